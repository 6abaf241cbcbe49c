use crate::{
    MotionConfig, TestbedError,
    ports::{EmgSource, GazeTracker},
};
use arrayvec::ArrayVec;
use proact_intent::GazeOffset;
use proact_participants::{Body, Participant, Trunk};
use proact_types::{
    Command, DisplayFrame, GazeSample, Heartbeat, HeartbeatKind, InputSource, Intention, JointVector,
    MAX_HEARTBEATS, ParticipantAnswer, Point, Pose, SimTime, TickInput, TrunkPosture, Vector, joints,
};

/// Ticks from one tracked shoulder pose to the next: 100 Hz, as motion capture gives.
const TRACKING_TICKS: u64 = 10;
/// The same in seconds.
const TRACKING_SECS: f64 = 0.01;
/// Who acts, and what measures it.
#[derive(Default)]
pub struct PersonParts {
    /// The simulated participant; none when a person drives.
    pub participant: Option<Box<dyn Participant>>,
    /// The armband; none when gestures are given directly.
    pub emg: Option<Box<dyn EmgSource>>,
    /// The eye tracker of the simulated participant; a person's gaze is handed in.
    pub gaze: Option<Box<dyn GazeTracker>>,
}

/// Somebody before the testbed, simulated or live: from what is seen, or brought by devices, to the inputs of a tick.
///
/// Deterministic with a simulated participant. What a live one does between two ticks becomes input of the next.
pub struct PersonStage {
    parts: PersonParts,
    trunk: Trunk,
    intention: Intention,
    last_gaze: Option<GazeSample>,
    /// What was heard since the last tick.
    heartbeats: ArrayVec<Heartbeat, MAX_HEARTBEATS>,
    /// Why the participant gives nothing, and news of it since the last tick.
    fault: Option<String>,
    participant_news: Option<ParticipantAnswer>,
    /// As the trackers sent them last: shoulder and limb.
    last_tracked: (Option<Pose>, Option<JointVector>),
    gaze_offset: GazeOffset,
    last_command: Option<Command>,
    /// `world_from_head` of a headset, while there is one.
    headset: Option<Pose>,
    /// A tracker's pose of the shoulder that no tick has had yet.
    tracked_shoulder: Option<Pose>,
    /// Where the person's own limb is, on its way to where it is asked to go.
    limb: Option<JointVector>,
    arm_count: usize,
    motion: MotionConfig,
}

/// What the person's part needs to know of the testbed.
#[derive(Clone, Copy, Debug)]
pub struct PersonInput<'a> {
    /// Angles of the arm joints after the tick before, rad: where the limb is when its tracking begins.
    pub arm: &'a [f64],
    /// The gesture in force after the tick before.
    pub command: Command,
}

impl PersonStage {
    /// Somebody with `body`, before an arm of `arm_count` joints that follows as `motion` says.
    pub fn new(parts: PersonParts, body: Body, motion: MotionConfig, arm_count: usize) -> Self {
        Self {
            parts,
            trunk: Trunk::new(body),
            intention: Intention {
                gesture: Command::NoMotion,
                gaze_direction: Vector::x(),
                eyes_open: true,
                trunk: TrunkPosture::default(),
                limb: None,
            },
            last_gaze: None,
            heartbeats: ArrayVec::new(),
            fault: None,
            participant_news: None,
            last_tracked: (None, None),
            gaze_offset: GazeOffset::default(),
            last_command: None,
            headset: None,
            tracked_shoulder: None,
            limb: None,
            arm_count,
            motion,
        }
    }

    /// A live person makes a gesture, from the next tick on.
    pub fn set_command(&mut self, command: Command) {
        self.intention.gesture = command;
    }

    /// A live person makes a gesture by way of `source`, whose silence or end stops the arm from now on. In a trial
    /// with an armband this is a prompt, and nothing is stopped by it.
    pub fn set_command_from(&mut self, source: InputSource, command: Command) {
        self.set_command(command);
        self.push_heartbeat(source, HeartbeatKind::Command);
    }

    /// `source` said something, if only that it is there.
    pub fn record_heartbeat(&mut self, source: InputSource) {
        self.push_heartbeat(source, HeartbeatKind::Alive);
    }

    /// `source` said something over a line whose delay is over the limit: what it holds moves nothing.
    pub fn record_delayed_heartbeat(&mut self, source: InputSource) {
        self.push_heartbeat(source, HeartbeatKind::Delayed);
    }

    /// `source` held a gesture and was silent for so long that its server let it go: the arm stops until it says something and the
    /// hand was relaxed.
    pub fn record_silence(&mut self, source: InputSource) {
        self.push_heartbeat(source, HeartbeatKind::Silent);
    }

    /// `source` ended its connection: a gesture that it held is released, and if one is in force the arm stops.
    pub fn record_closed_connection(&mut self, source: InputSource) {
        self.set_command(Command::NoMotion);
        self.push_heartbeat(source, HeartbeatKind::Closed);
    }

    fn push_heartbeat(&mut self, source: InputSource, kind: HeartbeatKind) {
        let heartbeat = Heartbeat { source, kind };
        // Each is said once a tick; of more than fit, what was said first is known.
        if !self.heartbeats.contains(&heartbeat) {
            let _ = self.heartbeats.try_push(heartbeat);
        }
    }

    /// A live person looks somewhere, as an eye tracker measured it: rays that repeat to the bit are those of a frozen
    /// one. A measurement of the same tick that came before is dropped.
    pub fn set_gaze(&mut self, gaze: GazeSample) {
        self.last_gaze = Some(self.gaze_offset.correct(gaze));
        // What was said of an earlier ray is not true of this one.
        self.heartbeats.retain(|heartbeat| {
            heartbeat.kind != HeartbeatKind::PointingDevice && (heartbeat.source != InputSource::EyeTracker)
        });
    }

    /// [`PersonStage::set_gaze`] with a ray that the tracker sent before, bit for bit, before it was turned into `world`.
    pub fn set_repeated_gaze(&mut self, gaze: GazeSample) {
        self.set_gaze(gaze);
        self.push_heartbeat(InputSource::EyeTracker, HeartbeatKind::Repeated);
    }

    /// A live person looks somewhere by a mouse or a stick, which may rest. Otherwise as [`PersonStage::set_gaze`].
    pub fn set_pointer_gaze(&mut self, gaze: GazeSample) {
        self.set_gaze(gaze);
        self.push_heartbeat(InputSource::Page, HeartbeatKind::PointingDevice);
    }

    /// The error of a live person's gaze source, from the next measurement on. The record holds gaze without it.
    pub fn set_gaze_offset(&mut self, offset: GazeOffset) {
        self.gaze_offset = offset;
    }

    /// A live person asks the trunk to go somewhere.
    pub fn set_trunk_target(&mut self, posture: TrunkPosture) {
        self.intention.trunk = posture;
    }

    /// A headset is at `world_from_head` from now on: the display shows that head instead of the trunk's. Gaze and
    /// shoulder are not moved by it.
    pub fn track_head(&mut self, world_from_head: Pose) {
        self.headset = Some(world_from_head);
    }

    /// A tracker saw a live person's shoulder: `world_from_shoulder`, from now on instead of the body model's.
    pub fn track_shoulder(&mut self, world_from_shoulder: Pose) {
        self.tracked_shoulder = Some(world_from_shoulder);
        let repeats = self.last_tracked.0.replace(world_from_shoulder) == Some(world_from_shoulder);
        self.push_heartbeat(
            InputSource::ShoulderTracker,
            if repeats { HeartbeatKind::Repeated } else { HeartbeatKind::Fresh },
        );
    }

    /// [`PersonStage::track_shoulder`] with a pose that the tracker sent before, bit for bit, before it was turned into
    /// `world`.
    pub fn track_repeated_shoulder(&mut self, world_from_shoulder: Pose) {
        self.tracked_shoulder = Some(world_from_shoulder);
        self.last_tracked.0 = Some(world_from_shoulder);
        self.push_heartbeat(InputSource::ShoulderTracker, HeartbeatKind::Repeated);
    }

    /// A tracker saw a live person's own limb: its angles in the joints of the arm, rad.
    ///
    /// # Errors
    /// [`TestbedError::Limb`] for another number of angles than the arm has joints, or one that is not finite.
    pub fn track_limb(&mut self, angles: &[f64]) -> Result<(), TestbedError> {
        let count = self.arm_count;
        if angles.len() != count || !angles.iter().all(|angle| angle.is_finite()) {
            return Err(TestbedError::Limb { got: angles.to_vec(), expected: count });
        }
        let repeats = self.last_tracked.1.as_deref() == Some(angles);
        self.last_tracked.1 = Some(joints(angles));
        self.push_heartbeat(
            InputSource::LimbTracker,
            if repeats { HeartbeatKind::Repeated } else { HeartbeatKind::Fresh },
        );
        self.intention.limb = Some(joints(angles));
        Ok(())
    }

    /// One step of the limb on its way, from `arm` where it has not been tracked yet.
    fn move_limb(&mut self, arm: &[f64]) -> Option<JointVector> {
        let requested = self.intention.limb.as_ref()?;
        let furthest = self.motion.limb_rad_per_s * TRACKING_SECS;
        let limb = self.limb.get_or_insert_with(|| joints(&arm[..requested.len()]));
        for (angle, requested) in limb.iter_mut().zip(requested) {
            *angle += (requested - *angle).clamp(-furthest, furthest);
        }
        Some(limb.clone())
    }

    /// `world_from_head` as a headset tracked it last; none before it did.
    pub fn headset_pose(&self) -> Option<Pose> {
        self.headset
    }

    /// The pose of the head now: `world_from_head`.
    pub fn head_pose(&self) -> Pose {
        if let Some(pose) = self.headset {
            return pose;
        }
        self.trunk.body().head_pose(&self.trunk.posture())
    }

    /// The gesture that a simulated participant makes now; none when a person drives, whose muscles nobody asks.
    pub fn intended_command(&self) -> Option<Command> {
        self.parts.participant.as_ref().map(|_| self.intention.gesture)
    }

    /// How long the oldest EMG sample of the last tick had waited for it; see [`EmgSource::oldest_sample_wait`].
    pub fn oldest_sample_wait(&self) -> Option<std::time::Duration> {
        self.parts.emg.as_ref()?.oldest_sample_wait()
    }

    /// What enters the testbed in tick `now`.
    pub fn step(&mut self, now: SimTime, input: PersonInput<'_>) -> TickInput {
        self.trunk.step(now, self.intention.trunk);
        let head = self.head_pose();
        let eye = Point::from(head.translation.vector);

        let mut heartbeats = std::mem::take(&mut self.heartbeats);
        // Who lets go of nothing need not stop the arm. Gestures before an armband are prompts: who gives them does not
        // move the arm.
        let (idle, prompts) = (input.command == Command::NoMotion, self.parts.emg.is_some());
        heartbeats.retain(|sign| match sign.kind {
            HeartbeatKind::Closed => !idle && !prompts,
            HeartbeatKind::Command => !prompts,
            _ => true,
        });
        let (gaze, participant) = (self.last_gaze.take(), self.participant_news.take());
        let mut tick = TickInput { gaze, heartbeats, participant, ..TickInput::default() };
        match &mut self.parts.emg {
            Some(emg) => tick.emg = emg.sample_at(now, self.intention.gesture),
            None if self.last_command != Some(self.intention.gesture) => {
                tick.command = Some(self.intention.gesture);
                self.last_command = tick.command;
            }
            None => {}
        }
        if let Some(tracker) = &mut self.parts.gaze {
            let Intention { gaze_direction, eyes_open, .. } = &self.intention;
            tick.gaze = tracker.sample_at(now, &eye, gaze_direction, *eyes_open);
        }
        // A real tracker's poses go on as they come.
        tick.shoulder = self.tracked_shoulder.take();
        if now.0.is_multiple_of(TRACKING_TICKS) {
            if self.last_tracked.0.is_none() {
                tick.shoulder = Some(self.trunk.body().shoulder_pose(&self.trunk.posture()));
            }
            tick.limb = self.move_limb(input.arm);
        }
        tick
    }

    /// A simulated participant looks at `frame`, and acts from the next tick on.
    pub fn show_frame(&mut self, frame: &DisplayFrame) {
        if let Some(participant) = &mut self.parts.participant {
            self.intention = participant.step(frame);
            let fault = participant.fault();
            if fault != self.fault.as_deref() {
                self.fault = fault.map(str::to_owned);
                self.participant_news = Some(self.fault.clone().map_or(Ok(()), Err));
            }
        }
    }
}
