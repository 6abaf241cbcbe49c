//! Features against LibEMG 2.0.3: vectors that `make_feature_vectors.py` computed from signals of its own, and as a
//! third opinion LibEMG's MATLAB values with LibEMG's own tolerance.
// The reference is read from files.
#![allow(clippy::disallowed_methods)]

use proact_emg::{EmgConfig, Feature, FeatureSet, FeatureVector, WindowLength, extract_features};
use proact_types::EmgSample;
use std::{collections::BTreeMap, path::PathBuf};

/// Sums in another order, and another Fourier transform; relative to the largest channel of the feature.
const RELATIVE: f64 = 1e-9;
/// Mean absolute value and waveform length: sums in another order.
const HUDGINS_RELATIVE: f64 = 1e-12;
/// LibEMG's own tolerance against MATLAB.
const MATLAB_RELATIVE: f64 = 0.01;

#[derive(serde::Deserialize)]
struct Case {
    name: String,
    rate_hz: f64,
    /// `[channels][samples]`
    channels: Vec<Vec<f64>>,
    /// Per feature, null where LibEMG has no finite value.
    features: BTreeMap<String, Vec<Option<f64>>>,
}

fn windows(names: &str, rows: &[Vec<f64>], rate_hz: f64, window: usize, step: u32) -> Vec<FeatureVector> {
    let config = EmgConfig {
        rate_hz,
        channels: rows[0].len(),
        window: WindowLength::Samples(window as u32),
        increment: WindowLength::Samples(step),
        features: names.parse().expect("known features"),
        stale_timeout_ms: u64::MAX,
        ..EmgConfig::default()
    };
    let sample =
        |(row, counter): (&Vec<f64>, u64)| EmgSample { counter, channels: row.iter().copied().collect() };
    let samples: Vec<EmgSample> = rows.iter().zip(0..).map(sample).collect();
    extract_features(&config, &samples).expect("good samples")
}

#[test]
fn every_feature_is_libemgs_and_zero_where_libemg_has_none() {
    let cases: Vec<Case> =
        serde_json::from_str(include_str!("feature_vectors.json")).expect("the vectors are JSON");
    let mut worst: BTreeMap<&str, f64> = BTreeMap::new();
    let mut undefined = 0;
    for case in &cases {
        let length = case.channels[0].len();
        let rows: Vec<Vec<f64>> = (0..length).map(|k| case.channels.iter().map(|c| c[k]).collect()).collect();
        for (feature, expected) in &case.features {
            let got = &windows(feature, &rows, case.rate_hz, length, 1)[0];
            assert_eq!(got.len(), expected.len(), "{} {feature}", case.name);
            let scale = expected.iter().flatten().fold(f64::MIN_POSITIVE, |max, v| max.max(v.abs()));
            let max_error = worst.entry(feature).or_default();
            for (k, (got, expected)) in got.iter().zip(expected).enumerate() {
                let Some(expected) = expected else {
                    undefined += 1;
                    assert_eq!(*got, 0.0, "{} {feature}, value {k}", case.name);
                    continue;
                };
                let error = (got - expected).abs() / scale;
                let limit = match feature.as_str() {
                    "ZC" | "SSC" | "WAMP" | "MDF" => 0.0,
                    "MAV" | "WL" => HUDGINS_RELATIVE,
                    // The details of a constant channel are rounding alone, and the entropy does not depend on scale.
                    "WENT" => 10.0 * RELATIVE,
                    _ => RELATIVE,
                };
                // Far below the floor under the logarithms of the wavelets there is rounding alone.
                let wavelet = matches!(feature.as_str(), "WENG" | "WV" | "WWL");
                let rounding = wavelet && (got.exp() - expected.exp()).abs() < 1e-11;
                assert!(
                    error <= limit || rounding,
                    "{} {feature}, value {k}: {got}, LibEMG {expected}",
                    case.name
                );
                if !rounding {
                    *max_error = max_error.max(error);
                }
            }
        }
    }
    // Our own COMPC has no counterpart.
    assert_eq!(worst.len() + 1, Feature::all().count(), "a feature is not compared");
    assert!(undefined > 10, "the cases hold signals on which definitions fail");
    println!("largest relative differences: {worst:?}");
}

#[test]
fn groups_are_their_features_side_by_side() {
    let wave = |k: usize, c: usize| ((k * (c + 2)) as f64 * 0.7).sin() * 9.0 + (k * k % 7) as f64;
    let rows: Vec<Vec<f64>> = (0..50).map(|k| vec![wave(k, 0), wave(k, 1)]).collect();
    for group in
        ["HTD", "TDAR", "LS4", "LS9", "TDPSD", "HJORTH", "HJORTHC", "ITD", "TSTD", "DFTR", "COMB", "MSWT"]
    {
        let set: FeatureSet = group.parse().expect("a group");
        let whole = &windows(group, &rows, 1000.0, 50, 1)[0];
        let parts = set.features().iter().flat_map(|f| windows(f.name(), &rows, 1000.0, 50, 1)[0].to_vec());
        assert_eq!(whole.to_vec(), parts.collect::<Vec<_>>(), "{group}");
    }
}

#[test]
fn a_channels_features_do_not_depend_on_its_neighbours() {
    // Seven channels: the last of the second four is filled up. One is large enough to drown what it would leak into.
    let wave = |k: usize, c: usize| {
        ((k * k + k * c) as f64 * 0.7).sin() * if c == 2 { 1e12 } else { 1.0 + c as f64 }
    };
    let rows: Vec<Vec<f64>> = (0..60).map(|k| (0..7).map(|c| wave(k, c)).collect()).collect();
    for feature in Feature::all() {
        // COMP sums over the channels, and pairs have two.
        if matches!(feature, Feature::Comp | Feature::Rmsphasor | Feature::Wlphasor) {
            continue;
        }
        let together = &windows(feature.name(), &rows, 1000.0, 60, 1)[0];
        for channel in 0..7 {
            let one: Vec<Vec<f64>> = rows.iter().map(|row| vec![row[channel]]).collect();
            let alone = &windows(feature.name(), &one, 1000.0, 60, 1)[0];
            let values = alone.len();
            let of_channel: Vec<f64> = match feature {
                Feature::Ar4 | Feature::Cc => together[channel * values..(channel + 1) * values].to_vec(),
                _ => together.iter().skip(channel).step_by(7).copied().collect(),
            };
            assert_eq!(*alone, of_channel, "{}, channel {channel}", feature.name());
        }
    }
}

#[test]
fn corrected_complexity_is_one_for_a_sine_and_does_not_depend_on_other_channels() {
    let sine: Vec<Vec<f64>> = (0..2000).map(|k| vec![(f64::from(k) * 0.2).sin(), f64::from(k % 7)]).collect();
    let both = &windows("COMPC", &sine, 1000.0, 2000, 1)[0];
    assert!((both[0] - 1.0).abs() < 1e-2, "{both:?}");
    let alone: Vec<Vec<f64>> = sine.iter().map(|row| vec![row[0]]).collect();
    assert_eq!(windows("COMPC", &alone, 1000.0, 2000, 1)[0][0], both[0]);
}

#[test]
fn features_of_a_recording_are_those_of_matlab_within_a_hundredth() {
    let beside = || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared");
    let shared = std::env::var_os("PROACT_SHARED").map_or_else(beside, PathBuf::from);
    let dir = shared.join("data/emg/libemg_tests_myo/matlab_features");
    if !dir.is_dir() {
        println!("skipped: ../shared not found");
        return;
    }
    let table = |name: &str| -> Vec<Vec<f64>> {
        let mut reader = csv::ReaderBuilder::new()
            .has_headers(false)
            .from_path(dir.join(name))
            .expect("the table is there");
        reader.deserialize().collect::<Result<_, _>>().expect("the table holds numbers")
    };
    let recording = table("emg_data_myo.csv");
    // VAR and AR are excluded as in LibEMG's own test: MATLAB's definitions differ.
    for name in
        "MAV ZC SSC WL LS MFL MSR WAMP RMS IAV DASDV M0 M2 M4 SPARSI IRF WLF MDF MNF SKEW KURT".split(' ')
    {
        let expected = table(&format!("matlab_{name}.csv"));
        // The tables were made with a nominal rate of 1 kHz.
        let got = windows(name, &recording, 1000.0, 200, 25);
        let mut worst = 0.0_f64;
        assert_eq!(got.len(), expected.len(), "{name}");
        for (k, (got, expected)) in got.iter().zip(&expected).enumerate() {
            for (channel, (a, b)) in got.iter().zip(expected).enumerate() {
                let error = if a == b { 0.0 } else { (2.0 * (a - b) / (a + b)).abs() };
                worst = worst.max(error);
                assert!(error < MATLAB_RELATIVE, "{name}, window {k}, channel {channel}: {a}, MATLAB {b}");
            }
        }
        println!("{name}: {worst:.1e} over {} of {} windows", got.len(), expected.len());
    }
}
