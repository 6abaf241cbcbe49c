use super::*;
use crate::{MassSet, PhysicsEngine};

fn config() -> TrialConfig {
    TrialConfig::new("D", 3, Setup::named("seated").expect("ships"))
}

#[test]
fn a_configuration_survives_its_text() {
    for name in ["seated", "still"] {
        let config = TrialConfig { setup: Setup::named(name).expect("ships"), ..config() };
        assert_eq!(TrialConfig::from_toml(&config.to_toml().expect("writes")), Ok(config));
    }
}

#[test]
fn an_error_in_a_text_with_its_arrangement_at_the_top_shows_the_line_itself() {
    let error = |text: &str| TrialConfig::from_toml(text).expect_err("a wrong value").to_string();
    // The wrong line stands last, and the text that is read is longer than the file.
    let top = "seed = 1\nmethod = \"D\"\narrangement = [\"NL\", \"NM\", \"FM\", \"FL\"]\n";
    let message = error(&format!("{top}[physics]\nengine = 3\n"));
    assert!(message.contains("engine = 3: "), "{message}");
    let message = error("seed = 1\nmethod = 7.5\n");
    assert!(message.contains("line 2: "), "{message}");
}

#[test]
fn the_intent_model_is_part_of_the_configuration_and_older_ones_mean_the_product() {
    let text = config().to_toml().expect("writes");
    let line = "intent_model = \"product\"\n";
    assert_eq!(TrialConfig::from_toml(&text.replace(line, "")), Ok(config()));
    let filtered = TrialConfig::from_toml(&text.replace(line, "intent_model = \"filtered\"\n"));
    assert_eq!(filtered.expect("reads").intent_model, IntentModelName::Filtered);
    assert!(TrialConfig::from_toml(&text.replace(line, "intent_model = \"guess\"\n")).is_err());
}

#[test]
fn the_physics_is_part_of_the_text_and_a_text_without_it_means_the_default() {
    for mass_set in [MassSet::Description, MassSet::Scaled(0.25)] {
        let physics = PhysicsConfig { mass_set, ..PhysicsConfig::ORIGINAL };
        let config = TrialConfig { physics, ..config() };
        let text = config.to_toml().expect("writes");
        assert!(text.contains("[physics") && text.contains("original_gains"), "{text}");
        assert_eq!(TrialConfig::from_toml(&text), Ok(config));
    }
    let text = config().to_toml().expect("writes");
    let (before, after) = text.split_once("[physics]").expect("is written");
    let (_, after) = after.split_once("\n[").expect("a section follows");
    assert_eq!(TrialConfig::from_toml(&format!("{before}[{after}")), Ok(config()));
    let scaled = |factor, physics| PhysicsConfig { mass_set: MassSet::Scaled(factor), ..physics };
    for factor in [0.0, -1.0, f64::NAN, 0.2, 1000.0] {
        let physics = scaled(factor, PhysicsConfig::default());
        let refused = TrialConfig { physics, ..config() }.check().expect_err("out of range");
        assert!(refused.to_string().contains("mass_set.scaled"), "{refused}");
    }
    let heavy = TrialConfig { physics: scaled(2.5, PhysicsConfig::ORIGINAL), ..config() };
    let refused = heavy.check().expect_err("the arm would fall").to_string();
    assert!(refused.contains("0.01 to 1 with original_gains"), "{refused}");
    let original = config().with_profile("original").expect("ships");
    assert_eq!(original.physics, PhysicsConfig::ORIGINAL);
    assert!(original.intent.gaze_sigma == 0.1 && original.intent.context_changes_at_grasp);
}

#[test]
fn a_value_with_a_number_of_its_own_is_set_by_its_name() {
    let twice = config().with_overrides(&["physics.mass_set.scaled=2"]).expect("as in a file");
    assert_eq!(twice.physics.mass_set, MassSet::Scaled(2.0));
    let back = twice.with_overrides(&["physics.mass_set=real_limb"]).expect("a name alone");
    assert_eq!(back.physics.mass_set, MassSet::RealLimb);
    for wrong in ["physics.mass_set.scald=2", "method.name=A", "physics.engine.name=ode"] {
        let error = config().with_overrides(&[wrong]).expect_err("no such key").to_string();
        assert!(error.contains(wrong), "{error}");
    }
}

#[test]
fn the_engine_is_part_of_the_text_and_an_unknown_one_is_told_with_those_that_there_are() {
    let text = config().to_toml().expect("writes");
    assert!(text.contains("engine = \"reduced\""), "{text}");
    let ode = config().with_overrides(&["physics.engine=ode"]).expect("is known");
    assert_eq!(ode.physics.engine, PhysicsEngine::Ode);
    assert_eq!(TrialConfig::from_toml(&ode.to_toml().expect("writes")), Ok(ode));
    assert_eq!(config().with_overrides(&["physics.engine=reduced"]), Ok(config()));
    let refused = config().with_overrides(&["physics.engine=bullet"]).expect_err("unknown").to_string();
    assert!(refused.contains("unknown variant bullet, expected reduced or ode"), "{refused}");
}

#[test]
fn unknown_names_and_keys_and_values_out_of_range_are_refused_with_what_is_expected() {
    let unknown = TrialConfig { method: "E".to_owned(), ..config() };
    let error = unknown.method_entry(&MethodRegistry::standard()).expect_err("no method E");
    assert_eq!(error.to_string(), "method \"E\" is unknown; expected one of A, B, C, D");
    assert!(Setup::named("standing").is_err());
    let text = config().to_toml().expect("writes");
    let error = TrialConfig::from_toml(&format!("colour = 3\n{text}")).expect_err("an unknown key");
    let expected =
        "the trial configuration is unreadable: line 1: unknown field colour, expected one of method, ";
    assert!(error.to_string().starts_with(expected), "{error}");
    assert!(!error.to_string().contains('\n'), "{error}");
    let other = config().with_overrides(&["planner.parameters.range=0.4"]).expect("a number is text to OMPL");
    assert_eq!(other.planner.parameters["range"], "0.4");
    let deep = format!("setup{}=1", ".body".repeat(20_000));
    let error = config().with_overrides(&[deep]).expect_err("no such key").to_string();
    assert!(error.contains("sets nothing"), "{error}");
    let emg = TrialConfig { emg: Some(EmgConfig::default()), ..config() };
    for assignment in ["emg_dc_offset=[nan]", "emg.rate_hz=nan", "emg.liveness.noise_floors=[nan]"] {
        assert!(
            emg.with_overrides(&[assignment]).is_err(),
            "{assignment} makes a configuration that equals no other"
        );
    }
    let error = config().with_overrides(&["planner.nme=PRM"]).expect_err("an unknown key").to_string();
    assert!(error.starts_with("cannot set planner.nme=PRM: unknown field nme, expected one of "), "{error}");
    assert!(!error.contains('\n'), "{error}");
    let error = TrialConfig::from_toml(&text.replace("limit_secs = 300.0", "limit_secs = -1.0"));
    assert!(matches!(error, Err(ConfigError::Value { key: "limit_secs", .. })), "{error:?}");
}

#[test]
fn without_gaze_a_method_that_needs_it_is_refused_and_the_others_are_not() {
    let methods = MethodRegistry::standard();
    let blind = config().with_overrides(&["gaze=false"]).expect("is a key");
    let error = blind.method_entry(&methods).expect_err("D gazes").to_string();
    assert!(error.starts_with("method \"D\" needs gaze, and this trial has none"), "{error}");
    assert!(TrialConfig { method: "A".to_owned(), ..blind }.method_entry(&methods).is_ok());
    assert!(!config().to_toml().expect("writes").contains("gaze = true"), "records stay what they were");
}

#[test]
fn an_outside_method_is_part_of_the_text_and_one_of_an_older_record_keeps_its_meaning() {
    let file = "name = \"nod\"\ntitle = \"by nodding\"\ncommand = [\"nod\"]\nneeds = { prior = true }\n";
    let entry = MethodEntry::from_toml(file).expect("reads");
    let config = config().with_method(&entry);
    let read = TrialConfig::from_toml(&config.to_toml().expect("writes")).expect("reads");
    assert_eq!(read, config);
    let methods = MethodRegistry::standard();
    assert_eq!(read.method_entry(&methods).expect("describes it").info(), entry.info());
    assert_eq!(read.method_label(), "nod");
    let text =
        format!("{}\n[method_process]\ncommand = [\"old\"]\n", self::config().to_toml().expect("writes"));
    let old = TrialConfig::from_toml(&text).expect("reads");
    assert_eq!((old.method.as_str(), old.method_label().as_str()), ("D", "outside"));
    assert!(old.method_entry(&methods).expect("D is known").needs().prior);
}

#[test]
fn the_one_to_blame_of_many_assignments_is_named() {
    let mut assignments = vec!["limit_secs=12.5".to_owned(); 400];
    // The next one replaces it.
    assignments[123] = "limit_secs=\"soon\"".to_owned();
    assignments[399] = "limit_secs=\"later\"".to_owned();
    let named = |assignments: &[String]| match config().with_overrides(assignments) {
        Err(ConfigError::RefusedAssignment { got, .. }) => got,
        other => panic!("{other:?}"),
    };
    assert_eq!(named(&assignments), assignments[399]);
    assert_eq!(named(&["seed=4", "no.such.key=1", "seed=5"].map(String::from)), "no.such.key=1");
}
