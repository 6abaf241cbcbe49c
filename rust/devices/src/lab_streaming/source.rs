use super::{EMG_TYPE, OPEN_SECS, failed, find, numbering::Numbering, reader::Reader, subscribe};
use crate::{
    DeviceError, EmgPacket, SampleSource, SourceClock, SourceCounts, SourceEvent, SourceInfo,
    amplifier::{is_emg, is_imu, microvolts_of},
};
use lsl::{ChannelFormat, StreamInfo, StreamInlet};
use proact_emg::{ImuChannel, RATES_HZ};
use proact_types::{EmgSample, MAX_EMG_CHANNELS};
use std::{
    sync::mpsc::RecvTimeoutError,
    time::{Duration, Instant},
};

/// From one look at the clocks' comparison, which liblsl makes in the background, to the next: before there is one, and then.
const CLOCK_PERIODS: [Duration; 2] = [Duration::from_millis(200), Duration::from_secs(2)];
/// A stream without a sample for so long is lost, until one comes.
const SILENCE: Duration = Duration::from_secs(2);
/// Samples that may wait for whoever polls; those beyond leave a gap. Four seconds at 4 kHz.
const WAITING: usize = 16_384;
/// Most samples of a packet.
const PACKET: usize = 64;

/// An EMG stream of the lab streaming layer, from any program on the network.
///
/// liblsl connects anew by itself when the sender comes back. Samples are numbered by their time stamps, so that what is
/// missing in them is a gap.
pub struct LslSource {
    info: SourceInfo,
    reader: Reader<Arrived>,
    /// Came after a gap and begins the next packet.
    held: Option<EmgSampleAfter>,
    numbering: Numbering,
    next: u64,
    opened: Instant,
    heard: Instant,
    lost: bool,
    counts: SourceCounts,
    clock: ClockStatistics,
}

/// A sample as it came.
struct Arrived {
    sample: EmgSample,
    /// By the sender's clock, and when it arrived, seconds of liblsl's clock on this machine.
    stamp: f64,
    arrived: f64,
    at: Instant,
    /// The sender's clock to that of this machine, and how wrong that may be, seconds.
    offset: Option<(f64, f64)>,
}

/// A numbered sample, and what is missing before it.
struct EmgSampleAfter {
    sample: EmgSample,
    lost: u64,
    at: Instant,
}

#[derive(Default)]
struct ClockStatistics {
    offset: Option<(f64, f64)>,
    ages: u64,
    age_sum: f64,
    worst_age: f64,
}

impl LslSource {
    /// Opens the stream called `name`; without a name the only one of type EMG. Channels of an inertial measurement unit among its
    /// channels are taken if `imu`.
    ///
    /// # Errors
    /// No such stream, or several; one without a rate, with too many channels or with texts; no connection.
    pub fn open(name: Option<&str>, imu: bool) -> Result<LslSource, DeviceError> {
        let (reader, info) = Reader::open(name, EMG_TYPE, WAITING, move |property, label| {
            let (inlet, info, chosen) = connect(property, label, imu)?;
            Ok((inlet, info, arrivals(chosen)))
        })?;
        let now = Instant::now();
        Ok(LslSource {
            numbering: Numbering::new(info.rate_hz),
            info,
            reader,
            held: None,
            next: 0,
            opened: now,
            heard: now,
            lost: false,
            counts: SourceCounts::default(),
            clock: ClockStatistics::default(),
        })
    }

    /// Numbers a sample; none if its stamp is no time.
    fn number(&mut self, arrived: Arrived) -> Option<EmgSampleAfter> {
        let Arrived { mut sample, stamp, arrived, at, offset } = arrived;
        if !stamp.is_finite() {
            self.counts.malformed += 1;
            return None;
        }
        let lost = self.numbering.lost_before(stamp, arrived);
        self.counts.resyncs = self.numbering.clock_resets();
        self.next += lost;
        sample.counter = self.next;
        self.next += 1;
        self.clock.offset = offset.or(self.clock.offset);
        if let Some((offset, _)) = self.clock.offset {
            let age = arrived - (stamp + offset);
            self.clock.ages += 1;
            self.clock.age_sum += age;
            self.clock.worst_age = self.clock.worst_age.max(age);
        }
        Some(EmgSampleAfter { sample, lost, at })
    }
}

impl SampleSource for LslSource {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn poll(&mut self, timeout: Duration, packet: &mut EmgPacket) -> Result<SourceEvent, DeviceError> {
        let first = match self.held.take() {
            Some(held) => held,
            None => match self.reader.samples.recv_timeout(timeout) {
                Ok(arrived) => match self.number(arrived) {
                    Some(sample) => sample,
                    None => return Ok(SourceEvent::Nothing),
                },
                Err(RecvTimeoutError::Timeout) => {
                    let silent = self.heard.elapsed();
                    if self.lost || silent < SILENCE {
                        return Ok(SourceEvent::Nothing);
                    }
                    self.lost = true;
                    self.counts.disconnects += 1;
                    let reason = format!("no samples for {:.1} s", silent.as_secs_f64());
                    return Ok(SourceEvent::Lost { reason });
                }
                Err(RecvTimeoutError::Disconnected) => {
                    return Err(failed(&self.info.name, "liblsl gave the stream up"));
                }
            },
        };
        self.heard = first.at;
        if std::mem::take(&mut self.lost) {
            self.held = Some(first);
            return Ok(SourceEvent::Restored);
        }
        packet.samples.clear();
        packet.lost_before = first.lost;
        let mut at = first.at;
        packet.samples.push(first.sample);
        // The rest that is there, up to the next gap.
        while packet.samples.len() < PACKET
            && let Ok(arrived) = self.reader.samples.try_recv()
        {
            let Some(next) = self.number(arrived) else { continue };
            if next.lost > 0 {
                self.held = Some(next);
                break;
            }
            at = next.at;
            packet.samples.push(next.sample);
        }
        self.heard = at;
        packet.received = at.saturating_duration_since(self.opened);
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
        let ClockStatistics { offset, ages, age_sum, worst_age } = self.clock;
        let (offset_secs, uncertainty_secs) = offset?;
        let mean_age_secs = age_sum / ages.max(1) as f64;
        Some(SourceClock { offset_secs, uncertainty_secs, mean_age_secs, worst_age_secs: worst_age })
    }
}

/// Finds the stream and subscribes to it.
fn connect(property: &str, label: &str, imu: bool) -> Result<(StreamInlet, SourceInfo, Chosen), DeviceError> {
    let stream = find(property, label)?;
    let info = checked(&stream).map_err(|reason| failed(label, reason))?;
    let inlet = subscribe(&stream, label)?;
    let chosen = Chosen::of(&described(&inlet, label)?, info.channels, imu);
    let volts = chosen.in_microvolts.then_some(1e-6);
    let info = SourceInfo {
        channels: chosen.channels.len(),
        volts,
        imu: chosen.imu.iter().map(|(_, channel)| channel.clone()).collect(),
        ..info
    };
    Ok((inlet, info, chosen))
}

/// What a stream says of a channel.
#[derive(Clone, Debug, Default)]
struct Described {
    kind: String,
    unit: String,
    label: String,
}

/// What the stream says of each channel, as far as it does.
fn described(inlet: &StreamInlet, label: &str) -> Result<Vec<Described>, DeviceError> {
    let mut about = inlet.info(OPEN_SECS).map_err(|error| failed(label, error))?;
    let count = about.channel_count().unsigned_abs() as usize;
    let mut channel = about.desc().child("channels").child("channel");
    let mut described = Vec::new();
    while !channel.empty() && described.len() < count {
        let said = |key: &str| channel.child_value_named(key);
        described.push(Described { kind: said("type"), unit: said("unit"), label: said("label") });
        channel = channel.next_sibling_named("channel");
    }
    Ok(described)
}

/// Which channels of a stream are taken, and in what they are multiplied.
#[derive(Clone, Debug, PartialEq)]
struct Chosen {
    channels: Vec<usize>,
    /// Those of an inertial measurement unit, where they are asked for.
    imu: Vec<(usize, ImuChannel)>,
    factor: f64,
    in_microvolts: bool,
}

impl Chosen {
    /// Of a stream of `count` channels that says so much of them. Where some are of type EMG or EXG, the others (accelerometers,
    /// triggers, counters) are left out; else all are taken. Voltages become microvolts, since limits of quality are in
    /// converter's counts, and a microvolt is near one.
    fn of(described: &[Described], count: usize, with_imu: bool) -> Chosen {
        let emg = described.iter().enumerate().filter(|(_, channel)| is_emg(&channel.kind));
        let emg: Vec<usize> = emg.map(|(channel, _)| channel).collect();
        let channels = if emg.is_empty() { (0..count).collect() } else { emg };
        let named = described.iter().enumerate().filter(|(k, c)| is_imu(&c.kind) && !channels.contains(k));
        let imu = named.map(|(place, channel)| {
            let said = |text: &str, otherwise: &str| match text.trim() {
                "" => otherwise.to_owned(),
                text => text.to_owned(),
            };
            // Without a unit channels of one type are taken for one sensor.
            let unit = said(&channel.unit, &channel.kind);
            (place, ImuChannel { name: said(&channel.label, &format!("{}_{place}", channel.kind)), unit })
        });
        let imu = if with_imu { imu.collect() } else { Vec::new() };
        let unit = |channel: &usize| described.get(*channel).and_then(|channel| microvolts_of(&channel.unit));
        let first = channels.first().and_then(unit);
        let one = first.filter(|first| channels.iter().all(|channel| unit(channel) == Some(*first)));
        Chosen { channels, imu, factor: one.unwrap_or(1.0), in_microvolts: one.is_some() }
    }
}

/// What the stream is, if it can be used.
fn checked(stream: &StreamInfo) -> Result<SourceInfo, String> {
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
        zero: 0.0,
        rails: None,
        loss_is_counted: true,
        volts: None,
        imu: Vec::new(),
    })
}

/// Makes a sample of what was pulled, with the newest comparison of the clocks.
fn arrivals(chosen: Chosen) -> impl FnMut(&StreamInlet, &[f64], f64) -> Arrived {
    let mut clock = None;
    let mut compared: Option<Instant> = None;
    move |inlet, values, stamp| {
        let period = CLOCK_PERIODS[usize::from(clock.is_some())];
        if compared.is_none_or(|at| at.elapsed() > period) {
            // Without a time-out it does not wait, so that no sample does.
            let offset =
                inlet.time_correction_ex(0.0).ok().map(|(offset, _, uncertainty)| (offset, uncertainty));
            (clock, compared) = (offset.or(clock), Some(Instant::now()));
        }
        let value = |channel: &usize| values.get(*channel).map_or(f64::NAN, |value| value * chosen.factor);
        let imu = chosen.imu.iter().map(|(place, _)| values.get(*place).copied().unwrap_or(f64::NAN));
        let sample =
            EmgSample { counter: 0, channels: chosen.channels.iter().map(value).chain(imu).collect() };
        Arrived { sample, stamp, arrived: lsl::local_clock(), at: Instant::now(), offset: clock }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{AmplifierLayout, LslOutlet};

    fn described(channels: &[(&str, &str)]) -> Vec<Described> {
        let of = |(kind, unit): &(&str, &str)| Described {
            kind: (*kind).to_owned(),
            unit: (*unit).to_owned(),
            label: String::new(),
        };
        channels.iter().map(of).collect()
    }

    #[test]
    fn channels_that_are_no_emg_are_left_out_and_voltages_become_microvolts() {
        let mixed = described(&[("EMG", "mV"), ("AUX", "g"), ("emg", "millivolts")]);
        let chosen = Chosen::of(&mixed, 3, true);
        assert_eq!(chosen.imu, [], "nobody says that it is an inertial measurement unit");
        assert_eq!((&chosen.channels[..], chosen.factor, chosen.in_microvolts), (&[0, 2][..], 1e3, true));
        let of = |channels: &[Described]| Chosen::of(channels, 2, false);
        let all = Chosen { channels: vec![0, 1], imu: Vec::new(), factor: 1.0, in_microvolts: false };
        assert_eq!(of(&[]), all, "a stream that says nothing");
        assert_eq!(of(&described(&[("EEG", "counts"), ("", "")])), all);
        assert_eq!(of(&described(&[("EMG", "V"), ("EMG", "mV")])), all, "two units are none");
        let mut worn = described(&[("EMG", "mV"), ("ACC", "g"), ("Gyroscope", ""), ("MISC", "counts")]);
        worn[1].label = "X1".to_owned();
        let chosen = Chosen::of(&worn, 4, true);
        let imu = [(1, ImuChannel::new("X1", "g")), (2, ImuChannel::new("Gyroscope_2", "Gyroscope"))];
        assert_eq!((&chosen.channels[..], &chosen.imu[..]), (&[0][..], &imu[..]));
        assert_eq!(Chosen::of(&worn, 4, false).imu, []);
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
                zero: 0.0,
                rails: None,
                loss_is_counted: true,
                volts: None,
                imu: Vec::new(),
            };
            let mut outlet = LslOutlet::open(&name, &info, Some(&layout)).unwrap();
            let mut source = LslSource::open(Some(&name), false).unwrap();
            let got = source.info().clone();
            assert_eq!((got.rate_hz, got.channels, got.volts), (rate_hz, channels, Some(1e-6)), "{key}");
            let mut codes = layout.double(Box::new(|| [10.0; 8].into_iter().collect()), 1);
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
