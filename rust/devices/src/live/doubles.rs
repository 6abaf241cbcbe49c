use super::{EmgPacket, SampleSource, SourceCounts, SourceEvent, SourceInfo};
use crate::{DeviceError, random_stream};
use proact_types::{EmgSample, Gesture};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use std::{collections::VecDeque, time::Duration};

/// What a [`ScriptedSource`] does at one poll.
#[derive(Clone, Debug, PartialEq)]
pub enum ScriptedEvent {
    /// Hands out these samples.
    Samples(Vec<EmgSample>),
    /// Anything but a packet.
    Other(SourceEvent),
}

/// A source that does what the test says, one event a poll, without any clock. Ends with the script.
#[derive(Clone, Debug)]
pub struct ScriptedSource {
    info: SourceInfo,
    script: VecDeque<ScriptedEvent>,
    expected: Option<u64>,
    counts: SourceCounts,
}

impl ScriptedSource {
    /// Plays `script`.
    pub fn new(info: SourceInfo, script: impl IntoIterator<Item = ScriptedEvent>) -> ScriptedSource {
        ScriptedSource {
            info,
            script: script.into_iter().collect(),
            expected: None,
            counts: SourceCounts::default(),
        }
    }
}

impl SampleSource for ScriptedSource {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn poll(&mut self, _timeout: Duration, packet: &mut EmgPacket) -> Result<SourceEvent, DeviceError> {
        let samples = match self.script.pop_front() {
            None => return Ok(SourceEvent::Ended),
            Some(ScriptedEvent::Other(event)) => {
                self.counts.disconnects += u64::from(matches!(event, SourceEvent::Lost { .. }));
                return Ok(event);
            }
            Some(ScriptedEvent::Samples(samples)) => samples,
        };
        let (Some(first), Some(last)) = (samples.first(), samples.last()) else {
            return Ok(SourceEvent::Nothing);
        };
        packet.lost_before = first.counter.saturating_sub(self.expected.unwrap_or(first.counter));
        packet.device_secs = (last.counter + 1) as f64 / self.info.rate_hz;
        packet.received = Duration::from_secs_f64(packet.device_secs);
        self.expected = Some(last.counter + 1);
        self.counts.packets += 1;
        self.counts.lost_samples += packet.lost_before;
        packet.samples = samples;
        Ok(SourceEvent::Packet)
    }

    fn counts(&self) -> SourceCounts {
        self.counts
    }
}

/// What a [`FaultySource`] does to the stream of another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum InjectedFault {
    /// A packet vanishes with this probability.
    Drop(f64),
    /// A packet comes twice with this probability.
    Duplicate(f64),
    /// A packet comes after the next one with this probability.
    Reorder(f64),
    /// The end of a packet is missing with this probability.
    Truncate(f64),
    /// From this packet on every value is that of the sample before, while the counter goes on: a frozen
    /// converter.
    Freeze {
        /// Number of the first such packet, from 0.
        from: u64,
    },
    /// One value of a packet is not a number, with this probability.
    NotANumber(f64),
    /// The link is lost at this packet; it and those after it come only when `polls` polls have brought nothing.
    Disconnect {
        /// Number of the packet, from 0.
        at: u64,
        /// Polls without anything, the report of the loss not counted.
        polls: u32,
    },
}

/// Another source with faults, for tests of what follows it. Unlike a proper source it does hand out repeated,
/// late and unusable samples, as one behind a poor driver would: what follows must stand it. Choices are drawn from
/// the stream `emg/faults` of the seed.
pub struct FaultySource<S> {
    inner: S,
    faults: Vec<InjectedFault>,
    rng: ChaCha8Rng,
    /// Packets that the inner source has given.
    packet_count: u64,
    /// To be handed out before the next.
    queue: VecDeque<EmgPacket>,
    frozen: Option<EmgSample>,
    silence: Option<u32>,
}

impl<S: SampleSource> FaultySource<S> {
    /// `inner` with `faults`, applied in their order.
    pub fn new(inner: S, faults: &[InjectedFault], seed: u64) -> FaultySource<S> {
        FaultySource {
            inner,
            faults: faults.to_vec(),
            rng: random_stream(seed, "emg/faults"),
            packet_count: 0,
            queue: VecDeque::new(),
            frozen: None,
            silence: None,
        }
    }

    /// Applies every fault to the packet that has just come. Queues what is left of it.
    fn apply_faults(&mut self, mut packet: EmgPacket) -> SourceEvent {
        let number = self.packet_count;
        self.packet_count += 1;
        let (mut copies, mut late, mut lost) = (1, false, false);
        for fault in self.faults.clone() {
            match fault {
                InjectedFault::Drop(share) => copies = if self.rng.random_bool(share) { 0 } else { copies },
                InjectedFault::Duplicate(share) => copies += usize::from(self.rng.random_bool(share)),
                InjectedFault::Reorder(share) => late |= self.rng.random_bool(share),
                InjectedFault::Truncate(share) if self.rng.random_bool(share) => {
                    let keep = self.rng.random_range(0..packet.samples.len().max(1));
                    packet.samples.truncate(keep);
                }
                InjectedFault::NotANumber(share) if self.rng.random_bool(share) => {
                    if let Some(value) = packet.samples.first_mut().and_then(|s| s.channels.first_mut()) {
                        *value = f64::NAN;
                    }
                }
                InjectedFault::Freeze { from } if number >= from => {
                    let held = self.frozen.take().or_else(|| packet.samples.first().cloned());
                    if let Some(held) = &held {
                        packet.samples.iter_mut().for_each(|s| s.channels.clone_from(&held.channels));
                    }
                    self.frozen = held;
                }
                InjectedFault::Disconnect { at, polls } if number == at => {
                    self.silence = Some(polls);
                    lost = true;
                }
                _ => {}
            }
        }
        if packet.samples.is_empty() {
            copies = 0;
        }
        let index = if late { self.queue.len() } else { 0 };
        for _ in 0..copies {
            self.queue.insert(index.min(self.queue.len()), packet.clone());
        }
        if late {
            // Kept until the next packet has passed it.
            SourceEvent::Nothing
        } else if lost {
            SourceEvent::Lost { reason: "the test pulled the plug".to_owned() }
        } else {
            SourceEvent::Packet
        }
    }
}

impl<S: SampleSource> SampleSource for FaultySource<S> {
    fn info(&self) -> &SourceInfo {
        self.inner.info()
    }

    fn poll(&mut self, timeout: Duration, packet: &mut EmgPacket) -> Result<SourceEvent, DeviceError> {
        match self.silence {
            Some(0) => {
                self.silence = None;
                return Ok(SourceEvent::Restored);
            }
            Some(polls) => {
                self.silence = Some(polls - 1);
                return Ok(SourceEvent::Nothing);
            }
            None => {}
        }
        if self.queue.is_empty() {
            let mut fresh = EmgPacket::default();
            match self.inner.poll(timeout, &mut fresh)? {
                SourceEvent::Packet => match self.apply_faults(fresh) {
                    SourceEvent::Packet => {}
                    SourceEvent::Nothing => {
                        // One that comes late: the next one goes first.
                        let mut next = EmgPacket::default();
                        match self.inner.poll(timeout, &mut next)? {
                            SourceEvent::Packet => {
                                self.packet_count += 1;
                                self.queue.push_front(next);
                            }
                            other => return Ok(other),
                        }
                    }
                    other => return Ok(other),
                },
                other => return Ok(other),
            }
        }
        Ok(match self.queue.pop_front() {
            Some(ready) => {
                *packet = ready;
                SourceEvent::Packet
            }
            None => SourceEvent::Nothing,
        })
    }

    fn counts(&self) -> SourceCounts {
        self.inner.counts()
    }

    fn prompt(&mut self, gesture: Gesture) {
        self.inner.prompt(gesture);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Pacing, PlaybackSource};

    fn clean(count: u64) -> PlaybackSource {
        let sample = |counter| EmgSample { counter, channels: [counter as f64].into_iter().collect() };
        PlaybackSource::new("test", (0..count).map(sample).collect(), 1000.0, 4, Pacing::AsFastAsPossible)
            .unwrap()
    }

    /// Counters of all samples, and all events that were no packet.
    fn drain(source: &mut impl SampleSource) -> (Vec<u64>, Vec<SourceEvent>, usize) {
        let (mut counters, mut events, mut not_a_number) = (Vec::new(), Vec::new(), 0);
        let mut packet = EmgPacket::default();
        loop {
            match source.poll(Duration::ZERO, &mut packet).unwrap() {
                SourceEvent::Packet => {
                    counters.extend(packet.samples.iter().map(|s| s.counter));
                    not_a_number += packet.samples.iter().filter(|s| s.channels[0].is_nan()).count();
                }
                SourceEvent::Ended => return (counters, events, not_a_number),
                other => events.push(other),
            }
        }
    }

    #[test]
    fn without_faults_the_stream_is_unchanged() {
        let (counters, events, _) = drain(&mut FaultySource::new(clean(40), &[], 1));
        assert_eq!(counters, (0..40).collect::<Vec<_>>());
        assert!(events.is_empty());
    }

    #[test]
    fn each_fault_does_what_it_says() {
        let run = |fault| drain(&mut FaultySource::new(clean(400), &[fault], 3));
        let (dropped, ..) = run(InjectedFault::Drop(0.2));
        assert!(dropped.len() < 400 && dropped.is_sorted());
        let (twice, ..) = run(InjectedFault::Duplicate(0.2));
        assert!(twice.len() > 400 && twice.windows(2).any(|w| w[1] + 3 == w[0]));
        let (mixed, ..) = run(InjectedFault::Reorder(0.2));
        assert!(!mixed.is_sorted());
        let mut sorted = mixed.clone();
        sorted.sort_unstable();
        assert_eq!(sorted, (0..400).collect::<Vec<_>>(), "nothing is lost");
        let (short, ..) = run(InjectedFault::Truncate(0.2));
        assert!(short.len() < 400 && short.is_sorted());
        assert!(run(InjectedFault::NotANumber(0.2)).2 > 5);
        let (_, events, _) = run(InjectedFault::Disconnect { at: 5, polls: 3 });
        assert!(matches!(events[0], SourceEvent::Lost { .. }));
        assert_eq!(
            events[1..],
            [SourceEvent::Nothing, SourceEvent::Nothing, SourceEvent::Nothing, SourceEvent::Restored]
        );
    }

    #[test]
    fn a_frozen_converter_repeats_its_value_while_the_counter_goes_on() {
        let mut source = FaultySource::new(clean(40), &[InjectedFault::Freeze { from: 2 }], 1);
        let mut packet = EmgPacket::default();
        let mut values = Vec::new();
        while source.poll(Duration::ZERO, &mut packet).unwrap() == SourceEvent::Packet {
            values.extend(packet.samples.iter().map(|s| (s.counter, s.channels[0])));
        }
        assert_eq!(values[7], (7, 7.0));
        assert!(values[8..].iter().all(|(_, v)| *v == 8.0), "{values:?}");
        assert_eq!(values.last().map(|(c, _)| *c), Some(39));
    }

    #[test]
    fn a_script_is_played_event_by_event() {
        let info = clean(1).info().clone();
        let sample = |counter| EmgSample { counter, channels: [1.0].into_iter().collect() };
        let lost = SourceEvent::Lost { reason: "out of range".to_owned() };
        let mut source = ScriptedSource::new(
            info,
            [
                ScriptedEvent::Samples(vec![sample(0), sample(1)]),
                ScriptedEvent::Other(lost.clone()),
                ScriptedEvent::Other(SourceEvent::Restored),
                ScriptedEvent::Samples(vec![sample(12)]),
            ],
        );
        let (counters, events, _) = drain(&mut source);
        assert_eq!(counters, [0, 1, 12]);
        assert_eq!(events, [lost, SourceEvent::Restored]);
        assert_eq!((source.counts().lost_samples, source.counts().disconnects), (10, 1));
    }
}
