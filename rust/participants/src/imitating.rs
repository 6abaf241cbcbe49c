mod leading_limb;

use crate::{
    Body, Participant, ParticipantOptions,
    jogging::{DecisionContext, HandTilt, TransferPhase},
    reach::{HandGoal, InternalArmModel},
    sensorimotor::SensorimotorModel,
    target_choice::TargetChoice,
};
use leading_limb::LeadingLimb;
use proact_arm::ArmModel;
use proact_types::{Briefing, Command, DisplayFrame, HandState, Intention, ObjectId, Point, Scene, SimTime};
use std::sync::Arc;

/// A hand that is closed on nothing for this long has missed, ms.
const MISSED_MILLIS: u64 = 900;
/// After so many tries in vain another object is taken, where the person may choose.
const MAX_ATTEMPTS: usize = 6;
/// What is this far above where it should be let go may fall, metres.
const MAX_DROP_HEIGHT_M: f64 = 0.04;

/// A participant whose own hand the arm imitates: brings it over what comes next and down, closes it, carries over, opens it. Sees each
/// frame `reaction_ms` late. Deterministic for its seed. It is no evidence about people.
///
/// Known weaknesses: the limb goes straight in its joints and at one speed, as people's do not; in tasks without objects it keeps
/// still.
pub struct ImitatingParticipant {
    sensorimotor: SensorimotorModel,
    arm_model: InternalArmModel,
    target_choice: TargetChoice,
    scene: Scene,
    leading_limb: LeadingLimb,
    hand_tilt: HandTilt,
    stage: TransferPhase,
    object: Option<ObjectId>,
    /// How often it was tried in vain.
    failed_attempts: usize,
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
            sensorimotor: SensorimotorModel::new(options, body, scene.table_height, seed),
            arm_model: InternalArmModel::new(model),
            target_choice: TargetChoice::new(scene, briefing),
            scene: scene.clone(),
            leading_limb: LeadingLimb::default(),
            hand_tilt: HandTilt::new(),
            stage: TransferPhase::Retreat,
            object: None,
            failed_attempts: 0,
            closed_since: None,
            decided: false,
        }
    }

    fn next_command(&mut self, now: SimTime, seen: &DisplayFrame) -> Command {
        self.update_from_display(seen);
        let Some(block) = self.object else { return Command::NoMotion };
        if !self.decided {
            self.decided = self.sensorimotor.decision_timer.is_decided(now);
            if !self.decided {
                return Command::NoMotion;
            }
        }
        let empty = seen.hand.held_object.is_none();
        match (self.stage, seen.hand.state) {
            (TransferPhase::Grip, _) => return self.close_hand(now, seen),
            (TransferPhase::Release, _) if !empty => return Command::HandOpen,
            (TransferPhase::Release, _) => self.enter_phase(TransferPhase::Retreat),
            // Left closed on nothing.
            (_, HandState::Closed) if empty => return Command::HandOpen,
            (
                TransferPhase::Above | TransferPhase::Hover | TransferPhase::Descend,
                HandState::Opening | HandState::Closing,
            ) => {
                return Command::NoMotion;
            }
            _ => {}
        }
        let target = self.target_choice.place_for(block, seen);
        let context =
            DecisionContext { sense: &self.arm_model, scene: &self.scene, frame: seen, block, target };
        self.hand_tilt.choose_orientation(&context, self.failed_attempts);
        let Some(q) = context.arm_angles() else { return Command::NoMotion };
        let leant = context.hand_goal_of(self.stage, self.hand_tilt.tilt_rad());
        // Down there first: from how the arm stands there it is thought back to what comes before, so that the way down is short.
        let (orientation, down) = match self.hand_tilt.planned_posture() {
            Some((orientation, down)) => (Some(*orientation), down.as_slice()),
            None => (None, q),
        };
        let goal = HandGoal { orientation, ..leant };
        let from = if matches!(self.stage, TransferPhase::Lift | TransferPhase::Retreat) { q } else { down };
        let to = self.arm_model.inverse(from, &goal, u32::MAX);
        if self.leading_limb.move_toward(now, q, &to) {
            let (off, _) = goal.error(&context.base_from_tip());
            self.finish_phase(off <= goal.point_tolerance_m, off, seen);
        }
        Command::NoMotion
    }

    /// The limb has come as near as it gets: on to what comes next, or back up if that is not near enough.
    fn finish_phase(&mut self, near: bool, off: f64, seen: &DisplayFrame) {
        let next = match self.stage {
            TransferPhase::Above => TransferPhase::Hover,
            TransferPhase::Hover => TransferPhase::Descend,
            TransferPhase::Descend | TransferPhase::Grip if near => TransferPhase::Grip,
            TransferPhase::Lift => TransferPhase::Carry,
            TransferPhase::Carry if near => TransferPhase::Lower,
            TransferPhase::Lower | TransferPhase::Release if near || off < MAX_DROP_HEIGHT_M => {
                TransferPhase::Release
            }
            TransferPhase::Retreat => TransferPhase::Above,
            TransferPhase::Carry | TransferPhase::Lower | TransferPhase::Release => {
                return self.retreat_and_retry(seen, TransferPhase::Lift);
            }
            TransferPhase::Descend | TransferPhase::Grip => {
                return self.retreat_and_retry(seen, TransferPhase::Retreat);
            }
        };
        self.enter_phase(next);
    }

    /// The way was in vain: up again, and another attitude, place or object.
    fn retreat_and_retry(&mut self, seen: &DisplayFrame, back: TransferPhase) {
        self.failed_attempts += 1;
        if self.failed_attempts.is_multiple_of(MAX_ATTEMPTS) {
            match seen.hand.held_object {
                Some(object) => self.target_choice.give_up_place(object, seen),
                None => self.target_choice.give_up(),
            }
        }
        self.leading_limb.restart_from_arm();
        self.sensorimotor.lean_to_reach(self.failed_attempts as u32, false);
        self.enter_phase(back);
    }

    /// Follows what the display shows: which object, and whether the hand holds it.
    fn update_from_display(&mut self, seen: &DisplayFrame) {
        let holding = matches!(
            self.stage,
            TransferPhase::Lift | TransferPhase::Carry | TransferPhase::Lower | TransferPhase::Release
        );
        match seen.hand.held_object {
            Some(object) if !holding => {
                self.object = Some(object);
                self.failed_attempts = 0;
                self.enter_phase(TransferPhase::Lift);
            }
            // It slipped away.
            None if holding && self.stage != TransferPhase::Release => {
                self.enter_phase(TransferPhase::Retreat)
            }
            _ => {}
        }
        if seen.hand.held_object.is_none() && self.stage != TransferPhase::Release {
            self.target_choice.put_down();
            let next = self.target_choice.next_object(seen);
            if next != self.object {
                (self.object, self.failed_attempts, self.decided) = (next, 0, false);
                self.sensorimotor.decision_timer.cancel();
                self.sensorimotor.lean_to_reach(0, false);
                self.enter_phase(TransferPhase::Retreat);
            }
        }
    }

    fn enter_phase(&mut self, stage: TransferPhase) {
        self.stage = stage;
        self.closed_since = None;
        self.hand_tilt.begin(stage);
        self.leading_limb.begin();
    }

    /// Closes the hand; goes up again when it is closed on nothing.
    fn close_hand(&mut self, now: SimTime, seen: &DisplayFrame) -> Command {
        if seen.hand.state == HandState::Closed {
            let since = *self.closed_since.get_or_insert(now);
            if now.millis_since(since) > MISSED_MILLIS {
                self.retreat_and_retry(seen, TransferPhase::Retreat);
                return Command::HandOpen;
            }
        }
        Command::HandClose
    }

    fn fixation_point(&mut self, frame: &DisplayFrame) -> Point {
        match self.object {
            Some(object) if frame.hand.held_object == Some(object) => {
                self.target_choice.place_for(object, frame)
            }
            Some(object) => Point::from(frame.objects[object.index()].translation.vector),
            None => Point::new(0.0, 0.0, self.scene.table_height),
        }
    }
}

impl Participant for ImitatingParticipant {
    fn step(&mut self, frame: &DisplayFrame) -> Intention {
        let now = frame.time;
        let seen = self.sensorimotor.perceive(frame);
        let wanted = self.next_command(now, &seen);
        self.sensorimotor.set_command(now, seen.stop.is_some(), wanted);
        let fixation_point = self.fixation_point(frame);
        let hand = Point::from(frame.world_from_tip.translation.vector);
        let limb = self.leading_limb.joints();
        self.sensorimotor.intention(frame, fixation_point, Some(hand), limb)
    }
}
