use super::{ActuationOutput, EmgStageOutput, GazeFreshness, IntentOutput, object_centers};
use crate::{
    ResultFault, ResultFaultKind, TestbedError, TrialConfig,
    plans::{PendingPlan, plan_request},
    ports::PlanService,
    recorder_tap::RecorderTap,
    trial_faults::{ExternalPart, FailedPlans, MissedAnswers, UsefulAnswers},
};
use proact_arm::ArmModel;
use proact_control::{
    ControlInput, ControlMethod, ControlOutput, DeadManProfile, FingerCommand, HandCommand, JointStates,
    JointSubset, MethodDisplay, MethodEntry, MethodFault, MotionCommand, PlanCommand, SourceWatchdog,
    UsedSources,
    ports::{ArmKinematics, MethodProcess},
};
use proact_types::{
    Command, EventKind, HandView, Heartbeat, HeartbeatKind, InputSource, IntentAnswer, JointVector,
    MethodAnswer, MethodStyle, ModeView, ParticipantAnswer, PlanReply, PlanRequest, PlannerView, PlantState,
    Scene, SimTime, Stop, StopCause, TargetView, WindowAnswer,
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
    last_display: MethodDisplay,
    /// Where the answers of a method in another process pass through.
    recorder_tap: RecorderTap,
    source_watchdog: SourceWatchdog,
    external: ExternalMethodState,
    missed_answers: MissedAnswers,
    useful_answers: UsefulAnswers,
    pending_plan: PendingPlan,
    failed_plans: FailedPlans,
    /// Angles of the person's own limb as tracked last.
    tracked_limb: Option<JointVector>,
    /// Arm joints that the person's own limb has: no plan moves them.
    held_joints: Vec<usize>,
    last_command: Command,
    tracked_at: Option<SimTime>,
}

/// What is known of a method in another process.
struct ExternalMethodState {
    /// The method is one.
    is_external: bool,
    /// It has commanded the arm, the hand or the planner.
    has_acted: bool,
    /// Why it failed first.
    first_failure: Option<String>,
    /// The first answer in a row that it has missed.
    missing_since: Option<SimTime>,
    /// Missed answers stop the arm when they last longer than this, ms; none: they only hold it.
    silence_ms: Option<u64>,
}

impl ExternalMethodState {
    /// What the outcome `fault` of the step at `now` is to the watch over all sources. None: nothing new.
    fn record_step(
        &mut self,
        now: SimTime,
        fault: Option<MethodFault>,
    ) -> Option<Option<(StopCause, String)>> {
        let since = self.missing_since.take();
        let found = match fault {
            None => return Some(None),
            Some(MethodFault::Failed(reason)) => {
                (StopCause::UnusableOutput, format!("the method failed: {reason}"))
            }
            Some(MethodFault::TimedOut(reason)) => {
                let since = since.unwrap_or(now);
                self.missing_since = Some(since);
                if self.silence_ms.is_none_or(|limit| now.millis_since(since) < limit) {
                    return None;
                }
                (StopCause::Silent, format!("the method does not answer: {reason}"))
            }
        };
        self.first_failure.get_or_insert_with(|| found.1.clone());
        Some(Some(found))
    }
}

/// What enters the method in one tick.
#[derive(Clone, Debug)]
pub struct MethodInput<'a> {
    /// What the EMG stage says in this tick.
    pub emg: &'a EmgStageOutput,
    /// What the intent stage says in this tick.
    pub intent: &'a IntentOutput,
    /// What was asked of the joints in the tick before.
    pub actuation: &'a ActuationOutput,
    /// The world after the tick before.
    pub world: &'a PlantState,
    /// The hand after the tick before.
    pub hand: HandView,
    /// What was heard of live sources.
    pub heartbeats: &'a [Heartbeat],
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
    pub has_stepped: bool,
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
    pub method_event_count: usize,
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
        let driven = JointSubset::for_style(method.info().style, &config.profile, &model)?;
        let held = (0..model.arm_count()).filter(|joint| !driven.contains(*joint)).collect();
        let is_external = method.program().is_some();
        let uses = UsedSources {
            gaze: method.needs().gaze,
            // A method in another process is given the limb and may use it.
            limb: !driven.is_whole() || is_external || method.info().style == MethodStyle::Imitating,
        };
        let waits = config.wait_for_plans;
        let link_ms = config.profile.dead_man.map(|limits| limits.command_timeout_ms);
        let external = ExternalMethodState {
            is_external,
            has_acted: false,
            first_failure: None,
            missing_since: None,
            // Where each answer is waited for, a missed one has been waited for long enough.
            silence_ms: if waits { Some(0) } else { link_ms },
        };
        Ok(Self {
            digit_of: model.digit_indices(),
            model,
            scene,
            name: method.info().name.clone(),
            method: built,
            held_joints: held,
            last_display: MethodDisplay::default(),
            recorder_tap,
            source_watchdog: SourceWatchdog::new(config.profile.dead_man, uses),
            external,
            missed_answers: MissedAnswers::new(config),
            useful_answers: UsefulAnswers::default(),
            pending_plan: PendingPlan::new(config, plans),
            failed_plans: FailedPlans::new(config.failed_plans_limit),
            tracked_limb: None,
            last_command: Command::NoMotion,
            tracked_at: None,
        })
    }

    /// Why the arm must stand still; none while it need not.
    pub fn stop(&self) -> Option<&Stop> {
        self.source_watchdog.stop()
    }

    /// Ages over which input stops the arm; none: no such limits.
    pub fn dead_man(&self) -> Option<DeadManProfile> {
        self.source_watchdog.limits()
    }

    /// Why another stage gives nothing, where each is a process of its own; none while all speak. It stops the arm from the next tick
    /// on, and a relaxed hand is waited for after it.
    pub fn set_stage_fault(&mut self, fault: Option<(StopCause, String)>) {
        self.source_watchdog.set_stage_fault(fault);
    }

    /// Whether the trial must end because a part in another process does not answer.
    pub(crate) fn must_end_trial(&self) -> bool {
        self.missed_answers.end_reason().is_some()
    }

    /// What is wrong with the trial up to now.
    pub(crate) fn faults(&self) -> Vec<ResultFault> {
        let ExternalMethodState { is_external, has_acted: acted, first_failure: failed, .. } = &self.external;
        let never_acted = *is_external && !*acted;
        let failed_always = failed.as_deref().filter(|_| never_acted);
        let external =
            self.missed_answers.end_reason().or(self.source_watchdog.external_fault()).or(failed_always);
        let fault = |kind, reason: &str| ResultFault { kind, reason: reason.to_owned() };
        let mut faults: Vec<ResultFault> = Vec::new();
        faults.extend(external.map(|reason| fault(ResultFaultKind::ExternalPart, reason)));
        if never_acted {
            let reason = "the method commanded neither the arm nor the hand nor the planner";
            faults.push(fault(ResultFaultKind::NeverActed, reason));
        }
        faults.extend(self.useful_answers.faults());
        faults.extend(self.failed_plans.fault());
        faults
    }

    /// What there is to see.
    pub fn view(&self) -> MethodView {
        MethodView {
            name: self.name.clone(),
            target: self.last_display.target.clone(),
            planner: self.last_display.planner.clone(),
            mode: self.last_display.mode.clone(),
            stop: self.source_watchdog.stop().cloned(),
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
            self.tracked_limb = Some(limb.clone());
        }
        output.plan = self.pending_plan.take_due_plan(now, input.plan);
        let command = input.emg.command;
        if command != self.last_command {
            output.events.push(EventKind::GestureChanged { gesture: command });
        }
        let change = self.watch_sources(now, &input);
        let stops = change.is_some();
        output.events.extend(change);
        output.has_stepped = now.0.is_multiple_of(CONTROL_TICKS)
            || command != self.last_command
            || output.plan.is_some()
            || input.emg.published_command.is_some()
            || stops;
        if output.has_stepped {
            self.last_command = command;
            self.recorder_tap.exchange_answer(input.answer.clone());
            let fault = self.step_method(now, &input, kinematics, &mut output);
            output.answer = self.recorder_tap.exchange_answer(None);
            self.watch_method(now, command, fault, &mut output);
        }
        output
    }

    /// A method in another process that fails stops the arm in the same tick.
    fn watch_method(
        &mut self,
        now: SimTime,
        command: Command,
        fault: Option<MethodFault>,
        output: &mut MethodOutput,
    ) {
        if !self.external.is_external {
            return;
        }
        let missed = output.answer.as_ref().and_then(|answer| match answer {
            MethodAnswer::TimedOut(reason) => Some(reason.as_str()),
            _ => None,
        });
        self.missed_answers.record(ExternalPart::Method, missed);
        if let Some(found) = self.external.record_step(now, fault) {
            let fails = found.is_some();
            self.source_watchdog.set_method_fault(found);
            output.events.extend(fails.then(|| self.source_watchdog.step(now, command)).flatten());
        }
    }

    /// Whether the sources are alive. Some if the arm must stop now, or may go on: the method must know at once.
    fn watch_sources(&mut self, now: SimTime, input: &MethodInput<'_>) -> Option<EventKind> {
        let watch = &mut self.source_watchdog;
        let decides = input.emg.decision.as_ref().is_some_and(|decision| !decision.stale);
        if input.emg.overridden {
            watch.ignore_armband();
        } else if decides {
            watch.record_heartbeat(now, InputSource::Armband, HeartbeatKind::Fresh);
        }
        match input.intent.gaze_freshness {
            Some(GazeFreshness::Fresh) => {
                watch.record_heartbeat(now, InputSource::EyeTracker, HeartbeatKind::Fresh)
            }
            Some(GazeFreshness::Repeated) => {
                watch.record_heartbeat(now, InputSource::EyeTracker, HeartbeatKind::Repeated)
            }
            Some(GazeFreshness::EyeLost) => watch.record_eye_lost(now),
            None => {}
        }
        for heartbeat in input.heartbeats {
            watch.record_heartbeat(now, heartbeat.source, heartbeat.kind);
        }
        watch.set_intent_fault(input.intent.fault.as_deref());
        if let Some(answer) = &input.intent.answer {
            let missed = matches!(answer, IntentAnswer::TimedOut(_)).then(|| answer.text());
            self.missed_answers.record(ExternalPart::IntentModel, missed);
            // A blink tells nothing, as it should.
            if input.intent.gaze_freshness != Some(GazeFreshness::EyeLost) {
                let is_useful =
                    input.intent.fault.is_none() && input.intent.posterior.iter().any(|share| *share > 0.0);
                self.useful_answers.record(ExternalPart::IntentModel, is_useful);
            }
        }
        for answer in &input.emg.answers {
            let missed = match answer {
                WindowAnswer::TimedOut { deadline_ms } => {
                    Some(format!("it has not answered within {deadline_ms} ms"))
                }
                _ => None,
            };
            self.missed_answers.record(ExternalPart::Decoder, missed.as_deref());
            self.useful_answers.record(ExternalPart::Decoder, decides);
        }
        if let Some(answer) = input.participant {
            watch.set_participant_fault(answer);
        }
        watch.set_armband_state(input.emg.fault.clone(), input.emg.armed);
        watch.step(now, input.emg.command)
    }

    /// What joints and digits feel.
    fn joint_states(&self, world: &PlantState) -> JointStates {
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

    fn step_method(
        &mut self,
        now: SimTime,
        input: &MethodInput<'_>,
        kinematics: &mut dyn ArmKinematics,
        output: &mut MethodOutput,
    ) -> Option<MethodFault> {
        if let Some(plan) = &output.plan {
            let reason = (!plan.reason.is_empty()).then(|| plan.reason.clone());
            output.events.push(EventKind::PlanFinished { request: plan.id, status: plan.status, reason });
            output.events.extend(self.failed_plans.record(now, plan));
        }
        let (world, arm) = (input.world, self.model.arm_count());
        let commanded = &input.actuation.command.position[..arm];
        let age = |at: Option<SimTime>| at.map(|at| now.millis_since(at));
        let objects = object_centers(world);
        let felt = self.joint_states(world);
        let seen = ControlInput {
            command: input.emg.command,
            recognized_gesture: input.emg.recognized_gesture,
            effort: input.emg.effort,
            drives: &input.emg.drives,
            published_command: input.emg.published_command,
            measured: &world.position[..arm],
            commanded,
            highlight: input.intent.highlight,
            objects: &objects,
            posterior: &input.intent.posterior,
            place_point: input.intent.place_point,
            hand: input.hand,
            world_from_base: world.world_from_base,
            plan: output.plan.as_ref(),
            motion: input.actuation.motion,
            joint_states: &felt,
            targets: &self.scene.targets,
            limb: self.tracked_limb.as_deref(),
            stop: self.source_watchdog.stop(),
            emg_age_ms: age(input.emg.decided_at),
            gaze_age_ms: age(input.intent.eye_seen_at),
            tracking_age_ms: age(self.tracked_at),
        };
        let ControlOutput { motion, hand, fingers, plan, events, display, fault } =
            self.method.step(now, &seen, kinematics);
        output.method_event_count = events.len();
        output.events.extend(events.into_iter().map(EventKind::from));
        self.last_display = display;
        self.external.has_acted |= motion.as_ref().is_some_and(|motion| *motion != MotionCommand::Hold)
            || hand.is_some()
            || matches!(fingers, Some(FingerCommand::Goto(_)))
            || matches!(plan, Some(PlanCommand::Request(_)));
        // A method in another process that asks for no speed at all has let go, and says so in the words that it has. Those of A and
        // B press on while their gesture lasts.
        let stands = |motion: &MotionCommand| matches!(motion, MotionCommand::Velocity(v) if v.iter().all(|v| *v == 0.0));
        let motion = match motion {
            Some(motion) if self.external.is_external && stands(&motion) => Some(MotionCommand::Hold),
            motion => motion,
        };
        (output.motion, output.hand, output.fingers) = (motion, hand, fingers);
        match plan {
            Some(PlanCommand::Request(goal)) => {
                let id = self.pending_plan.next_id();
                let start = commanded.iter().copied().collect();
                let seed = self.pending_plan.seed();
                let mut request = plan_request(id, &self.model, &self.scene, world, start, goal, seed);
                request.held_joints = self.held_joints.clone();
                self.pending_plan.submit(now, request.clone());
                output.request = Some(Box::new(request));
                output.events.push(EventKind::PlanRequested { request: id });
            }
            Some(PlanCommand::Cancel) => self.pending_plan.cancel(),
            None => {}
        }
        fault
    }
}
