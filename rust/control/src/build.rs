use crate::ports::NoProcess;
use crate::{
    Blend, CommandLimiter, ControlError, ControlMethod, DeadManSwitch, JointSubset, LimbFollower,
    MethodRegistry, Profile, ReachAssistant,
};
use proact_arm::ArmModel;

/// The shipped method called `method` as `profile` describes it, for the arm `model`, with the profile's safeguards
/// around it ([`MethodEntry::build`](crate::MethodEntry::build)).
///
/// # Errors
/// [`ControlError::Method`] with the names there are; a profile that fits neither the arm nor the method.
///
/// ```
/// # fn main() -> Result<(), proact_control::ControlError> {
/// # let model = proact_control::doubles::test_arm();
/// let profile = proact_control::Profile::named("default")?;
/// let method = proact_control::build("D", &profile, &model)?;
/// assert!(proact_control::build("E", &profile, &model).is_err());
/// # Ok(())
/// # }
/// ```
pub fn build(
    method: &str,
    profile: &Profile,
    model: &ArmModel,
) -> Result<Box<dyn ControlMethod>, ControlError> {
    MethodRegistry::standard().get(method)?.build(profile, model, NoProcess)
}

/// `method` with the profile's safeguards around it.
pub(crate) fn with_safeguards(
    mut method: Box<dyn ControlMethod>,
    profile: &Profile,
    subset: JointSubset,
    model: &ArmModel,
) -> Box<dyn ControlMethod> {
    if let Some(blend) = &profile.blend {
        let assistant = ReachAssistant::new(blend, profile, &subset, model);
        method = Box::new(Blend::new(method, assistant, blend.assistance_share));
    }
    method = Box::new(DeadManSwitch::new(method));
    if let Some(limiter) = &profile.limiter {
        method = Box::new(CommandLimiter::new(method, limiter, model));
    }
    if !subset.is_whole() {
        method = Box::new(LimbFollower::new(method, subset, model));
    }
    method
}
