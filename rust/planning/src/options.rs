use crate::{PlannerName, PlanningError, Roadmap, SearchLimits};
use std::sync::Arc;

/// Settings of the planner. Angles in radians, lengths in metres.
#[derive(Clone, Debug, PartialEq)]
pub struct PlannerOptions {
    /// Highest speed of any arm joint, rad/s. The original's URDF limit.
    pub max_velocity: f64,
    /// Highest acceleration of any arm joint, rad/s^2. The default of the original's time parameteriser.
    pub max_acceleration: f64,
    /// Highest jerk of any arm joint, rad/s^3; infinite for none. The path may then stray by
    /// `max_acceleration^3 / (6 max_jerk^2)` rad, and takes `2 max_acceleration / max_jerk` s longer.
    pub max_jerk: f64,
    /// Free space kept around obstacles in transit. The original padded blocks by 5 mm.
    pub padding: f64,
    /// Free space kept from fixed obstacles on the straight way to and from a grasp or a place. Assumed.
    pub contact_padding: f64,
    /// Height of the straight way down to a grasp or a place. Assumed: block height plus a margin.
    pub approach_height: f64,
    /// Height of the straight lift of a carried object. Assumed, as for the approach.
    pub lift_height: f64,
    /// Height of the straight way off a block that stands between the fingers. Assumed: more than its height.
    pub retreat_height: f64,
    /// Deepest contact at the start that is treated as a graze and left by a straight way up. Assumed.
    pub graze_depth: f64,
    /// Free space under an object when it is let go. Assumed.
    pub place_gap: f64,
    /// Largest angle between a placed object's axis and the vertical: it tips onto its base. Assumed.
    pub place_tilt: f64,
    /// A place that cannot be reached may be missed by this much toward the arm. Assumed: a third of the radius
    /// within which a block counts.
    pub place_tolerance: f64,
    /// Random arm postures from which each hand pose is sought, besides the present one.
    pub postures: usize,
    /// Ways of reaching the goal after which no more are looked for.
    pub goals: usize,
    /// What searches in joint space.
    pub planner: PlannerName,
    /// Its parameters by OMPL's names, such as `goal_bias`, and their values as text.
    pub planner_parameters: Vec<(String, String)>,
    /// What PRM begins with; none for a roadmap made anew for each request.
    pub roadmap: Option<Arc<Roadmap>>,
    /// Bounds of one search in joint space.
    pub search: SearchLimits,
    /// Time by which a request is answered, seconds, for live use; none for repeatable replies.
    pub deadline_secs: Option<f64>,
}

impl Default for PlannerOptions {
    fn default() -> Self {
        Self {
            max_velocity: 0.5,
            max_acceleration: 1.0,
            max_jerk: 10.0,
            padding: 0.005,
            contact_padding: 0.001,
            approach_height: 0.08,
            lift_height: 0.08,
            retreat_height: 0.07,
            graze_depth: 0.012,
            place_gap: 0.0015,
            place_tilt: 12_f64.to_radians(),
            place_tolerance: 0.016,
            postures: 8,
            goals: 6,
            planner: PlannerName::default(),
            planner_parameters: Vec::new(),
            roadmap: None,
            search: SearchLimits::default(),
            deadline_secs: None,
        }
    }
}

impl Default for SearchLimits {
    /// 0.02 rad and 5 mm between checked states; the padding in transit covers what could hide between them.
    fn default() -> Self {
        Self {
            max_iterations: 2000,
            max_secs: None,
            more_searches: 4,
            range_rad: 0.8,
            shortcuts: 40,
            step_rad: 0.02,
            step_metres: 0.005,
            equal_steps: None,
        }
    }
}

impl PlannerOptions {
    /// Refuses settings with which no plan makes sense.
    ///
    /// # Errors
    /// [`PlanningError::Option`] naming the first bad one; a parameter that the planner does not know.
    pub fn validate(&self) -> Result<(), PlanningError> {
        let positive = [
            ("max_velocity", self.max_velocity),
            ("max_acceleration", self.max_acceleration),
            ("approach_height", self.approach_height),
            ("lift_height", self.lift_height),
            ("retreat_height", self.retreat_height),
            ("search.range_rad", self.search.range_rad),
            ("search.step_rad", self.search.step_rad),
            ("search.step_metres", self.search.step_metres),
            ("goals", self.goals as f64),
        ];
        let not_negative = [
            ("padding", self.padding),
            ("contact_padding", self.contact_padding),
            ("graze_depth", self.graze_depth),
            ("place_gap", self.place_gap),
            ("place_tilt", self.place_tilt),
        ];
        let refused = |name, value, expected| Err(PlanningError::Option { name, value, expected });
        for (name, bound) in
            [("deadline_secs", self.deadline_secs), ("search.max_secs", self.search.max_secs)]
        {
            if let Some(value) = bound.filter(|secs| !(1e-3..=3600.0).contains(secs)) {
                return refused(name, value, "0.001 to 3600 s, or none");
            }
        }
        if self.max_jerk.is_nan() || self.max_jerk <= 0.0 {
            return refused("max_jerk", self.max_jerk, "a number above zero, or infinity");
        }
        for (name, value) in positive {
            if !(value.is_finite() && value > 0.0) {
                return refused(name, value, "a number above zero");
            }
        }
        for (name, value) in not_negative {
            if !(value.is_finite() && value >= 0.0) {
                return refused(name, value, "a number not below zero");
            }
        }
        crate::scene::check_planner(self.planner, &self.planner_parameters)
    }
}
