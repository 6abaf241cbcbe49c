//! Lines with a delay, and crowds of pages: who drives is measured, and is never locked out.

#![allow(clippy::unwrap_used, clippy::disallowed_methods)]

mod common;

use common::*;
use proact_bridge::{ClientInput, Heard, PageServer, TrialStatus};
use proact_types::Gesture;
use std::time::{Duration, Instant};

const LONG: Option<Duration> = Some(Duration::from_secs(3600));

/// What is heard of the driver with this limit, until it is `wanted`; `client` reads meanwhile, which answers pings.
async fn hear(server: &PageServer, client: &mut Client, limit: Option<Duration>, wanted: Heard) {
    let start = Instant::now();
    while server.take_heard(limit) != Some(wanted) {
        assert!(start.elapsed() < LIMIT, "the page was not heard to be {wanted:?}");
        let frame = frame(start.elapsed().as_millis() as u64 + 1);
        server.publish(&frame);
        next_of(client, "frame").await;
    }
}

/// A line with a constant delay of a second moved the arm as if it had none. Here every line has one: more than no time at all.
#[tokio::test]
async fn a_driver_whose_round_trip_is_over_the_limit_is_heard_as_delayed_and_warned() {
    let server = start(true);
    let mut page = connect(&server).await;
    say(&mut page, r#"{"type":"gesture","gesture":"wrist_extension"}"#).await;
    assert_eq!(inputs(&server, 1).await, [ClientInput::Gesture(Gesture::WristExtension)]);
    hear(&server, &mut page, LONG, Heard::Alive).await;
    hear(&server, &mut page, Some(Duration::ZERO), Heard::Delayed).await;
    let warning = next_of(&mut page, "delay").await;
    assert!(warning["ms"].as_f64().unwrap() > 0.0, "{warning}");
    hear(&server, &mut page, LONG, Heard::Alive).await;
    while !next_of(&mut page, "delay").await["ms"].is_null() {}
}

/// 64 connections that watched locked out driver and experimenter.
#[tokio::test]
async fn a_crowd_locks_out_neither_driver_nor_experimenter() {
    let server = start(true);
    let mut driver = connect(&server).await;
    say(&mut driver, r#"{"type":"join","name":"Ann"}"#).await;
    while next_of(&mut driver, "driver").await["you"] != true {}
    let mut crowd = Vec::new();
    for role in ["spectator", "participant", "experimenter"] {
        for _ in 0..70 {
            let url = format!("ws://{}/live?role={role}", authority(&server));
            match tokio_tungstenite::connect_async(url).await {
                Ok((client, _)) => crowd.push(client),
                Err(error) => {
                    assert!(role == "spectator" && error.to_string().contains("503"), "{role}: {error}")
                }
            }
        }
    }
    assert_eq!(crowd.len(), 64 + 70 + 70);
    // Who drives was not moved, and newcomers come in and are served.
    say(&mut driver, r#"{"type":"gesture","gesture":"hand_close"}"#).await;
    assert_eq!(inputs(&server, 1).await, [ClientInput::Gesture(Gesture::HandClose)]);
    server.set_status(&TrialStatus::default());
    for role in ["participant", "experimenter"] {
        let mut newcomer = connect_as(&server, role).await;
        next_of(&mut newcomer, "status").await;
        say(&mut newcomer, r#"{"type":"ping","id":5}"#).await;
        assert_eq!(next_of(&mut newcomer, "pong").await["id"], 5);
    }
}

/// The page showed a seed that ended in 314000 for one that ends in 314127.
#[tokio::test]
async fn a_seed_goes_to_the_page_as_text() {
    let server = start(true);
    let mut page = connect(&server).await;
    let seed = 9_007_199_254_740_993;
    server.set_status(&TrialStatus { seed, ..TrialStatus::default() });
    assert_eq!(next_of(&mut page, "status").await["seed"], seed.to_string());
}
