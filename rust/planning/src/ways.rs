//! Where a goal can be entered: arm angles above it and the straight way from there to it.

use crate::arm_planner::{ArmPlanner, Failure, Problem, Room};
use crate::reach::{self, Reach};
use proact_control::ports::IkOutcome;
use proact_types::{AttachedObject, BlockId, PlanGoal, PlanStatus, Point, Pose, Shape, Vector};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// The last part of a plan: from where the search ends to the goal.
#[derive(Clone, Debug)]
pub(crate) struct Way {
    /// Arm angles; the first is where the search ends, the last is the goal.
    pub points: Vec<Vec<f64>>,
    /// Lower is better.
    pub cost: f64,
}

/// What was found on the way to a list of ways, for the reason given when there is none.
#[derive(Default)]
struct Tally {
    reached: usize,
    hit: Option<(String, String)>,
}

/// Step between the rolls and leans that are tried, rad.
const TILT_STEP: f64 = 0.175;
/// Batches of postures after which a goal that no posture led to counts as out of reach.
const TRIES_OUT_OF_REACH: usize = 3;
/// Cost of a place at which the hand cannot open fully, rad.
const CRAMPED: f64 = 1.0;
/// Two arm postures closer than this in every joint are the same, rad.
const SAME: f64 = 0.08;

impl ArmPlanner {
    /// Ways to the goal, best first: from a few postures at a time, until some lead to one.
    pub(crate) fn ways_to_goal(&mut self, problem: &Problem, from: &[f64]) -> Result<Vec<Way>, Failure> {
        let batch = self.options.postures + 1;
        let all = self.postures(problem, from, batch * self.attempt.batches);
        let mut first = None;
        let mut reached = false;
        for (number, postures) in all.chunks(batch).enumerate() {
            match self.ways_from(problem, from, postures) {
                // The arm may reach from other postures, or with an elbow that is out of the way.
                Err(failure)
                    if matches!(failure.status, PlanStatus::GoalInCollision | PlanStatus::Unreachable) =>
                {
                    reached |= failure.status == PlanStatus::GoalInCollision;
                    first = first.or(Some(failure));
                }
                other => return other,
            }
            if !reached && number + 1 >= TRIES_OUT_OF_REACH {
                break;
            }
        }
        Err(first.unwrap_or_else(|| Tally::default().failure("goal")))
    }

    fn ways_from(
        &mut self,
        problem: &Problem,
        from: &[f64],
        postures: &[Vec<f64>],
    ) -> Result<Vec<Way>, Failure> {
        match &problem.request.goal {
            PlanGoal::Pick { block, centre } => self.ways_to_pick(problem, *block, centre, from, postures),
            PlanGoal::Place { point } => self.ways_to_place(problem, point, from, postures),
            PlanGoal::Joints { q } => self.ways_to_joints(q),
            PlanGoal::TipPose { pose } => self.ways_to_pose(problem, pose, from, postures),
        }
    }

    /// Arm postures from which hand poses are sought: the present one, then draws from the joint ranges.
    pub(crate) fn postures(&self, problem: &Problem, from: &[f64], count: usize) -> Vec<Vec<f64>> {
        let mut random = ChaCha8Rng::seed_from_u64(problem.request.seed);
        let mut unit = || (random.next_u64() >> 11) as f64 / (1_u64 << 53) as f64;
        let mut postures = vec![from.to_vec()];
        while postures.len() < count {
            let draw = |(low, high): (&f64, &f64)| low + (high - low) * unit();
            postures.push(self.limits.lower.iter().zip(&self.limits.upper).map(draw).collect());
        }
        postures
    }

    fn ways_to_pick(
        &mut self,
        problem: &Problem,
        block: BlockId,
        centre: &Point,
        from: &[f64],
        postures: &[Vec<f64>],
    ) -> Result<Vec<Way>, Failure> {
        let target = problem.base_from_world * centre;
        let point = Point::from(self.model.grasp_centre);
        let mut tally = Tally::default();
        // A hand that clears the block on its way down is best; one whose fingers push it a little will do.
        let (mut clear, mut pushing) = (Vec::new(), Vec::new());
        for (axis, off) in self.grasp_axes() {
            let reach = Reach { point, axis, target, direction: problem.up, orientation: None };
            for end in self.ends(&reach, postures, &clear, &mut tally)? {
                for (ways, fingers_may_touch) in [(&mut clear, false), (&mut pushing, true)] {
                    let entry = Entry::Pick { block, fingers_may_touch };
                    if self.add_way(problem, &reach, off, from, &end, entry, ways, &mut tally)? {
                        break;
                    }
                }
            }
            if clear.len() >= self.options.goals {
                break;
            }
        }
        let ways = if clear.is_empty() { pushing } else { clear };
        if !ways.is_empty() {
            return Ok(sorted(ways));
        }
        Err(tally.failure("block"))
    }

    fn ways_to_place(
        &mut self,
        problem: &Problem,
        point: &Point,
        from: &[f64],
        postures: &[Vec<f64>],
    ) -> Result<Vec<Way>, Failure> {
        let Some(object) = &problem.request.attached else {
            return Err(Failure::new(PlanStatus::Invalid, "There is nothing in the hand to place."));
        };
        // A place that is out of reach by a few millimetres is met as nearly as the arm can.
        let base = problem.request.world_from_base.translation.vector;
        let homeward = Vector::new(base.x - point.x, base.y - point.y, 0.0);
        let homeward = homeward.try_normalize(1e-6).unwrap_or_else(Vector::zeros);
        let mut first = None;
        for share in [0.0, 0.5, 1.0] {
            let nearer = point + homeward * (share * self.options.place_tolerance);
            match self.ways_to_place_at(problem, &nearer, object, from, postures) {
                Err(failure) if failure.status == PlanStatus::Unreachable => first = first.or(Some(failure)),
                other => return other,
            }
        }
        Err(first.unwrap_or_else(|| Tally::default().failure("place")))
    }

    fn ways_to_place_at(
        &mut self,
        problem: &Problem,
        point: &Point,
        object: &AttachedObject,
        from: &[f64],
        postures: &[Vec<f64>],
    ) -> Result<Vec<Way>, Failure> {
        let mut tally = Tally::default();
        let mut ways = Vec::new();
        let base_from_tip = self.kinematics.forward(&problem.start).map_err(crate::PlanningError::from)?;
        for (axis, off) in place_axes(object, &base_from_tip, &problem.up, self.options.place_tilt) {
            let height = half_height(&object.shape, off) + self.options.place_gap;
            let reach = Reach {
                point: Point::from(object.tip_from_object.translation.vector),
                axis,
                target: problem.base_from_world * (point + Vector::z() * height),
                direction: problem.up,
                orientation: None,
            };
            for end in self.ends(&reach, postures, &ways, &mut tally)? {
                self.add_way(problem, &reach, off, from, &end, Entry::Place, &mut ways, &mut tally)?;
            }
            if ways.len() >= self.options.goals {
                break;
            }
        }
        if ways.is_empty() { Err(tally.failure("place")) } else { Ok(sorted(ways)) }
    }

    fn ways_to_joints(&mut self, q: &[f64]) -> Result<Vec<Way>, Failure> {
        if !self.limits.contain(q, 1e-9) {
            return Err(Failure::new(PlanStatus::Invalid, "The goal is outside the joint limits."));
        }
        let goal = self.limits.clamp(q);
        self.set_room(Room::Transit)?;
        match self.scene.collisions(&goal)?.first() {
            Some((a, b)) => Err(Failure::new(
                PlanStatus::GoalInCollision,
                format!("The arm would touch something at the goal: {a} and {b}."),
            )),
            None => Ok(vec![Way { points: vec![goal], cost: 0.0 }]),
        }
    }

    fn ways_to_pose(
        &mut self,
        problem: &Problem,
        pose: &Pose,
        from: &[f64],
        postures: &[Vec<f64>],
    ) -> Result<Vec<Way>, Failure> {
        let base_from_tip = problem.base_from_world * pose;
        let mut tally = Tally::default();
        let mut ways: Vec<Way> = Vec::new();
        self.set_room(Room::Transit)?;
        let reach = Reach {
            point: Point::origin(),
            axis: Vector::z(),
            target: Point::from(base_from_tip.translation.vector),
            direction: Vector::z(),
            orientation: Some(base_from_tip.rotation.to_rotation_matrix().into_inner()),
        };
        for (index, posture) in postures.iter().enumerate() {
            self.go_on()?;
            // From the first posture KDL tries others too; that is as far as a pose out of reach is worth.
            let seed = match reach::solve(&mut self.chain, &self.limits, &reach, posture) {
                Some(near) => near,
                None if index == 0 => posture.clone(),
                None => continue,
            };
            let outcome =
                self.kinematics.inverse(&base_from_tip, &seed).map_err(crate::PlanningError::from)?;
            let IkOutcome::Solved(q) = outcome else { continue };
            tally.reached += 1;
            let q = q.to_vec();
            if !self.limits.contain(&q, 1e-9) || ways.iter().any(|w| same(&w.points[0], &q)) {
                continue;
            }
            match self.scene.collisions(&q)?.into_iter().next() {
                Some(pair) => tally.hit = Some(pair),
                None => {
                    let cost = self.cost(from, &q, 0.0);
                    ways.push(Way { points: vec![q], cost });
                }
            }
        }
        if ways.is_empty() { Err(tally.failure("pose")) } else { Ok(sorted(ways)) }
    }

    /// Arm angles that do what `reach` asks, found from `postures`, but for those that `ways` end at.
    fn ends(
        &mut self,
        reach: &Reach,
        postures: &[Vec<f64>],
        ways: &[Way],
        tally: &mut Tally,
    ) -> Result<Vec<Vec<f64>>, Failure> {
        let mut ends: Vec<Vec<f64>> = Vec::new();
        for posture in postures {
            self.go_on()?;
            let Some(end) = reach::solve(&mut self.chain, &self.limits, reach, posture) else { continue };
            tally.reached += 1;
            let known = |w: &Way| same(&w.points[w.points.len() - 1], &end);
            if !ways.iter().any(known) && !ends.iter().any(|e| same(e, &end)) {
                ends.push(end);
            }
        }
        Ok(ends)
    }

    /// Adds the straight way into `end` to `ways` if it is free. `off` is the angle to the preferred hand
    /// orientation, rad; `from` are the arm angles from which the goal is sought.
    #[allow(clippy::too_many_arguments)]
    fn add_way(
        &mut self,
        problem: &Problem,
        reach: &Reach,
        off: f64,
        from: &[f64],
        end: &[f64],
        entry: Entry,
        ways: &mut Vec<Way>,
        tally: &mut Tally,
    ) -> Result<bool, Failure> {
        self.go_on()?;
        match self.way_down(problem, reach, end, &entry, tally.hit.is_none())? {
            Ok(points) => {
                let cramped =
                    matches!(entry, Entry::Place) && !self.hand_is_free_after(problem, &entry, end)?;
                let cost = self.cost(from, &points[0], off) + if cramped { CRAMPED } else { 0.0 };
                ways.push(Way { points, cost });
                Ok(true)
            }
            Err(hit) => {
                tally.hit = tally.hit.take().or(hit);
                Ok(false)
            }
        }
    }

    /// The straight way down to `end`, from its top to `end`, if it is free; otherwise what it hits, if that is asked for:
    /// to name it takes longer than to see that there is something.
    #[allow(clippy::type_complexity)]
    fn way_down(
        &mut self,
        problem: &Problem,
        reach: &Reach,
        end: &[f64],
        entry: &Entry,
        name_it: bool,
    ) -> Result<Result<Vec<Vec<f64>>, Option<(String, String)>>, Failure> {
        self.set_room(Room::Contact)?;
        self.allow_entry(problem, entry)?;
        if !self.scene.is_free(end)? {
            return Ok(Err(self.hit_at(end, name_it)?));
        }
        let rise = problem.up * self.options.approach_height;
        let line = reach::line(&mut self.chain, &self.limits, reach, &rise, end);
        if line.len() <= reach::line_steps(rise.norm()) {
            return Ok(Err(None));
        }
        let search = self.limits_of_contact();
        for pair in line.windows(2) {
            if !self.scene.motion_is_free(&pair[0], &pair[1], &search)? {
                return Ok(Err(self.hit_at(&pair[1], name_it)?));
            }
        }
        if matches!(entry, Entry::Pick { .. }) && !self.hand_is_free_after(problem, entry, end)? {
            return Ok(Err(None));
        }
        self.set_room(Room::Transit)?;
        let top = &line[line.len() - 1];
        if !self.scene.is_free(top)? {
            return Ok(Err(self.hit_at(top, name_it)?));
        }
        Ok(Ok(line.into_iter().rev().collect()))
    }

    fn hit_at(&mut self, q: &[f64], name_it: bool) -> Result<Option<(String, String)>, Failure> {
        Ok(if name_it { self.scene.collisions(q)?.into_iter().next() } else { None })
    }

    /// Contacts that are part of the purpose: at the end of a pick the fingers may touch the block.
    fn allow_entry(&mut self, problem: &Problem, entry: &Entry) -> Result<(), Failure> {
        if let Entry::Pick { block, fingers_may_touch: true } = entry {
            let model = self.model.clone();
            if problem.request.obstacles.iter().any(|o| o.name == block.name()) {
                for (k, link) in model.links.iter().enumerate() {
                    if k != model.tip {
                        self.scene.allow_contact(&link.name, block.name())?;
                    }
                }
            }
        }
        Ok(())
    }

    /// True if nothing is touched at `end` once the hand has closed around the block, or opened to let go of it.
    fn hand_is_free_after(&mut self, problem: &Problem, entry: &Entry, end: &[f64]) -> Result<bool, Failure> {
        let model = self.model.clone();
        let pose = if matches!(entry, Entry::Pick { .. }) { "closed" } else { "open" };
        let Ok(fingers) = model.pose("hand", pose) else { return Ok(true) };
        self.set_room(Room::Contact)?;
        if let Entry::Pick { block, .. } = entry
            && problem.request.obstacles.iter().any(|o| o.name == block.name())
        {
            self.allow_hand(block.name(), problem)?;
        }
        self.scene.set_hand(fingers)?;
        let free = self.scene.is_free(end)?;
        self.scene.set_hand(&problem.request.hand)?;
        Ok(free)
    }

    /// Axes of the tip's frame that may point up in a grip from above, the preferred one first, each with its
    /// angle to the preferred one: roll about the hand's x, lean about its y.
    pub(crate) fn grasp_axes(&self) -> Vec<(Vector, f64)> {
        let axis =
            |tilt: f64, lean: f64| Vector::new(-lean.sin(), lean.cos() * tilt.sin(), lean.cos() * tilt.cos());
        let preferred = axis(self.options.tilt, 0.0);
        let [low, high] = self.options.tilt_range;
        let mut axes = Vec::new();
        for k in -20..=20 {
            let tilt = self.options.tilt + f64::from(k) * TILT_STEP;
            if tilt < low || tilt > high {
                continue;
            }
            for share in [0.0, 0.5, -0.5, 1.0, -1.0] {
                let a = axis(tilt, share * self.options.lateral);
                axes.push((a, a.angle(&preferred)));
            }
        }
        axes.sort_by(|a, b| a.1.total_cmp(&b.1));
        axes.dedup_by(|a, b| (a.0 - b.0).norm() < 1e-9);
        axes
    }

    /// Cost of a posture: the time that its slowest joint needs, the angle off the preferred hand orientation,
    /// and closeness to a limit, in radians of joint travel.
    pub(crate) fn cost(&self, from: &[f64], to: &[f64], off: f64) -> f64 {
        let travel = from.iter().zip(to).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        let squeeze = (0.05 - self.limits.margin(to)).max(0.0) / 0.05;
        travel + 1.5 * off + 0.5 * squeeze
    }
}

/// What is done at the end of a way.
#[derive(Clone, Copy, Debug)]
enum Entry {
    Pick { block: BlockId, fingers_may_touch: bool },
    Place,
}

impl Tally {
    fn failure(self, what: &str) -> Failure {
        if self.reached == 0 {
            return Failure::new(PlanStatus::Unreachable, format!("The {what} is out of the hand's reach."));
        }
        match self.hit {
            Some((a, b)) => Failure::new(
                PlanStatus::GoalInCollision,
                format!("At the {what} the hand would touch something: {a} and {b}."),
            ),
            None => Failure::new(
                PlanStatus::Unreachable,
                format!("The {what} cannot be approached from above: the arm is at its limits."),
            ),
        }
    }
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

pub(crate) fn same(a: &[f64], b: &[f64]) -> bool {
    a.iter().zip(b).all(|(x, y)| (x - y).abs() < SAME)
}

pub(crate) fn sorted(mut ways: Vec<Way>) -> Vec<Way> {
    ways.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    ways
}
