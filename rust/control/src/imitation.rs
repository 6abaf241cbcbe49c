use crate::ports::ArmKinematics;
use crate::{ControlInput, ControlMethod, ControlOutput, HandCommand, MethodDisplay, MethodEntry};
use proact_types::{Command, MethodHelp, MethodInfo, MethodNeeds, MethodStyle, SimTime};

/// The arm imitates the person's own limb, which leads every joint ([`LimbFollower`](crate::FollowsLimb) moves them, each at most at
/// its speed limit); of gestures, HC closes the hand and HO opens it. This is the mode of ArmSym in which the arm goes where the
/// person's hand goes: whoever tracks the hand finds the joints by inverse kinematics (`HandFit` of the crate `proact-arm`).
#[derive(Clone, Copy, Debug, Default)]
pub struct Imitation {
    /// The hand was told of this gesture.
    last_command: Option<Command>,
}

impl Imitation {
    /// The method as an entry of a registry.
    pub fn entry() -> MethodEntry {
        let nothing = "\u{2013}";
        let info = MethodInfo {
            name: "imitate".to_owned(),
            title: "Imitated hand".to_owned(),
            needs: MethodNeeds { limb: true, ..MethodNeeds::default() },
            style: MethodStyle::Imitating,
            help: MethodHelp {
                summary: "The arm goes where your own hand goes.".to_owned(),
                hand_close: "close hand".to_owned(),
                hand_open: "open hand".to_owned(),
                wrist_extension: nothing.to_owned(),
                wrist_flexion: nothing.to_owned(),
            },
        };
        MethodEntry::new(info, |_, _, _| Ok(Box::new(Self::default())))
    }
}

impl ControlMethod for Imitation {
    fn step(&mut self, _: SimTime, input: &ControlInput<'_>, _: &mut dyn ArmKinematics) -> ControlOutput {
        let hand = match input.command {
            Command::HandClose => Some(HandCommand::Close),
            Command::HandOpen => Some(HandCommand::Open),
            _ => None,
        };
        let made = hand.filter(|_| self.last_command != Some(input.command));
        self.last_command = Some(input.command);
        let planner = match input.limb {
            Some(_) => MethodDisplay::default().planner,
            None => crate::method::refusal_view("your hand is not tracked yet"),
        };
        ControlOutput {
            hand: made,
            display: MethodDisplay { planner, ..MethodDisplay::default() },
            ..ControlOutput::default()
        }
    }
}
