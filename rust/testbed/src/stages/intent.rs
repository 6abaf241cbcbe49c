use super::block_centres;
use crate::{ConfigError, TrialConfig};
use proact_arm::ArmModel;
use proact_control::ports::ArmKinematics;
use proact_intent::{Candidates, IntentModel, IntentOptions, Posterior, table_hit};
use proact_tasks::{PlaceRegion, TABLE_TOP, TaskState};
use proact_types::{
    BlockId, EventKind, GazeSample, InputSign, InputSource, PlantState, Point, SignKind, SimTime, TickInput,
    Vector,
};
use std::sync::Arc;

/// Without a valid gaze for this long, nothing is highlighted, ms.
const GAZE_MAX_AGE: u64 = 500;

/// The tracker's ray is the one before, although it may differ in `world`.
const AGAIN: InputSign = InputSign { source: InputSource::EyeTracker, kind: SignKind::Repeated };

/// From gaze to what is meant: the posterior over blocks, the highlighted one, and the place on the table.
pub struct IntentStage {
    model: Arc<ArmModel>,
    options: IntentOptions,
    filter: GazeFilter,
    /// The last gaze was no measurement.
    unusable: bool,
}

/// A gaze that entered the trial, with what its source says about it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GazeMeasurement {
    /// As it came.
    pub sample: GazeSample,
    /// It is that of a pointing device, which may rest.
    pub points: bool,
    /// The tracker sent the same ray before, although it may differ in `world`.
    pub again: bool,
}

impl GazeMeasurement {
    /// The gaze of a tick, if there is one.
    pub fn of(input: &TickInput) -> Option<Self> {
        let points = input.signs.iter().any(|sign| sign.kind == SignKind::Points);
        let again = input.signs.contains(&AGAIN);
        input.gaze.map(|sample| Self { sample, points, again })
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
}

/// What a new gaze says about its tracker.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GazeHeard {
    /// It measured.
    Fresh,
    /// It sent the ray before once more.
    Repeated,
    /// It measured without seeing the eye.
    Blank,
}

/// What the intent stage says in one tick.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct IntentOutput {
    /// What was heard of the eye tracker in this tick; none without a new gaze.
    pub heard: Option<GazeHeard>,
    /// Probability of each block after the last valid gaze; all zero when it told nothing.
    pub posterior: Posterior,
    /// The block that is most likely meant; none when the eye was not seen for half a second.
    pub highlight: Option<BlockId>,
    /// The place marker, on the table top, in `world`.
    pub place: Point,
    /// The last measurement, valid or not.
    pub gaze: Option<GazeSample>,
    /// When the eye was last seen.
    pub seen_at: Option<SimTime>,
    /// What happened.
    pub events: Vec<EventKind>,
}

impl IntentStage {
    /// The stage of a trial.
    ///
    /// # Errors
    /// Options that the intent model refuses.
    pub fn new(config: &TrialConfig, model: Arc<ArmModel>) -> Result<Self, ConfigError> {
        Ok(Self { model, options: config.intent, filter: GazeFilter::new(config)?, unusable: false })
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
            let sample = self.usable(&gaze.sample, &mut output.events);
            let same = self.filter.sample().is_some_and(|before| before == sample);
            output.heard = Some(match sample.valid {
                true if !gaze.points && (same || gaze.again) => GazeHeard::Repeated,
                true => GazeHeard::Fresh,
                false => GazeHeard::Blank,
            });
            let scene = self.candidates(&input, kinematics);
            self.filter.take(now, &sample, &scene);
        }
        output.posterior = *self.filter.posterior();
        output.highlight = self.filter.highlight(now);
        output.place = self.filter.place();
        output.gaze = self.filter.sample();
        output.seen_at = self.filter.seen_at();
        output
    }

    /// The gaze as the model takes it: one that is not finite or has no direction is a blink, and said once.
    fn usable(&mut self, gaze: &GazeSample, events: &mut Vec<EventKind>) -> GazeSample {
        let finite = gaze.origin.coords.iter().chain(gaze.direction.iter()).all(|v| v.is_finite());
        let usable = finite && (!gaze.valid || gaze.direction.norm() > 1e-9);
        if !usable && !self.unusable {
            events.push(EventKind::GazeUnusable);
        }
        self.unusable = !usable;
        let blink = GazeSample { origin: Point::origin(), direction: Vector::x(), valid: false };
        if usable { *gaze } else { blink }
    }

    fn candidates(&self, input: &IntentInput<'_>, kinematics: &mut dyn ArmKinematics) -> Candidates {
        let IntentInput { world, task, .. } = input;
        let held = world.attached.and_then(|(block, _)| BlockId::ALL.get(block));
        let tip = kinematics.forward(&world.position[..self.model.arm_count()]).ok();
        let centre = Point::from(self.model.grasp_centre);
        Candidates {
            centres: block_centres(world),
            pickable: task.pickable,
            last_released: self.options.last_colour(held.map(|block| block.colour()), task.last_released),
            tip: tip.map(|base_from_tip| world.world_from_base * base_from_tip * centre),
        }
    }
}

/// Turns gaze samples into the highlighted block and the place marker.
pub struct GazeFilter {
    model: Box<dyn IntentModel>,
    hysteresis: f64,
    filter_ms: f64,
    posterior: Posterior,
    highlight: Option<BlockId>,
    place: Point,
    last: Option<(SimTime, GazeSample)>,
    seen_at: Option<SimTime>,
}

impl GazeFilter {
    /// The filter of a trial.
    ///
    /// # Errors
    /// Options that the intent model refuses.
    pub fn new(config: &TrialConfig) -> Result<Self, ConfigError> {
        let model = config.intent_model.build(&config.intent_options())?;
        Ok(Self {
            model,
            hysteresis: config.intent.hysteresis,
            filter_ms: config.place_filter_ms as f64,
            posterior: [0.0; 4],
            highlight: None,
            place: PlaceRegion::DEFAULT.centre(),
            last: None,
            seen_at: None,
        })
    }

    /// A new measurement. A lost eye changes nothing until it is lost for too long; a look that tells the model
    /// nothing takes the highlight away.
    pub fn take(&mut self, now: SimTime, gaze: &GazeSample, scene: &Candidates) {
        let before = self.last.replace((now, *gaze)).map_or(now, |(time, _)| time);
        let found = self.model.observe(now, gaze, scene);
        if !gaze.valid {
            return;
        }
        self.posterior = found.unwrap_or([0.0; 4]);
        let best = (0..4).fold(0, |best, k| if self.posterior[k] > self.posterior[best] { k } else { best });
        let kept = self.highlight.map(|b| self.posterior[b.index()] * self.hysteresis);
        self.highlight = match (found, kept, self.highlight) {
            (None, _, _) => None,
            (Some(_), Some(kept), highlight) if kept >= self.posterior[best] => highlight,
            (Some(_), _, _) => Some(BlockId::ALL[best]),
        };

        if let Some(hit) = table_hit(gaze, TABLE_TOP) {
            let hit = PlaceRegion::DEFAULT.clamp(&hit);
            let fresh = self.seen_at.is_none_or(|seen| now.millis_since(seen) > GAZE_MAX_AGE);
            let elapsed = now.millis_since(before) as f64;
            let share = if fresh { 1.0 } else { 1.0 - (-elapsed / self.filter_ms.max(1e-9)).exp() };
            self.place += (hit - self.place) * share;
        }
        self.seen_at = Some(now);
    }

    /// Probability of each block after the last valid gaze; all zero when it told nothing.
    pub fn posterior(&self) -> &Posterior {
        &self.posterior
    }

    /// The block that is most likely meant; none when the eye was not seen for half a second.
    pub fn highlight(&self, now: SimTime) -> Option<BlockId> {
        let fresh = self.seen_at.is_some_and(|seen| now.millis_since(seen) <= GAZE_MAX_AGE);
        self.highlight.filter(|_| fresh)
    }

    /// The place marker, on the table top, in `world`.
    pub fn place(&self) -> Point {
        self.place
    }

    /// When the eye was last seen.
    pub fn seen_at(&self) -> Option<SimTime> {
        self.seen_at
    }

    /// The last measurement, valid or not.
    pub fn sample(&self) -> Option<GazeSample> {
        self.last.map(|(_, gaze)| gaze)
    }
}
