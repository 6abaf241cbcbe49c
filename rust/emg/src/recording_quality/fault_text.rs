//! Findings as sentences: what, where, and what to do.

use super::{Coincidence, RecordingFault};
use crate::{ChannelFault, ChannelStatus};
use std::fmt;

/// Recordings that a sentence names.
const MAX_NAMED_RECORDINGS: usize = 4;

impl fmt::Display for RecordingFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let remove = "remove the column";
        match self {
            RecordingFault::Channel {
                channel,
                status: light,
                finding,
                recordings,
                recording_count: of,
                coincidence: coincides,
                ..
            } => {
                let light = if *light == ChannelStatus::Red { "red" } else { "amber" };
                let named = recordings
                    .iter()
                    .take(MAX_NAMED_RECORDINGS)
                    .map(|(gesture, repetition)| format!("{gesture} {repetition}"));
                let more = if recordings.len() > MAX_NAMED_RECORDINGS { ", ..." } else { "" };
                write!(
                    f,
                    "channel {channel} is {light} ({}) in {} of {of} recordings: {}{more}{}{}; {}",
                    finding.text(),
                    recordings.len(),
                    named.collect::<Vec<_>>().join(", "),
                    self.files_in_brackets(),
                    match coincides {
                        Some(Coincidence::Gesture(gesture)) =>
                            format!(", which tells {gesture} from the others"),
                        Some(Coincidence::Repetition(number)) =>
                            format!(", which sets repetition {number} apart"),
                        None => String::new(),
                    },
                    match finding {
                        ChannelFault::Mains => "look at electrode, ground and cable, and record again",
                        ChannelFault::Railed => "lower the gain, and record again",
                        _ => "look at electrode and cable, and record again, or remove the column",
                    }
                )
            }
            RecordingFault::Noisy { channel, ratio: times, .. } => write!(
                f,
                "channel {channel} is noisy: {times:.1} times as loud at rest as the others, and no louder in any gesture{}; look at its electrode, and \
                 record again",
                self.files_in_brackets()
            ),
            RecordingFault::TimeStamps { channel, .. } => write!(
                f,
                "channel {channel} only rises: a column of time stamps or counters, not a muscle{}; {remove}",
                self.files_in_brackets()
            ),
            RecordingFault::Counter { channel, .. } => write!(
                f,
                "channel {channel} counts: a column of sample numbers or of a clock, not a muscle{}; {remove}",
                self.files_in_brackets()
            ),
            RecordingFault::Label { channel, .. } => write!(
                f,
                "channel {channel} holds one value in each recording: a column of labels, not a muscle{}; {remove}",
                self.files_in_brackets()
            ),
            RecordingFault::LabelWithin { channel, ratio: times, .. } => write!(
                f,
                "the level of channel {channel} tells the gesture: levels are {times:.1} times as far apart as its samples spread{}: a label \
                 with noise, or one added to an electrode; {remove}, or filter it with --filter highpass:20 if its level drifts",
                self.files_in_brackets()
            ),
            RecordingFault::Orientation { channels, length, .. } => write!(
                f,
                "channels {} keep the length {length:.3} together: an orientation (quaternion), not muscles{}; {}",
                list(channels),
                self.files_in_brackets(),
                OTHER_SENSOR_ADVICE
            ),
            RecordingFault::Acceleration { channels, length, .. } => write!(
                f,
                "channels {} keep the length {length:.3} together: an acceleration or a magnetic field, not muscles{}; {}",
                list(channels),
                self.files_in_brackets(),
                OTHER_SENSOR_ADVICE
            ),
            RecordingFault::Slow { channel, share, is_majority_slow: is_majority, .. } => {
                let percent = 100.0 * share;
                let what = match is_majority {
                    false => format!("an acceleration, a turn rate, an orientation or a level that drifts, not a muscle; {OTHER_SENSOR_ADVICE}"),
                    true => "an envelope, or an electrode without a high pass: filter it with --filter highpass:20 \
                             unless it is an envelope"
                        .to_owned(),
                };
                write!(
                    f,
                    "channel {channel} moves slowly, {percent:.0} % of its variance lies below 15 Hz{}: {what}",
                    self.files_in_brackets()
                )
            }
            RecordingFault::RepeatedRows { share, max_run, recordings, recording_count: of, .. } => write!(
                f,
                "{:.0} % of the rows of {recordings} of {of} recordings repeat the row before, up to {max_run} equal rows{}: the \
                 reader was faster than the device; write each sample once, with the device's own rate",
                100.0 * share,
                self.files_in_brackets()
            ),
            RecordingFault::RepeatedSamples { channels, share, .. } => write!(
                f,
                "channels {} keep their value in {:.0} % of their samples while others go on{}: a slower reader held them; write each sample once, \
                 with the device's own rate, or remove the columns",
                list(channels),
                100.0 * share,
                self.files_in_brackets()
            ),
            RecordingFault::Interpolated { channels, share, .. } => write!(
                f,
                "{:.0} % of the samples of channels {} lie on straight lines between others{}: the stream was interpolated; write what the \
                 device measured, with its own rate",
                100.0 * share,
                list(channels),
                self.files_in_brackets()
            ),
            RecordingFault::CopiedRecording { first, second, samples, later_samples: of, .. } => write!(
                f,
                "repetition {} of {} has {samples} of its {of} samples in common with repetition {} of {}{}: training and \
                 test would overlap; leave one of them out",
                second.1,
                second.0,
                first.1,
                first.0,
                self.files_in_brackets()
            ),
            RecordingFault::AlteredCopy {
                first, second, correlation, speed, backwards, rotation, ..
            } => {
                let mut how = vec![format!("correlation {correlation:.2}")];
                if *speed != 1.0 {
                    how.push(format!("at {speed:.2} times the speed"));
                }
                if *backwards {
                    how.push("backwards".to_owned());
                }
                if *rotation > 0 {
                    how.push(format!("channels moved on by {rotation}"));
                }
                write!(
                    f,
                    "repetition {} of {} is repetition {} of {} altered ({}){}: training and test would overlap; leave one of them out",
                    second.1,
                    second.0,
                    first.1,
                    first.0,
                    how.join(", "),
                    self.files_in_brackets()
                )
            }
            RecordingFault::AmplitudeMismatch { ratio: times } => {
                let times = if *times < 0.01 { format!("{times:.1e}") } else { format!("{times:.2}") };
                write!(
                    f,
                    "the stream is {times} times as loud as the loudest recording that its model was trained with: another unit or \
                     gain; train with this armband and these settings"
                )
            }
            RecordingFault::RateMismatch { measured_hz, nominal_hz } => write!(
                f,
                "the stream has {measured_hz:.0} samples a second, and its source says {nominal_hz}: windows are as long as they were in \
                 training only at the right rate; correct the rate, or train at this one"
            ),
            RecordingFault::UnknownRateKey { keys, assumed_hz } => write!(
                f,
                "the metadata has the unknown key {}, which may say the rate or the sampling interval, while {assumed_hz} Hz \
                 is assumed; write the rate under the key rate_hz, or give it with --emg-rate",
                keys.join(", ")
            ),
        }
    }
}

/// What to do with the columns of another sensor.
const OTHER_SENSOR_ADVICE: &str = "remove these columns, or put them into files of their own for --imu";

impl RecordingFault {
    /// In which files it was found, in brackets.
    fn files_in_brackets(&self) -> String {
        let files = self.files();
        let named =
            files.iter().take(MAX_NAMED_RECORDINGS).map(String::as_str).collect::<Vec<_>>().join(", ");
        match files.len() {
            0 => String::new(),
            count if count > MAX_NAMED_RECORDINGS => {
                format!(" ({named} and {} more files)", count - MAX_NAMED_RECORDINGS)
            }
            _ => format!(" ({named})"),
        }
    }

    /// The files in which it was found.
    pub fn files(&self) -> &[String] {
        match self {
            RecordingFault::Channel { files, .. }
            | RecordingFault::Noisy { files, .. }
            | RecordingFault::TimeStamps { files, .. }
            | RecordingFault::Counter { files, .. }
            | RecordingFault::Label { files, .. }
            | RecordingFault::LabelWithin { files, .. }
            | RecordingFault::Orientation { files, .. }
            | RecordingFault::Acceleration { files, .. }
            | RecordingFault::Slow { files, .. }
            | RecordingFault::RepeatedRows { files, .. }
            | RecordingFault::RepeatedSamples { files, .. }
            | RecordingFault::Interpolated { files, .. }
            | RecordingFault::CopiedRecording { files, .. }
            | RecordingFault::AlteredCopy { files, .. } => files,
            RecordingFault::AmplitudeMismatch { .. }
            | RecordingFault::RateMismatch { .. }
            | RecordingFault::UnknownRateKey { .. } => &[],
        }
    }
}

fn list(channels: &[usize]) -> String {
    channels.iter().map(usize::to_string).collect::<Vec<_>>().join(", ")
}
