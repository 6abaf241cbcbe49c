use super::{EMG_TYPE, check_name, lsl_error};
use crate::{AmplifierLayout, DeviceError, EmgPacket, SourceInfo};
use lsl::{ChannelFormat, ExPushable, StreamInfo, StreamOutlet};
use proact_types::Gesture;

/// Type of the channels of an inertial measurement unit.
const IMU_TYPE: &str = "IMU";
/// Weight of one packet's arrival in the line from sample counter to stamp.
const TIMESTAMP_GAIN: f64 = 0.01;
/// Most by which that line moves, of the time that passes. No device's clock is further from its nominal rate, and a
/// reader must not take the move for a lost sample.
const MAX_DRIFT: f64 = 0.01;
/// Most by which it moves at once, in samples.
const MAX_STEP_SAMPLES: f64 = 0.2;
/// A packet that comes by more than this before its time follows one that had waited, seconds.
const BACKLOG_SECS: f64 = 0.005;
/// Seconds that are kept for a reader that is late.
const BUFFER_SECS: i32 = 60;

/// Publishes samples as `NAME` (type EMG) and decisions as `NAME-decisions` (type Markers, the gesture's name).
///
/// Stamps follow the device's sample counter and its packets' mean arrival: they are as even as the device's clock, and
/// what was lost is missing in them.
pub struct LslOutlet {
    samples: StreamOutlet,
    decisions: StreamOutlet,
    name: String,
    period_secs: f64,
    /// Counter and stamp of the newest sample.
    newest_stamp: Option<(u64, f64)>,
    /// Packets are known to come when they are sent.
    backlog_drained: bool,
    values: Vec<f32>,
}

impl LslOutlet {
    /// Makes both streams known on the network. The channels are described as those of `layout`, if one is given.
    ///
    /// # Errors
    /// An unusable name, or no more sockets.
    pub fn open(
        name: &str,
        info: &SourceInfo,
        layout: Option<&AmplifierLayout>,
    ) -> Result<LslOutlet, DeviceError> {
        check_name(name)?;
        let error = |error| lsl_error(name, error);
        let channels = (info.channels + info.imu.len()) as u32;
        // With the same source a reader finds the stream again when the program is started anew.
        let source = |stream: &str| format!("proact-{stream}");
        let mut about =
            StreamInfo::new(name, EMG_TYPE, channels, info.rate_hz, ChannelFormat::Float32, &source(name))
                .map_err(error)?;
        let mut list = about.desc().append_child("channels");
        for channel in 0..info.channels {
            let described = layout.and_then(|layout| layout.channels.get(channel));
            let label = described.map_or_else(|| format!("EMG{channel}"), |known| known.label.clone());
            list.append_child("channel")
                .append_child_value("label", &label)
                .append_child_value("unit", described.map_or("counts", |known| known.unit))
                .append_child_value("type", described.map_or(EMG_TYPE, |known| known.kind));
        }
        for channel in &info.imu {
            list.append_child("channel")
                .append_child_value("label", &channel.name)
                .append_child_value("unit", &channel.unit)
                .append_child_value("type", IMU_TYPE);
        }
        about.desc().append_child_value("device", &info.name);
        let samples = StreamOutlet::new(&about, 0, BUFFER_SECS).map_err(error)?;
        let markers = format!("{name}-decisions");
        let about = StreamInfo::new(
            &markers,
            "Markers",
            1,
            lsl::IRREGULAR_RATE,
            ChannelFormat::String,
            &source(&markers),
        )
        .map_err(error)?;
        let decisions = StreamOutlet::new(&about, 0, BUFFER_SECS).map_err(error)?;
        let (period_secs, values) = (1.0 / info.rate_hz, Vec::with_capacity(info.channels));
        Ok(LslOutlet {
            samples,
            decisions,
            name: name.to_owned(),
            period_secs,
            newest_stamp: None,
            backlog_drained: false,
            values,
        })
    }

    /// Somebody reads the samples.
    pub fn has_readers(&self) -> bool {
        self.samples.have_consumers()
    }

    /// Publishes a packet that has just arrived. The first ones, which may have waited for somebody to take them, are not
    /// published: their arrival says nothing about their time.
    ///
    /// # Errors
    /// liblsl refuses it.
    pub fn packet(&mut self, packet: &EmgPacket) -> Result<(), DeviceError> {
        let Some(last) = packet.samples.last() else { return Ok(()) };
        let now = lsl::local_clock();
        let passed = self.newest_stamp.map(|(counter, stamp)| (last.counter as f64 - counter as f64, stamp));
        let due = passed.map_or(f64::INFINITY, |(samples, stamp)| stamp + samples * self.period_secs);
        self.backlog_drained |= now > due - BACKLOG_SECS;
        if !self.backlog_drained {
            self.newest_stamp = Some((last.counter, now));
            return Ok(());
        }
        let samples = passed.map_or(0.0, |(samples, _)| samples.max(0.0));
        let max_correction = (MAX_DRIFT * samples).min(MAX_STEP_SAMPLES) * self.period_secs;
        let end = due + (TIMESTAMP_GAIN * (now - due)).clamp(-max_correction, max_correction);
        self.newest_stamp = Some((last.counter, end));
        for sample in &packet.samples {
            self.values.clear();
            self.values.extend(sample.channels.iter().map(|value| *value as f32));
            let stamp = end - (last.counter - sample.counter) as f64 * self.period_secs;
            let pushed = self.samples.push_sample_ex(&self.values, stamp, sample.counter == last.counter);
            pushed.map_err(|error| lsl_error(&self.name, error))?;
        }
        Ok(())
    }

    /// Publishes a decision; `counter` is that of its window's last sample. Without one it is stamped now.
    ///
    /// # Errors
    /// liblsl refuses it.
    pub fn decision(&mut self, gesture: Gesture, counter: Option<u64>) -> Result<(), DeviceError> {
        let stamp = match (counter, self.newest_stamp) {
            (Some(counter), Some((newest, end))) => {
                end - newest.saturating_sub(counter) as f64 * self.period_secs
            }
            _ => lsl::local_clock(),
        };
        let pushed = self.decisions.push_sample_ex(&vec![gesture.as_str()], stamp, true);
        pushed.map_err(|error| lsl_error(&self.name, error))
    }
}
