//! European Data Format plus (EDF+), as specified at <https://www.edfplus.info/specs>: 16-bit codes, a record a
//! packet, each with its own time, so that gaps lie between records
//! (EDF+D). A recording without gaps is marked as such at its end (EDF+C), for programs that read no others.

use super::{RecordedStream, close};
use crate::{EmgPacket, SourceInfo};
use proact_types::{EmgSample, MAX_EMG_CHANNELS};
use std::{
    fs::File,
    io::{self, BufWriter, Seek, SeekFrom, Write},
    time::{SystemTime, UNIX_EPOCH},
};

/// Bytes of the annotations of a record: its time, and a word on what is missing.
const ANNOTATION_BYTES: usize = 64;
/// Stands for a sample that is missing at the end of a record, where a gap begins within a packet. No code of an
/// armband is as low.
const MISSING: i16 = i16::MIN;
/// Place of the kind of EDF+ in the header.
const KIND_AT: u64 = 192;
/// Place of the number of records in the header.
const RECORDS_AT: u64 = 236;

#[derive(Debug)]
pub(super) struct EdfWriter {
    file: BufWriter<File>,
    rate_hz: f64,
    channels: usize,
    record_samples: usize,
    /// `[sample][channel]` of the record under way.
    record: Vec<i16>,
    /// Counter of its first sample.
    begins: u64,
    records: u64,
    /// Counter after the last record, and whether all records follow each other, the first within a second.
    follows: Option<u64>,
    unbroken: bool,
    unflushed: f64,
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
            record_samples,
            record: Vec::with_capacity(record_samples * info.channels),
            begins: 0,
            records: 0,
            follows: None,
            unbroken: true,
            unflushed: 0.0,
        })
    }

    pub(super) fn packet(&mut self, packet: &EmgPacket) -> io::Result<()> {
        for sample in &packet.samples {
            let filled = self.record.len() / self.channels;
            if filled > 0 && sample.counter != self.begins + filled as u64 {
                self.write_record()?;
            }
            if self.record.is_empty() {
                self.begins = sample.counter;
            }
            if sample.channels.len() != self.channels {
                let message = format!(
                    "sample {} has {} channels, expected {}",
                    sample.counter,
                    sample.channels.len(),
                    self.channels
                );
                return Err(io::Error::new(io::ErrorKind::InvalidData, message));
            }
            for (value, channel) in sample.channels.iter().zip(0..) {
                let possible = value.fract() == 0.0 && value.abs() <= f64::from(i16::MAX);
                if !possible {
                    let message = format!(
                        "channel {channel} of sample {} is {value}, EDF+ holds whole numbers from -32767 to 32767; \
                         record to a .csv file",
                        sample.counter
                    );
                    return Err(io::Error::new(io::ErrorKind::InvalidData, message));
                }
                self.record.push(*value as i16);
            }
            if self.record.len() == self.record_samples * self.channels {
                self.write_record()?;
            }
        }
        Ok(())
    }

    fn write_record(&mut self) -> io::Result<()> {
        let filled = self.record.len() / self.channels;
        let missing = self.record_samples - filled;
        // A signal's samples of a record stand together.
        let mut bytes = Vec::with_capacity(self.record_samples * self.channels * 2 + ANNOTATION_BYTES);
        for channel in 0..self.channels {
            let codes = self.record.iter().skip(channel).step_by(self.channels).copied();
            for code in codes.chain(std::iter::repeat_n(MISSING, missing)) {
                bytes.extend(code.to_le_bytes());
            }
        }
        let onset = self.begins as f64 / self.rate_hz;
        let mut note = format!("+{onset}\u{14}\u{14}\0");
        if missing > 0 {
            note += &format!("+{onset}\u{14}last {missing} missing\u{14}\0");
        }
        let mut note = note.into_bytes();
        note.resize(ANNOTATION_BYTES, 0);
        bytes.extend(note);
        self.file.write_all(&bytes)?;
        self.unbroken &= match self.follows {
            Some(counter) => self.begins == counter,
            None => onset < 1.0,
        };
        self.follows = Some(self.begins + self.record_samples as u64);
        self.record.clear();
        self.records += 1;
        self.unflushed += self.record_samples as f64 / self.rate_hz;
        if self.unflushed >= 1.0 {
            self.unflushed = 0.0;
            self.file.flush()?;
        }
        Ok(())
    }

    pub(super) fn finish(mut self) -> io::Result<()> {
        if !self.record.is_empty() {
            self.write_record()?;
        }
        if self.unbroken {
            self.file.seek(SeekFrom::Start(KIND_AT))?;
            self.file.write_all(b"EDF+C")?;
        }
        self.file.seek(SeekFrom::Start(RECORDS_AT))?;
        write!(self.file, "{:<8}", self.records)?;
        close(self.file)
    }
}

fn header(info: &SourceInfo, record_samples: usize) -> String {
    let (date, long_date, time) = now();
    let signals = info.channels + 1;
    let mut text = String::new();
    // Text beyond ASCII is not allowed.
    let mut field = |value: &str, width: usize| {
        let ascii: String =
            value.chars().map(|c| if c.is_ascii_graphic() || c == ' ' { c } else { '_' }).collect();
        text += &format!("{:<width$.width$}", ascii);
    };
    field("0", 8);
    field("X X X X", 80);
    field(&format!("Startdate {long_date} X X {}", info.name.replace(' ', "_")), 80);
    field(&date, 8);
    field(&time, 8);
    field(&(256 * (signals + 1)).to_string(), 8);
    field("EDF+D", 44);
    // Not known before the end; readers take it from the length of the file.
    field("-1", 8);
    field(&(record_samples as f64 / info.rate_hz).to_string(), 8);
    field(&signals.to_string(), 4);
    let mut fields = |width: usize, signal: &dyn Fn(usize) -> String, annotations: &str| {
        (0..info.channels).for_each(|channel| field(&signal(channel), width));
        field(annotations, width);
    };
    fields(16, &|channel| format!("EMG ch{channel}"), "EDF Annotations");
    fields(80, &|_| info.name.clone(), "");
    // Codes as they came: physical and digital values are the same, without a unit.
    fields(8, &|_| String::new(), "");
    fields(8, &|_| "-32768".to_owned(), "-32768");
    fields(8, &|_| "32767".to_owned(), "32767");
    fields(8, &|_| "-32768".to_owned(), "-32768");
    fields(8, &|_| "32767".to_owned(), "32767");
    fields(80, &|_| String::new(), "");
    fields(8, &|_| record_samples.to_string(), &(ANNOTATION_BYTES / 2).to_string());
    fields(32, &|_| String::new(), "");
    text
}

/// The time in UTC as EDF's date, EDF+'s date and EDF's time.
fn now() -> (String, String, String) {
    let secs = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
    let (year, month, day) = civil(secs / 86_400);
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
fn civil(days: u64) -> (u64, u64, u64) {
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
        return Err(format!("a header of {signals} signals, expected EDF+ with 1 to 16 and annotations"));
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
    for (record, index) in body.chunks_exact(samples * channels * 2 + annotations).zip(0..) {
        let (codes, notes) = record.split_at(samples * channels * 2);
        let onset = notes.split(|b| *b == 0x14).next().and_then(|text| std::str::from_utf8(text).ok());
        let onset = onset.and_then(|text| text.parse::<f64>().ok()).filter(|v| v.is_finite() && *v >= 0.0);
        let onset = onset.ok_or_else(|| format!("record {index} does not say when it begins"))?;
        let begins = (onset * rate_hz).round() as u64;
        let code = |sample: usize, channel: usize| {
            let at = (channel * samples + sample) * 2;
            i16::from_le_bytes([codes[at], codes[at + 1]])
        };
        for (sample, counter) in (0..samples).zip(begins..) {
            if code(sample, 0) == MISSING {
                break;
            }
            let channels = (0..channels).map(|channel| f64::from(code(sample, channel))).collect();
            out.push(EmgSample { counter, channels });
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
        assert_eq!(civil(0), (1970, 1, 1));
        assert_eq!(civil(11_016), (2000, 2, 29));
        assert_eq!(civil(11_017), (2000, 3, 1));
        assert_eq!(civil(20_818), (2026, 12, 31));
    }
}
