use super::{super::fragments::split_into_fragments, *};
use proptest::prelude::*;

/// Packet `number` of a stream whose codes tell which sample they are.
fn data(number: u64, id: Option<u8>) -> Vec<u8> {
    let mut bytes = vec![EMG_DATA];
    bytes.extend(id);
    bytes.extend((0..16).flat_map(|k| (0..8).map(move |c| code(number.wrapping_mul(16).wrapping_add(k), c))));
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

fn parser() -> GForceParser {
    GForceParser::new(EmgSetting::PROACT_DEFAULT, true).unwrap()
}

/// Counters and gaps of the packets handed out; every sample is checked to be the one that its counter names.
fn run(parser: &mut GForceParser, stream: &[(u64, Vec<u8>)], base: u64) -> Vec<(u64, u64)> {
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
    let mut parser = GForceParser::new(EmgSetting::PROACT_DEFAULT, false).unwrap();
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
    let mut parser = GForceParser::new(EmgSetting::HIGH_RESOLUTION, true).unwrap();
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
        parser.restart(EmgSetting::PROACT_DEFAULT, true).unwrap();
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
        let pieces = split_into_fragments(&numbered(number), 20);
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
        let pieces = if fragmented { split_into_fragments(&message, 20) } else { vec![message] };
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
        let setting = if fine { EmgSetting::HIGH_RESOLUTION } else { EmgSetting::PROACT_DEFAULT };
        let mut parser = GForceParser::new(setting, ids).unwrap();
        let mut packet = EmgPacket::default();
        let mut next = 0;
        for (time, notification) in &stream {
            if parser.push(notification, Duration::from_millis(*time), &mut packet) {
                prop_assert_eq!(packet.samples.len(), setting.packet_samples());
                for sample in &packet.samples {
                    prop_assert_eq!(sample.channels.len(), 8);
                    prop_assert!(sample.channels.iter().all(|v| (0.0..=setting.max_code()).contains(v)));
                }
                prop_assert_eq!(packet.samples[0].counter, next + packet.lost_before);
                next = packet.samples[0].counter + packet.samples.len() as u64;
            }
        }
    }
}
