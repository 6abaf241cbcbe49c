use crate::{GraspRuleName, OpposingGrasp, OriginalGraspRule, PhysicsConfig};
use proact_arm::ArmModel;
use proact_control::HandCommand;
use proact_types::{Contact, HandState, JointVector, PlantState, joints};

/// What the rule asks of the plant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GraspAction {
    /// Attach this block (an index in `Scene::blocks`) to the tip.
    Attach(usize),
    /// Let go.
    Release,
}

/// When the hand takes a block and lets it go, by the rule that a trial asks for.
#[derive(Clone, Debug)]
pub struct GraspDetector {
    opposing_rule: GraspRule,
    /// Instead of `opposing`, if the trial asks for it.
    original_rule: Option<OriginalGraspRule>,
    /// Finger joints when the block was taken, rad.
    finger_joints_at_grasp: Option<JointVector>,
    /// [`ArmModel::hand_per_radian`].
    per_radian: JointVector,
}

impl GraspDetector {
    /// The rule of `physics` for the hand of `model`, which holds nothing.
    pub fn new(physics: &PhysicsConfig, model: &ArmModel) -> Self {
        let original = physics.grasp_rule == GraspRuleName::Original;
        Self {
            opposing_rule: GraspRule::new(physics.opposing_grasp, model),
            original_rule: original.then(|| OriginalGraspRule::new(physics.original_grasp, model)),
            finger_joints_at_grasp: None,
            per_radian: model.hand_per_radian(),
        }
    }

    /// One tick: the physics after it, the hand, and what the hand was told last.
    pub fn step(
        &mut self,
        model: &ArmModel,
        state: &PlantState,
        hand: HandState,
        command: HandCommand,
    ) -> Option<GraspAction> {
        let fingers = &state.position[model.arm_count()..];
        let attached = state.attached.map(|(block, _)| block);
        let opened = self.opposing_rule.options.release_opening_rad;
        let away = |at: &JointVector| {
            let joints = at.iter().zip(fingers).zip(&self.per_radian);
            joints.into_iter().any(|((at, now), per_radian)| (at - now).abs() > opened * per_radian)
        };
        let opened = command == HandCommand::Open && self.finger_joints_at_grasp.as_ref().is_some_and(away);
        let action = match &mut self.original_rule {
            Some(rule) => rule.step(model, state),
            None => self.opposing_rule.step(&state.contacts, hand, attached, opened),
        };
        match action {
            Some(GraspAction::Attach(_)) => self.finger_joints_at_grasp = Some(joints(fingers)),
            Some(GraspAction::Release) => self.finger_joints_at_grasp = None,
            None => {}
        }
        action
    }

    /// Names of the digits' links that touch a block.
    pub(crate) fn fingers_on(&self, model: &ArmModel, contacts: &[Contact], block: usize) -> Vec<String> {
        self.opposing_rule.fingers_on(model, contacts, block)
    }
}

/// The grasp rule: fingers that oppose each other on a block take it; a hand that opens lets it go.
///
/// In place of simulating a grip, as the original does (paper, "Feedback and control"), but in simulated time, by
/// contact of digits instead of shapes, and with release as soon as the hand opens.
#[derive(Clone, Debug)]
struct GraspRule {
    options: OpposingGrasp,
    /// Of each link, as [`ArmModel::digits`].
    digit: Vec<Option<usize>>,
    candidate: Option<usize>,
    held_millis: u32,
}

impl GraspRule {
    /// The rule for the hand of `model`.
    fn new(options: OpposingGrasp, model: &ArmModel) -> Self {
        Self { options, digit: model.digits(), candidate: None, held_millis: 0 }
    }

    /// One tick: contacts of this tick, the hand, the block that is attached, and whether the fingers have opened
    /// since it was.
    fn step(
        &mut self,
        contacts: &[Contact],
        hand: HandState,
        attached: Option<usize>,
        opened: bool,
    ) -> Option<GraspAction> {
        if attached.is_some() {
            self.candidate = None;
            self.held_millis = 0;
            return (opened && hand != HandState::Closed && hand != HandState::Closing)
                .then_some(GraspAction::Release);
        }
        let closing = matches!(hand, HandState::Closing | HandState::Closed);
        let gripped = if closing { self.opposed_object(contacts) } else { None };
        if gripped.is_some() && (gripped == self.candidate || self.candidate.is_none()) {
            self.candidate = gripped;
            self.held_millis += 1;
        } else {
            // Contacts of stiff fingers flicker: a tick without one counts back instead of starting again.
            self.held_millis = self.held_millis.saturating_sub(1);
            if self.held_millis == 0 {
                self.candidate = None;
            }
        }
        if self.held_millis < self.options.hold_ms {
            return None;
        }
        self.held_millis = 0;
        self.candidate.take().map(GraspAction::Attach)
    }

    /// Names of the digits' links that touch a block.
    fn fingers_on(&self, model: &ArmModel, contacts: &[Contact], block: usize) -> Vec<String> {
        let touches = |link: &usize| {
            self.digit[*link].is_some() && contacts.iter().any(|c| c.object == block && c.link == *link)
        };
        (0..model.links.len()).filter(touches).map(|link| model.links[link].name.clone()).collect()
    }

    /// The block that two digits press from opposite sides.
    fn opposed_object(&self, contacts: &[Contact]) -> Option<usize> {
        let OpposingGrasp { min_angle_deg, min_force_n, min_force_ratio: balance, .. } = self.options;
        let min_angle = min_angle_deg * std::f64::consts::PI / 180.0;
        let opposing = |a: &Contact, b: &Contact| {
            let digits = (self.digit[a.link], self.digit[b.link]);
            let (weak, strong) = (a.force.min(b.force), a.force.max(b.force));
            a.object == b.object
                && digits.0.is_some()
                && digits.1.is_some()
                && digits.0 != digits.1
                && weak >= min_force_n
                && weak >= balance * strong
                && a.normal.angle(&b.normal) > min_angle
        };
        let pair =
            |(k, a): (usize, &Contact)| contacts[k + 1..].iter().any(|b| opposing(a, b)).then_some(a.object);
        contacts.iter().enumerate().find_map(pair)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use nalgebra::Isometry3;
    use proact_arm::{Joint, JointKind, JointLimits, Link};
    use proact_types::{Point, Vector};

    /// A hand of the given links, and joints about z from a parent (second) to a child.
    pub(crate) fn hand_model(links: &[&str], joints: &[(usize, usize)]) -> ArmModel {
        let link =
            |name: &str| Link { name: name.into(), inertial: None, collisions: vec![], visuals: vec![] };
        let joint = |&(child, parent): &(usize, usize)| Joint {
            name: format!("j{child}"),
            kind: JointKind::Revolute,
            parent,
            child,
            origin: Isometry3::identity(),
            axis: Vector::z(),
            limits: JointLimits::default(),
            damping: 0.0,
            friction: 0.0,
        };
        ArmModel {
            name: "hand".into(),
            links: links.iter().copied().map(link).collect(),
            joints: joints.iter().map(joint).collect(),
            arm: vec![],
            hand: (0..joints.len()).collect(),
            tip: 0,
            poses: vec![],
            allowed_collisions: vec![],
            ..Default::default()
        }
    }

    /// A palm (link 0) with a thumb (1, 2) and a finger (3).
    fn hand() -> ArmModel {
        hand_model(&["palm", "thumb0", "thumb1", "index0"], &[(1, 0), (2, 1), (3, 0)])
    }

    fn contact(link: usize, normal: Vector) -> Contact {
        Contact { object: 2, link, point: Point::origin(), normal, force: 1.0 }
    }

    fn pinch() -> [Contact; 2] {
        [contact(2, Vector::x()), contact(3, -Vector::x())]
    }

    fn ticks_to_attach(contacts: &[Contact], state: HandState) -> Option<usize> {
        let mut rule = GraspRule::new(OpposingGrasp::DEFAULT, &hand());
        (1..200).find(|_| rule.step(contacts, state, None, false) == Some(GraspAction::Attach(2)))
    }

    #[test]
    fn a_pinch_between_thumb_and_finger_attaches_after_its_time() {
        assert_eq!(
            ticks_to_attach(&pinch(), HandState::Closing),
            Some(OpposingGrasp::DEFAULT.hold_ms as usize)
        );
    }

    #[test]
    fn two_links_of_one_digit_a_palm_or_contacts_from_one_side_do_not_hold() {
        let one_digit = [contact(1, Vector::x()), contact(2, -Vector::x())];
        let palm = [contact(0, Vector::x()), contact(3, -Vector::x())];
        let one_side = [contact(2, Vector::x()), contact(3, Vector::new(1.0, 0.3, 0.0).normalize())];
        for contacts in [one_digit, palm, one_side] {
            assert_eq!(ticks_to_attach(&contacts, HandState::Closing), None, "{contacts:?}");
        }
    }

    #[test]
    fn an_opening_hand_takes_nothing() {
        assert_eq!(ticks_to_attach(&pinch(), HandState::Opening), None);
        assert_eq!(ticks_to_attach(&pinch(), HandState::Open), None);
    }

    #[test]
    fn contact_that_flickers_counts_back_and_a_brief_touch_is_forgotten() {
        let mut rule = GraspRule::new(OpposingGrasp::DEFAULT, &hand());
        for tick in 0..10 * OpposingGrasp::DEFAULT.hold_ms {
            let touch = if tick % 2 == 0 { &pinch()[..] } else { &[] };
            assert_eq!(rule.step(touch, HandState::Closing, None, false), None);
        }
    }

    #[test]
    fn an_opened_hand_releases_and_a_closed_one_does_not() {
        let mut rule = GraspRule::new(OpposingGrasp::DEFAULT, &hand());
        assert_eq!(rule.step(&[], HandState::Closed, Some(2), true), None);
        assert_eq!(rule.step(&[], HandState::Opening, Some(2), false), None);
        assert_eq!(rule.step(&[], HandState::Opening, Some(2), true), Some(GraspAction::Release));
    }
}
