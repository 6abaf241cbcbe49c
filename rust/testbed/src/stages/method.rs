use super::{ActuationOutput, EmgStageOutput, GazeHeard, IntentOutput, object_centres};
use crate::{
    TestbedError, TrialConfig,
    outside::RecorderTap,
    plans::{PlanBook, plan_request},
    ports::PlanService,
};
use proact_arm::ArmModel;
use proact_control::{
    ControlInput, ControlMethod, ControlOutput, FingerCommand, HandCommand, JointStates, JointSubset,
    MethodEntry, MotionCommand, PlanCommand, Shown, SourceWatch,
    ports::{ArmKinematics, MethodProcess},
};
use proact_types::{
    EventKind, Gesture, HandView, InputSign, InputSource, JointVector, MethodAnswer, ModeView,
    ParticipantAnswer, PlanReply, PlanRequest, PlannerView, PlantState, Scene, SignKind, SimTime, Stop,
    TargetView,
};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Ticks from one control step to the next: 100 Hz.
const CONTROL_TICKS: u64 = 10;

/// The control method with what stands around it: the watch over all sources, which stops the arm, and the plans
/// that it asked for.
pub struct MethodStage {
    model: Arc<ArmModel>,
    scene: Scene,
    name: String,
    method: Box<dyn ControlMethod>,
    /// Of each link, the place of its digit in the order of the digits' first links.
    digit_of: Vec<Option<usize>>,
    /// What the method's last step gave to be seen.
    shown: Shown,
    /// Where the answers of a method in another process pass through.
    recorder_tap: RecorderTap,
    watch: SourceWatch,
    plans: PlanBook,
    /// Angles of the person's own limb as tracked last.
    limb: Option<JointVector>,
    /// Arm joints that the person's own limb has: no plan moves them.
    held: Vec<usize>,
    acted_on: Gesture,
    tracked_at: Option<SimTime>,
}

/// What enters the method in one tick.
#[derive(Clone, Debug)]
pub struct MethodInput<'a> {
    /// What the EMG stage says in this tick.
    pub gesture: &'a EmgStageOutput,
    /// What the intent stage says in this tick.
    pub intent: &'a IntentOutput,
    /// What was asked of the joints in the tick before.
    pub actuation: &'a ActuationOutput,
    /// The world after the tick before.
    pub world: &'a PlantState,
    /// The hand after the tick before.
    pub hand: HandView,
    /// What was heard of live sources.
    pub signs: &'a [InputSign],
    /// News of a participant in another program.
    pub participant: Option<&'a ParticipantAnswer>,
    /// A tracked shoulder pose came in this tick.
    pub shoulder_tracked: bool,
    /// New tracked angles of the person's own limb, rad.
    pub limb: Option<&'a JointVector>,
    /// A plan that the input log has for this tick.
    pub plan: Option<&'a PlanReply>,
    /// An answer of a method in another process that the input log has for this tick.
    pub answer: Option<MethodAnswer>,
}

/// What the method asks for in one tick.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MethodOutput {
    /// The method took a step; between steps it says nothing.
    pub stepped: bool,
    /// For the arm.
    pub motion: Option<MotionCommand>,
    /// For the hand.
    pub hand: Option<HandCommand>,
    /// For single fingers.
    pub fingers: Option<FingerCommand>,
    /// What the planner is asked.
    pub request: Option<Box<PlanRequest>>,
    /// A plan took effect.
    pub plan: Option<PlanReply>,
    /// What a method in another process answered.
    pub answer: Option<MethodAnswer>,
    /// How many of `events` are the method's own.
    pub said: usize,
    /// What happened.
    pub events: Vec<EventKind>,
}

/// What the method shows.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MethodView {
    /// Its name, such as `D`.
    pub name: String,
    /// Selection marker.
    pub target: TargetView,
    /// Planner and motion.
    pub planner: PlannerView,
    /// Joint or axis of the movement gestures.
    pub mode: Option<ModeView>,
    /// Why the arm must stand still; none while it need not.
    pub stop: Option<Stop>,
}

impl MethodStage {
    /// The stage of a trial by `method` before `scene`. `process` is that of a method in another process; none in a replay.
    ///
    /// # Errors
    /// A profile that the method or the arm refuses.
    pub fn new(
        config: &TrialConfig,
        method: &MethodEntry,
        model: Arc<ArmModel>,
        scene: Scene,
        plans: Box<dyn PlanService>,
        process: Option<Box<dyn MethodProcess>>,
    ) -> Result<Self, TestbedError> {
        let recorder_tap = RecorderTap::new(process);
        let built = method.build(&config.profile, &model, recorder_tap.clone())?;
        let driven = JointSubset::of(method.info().style, &config.profile, &model)?;
        let held = (0..model.arm_count()).filter(|joint| !driven.contains(*joint)).collect();
        Ok(Self {
            digit_of: model.digit_places(),
            model,
            scene,
            name: method.info().name.clone(),
            method: built,
            held,
            shown: Shown::default(),
            recorder_tap,
            watch: SourceWatch::new(config.profile.dead_man, method.needs().gaze),
            plans: PlanBook::new(config, plans),
            limb: None,
            acted_on: Gesture::NoMotion,
            tracked_at: None,
        })
    }

    /// Why the arm must stand still; none while it need not.
    pub fn stop(&self) -> Option<&Stop> {
        self.watch.stop()
    }

    /// What there is to see.
    pub fn view(&self) -> MethodView {
        MethodView {
            name: self.name.clone(),
            target: self.shown.target.clone(),
            planner: self.shown.planner.clone(),
            mode: self.shown.mode.clone(),
            stop: self.watch.stop().cloned(),
        }
    }

    /// One tick. The method itself takes a step a hundred times a second, and in ticks that bring a gesture, a plan, or
    /// the end of a source. `kinematics` is that of the arm, base to tip.
    pub fn step(
        &mut self,
        now: SimTime,
        input: MethodInput<'_>,
        kinematics: &mut dyn ArmKinematics,
    ) -> MethodOutput {
        let mut output = MethodOutput::default();
        if input.shoulder_tracked {
            self.tracked_at = Some(now);
        }
        if let Some(limb) = input.limb {
            self.limb = Some(limb.clone());
        }
        output.plan = self.plans.due(now, input.plan);
        let gesture = input.gesture.gesture;
        if gesture != self.acted_on {
            output.events.push(EventKind::GestureChanged { gesture });
        }
        let change = self.watch_sources(now, &input);
        let stops = change.is_some();
        output.events.extend(change);
        output.stepped = now.0.is_multiple_of(CONTROL_TICKS)
            || gesture != self.acted_on
            || output.plan.is_some()
            || input.gesture.message.is_some()
            || stops;
        if output.stepped {
            self.acted_on = gesture;
            self.recorder_tap.exchange(input.answer.clone());
            self.control(now, &input, kinematics, &mut output);
            output.answer = self.recorder_tap.exchange(None);
        }
        output
    }

    /// Whether the sources are alive. Some if the arm must stop now, or may go on: the method must know at once.
    fn watch_sources(&mut self, now: SimTime, input: &MethodInput<'_>) -> Option<EventKind> {
        let watch = &mut self.watch;
        if input.gesture.decision.as_ref().is_some_and(|decision| !decision.stale) {
            watch.hear(now, InputSource::Armband, SignKind::Fresh);
        }
        match input.intent.heard {
            Some(GazeHeard::Fresh) => watch.hear(now, InputSource::EyeTracker, SignKind::Fresh),
            Some(GazeHeard::Repeated) => watch.hear(now, InputSource::EyeTracker, SignKind::Repeated),
            Some(GazeHeard::Blank) => watch.hear_blank(now),
            None => {}
        }
        for sign in input.signs {
            watch.hear(now, sign.source, sign.kind);
        }
        watch.intent(input.intent.fault.as_deref());
        if let Some(answer) = input.participant {
            watch.participant(answer);
        }
        watch.armband(input.gesture.fault.clone(), input.gesture.armed);
        watch.step(now, input.gesture.gesture)
    }

    /// What joints and digits feel.
    fn felt(&self, world: &PlantState) -> JointStates {
        let digits = self.digit_of.iter().flatten().max().map_or(0, |last| last + 1);
        let mut digit_forces: JointVector = (0..digits).map(|_| 0.0).collect();
        for contact in &world.contacts {
            if let Some(digit) = self.digit_of[contact.link] {
                digit_forces[digit] += contact.force;
            }
        }
        JointStates {
            position: world.position.clone(),
            velocity: world.velocity.clone(),
            effort: world.effort.clone(),
            digit_forces,
        }
    }

    fn control(
        &mut self,
        now: SimTime,
        input: &MethodInput<'_>,
        kinematics: &mut dyn ArmKinematics,
        output: &mut MethodOutput,
    ) {
        if let Some(plan) = &output.plan {
            output.events.push(EventKind::PlanFinished { request: plan.id, status: plan.status });
        }
        let (world, arm) = (input.world, self.model.arm_count());
        let commanded = &input.actuation.command.position[..arm];
        let age = |at: Option<SimTime>| at.map(|at| now.millis_since(at));
        let objects = object_centres(world);
        let felt = self.felt(world);
        let seen = ControlInput {
            gesture: input.gesture.gesture,
            recognised: input.gesture.recognised,
            effort: input.gesture.effort,
            drives: &input.gesture.drives,
            message: input.gesture.message,
            measured: &world.position[..arm],
            commanded,
            highlight: input.intent.highlight,
            objects: &objects,
            posterior: &input.intent.posterior,
            place: input.intent.place,
            hand: input.hand,
            world_from_base: world.world_from_base,
            plan: output.plan.as_ref(),
            motion: input.actuation.motion,
            felt: &felt,
            targets: &self.scene.targets,
            limb: self.limb.as_deref(),
            stop: self.watch.stop(),
            emg_age_ms: age(input.gesture.decided_at),
            gaze_age_ms: age(input.intent.seen_at),
            tracking_age_ms: age(self.tracked_at),
        };
        let ControlOutput { motion, hand, fingers, plan, events, shown } =
            self.method.step(now, &seen, kinematics);
        output.said = events.len();
        output.events.extend(events.into_iter().map(EventKind::from));
        self.shown = shown;
        (output.motion, output.hand, output.fingers) = (motion, hand, fingers);
        match plan {
            Some(PlanCommand::Request(goal)) => {
                let id = self.plans.next_id();
                let start = commanded.iter().copied().collect();
                let seed = self.plans.seed();
                let mut request = plan_request(id, &self.model, &self.scene, world, start, goal, seed);
                request.held = self.held.clone();
                self.plans.ask(now, request.clone());
                output.request = Some(Box::new(request));
                output.events.push(EventKind::PlanRequested { request: id });
            }
            Some(PlanCommand::Cancel) => self.plans.cancel(),
            None => {}
        }
    }
}
