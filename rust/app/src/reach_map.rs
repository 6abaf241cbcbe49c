//! Which part of the box an arm reaches from where its base is: a picture for this person and table, before the trial begins.

use nalgebra::UnitQuaternion;
use proact_arm::{
    ArmModel, Chain, ChainPoses, Grasp, JacobianColumns, damped_step_within_limits, upright_axis,
};
use proact_bridge::{ReachGrid, ReachPoint};
use proact_participants::Body;
use proact_types::{JointVector, Point, Pose, Scene, TrunkPosture, Vector, joints};
use serde::Serialize;

/// From place to place, m.
const SPACING_M: f64 = 0.03;
/// Leans that are tried, as shares of that from which all places are reached; beyond it the trunk goes no further.
const LEAN_FRACTIONS: [f64; 6] = [0.0, 0.25, 0.5, 0.75, 1.0, 1.3];
/// Steps from one starting posture at most.
const MAX_IK_STEPS: usize = 60;
/// The hand is there: m, rad.
const POSITION_TOLERANCE_M: f64 = 0.005;
const ANGLE_TOLERANCE_RAD: f64 = 0.02;
/// Square of the damping of a step, and its longest, rad.
const IK_DAMPING: f64 = 1e-4;
const MAX_STEP_RAD: f64 = 0.4;

/// What of the box is reached: a hand above the table that holds an object as it grips from above, within the joints' limits.
/// Walls and objects in the way are not looked at; a planner may find less.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ReachMap {
    /// Height of what is gripped, m, `world`.
    pub height_m: f64,
    /// From place to place, m.
    pub spacing_m: f64,
    /// Where the shoulder is, upright, m, `world`.
    pub shoulder: [f64; 3],
    /// Row by row, the furthest first, each from left to right.
    pub rows: Vec<Vec<ReachPoint>>,
}

impl ReachMap {
    /// Of the arm `model` on `body`, in the box of `scene`.
    pub fn new(model: &ArmModel, scene: &Scene, body: &Body) -> Self {
        let width = scene.objects.first().map_or(0.05, |object| object.shape.grip_width());
        let half_height = scene
            .objects
            .first()
            .map_or(0.025, |object| object.pose.translation.z - scene.table_height)
            .max(0.0);
        let height_m = scene.table_height + half_height;
        let hand = GraspIk::new(model, model.grasp_for(width).clone());
        let postures = LEAN_FRACTIONS.map(|share| {
            let [forward, lateral, axial] =
                body.reaching_posture_deg.map(|degrees| (share * degrees).to_radians());
            body.clamp_posture(TrunkPosture { forward, lateral, axial })
        });

        let (low, high) = (scene.place_region.min, scene.place_region.max);
        let side = low[1].abs().max(high[1].abs());
        let rows = grid_steps(low[0], high[0]).rev().map(|x| {
            let mut warm: Vec<Option<JointVector>> = vec![None; LEAN_FRACTIONS.len()];
            let points = grid_steps(-side, side).rev().map(|y| {
                let point = Point::new(x, y, height_m);
                let found = (0..LEAN_FRACTIONS.len()).find(|&k| {
                    let base = body.shoulder_pose(&postures[k]);
                    let q = hand.solve(&base, &point, warm[k].as_ref());
                    let there = q.is_some();
                    warm[k] = q.or(warm[k].take());
                    there
                });
                let lean_deg = found.map(|k| postures[k].forward.to_degrees());
                ReachPoint { x, y, lean_deg }
            });
            points.collect::<Vec<_>>()
        });
        let rows = rows.collect();
        let shoulder = body.shoulder_pose(&TrunkPosture::default()).translation.vector.into();
        Self { height_m, spacing_m: SPACING_M, shoulder, rows }
    }

    fn cells(&self) -> impl Iterator<Item = &ReachPoint> {
        self.rows.iter().flatten()
    }

    /// Share of the places that are reached by leaning by `lean_deg` at most, 0 to 1.
    pub fn reachable_fraction(&self, lean_deg: f64) -> f64 {
        let count = self.cells().count().max(1);
        let reached = self.cells().filter(|point| point.lean_deg.is_some_and(|lean| lean <= lean_deg + 1e-9));
        reached.count() as f64 / count as f64
    }

    /// In one sentence.
    pub fn summary(&self) -> String {
        let (still, all) = (self.reachable_fraction(0.0), self.reachable_fraction(f64::INFINITY));
        let furthest = self.cells().filter_map(|point| point.lean_deg).fold(0.0, f64::max);
        if furthest < 0.5 {
            return format!("{:.0} % of the box is reached without leaning, no more with it", 1e2 * still);
        }
        format!(
            "{:.0} % of the box is reached without leaning, {:.0} % by leaning by up to {furthest:.0} degrees",
            1e2 * still,
            1e2 * all
        )
    }

    /// As the page draws it.
    pub fn to_page_picture(&self) -> ReachGrid {
        let points = self.cells().copied().collect();
        ReachGrid { summary: self.summary(), height_m: self.height_m, spacing_m: self.spacing_m, points }
    }

    /// As lines of text: seen from above, the person below.
    pub fn to_text_picture(&self) -> String {
        let mut text = String::new();
        for row in &self.rows {
            let cells = row.iter().map(|point| match point.lean_deg {
                None => '.',
                Some(lean) if lean < 0.5 => '#',
                // A digit for each five degrees that have begun.
                Some(lean) => char::from_digit((lean / 5.0).ceil().clamp(1.0, 9.0) as u32, 10).unwrap_or('9'),
            });
            let cells: String = cells.flat_map(|cell| [cell, ' ']).collect();
            text += &format!("{:5.2} m  {}\n", row.first().map_or(0.0, |point| point.x), cells.trim_end());
        }
        let [x, y, z] = self.shoulder;
        text += &format!(
            "shoulder at {x:.2}, {y:.2}, {z:.2} m; a cell is {:.0} cm; left is left, the person is below\n\
             # reached without leaning; 1 to 9 by leaning by up to 5 to 45 degrees; . not reached; walls are not looked at\n",
            1e2 * self.spacing_m
        );
        text + &self.summary()
    }
}

/// Places from `low` to `high`.
fn grid_steps(low: f64, high: f64) -> impl DoubleEndedIterator<Item = f64> {
    let count = ((high - low).max(0.0) / SPACING_M).round() as usize;
    (0..=count).map(move |k| low + (high - low) * k as f64 / count.max(1) as f64)
}

/// The hand at the end of the arm.
pub(crate) struct GraspIk {
    chain: Chain,
    grasp: Grasp,
    start_postures: Vec<JointVector>,
}

impl GraspIk {
    pub(crate) fn new(model: &ArmModel, grasp: Grasp) -> Self {
        let chain = Chain::new(model);
        let middle = |share: f64| -> JointVector {
            chain.limits().iter().map(|limits| limits.lower + share * (limits.upper - limits.lower)).collect()
        };
        let mut starts = vec![middle(0.5), middle(0.35), middle(0.65)];
        if let Ok(start) = model.pose("arm", "start") {
            starts.insert(0, joints(start));
        }
        Self { chain, grasp, start_postures: starts }
    }

    /// Where the middle of a gripped object is, in the tip's frame.
    pub(crate) fn grasp_center(&self) -> Vector {
        self.grasp.center
    }

    /// Angles that bring the grasp's centre to `goal`, upright as far as the grasp allows, for a base at `base`; from those of a
    /// neighbour first.
    pub(crate) fn solve(
        &self,
        base: &Pose,
        goal: &Point,
        neighbor: Option<&JointVector>,
    ) -> Option<JointVector> {
        let (target, up) = (base.inverse() * goal, base.rotation.inverse() * Vector::z());
        neighbor.into_iter().chain(&self.start_postures).find_map(|from| self.solve_from(from, &target, &up))
    }

    fn solve_from(&self, from: &JointVector, target: &Point, up: &Vector) -> Option<JointVector> {
        let mut q = from.clone();
        let mut poses = ChainPoses::default();
        for _ in 0..MAX_IK_STEPS {
            self.chain.link_poses_into(&q, &mut poses);
            let center = poses.tip * Point::from(self.grasp.center);
            let offset = target - center;
            let turn = self.upright_correction(&poses.tip.rotation, up);
            if offset.norm() < POSITION_TOLERANCE_M && turn.norm() < ANGLE_TOLERANCE_RAD {
                return Some(q);
            }
            let mut columns: JacobianColumns = self.chain.jacobian(&poses, &center);
            for column in &mut columns {
                // Turning about the vertical is free.
                let axis = Vector::new(column[3], column[4], column[5]);
                let level = axis - up * up.dot(&axis);
                (column[3], column[4], column[5]) = (level.x, level.y, level.z);
            }
            let error = nalgebra::Vector6::new(offset.x, offset.y, offset.z, turn.x, turn.y, turn.z);
            damped_step_within_limits(
                &mut q,
                self.chain.limits(),
                &mut columns,
                &error,
                IK_DAMPING,
                MAX_STEP_RAD,
            );
        }
        None
    }

    /// The turn that takes the hand to the nearest roll and lean at which it grips.
    fn upright_correction(&self, base_from_tip: &UnitQuaternion<f64>, up: &Vector) -> Vector {
        let in_tip = base_from_tip.inverse() * up;
        let (roll, lean) = (in_tip.y.atan2(in_tip.z), -in_tip.x.clamp(-1.0, 1.0).asin());
        let [low, high] = self.grasp.roll_range_rad;
        let axis = upright_axis(
            roll.clamp(low, high),
            lean.clamp(-self.grasp.max_lean_rad, self.grasp.max_lean_rad),
        );
        let is = base_from_tip * axis;
        let turn = is.cross(up);
        let angle = is.angle(up);
        if turn.norm() < 1e-9 { Vector::zeros() } else { turn.normalize() * angle }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proact_testbed::{Setup, TrialConfig};

    fn map(setup: &str, change: impl Fn(&mut Body)) -> ReachMap {
        let config = TrialConfig::new("A", 1, Setup::named(setup).unwrap());
        let trial = crate::trial::live_trial(config).unwrap().trial;
        let mut body = trial.testbed().config().setup.body;
        change(&mut body);
        ReachMap::new(trial.testbed().model(), trial.testbed().task().scene(), &body)
    }

    #[test]
    fn a_person_who_sits_has_to_lean_for_what_is_far_and_reaches_less_from_further_away() {
        let seated = map("seated", |_| ());
        let (still, all) = (seated.reachable_fraction(0.0), seated.reachable_fraction(f64::INFINITY));
        assert!(still < 0.5 && all > 0.95, "{}", seated.to_text_picture());
        // Whoever leans further does not reach less of it.
        assert!(
            seated.reachable_fraction(10.0) >= still
                && seated.reachable_fraction(20.0) >= seated.reachable_fraction(10.0)
        );
        let away = map("seated", |body| {
            for point in [&mut body.hip_m, &mut body.shoulder_m, &mut body.eye_m] {
                point.x -= 0.25;
            }
        });
        assert!(away.reachable_fraction(f64::INFINITY) < all - 0.2, "{}", away.to_text_picture());
        // The furthest row comes first, and is the hardest.
        let lean = |row: &[ReachPoint]| {
            row.iter().map(|cell_point| cell_point.lean_deg.unwrap_or(90.0)).sum::<f64>() / row.len() as f64
        };
        assert!(
            lean(&seated.rows[0]) > lean(&seated.rows[seated.rows.len() - 1]),
            "{}",
            seated.to_text_picture()
        );
        let picture = seated.to_text_picture();
        assert!(
            picture.contains("% of the box is reached without leaning") && picture.contains('#')
                || still == 0.0,
            "{picture}"
        );
    }

    #[test]
    fn from_the_still_shoulder_all_blocks_and_targets_are_within_reach_without_a_lean() {
        let still = map("still", |_| ());
        // The far corners of the box are not.
        assert!(
            (0.7..1.0).contains(&still.reachable_fraction(0.0))
                && still.reachable_fraction(90.0) == still.reachable_fraction(0.0),
            "{}",
            still.to_text_picture()
        );
        let config = TrialConfig::new("A", 1, Setup::named("still").unwrap());
        let trial = crate::trial::live_trial(config).unwrap().trial;
        let scene = trial.testbed().task().scene();
        let blocks = scene.objects.iter().map(|object| object.pose.translation.vector.xy());
        let targets = scene.targets.iter().map(|target| target.center.coords.xy());
        for goal in blocks.chain(targets) {
            let nearest = |point: &&ReachPoint| (point.x - goal.x).hypot(point.y - goal.y);
            let point = still.cells().min_by(|a, b| nearest(a).total_cmp(&nearest(b))).unwrap();
            assert!(point.lean_deg.is_some(), "{goal} is not reached:\n{}", still.to_text_picture());
        }
    }
}
