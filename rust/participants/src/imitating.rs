mod own_hand;

use crate::{
    Body, Participant, ParticipantOptions,
    choice::Choice,
    habits::Habits,
    jogging::{Attitude, Situation, Stage},
    reach::{ArmSense, HandGoal},
};
use own_hand::OwnHand;
use proact_arm::ArmModel;
use proact_types::{Briefing, DisplayFrame, Gesture, HandState, Intention, ObjectId, Point, Scene, SimTime};
use std::sync::Arc;

/// A hand that is closed on nothing for this long has missed, ms.
const MISSED_MILLIS: u64 = 900;
/// After so many tries in vain another object is taken, where the person may choose.
const GIVES_UP_AFTER: usize = 6;
/// What is this far above where it should be let go may fall, metres.
const FALL_HEIGHT: f64 = 0.04;

/// A participant whose own hand the arm imitates: brings it over what comes next and down, closes it, carries over, opens it. Sees each
/// frame `reaction_ms` late. Deterministic for its seed. It is no evidence about people.
///
/// Known weaknesses: the limb goes straight in its joints and at one speed, as people's do not; in tasks without objects it keeps
/// still.
pub struct ImitatingParticipant {
    habits: Habits,
    sense: ArmSense,
    choice: Choice,
    scene: Scene,
    hand: OwnHand,
    attitude: Attitude,
    stage: Stage,
    object: Option<ObjectId>,
    /// How often it was tried in vain.
    stuck: usize,
    closed_since: Option<SimTime>,
    decided: bool,
}

impl ImitatingParticipant {
    /// A participant with `body` before `scene` who was told `briefing`, and whose limb leads the arm `model`.
    pub fn new(
        options: ParticipantOptions,
        body: Body,
        scene: &Scene,
        briefing: &Briefing,
        model: Arc<ArmModel>,
        seed: u64,
    ) -> Self {
        Self {
            habits: Habits::new(options, body, scene.table_height, seed),
            sense: ArmSense::new(model),
            choice: Choice::new(scene, briefing),
            scene: scene.clone(),
            hand: OwnHand::default(),
            attitude: Attitude::new(),
            stage: Stage::Retreat,
            object: None,
            stuck: 0,
            closed_since: None,
            decided: false,
        }
    }

    fn decide(&mut self, now: SimTime, seen: &DisplayFrame) -> Gesture {
        self.keep_up(seen);
        let Some(block) = self.object else { return Gesture::NoMotion };
        if !self.decided {
            self.decided = self.habits.thinking.is_over(now);
            if !self.decided {
                return Gesture::NoMotion;
            }
        }
        let empty = seen.hand.holds.is_none();
        match (self.stage, seen.hand.state) {
            (Stage::Grip, _) => return self.grip(now, seen),
            (Stage::Release, _) if !empty => return Gesture::HandOpen,
            (Stage::Release, _) => self.enter(Stage::Retreat),
            // Left closed on nothing.
            (_, HandState::Closed) if empty => return Gesture::HandOpen,
            (Stage::Above | Stage::Hover | Stage::Down, HandState::Opening | HandState::Closing) => {
                return Gesture::NoMotion;
            }
            _ => {}
        }
        let target = self.choice.place(block, seen);
        let situation = Situation { sense: &self.sense, scene: &self.scene, seen, block, target };
        self.attitude.choose(&situation, self.stuck);
        let Some(q) = situation.arm_angles() else { return Gesture::NoMotion };
        let leant = situation.goal_of(self.stage, self.attitude.lean());
        // Down there first: from how the arm stands there it is thought back to what comes before, so that the way down is short.
        let (attitude, down) = match self.attitude.thought_of() {
            Some((attitude, down)) => (Some(*attitude), down.as_slice()),
            None => (None, q),
        };
        let goal = HandGoal { attitude, ..leant };
        let from = if matches!(self.stage, Stage::Lift | Stage::Retreat) { q } else { down };
        let to = self.sense.inverse(from, &goal, u32::MAX);
        if self.hand.toward(now, q, &to) {
            let (off, _) = goal.off(&situation.base_from_tip());
            self.arrived(off <= goal.point_done, off, seen);
        }
        Gesture::NoMotion
    }

    /// The limb has come as near as it gets: on to what comes next, or back up if that is not near enough.
    fn arrived(&mut self, near: bool, off: f64, seen: &DisplayFrame) {
        let next = match self.stage {
            Stage::Above => Stage::Hover,
            Stage::Hover => Stage::Down,
            Stage::Down | Stage::Grip if near => Stage::Grip,
            Stage::Lift => Stage::Carry,
            Stage::Carry if near => Stage::Lower,
            Stage::Lower | Stage::Release if near || off < FALL_HEIGHT => Stage::Release,
            Stage::Retreat => Stage::Above,
            Stage::Carry | Stage::Lower | Stage::Release => return self.stuck(seen, Stage::Lift),
            Stage::Down | Stage::Grip => return self.stuck(seen, Stage::Retreat),
        };
        self.enter(next);
    }

    /// The way was in vain: up again, and another attitude, place or object.
    fn stuck(&mut self, seen: &DisplayFrame, back: Stage) {
        self.stuck += 1;
        if self.stuck.is_multiple_of(GIVES_UP_AFTER) {
            match seen.hand.holds {
                Some(object) => self.choice.give_up_place(object, seen),
                None => self.choice.give_up(),
            }
        }
        self.hand.begin_anew();
        self.habits.lean_to_reach(self.stuck as u32, false);
        self.enter(back);
    }

    /// Follows what the display shows: which object, and whether the hand holds it.
    fn keep_up(&mut self, seen: &DisplayFrame) {
        let holding = matches!(self.stage, Stage::Lift | Stage::Carry | Stage::Lower | Stage::Release);
        match seen.hand.holds {
            Some(object) if !holding => {
                self.object = Some(object);
                self.stuck = 0;
                self.enter(Stage::Lift);
            }
            // It slipped away.
            None if holding && self.stage != Stage::Release => self.enter(Stage::Retreat),
            _ => {}
        }
        if seen.hand.holds.is_none() && self.stage != Stage::Release {
            self.choice.put_down();
            let next = self.choice.next(seen);
            if next != self.object {
                (self.object, self.stuck, self.decided) = (next, 0, false);
                self.habits.thinking.drop_it();
                self.habits.lean_to_reach(0, false);
                self.enter(Stage::Retreat);
            }
        }
    }

    fn enter(&mut self, stage: Stage) {
        self.stage = stage;
        self.closed_since = None;
        self.attitude.begin(stage);
        self.hand.begin();
    }

    /// Closes the hand; goes up again when it is closed on nothing.
    fn grip(&mut self, now: SimTime, seen: &DisplayFrame) -> Gesture {
        if seen.hand.state == HandState::Closed {
            let since = *self.closed_since.get_or_insert(now);
            if now.millis_since(since) > MISSED_MILLIS {
                self.stuck(seen, Stage::Retreat);
                return Gesture::HandOpen;
            }
        }
        Gesture::HandClose
    }

    fn looked_at(&mut self, frame: &DisplayFrame) -> Point {
        match self.object {
            Some(object) if frame.hand.holds == Some(object) => self.choice.place(object, frame),
            Some(object) => Point::from(frame.objects[object.index()].translation.vector),
            None => Point::new(0.0, 0.0, self.scene.table_height),
        }
    }
}

impl Participant for ImitatingParticipant {
    fn step(&mut self, frame: &DisplayFrame) -> Intention {
        let now = frame.time;
        let seen = self.habits.see(frame);
        let wanted = self.decide(now, &seen);
        self.habits.make(now, seen.stop.is_some(), wanted);
        let looked_at = self.looked_at(frame);
        let hand = Point::from(frame.world_from_tip.translation.vector);
        let limb = self.hand.to();
        self.habits.intend(frame, looked_at, Some(hand), limb)
    }
}
