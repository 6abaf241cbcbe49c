use crate::ports::ArmKinematics;
use crate::{
    ControlError, ControlInput, ControlMethod, ControlOutput, MotionCommand, MotionState, Profile, STEP_SECS,
};
use proact_arm::{ArmModel, JointLimits, matches_short_name};
use proact_types::{MethodStyle, SimTime, Trajectory};
use std::collections::BTreeSet;

/// A joint this near its goal has reached it, rad.
const JOINT_REACHED_RAD: f64 = 1e-9;
/// The level of limb loss at which nothing is left of the limb: every arm has it.
const WHOLE_ARM_LEVEL: &str = "shoulder";

/// The arm joints that a method drives; the person's own limb has the others.
#[derive(Clone, Debug, PartialEq)]
pub struct JointSubset {
    driven: Vec<usize>,
    arm_joint_count: usize,
}

impl JointSubset {
    /// The joints of the profile's level, base to tip.
    ///
    /// # Errors
    /// [`ControlError::Name`] for a level that neither profile nor arm has, or a joint that the arm does not have.
    pub fn new(profile: &Profile, model: &ArmModel) -> Result<Self, ControlError> {
        let count = model.arm_count();
        let all = Self { driven: (0..count).collect(), arm_joint_count: count };
        let (own, arms) = (&profile.levels, &model.settings.levels);
        let names = own.get(&profile.level).or_else(|| arms.get(&profile.level));
        let known = own.keys().chain(arms.keys());
        let names = match names {
            Some(names) => names.as_slice(),
            // An arm that says nothing of levels is worn as a whole.
            None if profile.level == WHOLE_ARM_LEVEL => &[],
            None => {
                let known: BTreeSet<&str> = known.map(String::as_str).chain([WHOLE_ARM_LEVEL]).collect();
                let known = Vec::from_iter(known).join(", ");
                return Err(ControlError::Name { kind: "level", got: profile.level.clone(), known });
            }
        };
        if names.is_empty() {
            return Ok(all);
        }
        let mut driven = names.iter().map(|name| all.find(model, name)).collect::<Result<Vec<_>, _>>()?;
        driven.sort_unstable();
        driven.dedup();
        Ok(Self { driven, arm_joint_count: count })
    }

    /// The same for a method that is driven by `style`: none where the arm imitates the person's own limb.
    ///
    /// # Errors
    /// As [`JointSubset::new`]; [`ControlError::Unsupported`] for a level of limb loss where the whole arm imitates.
    pub fn for_style(style: MethodStyle, profile: &Profile, model: &ArmModel) -> Result<Self, ControlError> {
        let subset = Self::new(profile, model)?;
        if style != MethodStyle::Imitating {
            return Ok(subset);
        }
        if !subset.is_whole() {
            return Err(ControlError::Unsupported {
                method: "by which the arm imitates the person's own limb".to_owned(),
                reason: "leads every joint of the arm by the limb: leave profile.level out",
            });
        }
        Ok(Self { driven: Vec::new(), arm_joint_count: subset.arm_joint_count })
    }

    /// Positions of the driven joints among the arm joints, ascending.
    pub fn driven(&self) -> &[usize] {
        &self.driven
    }

    /// True when the method has the whole arm.
    pub fn is_whole(&self) -> bool {
        self.driven.len() == self.arm_joint_count
    }

    /// True for the position of a driven joint.
    pub fn contains(&self, joint: usize) -> bool {
        self.driven.binary_search(&joint).is_ok()
    }

    /// Position of the driven joint called `name`.
    pub(crate) fn find(&self, model: &ArmModel, name: &str) -> Result<usize, ControlError> {
        let full = |joint: usize| &*model.joints[model.arm[joint]].name;
        self.driven.iter().copied().find(|&joint| matches_short_name(full(joint), name)).ok_or_else(|| {
            let known = self.driven.iter().map(|&joint| full(joint)).collect::<Vec<_>>().join(", ");
            ControlError::Name { kind: "joint", got: name.to_owned(), known }
        })
    }
}

/// Lets the joints that a method does not drive follow the person's own limb, at most at their speed limits. What
/// the method asks of those joints is dropped. Without a tracked limb they stay where they are. A path is followed on the
/// driven joints alone, and the method is told how far, as if actuation did.
#[derive(Clone, Debug)]
pub struct LimbFollower<M> {
    method: M,
    subset: JointSubset,
    limits: Vec<JointLimits>,
    /// Where the method sent its joints, while they are on their way.
    goal: Option<Vec<f64>>,
    /// The path that the driven joints follow, and since when.
    path: Option<(Trajectory, SimTime)>,
    /// The path before has been followed to its end.
    finished: bool,
    /// True while joints of the limb move.
    following: bool,
}

impl<M: ControlMethod> LimbFollower<M> {
    /// Around `method`, which drives the joints of `subset`.
    pub fn new(method: M, subset: JointSubset, model: &ArmModel) -> Self {
        let limits = model.arm.iter().map(|&j| model.joints[j].limits).collect();
        Self { method, subset, limits, goal: None, path: None, finished: false, following: false }
    }
}

impl<M> LimbFollower<M> {
    /// What the arm does as far as the method has to do with it: the path is followed here, not by actuation.
    fn method_motion_state(&self, now: SimTime, actuation: MotionState) -> MotionState {
        match &self.path {
            Some((path, since)) => {
                let secs = now.millis_since(*since) as f64 * 1e-3;
                MotionState::Following((secs / path.duration_secs().max(STEP_SECS)).min(1.0))
            }
            None if self.finished => MotionState::Finished,
            None => actuation,
        }
    }
}

impl<M: ControlMethod> ControlMethod for LimbFollower<M> {
    fn step(
        &mut self,
        now: SimTime,
        input: &ControlInput<'_>,
        kinematics: &mut dyn ArmKinematics,
    ) -> ControlOutput {
        let input = &ControlInput { motion: self.method_motion_state(now, input.motion), ..input.clone() };
        let mut output = self.method.step(now, input, kinematics);
        let motion = output.motion.take();
        match &motion {
            Some(MotionCommand::Goto(goal)) => self.goal = Some(goal.to_vec()),
            Some(_) => self.goal = None,
            None => {}
        }
        match &motion {
            Some(MotionCommand::Follow(path)) => self.path = Some((path.clone(), now)),
            Some(_) => self.path = None,
            None => {}
        }
        if motion.is_some() {
            self.finished = false;
        }
        // Nothing moves while a source is dead.
        if input.stop.is_some() && self.path.take().is_some() {
            self.goal = None;
        }
        if let Some((path, since)) = &self.path {
            let secs = now.millis_since(*since) as f64 * 1e-3;
            self.goal = path.sample(secs + STEP_SECS).map(|(angles, _)| angles.to_vec());
            if secs >= path.duration_secs() {
                self.path = None;
                self.finished = true;
            }
        }
        let commanded = input.commanded;
        let toward = |goal: Option<&f64>, joint: usize| {
            let top = self.limits.get(joint).map_or(0.0, |limits| limits.velocity);
            let gap = goal.map_or(0.0, |goal| goal - commanded[joint]);
            // A joint that is there does not tremble by rounding.
            let moves = gap.is_finite() && gap.abs() > JOINT_REACHED_RAD;
            if moves { (gap / STEP_SECS).clamp(-top, top) } else { 0.0 }
        };
        let speeds: proact_types::JointVector = (0..commanded.len())
            .map(|joint| match &motion {
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
        output.motion = match motion {
            // Speeds are said again at every step, and once more, zero, when the motion ends.
            _ if moving => Some(MotionCommand::Velocity(speeds)),
            Some(_) => Some(MotionCommand::Hold),
            None if was_following => Some(MotionCommand::Hold),
            None => None,
        };
        output
    }
}
