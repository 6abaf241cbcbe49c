use crate::{
    Body, Participant, ParticipantOptions,
    habits::Habits,
    jogging::{FIRST_AXIS, ModeCycle, number_of},
    reach::{ArmSense, HandGoal},
};
use proact_arm::ArmModel;
use proact_types::{
    DisplayFrame, Gesture, Intention, JointVector, ModeView, Point, SimTime, TaskGoal, Vector,
};
use rand_distr::{Distribution, Normal};
use std::sync::Arc;

/// How fast WE and WF move a joint, rad/s, and the hand, m/s: what practice has taught.
const JOINT_SPEED: f64 = 0.4;
const LINEAR_SPEED: f64 = 0.08;
/// No movement gesture is held shorter or longer than this, ms.
const SHORTEST_MILLIS: f64 = 150.0;
const LONGEST_MILLIS: f64 = 8000.0;
/// After a movement the arm is watched for this long before the next decision, ms.
const WATCH_MILLIS: u64 = 450;
/// What is left below this share of what is allowed is not worth another movement.
const DONE: f64 = 0.6;
/// Joint by joint, a joint this near to where it was thought of is left alone, rad.
const TURN_DONE: f64 = 0.035;
/// The place that is thought of joint by joint is thought of again when the hand would miss it by this share of its radius.
const MISSED: f64 = 0.5;

/// A participant who brings the hand or the joints to what the display asks for, in tasks without objects: methods that
/// jog, A and B.
///
/// Looks how far each joint or axis is off, goes to the one that is furthest off, holds the gesture for as long as the way
/// should take, looks again. Keeps still once all is near enough. Deterministic for its seed. It is no evidence about people.
///
/// Known weaknesses: nothing in the way is minded, and postures are not brought about along axes: with method B it keeps
/// still before them.
pub struct SteeringParticipant {
    habits: Habits,
    sense: ArmSense,
    modes: ModeCycle,
    asked: Option<TaskGoal>,
    /// Joint by joint: where the joints would have to be for the hand to be in its place.
    wanted: Option<JointVector>,
    /// The gesture that moves, until when it is held once it is made, and since when it is.
    movement: Option<Movement>,
    watch_until: SimTime,
    decided: bool,
}

#[derive(Clone, Copy, Debug)]
struct Movement {
    gesture: Gesture,
    millis: u64,
    since: Option<SimTime>,
}

/// What one joint or axis is off by.
#[derive(Clone, Copy, Debug)]
struct Off {
    mode: u8,
    amount: f64,
    /// As a share of what is allowed.
    share: f64,
}

impl SteeringParticipant {
    /// A participant with `body` who knows the arm `model`, of which the method does not drive the joints `own`, by their
    /// positions in it; the table is at `table_height`.
    pub fn new(
        options: ParticipantOptions,
        body: Body,
        table_height: f64,
        model: Arc<ArmModel>,
        own: &[usize],
        seed: u64,
    ) -> Self {
        Self {
            habits: Habits::new(options, body, table_height, seed),
            modes: ModeCycle::new(model.arm_count(), own),
            sense: ArmSense::new(model),
            asked: None,
            wanted: None,
            movement: None,
            watch_until: SimTime(0),
            decided: false,
        }
    }

    fn decide(&mut self, now: SimTime, seen: &DisplayFrame) -> Gesture {
        if self.asked != seen.asked {
            self.asked.clone_from(&seen.asked);
            (self.wanted, self.movement, self.decided) = (None, None, false);
        }
        let Some(shown) = &seen.mode else { return Gesture::NoMotion };
        if let Some(gesture) = self.move_on(now) {
            return gesture;
        }
        let mode = number_of(shown);
        if let Some(gesture) = self.modes.go_on(now, mode, &self.habits) {
            return gesture;
        }
        if now < self.watch_until || self.habits.gesture() == Gesture::HandOpen {
            return Gesture::NoMotion;
        }
        let offs = self.offs(seen, mode >= FIRST_AXIS);
        let worth = |off: &&Off| off.share > DONE;
        // What is chosen is used up first, since going on to the next costs more than the way.
        let chosen = offs.iter().filter(worth).find(|off| off.mode == mode);
        let furthest = || offs.iter().filter(worth).max_by(|a, b| a.share.total_cmp(&b.share));
        let Some(off) = chosen.or_else(furthest).copied() else { return Gesture::NoMotion };
        if !self.decided {
            self.decided = self.habits.thinking.is_over(now);
            if !self.decided {
                return Gesture::NoMotion;
            }
        }
        if off.mode != mode {
            self.modes.go(mode, off.mode);
            return Gesture::HandOpen;
        }
        self.begin(&off, shown)
    }

    /// Begins the movement that takes `off` away.
    fn begin(&mut self, off: &Off, shown: &ModeView) -> Gesture {
        let speed = if off.mode < FIRST_AXIS { JOINT_SPEED } else { LINEAR_SPEED };
        let spread = Normal::new(0.0, self.habits.options.timing_spread.max(0.0)).ok();
        let missed = spread.map_or(0.0, |n| n.sample(&mut self.habits.rng).clamp(-0.4, 0.4));
        let millis = off.amount.abs() / speed * 1e3 * (1.0 + missed);
        let extends = (off.amount > 0.0) == (shown.we_sign >= 0);
        let gesture = if extends { Gesture::WristExtension } else { Gesture::WristFlexion };
        let millis = millis.clamp(SHORTEST_MILLIS, LONGEST_MILLIS) as u64;
        self.movement = Some(Movement { gesture, millis, since: None });
        self.decided = false;
        gesture
    }

    /// The movement goes on until its time is over; none without one.
    fn move_on(&mut self, now: SimTime) -> Option<Gesture> {
        let movement = self.movement.as_mut()?;
        if self.habits.gesture() == movement.gesture {
            let since = *movement.since.get_or_insert(now);
            if now.millis_since(since) >= movement.millis {
                self.movement = None;
                self.watch_until = now.plus_millis(WATCH_MILLIS + self.habits.options.reaction_ms);
                return Some(Gesture::NoMotion);
            }
        }
        Some(movement.gesture)
    }

    /// What each mode is off by; nothing where it cannot be told by the modes that there are.
    fn offs(&mut self, seen: &DisplayFrame, by_axis: bool) -> Vec<Off> {
        match (self.asked.clone(), by_axis) {
            (Some(TaskGoal::Ball { centre, radius }), true) => {
                let off = self.hand_off(seen, &centre);
                // Three axes that are off by this much each leave the ball just so.
                let allowed = radius / 3.0_f64.sqrt();
                let axis = |k: usize| Off {
                    mode: FIRST_AXIS + k as u8,
                    amount: off[k],
                    share: off[k].abs() / allowed,
                };
                (0..3).map(axis).collect()
            }
            (Some(TaskGoal::Ball { centre, radius }), false) => {
                let Some(q) = seen.joints.get(..self.sense.joint_count()) else { return Vec::new() };
                let wanted = self.posture_at(seen, q, &centre, radius);
                let joint = |(k, (to, at)): (usize, (&f64, &f64))| Off {
                    mode: k as u8,
                    amount: to - at,
                    share: DONE * (to - at).abs() / TURN_DONE,
                };
                wanted.iter().zip(q).enumerate().map(joint).collect()
            }
            (Some(TaskGoal::Posture { joints }), false) => {
                let off = |goal: &proact_types::JointGoal| {
                    let amount = goal.angle - seen.joints.get(usize::from(goal.joint))?;
                    Some(Off { mode: goal.joint, amount, share: amount.abs() / goal.tolerance })
                };
                joints.iter().filter_map(off).collect()
            }
            (Some(TaskGoal::Posture { .. } | TaskGoal::Disc { .. }) | None, _) => Vec::new(),
        }
    }

    /// From the hand's grasp centre to `place`, along the axes of the base.
    fn hand_off(&self, seen: &DisplayFrame, place: &Point) -> Vector {
        let hand = seen.world_from_tip * self.sense.widest_grasp_centre();
        seen.world_from_base.inverse() * (place - hand)
    }

    /// The joints that bring the hand to `place`, its attitude kept where that can be.
    fn posture_at(&mut self, seen: &DisplayFrame, q: &[f64], place: &Point, radius: f64) -> JointVector {
        let point = self.sense.widest_grasp_centre();
        let target = seen.world_from_base.inverse() * place;
        if let Some(wanted) = &self.wanted
            && (self.sense.forward(wanted) * point - target).norm() < MISSED * radius
        {
            return wanted.clone();
        }
        let axis = Vector::z();
        let tip = self.sense.forward(q);
        let goal = HandGoal {
            point,
            axis,
            target,
            up: tip.rotation * axis,
            high_counts: 1.0,
            point_done: MISSED * radius,
            tilt_done: std::f64::consts::PI,
            attitude: None,
        };
        let all = (0..q.len()).fold(0, |set, joint| set | 1 << joint);
        let wanted = self.sense.inverse(q, &goal, all);
        self.wanted = Some(wanted.clone());
        wanted
    }
}

impl Participant for SteeringParticipant {
    fn step(&mut self, frame: &DisplayFrame) -> Intention {
        let now = frame.time;
        let seen = self.habits.see(frame);
        let wanted = self.decide(now, &seen);
        self.habits.make(now, seen.stop.is_some(), wanted);
        let hand = Point::from(frame.world_from_tip.translation.vector);
        let looked_at = match &self.asked {
            Some(TaskGoal::Ball { centre, .. } | TaskGoal::Disc { centre, .. }) => *centre,
            _ => hand,
        };
        self.habits.intend(frame, looked_at, Some(hand), None)
    }
}
