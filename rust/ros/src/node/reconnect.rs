//! Connects subscriptions again whose publisher closed the connection, or did not take it at first.
//!
//! rosrust asks a publisher once, and takes it for connected until the master says that it has gone. A publisher that closed the
//! connection meanwhile, because this node was stopped or off the network, or that could not answer when it was asked, would
//! never be heard. So the publishers are asked now and then whom they send to.

use super::{
    master::{self, MasterAddresses},
    rosout, type_mismatch,
};
use std::{
    collections::{BTreeMap, BTreeSet},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    time::{Duration, Instant},
};

/// From one look to the next.
const PERIOD: Duration = Duration::from_secs(1);
/// Looks in a row at which a connection must be missing before it is made again: one may fall between two connections.
const MISSING_CHECKS: u32 = 2;
/// How often the end of the node is looked at.
const POLL_PERIOD: Duration = Duration::from_millis(100);

/// Looks in a row at which a publisher has never listed this node: then its message type is compared, and if that is right the
/// connection is made again; and once more after twice as many looks, and so on.
const NEVER_LISTED: u32 = 3;

/// Topic and address of a publisher, to a number of looks.
type Looks = BTreeMap<(String, String), u32>;

#[derive(Default)]
struct Connections {
    /// Connections that the publisher listed once; the looks at which they were missing since.
    listed: Looks,
    /// Connections that the publisher has never listed.
    never_listed: Looks,
}

/// Starts to look, until `ended`. The thread is not waited for: a publisher that is stopped keeps a call waiting.
pub(super) fn start(addresses: MasterAddresses, ended: Arc<AtomicBool>) {
    // Without a thread, rosrust's behaviour stays.
    let _ = std::thread::Builder::new().name("reconnect".to_owned()).spawn(move || {
        let mut connections = Connections::default();
        while wait(&ended) {
            // A master or a publisher that does not answer is asked again.
            let _ = check_connections(&addresses, &mut connections);
        }
    });
}

fn wait(ended: &AtomicBool) -> bool {
    let wake = Instant::now() + PERIOD;
    while Instant::now() < wake {
        if ended.load(Ordering::Relaxed) || !rosrust::is_ok() {
            return false;
        }
        std::thread::sleep(POLL_PERIOD);
    }
    true
}

fn check_connections(addresses: &MasterAddresses, connections: &mut Connections) -> Result<(), String> {
    let subscribed = master::subscriptions(addresses)?;
    let state = rosrust::state().map_err(|error| error.to_string())?;
    // Address of a publisher, to its name and topics.
    let mut publishers: BTreeMap<String, (String, BTreeSet<String>)> = BTreeMap::new();
    for topic in state.publishers.into_iter().filter(|topic| subscribed.contains_key(&topic.name)) {
        for node in topic.connections.into_iter().filter(|node| *node != addresses.name) {
            if let Ok(uri) = master::node_address(addresses, &node) {
                publishers.entry(uri).or_insert((node, BTreeSet::new())).1.insert(topic.name.clone());
            }
        }
    }
    let Connections { listed, never_listed } = connections;
    let is_published =
        |topic: &str, uri: &str| publishers.get(uri).is_some_and(|(_, all)| all.contains(topic));
    listed.retain(|(topic, uri), _| is_published(topic, uri));
    never_listed.retain(|(topic, uri), _| is_published(topic, uri));
    for (uri, (node, topics)) in &publishers {
        let Ok(sent) = master::topics_received_from(addresses, uri) else { continue };
        for topic in topics {
            let key = (topic.clone(), uri.clone());
            if sent.contains(topic) {
                never_listed.remove(&key);
                listed.insert(key, 0);
            } else if let Some(missing) = listed.get_mut(&key) {
                *missing += 1;
                if !missing.is_multiple_of(MISSING_CHECKS) {
                    continue;
                }
                if *missing == MISSING_CHECKS {
                    rosout::warn(&format!("{topic}: connecting again to {uri}, which closed the connection"));
                }
                connect_again(addresses, topic, uri, &publishers)?;
            } else {
                let missing_count = never_listed.entry(key).or_insert(0);
                *missing_count = missing_count.saturating_add(1);
                let is_due = missing_count.is_multiple_of(NEVER_LISTED)
                    && (*missing_count / NEVER_LISTED).is_power_of_two();
                if !is_due {
                    continue;
                }
                let is_first = *missing_count == NEVER_LISTED;
                match type_mismatch::describe_mismatch(addresses, uri, node, topic, &subscribed[topic]) {
                    Ok(Some(line)) if is_first => rosout::warn(&line),
                    Ok(None) => {
                        if is_first {
                            let line =
                                format!("{topic}: connecting again to {uri}, which lists no connection");
                            rosout::warn(&line);
                        }
                        connect_again(addresses, topic, uri, &publishers)?;
                    }
                    _ => {}
                }
            }
        }
    }
    Ok(())
}

/// Has rosrust connect to the publisher at `uri` of a topic: it connects to one that is new to it.
fn connect_again(
    addresses: &MasterAddresses,
    topic: &str,
    uri: &str,
    publishers: &BTreeMap<String, (String, BTreeSet<String>)>,
) -> Result<(), String> {
    let all: Vec<&str> =
        publishers.iter().filter(|(_, (_, topics))| topics.contains(topic)).map(|(uri, _)| &**uri).collect();
    let others: Vec<&str> = all.iter().copied().filter(|other| *other != uri).collect();
    master::send_publisher_update(addresses, topic, &others)?;
    master::send_publisher_update(addresses, topic, &all)
}
