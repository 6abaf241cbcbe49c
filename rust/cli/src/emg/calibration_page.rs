//! The page that guides a calibration and shows the tests of a model.

use super::{
    calibration_ui::{CalibrationUi, RoundAction},
    train::CalibrationPageArgs,
};
use crate::announce::redact_token;
use proact_app::print_status;
use proact_bridge::{
    CalibrationCommand, CalibrationScreen, CalibrationServer, CalibrationView, ElectrodeView, GestureTest,
    PageOptions,
};
use proact_emg::{Calibration, CalibrationPhase, ChannelFault, ChannelQuality, CursorTest};
use proact_types::Gesture;
use serde_json::Value;
use std::{
    error::Error,
    time::{Duration, Instant},
};

/// From one message to the next.
const UPDATE_PERIOD: Duration = Duration::from_millis(50);
/// Sentences that the page shows.
const MAX_MESSAGES: usize = 4;

/// The page's side of a calibration or a test.
pub(super) struct CalibrationPage {
    server: CalibrationServer,
    source: String,
    messages: Vec<String>,
    last_update: Option<Instant>,
    begun: bool,
    action: Option<RoundAction>,
    result: Value,
}

impl CalibrationPage {
    /// Serves the page and prints its address.
    ///
    /// # Errors
    /// No port, or no thread.
    pub(super) fn open(page: &CalibrationPageArgs, source: &str) -> Result<CalibrationPage, Box<dyn Error>> {
        let (access, secret) = page.access.page_access(page.bind, vec![])?;
        let options = PageOptions { port: page.port, bind: page.bind, access, ..PageOptions::default() };
        let server = CalibrationServer::start(options)?;
        print_status(format_args!("page: {}", redact_token(&server.page_url(), secret)));
        if let Some(url) = server.remote_url() {
            print_status(format_args!("on another machine: {}", redact_token(&url, secret)));
        }
        let screen = ["DISPLAY", "WAYLAND_DISPLAY"].iter().any(|name| std::env::var_os(name).is_some());
        if screen && !page.no_browser {
            // The address is printed; a browser that does not start is no reason to stop.
            let _ = open::that_detached(server.page_url());
        }
        Ok(CalibrationPage {
            server,
            source: source.to_owned(),
            messages: Vec::new(),
            last_update: None,
            begun: false,
            action: None,
            result: Value::Null,
        })
    }

    /// Takes what the buttons ask for.
    fn handle_commands(&mut self) {
        for command in self.server.drain_commands() {
            match command {
                CalibrationCommand::Begin => self.begun = true,
                CalibrationCommand::Proceed => self.action = Some(RoundAction::Proceed),
                CalibrationCommand::RecordAgain { gesture } => {
                    self.action = Some(RoundAction::RecordAgain(gesture))
                }
                CalibrationCommand::Finish => self.action = Some(RoundAction::Stop),
            }
        }
    }

    /// The person has pressed the button that begins.
    pub(super) fn has_begun(&mut self) -> bool {
        self.handle_commands();
        self.begun
    }

    /// Waits for the button once more.
    pub(super) fn await_begin(&mut self) {
        self.begun = false;
    }

    /// Shows a view if one is due, or at once.
    pub(super) fn publish<'a>(&mut self, now: bool, view: impl FnOnce() -> CalibrationView<'a>) {
        // What the buttons say must not pile up, even where it is of no use.
        self.handle_commands();
        if !now && self.last_update.is_some_and(|at| at.elapsed() < UPDATE_PERIOD) {
            return;
        }
        self.last_update = Some(Instant::now());
        self.server.publish(&CalibrationScreen {
            source: &self.source,
            messages: &self.messages,
            begun: self.begun,
            result: &self.result,
            view: view(),
        });
    }

    /// Shows a test: what is prompted and how it goes.
    pub(super) fn show_test(&mut self, test: GestureTest, prompt: Option<Gesture>, in_force: Gesture) {
        self.publish(false, || CalibrationView::Test { test, prompt, in_force });
    }

    /// Shows the cursor test.
    pub(super) fn show_cursor(&mut self, test: &CursorTest, in_force: Gesture, effort: f64, now: bool) {
        self.publish(now, || {
            let (target, width) = test.target();
            CalibrationView::Cursor {
                cursor: test.cursor(),
                target,
                width,
                dwell_progress: test.dwell_progress(),
                in_force,
                effort,
                report: test.report(),
                finished: test.is_finished(),
            }
        });
    }

    /// Shows the result and waits a little, so that the page has it before the program ends.
    pub(super) fn end(&mut self, result: &Value) {
        self.result = result.clone();
        self.publish(true, || CalibrationView::End);
        std::thread::sleep(Duration::from_millis(300));
    }
}

impl CalibrationUi for CalibrationPage {
    fn show(&mut self, calibration: &Calibration) {
        self.publish(false, || calibration_view(calibration));
    }

    fn show_message(&mut self, text: &str) {
        self.messages.push(text.to_owned());
        if self.messages.len() > MAX_MESSAGES {
            self.messages.remove(0);
        }
    }

    fn show_report(&mut self, _calibration: &Calibration) {
        self.action = None;
    }

    fn poll_action(&mut self, calibration: &Calibration) -> Result<Option<RoundAction>, Box<dyn Error>> {
        let choice = self.action.take();
        let possible = match choice {
            Some(RoundAction::Proceed) => calibration.rounds() < calibration.config().max_rounds,
            Some(RoundAction::RecordAgain(gesture)) => calibration.config().gestures.contains(&gesture),
            Some(RoundAction::Stop) => calibration.rounds() >= 1,
            None => false,
        };
        Ok(choice.filter(|_| possible))
    }

    fn ready(&mut self) -> bool {
        self.has_begun()
    }

    fn show_result(&mut self, result: &Value) {
        self.end(result);
    }
}

/// What the page shows of a calibration.
fn calibration_view(calibration: &Calibration) -> CalibrationView<'_> {
    let config = calibration.config();
    let light =
        |q: &ChannelQuality| ElectrodeView { status: q.status, fault: q.fault.map(ChannelFault::text) };
    let phase = calibration.phase();
    CalibrationView::Calibration {
        reviewing: phase == CalibrationPhase::Reviewing,
        phase,
        position: calibration.position(),
        rounds: calibration.rounds(),
        max_rounds: config.max_rounds,
        gestures: &config.gestures,
        target_accuracy: config.target_accuracy,
        target_r2: config.target_r2,
        channels: calibration.channels().iter().map(light).collect(),
        stream: calibration.stream(),
        report: calibration.report(),
    }
}
