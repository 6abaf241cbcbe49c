//! What the models of intent are worth on recorded trials.
//!
//! A trial directory holds inputs, not outputs: the places of the blocks are recomputed by a replay, and the replay
//! must have the recorded digest, or they would not be those that the person saw.

use crate::{
    Arm,
    replay::{CheckedRecord, check_record, is_unstarted, read_classifier},
    trial, with_path,
};
use proact_analysis::{Episode, Forecast, ForecastScore, score_forecasts};
use proact_control::MethodRegistry;
use proact_control::ports::ArmKinematics;
use proact_intent::{Candidates, IntentModelName, IntentOptions, Posterior};
use proact_kinematics::Kinematics;
use proact_recording::{INPUTS_FILE, TrialRecord};
use proact_testbed::{GraspSelector, Testbed, TrialConfig, first_divergence};
use proact_types::{EventKind, GazeSample, ObjectId, Point, Scene, SimTime};
use serde::Serialize;
use std::{
    error::Error,
    fmt, fs,
    path::{Path, PathBuf},
};

/// A model that has nothing to say keeps its last word for this long, ms, as the highlight on the page does.
const ESTIMATE_HOLD_MS: u64 = 500;

/// What the models of intent are worth on some trials.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct IntentReport {
    /// Trials that were used.
    pub trials: Vec<IntentScoredTrial>,
    /// Trials that were interrupted before their first digest.
    #[serde(rename = "not_begun")]
    pub never_started: Vec<PathBuf>,
    /// Trials that could not be used.
    pub skipped: Vec<SkippedTrial>,
    /// Picks in them.
    pub picks: usize,
    /// One entry a model; one in another program comes last, where it was that of every trial.
    pub models: Vec<ModelScore>,
}

/// A trial that was used.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct IntentScoredTrial {
    /// Where it is.
    pub dir: PathBuf,
    /// Control method.
    pub method: String,
    /// Set-up.
    pub setup: String,
    /// Seed.
    pub seed: u64,
    /// Names of the objects that were picked, in order.
    pub picked: Vec<String>,
    /// Options of the models for this trial.
    pub options: IntentOptions,
    /// Up to where the record goes, seconds, if the trial was interrupted; none if it was brought to its end.
    #[serde(rename = "interrupted")]
    pub interrupted_at_secs: Option<f64>,
}

/// A trial that could not be used.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SkippedTrial {
    /// Where it is.
    pub dir: PathBuf,
    /// Why.
    pub reason: String,
}

/// What a model in another program is called here.
pub const EXTERNAL_MODEL: &str = "outside";

/// Score of one model.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ModelScore {
    /// Which model: the name of one of the program's own, or [`EXTERNAL_MODEL`].
    pub model: String,
    /// Its score.
    #[serde(flatten)]
    pub score: ForecastScore,
}

impl fmt::Display for IntentReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{} picks in {} trials", self.picks, self.trials.len())?;
        if !self.models.is_empty() {
            self.write_scores(f)?;
        }
        for trial in &self.trials {
            if let Some(seconds) = trial.interrupted_at_secs {
                writeln!(f, "interrupted {}: used up to {seconds:.3} s", trial.dir.display())?;
            }
        }
        for dir in &self.never_started {
            writeln!(f, "interrupted {}: before its first digest", dir.display())?;
        }
        for SkippedTrial { dir, reason } in &self.skipped {
            writeln!(f, "skipped {}", with_path(dir, reason))?;
        }
        Ok(())
    }
}

impl IntentReport {
    fn write_scores(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{:<12} {:>8} {:>7} {:>9} {:>11} {:>21} {:>6} {:>11}",
            "model",
            "log loss",
            "Brier",
            "accuracy",
            "calibration",
            "correct after, ms",
            "never",
            "flips/pick"
        )?;
        for ModelScore { model, score } in &self.models {
            let millis = |value: Option<f64>| value.map_or("-".to_owned(), |v| format!("{v:.0}"));
            let time = &score.time_to_correct_ms;
            let time = format!("{} ({} to {})", millis(time.median), millis(time.lower), millis(time.upper));
            writeln!(
                f,
                "{model:<12} {:>8.3} {:>7.3} {:>7.1} % {:>11.3} {time:>21} {:>6} {:>11.1}",
                score.log_loss,
                score.brier,
                100.0 * score.accuracy,
                score.expected_calibration_error,
                score.never_correct,
                score.flips_per_episode
            )?;
        }
        writeln!(
            f,
            "Each pick weighs the same. Log loss in nats (guessing among four: 1.386), calibration as expected \
             calibration error, time as median (quartiles) from the start of the pick."
        )?;
        Ok(())
    }
}

/// One gaze sample with what was known when it came.
struct GazeObservation {
    time: SimTime,
    gaze: GazeSample,
    scene: Candidates,
    /// What the trial's own model made of it; none if it told nothing.
    trial_posterior: Option<Posterior>,
}

/// From the start of the trial, or a release, until a block is attached.
struct Pick {
    start: SimTime,
    picked_object: ObjectId,
    samples: Vec<GazeObservation>,
}

/// The picks of a trial.
struct TrialPicks {
    config: TrialConfig,
    scene: Scene,
    /// Up to where the record of an interrupted trial goes, seconds.
    interrupted_at_secs: Option<f64>,
    picks: Vec<Pick>,
}

/// Scores every model on the trials in `dir`, itself a trial directory or a folder of them. `options` for all
/// trials; without them spread and weights are those of each trial. `progress` hears how many trials are done of how
/// many, and which one is next.
///
/// Deterministic: trials are used in the order of their names.
///
/// # Errors
/// No trial in `dir`, or none with a pick that could be used.
pub fn score_intent_models(
    methods: &MethodRegistry,
    dir: &Path,
    options: Option<&IntentOptions>,
    mut progress: impl FnMut(usize, usize, &Path),
) -> Result<IntentReport, Box<dyn Error>> {
    let dirs = trial_dirs(dir)?;
    let count = dirs.len();
    let (mut trials, mut skipped, mut not_started) = (Vec::new(), Vec::new(), Vec::new());
    let mut episodes = IntentModelName::ALL.map(|_| Vec::new());
    let (mut outside, mut always_outside) = (Vec::new(), true);
    for (number, dir) in dirs.into_iter().enumerate() {
        progress(number, count, &dir);
        match recompute_picks(methods, &dir) {
            Ok(None) => not_started.push(dir),
            Ok(Some(TrialPicks { config, scene, interrupted_at_secs: interrupted, picks })) => {
                let options = options.copied().unwrap_or(config.intent);
                for (name, episodes) in IntentModelName::ALL.into_iter().zip(&mut episodes) {
                    let mut model = name.build(&options)?;
                    episodes.extend(predict_picks(&picks, |at| model.observe(at.time, &at.gaze, &at.scene)));
                }
                always_outside &= config.intent_process.is_some();
                outside.extend(predict_picks(&picks, |at| at.trial_posterior.clone()));
                trials.push(IntentScoredTrial {
                    dir,
                    method: config.method_label(),
                    setup: config.setup.name,
                    seed: config.seed,
                    picked: picks.iter().map(|pick| scene.name(pick.picked_object)).collect(),
                    options,
                    interrupted_at_secs: interrupted,
                });
            }
            Err(error) => skipped.push(SkippedTrial { dir, reason: error.to_string() }),
        }
    }

    let picks = episodes[0].len();
    // That nothing was picked in a trial that was interrupted early is no fault of the record.
    let early = !not_started.is_empty() || trials.iter().any(|trial| trial.interrupted_at_secs.is_some());
    if picks == 0 && early && skipped.is_empty() {
        return Ok(IntentReport { trials, never_started: not_started, skipped, picks, models: Vec::new() });
    }
    if picks == 0 {
        let reasons: String =
            skipped.iter().map(|s| format!("\n  {}", with_path(&s.dir, &s.reason))).collect();
        return Err(
            format!("no pick to score: no block was picked in {} trials{reasons}", trials.len()).into()
        );
    }
    let own = IntentModelName::ALL.iter().map(|name| name.as_str()).zip(&episodes);
    let models = own
        .chain(always_outside.then_some((EXTERNAL_MODEL, &outside)))
        .map(|(model, episodes)| {
            Ok(ModelScore { model: model.to_owned(), score: score_forecasts(episodes)? })
        })
        .collect::<Result<_, proact_analysis::AnalysisError>>()?;
    Ok(IntentReport { trials, never_started: not_started, skipped, picks, models })
}

/// `dir` if it is a trial, or else the trials in it, by name.
fn trial_dirs(dir: &Path) -> Result<Vec<PathBuf>, Box<dyn Error>> {
    if TrialRecord::exists_in(dir) {
        return Ok(vec![dir.to_owned()]);
    }
    let entries = fs::read_dir(dir).map_err(|e| format!("{}: {e}", dir.display()))?;
    let mut found = Vec::new();
    for entry in entries {
        let path = entry?.path();
        if TrialRecord::exists_in(&path) {
            found.push(path);
        }
    }
    if found.is_empty() {
        return Err(format!(
            "{} is no trial and holds none: expected {INPUTS_FILE} in it or in its folders",
            dir.display()
        )
        .into());
    }
    found.sort();
    Ok(found)
}

/// Recomputes the trial in `dir` up to its last grasp: what was seen during each pick. None if it was interrupted before
/// its first digest.
fn recompute_picks(methods: &MethodRegistry, dir: &Path) -> Result<Option<TrialPicks>, Box<dyn Error>> {
    if is_unstarted(&TrialRecord::open(dir)?) {
        return Ok(None);
    }
    let CheckedRecord { record, config, recorded_spans: recorded, .. } = check_record(dir, false)?;
    let interrupted = (!record.is_finished()).then(|| record.end().as_secs());
    let attached = |kind: &EventKind| matches!(kind, EventKind::ObjectAttached { .. });
    let Some(last_grasp) = record.events()?.iter().filter(|e| attached(&e.kind)).map(|e| e.time).next_back()
    else {
        let scene =
            Arm::from_record(dir, &config).map(|arm| config.build_task(arm.model()))??.scene().clone();
        return Ok(Some(TrialPicks { config, scene, interrupted_at_secs: interrupted, picks: Vec::new() }));
    };
    // Whole spans only: what lies behind the last one cannot be checked.
    let count = recorded.iter().take_while(|span| span.tick < last_grasp).count() + 1;
    let recorded = &recorded[..count.min(recorded.len())];
    let end = recorded.last().ok_or("the record holds no complete span: its replay cannot be checked")?.tick;

    let (arm, classifier) = (Arm::from_record(dir, &config)?, read_classifier(&record, &config)?);
    let testbed = trial::replay_testbed(methods, &arm, config.clone(), classifier)?;
    let mut testbed = testbed.with_recorded_config(&record.header().config_toml);
    let mut kinematics = Kinematics::new(testbed.model())?;
    let mut spans = Vec::new();
    let mut picks = Vec::new();
    let (mut start, mut samples) = (SimTime(0), Vec::new());
    for tick in record.ticks()? {
        let (now, input) = tick?;
        if now > end {
            break;
        }
        // Before the tick: what its own inference will work on.
        let gaze_sample = input.gaze.filter(|_| testbed.plant().state().attached.is_none());
        let scene = gaze_sample.map(|_| current_candidates(&testbed, &mut kinematics)).transpose()?;
        let output = testbed.tick(&input, now == end)?;
        if let (Some(gaze), Some(scene)) = (gaze_sample, scene) {
            let has_posterior = gaze.valid && testbed.posterior().iter().any(|p| *p > 0.0);
            let used = has_posterior.then(|| testbed.posterior().to_vec());
            samples.push(GazeObservation { time: now, gaze, scene, trial_posterior: used });
        }
        spans.extend(output.span_digest);
        for event in output.events {
            match event.kind {
                EventKind::ObjectAttached { object: block } => {
                    let samples = std::mem::take(&mut samples);
                    // Without a single gaze sample there is nothing to judge a model by.
                    if !samples.is_empty() {
                        picks.push(Pick { start, picked_object: block, samples });
                    }
                }
                EventKind::ObjectReleased { .. } => {
                    start = event.time;
                    samples.clear();
                }
                _ => {}
            }
        }
    }
    if let Some(difference) = first_divergence(recorded, &spans) {
        return Err(format!(
            "its replay differs from the record between {:.3} s and {:.3} s, first in {}: analyze it with the version \
             of the program that recorded it",
            difference.from.as_secs(),
            difference.to.as_secs(),
            difference.fields.join(", ")
        )
        .into());
    }
    let scene = testbed.task().scene().clone();
    Ok(Some(TrialPicks { config, scene, interrupted_at_secs: interrupted, picks }))
}

/// The scene as the models see it now.
fn current_candidates(testbed: &Testbed, kinematics: &mut Kinematics) -> Result<Candidates, Box<dyn Error>> {
    let state = testbed.plant().state();
    let model = testbed.model();
    let base_from_tip = kinematics.forward(&state.position[..model.arm_count()])?;
    let task = testbed.task().state();
    let grasps = GraspSelector::new(model, testbed.task().scene())?;
    let held = state.attached.and_then(|(object, _)| grasps.grasp_center_of(object));
    let center = held.or_else(|| grasps.grasp_center(state)).ok_or("the scene has no objects")?;
    Ok(Candidates {
        centers: state.objects.iter().map(|object| Point::from(object.pose.translation.vector)).collect(),
        pickable: (0..state.objects.len()).map(|k| task.candidates.contains(ObjectId::new(k))).collect(),
        context: Some(task.context),
        tip: Some(state.world_from_base * base_from_tip * center),
    })
}

/// What a model says during the picks of one trial; `observe` takes each sample in, in the order of time.
fn predict_picks(
    picks: &[Pick],
    mut observe: impl FnMut(&GazeObservation) -> Option<Posterior>,
) -> Vec<Episode> {
    let episode = |pick: &Pick| {
        let mut last: Option<(SimTime, Posterior)> = None;
        let mut forecast = |sample: &GazeObservation| {
            let time = sample.time;
            if let Some(posterior) = observe(sample) {
                last = Some((time, posterior));
            }
            let kept = last
                .as_ref()
                .filter(|(estimated_at, _)| time.millis_since(*estimated_at) <= ESTIMATE_HOLD_MS);
            let probabilities =
                kept.map_or_else(|| uniform_posterior(&sample.scene), |(_, posterior)| posterior.clone());
            Forecast { time, probabilities }
        };
        let forecasts = pick.samples.iter().map(&mut forecast).collect();
        Episode { start: pick.start, truth: pick.picked_object.index(), forecasts }
    };
    picks.iter().map(episode).collect()
}

/// The same for every object that can be picked; for all of them if none can.
fn uniform_posterior(scene: &Candidates) -> Posterior {
    let (all, count) = (scene.pickable.len(), scene.pickable.iter().filter(|p| **p).count());
    if count == 0 {
        return vec![1.0 / all as f64; all];
    }
    scene.pickable.iter().map(|p| if *p { 1.0 / count as f64 } else { 0.0 }).collect()
}
