//! What a package installs beside the program, made from the command line itself: manual pages and completions.

use clap::{Args, ValueEnum};
use proact_app::{print_result, print_status};
use proact_files::make_folder;
use std::{error::Error, path::PathBuf};

/// Arguments of `proact completions`.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  proact completions bash > ~/.local/share/bash-completion/completions/proact\n  \
    proact completions zsh > ~/.zfunc/_proact     (with fpath+=~/.zfunc before compinit in ~/.zshrc)\n  \
    proact completions fish > ~/.config/fish/completions/proact.fish\n\n\
    The packages of a release install them."
)]
pub(crate) struct CompletionsArgs {
    /// For which shell
    #[arg(value_enum)]
    shell: Shell,
}

/// A shell that completions can be had for.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum Shell {
    Bash,
    Zsh,
    Fish,
}

/// Arguments of `proact man`.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  proact man ~/.local/share/man/man1\n\n\
    Writes proact.1 and a page for each command, such as proact-study-run.1. The packages of a release install them.")]
pub(crate) struct ManArgs {
    /// The folder for the pages; made if it is not there
    #[arg(value_name = "DIR")]
    folder: PathBuf,
}

/// Prints the completions of `command`.
pub(crate) fn completions(
    command: &mut clap::Command,
    args: &CompletionsArgs,
) -> Result<bool, Box<dyn Error>> {
    let shell = match args.shell {
        Shell::Bash => clap_complete::Shell::Bash,
        Shell::Zsh => clap_complete::Shell::Zsh,
        Shell::Fish => clap_complete::Shell::Fish,
    };
    let mut script = Vec::new();
    clap_complete::generate(shell, command, "proact", &mut script);
    print_result(String::from_utf8(script)?.trim_end())?;
    Ok(true)
}

/// Writes the manual pages of `command`.
pub(crate) fn man(command: clap::Command, args: &ManArgs) -> Result<bool, Box<dyn Error>> {
    make_folder(&args.folder)?;
    clap_mangen::generate_to(command, &args.folder)
        .map_err(|error| format!("manual pages cannot be written to {}: {error}", args.folder.display()))?;
    print_status(format_args!("manual pages are in {}", args.folder.display()));
    Ok(true)
}
