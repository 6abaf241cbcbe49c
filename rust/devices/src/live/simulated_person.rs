use super::{EmgPacket, Pacing, SampleSource, SourceCounts, SourceEvent, SourceInfo};
use crate::{DeviceError, EmgFeed, EmgOrigin, SimulatedImu, prepare_emg};
use proact_emg::{ImuChannel, RecordingFault};
use proact_types::{Command, Gesture, SimTime};
use std::{
    io::Read,
    sync::mpsc::{Receiver, channel},
    time::{Duration, Instant},
};

/// From one value of the inertial measurement unit to the next, ms: 50 a second.
const IMU_MILLIS: u64 = 20;
/// Length of a packet, as long as the armband's.
const PACKET_MILLIS: u64 = 16;

/// A simulated person with an armband: makes the gesture that is prompted, some time after the prompt, out of
/// recordings or synthetic EMG. Signed samples about zero. Deterministic when played flat out.
///
/// Known weakness: nobody tires, and the band stays where it is.
#[derive(Clone, Debug)]
pub struct SimulatedPersonSource {
    info: SourceInfo,
    feed: EmgFeed,
    /// With its newest values.
    imu: Option<(SimulatedImu, [f64; 10])>,
    pacing: Pacing,
    reaction_time: Duration,
    /// Milliseconds made so far.
    tick_ms: u64,
    intended: Gesture,
    /// Follows at this tick.
    scheduled_gesture: Option<(u64, Gesture)>,
    opened: Instant,
    packets: u64,
    findings: Vec<RecordingFault>,
}

impl SimulatedPersonSource {
    /// A person at rest, whose muscles are `source`: the repetitions to feed of a recording, or the generator. Prompts
    /// take effect after `reaction`.
    ///
    /// # Errors
    /// As [`prepare_emg`].
    pub fn new(
        source: &EmgOrigin,
        pacing: Pacing,
        reaction: Duration,
        seed: u64,
    ) -> Result<SimulatedPersonSource, DeviceError> {
        let setup = prepare_emg(source, seed)?;
        let rate_hz = setup.feed.rate_hz();
        let packet_samples = (rate_hz * PACKET_MILLIS as f64 / 1000.0).round().max(1.0) as usize;
        let info = SourceInfo {
            name: format!("simulated person, {}", setup.label),
            rate_hz,
            channels: setup.config.channels,
            packet_samples,
            zero_code: 0.0,
            rails: None,
            loss_is_counted: true,
            volts_per_code: None,
            imu: Vec::new(),
        };
        Ok(SimulatedPersonSource {
            info,
            intended: setup.feed.gesture_for(Command::NoMotion),
            feed: setup.feed,
            imu: None,
            pacing,
            reaction_time: reaction,
            tick_ms: 0,
            scheduled_gesture: None,
            opened: Instant::now(),
            packets: 0,
            findings: setup.findings,
        })
    }

    /// The same person with an inertial measurement unit on the band, whose noise is drawn from `seed`; the position of the limb
    /// changes what the electrodes hear ([`SimulatedImu`]).
    pub fn with_imu(mut self, seed: u64) -> SimulatedPersonSource {
        let mut imu = SimulatedImu::new(seed);
        let newest = imu.sample();
        self.imu = Some((imu, newest));
        self.info.imu = ImuChannel::armband_channels();
        self
    }
}

impl SampleSource for SimulatedPersonSource {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn findings(&self) -> &[RecordingFault] {
        &self.findings
    }

    fn poll(&mut self, timeout: Duration, packet: &mut EmgPacket) -> Result<SourceEvent, DeviceError> {
        let end = Duration::from_millis(self.tick_ms + PACKET_MILLIS);
        if self.pacing == Pacing::RealTime {
            let wait = end.saturating_sub(self.opened.elapsed());
            std::thread::sleep(wait.min(timeout));
            if wait > timeout {
                return Ok(SourceEvent::Nothing);
            }
        }
        packet.samples.clear();
        for tick in self.tick_ms..self.tick_ms + PACKET_MILLIS {
            if let Some((_, gesture)) = self.scheduled_gesture.take_if(|(at, _)| *at <= tick) {
                self.intended = gesture;
            }
            let mut samples = self.feed.sample_at(SimTime(tick), self.intended);
            if let Some((imu, newest)) = &mut self.imu {
                if tick.is_multiple_of(IMU_MILLIS) {
                    *newest = imu.sample();
                }
                for sample in &mut samples {
                    let channels = sample.channels.len();
                    for (c, value) in sample.channels.iter_mut().enumerate() {
                        *value *= imu.gain(c, channels);
                    }
                    sample.channels.extend(*newest);
                }
            }
            packet.samples.extend(samples);
        }
        self.tick_ms += PACKET_MILLIS;
        let Some(last) = packet.samples.last() else { return Ok(SourceEvent::Nothing) };
        packet.lost_before = 0;
        packet.device_secs = (last.counter + 1) as f64 / self.info.rate_hz;
        packet.received = match self.pacing {
            Pacing::RealTime => self.opened.elapsed(),
            Pacing::AsFastAsPossible => end,
        };
        self.packets += 1;
        Ok(SourceEvent::Packet)
    }

    fn counts(&self) -> SourceCounts {
        SourceCounts { packets: self.packets, ..SourceCounts::default() }
    }

    fn prompt(&mut self, gesture: Gesture) {
        let follows = self.tick_ms + self.reaction_time.as_millis() as u64;
        self.scheduled_gesture = Some((follows, gesture));
    }

    fn prompt_position(&mut self, position: usize, count: usize) {
        if let Some((imu, _)) = &mut self.imu {
            imu.set_position(position, count);
        }
    }
}

/// Keys in place of muscles: the EMG of the gesture whose key was pressed last, from the generator, in real time. W
/// wrist extension, S wrist flexion, A hand close, D hand open, as on the page; space, Enter or X relax, since a terminal does not tell
/// when a key is let go. The end of the keys relaxes.
pub struct KeyboardSource {
    person: SimulatedPersonSource,
    keys: Receiver<u8>,
    prompted: bool,
}

impl KeyboardSource {
    /// Reads keys from `keys` on a thread of its own. A terminal has to hand them out one by one.
    ///
    /// # Errors
    /// As [`SimulatedPersonSource::new`].
    pub fn new(mut keys: impl Read + Send + 'static, seed: u64) -> Result<KeyboardSource, DeviceError> {
        let mut person =
            SimulatedPersonSource::new(&EmgOrigin::Synthetic, Pacing::RealTime, Duration::ZERO, seed)?;
        person.info.name = "keys".to_owned();
        let (sender, receiver) = channel();
        std::thread::spawn(move || {
            let mut key = [0];
            while keys.read(&mut key).is_ok_and(|count| count == 1) && sender.send(key[0]).is_ok() {}
        });
        Ok(KeyboardSource { person, keys: receiver, prompted: false })
    }
}

/// The gesture of a key.
fn gesture_for_key(key: u8) -> Option<Command> {
    match key.to_ascii_lowercase() {
        b'w' => Some(Command::WristExtension),
        b's' => Some(Command::WristFlexion),
        b'a' => Some(Command::HandClose),
        b'd' => Some(Command::HandOpen),
        b' ' | b'x' | b'\n' | b'\r' => Some(Command::NoMotion),
        _ => None,
    }
}

impl SampleSource for KeyboardSource {
    fn info(&self) -> &SourceInfo {
        self.person.info()
    }

    fn poll(&mut self, timeout: Duration, packet: &mut EmgPacket) -> Result<SourceEvent, DeviceError> {
        use std::sync::mpsc::TryRecvError;
        loop {
            match self.keys.try_recv() {
                Ok(key) => {
                    if let Some(gesture) = gesture_for_key(key) {
                        self.person.prompt(gesture.into());
                    }
                }
                Err(TryRecvError::Empty) => break,
                Err(TryRecvError::Disconnected) => {
                    if !self.prompted {
                        self.prompted = true;
                        self.person.prompt(Command::NoMotion.into());
                    }
                    break;
                }
            }
        }
        self.person.poll(timeout, packet)
    }

    fn counts(&self) -> SourceCounts {
        self.person.counts()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Root mean square of the packets until `until` milliseconds.
    fn rms(source: &mut impl SampleSource, packets: usize) -> f64 {
        let (mut sum, mut count, mut packet) = (0.0, 0_usize, EmgPacket::default());
        for _ in 0..packets {
            while source.poll(Duration::from_secs(1), &mut packet).unwrap() != SourceEvent::Packet {}
            sum += packet.samples.iter().flat_map(|s| &s.channels).map(|v| v * v).sum::<f64>();
            count += packet.samples.iter().map(|s| s.channels.len()).sum::<usize>();
        }
        (sum / count as f64).sqrt()
    }

    #[test]
    fn a_person_makes_what_is_prompted_after_the_reaction_time() {
        let reaction = Duration::from_millis(320);
        let mut person =
            SimulatedPersonSource::new(&EmgOrigin::Synthetic, Pacing::AsFastAsPossible, reaction, 3).unwrap();
        let rest = rms(&mut person, 40);
        person.prompt(Command::HandClose.into());
        let reacting = rms(&mut person, 20);
        rms(&mut person, 10);
        let closed = rms(&mut person, 40);
        assert!(closed > 4.0 * rest && reacting < 2.0 * rest, "{rest} {reacting} {closed}");
        let mut packet = EmgPacket::default();
        person.poll(Duration::ZERO, &mut packet).unwrap();
        // 110 packets of 16 ms before this one, sample 0 at time 0.
        assert_eq!((packet.samples.len(), packet.samples[0].counter), (16, 110 * 16));
        assert_eq!(packet.received, Duration::from_millis(111 * 16));
    }

    #[test]
    fn keys_are_gestures_unknown_ones_are_none_and_their_end_relaxes() {
        assert_eq!(gesture_for_key(b'W'), Some(Command::WristExtension));
        assert_eq!(gesture_for_key(b'7'), None);
        let mut source = KeyboardSource::new(std::io::Cursor::new(b"7a".to_vec()), 1).unwrap();
        // The thread has read both within the first packets; then the keys end, and the hand relaxes.
        let mut packet = EmgPacket::default();
        while !source.prompted {
            source.poll(Duration::from_millis(5), &mut packet).unwrap();
        }
        rms(&mut source, 12);
        assert!(rms(&mut source, 10) < 3.0);
        assert_eq!(source.person.intended, Command::NoMotion);
    }
}
