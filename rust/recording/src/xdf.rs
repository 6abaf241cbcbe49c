//! Files of the format XDF 1.0, as the lab streaming layer's recorder writes them: streams of numbers or of words, each value with
//! its time. Layout: github.com/sccn/xdf, Specifications.
//!
//! The file is `XDF:` and then chunks: length, tag, content. Numbers are little-endian.
//!
//! ```
//! use proact_recording::xdf::{XdfChannel, XdfStream, XdfWriter};
//!
//! let mut file = XdfWriter::begin(Vec::new(), "trial seed1")?;
//! let angle = XdfChannel { label: "elbow".into(), unit: "rad".into(), channel_type: "Angle".into() };
//! let joints = file.add_stream(&XdfStream { name: "Joints".into(), content_type: "Kinematics".into(), rate_hz: 100.0, is_text: false, channels: vec![angle] })?;
//! file.write_numbers(joints, 0.01, &[0.5])?;
//! let bytes = file.finish()?;
//! assert_eq!(&bytes[..4], b"XDF:");
//! # Ok::<(), std::io::Error>(())
//! ```

use std::io::{self, Write};

/// What a file begins with.
const MAGIC: &[u8; 4] = b"XDF:";
/// Content of a boundary chunk, by which a reader finds its place again in a damaged file.
const BOUNDARY: [u8; 16] =
    [0x43, 0xA5, 0x46, 0xDC, 0xCB, 0xF5, 0x41, 0x0F, 0xB3, 0x0E, 0xD5, 0x46, 0x73, 0x83, 0xCB, 0xE4];
/// Samples of a stream are collected for so long, seconds, before they become a chunk.
const CHUNK_SECS: f64 = 1.0;
/// From one boundary to the next, seconds, and from one clock offset of a stream to the next, as LabRecorder's.
const BOUNDARY_SECS: f64 = 10.0;
const OFFSET_SECS: f64 = 5.0;

/// Kinds of chunk.
#[derive(Clone, Copy)]
enum XdfChunkTag {
    FileHeader = 1,
    StreamHeader = 2,
    Samples = 3,
    ClockOffset = 4,
    Boundary = 5,
    StreamFooter = 6,
}

/// What a stream is.
#[derive(Clone, Debug, PartialEq)]
pub struct XdfStream {
    /// By which it is found, such as `EMG`.
    pub name: String,
    /// Its content type, such as `EMG`, `Gaze`, `MoCap`, `Markers`.
    pub content_type: String,
    /// Samples per second; 0 where they come when they come.
    pub rate_hz: f64,
    /// Its values are words (channel format `string`), not numbers (`double64`).
    pub is_text: bool,
    /// One value of each makes a sample.
    pub channels: Vec<XdfChannel>,
}

/// One channel of a stream.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct XdfChannel {
    /// Its name.
    pub label: String,
    /// Such as `rad`; empty where there is none.
    pub unit: String,
    /// Such as `EMG`, `Angle`, `PositionX`.
    pub channel_type: String,
}

/// The number of a stream in its file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StreamId(usize);

/// A file as it is written. Times are seconds from the start of the trial, and of one clock: the offsets in the file are zero.
#[derive(Debug)]
pub struct XdfWriter<W: Write> {
    out: W,
    streams: Vec<XdfStreamBuffer>,
    boundary_secs: f64,
}

/// A stream as it grows.
#[derive(Debug)]
struct XdfStreamBuffer {
    is_text: bool,
    channels: usize,
    rate_hz: f64,
    /// Samples that are not in the file yet, in the form of its chunks, and how many they are.
    pending_samples: Vec<u8>,
    pending_count: u64,
    pending_since_secs: f64,
    /// First and last time, seconds.
    span: Option<[f64; 2]>,
    count: u64,
    /// When offsets were written, seconds.
    offsets: Vec<f64>,
}

impl<W: Write> XdfWriter<W> {
    /// Begins a file; `note` says what was recorded.
    ///
    /// # Errors
    /// What the output refuses.
    pub fn begin(out: W, note: &str) -> io::Result<Self> {
        let mut file = Self { out, streams: Vec::new(), boundary_secs: 0.0 };
        file.out.write_all(MAGIC)?;
        let header = format!("<info><version>1.0</version><note>{}</note></info>", escape_xml(note));
        file.write_chunk(XdfChunkTag::FileHeader, &[xml(&header).as_bytes()])?;
        Ok(file)
    }

    /// Adds a stream.
    ///
    /// # Errors
    /// What the output refuses.
    pub fn add_stream(&mut self, stream: &XdfStream) -> io::Result<StreamId> {
        let id = StreamId(self.streams.len());
        let channels = stream.channels.iter().fold(String::new(), |text, channel| {
            let [label, unit, kind] =
                [&channel.label, &channel.unit, &channel.channel_type].map(|text| escape_xml(text));
            format!("{text}<channel><label>{label}</label><unit>{unit}</unit><type>{kind}</type></channel>")
        });
        let header = format!(
            "<info><name>{name}</name><type>{kind}</type><channel_count>{count}</channel_count><nominal_srate>{rate}</nominal_srate>\
             <channel_format>{format}</channel_format><source_id>proact-{name}</source_id><created_at>0</created_at>\
             <desc><channels>{channels}</channels><manufacturer>ProACT</manufacturer></desc></info>",
            name = escape_xml(&stream.name),
            kind = escape_xml(&stream.content_type),
            count = stream.channels.len(),
            rate = stream.rate_hz,
            format = if stream.is_text { "string" } else { "double64" },
        );
        self.write_chunk(XdfChunkTag::StreamHeader, &[&id.bytes(), xml(&header).as_bytes()])?;
        self.streams.push(XdfStreamBuffer {
            is_text: stream.is_text,
            channels: stream.channels.len(),
            rate_hz: stream.rate_hz,
            pending_samples: Vec::new(),
            pending_count: 0,
            pending_since_secs: 0.0,
            span: None,
            count: 0,
            offsets: Vec::new(),
        });
        Ok(id)
    }

    /// Adds a sample of a stream of numbers.
    ///
    /// # Errors
    /// Another number of values than the stream has channels, a stream of words, what the output refuses.
    pub fn write_numbers(&mut self, id: StreamId, time_secs: f64, values: &[f64]) -> io::Result<()> {
        self.begin_sample(id, time_secs, values.len(), false)?;
        let waiting = &mut self.streams[id.0].pending_samples;
        waiting.extend(values.iter().flat_map(|value| value.to_le_bytes()));
        Ok(())
    }

    /// Adds a sample of a stream of words.
    ///
    /// # Errors
    /// Another number of words than the stream has channels, a stream of numbers, what the output refuses.
    pub fn write_strings(&mut self, id: StreamId, time_secs: f64, words: &[&str]) -> io::Result<()> {
        self.begin_sample(id, time_secs, words.len(), true)?;
        let waiting = &mut self.streams[id.0].pending_samples;
        for word in words {
            waiting.extend(encode_length(word.len() as u64));
            waiting.extend(word.as_bytes());
        }
        Ok(())
    }

    /// Ends the file and returns the output.
    ///
    /// # Errors
    /// What the output refuses.
    pub fn finish(mut self) -> io::Result<W> {
        for index in 0..self.streams.len() {
            self.write_pending_chunk(index)?;
            let stream = &self.streams[index];
            let [first, last] = stream.span.unwrap_or_default();
            let offsets = stream.offsets.iter().fold(String::new(), |text, time| {
                format!("{text}<offset><time>{time}</time><value>0</value></offset>")
            });
            let measured =
                if last > first { (stream.count - 1) as f64 / (last - first) } else { stream.rate_hz };
            let footer = format!(
                "<info><first_timestamp>{first}</first_timestamp><last_timestamp>{last}</last_timestamp>\
                 <sample_count>{}</sample_count><measured_srate>{measured}</measured_srate>\
                 <clock_offsets>{offsets}</clock_offsets></info>",
                stream.count
            );
            self.write_chunk(
                XdfChunkTag::StreamFooter,
                &[&StreamId(index).bytes(), xml(&footer).as_bytes()],
            )?;
        }
        self.out.flush()?;
        Ok(self.out)
    }

    /// What comes before the values of a sample.
    fn begin_sample(&mut self, id: StreamId, time_secs: f64, values: usize, text: bool) -> io::Result<()> {
        let stream = &self.streams[id.0];
        if stream.is_text != text {
            let kinds = if text { "numbers, got words" } else { "words, got numbers" };
            return Err(io::Error::new(io::ErrorKind::InvalidInput, format!("a stream of {kinds}")));
        }
        if values != stream.channels {
            let message =
                format!("a sample of {values} values, expected {}, one of each channel", stream.channels);
            return Err(io::Error::new(io::ErrorKind::InvalidInput, message));
        }
        if stream.pending_count > 0 && time_secs - stream.pending_since_secs >= CHUNK_SECS {
            self.write_pending_chunk(id.0)?;
        }
        let stream = &mut self.streams[id.0];
        if stream.pending_count == 0 {
            stream.pending_since_secs = time_secs;
        }
        stream.pending_count += 1;
        stream.count += 1;
        stream.span = Some([stream.span.map_or(time_secs, |span| span[0]), time_secs]);
        // Eight bytes of time follow.
        stream.pending_samples.push(8);
        stream.pending_samples.extend(time_secs.to_le_bytes());
        Ok(())
    }

    /// Makes a chunk of the samples that wait, with what is due beside it.
    fn write_pending_chunk(&mut self, index: usize) -> io::Result<()> {
        let stream = &mut self.streams[index];
        let (samples, count) =
            (std::mem::take(&mut stream.pending_samples), std::mem::take(&mut stream.pending_count));
        let Some([_, last]) = stream.span.filter(|_| count > 0) else { return Ok(()) };
        let id = StreamId(index).bytes();
        if stream.offsets.last().is_none_or(|time| last - time >= OFFSET_SECS) {
            stream.offsets.push(last);
            self.write_chunk(XdfChunkTag::ClockOffset, &[&id, &last.to_le_bytes(), &0.0_f64.to_le_bytes()])?;
        }
        if last - self.boundary_secs >= BOUNDARY_SECS {
            self.boundary_secs = last;
            self.write_chunk(XdfChunkTag::Boundary, &[&BOUNDARY])?;
        }
        self.write_chunk(XdfChunkTag::Samples, &[&id, &encode_length(count), &samples])
    }

    /// Writes a chunk whose content is `parts` one after the other.
    fn write_chunk(&mut self, tag: XdfChunkTag, parts: &[&[u8]]) -> io::Result<()> {
        let tag = (tag as u16).to_le_bytes();
        let bytes: usize = parts.iter().map(|part| part.len()).sum();
        self.out.write_all(&encode_length((tag.len() + bytes) as u64))?;
        self.out.write_all(&tag)?;
        parts.iter().try_for_each(|part| self.out.write_all(part))
    }
}

impl StreamId {
    /// How many streams were added before it.
    pub fn index(self) -> usize {
        self.0
    }

    /// As chunks have it: streams are counted from one, as LabRecorder does.
    fn bytes(self) -> [u8; 4] {
        (self.0 as u32 + 1).to_le_bytes()
    }
}

/// A number of variable length: how many bytes it has (1, 4 or 8), then itself.
fn encode_length(value: u64) -> Vec<u8> {
    let bytes = match value {
        0..=0xff => 1,
        0x100..=0xffff_ffff => 4,
        _ => 8,
    };
    [&[bytes as u8], &value.to_le_bytes()[..bytes]].concat()
}

fn xml(element: &str) -> String {
    format!("<?xml version=\"1.0\"?>{element}")
}

/// Text as XML takes it: the characters that mean something there are named, and control characters, which it has none of, left out.
fn escape_xml(text: &str) -> String {
    let mut escaped = String::new();
    for character in text.chars() {
        match character {
            '<' => escaped += "&lt;",
            '>' => escaped += "&gt;",
            '&' => escaped += "&amp;",
            '"' => escaped += "&quot;",
            other if other.is_control() => {}
            other => escaped.push(other),
        }
    }
    escaped
}

#[cfg(test)]
mod tests {
    use super::*;

    fn channel(label: &str) -> XdfChannel {
        XdfChannel { label: label.into(), unit: "rad".into(), channel_type: "Angle".into() }
    }

    fn numbers(name: &str, rate_hz: f64, labels: &[&str]) -> XdfStream {
        let channels = labels.iter().map(|label| channel(label)).collect();
        XdfStream { name: name.into(), content_type: "Kinematics".into(), rate_hz, is_text: false, channels }
    }

    #[test]
    fn a_file_of_one_sample_is_these_bytes() {
        let mut file = XdfWriter::begin(Vec::new(), "n").unwrap();
        let head = "<?xml version=\"1.0\"?><info><version>1.0</version><note>n</note></info>";
        let file_header = [&b"XDF:"[..], &[1, head.len() as u8 + 2, 1, 0], head.as_bytes()].concat();
        assert_eq!(file.out, file_header);

        let id = file.add_stream(&numbers("J", 100.0, &["a", "b"])).unwrap();
        let header = file.out[file_header.len()..].to_vec();
        // Longer than 255 bytes: four bytes of length, then the tag and the number of the stream.
        let size = u32::from_le_bytes(header[1..5].try_into().unwrap()) as usize;
        assert_eq!((header[0], header.len(), &header[5..11]), (4, 5 + size, &[2, 0, 1, 0, 0, 0][..]));
        let text = std::str::from_utf8(&header[11..]).unwrap();
        for part in [
            "<channel_count>2</channel_count>",
            "<nominal_srate>100</nominal_srate>",
            "double64",
            "<label>b</label>",
        ] {
            assert!(text.contains(part), "{part} in {text}");
        }

        let before = file.out.len();
        file.write_numbers(id, 0.5, &[1.0, -2.0]).unwrap();
        assert_eq!(file.out.len(), before, "a sample waits for its chunk");
        let bytes = file.finish().unwrap();
        let offset =
            [&[1, 22, 4, 0, 1, 0, 0, 0][..], &0.5_f64.to_le_bytes(), &0.0_f64.to_le_bytes()].concat();
        let values = [0.5_f64, 1.0, -2.0].map(f64::to_le_bytes).concat();
        let samples = [&[1, 33, 3, 0, 1, 0, 0, 0, 1, 1, 8][..], &values].concat();
        let rest = &bytes[before..];
        assert_eq!(&rest[..offset.len()], offset);
        assert_eq!(&rest[offset.len()..][..samples.len()], samples);
        let footer = String::from_utf8_lossy(&rest[offset.len() + samples.len()..]);
        assert!(footer.contains("<sample_count>1</sample_count>") && footer.ends_with("</info>"), "{footer}");
    }

    #[test]
    fn words_have_their_lengths_and_markup_in_them_stays_text() {
        let mut file = XdfWriter::begin(Vec::new(), "a < b & \"c\"\u{7}").unwrap();
        assert!(String::from_utf8_lossy(&file.out).contains("a &lt; b &amp; &quot;c&quot;<"));
        let id = file.add_stream(&XdfStream { is_text: true, ..numbers("M", 0.0, &["event"]) }).unwrap();
        let long = "x".repeat(300);
        file.write_strings(id, 1.0, &["gr\u{fc}n"]).unwrap();
        file.write_strings(id, 1.5, &[&long]).unwrap();
        let bytes = file.finish().unwrap();
        let short = [&[8][..], &1.0_f64.to_le_bytes(), &[1, 5], "gr\u{fc}n".as_bytes()].concat();
        let long = [&[8][..], &1.5_f64.to_le_bytes(), &[4, 44, 1, 0, 0], long.as_bytes()].concat();
        let both = [short, long].concat();
        assert!(bytes.windows(both.len()).any(|window| window == both));
    }

    #[test]
    fn a_sample_of_another_length_or_kind_is_refused_and_writes_nothing() {
        let mut file = XdfWriter::begin(Vec::new(), "").unwrap();
        let id = file.add_stream(&numbers("J", 100.0, &["a", "b"])).unwrap();
        let error = file.write_numbers(id, 0.0, &[1.0]).unwrap_err().to_string();
        assert_eq!(error, "a sample of 1 values, expected 2, one of each channel");
        assert!(file.write_strings(id, 0.0, &["a", "b"]).unwrap_err().to_string().contains("got words"));
        assert!(String::from_utf8_lossy(&file.finish().unwrap()).contains("<sample_count>0</sample_count>"));
    }

    #[test]
    fn long_streams_become_chunks_with_offsets_and_boundaries_between() {
        let mut file = XdfWriter::begin(Vec::new(), "").unwrap();
        let id = file.add_stream(&numbers("J", 10.0, &["a"])).unwrap();
        for k in 0..250 {
            file.write_numbers(id, f64::from(k) / 10.0, &[f64::from(k)]).unwrap();
        }
        let bytes = file.finish().unwrap();
        let mut tags = [0; 7];
        let mut at = 4;
        while at < bytes.len() {
            let width = usize::from(bytes[at]);
            let mut size = [0; 8];
            size[..width].copy_from_slice(&bytes[at + 1..][..width]);
            tags[usize::from(bytes[at + 1 + width])] += 1;
            at += 1 + width + u64::from_le_bytes(size) as usize;
        }
        // 25 s: a chunk a second, an offset every five, a boundary every ten.
        assert_eq!((at, tags), (bytes.len(), [0, 1, 1, 25, 5, 2, 1]));
    }
}
