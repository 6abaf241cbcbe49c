//! What all simulated participants have in common: they see late, relax between gestures, blink, and lean.

use crate::{
    Body, OutOfRange, PersonTraits,
    person::{ConfusionModel, DecisionTimer, GazeModel, MotorSkill, Perception},
};
use proact_types::{
    Command, DisplayFrame, Intention, JointVector, Point, Pose, SimTime, TrunkPosture, Vector,
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
    /// Spread of the length of a movement gesture about the one meant, as a share of it.
    pub timing_relative_sd: f64,
    /// Time from one blink to the next, on average.
    pub blink_interval_ms: u64,
    /// Length of a blink.
    pub blink_ms: u64,
    /// Root mean square error of the participant's eye tracker, degrees (paper: "within a 1.5 degree error").
    pub gaze_error_deg: f64,
    /// What makes a person of the participant; nobody's by default.
    #[serde(skip_serializing_if = "PersonTraits::is_default")]
    pub person: PersonTraits,
}

impl ParticipantOptions {
    /// Checks ranges.
    ///
    /// # Errors
    /// The first key that is out of range.
    pub fn check(&self) -> Result<(), OutOfRange> {
        let times = [
            ("participant.reaction_ms", self.reaction_ms, 0..=10_000, "0 to 10000"),
            ("participant.relax_ms", self.relax_ms, 0..=10_000, "0 to 10000"),
            ("participant.dwell_ms", self.dwell_ms, 0..=10_000, "0 to 10000"),
            ("participant.blink_interval_ms", self.blink_interval_ms, 100..=3_600_000, "100 to 3600000"),
            ("participant.blink_ms", self.blink_ms, 0..=10_000, "0 to 10000"),
        ];
        for (key, got, allowed, expected) in times {
            if !allowed.contains(&got) {
                return Err(OutOfRange { key, got: got.to_string(), expected });
            }
        }
        let numbers = [
            ("participant.place_tolerance_m", self.place_tolerance_m, 0.001..=0.2, "0.001 to 0.2"),
            ("participant.timing_relative_sd", self.timing_relative_sd, 0.0..=1.0, "0 to 1"),
            ("participant.gaze_error_deg", self.gaze_error_deg, 0.0..=45.0, "0 to 45"),
        ];
        for (key, got, allowed, expected) in numbers {
            if !allowed.contains(&got) {
                return Err(OutOfRange { key, got: got.to_string(), expected });
            }
        }
        self.person.check()
    }
}

impl Default for ParticipantOptions {
    fn default() -> Self {
        Self {
            reaction_ms: 250,
            relax_ms: 300,
            dwell_ms: 250,
            place_tolerance_m: 0.012,
            timing_relative_sd: 0.08,
            blink_interval_ms: 4000,
            blink_ms: 150,
            gaze_error_deg: 1.5,
            person: PersonTraits::default(),
        }
    }
}

/// With the wrist this high above the table, hand and block are clear of walls and partition, metres: 0.152 of
/// partition and 0.15 from wrist to the block's lower end.
const CLEAR_WRIST_HEIGHT_M: f64 = 0.30;

/// The body and the nerves of one participant.
pub(crate) struct SensorimotorModel {
    pub(crate) options: ParticipantOptions,
    pub(crate) rng: ChaCha8Rng,
    pub(crate) decision_timer: DecisionTimer,
    pub(crate) skill: MotorSkill,
    pub(crate) perception: Perception,
    confusion_model: ConfusionModel,
    gaze_model: GazeModel,
    /// Where the eye points, `world`.
    gaze: Vector,
    body: Body,
    table_height: f64,
    delayed_frames: VecDeque<DisplayFrame>,
    command: Command,
    relax_until: SimTime,
    posture: TrunkPosture,
    requested_posture: TrunkPosture,
    blink_at: SimTime,
}

impl SensorimotorModel {
    pub(crate) fn new(options: ParticipantOptions, body: Body, table_height: f64, seed: u64) -> Self {
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
        let person = &options.person;
        Self {
            options,
            rng,
            decision_timer: DecisionTimer::new(person, seed),
            skill: MotorSkill::new(person, seed),
            perception: Perception::new(person, seed),
            confusion_model: ConfusionModel::new(person, seed),
            gaze_model: GazeModel::new(person, seed),
            gaze: Vector::x(),
            body,
            table_height,
            delayed_frames: VecDeque::new(),
            command: Command::NoMotion,
            relax_until: SimTime(0),
            posture: TrunkPosture::default(),
            requested_posture: TrunkPosture::default(),
            blink_at: SimTime(options.blink_interval_ms),
        }
    }

    /// Takes in `frame`; what has been understood by now is one reaction time old.
    pub(crate) fn perceive(&mut self, frame: &DisplayFrame) -> DisplayFrame {
        self.delayed_frames.push_back(frame.clone());
        while self
            .delayed_frames
            .get(1)
            .is_some_and(|f| frame.time.millis_since(f.time) >= self.options.reaction_ms)
        {
            self.delayed_frames.pop_front();
        }
        let mut seen = self.delayed_frames.front().cloned().unwrap_or_else(|| frame.clone());
        self.perception.update(&mut seen, &self.gaze);
        // A trunk that leans while the hand is down in the box drags it through walls and blocks.
        if seen.world_from_tip.translation.z > self.table_height + CLEAR_WRIST_HEIGHT_M {
            self.posture = self.requested_posture;
        }
        seen
    }

    /// The gesture made now.
    pub(crate) fn command(&self) -> Command {
        self.command
    }

    /// What comes of all that at `frame`: muscles, eyes on what is `fixation_point`, trunk, and the own limb. The `hand` may be
    /// glanced at, `world`, where that is no selection.
    pub(crate) fn intention(
        &mut self,
        frame: &DisplayFrame,
        fixation_point: Point,
        hand: Option<Point>,
        limb: Option<JointVector>,
    ) -> Intention {
        let now = frame.time;
        let eye = frame.world_from_head.translation.vector;
        let target = self.gaze_model.step(now, fixation_point, hand);
        self.gaze = (target.coords - eye).try_normalize(1e-9).unwrap_or_else(Vector::x);
        Intention {
            gesture: self.confusion_model.step(now, self.command, &self.posture),
            gaze_direction: self.gaze,
            eyes_open: self.eyes_open(now),
            trunk: self.posture,
            limb,
        }
    }

    /// Goes over to `wanted`, relaxing for a moment between two gestures, and for as long as the arm is seen to
    /// be `stopped`: it waits for a relaxed hand.
    pub(crate) fn set_command(&mut self, now: SimTime, stopped: bool, wanted: Command) {
        let wanted = if stopped { Command::NoMotion } else { wanted };
        if wanted == self.command {
            return;
        }
        if self.command != Command::NoMotion {
            self.command = Command::NoMotion;
            self.relax_until = now.plus_millis(self.options.relax_ms);
        } else if now >= self.relax_until {
            self.command = wanted;
        }
    }

    /// Wants to lean as reaching asks for; later attempts try neighbouring postures. Stuck with the hand in the
    /// box, `at_once`, the trunk moves all the same.
    pub(crate) fn lean_to_reach(&mut self, attempt: u32, at_once: bool) {
        // Three degrees of wandering per attempt, about what a person shifts on a chair.
        let wander = f64::from(attempt) * 0.05;
        let [forward, lateral, axial] = self
            .body
            .reaching_posture_deg
            .map(|degrees| degrees.to_radians() + wander * self.rng.random_range(-1.0..1.0));
        self.requested_posture = self.body.clamp_posture(TrunkPosture { forward, lateral, axial });
        if at_once {
            self.posture = self.requested_posture;
        }
    }

    /// How the shoulder would move, `world`, if the trunk moved `point`, which it carries, by `shift`, and the posture that does
    /// it; none if it cannot.
    pub(crate) fn trunk_posture_for_shift(
        &self,
        point: &Point,
        shift: &Vector,
    ) -> Option<(Pose, TrunkPosture)> {
        let to = self.body.posture_moving_point(&self.posture, point, shift)?;
        let (from, there) = (self.body.shoulder_pose(&self.posture), self.body.shoulder_pose(&to));
        Some((there * from.inverse(), to))
    }

    /// Leans to `posture` at once; how long that takes to be seen done, ms.
    pub(crate) fn lean_to(&mut self, posture: TrunkPosture) -> u64 {
        let from = std::mem::replace(&mut self.posture, posture);
        self.requested_posture = posture;
        let secs = self.body.movement_secs(&from, &posture);
        (secs * 1e3) as u64 + self.options.reaction_ms
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::tests::body;

    #[test]
    fn a_hand_relaxes_while_the_arm_is_stopped_and_then_makes_the_gesture_again() {
        let mut sensorimotor = SensorimotorModel::new(ParticipantOptions::default(), body(), 0.8, 1);
        let mut make = |ms: u64, stopped: bool| {
            sensorimotor.set_command(SimTime(ms), stopped, Command::WristExtension);
            sensorimotor.command()
        };
        assert_eq!(make(1000, false), Command::WristExtension);
        assert_eq!(make(2000, true), Command::NoMotion);
        assert_eq!(make(5000, true), Command::NoMotion);
        assert_eq!(make(5017, false), Command::WristExtension);
    }
}
