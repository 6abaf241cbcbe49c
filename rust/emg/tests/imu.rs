//! A classifier that knows the position of the limb by an inertial measurement unit, and what happens when the unit fails.
//!
//! The person is synthetic. Four muscles, one below each electrode, give noise whose amplitude is that of the gesture. The effect
//! of the limb's position is the one that Fougner et al. (2011) describe, muscle lengths and gravity change how strongly each
//! electrode hears its muscle: electrode c is multiplied by `exp(GAIN * s_c * p)`, with p from -1 (arm hanging) to 1 (overhead)
//! and a sign s_c of its own. Gravity in the frame of the accelerometer turns with p.

use proact_emg::{
    Calibration, CalibrationConfig, CalibrationEvent, CalibrationPhase, EmgConfig, EmgError, EmgModel,
    EmgOutput, EmgPipeline, ImuChannel, ImuConfig, RepetitionRejection, SignalFault, StreamFormat,
    cross_validate,
};
use proact_types::{Command, EmgSample, Gesture, SimTime, StopCause};

const GAIN: f64 = 0.6;
const SIGNS: [f64; 4] = [1.0, -1.0, 1.0, -1.0];
const POSITIONS: [f64; 3] = [-1.0, 0.0, 1.0];
/// Samples of a repetition: 3 s at 200 Hz.
const REPETITION: u64 = 600;
/// A claim needs more than chance: a hundred windows of 885 are eleven points.
const CLEARLY_BETTER: f64 = 0.1;

/// Noise, uniform in -1 to 1, of its own for each stream and sample.
fn noise(seed: u64, k: u64) -> f64 {
    let mut z = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(k.wrapping_mul(0xd1b5_4a32_d192_ed03));
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    2.0 * ((z ^ (z >> 31)) as f64 / u64::MAX as f64 - 0.5)
}

fn config(words: &[&str]) -> EmgConfig {
    let channels = ["acceleration_x", "acceleration_z"].map(|name| ImuChannel::new(name, "g"));
    let imu = ImuConfig::record_only(channels.into()).with_features(words).expect("known");
    EmgConfig {
        channels: 4,
        rate_hz: 200.0,
        features: "MAV,WL".parse().expect("known"),
        imu,
        ..EmgConfig::default()
    }
}

/// Sample `k` of a person who makes `gesture` with the limb at `position`; the accelerometer gives 50 values a second.
fn sample(k: u64, gesture: Command, position: f64) -> EmgSample {
    let strengths: [f64; 4] = match gesture {
        Command::NoMotion => [2.0; 4],
        Command::HandClose => [20.0, 12.0, 20.0, 12.0],
        Command::HandOpen => [12.0, 20.0, 12.0, 20.0],
        Command::WristExtension => [15.0, 15.0, 28.0, 8.0],
        Command::WristFlexion => [15.0, 15.0, 8.0, 28.0],
    };
    let electrode = |c: usize| {
        let gain = (GAIN * SIGNS[c] * position).exp();
        gain * strengths[c] * noise(c as u64, k)
    };
    let angle = position * std::f64::consts::FRAC_PI_2;
    let tremor = |axis: u64| 0.03 * noise(100 + axis, k / 4);
    let imu = [angle.sin() + tremor(0), angle.cos() + tremor(1)];
    EmgSample { counter: k, channels: (0..4).map(electrode).chain(imu).collect() }
}

/// Each gesture twice in each position.
fn recordings() -> Vec<(Command, Vec<EmgSample>)> {
    let positions = POSITIONS.into_iter().cycle().take(2 * POSITIONS.len()).enumerate();
    let take = |round: usize, position: f64, gesture: Command| {
        let from = 100_000 * (5 * round + gesture.index()) as u64;
        (gesture, (from..from + REPETITION).map(|k| sample(k, gesture, position)).collect())
    };
    positions.flat_map(|(round, p)| Command::ALL.map(|gesture| take(round, p, gesture))).collect()
}

fn model(config: &EmgConfig) -> EmgModel {
    let recordings = recordings();
    let slices: Vec<_> = recordings.iter().map(|(gesture, samples)| (*gesture, samples.as_slice())).collect();
    EmgModel::train(config, &[0.0; 4], &slices).expect("good recordings")
}

#[test]
fn a_classifier_that_knows_the_position_of_the_limb_beats_one_that_does_not() {
    let accuracy = |words: &[&str]| cross_validate(&config(words), &recordings()).expect("judged").accuracy;
    let (with, without) = (accuracy(&["acceleration"]), accuracy(&[]));
    println!("recognised: {:.1} % with the accelerometer, {:.1} % without", 100.0 * with, 100.0 * without);
    assert!(with > without + CLEARLY_BETTER, "{with} with, {without} without");
    // In one position there is nothing to gain: the unit is no other way to tell gestures.
    let still: Vec<_> =
        recordings().into_iter().enumerate().filter(|(k, _)| (k / 5) % 3 == 1).map(|(_, r)| r).collect();
    let at_rest = |words: &[&str]| cross_validate(&config(words), &still).expect("judged").accuracy;
    assert!((at_rest(&["acceleration"]) - at_rest(&[])).abs() < 0.05);
}

#[test]
fn the_model_keeps_what_it_takes_and_refuses_a_stream_without() {
    let model = model(&config(&["acceleration"]));
    let read = EmgModel::from_json(&model.to_json().expect("whole")).expect("as written");
    assert_eq!(read, model);
    let imu = model.config.imu.channels.clone();
    let stream = |imu| StreamFormat { rate_hz: 200.0, channels: 4, rest_medians: None, imu };
    read.check_stream_format(&stream(imu.clone())).expect("the same stream");
    let error = read.check_stream_format(&stream(Vec::new())).expect_err("no unit").to_string();
    assert!(error.contains("acceleration_z (g), this one has no inertial measurement unit"), "{error}");
    let error = read.check_settings(&config(&[])).expect_err("trained with it").to_string();
    assert!(error.contains("emg.imu"), "{error}");
    assert!(matches!(read.with_channel_shift(1), Err(EmgError::Imu { .. })), "it has turned with the band");
    // A classifier of one stream on the settings of another.
    assert!(EmgPipeline::new(&config(&[]), model.classifier.clone()).is_err());
    let recorded = config(&[]);
    EmgPipeline::new(&recorded, self::model(&recorded).classifier).expect("recorded only");
}

/// What an inertial measurement unit says in a sample.
type Unit = fn(u64) -> [f64; 2];
/// What was said at each decision, and why the stream was stale, with their ticks.
type Ran = (Vec<(u64, EmgOutput)>, Vec<(u64, SignalFault)>);

/// Runs 5 s of a closed hand; `unit` changes the values of the inertial measurement unit from 2 s to 4 s. What is said at
/// each decision, and why the stream was stale.
fn run(words: &[&str], unit: Unit) -> Ran {
    let config = config(words);
    let model = model(&config);
    let config = EmgConfig { liveness: model.liveness(None), ..config };
    let mut pipeline = EmgPipeline::new(&config, model.classifier).expect("they fit");
    let (mut outputs, mut faults) = (Vec::new(), Vec::new());
    for tick in 0..5000 {
        // A relaxed hand first, which arms.
        let gesture = if tick < 600 { Command::NoMotion } else { Command::HandClose };
        let arrived = (tick % 5 == 0).then(|| {
            let mut sample = sample(tick / 5 + 900_000, gesture, 1.0);
            if (2000..4000).contains(&tick) {
                sample.channels.truncate(4);
                sample.channels.extend(unit(tick / 5));
            }
            sample
        });
        outputs.extend(pipeline.step(SimTime(tick), arrived.as_slice()).map(|output| (tick, output)));
        faults.extend(pipeline.fault().map(|fault| (tick, fault)));
    }
    (outputs, faults)
}

#[test]
fn a_unit_that_freezes_or_falls_silent_stops_the_arm_and_a_relaxed_hand_is_waited_for() {
    let cases: [(Unit, SignalFault, StopCause, u64); 2] = [
        (|_| [0.99, 0.01], SignalFault::ImuFrozen(1), StopCause::Frozen, 3000),
        (|_| [f64::NAN, 0.01], SignalFault::ImuSilent(1), StopCause::Silent, 2040),
    ];
    for (unit, fault, cause, after) in cases {
        let (outputs, faults) = run(&["acceleration"], unit);
        let moving = |tick: u64| outputs.iter().any(|(t, o)| *t == tick && o.gesture == Command::HandClose);
        assert!((1000..2000).any(moving), "{fault}: it works before");
        let (at, first) =
            faults.iter().find(|(_, f)| *f == fault).copied().unwrap_or_else(|| panic!("no {fault}"));
        assert_eq!(first.cause(), cause);
        assert!((after..after + 20).contains(&at), "{fault} at {at} ms");
        // From then on nothing moves: after the fault the hand stays closed, which is no relaxed hand.
        assert!(!(at..5000).any(moving), "{fault}");
        assert!(outputs.iter().any(|(t, o)| (at..at + 60).contains(t) && o.stale), "{fault}");
    }
}

#[test]
fn a_unit_that_is_recorded_only_may_fail() {
    let (outputs, faults) = run(&[], |_| [f64::NAN; 2]);
    assert_eq!(faults, []);
    let closed = outputs.iter().filter(|(t, o)| *t > 1000 && o.gesture == Command::HandClose).count();
    assert!(closed > 70, "{closed} of 80");
}

#[test]
fn nothing_is_learnt_from_a_dead_sensor() {
    let mut recordings = recordings();
    recordings[7].1.iter_mut().for_each(|sample| sample.channels[4..].copy_from_slice(&[0.0, 1.0]));
    let slices: Vec<_> = recordings.iter().map(|(gesture, samples)| (*gesture, samples.as_slice())).collect();
    let error =
        EmgModel::train(&config(&["acceleration"]), &[0.0; 4], &slices).expect_err("frozen").to_string();
    assert!(error.contains("acceleration_x does not change in a recording of"), "{error}");
    EmgModel::train(&config(&[]), &[0.0; 4], &slices).expect("it is not needed");
}

fn calibration(emg: EmgConfig) -> CalibrationConfig {
    let gestures = [Command::NoMotion, Command::HandClose].map(Gesture::from).into();
    let positions = ["hanging", "forward", "overhead"].map(str::to_owned).into();
    CalibrationConfig { emg, gestures, positions, target_accuracy: 0.5, ..CalibrationConfig::default() }
}

#[test]
fn a_calibration_asks_for_each_position_in_turn_and_tells_what_the_unit_is_worth() {
    let mut calibration = Calibration::new(calibration(config(&["acceleration"]))).expect("it can be");
    let (mut k, mut prompts) = (0, Vec::new());
    loop {
        let gesture = match calibration.phase() {
            CalibrationPhase::Reviewing if calibration.rounds() == 6 => break,
            CalibrationPhase::Reviewing => {
                let report = calibration.report();
                assert!(report.is_none_or(|report| !report.good_enough), "each position twice is needed");
                assert!(calibration.start_next_round());
                continue;
            }
            CalibrationPhase::Preparing { prompt, .. } | CalibrationPhase::Recording { prompt, .. } => {
                prompt.gesture
            }
            phase => panic!("{phase:?}"),
        };
        let position = calibration.position().expect("one is asked for").to_owned();
        let position_index =
            calibration.config().positions.iter().position(|p| *p == position).expect("one of them");
        let made = gesture.same_named_command().expect("one of the five");
        let events =
            calibration.step(SimTime(5 * k), &[sample(k, made, POSITIONS[position_index])]).expect("judged");
        prompts.extend(
            events.iter().any(|e| matches!(e, CalibrationEvent::RepetitionAccepted(_))).then_some(position),
        );
        k += 1;
    }
    let twice = |name: &'static str| [name, name];
    let round = ["hanging", "forward", "overhead"].map(twice).concat();
    assert_eq!(prompts, [round.clone(), round].concat());
    let report = calibration.report().expect("judged");
    assert!(report.good_enough);
    assert!(report.accuracy_without_imu.is_some_and(|without| without <= report.accuracy), "{report:?}");
}

#[test]
fn a_repetition_with_a_frozen_unit_is_not_kept() {
    let mut calibration = Calibration::new(calibration(config(&["acceleration"]))).expect("it can be");
    let mut refused = 0;
    for k in 0..1100 {
        let mut sample = sample(k, Command::NoMotion, 0.0);
        sample.channels[4..].copy_from_slice(&[0.0, 1.0]);
        let events = calibration.step(SimTime(5 * k), &[sample]).expect("judged");
        refused += events
            .iter()
            .filter(|e| matches!(e, CalibrationEvent::RepetitionRejected(_, RepetitionRejection::Imu)))
            .count();
    }
    assert_eq!((refused, calibration.repetitions().len()), (1, 0));
}

#[test]
fn positions_that_cannot_be_told_apart_are_refused() {
    let refused = |change: fn(&mut CalibrationConfig)| {
        let mut config = calibration(config(&[]));
        change(&mut config);
        Calibration::new(config).expect_err("refused").to_string()
    };
    assert!(refused(|c| c.positions[1] = "hanging".into()).contains("each once"));
    assert!(refused(|c| c.positions[1].clear()).contains("1 to 64 bytes"));
    assert!(refused(|c| c.max_rounds = 5).contains("two rounds for each position"));
}
