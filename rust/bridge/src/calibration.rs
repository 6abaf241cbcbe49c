//! The page that guides an EMG calibration and shows the tests after it: a server of its own, since there is no arm yet.
//!
//! Addresses: `/` the page, `/calibration` the WebSocket. From the server: [`CalibrationScreen`]s, one JSON object
//! a message, the newest only; a page that reads slowly misses some. From the page: [`CalibrationCommand`]s.

use crate::{
    BridgeError, CalibrationScreen, PageOptions, assets,
    calibration_view::CalibrationMessage,
    client_slots::{ClientSlot, ClientSlots, SlotKind, SlotLimits},
    encoding::accepts_gzip,
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
use proact_http::{AccessRight, ConnectionLimits, HttpServer, WebSocketLiveness};
use proact_types::Gesture;
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
        gesture: Gesture,
    },
    /// Train with what there is.
    Finish,
}

/// Largest message that a page may send, bytes.
const MAX_MESSAGE_BYTES: usize = 1024;
/// Commands kept until they are asked for; a page that sends more is broken.
const MAX_COMMANDS: usize = 64;
/// Most pages at once. Of further ones, those that only watch are refused with 503.
const SLOT_LIMITS: SlotLimits = SlotLimits { watching: 16, driving: 16, conducting: 0 };
/// A page that takes no byte for so long is gone or hopeless.
const SEND_TIMEOUT: Duration = Duration::from_secs(10);

struct CalibrationServerState {
    limits: ConnectionLimits,
    slots: Arc<ClientSlots>,
    next_client: AtomicU64,
    latest_message: watch::Sender<Utf8Bytes>,
    commands: Mutex<Vec<CalibrationCommand>>,
}

/// Serves the calibration page in a thread of its own until it is dropped.
pub struct CalibrationServer {
    shared: Arc<CalibrationServerState>,
    server: HttpServer,
}

impl CalibrationServer {
    /// Listens and begins to serve.
    ///
    /// # Errors
    /// As [`crate::PageServer::start_server`].
    pub fn start(options: PageOptions) -> Result<CalibrationServer, BridgeError> {
        let shared = Arc::new(CalibrationServerState {
            limits: options.limits,
            slots: ClientSlots::new(SLOT_LIMITS),
            next_client: AtomicU64::new(1),
            latest_message: watch::Sender::new(CalibrationMessage::Nothing.to_text().into()),
            commands: Mutex::default(),
        });
        let router = router(Arc::clone(&shared));
        let server = HttpServer::start(
            options.server_options("calibration-page"),
            router,
            |_| {},
            std::future::pending(),
        )?;
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
        self.shared.latest_message.send_replace(CalibrationMessage::Screen(screen).to_text().into());
    }

    /// What the pages asked for since the last call, oldest first.
    pub fn drain_commands(&self) -> Vec<CalibrationCommand> {
        std::mem::take(&mut *self.shared.commands.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

fn router(shared: Arc<CalibrationServerState>) -> Router {
    Router::new()
        .route(
            "/",
            get(|headers: HeaderMap| async move {
                assets::asset_response("calibrate.html", accepts_gzip(&headers))
            }),
        )
        .route(
            "/{*path}",
            get(|Path(path): Path<String>, headers: HeaderMap| async move {
                assets::asset_response(&path, accepts_gzip(&headers))
            }),
        )
        .route("/healthz", get(|| async { "ok\n" }))
        .route("/calibration", get(connect))
        .with_state(shared)
}

async fn connect(
    State(shared): State<Arc<CalibrationServerState>>,
    Extension(right): Extension<AccessRight>,
    upgrade: WebSocketUpgrade,
) -> Response {
    let seat = if right == AccessRight::Control { SlotKind::Driving } else { SlotKind::Watching };
    let slot = match shared.slots.acquire(shared.next_client.fetch_add(1, Ordering::Relaxed), seat, None) {
        Ok(slot) => slot,
        Err(limit) => {
            return (StatusCode::SERVICE_UNAVAILABLE, format!("{limit} pages watch already\n"))
                .into_response();
        }
    };
    upgrade
        .max_message_size(MAX_MESSAGE_BYTES)
        .max_frame_size(MAX_MESSAGE_BYTES)
        .on_upgrade(async move |socket| serve(socket, shared, right, slot).await)
}

/// One page: sends the newest object whenever there is one, takes commands.
async fn serve(
    mut socket: WebSocket,
    shared: Arc<CalibrationServerState>,
    right: AccessRight,
    slot: ClientSlot,
) {
    let mut newest = shared.latest_message.subscribe();
    newest.mark_changed();
    let liveness = WebSocketLiveness::new(shared.limits);
    let mut pings = liveness.ping_interval();
    loop {
        let answer = tokio::select! {
            () = slot.wait_for_eviction() => return,
            changed = newest.changed() => {
                if changed.is_err() {
                    return;
                }
                Message::Text(newest.borrow_and_update().clone())
            }
            message = socket.recv() => {
                liveness.record_received();
                match message {
                    Some(Ok(Message::Text(text))) => match queue_command(&shared, right, &text) {
                        Ok(()) => {
                            slot.mark_active();
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
            _ = pings.tick() => match liveness.is_timed_out() {
                true => return,
                false => Message::Ping(Default::default()),
            },
        };
        if !matches!(time::timeout(SEND_TIMEOUT, socket.send(answer)).await, Ok(Ok(()))) {
            return;
        }
    }
}

fn queue_command(shared: &CalibrationServerState, right: AccessRight, text: &str) -> Result<(), String> {
    if right < AccessRight::Control {
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
