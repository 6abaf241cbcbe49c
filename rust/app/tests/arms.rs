//! A lab's own arm in a trial: chosen by its folder, stored in the record, refused when it is another one.
#![allow(clippy::disallowed_methods, clippy::unwrap_used)] // A test of files.

use proact_app::{Arm, Recorder, ReplayOptions, replay_trial, trial};
use proact_control::MethodRegistry;
use proact_description::{MPL_RIGHT_ARM_SRDF, MPL_RIGHT_ARM_URDF};
use proact_devices::EmgOrigin;
use proact_testbed::{Setup, TrialConfig};
use std::{fs, path::Path};

const MESHES: &str =
    concat!(env!("CARGO_MANIFEST_DIR"), "/../../ros1_ws/src/proact_description/arms/mpl_right/meshes");

/// The shipped arm under another name and with a heavier forearm, in a folder.
fn own_arm(folder: &Path) {
    fs::create_dir_all(folder.join("meshes")).unwrap();
    for mesh in fs::read_dir(MESHES).unwrap() {
        let mesh = mesh.unwrap();
        fs::copy(mesh.path(), folder.join("meshes").join(mesh.file_name())).unwrap();
    }
    let urdf = MPL_RIGHT_ARM_URDF.replace("<robot name=\"mpl_right_arm\">", "<robot name=\"lab_arm\">");
    let (before, after) = urdf.split_once("<mass value=\"").unwrap();
    let (mass, after) = after.split_once('"').unwrap();
    let heavier = 1.5 * mass.parse::<f64>().unwrap();
    fs::write(folder.join("lab_arm.urdf"), format!("{before}<mass value=\"{heavier}\"{after}")).unwrap();
    let srdf = MPL_RIGHT_ARM_SRDF.replace("<robot name=\"mpl_right_arm\">", "<robot name=\"lab_arm\">");
    fs::write(folder.join("lab_arm.srdf"), srdf).unwrap();
}

fn record(arm: &Arm, dir: &Path) -> String {
    let mut config = TrialConfig::new("D", 1, Setup::named("still").unwrap());
    (config.arm, config.limit_secs) = (arm.pinned(), 8.0);
    record_of(arm, config, dir)
}

fn record_of(arm: &Arm, config: TrialConfig, dir: &Path) -> String {
    let assembled = trial::simulated_trial_with_model(
        &MethodRegistry::standard(),
        arm,
        config,
        &EmgOrigin::Synthetic,
        None,
    )
    .unwrap();
    let trial::Assembly { mut trial, classifier, arm, .. } = assembled;
    let used = trial.testbed().config().clone();
    let mut recorder = Recorder::create(dir, &used, &arm, classifier.as_ref()).unwrap();
    loop {
        let step = trial.step(false).unwrap();
        recorder.write(&step, trial.testbed().plant().state()).unwrap();
        if step.output.finished {
            break;
        }
    }
    recorder.finish(&trial.result()).unwrap();
    trial.testbed().digest()
}

#[test]
fn a_labs_own_arm_is_recorded_with_the_trial_and_another_one_is_refused_by_name() {
    let temp_dir = tempfile::tempdir().unwrap();
    let (folder, dir) = (temp_dir.path().join("arm"), temp_dir.path().join("trial"));
    own_arm(&folder);
    let digest = record(&Arm::load(folder.to_str().unwrap()).unwrap(), &dir);
    let shipped = record(&Arm::load("mpl_right").unwrap(), &temp_dir.path().join("shipped"));
    assert_ne!(digest, shipped);
    assert!(!temp_dir.path().join("shipped/arm.urdf").exists(), "the program has it");

    // The folder may be gone: the record has what it needs.
    fs::remove_dir_all(&folder).unwrap();
    let replayed = replay_trial(&dir, ReplayOptions::default()).unwrap();
    assert!(replayed.agrees && replayed.digest == digest, "{replayed:?}");

    let urdf = dir.join("arm.urdf");
    let text = fs::read_to_string(&urdf).unwrap();
    let config = TrialConfig::from_toml(&fs::read_to_string(dir.join("config.toml")).unwrap()).unwrap();
    let folder = temp_dir.path().join("other");
    fs::create_dir(&folder).unwrap();
    for file in fs::read_dir(&dir).unwrap().map(Result::unwrap) {
        if file.file_name().to_str().unwrap().starts_with("arm.") {
            fs::copy(file.path(), folder.join(file.file_name())).unwrap();
        }
    }
    let refusal = |text: &str| {
        fs::write(folder.join("arm.urdf"), text).unwrap();
        let arm = Arm::from_record(&folder, &config).map_err(|error| error.to_string());
        arm.and_then(|arm| {
            trial::replay_testbed(&MethodRegistry::standard(), &arm, config.clone(), None)
                .map_err(|error| error.to_string())
        })
        .err()
        .unwrap()
    };
    let (before, after) = text.split_once("<mass value=\"").unwrap();
    let other = refusal(&format!("{before}<mass value=\"1{after}"));
    assert!(other.starts_with("arm \"arm\" is another one here (hash "), "{other}");
    let renamed = refusal(&text.replace("<robot name=\"lab_arm\">", "<robot name=\"an_arm\">"));
    assert!(renamed.contains("another one here"), "{renamed}");
    fs::remove_file(folder.join("arm.urdf")).unwrap();
    let gone = Arm::from_record(&folder, &config).unwrap_err().to_string();
    assert!(
        gone.contains("arm \"arm\"") && gone.contains("arm.urdf") && gone.contains("mpl_right"),
        "{gone}"
    );
    // In the record itself, whatever it is now.
    fs::remove_file(&urdf).unwrap();
    let gone = replay_trial(&dir, ReplayOptions::default()).unwrap_err().to_string();
    assert!(gone.contains("arm.urdf is missing"), "{gone}");
}

/// Runs eight seconds of a trial with every method and replays them.
fn every_method(name: &str) {
    let temp_dir = tempfile::tempdir().unwrap();
    for method in ["A", "B", "C", "D"] {
        let arm = Arm::load(name).unwrap();
        let dir = temp_dir.path().join(method);
        let config = TrialConfig::new(method, 1, Setup::named("still").unwrap());
        let mut config = config.with_arm(arm.pinned(), arm.model());
        config.limit_secs = 8.0;
        let digest = record_of(&arm, config, &dir);
        let replayed = replay_trial(&dir, ReplayOptions::default()).unwrap();
        assert!(replayed.agrees && replayed.finished && replayed.digest == digest, "{method}: {replayed:?}");
        assert!(!dir.join("arm.urdf").exists(), "the program has it");
    }
}

#[test]
fn a_left_arm_runs_with_every_method_and_replays() {
    every_method("mpl_left");
}

#[test]
fn an_arm_with_another_hand_that_stands_by_itself_runs_with_every_method_and_replays() {
    every_method("wam");
}

#[test]
fn an_arm_in_a_set_up_for_the_other_side_is_refused() {
    let arm = Arm::load("mpl_left").unwrap();
    let right = TrialConfig::new("D", 1, Setup::named("still").unwrap());
    let left = right.clone().with_arm(arm.pinned(), arm.model());
    assert_eq!(left.setup.body.shoulder_m.y, -right.setup.body.shoulder_m.y);
    let config = TrialConfig { setup: right.setup, ..left };
    let error =
        trial::replay_testbed(&MethodRegistry::standard(), &arm, config, None).err().unwrap().to_string();
    assert!(error.contains("is a left arm and the set-up is for a right one"), "{error}");
}

#[test]
fn a_former_name_is_understood_and_the_record_says_the_present_one() {
    let arm = Arm::load("mpl_right_arm").unwrap();
    let mut config = TrialConfig::new("D", 1, Setup::named("still").unwrap());
    (config.arm.name, config.arm.hash) = ("mpl_right_arm".to_owned(), None);
    let testbed = trial::replay_testbed(&MethodRegistry::standard(), &arm, config, None).unwrap();
    assert_eq!(testbed.config().arm, arm.pinned());
    assert_eq!(arm.pinned().name, "mpl_right");
}

#[test]
fn an_arm_without_a_pose_is_refused_in_one_sentence_with_those_that_there_are() {
    let temp_dir = tempfile::tempdir().unwrap();
    own_arm(temp_dir.path());
    let file = temp_dir.path().join("lab_arm.srdf");
    let text = fs::read_to_string(&file).unwrap();
    fs::write(&file, text.replace("name=\"closed\"", "name=\"shut\"")).unwrap();
    let error = Arm::in_folder(temp_dir.path()).unwrap_err().to_string();
    assert!(error.contains("has no pose \"closed\" of the hand") && error.contains("shut (hand)"), "{error}");
    assert!(!error.contains('\n'), "{error}");
}

#[test]
fn an_arm_that_cannot_be_used_is_told_in_one_sentence_with_what_there_is() {
    let temp_dir = tempfile::tempdir().unwrap();
    let folder = temp_dir.path().join("arm");
    let refusal = |name: &str| {
        let error = Arm::load(name).unwrap_err().to_string();
        assert!(!error.contains('\n'), "{error}");
        error
    };
    let unknown = refusal("mpl_arm");
    assert_eq!(
        unknown,
        "arm \"mpl_arm\" is unknown; expected mpl_left, mpl_right, wam, or a folder with a URDF file"
    );
    fs::create_dir(&folder).unwrap();
    let name = folder.to_str().unwrap();
    assert!(refusal(name).ends_with("has 0 files *.urdf, expected one"));
    own_arm(&folder);
    let missing = fs::read_dir(folder.join("meshes")).unwrap().next().unwrap().unwrap();
    fs::remove_file(missing.path()).unwrap();
    let error = refusal(name);
    let file = missing.file_name().into_string().unwrap();
    assert!(
        error.contains(&file) && error.contains("which is not there") && error.contains(".stl, "),
        "{error}"
    );
    own_arm(&folder);
    fs::write(folder.join("other.urdf"), "<robot/>").unwrap();
    assert!(refusal(name).ends_with("has 2 files *.urdf, expected one"));
    fs::remove_file(folder.join("other.urdf")).unwrap();
    fs::write(folder.join("lab_arm.urdf"), "<robot name=\"lab_arm\"").unwrap();
    let error = Arm::load(name).unwrap_err().to_string();
    assert!(error.contains(name), "{error}");
}
