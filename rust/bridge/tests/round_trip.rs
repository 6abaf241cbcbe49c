//! Lines with a delay, and crowds of pages: who drives is measured, and is never locked out.

#![allow(clippy::unwrap_used, clippy::disallowed_methods)]

mod common;

use common::*;
use proact_bridge::{ClientInput, PageHeartbeat, PageServer, StudyAction, TrialStatus};
use proact_types::Command;
use std::time::{Duration, Instant};

const LONG: Option<Duration> = Some(Duration::from_secs(3600));

/// What is heard of the driver with this limit, until it is `wanted`; `client` reads meanwhile, which answers pings.
async fn await_heartbeat(
    server: &PageServer,
    client: &mut Client,
    limit: Option<Duration>,
    wanted: PageHeartbeat,
) {
    let start = Instant::now();
    while server.take_heartbeat(limit) != Some(wanted) {
        assert!(start.elapsed() < TIMEOUT, "the page was not heard to be {wanted:?}");
        let frame = frame(start.elapsed().as_millis() as u64 + 1);
        server.publish(&frame);
        next_of_type(client, "frame").await;
    }
}

/// A line with a constant delay of a second moved the arm as if it had none. Here every line has one: more than no time at all.
#[tokio::test]
async fn a_driver_whose_round_trip_is_over_the_limit_is_heard_as_delayed_and_warned() {
    let server = start(true);
    let mut page = connect(&server).await;
    send_text(&mut page, r#"{"type":"gesture","gesture":"wrist_extension"}"#).await;
    assert_eq!(await_inputs(&server, 1).await, [ClientInput::Gesture(Command::WristExtension)]);
    await_heartbeat(&server, &mut page, LONG, PageHeartbeat::Alive).await;
    await_heartbeat(&server, &mut page, Some(Duration::ZERO), PageHeartbeat::Delayed).await;
    let warning = next_of_type(&mut page, "delay").await;
    assert!(warning["ms"].as_f64().unwrap() > 0.0, "{warning}");
    await_heartbeat(&server, &mut page, LONG, PageHeartbeat::Alive).await;
    while !next_of_type(&mut page, "delay").await["ms"].is_null() {}
}

/// 64 connections that watched locked out driver and experimenter.
#[tokio::test]
async fn a_crowd_locks_out_neither_driver_nor_experimenter() {
    let server = start(true);
    let mut driver = connect(&server).await;
    send_text(&mut driver, r#"{"type":"join","name":"Ann"}"#).await;
    while next_of_type(&mut driver, "driver").await["you"] != true {}
    let mut clients = Vec::new();
    for role in ["spectator", "participant", "experimenter"] {
        for _ in 0..70 {
            let url = format!("ws://{}/live?role={role}", authority(&server));
            match tokio_tungstenite::connect_async(url).await {
                Ok((client, _)) => clients.push(client),
                Err(error) => {
                    assert!(role == "spectator" && error.to_string().contains("503"), "{role}: {error}")
                }
            }
        }
    }
    assert_eq!(clients.len(), 64 + 70 + 70);
    // Who drives was not moved, and newcomers come in and are served.
    send_text(&mut driver, r#"{"type":"gesture","gesture":"hand_close"}"#).await;
    assert_eq!(await_inputs(&server, 1).await, [ClientInput::Gesture(Command::HandClose)]);
    server.set_status(&TrialStatus::default());
    for role in ["participant", "experimenter"] {
        let mut newcomer = connect_as(&server, role).await;
        next_of_type(&mut newcomer, "status").await;
        send_text(&mut newcomer, r#"{"type":"ping","id":5}"#).await;
        assert_eq!(next_of_type(&mut newcomer, "pong").await["id"], 5);
    }
}

/// 41 pages that claimed to be the experimenter took the place of one who was there: the oldest had to go.
#[tokio::test]
async fn a_crowd_that_claims_to_be_the_experimenter_moves_none_that_answers_pings() {
    let server = start(true);
    let mut experimenter = connect_as(&server, "experimenter").await;
    await_ping(&mut experimenter).await;
    // Its answer goes out with what is said next, and is read before it.
    send_text(&mut experimenter, r#"{"type":"ping","id":1}"#).await;
    next_of_type(&mut experimenter, "pong").await;
    let mut clients = Vec::new();
    for id in 0..41 {
        let url = format!("ws://{}/live?role=experimenter", authority(&server));
        match tokio_tungstenite::connect_async(url).await {
            Ok((mut client, _)) => {
                send_text(&mut client, &format!(r#"{{"type":"ping","id":{id}}}"#)).await;
                next_of_type(&mut client, "pong").await;
                clients.push(client);
            }
            Err(error) => assert!(error.to_string().contains("503"), "{error}"),
        }
    }
    assert!(clients.len() >= 15, "{} of the crowd came in", clients.len());
    send_text(&mut experimenter, r#"{"type":"study","action":"pause"}"#).await;
    assert_eq!(await_inputs(&server, 1).await, [ClientInput::Study(StudyAction::Pause)]);
}

/// The page showed a seed that ended in 314000 for one that ends in 314127.
#[tokio::test]
async fn a_seed_goes_to_the_page_as_text() {
    let server = start(true);
    let mut page = connect(&server).await;
    let seed = 9_007_199_254_740_993;
    server.set_status(&TrialStatus { seed, ..TrialStatus::default() });
    assert_eq!(next_of_type(&mut page, "status").await["seed"], seed.to_string());
}
