//! The page that guides a calibration and shows the tests of a model.

use super::{
    screen::{Choice, Screen},
    train::PageArgs,
};
use crate::announce::printed;
use proact_app::tell;
use proact_bridge::{
    CalibrationCommand, CalibrationScreen, CalibrationServer, CalibrationView, ChannelLight, GestureTest,
    PageOptions,
};
use proact_emg::{Calibration, ChannelFault, ChannelQuality, CursorTest, Phase};
use proact_types::GestureName;
use serde_json::Value;
use std::{
    error::Error,
    time::{Duration, Instant},
};

/// From one message to the next.
const PERIOD: Duration = Duration::from_millis(50);
/// Sentences that the page shows.
const SENTENCES: usize = 4;

/// The page's side of a calibration or a test.
pub(super) struct PageScreen {
    server: CalibrationServer,
    source: String,
    said: Vec<String>,
    sent: Option<Instant>,
    begun: bool,
    choice: Option<Choice>,
    result: Value,
}

impl PageScreen {
    /// Serves the page and prints its address.
    ///
    /// # Errors
    /// No port, or no thread.
    pub(super) fn open(page: &PageArgs, source: &str) -> Result<PageScreen, Box<dyn Error>> {
        let (access, secret) = page.access.page_access(page.bind, vec![])?;
        let options = PageOptions { port: page.port, bind: page.bind, access, ..PageOptions::default() };
        let server = CalibrationServer::start(options)?;
        tell(format_args!("page: {}", printed(&server.page_url(), secret)));
        if let Some(url) = server.remote_url() {
            tell(format_args!("on another machine: {}", printed(&url, secret)));
        }
        let screen = ["DISPLAY", "WAYLAND_DISPLAY"].iter().any(|name| std::env::var_os(name).is_some());
        if screen && !page.no_browser {
            // The address is printed; a browser that does not start is no reason to stop.
            let _ = open::that_detached(server.page_url());
        }
        Ok(PageScreen {
            server,
            source: source.to_owned(),
            said: Vec::new(),
            sent: None,
            begun: false,
            choice: None,
            result: Value::Null,
        })
    }

    /// Takes what the buttons ask for.
    fn listen(&mut self) {
        for command in self.server.drain() {
            match command {
                CalibrationCommand::Begin => self.begun = true,
                CalibrationCommand::Proceed => self.choice = Some(Choice::Proceed),
                CalibrationCommand::RecordAgain { gesture } => self.choice = Some(Choice::Again(gesture)),
                CalibrationCommand::Finish => self.choice = Some(Choice::Stop),
            }
        }
    }

    /// The person has pressed the button that begins.
    pub(super) fn has_begun(&mut self) -> bool {
        self.listen();
        self.begun
    }

    /// Waits for the button once more.
    pub(super) fn await_begin(&mut self) {
        self.begun = false;
    }

    /// Shows a view if one is due, or at once.
    pub(super) fn publish<'a>(&mut self, now: bool, view: impl FnOnce() -> CalibrationView<'a>) {
        // What the buttons say must not pile up, even where it is of no use.
        self.listen();
        if !now && self.sent.is_some_and(|at| at.elapsed() < PERIOD) {
            return;
        }
        self.sent = Some(Instant::now());
        self.server.publish(&CalibrationScreen {
            source: &self.source,
            messages: &self.said,
            begun: self.begun,
            result: &self.result,
            view: view(),
        });
    }

    /// Shows a test: what is prompted and how it goes.
    pub(super) fn show_test(
        &mut self,
        test: GestureTest,
        prompt: Option<GestureName>,
        in_force: GestureName,
    ) {
        self.publish(false, || CalibrationView::Test { test, prompt, in_force });
    }

    /// Shows the cursor test.
    pub(super) fn show_cursor(&mut self, test: &CursorTest, in_force: GestureName, effort: f64, now: bool) {
        self.publish(now, || {
            let (target, width) = test.target();
            CalibrationView::Cursor {
                cursor: test.cursor(),
                target,
                width,
                dwelt: test.dwelt(),
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

impl Screen for PageScreen {
    fn show(&mut self, session: &Calibration) {
        self.publish(false, || calibration_view(session));
    }

    fn say(&mut self, text: &str) {
        self.said.push(text.to_owned());
        if self.said.len() > SENTENCES {
            self.said.remove(0);
        }
    }

    fn judged(&mut self, _session: &Calibration) {
        self.choice = None;
    }

    fn choose(&mut self, session: &Calibration) -> Result<Option<Choice>, Box<dyn Error>> {
        let choice = self.choice.take();
        let possible = match choice {
            Some(Choice::Proceed) => session.rounds() < session.config().most_rounds,
            Some(Choice::Again(gesture)) => session.config().gestures.contains(&gesture),
            Some(Choice::Stop) => session.rounds() >= 1,
            None => false,
        };
        Ok(choice.filter(|_| possible))
    }

    fn ready(&mut self) -> bool {
        self.has_begun()
    }

    fn done(&mut self, result: &Value) {
        self.end(result);
    }
}

/// What the page shows of a calibration.
fn calibration_view(session: &Calibration) -> CalibrationView<'_> {
    let config = session.config();
    let light = |q: &ChannelQuality| ChannelLight { light: q.light, fault: q.fault.map(ChannelFault::text) };
    let phase = session.phase();
    CalibrationView::Calibration {
        reviewing: phase == Phase::Reviewing,
        phase,
        position: session.position(),
        rounds: session.rounds(),
        most_rounds: config.most_rounds,
        gestures: &config.gestures,
        target_accuracy: config.target_accuracy,
        target_r2: config.target_r2,
        channels: session.channels().iter().map(light).collect(),
        stream: session.stream(),
        report: session.report(),
    }
}
