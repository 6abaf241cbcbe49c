//! What may be named where, so that a task or an arm of a lab's own needs no other place than its own.

use crate::workspace::{files, read};
use std::collections::BTreeSet;

/// The types of `tasks` by which any task is handled.
const ANY_TASK: [&str; 23] = [
    "Task",
    "TaskInput",
    "TaskState",
    "TaskResult",
    "TaskSpec",
    "TaskFile",
    "TaskError",
    "SceneFile",
    "DEFAULT_TASK",
    "BUILT_IN_TASKS",
    "GridSpec",
    "GridCount",
    "GridSpacing",
    "NormativeScore",
    "norms",
    "norms_in_result",
    "ObjectResult",
    "object_results",
    "ResultError",
    "check_legacy_fields",
    "check_result",
    "Sex",
    "UserProfile",
];

/// The module with the original's names.
const ORIGINAL: &str = "rust/messages/src/original.rs";

/// The lines of a Rust source that are not its tests, with their numbers.
fn program(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let end =
        text.lines().position(|line| line.trim_start().starts_with("#[cfg(test)]")).unwrap_or(usize::MAX);
    text.lines()
        .take(end)
        .enumerate()
        .map(|(number, line)| (number + 1, line.split("//").next().unwrap_or_default()))
}

/// Sources of the program itself.
fn sources() -> impl Iterator<Item = (String, String)> {
    let is_program = |path: &str| {
        path.starts_with("rust/")
            && path.ends_with(".rs")
            && path.contains("/src/")
            && !path.ends_with("tests.rs")
    };
    files().into_iter().filter(move |(path, _)| is_program(path) && !path.contains("/tests/"))
}

/// True if `name` stands in `line` as a word.
fn names(line: &str, name: &str) -> bool {
    let part = |c: char| c.is_alphanumeric() || c == '_';
    line.match_indices(name).any(|(at, _)| {
        let (before, after) = (line[..at].chars().next_back(), line[at + name.len()..].chars().next());
        !before.is_some_and(part) && !after.is_some_and(part)
    })
}

/// The names that `tasks` exports for tasks of its own.
fn own_names() -> Vec<String> {
    let lib = read("rust/tasks/src/lib.rs");
    let exported = lib.lines().filter_map(|line| line.strip_prefix("pub use ")).flat_map(|line| {
        let list = line.trim_end_matches(';').rsplit("::").next().unwrap_or_default().to_owned();
        list.trim_matches(['{', '}']).split(',').map(|name| name.trim().to_owned()).collect::<Vec<_>>()
    });
    exported.filter(|name| !ANY_TASK.contains(&name.as_str())).collect()
}

#[test]
fn a_task_is_named_by_nothing_but_its_own_crate() {
    let own = own_names();
    assert!(own.iter().any(|name| name == "ModifiedBbt"), "the search for names is broken: {own:?}");
    for (path, text) in sources().filter(|(path, _)| !path.starts_with("rust/tasks/")) {
        // Only who imports the crate can name what is in it.
        if !text.contains("proact_tasks") {
            continue;
        }
        for (number, line) in program(&text) {
            let named = own.iter().find(|name| names(line, name) && !line.contains("Error::"));
            assert!(named.is_none(), "{path}:{number}: names {named:?} of one task: {line}");
        }
    }
}

/// The original's topics, relative to the root, as its module declares them.
fn topics() -> Vec<String> {
    let declared = read(ORIGINAL);
    let lines = declared.lines().filter_map(|line| line.trim().strip_suffix("\";")?.split_once(" = \""));
    lines.filter(|(name, _)| !name.contains(' ')).map(|(_, words)| words.to_owned()).collect()
}

/// The benchmarks stand outside the program and speak to it as a lab's own nodes do.
#[test]
fn the_originals_topics_are_spelt_in_one_module() {
    let topics = topics();
    assert!(topics.len() > 20 && topics.iter().any(|t| t == "gazebo/model_states"), "not found: {topics:?}");
    for (path, text) in sources().filter(|(path, _)| path != ORIGINAL && !path.starts_with("rust/bench/")) {
        for (number, line) in program(&text) {
            let spelt = |topic: &String| {
                // Words without a slash are words of anything, unless somebody publishes or listens there.
                let is_endpoint = line.contains("publish(") || line.contains("listen");
                let relative =
                    (is_endpoint || topic.contains('/')) && line.contains(&format!("(\"{topic}\""));
                relative || line.contains(&format!("\"/{topic}\""))
            };
            let found = topics.iter().find(|topic| spelt(topic));
            assert!(found.is_none(), "{path}:{number}: the original's topic outside {ORIGINAL}: {line}");
        }
    }
}

#[test]
fn the_originals_names_of_things_stand_in_one_module() {
    let spelt = ["cylinder1", "cylinder2", "_block1_pose", "_block2_pose"];
    assert!(spelt.iter().all(|name| read(ORIGINAL).contains(name)), "the module is not where it was");
    for (path, text) in sources().filter(|(path, _)| path != ORIGINAL) {
        for (number, line) in program(&text) {
            let found = spelt.iter().find(|name| line.contains(**name));
            assert!(found.is_none(), "{path}:{number}: a name of the original's outside {ORIGINAL}: {line}");
        }
    }
}

/// Names of the joints in all folders of arms: in full, and what follows the last `__`.
fn joints_of_arms() -> (BTreeSet<String>, BTreeSet<String>) {
    let (mut full, mut short) = (BTreeSet::new(), BTreeSet::new());
    for (path, text) in files() {
        if !path.starts_with("ros1_ws/src/proact_description/arms/") || !path.ends_with(".urdf") {
            continue;
        }
        for name in text.split("<joint name=\"").skip(1).filter_map(|rest| rest.split('"').next()) {
            full.insert(name.to_owned());
            short.extend(name.rsplit("__").next().map(str::to_owned));
        }
    }
    // Also the level of limb loss at which nothing is left, and the marker on a wearer.
    short.remove("shoulder");
    (full, short)
}

#[test]
fn the_joints_of_an_arm_are_named_by_nothing_but_its_folder() {
    let (full, short) = joints_of_arms();
    let known = ["mpl_right_arm__wristz", "mpl_left_arm__thumb3", "palm_yaw"];
    assert!(known.iter().all(|name| full.contains(*name)), "the search for joints is broken: {full:?}");
    // The doubles are an arm of their own, for tests.
    let counted = sources().filter(|(path, _)| path != ORIGINAL && !path.ends_with("/src/doubles.rs"));
    for (path, text) in counted {
        for (number, line) in program(&text) {
            let named = full.iter().find(|name| names(line, name));
            let quoted = short.iter().find(|name| line.contains(&format!("\"{name}\"")));
            let found = named.or(quoted);
            assert!(found.is_none(), "{path}:{number}: names the joint {found:?} of an arm: {line}");
        }
    }
}

#[test]
fn an_arm_is_a_folder_and_no_line_of_rust() {
    for (path, text) in sources() {
        for (number, line) in program(&text) {
            assert!(!names(&line.to_lowercase(), "wam"), "{path}:{number}: speaks of one arm: {line}");
        }
    }
}

#[test]
fn a_name_is_told_from_a_part_of_another_and_tests_from_the_program() {
    assert!(names("use proact_tasks::{Across, Task};", "Across") && !names("AcrossTheBox", "Across"));
    let text = "let a = 1;\n#[cfg(test)]\nmod tests { Across }";
    assert_eq!(program(text).map(|(number, _)| number).collect::<Vec<_>>(), [1]);
}
