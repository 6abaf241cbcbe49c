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
//! by more than `profile.dead_man.delay_ms` does not move the arm. A client whose library answers no ping is not judged.
//!
//! 64 clients may watch, 64 may drive and 16 conduct; further ones that may drive or conduct take the place of the one of their kind
//! that came first and does not drive, whose connection is closed with code 1013.
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
    feed::{Feed, ServerMessage},
    input::{self, ClientInput, Parsed},
    input_arbiter::ClientId,
    line_delay::ECHO_PERIOD,
    places::Place,
    server::Shared,
};
use axum::extract::ws::{CloseFrame, Message, Utf8Bytes, WebSocket, close_code};
use futures_util::{
    SinkExt, StreamExt,
    stream::{SplitSink, SplitStream},
};
use proact_http::{Pulse, Right};
use proact_types::Gesture;
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
const MAX_BAD_MESSAGES: usize = 100;
/// How often a page is told how much its line is delayed, while it is.
const DELAY_TOLD_EVERY: Duration = Duration::from_millis(500);
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
    fn may(self, input: &ClientInput, right: Right, interactive: bool) -> Result<(), &'static str> {
        match (self, input) {
            _ if right < Right::Act => Err(
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
            (Role::Experimenter, ClientInput::Gesture(Gesture::NoMotion)) if interactive => Ok(()),
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
fn drives(role: Role, right: Right, interactive: bool) -> Result<(), &'static str> {
    match role {
        Role::Participant => role.may(&ClientInput::Disconnected, right, interactive),
        _ => Err(DOES_NOT_DRIVE),
    }
}

type Outgoing = SplitSink<WebSocket, Message>;

/// Serves one connection until it ends.
pub(crate) async fn serve(socket: WebSocket, shared: Arc<Shared>, role: Role, right: Right, place: Place) {
    let client = place.client;
    shared.enter();
    let (outgoing, incoming) = socket.split();
    // Reading and writing are apart: a stop must come in while a slow line is still busy with a frame.
    // Few replies are kept: a client that floods us with errors and does not read gets no more of them.
    let (replies, reply_queue) = mpsc::channel(8);
    let updates = shared.feed.subscribe();
    let pulse = Pulse::new(shared.limits);
    let watches = AtomicBool::new(role != Role::Participant);
    let reader =
        Reader { client, role, right, shared: &shared, pulse: &pulse, watches: &watches, place: &place };
    let writer =
        Writer { client, role, right, shared: &shared, pulse: &pulse, watches: &watches, place: &place };
    tokio::select! {
        () = reader.read(incoming, replies) => {}
        () = writer.write(outgoing, updates, reply_queue) => {}
    }
    shared.leave(client);
}

/// Whose messages are read, and what they may bring.
struct Reader<'a> {
    client: u64,
    role: Role,
    right: Right,
    shared: &'a Shared,
    pulse: &'a Pulse,
    /// Signals are wanted.
    watches: &'a AtomicBool,
    place: &'a Place,
}

impl Reader<'_> {
    async fn read(self, mut incoming: SplitStream<WebSocket>, replies: mpsc::Sender<Reply>) {
        let Reader { client, role, right, shared, pulse, watches, place } = self;
        let mut bad_messages = 0;
        while let Some(message) = incoming.next().await {
            pulse.beat();
            let parsed = match message {
                Ok(Message::Text(text)) => input::parse(&text).and_then(|parsed| match &parsed {
                    Parsed::Input(input) => role
                        .may(input, right, shared.interactive())
                        .map_err(str::to_owned)
                        .and_then(|()| shared.offers(input))
                        .map(|()| parsed),
                    Parsed::TakeOver => {
                        drives(role, right, shared.interactive()).map(|()| parsed).map_err(str::to_owned)
                    }
                    Parsed::Join(_)
                    | Parsed::Drawn
                    | Parsed::Alive
                    | Parsed::Watch(_)
                    | Parsed::Seen(_)
                    | Parsed::Ping(_) => Ok(parsed),
                }),
                Ok(Message::Binary(data)) => {
                    Err(format!("message ignored: got {} binary bytes, expected JSON text", data.len()))
                }
                Ok(Message::Pong(carried)) => {
                    shared.input_arbiter().line(client).answer(&carried, Instant::now());
                    continue;
                }
                Ok(Message::Ping(_)) => continue,
                Ok(Message::Close(_)) => return,
                Err(error) => {
                    // Too long, not UTF-8, or the line is dead; the protocol cannot go on after any of them.
                    let reason = format!("connection closed: {error}");
                    return end(replies, close_code::SIZE, reason).await;
                }
            };
            if parsed.is_ok() {
                place.note_speech();
            }
            match parsed {
                Ok(Parsed::Drawn) => shared.note_drawn(),
                Ok(Parsed::Input(
                    input @ (ClientInput::Study(_)
                    | ClientInput::After(_)
                    | ClientInput::Conduct(_)
                    | ClientInput::Answer(_)
                    | ClientInput::Submit { .. }),
                )) => shared.arbitrate(|arbiter| arbiter.command(input)),
                Ok(Parsed::Input(input @ ClientInput::Restart { .. })) if role == Role::Experimenter => {
                    shared.arbitrate(|arbiter| arbiter.command(input))
                }
                Ok(Parsed::Input(input)) => {
                    let asks = !matches!(
                        input,
                        ClientInput::Gaze { .. } | ClientInput::Head(_) | ClientInput::Controller(_)
                    );
                    let taken =
                        shared.arbitrate(|arbiter| arbiter.accept(client, Instant::now(), Some(input)));
                    if asks && !taken {
                        let driver =
                            shared.input_arbiter().driver().1.map_or_else(String::new, |(_, name)| name);
                        let reason = format!("message ignored: {driver} drives; take_over comes first");
                        let _ = replies.try_send(Reply::Error(reason));
                    }
                }
                Ok(Parsed::Join(name)) => {
                    let may = drives(role, right, shared.interactive()).is_ok();
                    shared.arbitrate(|arbiter| {
                        arbiter.name(client, &name);
                        if may {
                            arbiter.join(client, Instant::now());
                        }
                    });
                }
                Ok(Parsed::TakeOver) => shared.arbitrate(|arbiter| arbiter.take_over(client, Instant::now())),
                Ok(Parsed::Alive) => {
                    shared.arbitrate(|arbiter| arbiter.accept(client, Instant::now(), None));
                }
                Ok(Parsed::Watch(signals)) => watches.store(signals, Ordering::Relaxed),
                Ok(Parsed::Seen(frames)) => {
                    // Of several screens, that of whoever drives.
                    let driver = shared.input_arbiter().driver().1.map(|(driver, _)| driver);
                    if role == Role::Participant && driver.is_none_or(|driver| driver == client) {
                        shared.pictures().see(&frames);
                    }
                }
                // As with errors: who does not read gets no answers.
                Ok(Parsed::Ping(id)) => {
                    let clock_ms = shared.pictures().clock_ms(Instant::now());
                    let _ = replies.try_send(Reply::Pong { id, clock_ms });
                }
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
}

/// Something to tell this client alone.
enum Reply {
    Pong { id: u32, clock_ms: f64 },
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

/// To whom the news go.
struct Writer<'a> {
    client: u64,
    role: Role,
    right: Right,
    shared: &'a Shared,
    pulse: &'a Pulse,
    /// Signals are wanted.
    watches: &'a AtomicBool,
    place: &'a Place,
}

impl Writer<'_> {
    async fn write(
        self,
        mut outgoing: Outgoing,
        mut updates: watch::Receiver<Feed>,
        mut replies: mpsc::Receiver<Reply>,
    ) {
        let Writer { role, shared, pulse, watches, place, .. } = self;
        let (page_version, brace_controller) = (&*shared.page_version, shared.brace_controller);
        let mut ping = pulse.pings();
        // A client that comes late is told the whole trial's events: its score and list are then right.
        let mut seen = Seen { revision: updates.borrow().revision, ..Seen::default() };
        let revision = seen.revision;
        let hello = ServerMessage::Hello { page_version, revision, brace_controller }.to_text();
        if send(&mut outgoing, Message::Text(hello)).await.is_err() {
            return;
        }
        updates.mark_changed();
        let mut echoes = time::interval(ECHO_PERIOD);
        echoes.set_missed_tick_behavior(time::MissedTickBehavior::Delay);
        let mut line = Line::default();
        loop {
            let sent = tokio::select! {
                biased;
                () = place.lost() => {
                    let reason = Utf8Bytes::from_static("another page needed the place");
                    let _ = send(&mut outgoing, Message::Close(Some(CloseFrame { code: close_code::AGAIN, reason }))).await;
                    return;
                }
                _ = echoes.tick() => send_each(&mut outgoing, line.look(&self, Instant::now())).await,
                reply = replies.recv() => match reply {
                    Some(Reply::Pong { id, clock_ms }) => {
                        send(&mut outgoing, Message::Text(ServerMessage::Pong { id, clock_ms }.to_text())).await
                    }
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
                    let (mut messages, driver) = {
                        let feed = updates.borrow_and_update();
                        (seen.news(&feed, role, watches.load(Ordering::Relaxed)), (feed.driver.0 != seen.driver).then(|| feed.driver.clone()))
                    };
                    if let Some((changes, driver)) = driver {
                        seen.driver = changes;
                        messages.push(self.tell(driver));
                    }
                    send_all(&mut outgoing, messages).await
                }
                _ = ping.tick() => match pulse.is_lost() {
                    true => Err(Lost),
                    false => send(&mut outgoing, Message::Ping(Default::default())).await,
                },
            };
            if sent.is_err() {
                return;
            }
        }
    }

    /// Who drives, as this client is told.
    fn tell(&self, driver: Option<(ClientId, String)>) -> Utf8Bytes {
        let may_drive = drives(self.role, self.right, self.shared.interactive()).is_ok();
        let you = driver.as_ref().is_some_and(|(client, _)| *client == self.client);
        let name = driver.as_ref().map(|(_, name)| name.as_str());
        ServerMessage::Driver { name, you, may_drive }.to_text()
    }
}

/// What a client was told of its line.
#[derive(Debug, Default)]
struct Line {
    asked: bool,
    /// When it was told a delay last; none while it knows of none.
    told: Option<Instant>,
}

impl Line {
    /// A ping if one is due: once to whoever may drive, to learn whether it answers, then as long as it drives. And the delay, when
    /// it comes, goes on and ends.
    fn look(&mut self, writer: &Writer<'_>, now: Instant) -> Vec<Message> {
        let Writer { client, role, right, shared, .. } = writer;
        if drives(*role, *right, shared.interactive()).is_err() {
            return Vec::new();
        }
        let mut arbiter = shared.input_arbiter();
        let mut messages = Vec::new();
        if !self.asked || arbiter.drives(*client) {
            self.asked = true;
            messages.extend(arbiter.line(*client).ask(now).map(|carried| Message::Ping(carried.into())));
        }
        let delay = arbiter.delay(*client, now);
        let due = match (delay, self.told) {
            (Some(_), Some(told)) => now.duration_since(told) >= DELAY_TOLD_EVERY,
            (delay, told) => delay.is_some() != told.is_some(),
        };
        if due {
            self.told = delay.map(|_| now);
            let ms = delay.map(|delay| delay.as_secs_f64() * 1e3);
            messages.push(Message::Text(ServerMessage::Delay { ms }.to_text()));
        }
        messages
    }
}

/// How much of the feed a client has seen.
#[derive(Debug, Default)]
struct Seen {
    revision: u64,
    sequence: u64,
    status: u64,
    study: u64,
    ghost: u64,
    signals: u64,
    driver: u64,
}

impl Seen {
    /// What it has not seen yet, at most seven messages.
    fn news(&mut self, feed: &Feed, role: Role, watches: bool) -> Vec<Utf8Bytes> {
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
            messages.extend(feed.study.1.as_ref().and_then(|study| study.of(role)));
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
struct Lost;

async fn send_all(outgoing: &mut Outgoing, messages: Vec<Utf8Bytes>) -> Result<(), Lost> {
    send_each(outgoing, messages.into_iter().map(Message::Text)).await
}

async fn send_each(outgoing: &mut Outgoing, messages: impl IntoIterator<Item = Message>) -> Result<(), Lost> {
    for message in messages {
        send(outgoing, message).await?;
    }
    Ok(())
}

async fn send(outgoing: &mut Outgoing, message: Message) -> Result<(), Lost> {
    match time::timeout(SEND_TIMEOUT, outgoing.send(message)).await {
        Ok(Ok(())) => Ok(()),
        _ => Err(Lost),
    }
}
