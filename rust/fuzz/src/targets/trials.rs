//! Configurations, the files of a trial directory, and bags. What is mutated are the files of a record made on the spot,
//! so that they always have the format of this program.

use super::{Run, text};
use proact_app::{Recorder, ReplayOptions, film_of_bag, replay_trial, trial};
use proact_description::mpl_right_arm;
use proact_devices::EmgOrigin;
use proact_recording::{InputRecord, RecordingError, Trial, TrialHeader, TrialWriter, read_result};
use proact_testbed::{MethodName, Setup, SpanDigest, TrialConfig, TrialResult};
use proact_types::{MOST_TEXT_BYTES, SimTime, read_bytes};
use std::{
    fs::{self, File},
    path::{Path, PathBuf},
};

/// Length of the record, seconds: some spans of digests and a decision or two.
const RECORD_SECS: f64 = 0.35;

fn usual(seconds: f64) -> TrialConfig {
    let mut config = TrialConfig::new(MethodName::A, 1, Setup::named("still").expect("ships"));
    config.limit_secs = seconds;
    config
}

/// Records a trial into `dir`.
fn record(dir: &Path) {
    let assembly =
        trial::simulated(usual(RECORD_SECS), &EmgOrigin::Synthetic).expect("the usual trial can be made");
    let (mut session, classifier) = (assembly.session, assembly.classifier);
    let config = session.testbed().config().clone();
    let mut recorder = Recorder::create(dir, &config, &assembly.arm, classifier.as_ref())
        .expect("the scratch folder takes a record");
    loop {
        let step = session.step(false).expect("the usual trial runs");
        recorder.write(&step, session.testbed().plant().state()).expect("the disk takes it");
        if step.output.finished {
            break;
        }
    }
    recorder.finish(&session.result()).expect("the disk takes it");
}

/// A file of a record that has just been made.
fn recorded(scratch: &Path, name: &str) -> Vec<Vec<u8>> {
    let dir = scratch.join("seed");
    if !dir.exists() {
        record(&dir);
    }
    let file = File::open(dir.join(name)).expect("a record has this file");
    vec![read_bytes(file, MOST_TEXT_BYTES).expect("a short record is short")]
}

macro_rules! seeds {
    ($($name:ident: $file:literal,)*) => {
        $(pub(super) fn $name(scratch: &Path) -> Vec<Vec<u8>> {
            recorded(scratch, $file)
        })*
    };
}

seeds! {
    config_seeds: "config.toml",
    inputs_seeds: "inputs.log",
    digests_seeds: "digests.log",
    events_seeds: "events.jsonl",
    result_seeds: "result.json",
    classifier_seeds: "classifier.json",
    bag_seeds: "trial.bag",
}

/// Everything that a record says, and the trial computed again.
fn read_all(dir: &Path) {
    if let Ok(record) = Trial::open(dir) {
        let _ = record.events();
        let _ = record.digests::<SpanDigest>();
        if let Ok(inputs) = record.inputs() {
            inputs.take_while(Result::is_ok).for_each(drop);
        }
    }
    let _ = read_result::<TrialResult>(dir);
    let _ = replay_trial(dir, ReplayOptions { replan: false, other_versions: true });
}

/// The input is the file `name` of a record that is whole otherwise.
fn file_of_record(scratch: &Path, name: &'static str) -> Run {
    let dir = scratch.join("record");
    record(&dir);
    Box::new(move |bytes| {
        fs::write(dir.join(name), bytes).expect("the scratch folder takes files");
        read_all(&dir);
    })
}

pub(super) fn inputs_file(scratch: &Path) -> Run {
    file_of_record(scratch, "inputs.log")
}

pub(super) fn digests_file(scratch: &Path) -> Run {
    file_of_record(scratch, "digests.log")
}

pub(super) fn events_file(scratch: &Path) -> Run {
    file_of_record(scratch, "events.jsonl")
}

pub(super) fn result_file(scratch: &Path) -> Run {
    file_of_record(scratch, "result.json")
}

pub(super) fn classifier_file(scratch: &Path) -> Run {
    file_of_record(scratch, "classifier.json")
}

pub(super) fn arm_file(scratch: &Path) -> Run {
    file_of_record(scratch, "arm.urdf")
}

/// The input is the configuration of a record that our own writer puts together around it: its checksums hold.
pub(super) fn config_file(scratch: &Path) -> Run {
    let dir = scratch.join("record");
    record(&dir);
    let whole = Trial::open(&dir).expect("it was just made");
    let inputs: Result<Vec<InputRecord>, RecordingError> =
        whole.inputs().expect("it was just made").collect();
    let (inputs, digests) =
        (inputs.expect("it is whole"), whole.digests::<SpanDigest>().expect("it is whole"));
    let classifier = fs::read(dir.join("classifier.json")).expect("it is there");
    let made = scratch.join("made");
    Box::new(move |bytes| {
        let Some(text) = text(bytes) else { return };
        let _ = fs::remove_dir_all(&made);
        let header = TrialHeader { config_toml: text.to_owned(), seed: 1, ..TrialHeader::default() };
        let mut writer = TrialWriter::create(&made, &header).expect("the scratch folder takes a record");
        for input in &inputs {
            writer.write_input(input.tick, &input.input).expect("the disk takes it");
        }
        for digest in &digests {
            writer.write_digest(digest).expect("the disk takes it");
        }
        fs::write(made.join("classifier.json"), &classifier).expect("the disk takes it");
        writer.finish(SimTime::from_secs(RECORD_SECS), &0).expect("the disk takes it");
        read_all(&made);
    })
}

/// Makes the frames of `inputs.log` whole again: length, its complement and CRC-32 around each payload.
pub(super) fn mend_log(bytes: &mut [u8]) {
    const HEAD: usize = 12;
    let mut at = HEAD;
    while at + 12 <= bytes.len() {
        let announced = u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
        let room = bytes.len() - at - 12;
        let length = usize::try_from(announced).unwrap_or(room).min(room);
        let number = u32::try_from(length).unwrap_or_default();
        bytes[at..at + 4].copy_from_slice(&number.to_le_bytes());
        bytes[at + 4..at + 8].copy_from_slice(&(!number).to_le_bytes());
        let end = at + 8 + length;
        let checksum = crc32fast::hash(&bytes[at + 8..end]);
        bytes[end..end + 4].copy_from_slice(&checksum.to_le_bytes());
        at = end + 4;
    }
}

pub(super) fn config(_: &Path) -> Run {
    Box::new(|bytes| {
        let Some(Ok(config)) = text(bytes).map(TrialConfig::from_toml) else { return };
        let written = config.to_toml().expect("a configuration that was read can be written");
        assert_eq!(TrialConfig::from_toml(&written).as_ref(), Ok(&config), "and means the same");
    })
}

pub(super) fn values(_: &Path) -> Run {
    let base = usual(300.0);
    Box::new(move |bytes| {
        let Some(text) = text(bytes) else { return };
        let lines: Vec<&str> = text.lines().collect();
        if let Ok(config) = base.with_values(&lines) {
            config.to_toml().expect("a configuration that was read can be written");
        }
    })
}

pub(super) fn bag(scratch: &Path) -> Run {
    let (path, arm): (PathBuf, _) = (scratch.join("x.bag"), mpl_right_arm());
    Box::new(move |bytes| {
        fs::write(&path, bytes).expect("the scratch folder takes files");
        let _ = film_of_bag::read(&path, &arm);
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mutated_input_log_is_mended_so_far_that_its_records_are_read() {
        let scratch = tempfile::tempdir().expect("a folder");
        let mut log = inputs_seeds(scratch.path()).remove(0);
        let whole = log.clone();
        mend_log(&mut log);
        assert_eq!(log, whole, "what is whole stays");
        // Into the payload of the second record, and its checksum besides.
        let first = 12 + 12 + u32::from_le_bytes([whole[12], whole[13], whole[14], whole[15]]) as usize;
        log[first + 9] ^= 1;
        mend_log(&mut log);
        let dir = scratch.path().join("seed");
        fs::write(dir.join("inputs.log"), &log).expect("writes");
        let read: Vec<_> = Trial::open(&dir).expect("opens").inputs().expect("opens").collect();
        let error = read.first().and_then(|record| record.as_ref().err()).map(ToString::to_string);
        assert!(
            !error.is_some_and(|error| error.contains("checksum") || error.contains("CRC")),
            "{:?}",
            read.first()
        );
    }
}
