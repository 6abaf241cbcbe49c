//! Records of trials that were broken off, and finished ones whose files are no longer what was written.
#![allow(clippy::unwrap_used, clippy::disallowed_methods)]

mod common;

use common::{Digest, digest, event, header, input, write_trial};
use proact_recording::{
    CONFIG_FILE, DIGESTS_FILE, EVENTS_FILE, INPUTS_FILE, MANIFEST_FILE, RESULT_FILE, RecordingError,
    TrialHeader, TrialRecord, TrialWriter, write_manifest,
};
use proact_types::SimTime;
use std::{fs, path::Path, process::Command};

/// Ticks of a trial here; one that is broken off is so in the middle of a span.
const TICKS: u64 = 1050;

/// A trial whose process was killed: nothing was closed, and what was in memory is gone.
fn write_killed(dir: &Path) {
    let mut trial = TrialWriter::create(dir, &header()).unwrap();
    for tick in 1..=TICKS {
        trial.write_input(SimTime(tick), &input(tick)).unwrap();
        if tick % 100 == 0 {
            trial.write_event(&event(tick)).unwrap();
            trial.write_digest(&digest(tick)).unwrap();
        }
    }
    std::mem::forget(trial);
}

/// What is read of a trial: its last tick, inputs, digests and events.
fn read(dir: &Path) -> Result<(u64, usize, usize, usize), RecordingError> {
    let trial = TrialRecord::open(dir)?;
    let inputs: Vec<_> = trial.inputs()?.collect::<Result<_, _>>()?;
    for record in &inputs {
        assert_eq!(record.input, input(record.tick.0));
        assert!(record.tick <= trial.end());
    }
    let digests: Vec<Digest> = trial.digests()?;
    assert_eq!(digests, (1..=digests.len() as u64).map(|k| digest(100 * k)).collect::<Vec<_>>());
    let events = trial.events()?;
    assert!(events.iter().all(|event| event.time <= trial.end()));
    Ok((trial.end().0, inputs.len(), digests.len(), events.len()))
}

/// What there is to read of the killed trial up to `span`.
fn up_to(span: u64) -> (u64, usize, usize, usize) {
    let ticks = 100 * span;
    (ticks, (ticks - ticks / 3) as usize, span as usize, span as usize)
}

#[test]
fn a_killed_trial_is_read_up_to_its_last_digest_whatever_lies_behind() {
    let temp_dir = tempfile::tempdir().unwrap();
    let dir = temp_dir.path().join("trial");
    write_killed(&dir);
    assert!(!TrialRecord::open(&dir).unwrap().is_finished());
    assert_eq!(read(&dir).unwrap(), up_to(10));
    assert!(matches!(
        proact_recording::read_result::<serde_json::Value>(&dir),
        Err(RecordingError::Unfinished { .. })
    ));

    // What a loss of power leaves behind a file's end: blocks that were never written.
    for name in [INPUTS_FILE, DIGESTS_FILE, EVENTS_FILE] {
        let path = dir.join(name);
        let good = fs::read(&path).unwrap();
        for tail in [vec![0; 4096], b"{".to_vec()] {
            fs::write(&path, [good.as_slice(), &tail].concat()).unwrap();
            let got = read(&dir);
            // A line of digests is whole or not there; zeros with a line's end were put there by somebody.
            assert_eq!(got.unwrap(), up_to(10), "{name}");
        }
        fs::write(&path, good).unwrap();
    }
}

#[test]
fn a_killed_trial_whose_files_are_cut_anywhere_is_read_up_to_what_all_of_them_hold() {
    let temp_dir = tempfile::tempdir().unwrap();
    let dir = temp_dir.path().join("trial");
    write_killed(&dir);
    for name in [INPUTS_FILE, DIGESTS_FILE, EVENTS_FILE] {
        let path = dir.join(name);
        let good = fs::read(&path).unwrap();
        let head = if name == INPUTS_FILE { 12 + 12 + header_bytes(&good) } else { 0 };
        let (mut seen, mut last) = (0, 0);
        for k in 0..=1000 {
            let cut = head + (good.len() - head) * k / 1000;
            fs::write(&path, &good[..cut]).unwrap();
            let got = read(&dir).unwrap_or_else(|e| panic!("{name} cut at {cut}: {e}"));
            assert_eq!(got, up_to(got.2 as u64), "{name} cut at {cut}");
            assert!(got.0 >= last, "{name} cut at {cut}: more of the file must not give less of the trial");
            seen += u64::from(got.0 > last);
            last = got.0;
        }
        assert_eq!((last, seen), (1000, 10), "{name}: every span is lost and found once");
        // A log that ends in its head is none.
        for cut in [0, 5, head / 2] {
            if cut < head {
                fs::write(&path, &good[..cut]).unwrap();
                assert!(matches!(TrialRecord::open(&dir), Err(RecordingError::Truncated { records: 0, .. })));
            }
        }
        fs::write(&path, good).unwrap();
    }
}

/// Length of the header's payload in an input log.
fn header_bytes(log: &[u8]) -> usize {
    u32::from_le_bytes(log[12..16].try_into().unwrap()) as usize
}

#[test]
fn a_trial_that_was_killed_while_its_directory_was_made_has_no_length_and_is_no_error() {
    let temp_dir = tempfile::tempdir().unwrap();
    let dir = temp_dir.path().join("trial");
    std::mem::forget(TrialWriter::create(&dir, &header()).unwrap());
    assert_eq!(read(&dir).unwrap(), (0, 0, 0, 0));
    let log = fs::read(dir.join(INPUTS_FILE)).unwrap();
    for cut in [log.len() - 1, 20, 3, 0] {
        fs::write(dir.join(INPUTS_FILE), &log[..cut]).unwrap();
        assert_eq!(read(&dir).unwrap(), (0, 0, 0, 0), "cut at {cut}");
    }
    for name in [INPUTS_FILE, CONFIG_FILE, "classifier.json"] {
        fs::remove_file(dir.join(name)).unwrap();
        assert_eq!(read(&dir).unwrap(), (0, 0, 0, 0), "without {name}");
    }
    // A folder that never was one.
    fs::remove_file(dir.join(DIGESTS_FILE)).unwrap();
    assert!(matches!(TrialRecord::open(&dir), Err(RecordingError::NotATrial { missing: INPUTS_FILE, .. })));
}

#[test]
fn a_change_in_what_a_digest_vouches_for_is_refused_in_an_interrupted_trial_too() {
    let temp_dir = tempfile::tempdir().unwrap();
    let dir = temp_dir.path().join("trial");
    write_killed(&dir);
    for name in [INPUTS_FILE, DIGESTS_FILE] {
        let path = dir.join(name);
        let good = fs::read(&path).unwrap();
        let mut bad = good.clone();
        bad[good.len() / 2] ^= 0x10;
        fs::write(&path, bad).unwrap();
        assert!(matches!(TrialRecord::open(&dir), Err(RecordingError::Damaged { .. })), "{name}");
        fs::write(&path, good).unwrap();
    }
    // Lines of digests twice, or in another order.
    let path = dir.join(DIGESTS_FILE);
    let good = fs::read_to_string(&path).unwrap();
    let mut lines: Vec<&str> = good.split_inclusive('\n').collect();
    fs::write(&path, good.repeat(2)).unwrap();
    let error = TrialRecord::open(&dir).unwrap_err().to_string();
    assert!(error.contains("the digest of tick 100 stands after that of tick 1000"), "{error}");
    lines.swap(2, 3);
    fs::write(&path, lines.concat()).unwrap();
    assert!(matches!(TrialRecord::open(&dir), Err(RecordingError::Damaged { .. })));
    fs::write(&path, good).unwrap();

    for name in [CONFIG_FILE, "classifier.json"] {
        let path = dir.join(name);
        let good = fs::read(&path).unwrap();
        for bad in [b"".as_slice(), &good[1..]] {
            fs::write(&path, bad).unwrap();
            let error = TrialRecord::open(&dir).unwrap_err().to_string();
            assert!(
                error.contains(&format!("{name} is not the one that {INPUTS_FILE} was begun with")),
                "{error}"
            );
        }
        fs::remove_file(&path).unwrap();
        let error = TrialRecord::open(&dir).unwrap_err().to_string();
        assert!(error.contains(&format!("{name} is missing")), "{error}");
        fs::write(&path, good).unwrap();
    }
}

#[test]
fn a_finished_trial_is_refused_when_any_of_its_files_is_not_as_it_was() {
    let temp_dir = tempfile::tempdir().unwrap();
    let dir = temp_dir.path().join("trial");
    write_trial(&dir, 600);
    let trial = TrialRecord::open(&dir).unwrap();
    assert!(trial.is_finished());
    assert_eq!(trial.end(), SimTime(600));

    let mut names: Vec<String> = fs::read_dir(&dir)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .filter(|name| name != MANIFEST_FILE)
        .collect();
    names.sort();
    let expected = [RESULT_FILE, "classifier.json", CONFIG_FILE, DIGESTS_FILE, EVENTS_FILE, INPUTS_FILE]
        .map(str::to_owned);
    assert_eq!(names.len(), expected.len());
    for name in &names {
        let path = dir.join(name);
        let good = fs::read(&path).unwrap();
        let flipped = {
            let mut bytes = good.clone();
            let middle = bytes.len() / 2;
            bytes[middle] ^= 1;
            bytes
        };
        let lines: Vec<&[u8]> = good.split_inclusive(|byte| *byte == b'\n').collect();
        let reordered = lines.iter().rev().copied().collect::<Vec<_>>().concat();
        let fewer = lines[..lines.len() - 1].concat();
        for bad in [flipped, good[..good.len() / 2].to_vec(), good.repeat(2), reordered, fewer, Vec::new()] {
            if bad == good {
                continue;
            }
            fs::write(&path, &bad).unwrap();
            assert!(
                TrialRecord::open(&dir).is_err(),
                "{name} of {} instead of {} bytes",
                bad.len(),
                good.len()
            );
        }
        fs::remove_file(&path).unwrap();
        let error = TrialRecord::open(&dir).unwrap_err().to_string();
        assert!(error.contains(name.as_str()), "{error}");
        fs::write(&path, &good).unwrap();
        TrialRecord::open(&dir).unwrap();
    }
}

#[test]
fn an_input_log_of_another_trial_is_named_itself() {
    // Named were the files whose hashes the foreign log has, which were all as they had been written.
    let temp_dir = tempfile::tempdir().unwrap();
    let (dir, other) = (temp_dir.path().join("trial"), temp_dir.path().join("other"));
    write_trial(&dir, 600);
    let config_toml = "# another trial\nmethod = \"A\"\n".to_owned();
    TrialWriter::create(&other, &TrialHeader { config_toml, ..header() }).unwrap();
    fs::copy(other.join(INPUTS_FILE), dir.join(INPUTS_FILE)).unwrap();
    let error = TrialRecord::open(&dir).unwrap_err().to_string();
    assert!(error.contains("as it was recorded: inputs.log has changed; expected"), "{error}");
    // Without a manifest either file may be the foreign one, unless result and digests agree with the other.
    fs::remove_file(dir.join(MANIFEST_FILE)).unwrap();
    let error = TrialRecord::open(&dir).unwrap_err().to_string();
    assert!(error.contains("config.toml is not the one that inputs.log was begun with"), "{error}");
}

#[test]
fn an_input_log_of_another_trial_is_named_without_a_manifest_where_all_others_agree() {
    // Named was config.toml, which was as it had been written.
    let temp_dir = tempfile::tempdir().unwrap();
    let write = |name: &str, seed: u64, ticks: u64| {
        let dir = temp_dir.path().join(name);
        let config_toml = format!("seed = {seed}\n[setup]\nname = \"seated\"\n");
        let mut trial = TrialWriter::create(&dir, &TrialHeader { config_toml, seed, ..header() }).unwrap();
        (1..=ticks).for_each(|tick| trial.write_input(SimTime(tick), &input(tick)).unwrap());
        trial.write_digest(&serde_json::json!({"tick": ticks, "chain": name})).unwrap();
        trial.finish(SimTime(ticks), &serde_json::json!({"seed": seed, "digest": name})).unwrap();
        fs::remove_file(dir.join(MANIFEST_FILE)).unwrap();
        dir
    };
    let dir = write("trial", 1, 30);
    // Of another seed, and of the same seed and another length.
    for (name, seed, ticks) in [("of_another_seed", 2, 30), ("of_another_length", 1, 20)] {
        let other = write(name, seed, ticks);
        let own = fs::read(dir.join(INPUTS_FILE)).unwrap();
        fs::write(dir.join(CONFIG_FILE), "seed = 1\n# the same, and not the text that the log knows\n")
            .unwrap();
        fs::copy(other.join(INPUTS_FILE), dir.join(INPUTS_FILE)).unwrap();
        let error = TrialRecord::open(&dir).unwrap_err().to_string();
        assert!(error.contains("inputs.log is of another trial than config.toml, digests.log"), "{error}");
        fs::write(dir.join(INPUTS_FILE), own).unwrap();
        // An edited configuration is named itself.
        let error = TrialRecord::open(&dir).unwrap_err().to_string();
        assert!(error.contains("config.toml is not the one that inputs.log was begun with"), "{error}");
    }
}

#[test]
fn a_manifest_that_was_made_anew_over_a_shortened_log_is_refused_all_the_same() {
    let temp_dir = tempfile::tempdir().unwrap();
    let dir = temp_dir.path().join("trial");
    write_trial(&dir, 600);
    let path = dir.join(DIGESTS_FILE);
    let good = fs::read_to_string(&path).unwrap();
    let head: String = good.split_inclusive('\n').take(3).collect();
    fs::write(&path, head).unwrap();
    write_manifest(&dir).unwrap();
    let error = TrialRecord::open(&dir).unwrap_err().to_string();
    assert!(error.contains("ends at tick 600") && error.contains("at tick 300"), "{error}");

    // A manifest that leaves a file out, or is none.
    fs::write(&path, good).unwrap();
    write_manifest(&dir).unwrap();
    let manifest = fs::read_to_string(dir.join(MANIFEST_FILE)).unwrap();
    let without: String = manifest.split_inclusive('\n').filter(|line| !line.contains(EVENTS_FILE)).collect();
    fs::write(dir.join(MANIFEST_FILE), without).unwrap();
    let error = TrialRecord::open(&dir).unwrap_err().to_string();
    assert!(error.contains("events.jsonl is not in SHA256SUMS"), "{error}");
    // Without it the trial counts as interrupted, and its logs must be whole all the same: there is a result.
    fs::remove_file(dir.join(MANIFEST_FILE)).unwrap();
    assert_eq!(
        TrialRecord::open(&dir).map(|trial| (trial.is_finished(), trial.end())).unwrap(),
        (false, SimTime(600))
    );
    let lines = fs::read_to_string(&path).unwrap();
    fs::write(&path, lines.split_inclusive('\n').take(3).collect::<String>()).unwrap();
    assert!(matches!(TrialRecord::open(&dir), Err(RecordingError::Changed { .. })));
    fs::write(&path, lines).unwrap();

    let doubled = manifest.repeat(2);
    let reversed: String = manifest.split_inclusive('\n').rev().collect();
    for none in [
        &doubled,
        &reversed,
        "",
        "0\n",
        &manifest[1..],
        &manifest.replace("  ", " "),
        &manifest.replace("  ", "  ../"),
    ] {
        fs::write(dir.join(MANIFEST_FILE), none).unwrap();
        assert!(TrialRecord::open(&dir).is_err(), "{none:?}");
    }
    fs::write(dir.join(MANIFEST_FILE), manifest).unwrap();
    // What a lab puts beside the record is its own matter.
    fs::write(dir.join("notes.txt"), "the participant sneezed").unwrap();
    assert!(TrialRecord::open(&dir).unwrap().is_finished());
}

#[test]
fn sha256sum_checks_the_manifest_too() {
    let temp_dir = tempfile::tempdir().unwrap();
    let dir = temp_dir.path().join("trial");
    write_trial(&dir, 300);
    let run = || {
        Command::new("sha256sum").args(["-c", "--strict", MANIFEST_FILE]).current_dir(&dir).output().unwrap()
    };
    let output = run();
    assert!(output.status.success(), "{output:?}");
    assert_eq!(String::from_utf8_lossy(&output.stdout).lines().count(), 6);
    fs::write(dir.join(EVENTS_FILE), "").unwrap();
    assert!(!run().status.success());
}
