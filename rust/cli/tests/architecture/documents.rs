//! Whether the documents still say what is so: the crates in ARCHITECTURE.md, the commands in README and guide.

use std::collections::BTreeSet;
use std::process::Command;

use crate::dependencies::STAND_IN;
use crate::workspace::{load, read, root};

/// Words that the launcher answers itself; every other word is a command of the program.
const LAUNCHER_WORDS: [&str; 4] = ["test", "peers", "help", "--help"];
/// Commands whose next word is a command of its own.
const GROUPS: [&str; 6] = ["emg", "model", "study", "bench", "participants", "localize"];

/// The documents whose commands a reader will type.
const GUIDES: [&str; 2] = ["README.md", "docs/user_guide.md"];
/// The one whose commands stand in a table, between backquotes.
const PEERS: &str = "docs/peers.md";

/// Every `./proact ...` line in the code blocks of a document, without its comment.
fn commands_in(document: &str) -> Vec<Vec<String>> {
    let mut inside = false;
    let mut found = Vec::new();
    for line in document.lines() {
        if line.starts_with("```") {
            inside = !inside;
        } else if inside && let Some(start) = line.find("./proact ") {
            let command = line[start..].split(" #").next().unwrap_or_default();
            let command = command.split(['|', '>', '<', ';']).next().unwrap_or_default();
            found.push(command.split_whitespace().skip(1).map(str::to_owned).collect());
        }
    }
    found
}

/// Every `./proact ...` between backquotes on a line.
fn inline_commands_in(document: &str) -> Vec<Vec<String>> {
    let quoted = document.lines().flat_map(|line| line.split('`').skip(1).step_by(2));
    quoted
        .filter_map(|text| text.strip_prefix("./proact "))
        .map(|words| words.split_whitespace().map(str::to_owned).collect())
        .collect()
}

/// What `proact WORDS --help` prints, or the complaint when it fails.
fn help_of(words: &[String]) -> Result<String, String> {
    let output = Command::new(env!("CARGO_BIN_EXE_proact"))
        .args(words)
        .arg("--help")
        .output()
        .map_err(|error| format!("the program cannot be run: {error}"))?;
    if output.status.success() {
        Ok(String::from_utf8_lossy(&output.stdout).into_owned())
    } else {
        Err(String::from_utf8_lossy(&output.stderr).into_owned())
    }
}

#[test]
fn every_command_in_the_guides_exists_with_its_options() {
    let mut checked = 0;
    let typed = GUIDES.into_iter().map(|guide| (guide, commands_in(&read(guide))));
    for (guide, commands) in typed.chain([(PEERS, inline_commands_in(&read(PEERS)))]) {
        for command in commands {
            let Some(word) = command.first() else { continue };
            if LAUNCHER_WORDS.contains(&word.as_str()) {
                continue;
            }
            let depth = if GROUPS.contains(&word.as_str()) { 2 } else { 1 };
            let words: Vec<String> =
                command.iter().take(depth).filter(|w| !w.starts_with('-')).cloned().collect();
            let shown = command.join(" ");
            let help = help_of(&words).unwrap_or_else(|error| panic!("{guide}: ./proact {shown}: {error}"));
            for option in command.iter().filter(|word| word.starts_with("--")) {
                let name = option.split('=').next().unwrap_or_default();
                assert!(help.contains(name), "{guide}: ./proact {shown}: there is no {name} in\n{help}");
            }
            checked += 1;
        }
    }
    assert!(checked > 5, "the guides show more commands than {checked}");
}

#[test]
fn commands_are_found_in_code_blocks_only() {
    let document = "Type `./proact demo`.\n```\n./proact demo --method D   # watch\n./proact query < lines\n```\n./proact no";
    assert_eq!(commands_in(document), [vec!["demo", "--method", "D"], vec!["query"]]);
}

#[test]
fn each_feature_that_is_here_has_a_command_that_shows_it() {
    let document = read(PEERS);
    let rows = |part: &str| -> Vec<Vec<String>> {
        let cells = |line: &str| line.split('|').map(|cell| cell.trim().to_owned()).collect::<Vec<_>>();
        part.lines().map(cells).filter(|row| row.get(1).is_some_and(|n| n.parse::<u32>().is_ok())).collect()
    };
    let (features, shown) = document.split_once("## How to see it here").expect("two tables");
    let shown = rows(shown);
    let features = rows(features);
    assert!(features.len() > 30);
    for row in features {
        let command = shown.iter().find(|other| other[1] == row[1]).map(|other| other[2].as_str());
        let here = row[row.len() - 2].as_str();
        let expected = here == "**Y**" || here == "**P**";
        assert!(expected || here == "**-**", "{row:?}");
        assert_eq!(command.is_some_and(|command| !command.is_empty()), expected, "{}: {command:?}", row[2]);
    }
}

#[test]
fn inline_commands_are_those_between_backquotes() {
    let line = "| 3 | `./proact demo --arm wam`, `head LICENSE` | ./proact no | `./proact test` |";
    assert_eq!(inline_commands_in(line), [vec!["demo", "--arm", "wam"], vec!["test"]]);
}

#[test]
fn the_architecture_lists_exactly_the_crates_of_the_workspace() {
    let text = read("ARCHITECTURE.md");
    let listed: BTreeSet<String> = text
        .lines()
        .filter_map(|line| line.strip_prefix("| `")?.split('`').next())
        .filter(|name| name.starts_with("proact-") || *name == STAND_IN)
        .map(str::to_owned)
        .collect();
    let crates: BTreeSet<String> = load().members.into_keys().collect();
    assert_eq!(listed, crates, "left: ARCHITECTURE.md, right: the workspace");
}

#[test]
fn every_crate_has_a_readme_of_a_few_lines_with_its_name() {
    for name in load().members.into_keys() {
        let folder = match name.as_str() {
            STAND_IN => STAND_IN,
            own => own.strip_prefix("proact-").expect("crates are called proact-<folder>"),
        };
        let text = read(&format!("rust/{folder}/README.md"));
        assert!(text.starts_with(&format!("# {name}: ")), "rust/{folder}/README.md begins with another name");
        let lines = text.lines().count();
        assert!((5..40).contains(&lines), "rust/{folder}/README.md has {lines} lines");
    }
}

/// Words in backquotes that can only be the name of a test: a sentence of several words.
fn test_names_in(document: &str) -> BTreeSet<String> {
    let sentence = |word: &&str| {
        let plain = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_';
        word.matches('_').count() >= 4 && word.chars().all(plain)
    };
    document.split('`').skip(1).step_by(2).filter(sentence).map(str::to_owned).collect()
}

#[test]
fn tests_that_the_list_of_differences_names_exist() {
    let mut sources = String::new();
    let mut folders = vec![root().join("rust")];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).expect("the folder is there") {
            let path = entry.expect("an entry").path();
            if path.is_dir() && !path.ends_with("node_modules") {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                sources += &std::fs::read_to_string(&path).expect("a source is text");
            }
        }
    }
    let list = read("docs/differences.md");
    let names = test_names_in(&list);
    let missing: Vec<&String> =
        names.iter().filter(|name| !sources.contains(&format!("fn {name}("))).collect();
    assert!(missing.is_empty(), "docs/differences.md names tests that do not exist: {missing:?}");
    assert!(names.len() > 30, "the list names more tests than {}", names.len());
    // Each of the defects of control, hand and gaze has its row.
    for defect in 13..=45 {
        assert!(list.contains(&format!("\n| {defect} | ")), "defect {defect} is not in the list");
    }
}

#[test]
fn sentences_are_taken_for_tests_and_other_words_are_not() {
    let names =
        test_names_in("fixed: `a_look_at_a_block_wins` (`rust/intent`), `length_m`, a_b_c_d_e, `Plan::a`");
    assert_eq!(names.into_iter().collect::<Vec<_>>(), ["a_look_at_a_block_wins"]);
}

#[test]
fn links_between_documents_lead_somewhere() {
    let mut checked = 0;
    for document in
        ["README.md", "ARCHITECTURE.md", "CONTRIBUTING.md", "docs/user_guide.md", "docs/differences.md"]
    {
        let folder = root().join(document).parent().expect("a file lies in a folder").to_path_buf();
        for part in read(document).split("](").skip(1) {
            let target = part.split([')', '#']).next().unwrap_or_default();
            // Addresses are not files; anchors within a document are empty here.
            if target.is_empty() || target.contains(':') {
                continue;
            }
            assert!(folder.join(target).exists(), "{document} links to {target}, which does not exist");
            checked += 1;
        }
    }
    assert!(checked > 3, "the documents have more links than {checked}");
}

#[test]
fn every_file_that_names_the_version_names_the_same() {
    let manifest: toml::Table = read("Cargo.toml").parse().expect("Cargo read it already");
    let version = manifest["workspace"]["package"]["version"].as_str().expect("a version").to_owned();
    let cited = read("CITATION.cff");
    let cited = cited.lines().find_map(|line| line.strip_prefix("version: "));
    assert_eq!(cited, Some(version.as_str()), "CITATION.cff");
    // catkin takes numbers alone.
    let release = version.split('-').next().expect("a version");
    for package in
        ["proact_bringup", "proact_description", "proact_moveit_config", "proact_msgs", "proact_nodes"]
    {
        let text = read(&format!("ros1_ws/src/{package}/package.xml"));
        assert!(
            text.contains(&format!("<version>{release}</version>")),
            "{package}/package.xml is not of {release}"
        );
    }
    let page: serde_json::Value =
        serde_json::from_str(&read("rust/bridge/web/package.json")).expect("npm reads it");
    assert_eq!(page["version"], version.as_str(), "rust/bridge/web/package.json");
    let changes = read("CHANGELOG.md");
    let newest = changes.lines().find_map(|line| line.strip_prefix("## ")).expect("a section");
    assert!(newest == "Unreleased" || newest.starts_with(&version), "CHANGELOG.md begins with {newest:?}");
}
