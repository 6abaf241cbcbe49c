//! A trial configuration with the keys that were renamed since: it is the same as with the present ones.

use proact_tasks::TaskSpec;
use proact_testbed::{ConfigError, Setup, TrialConfig};
use proact_types::renamed_keys::{ConfigFile, ConfigTree, RENAMED_KEYS, RenamedKey, ShownRenames};

fn config(task: &str, profile: &str, values: &[&str]) -> Result<TrialConfig, ConfigError> {
    let config = TrialConfig::new("A", 1, Setup::named("seated")?).with_profile(profile)?;
    config.with_task(TaskSpec::named(task, 1)?)?.with_overrides(values)
}

/// Configurations that have all keys together.
fn configs() -> Result<Vec<TrialConfig>, ConfigError> {
    Ok(vec![
        config(
            "bbt",
            "default",
            &[
                "emg_dc_offset=[1.0, 2.0]",
                "user_profile.age_years=30",
                "task.grid={ count = 4, spacing_m = 0.12, width_m = 0.05 }",
                "planner.max_velocity_rad_per_s=0.31",
                "planner.search.fixed_validity_step=0.01",
                "impairments=[{ link = \"gaze\", delay_ms = 10, loss_probability = 0.1 }, { link = \"display\", loss_probability = 0.2 }]",
                "participant={ person = { decision_time_ms = 10 } }",
                "profile.blend={}",
                "profile.jog.simultaneous={ drives = { \"wrist_extension/wrist_flexion\" = \"elbow\" } }",
                "profile.jog.speed_steps={ slow_ms = 250, slow_factor = 0.4, fast_after_ms = 600, fast_factor = 2.0 }",
                "profile.jog.ramp={ rise_ms = 400, fall_rate_factor = 2.0 }",
                "profile.jog.proportional={ rest_effort = 0.1, full_effort = 0.9 }",
                "emg={ rejection_threshold = 0.5, majority_vote_windows = 5, two_site = { cocontraction_window_ms = 100 } }",
                "emg.regression={ ridge_alpha = 2.0 }",
            ],
        )?,
        config("modified_bbt", "original", &[])?,
        config(
            "bbt_heap",
            "default",
            &["task.heap={ count = 1, resting_poses = [[0.0, -0.1, 1.0275, 0.0, 0.0, 0.0, 1.0]] }"],
        )?,
    ])
}

/// Gives `tree` the old name of `row`, if it has the new one.
fn rename_back(tree: &mut toml::Value, row: &RenamedKey) -> bool {
    fn at(tree: &mut toml::Value, steps: &[&str], old: &str) -> bool {
        match steps {
            [] => false,
            [name] => tree.take(name).map(|value| tree.put(old, value)).is_some(),
            [table, rest @ ..] => {
                let inner = tree.child_mut(table.trim_end_matches("[]"));
                match inner {
                    Some(list) if table.ends_with("[]") => {
                        list.items_mut()
                            .iter_mut()
                            .map(|item| at(item, rest, old))
                            .filter(|found| *found)
                            .count()
                            > 0
                    }
                    Some(inner) => at(inner, rest, old),
                    None => false,
                }
            }
        }
    }
    let steps: Vec<&str> = row.new.split('.').collect();
    at(tree, &steps, row.old.rsplit('.').next().unwrap_or(row.old))
}

#[test]
fn a_file_of_old_keys_is_the_configuration_of_the_present_ones_and_each_is_told_once() {
    let mut rows: Vec<&RenamedKey> =
        RENAMED_KEYS.iter().filter(|row| row.file == ConfigFile::Trial).collect();
    for config in configs().expect("good configurations") {
        let text = config.to_toml().expect("plain data");
        let mut tree = toml::Value::Table(toml::from_str(&text).expect("TOML"));
        let renamed = RENAMED_KEYS.iter().rev().filter(|row| row.file == ConfigFile::Trial);
        let mut expected: Vec<&RenamedKey> = renamed.filter(|row| rename_back(&mut tree, row)).collect();
        expected.reverse();
        let old = tree.as_table().expect("a table").to_string();
        let mut noted = Vec::new();
        assert_eq!(TrialConfig::from_toml_noting(&old, &mut noted).as_ref(), Ok(&config));
        assert_eq!(noted, expected);
        assert_eq!(TrialConfig::from_toml(&old).as_ref(), Ok(&config), "records are read without a word");
        let mut shown = ShownRenames::new();
        assert_eq!((shown.first_uses(&noted).len(), shown.first_uses(&noted).len()), (expected.len(), 0));
        rows.retain(|row| !noted.contains(row));
        let mut none = Vec::new();
        assert_eq!(TrialConfig::from_toml_noting(&text, &mut none), Ok(config));
        assert!(none.is_empty(), "{none:?}");
    }
    assert!(rows.is_empty(), "no configuration here has {rows:?}");
}

#[test]
fn assignments_take_old_names_and_not_both() {
    let config = config("modified_bbt", "default", &[]).expect("good");
    let mut noted = Vec::new();
    let old = [
        "planner.max_velocity=0.3",
        "profile.dead_man.gaze_ms=300",
        "participant={ person = { notices = 0.5 } }",
    ];
    let new = [
        "planner.max_velocity_rad_per_s=0.3",
        "profile.dead_man.gaze_timeout_ms=300",
        "participant={ person = { error_detection_probability = 0.5 } }",
    ];
    assert_eq!(config.with_overrides_noting(&old, &mut noted), config.with_overrides(&new));
    let messages: Vec<String> = noted.iter().map(ToString::to_string).collect();
    assert_eq!(
        messages,
        [
            "planner.max_velocity is now planner.max_velocity_rad_per_s",
            "profile.dead_man.gaze_ms is now profile.dead_man.gaze_timeout_ms",
            "participant.person.notices is now participant.person.error_detection_probability",
        ]
    );
    for both in [[old[0], new[0]], [new[0], old[0]]] {
        let error = config.with_overrides(&both).expect_err("both").to_string();
        assert_eq!(
            error,
            "planner.max_velocity is the old name of planner.max_velocity_rad_per_s: both are given, expected \
             planner.max_velocity_rad_per_s alone"
        );
    }
    let text =
        config.to_toml().expect("plain data").replacen("[planner]", "[planner]\nmax_velocity = 0.5", 1);
    let error = TrialConfig::from_toml(&text).expect_err("both").to_string();
    assert!(error.starts_with("planner.max_velocity is the old name of"), "{error}");
    // The one that is wrong is named as it was written, and no value leaves the key out.
    let error = config.with_overrides(&["planner.max_velocity=fast"]).expect_err("a word").to_string();
    assert!(error.contains("planner.max_velocity=fast"), "{error}");
    let unset = config.with_overrides(&["planner.search.fixed_validity_step=0.01"]).expect("good");
    assert_eq!(unset.with_overrides(&["planner.search.equal_steps="]), Ok(config));
}
