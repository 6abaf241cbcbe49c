//! An agent's trial is a trial: the same commands by the parts of a simulated one give the same digest.
#![allow(clippy::unwrap_used)] // A test.

use proact_app::{
    Arm,
    agent::{ActionLevel, AgentEnvironment, AgentOptions, AgentStep, ObservationKind, RewardKind},
    trial::{Assembly, CustomParts, simulate_with},
};
use proact_control::{
    JogProfile, JogSteps, MethodEntry, MethodProgram, MethodRegistry, MethodResponse, MotionCommand,
    ports::MethodProcess,
};
use proact_participants::Participant;
use proact_testbed::{Setup, TrialConfig};
use proact_types::{Command, DisplayFrame, Intention, MethodAnswer, SimTime, TrunkPosture, Vector, joints};

/// Milliseconds.
const PERIOD: u64 = 50;
const STEPS: usize = 40;

fn config(method: &str) -> TrialConfig {
    TrialConfig { limit_secs: 30.0, ..TrialConfig::new(method, 9, Setup::named("still").unwrap()) }
}

fn agent(action: ActionLevel, config: TrialConfig) -> AgentEnvironment {
    let options = AgentOptions {
        action,
        observation: ObservationKind::Privileged,
        reward: RewardKind::Shaped,
        period_ms: PERIOD,
        emg: None,
        gaze_error_deg: 0.0,
        record: None,
    };
    AgentEnvironment::new(&MethodRegistry::standard(), &Arm::from_config(&config).unwrap(), config, &options)
        .unwrap()
}

/// What the agent's trial asks its method or participant for at a time: it begins at the first frame, 17 ms.
fn period_of(time: SimTime) -> Option<usize> {
    (time.0 > 17).then(|| ((time.0 - 18) / PERIOD) as usize)
}

/// A trial of as many ticks as the agent's, without an agent.
fn digest_without_agent(mut config: TrialConfig, own: CustomParts) -> String {
    config.gaze = false;
    config.set_gesture_source("agent").unwrap();
    if let JogProfile::Time { speed_steps: steps, .. } = &mut config.profile.jog {
        steps.get_or_insert(JogSteps::KEYS);
    }
    let arm = Arm::from_config(&config).unwrap();
    let Assembly { mut trial, .. } =
        simulate_with(&MethodRegistry::standard(), &arm, config, None, 0.0, own).unwrap();
    for _ in 0..17 + PERIOD * STEPS as u64 {
        trial.step(false).unwrap();
    }
    trial.testbed().digest()
}

fn relaxed(command: Command) -> Intention {
    let (gaze_direction, trunk) = (Vector::x(), TrunkPosture::default());
    Intention { gesture: command, gaze_direction, eyes_open: true, trunk, limb: None }
}

/// Acts on what is displayed: a frame at the end of a period still belongs to it.
struct Script(Vec<Command>);

impl Participant for Script {
    fn step(&mut self, frame: &DisplayFrame) -> Intention {
        relaxed(period_of(frame.time).map_or(Command::NoMotion, |period| self.0[period]))
    }
}

struct Speeds(Vec<[f64; 7]>);

impl MethodProcess for Speeds {
    fn ask(&mut self, now: SimTime, _line: &str) -> MethodAnswer {
        let speeds = period_of(now).map_or([0.0; 7], |period| self.0[period]);
        let motion = Some(MotionCommand::Velocity(joints(&speeds)));
        let line = MethodResponse { time: now, motion, ..MethodResponse::default() };
        MethodAnswer::Line(serde_json::to_string(&line).unwrap())
    }
}

#[test]
fn gestures_of_an_agent_are_those_of_a_participant() {
    let gestures: Vec<Command> = (0..STEPS).map(|step| Command::ALL[step * 7 / 10 % 5]).collect();
    let mut trial = agent(ActionLevel::Gesture, config("A"));
    for command in &gestures {
        trial.step(&[command.index() as f64]).unwrap();
    }
    let own = CustomParts { participant: Some(Box::new(Script(gestures))), ..CustomParts::default() };
    assert_eq!(trial.running_trial().testbed().digest(), digest_without_agent(config("A"), own));
}

#[test]
fn joint_speeds_of_an_agent_are_those_of_a_method_in_another_process() {
    let share = |step: usize, joint: usize| ((step * 3 + joint * 5) % 11) as f64 / 10.0 - 0.5;
    let mut trial = agent(ActionLevel::JointSpeed, config("A"));
    let used = trial.running_trial().testbed().config().clone();
    let limits: Vec<f64> = {
        let model = trial.running_trial().testbed().model();
        model.arm.iter().map(|joint| model.joints[*joint].limits.velocity).collect()
    };
    let mut speeds = Vec::new();
    for step in 0..STEPS {
        let mut action: Vec<f64> = (0..7).map(|joint| share(step, joint)).collect();
        speeds.push(std::array::from_fn(|joint| action[joint] * limits[joint]));
        action.push(0.0);
        trial.step(&action).unwrap();
    }
    let info = used.method_process.and_then(|process| process.info).unwrap();
    let program =
        MethodProgram { info: Some(info.clone()), ..MethodProgram::new(vec!["proact:agent".to_owned()]) };
    let own = CustomParts {
        method: Some(Box::new(Speeds(speeds))),
        participant: Some(Box::new(Script(vec![Command::NoMotion; STEPS]))),
        decoder: None,
        intent: None,
    };
    let alike = config("A").with_method(&MethodEntry::external(info, program));
    assert_eq!(trial.running_trial().testbed().digest(), digest_without_agent(alike, own));
}

#[test]
fn a_look_and_a_gesture_carry_the_hand_to_what_is_looked_at() {
    let mut trial = agent(ActionLevel::Selection, config("D"));
    let red1 = 2.0; // Behind `ahead` and `asked`.
    let away = |trial: &AgentEnvironment| {
        let frame = trial.frame();
        (frame.world_from_tip.translation.vector - frame.objects[0].translation.vector).norm()
    };
    let before = away(&trial);
    for _ in 0..10 {
        trial.step(&[red1, Command::NoMotion.index() as f64]).unwrap();
    }
    assert_eq!(trial.frame().target.object.map(|object| object.index()), Some(0));
    let mut worth = 0.0;
    for _ in 0..100 {
        let AgentStep { reward, .. } = trial.step(&[red1, Command::WristExtension.index() as f64]).unwrap();
        worth += reward;
    }
    assert!(away(&trial) < before - 0.1, "{} m, then {} m", before, away(&trial));
    assert!(worth > 0.1, "coming nearer is worth it: {worth}");
}
