use crate::ConfigError;
use proact_types::format_number;
use serde::{Deserialize, Deserializer, Serialize};
use std::{collections::BTreeMap, fmt, str::FromStr};

/// Settings of the planner. Angles in radians, lengths in metres.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PlannerOptions {
    /// Highest speed of any arm joint, rad/s. The original's URDF limit.
    pub max_velocity_rad_per_s: f64,
    /// Highest acceleration `a` of any arm joint, rad/s^2. The default of the original's time parameteriser.
    pub max_acceleration_rad_per_s2: f64,
    /// Highest jerk `j` of any arm joint, rad/s^3; infinite for none. The path may then stray by
    /// `a^3 / (6 j^2)` rad, and takes `2 a / j` s longer.
    pub max_jerk_rad_per_s3: f64,
    /// Free space kept around obstacles in transit. The original padded blocks by 5 mm.
    pub padding_m: f64,
    /// Free space kept from fixed obstacles on the straight way to and from a grasp or a place. Assumed.
    pub contact_padding_m: f64,
    /// Height of the straight way down to a grasp or a place. Assumed: block height plus a margin.
    pub approach_height_m: f64,
    /// Height of the straight lift of a carried object. Assumed, as for the approach.
    pub lift_height_m: f64,
    /// Height of the straight way off a block that stands between the fingers. Assumed: more than its height.
    pub retreat_height_m: f64,
    /// Deepest contact at the start that is treated as a graze and left by a straight way up. Assumed.
    pub start_contact_tolerance_m: f64,
    /// Free space under an object when it is let go. Assumed.
    pub place_gap_m: f64,
    /// Largest angle between a placed object's axis and the vertical: it tips onto its base. Assumed.
    pub place_tilt_rad: f64,
    /// A place that cannot be reached may be missed by this much toward the arm. Assumed: a third of the radius
    /// within which a block counts.
    pub place_tolerance_m: f64,
    /// Random arm postures from which each hand pose is sought, besides the present one: near it at first, then anywhere.
    pub ik_seeds: usize,
    /// Ways of reaching the goal after which no more are looked for.
    pub max_goal_postures: usize,
    /// What searches in joint space.
    pub name: PlannerName,
    /// Its parameters by OMPL's names, such as `goal_bias`, and their values as text.
    #[serde(skip_serializing_if = "BTreeMap::is_empty", deserialize_with = "parameters_as_text")]
    pub parameters: BTreeMap<String, String>,
    /// Bounds of one search in joint space.
    pub search: SearchLimits,
    /// Time by which a request is answered, seconds, for live use; none for repeatable replies.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub deadline_secs: Option<f64>,
}

impl Default for PlannerOptions {
    fn default() -> Self {
        Self {
            max_velocity_rad_per_s: 0.5,
            max_acceleration_rad_per_s2: 1.0,
            max_jerk_rad_per_s3: 10.0,
            padding_m: 0.005,
            contact_padding_m: 0.001,
            approach_height_m: 0.08,
            lift_height_m: 0.08,
            retreat_height_m: 0.07,
            start_contact_tolerance_m: 0.012,
            place_gap_m: 0.0015,
            place_tilt_rad: 12_f64.to_radians(),
            place_tolerance_m: 0.016,
            ik_seeds: 8,
            max_goal_postures: 6,
            name: PlannerName::default(),
            parameters: BTreeMap::new(),
            search: SearchLimits::default(),
            deadline_secs: None,
        }
    }
}

/// What bounds one search in joint space.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SearchLimits {
    /// Iterations of the planner.
    pub max_iterations: u32,
    /// Seconds, beside the iterations. With it equal requests no longer get equal replies.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_secs: Option<f64>,
    /// Searches after the first that succeeded, by RRTConnect and BiTRRT, for goals to which a path could be quicker,
    /// as long as ways are found easily; the best of all paths, by time and length, is the outcome.
    pub more_searches: u32,
    /// Longest motion added to a tree, rad (L2); for planners that grow trees.
    pub range_rad: f64,
    /// Attempts to shorten the path.
    pub shortcut_attempts: u32,
    /// Largest change of the joint vector between two checked states, rad (L2).
    pub step_rad: f64,
    /// Farthest that any point of the arm moves between two checked states, metres.
    pub step_m: f64,
    /// Looks at motions in equal steps of this share of the joint space's extent instead, and simplifies paths to
    /// the end: what OMPL does by itself, as in the original. For comparison; it misses contacts.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fixed_validity_step: Option<f64>,
}

impl Default for SearchLimits {
    /// 0.02 rad and 5 mm between checked states; the padding in transit covers what could hide between them.
    fn default() -> Self {
        Self {
            max_iterations: 2000,
            max_secs: None,
            more_searches: 4,
            range_rad: 0.8,
            shortcut_attempts: 20,
            step_rad: 0.02,
            step_m: 0.005,
            fixed_validity_step: None,
        }
    }
}

/// Values as text: OMPL takes nothing else, and people write numbers.
fn parameters_as_text<'de, D: Deserializer<'de>>(
    deserializer: D,
) -> Result<BTreeMap<String, String>, D::Error> {
    #[derive(Deserialize)]
    #[serde(untagged)]
    enum ParameterValue {
        Text(String),
        Flag(bool),
        Whole(i64),
        Number(f64),
    }
    let written = BTreeMap::<String, ParameterValue>::deserialize(deserializer)?;
    let text = |value| match value {
        ParameterValue::Text(text) => text,
        ParameterValue::Flag(flag) => flag.to_string(),
        ParameterValue::Whole(number) => number.to_string(),
        ParameterValue::Number(number) => number.to_string(),
    };
    Ok(written.into_iter().map(|(name, value)| (name, text(value))).collect())
}

impl PlannerOptions {
    /// Refuses settings with which no plan makes sense. Whether the planner knows its parameters, it is asked itself when
    /// it is made.
    ///
    /// # Errors
    /// [`ConfigError::Value`] naming the first bad one.
    pub fn check(&self) -> Result<(), ConfigError> {
        let refused =
            |key, got: f64, expected| Err(ConfigError::Value { key, got: format_number(got), expected });
        // The least of each is far below any use: with less, a path would have more points than memory holds.
        let search = &self.search;
        for (key, value, range, expected) in [
            ("planner.max_velocity_rad_per_s", self.max_velocity_rad_per_s, 0.01..=100.0, "0.01 to 100"),
            (
                "planner.max_acceleration_rad_per_s2",
                self.max_acceleration_rad_per_s2,
                0.01..=100.0,
                "0.01 to 100",
            ),
            ("planner.approach_height_m", self.approach_height_m, 0.001..=2.0, "0.001 to 2"),
            ("planner.lift_height_m", self.lift_height_m, 0.001..=2.0, "0.001 to 2"),
            ("planner.retreat_height_m", self.retreat_height_m, 0.001..=2.0, "0.001 to 2"),
            ("planner.search.range_rad", search.range_rad, 0.001..=100.0, "0.001 to 100"),
            ("planner.search.step_rad", search.step_rad, 0.001..=100.0, "0.001 to 100"),
            ("planner.search.step_m", search.step_m, 0.0001..=100.0, "0.0001 to 100"),
            ("planner.padding_m", self.padding_m, 0.0..=1.0, "0 to 1"),
            ("planner.contact_padding_m", self.contact_padding_m, 0.0..=1.0, "0 to 1"),
            ("planner.start_contact_tolerance_m", self.start_contact_tolerance_m, 0.0..=1.0, "0 to 1"),
            ("planner.place_gap_m", self.place_gap_m, 0.0..=1.0, "0 to 1"),
            ("planner.place_tilt_rad", self.place_tilt_rad, 0.0..=3.2, "0 to 3.2"),
            ("planner.place_tolerance_m", self.place_tolerance_m, 0.0..=1.0, "0 to 1"),
        ] {
            if !range.contains(&value) {
                return refused(key, value, expected);
            }
        }
        for (key, count, min) in
            [("planner.max_goal_postures", self.max_goal_postures, 1), ("planner.ik_seeds", self.ik_seeds, 0)]
        {
            if !(min..=1000).contains(&count) {
                return refused(key, count as f64, if min == 0 { "0 to 1000" } else { "1 to 1000" });
            }
        }
        for (key, count, max, expected) in [
            ("planner.search.more_searches", search.more_searches, 1000, "at most 1000"),
            ("planner.search.shortcut_attempts", search.shortcut_attempts, 100_000, "at most 100000"),
        ] {
            if count > max {
                return refused(key, f64::from(count), expected);
            }
        }
        if search.max_iterations > 1_000_000 && search.max_secs.is_none() {
            let expected = "at most 1000000 without planner.search.max_secs";
            return refused("planner.search.max_iterations", f64::from(search.max_iterations), expected);
        }
        for (key, bound) in
            [("planner.deadline_secs", self.deadline_secs), ("planner.search.max_secs", self.search.max_secs)]
        {
            if let Some(value) = bound.filter(|secs| !(1e-3..=3600.0).contains(secs)) {
                return refused(key, value, "0.001 to 3600 s, or none");
            }
        }
        if self.max_jerk_rad_per_s3.is_nan() || self.max_jerk_rad_per_s3 < 0.01 {
            return refused("planner.max_jerk_rad_per_s3", self.max_jerk_rad_per_s3, "0.01 or more, or inf");
        }
        if let Some(share) = self.search.fixed_validity_step.filter(|share| !(1e-4..=1.0).contains(share)) {
            return refused("planner.search.fixed_validity_step", share, "0.0001 to 1, or none");
        }
        Ok(())
    }
}

/// A planner of OMPL, by its name there. All are repeatable by the request's seed and bounded by iterations.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum PlannerName {
    /// Two trees that grow towards each other (Kuffner and LaValle, ICRA 2000). The quickest here.
    #[default]
    #[serde(rename = "RRTConnect")]
    RrtConnect,
    /// Two trees that avoid costly ground (Devaurs, Siméon and Cortés, 2013).
    #[serde(rename = "BiTRRT")]
    BiTrrt,
    /// Two lazy trees spread over a grid (Şucan and Kavraki, WAFR 2008): the planner of the original.
    #[serde(rename = "LBKPIECE1")]
    LbKpiece1,
    /// One tree that goes on improving until its iterations are spent (Karaman and Frazzoli, 2011): short paths,
    /// a hundred times the time of RRTConnect.
    #[serde(rename = "RRTstar")]
    RrtStar,
    /// A roadmap (Kavraki et al., 1996): made anew for each request, or begun with a stored roadmap,
    /// of which no more is looked at than a way needs (Bohlin and Kavraki, ICRA 2000).
    #[serde(rename = "PRM")]
    Prm,
    /// RRTConnect again and again until the iterations or the time are spent, and the best parts of all paths put
    /// together (Raveh, Enosh and Halperin, 2011; Luna et al., ICRA 2013).
    AnytimePathShortening,
}

impl PlannerName {
    /// All planners, the default first.
    pub const ALL: [PlannerName; 6] = [
        Self::RrtConnect,
        Self::BiTrrt,
        Self::LbKpiece1,
        Self::RrtStar,
        Self::Prm,
        Self::AnytimePathShortening,
    ];

    /// The name in OMPL.
    pub fn name(self) -> &'static str {
        match self {
            Self::RrtConnect => "RRTConnect",
            Self::BiTrrt => "BiTRRT",
            Self::LbKpiece1 => "LBKPIECE1",
            Self::RrtStar => "RRTstar",
            Self::Prm => "PRM",
            Self::AnytimePathShortening => "AnytimePathShortening",
        }
    }
}

impl fmt::Display for PlannerName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for PlannerName {
    type Err = ConfigError;

    fn from_str(text: &str) -> Result<Self, ConfigError> {
        Self::ALL.into_iter().find(|planner| planner.name() == text).ok_or_else(|| {
            let known = Self::ALL.map(Self::name).join(", ");
            ConfigError::Planner { got: text.to_owned(), known }
        })
    }
}
