//! Models of intent, scored on a recorded trial: recording, replay, models and scores together.
#![allow(clippy::disallowed_methods)] // A test of files.

use proact_app::{Recorder, intent_scores, trial};
use proact_control::MethodRegistry;
use proact_devices::EmgOrigin;
use proact_intent::{IntentModelName, IntentOptions};
use proact_testbed::{Setup, TrialConfig};
use proact_types::EventKind;
use std::{error::Error, fs, path::Path};

type Outcome<T = ()> = Result<T, Box<dyn Error>>;

/// Records a trial into `dir` that ends right after the first grasp; the name of the block.
fn record_one_pick(dir: &Path) -> Outcome<String> {
    let config = TrialConfig::new("D", 1, Setup::named("seated")?);
    let trial::Assembly { mut trial, classifier, arm, .. } =
        trial::simulated_trial(TrialConfig { limit_secs: 120.0, ..config }, &EmgOrigin::Synthetic)?;
    let config = trial.testbed().config().clone();
    let mut recorder = Recorder::create(dir, &config, &arm, classifier.as_ref())?;
    let mut grasped = None;
    loop {
        let step = trial.step(grasped.is_some())?;
        recorder.write(&step, trial.testbed().plant().state())?;
        if let Some(block) = grasped {
            recorder.finish(&trial.result())?;
            return Ok(trial.testbed().task().scene().name(block));
        }
        grasped = step.output.events.iter().find_map(|event| match event.kind {
            EventKind::ObjectAttached { object: block } => Some(block),
            _ => None,
        });
        if step.output.finished {
            return Err("the participant grasped nothing in 120 s".into());
        }
    }
}

#[test]
fn a_recorded_pick_is_scored_the_same_alone_and_in_a_folder_and_what_is_damaged_is_named() -> Outcome {
    let temp_dir = tempfile::tempdir()?;
    let dir = temp_dir.path().join("trial");
    let block = record_one_pick(&dir)?;

    let alone = intent_scores::score_intent_models(&MethodRegistry::standard(), &dir, None, |_, _, _| {})?;
    assert_eq!((alone.picks, alone.trials.len(), alone.skipped.len()), (1, 1, 0));
    assert_eq!(alone.trials[0].picked, [block]);
    let names: Vec<&str> = alone.models.iter().map(|m| m.model.as_str()).collect();
    assert_eq!(names, IntentModelName::ALL.map(IntentModelName::as_str));
    let score = |name: IntentModelName| {
        &alone.models.iter().find(|m| m.model == name.as_str()).expect("all are there").score
    };
    assert_eq!(score(IntentModelName::Product).never_correct, 0, "the participant locked it with this model");
    let chance_log_loss = 4.0_f64.ln();
    for name in [IntentModelName::GazeOnly, IntentModelName::Product, IntentModelName::Filtered] {
        let score = score(name);
        assert!(
            score.log_loss < chance_log_loss && score.accuracy > 0.5,
            "{name} is worse than guessing: {score:?}"
        );
        assert!(score.forecasts > 60, "more than a second of gaze");
    }
    // Red is due first and two blocks are red: by hand -ln 0.375.
    let prior = score(IntentModelName::PriorOnly);
    assert!((prior.log_loss - 0.980_829).abs() < 1e-3, "{prior:?}");
    assert!((prior.accuracy - 0.5).abs() < 0.01, "{prior:?}");

    // In a folder with a trial whose configuration was edited.
    let damaged = temp_dir.path().join("edited");
    fs::create_dir(&damaged)?;
    for file in fs::read_dir(&dir)? {
        let file = file?;
        fs::copy(file.path(), damaged.join(file.file_name()))?;
    }
    let text = fs::read_to_string(damaged.join("config.toml"))?;
    fs::write(damaged.join("config.toml"), text.replace("sigma = 0.03", "sigma = 0.04"))?;
    let folder =
        intent_scores::score_intent_models(&MethodRegistry::standard(), temp_dir.path(), None, |_, _, _| {})?;
    assert_eq!(folder.models, alone.models);
    assert_eq!(folder.skipped.len(), 1);
    assert_eq!(folder.skipped[0].dir, damaged);
    assert!(folder.skipped[0].reason.contains("config.toml"), "{}", folder.skipped[0].reason);

    // Options reach the models.
    let wide = IntentOptions { gaze_sigma: 5.0, off_task_weight: 0.25, ..Default::default() };
    let wide =
        intent_scores::score_intent_models(&MethodRegistry::standard(), &dir, Some(&wide), |_, _, _| {})?;
    assert!(
        (wide.models[2].score.log_loss - chance_log_loss).abs() < 0.01,
        "nothing is known: {:?}",
        wide.models[2]
    );

    // What people and machines read.
    let json: serde_json::Value = serde_json::to_value(&alone)?;
    for key in ["model", "log_loss", "brier", "accuracy", "expected_calibration_error", "reliability"] {
        assert!(json["models"][3].get(key).is_some(), "{key} is missing");
    }
    assert!(json["models"][3]["time_to_correct_ms"]["median"].is_number());
    assert!(alone.to_string().contains("filtered"), "{alone}");
    Ok(())
}

#[test]
fn a_folder_without_trials_is_refused_with_what_was_expected() -> Outcome {
    let temp_dir = tempfile::tempdir()?;
    let error =
        intent_scores::score_intent_models(&MethodRegistry::standard(), temp_dir.path(), None, |_, _, _| {})
            .expect_err("nothing is there")
            .to_string();
    assert!(error.contains("inputs.log"), "{error}");
    let error = intent_scores::score_intent_models(
        &MethodRegistry::standard(),
        &temp_dir.path().join("nowhere"),
        None,
        |_, _, _| {},
    )
    .expect_err("no such folder");
    assert!(error.to_string().contains("nowhere"), "{error}");
    Ok(())
}
