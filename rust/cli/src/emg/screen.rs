//! Who sees the prompts of a calibration, and who decides after a round.

use super::{page::PageScreen, train::PageArgs};
use crate::progress::bar;
use indicatif::ProgressBar;
use proact_app::{lines_of, tell};
use proact_emg::{
    Calibration, CalibrationConfig, CalibrationReport, DriveScore, EmgModel, Light, Phase, Refusal, Site,
};
use proact_types::{GestureName, Number};
use serde_json::Value;
use std::{
    error::Error,
    io::{BufReader, IsTerminal, stdin},
    sync::mpsc::{Receiver, TryRecvError},
};

/// What to do after a round.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Choice {
    /// Another round.
    Proceed,
    /// This gesture again.
    Again(GestureName),
    /// Train and be done.
    Stop,
}

/// What guides a person.
pub(super) trait Screen {
    /// Shows where the session is.
    fn show(&mut self, session: &Calibration);
    /// Shows one sentence.
    fn say(&mut self, text: &str);
    /// Shows how good the rounds are.
    fn judged(&mut self, session: &Calibration);
    /// What is wanted after a round; none as long as nobody has decided.
    ///
    /// # Errors
    /// Nobody will decide any more.
    fn choose(&mut self, session: &Calibration) -> Result<Option<Choice>, Box<dyn Error>>;
    /// The person has said that it may begin; a terminal begins at once.
    fn ready(&mut self) -> bool {
        true
    }
    /// The model is written.
    fn done(&mut self, _result: &Value) {}
}

/// A page if one is asked for; else the terminal, where a person decides if standard input is one, and the rule if not.
///
/// # Errors
/// The page cannot be served.
pub(super) fn open_screen(
    page: &PageArgs,
    json: bool,
    source: &str,
) -> Result<Box<dyn Screen>, Box<dyn Error>> {
    if page.page {
        return Ok(Box::new(PageScreen::open(page, source)?));
    }
    let keys = (!json && stdin().is_terminal()).then(|| lines_of(BufReader::new(stdin())));
    Ok(Box::new(Terminal { bar: bar(!json, 1000, "{prefix:20} {bar:30} {msg}"), quiet: json, keys }))
}

/// Prompts on a terminal.
struct Terminal {
    bar: ProgressBar,
    quiet: bool,
    /// A person who decides; without one the rule does.
    keys: Option<Receiver<String>>,
}

impl Screen for Terminal {
    fn show(&mut self, session: &Calibration) {
        let (prefix, share, message) = match session.phase() {
            Phase::Blocked { prompt } => {
                (prompt.gesture.to_string(), 0.0, "waiting for good channels".to_owned())
            }
            Phase::Preparing { prompt, left_secs } => {
                (prompt.gesture.to_string(), 0.0, format!("make it now, recording in {left_secs:.1} s"))
            }
            Phase::Recording { prompt, share } => (prompt.gesture.to_string(), share, "hold".to_owned()),
            Phase::Reviewing | Phase::Finished => ("relax".to_owned(), 0.0, String::new()),
        };
        let lights: String = session
            .channels()
            .iter()
            .map(|q| match q.light {
                Light::Green => '.',
                Light::Amber => 'o',
                Light::Red => 'X',
            })
            .collect();
        self.bar.set_prefix(prefix);
        self.bar.set_position((1000.0 * share) as u64);
        let arm = session.position().map_or_else(String::new, |position| format!("  arm: {position}"));
        self.bar.set_message(format!("{message}{arm}  round {}  channels {lights}", session.rounds() + 1));
    }

    fn say(&mut self, text: &str) {
        if self.quiet {
            return;
        }
        self.bar.suspend(|| tell(text));
    }

    fn judged(&mut self, session: &Calibration) {
        match session.report() {
            None => self.say("one round is recorded; accuracy is known from the second on"),
            Some(report) => self.say(&report_text(report)),
        }
        if self.keys.is_some() && session.report().is_some() {
            self.say("Enter: another round   NAME: record this gesture again, as hand_open   s: stop and write the model");
        }
    }

    fn choose(&mut self, session: &Calibration) -> Result<Option<Choice>, Box<dyn Error>> {
        let by_rule = if session.report().is_some_and(|r| r.good_enough)
            || session.rounds() >= session.config().most_rounds
        {
            Choice::Stop
        } else {
            Choice::Proceed
        };
        // One round cannot be judged: nothing to decide yet.
        let Some(keys) = self.keys.as_ref().filter(|_| session.report().is_some()) else {
            return Ok(Some(by_rule));
        };
        match keys.try_recv() {
            Err(TryRecvError::Empty) => Ok(None),
            Err(TryRecvError::Disconnected) => Ok(Some(by_rule)),
            Ok(line) => match line.trim() {
                "" if session.rounds() < session.config().most_rounds => Ok(Some(Choice::Proceed)),
                "" | "s" => Ok(Some(Choice::Stop)),
                name => match name.parse() {
                    Ok(gesture) if session.config().gestures.contains(&gesture) => {
                        Ok(Some(Choice::Again(gesture)))
                    }
                    _ => {
                        self.bar.suspend(|| {
                            tell(format_args!("{name:?} is neither a gesture of this calibration nor s"))
                        });
                        Ok(None)
                    }
                },
            },
        }
    }
}

/// Accuracy, confusion and outliers, for reading.
pub(super) fn report_text(report: &CalibrationReport) -> String {
    let mut text = format!(
        "round {}: {:.1} % of windows recognised, leaving one repetition out{}\n",
        report.rounds,
        100.0 * report.accuracy,
        if report.good_enough { ": good enough" } else { "" }
    );
    for ((gesture, row), recall) in report.classes.iter().zip(&report.confusion).zip(&report.recall) {
        let counts: String = row.iter().map(|count| format!("{count:>6}")).collect();
        text += &format!("  {:<16}{counts}   {:5.1} %\n", gesture, 100.0 * recall);
    }
    if let Some(without) = report.accuracy_without_imu {
        text += &format!("  {:.1} % without the inertial measurement unit\n", 100.0 * without);
    }
    for DriveScore { drive, r2, mean_absolute_error } in &report.drives {
        text +=
            &format!("  {drive:<32} R2 {:.3}, mean absolute error {mean_absolute_error:.3}\n", Number(*r2));
    }
    for outlier in report.outliers() {
        text += &format!(
            "  repetition {} of {} differs from the others ({:.0} % recognised): record it again?\n",
            outlier.repetition + 1,
            outlier.gesture,
            100.0 * outlier.recognised
        );
    }
    text.trim_end().to_owned()
}

/// A line for each site of direct control; nothing of another kind.
pub(super) fn sites_text(model: &EmgModel) -> String {
    let line = |Site { gesture, channel, low, high }: &Site| {
        format!("\n  {gesture:<16} channel {channel}, active above {low:.1}, full at {high:.1}")
    };
    model.classifier.sites().into_iter().flatten().map(line).collect()
}

/// What was reached, and what was expected.
pub(super) fn shortfall(judged: Option<&CalibrationReport>, config: &CalibrationConfig) -> String {
    let Some(report) = judged else { return "it was not judged, which takes two rounds".to_owned() };
    let worst = report.drives.iter().min_by(|a, b| a.r2.total_cmp(&b.r2));
    match worst {
        Some(worst) => format!("R2 {:.2} of {}, expected {:.2}", worst.r2, worst.drive, config.target_r2),
        None => format!(
            "{:.1} % of windows recognised, expected {:.0} % and {:.0} % of each gesture",
            100.0 * report.accuracy,
            100.0 * config.target_accuracy,
            100.0 * config.target_recall
        ),
    }
}

/// One sentence for the person.
pub(super) fn refusal_text(refusal: &Refusal) -> String {
    match refusal {
        Refusal::Gap { lost: 0 } => "a sample was unusable".to_owned(),
        Refusal::Gap { lost } => format!("{lost} samples were lost"),
        Refusal::Silence => "no samples came".to_owned(),
        Refusal::Imu => "the inertial measurement unit said nothing, or the same all the time".to_owned(),
        Refusal::Red { channels, stream } => {
            let mut parts: Vec<String> = channels
                .iter()
                .map(|(channel, fault)| match fault {
                    Some(fault) => {
                        format!("channel {channel} is red ({})", fault.text())
                    }
                    None => format!("channel {channel} is red"),
                })
                .collect();
            if *stream {
                parts.push("the stream loses samples or has a wrong rate".to_owned());
            }
            parts.join(", ")
        }
    }
}
