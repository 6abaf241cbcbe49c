//! What the testbed shows: the gaze as it understands it, and the display frame.

use crate::{ConfigError, Testbed, TestbedError, TrialConfig};
use proact_control::ports::KinematicsError;
use proact_intent::{Candidates, IntentModel, Posterior, table_hit};
use proact_tasks::{PlaceRegion, TABLE_TOP};
use proact_types::{BlockId, DisplayFrame, GazeSample, Point, Pose, SimTime};

/// Without a valid gaze for this long, nothing is highlighted, ms.
const GAZE_MAX_AGE: u64 = 500;

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

impl Testbed {
    /// True if a display frame belongs to this tick: 60 Hz, by accumulation.
    pub fn frame_is_due(&self) -> bool {
        let frames = |tick: u64| tick * 60 / 1000;
        let tick = self.now.0;
        tick > 0 && frames(tick) > frames(tick - 1)
    }

    /// Where the hand takes a block, in `world`; none if the kinematics refuse the arm's angles.
    pub(crate) fn grasp_centre(&mut self) -> Option<Point> {
        let state = self.parts.plant.state();
        let base = state.world_from_base;
        let arm = &state.position[..self.parts.model.arm_count()];
        let tip = self.parts.kinematics.forward(arm).ok()?;
        Some(base * tip * Point::from(self.parts.model.grasp_centre))
    }

    /// The instant as drawn; events since the frame before go with it. `world_from_head` comes from whoever
    /// tracks the head.
    ///
    /// # Errors
    /// If the kinematics refuse the arm's angles.
    pub fn frame(&mut self, world_from_head: Pose) -> Result<DisplayFrame, TestbedError> {
        let state = self.parts.plant.state();
        let arm = self.parts.model.arm_count();
        let joints = state.position.clone();
        let world_from_base = state.world_from_base;
        let blocks: Vec<Pose> = state.blocks.iter().map(|b| b.pose).collect();
        let base_from_tip = self
            .parts
            .kinematics
            .forward(&joints[..arm])
            .map_err(|e: KinematicsError| TestbedError::Kinematics(e))?;
        let task = self.task.state();
        Ok(DisplayFrame {
            time: self.now,
            method: self.method.name().to_owned(),
            world_from_tip: world_from_base * base_from_tip,
            joints,
            world_from_base,
            world_from_head,
            blocks,
            hand: self.hand_view(),
            gaze: self.gaze.sample(),
            target: self.method.target(),
            planner: self.method.planner(),
            goal: self.arm.goal(),
            mode: self.method.mode(),
            stop: self.watch.stop().cloned(),
            gesture: self.gesture(),
            confidence: self.confidence,
            effort: self.effort,
            emg_source: self.config.gesture_source.clone(),
            time_left_secs: (self.config.limit_secs - self.now.as_secs()).max(0.0),
            next_block: task.next,
            on_target: task.on_target,
            finished: task.finished,
            events: std::mem::take(&mut self.unseen),
        })
    }
}
