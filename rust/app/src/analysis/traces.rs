//! A recorded trial as scoring sees it.
//!
//! There is one way from a trial to its scores: [`ObservedState`] instants on an even grid, from which [`trace_points`] makes what is scored.
//! They come from the trial as it is recomputed from its input log ([`TraceSampler`]), as it runs ([`LiveTraceBuilder`]), or from a bag where
//! there is nothing else.

use super::scores::score_rows;
use crate::{
    Arm,
    bag_playback::{self, StartPoses},
    read_trunk,
    recompute::recompute_opened,
    replay::{CheckedRecord, ReplayOptions, check_record, check_versions, open_checked},
    study::TrialScores,
};
use proact_analysis::scoring::{JointRange, Trace, TracePoint};
use proact_arm::ArmModel;
use proact_control::MethodRegistry;
use proact_recording::{RESULT_FILE, bag::BagEnd};
use proact_tasks::TaskResult;
use proact_testbed::{GraspSelector, Testbed, TrialResult, TrialStep, stages::GAZE_MAX_AGE_MS};
use proact_types::{
    Command, DisplayFrame, Event, GazeSample, JointVector, ObjectId, Point, Pose, Scene, SimTime, TaskGoal,
    TickInput,
};
use serde_json::{Map, Value};
use std::{
    collections::{BTreeMap, BTreeSet},
    error::Error,
    fmt, fs,
    path::{Path, PathBuf},
    sync::Arc,
};

/// From one instant to the next, milliseconds: as often as a bag has joints.
const PERIOD_MS: u64 = 20;

/// What is wrong with a record or bag: the column `flaw`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Flaw {
    /// A bag that breaks off.
    Truncated(String),
    /// A bag that lacks messages in between.
    Gap(String),
    /// A bag without the record of a trial.
    BagOnly,
    /// A record that this program cannot compute again, so that its bag is scored.
    NotReplayable(String),
    /// The trial that is recomputed from the input log is not the recorded one.
    Diverged(String),
    /// The recorded result is not that of the recomputed trial.
    ResultMismatch(String),
    /// The trial was broken off, and its record closed.
    Interrupted,
}

impl Flaw {
    /// For a table.
    pub(crate) fn label(&self) -> &'static str {
        match self {
            Flaw::Truncated(_) => "cut",
            Flaw::Gap(_) => "gap",
            Flaw::BagOnly => "bag_only",
            Flaw::NotReplayable(_) => "foreign",
            Flaw::Diverged(_) | Flaw::ResultMismatch(_) => "diverged",
            Flaw::Interrupted => "interrupted",
        }
    }
}

impl fmt::Display for Flaw {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Flaw::Truncated(how) => write!(f, "{how}; it is scored as far as it goes, without a score of the trial"),
            Flaw::BagOnly => f.write_str(
                "a bag of the original lab does not tell what planner and grasp rule did, what ended the trial, nor its seed",
            ),
            Flaw::NotReplayable(why) => write!(f, "{why}. Its bag is scored"),
            Flaw::Gap(when) => write!(f, "the bag has nothing that can be scored {when}: ways, speeds and times there are wrong"),
            Flaw::Diverged(how) => f.write_str(how),
            Flaw::ResultMismatch(how) => write!(f, "{how}; score and outcomes are left out"),
            Flaw::Interrupted => f.write_str(
                "the trial was interrupted; it is scored as far as it went, without a score of the trial",
            ),
        }
    }
}

/// A recorded trial and what is wrong with it.
pub(super) struct RecordTrace {
    /// The trial.
    pub(super) trace: Trace,
    /// Empty where the trial came to its end, and the recomputed one is the recorded one.
    pub(super) flaws: Vec<Flaw>,
}

/// The trace of the trial in `dir`, recomputed from its input log. Its bag is scored where this program cannot recompute the trial,
/// or makes another one of it. What happened is taken from the recorded events.
///
/// # Errors
/// A record that is damaged, or that cannot be recomputed and has no bag.
pub(super) fn trace_from_record(methods: &MethodRegistry, dir: &Path) -> Result<RecordTrace, Box<dyn Error>> {
    let checked = check_record(dir, true)?;
    let broken_off = checked.result.as_ref().is_none_or(TrialResult::is_aborted);
    let mut flaws: Vec<Flaw> = broken_off.then_some(Flaw::Interrupted).into_iter().collect();
    let recomputed = check_versions(checked.record.header())
        .map_err(Box::from)
        .and_then(|()| recompute_trace(methods, dir, checked.clone()));
    let from_bag = |flaws: &mut Vec<Flaw>| -> Result<Option<Trace>, Box<dyn Error>> {
        let Some(bag) = bag_in(dir)? else { return Ok(None) };
        let (trace, gap) = trace_from_record_bag(dir, &checked, &bag)?;
        flaws.extend(gap);
        Ok(Some(trace))
    };
    match recomputed {
        Ok(RecomputedTrace { trace, diverged: None, result_mismatch: other_result }) => {
            flaws.extend(other_result);
            Ok(RecordTrace { trace, flaws })
        }
        // The bag has what happened, if there is one.
        Ok(RecomputedTrace { trace, diverged: Some(diverged), .. }) => {
            flaws.push(diverged);
            Ok(RecordTrace { trace: from_bag(&mut flaws)?.unwrap_or(trace), flaws })
        }
        Err(error) => match from_bag(&mut flaws)? {
            Some(trace) => {
                flaws.push(Flaw::NotReplayable(error.to_string()));
                Ok(RecordTrace { trace, flaws })
            }
            None => Err(error),
        },
    }
}

/// A trial that was recomputed from its input log.
struct RecomputedTrace {
    trace: Trace,
    /// Where it is another trial than the recorded one.
    diverged: Option<Flaw>,
    /// The recorded result is not that of this trial.
    result_mismatch: Option<Flaw>,
}

/// The trial in `dir`, recomputed.
///
/// # Errors
/// As [`recompute_opened`].
fn recompute_trace(
    methods: &MethodRegistry,
    dir: &Path,
    checked: CheckedRecord,
) -> Result<RecomputedTrace, Box<dyn Error>> {
    let mut sampler = TraceSampler::default();
    let mut of_trial: Option<(Arc<ArmModel>, Scene)> = None;
    let options = ReplayOptions { methods: methods.clone(), ..ReplayOptions::default() };
    let mut length = SimTime(0);
    let retraced = recompute_opened(open_checked(dir, checked, &options)?, |testbed, input| {
        of_trial.get_or_insert_with(|| (testbed.model().clone(), testbed.task().scene().clone()));
        sampler.take(testbed, input);
        length = testbed.now();
    })?;
    let (arm, scene) = of_trial.ok_or("the record holds no instant")?;
    let diverged = retraced.divergence.map(|at| {
        let [from, to] = [at.from.as_secs(), at.to.as_secs()];
        Flaw::Diverged(format!(
            "the recomputed trial is not the recorded one between {from:.3} s and {to:.3} s; proact replay says more"
        ))
    });
    let other_result =
        retraced.result.as_ref().map(|recorded| result_difference(recorded, &retraced.recomputed_result));
    let other_result = other_result.transpose()?.flatten().map(Flaw::ResultMismatch);
    let trace = Trace {
        points: trace_points(&arm, &scene, &sampler.states)?,
        scene,
        joints: ranges(&arm),
        duration: length,
        events: retraced.events,
        decisions: retraced.config.emg.as_ref().map(|_| retraced.decisions),
        trunk: read_trunk(dir)?,
        has_all_events: true,
        task_metrics: retraced
            .result
            .map_or_else(BTreeMap::new, |_| numeric_results(&retraced.recomputed_result.result)),
    };
    Ok(RecomputedTrace { trace, diverged, result_mismatch: other_result })
}

/// The first key of a recorded result whose value is not that of the recomputed trial, as a sentence. Left out is what cannot be
/// recomputed: times on the clock, the place on disk, and what ended a trial that was broken off.
fn result_difference(
    recorded: &TrialResult,
    recomputed: &TrialResult,
) -> Result<Option<String>, serde_json::Error> {
    let ended = if recorded.is_aborted() { recorded.ended } else { recomputed.ended };
    let recomputed = TrialResult {
        wall_seconds: recorded.wall_seconds,
        real_time_factor: recorded.real_time_factor,
        trial_dir: recorded.trial_dir.clone(),
        ended,
        ..recomputed.clone()
    };
    // Written and read as the recorded one was, so that each number is rounded alike.
    let recomputed: TrialResult = serde_json::from_slice(&serde_json::to_vec(&recomputed)?)?;
    let difference =
        first_difference("", &serde_json::to_value(recorded)?, &serde_json::to_value(recomputed)?);
    Ok(difference.map(|(key, [recorded, recomputed])| {
        format!("{RESULT_FILE} has {key} = {recorded}, the recomputed trial has {recomputed}")
    }))
}

/// The first place in which two values differ, such as `outcomes.2.outcome`, and what each has there.
fn first_difference(location: &str, one: &Value, other: &Value) -> Option<(String, [String; 2])> {
    let below = |key: &str| if location.is_empty() { key.to_owned() } else { format!("{location}.{key}") };
    let value_text = |value: Option<&Value>| value.map_or_else(|| "nothing".to_owned(), Value::to_string);
    let here = || (location.to_owned(), [value_text(Some(one)), value_text(Some(other))]);
    match (one, other) {
        (Value::Object(one), Value::Object(other)) => {
            let keys: BTreeSet<&String> = one.keys().chain(other.keys()).collect();
            keys.into_iter().find_map(|key| match (one.get(key), other.get(key)) {
                (Some(one), Some(other)) => first_difference(&below(key), one, other),
                (one, other) => Some((below(key), [value_text(one), value_text(other)])),
            })
        }
        (Value::Array(one), Value::Array(other)) if one.len() == other.len() => {
            let mut both = one.iter().zip(other).enumerate();
            both.find_map(|(k, (one, other))| first_difference(&below(&(k + 1).to_string()), one, other))
        }
        _ => (one != other).then(here),
    }
}

/// The same trial from its bag.
///
/// # Errors
/// A bag without what scoring needs.
fn trace_from_record_bag(
    dir: &Path,
    checked: &CheckedRecord,
    bag: &Path,
) -> Result<(Trace, Option<Flaw>), Box<dyn Error>> {
    let arm = Arm::from_record(dir, &checked.config)?;
    let task = checked.config.build_task(arm.model())?;
    let watched = bag_playback::sample_bag(bag, arm.model(), task, StartPoses::FromTask, PERIOD_MS)?;
    let scene = watched.task.scene().clone();
    let trace = Trace {
        points: trace_points(arm.model(), &scene, &scorable_states(&watched, bag)?)?,
        scene,
        joints: ranges(arm.model()),
        duration: checked.record.end(),
        events: checked.record.events()?,
        // Keys make no decisions of an armband.
        decisions: checked.config.emg.as_ref().map(|_| watched.decisions),
        trunk: read_trunk(dir)?,
        has_all_events: true,
        task_metrics: checked
            .result
            .as_ref()
            .map_or_else(BTreeMap::new, |result| numeric_results(&result.result)),
    };
    Ok((trace, gap_in(&watched)))
}

/// What a bag lacks between instants that can be scored.
fn gap_in(watched: &bag_playback::BagFrames) -> Option<Flaw> {
    let spans =
        watched.gaps.iter().map(|[from, to]| format!("from {:.2} to {:.2} s", from.as_secs(), to.as_secs()));
    let spans: Vec<String> = spans.collect();
    (!spans.is_empty()).then(|| Flaw::Gap(spans.join(", ")))
}

/// The bag in a record: `trial.bag`, in a study `participantP-modeM-trialT.bag`.
fn bag_in(dir: &Path) -> std::io::Result<Option<PathBuf>> {
    for entry in fs::read_dir(dir)? {
        let path = entry?.path();
        if path.extension().is_some_and(|ending| ending == "bag") {
            return Ok(Some(path));
        }
    }
    Ok(None)
}

/// A bag of the original lab: what was seen, and what came of it by our rules.
pub(super) struct BagTrace {
    /// The trial.
    pub(super) trace: Trace,
    /// The control method by the file's name, such as `A`; `?` if it has none.
    pub(super) method: String,
    /// What the task makes of it; none of a bag that breaks off before the trial may have ended.
    pub(super) result: Option<TaskResult>,
    /// What is wrong with the bag.
    pub(super) flaws: Vec<Flaw>,
}

/// The trace of the bag at `path`, which holds a trial of the original's task with `arm`.
///
/// # Errors
/// A file that is no bag of a trial, or lacks what scoring needs.
pub(super) fn trace_from_bag(path: &Path, arm: &Arm) -> Result<BagTrace, Box<dyn Error>> {
    let task = bag_playback::default_task();
    let watched = bag_playback::sample_bag(path, arm.model(), task, StartPoses::FromBag, PERIOD_MS)?;
    let scene = watched.task.scene().clone();
    let seen = scorable_states(&watched, path)?;
    let last = watched.frames.last().ok_or("the bag holds no instant")?;
    let whole = watched.end == BagEnd::Complete;
    let cut = (!whole).then(|| Flaw::Truncated(watched.end.to_string()));
    Ok(BagTrace {
        method: last.method.clone(),
        result: whole.then(|| watched.task.result(&watched.bodies)),
        flaws: cut.into_iter().chain(gap_in(&watched)).chain([Flaw::BagOnly]).collect(),
        trace: Trace {
            points: trace_points(arm.model(), &scene, &seen)?,
            scene,
            joints: ranges(arm.model()),
            duration: last.time,
            events: watched.frames.iter().flat_map(|frame| frame.events.iter().cloned()).collect(),
            decisions: Some(watched.decisions).filter(|decisions| *decisions > 0),
            trunk: Vec::new(),
            has_all_events: false,
            task_metrics: BTreeMap::new(),
        },
    })
}

/// The instants of a bag that can be scored.
///
/// # Errors
/// A bag that lacks joints, base or objects.
fn scorable_states(
    watched: &bag_playback::BagFrames,
    path: &Path,
) -> Result<Vec<ObservedState>, Box<dyn Error>> {
    if watched.scored_frames.is_empty() {
        let missing = if watched.missing.is_empty() {
            "joints, base and objects at one time".to_owned()
        } else {
            watched.missing.join("; ")
        };
        return Err(format!("{}: cannot be scored, for the bag lacks {missing}", path.display()).into());
    }
    Ok(watched.scored_frames.iter().map(|index| ObservedState::of_frame(&watched.frames[*index])).collect())
}

/// What is known of a trial at one instant.
struct ObservedState {
    time: SimTime,
    /// All that move, rad.
    joints: JointVector,
    world_from_base: Pose,
    /// In the order of the scene.
    objects: Vec<Pose>,
    gaze: Option<GazeSample>,
    gesture: Command,
    next: Option<ObjectId>,
    goal: Option<TaskGoal>,
}

impl ObservedState {
    fn of_frame(frame: &DisplayFrame) -> Self {
        Self {
            time: frame.time,
            joints: frame.joints.clone(),
            world_from_base: frame.world_from_base,
            objects: frame.objects.clone(),
            gaze: frame.gaze,
            gesture: frame.command,
            next: frame.next_object,
            goal: frame.task_goal.clone(),
        }
    }
}

/// Keeps what is seen of a trial that is computed, each [`PERIOD_MS`].
#[derive(Default)]
struct TraceSampler {
    states: Vec<ObservedState>,
    /// The last valid gaze.
    gaze: Option<(SimTime, GazeSample)>,
}

impl TraceSampler {
    /// Takes the tick that the testbed has done with `input`.
    fn take(&mut self, testbed: &Testbed, input: &TickInput) {
        let now = testbed.now();
        let is_fixation = |gaze: &GazeSample| {
            gaze.valid
                && gaze.direction.norm() > 1e-9
                && gaze.origin.iter().chain(gaze.direction.iter()).all(|value| value.is_finite())
        };
        if let Some(gaze) = input.gaze.filter(is_fixation) {
            self.gaze = Some((now, gaze));
        }
        // A record begins with its first tick, and a bag with the state after it.
        if now == SimTime(0) || !now.0.is_multiple_of(PERIOD_MS) {
            return;
        }
        let (state, task) = (testbed.plant().state(), testbed.task().state());
        self.states.push(ObservedState {
            time: now,
            joints: state.position.clone(),
            world_from_base: state.world_from_base,
            objects: state.objects.iter().map(|body| body.pose).collect(),
            gaze: self.gaze.filter(|(at, _)| now.millis_since(*at) <= GAZE_MAX_AGE_MS).map(|(_, gaze)| gaze),
            gesture: testbed.command(),
            next: task.next_object,
            goal: task.goal.clone(),
        });
    }
}

/// A trial as scoring sees it, while it goes on.
pub(crate) struct LiveTraceBuilder {
    scene: Scene,
    sampler: TraceSampler,
    events: Vec<Event>,
    duration: SimTime,
    /// None without an armband.
    decisions: Option<u64>,
}

impl LiveTraceBuilder {
    /// Before the first tick of a trial.
    pub(crate) fn new(testbed: &Testbed) -> Self {
        Self {
            scene: testbed.task().scene().clone(),
            sampler: TraceSampler::default(),
            events: Vec::new(),
            duration: SimTime(0),
            decisions: testbed.config().emg.as_ref().map(|_| 0),
        }
    }

    /// Takes a tick, after which the testbed is as it is.
    pub(crate) fn add_step(&mut self, step: &TrialStep, testbed: &Testbed) {
        self.duration = step.time;
        self.events.extend(step.output.events.iter().cloned());
        self.sampler.take(testbed, &step.input);
        if let Some(decisions) = &mut self.decisions {
            *decisions += u64::from(step.output.published_command.is_some());
        }
    }

    /// What is found in the trial that is over.
    ///
    /// # Errors
    /// An arm or a scene without a grasp.
    pub(crate) fn finish_and_score(
        self,
        arm: &ArmModel,
        result: &Map<String, Value>,
    ) -> Result<TrialScores, Box<dyn Error>> {
        let trace = Trace {
            points: trace_points(arm, &self.scene, &self.sampler.states)?,
            scene: self.scene,
            joints: ranges(arm),
            duration: self.duration,
            events: self.events,
            decisions: self.decisions,
            trunk: Vec::new(),
            has_all_events: true,
            task_metrics: numeric_results(result),
        };
        let [measures, objects, phases, faults] = score_rows(&[], &trace);
        Ok(TrialScores { measures, objects, phases, faults })
    }
}

/// What of a task's result is a number.
fn numeric_results(result: &Map<String, Value>) -> BTreeMap<String, f64> {
    result.iter().filter_map(|(name, value)| Some((name.clone(), value.as_f64()?))).collect()
}

/// The last links of thumb and index finger, by their digits' names; none where the hand has no such.
fn thumb_and_index(arm: &ArmModel) -> Option<[usize; 2]> {
    let digits = arm.digits();
    let is_last = |link: usize| !arm.joints.iter().any(|joint| joint.parent == link);
    let end = |name: &str| {
        let named =
            |link: &usize| digits[*link].is_some() && is_last(*link) && arm.links[*link].name.contains(name);
        (0..arm.links.len()).find(named)
    };
    Some([end("thumb")?, end("index")?])
}

/// What the joints of the arm can do.
fn ranges(arm: &ArmModel) -> Vec<JointRange> {
    let range = |joint: &usize| {
        let limits = arm.joints[*joint].limits;
        JointRange { lower_rad: limits.lower, upper_rad: limits.upper, max_speed_rad_per_s: limits.velocity }
    };
    arm.arm.iter().map(range).collect()
}

fn trace_points(
    arm: &ArmModel,
    scene: &Scene,
    seen: &[ObservedState],
) -> Result<Vec<TracePoint>, Box<dyn Error>> {
    let center = GraspSelector::new(arm, scene)?.grasp_center_of(0).unwrap_or(Point::origin());
    // Place of each joint of the arm in the vector of those that move, and the link that it moves.
    let moving: Vec<usize> = arm.moving().collect();
    let indices: Vec<usize> =
        arm.arm.iter().filter_map(|joint| moving.iter().position(|other| other == joint)).collect();
    let ends = thumb_and_index(arm);
    let instant = |seen: &ObservedState| {
        let links = arm.link_poses(&seen.joints);
        let base = seen.world_from_base;
        let tip = base * links[arm.tip];
        let at = |joint: &usize| Point::from((base * links[arm.joints[*joint].child]).translation.vector);
        TracePoint {
            time: seen.time,
            world_from_base: base,
            world_from_tip: tip,
            grasp_center: tip * center,
            joint_positions: indices.iter().map(|joint_index| seen.joints[*joint_index]).collect(),
            joint_origins: arm.arm.iter().map(at).collect(),
            objects: seen.objects.clone(),
            gaze: seen.gaze,
            gesture: seen.gesture,
            next: seen.next,
            goal: seen.goal.clone(),
            aperture_m: ends.map(|[thumb, index]| {
                (links[thumb].translation.vector - links[index].translation.vector).norm()
            }),
        }
    };
    Ok(seen.iter().map(instant).collect())
}

#[cfg(test)]
mod tests;
