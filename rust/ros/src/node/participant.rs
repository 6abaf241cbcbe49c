//! `proact node participant`: a simulated person before the other nodes. Sees the display, and answers with muscles,
//! eyes and trunk.

use super::{
    NodeError, RosGraph, convert,
    graph::Jobs,
    stage::{self, StageContext, StageNode, TickMessage},
    wire::{self, ExpectedCounts, TickState},
};
use crate::{
    frames::WORLD,
    messages::{
        geometry_msgs::{PoseStamped, Vector3Stamped},
        proact_msgs::{EmgSamples, Frame, Person, State},
    },
    publishing::Publisher,
};
use proact_messages::original::relative;
use proact_testbed::stages::{PersonInput, PersonStage};
use proact_types::{Command, DisplayFrame, EmgSample, Pose, SimTime, TickInput};

/// What a person is made of.
pub struct ParticipantParts {
    /// Who sees and acts, with armband, eye tracker and body.
    pub stage: PersonStage,
    /// Joints of the arm, objects of the scene.
    pub counts: ExpectedCounts,
}

struct ParticipantNode {
    context: StageContext,
    parts: ParticipantParts,
    state: TickMessage<TickState>,
    /// The frame of the newest tick that has one.
    frame: TickMessage<()>,
    gesture: Command,
    /// The first tick: armband and eye tracker count from it.
    started_at: Option<SimTime>,
    /// Since the last message of the clock.
    samples: Vec<EmgSample>,
    last_message: Option<Person>,
    emg: Publisher<EmgSamples>,
    gaze: [Publisher<Vector3Stamped>; 2],
    shoulder: Publisher<PoseStamped>,
    head: Publisher<PoseStamped>,
    person: Publisher<Person>,
}

/// Runs a simulated person until the graph ends the node.
///
/// # Errors
/// [`NodeError`].
pub fn run_participant(parts: ParticipantParts) -> Result<(), NodeError> {
    let graph = RosGraph::join("proact_participant")?;
    let mut node = ParticipantNode {
        context: StageContext::new(&graph)?,
        parts,
        state: TickMessage::default(),
        frame: TickMessage::default(),
        gesture: Command::NoMotion,
        started_at: None,
        samples: vec![],
        last_message: None,
        emg: graph.advertise("proact/emg_samples", 20, false)?,
        gaze: [
            graph.advertise(relative::GAZE_POSITION, 10, false)?,
            graph.advertise(relative::GAZE_DIRECTION, 10, false)?,
        ],
        shoulder: graph.advertise(relative::SHOULDER, 1, false)?,
        head: graph.advertise(relative::HEAD, 1, false)?,
        person: graph.advertise("proact/person", 100, false)?,
    };
    let jobs: Jobs<ParticipantNode> = Jobs::default();
    let _state =
        graph.subscribe("proact/state", 100, &jobs, |node: &mut ParticipantNode, message: State| {
            match wire::read_state(&message, node.parts.counts) {
                Ok(instant) => {
                    node.context.record_stamped_input("proact/state", &message.header);
                    node.receive_state(SimTime(message.tick), instant);
                }
                Err(reason) => node.context.node_diagnostics.record_refusal("state", &reason),
            }
        })?;
    let _frame =
        graph.subscribe("proact/frame", 10, &jobs, |node: &mut ParticipantNode, message: Frame| {
            match wire::read_frame(&message, node.parts.counts) {
                Ok(frame) => {
                    // A person who does not see the arm must not go on moving it.
                    node.context.record_stamped_input("proact/frame", &message.header);
                    node.receive_frame(&frame);
                }
                Err(reason) => node.context.node_diagnostics.record_refusal("frame", &reason),
            }
        })?;
    stage::run(graph, &jobs, &mut node)
}

impl ParticipantNode {
    fn receive_state(&mut self, tick: SimTime, instant: TickState) {
        if !self.context.lockstep {
            // A simulator that was started again counts anew.
            self.state = TickMessage::default();
        }
        if !self.state.update(tick, instant) {
            let done = self.republish_last();
            self.context.report_error("publish", done);
        }
    }

    fn receive_frame(&mut self, frame: &DisplayFrame) {
        if !self.context.lockstep {
            self.frame = TickMessage::default();
        }
        if self.frame.update(frame.time, ()) {
            self.gesture = frame.command;
            self.parts.stage.show_frame(frame);
        }
    }

    /// The original's topics. The headset publishes no gaze while it has lost the eye.
    fn publish_original_topics(&self, input: &TickInput, head: &Pose) -> rosrust::error::Result<()> {
        let stamp = self.context.stamp();
        if let Some(gaze) = input.gaze.filter(|gaze| gaze.valid) {
            for (publisher, v) in self.gaze.iter().zip([&gaze.origin.coords, &gaze.direction]) {
                let header = convert::header(stamp, WORLD);
                publisher.send(Vector3Stamped { header, vector: convert::vector(v) })?;
            }
        }
        if let Some(shoulder) = &input.shoulder {
            self.shoulder.send(convert::pose_stamped(stamp, WORLD, shoulder))?;
            self.head.send(convert::pose_stamped(stamp, WORLD, head))?;
        }
        Ok(())
    }
}

impl StageNode for ParticipantNode {
    fn context(&mut self) -> &mut StageContext {
        &mut self.context
    }

    fn tick(&mut self, now: SimTime) -> rosrust::error::Result<()> {
        let Some(instant) = self.state.get() else { return Ok(()) };
        let lockstep = self.context.lockstep;
        let began = *self.started_at.get_or_insert(if lockstep { SimTime(0) } else { now });
        let since = SimTime(now.millis_since(began));
        let arm = &instant.world.position[..self.parts.counts.arm];
        let mut input = self.parts.stage.step(since, PersonInput { arm, command: self.gesture });
        let head = self.parts.stage.head_pose();
        if !lockstep {
            self.samples.append(&mut input.emg);
        }
        let has_input = input.gaze.is_some() || input.shoulder.is_some() || input.command.is_some();
        if lockstep || has_input {
            let message = wire::person(now, self.context.stamp(), &input, &head);
            // Before the original's topics, which listeners that know the typed message pass over.
            self.person.send(message.clone())?;
            self.last_message = Some(message);
        }
        self.publish_original_topics(&input, &head)
    }

    /// An armband sends a few samples at a time.
    fn flush(&mut self) -> rosrust::error::Result<()> {
        let samples = std::mem::take(&mut self.samples);
        let Some(first) = samples.first() else { return Ok(()) };
        self.emg.send(EmgSamples {
            header: convert::header(self.context.stamp(), ""),
            counter: first.counter,
            channels: first.channels.len() as u32,
            data: samples.iter().flat_map(|sample| sample.channels.iter().copied()).collect(),
        })
    }

    fn is_ready(&self, next: SimTime) -> bool {
        let before = SimTime(next.0 - 1);
        let framed = self.state.get().is_some_and(|instant| !instant.has_frame || self.frame.is_at(before));
        self.state.is_at(before) && framed
    }

    fn republish_last(&mut self) -> rosrust::error::Result<()> {
        match &self.last_message {
            Some(last_input) => self.person.send(last_input.clone()),
            None => Ok(()),
        }
    }
}
