//! Where a goal can be entered: arm angles above it and the straight way from there to it.

use crate::context::PlanningContext;
use crate::facing::{faced, has_faces};
use crate::failure::Failure;
use crate::problem::Problem;
use crate::reach::{self, Limits, Reach};
use crate::seeking::{End, Entry, Seeking, Tally, Touch};
use crate::{PlannerOptions, PlanningError};
use proact_arm::{Grasp, upright_axis};
use proact_types::{AttachedObject, PlanGoal, PlanStatus, Point, Pose, Shape, Vector};

/// The last part of a plan: from where the search ends to the goal.
#[derive(Clone, Debug)]
pub(crate) struct ApproachPath {
    /// Arm angles; the first is where the search ends, the last is the goal.
    pub points: Vec<Vec<f64>>,
    /// Lower is better.
    pub cost: f64,
    /// At its end the fingers touch something on their way open.
    pub cramped: bool,
    /// What its end was sought for; none if it must stay where it is.
    pub aim: Option<Aim>,
}

/// What a hand does at the end of a path.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Aim {
    pub reach: Reach,
    /// None for a pose of the tip, which has no straight way into it.
    pub entry: Option<Entry>,
    /// The fingers must have room to open.
    pub roomy: bool,
}

/// Finds paths into a goal. Settings as in [`PlannerOptions`].
pub(crate) struct ApproachPaths {
    postures: usize,
    goals: usize,
    approach_height: f64,
    place_gap: f64,
    place_tilt: f64,
    place_tolerance: f64,
}

/// Step between the rolls and leans that are tried, rad.
const TILT_STEP: f64 = 0.175;
/// Batches of postures after which a goal that no posture led to counts as out of reach.
const TRIES_OUT_OF_REACH: usize = 4;
/// Batches of postures in which a place is sought where the hand can open, if the first places leave no room.
const TRIES_FOR_ROOM: usize = 4;
/// Heights above its place from which something may be dropped, tried one after the other, metres. The last is above a
/// partition of 15 cm.
const DROPS: [f64; 5] = [0.0, 0.05, 0.10, 0.15, 0.20];
/// Two arm postures closer than this in every joint are the same, rad.
const SAME: f64 = 0.08;

impl ApproachPaths {
    pub fn new(options: &PlannerOptions) -> Self {
        Self {
            postures: options.postures,
            goals: options.goals,
            approach_height: options.approach_height,
            place_gap: options.place_gap,
            place_tilt: options.place_tilt,
            place_tolerance: options.place_tolerance,
        }
    }

    /// Approach paths to the goal, best first: from a few postures at a time, until some lead to one, and to a place until one
    /// leaves the hand room to open.
    pub fn find(
        &self,
        context: &mut PlanningContext,
        problem: &Problem,
        from: &[f64],
    ) -> Result<Vec<ApproachPath>, Failure> {
        let batch = self.postures + 1;
        let all = context.postures(problem, from, batch, batch * context.attempt.batches);
        let mut first = None;
        let mut reached = false;
        let mut cramped = Vec::new();
        for (number, postures) in all.chunks(batch).enumerate() {
            if !cramped.is_empty() && number >= TRIES_FOR_ROOM {
                break;
            }
            let seeking = Seeking {
                context: &mut *context,
                problem,
                from,
                postures,
                approach_height: self.approach_height,
                tally: Tally::default(),
            };
            match self.paths_from(seeking) {
                // The arm may reach from other postures, or with an elbow that is out of the way.
                Err(failure)
                    if matches!(failure.status, PlanStatus::GoalInCollision | PlanStatus::Unreachable) =>
                {
                    reached |= failure.status == PlanStatus::GoalInCollision;
                    first = first.or(Some(failure));
                }
                Ok(paths) if paths.iter().all(|path| path.cramped) => cramped.extend(paths),
                Ok(mut paths) => {
                    // Should the search not get to those with room.
                    paths.append(&mut cramped);
                    return Ok(sorted(paths));
                }
                Err(failure) => return Err(failure),
            }
            if !reached && cramped.is_empty() && number + 1 >= TRIES_OUT_OF_REACH {
                break;
            }
        }
        if !cramped.is_empty() {
            return Ok(sorted(cramped));
        }
        Err(first.unwrap_or_else(|| Tally::default().failure("goal")))
    }

    /// A way to what `aim` asks that begins near the arm angles `corner`, unchecked; none if the arm cannot follow it.
    pub fn near(
        &self,
        context: &PlanningContext,
        problem: &Problem,
        aim: &Aim,
        corner: &[f64],
    ) -> Option<Vec<Vec<f64>>> {
        let (chain, limits) = (&context.chain, &context.limits);
        if aim.entry.is_none() {
            return Some(vec![reach::solve(chain, limits, &aim.reach, corner)?]);
        }
        let rise = problem.up * self.approach_height;
        let above = Reach { target: aim.reach.target + rise, ..aim.reach };
        let top = reach::solve(chain, limits, &above, corner)?;
        let way = reach::line(chain, limits, &above, &-rise, &top);
        (way.len() > reach::line_steps(rise.norm())).then_some(way)
    }

    /// The free way whose end is that of `way`; none if there is none.
    pub fn confirmed(
        &self,
        context: &mut PlanningContext,
        problem: &Problem,
        aim: &Aim,
        way: &[Vec<f64>],
    ) -> Result<Option<Vec<Vec<f64>>>, Failure> {
        let q = way[way.len() - 1].clone();
        let mut seeking = Seeking {
            context,
            problem,
            from: &way[0],
            postures: &[],
            approach_height: self.approach_height,
            tally: Tally::default(),
        };
        let Some(entry) = aim.entry else { return seeking.path_to_pose_near(&aim.reach, &q) };
        let end = End { q, number: 0, off: 0.0 };
        if aim.roomy && seeking.by_room(vec![end.clone()])?.0.is_empty() {
            return Ok(None);
        }
        Ok(seeking.path(&aim.reach, &end, entry)?.map(|path| path.points))
    }

    fn paths_from(&self, mut seeking: Seeking) -> Result<Vec<ApproachPath>, Failure> {
        match &seeking.problem.request.goal {
            PlanGoal::Pick { centre, .. } => self.paths_to_pick(&mut seeking, centre),
            PlanGoal::Place { point } => self.paths_to_place(&mut seeking, point),
            PlanGoal::Joints { q } => seeking.paths_to_joints(q),
            PlanGoal::TipPose { pose } => seeking.paths_to_pose(pose),
        }
    }

    fn paths_to_pick(&self, seeking: &mut Seeking, centre: &Point) -> Result<Vec<ApproachPath>, Failure> {
        let problem = seeking.problem;
        let target = problem.base_from_world * centre;
        let point = Point::from(problem.grasp.centre);
        // A hand that clears the block on its way down is best; one whose fingers push it a little will do, and in a heap
        // one that pushes others aside.
        let (mut clear, mut pushing, mut digging) = (Vec::new(), Vec::new(), Vec::new());
        let touches = if problem.loose.is_empty() { 2 } else { 3 };
        for (axis, off) in grasp_axes(&problem.grasp) {
            let reach = Reach {
                point,
                axis,
                target,
                direction: problem.up,
                orientation: None,
                slack: seeking.context.slack,
            };
            let mut turned = Vec::new();
            for (number, end) in seeking.ends(&reach, &clear)?.iter().enumerate() {
                for (q, more) in faced(seeking.context, problem, &reach, end) {
                    turned.push(End { q, number, off: off + more });
                }
            }
            // What hits something although it may touch the block need not be looked at any closer.
            if problem.loose.is_empty() {
                turned = seeking.free(turned, Entry::Pick(Touch::Picked))?;
            }
            let mut found = None;
            for end in turned {
                // One turn of each.
                if found == Some(end.number) {
                    continue;
                }
                let ways = [
                    (&mut clear, Touch::Nothing),
                    (&mut pushing, Touch::Picked),
                    (&mut digging, Touch::Loose),
                ];
                for (paths, touch) in ways.into_iter().take(touches) {
                    if let Some(path) = seeking.path(&reach, &end, Entry::Pick(touch))? {
                        let aim = path.aim.filter(|_| !has_faces(problem));
                        paths.push(ApproachPath { aim, ..path });
                        found = Some(end.number);
                        break;
                    }
                }
            }
            if clear.len() >= self.goals {
                break;
            }
        }
        match [clear, pushing, digging].into_iter().find(|paths| !paths.is_empty()) {
            Some(paths) => Ok(sorted(paths)),
            None => Err(seeking.failure("block")),
        }
    }

    fn paths_to_place(&self, seeking: &mut Seeking, point: &Point) -> Result<Vec<ApproachPath>, Failure> {
        let problem = seeking.problem;
        let Some(object) = &problem.request.attached else {
            return Err(Failure::new(PlanStatus::Invalid, "There is nothing in the hand to place."));
        };
        if object.loose {
            return self.paths_to_drop(seeking, point, object);
        }
        // A place that is out of reach by a few millimetres is met as nearly as the arm can.
        let base = problem.request.world_from_base.translation.vector;
        let homeward = Vector::new(base.x - point.x, base.y - point.y, 0.0);
        let homeward = homeward.try_normalize(1e-6).unwrap_or_else(Vector::zeros);
        let mut first = None;
        for share in [0.0, 0.5, 1.0] {
            let nearer = point + homeward * (share * self.place_tolerance);
            match self.paths_to_place_at(seeking, &nearer, object) {
                Err(failure) if failure.status == PlanStatus::Unreachable => first = first.or(Some(failure)),
                other => return other,
            }
        }
        Err(first.unwrap_or_else(|| Tally::default().failure("place")))
    }

    /// To where what may fall is let go of above `point`, as low as the arm gets there.
    fn paths_to_drop(
        &self,
        seeking: &mut Seeking,
        point: &Point,
        object: &AttachedObject,
    ) -> Result<Vec<ApproachPath>, Failure> {
        let mut first = None;
        for height in DROPS {
            match self.paths_to_place_at(seeking, &(point + Vector::z() * height), object) {
                Err(failure)
                    if matches!(failure.status, PlanStatus::Unreachable | PlanStatus::GoalInCollision) =>
                {
                    first = first.or(Some(failure));
                }
                other => return other,
            }
        }
        Err(first.unwrap_or_else(|| Tally::default().failure("place")))
    }

    fn paths_to_place_at(
        &self,
        seeking: &mut Seeking,
        point: &Point,
        object: &AttachedObject,
    ) -> Result<Vec<ApproachPath>, Failure> {
        let problem = seeking.problem;
        let mut paths = Vec::new();
        let mut cramped = Vec::new();
        let base_from_tip =
            seeking.context.kinematics.forward(&problem.start).map_err(PlanningError::from)?;
        for (axis, off) in place_axes(object, &base_from_tip, &problem.up, self.place_tilt) {
            let height = half_height(&object.shape, off) + self.place_gap;
            let reach = Reach {
                point: Point::from(object.tip_from_object.translation.vector),
                axis,
                target: problem.base_from_world * (point + Vector::z() * height),
                direction: problem.up,
                orientation: None,
                slack: seeking.context.slack,
            };
            let ends = seeking.ends(&reach, &paths)?.into_iter().enumerate();
            let ends = ends.map(|(number, q)| End { q, number, off }).collect();
            let free = seeking.free(ends, Entry::Place)?;
            let (roomy, others) = seeking.by_room(free)?;
            for end in roomy {
                paths.extend(seeking.path(&reach, &end, Entry::Place)?);
            }
            cramped.extend(others.into_iter().map(|end| (reach, end)));
            if paths.len() >= self.goals {
                break;
            }
        }
        // What is missing is made up where fingers touch something on their way open, near the start first.
        cramped.sort_by(|(_, a), (_, b)| {
            let of = |end: &End| cost(&seeking.context.limits, seeking.from, &end.q, end.off);
            of(a).total_cmp(&of(b))
        });
        for (reach, end) in cramped {
            if paths.len() >= self.goals {
                break;
            }
            let path = seeking.path(&reach, &end, Entry::Place)?;
            let aim = |path: &ApproachPath| path.aim.map(|aim| Aim { roomy: false, ..aim });
            paths.extend(path.map(|path| ApproachPath { cramped: true, aim: aim(&path), ..path }));
        }
        if paths.is_empty() { Err(seeking.failure("place")) } else { Ok(sorted(paths)) }
    }
}

/// Axes of the tip's frame that may point up in a grip from above, the preferred one first, each with its
/// angle to the preferred one: roll about the hand's x, lean about its y.
pub(crate) fn grasp_axes(grasp: &Grasp) -> Vec<(Vector, f64)> {
    let preferred = upright_axis(grasp.roll, 0.0);
    let [low, high] = grasp.roll_range;
    let mut axes = Vec::new();
    // A narrow range has its ends tried.
    let step = TILT_STEP.min((high - grasp.roll).max(grasp.roll - low));
    for k in -20..=20 {
        let roll = grasp.roll + f64::from(k) * step;
        if roll < low || roll > high {
            continue;
        }
        for share in [0.0, 0.5, -0.5, 1.0, -1.0] {
            let a = upright_axis(roll, share * grasp.lean);
            axes.push((a, a.angle(&preferred)));
        }
    }
    axes.sort_by(|a, b| a.1.total_cmp(&b.1));
    axes.dedup_by(|a, b| (a.0 - b.0).norm() < 1e-9);
    axes
}

/// Cost of a posture: the time that its slowest joint needs, the angle off the preferred hand orientation,
/// and closeness to a limit, in radians of joint travel.
pub(crate) fn cost(limits: &Limits, from: &[f64], to: &[f64], off: f64) -> f64 {
    let travel = from.iter().zip(to).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    travel + 1.5 * off + limits.squeeze(to)
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
pub(crate) fn same(a: &[f64], b: &[f64]) -> bool {
    a.iter().zip(b).all(|(x, y)| (x - y).abs() < SAME)
}

/// Best first: those that leave the hand room, each kind by its cost.
pub(crate) fn sorted(mut paths: Vec<ApproachPath>) -> Vec<ApproachPath> {
    paths.sort_by(|a, b| a.cramped.cmp(&b.cramped).then(a.cost.total_cmp(&b.cost)));
    paths
}
