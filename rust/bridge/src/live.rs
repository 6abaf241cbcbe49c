//! The WebSocket `/live`: JSON text messages, one object each, told apart by `type`.
//!
//! From the server: `hello {page_version, revision}` first; `frame` with the fields of
//! [`DisplayFrame`](proact_types::DisplayFrame) at the pace of publishing, the latest only; `events {events}`
//! with the events of frames that this client missed, at first those of the trial so far; `content {revision}` when `/api/content` has changed;
//! `error {message}` when a message of the client was ignored.
//!
//! From the client, if the page is interactive: `gesture {gesture}` at each change, `alive` every 100 ms while
//! one is held, `gaze {origin, direction}`, `trunk {forward, lateral, axial}`, `restart`. Metres, rad,
//! frame `world`. At most 4 KiB each, text only. A hundred malformed messages end the connection.

use crate::{
    feed::{Feed, ServerMessage},
    input,
    server::Shared,
};
use axum::extract::ws::{CloseFrame, Message, Utf8Bytes, WebSocket, close_code};
use futures_util::{
    SinkExt, StreamExt,
    stream::{SplitSink, SplitStream},
};
use std::{sync::Arc, time::Duration, time::Instant};
use tokio::{sync::mpsc, sync::watch, time};

/// Longest message taken from a client, bytes. The longest sensible one has about 200.
pub(crate) const MAX_MESSAGE_BYTES: usize = 4096;
/// Malformed messages that a connection survives.
const MAX_BAD_MESSAGES: usize = 100;
/// A client that takes no byte for so long is gone or hopeless.
const SEND_TIMEOUT: Duration = Duration::from_secs(10);
/// Without frames a ping finds out whether the client still is there.
const PING_PERIOD: Duration = Duration::from_secs(5);

type Outgoing = SplitSink<WebSocket, Message>;

/// Serves one connection until it ends.
pub(crate) async fn serve(socket: WebSocket, shared: Arc<Shared>) {
    let client = shared.enter();
    let (outgoing, incoming) = socket.split();
    // Reading and writing are apart: a stop must come in while a slow line is still busy with a frame.
    // Few replies are kept: a client that floods us with errors and does not read gets no more of them.
    let (replies, reply_queue) = mpsc::channel(8);
    let updates = shared.feed.subscribe();
    let version = shared.page_version.clone();
    tokio::select! {
        () = read(incoming, client, &shared, replies) => {}
        () = write(outgoing, updates, reply_queue, version) => {}
    }
    shared.leave(client);
}

async fn read(
    mut incoming: SplitStream<WebSocket>,
    client: u64,
    shared: &Shared,
    replies: mpsc::Sender<Reply>,
) {
    let mut bad_messages = 0;
    while let Some(message) = incoming.next().await {
        let parsed = match message {
            Ok(Message::Text(text)) if shared.interactive() => input::parse(&text),
            Ok(Message::Text(_)) => Err("message ignored: this page only shows a trial".to_owned()),
            Ok(Message::Binary(data)) => {
                Err(format!("message ignored: got {} binary bytes, expected JSON text", data.len()))
            }
            Ok(Message::Ping(_) | Message::Pong(_)) => continue,
            Ok(Message::Close(_)) => return,
            Err(error) => {
                // Too long, not UTF-8, or the line is dead; the protocol cannot go on after any of them.
                let reason = format!("connection closed: {error}");
                return end(replies, close_code::SIZE, reason).await;
            }
        };
        match parsed {
            Ok(input) => shared.pilot().accept(client, Instant::now(), input),
            Err(reason) => {
                bad_messages += 1;
                if bad_messages == MAX_BAD_MESSAGES {
                    let reason = format!("connection closed after {bad_messages} malformed messages");
                    return end(replies, close_code::POLICY, reason).await;
                }
                // A full queue means that the client does not read: it has enough answers.
                let _ = replies.try_send(Reply::Error(reason));
            }
        }
    }
}

/// Something to tell this client alone.
enum Reply {
    Error(String),
    Close(CloseFrame),
}

/// Has the writer close the connection, and waits for the writer to end it, which cancels this.
async fn end(replies: mpsc::Sender<Reply>, code: u16, mut reason: String) {
    // The standard allows 123 bytes; the texts are ASCII.
    reason.truncate(120);
    let frame = CloseFrame { code, reason: reason.into() };
    if replies.send(Reply::Close(frame)).await.is_ok() {
        replies.closed().await;
    }
}

async fn write(
    mut outgoing: Outgoing,
    mut updates: watch::Receiver<Feed>,
    mut replies: mpsc::Receiver<Reply>,
    page_version: String,
) {
    let mut ping = time::interval_at(time::Instant::now() + PING_PERIOD, PING_PERIOD);
    // A client that comes late is told the whole trial's events: its score and list are then right.
    let (mut revision, mut seen) = (updates.borrow().revision, 0);
    let hello = ServerMessage::Hello { page_version: &page_version, revision }.to_text();
    if send(&mut outgoing, Message::Text(hello)).await.is_err() {
        return;
    }
    updates.mark_changed();
    loop {
        let sent = tokio::select! {
            biased;
            reply = replies.recv() => match reply {
                Some(Reply::Error(message)) => {
                    let text = ServerMessage::Error { message: &message }.to_text();
                    send(&mut outgoing, Message::Text(text)).await
                }
                Some(Reply::Close(frame)) => {
                    let _ = send(&mut outgoing, Message::Close(Some(frame))).await;
                    return;
                }
                None => return,
            },
            changed = updates.changed() => {
                if changed.is_err() {
                    return;
                }
                let messages = news(&updates.borrow_and_update(), &mut revision, &mut seen);
                send_all(&mut outgoing, messages).await
            }
            _ = ping.tick() => send(&mut outgoing, Message::Ping(Default::default())).await,
        };
        if sent.is_err() {
            return;
        }
    }
}

/// What a client has not seen yet of the feed, at most three messages.
fn news(feed: &Feed, revision: &mut u64, seen: &mut u64) -> Vec<Utf8Bytes> {
    let mut messages = Vec::with_capacity(3);
    if feed.revision != *revision {
        *revision = feed.revision;
        messages.push(ServerMessage::Content { revision: feed.revision }.to_text());
    }
    if feed.sequence != *seen {
        messages.extend(feed.missed_events(*seen));
        messages.extend(feed.frame.clone());
        *seen = feed.sequence;
    }
    messages
}

/// The connection is of no use any more.
struct Lost;

async fn send_all(outgoing: &mut Outgoing, messages: Vec<Utf8Bytes>) -> Result<(), Lost> {
    for text in messages {
        send(outgoing, Message::Text(text)).await?;
    }
    Ok(())
}

async fn send(outgoing: &mut Outgoing, message: Message) -> Result<(), Lost> {
    match time::timeout(SEND_TIMEOUT, outgoing.send(message)).await {
        Ok(Ok(())) => Ok(()),
        _ => Err(Lost),
    }
}
