//! Regressors on a live stream: drives at the same time and in proportion, and none while the signal is not to be trusted.

use proact_emg::{
    CalibrationConfig, ClassifierKind, EmgConfig, EmgError, EmgModel, EmgOutput, EmgPipeline,
    RegressionConfig, cross_validate,
};
use proact_types::{Command, DegreeOfFreedom, EmgSample, SimTime};

/// One muscle below a channel for each of the four gestures.
const MUSCLES: [Command; 4] =
    [Command::WristExtension, Command::WristFlexion, Command::HandOpen, Command::HandClose];

fn config() -> EmgConfig {
    EmgConfig {
        channels: 4,
        rate_hz: 200.0,
        features: "MAV".parse().expect("known"),
        classifier: ClassifierKind::Linear,
        ..EmgConfig::default()
    }
}

/// Sample `k` (200 Hz) of muscles that are made as hard as `efforts`.
fn sample(k: u64, efforts: [f64; 4]) -> EmgSample {
    let value = |(c, effort): (usize, f64)| {
        let phase = k as f64 * (1.7 + 0.31 * c as f64);
        (1.0 + 20.0 * effort) * (phase.sin() + 0.3 * (2.3 * phase).cos())
    };
    EmgSample { counter: k, channels: efforts.into_iter().enumerate().map(value).collect() }
}

fn recordings() -> Vec<(Command, Vec<EmgSample>)> {
    let efforts = |gesture: Command| MUSCLES.map(|muscle| f64::from(u8::from(muscle == gesture)));
    let take =
        |gesture, from: u64| (gesture, (from..from + 400).map(|k| sample(k, efforts(gesture))).collect());
    (0..3).flat_map(|rep| Command::ALL.map(|gesture| take(gesture, 1000 * rep))).collect()
}

fn model(config: &EmgConfig) -> EmgModel {
    let recordings = recordings();
    let slices: Vec<_> = recordings.iter().map(|(gesture, samples)| (*gesture, samples.as_slice())).collect();
    EmgModel::train(config, &[0.0; 4], &slices).expect("good recordings")
}

fn pipeline(config: &EmgConfig) -> EmgPipeline {
    EmgPipeline::new(config, model(config).classifier).expect("they fit")
}

/// Runs `millis` from `from`, with a sample every 5 ms but those that `lost` says.
fn run(
    pipeline: &mut EmgPipeline,
    from: u64,
    millis: u64,
    efforts: [f64; 4],
    lost: impl Fn(u64) -> bool,
) -> Vec<EmgOutput> {
    let step = |tick: u64| {
        let arrived = tick.is_multiple_of(5) && !lost(tick);
        pipeline.step(SimTime(tick), arrived.then(|| sample(tick / 5, efforts)).as_slice())
    };
    (from..from + millis).filter_map(step).collect()
}

fn drives(outputs: &[EmgOutput]) -> [f64; 2] {
    let last = outputs.last().expect("a window ended");
    [last.drives[0], last.drives[1]]
}

#[test]
fn two_degrees_of_freedom_are_driven_in_proportion_and_at_the_same_time() {
    let driven = |efforts| drives(&run(&mut pipeline(&config()), 0, 1000, efforts, |_| false));
    assert_eq!(driven([0.0; 4]), [0.0; 2]);
    let near = |got: [f64; 2], expected: [f64; 2]| {
        let off = got.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(off < 0.1, "got {got:?}, expected {expected:?}");
    };
    near(driven([1.0, 0.0, 0.0, 0.0]), [1.0, 0.0]);
    near(driven([0.0, 0.5, 0.0, 0.0]), [-0.5, 0.0]);
    near(driven([0.6, 0.0, 0.0, 0.8]), [0.6, -0.8]);
    near(driven([3.0, 0.0, 3.0, 0.0]), [1.0, 1.0]);
    near(driven([0.15, 0.0, 0.0, 0.0]), [0.0, 0.0]);
}

#[test]
fn dead_band_and_smoothing_of_the_settings_are_those_that_act_whatever_the_training_had() {
    let classifier = model(&config()).classifier;
    let with = |regression: RegressionConfig| {
        let config = EmgConfig { regression, ..config() };
        EmgPipeline::new(&config, classifier.clone()).expect("they fit")
    };
    let wide = RegressionConfig { dead_band: 0.7, ..RegressionConfig::default() };
    let outputs = run(&mut with(wide), 0, 500, [0.6, 0.0, 0.0, 0.0], |_| false);
    assert_eq!((drives(&outputs), outputs[0].window_class), ([0.0; 2], Command::NoMotion.into()));
    let slow =
        RegressionConfig { smoothing_time_constant_ms: 150.0, dead_band: 0.0, ..RegressionConfig::default() };
    let outputs = run(&mut with(slow), 0, 400, [1.0, 0.0, 0.0, 0.0], |_| false);
    let wrist: Vec<f64> = outputs.iter().map(|output| output.drives[0]).collect();
    for (k, drive) in (1..).zip(&wrist) {
        let expected = 1.0 - (-50.0 * f64::from(k) / 150.0).exp();
        assert!((drive - expected).abs() < 0.05, "window {k}: {drive}, expected {expected}");
    }
}

#[test]
fn nothing_is_driven_after_a_silence_until_the_hand_relaxes_nor_in_a_window_with_bridged_samples() {
    let (mut pipeline, wrist) = (pipeline(&config()), [1.0, 0.0, 0.0, 0.0]);
    assert!(drives(&run(&mut pipeline, 0, 500, wrist, |_| false))[0] > 0.9);
    // Two samples in a row are lost: they are bridged, and only windows without them drive.
    let outputs = run(&mut pipeline, 500, 300, wrist, |tick| (560..570).contains(&tick));
    let zero = outputs.iter().filter(|output| output.drives[0] == 0.0).count();
    assert_eq!((outputs.len(), zero), (6, 2), "{outputs:?}");
    assert!(outputs.iter().all(|output| output.gesture == Command::WristExtension));

    let silent = run(&mut pipeline, 800, 300, wrist, |_| true);
    assert_eq!((silent.len(), silent[0].stale, drives(&silent)), (1, true, [0.0; 2]));
    let held = run(&mut pipeline, 1100, 500, wrist, |_| false);
    assert!(held.iter().all(|output| output.drives.iter().all(|drive| *drive == 0.0)), "{held:?}");
    assert_eq!(held.last().map(|output| output.window_class), Some(Command::WristExtension.into()));
    run(&mut pipeline, 1600, 300, [0.0; 4], |_| false);
    assert!(drives(&run(&mut pipeline, 1900, 300, wrist, |_| false))[0] > 0.9);
}

#[test]
fn a_model_of_a_regressor_is_read_as_it_was_written_and_cross_validated_by_degree_of_freedom() {
    let config = EmgConfig { classifier: ClassifierKind::Ridge, ..config() };
    let model = model(&config);
    let json = model.to_json().expect("sound");
    assert_eq!(EmgModel::from_json(&json), Ok(model.clone()));
    // Somebody swaps the gestures of the wrist in the file.
    let swapped = json.replace("wrist_extension/wrist_flexion", "wrist_flexion/wrist_extension");
    assert!(EmgModel::from_json(&swapped).is_err_and(|e| e.to_string().contains("does not fit")));
    let report = cross_validate(&config, &recordings()).expect("three repetitions");
    let names: Vec<DegreeOfFreedom> = report.drives.iter().map(|score| score.drive).collect();
    assert_eq!(names, [DegreeOfFreedom::wrist(), DegreeOfFreedom::hand()]);
    assert!(report.drives.iter().all(|s| s.r2 > 0.95 && s.mean_absolute_error < 0.1), "{report:?}");
    let refused = CalibrationConfig { target_r2: 1.5, ..CalibrationConfig::default() }.check();
    assert!(refused.is_err_and(|e| e.to_string().contains("target_r2")));
}

#[test]
fn settings_of_a_classifier_and_a_regressor_do_not_go_together() {
    let lda = EmgConfig { classifier: ClassifierKind::Lda, ..config() };
    let error = EmgPipeline::new(&lda, model(&config()).classifier).map(|_| ()).expect_err("another kind");
    let expected =
        EmgError::ClassifierMismatch { requested: ClassifierKind::Lda, trained: ClassifierKind::Linear };
    assert_eq!(error, expected);
    let rejecting = EmgConfig { rejection_threshold: Some(0.9), ..config() };
    assert!(
        rejecting
            .check()
            .is_err_and(|e| e.to_string().contains("emg.rejection_threshold is set, but linear"))
    );
    assert!(EmgModel::train::<Command>(&config(), &[0.0; 4], &[]).is_err());
}
