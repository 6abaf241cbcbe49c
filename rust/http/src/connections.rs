//! How many connections there are, how long each may dawdle, and who has to go when there are too many.
//!
//! A connection is a **stranger** until a request of it was let in, and does not count any more once it is a WebSocket: the
//! owner of the router counts those. When there are too many, the stranger that has waited longest is closed, first among
//! those of the newcomer's own address. A browser sends its request within milliseconds, so it comes in however many
//! connections somebody holds half open. Where no stranger is left to close, the newcomer is told so and closed.

use std::{
    collections::BTreeMap,
    io::{Error, ErrorKind, IoSlice, Result},
    net::IpAddr,
    pin::Pin,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
    task::{Context, Poll},
    time::Duration,
};
use tokio::{
    io::{AsyncRead, AsyncWrite, ReadBuf},
    sync::Notify,
    time::{Instant, Sleep, sleep},
};

/// How long a connection may dawdle, and how many there may be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ConnectionLimits {
    /// For a TLS handshake, for the head of a request, and between two requests.
    pub request_timeout: Duration,
    /// A client that takes no byte for so long is dropped.
    pub write_timeout: Duration,
    /// A WebSocket from which nothing comes for so long, not even the answer to a ping, is dropped.
    pub websocket_timeout: Duration,
    /// Most connections that are no WebSockets.
    pub max_connections: usize,
    /// Most strangers of one address among them.
    pub max_unauthorized_per_address: usize,
}

impl Default for ConnectionLimits {
    fn default() -> Self {
        ConnectionLimits {
            request_timeout: Duration::from_secs(10),
            write_timeout: Duration::from_secs(30),
            websocket_timeout: Duration::from_secs(35),
            max_connections: 256,
            // A browser has six, its user perhaps some tabs, and 64 clients may begin at once.
            max_unauthorized_per_address: 128,
        }
    }
}

/// The connections of a server that are no WebSockets.
#[derive(Debug)]
pub(crate) struct ConnectionTable {
    limits: ConnectionLimits,
    open: Mutex<OpenConnections>,
}

#[derive(Debug, Default)]
struct OpenConnections {
    next_number: u64,
    /// By the order in which they came.
    slots: BTreeMap<u64, SlotHolder>,
}

#[derive(Debug)]
struct SlotHolder {
    peer: IpAddr,
    is_unauthorized: bool,
    evicted: Arc<Notify>,
}

impl ConnectionTable {
    pub(crate) fn new(limits: ConnectionLimits) -> Arc<ConnectionTable> {
        Arc::new(ConnectionTable { limits, open: Mutex::default() })
    }

    fn lock(&self) -> MutexGuard<'_, OpenConnections> {
        // No code that holds the lock can panic half way through a change.
        self.open.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A place for a new connection; none if there is none to be had.
    pub(crate) fn acquire_slot(self: &Arc<Self>, peer: IpAddr) -> Option<Arc<ConnectionSlot>> {
        let mut open = self.lock();
        let of_peer = open.slots.values().filter(|held| held.is_unauthorized && held.peer == peer).count();
        let crowded = of_peer >= self.limits.max_unauthorized_per_address;
        if crowded || open.slots.len() >= self.limits.max_connections {
            let oldest = |of_peer: bool| {
                let mut strangers = open.slots.iter().filter(|(_, held)| held.is_unauthorized);
                strangers.find(|(_, held)| !of_peer || held.peer == peer).map(|(&number, _)| number)
            };
            let number = oldest(true).or_else(|| oldest(false))?;
            if let Some(held) = open.slots.remove(&number) {
                held.evicted.notify_one();
            }
        }
        let (number, end) = (open.next_number, Arc::new(Notify::new()));
        open.next_number += 1;
        open.slots.insert(number, SlotHolder { peer, is_unauthorized: true, evicted: Arc::clone(&end) });
        Some(Arc::new(ConnectionSlot { number, evicted: end, connections: Arc::clone(self) }))
    }
}

/// A connection's place, as long as it has one.
#[derive(Debug)]
pub(crate) struct ConnectionSlot {
    number: u64,
    evicted: Arc<Notify>,
    connections: Arc<ConnectionTable>,
}

impl ConnectionSlot {
    /// A request was let in.
    pub(crate) fn mark_authorized(&self) {
        if let Some(held) = self.connections.lock().slots.get_mut(&self.number) {
            held.is_unauthorized = false;
        }
    }

    /// It became a WebSocket, or ended.
    pub(crate) fn release(&self) {
        self.connections.lock().slots.remove(&self.number);
    }

    /// Until another connection needs the place.
    pub(crate) async fn wait_for_eviction(&self) {
        self.evicted.notified().await;
    }
}

impl Drop for ConnectionSlot {
    fn drop(&mut self) {
        self.release();
    }
}

/// A stream that ends with an error when its client takes no byte for too long.
pub(crate) struct WriteTimeoutStream<S> {
    stream: S,
    write_timeout: Duration,
    /// When it is given up; armed while a write waits.
    deadline: Pin<Box<Sleep>>,
    is_write_pending: bool,
}

impl<S> WriteTimeoutStream<S> {
    pub(crate) fn new(stream: S, stall: Duration) -> Self {
        WriteTimeoutStream {
            stream,
            write_timeout: stall,
            deadline: Box::pin(sleep(stall)),
            is_write_pending: false,
        }
    }

    /// Watches over what a write answers.
    fn check_write_deadline<T>(
        &mut self,
        context: &mut Context<'_>,
        written: Poll<Result<T>>,
    ) -> Poll<Result<T>> {
        if written.is_ready() {
            self.is_write_pending = false;
            return written;
        }
        if !self.is_write_pending {
            self.is_write_pending = true;
            self.deadline.as_mut().reset(Instant::now() + self.write_timeout);
        }
        match self.deadline.as_mut().poll(context) {
            Poll::Ready(()) => Poll::Ready(Err(Error::new(ErrorKind::TimedOut, "the client takes no data"))),
            Poll::Pending => Poll::Pending,
        }
    }
}

impl<S: AsyncRead + Unpin> AsyncRead for WriteTimeoutStream<S> {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<Result<()>> {
        Pin::new(&mut self.stream).poll_read(context, buffer)
    }
}

impl<S: AsyncWrite + Unpin> AsyncWrite for WriteTimeoutStream<S> {
    fn poll_write(mut self: Pin<&mut Self>, context: &mut Context<'_>, data: &[u8]) -> Poll<Result<usize>> {
        let written = Pin::new(&mut self.stream).poll_write(context, data);
        self.check_write_deadline(context, written)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        data: &[IoSlice<'_>],
    ) -> Poll<Result<usize>> {
        let written = Pin::new(&mut self.stream).poll_write_vectored(context, data);
        self.check_write_deadline(context, written)
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Result<()>> {
        let flushed = Pin::new(&mut self.stream).poll_flush(context);
        self.check_write_deadline(context, flushed)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Result<()>> {
        let done = Pin::new(&mut self.stream).poll_shutdown(context);
        self.check_write_deadline(context, done)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FLOOD: [u8; 4] = [192, 168, 1, 21];
    const OTHER: [u8; 4] = [192, 168, 1, 22];

    fn connections(all: usize, strangers: usize) -> Arc<ConnectionTable> {
        ConnectionTable::new(ConnectionLimits {
            max_connections: all,
            max_unauthorized_per_address: strangers,
            ..ConnectionLimits::default()
        })
    }

    /// Numbers of the places that are still held.
    fn open_slots(connections: &ConnectionTable) -> Vec<u64> {
        connections.lock().slots.keys().copied().collect()
    }

    #[test]
    fn a_flood_from_one_address_pushes_out_its_own_and_nobody_elses() {
        let connections = connections(10, 4);
        let mut slots = vec![connections.acquire_slot(OTHER.into()).unwrap()];
        slots.extend((0..100).map(|_| connections.acquire_slot(FLOOD.into()).unwrap()));
        assert_eq!(open_slots(&connections), [0, 97, 98, 99, 100]);
    }

    #[test]
    fn the_oldest_stranger_goes_first_and_who_was_let_in_stays() {
        let connections = connections(4, 4);
        let slots: Vec<_> = (0..4).map(|n| connections.acquire_slot([10, 0, 0, n].into()).unwrap()).collect();
        slots[0].mark_authorized();
        slots[3].mark_authorized();
        let newcomer = connections.acquire_slot(OTHER.into()).unwrap();
        assert_eq!(open_slots(&connections), [0, 2, 3, 4]);
        slots[2].mark_authorized();
        newcomer.mark_authorized();
        assert!(connections.acquire_slot(OTHER.into()).is_none(), "all have been let in");
        // A WebSocket needs no place.
        slots[0].release();
        assert!(connections.acquire_slot(OTHER.into()).is_some());
    }
}
