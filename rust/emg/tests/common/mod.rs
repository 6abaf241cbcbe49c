//! A small stream for tests.

use proact_emg::{EmgConfig, WindowLength};
use proact_types::{Command, EmgSample};

/// Of the test streams.
pub const CHANNELS: usize = 3;

/// Windows of 20 samples at 200 Hz.
pub fn config() -> EmgConfig {
    EmgConfig {
        rate_hz: 200.0,
        channels: CHANNELS,
        window: WindowLength::Samples(20),
        increment: WindowLength::Samples(10),
        ..EmgConfig::default()
    }
}

/// A noise-like signal of which every gesture has its own amplitudes; `mix` varies it.
pub fn signal(gesture: Command, count: u64, mix: f64) -> Vec<EmgSample> {
    let value = |k: u64, c: usize| {
        let phase = (k * (c as u64 * 2 + 3)) as f64 * (1.1 + mix) + (k * k % 97) as f64;
        phase.sin() * (1.0 + ((gesture.index() * (c + 1)) % 5) as f64 * 4.0) + 0.3 * (phase * 1.7).cos()
    };
    (0..count)
        .map(|counter| EmgSample { counter, channels: (0..CHANNELS).map(|c| value(counter, c)).collect() })
        .collect()
}
