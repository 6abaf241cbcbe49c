//! Arms from files, and questions about one.

use super::{TargetFn, utf8_text};
use proact_app::query::{self, QueryOptions};
use proact_description::{ImportOptions, MPL_RIGHT_ARM_URDF, check, import, parse};
use std::{fs, path::Path};

/// Longer lists would be answered, in minutes.
const MAX_MILESTONES: u64 = 100;

/// A description is judged; one that can be used answers questions, the last with a search.
pub(super) fn urdf(scratch: &Path) -> TargetFn {
    let path = scratch.join("arm.urdf");
    Box::new(move |bytes| {
        let Some(urdf) = utf8_text(bytes) else { return };
        let Some(summary) = check(urdf, None).summary else { return };
        fs::write(&path, urdf).expect("the scratch folder takes files");
        let zeros = vec![0.0; summary.arm.len()];
        let near = vec![0.1; summary.arm.len()];
        let lines = [
            serde_json::json!({ "op": "fk", "q": zeros }),
            serde_json::json!({ "op": "collision", "q": zeros, "scene": "empty" }),
            serde_json::json!({ "op": "plan", "start": zeros, "goal_q": near, "scene": "empty" }),
        ];
        let lines: String = lines.iter().map(|line| format!("{line}\n")).collect();
        let options = QueryOptions { urdf: Some(path.clone()), ..QueryOptions::default() };
        // An arm that the kinematics does not take is refused as a whole.
        let _ = query::run(options, lines.as_bytes(), Vec::new());
    })
}

pub(super) fn sdf(_: &Path) -> TargetFn {
    Box::new(|bytes| {
        if let Some(Ok(imported)) = utf8_text(bytes).map(|text| import(text, &ImportOptions::default())) {
            assert!(imported.report.usable, "what is imported passes the check: {}", imported.report);
        }
    })
}

pub(super) fn srdf(_: &Path) -> TargetFn {
    Box::new(|bytes| {
        if let Some(srdf) = utf8_text(bytes) {
            let _ = parse(MPL_RIGHT_ARM_URDF, srdf);
        }
    })
}

pub(super) fn query(_: &Path) -> TargetFn {
    Box::new(|bytes| {
        let asks_for_much = |line: &[u8]| {
            let question: Option<serde_json::Value> = serde_json::from_slice(line).ok();
            question.is_some_and(|q| q["milestones"].as_u64().is_some_and(|count| count > MAX_MILESTONES))
        };
        let lines: Vec<&[u8]> =
            bytes.split(|b| *b == b'\n').filter(|line| !asks_for_much(line)).take(5).collect();
        let mut answers = Vec::new();
        query::run(QueryOptions::default(), lines.join(&b'\n').as_slice(), &mut answers)
            .expect("bad lines are answered");
        for line in answers.split(|b| *b == b'\n').filter(|line| !line.is_empty()) {
            let answer: serde_json::Value = serde_json::from_slice(line).expect("answers are JSON");
            assert!(answer.is_object(), "{answer}");
            let numbers =
                answer["tau"].as_array().is_none_or(|tau| tau.iter().all(serde_json::Value::is_number));
            assert!(numbers, "{answer}");
        }
    })
}
