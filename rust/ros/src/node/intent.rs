//! `proact node intent`: gaze and objects in, the object and the place that are meant out.

use super::{
    Faults, NodeError, RosGraph, convert,
    gaze_topics::{self, GazeTopics, Looks},
    graph::Jobs,
    stage::{self, Common, Stage, Tagged},
    wire::{self, Instant},
};
use crate::{
    frames::WORLD,
    messages::{
        geometry_msgs::Vector3Stamped,
        proact_msgs::{Intent, Person, State},
        std_msgs::{Float64, String as Text},
    },
};
use proact_control::ports::ArmKinematics;
use proact_intent::table_hit;
use proact_messages::original;
use proact_messages::original::relative;
use proact_testbed::{
    Field,
    stages::{GazeMeasurement, IntentInput, IntentOutput, IntentStage},
};
use proact_types::{GazeSample, Point, Scene, SimTime, TickInput, Vector};
use rosrust::Publisher;
use std::sync::Arc;

/// What the intent stage is made of.
pub struct IntentParts {
    /// The stage.
    pub stage: IntentStage,
    /// The arm's kinematics.
    pub kinematics: Box<dyn ArmKinematics>,
    /// Joints of the arm, objects of the scene.
    pub counts: wire::Counts,
    /// The scene.
    pub scene: Scene,
}

struct IntentNode {
    common: Common,
    parts: IntentParts,
    state: Tagged<Instant>,
    /// In lock-step.
    person: Tagged<TickInput>,
    /// In real time: of the newest message.
    person_tick: Option<SimTime>,
    gaze_topics: GazeTopics,
    said: Option<IntentOutput>,
    block_id: Publisher<Text>,
    hit: Publisher<Vector3Stamped>,
    raw_hit: Publisher<Vector3Stamped>,
    gaze_ros: [Publisher<Vector3Stamped>; 2],
    distances: Vec<Publisher<Float64>>,
    intent: Publisher<Intent>,
}

/// Runs the intent stage until the graph ends the node.
///
/// # Errors
/// [`NodeError`].
pub fn run_intent(parts: IntentParts) -> Result<(), NodeError> {
    let graph = RosGraph::join("proact_intent")?;
    let topics = parts.scene.objects.iter().map(|object| original::gaze_distance_topic(&object.name));
    let distances = topics.map(|topic| graph.publish(&topic, 1, false)).collect::<Result<_, _>>()?;
    let mut node = IntentNode {
        common: Common::new(&graph)?,
        parts,
        state: Tagged::default(),
        person: Tagged::default(),
        person_tick: None,
        gaze_topics: GazeTopics::default(),
        said: None,
        block_id: graph.publish(relative::BLOCK_ID, 1, false)?,
        hit: graph.publish(relative::GAZE_HIT, 1, false)?,
        raw_hit: graph.publish(relative::GAZE_HIT_LOGGING, 1, false)?,
        gaze_ros: [
            graph.publish(relative::GAZE_POSITION_ROS, 1, false)?,
            graph.publish(relative::GAZE_DIRECTION_ROS, 1, false)?,
        ],
        distances,
        intent: graph.publish("proact/intent", 100, false)?,
    };
    let jobs: Jobs<IntentNode> = Jobs::default();
    let _state = graph.listen("proact/state", 100, &jobs, |node: &mut IntentNode, message: State| {
        match wire::read_state(&message, node.parts.counts) {
            Ok(instant) => node.hear_state(SimTime(message.tick), instant),
            Err(reason) => node.common.faults.refuse("state", &reason),
        }
    })?;
    let _person = graph.listen_from(
        "proact/person",
        100,
        &jobs,
        |node: &mut IntentNode, message: Person, caller| {
            node.common.prefer(caller);
            match wire::read_person(&message) {
                Ok((input, _)) => node.hear_person(SimTime(message.tick), input),
                Err(reason) => node.common.faults.refuse("person", &reason),
            }
        },
    )?;
    let _gaze = gaze_topics::listen(&graph, &jobs)?;
    stage::run(graph, &jobs, &mut node)
}

impl Looks for IntentNode {
    fn gaze_topics(&mut self) -> &mut GazeTopics {
        &mut self.gaze_topics
    }

    fn faults(&self) -> &Arc<Faults> {
        &self.common.faults
    }

    fn look(&mut self, sample: GazeSample) {
        let (points, again) = (false, false);
        self.infer_now(Some(GazeMeasurement { sample, points, again }));
    }

    fn passes_over(&self, caller: &str) -> bool {
        self.common.is_preferred(caller)
    }
}

impl IntentNode {
    fn hear_state(&mut self, tick: SimTime, instant: Instant) {
        if self.common.lockstep {
            self.hear_tagged(|node| node.state.take(tick, instant));
        } else {
            // A simulator that was started again counts anew.
            self.state = Tagged::default();
            self.state.take(tick, instant);
        }
    }

    fn hear_person(&mut self, tick: SimTime, input: TickInput) {
        if self.common.lockstep {
            self.hear_tagged(|node| node.person.take(tick, input));
            return;
        }
        // After a restart of the master a connection may be there twice, and every message come twice.
        let again = self.person_tick.replace(tick) == Some(tick);
        if let Some(gaze) = GazeMeasurement::of(&input).filter(|_| !again) {
            self.infer_now(Some(gaze));
        }
    }

    fn hear_tagged(&mut self, take: impl FnOnce(&mut Self) -> bool) {
        if !take(self) {
            let done = self.repeat();
            self.common.note("publish", done);
        }
    }

    /// Between two ticks: a gaze acts at once.
    fn infer_now(&mut self, gaze: Option<GazeMeasurement>) {
        let done = self.infer(self.common.now(), gaze);
        self.common.note("publish", done);
    }

    fn infer(&mut self, now: SimTime, gaze: Option<GazeMeasurement>) -> rosrust::error::Result<()> {
        let Some(Instant { world, task, .. }) = self.state.get() else { return Ok(()) };
        let input = IntentInput { gaze, world, task, answer: None };
        let output = self.parts.stage.step(now, input, self.parts.kinematics.as_mut());
        let stamp = self.common.stamp();
        // Before the original's topics, which listeners that know the typed message pass over.
        self.intent.send(wire::intent(now, stamp, &output))?;
        if let Some(sample) = output.gaze.filter(|sample| gaze.is_some() && sample.valid) {
            self.tell(&sample, &output)?;
        }
        self.said = Some(output);
        Ok(())
    }

    /// The original's topics.
    fn tell(&self, gaze: &GazeSample, output: &IntentOutput) -> rosrust::error::Result<()> {
        let stamp = self.common.stamp();
        let vector =
            |v: &Vector| Vector3Stamped { header: convert::header(stamp, WORLD), vector: convert::vector(v) };
        let scene = &self.parts.scene;
        if let Some(object) = output.highlight.and_then(|id| scene.objects.get(id.index())) {
            self.block_id.send(Text { data: object.ros_name.clone() })?;
        }
        self.hit.send(vector(&output.place.coords))?;
        if let Some(hit) = table_hit(gaze, scene.table_height) {
            self.raw_hit.send(vector(&hit.coords))?;
        }
        self.gaze_ros[0].send(vector(&gaze.origin.coords))?;
        self.gaze_ros[1].send(vector(&gaze.direction))?;
        let Some(Instant { world, .. }) = self.state.get() else { return Ok(()) };
        for (publisher, object) in self.distances.iter().zip(&world.objects) {
            // In a picture at unit distance, as the original has it.
            let centre = Point::from(object.pose.translation.vector);
            let data = gaze.direction.angle(&(centre - gaze.origin)).tan();
            publisher.send(Float64 { data })?;
        }
        Ok(())
    }
}

impl Stage for IntentNode {
    fn common(&mut self) -> &mut Common {
        &mut self.common
    }

    fn tick(&mut self, now: SimTime) -> rosrust::error::Result<()> {
        if !self.common.lockstep {
            return Ok(());
        }
        let input = self.person.get().cloned().unwrap_or_default();
        let done = self.infer(now, GazeMeasurement::of(&input));
        if let (Some(spans), Some(said)) = (&mut self.common.spans, &self.said) {
            spans.digest.input(&TickInput { gaze: input.gaze, ..TickInput::default() });
            spans.digest.intent(said);
            spans.end_tick(now, &[Field::InputGaze, Field::Intent], false);
        }
        done
    }

    /// What was seen grows old by itself.
    fn show(&mut self) -> rosrust::error::Result<()> {
        if self.common.lockstep { Ok(()) } else { self.infer(self.common.now(), None) }
    }

    fn is_ready(&self, next: SimTime) -> bool {
        self.person.is(next) && self.state.is(SimTime(next.0 - 1))
    }

    fn repeat(&mut self) -> rosrust::error::Result<()> {
        match &self.said {
            Some(said) => self.intent.send(wire::intent(self.common.now(), self.common.stamp(), said)),
            None => Ok(()),
        }
    }
}
