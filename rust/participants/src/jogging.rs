use crate::{
    Body, Participant, ParticipantOptions,
    habits::Habits,
    reach::{ArmSense, HandGoal},
};
use proact_types::{
    ArmModel, BlockId, DisplayFrame, Gesture, HandState, Intention, Point, Pose, Scene, SimTime, Vector,
};
use rand_distr::{Distribution, Normal};
use std::sync::Arc;

/// Numbers of `/mode` from which axes of the hand are moved instead of joints.
const FIRST_AXIS: u8 = 7;
/// How fast WE and WF move a joint, rad/s, and the hand, m/s and rad/s: learnt in the first minutes of practice.
const JOINT_SPEED: f64 = 0.4;
const LINEAR_SPEED: f64 = 0.08;
const ANGULAR_SPEED: f64 = 0.4;
/// What is left below this is not worth another movement: joints and angles rad, lengths metres.
const JOINT_DONE: f64 = 0.012;
const LINEAR_DONE: f64 = 0.006;
const ANGULAR_DONE: f64 = 0.15;
/// No movement gesture is held shorter or longer than this, ms: about two decisions, and a look in between.
const PULSE_MILLIS: (f64, f64) = (60.0, 2500.0);
/// After a movement the arm is watched for this long before the next decision, ms.
const WATCH_MILLIS: u64 = 450;
/// The hand passes over walls and partition with its grasp centre this high above the table, metres.
const CARRY_HEIGHT: f64 = 0.26;
/// From here the hand goes straight down, metres above the block's centre.
const HOVER_HEIGHT: f64 = 0.11;
/// A block is let go with its centre this far above where it rests, metres.
const DROP_HEIGHT: f64 = 0.012;
/// Closing on nothing for this long means that the block was missed, ms.
const MISSED_MILLIS: u64 = 900;
/// Roll of the hand at which its fingers close around a standing block, rad: the original's 25.6 degrees.
const ROLL: f64 = 25.6 * std::f64::consts::PI / 180.0;

/// A participant who jogs joint by joint or axis by axis, methods A and B.
///
/// Knows the arm well enough to tell how its joints would have to stand, moves what is furthest off, in pulses of
/// the length that seems right, looks, and corrects. Deterministic for its seed. A person without this model in
/// the head needs longer; it is no evidence about people.
///
/// Known weakness: it has no way around the box but straight up, and seldom brings a block across.
pub struct JoggingParticipant {
    habits: Habits,
    sense: ArmSense,
    scene: Scene,
    grasp_centre: Point,
    stage: Stage,
    block: Option<BlockId>,
    pulse: Option<Pulse>,
    mode_wanted: Option<u8>,
    mode_seen: Option<u8>,
    watch_until: SimTime,
    closed_since: Option<SimTime>,
}

/// A movement gesture of a length that was decided before it began.
#[derive(Clone, Copy, Debug)]
struct Pulse {
    gesture: Gesture,
    millis: u64,
    began: Option<SimTime>,
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

/// What one mode is off by, and what brings it nearer.
struct Lack {
    mode: u8,
    /// How far off, in the unit of its speed; positive needs the positive direction.
    amount: f64,
    /// Per second.
    speed: f64,
    /// Below this it is done.
    done: f64,
    gesture: Gesture,
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
            mode_wanted: None,
            mode_seen: None,
            watch_until: SimTime(0),
            closed_since: None,
        }
    }

    fn decide(&mut self, now: SimTime, seen: &DisplayFrame) -> Gesture {
        self.keep_up(seen);
        let Some(block) = self.block else { return Gesture::NoMotion };
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
        if let Some(gesture) = self.pulse_on(now) {
            return gesture;
        }
        if now < self.watch_until {
            return Gesture::NoMotion;
        }
        self.next_movement(seen, block)
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
            if self.stage != Stage::Retreat {
                self.enter(Stage::Above);
            }
        }
    }

    fn enter(&mut self, stage: Stage) {
        self.stage = stage;
        self.pulse = None;
        self.mode_wanted = None;
        self.closed_since = None;
    }

    /// A movement gesture goes on until its time is over.
    fn pulse_on(&mut self, now: SimTime) -> Option<Gesture> {
        let pulse = self.pulse.as_mut()?;
        if self.habits.gesture() == pulse.gesture {
            let began = *pulse.began.get_or_insert(now);
            if now.millis_since(began) >= pulse.millis {
                self.pulse = None;
                self.watch_until = now.plus_millis(WATCH_MILLIS + self.habits.options.reaction_ms);
                return Some(Gesture::NoMotion);
            }
        }
        Some(pulse.gesture)
    }

    fn next_movement(&mut self, seen: &DisplayFrame, block: BlockId) -> Gesture {
        let Some(mode) = seen.mode.as_ref().map(|mode| mode.number) else { return Gesture::NoMotion };
        if self.mode_seen.replace(mode) != Some(mode) && self.habits.gesture() == Gesture::HandOpen {
            // It has moved on: relax before anything else.
            return Gesture::NoMotion;
        }
        let lacks = self.lacks(seen, mode, block);
        let open = |lack: &&Lack| lack.amount.abs() > lack.done;
        let modes: i16 = if mode >= FIRST_AXIS { 6 } else { 7 };
        // The nearest in the cycle that is still off; turning to it costs a gesture a step.
        let ahead = |lack: &&Lack| (i16::from(lack.mode) - i16::from(mode)).rem_euclid(modes);
        let Some(lack) = lacks.iter().filter(open).min_by_key(ahead) else {
            self.arrived();
            return Gesture::NoMotion;
        };
        if lack.mode != mode {
            self.mode_wanted = Some(lack.mode);
            return Gesture::HandOpen;
        }
        let spread = Normal::new(1.0, self.habits.options.timing_spread.max(0.0)).ok();
        let share = spread.map_or(1.0, |n| n.sample(&mut self.habits.rng).clamp(0.6, 1.4));
        let millis = (lack.amount.abs() / lack.speed * 1e3 * share).clamp(PULSE_MILLIS.0, PULSE_MILLIS.1);
        self.pulse = Some(Pulse { gesture: lack.gesture, millis: millis as u64, began: None });
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

    /// What each mode lacks for the stage's place.
    fn lacks(&self, seen: &DisplayFrame, mode: u8, block: BlockId) -> Vec<Lack> {
        let base_from_tip = seen.world_from_base.inv_mul(&seen.world_from_tip);
        let goal = self.hand_goal(seen, block);
        let sided = |amount: f64, sign: f64| {
            if amount * sign > 0.0 { Gesture::WristExtension } else { Gesture::WristFlexion }
        };
        if mode >= FIRST_AXIS {
            let off = goal.target - base_from_tip * goal.point;
            let axis = base_from_tip.rotation * goal.axis;
            let turn = axis.cross(&goal.up);
            // Turning the hand at its wrist carries the grasp centre along: tilt first, then place.
            let upright = turn.norm() < ANGULAR_DONE * 1.5;
            let mut lacks = Vec::new();
            for (k, sign) in [1.0, -1.0, 1.0].into_iter().enumerate() {
                let number = FIRST_AXIS + k as u8;
                if upright {
                    let gesture = sided(off[k], sign);
                    lacks.push(Lack {
                        mode: number,
                        amount: off[k],
                        speed: LINEAR_SPEED,
                        done: LINEAR_DONE,
                        gesture,
                    });
                }
                let gesture = sided(turn[k], sign);
                let (speed, done) = (ANGULAR_SPEED, ANGULAR_DONE);
                lacks.push(Lack { mode: number + 3, amount: turn[k], speed, done, gesture });
            }
            return lacks;
        }
        let q = &seen.joints[..7.min(seen.joints.len())];
        let (wanted, _) = self.sense.inverse(q, &goal);
        // Signs of WE for the seven joints in the paper's order.
        const SIGNS: [f64; 7] = [1.0, -1.0, -1.0, 1.0, 1.0, 1.0, -1.0];
        (0..q.len())
            .map(|k| {
                let amount = wanted[k] - q[k];
                let gesture = sided(amount, SIGNS[k]);
                Lack { mode: k as u8, amount, speed: JOINT_SPEED, done: JOINT_DONE, gesture }
            })
            .collect()
    }

    fn hand_goal(&self, seen: &DisplayFrame, block: BlockId) -> HandGoal {
        let at = |pose: &Pose| Point::from(pose.translation.vector);
        let standing = at(&seen.blocks[block.index()]);
        let target = self.scene.targets[block.index()].centre;
        let high =
            |point: &Point, height: f64| Point::new(point.x, point.y, self.scene.table_height + height);
        let half = 0.025;
        let tip = &seen.world_from_tip;
        let place = match self.stage {
            Stage::Above => high(&standing, CARRY_HEIGHT),
            Stage::Hover => standing + Vector::z() * HOVER_HEIGHT,
            Stage::Down | Stage::Grip => standing,
            Stage::Lift | Stage::Retreat => high(&(tip * self.grasp_centre), CARRY_HEIGHT),
            Stage::Carry => high(&target, CARRY_HEIGHT),
            Stage::Lower | Stage::Release => high(&target, half + DROP_HEIGHT),
        };
        let held = seen.hand.holds.map(|b| tip.inv_mul(&seen.blocks[b.index()]));
        let base_from_world = seen.world_from_base.inverse();
        HandGoal {
            point: held.map_or(self.grasp_centre, |pose| at(&pose)),
            axis: held.map_or(Vector::new(0.0, ROLL.sin(), ROLL.cos()), |pose| {
                let axis = pose.rotation * Vector::z();
                // A block stands on either end.
                if axis.z < 0.0 { -axis } else { axis }
            }),
            target: base_from_world * place,
            up: base_from_world * Vector::z(),
        }
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
        self.habits.make(now, wanted);
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
        }
    }
}
