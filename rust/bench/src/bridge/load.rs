//! Clients that measure, and the processor time of threads.

use serde_json::{Value as Json, json};
use std::{
    error::Error,
    net::TcpStream,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    thread::JoinHandle,
    time::{Duration, Instant},
};
use tokio_tungstenite::tungstenite::{self, Message, WebSocket, client};

/// A client that hears nothing for so long looks whether the run is over.
const READ_TIMEOUT: Duration = Duration::from_millis(500);

/// How often a server that leaves an answer out is asked again.
const MAX_PINGS: usize = 40;

/// A WebSocket client.
pub(crate) struct WebSocketClient(WebSocket<TcpStream>);

impl WebSocketClient {
    /// Connects to `ws://host:port/..`.
    pub(crate) fn open(address: &str) -> Result<Self, Box<dyn Error>> {
        let host = address.trim_start_matches("ws://").split('/').next().unwrap_or_default();
        let stream = TcpStream::connect(host)?;
        stream.set_nodelay(true)?;
        let (socket, _) = client(address, stream).map_err(|error| error.to_string())?;
        Ok(WebSocketClient(socket))
    }

    pub(crate) fn send(&mut self, json: &Json) -> Result<(), tungstenite::Error> {
        self.0.send(Message::text(json.to_string()))
    }

    /// Puts a message into the next flush.
    pub(crate) fn enqueue(&mut self, text: String) -> Result<(), tungstenite::Error> {
        self.0.write(Message::text(text))
    }

    pub(crate) fn flush(&mut self) -> Result<(), tungstenite::Error> {
        self.0.flush()
    }

    pub(crate) fn read(&mut self) -> Result<Message, tungstenite::Error> {
        self.0.read()
    }

    /// Waits until rosbridge has handled everything that was sent before.
    pub(crate) fn wait_until_handled(&mut self) -> Result<(), Box<dyn Error>> {
        self.send(&json!({"op": "call_service", "id": "settled", "service": "/rosapi/get_time"}))?;
        while !self.read()?.to_text()?.contains("\"settled\"") {}
        Ok(())
    }

    /// Waits until the page's server has handled everything that was sent before. `number`: of this call.
    pub(crate) fn wait_until_page_handled(&mut self, number: u64) -> Result<(), Box<dyn Error>> {
        let id = number as u32;
        self.0.get_ref().set_read_timeout(Some(READ_TIMEOUT))?;
        for _ in 0..MAX_PINGS {
            // A server that has many answers to give to one client leaves some out; what else it sends is no answer.
            self.send(&json!({"type": "ping", "id": id}))?;
            let sent_at = Instant::now();
            while sent_at.elapsed() < READ_TIMEOUT {
                match self.read() {
                    Ok(Message::Text(text)) => {
                        let message: Json = serde_json::from_str(&text)?;
                        if message["type"] == "pong" && message["id"] == id {
                            return Ok(());
                        }
                    }
                    Ok(_) => {}
                    Err(tungstenite::Error::Io(error)) if is_timeout(&error) => {}
                    Err(error) => return Err(error.into()),
                }
            }
        }
        Err("the page's server does not answer".into())
    }

    /// Ends the connection as the protocol has it.
    pub(crate) fn close(&mut self) -> Result<(), tungstenite::Error> {
        self.0.close(None)?;
        self.flush()
    }
}

type Arrivals = Vec<(usize, Instant)>;

/// Reads messages that contain `mark` in a thread of its own, until the run has `ended` and nothing comes: the
/// number of each, and when it came. The number is the first one behind the mark, or behind `"seq":`.
pub(super) fn spawn_reader(
    mut link: WebSocketClient,
    mark: &'static str,
    ended: &Arc<AtomicBool>,
) -> JoinHandle<Arrivals> {
    let ended = Arc::clone(ended);
    std::thread::spawn(move || {
        let mut arrivals = Vec::new();
        if link.0.get_ref().set_read_timeout(Some(READ_TIMEOUT)).is_err() {
            return arrivals;
        }
        loop {
            match link.read() {
                Ok(Message::Text(text)) => {
                    let now = Instant::now();
                    if let Some(number) = number_in(&text, mark) {
                        arrivals.push((number, now));
                    }
                }
                Ok(_) => {}
                Err(tungstenite::Error::Io(error))
                    if is_timeout(&error) && !ended.load(Ordering::Relaxed) => {}
                Err(_) => return arrivals,
            }
        }
    })
}

fn is_timeout(error: &std::io::Error) -> bool {
    matches!(error.kind(), std::io::ErrorKind::WouldBlock | std::io::ErrorKind::TimedOut)
}

fn number_in(text: &str, mark: &str) -> Option<usize> {
    let after = &text[text.find(mark)? + mark.len()..];
    let digits = match after.strip_prefix(|c: char| c.is_ascii_digit()) {
        Some(_) => after,
        // rosbridge numbers frames from one.
        None => &after[after.find("\"seq\":")? + 6..],
    };
    let end = digits.find(|c: char| !c.is_ascii_digit()).unwrap_or(digits.len());
    let number: usize = digits[..end].parse().ok()?;
    if std::ptr::eq(digits, after) { Some(number) } else { number.checked_sub(1) }
}

/// How late messages arrived at all clients together.
pub(crate) struct MessageLatencies {
    /// Milliseconds from publishing to arrival, of those that arrived.
    pub(super) ms: Vec<f64>,
    /// How many should have.
    pub(super) expected: usize,
}

impl MessageLatencies {
    /// Ends the run and gathers what the readers saw of the messages `sent` at those instants.
    pub(super) fn collect(
        readers: Vec<JoinHandle<Arrivals>>,
        sent: &[Instant],
        ended: &AtomicBool,
    ) -> Result<Self, Box<dyn Error>> {
        super::stop_readers(ended);
        let expected = sent.len() * readers.len();
        let mut ms = Vec::with_capacity(expected);
        for reader in readers {
            let arrivals = reader.join().map_err(|_| "a reading client panicked")?;
            let lateness = arrivals.iter().filter_map(|(number, at)| {
                Some(at.saturating_duration_since(*sent.get(*number)?).as_secs_f64() * 1e3)
            });
            ms.extend(lateness);
        }
        Ok(MessageLatencies { ms, expected })
    }

    /// Messages that did not arrive.
    pub(super) fn lost(&self) -> usize {
        self.expected.saturating_sub(self.ms.len())
    }
}

/// Processor time of this process's threads of that name, seconds.
pub(super) fn cpu_of_threads(name: &str) -> Result<f64, Box<dyn Error>> {
    let mut total = 0.0;
    for entry in std::fs::read_dir("/proc/self/task")? {
        let task = entry?.path();
        // A thread may end between the listing and the reading.
        let Ok(comm) = std::fs::read_to_string(task.join("comm")) else { continue };
        if comm.trim_end() == name {
            total += cpu(&task.join("schedstat"))?;
        }
    }
    Ok(total)
}

/// Processor time of all threads of this process that are still there, seconds.
pub(crate) fn cpu_of_all_threads() -> Result<f64, Box<dyn Error>> {
    let mut total = 0.0;
    for entry in std::fs::read_dir("/proc/self/task")? {
        // A thread may end between the listing and the reading.
        total += cpu(&entry?.path().join("schedstat")).unwrap_or(0.0);
    }
    Ok(total)
}

/// Processor time of the calling thread, seconds.
pub(super) fn cpu_of_this_thread() -> Result<f64, Box<dyn Error>> {
    cpu("/proc/thread-self/schedstat".as_ref())
}

/// The first number of `schedstat`: nanoseconds on a processor.
fn cpu(path: &std::path::Path) -> Result<f64, Box<dyn Error>> {
    let text = std::fs::read_to_string(path).map_err(|error| format!("{}: {error}", path.display()))?;
    let nanoseconds: u64 = text.split_whitespace().next().unwrap_or_default().parse()?;
    Ok(nanoseconds as f64 * 1e-9)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_number_of_a_message_is_found_behind_its_mark() {
        assert_eq!(number_in(r#"{"type":"frame","time":42,"method":"D"}"#, "\"time\":"), Some(42));
        assert_eq!(number_in(r#"{"msg":{"data":"00000107 xx"}}"#, "\"data\":\""), Some(107));
        let states = r#"{"topic":"/wrapped_joint_states","msg":{"header":{"seq":7,"stamp":{"secs":3}}}}"#;
        assert_eq!(number_in(states, "wrapped_joint_states"), Some(6));
        assert_eq!(number_in(r#"{"topic":"/mode","msg":{"data":3}}"#, "wrapped_joint_states"), None);
    }

    #[test]
    fn processor_time_of_this_thread_grows_with_work() {
        let before = cpu_of_this_thread().unwrap();
        let mut sum = 0u64;
        while cpu_of_this_thread().unwrap() <= before {
            sum = std::hint::black_box(sum + 1);
        }
        assert!(cpu_of_threads("no such thread").unwrap() == 0.0);
    }
}
