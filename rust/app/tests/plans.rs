//! What the testbed asks of a planner, which of its answers count, and what becomes of broken gaze: on the real
//! physics, with a planner that is played.
#![allow(clippy::disallowed_methods)] // Tests have a clock of their own if they want one.

use proact_dynamics::{DynamicsOptions, RigidBodyPlant};
use proact_kinematics::Kinematics;
use proact_testbed::{Setup, Testbed, TestbedParts, TickOutput, TrialConfig, ports::PlanService};
use proact_types::{
    Command, EventKind, GazeSample, Heartbeat, HeartbeatKind, InputSource, ObjectId, PlanReply, PlanRequest,
    PlanStatus, PlannerView, Point, Pose, TickInput, Trajectory, TrajectoryPoint, Vector, joints,
};
use std::{
    error::Error,
    sync::{Arc, Mutex},
};

type Outcome<T = ()> = Result<T, Box<dyn Error>>;

/// Keeps what was asked and answers nothing: the test hands in the plans.
#[derive(Clone, Default)]
struct Asked(Arc<Mutex<Vec<PlanRequest>>>);

impl Asked {
    fn last(&self) -> Option<PlanRequest> {
        self.0.lock().expect("one thread").last().cloned()
    }

    /// A plan for request `id` that turns the elbow by 0.3 rad in a second.
    fn reply(&self, id: u64) -> Option<PlanReply> {
        let request = self.last()?;
        let rest = joints(&[0.0; 7]);
        let mut end = request.start.clone();
        end[3] -= 0.3;
        let points = vec![
            TrajectoryPoint { time_secs: 0.0, q: request.start, qd: rest.clone() },
            TrajectoryPoint { time_secs: 1.0, q: end, qd: rest },
        ];
        Some(PlanReply {
            id,
            status: PlanStatus::Ok,
            trajectory: Trajectory { points },
            reason: String::new(),
            clearance_m: None,
        })
    }
}

impl PlanService for Asked {
    fn submit(&mut self, request: PlanRequest) {
        self.0.lock().expect("one thread").push(request);
    }

    fn poll(&mut self, _id: u64) -> Option<PlanReply> {
        None
    }

    fn wait(&mut self, _id: u64) -> PlanReply {
        unreachable!("live trials poll")
    }

    fn cancel(&mut self) {}
}

/// A live trial before a planner.
struct Trial {
    testbed: Testbed,
    asked: Asked,
    eye: Point,
    looks_at: Option<Vector>,
}

impl Trial {
    fn new() -> Outcome<Self> {
        let config = TrialConfig::new("D", 1, Setup::named("still")?);
        let config = TrialConfig { wait_for_plans: false, ..config };
        let model = Arc::new(proact_description::mpl_right_arm());
        let task = config.build_task(&model)?;
        let body = config.setup.body;
        let base = body.shoulder_pose(&Default::default());
        let initial: Vec<f64> =
            model.pose("arm", "start")?.iter().chain(model.pose("hand", "open")?).copied().collect();
        let plant = RigidBodyPlant::new(&model, task.scene(), &initial, &base, DynamicsOptions::default())?;
        let requested = Asked::default();
        let parts = TestbedParts {
            arm: config.arm.clone(),
            kinematics: Box::new(Kinematics::new(&model)?),
            plant: Box::new(plant),
            methods: proact_control::MethodRegistry::standard(),
            plans: Box::new(requested.clone()),
            classifier: None,
            process: None,
            model,
        };
        let eye = Point::from(body.head_pose(&Default::default()).translation.vector);
        Ok(Self { testbed: Testbed::new(config, parts)?, asked: requested, eye, looks_at: None })
    }

    /// Makes `command` for `ms`, with `first` as the input of the first tick; what came out.
    fn make(&mut self, command: Command, first: TickInput, ms: u64) -> Outcome<Vec<TickOutput>> {
        let mut outputs = Vec::new();
        let mut input = TickInput { command: Some(command), ..first };
        for tick in 0..ms {
            if tick % 10 == 0 {
                let red = self.testbed.plant().state().objects[0].pose.translation.vector;
                let direction = self.looks_at.unwrap_or(red - self.eye.coords);
                input.gaze = Some(GazeSample { origin: self.eye, direction, valid: true });
                // As a mouse does, which may rest.
                input
                    .heartbeats
                    .push(Heartbeat { source: InputSource::Page, kind: HeartbeatKind::PointingDevice });
            }
            outputs.push(self.testbed.tick(&input, false)?);
            input = TickInput::default();
        }
        Ok(outputs)
    }

    fn elbow(&self) -> f64 {
        self.testbed.plant().state().position[3]
    }
}

fn plan(reply: Option<PlanReply>) -> TickInput {
    TickInput { plan: reply, ..TickInput::default() }
}

fn moved(trial: &mut Trial, command: Command, reply: Option<PlanReply>) -> Outcome<(bool, f64)> {
    let before = trial.elbow();
    let outputs = trial.make(command, plan(reply), 500)?;
    Ok((outputs.iter().any(|output| output.plan.is_some()), (trial.elbow() - before).abs()))
}

#[test]
fn a_plan_that_nobody_asked_for_or_that_comes_after_a_cancel_is_dropped_and_the_right_one_is_followed()
-> Outcome {
    let mut trial = Trial::new()?;
    trial.make(Command::NoMotion, TickInput::default(), 200)?;
    // Nobody asked at all.
    trial.make(Command::WristExtension, TickInput::default(), 20)?;
    let first = trial.asked.last().ok_or("WE asks for a plan")?.id;
    for foreign in [first + 76, 0] {
        let reply = trial.asked.reply(foreign);
        let (taken, travel) = moved(&mut trial, Command::WristExtension, reply)?;
        assert!(
            !taken && travel < 0.01,
            "plan {foreign} for request {first} moved the elbow by {travel} rad"
        );
    }
    // The person lets go; the plan comes all the same.
    trial.make(Command::NoMotion, TickInput::default(), 50)?;
    let late = trial.asked.reply(first);
    let (taken, travel) = moved(&mut trial, Command::NoMotion, late.clone())?;
    assert!(!taken && travel < 0.01, "a late plan moved the elbow by {travel} rad");
    // Nor does it count for the next request.
    let (taken, travel) = moved(&mut trial, Command::WristExtension, late)?;
    assert!(!taken && travel < 0.01, "an old plan moved the elbow by {travel} rad");
    let second = trial.asked.last().ok_or("WE asks again")?.id;
    assert_ne!(first, second);
    let right = trial.asked.reply(second);
    let (taken, travel) = moved(&mut trial, Command::WristExtension, right)?;
    assert!(taken && travel > 0.1, "the right plan moved the elbow by {travel} rad");
    Ok(())
}

#[test]
fn defect_29_every_request_carries_the_whole_scene_after_hand_commands_too() -> Outcome {
    let mut trial = Trial::new()?;
    for command in [Command::HandClose, Command::HandOpen] {
        trial.make(command, TickInput::default(), 1500)?;
        trial.make(Command::NoMotion, TickInput::default(), 100)?;
    }
    trial.make(Command::WristExtension, TickInput::default(), 20)?;
    let request = trial.asked.last().ok_or("WE asks for a plan")?;
    let at = |name: &str| -> Option<Pose> {
        request.obstacles.iter().find(|obstacle| obstacle.name == name).map(|obstacle| obstacle.pose)
    };
    let blocks = &trial.testbed.task().scene().objects;
    assert_eq!(blocks.len(), trial.testbed.plant().state().objects.len());
    for (block, body) in blocks.iter().zip(&trial.testbed.plant().state().objects) {
        let pose = at(&block.name).ok_or(&*block.name)?;
        assert!((pose.translation.vector - body.pose.translation.vector).norm() < 1e-3, "{}", block.name);
    }
    for object in &trial.testbed.task().scene().fixed {
        assert_eq!(at(&object.name), Some(object.pose), "{}", object.name);
    }
    Ok(())
}

#[test]
fn a_gaze_that_is_no_number_or_has_no_direction_is_a_blink_on_the_record_and_the_trial_goes_on() -> Outcome {
    for broken in [Vector::new(f64::NAN, 0.0, 0.0), Vector::zeros(), Vector::new(f64::INFINITY, 0.0, 0.0)] {
        let mut trial = Trial::new()?;
        trial.make(Command::NoMotion, TickInput::default(), 100)?;
        trial.looks_at = Some(broken);
        let outputs = trial.make(Command::NoMotion, TickInput::default(), 700)?;
        let events: Vec<&EventKind> =
            outputs.iter().flat_map(|output| &output.events).map(|event| &event.kind).collect();
        assert_eq!(events, [&EventKind::GazeUnusable], "said once, {broken:?}");
        let frame = trial.testbed.frame(Pose::identity())?;
        assert_eq!(frame.target.object, None, "what is not looked at any more goes out");
        assert!(frame.gaze.is_some_and(|gaze| !gaze.valid && gaze.direction.norm() > 0.5));
        trial.looks_at = None;
        trial.make(Command::NoMotion, TickInput::default(), 100)?;
        assert_eq!(trial.testbed.frame(Pose::identity())?.target.object, Some(ObjectId(0)));
    }
    // A gaze from behind meets no block and selects none.
    let mut trial = Trial::new()?;
    trial.looks_at = Some(-Vector::x());
    trial.make(Command::WristExtension, TickInput::default(), 200)?;
    let frame = trial.testbed.frame(Pose::identity())?;
    assert_eq!(frame.target.object, None);
    assert!(trial.asked.last().is_none());
    assert!(
        matches!(&frame.planner, PlannerView::Failed { reason, .. } if reason.contains("look at a block")),
        "{:?}",
        frame.planner
    );
    Ok(())
}
