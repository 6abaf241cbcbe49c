//! A trial from its configuration to its record, for the command, the nodes and the tests alike.
//!
//! This is where the parts meet: it chooses the libraries, opens devices and pages, and keeps real time. What a trial *is*
//! lives in `proact-testbed`.
// They panic where the output is closed or full.
#![deny(clippy::print_stdout, clippy::print_stderr)]
#![allow(clippy::disallowed_methods)] // Here are the clock, the threads and the files that stages lack.
#![cfg_attr(test, allow(clippy::unwrap_used))]

pub mod agent;
pub mod analysis;
mod arm;
mod armband;
pub mod batch;
mod calibrations;
mod centred;
pub mod compare;
mod console;
mod counterfactual;
mod dense_spectra;
pub mod digests;
mod disk;
pub mod doctor;
mod experimenter;
pub mod film;
pub mod film_of_bag;
mod film_of_emg;
pub mod fit;
mod head_shoulder;
mod heap;
pub mod intent_process;
pub mod intent_scores;
mod intent_view;
pub mod lab_streaming;
mod latency;
pub mod libraries;
mod limb;
mod live;
pub mod method_process;
#[cfg(feature = "ros")]
pub mod nodes;
mod pace;
mod page_content;
pub mod paper;
mod person;
mod pose_log;
pub mod query;
mod reach_map;
mod record;
mod recorded_bodies;
mod registry;
mod replay;
mod result_card;
mod retrace;
#[cfg(feature = "ros")]
mod ros_bus;
mod ros_capture;
mod rosbridge;
mod run;
pub mod source;
pub mod stream_view;
pub mod study;
mod threads;
mod trace_envelope;
mod tracked_body;
mod tracked_limb;
mod tracked_shoulder;
pub mod trial;
mod trial_choice;
mod trial_markers;
mod trunk_log;
pub mod use_log;
pub mod vmpl;
pub mod vmpl_ghost;
mod wearer;
mod whole;
mod worn_headset;
mod xdf;

pub use arm::{Arm, ArmError};
pub use armband::LiveArmband;
pub use calibrations::{
    CALIBRATIONS_DIR, Calibrated, CalibrationFileError, CalibrationSource, Calibrations, SavedCalibration,
};
pub use centred::CentredStream;
pub use console::{answer, lines_of, tell};
pub use counterfactual::{Counterfactual, counterfactual};
pub use experimenter::Experimenter;
pub use head_shoulder::HeadShoulder;
pub use heap::settle_heap;
pub use limb::{LimbError, LimbReceiver};
pub use live::{Ended, LiveTrial, TrialInputs};
pub use pace::Pace;
pub use page_content::{driven_content, page_content};
pub use person::{EyeTracker, LivePerson, drive_by_page};
pub use pose_log::{HEAD_BODY, PoseLog};
pub use reach_map::ReachMap;
pub use record::{Recorder, RecorderError, default_dir};
pub use recorded_bodies::{RecordedBodies, RecordedBodyError, timed as recorded_poses};
pub use registry::Registry;
pub use replay::{OtherVersions, Replanned, ReplayOptions, Replayed, replay_trial};
pub use result_card::{CardTally, ResultCards};
pub use retrace::{Retraced, retrace};
pub use ros_capture::ROS_SCHEMES;
#[cfg(feature = "ros")]
pub use rosbridge::relay;
pub use rosbridge::{Rosbridge, RosbridgePlace, drive_by_topics};
pub use run::{Audience, run_to_end, tell_faults};
pub use tracked_body::{Followable, MocapAxes, MocapAxesError, TrackedBody};
pub use tracked_limb::{LimbBodies, LimbBodiesError, TrackedLimb, TrackedLimbError};
pub use tracked_shoulder::{TrackedShoulder, TrackedShoulderError};
pub use trial_choice::{DEFAULT_METHOD, TrialContext, sets_emg, trial_config};
pub use trial_markers::TrialMarkers;
pub use trunk_log::{TRUNK_FILE, read_trunk, trunk_text};
pub use wearer::{Held, wearer_codes};
pub(crate) use whole::claim_folder;
pub use whole::write_whole;
pub use worn_headset::{MarkedHeadset, WornHeadset};
pub use xdf::{ExportedStream, ExportedXdf, export_xdf};

/// What a build without the feature `ros` says.
#[cfg(not(feature = "ros"))]
pub const NO_ROS: &str = "this build knows no ROS; build it with: cargo build --release -p proact-cli --features ros \
                          (docs/ros1.md names the packages that this needs)";
