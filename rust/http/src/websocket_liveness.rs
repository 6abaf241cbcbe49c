//! Whether the other end of a WebSocket still is there.

use crate::ConnectionLimits;
use std::{
    sync::{Mutex, PoisonError},
    time::{Duration, Instant},
};
use tokio::time;

/// When a client of a WebSocket was heard last. Whoever reads tells of each message; whoever writes pings, and asks.
#[derive(Debug)]
pub struct WebSocketLiveness {
    limits: ConnectionLimits,
    last_received: Mutex<Instant>,
}

impl WebSocketLiveness {
    /// Of a client that has just come.
    pub fn new(limits: ConnectionLimits) -> WebSocketLiveness {
        WebSocketLiveness { limits, last_received: Mutex::new(Instant::now()) }
    }

    /// Something came, if only the answer to a ping.
    pub fn record_received(&self) {
        *self.last_received.lock().unwrap_or_else(PoisonError::into_inner) = Instant::now();
    }

    /// Nothing came for longer than is allowed.
    pub fn is_timed_out(&self) -> bool {
        self.last_received.lock().unwrap_or_else(PoisonError::into_inner).elapsed()
            > self.limits.websocket_timeout
    }

    /// Ticks when a ping is due. An answer or two may be lost.
    pub fn ping_interval(&self) -> time::Interval {
        let period: Duration = self.limits.websocket_timeout / 5;
        let mut pings = time::interval_at(time::Instant::now() + period, period);
        pings.set_missed_tick_behavior(time::MissedTickBehavior::Delay);
        pings
    }
}
