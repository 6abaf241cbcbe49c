//! Lab streaming layer: streams of other programs as a source, ours published. Needs the feature `lsl`.

#[cfg(not(feature = "lsl"))]
use proact_devices::{AmplifierLayout, DeviceError, SourceInfo};
use proact_devices::{EmgPacket, gforce::CodeSource, random_stream};
use proact_types::EmgSample;
#[cfg(not(feature = "lsl"))]
use proact_types::Gesture;
use rand::RngExt;
use std::{
    error::Error,
    sync::atomic::{AtomicBool, Ordering},
    time::{Duration, Instant},
};

/// What `--lsl NAME` publishes.
#[cfg(feature = "lsl")]
pub use proact_devices::LslOutlet as LslStreamOutlet;

/// Without the feature there is never one.
#[cfg(not(feature = "lsl"))]
pub enum LslStreamOutlet {}

#[cfg(not(feature = "lsl"))]
impl LslStreamOutlet {
    /// Never opens anything.
    ///
    /// # Errors
    /// A program built without the feature.
    pub fn open(
        _name: &str,
        _info: &SourceInfo,
        _layout: Option<&AmplifierLayout>,
    ) -> Result<LslStreamOutlet, Box<dyn Error>> {
        Err(proact_devices::NO_LSL.into())
    }

    /// Publishes samples.
    ///
    /// # Errors
    /// Never.
    pub fn packet(&mut self, _packet: &EmgPacket) -> Result<(), DeviceError> {
        match *self {}
    }

    /// Publishes a decision.
    ///
    /// # Errors
    /// Never.
    pub fn decision(&mut self, _gesture: Gesture, _counter: Option<u64>) -> Result<(), DeviceError> {
        match *self {}
    }
}

/// Publishes simulated samples in packets of 16 by the clock until told to stop; the share `loss` of packets is lost.
///
/// # Errors
/// A share that is none, or liblsl refuses a packet.
pub fn serve_simulated(
    published: &mut LslStreamOutlet,
    codes: &mut CodeSource,
    rate_hz: f64,
    (loss, seed): (f64, u64),
    stop: &AtomicBool,
) -> Result<(), Box<dyn Error>> {
    const PACKET_SAMPLES: u64 = 16;
    if !(0.0..=1.0).contains(&loss) {
        return Err(format!("--loss-rate is {loss}, expected a share from 0 to 1").into());
    }
    let mut faults = random_stream(seed, "emg/simulate/lsl");
    let mut packet = EmgPacket::default();
    let begin = Instant::now();
    let mut counter = 0;
    while !stop.load(Ordering::Relaxed) {
        packet.samples.clear();
        packet.samples.extend(
            (counter..counter + PACKET_SAMPLES).map(|counter| EmgSample { counter, channels: codes() }),
        );
        counter += PACKET_SAMPLES;
        let due = Duration::from_secs_f64(counter as f64 / rate_hz);
        std::thread::sleep(due.saturating_sub(begin.elapsed()));
        if faults.random::<f64>() >= loss {
            published.packet(&packet)?;
        }
    }
    Ok(())
}
