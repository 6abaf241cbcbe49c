//! Whether the other end of a WebSocket still is there.

use crate::Limits;
use std::{
    sync::{Mutex, PoisonError},
    time::{Duration, Instant},
};
use tokio::time;

/// When a client of a WebSocket was heard last. Whoever reads tells of each message; whoever writes pings, and asks.
#[derive(Debug)]
pub struct Pulse {
    limits: Limits,
    heard: Mutex<Instant>,
}

impl Pulse {
    /// Of a client that has just come.
    pub fn new(limits: Limits) -> Pulse {
        Pulse { limits, heard: Mutex::new(Instant::now()) }
    }

    /// Something came, if only the answer to a ping.
    pub fn beat(&self) {
        *self.heard.lock().unwrap_or_else(PoisonError::into_inner) = Instant::now();
    }

    /// Nothing came for longer than is allowed.
    pub fn is_lost(&self) -> bool {
        self.heard.lock().unwrap_or_else(PoisonError::into_inner).elapsed() > self.limits.silence
    }

    /// Ticks when a ping is due. An answer or two may be lost.
    pub fn pings(&self) -> time::Interval {
        let period: Duration = self.limits.silence / 5;
        let mut pings = time::interval_at(time::Instant::now() + period, period);
        pings.set_missed_tick_behavior(time::MissedTickBehavior::Delay);
        pings
    }
}
