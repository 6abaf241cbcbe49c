//! The look for paths into a goal from some arm postures: arm angles that do what is asked, and straight paths to them.

use crate::PlanningError;
use crate::approach_paths::{ApproachGoal, ApproachPath, is_same_posture, posture_cost, sort_by_cost};
use crate::axis_ik::{self, IkGoal};
use crate::context::{ClearanceMode, PlanningContext};
use crate::failure::PlanFailure;
use crate::problem::PlanProblem;
use proact_control::ports::IkOutcome;
use proact_types::{PlanStatus, Point, Pose, Vector};

/// One look for paths into the goal of a request, and what it has met so far.
pub(crate) struct ApproachSearch<'a> {
    pub context: &'a mut PlanningContext,
    pub problem: &'a PlanProblem<'a>,
    /// Arm angles at which the search in joint space begins.
    pub start: &'a [f64],
    /// Arm angles near which those at the goal are sought.
    pub ik_seeds: &'a [Vec<f64>],
    /// Height of the straight way down, metres.
    pub approach_height_m: f64,
    pub diagnostics: SearchDiagnostics,
}

/// What was found on the way to a list of paths, for the reason given when there is none.
#[derive(Default)]
pub(crate) struct SearchDiagnostics {
    ik_solution_count: usize,
    first_contact: Option<(String, String)>,
}

/// What is done at the end of a way.
#[derive(Clone, Copy, Debug)]
pub(crate) enum ApproachAction {
    Pick(AllowedContact),
    Place,
}

/// What the fingers may touch on the straight way into a grip.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum AllowedContact {
    Nothing,
    /// The object that is picked.
    PickedObject,
    /// That, and what may be pushed aside.
    LooseObjects,
}

/// Arm angles that do what is asked.
#[derive(Clone, Debug)]
pub(crate) struct GoalPosture {
    pub q: Vec<f64>,
    /// Ends that differ by the hand's turn about the vertical alone have the same number.
    pub posture_id: usize,
    /// The angle to the preferred hand orientation, rad.
    pub tilt_rad: f64,
}

/// Hands on the way from closed to open that are looked at.
const OPENING_STEPS: usize = 10;

impl ApproachSearch<'_> {
    /// To arm angles, which are themselves the way.
    pub fn paths_to_joints(&mut self, q: &[f64]) -> Result<Vec<ApproachPath>, PlanFailure> {
        if !self.context.limits.contains(q, 1e-9) {
            return Err(PlanFailure::new(PlanStatus::Invalid, "The goal is outside the joint limits."));
        }
        let goal = self.context.limits.clamp(q);
        self.context.set_clearance(ClearanceMode::Transit)?;
        match self.context.scene.collisions(&goal)?.first() {
            Some((a, b)) => Err(PlanFailure::new(
                PlanStatus::GoalInCollision,
                format!("The arm would touch something at the goal: {a} and {b}."),
            )),
            None => Ok(vec![ApproachPath {
                waypoints: vec![goal],
                cost: 0.0,
                opening_blocked: false,
                approach_goal: None,
            }]),
        }
    }

    /// To a pose of the tip in the world, without a straight way into it.
    pub fn paths_to_pose(&mut self, pose: &Pose) -> Result<Vec<ApproachPath>, PlanFailure> {
        let base_from_tip = self.problem.base_from_world * pose;
        let mut paths: Vec<ApproachPath> = Vec::new();
        self.context.set_clearance(ClearanceMode::Transit)?;
        let reach = IkGoal {
            point: Point::origin(),
            axis: Vector::z(),
            target: Point::from(base_from_tip.translation.vector),
            direction: Vector::z(),
            orientation: Some(base_from_tip.rotation),
            tolerance: None,
        };
        for (index, posture) in self.ik_seeds.iter().enumerate() {
            self.context.check_interrupt()?;
            // From the first posture KDL tries others too; that is as far as a pose out of reach is worth.
            let seed = match axis_ik::solve_ik(&self.context.chain, &self.context.limits, &reach, posture) {
                Some(near) => near,
                None if index == 0 => posture.clone(),
                None => continue,
            };
            let outcome =
                self.context.kinematics.inverse(&base_from_tip, &seed).map_err(PlanningError::from)?;
            let IkOutcome::Solved(q) = outcome else { continue };
            self.diagnostics.ik_solution_count += 1;
            let q = q.to_vec();
            if !self.context.limits.contains(&q, 1e-9)
                || paths.iter().any(|w| is_same_posture(&w.waypoints[0], &q))
            {
                continue;
            }
            match self.context.scene.collisions(&q)?.into_iter().next() {
                Some(pair) => self.diagnostics.first_contact = Some(pair),
                None => {
                    let cost = posture_cost(&self.context.limits, self.start, &q, 0.0);
                    let approach_goal =
                        Some(ApproachGoal { ik_goal: reach, action: None, needs_opening_clearance: false });
                    paths.push(ApproachPath {
                        waypoints: vec![q],
                        cost,
                        opening_blocked: false,
                        approach_goal,
                    });
                }
            }
        }
        if paths.is_empty() { Err(self.failure("pose")) } else { Ok(sort_by_cost(paths)) }
    }

    /// The arm angles at the pose that `reach` asks for which the kinematics library finds from `q`, if they are free.
    pub fn path_to_pose_near(
        &mut self,
        reach: &IkGoal,
        q: &[f64],
    ) -> Result<Option<Vec<Vec<f64>>>, PlanFailure> {
        let Some(rotation) = reach.orientation else { return Ok(None) };
        let pose = Pose::from_parts(reach.target.into(), rotation);
        let outcome = self.context.kinematics.inverse(&pose, q).map_err(PlanningError::from)?;
        let IkOutcome::Solved(q) = outcome else { return Ok(None) };
        self.context.set_clearance(ClearanceMode::Transit)?;
        let free = self.context.limits.contains(&q, 1e-9) && self.context.scene.is_free(&q)?;
        Ok(free.then(|| vec![q.to_vec()]))
    }

    /// Arm angles that do what `reach` asks, found from the postures, but for those that `paths` end at.
    pub fn ik_solutions(
        &mut self,
        reach: &IkGoal,
        paths: &[ApproachPath],
    ) -> Result<Vec<Vec<f64>>, PlanFailure> {
        let mut ends: Vec<Vec<f64>> = Vec::new();
        for posture in self.ik_seeds {
            self.context.check_interrupt()?;
            let Some(end) = axis_ik::solve_ik(&self.context.chain, &self.context.limits, reach, posture)
            else {
                continue;
            };
            self.diagnostics.ik_solution_count += 1;
            let known = |w: &ApproachPath| is_same_posture(&w.waypoints[w.waypoints.len() - 1], &end);
            if !paths.iter().any(known) && !ends.iter().any(|e| is_same_posture(e, &end)) {
                ends.push(end);
            }
        }
        Ok(ends)
    }

    /// Those of `ends` where nothing is touched but what `entry` may touch.
    pub fn collision_free(
        &mut self,
        ends: Vec<GoalPosture>,
        entry: ApproachAction,
    ) -> Result<Vec<GoalPosture>, PlanFailure> {
        self.context.check_interrupt()?;
        self.context.set_clearance(ClearanceMode::Contact)?;
        self.allow_action_contacts(&entry)?;
        let mut free = Vec::with_capacity(ends.len());
        for end in ends {
            if self.context.scene.is_free(&end.q)? {
                free.push(end);
            } else if self.diagnostics.first_contact.is_none() {
                self.diagnostics.first_contact = self.context.scene.collisions(&end.q)?.into_iter().next();
            }
        }
        Ok(free)
    }

    /// `ends` of a place parted into those where no finger touches anything on its way open, and the others.
    pub fn split_by_opening_clearance(
        &mut self,
        ends: Vec<GoalPosture>,
    ) -> Result<(Vec<GoalPosture>, Vec<GoalPosture>), PlanFailure> {
        let model = self.context.model.clone();
        let open = model.pose("hand", &self.problem.grasp.open_pose);
        let (Ok(open), false) = (open, ends.is_empty()) else { return Ok((ends, Vec::new())) };
        let request = self.problem.request;
        self.context.check_interrupt()?;
        self.context.set_clearance(ClearanceMode::Contact)?;
        self.context.scene.set_attached(None)?;
        let parted = self.split_by_opening_sweep(open, ends);
        // As it was, whatever came of it.
        self.context.scene.set_hand(&request.hand)?;
        self.context.scene.set_attached(request.attached.as_ref())?;
        parted
    }

    /// `ends` parted by whether none of the hands from the present one to `fingers` touches anything there.
    fn split_by_opening_sweep(
        &mut self,
        fingers: &[f64],
        ends: Vec<GoalPosture>,
    ) -> Result<(Vec<GoalPosture>, Vec<GoalPosture>), PlanFailure> {
        let (mut clear, mut cramped) = (ends, Vec::new());
        // The last one takes the most room.
        for step in (1..=OPENING_STEPS).rev() {
            if clear.is_empty() {
                break;
            }
            let share = step as f64 / OPENING_STEPS as f64;
            let hand = self.problem.request.hand.iter().zip(fingers);
            let hand: Vec<f64> = hand.map(|(from, to)| from + share * (to - from)).collect();
            self.context.scene.set_hand(&hand)?;
            for end in std::mem::take(&mut clear) {
                let free = self.context.scene.is_free(&end.q)?;
                if free { &mut clear } else { &mut cramped }.push(end);
            }
        }
        Ok((clear, cramped))
    }

    /// The straight way into `end`, if it is free.
    pub fn approach_path(
        &mut self,
        reach: &IkGoal,
        end: &GoalPosture,
        entry: ApproachAction,
    ) -> Result<Option<ApproachPath>, PlanFailure> {
        self.context.check_interrupt()?;
        match self.straight_approach(reach, &end.q, &entry, self.diagnostics.first_contact.is_none())? {
            Ok(points) => {
                let cost = posture_cost(&self.context.limits, self.start, &points[0], end.tilt_rad);
                // Part of an arm does not do all that is asked.
                let whole = self.context.goal_tolerance.is_none();
                let needs_clearance = matches!(entry, ApproachAction::Place);
                let approach_goal = whole.then_some(ApproachGoal {
                    ik_goal: *reach,
                    action: Some(entry),
                    needs_opening_clearance: needs_clearance,
                });
                Ok(Some(ApproachPath { waypoints: points, cost, opening_blocked: false, approach_goal }))
            }
            Err(hit) => {
                self.diagnostics.first_contact = self.diagnostics.first_contact.take().or(hit);
                Ok(None)
            }
        }
    }

    /// The straight way down to `end`, from its top to `end`, if it is free; otherwise what it hits, if that is asked for:
    /// to name it takes longer than to see that there is something.
    #[allow(clippy::type_complexity)]
    fn straight_approach(
        &mut self,
        reach: &IkGoal,
        end: &[f64],
        entry: &ApproachAction,
        name_it: bool,
    ) -> Result<Result<Vec<Vec<f64>>, Option<(String, String)>>, PlanFailure> {
        self.context.set_clearance(ClearanceMode::Contact)?;
        self.allow_action_contacts(entry)?;
        if matches!(entry, ApproachAction::Pick(AllowedContact::LooseObjects)) {
            // To allow all that is near takes longer than to see that something else is touched.
            let touching = self.context.scene.collisions(end)?;
            if let Some(pair) = touching.into_iter().find(|pair| !self.is_allowed_push(pair)) {
                return Ok(Err(Some(pair)));
            }
            self.allow_loose_contacts()?;
        } else if !self.context.scene.is_free(end)? {
            return Ok(Err(self.contact_at(end, name_it)?));
        }
        // Part of an arm cannot go far straight down.
        let shares: &[f64] = if self.context.goal_tolerance.is_some() { &[1.0, 0.5, 0.25] } else { &[1.0] };
        let lines = shares.iter().find_map(|share| {
            let rise = self.problem.up * (share * self.approach_height_m);
            let line = axis_ik::straight_line(&self.context.chain, &self.context.limits, reach, &rise, end);
            (line.len() > axis_ik::line_steps(rise.norm())).then_some(line)
        });
        let Some(line) = lines else { return Ok(Err(None)) };
        let search = self.context.contact_search_limits();
        if !self.context.scene.path_is_free(line.iter().map(Vec::as_slice), &search)? {
            return Ok(Err(self.first_contact_along(&line, name_it)?));
        }
        if let ApproachAction::Pick(touch) = entry
            && !self.closed_grip_is_free(*touch, end)?
        {
            return Ok(Err(None));
        }
        self.context.set_clearance(ClearanceMode::Transit)?;
        let top = &line[line.len() - 1];
        if !self.context.scene.is_free(top)? {
            return Ok(Err(self.contact_at(top, name_it)?));
        }
        Ok(Ok(line.into_iter().rev().collect()))
    }

    /// The first pair that touches at one of the points.
    fn first_contact_along(
        &mut self,
        line: &[Vec<f64>],
        name_it: bool,
    ) -> Result<Option<(String, String)>, PlanFailure> {
        for q in line {
            if let Some(hit) = self.contact_at(q, name_it)? {
                return Ok(Some(hit));
            }
        }
        Ok(None)
    }

    fn contact_at(&mut self, q: &[f64], name_it: bool) -> Result<Option<(String, String)>, PlanFailure> {
        Ok(if name_it { self.context.scene.collisions(q)?.into_iter().next() } else { None })
    }

    /// Contacts that are part of the purpose: at the end of a pick the fingers may touch the block.
    fn allow_action_contacts(&mut self, entry: &ApproachAction) -> Result<(), PlanFailure> {
        let ApproachAction::Pick(AllowedContact::PickedObject | AllowedContact::LooseObjects) = entry else {
            return Ok(());
        };
        let Some(picked) = self.picked_object() else { return Ok(()) };
        let model = self.context.model.clone();
        for (k, link) in model.links.iter().enumerate() {
            if k != model.tip {
                self.context.scene.allow_contact(&link.name, &picked)?;
            }
        }
        Ok(())
    }

    /// A finger touches what lies loose near the grip.
    fn is_allowed_push(&self, (link, obstacle): &(String, String)) -> bool {
        let model = &self.context.model;
        let mut fingers = model.hand.iter().map(|&joint| &model.links[model.joints[joint].child].name);
        self.problem.loose_obstacles.contains(obstacle) && fingers.any(|name| name == link)
    }

    /// Lets the fingers touch what may be pushed aside.
    fn allow_loose_contacts(&mut self) -> Result<(), PlanFailure> {
        let model = self.context.model.clone();
        for obstacle in &self.problem.loose_obstacles {
            for &joint in &model.hand {
                self.context.scene.allow_contact(&model.links[model.joints[joint].child].name, obstacle)?;
            }
        }
        Ok(())
    }

    /// The name of the object that is to be picked, if it is among the obstacles.
    fn picked_object(&self) -> Option<String> {
        let request = &self.problem.request;
        request.picked_object.clone().filter(|picked| request.obstacles.iter().any(|o| o.name == *picked))
    }

    /// True if nothing else is touched at `end` once the hand has closed around the block.
    fn closed_grip_is_free(&mut self, touch: AllowedContact, end: &[f64]) -> Result<bool, PlanFailure> {
        let model = self.context.model.clone();
        let Ok(closed) = model.pose("hand", &self.problem.grasp.closed_pose) else { return Ok(true) };
        self.context.set_clearance(ClearanceMode::Contact)?;
        if let Some(picked) = self.picked_object() {
            self.allow_hand_contacts(&picked)?;
        }
        if touch == AllowedContact::LooseObjects {
            self.allow_loose_contacts()?;
        }
        self.context.scene.set_hand(closed)?;
        let free = self.context.scene.is_free(end);
        // As it was, whatever came of it.
        self.context.scene.set_hand(&self.problem.request.hand)?;
        Ok(free?)
    }

    /// Lets the whole hand and what it carries touch `obstacle`.
    fn allow_hand_contacts(&mut self, obstacle: &str) -> Result<(), PlanFailure> {
        for link in &self.context.model.links {
            self.context.scene.allow_contact(&link.name, obstacle)?;
        }
        if let Some(object) = &self.problem.request.attached {
            self.context.scene.allow_contact(&object.name, obstacle)?;
        }
        Ok(())
    }

    /// The reason why there is no way to `what`; another look may follow.
    pub fn failure(&mut self, what: &str) -> PlanFailure {
        std::mem::take(&mut self.diagnostics).into_failure(what)
    }
}

impl SearchDiagnostics {
    /// The reason why there is no way to `what`.
    pub fn into_failure(self, what: &str) -> PlanFailure {
        if self.ik_solution_count == 0 {
            return PlanFailure::new(
                PlanStatus::Unreachable,
                format!("The {what} is out of the hand's reach."),
            );
        }
        match self.first_contact {
            Some((a, b)) => PlanFailure::new(
                PlanStatus::GoalInCollision,
                format!("At the {what} the hand would touch something: {a} and {b}."),
            ),
            None => PlanFailure::new(
                PlanStatus::Unreachable,
                format!("The {what} cannot be approached from above: the arm is at its limits."),
            ),
        }
    }
}
