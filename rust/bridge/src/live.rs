//! The WebSocket `/live`: JSON text messages, one object each, told apart by `type`.
//!
//! From the server: `hello {page_version, revision, brace_controller}` first; `frame` with the fields of
//! [`DisplayFrame`](proact_types::DisplayFrame) at the pace of publishing, the latest only; `events {events}`
//! with the events of frames that this client missed, at first those of the trial so far; `content {revision}`
//! when `/api/content` has changed; `status` with the fields of [`TrialStatus`](crate::TrialStatus); `pong {id, clock_ms}`;
//! `ghost {arm}` of a second arm that is only shown, with the fields of [`GhostArm`](crate::GhostArm), or null when it is gone;
//! `error {message}` when a message of the client was ignored; `driver {name, you, may_drive}` when another client
//! drives; `delay {ms}` while the round trip of this client's line is longer than the trial allows, null when it no longer is.
//!
//! The server measures the round trip by WebSocket pings, every 50 ms while a client drives. What comes over a line that is delayed
//! by more than `profile.dead_man.max_delay_ms` does not move the arm until its round trips are below 0.8 of that. A client whose library answers no ping is not judged.
//!
//! 64 clients may watch, 64 may drive and 16 conduct. A further one that may drive or conduct takes the place of the first of its kind that
//! does not drive and never answered a ping, whose connection is closed with code 1013. If all answer, it is refused with 503.
//!
//! One client drives: the first that says `join {name}` or sends anything, until its connection ends or another says
//! `take_over`. What the others send is ignored, but for a relaxed gesture: a stop is taken from everybody.
//!
//! From the client, if the page is interactive: `gesture {gesture}` at each change, `alive` every 40 ms while
//! one is held (nothing else keeps a gesture alive), `gaze {origin, direction, measured}`, `trunk {forward, lateral, axial}`, `head {position, quaternion}`,
//! `controller {hand, time_ms, position, quaternion, tracked}` of the one on the brace,
//! `restart {method, again}`, `gaze_check {source, points}`, `join`, `take_over`, `hold {on}`
//! while a dialog is open; `after {ask}` when a trial that was shown is over; always `drawn`, `ping {id}`, `seen {frames}` with
//! `{time, came_ms, shown_ms}` of each frame that was on a picture, on the clock that `pong` tells, and `watch {signals}`,
//! after which the participant's page gets signals too, or no longer. Metres, rad, frame `world`,
//! quaternions x, y, z, w. At most 64 KiB each, text only. A hundred malformed messages end the connection.
//!
//! `/live?role=experimenter` also gets `signals` with the fields of [`Signals`](crate::Signals), and may send
//! `study {action}` (`pause`, `resume`, `abort`, `check_gaze`) and `restart` even where the page is not interactive. Of a
//! study it gets `study` with the fields of [`ExperimenterScreen`](crate::ExperimenterScreen) and sends `conduct {ask}`
//! ([`StudyRequest`](crate::StudyRequest)); the participant's page gets `participant` with those of
//! [`ParticipantScreen`](crate::ParticipantScreen). Both send `answer {step, key, answer}` and `submit {step}`; whatever a page
//! is shown next says what became of it.
//! `/live?role=spectator` gets the same and may send nothing but `ping`. So may whoever has no right to
//! [act](proact_http::Right), whatever the role.

use crate::{
    client_slots::ClientSlot,
    feed::{PageFeed, ServerMessage},
    input::{self, ClientInput, ParsedMessage},
    input_arbiter::ClientId,
    round_trip::PING_PERIOD,
    server::PageServerState,
};
use axum::extract::ws::{CloseFrame, Message, Utf8Bytes, WebSocket, close_code};
use futures_util::{
    SinkExt, StreamExt,
    stream::{SplitSink, SplitStream},
};
use proact_http::{AccessRight, WebSocketLiveness};
use proact_types::Command;
use serde::Deserialize;
use std::{
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    time::{Duration, Instant},
};
use tokio::{sync::mpsc, sync::watch, time};

/// Longest message taken from a client, bytes: the longest answer in free words, each byte written as an escape of six.
pub(crate) const MAX_MESSAGE_BYTES: usize = 64 * 1024;
/// Malformed messages that a connection survives.
const MAX_MALFORMED_MESSAGES: usize = 100;
/// How often a page is told how much its line is delayed, while it is.
const DELAY_REPORT_PERIOD: Duration = Duration::from_millis(500);
/// A client that takes no byte for so long is gone or hopeless.
const SEND_TIMEOUT: Duration = Duration::from_secs(10);

/// What a connection may see and do.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(rename_all = "snake_case")]
pub(crate) enum Role {
    /// Drives, if the page is interactive.
    #[default]
    Participant,
    /// Watches the signals, pauses and ends trials.
    Experimenter,
    /// Watches the signals.
    Spectator,
}

impl Role {
    /// Whether `input` may come from it.
    fn check_permission(
        self,
        input: &ClientInput,
        right: AccessRight,
        interactive: bool,
    ) -> Result<(), &'static str> {
        match (self, input) {
            _ if right < AccessRight::Control => Err(
                "message ignored: this machine may only watch; open the address with the token, or start proact with \
                 --page-allow ADDRESS=act",
            ),
            (Role::Spectator, _) => Err("message ignored: a spectator only watches"),
            (
                Role::Experimenter,
                ClientInput::Study(_)
                | ClientInput::Restart { .. }
                | ClientInput::Conduct(_)
                | ClientInput::Answer(_)
                | ClientInput::Submit { .. },
            ) => Ok(()),
            // A stop is taken from everybody.
            (Role::Experimenter, ClientInput::Gesture(Command::NoMotion)) if interactive => Ok(()),
            (Role::Experimenter, _) => Err(DOES_NOT_DRIVE),
            (_, ClientInput::Study(_)) => {
                Err("message ignored: this is for the experimenter's page, /live?role=experimenter")
            }
            (Role::Participant, ClientInput::Conduct(_)) => {
                Err("message ignored: this is for the experimenter's page, /live?role=experimenter")
            }
            (_, ClientInput::After(_) | ClientInput::Answer(_) | ClientInput::Submit { .. }) => Ok(()),
            (_, _) if !interactive => Err("message ignored: this page only shows a trial"),
            _ => Ok(()),
        }
    }
}

const DOES_NOT_DRIVE: &str = "message ignored: this role does not drive; open the participant's page";

/// Whether a client may drive.
fn check_may_drive(role: Role, right: AccessRight, interactive: bool) -> Result<(), &'static str> {
    match role {
        Role::Participant => role.check_permission(&ClientInput::Disconnected, right, interactive),
        _ => Err(DOES_NOT_DRIVE),
    }
}

type Outgoing = SplitSink<WebSocket, Message>;

/// Serves one connection until it ends.
pub(crate) async fn serve(
    socket: WebSocket,
    shared: Arc<PageServerState>,
    role: Role,
    right: AccessRight,
    slot: ClientSlot,
) {
    let client = slot.client;
    shared.count_connection();
    let (outgoing, incoming) = socket.split();
    // Reading and writing are apart: a stop must come in while a slow line is still busy with a frame.
    // Few replies are kept: a client that floods us with errors and does not read gets no more of them.
    let (replies, reply_queue) = mpsc::channel(8);
    let updates = shared.feed.subscribe();
    let liveness = WebSocketLiveness::new(shared.limits);
    let watches = AtomicBool::new(role != Role::Participant);
    let reader = ClientReader {
        client,
        role,
        right,
        shared: &shared,
        pulse: &liveness,
        wants_signals: &watches,
        slot: &slot,
    };
    let writer = ClientWriter {
        client,
        role,
        right,
        shared: &shared,
        pulse: &liveness,
        wants_signals: &watches,
        slot: &slot,
    };
    tokio::select! {
        () = reader.read(incoming, replies) => {}
        () = writer.write(outgoing, updates, reply_queue) => {}
    }
    shared.disconnect(client);
}

/// Whose messages are read, and what they may bring.
struct ClientReader<'a> {
    client: u64,
    role: Role,
    right: AccessRight,
    shared: &'a PageServerState,
    pulse: &'a WebSocketLiveness,
    /// Signals are wanted.
    wants_signals: &'a AtomicBool,
    slot: &'a ClientSlot,
}

impl ClientReader<'_> {
    async fn read(self, mut incoming: SplitStream<WebSocket>, replies: mpsc::Sender<ClientReply>) {
        let ClientReader { client, role, right, shared, pulse: liveness, wants_signals: watches, slot } =
            self;
        let mut bad_messages = 0;
        while let Some(message) = incoming.next().await {
            liveness.record_received();
            let parsed = match message {
                Ok(Message::Text(text)) => input::parse(&text).and_then(|parsed| match &parsed {
                    ParsedMessage::Input(input) => role
                        .check_permission(input, right, shared.interactive())
                        .map_err(str::to_owned)
                        .and_then(|()| shared.check_offered(input))
                        .map(|()| parsed),
                    ParsedMessage::TakeOver => check_may_drive(role, right, shared.interactive())
                        .map(|()| parsed)
                        .map_err(str::to_owned),
                    ParsedMessage::Join(_)
                    | ParsedMessage::Drawn
                    | ParsedMessage::Alive
                    | ParsedMessage::Watch(_)
                    | ParsedMessage::Seen(_)
                    | ParsedMessage::Ping(_) => Ok(parsed),
                }),
                Ok(Message::Binary(data)) => {
                    Err(format!("message ignored: got {} binary bytes, expected JSON text", data.len()))
                }
                Ok(Message::Pong(carried)) => {
                    shared.input_arbiter().round_trip(client).record_pong(&carried, Instant::now());
                    slot.mark_responsive();
                    continue;
                }
                Ok(Message::Ping(_)) => continue,
                Ok(Message::Close(_)) => return,
                Err(error) => {
                    // Too long, not UTF-8, or the line is dead; the protocol cannot go on after any of them.
                    let reason = format!("connection closed: {error}");
                    return close_connection(replies, close_code::SIZE, reason).await;
                }
            };
            if parsed.is_ok() {
                slot.mark_active();
            }
            match parsed {
                Ok(ParsedMessage::Drawn) => shared.mark_drawn(),
                Ok(ParsedMessage::Input(
                    input @ (ClientInput::Study(_)
                    | ClientInput::After(_)
                    | ClientInput::Conduct(_)
                    | ClientInput::Answer(_)
                    | ClientInput::Submit { .. }),
                )) => shared.with_arbiter(|arbiter| arbiter.accept_command(input)),
                Ok(ParsedMessage::Input(input @ ClientInput::Restart { .. }))
                    if role == Role::Experimenter =>
                {
                    shared.with_arbiter(|arbiter| arbiter.accept_command(input))
                }
                Ok(ParsedMessage::Input(input)) => {
                    let is_request = !matches!(
                        input,
                        ClientInput::Gaze { .. } | ClientInput::Head(_) | ClientInput::Controller(_)
                    );
                    let taken =
                        shared.with_arbiter(|arbiter| arbiter.accept(client, Instant::now(), Some(input)));
                    if is_request && !taken {
                        let driver =
                            shared.input_arbiter().driver().1.map_or_else(String::new, |(_, name)| name);
                        let reason = format!("message ignored: {driver} drives; take_over comes first");
                        let _ = replies.try_send(ClientReply::Error(reason));
                    }
                }
                Ok(ParsedMessage::Join(name)) => {
                    let may = check_may_drive(role, right, shared.interactive()).is_ok();
                    shared.with_arbiter(|arbiter| {
                        arbiter.set_name(client, &name);
                        if may {
                            arbiter.join(client, Instant::now());
                        }
                    });
                }
                Ok(ParsedMessage::TakeOver) => {
                    shared.with_arbiter(|arbiter| arbiter.take_over(client, Instant::now()))
                }
                Ok(ParsedMessage::Alive) => {
                    shared.with_arbiter(|arbiter| arbiter.accept(client, Instant::now(), None));
                }
                Ok(ParsedMessage::Watch(signals)) => watches.store(signals, Ordering::Relaxed),
                Ok(ParsedMessage::Seen(frames)) => {
                    // Of several screens, that of whoever drives.
                    let driver = shared.input_arbiter().driver().1.map(|(driver, _)| driver);
                    if role == Role::Participant && driver.is_none_or(|driver| driver == client) {
                        shared.frame_latency().record_displayed(&frames);
                    }
                }
                // As with errors: who does not read gets no answers.
                Ok(ParsedMessage::Ping(id)) => {
                    let clock_ms = shared.frame_latency().clock_ms(Instant::now());
                    let _ = replies.try_send(ClientReply::Pong { id, clock_ms });
                }
                Err(reason) => {
                    bad_messages += 1;
                    if bad_messages == MAX_MALFORMED_MESSAGES {
                        let reason = format!("connection closed after {bad_messages} malformed messages");
                        return close_connection(replies, close_code::POLICY, reason).await;
                    }
                    // A full queue means that the client does not read: it has enough answers.
                    let _ = replies.try_send(ClientReply::Error(reason));
                }
            }
        }
    }
}

/// Something to tell this client alone.
enum ClientReply {
    Pong { id: u32, clock_ms: f64 },
    Error(String),
    Close(CloseFrame),
}

/// Has the writer close the connection, and waits for the writer to end it, which cancels this.
async fn close_connection(replies: mpsc::Sender<ClientReply>, code: u16, mut reason: String) {
    // The standard allows 123 bytes; the texts are ASCII.
    reason.truncate(120);
    let frame = CloseFrame { code, reason: reason.into() };
    if replies.send(ClientReply::Close(frame)).await.is_ok() {
        replies.closed().await;
    }
}

/// To whom the news go.
struct ClientWriter<'a> {
    client: u64,
    role: Role,
    right: AccessRight,
    shared: &'a PageServerState,
    pulse: &'a WebSocketLiveness,
    /// Signals are wanted.
    wants_signals: &'a AtomicBool,
    slot: &'a ClientSlot,
}

impl ClientWriter<'_> {
    async fn write(
        self,
        mut outgoing: Outgoing,
        mut updates: watch::Receiver<PageFeed>,
        mut replies: mpsc::Receiver<ClientReply>,
    ) {
        let ClientWriter { role, shared, pulse: liveness, wants_signals: watches, slot, .. } = self;
        let (page_version, brace_controller) = (&*shared.page_version, shared.brace_controller);
        let mut ping = liveness.ping_interval();
        // A client that comes late is told the whole trial's events: its score and list are then right.
        let mut seen = FeedCursor { revision: updates.borrow().revision, ..FeedCursor::default() };
        let revision = seen.revision;
        let hello = ServerMessage::Hello { page_version, revision, brace_controller }.to_text();
        if send(&mut outgoing, Message::Text(hello)).await.is_err() {
            return;
        }
        updates.mark_changed();
        let mut echoes = time::interval(PING_PERIOD);
        echoes.set_missed_tick_behavior(time::MissedTickBehavior::Delay);
        let mut line = RoundTripReporter::default();
        loop {
            let sent = tokio::select! {
                biased;
                () = slot.wait_for_eviction() => {
                    let reason = Utf8Bytes::from_static("another page needed the place");
                    let _ = send(&mut outgoing, Message::Close(Some(CloseFrame { code: close_code::AGAIN, reason }))).await;
                    return;
                }
                _ = echoes.tick() => send_each(&mut outgoing, line.poll(&self, Instant::now())).await,
                reply = replies.recv() => match reply {
                    Some(ClientReply::Pong { id, clock_ms }) => {
                        send(&mut outgoing, Message::Text(ServerMessage::Pong { id, clock_ms }.to_text())).await
                    }
                    Some(ClientReply::Error(message)) => {
                        let text = ServerMessage::Error { message: &message }.to_text();
                        send(&mut outgoing, Message::Text(text)).await
                    }
                    Some(ClientReply::Close(frame)) => {
                        let _ = send(&mut outgoing, Message::Close(Some(frame))).await;
                        return;
                    }
                    None => return,
                },
                changed = updates.changed() => {
                    if changed.is_err() {
                        return;
                    }
                    let (mut messages, driver) = {
                        let feed = updates.borrow_and_update();
                        (seen.pending_messages(&feed, role, watches.load(Ordering::Relaxed)), (feed.driver.0 != seen.driver).then(|| feed.driver.clone()))
                    };
                    if let Some((changes, driver)) = driver {
                        seen.driver = changes;
                        messages.push(self.driver_message(driver));
                    }
                    send_all(&mut outgoing, messages).await
                }
                _ = ping.tick() => match liveness.is_timed_out() {
                    true => Err(ClientLost),
                    false => send(&mut outgoing, Message::Ping(Default::default())).await,
                },
            };
            if sent.is_err() {
                return;
            }
        }
    }

    /// Who drives, as this client is told.
    fn driver_message(&self, driver: Option<(ClientId, String)>) -> Utf8Bytes {
        let may_drive = check_may_drive(self.role, self.right, self.shared.interactive()).is_ok();
        let you = driver.as_ref().is_some_and(|(client, _)| *client == self.client);
        let name = driver.as_ref().map(|(_, name)| name.as_str());
        ServerMessage::Driver { name, you, may_drive }.to_text()
    }
}

/// What a client was told of its line.
#[derive(Debug, Default)]
struct RoundTripReporter {
    ping_sent: bool,
    /// When it was told a delay last; none while it knows of none.
    last_report: Option<Instant>,
}

impl RoundTripReporter {
    /// A ping if one is due: once to each client, to learn whether it answers, then as long as it drives. And the delay, when it
    /// comes, goes on and ends.
    fn poll(&mut self, writer: &ClientWriter<'_>, now: Instant) -> Vec<Message> {
        let ClientWriter { client, role, right, shared, .. } = writer;
        let may_drive = check_may_drive(*role, *right, shared.interactive()).is_ok();
        if self.ping_sent && !may_drive {
            return Vec::new();
        }
        let mut arbiter = shared.input_arbiter();
        let mut messages = Vec::new();
        if !self.ping_sent || arbiter.is_driver(*client) {
            self.ping_sent = true;
            messages.extend(
                arbiter.round_trip(*client).next_ping(now).map(|carried| Message::Ping(carried.into())),
            );
        }
        let delay = arbiter.excess_delay(*client, now);
        let due = match (delay, self.last_report) {
            (Some(_), Some(reported_at)) => now.duration_since(reported_at) >= DELAY_REPORT_PERIOD,
            (delay, reported_at) => delay.is_some() != reported_at.is_some(),
        };
        if due {
            self.last_report = delay.map(|_| now);
            let ms = delay.map(|delay| delay.as_secs_f64() * 1e3);
            messages.push(Message::Text(ServerMessage::Delay { ms }.to_text()));
        }
        messages
    }
}

/// How much of the feed a client has seen.
#[derive(Debug, Default)]
struct FeedCursor {
    revision: u64,
    sequence: u64,
    status: u64,
    study: u64,
    ghost: u64,
    signals: u64,
    driver: u64,
}

impl FeedCursor {
    /// What it has not seen yet, at most seven messages.
    fn pending_messages(&mut self, feed: &PageFeed, role: Role, watches: bool) -> Vec<Utf8Bytes> {
        let mut messages = Vec::with_capacity(7);
        if feed.revision != self.revision {
            self.revision = feed.revision;
            messages.push(ServerMessage::Content { revision: feed.revision }.to_text());
        }
        if feed.status.0 != self.status {
            self.status = feed.status.0;
            messages.extend(feed.status.1.clone());
        }
        if feed.study.0 != self.study {
            self.study = feed.study.0;
            messages.extend(feed.study.1.as_ref().and_then(|study| study.for_role(role)));
        }
        if feed.sequence != self.sequence {
            messages.extend(feed.missed_events(self.sequence));
            messages.extend(feed.frame.clone());
            self.sequence = feed.sequence;
        }
        if feed.ghost.0 != self.ghost {
            messages.extend(feed.ghost.1.clone());
            self.ghost = feed.ghost.0;
        }
        if watches && feed.signals.0 != self.signals {
            messages.extend(feed.signals.1.clone());
            self.signals = feed.signals.0;
        }
        messages
    }
}

/// The connection is of no use any more.
struct ClientLost;

async fn send_all(outgoing: &mut Outgoing, messages: Vec<Utf8Bytes>) -> Result<(), ClientLost> {
    send_each(outgoing, messages.into_iter().map(Message::Text)).await
}

async fn send_each(
    outgoing: &mut Outgoing,
    messages: impl IntoIterator<Item = Message>,
) -> Result<(), ClientLost> {
    for message in messages {
        send(outgoing, message).await?;
    }
    Ok(())
}

async fn send(outgoing: &mut Outgoing, message: Message) -> Result<(), ClientLost> {
    match time::timeout(SEND_TIMEOUT, outgoing.send(message)).await {
        Ok(Ok(())) => Ok(()),
        _ => Err(ClientLost),
    }
}
