//! What the result of a task may hold, for whoever reads one back: a key that no task writes is an error that names it.

use crate::{
    NormativeScore, ObjectResult,
    result_schemas::{CrossingResult, GoalsResult, LegacyFields, MovesResult, TargetsResult},
};
use serde::{Deserialize, Deserializer};
use serde_json::{Map, Value};

/// A result is not one that a task writes.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the result of the task is not readable: {reason}")]
pub struct ResultError {
    reason: String,
}

/// For `deserialize_with`: a value that may be null, under a key that must be there.
pub(crate) fn required_nullable<'de, D: Deserializer<'de>, T: Deserialize<'de>>(
    from: D,
) -> Result<Option<T>, D::Error> {
    Option::deserialize(from)
}

/// Reads a result as one kind of task writes it, and forgets it again.
type ResultCheck = fn(Value) -> Result<(), serde_json::Error>;

fn check_as<T: serde::de::DeserializeOwned>(value: Value) -> Result<(), serde_json::Error> {
    serde_json::from_value::<T>(value).map(drop)
}

/// Each kind of result, with keys by which it is known.
const KINDS: [(&[&str], ResultCheck); 4] = [
    (&["on_target", "objects", "seconds", "outcomes"], check_as::<TargetsResult>),
    (&["crossed", "objects", "grasps", "on_floor", "crossings"], check_as::<CrossingResult>),
    (&["moved", "of_moves", "seconds", "fell", "moves"], check_as::<MovesResult>),
    (&["reached", "asked", "shown", "completion_rate", "completion_s", "goals"], check_as::<GoalsResult>),
];

/// Refuses what is not the result of a task: the keys are those of one kind of task, each line has its own, and every
/// outcome is known.
///
/// # Errors
/// [`ResultError`] with the key or the outcome.
pub fn check_result(result: &Map<String, Value>) -> Result<(), ResultError> {
    let common =
        |(keys, _): &&(&[&str], ResultCheck)| keys.iter().filter(|key| result.contains_key(**key)).count();
    let kind = KINDS.iter().max_by_key(common).filter(|kind| common(kind) > 0);
    let Some((_, check)) = kind else {
        let got: Vec<&str> = result.keys().map(String::as_str).collect();
        let expected: Vec<String> = KINDS.iter().map(|(keys, _)| keys.join(", ")).collect();
        let reason =
            format!("its keys are {}; expected those of a task: {}", got.join(", "), expected.join("; or "));
        return Err(ResultError { reason });
    };
    check(Value::Object(result.clone())).map_err(result_error)
}

/// Refuses other keys beside a result than those of [`TaskResult::legacy_fields`](crate::TaskResult::beside).
///
/// # Errors
/// [`ResultError`] with the key or the outcome.
pub fn check_legacy_fields(beside: &Map<String, Value>) -> Result<(), ResultError> {
    match beside.is_empty() {
        true => Ok(()),
        false => check_as::<LegacyFields>(Value::Object(beside.clone())).map_err(result_error),
    }
}

/// What became of each object; none of a task that tells of other things.
///
/// # Errors
/// [`ResultError`] with the key or the outcome that is unknown.
pub fn object_results(result: &Map<String, Value>) -> Result<Vec<ObjectResult>, ResultError> {
    let Some(lines) = result.get("outcomes") else { return Ok(Vec::new()) };
    serde_json::from_value(lines.clone()).map_err(result_error)
}

/// Norms beside a score; none where there are none.
///
/// # Errors
/// [`ResultError`] with the key that is unknown.
pub fn norms_in_result(result: &Map<String, Value>) -> Result<Vec<NormativeScore>, ResultError> {
    let Some(norms) = result.get("norms") else { return Ok(Vec::new()) };
    serde_json::from_value(norms.clone()).map_err(result_error)
}

fn result_error(error: serde_json::Error) -> ResultError {
    ResultError { reason: error.to_string() }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::{BUILT_IN_TASKS, DEFAULT_TASK, TaskInput, TaskResult, TaskSpec};
    use proact_types::{BodyState, Point, SimTime, Vector};

    fn results() -> Vec<(String, TaskResult)> {
        let tasks = BUILT_IN_TASKS.iter().map(|(name, _)| *name).chain([DEFAULT_TASK]);
        let result = |name: &str| {
            let mut task = TaskSpec::named(name, 1).unwrap().build(false).unwrap();
            let still = |pose| BodyState {
                pose,
                linear_velocity: Vector::zeros(),
                angular_velocity: Vector::zeros(),
            };
            let objects: Vec<BodyState> = task.scene().objects.iter().map(|o| still(o.pose)).collect();
            task.check_arm(&[[-3.0, 3.0]; 7]).unwrap();
            for tick in 1..20_000 {
                let input = TaskInput {
                    objects: &objects,
                    held: None,
                    fingertips: &[],
                    joints: &[0.0; 7],
                    hand: Point::origin(),
                };
                task.step(SimTime(tick), &input);
            }
            (name.to_owned(), task.result(&objects))
        };
        tasks.map(result).collect()
    }

    /// Calls `seen` with the place of each key in `value` that no number of a list stands for.
    fn each_key(value: &Value, pointer: &str, seen: &mut impl FnMut(&str, &str)) {
        match value {
            Value::Object(map) => {
                for (key, inner) in map {
                    seen(pointer, key);
                    each_key(inner, &format!("{pointer}/{key}"), seen);
                }
            }
            Value::Array(lines) => {
                for (k, inner) in lines.iter().enumerate() {
                    each_key(inner, &format!("{pointer}/{k}"), seen);
                }
            }
            _ => {}
        }
    }

    // Catches a task that writes a key which nobody could read back, and a key that could vanish without a word.
    #[test]
    fn every_task_s_result_is_read_and_each_of_its_keys_renamed_is_named() {
        let mut renamed = 0;
        for (name, task) in results() {
            check_result(&task.result).unwrap_or_else(|error| panic!("{name}: {error}"));
            check_legacy_fields(&task.legacy_fields).unwrap_or_else(|error| panic!("{name}: {error}"));
            type Checks = fn(&Map<String, Value>) -> Result<(), ResultError>;
            for (map, check) in
                [(task.result, check_result as Checks), (task.legacy_fields, check_legacy_fields)]
            {
                let whole = Value::Object(map);
                each_key(&whole, "", &mut |pointer, key| {
                    let mut other = whole.clone();
                    let object = other.pointer_mut(pointer).unwrap().as_object_mut().unwrap();
                    let value = object.remove(key).unwrap();
                    object.insert(format!("{key}_x"), value);
                    let error = check(other.as_object().unwrap()).expect_err(key).to_string();
                    assert!(error.contains(key), "{name} {pointer}/{key}: {error}");
                    renamed += 1;
                });
            }
        }
        assert!(renamed > 50, "{renamed}");
    }

    #[test]
    fn an_unknown_outcome_is_named() {
        let (_, task) = results().into_iter().find(|(name, _)| name == DEFAULT_TASK).unwrap();
        let mut result = task.result;
        result["outcomes"][2]["outcome"] = "on_tarqet".into();
        for error in [check_result(&result), object_results(&result).map(drop)] {
            assert!(error.unwrap_err().to_string().contains("on_tarqet"));
        }
    }
}
