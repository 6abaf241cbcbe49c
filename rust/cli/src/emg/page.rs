//! The page that guides a calibration and shows the cursor test.

use super::{
    screen::{Choice, Screen},
    train::PageArgs,
    view::fault_text,
};
use crate::serve::new_token;
use proact_bridge::{CalibrationCommand, CalibrationServer, PageOptions};
use proact_emg::{Calibration, ChannelQuality, CursorTest, Phase};
use proact_types::Gesture;
use serde_json::{Value, json};
use std::{
    collections::VecDeque,
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
    said: VecDeque<String>,
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
        let options = PageOptions {
            port: page.port,
            bind: page.bind,
            token: new_token(page.bind)?,
            ..PageOptions::default()
        };
        let server = CalibrationServer::start(options)?;
        eprintln!("page: {}", server.url());
        if let Some(url) = server.remote_url() {
            eprintln!("on another machine: {url}");
        }
        let screen = ["DISPLAY", "WAYLAND_DISPLAY"].iter().any(|name| std::env::var_os(name).is_some());
        if screen && !page.no_browser {
            // The address is printed; a browser that does not start is no reason to stop.
            let _ = open::that_detached(server.url());
        }
        Ok(PageScreen {
            server,
            source: source.to_owned(),
            said: VecDeque::new(),
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

    /// Sends a message if one is due, or at once.
    pub(super) fn publish(&mut self, now: bool, message: impl FnOnce() -> Value) {
        if !now && self.sent.is_some_and(|at| at.elapsed() < PERIOD) {
            return;
        }
        self.sent = Some(Instant::now());
        let mut object = message();
        object["source"] = json!(self.source);
        object["messages"] = json!(self.said);
        object["result"] = self.result.clone();
        object["begun"] = json!(self.begun);
        self.server.publish(&object);
    }

    /// Shows a test: its name, what is prompted and how it goes.
    pub(super) fn show_test(
        &mut self,
        name: &str,
        prompt: Option<Gesture>,
        in_force: Gesture,
        report: &Value,
    ) {
        self.publish(false, || {
            json!({ "type": "test", "test": name, "prompt": prompt, "in_force": in_force, "report": report })
        });
    }

    /// Shows the cursor test.
    pub(super) fn show_cursor(&mut self, test: &CursorTest, in_force: Gesture, effort: f64, now: bool) {
        self.publish(now, || {
            let (centre, width) = test.target();
            json!({ "type": "cursor", "cursor": test.cursor(), "target": centre, "width": width,
                "dwelt": test.dwelt(), "in_force": in_force, "effort": effort, "report": test.report(),
                "finished": test.is_finished() })
        });
    }

    /// Shows the result and waits a little, so that the page has it before the program ends.
    pub(super) fn end(&mut self, result: &Value) {
        self.result = result.clone();
        self.publish(true, || json!({ "type": "end" }));
        std::thread::sleep(Duration::from_millis(300));
    }
}

impl Screen for PageScreen {
    fn show(&mut self, session: &Calibration) {
        self.listen();
        self.publish(false, || calibration_message(session));
    }

    fn say(&mut self, text: &str) {
        self.said.push_back(text.to_owned());
        if self.said.len() > SENTENCES {
            self.said.pop_front();
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
fn calibration_message(session: &Calibration) -> Value {
    let config = session.config();
    json!({
        "type": "calibration", "phase": session.phase(), "rounds": session.rounds(),
        "most_rounds": config.most_rounds, "gestures": config.gestures,
        "target_accuracy": config.target_accuracy,
        "channels": lights(session.channels()), "stream": session.stream(), "report": session.report(),
        "reviewing": session.phase() == Phase::Reviewing,
    })
}

fn lights(channels: &[ChannelQuality]) -> Vec<Value> {
    let light = |q: &ChannelQuality| json!({ "light": q.light, "fault": q.fault.map(fault_text) });
    channels.iter().map(light).collect()
}
