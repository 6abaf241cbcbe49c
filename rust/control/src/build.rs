use crate::{
    ControlError, ControlMethod, DeadMan, EndEffectorJog, FollowsLimb, GazeAssisted, GazeAssistedProfile,
    GazeToggled, JointJog, JointSubset, Limited, Profile,
};
use proact_types::ArmModel;

/// The methods that [`build`] knows.
pub const METHODS: [&str; 4] = ["A", "B", "C", "D"];

/// The method called `method` as `profile` describes it, for the arm `model`, with the profile's safeguards around
/// it: dead man, limiter, and the joints of the person's own limb.
///
/// # Errors
/// [`ControlError::Method`] with the names there are; a profile that does not fit the arm; C and D for part of an
/// arm.
///
/// ```
/// # fn main() -> Result<(), proact_control::ControlError> {
/// # let model = proact_types::ArmModel { name: "none".into(), links: vec![], joints: vec![], arm: vec![],
/// #     hand: vec![], tip: 0, poses: vec![], allowed_collisions: vec![], grasp_centre: Default::default() };
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
    let mut built: Box<dyn ControlMethod> = match (name, profile.gaze_assisted) {
        ("A", _) => Box::new(JointJog::new(profile, model, &subset)?),
        ("B", _) => Box::new(EndEffectorJog::new(profile, model, &subset)),
        (name, GazeAssistedProfile::LockOnce(rules)) => Box::new(GazeAssisted::with(name, rules)),
        (name, GazeAssistedProfile::ToggleLocks(rules)) => Box::new(GazeToggled::new(name, rules, model)),
    };
    if let Some(dead_man) = &profile.dead_man {
        built = Box::new(DeadMan::new(built, dead_man, gazes));
    }
    if let Some(limiter) = &profile.limiter {
        built = Box::new(Limited::new(built, limiter, model));
    }
    if !subset.is_whole() {
        built = Box::new(FollowsLimb::new(built, subset, model));
    }
    Ok(built)
}
