//! The TCPROS server of a process: one port for all its topics.

use super::{
    connection::{ConnectionEnd, EncodedMessage, QueueLimits, SubscriberConnection},
    header::{self, HeaderFields},
};
use std::{
    collections::{BTreeMap, BTreeSet},
    io::{self, Read, Write},
    net::{TcpListener, TcpStream, ToSocketAddrs},
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicBool, AtomicUsize, Ordering},
    },
    time::{Duration, Instant},
};

/// A subscriber sends its header, and takes ours, within this time.
const HANDSHAKE_TIMEOUT: Duration = Duration::from_secs(5);
/// Most connections of the process; further ones are closed at once.
const MAX_CONNECTIONS: usize = 1000;
/// Refused connections that are remembered, so that each is logged once. Subscribers try again for ever.
const MAX_REMEMBERED_REFUSALS: usize = 1000;
/// After a failed `accept` (no file handles left) the next one waits for this time.
const ACCEPT_RETRY_DELAY: Duration = Duration::from_millis(100);
/// Subscribers and publishers that take any type say this in place of type and MD5 sum.
const ANY: &str = "*";

/// What is published on a topic.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct TopicDescription {
    pub type_name: String,
    pub md5: String,
    /// The message definition with all that it needs.
    pub definition: String,
}

fn lock<T>(of: &Mutex<T>) -> MutexGuard<'_, T> {
    // No code that holds one of these locks can panic half way through a change.
    of.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The subscribers of a topic.
pub(super) struct OfferedTopic {
    topic: String,
    description: TopicDescription,
    limits: QueueLimits,
    latching: AtomicBool,
    subscribers: Mutex<Subscribers>,
}

#[derive(Default)]
struct Subscribers {
    connections: Vec<Arc<SubscriberConnection>>,
    /// The last message, where the topic latches.
    last: Option<EncodedMessage>,
    ended: bool,
}

impl Subscribers {
    fn open(&self) -> impl Iterator<Item = &Arc<SubscriberConnection>> {
        self.connections.iter().filter(|connection| !connection.is_closed())
    }
}

impl OfferedTopic {
    pub(super) fn description(&self) -> &TopicDescription {
        &self.description
    }

    /// From now on the last message is kept for subscribers that come later.
    pub(super) fn latch(&self) {
        self.latching.store(true, Ordering::Relaxed);
    }

    /// Gives a message to every subscriber's queue.
    pub(super) fn send(&self, message: &EncodedMessage) {
        let mut subscribers = lock(&self.subscribers);
        if self.latching.load(Ordering::Relaxed) {
            subscribers.last = Some(message.clone());
        }
        subscribers.connections.retain(|connection| !connection.is_closed());
        for connection in &subscribers.connections {
            connection.push(message.clone());
        }
    }

    /// Nodes that are connected.
    pub(super) fn subscribers(&self) -> Vec<String> {
        lock(&self.subscribers).open().map(|connection| connection.subscriber().to_owned()).collect()
    }

    pub(super) fn subscriber_count(&self) -> usize {
        lock(&self.subscribers).open().count()
    }

    pub(super) fn connections(&self) -> Vec<Arc<SubscriberConnection>> {
        lock(&self.subscribers).connections.clone()
    }

    /// Waits until each subscriber has what was sent; false if that is not so at `deadline`.
    pub(super) fn flush(&self, deadline: Instant) -> bool {
        self.connections().iter().all(|connection| connection.flush(deadline))
    }

    /// A subscriber that has had its header. False if the topic has ended meanwhile.
    fn add(&self, connection: &Arc<SubscriberConnection>) -> bool {
        let mut subscribers = lock(&self.subscribers);
        if subscribers.ended {
            return false;
        }
        // A node has one connection for a topic. A second one takes the place of the first: the node was started again, lost
        // the network, or did not see that the first one lives, as rosrust after a restart of the master.
        subscribers.connections.retain(|other| {
            let same = other.subscriber() == connection.subscriber() && !other.subscriber().is_empty();
            if same {
                other.close();
            }
            !same && !other.is_closed()
        });
        if let Some(last) = &subscribers.last {
            connection.push(last.clone());
        }
        subscribers.connections.push(connection.clone());
        true
    }

    /// Ends all connections once what waits is written.
    fn end(&self) {
        let mut subscribers = lock(&self.subscribers);
        subscribers.ended = true;
        for connection in subscribers.connections.drain(..) {
            connection.end();
        }
    }
}

/// A connection of the process, as `rosnode info` shows it.
pub(super) struct BusConnection {
    pub topic: String,
    pub subscriber: String,
}

/// What the server is set up with.
pub(super) struct TopicServerOptions {
    /// Name of this node.
    pub node: String,
    /// A subscriber that takes nothing for this long is closed.
    pub write_timeout: Duration,
    /// Takes a sentence for the log.
    pub log: Box<dyn Fn(&str) + Send + Sync>,
}

/// The server.
pub(super) struct TopicServer {
    options: TopicServerOptions,
    port: u16,
    topics: Mutex<BTreeMap<String, Arc<OfferedTopic>>>,
    open_connections: AtomicUsize,
    refused: Mutex<BTreeSet<String>>,
}

impl TopicServer {
    /// Listens on a free port of `address`, until the process ends.
    ///
    /// # Errors
    /// The socket's, or no thread.
    pub(super) fn bind(address: impl ToSocketAddrs, options: TopicServerOptions) -> io::Result<Arc<Self>> {
        let listener = TcpListener::bind(address)?;
        let port = listener.local_addr()?.port();
        let hub = Arc::new(Self {
            options,
            port,
            topics: Mutex::default(),
            open_connections: AtomicUsize::new(0),
            refused: Mutex::default(),
        });
        let accepting = hub.clone();
        std::thread::Builder::new().name("tcpros".to_owned()).spawn(move || accept(&listener, &accepting))?;
        Ok(hub)
    }

    pub(super) fn port(&self) -> u16 {
        self.port
    }

    /// Offers a topic. One that is offered already is that one; its description and limits stay.
    pub(super) fn advertise(
        &self,
        topic: &str,
        description: &TopicDescription,
        limits: QueueLimits,
    ) -> Arc<OfferedTopic> {
        let topic_publisher = || {
            Arc::new(OfferedTopic {
                topic: topic.to_owned(),
                description: description.clone(),
                limits,
                latching: AtomicBool::new(false),
                subscribers: Mutex::default(),
            })
        };
        lock(&self.topics).entry(topic.to_owned()).or_insert_with(topic_publisher).clone()
    }

    /// Takes a topic back; its subscribers get what was sent.
    pub(super) fn unadvertise(&self, topic: &str) {
        if let Some(topic_publisher) = lock(&self.topics).remove(topic) {
            topic_publisher.end();
        }
    }

    pub(super) fn topic(&self, topic: &str) -> Option<Arc<OfferedTopic>> {
        lock(&self.topics).get(topic).cloned()
    }

    pub(super) fn topics(&self) -> Vec<(String, Arc<OfferedTopic>)> {
        lock(&self.topics)
            .iter()
            .map(|(topic, topic_publisher)| (topic.clone(), topic_publisher.clone()))
            .collect()
    }

    pub(super) fn log(&self, text: &str) {
        (self.options.log)(text);
    }

    /// All connections.
    pub(super) fn bus(&self) -> Vec<BusConnection> {
        let of_topic = |(topic, topic_publisher): (String, Arc<OfferedTopic>)| {
            let subscribers = topic_publisher.subscribers().into_iter();
            subscribers.map(move |subscriber| BusConnection { topic: topic.clone(), subscriber })
        };
        self.topics().into_iter().flat_map(of_topic).collect()
    }

    /// Serves a connection until it ends.
    fn serve(&self, mut stream: TcpStream) -> io::Result<()> {
        stream.set_nodelay(true)?;
        let deadline = Instant::now() + HANDSHAKE_TIMEOUT;
        stream.set_write_timeout(Some(HANDSHAKE_TIMEOUT))?;
        let topic_publisher = header::read(&mut DeadlineReader { stream: &stream, deadline })
            .map_err(|error| error.to_string())
            .and_then(|fields| self.admit(&fields));
        let (topic_publisher, subscriber) = match topic_publisher {
            Ok(admitted) => admitted,
            Err(reason) => {
                self.refuse(&reason);
                return stream.write_all(&header::write(&[("error", &reason)]));
            }
        };
        let TopicDescription { type_name, md5, definition } = &topic_publisher.description;
        stream.write_all(&header::write(&[
            ("callerid", &self.options.node),
            ("latching", if topic_publisher.latching.load(Ordering::Relaxed) { "1" } else { "0" }),
            ("md5sum", md5),
            ("message_definition", definition),
            ("topic", &topic_publisher.topic),
            ("type", type_name),
        ]))?;
        let closes_after = self.options.write_timeout;
        let connection =
            Arc::new(SubscriberConnection::new(&subscriber, stream, topic_publisher.limits, closes_after)?);
        let topic = topic_publisher.topic.clone();
        let added = topic_publisher.add(&connection);
        // The outlet of a publisher that is dropped meanwhile does not live on.
        drop(topic_publisher);
        if added && connection.run() == ConnectionEnd::Timeout {
            self.log(&format!("closed {subscriber}, which took nothing of {topic} for {closes_after:?}"));
        }
        Ok(())
    }

    /// The topic that a subscriber asks for, and the subscriber's name; or why it does not get it.
    fn admit(&self, fields: &HeaderFields) -> Result<(Arc<OfferedTopic>, String), String> {
        let field = |key: &str| fields.get(key).map(String::as_str);
        let subscriber = field("callerid").unwrap_or_default();
        let topic = field("topic").ok_or("the header has no field \"topic\"")?;
        let topic_publisher =
            self.topic(topic).ok_or_else(|| format!("{} does not publish {topic}", self.options.node))?;
        let here = &topic_publisher.description;
        let md5 = field("md5sum").ok_or("the header has no field \"md5sum\"")?;
        // roscpp may leave its type out.
        let type_name = field("type").unwrap_or(ANY);
        let agrees = |theirs: &str, ours: &str| theirs == ours || theirs == ANY || ours == ANY;
        if !agrees(md5, &here.md5) || !agrees(type_name, &here.type_name) {
            return Err(format!(
                "{topic}: {subscriber} expects {type_name} with MD5 sum {md5}, {} publishes {} with MD5 sum {}",
                self.options.node, here.type_name, here.md5
            ));
        }
        Ok((topic_publisher, subscriber.to_owned()))
    }

    fn refuse(&self, reason: &str) {
        let mut refused = lock(&self.refused);
        if refused.len() < MAX_REMEMBERED_REFUSALS && refused.insert(reason.to_owned()) {
            drop(refused);
            self.log(&format!("refused a subscriber: {reason}"));
        }
    }
}

fn accept(listener: &TcpListener, hub: &Arc<TopicServer>) -> ! {
    loop {
        let Ok((stream, _)) = listener.accept() else {
            std::thread::sleep(ACCEPT_RETRY_DELAY);
            continue;
        };
        if hub.open_connections.fetch_add(1, Ordering::AcqRel) >= MAX_CONNECTIONS {
            hub.open_connections.fetch_sub(1, Ordering::AcqRel);
            hub.refuse(&format!("{MAX_CONNECTIONS} connections are open already"));
            continue;
        }
        let serving = hub.clone();
        let serve = move || {
            // It ends with an error when the subscriber breaks off, which is its own matter.
            let _ = serving.serve(stream);
            serving.open_connections.fetch_sub(1, Ordering::AcqRel);
        };
        if std::thread::Builder::new().name("tcpros".to_owned()).spawn(serve).is_err() {
            hub.open_connections.fetch_sub(1, Ordering::AcqRel);
        }
    }
}

/// Reads until a deadline.
struct DeadlineReader<'a> {
    stream: &'a TcpStream,
    deadline: Instant,
}

impl Read for DeadlineReader<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let left = self.deadline.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return Err(io::ErrorKind::TimedOut.into());
        }
        self.stream.set_read_timeout(Some(left))?;
        self.stream.read(buffer)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc::{Receiver, channel};

    const LIMITS: QueueLimits = QueueLimits { messages: 10, bytes: 1 << 20 };
    const LONG: Duration = Duration::from_secs(60);

    fn description() -> TopicDescription {
        TopicDescription {
            type_name: "std_msgs/String".to_owned(),
            md5: "992ce8a1687cec8c8bd883ec73ca41d1".to_owned(),
            definition: "string data\n".to_owned(),
        }
    }

    /// A hub, and what it logs.
    fn start(closes_after: Duration) -> (Arc<TopicServer>, Receiver<String>) {
        let (sender, logged) = channel();
        let sender = Mutex::new(sender);
        let log = Box::new(move |text: &str| {
            // The test may have ended.
            let _ = lock(&sender).send(text.to_owned());
        });
        let options = TopicServerOptions { node: "/talker".to_owned(), write_timeout: closes_after, log };
        (TopicServer::bind("127.0.0.1:0", options).unwrap(), logged)
    }

    /// A subscriber, and the header that it gets.
    fn subscribe(hub: &TopicServer, fields: &[(&str, &str)]) -> (TcpStream, HeaderFields) {
        let mut stream = TcpStream::connect(("127.0.0.1", hub.port())).unwrap();
        stream.set_read_timeout(Some(LONG)).unwrap();
        stream.write_all(&header::write(fields)).unwrap();
        let answer = header::read(&mut stream).unwrap();
        (stream, answer)
    }

    fn listener(hub: &TopicServer, name: &str) -> TcpStream {
        let (md5, type_name) = (description().md5, description().type_name);
        let fields = [("callerid", name), ("topic", "/chatter"), ("md5sum", &*md5), ("type", &*type_name)];
        let (stream, answer) = subscribe(hub, &fields);
        assert_eq!(answer.get("error"), None);
        stream
    }

    fn take(stream: &mut TcpStream, bytes: usize) -> Vec<u8> {
        let mut got = vec![0; bytes];
        stream.read_exact(&mut got).unwrap();
        got
    }

    fn until(true_at_last: impl Fn() -> bool) {
        let deadline = Instant::now() + LONG;
        while !true_at_last() {
            assert!(Instant::now() < deadline, "waited in vain");
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    fn send(topic_publisher: &OfferedTopic, text: &[u8]) {
        topic_publisher.send(&text.into());
    }

    #[test]
    fn subscribers_get_the_header_and_every_message() {
        let (hub, _) = start(LONG);
        let topic_publisher = hub.advertise("/chatter", &description(), LIMITS);
        let (mut any, answer) =
            subscribe(&hub, &[("callerid", "/any"), ("topic", "/chatter"), ("md5sum", "*"), ("type", "*")]);
        let expected = [
            ("callerid", "/talker"),
            ("latching", "0"),
            ("md5sum", "992ce8a1687cec8c8bd883ec73ca41d1"),
            ("message_definition", "string data\n"),
            ("topic", "/chatter"),
            ("type", "std_msgs/String"),
        ];
        let expected: HeaderFields =
            expected.into_iter().map(|(key, value)| (key.to_owned(), value.to_owned())).collect();
        assert_eq!(answer, expected);
        let mut named = listener(&hub, "/listener");
        until(|| topic_publisher.subscriber_count() == 2);
        send(&topic_publisher, b"one");
        send(&topic_publisher, b"two");
        for stream in [&mut any, &mut named] {
            assert_eq!(take(stream, 6), b"onetwo");
        }
        assert!(topic_publisher.flush(Instant::now() + LONG));
        let bus: Vec<_> = hub.bus().into_iter().map(|one| (one.topic, one.subscriber)).collect();
        let pair = |name: &str| ("/chatter".to_owned(), name.to_owned());
        assert_eq!(bus, [pair("/any"), pair("/listener")]);
    }

    #[test]
    fn a_stopped_subscriber_takes_nothing_from_the_others() {
        let (hub, _) = start(LONG);
        let topic_publisher = hub.advertise("/chatter", &description(), LIMITS);
        let _stopped = listener(&hub, "/stopped");
        let mut others: Vec<TcpStream> = (0..5).map(|k| listener(&hub, &format!("/other{k}"))).collect();
        until(|| topic_publisher.subscriber_count() == 6);
        // Far more than the kernel keeps for a connection.
        for number in 0..100 {
            send(&topic_publisher, &vec![number; 200_000]);
            for other in &mut others {
                assert_eq!(take(other, 200_000), vec![number; 200_000]);
            }
        }
        let counted: Vec<_> = topic_publisher.connections().iter().map(|c| c.take_stats(|_| true)).collect();
        assert!(counted[0].unwrap().dropped > 0);
        assert!(counted[1..].iter().all(|others| others.unwrap().dropped == 0));
    }

    #[test]
    fn a_subscriber_that_takes_nothing_is_closed_and_named_in_the_log() {
        let (hub, logged) = start(Duration::from_millis(200));
        let topic_publisher = hub.advertise("/chatter", &description(), LIMITS);
        let _stopped = listener(&hub, "/stopped");
        until(|| topic_publisher.subscriber_count() == 1);
        for _ in 0..100 {
            send(&topic_publisher, &vec![0; 200_000]);
        }
        assert_eq!(
            logged.recv_timeout(LONG).unwrap(),
            "closed /stopped, which took nothing of /chatter for 200ms"
        );
        assert_eq!(topic_publisher.subscriber_count(), 0);
    }

    #[test]
    fn who_comes_later_gets_the_latched_message_first() {
        let (hub, _) = start(LONG);
        let topic_publisher = hub.advertise("/chatter", &description(), LIMITS);
        send(&topic_publisher, b"before");
        topic_publisher.latch();
        send(&topic_publisher, b"kept");
        let mut late = listener(&hub, "/late");
        assert_eq!(take(&mut late, 4), b"kept");
        send(&topic_publisher, b"next");
        assert_eq!(take(&mut late, 4), b"next");
    }

    #[test]
    fn a_wrong_sum_or_type_is_answered_with_an_error_and_logged_once() {
        let (hub, logged) = start(LONG);
        hub.advertise("/chatter", &description(), LIMITS);
        let other = "0123456789abcdef0123456789abcdef";
        let ours = description().md5;
        for (md5, type_name) in [(other, "lab/String"), (&*ours, "lab/String"), (other, "*")] {
            let fields = [("callerid", "/l"), ("topic", "/chatter"), ("md5sum", md5), ("type", type_name)];
            let expected = format!(
                "/chatter: /l expects {type_name} with MD5 sum {md5}, /talker publishes std_msgs/String with MD5 sum {ours}"
            );
            for _ in 0..3 {
                let (mut stream, answer) = subscribe(&hub, &fields);
                assert_eq!(answer.into_iter().collect::<Vec<_>>(), [("error".to_owned(), expected.clone())]);
                assert_eq!(stream.read(&mut [0]).unwrap(), 0);
            }
            assert_eq!(logged.recv_timeout(LONG).unwrap(), format!("refused a subscriber: {expected}"));
        }
        assert!(logged.try_recv().is_err(), "each once");
        let answer = subscribe(&hub, &[("callerid", "/l"), ("topic", "/other"), ("md5sum", "*")]).1;
        assert_eq!(answer["error"], "/talker does not publish /other");
        assert_eq!(subscribe(&hub, &[]).1["error"], "the header has no field \"topic\"");
    }

    #[test]
    fn bytes_that_are_no_header_are_answered_and_hold_nobody_up() {
        let (hub, _) = start(LONG);
        hub.advertise("/chatter", &description(), LIMITS);
        let _silent: Vec<TcpStream> =
            (0..20).map(|_| TcpStream::connect(("127.0.0.1", hub.port())).unwrap()).collect();
        let mut stream = TcpStream::connect(("127.0.0.1", hub.port())).unwrap();
        stream.write_all(b"GET / HTTP/1.1\r\n\r\n").unwrap();
        assert!(header::read(&mut stream).unwrap()["error"].contains("at most 262144 are allowed"));
        listener(&hub, "/listener");
    }

    #[test]
    fn a_node_has_one_connection_for_a_topic() {
        let (hub, _) = start(LONG);
        let topic_publisher = hub.advertise("/chatter", &description(), LIMITS);
        let mut first = listener(&hub, "/listener");
        until(|| topic_publisher.subscriber_count() == 1);
        let mut second = listener(&hub, "/listener");
        assert_eq!(first.read(&mut [0]).unwrap(), 0, "the first has ended");
        send(&topic_publisher, b"once");
        assert_eq!(take(&mut second, 4), b"once");
        assert_eq!(topic_publisher.subscriber_count(), 1);
    }

    #[test]
    fn a_topic_that_is_withdrawn_is_written_to_its_end() {
        let (hub, _) = start(LONG);
        let topic_publisher = hub.advertise("/chatter", &description(), LIMITS);
        let mut stream = listener(&hub, "/listener");
        until(|| topic_publisher.subscriber_count() == 1);
        let long = vec![1; 4 << 20];
        send(&topic_publisher, &long);
        hub.unadvertise("/chatter");
        let mut got = Vec::new();
        stream.read_to_end(&mut got).unwrap();
        assert_eq!(got, long);
        let answer = subscribe(&hub, &[("callerid", "/late"), ("topic", "/chatter"), ("md5sum", "*")]).1;
        assert_eq!(answer["error"], "/talker does not publish /chatter");
    }
}
