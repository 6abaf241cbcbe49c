//! A page's server on a port of the system's choice, and a browser's side of its WebSocket.
#![allow(dead_code)]

use futures_util::{SinkExt, StreamExt};
use nalgebra::Isometry3;
use proact_arm::*;
use proact_bridge::{ClientInput, PageContent, PageOptions, PageServer};
use proact_types::*;
use serde_json::Value;
use std::time::{Duration, Instant};
use tokio::net::TcpStream;
use tokio_tungstenite::{MaybeTlsStream, WebSocketStream, connect_async, tungstenite::Message};

/// Only a hanging server takes so long.
pub const TIMEOUT: Duration = Duration::from_secs(20);

pub type Client = WebSocketStream<MaybeTlsStream<TcpStream>>;

pub fn content(interactive: bool) -> PageContent {
    let link = |name: &str| Link { name: name.into(), inertial: None, collisions: vec![], visuals: vec![] };
    let arm = ArmModel {
        name: "two_links".into(),
        links: vec![link("base"), link("tip")],
        joints: vec![Joint {
            name: "elbow".into(),
            kind: JointKind::Revolute,
            parent: 0,
            child: 1,
            origin: Pose::identity(),
            axis: Vector::z(),
            limits: JointLimits::default(),
            damping: 0.0,
            friction: 0.0,
        }],
        arm: vec![0],
        hand: vec![],
        tip: 1,
        poses: vec![],
        allowed_collisions: vec![],
        ..Default::default()
    };
    let scene = Scene { table_height: 1.015, ..Scene::default() };
    let briefing = Briefing {
        title: "Modified box and blocks".into(),
        text: "Carry each block to its target.".into(),
        order: Order::Prescribed,
        destination: Destination::OwnTarget,
        score_name: "blocks on target".into(),
        max_score: Some(4),
        practice_secs: 0.0,
        limit_secs: 300.0,
    };
    PageContent {
        title: "test".into(),
        setup: "still".into(),
        arm,
        meshes: vec![],
        scene,
        briefing,
        interactive,
        lean: false,
        method: Default::default(),
        methods: vec![],
    }
}

pub fn frame(tick: u64) -> DisplayFrame {
    DisplayFrame {
        time: SimTime(tick),
        method: "D".into(),
        joints: joints(&[0.5]),
        world_from_base: Isometry3::identity(),
        world_from_tip: Isometry3::identity(),
        world_from_head: Isometry3::identity(),
        objects: vec![],
        hand: HandView::default(),
        gaze: None,
        target: TargetView::default(),
        planner: PlannerView::Idle,
        mode: None,
        stop: None,
        command: Command::NoMotion,
        recognized_gesture: Command::NoMotion.into(),
        confidence: 1.0,
        effort: 0.5,
        emg_source: "keys".into(),
        time_left_secs: 300.0,
        plan_goal: None,
        next_object: Some(ObjectId(0)),
        task_goal: None,
        score: 0,
        finished: false,
        events: vec![],
        contacts: Vec::new(),
        feedback: Vec::new(),
    }
}

pub fn options() -> PageOptions {
    PageOptions { port: 0, allow_next_port: false, ..PageOptions::default() }
}

pub fn start(interactive: bool) -> PageServer {
    PageServer::start(options(), content(interactive)).unwrap()
}

pub fn authority(server: &PageServer) -> String {
    server.url().trim_start_matches("http://").trim_end_matches('/').to_owned()
}

pub async fn connect(server: &PageServer) -> Client {
    let (mut client, _) = connect_async(format!("ws://{}/live", authority(server))).await.unwrap();
    let hello = next(&mut client).await;
    assert_eq!(hello["type"], "hello");
    client
}

pub async fn connect_as(server: &PageServer, role: &str) -> Client {
    let url = format!("ws://{}/live?role={role}", authority(server));
    let (mut client, _) = connect_async(url).await.unwrap();
    assert_eq!(next(&mut client).await["type"], "hello");
    client
}

/// The next text message, in time whatever else comes. Pings are answered by the library.
pub async fn next(client: &mut Client) -> Value {
    let read = async {
        loop {
            let message = client.next().await.unwrap().unwrap();
            if !message.is_ping() {
                return serde_json::from_str(message.to_text().unwrap()).unwrap();
            }
        }
    };
    tokio::time::timeout(TIMEOUT, read).await.expect("no answer in time")
}

/// Reads until the server pings; the library answers with what is said next.
pub async fn await_ping(client: &mut Client) {
    let read = async { while !client.next().await.unwrap().unwrap().is_ping() {} };
    tokio::time::timeout(TIMEOUT, read).await.expect("no ping in time");
}

/// The next message of this type; others are skipped.
pub async fn next_of_type(client: &mut Client, kind: &str) -> Value {
    let read = async {
        loop {
            let message = next(client).await;
            if message["type"] == kind {
                return message;
            }
        }
    };
    tokio::time::timeout(TIMEOUT, read).await.expect("no message of this type in time")
}

pub async fn send_text(client: &mut Client, text: &str) {
    client.send(Message::text(text)).await.unwrap();
}

/// Waits until the server has handed out `count` inputs.
pub async fn await_inputs(server: &PageServer, count: usize) -> Vec<ClientInput> {
    let (mut got, start) = (Vec::new(), Instant::now());
    while got.len() < count {
        assert!(start.elapsed() < TIMEOUT, "{count} inputs expected, got {got:?}");
        got.extend(server.drain_inputs());
        tokio::task::yield_now().await;
    }
    got
}
