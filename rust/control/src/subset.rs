use crate::ports::ArmKinematics;
use crate::{ControlError, ControlInput, ControlMethod, ControlOutput, MotionCommand, Profile, STEP_SECS};
use proact_arm::{ArmModel, JointLimits};
use proact_types::{ModeView, PlannerView, SimTime, TargetView};

/// A joint this near its goal has reached it, rad.
const THERE: f64 = 1e-9;

/// The arm joints that a method drives; the person's own limb has the others.
#[derive(Clone, Debug, PartialEq)]
pub struct JointSubset {
    driven: Vec<usize>,
    count: usize,
}

impl JointSubset {
    /// The joints of the profile's level, base to tip.
    ///
    /// # Errors
    /// [`ControlError::Name`] for a level that is not in the list or a joint that the arm does not have.
    pub fn new(profile: &Profile, model: &ArmModel) -> Result<Self, ControlError> {
        let count = model.arm_count();
        let all = Self { driven: (0..count).collect(), count };
        let names = profile.levels.get(&profile.level).ok_or_else(|| ControlError::Name {
            kind: "level",
            got: profile.level.clone(),
            known: profile.levels.keys().cloned().collect::<Vec<_>>().join(", "),
        })?;
        if names.is_empty() {
            return Ok(all);
        }
        let mut driven = names.iter().map(|name| all.find(model, name)).collect::<Result<Vec<_>, _>>()?;
        driven.sort_unstable();
        driven.dedup();
        Ok(Self { driven, count })
    }

    /// Positions of the driven joints among the arm joints, ascending.
    pub fn driven(&self) -> &[usize] {
        &self.driven
    }

    /// True when the method has the whole arm.
    pub fn is_whole(&self) -> bool {
        self.driven.len() == self.count
    }

    /// True for the position of a driven joint.
    pub fn contains(&self, joint: usize) -> bool {
        self.driven.binary_search(&joint).is_ok()
    }

    /// Position of the driven joint called `name`.
    pub(crate) fn find(&self, model: &ArmModel, name: &str) -> Result<usize, ControlError> {
        let full = |joint: usize| &*model.joints[model.arm[joint]].name;
        self.driven.iter().copied().find(|&joint| Self::is_named(full(joint), name)).ok_or_else(|| {
            let known = self.driven.iter().map(|&joint| full(joint)).collect::<Vec<_>>().join(", ");
            ControlError::Name { kind: "joint", got: name.to_owned(), known }
        })
    }

    /// True if `name` is the joint's full name or what follows its last `__`: `mpl_right_arm__elbow` is `elbow`.
    pub(crate) fn is_named(full: &str, name: &str) -> bool {
        full == name || full.rsplit("__").next() == Some(name)
    }
}

/// Lets the joints that a method does not drive follow the person's own limb, at most at their speed limits. What
/// the method asks of those joints is dropped. Without a tracked limb they stay where they are.
#[derive(Clone, Debug)]
pub struct FollowsLimb<M> {
    method: M,
    subset: JointSubset,
    limits: Vec<JointLimits>,
    /// Where the method sent its joints, while they are on their way.
    goal: Option<Vec<f64>>,
    /// True while joints of the limb move.
    following: bool,
}

impl<M: ControlMethod> FollowsLimb<M> {
    /// Around `method`, which drives the joints of `subset`.
    pub fn new(method: M, subset: JointSubset, model: &ArmModel) -> Self {
        let limits = model.arm.iter().map(|&j| model.joints[j].limits).collect();
        Self { method, subset, limits, goal: None, following: false }
    }
}

impl<M: ControlMethod> ControlMethod for FollowsLimb<M> {
    fn name(&self) -> &str {
        self.method.name()
    }

    fn step(
        &mut self,
        now: SimTime,
        input: &ControlInput<'_>,
        kinematics: &mut dyn ArmKinematics,
    ) -> ControlOutput {
        let mut output = self.method.step(now, input, kinematics);
        let asked = output.motion.take();
        match &asked {
            Some(MotionCommand::Goto(goal)) => self.goal = Some(goal.to_vec()),
            Some(_) => self.goal = None,
            None => {}
        }
        let commanded = input.commanded;
        let toward = |goal: Option<&f64>, joint: usize| {
            let top = self.limits.get(joint).map_or(0.0, |limits| limits.velocity);
            let gap = goal.map_or(0.0, |goal| goal - commanded[joint]);
            // A joint that is there does not tremble by rounding.
            let moves = gap.is_finite() && gap.abs() > THERE;
            if moves { (gap / STEP_SECS).clamp(-top, top) } else { 0.0 }
        };
        let speeds: proact_types::JointVector = (0..commanded.len())
            .map(|joint| match &asked {
                _ if !self.subset.contains(joint) => {
                    let limits = self.limits.get(joint).copied().unwrap_or_default();
                    // A limb whose tracker died is nowhere; and when anything died, nothing moves.
                    let limb = input.limb.filter(|_| input.stop.is_none());
                    let goal = limb.and_then(|limb| limb.get(joint));
                    toward(goal.map(|goal| goal.clamp(limits.lower, limits.upper)).as_ref(), joint)
                }
                Some(MotionCommand::Velocity(speeds)) => speeds.get(joint).copied().unwrap_or(0.0),
                _ => toward(self.goal.as_ref().and_then(|goal| goal.get(joint)), joint),
            })
            .collect();
        let moving = speeds.iter().any(|speed| *speed != 0.0);
        let was_following = std::mem::replace(&mut self.following, moving);
        output.motion = match asked {
            // Speeds are said again at every step, and once more, zero, when the motion ends.
            _ if moving => Some(MotionCommand::Velocity(speeds)),
            Some(_) => Some(MotionCommand::Hold),
            None if was_following => Some(MotionCommand::Hold),
            None => None,
        };
        output
    }

    fn mode(&self) -> Option<ModeView> {
        self.method.mode()
    }

    fn target(&self) -> TargetView {
        self.method.target()
    }

    fn planner(&self) -> PlannerView {
        self.method.planner()
    }
}
