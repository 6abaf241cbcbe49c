//! What a practised person knows of the arm: where the hand goes when a joint turns, and which few joints would
//! have to turn for the hand to be somewhere. A model in the head, apart from the kinematics that drive the arm.

use nalgebra::{DMatrix, DVector, Translation3, Unit, UnitQuaternion};
use proact_types::{ArmModel, JointVector, Point, Pose, Vector};
use std::sync::Arc;

/// Steps of the search for joint angles.
const STEPS: usize = 40;
/// Damping of a step, metres: the search stays calm where the arm is stretched.
const DAMPING: f64 = 0.03;
/// One radian of the hand's tilt counts as this many metres: first the place, then the attitude.
const TILT_WEIGHT: f64 = 0.03;
/// Largest change of a joint in one step, rad.
const STEP_MAX: f64 = 0.2;
/// The search ends when a step is shorter than this, rad.
const STEP_MIN: f64 = 1e-4;
/// Joints that are moved for one way, at most.
const MOST_JOINTS: u32 = 4;
/// A joint moves at least this far: shorter gestures are not recognised, rad.
const LEAST_TURN: f64 = 0.05;
/// Points looked at on the way of one joint.
const SAMPLES: usize = 8;
/// A metre of obstacle in the way counts as this many seconds.
const SECS_PER_METRE: f64 = 1000.0;
/// A metre short of the goal counts as this many seconds.
const SECS_PER_METRE_OFF: f64 = 300.0;
/// A gesture that goes one joint on takes this long, and one that turns a joint this much beyond the turn itself,
/// seconds.
const SECS_PER_MODE: f64 = 0.8;
const SECS_PER_TURN: f64 = 1.2;

/// Where the hand should be: the grasp centre at a point, and an axis of the hand upright. The yaw about it is
/// free.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct HandGoal {
    /// Point of the hand that is brought to `target`, in the tip's frame.
    pub(crate) point: Point,
    /// Axis of the hand that is brought upright, in the tip's frame, unit length.
    pub(crate) axis: Vector,
    /// Where the point should be, in `base_link`.
    pub(crate) target: Point,
    /// What upright is, in `base_link`, unit length.
    pub(crate) up: Vector,
    /// How far off the point may be, metres.
    pub(crate) point_done: f64,
    /// How far off upright the axis may be, rad.
    pub(crate) tilt_done: f64,
    /// Where the yaw is not free: `base_from_tip`'s rotation.
    pub(crate) attitude: Option<UnitQuaternion<f64>>,
}

impl HandGoal {
    /// What `base_from_tip` leaves: metres of the point, and rad of tilt, or of all attitude.
    pub(crate) fn off(&self, base_from_tip: &Pose) -> (f64, f64) {
        let tilt = match &self.attitude {
            Some(wanted) => base_from_tip.rotation.angle_to(wanted),
            None => (base_from_tip.rotation * self.axis).angle(&self.up),
        };
        ((self.target - base_from_tip * self.point).norm(), tilt)
    }

    /// True if nothing is left to do.
    pub(crate) fn reached(&self, base_from_tip: &Pose) -> bool {
        let (off, tilt) = self.off(base_from_tip);
        off <= self.point_done && tilt <= self.tilt_done
    }
}

/// A joint to turn, and how far.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Turn {
    /// Position among the arm joints.
    pub(crate) joint: usize,
    /// Where it goes, rad.
    pub(crate) to: f64,
    /// From where it was when the turn was thought of, rad.
    pub(crate) angle: f64,
}

/// The arm as its user knows it.
#[derive(Clone, Debug)]
pub(crate) struct ArmSense {
    model: Arc<ArmModel>,
}

/// Some joints in the order in which they turn.
struct Way {
    turns: Vec<Turn>,
    secs: f64,
    /// Obstacle in the way, metres.
    blocked: f64,
}

impl ArmSense {
    pub(crate) fn new(model: Arc<ArmModel>) -> Self {
        Self { model }
    }

    /// `base_from_tip` at the arm angles `q`, and point and axis of each joint, in the base.
    fn chain(&self, q: &[f64]) -> (Pose, Vec<(Point, Vector)>) {
        // Links of the way from the base to the tip; joint `link - 1` moves `link`.
        let mut links = Vec::with_capacity(16);
        let mut link = self.model.tip;
        while link > 0 {
            links.push(link - 1);
            link = self.model.joints[link - 1].parent;
        }
        let mut pose = Pose::identity();
        let mut axes = vec![(Point::origin(), Vector::zeros()); q.len()];
        for &joint in links.iter().rev() {
            let described = &self.model.joints[joint];
            pose *= described.origin;
            let Some(k) = self.model.arm.iter().position(|&j| j == joint) else { continue };
            axes[k] = (Point::from(pose.translation.vector), pose.rotation * described.axis);
            let turn = UnitQuaternion::from_axis_angle(&Unit::new_normalize(described.axis), q[k]);
            pose *= Pose::from_parts(Translation3::identity(), turn);
        }
        (pose, axes)
    }

    /// Where the joints and tips of the fingers are in the tip's frame at the angles `moving` of all joints.
    pub(crate) fn fingers(&self, moving: &[f64]) -> Vec<Point> {
        let mut poses: Vec<Option<Pose>> = vec![None; self.model.links.len()];
        poses[self.model.tip] = Some(Pose::identity());
        let mut points = Vec::new();
        for (k, joint) in self.model.joints.iter().enumerate() {
            let Some(parent) = poses[joint.parent] else { continue };
            let angle = self.model.moving().position(|j| j == k).and_then(|at| moving.get(at));
            let axis = Unit::new_normalize(joint.axis);
            let turn =
                angle.map_or(UnitQuaternion::identity(), |a| UnitQuaternion::from_axis_angle(&axis, *a));
            let pose = parent * joint.origin * Pose::from_parts(Translation3::identity(), turn);
            poses[joint.child] = Some(pose);
            let at = pose.translation.vector;
            points.push(Point::from(at));
            // The last link of a finger is a little shorter than the one before it.
            if !self.model.joints.iter().any(|next| next.parent == joint.child) {
                points.push(Point::from(at + (at - parent.translation.vector) * 0.8));
            }
        }
        points
    }

    /// `base_from_tip` at the arm angles `q`.
    pub(crate) fn forward(&self, q: &[f64]) -> Pose {
        self.chain(q).0
    }

    /// Arm angles near `from` that bring the hand toward the goal by turning the joints of the set `moved` alone.
    pub(crate) fn inverse(&self, from: &[f64], goal: &HandGoal, moved: u32) -> JointVector {
        let limits: Vec<_> = self.model.arm.iter().map(|&j| self.model.joints[j].limits).collect();
        let mut q: JointVector = from.iter().copied().collect();
        for _ in 0..STEPS {
            let (pose, axes) = self.chain(&q);
            let point = pose * goal.point;
            let axis = pose.rotation * goal.axis;
            let off = goal.target - point;
            let tilt = match &goal.attitude {
                Some(wanted) => (wanted * pose.rotation.inverse()).scaled_axis(),
                None => axis.cross(&goal.up),
            } * TILT_WEIGHT;
            let error = DVector::from_iterator(6, off.iter().chain(tilt.iter()).copied());
            let mut jacobian = DMatrix::zeros(6, q.len());
            for (k, (origin, about)) in axes.iter().enumerate().filter(|(k, _)| moved >> k & 1 == 1) {
                jacobian.fixed_view_mut::<3, 1>(0, k).copy_from(&about.cross(&(point - origin)));
                let leans = match goal.attitude {
                    Some(_) => *about,
                    None => goal.up.cross(&about.cross(&axis)),
                } * TILT_WEIGHT;
                jacobian.fixed_view_mut::<3, 1>(3, k).copy_from(&leans);
            }
            let square = &jacobian * jacobian.transpose() + DMatrix::identity(6, 6) * (DAMPING * DAMPING);
            let Some(solved) = square.cholesky().map(|c| c.solve(&error)) else { break };
            let step = jacobian.transpose() * solved;
            let mut longest = 0.0_f64;
            for (k, limits) in limits.iter().enumerate() {
                let next = (q[k] + step[k].clamp(-STEP_MAX, STEP_MAX)).clamp(limits.lower, limits.upper);
                longest = longest.max((next - q[k]).abs());
                q[k] = next;
            }
            if longest < STEP_MIN {
                break;
            }
        }
        q
    }

    /// The joints to turn one after the other from `q` on the quickest way to the goal, where joint `mode` is selected
    /// and a turn of one rad takes `secs_per_rad`. `in_the_way` tells how far the hand at `base_from_tip` sticks in
    /// things, metres. Empty if no turn brings the hand nearer.
    pub(crate) fn turns(
        &self,
        q: &[f64],
        mode: usize,
        goal: &HandGoal,
        secs_per_rad: f64,
        in_the_way: &dyn Fn(&Pose) -> f64,
    ) -> Vec<Turn> {
        let here = self.forward(q);
        // A straight way when the whole one is blocked: half of it, a quarter of it.
        let start = here * goal.point;
        let mut best: Option<Way> = None;
        for share in [1.0, 0.5, 0.25] {
            let goal = HandGoal { target: start + (goal.target - start) * share, ..*goal };
            let way = self.way(q, mode, &goal, secs_per_rad, in_the_way);
            let clearer = |way: &Way, best: &Way| way.blocked < best.blocked - 0.005;
            if way.as_ref().is_some_and(|way| best.as_ref().is_none_or(|best| clearer(way, best))) {
                best = way;
            }
            if best.as_ref().is_some_and(|best| best.blocked < 0.005) {
                break;
            }
        }
        best.map(|way| way.turns).unwrap_or_default()
    }

    fn way(
        &self,
        q: &[f64],
        mode: usize,
        goal: &HandGoal,
        secs_per_rad: f64,
        in_the_way: &dyn Fn(&Pose) -> f64,
    ) -> Option<Way> {
        let short = |pose: &Pose| {
            let (off, tilt) = goal.off(pose);
            ((off - goal.point_done).max(0.0) + TILT_WEIGHT * (tilt - goal.tilt_done).max(0.0))
                * SECS_PER_METRE_OFF
        };
        let now = short(&self.forward(q));
        let mut best: Option<Way> = None;
        let sets = (1_u32..1 << q.len()).filter(|set| set.count_ones() <= MOST_JOINTS);
        for set in sets {
            let wanted = self.inverse(q, goal, set);
            let turns: Vec<Turn> = (0..q.len())
                .map(|joint| Turn { joint, to: wanted[joint], angle: wanted[joint] - q[joint] })
                .filter(|turn| turn.angle.abs() >= LEAST_TURN)
                .collect();
            if turns.len() != set.count_ones() as usize {
                continue;
            }
            let mut end: JointVector = q.iter().copied().collect();
            turns.iter().for_each(|turn| end[turn.joint] += turn.angle);
            let left = short(&self.forward(&end));
            if left >= now {
                continue;
            }
            let moving: f64 =
                turns.iter().map(|turn| turn.angle.abs() * secs_per_rad + SECS_PER_TURN).sum::<f64>() + left;
            if best.as_ref().is_some_and(|best| best.blocked == 0.0 && best.secs < moving) {
                continue;
            }
            let way = self.order(q, mode, &turns, in_the_way);
            let way = Way { secs: way.secs + moving, ..way };
            let cost = |way: &Way| way.secs + way.blocked * SECS_PER_METRE;
            if best.as_ref().is_none_or(|best| cost(&way) < cost(best)) {
                best = Some(way);
            }
        }
        best
    }

    /// The turns in the order that is clear of obstacles and needs the fewest changes of mode.
    fn order(&self, q: &[f64], mode: usize, turns: &[Turn], in_the_way: &dyn Fn(&Pose) -> f64) -> Way {
        let count = turns.len();
        // From each set of turns already made, by the one made last: seconds, obstacle, and what comes next. From
        // the end backwards.
        let mut best = vec![vec![(0.0_f64, 0.0_f64, 0_usize); count + 1]; 1 << count];
        for made in (0..(1_usize << count) - 1).rev() {
            let open = |k: &usize| made >> k & 1 == 0;
            let mut from: JointVector = q.iter().copied().collect();
            turns
                .iter()
                .enumerate()
                .filter(|(k, _)| !open(k))
                .for_each(|(_, turn)| from[turn.joint] = turn.to);
            let blocked: Vec<(usize, f64)> =
                (0..count).filter(open).map(|k| (k, self.blocked(&from, &turns[k], in_the_way))).collect();
            for last in 0..=count {
                let at = turns.get(last).map_or(mode, |turn| turn.joint);
                let on = |&(k, blocked): &(usize, f64)| {
                    let (secs, later, _) = best[made | 1 << k][k];
                    let modes = cycle_distance(at, turns[k].joint, q.len()) as f64;
                    (secs + modes * SECS_PER_MODE, later.max(blocked), k)
                };
                let cost = |(secs, blocked, _): &(f64, f64, usize)| secs + blocked * SECS_PER_METRE;
                let next = blocked.iter().map(on).min_by(|a, b| cost(a).total_cmp(&cost(b)));
                best[made][last] = next.unwrap_or_default();
            }
        }
        let (secs, blocked, _) = best[0][count];
        let (mut made, mut last, mut ordered) = (0, count, Vec::with_capacity(count));
        while ordered.len() < count {
            last = best[made][last].2;
            made |= 1 << last;
            ordered.push(turns[last]);
        }
        Way { turns: ordered, secs, blocked }
    }

    /// How far the hand sticks in things while one joint turns, metres.
    fn blocked(&self, from: &[f64], turn: &Turn, in_the_way: &dyn Fn(&Pose) -> f64) -> f64 {
        let mut q: JointVector = from.iter().copied().collect();
        (1..=SAMPLES).fold(0.0, |most: f64, sample| {
            q[turn.joint] = from[turn.joint] + turn.angle * sample as f64 / SAMPLES as f64;
            most.max(in_the_way(&self.forward(&q)))
        })
    }
}

/// Gestures from one of `count` modes to another: forward one by one, or back in about the same time each.
fn cycle_distance(from: usize, to: usize, count: usize) -> usize {
    let ahead = (to + count - from) % count;
    ahead.min(count - ahead + 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proact_types::{Joint, JointKind, JointLimits, Link};

    /// Three joints about z, y, y with links of 0.3 m along x.
    fn arm() -> ArmSense {
        let link =
            |k: usize| Link { name: format!("l{k}"), inertial: None, collisions: vec![], visuals: vec![] };
        let joint = |k: usize, axis: Vector| Joint {
            name: format!("j{k}"),
            kind: JointKind::Revolute,
            parent: k,
            child: k + 1,
            origin: Pose::translation(if k == 0 { 0.0 } else { 0.3 }, 0.0, 0.0),
            axis,
            limits: JointLimits { lower: -2.0, upper: 2.0, velocity: 1.0, effort: 1.0 },
            damping: 0.0,
            friction: 0.0,
        };
        ArmSense::new(Arc::new(ArmModel {
            name: "arm".into(),
            links: (0..4).map(link).collect(),
            joints: vec![joint(0, Vector::z()), joint(1, Vector::y()), joint(2, Vector::y())],
            arm: vec![0, 1, 2],
            hand: vec![],
            tip: 3,
            poses: vec![],
            allowed_collisions: vec![],
            grasp_centre: Vector::zeros(),
        }))
    }

    #[test]
    fn the_hand_is_where_trigonometry_says() {
        let pose = arm().forward(&[std::f64::consts::FRAC_PI_2, 0.0, 0.5]);
        assert!((pose.translation.vector - Vector::new(0.0, 0.6, 0.0)).norm() < 1e-12, "{pose}");
    }

    fn goal(arm: &ArmSense) -> HandGoal {
        let wanted = arm.forward(&[0.4, -0.5, 0.9]);
        HandGoal {
            point: Point::new(0.1, 0.0, 0.0),
            axis: Vector::z(),
            target: wanted * Point::new(0.1, 0.0, 0.0),
            up: wanted.rotation * Vector::z(),
            point_done: 0.01,
            tilt_done: 0.1,
            attitude: None,
        }
    }

    #[test]
    fn angles_are_found_that_bring_hand_and_axis_to_the_goal_and_what_is_out_of_reach_is_told() {
        let arm = arm();
        let near = goal(&arm);
        let q = arm.inverse(&[0.0, 0.1, 0.1], &near, 0b111);
        assert!(near.reached(&arm.forward(&q)), "{:?} left at {q:?}", near.off(&arm.forward(&q)));
        let wanted = arm.forward(&[0.4, -0.5, 0.9]).rotation;
        let whole = HandGoal { attitude: Some(wanted), ..near };
        let q = arm.inverse(&[0.0, 0.1, 0.1], &whole, 0b111);
        assert!(whole.reached(&arm.forward(&q)), "{:?} left at {q:?}", whole.off(&arm.forward(&q)));
        let far = HandGoal { target: Point::new(3.0, 0.0, 0.0), ..near };
        assert!(far.off(&arm.forward(&arm.inverse(&[0.0, 0.1, 0.1], &far, 0b111))).0 > 1.0);
    }

    #[test]
    fn the_turns_lead_to_the_goal_and_go_around_what_is_in_the_way() {
        let arm = arm();
        let (goal, q) = (goal(&arm), [0.0, 0.1, 0.1]);
        let end = |turns: &[Turn]| {
            let mut q = q;
            turns.iter().for_each(|turn| q[turn.joint] = turn.to);
            goal.off(&arm.forward(&q)).0
        };
        let free = arm.turns(&q, 0, &goal, 2.5, &|_| 0.0);
        assert!(end(&free) < 0.02, "{free:?}");
        assert_eq!(free[0].joint, 0, "the selected joint costs no gesture");
        // A wall that the hand passes only when it has been lifted before it is swung aside.
        let wall =
            |pose: &Pose| if pose.translation.y > 0.05 && pose.translation.z < 0.05 { 0.1 } else { 0.0 };
        let around = arm.turns(&q, 0, &goal, 2.5, &wall);
        assert_ne!(around.first().map(|turn| turn.joint), Some(0), "{around:?}");
    }

    #[test]
    fn modes_are_gone_to_forward_or_back_whichever_is_nearer() {
        assert_eq!([cycle_distance(0, 0, 7), cycle_distance(0, 3, 7), cycle_distance(0, 6, 7)], [0, 3, 2]);
    }
}
