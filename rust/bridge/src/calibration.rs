//! The page that guides an EMG calibration and shows the tests after it: a server of its own, since there is no arm yet.
//!
//! Addresses: `/` the page, `/calibration` the WebSocket. From the server: [`CalibrationScreen`]s, one JSON object
//! a message, the newest only; a page that reads slowly misses some. From the page: [`CalibrationCommand`]s.

use crate::{
    BridgeError, CalibrationScreen, PageOptions, assets,
    calibration_screen::CalibrationMessage,
    encoding::takes_gzip,
    places::{Place, Places, Seat, Seats},
};
use axum::{
    Extension, Router,
    extract::{
        Path, State,
        ws::{Message, Utf8Bytes, WebSocket, WebSocketUpgrade},
    },
    http::{HeaderMap, StatusCode},
    response::{IntoResponse, Response},
    routing::get,
};
use proact_http::{Limits, Pulse, Right, Server};
use proact_types::GestureName;
use serde::Deserialize;
use std::{
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicU64, Ordering},
    },
    time::Duration,
};
use tokio::{sync::watch, time};

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
        gesture: GestureName,
    },
    /// Train with what there is.
    Finish,
}

/// Largest message that a page may send, bytes.
const MAX_MESSAGE_BYTES: usize = 1024;
/// Commands kept until they are asked for; a page that sends more is broken.
const MAX_COMMANDS: usize = 64;
/// Most pages at once. Of further ones, those that only watch are refused with 503.
const SEATS: Seats = Seats { watching: 16, driving: 16, conducting: 0 };
/// A page that takes no byte for so long is gone or hopeless.
const SEND_TIMEOUT: Duration = Duration::from_secs(10);

struct Shared {
    limits: Limits,
    places: Arc<Places>,
    next_client: AtomicU64,
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
            limits: options.limits,
            places: Places::new(SEATS),
            next_client: AtomicU64::new(1),
            newest: watch::Sender::new(CalibrationMessage::Nothing.to_text().into()),
            commands: Mutex::default(),
        });
        let router = router(Arc::clone(&shared));
        let server =
            Server::start(options.serve("calibration-page"), router, |_| {}, std::future::pending())?;
        Ok(CalibrationServer { shared, server })
    }

    /// Where it is served, without the token.
    pub fn url(&self) -> String {
        self.server.url()
    }

    /// The address to open in a browser on this machine, with the token if there is one.
    pub fn page_url(&self) -> String {
        self.server.page_url("")
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
        .route("/", get(|asked: HeaderMap| async move { assets::page("calibrate.html", takes_gzip(&asked)) }))
        .route(
            "/{*path}",
            get(|Path(path): Path<String>, asked: HeaderMap| async move {
                assets::page(&path, takes_gzip(&asked))
            }),
        )
        .route("/healthz", get(|| async { "ok\n" }))
        .route("/calibration", get(connect))
        .with_state(shared)
}

async fn connect(
    State(shared): State<Arc<Shared>>,
    Extension(right): Extension<Right>,
    upgrade: WebSocketUpgrade,
) -> Response {
    let seat = if right == Right::Act { Seat::Driving } else { Seat::Watching };
    let place = match shared.places.enter(shared.next_client.fetch_add(1, Ordering::Relaxed), seat, None) {
        Ok(place) => place,
        Err(most) => {
            return (StatusCode::SERVICE_UNAVAILABLE, format!("{most} pages watch already\n"))
                .into_response();
        }
    };
    upgrade
        .max_message_size(MAX_MESSAGE_BYTES)
        .max_frame_size(MAX_MESSAGE_BYTES)
        .on_upgrade(async move |socket| serve(socket, shared, right, place).await)
}

/// One page: sends the newest object whenever there is one, takes commands.
async fn serve(mut socket: WebSocket, shared: Arc<Shared>, right: Right, place: Place) {
    let mut newest = shared.newest.subscribe();
    newest.mark_changed();
    let pulse = Pulse::new(shared.limits);
    let mut pings = pulse.pings();
    loop {
        let answer = tokio::select! {
            () = place.lost() => return,
            changed = newest.changed() => {
                if changed.is_err() {
                    return;
                }
                Message::Text(newest.borrow_and_update().clone())
            }
            message = socket.recv() => {
                pulse.beat();
                match message {
                    Some(Ok(Message::Text(text))) => match take(&shared, right, &text) {
                        Ok(()) => {
                            place.note_speech();
                            continue;
                        }
                        Err(reason) => {
                            Message::Text(CalibrationMessage::Error { message: &reason }.to_text().into())
                        }
                    },
                    Some(Ok(Message::Close(_)) | Err(_)) | None => return,
                    Some(Ok(_)) => continue,
                }
            }
            _ = pings.tick() => match pulse.is_lost() {
                true => return,
                false => Message::Ping(Default::default()),
            },
        };
        if !matches!(time::timeout(SEND_TIMEOUT, socket.send(answer)).await, Ok(Ok(()))) {
            return;
        }
    }
}

fn take(shared: &Shared, right: Right, text: &str) -> Result<(), String> {
    if right < Right::Act {
        return Err(
            "message ignored: this machine may only watch; open the address with the token".to_owned()
        );
    }
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
