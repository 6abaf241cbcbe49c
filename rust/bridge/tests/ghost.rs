//! The second arm that is only shown: every page has it, early or late, until it is gone or another trial begins.
#![allow(clippy::unwrap_used, clippy::disallowed_methods)]

mod common;

use common::{connect, connect_as, content, next_of_type, options};
use proact_bridge::{GhostArm, PageServer};
use serde_json::{Value, json};

#[tokio::test]
async fn every_page_has_the_ghost_until_it_is_gone_or_another_trial_begins() {
    let server = PageServer::start(options(), content(true)).unwrap();
    let mut early = connect(&server).await;
    let arm = GhostArm { joints: vec![0.0, 1.5], color: [0.25, 0.5, 0.75], alpha: 0.5 };
    server.publish_ghost(Some(&arm));
    // A whole number is written without its point.
    let expected = json!({ "joints": [0, 1.5], "colour": [0.25, 0.5, 0.75], "alpha": 0.5 });
    let mut late = connect_as(&server, "spectator").await;
    for client in [&mut early, &mut late] {
        assert_eq!(next_of_type(client, "ghost").await["arm"], expected);
    }
    // The same again is no news: the next that comes is its end.
    server.publish_ghost(Some(&arm));
    server.publish_ghost(None);
    for client in [&mut early, &mut late] {
        assert_eq!(next_of_type(client, "ghost").await["arm"], Value::Null);
    }
    server.publish_ghost(Some(&arm));
    assert_eq!(next_of_type(&mut early, "ghost").await["arm"], expected);
    server.set_content(content(true)).unwrap();
    next_of_type(&mut early, "content").await;
    // In another trial it is news again.
    server.publish_ghost(Some(&arm));
    assert_eq!(next_of_type(&mut early, "ghost").await["arm"], expected);
}
