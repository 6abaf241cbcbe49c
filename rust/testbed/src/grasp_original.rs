//! The original's grasp rule, for comparisons.

use crate::{GraspAction, OriginalGrasp};
use proact_arm::{ArmModel, is_named};
use proact_types::{PlantState, Point, Pose, Vector};

/// What a link did to a block since the last check.
#[derive(Clone, Copy, Debug)]
struct Touch {
    block: usize,
    link: usize,
    /// Sum over ticks and points, N, `world`.
    force: Vector,
    /// Sum of the points, link frame, m.
    point: Vector,
    points: u32,
}

/// A finger on the block that was taken.
#[derive(Clone, Copy, Debug)]
struct Finger {
    link: usize,
    /// In the link's frame.
    point: Point,
    /// From there to the block's centre when it was taken, metres.
    distance: f64,
}

/// The rule of `GazeboGraspFix`, with the settings of the published code, in simulated time: contacts are averaged over
/// 250 ms; two opposing mean forces count a block up, their absence down; above four it is taken, and at four or below it
/// is let go once a finger has come away. So a grasp takes 1.25 s and a release about one.
///
/// Differences: forces are told apart by link, not by collision shape, and a block that is carried feels no forces, so that
/// fingers which have not come away count as pressing.
#[derive(Clone, Debug)]
pub struct OriginalGraspRule {
    options: OriginalGrasp,
    gripper: Vec<usize>,
    ticks: u32,
    touches: Vec<Touch>,
    /// By block.
    counts: Vec<u32>,
    fingers: Vec<Finger>,
    /// `world_from_link` of every link: scratch.
    links: Vec<Pose>,
}

impl OriginalGraspRule {
    /// The rule for the hand of `model`: the links that its settings name, or all digits if they name none. (The original
    /// has left its index out, and the pinky never was in.)
    pub fn new(options: OriginalGrasp, model: &ArmModel) -> Self {
        let (names, digits) = (&model.settings.gripper, model.digits());
        let grips = |link: &usize| match names.as_slice() {
            [] => digits[*link].is_some(),
            names => names.iter().any(|name| is_named(&model.links[*link].name, name)),
        };
        let gripper = (0..model.links.len()).filter(grips).collect();
        let (touches, counts, fingers, links) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        Self { options, gripper, ticks: 0, touches, counts, fingers, links }
    }

    /// One tick with the state that the physics left.
    pub fn step(&mut self, model: &ArmModel, state: &PlantState) -> Option<GraspAction> {
        self.ticks += 1;
        let check = self.ticks == self.options.check_ms;
        let touched = state.contacts.iter().any(|contact| self.gripper.contains(&contact.link));
        if !check && !touched {
            return None;
        }
        model.place_links(&state.world_from_base, &state.position, &mut self.links);
        self.gather(state);
        if !check {
            return None;
        }
        self.ticks = 0;
        let action = self.check(state);
        self.touches.clear();
        action
    }

    fn gather(&mut self, state: &PlantState) {
        for contact in state.contacts.iter().filter(|contact| self.gripper.contains(&contact.link)) {
            let (block, link) = (contact.object, contact.link);
            let known = self.touches.iter().position(|touch| touch.block == block && touch.link == link);
            let index = known.unwrap_or(self.touches.len());
            if known.is_none() {
                let (force, point) = (Vector::zeros(), Vector::zeros());
                self.touches.push(Touch { block, link, force, point, points: 0 });
            }
            let touch = &mut self.touches[index];
            touch.force += contact.normal * contact.force;
            touch.point += self.links[link].inverse_transform_point(&contact.point).coords;
            touch.points += 1;
        }
    }

    fn check(&mut self, state: &PlantState) -> Option<GraspAction> {
        self.counts.resize(state.objects.len(), 0);
        let attached = state.attached.map(|(block, _)| block);
        for block in 0..state.objects.len() {
            let gripped =
                if attached == Some(block) { self.pressed(state, block) } else { self.gripped(block) };
            let OriginalGrasp { max_count, grip_count, release_distance_m: release, .. } = self.options;
            let count = &mut self.counts[block];
            *count = if gripped { (*count + 1).min(max_count) } else { count.saturating_sub(1) };
            if gripped && *count > grip_count && attached.is_none() {
                self.hold(state, block);
                return Some(GraspAction::Attach(block));
            }
            let loose = attached == Some(block) && !gripped && *count <= grip_count;
            if loose && self.recession(state, block).any(|metres| metres > release) {
                self.counts[block] = 0;
                self.fingers.clear();
                return Some(GraspAction::Release);
            }
        }
        None
    }

    /// Whether two mean forces on a block oppose each other.
    fn gripped(&self, block: usize) -> bool {
        let forces: Vec<Vector> = self
            .touches
            .iter()
            .filter(|touch| touch.block == block)
            .map(|touch| touch.force / f64::from(touch.points))
            .collect();
        let OriginalGrasp { least_angle_deg, least_force_n, balance, .. } = self.options;
        let least_angle = least_angle_deg * std::f64::consts::PI / 180.0;
        let opposing = |a: &Vector, b: &Vector| {
            let (weak, strong) = (a.norm().min(b.norm()), a.norm().max(b.norm()));
            weak >= least_force_n && weak >= balance * strong && a.angle(b) > least_angle
        };
        forces.iter().enumerate().any(|(k, a)| forces[k + 1..].iter().any(|b| opposing(a, b)))
    }

    /// Whether two fingers are still where they were when they took the block.
    fn pressed(&self, state: &PlantState, block: usize) -> bool {
        let pressing = self.options.pressing_distance_m;
        self.recession(state, block).filter(|metres| *metres < pressing).count() >= 2
    }

    /// By how much each finger's distance to the block has changed since it was taken, metres.
    fn recession(&self, state: &PlantState, block: usize) -> impl Iterator<Item = f64> {
        let centre = Point::from(state.objects[block].pose.translation.vector);
        let metres = |finger: &Finger| {
            ((self.links[finger.link] * finger.point - centre).norm() - finger.distance).abs()
        };
        self.fingers.iter().map(metres).collect::<Vec<_>>().into_iter()
    }

    fn hold(&mut self, state: &PlantState, block: usize) {
        let centre = Point::from(state.objects[block].pose.translation.vector);
        let finger = |touch: &Touch| {
            let point = Point::from(touch.point / f64::from(touch.points));
            Finger { link: touch.link, point, distance: (self.links[touch.link] * point - centre).norm() }
        };
        self.fingers = self.touches.iter().filter(|touch| touch.block == block).map(finger).collect();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grasp::tests::link_names_and_joints;
    use nalgebra::Isometry3;
    use proact_types::{BodyState, Contact, joints, zeros};

    /// A thumb and a middle finger that hang from the palm and turn about z.
    fn hand() -> ArmModel {
        link_names_and_joints(&["palm", "arm__thumb3_link", "arm__middle3_link"], &[(1, 0), (2, 0)])
    }

    /// The thumb at -y and the finger at +y of a block, `force` N each, or no contact at all.
    fn state(angle: f64, forces: Option<(f64, f64)>, attached: bool) -> PlantState {
        let block = BodyState {
            pose: Pose::translation(0.1, 0.0, 0.0),
            linear: Vector::zeros(),
            angular: Vector::zeros(),
        };
        let contact = |link: usize, side: f64, force: f64| Contact {
            object: 0,
            link,
            point: Point::new(0.1, 0.025 * side, 0.0),
            normal: Vector::y() * -side,
            force,
        };
        let contacts = forces.map(|(thumb, finger)| [contact(1, -1.0, thumb), contact(2, 1.0, finger)]);
        PlantState {
            position: joints(&[-angle, angle]),
            velocity: zeros(2),
            effort: zeros(2),
            stop_effort: zeros(2),
            world_from_base: Isometry3::identity(),
            base_held: false,
            objects: std::iter::once(block).collect(),
            attached: attached.then(|| (0, Isometry3::identity())),
            contacts: contacts.into_iter().flatten().collect(),
        }
    }

    /// Ticks until the rule acts.
    fn ticks(rule: &mut OriginalGraspRule, state: &PlantState, most: u32) -> Option<(u32, GraspAction)> {
        (1..=most).find_map(|tick| rule.step(&hand(), state).map(|action| (tick, action)))
    }

    #[test]
    fn a_pinch_takes_the_block_at_the_fifth_check() {
        let mut rule = OriginalGraspRule::new(OriginalGrasp::DEFAULT, &hand());
        let found = ticks(&mut rule, &state(0.0, Some((1.0, 0.5)), false), 3000);
        assert_eq!(found, Some((1250, GraspAction::Attach(0))));
    }

    #[test]
    fn forces_that_are_weak_uneven_or_from_one_side_take_nothing() {
        for forces in [(0.9e-4, 0.9e-4), (1.0, 0.29)] {
            let mut rule = OriginalGraspRule::new(OriginalGrasp::DEFAULT, &hand());
            assert_eq!(ticks(&mut rule, &state(0.0, Some(forces), false), 5000), None, "{forces:?}");
        }
        let mut one_side = state(0.0, Some((1.0, 1.0)), false);
        one_side.contacts[1].normal = Vector::new(0.5, 1.0, 0.0).normalize();
        assert_eq!(
            ticks(&mut OriginalGraspRule::new(OriginalGrasp::DEFAULT, &hand()), &one_side, 5000),
            None
        );
    }

    #[test]
    fn a_hand_that_opens_lets_go_at_the_fourth_check_after_a_long_hold_and_sooner_after_a_short_one() {
        for (held, expected) in [(2000, 1000), (0, 250)] {
            let mut rule = OriginalGraspRule::new(OriginalGrasp::DEFAULT, &hand());
            ticks(&mut rule, &state(0.0, Some((1.0, 1.0)), false), 3000).expect("takes the block");
            assert_eq!(ticks(&mut rule, &state(0.0, None, true), held), None, "a closed hand holds");
            // Half a radian takes the points by some 5 cm.
            let found = ticks(&mut rule, &state(0.5, None, true), 5000);
            assert_eq!(found, Some((expected, GraspAction::Release)), "after {held} ms");
        }
    }

    #[test]
    fn fingers_that_have_come_away_by_less_than_three_centimetres_do_not_let_go() {
        let mut rule = OriginalGraspRule::new(OriginalGrasp::DEFAULT, &hand());
        ticks(&mut rule, &state(0.0, Some((1.0, 1.0)), false), 3000).expect("takes the block");
        assert_eq!(ticks(&mut rule, &state(0.2, None, true), 20_000), None);
    }
}
