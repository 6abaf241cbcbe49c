use crate::inverse::DampedInverse;
use crate::ports::ArmKinematics;
use crate::{
    BlendProfile, ControlInput, ControlMethod, ControlOutput, DampedProfile, InverseProfile, JointSubset,
    MotionCommand, Profile, STEP_SECS,
};
use nalgebra::Vector6;
use proact_arm::{ArmModel, JointLimits};
use proact_types::{JointVector, Point, SimTime, Vector};

/// Closer to its goal than this the assistant no longer moves the hand, metres.
const ARRIVED_M: f64 = 0.01;

/// The assistant of [`crate::Blend`]: moves the grasp centre straight toward the point over the block that the gaze
/// selects, or over the place while a block is held, without turning the hand. It never acts alone.
///
/// Known weaknesses: the grasp centre is that of the hand's widest grasp, because a method is not told of shapes; it minds joint limits and singularities, not what stands in the way.
#[derive(Clone, Debug)]
pub struct ReachAssistant {
    speed_m_per_s: f64,
    height_above_target_m: f64,
    grasp_center: Point,
    /// None where the profile has the undamped inverse: then there is no help.
    inverse: Option<DampedProfile>,
    limits: Vec<JointLimits>,
    subset: JointSubset,
}

impl ReachAssistant {
    /// With the joints of `subset`, by the inverse of `profile.end_effector_jog` if that is damped.
    pub fn new(blend: &BlendProfile, profile: &Profile, subset: &JointSubset, model: &ArmModel) -> Self {
        Self {
            speed_m_per_s: blend.speed_m_per_s,
            height_above_target_m: blend.height_above_target_m,
            grasp_center: Point::from(model.widest_grasp().center),
            inverse: match profile.end_effector_jog.inverse {
                InverseProfile::Damped(damped) => Some(damped),
                InverseProfile::MoorePenrose(_) => None,
            },
            limits: model.arm.iter().map(|&j| model.joints[j].limits).collect(),
            subset: subset.clone(),
        }
    }

    fn joint_velocities(
        &self,
        input: &ControlInput<'_>,
        kinematics: &mut dyn ArmKinematics,
    ) -> Option<JointVector> {
        let below = match (input.hand.held_object, input.highlight) {
            (Some(_), _) => input.place_point,
            (None, block) => input.objects[block?.index()],
        };
        let goal = input
            .world_from_base
            .inverse_transform_point(&(below + Vector::z() * self.height_above_target_m));
        let away = goal - kinematics.forward(input.measured).ok()? * self.grasp_center;
        if away.norm() < ARRIVED_M {
            return None;
        }
        let linear = away.normalize() * self.speed_m_per_s;
        let twist = Vector6::new(linear.x, linear.y, linear.z, 0.0, 0.0, 0.0);
        let damped =
            DampedInverse { profile: self.inverse.as_ref()?, limits: &self.limits, subset: &self.subset };
        let mut jacobian_at = |q: &[f64]| kinematics.jacobian(q).map_err(|error| error.to_string());
        damped.solve(&twist, input.commanded, input.measured, STEP_SECS, &mut jacobian_at).ok()
    }
}

impl ControlMethod for ReachAssistant {
    fn step(
        &mut self,
        _now: SimTime,
        input: &ControlInput<'_>,
        kinematics: &mut dyn ArmKinematics,
    ) -> ControlOutput {
        let fits = input.commanded.len() == self.limits.len() && input.measured.len() == self.limits.len();
        let speeds = if fits { self.joint_velocities(input, kinematics) } else { None };
        ControlOutput { motion: speeds.map(MotionCommand::Velocity), ..ControlOutput::default() }
    }
}
