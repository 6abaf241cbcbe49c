//! A live source, centred as its model wants it.

use proact_devices::{EmgPacket, SampleSource, SourceEvent, SourceInfo};
use proact_emg::{EmgModel, StreamFormat};
use proact_types::{EmgSample, SimTime};
use std::{
    error::Error,
    time::{Duration, Instant},
};

/// Longest wait for an event.
const TIMEOUT: Duration = Duration::from_millis(20);

/// What a source brings, with the zero level subtracted and the time of each event.
pub struct OffsetCorrectedStream {
    /// Where it comes from.
    pub source: Box<dyn SampleSource>,
    /// What is subtracted from each channel.
    pub dc_offsets: Vec<f64>,
    /// The newest packet, without samples if the newest event was none.
    pub packet: EmgPacket,
    /// Time of the newest event. It never goes back, whichever clock it is read from.
    pub now: SimTime,
    offset_check: Option<DcOffsetCheck>,
    started: Instant,
}

impl OffsetCorrectedStream {
    /// `source`, centred at `zero` if that is given, else as `model` was.
    pub fn new(source: Box<dyn SampleSource>, zero: Option<f64>, model: &EmgModel) -> OffsetCorrectedStream {
        let info = source.info();
        OffsetCorrectedStream {
            dc_offsets: channel_dc_offsets(zero, info, model),
            offset_check: DcOffsetCheck::new(zero, info, model),
            source,
            packet: EmgPacket::default(),
            now: SimTime(0),
            started: Instant::now(),
        }
    }

    /// Seconds since the stream was opened, on the host's clock.
    pub fn elapsed_secs(&self) -> f64 {
        self.started.elapsed().as_secs_f64()
    }

    /// Waits for the next event. `raw` sees a packet before it is centred.
    ///
    /// # Errors
    /// Those of the source and of `raw`; a stream that rests elsewhere than its model.
    pub fn next(
        &mut self,
        raw: impl FnOnce(&EmgPacket) -> Result<(), Box<dyn Error>>,
    ) -> Result<SourceEvent, Box<dyn Error>> {
        let event = self.source.poll(TIMEOUT, &mut self.packet)?;
        if event != SourceEvent::Packet {
            self.packet.samples.clear();
            self.now = self.now.max(SimTime(self.started.elapsed().as_millis() as u64));
            return Ok(event);
        }
        self.now = self.now.max(SimTime(self.packet.received.as_millis() as u64));
        raw(&self.packet)?;
        for sample in &mut self.packet.samples {
            if let Some(check) = &mut self.offset_check
                && check.push(sample)?
            {
                self.offset_check = None;
            }
            sample.channels.iter_mut().zip(&self.dc_offsets).for_each(|(value, zero)| *value -= zero);
        }
        Ok(event)
    }
}

/// What is subtracted from each channel. A model whose zero levels are all 0 was trained on centred samples.
fn channel_dc_offsets(zero: Option<f64>, info: &SourceInfo, model: &EmgModel) -> Vec<f64> {
    match zero {
        Some(zero) => vec![zero; info.channels],
        None if model.dc_offset.iter().any(|level| *level != 0.0) => model.dc_offset.clone(),
        None => vec![info.zero_code; info.channels],
    }
}

/// Seconds of a stream over which its zero level is compared with the model's.
const OFFSET_CHECK_SECS: f64 = 2.0;

/// Compares the zero level of the first seconds of a stream with that of its model. Muscles move about zero, so the
/// median of whatever the person does is near it.
struct DcOffsetCheck {
    model: EmgModel,
    stream: StreamFormat,
    values: Vec<Vec<f64>>,
    samples_needed: usize,
}

impl DcOffsetCheck {
    /// A check of the raw stream `info`; none where the zero level is given, or the model was trained on centred
    /// samples and does not know raw levels.
    fn new(zero: Option<f64>, info: &SourceInfo, model: &EmgModel) -> Option<DcOffsetCheck> {
        let raw = zero.is_none() && model.dc_offset.iter().any(|level| *level != 0.0);
        raw.then(|| DcOffsetCheck {
            model: model.clone(),
            stream: StreamFormat {
                rate_hz: info.rate_hz,
                channels: info.channels,
                rest_medians: None,
                imu: info.imu.clone(),
            },
            values: vec![Vec::new(); info.channels],
            samples_needed: (OFFSET_CHECK_SECS * info.rate_hz) as usize,
        })
    }

    /// Takes a raw sample. True once the check is done.
    ///
    /// # Errors
    /// The stream rests elsewhere than the model.
    fn push(&mut self, sample: &EmgSample) -> Result<bool, Box<dyn Error>> {
        for (values, value) in self.values.iter_mut().zip(&sample.channels) {
            values.push(*value);
        }
        if self.values.first().is_none_or(|v| v.len() < self.samples_needed) {
            return Ok(false);
        }
        let medians = self.values.iter_mut().map(|values| {
            values.sort_unstable_by(f64::total_cmp);
            values[values.len() / 2]
        });
        self.stream.rest_medians = Some(medians.collect());
        self.model.check_stream_format(&self.stream)?;
        Ok(true)
    }
}
