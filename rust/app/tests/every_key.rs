//! Every key of a trial's configuration does something: another value gives another trial, or is refused with the reason.
#![allow(clippy::disallowed_methods, clippy::unwrap_used)] // A test.

use proact_app::trial;
use proact_devices::EmgSource;
use proact_testbed::{MethodName, Session, Setup, SpanDigest, TrialConfig};
use proact_types::{Gesture, Pose};
use std::{
    collections::BTreeMap,
    sync::{
        Mutex,
        atomic::{AtomicUsize, Ordering},
    },
};

/// Names that are shown and recorded, and steer nothing.
const LABELS: [&str; 2] = ["setup.name", "profile.name"];

/// Other values, where the usual ones (a number a tenth larger, a flag turned over) would do nothing in so short a trial,
/// and what the trial must be for the key to matter: `key=value`, then assignments that both trials have.
const CASES: &[(&str, &[&str])] = &[];

/// Keys that a configuration leaves out unless they are set.
const OPTIONAL: &[&str] = &[];

type Run = Box<dyn Fn(&mut Session, u64)>;

#[test]
fn another_value_of_any_key_gives_another_trial_or_is_refused() {
    let text = session(&[]).unwrap().testbed().config().to_toml().unwrap();
    let table: toml::Table = toml::from_str(&text).unwrap();
    let mut keys = Vec::new();
    leaves("", &table, &mut keys);
    for key in &keys {
        let before: Vec<&str> = vec![];
        let other = match &key.1 {
            toml::Value::Float(x) if *x == 0.0 => "0.5".to_owned(),
            toml::Value::Float(x) => (x * 1.1).to_string(),
            toml::Value::Integer(x) => (x + 1).to_string(),
            toml::Value::Boolean(x) => (!x).to_string(),
            v => { println!("SKIP {} {v}", key.0); continue }
        };
        let changed = format!("{}={other}", key.0);
        let t = std::time::Instant::now();
        let verdict = verdict(&before, &changed);
        println!("{changed}: {verdict} {:.2}", t.elapsed().as_secs_f64());
    }
}

fn leaves(prefix: &str, table: &toml::Table, keys: &mut Vec<(String, toml::Value)>) {
    for (name, value) in table {
        let key = if prefix.is_empty() { name.clone() } else { format!("{prefix}.{name}") };
        match value {
            toml::Value::Table(inner) => leaves(&key, inner, keys),
            value => keys.push((key, value.clone())),
        }
    }
}

fn session(assignments: &[&str]) -> Result<Session, String> {
    let config = TrialConfig::new(MethodName::D, 1, Setup::named("seated").unwrap());
    let mut config = TrialConfig { limit_secs: 30.0, ..config };
    config.emg = Some(Default::default());
    config.participant = Some(Default::default());
    let config = config.with_values(assignments).map_err(|e| e.to_string())?;
    Ok(trial::simulated(config, &EmgSource::Synthetic).map_err(|e| e.to_string())?.session)
}

fn verdict(before: &[&str], changed: &str) -> String {
    let mut with = before.to_vec();
    with.push(changed);
    let mut other = match session(&with) {
        Ok(session) => session,
        Err(reason) => return format!("refused: {reason}"),
    };
    let mut usual = session(before).unwrap();
    loop {
        let (a, b) = (usual.step(false).unwrap().output, other.step(false).unwrap().output);
        let fields = |span: &Option<SpanDigest>| span.as_ref().map(|span| span.fields.clone());
        if fields(&a.span) != fields(&b.span) || a.finished != b.finished {
            return format!("differs at {}", usual.testbed().now().0);
        }
        if a.finished {
            return "SAME".to_owned();
        }
    }
}
