//! Manual pages and completions, as a package installs them.
#![allow(clippy::disallowed_methods, clippy::unwrap_used)] // A test of files and processes.

use std::{collections::BTreeSet, fs, process::Command};

fn output_of(words: &[&str]) -> String {
    let output = Command::new(env!("CARGO_BIN_EXE_proact")).args(words).output().unwrap();
    assert!(output.status.success(), "{words:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

/// The names of the commands that the help lists below a command.
fn commands_of(words: &[&str]) -> Vec<String> {
    let help = output_of(&[words, &["--help"]].concat());
    let Some((_, list)) = help.split_once("Commands:\n") else { return Vec::new() };
    let lines = list.lines().take_while(|line| !line.is_empty());
    let names = lines.filter_map(|line| line.strip_prefix("  ")?.split_whitespace().next());
    names.filter(|name| *name != "help").map(str::to_owned).collect()
}

#[test]
fn every_command_has_a_manual_page_with_its_options() {
    let folder = tempfile::tempdir().unwrap();
    output_of(&["man", &folder.path().join("made/man1").to_string_lossy()]);
    let pages: BTreeSet<String> = fs::read_dir(folder.path().join("made/man1"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    let mut expected = vec!["proact.1".to_owned()];
    for command in commands_of(&[]) {
        expected.push(format!("proact-{command}.1"));
        expected.extend(commands_of(&[&command]).iter().map(|sub| format!("proact-{command}-{sub}.1")));
    }
    assert!(expected.len() > 40, "{expected:?}");
    let missing: Vec<&String> = expected.iter().filter(|page| !pages.contains(*page)).collect();
    assert!(missing.is_empty(), "{missing:?} of {pages:?}");
    let demo = fs::read_to_string(folder.path().join("made/man1/proact-demo.1")).unwrap();
    for part in ["\\-\\-headless", "imitate", "Examples:"] {
        assert!(demo.contains(part), "{part} in\n{demo}");
    }
}

#[test]
fn a_folder_that_cannot_be_made_is_named() {
    let file = tempfile::NamedTempFile::new().unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_proact")).arg("man").arg(file.path()).output().unwrap();
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success() && stderr.contains(&*file.path().to_string_lossy()), "{stderr}");
}

#[test]
fn completions_know_the_commands_and_what_can_be_chosen() {
    for (shell, parts) in [
        ("bash", ["complete -F _proact", "--headless", "imitate"]),
        ("zsh", ["#compdef proact", "--headless", "imitate"]),
        ("fish", ["complete -c proact", "-l headless", "imitate"]),
    ] {
        let script = output_of(&["completions", shell]);
        for part in parts {
            assert!(script.contains(part), "{shell}: no {part}");
        }
    }
    // bash is on every machine that these tests run on: the script parses, and completes a word.
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("completions"), output_of(&["completions", "bash"])).unwrap();
    let completion_script = ". ./completions; COMP_WORDS=(proact stud); COMP_CWORD=1; _proact proact stud proact; echo \"<${COMPREPLY[*]}>\"";
    let output = Command::new("bash")
        .args(["--norc", "-c", completion_script])
        .current_dir(folder.path())
        .output()
        .unwrap();
    let complaint = String::from_utf8_lossy(&output.stderr);
    assert_eq!(String::from_utf8_lossy(&output.stdout), "<study>\n", "{complaint}");
}

#[test]
fn the_version_is_one_line_for_the_program_and_one_for_each_library() {
    let text = output_of(&["--version"]);
    assert!(text.starts_with(concat!("proact ", env!("CARGO_PKG_VERSION"))), "{text}");
    for library in ["\nFCL ", "\nKDL ", "\nODE ", "\nOMPL ", "\nlibccd ", "\nurdfdom "] {
        assert!(text.contains(library), "{library:?} in {text}");
    }
    assert_eq!(output_of(&["-V"]).lines().count(), 1);
}
