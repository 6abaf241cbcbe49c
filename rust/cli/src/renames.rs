//! Flags and commands that have a new name: the old one is still accepted, hidden, with one line on standard error.

use std::ffi::OsString;

/// A flag with a new name.
pub(crate) struct RenamedFlag {
    pub(crate) old: &'static str,
    pub(crate) new: &'static str,
    /// The commands that have it, without the program's name.
    pub(crate) commands: &'static [&'static str],
}

/// A key within the value of a flag, with a new name. Whatever reads the value accepts both.
pub(crate) struct RenamedValueKey {
    pub(crate) flag: &'static str,
    pub(crate) old: &'static str,
    pub(crate) new: &'static str,
    pub(crate) commands: &'static [&'static str],
}

/// A command with a new name, below the command `parent`.
pub(crate) struct RenamedCommand {
    pub(crate) parent: &'static str,
    pub(crate) old: &'static str,
    pub(crate) new: &'static str,
}

const fn flag(old: &'static str, new: &'static str, commands: &'static [&'static str]) -> RenamedFlag {
    RenamedFlag { old, new, commands }
}

const DECODERS: &[&str] = &["emg evaluate", "emg features", "emg select", "emg train", "emg stream"];
const SOURCES: &[&str] = &["emg train", "emg test", "emg stream"];
const SIMULATE: &[&str] = &["emg simulate"];
const TRAIN: &[&str] = &["emg train"];
const TEST: &[&str] = &["emg test"];
const SHOULDER: &[&str] = &["localize shoulder"];

pub(crate) const RENAMED_FLAGS: [RenamedFlag; 67] = [
    flag("--limit", "--time-limit", &["demo", "serve", "node", "localize reach", "simulate", "compare"]),
    flag("--people", "--participant-kind", &["simulate", "compare", "study run"]),
    flag("--new", "--enroll", &["study run"]),
    flag("--use-log", "--usage-log", &["study run", "serve"]),
    flag("--settle", "--reachability-timeout", &["bench"]),
    flag("--emg-train", "--emg-train-repetitions", &["demo"]),
    flag("--emg-feed", "--emg-test-repetitions", &["demo"]),
    flag("--emg-fill", "--fill-missing", &["demo"]),
    flag("--exit", "--no-wait", &["demo", "run"]),
    flag("--as", "--override", &["replay"]),
    flag("--vary", "--sweep", &["simulate"]),
    flag("--whole", "--full-physics", &["participants predict"]),
    flag("--seeds", "--master-seeds", &["participants predict"]),
    flag("--options", "--intent-options", &["analyze"]),
    flag("--allow", "--rosbridge-allow", &["demo", "run", "serve", "study run", "node"]),
    flag("--arm", "--upper-arm-body", SHOULDER),
    flag("--left", "--left-arm", SHOULDER),
    flag("--half-width", "--half-shoulder-width", SHOULDER),
    flag("--profile", "--box-placement", SHOULDER),
    flag("--legs-ahead", "--knee-distance", SHOULDER),
    flag("--correct", "--box-offset", SHOULDER),
    flag("--markers", "--marker-body", &["localize headset"]),
    flag("--force", "--replace", &["model import"]),
    flag("--like", "--template", &["study new"]),
    flag("--like", "--extra-format", &["study export"]),
    flag("--keep-ids", "--keep-pseudonyms", &["study export"]),
    flag("--from", "--pilot", &["study power"]),
    flag("--people", "--participants", &["study power"]),
    flag("--level", "--alpha", &["study power"]),
    flag("--alpha", "--ridge-penalty", DECODERS),
    flag("--process", "--decoder-process", DECODERS),
    flag("--pair", "--site-gestures", DECODERS),
    flag("--sites", "--site-channels", DECODERS),
    flag("--cocontraction", "--cocontraction-window", DECODERS),
    flag("--switch", "--cocontraction-gesture", DECODERS),
    flag("--train-reps", "--train-repetitions", &["emg evaluate", "emg features", "emg stream"]),
    flag("--test-reps", "--test-repetitions", &["emg evaluate", "emg features"]),
    flag("--most", "--max-features", &["emg select"]),
    flag("--reps", "--repetitions", &["emg simulate", "emg train"]),
    flag("--gesture", "--gesture-sequence", SIMULATE),
    flag("--like", "--amplifier", SIMULATE),
    flag("--loss", "--loss-rate", SIMULATE),
    flag("--dup", "--duplicate-rate", SIMULATE),
    flag("--reorder", "--reorder-rate", SIMULATE),
    flag("--truncate", "--truncation-rate", SIMULATE),
    flag("--jitter", "--jitter-ms", SIMULATE),
    flag("--notification", "--notification-bytes", SIMULATE),
    flag("--no-ids", "--no-sequence-numbers", SIMULATE),
    flag("--battery", "--battery-percent", SIMULATE),
    flag("--rep", "--source-repetition", SOURCES),
    flag("--flat-out", "--no-realtime", SOURCES),
    flag("--zero", "--adc-zero", SOURCES),
    flag("--bits", "--adc-bits", SOURCES),
    flag("--packet", "--packet-bytes", SOURCES),
    flag("--rounds", "--max-rounds", TRAIN),
    flag("--least-rounds", "--min-rounds", TRAIN),
    flag("--target", "--target-accuracy", &["emg train", "emg test"]),
    flag("--secs", "--repetition-seconds", TRAIN),
    flag("--prepare", "--prepare-seconds", TRAIN),
    flag("--check", "--band-check", TRAIN),
    flag("--accept-roll", "--accept-rotation", TRAIN),
    flag("--patience", "--timeout", TRAIN),
    flag("--in-a-row", "--consecutive-sequences", TEST),
    flag("--attempts", "--max-sequences", TEST),
    flag("--motions", "--motion-repetitions", TEST),
    flag("--repetitions", "--tac-repetitions", TEST),
    flag("--targets", "--cursor-targets", TEST),
];

pub(crate) const RENAMED_KEYS: [RenamedValueKey; 1] = [RenamedValueKey {
    flag: "--mocap-axes",
    old: "metres_per_unit",
    new: "meters_per_unit",
    commands: &["demo", "run", "serve", "study run", "doctor", "localize headset", "localize shoulder"],
}];

pub(crate) const RENAMED_COMMANDS: [RenamedCommand; 2] = [
    RenamedCommand { parent: "", old: "bless", new: "update-digests" },
    RenamedCommand { parent: "emg", old: "use", new: "usage" },
];

/// `command` with the old names of the table as hidden aliases.
pub(crate) fn accept_old_names(command: clap::Command) -> clap::Command {
    accept_below(command, "")
}

fn accept_below(command: clap::Command, path: &str) -> clap::Command {
    let command = command.mut_args(|argument| {
        let old =
            |row: &&RenamedFlag| argument.get_long() == Some(bare(row.new)) && row.commands.contains(&path);
        match RENAMED_FLAGS.iter().find(old) {
            Some(row) => argument.alias(bare(row.old)),
            None => argument,
        }
    });
    command.mut_subcommands(|below| {
        let renamed = |row: &&RenamedCommand| row.parent == path && row.new == below.get_name();
        let row = RENAMED_COMMANDS.iter().find(renamed);
        let below_path = join(path, below.get_name());
        let below = accept_below(below, &below_path);
        match row {
            Some(row) => below.alias(row.old),
            None => below,
        }
    })
}

/// A line for each old name among the `words` of a command line, once for each: "--limit is now --time-limit".
///
/// `command` is the whole command line, with the old names as [`accept_old_names`] adds them; the first word is the program.
pub(crate) fn rename_warnings(command: &clap::Command, words: &[OsString]) -> Vec<String> {
    let mut warnings: Vec<String> = Vec::new();
    let mut warn = |old: String, new: String| {
        let warning = format!("{old} is now {new}");
        if !warnings.contains(&warning) {
            warnings.push(warning);
        }
    };
    let (mut command, mut path) = (command, String::new());
    let mut words = words.iter().skip(1).map(|word| word.to_string_lossy());
    while let Some(word) = words.next() {
        if word == "--" {
            break;
        }
        let Some(text) = word.strip_prefix("--") else {
            if let Some(below) = command.find_subcommand(&*word) {
                let row = RENAMED_COMMANDS.iter().find(|row| row.parent == path && row.old == word);
                if let Some(row) = row {
                    warn(join(row.parent, row.old), join(row.parent, row.new));
                }
                path = join(&path, below.get_name());
                command = below;
            }
            continue;
        };
        let (name, value) = match text.split_once('=') {
            Some((name, value)) => (name, Some(value.to_owned())),
            None => (text, None),
        };
        let row = RENAMED_FLAGS.iter().find(|row| bare(row.old) == name && row.commands.contains(&&*path));
        if let Some(row) = row {
            warn(row.old.to_owned(), row.new.to_owned());
        }
        let key = RENAMED_KEYS.iter().find(|row| bare(row.flag) == name && row.commands.contains(&&*path));
        let takes_any_word = command
            .get_arguments()
            .any(|argument| argument.get_long() == Some(name) && argument.is_allow_hyphen_values_set());
        // The value, where it matters: elsewhere a value never begins with two hyphens.
        let value = match value {
            None if takes_any_word || key.is_some() => words.next().map(std::borrow::Cow::into_owned),
            value => value,
        };
        if let (Some(row), Some(value)) = (key, value) {
            let is_old = |part: &str| part.trim().split('=').next() == Some(row.old);
            if value.split(',').any(is_old) {
                warn(row.old.to_owned(), row.new.to_owned());
            }
        }
    }
    warnings
}

/// A flag without its hyphens.
fn bare(flag: &'static str) -> &'static str {
    flag.trim_start_matches('-')
}

/// The name of a command below the command `path`.
fn join(path: &str, name: &str) -> String {
    if path.is_empty() { name.to_owned() } else { format!("{path} {name}") }
}
