//! Kinds of faults that came through without a word, each in several forms.

use super::*;
use std::f64::consts::TAU;

/// The kind of each finding, and its channels where it has any.
fn kinds(session: &Session) -> Vec<(String, Vec<usize>)> {
    let findings = check(session);
    let kind = |fault: &RecordingFault| {
        let value = serde_json::to_value(fault).expect("it is data");
        let many = value["channels"].as_array().cloned().unwrap_or_default();
        let channels = many.iter().chain(value.get("channel")).filter_map(serde_json::Value::as_u64);
        (value["fault"].as_str().unwrap_or_default().to_owned(), channels.map(|c| c as usize).collect())
    };
    findings.iter().map(kind).collect()
}

/// `values` at other places: linear between samples.
fn at(values: &[EmgSample], fractional_index: f64) -> Vec<f64> {
    let (k, share) = (fractional_index as usize, fractional_index.fract());
    let next = &values[(k + 1).min(values.len() - 1)];
    values[k].channels.iter().zip(&next.channels).map(|(a, b)| a + share * (b - a)).collect()
}

/// A pole or a zero each way: `new = old + share (value - old)`, twice.
fn low_passed(rows: &[Vec<f64>], share: f64) -> Vec<Vec<f64>> {
    let mut state = [vec![0.0; CHANNELS], vec![0.0; CHANNELS]];
    let step = |row: &Vec<f64>| {
        let mut value = row.clone();
        for state in &mut state {
            state.iter_mut().zip(&mut value).for_each(|(state, value)| {
                *state += share * (*value - *state);
                *value = *state;
            });
        }
        value
    };
    rows.iter().map(step).collect()
}

/// A repetition that was copied with these changes was tested as a new one, at up to 100 %.
#[test]
fn an_altered_copy_is_found_whatever_was_done_to_it() {
    type Rows = Vec<Vec<f64>>;
    type Change<'a> = &'a dyn Fn(&Rows) -> Rows;
    let noisy = |rows: &Rows, share: f64| -> Rows {
        let row = |(k, row): (usize, &Vec<f64>)| {
            row.iter().enumerate().map(|(c, v)| v + 20.0 * share * noise(900 + c as u64, k as u64)).collect()
        };
        rows.iter().enumerate().map(row).collect()
    };
    let faster = |rows: &Rows, speed: f64| -> Rows {
        let samples: Vec<EmgSample> = rows
            .iter()
            .map(|row| EmgSample { counter: 0, channels: row.iter().copied().collect() })
            .collect();
        (0..(rows.len() as f64 / speed) as usize).map(|k| at(&samples, speed * k as f64)).collect()
    };
    let high_passed = |rows: &Rows, share: f64| -> Rows {
        let slow = low_passed(rows, share);
        rows.iter().zip(slow).map(|(row, slow)| row.iter().zip(slow).map(|(a, b)| a - b).collect()).collect()
    };
    let rotated = |rows: &Rows, by: usize| -> Rows {
        rows.iter().map(|row| (0..CHANNELS).map(|c| row[(c + by) % CHANNELS]).collect()).collect()
    };
    let backwards = |rows: &Rows| -> Rows { rows.iter().rev().cloned().collect() };
    let scaled = |rows: &Rows, gains: [f64; CHANNELS]| -> Rows {
        rows.iter().map(|row| row.iter().zip(gains).map(|(v, gain)| (gain * v).round()).collect()).collect()
    };
    let alterations: [(&str, Change<'_>); 14] = [
        ("a tenth of noise", &|rows| noisy(rows, 0.1)),
        ("half as much noise as signal", &|rows| noisy(rows, 0.5)),
        ("slower", &|rows| faster(rows, 0.97)),
        ("faster", &|rows| faster(rows, 1.05)),
        ("much slower, between two of the speeds that are searched", &|rows| faster(rows, 0.945)),
        ("low pass", &|rows| low_passed(rows, 0.5)),
        ("high pass", &|rows| high_passed(rows, 0.5)),
        ("channels moved on", &|rows| rotated(rows, 3)),
        ("polarity of some channels, with noise", &|rows| noisy(&scaled(rows, [1.0, -1.0, -1.0, 1.0]), 0.2)),
        ("a gain for each channel, with noise", &|rows| noisy(&scaled(rows, [0.3, 2.0, 0.7, 1.3]), 0.2)),
        ("shifted by half a second, with noise", &|rows| noisy(&rows[100..].to_vec(), 0.2)),
        ("the second half alone, with noise", &|rows| noisy(&rows[300..].to_vec(), 0.2)),
        ("backwards", &backwards),
        ("all of it", &|rows| {
            let moved = rotated(&faster(&backwards(&rows[40..].to_vec()), 1.03), 1);
            noisy(&scaled(&low_passed(&moved, 0.6), [-0.8, 0.9, 1.2, -1.0]), 0.1)
        }),
    ];
    for (name, change) in alterations {
        let mut session = session(|_, v| v);
        let rows = session[1].2.iter().map(|sample| sample.channels.to_vec()).collect();
        let copy = change(&rows).into_iter().enumerate();
        session[5].2 = copy
            .map(|(k, row)| EmgSample { counter: k as u64, channels: row.into_iter().collect() })
            .collect();
        let faults = check(&session);
        let value = serde_json::to_value(&faults).expect("it is data");
        assert_eq!(faults.len(), 1, "{name}: {faults:?}");
        assert!(value[0]["fault"] == "altered_copy" || value[0]["fault"] == "shared", "{name}: {value}");
        assert_eq!(
            (&value[0]["first"][1], &value[0]["second"][1]),
            (&0.into(), &2.into()),
            "{name}: {value}"
        );
        assert_eq!(faults[0].status(), ChannelStatus::Red);
    }
}

/// A tremor fits itself at each of its periods, and onset, release and hum are alike in all repetitions.
#[test]
fn repetitions_that_are_alike_as_those_of_a_person_are_no_copies() {
    let alike = |change: &dyn Fn(usize, f64) -> f64| {
        changed(|recording, k, row| {
            let lag = 37 * recording;
            row.iter().map(|v| change(k + lag, *v).round()).collect()
        })
    };
    let secs = |k: usize| k as f64 / RATE_HZ;
    let tremor = alike(&|k, v| v * (1.0 + 0.9 * (TAU * 9.0 * secs(k)).sin()));
    assert_eq!(kinds(&tremor), []);
    let onset = changed(|_, k, row| {
        row.iter()
            .map(|v| (v * (secs(k) / 0.3).min(1.0) * ((3.0 - secs(k)) / 0.4).min(1.0)).round())
            .collect()
    });
    assert_eq!(kinds(&onset), []);
    for hz in [50.0, 60.0] {
        let hum = alike(&|k, v| v + 8.0 * (TAU * hz * secs(k)).sin());
        assert!(
            check(&hum).iter().all(|fault| matches!(fault, RecordingFault::Channel { .. })),
            "{:?}",
            check(&hum)
        );
    }
}

/// A turn rate, and an accelerometer that is shaken, raised an accuracy without a word.
#[test]
fn sensors_of_a_moving_limb_are_found_in_any_unit() {
    let swing = |recording: usize, k: usize, hz: f64, axis: usize| {
        let strength = [1.0, 0.6, 0.3][axis] * if recording % 2 == 1 { 1.0 } else { 0.3 };
        let time = k as f64 / RATE_HZ + 0.37 * recording as f64;
        strength * ((TAU * hz * time + axis as f64).sin() + 0.3 * (TAU * 0.7 * hz * time).cos())
    };
    let sensor =
        |recording: usize, k: usize, axis: usize| noise(70 + (10 * recording + axis) as u64, k as u64);
    for hz in [2.0, 4.0, 6.0, 8.0] {
        let turning = |recording: usize, k: usize| -> Vec<f64> {
            (0..3)
                .map(|axis| 2.0 * swing(recording, k, hz, axis) + 0.1 * sensor(recording, k, axis))
                .collect()
        };
        let shaken = |recording: usize, k: usize| -> Vec<f64> {
            let gravity = [0.3, -0.2, 0.93];
            (0..3)
                .map(|axis| {
                    gravity[axis] + 1.5 * swing(recording, k, hz, axis) + 0.05 * sensor(recording, k, axis)
                })
                .collect()
        };
        for unit in [1.0, 1e-3, 57.3, 2048.0] {
            let turned = changed(|recording, k, row| {
                [row, &turning(recording, k).iter().map(|v| unit * v).collect::<Vec<_>>()].concat()
            });
            let expected: Vec<_> = (0..3).map(|axis| ("slow".to_owned(), vec![CHANNELS + axis])).collect();
            assert_eq!(kinds(&turned), expected, "turn rate, {hz} Hz, {unit}");
            // More columns of another sensor than electrodes.
            let six = changed(|recording, k, row| {
                let columns: Vec<f64> =
                    turning(recording, k).into_iter().chain(shaken(recording, k)).map(|v| unit * v).collect();
                [&columns, row].concat()
            });
            let found: Vec<usize> = check(&six)
                .iter()
                .filter(|f| f.status() == ChannelStatus::Red)
                .flat_map(|f| {
                    let value = serde_json::to_value(f).expect("it is data");
                    let many = value["channels"].as_array().cloned().unwrap_or_default();
                    many.iter()
                        .chain(value.get("channel"))
                        .filter_map(serde_json::Value::as_u64)
                        .map(|c| c as usize)
                        .collect::<Vec<_>>()
                })
                .collect();
            let mut found = found;
            found.sort_unstable();
            assert_eq!(found, [0, 1, 2, 3, 4, 5], "{hz} Hz, {unit}: {:?}", check(&six));
        }
    }
}

/// Clocks and counters with noise, in other units.
#[test]
fn clocks_counters_and_orientations_with_noise_are_found_in_any_unit() {
    let small = |seed: u64, k: usize| noise(seed, k as u64);
    type Column<'a> = &'a dyn Fn(usize, usize) -> f64;
    let cases: [(&str, Column<'_>); 6] = [
        ("a clock that comes late", &|recording, k| {
            20.0 * recording as f64 + 0.005 * k as f64 + 0.02 * small(1, k).abs()
        }),
        ("a clock that begins again", &|_, k| 0.005 * k as f64 + 0.05 * small(2, k)),
        ("a counter of 8 bits with noise", &|recording, k| {
            ((k + 50 * recording) % 256) as f64 + 5.0 * small(3, k)
        }),
        ("a counter of 32 with noise", &|_, k| (k % 32) as f64 + small(4, k)),
        ("seconds", &|recording, k| (40 * recording + k / 200) as f64),
        ("a clock that runs backwards", &|_, k| 100.0 - 0.005 * k as f64 + 0.001 * small(5, k)),
    ];
    for (name, column) in cases {
        for unit in [1.0, 1e-6, 1000.0] {
            let session = changed(|recording, k, row| [&[unit * column(recording, k)], row].concat());
            let faults = check(&session);
            assert_eq!(faults.len(), 1, "{name}, {unit}: {faults:?}");
            assert_eq!(
                (faults[0].status(), &kinds(&session)[0].1),
                (ChannelStatus::Red, &vec![0]),
                "{name}, {unit}: {faults:?}"
            );
        }
    }
    for (unit, share) in [(1.0, 0.01), (16_384.0, 0.02), (1e-4, 0.03)] {
        let session = changed(|recording, k, row| {
            let half = (0.2 * recording as f64 + 0.05 * (k as f64 / 90.0).sin()) / 2.0;
            let parts = [0.3 * half.sin(), 0.5 * half.sin(), 0.81 * half.sin(), half.cos()];
            let column = |c: usize| unit * (parts[c] + share * small(10 + c as u64, k));
            [row, &[0, 1, 2, 3].map(column)].concat()
        });
        assert_eq!(kinds(&session), [("orientation".to_owned(), vec![4, 5, 6, 7])], "{unit}, {share}");
    }
}

/// Some channels of a slower reader, and held rows with another last digit, made training and test alike.
#[test]
fn held_channels_and_interpolated_samples_are_found_with_another_last_digit() {
    let good = session(|_, v| v);
    let digit = |dither: bool, c: usize, k: usize| {
        if dither { uniform(c as u64 + 40, k as u64).clamp(-1.0, 1.0).round() } else { 0.0 }
    };
    let slow_in = |of: &'static [usize], held: usize, dither: bool| {
        changed(|recording, k, row| {
            let before = &good[recording].2[k - k % held].channels;
            let value = |c: usize| if of.contains(&c) { before[c] + digit(dither, c, k) } else { row[c] };
            (0..CHANNELS).map(value).collect()
        })
    };
    for (of, dither) in
        [(&[0, 2][..], false), (&[0, 2], true), (&[3], false), (&[3], true), (&[0, 1, 2, 3], true)]
    {
        for held in [2, 4] {
            assert_eq!(
                kinds(&slow_in(of, held, dither)),
                [("held_channels".to_owned(), of.to_vec())],
                "{of:?}, {held}, {dither}"
            );
        }
    }
    // A reader that is a quarter too fast.
    let fifth = changed(|recording, k, _| {
        let before = &good[recording].2[k - usize::from(k % 5 == 4)].channels;
        (0..CHANNELS).map(|c| before[c] + digit(true, c, k)).collect()
    });
    assert_eq!(kinds(&fifth), [("held_channels".to_owned(), vec![0, 1, 2, 3])]);
    for (of, dither) in [(&[0, 1, 2, 3][..], false), (&[0, 1, 2, 3], true), (&[1, 2], false)] {
        let between = changed(|recording, k, row| {
            let (from, to) = (k - k % 2, (k - k % 2 + 2).min(599));
            let value = |c: usize| {
                let samples = &good[recording].2;
                let line = samples[from].channels[c]
                    + (k - from) as f64 / 2.0 * (samples[to].channels[c] - samples[from].channels[c]);
                if of.contains(&c) { line.round() + digit(dither, c, k) } else { row[c] }
            };
            (0..CHANNELS).map(value).collect()
        });
        assert_eq!(kinds(&between), [("interpolated".to_owned(), of.to_vec())], "{of:?}, {dither}");
    }
}

/// A label in the data told the gesture at 100 %.
#[test]
fn a_column_that_tells_the_gesture_is_found_in_each_form() {
    let label = |recording: usize| 1.0 + 3.0 * (recording % 2) as f64;
    let some = |seed: u64, k: usize| noise(seed, k as u64);
    type Column<'a> = &'a dyn Fn(usize, usize, f64) -> f64;
    let cases: [(&str, &str, Column<'_>); 9] = [
        ("as it is", "label", &|recording, _, _| label(recording)),
        ("from the cue on", "label", &|recording, k, _| if k > 100 { label(recording) } else { 1.0 }),
        ("with glitches", "label", &|recording, k, _| if k % 200 == 7 { 9.0 } else { label(recording) }),
        ("with little noise", "slow", &|recording, k, _| {
            label(recording) + 0.1 * some(1 + recording as u64, k)
        }),
        ("in a range of it", "slow", &|recording, k, _| label(recording) + 0.25 * uniform(3, k as u64)),
        ("rounded noise around it", "label_within", &|recording, k, _| {
            (label(recording) + 1.7 * some(11 + recording as u64, k)).round()
        }),
        ("with noise of its size", "label_within", &|recording, k, _| {
            label(recording) + 2.0 * some(31 + recording as u64, k)
        }),
        ("negative, in another unit", "label_within", &|recording, k, _| {
            -1e-3 * (label(recording) + 2.0 * some(51 + recording as u64, k))
        }),
        ("added to an electrode", "label_within", &|recording, _, v| v + 8.0 * label(recording)),
    ];
    for (name, kind, column) in cases {
        let session = changed(|recording, k, row| [row, &[column(recording, k, row[0])]].concat());
        let faults = check(&session);
        assert_eq!(kinds(&session), [(kind.to_owned(), vec![CHANNELS])], "{name}: {faults:?}");
        assert_eq!(faults[0].status(), ChannelStatus::Red, "{name}");
    }
}
