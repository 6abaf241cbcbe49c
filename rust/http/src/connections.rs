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
pub struct Limits {
    /// For a TLS handshake, for the head of a request, and between two requests.
    pub request: Duration,
    /// A client that takes no byte for so long is dropped.
    pub stall: Duration,
    /// A WebSocket from which nothing comes for so long, not even the answer to a ping, is dropped.
    pub silence: Duration,
    /// Most connections that are no WebSockets.
    pub connections: usize,
    /// Most strangers of one address among them.
    pub strangers: usize,
}

impl Default for Limits {
    fn default() -> Self {
        Limits {
            request: Duration::from_secs(10),
            stall: Duration::from_secs(30),
            silence: Duration::from_secs(35),
            connections: 256,
            // A browser has six, its user perhaps some tabs, and 64 clients may begin at once.
            strangers: 128,
        }
    }
}

/// The connections of a server that are no WebSockets.
#[derive(Debug)]
pub(crate) struct Connections {
    limits: Limits,
    open: Mutex<Open>,
}

#[derive(Debug, Default)]
struct Open {
    next: u64,
    /// By the order in which they came.
    places: BTreeMap<u64, Held>,
}

#[derive(Debug)]
struct Held {
    peer: IpAddr,
    stranger: bool,
    end: Arc<Notify>,
}

impl Connections {
    pub(crate) fn new(limits: Limits) -> Arc<Connections> {
        Arc::new(Connections { limits, open: Mutex::default() })
    }

    fn lock(&self) -> MutexGuard<'_, Open> {
        // No code that holds the lock can panic half way through a change.
        self.open.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A place for a new connection; none if there is none to be had.
    pub(crate) fn enter(self: &Arc<Self>, peer: IpAddr) -> Option<Arc<Place>> {
        let mut open = self.lock();
        let of_peer = open.places.values().filter(|held| held.stranger && held.peer == peer).count();
        let crowded = of_peer >= self.limits.strangers;
        if crowded || open.places.len() >= self.limits.connections {
            let oldest = |of_peer: bool| {
                let mut strangers = open.places.iter().filter(|(_, held)| held.stranger);
                strangers.find(|(_, held)| !of_peer || held.peer == peer).map(|(&number, _)| number)
            };
            let number = oldest(true).or_else(|| oldest(false))?;
            if let Some(held) = open.places.remove(&number) {
                held.end.notify_one();
            }
        }
        let (number, end) = (open.next, Arc::new(Notify::new()));
        open.next += 1;
        open.places.insert(number, Held { peer, stranger: true, end: Arc::clone(&end) });
        Some(Arc::new(Place { number, end, connections: Arc::clone(self) }))
    }
}

/// A connection's place, as long as it has one.
#[derive(Debug)]
pub(crate) struct Place {
    number: u64,
    end: Arc<Notify>,
    connections: Arc<Connections>,
}

impl Place {
    /// A request was let in.
    pub(crate) fn is_welcome(&self) {
        if let Some(held) = self.connections.lock().places.get_mut(&self.number) {
            held.stranger = false;
        }
    }

    /// It became a WebSocket, or ended.
    pub(crate) fn leave(&self) {
        self.connections.lock().places.remove(&self.number);
    }

    /// Until another connection needs the place.
    pub(crate) async fn lost(&self) {
        self.end.notified().await;
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        self.leave();
    }
}

/// A stream that ends with an error when its client takes no byte for too long.
pub(crate) struct Unstalled<S> {
    stream: S,
    stall: Duration,
    /// When it is given up; armed while a write waits.
    deadline: Pin<Box<Sleep>>,
    waiting: bool,
}

impl<S> Unstalled<S> {
    pub(crate) fn new(stream: S, stall: Duration) -> Self {
        Unstalled { stream, stall, deadline: Box::pin(sleep(stall)), waiting: false }
    }

    /// Watches over what a write answers.
    fn watch<T>(&mut self, context: &mut Context<'_>, written: Poll<Result<T>>) -> Poll<Result<T>> {
        if written.is_ready() {
            self.waiting = false;
            return written;
        }
        if !self.waiting {
            self.waiting = true;
            self.deadline.as_mut().reset(Instant::now() + self.stall);
        }
        match self.deadline.as_mut().poll(context) {
            Poll::Ready(()) => Poll::Ready(Err(Error::new(ErrorKind::TimedOut, "the client takes no data"))),
            Poll::Pending => Poll::Pending,
        }
    }
}

impl<S: AsyncRead + Unpin> AsyncRead for Unstalled<S> {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<Result<()>> {
        Pin::new(&mut self.stream).poll_read(context, buffer)
    }
}

impl<S: AsyncWrite + Unpin> AsyncWrite for Unstalled<S> {
    fn poll_write(mut self: Pin<&mut Self>, context: &mut Context<'_>, data: &[u8]) -> Poll<Result<usize>> {
        let written = Pin::new(&mut self.stream).poll_write(context, data);
        self.watch(context, written)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        data: &[IoSlice<'_>],
    ) -> Poll<Result<usize>> {
        let written = Pin::new(&mut self.stream).poll_write_vectored(context, data);
        self.watch(context, written)
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Result<()>> {
        let flushed = Pin::new(&mut self.stream).poll_flush(context);
        self.watch(context, flushed)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Result<()>> {
        let done = Pin::new(&mut self.stream).poll_shutdown(context);
        self.watch(context, done)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FLOOD: [u8; 4] = [192, 168, 1, 21];
    const OTHER: [u8; 4] = [192, 168, 1, 22];

    fn connections(all: usize, strangers: usize) -> Arc<Connections> {
        Connections::new(Limits { connections: all, strangers, ..Limits::default() })
    }

    /// Numbers of the places that are still held.
    fn held(connections: &Connections) -> Vec<u64> {
        connections.lock().places.keys().copied().collect()
    }

    #[test]
    fn a_flood_from_one_address_pushes_out_its_own_and_nobody_elses() {
        let connections = connections(10, 4);
        let mut places = vec![connections.enter(OTHER.into()).unwrap()];
        places.extend((0..100).map(|_| connections.enter(FLOOD.into()).unwrap()));
        assert_eq!(held(&connections), [0, 97, 98, 99, 100]);
    }

    #[test]
    fn the_oldest_stranger_goes_first_and_who_was_let_in_stays() {
        let connections = connections(4, 4);
        let places: Vec<_> = (0..4).map(|n| connections.enter([10, 0, 0, n].into()).unwrap()).collect();
        places[0].is_welcome();
        places[3].is_welcome();
        let newcomer = connections.enter(OTHER.into()).unwrap();
        assert_eq!(held(&connections), [0, 2, 3, 4]);
        places[2].is_welcome();
        newcomer.is_welcome();
        assert!(connections.enter(OTHER.into()).is_none(), "all have been let in");
        // A WebSocket needs no place.
        places[0].leave();
        assert!(connections.enter(OTHER.into()).is_some());
    }
}
