use super::{OPEN_TIMEOUT_SECS, lsl_error, reader::LslReader, resolve_stream, subscribe};
use crate::{
    DeviceError,
    motion_capture::{CaptureStatus, HostClock, MotionCapture},
};
use lsl::StreamInlet;
use proact_localization::RawBodyPose;
use std::sync::mpsc::TryRecvError;

/// The type by which streams of motion capture are found (XDF, MoCap meta-data).
const MOCAP_TYPE: &str = "MoCap";
/// Samples that may wait for whoever polls.
const MAX_QUEUED_SAMPLES: usize = 4096;
/// What follows a body's name and an underscore in the labels of its channels.
const POSE_SUFFIXES: [&str; 7] = ["x", "y", "z", "qx", "qy", "qz", "qw"];

/// Poses of a stream of the lab streaming layer, whose channels are labelled `BODY_x`, `_y`, `_z`, `_qx`, `_qy`, `_qz`,
/// `_qw` for each body, and `BODY_tracked` (above 0.5) if it is there. Stamps are liblsl's.
pub struct LslCapture {
    name: String,
    reader: LslReader<Vec<RawBodyPose>>,
}

/// The channels of a body.
#[derive(Debug, PartialEq)]
struct BodyChannels {
    name: String,
    channels: [usize; 7],
    tracked: Option<usize>,
}

impl LslCapture {
    /// Opens the stream called `name`.
    ///
    /// # Errors
    /// No such stream, or several; one whose channels are no poses; no connection.
    pub fn open(name: &str, clock: HostClock) -> Result<Self, DeviceError> {
        let (reader, name) =
            LslReader::open(Some(name), MOCAP_TYPE, MAX_QUEUED_SAMPLES, move |property, label| {
                let stream = resolve_stream(property, label)?;
                let name = format!("LSL {} on {}", stream.stream_name(), stream.hostname());
                let inlet = subscribe(&stream, label)?;
                let bodies =
                    bodies_of(&channel_labels(&inlet, label)?).map_err(|reason| lsl_error(label, reason))?;
                let read = move |_: &StreamInlet, values: &[f64], stamp: f64| {
                    let arrival = clock.now();
                    bodies.iter().map(|body| body.read(values, stamp, arrival)).collect()
                };
                Ok((inlet, name, read))
            })?;
        Ok(Self { name, reader })
    }
}

impl MotionCapture for LslCapture {
    fn name(&self) -> &str {
        &self.name
    }

    fn drain_poses(&mut self, poses: &mut Vec<RawBodyPose>) -> Result<CaptureStatus, DeviceError> {
        loop {
            match self.reader.samples.try_recv() {
                Ok(sample) => poses.extend(sample),
                Err(TryRecvError::Empty) => return Ok(CaptureStatus::Connected),
                Err(TryRecvError::Disconnected) => {
                    return Err(lsl_error(&self.name, "liblsl gave the stream up"));
                }
            }
        }
    }
}

fn channel_labels(inlet: &StreamInlet, label: &str) -> Result<Vec<String>, DeviceError> {
    let mut about = inlet.info(OPEN_TIMEOUT_SECS).map_err(|error| lsl_error(label, error))?;
    let count = about.channel_count().unsigned_abs() as usize;
    let mut channel = about.desc().child("channels").child("channel");
    let mut labels = Vec::new();
    while !channel.empty() && labels.len() < count {
        labels.push(channel.child_value_named("label"));
        channel = channel.next_sibling_named("channel");
    }
    Ok(labels)
}

fn bodies_of(labels: &[String]) -> Result<Vec<BodyChannels>, String> {
    let mut bodies = Vec::new();
    for label in labels {
        let Some(name) = label.strip_suffix("_x") else { continue };
        let channel = |part: &str| labels.iter().position(|known| *known == format!("{name}_{part}"));
        let mut channels = [0; 7];
        for (channel_index, part) in channels.iter_mut().zip(POSE_SUFFIXES) {
            *channel_index =
                channel(part).ok_or_else(|| format!("body {name:?} has no channel {name}_{part}"))?;
        }
        bodies.push(BodyChannels { name: name.to_owned(), channels, tracked: channel("tracked") });
    }
    if bodies.is_empty() {
        return Err(format!(
            "its channels are labelled {labels:?}, expected BODY_x, _y, _z, _qx, _qy, _qz, _qw"
        ));
    }
    Ok(bodies)
}

impl BodyChannels {
    fn read(&self, values: &[f64], stamp: f64, arrival: i64) -> RawBodyPose {
        let value = |channel: usize| values.get(channel).copied().unwrap_or(f64::NAN);
        let [x, y, z, qx, qy, qz, qw] = self.channels.map(value);
        RawBodyPose {
            body: self.name.clone(),
            id: None,
            stamp: (stamp * 1e9) as i64,
            arrival,
            position: [x, y, z],
            quaternion: [qx, qy, qz, qw],
            tracked: self.tracked.is_none_or(|channel| value(channel) > 0.5),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lsl::{ChannelFormat, ExPushable, StreamInfo, StreamOutlet};

    #[test]
    fn bodies_are_found_by_their_labels_and_incomplete_ones_refused() {
        let labels = |words: &str| words.split(' ').map(str::to_owned).collect::<Vec<_>>();
        let found = bodies_of(&labels("pad_tracked pad_qw pad_x pad_y pad_z pad_qx pad_qy pad_qz")).unwrap();
        assert_eq!(found[0].channels, [2, 3, 4, 5, 6, 7, 1]);
        assert!(bodies_of(&labels("pad_x pad_y")).unwrap_err().contains("no channel pad_z"));
        assert!(bodies_of(&labels("emg1 emg2")).unwrap_err().contains("expected BODY_x"));
    }

    #[test]
    fn poses_of_another_program_come_in() {
        let name = format!("proact-test-mocap-{}", std::process::id());
        let mut about = StreamInfo::new(&name, MOCAP_TYPE, 7, 100.0, ChannelFormat::Double64, &name).unwrap();
        let mut list = about.desc().append_child("channels");
        for part in POSE_SUFFIXES {
            list.append_child("channel").append_child_value("label", &format!("pad_{part}"));
        }
        let outlet = StreamOutlet::new(&about, 0, 10).unwrap();
        let mut capture = LslCapture::open(&name, HostClock::start()).unwrap();
        assert!(outlet.wait_for_consumers(10.0));
        outlet.push_sample_ex(&vec![0.1, 0.2, 1.4, 0.0, 0.0, 0.0, 1.0], 12.5, true).unwrap();
        let mut poses = Vec::new();
        while poses.is_empty() {
            capture.drain_poses(&mut poses).unwrap();
            std::thread::yield_now();
        }
        assert_eq!((poses[0].body.as_str(), poses[0].position), ("pad", [0.1, 0.2, 1.4]));
    }
}
