use crate::ConfigError;
use proact_types::number_text;
use serde::{Deserialize, Deserializer, Serialize};
use std::{collections::BTreeMap, fmt, str::FromStr};

/// Settings of the planner. Angles in radians, lengths in metres.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
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
    /// Random arm postures from which each hand pose is sought, besides the present one: near it at first, then anywhere.
    pub postures: usize,
    /// Ways of reaching the goal after which no more are looked for.
    pub goals: usize,
    /// What searches in joint space.
    pub name: PlannerName,
    /// Its parameters by OMPL's names, such as `goal_bias`, and their values as text.
    #[serde(skip_serializing_if = "BTreeMap::is_empty", deserialize_with = "texts")]
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
    pub shortcuts: u32,
    /// Largest change of the joint vector between two checked states, rad (L2).
    pub step_rad: f64,
    /// Farthest that any point of the arm moves between two checked states, metres.
    pub step_metres: f64,
    /// Looks at motions in equal steps of this share of the joint space's extent instead, and simplifies paths to
    /// the end: what OMPL does by itself, as in the original. For comparison; it misses contacts.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub equal_steps: Option<f64>,
}

impl Default for SearchLimits {
    /// 0.02 rad and 5 mm between checked states; the padding in transit covers what could hide between them.
    fn default() -> Self {
        Self {
            max_iterations: 2000,
            max_secs: None,
            more_searches: 4,
            range_rad: 0.8,
            shortcuts: 20,
            step_rad: 0.02,
            step_metres: 0.005,
            equal_steps: None,
        }
    }
}

/// Values as text: OMPL takes nothing else, and people write numbers.
fn texts<'de, D: Deserializer<'de>>(deserializer: D) -> Result<BTreeMap<String, String>, D::Error> {
    #[derive(Deserialize)]
    #[serde(untagged)]
    enum Written {
        Text(String),
        Flag(bool),
        Whole(i64),
        Number(f64),
    }
    let written = BTreeMap::<String, Written>::deserialize(deserializer)?;
    let text = |value| match value {
        Written::Text(text) => text,
        Written::Flag(flag) => flag.to_string(),
        Written::Whole(number) => number.to_string(),
        Written::Number(number) => number.to_string(),
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
            |key, got: f64, expected| Err(ConfigError::Value { key, got: number_text(got), expected });
        // The least of each is far below any use: with less, a path would have more points than memory holds.
        let search = &self.search;
        for (key, value, range, expected) in [
            ("planner.max_velocity", self.max_velocity, 0.01..=100.0, "0.01 to 100"),
            ("planner.max_acceleration", self.max_acceleration, 0.01..=100.0, "0.01 to 100"),
            ("planner.approach_height", self.approach_height, 0.001..=2.0, "0.001 to 2"),
            ("planner.lift_height", self.lift_height, 0.001..=2.0, "0.001 to 2"),
            ("planner.retreat_height", self.retreat_height, 0.001..=2.0, "0.001 to 2"),
            ("planner.search.range_rad", search.range_rad, 0.001..=100.0, "0.001 to 100"),
            ("planner.search.step_rad", search.step_rad, 0.001..=100.0, "0.001 to 100"),
            ("planner.search.step_metres", search.step_metres, 0.0001..=100.0, "0.0001 to 100"),
            ("planner.padding", self.padding, 0.0..=1.0, "0 to 1"),
            ("planner.contact_padding", self.contact_padding, 0.0..=1.0, "0 to 1"),
            ("planner.graze_depth", self.graze_depth, 0.0..=1.0, "0 to 1"),
            ("planner.place_gap", self.place_gap, 0.0..=1.0, "0 to 1"),
            ("planner.place_tilt", self.place_tilt, 0.0..=3.2, "0 to 3.2"),
            ("planner.place_tolerance", self.place_tolerance, 0.0..=1.0, "0 to 1"),
        ] {
            if !range.contains(&value) {
                return refused(key, value, expected);
            }
        }
        for (key, count, least) in [("planner.goals", self.goals, 1), ("planner.postures", self.postures, 0)]
        {
            if !(least..=1000).contains(&count) {
                return refused(key, count as f64, if least == 0 { "0 to 1000" } else { "1 to 1000" });
            }
        }
        for (key, count, most, expected) in [
            ("planner.search.more_searches", search.more_searches, 1000, "at most 1000"),
            ("planner.search.shortcuts", search.shortcuts, 100_000, "at most 100000"),
        ] {
            if count > most {
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
        if self.max_jerk.is_nan() || self.max_jerk < 0.01 {
            return refused("planner.max_jerk", self.max_jerk, "0.01 or more, or inf");
        }
        if let Some(share) = self.search.equal_steps.filter(|share| !(1e-4..=1.0).contains(share)) {
            return refused("planner.search.equal_steps", share, "0.0001 to 1, or none");
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
