use super::{RecordedStream, flush_and_sync};
use crate::{EmgPacket, SourceInfo};
use proact_types::{EmgSample, MAX_EMG_CHANNELS};
use std::{
    fs::File,
    io::{self, BufWriter, Write},
};

const FIRST_COLUMNS: [&str; 3] = ["counter", "device_s", "received_s"];

/// A row a sample: counter, the device's time, the arrival of its packet, raw codes.
#[derive(Debug)]
pub(super) struct CsvWriter {
    file: BufWriter<File>,
    rate_hz: f64,
    flush_every: u64,
    unflushed: u64,
}

impl CsvWriter {
    pub(super) fn begin(mut file: BufWriter<File>, info: &SourceInfo) -> io::Result<CsvWriter> {
        let electrodes = (0..info.channels).map(|c| format!("ch{c}"));
        let channels = electrodes.chain(info.imu.iter().map(|channel| channel.name.replace(',', " ")));
        let names: Vec<String> = FIRST_COLUMNS.iter().map(|n| (*n).to_owned()).chain(channels).collect();
        writeln!(file, "{}", names.join(","))?;
        Ok(CsvWriter { file, rate_hz: info.rate_hz, flush_every: info.rate_hz.ceil() as u64, unflushed: 0 })
    }

    pub(super) fn packet(&mut self, packet: &EmgPacket) -> io::Result<()> {
        for sample in &packet.samples {
            let device_secs = sample.counter as f64 / self.rate_hz;
            write!(self.file, "{},{device_secs},{:.3}", sample.counter, packet.received.as_secs_f64())?;
            for value in &sample.channels {
                write!(self.file, ",{value}")?;
            }
            writeln!(self.file)?;
        }
        self.unflushed += packet.samples.len() as u64;
        if self.unflushed >= self.flush_every {
            self.unflushed = 0;
            self.file.flush()?;
        }
        Ok(())
    }

    pub(super) fn finish(self) -> io::Result<()> {
        flush_and_sync(self.file)
    }
}

pub(super) fn read(bytes: &[u8]) -> Result<RecordedStream, String> {
    let text = std::str::from_utf8(bytes).map_err(|e| format!("it is no text: {e}"))?;
    let mut lines = text.split_inclusive('\n').zip(1..);
    let head = lines.next().map_or("", |(line, _)| line.trim_end());
    let names: Vec<&str> = head.split(',').collect();
    // What follows the electrodes is an inertial measurement unit, which is left out.
    let electrodes = names.iter().skip(FIRST_COLUMNS.len()).enumerate();
    let channels = electrodes.take_while(|(k, name)| **name == format!("ch{k}")).count();
    if !names.starts_with(&FIRST_COLUMNS) || !(1..=MAX_EMG_CHANNELS).contains(&channels) {
        return Err(format!("the first row is {head:?}, expected counter,device_s,received_s,ch0,.."));
    }
    let mut samples: Vec<EmgSample> = Vec::new();
    let mut times = Vec::new();
    for (line, row) in lines {
        if !line.ends_with('\n') {
            // The row that was being written when the recording was cut off.
            break;
        }
        let wrong = |what: &str| format!("row {row}: {what} in {:?}", line.trim_end());
        let values: Vec<&str> = line.trim_end().split(',').collect();
        if values.len() != names.len() {
            return Err(wrong(&format!("{} columns, expected {}", values.len(), names.len())));
        }
        let counter = values[0].parse().map_err(|_| wrong("a counter that is no whole number"))?;
        let number = |text: &str| text.parse::<f64>().ok().filter(|v| v.is_finite());
        times.push(number(values[1]).ok_or_else(|| wrong("a time that is no finite number"))?);
        let channels =
            values[FIRST_COLUMNS.len()..][..channels].iter().map(|text| number(text)).collect::<Option<_>>();
        let channels = channels.ok_or_else(|| wrong("a value that is no finite number"))?;
        samples.push(EmgSample { counter, channels });
    }
    let ([first, .., last], [begin, .., end]) = (&samples[..], &times[..]) else {
        return Err(format!("{} samples, expected at least two", samples.len()));
    };
    let rate_hz = (last.counter as f64 - first.counter as f64) / (end - begin);
    if !(rate_hz.is_finite() && rate_hz > 0.0) {
        return Err("the times do not rise with the counters".to_owned());
    }
    // Times are written in full; what division leaves over is rounding.
    let whole = rate_hz.round();
    let rate_hz = if (rate_hz - whole).abs() < 1e-6 * whole { whole } else { rate_hz };
    Ok(RecordedStream { rate_hz, samples })
}
