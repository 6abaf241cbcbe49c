use crate::{
    SpanDigest, Testbed, TestbedError, TickOutput,
    ports::{EmgSource, GazeTracker, PlanService},
};
use arrayvec::ArrayVec;
use proact_intent::GazeOffset;
use proact_participants::{Participant, Trunk};
use proact_tasks::{Arrangement, BlockResult};
use proact_types::{
    DisplayFrame, GazeSample, Gesture, InputSign, InputSource, Intention, JointVector, MAX_SIGNS, PlanReply,
    PlanRequest, PlanStatus, Point, Pose, SignKind, SimTime, TickInput, Trajectory, TrunkPosture, Vector,
    joints,
};
use serde::{Deserialize, Serialize};

/// Ticks from one tracked shoulder pose to the next: 100 Hz, as motion capture gives.
const TRACKING_TICKS: u64 = 10;
/// Furthest that a tracked shoulder is followed from one of these to the next: 2 m/s and 6 rad/s, faster than
/// people lean. A tracker that jumps must not hurl the arm through the blocks.
const SHOULDER_STEP: (f64, f64) = (0.02, 0.06);

/// Furthest that a joint of the limb is followed in such a time, rad: 0.5 rad/s, which is the arm's speed too.
const LIMB_STEP: f64 = 0.005;

/// Who and what surrounds the testbed in a trial.
pub struct SessionParts {
    /// The testbed at time zero.
    pub testbed: Testbed,
    /// The simulated participant; none when a person drives.
    pub participant: Option<Box<dyn Participant>>,
    /// The armband; none when gestures are given directly.
    pub emg: Option<Box<dyn EmgSource>>,
    /// The eye tracker of the simulated participant; a person's gaze is handed in.
    pub gaze: Option<Box<dyn GazeTracker>>,
}

/// One tick of a session.
#[derive(Debug)]
pub struct Step {
    /// When.
    pub time: SimTime,
    /// What went in, with the plan that took effect: the entry of the input log.
    pub input: TickInput,
    /// What came out.
    pub output: TickOutput,
    /// The display frame, if one was due.
    pub frame: Option<DisplayFrame>,
}

/// A trial in progress: a person, simulated or live, before the testbed.
///
/// Deterministic with a simulated participant. With a live one, what [`Session::act`] and [`Session::look`] bring
/// is logged as input, so that the trial can be replayed all the same.
pub struct Session {
    parts: SessionParts,
    trunk: Trunk,
    intention: Intention,
    seen: Option<GazeSample>,
    /// What was heard since the last tick.
    signs: ArrayVec<InputSign, MAX_SIGNS>,
    /// As the trackers sent them last: shoulder and limb.
    measured: (Option<Pose>, Option<JointVector>),
    gaze_offset: GazeOffset,
    given: Option<Gesture>,
    /// `world_from_head` of a headset, while there is one.
    headset: Option<Pose>,
    /// Where a tracker has the shoulder, and where it is on its way there.
    tracked_shoulder: Option<(Pose, Pose)>,
    /// Where the person's own limb is, on its way to where it is asked to go.
    limb: Option<JointVector>,
}

impl Session {
    /// A session at time zero.
    pub fn new(parts: SessionParts) -> Self {
        let body = parts.testbed.config().setup.body;
        Self {
            parts,
            trunk: Trunk::new(body),
            intention: Intention {
                gesture: Gesture::NoMotion,
                gaze_direction: Vector::x(),
                eyes_open: true,
                trunk: TrunkPosture::default(),
                limb: None,
            },
            seen: None,
            signs: ArrayVec::new(),
            measured: (None, None),
            gaze_offset: GazeOffset::default(),
            given: None,
            headset: None,
            tracked_shoulder: None,
            limb: None,
        }
    }

    /// The testbed.
    pub fn testbed(&self) -> &Testbed {
        &self.parts.testbed
    }

    /// A live person makes a gesture, from the next tick on.
    pub fn act(&mut self, gesture: Gesture) {
        self.intention.gesture = gesture;
    }

    /// A live person makes a gesture by way of `source`, whose silence or end stops the arm from now on. In a trial
    /// with an armband this is a prompt, and nothing is stopped by it.
    pub fn command(&mut self, source: InputSource, gesture: Gesture) {
        self.act(gesture);
        self.sign(source, SignKind::Commands);
    }

    /// `source` said something, if only that it is there.
    pub fn hear(&mut self, source: InputSource) {
        self.sign(source, SignKind::Alive);
    }

    /// `source` ended its connection: a gesture that it held is released, and if there was one the arm stops.
    pub fn close(&mut self, source: InputSource) {
        self.act(Gesture::NoMotion);
        if self.parts.testbed.gesture() != Gesture::NoMotion {
            self.sign(source, SignKind::Closed);
        }
    }

    fn sign(&mut self, source: InputSource, kind: SignKind) {
        let sign = InputSign { source, kind };
        // Each is said once a tick; of more than fit, what was said first is known.
        if !self.signs.contains(&sign) {
            let _ = self.signs.try_push(sign);
        }
    }

    /// A live person looks somewhere, as an eye tracker measured it: rays that repeat to the bit are those of a frozen
    /// one. A measurement of the same tick that came before is dropped.
    pub fn look(&mut self, gaze: GazeSample) {
        self.seen = Some(self.gaze_offset.correct(gaze));
        // What was said of an earlier ray is not true of this one.
        self.signs.retain(|sign| sign.kind != SignKind::Points && (sign.source != InputSource::EyeTracker));
    }

    /// [`Session::look`] with a ray that the tracker sent before, bit for bit, before it was turned into `world`.
    pub fn look_again(&mut self, gaze: GazeSample) {
        self.look(gaze);
        self.sign(InputSource::EyeTracker, SignKind::Repeated);
    }

    /// A live person looks somewhere by a mouse or a stick, which may rest. Otherwise as [`Session::look`].
    pub fn point(&mut self, gaze: GazeSample) {
        self.look(gaze);
        self.sign(InputSource::Page, SignKind::Points);
    }

    /// The error of a live person's gaze source, from the next measurement on. The record holds gaze without it.
    pub fn set_gaze_offset(&mut self, offset: GazeOffset) {
        self.gaze_offset = offset;
    }

    /// A live person asks the trunk to go somewhere.
    pub fn lean(&mut self, posture: TrunkPosture) {
        self.intention.trunk = posture;
    }

    /// A headset is at `world_from_head` from now on: the display shows that head instead of the trunk's. Gaze and
    /// shoulder are not moved by it.
    pub fn track_head(&mut self, world_from_head: Pose) {
        self.headset = Some(world_from_head);
    }

    /// A tracker saw a live person's shoulder: `world_from_shoulder`, from now on instead of the body model's.
    pub fn track_shoulder(&mut self, world_from_shoulder: Pose) {
        let now = self.shoulder();
        self.tracked_shoulder = Some((world_from_shoulder, now));
        let repeats = self.measured.0.replace(world_from_shoulder) == Some(world_from_shoulder);
        self.sign(InputSource::ShoulderTracker, if repeats { SignKind::Repeated } else { SignKind::Fresh });
    }

    /// A tracker saw a live person's own limb: its angles in the joints of the arm, rad.
    ///
    /// # Errors
    /// [`TestbedError::Input`] for another number of angles than the arm has joints, or one that is not finite.
    pub fn track_limb(&mut self, angles: &[f64]) -> Result<(), TestbedError> {
        let testbed = &self.parts.testbed;
        let count = testbed.model().arm_count();
        if angles.len() != count || !angles.iter().all(|angle| angle.is_finite()) {
            let value = format!("{angles:?}, expected {count} finite angles");
            return Err(TestbedError::Input { time: testbed.now(), what: "tracked limb", value });
        }
        let repeats = self.measured.1.as_deref() == Some(angles);
        self.measured.1 = Some(joints(angles));
        self.sign(InputSource::LimbTracker, if repeats { SignKind::Repeated } else { SignKind::Fresh });
        self.intention.limb = Some(joints(angles));
        Ok(())
    }

    /// One step of the limb on its way.
    fn move_limb(&mut self) -> Option<JointVector> {
        let asked = self.intention.limb.as_ref()?;
        let state = self.parts.testbed.plant().state();
        let limb = self.limb.get_or_insert_with(|| joints(&state.position[..asked.len()]));
        for (angle, asked) in limb.iter_mut().zip(asked) {
            *angle += (asked - *angle).clamp(-LIMB_STEP, LIMB_STEP);
        }
        Some(limb.clone())
    }

    fn shoulder(&self) -> Pose {
        match self.tracked_shoulder {
            Some((_, now)) => now,
            None => self.trunk.body().shoulder_pose(&self.trunk.posture()),
        }
    }

    /// The pose of the head now: `world_from_head`.
    pub fn head(&self) -> Pose {
        if let Some(pose) = self.headset {
            return pose;
        }
        self.trunk.body().head_pose(&self.trunk.posture())
    }

    /// Advances by one tick. `last` ends the trial with it.
    ///
    /// # Errors
    /// [`TestbedError`]; the trial is over then.
    pub fn step(&mut self, last: bool) -> Result<Step, TestbedError> {
        let time = SimTime(self.parts.testbed.now().0 + 1);
        self.trunk.step(time, self.intention.trunk);
        let head = self.head();
        let eye = Point::from(head.translation.vector);

        let signs = std::mem::take(&mut self.signs);
        let mut input = TickInput { gaze: self.seen.take(), signs, ..TickInput::default() };
        if self.parts.emg.is_some() {
            // Gestures are prompts then: who gives them does not move the arm.
            input.signs.retain(|sign| !matches!(sign.kind, SignKind::Commands | SignKind::Closed));
        }
        match &mut self.parts.emg {
            Some(emg) => input.emg = emg.sample_at(time, self.intention.gesture),
            None if self.given != Some(self.intention.gesture) => {
                input.gesture = Some(self.intention.gesture);
                self.given = input.gesture;
            }
            None => {}
        }
        if let Some(tracker) = &mut self.parts.gaze {
            let Intention { gaze_direction, eyes_open, .. } = &self.intention;
            input.gaze = tracker.sample_at(time, &eye, gaze_direction, *eyes_open);
        }
        if time.0.is_multiple_of(TRACKING_TICKS) {
            if let Some((asked, now)) = &mut self.tracked_shoulder {
                *now = toward(now, asked);
            }
            input.shoulder = Some(self.shoulder());
            input.limb = self.move_limb();
        }

        let output = self.parts.testbed.tick(&input, last)?;
        input.plan = output.plan.clone();
        input.method = output.method.clone();
        let mut frame = None;
        if self.parts.testbed.frame_is_due() || output.finished {
            let drawn = self.parts.testbed.frame(head)?;
            if let Some(participant) = &mut self.parts.participant {
                self.intention = participant.step(&drawn);
            }
            frame = Some(drawn);
        }
        Ok(Step { time, input, output, frame })
    }

    /// The result as of now; the caller adds wall time and the place on disk.
    pub fn result(&self) -> TrialResult {
        let testbed = &self.parts.testbed;
        let config = testbed.config();
        let outcomes = testbed.task().results(&testbed.plant().state().blocks);
        TrialResult {
            method: config.method_label(),
            seed: config.seed,
            setup: config.setup.name.clone(),
            arrangement: config.arrangement,
            on_target: testbed.task().state().on_target,
            outcomes,
            sim_seconds: testbed.now().as_secs(),
            wall_seconds: 0.0,
            real_time_factor: 0.0,
            digest: testbed.digest(),
            trial_dir: None,
            gesture_source: config.gesture_source.clone(),
        }
    }
}

/// One step of a tracked shoulder on its way.
fn toward(now: &Pose, asked: &Pose) -> Pose {
    let way = (asked.translation.vector - now.translation.vector).norm();
    let turn = now.rotation.angle_to(&asked.rotation);
    let share = (SHOULDER_STEP.0 / way.max(1e-12)).min(SHOULDER_STEP.1 / turn.max(1e-12)).min(1.0);
    // Between opposite attitudes there is no shortest way; the tracker will not stay there.
    now.try_lerp_slerp(asked, share, 1e-9).unwrap_or(*now)
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
    /// Where red 1, red 2, blue 1, blue 2 stood at the start.
    pub arrangement: Arrangement,
    /// Blocks on target, 0 to 4.
    pub on_target: u32,
    /// One entry per block in the prescribed order.
    pub outcomes: Vec<BlockResult>,
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
        spans.extend(output.span);
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
        PlanReply {
            id,
            status: PlanStatus::Invalid,
            trajectory: Trajectory::default(),
            reason: "the log holds no such plan".to_owned(),
        }
    }

    fn cancel(&mut self) {}
}
