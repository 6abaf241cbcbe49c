//! An armband that sends a line of numbers for each sample over TCP: eight channels, separated by commas, 1000 a second.

use proact_devices::{
    DeviceError, EmgPacket, SampleSource, SourceAddress, SourceCounts, SourceEvent, SourceInfo,
    SourceOptions, SourceScheme,
};
use proact_types::EmgSample;
use std::{
    io::{self, BufRead, BufReader},
    net::TcpStream,
    time::{Duration, Instant},
};

const CHANNELS: usize = 8;
const RATE_HZ: f64 = 1000.0;
/// A line longer than this is none of the armband's, bytes.
const LONGEST_LINE: usize = 256;

/// How it is named on the command line, and opened.
pub const TEXT_BAND: SourceScheme = SourceScheme {
    scheme: "textband",
    address: SourceAddress::Required("HOST:PORT"),
    help: "our own armband: a line of eight numbers for each sample",
    open: |address, _options: &SourceOptions| Ok(Box::new(TextBand::connect(address)?)),
};

struct TextBand {
    input: BufReader<TcpStream>,
    /// The beginning of a line whose end has not come yet.
    line: Vec<u8>,
    info: SourceInfo,
    counts: SourceCounts,
    next: u64,
    opened: Instant,
}

impl TextBand {
    fn connect(address: &str) -> Result<TextBand, DeviceError> {
        let failed = |error: io::Error| unusable(address, error.to_string());
        let stream = TcpStream::connect(address).map_err(failed)?;
        let info = SourceInfo {
            name: format!("text band at {address}"),
            rate_hz: RATE_HZ,
            channels: CHANNELS,
            packet_samples: 1,
            zero_code: 0.0,
            rails: None,
            loss_is_counted: false,
            volts_per_code: None,
            imu: Vec::new(),
        };
        let (input, opened) = (BufReader::new(stream), Instant::now());
        Ok(TextBand { input, line: Vec::new(), info, counts: SourceCounts::default(), next: 0, opened })
    }
}

fn unusable(address: &str, reason: String) -> DeviceError {
    DeviceError::Source { name: format!("textband://{address}"), reason }
}

impl SampleSource for TextBand {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn poll(&mut self, timeout: Duration, packet: &mut EmgPacket) -> Result<SourceEvent, DeviceError> {
        let failed = |error: io::Error| unusable(&self.info.name, error.to_string());
        // A socket takes no timeout of zero.
        let timeout = timeout.max(Duration::from_millis(1));
        self.input.get_ref().set_read_timeout(Some(timeout)).map_err(failed)?;
        let waiting = match self.input.fill_buf() {
            Ok([]) => return Ok(SourceEvent::Ended),
            Ok(bytes) => bytes,
            Err(error) if matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut) => {
                return Ok(SourceEvent::Nothing);
            }
            Err(error) => return Ok(SourceEvent::Lost { reason: error.to_string() }),
        };
        let end = waiting.iter().position(|byte| *byte == b'\n');
        let taken = end.map_or(waiting.len(), |end| end + 1);
        self.line.extend_from_slice(&waiting[..taken]);
        self.input.consume(taken);
        if end.is_none() && self.line.len() <= LONGEST_LINE {
            return Ok(SourceEvent::Nothing);
        }
        let line = std::mem::take(&mut self.line);
        let Some(sample) = sample(&line, self.next) else {
            self.counts.malformed += 1;
            return Ok(SourceEvent::Nothing);
        };
        packet.samples.clear();
        packet.samples.push(sample);
        packet.lost_before = 0;
        packet.device_secs = self.next as f64 / RATE_HZ;
        packet.received = self.opened.elapsed();
        self.next += 1;
        self.counts.packets += 1;
        Ok(SourceEvent::Packet)
    }

    fn counts(&self) -> SourceCounts {
        self.counts
    }
}

/// A sample from its line; none if the line holds anything but eight finite numbers.
fn sample(line: &[u8], counter: u64) -> Option<EmgSample> {
    let text = std::str::from_utf8(line).ok()?;
    let number = |word: &str| word.trim().parse().ok().filter(|value: &f64| value.is_finite());
    let channels: Vec<f64> = text.split(',').map(number).collect::<Option<_>>()?;
    let channels = (channels.len() == CHANNELS).then_some(channels)?;
    Some(EmgSample { counter, channels: channels.into_iter().collect() })
}
