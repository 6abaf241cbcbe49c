//! Methods as entries of a registry: names, needs, and the files of outside methods.
mod common;

use common::model;
use proact_control::{
    BlendProfile, ControlError, EXTERNAL_METHOD_NAME, JointJog, MethodEntry, MethodProgram, MethodRegistry,
    Profile, ports::NoProcess,
};
use proact_types::{MethodInfo, MethodNeeds, MethodStyle};

const FILE: &str = "name = \"nod\"\ntitle = \"by nodding\"\ncommand = [\"python3\", \"nod.py\"]\n\
    style = \"selecting\"\n[needs]\ngaze = true\n[help]\nhand_open = \"let go\"\n";

fn jogging(name: &str, needs: MethodNeeds) -> MethodEntry {
    let info = MethodInfo { name: name.to_owned(), title: "mine".to_owned(), needs, ..MethodInfo::default() };
    MethodEntry::new(info, |profile, model, subset| Ok(Box::new(JointJog::new(profile, model, subset)?)))
}

#[test]
fn a_lab_adds_a_method_and_every_other_keeps_its_place() {
    let methods =
        MethodRegistry::standard().with(jogging("mine", MethodNeeds::default())).expect("a new name");
    assert_eq!(methods.names(), ["A", "B", "C", "D", "mine"]);
    let profile = Profile::named("default").expect("ships");
    for entry in methods.entries() {
        entry.build(&profile, &model(), NoProcess).expect("each fits the default profile");
    }
    let error = methods.get("E").expect_err("there is no E").to_string();
    assert_eq!(error, "method \"E\" is unknown; expected one of A, B, C, D, mine");
    let error = methods.with(jogging("D", MethodNeeds::default())).expect_err("there is a D").to_string();
    assert_eq!(error, "method \"D\" exists already, among A, B, C, D, mine: give yours another name");
}

#[test]
fn names_and_texts_that_cannot_be_shown_or_be_part_of_a_path_are_refused() {
    let long = "n".repeat(33);
    for name in ["", "a/b", "..", "two words", EXTERNAL_METHOD_NAME, &long] {
        let error = MethodRegistry::standard().with(jogging(name, MethodNeeds::default())).expect_err(name);
        assert!(matches!(error, ControlError::MethodText { key: "name", .. }), "{error}");
    }
    let mut info = MethodInfo { name: "x".to_owned(), title: "mine".to_owned(), ..MethodInfo::default() };
    info.help.hand_open = "let\u{1b}[2Jgo".to_owned();
    let program = MethodProgram { info: Some(info), ..MethodProgram::new(vec!["true".to_owned()]) };
    let error = program.check().expect_err("an escape sequence").to_string();
    assert!(error.starts_with("method: hand_open = "), "{error}");
}

#[test]
fn what_a_method_needs_decides_which_profiles_it_takes() {
    let profile = |level: &str, blend| {
        let profile = Profile::named("default").expect("ships");
        Profile { level: level.to_owned(), blend, ..profile }
    };
    let share = Some(BlendProfile { assistance_share: 0.5, ..BlendProfile::default() });
    let whole = MethodNeeds { whole_arm: true, ..MethodNeeds::default() };
    let limb = MethodNeeds { limb: true, ..MethodNeeds::default() };
    let plans = MethodNeeds { plans: true, ..MethodNeeds::default() };
    for (needs, profile, expected) in [
        (whole, profile("below_elbow", None), Some("drives the whole arm")),
        (whole, profile("shoulder", None), None),
        (limb, profile("shoulder", None), Some("needs the person's own limb")),
        (limb, profile("below_elbow", None), None),
        (plans, profile("shoulder", share), Some("no speed to blend")),
        (MethodNeeds::default(), profile("below_elbow", share), None),
    ] {
        let built = jogging("mine", needs).build(&profile, &model(), NoProcess);
        match (built.err(), expected) {
            (Some(error), Some(expected)) => assert!(error.to_string().contains(expected), "{error}"),
            (None, None) => {}
            (got, expected) => panic!("{needs:?} gave {got:?}, expected {expected:?}"),
        }
    }
}

#[test]
fn the_file_of_an_outside_method_is_an_entry_and_what_is_wrong_in_it_is_named() {
    let entry = MethodEntry::from_toml(FILE).expect("reads");
    let (info, program) = (entry.info().clone(), entry.program().cloned().expect("a program"));
    assert_eq!((info.name.as_str(), info.style, info.needs.gaze), ("nod", MethodStyle::Selecting, true));
    assert_eq!((info.help.hand_open.as_str(), program.deadline_ms), ("let go", 5));
    for (from, to, expected) in [
        ("[needs]\n", "[needs]\ntouch = true\n", "unknown field touch"),
        ("style = \"selecting\"", "style = \"dancing\"", "unknown variant dancing"),
        ("[\"python3\", \"nod.py\"]", "[]", "method_process.command = []"),
        ("name = \"nod\"", "name = \"\"", "method: name = \"\""),
        ("title = \"by nodding\"\n", "", "missing field title"),
        ("style =", "deadline_ms = 0\nstyle =", "method_process.deadline_ms = 0"),
    ] {
        let error = MethodEntry::from_toml(&FILE.replace(from, to)).expect_err(to).to_string();
        assert!(error.contains(expected) && !error.contains('\n'), "{to} gave {error}");
    }
    // A record names the method and holds the program: no registry has to know it.
    let methods = MethodRegistry::standard();
    assert_eq!(methods.resolve("nod", Some(&program)).expect("its own").info(), &info);
    let error = methods.resolve("D", Some(&program)).expect_err("two names").to_string();
    assert!(error.contains("\"D\"") && error.contains("\"nod\""), "{error}");
}

#[test]
fn a_program_without_a_name_stands_in_the_place_of_a_method_and_knows_what_that_one_knows() {
    let program = MethodProgram::new(vec!["true".to_owned()]);
    let methods = MethodRegistry::standard();
    let entry = methods.resolve("D", Some(&program)).expect("D is known");
    assert_eq!(entry.info().name, EXTERNAL_METHOD_NAME);
    assert!(entry.needs().prior && entry.needs().gaze && !entry.needs().whole_arm);
    assert!(!methods.resolve("A", Some(&program)).expect("A is known").needs().gaze);
    assert!(methods.resolve("E", Some(&program)).is_err());
}
