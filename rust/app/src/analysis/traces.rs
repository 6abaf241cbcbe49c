//! A recorded trial as scoring sees it.
//!
//! There is one way from a trial to its scores: [`Seen`] instants on an even grid, from which [`instants`] makes what is scored.
//! They come from the trial as it is recomputed from its input log ([`Sampler`]), as it runs ([`LiveTrace`]), or from a bag where
//! there is nothing else.

use super::scores::scores;
use crate::{
    Arm, film_of_bag, read_trunk,
    replay::{Checked, ReplayOptions, check_record, check_versions, open_checked},
    retrace::retrace_opened,
    study::TrialScores,
};
use proact_analysis::scoring::{Instant, JointRange, Trace};
use proact_arm::ArmModel;
use proact_control::MethodRegistry;
use proact_recording::bag::BagEnd;
use proact_tasks::TaskResult;
use proact_testbed::{GraspChoice, Step, Testbed, TrialEnd, stages::GAZE_MAX_AGE_MS};
use proact_types::{
    DisplayFrame, Event, GazeSample, Gesture, JointVector, ObjectId, Point, Pose, Scene, SimTime, TaskGoal,
    TickInput,
};
use serde_json::{Map, Value};
use std::{
    collections::BTreeMap,
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
    Cut(String),
    /// A bag without the record of a trial.
    BagOnly,
    /// A record that this program cannot compute again, so that its bag is scored.
    Foreign(String),
    /// The trial that is recomputed from the input log is not the recorded one.
    Diverged(String),
    /// The trial was broken off, and its record closed.
    Interrupted,
}

impl Flaw {
    /// For a table.
    pub(crate) fn label(&self) -> &'static str {
        match self {
            Flaw::Cut(_) => "cut",
            Flaw::BagOnly => "bag_only",
            Flaw::Foreign(_) => "foreign",
            Flaw::Diverged(_) => "diverged",
            Flaw::Interrupted => "interrupted",
        }
    }
}

impl fmt::Display for Flaw {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Flaw::Cut(how) => write!(f, "{how}; it is scored as far as it goes, without a score of the trial"),
            Flaw::BagOnly => f.write_str(
                "a bag of the original lab does not tell what planner and grasp rule did, what ended the trial, nor its seed",
            ),
            Flaw::Foreign(why) => write!(f, "{why}. Its bag is scored"),
            Flaw::Diverged(at) => write!(f, "{at}; proact replay says more"),
            Flaw::Interrupted => f.write_str("the trial was interrupted; it is scored as far as it went"),
        }
    }
}

/// A recorded trial and what is wrong with it.
pub(super) struct OfRecord {
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
pub(super) fn of_record(methods: &MethodRegistry, dir: &Path) -> Result<OfRecord, Box<dyn Error>> {
    let checked = check_record(dir, true)?;
    let broken_off = checked
        .result
        .as_ref()
        .is_none_or(|result| !matches!(result.ended, TrialEnd::Task | TrialEnd::Failed));
    let mut flaws: Vec<Flaw> = broken_off.then_some(Flaw::Interrupted).into_iter().collect();
    let recomputed = check_versions(checked.record.header())
        .map_err(Box::from)
        .and_then(|()| recomputed(methods, dir, checked.clone()));
    let bag = || -> Result<Option<Trace>, Box<dyn Error>> {
        bag_in(dir)?.map(|bag| of_record_from_bag(dir, &checked, &bag)).transpose()
    };
    match recomputed {
        Ok((trace, None)) => Ok(OfRecord { trace, flaws }),
        // The bag has what happened, if there is one.
        Ok((trace, Some(diverged))) => {
            flaws.push(diverged);
            Ok(OfRecord { trace: bag()?.unwrap_or(trace), flaws })
        }
        Err(error) => match bag()? {
            Some(trace) => {
                flaws.push(Flaw::Foreign(error.to_string()));
                Ok(OfRecord { trace, flaws })
            }
            None => Err(error),
        },
    }
}

/// The trace of the trial in `dir`, recomputed, and where that is another trial than the recorded one.
///
/// # Errors
/// As [`retrace_opened`].
fn recomputed(
    methods: &MethodRegistry,
    dir: &Path,
    checked: Checked,
) -> Result<(Trace, Option<Flaw>), Box<dyn Error>> {
    let mut sampler = Sampler::default();
    let mut of_trial: Option<(Arc<ArmModel>, Scene)> = None;
    let options = ReplayOptions { methods: methods.clone(), ..ReplayOptions::default() };
    let mut length = SimTime(0);
    let retraced = retrace_opened(open_checked(dir, checked, &options)?, |testbed, input| {
        of_trial.get_or_insert_with(|| (testbed.model().clone(), testbed.task().scene().clone()));
        sampler.take(testbed, input);
        length = testbed.now();
    })?;
    let (arm, scene) = of_trial.ok_or("the record holds no instant")?;
    let diverged = retraced.divergence.map(|at| {
        let [from, to] = [at.from.as_secs(), at.to.as_secs()];
        Flaw::Diverged(format!(
            "the recomputed trial is not the recorded one between {from:.3} s and {to:.3} s"
        ))
    });
    let trace = Trace {
        instants: instants(&arm, &scene, &sampler.seen)?,
        scene,
        joints: ranges(&arm),
        length,
        events: retraced.events,
        decisions: retraced.config.emg.as_ref().map(|_| retraced.decisions),
        trunk: read_trunk(dir)?,
        tells_events: true,
        counted: retraced.result.map_or_else(BTreeMap::new, |result| numbers(&result.result)),
    };
    Ok((trace, diverged))
}

/// The same trial from its bag.
///
/// # Errors
/// A bag without what scoring needs.
fn of_record_from_bag(dir: &Path, checked: &Checked, bag: &Path) -> Result<Trace, Box<dyn Error>> {
    let arm = Arm::recorded(dir, &checked.config)?;
    let task = checked.config.build_task(arm.model())?;
    let watched = film_of_bag::watch(bag, arm.model(), task, PERIOD_MS)?;
    let scene = watched.task.scene().clone();
    Ok(Trace {
        instants: instants(arm.model(), &scene, &seen_in(&watched, bag)?)?,
        scene,
        joints: ranges(arm.model()),
        length: checked.record.end(),
        events: checked.record.events()?,
        // Keys make no decisions of an armband.
        decisions: checked.config.emg.as_ref().map(|_| watched.decisions),
        trunk: read_trunk(dir)?,
        tells_events: true,
        counted: checked.result.as_ref().map_or_else(BTreeMap::new, |result| numbers(&result.result)),
    })
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
pub(super) struct OfBag {
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
pub(super) fn of_bag(path: &Path, arm: &Arm) -> Result<OfBag, Box<dyn Error>> {
    let watched = film_of_bag::watch(path, arm.model(), film_of_bag::default_task(), PERIOD_MS)?;
    let scene = watched.task.scene().clone();
    let seen = seen_in(&watched, path)?;
    let last = watched.frames.last().ok_or("the bag holds no instant")?;
    let whole = watched.end == BagEnd::Whole;
    let cut = (!whole).then(|| Flaw::Cut(watched.end.to_string()));
    Ok(OfBag {
        method: last.method.clone(),
        result: whole.then(|| watched.task.result(&watched.bodies)),
        flaws: cut.into_iter().chain([Flaw::BagOnly]).collect(),
        trace: Trace {
            instants: instants(arm.model(), &scene, &seen)?,
            scene,
            joints: ranges(arm.model()),
            length: last.time,
            events: watched.frames.iter().flat_map(|frame| frame.events.iter().cloned()).collect(),
            decisions: Some(watched.decisions).filter(|decisions| *decisions > 0),
            trunk: Vec::new(),
            tells_events: false,
            counted: BTreeMap::new(),
        },
    })
}

/// The instants of a bag that can be scored.
///
/// # Errors
/// A bag that lacks joints, base or objects.
fn seen_in(watched: &film_of_bag::Watched, path: &Path) -> Result<Vec<Seen>, Box<dyn Error>> {
    if watched.scored.is_empty() {
        let missing = if watched.missing.is_empty() {
            "joints, base and objects at one time".to_owned()
        } else {
            watched.missing.join("; ")
        };
        return Err(format!("{}: cannot be scored, for the bag lacks {missing}", path.display()).into());
    }
    Ok(watched.scored.iter().map(|place| Seen::of_frame(&watched.frames[*place])).collect())
}

/// What is known of a trial at one instant.
struct Seen {
    time: SimTime,
    /// All that move, rad.
    joints: JointVector,
    world_from_base: Pose,
    /// In the order of the scene.
    objects: Vec<Pose>,
    gaze: Option<GazeSample>,
    gesture: Gesture,
    next: Option<ObjectId>,
    asked: Option<TaskGoal>,
}

impl Seen {
    fn of_frame(frame: &DisplayFrame) -> Self {
        Self {
            time: frame.time,
            joints: frame.joints.clone(),
            world_from_base: frame.world_from_base,
            objects: frame.objects.clone(),
            gaze: frame.gaze,
            gesture: frame.gesture,
            next: frame.next,
            asked: frame.asked.clone(),
        }
    }
}

/// Keeps what is seen of a trial that is computed, each [`PERIOD_MS`].
#[derive(Default)]
struct Sampler {
    seen: Vec<Seen>,
    /// The last valid gaze.
    gaze: Option<(SimTime, GazeSample)>,
}

impl Sampler {
    /// Takes the tick that the testbed has done with `input`.
    fn take(&mut self, testbed: &Testbed, input: &TickInput) {
        let now = testbed.now();
        let is_look = |gaze: &GazeSample| {
            gaze.valid
                && gaze.direction.norm() > 1e-9
                && gaze.origin.iter().chain(gaze.direction.iter()).all(|value| value.is_finite())
        };
        if let Some(gaze) = input.gaze.filter(is_look) {
            self.gaze = Some((now, gaze));
        }
        // A record begins with its first tick, and a bag with the state after it.
        if now == SimTime(0) || !now.0.is_multiple_of(PERIOD_MS) {
            return;
        }
        let (state, task) = (testbed.plant().state(), testbed.task().state());
        self.seen.push(Seen {
            time: now,
            joints: state.position.clone(),
            world_from_base: state.world_from_base,
            objects: state.objects.iter().map(|body| body.pose).collect(),
            gaze: self.gaze.filter(|(at, _)| now.millis_since(*at) <= GAZE_MAX_AGE_MS).map(|(_, gaze)| gaze),
            gesture: testbed.gesture(),
            next: task.next,
            asked: task.goal.clone(),
        });
    }
}

/// A trial as scoring sees it, while it goes on.
pub(crate) struct LiveTrace {
    scene: Scene,
    sampler: Sampler,
    events: Vec<Event>,
    length: SimTime,
    /// None without an armband.
    decisions: Option<u64>,
}

impl LiveTrace {
    /// Before the first tick of a trial.
    pub(crate) fn new(testbed: &Testbed) -> Self {
        Self {
            scene: testbed.task().scene().clone(),
            sampler: Sampler::default(),
            events: Vec::new(),
            length: SimTime(0),
            decisions: testbed.config().emg.as_ref().map(|_| 0),
        }
    }

    /// Takes a tick, after which the testbed is as it is.
    pub(crate) fn take(&mut self, step: &Step, testbed: &Testbed) {
        self.length = step.time;
        self.events.extend(step.output.events.iter().cloned());
        self.sampler.take(testbed, &step.input);
        if let Some(decisions) = &mut self.decisions {
            *decisions += u64::from(step.output.message.is_some());
        }
    }

    /// What is found in the trial that is over.
    ///
    /// # Errors
    /// An arm or a scene without a grasp.
    pub(crate) fn scores(
        self,
        arm: &ArmModel,
        result: &Map<String, Value>,
    ) -> Result<TrialScores, Box<dyn Error>> {
        let trace = Trace {
            instants: instants(arm, &self.scene, &self.sampler.seen)?,
            scene: self.scene,
            joints: ranges(arm),
            length: self.length,
            events: self.events,
            decisions: self.decisions,
            trunk: Vec::new(),
            tells_events: true,
            counted: numbers(result),
        };
        let [measures, objects, phases, faults] = scores(&[], &trace);
        Ok(TrialScores { measures, objects, phases, faults })
    }
}

/// What of a task's result is a number.
fn numbers(result: &Map<String, Value>) -> BTreeMap<String, f64> {
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
        JointRange { lower: limits.lower, upper: limits.upper, speed: limits.velocity }
    };
    arm.arm.iter().map(range).collect()
}

fn instants(arm: &ArmModel, scene: &Scene, seen: &[Seen]) -> Result<Vec<Instant>, Box<dyn Error>> {
    let centre = GraspChoice::new(arm, scene)?.centre_of(0).unwrap_or(Point::origin());
    // Place of each joint of the arm in the vector of those that move, and the link that it moves.
    let moving: Vec<usize> = arm.moving().collect();
    let places: Vec<usize> =
        arm.arm.iter().filter_map(|joint| moving.iter().position(|other| other == joint)).collect();
    let ends = thumb_and_index(arm);
    let instant = |seen: &Seen| {
        let links = arm.link_poses(&seen.joints);
        let base = seen.world_from_base;
        let tip = base * links[arm.tip];
        let at = |joint: &usize| Point::from((base * links[arm.joints[*joint].child]).translation.vector);
        Instant {
            time: seen.time,
            base,
            tip,
            hand: tip * centre,
            joints: places.iter().map(|place| seen.joints[*place]).collect(),
            places: arm.arm.iter().map(at).collect(),
            objects: seen.objects.clone(),
            gaze: seen.gaze,
            gesture: seen.gesture,
            next: seen.next,
            asked: seen.asked.clone(),
            aperture: ends.map(|[thumb, index]| {
                (links[thumb].translation.vector - links[index].translation.vector).norm()
            }),
        }
    };
    Ok(seen.iter().map(instant).collect())
}

#[cfg(test)]
mod tests;
