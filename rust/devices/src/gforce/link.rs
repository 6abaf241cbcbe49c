//! What carries the protocol: a radio, or a socket to the simulator.

use super::{protocol::Characteristic, simulator::PROMPT_OPCODE};
use proact_types::Gesture;
use std::{
    io::{self, Read, Write},
    net::TcpStream,
    os::unix::net::UnixStream,
    time::{Duration, Instant},
};

/// Why a link failed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LinkError {
    /// The other side is gone.
    #[error("the armband closed the connection")]
    Closed,
    /// The socket failed.
    #[error("the connection failed: {0}")]
    Io(#[from] io::Error),
    /// Bytes on the socket that are no frame.
    #[error("the other side sends no frames: characteristic {0}, expected 1 to 9; is it a ProACT simulator?")]
    NotFramed(u8),
    /// No armband is in reach, or no radio, or another trouble with it.
    #[error("{0}")]
    Radio(String),
}

/// A connection to an armband whose notifications are switched on.
pub trait GattLink: Send {
    /// Writes to a characteristic. Commands fit into one write: the longest has seven bytes.
    ///
    /// # Errors
    /// The link is lost.
    fn write(&mut self, characteristic: Characteristic, bytes: &[u8]) -> Result<(), LinkError>;

    /// Waits at most `timeout` for the next notification, and puts its bytes in place of those in `bytes`. None if
    /// nothing came.
    ///
    /// # Errors
    /// The link is lost.
    fn next_notification(
        &mut self,
        timeout: Duration,
        bytes: &mut Vec<u8>,
    ) -> Result<Option<Characteristic>, LinkError>;

    /// Reads a characteristic that is no stream; none if the armband does not tell within `timeout`. Notifications that come
    /// meanwhile are lost.
    ///
    /// # Errors
    /// The link is lost.
    fn read(
        &mut self,
        characteristic: Characteristic,
        timeout: Duration,
    ) -> Result<Option<Vec<u8>>, LinkError> {
        // On a socket an empty write asks for it.
        self.write(characteristic, &[])?;
        let deadline = Instant::now() + timeout;
        let mut bytes = Vec::new();
        loop {
            let left = deadline.saturating_duration_since(Instant::now());
            if self.next_notification(left, &mut bytes)? == Some(characteristic) {
                return Ok(Some(bytes));
            }
            if left.is_zero() {
                return Ok(None);
            }
        }
    }

    /// Tells the simulator's person what is asked for; a radio carries no such thing.
    ///
    /// # Errors
    /// The link is lost.
    fn prompt(&mut self, _gesture: Gesture) -> Result<(), LinkError> {
        Ok(())
    }
}

/// Makes links, again after each loss.
pub trait GattConnector: Send {
    /// Finds the armband and connects.
    ///
    /// # Errors
    /// It cannot be found, or does not answer.
    fn connect(&mut self) -> Result<Box<dyn GattLink>, LinkError>;

    /// For display.
    fn name(&self) -> String;
}

/// Longest frame: more than any notification can hold.
const MAX_FRAME_BYTES: usize = 1024;

/// Sockets that frames can run over.
pub trait FrameSocket: Read + Write + Send {
    /// See [`TcpStream::set_read_timeout`].
    ///
    /// # Errors
    /// Those of the socket.
    fn set_read_timeout(&self, timeout: Option<Duration>) -> io::Result<()>;
}

impl FrameSocket for TcpStream {
    fn set_read_timeout(&self, timeout: Option<Duration>) -> io::Result<()> {
        TcpStream::set_read_timeout(self, timeout)
    }
}

impl FrameSocket for UnixStream {
    fn set_read_timeout(&self, timeout: Option<Duration>) -> io::Result<()> {
        UnixStream::set_read_timeout(self, timeout)
    }
}

/// A link over a socket: each frame is the number of the characteristic (1 command, 2 data, 3 to 6 EMG of a Myo, 7
/// firmware, 8 battery), the number of bytes as two bytes,
/// little endian, and the bytes. Both sides speak the same.
#[derive(Debug)]
pub struct SocketLink<S> {
    socket: S,
    buffer: Vec<u8>,
    /// Bytes of the buffer already read out.
    consumed: usize,
}

impl<S: FrameSocket> SocketLink<S> {
    /// A link over a connected socket.
    pub fn new(socket: S) -> SocketLink<S> {
        SocketLink { socket, buffer: Vec::with_capacity(4 * MAX_FRAME_BYTES), consumed: 0 }
    }

    /// The frame at the front of the buffer.
    fn take_frame(&mut self, bytes: &mut Vec<u8>) -> Result<Option<Characteristic>, LinkError> {
        let &[kind, l0, l1, ref rest @ ..] = &self.buffer[self.consumed..] else { return Ok(None) };
        let characteristic = Characteristic::from_frame_number(kind).ok_or(LinkError::NotFramed(kind))?;
        let length = usize::from(u16::from_le_bytes([l0, l1]));
        if length > MAX_FRAME_BYTES {
            return Err(LinkError::NotFramed(kind));
        }
        let Some(frame) = rest.get(..length) else { return Ok(None) };
        bytes.clear();
        bytes.extend_from_slice(frame);
        self.consumed += 3 + length;
        if self.consumed == self.buffer.len() {
            self.buffer.clear();
            self.consumed = 0;
        }
        Ok(Some(characteristic))
    }
}

impl SocketLink<TcpStream> {
    /// Connects to a simulator.
    ///
    /// # Errors
    /// Nobody listens there.
    pub fn connect(address: &str) -> Result<SocketLink<TcpStream>, LinkError> {
        let socket = TcpStream::connect(address)
            .map_err(|e| LinkError::Radio(format!("nothing answers at {address}: {e}")))?;
        // Packets are small and must not wait for each other.
        socket.set_nodelay(true)?;
        Ok(SocketLink::new(socket))
    }
}

impl<S: FrameSocket> GattLink for SocketLink<S> {
    fn write(&mut self, characteristic: Characteristic, bytes: &[u8]) -> Result<(), LinkError> {
        let Ok(length) = u16::try_from(bytes.len()) else {
            return Err(LinkError::Io(io::Error::new(io::ErrorKind::InvalidInput, "a frame of over 64 kB")));
        };
        let kind = characteristic.frame_number();
        let [l0, l1] = length.to_le_bytes();
        let frame = [&[kind, l0, l1], bytes].concat();
        self.socket.write_all(&frame).map_err(link_error)
    }

    fn prompt(&mut self, gesture: Gesture) -> Result<(), LinkError> {
        self.write(Characteristic::Command, &[&[PROMPT_OPCODE], gesture.as_str().as_bytes()].concat())
    }

    fn next_notification(
        &mut self,
        timeout: Duration,
        bytes: &mut Vec<u8>,
    ) -> Result<Option<Characteristic>, LinkError> {
        let begin = Instant::now();
        loop {
            if let Some(characteristic) = self.take_frame(bytes)? {
                return Ok(Some(characteristic));
            }
            let left = timeout.saturating_sub(begin.elapsed());
            // Sockets know no wait of zero; a microsecond is as good.
            self.socket.set_read_timeout(Some(left.max(Duration::from_micros(1))))?;
            self.buffer.drain(..self.consumed);
            self.consumed = 0;
            let mut chunk = [0; MAX_FRAME_BYTES];
            match self.socket.read(&mut chunk) {
                Ok(0) => return Err(LinkError::Closed),
                Ok(count) => self.buffer.extend_from_slice(&chunk[..count]),
                Err(e) if matches!(e.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut) => {
                    if timeout <= begin.elapsed() {
                        return Ok(None);
                    }
                }
                Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
                Err(e) => return Err(link_error(e)),
            }
        }
    }
}

/// A connection that the other side cut is a common end, not a failure of this side.
fn link_error(error: io::Error) -> LinkError {
    match error.kind() {
        io::ErrorKind::BrokenPipe | io::ErrorKind::ConnectionReset | io::ErrorKind::ConnectionAborted => {
            LinkError::Closed
        }
        _ => LinkError::Io(error),
    }
}

/// Connects to a simulator over TCP.
#[derive(Clone, Debug)]
pub struct TcpConnector {
    address: String,
}

impl TcpConnector {
    /// `address` as `127.0.0.1:7410`.
    pub fn new(address: impl Into<String>) -> TcpConnector {
        TcpConnector { address: address.into() }
    }
}

impl GattConnector for TcpConnector {
    fn connect(&mut self) -> Result<Box<dyn GattLink>, LinkError> {
        Ok(Box::new(SocketLink::connect(&self.address)?))
    }

    fn name(&self) -> String {
        format!("simulator at {}", self.address)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WAIT: Duration = Duration::from_secs(5);

    fn pair() -> (SocketLink<UnixStream>, UnixStream) {
        let (ours, theirs) = UnixStream::pair().unwrap();
        (SocketLink::new(ours), theirs)
    }

    #[test]
    fn frames_survive_being_cut_and_glued_by_the_socket() {
        let (mut link, mut other) = pair();
        let mut bytes = Vec::new();
        other.write_all(&[1, 2, 0, 0xAA]).unwrap();
        assert_eq!(link.next_notification(Duration::ZERO, &mut bytes).unwrap(), None);
        other.write_all(&[0xBB, 2, 0, 0, 2, 1, 0, 7]).unwrap();
        let mut next = || {
            let characteristic = link.next_notification(WAIT, &mut bytes).unwrap();
            (characteristic, bytes.clone())
        };
        assert_eq!(next(), (Some(Characteristic::Command), vec![0xAA, 0xBB]));
        assert_eq!(next(), (Some(Characteristic::Data), vec![]));
        assert_eq!(next(), (Some(Characteristic::Data), vec![7]));
    }

    #[test]
    fn a_closed_socket_and_bytes_that_are_no_frames_are_errors() {
        let (mut link, mut other) = pair();
        other.write_all(b"HTTP/1.1").unwrap();
        let error = link.next_notification(WAIT, &mut Vec::new()).unwrap_err();
        assert!(error.to_string().contains("characteristic 72"), "{error}");
        let (mut link, other) = pair();
        drop(other);
        let error = link.next_notification(WAIT, &mut Vec::new()).unwrap_err();
        assert!(matches!(error, LinkError::Closed), "{error}");
        assert!(matches!(link.write(Characteristic::Command, &[6]), Err(LinkError::Closed)));
    }
}
