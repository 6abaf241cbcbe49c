//! Keeps raw codes with the device's time: as a table (CSV) or as EDF+ without interruptions, which every biosignal program
//! reads.

mod csv;
mod edf;

use crate::{DeviceError, EmgPacket, SourceInfo};
use proact_types::{EmgSample, MAX_RECORDING_BYTES, read_bytes};
use std::{
    fs::File,
    io::{self, BufWriter},
    path::{Path, PathBuf},
};

/// Writes a stream to a file while it runs. What was written is on disk within about a second, so that a crash costs
/// no more than that. An existing file is never replaced; a pipe or device is written to.
#[derive(Debug)]
pub struct EmgRecorder {
    path: PathBuf,
    file: FormatWriter,
    samples: u64,
}

#[derive(Debug)]
enum FormatWriter {
    Csv(csv::CsvWriter),
    Edf(edf::EdfWriter),
}

/// A recorded stream, read back.
#[derive(Clone, Debug, PartialEq)]
pub struct RecordedStream {
    /// Samples per second.
    pub rate_hz: f64,
    /// Raw codes under the device's counter: a step is a gap.
    pub samples: Vec<EmgSample>,
}

impl EmgRecorder {
    /// Begins a recording of the stream `info`. The ending of `path` says which format: `.csv` or `.edf`.
    ///
    /// # Errors
    /// Another ending, a file that is there already, or a place that cannot be written to.
    pub fn create(path: &Path, info: &SourceInfo) -> Result<EmgRecorder, DeviceError> {
        let ending = path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
        let ending = ending.filter(|e| e == "csv" || e == "edf");
        let Some(ending) = ending else { return Err(DeviceError::RecordFormat { path: path.to_owned() }) };
        let failed = |source| DeviceError::Write { path: path.to_owned(), source };
        let file = proact_files::create_in_place(path).map_err(failed)?;
        let file = BufWriter::new(file);
        let file = match ending.as_str() {
            "csv" => csv::CsvWriter::begin(file, info).map(FormatWriter::Csv),
            _ => edf::EdfWriter::begin(file, info).map(FormatWriter::Edf),
        };
        Ok(EmgRecorder { path: path.to_owned(), file: file.map_err(failed)?, samples: 0 })
    }

    /// Adds a packet.
    ///
    /// # Errors
    /// The disk is full, or EDF+ cannot hold the values: it holds whole numbers of 16 bits.
    pub fn packet(&mut self, packet: &EmgPacket) -> Result<(), DeviceError> {
        self.samples += packet.samples.len() as u64;
        match &mut self.file {
            FormatWriter::Csv(file) => file.packet(packet),
            FormatWriter::Edf(file) => file.packet(packet),
        }
        .map_err(|source| DeviceError::Write { path: self.path.clone(), source })
    }

    /// Ends the recording; the number of samples in it.
    ///
    /// # Errors
    /// The disk is full.
    pub fn finish(self) -> Result<u64, DeviceError> {
        match self.file {
            FormatWriter::Csv(file) => file.finish(),
            FormatWriter::Edf(file) => file.finish(),
        }
        .map_err(|source| DeviceError::Write { path: self.path.clone(), source })?;
        Ok(self.samples)
    }
}

/// Reads what an [`EmgRecorder`] wrote; also one that was cut off.
///
/// # Errors
/// A file of another kind, or one with damage: what stands where is said.
pub fn read_recorded(path: &Path) -> Result<RecordedStream, DeviceError> {
    let bytes = File::open(path)
        .and_then(|file| read_bytes(file, MAX_RECORDING_BYTES))
        .map_err(|source| DeviceError::Read { path: path.to_owned(), source })?;
    let read = match path.extension().and_then(|e| e.to_str()) {
        Some("csv") => csv::read(&bytes),
        Some("edf") => edf::read(&bytes),
        _ => return Err(DeviceError::RecordFormat { path: path.to_owned() }),
    };
    read.and_then(check_counters_rise)
        .map_err(|reason| DeviceError::InvalidRecording { path: path.to_owned(), reason })
}

/// The stream if its counters rise, as the recorder writes them; a damaged file may say otherwise.
fn check_counters_rise(stream: RecordedStream) -> Result<RecordedStream, String> {
    match stream.samples.windows(2).find(|pair| pair[1].counter <= pair[0].counter) {
        None => Ok(stream),
        Some(pair) => {
            Err(format!("sample {} after {}, expected a higher one", pair[1].counter, pair[0].counter))
        }
    }
}

/// Hands over what is in memory and on to the disk. Pipes and devices have nothing that could be synchronized.
fn flush_and_sync(file: BufWriter<File>) -> io::Result<()> {
    let file = file.into_inner().map_err(io::IntoInnerError::into_error)?;
    if file.metadata()?.is_file() { file.sync_all() } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::time::Duration;

    fn info(channels: usize) -> SourceInfo {
        SourceInfo {
            name: "test".to_owned(),
            rate_hz: 1000.0,
            channels,
            packet_samples: 16,
            zero_code: 128.0,
            rails: Some((0.0, 255.0)),
            loss_is_counted: true,
            volts_per_code: Some(2.5 / 1200.0 / 127.0),
            imu: Vec::new(),
        }
    }

    fn sample(counter: u64) -> EmgSample {
        EmgSample { counter, channels: (0..8).map(|c| ((counter * 7 + c * 31) % 256) as f64).collect() }
    }

    /// Packets of `lengths` samples with `gaps` samples missing before each.
    fn packets(plan: &[(u64, u64)]) -> Vec<EmgPacket> {
        let mut counter = 5;
        let packet = |&(gap, length): &(u64, u64)| {
            counter += gap;
            let samples: Vec<_> = (counter..counter + length).map(sample).collect();
            counter += length;
            EmgPacket {
                samples,
                lost_before: gap,
                device_secs: counter as f64 / 1000.0,
                received: Duration::from_millis(counter + 3),
            }
        };
        plan.iter().map(packet).collect()
    }

    fn round_trip(ending: &str, packets: &[EmgPacket]) -> (RecordedStream, Vec<u8>) {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join(format!("stream.{ending}"));
        let mut recorder = EmgRecorder::create(&path, &info(8)).unwrap();
        for packet in packets {
            recorder.packet(packet).unwrap();
        }
        recorder.finish().unwrap();
        (read_recorded(&path).unwrap(), std::fs::read(&path).unwrap())
    }

    #[test]
    fn a_table_has_counter_device_time_and_arrival_beside_raw_codes() {
        let (_, bytes) = round_trip("csv", &packets(&[(0, 2)]));
        let text = String::from_utf8(bytes).unwrap();
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines[0], "counter,device_s,received_s,ch0,ch1,ch2,ch3,ch4,ch5,ch6,ch7");
        assert_eq!(lines[1], "5,0.005,0.010,35,66,97,128,159,190,221,252");
        assert_eq!(lines.len(), 3);
    }

    #[test]
    fn edf_has_the_header_of_the_standard_and_no_interruption() {
        let (_, bytes) = round_trip("edf", &packets(&[(0, 16), (16, 16)]));
        let text = |from: usize, length: usize| {
            std::str::from_utf8(&bytes[from..from + length]).unwrap().trim_end().to_owned()
        };
        assert_eq!(text(0, 8), "0");
        assert_eq!(text(192, 5), "EDF+C");
        assert_eq!(text(184, 8), (256 * 10).to_string());
        assert_eq!((text(236, 8), text(244, 8), text(252, 4)), ("3".into(), "0.016".into(), "9".into()));
        assert_eq!((text(256, 16), text(256 + 8 * 16, 16)), ("EMG ch0".into(), "EDF Annotations".into()));
        // Behind labels and transducers: the unit, and what the codes -32768 and 32767 are in it.
        let units = 256 + 9 * 96;
        let ends = [text(units + 72, 8), text(units + 144, 8)].map(|end| end.parse::<f64>().unwrap());
        assert_eq!(text(units, 8), "uV");
        let scale = 2.5e6 / 1200.0 / 127.0;
        assert!(
            (ends[0] + 32_896.0 * scale).abs() < 1.0 && (ends[1] - 32_639.0 * scale).abs() < 1.0,
            "{ends:?}"
        );
        assert_eq!(bytes.len(), 256 * 10 + 3 * (8 * 16 * 2 + 128));
        let notes = String::from_utf8_lossy(&bytes[256 * 10..]).into_owned();
        assert!(notes.contains("+0.016\u{15}0.016\u{14}BAD_lost 16 samples\u{14}"), "{notes}");
        assert!(notes.contains("first sample: 5"), "{notes}");
    }

    #[test]
    fn edf_refuses_a_gap_that_would_fill_the_disk_and_a_counter_that_falls() {
        let dir = tempfile::tempdir().unwrap();
        let mut recorder = EmgRecorder::create(&dir.path().join("stream.edf"), &info(8)).unwrap();
        let packet = |counter| EmgPacket { samples: vec![sample(counter)], ..EmgPacket::default() };
        recorder.packet(&packet(10)).unwrap();
        let far = recorder.packet(&packet(1 << 50)).unwrap_err().to_string();
        assert!(far.contains("expected at most 3600 s"), "{far}");
        let back = recorder.packet(&packet(3)).unwrap_err().to_string();
        assert!(back.contains("sample 3 comes after 10"), "{back}");
    }

    #[test]
    fn a_recording_that_was_cut_off_is_read_as_far_as_it_goes() {
        for ending in ["csv", "edf"] {
            let dir = tempfile::tempdir().unwrap();
            let path = dir.path().join(format!("stream.{ending}"));
            let mut recorder = EmgRecorder::create(&path, &info(8)).unwrap();
            packets(&[(0, 16); 200]).iter().for_each(|p| recorder.packet(p).unwrap());
            // The process dies here: neither the end nor what is in memory is written.
            std::mem::forget(recorder);
            let read = read_recorded(&path).unwrap();
            assert!(read.samples.len() >= 2000, "{ending}: {} on disk", read.samples.len());
            assert!(read.samples.iter().zip(5..).all(|(s, k)| *s == sample(k)));
        }
    }

    #[test]
    fn existing_files_other_formats_and_values_that_are_no_codes_are_refused() {
        let dir = tempfile::tempdir().unwrap();
        let error =
            |name: &str| EmgRecorder::create(&dir.path().join(name), &info(8)).unwrap_err().to_string();
        assert!(error("stream.mat").contains("expected a name that ends in .csv or .edf"));
        std::fs::write(dir.path().join("old.csv"), "kept").unwrap();
        assert!(error("old.csv").contains("exists"), "{}", error("old.csv"));
        assert_eq!(std::fs::read_to_string(dir.path().join("old.csv")).unwrap(), "kept");
        let mut recorder = EmgRecorder::create(&dir.path().join("new.edf"), &info(8)).unwrap();
        let mut bad = packets(&[(0, 16)]);
        bad[0].samples[3].channels[2] = f64::NAN;
        let error = recorder.packet(&bad[0]).unwrap_err().to_string();
        assert!(error.contains("channel 2 of sample 8 is NaN"), "{error}");
    }

    #[test]
    fn damaged_recordings_are_refused() {
        let dir = tempfile::tempdir().unwrap();
        let refused = |name: &str, text: &str| {
            let path = dir.path().join(name);
            std::fs::write(&path, text).unwrap();
            read_recorded(&path).unwrap_err().to_string()
        };
        assert!(refused("a.csv", "x,y\n").contains("first row"));
        let head = "counter,device_s,received_s,ch0\n";
        assert!(refused("b.csv", &format!("{head}0,0,0,1\n1,0.001,0\n2,0.002,0,1\n")).contains("row 3"));
        assert!(refused("c.csv", &format!("{head}0,0,0,1\n1,0.001,0,NaN\n2,0,0,0\n")).contains("row 3"));
        assert!(refused("d.edf", "no header").contains("9 bytes"));
        assert!(refused("e.edf", &"x".repeat(600)).contains("header"));
    }

    proptest! {
        // Each case writes two files to the disk.
        #![proptest_config(ProptestConfig::with_cases(24))]

        #[test]
        fn what_is_recorded_is_read_back_with_its_gaps(
            plan in prop::collection::vec((0_u64..40, prop_oneof![Just(16_u64), 1_u64..20]), 2..20)
        ) {
            let packets = packets(&plan);
            let samples: Vec<EmgSample> = packets.iter().flat_map(|p| p.samples.clone()).collect();
            for ending in ["csv", "edf"] {
                let (read, _) = round_trip(ending, &packets);
                prop_assert_eq!(read.rate_hz, 1000.0);
                prop_assert_eq!(&read.samples, &samples, "{}", ending);
            }
        }

    }

    proptest! {
        #[test]
        fn no_bytes_make_the_readers_panic(bytes in prop::collection::vec(any::<u8>(), 0..2000)) {
            let _ = csv::read(&bytes);
            let _ = edf::read(&bytes);
        }
    }
}
