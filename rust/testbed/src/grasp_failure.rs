use crate::{GraspRuleName, NearObject, PhysicsConfig};
use proact_arm::ArmModel;
use proact_control::HandCommand;
use proact_types::{Contact, EventKind, GraspFault, HandState, ObjectId};

/// A closed hand is given this much longer than its grasp rule needs, ms: fingers still settle on what they touch.
const SETTLING_MS: u32 = 200;

/// Tells when a hand has closed and holds nothing, and why.
#[derive(Clone, Debug)]
pub(crate) struct GraspFailureDetector {
    /// Of each link, as [`ArmModel::digits`].
    digit: Vec<Option<usize>>,
    /// Closed for this long without holding anything, the grasp has failed, ms.
    wait_ms: u32,
    /// While the hand closes and nothing is said: for how long it has been closed.
    closed_ms: Option<u32>,
    /// Digits that have touched each object since the hand was told to close, with the object's place in the scene.
    touching_digits: Vec<(usize, Vec<usize>)>,
}

impl GraspFailureDetector {
    pub(crate) fn new(physics: &PhysicsConfig, model: &ArmModel) -> Self {
        let rule = match physics.grasp_rule {
            GraspRuleName::Opposing => physics.opposing_grasp.hold_ms,
            GraspRuleName::Original => {
                physics.original_grasp.check_interval_ms * (physics.original_grasp.grip_count_threshold + 2)
            }
        };
        let wait_ms = rule + SETTLING_MS;
        Self { digit: model.digits(), wait_ms, closed_ms: None, touching_digits: Vec::new() }
    }

    /// One tick: what the hand was told in it, how it is after it, what touches, and whether something is held. `near` is
    /// asked for when a grasp has failed.
    pub(crate) fn step(
        &mut self,
        command: Option<HandCommand>,
        hand: HandState,
        contacts: &[Contact],
        holds: bool,
        near: impl FnOnce() -> Option<NearObject>,
    ) -> Option<EventKind> {
        match command {
            Some(HandCommand::Close) => {
                self.closed_ms = Some(0);
                self.touching_digits.clear();
            }
            Some(HandCommand::Open) => self.closed_ms = None,
            None => {}
        }
        let closed_ms = self.closed_ms.as_mut()?;
        if holds {
            self.closed_ms = None;
            return None;
        }
        for contact in contacts {
            let Some(digit) = self.digit[contact.link] else { continue };
            let known = self.touching_digits.iter().position(|(object, _)| *object == contact.object);
            let index = known.unwrap_or(self.touching_digits.len());
            if known.is_none() {
                self.touching_digits.push((contact.object, Vec::new()));
            }
            let digits = &mut self.touching_digits[index].1;
            if !digits.contains(&digit) {
                digits.push(digit);
            }
        }
        if hand != HandState::Closed {
            return None;
        }
        *closed_ms += 1;
        if *closed_ms < self.wait_ms {
            return None;
        }
        self.closed_ms = None;
        Some(self.failure(contacts, near()))
    }

    /// What failed: at the object that most digits have touched, otherwise at the one between the fingers.
    fn failure(&self, contacts: &[Contact], near: Option<NearObject>) -> EventKind {
        let most_touching = self.touching_digits.iter().rev().max_by_key(|(_, digits)| digits.len());
        let near = near.filter(|near| near.is_between_fingers);
        let object = most_touching.map(|(object, _)| *object).or(near.map(|near| near.object));
        let reason = match (most_touching, near) {
            (_, Some(near)) if !near.is_graspable && object == Some(near.object) => GraspFault::NoGrasp,
            (None, None) => GraspFault::Nothing,
            (None, Some(_)) => GraspFault::NotTouched,
            (Some((_, digits)), _) if digits.len() < 2 => GraspFault::OneDigit,
            (Some((object, digits)), _) => {
                let still = |digit: &&usize| {
                    let on = |c: &Contact| c.object == *object && self.digit[c.link] == Some(**digit);
                    contacts.iter().any(on)
                };
                let two = digits.iter().filter(still).count() > 1;
                if two { GraspFault::NotOpposing } else { GraspFault::Slipped }
            }
        };
        EventKind::GraspFailed { object: object.map(ObjectId::new), reason }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grasp::tests::hand_model;
    use proact_types::{Point, Vector};

    /// What a hand of a palm, a thumb (links 1, 2) and a finger (3) says of a closing in which these links touch object 2,
    /// first and in the end; `between` the fingers is object 1.
    fn said(first: &[usize], end: &[usize], between: Option<bool>, holds: bool) -> Option<EventKind> {
        let model = hand_model(&["palm", "t0", "t1", "i0"], &[(1, 0), (2, 1), (3, 0)]);
        let mut watch = GraspFailureDetector::new(&PhysicsConfig::default(), &model);
        let contact = |&link: &usize| {
            let (point, normal) = (Point::origin(), Vector::x());
            Contact { object: 2, link, point, normal, force: 1.0 }
        };
        let near = between.map(|graspable| NearObject {
            object: 1,
            distance_m: 0.01,
            is_between_fingers: true,
            is_graspable: graspable,
            center: Point::origin(),
        });
        let contacts = |links: &[usize]| links.iter().map(contact).collect::<Vec<_>>();
        let mut command = Some(HandCommand::Close);
        let mut all = Vec::new();
        for tick in 0..1000 {
            let links = if tick < 100 { first } else { end };
            let hand = if tick < 200 { HandState::Closing } else { HandState::Closed };
            let held = holds && tick > 150;
            all.extend(watch.step(command.take(), hand, &contacts(links), held, || near));
        }
        assert!(all.len() < 2, "said once: {all:?}");
        all.pop()
    }

    #[test]
    fn a_hand_that_closed_in_vain_says_why_once_and_one_that_holds_says_nothing() {
        let failed = |object, reason| Some(EventKind::GraspFailed { object, reason });
        let (red2, blue1) = (Some(ObjectId(1)), Some(ObjectId(2)));
        for (first, end, between, expected) in [
            (&[][..], &[][..], None, failed(None, GraspFault::Nothing)),
            (&[], &[], Some(true), failed(red2, GraspFault::NotTouched)),
            (&[], &[], Some(false), failed(red2, GraspFault::NoGrasp)),
            // Palm and two links of the thumb: one digit.
            (&[0, 1, 2], &[1], None, failed(blue1, GraspFault::OneDigit)),
            (&[1, 3], &[1], None, failed(blue1, GraspFault::Slipped)),
            (&[], &[2, 3], Some(true), failed(blue1, GraspFault::NotOpposing)),
        ] {
            assert_eq!(said(first, end, between, false), expected, "{first:?} then {end:?}");
        }
        assert_eq!(said(&[1, 3], &[1, 3], None, true), None);
    }
}
