//! Where a goal can be entered: arm angles above it and the straight way from there to it.

use crate::approach_search::{
    AllowedContact, ApproachAction, ApproachSearch, GoalPosture, SearchDiagnostics,
};
use crate::axis_ik::{self, ArmJointLimits, IkGoal};
use crate::context::PlanningContext;
use crate::failure::PlanFailure;
use crate::grasp_yaw::{align_to_faces, needs_face_alignment};
use crate::problem::PlanProblem;
use crate::{PlannerOptions, PlanningError};
use proact_arm::{Grasp, upright_axis};
use proact_types::{AttachedObject, PlanGoal, PlanStatus, Point, Pose, Shape, Vector};

/// The last part of a plan: from where the search ends to the goal.
#[derive(Clone, Debug)]
pub(crate) struct ApproachPath {
    /// Arm angles; the first is where the search ends, the last is the goal.
    pub waypoints: Vec<Vec<f64>>,
    /// Lower is better.
    pub cost: f64,
    /// At its end the fingers touch something on their way open.
    pub opening_blocked: bool,
    /// What its end was sought for; none if it must stay where it is.
    pub approach_goal: Option<ApproachGoal>,
}

/// What a hand does at the end of a path.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ApproachGoal {
    pub ik_goal: IkGoal,
    /// None for a pose of the tip, which has no straight way into it.
    pub action: Option<ApproachAction>,
    /// The fingers must have room to open.
    pub needs_opening_clearance: bool,
}

/// Finds paths into a goal. Settings as in [`PlannerOptions`].
pub(crate) struct ApproachPlanner {
    ik_seeds: usize,
    max_goal_postures: usize,
    approach_height_m: f64,
    place_gap_m: f64,
    place_tilt_rad: f64,
    place_tolerance_m: f64,
}

/// Step between the rolls and leans that are tried, rad.
const TILT_STEP_RAD: f64 = 0.175;
/// Batches of postures after which a goal that no posture led to counts as out of reach.
const MAX_UNREACHED_BATCHES: usize = 4;
/// Batches of postures in which a place is sought where the hand can open, if the first places leave no room.
const MAX_BLOCKED_BATCHES: usize = 4;
/// Heights above its place from which something may be dropped, tried one after the other, metres. The last is above a
/// partition of 15 cm.
const DROP_HEIGHTS_M: [f64; 5] = [0.0, 0.05, 0.10, 0.15, 0.20];
/// Two arm postures closer than this in every joint are the same, rad.
const SAME_POSTURE_RAD: f64 = 0.08;

impl ApproachPlanner {
    pub fn new(options: &PlannerOptions) -> Self {
        Self {
            ik_seeds: options.ik_seeds,
            max_goal_postures: options.max_goal_postures,
            approach_height_m: options.approach_height_m,
            place_gap_m: options.place_gap_m,
            place_tilt_rad: options.place_tilt_rad,
            place_tolerance_m: options.place_tolerance_m,
        }
    }

    /// Approach paths to the goal, best first: from a few postures at a time, until some lead to one, and to a place until one
    /// leaves the hand room to open.
    pub fn find(
        &self,
        context: &mut PlanningContext,
        problem: &PlanProblem,
        from: &[f64],
    ) -> Result<Vec<ApproachPath>, PlanFailure> {
        let batch = self.ik_seeds + 1;
        let all = context.ik_seeds(problem, from, batch, batch * context.attempt.seed_batches);
        let mut first = None;
        let mut reached = false;
        let mut cramped = Vec::new();
        for (number, postures) in all.chunks(batch).enumerate() {
            if !cramped.is_empty() && number >= MAX_BLOCKED_BATCHES {
                break;
            }
            let search = ApproachSearch {
                context: &mut *context,
                problem,
                start: from,
                ik_seeds: postures,
                approach_height_m: self.approach_height_m,
                diagnostics: SearchDiagnostics::default(),
            };
            match self.paths_for_goal(search) {
                // The arm may reach from other postures, or with an elbow that is out of the way.
                Err(failure)
                    if matches!(failure.status, PlanStatus::GoalInCollision | PlanStatus::Unreachable) =>
                {
                    reached |= failure.status == PlanStatus::GoalInCollision;
                    first = first.or(Some(failure));
                }
                Ok(paths) if paths.iter().all(|path| path.opening_blocked) => cramped.extend(paths),
                Ok(mut paths) => {
                    // Should the search not get to those with room.
                    paths.append(&mut cramped);
                    return Ok(sort_by_cost(paths));
                }
                Err(failure) => return Err(failure),
            }
            if !reached && cramped.is_empty() && number + 1 >= MAX_UNREACHED_BATCHES {
                break;
            }
        }
        if !cramped.is_empty() {
            return Ok(sort_by_cost(cramped));
        }
        Err(first.unwrap_or_else(|| SearchDiagnostics::default().into_failure("goal")))
    }

    /// A way to what `approach_goal` asks that begins near the arm angles `corner`, unchecked; none if the arm cannot follow it.
    pub fn approach_near(
        &self,
        context: &PlanningContext,
        problem: &PlanProblem,
        approach_goal: &ApproachGoal,
        corner: &[f64],
    ) -> Option<Vec<Vec<f64>>> {
        let (chain, limits) = (&context.chain, &context.limits);
        if approach_goal.action.is_none() {
            return Some(vec![axis_ik::solve_ik(chain, limits, &approach_goal.ik_goal, corner)?]);
        }
        let rise = problem.up * self.approach_height_m;
        let above = IkGoal { target: approach_goal.ik_goal.target + rise, ..approach_goal.ik_goal };
        let top = axis_ik::solve_ik(chain, limits, &above, corner)?;
        let line = axis_ik::straight_line(chain, limits, &above, &-rise, &top);
        (line.len() > axis_ik::line_steps(rise.norm())).then_some(line)
    }

    /// The free way whose end is that of `line`; none if there is none.
    pub fn verified_approach(
        &self,
        context: &mut PlanningContext,
        problem: &PlanProblem,
        approach_goal: &ApproachGoal,
        line: &[Vec<f64>],
    ) -> Result<Option<Vec<Vec<f64>>>, PlanFailure> {
        let q = line[line.len() - 1].clone();
        let mut search = ApproachSearch {
            context,
            problem,
            start: &line[0],
            ik_seeds: &[],
            approach_height_m: self.approach_height_m,
            diagnostics: SearchDiagnostics::default(),
        };
        let Some(entry) = approach_goal.action else {
            return search.path_to_pose_near(&approach_goal.ik_goal, &q);
        };
        let end = GoalPosture { q, posture_id: 0, tilt_rad: 0.0 };
        if approach_goal.needs_opening_clearance
            && search.split_by_opening_clearance(vec![end.clone()])?.0.is_empty()
        {
            return Ok(None);
        }
        Ok(search.approach_path(&approach_goal.ik_goal, &end, entry)?.map(|path| path.waypoints))
    }

    fn paths_for_goal(&self, mut search: ApproachSearch) -> Result<Vec<ApproachPath>, PlanFailure> {
        match &search.problem.request.goal {
            PlanGoal::Pick { center, .. } => self.paths_to_pick(&mut search, center),
            PlanGoal::Place { point } => self.paths_to_place(&mut search, point),
            PlanGoal::Joints { q } => search.paths_to_joints(q),
            PlanGoal::TipPose { pose } => search.paths_to_pose(pose),
        }
    }

    fn paths_to_pick(
        &self,
        search: &mut ApproachSearch,
        center: &Point,
    ) -> Result<Vec<ApproachPath>, PlanFailure> {
        let problem = search.problem;
        let target = problem.base_from_world * center;
        let point = Point::from(problem.grasp.center);
        // A hand that clears the block on its way down is best; one whose fingers push it a little will do, and in a heap
        // one that pushes others aside.
        let (mut clear, mut pushing, mut digging) = (Vec::new(), Vec::new(), Vec::new());
        let touches = if problem.loose_obstacles.is_empty() { 2 } else { 3 };
        for (axis, off) in grasp_axes(&problem.grasp) {
            let reach = IkGoal {
                point,
                axis,
                target,
                direction: problem.up,
                orientation: None,
                tolerance: search.context.goal_tolerance,
            };
            let mut turned = Vec::new();
            for (number, end) in search.ik_solutions(&reach, &clear)?.iter().enumerate() {
                for (q, more) in align_to_faces(search.context, problem, &reach, end) {
                    turned.push(GoalPosture { q, posture_id: number, tilt_rad: off + more });
                }
            }
            // What hits something although it may touch the block need not be looked at any closer.
            if problem.loose_obstacles.is_empty() {
                turned = search.collision_free(turned, ApproachAction::Pick(AllowedContact::PickedObject))?;
            }
            let mut found = None;
            for end in turned {
                // One turn of each.
                if found == Some(end.posture_id) {
                    continue;
                }
                let variants = [
                    (&mut clear, AllowedContact::Nothing),
                    (&mut pushing, AllowedContact::PickedObject),
                    (&mut digging, AllowedContact::LooseObjects),
                ];
                for (paths, touch) in variants.into_iter().take(touches) {
                    if let Some(path) = search.approach_path(&reach, &end, ApproachAction::Pick(touch))? {
                        let approach_goal = path.approach_goal.filter(|_| !needs_face_alignment(problem));
                        paths.push(ApproachPath { approach_goal, ..path });
                        found = Some(end.posture_id);
                        break;
                    }
                }
            }
            if clear.len() >= self.max_goal_postures {
                break;
            }
        }
        match [clear, pushing, digging].into_iter().find(|paths| !paths.is_empty()) {
            Some(paths) => Ok(sort_by_cost(paths)),
            None => Err(search.failure("block")),
        }
    }

    fn paths_to_place(
        &self,
        search: &mut ApproachSearch,
        point: &Point,
    ) -> Result<Vec<ApproachPath>, PlanFailure> {
        let problem = search.problem;
        let Some(object) = &problem.request.attached else {
            return Err(PlanFailure::new(PlanStatus::Invalid, "There is nothing in the hand to place."));
        };
        if object.loose {
            return self.paths_to_drop(search, point, object);
        }
        // A place that is out of reach by a few millimetres is met as nearly as the arm can.
        let base = problem.request.world_from_base.translation.vector;
        let homeward = Vector::new(base.x - point.x, base.y - point.y, 0.0);
        let homeward = homeward.try_normalize(1e-6).unwrap_or_else(Vector::zeros);
        let mut first = None;
        for share in [0.0, 0.5, 1.0] {
            let nearer = point + homeward * (share * self.place_tolerance_m);
            match self.paths_to_place_at(search, &nearer, object) {
                Err(failure) if failure.status == PlanStatus::Unreachable => first = first.or(Some(failure)),
                other => return other,
            }
        }
        Err(first.unwrap_or_else(|| SearchDiagnostics::default().into_failure("place")))
    }

    /// To where what may fall is let go of above `point`, as low as the arm gets there.
    fn paths_to_drop(
        &self,
        search: &mut ApproachSearch,
        point: &Point,
        object: &AttachedObject,
    ) -> Result<Vec<ApproachPath>, PlanFailure> {
        let mut first = None;
        for height in DROP_HEIGHTS_M {
            match self.paths_to_place_at(search, &(point + Vector::z() * height), object) {
                Err(failure)
                    if matches!(failure.status, PlanStatus::Unreachable | PlanStatus::GoalInCollision) =>
                {
                    first = first.or(Some(failure));
                }
                other => return other,
            }
        }
        Err(first.unwrap_or_else(|| SearchDiagnostics::default().into_failure("place")))
    }

    fn paths_to_place_at(
        &self,
        search: &mut ApproachSearch,
        point: &Point,
        object: &AttachedObject,
    ) -> Result<Vec<ApproachPath>, PlanFailure> {
        let problem = search.problem;
        let mut paths = Vec::new();
        let mut cramped = Vec::new();
        let base_from_tip = search.context.kinematics.forward(&problem.start).map_err(PlanningError::from)?;
        for (axis, off) in place_axes(object, &base_from_tip, &problem.up, self.place_tilt_rad) {
            let height = half_height(&object.shape, off) + self.place_gap_m;
            let reach = IkGoal {
                point: Point::from(object.tip_from_object.translation.vector),
                axis,
                target: problem.base_from_world * (point + Vector::z() * height),
                direction: problem.up,
                orientation: None,
                tolerance: search.context.goal_tolerance,
            };
            let ends = search.ik_solutions(&reach, &paths)?.into_iter().enumerate();
            let ends = ends.map(|(number, q)| GoalPosture { q, posture_id: number, tilt_rad: off }).collect();
            let free = search.collision_free(ends, ApproachAction::Place)?;
            let (clear, others) = search.split_by_opening_clearance(free)?;
            for end in clear {
                paths.extend(search.approach_path(&reach, &end, ApproachAction::Place)?);
            }
            cramped.extend(others.into_iter().map(|end| (reach, end)));
            if paths.len() >= self.max_goal_postures {
                break;
            }
        }
        // What is missing is made up where fingers touch something on their way open, near the start first.
        cramped.sort_by(|(_, a), (_, b)| {
            let of =
                |end: &GoalPosture| posture_cost(&search.context.limits, search.start, &end.q, end.tilt_rad);
            of(a).total_cmp(&of(b))
        });
        for (reach, end) in cramped {
            if paths.len() >= self.max_goal_postures {
                break;
            }
            let path = search.approach_path(&reach, &end, ApproachAction::Place)?;
            let drop_clearance = |path: &ApproachPath| {
                path.approach_goal
                    .map(|approach_goal| ApproachGoal { needs_opening_clearance: false, ..approach_goal })
            };
            paths.extend(path.map(|path| ApproachPath {
                opening_blocked: true,
                approach_goal: drop_clearance(&path),
                ..path
            }));
        }
        if paths.is_empty() { Err(search.failure("place")) } else { Ok(sort_by_cost(paths)) }
    }
}

/// Axes of the tip's frame that may point up in a grip from above, the preferred one first, each with its
/// angle to the preferred one: roll about the hand's x, lean about its y.
pub(crate) fn grasp_axes(grasp: &Grasp) -> Vec<(Vector, f64)> {
    let preferred = upright_axis(grasp.roll_rad, 0.0);
    let [low, high] = grasp.roll_range_rad;
    let mut axes = Vec::new();
    // A narrow range has its ends tried.
    let step = TILT_STEP_RAD.min((high - grasp.roll_rad).max(grasp.roll_rad - low));
    for k in -20..=20 {
        let roll = grasp.roll_rad + f64::from(k) * step;
        if roll < low || roll > high {
            continue;
        }
        for share in [0.0, 0.5, -0.5, 1.0, -1.0] {
            let a = upright_axis(roll, share * grasp.max_lean_rad);
            axes.push((a, a.angle(&preferred)));
        }
    }
    axes.sort_by(|a, b| a.1.total_cmp(&b.1));
    axes.dedup_by(|a, b| (a.0 - b.0).norm() < 1e-9);
    axes
}

/// Cost of a posture: the time that its slowest joint needs, the angle off the preferred hand orientation,
/// and closeness to a limit, in radians of joint travel.
pub(crate) fn posture_cost(limits: &ArmJointLimits, from: &[f64], to: &[f64], off: f64) -> f64 {
    let travel = from.iter().zip(to).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    travel + 1.5 * off + limits.limit_cost(to)
}

/// Axes of the tip's frame that may point up when the object is let go: its own axis, whichever end is up now,
/// then leans by up to `tilt` from it. Each with its angle off the axis.
fn place_axes(object: &AttachedObject, base_from_tip: &Pose, up: &Vector, tilt: f64) -> Vec<(Vector, f64)> {
    let own = object.tip_from_object.rotation * Vector::z();
    let own = if (base_from_tip.rotation * own).dot(up) < 0.0 { -own } else { own };
    let mut axes = vec![(own, 0.0)];
    let x = own.cross(&if own.x.abs() < 0.9 { Vector::x() } else { Vector::y() }).normalize();
    let y = own.cross(&x);
    for share in [0.5, 1.0] {
        let off = share * tilt;
        for side in [x, -x, y, -y] {
            axes.push((own * off.cos() + side * off.sin(), off));
        }
    }
    if tilt == 0.0 {
        axes.truncate(1);
    }
    axes
}

/// Half the vertical extent of a shape whose axis leans by `off` from the vertical, metres.
fn half_height(shape: &Shape, off: f64) -> f64 {
    match *shape {
        Shape::Box { size } => 0.5 * (size[2] * off.cos() + size[0].hypot(size[1]) * off.sin()),
        Shape::Sphere { radius } => radius,
        Shape::Cylinder { radius, length } => 0.5 * length * off.cos() + radius * off.sin(),
        Shape::Capsule { radius, length } => 0.5 * length * off.cos() + radius,
    }
}

/// True for two arm postures that are the same.
pub(crate) fn is_same_posture(a: &[f64], b: &[f64]) -> bool {
    a.iter().zip(b).all(|(x, y)| (x - y).abs() < SAME_POSTURE_RAD)
}

/// Best first: those that leave the hand room, each kind by its cost.
pub(crate) fn sort_by_cost(mut paths: Vec<ApproachPath>) -> Vec<ApproachPath> {
    paths.sort_by(|a, b| a.opening_blocked.cmp(&b.opening_blocked).then(a.cost.total_cmp(&b.cost)));
    paths
}
