//! `proact node method`: gestures and what is meant in, commands for arm and hand out.

mod arm;
mod inputs;
mod outlets;

use super::{
    Graph, NodeError,
    graph::Jobs,
    stage::{self, Common, Stage, Worldly},
};
use crate::world::World;
use arm::ArmOutlet;
use outlets::Outlets;
use proact_control::{
    ControlInput, ControlMethod, ControlOutput, HandCommand, HandTracker, MotionState, PlanCommand,
    SourceWatch, ports::ArmKinematics,
};
use proact_tasks::PlaceRegion;
use proact_testbed::{ArmMotion, MethodName, TestbedError, TrialConfig, plan_request, ports::PlanService};
use proact_types::{
    BlockId, EventKind, Gesture, HandState, HandView, InputSource, JointVector, ModeView, PlanGoal,
    PlanReply, PlannerView, Point, Pose, SignKind, SimTime, Stop, TargetView,
};
use serde::{Deserialize, Serialize};
use std::{
    collections::{BTreeMap, BTreeSet},
    ops::RangeInclusive,
};

/// A block that nobody has looked at for this long is not highlighted, ms.
const LOOK_MS: u64 = 500;
/// A stage that promised to speak and is silent for this long stops the arm, ms.
const SILENCE_MS: u64 = 120;
/// A held arm that is this far from where it was asked to be, rad, was moved or stopped by somebody else.
const STRAYED: f64 = 0.05;
/// The same while it follows a path.
const LEFT_BEHIND: f64 = 0.2;
/// A command needs this long to show in the joints, ms.
const SETTLING_MS: u64 = 300;

/// What the method stage shows beside the original's topics: the text on `/proact/method`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MethodView {
    /// Name of the method, such as `D`.
    pub method: String,
    /// Gesture that it acts on.
    pub gesture: Gesture,
    /// The hand as the method sees it.
    pub hand: HandView,
    /// Why the arm must stand still; none while it need not.
    #[serde(default)]
    pub stop: Option<Stop>,
    /// Selection marker.
    pub target: TargetView,
    /// Planner and motion.
    pub planner: PlannerView,
    /// Joint or axis of the movement gestures.
    pub mode: Option<ModeView>,
    /// Arm angles at the end of the path that is followed, rad.
    pub goal: Option<JointVector>,
}

/// What the method stage is made of.
pub struct MethodParts {
    /// Method, profile, seed.
    pub config: TrialConfig,
    /// The world before the first message.
    pub world: World,
    /// The arm's kinematics.
    pub kinematics: Box<dyn ArmKinematics>,
    /// The planner.
    pub plans: Box<dyn PlanService>,
}

/// Messages that tell of the gaze, the least telling first. Once a more telling one has come, the others say nothing
/// about the eye tracker.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum GazeWord {
    Nothing,
    /// The block that is looked at: it may rightly stay the same.
    Block,
    /// Where the gaze meets the table.
    Table,
    /// The ray.
    Ray,
}

struct MethodNode {
    common: Common,
    config: TrialConfig,
    world: World,
    method: Box<dyn ControlMethod>,
    kinematics: Box<dyn ArmKinematics>,
    plans: Box<dyn PlanService>,
    /// What the arm was asked to do, as its controller does it.
    arm: Option<ArmMotion>,
    commanded_at: SimTime,
    hand: HandTracker,
    /// The goal that the hand is on its way to.
    hand_goal: Option<String>,
    gesture: Gesture,
    /// What was said last. Where a stage fell silent the method lets go, but the hand has not relaxed.
    said: Gesture,
    /// Which sources are alive.
    watch: SourceWatch,
    /// The most telling kind of message about the gaze so far, and what it said last.
    gaze_told: (GazeWord, Vec<f64>),
    shoulder: Option<Pose>,
    /// Stages that fell silent: nothing acts until they are back, or a relaxed hand is seen.
    lost: BTreeSet<String>,
    decided_at: Option<SimTime>,
    joy: Gesture,
    /// The newest gesture is the joystick's, whose silence counts then.
    joy_acts: bool,
    highlight: Option<(SimTime, BlockId)>,
    place: Point,
    looked_at: Option<SimTime>,
    posterior: Vec<f64>,
    gaze: Option<proact_types::GazeSample>,
    pending: Option<(u64, SimTime)>,
    requests: u64,
    others: BTreeMap<String, SimTime>,
    out: Outlets,
    arm_out: ArmOutlet,
}

/// Runs the method stage until the graph ends the node.
///
/// # Errors
/// [`NodeError`].
pub fn run_method(parts: MethodParts) -> Result<(), NodeError> {
    let MethodParts { config, world, kinematics, plans } = parts;
    let graph = Graph::join("proact_method")?;
    let model = world.model().clone();
    let control = |e| NodeError::Testbed(TestbedError::Control(e));
    let method =
        proact_control::build(&config.method.to_string(), &config.profile, &model).map_err(control)?;
    let open = model.pose("hand", "open").map_err(TestbedError::Model)?;
    // Method A commands joint by joint, through controllers of single joints, as the original does.
    let arm_out = ArmOutlet::new(&graph, &model, config.method == MethodName::A)?;
    let mut node = MethodNode {
        common: Common::new(&graph)?,
        method,
        kinematics,
        plans,
        arm: None,
        commanded_at: SimTime(0),
        hand: HandTracker::new(open),
        hand_goal: None,
        gesture: Gesture::NoMotion,
        said: Gesture::NoMotion,
        watch: SourceWatch::new(
            config.profile.dead_man,
            matches!(config.method, MethodName::C | MethodName::D),
        ),
        gaze_told: (GazeWord::Nothing, vec![]),
        shoulder: None,
        lost: BTreeSet::new(),
        decided_at: None,
        joy: Gesture::NoMotion,
        joy_acts: false,
        highlight: None,
        place: PlaceRegion::DEFAULT.centre(),
        looked_at: None,
        posterior: vec![],
        gaze: None,
        pending: None,
        requests: 0,
        others: BTreeMap::new(),
        out: Outlets::new(&graph)?,
        arm_out,
        config,
        world,
    };
    let jobs: Jobs<MethodNode> = Jobs::default();
    let _world = stage::listen_to_world(&graph, &jobs)?;
    let _inputs = inputs::listen(&graph, &jobs)?;
    let _keeper = node.arm_out.keep_controllers();
    stage::run(graph, &jobs, &mut node)
}

impl Stage for MethodNode {
    fn common(&mut self) -> &mut Common {
        &mut self.common
    }

    fn ticks(&mut self, ticks: RangeInclusive<u64>) -> rosrust::error::Result<()> {
        let now = self.common.now();
        self.world.step(now);
        if !self.world.is_complete() {
            return Ok(());
        }
        let arm = self.world.model().arm_count();
        if self.arm.is_none() {
            self.begin();
        }
        for _ in ticks {
            if let Some(motion) = &mut self.arm {
                motion.step();
            }
        }
        self.watch_others();
        self.watch_arm()?;
        self.watch_sources();
        let state = self.world.state();
        self.hand.step(&state.position[arm..], &state.velocity[arm..], self.hand_goal.is_some());
        let plan = self.due_plan();
        self.control(None, plan)?;
        self.show()
    }
}

impl Worldly for MethodNode {
    fn world(&mut self) -> &mut World {
        &mut self.world
    }
}

impl MethodNode {
    /// The world is seen for the first time: the arm is where it is, the hand as its fingers tell.
    fn begin(&mut self) {
        let model = self.world.model().clone();
        let arm = model.arm_count();
        let position = self.world.state().position.clone();
        self.arm = Some(ArmMotion::new(&model, &position[..arm]));
        let off = |name: &str| {
            let pose = model.pose("hand", name).unwrap_or(&[]);
            pose.iter().zip(&position[arm..]).fold(0.0_f64, |most, (a, b)| most.max((a - b).abs()))
        };
        if self.world.held().is_some() || off("closed") < off("open") {
            self.hand.note(HandCommand::Close);
        }
    }

    fn gazes(&self) -> bool {
        matches!(self.config.method, MethodName::C | MethodName::D)
    }

    /// A gesture from muscles or joystick. Acts at once, between two ticks.
    fn act(&mut self, gesture: Gesture) {
        let now = self.common.now();
        self.decided_at = Some(now);
        for kind in [SignKind::Commands, SignKind::Alive] {
            self.watch.hear(now, InputSource::GestureTopic, kind);
        }
        if gesture == Gesture::NoMotion {
            self.lost.clear();
        }
        self.said = gesture;
        self.gesture = if !self.lost.is_empty() { Gesture::NoMotion } else { gesture };
        self.watch_sources();
        let done = self.control(Some(self.gesture), None);
        self.common.note("publish", done);
    }

    /// Stops when a source died, and lets it be known; goes on when it is back and the hand was relaxed.
    fn watch_sources(&mut self) {
        if let Some(EventKind::Stopped { reason, .. }) = self.watch.step(self.common.now(), self.said) {
            self.common.faults.stop(&reason);
        }
    }

    /// A message told of the gaze: with values that differ from those before, unless it is frozen.
    fn hear_gaze(&mut self, word: GazeWord, values: &[f64]) {
        let now = self.common.now();
        self.looked_at = Some(now);
        if word < self.gaze_told.0 {
            return;
        }
        let repeats = word != GazeWord::Block && self.gaze_told.0 == word && self.gaze_told.1 == values;
        self.gaze_told = (word, values.to_vec());
        let kind = if repeats { SignKind::Repeated } else { SignKind::Fresh };
        self.watch.hear(now, InputSource::EyeTracker, kind);
    }

    /// The tracked shoulder. That of a simulated person rests to the bit; the person's heartbeat speaks for it.
    fn hear_shoulder(&mut self, pose: Pose) {
        let simulated = self.others.keys().any(|name| name.ends_with(super::participant::NAME));
        let repeats = !simulated && self.shoulder == Some(pose);
        self.shoulder = Some(pose);
        let kind = if repeats { SignKind::Repeated } else { SignKind::Fresh };
        self.watch.hear(self.common.now(), InputSource::ShoulderTracker, kind);
    }

    /// Stops when a stage that promised to speak fell silent.
    fn watch_others(&mut self) {
        let now = self.common.now();
        let silent = |at: &SimTime| now.millis_since(*at) > SILENCE_MS;
        let lost: Vec<String> =
            self.others.iter().filter(|(_, at)| silent(at)).map(|(name, _)| name.clone()).collect();
        for name in lost {
            self.others.remove(&name);
            self.gesture = Gesture::NoMotion;
            let reason = format!("{name} is silent for {SILENCE_MS} ms: no motion until it is back");
            self.common.faults.refuse("heartbeat", &reason);
            self.lost.insert(name);
        }
    }

    /// Somebody else may have stopped or moved the arm; then it is where it is.
    fn watch_arm(&mut self) -> rosrust::error::Result<()> {
        let Some(motion) = &self.arm else { return Ok(()) };
        if self.common.now().millis_since(self.commanded_at) < SETTLING_MS {
            return Ok(());
        }
        let model = self.world.model().clone();
        let measured = &self.world.state().position[..model.arm_count()];
        let off =
            motion.position().iter().zip(measured).fold(0.0_f64, |most, (a, b)| most.max((a - b).abs()));
        let follows = matches!(motion.state(), MotionState::Following(_));
        if off > if follows { LEFT_BEHIND } else { STRAYED } {
            self.arm = Some(ArmMotion::new(&model, measured));
            if follows {
                let reason = format!("the arm does not follow: {off:.2} rad off; the path is given up");
                self.common.faults.refuse("arm", &reason);
                // The method lets go, and begins anew with the next message.
                self.gesture = Gesture::NoMotion;
                self.arm_out.hold(self.common.stamp())?;
            }
        }
        Ok(())
    }

    fn due_plan(&mut self) -> Option<PlanReply> {
        let (id, due) = self.pending?;
        if self.common.now() < due {
            return None;
        }
        let reply = self.plans.poll(id)?;
        self.pending = None;
        Some(reply)
    }

    fn hand_view(&self) -> HandView {
        HandView { state: self.hand.state(), holds: self.world.held() }
    }

    /// One step of the method, and what it asks for. `message`: a gesture came just now.
    fn control(&mut self, message: Option<Gesture>, plan: Option<PlanReply>) -> rosrust::error::Result<()> {
        let now = self.common.now();
        let Some(motion) = &self.arm else { return Ok(()) };
        let blocks = self.world.block_centres();
        let (commanded, doing) = (motion.position().clone(), motion.state());
        let age = |at: Option<SimTime>| at.map(|at| now.millis_since(at));
        let state = self.world.state();
        let input = ControlInput {
            gesture: self.gesture,
            message,
            measured: &state.position[..self.world.model().arm_count()],
            commanded: &commanded,
            highlight: self
                .highlight
                .and_then(|(at, block)| (now.millis_since(at) <= LOOK_MS).then_some(block)),
            blocks: &blocks,
            posterior: &self.posterior,
            place: self.place,
            hand: self.hand_view(),
            world_from_base: state.world_from_base,
            plan: plan.as_ref(),
            motion: doing,
            targets: &self.world.task().scene().targets,
            limb: None,
            stop: self.watch.stop(),
            emg_age_ms: age(self.decided_at),
            gaze_age_ms: age(self.looked_at),
            tracking_age_ms: None,
        };
        let ControlOutput { motion, hand, plan: planning, events } =
            self.method.step(now, &input, self.kinematics.as_mut());
        for event in events {
            match event {
                EventKind::Locked { .. } => self.out.frozen(true)?,
                EventKind::Unlocked => self.out.frozen(false)?,
                _ => {}
            }
        }
        if let Some(command) = motion {
            self.commanded_at = now;
            if let Some(motion) = &mut self.arm {
                motion.apply(command.clone());
                self.arm_out.send(&command, motion.position(), self.common.stamp())?;
            }
        }
        if let Some(command) = hand {
            self.hand.note(command);
            self.hand_goal = Some(self.out.grasp(command, self.common.stamp())?);
        }
        match planning {
            Some(PlanCommand::Request(goal)) => self.request(goal)?,
            Some(PlanCommand::Cancel) => {
                self.pending = None;
                self.plans.cancel();
            }
            None => {}
        }
        Ok(())
    }

    fn request(&mut self, goal: PlanGoal) -> rosrust::error::Result<()> {
        let Some(motion) = &self.arm else { return Ok(()) };
        self.requests += 1;
        let request = plan_request(
            self.requests,
            self.world.model(),
            self.world.task().scene(),
            self.world.state(),
            motion.position().clone(),
            goal,
            self.config.seed,
        );
        self.out.request(self.world.model(), &request, self.common.stamp())?;
        self.plans.submit(request);
        self.pending = Some((self.requests, self.common.now().plus_millis(self.config.plan_latency_ms)));
        Ok(())
    }

    /// The hand's action has ended.
    fn hand_done(&mut self, goal: &str) -> rosrust::error::Result<()> {
        if self.hand_goal.as_deref() != Some(goal) {
            return Ok(());
        }
        self.hand_goal = None;
        self.out.success(self.hand.command() == HandCommand::Close)
    }

    fn show(&mut self) -> rosrust::error::Result<()> {
        let view = MethodView {
            method: self.method.name().to_owned(),
            gesture: self.gesture,
            hand: self.hand_view(),
            stop: self.watch.stop().cloned(),
            target: self.method.target(),
            planner: self.method.planner(),
            mode: self.method.mode(),
            goal: self.arm.as_ref().and_then(ArmMotion::goal),
        };
        self.out.show(self.common.stamp(), &view)
    }

    /// Whether the grasp button should open.
    fn is_closed(&self) -> bool {
        matches!(self.hand.state(), HandState::Closed | HandState::Closing)
    }
}
