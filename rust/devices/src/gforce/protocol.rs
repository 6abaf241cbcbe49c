//! Commands, replies and settings, byte for byte. Everything is little endian.
//!
//! From OyMotion's published SDKs; points that those leave open are marked in the docs.

use arrayvec::ArrayVec;

/// The service that the armband advertises; scans look for it.
pub const SERVICE: &str = "0000ffd0-0000-1000-8000-00805f9b34fb";
/// Commands are written here, replies come back as notifications.
pub const COMMAND_CHARACTERISTIC: &str = "f000ffe1-0451-4000-b000-000000000000";
/// Samples come as notifications.
pub const DATA_CHARACTERISTIC: &str = "f000ffe2-0451-4000-b000-000000000000";

/// First byte of a data notification with EMG.
pub const EMG_DATA: u8 = 0x08;
/// First byte of a fragment of a longer message, on either characteristic.
pub const FRAGMENT: u8 = 0xFF;

/// Which characteristic of an armband. A gForce has the first two, a Myo has all but [`Characteristic::Data`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Characteristic {
    /// Commands and replies.
    Command,
    /// Samples.
    Data,
    /// Samples of a Myo come on four characteristics in turn.
    Emg0,
    /// The second.
    Emg1,
    /// The third.
    Emg2,
    /// The fourth.
    Emg3,
    /// Version of the firmware.
    Firmware,
    /// Charge of the battery.
    Battery,
    /// Inertial measurement unit of a Myo.
    Imu,
}

impl Characteristic {
    /// By the number that they have in the simulator's frames, from 1.
    const FRAME_ORDER: [Characteristic; 9] = [
        Characteristic::Command,
        Characteristic::Data,
        Characteristic::Emg0,
        Characteristic::Emg1,
        Characteristic::Emg2,
        Characteristic::Emg3,
        Characteristic::Firmware,
        Characteristic::Battery,
        Characteristic::Imu,
    ];

    /// Its number in the simulator's frames.
    pub(super) fn frame_number(self) -> u8 {
        self as u8 + 1
    }

    /// The one of this number.
    pub(super) fn from_frame_number(number: u8) -> Option<Characteristic> {
        Self::FRAME_ORDER.get(usize::from(number).checked_sub(1)?).copied()
    }
}

/// What can be wrong with bytes or settings.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum GForceProtocolError {
    /// Fewer or more bytes than the message has.
    #[error("{what} has {got} bytes, expected {expected}")]
    Length {
        /// Which message.
        what: &'static str,
        /// Its bytes.
        got: usize,
        /// As it should be.
        expected: &'static str,
    },
    /// An operation that the protocol does not have, or that this program does not use.
    #[error("operation {opcode:#04x} is unknown")]
    Opcode {
        /// The first byte.
        opcode: u8,
    },
    /// A setting that the armband cannot have.
    #[error("{what} is {value}, expected {expected}")]
    Setting {
        /// Such as `EMG rate`.
        what: &'static str,
        /// As given.
        value: u32,
        /// What is possible.
        expected: &'static str,
    },
}

/// Body of the commands that set and read the EMG configuration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EmgSetting {
    /// Samples per second.
    pub rate_hz: u16,
    /// A bit for each channel, the lowest is channel 0.
    pub channel_mask: u16,
    /// Bytes of samples in a packet.
    pub packet_bytes: u8,
    /// Bits of a code: 8 or 12.
    pub bits: u8,
}

impl EmgSetting {
    /// As ProACT sets the armband: 1000 Hz, 8 channels, 8 bit, 16 samples a packet (arXiv:2407.05025).
    pub const PROACT_DEFAULT: EmgSetting =
        EmgSetting { rate_hz: 1000, channel_mask: 0xFF, packet_bytes: 128, bits: 8 };
    /// The finer converter: 500 Hz, 8 channels, 12 bit, 8 samples a packet.
    pub const HIGH_RESOLUTION: EmgSetting =
        EmgSetting { rate_hz: 500, channel_mask: 0xFF, packet_bytes: 128, bits: 12 };

    /// Number of channels.
    pub fn channels(self) -> usize {
        self.channel_mask.count_ones() as usize
    }

    /// Bytes of one code.
    pub fn code_bytes(self) -> usize {
        if self.bits > 8 { 2 } else { 1 }
    }

    /// Samples in a packet.
    pub fn packet_samples(self) -> usize {
        usize::from(self.packet_bytes) / (self.channels() * self.code_bytes()).max(1)
    }

    /// The code of zero volts: the middle. The maker's own programs disagree (128 or 119 at 8 bit).
    pub fn zero_code(self) -> f64 {
        f64::from(1_u16 << (self.bits - 1))
    }

    /// The largest code.
    pub fn max_code(self) -> f64 {
        f64::from((1_u16 << self.bits) - 1)
    }

    /// Volts of one code: 2.5 V behind an amplifier of 1200, by LibEMG's driver. Nominal: the maker's own programs disagree.
    pub fn volts_per_code(self) -> f64 {
        2.5 / 1200.0 / (self.zero_code() - 1.0)
    }

    /// Seconds from packet to packet.
    pub fn packet_secs(self) -> f64 {
        self.packet_samples() as f64 / f64::from(self.rate_hz)
    }

    /// Checks what can be checked without the armband. It may still refuse a rate.
    ///
    /// # Errors
    /// [`GForceProtocolError::Setting`] with the first impossible value.
    pub fn check(self) -> Result<(), GForceProtocolError> {
        let wrong = |what, value: u32, expected| Err(GForceProtocolError::Setting { what, value, expected });
        // The bandwidth of the radio: stated by the maker in BrainFlow's pull request 270.
        let (fastest, expected) = match self.bits {
            8 => (1000, "1 to 1000 Hz at 8 bit"),
            12 => (500, "1 to 500 Hz at 12 bit"),
            bits => return wrong("resolution", bits.into(), "8 or 12 bit"),
        };
        if !(1..=fastest).contains(&self.rate_hz) {
            return wrong("EMG rate", self.rate_hz.into(), expected);
        }
        if self.channels() == 0 {
            return wrong("channel mask", self.channel_mask.into(), "at least one bit set");
        }
        let sample = self.channels() * self.code_bytes();
        if self.packet_bytes == 0 || !usize::from(self.packet_bytes).is_multiple_of(sample) {
            return wrong("bytes of a packet", self.packet_bytes.into(), "a whole number of samples");
        }
        Ok(())
    }

    /// The six bytes.
    pub fn to_bytes(self) -> [u8; 6] {
        let ([r0, r1], [m0, m1]) = (self.rate_hz.to_le_bytes(), self.channel_mask.to_le_bytes());
        [r0, r1, m0, m1, self.packet_bytes, self.bits]
    }

    /// From the six bytes, unchecked.
    ///
    /// # Errors
    /// [`GForceProtocolError::Length`].
    pub fn from_bytes(bytes: &[u8]) -> Result<EmgSetting, GForceProtocolError> {
        let &[r0, r1, m0, m1, packet_bytes, bits] = bytes else {
            return Err(GForceProtocolError::Length { what: "EMG setting", got: bytes.len(), expected: "6" });
        };
        Ok(EmgSetting {
            rate_hz: u16::from_le_bytes([r0, r1]),
            channel_mask: u16::from_le_bytes([m0, m1]),
            packet_bytes,
            bits,
        })
    }
}

/// What is written to the command characteristic.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GForceCommand {
    /// Text or up to four numbers.
    Firmware,
    /// Per cent.
    Battery,
    /// The vibration motor, for feedback.
    Motor(bool),
    /// The lamp.
    Led(bool),
    /// A counter in every data packet: the only detector of losses.
    PackageId(bool),
    /// Highest rate, number of channels, largest packet.
    EmgCapability,
    /// Sets rate, channels, packet and resolution.
    SetEmg(EmgSetting),
    /// Reads them back.
    GetEmg,
    /// Which kinds of data are sent; a bit each.
    DataSwitch(u32),
}

/// [`GForceCommand::DataSwitch`]: raw EMG. Orientation beside EMG has broken EMG data on devices (BrainFlow issue 703), so it is left
/// off unless it is asked for.
pub const SWITCH_EMG: u32 = 0x80;
/// [`GForceCommand::DataSwitch`]: acceleration, angular velocity and orientation.
pub const SWITCH_IMU: u32 = 0x01 | 0x02 | 0x10;

impl GForceCommand {
    /// The first byte.
    pub fn opcode(self) -> u8 {
        match self {
            GForceCommand::Firmware => 0x06,
            GForceCommand::Battery => 0x08,
            GForceCommand::Motor(_) => 0x24,
            GForceCommand::Led(_) => 0x25,
            GForceCommand::PackageId(_) => 0x26,
            GForceCommand::EmgCapability => 0x3E,
            GForceCommand::SetEmg(_) => 0x3F,
            GForceCommand::GetEmg => 0x46,
            GForceCommand::DataSwitch(_) => 0x4F,
        }
    }

    /// All bytes.
    pub fn to_bytes(self) -> ArrayVec<u8, 8> {
        let mut bytes = ArrayVec::new();
        bytes.push(self.opcode());
        match self {
            GForceCommand::Motor(on) | GForceCommand::Led(on) | GForceCommand::PackageId(on) => {
                bytes.push(u8::from(on))
            }
            GForceCommand::SetEmg(setting) => bytes.extend(setting.to_bytes()),
            GForceCommand::DataSwitch(flags) => bytes.extend(flags.to_le_bytes()),
            GForceCommand::Firmware
            | GForceCommand::Battery
            | GForceCommand::EmgCapability
            | GForceCommand::GetEmg => {}
        }
        bytes
    }

    /// The command that `bytes` are, as the armband reads it.
    ///
    /// # Errors
    /// An operation that is not among these, or a body of another length.
    pub fn from_bytes(bytes: &[u8]) -> Result<GForceCommand, GForceProtocolError> {
        let Some((&opcode, body)) = bytes.split_first() else {
            return Err(GForceProtocolError::Length { what: "command", got: 0, expected: "at least 1" });
        };
        let length =
            |expected| GForceProtocolError::Length { what: "body of the command", got: body.len(), expected };
        let empty = |command| if body.is_empty() { Ok(command) } else { Err(length("0")) };
        let on = || match body {
            [0] => Ok(false),
            [1] => Ok(true),
            &[value] => {
                let value = u32::from(value);
                Err(GForceProtocolError::Setting { what: "switch", value, expected: "0 or 1" })
            }
            _ => Err(length("1")),
        };
        match opcode {
            0x06 => empty(GForceCommand::Firmware),
            0x08 => empty(GForceCommand::Battery),
            0x24 => on().map(GForceCommand::Motor),
            0x25 => on().map(GForceCommand::Led),
            0x26 => on().map(GForceCommand::PackageId),
            0x3E => empty(GForceCommand::EmgCapability),
            0x3F => EmgSetting::from_bytes(body).map(GForceCommand::SetEmg),
            0x46 => empty(GForceCommand::GetEmg),
            0x4F => match body.try_into() {
                Ok(flags) => Ok(GForceCommand::DataSwitch(u32::from_le_bytes(flags))),
                Err(_) => Err(length("4")),
            },
            opcode => Err(GForceProtocolError::Opcode { opcode }),
        }
    }
}

/// How the armband judges a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GForceReplyCode {
    /// Done.
    Ok,
    /// It does not know the operation.
    NotSupported,
    /// It does not accept the body.
    BadParameter,
    /// It tried in vain.
    Failed,
    /// It tried too long.
    TimedOut,
    /// None of the codes known.
    Unknown(u8),
}

impl GForceReplyCode {
    /// The byte.
    pub fn to_byte(self) -> u8 {
        match self {
            GForceReplyCode::Ok => 0,
            GForceReplyCode::NotSupported => 1,
            GForceReplyCode::BadParameter => 2,
            GForceReplyCode::Failed => 3,
            GForceReplyCode::TimedOut => 4,
            GForceReplyCode::Unknown(byte) => byte,
        }
    }

    fn from_byte(byte: u8) -> GForceReplyCode {
        match byte {
            0 => GForceReplyCode::Ok,
            1 => GForceReplyCode::NotSupported,
            2 => GForceReplyCode::BadParameter,
            3 => GForceReplyCode::Failed,
            4 => GForceReplyCode::TimedOut,
            byte => GForceReplyCode::Unknown(byte),
        }
    }
}

impl std::fmt::Display for GForceReplyCode {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            GForceReplyCode::Ok => f.write_str("done"),
            GForceReplyCode::NotSupported => f.write_str("not supported"),
            GForceReplyCode::BadParameter => f.write_str("bad parameter"),
            GForceReplyCode::Failed => f.write_str("failed"),
            GForceReplyCode::TimedOut => f.write_str("timed out inside the armband"),
            GForceReplyCode::Unknown(byte) => write!(f, "unknown code {byte}"),
        }
    }
}

/// A reply on the command characteristic.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GForceReply<'a> {
    /// The verdict.
    pub code: GForceReplyCode,
    /// Which operation it answers.
    pub opcode: u8,
    /// What was asked for.
    pub body: &'a [u8],
}

impl<'a> GForceReply<'a> {
    /// Reads one.
    ///
    /// # Errors
    /// [`GForceProtocolError::Length`] below two bytes.
    pub fn from_bytes(bytes: &'a [u8]) -> Result<GForceReply<'a>, GForceProtocolError> {
        let &[code, opcode, ref body @ ..] = bytes else {
            return Err(GForceProtocolError::Length {
                what: "reply",
                got: bytes.len(),
                expected: "at least 2",
            });
        };
        Ok(GForceReply { code: GForceReplyCode::from_byte(code), opcode, body })
    }
}

/// Body of the reply to [`GForceCommand::EmgCapability`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EmgCapability {
    /// Highest rate, Hz.
    pub max_rate_hz: u16,
    /// Number of channels.
    pub channels: u16,
    /// Largest packet.
    pub max_packet_bytes: u8,
}

impl EmgCapability {
    /// The five bytes.
    pub fn to_bytes(self) -> [u8; 5] {
        let ([r0, r1], [c0, c1]) = (self.max_rate_hz.to_le_bytes(), self.channels.to_le_bytes());
        [r0, r1, c0, c1, self.max_packet_bytes]
    }

    /// From the five bytes.
    ///
    /// # Errors
    /// [`GForceProtocolError::Length`].
    pub fn from_bytes(bytes: &[u8]) -> Result<EmgCapability, GForceProtocolError> {
        let &[r0, r1, c0, c1, max_packet_bytes] = bytes else {
            return Err(GForceProtocolError::Length {
                what: "EMG capability",
                got: bytes.len(),
                expected: "5",
            });
        };
        Ok(EmgCapability {
            max_rate_hz: u16::from_le_bytes([r0, r1]),
            channels: u16::from_le_bytes([c0, c1]),
            max_packet_bytes,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn commands_are_the_bytes_of_the_vendor_programs() {
        let hex = |command: GForceCommand| -> String {
            command.to_bytes().iter().map(|b| format!("{b:02X} ")).collect::<String>().trim_end().to_owned()
        };
        assert_eq!(hex(GForceCommand::SetEmg(EmgSetting::PROACT_DEFAULT)), "3F E8 03 FF 00 80 08");
        assert_eq!(hex(GForceCommand::SetEmg(EmgSetting::HIGH_RESOLUTION)), "3F F4 01 FF 00 80 0C");
        assert_eq!(hex(GForceCommand::DataSwitch(SWITCH_EMG)), "4F 80 00 00 00");
        assert_eq!(hex(GForceCommand::DataSwitch(0)), "4F 00 00 00 00");
        assert_eq!(hex(GForceCommand::Motor(true)), "24 01");
        assert_eq!(hex(GForceCommand::PackageId(true)), "26 01");
        assert_eq!(hex(GForceCommand::GetEmg), "46");
        assert_eq!(hex(GForceCommand::Firmware), "06");
    }

    #[test]
    fn replies_of_the_vendor_programs_are_read() {
        let reply = GForceReply::from_bytes(&[0x00, 0x46, 0xE8, 0x03, 0xFF, 0x00, 0x80, 0x08]).unwrap();
        assert_eq!((reply.code, reply.opcode), (GForceReplyCode::Ok, 0x46));
        assert_eq!(EmgSetting::from_bytes(reply.body), Ok(EmgSetting::PROACT_DEFAULT));
        let refusal = GForceReply::from_bytes(&[0x02, 0x3F]).unwrap();
        assert_eq!(
            (refusal.code, refusal.opcode, refusal.body),
            (GForceReplyCode::BadParameter, 0x3F, &[][..])
        );
        assert!(GForceReply::from_bytes(&[0]).unwrap_err().to_string().contains("reply has 1 bytes"));
    }

    #[test]
    fn settings_give_the_packets_that_were_observed() {
        let of =
            |s: EmgSetting| (s.channels(), s.packet_samples(), s.packet_secs(), s.zero_code(), s.max_code());
        assert_eq!(of(EmgSetting::PROACT_DEFAULT), (8, 16, 0.016, 128.0, 255.0));
        assert_eq!(of(EmgSetting::HIGH_RESOLUTION), (8, 8, 0.016, 2048.0, 4095.0));
    }

    #[test]
    fn impossible_settings_are_refused() {
        let refused = |change: fn(&mut EmgSetting)| {
            let mut setting = EmgSetting::PROACT_DEFAULT;
            change(&mut setting);
            setting.check().unwrap_err().to_string()
        };
        assert!(refused(|s| s.rate_hz = 1001).contains("EMG rate is 1001"));
        assert!(refused(|s| s.rate_hz = 0).contains("EMG rate is 0"));
        assert!(refused(|s| s.bits = 12).contains("500 Hz at 12 bit"));
        assert!(refused(|s| s.bits = 24).contains("resolution is 24"));
        assert!(refused(|s| s.channel_mask = 0).contains("channel mask is 0"));
        assert!(refused(|s| s.packet_bytes = 130).contains("whole number of samples"));
        assert!(refused(|s| s.packet_bytes = 0).contains("bytes of a packet is 0"));
        assert_eq!(EmgSetting::HIGH_RESOLUTION.check(), Ok(()));
    }

    proptest! {
        #[test]
        fn any_bytes_are_a_command_that_encodes_to_them_or_an_error(bytes in prop::collection::vec(any::<u8>(), 0..12)) {
            if let Ok(command) = GForceCommand::from_bytes(&bytes) {
                let again = command.to_bytes();
                prop_assert_eq!(again.as_slice(), bytes.as_slice());
            }
        }

        #[test]
        fn settings_and_capabilities_survive_the_wire(rate: u16, mask: u16, packet: u8, bits: u8) {
            let setting = EmgSetting { rate_hz: rate, channel_mask: mask, packet_bytes: packet, bits };
            prop_assert_eq!(EmgSetting::from_bytes(&setting.to_bytes()), Ok(setting));
            let capability = EmgCapability { max_rate_hz: rate, channels: mask, max_packet_bytes: packet };
            prop_assert_eq!(EmgCapability::from_bytes(&capability.to_bytes()), Ok(capability));
            // Whatever the values are, asking whether they can work does not panic.
            let _ = setting.check();
        }
    }
}
