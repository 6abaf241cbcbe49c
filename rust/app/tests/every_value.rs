//! Every number of a trial's configuration, at values that nobody means: each is refused by name, or a trial of it runs
//! without a panic, and ends.
#![allow(clippy::disallowed_methods, clippy::unwrap_used)] // A test with threads and a clock.

use proact_app::trial;
use proact_devices::EmgOrigin;
use proact_emg::EmgConfig;
use proact_testbed::{Setup, TrialConfig};
use std::{
    panic::{AssertUnwindSafe, catch_unwind},
    sync::{
        atomic::{AtomicUsize, Ordering},
        mpsc::channel,
    },
    thread,
    time::Duration,
};

/// What a number is set to.
const VALUES: [&str; 9] = ["nan", "-1.0", "0.0", "1e-300", "1e300", "inf", "-1", "0", "9223372036854775807"];
/// What a list of numbers is set to.
const LISTS: [&str; 5] = ["[]", "[nan, nan, nan]", "[-1e300, 1e300, 1e300]", "[1, 2]", "[0.0]"];
/// A trial is this long: long enough for a plan and a movement.
const TICKS: u64 = 2500;
/// None of these trials takes a second; a machine under load may take many.
const PATIENCE: Duration = Duration::from_secs(120);

/// Trials between which all sections of a configuration are there.
const BASES: [&[&str]; 4] = [
    &["method=D"],
    &["method=A", "profile.jog={ pace = \"message\", nominal_ms = 50, joint_state_ms = 20 }"],
    &["method=B", "profile.blend={}", "physics.grasp_rule=original", "physics.joint_control=original_gains"],
    &["method=D", "intent_model=filtered", "planner.deadline_secs=1.0", "physics.engine=ode"],
];

fn config(assignments: &[&str]) -> Result<TrialConfig, String> {
    let mut config = TrialConfig::new("D", 1, Setup::named("seated").unwrap());
    config.limit_secs = 30.0;
    config.emg = Some(EmgConfig::default());
    config.participant = Some(Default::default());
    config.with_values(assignments).map_err(|error| error.to_string())
}

/// The keys of numbers and of lists of numbers below `prefix`, with what they are set to in turn.
fn cases(prefix: &str, table: &toml::Table, found: &mut Vec<(String, Vec<&'static str>)>) {
    for (name, value) in table {
        let key = if prefix.is_empty() { name.clone() } else { format!("{prefix}.{name}") };
        match value {
            toml::Value::Table(inner) => cases(&key, inner, found),
            toml::Value::Float(_) | toml::Value::Integer(_) => found.push((key, VALUES.to_vec())),
            toml::Value::Array(list) if list.iter().all(|v| v.is_float() || v.is_integer()) => {
                found.push((key, LISTS.to_vec()));
            }
            _ => {}
        }
    }
}

/// Why the trial is refused; nothing if it runs.
fn run(assignments: &[&str]) -> Option<String> {
    let config = match config(assignments) {
        Ok(config) => config,
        Err(refusal) => return Some(refusal),
    };
    let mut session = match trial::simulated(config, &EmgOrigin::Synthetic) {
        Ok(assembly) => assembly.session,
        Err(refusal) => return Some(refusal.to_string()),
    };
    for _ in 0..TICKS {
        match session.step(false) {
            Ok(step) if step.output.finished => break,
            Ok(_) => {}
            Err(refusal) => return Some(refusal.to_string()),
        }
    }
    None
}

#[test]
fn no_number_of_a_configuration_makes_a_trial_panic_or_hang() {
    let mut all: Vec<(Vec<&str>, String)> = Vec::new();
    let mut seen = std::collections::BTreeSet::new();
    for base in BASES {
        let text = config(base).unwrap().to_toml().unwrap();
        let mut found = Vec::new();
        cases("", &toml::from_str(&text).unwrap(), &mut found);
        for (key, values) in found {
            if seen.insert(key.clone()) {
                all.extend(values.iter().map(|value| (base.to_vec(), format!("{key}={value}"))));
            }
        }
    }
    assert!(seen.len() > 100, "{} keys: the search is broken", seen.len());

    let next = AtomicUsize::new(0);
    let work = || {
        let mut bad = Vec::new();
        while let Some((base, assignment)) = all.get(next.fetch_add(1, Ordering::Relaxed)) {
            // What allocates without bound ends the process: the last line tells what it was.
            eprintln!("{assignment}");
            let asked: Vec<String> = base.iter().map(|&a| a.to_owned()).chain([assignment.clone()]).collect();
            let (done, wait) = channel();
            thread::spawn(move || {
                let asked: Vec<&str> = asked.iter().map(String::as_str).collect();
                let ended = catch_unwind(AssertUnwindSafe(|| run(&asked)));
                done.send(ended.is_ok()).ok();
            });
            match wait.recv_timeout(PATIENCE) {
                Ok(true) => {}
                Ok(false) => bad.push(format!("{assignment} panics (with {base:?})")),
                Err(_) => bad.push(format!("{assignment} does not end (with {base:?})")),
            }
        }
        bad
    };
    let bad = thread::scope(|scope| {
        let workers = [scope.spawn(work), scope.spawn(work)];
        workers.map(|worker| worker.join().unwrap()).concat()
    });
    assert!(bad.is_empty(), "{} of {}:\n{}", bad.len(), all.len(), bad.join("\n"));
}
