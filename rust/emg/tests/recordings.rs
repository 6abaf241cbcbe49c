//! Models, band check, quality and adaptation on real recordings.
// The recordings are read from files.
#![allow(clippy::disallowed_methods)]

mod data;

use data::shared;
use proact_emg::{
    Adaptation, AdaptationConfig, BandProposal, ChannelStatus, EmgConfig, EmgModel, FeatureVector,
    QualityConfig, QualityMonitor, StreamFormat, WindowLength, check_rotation, cross_validate,
    extract_features,
};
use proact_types::{Command, EmgSample, SimTime};

fn config() -> EmgConfig {
    EmgConfig {
        rate_hz: 200.0,
        window: WindowLength::Samples(20),
        increment: WindowLength::Samples(10),
        ..EmgConfig::default()
    }
}

type Recordings = Vec<(Command, Vec<EmgSample>)>;

/// The five gestures of a repetition, the channels rolled by `roll`.
fn repetition(rep: u32, roll: usize) -> Option<Recordings> {
    let dir = shared()?.join("libemg_tests_myo");
    let read = |gesture: Command| {
        let path = dir.join(format!("R_{rep}_C_{}_EMG.csv", gesture.index()));
        let mut reader = csv::ReaderBuilder::new().has_headers(false).from_path(path).expect("it is there");
        let rows = reader.deserialize().collect::<Result<Vec<Vec<f64>>, _>>().expect("it holds numbers");
        let sample = |(mut row, counter): (Vec<f64>, u64)| {
            row.rotate_right(roll);
            EmgSample { counter, channels: row.into_iter().collect() }
        };
        (gesture, rows.into_iter().zip(0..).map(sample).collect())
    };
    Some(Command::ALL.into_iter().map(read).collect())
}

fn model(reps: &[u32]) -> Option<EmgModel> {
    let recordings: Vec<Recordings> = reps.iter().map(|rep| repetition(*rep, 0)).collect::<Option<_>>()?;
    let slices: Vec<_> = recordings.iter().flatten().map(|(g, s)| (*g, s.as_slice())).collect();
    Some(EmgModel::train(&config(), &[0.0; 8], &slices).expect("good recordings"))
}

fn windows(recordings: &Recordings, gestures: &[Command]) -> Vec<(Command, FeatureVector)> {
    let chosen = recordings.iter().filter(|(g, _)| gestures.contains(g));
    chosen
        .flat_map(|(g, samples)| {
            extract_features(&config(), samples).expect("good samples").into_iter().map(move |w| (*g, w))
        })
        .collect()
}

fn accuracy(model: &EmgModel, windows: &[(Command, FeatureVector)]) -> f64 {
    let right =
        |(g, w): &&(Command, FeatureVector)| model.classifier.predict(w).expect("good window").class == *g;
    windows.iter().filter(right).count() as f64 / windows.len() as f64
}

#[test]
fn a_band_that_was_turned_is_found_from_two_gestures_whatever_the_turn() {
    let Some(model) = model(&[0, 1]) else { return };
    let two = [Command::WristExtension, Command::WristFlexion];
    for shift in 0..8 {
        let turned = repetition(2, shift).expect("found before");
        let report = check_rotation(&model, &windows(&turned, &two)).expect("good windows");
        let expected = if shift == 0 { BandProposal::Keep } else { BandProposal::Roll(shift) };
        assert_eq!(report.proposal, expected, "{report:?}");
        println!("turn {shift}: margin {:.2}, best {:?}", report.margin, report.ranked[0]);
    }
}

#[test]
fn the_repetition_taken_with_a_turned_band_becomes_usable_by_the_proposal() {
    let Some(model) = model(&[0, 1, 2]) else { return };
    let turned = repetition(3, 0).expect("found before");
    let all = windows(&turned, &Command::ALL);
    let two = windows(&turned, &[Command::HandOpen, Command::WristFlexion]);
    let report = check_rotation(&model, &two).expect("good windows");
    let best = report.ranked[0].shift;
    let rolled: Vec<_> = all
        .iter()
        .map(|(g, w)| {
            let mut out = w.clone();
            model.config.layout().roll(w, best, &mut out);
            (*g, out)
        })
        .collect();
    let (before, after) = (accuracy(&model, &all), accuracy(&model, &rolled));
    println!("{report:?}\naccuracy {before:.3}, rolled by {best}: {after:.3}");
    assert!(before < 0.25 && after > 0.6, "{before} {after} {report:?}");
}

#[test]
fn a_rolled_model_recognises_a_turned_band_as_the_model_did_the_band() {
    let Some(model) = model(&[0, 1]) else { return };
    let straight = accuracy(&model, &windows(&repetition(2, 0).expect("found before"), &Command::ALL));
    for shift in 0..8 {
        let turned = windows(&repetition(2, shift).expect("found before"), &Command::ALL);
        let rolled = model.with_channel_shift(shift).expect("a sound model");
        assert_eq!(accuracy(&rolled, &turned), straight, "turned by {shift}");
        assert!(shift == 0 || accuracy(&model, &turned) < straight);
        // Back again it is the model that it was.
        assert_eq!(rolled.with_channel_shift(8 - shift).expect("a sound model"), model);
    }
}

#[test]
fn a_repetition_taken_with_a_turned_band_is_an_outlier_and_the_others_are_not() {
    let take = |reps: &[u32]| -> Option<Recordings> {
        Some(
            reps.iter()
                .map(|r| repetition(*r, 0))
                .collect::<Option<Vec<_>>>()?
                .into_iter()
                .flatten()
                .collect(),
        )
    };
    let Some(good) = take(&[0, 1, 2]) else { return };
    let report = cross_validate(&config(), &good).expect("good recordings");
    let distances = |r: &proact_emg::CalibrationReport| {
        r.repetitions
            .iter()
            .map(|r| format!("{} {}: {:.2} {:.2}", r.gesture, r.repetition, r.distance, r.recognized_share))
            .collect::<Vec<_>>()
    };
    println!("accuracy {:.4} {:#?}", report.accuracy, distances(&report));
    assert!(report.accuracy > 0.95 && report.outliers().count() == 0, "{:#?}", distances(&report));
    let report = cross_validate(&config(), &take(&[0, 1, 2, 3]).expect("found before")).expect("good");
    println!("with the turned band {:.4} {:#?}", report.accuracy, distances(&report));
    let turned: Vec<_> = report.outliers().filter(|r| r.repetition == 3).map(|r| r.gesture).collect();
    assert!(turned.len() >= 3 && report.accuracy < 0.9, "{turned:?} {:#?}", distances(&report));
    assert!(report.outliers().all(|r| r.repetition == 3), "{:#?}", distances(&report));
}

#[test]
fn a_model_survives_its_file_and_refuses_other_streams_with_reasons() {
    let Some(model) = model(&[0, 1]) else { return };
    let json = model.to_json().expect("a sound model");
    let read = EmgModel::from_json(&json).expect("its own file");
    assert_eq!(read, model);
    let medians: Vec<f64> = model.channels.iter().map(|c| c.rest_median).collect();
    let stream =
        StreamFormat { rate_hz: 199.0, channels: 8, rest_medians: Some(medians.clone()), imu: Vec::new() };
    assert_eq!(read.check_stream_format(&stream), Ok(()));
    let refused = |change: fn(&mut StreamFormat)| {
        let mut stream = stream.clone();
        change(&mut stream);
        read.check_stream_format(&stream).expect_err("must be refused").to_string()
    };
    assert!(refused(|s| s.rate_hz = 1000.0).contains("trained at 200 Hz, the stream has 1000 Hz"));
    assert!(refused(|s| s.rate_hz = f64::NAN).contains("NaN Hz"));
    assert!(refused(|s| s.channels = 4).contains("8 channels, the stream 4"));
    let raw = refused(|s| s.rest_medians = Some(vec![128.0; 8]));
    assert!(raw.contains("channel 0 rests at 128") && raw.contains("channel 7"), "{raw}");

    let broken = |from: &str, to: &str| {
        assert!(json.contains(from), "{from}");
        EmgModel::from_json(&json.replacen(from, to, 1)).expect_err("must be refused").to_string()
    };
    assert!(broken("\"format\": 1", "\"format\": 2").contains("format 2, this version reads format 1"));
    assert!(broken("\"HTD\"", "\"LS4,ZC\"").contains("does not fit"));
    assert!(broken("\"channels\": 8", "\"channels\": 7").contains("does not fit"));
    assert!(broken("\"intercepts\": [", "\"intercepts\": [ 1.0,").contains("does not fit"));
    // A file of before the keys of its settings were renamed.
    let old = json.replacen("\"consecutive_decisions\"", "\"required\"", 1);
    let old = old.replacen("\"gap_interpolation\"", "\"bridge\"", 1).replacen(
        "\"max_gap_ms\"",
        "\"longest_ms\"",
        1,
    );
    assert_eq!(EmgModel::from_json(&old), Ok(read));
    let both = json.replacen("\"consecutive_decisions\"", "\"required\": 3, \"consecutive_decisions\"", 1);
    let error = EmgModel::from_json(&both).expect_err("both names").to_string();
    assert!(error.contains("emg.required is the old name of emg.consecutive_decisions"), "{error}");
    assert!(EmgModel::from_json(&json[..json.len() / 2]).is_err());
    assert!(EmgModel::from_json("").is_err());
}

#[test]
fn raw_codes_with_zero_levels_give_the_model_of_the_centred_stream() {
    let Some(recordings) = repetition(0, 0) else { return };
    let raw: Recordings = recordings
        .iter()
        .map(|(g, samples)| {
            let mut samples = samples.clone();
            samples.iter_mut().for_each(|s| s.channels.iter_mut().for_each(|v| *v += 128.0));
            (*g, samples)
        })
        .collect();
    let train = |recordings: &Recordings, zero: f64| {
        let slices: Vec<_> = recordings.iter().map(|(g, s)| (*g, s.as_slice())).collect();
        EmgModel::train(&config(), &[zero; 8], &slices).expect("good recordings")
    };
    let (centered, model) = (train(&recordings, 0.0), train(&raw, 128.0));
    assert_eq!(model.classifier, centered.classifier);
    assert_eq!(model.subtract_dc_offset(&raw[0].1[7]), recordings[0].1[7]);
    assert!(EmgModel::train::<Command>(&config(), &[0.0; 3], &[]).is_err());
    assert!(EmgModel::train::<Command>(&config(), &[0.0; 8], &[]).is_err());
}

#[test]
fn a_good_recording_shows_no_red_light() {
    let Some(model) = model(&[0, 1, 2]) else { return };
    let config = QualityConfig { rails: Some([-128.0, 127.0]), ..QualityConfig::default() };
    for (gesture, samples) in repetition(2, 0).expect("found before") {
        let mut monitor = QualityMonitor::new(config.clone(), 200.0, 8, &model.channels);
        for sample in &samples {
            monitor.push(SimTime(sample.counter * 5), sample);
            assert_ne!(monitor.status(), ChannelStatus::Red, "{gesture:?} {:?}", monitor.channels());
        }
    }
}

#[test]
fn adaptation_follows_a_changed_signal_freezes_and_rolls_back() {
    let Some(model) = model(&[0, 1]) else { return };
    // The armband sits looser: everything is weaker by a third.
    let weaker = repetition(2, 0).expect("found before").into_iter().map(|(g, mut samples)| {
        samples.iter_mut().for_each(|s| s.channels.iter_mut().for_each(|v| *v *= 0.67));
        (g, samples)
    });
    let windows = windows(&weaker.collect(), &Command::ALL);
    let mut adaptation = Adaptation::new(AdaptationConfig::default(), &model).expect("good settings");
    assert_eq!((adaptation.classifier(), adaptation.drift()), (&model.classifier, 0.0));
    let mut used = 0;
    for (gesture, window) in &windows {
        used += u64::from(adaptation.confirm(*gesture, window).expect("a good window"));
    }
    assert_eq!(adaptation.used(), used);
    assert!(used > 100 && adaptation.drift() > 0.05, "{used} windows, drift {}", adaptation.drift());
    let adapted = EmgModel { classifier: adaptation.classifier().clone(), ..model.clone() };
    let (before, after) = (accuracy(&model, &windows), accuracy(&adapted, &windows));
    println!("accuracy {before:.3}, adapted {after:.3}, drift {:.2}", adaptation.drift());
    assert!(after >= before, "{before} {after}");

    adaptation.freeze(true);
    assert_eq!(adaptation.confirm(windows[0].0, &windows[0].1), Ok(false));
    adaptation.roll_back();
    assert_eq!((adaptation.classifier(), adaptation.drift()), (&model.classifier, 0.0));
}

#[test]
fn no_pair_of_gestures_proposes_a_wrong_turn_and_rest_is_no_evidence() {
    let Some(model) = model(&[0, 1]) else { return };
    let (straight, turned) = (repetition(2, 0).expect("found"), repetition(3, 0).expect("found"));
    let moving: Vec<Command> = Command::ALL.into_iter().filter(|g| *g != Command::NoMotion).collect();
    let check =
        |recordings: &Recordings, pair: &[Command]| check_rotation(&model, &windows(recordings, pair));
    let mut found = 0;
    for (k, a) in moving.iter().enumerate() {
        for b in &moving[k + 1..] {
            assert_eq!(check(&straight, &[*a, *b]).expect("good windows").proposal, BandProposal::Keep);
            // Rolling by 3 gives the largest accuracy over all five gestures.
            let proposal = check(&turned, &[*a, *b]).expect("good windows").proposal;
            assert!(matches!(proposal, BandProposal::Roll(3) | BandProposal::Recalibrate), "{a:?} {b:?}");
            found += u32::from(proposal == BandProposal::Roll(3));
        }
        let error = check(&straight, &[*a, Command::NoMotion]).expect_err("one moving gesture").to_string();
        assert!(error.contains("got 1 gesture besides no motion"), "{error}");
    }
    assert!(found >= 4, "{found} of 6 pairs find the turn");
}

/// A band check that knew turns alone took two swapped electrodes for a turned band.
#[test]
fn two_electrodes_that_changed_places_are_named_and_never_taken_for_a_turn() {
    let Some(model) = model(&[0, 1]) else { return };
    let two = [Command::WristExtension, Command::WristFlexion];
    let straight = repetition(2, 0).expect("found before");
    for (a, b) in (0..8).flat_map(|a| (a + 1..8).map(move |b| (a, b))) {
        let mut swapped = straight.clone();
        for sample in swapped.iter_mut().flat_map(|(_, samples)| samples) {
            sample.channels.swap(a, b);
        }
        let report = check_rotation(&model, &windows(&swapped, &two)).expect("good windows");
        assert_eq!(report.proposal, BandProposal::Swap([a, b]), "{report:?}");
    }
}
