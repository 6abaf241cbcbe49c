//! The page that guides an EMG calibration and shows the tests after it: a server of its own, since there is no arm yet.
//!
//! Addresses: `/` the page, `/calibration` the WebSocket. From the server: [`CalibrationScreen`]s, one JSON object
//! a message, the newest only; a page that reads slowly misses some. From the page: [`CalibrationCommand`]s.

use crate::{BridgeError, CalibrationScreen, PageOptions, assets, calibration_screen::CalibrationMessage};
use axum::{
    Router,
    extract::{
        Path, State,
        ws::{Message, Utf8Bytes, WebSocket, WebSocketUpgrade},
    },
    response::Response,
    routing::get,
};
use proact_http::Server;
use proact_types::Gesture;
use serde::Deserialize;
use std::sync::{Arc, Mutex, PoisonError};
use tokio::sync::watch;

/// What the buttons of the page ask for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum CalibrationCommand {
    /// The person is ready.
    Begin,
    /// Another round.
    Proceed,
    /// This gesture again.
    RecordAgain {
        /// Which.
        gesture: Gesture,
    },
    /// Train with what there is.
    Finish,
}

/// Largest message that a page may send, bytes.
const MAX_MESSAGE_BYTES: usize = 1024;
/// Commands kept until they are asked for; a page that sends more is broken.
const MAX_COMMANDS: usize = 64;

struct Shared {
    newest: watch::Sender<Utf8Bytes>,
    commands: Mutex<Vec<CalibrationCommand>>,
}

/// Serves the calibration page in a thread of its own until it is dropped.
pub struct CalibrationServer {
    shared: Arc<Shared>,
    server: Server,
}

impl CalibrationServer {
    /// Listens and begins to serve.
    ///
    /// # Errors
    /// As [`crate::PageServer::start`].
    pub fn start(options: PageOptions) -> Result<CalibrationServer, BridgeError> {
        let shared = Arc::new(Shared {
            newest: watch::Sender::new(CalibrationMessage::Nothing.to_text().into()),
            commands: Mutex::default(),
        });
        let router = router(Arc::clone(&shared));
        let server =
            Server::start(options.serve("calibration-page"), router, |_| {}, std::future::pending())?;
        Ok(CalibrationServer { shared, server })
    }

    /// The address to open in a browser.
    pub fn url(&self) -> String {
        self.server.url()
    }

    /// The address for other machines, with the token that lets them in; none if they cannot connect.
    pub fn remote_url(&self) -> Option<String> {
        self.server.remote_url()
    }

    /// Shows a screen on all pages, in place of the one before. Never blocks.
    pub fn publish(&self, screen: &CalibrationScreen) {
        self.shared.newest.send_replace(CalibrationMessage::Screen(screen).to_text().into());
    }

    /// What the pages asked for since the last call, oldest first.
    pub fn drain(&self) -> Vec<CalibrationCommand> {
        std::mem::take(&mut *self.shared.commands.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

fn router(shared: Arc<Shared>) -> Router {
    Router::new()
        .route("/", get(|| async { assets::page("calibrate.html") }))
        .route("/{*path}", get(|Path(path): Path<String>| async move { assets::page(&path) }))
        .route("/healthz", get(|| async { "ok\n" }))
        .route("/calibration", get(connect))
        .with_state(shared)
}

async fn connect(State(shared): State<Arc<Shared>>, upgrade: WebSocketUpgrade) -> Response {
    upgrade
        .max_message_size(MAX_MESSAGE_BYTES)
        .max_frame_size(MAX_MESSAGE_BYTES)
        .on_upgrade(move |socket| serve(socket, shared))
}

/// One page: sends the newest object whenever there is one, takes commands.
async fn serve(mut socket: WebSocket, shared: Arc<Shared>) {
    let mut newest = shared.newest.subscribe();
    newest.mark_changed();
    loop {
        tokio::select! {
            changed = newest.changed() => {
                if changed.is_err() {
                    return;
                }
                let text = newest.borrow_and_update().clone();
                if socket.send(Message::Text(text)).await.is_err() {
                    return;
                }
            }
            message = socket.recv() => match message {
                Some(Ok(Message::Text(text))) => {
                    if let Err(reason) = take(&shared, &text) {
                        let answer = CalibrationMessage::Error { message: &reason }.to_text();
                        if socket.send(Message::Text(answer.into())).await.is_err() {
                            return;
                        }
                    }
                }
                Some(Ok(Message::Close(_)) | Err(_)) | None => return,
                Some(Ok(_)) => {}
            },
        }
    }
}

fn take(shared: &Shared, text: &str) -> Result<(), String> {
    let command = serde_json::from_str(text).map_err(|error| {
        format!("message ignored: {error}; expected a JSON object with type begin, proceed, record_again or finish")
    })?;
    let mut commands = shared.commands.lock().unwrap_or_else(PoisonError::into_inner);
    if commands.len() == MAX_COMMANDS {
        return Err(format!("message ignored: {MAX_COMMANDS} commands wait already"));
    }
    commands.push(command);
    Ok(())
}
