//! Whether every command that a document shows can be typed: each is parsed as the program itself parses it.

use super::*;
use clap::error::ErrorKind;
use std::{fs, path::Path};

/// Words that the launcher answers itself, and what the guide writes for any of them.
const LAUNCHER_WORDS: [&str; 7] = ["test", "peers", "release", "docs", "ros-binary", "help", "WORD"];
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
            found.push(shell_words(words));
        }
    }
    found
}

/// Every call of the program in single backticks, outside of code blocks, up to `, then` or dots for the rest.
fn commands_in_prose(document: &str) -> Vec<Vec<String>> {
    let prose: String = document.split("```").step_by(2).collect();
    let in_backticks = prose.split('`').skip(1).step_by(2);
    let called = in_backticks.filter_map(|code| code.trim_start_matches("./").strip_prefix("proact "));
    let own =
        |words: &str| words.split(", then").next().unwrap_or_default().trim_end_matches("...").to_owned();
    // A line may break within.
    called.map(|words| shell_words(&own(words).replace('\n', " "))).collect()
}

/// The words of a command as a shell takes them, up to what is no longer the command.
fn shell_words(text: &str) -> Vec<String> {
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
fn parse_error(words: &[String]) -> Option<String> {
    try_parse(words).err().map(|(_, text)| text)
}

/// Prose leaves out what a command needs, and writes NAME or a choice for a value: its commands and options have to be there.
fn parse_error_in_prose(words: &[String]) -> Option<String> {
    let wrong = [ErrorKind::UnknownArgument, ErrorKind::InvalidSubcommand, ErrorKind::ArgumentConflict];
    try_parse(words).err().filter(|(kind, _)| wrong.contains(kind)).map(|(_, text)| text)
}

/// Or the kind of what is wrong with it, and the message.
fn try_parse(words: &[String]) -> Result<(), (ErrorKind, String)> {
    let mut registry: Registry = proact_control::MethodRegistry::standard().into();
    // Files of methods are read before the command is parsed; documents name them from the repository's folder.
    let link = |word: &String| match word.strip_prefix("docs/") {
        Some(_) => root().join(word).into_os_string(),
        None => word.into(),
    };
    let words = ["proact".into()].into_iter().chain(words.iter().map(link)).collect();
    let (methods, words) = match method_files::register_method_files(registry.methods, words) {
        Ok(taken) => taken,
        Err(error) => return Err((ErrorKind::ValueValidation, error.to_string())),
    };
    registry.methods = methods;
    let parsed = build_command_line(&registry)
        .try_get_matches_from(words)
        .and_then(|found| Cli::from_arg_matches(&found));
    match parsed {
        // Help and version are no errors.
        Err(error) if error.use_stderr() => Err((error.kind(), error.to_string())),
        _ => Ok(()),
    }
}

#[test]
fn every_command_in_the_documents_can_be_typed() {
    let mut checked = 0;
    let mut refused = Vec::new();
    let program = build_command_line(&proact_control::MethodRegistry::standard().into());
    for document in documents() {
        let text = fs::read_to_string(root().join(&document)).unwrap();
        let of_blocks = commands_in(&text).into_iter().map(|command| (parse_error(&command), command));
        // The changelog names what was.
        let prose = if document == "CHANGELOG.md" { Vec::new() } else { commands_in_prose(&text) };
        let of_prose = prose.into_iter().map(|command| (parse_error_in_prose(&command), command));
        for (refusal, command) in of_blocks.chain(of_prose) {
            if command.first().is_none_or(|word| LAUNCHER_WORDS.contains(&word.as_str())) {
                continue;
            }
            checked += 1;
            let shown = command.join(" ");
            refused.extend(refusal.map(|error| format!("{document}: proact {shown}\n{error}")));
            // The changelog names what was.
            if document != "CHANGELOG.md" {
                let words: Vec<_> = ["proact"]
                    .into_iter()
                    .chain(command.iter().map(String::as_str))
                    .map(Into::into)
                    .collect();
                let old = crate::renames::rename_warnings(&program, &words);
                refused.extend(old.iter().map(|warning| format!("{document}: proact {shown}\n{warning}\n")));
            }
        }
    }
    assert!(refused.is_empty(), "{} of {checked} commands:\n\n{}", refused.len(), refused.join("\n"));
    assert!(checked > 150, "the documents show more commands than {checked}");
}

#[test]
fn what_cannot_be_typed_is_found() {
    let words = |text: &str| shell_words(text);
    for (good, bad) in [
        ("demo --headless", "demo --headles"),
        ("demo --method D --seed 1", "demo --method D --seed one"),
        ("study check pilot", "study chek pilot"),
        ("demo --method docs/methods/follow_gaze.toml", "demo --method docs/methods/nobodys.toml"),
        ("demo --help", "replay"),
    ] {
        assert_eq!(parse_error(&words(good)), None, "{good}");
        assert!(parse_error(&words(bad)).is_some(), "{bad}");
    }
    for (good, bad) in
        [("bench STAGE --json", "bench STAGE --jsn"), ("replay", "replays"), ("study check", "study chek")]
    {
        assert_eq!(parse_error_in_prose(&words(good)), None, "{good}");
        assert!(parse_error_in_prose(&words(bad)).is_some(), "{bad}");
    }
    let prose = "Type `./proact demo, then /emg`, or `proact\nstudy`.\n```\nproact no\n```\nSo `proact serve\n--port 8091`.";
    assert_eq!(commands_in_prose(prose), [vec!["demo"], vec!["serve", "--port", "8091"]]);
}

/// The default of `emg test --tests` was shown as `sequence trial`, which the option does not take; `--steering` and
/// `localize shoulder --box-offset` did not take the values with commas that help and documents show.
#[test]
fn a_list_is_typed_with_commas_as_its_default_is_shown() {
    fn check(command: &clap::Command) {
        for argument in command.get_arguments().filter(|argument| argument.get_value_delimiter().is_some()) {
            let name = format!("{} --{}", command.get_name(), argument.get_id());
            assert!(
                argument.get_default_values().len() <= 1,
                "{name}: the default is shown with spaces between"
            );
            let min_words = argument.get_num_args().map_or(1, |count| count.min_values());
            assert!(
                min_words <= 1,
                "{name}: {min_words} words are needed, so that values with commas between are refused"
            );
        }
        command.get_subcommands().for_each(check);
    }
    let mut command = Cli::command();
    command.build();
    check(&command);
    for typed in [
        "emg test --model me.json --source synthetic --tests motion,tac1",
        "emg test --model me.json --source synthetic --steering wave_out,wave_in,spread,fist",
        "emg test --model me.json --source synthetic --steering wave_out wave_in spread fist",
        "localize shoulder rest.csv --body Shoulderpad --box-offset 0.02,0,-0.01",
        "localize shoulder rest.csv --body Shoulderpad --box-offset 0.02 0 -0.01",
    ] {
        assert_eq!(parse_error(&shell_words(typed)), None, "{typed}");
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
