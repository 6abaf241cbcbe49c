use super::object_centers;
use crate::{ConfigError, GraspSelector, TestbedError, TrialConfig};
use proact_arm::ArmModel;
use proact_control::ports::ArmKinematics;
use proact_intent::{
    Candidates, ExternalIntentModel, IntentModel, IntentOptions, IntentProcess, IntentReply, Posterior,
    gaze_plane_intersection,
};
use proact_tasks::TaskState;
use proact_types::{
    EventKind, GazeSample, Heartbeat, HeartbeatKind, InputSource, IntentAnswer, MethodNeeds, ObjectId,
    ObjectSet, PlaceRegion, PlantState, Point, Scene, SimTime, TaskContext, TickInput, Vector,
};
use std::sync::Arc;

/// A gaze expires after this, ms: without a newer valid one, nothing is highlighted, and nothing counts as looked at.
pub const GAZE_MAX_AGE_MS: u64 = 500;

/// The tracker's ray is the one before, although it may differ in `world`.
const REPEATED_GAZE: Heartbeat = Heartbeat { source: InputSource::EyeTracker, kind: HeartbeatKind::Repeated };

/// From gaze to what is meant: the posterior over objects, the highlighted one, and the place on the table.
pub struct IntentStage {
    model: Arc<ArmModel>,
    grasp_selector: GraspSelector,
    options: IntentOptions,
    scene: Scene,
    /// The method asks what the task says.
    uses_context: bool,
    gaze_filter: GazeFilter,
    /// The last gaze was no measurement.
    last_gaze_invalid: bool,
}

/// A gaze that entered the trial, with what its source says about it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GazeMeasurement {
    /// As it came.
    pub sample: GazeSample,
    /// It is that of a pointing device, which may rest.
    pub is_pointing_device: bool,
    /// The tracker sent the same ray before, although it may differ in `world`.
    pub is_repeated: bool,
}

impl GazeMeasurement {
    /// The gaze of a tick, if there is one.
    pub fn from_input(input: &TickInput) -> Option<Self> {
        let points = input.heartbeats.iter().any(|heartbeat| heartbeat.kind == HeartbeatKind::PointingDevice);
        let again = input.heartbeats.contains(&REPEATED_GAZE);
        input.gaze.map(|sample| Self { sample, is_pointing_device: points, is_repeated: again })
    }
}

/// What enters the intent stage in one tick.
#[derive(Clone, Copy, Debug)]
pub struct IntentInput<'a> {
    /// A new gaze.
    pub gaze: Option<GazeMeasurement>,
    /// The world after the tick before.
    pub world: &'a PlantState,
    /// The task after the tick before.
    pub task: &'a TaskState,
    /// What the input log has of an intent model in another process; none live.
    pub answer: Option<&'a IntentAnswer>,
}

/// What a new gaze says about its tracker.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GazeFreshness {
    /// It measured.
    Fresh,
    /// It sent the ray before once more.
    Repeated,
    /// It measured without seeing the eye.
    EyeLost,
}

/// What the intent stage says in one tick.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct IntentOutput {
    /// What was heard of the eye tracker in this tick; none without a new gaze.
    pub gaze_freshness: Option<GazeFreshness>,
    /// Probability of each object after the last valid gaze; all zero when it told nothing.
    pub posterior: Posterior,
    /// The object that is most likely meant; none when the eye was not seen for half a second.
    pub highlight: Option<ObjectId>,
    /// The place marker, on the table top, in `world`.
    pub place_point: Point,
    /// The last measurement, valid or not.
    pub gaze: Option<GazeSample>,
    /// When the eye was last seen.
    pub eye_seen_at: Option<SimTime>,
    /// What a model in another process answered in this tick.
    pub answer: Option<IntentAnswer>,
    /// Why the last answer of a model in another process is of no use, so that nothing is highlighted; none if it is.
    pub fault: Option<String>,
    /// What happened.
    pub events: Vec<EventKind>,
}

impl IntentStage {
    /// The stage of a trial before `scene`, by a method that `needs` this.
    ///
    /// # Errors
    /// Options that the intent model refuses, an arm without the poses that its grasps name.
    pub fn new(
        config: &TrialConfig,
        needs: MethodNeeds,
        model: Arc<ArmModel>,
        scene: &Scene,
    ) -> Result<Self, TestbedError> {
        let grasps = GraspSelector::new(&model, scene)?;
        Ok(Self {
            model,
            grasp_selector: grasps,
            options: config.intent,
            scene: scene.clone(),
            uses_context: needs.prior,
            gaze_filter: GazeFilter::new(config, scene)?,
            last_gaze_invalid: false,
        })
    }

    /// The same stage, whose model is that of `process`, where the configuration names a program; none in a replay.
    pub fn with_process(mut self, process: Option<Box<dyn IntentProcess>>) -> Self {
        if let IntentSource::External(model) = &mut self.gaze_filter.intent_source {
            model.set_process(process);
        }
        self
    }

    /// One tick. `kinematics` is that of the arm, base to tip.
    pub fn step(
        &mut self,
        now: SimTime,
        input: IntentInput<'_>,
        kinematics: &mut dyn ArmKinematics,
    ) -> IntentOutput {
        let mut output = IntentOutput::default();
        if let Some(gaze) = input.gaze {
            let sample = self.sanitize_gaze(&gaze.sample, &mut output.events);
            let same = self.gaze_filter.sample().is_some_and(|before| before == sample);
            output.gaze_freshness = Some(match sample.valid {
                true if !gaze.is_pointing_device && (same || gaze.is_repeated) => GazeFreshness::Repeated,
                true => GazeFreshness::Fresh,
                false => GazeFreshness::EyeLost,
            });
            let scene = self.candidates(&input, kinematics);
            output.answer = self.gaze_filter.update(now, &sample, &scene, input.answer);
        }
        output.posterior = self.gaze_filter.posterior().clone();
        output.highlight = self.gaze_filter.highlight(now);
        output.place_point = self.gaze_filter.place_point();
        output.gaze = self.gaze_filter.sample();
        output.eye_seen_at = self.gaze_filter.eye_seen_at();
        output.fault = self.gaze_filter.fault().map(str::to_owned);
        output
    }

    /// What the method takes of what the task says: without task context every object is due, and all that counts is when a
    /// new selection begins.
    fn context(&self, task: &TaskState, objects: usize) -> TaskContext {
        let context =
            if self.options.context_changes_at_grasp { task.context_at_grasp } else { task.context };
        let due = if self.uses_context { context.expected_objects } else { ObjectSet::first(objects) };
        TaskContext { expected_objects: due, ..context }
    }

    /// The gaze as the model takes it: one that is not finite or has no direction is a blink, and said once.
    fn sanitize_gaze(&mut self, gaze: &GazeSample, events: &mut Vec<EventKind>) -> GazeSample {
        let finite = gaze.origin.coords.iter().chain(gaze.direction.iter()).all(|v| v.is_finite());
        let usable = finite && (!gaze.valid || gaze.direction.norm() > 1e-9);
        if !usable && !self.last_gaze_invalid {
            events.push(EventKind::GazeUnusable);
        }
        self.last_gaze_invalid = !usable;
        let blink = GazeSample { origin: Point::origin(), direction: Vector::x(), valid: false };
        if usable { *gaze } else { blink }
    }

    /// Centre of the grasp of what the hand holds, otherwise of what it is nearest to, in the tip's frame.
    fn grasp_center(&self, world: &PlantState) -> Point {
        let held = world.attached.and_then(|(object, _)| self.grasp_selector.grasp_center_of(object));
        let center = held.or_else(|| self.grasp_selector.grasp_center(world));
        center.unwrap_or_else(|| Point::from(self.model.widest_grasp().center))
    }

    /// It is in a heap with another on it: who takes from a heap takes from its top.
    fn is_covered(&self, object: ObjectId, world: &PlantState) -> bool {
        let center = |id: ObjectId| world.objects[id.index()].pose.translation.vector;
        self.scene.objects[object.index()].loose && self.scene.is_covered(object, center)
    }

    fn candidates(&self, input: &IntentInput<'_>, kinematics: &mut dyn ArmKinematics) -> Candidates {
        let IntentInput { world, task, .. } = input;
        let tip = kinematics.forward(&world.position[..self.model.arm_count()]).ok();
        Candidates {
            centers: object_centers(world),
            pickable: self
                .scene
                .ids()
                .map(|id| task.candidates.contains(id) && !self.is_covered(id, world))
                .collect(),
            context: Some(self.context(task, world.objects.len())),
            tip: tip.map(|base_from_tip| world.world_from_base * base_from_tip * self.grasp_center(world)),
        }
    }
}

/// A gaze that passes a shelf's edge this closely means the shelf, metres: eye trackers are off by as much.
const SHELF_EDGE_MARGIN_M: f64 = 0.02;

/// Who says what is meant.
enum IntentSource {
    /// One of the program's own.
    BuiltIn(Box<dyn IntentModel>),
    /// One in another process.
    External(ExternalIntentModel),
}

/// Turns gaze samples into the highlighted object and the place marker.
pub struct GazeFilter {
    intent_source: IntentSource,
    /// Why the last answer of a model in another process is of no use.
    fault: Option<String>,
    hysteresis: f64,
    filter_ms: f64,
    place_region: PlaceRegion,
    table_height: f64,
    /// Other surfaces than the table, with their heights.
    shelves: Vec<(PlaceRegion, f64)>,
    posterior: Posterior,
    highlight: Option<ObjectId>,
    place_point: Point,
    last: Option<(SimTime, GazeSample)>,
    eye_seen_at: Option<SimTime>,
}

impl GazeFilter {
    /// The filter of a trial before `scene`.
    ///
    /// # Errors
    /// Options that the intent model refuses.
    pub fn new(config: &TrialConfig, scene: &Scene) -> Result<Self, ConfigError> {
        let own = config.intent_model.build(&config.intent)?;
        let outside = config.intent_process.as_ref().map(|_| ExternalIntentModel::new(config.intent));
        Ok(Self {
            intent_source: outside.map_or(IntentSource::BuiltIn(own), IntentSource::External),
            fault: None,
            hysteresis: config.intent.highlight_hysteresis,
            filter_ms: config.place_filter_ms as f64,
            place_region: scene.place_region,
            table_height: scene.table_height,
            shelves: scene.shelves(),
            posterior: vec![0.0; scene.objects.len()],
            highlight: None,
            place_point: scene.place_region.center(scene.table_height),
            last: None,
            eye_seen_at: None,
        })
    }

    /// A new measurement. A lost eye changes nothing until it is lost for too long; a look that tells the model
    /// nothing takes the highlight away, and so does a model in another process that fails. `logged` is the answer that the
    /// input log has of one; its answer comes back.
    pub fn update(
        &mut self,
        now: SimTime,
        gaze: &GazeSample,
        scene: &Candidates,
        logged: Option<&IntentAnswer>,
    ) -> Option<IntentAnswer> {
        let (found, answer) = match &mut self.intent_source {
            IntentSource::BuiltIn(model) => (Ok(model.observe(now, gaze, scene)), None),
            IntentSource::External(model) => {
                let IntentReply { answer, posterior } = model.observe(now, gaze, scene, logged);
                (posterior, Some(answer))
            }
        };
        self.fault = found.as_ref().err().map(|reason| format!("the intent model gives nothing: {reason}"));
        match found {
            Err(_) => {
                self.posterior.fill(0.0);
                self.highlight = None;
            }
            Ok(found) if gaze.valid => self.update_highlight(found),
            Ok(_) => {}
        }
        self.update_place(now, gaze);
        answer
    }

    /// What is meant by what the model `found`; none if the look told it nothing.
    fn update_highlight(&mut self, found: Option<Posterior>) {
        let count = self.posterior.len();
        let has_target = found.is_some();
        self.posterior = found.unwrap_or_else(|| vec![0.0; count]);
        let best =
            (0..count).fold(0, |best, k| if self.posterior[k] > self.posterior[best] { k } else { best });
        let kept = self.highlight.map(|b| self.posterior[b.index()] * self.hysteresis);
        self.highlight = match (has_target, kept, self.highlight) {
            (false, _, _) => None,
            (true, Some(kept), highlight) if kept >= self.posterior[best] => highlight,
            (true, _, _) => Some(ObjectId::new(best)),
        };
    }

    /// The place marker goes where the gaze meets a surface.
    fn update_place(&mut self, now: SimTime, gaze: &GazeSample) {
        let before = self.last.replace((now, *gaze)).map_or(now, |(time, _)| time);
        if !gaze.valid {
            return;
        }
        let on_table = || {
            let hit = gaze_plane_intersection(gaze, self.table_height)?;
            Some(self.place_region.clamp(&hit, self.table_height))
        };
        if let Some(hit) = self.shelf_point(gaze).or_else(on_table) {
            let fresh = self.eye_seen_at.is_none_or(|seen| now.millis_since(seen) > GAZE_MAX_AGE_MS);
            let elapsed = now.millis_since(before) as f64;
            let share = if fresh { 1.0 } else { 1.0 - (-elapsed / self.filter_ms.max(1e-9)).exp() };
            self.place_point += (hit - self.place_point) * share;
        }
        self.eye_seen_at = Some(now);
    }

    /// Where the gaze meets a shelf, or passes close beside one; of several the one that it meets first.
    fn shelf_point(&self, gaze: &GazeSample) -> Option<Point> {
        let met = |(region, height): &(PlaceRegion, f64)| {
            let hit = gaze_plane_intersection(gaze, *height)?;
            let on = region.clamp(&hit, *height);
            ((hit - on).norm() < SHELF_EDGE_MARGIN_M).then(|| ((hit - gaze.origin).norm(), on))
        };
        let met = self.shelves.iter().filter_map(met);
        met.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, on)| on)
    }

    /// Probability of each object after the last valid gaze; all zero when it told nothing.
    pub fn posterior(&self) -> &Posterior {
        &self.posterior
    }

    /// The object that is most likely meant; none when the eye was not seen for half a second.
    pub fn highlight(&self, now: SimTime) -> Option<ObjectId> {
        let fresh = self.eye_seen_at.is_some_and(|seen| now.millis_since(seen) <= GAZE_MAX_AGE_MS);
        self.highlight.filter(|_| fresh)
    }

    /// The place marker, on the table top, in `world`.
    pub fn place_point(&self) -> Point {
        self.place_point
    }

    /// When the eye was last seen.
    pub fn eye_seen_at(&self) -> Option<SimTime> {
        self.eye_seen_at
    }

    /// Why the last answer of a model in another process is of no use; none if it is, or if there is no such model.
    pub fn fault(&self) -> Option<&str> {
        self.fault.as_deref()
    }

    /// The last measurement, valid or not.
    pub fn sample(&self) -> Option<GazeSample> {
        self.last.map(|(_, gaze)| gaze)
    }
}
