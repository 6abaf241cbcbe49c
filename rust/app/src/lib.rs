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
pub mod arm_comparison;
mod arm_picture;
mod arm_placement;
mod armband;
pub mod bag_playback;
pub mod batch;
mod calibrations;
mod console;
mod counterfactual;
mod dc_offset;
mod dense_spectra;
pub mod digests;
mod disk_sync;
pub mod doctor;
pub mod emg_model_file;
mod emg_playback;
pub mod fit;
mod head_tracked_shoulder;
mod headset_alignment;
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
mod page_content;
pub mod paper;
mod pose_log;
pub mod query;
mod reach_map;
mod real_time_pacer;
mod recompute;
mod record_keys;
pub mod record_playback;
mod recorded_bodies;
mod recorder;
mod registry;
mod renamed_key_warnings;
mod replay;
mod result_card;
#[cfg(feature = "ros")]
mod ros_bus;
mod ros_capture;
mod rosbridge;
mod run;
mod simulated_wearer;
mod status_publisher;
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
pub mod usage_log;
mod user_devices;
pub mod vmpl;
pub mod vmpl_ghost;
mod xdf_export;

pub use arm::{Arm, ArmError};
pub use arm_picture::{MeshPoints, arm_picture};
pub use arm_placement::{ArmPlacement, allow_lasting_contacts, place_arm, trial_obstacle};
pub use armband::LiveArmband;
pub use calibrations::{
    CALIBRATIONS_DIR, CalibrationFile, CalibrationFileError, CalibrationSource, Calibrations,
    SavedCalibration,
};
pub use console::{print_result, print_result_json, print_status, read_lines};
pub use counterfactual::{Counterfactual, counterfactual};
pub use dc_offset::OffsetCorrectedStream;
pub use head_tracked_shoulder::HeadTrackedShoulder;
pub use headset_alignment::{HeadsetAlignment, HeadsetMarkerCalibration};
pub use heap::settle_heap;
pub use limb::{LimbError, LimbReceiver};
pub use live::{LiveTrial, LiveTrialEnd, TrialInputs};
pub use page_content::{driven_page_content, page_content};
pub use pose_log::{HEAD_BODY, PoseLog};
pub use reach_map::ReachMap;
pub use real_time_pacer::RealTimePacer;
pub use recompute::{RecomputedRecord, recompute_record};
pub use record_keys::with_path;
pub use recorded_bodies::{RecordedBodies, RecordedBodyError, recorded_poses};
pub use recorder::{Recorder, RecorderError, default_dir};
pub use registry::Registry;
pub use renamed_key_warnings::warn_of_renamed_keys;
pub use replay::{ReplanResult, ReplayOptions, ReplayResult, VersionMismatch, replay_trial};
pub use result_card::{ResultCardCounter, ResultCards};
pub use ros_capture::ROS_SCHEMES;
#[cfg(feature = "ros")]
pub use rosbridge::serve_ros_graph;
pub use rosbridge::{Rosbridge, RosbridgeEndpoint, apply_topic_inputs};
pub use run::{RunOutputs, print_faults, run_to_end};
pub use simulated_wearer::{TimedGesture, wearer_code_source};
pub use status_publisher::StatusPublisher;
pub use tracked_body::{MocapAxes, MocapAxesError, TrackedBody, UsablePose};
pub use tracked_limb::{LimbBodies, LimbBodiesError, TrackedLimb, TrackedLimbError};
pub use tracked_shoulder::{TrackedShoulder, TrackedShoulderError};
pub use trial_choice::{DEFAULT_METHOD, TrialContext, sets_emg, trial_config};
pub use trial_markers::TrialMarkers;
pub use trunk_log::{TRUNK_FILE, read_trunk, trunk_text};
pub use user_devices::{EyeTracker, UserDevices, apply_page_inputs};
pub use xdf_export::{ExportedStream, XdfExportSummary, export_xdf};

/// What a build without the feature `ros` says.
#[cfg(not(feature = "ros"))]
pub const NO_ROS: &str = "this proact was built without ROS 1. Install the Debian package of a release that has it, or build \
                          it in: PROACT_FEATURES=ros ./proact in the sources installs ros-std-msgs and the other \
                          message packages first (docs/ros1.md)";
