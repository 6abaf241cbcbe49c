//! The records in `tests/records`: each replays with its digests, whatever was added to the program since it was recorded.
#![allow(clippy::disallowed_methods)] // A test of files.

use proact_app::{
    Arm, Registry, ReplayOptions,
    digests::{DigestStore, Platform},
    recompute_record, replay_trial, trial,
};
use proact_recording::{RECORD_FORMAT, TrialRecord, TrialWriter, read_result};
use proact_testbed::{SpanDigest, Testbed, TrialConfig};
use std::{
    error::Error,
    fs,
    io::Write,
    path::{Path, PathBuf},
};

type Outcome<T = ()> = Result<T, Box<dyn Error>>;

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn records() -> Outcome<Vec<PathBuf>> {
    let mut found = Vec::new();
    for entry in fs::read_dir(repository().join("tests/records"))? {
        found.extend(Some(entry?.path()).filter(|path| path.is_dir()));
    }
    found.sort();
    Ok(found)
}

fn options(other_versions: bool) -> ReplayOptions {
    ReplayOptions {
        methods: Registry::standard().methods,
        allow_other_versions: other_versions,
        ..ReplayOptions::default()
    }
}

// Catches a change after which records of before do not replay although the format of records is the same.
#[test]
fn every_stored_record_replays() -> Outcome {
    let records = records()?;
    assert_eq!(records.len(), 12, "{records:?}");
    let platform = Platform::current();
    let same = DigestStore::in_repository(&repository()).digests(&platform)?.is_some();
    if !same {
        let _ = writeln!(
            std::io::stderr(),
            "records: digests are skipped, since no file of tests/digests is of the platform {platform}; results are compared"
        );
    }
    let mut finished = 0;
    for dir in records {
        let named = |error: Box<dyn Error>| format!("{}: {error}", dir.display());
        if same {
            let replayed = replay_trial(&dir, options(false)).map_err(named)?;
            assert!(replayed.agrees, "{}: {replayed:?}", dir.display());
            assert!(replayed.spans > 2 && replayed.format == RECORD_FORMAT, "{replayed:?}");
            finished += usize::from(replayed.finished);
        } else {
            let mut score = 0.0;
            let seen = |testbed: &Testbed, _: &_| score = f64::from(testbed.task().state().score);
            let retraced = recompute_record(&dir, &options(true), seen).map_err(named)?;
            if let Some(result) = &retraced.result {
                assert_eq!(score, result.score, "{}", dir.display());
                finished += 1;
            }
        }
    }
    assert_eq!(finished, 11, "one was interrupted");
    Ok(())
}

// Catches a digest of the text that today's types write: a key that came later, with a default, is in that text.
#[test]
fn a_record_without_a_key_that_came_later_replays_by_the_text_that_was_recorded() -> Outcome {
    let temp_dir = tempfile::tempdir()?;
    let original = TrialRecord::open(&stored())?;
    let text = original.header().config_toml.replace("intent_model = \"product\"\n", "");
    let config = TrialConfig::from_toml(&text)?;
    assert_ne!(config.to_toml()?, text, "the key is written today");
    let arm = Arm::from_record(original.dir(), &config)?;
    let mut testbed =
        trial::replay_testbed(&Registry::standard().methods, &arm, config, None)?.with_recorded_config(&text);
    let mut spans: Vec<SpanDigest> = Vec::new();
    for tick in original.ticks()? {
        let (time, input) = tick?;
        spans.extend(testbed.tick(&input, time == original.end())?.span_digest);
    }
    let dir = temp_dir.path().join("earlier");
    rewrite(&original, &dir, &text, &spans)?;
    let replayed = replay_trial(&dir, options(true))?;
    assert!(replayed.agrees, "{replayed:?}");
    assert_eq!(replayed.recorded_by, "proact 9.9.9 at commit 0123456789ab");
    Ok(())
}

#[test]
fn a_key_that_is_unknown_is_refused_with_its_name_and_the_program_that_wrote_it() -> Outcome {
    let temp_dir = tempfile::tempdir()?;
    let dir = temp_dir.path().join("unknown");
    let original = TrialRecord::open(&stored())?;
    let text = format!("later_key = 1\n{}", original.header().config_toml);
    rewrite(&original, &dir, &text, &original.digests()?)?;
    let error = replay_trial(&dir, options(true)).expect_err("an unknown key").to_string();
    for part in ["later_key", "proact 9.9.9 at commit 0123456789ab wrote it"] {
        assert!(error.contains(part), "{error}");
    }
    Ok(())
}

fn stored() -> PathBuf {
    repository().join("tests/records/keys_a_bbt")
}

/// A record as another program could have written it: with another text of the configuration, and these digests.
fn rewrite(original: &TrialRecord, to: &Path, text: &str, spans: &[SpanDigest]) -> Outcome {
    let mut header = original.header().clone();
    header.config_toml = text.to_owned();
    header.commit = "0123456789ab".to_owned();
    header.versions.insert("proact".to_owned(), "9.9.9".to_owned());
    let mut writer = TrialWriter::create(to, &header)?;
    let events = original.events()?;
    for tick in original.ticks()? {
        let (time, input) = tick?;
        writer.write_input(time, &input)?;
        events.iter().filter(|event| event.time == time).try_for_each(|event| writer.write_event(event))?;
        spans.iter().filter(|span| span.tick == time).try_for_each(|span| writer.write_digest(span))?;
    }
    let mut result: serde_json::Value = read_result(original.dir())?;
    result["digest"] = spans.last().map(|span| span.chain_hash.as_str()).into();
    writer.finish(original.end(), &result)?;
    Ok(())
}

// Catches a format whose records can no longer be read for their scores, or a refusal that names no program.
#[test]
fn a_record_of_an_earlier_format_is_read_and_its_replay_names_the_program_that_computes_it() -> Outcome {
    let dir = repository().join("tests/records_earlier/format_7");
    let record = TrialRecord::open(&dir)?;
    assert!(record.format() == 7 && record.is_finished() && !record.events()?.is_empty());
    let refusal = replay_trial(&dir, options(true)).map(|_| ()).expect_err("another format").to_string();
    assert!(refusal.contains("format 7") && refusal.contains("ca6e481"), "{refusal}");
    Ok(())
}
