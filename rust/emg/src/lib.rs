//! EMG stage: from samples to the gesture in force.
//!
//! `samples -> sliding windows -> features -> class posterior -> decision rule -> gesture`, for live streams and
//! for recordings through the same code. Pure: no clock, no files, no threads, no randomness; the same samples
//! at the same times give the same outputs. [`EmgPipeline::step`] does not allocate.
//!
//! Around it: [`EmgModel`] is the contents of a model file, [`Calibration`] the guided session that makes one,
//! [`SequenceTest`], [`HoldTest`], [`MotionTest`] and [`CursorTest`] say whether a person can use it. [`QualityMonitor`] watches the
//! channels, [`check_rotation`] finds a band that was turned, [`Adaptation`] follows the user where a study wants that.
//!
//! [`Feature`] lists the features, [`FeatureSet`] the groups and the order of their values. Features and classifier
//! follow LibEMG 2.0.3 and scikit-learn's `svd` solver number by number; the tests
//! compare with vectors that those two computed.
//!
//! ```
//! use proact_emg::{Classifier, EmgConfig, EmgPipeline, extract_features};
//! use proact_types::{EmgSample, Command, SimTime};
//!
//! // A toy armband with two channels: one muscle for closing, nothing at rest.
//! let config = EmgConfig { channels: 2, rate_hz: 200.0, ..EmgConfig::default() };
//! let sample = |k: u64, amplitude: f64| EmgSample {
//!     counter: k,
//!     channels: [amplitude * (k as f64 * 1.7).sin(), (k as f64 * 2.9).cos()].into_iter().collect(),
//! };
//! let rest: Vec<EmgSample> = (0..400).map(|k| sample(k, 1.0)).collect();
//! let close: Vec<EmgSample> = (0..400).map(|k| sample(k, 20.0)).collect();
//!
//! let mut features = extract_features(&config, &rest)?;
//! let mut labels = vec![Command::NoMotion; features.len()];
//! features.extend(extract_features(&config, &close)?);
//! labels.resize(features.len(), Command::HandClose);
//! let classifier = Classifier::train(&config, &features, &labels)?;
//!
//! let mut pipeline = EmgPipeline::new(&config, classifier)?;
//! let outputs: Vec<_> =
//!     close.iter().filter_map(|s| pipeline.step(SimTime(s.counter * 5), std::slice::from_ref(s))).collect();
//! assert_eq!(outputs[0].gesture, Command::NoMotion, "one window does not move the arm");
//! assert_eq!(outputs[2].gesture, Command::HandClose);
//! # Ok::<(), proact_emg::EmgError>(())
//! ```

mod adaptation;
mod calibration;
mod classifier;
mod config;
mod decision;
mod decoder_process;
mod decoder_tap;
mod discriminant;
mod drives;
mod error;
mod extract;
mod feature;
mod feature_layout;
mod feature_set;
mod feature_space;
mod features;
mod fft;
mod filter;
mod fitts;
mod goertzel;
mod imu;
mod lanes;
mod lda;
mod live_check;
mod liveness;
mod loss_monitor;
mod metrics;
mod model;
mod moments;
mod motion_assessment;
mod pipeline;
mod quality;
mod recording_quality;
mod regression;
mod rotation;
mod selection;
mod spectrum;
mod tac;
mod two_site;
mod usability;
mod welch;
mod window;

pub use adaptation::{Adaptation, AdaptationConfig};
pub use calibration::{
    Calibration, CalibrationConfig, CalibrationEvent, CalibrationPhase, CalibrationReport, DcOffsetSource,
    DriveScore, Prompt, Repetition, RepetitionRejection, RepetitionScore, cross_validate,
};
pub use classifier::{ClassPosterior, Classifier, EffortScale, Prediction};
pub use config::{
    CovarianceNormalization, DEFAULT_MAJORITY_VOTE_WINDOWS, DEFAULT_REJECTION_THRESHOLD, EmgConfig,
    GapInterpolationConfig, MAX_MAJORITY_VOTE_WINDOWS, Priors, PublishRule, RATES_HZ, WindowLength,
};
pub use decision::{Decision, DecisionRule, MajorityVote};
pub use decoder_process::{
    DecodeRequest, DecoderProcess, DecoderProcessConfig, DecoderProcessInput, start_request,
};
pub use discriminant::{ClassifierKind, MuscleSite};
pub use error::EmgError;
pub use extract::{DecoderInput, extract_decoder_inputs, extract_features, extract_features_with_amplitudes};
pub use feature::Feature;
pub use feature_layout::FeatureLayout;
pub use feature_set::FeatureSet;
pub use feature_space::{FeatureSpace, FeatureSpaceAxes, feature_space};
pub use features::{FeatureExtractor, FeatureVector};
pub use filter::EmgFilter;
pub use fitts::{CursorConfig, CursorEvent, CursorMovement, CursorReport, CursorTest};
pub use imu::{ImuChannel, ImuConfig};
pub use lda::Lda;
pub use live_check::LiveCheck;
pub use liveness::{Liveness, LivenessConfig, SignalFault, noise_floors};
pub use metrics::RecognitionMetrics;
pub use model::{ChannelStatistics, EmgModel, MODEL_FORMAT, StreamFormat};
pub use moments::ClassMoments;
pub use motion_assessment::{MotionAttempt, MotionReport, MotionTest, MotionTestConfig};
pub use pipeline::{EmgOutput, EmgPipeline, StreamEvents};
pub use quality::{
    ChannelFault, ChannelQuality, ChannelStatus, QualityConfig, QualityMonitor, StreamQuality,
};
pub use recording_quality::{
    Coincidence, RecordedRepetition, RecordingFault, RecordingSet, check_recordings,
};
pub use regression::RegressionConfig;
pub use rotation::{BandProposal, RotationReport, ShiftEvidence, accuracy_at_shift, check_rotation};
pub use selection::{SelectedFeature, SelectionCriterion, SelectionData, select_features};
pub use tac::{TacAxis, TacConfig, TacPhase, TacReport, TacTarget, TacTest, TacTrial};
pub use two_site::TwoSiteConfig;
pub use usability::{
    HoldConfig, HoldReport, HoldTest, SequenceConfig, SequenceMistake, SequenceReport, SequenceTest,
};
pub use welch::{WelchSpectrum, welch};
pub use window::{SlidingWindow, StreamCounts, WindowView};
