use crate::Body;
use proact_types::{
    BlockId, DisplayFrame, Gesture, HandState, Intention, PlannerView, Point, Scene, SimTime, TrunkPosture,
    Vector,
};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;

/// Habits of a simulated participant. Times in milliseconds; sources in `instruments.md` where one has a number.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ParticipantOptions {
    /// From something shown to the beginning of an answer. Choice reaction takes 250 to 400 ms.
    pub reaction_ms: u64,
    /// Relaxed time between two gestures.
    pub relax_ms: u64,
    /// How long the marker must sit right before it is locked.
    pub dwell_ms: u64,
    /// How far the place marker may be off before it is locked, metres.
    pub place_tolerance_m: f64,
    /// Time from one blink to the next, on average.
    pub blink_interval_ms: u64,
    /// Length of a blink.
    pub blink_ms: u64,
}

impl Default for ParticipantOptions {
    fn default() -> Self {
        Self {
            reaction_ms: 250,
            relax_ms: 300,
            dwell_ms: 250,
            place_tolerance_m: 0.012,
            blink_interval_ms: 4000,
            blink_ms: 150,
        }
    }
}

/// Point of comfortable reach in `base_link` axes, metres: where a goal should lie when the trunk has moved.
const COMFORT: [f64; 3] = [0.38, -0.06, -0.43];
/// Weight of missing the comfortable point along x, y, z.
const COMFORT_WEIGHT: [f64; 3] = [1.0, 0.6, 0.4];
/// Weight of leaning, metres squared per radian squared.
const LEAN_WEIGHT: f64 = 0.02;
/// A gaze correction never exceeds this, metres: people look at what they mean.
const CORRECTION_MAX: f64 = 0.06;
/// Closing on nothing for this long means that the block was missed.
const MISSED_MILLIS: u64 = 900;
/// With the wrist this high above the table, hand and block are clear of walls and partition, metres: 0.152 of
/// partition and 0.15 from wrist to the block's lower end.
const CLEAR_HEIGHT: f64 = 0.30;
/// Holding WE without any movement for this long means that another posture is needed.
const STUCK_MILLIS: u64 = 1500;

/// A participant who follows the task's order with gaze-assisted control, methods C and D.
///
/// Sees each frame `reaction_ms` late, corrects the gaze when the marker is off, leans toward what is out of
/// comfortable reach, relaxes between gestures and tries again what did not work. Deterministic for its seed.
/// It is no evidence about people: its habits were chosen, not fitted.
pub struct SimulatedParticipant {
    options: ParticipantOptions,
    body: Body,
    scene: Scene,
    rng: ChaCha8Rng,
    seen: VecDeque<DisplayFrame>,
    goal: Option<Goal>,
    /// Where the eye rests relative to what it looks at, metres in `world`.
    correction: Vector,
    corrected_at: SimTime,
    right_since: Option<SimTime>,
    gesture: Gesture,
    wanted: Gesture,
    relax_until: SimTime,
    reached: bool,
    closed_since: Option<SimTime>,
    stuck_since: Option<SimTime>,
    /// Where the trunk is, and where it should go once the hand is clear of the box.
    posture: TrunkPosture,
    wanted_posture: TrunkPosture,
    attempt: u32,
    blink_at: SimTime,
}

/// What the participant is about.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Goal {
    Pick(BlockId),
    Place(BlockId),
}

impl SimulatedParticipant {
    /// A participant with `body` before `scene`.
    pub fn new(options: ParticipantOptions, body: Body, scene: &Scene, seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0x7061_7274_6963_6970);
        // Habits vary by about a tenth between people.
        let mut vary = |millis: u64| {
            let spread = Normal::new(1.0, 0.1).expect("a positive spread");
            (millis as f64 * f64::clamp(spread.sample(&mut rng), 0.7, 1.3)) as u64
        };
        let options = ParticipantOptions {
            reaction_ms: vary(options.reaction_ms),
            relax_ms: vary(options.relax_ms),
            dwell_ms: vary(options.dwell_ms),
            ..options
        };
        Self {
            options,
            body,
            scene: scene.clone(),
            rng,
            seen: VecDeque::new(),
            goal: None,
            correction: Vector::zeros(),
            corrected_at: SimTime(0),
            right_since: None,
            gesture: Gesture::NoMotion,
            wanted: Gesture::NoMotion,
            relax_until: SimTime(0),
            reached: false,
            closed_since: None,
            stuck_since: None,
            posture: TrunkPosture::default(),
            wanted_posture: TrunkPosture::default(),
            attempt: 0,
            blink_at: SimTime(options.blink_interval_ms),
        }
    }

    /// Looks at `frame` and acts. Called once per display frame.
    pub fn step(&mut self, frame: &DisplayFrame) -> Intention {
        let now = frame.time;
        self.seen.push_back(frame.clone());
        while self.seen.get(1).is_some_and(|f| now.millis_since(f.time) >= self.options.reaction_ms) {
            self.seen.pop_front();
        }
        let seen = self.seen.front().cloned().unwrap_or_else(|| frame.clone());

        self.decide(now, &seen);
        self.hand(now);
        let looked_at = self.looked_at(frame) + self.correction;
        let eye = frame.world_from_head.translation.vector;
        Intention {
            gesture: self.gesture,
            gaze_direction: (looked_at.coords - eye).try_normalize(1e-9).unwrap_or_else(Vector::x),
            eyes_open: self.eyes_open(now),
            trunk: self.posture,
        }
    }

    fn decide(&mut self, now: SimTime, seen: &DisplayFrame) {
        let goal = match (seen.hand.holds, seen.next_block) {
            (Some(block), _) => Some(Goal::Place(block)),
            (None, next) => next.map(Goal::Pick),
        };
        if goal != self.goal {
            self.goal = goal;
            self.correction = Vector::zeros();
            self.right_since = None;
            self.reached = false;
            self.stuck_since = None;
            self.attempt = 0;
            if let Some(goal) = goal {
                self.wanted_posture = self.comfortable(&self.place_of(goal, seen), 0);
            }
        }
        // A trunk that leans while the hand is down in the box drags it through walls and blocks.
        if seen.world_from_tip.translation.z > self.scene.table_height + CLEAR_HEIGHT {
            self.posture = self.wanted_posture;
        }
        self.wanted = match goal {
            None => Gesture::NoMotion,
            Some(Goal::Pick(block)) => self.pick(now, seen, block),
            Some(Goal::Place(block)) => self.place(now, seen, block),
        };
    }

    fn pick(&mut self, now: SimTime, seen: &DisplayFrame, block: BlockId) -> Gesture {
        if self.reached {
            return self.grip(now, seen);
        }
        match seen.hand.state {
            HandState::Open => {}
            HandState::Opening => return Gesture::NoMotion,
            HandState::Closing | HandState::Closed => return Gesture::HandOpen,
        }
        let right = seen.target.block == Some(block);
        if !right {
            self.look_away_from(now, seen, block);
        }
        if let Some(gesture) = self.lock(now, right, seen.target.locked) {
            return gesture;
        }
        self.approach(now, seen, Goal::Pick(block))
    }

    fn place(&mut self, now: SimTime, seen: &DisplayFrame, block: BlockId) -> Gesture {
        if self.reached {
            return Gesture::HandOpen;
        }
        let target = self.scene.targets[block.index()].centre;
        let error = seen.target.place.map_or(Vector::repeat(1.0), |marker| target - marker);
        let tolerance = self.options.place_tolerance_m * if seen.target.locked { 2.0 } else { 1.0 };
        let right = error.norm() < tolerance;
        // One correction per look: the marker has to be seen where it went before the next.
        if !right
            && !seen.target.locked
            && now.millis_since(self.corrected_at) > self.options.reaction_ms + 200
        {
            self.corrected_at = now;
            let corrected = self.correction + error.cap_magnitude(0.03) * 0.7;
            self.correction = corrected.cap_magnitude(CORRECTION_MAX);
        }
        if let Some(gesture) = self.lock(now, right, seen.target.locked) {
            return gesture;
        }
        self.approach(now, seen, Goal::Place(block))
    }

    /// Brings the selection to a lock on what is meant. None once it is there.
    fn lock(&mut self, now: SimTime, right: bool, locked: bool) -> Option<Gesture> {
        if !right {
            self.right_since = None;
        }
        match (right, locked) {
            (true, true) => None,
            (false, true) => Some(Gesture::WristFlexion),
            (false, false) => Some(Gesture::NoMotion),
            (true, false) => {
                let since = *self.right_since.get_or_insert(now);
                let long_enough = now.millis_since(since) >= self.options.dwell_ms;
                Some(if long_enough { Gesture::WristFlexion } else { Gesture::NoMotion })
            }
        }
    }

    /// Holds WE until the arm is there; takes another posture when it gets stuck.
    fn approach(&mut self, now: SimTime, seen: &DisplayFrame, goal: Goal) -> Gesture {
        let stuck = match &seen.planner {
            PlannerView::Arrived { intermediate: false } if self.gesture == Gesture::WristExtension => {
                self.reached = true;
                self.closed_since = None;
                return Gesture::NoMotion;
            }
            PlannerView::Arrived { .. } | PlannerView::Failed { .. } => true,
            PlannerView::Idle | PlannerView::Planning | PlannerView::Executing { .. } => false,
        };
        if !stuck || self.gesture != Gesture::WristExtension {
            self.stuck_since = None;
        } else if now.millis_since(*self.stuck_since.get_or_insert(now)) > STUCK_MILLIS {
            self.stuck_since = None;
            self.attempt += 1;
            // Stuck with the hand in the box: then the trunk moves all the same, and carefully.
            self.wanted_posture = self.comfortable(&self.place_of(goal, seen), self.attempt);
            self.posture = self.wanted_posture;
        }
        Gesture::WristExtension
    }

    /// Closes the hand on the block; opens it again and goes back when the block was missed.
    fn grip(&mut self, now: SimTime, seen: &DisplayFrame) -> Gesture {
        if seen.hand.state == HandState::Closed {
            let since = *self.closed_since.get_or_insert(now);
            if now.millis_since(since) > MISSED_MILLIS {
                self.reached = false;
                return Gesture::HandOpen;
            }
        }
        Gesture::HandClose
    }

    /// Shifts the gaze to the far side of the block that is meant, away from the one that lights up.
    fn look_away_from(&mut self, now: SimTime, seen: &DisplayFrame, block: BlockId) {
        let Some(wrong) = seen.target.block else { return };
        if seen.target.locked || now.millis_since(self.corrected_at) < self.options.reaction_ms + 400 {
            return;
        }
        self.corrected_at = now;
        let position = |b: BlockId| seen.blocks[b.index()].translation.vector;
        let away = (position(block) - position(wrong)).try_normalize(1e-6).unwrap_or_else(Vector::x);
        self.correction = (self.correction + away * 0.015).cap_magnitude(CORRECTION_MAX);
    }

    /// Relaxes for a moment between two gestures.
    fn hand(&mut self, now: SimTime) {
        if self.wanted == self.gesture {
            return;
        }
        if self.gesture != Gesture::NoMotion {
            self.gesture = Gesture::NoMotion;
            self.relax_until = now.plus_millis(self.options.relax_ms);
        } else if now >= self.relax_until {
            self.gesture = self.wanted;
        }
    }

    fn looked_at(&self, frame: &DisplayFrame) -> Point {
        match self.goal {
            Some(goal) => self.place_of(goal, frame),
            None => Point::new(0.0, 0.0, self.scene.table_height),
        }
    }

    fn place_of(&self, goal: Goal, frame: &DisplayFrame) -> Point {
        match goal {
            Goal::Pick(block) => Point::from(frame.blocks[block.index()].translation.vector),
            Goal::Place(block) => self.scene.targets[block.index()].centre,
        }
    }

    /// The posture that brings `point` nearest to comfortable reach for the least lean; later attempts try
    /// neighbouring postures.
    fn comfortable(&mut self, point: &Point, attempt: u32) -> TrunkPosture {
        let mut best = (f64::INFINITY, TrunkPosture::default());
        let steps = |max: f64, from: f64| {
            (0..=12).map(move |k| (from + (max - from) * f64::from(k) / 12.0).to_radians())
        };
        for forward in steps(self.body.forward_max_deg, 0.0) {
            for lateral in steps(self.body.lateral_max_deg, -self.body.lateral_max_deg) {
                for axial in steps(self.body.axial_max_deg, -self.body.axial_max_deg) {
                    let posture = TrunkPosture { forward, lateral, axial };
                    let seen_from_base = self.body.shoulder_pose(&posture).inverse_transform_point(point);
                    let reach: f64 = (0..3)
                        .map(|k| COMFORT_WEIGHT[k] * (seen_from_base.coords[k] - COMFORT[k]).powi(2))
                        .sum();
                    let lean = forward * forward + lateral * lateral + axial * axial;
                    let cost = reach + LEAN_WEIGHT * lean;
                    if cost < best.0 {
                        best = (cost, posture);
                    }
                }
            }
        }
        // A tenth of a radian of wandering per attempt, about what a person shifts on a chair.
        let wander = f64::from(attempt) * 0.05;
        let mut shift = |value: f64| value + wander * self.rng.random_range(-1.0..1.0);
        let posture = TrunkPosture {
            forward: shift(best.1.forward),
            lateral: shift(best.1.lateral),
            axial: shift(best.1.axial),
        };
        self.body.limit(posture)
    }

    fn eyes_open(&mut self, now: SimTime) -> bool {
        if now < self.blink_at {
            return true;
        }
        if now.millis_since(self.blink_at) < self.options.blink_ms {
            return false;
        }
        let mean = self.options.blink_interval_ms.max(2);
        self.blink_at = now.plus_millis(self.rng.random_range(mean / 2..mean * 3 / 2));
        true
    }
}
