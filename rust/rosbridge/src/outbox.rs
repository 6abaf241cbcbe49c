//! What waits to be sent to one client: bounded, and the oldest goes first when it is too much.

use crate::bus::{TopicMessage, TopicSink};
use axum::extract::ws::Utf8Bytes;
use proact_messages::RosVersion;
use std::{
    collections::{HashMap, VecDeque},
    sync::{Arc, Mutex, MutexGuard, PoisonError},
    time::{Duration, Instant},
};
use tokio::sync::Notify;

/// Most bytes that wait for one client, counted as text. Beyond it the oldest messages are dropped. Room for the longest
/// message, which may be longer as it is written here than as it came.
pub(crate) const MAX_WAITING_BYTES: usize = 16 * 1024 * 1024;
/// Most answers and status messages that wait for one client: it asks and does not read.
const MAX_REPLIES: usize = 20_000;
/// Handed to the writer at a time: more would only wait there instead of here, where it can still be dropped.
const BATCH_BYTES: usize = 64 * 1024;

/// How a client wants the messages of a topic.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct DeliveryOptions {
    /// Least time from one message to the next.
    pub(crate) throttle: Duration,
    /// Most messages that wait; zero for as many as memory allows.
    pub(crate) queue_length: usize,
    /// Longest piece, bytes; none for whole messages.
    pub(crate) fragment_size: Option<usize>,
    /// How it is written.
    pub(crate) compression: Compression,
    /// Whether names and fields are those of ROS 1 or of ROS 2.
    pub(crate) ros_version: RosVersion,
}

/// How a message is written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Compression {
    /// JSON text.
    #[default]
    None,
    /// JSON text in a picture.
    Png,
    /// A binary frame.
    Cbor,
    /// A binary frame with the bytes that ROS sends, and when they came.
    CborRaw,
}

/// Something to send.
pub(crate) enum Outgoing {
    /// A message of a topic.
    Message(Arc<TopicMessage>, DeliveryOptions),
    /// An answer or a status, ready to go.
    Reply(QueuedReply),
}

/// An answer or a status.
pub(crate) struct QueuedReply {
    pub(crate) text: Utf8Bytes,
    pub(crate) fragment_size: Option<usize>,
    pub(crate) compression: Compression,
}

/// The queue of one client.
#[derive(Default)]
pub(crate) struct Outbox {
    queues: Mutex<Queues>,
    wake: Notify,
}

#[derive(Default)]
struct Queues {
    topics: HashMap<Arc<str>, TopicQueue>,
    /// What goes out next. A topic stands here as often as it has messages that are ready.
    order: VecDeque<QueueEntry>,
    /// Topics with messages that wait for their throttle.
    throttled: Vec<Arc<str>>,
    bytes: usize,
    replies: usize,
    dropped: u64,
    closed: bool,
}

enum QueueEntry {
    Topic(Arc<str>),
    Reply(QueuedReply),
}

struct TopicQueue {
    name: Arc<str>,
    /// What the client calls the topic, if it leaves the first slash out: it wants that name back.
    alias: Option<Arc<str>>,
    delivery: DeliveryOptions,
    /// The first `ready` may be sent, the others wait for their throttle.
    queued: VecDeque<QueuedMessage>,
    ready: usize,
    next_due: Option<Instant>,
}

/// A message with its length as text when it came: the client may ask for another form since.
struct QueuedMessage {
    message: Arc<TopicMessage>,
    bytes: usize,
}

impl Outbox {
    fn lock(&self) -> MutexGuard<'_, Queues> {
        // No code that holds the lock can panic half way through a change.
        self.queues.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Begins or changes the delivery of a topic.
    pub(crate) fn set_delivery(&self, topic: &str, delivery: DeliveryOptions) {
        let mut queues = self.lock();
        match queues.topics.get_mut(topic) {
            Some(queue) => queue.delivery = delivery,
            None => {
                let name: Arc<str> = topic.into();
                let waiting = VecDeque::new();
                let queue = TopicQueue {
                    name: Arc::clone(&name),
                    alias: None,
                    delivery,
                    queued: waiting,
                    ready: 0,
                    next_due: None,
                };
                queues.topics.insert(name, queue);
            }
        }
    }

    /// Has the messages of a topic go out under another name.
    pub(crate) fn set_alias(&self, topic: &str, alias: Option<&String>) {
        if let Some(queue) = self.lock().topics.get_mut(topic) {
            queue.alias = alias.map(|alias| alias.as_str().into());
        }
    }

    /// Ends the delivery of a topic; what waits is dropped.
    pub(crate) fn remove(&self, topic: &str) {
        let mut queues = self.lock();
        if let Some(queue) = queues.topics.remove(topic) {
            queues.bytes -= queue.queued.iter().map(|waiting| waiting.bytes).sum::<usize>();
            queues.order.retain(|slot| !matches!(slot, QueueEntry::Topic(name) if &**name == topic));
            queues.throttled.retain(|name| &**name != topic);
        }
    }

    /// Puts an answer or a status behind what waits.
    pub(crate) fn reply(&self, reply: QueuedReply) {
        let mut queues = self.lock();
        queues.bytes += reply.text.len();
        queues.replies += 1;
        queues.order.push_back(QueueEntry::Reply(reply));
        queues.drop_oldest();
        if queues.replies > MAX_REPLIES || queues.bytes > MAX_WAITING_BYTES {
            queues.closed = true;
        }
        drop(queues);
        self.wake.notify_one();
    }

    /// Messages that this client did not get because it read too slowly.
    pub(crate) fn dropped(&self) -> u64 {
        self.lock().dropped
    }

    /// What may be sent now, about a batch; none once the client has more answers waiting than it is allowed.
    pub(crate) fn take_batch(&self, now: Instant) -> Option<Vec<Outgoing>> {
        let mut queues = self.lock();
        if queues.closed {
            return None;
        }
        queues.release_throttled(now);
        let mut batch = Vec::new();
        let mut bytes = 0;
        while bytes < BATCH_BYTES
            && let Some(outgoing) = queues.pop()
        {
            bytes += match &outgoing {
                Outgoing::Message(message, delivery) => message.text(delivery.ros_version).len(),
                Outgoing::Reply(reply) => reply.text.len(),
            };
            batch.push(outgoing);
        }
        Some(batch)
    }

    /// Waits until there may be something to take.
    pub(crate) async fn ready(&self) {
        let due = self.lock().next_due();
        match due {
            Some(due) => {
                tokio::select! {
                    () = self.wake.notified() => {}
                    () = tokio::time::sleep_until(due.into()) => {}
                }
            }
            None => self.wake.notified().await,
        }
    }

    fn push(&self, message: &Arc<TopicMessage>, now: Instant) {
        let mut guard = self.lock();
        let queues = &mut *guard;
        let Some(queue) = queues.topics.get_mut(&*message.topic) else { return };
        let name = Arc::clone(&queue.name);
        let DeliveryOptions { throttle, queue_length, ros_version: convention, .. } = queue.delivery;
        let bytes = message.text(convention).len();
        let waiting = QueuedMessage { message: Arc::clone(message), bytes };
        let early = !throttle.is_zero()
            && (queue.queued.len() > queue.ready || queue.next_due.is_some_and(|due| now < due));
        if early {
            if queue_length == 0 {
                return;
            }
            queue.queued.push_back(waiting);
            queues.bytes += bytes;
            if queue.queued.len() - queue.ready > queue_length {
                let gone = queue.queued.remove(queue.ready);
                queues.bytes -= gone.map_or(0, |waiting| waiting.bytes);
            }
            if !queues.throttled.contains(&name) {
                queues.throttled.push(name);
            }
        } else {
            queue.next_due = Some(now + throttle);
            queue.queued.push_back(waiting);
            queues.bytes += bytes;
            if queue_length > 0 && queue.ready == queue_length {
                // The new message takes the place of the oldest one in the order.
                let gone = queue.queued.pop_front();
                queues.bytes -= gone.map_or(0, |waiting| waiting.bytes);
                queues.dropped += 1;
            } else {
                queue.ready += 1;
                queues.order.push_back(QueueEntry::Topic(name));
            }
        }
        queues.drop_oldest();
    }
}

impl Queues {
    /// Drops the oldest messages until what waits fits; answers stay.
    fn drop_oldest(&mut self) {
        let mut kept = VecDeque::new();
        while self.bytes > MAX_WAITING_BYTES {
            match self.order.pop_front() {
                Some(QueueEntry::Topic(name)) => {
                    if let Some(queue) = self.topics.get_mut(&name)
                        && let Some(waiting) = queue.queued.pop_front()
                    {
                        queue.ready -= 1;
                        self.bytes -= waiting.bytes;
                        self.dropped += 1;
                    }
                }
                Some(reply) => kept.push_back(reply),
                // Only throttled messages and answers are left; the former go whole.
                None => {
                    let Some(name) = self.throttled.pop() else { break };
                    if let Some(queue) = self.topics.get_mut(&name) {
                        for waiting in queue.queued.drain(..) {
                            self.bytes -= waiting.bytes;
                            self.dropped += 1;
                        }
                    }
                }
            }
        }
        while let Some(slot) = kept.pop_back() {
            self.order.push_front(slot);
        }
    }

    /// Lets throttled messages go whose time has come.
    fn release_throttled(&mut self, now: Instant) {
        let (topics, order) = (&mut self.topics, &mut self.order);
        self.throttled.retain(|name| {
            let Some(queue) = topics.get_mut(name) else { return false };
            if queue.next_due.is_none_or(|due| due <= now) && queue.queued.len() > queue.ready {
                queue.ready += 1;
                queue.next_due = Some(now + queue.delivery.throttle);
                order.push_back(QueueEntry::Topic(Arc::clone(name)));
            }
            queue.queued.len() > queue.ready
        });
    }

    fn next_due(&self) -> Option<Instant> {
        self.throttled.iter().filter_map(|name| self.topics.get(name)?.next_due).min()
    }

    fn pop(&mut self) -> Option<Outgoing> {
        loop {
            match self.order.pop_front()? {
                QueueEntry::Reply(reply) => {
                    self.bytes -= reply.text.len();
                    self.replies -= 1;
                    return Some(Outgoing::Reply(reply));
                }
                QueueEntry::Topic(name) => {
                    let Some(queue) = self.topics.get_mut(&name) else { continue };
                    let Some(QueuedMessage { message, bytes }) = queue.queued.pop_front() else { continue };
                    queue.ready -= 1;
                    self.bytes -= bytes;
                    let message = match &queue.alias {
                        Some(alias) => message.with_topic(alias),
                        None => message,
                    };
                    return Some(Outgoing::Message(message, queue.delivery));
                }
            }
        }
    }
}

impl TopicSink for Outbox {
    fn deliver(&self, message: &Arc<TopicMessage>) {
        self.push(message, Instant::now());
    }

    fn wake(&self) {
        self.wake.notify_one();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proact_messages::MessageValue;

    const PLAIN: DeliveryOptions = DeliveryOptions {
        throttle: Duration::ZERO,
        queue_length: 0,
        fragment_size: None,
        compression: Compression::None,
        ros_version: RosVersion::Ros1,
    };

    fn message(topic: &str, number: usize, size: usize) -> Arc<TopicMessage> {
        let text = format!("{number:06}{}", "x".repeat(size));
        TopicMessage::new(topic, None, MessageValue::Message(vec![("data".into(), MessageValue::Text(text))]))
    }

    fn numbers(batch: &[Outgoing]) -> Vec<(String, usize)> {
        let number = |message: &TopicMessage| {
            message.value.get("data").and_then(MessageValue::as_text).unwrap()[..6].parse().unwrap()
        };
        let one = |outgoing: &Outgoing| match outgoing {
            Outgoing::Message(message, _) => (message.topic.to_string(), number(message)),
            Outgoing::Reply(reply) => (reply.text.to_string(), 0),
        };
        batch.iter().map(one).collect()
    }

    fn pairs(expected: &[(&str, usize)]) -> Vec<(String, usize)> {
        expected.iter().map(|(topic, number)| ((*topic).to_owned(), *number)).collect()
    }

    #[test]
    fn a_short_queue_keeps_the_newest_message_of_each_topic() {
        let outbox = Outbox::default();
        let now = Instant::now();
        for topic in ["/a", "/b"] {
            outbox.set_delivery(topic, DeliveryOptions { queue_length: 1, ..PLAIN });
        }
        for number in 0..5 {
            outbox.push(&message("/a", number, 0), now);
            outbox.push(&message("/b", number, 0), now);
        }
        assert_eq!(numbers(&outbox.take_batch(now).unwrap()), pairs(&[("/a", 4), ("/b", 4)]));
        assert_eq!(outbox.dropped(), 8);
        assert!(outbox.take_batch(now).unwrap().is_empty());
    }

    #[test]
    fn without_a_queue_length_everything_is_kept_in_order_up_to_the_memory_bound() {
        let outbox = Outbox::default();
        let now = Instant::now();
        outbox.set_delivery("/a", PLAIN);
        for number in 0..100 {
            outbox.push(&message("/a", number, 1_000_000), now);
            assert!(outbox.lock().bytes <= MAX_WAITING_BYTES);
        }
        let mut got = Vec::new();
        loop {
            let batch = outbox.take_batch(now).unwrap();
            if batch.is_empty() {
                break;
            }
            got.extend(numbers(&batch));
        }
        assert_eq!(got, pairs(&(84..100).map(|n| ("/a", n)).collect::<Vec<_>>()));
        assert_eq!(outbox.dropped(), 84);
        assert_eq!(outbox.lock().bytes, 0);
    }

    #[test]
    fn a_throttled_topic_comes_at_its_pace_and_keeps_the_latest() {
        let outbox = Outbox::default();
        let start = Instant::now();
        let at = |ms| start + Duration::from_millis(ms);
        outbox.set_delivery(
            "/a",
            DeliveryOptions { throttle: Duration::from_millis(100), queue_length: 1, ..PLAIN },
        );
        let mut got = Vec::new();
        for ms in 0..250 {
            outbox.push(&message("/a", ms as usize, 0), at(ms));
            got.extend(numbers(&outbox.take_batch(at(ms)).unwrap()));
        }
        got.extend(numbers(&outbox.take_batch(at(1000)).unwrap()));
        assert_eq!(got, pairs(&[("/a", 0), ("/a", 100), ("/a", 200), ("/a", 249)]));
        assert_eq!(outbox.lock().bytes, 0);
    }

    #[test]
    fn a_throttle_without_a_queue_drops_what_comes_early() {
        let outbox = Outbox::default();
        let start = Instant::now();
        outbox.set_delivery("/a", DeliveryOptions { throttle: Duration::from_millis(100), ..PLAIN });
        for ms in 0..=100 {
            outbox.push(&message("/a", ms, 0), start + Duration::from_millis(ms as u64));
        }
        assert_eq!(numbers(&outbox.take_batch(start).unwrap()), pairs(&[("/a", 0), ("/a", 100)]));
    }

    #[test]
    fn a_client_that_asks_and_never_reads_is_given_up() {
        let outbox = Outbox::default();
        let reply = || QueuedReply { text: "x".into(), fragment_size: None, compression: Compression::None };
        for _ in 0..MAX_REPLIES {
            outbox.reply(reply());
        }
        assert!(!outbox.lock().closed);
        outbox.reply(reply());
        assert!(outbox.take_batch(Instant::now()).is_none());
    }

    #[test]
    fn the_end_of_a_subscription_takes_its_messages_along() {
        let outbox = Outbox::default();
        let now = Instant::now();
        outbox.set_delivery("/a", PLAIN);
        outbox.set_delivery(
            "/b",
            DeliveryOptions { throttle: Duration::from_secs(1), queue_length: 3, ..PLAIN },
        );
        for number in 0..3 {
            outbox.push(&message("/a", number, 9), now);
            outbox.push(&message("/b", number, 9), now);
        }
        outbox.remove("/a");
        outbox.remove("/b");
        assert!(outbox.take_batch(now).unwrap().is_empty());
        assert_eq!(outbox.lock().bytes, 0);
        assert_eq!(outbox.lock().next_due(), None);
    }
}
