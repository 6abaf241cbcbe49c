//! Whether every command that a document shows can be typed: each is parsed as the program itself parses it.

use super::*;
use std::{fs, path::Path};

/// Words that the launcher answers itself.
const LAUNCHER_WORDS: [&str; 6] = ["test", "peers", "release", "docs", "ros-binary", "help"];
/// What a document is below the repository, and nothing else of it.
const FOLDERS: [&str; 6] = ["", "docs", "docs/methods", "docs/tasks", "python", "docker"];

/// The repository.
fn root() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
}

/// The documents whose commands a reader types.
fn documents() -> Vec<String> {
    let mut found = Vec::new();
    for folder in FOLDERS {
        let entries = fs::read_dir(root().join(folder)).unwrap().map(|entry| entry.unwrap().file_name());
        let names = entries.map(|name| name.into_string().unwrap()).filter(|name| name.ends_with(".md"));
        found.extend(names.map(|name| format!("{folder}/{name}").trim_start_matches('/').to_owned()));
    }
    found.sort();
    found
}

/// Every line of a document's code blocks that calls the program, as the words after its name. What follows a `#` or three spaces is
/// an explanation, and a backslash at the end goes on with the next line.
fn commands_in(document: &str) -> Vec<Vec<String>> {
    let mut inside = false;
    let mut found = Vec::new();
    let parts: Vec<&str> = document.split("\\\n").map(|part| part.trim_start_matches(' ')).collect();
    let joined = parts.join("");
    for line in joined.lines() {
        if line.trim_start().starts_with("```") {
            inside = !inside;
            continue;
        }
        let called = ["./proact ", "proact "].into_iter().find_map(|name| {
            let rest = line.trim_start();
            // After a pipe, too.
            let start = if rest.starts_with(name) {
                Some(0)
            } else {
                rest.find(&format!("| {name}")).map(|at| at + 2)
            };
            start.map(|at| &rest[at + name.len()..])
        });
        if let Some(words) = called.filter(|_| inside) {
            found.push(words_of(words));
        }
    }
    found
}

/// The words of a command as a shell takes them, up to what is no longer the command.
fn words_of(text: &str) -> Vec<String> {
    let mut words = Vec::new();
    let mut word: Option<String> = None;
    let mut quote = None;
    let mut spaces = 0;
    for character in text.chars() {
        match (quote, character) {
            (Some(open), _) if open == character => quote = None,
            (Some(_), _) => word.get_or_insert_default().push(character),
            (None, '\'' | '"') => {
                quote = Some(character);
                word.get_or_insert_default();
            }
            (None, ' ') => {
                words.extend(word.take());
                spaces += 1;
                if spaces == 3 {
                    return words;
                }
                continue;
            }
            (None, '#' | '|' | '>' | '<' | ';' | '&') if word.is_none() => return words,
            (None, _) => word.get_or_insert_default().push(character),
        }
        spaces = 0;
    }
    words.extend(word);
    words
}

/// What the program says of a command that it does not take.
fn refusal(words: &[String]) -> Option<String> {
    let mut registry: Registry = proact_control::MethodRegistry::standard().into();
    // Files of methods are read before the command is parsed; documents name them from the repository's folder.
    let place = |word: &String| match word.strip_prefix("docs/") {
        Some(_) => root().join(word).into_os_string(),
        None => word.into(),
    };
    let words = ["proact".into()].into_iter().chain(words.iter().map(place)).collect();
    let (methods, words) = match method_files::taken_from(registry.methods, words) {
        Ok(taken) => taken,
        Err(error) => return Some(error.to_string()),
    };
    registry.methods = methods;
    let parsed =
        offering(&registry).try_get_matches_from(words).and_then(|found| Cli::from_arg_matches(&found));
    let error = parsed.err()?;
    // Help and version are no errors.
    error.use_stderr().then(|| error.to_string())
}

#[test]
fn every_command_in_the_documents_can_be_typed() {
    let mut checked = 0;
    let mut refused = Vec::new();
    for document in documents() {
        let text = fs::read_to_string(root().join(&document)).unwrap();
        for command in commands_in(&text) {
            if command.first().is_none_or(|word| LAUNCHER_WORDS.contains(&word.as_str())) {
                continue;
            }
            checked += 1;
            let shown = command.join(" ");
            refused.extend(refusal(&command).map(|error| format!("{document}: proact {shown}\n{error}")));
        }
    }
    assert!(refused.is_empty(), "{} of {checked} commands:\n\n{}", refused.len(), refused.join("\n"));
    assert!(checked > 150, "the documents show more commands than {checked}");
}

#[test]
fn what_cannot_be_typed_is_found() {
    let words = |text: &str| words_of(text);
    for (good, bad) in [
        ("demo --headless", "demo --headles"),
        ("demo --method D --seed 1", "demo --method D --seed one"),
        ("study check pilot", "study chek pilot"),
        ("demo --method docs/methods/follow_gaze.toml", "demo --method docs/methods/nobodys.toml"),
        ("demo --help", "replay"),
    ] {
        assert_eq!(refusal(&words(good)), None, "{good}");
        assert!(refusal(&words(bad)).is_some(), "{bad}");
    }
}

#[test]
fn commands_are_taken_as_a_shell_takes_them() {
    let document = "Type `proact demo`.\n```sh\n./proact demo --set 'a=[{ b = 1 }, c]'   # watch\n  proact node sim      the simulator\n\
        echo '{}' | ./proact query > answers\n./proact demo --method A \\\n    --seed 2\nnode proact x\n```\nproact no";
    let commands = commands_in(document);
    let expected: [&[&str]; 4] = [
        &["demo", "--set", "a=[{ b = 1 }, c]"],
        &["node", "sim"],
        &["query"],
        &["demo", "--method", "A", "--seed", "2"],
    ];
    assert_eq!(commands, expected);
}
