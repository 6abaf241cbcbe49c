//! Messages of a gForce's inertial measurement unit, byte for byte, from the same sources as [`super::protocol`].

/// First byte of a data notification with the acceleration: three 32-bit integers, of which 65536 are 1 g.
pub const ACCELERATION_DATA: u8 = 0x01;
/// First byte of a data notification with the angular velocity: three 32-bit integers, of which 65536 are 1 deg/s.
pub const ANGULAR_VELOCITY_DATA: u8 = 0x02;
/// First byte of a data notification with the orientation: a unit quaternion w, x, y, z of 32-bit floating-point numbers.
pub const ORIENTATION_DATA: u8 = 0x05;
/// Codes of 1 g, and of 1 deg/s.
const IMU_SCALE: f64 = 65536.0;

/// Puts what a data message of the inertial measurement unit says into its place in `values`, which are those of
/// [`proact_emg::ImuChannel::of_an_armband`]. False for a message of another kind or length.
pub fn read_imu(message: &[u8], values: &mut [f64; 10]) -> bool {
    let Some((&kind, body)) = message.split_first() else { return false };
    let offset = match (kind, body.len()) {
        (ORIENTATION_DATA, 16) => 0..4,
        (ACCELERATION_DATA, 12) => 4..7,
        (ANGULAR_VELOCITY_DATA, 12) => 7..10,
        _ => return false,
    };
    for (value, bytes) in values[offset].iter_mut().zip(body.chunks_exact(4)) {
        let bytes = [bytes[0], bytes[1], bytes[2], bytes[3]];
        *value = match kind {
            ORIENTATION_DATA => f32::from_le_bytes(bytes).into(),
            _ => f64::from(i32::from_le_bytes(bytes)) / IMU_SCALE,
        };
    }
    true
}

/// The three data messages that say `values`.
pub fn imu_messages(values: &[f64; 10]) -> [Vec<u8>; 3] {
    let scaled = |kind: u8, values: &[f64]| {
        let codes = values.iter().flat_map(|value| ((value * IMU_SCALE).round() as i32).to_le_bytes());
        std::iter::once(kind).chain(codes).collect()
    };
    let orientation = values[..4].iter().flat_map(|value| (*value as f32).to_le_bytes());
    [
        std::iter::once(ORIENTATION_DATA).chain(orientation).collect(),
        scaled(ACCELERATION_DATA, &values[4..7]),
        scaled(ANGULAR_VELOCITY_DATA, &values[7..]),
    ]
}
