use crate::DeviceError;
use std::{
    io,
    net::{SocketAddr, UdpSocket},
    time::Duration,
};

/// Where LibEMG sends its classes unless told otherwise.
pub const LIBEMG_PORT: u16 = 12346;

/// One message of LibEMG's online classifier: `class` or `class velocity`, as text, with or without an end of line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LibEmgOutput {
    /// What was recognised, by its place in the list of gestures; none if the classifier rejected its own output
    /// (class -1).
    pub class: Option<usize>,
    /// How hard, 0 to 1, if it was sent.
    pub velocity: Option<f64>,
}

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
        let mut words = text.split_whitespace();
        let class: i64 = words.next().and_then(|word| word.parse().ok()).ok_or_else(wrong)?;
        let velocity: Option<f64> = words.next().map(|w| w.parse().map_err(|_| wrong())).transpose()?;
        if words.next().is_some() || velocity.is_some_and(|v| !(0.0..=1.0).contains(&v)) {
            return Err(wrong());
        }
        let class = match usize::try_from(class) {
            Ok(class) if class < classes => Some(class),
            Ok(_) => return Err(wrong()),
            Err(_) if class == -1 => None,
            Err(_) => return Err(wrong()),
        };
        Ok(LibEmgOutput { class, velocity })
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

/// Classes that LibEMG, or a program that speaks as it does, sends over UDP.
#[derive(Debug)]
pub struct LibEmgReceiver {
    socket: UdpSocket,
    classes: usize,
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
        Ok(LibEmgReceiver { socket, classes })
    }

    /// Where it listens.
    ///
    /// # Errors
    /// The system does not say.
    pub fn address(&self) -> io::Result<SocketAddr> {
        self.socket.local_addr()
    }

    /// Waits at most `timeout` for a message. None if none came.
    ///
    /// # Errors
    /// A message that is none of LibEMG's, or a socket that fails.
    pub fn poll(&mut self, timeout: Duration) -> Result<Option<LibEmgOutput>, DeviceError> {
        let failed = |source| DeviceError::Udp { address: "127.0.0.1".to_owned(), source };
        // Sockets know no wait of zero.
        self.socket.set_read_timeout(Some(timeout.max(Duration::from_micros(1)))).map_err(failed)?;
        let mut bytes = [0; 256];
        match self.socket.recv(&mut bytes) {
            Ok(count) => LibEmgOutput::parse(&bytes[..count], self.classes).map(Some),
            Err(e) if matches!(e.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut) => Ok(None),
            Err(e) => Err(failed(e)),
        }
    }
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
        let output = |class, velocity| LibEmgOutput { class, velocity };
        assert_eq!(read("2"), output(Some(2), None));
        assert_eq!(read("4\n"), output(Some(4), None));
        assert_eq!(read("0 0.55\n"), output(Some(0), Some(0.55)));
        assert_eq!(read("-1 0\n"), output(None, Some(0.0)));
        assert_eq!(output(Some(1), Some(0.5)).to_message(), "1 0.50\n");
        assert_eq!(output(None, None).to_message(), "-1\n");
    }

    #[test]
    fn anything_else_is_refused_with_its_text() {
        for text in ["", "close", "5", "-2", "1.5", "1 x", "1 NaN", "1 2.0", "1 0.5 7", "\u{ff}"] {
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
        let output = LibEmgOutput { class: Some(1), velocity: Some(0.25) };
        sender.send(output).unwrap();
        assert_eq!(receiver.poll(Duration::from_secs(5)).unwrap(), Some(output));
        assert_eq!(receiver.poll(Duration::ZERO).unwrap(), None);
        assert!(LibEmgReceiver::bind(receiver.address().unwrap().port(), 5).is_err(), "the port is taken");
    }

    proptest! {
        #[test]
        fn no_bytes_make_it_panic(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
            let _ = LibEmgOutput::parse(&bytes, 5);
        }
    }
}
