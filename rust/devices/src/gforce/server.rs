use super::{
    link::{FrameSocket, GattLink, LinkError, SocketLink},
    protocol::Characteristic,
    simulator::Notification,
};
use std::{
    io,
    net::TcpListener,
    sync::atomic::{AtomicBool, Ordering},
    time::{Duration, Instant},
};

/// Longest wait in which a wish to stop is not noticed.
const POLL_INTERVAL: Duration = Duration::from_millis(50);

/// The other side of a link: an armband without radio and without clock.
pub trait GattSimulator {
    /// Takes what was written to `characteristic` at `now`; the notifications that answer.
    fn write(&mut self, characteristic: Characteristic, bytes: &[u8], now: Duration) -> Vec<Notification>;

    /// When the next notification of samples is due.
    fn next_due(&self) -> Option<Duration>;

    /// The notifications of samples complete at `now`, with the times at which they are due.
    fn advance(&mut self, now: Duration) -> Vec<Notification>;

    /// The link is gone.
    fn disconnect(&mut self);
}

/// Serves one armband over TCP, one connection after the other as a radio does, until `stop`. `report` is told of
/// connections and their ends.
///
/// # Errors
/// The listener failed.
pub fn serve(
    listener: &TcpListener,
    simulator: &mut impl GattSimulator,
    stop: &AtomicBool,
    mut report: impl FnMut(&str),
) -> io::Result<()> {
    listener.set_nonblocking(true)?;
    while !stop.load(Ordering::Relaxed) {
        match listener.accept() {
            Ok((socket, peer)) => {
                socket.set_nonblocking(false)?;
                socket.set_nodelay(true)?;
                report(&format!("connected: {peer}"));
                let end = serve_connection(&mut SocketLink::new(socket), simulator, stop);
                report(&format!("disconnected: {end}"));
            }
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => std::thread::sleep(POLL_INTERVAL / 5),
            Err(error) => return Err(error),
        }
    }
    Ok(())
}

/// Serves one connection until its end or `stop`; why it ended. Packets leave when they are due by the clock.
pub fn serve_connection<S: FrameSocket>(
    link: &mut SocketLink<S>,
    simulator: &mut impl GattSimulator,
    stop: &AtomicBool,
) -> LinkError {
    let begin = Instant::now();
    let mut waiting: Vec<Notification> = Vec::new();
    let mut bytes = Vec::new();
    let end = loop {
        if stop.load(Ordering::Relaxed) {
            break LinkError::Closed;
        }
        let now = begin.elapsed();
        waiting.extend(simulator.advance(now));
        // Jitter may delay a packet beyond the next; a link keeps the order, so what is behind waits.
        let ready = waiting.iter().take_while(|n| n.due <= now).count();
        let sent: Result<(), LinkError> =
            waiting.drain(..ready).try_for_each(|n| link.write(n.characteristic, &n.bytes));
        if let Err(error) = sent {
            break error;
        }
        let next = waiting.first().map(|n| n.due).into_iter().chain(simulator.next_due()).min();
        let wait = next.map_or(POLL_INTERVAL, |due| due.saturating_sub(begin.elapsed()).min(POLL_INTERVAL));
        match link.next_notification(wait, &mut bytes) {
            Ok(Some(characteristic)) => {
                let replies = simulator.write(characteristic, &bytes, begin.elapsed());
                if let Err(error) = replies.iter().try_for_each(|n| link.write(n.characteristic, &n.bytes)) {
                    break error;
                }
            }
            Ok(None) => {}
            Err(error) => break error,
        }
    };
    simulator.disconnect();
    end
}
