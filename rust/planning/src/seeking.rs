//! The look for paths into a goal from some arm postures: arm angles that do what is asked, and straight paths to them.

use crate::PlanningError;
use crate::approach_paths::{Aim, ApproachPath, cost, same, sorted};
use crate::context::{Clearance, PlanningContext};
use crate::failure::Failure;
use crate::problem::Problem;
use crate::reach::{self, Reach};
use proact_control::ports::IkOutcome;
use proact_types::{PlanStatus, Point, Pose, Vector};

/// One look for paths into the goal of a request, and what it has met so far.
pub(crate) struct Seeking<'a> {
    pub context: &'a mut PlanningContext,
    pub problem: &'a Problem<'a>,
    /// Arm angles at which the search in joint space begins.
    pub from: &'a [f64],
    /// Arm angles near which those at the goal are sought.
    pub postures: &'a [Vec<f64>],
    /// Height of the straight way down, metres.
    pub approach_height: f64,
    pub tally: Tally,
}

/// What was found on the way to a list of paths, for the reason given when there is none.
#[derive(Default)]
pub(crate) struct Tally {
    reached: usize,
    hit: Option<(String, String)>,
}

/// What is done at the end of a way.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Entry {
    Pick(Touch),
    Place,
}

/// What the fingers may touch on the straight way into a grip.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Touch {
    Nothing,
    /// The object that is picked.
    Picked,
    /// That, and what may be pushed aside.
    Loose,
}

/// Arm angles that do what is asked.
#[derive(Clone, Debug)]
pub(crate) struct End {
    pub q: Vec<f64>,
    /// Ends that differ by the hand's turn about the vertical alone have the same number.
    pub number: usize,
    /// The angle to the preferred hand orientation, rad.
    pub off: f64,
}

/// Hands on the way from closed to open that are looked at.
const SWEEP: usize = 10;

impl Seeking<'_> {
    /// To arm angles, which are themselves the way.
    pub fn paths_to_joints(&mut self, q: &[f64]) -> Result<Vec<ApproachPath>, Failure> {
        if !self.context.limits.contain(q, 1e-9) {
            return Err(Failure::new(PlanStatus::Invalid, "The goal is outside the joint limits."));
        }
        let goal = self.context.limits.clamp(q);
        self.context.set_clearance(Clearance::Transit)?;
        match self.context.scene.collisions(&goal)?.first() {
            Some((a, b)) => Err(Failure::new(
                PlanStatus::GoalInCollision,
                format!("The arm would touch something at the goal: {a} and {b}."),
            )),
            None => Ok(vec![ApproachPath { points: vec![goal], cost: 0.0, cramped: false, aim: None }]),
        }
    }

    /// To a pose of the tip in the world, without a straight way into it.
    pub fn paths_to_pose(&mut self, pose: &Pose) -> Result<Vec<ApproachPath>, Failure> {
        let base_from_tip = self.problem.base_from_world * pose;
        let mut paths: Vec<ApproachPath> = Vec::new();
        self.context.set_clearance(Clearance::Transit)?;
        let reach = Reach {
            point: Point::origin(),
            axis: Vector::z(),
            target: Point::from(base_from_tip.translation.vector),
            direction: Vector::z(),
            orientation: Some(base_from_tip.rotation),
            slack: None,
        };
        for (index, posture) in self.postures.iter().enumerate() {
            self.context.go_on()?;
            // From the first posture KDL tries others too; that is as far as a pose out of reach is worth.
            let seed = match reach::solve(&self.context.chain, &self.context.limits, &reach, posture) {
                Some(near) => near,
                None if index == 0 => posture.clone(),
                None => continue,
            };
            let outcome =
                self.context.kinematics.inverse(&base_from_tip, &seed).map_err(PlanningError::from)?;
            let IkOutcome::Solved(q) = outcome else { continue };
            self.tally.reached += 1;
            let q = q.to_vec();
            if !self.context.limits.contain(&q, 1e-9) || paths.iter().any(|w| same(&w.points[0], &q)) {
                continue;
            }
            match self.context.scene.collisions(&q)?.into_iter().next() {
                Some(pair) => self.tally.hit = Some(pair),
                None => {
                    let cost = cost(&self.context.limits, self.from, &q, 0.0);
                    let aim = Some(Aim { reach, entry: None, roomy: false });
                    paths.push(ApproachPath { points: vec![q], cost, cramped: false, aim });
                }
            }
        }
        if paths.is_empty() { Err(self.failure("pose")) } else { Ok(sorted(paths)) }
    }

    /// The arm angles at the pose that `reach` asks for which the kinematics library finds from `q`, if they are free.
    pub fn path_to_pose_near(&mut self, reach: &Reach, q: &[f64]) -> Result<Option<Vec<Vec<f64>>>, Failure> {
        let Some(rotation) = reach.orientation else { return Ok(None) };
        let pose = Pose::from_parts(reach.target.into(), rotation);
        let outcome = self.context.kinematics.inverse(&pose, q).map_err(PlanningError::from)?;
        let IkOutcome::Solved(q) = outcome else { return Ok(None) };
        self.context.set_clearance(Clearance::Transit)?;
        let free = self.context.limits.contain(&q, 1e-9) && self.context.scene.is_free(&q)?;
        Ok(free.then(|| vec![q.to_vec()]))
    }

    /// Arm angles that do what `reach` asks, found from the postures, but for those that `paths` end at.
    pub fn ends(&mut self, reach: &Reach, paths: &[ApproachPath]) -> Result<Vec<Vec<f64>>, Failure> {
        let mut ends: Vec<Vec<f64>> = Vec::new();
        for posture in self.postures {
            self.context.go_on()?;
            let Some(end) = reach::solve(&self.context.chain, &self.context.limits, reach, posture) else {
                continue;
            };
            self.tally.reached += 1;
            let known = |w: &ApproachPath| same(&w.points[w.points.len() - 1], &end);
            if !paths.iter().any(known) && !ends.iter().any(|e| same(e, &end)) {
                ends.push(end);
            }
        }
        Ok(ends)
    }

    /// Those of `ends` where nothing is touched but what `entry` may touch.
    pub fn free(&mut self, ends: Vec<End>, entry: Entry) -> Result<Vec<End>, Failure> {
        self.context.go_on()?;
        self.context.set_clearance(Clearance::Contact)?;
        self.allow_entry(&entry)?;
        let mut free = Vec::with_capacity(ends.len());
        for end in ends {
            if self.context.scene.is_free(&end.q)? {
                free.push(end);
            } else if self.tally.hit.is_none() {
                self.tally.hit = self.context.scene.collisions(&end.q)?.into_iter().next();
            }
        }
        Ok(free)
    }

    /// `ends` of a place parted into those where no finger touches anything on its way open, and the others.
    pub fn by_room(&mut self, ends: Vec<End>) -> Result<(Vec<End>, Vec<End>), Failure> {
        let model = self.context.model.clone();
        let open = model.pose("hand", &self.problem.grasp.open_pose);
        let (Ok(open), false) = (open, ends.is_empty()) else { return Ok((ends, Vec::new())) };
        let request = self.problem.request;
        self.context.go_on()?;
        self.context.set_clearance(Clearance::Contact)?;
        self.context.scene.set_attached(None)?;
        let parted = self.swept(open, ends);
        // As it was, whatever came of it.
        self.context.scene.set_hand(&request.hand)?;
        self.context.scene.set_attached(request.attached.as_ref())?;
        parted
    }

    /// `ends` parted by whether none of the hands from the present one to `fingers` touches anything there.
    fn swept(&mut self, fingers: &[f64], ends: Vec<End>) -> Result<(Vec<End>, Vec<End>), Failure> {
        let (mut roomy, mut cramped) = (ends, Vec::new());
        // The last one takes the most room.
        for step in (1..=SWEEP).rev() {
            if roomy.is_empty() {
                break;
            }
            let share = step as f64 / SWEEP as f64;
            let hand = self.problem.request.hand.iter().zip(fingers);
            let hand: Vec<f64> = hand.map(|(from, to)| from + share * (to - from)).collect();
            self.context.scene.set_hand(&hand)?;
            for end in std::mem::take(&mut roomy) {
                let free = self.context.scene.is_free(&end.q)?;
                if free { &mut roomy } else { &mut cramped }.push(end);
            }
        }
        Ok((roomy, cramped))
    }

    /// The straight way into `end`, if it is free.
    pub fn path(&mut self, reach: &Reach, end: &End, entry: Entry) -> Result<Option<ApproachPath>, Failure> {
        self.context.go_on()?;
        match self.path_down(reach, &end.q, &entry, self.tally.hit.is_none())? {
            Ok(points) => {
                let cost = cost(&self.context.limits, self.from, &points[0], end.off);
                // Part of an arm does not do all that is asked.
                let whole = self.context.slack.is_none();
                let roomy = matches!(entry, Entry::Place);
                let aim = whole.then_some(Aim { reach: *reach, entry: Some(entry), roomy });
                Ok(Some(ApproachPath { points, cost, cramped: false, aim }))
            }
            Err(hit) => {
                self.tally.hit = self.tally.hit.take().or(hit);
                Ok(None)
            }
        }
    }

    /// The straight way down to `end`, from its top to `end`, if it is free; otherwise what it hits, if that is asked for:
    /// to name it takes longer than to see that there is something.
    #[allow(clippy::type_complexity)]
    fn path_down(
        &mut self,
        reach: &Reach,
        end: &[f64],
        entry: &Entry,
        name_it: bool,
    ) -> Result<Result<Vec<Vec<f64>>, Option<(String, String)>>, Failure> {
        self.context.set_clearance(Clearance::Contact)?;
        self.allow_entry(entry)?;
        if matches!(entry, Entry::Pick(Touch::Loose)) {
            // To allow all that is near takes longer than to see that something else is touched.
            let touching = self.context.scene.collisions(end)?;
            if let Some(pair) = touching.into_iter().find(|pair| !self.is_pushing(pair)) {
                return Ok(Err(Some(pair)));
            }
            self.allow_pushing()?;
        } else if !self.context.scene.is_free(end)? {
            return Ok(Err(self.hit_at(end, name_it)?));
        }
        // Part of an arm cannot go far straight down.
        let shares: &[f64] = if self.context.slack.is_some() { &[1.0, 0.5, 0.25] } else { &[1.0] };
        let lines = shares.iter().find_map(|share| {
            let rise = self.problem.up * (share * self.approach_height);
            let line = reach::line(&self.context.chain, &self.context.limits, reach, &rise, end);
            (line.len() > reach::line_steps(rise.norm())).then_some(line)
        });
        let Some(line) = lines else { return Ok(Err(None)) };
        let search = self.context.limits_of_contact();
        if !self.context.scene.path_is_free(line.iter().map(Vec::as_slice), &search)? {
            return Ok(Err(self.first_hit(&line, name_it)?));
        }
        if let Entry::Pick(touch) = entry
            && !self.grip_is_free(*touch, end)?
        {
            return Ok(Err(None));
        }
        self.context.set_clearance(Clearance::Transit)?;
        let top = &line[line.len() - 1];
        if !self.context.scene.is_free(top)? {
            return Ok(Err(self.hit_at(top, name_it)?));
        }
        Ok(Ok(line.into_iter().rev().collect()))
    }

    /// The first pair that touches at one of the points.
    fn first_hit(&mut self, line: &[Vec<f64>], name_it: bool) -> Result<Option<(String, String)>, Failure> {
        for q in line {
            if let Some(hit) = self.hit_at(q, name_it)? {
                return Ok(Some(hit));
            }
        }
        Ok(None)
    }

    fn hit_at(&mut self, q: &[f64], name_it: bool) -> Result<Option<(String, String)>, Failure> {
        Ok(if name_it { self.context.scene.collisions(q)?.into_iter().next() } else { None })
    }

    /// Contacts that are part of the purpose: at the end of a pick the fingers may touch the block.
    fn allow_entry(&mut self, entry: &Entry) -> Result<(), Failure> {
        let Entry::Pick(Touch::Picked | Touch::Loose) = entry else { return Ok(()) };
        let Some(picked) = self.picked() else { return Ok(()) };
        let model = self.context.model.clone();
        for (k, link) in model.links.iter().enumerate() {
            if k != model.tip {
                self.context.scene.allow_contact(&link.name, &picked)?;
            }
        }
        Ok(())
    }

    /// A finger touches what lies loose near the grip.
    fn is_pushing(&self, (link, obstacle): &(String, String)) -> bool {
        let model = &self.context.model;
        let mut fingers = model.hand.iter().map(|&joint| &model.links[model.joints[joint].child].name);
        self.problem.loose.contains(obstacle) && fingers.any(|name| name == link)
    }

    /// Lets the fingers touch what may be pushed aside.
    fn allow_pushing(&mut self) -> Result<(), Failure> {
        let model = self.context.model.clone();
        for obstacle in &self.problem.loose {
            for &joint in &model.hand {
                self.context.scene.allow_contact(&model.links[model.joints[joint].child].name, obstacle)?;
            }
        }
        Ok(())
    }

    /// The name of the object that is to be picked, if it is among the obstacles.
    fn picked(&self) -> Option<String> {
        let request = &self.problem.request;
        request.picked.clone().filter(|picked| request.obstacles.iter().any(|o| o.name == *picked))
    }

    /// True if nothing else is touched at `end` once the hand has closed around the block.
    fn grip_is_free(&mut self, touch: Touch, end: &[f64]) -> Result<bool, Failure> {
        let model = self.context.model.clone();
        let Ok(closed) = model.pose("hand", &self.problem.grasp.closed_pose) else { return Ok(true) };
        self.context.set_clearance(Clearance::Contact)?;
        if let Some(picked) = self.picked() {
            self.allow_hand(&picked)?;
        }
        if touch == Touch::Loose {
            self.allow_pushing()?;
        }
        self.context.scene.set_hand(closed)?;
        let free = self.context.scene.is_free(end);
        // As it was, whatever came of it.
        self.context.scene.set_hand(&self.problem.request.hand)?;
        Ok(free?)
    }

    /// Lets the whole hand and what it carries touch `obstacle`.
    fn allow_hand(&mut self, obstacle: &str) -> Result<(), Failure> {
        for link in &self.context.model.links {
            self.context.scene.allow_contact(&link.name, obstacle)?;
        }
        if let Some(object) = &self.problem.request.attached {
            self.context.scene.allow_contact(&object.name, obstacle)?;
        }
        Ok(())
    }

    /// The reason why there is no way to `what`; another look may follow.
    pub fn failure(&mut self, what: &str) -> Failure {
        std::mem::take(&mut self.tally).failure(what)
    }
}

impl Tally {
    /// The reason why there is no way to `what`.
    pub fn failure(self, what: &str) -> Failure {
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
