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
pub const EMG_CHARACTERISTIC_ORDER: [Characteristic; 4] =
    [Characteristic::Emg0, Characteristic::Emg1, Characteristic::Emg2, Characteristic::Emg3];

/// What its inertial measurement unit says comes as notifications of this one.
pub const IMU_CHARACTERISTIC: &str = "d5060402-a904-deb9-4748-2c7f4a124842";
/// Bytes of such a notification: unit quaternion w, x, y, z, acceleration x, y, z and angular velocity x, y, z, 16 bits each.
pub const IMU_BYTES: usize = 20;
/// Notifications of it a second.
pub const IMU_RATE_HZ: u16 = 50;
/// Codes of one, of 1 g and of 1 deg/s.
const IMU_SCALES: [f64; 3] = [16384.0, 2048.0, 16.0];

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
    /// What is sent. The armband's own classifier stays off.
    SetMode {
        /// Of its electrodes.
        emg: MyoEmgMode,
        /// Of its inertial measurement unit: nothing, or all of it.
        imu: bool,
    },
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
            MyoCommand::SetMode { emg, imu } => {
                let emg = match emg {
                    MyoEmgMode::Off => 0,
                    MyoEmgMode::Filtered => 2,
                    MyoEmgMode::Raw => 3,
                };
                vec![0x01, 3, emg, u8::from(imu), 0]
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
            [0x01, 3, emg, imu @ (0 | 1), 0] => MyoCommand::SetMode {
                emg: match emg {
                    0 => MyoEmgMode::Off,
                    2 => MyoEmgMode::Filtered,
                    3 => MyoEmgMode::Raw,
                    _ => return None,
                },
                imu: *imu == 1,
            },
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

/// What a notification of the inertial measurement unit says, in the order and units of [`ImuChannel::of_an_armband`]; none for
/// one of another length.
pub fn imu_values(bytes: &[u8]) -> Option<[f64; 10]> {
    let bytes: &[u8; IMU_BYTES] = bytes.try_into().ok()?;
    Some(std::array::from_fn(|k| {
        f64::from(i16::from_le_bytes([bytes[2 * k], bytes[2 * k + 1]])) / IMU_SCALES[scale_index(k)]
    }))
}

/// The notification that says `values`, cut off at the ends of the range.
pub fn imu_bytes(values: &[f64; 10]) -> [u8; IMU_BYTES] {
    let mut bytes = [0; IMU_BYTES];
    for (k, (value, bytes_out)) in values.iter().zip(bytes.chunks_exact_mut(2)).enumerate() {
        bytes_out.copy_from_slice(&((value * IMU_SCALES[scale_index(k)]).round() as i16).to_le_bytes());
    }
    bytes
}

/// Orientation, acceleration or angular velocity.
fn scale_index(channel: usize) -> usize {
    match channel {
        0..4 => 0,
        4..7 => 1,
        _ => 2,
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
        let mode = |emg, imu| MyoCommand::SetMode { emg, imu };
        for (command, bytes) in [
            (mode(MyoEmgMode::Off, false), &[0x01, 0x03, 0x00, 0x00, 0x00][..]),
            (mode(MyoEmgMode::Filtered, false), &[0x01, 0x03, 0x02, 0x00, 0x00]),
            (mode(MyoEmgMode::Raw, false), &[0x01, 0x03, 0x03, 0x00, 0x00]),
            (mode(MyoEmgMode::Filtered, true), &[0x01, 0x03, 0x02, 0x01, 0x00]),
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
        // Another length, another value, motion events, deep sleep, nothing.
        for wrong in [
            &[0x01, 0x03, 0x02][..],
            &[0x01, 3, 2, 2, 0],
            &[0x01, 0x03, 0x01, 0, 0],
            &[0x03, 0x01, 9],
            &[0x04, 0x00],
            &[],
        ] {
            assert_eq!(MyoCommand::from_bytes(wrong), None, "{wrong:?}");
        }
    }

    /// Bytes by the header's structure and scales: a quarter turn about x, 1 g along z, 2 deg/s about y.
    #[test]
    fn the_inertial_measurement_unit_sends_ten_numbers_of_two_bytes() {
        let mut values = [0.0; 10];
        (values[0], values[1], values[6], values[8]) = (0.5_f64.sqrt(), 0.5_f64.sqrt(), 1.0, -2.0);
        let bytes = imu_bytes(&values);
        assert_eq!(bytes[..4], [0x41, 0x2D, 0x41, 0x2D], "11585 twice");
        assert_eq!((&bytes[12..14], &bytes[16..18]), (&[0x00, 0x08][..], &[0xE0, 0xFF][..]));
        let read = imu_values(&bytes).unwrap();
        for (k, (value, read)) in values.iter().zip(read).enumerate() {
            assert!((value - read).abs() <= 0.5 / IMU_SCALES[scale_index(k)], "{k}");
        }
        assert_eq!(imu_values(&bytes[1..]), None);
        assert_eq!(imu_bytes(&[1e9; 10])[..2], [0xFF, 0x7F]);
    }

    #[test]
    fn the_version_of_the_firmware_is_three_numbers() {
        assert_eq!(firmware_version(&[1, 0, 5, 0, 0xB2, 0x07, 2, 0]), Some("1.5.1970".to_owned()));
        assert_eq!(firmware_version(&[1, 0]), None);
    }
}
