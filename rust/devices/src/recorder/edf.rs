//! European Data Format plus (EDF+), as specified at <https://www.edfplus.info/specs>: 16-bit codes, a record a packet,
//! without interruption (EDF+C), since most programs refuse interrupted files (EDF+D) or read them as if nothing lacked.
//! Lost samples are [`MISSING_CODE`], under an annotation that says so.

use super::{RecordedStream, flush_and_sync};
use crate::{EmgPacket, SourceInfo};
use proact_types::{EmgSample, MAX_EMG_CHANNELS};
use std::{
    fmt::Write as _,
    fs::File,
    io::{self, BufWriter, Seek, SeekFrom, Write},
    time::{SystemTime, UNIX_EPOCH},
};

/// Bytes of the annotations of a record: its time, and what is missing.
const ANNOTATION_BYTES: usize = 128;
/// Stands for a sample that was lost. No code of an armband is as low.
const MISSING_CODE: i16 = i16::MIN;
/// A longer gap is none that a file should be filled for.
const MAX_GAP_SECS: f64 = 3600.0;
/// Says with which sample of the device the file begins.
const FIRST_SAMPLE_LABEL: &str = "first sample: ";
/// Place of the number of records in the header.
const RECORD_COUNT_OFFSET: u64 = 236;

#[derive(Debug)]
pub(super) struct EdfWriter {
    file: BufWriter<File>,
    rate_hz: f64,
    channels: usize,
    /// Channels of an inertial measurement unit, which follow.
    imu: usize,
    record_samples: usize,
    /// `[sample][channel]` of the record under way.
    record: Vec<i16>,
    /// Counter of the next sample, none before the first.
    next_counter: Option<u64>,
    /// Annotations that are to go into the next records.
    pending_annotations: Vec<String>,
    records: u64,
    unflushed_secs: f64,
}

impl EdfWriter {
    pub(super) fn begin(mut file: BufWriter<File>, info: &SourceInfo) -> io::Result<EdfWriter> {
        let record_samples = info.packet_samples.max(1);
        file.write_all(header(info, record_samples).as_bytes())?;
        // On disk from the first moment: without it the records cannot be read.
        file.flush()?;
        Ok(EdfWriter {
            file,
            rate_hz: info.rate_hz,
            channels: info.channels,
            imu: info.imu.len(),
            record_samples,
            record: Vec::with_capacity(record_samples * info.channels),
            next_counter: None,
            pending_annotations: Vec::new(),
            records: 0,
            unflushed_secs: 0.0,
        })
    }

    pub(super) fn packet(&mut self, packet: &EmgPacket) -> io::Result<()> {
        for sample in &packet.samples {
            let codes = self.codes(sample)?;
            match self.next_counter {
                None => self.pending_annotations.push(annotation(
                    "0",
                    None,
                    &format!("{FIRST_SAMPLE_LABEL}{}", sample.counter),
                )),
                Some(expected) => self.write_lost_samples(expected, sample.counter)?,
            }
            self.next_counter = Some(sample.counter.saturating_add(1));
            self.record.extend(codes);
            self.write_full_record()?;
        }
        Ok(())
    }

    /// The codes of `sample`, if EDF+ can hold them.
    fn codes(&self, sample: &EmgSample) -> io::Result<Vec<i16>> {
        let EmgSample { counter, channels } = sample;
        // Codes of a converter fit, values of an inertial measurement unit do not: those are left out.
        let channels =
            if channels.len() == self.channels + self.imu { &channels[..self.channels] } else { channels };
        if channels.len() != self.channels {
            let (got, expected) = (channels.len(), self.channels);
            return Err(invalid(format!("sample {counter} has {got} channels, expected {expected}")));
        }
        let possible = |value: f64| value.fract() == 0.0 && value.abs() <= f64::from(i16::MAX);
        if let Some((channel, value)) = channels.iter().enumerate().find(|(_, value)| !possible(**value)) {
            return Err(invalid(format!(
                "channel {channel} of sample {counter} is {value}, EDF+ holds whole numbers from -32767 to 32767; record \
                 to a .csv file"
            )));
        }
        Ok(channels.iter().map(|value| *value as i16).collect())
    }

    /// Marks the samples from `expected` to before `counter` as lost.
    fn write_lost_samples(&mut self, expected: u64, counter: u64) -> io::Result<()> {
        let Some(lost) = counter.checked_sub(expected) else {
            return Err(invalid(format!(
                "sample {counter} comes after {}; the device began anew: begin another recording",
                expected - 1
            )));
        };
        if lost == 0 {
            return Ok(());
        }
        let secs = lost as f64 / self.rate_hz;
        if secs > MAX_GAP_SECS {
            return Err(invalid(format!(
                "{lost} samples are lost before sample {counter}, {secs:.0} s, expected at most {MAX_GAP_SECS} s: \
                 begin another recording, or record to a .csv file"
            )));
        }
        let onset =
            self.onset_text(self.records * self.record_samples as u64 + self.samples_in_record() as u64);
        // MNE leaves out what is annotated as bad.
        self.pending_annotations.push(annotation(&onset, Some(secs), &format!("BAD_lost {lost} samples")));
        for _ in 0..lost {
            self.record.extend(std::iter::repeat_n(MISSING_CODE, self.channels));
            self.write_full_record()?;
        }
        Ok(())
    }

    /// Samples in the record under way.
    fn samples_in_record(&self) -> usize {
        self.record.len() / self.channels
    }

    fn onset_text(&self, samples: u64) -> String {
        (samples as f64 / self.rate_hz).to_string()
    }

    fn write_full_record(&mut self) -> io::Result<()> {
        if self.samples_in_record() == self.record_samples { self.write_record() } else { Ok(()) }
    }

    fn write_record(&mut self) -> io::Result<()> {
        // A signal's samples of a record stand together.
        let mut bytes = Vec::with_capacity(self.record_samples * self.channels * 2 + ANNOTATION_BYTES);
        for channel in 0..self.channels {
            for code in self.record.iter().skip(channel).step_by(self.channels) {
                bytes.extend(code.to_le_bytes());
            }
        }
        let time = self.onset_text(self.records * self.record_samples as u64);
        let mut annotations = format!("+{time}\u{14}\u{14}\0");
        while self
            .pending_annotations
            .first()
            .is_some_and(|note| annotations.len() + note.len() <= ANNOTATION_BYTES)
        {
            annotations += &self.pending_annotations.remove(0);
        }
        let mut annotations = annotations.into_bytes();
        annotations.resize(ANNOTATION_BYTES, 0);
        bytes.extend(annotations);
        self.file.write_all(&bytes)?;
        self.record.clear();
        self.records += 1;
        self.unflushed_secs += self.record_samples as f64 / self.rate_hz;
        if self.unflushed_secs >= 1.0 {
            self.unflushed_secs = 0.0;
            self.file.flush()?;
        }
        Ok(())
    }

    pub(super) fn finish(mut self) -> io::Result<()> {
        let missing = (self.record_samples - self.samples_in_record()) % self.record_samples;
        if missing > 0 {
            let onset =
                self.onset_text(self.records * self.record_samples as u64 + self.samples_in_record() as u64);
            let secs = missing as f64 / self.rate_hz;
            self.pending_annotations.push(annotation(&onset, Some(secs), "BAD_after the end"));
        }
        // Annotations of many short gaps may need a record more.
        while !self.record.is_empty() || !self.pending_annotations.is_empty() {
            self.record.resize(self.record_samples * self.channels, MISSING_CODE);
            self.write_record()?;
        }
        self.file.seek(SeekFrom::Start(RECORD_COUNT_OFFSET))?;
        write!(self.file, "{:<8}", self.records)?;
        flush_and_sync(self.file)
    }
}

fn invalid(message: String) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, message)
}

/// A time-stamped annotation.
fn annotation(onset: &str, secs: Option<f64>, text: &str) -> String {
    let duration = secs.map(|secs| format!("\u{15}{secs}")).unwrap_or_default();
    format!("+{onset}{duration}\u{14}{text}\u{14}\0")
}

fn header(info: &SourceInfo, record_samples: usize) -> String {
    let (date, long_date, time) = now();
    let signals = info.channels + 1;
    let mut text = String::new();
    // Text beyond ASCII is not allowed.
    let mut field = |value: &str, width: usize| {
        let ascii: String =
            value.chars().map(|c| if c.is_ascii_graphic() || c == ' ' { c } else { '_' }).collect();
        let _ = write!(text, "{ascii:<width$.width$}");
    };
    field("0", 8);
    field("X X X X", 80);
    field(&format!("Startdate {long_date} X X {}", info.name.replace(' ', "_")), 80);
    field(&date, 8);
    field(&time, 8);
    field(&(256 * (signals + 1)).to_string(), 8);
    field("EDF+C", 44);
    // Not known before the end; readers take it from the length of the file.
    field("-1", 8);
    field(&(record_samples as f64 / info.rate_hz).to_string(), 8);
    field(&signals.to_string(), 4);
    // Microvolts where the device says what a code is, else codes as they came, without a unit.
    let physical = |code: i16| match info.volts_per_code {
        Some(volts) => format_in_8_chars((f64::from(code) - info.zero_code) * volts * 1e6),
        None => code.to_string(),
    };
    let (lowest, highest) = (physical(i16::MIN), physical(i16::MAX));
    let mut fields = |width: usize, signal: &dyn Fn(usize) -> String, annotations: &str| {
        (0..info.channels).for_each(|channel| field(&signal(channel), width));
        field(annotations, width);
    };
    fields(16, &|channel| format!("EMG ch{channel}"), "EDF Annotations");
    fields(80, &|_| info.name.clone(), "");
    fields(8, &|_| if info.volts_per_code.is_some() { "uV" } else { "" }.to_owned(), "");
    fields(8, &|_| lowest.clone(), "-32768");
    fields(8, &|_| highest.clone(), "32767");
    fields(8, &|_| "-32768".to_owned(), "-32768");
    fields(8, &|_| "32767".to_owned(), "32767");
    fields(80, &|_| String::new(), "");
    fields(8, &|_| record_samples.to_string(), &(ANNOTATION_BYTES / 2).to_string());
    fields(32, &|_| String::new(), "");
    text
}

/// `value` in at most eight characters, as exactly as they allow.
fn format_in_8_chars(value: f64) -> String {
    let whole = format!("{value:.0}").len();
    let decimals = 8_usize.saturating_sub(whole + 1).min(6);
    format!("{value:.decimals$}")
}

/// The time in UTC as EDF's date, EDF+'s date and EDF's time.
fn now() -> (String, String, String) {
    let secs = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
    let (year, month, day) = civil_from_days(secs / 86_400);
    const MONTHS: [&str; 12] =
        ["JAN", "FEB", "MAR", "APR", "MAY", "JUN", "JUL", "AUG", "SEP", "OCT", "NOV", "DEC"];
    let (h, m, s) = (secs / 3600 % 24, secs / 60 % 60, secs % 60);
    (
        format!("{day:02}.{month:02}.{:02}", year % 100),
        format!("{day:02}-{}-{year}", MONTHS[month as usize - 1]),
        format!("{h:02}.{m:02}.{s:02}"),
    )
}

/// Year, month and day of the `days`-th day after 1 January 1970 (Gregorian).
fn civil_from_days(days: u64) -> (u64, u64, u64) {
    // Years that begin in March, counted from the year 0, have the leap day last.
    let days = days + 719_468;
    let era = days / 146_097;
    let day_of_era = days % 146_097;
    let year_of_era = (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let shifted = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * shifted + 2) / 5 + 1;
    let month = if shifted < 10 { shifted + 3 } else { shifted - 9 };
    (era * 400 + year_of_era + u64::from(month <= 2), month, day)
}

/// The device's number of the first sample; 0 in files of other programs.
fn first_sample(notes: &[u8]) -> Result<u64, String> {
    let texts = notes.split(|b| *b == 0 || *b == 0x14).filter_map(|text| std::str::from_utf8(text).ok());
    let Some(number) = texts.filter_map(|text| text.strip_prefix(FIRST_SAMPLE_LABEL)).next() else {
        return Ok(0);
    };
    number
        .parse()
        .map_err(|_| format!("the annotation {FIRST_SAMPLE_LABEL:?} says {number:?}, expected a number"))
}

/// The codes of a file; of interrupted ones (EDF+D) each record has its own time.
pub(super) fn read(bytes: &[u8]) -> Result<RecordedStream, String> {
    if bytes.len() < 512 {
        return Err(format!("{} bytes, expected a header of at least 512", bytes.len()));
    }
    let number = |from: usize, width: usize, what: &str| -> Result<f64, String> {
        let text = bytes.get(from..from + width).and_then(|b| std::str::from_utf8(b).ok()).unwrap_or("?");
        let value = text.trim().parse::<f64>().ok().filter(|v| v.is_finite());
        value.ok_or_else(|| format!("the header says {text:?} for {what}, expected a number"))
    };
    let duration = number(244, 8, "the duration of a record")?;
    let signals = number(252, 4, "the number of signals")? as usize;
    if !(2..=MAX_EMG_CHANNELS + 1).contains(&signals) || !bytes[192..].starts_with(b"EDF+") {
        return Err(format!(
            "a header of {signals} signals, expected EDF+ with 1 to {MAX_EMG_CHANNELS} and annotations"
        ));
    }
    let channels = signals - 1;
    // Behind the fields of 16 + 80 + 8 + 4 * 8 + 80 bytes a signal.
    let lengths = 256 + signals * 216;
    let samples = number(lengths, 8, "the samples of a record")? as usize;
    let annotations = number(lengths + channels * 8, 8, "the annotations of a record")? as usize * 2;
    if !(1..=100_000).contains(&samples) || !(16..=10_000).contains(&annotations) || duration <= 0.0 {
        return Err(format!("a header with {samples} samples in {duration} s, which cannot be"));
    }
    // The duration has eight digits; rates are whole in practice.
    let rate = samples as f64 / duration;
    let rate_hz = if (rate - rate.round()).abs() < 1e-3 { rate.round() } else { rate };
    let mut out = Vec::new();
    let body = bytes.get(256 * (signals + 1)..).unwrap_or_default();
    let mut first = 0;
    for (record, index) in body.chunks_exact(samples * channels * 2 + annotations).zip(0..) {
        let (codes, notes) = record.split_at(samples * channels * 2);
        if index == 0 {
            first = first_sample(notes)?;
        }
        let onset = notes.split(|b| *b == 0x14).next().and_then(|text| std::str::from_utf8(text).ok());
        let onset = onset.and_then(|text| text.parse::<f64>().ok()).filter(|v| v.is_finite() && *v >= 0.0);
        let onset = onset.ok_or_else(|| format!("record {index} does not say when it begins"))?;
        let begins = ((onset * rate_hz).round() as u64).saturating_add(first);
        let code = |sample: usize, channel: usize| {
            let at = (channel * samples + sample) * 2;
            i16::from_le_bytes([codes[at], codes[at + 1]])
        };
        for (sample, counter) in (0..samples).zip(begins..) {
            if code(sample, 0) != MISSING_CODE {
                let channels = (0..channels).map(|channel| f64::from(code(sample, channel))).collect();
                out.push(EmgSample { counter, channels });
            }
        }
    }
    if out.is_empty() {
        return Err("no samples".to_owned());
    }
    Ok(RecordedStream { rate_hz, samples: out })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_are_those_of_the_calendar() {
        assert_eq!(civil_from_days(0), (1970, 1, 1));
        assert_eq!(civil_from_days(11_016), (2000, 2, 29));
        assert_eq!(civil_from_days(11_017), (2000, 3, 1));
        assert_eq!(civil_from_days(20_818), (2026, 12, 31));
    }
}
