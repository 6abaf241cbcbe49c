//! A trial that is recorded, exported and read again.
#![allow(clippy::disallowed_methods, clippy::unwrap_used)] // A test of files and processes.

use serde_json::Value;
use std::{collections::BTreeMap, fs, path::Path, process::Command};

fn proact(words: &[&str]) -> Result<String, String> {
    let output = Command::new(env!("CARGO_BIN_EXE_proact")).args(words).output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    if output.status.success() { Ok(text(output.stdout)) } else { Err(text(output.stderr)) }
}

/// What a reader that knows XDF's layout alone finds: for each stream its header, and its samples' times and bytes.
#[derive(Default)]
struct Found {
    header: String,
    footer: String,
    times: Vec<f64>,
    numbers: Vec<Vec<f64>>,
    words: Vec<Vec<String>>,
}

/// Takes so many bytes from the front.
fn take<'a>(bytes: &mut &'a [u8], count: usize) -> &'a [u8] {
    let (front, rest) = bytes.split_at(count);
    *bytes = rest;
    front
}

fn length(bytes: &mut &[u8]) -> usize {
    let width = usize::from(take(bytes, 1)[0]);
    assert!([1, 4, 8].contains(&width), "a length of {width} bytes");
    let mut value = [0; 8];
    value[..width].copy_from_slice(take(bytes, width));
    u64::from_le_bytes(value) as usize
}

fn number(bytes: &mut &[u8]) -> f64 {
    f64::from_le_bytes(take(bytes, 8).try_into().unwrap())
}

fn element<'a>(xml: &'a str, name: &str) -> &'a str {
    xml.split_once(&format!("<{name}>")).unwrap().1.split_once(&format!("</{name}>")).unwrap().0
}

/// The streams of a file by their names.
fn read(file: &Path) -> BTreeMap<String, Found> {
    let bytes = fs::read(file).unwrap();
    let mut rest = bytes.strip_prefix(b"XDF:").unwrap();
    let mut found: BTreeMap<u32, Found> = BTreeMap::new();
    while !rest.is_empty() {
        let size = length(&mut rest);
        let mut content = take(&mut rest, size);
        let tag = u16::from_le_bytes(take(&mut content, 2).try_into().unwrap());
        if tag == 1 {
            assert_eq!(element(std::str::from_utf8(content).unwrap(), "version"), "1.0");
            continue;
        }
        if tag == 5 {
            continue;
        }
        let stream = found.entry(u32::from_le_bytes(take(&mut content, 4).try_into().unwrap())).or_default();
        match tag {
            2 => stream.header = String::from_utf8(content.to_vec()).unwrap(),
            3 => {
                let channels: usize = element(&stream.header, "channel_count").parse().unwrap();
                let text = element(&stream.header, "channel_format") == "string";
                for _ in 0..length(&mut content) {
                    assert_eq!(take(&mut content, 1), [8], "each sample has its time");
                    stream.times.push(number(&mut content));
                    if text {
                        let mut word = || {
                            let size = length(&mut content);
                            String::from_utf8(take(&mut content, size).to_vec()).unwrap()
                        };
                        stream.words.push((0..channels).map(|_| word()).collect());
                    } else {
                        stream.numbers.push((0..channels).map(|_| number(&mut content)).collect());
                    }
                }
                assert!(content.is_empty());
            }
            4 => assert_eq!((number(&mut content) >= 0.0, number(&mut content)), (true, 0.0)),
            6 => stream.footer = String::from_utf8(content.to_vec()).unwrap(),
            other => panic!("a chunk of the kind {other}"),
        }
    }
    found.into_values().map(|stream| (element(&stream.header, "name").to_owned(), stream)).collect()
}

#[test]
fn an_exported_trial_has_what_was_recorded_at_its_times() {
    let temp_dir = tempfile::tempdir().unwrap();
    let trial = temp_dir.path().join("trial");
    let file = temp_dir.path().join("trial.xdf");
    let (trial, out) = (trial.to_str().unwrap(), file.to_str().unwrap());
    proact(&["demo", "--headless", "--seed", "1", "--time-limit", "12", "--out", trial]).unwrap();
    let stdout = proact(&["export", trial, "--xdf", out, "--json"]).unwrap();
    let report: Value = serde_json::from_str(&stdout).unwrap();
    assert_eq!((report["seconds"].as_f64(), report["finished"].as_bool()), (Some(12.0), Some(true)));

    let streams = read(&file);
    for reported in report["streams"].as_array().unwrap() {
        let name = reported["name"].as_str().unwrap();
        let stream = &streams[name];
        assert_eq!(reported["samples"], stream.times.len(), "{name}");
        assert_eq!(element(&stream.footer, "sample_count"), stream.times.len().to_string(), "{name}");
        assert_eq!(reported["channels"], stream.header.matches("<channel>").count(), "{name}");
        assert!(
            stream.times.is_sorted() && stream.times.iter().all(|time| (-0.1..=12.0).contains(time)),
            "{name}"
        );
        assert!(stream.numbers.iter().flatten().all(|value| value.is_finite()), "{name}");
    }
    assert_eq!(streams.len(), 7, "{:?}", streams.keys());
    // 12 s of joints at 100 Hz and of poses at 60 Hz; an armband's samples, whatever its rate is.
    assert_eq!(streams["Joints"].times.len(), 1200);
    assert_eq!((streams["Hand"].times.len(), streams["Shoulder"].times.len()), (720, 720));
    let rate: f64 = element(&streams["EMG"].header, "nominal_srate").parse().unwrap();
    let expected = 12.0 * rate;
    assert!((streams["EMG"].times.len() as f64 - expected).abs() < 0.02 * expected, "{rate} Hz");
    assert!(
        streams["Joints"].header.contains("elbow</label><unit>rad</unit>"),
        "{}",
        streams["Joints"].header
    );
    // Quaternions are of unit length, probabilities add up to one.
    for pose in &streams["Hand"].numbers {
        assert!((pose[3..].iter().map(|q| q * q).sum::<f64>() - 1.0).abs() < 1e-9);
    }
    for window in &streams["Gestures"].numbers {
        let sum: f64 = window[..window.len() - 1].iter().sum();
        assert!((sum - 1.0).abs() < 1e-9 || sum == 0.0, "{window:?}");
    }
    // The events are those of the record, in their order.
    let lines = fs::read_to_string(Path::new(trial).join("events.jsonl")).unwrap();
    let recorded: Vec<Value> = lines.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let events: Vec<Value> =
        streams["Events"].words.iter().map(|words| serde_json::from_str(&words[1]).unwrap()).collect();
    assert!(recorded.len() > 5 && events == recorded, "{events:?}");
    for (words, event) in streams["Events"].words.iter().zip(&recorded) {
        assert_eq!(words[0], event["event"].as_str().unwrap());
    }

    // A file that is there is left alone, and no half of one stays where the record is not what it was.
    let again = proact(&["export", trial, "--xdf", out]).unwrap_err();
    assert!(again.contains("trial.xdf") && fs::metadata(&file).unwrap().len() > 100_000, "{again}");
    let events = Path::new(trial).join("events.jsonl");
    fs::write(&events, lines.replacen("gesture", "gesturf", 1)).unwrap();
    let other = temp_dir.path().join("other.xdf");
    assert!(proact(&["export", trial, "--xdf", other.to_str().unwrap()]).is_err());
    assert!(!other.exists());
}
