use super::{
    fragments::{Fragments, Joined},
    protocol::{EMG_DATA, EmgSetting, ProtocolError},
};
use crate::{EmgPacket, SourceCounts};
use proact_types::EmgSample;
use std::time::Duration;

/// From data notifications to numbered packets of samples. Pure: the time comes in with each notification.
///
/// With package ids every packet carries a counter that wraps after 256. The parser unwraps it with the help of the
/// time since the last packet, drops what comes twice or late, and steps the sample counter over what is lost.
/// Packets of any other length than the one agreed on are dropped. Packets joined from fragments are handed out
/// when the number of the next one shows that no fragment of another packet got between.
///
/// Known weaknesses: without package ids a loss shows only as a silence, and a packet that comes twice, or that is
/// wrongly joined from two, cannot be told. With them, a stall of the host of more than 200 packets, 3 s, after which
/// all arrive at once, is taken for a loss.
#[derive(Clone, Debug)]
pub struct EmgParser {
    setting: EmgSetting,
    ids: bool,
    fragments: Fragments,
    /// Joined from fragments, waiting for the next.
    held: Option<Held>,
    held_codes: Vec<u8>,
    /// Id and arrival of the newest packet accepted.
    last: Option<(u8, Duration)>,
    /// The numbering begins anew with the next packet.
    restarted: bool,
    /// Counter of the first sample of the next packet, if none is lost.
    next: u64,
    /// Counter after the last sample handed out; where the stream began before that.
    delivered: u64,
    /// Id that continues a run of packets judged late, and the length of that run.
    late_run: (u8, u32),
    /// Packets in a row that are as long as packets without an id.
    without_id: u32,
    counts: SourceCounts,
}

#[derive(Clone, Copy, Debug)]
struct Held {
    counter: u64,
    received: Duration,
}

/// So many packets in a row, each the successor of the one before, are no late ones: the numbering began anew.
const RESTART_AFTER: u32 = 4;
/// An armband that accepts the order to send ids and sends so many packets in a row without is believed to have
/// none: no source describes the layout beyond doubt.
const WITHOUT_ID_AFTER: u32 = 16;
/// A packet may be this share of 256 packets ahead of the time, and almost 256 behind, before it is misjudged.
const WRAP_MARGIN: f64 = 0.2;
/// Without ids a silence of this many packets, and of [`SILENCE_SECS`], is a gap.
const SILENT_PACKETS: f64 = 4.0;
const SILENCE_SECS: f64 = 0.1;

impl EmgParser {
    /// A parser at the start of a stream. `ids` if the armband agreed to send package ids.
    ///
    /// # Errors
    /// Settings that cannot work.
    pub fn new(setting: EmgSetting, ids: bool) -> Result<EmgParser, ProtocolError> {
        setting.check()?;
        Ok(EmgParser {
            setting,
            ids,
            fragments: Fragments::default(),
            held: None,
            held_codes: Vec::new(),
            last: None,
            restarted: false,
            next: 0,
            delivered: 0,
            late_run: (0, 0),
            without_id: 0,
            counts: SourceCounts::default(),
        })
    }

    /// What was met so far.
    pub fn counts(&self) -> SourceCounts {
        SourceCounts { broken_fragments: self.fragments.dropped(), ..self.counts }
    }

    /// Losses are counted by the armband's own numbers.
    pub fn has_ids(&self) -> bool {
        self.ids
    }

    /// Settings and ids of the stream from now on, after the armband was configured anew at the end of a loss.
    /// The sample counter goes on and steps over at least one packet: how many samples are missing is estimated
    /// from the time.
    ///
    /// # Errors
    /// Settings that cannot work; the old ones stay.
    pub fn restart(&mut self, setting: EmgSetting, ids: bool) -> Result<(), ProtocolError> {
        setting.check()?;
        (self.setting, self.ids) = (setting, ids);
        self.fragments.clear();
        self.held = None;
        self.restarted = true;
        self.without_id = 0;
        self.counts.disconnects += 1;
        Ok(())
    }

    /// Takes a notification that arrived at `now`, and fills `packet` if one is ready. Notifications that are no
    /// EMG are left alone.
    pub fn push(&mut self, notification: &[u8], now: Duration, packet: &mut EmgPacket) -> bool {
        // Taken out so that its message can be read while the rest of this changes; costs no allocation.
        let mut fragments = std::mem::take(&mut self.fragments);
        let ready = match fragments.push(notification) {
            Joined::Incomplete => false,
            Joined::Whole(message) => self.message(message, false, now, packet),
            Joined::FromFragments(message) => self.message(message, true, now, packet),
        };
        self.fragments = fragments;
        ready
    }

    fn message(&mut self, message: &[u8], joined: bool, now: Duration, packet: &mut EmgPacket) -> bool {
        let Some((&EMG_DATA, rest)) = message.split_first() else {
            // Another kind of data, or nothing at all. A joined message without its head begins with a code.
            self.counts.malformed += u64::from(message.is_empty() || joined);
            return false;
        };
        let codes = usize::from(self.setting.packet_bytes);
        self.without_id = if self.ids && rest.len() == codes { self.without_id + 1 } else { 0 };
        if self.without_id == WITHOUT_ID_AFTER {
            self.ids = false;
            self.restarted = true;
        }
        let (id, codes) = match rest.split_first() {
            Some((&id, body)) if self.ids && body.len() == codes => (Some(id), body),
            _ if !self.ids && rest.len() == codes => (None, rest),
            _ => {
                self.counts.malformed += 1;
                return false;
            }
        };
        if self.setting.bits > 8 && codes.chunks_exact(2).any(|code| code[1] > 0x0F) {
            // Beyond twelve bits: whatever it is, it is not a code.
            self.counts.malformed += 1;
            return false;
        }
        let Some(advance) = self.advance(id, now) else { return false };
        let counter = self.next + (advance - 1) * self.setting.packet_samples() as u64;
        self.next = counter + self.setting.packet_samples() as u64;
        self.last = Some((id.unwrap_or(0), now));
        self.late_run = (0, 0);
        if !(joined && self.ids) {
            // A packet that came whole is proof against mixing, but not one that is still held from before.
            self.drop_held();
            self.fill(packet, codes, Held { counter, received: now });
            return true;
        }
        let held = self.held.replace(Held { counter, received: now });
        let ready = match held {
            Some(held) if advance == 1 => {
                let before = std::mem::take(&mut self.held_codes);
                self.fill(packet, &before, held);
                self.held_codes = before;
                true
            }
            Some(_) => {
                self.counts.malformed += 1;
                false
            }
            None => false,
        };
        self.held_codes.clear();
        self.held_codes.extend_from_slice(codes);
        ready
    }

    /// By how many packets the stream has advanced with this one: 1 if none is lost. None if it is to be dropped.
    fn advance(&mut self, id: Option<u8>, now: Duration) -> Option<u64> {
        let Some((last_id, last_at)) = self.last else {
            self.restarted = false;
            return Some(1);
        };
        let elapsed = now.saturating_sub(last_at).as_secs_f64() / self.setting.packet_secs();
        if std::mem::take(&mut self.restarted) {
            // At least one is missing, so that no window joins before and after.
            return Some((elapsed.round() as u64).max(2));
        }
        let Some(id) = id else {
            let silent = elapsed > SILENT_PACKETS && now.saturating_sub(last_at).as_secs_f64() > SILENCE_SECS;
            return Some(if silent { elapsed.round() as u64 } else { 1 });
        };
        // The advance is known but for multiples of 256; the time since the last packet decides.
        let wrapped = i64::from(id.wrapping_sub(last_id));
        // Rather a stall of the host than a loss: packets that were late come in a burst, ahead of the time.
        let wraps = ((elapsed - wrapped as f64) / 256.0 + WRAP_MARGIN).floor();
        let advance = wrapped + 256 * wraps as i64;
        if let Ok(advance @ 1..) = u64::try_from(advance) {
            return Some(advance);
        }
        self.counts.duplicates += u64::from(advance == 0);
        self.counts.late += u64::from(advance < 0);
        let (expected, run) = self.late_run;
        let run = if run > 0 && id == expected { run + 1 } else { 1 };
        self.late_run = (id.wrapping_add(1), run);
        if run < RESTART_AFTER {
            return None;
        }
        self.counts.resyncs += 1;
        Some((elapsed.round() as u64).max(2))
    }

    fn drop_held(&mut self) {
        if self.held.take().is_some() {
            self.counts.malformed += 1;
        }
    }

    fn fill(&mut self, packet: &mut EmgPacket, codes: &[u8], held: Held) {
        let channels = self.setting.channels();
        packet.samples.clear();
        for (sample, counter) in codes.chunks_exact(channels * self.setting.code_bytes()).zip(held.counter..)
        {
            let channels = match self.setting.code_bytes() {
                1 => sample.iter().map(|code| f64::from(*code)).collect(),
                _ => sample.chunks_exact(2).map(|c| f64::from(u16::from_le_bytes([c[0], c[1]]))).collect(),
            };
            packet.samples.push(EmgSample { counter, channels });
        }
        packet.lost_before = held.counter - self.delivered;
        self.delivered = held.counter + packet.samples.len() as u64;
        packet.device_secs = self.delivered as f64 / f64::from(self.setting.rate_hz);
        packet.received = held.received;
        self.counts.packets += 1;
        self.counts.lost_samples += packet.lost_before;
    }
}

#[cfg(test)]
mod tests {
    use super::{super::fragments::cut, *};
    use proptest::prelude::*;

    /// Packet `number` of a stream whose codes tell which sample they are.
    fn data(number: u64, id: Option<u8>) -> Vec<u8> {
        let mut bytes = vec![EMG_DATA];
        bytes.extend(id);
        bytes.extend(
            (0..16).flat_map(|k| (0..8).map(move |c| code(number.wrapping_mul(16).wrapping_add(k), c))),
        );
        bytes
    }

    fn code(sample: u64, channel: u64) -> u8 {
        (sample.wrapping_mul(2_654_435_761) >> 8).wrapping_add(channel * 37) as u8
    }

    fn numbered(number: u64) -> Vec<u8> {
        data(number, Some(number as u8))
    }

    fn at(number: u64) -> Duration {
        Duration::from_millis(16 * number)
    }

    fn parser() -> EmgParser {
        EmgParser::new(EmgSetting::PROACT, true).unwrap()
    }

    /// Counters and gaps of the packets handed out; every sample is checked to be the one that its counter names.
    fn run(parser: &mut EmgParser, stream: &[(u64, Vec<u8>)], base: u64) -> Vec<(u64, u64)> {
        let mut packet = EmgPacket::default();
        let mut out = Vec::new();
        for (time, notification) in stream {
            if parser.push(notification, at(*time), &mut packet) {
                out.push((packet.samples[0].counter, packet.lost_before));
                for sample in &packet.samples {
                    for (value, channel) in sample.channels.iter().zip(0..) {
                        assert_eq!(*value, f64::from(code(sample.counter + base, channel)));
                    }
                }
            }
        }
        out
    }

    fn in_order(numbers: impl IntoIterator<Item = u64>) -> Vec<(u64, Vec<u8>)> {
        numbers.into_iter().map(|n| (n, numbered(n))).collect()
    }

    #[test]
    fn a_clean_stream_gives_every_sample_once_over_many_wraps_of_the_id() {
        let out = run(&mut parser(), &in_order(0..1000), 0);
        assert_eq!(out, (0..1000).map(|n| (16 * n, 0)).collect::<Vec<_>>());
    }

    #[test]
    fn lost_packets_are_a_gap_of_their_length_even_beyond_a_wrap() {
        for lost in [1, 2, 100, 255, 256, 300, 1000] {
            let mut parser = parser();
            let out = run(&mut parser, &in_order((0..10).chain(10 + lost..20 + lost)), 0);
            assert_eq!(out[10], (16 * (10 + lost), 16 * lost), "{lost} lost");
            assert_eq!(parser.counts().lost_samples, 16 * lost);
        }
    }

    #[test]
    fn packets_that_come_twice_or_late_are_dropped_and_counted() {
        let mut stream = in_order([0, 1, 1, 3, 2, 4]);
        stream.iter_mut().zip(0..).for_each(|((time, _), now)| *time = now);
        let mut parser = parser();
        assert_eq!(run(&mut parser, &stream, 0), [(0, 0), (16, 0), (48, 16), (64, 0)]);
        assert_eq!((parser.counts().duplicates, parser.counts().late), (1, 1));
    }

    #[test]
    fn a_burst_after_a_stall_of_the_host_is_no_loss() {
        let stream: Vec<_> = (0..100).map(|n| (if n < 50 { n } else { n.max(99) }, numbered(n))).collect();
        assert!(run(&mut parser(), &stream, 0).iter().all(|(_, lost)| *lost == 0));
    }

    #[test]
    fn packets_of_another_length_are_dropped_and_leave_a_gap() {
        let mut stream = in_order(0..6);
        stream[1].1.pop();
        stream[2].1.push(7);
        stream[4].1.truncate(1);
        stream.push((6, vec![]));
        let mut parser = parser();
        assert_eq!(run(&mut parser, &stream, 0), [(0, 0), (48, 32), (80, 16)]);
        assert_eq!(parser.counts().malformed, 4);
    }

    #[test]
    fn other_kinds_of_data_pass_by() {
        let mut stream = in_order(0..2);
        stream.insert(1, (1, [&[0x05], &[0; 16][..]].concat()));
        let mut parser = parser();
        assert_eq!(run(&mut parser, &stream, 0).len(), 2);
        assert_eq!(parser.counts().malformed, 0);
    }

    #[test]
    fn numbering_that_begins_anew_is_taken_up_after_four_packets_with_a_gap() {
        // A device that starts again sends ids from 0; its codes go on here, so that they can be checked.
        let mut stream = in_order(0..100);
        stream.extend((100..120).map(|n| (n, data(n, Some((n - 100) as u8)))));
        let mut parser = parser();
        let out = run(&mut parser, &stream, 0);
        assert_eq!(out[100], (16 * 103, 48));
        assert_eq!(parser.counts().resyncs, 1);
    }

    #[test]
    fn a_packet_repeated_for_ever_is_never_taken_for_a_stream() {
        let mut stream = in_order(0..5);
        stream.extend((5..100).map(|now| (now, numbered(4))));
        assert_eq!(run(&mut parser(), &stream, 0).len(), 5);
    }

    #[test]
    fn without_ids_a_silence_is_a_gap() {
        let mut parser = EmgParser::new(EmgSetting::PROACT, false).unwrap();
        let stream: Vec<_> = (0..5).chain(20..25).map(|n| (n, data(n, None))).collect();
        let out = run(&mut parser, &stream, 0);
        assert_eq!(out[5], (16 * 20, 16 * 15));
    }

    #[test]
    fn an_armband_that_agrees_to_ids_and_sends_none_is_found_out() {
        let mut parser = parser();
        let stream: Vec<_> = (0..40).map(|n| (n, data(n, None))).collect();
        let mut packet = EmgPacket::default();
        let taken = stream.iter().filter(|(time, b)| parser.push(b, at(*time), &mut packet)).count();
        assert!(!parser.has_ids());
        assert_eq!(taken, 40 - 15);
    }

    #[test]
    fn twelve_bit_codes_are_two_bytes_and_never_more_than_4095() {
        let mut parser = EmgParser::new(EmgSetting::FINE, true).unwrap();
        let mut bytes = vec![EMG_DATA, 0];
        bytes.extend((0..64_u16).flat_map(|k| (k * 64 + 1).to_le_bytes()));
        let mut packet = EmgPacket::default();
        assert!(parser.push(&bytes, at(0), &mut packet));
        assert_eq!(packet.samples.len(), 8);
        assert_eq!(packet.samples[7].channels[7], f64::from(63 * 64 + 1));
        assert_eq!(packet.device_secs, 8.0 / 500.0);
        (bytes[1], bytes[3]) = (1, 0x10);
        assert!(!parser.push(&bytes, at(1), &mut packet), "beyond twelve bits");
        assert_eq!(parser.counts().malformed, 1);
    }

    #[test]
    fn after_a_lost_link_the_counter_steps_by_the_time_and_at_least_a_packet() {
        for (silence, lost) in [(0, 16), (1, 16), (100, 16 * 99)] {
            let mut parser = parser();
            run(&mut parser, &in_order(0..10), 0);
            parser.restart(EmgSetting::PROACT, true).unwrap();
            let mut packet = EmgPacket::default();
            assert!(parser.push(&data(0, Some(0)), at(9 + silence), &mut packet));
            assert_eq!((packet.samples[0].counter, packet.lost_before), (160 + lost, lost), "{silence}");
        }
    }

    #[test]
    fn fragments_of_two_packets_that_fit_together_are_not_mixed() {
        // Packet 1 loses its end and packet 2 its beginning; what is left is as long as a packet.
        let mut stream: Vec<(u64, Vec<u8>)> = Vec::new();
        for number in 0..6 {
            let pieces = cut(&numbered(number), 20);
            let kept = match number {
                1 => &pieces[..3],
                2 => &pieces[3..],
                _ => &pieces[..],
            };
            stream.extend(kept.iter().map(|piece| (number, piece.clone())));
        }
        let out = run(&mut parser(), &stream, 0);
        assert_eq!(out, [(0, 0), (48, 32), (64, 0)]);
    }

    /// A stream and what the air does to it: per notification, drop, repeat, swap with the next, or cut short.
    fn spoilt(fragmented: bool, faults: &[u8]) -> Vec<(u64, Vec<u8>)> {
        let mut stream = Vec::new();
        for number in 0..60 {
            let message = numbered(number);
            let pieces = if fragmented { cut(&message, 20) } else { vec![message] };
            stream.extend(pieces.into_iter().map(|piece| (number, piece)));
        }
        let mut out: Vec<(u64, Vec<u8>)> = Vec::new();
        let mut late = None;
        for ((time, mut bytes), fault) in stream.into_iter().zip(faults.iter().cycle()) {
            // Counters begin with the first packet heard: that one comes through.
            let fault = if time == 0 { &9 } else { fault };
            match fault {
                0 => continue,
                1 => out.push((time, bytes.clone())),
                2 if late.is_none() => {
                    late = Some((time, bytes));
                    continue;
                }
                3 => bytes.truncate(bytes.len() / 2),
                _ => {}
            }
            out.push((time, bytes));
            out.extend(late.take());
        }
        out
    }

    proptest! {
        #[test]
        fn whatever_the_air_does_no_sample_is_invented_doubled_or_moved(
            fragmented: bool, faults in prop::collection::vec(0_u8..30, 5..600)
        ) {
            // `run` checks that every sample handed out is the one that its counter names.
            let out = run(&mut parser(), &spoilt(fragmented, &faults), 0);
            let mut next = 0;
            for (counter, lost) in out {
                prop_assert_eq!(counter, next + lost, "gaps are marked");
                next = counter + 16;
            }
        }

        #[test]
        fn bytes_of_any_kind_do_not_panic_and_samples_are_whole_and_in_order(
            stream in prop::collection::vec(
                (0_u64..3000, prop_oneof![
                    prop::collection::vec(any::<u8>(), 0..140),
                    any::<u64>().prop_map(numbered),
                    (any::<u8>(), prop::collection::vec(any::<u8>(), 0..140)).prop_map(|(index, bytes)| [&[0xFF, index], &bytes[..]].concat()),
                ]), 0..80),
            ids: bool, fine: bool,
        ) {
            let setting = if fine { EmgSetting::FINE } else { EmgSetting::PROACT };
            let mut parser = EmgParser::new(setting, ids).unwrap();
            let mut packet = EmgPacket::default();
            let mut next = 0;
            for (time, notification) in &stream {
                if parser.push(notification, Duration::from_millis(*time), &mut packet) {
                    prop_assert_eq!(packet.samples.len(), setting.packet_samples());
                    for sample in &packet.samples {
                        prop_assert_eq!(sample.channels.len(), 8);
                        prop_assert!(sample.channels.iter().all(|v| (0.0..=setting.highest()).contains(v)));
                    }
                    prop_assert_eq!(packet.samples[0].counter, next + packet.lost_before);
                    next = packet.samples[0].counter + packet.samples.len() as u64;
                }
            }
        }
    }
}
