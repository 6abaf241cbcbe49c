//! The kinds of motion capture by their schemes, in one table.

use super::{
    ControllerCapture, HostClock, MotionCapture, PosePlayback,
    natnet::{NatNetClient, NatNetOptions},
    vrpn::VrpnClient,
};
use crate::{DeviceError, SourceName};
use proact_localization::{TrackingAxes, UpAxis};
use std::path::Path;

/// Opens the system at a place for the sake of a body. Most bring all other bodies too.
pub type OpenCapture = fn(&str, &str, HostClock) -> Result<Box<dyn MotionCapture>, DeviceError>;

/// Splits what stands behind the scheme into place and body; none if it is no such name.
pub type SplitName = fn(&str) -> Option<(&str, &str)>;

/// How names are split.
pub mod split {
    /// At the first slash: sensors of VRPN are `DEVICE/NUMBER`, so a host ends there.
    pub fn first_slash(address: &str) -> Option<(&str, &str)> {
        address.split_once('/')
    }

    /// At the last slash: a path has many.
    pub fn last_slash(address: &str) -> Option<(&str, &str)> {
        address.rsplit_once('/')
    }

    /// Not at all: the place is the body's name too.
    pub fn unsplit(address: &str) -> Option<(&str, &str)> {
        Some((address, address))
    }
}

/// A kind of motion capture.
#[derive(Clone, Copy, Debug)]
pub struct CaptureScheme {
    /// What its name begins with, such as `vrpn`.
    pub scheme: &'static str,
    /// How it is named, such as `vrpn:HOST[:PORT]/BODY`.
    pub form: &'static str,
    /// How the rest of its name is split.
    pub split: SplitName,
    /// Which axis is up unless the laboratory says otherwise.
    pub up_axis: UpAxis,
    /// How it is opened.
    pub open: OpenCapture,
}

/// The kinds that there are. This is the one place to add another.
pub const CAPTURE_SCHEMES: [CaptureScheme; 5] = [
    CaptureScheme {
        scheme: "vrpn",
        form: "vrpn:HOST[:PORT]/BODY",
        split: split::first_slash,
        up_axis: UpAxis::Z,
        open: |host, _, clock| Ok(Box::new(VrpnClient::open(host, clock)?)),
    },
    CaptureScheme {
        scheme: "natnet",
        form: "natnet:HOST[:PORT]/BODY",
        split: split::first_slash,
        up_axis: UpAxis::Y,
        open: |host, _, clock| Ok(Box::new(NatNetClient::open(host, NatNetOptions::default(), clock)?)),
    },
    CaptureScheme {
        scheme: "lsl",
        form: "lsl:STREAM/BODY",
        split: split::first_slash,
        up_axis: UpAxis::Z,
        open: |stream, _, clock| open_lsl(stream, clock),
    },
    CaptureScheme {
        scheme: "headset",
        form: "headset:left_controller|right_controller",
        split: split::unsplit,
        up_axis: UpAxis::Z,
        open: |_, body, clock| Ok(Box::new(ControllerCapture::open(body, clock)?)),
    },
    CaptureScheme {
        scheme: "file",
        form: "file:PATH/BODY",
        split: split::last_slash,
        up_axis: UpAxis::Z,
        open: |path, _, clock| Ok(Box::new(PosePlayback::open(Path::new(path), clock)?)),
    },
];

/// The scheme of a name, and its place and body.
fn split_source_name<'a>(
    schemes: &'a [CaptureScheme],
    name: &'a SourceName,
) -> Result<(&'a CaptureScheme, &'a str, &'a str), DeviceError> {
    let unknown = || DeviceError::UnknownSource {
        got: name.to_string(),
        known: schemes.iter().map(|scheme| scheme.form).collect::<Vec<_>>().join(", "),
    };
    let found = schemes.iter().find(|scheme| scheme.scheme == name.scheme()).ok_or_else(unknown)?;
    let parts = (found.split)(name.address());
    let (address, body) =
        parts.filter(|(address, body)| !address.is_empty() && !body.is_empty()).ok_or_else(unknown)?;
    Ok((found, address, body))
}

/// The body that the name of a source ends with.
///
/// # Errors
/// [`DeviceError::UnknownSource`].
pub fn body_name<'a>(schemes: &'a [CaptureScheme], name: &'a SourceName) -> Result<&'a str, DeviceError> {
    split_source_name(schemes, name).map(|(_, _, body)| body)
}

/// A system that is open, and whose body is followed.
pub struct OpenedCapture {
    /// As it was named.
    pub name: SourceName,
    /// What brings poses.
    pub capture: Box<dyn MotionCapture>,
    /// The body.
    pub body: String,
    /// Unit and axes, unless the laboratory says otherwise.
    pub axes: TrackingAxes,
    /// What arrivals are stamped with.
    pub clock: HostClock,
}

impl OpenedCapture {
    /// Opens what is called `name`, such as `vrpn:192.168.1.5/Shoulderpad`. Of a file the last part of the path is the body.
    ///
    /// # Errors
    /// [`DeviceError::UnknownSource`] with the kinds that there are; what the source says.
    pub fn open(schemes: &[CaptureScheme], name: &SourceName) -> Result<Self, DeviceError> {
        let (found, address, body) = split_source_name(schemes, name)?;
        let clock = HostClock::start();
        Ok(Self {
            name: name.clone(),
            capture: (found.open)(address, body, clock)?,
            body: body.to_owned(),
            axes: TrackingAxes { up: found.up_axis, ..TrackingAxes::default() },
            clock,
        })
    }
}

#[cfg(feature = "lsl")]
fn open_lsl(name: &str, clock: HostClock) -> Result<Box<dyn MotionCapture>, DeviceError> {
    Ok(Box::new(crate::LslCapture::open(name, clock)?))
}

#[cfg(not(feature = "lsl"))]
fn open_lsl(_name: &str, _clock: HostClock) -> Result<Box<dyn MotionCapture>, DeviceError> {
    Err(DeviceError::Source { name: "lsl".to_owned(), reason: crate::NO_LSL.to_owned() })
}
