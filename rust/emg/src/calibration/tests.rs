use super::*;
use crate::{ChannelFault, EmgConfig, StreamFormat};
use proact_types::Command::{self, HandClose, HandOpen, NoMotion};

const RATE: f64 = 200.0;
const CHANNELS: usize = 3;
const ZERO: f64 = 128.0;

fn config() -> CalibrationConfig {
    CalibrationConfig {
        emg: EmgConfig { rate_hz: RATE, channels: CHANNELS, ..EmgConfig::default() },
        gestures: [NoMotion, HandClose, HandOpen].map(Gesture::from).into(),
        nominal_dc_offset: 120.0,
        ..CalibrationConfig::default()
    }
}

/// Noise, uniform in -1 to 1.
fn noise(seed: u64, k: u64) -> f64 {
    let mut z = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(k.wrapping_mul(0xd1b5_4a32_d192_ed03));
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    2.0 * ((z ^ (z >> 31)) as f64 / u64::MAX as f64 - 0.5)
}

/// Raw codes of a gesture: each has a muscle of its own.
fn sample(counter: u64, gesture: impl Into<Gesture>) -> EmgSample {
    let gesture = gesture.into().same_named_command();
    let strength = |c: usize| match (gesture, c) {
        (Some(HandClose), 0) | (Some(HandOpen), 1) => 40.0,
        _ => 4.0,
    };
    let channels = (0..CHANNELS).map(|c| (ZERO + strength(c) * noise(c as u64, counter)).round()).collect();
    EmgSample { counter, channels }
}

/// A person who makes what is prompted, or what `act` says, until `until` samples have come; all events.
fn run(
    calibration: &mut Calibration,
    from: u64,
    until: u64,
    mut spoil: impl FnMut(&CalibrationPhase, EmgSample) -> Option<EmgSample>,
) -> Vec<CalibrationEvent> {
    let mut events = Vec::new();
    for k in from..until {
        let phase = calibration.phase();
        let gesture = match &phase {
            CalibrationPhase::Preparing { prompt, .. }
            | CalibrationPhase::Recording { prompt, .. }
            | CalibrationPhase::Blocked { prompt } => prompt.gesture,
            CalibrationPhase::Reviewing | CalibrationPhase::Finished => NoMotion.into(),
        };
        let sample = spoil(&phase, sample(k, gesture));
        events
            .extend(calibration.step(SimTime(5 * k), sample.as_slice()).expect("a round that can be judged"));
    }
    events
}

/// Samples of a round: three prompts of 2 + 3 s, and a few.
const ROUND: u64 = 3 * 1000 + 10;

fn session_after(rounds: u64) -> Calibration {
    let mut calibration = Calibration::new(config()).expect("good settings");
    for round in 0..rounds {
        run(&mut calibration, round * ROUND, (round + 1) * ROUND, |_, s| Some(s));
        assert_eq!(calibration.phase(), CalibrationPhase::Reviewing);
        if round + 1 < rounds {
            assert!(calibration.start_next_round());
        }
    }
    calibration
}

#[test]
fn two_rounds_are_prompted_recorded_judged_and_make_a_model_that_fits() {
    let mut calibration = Calibration::new(config()).expect("good settings");
    let events = run(&mut calibration, 0, ROUND, |_, s| Some(s));
    let prompted: Vec<Gesture> = events
        .iter()
        .filter_map(|e| match e {
            CalibrationEvent::Prompted(prompt) => Some(prompt.gesture),
            _ => None,
        })
        .collect();
    assert_eq!(prompted, [NoMotion, HandClose, HandOpen]);
    assert_eq!(events.last(), Some(&CalibrationEvent::RoundFinished));
    assert_eq!((calibration.rounds(), calibration.report()), (1, None), "one round cannot be judged");
    assert!(calibration.start_next_round());
    run(&mut calibration, ROUND, 2 * ROUND, |_, s| Some(s));
    let report = calibration.report().expect("two rounds can be judged").clone();
    assert!(report.good_enough && report.accuracy == 1.0 && report.outliers().count() == 0, "{report:?}");
    // 600 samples are 59 windows of 20 every 10.
    assert_eq!((report.windows, report.rounds), (6 * 59, 2));
    assert!(
        calibration.repetitions().iter().all(|r| r.samples.len() == 600 && r.status == ChannelStatus::Green)
    );

    let model = calibration.finish().expect("a model");
    assert_eq!(calibration.phase(), CalibrationPhase::Finished);
    assert!(model.dc_offset.iter().all(|level| (level - ZERO).abs() <= 1.0), "{:?}", model.dc_offset);
    let rest_medians = Some(vec![ZERO; CHANNELS]);
    model
        .check_stream_format(&StreamFormat {
            rate_hz: RATE,
            channels: CHANNELS,
            rest_medians,
            imu: Vec::new(),
        })
        .expect("it fits");
    let rest_medians = Some(vec![0.0; CHANNELS]);
    let other = model.check_stream_format(&StreamFormat {
        rate_hz: RATE,
        channels: CHANNELS,
        rest_medians,
        imu: Vec::new(),
    });
    assert!(other.expect_err("centred already").to_string().contains("centring"));
}

#[test]
fn a_repetition_with_a_long_gap_or_a_bad_sample_is_recorded_again() {
    for nan in [false, true] {
        let mut calibration = Calibration::new(config()).expect("good settings");
        // Nine samples of 5 ms are more than are bridged.
        let mut spoilt = 0;
        let events = run(&mut calibration, 0, 2000, |phase, mut s| {
            let max_count = if nan { 1 } else { 9 };
            let due = spoilt < max_count
                && matches!(phase, CalibrationPhase::Recording { share, .. } if *share > 0.5);
            spoilt += u32::from(due);
            if due && nan {
                s.channels[0] = f64::NAN;
            }
            (!due || nan).then_some(s)
        });
        let first = Prompt { gesture: NoMotion.into(), repetition: 0 };
        let lost = if nan { 0 } else { 9 };
        let refused = CalibrationEvent::RepetitionRejected(first, RepetitionRejection::Gap { lost });
        let at = events.iter().position(|e| *e == refused).expect("it is refused");
        assert_eq!(events[at + 1], CalibrationEvent::Prompted(first));
        let kept = events.iter().filter(|e| matches!(e, CalibrationEvent::RepetitionAccepted(_))).count();
        assert_eq!((kept, calibration.repetitions().len()), (1, 1));
        assert_eq!(calibration.repetitions()[0].samples.len(), 600);
    }
}

#[test]
fn nothing_is_recorded_while_a_channel_is_dead_and_it_goes_on_when_it_is_not() {
    let mut calibration = Calibration::new(config()).expect("good settings");
    let dead = |_: &CalibrationPhase, mut s: EmgSample| {
        s.channels[2] = 128.0;
        Some(s)
    };
    let events = run(&mut calibration, 0, 2000, dead);
    assert_eq!(events.len(), 2, "{events:?}");
    let channels = vec![(2, Some(ChannelFault::Flat))];
    let first = Prompt { gesture: NoMotion.into(), repetition: 0 };
    assert_eq!(
        events[1],
        CalibrationEvent::Blocked(
            first,
            RepetitionRejection::Red { channels: channels.clone(), stream: false }
        )
    );
    assert!(calibration.repetitions().is_empty());
    run(&mut calibration, 2000, 3300, |_, s| Some(s));
    assert_eq!(calibration.repetitions().len(), 1);
    // A channel that dies while it is recorded.
    let events = run(&mut calibration, 3300, 4300, dead);
    let refused = events.iter().any(
        |e| matches!(e, CalibrationEvent::RepetitionRejected(_, RepetitionRejection::Red { channels: c, .. }) if *c == channels),
    );
    assert!(refused || matches!(calibration.phase(), CalibrationPhase::Blocked { .. }), "{events:?}");
    assert_eq!(calibration.repetitions().len(), 1);
}

#[test]
fn a_stream_that_falls_silent_stops_the_recording() {
    let mut calibration = Calibration::new(config()).expect("good settings");
    let events = run(&mut calibration, 0, 800, |phase, s| {
        (!matches!(phase, CalibrationPhase::Recording { share, .. } if *share > 0.2)).then_some(s)
    });
    assert!(
        events
            .iter()
            .any(|e| matches!(e, CalibrationEvent::RepetitionRejected(_, RepetitionRejection::Silence))),
        "{events:?}"
    );
    let mut unheard = Calibration::new(config()).expect("good settings");
    let events = run(&mut unheard, 0, 800, |_, _| None);
    assert!(
        matches!(events[..], [_, CalibrationEvent::Blocked(_, RepetitionRejection::Silence)]),
        "{events:?}"
    );
}

#[test]
fn a_repetition_of_another_gesture_is_an_outlier_and_can_be_recorded_again() {
    let mut calibration = session_after(2);
    assert!(calibration.start_next_round());
    // In the third round the person opens the hand when asked to close it.
    run(&mut calibration, 2 * ROUND, 3 * ROUND, |phase, s| {
        let wrong = matches!(phase, CalibrationPhase::Recording { prompt, .. } | CalibrationPhase::Preparing { prompt, .. } if prompt.gesture == HandClose);
        Some(if wrong { sample(s.counter, HandOpen) } else { s })
    });
    let report = calibration.report().expect("judged").clone();
    assert!(!report.good_enough && report.accuracy < 0.9, "{report:?}");
    let outliers: Vec<(Gesture, usize)> = report.outliers().map(|r| (r.gesture, r.repetition)).collect();
    assert_eq!(outliers, [(HandClose.into(), 2)], "{report:?}");

    assert!(!calibration.redo_repetition(HandClose, Some(9)), "there is no such repetition");
    assert!(calibration.redo_repetition(HandClose, None));
    assert!(!calibration.redo_repetition(HandClose, None), "not while it is being recorded");
    run(&mut calibration, 3 * ROUND, 3 * ROUND + 1010, |_, s| Some(s));
    let report = calibration.report().expect("judged");
    assert!(report.good_enough && report.rounds == 3 && report.outliers().count() == 0, "{report:?}");
}

#[test]
fn recordings_can_be_added_and_bad_ones_are_refused() {
    let mut calibration = Calibration::new(config()).expect("good settings");
    let take = |from: u64, gesture| (from..from + 600).map(|k| sample(k, gesture)).collect::<Vec<_>>();
    let mut gapped = take(0, NoMotion);
    gapped.drain(300..309);
    let error = calibration.add(NoMotion, gapped).expect_err("a gap").to_string();
    assert_eq!(
        error,
        "the repetition has sample 309 after 299, expected rising counters and short, rare gaps"
    );
    let mut falling = take(0, NoMotion);
    falling[7].counter = 0;
    assert!(calibration.add(NoMotion, falling).is_err());
    let mut nan = take(0, NoMotion);
    nan[5].channels[1] = f64::NAN;
    assert!(calibration.add(NoMotion, nan).is_err());
    assert!(calibration.add(NoMotion, take(0, NoMotion)[..10].to_vec()).is_err());
    assert!(calibration.add(Command::WristFlexion, take(0, NoMotion)).is_err());
    assert!(calibration.repetitions().is_empty());
    assert!(calibration.finish().is_err(), "nothing to train on");
    for round in 0..2 {
        for gesture in [NoMotion, HandClose, HandOpen] {
            calibration.add(gesture, take(round * 1000, gesture)).expect("good");
        }
    }
    calibration.review().expect("can be judged");
    assert!(calibration.report().is_some_and(|r| r.good_enough));
    assert!(calibration.finish().is_ok());
}

/// With one packet in a hundred lost hardly a repetition was kept: three seconds hold two hundred packets.
#[test]
fn lost_packets_cost_a_few_windows_and_no_repetition() {
    let mut calibration = Calibration::new(config()).expect("good settings");
    let lossy = |_: &CalibrationPhase, s: EmgSample| (!(s.counter / 3).is_multiple_of(97)).then_some(s);
    let mut events = run(&mut calibration, 0, ROUND, lossy);
    assert!(calibration.start_next_round());
    events.extend(run(&mut calibration, ROUND, 2 * ROUND, lossy));
    assert!(!events.iter().any(|e| matches!(e, CalibrationEvent::RepetitionRejected(..))), "{events:?}");
    let (report, repetitions) = (calibration.report().expect("judged"), calibration.repetitions());
    assert!(report.good_enough && report.rounds == 2, "{report:?}");
    let lost: usize = repetitions.iter().map(|r| 600 - r.samples.len()).sum();
    assert!((18..=45).contains(&lost), "{lost}");
    // A gap touches two or three of the windows; these are not trained on.
    assert!((6 * 59 - 45..6 * 59).contains(&report.windows), "{}", report.windows);

    // One in ten is too many: the light says so, and nothing is kept.
    let mut calibration = Calibration::new(config()).expect("good settings");
    run(&mut calibration, 0, ROUND, |_, s| (!(s.counter / 3).is_multiple_of(10)).then_some(s));
    assert!(calibration.repetitions().is_empty());
}

#[test]
fn an_interrupted_calibration_goes_on_where_it_stopped() {
    let whole = session_after(2);
    let kept = |calibration: &Calibration| -> Vec<(Gesture, Vec<EmgSample>)> {
        calibration.repetitions().iter().map(|r| (r.gesture, r.samples.clone())).collect()
    };
    // Stopped in the second round, in the recording of the second gesture.
    let mut stopped = session_after(1);
    assert!(stopped.start_next_round());
    run(&mut stopped, ROUND, ROUND + 1500, |_, s| Some(s));
    assert_eq!(stopped.repetitions().len(), 4);
    let mut resumed = Calibration::new(config()).expect("good settings");
    resumed.resume(kept(&stopped)).expect("what was kept is good");
    let events = run(&mut resumed, 9000, 9000 + 2 * 1000 + 10, |_, s| Some(s));
    let second =
        |gesture: Command| CalibrationEvent::Prompted(Prompt { gesture: gesture.into(), repetition: 1 });
    assert_eq!(events[0], second(HandClose));
    assert!(events.contains(&second(HandOpen)));
    assert_eq!((resumed.phase(), resumed.rounds()), (CalibrationPhase::Reviewing, 2));
    assert!(resumed.report().is_some_and(|r| r.good_enough));

    // Between two rounds there is nothing to record, but to decide; before the first all of it.
    let mut reviewed = Calibration::new(config()).expect("good settings");
    reviewed.resume(kept(&whole)).expect("good");
    assert_eq!((reviewed.phase(), reviewed.report()), (CalibrationPhase::Reviewing, whole.report()));
    let mut fresh = Calibration::new(config()).expect("good settings");
    fresh.resume(Vec::new()).expect("nothing to add");
    assert!(
        matches!(fresh.phase(), CalibrationPhase::Preparing { prompt, .. } if prompt.gesture == NoMotion)
    );
}

#[test]
fn settings_that_cannot_work_are_refused() {
    let refused = |change: fn(&mut CalibrationConfig)| {
        let mut changed = config();
        change(&mut changed);
        Calibration::new(changed).expect_err("refused").to_string()
    };
    assert!(refused(|c| c.repetition_secs = f64::NAN).contains("NaN"));
    assert!(refused(|c| c.gestures.truncate(1)).contains("1 different gestures"));
    assert!(refused(|c| c.gestures.push(HandClose.into())).contains("hand_close is asked for twice"));
    assert!(refused(|c| c.target_accuracy = 2.0).contains("0 to 1"));
    assert!(refused(|c| c.max_rounds = 0).contains("most_rounds"));
    let one = cross_validate(&config().emg, &[(NoMotion, (0..600).map(|k| sample(k, NoMotion)).collect())]);
    assert!(one.expect_err("one repetition").to_string().contains("no_motion has 1 repetitions"));
}
