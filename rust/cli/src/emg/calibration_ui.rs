//! Who sees the prompts of a calibration, and who decides after a round.

use super::{calibration_page::CalibrationPage, train::CalibrationPageArgs};
use crate::progress::progress_bar;
use indicatif::ProgressBar;
use proact_app::{print_status, read_lines};
use proact_emg::{
    Calibration, CalibrationConfig, CalibrationPhase, CalibrationReport, ChannelStatus, DriveScore, EmgModel,
    MuscleSite, RepetitionRejection,
};
use proact_types::{Gesture, Number};
use serde_json::Value;
use std::{
    error::Error,
    io::{BufReader, IsTerminal, stdin},
    sync::mpsc::{Receiver, TryRecvError},
};

/// What to do after a round.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum RoundAction {
    /// Another round.
    Proceed,
    /// This gesture again.
    RecordAgain(Gesture),
    /// Train and be done.
    Stop,
}

/// What guides a person.
pub(super) trait CalibrationUi {
    /// Shows where the session is.
    fn show(&mut self, calibration: &Calibration);
    /// Shows one sentence.
    fn show_message(&mut self, text: &str);
    /// Shows how good the rounds are.
    fn show_report(&mut self, calibration: &Calibration);
    /// What is wanted after a round; none as long as nobody has decided.
    ///
    /// # Errors
    /// Nobody will decide any more.
    fn poll_action(&mut self, calibration: &Calibration) -> Result<Option<RoundAction>, Box<dyn Error>>;
    /// The person has said that it may begin; a terminal begins at once.
    fn ready(&mut self) -> bool {
        true
    }
    /// The model is written.
    fn show_result(&mut self, _result: &Value) {}
}

/// A page if one is asked for; else the terminal, where a person decides if standard input is one, and the rule if not.
///
/// # Errors
/// The page cannot be served.
pub(super) fn open_calibration_ui(
    page: &CalibrationPageArgs,
    json: bool,
    source: &str,
) -> Result<Box<dyn CalibrationUi>, Box<dyn Error>> {
    if page.page {
        return Ok(Box::new(CalibrationPage::open(page, source)?));
    }
    let keys = (!json && stdin().is_terminal()).then(|| read_lines(BufReader::new(stdin())));
    Ok(Box::new(CalibrationTerminal {
        bar: progress_bar(!json, 1000, "{prefix:20} {bar:30} {msg}"),
        quiet: json,
        input_lines: keys,
    }))
}

/// Prompts on a terminal.
struct CalibrationTerminal {
    bar: ProgressBar,
    quiet: bool,
    /// A person who decides; without one the rule does.
    input_lines: Option<Receiver<String>>,
}

impl CalibrationUi for CalibrationTerminal {
    fn show(&mut self, calibration: &Calibration) {
        let (prefix, share, message) = match calibration.phase() {
            CalibrationPhase::Blocked { prompt } => {
                (prompt.gesture.to_string(), 0.0, "waiting for good channels".to_owned())
            }
            CalibrationPhase::Preparing { prompt, remaining_secs: left_secs } => {
                (prompt.gesture.to_string(), 0.0, format!("make it now, recording in {left_secs:.1} s"))
            }
            CalibrationPhase::Recording { prompt, share } => {
                (prompt.gesture.to_string(), share, "hold".to_owned())
            }
            CalibrationPhase::Reviewing | CalibrationPhase::Finished => {
                ("relax".to_owned(), 0.0, String::new())
            }
        };
        let lights: String = calibration
            .channels()
            .iter()
            .map(|q| match q.status {
                ChannelStatus::Green => '.',
                ChannelStatus::Amber => 'o',
                ChannelStatus::Red => 'X',
            })
            .collect();
        self.bar.set_prefix(prefix);
        self.bar.set_position((1000.0 * share) as u64);
        let arm = calibration.position().map_or_else(String::new, |position| format!("  arm: {position}"));
        self.bar
            .set_message(format!("{message}{arm}  round {}  channels {lights}", calibration.rounds() + 1));
    }

    fn show_message(&mut self, text: &str) {
        if self.quiet {
            return;
        }
        self.bar.suspend(|| print_status(text));
    }

    fn show_report(&mut self, calibration: &Calibration) {
        match calibration.report() {
            None => self.show_message("one round is recorded; accuracy is known from the second on"),
            Some(report) => self.show_message(&report_text(report)),
        }
        if self.input_lines.is_some() && calibration.report().is_some() {
            self.show_message("Enter: another round   NAME: record this gesture again, as hand_open   s: stop and write the model");
        }
    }

    fn poll_action(&mut self, calibration: &Calibration) -> Result<Option<RoundAction>, Box<dyn Error>> {
        let by_rule = if calibration.report().is_some_and(|r| r.good_enough)
            || calibration.rounds() >= calibration.config().max_rounds
        {
            RoundAction::Stop
        } else {
            RoundAction::Proceed
        };
        // One round cannot be judged: nothing to decide yet.
        let Some(keys) = self.input_lines.as_ref().filter(|_| calibration.report().is_some()) else {
            return Ok(Some(by_rule));
        };
        match keys.try_recv() {
            Err(TryRecvError::Empty) => Ok(None),
            Err(TryRecvError::Disconnected) => Ok(Some(by_rule)),
            Ok(line) => match line.trim() {
                "" if calibration.rounds() < calibration.config().max_rounds => {
                    Ok(Some(RoundAction::Proceed))
                }
                "" | "s" => Ok(Some(RoundAction::Stop)),
                name => match name.parse() {
                    Ok(gesture) if calibration.config().gestures.contains(&gesture) => {
                        Ok(Some(RoundAction::RecordAgain(gesture)))
                    }
                    _ => {
                        self.bar.suspend(|| {
                            print_status(format_args!(
                                "{name:?} is neither a gesture of this calibration nor s"
                            ))
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
            100.0 * outlier.recognized_share
        );
    }
    text.trim_end().to_owned()
}

/// A line for each site of direct control; nothing of another kind.
pub(super) fn sites_text(model: &EmgModel) -> String {
    let line = |MuscleSite { gesture, channel, low, high }: &MuscleSite| {
        format!("\n  {gesture:<16} channel {channel}, active above {low:.1}, full at {high:.1}")
    };
    model.classifier.sites().into_iter().flatten().map(line).collect()
}

/// What was reached, and what was expected.
pub(super) fn shortfall_text(
    calibration_report: Option<&CalibrationReport>,
    config: &CalibrationConfig,
) -> String {
    let Some(report) = calibration_report else {
        return "it was not judged, which takes two rounds".to_owned();
    };
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
pub(super) fn refusal_text(refusal: &RepetitionRejection) -> String {
    match refusal {
        RepetitionRejection::Gap { lost: 0 } => "a sample was unusable".to_owned(),
        RepetitionRejection::Gap { lost } => format!("{lost} samples were lost"),
        RepetitionRejection::Silence => "no samples came".to_owned(),
        RepetitionRejection::Imu => {
            "the inertial measurement unit said nothing, or the same all the time".to_owned()
        }
        RepetitionRejection::Red { channels, stream } => {
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
