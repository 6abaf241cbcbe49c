//! The digest: what makes two trials the same, and tells where they part.
//!
//! Every tick feeds the inputs and the outputs of each stage into one hash per field. Every 100 ticks these close
//! a span, and the span is chained to those before it. Numbers enter as their bits: equal means bit for bit.

use crate::stages::{ActuationOutput, EmgStageOutput, IntentOutput, MethodOutput};
use blake3::Hasher;
use proact_tasks::TaskState;
use proact_types::{
    ExternalAnswer, JointGoal, ObjectId, PlantState, Pose, SimTime, Stop, TaskGoal, TickInput, Vector,
    WindowAnswer,
};
use serde::{Deserialize, Serialize};

/// Ticks in a span.
pub const SPAN_TICKS: u64 = 100;

/// What is hashed, in the order of the tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DigestField {
    /// EMG samples that came in.
    InputEmg,
    /// Gestures given directly, and signs of life of live sources.
    InputGesture,
    /// Gaze that came in.
    InputGaze,
    /// Tracked shoulder poses that came in.
    InputShoulder,
    /// Tracked angles of the person's own limb that came in.
    InputLimb,
    /// Plans that took effect.
    InputPlan,
    /// Answers of a method in another process.
    InputMethod,
    /// Decisions of the EMG stage.
    Emg,
    /// Posterior over objects, and the place point.
    Intent,
    /// Commands of the control method.
    Control,
    /// Joint targets.
    Motion,
    /// Joint angles and speeds.
    Joints,
    /// Poses and speeds of the objects, and what is attached.
    Blocks,
    /// State of the task.
    Task,
}

impl DigestField {
    /// All fields in order.
    pub const ALL: [DigestField; 14] = [
        DigestField::InputEmg,
        DigestField::InputGesture,
        DigestField::InputGaze,
        DigestField::InputShoulder,
        DigestField::InputLimb,
        DigestField::InputPlan,
        DigestField::InputMethod,
        DigestField::Emg,
        DigestField::Intent,
        DigestField::Control,
        DigestField::Motion,
        DigestField::Joints,
        DigestField::Blocks,
        DigestField::Task,
    ];

    /// Stage and field as reported, such as `dynamics.joints`.
    pub fn name(self) -> &'static str {
        [
            "input.emg",
            "input.gesture",
            "input.gaze",
            "input.shoulder",
            "input.limb",
            "input.plan",
            "input.method",
            "emg.decision",
            "intent.posterior",
            "control.commands",
            "motion.targets",
            "dynamics.joints",
            "dynamics.objects",
            "task.state",
        ][self as usize]
    }
}

/// The digest of one span of ticks.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SpanDigest {
    /// Last tick of the span.
    pub tick: SimTime,
    /// One hash per field in [`DigestField::ALL`] order, 16 hexadecimal digits each.
    pub fields: Vec<String>,
    /// Hash of this span and all before it, 64 hexadecimal digits.
    #[serde(rename = "chain")]
    pub chain_hash: String,
}

/// Collects a trial's digest.
#[derive(Clone, Debug)]
pub struct Digest {
    /// What each field has said in the present span. In one piece it is hashed several times as fast as number by number:
    /// BLAKE3 takes its chunks of 1 KiB side by side.
    fields: Vec<Vec<u8>>,
    chain: blake3::Hash,
    ticks_in_span: u64,
}

impl Digest {
    /// A digest that begins with the configuration.
    pub fn new(configuration: &str) -> Self {
        Self {
            fields: vec![Vec::new(); DigestField::ALL.len()],
            chain: blake3::hash(configuration.as_bytes()),
            ticks_in_span: 0,
        }
    }

    /// Where the numbers of `field` go.
    pub fn field(&mut self, field: DigestField) -> FieldDigest<'_> {
        FieldDigest(&mut self.fields[field as usize])
    }

    /// What entered the tick.
    pub fn input(&mut self, input: &TickInput) {
        for sample in &input.emg {
            self.field(DigestField::InputEmg).word(sample.counter).numbers(&sample.channels);
        }
        if let Some(command) = input.command {
            self.field(DigestField::InputGesture).word(command.index() as u64);
        }
        for heartbeat in &input.heartbeats {
            let mut field = self.field(DigestField::InputGesture);
            field.word(heartbeat.source.index() as u64).word(heartbeat.kind as u64);
        }
        if let Some(gaze) = &input.gaze {
            let mut field = self.field(DigestField::InputGaze);
            field.vector(&gaze.origin.coords).vector(&gaze.direction).word(u64::from(gaze.valid));
        }
        if let Some(pose) = &input.shoulder {
            self.field(DigestField::InputShoulder).pose(pose);
        }
        if let Some(limb) = &input.limb {
            self.field(DigestField::InputLimb).numbers(limb);
        }
    }

    /// What the EMG stage said.
    pub fn emg(&mut self, output: &EmgStageOutput) {
        // Without a process that decodes there are none, and nothing enters.
        for answer in &output.answers {
            let mut field = self.field(DigestField::InputEmg);
            match answer {
                WindowAnswer::Line(text) => field.word(0).text(text),
                WindowAnswer::TimedOut { deadline_ms } => field.word(1).word(*deadline_ms),
                WindowAnswer::Failed(reason) => field.word(2).text(reason),
            };
        }
        if let Some(decision) = &output.decision {
            let mut field = self.field(DigestField::Emg);
            field.word(decision.class_index as u64).numbers(&decision.posterior);
        }
        // Without a regressor there are none, and nothing enters.
        if !output.drives.is_empty() {
            self.field(DigestField::Emg).numbers(&output.drives);
        }
    }

    /// What the intent stage said of a new gaze.
    pub fn intent(&mut self, output: &IntentOutput) {
        // Without a model in another process there is none, and nothing enters.
        if let Some(answer) = &output.answer {
            self.field(DigestField::InputGaze).answer(answer);
        }
        if output.gaze_freshness.is_some() {
            let mut field = self.field(DigestField::Intent);
            field.numbers(&output.posterior).vector(&output.place_point.coords);
        }
    }

    /// What the method asked for, and what stopped it.
    pub fn method(&mut self, output: &MethodOutput, stop: Option<&Stop>) {
        if let Some(reply) = &output.plan {
            let mut field = self.field(DigestField::InputPlan);
            field.word(reply.id).word(reply.status as u64).text(&reply.reason);
            for point in &reply.trajectory.points {
                field.number(point.time_secs).numbers(&point.q).numbers(&point.qd);
            }
        }
        if let Some(answer) = &output.answer {
            self.field(DigestField::InputMethod).answer(answer);
        }
        if output.has_stepped {
            let mut field = self.field(DigestField::Control);
            field
                .word(u64::from(output.motion.is_some()))
                .word(output.hand.map_or(0, |hand| hand as u64 + 1))
                .word(output.method_event_count as u64);
            if let Some(stop) = stop {
                field.word(stop.source.index() as u64).word(stop.cause as u64);
            }
        }
    }

    /// What was asked of the joints.
    pub fn actuation(&mut self, output: &ActuationOutput) {
        let command = &output.command;
        self.field(DigestField::Motion).numbers(&command.position).pose(&command.world_from_base);
    }

    /// The world after its step, and the object that was attached while the physics moved.
    pub fn world(&mut self, state: &PlantState, carried: Option<usize>) {
        self.field(DigestField::Joints).numbers(&state.position).numbers(&state.velocity);
        let mut field = self.field(DigestField::Blocks);
        for body in &state.objects {
            field.pose(&body.pose).vector(&body.linear_velocity).vector(&body.angular_velocity);
        }
        field.word(carried.map_or(u64::MAX, |block| block as u64));
    }

    /// The task, with the object in the hand.
    pub fn task(&mut self, state: &TaskState, held: Option<ObjectId>) {
        let mut field = self.field(DigestField::Task);
        // None is 9, so that what comes after 8 moves up by one.
        let object_code =
            |object: Option<ObjectId>| object.map_or(9, |id| u64::from(id.0) + u64::from(id.0 >= 9));
        field.word(u64::from(state.score)).word(object_code(state.next_object));
        field.word(object_code(held)).word(u64::from(state.finished));
        match &state.goal {
            None => {}
            Some(TaskGoal::Disc { center, radius }) => {
                field.word(1).vector(&center.coords).number(*radius);
            }
            Some(TaskGoal::Ball { center, radius }) => {
                field.word(2).vector(&center.coords).number(*radius);
            }
            Some(TaskGoal::Posture { joints }) => {
                field.word(3);
                for JointGoal { joint, angle, tolerance } in joints {
                    field.word(u64::from(*joint)).number(*angle).number(*tolerance);
                }
            }
        }
    }

    /// Ends tick `now`; the span's digest if it closes one. `last` closes it early, at the end of a trial.
    pub fn end_tick(&mut self, now: SimTime, last: bool) -> Option<SpanDigest> {
        self.ticks_in_span += 1;
        if self.ticks_in_span < SPAN_TICKS && !last {
            return None;
        }
        self.ticks_in_span = 0;
        let mut chain = Hasher::new();
        chain.update(self.chain.as_bytes());
        let mut fields = Vec::with_capacity(DigestField::ALL.len());
        for field in &mut self.fields {
            let hash = blake3::hash(field);
            chain.update(hash.as_bytes());
            fields.push(hash.to_hex()[..16].to_owned());
            field.clear();
        }
        self.chain = chain.finalize();
        Some(SpanDigest { tick: now, fields, chain_hash: self.chain.to_hex().to_string() })
    }

    /// The trial's digest so far: the chain up to the last closed span.
    pub fn value(&self) -> String {
        self.chain.to_hex().to_string()
    }
}

/// Takes the numbers of one field.
pub struct FieldDigest<'a>(&'a mut Vec<u8>);

impl FieldDigest<'_> {
    /// A number, by its bits.
    pub fn number(&mut self, value: f64) -> &mut Self {
        self.0.extend_from_slice(&value.to_bits().to_le_bytes());
        self
    }

    /// Several numbers, preceded by how many.
    pub fn numbers(&mut self, values: &[f64]) -> &mut Self {
        self.word(values.len() as u64);
        // In one piece: a tick has some hundred numbers.
        let start = self.0.len();
        self.0.resize(start + 8 * values.len(), 0);
        for (bytes, value) in self.0[start..].as_chunks_mut().0.iter_mut().zip(values) {
            *bytes = value.to_bits().to_le_bytes();
        }
        self
    }

    /// A whole number.
    pub fn word(&mut self, value: u64) -> &mut Self {
        self.0.extend_from_slice(&value.to_le_bytes());
        self
    }

    /// Text, preceded by its length.
    pub fn text(&mut self, value: &str) -> &mut Self {
        self.word(value.len() as u64);
        self.0.extend_from_slice(value.as_bytes());
        self
    }

    /// The answer of a part in another process.
    fn answer(&mut self, answer: &ExternalAnswer) -> &mut Self {
        let number = match answer {
            ExternalAnswer::Failed(_) => 0,
            ExternalAnswer::Line(_) => 1,
            ExternalAnswer::TimedOut(_) => 2,
        };
        self.word(number).text(answer.text())
    }

    /// A vector.
    pub fn vector(&mut self, value: &Vector) -> &mut Self {
        self.numbers(value.as_slice())
    }

    /// A pose: translation, then quaternion.
    pub fn pose(&mut self, value: &Pose) -> &mut Self {
        self.vector(&value.translation.vector).numbers(value.rotation.coords.as_slice())
    }
}

/// Where two trials part.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Divergence {
    /// First tick of the first span that differs.
    pub from: SimTime,
    /// Its last tick.
    pub to: SimTime,
    /// Names of the fields that differ in it, in the order of the tick: the first is the likely cause.
    pub fields: Vec<String>,
}

/// Compares a recorded chain with a recomputed one; none if they agree.
pub fn first_divergence(recorded: &[SpanDigest], recomputed: &[SpanDigest]) -> Option<Divergence> {
    let spans = recorded.len().max(recomputed.len());
    let k = (0..spans).find(|&k| recorded.get(k) != recomputed.get(k))?;
    let from = SimTime(k as u64 * SPAN_TICKS + 1);
    match (recorded.get(k), recomputed.get(k)) {
        (Some(a), Some(b)) => {
            let differing = |(field, (x, y)): (&DigestField, (&String, &String))| {
                (x != y).then(|| field.name().to_owned())
            };
            let mut fields: Vec<String> =
                DigestField::ALL.iter().zip(a.fields.iter().zip(&b.fields)).filter_map(differing).collect();
            if a.tick != b.tick {
                fields.push("length".to_owned());
            } else if fields.is_empty() {
                fields.push("configuration".to_owned());
            }
            Some(Divergence { from, to: a.tick.max(b.tick), fields })
        }
        (one, other) => {
            let to = one.or(other).map_or(from, |span| span.tick);
            Some(Divergence { from, to, fields: vec!["length".to_owned()] })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chain(configuration: &str, change: Option<(u64, f64)>) -> Vec<SpanDigest> {
        let mut digest = Digest::new(configuration);
        (1..=350)
            .filter_map(|tick| {
                let joint = change.filter(|c| c.0 == tick).map_or(1.0, |c| c.1);
                digest.field(DigestField::Joints).number(joint);
                digest.field(DigestField::InputEmg).word(tick);
                digest.end_tick(SimTime(tick), tick == 350)
            })
            .collect()
    }

    #[test]
    fn equal_trials_agree_and_the_smallest_change_of_a_number_is_named() {
        let recorded = chain("a", None);
        assert_eq!(recorded.len(), 4);
        assert_eq!(first_divergence(&recorded, &chain("a", None)), None);
        let changed = chain("a", Some((250, 1.0 + f64::EPSILON)));
        let expected =
            Divergence { from: SimTime(201), to: SimTime(300), fields: vec!["dynamics.joints".into()] };
        assert_eq!(first_divergence(&recorded, &changed), Some(expected));
    }

    #[test]
    fn another_configuration_and_another_length_are_told_apart() {
        let recorded = chain("a", None);
        let other = first_divergence(&recorded, &chain("b", None)).expect("differs");
        assert_eq!(other.fields, ["configuration"]);
        let shorter = first_divergence(&recorded, &recorded[..3]).expect("differs");
        assert_eq!((shorter.fields, shorter.to), (vec!["length".to_owned()], SimTime(350)));
    }
}
