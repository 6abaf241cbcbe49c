use crate::{
    ResultFault, ResultFaultKind, SpanDigest, Testbed, TestbedError, TickOutput,
    impairment::Impairments,
    ports::PlanService,
    stages::{ExternalTargets, PersonInput, PersonParts, PersonStage, StageName},
};
use proact_arm::Side;
use proact_tasks::TaskResult;
use proact_types::{DisplayFrame, PlanReply, PlanRequest, PlanStatus, Pose, SimTime, TickInput};
use serde::{Deserialize, Deserializer, Serialize, de::Error};
use serde_json::{Map, Value};

/// One tick of a session.
#[derive(Debug)]
pub struct TrialStep {
    /// When.
    pub time: SimTime,
    /// What went in, with the plan that took effect: the entry of the input log.
    pub input: Box<TickInput>,
    /// What came out.
    pub output: TickOutput,
    /// The display frame, if one was due.
    pub frame: Option<Box<DisplayFrame>>,
}

/// A trial in progress: a person, simulated or live, before the testbed.
///
/// Deterministic with a simulated participant. With a live one, what [`RunningTrial::person_stage_mut`] is told is logged as input, so
/// that the trial can be replayed all the same.
pub struct RunningTrial {
    testbed: Testbed,
    person: PersonStage,
    impairments: Impairments,
}

impl RunningTrial {
    /// A session at time zero.
    pub fn new(testbed: Testbed, person: PersonParts) -> Self {
        let crate::TrialConfig { setup, motion, impairments, seed, .. } = testbed.config();
        let impairments = Impairments::new(impairments, *seed);
        let person = PersonStage::new(person, setup.body, *motion, testbed.model().arm_count());
        Self { testbed, person, impairments }
    }

    /// The testbed.
    pub fn testbed(&self) -> &Testbed {
        &self.testbed
    }

    /// Who acts: a live person's devices hand in here what they bring.
    pub fn person_stage_mut(&mut self) -> &mut PersonStage {
        &mut self.person
    }

    /// Who acts, to be asked only.
    pub fn person_stage(&self) -> &PersonStage {
        &self.person
    }

    /// The pose of the head now: `world_from_head`.
    pub fn head_pose(&self) -> Pose {
        self.person.head_pose()
    }

    /// `world_from_head` as a headset tracked it last; none before it did.
    pub fn headset_pose(&self) -> Option<Pose> {
        self.person.headset_pose()
    }

    /// What somebody else's controllers ask for in the next tick; see [`Testbed::drive`].
    pub fn set_external_targets(&mut self, driven: ExternalTargets) {
        self.testbed.set_external_targets(driven);
    }

    /// Advances by one tick. `last` ends the trial with it.
    ///
    /// # Errors
    /// [`TestbedError`]; the trial is over then.
    pub fn step(&mut self, last: bool) -> Result<TrialStep, TestbedError> {
        self.step_with_stage_timing(last, &mut |_| ())
    }

    /// [`RunningTrial::step`] that says when each stage is done, for whoever has a clock.
    ///
    /// # Errors
    /// As [`RunningTrial::step`].
    pub fn step_with_stage_timing(
        &mut self,
        last: bool,
        done: &mut dyn FnMut(StageName),
    ) -> Result<TrialStep, TestbedError> {
        let testbed = &mut self.testbed;
        let time = SimTime(testbed.now().0 + 1);
        let arm = &testbed.plant().state().position[..testbed.model().arm_count()];
        let mut input = Box::new(self.person.step(time, PersonInput { arm, command: testbed.command() }));
        if !testbed.config().gaze {
            input.gaze = None;
        }
        self.impairments.apply(time, &mut input);
        let output = testbed.tick_with_stage_timing(&input, last, done)?;
        input.plan.clone_from(&output.plan);
        input.method.clone_from(&output.method);
        input.decoder.clone_from(&output.decoder);
        input.intent.clone_from(&output.intent);
        let due = testbed.frame_is_due() || output.finished;
        let drawn = due.then(|| testbed.frame(self.person.head_pose())).transpose()?.map(Box::new);
        let frame = self.impairments.display_frame(time, drawn, output.finished);
        if let Some(frame) = &frame {
            self.person.show_frame(frame);
        }
        Ok(TrialStep { time, input, output, frame })
    }

    /// The result as of now; the caller adds wall time and the place on disk.
    pub fn result(&self) -> TrialResult {
        TrialResult::from_testbed(&self.testbed)
    }
}

/// What ended a trial.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TrialEnd {
    /// The task: all is done, or time is up.
    Task,
    /// The experimenter.
    Abort,
    /// The wish for another trial.
    Restart,
    /// A signal such as that of Ctrl-C.
    Interrupt,
    /// A part in another process failed and was not back at the end: the score says nothing.
    Failed,
}

/// What is known of a trial when it is over.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrialResult {
    /// Control method.
    pub method: String,
    /// Seed.
    pub seed: u64,
    /// Set-up.
    pub setup: String,
    /// The task.
    pub task: String,
    /// The arm.
    pub arm: String,
    /// BLAKE3 of the arm, 64 hexadecimal digits.
    pub arm_hash: String,
    /// What counts in the task.
    pub score: f64,
    /// What the score is, such as `blocks on target`.
    pub score_name: String,
    /// What the task counts, by name.
    #[serde(deserialize_with = "checked_task_result")]
    pub result: Map<String, Value>,
    /// Keys of its own that a task puts beside these: `arrangement`, `on_target`, `outcomes` of the modified test.
    #[serde(flatten, deserialize_with = "checked_legacy_fields")]
    #[serde(rename = "beside")]
    pub legacy_fields: Map<String, Value>,
    /// The result for a reader.
    #[serde(skip)]
    pub lines: Vec<String>,
    /// Length of the trial, simulated seconds.
    pub sim_seconds: f64,
    /// Length of the computation, seconds.
    pub wall_seconds: f64,
    /// The ratio of the two.
    pub real_time_factor: f64,
    /// Digest of the trial.
    pub digest: String,
    /// Where it is recorded; none if it is not.
    pub trial_dir: Option<String>,
    /// Where the gestures came from: `recording`, `synthetic`, `keys`.
    pub gesture_source: String,
    /// What ended it.
    pub ended: TrialEnd,
    /// Ticks in which the physics met the laws of contact inexactly; the event `contacts_unsolved` says when.
    #[serde(default)]
    pub unsolved_ticks: u64,
    /// What is wrong with the trial; empty in records made before such faults were noted.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub trial_faults: Vec<ResultFault>,
}

impl TrialResult {
    /// The result of a trial as of now; the caller adds wall time and the place on disk.
    pub fn from_testbed(testbed: &Testbed) -> Self {
        let config = testbed.config();
        let TaskResult { score, mut result, legacy_fields: beside, mut lines } =
            testbed.task().result(&testbed.plant().state().objects);
        let user_profile = config.user_profile.unwrap_or_default();
        let norms = proact_tasks::norms(&config.task.name, &user_profile, config.setup.side == Side::Left);
        if !norms.is_empty() {
            lines.extend(norms.iter().map(ToString::to_string));
            result.insert("norms".to_owned(), serde_json::json!(norms));
        }
        let trial_faults = testbed.faults();
        let failed = trial_faults.iter().any(|fault| fault.kind == ResultFaultKind::ExternalPart);
        TrialResult {
            method: config.method_label(),
            seed: config.seed,
            setup: config.setup.name.clone(),
            task: config.task.name.clone(),
            arm: config.arm.name.clone(),
            arm_hash: config.arm.hash.clone().unwrap_or_default(),
            score,
            score_name: testbed.task().briefing().score_name.clone(),
            result,
            legacy_fields: beside,
            lines,
            sim_seconds: testbed.now().as_secs(),
            wall_seconds: 0.0,
            real_time_factor: 0.0,
            digest: testbed.digest(),
            trial_dir: None,
            gesture_source: config.gesture_source.clone(),
            ended: match (failed, testbed.task().state().finished) {
                (true, _) => TrialEnd::Failed,
                (false, true) => TrialEnd::Task,
                (false, false) => TrialEnd::Interrupt,
            },
            unsolved_ticks: testbed.unsolved_ticks(),
            trial_faults,
        }
    }

    /// The score for tables and means; none of a trial that the task did not end: it failed or was broken off, and what would have
    /// come of it is not known.
    pub fn counted_score(&self) -> Option<f64> {
        (self.ended == TrialEnd::Task).then_some(self.score)
    }

    /// Whether the trial was broken off: somebody or a signal ended it before the task did.
    pub fn is_aborted(&self) -> bool {
        matches!(self.ended, TrialEnd::Abort | TrialEnd::Restart | TrialEnd::Interrupt)
    }

    /// Which part in another process did nothing in the whole trial, as a sentence; none if each did something.
    pub fn never_acted(&self) -> Option<&str> {
        let idle = self.trial_faults.iter().find(|fault| fault.kind == ResultFaultKind::NeverActed);
        idle.map(|fault| fault.reason.as_str())
    }

    /// Why the trial failed, if it did.
    pub fn failure(&self) -> Option<&str> {
        let external = self.trial_faults.iter().find(|fault| fault.kind == ResultFaultKind::ExternalPart);
        (self.ended == TrialEnd::Failed).then(|| external.map_or("", |fault| fault.reason.as_str()))
    }
}

/// Refuses keys and outcomes that no task writes, so that what was renamed does not vanish from tables.
fn checked_task_result<'de, D: Deserializer<'de>>(from: D) -> Result<Map<String, Value>, D::Error> {
    let result = Map::deserialize(from)?;
    proact_tasks::check_result(&result).map_err(D::Error::custom)?;
    Ok(result)
}

fn checked_legacy_fields<'de, D: Deserializer<'de>>(from: D) -> Result<Map<String, Value>, D::Error> {
    let beside = Map::deserialize(from)?;
    proact_tasks::check_legacy_fields(&beside).map_err(D::Error::custom)?;
    Ok(beside)
}

/// Recomputes a trial from its inputs: the digests of all spans up to tick `last`. `inputs` ascend in time; ticks
/// without an entry had no input.
///
/// # Errors
/// What the testbed refuses, or `E` from reading the log.
pub fn replay<E>(
    testbed: &mut Testbed,
    inputs: impl IntoIterator<Item = Result<(SimTime, TickInput), E>>,
    last: SimTime,
) -> Result<Vec<SpanDigest>, E>
where
    E: From<TestbedError>,
{
    let mut inputs = inputs.into_iter();
    let mut next = inputs.next().transpose()?;
    let mut spans = Vec::new();
    for tick in 1..=last.0 {
        let mut input = TickInput::default();
        while let Some((_, logged)) = next.take_if(|(time, _)| time.0 <= tick) {
            input = logged;
            next = inputs.next().transpose()?;
        }
        let output = testbed.tick(&input, tick == last.0)?;
        spans.extend(output.span_digest);
    }
    Ok(spans)
}

/// The plan service of a replay: plans come in with the inputs, nobody is asked.
#[derive(Clone, Copy, Debug, Default)]
pub struct LoggedPlans;

impl PlanService for LoggedPlans {
    fn submit(&mut self, _request: PlanRequest) {}

    fn poll(&mut self, _id: u64) -> Option<PlanReply> {
        None
    }

    /// A plan that the log should hold and does not: the digest tells where.
    fn wait(&mut self, id: u64) -> PlanReply {
        PlanReply::without_plan(id, PlanStatus::Invalid, "the log holds no such plan")
    }

    fn cancel(&mut self) {}
}
