//! The pages of the documentation that the program writes itself: every command with its options, every key of a configuration.

use clap::Args;
use proact_app::print_status;
use proact_emg::EmgConfig;
use proact_files::{make_folder, write_atomically};
use proact_participants::ParticipantOptions;
use proact_testbed::{Setup, TrialConfig};
use std::{error::Error, fmt::Write, path::PathBuf};

/// Files of values with a comment for each: unit, what it does, where it comes from.
const COMMENTED_FILES: [(&str, &str); 4] = [
    ("profile default", include_str!("../../control/data/profiles/default.toml")),
    ("profile original: what differs", include_str!("../../control/data/profiles/original.toml")),
    ("set-up seated", include_str!("../../testbed/data/setups/seated.toml")),
    ("set-up still", include_str!("../../testbed/data/setups/still.toml")),
];

/// Arguments of `proact reference`.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  proact reference build/reference\n\n\
    Writes commands.md and configuration.md. `./proact docs` makes them part of the documentation.")]
pub(crate) struct ReferenceArgs {
    /// The folder for the pages; made if it is not there
    #[arg(value_name = "DIR")]
    folder: PathBuf,
}

/// Writes the pages for `command`.
pub(crate) fn command(mut command: clap::Command, args: &ReferenceArgs) -> Result<bool, Box<dyn Error>> {
    command.build();
    let mut commands = String::from(
        "# Commands\n\nFor whoever looks for an option. Written by `proact reference` from the program itself: what `--help` says.\n",
    );
    add_command(&mut commands, &command)?;
    let configuration = configuration()?;
    make_folder(&args.folder)?;
    write_atomically(&args.folder.join("commands.md"), commands)?;
    write_atomically(&args.folder.join("configuration.md"), configuration)?;
    print_status(format_args!("commands.md and configuration.md are in {}", args.folder.display()));
    Ok(true)
}

/// A command and those below it, but for hidden ones and `help`.
fn add_command(text: &mut String, command: &clap::Command) -> Result<(), std::fmt::Error> {
    let name = command.get_bin_name().unwrap_or(command.get_name());
    let help = command.clone().render_long_help();
    write!(text, "\n## {name}\n\n```text\n{}\n```\n", help.to_string().trim_end())?;
    let shown = command.get_subcommands().filter(|one| !one.is_hide_set() && one.get_name() != "help");
    for one in shown {
        add_command(text, one)?;
    }
    Ok(())
}

/// All keys with their defaults, then the files whose values have comments.
fn configuration() -> Result<String, Box<dyn Error>> {
    let setup = Setup::named("seated")?;
    let config = TrialConfig {
        emg: Some(EmgConfig::default()),
        participant: Some(ParticipantOptions::default()),
        ..TrialConfig::new("D", 1, setup)
    };
    let table: toml::Table = toml::from_str(&config.to_toml()?)?;
    let mut text = String::from(
        "# Configuration\n\nFor whoever changes a value. Written by `proact reference` from the program itself. `--set KEY=VALUE` changes one value; \
         a whole configuration is what a trial directory holds as `config.toml`, and `proact run` takes it. Units are in the names. A key that \
         is missing here is empty by default, and left out of the file.\n\n## Keys of a trial\n\nWith their defaults for `proact demo`, method D.\n\n\
         | key | default |\n|---|---|\n",
    );
    for (key, value) in flatten_keys(&table, "") {
        text += &format!("| `{key}` | `{}` |\n", value.to_string().replace('|', "\\|").replace('\n', " "));
    }
    // A configuration leaves it out while it has its default.
    text += &format!("| `failed_plans_limit` | `{}` |\n", config.failed_plans_limit);
    for (name, file) in COMMENTED_FILES {
        text += &format!("\n## The {name}\n\n```toml\n{}\n```\n", file.trim_end());
    }
    Ok(text)
}

/// The keys below a table, with its name and a point before each.
fn flatten_keys<'a>(table: &'a toml::Table, before: &str) -> Vec<(String, &'a toml::Value)> {
    table
        .iter()
        .flat_map(|(name, value)| match value {
            toml::Value::Table(inner) => flatten_keys(inner, &format!("{before}{name}.")),
            other => vec![(format!("{before}{name}"), other)],
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_configuration_has_the_keys_of_every_section_and_the_comments_of_its_files() {
        let text = configuration().unwrap();
        for part in [
            "| `method` | `\"D\"` |",
            "| `emg.rate_hz` | `1000.0` |",
            "| `intent.gaze_sigma` | `0.03` |",
            "| `profile.jog.reverse_cycle_after_ms` | `1000` |",
            "[assumed] HO held this long goes back",
        ] {
            assert!(text.contains(part), "{part}");
        }
        assert!(text.matches("\n| `").count() > 120, "{text}");
    }
}
