//! `proact node intent`: gaze and objects in, the object and the place that are meant out.

use super::{
    NodeDiagnostics, NodeError, RosGraph, convert,
    gaze_topics::{self, GazeTopicNode, GazeTopics},
    graph::Jobs,
    stage::{self, StageContext, StageNode, TickMessage},
    wire::{self, TickState},
};
use crate::{
    frames::WORLD,
    messages::{
        geometry_msgs::Vector3Stamped,
        proact_msgs::{Intent, Person, State},
        std_msgs::{Float64, String as Text},
    },
    publishing::Publisher,
};
use proact_control::ports::ArmKinematics;
use proact_intent::gaze_plane_intersection;
use proact_messages::original;
use proact_messages::original::relative;
use proact_testbed::{
    DigestField,
    stages::{GazeMeasurement, IntentInput, IntentOutput, IntentStage},
};
use proact_types::{GazeSample, Point, Scene, SimTime, TickInput, Vector};
use std::sync::Arc;

/// What the intent stage is made of.
pub struct IntentParts {
    /// The stage.
    pub stage: IntentStage,
    /// The arm's kinematics.
    pub kinematics: Box<dyn ArmKinematics>,
    /// Joints of the arm, objects of the scene.
    pub counts: wire::ExpectedCounts,
    /// The scene.
    pub scene: Scene,
}

struct IntentNode {
    context: StageContext,
    parts: IntentParts,
    state: TickMessage<TickState>,
    /// In lock-step.
    person: TickMessage<TickInput>,
    /// In real time: of the newest message.
    person_tick: Option<SimTime>,
    gaze_topics: GazeTopics,
    last_output: Option<IntentOutput>,
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
    let distances = topics.map(|topic| graph.advertise(&topic, 1, false)).collect::<Result<_, _>>()?;
    let mut node = IntentNode {
        context: StageContext::new(&graph)?,
        parts,
        state: TickMessage::default(),
        person: TickMessage::default(),
        person_tick: None,
        gaze_topics: GazeTopics::default(),
        last_output: None,
        block_id: graph.advertise(relative::BLOCK_ID, 1, false)?,
        hit: graph.advertise(relative::GAZE_HIT, 1, false)?,
        raw_hit: graph.advertise(relative::GAZE_HIT_LOGGING, 1, false)?,
        gaze_ros: [
            graph.advertise(relative::GAZE_POSITION_ROS, 1, false)?,
            graph.advertise(relative::GAZE_DIRECTION_ROS, 1, false)?,
        ],
        distances,
        intent: graph.advertise("proact/intent", 100, false)?,
    };
    let jobs: Jobs<IntentNode> = Jobs::default();
    let _state = graph.subscribe("proact/state", 100, &jobs, |node: &mut IntentNode, message: State| {
        match wire::read_state(&message, node.parts.counts) {
            Ok(instant) => {
                node.context.record_stamped_input("proact/state", &message.header);
                node.receive_state(SimTime(message.tick), instant);
            }
            Err(reason) => node.context.node_diagnostics.record_refusal("state", &reason),
        }
    })?;
    let _person = graph.subscribe_with_caller(
        "proact/person",
        100,
        &jobs,
        |node: &mut IntentNode, message: Person, caller| {
            node.context.register_typed_caller(caller);
            match wire::read_person(&message) {
                Ok((input, _)) => node.receive_person(SimTime(message.tick), input),
                Err(reason) => node.context.node_diagnostics.record_refusal("person", &reason),
            }
        },
    )?;
    let _gaze = gaze_topics::subscribe(&graph, &jobs)?;
    stage::run(graph, &jobs, &mut node)
}

impl GazeTopicNode for IntentNode {
    fn gaze_topics(&mut self) -> &mut GazeTopics {
        &mut self.gaze_topics
    }

    fn node_diagnostics(&self) -> &Arc<NodeDiagnostics> {
        &self.context.node_diagnostics
    }

    fn receive_gaze(&mut self, sample: GazeSample) {
        let (points, again) = (false, false);
        self.infer_between_ticks(Some(GazeMeasurement {
            sample,
            is_pointing_device: points,
            is_repeated: again,
        }));
    }

    fn ignores_caller(&self, caller: &str) -> bool {
        self.context.is_typed_caller(caller)
    }
}

impl IntentNode {
    fn receive_state(&mut self, tick: SimTime, instant: TickState) {
        if self.context.lockstep {
            self.receive_tick_message(|node| node.state.update(tick, instant));
        } else {
            // A simulator that was started again counts anew.
            self.state = TickMessage::default();
            self.state.update(tick, instant);
        }
    }

    fn receive_person(&mut self, tick: SimTime, input: TickInput) {
        if self.context.lockstep {
            self.receive_tick_message(|node| node.person.update(tick, input));
            return;
        }
        // After a restart of the master a connection may be there twice, and every message come twice.
        let again = self.person_tick.replace(tick) == Some(tick);
        if let Some(gaze) = GazeMeasurement::from_input(&input).filter(|_| !again) {
            self.infer_between_ticks(Some(gaze));
        }
    }

    fn receive_tick_message(&mut self, take: impl FnOnce(&mut Self) -> bool) {
        if !take(self) {
            let done = self.republish_last();
            self.context.report_error("publish", done);
        }
    }

    /// Between two ticks: a gaze acts at once.
    fn infer_between_ticks(&mut self, gaze: Option<GazeMeasurement>) {
        let done = self.infer(self.context.now(), gaze);
        self.context.report_error("publish", done);
    }

    fn infer(&mut self, now: SimTime, gaze: Option<GazeMeasurement>) -> rosrust::error::Result<()> {
        let Some(TickState { world, task, .. }) = self.state.get() else { return Ok(()) };
        let input = IntentInput { gaze, world, task, answer: None };
        let output = self.parts.stage.step(now, input, self.parts.kinematics.as_mut());
        let stamp = self.context.stamp();
        // Before the original's topics, which listeners that know the typed message pass over.
        self.intent.send(wire::intent(now, stamp, &output))?;
        if let Some(sample) = output.gaze.filter(|sample| gaze.is_some() && sample.valid) {
            self.publish_original_topics(&sample, &output)?;
        }
        self.last_output = Some(output);
        Ok(())
    }

    /// The original's topics.
    fn publish_original_topics(
        &self,
        gaze: &GazeSample,
        output: &IntentOutput,
    ) -> rosrust::error::Result<()> {
        let stamp = self.context.stamp();
        let vector =
            |v: &Vector| Vector3Stamped { header: convert::header(stamp, WORLD), vector: convert::vector(v) };
        let scene = &self.parts.scene;
        if let Some(object) = output.highlight.and_then(|id| scene.objects.get(id.index())) {
            self.block_id.send(Text { data: object.ros_name.clone() })?;
        }
        self.hit.send(vector(&output.place_point.coords))?;
        if let Some(hit) = gaze_plane_intersection(gaze, scene.table_height) {
            self.raw_hit.send(vector(&hit.coords))?;
        }
        self.gaze_ros[0].send(vector(&gaze.origin.coords))?;
        self.gaze_ros[1].send(vector(&gaze.direction))?;
        let Some(TickState { world, .. }) = self.state.get() else { return Ok(()) };
        for (publisher, object) in self.distances.iter().zip(&world.objects) {
            // In a picture at unit distance, as the original has it.
            let center = Point::from(object.pose.translation.vector);
            let data = gaze.direction.angle(&(center - gaze.origin)).tan();
            publisher.send(Float64 { data })?;
        }
        Ok(())
    }
}

impl StageNode for IntentNode {
    fn context(&mut self) -> &mut StageContext {
        &mut self.context
    }

    fn tick(&mut self, now: SimTime) -> rosrust::error::Result<()> {
        if !self.context.lockstep {
            return Ok(());
        }
        let input = self.person.get().cloned().unwrap_or_default();
        let done = self.infer(now, GazeMeasurement::from_input(&input));
        if let (Some(spans), Some(last_output)) = (&mut self.context.span_digests, &self.last_output) {
            spans.digest.input(&TickInput { gaze: input.gaze, ..TickInput::default() });
            spans.digest.intent(last_output);
            spans.end_tick(now, &[DigestField::InputGaze, DigestField::Intent], false);
        }
        done
    }

    /// What was seen grows old by itself.
    fn flush(&mut self) -> rosrust::error::Result<()> {
        if self.context.lockstep { Ok(()) } else { self.infer(self.context.now(), None) }
    }

    fn is_ready(&self, next: SimTime) -> bool {
        self.person.is_at(next) && self.state.is_at(SimTime(next.0 - 1))
    }

    fn republish_last(&mut self) -> rosrust::error::Result<()> {
        match &self.last_output {
            Some(last_output) => {
                self.intent.send(wire::intent(self.context.now(), self.context.stamp(), last_output))
            }
            None => Ok(()),
        }
    }
}
