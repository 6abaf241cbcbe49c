use crate::{
    Task, TaskError, TaskInput, TaskResult, TaskState,
    goal_attempt::{GoalAttempt, GoalAttemptResult, distance},
    throughput::{PointingMovement, effective_throughput, index_of_difficulty, nominal_throughput},
};
use proact_types::{BodyState, Briefing, EventKind, JointGoal, Point, Scene, SimTime, TaskContext, TaskGoal};
use serde_json::{Map, Value, json};

/// What one after the other is asked for.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum TaskGoals {
    /// The hand's grasp centre to balls: the condition of each, and the ball. The first of each condition is where the next
    /// movement begins, and does not count.
    Balls(Vec<(usize, Point, f64)>),
    /// Joints to postures: of each joint that counts its place in the arm and the share of its range, 0 to 1, and how far it may
    /// be off, rad.
    Postures(Vec<Vec<(u8, f64)>>, f64),
}

impl TaskGoals {
    fn count(&self) -> usize {
        match self {
            Self::Balls(balls) => balls.len(),
            Self::Postures(postures, _) => postures.len(),
        }
    }

    fn is_scored(&self, number: usize) -> bool {
        match self {
            Self::Balls(balls) => number > 0 && balls[number - 1].0 == balls[number].0,
            Self::Postures(..) => true,
        }
    }
}

/// Goals one after the other, each to be entered and kept for a dwell time: target achievement (postures of the arm's joints)
/// and reaching (balls in space). One that is not reached in time is missed, and the next one is shown.
///
/// Deterministic: state follows from the calls alone.
#[derive(Clone, Debug)]
pub struct GoalSequence {
    briefing: Briefing,
    scene: Scene,
    goals: TaskGoals,
    dwell: SimTime,
    goal_limit: SimTime,
    limit: SimTime,
    /// Lowest and highest angle of each joint, rad; none before the arm is known.
    ranges: Vec<[f64; 2]>,
    current_attempt: Option<GoalAttempt>,
    done: Vec<GoalAttemptResult>,
    state: TaskState,
}

impl GoalSequence {
    /// The task before its start. `dwell_secs` completes a goal, `goal_secs` gives it up.
    pub(crate) fn new(
        briefing: Briefing,
        scene: Scene,
        goals: TaskGoals,
        dwell_secs: f64,
        goal_secs: f64,
    ) -> Self {
        let mut task = Self {
            dwell: SimTime::from_secs(dwell_secs),
            goal_limit: SimTime::from_secs(goal_secs),
            limit: SimTime::from_secs(briefing.limit_secs),
            ranges: Vec::new(),
            current_attempt: None,
            done: Vec::new(),
            state: TaskState::default(),
            briefing,
            scene,
            goals,
        };
        task.update_state();
        task
    }

    fn goal(&self, number: usize) -> Option<TaskGoal> {
        match &self.goals {
            TaskGoals::Balls(balls) => {
                let (_, center, radius) = *balls.get(number)?;
                Some(TaskGoal::Ball { center, radius })
            }
            TaskGoals::Postures(postures, tolerance) => {
                let angle = |(joint, share): &(u8, f64)| {
                    let [low, high] = *self.ranges.get(usize::from(*joint))?;
                    let angle = low + share * (high - low);
                    Some(JointGoal { joint: *joint, angle, tolerance: *tolerance })
                };
                let joints: Option<Vec<_>> = postures.get(number)?.iter().map(angle).collect();
                Some(TaskGoal::Posture { joints: joints? })
            }
        }
    }

    fn update_state(&mut self) {
        self.state.goal = self.goal(self.done.len());
        let reached = self.done.iter().enumerate().filter(|(k, one)| one.reached && self.goals.is_scored(*k));
        self.state.score = reached.count() as u32;
        self.state.context =
            TaskContext { selection_number: self.done.len() as u32, ..TaskContext::default() };
        self.state.context_at_grasp = self.state.context;
    }

    /// The coordinates that count now, and whether they are where they should be.
    fn current_coordinates(&self, seen: &TaskInput<'_>) -> Option<(Vec<f64>, bool)> {
        match self.state.goal.as_ref()? {
            TaskGoal::Ball { center, radius } => {
                let hand = seen.hand.coords.as_slice().to_vec();
                let inside = (seen.hand - center).norm() <= *radius;
                Some((hand, inside))
            }
            TaskGoal::Posture { joints } => {
                let at = |goal: &JointGoal| seen.joints.get(usize::from(goal.joint)).copied();
                let angles: Option<Vec<f64>> = joints.iter().map(at).collect();
                let angles = angles?;
                let near = |(at, goal): (&f64, &JointGoal)| (at - goal.angle).abs() <= goal.tolerance;
                let inside = angles.iter().zip(joints).all(near);
                Some((angles, inside))
            }
            TaskGoal::Disc { .. } => None,
        }
    }

    /// The movements that were asked for and reached, as pointing.
    fn pointing_movements(&self) -> Vec<PointingMovement> {
        let TaskGoals::Balls(balls) = &self.goals else { return Vec::new() };
        let one = |(number, pursued): (usize, &GoalAttemptResult)| {
            if !pursued.reached || !self.goals.is_scored(number) {
                return None;
            }
            let ((_, before, _), (condition, center, radius)) = (balls[number - 1], balls[number]);
            let line = (center - before).try_normalize(1e-9)?;
            let end = Point::from_slice(&pursued.to);
            let start = Point::from_slice(&pursued.from);
            Some(PointingMovement {
                condition,
                distance: (center - before).norm(),
                width: 2.0 * radius,
                seconds: pursued.seconds,
                along: (end - start).dot(&line),
                overshoot_m: (end - center).dot(&line),
            })
        };
        self.done.iter().enumerate().filter_map(one).collect()
    }

    fn result_line(&self, number: usize, pursued: &GoalAttemptResult) -> Value {
        let mut line = json!({
            "number": number + 1,
            "counts": self.goals.is_scored(number),
            "reached": pursued.reached,
            "seconds": pursued.seconds,
            "overshoots": pursued.overshoots,
            "path_efficiency": pursued.path_efficiency,
        });
        if let TaskGoals::Balls(balls) = &self.goals {
            let (condition, center, radius) = balls[number];
            line["condition"] = json!(condition + 1);
            line["width_m"] = json!(2.0 * radius);
            line["off_m"] = json!(distance(center.coords.as_slice(), &pursued.to));
            if self.goals.is_scored(number) {
                let distance = (center - balls[number - 1].1).norm();
                line["distance_m"] = json!(distance);
                line["difficulty_bits"] = json!(index_of_difficulty(distance, 2.0 * radius));
            }
        }
        line
    }
}

impl Task for GoalSequence {
    fn scene(&self) -> &Scene {
        &self.scene
    }

    fn briefing(&self) -> &Briefing {
        &self.briefing
    }

    fn state(&self) -> &TaskState {
        &self.state
    }

    fn step(&mut self, now: SimTime, seen: &TaskInput<'_>) -> Vec<EventKind> {
        let mut events = Vec::new();
        if self.state.finished {
            return events;
        }
        if let Some((at, inside)) = self.current_coordinates(seen) {
            let pursuit = self.current_attempt.get_or_insert_with(|| GoalAttempt::new(now, &at));
            if let Some(pursued) = pursuit.step(now, &at, inside, self.dwell, self.goal_limit) {
                let number = self.done.len() as u32 + 1;
                events.push(match pursued.reached {
                    true => EventKind::GoalReached { number },
                    false => EventKind::GoalMissed { number },
                });
                self.done.push(pursued);
                self.current_attempt = None;
                self.update_state();
            }
        }
        if self.done.len() == self.goals.count() || now >= self.limit {
            self.state.finished = true;
            events.push(EventKind::TrialFinished);
        }
        events
    }

    fn result(&self, _objects: &[BodyState]) -> TaskResult {
        let scored_count = (0..self.goals.count()).filter(|k| self.goals.is_scored(*k)).count();
        let done: Vec<(usize, &GoalAttemptResult)> =
            self.done.iter().enumerate().filter(|(k, _)| self.goals.is_scored(*k)).collect();
        let reached: Vec<&GoalAttemptResult> =
            done.iter().map(|(_, one)| *one).filter(|one| one.reached).collect();
        let mean =
            |values: Vec<f64>| (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64);
        let mut result = Map::new();
        let mut put = |name: &str, value: Value| result.insert(name.to_owned(), value);
        put("reached", json!(reached.len()));
        put("asked", json!(scored_count));
        put("shown", json!(done.len()));
        let rate = reached.len() as f64 / done.len().max(1) as f64;
        put("completion_rate", json!((!done.is_empty()).then_some(rate)));
        put("completion_s", json!(mean(reached.iter().map(|one| one.seconds).collect())));
        put("overshoots", json!(mean(done.iter().map(|(_, one)| f64::from(one.overshoots)).collect())));
        let efficiencies = reached.iter().filter_map(|one| one.path_efficiency).collect();
        put("goal_path_efficiency", json!(mean(efficiencies)));
        if matches!(self.goals, TaskGoals::Balls(_)) {
            let aimed = self.pointing_movements();
            put("throughput_bits_per_s", json!(nominal_throughput(&aimed)));
            put("effective_throughput_bits_per_s", json!(effective_throughput(&aimed)));
        }
        let lines = self.done.iter().enumerate().map(|(k, one)| self.result_line(k, one)).collect();
        put("goals", Value::Array(lines));
        let describe = |(number, one): &(usize, &GoalAttemptResult)| {
            let how = if one.reached { "reached in" } else { "missed after" };
            format!("goal {:<4}{how} {:.1} s", number + 1, one.seconds)
        };
        TaskResult {
            score: f64::from(self.state.score),
            result,
            legacy_fields: Map::new(),
            lines: done.iter().map(describe).collect(),
        }
    }

    fn needs_hand(&self) -> bool {
        matches!(self.goals, TaskGoals::Balls(_))
    }

    fn check_arm(&mut self, limits: &[[f64; 2]]) -> Result<(), TaskError> {
        if let TaskGoals::Postures(postures, tolerance) = &self.goals {
            for (joint, share) in postures.iter().flatten() {
                let wrong = |reason| Err(TaskError::Rule { key: "postures", reason });
                let Some([low, high]) = limits.get(usize::from(*joint)) else {
                    let (got, count) = (usize::from(*joint) + 1, limits.len());
                    return wrong(format!("joint {got}, the arm has joints 1 to {count}"));
                };
                let angle = low + share * (high - low);
                if angle - low < *tolerance || high - angle < *tolerance {
                    let (got, joint) = (angle.to_degrees(), usize::from(*joint) + 1);
                    return wrong(format!(
                        "joint {joint} at {got:.1} degrees is nearer to its limit than the tolerance, {:.1}",
                        tolerance.to_degrees()
                    ));
                }
            }
        }
        self.ranges = limits.to_vec();
        self.update_state();
        Ok(())
    }
}
