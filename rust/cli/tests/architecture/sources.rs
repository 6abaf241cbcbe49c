//! Rules over the text of the sources: lints everywhere, `unsafe` in few places, no paths of one machine.

use crate::dependencies::{NATIVE, STAND_IN};
use crate::workspace::{files, load, read};
use std::collections::BTreeMap;

/// A file of more lines than this is named as a warning, of more than the second number as an error. Files that
/// long have several subjects and are read by nobody as a whole.
const LINES_TO_WARN: usize = 600;
const LINES_TO_FAIL: usize = 1000;
/// Data, not code: whoever translates the pages goes through it from one end to the other.
const WORDS: &str = "rust/bridge/web/src/strings.ts";

/// The part of a line that is code: comments may speak of what code may not do.
fn code_of(line: &str) -> &str {
    line.split("//").next().unwrap_or_default()
}

/// Whether a line of Rust has the keyword `unsafe` in front of what can be unsafe.
fn uses_unsafe(line: &str) -> bool {
    let code = code_of(line);
    ["unsafe {", "unsafe fn", "unsafe impl", "unsafe extern", "unsafe trait", "unsafe(", "(unsafe_code)"]
        .iter()
        .any(|form| code.contains(form))
}

/// Whether a line has an absolute path that exists on one person's machine only.
fn names_a_machine(line: &str) -> bool {
    ["home", "root", "Users", "work"].iter().any(|folder| {
        let path = format!("/{folder}/");
        line.match_indices(&path).any(|(start, _)| {
            // After a letter, a variable, a dot or a brace it is the tail of a relative path or of an address.
            let before = line[..start].chars().next_back();
            !before.is_some_and(|c| c.is_alphanumeric() || "_-.}$/*~)".contains(c))
        })
    })
}

#[test]
fn every_crate_takes_the_lints_of_the_workspace() {
    for name in load().members.keys() {
        let manifest = read(&format!("rust/{}/Cargo.toml", name.trim_start_matches("proact-")));
        let table: toml::Table = manifest.parse().expect("Cargo read it already");
        let inherited =
            table.get("lints").and_then(|lints| lints.get("workspace")).and_then(toml::Value::as_bool);
        assert_eq!(inherited, Some(true), "{name}: its Cargo.toml lacks [lints] workspace = true");
    }
}

#[test]
fn unsafe_stands_only_in_the_crates_that_call_cpp() {
    let allowed: Vec<String> =
        NATIVE.iter().map(|name| format!("rust/{}/", name.trim_start_matches("proact-"))).collect();
    let mut inside = 0;
    for (path, text) in files() {
        // This very file names the forms that it looks for.
        if !path.ends_with(".rs") || path.ends_with("tests/architecture/sources.rs") {
            continue;
        }
        for (number, line) in text.lines().enumerate().filter(|(_, line)| uses_unsafe(line)) {
            assert!(
                allowed.iter().any(|folder| path.starts_with(folder)),
                "{path}:{}: unsafe is allowed in {allowed:?} only: {line}",
                number + 1
            );
            inside += 1;
        }
    }
    assert!(inside > 0, "the native crates do use unsafe, so finding none means that the search is broken");
}

#[test]
fn unsafe_is_told_from_talk_about_it() {
    assert!(uses_unsafe("    let x = unsafe { call() };"));
    assert!(uses_unsafe("unsafe impl Send for Arm {}"));
    assert!(uses_unsafe("#![allow(unsafe_code)]"));
    assert!(!uses_unsafe("// SAFETY: why unsafe { } is right here"));
    assert!(!uses_unsafe("#![forbid(missing_docs)]"));
}

#[test]
fn no_file_names_a_path_of_one_machine() {
    for (path, text) in files() {
        // Git writes the place of its folder into a linked worktree.
        if path.ends_with("tests/architecture/sources.rs") || path == ".git" {
            continue;
        }
        for (number, line) in text.lines().enumerate() {
            assert!(!names_a_machine(line), "{path}:{}: absolute path of one machine: {line}", number + 1);
        }
    }
}

#[test]
fn machine_paths_are_told_from_relative_ones() {
    assert!(names_a_machine("open(\"/home/ada/arm.urdf\")"));
    assert!(names_a_machine(&["", "root", ".cargo"].join("/")));
    assert!(!names_a_machine("cp x \"$root/root/.cargo\""));
    assert!(!names_a_machine("see docs/work/plan.md"));
}

#[test]
fn no_source_file_is_too_long_to_read() {
    for (path, text) in files() {
        // What a program writes is read by none.
        let source = !path.contains("/generated/")
            && path != WORDS
            && [".rs", ".cpp", ".hpp", ".ts", ".mjs", ".py", ".sh"].iter().any(|end| path.ends_with(end));
        let lines = text.lines().count();
        if source && lines > LINES_TO_WARN {
            println!("warning: {path} has {lines} lines, more than {LINES_TO_WARN}: split it by subject");
        }
        assert!(
            !source || lines <= LINES_TO_FAIL,
            "{path} has {lines} lines, at most {LINES_TO_FAIL} are allowed"
        );
    }
}

/// The name of the public type or trait that a line declares, if it does.
fn declares(line: &str) -> Option<&str> {
    let rest = code_of(line).trim_start().strip_prefix("pub ")?;
    let kinds = ["struct ", "enum ", "trait ", "type ", "union "];
    let name = kinds.iter().find_map(|kind| rest.strip_prefix(kind))?;
    name.split(|c: char| !c.is_alphanumeric() && c != '_').next().filter(|name| !name.is_empty())
}

#[test]
fn declarations_are_told_from_uses() {
    assert_eq!(declares("pub struct Chain {"), Some("Chain"));
    assert_eq!(declares("    pub trait Plant: Send {"), Some("Plant"));
    assert_eq!(declares("pub type Posterior = [f64; 4];"), Some("Posterior"));
    for other in [
        "pub(crate) struct Chain;",
        "// pub struct Chain",
        "struct Chain;",
        "pub fn chain()",
        "pub use a::B;",
    ] {
        assert_eq!(declares(other), None, "{other}");
    }
}

#[test]
fn one_name_is_one_public_type_in_all_crates() {
    let mut declared: BTreeMap<&str, BTreeMap<&str, &str>> = BTreeMap::new();
    let files = files();
    for (path, text) in files.iter().filter(|(path, _)| path.ends_with(".rs") && path.contains("/src/")) {
        let Some(name) = path.strip_prefix("rust/").and_then(|rest| rest.split('/').next()) else { continue };
        if name == STAND_IN {
            continue;
        }
        let code = text.split("#[cfg(test)]\nmod tests").next().unwrap_or_default();
        for declaration in code.lines().filter_map(declares) {
            declared.entry(declaration).or_default().insert(name, path);
        }
    }
    assert!(declared.len() > 100, "the search is broken");
    let twice: Vec<String> = declared
        .iter()
        .filter(|(_, locations)| locations.len() > 1)
        .map(|(name, locations)| {
            format!("{name}: {}", locations.values().copied().collect::<Vec<_>>().join(", "))
        })
        .collect();
    assert!(twice.is_empty(), "one name, one thing; rename all but one of each:\n{}", twice.join("\n"));
}

/// Whether a line prints JSON on its own, and not through `answer_json`, which writes no negative zero.
fn prints_json(line: &str) -> bool {
    let code = code_of(line);
    let json = ["serde_json::to_string", "object.to_string()", "json!(", "&object"];
    let answers = code.match_indices("answer(").any(|(at, _)| !code[..at].ends_with('_'));
    answers && json.iter().any(|form| code.contains(form))
}

#[test]
fn json_answers_are_told_from_texts() {
    assert!(prints_json("answer(serde_json::to_string(&report)?)?;"));
    assert!(prints_json("answer(json!({"));
    for other in
        ["answer_json(&object)?;", "answer(text)?;", "answer(&error)?", "tell_or_answer(json, &json!({"]
    {
        assert!(!prints_json(other), "{other}");
    }
}

#[test]
fn every_answer_in_json_is_written_by_one_function() {
    let files = files();
    let sources = files.iter().filter(|(path, _)| path.starts_with("rust/cli/src/") && path.ends_with(".rs"));
    let offences: Vec<String> = sources
        .flat_map(|(path, text)| {
            text.lines().filter(|line| prints_json(line)).map(move |line| format!("{path}: {line}"))
        })
        .collect();
    assert!(offences.is_empty(), "use answer_json:\n{}", offences.join("\n"));
}
