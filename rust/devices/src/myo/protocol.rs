//! Commands, characteristics and data, byte for byte.
//!
//! From the maker's published header, `myohw.h` (Thalmic Labs, 2015). It calls all values big-endian; armbands send them
//! little-endian, as every driver reads them.

use crate::gforce::Characteristic;

/// The service that the armband advertises; scans look for it.
pub const SERVICE: &str = "d5060001-a904-deb9-4748-2c7f4a124842";
/// Commands are written here. There are no replies.
pub const COMMAND_CHARACTERISTIC: &str = "d5060401-a904-deb9-4748-2c7f4a124842";
/// Version of the firmware, read.
pub const FIRMWARE_CHARACTERISTIC: &str = "d5060201-a904-deb9-4748-2c7f4a124842";
/// Charge, read: that of every Bluetooth device.
pub const BATTERY_CHARACTERISTIC: &str = "00002a19-0000-1000-8000-00805f9b34fb";
/// Samples come as notifications of these four in turn.
pub const EMG_CHARACTERISTICS: [&str; 4] = [
    "d5060105-a904-deb9-4748-2c7f4a124842",
    "d5060205-a904-deb9-4748-2c7f4a124842",
    "d5060305-a904-deb9-4748-2c7f4a124842",
    "d5060405-a904-deb9-4748-2c7f4a124842",
];
/// The same four, as this program names them.
pub const EMG: [Characteristic; 4] =
    [Characteristic::Emg0, Characteristic::Emg1, Characteristic::Emg2, Characteristic::Emg3];

/// Samples a second. There is no other rate.
pub const RATE_HZ: u16 = 200;
/// Electrodes.
pub const CHANNELS: usize = 8;
/// Samples in a notification.
pub const PACKET_SAMPLES: usize = 2;
/// Bytes of a notification: a signed one a channel and sample.
pub const PACKET_BYTES: usize = PACKET_SAMPLES * CHANNELS;

/// What the armband sends of its electrodes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum MyoEmgMode {
    /// Nothing.
    Off,
    /// Mains hum taken out by the armband, as LibEMG asks for.
    #[default]
    Filtered,
    /// As converted.
    Raw,
}

/// How long the motor runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MyoVibration {
    /// Not at all.
    Off,
    /// A short time.
    Short,
    /// A medium time.
    Medium,
    /// A long time.
    Long,
}

/// What is written to the command characteristic.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MyoCommand {
    /// What is sent. Motion data and the armband's own classifier stay off.
    SetMode(MyoEmgMode),
    /// Runs the motor.
    Vibrate(MyoVibration),
    /// Whether it may fall asleep when nobody moves: a relaxed hand looks like that.
    MaySleep(bool),
    /// Tells the person, by a short buzz, that something was taken in.
    UserAction,
}

impl MyoCommand {
    /// All bytes: number of the command, length of the rest, the rest.
    pub fn to_bytes(self) -> Vec<u8> {
        match self {
            MyoCommand::SetMode(mode) => {
                let emg = match mode {
                    MyoEmgMode::Off => 0,
                    MyoEmgMode::Filtered => 2,
                    MyoEmgMode::Raw => 3,
                };
                vec![0x01, 3, emg, 0, 0]
            }
            MyoCommand::Vibrate(kind) => {
                let kind = match kind {
                    MyoVibration::Off => 0,
                    MyoVibration::Short => 1,
                    MyoVibration::Medium => 2,
                    MyoVibration::Long => 3,
                };
                vec![0x03, 1, kind]
            }
            MyoCommand::MaySleep(may) => vec![0x09, 1, u8::from(!may)],
            MyoCommand::UserAction => vec![0x0B, 1, 0],
        }
    }

    /// The command that `bytes` are, as the armband reads it; none if they are none that is used here.
    pub fn from_bytes(bytes: &[u8]) -> Option<MyoCommand> {
        Some(match bytes {
            [0x01, 3, emg, 0, 0] => MyoCommand::SetMode(match emg {
                0 => MyoEmgMode::Off,
                2 => MyoEmgMode::Filtered,
                3 => MyoEmgMode::Raw,
                _ => return None,
            }),
            [0x03, 1, kind] => MyoCommand::Vibrate(match kind {
                0 => MyoVibration::Off,
                1 => MyoVibration::Short,
                2 => MyoVibration::Medium,
                3 => MyoVibration::Long,
                _ => return None,
            }),
            [0x09, 1, never @ (0 | 1)] => MyoCommand::MaySleep(*never == 0),
            [0x0B, 1, 0] => MyoCommand::UserAction,
            _ => return None,
        })
    }
}

/// The version in the eight bytes of the firmware characteristic: major, minor, patch, revision of the hardware.
pub fn firmware_version(bytes: &[u8]) -> Option<String> {
    let &[a0, a1, b0, b1, c0, c1, _, _] = bytes else { return None };
    let [major, minor, patch] = [[a0, a1], [b0, b1], [c0, c1]].map(u16::from_le_bytes);
    Some(format!("{major}.{minor}.{patch}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_are_those_of_the_published_header() {
        for (command, bytes) in [
            (MyoCommand::SetMode(MyoEmgMode::Off), &[0x01, 0x03, 0x00, 0x00, 0x00][..]),
            (MyoCommand::SetMode(MyoEmgMode::Filtered), &[0x01, 0x03, 0x02, 0x00, 0x00]),
            (MyoCommand::SetMode(MyoEmgMode::Raw), &[0x01, 0x03, 0x03, 0x00, 0x00]),
            (MyoCommand::Vibrate(MyoVibration::Off), &[0x03, 0x01, 0x00]),
            (MyoCommand::Vibrate(MyoVibration::Short), &[0x03, 0x01, 0x01]),
            (MyoCommand::Vibrate(MyoVibration::Medium), &[0x03, 0x01, 0x02]),
            (MyoCommand::Vibrate(MyoVibration::Long), &[0x03, 0x01, 0x03]),
            (MyoCommand::MaySleep(true), &[0x09, 0x01, 0x00]),
            (MyoCommand::MaySleep(false), &[0x09, 0x01, 0x01]),
            (MyoCommand::UserAction, &[0x0B, 0x01, 0x00]),
        ] {
            assert_eq!(command.to_bytes(), bytes);
            assert_eq!(MyoCommand::from_bytes(bytes), Some(command));
        }
        // Another length, another value, deep sleep, nothing.
        for wrong in
            [&[0x01, 0x03, 0x02][..], &[0x01, 0x03, 0x01, 0, 0], &[0x03, 0x01, 9], &[0x04, 0x00], &[]]
        {
            assert_eq!(MyoCommand::from_bytes(wrong), None, "{wrong:?}");
        }
    }

    #[test]
    fn the_version_of_the_firmware_is_three_numbers() {
        assert_eq!(firmware_version(&[1, 0, 5, 0, 0xB2, 0x07, 2, 0]), Some("1.5.1970".to_owned()));
        assert_eq!(firmware_version(&[1, 0]), None);
    }
}
