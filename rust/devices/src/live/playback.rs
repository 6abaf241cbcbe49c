use super::{EmgPacket, SampleSource, SourceCounts, SourceEvent, SourceInfo};
use crate::{DeviceError, Recordings};
use proact_emg::{RATES_HZ, RecordingFault};
use proact_types::{ChannelValues, EmgSample, Gesture};
use std::time::{Duration, Instant};

/// How fast a recording is played.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pacing {
    /// Each packet when its last sample is due.
    RealTime,
    /// Without waiting.
    AsFastAsPossible,
}

/// A recording played as if it came from a device, in packets.
#[derive(Clone, Debug)]
pub struct PlaybackSource {
    info: SourceInfo,
    pacing: Pacing,
    samples: Vec<EmgSample>,
    position: usize,
    opened: Instant,
    packets: u64,
    lost_samples: u64,
    findings: Vec<RecordingFault>,
}

impl PlaybackSource {
    /// Plays `samples`, numbered as they are: a step in the counters is a gap. Packets hold `packet_samples`.
    ///
    /// # Errors
    /// No samples, counters that do not rise, no channels, channels that change, or no usable rate or packet.
    pub fn new(
        name: &str,
        samples: Vec<EmgSample>,
        rate_hz: f64,
        packet_samples: usize,
        pacing: Pacing,
    ) -> Result<PlaybackSource, DeviceError> {
        if !RATES_HZ.contains(&rate_hz) {
            let expected = "1 to 1000000 samples per second";
            return Err(DeviceError::Parameter { name: "EMG rate", value: rate_hz, expected });
        }
        if packet_samples == 0 {
            return Err(DeviceError::Parameter {
                name: "samples of a packet",
                value: 0.0,
                expected: "at least 1",
            });
        }
        let channels = samples.first().map_or(0, |s| s.channels.len());
        if channels == 0 {
            return Err(DeviceError::EmptyFile { path: name.into() });
        }
        for (row, pair) in samples.windows(2).enumerate() {
            if pair[1].channels.len() != channels {
                return Err(DeviceError::Columns {
                    path: name.into(),
                    row: row + 2,
                    got: pair[1].channels.len(),
                    expected: channels.to_string(),
                });
            }
            if pair[1].counter <= pair[0].counter {
                return Err(DeviceError::CounterNotRising {
                    name: name.to_owned(),
                    before: pair[0].counter,
                    got: pair[1].counter,
                });
            }
        }
        let info = SourceInfo {
            name: name.to_owned(),
            rate_hz,
            channels,
            packet_samples,
            zero_code: 0.0,
            rails: None,
            loss_is_counted: true,
            volts_per_code: None,
            imu: Vec::new(),
        };
        let opened = Instant::now();
        let findings = Vec::new();
        Ok(PlaybackSource {
            info,
            pacing,
            samples,
            position: 0,
            opened,
            packets: 0,
            lost_samples: 0,
            findings,
        })
    }

    /// The same, of recordings in which `findings` were accepted.
    pub fn with_findings(self, findings: Vec<RecordingFault>) -> PlaybackSource {
        PlaybackSource { findings, ..self }
    }

    /// Plays repetition `repetition` of `gestures`, one after the other, with counters from 0 and no gaps.
    ///
    /// # Errors
    /// A repetition that is not there, and those of [`PlaybackSource::new`].
    pub fn of_recordings(
        recordings: &Recordings,
        repetition: u32,
        gestures: &[impl Copy + Into<Gesture>],
        packet_samples: usize,
        pacing: Pacing,
    ) -> Result<PlaybackSource, DeviceError> {
        let mut values: Vec<ChannelValues> = Vec::new();
        for &gesture in gestures {
            values.extend(recordings.find(gesture, repetition)?.samples.iter().cloned());
        }
        let samples =
            values.into_iter().zip(0..).map(|(channels, counter)| EmgSample { counter, channels }).collect();
        let name = recordings.path.display().to_string();
        let mut source = PlaybackSource::new(&name, samples, recordings.rate_hz, packet_samples, pacing)?;
        (source.info.channels, source.info.imu) = (recordings.channels, recordings.imu.clone());
        Ok(source)
    }
}

impl SampleSource for PlaybackSource {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn findings(&self) -> &[RecordingFault] {
        &self.findings
    }

    fn poll(&mut self, timeout: Duration, packet: &mut EmgPacket) -> Result<SourceEvent, DeviceError> {
        let rest = &self.samples[self.position..];
        let Some(first) = rest.first() else { return Ok(SourceEvent::Ended) };
        // A packet ends before a gap, as a device's would.
        let unbroken = rest.iter().zip(first.counter..).take_while(|(s, due)| s.counter == *due).count();
        let count = unbroken.min(self.info.packet_samples);
        let begin = self.samples[0].counter;
        let last = first.counter + count as u64;
        if self.pacing == Pacing::RealTime {
            let due = Duration::from_secs_f64((last - begin) as f64 / self.info.rate_hz);
            let wait = due.saturating_sub(self.opened.elapsed());
            std::thread::sleep(wait.min(timeout));
            if wait > timeout {
                return Ok(SourceEvent::Nothing);
            }
        }
        let expected = if self.position == 0 { begin } else { self.samples[self.position - 1].counter + 1 };
        packet.samples.clear();
        packet.samples.extend_from_slice(&rest[..count]);
        packet.lost_before = first.counter - expected;
        packet.device_secs = last as f64 / self.info.rate_hz;
        packet.received = match self.pacing {
            Pacing::RealTime => self.opened.elapsed(),
            // Flat out nothing arrives by the clock; the device's time keeps the same run the same.
            Pacing::AsFastAsPossible => Duration::from_secs_f64((last - begin) as f64 / self.info.rate_hz),
        };
        self.position += count;
        self.packets += 1;
        self.lost_samples += packet.lost_before;
        Ok(SourceEvent::Packet)
    }

    fn counts(&self) -> SourceCounts {
        SourceCounts { packets: self.packets, lost_samples: self.lost_samples, ..SourceCounts::default() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn samples(counters: impl IntoIterator<Item = u64>) -> Vec<EmgSample> {
        let sample = |counter| EmgSample { counter, channels: [counter as f64].into_iter().collect() };
        counters.into_iter().map(sample).collect()
    }

    #[test]
    fn packets_end_at_a_gap_and_the_next_one_says_what_is_missing() {
        let counters = (10..14).chain(20..25);
        let mut source =
            PlaybackSource::new("test", samples(counters), 200.0, 3, Pacing::AsFastAsPossible).unwrap();
        let mut packet = EmgPacket::default();
        let mut seen = Vec::new();
        while source.poll(Duration::ZERO, &mut packet).unwrap() == SourceEvent::Packet {
            seen.push((packet.samples[0].counter, packet.samples.len(), packet.lost_before));
        }
        assert_eq!(seen, [(10, 3, 0), (13, 1, 0), (20, 3, 6), (23, 2, 0)]);
        assert_eq!(source.counts().lost_samples, 6);
        assert_eq!(packet.device_secs, 25.0 / 200.0);
        assert_eq!(source.poll(Duration::ZERO, &mut packet).unwrap(), SourceEvent::Ended);
    }

    #[test]
    fn in_real_time_a_packet_comes_when_its_last_sample_is_due_and_not_before() {
        let mut source = PlaybackSource::new("test", samples(0..10), 1000.0, 10, Pacing::RealTime).unwrap();
        let mut packet = EmgPacket::default();
        let begin = Instant::now();
        assert_eq!(source.poll(Duration::from_millis(1), &mut packet).unwrap(), SourceEvent::Nothing);
        assert_eq!(source.poll(Duration::from_secs(1), &mut packet).unwrap(), SourceEvent::Packet);
        assert!(begin.elapsed() >= Duration::from_millis(9), "{:?}", begin.elapsed());
    }

    #[test]
    fn recordings_that_cannot_be_played_are_refused() {
        let refused = |samples, rate, packet| {
            PlaybackSource::new("test", samples, rate, packet, Pacing::AsFastAsPossible)
                .unwrap_err()
                .to_string()
        };
        assert!(refused(samples([]), 200.0, 1).contains("has no samples"));
        assert!(refused(samples([1, 1]), 200.0, 1).contains("counter 1 after 1"));
        assert!(refused(samples([1]), f64::NAN, 1).contains("EMG rate is NaN"));
        assert!(refused(samples([1]), 200.0, 0).contains("samples of a packet is 0"));
        let mut ragged = samples([1, 2]);
        ragged[1].channels.push(0.0);
        assert!(refused(ragged, 200.0, 1).contains("2 columns, expected 1"));
    }
}
