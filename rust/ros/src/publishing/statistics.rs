//! Messages that slow subscribers lose: `rosgraph_msgs/TopicStatistics` on `/statistics`, and one line in the log for each
//! connection.
//!
//! In ROS 1 subscribers measure these statistics, on request. Here the publisher does, who knows what it dropped: once a second,
//! for each connection that lost messages since the last report. Without a subscriber of `/statistics` the counts go on.

use super::{
    Publisher,
    connection::{DeliveryStats, SubscriberConnection},
    topic_server::TopicServer,
};
use crate::messages::rosgraph_msgs::TopicStatistics;
use std::{
    collections::HashMap,
    sync::{Arc, Weak},
    time::Duration,
};

/// From one report to the next.
const PERIOD: Duration = Duration::from_secs(1);
const TOPIC: &str = "/statistics";
/// Reports that wait for a subscriber: one for each slow connection.
const QUEUE: usize = 100;

/// A connection that is watched.
struct WatchedConnection {
    connection: Weak<SubscriberConnection>,
    /// When its counts began anew.
    since: rosrust::Time,
    logged: bool,
}

/// Reports until the process ends. `node` is this node's name.
pub(super) fn run_statistics(hub: &Arc<TopicServer>, node: &str) -> ! {
    let mut watched: HashMap<usize, WatchedConnection> = HashMap::new();
    let mut statistics: Option<Publisher<TopicStatistics>> = None;
    loop {
        std::thread::sleep(PERIOD);
        let now = rosrust::now();
        watched.retain(|_, known| known.connection.strong_count() > 0);
        for (topic, topic_publisher) in hub.topics() {
            for connection in topic_publisher.connections() {
                let known = watched.entry(Arc::as_ptr(&connection) as usize).or_insert_with(|| {
                    WatchedConnection { connection: Arc::downgrade(&connection), since: now, logged: false }
                });
                let subscriber = connection.subscriber();
                let has_subscribers = statistics.as_ref().is_some_and(|topic| topic.subscriber_count() > 0);
                let mut lost = 0;
                let counted = connection.take_stats(|counted| {
                    lost = counted.dropped;
                    lost == 0 || has_subscribers
                });
                if lost > 0 && !known.logged {
                    known.logged = true;
                    hub.log(&format!(
                        "{subscriber} takes {topic} too slowly: {lost} messages dropped for it; {TOPIC} counts on"
                    ));
                    // Registered now: most nodes never need it.
                    statistics = statistics.or_else(|| Publisher::new(TOPIC, QUEUE, false).ok());
                }
                let Some(counted) = counted else { continue };
                if let Some(statistics) = statistics.as_ref().filter(|_| counted.dropped > 0) {
                    let report = message(&topic, node, subscriber, (known.since, now), counted);
                    // It is a message of plain numbers, which can be encoded.
                    let _ = statistics.send(report);
                }
                known.since = now;
            }
        }
    }
}

/// Periods and ages stay zero: the publisher does not see when messages arrive.
fn message(
    topic: &str,
    node: &str,
    subscriber: &str,
    (window_start, window_stop): (rosrust::Time, rosrust::Time),
    counted: DeliveryStats,
) -> TopicStatistics {
    let count = |number: u64| i32::try_from(number).unwrap_or(i32::MAX);
    TopicStatistics {
        topic: topic.to_owned(),
        node_pub: node.to_owned(),
        node_sub: subscriber.to_owned(),
        window_start,
        window_stop,
        delivered_msgs: count(counted.delivered),
        dropped_msgs: count(counted.dropped),
        traffic: count(counted.bytes),
        ..TopicStatistics::default()
    }
}
