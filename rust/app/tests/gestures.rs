//! A model of seven gestures of its own: recorded in LibEMG's layout, judged, and in a trial by the table of the profile.
#![allow(clippy::unwrap_used, clippy::disallowed_methods)] // A test of files.

use proact_app::{Arm, Recorder, ReplayOptions, replay_trial, trial};
use proact_control::MethodRegistry;
use proact_devices::{EmgOrigin, Recordings, SyntheticEmg, SyntheticModel, evaluate, random_stream};
use proact_emg::EmgConfig;
use proact_testbed::{Setup, TrialConfig};
use proact_types::{Command, EventKind};
use std::{collections::BTreeSet, fmt::Write, path::Path};

/// Class numbers, names, and what they are made of: the EMG of one of the five, and channels that the band is turned by,
/// which makes another pattern of it.
const SEVEN: [(&str, Command, usize); 7] = [
    ("wave out", Command::WristExtension, 0),
    ("fist", Command::HandClose, 0),
    ("relax", Command::NoMotion, 0),
    ("wave in", Command::WristFlexion, 0),
    ("spread", Command::HandOpen, 0),
    ("point", Command::HandClose, 3),
    ("pinch", Command::WristExtension, 3),
];

/// Three repetitions of 3 s at 200 Hz, with the names in the folder's metadata.
fn record(dir: &Path) {
    let model = SyntheticModel::shipped().unwrap();
    let mut emg = SyntheticEmg::new(&model, 200.0, 8, 1.0, random_stream(1, "test")).unwrap();
    for (class, (_, made_of, turned)) in SEVEN.into_iter().enumerate() {
        for repetition in 0..3 {
            let mut text = String::new();
            for _ in 0..600 {
                let mut row = emg.next(made_of);
                row.rotate_left(turned);
                let row: Vec<String> = row.iter().map(f64::to_string).collect();
                writeln!(text, "{}", row.join(",")).unwrap();
            }
            std::fs::write(dir.join(format!("R_{repetition}_C_{class}.csv")), text).unwrap();
        }
    }
    let names: Vec<String> = SEVEN.iter().map(|(name, ..)| format!("{name:?}")).collect();
    let metadata = format!(r#"{{"rate_hz": 200, "classes": [{}], "rest": "relax"}}"#, names.join(", "));
    std::fs::write(dir.join("metadata.json"), metadata).unwrap();
}

/// A trial of method A whose profile has `table`.
fn config(table: &str) -> Result<TrialConfig, String> {
    let config = TrialConfig::new("A", 1, Setup::named("still").unwrap());
    let text = config.to_toml().unwrap();
    let own = format!("[profile.gestures]\n{table}\n[profile.jog]\n");
    let changed = text.replacen("[profile.jog]\n", &own, 1);
    assert_ne!(changed, text, "there is such a table in {text}");
    TrialConfig::from_toml(&changed).map_err(|error| error.to_string())
}

const TABLE: &str = r#""wave out" = "wrist_extension"
"wave in" = "wrist_flexion"
fist = "hand_close"
spread = "hand_open"
pinch = "hand_close""#;

#[test]
fn seven_gestures_are_recorded_judged_and_drive_a_trial_by_the_table() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("recordings");
    std::fs::create_dir(&folder).unwrap();
    record(&folder);
    let recordings = Recordings::open(&folder, None).unwrap();
    assert_eq!((recordings.gestures().len(), recordings.rest.as_str()), (7, "relax"));
    let settings = EmgConfig { rate_hz: 200.0, ..EmgConfig::default() };
    let evaluation = evaluate(&recordings, &[0, 1], &[2], &settings).unwrap();
    let classes: Vec<&str> = evaluation.classes.iter().map(|name| name.as_str()).collect();
    assert_eq!(classes, ["fist", "pinch", "point", "relax", "spread", "wave in", "wave out"]);
    assert!(evaluation.confusion.len() == 7 && evaluation.confusion.iter().all(|row| row.len() == 7));
    assert!(evaluation.accuracy > 0.9, "{evaluation:?}");

    let config = config(TABLE).unwrap();
    let arm = Arm::from_config(&config).unwrap();
    let emg = EmgOrigin::recording(&folder);
    let trial::Assembly { mut trial, classifier, arm, .. } =
        trial::simulated_trial_with_model(&MethodRegistry::standard(), &arm, config, &emg, None).unwrap();
    let trial_dir = dir.path().join("trial");
    let used = trial.testbed().config().clone();
    assert_eq!(used.emg.as_ref().unwrap().rest.as_str(), "relax");
    let mut recorder = Recorder::create(&trial_dir, &used, &arm, classifier.as_ref()).unwrap();
    let (mut commands, mut names) = (BTreeSet::new(), BTreeSet::new());
    const TICKS: u64 = 15_000;
    for tick in 1..=TICKS {
        let step = trial.step(tick == TICKS).unwrap();
        recorder.write(&step, trial.testbed().plant().state()).unwrap();
        for event in &step.output.events {
            if let EventKind::GestureChanged { gesture } = event.kind {
                commands.insert(gesture);
            }
        }
        if let Some(frame) = step.frame {
            let does = SEVEN.iter().find(|(name, ..)| frame.recognized_gesture.as_str() == *name);
            let does =
                does.map(|(name, made_of, _)| if *name == "pinch" { Command::HandClose } else { *made_of });
            // Nothing is made of `point`, which has no entry.
            let expected =
                if frame.recognized_gesture.as_str() == "point" { Some(Command::NoMotion) } else { does };
            assert_eq!(Some(frame.command), expected, "{}", frame.recognized_gesture);
            names.insert(frame.recognized_gesture.to_string());
        }
    }
    recorder.finish(&trial.result()).unwrap();
    assert!(commands.len() >= 3 && commands.contains(&Command::HandOpen), "{commands:?}");
    assert!(names.contains("relax") && names.contains("spread"), "{names:?}");
    let text = std::fs::read_to_string(trial_dir.join("config.toml")).unwrap();
    assert!(
        text.contains("\"wave out\" = \"wrist_extension\"") && text.contains("rest = \"relax\""),
        "{text}"
    );
    let replayed = replay_trial(&trial_dir, ReplayOptions::default()).unwrap();
    assert!(replayed.agrees, "{replayed:?}");
}

#[test]
fn tables_that_cannot_act_are_refused_in_one_sentence() {
    let dir = tempfile::tempdir().unwrap();
    record(dir.path());
    let refused = |table: &str| {
        let config = config(table)?;
        let arm = Arm::from_config(&config).unwrap();
        let assembled = trial::simulated_trial_with_model(
            &MethodRegistry::standard(),
            &arm,
            config,
            &EmgOrigin::recording(dir.path()),
            None,
        );
        assembled.map(|_| ()).map_err(|error| error.to_string())
    };
    assert_eq!(refused(""), Ok(()), "gestures without an entry do nothing");
    let text = refused("wave = \"hand_close\"").unwrap_err();
    assert!(text.contains("\"wave\"") && text.contains("it has fist, pinch, point"), "{text}");
    let text = refused("relax = \"hand_close\"").unwrap_err();
    assert!(text.contains("relax is the rest gesture"), "{text}");
    let text = refused("fist = \"grab\"").unwrap_err();
    assert!(text.contains("unknown variant grab, expected one of hand_close"), "{text}");
    let text = refused("\" fist\" = \"hand_close\"").unwrap_err();
    assert!(text.contains("cannot be the name of a gesture"), "{text}");
}

#[test]
fn folders_that_do_not_say_what_a_gesture_is_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    record(dir.path());
    let start = |metadata: &str| {
        std::fs::write(dir.path().join("metadata.json"), metadata).unwrap();
        let config = config("").unwrap();
        let arm = Arm::from_config(&config).unwrap();
        trial::simulated_trial_with_model(
            &MethodRegistry::standard(),
            &arm,
            config,
            &EmgOrigin::recording(dir.path()),
            None,
        )
        .map(|_| ())
        .unwrap_err()
        .to_string()
    };
    let text = start(r#"{"rate_hz": 200}"#);
    assert!(
        text.contains("class 5 has no name; known are 0 hand_close") && text.contains("class_map"),
        "{text}"
    );
    let text = start(r#"{"rate_hz": 200, "classes": ["a", "b", "c", "d", "e", "f", "g"]}"#);
    assert!(
        text.contains("the rest gesture is no_motion, which the model does not know; it has a, b"),
        "{text}"
    );
    let text = start(r#"{"rate_hz": 200, "classes": ["a", "b", "no motion", "d", "e", "f", "g", "h"]}"#);
    assert!(text.contains("no recording of h"), "{text}");
}
