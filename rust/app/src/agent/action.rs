//! What a program does: as a person, by gestures and looks; or in the place of a control method, by speeds.

use super::AgentError;
use crate::trial::OwnParts;
use nalgebra::Vector6;
use proact_arm::{ArmModel, Chain, ChainPoses, damped_step_within};
use proact_control::{
    HandCommand, MethodEntry, MethodProgram, MethodRegistry, MotionCommand, OutputLine, ports::MethodProcess,
};
use proact_participants::Participant;
use proact_testbed::{ConfigError, Session, TrialConfig};
use proact_types::{
    DisplayFrame, Gesture, Intention, JointVector, MethodAnswer, MethodHelp, MethodInfo, MethodStyle, Needs,
    Point, SimTime, TaskGoal, TrunkPosture, Vector, joints, zeros,
};
use std::{
    str::FromStr,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
};

/// What stands for the program of a method whose place an agent takes. A replay takes its answers from the log.
const AGENT_COMMAND: &str = "proact:agent";
/// Ticks from one control step to the next.
const CONTROL_TICKS: u64 = 10;
/// The same in seconds.
const CONTROL_SECS: f64 = 0.01;
/// Speeds of the hand at an action of one, m/s and rad/s. ASSUMED: what joints of 0.5 rad/s and an arm of 0.6 m come to.
const LINEAR_SPEED: f64 = 0.2;
const ANGULAR_SPEED: f64 = 0.5;
/// Damping of the step from hand to joints, the square of a lambda of 0.05. ASSUMED: slows within a few degrees of a singularity.
const DAMPING: f64 = 0.0025;
/// An action for the hand beyond this closes it, below its negative opens it; between them it stays as it was told last.
const HAND_THRESHOLD: f64 = 1.0 / 3.0;
/// Where nothing has a target of its own, as many places along each side of where objects may be put down.
const GRID: usize = 3;

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
    Choices(Vec<Vec<String>>),
    /// Numbers from -1 to 1.
    Numbers(Vec<String>),
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
enum Look {
    Ahead,
    Object(usize),
    Place(Point),
    Asked,
}

/// What the agent asks for now.
#[derive(Debug)]
struct Asked {
    gesture: Gesture,
    look: Look,
    speeds: JointVector,
    hand: Option<HandCommand>,
}

/// Between the agent and those who act for it within a tick: all in one thread, one after the other.
#[derive(Clone)]
struct Board(Arc<Mutex<Asked>>);

impl Board {
    fn open(&self) -> MutexGuard<'_, Asked> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Participant for Board {
    fn step(&mut self, frame: &DisplayFrame) -> Intention {
        let asked = self.open();
        let at = match asked.look {
            Look::Ahead => None,
            Look::Object(index) => frame.objects.get(index).map(|pose| Point::from(pose.translation.vector)),
            Look::Place(point) => Some(point),
            Look::Asked => match &frame.asked {
                Some(TaskGoal::Disc { centre, .. } | TaskGoal::Ball { centre, .. }) => Some(*centre),
                Some(TaskGoal::Posture { .. }) | None => None,
            },
        };
        let head = frame.world_from_head;
        let ray = at.map(|at| at.coords - head.translation.vector);
        let gaze_direction =
            ray.and_then(|ray| ray.try_normalize(1e-9)).unwrap_or(head.rotation * Vector::x());
        Intention {
            gesture: asked.gesture,
            gaze_direction,
            eyes_open: true,
            trunk: TrunkPosture::default(),
            limb: None,
        }
    }
}

impl MethodProcess for Board {
    fn ask(&mut self, now: SimTime, _line: &str) -> MethodAnswer {
        let mut asked = self.open();
        let motion = Some(MotionCommand::Velocity(asked.speeds.clone()));
        let line = OutputLine { time: now, motion, hand: asked.hand.take(), ..OutputLine::default() };
        serde_json::to_string(&line).map_err(|error| error.to_string()).into()
    }
}

/// True if the tick after `now` brings a step of the control method.
pub(super) fn is_control_tick(now: SimTime) -> bool {
    (now.0 + 1).is_multiple_of(CONTROL_TICKS)
}

/// Turns actions into what a person or a method does.
pub(super) struct Driver {
    level: ActionLevel,
    kind: ActionKind,
    /// Choices of looks, in their order.
    looks: Vec<Look>,
    chain: Chain,
    grasp_centre: Point,
    /// Of the hand, in `world`: linear, then angular.
    twist: Vector6<f64>,
    /// Told last.
    hand: Option<HandCommand>,
    board: Board,
}

impl Driver {
    /// At `level`, before the trial of `config`, which then says what drives it; and what takes part in the trial for the agent.
    pub(super) fn new(
        level: ActionLevel,
        methods: &MethodRegistry,
        model: &ArmModel,
        config: &mut TrialConfig,
    ) -> Result<(Self, OwnParts), AgentError> {
        let asked = Asked {
            gesture: Gesture::NoMotion,
            look: Look::Ahead,
            speeds: zeros(model.arm_count()),
            hand: None,
        };
        let board = Board(Arc::new(Mutex::new(asked)));
        let as_person = match level {
            ActionLevel::Gesture | ActionLevel::Selection => {
                check_method(level, &config.method_entry(methods)?)?;
                true
            }
            ActionLevel::JointSpeed | ActionLevel::EndEffectorSpeed => {
                *config = config.clone().by(&agent_method(level));
                false
            }
        };
        // Nobody looks: a gaze that rests would be that of a frozen eye tracker.
        config.gaze &= level == ActionLevel::Selection;
        let (kind, looks) = kind_of(level, model, config)?;
        let driver = Self {
            level,
            kind,
            looks,
            chain: Chain::new(model),
            grasp_centre: Point::from(model.widest_grasp().centre),
            twist: Vector6::zeros(),
            hand: None,
            board: board.clone(),
        };
        let own = OwnParts {
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
    pub(super) fn take(&mut self, action: &[f64]) -> Result<(), ActionError> {
        self.check(action)?;
        let mut asked = self.board.open();
        // The check has shown that they are places.
        let chosen = |index: usize| action[index] as usize;
        match self.level {
            ActionLevel::Gesture => asked.gesture = Gesture::ALL[chosen(0)],
            ActionLevel::Selection => {
                asked.look = self.looks[chosen(0)];
                asked.gesture = Gesture::ALL[chosen(1)];
            }
            ActionLevel::JointSpeed => {
                let limits = self.chain.limits().iter();
                asked.speeds = limits.zip(action).map(|(limits, share)| limits.velocity * share).collect();
            }
            ActionLevel::EndEffectorSpeed => {
                self.twist = Vector6::from_fn(|row, _| {
                    action[row] * if row < 3 { LINEAR_SPEED } else { ANGULAR_SPEED }
                });
            }
        }
        if let (ActionLevel::JointSpeed | ActionLevel::EndEffectorSpeed, Some(hand)) =
            (self.level, action.last())
        {
            let told = match *hand {
                share if share > HAND_THRESHOLD => Some(HandCommand::Close),
                share if share < -HAND_THRESHOLD => Some(HandCommand::Open),
                _ => self.hand,
            };
            // Said once: a command that is repeated would begin the motion again.
            if told != self.hand {
                (self.hand, asked.hand) = (told, told);
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
            ActionKind::Choices(choices) => {
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
            ActionKind::Numbers(names) => {
                length(names.iter().map(String::as_str).collect())?;
                if let Some(index) = action.iter().position(|got| !(-1.0..=1.0).contains(got)) {
                    return Err(number(index, &names[index], "a number from -1 to 1".to_owned()));
                }
            }
        }
        Ok(())
    }

    /// Before a control step: the joint speeds by which the hand moves as it was asked to.
    pub(super) fn command(&mut self, session: &Session) {
        if self.level != ActionLevel::EndEffectorSpeed {
            return;
        }
        let testbed = session.testbed();
        let angles = &testbed.targets()[..self.chain.joint_count()];
        let mut poses = ChainPoses::default();
        self.chain.place(angles, &mut poses);
        let mut columns = self.chain.jacobian(&poses, &(poses.tip * self.grasp_centre));
        let base_from_world = testbed.plant().state().world_from_base.rotation.inverse();
        let (linear, angular) = (self.twist.fixed_rows::<3>(0), self.twist.fixed_rows::<3>(3));
        let (linear, angular) = (base_from_world * linear, base_from_world * angular);
        let shift =
            Vector6::new(linear.x, linear.y, linear.z, angular.x, angular.y, angular.z) * CONTROL_SECS;
        let limits = self.chain.limits();
        let slowest = limits.iter().map(|limits| limits.velocity).fold(f64::INFINITY, f64::min);
        let mut next = joints(angles);
        damped_step_within(&mut next, limits, &mut columns, &shift, DAMPING, slowest * CONTROL_SECS);
        let speeds = next.iter().zip(angles).map(|(next, now)| (next - now) / CONTROL_SECS).collect();
        self.board.open().speeds = speeds;
    }
}

/// What is told of the method whose place an agent takes.
fn agent_method(level: ActionLevel) -> MethodEntry {
    let name =
        if level == ActionLevel::JointSpeed { "agent_joint_speed" } else { "agent_end_effector_speed" };
    let info = MethodInfo {
        name: name.to_owned(),
        title: "speeds from a program".to_owned(),
        needs: Needs::default(),
        style: MethodStyle::Jogging,
        help: MethodHelp::default(),
    };
    let program =
        MethodProgram { info: Some(info.clone()), ..MethodProgram::new(vec![AGENT_COMMAND.to_owned()]) };
    MethodEntry::outside(info, program)
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
fn kind_of(
    level: ActionLevel,
    model: &ArmModel,
    config: &TrialConfig,
) -> Result<(ActionKind, Vec<Look>), AgentError> {
    let gestures = || Gesture::ALL.map(|gesture| gesture.ros_name().to_owned()).to_vec();
    let with_hand = |mut names: Vec<String>| {
        names.push("hand".to_owned());
        ActionKind::Numbers(names)
    };
    Ok(match level {
        ActionLevel::Gesture => (ActionKind::Choices(vec![gestures()]), Vec::new()),
        ActionLevel::Selection => {
            let looks = looks(model, config)?;
            let names = looks.iter().map(|(name, _)| name.clone()).collect();
            (ActionKind::Choices(vec![names, gestures()]), looks.into_iter().map(|(_, look)| look).collect())
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
fn looks(model: &ArmModel, config: &TrialConfig) -> Result<Vec<(String, Look)>, ConfigError> {
    let task = config.build_task(model)?;
    let scene = task.scene();
    let mut looks = vec![("ahead".to_owned(), Look::Ahead), ("asked".to_owned(), Look::Asked)];
    looks.extend(scene.ids().map(|id| (format!("object.{}", scene.name(id)), Look::Object(id.index()))));
    looks.extend(
        scene.targets.iter().map(|to| (format!("target.{}", scene.name(to.object)), Look::Place(to.centre))),
    );
    if scene.targets.is_empty() && !scene.objects.is_empty() {
        let [min, max] = [scene.put_down.min, scene.put_down.max];
        let at = |axis: usize, step: usize| {
            min[axis] + (step as f64 + 0.5) / GRID as f64 * (max[axis] - min[axis])
        };
        for (row, column) in (0..GRID).flat_map(|row| (0..GRID).map(move |column| (row, column))) {
            let point = Point::new(at(0, row), at(1, column), scene.table_height);
            looks.push((format!("place.{row}.{column}"), Look::Place(point)));
        }
    }
    Ok(looks)
}
