use super::{
    EMG_TYPE, OPEN_TIMEOUT_SECS, lsl_error, numbering::TimestampNumbering, reader::LslReader, resolve_stream,
    subscribe,
};
use crate::{
    DeviceError, EmgPacket, SampleSource, SourceClock, SourceCounts, SourceEvent, SourceInfo,
    amplifier::{is_emg, is_imu, microvolts_per_unit},
};
use lsl::{ChannelFormat, StreamInfo, StreamInlet};
use proact_emg::{ImuChannel, RATES_HZ};
use proact_types::{EmgSample, MAX_EMG_CHANNELS};
use std::{
    sync::mpsc::RecvTimeoutError,
    time::{Duration, Instant},
};

/// From one look at the clocks' comparison, which liblsl makes in the background, to the next: before there is one, and then.
const CLOCK_QUERY_PERIODS: [Duration; 2] = [Duration::from_millis(200), Duration::from_secs(2)];
/// A stream without a sample for so long is lost, until one comes.
const SAMPLE_TIMEOUT: Duration = Duration::from_secs(2);
/// Samples that may wait for whoever polls; those beyond leave a gap. Four seconds at 4 kHz.
const MAX_QUEUED_SAMPLES: usize = 16_384;
/// Most samples of a packet.
const MAX_PACKET_SAMPLES: usize = 64;

/// An EMG stream of the lab streaming layer, from any program on the network.
///
/// liblsl connects anew by itself when the sender comes back. Samples are numbered by their time stamps, so that what is
/// missing in them is a gap.
pub struct LslSource {
    info: SourceInfo,
    reader: LslReader<ReceivedSample>,
    /// Came after a gap and begins the next packet.
    pending: Option<NumberedSample>,
    numbering: TimestampNumbering,
    next_counter: u64,
    opened: Instant,
    last_sample: Instant,
    lost: bool,
    counts: SourceCounts,
    clock: ClockStatistics,
}

/// A sample as it came.
struct ReceivedSample {
    sample: EmgSample,
    /// By the sender's clock, and when it arrived, seconds of liblsl's clock on this machine.
    stamp_secs: f64,
    arrival_secs: f64,
    received: Instant,
    /// The sender's clock to that of this machine, and how wrong that may be, seconds.
    clock_offset_secs: Option<(f64, f64)>,
}

/// A numbered sample, and what is missing before it.
struct NumberedSample {
    sample: EmgSample,
    lost_before: u64,
    received: Instant,
}

#[derive(Default)]
struct ClockStatistics {
    offset_secs: Option<(f64, f64)>,
    age_count: u64,
    age_sum_secs: f64,
    worst_age_secs: f64,
}

impl LslSource {
    /// Opens the stream called `name`; without a name the only one of type EMG. Channels of an inertial measurement unit among its
    /// channels are taken if `imu`.
    ///
    /// # Errors
    /// No such stream, or several; one without a rate, with too many channels or with texts; no connection.
    pub fn open(name: Option<&str>, imu: bool) -> Result<LslSource, DeviceError> {
        let (reader, info) = LslReader::open(name, EMG_TYPE, MAX_QUEUED_SAMPLES, move |property, label| {
            let (inlet, info, chosen) = connect(property, label, imu)?;
            Ok((inlet, info, sample_converter(chosen)))
        })?;
        let now = Instant::now();
        Ok(LslSource {
            numbering: TimestampNumbering::new(info.rate_hz),
            info,
            reader,
            pending: None,
            next_counter: 0,
            opened: now,
            last_sample: now,
            lost: false,
            counts: SourceCounts::default(),
            clock: ClockStatistics::default(),
        })
    }

    /// Numbers a sample; none if its stamp is no time.
    fn number_sample(&mut self, arrived: ReceivedSample) -> Option<NumberedSample> {
        let ReceivedSample { mut sample, stamp_secs, arrival_secs, received, clock_offset_secs } = arrived;
        if !stamp_secs.is_finite() {
            self.counts.malformed += 1;
            return None;
        }
        let lost_before = self.numbering.lost_before(stamp_secs, arrival_secs);
        self.counts.resyncs = self.numbering.clock_resets();
        self.next_counter += lost_before;
        sample.counter = self.next_counter;
        self.next_counter += 1;
        self.clock.offset_secs = clock_offset_secs.or(self.clock.offset_secs);
        if let Some((offset_secs, _)) = self.clock.offset_secs {
            let age_secs = arrival_secs - (stamp_secs + offset_secs);
            self.clock.age_count += 1;
            self.clock.age_sum_secs += age_secs;
            self.clock.worst_age_secs = self.clock.worst_age_secs.max(age_secs);
        }
        Some(NumberedSample { sample, lost_before, received })
    }
}

impl SampleSource for LslSource {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn poll(&mut self, timeout: Duration, packet: &mut EmgPacket) -> Result<SourceEvent, DeviceError> {
        let first = match self.pending.take() {
            Some(pending) => pending,
            None => match self.reader.samples.recv_timeout(timeout) {
                Ok(arrived) => match self.number_sample(arrived) {
                    Some(sample) => sample,
                    None => return Ok(SourceEvent::Nothing),
                },
                Err(RecvTimeoutError::Timeout) => {
                    let silent = self.last_sample.elapsed();
                    if self.lost || silent < SAMPLE_TIMEOUT {
                        return Ok(SourceEvent::Nothing);
                    }
                    self.lost = true;
                    self.counts.disconnects += 1;
                    let reason = format!("no samples for {:.1} s", silent.as_secs_f64());
                    return Ok(SourceEvent::Lost { reason });
                }
                Err(RecvTimeoutError::Disconnected) => {
                    return Err(lsl_error(&self.info.name, "liblsl gave the stream up"));
                }
            },
        };
        self.last_sample = first.received;
        if std::mem::take(&mut self.lost) {
            self.pending = Some(first);
            return Ok(SourceEvent::Restored);
        }
        packet.samples.clear();
        packet.lost_before = first.lost_before;
        let mut received = first.received;
        packet.samples.push(first.sample);
        // The rest that is there, up to the next gap.
        while packet.samples.len() < MAX_PACKET_SAMPLES
            && let Ok(arrived) = self.reader.samples.try_recv()
        {
            let Some(next) = self.number_sample(arrived) else { continue };
            if next.lost_before > 0 {
                self.pending = Some(next);
                break;
            }
            received = next.received;
            packet.samples.push(next.sample);
        }
        self.last_sample = received;
        packet.received = received.saturating_duration_since(self.opened);
        let last = packet.samples.last().map_or(0, |sample| sample.counter);
        packet.device_secs = (last + 1) as f64 / self.info.rate_hz;
        self.counts.packets += 1;
        self.counts.lost_samples += packet.lost_before;
        Ok(SourceEvent::Packet)
    }

    fn counts(&self) -> SourceCounts {
        self.counts
    }

    fn clock(&self) -> Option<SourceClock> {
        let ClockStatistics { offset_secs, age_count, age_sum_secs, worst_age_secs } = self.clock;
        let (offset_secs, uncertainty_secs) = offset_secs?;
        let mean_age_secs = age_sum_secs / age_count.max(1) as f64;
        Some(SourceClock { offset_secs, uncertainty_secs, mean_age_secs, worst_age_secs })
    }
}

/// Finds the stream and subscribes to it.
fn connect(
    property: &str,
    label: &str,
    imu: bool,
) -> Result<(StreamInlet, SourceInfo, ChannelSelection), DeviceError> {
    let stream = resolve_stream(property, label)?;
    let info = check_stream(&stream).map_err(|reason| lsl_error(label, reason))?;
    let inlet = subscribe(&stream, label)?;
    let chosen = ChannelSelection::select(&describe_channels(&inlet, label)?, info.channels, imu);
    let volts_per_code = chosen.in_microvolts.then_some(1e-6);
    let info = SourceInfo {
        channels: chosen.channels.len(),
        volts_per_code,
        imu: chosen.imu.iter().map(|(_, channel)| channel.clone()).collect(),
        ..info
    };
    Ok((inlet, info, chosen))
}

/// What a stream says of a channel.
#[derive(Clone, Debug, Default)]
struct ChannelDescription {
    kind: String,
    unit: String,
    label: String,
}

/// What the stream says of each channel, as far as it does.
fn describe_channels(inlet: &StreamInlet, label: &str) -> Result<Vec<ChannelDescription>, DeviceError> {
    let mut about = inlet.info(OPEN_TIMEOUT_SECS).map_err(|error| lsl_error(label, error))?;
    let count = about.channel_count().unsigned_abs() as usize;
    let mut channel = about.desc().child("channels").child("channel");
    let mut described = Vec::new();
    while !channel.empty() && described.len() < count {
        let described_value = |key: &str| channel.child_value_named(key);
        described.push(ChannelDescription {
            kind: described_value("type"),
            unit: described_value("unit"),
            label: described_value("label"),
        });
        channel = channel.next_sibling_named("channel");
    }
    Ok(described)
}

/// Which channels of a stream are taken, and in what they are multiplied.
#[derive(Clone, Debug, PartialEq)]
struct ChannelSelection {
    channels: Vec<usize>,
    /// Those of an inertial measurement unit, where they are asked for.
    imu: Vec<(usize, ImuChannel)>,
    scale: f64,
    in_microvolts: bool,
}

impl ChannelSelection {
    /// Of a stream of `count` channels that says so much of them. Where some are of type EMG or EXG, the others (accelerometers,
    /// triggers, counters) are left out; else all are taken. Voltages become microvolts, since limits of quality are in
    /// converter's counts, and a microvolt is near one.
    fn select(described: &[ChannelDescription], count: usize, with_imu: bool) -> ChannelSelection {
        let emg = described.iter().enumerate().filter(|(_, channel)| is_emg(&channel.kind));
        let emg: Vec<usize> = emg.map(|(channel, _)| channel).collect();
        let channels = if emg.is_empty() { (0..count).collect() } else { emg };
        let named = described.iter().enumerate().filter(|(k, c)| is_imu(&c.kind) && !channels.contains(k));
        let imu = named.map(|(index, channel)| {
            let non_empty = |text: &str, otherwise: &str| match text.trim() {
                "" => otherwise.to_owned(),
                text => text.to_owned(),
            };
            // Without a unit channels of one type are taken for one sensor.
            let unit = non_empty(&channel.unit, &channel.kind);
            (
                index,
                ImuChannel { name: non_empty(&channel.label, &format!("{}_{index}", channel.kind)), unit },
            )
        });
        let imu = if with_imu { imu.collect() } else { Vec::new() };
        let unit =
            |channel: &usize| described.get(*channel).and_then(|channel| microvolts_per_unit(&channel.unit));
        let first = channels.first().and_then(unit);
        let one = first.filter(|first| channels.iter().all(|channel| unit(channel) == Some(*first)));
        ChannelSelection { channels, imu, scale: one.unwrap_or(1.0), in_microvolts: one.is_some() }
    }
}

/// What the stream is, if it can be used.
fn check_stream(stream: &StreamInfo) -> Result<SourceInfo, String> {
    let (rate_hz, channels) = (stream.nominal_srate(), stream.channel_count());
    if !RATES_HZ.contains(&rate_hz) {
        return Err(format!("its nominal rate is {rate_hz}, expected 1 to 1000000 samples per second"));
    }
    if !(1..=MAX_EMG_CHANNELS as i32).contains(&channels) {
        return Err(format!("it has {channels} channels, expected 1 to {MAX_EMG_CHANNELS}"));
    }
    if matches!(stream.channel_format(), ChannelFormat::String | ChannelFormat::Undefined) {
        return Err("its samples are texts, expected numbers".to_owned());
    }
    Ok(SourceInfo {
        name: format!("{} on {}, lab streaming layer", stream.stream_name(), stream.hostname()),
        rate_hz,
        channels: channels as usize,
        packet_samples: 1,
        zero_code: 0.0,
        rails: None,
        loss_is_counted: true,
        volts_per_code: None,
        imu: Vec::new(),
    })
}

/// Makes a sample of what was pulled, with the newest comparison of the clocks.
fn sample_converter(chosen: ChannelSelection) -> impl FnMut(&StreamInlet, &[f64], f64) -> ReceivedSample {
    let mut clock = None;
    let mut compared: Option<Instant> = None;
    move |inlet, values, stamp| {
        let period = CLOCK_QUERY_PERIODS[usize::from(clock.is_some())];
        if compared.is_none_or(|at| at.elapsed() > period) {
            // Without a time-out it does not wait, so that no sample does.
            let offset =
                inlet.time_correction_ex(0.0).ok().map(|(offset, _, uncertainty)| (offset, uncertainty));
            (clock, compared) = (offset.or(clock), Some(Instant::now()));
        }
        let value = |channel: &usize| values.get(*channel).map_or(f64::NAN, |value| value * chosen.scale);
        let imu = chosen.imu.iter().map(|(index, _)| values.get(*index).copied().unwrap_or(f64::NAN));
        let sample =
            EmgSample { counter: 0, channels: chosen.channels.iter().map(value).chain(imu).collect() };
        ReceivedSample {
            sample,
            stamp_secs: stamp,
            arrival_secs: lsl::local_clock(),
            received: Instant::now(),
            clock_offset_secs: clock,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{AmplifierLayout, LslOutlet};

    fn described(channels: &[(&str, &str)]) -> Vec<ChannelDescription> {
        let of = |(kind, unit): &(&str, &str)| ChannelDescription {
            kind: (*kind).to_owned(),
            unit: (*unit).to_owned(),
            label: String::new(),
        };
        channels.iter().map(of).collect()
    }

    #[test]
    fn channels_that_are_no_emg_are_left_out_and_voltages_become_microvolts() {
        let mixed = described(&[("EMG", "mV"), ("AUX", "g"), ("emg", "millivolts")]);
        let chosen = ChannelSelection::select(&mixed, 3, true);
        assert_eq!(chosen.imu, [], "nobody says that it is an inertial measurement unit");
        assert_eq!((&chosen.channels[..], chosen.scale, chosen.in_microvolts), (&[0, 2][..], 1e3, true));
        let of = |channels: &[ChannelDescription]| ChannelSelection::select(channels, 2, false);
        let all =
            ChannelSelection { channels: vec![0, 1], imu: Vec::new(), scale: 1.0, in_microvolts: false };
        assert_eq!(of(&[]), all, "a stream that says nothing");
        assert_eq!(of(&described(&[("EEG", "counts"), ("", "")])), all);
        assert_eq!(of(&described(&[("EMG", "V"), ("EMG", "mV")])), all, "two units are none");
        let mut worn = described(&[("EMG", "mV"), ("ACC", "g"), ("Gyroscope", ""), ("MISC", "counts")]);
        worn[1].label = "X1".to_owned();
        let chosen = ChannelSelection::select(&worn, 4, true);
        let imu = [(1, ImuChannel::new("X1", "g")), (2, ImuChannel::new("Gyroscope_2", "Gyroscope"))];
        assert_eq!((&chosen.channels[..], &chosen.imu[..]), (&[0][..], &imu[..]));
        assert_eq!(ChannelSelection::select(&worn, 4, false).imu, []);
    }

    /// The double of each amplifier is read as its page says. The grid runs at 4 kHz, its highest rate.
    #[test]
    fn doubles_of_amplifiers_come_in_with_their_channels_in_microvolts() {
        for (key, rate_hz, channels) in [("delsys", 2000.0, 16), ("otb", 4000.0, 64), ("brainflow", 250.0, 8)]
        {
            let layout = AmplifierLayout::find(key).unwrap();
            let name = format!("proact-test-{key}-{}", std::process::id());
            let info = SourceInfo {
                name: layout.device.to_owned(),
                rate_hz,
                channels: layout.channels.len(),
                packet_samples: 16,
                zero_code: 0.0,
                rails: None,
                loss_is_counted: true,
                volts_per_code: None,
                imu: Vec::new(),
            };
            let mut outlet = LslOutlet::open(&name, &info, Some(&layout)).unwrap();
            let mut source = LslSource::open(Some(&name), false).unwrap();
            let got = source.info().clone();
            assert_eq!(
                (got.rate_hz, got.channels, got.volts_per_code),
                (rate_hz, channels, Some(1e-6)),
                "{key}"
            );
            let mut codes = layout.simulated_samples(Box::new(|| [10.0; 8].into_iter().collect()), 1);
            let begin = Instant::now();
            let (mut packet, mut came) = (EmgPacket::default(), Vec::new());
            // A second of the stream, by the clock.
            for number in 0..(rate_hz / 16.0) as u64 {
                let counters = 16 * number..16 * number + 16;
                let samples = counters.map(|counter| EmgSample { counter, channels: codes() }).collect();
                let due = Duration::from_secs_f64(16.0 * (number + 1) as f64 / rate_hz);
                std::thread::sleep(due.saturating_sub(begin.elapsed()));
                outlet.packet(&EmgPacket { samples, ..EmgPacket::default() }).unwrap();
                while source.poll(Duration::ZERO, &mut packet).unwrap() == SourceEvent::Packet {
                    came.append(&mut packet.samples);
                }
            }
            while source.poll(Duration::from_millis(300), &mut packet).unwrap() == SourceEvent::Packet {
                came.append(&mut packet.samples);
            }
            // The outlet keeps the first packets back until it knows when they come.
            assert!(came.len() as f64 > 0.5 * rate_hz, "{key}: {} samples", came.len());
            assert_eq!(source.counts().lost_samples, 0, "{key}");
            // Ten codes of the simulated person are 164 uV, whatever the stream's unit.
            for sample in &came {
                assert!(sample.channels.iter().all(|value| (value - 164.0).abs() < 8.0), "{key}: {sample:?}");
            }
        }
    }
}
