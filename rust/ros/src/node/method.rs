//! `proact node method`: the gesture and what is meant in, commands for arm and hand out.

mod arm;
mod inputs;
mod publishers;

use super::{
    NodeError, RosGraph,
    graph::Jobs,
    stage::{self, StageContext, StageNode, TickMessage},
    wire::{self, ExpectedCounts, MethodStatus, TickState},
};
use crate::heartbeat::{self, HEARTBEAT_TIMEOUT_MS, HeartbeatMonitor};
use arm::ArmCommandPublisher;
use inputs::ReceivedInputs;
use proact_arm::ArmModel;
use proact_control::{MethodEntry, MotionCommand, MotionState, ports::ArmKinematics};
use proact_testbed::{
    DigestField,
    stages::{DisplayStage, EmgStageOutput, IntentOutput, MethodInput, MethodOutput, MethodStage},
};
use proact_types::{Command, EventKind, HandState, Scene, SimTime, StopCause, TickInput};
use publishers::MethodPublishers;
use std::{collections::BTreeMap, sync::Arc};

/// The world's topic: without it no gesture moves the arm.
const STATE: &str = "proact/state";
/// From a command for the arm to the first message of the world that shows it, at most, ms.
const COMMAND_SETTLING_MS: u64 = 300;

/// What the method stage is made of.
pub struct MethodParts {
    /// The stage.
    pub stage: MethodStage,
    /// What it was made of.
    pub method: MethodEntry,
    /// The arm.
    pub model: Arc<ArmModel>,
    /// What stands where.
    pub scene: Scene,
    /// The arm's kinematics.
    pub kinematics: Box<dyn ArmKinematics>,
}

struct MethodNode {
    context: StageContext,
    counts: ExpectedCounts,
    parts: MethodParts,
    state: TickMessage<TickState>,
    /// In lock-step: what came of a tick.
    person: TickMessage<TickInput>,
    decision: TickMessage<EmgStageOutput>,
    intent: TickMessage<IntentOutput>,
    /// In real time: what came since the tick before.
    received: ReceivedInputs,
    /// Nodes that promised to speak, and the input that each misses.
    stage_heartbeats: HeartbeatMonitor<String>,
    missing_inputs: BTreeMap<String, String>,
    /// Why the path that was followed is given up.
    abandoned_path_reason: Option<String>,
    /// Commands for the arm, and when the last one was given.
    command_count: u64,
    commanded_at: Option<SimTime>,
    /// What the arm does from that command on.
    commanded_motion: MotionState,
    hand: HandState,
    last_output: Option<(MethodOutput, Vec<EventKind>)>,
    publishers: MethodPublishers,
    arm_commands: ArmCommandPublisher,
}

/// Runs the method stage until the graph ends the node.
///
/// # Errors
/// [`NodeError`].
pub fn run_method(parts: MethodParts) -> Result<(), NodeError> {
    let graph = RosGraph::join("proact_method")?;
    let arm_out = ArmCommandPublisher::new(&graph, &parts.model, parts.method.single_joints())?;
    let (received, counts) =
        (ReceivedInputs::new(&parts.scene), ExpectedCounts::of(&parts.model, &parts.scene));
    let mut node = MethodNode {
        context: StageContext::new(&graph)?,
        parts,
        state: TickMessage::default(),
        person: TickMessage::default(),
        decision: TickMessage::default(),
        intent: TickMessage::default(),
        received,
        counts,
        stage_heartbeats: HeartbeatMonitor::default(),
        missing_inputs: BTreeMap::new(),
        abandoned_path_reason: None,
        command_count: 0,
        commanded_at: None,
        commanded_motion: MotionState::Holding,
        hand: HandState::Open,
        last_output: None,
        publishers: MethodPublishers::new(&graph)?,
        arm_commands: arm_out,
    };
    let jobs: Jobs<MethodNode> = Jobs::default();
    let _inputs = inputs::subscribe(&graph, &jobs)?;
    let _keeper = node.arm_commands.spawn_controllers();
    stage::run(graph, &jobs, &mut node)
}

impl StageNode for MethodNode {
    fn context(&mut self) -> &mut StageContext {
        &mut self.context
    }

    fn tick(&mut self, now: SimTime) -> rosrust::error::Result<()> {
        if !self.context.lockstep {
            return self.step_real_time(now);
        }
        let Some(input) = self.person.get().cloned() else { return Ok(()) };
        let (Some(emg_output), Some(intent)) = (self.decision.get().cloned(), self.intent.get().cloned())
        else {
            return Ok(());
        };
        let done = self.step(now, &input, &emg_output, &intent);
        if let (Some(spans), Some((output, _))) = (&mut self.context.span_digests, &self.last_output) {
            // Samples, gaze and shoulder are those of other stages.
            let TickInput { command, limb, heartbeats, .. } = input;
            spans.digest.input(&TickInput { command, limb, heartbeats, ..TickInput::default() });
            spans.digest.method(output, self.parts.stage.stop());
            let own = [
                DigestField::InputGesture,
                DigestField::InputLimb,
                DigestField::InputPlan,
                DigestField::InputMethod,
                DigestField::Control,
            ];
            spans.end_tick(now, &own, false);
        }
        done
    }

    fn flush(&mut self) -> rosrust::error::Result<()> {
        let Some(instant) = self.state.get() else { return Ok(()) };
        let hand = instant.hand.state;
        if self.hand != hand {
            self.hand = hand;
            match hand {
                HandState::Closed => self.publishers.publish_success(true)?,
                HandState::Open => self.publishers.publish_success(false)?,
                HandState::Closing | HandState::Opening => {}
            }
        }
        let due = !self.context.lockstep || DisplayStage::is_due(self.context.now());
        match self.method_status().filter(|_| due) {
            Some(method_status) => {
                self.publishers.publish_status(self.context.stamp(), &self.parts.scene, &method_status)
            }
            None => Ok(()),
        }
    }

    fn is_ready(&self, next: SimTime) -> bool {
        self.person.is_at(next)
            && self.decision.is_at(next)
            && self.intent.is_at(next)
            && self.state.is_at(SimTime(next.0 - 1))
    }

    fn republish_last(&mut self) -> rosrust::error::Result<()> {
        let Some((output, events)) = &self.last_output else { return Ok(()) };
        let method_status = self.method_status();
        let (now, stamp) = (self.context.now(), self.context.stamp());
        self.publishers.publish_command(wire::command(
            now,
            stamp,
            output,
            self.command_count,
            method_status.as_ref(),
            events,
        ))
    }
}

impl MethodNode {
    /// In real time: a step on what came since the one before. Between two ticks as well, where a gesture came.
    fn step_real_time(&mut self, now: SimTime) -> rosrust::error::Result<()> {
        let (emg_output, mut intent, input) = self.received.take_inputs(now);
        let gaze_ms = self.parts.stage.dead_man().map(|limits| limits.gaze_timeout_ms);
        if let Some(reason) = gaze_ms.and_then(|limit| self.received.stale_intent(now, limit)) {
            intent.fault = Some(reason);
        }
        self.check_arm(now);
        self.check_heartbeats();
        let stands = emg_output.command == Command::NoMotion && emg_output.fault.is_none();
        if stands {
            self.forget_stale();
        }
        let fault = self
            .missing_stage()
            .or_else(|| Some((StopCause::TrackingLost, self.abandoned_path_reason.take()?)));
        self.parts.stage.set_stage_fault(fault);
        self.step(now, &input, &emg_output, &intent)
    }

    fn step(
        &mut self,
        now: SimTime,
        input: &TickInput,
        emg_output: &EmgStageOutput,
        intent: &IntentOutput,
    ) -> rosrust::error::Result<()> {
        let (commands, motion, lockstep) = (self.command_count, self.commanded_motion, self.context.lockstep);
        let Some(instant) = self.state.get_mut() else { return Ok(()) };
        if !lockstep && commands > 0 && instant.last_command_number != commands {
            // The world does not show the last command yet.
            instant.actuation.motion = motion;
        }
        let instant = &*instant;
        let method_input = MethodInput {
            emg: emg_output,
            intent,
            actuation: &instant.actuation,
            world: &instant.world,
            hand: instant.hand,
            heartbeats: &input.heartbeats,
            participant: None,
            shoulder_tracked: input.shoulder.is_some(),
            limb: input.limb.as_ref(),
            plan: None,
            answer: None,
        };
        let output = self.parts.stage.step(now, method_input, self.parts.kinematics.as_mut());
        if let Some(command) = &output.motion {
            self.command_count += 1;
            self.commanded_at = Some(now);
            let follows = matches!(command, MotionCommand::Follow(_));
            self.commanded_motion = if follows { MotionState::Following(0.0) } else { MotionState::Holding };
        }
        self.received.set_last_inputs(emg_output, intent);
        let stamp = self.context.stamp();
        for event in &output.events {
            match event {
                EventKind::Stopped { reason, .. } => self.context.node_diagnostics.record_stop(reason),
                EventKind::Locked { .. } => self.publishers.publish_frozen(true)?,
                EventKind::Unlocked => self.publishers.publish_frozen(false)?,
                _ => {}
            }
        }
        let events: Vec<EventKind> =
            emg_output.events.iter().chain(&intent.events).chain(&output.events).cloned().collect();
        let due = output.has_stepped || DisplayStage::is_due(now);
        if lockstep || output.has_stepped || !events.is_empty() {
            // Before the original's topics, which listeners that know the typed message pass over.
            let method_status = self.method_status().filter(|_| due);
            self.publishers.publish_command(wire::command(
                now,
                stamp,
                &output,
                self.command_count,
                method_status.as_ref(),
                &events,
            ))?;
        }
        if let (Some(command), Some(instant)) = (&output.motion, self.state.get()) {
            let arm = self.parts.model.arm_count();
            self.arm_commands.send(command, &instant.actuation.command.position[..arm], stamp)?;
        }
        if let Some(command) = output.hand {
            self.publishers.publish_grasp_goal(command, stamp)?;
        }
        if let Some(request) = &output.request {
            self.publishers.publish_plan_request(&self.parts.model, request, stamp)?;
        }
        self.last_output = Some((output, events));
        Ok(())
    }

    /// What there is to see; none before the world was.
    fn method_status(&self) -> Option<MethodStatus> {
        let instant = self.state.get()?;
        let view = self.parts.stage.view();
        let (emg_output, intent) = match self.context.lockstep {
            true => (self.decision.get()?, self.intent.get()?),
            false => self.received.last_inputs(),
        };
        Some(MethodStatus {
            method: view.name,
            gesture: emg_output.command,
            recognized: emg_output.recognized_gesture,
            confidence: emg_output.confidence,
            effort: emg_output.effort,
            hand: instant.hand,
            gaze: intent.gaze,
            stop: view.stop,
            target: view.target,
            planner: view.planner,
            mode: view.mode,
            goal: instant.actuation.goal.clone(),
        })
    }

    /// Notices nodes and topics that fell silent.
    fn check_heartbeats(&mut self) {
        let now = self.context.now();
        self.context.check_inputs();
        for name in self.stage_heartbeats.step(now) {
            let reason =
                format!("{name} is silent for {HEARTBEAT_TIMEOUT_MS} ms: no motion until the hand relaxes");
            self.context.node_diagnostics.record_refusal("heartbeat", &reason);
        }
    }

    /// Which topic or stage is missing, and how; none while all are there.
    fn missing_stage(&self) -> Option<(StopCause, String)> {
        let silent = |name: &dyn std::fmt::Display| format!("{name} is silent");
        let topic = self.context.inputs.stale().next().map(|topic| (StopCause::Silent, silent(topic)));
        let node =
            || self.stage_heartbeats.stale().next().map(|name| (StopCause::TrackingLost, silent(name)));
        let starved = || {
            let (name, input) = self.missing_inputs.first_key_value()?;
            Some((StopCause::Silent, format!("{name} misses {input}")))
        };
        topic.or_else(node).or_else(starved)
    }

    /// A hand that is seen to relax may go on without a stage that does not come back, but not without the world.
    fn forget_stale(&mut self) {
        let topics: Vec<_> = self.context.inputs.stale().copied().filter(|topic| *topic != STATE).collect();
        topics.iter().for_each(|topic| self.context.inputs.forget(topic));
        let nodes: Vec<_> = self.stage_heartbeats.stale().cloned().collect();
        for name in nodes {
            self.stage_heartbeats.forget(&name);
            self.missing_inputs.remove(&name);
        }
    }

    /// A stage said that it lives; it may miss an input, and cannot do its part then.
    fn receive_heartbeat(&mut self, text: &str) {
        let (name, missed) = heartbeat::parse_heartbeat(text);
        if name == rosrust::name() {
            return;
        }
        self.stage_heartbeats.record(name.to_owned(), self.context.now());
        match missed.filter(|_| self.stage_heartbeats.is_watched(&name.to_owned())) {
            None => {
                self.missing_inputs.remove(name);
            }
            Some(input) => {
                if self.missing_inputs.insert(name.to_owned(), input.to_owned()).is_none() {
                    let reason = format!("{name} misses {input}: no motion until the hand relaxes");
                    self.context.node_diagnostics.record_refusal("heartbeat", &reason);
                }
            }
        }
    }

    /// Somebody else may have taken the arm, or held it, while the method believes that it follows a path.
    fn check_arm(&mut self, now: SimTime) {
        let Some(instant) = self.state.get() else { return };
        let Some(since) = self.commanded_at else { return };
        let executes = matches!(self.parts.stage.view().planner, proact_types::PlannerView::Executing { .. });
        let held = instant.actuation.motion == MotionState::Holding;
        if !(executes && held) || now.millis_since(since) < COMMAND_SETTLING_MS {
            return;
        }
        self.commanded_at = None;
        let reason = "the arm was stopped by somebody else; the path is given up";
        self.context.node_diagnostics.record_refusal("arm", reason);
        self.abandoned_path_reason = Some(reason.to_owned());
    }
}
