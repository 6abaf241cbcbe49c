use crate::{
    ConfigError, Digest, PinnedContent, ResultFault, SpanDigest, TrialConfig,
    ports::{PlanService, Plant, PlantError},
    stages::{
        ActuationInput, ActuationOutput, ActuationStage, DisplayInput, DisplayStage, EmgStage, EmgStageInput,
        EmgStageOutput, ExternalTargets, FeedbackInput, FeedbackStage, GazeMeasurement, IntentInput,
        IntentOutput, IntentStage, MethodInput, MethodStage, StageName, TaskStage, TaskStageInput,
        WorldInput, WorldStage,
    },
};
use proact_arm::{ArmModel, ArmModelError};
use proact_control::{
    ControlError, MethodRegistry, MotionState,
    ports::{ArmKinematics, KinematicsError, MethodProcess},
};
use proact_emg::{Classifier, DecoderProcess, EmgError, EmgOutput};
use proact_intent::IntentProcess;
use proact_tasks::Task;
use proact_types::{
    Command, CommandMapError, DisplayFrame, Event, EventKind, FeedbackCue, Gesture, HandState, IntentAnswer,
    JointVector, MethodAnswer, MethodInfo, PlanReply, PlanRequest, Pose, SimTime, Stop, TickInput,
    WindowAnswer,
};
use std::sync::Arc;

/// Why a tick could not be taken. The trial is over then; what is recorded up to here stands.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TestbedError {
    /// The configuration does not fit.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The arm lacks something.
    #[error("arm model: {0}")]
    Model(#[from] ArmModelError),
    /// The method refused its profile or the arm.
    #[error("control: {0}")]
    Control(#[from] ControlError),
    /// Gestures and commands that do not go together.
    #[error("profile: {0}")]
    Gestures(#[from] CommandMapError),
    /// The EMG stage refused its set-up.
    #[error("EMG: {0}")]
    Emg(#[from] EmgError),
    /// The physics refused.
    #[error("physics at {:.3} s: {source}", time.as_secs())]
    Plant {
        /// When.
        time: SimTime,
        /// Why.
        source: PlantError,
    },
    /// The kinematics refused.
    #[error("kinematics: {0}")]
    Kinematics(#[from] KinematicsError),
    /// The angles of a tracked limb do not fit the arm.
    #[error("tracked limb is {got:?}, expected {expected} finite angles")]
    Limb {
        /// As tracked, rad.
        got: Vec<f64>,
        /// Joints of the arm.
        expected: usize,
    },
    /// An input is not finite.
    #[error("{what} at {:.3} s is not finite: {value}", time.as_secs())]
    Input {
        /// When.
        time: SimTime,
        /// Such as `tracked limb`.
        what: &'static str,
        /// As text.
        value: String,
    },
}

/// What the testbed is made of.
pub struct TestbedParts {
    /// What the arm is called, and the hash of its folder.
    pub arm: PinnedContent,
    /// The arm.
    pub model: Arc<ArmModel>,
    /// Its kinematics, base to tip.
    pub kinematics: Box<dyn ArmKinematics>,
    /// Physics.
    pub plant: Box<dyn Plant>,
    /// Motion plans.
    pub plans: Box<dyn PlanService>,
    /// The methods among which the configuration names one.
    pub methods: MethodRegistry,
    /// Trained classifier; none when gestures come from keys.
    pub classifier: Option<Classifier>,
    /// The process that the configuration names for its method; none in a replay.
    pub process: Option<Box<dyn MethodProcess>>,
}

/// What one tick gave.
#[derive(Clone, Debug, Default)]
pub struct TickOutput {
    /// What the planner was asked in this tick.
    pub request: Option<Box<PlanRequest>>,
    /// A plan took effect in this tick: it belongs to the input log.
    pub plan: Option<PlanReply>,
    /// What a method in another process answered: it belongs to the input log.
    pub method: Option<MethodAnswer>,
    /// What a process that decodes EMG answered: it belongs to the input log.
    pub decoder: Vec<WindowAnswer>,
    /// What an intent model in another process answered: it belongs to the input log.
    pub intent: Option<IntentAnswer>,
    /// A window of EMG ended, or the stream became stale.
    pub emg: Option<Box<EmgOutput>>,
    /// The command that the EMG stage published.
    pub published_command: Option<Command>,
    /// The method commanded the arm.
    pub arm_commanded: bool,
    /// The method commanded the hand.
    pub hand_commanded: bool,
    /// What happened.
    pub events: Vec<Event>,
    /// What is to be heard and felt.
    pub cues: Vec<FeedbackCue>,
    /// The digest of a span that this tick closed.
    pub span_digest: Option<SpanDigest>,
    /// The trial is over.
    pub finished: bool,
}

/// The testbed: all stages, ticked one after the other, a millisecond at a time.
///
/// Deterministic: configuration, classifier and the sequence of [`TickInput`]s decide every bit of what follows,
/// given a plant and a planner that are deterministic themselves. A plan that comes in as input is taken instead
/// of asking the planner; that is how a replay runs.
pub struct Testbed {
    config: TrialConfig,
    model: Arc<ArmModel>,
    kinematics: Box<dyn ArmKinematics>,
    emg: EmgStage,
    intent: IntentStage,
    method: MethodStage,
    actuation: ActuationStage,
    world: WorldStage,
    task: TaskStage,
    feedback: FeedbackStage,
    display: DisplayStage,
    digest: Digest,
    method_info: MethodInfo,
    now: SimTime,
    /// For the next tick.
    external_targets: ExternalTargets,
    /// What the stages said in the last tick.
    last_outputs: LastOutputs,
}

/// What outlives a tick of the stages' outputs: the next tick, or the display, asks for it.
struct LastOutputs {
    emg: EmgStageOutput,
    intent: IntentOutput,
    actuation: ActuationOutput,
    /// Angles of the fingers on a block that the hand has just taken.
    frozen_fingers: Option<JointVector>,
}

impl Testbed {
    /// A testbed at time zero. `plant` must hold the arm at its pose `start` with an open hand, and the objects
    /// of [`TrialConfig::build_task`].
    ///
    /// # Errors
    /// A configuration that does not fit, another arm or task than it names, an arm without the poses `start`, `open`
    /// and `closed`.
    pub fn new(mut config: TrialConfig, parts: TestbedParts) -> Result<Self, TestbedError> {
        config.check()?;
        let TestbedParts { arm, model, kinematics, plant, plans, methods, classifier, process } = parts;
        config.pin_contents(&arm)?;
        config.check_side(&model)?;
        let method = config.method_entry(&methods)?;
        let task = config.build_task(&model)?;
        let actuation = ActuationStage::new(&config, &model, task.scene())?;
        let last_outputs = LastOutputs {
            emg: EmgStageOutput::default(),
            intent: IntentOutput::default(),
            actuation: actuation.output(),
            frozen_fingers: None,
        };
        Ok(Self {
            emg: EmgStage::new(&config, classifier)?,
            intent: IntentStage::new(&config, method.needs(), model.clone(), task.scene())?,
            method: MethodStage::new(&config, &method, model.clone(), task.scene().clone(), plans, process)?,
            actuation,
            world: WorldStage::new(&config, model.clone(), task.scene(), plant)?,
            task: TaskStage::new(task, model.clone()),
            feedback: FeedbackStage::new(&config, &model),
            display: DisplayStage::new(&config, &model),
            digest: Digest::new(&config.to_toml()?),
            method_info: method.info().clone(),
            now: SimTime(0),
            external_targets: ExternalTargets::default(),
            last_outputs,
            config,
            model,
            kinematics,
        })
    }

    /// The same testbed at time zero, whose digest begins with the configuration's text as a record has it: today's
    /// types may write the same values otherwise.
    pub fn with_recorded_config(mut self, text: &str) -> Self {
        self.digest = Digest::new(text);
        self
    }

    /// The same testbed, whose classifier is that of `decoder`; none in a replay, which takes its answers from the log.
    pub fn with_decoder(mut self, decoder: Option<Box<dyn DecoderProcess>>) -> Self {
        self.emg = self.emg.with_decoder(decoder);
        self
    }

    /// The same testbed, whose intent model is that of `process`; none in a replay, which takes its answers from the log.
    pub fn with_intent(mut self, process: Option<Box<dyn IntentProcess>>) -> Self {
        self.intent = self.intent.with_process(process);
        self
    }

    /// Simulated time of the last tick.
    pub fn now(&self) -> SimTime {
        self.now
    }

    /// The configuration.
    pub fn config(&self) -> &TrialConfig {
        &self.config
    }

    /// What is told of the method.
    pub fn method(&self) -> &MethodInfo {
        &self.method_info
    }

    /// The arm.
    pub fn model(&self) -> &Arc<ArmModel> {
        &self.model
    }

    /// The task.
    pub fn task(&self) -> &dyn Task {
        self.task.task()
    }

    /// Ticks so far in which the physics met the laws of contact inexactly.
    pub fn unsolved_ticks(&self) -> u64 {
        self.world.unsolved_ticks()
    }

    /// The physics.
    pub fn plant(&self) -> &dyn Plant {
        self.world.plant()
    }

    /// The trial's digest up to the last closed span.
    pub fn digest(&self) -> String {
        self.digest.value()
    }

    /// Why the arm must stand still; none while it need not.
    pub fn stop(&self) -> Option<&Stop> {
        self.method.stop()
    }

    /// What is wrong with the trial up to now.
    pub fn faults(&self) -> Vec<ResultFault> {
        self.method.faults()
    }

    /// Gesture in force.
    pub fn command(&self) -> Command {
        self.last_outputs.emg.command
    }

    /// What the EMG stage said in the last tick.
    pub fn emg_output(&self) -> &EmgStageOutput {
        &self.last_outputs.emg
    }

    /// The gestures that the EMG model tells apart, in the order of [`EmgOutput::posterior`]; none without a model.
    pub fn emg_gestures(&self) -> &[Gesture] {
        self.emg.gestures()
    }

    /// Probability of each object after the last valid gaze; all zero where it told nothing.
    pub fn posterior(&self) -> &[f64] {
        &self.last_outputs.intent.posterior
    }

    /// What the arm does now.
    pub fn motion(&self) -> MotionState {
        self.last_outputs.actuation.motion
    }

    /// Angles asked of all moving joints now, rad.
    pub fn targets(&self) -> &JointVector {
        &self.last_outputs.actuation.command.position
    }

    /// The hand has arrived where it was told to go, or holds something.
    pub fn is_hand_settled(&self) -> bool {
        let arrived = !self.last_outputs.actuation.hand_moving
            && matches!(self.world.hand().state, HandState::Open | HandState::Closed);
        self.last_outputs.frozen_fingers.is_some() || arrived
    }

    /// What somebody else's controllers ask for in the next tick. Where the method commands arm or hand in that tick, the
    /// method has them.
    ///
    /// It is no input of the trial: no log holds it. The digest tells a trial that was driven from one that was not, and
    /// nobody replays the former.
    pub fn set_external_targets(&mut self, driven: ExternalTargets) {
        self.external_targets = driven;
    }

    /// Advances by one millisecond. `last` closes the digest's span early: the trial ends with this tick.
    ///
    /// # Errors
    /// [`TestbedError`]; the trial cannot go on then.
    pub fn tick(&mut self, input: &TickInput, last: bool) -> Result<TickOutput, TestbedError> {
        self.tick_with_stage_timing(input, last, &mut |_| ())
    }

    /// [`Testbed::tick`] that says when each stage is done, for whoever has a clock.
    ///
    /// # Errors
    /// As [`Testbed::tick`].
    pub fn tick_with_stage_timing(
        &mut self,
        input: &TickInput,
        last: bool,
        done: &mut dyn FnMut(StageName),
    ) -> Result<TickOutput, TestbedError> {
        self.now = SimTime(self.now.0 + 1);
        let now = self.now;
        self.check_input(input)?;
        self.digest.input(input);
        let mut output = TickOutput::default();
        let mut note = |kinds: Vec<EventKind>| {
            output.events.extend(kinds.into_iter().map(|kind| Event { time: now, kind }));
        };
        let kinematics = self.kinematics.as_mut();

        let samples =
            EmgStageInput { samples: &input.emg, direct_command: input.command, answers: &input.decoder };
        let mut emg_output = self.emg.step(now, samples);
        note(std::mem::take(&mut emg_output.events));
        self.digest.emg(&emg_output);
        done(StageName::Emg);

        let intent_input = IntentInput {
            gaze: GazeMeasurement::from_input(input),
            world: self.world.state(),
            task: self.task.task().state(),
            answer: input.intent.as_ref(),
        };
        let mut intent = self.intent.step(now, intent_input, kinematics);
        note(std::mem::take(&mut intent.events));
        self.digest.intent(&intent);
        done(StageName::Intent);

        let method_input = MethodInput {
            emg: &emg_output,
            intent: &intent,
            actuation: &self.last_outputs.actuation,
            world: self.world.state(),
            hand: self.world.hand(),
            heartbeats: &input.heartbeats,
            participant: input.participant.as_ref(),
            shoulder_tracked: input.shoulder.is_some(),
            limb: input.limb.as_ref(),
            plan: input.plan.as_ref(),
            answer: input.method.clone(),
        };
        let mut method = self.method.step(now, method_input, kinematics);
        note(std::mem::take(&mut method.events));
        self.digest.method(&method, self.method.stop());
        done(StageName::Method);

        let ExternalTargets { mut joints, hand, hold_hand } = std::mem::take(&mut self.external_targets);
        let arm = self.model.arm_count();
        (output.arm_commanded, output.hand_commanded) = (method.motion.is_some(), method.hand.is_some());
        joints.retain(|driven| {
            !(if driven.joint < arm { output.arm_commanded } else { output.hand_commanded })
        });
        let hand = method.hand.or(hand);
        let held = (hold_hand && hand.is_none()).then(|| {
            self.last_outputs.actuation.command.position[arm..].iter().copied().collect::<JointVector>()
        });
        let commanded = ActuationInput {
            shoulder: input.shoulder,
            motion: method.motion,
            hand,
            fingers: method.fingers,
            frozen_fingers: held.as_ref().or(self.last_outputs.frozen_fingers.as_ref()),
            external_targets: &joints,
            world: self.world.state(),
        };
        let mut actuation = self.actuation.step(now, commanded);
        note(std::mem::take(&mut actuation.events));
        self.digest.actuation(&actuation);
        done(StageName::Actuation);

        let moved = WorldInput { command: &actuation.command, hand, hand_moving: actuation.hand_moving };
        let world = self.world.step(now, moved)?;
        note(world.events);
        self.digest.world(self.world.state(), world.carried_object);
        done(StageName::World);

        let task_input = TaskStageInput { world: self.world.state(), held: world.hand.held_object };
        let task = self.task.step(now, task_input);
        note(task.events);
        if self.method.must_end_trial() && !task.state.finished {
            note(vec![EventKind::TrialFinished]);
        }
        self.world.rearrange(&task.placements);
        self.digest.task(&task.state, world.hand.held_object);

        let contacts = &self.world.state().contacts;
        output.cues = self.feedback.step(now, FeedbackInput { events: &output.events, contacts });
        self.display.add_events(&output.events, &output.cues);
        (output.emg, output.published_command) = (emg_output.decision.clone(), emg_output.published_command);
        (output.request, output.plan, output.method) = (method.request, method.plan, method.answer);
        output.decoder.clone_from(&emg_output.answers);
        output.intent = intent.answer.take();
        output.finished = task.state.finished || self.method.must_end_trial();
        output.span_digest = self.digest.end_tick(now, last || output.finished);
        self.last_outputs =
            LastOutputs { emg: emg_output, intent, actuation, frozen_fingers: world.frozen_fingers };
        done(StageName::Task);
        Ok(output)
    }

    /// True if a display frame belongs to this tick: 60 Hz, by accumulation.
    pub fn frame_is_due(&self) -> bool {
        DisplayStage::is_due(self.now)
    }

    /// The instant as drawn; events since the frame before go with it. `world_from_head` comes from whoever
    /// tracks the head.
    ///
    /// # Errors
    /// If the kinematics refuse the arm's angles.
    pub fn frame(&mut self, world_from_head: Pose) -> Result<DisplayFrame, TestbedError> {
        let display_input = DisplayInput {
            emg: &self.last_outputs.emg,
            intent: &self.last_outputs.intent,
            method: self.method.view(),
            actuation: &self.last_outputs.actuation,
            world: self.world.state(),
            hand: self.world.hand(),
            task: self.task.task().state(),
            world_from_head,
        };
        let mut frame = self.display.step(self.now, display_input, self.kinematics.as_mut())?;
        frame.finished |= self.method.must_end_trial();
        Ok(frame)
    }

    fn check_input(&self, input: &TickInput) -> Result<(), TestbedError> {
        let refuse = |what, value: String| Err(TestbedError::Input { time: self.now, what, value });
        if let Some(pose) = &input.shoulder
            && !pose.translation.vector.iter().chain(pose.rotation.coords.iter()).all(|v| v.is_finite())
        {
            return refuse("tracked shoulder pose", format!("{pose}"));
        }
        if let Some(limb) = &input.limb {
            let count = self.model.arm_count();
            if limb.len() != count || !limb.iter().all(|angle| angle.is_finite()) {
                return refuse("tracked limb", format!("{limb:?}, expected {count} finite angles"));
            }
        }
        Ok(())
    }
}
