mod decision_context;
mod hand_tilt;
mod key_press;
mod modes;
mod movement;
mod obstacles;
mod residual_limb;

use crate::{
    Body, Participant, ParticipantOptions, reach::InternalArmModel, sensorimotor::SensorimotorModel,
    target_choice::TargetChoice,
};
pub(crate) use decision_context::DecisionContext;
use decision_context::ReachGoal;
pub(crate) use hand_tilt::HandTilt;
use key_press::KeyPress;
pub(crate) use modes::ModeCycle;
use movement::Movements;
use proact_arm::ArmModel;
use proact_types::{
    Briefing, Command, ControlledDof, DisplayFrame, HandState, Intention, ModeView, ObjectId, Point, Scene,
    SimTime,
};
use residual_limb::ResidualLimb;
use std::sync::Arc;

/// Modes are thought of as numbers: joints of the arm from 0, axes of the hand from here, three to go along and three to
/// turn about.
pub(crate) const FIRST_AXIS_MODE: u8 = 64;
const AXIS_MODES: u8 = 6;
/// After a movement the arm is watched for this long before the next decision, ms.
const WATCH_MILLIS: u64 = 450;
/// A block is let go with its centre this far above where it rests when the arm goes no lower, metres.
const MAX_DROP_HEIGHT_M: f64 = 0.04;
/// A block is gripped with the hand this far above its middle when the arm goes no lower, metres.
const MAX_GRIP_HEIGHT_M: f64 = 0.03;
/// Closing on nothing for this long means that the block was missed, ms.
const MISSED_MILLIS: u64 = 900;
/// As often the trunk corrects where the hand is before the arm has to.
const MAX_TRUNK_MOVES: usize = 3;
/// After so many times that the arm got stuck another object is taken, where the person may choose.
const MAX_ATTEMPTS: usize = 6;

/// A participant who jogs joint by joint or axis by axis, methods A and B.
///
/// Knows the arm well enough to tell which few joints would have to turn, and in which order the hand stays clear of
/// the box. Joint by joint it thinks of the whole way first, such as one joint that lifts, two that carry and one that
/// lowers, turns each of them once, and looks before the last; along the axes it looks after each movement. A movement
/// that brought too little has met something and is left for later; when none is left, the hand goes up and is leant
/// another way. Deterministic for its seed. A person without this model in the head needs longer; it is no evidence
/// about people.
///
/// Known weakness: it minds where fingers, wrist and forearm are, not the elbow; and now and then the hand comes down on
/// something several times before a way is found that is clear.
pub struct JoggingParticipant {
    sensorimotor: SensorimotorModel,
    arm_model: InternalArmModel,
    scene: Scene,
    target_choice: TargetChoice,
    phase: TransferPhase,
    block: Option<ObjectId>,
    /// How often the arm got stuck with this block.
    failed_attempts: usize,
    /// The arm is watched until then.
    watch_until: SimTime,
    /// Since when the hand is closed around the block, or on nothing.
    closed_since: Option<SimTime>,
    /// The block was gripped above its middle last time.
    grasped_high: bool,
    hand_tilt: HandTilt,
    movements: Movements,
    key_press: Option<KeyPress>,
    modes: ModeCycle,
    residual_limb: ResidualLimb,
    /// The mode that was decided for: nothing is left to think about once it is there.
    decided: bool,
    /// How often the trunk moved in this stage.
    trunk_moves: usize,
}

/// The number that a mode is thought of by.
pub(crate) fn mode_number(mode: &ModeView) -> u8 {
    match mode.controlled_dof {
        ControlledDof::Joint(joint) => joint,
        ControlledDof::Translation(axis) => FIRST_AXIS_MODE + axis,
        ControlledDof::Rotation(axis) => FIRST_AXIS_MODE + AXIS_MODES / 2 + axis,
    }
}

/// The way of one block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum TransferPhase {
    /// High, over the block.
    Above,
    /// Close over the block.
    Hover,
    /// Around the block.
    Descend,
    /// The hand closes.
    Grip,
    /// Up with it.
    Lift,
    /// High, over the target.
    Carry,
    /// Down to the table.
    Lower,
    /// The hand opens.
    Release,
    /// Up without it.
    Retreat,
}

impl JoggingParticipant {
    /// A participant with `body` before `scene` who was told `briefing` and knows the arm `model`.
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
            arm_model: InternalArmModel::new(model.clone()),
            scene: scene.clone(),
            target_choice: TargetChoice::new(scene, briefing),
            phase: TransferPhase::Above,
            block: None,
            failed_attempts: 0,
            watch_until: SimTime(0),
            closed_since: None,
            grasped_high: false,
            hand_tilt: HandTilt::new(),
            movements: Movements::default(),
            key_press: None,
            modes: ModeCycle::new(model.arm_count(), &[]),
            residual_limb: ResidualLimb::default(),
            decided: false,
            trunk_moves: 0,
        }
    }

    /// The same with a limb of which the joints `own` of the arm, by their positions in it, are left: the method does
    /// not drive these.
    pub fn with_residual_limb(mut self, own: Vec<usize>) -> Self {
        self.modes = ModeCycle::new(self.arm_model.joints(), &own);
        self.residual_limb = ResidualLimb::new(own);
        self
    }

    /// The same with a method that goes through the places `cycle` of the arm, in this order; the place behind the last joint is the
    /// hand, which this person then opens and closes in its mode.
    pub fn with_cycle(mut self, cycle: &[usize]) -> Self {
        self.modes = ModeCycle::of(self.arm_model.joints(), cycle);
        self
    }

    /// Opens or closes the hand: by HC, which toggles it, or in its mode.
    fn hand_command(&mut self, now: SimTime, seen: &DisplayFrame, opens: bool) -> Command {
        let Some(mode_view) = &seen.mode else { return Command::HandClose };
        let mode = mode_number(mode_view);
        let Some(hand) = self.modes.hand(mode) else { return Command::HandClose };
        if let Some(command) = self.modes.continue_change(now, mode, &self.sensorimotor) {
            return command;
        }
        if mode != hand {
            self.modes.start_change(mode, hand);
            return Command::HandOpen;
        }
        match opens == (mode_view.we_sign >= 0) {
            true => Command::WristExtension,
            false => Command::WristFlexion,
        }
    }

    fn next_command(&mut self, now: SimTime, seen: &DisplayFrame) -> Command {
        self.update_from_display(seen);
        let Some(block) = self.block else { return Command::NoMotion };
        let target = self.target_choice.place_for(block, seen);
        let context =
            DecisionContext { sense: &self.arm_model, scene: &self.scene, frame: seen, block, target };
        self.hand_tilt.choose_orientation(&context, self.failed_attempts);
        match self.phase {
            TransferPhase::Grip => return self.close_hand(now, seen),
            TransferPhase::Release if seen.hand.held_object.is_some() => {
                return self.hand_command(now, seen, true);
            }
            TransferPhase::Release => {
                self.enter_phase(TransferPhase::Retreat);
                return Command::NoMotion;
            }
            TransferPhase::Above | TransferPhase::Hover | TransferPhase::Descend
                if seen.hand.state == HandState::Closed =>
            {
                // The hand was left closed on nothing.
                return self.hand_command(now, seen, true);
            }
            _ => {}
        }
        if let Some(command) = self.continue_key_press(now, seen, block) {
            return command;
        }
        let Some(mode_view) = &seen.mode else { return Command::NoMotion };
        let mode = mode_number(mode_view);
        if let Some(command) = self.modes.continue_change(now, mode, &self.sensorimotor) {
            return command;
        }
        if mode < FIRST_AXIS_MODE {
            self.move_without_stop();
            // Joint after joint without a look in between; before the last one the hand has to be in its place.
            if let ([next, _, ..], true) = (self.movements.planned_turns(), now < self.watch_until)
                && next.joint != usize::from(mode)
                && !self.residual_limb.has_joint(next.joint)
            {
                self.modes.start_change(mode, next.joint as u8);
                return Command::HandOpen;
            }
        }
        if now < self.watch_until {
            return Command::NoMotion;
        }
        self.next_movement(now, seen, mode_view, block)
    }

    /// Follows what the display shows: which block, and whether the hand holds it.
    fn update_from_display(&mut self, seen: &DisplayFrame) {
        let holding = matches!(
            self.phase,
            TransferPhase::Lift | TransferPhase::Carry | TransferPhase::Lower | TransferPhase::Release
        );
        match seen.hand.held_object {
            Some(block) if !holding => {
                self.block = Some(block);
                self.enter_phase(TransferPhase::Lift);
            }
            None if holding && self.phase != TransferPhase::Release => {
                // It slipped away: begin again from above.
                self.block = self.choose_object(seen);
                self.enter_phase(TransferPhase::Retreat);
            }
            _ => {}
        }
        let next =
            if seen.hand.held_object.is_none() && !holding { Some(self.choose_object(seen)) } else { None };
        if let Some(next) = next.filter(|next| self.block != *next) {
            self.block = next;
            self.failed_attempts = 0;
            if self.phase != TransferPhase::Retreat {
                self.enter_phase(TransferPhase::Above);
            }
        }
    }

    /// The object to take next.
    fn choose_object(&mut self, seen: &DisplayFrame) -> Option<ObjectId> {
        self.target_choice.put_down();
        self.target_choice.next_object(seen)
    }

    fn enter_phase(&mut self, stage: TransferPhase) {
        self.phase = stage;
        self.closed_since = None;
        self.hand_tilt.begin(stage);
        self.movements.begin();
        self.key_press = None;
        self.modes.begin();
        self.residual_limb.begin();
        self.decided = false;
        self.trunk_moves = 0;
    }

    /// A movement gesture goes on until its time is over, or the display refuses it. What it brought is judged when
    /// the next one is thought of.
    fn continue_key_press(&mut self, now: SimTime, seen: &DisplayFrame, block: ObjectId) -> Option<Command> {
        let key_press = self.key_press.as_mut()?;
        let target = self.target_choice.place_for(block, seen);
        let context =
            DecisionContext { sense: &self.arm_model, scene: &self.scene, frame: seen, block, target };
        if key_press.continue_press(now, &context, self.sensorimotor.command()) {
            self.watch_until = now.plus_millis(WATCH_MILLIS + self.sensorimotor.options.reaction_ms);
        }
        key_press.command()
    }

    /// Joint by joint the hand goes all the way at once: what is in the way is passed by thinking of it before.
    fn move_without_stop(&mut self) {
        self.phase = match self.phase {
            TransferPhase::Above => TransferPhase::Descend,
            same => same,
        };
    }

    fn next_movement(
        &mut self,
        now: SimTime,
        seen: &DisplayFrame,
        mode_view: &ModeView,
        block: ObjectId,
    ) -> Command {
        if self.sensorimotor.command() == Command::HandOpen {
            return Command::NoMotion;
        }
        if !self.decided && !self.sensorimotor.decision_timer.is_decided(now) {
            return Command::NoMotion;
        }
        self.decided = false;
        let mode = mode_number(mode_view);
        let target = self.target_choice.place_for(block, seen);
        let context =
            DecisionContext { sense: &self.arm_model, scene: &self.scene, frame: seen, block, target };
        if let Some(key_press) = self.key_press.take() {
            self.sensorimotor
                .skill
                .update_from_movement(key_press.direction().0, key_press.progress_share(&context));
            self.movements.record_outcome(&key_press, &context);
        }
        let goal = context.hand_goal_of(self.phase, self.hand_tilt.tilt_rad());
        let reach_goal = ReachGoal { phase: self.phase, hand_goal: goal, selected_mode: mode };
        if self.residual_limb.reach(now, &context, &reach_goal, &mut self.movements) {
            return Command::NoMotion;
        }
        if self.trunk_moves < MAX_TRUNK_MOVES
            && let Some(posture) = context.trunk_posture_for(&reach_goal.hand_goal, &self.sensorimotor)
            && self.sensorimotor.skill.uses_trunk()
        {
            self.trunk_moves += 1;
            self.watch_until = now.plus_millis(self.sensorimotor.lean_to(posture));
            return Command::NoMotion;
        }
        let mode_error = match self.movements.next(&context, &reach_goal, &mut self.hand_tilt) {
            Ok(Some(mode_error)) => mode_error,
            Ok(None) => {
                self.finish_phase();
                return Command::NoMotion;
            }
            Err(()) => {
                // What was just tried in vain is not the way out either.
                let tried = self.movements.failed_directions(&reach_goal);
                self.retreat_and_retry(seen);
                if let Some(tried) = tried {
                    self.movements.begin_phase_avoiding(tried);
                }
                return Command::NoMotion;
            }
        };
        if mode_error.mode != mode {
            self.modes.start_change(mode, mode_error.mode);
            self.decided = true;
            return Command::HandOpen;
        }
        let key_press = KeyPress::new(&mode_error, mode_view, &context, &mut self.sensorimotor);
        let command = key_press.command().unwrap_or_default();
        self.key_press = Some(key_press);
        self.movements.start(&reach_goal);
        command
    }

    /// The stage's place is reached: on to the next.
    fn finish_phase(&mut self) {
        let next = match self.phase {
            TransferPhase::Above => TransferPhase::Hover,
            TransferPhase::Hover => TransferPhase::Descend,
            TransferPhase::Descend => TransferPhase::Grip,
            TransferPhase::Lift => TransferPhase::Carry,
            TransferPhase::Carry => TransferPhase::Lower,
            TransferPhase::Lower => TransferPhase::Release,
            TransferPhase::Retreat => TransferPhase::Above,
            same @ (TransferPhase::Grip | TransferPhase::Release) => same,
        };
        self.enter_phase(next);
    }

    /// No movement is left that would help: lets go if that is near enough, else goes up and tries another attitude
    /// of the hand, now and then another posture too.
    fn retreat_and_retry(&mut self, seen: &DisplayFrame) {
        let shape = |block: ObjectId| self.scene.objects[block.index()].shape;
        let goes_to = seen.hand.held_object.map(|block| self.target_choice.place_for(block, seen));
        let height = |block: ObjectId| {
            let at = seen.objects[block.index()].translation.z;
            at - goes_to.map_or(self.scene.table_height, |place_point| place_point.z)
                - shape(block).half_height()
        };
        if self.phase == TransferPhase::Lower
            && seen.hand.held_object.is_some_and(|block| height(block) < MAX_DROP_HEIGHT_M)
        {
            self.enter_phase(TransferPhase::Release);
            return;
        }
        let over = |block: ObjectId| {
            let center = seen.world_from_tip * self.arm_model.grasp_center(shape(block).grip_width());
            center.coords - seen.objects[block.index()].translation.vector
        };
        let gripped = |block: ObjectId| {
            let off = over(block);
            off.z < MAX_GRIP_HEIGHT_M && off.xy().norm() < 0.6 * shape(block).half_width()
        };
        if self.phase == TransferPhase::Descend && !self.grasped_high && self.block.is_some_and(gripped) {
            self.grasped_high = true;
            self.enter_phase(TransferPhase::Grip);
            return;
        }
        self.grasped_high = false;
        self.failed_attempts += 1;
        if self.failed_attempts.is_multiple_of(MAX_ATTEMPTS) && seen.hand.held_object.is_none() {
            self.target_choice.give_up();
        }
        if self.failed_attempts.is_multiple_of(3) {
            self.sensorimotor.lean_to_reach((self.failed_attempts / 3) as u32, false);
        }
        match (self.phase, seen.hand.held_object) {
            // Not even up: on with what comes next, from wherever the hand is.
            (TransferPhase::Retreat | TransferPhase::Lift, _) => self.finish_phase(),
            (_, Some(_)) => self.enter_phase(TransferPhase::Lift),
            (_, None) => self.enter_phase(TransferPhase::Retreat),
        }
    }

    /// Closes the hand; when it closed on nothing, opens it again and goes back up.
    fn close_hand(&mut self, now: SimTime, seen: &DisplayFrame) -> Command {
        if seen.hand.state != HandState::Closed {
            // Once it closes, holding the gesture on changes nothing.
            return self.hand_command(now, seen, false);
        }
        let since = *self.closed_since.get_or_insert(now);
        if now.millis_since(since) > MISSED_MILLIS {
            if let Some(block) = self.block {
                self.sensorimotor.perception.resample_depth(block.index());
            }
            self.enter_phase(TransferPhase::Hover);
        }
        Command::NoMotion
    }
}

impl Participant for JoggingParticipant {
    fn step(&mut self, frame: &DisplayFrame) -> Intention {
        let now = frame.time;
        if now.0 < 100 {
            self.sensorimotor.lean_to_reach(0, false);
        }
        let seen = self.sensorimotor.perceive(frame);
        let wanted = self.next_command(now, &seen);
        self.sensorimotor.set_command(now, seen.stop.is_some(), wanted);
        let fixation_point = match self.block {
            Some(block) if seen.hand.held_object.is_some() => self.target_choice.place_for(block, &seen),
            Some(block) => Point::from(frame.objects[block.index()].translation.vector),
            None => Point::new(0.0, 0.0, self.scene.table_height),
        };
        let hand = Point::from(frame.world_from_tip.translation.vector);
        let limb = self.residual_limb.target_joints();
        self.sensorimotor.intention(frame, fixation_point, Some(hand), limb)
    }
}
