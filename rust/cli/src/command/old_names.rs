//! Whether everything under an old name goes on as under the new one, and says so.

use super::*;
use crate::renames::{
    RENAMED_COMMANDS, RENAMED_FLAGS, RENAMED_KEYS, RenamedCommand, RenamedFlag, RenamedValueKey,
    rename_warnings,
};
use clap::error::ErrorKind;
use std::{collections::BTreeSet, ffi::OsString, fs, path::Path};

/// The page of renames, whose section on flags follows from the table.
const PAGE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/renames.md");
const SECTION: &str = "## Flags and commands\n";
/// A file that a decoder's program is described in.
const DECODER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/decoders/nearest_centroid.toml");

/// What each command needs at least.
const COMMANDS: &[(&str, &str)] = &[
    ("demo", "demo"),
    ("run", "run trial.toml"),
    ("serve", "serve"),
    ("node", "node testbed"),
    ("simulate", "simulate"),
    ("compare", "compare A B"),
    ("replay", "replay trial"),
    ("bench", "bench planning"),
    ("analyze", "analyze trials"),
    ("doctor", "doctor"),
    ("participants predict", "participants predict"),
    ("localize reach", "localize reach"),
    ("localize shoulder", "localize shoulder rest.csv --body Pad"),
    ("localize headset", "localize headset minute.csv"),
    ("model import", "model import arm.urdf --out arm"),
    ("study new", "study new pilot"),
    ("study run", "study run pilot"),
    ("study export", "study export pilot"),
    ("study power", "study power pilot"),
    ("emg evaluate", "emg evaluate --data folder"),
    ("emg features", "emg features --data folder"),
    ("emg select", "emg select --data folder"),
    ("emg train", "emg train --source synthetic"),
    ("emg stream", "emg stream --source synthetic"),
    ("emg test", "emg test --model me.json --source synthetic"),
    ("emg simulate", "emg simulate"),
];

/// By the new name: a value that is not the default, none for a switch, and what else has to be given.
const VALUES: &[(&str, &str, &str)] = &[
    ("--time-limit", "7", ""),
    ("--participant-kind", "person", ""),
    ("--enroll", "", "--participant P07"),
    ("--usage-log", "usage.log", ""),
    ("--reachability-timeout", "5", ""),
    ("--emg-train-repetitions", "3,4", ""),
    ("--emg-test-repetitions", "5", ""),
    ("--fill-missing", "synthetic", ""),
    ("--no-wait", "", ""),
    ("--override", "intent.sigma=0.05", ""),
    ("--sweep", "intent.sigma=0.01,0.02", ""),
    ("--full-physics", "1", ""),
    ("--master-seeds", "5,6", ""),
    ("--intent-options", "options.toml", "--intent"),
    ("--rosbridge-allow", "10.0.0.1", "--rosbridge=9090"),
    ("--upper-arm-body", "UpperArm", "--circles circles.csv"),
    ("--left-arm", "", ""),
    ("--half-shoulder-width", "0.2", ""),
    ("--box-placement", "study_1", ""),
    ("--knee-distance", "0.3", ""),
    ("--box-offset", "0.02,0,-0.01", ""),
    ("--marker-body", "HololensSG", ""),
    ("--replace", "", ""),
    ("--template", "study1", ""),
    ("--extra-format", "armsym", ""),
    ("--keep-pseudonyms", "", ""),
    ("--pilot", "pilot", ""),
    ("--participants", "5,7", "--effect effect.toml"),
    ("--alpha", "0.01", "--effect effect.toml"),
    ("--ridge-penalty", "2", ""),
    ("--decoder-process", DECODER, ""),
    ("--site-gestures", "hand_open/hand_close", ""),
    ("--site-channels", "hand_open=1,hand_close=2", ""),
    ("--cocontraction-window", "90", ""),
    ("--cocontraction-gesture", "hand_close", ""),
    ("--train-repetitions", "3,4", ""),
    ("--test-repetitions", "5", ""),
    ("--max-features", "3", ""),
    ("--repetitions", "1,0", ""),
    ("--gesture-sequence", "hand_open:1,hand_close:2", ""),
    ("--amplifier", "delsys", "--lsl stream"),
    ("--loss-rate", "0.1", ""),
    ("--duplicate-rate", "0.1", ""),
    ("--reorder-rate", "0.1", ""),
    ("--truncation-rate", "0.1", ""),
    ("--jitter-ms", "3", ""),
    ("--notification-bytes", "20", ""),
    ("--no-sequence-numbers", "", ""),
    ("--battery-percent", "5", ""),
    ("--source-repetition", "1", ""),
    ("--no-realtime", "", ""),
    ("--adc-zero", "127", ""),
    ("--adc-bits", "12", ""),
    ("--packet-bytes", "32", ""),
    ("--max-rounds", "9", ""),
    ("--min-rounds", "3", ""),
    ("--target-accuracy", "0.8", ""),
    ("--repetition-seconds", "2", ""),
    ("--prepare-seconds", "1", ""),
    ("--band-check", "earlier.json", ""),
    ("--accept-rotation", "", "--band-check earlier.json"),
    ("--timeout", "9", ""),
    ("--consecutive-sequences", "4", ""),
    ("--max-sequences", "20", ""),
    ("--motion-repetitions", "4", ""),
    ("--tac-repetitions", "3", ""),
    ("--cursor-targets", "11", ""),
];

fn registry() -> Registry {
    proact_control::MethodRegistry::standard().into()
}

fn split(line: &str) -> Vec<OsString> {
    std::iter::once("proact").chain(line.split_whitespace()).map(OsString::from).collect()
}

/// What the program makes of a line, all of it.
fn parse(line: &str) -> Result<String, clap::Error> {
    let found = build_command_line(&registry()).try_get_matches_from(split(line))?;
    Ok(format!("{:?}", Cli::from_arg_matches(&found)?))
}

fn warnings(line: &str) -> Vec<String> {
    rename_warnings(&build_command_line(&registry()), &split(line))
}

/// The least that `command` takes.
fn minimal(command: &str) -> &'static str {
    COMMANDS.iter().find(|(name, _)| *name == command).unwrap_or_else(|| panic!("no line for {command}")).1
}

#[test]
fn an_old_flag_means_what_the_new_one_means_and_is_told_once() {
    for &RenamedFlag { old, new, commands } in &RENAMED_FLAGS {
        let &(_, value, others) =
            VALUES.iter().find(|(name, ..)| *name == new).unwrap_or_else(|| panic!("no value for {new}"));
        for &command in commands {
            let others = match (command, new) {
                ("study run", "--participant-kind") => "--simulated",
                _ => others,
            };
            let line = format!("{} {others}", minimal(command));
            let with = |flag: &str| format!("{line} {flag} {value}");
            let expected = parse(&with(new)).unwrap_or_else(|error| panic!("{command} {new}: {error}"));
            assert_eq!(parse(&with(old)).unwrap(), expected, "{command} {old}");
            // Where the flag can be left out, it says something.
            assert!(parse(&line).map_or(true, |without| without != expected), "{command} {new} does nothing");
            let warning = [format!("{old} is now {new}")];
            assert_eq!(warnings(&with(old)), warning, "{command}");
            assert_eq!(warnings(&with(new)), [""; 0], "{command} {new}");
            let joined = format!("{line} {old}={value}");
            if !value.is_empty() {
                assert_eq!(parse(&joined).unwrap(), expected, "{command} {old}=");
                assert_eq!(
                    warnings(&format!("{joined} {joined}")),
                    warning,
                    "{command}: told more than once"
                );
            }
            check_both_names(command, new, &format!("{} {new} {value}", with(old)));
        }
    }
}

/// A list takes values under both names, all else is refused in the words of a flag that is given twice.
fn check_both_names(command: &str, new: &str, line: &str) {
    let program = build_command_line(&registry());
    let below = command.split(' ').fold(&program, |above, name| above.find_subcommand(name).unwrap());
    let argument =
        below.get_arguments().find(|argument| argument.get_long() == new.strip_prefix("--")).unwrap();
    match (argument.get_action(), parse(line)) {
        (clap::ArgAction::Append, both) => assert!(both.is_ok(), "{line}"),
        (_, both) => {
            let error = both.expect_err(line);
            assert_eq!(error.kind(), ErrorKind::ArgumentConflict, "{line}");
            let text = error.to_string();
            assert!(text.contains(new) && text.contains("cannot be used multiple times"), "{text}");
        }
    }
}

#[test]
fn an_old_key_in_a_value_means_what_the_new_one_means_and_is_told_once() {
    for &RenamedValueKey { flag, old, new, commands } in &RENAMED_KEYS {
        for &command in commands {
            let needs = match command {
                "localize shoulder" => "",
                "localize headset" => "--marker-body M",
                _ => "--mocap vrpn:127.0.0.1/Pad",
            };
            let with = |between: &str, key: &str| {
                format!("{} {needs} {flag}{between}up=y,{key}=0.001", minimal(command))
            };
            let expected = parse(&with(" ", new)).unwrap_or_else(|error| panic!("{command}: {error}"));
            for between in [" ", "="] {
                assert_eq!(parse(&with(between, old)).unwrap(), expected, "{command}");
                assert_eq!(warnings(&with(between, old)), [format!("{old} is now {new}")], "{command}");
                assert_eq!(warnings(&with(between, new)), [""; 0], "{command}");
            }
        }
    }
}

#[test]
fn an_old_command_is_the_new_one_and_is_told_once() {
    for &RenamedCommand { parent, old, new } in &RENAMED_COMMANDS {
        let line = |name: &str| format!("{parent} {name} words");
        assert_eq!(parse(&line(old)).unwrap(), parse(&line(new)).unwrap(), "{old}");
        let warning = format!("{parent} {old} is now {parent} {new}").trim_start().replace("now  ", "now ");
        assert_eq!(warnings(&line(old)), [warning]);
        assert_eq!(warnings(&line(new)), [""; 0]);
    }
    assert_eq!(warnings("bless why"), ["bless is now update-digests"]);
    assert_eq!(warnings("emg use log"), ["emg use is now emg usage"]);
}

#[test]
fn words_that_are_no_flags_are_not_told_of() {
    for line in [
        // Values, and what follows two hyphens.
        "simulate --out x --slurm=4 --sbatch-option --limit=3",
        "simulate --out x --slurm=4 --sbatch-option --people",
        "update-digests -- --limit",
        "demo --method bless",
        "update-digests bless",
        "model import --out use arm.urdf",
        // Flags of this name that are still what they were.
        "simulate --seeds 4",
        "demo --like minivie --arm mpl_left --profile original",
        "study power pilot --effect e --alpha 0.05",
        "emg test --model m --source synthetic --tests tac1",
    ] {
        assert_eq!(warnings(line), [""; 0], "{line}");
    }
    assert_eq!(
        warnings("demo --limit 3 --exit --allow 10.0.0.1 --like minivie"),
        ["--limit is now --time-limit", "--exit is now --no-wait", "--allow is now --rosbridge-allow"]
    );
}

/// The contract of `design.md`, section 5, in its own words.
#[test]
fn flags_that_programs_rely_on_are_taken_as_before() {
    for line in [
        "demo --headless --task bbt --arm mpl_left --method D --seed 3 --setup seated --emg folder --out out --like minivie --json",
        "replay trial --as intent.sigma=0.05,intent_model=filtered --json",
        "emg evaluate --data folder --train-reps 0,1 --test-reps 2 --window 100 --increment 50 --unit ms --features HTD --json",
        "emg features --data folder --train-reps 0,1 --test-reps 2 --unit samples --features HTD",
        "emg features --csv file.csv --out out.csv --header",
        "simulate --seeds 4 --limit 5 --json",
    ] {
        assert!(parse(line).is_ok(), "{line}: {:?}", parse(line));
    }
}

/// All that describes a command line: help, completions, manual pages.
fn descriptions(mut command: clap::Command) -> String {
    fn add_pages(text: &mut Vec<u8>, command: &clap::Command) {
        text.extend(command.clone().render_long_help().to_string().into_bytes());
        clap_mangen::Man::new(command.clone()).render(text).unwrap();
        command.get_subcommands().for_each(|below| add_pages(text, below));
    }
    let mut text = Vec::new();
    for shell in [clap_complete::Shell::Bash, clap_complete::Shell::Zsh, clap_complete::Shell::Fish] {
        clap_complete::generate(shell, &mut command, "proact", &mut text);
    }
    command.build();
    add_pages(&mut text, &command);
    String::from_utf8(text).unwrap()
}

#[test]
fn help_completions_and_manuals_have_new_names_alone() {
    let shown = descriptions(build_command_line(&registry()));
    assert!(shown == descriptions(build_with_new_names(&registry())), "an old name is shown");
    assert!(shown.contains("--time-limit") && shown.contains("update-digests") && !shown.contains("bless"));
}

/// The section that follows from the table.
fn section() -> String {
    let commands =
        |names: &[&str]| names.iter().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ");
    let mut text = format!(
        "{SECTION}\nThe old name is still accepted and says so once on standard error. Help, completions and manual pages show the \
         new one.\n\n| command | old | new |\n|---|---|---|\n"
    );
    for &RenamedCommand { parent, old, new } in &RENAMED_COMMANDS {
        let whole = |name: &str| format!("{parent} {name}").trim_start().to_owned();
        text += &format!("| command | `{}` | `{}` |\n", whole(old), whole(new));
    }
    for &RenamedFlag { old, new, commands: names } in &RENAMED_FLAGS {
        text += &format!("| {} | `{old}` | `{new}` |\n", commands(names));
    }
    for &RenamedValueKey { flag, old, new, commands: names } in &RENAMED_KEYS {
        text += &format!("| {} | `{flag} {old}=..` | `{flag} {new}=..` |\n", commands(names));
    }
    text
}

#[test]
fn the_page_of_renames_is_what_the_table_says() {
    let page = fs::read_to_string(PAGE).unwrap();
    let (before, rest) = page.split_once(SECTION).expect("the page has a section on flags");
    let after = rest.find("\n## ").map_or("", |at| &rest[at..]);
    let expected = format!("{before}{}{after}", section());
    if std::env::var_os("UPDATE_EXPECTED").is_some() {
        fs::write(PAGE, &expected).unwrap();
    } else {
        assert!(page == expected, "UPDATE_EXPECTED=1 writes it anew; expected is\n{}", section());
    }
}

#[test]
fn no_name_is_old_and_new_in_one_command_and_every_command_is_there() {
    let program = build_with_new_names(&registry());
    let mut seen = BTreeSet::new();
    for &RenamedFlag { old, new, commands } in &RENAMED_FLAGS {
        for &command in commands {
            assert!(seen.insert((command, old)), "{command} {old} is there twice");
            let mut below = &program;
            for name in command.split(' ') {
                below = below.find_subcommand(name).unwrap_or_else(|| panic!("no command {command}"));
            }
            let has = |flag: &str| below.get_arguments().any(|own| own.get_long() == flag.strip_prefix("--"));
            assert!(has(new) && !has(old), "{command}: {old}, {new}");
        }
    }
    assert!(Path::new(DECODER).is_file());
}
