//! What the method listens to.

use super::MethodNode;
use crate::{
    joy,
    messages::{
        geometry_msgs::{PoseStamped, Vector3Stamped},
        proact_msgs::{Decision, Intent, Person, State},
        sensor_msgs::Joy,
        std_msgs::String as Text,
    },
    node::{NodeError, RosGraph, convert, graph::Jobs, stage::Stage, wire},
};
use proact_emg::EmgOutput;
use proact_messages::original::relative;
use proact_testbed::stages::{EmgStageOutput, GazeHeard, IntentOutput};
use proact_types::{
    Gesture, HandState, InputSign, InputSource, JointVector, MAX_SIGNS, MethodStyle, ObjectId, Point, Pose,
    Scene, SignKind, SimTime, TickInput,
};
use rosrust::Subscriber;
use std::collections::VecDeque;

/// A block that nobody has looked at for this long is not highlighted, ms.
const LOOK_MS: u64 = 500;
/// Decisions that wait for a step, at most: half a second of them.
const MOST_DECISIONS: usize = 50;

/// In real time: what came since the last step, and what holds on.
pub(super) struct Heard {
    /// From our EMG stage: decisions in their order, then what it said last.
    decisions: VecDeque<EmgStageOutput>,
    gesture: EmgStageOutput,
    /// The newest decision, and its tick.
    decided: Option<(SimTime, Option<Box<EmgOutput>>)>,
    intent: IntentOutput,
    /// When somebody else's block was looked at, and the telling kind of messages about gaze with its last values.
    highlighted_at: Option<SimTime>,
    told: (GazeWord, Vec<f64>),
    signs: Vec<InputSign>,
    shoulder: Option<Pose>,
    limb: Option<JointVector>,
    tracked: bool,
    /// The gesture and intent of the last step.
    shown: (EmgStageOutput, IntentOutput),
    joy: Gesture,
    /// The newest gesture is the joystick's, whose silence counts then.
    joy_acts: bool,
}

/// Messages of other people that tell of the gaze, the least telling first. Once a more telling one has come, the others
/// say nothing about the eye tracker.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
enum GazeWord {
    #[default]
    Nothing,
    /// The block that is looked at: it may rightly stay the same.
    Block,
    /// Where the gaze meets the table.
    Table,
}

impl Heard {
    pub(super) fn new(scene: &Scene) -> Self {
        // Before the first gaze the place is the middle of where objects may be put.
        let place = scene.put_down.centre(scene.table_height);
        let intent = IntentOutput { place, ..IntentOutput::default() };
        Self {
            decisions: VecDeque::new(),
            gesture: EmgStageOutput::default(),
            decided: None,
            intent,
            highlighted_at: None,
            told: Default::default(),
            signs: vec![],
            shoulder: None,
            limb: None,
            tracked: false,
            shown: Default::default(),
            joy: Gesture::NoMotion,
            joy_acts: false,
        }
    }

    pub(super) fn sign(&mut self, source: InputSource, kind: SignKind) {
        let sign = InputSign { source, kind };
        if self.signs.len() < MAX_SIGNS && !self.signs.contains(&sign) {
            self.signs.push(sign);
        }
    }

    /// What a step at `now` acts on. What came once is gone then.
    pub(super) fn take(&mut self, now: SimTime) -> (EmgStageOutput, IntentOutput, TickInput) {
        let mut gesture = self.gesture.clone();
        if let Some(decision) = self.decisions.pop_front() {
            gesture = decision;
        }
        (self.gesture.message, self.gesture.decision) = (None, None);
        self.gesture.events.clear();
        let mut intent = self.intent.clone();
        self.intent.heard = None;
        self.intent.events.clear();
        if self.highlighted_at.is_some_and(|at| now.millis_since(at) > LOOK_MS) {
            self.highlighted_at = None;
            self.intent.highlight = None;
            intent.highlight = None;
        }
        let input = TickInput {
            signs: self.signs.drain(..).take(MAX_SIGNS).collect(),
            shoulder: self.shoulder.filter(|_| std::mem::take(&mut self.tracked)),
            limb: self.limb.take(),
            ..TickInput::default()
        };
        (gesture, intent, input)
    }

    /// What the last step acted on.
    pub(super) fn shows(&mut self, gesture: &EmgStageOutput, intent: &IntentOutput) {
        self.shown = (gesture.clone(), intent.clone());
    }

    pub(super) fn shown(&self) -> (&EmgStageOutput, &IntentOutput) {
        (&self.shown.0, &self.shown.1)
    }

    /// Somebody else's message tells of the gaze: with values that differ from those before, unless it is frozen.
    fn hear_gaze(&mut self, now: SimTime, word: GazeWord, values: &[f64]) {
        self.intent.seen_at = Some(now);
        if word < self.told.0 {
            return;
        }
        let repeats = word != GazeWord::Block && self.told.0 == word && self.told.1 == values;
        self.told = (word, values.to_vec());
        self.intent.heard = Some(if repeats { GazeHeard::Repeated } else { GazeHeard::Fresh });
    }
}

pub(super) fn listen(graph: &RosGraph, jobs: &Jobs<MethodNode>) -> Result<Vec<Subscriber>, NodeError> {
    let mut all = listen_to_stages(graph, jobs)?;
    all.extend(listen_to_others(graph, jobs)?);
    Ok(all)
}

/// What our own stages say, in typed messages.
fn listen_to_stages(graph: &RosGraph, jobs: &Jobs<MethodNode>) -> Result<Vec<Subscriber>, NodeError> {
    Ok(vec![
        graph.listen("proact/state", 100, jobs, |node: &mut MethodNode, m: State| {
            match wire::read_state(&m, node.counts) {
                Ok(instant) => {
                    if !node.common.lockstep {
                        // A simulator that was started again counts anew.
                        node.state = Default::default();
                    }
                    let new = node.state.take(SimTime(m.tick), instant);
                    node.answer(new);
                }
                Err(reason) => node.common.faults.refuse("state", &reason),
            }
        })?,
        graph.listen_from("proact/person", 100, jobs, |node: &mut MethodNode, m: Person, caller| {
            if node.common.prefer(caller) {
                // What it said of its shoulder in the original's type may have come first.
                node.heard.sign(InputSource::ShoulderTracker, SignKind::Closed);
            }
            match wire::read_person(&m) {
                Ok((input, _)) if node.common.lockstep => {
                    let new = node.person.take(SimTime(m.tick), input);
                    node.answer(new);
                }
                Ok((input, _)) => {
                    node.heard.tracked |= input.shoulder.is_some();
                    node.heard.shoulder = input.shoulder.or(node.heard.shoulder);
                    node.heard.limb = input.limb.or(node.heard.limb.take());
                    for sign in input.signs {
                        node.heard.sign(sign.source, sign.kind);
                    }
                }
                Err(reason) => node.common.faults.refuse("person", &reason),
            }
        })?,
        graph.listen_from("proact/decision", 100, jobs, |node: &mut MethodNode, m: Decision, caller| {
            node.common.prefer(caller);
            match wire::read_decision(&m) {
                Ok(output) if node.common.lockstep => {
                    let new = node.decision.take(SimTime(m.tick), output);
                    node.answer(new);
                }
                Ok(output) => node.decide(SimTime(m.tick), output),
                Err(reason) => node.common.faults.refuse("decision", &reason),
            }
        })?,
        graph.listen_from("proact/intent", 100, jobs, |node: &mut MethodNode, m: Intent, caller| {
            node.common.prefer(caller);
            match wire::read_intent(&m, node.counts.objects) {
                Ok(output) if node.common.lockstep => {
                    let new = node.intent.take(SimTime(m.tick), output);
                    node.answer(new);
                }
                Ok(output) => {
                    // The stage's ticks are not quite these; a measurement that waits is not to be lost.
                    let heard = match node.heard.intent.heard {
                        Some(GazeHeard::Fresh) => Some(GazeHeard::Fresh),
                        before => output.heard.or(before),
                    };
                    node.heard.highlighted_at = output.highlight.map(|_| node.common.now());
                    node.heard.intent = IntentOutput { heard, ..output };
                }
                Err(reason) => node.common.faults.refuse("intent", &reason),
            }
        })?,
        graph.listen("proact/heartbeat", 100, jobs, |node: &mut MethodNode, m: Text| {
            if m.data != rosrust::name() && !node.common.lockstep {
                node.hear_other(m.data);
            }
        })?,
    ])
}

/// What other people's nodes say, in the original's types.
fn listen_to_others(graph: &RosGraph, jobs: &Jobs<MethodNode>) -> Result<Vec<Subscriber>, NodeError> {
    Ok(vec![
        graph.listen_from(relative::EMG, 1, jobs, |node: &mut MethodNode, m: Text, caller| {
            if node.common.is_preferred(caller) {
                return;
            }
            match m.data.parse::<Gesture>() {
                Ok(gesture) => {
                    node.heard.joy_acts = false;
                    node.command(gesture);
                }
                Err(error) => node.common.faults.refuse("emg", &error.to_string()),
            }
        })?,
        graph.listen(relative::JOY, 1, jobs, |node: &mut MethodNode, m: Joy| {
            let gazes = node.parts.method.info().style == MethodStyle::Selecting;
            let closed = matches!(node.hand, HandState::Closed | HandState::Closing);
            let gesture = joy::gesture(&m.axes, &m.buttons, gazes, closed);
            // A joystick at rest repeats itself; it must not talk over the armband.
            if gesture != node.heard.joy || gesture != Gesture::NoMotion {
                (node.heard.joy, node.heard.joy_acts) = (gesture, true);
                node.command(gesture);
            } else if node.heard.joy_acts {
                node.heard.sign(InputSource::GestureTopic, SignKind::Alive);
            }
        })?,
        graph.listen_from(relative::BLOCK_ID, 1, jobs, |node: &mut MethodNode, m: Text, caller| {
            if node.common.is_preferred(caller) {
                return;
            }
            let now = node.common.now();
            let mut objects = node.parts.scene.objects.iter();
            match objects.position(|object| object.ros_name == m.data).map(ObjectId::new) {
                Some(block) => {
                    node.heard.intent.highlight = Some(block);
                    node.heard.highlighted_at = Some(now);
                    node.heard.hear_gaze(now, GazeWord::Block, &[]);
                }
                None => node.common.faults.refuse("block_id", &format!("{:?} is no object", m.data)),
            }
        })?,
        graph.listen_from(
            relative::GAZE_HIT,
            1,
            jobs,
            |node: &mut MethodNode, m: Vector3Stamped, caller| {
                if node.common.is_preferred(caller) {
                    return;
                }
                let point = Point::new(m.vector.x, m.vector.y, m.vector.z);
                if !point.iter().all(|v| v.is_finite()) {
                    return node.common.faults.refuse("gaze", "the gaze's place on the table is not finite");
                }
                node.heard.intent.place = point;
                node.heard.hear_gaze(node.common.now(), GazeWord::Table, point.coords.as_slice());
            },
        )?,
        // The simulator judges the pose; here it only counts that it comes and moves.
        graph.listen_from(relative::SHOULDER, 1, jobs, |node: &mut MethodNode, m: PoseStamped, caller| {
            let pose = convert::read_pose(&m.pose);
            let Some(pose) = pose.ok().filter(|_| !node.common.is_preferred(caller)) else { return };
            let repeats = node.heard.shoulder.replace(pose) == Some(pose);
            node.heard.tracked = true;
            let kind = if repeats { SignKind::Repeated } else { SignKind::Fresh };
            node.heard.sign(InputSource::ShoulderTracker, kind);
        })?,
    ])
}

impl MethodNode {
    /// In lock-step: whoever sent an old message has not heard what was said since.
    fn answer(&mut self, new: bool) {
        if !new {
            let done = self.repeat();
            self.common.note("publish", done);
        }
    }

    /// What our EMG stage says. A change of gesture, and a message, act at once.
    fn decide(&mut self, tick: SimTime, output: EmgStageOutput) {
        // After a restart of the master a connection may be there twice, and every message come twice.
        if output.decision.is_some() {
            let decided = Some((tick, output.decision.clone()));
            if self.heard.decided == decided {
                return;
            }
            self.heard.decided = decided;
        }
        let acts = output.message.is_some() || output.gesture != self.heard.gesture.gesture;
        let kept = EmgStageOutput { message: None, decision: None, events: vec![], ..output.clone() };
        self.heard.gesture = kept;
        if output.decision.is_some() && self.heard.decisions.len() < MOST_DECISIONS {
            self.heard.decisions.push_back(output);
        }
        if acts {
            self.act_now();
        }
    }

    /// A gesture from somebody else's topic or a joystick. Acts at once, between two ticks.
    fn command(&mut self, gesture: Gesture) {
        let decided_at = Some(self.common.now());
        let (confidence, effort) = (1.0, 1.0);
        let (message, recognised) = (Some(gesture), gesture.into());
        self.heard.gesture = EmgStageOutput {
            gesture,
            recognised,
            message,
            decided_at,
            confidence,
            effort,
            ..EmgStageOutput::default()
        };
        for kind in [SignKind::Commands, SignKind::Alive] {
            self.heard.sign(InputSource::GestureTopic, kind);
        }
        self.act_now();
    }

    fn act_now(&mut self) {
        let done = self.act(self.common.now());
        self.common.note("publish", done);
    }
}
