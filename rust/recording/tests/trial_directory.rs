//! Trial directories: round trips to the bit, damage, truncation, places that cannot be written.
#![allow(clippy::unwrap_used, clippy::disallowed_methods)]

mod common;

use common::{Digest, digest, event, header, input, write_trial};
use proact_recording::{
    FLUSH_TICKS, INPUTS_FILE, InputLog, InputRecord, LogEnd, RECORD_FORMAT, RESULT_FILE, RecordingError,
    TrialRecord, TrialWriter, read_result,
};
use proact_types::{
    EmgSample, Event, EventKind, ExternalAnswer, ObjectId, Pose, SimTime, TickInput, Vector, WindowAnswer,
};
use std::{fs, path::Path};

fn read_inputs(dir: &Path) -> (Vec<InputRecord>, Result<Option<LogEnd>, RecordingError>) {
    let mut log = InputLog::open(dir).unwrap();
    let mut records = Vec::new();
    for item in &mut log {
        match item {
            Ok(record) => records.push(record),
            Err(error) => return (records, Err(error)),
        }
    }
    (records, Ok(log.end()))
}

#[test]
fn a_trial_reads_back_as_it_was_written() {
    let temp_dir = tempfile::tempdir().unwrap();
    let dir = temp_dir.path().join("made/on/the/way");
    write_trial(&dir, 600);

    let trial = TrialRecord::open(&dir).unwrap();
    assert_eq!(*trial.header(), header());
    assert_eq!(trial.header().writer(), "proact 0.1.0 at commit 0123456789ab");
    let (records, end) = read_inputs(&dir);
    let expected: Vec<_> = (1..=600).map(|t| (t, input(t))).filter(|(t, _)| t % 3 != 0).collect();
    let got: Vec<_> = records.into_iter().map(|r| (r.tick.0, r.input)).collect();
    assert_eq!(got, expected);
    assert_eq!(end.unwrap(), Some(LogEnd { time: SimTime(600), records: 400 }));
    let spans: Vec<u64> = (1..=6).map(|k| 100 * k).collect();
    assert_eq!(trial.digests::<Digest>().unwrap(), spans.iter().map(|t| digest(*t)).collect::<Vec<_>>());
    assert_eq!(trial.events().unwrap(), spans.iter().map(|t| event(*t)).collect::<Vec<_>>());
    assert_eq!(read_result::<serde_json::Value>(&dir).unwrap()["on_target"], 3);
    assert!(!dir.join("result.json.tmp").exists());
}

#[test]
fn equal_trials_give_equal_files() {
    let temp_dir = tempfile::tempdir().unwrap();
    let (one, two) = (temp_dir.path().join("one"), temp_dir.path().join("two"));
    write_trial(&one, 300);
    write_trial(&two, 300);
    for entry in fs::read_dir(&one).unwrap() {
        let name = entry.unwrap().file_name();
        assert_eq!(fs::read(one.join(&name)).unwrap(), fs::read(two.join(&name)).unwrap(), "{name:?}");
    }
}

// Catches an answer that goes into the log and does not come out of it, in any combination.
#[test]
fn what_other_programs_answered_is_kept_beside_the_tick_it_belongs_to() {
    let temp_dir = tempfile::tempdir().unwrap();
    let dir = temp_dir.path().join("trial");
    let windows =
        [vec![], vec![WindowAnswer::Line("rest".to_owned()), WindowAnswer::TimedOut { deadline_ms: 50 }]];
    let intents = [
        None,
        Some(ExternalAnswer::Line("[1, 0]".to_owned())),
        Some(ExternalAnswer::Failed("it has ended".to_owned())),
        Some(ExternalAnswer::TimedOut("no answer within 50 ms".to_owned())),
    ];
    let reports = [None, Some(Ok(())), Some(Err("division by zero".to_owned()))];
    let mut given = Vec::new();
    for decoder in &windows {
        for intent in &intents {
            for participant in &reports {
                let (decoder, intent, participant) = (decoder.clone(), intent.clone(), participant.clone());
                let tick = input(1 + given.len() as u64 % 2);
                given.push(TickInput { decoder, intent, participant, ..tick });
            }
        }
    }
    let mut trial = TrialWriter::create(&dir, &header()).unwrap();
    for (tick, input) in given.iter().enumerate() {
        trial.write_input(SimTime(tick as u64 + 1), input).unwrap();
    }
    trial.finish(SimTime(given.len() as u64), &()).unwrap();
    let (records, end) = read_inputs(&dir);
    assert!(end.unwrap().is_some());
    assert_eq!(records.into_iter().map(|record| record.input).collect::<Vec<_>>(), given);
}

#[test]
fn every_bit_of_an_input_is_kept_nan_and_minus_zero_included() {
    let temp_dir = tempfile::tempdir().unwrap();
    let dir = temp_dir.path().join("trial");
    let odd = [f64::from_bits(0x7ff8_dead_beef_0001), -0.0, f64::MIN_POSITIVE / 3.0, f64::NEG_INFINITY];
    let mut given = TickInput::default();
    given.emg.push(EmgSample { counter: 9, channels: odd.into_iter().collect() });
    // A pose whose quaternion is not exactly of unit length must not be normalised on the way.
    let rotation = nalgebra::UnitQuaternion::new_unchecked(nalgebra::Quaternion::new(0.6, 0.1, 0.1, 0.8));
    given.shoulder = Some(Pose::from_parts(Vector::zeros().into(), rotation));
    let mut trial = TrialWriter::create(&dir, &header()).unwrap();
    trial.write_input(SimTime(1), &given).unwrap();
    trial.finish(SimTime(1), &()).unwrap();

    let read = InputLog::open(&dir).unwrap().next().unwrap().unwrap().input;
    let bits = |i: &TickInput| i.emg[0].channels.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
    assert_eq!(bits(&read), bits(&given));
    assert_eq!(read.shoulder, given.shoulder);
}

#[test]
fn a_flipped_byte_anywhere_is_reported_at_the_record_it_is_in() {
    let temp_dir = tempfile::tempdir().unwrap();
    let dir = temp_dir.path().join("trial");
    write_trial(&dir, 9);
    let file = dir.join(INPUTS_FILE);
    let good = fs::read(&file).unwrap();
    let (records, _) = read_inputs(&dir);
    let mut starts: Vec<u64> = records.iter().map(|r| r.offset).collect();
    // The end mark is a record too: it starts where the last input's record ends.
    let last = *starts.last().unwrap() as usize;
    let length = u32::from_le_bytes(good[last..last + 4].try_into().unwrap()) as u64;
    starts.push(last as u64 + length + 12);

    for at in starts[0] as usize..good.len() {
        let mut bad = good.clone();
        bad[at] ^= 0x10;
        fs::write(&file, &bad).unwrap();
        let index = starts.iter().rposition(|s| *s <= at as u64).unwrap();
        let (read, end) = read_inputs(&dir);
        assert_eq!(read, records[..index.min(records.len())], "byte {at}");
        match end {
            Err(RecordingError::Damaged { offset, .. }) => assert_eq!(offset, starts[index], "byte {at}"),
            other => panic!("byte {at}: {other:?}"),
        }
    }
}

#[test]
fn a_damaged_head_is_refused() {
    let temp_dir = tempfile::tempdir().unwrap();
    let dir = temp_dir.path().join("trial");
    write_trial(&dir, 3);
    let file = dir.join(INPUTS_FILE);
    let good = fs::read(&file).unwrap();
    let open_with = |at: usize| {
        let mut bad = good.clone();
        bad[at] ^= 1;
        fs::write(&file, &bad).unwrap();
        InputLog::open(&dir).unwrap_err()
    };
    assert!(matches!(open_with(0), RecordingError::Damaged { offset: 0, .. }));
    let other = RECORD_FORMAT ^ 1;
    assert!(
        matches!(open_with(8), RecordingError::WrongFormat { got, expected: RECORD_FORMAT, .. } if got == other)
    );
    assert!(matches!(open_with(30), RecordingError::Damaged { offset: 12, .. }));
    fs::write(&file, []).unwrap();
    assert!(matches!(InputLog::open(&dir), Err(RecordingError::Truncated { offset: 0, records: 0, .. })));
}

#[test]
fn a_log_cut_anywhere_is_read_up_to_the_cut() {
    let temp_dir = tempfile::tempdir().unwrap();
    let dir = temp_dir.path().join("trial");
    write_trial(&dir, 9);
    let file = dir.join(INPUTS_FILE);
    let good = fs::read(&file).unwrap();
    let (records, _) = read_inputs(&dir);
    for cut in records[0].offset as usize..good.len() {
        fs::write(&file, &good[..cut]).unwrap();
        let (read, end) = read_inputs(&dir);
        assert_eq!(read, records[..read.len()]);
        match end {
            Err(RecordingError::Truncated { offset, records: good_records, .. }) => {
                assert_eq!(good_records, read.len() as u64);
                assert!(offset <= cut as u64);
                let whole = records.iter().filter(|r| r.offset < offset).count();
                assert_eq!(whole, read.len(), "cut at {cut}");
            }
            other => panic!("cut at {cut}: {other:?}"),
        }
    }
}

#[test]
fn a_crash_loses_at_most_the_last_span_and_leaves_an_unfinished_trial() {
    let temp_dir = tempfile::tempdir().unwrap();
    let dir = temp_dir.path().join("trial");
    let mut trial = TrialWriter::create(&dir, &header()).unwrap();
    for tick in 1..=1050 {
        trial.write_input(SimTime(tick), &input(tick)).unwrap();
    }
    // A crash runs no destructor: what is in memory is gone.
    std::mem::forget(trial);
    let (read, end) = read_inputs(&dir);
    assert!(matches!(end, Err(RecordingError::Truncated { .. })));
    assert!(read.last().unwrap().tick.0 + FLUSH_TICKS >= 1050);
    let error = read_result::<serde_json::Value>(&dir).unwrap_err();
    assert!(matches!(error, RecordingError::Unfinished { .. }));
    assert!(error.to_string().contains("interrupted"), "{error}");
}

#[test]
fn a_damaged_result_is_reported_with_its_offset() {
    let temp_dir = tempfile::tempdir().unwrap();
    let dir = temp_dir.path().join("trial");
    write_trial(&dir, 3);
    fs::write(dir.join(RESULT_FILE), "{\n  \"on_target\": 3x\n}\n").unwrap();
    match read_result::<serde_json::Value>(&dir) {
        Err(RecordingError::Damaged { offset, .. }) => assert_eq!(offset, 18),
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_directory_with_something_in_it_is_refused_and_left_alone() {
    let temp_dir = tempfile::tempdir().unwrap();
    fs::write(temp_dir.path().join("thesis.tex"), "years of work").unwrap();
    let error = TrialWriter::create(temp_dir.path(), &header()).unwrap_err();
    assert!(matches!(error, RecordingError::OutputExists { .. }));
    let names: Vec<_> = fs::read_dir(temp_dir.path()).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert_eq!(names, ["thesis.tex"]);
}

#[test]
fn an_empty_directory_is_used() {
    let temp_dir = tempfile::tempdir().unwrap();
    TrialWriter::create(temp_dir.path(), &header()).unwrap();
    assert!(temp_dir.path().join(INPUTS_FILE).exists());
}

#[test]
fn a_place_that_cannot_be_written_is_an_error_before_anything_runs() {
    let temp_dir = tempfile::tempdir().unwrap();
    let file = temp_dir.path().join("file");
    fs::write(&file, "").unwrap();
    // Below a file, on a file, and in a file system that takes no directories, even from root.
    for dir in [file.join("trial"), file.clone(), "/proc/trial".into()] {
        let error = TrialWriter::create(&dir, &header()).unwrap_err();
        assert!(matches!(error, RecordingError::Io { .. }), "{error:?}");
        assert!(error.to_string().contains(&dir.display().to_string()), "{error}");
    }
    assert_eq!(fs::read_dir(temp_dir.path()).unwrap().count(), 1);
}

#[test]
fn an_event_that_json_cannot_hold_is_refused() {
    let temp_dir = tempfile::tempdir().unwrap();
    let mut trial = TrialWriter::create(&temp_dir.path().join("trial"), &header()).unwrap();
    let kind = EventKind::ObjectOnTarget { object: ObjectId(0), distance: f64::NAN };
    let error = trial.write_event(&Event { time: SimTime(250), kind }).unwrap_err();
    assert!(error.to_string().contains("NaN at 0.25 s"), "{error}");
}

#[test]
fn a_result_that_cannot_be_put_in_place_leaves_the_trial_unfinished() {
    let temp_dir = tempfile::tempdir().unwrap();
    let dir = temp_dir.path().join("trial");
    let trial = TrialWriter::create(&dir, &header()).unwrap();
    // Renaming onto a directory that is not empty fails, for root too.
    fs::create_dir_all(dir.join(RESULT_FILE).join("in_the_way")).unwrap();
    let error = trial.finish(SimTime(1), &3).unwrap_err();
    assert!(matches!(error, RecordingError::Io { .. }));
    assert!(!dir.join("result.json.tmp").exists());
}

#[test]
fn ticks_out_of_order_are_refused() {
    let temp_dir = tempfile::tempdir().unwrap();
    let mut trial = TrialWriter::create(&temp_dir.path().join("trial"), &header()).unwrap();
    trial.write_input(SimTime(5), &input(5)).unwrap();
    for tick in [5, 4] {
        let error = trial.write_input(SimTime(tick), &input(4)).unwrap_err();
        assert!(matches!(error, RecordingError::OutOfOrder { got, last: SimTime(5) } if got.0 == tick));
    }
}

#[test]
fn a_directory_that_is_no_trial_is_named() {
    let temp_dir = tempfile::tempdir().unwrap();
    assert!(matches!(TrialRecord::open(temp_dir.path()), Err(RecordingError::NotATrial { .. })));
    assert!(matches!(
        read_result::<serde_json::Value>(temp_dir.path()),
        Err(RecordingError::NotATrial { missing: "inputs.log", .. })
    ));
}
