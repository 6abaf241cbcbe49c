//! `proact node participant`: a simulated person before the other nodes. Sees the display, and answers with muscles,
//! eyes and trunk.

use super::{
    NodeError, RosGraph, convert,
    graph::Jobs,
    stage::{self, Common, Stage, Tagged},
    wire::{self, Counts, Instant},
};
use crate::{
    frames::WORLD,
    messages::{
        geometry_msgs::{PoseStamped, Vector3Stamped},
        proact_msgs::{EmgSamples, Frame, Person, State},
    },
};
use proact_messages::original::relative;
use proact_testbed::stages::{PersonInput, PersonStage};
use proact_types::{DisplayFrame, EmgSample, Gesture, Pose, SimTime, TickInput};
use rosrust::Publisher;

/// What a person is made of.
pub struct ParticipantParts {
    /// Who sees and acts, with armband, eye tracker and body.
    pub stage: PersonStage,
    /// Joints of the arm, objects of the scene.
    pub counts: Counts,
}

struct ParticipantNode {
    common: Common,
    parts: ParticipantParts,
    state: Tagged<Instant>,
    /// The frame of the newest tick that has one.
    frame: Tagged<()>,
    gesture: Gesture,
    /// The first tick: armband and eye tracker count from it.
    began: Option<SimTime>,
    /// Since the last message of the clock.
    samples: Vec<EmgSample>,
    said: Option<Person>,
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
        common: Common::new(&graph)?,
        parts,
        state: Tagged::default(),
        frame: Tagged::default(),
        gesture: Gesture::NoMotion,
        began: None,
        samples: vec![],
        said: None,
        emg: graph.publish("proact/emg_samples", 20, false)?,
        gaze: [
            graph.publish(relative::GAZE_POSITION, 10, false)?,
            graph.publish(relative::GAZE_DIRECTION, 10, false)?,
        ],
        shoulder: graph.publish(relative::SHOULDER, 1, false)?,
        head: graph.publish(relative::HEAD, 1, false)?,
        person: graph.publish("proact/person", 100, false)?,
    };
    let jobs: Jobs<ParticipantNode> = Jobs::default();
    let _state = graph.listen("proact/state", 100, &jobs, |node: &mut ParticipantNode, message: State| {
        match wire::read_state(&message, node.parts.counts) {
            Ok(instant) => node.hear_state(SimTime(message.tick), instant),
            Err(reason) => node.common.faults.refuse("state", &reason),
        }
    })?;
    let _frame = graph.listen("proact/frame", 10, &jobs, |node: &mut ParticipantNode, message: Frame| {
        match wire::read_frame(&message, node.parts.counts) {
            Ok(frame) => node.see(&frame),
            Err(reason) => node.common.faults.refuse("frame", &reason),
        }
    })?;
    stage::run(graph, &jobs, &mut node)
}

impl ParticipantNode {
    fn hear_state(&mut self, tick: SimTime, instant: Instant) {
        if !self.common.lockstep {
            // A simulator that was started again counts anew.
            self.state = Tagged::default();
        }
        if !self.state.take(tick, instant) {
            let done = self.repeat();
            self.common.note("publish", done);
        }
    }

    fn see(&mut self, frame: &DisplayFrame) {
        if !self.common.lockstep {
            self.frame = Tagged::default();
        }
        if self.frame.take(frame.time, ()) {
            self.gesture = frame.gesture;
            self.parts.stage.see(frame);
        }
    }

    /// The original's topics. The headset publishes no gaze while it has lost the eye.
    fn tell(&self, input: &TickInput, head: &Pose) -> rosrust::error::Result<()> {
        let stamp = self.common.stamp();
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

impl Stage for ParticipantNode {
    fn common(&mut self) -> &mut Common {
        &mut self.common
    }

    fn tick(&mut self, now: SimTime) -> rosrust::error::Result<()> {
        let Some(instant) = self.state.get() else { return Ok(()) };
        let lockstep = self.common.lockstep;
        let began = *self.began.get_or_insert(if lockstep { SimTime(0) } else { now });
        let since = SimTime(now.millis_since(began));
        let arm = &instant.world.position[..self.parts.counts.arm];
        let mut input = self.parts.stage.step(since, PersonInput { arm, gesture: self.gesture });
        let head = self.parts.stage.head();
        if !lockstep {
            self.samples.append(&mut input.emg);
        }
        let news = input.gaze.is_some() || input.shoulder.is_some() || input.gesture.is_some();
        if lockstep || news {
            let message = wire::person(now, self.common.stamp(), &input, &head);
            // Before the original's topics, which listeners that know the typed message pass over.
            self.person.send(message.clone())?;
            self.said = Some(message);
        }
        self.tell(&input, &head)
    }

    /// An armband sends a few samples at a time.
    fn show(&mut self) -> rosrust::error::Result<()> {
        let samples = std::mem::take(&mut self.samples);
        let Some(first) = samples.first() else { return Ok(()) };
        self.emg.send(EmgSamples {
            header: convert::header(self.common.stamp(), ""),
            counter: first.counter,
            channels: first.channels.len() as u32,
            data: samples.iter().flat_map(|sample| sample.channels.iter().copied()).collect(),
        })
    }

    fn is_ready(&self, next: SimTime) -> bool {
        let before = SimTime(next.0 - 1);
        let framed = self.state.get().is_some_and(|instant| !instant.frame || self.frame.is(before));
        self.state.is(before) && framed
    }

    fn repeat(&mut self) -> rosrust::error::Result<()> {
        match &self.said {
            Some(said) => self.person.send(said.clone()),
            None => Ok(()),
        }
    }
}
