//! A recorded trial as scoring sees it.

use super::scores::scores;
use crate::{Arm, film, film_of_bag, read_trunk, study::TrialScores};
use proact_analysis::scoring::{Instant, Trace};
use proact_arm::ArmModel;
use proact_control::MethodRegistry;
use proact_recording::{Trial, bag::BagEnd, read_result};
use proact_tasks::TaskResult;
use proact_testbed::{GraspChoice, Step, TrialConfig, TrialResult};
use proact_types::{DisplayFrame, Event, Point, Scene, SimTime};
use serde_json::{Map, Value};
use std::{
    collections::BTreeMap,
    error::Error,
    fs,
    path::{Path, PathBuf},
};

/// From one instant to the next, milliseconds: as often as a bag has joints.
const PERIOD_MS: u64 = 20;

/// The trace of the trial in `dir`: what was seen from its bag, or recomputed where it has none; what happened from its events.
///
/// # Errors
/// A record that cannot be read.
pub(super) fn of_record(methods: &MethodRegistry, dir: &Path) -> Result<Trace, Box<dyn Error>> {
    let record = Trial::open(dir)?;
    let config = TrialConfig::from_toml(&record.header().config_toml)?;
    let arm = Arm::recorded(dir, &config)?;
    let task = config.build_task(arm.model())?;
    let scene = task.scene().clone();
    let (frames, decisions) = if let Some(bag) = bag_in(dir)? {
        let watched = film_of_bag::watch(&bag, arm.model(), task, PERIOD_MS)?;
        // Keys make no decisions of an armband.
        (watched.frames, config.emg.as_ref().map(|_| watched.decisions))
    } else {
        (film::recompute(methods, dir)?.frames, None)
    };
    Ok(Trace {
        instants: instants(arm.model(), &scene, &frames)?,
        scene,
        length: record.end(),
        events: record.events()?,
        decisions,
        trunk: read_trunk(dir)?,
        tells_events: true,
        counted: record
            .finished()
            .then(|| read_result::<TrialResult>(dir))
            .transpose()?
            .map_or_else(BTreeMap::new, |result| numbers(&result.result)),
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
    /// What the task makes of it.
    pub(super) result: TaskResult,
    /// What is wrong with the bag.
    pub(super) flaw: Option<String>,
}

/// The trace of the bag at `path`, which holds a trial of the original's task with `arm`.
///
/// # Errors
/// A file that is no bag of a trial.
pub(super) fn of_bag(path: &Path, arm: &Arm) -> Result<OfBag, Box<dyn Error>> {
    let watched = film_of_bag::watch(path, arm.model(), film_of_bag::default_task(), PERIOD_MS)?;
    let scene = watched.task.scene().clone();
    let last = watched.frames.last().ok_or("the bag holds no instant")?;
    Ok(OfBag {
        method: last.method.clone(),
        result: watched.task.result(&watched.bodies),
        flaw: (watched.end != BagEnd::Whole).then(|| watched.end.to_string()),
        trace: Trace {
            instants: instants(arm.model(), &scene, &watched.frames)?,
            scene,
            length: last.time,
            events: watched.frames.iter().flat_map(|frame| frame.events.iter().cloned()).collect(),
            decisions: Some(watched.decisions).filter(|decisions| *decisions > 0),
            trunk: Vec::new(),
            tells_events: false,
            counted: BTreeMap::new(),
        },
    })
}

/// A trial as scoring sees it, while it goes on: as often as a recomputed record has instants.
pub(crate) struct LiveTrace {
    scene: Scene,
    frames: Vec<DisplayFrame>,
    events: Vec<Event>,
    length: SimTime,
    count: u64,
}

impl LiveTrace {
    /// Before the first tick of a trial with this scene.
    pub(crate) fn new(scene: Scene) -> Self {
        Self { scene, frames: Vec::new(), events: Vec::new(), length: SimTime(0), count: 0 }
    }

    /// Takes a tick.
    pub(crate) fn take(&mut self, step: &Step) {
        self.length = step.time;
        self.events.extend(step.output.events.iter().cloned());
        if let Some(frame) = &step.frame {
            self.count += 1;
            if self.count % film::KEPT == 1 {
                self.frames.push(DisplayFrame::clone(frame));
            }
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
            instants: instants(arm, &self.scene, &self.frames)?,
            scene: self.scene,
            length: self.length,
            events: self.events,
            decisions: None,
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

fn instants(arm: &ArmModel, scene: &Scene, frames: &[DisplayFrame]) -> Result<Vec<Instant>, Box<dyn Error>> {
    let centre = GraspChoice::new(arm, scene)?.centre_of(0).unwrap_or(Point::origin());
    // Place of each joint of the arm in the vector of those that move, and the link that it moves.
    let moving: Vec<usize> = arm.moving().collect();
    let places: Vec<usize> =
        arm.arm.iter().filter_map(|joint| moving.iter().position(|other| other == joint)).collect();
    let ends = thumb_and_index(arm);
    let instant = |frame: &DisplayFrame| {
        let links = arm.link_poses(&frame.joints);
        let at = |joint: &usize| {
            Point::from((frame.world_from_base * links[arm.joints[*joint].child]).translation.vector)
        };
        Instant {
            time: frame.time,
            base: frame.world_from_base,
            tip: frame.world_from_tip,
            hand: frame.world_from_tip * centre,
            joints: places.iter().map(|place| frame.joints[*place]).collect(),
            places: arm.arm.iter().map(at).collect(),
            objects: frame.objects.clone(),
            gaze: frame.gaze,
            gesture: frame.gesture,
            next: frame.next,
            asked: frame.asked.clone(),
            aperture: ends.map(|[thumb, index]| {
                (links[thumb].translation.vector - links[index].translation.vector).norm()
            }),
        }
    };
    Ok(frames.iter().map(instant).collect())
}
