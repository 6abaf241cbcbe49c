//! A shared file may name a program; whoever runs the file decides whether it is started.

use proact_testbed::TrialConfig;
use proact_types::{LineRead, read_line};
use std::{
    error::Error,
    io::{self, BufRead, IsTerminal, Write},
};

/// Longest answer that is looked at, bytes.
const MAX_ANSWER_BYTES: usize = 1000;

/// Whether the programs that `config`, from `file`, names may be started: if `allowed` on the command line, or if somebody at
/// the terminal says yes to each.
///
/// # Errors
/// Nobody consented; the first such command is shown.
pub(crate) fn require_consent(config: &TrialConfig, file: &str, allowed: bool) -> Result<(), Box<dyn Error>> {
    if allowed {
        return Ok(());
    }
    let named = [
        ("method_process", config.method_process.as_ref().map(|program| &program.command)),
        ("intent_process", config.intent_process.as_ref().map(|program| &program.command)),
    ];
    for (section, command) in named {
        let Some(command) = command else { continue };
        let command = quote_command(command);
        if !(io::stdin().is_terminal() && io::stderr().is_terminal()) {
            return Err(refusal_text(file, section, &command).into());
        }
        ask_at_terminal(file, section, &command, &mut io::stdin().lock(), &mut io::stderr())?;
    }
    Ok(())
}

/// The words as they reach the program; what a terminal would act upon is spelt out.
fn quote_command(command: &[String]) -> String {
    command.iter().map(|word| format!("{word:?}")).collect::<Vec<_>>().join(" ")
}

fn refusal_text(file: &str, section: &str, command: &str) -> String {
    format!(
        "{file} would start the program {command} ({section}.command), with all rights that you have: read it, \
         then add --allow-command, or take the section out of the file"
    )
}

fn ask_at_terminal(
    file: &str,
    section: &str,
    command: &str,
    answers: &mut impl BufRead,
    terminal: &mut impl Write,
) -> Result<(), Box<dyn Error>> {
    write!(
        terminal,
        "{file} starts this program ({section}.command), with all rights that you have:\n  {command}\nStart it? [y/N] "
    )?;
    terminal.flush()?;
    let mut line = Vec::new();
    let read = read_line(answers, MAX_ANSWER_BYTES, &mut line)?;
    let yes = line.trim_ascii().eq_ignore_ascii_case(b"y") || line.trim_ascii().eq_ignore_ascii_case(b"yes");
    if read == LineRead::Complete && yes { Ok(()) } else { Err(refusal_text(file, section, command).into()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_yes_starts_the_command_and_it_is_shown_without_control_characters() {
        let command = quote_command(&["sh".to_owned(), "-c".to_owned(), "\x1b[2Jrm".to_owned()]);
        assert_eq!(command, "\"sh\" \"-c\" \"\\u{1b}[2Jrm\"");
        for (answer, consents) in [
            ("y\n", true),
            ("YES\n", true),
            ("", false),
            ("\n", false),
            ("n\n", false),
            ("yesterday\n", false),
        ] {
            let mut terminal = Vec::new();
            let consent =
                ask_at_terminal("x.toml", "method_process", &command, &mut answer.as_bytes(), &mut terminal);
            assert_eq!(consent.is_ok(), consents, "{answer:?}");
            let text = String::from_utf8(terminal).unwrap();
            assert!(text.contains(&command) && text.ends_with("[y/N] "), "{text}");
        }
    }
}
