//! What a person may have connected to a trial beside the page, on the command line.

use crate::rosbridge_args::RosbridgeArgs;
use clap::Args;
use proact_app::vmpl::{VmplError, VmplPublisher};
use proact_app::{
    CALIBRATIONS_DIR, Calibrations, LimbBodies, LimbReceiver, MocapAxes, Registry, TrackedShoulder,
    TrialMarkers, UserDevices, print_status,
};
use proact_arm::Side;
use proact_devices::motion_capture::{LEFT_CONTROLLER, OpenedCapture, RIGHT_CONTROLLER, body_name};
use proact_devices::{DeviceError, FeedbackSinks, GazeDevice, GazeReceiver, SinkScheme, SourceName};
#[cfg(feature = "lsl")]
use proact_devices::{LslGaze, LslMarkers};
use proact_localization::FilterProfile;
use proact_testbed::RunningTrial;
use std::{error::Error, net::SocketAddr, path::PathBuf};

/// Where cues go.
#[derive(Debug, Args)]
pub(crate) struct FeedbackArgs {
    /// Where cues go, to be heard or felt; may be repeated
    #[arg(long, value_name = "SINK")]
    feedback: Vec<String>,
}

impl FeedbackArgs {
    pub(crate) fn open(&self, sinks: &[SinkScheme]) -> Result<FeedbackSinks, DeviceError> {
        FeedbackSinks::open(sinks, &self.feedback)
    }
}

/// A virtual limb that shows the arm.
#[derive(Debug, Args)]
pub(crate) struct VmplArgs {
    /// Show the arm on a virtual limb of miniVIE too, at its command port, such as 127.0.0.1:25000
    #[arg(long, value_name = "ADDRESS:PORT")]
    vmpl: Option<SocketAddr>,
}

impl VmplArgs {
    pub(crate) fn open(&self, trial: &RunningTrial) -> Result<Option<VmplPublisher>, VmplError> {
        self.vmpl.map(|address| VmplPublisher::new(address, trial.testbed().model())).transpose()
    }
}

/// A motion capture system that sees the shoulder.
#[derive(Debug, Args)]
pub(crate) struct MocapArgs {
    /// Follow a shoulder that motion capture sees: vrpn:HOST[:PORT]/BODY, natnet:HOST[:PORT]/BODY, ros:/TOPIC,
    /// tf:PARENT/FRAME, headset:left_controller|right_controller, lsl:STREAM/BODY or file:PATH/BODY (docs/motion_capture.md)
    #[arg(long, value_name = "SOURCE")]
    mocap: Option<SourceName>,
    /// How its axes lie, where that differs from what such systems usually send: up=x|y|z, meters_per_unit=NUMBER, and
    /// heading_deg=NUMBER for where the person looks, counter-clockwise from its x axis seen from above
    #[arg(long, value_name = "KEY=VALUE,..", requires = "mocap")]
    mocap_axes: Option<MocapAxes>,
    /// Folder with what proact localize found; what is good is used and kept with each record
    #[arg(long, value_name = "DIR", default_value = CALIBRATIONS_DIR, requires = "mocap")]
    calibrations: PathBuf,
    /// Follow the person's own limb by bodies of the same system: on the upper arm, and on the forearm where there is one
    #[arg(long, value_name = "UPPER[,FOREARM]", requires = "mocap")]
    mocap_limb: Option<LimbBodies>,
    /// Follow the person's own hand by a body of the same system on it, for method imitate: joints by inverse kinematics
    #[arg(long, value_name = "BODY", requires = "mocap", conflicts_with = "mocap_limb")]
    mocap_hand: Option<String>,
    /// Keep where the trunk is with each record, for compensation in the analysis: a body of the same system on the breastbone
    #[arg(long, value_name = "BODY", requires = "mocap")]
    mocap_trunk: Option<String>,
    /// How its poses are smoothed: default, or original for the first testbed's mean of ten
    #[arg(long, value_name = "NAME", default_value = "default", requires = "mocap", value_parser = ["default", "original"])]
    mocap_filter: String,
    /// Record all poses, and those of a headset, to this file, for proact localize
    #[arg(long, value_name = "FILE", requires = "mocap")]
    mocap_record: Option<PathBuf>,
}

impl MocapArgs {
    pub(crate) fn open_shoulder(
        &self,
        registry: &Registry,
    ) -> Result<Option<TrackedShoulder>, Box<dyn Error>> {
        let Some(name) = &self.mocap else { return Ok(None) };
        let opened = OpenedCapture::open(&registry.captures, name)?;
        print_status(format_args!("motion capture: {}, body {}", opened.capture.name(), opened.body));
        let found = Calibrations::load(&self.calibrations)?;
        for (kind, line, _) in found.summaries() {
            print_status(format_args!("calibration of the {kind} {line}"));
        }
        let used = found.clone().for_body(&opened.body);
        if used.shoulder.is_none() {
            let why = match &found.shoulder {
                Some(saved) => format!("that of {} is not one of {}", saved.calibration.body, opened.body),
                None => format!("there is none in {}", self.calibrations.display()),
            };
            print_status(format_args!(
                "no calibration of the shoulder is used ({why}): the arm hangs where the set-up has the shoulder; see proact localize"
            ));
        }
        let shoulder = TrackedShoulder::new(opened, self.mocap_axes.unwrap_or_default(), used);
        let profile = match self.mocap_filter.as_str() {
            "original" => FilterProfile::Original,
            _ => FilterProfile::Default,
        };
        let shoulder = shoulder
            .with_filter(profile)
            .with_limb(self.mocap_limb.clone().or(self.mocap_hand.clone().map(LimbBodies::Hand)))
            .with_trunk(self.mocap_trunk.clone());
        Ok(Some(shoulder.with_pose_log(self.mocap_record.as_deref())))
    }

    /// The headset's controller that is the shoulder, if one is.
    pub(crate) fn shoulder_controller(&self) -> Option<Side> {
        let name = self.mocap.as_ref().filter(|name| name.scheme() == "headset")?;
        match name.address() {
            LEFT_CONTROLLER => Some(Side::Left),
            RIGHT_CONTROLLER => Some(Side::Right),
            _ => None,
        }
    }

    /// What a trial with this shoulder rests on.
    pub(crate) fn load_calibrations(&self, registry: &Registry) -> Result<Calibrations, Box<dyn Error>> {
        let Some(name) = &self.mocap else { return Ok(Calibrations::default()) };
        let body = body_name(&registry.captures, name)?;
        Ok(Calibrations::load(&self.calibrations)?.for_body(body))
    }
}

/// What a person who drives may have connected.
#[derive(Debug, Args)]
pub(crate) struct UserDeviceArgs {
    /// Take gaze from an eye tracker's program over UDP, on port 25040 unless another is given
    #[arg(long, value_name = "PORT", num_args = 0..=1, default_missing_value = "25040")]
    gaze_udp: Option<u16>,
    /// Take gaze from an eye tracker's stream of the lab streaming layer: its name, or the only one of type Gaze
    #[cfg(feature = "lsl")]
    #[arg(long, value_name = "NAME", num_args = 0..=1, conflicts_with = "gaze_udp")]
    gaze_lsl: Option<Option<String>>,
    /// Send markers on a stream of the lab streaming layer with this name, for other recorders: 0 the experiment begins,
    /// 1 a trial or practice begins, 2 it ends, 3 the program leaves
    #[cfg(feature = "lsl")]
    #[arg(long, value_name = "NAME")]
    markers_lsl: Option<String>,
    /// Follow a tracked limb that a program sends over UDP as {"angles": [..]}, on port 25041 unless another is given
    #[arg(long, value_name = "PORT", num_args = 0..=1, default_missing_value = "25041", conflicts_with_all = ["mocap_limb", "mocap_hand"])]
    limb_udp: Option<u16>,
    /// Carry the shoulder with the neck of whoever wears the headset, without cameras
    #[arg(long, conflicts_with = "mocap")]
    shoulder_from_head: bool,
    #[command(flatten)]
    pub(crate) mocap: MocapArgs,
    #[command(flatten)]
    feedback: FeedbackArgs,
    #[command(flatten)]
    vmpl: VmplArgs,
    #[command(flatten)]
    pub(crate) rosbridge: RosbridgeArgs,
}

impl UserDeviceArgs {
    pub(crate) fn open(
        &self,
        registry: &Registry,
        trial: &RunningTrial,
    ) -> Result<UserDevices, Box<dyn Error>> {
        let tracker = self.open_gaze_tracker()?;
        let limb = self.limb_udp.map(LimbReceiver::bind).transpose()?;
        if let Some(limb) = &limb {
            print_status(format_args!("limb: UDP {}", limb.address()?));
        }
        Ok(UserDevices::new(tracker, limb, self.feedback.open(&registry.sinks)?, self.rosbridge.open(trial)?)
            .with_vmpl(self.vmpl.open(trial)?)
            .with_markers(self.open_markers()?)
            .with_shoulder(self.mocap.open_shoulder(registry)?, trial)
            .with_head_tracked_shoulder(self.shoulder_from_head))
    }

    /// Whether something gives angles for every joint of the arm.
    pub(crate) fn tracks_limb(&self) -> bool {
        self.limb_udp.is_some() || self.mocap.mocap_hand.is_some()
    }

    #[cfg(feature = "lsl")]
    fn open_markers(&self) -> Result<Option<TrialMarkers>, DeviceError> {
        let Some(name) = &self.markers_lsl else { return Ok(None) };
        let mut outlet = LslMarkers::open(name)?;
        let send = move |marker: &str, age_secs: f64| {
            if let Err(error) = outlet.send(marker, age_secs) {
                print_status(format_args!("marker {marker}: {error}"));
            }
        };
        Ok(Some(TrialMarkers::new(Box::new(send))))
    }

    #[cfg(not(feature = "lsl"))]
    fn open_markers(&self) -> Result<Option<TrialMarkers>, DeviceError> {
        Ok(None)
    }

    fn open_gaze_tracker(&self) -> Result<Option<Box<dyn GazeDevice>>, Box<dyn Error>> {
        #[cfg(feature = "lsl")]
        if let Some(name) = &self.gaze_lsl {
            let tracker = LslGaze::open(name.as_deref())?;
            print_status(format_args!("gaze: {}, lab streaming layer", tracker.name()));
            return Ok(Some(Box::new(tracker)));
        }
        let Some(port) = self.gaze_udp else { return Ok(None) };
        let tracker = GazeReceiver::bind(port)?;
        print_status(format_args!("gaze: UDP {}", tracker.address()?));
        Ok(Some(Box::new(tracker)))
    }
}
