//! One client: from its socket to its [`RosbridgeSession`](crate::session::Session), and from its outbox to its socket.

use crate::{
    actions::ActionBridge,
    fragments,
    outbox::{Compression, Outbox, Outgoing},
    png,
    server::{RosbridgeState, wall_time},
    services::OfferedServices,
    session::{ReceiveTime, RosbridgeSession},
};
use axum::extract::ws::{CloseFrame, Message, Utf8Bytes, WebSocket, close_code};
use futures_util::{
    SinkExt, StreamExt,
    stream::{SplitSink, SplitStream},
};
use proact_http::WebSocketLiveness;
use proact_messages::RosVersion;
use std::{
    net::SocketAddr,
    sync::atomic::{AtomicU64, Ordering},
    time::{Duration, Instant},
};
use tokio::time;

pub(super) use crate::session::MAX_MESSAGE_BYTES;

/// A client that takes no byte for so long is gone or hopeless.
const SEND_TIMEOUT: Duration = Duration::from_secs(30);
/// How often overdue service calls, and goals whose servers are connected by now, are looked for.
const POLL_PERIOD: Duration = Duration::from_millis(50);
/// A client that sends more than this many messages in a second is read no faster.
const MAX_MESSAGES_PER_SECOND: u32 = 100_000;
/// The same, in a tenth of a second.
const RATE_WINDOW: Duration = Duration::from_millis(100);

type Incoming = SplitStream<WebSocket>;
type Sink = SplitSink<WebSocket, Message>;

/// Clients are numbered in the order in which they come.
static NEXT_CLIENT: AtomicU64 = AtomicU64::new(1);

/// Serves one client until it goes or is given up.
pub(super) async fn serve(
    socket: WebSocket,
    peer: SocketAddr,
    convention: RosVersion,
    shared: &RosbridgeState,
) {
    let name = format!("/rosbridge_client_{}", NEXT_CLIENT.fetch_add(1, Ordering::Relaxed));
    shared.notice("connected", format!("{name} connected from {peer}"));
    let (bus, actions) = (std::sync::Arc::clone(&shared.bus), std::sync::Arc::clone(&shared.actions));
    let mut session = RosbridgeSession::new(bus, actions, &name, convention, shared.frozen_gaze_timeout);
    let (outbox, offered) =
        (std::sync::Arc::clone(session.outbox()), std::sync::Arc::clone(session.offered_services()));
    let (mut sink, incoming) = socket.split();
    let liveness = WebSocketLiveness::new(shared.limits);
    // Reading and writing are apart: a stop must come in while a slow line is still busy with old messages.
    let reason = tokio::select! {
        reason = read(incoming, &mut session, &liveness, &name, shared) => reason,
        reason = write(&mut sink, &outbox, &offered, &shared.actions, &liveness) => reason,
    };
    drop(session);
    // The standard allows 123 bytes; the texts are ASCII.
    let mut text = reason.unwrap_or("").to_owned();
    text.truncate(120);
    let frame = CloseFrame { code: close_code::NORMAL, reason: text.into() };
    let _ = time::timeout(Duration::from_secs(1), sink.send(Message::Close(Some(frame)))).await;
    let dropped = match outbox.dropped() {
        0 => String::new(),
        dropped => format!("; it read too slowly for {dropped} messages"),
    };
    shared.notice(
        "gone",
        format!("{name} is gone{}{dropped}", reason.map(|text| format!(": {text}")).unwrap_or_default()),
    );
}

/// Why a connection ends; none if the client wanted it.
type CloseReason = Option<&'static str>;

async fn read(
    mut incoming: Incoming,
    session: &mut RosbridgeSession,
    liveness: &WebSocketLiveness,
    name: &str,
    shared: &RosbridgeState,
) -> CloseReason {
    let (mut window, mut count) = (Instant::now(), 0);
    let mut noticed = false;
    loop {
        let message = match incoming.next().await {
            Some(Ok(message)) => message,
            // Too long, not UTF-8, or the line is dead; the protocol cannot go on after any of them.
            Some(Err(_)) => return Some("the connection broke, or a message was too long or no valid frame"),
            None => return None,
        };
        let now = Instant::now();
        liveness.record_received();
        let bytes = match &message {
            Message::Text(text) => text.as_bytes(),
            Message::Binary(bytes) => bytes,
            Message::Close(_) => return None,
            _ => continue,
        };
        let result = session.handle(bytes, ReceiveTime { instant: now, time: wall_time() });
        if !noticed && let Some(mistake) = session.first_error() {
            shared
                .notice("mistake", format!("{name}: {mistake} (further ones are answered and not reported)"));
            noticed = true;
        }
        if result.is_err() {
            return Some("too many messages that could not be obeyed");
        }
        if now.duration_since(window) > RATE_WINDOW {
            (window, count) = (now, 0);
        }
        count += 1;
        if count >= MAX_MESSAGES_PER_SECOND / 10 {
            time::sleep_until((window + RATE_WINDOW).into()).await;
        }
    }
}

async fn write(
    sink: &mut Sink,
    outbox: &Outbox,
    offered: &OfferedServices,
    actions: &ActionBridge,
    liveness: &WebSocketLiveness,
) -> CloseReason {
    const STALLED_CLIENT: CloseReason = Some("it takes no more data");
    let mut pieces = 0;
    let mut ping = liveness.ping_interval();
    let mut chores = time::interval(POLL_PERIOD);
    chores.set_missed_tick_behavior(time::MissedTickBehavior::Delay);
    loop {
        tokio::select! {
            () = outbox.ready() => {}
            _ = chores.tick() => {
                offered.expire(Instant::now());
                actions.poll(Instant::now());
                continue;
            }
            _ = ping.tick() => {
                if liveness.is_timed_out() {
                    return Some("it has been silent for too long");
                }
                if send(sink.send(Message::Ping(Default::default()))).await.is_err() {
                    return STALLED_CLIENT;
                }
                continue;
            }
        }
        loop {
            let Some(batch) = outbox.take_batch(Instant::now()) else {
                return Some("it asks and does not read the answers");
            };
            if batch.is_empty() {
                break;
            }
            for outgoing in batch {
                for message in websocket_frames(&outgoing, &mut pieces) {
                    if send(sink.feed(message)).await.is_err() {
                        return STALLED_CLIENT;
                    }
                }
            }
            if send(sink.flush()).await.is_err() {
                return STALLED_CLIENT;
            }
        }
    }
}

/// The connection is of no use any more.
struct ConnectionLost;

async fn send<E>(sending: impl Future<Output = Result<(), E>>) -> Result<(), ConnectionLost> {
    match time::timeout(SEND_TIMEOUT, sending).await {
        Ok(Ok(())) => Ok(()),
        _ => Err(ConnectionLost),
    }
}

/// The frames of something to send; `pieces` counts the messages that went in pieces, which gives them their ids.
fn websocket_frames(outgoing: &Outgoing, pieces: &mut u64) -> Vec<Message> {
    let (text, fragment_size): (Utf8Bytes, _) = match outgoing {
        Outgoing::Message(message, delivery) => {
            let text = match delivery.compression {
                Compression::None => message.text(delivery.ros_version),
                Compression::Png => message.png(delivery.ros_version),
                Compression::Cbor => {
                    return vec![Message::Binary(message.cbor(delivery.ros_version).clone())];
                }
                // Of a type that nobody knows there are no such bytes; the subscriber was told.
                Compression::CborRaw => {
                    return message.cbor_raw(wall_time).cloned().map(Message::Binary).into_iter().collect();
                }
            };
            (text.clone(), delivery.fragment_size)
        }
        Outgoing::Reply(reply) => match reply.compression {
            Compression::Png => (png::encode_message(&reply.text).into(), reply.fragment_size),
            _ => (reply.text.clone(), reply.fragment_size),
        },
    };
    let split = fragment_size.and_then(|size| fragments::split(&text, size, *pieces));
    match split {
        Some(parts) => {
            *pieces += 1;
            parts.into_iter().map(|part| Message::Text(part.into())).collect()
        }
        None => vec![Message::Text(text)],
    }
}
