//! The method `vmpl`: a decoder that speaks to miniVIE's virtual limb drives the arm, unchanged, and gets percepts back. What it
//! asks for is logged as the answers of an outside method are, so that a replay needs no decoder.

use crate::print_status;
use proact_arm::{ArmModel, Side, matches_short_name};
use proact_control::{
    FingerCommand, HandCommand, MethodEntry, MethodProgram, MethodRequest, MethodResponse, MotionCommand,
    ports::MethodProcess,
};
use proact_devices::{
    DeviceError, VMPL_ARM_JOINTS, VMPL_FINGERS, VMPL_JOINTS, VMPL_LEFT_PORTS, VMPL_RIGHT_PORTS, VmplCommand,
    VmplDisplay, VmplPercepts, vmpl_joint_names,
};
use proact_testbed::TrialConfig;
use proact_types::{JointVector, MethodAnswer, MethodHelp, MethodInfo, SimTime};
use std::{
    net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket},
    time::{Duration, Instant},
};

/// The first word of a command that is no program but a decoder.
pub const VMPL_COMMAND: &str = "proact:vmpl";
/// The method's name.
const VMPL_METHOD: &str = "vmpl";
/// A decoder sends every 20 ms; after five packets that did not come the arm stops.
const COMMAND_TIMEOUT: Duration = Duration::from_millis(100);
/// Percepts go out every 20 ms of the trial, as commands come in.
const PERCEPT_PERIOD_MS: u64 = 20;
/// Fingers that together turn by less than this say nothing new of whether the hand opens or closes, rad.
const FINGER_MOTION_RAD: f64 = 0.05;

/// Why there is no such method.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum VmplError {
    /// A word behind the command.
    #[error("got {got:?}, expected ADDRESS:PORT behind listen=, decoder=, ghost= or ghost_setup=")]
    InvalidOption {
        /// The word.
        got: String,
    },
    /// The arm is another one.
    #[error("the arm {arm} has none of the joints {}; choose one of the modular prosthetic limb", vmpl_joint_names()[..VMPL_ARM_JOINTS].join(", "))]
    Arm {
        /// Its name.
        arm: String,
    },
    /// The socket.
    #[error(transparent)]
    Socket(#[from] DeviceError),
}

/// Whether a decoder drives the trial.
pub(crate) fn is_vmpl_trial(config: &TrialConfig) -> bool {
    let program = config.method_process.as_ref().and_then(|program| program.command.first());
    program.map_or(config.method == VMPL_METHOD, |first| first == VMPL_COMMAND)
}

/// Shows the arm of a trial on a vMPL: sends the angles of each display frame as its commands.
#[derive(Debug)]
pub struct VmplPublisher {
    socket: UdpSocket,
    joint_indices: [Option<usize>; VMPL_JOINTS],
}

impl VmplPublisher {
    /// Sends the angles of `model` to the vMPL at `address`.
    ///
    /// # Errors
    /// [`VmplError::Arm`]; no socket.
    pub fn new(address: SocketAddr, model: &ArmModel) -> Result<VmplPublisher, VmplError> {
        let indices = joint_indices(model)?;
        let here: IpAddr = match address {
            SocketAddr::V4(_) if address.ip().is_loopback() => Ipv4Addr::LOCALHOST.into(),
            SocketAddr::V6(_) if address.ip().is_loopback() => Ipv6Addr::LOCALHOST.into(),
            SocketAddr::V4(_) => Ipv4Addr::UNSPECIFIED.into(),
            SocketAddr::V6(_) => Ipv6Addr::UNSPECIFIED.into(),
        };
        let failed = |source| DeviceError::Udp { address: address.to_string(), source };
        let socket = UdpSocket::bind((here, 0)).map_err(failed)?;
        socket.set_nonblocking(true).map_err(failed)?;
        socket.connect(address).map_err(failed)?;
        Ok(VmplPublisher { socket, joint_indices: indices })
    }

    /// Sends the joints of a frame, if anybody can be reached.
    pub fn send(&self, joints: &[f64]) {
        let angles = self
            .joint_indices
            .map(|index| index.and_then(|index| joints.get(index)).map_or(0.0, |angle| *angle as f32));
        let (for_arm, for_fingers) = angles.split_at(VMPL_ARM_JOINTS);
        let mut arm = [0.0; VMPL_ARM_JOINTS];
        arm.copy_from_slice(for_arm);
        let mut fingers = [0.0; VMPL_JOINTS - VMPL_ARM_JOINTS];
        fingers.copy_from_slice(for_fingers);
        let _ = self.socket.send(&VmplCommand { arm, fingers: Some(fingers) }.to_packet());
    }
}

/// Where a limb listens and answers.
#[derive(Debug)]
pub(crate) struct VmplAddresses {
    pub(crate) listen: SocketAddr,
    decoder: SocketAddr,
    /// Where the ghost arm gets its angles and its look, if the command says so.
    pub(crate) ghost: Option<SocketAddr>,
    pub(crate) ghost_setup: Option<SocketAddr>,
}

/// What the words behind the command say: miniVIE's ports on this machine where they say nothing.
pub(crate) fn parse_addresses(words: &[String], side: Side) -> Result<VmplAddresses, VmplError> {
    let [listens, answers] = match side {
        Side::Right => VMPL_RIGHT_PORTS,
        Side::Left => VMPL_LEFT_PORTS,
    };
    let here = |port| SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), port);
    let mut addresses =
        VmplAddresses { listen: here(listens), decoder: here(answers), ghost: None, ghost_setup: None };
    for word in words {
        let wrong = || VmplError::InvalidOption { got: word.clone() };
        let (key, address) = word.split_once('=').ok_or_else(wrong)?;
        let address: SocketAddr = address.parse().map_err(|_| wrong())?;
        match key {
            "listen" => addresses.listen = address,
            "decoder" => addresses.decoder = address,
            "ghost" => addresses.ghost = Some(address),
            "ghost_setup" => addresses.ghost_setup = Some(address),
            _ => return Err(wrong()),
        }
    }
    Ok(addresses)
}

/// Where each joint of the packets is among the moving joints of `model`.
pub(crate) fn joint_indices(model: &ArmModel) -> Result<[Option<usize>; VMPL_JOINTS], VmplError> {
    let index =
        |name: &str| model.moving().position(|joint| matches_short_name(&model.joints[joint].name, name));
    let indices = vmpl_joint_names().map(index);
    if indices[..VMPL_ARM_JOINTS].iter().all(Option::is_none) {
        return Err(VmplError::Arm { arm: model.name.clone() });
    }
    Ok(indices)
}

/// The entry of the method.
pub(crate) fn vmpl_method() -> MethodEntry {
    let info = MethodInfo {
        name: VMPL_METHOD.to_owned(),
        title: "Decoder of a vMPL (miniVIE)".to_owned(),
        help: MethodHelp {
            summary: "Another program moves each joint of arm and hand, over UDP.".to_owned(),
            ..MethodHelp::default()
        },
        ..MethodInfo::default()
    };
    let program = MethodProgram::new(vec![VMPL_COMMAND.to_owned()]);
    MethodEntry::external(info, program).with_arm_check(|model| {
        joint_indices(model)
            .map(drop)
            .map_err(|_| "finds none of its joints: choose an arm of the modular prosthetic limb")
    })
}

/// A decoder in the place of a method's process.
#[derive(Debug)]
pub struct VmplMethod {
    display: VmplDisplay,
    /// Where each joint of the packets is among the moving joints; none that the arm does not have.
    joint_indices: [Option<usize>; VMPL_JOINTS],
    /// Where each finger is among the digits.
    digits: [Option<usize>; VMPL_FINGERS],
    arm_count: usize,
    /// When the last command came; none before the first, and after a silence.
    last_command: Option<Instant>,
    /// Sum of the fingers' angles when the hand last turned to open or close, rad.
    closure: f64,
}

impl VmplMethod {
    /// Listens for the decoder of the arm `model`. `words` say `listen=ADDRESS:PORT` and `decoder=ADDRESS:PORT` where these are
    /// others than miniVIE's ports on this machine; what they say of the ghost arm is for [`GhostReceiver`](crate::vmpl_ghost::GhostReceiver).
    ///
    /// # Errors
    /// [`VmplError`].
    pub fn open(words: &[String], model: &ArmModel) -> Result<VmplMethod, VmplError> {
        let VmplAddresses { listen, decoder, .. } = parse_addresses(words, model.side)?;
        let moving: Vec<usize> = model.moving().collect();
        let indices = joint_indices(model)?;
        let digit_of = model.digit_indices();
        let digits = std::array::from_fn(|finger| {
            let index = indices[VMPL_ARM_JOINTS + 4 * finger]?;
            digit_of[model.joints[moving[index]].child]
        });
        let display = VmplDisplay::bind(listen, decoder)?;
        Ok(VmplMethod {
            display,
            joint_indices: indices,
            digits,
            arm_count: model.arm_count(),
            last_command: None,
            closure: 0.0,
        })
    }

    /// Where it listens.
    pub fn address(&self) -> std::io::Result<SocketAddr> {
        self.display.address()
    }

    /// The percepts of one step.
    fn percepts(&self, line: &MethodRequest) -> VmplPercepts {
        let felt = &line.joint_states;
        let number = |values: &JointVector, index: Option<usize>| {
            index.and_then(|index| values.get(index)).map_or(0.0, |value| *value as f32)
        };
        VmplPercepts {
            joints: self.joint_indices.map(|index| {
                [&felt.position, &felt.velocity, &felt.effort].map(|values| number(values, index))
            }),
            forces: self
                .digits
                .map(|digit| digit.and_then(|digit| felt.digit_forces.get(digit)).copied().unwrap_or(0.0)),
        }
    }

    /// What a command means for the arm, at the step `line`.
    fn apply_command(&mut self, command: &VmplCommand, line: &MethodRequest, answer: &mut MethodResponse) {
        let (for_arm, for_fingers) = self.joint_indices.split_at(VMPL_ARM_JOINTS);
        let mut goal = line.commanded.clone();
        for (angle, index) in command.arm.iter().zip(for_arm) {
            if let Some(goal_angle) = index.and_then(|index| goal.get_mut(index)) {
                *goal_angle = f64::from(*angle);
            }
        }
        answer.motion = Some(MotionCommand::Goto(goal));
        let Some(fingers) = &command.fingers else { return };
        let mut finger_goals: JointVector =
            line.joint_states.position.iter().skip(self.arm_count).copied().collect();
        for (angle, index) in fingers.iter().zip(for_fingers) {
            if let Some(goal_angle) =
                index.and_then(|index| finger_goals.get_mut(index.checked_sub(self.arm_count)?))
            {
                *goal_angle = f64::from(*angle);
            }
        }
        answer.fingers = Some(FingerCommand::Goto(finger_goals));
        // Spread is no closing: the first joint of each finger but the thumb is left out.
        let flexion = fingers.iter().enumerate().filter(|(joint, _)| *joint >= 16 || joint % 4 != 0);
        let closure: f64 = flexion.map(|(_, angle)| f64::from(*angle)).sum();
        if (closure - self.closure).abs() > FINGER_MOTION_RAD {
            answer.hand = Some(if closure > self.closure { HandCommand::Close } else { HandCommand::Open });
            self.closure = closure;
        }
    }

    fn respond(&mut self, line: &MethodRequest, now: Instant) -> MethodResponse {
        let mut answer = MethodResponse { time: line.time, ..MethodResponse::default() };
        match self.display.latest() {
            Some(command) => {
                self.last_command = Some(now);
                self.apply_command(&command, line, &mut answer);
            }
            // Said once.
            None if self
                .last_command
                .is_some_and(|received_at| now.duration_since(received_at) > COMMAND_TIMEOUT) =>
            {
                self.last_command = None;
                answer.motion = Some(MotionCommand::Hold);
                answer.fingers = Some(FingerCommand::Hold);
            }
            None => {}
        }
        answer
    }
}

impl MethodProcess for VmplMethod {
    fn ask(&mut self, _now: SimTime, line: &str) -> MethodAnswer {
        let line: MethodRequest = match serde_json::from_str(line) {
            Ok(line) => line,
            Err(error) => return MethodAnswer::Failed(error.to_string()),
        };
        if line.time.0.is_multiple_of(PERCEPT_PERIOD_MS) {
            self.display.send(&self.percepts(&line));
        }
        let now = Instant::now();
        let answer = self.respond(&line, now);
        if let Some(report) = self.display.report_refused(now) {
            print_status(format_args!("method vmpl: {report}"));
        }
        serde_json::to_string(&answer).map_err(|error| error.to_string()).into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The method of the arm that ships, and its decoder.
    fn method() -> (VmplMethod, ArmModel, UdpSocket) {
        let decoder = UdpSocket::bind("127.0.0.1:0").unwrap();
        let model = crate::Arm::load("mpl_right").unwrap().model().as_ref().clone();
        let words = ["listen=127.0.0.1:0".to_owned(), format!("decoder={}", decoder.local_addr().unwrap())];
        (VmplMethod::open(&words, &model).unwrap(), model, decoder)
    }

    /// A step of an arm at rest, as the method is told of it.
    fn line(model: &ArmModel) -> MethodRequest {
        let zeros = |count: usize| vec![0.0; count];
        serde_json::from_value(serde_json::json!({
            "time": 20, "gesture": "no_motion", "message": null, "measured": zeros(7), "commanded": zeros(7),
            "highlight": null, "objects": [], "posterior": [], "place": [0.0, 0.0, 0.0],
            "hand": { "state": "open", "holds": null },
            "world_from_base": { "rotation": [0.0, 0.0, 0.0, 1.0], "translation": [0.0, 0.0, 0.0] },
            "base_from_tip": null, "jacobian": null, "plan": null, "motion": "holding", "targets": [], "limb": null,
            "emg_age_ms": null, "gaze_age_ms": null, "tracking_age_ms": null,
            "felt": {
                "position": zeros(model.moving_count()), "velocity": zeros(model.moving_count()),
                "effort": zeros(model.moving_count()), "digit_forces": [0.0, 1.0, 0.0, 0.0, 0.0]
            },
        }))
        .unwrap()
    }

    #[test]
    fn silence_stops_arm_and_fingers_once_and_the_next_command_moves_them() {
        let (mut method, model, decoder) = method();
        let line = line(&model);
        let start = Instant::now();
        let address = method.address().unwrap();
        let command = VmplCommand { arm: [0.1; 7], fingers: Some([0.3; 20]) };
        let send = |command: &VmplCommand| {
            decoder.send_to(&command.to_packet(), address).unwrap();
        };
        assert_eq!(method.respond(&line, start).motion, None, "nobody has said anything yet");
        send(&command);
        let first = method.respond(&line, start);
        assert!(matches!(first.motion, Some(MotionCommand::Goto(_))), "{first:?}");
        assert_eq!(first.hand, Some(HandCommand::Close), "the fingers bend");
        let after = |ms| start + Duration::from_millis(ms);
        assert_eq!(method.respond(&line, after(100)).motion, None);
        let silent = method.respond(&line, after(101));
        assert_eq!((silent.motion, silent.fingers), (Some(MotionCommand::Hold), Some(FingerCommand::Hold)));
        assert_eq!(method.respond(&line, after(150)).motion, None, "said once");
        send(&VmplCommand { fingers: Some([0.1; 20]), ..command });
        let again = method.respond(&line, after(160));
        assert_eq!(again.hand, Some(HandCommand::Open));
        assert!(again.motion.is_some());
    }

    #[test]
    fn ring_and_little_finger_change_places_and_each_finger_has_its_force() {
        let (mut method, model, decoder) = method();
        let mut line = line(&model);
        let mut fingers = [0.0; 20];
        (fingers[9], fingers[13]) = (0.7, 0.2);
        let command = VmplCommand { arm: [0.0; 7], fingers: Some(fingers) };
        decoder.send_to(&command.to_packet(), method.address().unwrap()).unwrap();
        let Some(FingerCommand::Goto(finger_goals)) = method.respond(&line, Instant::now()).fingers else {
            panic!("the fingers are asked for")
        };
        let of = |name: &str| {
            model.hand.iter().position(|&joint| matches_short_name(&model.joints[joint].name, name)).unwrap()
        };
        assert_eq!(
            (finger_goals[of("ring1")], finger_goals[of("pinky1")]),
            (f64::from(0.7_f32), f64::from(0.2_f32))
        );
        let index = model.arm_count() + of("pinky1");
        line.joint_states.position[index] = 0.5;
        let percepts = method.percepts(&line);
        assert_eq!(percepts.joints[20][0], 0.5);
        assert_eq!(percepts.forces.iter().sum::<f64>(), 1.0, "one digit presses: {:?}", percepts.forces);
    }

    #[test]
    fn what_is_published_drives_a_limb_of_the_same_kind() {
        let (mut method, model, _decoder) = method();
        let publisher = VmplPublisher::new(method.address().unwrap(), &model).unwrap();
        let angles: Vec<f64> = (0..model.moving_count()).map(|joint| joint as f64 / 64.0).collect();
        publisher.send(&angles);
        let answer = method.respond(&line(&model), Instant::now());
        let (arm, hand) = angles.split_at(model.arm_count());
        assert_eq!(answer.motion, Some(MotionCommand::Goto(proact_types::joints(arm))));
        assert_eq!(answer.fingers, Some(FingerCommand::Goto(proact_types::joints(hand))));
    }

    #[test]
    fn a_decoder_is_known_by_its_method_and_by_its_command() {
        let config =
            |method: &str| TrialConfig::new(method, 1, proact_testbed::Setup::named("still").unwrap());
        assert!(is_vmpl_trial(&config("vmpl")) && !is_vmpl_trial(&config("A")));
        let by = |word: &str| TrialConfig {
            method_process: Some(MethodProgram::new(vec![word.to_owned()])),
            ..config("A")
        };
        assert!(is_vmpl_trial(&by(VMPL_COMMAND)) && !is_vmpl_trial(&by("python3")));
    }

    #[test]
    fn what_is_no_option_and_an_arm_of_other_joints_are_refused() {
        let (_, model, _) = method();
        for (words, part) in [
            ("listen", "ADDRESS:PORT behind listen="),
            ("listen=nowhere", "\"listen=nowhere\""),
            ("other=127.0.0.1:1", "\"other=127.0.0.1:1\""),
        ] {
            let error = VmplMethod::open(&[words.to_owned()], &model).unwrap_err().to_string();
            assert!(error.contains(part), "{error}");
        }
        let wam = crate::Arm::load("wam").unwrap();
        let error = VmplMethod::open(&[], wam.model()).unwrap_err().to_string();
        assert!(error.contains("has none of the joints shoulder"), "{error}");
    }
}
