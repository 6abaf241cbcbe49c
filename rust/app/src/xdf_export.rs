//! A recorded trial as a file of the lab streaming layer's format.

use crate::{
    replay::{OpenedTrial, ReplayOptions, is_unstarted, open_trial},
    study::tables::trials::event_name,
};
use proact_control::MethodRegistry;
use proact_emg::{EmgConfig, EmgOutput};
use proact_files::OutputFile;
use proact_recording::{
    TrialRecord,
    xdf::{StreamId, XdfChannel, XdfStream, XdfWriter},
};
use proact_testbed::{SpanDigest, Testbed, first_divergence};
use proact_types::{EmgSample, Event, GazeSample, Pose, SimTime};
use serde::Serialize;
use std::{
    error::Error,
    io::{self, BufWriter},
    path::Path,
};

/// From one sample of the joints to the next, ticks: 100 Hz, as the control runs.
const JOINT_TICKS: u64 = 10;
/// Of the hand's and the shoulder's pose: that of the display.
const POSE_RATE_HZ: f64 = 60.0;

/// What was exported.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct XdfExportSummary {
    /// Length of the trial, s.
    pub seconds: f64,
    /// The record was closed; that of an interrupted trial is exported up to its last digest.
    pub finished: bool,
    /// In their order in the file.
    pub streams: Vec<ExportedStream>,
}

/// A stream of it.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct ExportedStream {
    /// Its name.
    pub name: String,
    /// Values of a sample.
    pub channels: usize,
    /// Samples.
    pub samples: u64,
}

/// Writes the trial in `dir` to `file`. What came in is as it was recorded; what the trial made of it is computed again, and must
/// have the recorded digests.
///
/// # Errors
/// A record that cannot be replayed or that does not agree, a file that exists, what the disk refuses. No file is left then.
pub fn export_xdf(
    methods: &MethodRegistry,
    dir: &Path,
    file: &Path,
) -> Result<XdfExportSummary, Box<dyn Error>> {
    if is_unstarted(&TrialRecord::open(dir)?) {
        return Err(format!(
            "{} was interrupted before its first digest: there is nothing to export",
            dir.display()
        )
        .into());
    }
    let mut out = OutputFile::create_new(file)?;
    let exported = write(methods, dir, BufWriter::new(&mut out))?;
    out.finish()?;
    Ok(exported)
}

fn write(
    methods: &MethodRegistry,
    dir: &Path,
    out: BufWriter<&mut OutputFile>,
) -> Result<XdfExportSummary, Box<dyn Error>> {
    let options = ReplayOptions { methods: methods.clone(), ..ReplayOptions::default() };
    let OpenedTrial { record, config, mut testbed, recorded_spans: recorded, result, .. } =
        open_trial(dir, &options)?;
    let last = record.end();
    let note = format!(
        "ProACT trial, method {}, set-up {}, seed {}",
        config.method_label(),
        config.setup.name,
        config.seed
    );
    let mut streams = XdfTrialStreams::begin(out, &note, &testbed, config.emg.as_ref())?;
    let mut spans: Vec<SpanDigest> = Vec::new();
    for tick in record.ticks()? {
        let (now, input) = tick?;
        let output = testbed.tick(&input, now == last)?;
        streams.emg(now, &input.emg, output.emg.as_deref())?;
        streams.gaze(now, input.gaze.as_ref())?;
        streams.state(now, &mut testbed)?;
        for event in &output.events {
            streams.event(event)?;
        }
        spans.extend(output.span_digest);
    }
    if let Some(divergence) = first_divergence(&recorded, &spans) {
        let (from, to) = (divergence.from.as_secs(), divergence.to.as_secs());
        return Err(format!(
            "{}: the recomputed trial is not the recorded one between {from:.3} s and {to:.3} s; `proact replay` says more",
            dir.display()
        )
        .into());
    }
    let streams = streams.finish()?;
    Ok(XdfExportSummary { seconds: last.as_secs(), finished: result.is_some(), streams })
}

/// The streams of a trial as they grow.
struct XdfTrialStreams<'a> {
    file: XdfWriter<BufWriter<&'a mut OutputFile>>,
    written: Vec<ExportedStream>,
    emg: Option<(&'a EmgConfig, StreamId, StreamId)>,
    gaze: StreamId,
    joints: StreamId,
    hand: StreamId,
    shoulder: StreamId,
    events: StreamId,
    /// Kept from window to window.
    values: Vec<f64>,
}

impl<'a> XdfTrialStreams<'a> {
    fn begin(
        out: BufWriter<&'a mut OutputFile>,
        note: &str,
        testbed: &Testbed,
        emg: Option<&'a EmgConfig>,
    ) -> io::Result<Self> {
        let mut file = XdfWriter::begin(out, note)?;
        let mut written = Vec::new();
        let mut add = |name: &str, kind: &str, rate_hz: f64, text: bool, channels: Vec<XdfChannel>| {
            written.push(ExportedStream { name: name.into(), channels: channels.len(), samples: 0 });
            file.add_stream(&XdfStream {
                name: name.into(),
                content_type: kind.into(),
                rate_hz,
                is_text: text,
                channels,
            })
        };
        let emg = match emg {
            Some(config) => {
                let electrodes = (1..=config.channels).map(|k| channel(&format!("electrode_{k}"), "", "EMG"));
                let imu = config.imu.channels.iter().map(|one| channel(&one.name, &one.unit, "IMU"));
                let raw = add("EMG", "EMG", config.rate_hz, false, electrodes.chain(imu).collect())?;
                let gestures = testbed.emg_gestures().iter();
                let gestures = gestures.map(|gesture| channel(&gesture.to_string(), "", "Probability"));
                let effort = std::iter::once(channel("effort", "", "Effort"));
                Some((
                    config,
                    raw,
                    add("Gestures", "Probability", 0.0, false, gestures.chain(effort).collect())?,
                ))
            }
            None => None,
        };
        let sight =
            ["origin_x", "origin_y", "origin_z", "direction_x", "direction_y", "direction_z", "valid"];
        let sight =
            sight.map(|name| channel(name, if name.starts_with("origin") { "m" } else { "" }, "Gaze"));
        let gaze = add("Gaze", "Gaze", 0.0, false, sight.into())?;
        let model = testbed.model();
        let angles = model.moving().map(|index| channel(&model.joints[index].name, "rad", "Angle"));
        let joints = add("Joints", "Kinematics", 1e3 / JOINT_TICKS as f64, false, angles.collect())?;
        let hand = add("Hand", "MoCap", POSE_RATE_HZ, false, pose_channels())?;
        let shoulder = add("Shoulder", "MoCap", POSE_RATE_HZ, false, pose_channels())?;
        let events = add(
            "Events",
            "Markers",
            0.0,
            true,
            vec![channel("event", "", "Marker"), channel("json", "", "Marker")],
        )?;
        Ok(Self { file, written, emg, gaze, joints, hand, shoulder, events, values: Vec::new() })
    }

    /// Samples that came in the tick `now`. The newest came then; those before it by the stream's rate earlier.
    fn emg(&mut self, now: SimTime, samples: &[EmgSample], window: Option<&EmgOutput>) -> io::Result<()> {
        let Some((config, raw, gestures)) = self.emg else { return Ok(()) };
        let expected = config.sample_channels();
        for (k, sample) in samples.iter().enumerate() {
            // One of another length is refused by the trial, too, which says so in an event.
            if sample.channels.len() == expected {
                let age = (samples.len() - 1 - k) as f64 / config.rate_hz;
                self.write_numbers(raw, now.as_secs() - age, &sample.channels)?;
            }
        }
        if let Some(window) = window {
            let mut values = std::mem::take(&mut self.values);
            values.clear();
            values.extend(window.posterior.iter().copied().chain([window.effort]));
            self.write_numbers(gestures, now.as_secs(), &values)?;
            self.values = values;
        }
        Ok(())
    }

    fn gaze(&mut self, now: SimTime, gaze: Option<&GazeSample>) -> io::Result<()> {
        let Some(GazeSample { origin, direction, valid }) = gaze else { return Ok(()) };
        let valid = f64::from(u8::from(*valid));
        let values = [origin.x, origin.y, origin.z, direction.x, direction.y, direction.z, valid];
        self.write_numbers(self.gaze, now.as_secs(), &values)
    }

    /// Joints and poses, where they are due.
    fn state(&mut self, now: SimTime, testbed: &mut Testbed) -> Result<(), Box<dyn Error>> {
        if now.0.is_multiple_of(JOINT_TICKS) {
            self.write_numbers(self.joints, now.as_secs(), &testbed.plant().state().position)?;
        }
        if testbed.frame_is_due() {
            let frame = testbed.frame(Pose::identity())?;
            self.write_numbers(self.hand, now.as_secs(), &pose_values(&frame.world_from_tip))?;
            self.write_numbers(self.shoulder, now.as_secs(), &pose_values(&frame.world_from_base))?;
        }
        Ok(())
    }

    /// Its name, and all of it as in `events.jsonl`.
    fn event(&mut self, event: &Event) -> io::Result<()> {
        self.count_sample(self.events);
        self.file.write_strings(
            self.events,
            event.time.as_secs(),
            &[&event_name(event)?, &serde_json::to_value(event)?.to_string()],
        )
    }

    fn write_numbers(&mut self, stream: StreamId, time_secs: f64, values: &[f64]) -> io::Result<()> {
        self.count_sample(stream);
        self.file.write_numbers(stream, time_secs, values)
    }

    fn count_sample(&mut self, stream: StreamId) {
        self.written[stream.index()].samples += 1;
    }

    fn finish(self) -> io::Result<Vec<ExportedStream>> {
        self.file.finish()?;
        Ok(self.written)
    }
}

fn channel(label: &str, unit: &str, kind: &str) -> XdfChannel {
    XdfChannel { label: label.into(), unit: unit.into(), channel_type: kind.into() }
}

/// Of a pose in `world`: position, then quaternion, as XDF's meta-data for motion capture name them.
fn pose_channels() -> Vec<XdfChannel> {
    let position = ["X", "Y", "Z"].map(|axis| channel(&axis.to_lowercase(), "m", &format!("Position{axis}")));
    let orientation = ["X", "Y", "Z", "W"]
        .map(|axis| channel(&format!("q{}", axis.to_lowercase()), "", &format!("Orientation{axis}")));
    position.into_iter().chain(orientation).collect()
}

fn pose_values(pose: &Pose) -> [f64; 7] {
    let (p, q) = (pose.translation.vector, pose.rotation.coords);
    [p.x, p.y, p.z, q.x, q.y, q.z, q.w]
}
