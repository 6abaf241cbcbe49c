use super::{OPEN_TIMEOUT_SECS, lsl_error, reader::LslReader, resolve_stream, subscribe};
use crate::{DeviceError, GazeDevice, GazeFrame, RawGazeSample};
use lsl::{ChannelFormat, StreamInlet};
use std::sync::mpsc::TryRecvError;

/// The type by which gaze streams are found.
const GAZE_TYPE: &str = "Gaze";
/// A sample that its tracker trusts less counts as lost; Pupil Labs' own bound.
const MIN_CONFIDENCE: f64 = 0.6;
/// Samples that may wait for whoever polls, a second of the fastest trackers.
const MAX_QUEUED_SAMPLES: usize = 1024;

/// Gaze samples of a stream of the lab streaming layer, from any program on the network.
///
/// Channels are found by their labels (XDF, Gaze meta-data): `direction_x`, `_y`, `_z`, and if they are there
/// `origin_x`, `_y`, `_z`, metres, `valid` (above 0.5) and `confidence` (from 0.6); the description's value `frame` says
/// `world`, the default, or `head`. Without a direction, `gaze_point_3d_x`, `_y`, `_z` as Pupil Capture's relay sends
/// them: a point in the axes of the scene camera (x right, y down, z ahead), which is taken for the head. A sample
/// with a number that is not finite is one of a lost eye.
pub struct LslGaze {
    name: String,
    reader: LslReader<RawGazeSample>,
}

/// Which channel is what.
#[derive(Debug, PartialEq)]
struct GazeChannels {
    direction: [usize; 3],
    /// The direction is in the axes of a camera.
    in_camera_axes: bool,
    origin: Option<[usize; 3]>,
    valid: Option<usize>,
    confidence: Option<usize>,
    frame: GazeFrame,
}

impl LslGaze {
    /// Opens the stream called `name`; without a name the only one of type Gaze.
    ///
    /// # Errors
    /// No such stream, or several; one whose channels are not labelled as gaze or are texts; no connection.
    pub fn open(name: Option<&str>) -> Result<LslGaze, DeviceError> {
        let (reader, name) = LslReader::open(name, GAZE_TYPE, MAX_QUEUED_SAMPLES, |property, label| {
            let (inlet, layout, name) = connect(property, label)?;
            Ok((inlet, name, move |_: &StreamInlet, values: &[f64], _| layout.read(values)))
        })?;
        Ok(LslGaze { name, reader })
    }

    /// The stream's name and host.
    pub fn name(&self) -> &str {
        &self.name
    }
}

impl GazeDevice for LslGaze {
    fn latest(&mut self) -> Result<Option<RawGazeSample>, DeviceError> {
        let mut latest = None;
        loop {
            match self.reader.samples.try_recv() {
                Ok(sample) => latest = Some(sample),
                Err(TryRecvError::Empty) => return Ok(latest),
                Err(TryRecvError::Disconnected) => {
                    return Err(lsl_error(&self.name, "liblsl gave the stream up"));
                }
            }
        }
    }
}

/// Finds the stream, learns its channels and subscribes to it.
fn connect(property: &str, label: &str) -> Result<(StreamInlet, GazeChannels, String), DeviceError> {
    let stream = resolve_stream(property, label)?;
    let name = format!("{} on {}", stream.stream_name(), stream.hostname());
    if matches!(stream.channel_format(), ChannelFormat::String | ChannelFormat::Undefined) {
        return Err(lsl_error(label, "its samples are texts, expected numbers"));
    }
    let inlet = subscribe(&stream, label)?;
    let mut about = inlet.info(OPEN_TIMEOUT_SECS).map_err(|error| lsl_error(label, error))?;
    let count = about.channel_count().unsigned_abs() as usize;
    let description = about.desc();
    let mut channel = description.child("channels").child("channel");
    let mut labels = Vec::new();
    while !channel.empty() && labels.len() < count {
        labels.push(channel.child_value_named("label").to_lowercase());
        channel = channel.next_sibling_named("channel");
    }
    let layout = GazeChannels::from_labels(&labels, &description.child_value_named("frame"));
    Ok((inlet, layout.map_err(|reason| lsl_error(label, reason))?, name))
}

impl GazeChannels {
    fn from_labels(labels: &[String], frame: &str) -> Result<GazeChannels, String> {
        let channel = |label: &str| labels.iter().position(|known| known == label);
        let three = |label: &str| -> Option<[usize; 3]> {
            Some([
                channel(&format!("{label}_x"))?,
                channel(&format!("{label}_y"))?,
                channel(&format!("{label}_z"))?,
            ])
        };
        let named = three("direction");
        let direction = named.or_else(|| three("gaze_point_3d")).ok_or_else(|| {
            format!(
                "its channels are labelled {labels:?}, expected direction_x, direction_y and direction_z, or \
                 gaze_point_3d_x, _y and _z"
            )
        })?;
        let in_camera_axes = named.is_none();
        let frame = match frame {
            _ if in_camera_axes => GazeFrame::Head,
            "" | "world" => GazeFrame::World,
            "head" => GazeFrame::Head,
            other => return Err(format!("its frame is {other:?}, expected \"world\" or \"head\"")),
        };
        let origin = three("origin").filter(|_| !in_camera_axes);
        Ok(GazeChannels {
            direction,
            in_camera_axes,
            origin,
            valid: channel("valid"),
            confidence: channel("confidence"),
            frame,
        })
    }

    /// The gaze of a sample with a value for each channel.
    fn read(&self, values: &[f64]) -> RawGazeSample {
        let value = |channel: usize| values.get(channel).copied().unwrap_or(f64::NAN);
        let [x, y, z] = self.direction.map(value);
        let direction = if self.in_camera_axes { [z, -x, -y] } else { [x, y, z] };
        let origin = self.origin.map_or([0.0; 3], |channels| channels.map(value));
        let seen = self.valid.is_none_or(|channel| value(channel) > 0.5)
            && self.confidence.is_none_or(|channel| value(channel) >= MIN_CONFIDENCE);
        let sample = |valid| RawGazeSample::new(origin, direction, valid, self.frame);
        let lost = || RawGazeSample::new([0.0; 3], [1.0, 0.0, 0.0], false, self.frame);
        #[allow(clippy::expect_used)] // The numbers are written here.
        sample(seen).or_else(|_| lost()).expect("a lost eye is a sample")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lsl::{ExPushable, StreamInfo, StreamOutlet};
    use proact_types::Vector;

    fn labels(words: &str) -> Vec<String> {
        words.split(' ').map(str::to_owned).collect()
    }

    #[test]
    fn channels_are_found_by_label_and_others_left_out() {
        let ours = labels("valid direction_z direction_y direction_x diameter");
        let layout = GazeChannels::from_labels(&ours, "head").unwrap();
        assert_eq!((layout.direction, layout.frame), ([3, 2, 1], GazeFrame::Head));
        let sent = layout.read(&[1.0, 0.0, 2.0, 0.0, 4.5]);
        assert_eq!((sent.sample.direction, sent.sample.valid), (Vector::y(), true));
        assert!(!layout.read(&[0.0, 0.0, 2.0, 0.0, 4.5]).sample.valid, "the tracker says so");
        assert!(!layout.read(&[1.0, f64::NAN, 2.0, 0.0, 4.5]).sample.valid, "not a number");
        assert!(!layout.read(&[1.0, 0.0, 0.0, 0.0, 4.5]).sample.valid, "no direction");
        for (words, frame, part) in [
            ("direction_x direction_y", "", "expected direction_x, direction_y and direction_z"),
            ("direction_x direction_y direction_z", "moon", "its frame is \"moon\""),
        ] {
            let reason = GazeChannels::from_labels(&labels(words), frame).unwrap_err();
            assert!(reason.contains(part), "{reason}");
        }
    }

    #[test]
    fn the_relay_of_pupil_capture_is_understood() {
        let theirs = "confidence norm_pos_x norm_pos_y gaze_point_3d_x gaze_point_3d_y gaze_point_3d_z";
        let layout = GazeChannels::from_labels(&labels(theirs), "").unwrap();
        // 30 mm to the right and 40 mm down at a metre.
        let sent = layout.read(&[0.9, 0.5, 0.5, 30.0, 40.0, 1000.0]);
        let expected = Vector::new(1.0, -0.03, -0.04).normalize();
        assert!((sent.sample.direction - expected).norm() < 1e-12);
        assert_eq!((sent.sample.valid, sent.frame), (true, GazeFrame::Head));
        assert!(!layout.read(&[0.3, 0.5, 0.5, 30.0, 40.0, 1000.0]).sample.valid, "a blink");
    }

    #[test]
    fn a_stream_of_another_program_comes_in() {
        let name = format!("proact-test-gaze-{}", std::process::id());
        assert!(LslGaze::open(Some("no \" name")).is_err());
        let mut about = StreamInfo::new(&name, GAZE_TYPE, 3, 100.0, ChannelFormat::Float32, &name).unwrap();
        let mut list = about.desc().append_child("channels");
        for label in ["direction_x", "direction_y", "direction_z"] {
            list.append_child("channel").append_child_value("label", label);
        }
        about.desc().append_child_value("frame", "head");
        let outlet = StreamOutlet::new(&about, 0, 10).unwrap();
        let mut tracker = LslGaze::open(Some(&name)).unwrap();
        assert!(tracker.name().starts_with(&name));
        assert_eq!(tracker.latest().unwrap(), None);
        assert!(outlet.wait_for_consumers(10.0));
        outlet.push_sample_ex(&vec![1.0_f32, 0.0, 0.0], 0.0, true).unwrap();
        outlet.push_sample_ex(&vec![0.0_f32, 0.0, -3.0], 0.0, true).unwrap();
        // Two may come in two steps.
        let down = Vector::new(0.0, 0.0, -1.0);
        let mut newest = None;
        while newest.is_none_or(|sent: RawGazeSample| sent.sample.direction != down) {
            newest = tracker.latest().unwrap().or(newest);
            std::thread::yield_now();
        }
        assert_eq!(newest.unwrap().frame, GazeFrame::Head);
    }
}
