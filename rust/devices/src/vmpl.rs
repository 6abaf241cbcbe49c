//! The virtual modular prosthetic limb (vMPL) of miniVIE on the wire: 27 joint angles in, percepts out, over UDP. Numbers are
//! 32 bits, little endian.
//!
//! Layouts and ports are facts of miniVIE's interface (`python/minivie/mpl/unity.py`, `extract_percepts.py`). What it leaves open
//! is said where it is filled in.

use crate::{DeviceError, RefusedDatagrams};
use std::{
    io,
    net::{SocketAddr, UdpSocket},
    time::Instant,
};

/// Joints of the limb: seven of the arm, then four each of index, middle, ring and little finger and of the thumb.
pub const VMPL_JOINTS: usize = 27;
/// The first of them are the arm's.
pub const VMPL_ARM_JOINTS: usize = 7;
/// Fingers, in the order of their joints.
pub const VMPL_FINGERS: usize = 5;
/// Bytes of a command.
const COMMAND_BYTES: usize = 4 * VMPL_JOINTS;
/// Some programs send the arm alone.
const ARM_BYTES: usize = 4 * VMPL_ARM_JOINTS;
/// Words of the contact sensors behind the joints' percepts.
const CONTACT_WORDS: usize = 37;
const PERCEPTS_BYTES: usize = 12 * VMPL_JOINTS;
const WITH_CONTACTS_BYTES: usize = PERCEPTS_BYTES + 2 * CONTACT_WORDS;
const WITH_FORCES_BYTES: usize = WITH_CONTACTS_BYTES + 12 * VMPL_FINGERS;
/// A contact word is a force in hundredths of a newton: miniVIE does not say its unit.
const CONTACT_UNITS_PER_N: f64 = 100.0;
/// No joint turns this far, rad: a packet with such a number holds something else.
const MAX_ANGLE_RAD: f32 = 7.0;
/// Packets taken in one go: a flood must not hold up the trial.
const MAX_PACKETS_PER_POLL: usize = 256;

/// Where a vMPL of the right arm listens, and where it answers.
pub const VMPL_RIGHT_PORTS: [u16; 2] = [25000, 25001];
/// The same for the left arm.
pub const VMPL_LEFT_PORTS: [u16; 2] = [25100, 25101];

/// The joints in the packets' order, by their names in the limb's description; all have its sign. Ring and little finger stand
/// the other way round than in the description.
pub fn vmpl_joint_names() -> [&'static str; VMPL_JOINTS] {
    let mut names = include_str!("../data/vmpl_joints.txt").split_whitespace();
    std::array::from_fn(|_| names.next().expect("the file has a name for each joint, and a test counts them"))
}

/// What a decoder asks of the limb.
#[derive(Clone, Debug, PartialEq)]
pub struct VmplCommand {
    /// Angles of the first seven joints, rad.
    pub arm: [f32; VMPL_ARM_JOINTS],
    /// Those of the fingers, rad; none in a packet of the arm alone.
    pub fingers: Option<[f32; VMPL_JOINTS - VMPL_ARM_JOINTS]>,
}

impl VmplCommand {
    /// Reads one packet: 27 angles, or 7.
    ///
    /// # Errors
    /// [`DeviceError::VmplPacket`] for another length and for numbers that are no angles.
    pub fn parse(packet: &[u8]) -> Result<VmplCommand, DeviceError> {
        let wrong = |reason| DeviceError::VmplPacket { reason };
        if packet.len() != COMMAND_BYTES && packet.len() != ARM_BYTES {
            return Err(wrong(format!("{} bytes, expected {COMMAND_BYTES} or {ARM_BYTES}", packet.len())));
        }
        let mut angles = [0.0; VMPL_JOINTS];
        for (number, (angle, bytes)) in angles.iter_mut().zip(packet.as_chunks::<4>().0).enumerate() {
            *angle = f32::from_le_bytes(*bytes);
            if !angle.is_finite() || angle.abs() > MAX_ANGLE_RAD {
                return Err(wrong(format!(
                    "angle {number} is {angle} rad, expected -{MAX_ANGLE_RAD} to {MAX_ANGLE_RAD}"
                )));
            }
        }
        let (arm, fingers) = angles.split_at(VMPL_ARM_JOINTS);
        let mut command = VmplCommand { arm: [0.0; VMPL_ARM_JOINTS], fingers: None };
        command.arm.copy_from_slice(arm);
        if packet.len() == COMMAND_BYTES {
            let mut all = [0.0; VMPL_JOINTS - VMPL_ARM_JOINTS];
            all.copy_from_slice(fingers);
            command.fingers = Some(all);
        }
        Ok(command)
    }

    /// The packet of 27 angles; fingers that nothing is said of are sent as zeros, as miniVIE does.
    pub fn to_packet(&self) -> [u8; COMMAND_BYTES] {
        let mut packet = [0; COMMAND_BYTES];
        let fingers = self.fingers.unwrap_or_default();
        for (bytes, angle) in packet.as_chunks_mut::<4>().0.iter_mut().zip(self.arm.iter().chain(&fingers)) {
            *bytes = angle.to_le_bytes();
        }
        packet
    }
}

/// What the limb feels.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct VmplPercepts {
    /// Angle in rad, speed in rad/s and torque in N m of each joint.
    pub joints: [[f32; 3]; VMPL_JOINTS],
    /// The force of each finger on what it touches, N.
    pub forces: [f64; VMPL_FINGERS],
}

impl VmplPercepts {
    /// The packet: joints, 37 contact words, three force components of each finger. The first five words are the
    /// fingers' forces and the others zero, and a force is the third component of its finger: which sensor is which is not public.
    pub fn to_packet(&self) -> [u8; WITH_FORCES_BYTES] {
        let mut packet = [0; WITH_FORCES_BYTES];
        let (joints, rest) = packet.split_at_mut(PERCEPTS_BYTES);
        for (bytes, value) in joints.as_chunks_mut::<4>().0.iter_mut().zip(self.joints.as_flattened()) {
            *bytes = value.to_le_bytes();
        }
        let (contacts, forces) = rest.split_at_mut(2 * CONTACT_WORDS);
        for (bytes, force) in contacts.as_chunks_mut::<2>().0.iter_mut().zip(self.forces) {
            *bytes = ((force * CONTACT_UNITS_PER_N).round() as u16).to_le_bytes();
        }
        for (finger, force) in forces.as_chunks_mut::<12>().0.iter_mut().zip(self.forces) {
            finger[8..].copy_from_slice(&(force as f32).to_le_bytes());
        }
        packet
    }

    /// Reads a packet of percepts, with or without contacts and forces. Torques may be NaN, as miniVIE's own display sends
    /// them; forces are read where they stand as [`VmplPercepts::to_packet`] writes them.
    ///
    /// # Errors
    /// [`DeviceError::VmplPacket`] for a length that is none of the four known.
    pub fn parse(packet: &[u8]) -> Result<VmplPercepts, DeviceError> {
        /// As [`WITH_FORCES_BYTES`] with 14 numbers of each finger.
        const WITH_FINGERTIPS_BYTES: usize = WITH_CONTACTS_BYTES + 4 * 14 * VMPL_FINGERS;
        let known = [PERCEPTS_BYTES, WITH_CONTACTS_BYTES, WITH_FORCES_BYTES, WITH_FINGERTIPS_BYTES];
        if !known.contains(&packet.len()) {
            let reason = format!("{} bytes, expected one of {known:?}", packet.len());
            return Err(DeviceError::VmplPacket { reason });
        }
        let mut percepts = VmplPercepts::default();
        let (joints, rest) = packet.split_at(PERCEPTS_BYTES);
        for (value, bytes) in percepts.joints.as_flattened_mut().iter_mut().zip(joints.as_chunks::<4>().0) {
            *value = f32::from_le_bytes(*bytes);
        }
        for (force, bytes) in percepts.forces.iter_mut().zip(rest.as_chunks::<2>().0) {
            *force = f64::from(u16::from_le_bytes(*bytes)) / CONTACT_UNITS_PER_N;
        }
        Ok(percepts)
    }
}

/// The side of the limb: takes commands and sends percepts. Packets that are no commands are counted and left out.
#[derive(Debug)]
pub struct VmplDisplay {
    socket: UdpSocket,
    /// Where percepts go.
    decoder: SocketAddr,
    refused: RefusedDatagrams,
}

impl VmplDisplay {
    /// Listens at `listen` and sends percepts to `decoder`.
    ///
    /// # Errors
    /// [`DeviceError::Udp`] if the address cannot be had.
    pub fn bind(listen: SocketAddr, decoder: SocketAddr) -> Result<VmplDisplay, DeviceError> {
        let failed = |source| DeviceError::Udp { address: listen.to_string(), source };
        let socket = UdpSocket::bind(listen).map_err(failed)?;
        socket.set_nonblocking(true).map_err(failed)?;
        Ok(VmplDisplay { socket, decoder, refused: RefusedDatagrams::default() })
    }

    /// Where it listens.
    ///
    /// # Errors
    /// The system does not say.
    pub fn address(&self) -> io::Result<SocketAddr> {
        self.socket.local_addr()
    }

    /// Packets so far that were no commands.
    pub fn refused(&self) -> u64 {
        self.refused.total()
    }

    /// The report that is due at `now` of packets that were refused, once a second at most.
    pub fn report_refused(&mut self, now: Instant) -> Option<String> {
        self.refused.report(now)
    }

    /// The newest command since the last call. What the network says of packets that nobody took is no failure.
    pub fn latest(&mut self) -> Option<VmplCommand> {
        // Longer than any command, so that a longer packet is not taken for its beginning.
        let mut bytes = [0; 2 * COMMAND_BYTES];
        let mut latest = None;
        for _ in 0..MAX_PACKETS_PER_POLL {
            match self.socket.recv(&mut bytes).map(|count| VmplCommand::parse(&bytes[..count])) {
                Ok(Ok(command)) => latest = Some(command),
                Ok(Err(error)) => self.refused.record_refusal(error),
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => break,
                // A decoder that does not listen yet answers percepts with a refusal of its port.
                Err(_) => {}
            }
        }
        latest
    }

    /// Sends percepts, if anybody can be reached.
    pub fn send(&self, percepts: &VmplPercepts) {
        let _ = self.socket.send_to(&percepts.to_packet(), self.decoder);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn hex(text: &str) -> Vec<u8> {
        (0..text.len()).step_by(2).map(|at| u8::from_str_radix(&text[at..at + 2], 16).unwrap()).collect()
    }

    #[test]
    fn commands_are_read_and_written_byte_for_byte() {
        // Elbow at 90 degrees; wrist at -15 degrees and the ring finger's knuckle at 45 degrees.
        for (set, bytes) in [
            (vec![(3, 90.0_f32)], format!("{}db0fc93f{}", "00".repeat(12), "00".repeat(92))),
            (
                vec![(4, -15.0), (16, 45.0)],
                format!("{}920a86be{}db0f493f{}", "00".repeat(16), "00".repeat(44), "00".repeat(40)),
            ),
        ] {
            let command = VmplCommand::parse(&hex(&bytes)).unwrap();
            let fingers = command.fingers.unwrap();
            let angles: Vec<f32> = command.arm.iter().chain(&fingers).copied().collect();
            let mut expected = [0.0; VMPL_JOINTS];
            set.iter().for_each(|&(joint, degrees)| expected[joint] = degrees.to_radians());
            assert_eq!(angles, expected);
            assert_eq!(command.to_packet().as_slice(), hex(&bytes));
        }
        let arm =
            VmplCommand::parse(&hex("c2b8323ec2b8b2bec2b8b23ddb0fc93f920a86be35fa0e3d5077563d")).unwrap();
        assert_eq!((arm.fingers, arm.arm[3]), (None, 90.0_f32.to_radians()));
    }

    #[test]
    fn each_joint_has_a_name_of_its_own() {
        let names: std::collections::BTreeSet<&str> = vmpl_joint_names().into();
        assert_eq!(names.len(), VMPL_JOINTS);
        assert_eq!(include_str!("../data/vmpl_joints.txt").split_whitespace().count(), VMPL_JOINTS);
    }

    #[test]
    fn percepts_stand_at_their_places() {
        let mut percepts = VmplPercepts::default();
        percepts.joints[3] = [0.03, 0.5, f32::NAN];
        percepts.forces = [1.5, 0.0, 0.0, 0.0, 700.0];
        let packet = percepts.to_packet();
        assert_eq!(packet.len(), 458);
        assert_eq!(
            packet[36..48],
            hex("8fc2f53c0000003f0000c07f"),
            "angle, speed, torque at 12 bytes a joint"
        );
        assert_eq!(packet[324..334], [150, 0, 0, 0, 0, 0, 0, 0, 255, 255], "a word holds no more");
        assert_eq!(packet[398 + 8..398 + 12], 1.5_f32.to_le_bytes());
        for length in [324, 398, 458] {
            let read = VmplPercepts::parse(&packet[..length]).unwrap();
            assert_eq!((read.joints[3][1], read.forces[0]), (0.5, if length > 324 { 1.5 } else { 0.0 }));
        }
        assert!(VmplPercepts::parse(&packet[..400]).unwrap_err().to_string().contains("400 bytes"));
    }

    #[test]
    fn what_is_no_command_is_refused_with_the_reason() {
        let with = |angle: f32| VmplCommand { arm: [angle; 7], fingers: None }.to_packet().to_vec();
        for (packet, part) in [
            (vec![], "0 bytes"),
            (vec![0; 107], "107 bytes, expected 108 or 28"),
            (vec![0; 324], "324 bytes"),
            (with(f32::NAN), "angle 0 is NaN"),
            (with(f32::INFINITY), "inf"),
            (with(90.0), "angle 0 is 90 rad"),
        ] {
            let error = VmplCommand::parse(&packet).unwrap_err().to_string();
            assert!(error.contains(part), "{error}");
        }
    }

    #[test]
    fn a_hundred_thousand_wrong_packets_cost_a_count_and_the_next_command_is_taken() {
        let decoder = UdpSocket::bind("127.0.0.1:0").unwrap();
        let any = "127.0.0.1:0".parse().unwrap();
        let mut display = VmplDisplay::bind(any, decoder.local_addr().unwrap()).unwrap();
        let address = display.address().unwrap();
        let mut bytes = [0_u8; 1500];
        let (mut sent, mut state) = (0_u64, 7_u64);
        while sent < 100_000 {
            // On the loopback a datagram is there once it is sent; few enough that the socket holds them all.
            for _ in 0..50 {
                state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
                let length = (state >> 33) as usize % bytes.len();
                bytes[..length].fill((state >> 24) as u8 | 0x80);
                let length = if length == COMMAND_BYTES || length == ARM_BYTES { length + 1 } else { length };
                decoder.send_to(&bytes[..length], address).unwrap();
                sent += 1;
            }
            assert_eq!(display.latest(), None);
        }
        assert_eq!(display.refused(), sent);
        let command = VmplCommand { arm: [0.25; 7], fingers: None };
        decoder.send_to(&command.to_packet(), address).unwrap();
        assert_eq!(display.latest().unwrap().arm, command.arm);
        display.send(&VmplPercepts::default());
        assert_eq!(decoder.recv(&mut bytes).unwrap(), WITH_FORCES_BYTES);
    }

    proptest! {
        #[test]
        fn no_bytes_make_it_panic(bytes in prop::collection::vec(any::<u8>(), 0..700), cut in 0..4_usize) {
            let mut bytes = bytes;
            bytes.resize([bytes.len(), COMMAND_BYTES, ARM_BYTES, WITH_FORCES_BYTES][cut], 0);
            if let Ok(command) = VmplCommand::parse(&bytes) {
                prop_assert!(VmplCommand::parse(&command.to_packet()).is_ok());
            }
            let _ = VmplPercepts::parse(&bytes);
        }
    }
}
