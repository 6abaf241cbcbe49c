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
pub const LIMIT: Duration = Duration::from_secs(20);

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
        most: Some(4),
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
        gesture: Gesture::NoMotion,
        recognised: Gesture::NoMotion.into(),
        confidence: 1.0,
        effort: 0.5,
        emg_source: "keys".into(),
        time_left_secs: 300.0,
        goal: None,
        next: Some(ObjectId(0)),
        asked: None,
        score: 0,
        finished: false,
        events: vec![],
        contacts: Vec::new(),
        feedback: Vec::new(),
    }
}

pub fn options() -> PageOptions {
    PageOptions { port: 0, allow_next: false, ..PageOptions::default() }
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

/// The next text message. Pings are answered by the library.
pub async fn next(client: &mut Client) -> Value {
    loop {
        let message =
            tokio::time::timeout(LIMIT, client.next()).await.expect("no answer in time").unwrap().unwrap();
        if !message.is_ping() {
            return serde_json::from_str(message.to_text().unwrap()).unwrap();
        }
    }
}

/// The next message of this type; others are skipped.
pub async fn next_of(client: &mut Client, kind: &str) -> Value {
    loop {
        let message = next(client).await;
        if message["type"] == kind {
            return message;
        }
    }
}

pub async fn say(client: &mut Client, text: &str) {
    client.send(Message::text(text)).await.unwrap();
}

/// Waits until the server has handed out `count` inputs.
pub async fn inputs(server: &PageServer, count: usize) -> Vec<ClientInput> {
    let (mut got, start) = (Vec::new(), Instant::now());
    while got.len() < count {
        assert!(start.elapsed() < LIMIT, "{count} inputs expected, got {got:?}");
        got.extend(server.drain_inputs());
        tokio::task::yield_now().await;
    }
    got
}
