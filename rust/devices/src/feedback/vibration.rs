use super::FeedbackSink;
use crate::DeviceError;
use proact_types::{FeedbackCue, Tone, Vibration};
use std::{
    fmt,
    fs::{File, OpenOptions},
    io::{self, Write},
    net::UdpSocket,
    os::unix::fs::FileTypeExt,
    path::Path,
    process::{Command, Stdio},
    str::FromStr,
};

/// A line to a driver of vibrating motors and a buzzer: ASCII, one command, ended by a line feed.
///
/// | line | meaning |
/// |---|---|
/// | `V 2 128 40` | motor 2 at 128 of 255 for 40 ms; a later line for the same motor takes its place |
/// | `V * 255 150` | all motors |
/// | `T 440 660 150` | a tone that glides from 440 to 660 Hz in 150 ms |
///
/// Motor `n` belongs to the hand's digit `n`, counted from 0 in the order of its description. Strength 0 ends a vibration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum VibrationLine {
    /// A motor, or all of them.
    Vibrate {
        /// Which motor; none for all.
        motor: Option<u8>,
        /// Of 255.
        strength: u8,
        /// Milliseconds.
        ms: u32,
    },
    /// The buzzer.
    Sound {
        /// Hz at the beginning and at the end.
        hz: [u16; 2],
        /// Milliseconds.
        ms: u32,
    },
}

impl VibrationLine {
    /// What a cue is to such a driver, at most one line for what is felt and one for what is heard.
    pub fn lines_for(cue: &FeedbackCue) -> impl Iterator<Item = Self> {
        let motor = cue.digit.as_ref().map(|digit| digit.number);
        let felt = cue.vibration.map(|Vibration { strength, ms }| {
            let strength = (strength.clamp(0.0, 1.0) * 255.0).round() as u8;
            Self::Vibrate { motor, strength, ms }
        });
        let tone = cue.sound.map(|Tone { hz, ms }| {
            let hz = hz.map(|hz| hz.clamp(0.0, f64::from(u16::MAX)).round() as u16);
            Self::Sound { hz, ms }
        });
        felt.into_iter().chain(tone)
    }
}

impl fmt::Display for VibrationLine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Vibrate { motor: Some(motor), strength, ms } => write!(f, "V {motor} {strength} {ms}"),
            Self::Vibrate { motor: None, strength, ms } => write!(f, "V * {strength} {ms}"),
            Self::Sound { hz: [from, to], ms } => write!(f, "T {from} {to} {ms}"),
        }
    }
}

impl FromStr for VibrationLine {
    type Err = String;

    fn from_str(line: &str) -> Result<Self, String> {
        let wrong = || {
            format!(
                "line {line:?}, expected V MOTOR|* STRENGTH MS or T HZ HZ MS with whole numbers, one blank each"
            )
        };
        let words: Vec<&str> = line.split(' ').collect();
        fn number<T: FromStr>(text: &str) -> Option<T> {
            text.bytes().all(|byte| byte.is_ascii_digit()).then(|| text.parse().ok()).flatten()
        }
        let read = match words.as_slice() {
            ["V", "*", strength, ms] => number(strength)
                .zip(number(ms))
                .map(|(strength, ms)| Self::Vibrate { motor: None, strength, ms }),
            ["V", motor, strength, ms] => number(motor)
                .zip(number(strength))
                .zip(number(ms))
                .map(|((motor, strength), ms)| Self::Vibrate { motor: Some(motor), strength, ms }),
            ["T", from, to, ms] => number(from)
                .zip(number(to))
                .zip(number(ms))
                .map(|((from, to), ms)| Self::Sound { hz: [from, to], ms }),
            _ => None,
        };
        read.ok_or_else(wrong)
    }
}

/// Speaks to a driver of motors, by UDP or at a serial port.
pub struct VibrationDriver {
    link: VibrationLink,
    name: String,
}

enum VibrationLink {
    Udp(UdpSocket),
    Serial(File),
}

impl VibrationDriver {
    /// A line in each datagram to `target`, such as `192.168.1.7:25043`. That nobody listens is no error.
    ///
    /// # Errors
    /// [`DeviceError::Udp`] for an address that does not resolve.
    pub fn udp(target: &str) -> Result<Self, DeviceError> {
        let failed = |source| DeviceError::Udp { address: target.to_owned(), source };
        let socket = UdpSocket::bind(("0.0.0.0", 0)).map_err(failed)?;
        socket.connect(target).map_err(failed)?;
        Ok(Self { link: VibrationLink::Udp(socket), name: target.to_owned() })
    }

    /// Lines to the serial port at `path`, which is set to 115200 baud, eight bits, no echo; or to a pipe or file.
    ///
    /// # Errors
    /// [`DeviceError::Sink`] if it cannot be opened, or is a device and no serial port. Opening may wait for the other end.
    pub fn serial(path: &Path) -> Result<Self, DeviceError> {
        let name = path.display().to_string();
        let failed = |reason: String| DeviceError::Sink { sink: name.clone(), reason };
        let file = OpenOptions::new().append(true).open(path).map_err(|error| failed(error.to_string()))?;
        let kind = file.metadata().map_err(|error| failed(error.to_string()))?.file_type();
        if kind.is_char_device() {
            let set = Command::new("stty")
                .arg("-F")
                .arg(path)
                .args(["115200", "raw", "-echo"])
                .stderr(Stdio::null())
                .status();
            if !set.is_ok_and(|status| status.success()) {
                return Err(failed("it is no serial port that can be set to 115200 baud".to_owned()));
            }
        }
        Ok(Self { link: VibrationLink::Serial(file), name })
    }

    fn send(&mut self, line: VibrationLine) -> io::Result<()> {
        let bytes = format!("{line}\n");
        match &mut self.link {
            VibrationLink::Serial(port) => port.write_all(bytes.as_bytes()),
            VibrationLink::Udp(socket) => match socket.send(bytes.as_bytes()) {
                Err(error) if error.kind() == io::ErrorKind::ConnectionRefused => Ok(()),
                sent => sent.map(drop),
            },
        }
    }
}

impl FeedbackSink for VibrationDriver {
    fn begin(&mut self, cue: &FeedbackCue) -> Result<(), DeviceError> {
        VibrationLine::lines_for(cue)
            .try_for_each(|line| self.send(line))
            .map_err(|error| DeviceError::Sink { sink: self.name.clone(), reason: error.to_string() })
    }
}

/// The driver's own side, for tests and as a model for firmware: bytes in, as they come; motors out.
#[derive(Clone, Debug, Default)]
pub struct VibrationDevice {
    partial: Vec<u8>,
    /// Lines that were understood.
    pub lines: Vec<VibrationLine>,
    /// Lines that were not.
    pub refused: Vec<String>,
}

impl VibrationDevice {
    /// Longest line, bytes; of a longer one the rest counts as a line of its own.
    const MAX_LINE_BYTES: usize = 32;

    /// Takes bytes as a serial port or a datagram brings them.
    pub fn receive(&mut self, bytes: &[u8]) {
        for byte in bytes {
            if *byte != b'\n' && self.partial.len() < Self::MAX_LINE_BYTES {
                self.partial.push(*byte);
                continue;
            }
            let line = String::from_utf8_lossy(&std::mem::take(&mut self.partial)).into_owned();
            match line.parse() {
                Ok(line) => self.lines.push(line),
                Err(reason) => self.refused.push(reason),
            }
            if *byte != b'\n' {
                self.partial.push(*byte);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proact_types::{Cue, Digit, SimTime};
    use std::{io::Read, time::Duration};

    fn cues() -> [FeedbackCue; 3] {
        let digit = |number| Some(Digit { number, link: "finger".to_owned() });
        let buzz = |strength, ms| Some(Vibration { strength, ms });
        let (time, sound) = (SimTime(5), Some(Tone { hz: [440.0, 660.4], ms: 150 }));
        [
            FeedbackCue { time, cue: Cue::ContactMade, digit: None, sound, vibration: buzz(1.0, 150) },
            FeedbackCue { time, cue: Cue::Pressure, digit: digit(2), sound: None, vibration: buzz(0.5, 40) },
            FeedbackCue { time, cue: Cue::Pressure, digit: digit(2), sound: None, vibration: buzz(0.0, 0) },
        ]
    }

    const BYTES: &str = "V * 255 150\nT 440 660 150\nV 2 128 40\nV 2 0 0\n";

    #[test]
    fn a_serial_port_gets_these_bytes_and_the_device_understands_every_line() {
        let temp_dir = tempfile::tempdir().unwrap();
        let path = temp_dir.path().join("port");
        std::fs::write(&path, "").unwrap();
        let mut driver = VibrationDriver::serial(&path).unwrap();
        cues().iter().for_each(|cue| driver.begin(cue).unwrap());
        let mut written = String::new();
        File::open(&path).unwrap().read_to_string(&mut written).unwrap();
        assert_eq!(written, BYTES);
        let mut device = VibrationDevice::default();
        // A port brings bytes in pieces of any length.
        written.as_bytes().chunks(3).for_each(|piece| device.receive(piece));
        assert!(device.refused.is_empty(), "{:?}", device.refused);
        assert_eq!(device.lines.iter().map(|line| format!("{line}\n")).collect::<String>(), BYTES);
        assert_eq!(device.lines[2], VibrationLine::Vibrate { motor: Some(2), strength: 128, ms: 40 });
    }

    #[test]
    fn each_datagram_is_a_line_and_a_missing_listener_is_no_error() {
        let listener = UdpSocket::bind("127.0.0.1:0").unwrap();
        listener.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
        let mut driver = VibrationDriver::udp(&listener.local_addr().unwrap().to_string()).unwrap();
        cues().iter().for_each(|cue| driver.begin(cue).unwrap());
        let mut got = String::new();
        let mut bytes = [0; 64];
        for _ in 0..4 {
            let count = listener.recv(&mut bytes).unwrap();
            got += std::str::from_utf8(&bytes[..count]).unwrap();
        }
        assert_eq!(got, BYTES);
        drop(listener);
        cues().iter().for_each(|cue| driver.begin(cue).unwrap());
    }

    #[test]
    fn what_is_no_line_is_refused_and_the_next_is_understood() {
        let mut device = VibrationDevice::default();
        device.receive(b"V 2 300 40\nV 2  128 40\nX\nV 1 +5 40\n\nT 1 2\n");
        device.receive(&[b'V'; 100]);
        device.receive(b"\nV 1 5 40\n");
        assert_eq!(device.lines, [VibrationLine::Vibrate { motor: Some(1), strength: 5, ms: 40 }]);
        assert!(device.refused.len() >= 6, "{:?}", device.refused);
    }

    #[test]
    fn a_device_that_is_no_serial_port_is_refused() {
        let error = VibrationDriver::serial("/dev/null".as_ref()).err().unwrap().to_string();
        assert!(error.contains("/dev/null") && error.contains("no serial port"), "{error}");
    }
}
