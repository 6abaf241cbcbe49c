//! Simulated people, with and without physics.
#![allow(clippy::disallowed_methods, clippy::unwrap_used)] // A test, which reads files.

use proact_app::{Arm, trial};
use proact_control::MethodRegistry;
use proact_devices::EmgOrigin;
use proact_participants::{ParticipantOptions, Population, PracticeHistory};
use proact_testbed::{RunningTrial, Setup, TrialConfig, TrialResult};

fn run(mut trial: RunningTrial) -> TrialResult {
    while !trial.step(false).unwrap().output.finished {}
    trial.result()
}

fn kinematic(method: &str, options: ParticipantOptions) -> TrialResult {
    let config = TrialConfig::new(method, 3, Setup::named("seated").unwrap());
    let config = TrialConfig { participant: Some(options), limit_secs: 150.0, ..config };
    let arm = Arm::from_config(&config).unwrap();
    run(trial::kinematic_trial(&MethodRegistry::standard(), &arm, config, &EmgOrigin::Synthetic).unwrap())
}

#[test]
fn without_physics_a_trial_goes_as_one_with_physics_would() {
    let result = kinematic("D", ParticipantOptions::default());
    assert_eq!(result.score, 4.0);
    assert_eq!(result.digest, kinematic("D", ParticipantOptions::default()).digest);
}

#[test]
fn a_person_needs_longer_than_nobody_in_particular_and_another_one_another_time() {
    let person = |index| Population::standard().person(5, index, &PracticeHistory::default());
    let nobody = kinematic("D", ParticipantOptions::default()).sim_seconds;
    let [one, other] = [0, 1].map(|index| kinematic("D", person(index)).sim_seconds);
    assert!(one > nobody && other > nobody, "{one} s and {other} s, nobody {nobody} s");
    assert_ne!(one, other);
}

#[test]
fn the_text_of_a_trial_keeps_who_the_person_is() {
    let options = Population::standard().person(5, 2, &PracticeHistory::default());
    let config = TrialConfig::new("A", 1, Setup::named("seated").unwrap());
    let config = TrialConfig { participant: Some(options), ..config };
    let text = config.to_toml().unwrap();
    assert!(text.contains("[participant.person]"), "{text}");
    assert_eq!(TrialConfig::from_toml(&text).unwrap().participant, Some(options));
}

/// The crate that simulates people cannot know what the paper found: the fit would fit itself.
#[test]
fn who_is_simulated_knows_nothing_of_the_papers_results() {
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../participants");
    let manifest: toml::Value =
        toml::from_str(&std::fs::read_to_string(root.join("Cargo.toml")).unwrap()).unwrap();
    let dependencies = |section: &str| {
        let table = manifest.get(section).and_then(toml::Value::as_table).cloned().unwrap_or_default();
        table.keys().cloned().collect::<Vec<_>>()
    };
    let ours: Vec<String> =
        dependencies("dependencies").into_iter().filter(|name| name.starts_with("proact")).collect();
    assert_eq!(ours, ["proact-arm", "proact-types"]);
    for section in ["dev-dependencies", "build-dependencies"] {
        assert!(dependencies(section).is_empty(), "{section}");
    }
    // Neither do its own files have the file of results, or a row of it.
    let paper = proact_app::paper::PaperResults::shipped().study1;
    let mut folders = vec![root];
    let mut files = 0;
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
                continue;
            }
            let text = std::fs::read_to_string(&path).unwrap();
            files += 1;
            let quoted = quotes_result(&text, &paper);
            assert!(quoted.is_none(), "{} has {quoted:?}", path.display());
        }
    }
    assert!(files > 20, "the crate's files were not found");
    let planted = "sums to 2.21 blocks, with a spread of 1.50";
    assert!(quotes_result(planted, &paper).is_some(), "a planted row is found");
}

/// What of the paper's results stands in `text`: the name of their file, or mean and standard deviation of a method.
fn quotes_result(text: &str, paper: &proact_app::paper::PaperStudy) -> Option<String> {
    let number = |letter: char| !letter.is_ascii_digit() && letter != '.';
    let numbers: Vec<&str> = text.split(number).map(|word| word.trim_end_matches('.')).collect();
    let has = |value: f64| {
        let texts = [format!("{value}"), format!("{value:.2}")];
        numbers.iter().any(|word| texts.iter().any(|text| text == word))
    };
    if text.contains("paper_results") {
        return Some("paper_results".to_owned());
    }
    let row = paper.methods.iter().find(|(_, row)| has(row.mean) && has(row.sd));
    row.map(|(method, _)| format!("the row of {method}"))
}
