//! What a step is worth.

use proact_arm::ArmModel;
use proact_testbed::{ConfigError, Session};
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
struct Subject {
    score: u32,
    next: Option<ObjectId>,
    goal: Option<TaskGoal>,
}

/// The worth of steps, one after the other.
pub(super) struct Reward {
    kind: RewardKind,
    model: Arc<ArmModel>,
    /// What was asked for after the step before, and how far it was away.
    before: Option<(Subject, f64)>,
    score: u32,
}

impl Reward {
    pub(super) fn new(kind: RewardKind, session: &Session) -> Self {
        let mut reward = Self { kind, model: session.testbed().model().clone(), before: None, score: 0 };
        reward.of_step(session);
        reward
    }

    /// The worth of what happened since the last call.
    pub(super) fn of_step(&mut self, session: &Session) -> f64 {
        let state = session.testbed().task().state();
        let scored = f64::from(state.score) - f64::from(std::mem::replace(&mut self.score, state.score));
        if self.kind == RewardKind::Sparse {
            return scored;
        }
        let subject = Subject { score: state.score, next: state.next, goal: state.goal.clone() };
        let now = distance(session, &self.model);
        let nearer = match &self.before {
            Some((before, distance)) if *before == subject => distance - now,
            _ => 0.0,
        };
        self.before = Some((subject, now));
        scored + nearer
    }
}

/// How far what is asked for is away: metres, or rad of the mean joint.
fn distance(session: &Session, model: &ArmModel) -> f64 {
    let testbed = session.testbed();
    let (task, world) = (testbed.task(), testbed.plant().state());
    let (state, scene) = (task.state(), task.scene());
    let hand = || grasp_centre(session, model);
    if let Some(TaskGoal::Posture { joints }) = &state.goal {
        let off = joints.iter().map(|goal| (world.position[usize::from(goal.joint)] - goal.angle).abs());
        return off.sum::<f64>() / joints.len().max(1) as f64;
    }
    if let Some(TaskGoal::Ball { centre, .. }) = &state.goal {
        return (hand() - centre).norm();
    }
    let side = if scene.put_down.centre(0.0).y < 0.0 { -1.0 } else { 1.0 };
    let to_go = |object: ObjectId| {
        let at = Point::from(world.objects[object.index()].pose.translation.vector);
        let place = match (&state.goal, task.briefing().destination) {
            (Some(TaskGoal::Disc { centre, .. }), _) => Some(*centre),
            (_, Destination::OwnTarget) => scene.target(object).map(|target| target.centre),
            _ => None,
        };
        // Across the partition, in the plane y = 0, is where an object counts that has no place of its own.
        let away = place.map_or((-side * at.y).max(0.0), |place| (at.xy() - place.xy()).norm());
        (hand() - at).norm() + away
    };
    let held = world.attached.map(|(index, _)| ObjectId::new(index));
    let meant: ObjectSet = match held.or(state.next) {
        Some(object) => [object].into_iter().collect(),
        None => state.candidates,
    };
    let nearest = meant.iter().filter(|object| object.index() < world.objects.len()).map(to_go);
    nearest.min_by(f64::total_cmp).unwrap_or(0.0)
}

/// Centre of the hand's widest grasp, `world`.
pub(super) fn grasp_centre(session: &Session, model: &ArmModel) -> Point {
    let world = session.testbed().plant().state();
    let mut poses = Vec::new();
    model.place_links(&world.world_from_base, &world.position, &mut poses);
    poses[model.tip] * Point::from(model.widest_grasp().centre)
}
