use super::{ActuationOutput, EmgStageOutput, GazeHeard, IntentOutput, object_centres};
use crate::{
    ResultFault, ResultFaultKind, TestbedError, TrialConfig,
    outside::RecorderTap,
    plans::{PlanBook, plan_request},
    ports::PlanService,
    trial_faults::{ExternalPart, FailedPlans, MissedAnswers},
};
use proact_arm::ArmModel;
use proact_control::{
    ControlInput, ControlMethod, ControlOutput, FingerCommand, HandCommand, JointStates, JointSubset,
    MethodEntry, MethodFault, MotionCommand, PlanCommand, Shown, SourceWatch, UsedSources,
    ports::{ArmKinematics, MethodProcess},
};
use proact_types::{
    EventKind, Gesture, HandView, InputSign, InputSource, IntentAnswer, JointVector, MethodAnswer,
    MethodStyle, ModeView, ParticipantAnswer, PlanReply, PlanRequest, PlannerView, PlantState, Scene,
    SignKind, SimTime, Stop, StopCause, TargetView, WindowAnswer,
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
    external: ExternalMethod,
    missed: MissedAnswers,
    plans: PlanBook,
    failed_plans: FailedPlans,
    /// Angles of the person's own limb as tracked last.
    limb: Option<JointVector>,
    /// Arm joints that the person's own limb has: no plan moves them.
    held: Vec<usize>,
    acted_on: Gesture,
    tracked_at: Option<SimTime>,
}

/// What is known of a method in another process.
struct ExternalMethod {
    /// The method is one.
    is_external: bool,
    /// It has commanded the arm, the hand or the planner.
    acted: bool,
    /// Why it failed first.
    failed: Option<String>,
    /// The first answer in a row that it has missed.
    missing_since: Option<SimTime>,
    /// Missed answers stop the arm when they last longer than this, ms; none: they only hold it.
    silence_ms: Option<u64>,
}

impl ExternalMethod {
    /// What the outcome `fault` of the step at `now` is to the watch over all sources. None: nothing new.
    fn take(&mut self, now: SimTime, fault: Option<MethodFault>) -> Option<Option<(StopCause, String)>> {
        let since = self.missing_since.take();
        let found = match fault {
            None => return Some(None),
            Some(MethodFault::Failed(reason)) => {
                (StopCause::Undecided, format!("the method failed: {reason}"))
            }
            Some(MethodFault::Missed(reason)) => {
                let since = since.unwrap_or(now);
                self.missing_since = Some(since);
                if self.silence_ms.is_none_or(|limit| now.millis_since(since) < limit) {
                    return None;
                }
                (StopCause::Silent, format!("the method does not answer: {reason}"))
            }
        };
        self.failed.get_or_insert_with(|| found.1.clone());
        Some(Some(found))
    }
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
        let is_external = method.program().is_some();
        let uses = UsedSources {
            gaze: method.needs().gaze,
            // A method in another process is given the limb and may use it.
            limb: !driven.is_whole() || is_external || method.info().style == MethodStyle::Imitating,
        };
        let waits = config.wait_for_plans;
        let link_ms = config.profile.dead_man.map(|limits| limits.link_ms);
        let external = ExternalMethod {
            is_external,
            acted: false,
            failed: None,
            missing_since: None,
            // Where each answer is waited for, a missed one has been waited for long enough.
            silence_ms: if waits { Some(0) } else { link_ms },
        };
        Ok(Self {
            digit_of: model.digit_places(),
            model,
            scene,
            name: method.info().name.clone(),
            method: built,
            held,
            shown: Shown::default(),
            recorder_tap,
            watch: SourceWatch::new(config.profile.dead_man, uses),
            external,
            missed: MissedAnswers::new(config.missed_answers_limit, waits),
            plans: PlanBook::new(config, plans),
            failed_plans: FailedPlans::new(config.failed_plans_limit),
            limb: None,
            acted_on: Gesture::NoMotion,
            tracked_at: None,
        })
    }

    /// Why the arm must stand still; none while it need not.
    pub fn stop(&self) -> Option<&Stop> {
        self.watch.stop()
    }

    /// Whether the trial must end because a part in another process does not answer.
    pub(crate) fn gave_up(&self) -> bool {
        self.missed.over().is_some()
    }

    /// What is wrong with the trial up to now.
    pub(crate) fn faults(&self) -> Vec<ResultFault> {
        let ExternalMethod { is_external, acted, failed, .. } = &self.external;
        let never_acted = *is_external && !*acted;
        let failed_always = failed.as_deref().filter(|_| never_acted);
        let external = self.missed.over().or(self.watch.external_fault()).or(failed_always);
        let fault = |kind, reason: &str| ResultFault { kind, reason: reason.to_owned() };
        let mut faults: Vec<ResultFault> = Vec::new();
        faults.extend(external.map(|reason| fault(ResultFaultKind::ExternalPart, reason)));
        if never_acted {
            let reason = "the method commanded neither the arm nor the hand nor the planner";
            faults.push(fault(ResultFaultKind::NeverActed, reason));
        }
        faults.extend(self.failed_plans.fault());
        faults
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
            let fault = self.control(now, &input, kinematics, &mut output);
            output.answer = self.recorder_tap.exchange(None);
            self.watch_method(now, gesture, fault, &mut output);
        }
        output
    }

    /// A method in another process that fails stops the arm in the same tick.
    fn watch_method(
        &mut self,
        now: SimTime,
        gesture: Gesture,
        fault: Option<MethodFault>,
        output: &mut MethodOutput,
    ) {
        if !self.external.is_external {
            return;
        }
        let missed = output.answer.as_ref().and_then(|answer| match answer {
            MethodAnswer::Missed(reason) => Some(reason.as_str()),
            _ => None,
        });
        self.missed.take(ExternalPart::Method, missed);
        if let Some(found) = self.external.take(now, fault) {
            let fails = found.is_some();
            self.watch.method(found);
            output.events.extend(fails.then(|| self.watch.step(now, gesture)).flatten());
        }
    }

    /// Whether the sources are alive. Some if the arm must stop now, or may go on: the method must know at once.
    fn watch_sources(&mut self, now: SimTime, input: &MethodInput<'_>) -> Option<EventKind> {
        let watch = &mut self.watch;
        let decides = input.gesture.decision.as_ref().is_some_and(|decision| !decision.stale);
        if decides && !input.gesture.overridden {
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
        if let Some(answer) = &input.intent.answer {
            let missed = matches!(answer, IntentAnswer::Missed(_)).then(|| answer.text());
            self.missed.take(ExternalPart::IntentModel, missed);
        }
        for answer in &input.gesture.answers {
            let missed = match answer {
                WindowAnswer::Late { deadline_ms } => {
                    Some(format!("it has not answered within {deadline_ms} ms"))
                }
                _ => None,
            };
            self.missed.take(ExternalPart::Decoder, missed.as_deref());
        }
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
    ) -> Option<MethodFault> {
        if let Some(plan) = &output.plan {
            let reason = (!plan.reason.is_empty()).then(|| plan.reason.clone());
            output.events.push(EventKind::PlanFinished { request: plan.id, status: plan.status, reason });
            output.events.extend(self.failed_plans.take(now, plan));
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
        let ControlOutput { motion, hand, fingers, plan, events, shown, fault } =
            self.method.step(now, &seen, kinematics);
        output.said = events.len();
        output.events.extend(events.into_iter().map(EventKind::from));
        self.shown = shown;
        self.external.acted |= motion.as_ref().is_some_and(|motion| *motion != MotionCommand::Hold)
            || hand.is_some()
            || matches!(fingers, Some(FingerCommand::Goto(_)))
            || matches!(plan, Some(PlanCommand::Request(_)));
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
        fault
    }
}
