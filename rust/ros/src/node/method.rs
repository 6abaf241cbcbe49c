//! `proact node method`: the gesture and what is meant in, commands for arm and hand out.

mod arm;
mod inputs;
mod outlets;

use super::{
    NodeError, RosGraph,
    graph::Jobs,
    stage::{self, Common, Stage, Tagged},
    wire::{self, Counts, Instant, MethodShown},
};
use arm::ArmOutlet;
use inputs::Heard;
use outlets::Outlets;
use proact_arm::ArmModel;
use proact_control::{MethodEntry, MotionCommand, MotionState, ports::ArmKinematics};
use proact_testbed::{
    Field,
    stages::{DisplayStage, EmgStageOutput, IntentOutput, MethodInput, MethodOutput, MethodStage},
};
use proact_types::{
    EventKind, Gesture, HandState, InputSign, InputSource, Scene, SignKind, SimTime, TickInput,
};
use std::{
    collections::{BTreeMap, BTreeSet},
    sync::Arc,
};

/// A stage that promised to speak and is silent for this long stops the arm, ms.
const SILENCE_MS: u64 = 120;
/// From a command for the arm to the first message of the world that shows it, at most, ms.
const SETTLING_MS: u64 = 300;

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
    common: Common,
    counts: Counts,
    parts: MethodParts,
    state: Tagged<Instant>,
    /// In lock-step: what came of a tick.
    person: Tagged<TickInput>,
    decision: Tagged<EmgStageOutput>,
    intent: Tagged<IntentOutput>,
    /// In real time: what came since the tick before.
    heard: Heard,
    /// When each node that promised to speak last did, and those that fell silent.
    others: BTreeMap<String, SimTime>,
    lost: BTreeSet<String>,
    /// Commands for the arm, and when the last one was given.
    commands: u64,
    commanded_at: Option<SimTime>,
    /// What the arm does from that command on.
    begun: MotionState,
    hand: HandState,
    said: Option<(MethodOutput, Vec<EventKind>)>,
    out: Outlets,
    arm_out: ArmOutlet,
}

/// Runs the method stage until the graph ends the node.
///
/// # Errors
/// [`NodeError`].
pub fn run_method(parts: MethodParts) -> Result<(), NodeError> {
    let graph = RosGraph::join("proact_method")?;
    let arm_out = ArmOutlet::new(&graph, &parts.model, parts.method.single_joints())?;
    let (heard, counts) = (Heard::new(&parts.scene), Counts::of(&parts.model, &parts.scene));
    let mut node = MethodNode {
        common: Common::new(&graph)?,
        parts,
        state: Tagged::default(),
        person: Tagged::default(),
        decision: Tagged::default(),
        intent: Tagged::default(),
        heard,
        counts,
        others: BTreeMap::new(),
        lost: BTreeSet::new(),
        commands: 0,
        commanded_at: None,
        begun: MotionState::Holding,
        hand: HandState::Open,
        said: None,
        out: Outlets::new(&graph)?,
        arm_out,
    };
    let jobs: Jobs<MethodNode> = Jobs::default();
    let _inputs = inputs::listen(&graph, &jobs)?;
    let _keeper = node.arm_out.keep_controllers();
    stage::run(graph, &jobs, &mut node)
}

impl Stage for MethodNode {
    fn common(&mut self) -> &mut Common {
        &mut self.common
    }

    fn tick(&mut self, now: SimTime) -> rosrust::error::Result<()> {
        if !self.common.lockstep {
            self.watch_others();
            return self.act(now);
        }
        let Some(input) = self.person.get().cloned() else { return Ok(()) };
        let (Some(gesture), Some(intent)) = (self.decision.get().cloned(), self.intent.get().cloned()) else {
            return Ok(());
        };
        let done = self.step(now, &input, &gesture, &intent);
        if let (Some(spans), Some((output, _))) = (&mut self.common.spans, &self.said) {
            // Samples, gaze and shoulder are those of other stages.
            let TickInput { gesture, limb, signs, .. } = input;
            spans.digest.input(&TickInput { gesture, limb, signs, ..TickInput::default() });
            spans.digest.method(output, self.parts.stage.stop());
            let own =
                [Field::InputGesture, Field::InputLimb, Field::InputPlan, Field::InputMethod, Field::Control];
            spans.end_tick(now, &own, false);
        }
        done
    }

    fn show(&mut self) -> rosrust::error::Result<()> {
        let Some(instant) = self.state.get() else { return Ok(()) };
        let hand = instant.hand.state;
        if self.hand != hand {
            self.hand = hand;
            match hand {
                HandState::Closed => self.out.success(true)?,
                HandState::Open => self.out.success(false)?,
                HandState::Closing | HandState::Opening => {}
            }
        }
        let due = !self.common.lockstep || DisplayStage::is_due(self.common.now());
        match self.shown().filter(|_| due) {
            Some(shown) => self.out.show(self.common.stamp(), &self.parts.scene, &shown),
            None => Ok(()),
        }
    }

    fn is_ready(&self, next: SimTime) -> bool {
        self.person.is(next)
            && self.decision.is(next)
            && self.intent.is(next)
            && self.state.is(SimTime(next.0 - 1))
    }

    fn repeat(&mut self) -> rosrust::error::Result<()> {
        let Some((output, events)) = &self.said else { return Ok(()) };
        let shown = self.shown();
        let (now, stamp) = (self.common.now(), self.common.stamp());
        self.out.command(wire::command(now, stamp, output, self.commands, shown.as_ref(), events))
    }
}

impl MethodNode {
    /// In real time: a step on what came since the one before. Between two ticks as well, where a gesture came.
    fn act(&mut self, now: SimTime) -> rosrust::error::Result<()> {
        let (gesture, intent, input) = self.heard.take(now);
        let mut input = input;
        self.watch_arm(now, &mut input);
        // A hand that is seen to relax may go on without a stage that does not come back.
        if gesture.gesture == Gesture::NoMotion && gesture.fault.is_none() && !self.lost.is_empty() {
            self.lost.clear();
            self.heard.sign(InputSource::Stage, SignKind::Alive);
        }
        self.step(now, &input, &gesture, &intent)
    }

    fn step(
        &mut self,
        now: SimTime,
        input: &TickInput,
        gesture: &EmgStageOutput,
        intent: &IntentOutput,
    ) -> rosrust::error::Result<()> {
        let (commands, begun, lockstep) = (self.commands, self.begun, self.common.lockstep);
        let Some(instant) = self.state.get_mut() else { return Ok(()) };
        if !lockstep && commands > 0 && instant.acted_on != commands {
            // The world does not show the last command yet.
            instant.actuation.motion = begun;
        }
        let instant = &*instant;
        let asked = MethodInput {
            gesture,
            intent,
            actuation: &instant.actuation,
            world: &instant.world,
            hand: instant.hand,
            signs: &input.signs,
            participant: None,
            shoulder_tracked: input.shoulder.is_some(),
            limb: input.limb.as_ref(),
            plan: None,
            answer: None,
        };
        let output = self.parts.stage.step(now, asked, self.parts.kinematics.as_mut());
        if let Some(command) = &output.motion {
            self.commands += 1;
            self.commanded_at = Some(now);
            let follows = matches!(command, MotionCommand::Follow(_));
            self.begun = if follows { MotionState::Following(0.0) } else { MotionState::Holding };
        }
        self.heard.shows(gesture, intent);
        let stamp = self.common.stamp();
        for event in &output.events {
            match event {
                EventKind::Stopped { reason, .. } => self.common.faults.stop(reason),
                EventKind::Locked { .. } => self.out.frozen(true)?,
                EventKind::Unlocked => self.out.frozen(false)?,
                _ => {}
            }
        }
        let events: Vec<EventKind> =
            gesture.events.iter().chain(&intent.events).chain(&output.events).cloned().collect();
        let due = output.stepped || DisplayStage::is_due(now);
        if lockstep || output.stepped || !events.is_empty() {
            // Before the original's topics, which listeners that know the typed message pass over.
            let shown = self.shown().filter(|_| due);
            self.out.command(wire::command(now, stamp, &output, self.commands, shown.as_ref(), &events))?;
        }
        if let (Some(command), Some(instant)) = (&output.motion, self.state.get()) {
            let arm = self.parts.model.arm_count();
            self.arm_out.send(command, &instant.actuation.command.position[..arm], stamp)?;
        }
        if let Some(command) = output.hand {
            self.out.grasp(command, stamp)?;
        }
        if let Some(request) = &output.request {
            self.out.request(&self.parts.model, request, stamp)?;
        }
        self.said = Some((output, events));
        Ok(())
    }

    /// What there is to see; none before the world was.
    fn shown(&self) -> Option<MethodShown> {
        let instant = self.state.get()?;
        let view = self.parts.stage.view();
        let (gesture, intent) = match self.common.lockstep {
            true => (self.decision.get()?, self.intent.get()?),
            false => self.heard.shown(),
        };
        Some(MethodShown {
            method: view.name,
            gesture: gesture.gesture,
            recognised: gesture.recognised,
            confidence: gesture.confidence,
            effort: gesture.effort,
            hand: instant.hand,
            gaze: intent.gaze,
            stop: view.stop,
            target: view.target,
            planner: view.planner,
            mode: view.mode,
            goal: instant.actuation.goal.clone(),
        })
    }

    /// Stops when a stage that promised to speak fell silent.
    fn watch_others(&mut self) {
        let now = self.common.now();
        let silent = |at: &SimTime| now.millis_since(*at) > SILENCE_MS;
        let lost: Vec<String> =
            self.others.iter().filter(|(_, at)| silent(at)).map(|(name, _)| name.clone()).collect();
        for name in lost {
            self.others.remove(&name);
            let reason = format!("{name} is silent for {SILENCE_MS} ms: no motion until it is back");
            self.common.faults.refuse("heartbeat", &reason);
            self.lost.insert(name);
            self.heard.sign(InputSource::Stage, SignKind::Closed);
        }
    }

    /// A stage said that it lives.
    fn hear_other(&mut self, name: String) {
        let now = self.common.now();
        if self.lost.remove(&name) && self.lost.is_empty() {
            self.heard.sign(InputSource::Stage, SignKind::Alive);
        }
        self.others.insert(name, now);
    }

    /// Somebody else may have taken the arm, or held it, while the method believes that it follows a path.
    fn watch_arm(&mut self, now: SimTime, input: &mut TickInput) {
        let Some(instant) = self.state.get() else { return };
        let Some(since) = self.commanded_at else { return };
        let executes = matches!(self.parts.stage.view().planner, proact_types::PlannerView::Executing { .. });
        let held = instant.actuation.motion == MotionState::Holding;
        if !(executes && held) || now.millis_since(since) < SETTLING_MS {
            return;
        }
        self.commanded_at = None;
        self.common.faults.refuse("arm", "the arm was stopped by somebody else; the path is given up");
        // Lost for a tick, so that a relaxed hand is waited for.
        let _ = input.signs.try_push(InputSign { source: InputSource::Stage, kind: SignKind::Closed });
        self.heard.sign(InputSource::Stage, SignKind::Alive);
    }
}
