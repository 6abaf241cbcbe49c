//! Configurations, the files of a trial directory, and bags. What is mutated are the files of a record made on the spot,
//! so that they always have the format of this program.

use super::{TargetFn, utf8_text};
use proact_app::{Arm, LimbReceiver, Recorder, ReplayOptions, bag_playback, replay_trial, trial};
use proact_devices::EmgOrigin;
use proact_recording::{
    InputRecord, MANIFEST_FILE, RecordingError, TrialHeader, TrialRecord, TrialWriter, read_result,
    write_manifest,
};
use proact_testbed::{Setup, SpanDigest, TrialConfig, TrialResult};
use proact_types::{MAX_TEXT_BYTES, SimTime, read_bytes};
use std::{
    fs::{self, File},
    net::UdpSocket,
    path::{Path, PathBuf},
};

/// Length of the record, seconds: some spans of digests and a decision or two.
const RECORD_SECS: f64 = 0.35;

fn short_config(seconds: f64) -> TrialConfig {
    let mut config = TrialConfig::new("A", 1, Setup::named("still").expect("ships"));
    config.limit_secs = seconds;
    config
}

/// Records a trial into `dir`.
fn record_trial(dir: &Path) {
    let assembly = trial::simulated_trial(short_config(RECORD_SECS), &EmgOrigin::Synthetic)
        .expect("the usual trial can be made");
    let (mut trial, classifier) = (assembly.trial, assembly.classifier);
    let config = trial.testbed().config().clone();
    let mut recorder = Recorder::create(dir, &config, &assembly.arm, classifier.as_ref())
        .expect("the scratch folder takes a record");
    loop {
        let step = trial.step(false).expect("the usual trial runs");
        recorder.write(&step, trial.testbed().plant().state()).expect("the disk takes it");
        if step.output.finished {
            break;
        }
    }
    recorder.finish(&trial.result()).expect("the disk takes it");
}

/// A file of a record that has just been made.
fn recorded_file(scratch: &Path, name: &str) -> Vec<Vec<u8>> {
    let dir = scratch.join("seed");
    if !dir.exists() {
        record_trial(&dir);
    }
    let file = File::open(dir.join(name)).expect("a record has this file");
    vec![read_bytes(file, MAX_TEXT_BYTES).expect("a short record is short")]
}

macro_rules! seeds {
    ($($name:ident: $file:literal,)*) => {
        $(pub(super) fn $name(scratch: &Path) -> Vec<Vec<u8>> {
            recorded_file(scratch, $file)
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
    manifest_seeds: "SHA256SUMS",
    bag_seeds: "trial.bag",
}

/// Everything that a record says, and the trial computed again.
fn read_record(dir: &Path) {
    if let Ok(record) = TrialRecord::open(dir) {
        let _ = record.events();
        let _ = record.digests::<SpanDigest>();
        if let Ok(inputs) = record.inputs() {
            inputs.take_while(Result::is_ok).for_each(drop);
        }
    }
    let _ = read_result::<TrialResult>(dir);
    let _ = replay_trial(dir, ReplayOptions { allow_other_versions: true, ..ReplayOptions::default() });
}

/// The input is the file `name` of a record whose trial was interrupted, so that no manifest stands before its readers.
fn mutate_record_file(scratch: &Path, name: &'static str) -> TargetFn {
    let dir = scratch.join("record");
    record_trial(&dir);
    fs::remove_file(dir.join(MANIFEST_FILE)).expect("a finished record has one");
    Box::new(move |bytes| {
        fs::write(dir.join(name), bytes).expect("the scratch folder takes files");
        read_record(&dir);
    })
}

pub(super) fn inputs_file(scratch: &Path) -> TargetFn {
    mutate_record_file(scratch, "inputs.log")
}

pub(super) fn digests_file(scratch: &Path) -> TargetFn {
    mutate_record_file(scratch, "digests.log")
}

pub(super) fn events_file(scratch: &Path) -> TargetFn {
    mutate_record_file(scratch, "events.jsonl")
}

/// The input is the result of a record whose manifest covers it.
pub(super) fn result_file(scratch: &Path) -> TargetFn {
    let dir = scratch.join("record");
    record_trial(&dir);
    Box::new(move |bytes| {
        fs::write(dir.join("result.json"), bytes).expect("the scratch folder takes files");
        write_manifest(&dir).expect("the disk takes it");
        read_record(&dir);
    })
}

pub(super) fn manifest_file(scratch: &Path) -> TargetFn {
    let dir = scratch.join("record");
    record_trial(&dir);
    Box::new(move |bytes| {
        fs::write(dir.join(MANIFEST_FILE), bytes).expect("the scratch folder takes files");
        read_record(&dir);
    })
}

/// The input is what a trial begins with, in a record that our own writer puts together around it: its hashes hold.
fn mutate_record_header(scratch: &Path, put: fn(&mut TrialHeader, &[u8])) -> TargetFn {
    let dir = scratch.join("record");
    record_trial(&dir);
    let whole = TrialRecord::open(&dir).expect("it was just made");
    let inputs: Result<Vec<InputRecord>, RecordingError> =
        whole.inputs().expect("it was just made").collect();
    let inputs = inputs.expect("it is whole");
    let digests: Vec<SpanDigest> = whole.digests().expect("it is whole");
    let made = scratch.join("made");
    Box::new(move |bytes| {
        let _ = fs::remove_dir_all(&made);
        let mut header = whole.header().clone();
        put(&mut header, bytes);
        let mut writer = TrialWriter::create(&made, &header).expect("the scratch folder takes a record");
        let (mut inputs, mut digests) = (inputs.iter().peekable(), digests.iter().peekable());
        for tick in (1..=whole.end().0).map(SimTime) {
            let input = inputs.next_if(|record| record.tick == tick).map(|record| record.input.clone());
            writer.write_input(tick, &input.unwrap_or_default()).expect("the disk takes it");
            if let Some(digest) = digests.next_if(|digest| digest.tick == tick) {
                writer.write_digest(digest).expect("the disk takes it");
            }
        }
        // Without its end, so that the result stands before nothing.
        drop(writer);
        read_record(&made);
    })
}

pub(super) fn config_file(scratch: &Path) -> TargetFn {
    mutate_record_header(scratch, |header, bytes| {
        header.config_toml = String::from_utf8_lossy(bytes).into_owned()
    })
}

pub(super) fn classifier_file(scratch: &Path) -> TargetFn {
    mutate_record_header(scratch, |header, bytes| {
        drop(header.files.insert("classifier.json".to_owned(), bytes.to_vec()))
    })
}

pub(super) fn arm_file(scratch: &Path) -> TargetFn {
    mutate_record_header(scratch, |header, bytes| {
        drop(header.files.insert("arm.urdf".to_owned(), bytes.to_vec()))
    })
}

/// Makes the lines of `digests.log` whole again: the CRC-32 before each.
pub(super) fn repair_digests(bytes: &mut [u8]) {
    for line in bytes.split_mut(|byte| *byte == b'\n') {
        if let Some((sum, text)) = line.split_at_mut_checked(9) {
            sum.copy_from_slice(format!("{:08x} ", crc32fast::hash(text)).as_bytes());
        }
    }
}

/// Makes the frames of `inputs.log` whole again: length, its complement and CRC-32 around each payload.
pub(super) fn repair_log(bytes: &mut [u8]) {
    const HEAD: usize = 12;
    let mut at = HEAD;
    while at + 12 <= bytes.len() {
        let announced = u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
        let max_length = bytes.len() - at - 12;
        let length = usize::try_from(announced).unwrap_or(max_length).min(max_length);
        let number = u32::try_from(length).unwrap_or_default();
        bytes[at..at + 4].copy_from_slice(&number.to_le_bytes());
        bytes[at + 4..at + 8].copy_from_slice(&(!number).to_le_bytes());
        let end = at + 8 + length;
        let checksum = crc32fast::hash(&bytes[at + 8..end]);
        bytes[end..end + 4].copy_from_slice(&checksum.to_le_bytes());
        at = end + 4;
    }
}

pub(super) fn config(_: &Path) -> TargetFn {
    Box::new(|bytes| {
        let Some(Ok(config)) = utf8_text(bytes).map(TrialConfig::from_toml) else { return };
        let written = config.to_toml().expect("a configuration that was read can be written");
        assert_eq!(TrialConfig::from_toml(&written).as_ref(), Ok(&config), "and means the same");
    })
}

pub(super) fn values(_: &Path) -> TargetFn {
    let base = short_config(300.0);
    Box::new(move |bytes| {
        let Some(text) = utf8_text(bytes) else { return };
        let lines: Vec<&str> = text.lines().collect();
        if let Ok(config) = base.with_overrides(&lines) {
            config.to_toml().expect("a configuration that was read can be written");
        }
    })
}

pub(super) fn bag(scratch: &Path) -> TargetFn {
    let path: PathBuf = scratch.join("x.bag");
    let arm = Arm::load(TrialConfig::DEFAULT_ARM).expect("ships with the program");
    Box::new(move |bytes| {
        fs::write(&path, bytes).expect("the scratch folder takes files");
        let _ = bag_playback::read_playback(&path, &arm);
    })
}

/// Sent as it would be, to a trial that follows a limb.
pub(super) fn udp_limb(_: &Path) -> TargetFn {
    let config = short_config(RECORD_SECS)
        .with_overrides(&["profile.level=below_elbow"])
        .expect("a level that there is");
    let mut trial = trial::live_trial(config).expect("the usual trial can be made").trial;
    let mut receiver = LimbReceiver::bind(0).expect("there is a free port");
    let sender = UdpSocket::bind("127.0.0.1:0").expect("there is another");
    sender.connect(receiver.address().expect("it is bound")).expect("it is there");
    Box::new(move |bytes| {
        // Longer ones than a datagram do not leave this machine.
        if sender.send(bytes).is_ok() {
            let _ = receiver.apply_to(&mut trial);
        }
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
        repair_log(&mut log);
        assert_eq!(log, whole, "what is whole stays");
        // Into the payload of the second record, and its checksum besides.
        let first = 12 + 12 + u32::from_le_bytes([whole[12], whole[13], whole[14], whole[15]]) as usize;
        log[first + 9] ^= 1;
        repair_log(&mut log);
        let dir = scratch.path().join("seed");
        fs::remove_file(dir.join(MANIFEST_FILE)).expect("a finished record has one");
        fs::write(dir.join("inputs.log"), &log).expect("writes");
        let error = TrialRecord::open(&dir).err().map(|error| error.to_string());
        assert!(!error.as_ref().is_some_and(|error| error.contains("checksum")), "{error:?}");
        // A digest of another number, too.
        let mut digests = digests_seeds(scratch.path()).remove(0);
        let at = digests.windows(7).position(|w| w == b"\"chain\"").expect("a digest has a chain") + 10;
        digests[at] ^= 1;
        repair_digests(&mut digests);
        fs::write(dir.join("digests.log"), &digests).expect("writes");
        let error = TrialRecord::open(&dir).err().map(|error| error.to_string());
        assert!(!error.as_ref().is_some_and(|error| error.contains("checksum")), "{error:?}");
    }
}
