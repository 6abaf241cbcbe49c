//! Sources of what a person sends: EMG and gaze. Recordings, a generator of synthetic EMG, a gaze tracker's errors.
//!
//! Files are read here, when a source is made; what runs during a trial is deterministic: every random choice
//! comes from [`random_stream`], so the same seed gives the same samples. Implements the ports of `testbed`.
//!
//! Live streams come through one trait, [`SampleSource`]: the armbands gForce ([`gforce`]) and Myo ([`myo`]) over any
//! link (Bluetooth with the feature `ble`, which needs libdbus-1-dev on Linux), streams of the lab streaming layer (feature `lsl`, which builds
//! liblsl), recordings played as if live, and doubles with faults for tests. [`EmgRecorder`] keeps them;
//! [`LibEmgReceiver`] and [`LibEmgSender`] speak with LibEMG's programs. [`GazeReceiver`] takes an eye tracker's samples,
//! poses of bodies come through [`motion_capture::MotionCapture`],
//! and a [`FeedbackSink`] makes cues heard or felt. What there is of both is found by its scheme: [`SourceRegistry`],
//! [`SINK_SCHEMES`]. Only these know the real clock.
//!
//! ```
//! use proact_devices::{EmgOrigin, prepare_emg};
//! use proact_emg::EmgPipeline;
//! use proact_types::{Command, SimTime};
//!
//! let mut setup = prepare_emg(&EmgOrigin::Synthetic, 7)?;
//! let mut pipeline = EmgPipeline::new(&setup.config, setup.classifier.clone())?;
//! let mut gesture = Command::NoMotion.into();
//! for tick in 0..1000 {
//!     let samples = setup.feed.sample_at(SimTime(tick), Command::HandClose);
//!     if let Some(output) = pipeline.step(SimTime(tick), &samples) {
//!         gesture = output.gesture;
//!     }
//! }
//! assert_eq!(gesture, Command::HandClose);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
// They panic where the output is closed or full.
#![deny(clippy::print_stdout, clippy::print_stderr)]
#![cfg_attr(test, allow(clippy::unwrap_used))]
// Reading recordings, and streams by the real clock, is what this crate is for.
#![allow(clippy::disallowed_methods)]

/// What a build without the feature `lsl` says.
#[cfg(not(feature = "lsl"))]
pub const NO_LSL: &str = "this proact was built without the lab streaming layer; set PROACT_FEATURES=lsl for ./proact, or build with \
     --features lsl; both need cmake and a C++ compiler";

mod amplifier;
mod emg_setup;
mod error;
mod evaluate;
mod external_decoder;
mod feed;
mod feedback;
mod gaze_tracker;
mod gaze_udp;
pub mod gforce;
#[cfg(feature = "lsl")]
mod lab_streaming;
mod libemg;
mod line_process;
mod live;
mod metadata;
pub mod motion_capture;
pub mod myo;
mod ports;
mod random;
mod raw_keys;
mod recorder;
mod recording;
mod recording_faults;
mod recording_folder;
mod refused_datagrams;
mod sample_file;
mod simulated_eye_tracker;
mod simulated_imu;
mod sources;
mod synthetic;
mod vmpl;
mod vmpl_ghost;

pub use amplifier::{AmplifierChannel, AmplifierLayout};
pub use emg_setup::{
    EmgOrigin, EmgSetup, default_config, prepare_emg, prepare_emg_with, prepare_model, train_classifier,
};
pub use error::DeviceError;
pub use evaluate::{Evaluation, evaluate, leave_one_out};
pub use external_decoder::{
    ExternalDecoderProcess, open_pipeline, read_process_file, train_process, try_process,
};
pub use feed::EmgFeed;
pub use feedback::{
    FeedbackSink, FeedbackSinks, OpenSink, SINK_SCHEMES, SinkScheme, UdpFeedback, VibrationDevice,
    VibrationDriver, VibrationLine,
};
pub use gaze_tracker::{GazeDevice, GazeFrame, RawGazeSample};
pub use gaze_udp::{GAZE_UDP_PORT, GazeReceiver};
#[cfg(feature = "lsl")]
pub use lab_streaming::{LslCapture, LslGaze, LslMarkers, LslOutlet, LslSource};
pub use libemg::{LIBEMG_PORT, LibEmgOutput, LibEmgReceiver, LibEmgSender};
pub use line_process::{LineProcess, LineProcessError};
pub use live::{
    EmgPacket, FaultySource, InjectedFault, KeyboardSource, Pacing, PlaybackSource, SampleSource,
    ScriptedEvent, ScriptedSource, SimulatedPersonSource, SourceClock, SourceCounts, SourceEvent, SourceInfo,
};
pub use metadata::read_class_map;
pub use random::random_stream;
pub use recorder::{EmgRecorder, RecordedStream, read_recorded};
pub use recording::{MYO_RATE_HZ, Recording, Recordings};
pub use recording_faults::{FaultPolicy, accepted_fault_texts, findings_json};
pub use recording_folder::RecordingFolder;
pub use refused_datagrams::RefusedDatagrams;
pub use sample_file::{SampleFile, read_samples};
pub use simulated_eye_tracker::SimulatedEyeTracker;
pub use simulated_imu::SimulatedImu;
pub use sources::{
    LibEmgEndpoint, OpenSource, REACTION_TIME, SourceAddress, SourceName, SourceOptions, SourceRegistry,
    SourceScheme,
};
pub use synthetic::{FittedGesture, SyntheticEmg, SyntheticModel};
pub use vmpl::{
    VMPL_ARM_JOINTS, VMPL_FINGERS, VMPL_JOINTS, VMPL_LEFT_PORTS, VMPL_RIGHT_PORTS, VmplCommand, VmplDisplay,
    VmplPercepts, vmpl_joint_names,
};
pub use vmpl_ghost::{VMPL_LEFT_GHOST_PORTS, VMPL_RIGHT_GHOST_PORTS, VmplGhost, VmplGhostSetup};
