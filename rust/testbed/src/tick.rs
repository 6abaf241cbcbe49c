use crate::{
    ConfigError, Digest, Field, Grasp, MethodName, SpanDigest, TrialConfig,
    motion::{ArmMotion, BaseMotion, HandMotion},
    outside::Tap,
    ports::{PlanService, Plant, PlantError},
    view::GazeFilter,
};
use proact_control::{
    ControlError, ControlInput, ControlMethod, ControlOutput, HandTracker, MotionState, PlanCommand,
    SourceWatch,
    ports::{ArmKinematics, KinematicsError, MethodProcess},
};
use proact_emg::{Classifier, EmgError, EmgOutput, EmgPipeline, StreamEvents};
use proact_intent::Candidates;
use proact_tasks::BoxAndBlocks;
use proact_types::{
    ArmModel, ArmModelError, BlockId, Event, EventKind, Gesture, HandView, InputSource, JointVector,
    MethodAnswer, PlanReply, PlanRequest, Point, SignKind, SimTime, Stop, TickInput,
};
use std::sync::Arc;

/// Ticks from one control step to the next: 100 Hz.
const CONTROL_TICKS: u64 = 10;

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
pub struct Parts {
    /// The arm.
    pub model: Arc<ArmModel>,
    /// Its kinematics, base to tip.
    pub kinematics: Box<dyn ArmKinematics>,
    /// Physics.
    pub plant: Box<dyn Plant>,
    /// Motion plans.
    pub plans: Box<dyn PlanService>,
    /// Trained classifier; none when gestures come from keys.
    pub classifier: Option<Classifier>,
    /// The process that the configuration names for its method; none in a replay.
    pub process: Option<Box<dyn MethodProcess>>,
}

/// What one tick gave.
#[derive(Clone, Debug, Default)]
pub struct TickOutput {
    /// What the planner was asked in this tick.
    pub request: Option<PlanRequest>,
    /// A plan took effect in this tick: it belongs to the input log.
    pub plan: Option<PlanReply>,
    /// What a method in another process answered: it belongs to the input log.
    pub method: Option<MethodAnswer>,
    /// A window of EMG ended, or the stream became stale.
    pub emg: Option<EmgOutput>,
    /// What happened.
    pub events: Vec<Event>,
    /// The digest of a span that this tick closed.
    pub span: Option<SpanDigest>,
    /// The trial is over.
    pub finished: bool,
}

/// The testbed: all stages, wired, advancing one millisecond at a time.
///
/// Deterministic: configuration, classifier and the sequence of [`TickInput`]s decide every bit of what follows,
/// given a plant and a planner that are deterministic themselves. A plan that comes in as input is taken instead
/// of asking the planner; that is how a replay runs.
pub struct Testbed {
    pub(crate) config: TrialConfig,
    pub(crate) parts: Parts,
    pub(crate) task: BoxAndBlocks,
    pub(crate) method: Box<dyn ControlMethod>,
    /// Where the answers of a method in another process pass through.
    tap: Tap,
    /// Angles of the person's own limb as tracked last.
    limb: Option<JointVector>,
    pub(crate) emg: Option<EmgPipeline>,
    pub(crate) gaze: GazeFilter,
    pub(crate) arm: ArmMotion,
    pub(crate) hand: HandMotion,
    pub(crate) base: BaseMotion,
    /// Which sources are alive.
    pub(crate) watch: SourceWatch,
    pub(crate) grasp: Grasp,
    /// Fingers on the block that is held.
    pub(crate) grasped_by: Vec<String>,
    /// Base, arm and hand stand still: the tracked shoulder has jumped.
    pub(crate) paused: bool,
    pub(crate) hand_tracker: HandTracker,
    pub(crate) digest: Digest,
    pub(crate) now: SimTime,
    direct: Option<Gesture>,
    recognised: Gesture,
    pub(crate) confidence: f64,
    pub(crate) effort: f64,
    acted_on: Gesture,
    decided_at: Option<SimTime>,
    tracked_at: Option<SimTime>,
    pub(crate) pending: Option<(u64, SimTime)>,
    pub(crate) requests: u64,
    /// The last gaze was no measurement.
    pub(crate) gaze_unusable: bool,
    pub(crate) unseen: Vec<Event>,
}

impl Testbed {
    /// A testbed at time zero. `plant` must hold the arm at its pose `start` with an open hand, and the blocks
    /// of `BoxAndBlocks::new(config.arrangement)`.
    ///
    /// # Errors
    /// A configuration that does not fit, an arm without the poses `start`, `open` and `closed`.
    pub fn new(config: TrialConfig, mut parts: Parts) -> Result<Self, TestbedError> {
        config.check()?;
        let model = &parts.model;
        let start = model.pose("arm", "start")?;
        let (open, closed) = (model.pose("hand", "open")?, model.pose("hand", "closed")?);
        let emg = match (&config.emg, &parts.classifier) {
            (Some(emg), Some(classifier)) => {
                Some(EmgPipeline::new(emg, classifier.clone())?.with_centring(&config.emg_centring)?)
            }
            _ => None,
        };
        let tap = Tap::new(parts.process.take());
        let gazes = matches!(config.method, MethodName::C | MethodName::D);
        let method = match &config.method_process {
            Some(_) => proact_control::build_outside(tap.clone(), &config.profile, model)?,
            None => proact_control::build(&config.method.to_string(), &config.profile, model)?,
        };
        let task = BoxAndBlocks::new(config.arrangement).with_limit(SimTime::from_secs(config.limit_secs));
        Ok(Self {
            digest: Digest::new(&config.to_toml()?),
            arm: ArmMotion::new(model, start),
            hand: HandMotion::new(open, closed),
            base: BaseMotion::new(config.setup.body.shoulder_pose(&Default::default())),
            watch: SourceWatch::new(config.profile.dead_man, gazes),
            grasp: Grasp::new(config.physics.grasp_rule, model),
            grasped_by: Vec::new(),
            paused: false,
            hand_tracker: HandTracker::new(open),
            gaze: GazeFilter::new(&config)?,
            task,
            method,
            tap,
            limb: None,
            emg,
            now: SimTime(0),
            direct: None,
            recognised: Gesture::NoMotion,
            confidence: 0.0,
            effort: 0.0,
            acted_on: Gesture::NoMotion,
            decided_at: None,
            tracked_at: None,
            pending: None,
            requests: 0,
            gaze_unusable: false,
            unseen: Vec::new(),
            config,
            parts,
        })
    }

    /// Simulated time of the last tick.
    pub fn now(&self) -> SimTime {
        self.now
    }

    /// The configuration.
    pub fn config(&self) -> &TrialConfig {
        &self.config
    }

    /// The arm.
    pub fn model(&self) -> &Arc<ArmModel> {
        &self.parts.model
    }

    /// The task.
    pub fn task(&self) -> &BoxAndBlocks {
        &self.task
    }

    /// The physics.
    pub fn plant(&self) -> &dyn Plant {
        self.parts.plant.as_ref()
    }

    /// The trial's digest up to the last closed span.
    pub fn digest(&self) -> String {
        self.digest.value()
    }

    /// Why the arm must stand still; none while it need not.
    pub fn stop(&self) -> Option<&Stop> {
        self.watch.stop()
    }

    /// Gesture in force.
    pub fn gesture(&self) -> Gesture {
        self.direct.unwrap_or(self.recognised)
    }

    /// Advances by one millisecond. `last` closes the digest's span early: the trial ends with this tick.
    ///
    /// # Errors
    /// [`TestbedError`]; the trial cannot go on then.
    pub fn tick(&mut self, input: &TickInput, last: bool) -> Result<TickOutput, TestbedError> {
        self.now = SimTime(self.now.0 + 1);
        let now = self.now;
        let mut output = TickOutput::default();
        self.check_input(input)?;
        self.digest_input(input);

        // From muscle to gesture.
        if let Some(emg) = &mut self.emg {
            output.emg = emg.step(now, &input.emg);
            let events = *emg.events();
            if events.is_eventful() {
                self.note_stream(&mut output, &events);
            }
        }
        if let Some(decision) = &output.emg {
            self.recognised = decision.gesture;
            self.decided_at = Some(now);
            if !decision.stale {
                self.watch.hear(now, InputSource::Armband, SignKind::Fresh);
            }
            (self.confidence, self.effort) = (decision.confidence, decision.effort);
            let field = &mut self.digest.field(Field::Emg);
            field.word(decision.gesture.index() as u64).numbers(&decision.posterior);
        }
        if input.gesture.is_some() {
            self.direct = input.gesture;
            (self.confidence, self.effort) = (1.0, 1.0);
        }

        // From tracking and gaze to base and intent.
        if let Some(pose) = input.shoulder {
            self.base.track(pose);
            self.tracked_at = Some(now);
        }
        self.base.step();
        if input.limb.is_some() {
            self.limb.clone_from(&input.limb);
        }
        if let Some(gaze) = &input.gaze {
            let gaze = self.usable_gaze(gaze, &mut output);
            self.hear_gaze(&gaze, input);
            self.infer(&gaze);
        }

        // From intent to commands.
        let plan = self.due_plan(input);
        let gesture = self.gesture();
        if gesture != self.acted_on {
            self.note(&mut output, EventKind::GestureChanged { gesture });
        }
        let stops = self.watch_sources(input, gesture, &mut output);
        let message = output.emg.is_some_and(|decision| decision.published);
        if now.0.is_multiple_of(CONTROL_TICKS)
            || gesture != self.acted_on
            || plan.is_some()
            || message
            || stops
        {
            self.acted_on = gesture;
            self.tap.exchange(input.method.clone());
            self.control(gesture, plan.as_ref(), &mut output)?;
            output.method = self.tap.exchange(None);
            if let Some(answer) = &output.method {
                let (Ok(text) | Err(text)) = answer;
                self.digest.field(Field::InputMethod).word(u64::from(answer.is_ok())).text(text);
            }
        }
        output.plan = plan;

        // From commands to the world.
        self.watch_base(&mut output);
        if !self.paused {
            self.arm.step();
            self.hand.step();
        }
        self.move_world()?;
        self.grip(&mut output)?;
        self.judge(&mut output);
        self.unseen.extend(output.events.iter().cloned());
        output.finished = self.task.state().finished;
        output.span = self.digest.end_tick(now, last || output.finished);
        Ok(output)
    }

    fn infer(&mut self, gaze: &proact_types::GazeSample) {
        let state = self.task.state();
        let held = self.parts.plant.state().attached.and_then(|(block, _)| BlockId::ALL.get(block));
        let scene = Candidates {
            centres: self.block_centres(),
            pickable: state.pickable,
            last_released: self
                .config
                .intent
                .last_colour(held.map(|block| block.colour()), state.last_released),
            tip: self.grasp_centre(),
        };
        self.gaze.take(self.now, gaze, &scene);
        let field = &mut self.digest.field(Field::Intent);
        field.numbers(self.gaze.posterior()).vector(&self.gaze.place().coords);
    }

    fn control(
        &mut self,
        gesture: Gesture,
        plan: Option<&PlanReply>,
        output: &mut TickOutput,
    ) -> Result<(), TestbedError> {
        if let Some(plan) = plan {
            self.note(output, EventKind::PlanFinished { request: plan.id, status: plan.status });
        }
        let blocks = self.block_centres();
        let posterior = *self.gaze.posterior();
        let state = self.parts.plant.state();
        let input = ControlInput {
            gesture,
            message: output.emg.filter(|decision| decision.published).map(|decision| decision.gesture),
            measured: &state.position[..self.parts.model.arm_count()],
            commanded: &self.arm.position().clone(),
            highlight: self.gaze.highlight(self.now),
            blocks: &blocks,
            posterior: &posterior,
            place: self.gaze.place(),
            hand: self.hand_view(),
            world_from_base: state.world_from_base,
            plan,
            motion: self.arm.state(),
            targets: &self.task.scene().targets,
            limb: self.limb.as_deref(),
            stop: self.watch.stop(),
            emg_age_ms: self.decided_at.map(|at| self.now.millis_since(at)),
            gaze_age_ms: self.gaze.seen_at().map(|at| self.now.millis_since(at)),
            tracking_age_ms: self.tracked_at.map(|at| self.now.millis_since(at)),
        };
        let ControlOutput { motion, hand, plan, events } =
            self.method.step(self.now, &input, self.parts.kinematics.as_mut());

        let field = &mut self.digest.field(Field::Control);
        field
            .word(u64::from(motion.is_some()))
            .word(hand.map_or(0, |h| h as u64 + 1))
            .word(events.len() as u64);
        if let Some(stop) = self.watch.stop() {
            field.word(stop.source.index() as u64).word(stop.cause as u64);
        }
        for event in events {
            self.note(output, event);
        }
        if let Some(command) = motion {
            self.arm.apply(command);
        }
        if let Some(command) = hand {
            self.hand_tracker.note(command);
            self.hand.apply(command);
        }
        match plan {
            Some(PlanCommand::Request(goal)) => self.request(goal, output)?,
            Some(PlanCommand::Cancel) => {
                self.pending = None;
                self.parts.plans.cancel();
            }
            None => {}
        }
        Ok(())
    }

    /// The task's view of what happened.
    fn judge(&mut self, output: &mut TickOutput) {
        let held = self.hand_view().holds;
        let state = self.parts.plant.state();
        let step = self.task.step(self.now, &state.blocks, held);
        for event in step.events {
            self.note(output, event);
        }
        let task = self.task.state();
        let field = &mut self.digest.field(Field::Task);
        field.word(u64::from(task.on_target)).word(task.next.map_or(9, |b| b.index() as u64));
        field.word(held.map_or(9, |b| b.index() as u64)).word(u64::from(task.finished));
    }

    /// What befell the armband's stream, for the record.
    fn note_stream(&self, output: &mut TickOutput, events: &StreamEvents) {
        let counts = &events.counts;
        if counts.gaps + counts.unusable_samples + counts.rejected_windows > 0 {
            let (gaps, unusable_samples) = (counts.gaps, counts.unusable_samples);
            let rejected_windows = counts.rejected_windows;
            self.note(output, EventKind::EmgGap { gaps, unusable_samples, rejected_windows });
        }
    }

    pub(crate) fn note(&self, output: &mut TickOutput, kind: EventKind) {
        output.events.push(Event { time: self.now, kind });
    }

    pub(crate) fn hand_view(&self) -> HandView {
        let attached = self.parts.plant.state().attached;
        HandView {
            state: self.hand_tracker.state(),
            holds: attached.and_then(|(block, _)| BlockId::ALL.get(block).copied()),
        }
    }

    pub(crate) fn block_centres(&self) -> [Point; 4] {
        let blocks = &self.parts.plant.state().blocks;
        std::array::from_fn(|k| Point::from(blocks[k].pose.translation.vector))
    }

    /// What the arm does now.
    pub fn motion(&self) -> MotionState {
        self.arm.state()
    }
}
