use super::{check_name, lsl_error};
use crate::DeviceError;
use lsl::{ChannelFormat, ExPushable, StreamInfo, StreamOutlet};

/// Markers that are kept for a reader that is late.
const MAX_BUFFERED_MARKERS: i32 = 360;

/// Publishes markers as `NAME` (type Markers, one string channel at irregular times), as programs of experiments do.
pub struct LslMarkers {
    outlet: StreamOutlet,
    name: String,
}

impl LslMarkers {
    /// Makes the stream known on the network.
    ///
    /// # Errors
    /// An unusable name, or no more sockets.
    pub fn open(name: &str) -> Result<LslMarkers, DeviceError> {
        check_name(name)?;
        let error = |error| lsl_error(name, error);
        // With the same source a reader finds the stream again when the program is started anew.
        let source = format!("proact-{name}");
        let about = StreamInfo::new(name, "Markers", 1, lsl::IRREGULAR_RATE, ChannelFormat::String, &source)
            .map_err(error)?;
        let outlet = StreamOutlet::new(&about, 0, MAX_BUFFERED_MARKERS).map_err(error)?;
        Ok(LslMarkers { outlet, name: name.to_owned() })
    }

    /// Publishes a marker that was due `age_secs` ago, which is what its stamp says.
    ///
    /// # Errors
    /// liblsl refuses it.
    pub fn send(&mut self, marker: &str, age_secs: f64) -> Result<(), DeviceError> {
        let stamp = lsl::local_clock() - age_secs;
        self.outlet.push_sample_ex(&vec![marker], stamp, true).map_err(|error| lsl_error(&self.name, error))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lab_streaming::{resolve_stream, subscribe};
    use lsl::Pullable;

    /// How long a marker has to come.
    const TIMEOUT_SECS: f64 = 10.0;
    /// Clocks of one machine differ by no more, s.
    const CLOCKS_SECS: f64 = 0.05;

    #[test]
    fn a_marker_comes_as_text_with_the_time_at_which_it_was_due() {
        let name = format!("proact-test-markers-{}", std::process::id());
        let mut markers = LslMarkers::open(&name).unwrap();
        let found = resolve_stream("name", &name).unwrap();
        assert_eq!((found.stream_type(), found.channel_count()), ("Markers".to_owned(), 1));
        let inlet = subscribe(&found, &name).unwrap();
        assert!(markers.outlet.wait_for_consumers(TIMEOUT_SECS));
        let before = lsl::local_clock();
        markers.send("1", 2.0).unwrap();
        let (sample, stamp): (Vec<String>, f64) = inlet.pull_sample(TIMEOUT_SECS).unwrap();
        assert_eq!(sample, ["1"]);
        assert!((stamp - (before - 2.0)).abs() < CLOCKS_SECS, "{stamp} after {before}");
        assert!(LslMarkers::open("").is_err());
    }
}
