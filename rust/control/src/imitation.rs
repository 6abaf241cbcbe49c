use crate::ports::ArmKinematics;
use crate::{ControlInput, ControlMethod, ControlOutput, HandCommand, MethodEntry, Shown};
use proact_types::{Gesture, MethodHelp, MethodInfo, MethodStyle, Needs, SimTime};

/// The arm imitates the person's own limb, which leads every joint ([`FollowsLimb`](crate::FollowsLimb) moves them, each at most at
/// its speed limit); of gestures, HC closes the hand and HO opens it. This is the mode of ArmSym in which the arm goes where the
/// person's hand goes: whoever tracks the hand finds the joints by inverse kinematics (`HandFit` of the crate `proact-arm`).
#[derive(Clone, Copy, Debug, Default)]
pub struct Imitation {
    /// The hand was told of this gesture.
    acted_on: Option<Gesture>,
}

impl Imitation {
    /// The method as an entry of a registry.
    pub fn entry() -> MethodEntry {
        let nothing = "\u{2013}";
        let info = MethodInfo {
            name: "imitate".to_owned(),
            title: "Imitated hand".to_owned(),
            needs: Needs { limb: true, ..Needs::default() },
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
        let hand = match input.gesture {
            Gesture::HandClose => Some(HandCommand::Close),
            Gesture::HandOpen => Some(HandCommand::Open),
            _ => None,
        };
        let made = hand.filter(|_| self.acted_on != Some(input.gesture));
        self.acted_on = Some(input.gesture);
        let planner = match input.limb {
            Some(_) => Shown::default().planner,
            None => crate::method::refused("your hand is not tracked yet"),
        };
        ControlOutput { hand: made, shown: Shown { planner, ..Shown::default() }, ..ControlOutput::default() }
    }
}
