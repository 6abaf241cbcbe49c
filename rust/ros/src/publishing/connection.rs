//! One subscriber's connection: a bounded queue that drops its oldest message, and a thread that writes.

use nix::sys::socket::{setsockopt, sockopt};
use std::{
    collections::VecDeque,
    io::{self, ErrorKind, Read, Write},
    net::{Shutdown, TcpStream},
    os::fd::AsRawFd,
    sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError},
    time::{Duration, Instant},
};

/// From one look whether the subscriber closed the connection to the next, while no message is written.
const CLOSE_CHECK_PERIOD: Duration = Duration::from_secs(1);
/// How long such a look waits for bytes. A subscriber sends none after its header.
const CLOSE_CHECK_TIMEOUT: Duration = Duration::from_millis(1);

/// A message as it is sent, with its length before it. All subscribers of a topic share it.
pub(super) type EncodedMessage = Arc<[u8]>;

/// What may wait for one subscriber. One message may always wait.
#[derive(Clone, Copy, Debug)]
pub(super) struct QueueLimits {
    pub messages: usize,
    pub bytes: usize,
}

/// Messages to one subscriber since a time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct DeliveryStats {
    pub delivered: u64,
    pub dropped: u64,
    /// Delivered bytes.
    pub bytes: u64,
}

/// Why a connection ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ConnectionEnd {
    /// The publisher ended it.
    Publisher,
    /// The subscriber closed it, or the network broke it.
    Subscriber,
    /// The subscriber took nothing within the write timeout.
    Timeout,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    Open,
    /// Messages that wait are written, then the connection is closed.
    Ending,
    Closed,
}

struct Queue {
    waiting: VecDeque<EncodedMessage>,
    /// Of all that wait.
    bytes: usize,
    /// A message is between the queue and the socket.
    writing: bool,
    state: State,
    stats: DeliveryStats,
}

impl Queue {
    fn is_drained(&self) -> bool {
        self.state == State::Closed || (self.waiting.is_empty() && !self.writing)
    }
}

/// The publisher's side of a connection.
pub(super) struct SubscriberConnection {
    subscriber: String,
    stream: TcpStream,
    limits: QueueLimits,
    queue: Mutex<Queue>,
    changed: Condvar,
}

/// Has the kernel end a connection whose packets get no answer for `timeout`: a machine that went off the network. Without
/// this, a topic with few messages keeps such a subscriber for a quarter of an hour, an idle one for ever.
fn close_without_answer(stream: &TcpStream, timeout: Duration) -> io::Result<()> {
    let socket = stream.as_raw_fd();
    let (seconds, millis) = (timeout.as_secs().clamp(1, 32_767), timeout.as_millis().min(u32::MAX.into()));
    setsockopt(socket, sockopt::KeepAlive, &true)?;
    setsockopt(socket, sockopt::TcpKeepIdle, &(seconds as u32))?;
    setsockopt(socket, sockopt::TcpUserTimeout, &(millis as u32))?;
    Ok(())
}

impl SubscriberConnection {
    /// A connection to the node `subscriber`, which has had its header. A subscriber that takes no byte for `timeout` is
    /// closed.
    ///
    /// # Errors
    /// The socket's.
    pub(super) fn new(
        subscriber: &str,
        stream: TcpStream,
        limits: QueueLimits,
        timeout: Duration,
    ) -> io::Result<Self> {
        stream.set_nodelay(true)?;
        stream.set_write_timeout(Some(timeout))?;
        close_without_answer(&stream, timeout)?;
        stream.set_read_timeout(Some(CLOSE_CHECK_TIMEOUT))?;
        let queue = Queue {
            waiting: VecDeque::new(),
            bytes: 0,
            writing: false,
            state: State::Open,
            stats: DeliveryStats::default(),
        };
        Ok(Self {
            subscriber: subscriber.to_owned(),
            stream,
            limits,
            queue: Mutex::new(queue),
            changed: Condvar::new(),
        })
    }

    fn queue(&self) -> MutexGuard<'_, Queue> {
        // No code that holds the lock can panic half way through a change.
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The subscriber's node.
    pub(super) fn subscriber(&self) -> &str {
        &self.subscriber
    }

    /// Puts a message in the queue, and drops the oldest ones that no longer fit. Never waits for the subscriber.
    pub(super) fn push(&self, message: EncodedMessage) {
        let mut queue = self.queue();
        if queue.state != State::Open {
            return;
        }
        queue.bytes += message.len();
        queue.waiting.push_back(message);
        while queue.waiting.len() > 1
            && (queue.waiting.len() > self.limits.messages || queue.bytes > self.limits.bytes)
        {
            if let Some(oldest) = queue.waiting.pop_front() {
                queue.bytes -= oldest.len();
                queue.stats.dropped += 1;
            }
        }
        drop(queue);
        self.changed.notify_all();
    }

    /// The thread of the connection: writes until the connection ends, and says why it did.
    pub(super) fn run(&self) -> ConnectionEnd {
        let end = self.write_messages();
        self.close();
        end
    }

    fn write_messages(&self) -> ConnectionEnd {
        loop {
            match self.next() {
                WriterStep::Message(message) => match (&self.stream).write_all(&message) {
                    Ok(()) => self.delivered(message.len()),
                    Err(_) if self.queue().state == State::Closed => return ConnectionEnd::Publisher,
                    Err(error) if error.kind() == ErrorKind::WouldBlock => return ConnectionEnd::Timeout,
                    Err(error) => return connection_end(&error),
                },
                WriterStep::CheckClosed => {
                    if let Some(end) = self.check_closed() {
                        return end;
                    }
                }
                WriterStep::End => return ConnectionEnd::Publisher,
            }
        }
    }

    /// Waits for the next thing to do.
    fn next(&self) -> WriterStep {
        let mut queue = self.queue();
        loop {
            if queue.state == State::Closed {
                return WriterStep::End;
            }
            if let Some(message) = queue.waiting.pop_front() {
                queue.bytes -= message.len();
                queue.writing = true;
                return WriterStep::Message(message);
            }
            if queue.state == State::Ending {
                return WriterStep::End;
            }
            let (woken, timeout) =
                self.changed.wait_timeout(queue, CLOSE_CHECK_PERIOD).unwrap_or_else(PoisonError::into_inner);
            if timeout.timed_out() && woken.waiting.is_empty() {
                return WriterStep::CheckClosed;
            }
            queue = woken;
        }
    }

    fn delivered(&self, bytes: usize) {
        let mut queue = self.queue();
        queue.writing = false;
        queue.stats.delivered += 1;
        queue.stats.bytes += bytes as u64;
        let drained = queue.is_drained();
        drop(queue);
        if drained {
            // For `flush`.
            self.changed.notify_all();
        }
    }

    /// Whether the connection has ended while nothing was written. Bytes that the subscriber sends are dropped, or they would
    /// hide its end.
    fn check_closed(&self) -> Option<ConnectionEnd> {
        match (&self.stream).read(&mut [0; 256]) {
            Ok(0) => Some(ConnectionEnd::Subscriber),
            Ok(_) => None,
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => None,
            Err(error) => Some(connection_end(&error)),
        }
    }

    /// Whether the connection has ended.
    pub(super) fn is_closed(&self) -> bool {
        self.queue().state == State::Closed
    }

    /// Writes what waits, then closes. Does not wait for it.
    pub(super) fn end(&self) {
        let mut queue = self.queue();
        if queue.state == State::Open {
            queue.state = State::Ending;
        }
        drop(queue);
        self.changed.notify_all();
    }

    /// Closes now; what waits is dropped.
    pub(super) fn close(&self) {
        let mut queue = self.queue();
        queue.state = State::Closed;
        queue.writing = false;
        queue.stats.dropped += queue.waiting.len() as u64;
        queue.bytes = 0;
        queue.waiting = VecDeque::new();
        drop(queue);
        self.changed.notify_all();
        // A write that waits for the subscriber ends. An error means that the connection is gone already.
        let _ = self.stream.shutdown(Shutdown::Both);
    }

    /// Waits until everything was written, or the connection is closed; false if that is not so at `deadline`.
    pub(super) fn flush(&self, deadline: Instant) -> bool {
        let mut queue = self.queue();
        while !queue.is_drained() {
            let left = deadline.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return false;
            }
            queue = self.changed.wait_timeout(queue, left).unwrap_or_else(PoisonError::into_inner).0;
        }
        true
    }

    /// What was delivered and dropped since the count began anew. `take` says of a count whether it is taken, and begins anew.
    pub(super) fn take_stats(&self, take: impl FnOnce(&DeliveryStats) -> bool) -> Option<DeliveryStats> {
        let mut queue = self.queue();
        take(&queue.stats).then(|| std::mem::take(&mut queue.stats))
    }
}

/// The end of a connection whose socket gives this error. `TimedOut` is the kernel's word for packets without an answer.
fn connection_end(error: &io::Error) -> ConnectionEnd {
    match error.kind() {
        ErrorKind::TimedOut => ConnectionEnd::Timeout,
        _ => ConnectionEnd::Subscriber,
    }
}

enum WriterStep {
    Message(EncodedMessage),
    /// Nothing was to be written for [`LOOK_PERIOD`].
    CheckClosed,
    End,
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::{net::TcpListener, thread};

    const LIMITS: QueueLimits = QueueLimits { messages: 3, bytes: 1 << 20 };
    const LONG: Duration = Duration::from_secs(60);

    /// Both ends of a connection.
    fn connect(limits: QueueLimits, timeout: Duration) -> (Arc<SubscriberConnection>, TcpStream) {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let subscriber = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        let (stream, _) = listener.accept().unwrap();
        (Arc::new(SubscriberConnection::new("/listener", stream, limits, timeout).unwrap()), subscriber)
    }

    fn run(connection: &Arc<SubscriberConnection>) -> thread::JoinHandle<ConnectionEnd> {
        let connection = connection.clone();
        thread::spawn(move || connection.run())
    }

    fn message(number: u8, bytes: usize) -> EncodedMessage {
        vec![number; bytes].into()
    }

    fn deliveries(connection: &SubscriberConnection) -> DeliveryStats {
        connection.take_stats(|_| true).unwrap()
    }

    /// A hundred messages that no subscriber takes. The last one, which is never dropped, alone is more than the kernel keeps
    /// for a connection, so that the writer waits however late it begins.
    fn fill(connection: &SubscriberConnection) {
        for _ in 0..99 {
            connection.push(message(0, 1 << 20));
        }
        connection.push(message(0, 1 << 26));
    }

    #[test]
    fn messages_come_in_order() {
        let (connection, mut subscriber) = connect(QueueLimits { messages: 10, ..LIMITS }, LONG);
        let writer = run(&connection);
        for number in 0..10 {
            connection.push(message(number, 1));
        }
        let mut got = [0; 10];
        subscriber.read_exact(&mut got).unwrap();
        assert_eq!(got, [0, 1, 2, 3, 4, 5, 6, 7, 8, 9]);
        assert!(connection.flush(Instant::now() + LONG));
        assert_eq!(deliveries(&connection), DeliveryStats { delivered: 10, dropped: 0, bytes: 10 });
        connection.end();
        assert_eq!(writer.join().unwrap(), ConnectionEnd::Publisher);
    }

    #[test]
    fn the_oldest_messages_are_dropped_by_number_and_by_bytes() {
        let (connection, mut subscriber) = connect(LIMITS, LONG);
        for number in 0..8 {
            connection.push(message(number, 1));
        }
        assert_eq!(deliveries(&connection).dropped, 5);
        // Too large together, each of them alone, and one that is too large by itself.
        connection.push(message(8, 1 << 20));
        assert_eq!(deliveries(&connection).dropped, 3);
        connection.push(message(9, 2 << 20));
        assert_eq!(deliveries(&connection).dropped, 1);
        connection.end();
        // It is still written: an end is no loss.
        let writer = run(&connection);
        let mut got = Vec::new();
        subscriber.read_to_end(&mut got).unwrap();
        assert_eq!(got, vec![9; 2 << 20]);
        assert_eq!(writer.join().unwrap(), ConnectionEnd::Publisher);
    }

    #[test]
    fn a_subscriber_that_takes_nothing_is_closed_and_holds_nobody_up() {
        let (connection, _subscriber) = connect(LIMITS, Duration::from_millis(200));
        let writer = run(&connection);
        fill(&connection);
        assert_eq!(writer.join().unwrap(), ConnectionEnd::Timeout);
        assert!(connection.is_closed());
        let counted = deliveries(&connection);
        // The message in the socket counts as neither.
        assert_eq!(counted.delivered + counted.dropped, 99);
        connection.push(message(0, 1));
        assert!(connection.flush(Instant::now()), "nothing waits in a closed connection");
    }

    #[test]
    fn a_subscriber_that_goes_on_gets_the_newest() {
        let (connection, mut subscriber) = connect(LIMITS, LONG);
        let writer = run(&connection);
        fill(&connection);
        connection.push(message(7, 5));
        connection.end();
        let mut got = Vec::new();
        subscriber.read_to_end(&mut got).unwrap();
        assert_eq!(got[got.len() - 5..], [7; 5]);
        assert!(got[..got.len() - 5].iter().all(|byte| *byte == 0));
        assert_eq!(got.len() % (1 << 20), 5, "messages are whole");
        assert_eq!(writer.join().unwrap(), ConnectionEnd::Publisher);
    }

    #[test]
    fn an_end_is_noticed_while_no_message_is_sent() {
        let (connection, mut subscriber) = connect(LIMITS, LONG);
        let writer = run(&connection);
        // Bytes that no subscriber sends do not hide it.
        subscriber.write_all(b"unexpected").unwrap();
        drop(subscriber);
        assert_eq!(writer.join().unwrap(), ConnectionEnd::Subscriber);
        assert!(connection.is_closed());
    }

    #[test]
    fn closing_ends_a_write_that_waits() {
        let (connection, _subscriber) = connect(LIMITS, LONG);
        let writer = run(&connection);
        fill(&connection);
        assert!(!connection.flush(Instant::now() + Duration::from_millis(10)));
        connection.close();
        assert_eq!(writer.join().unwrap(), ConnectionEnd::Publisher);
    }
}
