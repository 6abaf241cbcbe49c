//! Side by side with LibEMG 2.0.3 and scikit-learn 1.9.1, whose values lie in `../shared/data/emg/reference` with
//! the script that made them. Tolerances are those of the reference's README.
// The reference is read from files.
#![allow(clippy::disallowed_methods)]

mod data;

use data::shared;
use nalgebra::DMatrix;
use proact_emg::{
    Classifier, CovarianceNormalization, DEFAULT_MAJORITY_VOTE_WINDOWS, DEFAULT_REJECTION_THRESHOLD,
    DecisionRule, EmgConfig, EmgPipeline, FeatureSet, FeatureVector, Lda, MajorityVote, Priors, PublishRule,
    WindowLength, extract_features,
};
use proact_types::{Command, EmgSample, Gesture, SimTime};
use std::{
    fs::File,
    io::{BufReader, Read},
    num::NonZeroU32,
};
use zip::ZipArchive;

/// MAV and WL: sums in another order.
const FEATURE_RELATIVE: f64 = 1e-12;
/// Decision values, relative to the largest of their window.
const DECISION_RELATIVE: f64 = 1e-9;
const PROBABILITY_ABSOLUTE: f64 = 1e-9;

/// A NumPy archive: a zip file with one array a member.
struct Reference(ZipArchive<File>);

impl Reference {
    fn open(name: &str) -> Option<Reference> {
        let file = File::open(shared()?.join("reference").join(name)).expect("the reference is there");
        Some(Reference(ZipArchive::new(file).expect("the reference is a zip file")))
    }

    /// Shape and 8-byte values of an array whose element type NumPy calls `kind`. Layout: NumPy's format 1.0, a
    /// 10-byte prologue that ends with the length of a header, a Python dictionary as text; then the values.
    fn array(&mut self, name: &str, kind: &str) -> (Vec<usize>, Vec<[u8; 8]>) {
        let mut bytes = Vec::new();
        let mut member = self.0.by_name(&format!("{name}.npy")).expect("the reference has this array");
        member.read_to_end(&mut bytes).expect("the member is whole");
        let (prologue, rest) = bytes.split_at(10);
        assert_eq!(&prologue[..8], b"\x93NUMPY\x01\x00", "{name}");
        let (header, data) = rest.split_at(usize::from(u16::from_le_bytes([prologue[8], prologue[9]])));
        let header = std::str::from_utf8(header).expect("the header is text");
        assert!(header.contains(&format!("'descr': '{kind}', 'fortran_order': False")), "{name}: {header}");
        let shape = header.split_once("'shape': (").and_then(|(_, rest)| rest.split_once(')'));
        let shape: Vec<usize> =
            shape.expect("the header has a shape").0.split(',').flat_map(|n| n.trim().parse()).collect();
        let values: Vec<[u8; 8]> =
            data.chunks_exact(8).map(|value| value.try_into().expect("8 bytes each")).collect();
        assert_eq!(values.len(), shape.iter().product::<usize>(), "{name}");
        (shape, values)
    }

    fn doubles(&mut self, name: &str) -> (Vec<usize>, Vec<f64>) {
        let (shape, values) = self.array(name, "<f8");
        (shape, values.into_iter().map(f64::from_le_bytes).collect())
    }

    fn integers(&mut self, name: &str) -> Vec<i64> {
        self.array(name, "<i8").1.into_iter().map(i64::from_le_bytes).collect()
    }

    fn rows(&mut self, name: &str) -> Vec<Vec<f64>> {
        let (shape, values) = self.doubles(name);
        values.chunks_exact(shape[1]).map(<[f64]>::to_vec).collect()
    }
}

fn config(window: u32, increment: u32) -> EmgConfig {
    EmgConfig {
        rate_hz: 200.0,
        window: WindowLength::Samples(window),
        increment: WindowLength::Samples(increment),
        stale_timeout_ms: 1000,
        ..EmgConfig::default()
    }
}

fn samples(rows: &[Vec<f64>]) -> Vec<EmgSample> {
    let sample =
        |(row, counter): (&Vec<f64>, u64)| EmgSample { counter, channels: row.iter().copied().collect() };
    rows.iter().zip(0..).map(sample).collect()
}

/// Windows of the recordings of these repetitions, repetition by repetition, class by class.
fn recorded(reps: &[u32], config: &EmgConfig) -> Option<(Vec<FeatureVector>, Vec<Command>)> {
    let dir = shared()?.join("libemg_tests_myo");
    let (mut windows, mut labels) = (Vec::new(), Vec::new());
    for rep in reps {
        for gesture in Command::ALL {
            let path = dir.join(format!("R_{rep}_C_{}_EMG.csv", gesture.index()));
            let mut reader =
                csv::ReaderBuilder::new().has_headers(false).from_path(path).expect("the recording is there");
            let rows: Vec<Vec<f64>> =
                reader.deserialize().collect::<Result<_, _>>().expect("the recording holds numbers");
            windows.extend(extract_features(config, &samples(&rows)).expect("good samples"));
            labels.resize(windows.len(), gesture);
        }
    }
    Some((windows, labels))
}

fn assert_features(got: &[f64], expected: &[f64], channels: usize, what: &str) {
    assert_eq!(got.len(), expected.len(), "{what}");
    for (k, (a, b)) in got.iter().zip(expected).enumerate() {
        let exact = (channels..3 * channels).contains(&k);
        let close = (a - b).abs() <= FEATURE_RELATIVE * b.abs();
        assert!(if exact { a == b } else { close }, "{what}, feature {k}: {a}, LibEMG {b}");
    }
}

#[test]
fn features_of_whole_recordings_are_those_of_libemg() {
    let Some(mut reference) = Reference::open("libemg_myo_w100_i50.npz") else { return };
    for (reps, name) in [(&[0, 1][..], "X_train"), (&[2][..], "X_test")] {
        let (windows, _) = recorded(reps, &config(100, 50)).expect("found before");
        let expected = reference.rows(name);
        assert_eq!(windows.len(), expected.len());
        for (k, (got, expected)) in windows.iter().zip(&expected).enumerate() {
            assert_features(got, expected, 8, &format!("{name} window {k}"));
        }
    }
}

#[test]
fn features_of_edge_cases_are_those_of_libemg() {
    let Some(dir) = shared() else { return };
    let file = File::open(dir.join("reference/edge_cases_features.json")).expect("the reference is there");
    let cases: serde_json::Map<String, serde_json::Value> =
        serde_json::from_reader(BufReader::new(file)).expect("the reference is JSON");
    assert!(cases.len() >= 9);
    for (name, case) in &cases {
        let list =
            |key: &str| -> Vec<Vec<f64>> { serde_json::from_value(case[key].clone()).unwrap_or_default() };
        let number = |key: &str| case[key].as_u64().expect("a whole number") as u32;
        let rows = list("samples");
        let config = EmgConfig { channels: rows[0].len(), ..config(number("window"), number("increment")) };
        let windows = extract_features(&config, &samples(&rows)).expect("good samples");
        // LibEMG makes one short window of a recording that lacks less than an increment. That is a defect: such
        // a window cannot be compared with the others, so we make none.
        let short = case["window_len"].as_u64().is_some_and(|length| length < u64::from(number("window")));
        let expected = if short { Vec::new() } else { list("features") };
        assert_eq!(windows.len(), expected.len(), "{name}");
        for (got, expected) in windows.iter().zip(&expected) {
            assert_features(got, expected, config.channels, name);
        }
    }
}

/// Trains on the reference's own features and compares decision values, probabilities and classes.
fn compare_lda(file: &str) {
    let Some(mut reference) = Reference::open(file) else { return };
    let train = reference.rows("X_train");
    let labels: Vec<usize> = reference.integers("y_train").iter().map(|y| *y as usize).collect();
    let test = reference.rows("X_test");
    let classes = reference.integers("classes").len();
    let predicted = reference.integers("pred_index");
    let matrix = DMatrix::from_fn(train.len(), train[0].len(), |i, j| train[i][j]);
    for (normalization, suffix) in
        [(CovarianceNormalization::Windows, "n"), (CovarianceNormalization::WindowsLessClasses, "n_minus_c")]
    {
        let lda = Lda::fit(&matrix, &labels, classes, normalization).expect("good data");
        let decisions = reference.rows(&format!("decision_{suffix}"));
        let probabilities = reference.rows(&format!("proba_{suffix}"));
        for (k, x) in test.iter().enumerate() {
            let mut values = vec![0.0; classes];
            lda.decide(x, &mut values);
            let scale = decisions[k].iter().fold(0.0_f64, |max, v| max.max(v.abs()));
            for (got, expected) in values.iter().zip(&decisions[k]) {
                assert!(
                    (got - expected).abs() <= DECISION_RELATIVE * scale,
                    "{file} {suffix} window {k}: {got}, scikit-learn {expected}"
                );
            }
            let best = (0..classes).max_by(|a, b| values[*a].total_cmp(&values[*b])).expect("classes");
            assert_eq!(best as i64, predicted[k], "{file} {suffix} window {k}");
            let largest = values[best];
            let sum: f64 = values.iter().map(|v| (v - largest).exp()).sum();
            for (value, expected) in values.iter().zip(&probabilities[k]) {
                let got = (value - largest).exp() / sum;
                assert!((got - expected).abs() <= PROBABILITY_ABSOLUTE, "{file} {suffix} window {k}");
            }
        }
    }
}

#[test]
fn discriminant_is_that_of_scikit_learn_with_both_normalisations() {
    compare_lda("libemg_myo_w100_i50.npz");
}

#[test]
fn discriminant_survives_constant_and_duplicated_features_as_scikit_learn_does() {
    compare_lda("edge_lda_rank_deficient.npz");
}

#[test]
fn classifier_gives_libemgs_classes_probabilities_and_velocities() {
    let Some(mut reference) = Reference::open("libemg_myo_w100_i50.npz") else { return };
    let config = config(100, 50);
    let (train, labels) = recorded(&[0, 1], &config).expect("found before");
    let (test, _) = recorded(&[2], &config).expect("found before");
    let classifier = Classifier::train(&config, &train, &labels).expect("good data");
    let (predicted, probabilities) = (reference.integers("pred_label"), reference.rows("proba_n"));
    let (_, velocities) = reference.doubles("velocity");
    for (k, window) in test.iter().enumerate() {
        let prediction = classifier.predict(window).expect("good window");
        assert_eq!(prediction.class_index as i64, predicted[k], "window {k}");
        for (got, expected) in prediction.posterior.iter().zip(&probabilities[k]) {
            assert!((got - expected).abs() <= PROBABILITY_ABSOLUTE, "window {k}");
        }
        // LibEMG rounds to two decimals.
        let effort = classifier.effort(prediction.class, window).expect("trained");
        assert!(
            (effort - velocities[k]).abs() <= 0.005 + 1e-9,
            "window {k}: {effort}, LibEMG {}",
            velocities[k]
        );
    }
}

#[test]
fn accuracies_are_those_of_libemg_to_the_last_window() {
    // From reference_meta.json: windows of 20 samples, increment 10; repetition 3 was taken with the band turned.
    for (train, test, windows, correct) in [(&[0, 1][..], 2, 295, 293), (&[0, 1, 2][..], 3, 294, 62)] {
        let config = config(20, 10);
        let Some((features, labels)) = recorded(train, &config) else { return };
        let classifier = Classifier::train(&config, &features, &labels).expect("good data");
        let (features, labels) = recorded(&[test], &config).expect("found before");
        let class = |window: &FeatureVector| classifier.predict(window).expect("good window").class;
        let right = features.iter().zip(&labels).filter(|(w, g)| class(w) == **g).count();
        assert_eq!((features.len(), right), (windows, correct), "trained on {train:?}, tested on {test}");
    }
}

#[test]
fn three_equal_classes_act_as_in_the_original_program_and_as_in_the_paper() {
    // -2 in the strict array means that nothing was decided yet.
    const NOTHING: i64 = -2;
    for file in ["libemg_myo_w100_i50.npz", "edge_lda_rank_deficient.npz"] {
        let Some(mut reference) = Reference::open(file) else { return };
        let predicted = reference.integers("pred_label");
        let (hold, strict) = (reference.integers("streak3"), reference.integers("streak3_strict"));
        let run = |config: &EmgConfig| {
            let mut rule = DecisionRule::new(config);
            let mut last_published = NOTHING;
            let step = |(class, k): (&i64, u64)| {
                let output = Command::ALL[*class as usize].into();
                let decision = rule.step(SimTime(k * 50), Some(output)).expect("a decision");
                if decision.published {
                    last_published =
                        decision.gesture.same_named_command().map_or(NOTHING, |g| g.index() as i64);
                }
                last_published
            };
            predicted.iter().zip(0..).map(step).collect::<Vec<_>>()
        };
        let original = EmgConfig { act_on_first_window: true, ..EmgConfig::default() };
        assert_eq!(run(&original), hold, "{file}");
        let paper = EmgConfig { publish_rule: PublishRule::Strict, ..EmgConfig::default() };
        assert_eq!(run(&paper), strict, "{file}");
    }
}

#[test]
fn rejection_and_majority_vote_are_libemgs() {
    for file in ["libemg_myo_w100_i50.npz", "edge_lda_rank_deficient.npz"] {
        let Some(mut reference) = Reference::open(file) else { return };
        let (confidences, predicted) = (reference.doubles("confidence").1, reference.integers("pred_label"));
        let (rejected, majority) =
            (reference.integers("rejected_090"), reference.integers("majority5_online"));
        assert_eq!(majority, reference.integers("majority5_offline"));
        let mut vote = MajorityVote::new(NonZeroU32::new(DEFAULT_MAJORITY_VOTE_WINDOWS).expect("five"));
        let index = |class: Option<Gesture>| {
            class.and_then(Gesture::same_named_command).map_or(-1, |g| g.index() as i64)
        };
        let mut refusals = 0;
        for k in 0..predicted.len() {
            let predicted = Gesture::from(Command::ALL[predicted[k] as usize]);
            let kept = (confidences[k] > DEFAULT_REJECTION_THRESHOLD).then_some(predicted);
            refusals += usize::from(kept.is_none());
            assert_eq!(index(kept), rejected[k], "{file} window {k}");
            // The reference's vote runs over the classes before rejection.
            assert_eq!(index(vote.push(Some(predicted))), majority[k], "{file} window {k}");
        }
        println!("{file}: {refusals} rejected");
    }
}

#[test]
fn the_pipeline_rejects_at_the_threshold_of_libemg() {
    let Some(mut reference) = Reference::open("libemg_myo_w100_i50.npz") else { return };
    let config = EmgConfig { rejection_threshold: Some(DEFAULT_REJECTION_THRESHOLD), ..config(100, 50) };
    let (train, labels) = recorded(&[0, 1], &config).expect("found before");
    let classifier = Classifier::train(&config, &train, &labels).expect("good data");
    let raw = reference.doubles("X_test").0[0];
    let rejected = reference.integers("rejected_090");
    let dir = shared().expect("found before").join("libemg_tests_myo");
    let mut classes = Vec::new();
    for gesture in Command::ALL {
        let mut pipeline = EmgPipeline::new(&config, classifier.clone()).expect("they fit");
        let text = std::fs::read_to_string(dir.join(format!("R_2_C_{}_EMG.csv", gesture.index())));
        let text = text.expect("the recording is there");
        let rows: Vec<Vec<f64>> =
            text.lines().map(|l| l.split(',').map(|v| v.parse().expect("a number")).collect()).collect();
        for sample in samples(&rows) {
            let output = pipeline.step(SimTime(sample.counter * 5), &[sample]);
            classes.extend(output.map(|o| {
                assert!(o.class.is_some() || o.effort == 0.0);
                o.class.and_then(Gesture::same_named_command).map_or(-1, |g| g.index() as i64)
            }));
        }
    }
    assert_eq!(classes.len(), raw);
    assert_eq!(classes, rejected);
}

#[test]
fn equal_priors_move_decisions_by_the_logarithm_of_the_priors_alone() {
    let config = config(20, 10);
    let Some((mut windows, mut labels)) = recorded(&[0, 1], &config) else { return };
    // Unequal recordings, so that the priors differ.
    windows.truncate(250);
    labels.truncate(250);
    let train = |priors| {
        Classifier::train(&EmgConfig { priors, ..config.clone() }, &windows, &labels).expect("good data")
    };
    let (counted, equal) = (train(Priors::Counts), train(Priors::Equal));
    let count = |k: usize| labels.iter().filter(|g| g.index() == k).count() as f64;
    for window in &windows {
        let (mut a, mut b) = ([0.0; 5], [0.0; 5]);
        counted.lda().expect("LDA").decide(window, &mut a);
        equal.lda().expect("LDA").decide(window, &mut b);
        for k in 1..5 {
            let moved = (a[k] - a[0]) - (b[k] - b[0]);
            assert!((moved - (count(k) / count(0)).ln()).abs() < 1e-9, "class {k}: {moved}");
        }
    }
}

#[test]
fn the_feature_group_has_as_many_features_as_it_says() {
    let config = EmgConfig { channels: 3, ..config(10, 5) };
    let rows = vec![vec![1.0, -2.0, 3.0]; 10];
    let windows = extract_features(&config, &samples(&rows)).expect("good samples");
    assert_eq!(windows[0].len(), FeatureSet::HTD.layout(3, 1000.0).count());
}
