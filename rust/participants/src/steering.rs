use crate::{
    Body, Participant, ParticipantOptions,
    jogging::{FIRST_AXIS_MODE, ModeCycle, mode_number},
    reach::{HandGoal, InternalArmModel},
    sensorimotor::SensorimotorModel,
};
use proact_arm::ArmModel;
use proact_types::{
    Command, DisplayFrame, Intention, JointVector, ModeView, Point, SimTime, TaskGoal, Vector,
};
use rand_distr::{Distribution, Normal};
use std::sync::Arc;

/// How fast WE and WF move a joint, rad/s, and the hand, m/s: what practice has taught.
const JOINT_SPEED: f64 = 0.4;
const LINEAR_SPEED: f64 = 0.08;
/// No movement gesture is held shorter or longer than this, ms.
const MIN_HOLD_MS: f64 = 150.0;
const MAX_HOLD_MS: f64 = 8000.0;
/// After a movement the arm is watched for this long before the next decision, ms.
const WATCH_MILLIS: u64 = 450;
/// What is left below this share of what is allowed is not worth another movement.
const DONE_SHARE: f64 = 0.6;
/// Joint by joint, a joint this near to where it was thought of is left alone, rad.
const JOINT_TOLERANCE_RAD: f64 = 0.035;
/// The place that is thought of joint by joint is thought of again when the hand would miss it by this share of its radius.
const REPLAN_SHARE: f64 = 0.5;

/// A participant who brings the hand or the joints to what the display asks for, in tasks without objects: methods that
/// jog, A and B.
///
/// Looks how far each joint or axis is off, goes to the one that is furthest off, holds the gesture for as long as the way
/// should take, looks again. Keeps still once all is near enough. Deterministic for its seed. It is no evidence about people.
///
/// Known weaknesses: nothing in the way is minded, and postures are not brought about along axes: with method B it keeps
/// still before them.
pub struct SteeringParticipant {
    sensorimotor: SensorimotorModel,
    arm_model: InternalArmModel,
    modes: ModeCycle,
    task_goal: Option<TaskGoal>,
    /// Joint by joint: where the joints would have to be for the hand to be in its place.
    target_joints: Option<JointVector>,
    /// The gesture that moves, until when it is held once it is made, and since when it is.
    movement: Option<TimedMovement>,
    watch_until: SimTime,
    decided: bool,
}

#[derive(Clone, Copy, Debug)]
struct TimedMovement {
    command: Command,
    millis: u64,
    since: Option<SimTime>,
}

/// What one joint or axis is off by.
#[derive(Clone, Copy, Debug)]
struct SteeringError {
    mode: u8,
    error: f64,
    /// As a share of what is allowed.
    tolerance_share: f64,
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
            sensorimotor: SensorimotorModel::new(options, body, table_height, seed),
            modes: ModeCycle::new(model.arm_count(), own),
            arm_model: InternalArmModel::new(model),
            task_goal: None,
            target_joints: None,
            movement: None,
            watch_until: SimTime(0),
            decided: false,
        }
    }

    fn next_command(&mut self, now: SimTime, seen: &DisplayFrame) -> Command {
        if self.task_goal != seen.task_goal {
            self.task_goal.clone_from(&seen.task_goal);
            (self.target_joints, self.movement, self.decided) = (None, None, false);
        }
        let Some(mode_view) = &seen.mode else { return Command::NoMotion };
        if let Some(command) = self.continue_movement(now) {
            return command;
        }
        let mode = mode_number(mode_view);
        if let Some(command) = self.modes.continue_change(now, mode, &self.sensorimotor) {
            return command;
        }
        if now < self.watch_until || self.sensorimotor.command() == Command::HandOpen {
            return Command::NoMotion;
        }
        let offs = self.mode_errors(seen, mode >= FIRST_AXIS_MODE);
        let worth = |off: &&SteeringError| off.tolerance_share > DONE_SHARE;
        // What is chosen is used up first, since going on to the next costs more than the way.
        let chosen = offs.iter().filter(worth).find(|off| off.mode == mode);
        let furthest =
            || offs.iter().filter(worth).max_by(|a, b| a.tolerance_share.total_cmp(&b.tolerance_share));
        let Some(off) = chosen.or_else(furthest).copied() else { return Command::NoMotion };
        if !self.decided {
            self.decided = self.sensorimotor.decision_timer.is_decided(now);
            if !self.decided {
                return Command::NoMotion;
            }
        }
        if off.mode != mode {
            self.modes.start_change(mode, off.mode);
            return Command::HandOpen;
        }
        self.start_movement(&off, mode_view)
    }

    /// Begins the movement that takes `off` away.
    fn start_movement(&mut self, off: &SteeringError, mode_view: &ModeView) -> Command {
        let speed = if off.mode < FIRST_AXIS_MODE { JOINT_SPEED } else { LINEAR_SPEED };
        let spread = Normal::new(0.0, self.sensorimotor.options.timing_relative_sd.max(0.0)).ok();
        let missed = spread.map_or(0.0, |n| n.sample(&mut self.sensorimotor.rng).clamp(-0.4, 0.4));
        let millis = off.error.abs() / speed * 1e3 * (1.0 + missed);
        let extends = (off.error > 0.0) == (mode_view.we_sign >= 0);
        let command = if extends { Command::WristExtension } else { Command::WristFlexion };
        let millis = millis.clamp(MIN_HOLD_MS, MAX_HOLD_MS) as u64;
        self.movement = Some(TimedMovement { command, millis, since: None });
        self.decided = false;
        command
    }

    /// The movement goes on until its time is over; none without one.
    fn continue_movement(&mut self, now: SimTime) -> Option<Command> {
        let movement = self.movement.as_mut()?;
        if self.sensorimotor.command() == movement.command {
            let since = *movement.since.get_or_insert(now);
            if now.millis_since(since) >= movement.millis {
                self.movement = None;
                self.watch_until = now.plus_millis(WATCH_MILLIS + self.sensorimotor.options.reaction_ms);
                return Some(Command::NoMotion);
            }
        }
        Some(movement.command)
    }

    /// What each mode is off by; nothing where it cannot be told by the modes that there are.
    fn mode_errors(&mut self, seen: &DisplayFrame, by_axis: bool) -> Vec<SteeringError> {
        match (self.task_goal.clone(), by_axis) {
            (Some(TaskGoal::Ball { center, radius }), true) => {
                let off = self.hand_error(seen, &center);
                // Three axes that are off by this much each leave the ball just so.
                let allowed = radius / 3.0_f64.sqrt();
                let axis = |k: usize| SteeringError {
                    mode: FIRST_AXIS_MODE + k as u8,
                    error: off[k],
                    tolerance_share: off[k].abs() / allowed,
                };
                (0..3).map(axis).collect()
            }
            (Some(TaskGoal::Ball { center, radius }), false) => {
                let Some(q) = seen.joints.get(..self.arm_model.joint_count()) else { return Vec::new() };
                let wanted = self.posture_for(seen, q, &center, radius);
                let joint = |(k, (to, at)): (usize, (&f64, &f64))| SteeringError {
                    mode: k as u8,
                    error: to - at,
                    tolerance_share: DONE_SHARE * (to - at).abs() / JOINT_TOLERANCE_RAD,
                };
                wanted.iter().zip(q).enumerate().map(joint).collect()
            }
            (Some(TaskGoal::Posture { joints }), false) => {
                let off = |goal: &proact_types::JointGoal| {
                    let amount = goal.angle - seen.joints.get(usize::from(goal.joint))?;
                    Some(SteeringError {
                        mode: goal.joint,
                        error: amount,
                        tolerance_share: amount.abs() / goal.tolerance,
                    })
                };
                joints.iter().filter_map(off).collect()
            }
            (Some(TaskGoal::Posture { .. } | TaskGoal::Disc { .. }) | None, _) => Vec::new(),
        }
    }

    /// From the hand's grasp centre to `goal_point`, along the axes of the base.
    fn hand_error(&self, seen: &DisplayFrame, goal_point: &Point) -> Vector {
        let hand = seen.world_from_tip * self.arm_model.widest_grasp_center();
        seen.world_from_base.inverse() * (goal_point - hand)
    }

    /// The joints that bring the hand to `goal_point`, its attitude kept where that can be.
    fn posture_for(
        &mut self,
        seen: &DisplayFrame,
        q: &[f64],
        goal_point: &Point,
        radius: f64,
    ) -> JointVector {
        let point = self.arm_model.widest_grasp_center();
        let target = seen.world_from_base.inverse() * goal_point;
        if let Some(wanted) = &self.target_joints
            && (self.arm_model.forward(wanted) * point - target).norm() < REPLAN_SHARE * radius
        {
            return wanted.clone();
        }
        let axis = Vector::z();
        let tip = self.arm_model.forward(q);
        let goal = HandGoal {
            point,
            axis,
            target,
            up: tip.rotation * axis,
            excess_height_weight: 1.0,
            point_tolerance_m: REPLAN_SHARE * radius,
            tilt_tolerance_rad: std::f64::consts::PI,
            orientation: None,
        };
        let all = (0..q.len()).fold(0, |set, joint| set | 1 << joint);
        let wanted = self.arm_model.inverse(q, &goal, all);
        self.target_joints = Some(wanted.clone());
        wanted
    }
}

impl Participant for SteeringParticipant {
    fn step(&mut self, frame: &DisplayFrame) -> Intention {
        let now = frame.time;
        let seen = self.sensorimotor.perceive(frame);
        let wanted = self.next_command(now, &seen);
        self.sensorimotor.set_command(now, seen.stop.is_some(), wanted);
        let hand = Point::from(frame.world_from_tip.translation.vector);
        let fixation_point = match &self.task_goal {
            Some(TaskGoal::Ball { center, .. } | TaskGoal::Disc { center, .. }) => *center,
            _ => hand,
        };
        self.sensorimotor.intention(frame, fixation_point, Some(hand), None)
    }
}
