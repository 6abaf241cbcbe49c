//! The ghost arm of miniVIE's virtual limb: what a decoder's ghost commands become on the page. It moves nothing, and is neither
//! recorded nor part of the digest.

use crate::{
    print_status,
    vmpl::{VmplError, is_vmpl_trial, joint_indices, parse_addresses},
};
use proact_arm::{ArmModel, Side};
use proact_bridge::GhostArm;
use proact_devices::{
    DeviceError, VMPL_ARM_JOINTS, VMPL_JOINTS, VMPL_LEFT_GHOST_PORTS, VMPL_RIGHT_GHOST_PORTS, VmplGhost,
};
use proact_testbed::{Testbed, TrialConfig};
use std::time::Instant;

/// Takes ghost commands for the arm of one trial.
#[derive(Debug)]
pub struct GhostReceiver {
    ghost: VmplGhost,
    /// Where each joint of the packets is among the moving joints; none that the arm does not have.
    joint_indices: [Option<usize>; VMPL_JOINTS],
    joint_count: usize,
}

impl GhostReceiver {
    /// Listens for the ghost of `model`. `words` are those of the method's command: `ghost=ADDRESS:PORT` and
    /// `ghost_setup=ADDRESS:PORT` where these are others than miniVIE's ports at the address at which commands are listened for.
    ///
    /// # Errors
    /// [`VmplError`].
    pub fn open(words: &[String], model: &ArmModel) -> Result<GhostReceiver, VmplError> {
        let ports = match model.side {
            Side::Right => VMPL_RIGHT_GHOST_PORTS,
            Side::Left => VMPL_LEFT_GHOST_PORTS,
        };
        let addresses = parse_addresses(words, model.side)?;
        let here = |port| (addresses.listen.ip(), port).into();
        let commands = addresses.ghost.unwrap_or_else(|| here(ports[0]));
        let setups = addresses.ghost_setup.unwrap_or_else(|| here(ports[1]));
        let ghost = VmplGhost::bind(commands, setups)?;
        Ok(GhostReceiver { ghost, joint_indices: joint_indices(model)?, joint_count: model.moving_count() })
    }

    /// That of a trial by a decoder; none of another trial. A port in use is said, and the trial goes on without a ghost.
    pub(crate) fn for_testbed(testbed: &Testbed) -> Option<GhostReceiver> {
        let config = testbed.config();
        if !is_vmpl_trial(config) {
            return None;
        }
        match GhostReceiver::open(command_words(config), testbed.model()) {
            Ok(receiver) => Some(receiver),
            Err(error) => {
                print_status(format_args!("method vmpl: no ghost arm: {error}"));
                None
            }
        }
    }

    /// Where it listens for angles, and for the look.
    ///
    /// # Errors
    /// The system does not say.
    pub fn addresses(&self) -> Result<[std::net::SocketAddr; 2], DeviceError> {
        self.ghost.addresses().map_err(|source| DeviceError::Udp { address: "the ghost".to_owned(), source })
    }

    /// The ghost as it is to be shown now; none before there is one, and while it is switched off.
    pub fn latest(&mut self) -> Option<GhostArm> {
        if let Some(report) = self.ghost.report_refused(Instant::now()) {
            print_status(format_args!("method vmpl, ghost arm: {report}"));
        }
        let (command, setup) = self.ghost.latest()?;
        let mut joints = vec![0.0; self.joint_count];
        let fingers = command.fingers.unwrap_or([0.0; VMPL_JOINTS - VMPL_ARM_JOINTS]);
        for (angle, index) in command.arm.iter().chain(&fingers).zip(self.joint_indices) {
            if let Some(joint) = index.and_then(|index| joints.get_mut(index)) {
                *joint = f64::from(*angle);
            }
        }
        Some(GhostArm { joints, color: setup.color.map(f64::from), alpha: f64::from(setup.alpha) })
    }
}

/// What follows the command's first word.
fn command_words(config: &TrialConfig) -> &[String] {
    config.method_process.as_ref().and_then(|program| program.command.get(1..)).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proact_arm::matches_short_name;
    use proact_devices::VmplCommand;
    use std::net::UdpSocket;

    /// On, colour 0.3, 0.4, 0.5, alpha 0.8, as miniVIE sends it.
    const ON: &[u8; 20] = b"\x00\x00\x80\x3f\x9a\x99\x99\x3e\xcd\xcc\xcc\x3e\x00\x00\x00\x3f\xcd\xcc\x4c\x3f";

    fn words(ports: [&str; 2]) -> Vec<String> {
        vec![format!("ghost={}", ports[0]), format!("ghost_setup={}", ports[1])]
    }

    #[test]
    fn a_ghost_command_stands_at_its_joints_in_its_colour() {
        let arm = crate::Arm::load("mpl_right").expect("the arm that ships");
        let model = arm.model();
        let mut receiver =
            GhostReceiver::open(&words(["127.0.0.1:0"; 2]), model).expect("free ports on this machine");
        let [commands, setups] = receiver.addresses().expect("bound");
        let decoder = UdpSocket::bind("127.0.0.1:0").expect("a free port");
        let mut fingers = [0.0; 20];
        fingers[9] = 0.7;
        let command = VmplCommand { arm: [0.0, 0.0, 0.0, 1.25, 0.0, 0.0, 0.0], fingers: Some(fingers) };
        decoder.send_to(&command.to_packet(), commands).expect("sent");
        assert_eq!(receiver.latest(), None, "nothing has switched it on");
        decoder.send_to(ON, setups).expect("sent");
        let ghost = receiver.latest().expect("a ghost");
        let at = |name: &str| {
            let index = model.moving().position(|joint| matches_short_name(&model.joints[joint].name, name));
            ghost.joints[index.expect("a moving joint")]
        };
        assert_eq!((at("forearm"), at("ring1"), at("wristz")), (1.25, f64::from(0.7_f32), 0.0));
        assert_eq!(ghost.joints.len(), model.moving_count());
        let rgba = [0.3_f32, 0.4, 0.5, 0.8].map(f64::from);
        assert_eq!((ghost.color.as_slice(), ghost.alpha), (&rgba[..3], rgba[3]));
        decoder.send_to(&[0xff; 20], setups).expect("sent");
        assert!(receiver.latest().is_some(), "what is no set-up changes nothing");
    }

    #[test]
    fn a_port_in_use_is_said_and_no_other_machine_is_listened_to_unless_told() {
        let arm = crate::Arm::load("mpl_right").expect("the arm that ships");
        let taken = UdpSocket::bind("127.0.0.1:0").expect("a free port");
        let address = taken.local_addr().expect("bound").to_string();
        let error = GhostReceiver::open(&words([&address, "127.0.0.1:0"]), arm.model()).expect_err("taken");
        assert!(error.to_string().contains(&address), "{error}");
        let addresses = parse_addresses(&[], Side::Left).expect("no words");
        assert!(addresses.listen.ip().is_loopback() && addresses.ghost.is_none());
    }
}
