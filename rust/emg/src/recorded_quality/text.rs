//! Findings as sentences: what, where, and what to do.

use super::{Coincidence, RecordedFault};
use crate::{ChannelFault, Light};
use std::fmt;

/// Recordings that a sentence names.
const NAMED: usize = 4;

impl fmt::Display for RecordedFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let remove = "remove the column";
        match self {
            RecordedFault::Channel { channel, light, finding, recordings, of, coincides, .. } => {
                let light = if *light == Light::Red { "red" } else { "amber" };
                let named = recordings
                    .iter()
                    .take(NAMED)
                    .map(|(gesture, repetition)| format!("{gesture} {repetition}"));
                let more = if recordings.len() > NAMED { ", ..." } else { "" };
                write!(
                    f,
                    "channel {channel} is {light} ({}) in {} of {of} recordings: {}{more}{}{}; {}",
                    finding.text(),
                    recordings.len(),
                    named.collect::<Vec<_>>().join(", "),
                    self.place(),
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
            RecordedFault::Noisy { channel, times, .. } => write!(
                f,
                "channel {channel} is noisy: {times:.1} times as loud at rest as the others, and no louder in any gesture{}; look at its electrode, and \
                 record again",
                self.place()
            ),
            RecordedFault::TimeStamps { channel, .. } => write!(
                f,
                "channel {channel} only rises: a column of time stamps or counters, not a muscle{}; {remove}",
                self.place()
            ),
            RecordedFault::Counter { channel, .. } => write!(
                f,
                "channel {channel} counts: a column of sample numbers or of a clock, not a muscle{}; {remove}",
                self.place()
            ),
            RecordedFault::Label { channel, .. } => write!(
                f,
                "channel {channel} holds one value in each recording: a column of labels, not a muscle{}; {remove}",
                self.place()
            ),
            RecordedFault::Orientation { channels, length, .. } => write!(
                f,
                "channels {} keep the length {length:.3} together: an orientation (quaternion), not muscles{}; {}",
                list(channels),
                self.place(),
                BESIDE
            ),
            RecordedFault::Acceleration { channels, length, .. } => write!(
                f,
                "channels {} keep the length {length:.3} together: an acceleration or a magnetic field, not muscles{}; {}",
                list(channels),
                self.place(),
                BESIDE
            ),
            RecordedFault::Slow { channel, share, most, .. } => {
                let percent = 100.0 * share;
                let what = match most {
                    false => format!("an acceleration, an orientation or a level that drifts, not a muscle; {BESIDE}"),
                    true => "an envelope, or an electrode without a high pass: filter it with --filter highpass:20 \
                             unless it is an envelope"
                        .to_owned(),
                };
                write!(
                    f,
                    "channel {channel} moves slowly, {percent:.0} % of its variance lies below 10 Hz{}: {what}",
                    self.place()
                )
            }
            RecordedFault::Held { share, longest, recordings, of, .. } => write!(
                f,
                "{:.0} % of the rows of {recordings} of {of} recordings repeat the row before, up to {longest} equal rows{}: the \
                 reader was faster than the device; write each sample once, with the device's own rate",
                100.0 * share,
                self.place()
            ),
            RecordedFault::Shared { first, second, samples, of, .. } => write!(
                f,
                "repetition {} of {} has {samples} of its {of} samples in common with repetition {} of {}{}: training and \
                 test would overlap; leave one of them out",
                second.1,
                second.0,
                first.1,
                first.0,
                self.place()
            ),
            RecordedFault::RateKey { keys, assumed_hz } => write!(
                f,
                "the metadata has the unknown key {}, which may say the rate or the sampling interval, while {assumed_hz} Hz \
                 is assumed; write the rate under the key rate_hz, or give it with --emg-rate",
                keys.join(", ")
            ),
        }
    }
}

/// What to do with the columns of another sensor.
const BESIDE: &str = "remove these columns, or put them into files of their own for --imu";

impl RecordedFault {
    /// In which files it was found, in brackets.
    fn place(&self) -> String {
        let files = self.files();
        let named = files.iter().take(NAMED).map(String::as_str).collect::<Vec<_>>().join(", ");
        match files.len() {
            0 => String::new(),
            count if count > NAMED => format!(" ({named} and {} more files)", count - NAMED),
            _ => format!(" ({named})"),
        }
    }

    /// The files in which it was found.
    pub fn files(&self) -> &[String] {
        match self {
            RecordedFault::Channel { files, .. }
            | RecordedFault::Noisy { files, .. }
            | RecordedFault::TimeStamps { files, .. }
            | RecordedFault::Counter { files, .. }
            | RecordedFault::Label { files, .. }
            | RecordedFault::Orientation { files, .. }
            | RecordedFault::Acceleration { files, .. }
            | RecordedFault::Slow { files, .. }
            | RecordedFault::Held { files, .. }
            | RecordedFault::Shared { files, .. } => files,
            RecordedFault::RateKey { .. } => &[],
        }
    }
}

fn list(channels: &[usize]) -> String {
    channels.iter().map(usize::to_string).collect::<Vec<_>>().join(", ")
}
