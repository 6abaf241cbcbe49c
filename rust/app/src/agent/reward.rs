//! What a step is worth.

use proact_arm::ArmModel;
use proact_testbed::{ConfigError, RunningTrial};
use proact_types::{Destination, ObjectId, ObjectSet, Point, TaskGoal};
use std::{str::FromStr, sync::Arc};

/// What a step is worth.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RewardKind {
    /// What the task counted in it.
    Sparse,
    /// The same, and how much nearer hand, object or joints came to where they should be, in metres or rad (Ng, Harada and
    /// Russell 1999, without a discount).
    Shaped,
}

impl FromStr for RewardKind {
    type Err = ConfigError;

    fn from_str(name: &str) -> Result<Self, ConfigError> {
        match name {
            "sparse" => Ok(Self::Sparse),
            "shaped" => Ok(Self::Shaped),
            _ => Err(ConfigError::Value {
                key: "reward",
                got: format!("{name:?}"),
                expected: "sparse or shaped",
            }),
        }
    }
}

/// What is asked for: while it stays the same, coming nearer counts.
#[derive(Clone, Debug, PartialEq)]
struct RewardGoal {
    score: u32,
    next: Option<ObjectId>,
    goal: Option<TaskGoal>,
}

/// The worth of steps, one after the other.
pub(super) struct RewardFunction {
    kind: RewardKind,
    model: Arc<ArmModel>,
    /// What was asked for after the step before, and how far it was away.
    previous: Option<(RewardGoal, f64)>,
    score: u32,
}

impl RewardFunction {
    pub(super) fn new(kind: RewardKind, trial: &RunningTrial) -> Self {
        let mut reward = Self { kind, model: trial.testbed().model().clone(), previous: None, score: 0 };
        reward.step_reward(trial);
        reward
    }

    /// The worth of what happened since the last call.
    pub(super) fn step_reward(&mut self, trial: &RunningTrial) -> f64 {
        let state = trial.testbed().task().state();
        let scored = f64::from(state.score) - f64::from(std::mem::replace(&mut self.score, state.score));
        if self.kind == RewardKind::Sparse {
            return scored;
        }
        let subject = RewardGoal { score: state.score, next: state.next_object, goal: state.goal.clone() };
        let now = distance(trial, &self.model);
        let nearer = match &self.previous {
            Some((before, distance)) if *before == subject => distance - now,
            _ => 0.0,
        };
        self.previous = Some((subject, now));
        scored + nearer
    }
}

/// How far what is asked for is away: metres, or rad of the mean joint.
fn distance(trial: &RunningTrial, model: &ArmModel) -> f64 {
    let testbed = trial.testbed();
    let (task, world) = (testbed.task(), testbed.plant().state());
    let (state, scene) = (task.state(), task.scene());
    let hand = || grasp_center(trial, model);
    if let Some(TaskGoal::Posture { joints }) = &state.goal {
        let off = joints.iter().map(|goal| (world.position[usize::from(goal.joint)] - goal.angle).abs());
        return off.sum::<f64>() / joints.len().max(1) as f64;
    }
    if let Some(TaskGoal::Ball { center, .. }) = &state.goal {
        return (hand() - center).norm();
    }
    let side = if scene.place_region.center(0.0).y < 0.0 { -1.0 } else { 1.0 };
    let to_go = |object: ObjectId| {
        let at = Point::from(world.objects[object.index()].pose.translation.vector);
        let destination = match (&state.goal, task.briefing().destination) {
            (Some(TaskGoal::Disc { center, .. }), _) => Some(*center),
            (_, Destination::OwnTarget) => scene.target(object).map(|target| target.center),
            _ => None,
        };
        // Across the partition, in the plane y = 0, is where an object counts that has no place of its own.
        let away =
            destination.map_or((-side * at.y).max(0.0), |destination| (at.xy() - destination.xy()).norm());
        (hand() - at).norm() + away
    };
    let held = world.attached.map(|(index, _)| ObjectId::new(index));
    let candidates: ObjectSet = match held.or(state.next_object) {
        Some(object) => [object].into_iter().collect(),
        None => state.candidates,
    };
    let nearest = candidates.iter().filter(|object| object.index() < world.objects.len()).map(to_go);
    nearest.min_by(f64::total_cmp).unwrap_or(0.0)
}

/// Centre of the hand's widest grasp, `world`.
pub(super) fn grasp_center(trial: &RunningTrial, model: &ArmModel) -> Point {
    let world = trial.testbed().plant().state();
    let mut poses = Vec::new();
    model.link_poses_into(&world.world_from_base, &world.position, &mut poses);
    poses[model.tip] * Point::from(model.widest_grasp().center)
}
