//! What the models of intent are worth on recorded trials.
//!
//! A trial directory holds inputs, not outputs: the places of the blocks are recomputed by a replay, and the replay
//! must have the recorded digest, or they would not be those that the person saw.

use crate::{
    Arm,
    replay::{Checked, check_record, never_begun, read_classifier},
    trial,
};
use proact_analysis::{Episode, Forecast, Score, score};
use proact_control::MethodRegistry;
use proact_control::ports::ArmKinematics;
use proact_intent::{Candidates, IntentModelName, IntentOptions, Posterior};
use proact_kinematics::Kinematics;
use proact_recording::{INPUTS_FILE, Trial};
use proact_testbed::{GraspChoice, Testbed, TrialConfig, first_divergence};
use proact_types::{EventKind, GazeSample, ObjectId, Point, Scene, SimTime};
use serde::Serialize;
use std::{
    error::Error,
    fmt, fs,
    path::{Path, PathBuf},
};

/// A model that has nothing to say keeps its last word for this long, ms, as the highlight on the page does.
const KEPT_MILLIS: u64 = 500;

/// What the models of intent are worth on some trials.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct IntentReport {
    /// Trials that were used.
    pub trials: Vec<TrialUsed>,
    /// Trials that were interrupted before their first digest.
    pub not_begun: Vec<PathBuf>,
    /// Trials that could not be used.
    pub skipped: Vec<TrialSkipped>,
    /// Picks in them.
    pub picks: usize,
    /// One entry a model; one in another program comes last, where it was that of every trial.
    pub models: Vec<ModelScore>,
}

/// A trial that was used.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TrialUsed {
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
    pub interrupted: Option<f64>,
}

/// A trial that could not be used.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TrialSkipped {
    /// Where it is.
    pub dir: PathBuf,
    /// Why.
    pub reason: String,
}

/// What a model in another program is called here.
pub const OUTSIDE_MODEL: &str = "outside";

/// Score of one model.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ModelScore {
    /// Which model: the name of one of the program's own, or [`OUTSIDE_MODEL`].
    pub model: String,
    /// Its score.
    #[serde(flatten)]
    pub score: Score,
}

impl fmt::Display for IntentReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{} picks in {} trials", self.picks, self.trials.len())?;
        if !self.models.is_empty() {
            self.write_scores(f)?;
        }
        for trial in &self.trials {
            if let Some(seconds) = trial.interrupted {
                writeln!(f, "interrupted {}: used up to {seconds:.3} s", trial.dir.display())?;
            }
        }
        for dir in &self.not_begun {
            writeln!(f, "interrupted {}: before its first digest", dir.display())?;
        }
        for TrialSkipped { dir, reason } in &self.skipped {
            writeln!(f, "skipped {}: {reason}", dir.display())?;
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
struct Sample {
    time: SimTime,
    gaze: GazeSample,
    scene: Candidates,
    /// What the trial's own model made of it; none if it told nothing.
    used: Option<Posterior>,
}

/// From the start of the trial, or a release, until a block is attached.
struct Pick {
    start: SimTime,
    truth: ObjectId,
    samples: Vec<Sample>,
}

/// The picks of a trial.
struct Picked {
    config: TrialConfig,
    scene: Scene,
    /// Up to where the record of an interrupted trial goes, seconds.
    interrupted: Option<f64>,
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
pub fn intent(
    methods: &MethodRegistry,
    dir: &Path,
    options: Option<&IntentOptions>,
    mut progress: impl FnMut(usize, usize, &Path),
) -> Result<IntentReport, Box<dyn Error>> {
    let dirs = trial_dirs(dir)?;
    let count = dirs.len();
    let (mut trials, mut skipped, mut not_begun) = (Vec::new(), Vec::new(), Vec::new());
    let mut episodes = IntentModelName::ALL.map(|_| Vec::new());
    let (mut outside, mut always_outside) = (Vec::new(), true);
    for (number, dir) in dirs.into_iter().enumerate() {
        progress(number, count, &dir);
        match picks(methods, &dir) {
            Ok(None) => not_begun.push(dir),
            Ok(Some(Picked { config, scene, interrupted, picks })) => {
                let options = options.copied().unwrap_or(config.intent);
                for (name, episodes) in IntentModelName::ALL.into_iter().zip(&mut episodes) {
                    let mut model = name.build(&options)?;
                    episodes.extend(forecast(&picks, |at| model.observe(at.time, &at.gaze, &at.scene)));
                }
                always_outside &= config.intent_process.is_some();
                outside.extend(forecast(&picks, |at| at.used.clone()));
                trials.push(TrialUsed {
                    dir,
                    method: config.method_label(),
                    setup: config.setup.name,
                    seed: config.seed,
                    picked: picks.iter().map(|pick| scene.name(pick.truth)).collect(),
                    options,
                    interrupted,
                });
            }
            Err(error) => skipped.push(TrialSkipped { dir, reason: error.to_string() }),
        }
    }

    let picks = episodes[0].len();
    // That nothing was picked in a trial that was interrupted early is no fault of the record.
    let early = !not_begun.is_empty() || trials.iter().any(|trial| trial.interrupted.is_some());
    if picks == 0 && early && skipped.is_empty() {
        return Ok(IntentReport { trials, not_begun, skipped, picks, models: Vec::new() });
    }
    if picks == 0 {
        let reasons: String =
            skipped.iter().map(|s| format!("\n  {}: {}", s.dir.display(), s.reason)).collect();
        return Err(
            format!("no pick to score: no block was picked in {} trials{reasons}", trials.len()).into()
        );
    }
    let own = IntentModelName::ALL.iter().map(|name| name.as_str()).zip(&episodes);
    let models = own
        .chain(always_outside.then_some((OUTSIDE_MODEL, &outside)))
        .map(|(model, episodes)| Ok(ModelScore { model: model.to_owned(), score: score(episodes)? }))
        .collect::<Result<_, proact_analysis::AnalysisError>>()?;
    Ok(IntentReport { trials, not_begun, skipped, picks, models })
}

/// `dir` if it is a trial, or else the trials in it, by name.
fn trial_dirs(dir: &Path) -> Result<Vec<PathBuf>, Box<dyn Error>> {
    if Trial::is_in(dir) {
        return Ok(vec![dir.to_owned()]);
    }
    let entries = fs::read_dir(dir).map_err(|e| format!("{}: {e}", dir.display()))?;
    let mut found = Vec::new();
    for entry in entries {
        let path = entry?.path();
        if Trial::is_in(&path) {
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
fn picks(methods: &MethodRegistry, dir: &Path) -> Result<Option<Picked>, Box<dyn Error>> {
    if never_begun(&Trial::open(dir)?) {
        return Ok(None);
    }
    let Checked { record, config, recorded, .. } = check_record(dir, false)?;
    let interrupted = (!record.finished()).then(|| record.end().as_secs());
    let attached = |kind: &EventKind| matches!(kind, EventKind::ObjectAttached { .. });
    let Some(last_grasp) = record.events()?.iter().filter(|e| attached(&e.kind)).map(|e| e.time).next_back()
    else {
        let scene = Arm::recorded(dir, &config).map(|arm| config.build_task(arm.model()))??.scene().clone();
        return Ok(Some(Picked { config, scene, interrupted, picks: Vec::new() }));
    };
    // Whole spans only: what lies behind the last one cannot be checked.
    let count = recorded.iter().take_while(|span| span.tick < last_grasp).count() + 1;
    let recorded = &recorded[..count.min(recorded.len())];
    let end = recorded.last().ok_or("the record holds no complete span: its replay cannot be checked")?.tick;

    let (arm, classifier) = (Arm::recorded(dir, &config)?, read_classifier(&record, &config)?);
    let testbed = trial::replayed(methods, &arm, config.clone(), classifier)?;
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
        let looked = input.gaze.filter(|_| testbed.plant().state().attached.is_none());
        let scene = looked.map(|_| candidates(&testbed, &mut kinematics)).transpose()?;
        let output = testbed.tick(&input, now == end)?;
        if let (Some(gaze), Some(scene)) = (looked, scene) {
            let told = gaze.valid && testbed.posterior().iter().any(|p| *p > 0.0);
            let used = told.then(|| testbed.posterior().to_vec());
            samples.push(Sample { time: now, gaze, scene, used });
        }
        spans.extend(output.span);
        for event in output.events {
            match event.kind {
                EventKind::ObjectAttached { object: block } => {
                    let samples = std::mem::take(&mut samples);
                    // Without a single gaze sample there is nothing to judge a model by.
                    if !samples.is_empty() {
                        picks.push(Pick { start, truth: block, samples });
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
    Ok(Some(Picked { config, scene, interrupted, picks }))
}

/// The scene as the models see it now.
fn candidates(testbed: &Testbed, kinematics: &mut Kinematics) -> Result<Candidates, Box<dyn Error>> {
    let state = testbed.plant().state();
    let model = testbed.model();
    let base_from_tip = kinematics.forward(&state.position[..model.arm_count()])?;
    let task = testbed.task().state();
    let grasps = GraspChoice::new(model, testbed.task().scene())?;
    let held = state.attached.and_then(|(object, _)| grasps.centre_of(object));
    let centre = held.or_else(|| grasps.centre(state)).ok_or("the scene has no objects")?;
    Ok(Candidates {
        centres: state.objects.iter().map(|object| Point::from(object.pose.translation.vector)).collect(),
        pickable: (0..state.objects.len()).map(|k| task.candidates.contains(ObjectId::new(k))).collect(),
        context: Some(task.context),
        tip: Some(state.world_from_base * base_from_tip * centre),
    })
}

/// What a model says during the picks of one trial; `observe` takes each sample in, in the order of time.
fn forecast(picks: &[Pick], mut observe: impl FnMut(&Sample) -> Option<Posterior>) -> Vec<Episode> {
    let episode = |pick: &Pick| {
        let mut last: Option<(SimTime, Posterior)> = None;
        let mut told = |sample: &Sample| {
            let time = sample.time;
            if let Some(posterior) = observe(sample) {
                last = Some((time, posterior));
            }
            let kept = last.as_ref().filter(|(said, _)| time.millis_since(*said) <= KEPT_MILLIS);
            let probabilities =
                kept.map_or_else(|| no_opinion(&sample.scene), |(_, posterior)| posterior.clone());
            Forecast { time, probabilities }
        };
        let forecasts = pick.samples.iter().map(&mut told).collect();
        Episode { start: pick.start, truth: pick.truth.index(), forecasts }
    };
    picks.iter().map(episode).collect()
}

/// The same for every object that can be picked; for all of them if none can.
fn no_opinion(scene: &Candidates) -> Posterior {
    let (all, count) = (scene.pickable.len(), scene.pickable.iter().filter(|p| **p).count());
    if count == 0 {
        return vec![1.0 / all as f64; all];
    }
    scene.pickable.iter().map(|p| if *p { 1.0 / count as f64 } else { 0.0 }).collect()
}
