//! The page: a web server in a thread of its own that shows a trial in browsers and takes mouse and keys back.
//!
//! The testbed publishes [`DisplayFrame`](proact_types::DisplayFrame)s and drains [`ClientInput`]s; it is never
//! blocked by a browser. A client that reads too slowly misses frames, never events, and costs no memory. When
//! in doubt the arm stops: a client that holds a gesture and vanishes or falls silent releases it.
//!
//! Addresses: `/` the participant's page, `/experimenter` and `/spectator`, `/emg`, `/replay`; `/api/content` arm and scene,
//! `/api/trials` and `/api/trials/<number>` recorded trials, `/report` the report on them, `/meshes/<id>` the arm's meshes, `/live` the
//! WebSocket (protocol: [`live`]), `/camera.png` and `/camera.json` what a simulated [camera](proact_camera) sees,
//! `/healthz`. Who may connect is [`proact_http`]'s rule.
//!
//! It uses the real clock and threads. It does not compute anything of the trial, knows no ROS and reads no
//! files: the page is embedded when the crate is built, meshes come with the content.
//!
//! ```no_run
//! # fn example(arm: proact_arm::ArmModel, scene: proact_types::Scene, briefing: proact_types::Briefing, frame: proact_types::DisplayFrame)
//! #     -> Result<(), proact_bridge::BridgeError> {
//! use proact_bridge::{PageContent, PageOptions, PageServer};
//! let server = PageServer::start(
//!     PageOptions::default(),
//!     PageContent { title: "demo".into(), setup: "still".into(), arm, meshes: vec![], scene, briefing,
//!         interactive: true, lean: false, method: Default::default(), methods: vec![] },
//! )?;
//! println!("open {}", server.url());
//! server.publish(&frame);
//! for input in server.drain_inputs() {
//!     println!("{input:?}");
//! }
//! # Ok(())
//! # }
//! ```
// A web server lives by the real clock and in a thread of its own.
#![allow(clippy::disallowed_methods)]
#![cfg_attr(test, allow(clippy::unwrap_used))]

mod assets;
pub use assets::FIGURES_SCRIPT;
mod calibration;
mod calibration_view;
mod camera;
mod client_slots;
mod encoding;
mod error;
mod feed;
mod frame_latency;
mod gaze_check;
mod input;
mod input_arbiter;
pub mod live;
mod meshes;
mod recorded_signals;
mod round_trip;
mod server;
mod signals;
mod study;
mod tracking;
mod trials;
#[cfg(all(test, feature = "ts"))]
mod typescript;

pub use calibration::{CalibrationCommand, CalibrationServer};
pub use calibration_view::{
    CalibrationScreen, CalibrationView, ElectrodeView, GestureTest, TacAxisState, TestKind,
};
pub use error::BridgeError;
pub use feed::GhostArm;
pub use frame_latency::FrameLatency;
pub use gaze_check::{GazeCheck, GazePoint};
pub use input::{ClientInput, ControllerPose, PostTrialAction, StudyAction};
pub use input_arbiter::PageHeartbeat;
pub use meshes::MeshFile;
pub use recorded_signals::{RecordedEmg, RecordedWindow};
pub use server::{PageContent, PageOptions, PageServer};
pub use signals::{
    ChannelSpectrum, InertialValue, IntentDomain, IntentEstimate, LatencyRow, LatencyStage, ObjectResultRow,
    Recognition, ResultCard, Signals, TrialStatus,
};
pub use study::{
    AnswerInput, CurrentStepScreen, ExperimenterScreen, FormPair, FormScreen, NextSession, ParticipantRow,
    ParticipantScreen, PromptScreen, RefusedAnswer, SessionScreen, StepActivity, StepRow, StudyButton,
    StudyRequest, StudyScreen,
};
pub use tracking::{ActiveCalibration, PoseStreamStatistics, ReachGrid, ReachPoint, TrackingReport};
pub use trials::{RecordedTrial, TrialLibrary, TrialSummary};
