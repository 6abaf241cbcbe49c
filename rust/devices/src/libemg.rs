use crate::DeviceError;
use std::{
    io::{self, Read},
    net::{SocketAddr, TcpStream, UdpSocket},
    time::Duration,
};

/// Where LibEMG sends its classes unless told otherwise.
pub const LIBEMG_PORT: u16 = 12346;

/// One message of LibEMG's online classifier as text: `class` or `class velocity`, or with the option
/// `output_format="probabilities"` one probability a class and maybe a velocity; a time stamp may follow each, and an end
/// of line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LibEmgOutput {
    /// What was recognised, by its place in the list of gestures; none if the classifier rejected its own output
    /// (class -1).
    pub class: Option<usize>,
    /// How hard, 0 to 1, if it was sent.
    pub velocity: Option<f64>,
    /// The probability of the class, if all were sent. Their class is the most probable one: LibEMG rejects nothing then.
    pub probability: Option<f64>,
}

/// Seconds since 1970 that nothing but a time stamp has.
const MIN_TIMESTAMP_SECS: f64 = 1e6;
/// Longest text without a whole message in it.
const MAX_MESSAGE_BYTES: usize = 4096;

impl LibEmgOutput {
    /// Reads a message of a classifier of `classes` gestures.
    ///
    /// # Errors
    /// Anything else, with the text.
    pub fn parse(message: &[u8], classes: usize) -> Result<LibEmgOutput, DeviceError> {
        let wrong = || DeviceError::LibEmgMessage {
            most: classes.saturating_sub(1),
            // Long enough to see what it is, short enough for one line.
            text: String::from_utf8_lossy(&message[..message.len().min(40)]).into_owned(),
        };
        let text = std::str::from_utf8(message).map_err(|_| wrong())?;
        let words: Vec<&str> = text.split_whitespace().collect();
        let first = words.first().ok_or_else(wrong)?;
        // Classes are whole numbers, probabilities have two decimals.
        let (class, probability, rest) = if first.contains('.') {
            let numbers: Option<Vec<f64>> =
                words.iter().take(classes).map(|word| word.parse().ok()).collect();
            let all = numbers.filter(|p| p.len() == classes).ok_or_else(wrong)?;
            let sum: f64 = all.iter().sum();
            // Each is rounded by half a hundredth at most.
            let sound = all.iter().all(|p| (0.0..=1.0).contains(p))
                && (sum - 1.0).abs() < 0.01 + 0.005 * classes as f64;
            // Of equals the first, as LibEMG.
            let best = all.iter().enumerate().rev().max_by(|a, b| a.1.total_cmp(b.1)).filter(|_| sound);
            let (class, probability) = best.ok_or_else(wrong)?;
            (Some(class), Some(*probability), &words[classes..])
        } else {
            let class: i64 = first.parse().map_err(|_| wrong())?;
            let class = match usize::try_from(class) {
                Ok(class) if class < classes => Some(class),
                Err(_) if class == -1 => None,
                _ => return Err(wrong()),
            };
            (class, None, &words[1..])
        };
        let numbers: Vec<f64> =
            rest.iter().map(|word| word.parse().map_err(|_| wrong())).collect::<Result<_, _>>()?;
        let velocity = match numbers[..] {
            [] => None,
            [stamp] if stamp > MIN_TIMESTAMP_SECS => None,
            [velocity] => Some(velocity),
            [velocity, stamp] if stamp > MIN_TIMESTAMP_SECS => Some(velocity),
            _ => return Err(wrong()),
        };
        if velocity.is_some_and(|v| !(0.0..=1.0).contains(&v)) {
            return Err(wrong());
        }
        Ok(LibEmgOutput { class, velocity, probability })
    }

    /// The message, as LibEMG 2 writes it: velocity with two decimals.
    pub fn to_message(self) -> String {
        let class = self.class.map_or(-1, |class| class as i64);
        match self.velocity {
            Some(velocity) => format!("{class} {velocity:.2}\n"),
            None => format!("{class}\n"),
        }
    }
}

/// Classes that LibEMG, or a program that speaks as it does, sends over UDP, or over TCP with its option `tcp=True`.
#[derive(Debug)]
pub struct LibEmgReceiver {
    link: LibEmgLink,
    classes: usize,
}

#[derive(Debug)]
enum LibEmgLink {
    Udp(UdpSocket),
    /// What came and is no whole message yet.
    Tcp(TcpStream, Vec<u8>),
}

impl LibEmgReceiver {
    /// Listens on `port` of this machine only, 0 for any that is free, to a classifier of `classes` gestures.
    ///
    /// # Errors
    /// The port is taken.
    pub fn bind(port: u16, classes: usize) -> Result<LibEmgReceiver, DeviceError> {
        let socket = UdpSocket::bind(("127.0.0.1", port));
        let socket =
            socket.map_err(|source| DeviceError::Udp { address: format!("127.0.0.1:{port}"), source })?;
        Ok(LibEmgReceiver { link: LibEmgLink::Udp(socket), classes })
    }

    /// Connects to LibEMG at `address`, which waits there for the one listener that it has.
    ///
    /// # Errors
    /// Nobody waits there.
    pub fn connect(address: &str, classes: usize) -> Result<LibEmgReceiver, DeviceError> {
        let failed = |source| DeviceError::Tcp { address: address.to_owned(), source };
        let stream = TcpStream::connect(address).map_err(failed)?;
        Ok(LibEmgReceiver { link: LibEmgLink::Tcp(stream, Vec::new()), classes })
    }

    /// Where it listens, or to whom.
    ///
    /// # Errors
    /// The system does not say.
    pub fn address(&self) -> io::Result<SocketAddr> {
        match &self.link {
            LibEmgLink::Udp(socket) => socket.local_addr(),
            LibEmgLink::Tcp(stream, _) => stream.peer_addr(),
        }
    }

    /// Waits at most `timeout` for a message. None if none came.
    ///
    /// # Errors
    /// A message that is none of LibEMG's, a socket that fails, or a connection that was closed.
    pub fn poll(&mut self, timeout: Duration) -> Result<Option<LibEmgOutput>, DeviceError> {
        // Sockets know no wait of zero.
        let timeout = Some(timeout.max(Duration::from_micros(1)));
        let waited = |e: &io::Error| matches!(e.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut);
        let classes = self.classes;
        match &mut self.link {
            LibEmgLink::Udp(socket) => {
                let failed = |source| DeviceError::Udp { address: "127.0.0.1".to_owned(), source };
                socket.set_read_timeout(timeout).map_err(failed)?;
                let mut bytes = [0; 1024];
                match socket.recv(&mut bytes) {
                    Ok(count) => LibEmgOutput::parse(&bytes[..count], classes).map(Some),
                    Err(e) if waited(&e) => Ok(None),
                    Err(e) => Err(failed(e)),
                }
            }
            LibEmgLink::Tcp(stream, waiting) => {
                if let Some(message) = take_message(waiting, classes) {
                    return LibEmgOutput::parse(&message, classes).map(Some);
                }
                let failed = |source| DeviceError::Tcp { address: "LibEMG".to_owned(), source };
                stream.set_read_timeout(timeout).map_err(failed)?;
                let mut bytes = [0; 1024];
                match stream.read(&mut bytes) {
                    Ok(0) => return Err(failed(io::ErrorKind::UnexpectedEof.into())),
                    Ok(count) => waiting.extend_from_slice(&bytes[..count]),
                    Err(e) if waited(&e) => return Ok(None),
                    Err(e) => return Err(failed(e)),
                }
                let message = take_message(waiting, classes);
                message.map(|message| LibEmgOutput::parse(&message, classes)).transpose()
            }
        }
    }
}

/// The first message in `waiting`: a line; or, since LibEMG ends probabilities with nothing, what is one as it stands, or
/// up to the probability that follows a time stamp without a space.
fn take_message(waiting: &mut Vec<u8>, classes: usize) -> Option<Vec<u8>> {
    if let Some(end) = waiting.iter().position(|byte| *byte == b'\n') {
        return Some(waiting.drain(..=end).collect());
    }
    if !waiting.contains(&b'.') {
        return None;
    }
    // A time stamp has one point; the second one in a word is that of the next message, after its one digit.
    let mut points = 0;
    let glued = waiting.iter().position(|byte| {
        points = match byte {
            b'.' => points + 1,
            b' ' => 0,
            _ => points,
        };
        points == 2
    });
    let end = match glued {
        Some(point) => point.saturating_sub(1).max(1),
        None if LibEmgOutput::parse(waiting, classes).is_ok() => waiting.len(),
        // Nothing will become of it.
        None if waiting.len() > MAX_MESSAGE_BYTES => waiting.len(),
        None => return None,
    };
    Some(waiting.drain(..end).collect())
}

/// Sends classes as LibEMG does, so that programs written for it can listen to ProACT.
#[derive(Debug)]
pub struct LibEmgSender {
    socket: UdpSocket,
    target: String,
}

impl LibEmgSender {
    /// Sends to `target`, such as `127.0.0.1:12346`.
    ///
    /// # Errors
    /// An address that does not resolve.
    pub fn connect(target: &str) -> Result<LibEmgSender, DeviceError> {
        let failed = |source| DeviceError::Udp { address: target.to_owned(), source };
        let socket = UdpSocket::bind(("0.0.0.0", 0)).map_err(failed)?;
        socket.connect(target).map_err(failed)?;
        Ok(LibEmgSender { socket, target: target.to_owned() })
    }

    /// Sends one output. That nobody listens is no error.
    ///
    /// # Errors
    /// The network is down.
    pub fn send(&mut self, output: LibEmgOutput) -> Result<(), DeviceError> {
        match self.socket.send(output.to_message().as_bytes()) {
            Ok(_) => Ok(()),
            Err(e) if e.kind() == io::ErrorKind::ConnectionRefused => Ok(()),
            Err(source) => Err(DeviceError::Udp { address: self.target.clone(), source }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn messages_of_both_versions_are_read() {
        let read = |text: &str| LibEmgOutput::parse(text.as_bytes(), 5).unwrap();
        let output = |class, velocity| LibEmgOutput { class, velocity, probability: None };
        assert_eq!(read("2"), output(Some(2), None));
        assert_eq!(read("4\n"), output(Some(4), None));
        assert_eq!(read("0 0.55\n"), output(Some(0), Some(0.55)));
        assert_eq!(read("-1 0\n"), output(None, Some(0.0)));
        assert_eq!(read("3 1763899999.25"), output(Some(3), None), "LibEMG 1 stamps its classes");
        assert_eq!(read("3 0.5 1763899999.25"), output(Some(3), Some(0.5)));
        let probable =
            |class, velocity, p| LibEmgOutput { class: Some(class), velocity, probability: Some(p) };
        assert_eq!(read("0.01 0.02 0.90 0.05 0.02 1763899999.25"), probable(2, None, 0.9));
        assert_eq!(read("0.01 0.90 0.02 0.05 0.02 0.37 1763899999.25"), probable(1, Some(0.37), 0.9));
        assert_eq!(read("0.40 0.40 0.10 0.05 0.05"), probable(0, None, 0.4), "of equals the first");
        assert_eq!(output(Some(1), Some(0.5)).to_message(), "1 0.50\n");
        assert_eq!(output(None, None).to_message(), "-1\n");
    }

    #[test]
    fn anything_else_is_refused_with_its_text() {
        for text in [
            "",
            "close",
            "5",
            "-2",
            "1.5",
            "1 x",
            "1 NaN",
            "1 2.0",
            "1 0.5 7",
            "\u{ff}",
            "0.5 0.5",
            "0.9 0.9 0.9 0.9 0.9",
            "0.2 0.2 0.2 0.2 0.2 0.5 7",
            "0.2 0.2 -0.2 0.6 0.2",
        ] {
            let error = LibEmgOutput::parse(text.as_bytes(), 5).unwrap_err().to_string();
            assert!(error.contains("expected \"class\" or \"class velocity\""), "{text:?}: {error}");
        }
        assert!(LibEmgOutput::parse(&[0xFF, 0xFE], 5).is_err());
    }

    #[test]
    fn what_is_sent_is_received() {
        let mut receiver = LibEmgReceiver::bind(0, 5).unwrap();
        let address = receiver.address().unwrap().to_string();
        let mut sender = LibEmgSender::connect(&address).unwrap();
        let output = LibEmgOutput { class: Some(1), velocity: Some(0.25), probability: None };
        sender.send(output).unwrap();
        assert_eq!(receiver.poll(Duration::from_secs(5)).unwrap(), Some(output));
        assert_eq!(receiver.poll(Duration::ZERO).unwrap(), None);
        assert!(LibEmgReceiver::bind(receiver.address().unwrap().port(), 5).is_err(), "the port is taken");
    }

    #[test]
    fn messages_over_tcp_come_one_by_one_however_they_are_cut() {
        let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap().to_string();
        let mut receiver = LibEmgReceiver::connect(&address, 2).unwrap();
        let (mut libemg, _) = listener.accept().unwrap();
        let mut all = |texts: &[&str], expected: usize| -> Vec<(Option<usize>, Option<f64>)> {
            texts.iter().for_each(|text| std::io::Write::write_all(&mut libemg, text.as_bytes()).unwrap());
            let mut got = Vec::new();
            while got.len() < expected {
                got.extend(receiver.poll(Duration::from_secs(5)).unwrap().map(|o| (o.class, o.probability)));
            }
            assert_eq!(receiver.poll(Duration::ZERO).unwrap(), None);
            got
        };
        assert_eq!(all(&["1\n0 0.5", "0\n-1", "\n"], 3), [(Some(1), None), (Some(0), None), (None, None)]);
        // Probabilities have no end: the time stamp runs into the next message.
        let glued = "0.25 0.75 1763899999.250.90 0.10 1763899999.31.00 0.00 1763899999.35";
        let expected = [(Some(1), Some(0.75)), (Some(0), Some(0.9)), (Some(0), Some(1.0))];
        assert_eq!(all(&[glued], 3), expected);
        drop(libemg);
        assert!(receiver.poll(Duration::from_secs(5)).is_err(), "the other end is gone");
    }

    proptest! {
        #[test]
        fn no_bytes_make_it_panic(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
            let _ = LibEmgOutput::parse(&bytes, 5);
            let mut waiting = bytes.clone();
            while take_message(&mut waiting, 5).is_some_and(|message| !message.is_empty()) {}
        }
    }
}
