//! The page's server as a browser meets it: plain HTTP and the WebSocket, over a real socket on a port that the
//! system chooses. All waiting is for an answer, with a limit that only a fault reaches.

#![allow(clippy::unwrap_used, clippy::disallowed_methods)]

mod common;

use common::*;
use futures_util::{SinkExt, StreamExt};
use nalgebra::{Point3, Vector3};
use proact_bridge::{
    BridgeError, ClientInput, PageOptions, PageServer, RecordedTrial, Signals, StudyAction, TrialLibrary,
    TrialStatus, TrialSummary,
};
use proact_http::ServeError;
use proact_types::*;
use serde_json::Value;
use std::{
    sync::{
        Arc,
        atomic::{AtomicBool, AtomicUsize, Ordering},
    },
    time::{Duration, Instant},
};
use tokio::{
    io::{AsyncReadExt, AsyncWriteExt},
    net::TcpStream,
};
use tokio_tungstenite::{
    connect_async,
    tungstenite::{self, Message, client::IntoClientRequest},
};

async fn get(server: &PageServer, path: &str) -> String {
    let authority = authority(server);
    let mut stream = TcpStream::connect(&authority).await.unwrap();
    let request = format!("GET {path} HTTP/1.1\r\nHost: {authority}\r\nConnection: close\r\n\r\n");
    stream.write_all(request.as_bytes()).await.unwrap();
    let mut answer = Vec::new();
    tokio::time::timeout(TIMEOUT, stream.read_to_end(&mut answer)).await.expect("no answer in time").unwrap();
    String::from_utf8_lossy(&answer).into_owned()
}

#[tokio::test]
async fn page_content_and_health_are_served() {
    let server = start(true);
    let first = get(&server, "/").await;
    assert!(first.contains("<title>ProACT"));
    // Scripts have the hash of their content in their names.
    let named = first.split('"').find(|part| part.starts_with("/app-") && part.ends_with(".js")).unwrap();
    assert!(get(&server, named).await.starts_with("HTTP/1.1 200"));
    assert!(get(&server, "/healthz").await.ends_with("ok\n"));
    assert!(get(&server, "/meshes/no_such.stl").await.starts_with("HTTP/1.1 404"));
    assert!(get(&server, "/..%2fCargo.toml").await.starts_with("HTTP/1.1 404"));
    let answer = get(&server, "/api/content").await;
    let json: Value = serde_json::from_str(answer.split("\r\n\r\n").nth(1).unwrap()).unwrap();
    assert_eq!(json["arm"]["joints"][0]["name"], "elbow");
    assert_eq!(json["interactive"], true);
}

#[tokio::test]
async fn a_camera_sees_the_latest_instant_once_there_is_one() {
    let server = start(false);
    assert!(get(&server, "/camera.png").await.starts_with("HTTP/1.1 503"));
    server.publish(&frame(42));
    let answer = get(&server, "/camera.png?view=overhead&width=64&height=48").await;
    assert!(answer.starts_with("HTTP/1.1 200") && answer.contains("content-type: image/png"), "{answer}");
    let answer = get(&server, "/camera.json?width=64&height=48&fov=90").await;
    let json: Value = serde_json::from_str(answer.split("\r\n\r\n").nth(1).unwrap()).unwrap();
    assert_eq!((&json["time"], &json["width"]), (&42.into(), &64.into()));
    assert!((json["k"][0].as_f64().unwrap() - 24.0).abs() < 1e-9, "{}", json["k"]);
    assert!(json["png"].as_str().unwrap().starts_with("iVBORw0KGgo"), "the first bytes of a PNG file");
    for wrong in ["width=8", "height=100000", "fov=180", "fov=NaN", "view=behind", "zoom=2", "width=x"] {
        let answer = get(&server, &format!("/camera.png?{wrong}")).await;
        assert!(answer.starts_with("HTTP/1.1 400"), "{wrong}: {answer}");
    }
}

#[tokio::test]
async fn a_published_frame_arrives_whole() {
    let server = start(true);
    let mut client = connect(&server).await;
    let sent = frame(17);
    server.publish(&sent);
    let message = next_of_type(&mut client, "frame").await;
    assert_eq!(serde_json::from_value::<DisplayFrame>(message).unwrap(), sent);
}

#[tokio::test]
async fn a_client_that_comes_late_gets_the_latest_frame_at_once() {
    let server = start(true);
    server.publish(&frame(1));
    server.publish(&frame(2));
    let mut client = connect(&server).await;
    assert_eq!(next(&mut client).await["time"], 2);
}

#[tokio::test]
async fn inputs_arrive_in_order() {
    let server = start(true);
    let mut client = connect(&server).await;
    send_text(&mut client, r#"{"type":"gaze","origin":[0,0,1],"direction":[2,0,0]}"#).await;
    send_text(&mut client, r#"{"type":"gesture","gesture":"wrist_flexion"}"#).await;
    send_text(&mut client, r#"{"type":"gesture","gesture":"no_motion"}"#).await;
    send_text(&mut client, r#"{"type":"trunk","forward":0.1,"lateral":0,"axial":0}"#).await;
    send_text(&mut client, r#"{"type":"restart"}"#).await;
    assert_eq!(
        await_inputs(&server, 5).await,
        [
            ClientInput::Gaze {
                origin: Point3::new(0.0, 0.0, 1.0),
                direction: Vector3::x(),
                measured: false
            },
            ClientInput::Gesture(Command::WristFlexion),
            ClientInput::Gesture(Command::NoMotion),
            ClientInput::Trunk(TrunkPosture { forward: 0.1, lateral: 0.0, axial: 0.0 }),
            ClientInput::Restart { method: None, same_seed: false },
        ]
    );
}

#[tokio::test]
async fn malformed_messages_are_answered_and_the_connection_goes_on() {
    let server = start(true);
    let mut client = connect(&server).await;
    for (text, part) in [
        ("not json", "expected"),
        (r#"{"type":"gesture","gesture":"wave"}"#, "wave"),
        (r#"{"type":"gaze","origin":[0,0,1e7],"direction":[1,0,0]}"#, "origin"),
    ] {
        send_text(&mut client, text).await;
        let message = next_of_type(&mut client, "error").await["message"].as_str().unwrap().to_owned();
        assert!(message.contains(part), "{text} gave {message}");
    }
    client.send(Message::binary(vec![0xff; 10])).await.unwrap();
    assert!(
        next_of_type(&mut client, "error").await["message"].as_str().unwrap().contains("10 binary bytes")
    );
    send_text(&mut client, r#"{"type":"gesture","gesture":"hand_close"}"#).await;
    assert_eq!(await_inputs(&server, 1).await, [ClientInput::Gesture(Command::HandClose)]);
}

#[tokio::test]
async fn an_oversized_message_ends_the_connection_and_stops_the_arm() {
    let server = start(true);
    let mut client = connect(&server).await;
    send_text(&mut client, r#"{"type":"gesture","gesture":"wrist_extension"}"#).await;
    // The server may hang up while the rest is still being sent.
    let _ = client.send(Message::text("x".repeat(100_000))).await;
    assert_eq!(
        await_inputs(&server, 3).await,
        [
            ClientInput::Gesture(Command::WristExtension),
            ClientInput::Gesture(Command::NoMotion),
            ClientInput::Disconnected
        ]
    );
}

#[tokio::test]
async fn a_flood_of_malformed_messages_ends_the_connection() {
    let server = start(true);
    let mut client = connect(&server).await;
    let mut closed = None;
    for _ in 0..1000 {
        if client.send(Message::text("?")).await.is_err() {
            break;
        }
    }
    while let Ok(Some(Ok(message))) = tokio::time::timeout(TIMEOUT, client.next()).await {
        if let Message::Close(frame) = message {
            closed = frame;
        }
    }
    // The close frame may be lost when the line is reset under the flood; if it came, it says why.
    if let Some(frame) = closed {
        assert!(frame.reason.contains("malformed"), "{frame:?}");
    }
    wait_for_clients(&server, 0).await;
}

async fn wait_for_clients(server: &PageServer, count: usize) {
    let start = Instant::now();
    while server.client_count() != count {
        assert!(start.elapsed() < TIMEOUT, "{} clients, expected {count}", server.client_count());
        tokio::task::yield_now().await;
    }
}

#[tokio::test]
async fn a_client_that_disconnects_while_holding_a_gesture_releases_it() {
    let server = start(true);
    let mut client = connect(&server).await;
    send_text(&mut client, r#"{"type":"gesture","gesture":"wrist_extension"}"#).await;
    assert_eq!(await_inputs(&server, 1).await, [ClientInput::Gesture(Command::WristExtension)]);
    drop(client);
    assert_eq!(
        await_inputs(&server, 2).await,
        [ClientInput::Gesture(Command::NoMotion), ClientInput::Disconnected]
    );
}

#[tokio::test]
async fn a_client_that_falls_silent_while_holding_a_gesture_releases_it() {
    let server = start(true);
    let mut client = connect(&server).await;
    send_text(&mut client, r#"{"type":"gesture","gesture":"wrist_extension"}"#).await;
    let got = await_inputs(&server, 2).await;
    assert_eq!(got, [ClientInput::Gesture(Command::WristExtension), ClientInput::Gesture(Command::NoMotion)]);
    drop(client);
}

#[tokio::test]
async fn a_page_that_only_shows_takes_no_input() {
    let server = start(false);
    let mut client = connect(&server).await;
    send_text(&mut client, r#"{"type":"gesture","gesture":"wrist_extension"}"#).await;
    assert!(next_of_type(&mut client, "error").await["message"].as_str().unwrap().contains("only shows"));
    assert_eq!(server.drain_inputs(), []);
}

/// A client that reads nothing must not hold up the publisher or the others, and finds the latest frame and no
/// lost event when it reads on.
#[tokio::test]
async fn a_slow_client_loses_old_frames_but_no_event_and_disturbs_nobody() {
    let server = start(true);
    let mut slow = connect(&server).await;
    let mut quick = connect(&server).await;
    // Far more than the buffers of both sockets hold, with an event in one frame in the middle of it.
    const FRAMES: u64 = 20_000;
    const EVENT_AT: u64 = 15_000;
    let padding = "x".repeat(4_000);
    for tick in 1..=FRAMES {
        let mut frame = frame(tick);
        frame.emg_source.clone_from(&padding);
        if tick == EVENT_AT {
            frame.events = vec![Event { time: SimTime(tick), kind: EventKind::MotionStopped }];
        }
        server.publish(&frame);
        if tick % 2_000 == 0 {
            // The quick one keeps up: it sees this frame although the slow one reads nothing.
            while next_of_type(&mut quick, "frame").await["time"] != tick {}
        }
    }
    let (mut received, mut events) = (0_u64, 0);
    loop {
        let message = next(&mut slow).await;
        match message["type"].as_str().unwrap() {
            "frame" => {
                received += 1;
                events += message["events"].as_array().unwrap().len();
                if message["time"] == FRAMES {
                    break;
                }
            }
            "events" => events += message["events"].as_array().unwrap().len(),
            other => panic!("unexpected {other}"),
        }
    }
    assert_eq!(events, 1);
    assert!(
        received < FRAMES / 2,
        "the slow client got {received} of {FRAMES} frames: they were kept for it"
    );
}

#[tokio::test]
async fn new_content_is_announced_and_served() {
    let server = start(true);
    let mut client = connect(&server).await;
    let mut other = content(true);
    other.setup = "seated".into();
    server.set_content(other).unwrap();
    assert_eq!(next_of_type(&mut client, "content").await["revision"], 1);
    assert!(get(&server, "/api/content").await.contains(r#""setup":"seated""#));
}

#[tokio::test]
async fn another_sites_page_cannot_connect() {
    let server = start(true);
    let mut request = format!("ws://{}/live", authority(&server)).into_client_request().unwrap();
    request.headers_mut().insert("Origin", "http://evil.example".parse().unwrap());
    match connect_async(request).await {
        Err(tungstenite::Error::Http(response)) => assert_eq!(response.status(), 403),
        other => panic!("expected refusal, got {other:?}"),
    }
}

#[test]
fn a_taken_port_is_named_and_the_next_one_used_if_allowed() {
    let first = start(true);
    let port: u16 = authority(&first).rsplit(':').next().unwrap().parse().unwrap();
    let taken = PageOptions { port, ..options() };
    match PageServer::start(taken.clone(), content(true)) {
        Err(error @ BridgeError::Serve(ServeError::PortTaken { .. })) => {
            let text = error.to_string();
            assert!(text.contains(&format!("port {port}")) && text.contains("--port"), "{text}");
        }
        other => panic!("expected PortTaken, got {:?}", other.map(|server| server.url())),
    }
    let second = PageServer::start(PageOptions { allow_next_port: true, ..taken }, content(true)).unwrap();
    assert_ne!(first.url(), second.url());
}

#[test]
fn the_port_is_free_again_when_the_server_is_dropped() {
    let first = start(true);
    let url = first.url();
    let port: u16 = authority(&first).rsplit(':').next().unwrap().parse().unwrap();
    drop(first);
    let second = PageServer::start(PageOptions { port, ..options() }, content(true)).unwrap();
    assert_eq!(second.url(), url);
}

#[tokio::test]
async fn the_experimenter_pauses_what_a_spectator_only_watches() {
    let server = start(false);
    let (mut experimenter, mut spectator, mut participant) = (
        connect_as(&server, "experimenter").await,
        connect_as(&server, "spectator").await,
        connect(&server).await,
    );
    send_text(&mut spectator, r#"{"type":"study","action":"abort"}"#).await;
    assert!(
        next_of_type(&mut spectator, "error").await["message"].as_str().unwrap().contains("only watches")
    );
    send_text(&mut participant, r#"{"type":"study","action":"abort"}"#).await;
    let refused = next_of_type(&mut participant, "error").await["message"].as_str().unwrap().to_owned();
    assert!(refused.contains("role=experimenter"), "{refused}");
    send_text(&mut experimenter, r#"{"type":"study","action":"pause"}"#).await;
    assert_eq!(await_inputs(&server, 1).await, [ClientInput::Study(StudyAction::Pause)]);
    server.set_status(&TrialStatus { paused: true, ..TrialStatus::default() });
    server.publish_signals(&Signals {
        emg: vec![vec![1.5; 8]],
        emg_rate_hz: 200.0,
        emg_row_hz: 200.0,
        ..Signals::default()
    });
    for client in [&mut experimenter, &mut spectator] {
        assert_eq!(next_of_type(client, "status").await["paused"], true);
        assert_eq!(next_of_type(client, "signals").await["emg"][0][7], 1.5);
    }
    assert_eq!(next_of_type(&mut participant, "status").await["paused"], true);
    send_text(&mut participant, r#"{"type":"ping","id":5}"#).await;
    // The next message but the status: signals are not for the participant.
    let answer = next(&mut participant).await;
    assert_eq!((answer["type"].as_str(), answer["id"].as_u64()), (Some("pong"), Some(5)));
}

#[tokio::test]
async fn the_way_of_a_frame_to_the_screen_is_told_by_whoever_drives_on_the_servers_clock() {
    let server = start(true);
    let (mut page, mut second) = (connect(&server).await, connect(&server).await);
    for (client, name) in [(&mut page, "Ann"), (&mut second, "Ben")] {
        send_text(client, &format!(r#"{{"type":"join","name":"{name}"}}"#)).await;
        next_of_type(client, "driver").await;
    }
    send_text(&mut page, r#"{"type":"ping","id":1}"#).await;
    let before = next_of_type(&mut page, "pong").await["clock_ms"].as_f64().unwrap();
    server.publish(&frame(16));
    assert_eq!(next_of_type(&mut page, "frame").await["time"], 16);
    send_text(&mut page, r#"{"type":"ping","id":2}"#).await;
    let after = next_of_type(&mut page, "pong").await["clock_ms"].as_f64().unwrap();
    assert!(after >= before, "{before} {after}");
    let seen = |shown_ms: f64| {
        format!(r#"{{"type":"seen","frames":[{{"time":16,"came_ms":{after},"shown_ms":{shown_ms}}}]}}"#)
    };
    // Whoever only watches has another screen. The answer to a ping comes after what was said before it.
    send_text(&mut second, &seen(after + 70.0)).await;
    send_text(&mut second, r#"{"type":"ping","id":3}"#).await;
    next_of_type(&mut second, "pong").await;
    send_text(&mut page, &seen(after + 50.0)).await;
    send_text(&mut page, r#"{"type":"seen","frames":[{"time":16,"came_ms":"soon","shown_ms":1}]}"#).await;
    let refused = next_of_type(&mut page, "error").await["message"].to_string();
    assert!(refused.contains("expected f64"), "{refused}");
    let ages = server.take_frame_latencies();
    assert_eq!(ages.len(), 1, "{ages:?}");
    assert_eq!((ages[0].time, ages[0].render.as_millis()), (SimTime(16), 50));
    assert!(ages[0].network.as_secs_f64() * 1e3 <= after - before, "{ages:?}");
}

#[tokio::test]
async fn a_participants_page_gets_signals_as_long_as_it_asks_for_them() {
    let server = start(true);
    let mut page = connect(&server).await;
    let publish = |pages| server.publish_signals(&Signals { page_count: pages, ..Signals::default() });
    // The answer to a ping comes after whatever was said before it.
    send_text(&mut page, r#"{"type":"watch","signals":true}"#).await;
    send_text(&mut page, r#"{"type":"ping","id":1}"#).await;
    next_of_type(&mut page, "pong").await;
    publish(7);
    assert_eq!(next_of_type(&mut page, "signals").await["pages"], 7);
    send_text(&mut page, r#"{"type":"watch","signals":false}"#).await;
    send_text(&mut page, r#"{"type":"ping","id":2}"#).await;
    next_of_type(&mut page, "pong").await;
    publish(8);
    server.set_status(&TrialStatus::default());
    assert_eq!(next(&mut page).await["type"], "status");
}

#[tokio::test]
async fn why_a_choice_was_refused_stays_in_the_status_until_another_begins() {
    let server = start(true);
    let mut page = connect(&server).await;
    server.set_start_error(Some("This trial cannot begin.".into()));
    server.set_status(&TrialStatus::default());
    assert_eq!(next_of_type(&mut page, "status").await["refused"], "This trial cannot begin.");
    server.set_start_error(None);
    server.set_status(&TrialStatus::default());
    assert_eq!(next_of_type(&mut page, "status").await["refused"], Value::Null);
}

fn recorded(name: &str) -> RecordedTrial {
    RecordedTrial {
        name: name.into(),
        method: "D".into(),
        setup: "still".into(),
        seed: Some(u64::MAX),
        seconds: 2.0,
        score: 1,
        content: content(false),
        digest_matches: Some(true),
        finished: true,
        frames: vec![frame(16), frame(50)],
        emg: None,
    }
}

#[tokio::test]
async fn recorded_trials_are_listed_and_served_by_number() {
    let server = start(false);
    assert!(get(&server, "/api/trials").await.ends_with("[]"));
    server.set_trials(Arc::new(vec![recorded("D-still-seed1")])).unwrap();
    let list = get(&server, "/api/trials").await;
    assert!(
        list.contains(r#""name":"D-still-seed1""#) && list.contains(r#""seed":"18446744073709551615""#),
        "{list}"
    );
    let answer = get(&server, "/api/trials/0").await;
    let json: Value = serde_json::from_str(answer.split("\r\n\r\n").nth(1).unwrap()).unwrap();
    assert_eq!((&json["frames"][1]["time"], &json["seed"]), (&50.into(), &u64::MAX.to_string().into()));
    let missing = get(&server, "/api/trials/1").await;
    assert!(missing.starts_with("HTTP/1.1 404") && missing.contains("below 1"), "{missing}");
    assert!(get(&server, "/report").await.starts_with("HTTP/1.1 404"));
}

/// Makes a trial at each call, and counts the calls; the last one it cannot read.
struct Counted(AtomicUsize);

impl TrialLibrary for Counted {
    fn list(&self) -> Vec<TrialSummary> {
        let summary = |seed| TrialSummary {
            name: format!("seed {seed}"),
            method: "D".into(),
            setup: "still".into(),
            seed: Some(seed),
            seconds: 2.0,
            score: 1,
        };
        (0..4).map(summary).collect()
    }

    fn trial(&self, number: usize) -> Result<RecordedTrial, String> {
        if number == 3 {
            return Err("the log is cut".to_owned());
        }
        self.0.fetch_add(1, Ordering::Relaxed);
        Ok(recorded(&format!("seed {number}")))
    }

    fn report(&self) -> Option<String> {
        Some("<!doctype html><style>p { color: red }</style><p>a report</p>".to_owned())
    }
}

#[tokio::test]
async fn a_trial_is_made_when_it_is_asked_for_and_two_are_kept() {
    let (server, library) = (start(false), Arc::new(Counted(AtomicUsize::new(0))));
    server.set_trials(library.clone()).unwrap();
    let made = || library.0.load(Ordering::Relaxed);
    assert!(get(&server, "/api/trials").await.contains("seed 3"));
    assert_eq!(made(), 0);
    for (number, expected) in [(0, 1), (1, 2), (0, 2), (1, 2), (2, 3), (0, 4)] {
        let answer = get(&server, &format!("/api/trials/{number}")).await;
        assert!(answer.contains(&format!(r#""name":"seed {number}""#)), "{answer}");
        assert_eq!(made(), expected, "trial {number}");
    }
    let refused = get(&server, "/api/trials/3").await;
    assert!(refused.starts_with("HTTP/1.1 422") && refused.contains("the log is cut"), "{refused}");
    // The report's own style holds, and no script runs beside it.
    let report = get(&server, "/report").await;
    assert!(report.contains("a report") && report.contains("style-src 'unsafe-inline'"), "{report}");
    assert!(!report.contains("script-src"), "{report}");
    assert!(get(&server, "/replay").await.contains("script-src 'self'; style-src 'self'"));
}

/// Takes as long for a trial as it is told to, and counts how many it makes at once.
#[derive(Default)]
struct Slow {
    now: AtomicUsize,
    most: AtomicUsize,
    go: AtomicBool,
}

impl TrialLibrary for Slow {
    fn list(&self) -> Vec<TrialSummary> {
        Counted(AtomicUsize::new(0)).list()
    }

    fn trial(&self, number: usize) -> Result<RecordedTrial, String> {
        let now = self.now.fetch_add(1, Ordering::SeqCst) + 1;
        self.most.fetch_max(now, Ordering::SeqCst);
        while !self.go.load(Ordering::SeqCst) {
            std::thread::yield_now();
        }
        self.now.fetch_sub(1, Ordering::SeqCst);
        Ok(recorded(&format!("seed {number}")))
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn pages_that_ask_for_trials_and_go_away_do_not_have_many_made_at_once() {
    let (server, library) = (start(false), Arc::new(Slow::default()));
    server.set_trials(library.clone()).unwrap();
    let authority = authority(&server);
    for number in 0..3 {
        let mut stream = TcpStream::connect(&authority).await.unwrap();
        let request = format!("GET /api/trials/{number} HTTP/1.1\r\nHost: {authority}\r\n\r\n");
        stream.write_all(request.as_bytes()).await.unwrap();
        while library.now.load(Ordering::SeqCst) == 0 {
            tokio::task::yield_now().await;
        }
        drop(stream);
        // Longer than a server takes to see that nobody waits any more.
        tokio::time::sleep(Duration::from_millis(100)).await;
    }
    library.go.store(true, Ordering::SeqCst);
    assert!(get(&server, "/api/trials/1").await.contains("seed 1"));
    assert_eq!(library.most.load(Ordering::SeqCst), 1);
}

#[test]
fn content_that_does_not_fit_together_is_refused() {
    let mut page = content(true);
    page.arm.links.pop();
    match PageServer::start(options(), page) {
        Err(BridgeError::Content { what }) => assert!(what.contains("1 links and 1 joints"), "{what}"),
        other => panic!("expected Content, got {:?}", other.map(|server| server.url())),
    }
}

#[tokio::test]
async fn one_page_drives_and_the_others_watch_until_one_takes_over() {
    let server = start(true);
    let (mut first, mut second) = (connect(&server).await, connect(&server).await);
    send_text(&mut first, r#"{"type":"join","name":"Ann"}"#).await;
    let message = next_of_type(&mut first, "driver").await;
    assert_eq!((message["name"].as_str(), message["you"].as_bool()), (Some("Ann"), Some(true)));
    send_text(&mut second, r#"{"type":"join","name":"Bo"}"#).await;
    let message = next_of_type(&mut second, "driver").await;
    assert_eq!(
        (message["name"].as_str(), message["you"].as_bool(), message["may_drive"].as_bool()),
        (Some("Ann"), Some(false), Some(true))
    );
    // A gesture and a restart of who watches are refused with the driver's name; a relaxed hand is not.
    send_text(&mut second, r#"{"type":"gesture","gesture":"wrist_extension"}"#).await;
    assert!(next_of_type(&mut second, "error").await["message"].as_str().unwrap().contains("Ann drives"));
    send_text(&mut second, r#"{"type":"restart"}"#).await;
    assert!(next_of_type(&mut second, "error").await["message"].as_str().unwrap().contains("Ann drives"));
    send_text(&mut first, r#"{"type":"gesture","gesture":"hand_close"}"#).await;
    assert_eq!(await_inputs(&server, 1).await, [ClientInput::Gesture(Command::HandClose)]);
    send_text(&mut second, r#"{"type":"take_over"}"#).await;
    for (client, you) in [(&mut first, false), (&mut second, true)] {
        let message = next_of_type(client, "driver").await;
        assert_eq!((message["name"].as_str(), message["you"].as_bool()), (Some("Bo"), Some(you)));
    }
    send_text(&mut second, r#"{"type":"gesture","gesture":"hand_open"}"#).await;
    // What the first one held was released when the second took over.
    let expected = [ClientInput::Gesture(Command::NoMotion), ClientInput::Gesture(Command::HandOpen)];
    assert_eq!(await_inputs(&server, 2).await, expected);
    drop(second);
    assert_eq!(next_of_type(&mut first, "driver").await["name"], serde_json::Value::Null);
}

#[tokio::test]
async fn who_only_watches_cannot_take_over() {
    let server = start(true);
    for role in ["spectator", "experimenter"] {
        let mut client = connect_as(&server, role).await;
        send_text(&mut client, r#"{"type":"join","name":"Cy"}"#).await;
        send_text(&mut client, r#"{"type":"take_over"}"#).await;
        let refused = next_of_type(&mut client, "error").await["message"].as_str().unwrap().to_owned();
        assert!(refused.contains("does not drive"), "{refused}");
    }
    let watched = start(false);
    let mut shown = connect(&watched).await;
    send_text(&mut shown, r#"{"type":"take_over"}"#).await;
    assert!(next_of_type(&mut shown, "error").await["message"].as_str().unwrap().contains("only shows"));
}
