mod attitude;
mod limb;
mod modes;
mod movement;
mod obstacles;
mod pulse;
mod situation;

use crate::{Body, Participant, ParticipantOptions, choice::Choice, habits::Habits, reach::ArmSense};
pub(crate) use attitude::Attitude;
use limb::Limb;
pub(crate) use modes::ModeCycle;
use movement::Movements;
use proact_arm::ArmModel;
use proact_types::{
    Briefing, DisplayFrame, Gesture, HandState, Intention, ModeView, Moves, ObjectId, Point, Scene, SimTime,
};
use pulse::Pulse;
use situation::Aim;
pub(crate) use situation::Situation;
use std::sync::Arc;

/// Modes are thought of as numbers: joints of the arm from 0, axes of the hand from here, three to go along and three to
/// turn about.
pub(crate) const FIRST_AXIS: u8 = 64;
const AXES: u8 = 6;
/// After a movement the arm is watched for this long before the next decision, ms.
const WATCH_MILLIS: u64 = 450;
/// A block is let go with its centre this far above where it rests when the arm goes no lower, metres.
const FALL_HEIGHT: f64 = 0.04;
/// A block is gripped with the hand this far above its middle when the arm goes no lower, metres.
const GRIP_HEIGHT: f64 = 0.03;
/// Closing on nothing for this long means that the block was missed, ms.
const MISSED_MILLIS: u64 = 900;
/// As often the trunk corrects where the hand is before the arm has to.
const MOST_TRUNK_MOVES: usize = 3;
/// After so many times that the arm got stuck another object is taken, where the person may choose.
const GIVES_UP_AFTER: usize = 6;

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
    habits: Habits,
    sense: ArmSense,
    scene: Scene,
    choice: Choice,
    stage: Stage,
    block: Option<ObjectId>,
    /// How often the arm got stuck with this block.
    stuck: usize,
    /// The arm is watched until then.
    watch_until: SimTime,
    /// Since when the hand is closed around the block, or on nothing.
    closed_since: Option<SimTime>,
    /// The block was gripped above its middle last time.
    gripped_high: bool,
    attitude: Attitude,
    movements: Movements,
    pulse: Option<Pulse>,
    modes: ModeCycle,
    limb: Limb,
    /// The mode that was decided for: nothing is left to think about once it is there.
    decided: bool,
    /// How often the trunk moved in this stage.
    trunk_moves: usize,
}

/// The number that a mode is thought of by.
pub(crate) fn number_of(mode: &ModeView) -> u8 {
    match mode.moves {
        Moves::Joint(joint) => joint,
        Moves::Translation(axis) => FIRST_AXIS + axis,
        Moves::Rotation(axis) => FIRST_AXIS + AXES / 2 + axis,
    }
}

/// The way of one block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Stage {
    /// High, over the block.
    Above,
    /// Close over the block.
    Hover,
    /// Around the block.
    Down,
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
            habits: Habits::new(options, body, scene.table_height, seed),
            sense: ArmSense::new(model.clone()),
            scene: scene.clone(),
            choice: Choice::new(scene, briefing),
            stage: Stage::Above,
            block: None,
            stuck: 0,
            watch_until: SimTime(0),
            closed_since: None,
            gripped_high: false,
            attitude: Attitude::new(),
            movements: Movements::default(),
            pulse: None,
            modes: ModeCycle::new(model.arm_count(), &[]),
            limb: Limb::default(),
            decided: false,
            trunk_moves: 0,
        }
    }

    /// The same with a limb of which the joints `own` of the arm, by their positions in it, are left: the method does
    /// not drive these.
    pub fn with_limb(mut self, own: Vec<usize>) -> Self {
        self.modes = ModeCycle::new(self.sense.joints(), &own);
        self.limb = Limb::new(own);
        self
    }

    /// The same with a method that goes through the places `cycle` of the arm, in this order; the place behind the last joint is the
    /// hand, which this person then opens and closes in its mode.
    pub fn with_cycle(mut self, cycle: &[usize]) -> Self {
        self.modes = ModeCycle::of(self.sense.joints(), cycle);
        self
    }

    /// Opens or closes the hand: by HC, which toggles it, or in its mode.
    fn hand(&mut self, now: SimTime, seen: &DisplayFrame, opens: bool) -> Gesture {
        let Some(shown) = &seen.mode else { return Gesture::HandClose };
        let mode = number_of(shown);
        let Some(hand) = self.modes.hand(mode) else { return Gesture::HandClose };
        if let Some(gesture) = self.modes.go_on(now, mode, &self.habits) {
            return gesture;
        }
        if mode != hand {
            self.modes.go(mode, hand);
            return Gesture::HandOpen;
        }
        match opens == (shown.we_sign >= 0) {
            true => Gesture::WristExtension,
            false => Gesture::WristFlexion,
        }
    }

    fn decide(&mut self, now: SimTime, seen: &DisplayFrame) -> Gesture {
        self.keep_up(seen);
        let Some(block) = self.block else { return Gesture::NoMotion };
        let target = self.choice.place(block, seen);
        let situation = Situation { sense: &self.sense, scene: &self.scene, seen, block, target };
        self.attitude.choose(&situation, self.stuck);
        match self.stage {
            Stage::Grip => return self.grip(now, seen),
            Stage::Release if seen.hand.holds.is_some() => return self.hand(now, seen, true),
            Stage::Release => {
                self.enter(Stage::Retreat);
                return Gesture::NoMotion;
            }
            Stage::Above | Stage::Hover | Stage::Down if seen.hand.state == HandState::Closed => {
                // The hand was left closed on nothing.
                return self.hand(now, seen, true);
            }
            _ => {}
        }
        if let Some(gesture) = self.pulse_on(now, seen, block) {
            return gesture;
        }
        let Some(shown) = &seen.mode else { return Gesture::NoMotion };
        let mode = number_of(shown);
        if let Some(gesture) = self.modes.go_on(now, mode, &self.habits) {
            return gesture;
        }
        if mode < FIRST_AXIS {
            self.go_all_the_way();
            // Joint after joint without a look in between; before the last one the hand has to be in its place.
            if let ([next, _, ..], true) = (self.movements.turns(), now < self.watch_until)
                && next.joint != usize::from(mode)
                && !self.limb.has(next.joint)
            {
                self.modes.go(mode, next.joint as u8);
                return Gesture::HandOpen;
            }
        }
        if now < self.watch_until {
            return Gesture::NoMotion;
        }
        self.next_movement(now, seen, shown, block)
    }

    /// Follows what the display shows: which block, and whether the hand holds it.
    fn keep_up(&mut self, seen: &DisplayFrame) {
        let holding = matches!(self.stage, Stage::Lift | Stage::Carry | Stage::Lower | Stage::Release);
        match seen.hand.holds {
            Some(block) if !holding => {
                self.block = Some(block);
                self.enter(Stage::Lift);
            }
            None if holding && self.stage != Stage::Release => {
                // It slipped away: begin again from above.
                self.block = self.choose(seen);
                self.enter(Stage::Retreat);
            }
            _ => {}
        }
        let next = if seen.hand.holds.is_none() && !holding { Some(self.choose(seen)) } else { None };
        if let Some(next) = next.filter(|next| self.block != *next) {
            self.block = next;
            self.stuck = 0;
            if self.stage != Stage::Retreat {
                self.enter(Stage::Above);
            }
        }
    }

    /// The object to take next.
    fn choose(&mut self, seen: &DisplayFrame) -> Option<ObjectId> {
        self.choice.put_down();
        self.choice.next(seen)
    }

    fn enter(&mut self, stage: Stage) {
        self.stage = stage;
        self.closed_since = None;
        self.attitude.begin(stage);
        self.movements.begin();
        self.pulse = None;
        self.modes.begin();
        self.limb.begin();
        self.decided = false;
        self.trunk_moves = 0;
    }

    /// A movement gesture goes on until its time is over, or the display refuses it. What it brought is judged when
    /// the next one is thought of.
    fn pulse_on(&mut self, now: SimTime, seen: &DisplayFrame, block: ObjectId) -> Option<Gesture> {
        let pulse = self.pulse.as_mut()?;
        let target = self.choice.place(block, seen);
        let situation = Situation { sense: &self.sense, scene: &self.scene, seen, block, target };
        if pulse.go_on(now, &situation, self.habits.gesture()) {
            self.watch_until = now.plus_millis(WATCH_MILLIS + self.habits.options.reaction_ms);
        }
        pulse.gesture()
    }

    /// Joint by joint the hand goes all the way at once: what is in the way is passed by thinking of it before.
    fn go_all_the_way(&mut self) {
        self.stage = match self.stage {
            Stage::Above => Stage::Down,
            same => same,
        };
    }

    fn next_movement(
        &mut self,
        now: SimTime,
        seen: &DisplayFrame,
        shown: &ModeView,
        block: ObjectId,
    ) -> Gesture {
        if self.habits.gesture() == Gesture::HandOpen {
            return Gesture::NoMotion;
        }
        if !self.decided && !self.habits.thinking.is_over(now) {
            return Gesture::NoMotion;
        }
        self.decided = false;
        let mode = number_of(shown);
        let target = self.choice.place(block, seen);
        let situation = Situation { sense: &self.sense, scene: &self.scene, seen, block, target };
        if let Some(pulse) = self.pulse.take() {
            self.habits.skill.learn(pulse.kind().0, pulse.share(&situation));
            self.movements.judge(&pulse, &situation);
        }
        let goal = situation.goal_of(self.stage, self.attitude.lean());
        let aim = Aim { stage: self.stage, goal, mode };
        if self.limb.reach(now, &situation, &aim, &mut self.movements) {
            return Gesture::NoMotion;
        }
        if self.trunk_moves < MOST_TRUNK_MOVES
            && let Some(posture) = situation.by_trunk(&aim.goal, &self.habits)
            && self.habits.skill.uses_body()
        {
            self.trunk_moves += 1;
            self.watch_until = now.plus_millis(self.habits.lean_to(posture));
            return Gesture::NoMotion;
        }
        let lack = match self.movements.next(&situation, &aim, &mut self.attitude) {
            Ok(Some(lack)) => lack,
            Ok(None) => {
                self.arrived();
                return Gesture::NoMotion;
            }
            Err(()) => {
                // What was just tried in vain is not the way out either.
                let tried = self.movements.tried_in_vain(&aim);
                self.stuck(seen);
                if let Some(tried) = tried {
                    self.movements.begin_after(tried);
                }
                return Gesture::NoMotion;
            }
        };
        if lack.mode != mode {
            self.modes.go(mode, lack.mode);
            self.decided = true;
            return Gesture::HandOpen;
        }
        let pulse = Pulse::new(&lack, shown, &situation, &mut self.habits);
        let gesture = pulse.gesture().unwrap_or_default();
        self.pulse = Some(pulse);
        self.movements.start(&aim);
        gesture
    }

    /// The stage's place is reached: on to the next.
    fn arrived(&mut self) {
        let next = match self.stage {
            Stage::Above => Stage::Hover,
            Stage::Hover => Stage::Down,
            Stage::Down => Stage::Grip,
            Stage::Lift => Stage::Carry,
            Stage::Carry => Stage::Lower,
            Stage::Lower => Stage::Release,
            Stage::Retreat => Stage::Above,
            same @ (Stage::Grip | Stage::Release) => same,
        };
        self.enter(next);
    }

    /// No movement is left that would help: lets go if that is near enough, else goes up and tries another attitude
    /// of the hand, now and then another posture too.
    fn stuck(&mut self, seen: &DisplayFrame) {
        let shape = |block: ObjectId| self.scene.objects[block.index()].shape;
        let goes_to = seen.hand.holds.map(|block| self.choice.place(block, seen));
        let height = |block: ObjectId| {
            let at = seen.objects[block.index()].translation.z;
            at - goes_to.map_or(self.scene.table_height, |place| place.z) - shape(block).half_height()
        };
        if self.stage == Stage::Lower && seen.hand.holds.is_some_and(|block| height(block) < FALL_HEIGHT) {
            self.enter(Stage::Release);
            return;
        }
        let over = |block: ObjectId| {
            let centre = seen.world_from_tip * self.sense.grasp_centre(shape(block).grip_width());
            centre.coords - seen.objects[block.index()].translation.vector
        };
        let gripped = |block: ObjectId| {
            let off = over(block);
            off.z < GRIP_HEIGHT && off.xy().norm() < 0.6 * shape(block).half_width()
        };
        if self.stage == Stage::Down && !self.gripped_high && self.block.is_some_and(gripped) {
            self.gripped_high = true;
            self.enter(Stage::Grip);
            return;
        }
        self.gripped_high = false;
        self.stuck += 1;
        if self.stuck.is_multiple_of(GIVES_UP_AFTER) && seen.hand.holds.is_none() {
            self.choice.give_up();
        }
        if self.stuck.is_multiple_of(3) {
            self.habits.lean_to_reach((self.stuck / 3) as u32, false);
        }
        match (self.stage, seen.hand.holds) {
            // Not even up: on with what comes next, from wherever the hand is.
            (Stage::Retreat | Stage::Lift, _) => self.arrived(),
            (_, Some(_)) => self.enter(Stage::Lift),
            (_, None) => self.enter(Stage::Retreat),
        }
    }

    /// Closes the hand; when it closed on nothing, opens it again and goes back up.
    fn grip(&mut self, now: SimTime, seen: &DisplayFrame) -> Gesture {
        if seen.hand.state != HandState::Closed {
            // Once it closes, holding the gesture on changes nothing.
            return self.hand(now, seen, false);
        }
        let since = *self.closed_since.get_or_insert(now);
        if now.millis_since(since) > MISSED_MILLIS {
            if let Some(block) = self.block {
                self.habits.perception.judge_again(block.index());
            }
            self.enter(Stage::Hover);
        }
        Gesture::NoMotion
    }
}

impl Participant for JoggingParticipant {
    fn step(&mut self, frame: &DisplayFrame) -> Intention {
        let now = frame.time;
        if now.0 < 100 {
            self.habits.lean_to_reach(0, false);
        }
        let seen = self.habits.see(frame);
        let wanted = self.decide(now, &seen);
        self.habits.make(now, seen.stop.is_some(), wanted);
        let looked_at = match self.block {
            Some(block) if seen.hand.holds.is_some() => self.choice.place(block, &seen),
            Some(block) => Point::from(frame.objects[block.index()].translation.vector),
            None => Point::new(0.0, 0.0, self.scene.table_height),
        };
        let hand = Point::from(frame.world_from_tip.translation.vector);
        let limb = self.limb.to();
        self.habits.intend(frame, looked_at, Some(hand), limb)
    }
}
