//! An agent's trial is a trial: the same commands by the parts of a simulated one give the same digest.
#![allow(clippy::unwrap_used)] // A test.

use proact_app::{
    Arm,
    agent::{ActionLevel, AgentOptions, AgentStep, AgentTrial, ObservationKind, RewardKind},
    trial::{Assembly, OwnParts, simulated_by},
};
use proact_control::{
    JogProfile, JogSteps, MethodEntry, MethodProgram, MethodRegistry, MotionCommand, OutputLine,
    ports::MethodProcess,
};
use proact_participants::Participant;
use proact_testbed::{Setup, TrialConfig};
use proact_types::{DisplayFrame, Gesture, Intention, MethodAnswer, SimTime, TrunkPosture, Vector, joints};

/// Milliseconds.
const PERIOD: u64 = 50;
const STEPS: usize = 40;

fn config(method: &str) -> TrialConfig {
    TrialConfig { limit_secs: 30.0, ..TrialConfig::new(method, 9, Setup::named("still").unwrap()) }
}

fn agent(action: ActionLevel, config: TrialConfig) -> AgentTrial {
    let options = AgentOptions {
        action,
        observation: ObservationKind::Privileged,
        reward: RewardKind::Shaped,
        period_ms: PERIOD,
        emg: None,
        gaze_error_deg: 0.0,
        record: None,
    };
    AgentTrial::new(&MethodRegistry::standard(), &Arm::of(&config).unwrap(), config, &options).unwrap()
}

/// What the agent's trial asks its method or participant for at a time: it begins at the first frame, 17 ms.
fn period_of(time: SimTime) -> Option<usize> {
    (time.0 > 17).then(|| ((time.0 - 18) / PERIOD) as usize)
}

/// A trial of as many ticks as the agent's, without an agent.
fn digest_without_agent(mut config: TrialConfig, own: OwnParts) -> String {
    config.gaze = false;
    config.gestures_from("agent").unwrap();
    if let JogProfile::Time { steps, .. } = &mut config.profile.jog {
        steps.get_or_insert(JogSteps::KEYS);
    }
    let arm = Arm::of(&config).unwrap();
    let Assembly { mut session, .. } =
        simulated_by(&MethodRegistry::standard(), &arm, config, None, 0.0, own).unwrap();
    for _ in 0..17 + PERIOD * STEPS as u64 {
        session.step(false).unwrap();
    }
    session.testbed().digest()
}

fn relaxed(gesture: Gesture) -> Intention {
    let (gaze_direction, trunk) = (Vector::x(), TrunkPosture::default());
    Intention { gesture, gaze_direction, eyes_open: true, trunk, limb: None }
}

/// Acts on what is displayed: a frame at the end of a period still belongs to it.
struct Script(Vec<Gesture>);

impl Participant for Script {
    fn step(&mut self, frame: &DisplayFrame) -> Intention {
        relaxed(period_of(frame.time).map_or(Gesture::NoMotion, |period| self.0[period]))
    }
}

struct Speeds(Vec<[f64; 7]>);

impl MethodProcess for Speeds {
    fn ask(&mut self, now: SimTime, _line: &str) -> MethodAnswer {
        let speeds = period_of(now).map_or([0.0; 7], |period| self.0[period]);
        let motion = Some(MotionCommand::Velocity(joints(&speeds)));
        let line = OutputLine { time: now, motion, ..OutputLine::default() };
        MethodAnswer::Line(serde_json::to_string(&line).unwrap())
    }
}

#[test]
fn gestures_of_an_agent_are_those_of_a_participant() {
    let gestures: Vec<Gesture> = (0..STEPS).map(|step| Gesture::ALL[step * 7 / 10 % 5]).collect();
    let mut trial = agent(ActionLevel::Gesture, config("A"));
    for gesture in &gestures {
        trial.step(&[gesture.index() as f64]).unwrap();
    }
    let own = OwnParts { participant: Some(Box::new(Script(gestures))), ..OwnParts::default() };
    assert_eq!(trial.session().testbed().digest(), digest_without_agent(config("A"), own));
}

#[test]
fn joint_speeds_of_an_agent_are_those_of_a_method_in_another_process() {
    let share = |step: usize, joint: usize| ((step * 3 + joint * 5) % 11) as f64 / 10.0 - 0.5;
    let mut trial = agent(ActionLevel::JointSpeed, config("A"));
    let used = trial.session().testbed().config().clone();
    let limits: Vec<f64> = {
        let model = trial.session().testbed().model();
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
    let own = OwnParts {
        method: Some(Box::new(Speeds(speeds))),
        participant: Some(Box::new(Script(vec![Gesture::NoMotion; STEPS]))),
        decoder: None,
        intent: None,
    };
    let alike = config("A").by(&MethodEntry::outside(info, program));
    assert_eq!(trial.session().testbed().digest(), digest_without_agent(alike, own));
}

#[test]
fn a_look_and_a_gesture_carry_the_hand_to_what_is_looked_at() {
    let mut trial = agent(ActionLevel::Selection, config("D"));
    let red1 = 2.0; // Behind `ahead` and `asked`.
    let away = |trial: &AgentTrial| {
        let frame = trial.frame();
        (frame.world_from_tip.translation.vector - frame.objects[0].translation.vector).norm()
    };
    let before = away(&trial);
    for _ in 0..10 {
        trial.step(&[red1, Gesture::NoMotion.index() as f64]).unwrap();
    }
    assert_eq!(trial.frame().target.object.map(|object| object.index()), Some(0));
    let mut worth = 0.0;
    for _ in 0..100 {
        let AgentStep { reward, .. } = trial.step(&[red1, Gesture::WristExtension.index() as f64]).unwrap();
        worth += reward;
    }
    assert!(away(&trial) < before - 0.1, "{} m, then {} m", before, away(&trial));
    assert!(worth > 0.1, "coming nearer is worth it: {worth}");
}
