//! The kinds of motion capture by their schemes, in one table.

use super::{
    HostClock, MotionCapture, PlayedCapture,
    natnet::{NatNetClient, NatNetOptions},
    vrpn::VrpnClient,
};
use crate::{DeviceError, SourceName};
use proact_localization::{TrackingAxes, UpAxis};
use std::path::Path;

/// Opens the system at an address.
pub type OpenCapture = fn(&str, HostClock) -> Result<Box<dyn MotionCapture>, DeviceError>;

/// A kind of motion capture.
#[derive(Clone, Copy, Debug)]
pub struct CaptureScheme {
    /// What its name begins with, such as `vrpn`.
    pub scheme: &'static str,
    /// How it is named, such as `vrpn:HOST[:PORT]/BODY`.
    pub form: &'static str,
    /// Which axis is up unless the laboratory says otherwise.
    pub up: UpAxis,
    /// How it is opened.
    pub open: OpenCapture,
}

/// The kinds that there are. This is the one place to add another.
pub const CAPTURE_SCHEMES: [CaptureScheme; 4] = [
    CaptureScheme {
        scheme: "vrpn",
        form: "vrpn:HOST[:PORT]/BODY",
        up: UpAxis::Z,
        open: |host, clock| Ok(Box::new(VrpnClient::open(host, clock)?)),
    },
    CaptureScheme {
        scheme: "natnet",
        form: "natnet:HOST[:PORT]/BODY",
        up: UpAxis::Y,
        open: |host, clock| Ok(Box::new(NatNetClient::open(host, NatNetOptions::default(), clock)?)),
    },
    CaptureScheme { scheme: "lsl", form: "lsl:STREAM/BODY", up: UpAxis::Z, open: open_lsl },
    CaptureScheme {
        scheme: "file",
        form: "file:PATH/BODY",
        up: UpAxis::Z,
        open: |path, clock| Ok(Box::new(PlayedCapture::open(Path::new(path), clock)?)),
    },
];

/// The scheme of a name, and its place and body.
fn parts<'a>(
    schemes: &'a [CaptureScheme],
    name: &'a SourceName,
) -> Result<(&'a CaptureScheme, &'a str, &'a str), DeviceError> {
    let unknown = || DeviceError::UnknownSource {
        got: name.to_string(),
        known: schemes.iter().map(|scheme| scheme.form).collect::<Vec<_>>().join(", "),
    };
    let found = schemes.iter().find(|scheme| scheme.scheme == name.scheme()).ok_or_else(unknown)?;
    let address = name.address();
    // Sensors of VRPN are DEVICE/NUMBER, so a host ends at the first slash; a path has many.
    let parts = if found.scheme == "file" { address.rsplit_once('/') } else { address.split_once('/') };
    let (place, body) =
        parts.filter(|(place, body)| !place.is_empty() && !body.is_empty()).ok_or_else(unknown)?;
    Ok((found, place, body))
}

/// The body that the name of a source ends with.
///
/// # Errors
/// [`DeviceError::UnknownSource`].
pub fn body_of<'a>(schemes: &'a [CaptureScheme], name: &'a SourceName) -> Result<&'a str, DeviceError> {
    parts(schemes, name).map(|(_, _, body)| body)
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
        let (found, place, body) = parts(schemes, name)?;
        let clock = HostClock::start();
        Ok(Self {
            name: name.clone(),
            capture: (found.open)(place, clock)?,
            body: body.to_owned(),
            axes: TrackingAxes { up: found.up, ..TrackingAxes::default() },
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
