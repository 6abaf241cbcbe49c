use crate::ports::MethodProcess;
use crate::{
    Blend, ControlError, ControlMethod, DeadMan, EndEffectorJog, FollowsLimb, GazeAssisted,
    GazeAssistedProfile, GazeToggled, Guide, JointJog, JointSubset, Limited, PipeMethod, Profile,
};
use proact_arm::ArmModel;

/// The methods that [`build`] knows.
pub const METHODS: [&str; 4] = ["A", "B", "C", "D"];

/// The method called `method` as `profile` describes it, for the arm `model`, with the profile's safeguards around
/// it: an assistant that shares the speeds, dead man, limiter, and the joints of the person's own limb.
///
/// # Errors
/// [`ControlError::Method`] with the names there are; a profile that does not fit the arm; C and D for part of an
/// arm, or with an assistant.
///
/// ```
/// # fn main() -> Result<(), proact_control::ControlError> {
/// # let model = proact_arm::ArmModel { name: "none".into(), links: vec![], joints: vec![], arm: vec![],
/// #     hand: vec![], tip: 0, poses: vec![], allowed_collisions: vec![], grasp_centre: Default::default(),
/// #     grasp: Default::default() };
/// let profile = proact_control::Profile::named("default")?;
/// let method = proact_control::build("D", &profile, &model)?;
/// assert_eq!(method.name(), "D");
/// assert!(proact_control::build("E", &profile, &model).is_err());
/// # Ok(())
/// # }
/// ```
pub fn build(
    method: &str,
    profile: &Profile,
    model: &ArmModel,
) -> Result<Box<dyn ControlMethod>, ControlError> {
    profile.check()?;
    let known = METHODS.iter().find(|name| **name == method);
    let Some(&name) = known else {
        return Err(ControlError::Method { got: method.to_owned(), known: METHODS.join(", ") });
    };
    let subset = JointSubset::new(profile, model)?;
    let gazes = matches!(name, "C" | "D");
    if gazes && !subset.is_whole() {
        return Err(ControlError::Unsupported {
            method: name.to_owned(),
            reason: "plans for the whole arm: choose level = \"shoulder\", or method A or B",
        });
    }
    if profile.blend.is_some() && gazes {
        return Err(ControlError::Unsupported {
            method: name.to_owned(),
            reason: "plans its motions, there is no speed to blend: leave profile.blend out, or use method A or B",
        });
    }
    let built: Box<dyn ControlMethod> = match (name, profile.gaze_assisted) {
        ("A", _) => Box::new(JointJog::new(profile, model, &subset)?),
        ("B", _) => Box::new(EndEffectorJog::new(profile, model, &subset)),
        (name, GazeAssistedProfile::LockOnce(rules)) => Box::new(GazeAssisted::with(name, rules)),
        (name, GazeAssistedProfile::ToggleLocks(rules)) => Box::new(GazeToggled::new(name, rules, model)),
    };
    Ok(guarded(built, profile, subset, model))
}

/// The method in `process`, with the same safeguards as [`build`] puts around the others.
///
/// # Errors
/// A profile that does not fit the arm.
pub fn build_outside(
    process: impl MethodProcess + 'static,
    profile: &Profile,
    model: &ArmModel,
) -> Result<Box<dyn ControlMethod>, ControlError> {
    profile.check()?;
    let subset = JointSubset::new(profile, model)?;
    Ok(guarded(Box::new(PipeMethod::new(process)), profile, subset, model))
}

fn guarded(
    mut method: Box<dyn ControlMethod>,
    profile: &Profile,
    subset: JointSubset,
    model: &ArmModel,
) -> Box<dyn ControlMethod> {
    if let Some(blend) = &profile.blend {
        let assistant = Guide::new(blend, profile, &subset, model);
        method = Box::new(Blend::new(method, assistant, blend.share));
    }
    method = Box::new(DeadMan::new(method));
    if let Some(limiter) = &profile.limiter {
        method = Box::new(Limited::new(method, limiter, model));
    }
    if !subset.is_whole() {
        method = Box::new(FollowsLimb::new(method, subset, model));
    }
    method
}
