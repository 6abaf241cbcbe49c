//! The original's grasp rule, for comparisons.

use crate::{GraspAction, OriginalGrasp};
use proact_arm::{ArmModel, matches_short_name};
use proact_types::{PlantState, Point, Pose, Vector};

/// What a link did to a block since the last check.
#[derive(Clone, Copy, Debug)]
struct AccumulatedContact {
    block: usize,
    link: usize,
    /// Sum over ticks and points, N, `world`.
    force: Vector,
    /// Sum of the points, link frame, m.
    point: Vector,
    point_count: u32,
}

/// A finger on the block that was taken.
#[derive(Clone, Copy, Debug)]
struct GraspingFinger {
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
    contacts: Vec<AccumulatedContact>,
    /// By block.
    grip_counts: Vec<u32>,
    fingers: Vec<GraspingFinger>,
    /// `world_from_link` of every link: scratch.
    links: Vec<Pose>,
}

impl OriginalGraspRule {
    /// The rule for the hand of `model`: the links that its settings name, or all digits if they name none. (The original
    /// has left its index out, and the pinky never was in.)
    pub fn new(options: OriginalGrasp, model: &ArmModel) -> Self {
        let (names, digits) = (&model.settings.grasp_contact_links, model.digits());
        let grips = |link: &usize| match names.as_slice() {
            [] => digits[*link].is_some(),
            names => names.iter().any(|name| matches_short_name(&model.links[*link].name, name)),
        };
        let gripper = (0..model.links.len()).filter(grips).collect();
        let (touches, counts, fingers, links) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        Self { options, gripper, ticks: 0, contacts: touches, grip_counts: counts, fingers, links }
    }

    /// One tick with the state that the physics left.
    pub fn step(&mut self, model: &ArmModel, state: &PlantState) -> Option<GraspAction> {
        self.ticks += 1;
        let check = self.ticks == self.options.check_interval_ms;
        let touched = state.contacts.iter().any(|contact| self.gripper.contains(&contact.link));
        if !check && !touched {
            return None;
        }
        model.link_poses_into(&state.world_from_base, &state.position, &mut self.links);
        self.accumulate_contacts(state);
        if !check {
            return None;
        }
        self.ticks = 0;
        let action = self.check(state);
        self.contacts.clear();
        action
    }

    fn accumulate_contacts(&mut self, state: &PlantState) {
        for contact in state.contacts.iter().filter(|contact| self.gripper.contains(&contact.link)) {
            let (block, link) = (contact.object, contact.link);
            let known = self.contacts.iter().position(|touch| touch.block == block && touch.link == link);
            let index = known.unwrap_or(self.contacts.len());
            if known.is_none() {
                let (force, point) = (Vector::zeros(), Vector::zeros());
                self.contacts.push(AccumulatedContact { block, link, force, point, point_count: 0 });
            }
            let touch = &mut self.contacts[index];
            touch.force += contact.normal * contact.force;
            touch.point += self.links[link].inverse_transform_point(&contact.point).coords;
            touch.point_count += 1;
        }
    }

    fn check(&mut self, state: &PlantState) -> Option<GraspAction> {
        self.grip_counts.resize(state.objects.len(), 0);
        let attached = state.attached.map(|(block, _)| block);
        for block in 0..state.objects.len() {
            let gripped = if attached == Some(block) {
                self.is_still_gripped(state, block)
            } else {
                self.has_opposing_forces(block)
            };
            let OriginalGrasp {
                max_grip_count: max_count,
                grip_count_threshold: grip_count,
                release_tolerance_m: release,
                ..
            } = self.options;
            let count = &mut self.grip_counts[block];
            *count = if gripped { (*count + 1).min(max_count) } else { count.saturating_sub(1) };
            if gripped && *count > grip_count && attached.is_none() {
                self.record_fingers(state, block);
                return Some(GraspAction::Attach(block));
            }
            let loose = attached == Some(block) && !gripped && *count <= grip_count;
            if loose && self.finger_displacements_m(state, block).any(|meters| meters > release) {
                self.grip_counts[block] = 0;
                self.fingers.clear();
                return Some(GraspAction::Release);
            }
        }
        None
    }

    /// Whether two mean forces on a block oppose each other.
    fn has_opposing_forces(&self, block: usize) -> bool {
        let forces: Vec<Vector> = self
            .contacts
            .iter()
            .filter(|touch| touch.block == block)
            .map(|touch| touch.force / f64::from(touch.point_count))
            .collect();
        let OriginalGrasp {
            forces_angle_tolerance_deg: min_angle_deg,
            min_force_n,
            min_force_ratio: balance,
            ..
        } = self.options;
        let min_angle = min_angle_deg * std::f64::consts::PI / 180.0;
        let opposing = |a: &Vector, b: &Vector| {
            let (weak, strong) = (a.norm().min(b.norm()), a.norm().max(b.norm()));
            weak >= min_force_n && weak >= balance * strong && a.angle(b) > min_angle
        };
        forces.iter().enumerate().any(|(k, a)| forces[k + 1..].iter().any(|b| opposing(a, b)))
    }

    /// Whether two fingers are still where they were when they took the block.
    fn is_still_gripped(&self, state: &PlantState, block: usize) -> bool {
        let pressing = self.options.pressing_distance_m;
        self.finger_displacements_m(state, block).filter(|meters| *meters < pressing).count() >= 2
    }

    /// By how much each finger's distance to the block has changed since it was taken, metres.
    fn finger_displacements_m(&self, state: &PlantState, block: usize) -> impl Iterator<Item = f64> {
        let center = Point::from(state.objects[block].pose.translation.vector);
        let meters = |finger: &GraspingFinger| {
            ((self.links[finger.link] * finger.point - center).norm() - finger.distance).abs()
        };
        self.fingers.iter().map(meters).collect::<Vec<_>>().into_iter()
    }

    fn record_fingers(&mut self, state: &PlantState, block: usize) {
        let center = Point::from(state.objects[block].pose.translation.vector);
        let finger = |touch: &AccumulatedContact| {
            let point = Point::from(touch.point / f64::from(touch.point_count));
            GraspingFinger {
                link: touch.link,
                point,
                distance: (self.links[touch.link] * point - center).norm(),
            }
        };
        self.fingers = self.contacts.iter().filter(|touch| touch.block == block).map(finger).collect();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grasp::tests::hand_model;
    use nalgebra::Isometry3;
    use proact_types::{BodyState, Contact, joints, zeros};

    /// A thumb and a middle finger that hang from the palm and turn about z.
    fn hand() -> ArmModel {
        hand_model(&["palm", "arm__thumb3_link", "arm__middle3_link"], &[(1, 0), (2, 0)])
    }

    /// The thumb at -y and the finger at +y of a block, `force` N each, or no contact at all.
    fn state(angle: f64, forces: Option<(f64, f64)>, attached: bool) -> PlantState {
        let block = BodyState {
            pose: Pose::translation(0.1, 0.0, 0.0),
            linear_velocity: Vector::zeros(),
            angular_velocity: Vector::zeros(),
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
            limit_effort: zeros(2),
            world_from_base: Isometry3::identity(),
            base_held: false,
            objects: std::iter::once(block).collect(),
            attached: attached.then(|| (0, Isometry3::identity())),
            contacts: contacts.into_iter().flatten().collect(),
        }
    }

    /// Ticks until the rule acts.
    fn ticks(rule: &mut OriginalGraspRule, state: &PlantState, max_ticks: u32) -> Option<(u32, GraspAction)> {
        (1..=max_ticks).find_map(|tick| rule.step(&hand(), state).map(|action| (tick, action)))
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
