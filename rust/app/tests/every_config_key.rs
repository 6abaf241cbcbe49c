//! Every key of a trial's configuration does something: another value gives another trial, or is refused with the reason.
//! Compared is what the stages said, span by span, and not the digest, into which the text of the configuration goes.
#![allow(clippy::disallowed_methods, clippy::unwrap_used)] // A test.

use arrayvec::ArrayVec;
use proact_app::{Arm, trial};
use proact_control::MethodRegistry;
use proact_devices::{EmgOrigin, SyntheticEmg, SyntheticModel, random_stream};
use proact_emg::{EmgConfig, EmgModel};
use proact_testbed::{RunningTrial, Setup, TrialConfig, ports};
use proact_types::{Command, EmgSample, InputSource, Pose, SimTime, Vector};
use std::{
    collections::{BTreeMap, BTreeSet},
    sync::{
        LazyLock,
        atomic::{AtomicUsize, Ordering},
    },
    thread,
};

/// Keys that steer nothing, and why.
const INERT_KEYS: [(&str, &str); 16] = [
    ("setup.name", "is shown and recorded"),
    ("profile.name", "is shown and recorded"),
    (
        "emg.gap_interpolation.max_gap_ms",
        "these trials lose no sample; rust/devices/tests/losses.rs tests it",
    ),
    ("emg.gap_interpolation.max_interpolated_share", "as max_gap_ms"),
    ("emg.priors", "the generator gives each gesture as many windows; rust/emg tests it"),
    (
        "planner.start_contact_tolerance_m",
        "no plan of these trials starts with a graze; rust/planning tests the rule",
    ),
    ("planner.place_tolerance_m", "no place of these trials is out of reach; no test sets it"),
    ("planner.search.step_m", "nothing small stands in the way here; no test sets it"),
    ("planner.search.step_rad", "as step_m"),
    (
        "profile.end_effector_jog.inverse.tracking_error_limit_rad",
        "the arm of these trials follows; no test sets it",
    ),
    ("profile.joint_jog.tracking_error_limit_rad", "the arm of these trials follows; rust/control tests it"),
    (
        "profile.gaze_assisted.replan_distance_m",
        "nobody leans while a plan is made; rust/control tests the rule",
    ),
    ("profile.gaze_assisted.replan_angle_rad", "as replan_distance_m"),
    (
        "profile.dead_man.max_delay_ms",
        "these trials have no line with a delay; rust/bridge and rust/control test it",
    ),
    ("profile.jog.confirm_open_ms", "no block is held so early; rust/control tests it"),
    ("wait_for_plans", "decides by the clock; rust/app/tests/plans.rs tests it"),
];

const A: &str = "method=A";
const B: &str = "method=B";
const BY_MESSAGE: &str =
    "profile.jog={ pace = \"message\", nominal_period_ms = 50, joint_state_period_ms = 20 }";
const PSEUDO_INVERSE: &str =
    "profile.end_effector_jog.inverse={ kind = \"moore_penrose\", condition_limit = 15.0, elbow_index = 3 }";
const STEPS: &str =
    "profile.jog.speed_steps={ slow_ms = 250, slow_factor = 0.4, fast_after_ms = 600, fast_factor = 2.0 }";
const PROPORTIONAL: &str = "profile.jog.proportional={ rest_effort = 0.05, full_effort = 0.9 }";
const RAMP: &str = "profile.jog.ramp={ rise_ms = 400, fall_rate_factor = 2.0 }";
const RIDGE: &str = "emg.classifier=ridge";
/// What its drives move.
const SIMULTANEOUS: &str = "profile.jog.simultaneous={ drives = { \"wrist_extension/wrist_flexion\" = \"elbow\", \"hand_open/hand_close\" = \"shoulder\" } }";
const WITH_HAND: &str = "profile.jog.simultaneous={ drives = { \"wrist_extension/wrist_flexion\" = \"elbow\", \"hand_open/hand_close\" = \"hand\" } }";
const FILTERED: &str = "intent_model=filtered";
const ORIGINAL_GRASP: &str = "physics.grasp_rule=original";
/// Somebody who does not lean: places are hard to reach.
const UPRIGHT: &str = "setup.body.reaching_posture_deg=[0.0, 0.0, 0.0]";
const LONG: &str = "limit_secs=45.0";
/// A live trial whose gestures come from an armband that dies in every way there is.
const ARMBAND: &str = "@armband";
/// A live trial of somebody at the page, whose shoulder is tracked.
const PAGE: &str = "@page";

/// Another value of a key, and what both trials have. Keys that are not here get a number a tenth larger, or a flag
/// turned over, in the usual trial.
#[rustfmt::skip]
const CASES: &[(&str, &str, &[&str])] = &[
    ("arm.hash", "00", &[]),
    ("arm.name", "mpl_left", &[]),
    ("emg.features", "LS4", &[]),
    ("emg.act_on_first_window", "true", &[ARMBAND]),
    ("emg.liveness.flat_ms", "250", &[ARMBAND, "emg.liveness.min_noise_share=0.0"]),
    ("emg.liveness.frozen_ms", "200", &[ARMBAND]),
    ("emg.liveness.max_lost_share", "0.9", &[ARMBAND]),
    ("emg.liveness.noise_floors", "[]", &[ARMBAND]),
    ("emg.liveness.noise_window_ms", "300", &[ARMBAND]),
    ("emg.liveness.min_noise_share", "0.0", &[ARMBAND]),
    ("emg.liveness.railed_ms", "50", &[ARMBAND]),
    ("emg.liveness.rails", "[-2000.0, 2000.0]", &[ARMBAND, "emg.liveness.railed_ms=50"]),
    ("emg.liveness.rate_ratio_limits", "[0.1, 1.85]", &[ARMBAND]),
    ("emg.liveness.loss_window_ms", "400", &[ARMBAND]),
    ("emg.stale_timeout_ms", "100", &[ARMBAND]),
    ("emg.covariance_normalization", "windows_less_classes", &[]),
    ("emg.rejection_threshold", "0.999999", &[]),
    ("emg.majority_vote_windows", "9", &[]),
    ("emg.regression.ridge_alpha", "1000.0", &[A, RIDGE, SIMULTANEOUS]),
    ("emg.regression.dead_band", "0.6", &[A, RIDGE, SIMULTANEOUS]),
    ("emg.regression.drives", "[\"wrist_extension/wrist_flexion\"]", &[A, RIDGE, SIMULTANEOUS]),
    ("emg.regression.smoothing_time_constant_ms", "300.0", &[A, RIDGE, SIMULTANEOUS]),
    ("emg.publish_rule", "strict", &[]),
    ("emg.two_site.channels", "{ wrist_extension = 0, wrist_flexion = 1 }", &[A, "emg.classifier=two_site"]),
    ("emg.two_site.pair", "hand_close/wrist_flexion", &[A, "emg.classifier=two_site"]),
    ("emg.two_site.switch_gesture", "hand_close", &[A, "emg.classifier=two_site"]),
    ("emg.wamp_threshold", "5.0", &["emg.features=WAMP"]),
    ("gesture_source", "recording", &[]),
    ("emg_dc_offset", "[1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0]", &[]),
    ("emg_accepted_faults", "[\"channel 0 only rises\"]", &[]),
    ("intent.context_changes_at_grasp", "true", &[LONG]),
    ("intent.off_target_likelihood", "0.5", &[FILTERED]),
    ("intent.highlight_hysteresis", "1000.0", &["intent.gaze_sigma=0.5", LONG]),
    ("intent.independent_fixation_ms", "100.0", &[FILTERED]),
    ("intent.straightness_per_m", "50.0", &["intent_model=hand_motion"]),
    ("intent.goal_switching_rate_per_s", "3.0", &[FILTERED]),
    ("intent_model", "gaze_only", &[]),
    ("intent_process.command", "[\"no-such-program\"]", &[]),
    ("method", "C", &[]),
    ("method_process.command", "[\"no-such-program\"]", &[]),
    ("motion.limb_rad_per_s", "0.1", &[A, "profile.level=below_elbow"]),
    ("motion.shoulder_m_per_s", "1.0", &[PAGE]),
    ("motion.shoulder_rad_per_s", "1.0", &[PAGE]),
    ("participant.dwell_ms", "500", &[]),
    ("participant.reaction_ms", "400", &[]),
    ("participant.relax_ms", "600", &[]),
    ("participant.timing_relative_sd", "0.3", &[A]),
    ("physics.engine", "ode", &[]),
    ("physics.grasp_rule", "original", &[]),
    ("physics.joint_control", "original_gains", &[]),
    ("physics.mass_set", "real_limb", &[]),
    ("physics.opposing_grasp.min_force_ratio", "1.0", &[]),
    ("physics.opposing_grasp.min_angle_deg", "179.0", &[]),
    ("physics.opposing_grasp.min_force_n", "50.0", &[]),
    ("physics.original_grasp.min_force_ratio", "1.0", &[ORIGINAL_GRASP]),
    ("physics.original_grasp.check_interval_ms", "100", &[ORIGINAL_GRASP]),
    ("physics.original_grasp.grip_count_threshold", "6", &[ORIGINAL_GRASP]),
    ("physics.original_grasp.forces_angle_tolerance_deg", "179.0", &[ORIGINAL_GRASP]),
    ("physics.original_grasp.min_force_n", "50.0", &[ORIGINAL_GRASP]),
    ("physics.original_grasp.max_grip_count", "5", &[ORIGINAL_GRASP, LONG]),
    ("physics.original_grasp.pressing_distance_m", "0.0", &[ORIGINAL_GRASP, LONG]),
    ("physics.original_grasp.release_tolerance_m", "0.5", &[ORIGINAL_GRASP, LONG]),
    ("planner.contact_padding_m", "0.004", &[]),
    ("planner.deadline_secs", "0.001", &[]),
    ("planner.max_goal_postures", "30", &[]),
    ("planner.max_velocity_rad_per_s", "0.3", &[]),
    ("planner.name", "BiTRRT", &[]),
    ("planner.parameters.range", "0.1", &[]),
    ("planner.place_tilt_rad", "0.02", &[]),
    ("planner.ik_seeds", "1", &[]),
    ("planner.search.fixed_validity_step", "0.5", &[]),
    ("planner.search.max_iterations", "1", &[]),
    // In the usual steps a whole search may take less.
    ("planner.search.max_secs", "0.001", &["planner.search.fixed_validity_step=0.001"]),
    // One more search than usual finds nothing better in these trials.
    ("planner.search.more_searches", "0", &[]),
    ("planner.search.shortcut_attempts", "5", &[LONG]),
    ("profile.blend.assistance_share", "0.9", &[B, "profile.blend={}"]),
    ("profile.blend.speed_m_per_s", "0.2", &[B, "profile.blend={}"]),
    ("profile.blend.height_above_target_m", "0.3", &[B, "profile.blend={}"]),
    ("profile.dead_man.emg_timeout_ms", "60", &[ARMBAND]),
    ("profile.dead_man.gaze_timeout_ms", "50", &[]),
    ("profile.dead_man.command_timeout_ms", "120", &[PAGE]),
    ("profile.dead_man.tracking_timeout_ms", "60", &[PAGE]),
    ("profile.end_effector_jog.axes", "[]", &[B]),
    ("profile.end_effector_jog.ignores_open_after_close", "true", &[PAGE, B, BY_MESSAGE]),
    ("profile.end_effector_jog.inverse.condition_limit", "3.0", &[B, "profile.end_effector_jog.inverse.condition_slowdown=2.0"]),
    ("profile.end_effector_jog.inverse.condition_slowdown", "2.0", &[B]),
    ("profile.end_effector_jog.inverse.singular_value_threshold", "0.5", &[B]),
    ("profile.end_effector_jog.inverse.max_damping", "0.5", &[B, "profile.end_effector_jog.inverse.singular_value_threshold=0.5"]),
    ("profile.end_effector_jog.inverse.elbow_index", "2", &[B, PSEUDO_INVERSE]),
    ("profile.end_effector_jog.inverse.kind", "moore_penrose", &[]),
    ("profile.end_effector_jog.inverse.min_alignment_cosine", "0.99999", &[B]),
    ("profile.end_effector_jog.inverse.characteristic_length_m", "1.0", &[B]),
    ("profile.end_effector_jog.speed_m_per_s", "0.05", &[B]),
    ("profile.end_effector_jog.speed_rad_per_s", "0.2", &[B]),
    ("profile.end_effector_jog.step_m", "0.002", &[B, BY_MESSAGE]),
    ("profile.end_effector_jog.step_rad", "0.01", &[B, BY_MESSAGE]),
    ("profile.gaze_assisted.confirm_open_ms", "1000", &[LONG]),
    ("profile.gaze_assisted.max_intermediate_goals", "0", &[UPRIGHT]),
    ("profile.gaze_assisted.rules", "toggle_locks", &[]),
    ("profile.gaze_assisted.snap_radius_m", "0.2", &[LONG]),
    ("profile.jog.reverse_cycle_after_ms", "200", &[A]),
    ("profile.jog.joint_state_period_ms", "200", &[PAGE, A, BY_MESSAGE]),
    ("profile.jog.nominal_period_ms", "100", &[PAGE, A, BY_MESSAGE]),
    ("profile.jog.open_after_close_ms", "900", &[PAGE, A]),
    ("profile.jog.pace", "message", &[]),
    ("profile.jog.proportional.full_effort", "0.7", &[ARMBAND, PROPORTIONAL]),
    ("profile.jog.proportional.rest_effort", "0.15", &[ARMBAND, PROPORTIONAL]),
    ("profile.jog.ramp.fall_rate_factor", "4.0", &[PAGE, A, "profile.jog.ramp={ rise_ms = 4000, fall_rate_factor = 1.0 }"]),
    ("profile.jog.ramp.rise_ms", "300", &[PAGE, A, RAMP]),
    ("profile.jog.simultaneous.drives", "{ \"wrist_extension/wrist_flexion\" = \"elbow\", \"hand_open/hand_close\" = \"wristz\" }", &[A, RIDGE, SIMULTANEOUS]),
    ("profile.jog.simultaneous.hand_on_threshold", "0.99", &[A, RIDGE, WITH_HAND]),
    ("profile.jog.speed_steps.fast_factor", "1.1", &[PAGE, A, STEPS]),
    ("profile.jog.speed_steps.fast_after_ms", "500", &[PAGE, A, STEPS]),
    ("profile.jog.speed_steps.slow_factor", "0.2", &[PAGE, A, STEPS]),
    ("profile.jog.speed_steps.slow_ms", "150", &[PAGE, A, STEPS]),
    ("profile.joint_jog.cycle", "[\"wristz\", \"elbow\"]", &[A]),
    (
        "profile.joint_jog.joints",
        "[{ joint = \"shoulder\", name = \"other way\", we = \"-\", wf = \"+\", we_sign = -1 }]",
        &[A],
    ),
    ("profile.joint_jog.speed_rad_per_s", "0.2", &[A]),
    ("profile.joint_jog.starts_closed", "true", &[A]),
    ("profile.joint_jog.step_rad", "0.01", &[A, BY_MESSAGE]),
    ("profile.level", "below_elbow", &[A]),
    ("profile.levels.above_elbow", "[\"wristz\"]", &[A, "profile.level=above_elbow"]),
    ("profile.levels.below_elbow", "[\"wristz\"]", &[A, "profile.level=below_elbow"]),
    ("profile.levels.shoulder", "[\"wristz\"]", &[A]),
    ("profile.limiter.acceleration_rad_per_s2", "1.0", &[A]),
    ("setup.body.axial_max_deg", "5.0", &[]),
    ("setup.body.eye_m", "[-0.55, 0.0, 1.6]", &[]),
    ("setup.body.forward_max_deg", "10.0", &[]),
    ("setup.body.hip_m", "[-0.6, 0.0, 0.9]", &[]),
    ("setup.body.lateral_max_deg", "5.0", &[]),
    ("setup.body.reaching_posture_deg", "[20.0, -10.0, 20.0]", &[]),
    ("setup.body.shoulder_m", "[-0.6, -0.18, 1.4]", &[]),
    ("setup.side", "left", &[]),
    ("task.arrangement", "[\"FL\", \"NM\", \"NL\", \"FM\"]", &[]),
    ("task.hash", "00", &[]),
    ("task.name", "nine_holes", &[]),
];

#[test]
fn another_value_of_any_key_gives_another_trial_or_is_refused() {
    let text = simulated_session(&[]).unwrap().testbed().config().to_toml().unwrap();
    let mut keys = BTreeMap::new();
    leaves("", &toml::from_str(&text).unwrap(), &mut keys);
    let named: BTreeSet<&str> = CASES.iter().map(|(key, ..)| *key).collect();
    assert_eq!(named.len(), CASES.len(), "a key has two cases");

    let steers = |key: &String| INERT_KEYS.iter().all(|(other, _)| other != key);
    let rest = keys.iter().filter(|(key, _)| !named.contains(key.as_str()) && steers(key));
    let cases: Vec<(String, Vec<&str>)> = rest
        .map(|(key, value)| (format!("{key}={}", another(key, value)), Vec::new()))
        .chain(CASES.iter().map(|(key, value, base)| (format!("{key}={value}"), base.to_vec())))
        .collect();

    let next = AtomicUsize::new(0);
    let work = || {
        let mut same = Vec::new();
        while let Some((changed, base)) = cases.get(next.fetch_add(1, Ordering::Relaxed)) {
            if !is_another_trial(base, changed) {
                same.push(format!("{changed} with {base:?}"));
            }
        }
        same
    };
    let same = thread::scope(|scope| {
        let workers = [scope.spawn(work), scope.spawn(work)];
        workers.map(|worker| worker.join().unwrap()).concat()
    });
    assert!(same.is_empty(), "these do nothing and are not refused:\n{}", same.join("\n"));
}

fn leaves(prefix: &str, table: &toml::Table, keys: &mut BTreeMap<String, toml::Value>) {
    for (name, value) in table {
        let key = if prefix.is_empty() { name.clone() } else { format!("{prefix}.{name}") };
        match value {
            toml::Value::Table(inner) => leaves(&key, inner, keys),
            value => drop(keys.insert(key, value.clone())),
        }
    }
}

fn another(key: &str, value: &toml::Value) -> String {
    match value {
        toml::Value::Float(x) if *x == 0.0 => "0.5".to_owned(),
        toml::Value::Float(x) => (x * 1.1).to_string(),
        toml::Value::Integer(x) => (x + 1).to_string(),
        toml::Value::Boolean(x) => (!x).to_string(),
        other => panic!("{key} = {other}: a new key; say in CASES what another value is and when it matters"),
    }
}

/// Whether the trial of `base` is another one with `changed`, or is refused.
fn is_another_trial(base: &[&str], changed: &str) -> bool {
    let with: Vec<&str> = base.iter().copied().chain([changed]).collect();
    let Ok(mut other) = start(&with) else { return true };
    let mut usual = start(base).unwrap_or_else(|error| panic!("{base:?}: {error}"));
    for tick in 1.. {
        let (usual, other) = (advance(&mut usual, base, tick), advance(&mut other, base, tick));
        if usual != other {
            return true;
        }
        if usual.1 {
            return false;
        }
    }
    false
}

/// What the stages said in a span that ends with this tick, and whether the trial is over.
fn advance(trial: &mut RunningTrial, base: &[&str], tick: u64) -> (Option<Vec<String>>, bool) {
    if base.contains(&PAGE) {
        act(trial, tick);
    }
    let output = trial.step(false).unwrap().output;
    let over = base.first().is_some_and(|kind| kind.starts_with('@')) && tick == 8500;
    (output.span_digest.map(|span| span.fields), output.finished || over)
}

fn start(assignments: &[&str]) -> Result<RunningTrial, String> {
    let values: Vec<&str> = assignments.iter().copied().filter(|text| !text.starts_with('@')).collect();
    let config = |method| TrialConfig::new(method, 1, Setup::named("still").unwrap());
    let text = |error: &dyn std::fmt::Display| error.to_string();
    if assignments.contains(&ARMBAND) {
        let mut config = config("A");
        config.emg = Some(MODEL.config.clone());
        let config = config.with_overrides(&values).map_err(|e| text(&e))?;
        let worn = trial::TrainedArmband {
            trained: &MODEL,
            samples: Box::new(DyingArmband { emg: generator(2), lacking: 0 }),
        };
        let arm = Arm::from_config(&config).map_err(|e| text(&e))?;
        return Ok(trial::live_trial_with_armband(&MethodRegistry::standard(), &arm, config, Some(worn))
            .map_err(|e| text(&e))?
            .trial);
    }
    if assignments.contains(&PAGE) {
        let config = config("A").with_overrides(&values).map_err(|e| text(&e))?;
        return Ok(trial::live_trial(config).map_err(|e| text(&e))?.trial);
    }
    simulated_session(&values)
}

/// A simulated participant before the box.
fn simulated_session(values: &[&str]) -> Result<RunningTrial, String> {
    let mut config = TrialConfig::new("D", 1, Setup::named("seated").unwrap());
    config.limit_secs = 30.0;
    config.emg = Some(EmgConfig::default());
    config.participant = Some(Default::default());
    let config = config.with_overrides(values).map_err(|e| e.to_string())?;
    Ok(trial::simulated_trial(config, &EmgOrigin::Synthetic).map_err(|e| e.to_string())?.trial)
}

/// Somebody turns a joint by the page, whose word stops now and then, and leans by a jump that a tracker sees.
fn act(trial: &mut RunningTrial, tick: u64) {
    let command = match tick {
        1000..2000 => None,
        0..1000 | 2200..3000 => Some(Command::WristExtension),
        3000..4400 => Some(Command::WristFlexion),
        4700..5400 | 6600..7000 => Some(Command::HandClose),
        5400..5900 | 7000..7100 => Some(Command::HandOpen),
        6300..6500 | 7100..7500 => Some(Command::WristExtension),
        _ => Some(Command::NoMotion),
    };
    if let Some(command) = command.filter(|_| tick.is_multiple_of(10)) {
        trial.person_stage_mut().set_command_from(InputSource::Page, command);
        trial.person_stage_mut().record_heartbeat(InputSource::Page);
    }
    if tick.is_multiple_of(10) && !(3500..4300).contains(&tick) {
        let jump = if tick < 500 { 0.0 } else { 0.08 };
        // Noise of the tracker: what repeats to the bit is frozen.
        let noise = 1e-6 * (tick % 7) as f64;
        let turn = nalgebra::UnitQuaternion::from_scaled_axis(Vector::z() * (2.0 * jump));
        let at = nalgebra::Translation3::new(-0.39 + jump + noise, 0.12, 1.5);
        trial.person_stage_mut().track_shoulder(Pose::from_parts(at, turn));
    }
}

fn generator(seed: u64) -> SyntheticEmg {
    SyntheticEmg::new(&SyntheticModel::shipped().unwrap(), 1000.0, 8, 1.0, random_stream(seed, "test"))
        .unwrap()
}

static MODEL: LazyLock<EmgModel> = LazyLock::new(|| {
    let mut emg = generator(1);
    let mut take = |gesture| -> Vec<EmgSample> {
        let mut codes = || emg.next(gesture).iter().copied().collect();
        (0..6000).map(|counter| EmgSample { counter, channels: codes() }).collect()
    };
    let recordings = Command::ALL.map(|gesture| (gesture, take(gesture)));
    let slices: Vec<(Command, &[EmgSample])> = recordings.iter().map(|(g, s)| (*g, s.as_slice())).collect();
    let rails = Some([-1000.0, 1000.0]);
    let liveness = proact_emg::LivenessConfig { rails, ..Default::default() };
    let config = EmgConfig { liveness, ..EmgConfig::default() };
    let mut model = EmgModel::train(&config, &[0.0; 8], &slices).unwrap();
    model.config.liveness = model.liveness(rails);
    model
});

/// A wrist that stays flexed under an armband that dies once a second, each time otherwise.
struct DyingArmband {
    emg: SyntheticEmg,
    /// Samples that were never made.
    lacking: u64,
}

impl ports::EmgSource for DyingArmband {
    fn sample_at(&mut self, now: SimTime, _intended: Command) -> Vec<EmgSample> {
        let mut channels: ArrayVec<f64, 8> = self.emg.next(Command::WristFlexion).iter().copied().collect();
        let (second, millis) = (now.0 / 1000, now.0 % 1000);
        let phase = 0.1 * std::f64::consts::PI * millis as f64;
        let number = millis as f64;
        match second {
            _ if millis < 500 => {}
            1 => channels.iter_mut().zip(1..).for_each(|(v, c)| *v = (number % 50.0 - 25.0) * f64::from(c)),
            2 => channels[3] = 0.0,
            3 => channels[3] = 1000.0,
            4 => channels[3] = 40.0 * (0.1 * phase).sin(),
            5 if millis % 2 == 0 => return Vec::new(),
            6 => return Vec::new(),
            7 if millis % 2 == 0 => {
                self.lacking += 1;
                return Vec::new();
            }
            _ => {}
        }
        let counter = now.0 - self.lacking;
        [EmgSample { counter, channels: channels.into_iter().collect() }].into_iter().collect()
    }
}
