//! The results that tasks write, key by key. Read only to be checked.
#![expect(dead_code, reason = "reading is the check")]

use crate::{Arrangement, Norm, ObjectResult, result_keys::present};
use serde::Deserialize;

type Number = Option<f64>;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct OfTargets {
    on_target: u32,
    objects: u32,
    #[serde(deserialize_with = "present")]
    seconds: Number,
    outcomes: Vec<ObjectResult>,
    /// Of the modified test alone.
    #[serde(default)]
    arrangement: Option<Arrangement>,
    #[serde(default)]
    norms: Vec<Norm>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct OfAcross {
    crossed: u32,
    objects: u32,
    grasps: u32,
    on_floor: u32,
    crossings: Vec<Crossing>,
    #[serde(default)]
    norms: Vec<Norm>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Crossing {
    object: String,
    seconds: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct OfMoves {
    moved: u32,
    of_moves: u32,
    #[serde(deserialize_with = "present")]
    seconds: Number,
    fell: u32,
    moves: Vec<MoveLine>,
    #[serde(default)]
    norms: Vec<Norm>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct MoveLine {
    number: u32,
    object: String,
    done: bool,
    fell: bool,
    grasps: u32,
    #[serde(deserialize_with = "present")]
    pick_s: Number,
    #[serde(deserialize_with = "present")]
    place_s: Number,
    #[serde(deserialize_with = "present")]
    seconds: Number,
    #[serde(deserialize_with = "present")]
    distance_m: Number,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct OfGoals {
    reached: u32,
    asked: u32,
    shown: u32,
    #[serde(deserialize_with = "present")]
    completion_rate: Number,
    #[serde(deserialize_with = "present")]
    completion_s: Number,
    #[serde(deserialize_with = "present")]
    overshoots: Number,
    #[serde(deserialize_with = "present")]
    goal_path_efficiency: Number,
    /// Of balls alone, as the next.
    #[serde(default)]
    throughput_bits_per_s: Number,
    #[serde(default)]
    effective_throughput_bits_per_s: Number,
    goals: Vec<GoalLine>,
    #[serde(default)]
    norms: Vec<Norm>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct GoalLine {
    number: u32,
    counts: bool,
    reached: bool,
    seconds: f64,
    overshoots: u32,
    #[serde(deserialize_with = "present")]
    path_efficiency: Number,
    /// Of balls alone, as those that follow; the last two of balls that count.
    #[serde(default)]
    condition: Option<u32>,
    #[serde(default)]
    width_m: Number,
    #[serde(default)]
    off_m: Number,
    #[serde(default)]
    distance_m: Number,
    #[serde(default)]
    difficulty_bits: Number,
}

/// The keys that the modified test repeats beside the result.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Beside {
    arrangement: Arrangement,
    on_target: u32,
    outcomes: Vec<ObjectResult>,
}
