mod kind_tests;

use super::*;
use proact_types::Command;

const CHANNELS: usize = 4;
const RATE_HZ: f64 = 200.0;

/// Noise of standard deviation one, nearly Gaussian, from a counter.
fn noise(seed: u64, k: u64) -> f64 {
    (0..4).map(|part| uniform(seed.wrapping_add(1000 * part), k)).sum::<f64>() / 2.0
}

fn uniform(seed: u64, k: u64) -> f64 {
    let mut z = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(k.wrapping_mul(0xd1b5_4a32_d192_ed03));
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) as f64 / u64::MAX as f64 - 0.5) * 12_f64.sqrt()
}

type Session = Vec<(Gesture, u32, Vec<EmgSample>)>;

/// Three repetitions of rest and of a fist of 3 s, channel 1 changed by `change(seconds, value)`.
fn session(change: impl Fn(f64, f64) -> f64) -> Session {
    let mut session = Vec::new();
    for repetition in 0..3 {
        for (gesture, strength) in [(Command::NoMotion, 3.0), (Command::HandClose, 20.0)] {
            let seed = u64::from(repetition) * 16 + strength as u64 * 100;
            let sample = |k: u64| {
                let value = |c: u64| (strength * noise(seed + c, k)).round().clamp(-128.0, 127.0);
                let mut channels: Vec<f64> = (0..CHANNELS as u64).map(value).collect();
                channels[1] = change(k as f64 / RATE_HZ, channels[1]);
                EmgSample { counter: k, channels: channels.into_iter().collect() }
            };
            session.push((gesture.into(), repetition, (0..600).map(sample).collect()));
        }
    }
    session
}

fn check(session: &Session) -> Vec<RecordingFault> {
    let repetitions: Vec<RecordedRepetition<'_>> = session
        .iter()
        .map(|(gesture, repetition, samples)| RecordedRepetition {
            gesture: *gesture,
            repetition: *repetition,
            file: "file",
            samples,
        })
        .collect();
    check_recordings(&RecordingSet {
        rate_hz: RATE_HZ,
        channels: session[0].2[0].channels.len(),
        rest: Command::NoMotion.into(),
        unknown_rate_keys: &[],
        repetitions: &repetitions,
    })
}

/// The recordings with what `change` makes of recording, sample and row.
fn changed(change: impl Fn(usize, usize, &[f64]) -> Vec<f64>) -> Session {
    let mut session = session(|_, v| v);
    for (recording, (.., samples)) in session.iter_mut().enumerate() {
        for (k, sample) in samples.iter_mut().enumerate() {
            sample.channels = change(recording, k, &sample.channels).into_iter().collect();
        }
    }
    session
}

fn on_channel_1(finding: ChannelFault) -> impl Fn(&RecordingFault) -> bool {
    move |fault| matches!(fault, RecordingFault::Channel { channel: 1, status: ChannelStatus::Red, finding: f, .. } if *f == finding)
}

#[test]
fn good_recordings_have_no_fault() {
    assert_eq!(check(&session(|_, v| v)), []);
}

#[test]
fn each_planted_fault_is_the_only_one_found() {
    let only = |change: &dyn Fn(f64, f64) -> f64| {
        let mut faults = check(&session(change));
        assert_eq!(faults.len(), 1, "{faults:?}");
        faults.remove(0)
    };
    assert!(on_channel_1(ChannelFault::Flat)(&only(&|_, _| 3.0)));
    let hum = |t: f64, v: f64| v + 40.0 * (std::f64::consts::TAU * 50.0 * t).sin();
    assert!(on_channel_1(ChannelFault::Mains)(&only(&hum)));
    assert!(on_channel_1(ChannelFault::Railed)(&only(&|_, v| (1.5 * v).clamp(-20.0, 20.0))));
    assert!(matches!(only(&|t, _| 1000.0 + t), RecordingFault::TimeStamps { channel: 1, .. }));
    let loud = |t: f64, _: f64| (40.0 * noise(7, (t * 200.0).round() as u64)).round();
    assert!(matches!(only(&loud), RecordingFault::Noisy { channel: 1, ratio, .. } if ratio > 5.0));
}

#[test]
fn a_channel_that_is_red_in_few_recordings_is_told_with_their_names_and_refused_in_most() {
    let dead_in = |count: usize| {
        let mut session = session(|_, v| v);
        for (.., samples) in session.iter_mut().take(count) {
            samples.iter_mut().for_each(|sample| sample.channels[1] = 3.0);
        }
        let mut faults = check(&session);
        assert_eq!(faults.len(), 1, "{faults:?}");
        faults.remove(0)
    };
    let (one, four) = (dead_in(1), dead_in(4));
    assert_eq!((one.status(), four.status()), (ChannelStatus::Amber, ChannelStatus::Red));
    let rest = Gesture::from(Command::NoMotion);
    assert!(
        matches!(&one, RecordingFault::Channel { recordings, recording_count: 6, .. } if *recordings == [(rest, 0)]),
        "{one:?}"
    );
}

#[test]
fn repetitions_that_share_samples_are_named_whole_or_in_part() {
    let mut copied = session(|_, v| v);
    copied[5].2 = copied[1].2.clone();
    let close = Gesture::from(Command::HandClose);
    let files = vec!["file".to_owned(); 2];
    let expected = RecordingFault::CopiedRecording {
        first: (close, 0),
        second: (close, 2),
        samples: 600,
        later_samples: 600,
        files,
    };
    assert_eq!(check(&copied), [expected]);
    // The second half of one recording is the beginning of the next.
    let mut cut = session(|_, v| v);
    let half = cut[1].2[290..].to_vec();
    cut[3].2.splice(..half.len(), half);
    match check(&cut).as_slice() {
        [RecordingFault::CopiedRecording { first, second, samples, later_samples: 600, .. }] => {
            assert_eq!((*first, *second), ((close, 0), (close, 1)));
            assert!((280..=310).contains(samples), "{samples}");
        }
        other => panic!("{other:?}"),
    }
}

/// A copy with another gain, offset or polarity, and one with time stamps of its own, came through as a new repetition.
#[test]
fn a_copy_is_found_whatever_its_gain_offset_shift_and_stamps() {
    let close = Gesture::from(Command::HandClose);
    type Change = fn(usize, f64) -> f64;
    let copies: [(&str, Change); 4] = [
        ("gain and offset", |_, v| 0.6 * v + 7.0),
        ("rounded", |_, v| (0.6 * v).round()),
        ("polarity", |_, v| -v),
        ("noise", |k, v| v + 0.5 * noise(99, k as u64)),
    ];
    for (name, change) in copies {
        let mut session = session(|_, v| v);
        // Shifted by 100 samples.
        let copy: Vec<EmgSample> = session[1].2[100..]
            .iter()
            .enumerate()
            .map(|(k, sample)| EmgSample {
                counter: k as u64,
                channels: sample.channels.iter().map(|v| change(k, *v)).collect(),
            })
            .collect();
        session[5].2 = copy;
        match check(&session).as_slice() {
            [RecordingFault::CopiedRecording { first, second, samples, later_samples: 500, .. }] => {
                assert_eq!((*first, *second), ((close, 0), (close, 2)), "{name}");
                assert!(*samples >= 460, "{name}: {samples}");
            }
            other => panic!("{name}: {other:?}"),
        }
    }
    let mut stamped =
        changed(|recording, k, row| [&[100.0 * recording as f64 + 0.005 * k as f64], row].concat());
    for k in 0..600 {
        let original = stamped[1].2[k].channels.clone();
        stamped[5].2[k].channels[1..].copy_from_slice(&original[1..]);
    }
    let faults = check(&stamped);
    assert!(
        matches!(
            faults.as_slice(),
            [
                RecordingFault::TimeStamps { channel: 0, .. },
                RecordingFault::CopiedRecording { samples: 600, .. }
            ]
        ),
        "{faults:?}"
    );
}

/// A gesture was recognised by the fault of a channel, at 100 % on noise, with no more than a word.
#[test]
fn a_fault_that_coincides_with_a_gesture_or_a_repetition_is_refused() {
    let hum = |k: usize| 40.0 * (std::f64::consts::TAU * 50.0 * k as f64 / RATE_HZ).sin();
    let names =
        ["no_motion", "hand_close", "a", "b", "c"].map(|name| name.parse::<Gesture>().expect("a good name"));
    // Noise: five gestures, three repetitions, channel 1 faulty in the recordings of `faulty`.
    let faults = |faulty: &dyn Fn(usize, u32) -> bool, fault: &dyn Fn(usize, f64) -> f64| {
        let mut session = Vec::new();
        for (class, repetition) in (0..5).flat_map(|class| (0..3).map(move |repetition| (class, repetition)))
        {
            let sample = |k: usize| {
                let seed = 100 * class as u64 + 10 * u64::from(repetition);
                let value = |c: usize| (20.0 * noise(seed + c as u64, k as u64)).round();
                let mut channels: Vec<f64> = (0..CHANNELS).map(value).collect();
                if faulty(class, repetition) {
                    channels[1] = fault(k, channels[1]);
                }
                EmgSample { counter: k as u64, channels: channels.into_iter().collect() }
            };
            session.push((names[class], repetition, (0..600).map(sample).collect()));
        }
        check(&session)
    };
    type Fault<'a> = &'a dyn Fn(usize, f64) -> f64;
    let kinds: [(ChannelFault, Fault<'_>); 2] =
        [(ChannelFault::Flat, &|_, _| 0.0), (ChannelFault::Mains, &|k, v| v + hum(k))];
    for (finding, fault) in kinds {
        let only = |faulty: &dyn Fn(usize, u32) -> bool| match faults(faulty, fault).as_slice() {
            [found @ RecordingFault::Channel { channel: 1, finding: kind, coincidence: coincides, .. }]
                if *kind == finding =>
            {
                (found.status(), *coincides)
            }
            other => panic!("{other:?}"),
        };
        let gesture = |class: usize| (ChannelStatus::Red, Some(Coincidence::Gesture(names[class])));
        assert_eq!(only(&|class, _| class == 3), gesture(3));
        assert_eq!(only(&|class, repetition| class == 0 && repetition < 2), gesture(0));
        assert_eq!(
            only(&|_, repetition| repetition == 2),
            (ChannelStatus::Red, Some(Coincidence::Repetition(2)))
        );
        assert_eq!(
            only(&|class, repetition| class as u32 % 3 == repetition && class < 3),
            (ChannelStatus::Amber, None)
        );
    }
}

#[test]
fn a_relaxed_hand_below_a_step_of_the_converter_is_no_reason_to_refuse() {
    let coarse = check(&changed(|recording, _, row| {
        let resting = recording % 2 == 0;
        row.iter().enumerate().map(|(c, v)| if resting && c < 2 { 0.0 } else { (v / 3.0).round() }).collect()
    }));
    assert!(coarse.iter().all(|fault| fault.status() == ChannelStatus::Amber), "{coarse:?}");
    assert_eq!(coarse.len(), 2, "{coarse:?}");
}

/// An electrode beside an acceleration, and three beside a clock, were taken for an orientation and advised to be removed.
#[test]
fn no_electrode_is_taken_for_a_part_of_what_stands_beside_it() {
    let gravity = |recording: usize, k: usize, seed: u64| {
        let tilt = 0.25 * (recording % 5) as f64 + 0.05 * (k as f64 / 64.0 + recording as f64).sin();
        let parts = [tilt.sin(), 0.2 * tilt.cos(), tilt.cos()];
        [0, 1, 2].map(|c| parts[c] + 0.03 * noise(seed + c as u64, k as u64))
    };
    // Units of the electrodes and of an acceleration beside them.
    for (emg, unit) in [(1.0, 2048.0), (1.0, 1000.0), (1.0, 16_384.0), (1e-6, 1.0), (1e-6, 9.81)] {
        for at in [0, 2, CHANNELS] {
            let beside = |columns: &dyn Fn(usize, usize) -> Vec<f64>| {
                let session = changed(|recording, k, row| {
                    let mut row: Vec<f64> = row.iter().map(|v| emg * v).collect();
                    row.splice(at..at, columns(recording, k));
                    row
                });
                check(&session)
            };
            let count = if unit > 100.0 { 1.0 } else { 1e-6 };
            let acceleration = |recording: usize, k: usize| -> Vec<f64> {
                gravity(recording, k, 70 + recording as u64)
                    .iter()
                    .map(|v| (unit * v / count).round() * count)
                    .collect()
            };
            match beside(&acceleration).as_slice() {
                [RecordingFault::Acceleration { channels, .. }] => {
                    assert_eq!(*channels, [at, at + 1, at + 2], "{unit}, {emg}");
                }
                other => panic!("{unit}, {emg}, {at}: {other:?}"),
            }
            // Time stamps of a computer that come late.
            let clock = |recording: usize, k: usize| {
                vec![1.7e9 + 100.0 * recording as f64 + 0.005 * k as f64 + 0.004 * noise(80, k as u64)]
            };
            match beside(&clock).as_slice() {
                [RecordingFault::Slow { channel, .. }] => assert_eq!(*channel, at),
                other => panic!("{emg}, {at}: {other:?}"),
            }
        }
    }
}

/// Columns that are no electrode raised an accuracy without a word.
#[test]
fn each_column_that_is_no_electrode_is_named() {
    let tilt = |recording: usize, k: usize| 0.2 * recording as f64 + 0.05 * (k as f64 / 90.0).sin();
    let small = |seed: u64, k: usize| 0.003 * noise(seed, k as u64);
    let quaternion = |recording: usize, k: usize| {
        let half = tilt(recording, k) / 2.0;
        let axis = [0.3, 0.5, 0.81].map(|part| part / 0.998_05 * half.sin());
        vec![axis[0] + small(1, k), axis[1] + small(2, k), axis[2] + small(3, k), half.cos() + small(4, k)]
    };
    let gravity = |recording: usize, k: usize| {
        let tilt = tilt(recording, k);
        vec![9.81 * tilt.sin() + small(1, k), small(2, k), 9.81 * tilt.cos() + small(3, k)]
    };
    type Columns<'a> = &'a dyn Fn(usize, usize) -> Vec<f64>;
    let cases: [(&str, Columns<'_>); 14] = [
        ("time_stamps", &|_, k| vec![1.7e9 + 0.005 * k as f64]),
        ("time_stamps", &|recording, k| vec![(100_000 * recording + 5 * (k - k % 3)) as f64]),
        ("counter", &|recording, k| vec![((k + 77 * recording) % 256) as f64]),
        ("counter", &|_, k| vec![(k % 8) as f64]),
        ("counter", &|_, k| vec![65_535.0 - k as f64]),
        ("label", &|recording, _| vec![(recording % 2) as f64]),
        ("orientation", &quaternion),
        ("orientation", &|recording, k| {
            quaternion(recording, k).iter().map(|v| (16_384.0 * v).round()).collect()
        }),
        // A limb that is not moved at all.
        ("orientation", &|_, k| {
            vec![0.5 + small(1, k), 0.5 + small(2, k), -0.5 + small(3, k), 0.5 + small(4, k)]
        }),
        ("acceleration", &gravity),
        ("acceleration", &|recording, k| gravity(recording, k).iter().map(|v| v / 9.81).collect()),
        ("slow", &|recording, k| vec![tilt(recording, k) + small(1, k)]),
        ("slow", &|recording, k| vec![90.0 * (k as f64 / 60.0 + recording as f64).sin()]),
        ("channel", &|_, k| vec![128.0 + (uniform(5, k as u64)).clamp(-1.0, 1.0).round()]),
    ];
    for (kind, columns) in cases {
        for first in [true, false] {
            let session = changed(|recording, k, row| {
                let columns = columns(recording, k);
                if first { [&columns, row].concat() } else { [row, &columns].concat() }
            });
            let faults = check(&session);
            let value = serde_json::to_value(&faults).expect("it is data");
            assert_eq!(faults.len(), 1, "{kind}: {faults:?}");
            assert_eq!(
                (faults[0].status(), &value[0]["fault"]),
                (ChannelStatus::Red, &kind.into()),
                "{faults:?}"
            );
            let channel = if first { 0 } else { CHANNELS };
            assert!(value[0]["channel"] == channel || value[0]["channels"][0] == channel, "{kind}: {value}");
        }
    }
}

/// Rows that a slow reader held, also beside time stamps of its own, made training and test alike.
#[test]
fn held_rows_are_found_at_any_rate_and_quiet_channels_are_none() {
    let good = session(|_, v| v);
    for (held, share) in [(2, 0.5), (5, 0.8), (10, 0.9)] {
        for stamps in [0, 1] {
            let session = changed(|recording, k, _| {
                let row = good[recording].2[k - k % held].channels.to_vec();
                [vec![0.005 * k as f64; stamps], row].concat()
            });
            let faults = check(&session);
            let found = faults.iter().find_map(|fault| match fault {
                RecordingFault::RepeatedRows {
                    share, max_run, recordings: 6, recording_count: 6, ..
                } => Some((*share, *max_run)),
                _ => None,
            });
            let (found, max_run) = found.unwrap_or_else(|| panic!("{held}: {faults:?}"));
            assert!((found - share).abs() < 0.01 && max_run == held, "{held}: {found}, {max_run}");
            assert_eq!(faults.len(), 1 + stamps, "{faults:?}");
        }
    }
    // A converter of few counts.
    assert_eq!(check(&changed(|_, _, row| row.iter().map(|v| (v / 3.0).round()).collect())), []);
}

#[test]
fn no_unit_offset_or_number_of_channels_is_a_fault() {
    let good: [(&str, &dyn Fn(f64) -> f64); 4] = [
        ("volts", &|v| 1e-6 * v),
        ("millivolts with noise", &|v| 0.0123 * v),
        ("codes of 8 bits", &|v| v + 128.0),
        ("codes of 16 bits", &|v| 32_768.0 - 9.0 * v),
    ];
    for (name, unit) in good {
        assert_eq!(check(&changed(|_, _, row| row.iter().map(|v| unit(*v)).collect())), [], "{name}");
    }
    for channels in 1..CHANNELS {
        assert_eq!(check(&changed(|_, _, row| row[..channels].to_vec())), [], "{channels}");
    }
    // Envelopes and electrodes without a high pass are all slow: said, and used.
    let drifting = check(&changed(|recording, k, row| {
        row.iter()
            .enumerate()
            .map(|(c, v)| v + 500.0 * ((k + 99 * recording) as f64 / (80.0 + c as f64)).sin())
            .collect()
    }));
    assert!(drifting.iter().all(|fault| fault.status() == ChannelStatus::Amber), "{drifting:?}");
    assert_eq!(drifting.len(), CHANNELS, "{drifting:?}");
}
