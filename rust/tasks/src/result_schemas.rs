//! The results that tasks write, key by key. Read only to be checked.
#![expect(dead_code, reason = "reading is the check")]

use crate::{Arrangement, NormativeScore, ObjectResult, result_check::required_nullable};
use serde::Deserialize;

type NullableNumber = Option<f64>;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct TargetsResult {
    on_target: u32,
    objects: u32,
    #[serde(deserialize_with = "required_nullable")]
    seconds: NullableNumber,
    outcomes: Vec<ObjectResult>,
    /// Of the modified test alone.
    #[serde(default)]
    arrangement: Option<Arrangement>,
    #[serde(default)]
    norms: Vec<NormativeScore>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct CrossingResult {
    crossed: u32,
    objects: u32,
    grasps: u32,
    on_floor: u32,
    crossings: Vec<CrossingTime>,
    #[serde(default)]
    norms: Vec<NormativeScore>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct CrossingTime {
    object: String,
    seconds: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct MovesResult {
    moved: u32,
    of_moves: u32,
    #[serde(deserialize_with = "required_nullable")]
    seconds: NullableNumber,
    fell: u32,
    moves: Vec<MoveLine>,
    #[serde(default)]
    norms: Vec<NormativeScore>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct MoveLine {
    number: u32,
    object: String,
    done: bool,
    fell: bool,
    grasps: u32,
    #[serde(deserialize_with = "required_nullable")]
    pick_s: NullableNumber,
    #[serde(deserialize_with = "required_nullable")]
    place_s: NullableNumber,
    #[serde(deserialize_with = "required_nullable")]
    seconds: NullableNumber,
    #[serde(deserialize_with = "required_nullable")]
    distance_m: NullableNumber,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct GoalsResult {
    reached: u32,
    asked: u32,
    shown: u32,
    #[serde(deserialize_with = "required_nullable")]
    completion_rate: NullableNumber,
    #[serde(deserialize_with = "required_nullable")]
    completion_s: NullableNumber,
    #[serde(deserialize_with = "required_nullable")]
    overshoots: NullableNumber,
    #[serde(deserialize_with = "required_nullable")]
    goal_path_efficiency: NullableNumber,
    /// Of balls alone, as the next.
    #[serde(default)]
    throughput_bits_per_s: NullableNumber,
    #[serde(default)]
    effective_throughput_bits_per_s: NullableNumber,
    goals: Vec<GoalLine>,
    #[serde(default)]
    norms: Vec<NormativeScore>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct GoalLine {
    number: u32,
    counts: bool,
    reached: bool,
    seconds: f64,
    overshoots: u32,
    #[serde(deserialize_with = "required_nullable")]
    path_efficiency: NullableNumber,
    /// Of balls alone, as those that follow; the last two of balls that count.
    #[serde(default)]
    condition: Option<u32>,
    #[serde(default)]
    width_m: NullableNumber,
    #[serde(default)]
    off_m: NullableNumber,
    #[serde(default)]
    distance_m: NullableNumber,
    #[serde(default)]
    difficulty_bits: NullableNumber,
}

/// The keys that the modified test repeats beside the result.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct LegacyFields {
    arrangement: Arrangement,
    on_target: u32,
    outcomes: Vec<ObjectResult>,
}
