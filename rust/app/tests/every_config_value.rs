//! Every number of a trial's configuration, at values that no trial needs: each is refused by name with its range, or a trial
//! of it runs with finite numbers and ends.
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
const VALUES: [&str; 14] = [
    "nan",
    "-1.0",
    "0.0",
    // Above zero, and as good as zero to divide by: a braking distance over 1e-310 rad/s^2 was no number, and a panic.
    "5e-324",
    "-5e-324",
    "1e-310",
    "1e-30",
    "1e300",
    "-1e300",
    "1.7976931348623157e308",
    "inf",
    "-1",
    "0",
    "9223372036854775807",
];
/// What a list of numbers is set to.
const LISTS: [&str; 7] = [
    "[]",
    "[nan, nan, nan]",
    "[-1e300, 1e300, 1e300]",
    "[1, 2]",
    "[0.0]",
    "[5e-324, 5e-324]",
    "[1e-310, 5e-324, -1e-310]",
];
/// A trial is this long: long enough for a plan and a movement.
const TICKS: u64 = 2500;
/// None of these trials takes a second; a machine under load may take many.
const TIMEOUT: Duration = Duration::from_secs(120);

/// Longest sentence of a refusal, bytes: a number may have over 300 digits.
const LONGEST_REFUSAL: usize = 300;

/// Trials between which all sections of a configuration are there.
const BASES: [&[&str]; 6] = [
    &["method=D"],
    &["method=A", "profile.jog={ pace = \"message\", nominal_period_ms = 50, joint_state_period_ms = 20 }"],
    &["method=B", "profile.blend={}", "physics.grasp_rule=original", "physics.joint_control=original_gains"],
    &["method=D", "intent_model=filtered", "planner.deadline_secs=1.0", "physics.engine=ode"],
    &[
        "method=A",
        "profile.limiter={ acceleration_rad_per_s2 = 4.0 }",
        "profile.jog.speed_steps={ slow_ms = 250, slow_factor = 0.4, fast_after_ms = 600, fast_factor = 2.0 }",
        "profile.jog.ramp={ rise_ms = 400, fall_rate_factor = 2.0 }",
        "physics.mass_set={ scaled = 2.0 }",
    ],
    &["method=A", "profile.jog.proportional={ rest_effort = 0.05, full_effort = 0.9 }"],
];

fn config(assignments: &[&str]) -> Result<TrialConfig, String> {
    let mut config = TrialConfig::new("D", 1, Setup::named("seated").unwrap());
    config.limit_secs = 30.0;
    config.emg = Some(EmgConfig::default());
    config.participant = Some(Default::default());
    config.with_overrides(assignments).map_err(|error| error.to_string())
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

/// What is wrong with a trial of this value of `key`; nothing if it is refused in a sentence or runs.
fn fault(assignments: &[&str], key: &str) -> Option<String> {
    let config = match config(assignments) {
        Ok(config) => config,
        Err(refusal) => {
            // Some errors name the key in words, such as "EMG rate" for `emg.rate_hz`.
            let refusal_text = refusal.to_lowercase();
            let named = key
                .rsplit('.')
                .next()
                .is_some_and(|name| name.split('_').any(|word| refusal_text.contains(word)));
            let long = refusal.len() > LONGEST_REFUSAL;
            return (!named || !refusal.contains("expected") || long)
                .then(|| format!("is refused by: {refusal}"));
        }
    };
    // What is not in its own right wrong may be refused by what it has to fit.
    let mut trial = match trial::simulated_trial(config, &EmgOrigin::Synthetic) {
        Ok(assembly) => assembly.trial,
        Err(refusal) => {
            let refusal = refusal.to_string();
            return (refusal.len() > LONGEST_REFUSAL).then(|| format!("is refused by: {refusal}"));
        }
    };
    for _ in 0..TICKS {
        let step = match trial.step(false) {
            Ok(step) => step,
            Err(refusal) => return Some(format!("stops the trial: {refusal}")),
        };
        let testbed = trial.testbed();
        let state = testbed.plant().state();
        let numbers = testbed.targets().iter().chain(&state.position).chain(&state.velocity);
        if !numbers.chain(testbed.posterior()).all(|value| value.is_finite()) {
            return Some(format!("gives numbers that are not finite at {} ms", step.time.0));
        }
        if step.output.finished {
            break;
        }
    }
    None
}

#[test]
fn every_number_of_a_configuration_is_refused_with_its_range_or_gives_a_trial_of_finite_numbers() {
    let mut all: Vec<(Vec<&str>, String, &str)> = Vec::new();
    let mut seen = std::collections::BTreeSet::new();
    for base in BASES {
        let text = config(base).unwrap().to_toml().unwrap();
        let mut found = Vec::new();
        cases("", &toml::from_str(&text).unwrap(), &mut found);
        for (key, values) in found {
            if seen.insert(key.clone()) {
                all.extend(values.iter().map(|value| (base.to_vec(), key.clone(), *value)));
            }
        }
    }
    assert!(seen.len() > 100, "{} keys: the search is broken", seen.len());

    let next = AtomicUsize::new(0);
    let work = || {
        let mut bad = Vec::new();
        while let Some((base, key, value)) = all.get(next.fetch_add(1, Ordering::Relaxed)) {
            // What allocates without bound ends the process: the last line tells what it was.
            let assignment = format!("{key}={value}");
            eprintln!("{assignment}");
            let arguments: Vec<String> =
                base.iter().map(|&a| a.to_owned()).chain([assignment.clone()]).collect();
            let key = key.clone();
            let (done, wait) = channel();
            thread::spawn(move || {
                let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
                done.send(catch_unwind(AssertUnwindSafe(|| fault(&arguments, &key)))).ok();
            });
            match wait.recv_timeout(TIMEOUT) {
                Ok(Ok(None)) => {}
                Ok(Ok(Some(fault))) => bad.push(format!("{assignment} {fault} (with {base:?})")),
                Ok(Err(_)) => bad.push(format!("{assignment} panics (with {base:?})")),
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
