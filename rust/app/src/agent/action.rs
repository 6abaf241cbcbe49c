//! What a program does: as a person, by gestures and looks; or in the place of a control method, by speeds.

use super::AgentError;
use crate::trial::CustomParts;
use nalgebra::Vector6;
use proact_arm::{ArmModel, Chain, ChainPoses, damped_step_within_limits};
use proact_control::{
    HandCommand, MethodEntry, MethodProgram, MethodRegistry, MethodResponse, MotionCommand,
    ports::MethodProcess,
};
use proact_participants::Participant;
use proact_testbed::{ConfigError, RunningTrial, TrialConfig};
use proact_types::{
    Command, DisplayFrame, Intention, JointVector, MethodAnswer, MethodHelp, MethodInfo, MethodNeeds,
    MethodStyle, Point, SimTime, TaskGoal, TrunkPosture, Vector, joints, zeros,
};
use std::{
    str::FromStr,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
};

/// What stands for the program of a method whose place an agent takes. A replay takes its answers from the log.
const AGENT_COMMAND: &str = "proact:agent";
/// Ticks from one control step to the next.
const CONTROL_PERIOD_TICKS: u64 = 10;
/// The same in seconds.
const CONTROL_PERIOD_SECS: f64 = 0.01;
/// Speeds of the hand at an action of one, m/s and rad/s. ASSUMED: what joints of 0.5 rad/s and an arm of 0.6 m come to.
const MAX_LINEAR_SPEED_M_PER_S: f64 = 0.2;
const MAX_ANGULAR_SPEED_RAD_PER_S: f64 = 0.5;
/// Damping of the step from hand to joints, the square of a lambda of 0.05. ASSUMED: slows within a few degrees of a singularity.
const IK_DAMPING: f64 = 0.0025;
/// An action for the hand beyond this closes it, below its negative opens it; between them it stays as it was told last.
const HAND_THRESHOLD: f64 = 1.0 / 3.0;
/// Where nothing has a target of its own, as many places along each side of where objects may be put down.
const PLACE_GRID_SIZE: usize = 3;

/// What an action is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ActionLevel {
    /// One of the five gestures, for methods without gaze.
    Gesture,
    /// Where the eye looks, and one of the five gestures, for methods with gaze.
    Selection,
    /// Speeds of the arm's joints, and the hand.
    JointSpeed,
    /// Speed of the hand in space, and the hand's closing.
    EndEffectorSpeed,
}

impl ActionLevel {
    /// All of them with their names.
    pub const ALL: [(&str, Self); 4] = [
        ("gesture", Self::Gesture),
        ("selection", Self::Selection),
        ("joint_speed", Self::JointSpeed),
        ("end_effector_speed", Self::EndEffectorSpeed),
    ];
}

impl FromStr for ActionLevel {
    type Err = ConfigError;

    fn from_str(name: &str) -> Result<Self, ConfigError> {
        let known = Self::ALL.into_iter().find(|(known, _)| *known == name);
        known.map(|(_, level)| level).ok_or(ConfigError::Value {
            key: "action",
            got: format!("{name:?}"),
            expected: "gesture, selection, joint_speed or end_effector_speed",
        })
    }
}

/// What the numbers of an action are, with a name for each choice or number.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ActionKind {
    /// For each number, the choices among which it is the place, from 0.
    Discrete(Vec<Vec<String>>),
    /// Numbers from -1 to 1.
    Continuous(Vec<String>),
}

/// An action that cannot be.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ActionError {
    /// Of another length.
    #[error("the action has {got} numbers, expected {expected}: {names}")]
    Length {
        /// Numbers that came.
        got: usize,
        /// Numbers that there must be.
        expected: usize,
        /// What they are.
        names: String,
    },
    /// A number that is none, or out of range.
    #[error("number {index} of the action ({name}) is {got}, expected {expected}")]
    Number {
        /// Its place, from 0.
        index: usize,
        /// What it is about.
        name: String,
        /// What came.
        got: f64,
        /// What can be.
        expected: String,
    },
    /// A method that cannot be driven at this level.
    #[error("method {method} cannot be driven by action = {level:?}: {expected}")]
    Method {
        /// Its name.
        method: String,
        /// `gesture` or `selection`.
        level: &'static str,
        /// What to do.
        expected: &'static str,
    },
}

/// Where the eye looks.
#[derive(Clone, Copy, Debug, PartialEq)]
enum AgentGaze {
    Ahead,
    Object(usize),
    Place(Point),
    TaskGoal,
}

/// What the agent asks for now.
#[derive(Debug)]
struct AgentCommand {
    gesture: Command,
    gaze: AgentGaze,
    speeds: JointVector,
    hand: Option<HandCommand>,
}

/// Between the agent and those who act for it within a tick: all in one thread, one after the other.
#[derive(Clone)]
struct SharedCommand(Arc<Mutex<AgentCommand>>);

impl SharedCommand {
    fn lock(&self) -> MutexGuard<'_, AgentCommand> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Participant for SharedCommand {
    fn step(&mut self, frame: &DisplayFrame) -> Intention {
        let agent_command = self.lock();
        let at = match agent_command.gaze {
            AgentGaze::Ahead => None,
            AgentGaze::Object(index) => {
                frame.objects.get(index).map(|pose| Point::from(pose.translation.vector))
            }
            AgentGaze::Place(point) => Some(point),
            AgentGaze::TaskGoal => match &frame.task_goal {
                Some(TaskGoal::Disc { center, .. } | TaskGoal::Ball { center, .. }) => Some(*center),
                Some(TaskGoal::Posture { .. }) | None => None,
            },
        };
        let head = frame.world_from_head;
        let ray = at.map(|at| at.coords - head.translation.vector);
        let gaze_direction =
            ray.and_then(|ray| ray.try_normalize(1e-9)).unwrap_or(head.rotation * Vector::x());
        Intention {
            gesture: agent_command.gesture,
            gaze_direction,
            eyes_open: true,
            trunk: TrunkPosture::default(),
            limb: None,
        }
    }
}

impl MethodProcess for SharedCommand {
    fn ask(&mut self, now: SimTime, _line: &str) -> MethodAnswer {
        let mut agent_command = self.lock();
        let motion = Some(MotionCommand::Velocity(agent_command.speeds.clone()));
        let line = MethodResponse {
            time: now,
            motion,
            hand: agent_command.hand.take(),
            ..MethodResponse::default()
        };
        serde_json::to_string(&line).map_err(|error| error.to_string()).into()
    }
}

/// True if the tick after `now` brings a step of the control method.
pub(super) fn is_control_tick(now: SimTime) -> bool {
    (now.0 + 1).is_multiple_of(CONTROL_PERIOD_TICKS)
}

/// Turns actions into what a person or a method does.
pub(super) struct ActionDecoder {
    level: ActionLevel,
    kind: ActionKind,
    /// Choices of looks, in their order.
    gaze_choices: Vec<AgentGaze>,
    chain: Chain,
    grasp_center: Point,
    /// Of the hand, in `world`: linear, then angular.
    twist: Vector6<f64>,
    /// Told last.
    last_hand_command: Option<HandCommand>,
    shared_command: SharedCommand,
}

impl ActionDecoder {
    /// At `level`, before the trial of `config`, which then says what drives it; and what takes part in the trial for the agent.
    pub(super) fn new(
        level: ActionLevel,
        methods: &MethodRegistry,
        model: &ArmModel,
        config: &mut TrialConfig,
    ) -> Result<(Self, CustomParts), AgentError> {
        let agent_command = AgentCommand {
            gesture: Command::NoMotion,
            gaze: AgentGaze::Ahead,
            speeds: zeros(model.arm_count()),
            hand: None,
        };
        let board = SharedCommand(Arc::new(Mutex::new(agent_command)));
        let as_person = match level {
            ActionLevel::Gesture | ActionLevel::Selection => {
                check_method(level, &config.method_entry(methods)?)?;
                true
            }
            ActionLevel::JointSpeed | ActionLevel::EndEffectorSpeed => {
                *config = config.clone().with_method(&agent_method(level));
                false
            }
        };
        // Nobody looks: a gaze that rests would be that of a frozen eye tracker.
        config.gaze &= level == ActionLevel::Selection;
        let (kind, gaze_choices) = action_space(level, model, config)?;
        let driver = Self {
            level,
            kind,
            gaze_choices,
            chain: Chain::new(model),
            grasp_center: Point::from(model.widest_grasp().center),
            twist: Vector6::zeros(),
            last_hand_command: None,
            shared_command: board.clone(),
        };
        let own = CustomParts {
            method: (!as_person).then(|| Box::new(board.clone()) as Box<dyn MethodProcess>),
            participant: Some(Box::new(board)),
            decoder: None,
            intent: None,
        };
        Ok((driver, own))
    }

    pub(super) fn kind(&self) -> &ActionKind {
        &self.kind
    }

    /// Takes an action, from the next tick on.
    pub(super) fn apply_action(&mut self, action: &[f64]) -> Result<(), ActionError> {
        self.check(action)?;
        let mut agent_command = self.shared_command.lock();
        // The check has shown that they are places.
        let chosen = |index: usize| action[index] as usize;
        match self.level {
            ActionLevel::Gesture => agent_command.gesture = Command::ALL[chosen(0)],
            ActionLevel::Selection => {
                agent_command.gaze = self.gaze_choices[chosen(0)];
                agent_command.gesture = Command::ALL[chosen(1)];
            }
            ActionLevel::JointSpeed => {
                let limits = self.chain.limits().iter();
                agent_command.speeds =
                    limits.zip(action).map(|(limits, share)| limits.velocity * share).collect();
            }
            ActionLevel::EndEffectorSpeed => {
                self.twist = Vector6::from_fn(|row, _| {
                    action[row] * if row < 3 { MAX_LINEAR_SPEED_M_PER_S } else { MAX_ANGULAR_SPEED_RAD_PER_S }
                });
            }
        }
        if let (ActionLevel::JointSpeed | ActionLevel::EndEffectorSpeed, Some(hand)) =
            (self.level, action.last())
        {
            let hand_command = match *hand {
                share if share > HAND_THRESHOLD => Some(HandCommand::Close),
                share if share < -HAND_THRESHOLD => Some(HandCommand::Open),
                _ => self.last_hand_command,
            };
            // Said once: a command that is repeated would begin the motion again.
            if hand_command != self.last_hand_command {
                (self.last_hand_command, agent_command.hand) = (hand_command, hand_command);
            }
        }
        Ok(())
    }

    fn check(&self, action: &[f64]) -> Result<(), ActionError> {
        let length = |names: Vec<&str>| match names.len() == action.len() {
            true => Ok(()),
            false => {
                Err(ActionError::Length { got: action.len(), expected: names.len(), names: names.join(", ") })
            }
        };
        let number = |index, name: &str, expected| ActionError::Number {
            index,
            name: name.to_owned(),
            got: action[index],
            expected,
        };
        match &self.kind {
            ActionKind::Discrete(choices) => {
                let heads = [["look", "gesture"].as_slice(), &["gesture"]];
                let names = heads[usize::from(choices.len() == 1)];
                length(names.to_vec())?;
                for (index, (choices, name)) in choices.iter().zip(names).enumerate() {
                    let got = action[index];
                    if got.fract() != 0.0 || !(0.0..choices.len() as f64).contains(&got) {
                        let expected = format!("a whole number from 0 to {}", choices.len() - 1);
                        return Err(number(index, name, expected));
                    }
                }
            }
            ActionKind::Continuous(names) => {
                length(names.iter().map(String::as_str).collect())?;
                if let Some(index) = action.iter().position(|got| !(-1.0..=1.0).contains(got)) {
                    return Err(number(index, &names[index], "a number from -1 to 1".to_owned()));
                }
            }
        }
        Ok(())
    }

    /// Before a control step: the joint speeds by which the hand moves as it was asked to.
    pub(super) fn update_joint_speeds(&mut self, trial: &RunningTrial) {
        if self.level != ActionLevel::EndEffectorSpeed {
            return;
        }
        let testbed = trial.testbed();
        let angles = &testbed.targets()[..self.chain.joint_count()];
        let mut poses = ChainPoses::default();
        self.chain.link_poses_into(angles, &mut poses);
        let mut columns = self.chain.jacobian(&poses, &(poses.tip * self.grasp_center));
        let base_from_world = testbed.plant().state().world_from_base.rotation.inverse();
        let (linear, angular) = (self.twist.fixed_rows::<3>(0), self.twist.fixed_rows::<3>(3));
        let (linear, angular) = (base_from_world * linear, base_from_world * angular);
        let shift =
            Vector6::new(linear.x, linear.y, linear.z, angular.x, angular.y, angular.z) * CONTROL_PERIOD_SECS;
        let limits = self.chain.limits();
        let slowest = limits.iter().map(|limits| limits.velocity).fold(f64::INFINITY, f64::min);
        let mut next = joints(angles);
        damped_step_within_limits(
            &mut next,
            limits,
            &mut columns,
            &shift,
            IK_DAMPING,
            slowest * CONTROL_PERIOD_SECS,
        );
        let speeds = next.iter().zip(angles).map(|(next, now)| (next - now) / CONTROL_PERIOD_SECS).collect();
        self.shared_command.lock().speeds = speeds;
    }
}

/// What is told of the method whose place an agent takes.
fn agent_method(level: ActionLevel) -> MethodEntry {
    let name =
        if level == ActionLevel::JointSpeed { "agent_joint_speed" } else { "agent_end_effector_speed" };
    let info = MethodInfo {
        name: name.to_owned(),
        title: "speeds from a program".to_owned(),
        needs: MethodNeeds::default(),
        style: MethodStyle::Jogging,
        help: MethodHelp::default(),
    };
    let program =
        MethodProgram { info: Some(info.clone()), ..MethodProgram::new(vec![AGENT_COMMAND.to_owned()]) };
    MethodEntry::external(info, program)
}

fn check_method(level: ActionLevel, method: &MethodEntry) -> Result<(), ActionError> {
    let (level, expected) = match (level, method.needs().gaze) {
        (ActionLevel::Gesture, true) => {
            ("gesture", "it needs gaze; use action = \"selection\", or a method without gaze such as A or B")
        }
        (ActionLevel::Selection, false) => (
            "selection",
            "it does without gaze; use action = \"gesture\", or a method with gaze such as C or D",
        ),
        _ => return Ok(()),
    };
    Err(ActionError::Method { method: method.info().name.clone(), level, expected })
}

/// What actions at `level` are in the trial of `config`, and the looks among which they choose.
fn action_space(
    level: ActionLevel,
    model: &ArmModel,
    config: &TrialConfig,
) -> Result<(ActionKind, Vec<AgentGaze>), AgentError> {
    let gestures = || Command::ALL.map(|command| command.ros_name().to_owned()).to_vec();
    let with_hand = |mut names: Vec<String>| {
        names.push("hand".to_owned());
        ActionKind::Continuous(names)
    };
    Ok(match level {
        ActionLevel::Gesture => (ActionKind::Discrete(vec![gestures()]), Vec::new()),
        ActionLevel::Selection => {
            let gaze_choices = list_gaze_choices(model, config)?;
            let names = gaze_choices.iter().map(|(name, _)| name.clone()).collect();
            (
                ActionKind::Discrete(vec![names, gestures()]),
                gaze_choices.into_iter().map(|(_, gaze_choice)| gaze_choice).collect(),
            )
        }
        ActionLevel::JointSpeed => {
            let name = |joint: &usize| model.joints[*joint].name.clone();
            (with_hand(model.arm.iter().map(name).collect()), Vec::new())
        }
        ActionLevel::EndEffectorSpeed => {
            let names = ["linear.x", "linear.y", "linear.z", "angular.x", "angular.y", "angular.z"];
            (with_hand(names.map(str::to_owned).to_vec()), Vec::new())
        }
    })
}

/// Where an eye can look: ahead, at an object, at a target or a place, at what is asked for.
fn list_gaze_choices(
    model: &ArmModel,
    config: &TrialConfig,
) -> Result<Vec<(String, AgentGaze)>, ConfigError> {
    let task = config.build_task(model)?;
    let scene = task.scene();
    let mut gaze_choices =
        vec![("ahead".to_owned(), AgentGaze::Ahead), ("asked".to_owned(), AgentGaze::TaskGoal)];
    gaze_choices
        .extend(scene.ids().map(|id| (format!("object.{}", scene.name(id)), AgentGaze::Object(id.index()))));
    gaze_choices.extend(
        scene
            .targets
            .iter()
            .map(|to| (format!("target.{}", scene.name(to.object)), AgentGaze::Place(to.center))),
    );
    if scene.targets.is_empty() && !scene.objects.is_empty() {
        let [min, max] = [scene.place_region.min, scene.place_region.max];
        let at = |axis: usize, step: usize| {
            min[axis] + (step as f64 + 0.5) / PLACE_GRID_SIZE as f64 * (max[axis] - min[axis])
        };
        for (row, column) in
            (0..PLACE_GRID_SIZE).flat_map(|row| (0..PLACE_GRID_SIZE).map(move |column| (row, column)))
        {
            let point = Point::new(at(0, row), at(1, column), scene.table_height);
            gaze_choices.push((format!("place.{row}.{column}"), AgentGaze::Place(point)));
        }
    }
    Ok(gaze_choices)
}
