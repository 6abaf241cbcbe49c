//! The ghost arm of miniVIE's virtual limb on the wire: a second arm that is seen through and moves nothing, such as the posture that
//! a decoder asks its wearer for. Its angles come as commands of the limb do, its look in packets of their own.

use crate::{DeviceError, RefusedDatagrams, VmplCommand};
use std::{
    io,
    net::{SocketAddr, UdpSocket},
    time::Instant,
};

/// Bytes of a set-up: five numbers of 32 bits, little endian.
const SETUP_BYTES: usize = 20;
/// Packets taken in one go: a flood must not hold up the trial.
const MAX_PACKETS_PER_POLL: usize = 256;

/// Where the ghost of a right arm gets its angles, and where its set-up.
pub const VMPL_RIGHT_GHOST_PORTS: [u16; 2] = [25010, 27000];
/// The same of a left arm.
pub const VMPL_LEFT_GHOST_PORTS: [u16; 2] = [25110, 27100];

/// How the ghost is to look.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VmplGhostSetup {
    /// Whether it is there at all.
    pub enabled: bool,
    /// Red, green and blue, 0 to 1.
    pub color: [f32; 3],
    /// From 0, not to be seen, to 1, solid.
    pub alpha: f32,
}

impl VmplGhostSetup {
    /// Reads one packet: enable (0 or 1), red, green, blue, alpha.
    ///
    /// # Errors
    /// [`DeviceError::VmplPacket`] for another length and for numbers outside 0 to 1.
    pub fn parse(packet: &[u8]) -> Result<VmplGhostSetup, DeviceError> {
        let wrong = |reason| DeviceError::VmplPacket { reason };
        if packet.len() != SETUP_BYTES {
            return Err(wrong(format!("{} bytes, expected {SETUP_BYTES} of a ghost's set-up", packet.len())));
        }
        let mut numbers = [0.0_f32; 5];
        for (index, (number, bytes)) in numbers.iter_mut().zip(packet.as_chunks::<4>().0).enumerate() {
            *number = f32::from_le_bytes(*bytes);
            // A number that is none is in no range.
            if !(0.0..=1.0).contains(number) {
                return Err(wrong(format!(
                    "number {index} of a ghost's set-up is {number}, expected 0 to 1"
                )));
            }
        }
        let [enable, red, green, blue, alpha] = numbers;
        Ok(VmplGhostSetup { enabled: enable >= 0.5, color: [red, green, blue], alpha })
    }
}

/// Takes what is said of the ghost. Packets that say nothing of it are counted and left out.
#[derive(Debug)]
pub struct VmplGhost {
    commands: UdpSocket,
    setups: UdpSocket,
    command: Option<VmplCommand>,
    setup: Option<VmplGhostSetup>,
    refused: RefusedDatagrams,
}

impl VmplGhost {
    /// Listens for angles at `commands` and for the look at `setups`.
    ///
    /// # Errors
    /// [`DeviceError::Udp`] if one of the addresses cannot be had.
    pub fn bind(commands: SocketAddr, setups: SocketAddr) -> Result<VmplGhost, DeviceError> {
        let open = |address: SocketAddr| -> Result<UdpSocket, DeviceError> {
            let failed = |source| DeviceError::Udp { address: address.to_string(), source };
            let socket = UdpSocket::bind(address).map_err(failed)?;
            socket.set_nonblocking(true).map_err(failed)?;
            Ok(socket)
        };
        let (commands, setups) = (open(commands)?, open(setups)?);
        Ok(VmplGhost { commands, setups, command: None, setup: None, refused: RefusedDatagrams::default() })
    }

    /// Where it listens for angles, and for the look.
    ///
    /// # Errors
    /// The system does not say.
    pub fn addresses(&self) -> io::Result<[SocketAddr; 2]> {
        Ok([self.commands.local_addr()?, self.setups.local_addr()?])
    }

    /// Packets so far that said nothing of a ghost.
    pub fn refused(&self) -> u64 {
        self.refused.total()
    }

    /// The report that is due at `now` of packets that were refused, once a second at most.
    pub fn report_refused(&mut self, now: Instant) -> Option<String> {
        self.refused.report(now)
    }

    /// The ghost as it was last asked for: none before its angles and its set-up are known, and while it is switched off.
    pub fn latest(&mut self) -> Option<(&VmplCommand, VmplGhostSetup)> {
        // Longer than any packet, so that a longer one is not taken for its beginning.
        let mut bytes = [0; 256];
        for _ in 0..MAX_PACKETS_PER_POLL {
            let Ok(count) = self.commands.recv(&mut bytes) else { break };
            match VmplCommand::parse(&bytes[..count]) {
                Ok(command) => self.command = Some(command),
                Err(error) => self.refused.record_refusal(error),
            }
        }
        for _ in 0..MAX_PACKETS_PER_POLL {
            let Ok(count) = self.setups.recv(&mut bytes) else { break };
            match VmplGhostSetup::parse(&bytes[..count]) {
                Ok(setup) => self.setup = Some(setup),
                Err(error) => self.refused.record_refusal(error),
            }
        }
        self.command.as_ref().zip(self.setup.filter(|setup| setup.enabled))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// On, colour 0.3, 0.4, 0.5, alpha 0.8, byte by byte.
    const ON: [u8; 20] = [
        0x00, 0x00, 0x80, 0x3f, 0x9a, 0x99, 0x99, 0x3e, 0xcd, 0xcc, 0xcc, 0x3e, 0x00, 0x00, 0x00, 0x3f, 0xcd,
        0xcc, 0x4c, 0x3f,
    ];

    fn ghost() -> (VmplGhost, UdpSocket, [SocketAddr; 2]) {
        let any = "127.0.0.1:0".parse().expect("an address");
        let ghost = VmplGhost::bind(any, any).expect("free ports");
        let addresses = ghost.addresses().expect("bound");
        (ghost, UdpSocket::bind(any).expect("a free port"), addresses)
    }

    #[test]
    fn a_setup_is_read_byte_for_byte_and_what_is_none_is_refused_with_the_reason() {
        let expected = VmplGhostSetup { enabled: true, color: [0.3, 0.4, 0.5], alpha: 0.8 };
        assert_eq!(VmplGhostSetup::parse(&ON).expect("a set-up"), expected);
        let off = VmplGhostSetup::parse(&[0; 20]).expect("a set-up");
        assert!(!off.enabled);
        let with = |index: usize, number: f32| {
            let mut packet = ON;
            packet[4 * index..4 * index + 4].copy_from_slice(&number.to_le_bytes());
            packet.to_vec()
        };
        for (packet, part) in [
            (vec![], "0 bytes, expected 20"),
            (vec![0; 19], "19 bytes"),
            (vec![0; 108], "108 bytes"),
            (with(1, f32::NAN), "number 1 of a ghost's set-up is NaN"),
            (with(4, 1.5), "number 4 of a ghost's set-up is 1.5"),
            (with(0, -1.0), "number 0"),
            (with(2, f32::INFINITY), "inf"),
        ] {
            let error = VmplGhostSetup::parse(&packet).expect_err("no set-up").to_string();
            assert!(error.contains(part), "{error}");
        }
    }

    #[test]
    fn a_ghost_appears_with_angles_and_setup_and_disappears_when_it_is_switched_off() {
        let (mut ghost, sender, [commands, setups]) = ghost();
        let send = |packet: &[u8], to: SocketAddr| sender.send_to(packet, to).expect("sent");
        assert_eq!(ghost.latest(), None);
        send(&ON, setups);
        assert_eq!(ghost.latest(), None, "it has no angles yet");
        let command = VmplCommand { arm: [0.25; 7], fingers: None };
        send(&command.to_packet(), commands);
        let (seen, setup) = ghost.latest().expect("a ghost");
        assert_eq!((seen.arm, setup.alpha), (command.arm, 0.8));
        assert!(ghost.latest().is_some(), "it stays without another packet");
        send(&[0; 20], setups);
        assert_eq!(ghost.latest(), None);
    }

    #[test]
    fn a_hundred_thousand_wrong_packets_cost_a_count_and_the_ghost_stays() {
        let (mut ghost, sender, addresses) = ghost();
        let command = VmplCommand { arm: [0.5; 7], fingers: Some([0.1; 20]) };
        sender.send_to(&command.to_packet(), addresses[0]).expect("sent");
        sender.send_to(&ON, addresses[1]).expect("sent");
        let mut state = 7_u64;
        for _ in 0..2000 {
            // On the loopback a datagram is there once it is sent; few enough that the sockets hold them all.
            for number in 0..50 {
                state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
                let length = (state >> 33) as usize % 1500;
                let length = if [20, 28, 108].contains(&length) { length + 1 } else { length };
                sender
                    .send_to(&vec![(state >> 24) as u8 | 0x80; length], addresses[number % 2])
                    .expect("sent");
            }
            let (seen, _) = ghost.latest().expect("the ghost");
            assert_eq!(*seen, command);
        }
        assert_eq!(ghost.refused(), 100_000);
    }

    proptest! {
        #[test]
        fn no_bytes_make_it_panic(bytes in prop::collection::vec(any::<u8>(), 0..64), whole in any::<bool>()) {
            let mut bytes = bytes;
            if whole {
                bytes.resize(SETUP_BYTES, 0);
            }
            if let Ok(setup) = VmplGhostSetup::parse(&bytes) {
                prop_assert!((0.0..=1.0).contains(&setup.alpha));
            }
        }
    }
}
