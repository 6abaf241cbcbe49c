//! A rig that carries out what a method asks for, with the doubles of the ports.
#![allow(dead_code)] // Each test program uses its part.

use proact_arm::{ArmModel, JointLimits};
pub use proact_control::doubles::START_RAD;
use proact_control::doubles::{SerialKinematics, test_arm};
use proact_control::ports::ArmKinematics;
use proact_control::{
    ControlInput, ControlMethod, ControlOutput, HandCommand, JointStates, MethodDisplay, MotionCommand,
    MotionState, Profile, build,
};
use proact_types::{
    Command, HandState, HandView, JointVector, ObjectId, PlanReply, PlanStatus, PlannerView, Point, Pose,
    SimTime, Stop, Target, Trajectory, TrajectoryPoint, joints,
};

pub const BLOCKS: [Point; 4] = [
    Point::new(-0.08, -0.2, 1.04),
    Point::new(0.08, -0.2, 1.04),
    Point::new(-0.08, -0.08, 1.04),
    Point::new(0.08, -0.08, 1.04),
];

/// The arm that the methods drive here.
pub fn model() -> ArmModel {
    test_arm()
}

pub fn limits() -> Vec<JointLimits> {
    let model = model();
    model.arm.iter().map(|&j| model.joints[j].limits).collect()
}

/// A method on an arm that does exactly what it is asked.
pub struct Rig {
    pub method: Box<dyn ControlMethod>,
    /// After the last step.
    pub shown: MethodDisplay,
    pub kinematics: SerialKinematics,
    pub q: JointVector,
    /// What is measured differs from what is asked by this.
    pub lag: [f64; 7],
    pub gesture: Command,
    /// How hard it is made, 0 to 1.
    pub effort: f64,
    /// As in [`ControlInput::drives`].
    pub drives: Vec<f64>,
    /// A message of the classifier every so many milliseconds; none for keys.
    pub message_ms: Option<u64>,
    pub hand: HandView,
    pub highlight: Option<ObjectId>,
    pub place: Point,
    pub targets: Vec<Target>,
    pub limb: Option<Vec<f64>>,
    pub stop: Option<Stop>,
    pub base: Pose,
    pub plan: Option<PlanReply>,
    pub now: u64,
    command: MotionCommand,
    since: u64,
    finished: bool,
}

impl Rig {
    pub fn new(method: &str, profile: &str) -> Self {
        let profile = Profile::named(profile).expect("an embedded profile");
        Self::with(build(method, &profile, &model()).expect("a known method"))
    }

    pub fn with(method: Box<dyn ControlMethod>) -> Self {
        Self {
            method,
            shown: MethodDisplay::default(),
            kinematics: SerialKinematics::new(&model()),
            q: joints(&START_RAD),
            lag: [0.0; 7],
            gesture: Command::NoMotion,
            effort: 1.0,
            drives: Vec::new(),
            message_ms: Some(50),
            hand: HandView::default(),
            highlight: Some(ObjectId(0)),
            place: Point::new(0.05, 0.2, 1.015),
            targets: Vec::new(),
            limb: None,
            stop: None,
            base: Pose::translation(-0.39, 0.12, 1.5),
            plan: None,
            now: 0,
            command: MotionCommand::Hold,
            since: 0,
            finished: false,
        }
    }

    /// What the arm was told last.
    pub fn command(&self) -> &MotionCommand {
        &self.command
    }

    /// One control step now, at the present time.
    pub fn step(&mut self) -> ControlOutput {
        let measured: Vec<f64> = self.q.iter().zip(&self.lag).map(|(q, lag)| q - lag).collect();
        let message = self.message_ms.is_some_and(|ms| self.now.is_multiple_of(ms));
        let motion = match &self.command {
            MotionCommand::Follow(path) => {
                MotionState::Following((self.now - self.since) as f64 * 1e-3 / path.duration_secs())
            }
            _ if self.finished => MotionState::Finished,
            _ => MotionState::Holding,
        };
        let plan = self.plan.take();
        let input = ControlInput {
            command: self.gesture,
            recognized_gesture: self.gesture.into(),
            effort: self.effort,
            drives: &self.drives,
            published_command: message.then_some(self.gesture),
            measured: &measured,
            commanded: &self.q,
            highlight: self.highlight,
            objects: &BLOCKS,
            posterior: &[0.4, 0.3, 0.2, 0.1],
            place_point: self.place,
            hand: self.hand,
            world_from_base: self.base,
            plan: plan.as_ref(),
            motion,
            joint_states: &JointStates::default(),
            targets: &self.targets,
            limb: self.limb.as_deref(),
            stop: self.stop.as_ref(),
            emg_age_ms: None,
            gaze_age_ms: None,
            tracking_age_ms: None,
        };
        let output = self.method.step(SimTime(self.now), &input, &mut self.kinematics);
        self.shown = output.display.clone();
        if let Some(command) = &output.motion {
            self.command = command.clone();
            self.since = self.now;
            self.finished = false;
        }
        if let Some(command) = output.hand {
            let state = if command == HandCommand::Open { HandState::Open } else { HandState::Closed };
            self.hand.state = state;
        }
        output
    }

    /// Advances by `ms`, with a control step every 10 ms and at each message.
    pub fn run(&mut self, ms: u64) -> Vec<ControlOutput> {
        let mut outputs = Vec::new();
        for _ in 0..ms {
            self.now += 1;
            let message = self.message_ms.is_some_and(|ms| self.now.is_multiple_of(ms));
            if self.now.is_multiple_of(10) || message {
                outputs.push(self.step());
            }
            self.move_arm();
        }
        outputs
    }

    /// Lets the arm move for `ms` and the next, with no control step.
    pub fn advance(&mut self, ms: u64) {
        (0..=ms).for_each(|_| self.move_arm());
    }

    /// Makes a gesture for `ms`.
    pub fn make(&mut self, command: Command, ms: u64) -> Vec<ControlOutput> {
        self.gesture = command;
        self.run(ms)
    }

    /// Why nothing moves, as shown.
    pub fn refusal(&self) -> String {
        match self.shown.planner.clone() {
            PlannerView::Failed { reason, .. } => reason,
            other => panic!("a refusal was expected, not {other:?}"),
        }
    }

    pub fn tip(&mut self) -> Pose {
        self.kinematics.forward(&self.q.clone()).expect("finite angles")
    }

    fn move_arm(&mut self) {
        let limits = limits();
        match &self.command {
            MotionCommand::Velocity(speeds) if self.now - self.since < 20 => {
                self.q.iter_mut().zip(speeds).for_each(|(q, speed)| *q += speed * 1e-3);
            }
            MotionCommand::Goto(goal) => {
                self.q.iter_mut().zip(goal).for_each(|(q, goal)| *q += (goal - *q).clamp(-5e-4, 5e-4));
            }
            MotionCommand::Follow(path) => {
                let secs = (self.now - self.since) as f64 * 1e-3;
                if let Some((q, _)) = path.sample(secs) {
                    self.q = q;
                }
                if secs >= path.duration_secs() {
                    self.command = MotionCommand::Hold;
                    self.finished = true;
                }
            }
            _ => {}
        }
        self.q.iter_mut().zip(limits).for_each(|(q, limits)| *q = q.clamp(limits.lower, limits.upper));
    }
}

/// A plan from [`START_RAD`] that turns the elbow by `turn` radians.
pub fn reply(status: PlanStatus, turn: f64) -> PlanReply {
    let point = |time_secs: f64, turn: f64| {
        let mut q = joints(&START_RAD);
        q[3] += turn;
        TrajectoryPoint { time_secs, q, qd: joints(&[0.0; 7]) }
    };
    let points = if matches!(status, PlanStatus::Ok | PlanStatus::Intermediate) {
        vec![point(0.0, 0.0), point(1.0, turn)]
    } else {
        Vec::new()
    };
    PlanReply { id: 1, status, trajectory: Trajectory { points }, reason: String::new(), clearance_m: None }
}

/// Joints from 0, translations from 7, rotations from 10, as traces have them.
pub fn number(moves: proact_types::ControlledDof) -> u8 {
    use proact_types::ControlledDof::{Joint, Rotation, Translation};
    match moves {
        Joint(joint) => joint,
        Translation(axis) => 7 + axis,
        Rotation(axis) => 10 + axis,
    }
}
