//! `proact node participant`: a simulated person before the other nodes. Sees what they show, and answers with muscles,
//! eyes and trunk.

use super::{
    Graph, NodeError, convert,
    graph::Jobs,
    method::MethodView,
    stage::{self, Common, Stage, Worldly},
};
use crate::{
    frames::WORLD,
    messages::{
        geometry_msgs::{PoseStamped, Vector3Stamped},
        proact_msgs::{EmgSamples, View},
    },
    world::World,
};
use proact_participants::{Participant, Trunk};
use proact_testbed::ports::{EmgSource, GazeTracker};
use proact_types::{
    DisplayFrame, EmgSample, Event, GazeSample, Gesture, Intention, Point, SimTime, TrunkPosture, Vector,
};
use rosrust::Publisher;
use std::ops::RangeInclusive;

/// The node's name, by which its heartbeat is known.
pub(super) const NAME: &str = "proact_participant";
/// Ticks from one tracked shoulder pose to the next: 100 Hz, as motion capture gives.
const TRACKING_TICKS: u64 = 10;

/// Somebody with an armband and an eye tracker.
pub struct Person {
    /// Who sees and acts.
    pub participant: Box<dyn Participant>,
    /// The armband.
    pub emg: Box<dyn EmgSource>,
    /// The eye tracker.
    pub gaze: Box<dyn GazeTracker>,
    /// The body that carries both.
    pub trunk: Trunk,
}

struct ParticipantNode {
    common: Common,
    world: World,
    person: Person,
    intention: Intention,
    seen: Option<MethodView>,
    last_gaze: Option<GazeSample>,
    events: Vec<Event>,
    /// The first tick: armband and eye tracker count from it.
    began: Option<SimTime>,
    emg: Publisher<EmgSamples>,
    gaze: [Publisher<Vector3Stamped>; 2],
    shoulder: Publisher<PoseStamped>,
    head: Publisher<PoseStamped>,
}

/// Runs a simulated person until the graph ends the node.
///
/// # Errors
/// [`NodeError`].
pub fn run_participant(world: World, person: Person) -> Result<(), NodeError> {
    let graph = Graph::join(NAME)?;
    let mut node = ParticipantNode {
        common: Common::new(&graph)?,
        world,
        person,
        intention: Intention {
            gesture: Gesture::NoMotion,
            gaze_direction: Vector::x(),
            eyes_open: true,
            trunk: TrunkPosture::default(),
            limb: None,
        },
        seen: None,
        last_gaze: None,
        events: vec![],
        began: None,
        emg: graph.publish("proact/emg_samples", 20, false)?,
        gaze: [graph.publish("gaze_position", 10, false)?, graph.publish("gaze_direction", 10, false)?],
        shoulder: graph.publish("Shoulderpad_filtered_pose", 1, false)?,
        head: graph.publish("hololens/head", 1, false)?,
    };
    let jobs: Jobs<ParticipantNode> = Jobs::default();
    let _world = stage::listen_to_world(&graph, &jobs)?;
    let _method = graph.listen("proact/method", 1, &jobs, |node: &mut ParticipantNode, m: View| {
        match serde_json::from_str(&m.json) {
            Ok(view) => node.seen = Some(view),
            Err(error) => node.common.faults.refuse("method", &error.to_string()),
        }
    })?;
    stage::run(graph, &jobs, &mut node)
}

impl Stage for ParticipantNode {
    fn common(&mut self) -> &mut Common {
        &mut self.common
    }

    fn ticks(&mut self, ticks: RangeInclusive<u64>) -> rosrust::error::Result<()> {
        let now = self.common.now();
        let noticed = self.world.step(now).into_iter().map(|kind| Event { time: now, kind });
        self.events.extend(noticed);
        if !self.world.is_complete() {
            return Ok(());
        }
        let began = self.began.unwrap_or(now);
        self.began = Some(began);
        let mut samples = Vec::new();
        let frames = |tick: u64| tick * 60 / 1000;
        let mut frame_is_due = false;
        for tick in ticks {
            let time = SimTime(tick);
            let since = SimTime(time.millis_since(began));
            self.person.trunk.step(time, self.intention.trunk);
            samples.extend(self.person.emg.sample_at(since, self.intention.gesture));
            let head = self.person.trunk.body().head_pose(&self.person.trunk.posture());
            let eye = Point::from(head.translation.vector);
            let Intention { gaze_direction, eyes_open, .. } = self.intention;
            if let Some(gaze) = self.person.gaze.sample_at(since, &eye, &gaze_direction, eyes_open) {
                self.last_gaze = Some(gaze);
                self.look(&gaze)?;
            }
            if tick.is_multiple_of(TRACKING_TICKS) {
                self.track()?;
            }
            frame_is_due |= frames(tick) > frames(tick - 1);
        }
        self.flex(&samples)?;
        if frame_is_due && let Some(frame) = self.frame() {
            self.intention = self.person.participant.step(&frame);
        }
        Ok(())
    }
}

impl Worldly for ParticipantNode {
    fn world(&mut self) -> &mut World {
        &mut self.world
    }
}

impl ParticipantNode {
    /// The headset publishes no gaze while it has lost the eye.
    fn look(&self, gaze: &GazeSample) -> rosrust::error::Result<()> {
        if !gaze.valid {
            return Ok(());
        }
        for (publisher, v) in self.gaze.iter().zip([&gaze.origin.coords, &gaze.direction]) {
            let header = convert::header(self.common.stamp(), "");
            publisher.send(Vector3Stamped { header, vector: convert::vector(v) })?;
        }
        Ok(())
    }

    fn track(&self) -> rosrust::error::Result<()> {
        let (body, posture, stamp) =
            (self.person.trunk.body(), self.person.trunk.posture(), self.common.stamp());
        self.shoulder.send(convert::pose_stamped(stamp, WORLD, &body.shoulder_pose(&posture)))?;
        self.head.send(convert::pose_stamped(stamp, WORLD, &body.head_pose(&posture)))
    }

    fn flex(&self, samples: &[EmgSample]) -> rosrust::error::Result<()> {
        let Some(first) = samples.first() else { return Ok(()) };
        self.emg.send(EmgSamples {
            header: convert::header(self.common.stamp(), ""),
            counter: first.counter,
            channels: first.channels.len() as u32,
            data: samples.iter().flat_map(|s| s.channels.iter().copied()).collect(),
        })
    }

    /// What there is to see; none before the method has shown anything.
    fn frame(&mut self) -> Option<DisplayFrame> {
        let method = self.seen.as_ref()?;
        let (state, task) = (self.world.state(), self.world.task());
        let now = self.common.now();
        let events = std::mem::take(&mut self.events);
        Some(DisplayFrame {
            time: now,
            method: method.method.clone(),
            joints: state.position.clone(),
            world_from_base: state.world_from_base,
            world_from_tip: self.world.world_from_tip(),
            world_from_head: self.person.trunk.body().head_pose(&self.person.trunk.posture()),
            blocks: state.blocks.iter().map(|body| body.pose).collect(),
            hand: method.hand,
            gaze: self.last_gaze,
            target: method.target.clone(),
            planner: method.planner.clone(),
            goal: method.goal.clone(),
            mode: method.mode.clone(),
            stop: method.stop.clone(),
            gesture: method.gesture,
            confidence: 1.0,
            effort: 1.0,
            emg_source: "synthetic".to_owned(),
            time_left_secs: (task.limit().as_secs() - now.as_secs()).max(0.0),
            next_block: task.state().next,
            on_target: task.state().on_target,
            finished: task.state().finished,
            events,
        })
    }
}
