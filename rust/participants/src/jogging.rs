mod limb;
mod modes;
mod movement;
mod obstacles;
mod place;

use crate::{
    Body, Participant, ParticipantOptions,
    habits::Habits,
    reach::{ArmSense, Turn},
};
use nalgebra::UnitQuaternion;
use proact_types::{
    ArmModel, BlockId, DisplayFrame, Gesture, HandState, Intention, JointVector, PlannerView, Point, Pose,
    Scene, SimTime, Vector,
};
use rand_distr::{Distribution, Normal};
use std::sync::Arc;

/// Numbers of `/mode` from which axes of the hand are moved instead of joints, and how many there are of each.
const FIRST_AXIS: u8 = 7;
const JOINTS: u8 = 7;
const AXES: u8 = 6;
/// No movement gesture is held shorter or longer than this, ms: three decisions, and a look in between.
const PULSE_MILLIS: (f64, f64) = (150.0, 2500.0);
/// A joint is turned all the way at once.
const LONGEST_TURN_MILLIS: f64 = 8000.0;
/// A long movement is followed with the eye and ended this near to the moment that was meant, ms.
const TIMING_MILLIS: f64 = 50.0;
/// After a movement the arm is watched for this long before the next decision, ms.
const WATCH_MILLIS: u64 = 450;
/// A block is let go with its centre this far above where it rests when the arm goes no lower, metres.
const FALL_HEIGHT: f64 = 0.04;
/// A block is gripped with the hand this far above its middle when the arm goes no lower, metres.
const GRIP_HEIGHT: f64 = 0.03;
/// Closing on nothing for this long means that the block was missed, ms.
const MISSED_MILLIS: u64 = 900;
/// After so many movements the place is good enough, or not to be had.
const MOST_MOVEMENTS: u32 = 14;
/// Joint by joint, after so many that brought too little another way is looked for.
const MOST_IN_VAIN: u32 = 3;
/// Half of a block's height, and its radius, metres.
const BLOCK: f64 = 0.025;
/// A movement that gives less than this share of what it should has met something.
const LEAST_PROGRESS: f64 = 0.4;
/// ... and so has a joint that stops this much short of where it was turned, rad.
const TOUCHED: f64 = 0.06;

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
    grasp_centre: Point,
    stage: Stage,
    block: Option<BlockId>,
    pulse: Option<Pulse>,
    turning: Option<modes::Turning>,
    watch_until: SimTime,
    closed_since: Option<SimTime>,
    /// Movements that were refused since the last one that was not.
    refused: Vec<(u8, Gesture)>,
    /// How often the arm got stuck with this block.
    stuck: usize,
    /// The hand leans toward the shoulder, rad.
    lean: f64,
    /// A stage began for which the attitude of the hand has to be thought of.
    attitude_due: bool,
    /// What method A has yet to turn, in this order.
    turns: Vec<Turn>,
    /// `base_from_tip`'s rotation with which method B takes the block, or puts it down.
    attitude: Option<UnitQuaternion<f64>>,
    /// The hand has come near enough to its place to turn to that attitude.
    near: bool,
    /// The block was gripped above its middle last time.
    gripped_high: bool,
    /// Movements since the stage began.
    movements: u32,
    /// ... and those of them that brought too little.
    in_vain: u32,
    limb: limb::Limb,
}

/// A movement gesture of a length that was decided before it began.
#[derive(Clone, Debug)]
struct Pulse {
    mode: u8,
    gesture: Gesture,
    millis: u64,
    /// Where the arm was before: arm angles, or the hand's place and attitude.
    before: (JointVector, Pose),
    /// What it should bring, in the unit of its speed.
    amount: f64,
    began: Option<SimTime>,
    over: bool,
}

/// The way of one block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
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
    /// A participant with `body` before `scene` who knows the arm `model`.
    pub fn new(
        options: ParticipantOptions,
        body: Body,
        scene: &Scene,
        model: Arc<ArmModel>,
        seed: u64,
    ) -> Self {
        Self {
            habits: Habits::new(options, body, scene.table_height, seed),
            grasp_centre: Point::from(model.grasp_centre),
            sense: ArmSense::new(model),
            scene: scene.clone(),
            stage: Stage::Above,
            block: None,
            pulse: None,
            turning: None,
            watch_until: SimTime(0),
            closed_since: None,
            refused: Vec::new(),
            stuck: 0,
            lean: 0.0,
            attitude_due: true,
            turns: Vec::new(),
            attitude: None,
            near: false,
            gripped_high: false,
            movements: 0,
            in_vain: 0,
            limb: limb::Limb::default(),
        }
    }

    /// The same with a limb of which the joints `own` of the arm, by their positions in it, are left: the method does
    /// not drive these.
    pub fn with_limb(mut self, own: Vec<usize>) -> Self {
        self.limb = limb::Limb::new(own);
        self
    }

    fn decide(&mut self, now: SimTime, seen: &DisplayFrame) -> Gesture {
        self.keep_up(seen);
        let Some(block) = self.block else { return Gesture::NoMotion };
        if std::mem::take(&mut self.attitude_due) {
            self.choose_attitude(seen, block);
        }
        match self.stage {
            Stage::Grip => return self.grip(now, seen),
            Stage::Release if seen.hand.holds.is_some() => return Gesture::HandClose,
            Stage::Release => {
                self.enter(Stage::Retreat);
                return Gesture::NoMotion;
            }
            Stage::Above | Stage::Hover | Stage::Down if seen.hand.state == HandState::Closed => {
                // The hand was left closed on nothing: HC toggles it.
                return Gesture::HandClose;
            }
            _ => {}
        }
        if let Some(gesture) = self.pulse_on(now, seen) {
            return gesture;
        }
        let Some(mode) = seen.mode.as_ref().map(|mode| mode.number) else { return Gesture::NoMotion };
        if let Some(gesture) = self.turn_on(now, mode) {
            return gesture;
        }
        if mode < FIRST_AXIS {
            self.go_all_the_way();
            // Joint after joint without a look in between; before the last one the hand has to be in its place.
            if let ([next, _, ..], true) = (self.turns.as_slice(), now < self.watch_until)
                && next.joint != usize::from(mode)
            {
                self.turning = Some(self.way_to(mode, next.joint as u8));
                return Gesture::HandOpen;
            }
        }
        if now < self.watch_until {
            return Gesture::NoMotion;
        }
        self.next_movement(now, seen, mode, block)
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
                self.block = seen.next_block;
                self.enter(Stage::Retreat);
            }
            _ => {}
        }
        if seen.hand.holds.is_none() && self.block != seen.next_block && !holding {
            self.block = seen.next_block;
            self.stuck = 0;
            if self.stage != Stage::Retreat {
                self.enter(Stage::Above);
            }
        }
    }

    fn enter(&mut self, stage: Stage) {
        self.stage = stage;
        self.pulse = None;
        self.turning = None;
        self.closed_since = None;
        self.refused.clear();
        self.turns.clear();
        self.movements = 0;
        self.in_vain = 0;
        self.limb.begin();
        self.attitude_due = matches!(stage, Stage::Above | Stage::Carry);
    }

    /// A movement gesture goes on until its time is over, or the display refuses it. What it brought is judged when
    /// the next one is thought of.
    fn pulse_on(&mut self, now: SimTime, seen: &DisplayFrame) -> Option<Gesture> {
        let pulse = self.pulse.as_mut()?;
        if self.habits.gesture() == pulse.gesture {
            let began = *pulse.began.get_or_insert(now);
            // What is seen is as old as the reaction time: a refusal counts if it belongs to this movement.
            let refused = seen.gesture == pulse.gesture
                && seen.time > began
                && matches!(seen.planner, PlannerView::Failed { .. });
            if refused || now.millis_since(began) >= pulse.millis {
                pulse.over = true;
                self.watch_until = now.plus_millis(WATCH_MILLIS + self.habits.options.reaction_ms);
            }
        }
        (!pulse.over).then_some(pulse.gesture)
    }

    /// Remembers a movement that brought too little; forgets the others when one went well.
    fn judge(&mut self, seen: &DisplayFrame) {
        let Some(pulse) = self.pulse.take() else { return };
        let (q, tip) = &pulse.before;
        let base_from_tip = seen.world_from_base.inv_mul(&seen.world_from_tip);
        let moved = match pulse.mode {
            joint if joint < FIRST_AXIS => seen.joints[usize::from(joint)] - q[usize::from(joint)],
            axis if axis < FIRST_AXIS + 3 => {
                (base_from_tip * self.grasp_centre - tip * self.grasp_centre).norm()
            }
            _ => base_from_tip.rotation.angle_to(&tip.rotation),
        };
        let short = pulse.amount - moved.abs();
        if short > (1.0 - LEAST_PROGRESS) * pulse.amount || (pulse.mode < FIRST_AXIS && short > TOUCHED) {
            self.refused.push((pulse.mode, pulse.gesture));
            self.in_vain += 1;
            self.turns.clear();
        } else {
            self.refused.clear();
        }
    }

    /// Joint by joint the hand goes all the way at once: what is in the way is passed by thinking of it before.
    fn go_all_the_way(&mut self) {
        self.stage = match self.stage {
            Stage::Above => Stage::Down,
            same => same,
        };
    }

    fn next_movement(&mut self, now: SimTime, seen: &DisplayFrame, mode: u8, block: BlockId) -> Gesture {
        if self.habits.gesture() == Gesture::HandOpen {
            return Gesture::NoMotion;
        }
        self.judge(seen);
        let goal = self.goal_of(self.stage, self.lean, seen, block);
        let by_axis = mode >= FIRST_AXIS;
        let base_from_tip = seen.world_from_base.inv_mul(&seen.world_from_tip);
        if self.move_limb(now, seen, &goal, by_axis, mode, block) {
            return Gesture::NoMotion;
        }
        let good_enough = self.movements > if by_axis { MOST_MOVEMENTS } else { 2 * MOST_MOVEMENTS };
        let in_vain = !by_axis && self.in_vain >= MOST_IN_VAIN;
        let wanted = match () {
            () if in_vain => Err(()),
            () if good_enough && goal.off(&base_from_tip).0 < 2.0 * goal.point_done => Ok(None),
            () if good_enough => Err(()),
            () if !by_axis && goal.reached(&base_from_tip) => Ok(None),
            () if by_axis => self.axis_lack(&base_from_tip, &goal, mode),
            () => self.joint_lack(seen, &goal, mode, block).map(Some).ok_or(()),
        };
        let lack = match wanted {
            Ok(Some(lack)) => lack,
            Ok(None) => {
                self.arrived();
                return Gesture::NoMotion;
            }
            Err(()) => {
                // What was just tried in vain is not the way out either.
                let refused = if in_vain { std::mem::take(&mut self.refused) } else { Vec::new() };
                self.stuck(seen);
                self.refused = refused;
                return Gesture::NoMotion;
            }
        };
        if lack.mode != mode {
            self.turning = Some(self.way_to(mode, lack.mode));
            return Gesture::HandOpen;
        }
        let spread = Normal::new(0.0, self.habits.options.timing_spread.max(0.0)).ok();
        let share = spread.map_or(0.0, |n| n.sample(&mut self.habits.rng).clamp(-0.4, 0.4));
        let longest = if by_axis { PULSE_MILLIS.1 } else { LONGEST_TURN_MILLIS };
        let meant = lack.amount.abs() / lack.speed * 1e3;
        let missed = (meant * share).clamp(-TIMING_MILLIS, TIMING_MILLIS);
        let millis = (meant + missed).clamp(PULSE_MILLIS.0, longest);
        self.movements += 1;
        if !by_axis {
            self.turns.remove(0);
        }
        self.pulse = Some(Pulse {
            mode,
            gesture: lack.gesture,
            millis: millis as u64,
            before: (seen.joints.clone(), base_from_tip),
            amount: millis * 1e-3 * lack.speed,
            began: None,
            over: false,
        });
        lack.gesture
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
        self.refused.clear();
        self.turns.clear();
        let height =
            |block: BlockId| seen.blocks[block.index()].translation.z - self.scene.table_height - BLOCK;
        if self.stage == Stage::Lower && seen.hand.holds.is_some_and(|block| height(block) < FALL_HEIGHT) {
            self.enter(Stage::Release);
            return;
        }
        let centre = seen.world_from_tip * self.grasp_centre;
        let over = |block: BlockId| centre.coords - seen.blocks[block.index()].translation.vector;
        let gripped = |off: Vector| off.z < GRIP_HEIGHT && off.xy().norm() < 0.6 * BLOCK;
        if self.stage == Stage::Down
            && !self.gripped_high
            && self.block.is_some_and(|block| gripped(over(block)))
        {
            self.gripped_high = true;
            self.enter(Stage::Grip);
            return;
        }
        self.gripped_high = false;
        self.stuck += 1;
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
            // HC toggles: once it closes, holding the gesture on changes nothing.
            return Gesture::HandClose;
        }
        let since = *self.closed_since.get_or_insert(now);
        if now.millis_since(since) > MISSED_MILLIS {
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
            Some(block) if seen.hand.holds.is_some() => self.scene.targets[block.index()].centre,
            Some(block) => Point::from(frame.blocks[block.index()].translation.vector),
            None => Point::new(0.0, 0.0, self.scene.table_height),
        };
        let eye = frame.world_from_head.translation.vector;
        Intention {
            gesture: self.habits.gesture(),
            gaze_direction: (looked_at.coords - eye).try_normalize(1e-9).unwrap_or_else(Vector::x),
            eyes_open: self.habits.eyes_open(now),
            trunk: self.habits.posture(),
            limb: self.limb.to(),
        }
    }
}
