//! An intent model in another program, asked line by line.

use crate::{Candidates, IntentError, IntentOptions, Posterior};
use proact_types::{GazeSample, IntentAnswer, ObjectId, Point, SimTime};
use serde::{Deserialize, Serialize};

/// A program in the place of a model, which reads and writes JSON lines (`docs/intent.md`).
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct IntentProgram {
    /// The program and its arguments. A trial that is run starts it; a replay does not.
    pub command: Vec<String>,
    /// A live gaze without an answer after this time stops the arm, milliseconds; the tick waits for it. A batch waits for
    /// each answer.
    #[serde(default = "IntentProgram::default_deadline_ms")]
    pub deadline_ms: u64,
}

impl IntentProgram {
    /// `command` with the default deadline.
    pub fn new(command: Vec<String>) -> Self {
        Self { command, deadline_ms: Self::default_deadline_ms() }
    }

    /// A page's gaze comes every 17 ms, and a machine with other work to do is late by some.
    fn default_deadline_ms() -> u64 {
        10
    }

    /// Checks ranges.
    ///
    /// # Errors
    /// [`IntentError::Program`] naming the first key that is out of range.
    pub fn check(&self) -> Result<(), IntentError> {
        let bad = |key, got, expected| Err(IntentError::Program { key, got, expected });
        if self.command.first().is_none_or(|program| program.is_empty()) {
            return bad("command", format!("{:?}", self.command), "a program's name first");
        }
        if !(1..=1000).contains(&self.deadline_ms) {
            return bad("deadline_ms", self.deadline_ms.to_string(), "1 to 1000");
        }
        Ok(())
    }
}

/// A process that holds an intent model.
pub trait IntentProcess: Send {
    /// Hands over the line of the gaze at `now` (one JSON object, no line break) and gives the line that answers it. Answers to earlier lines are skipped. Waits for a bounded time.
    fn ask(&mut self, now: SimTime, line: &str) -> IntentAnswer;
}

/// One line to the program: a gaze, and what is known beside it. Lists have the order of the scene; numbers that are not finite
/// arrive as `null`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct IntentRequest {
    /// Milliseconds since the start of the trial; the answer repeats it.
    pub time: SimTime,
    /// The gaze, in `world`; not `valid` during a blink.
    pub gaze: GazeSample,
    /// Centres of the objects in `world`, metres.
    #[serde(rename = "objects")]
    pub object_centers: Vec<Point>,
    /// Which of them may be meant.
    pub pickable: Vec<bool>,
    /// Which of them the task asks for; all of them for a method without task context.
    #[serde(rename = "due")]
    pub expected_objects: Vec<bool>,
    /// What the task says of each by `intent.off_task_weight`; sums to one, all zero where nothing may be meant.
    pub prior: Vec<f64>,
    /// Counts up when a new selection begins.
    pub selection: u32,
    /// The point of the hand that will meet the object, in `world`, metres; none if it is not known.
    pub tip: Option<Point>,
}

impl IntentRequest {
    /// The line of `gaze` at `now` over `scene`.
    pub fn new(now: SimTime, gaze: &GazeSample, scene: &Candidates, options: &IntentOptions) -> Self {
        let count = scene.centers.len();
        let due = |k| scene.context.is_none_or(|context| context.expected_objects.contains(ObjectId::new(k)));
        Self {
            time: now,
            gaze: *gaze,
            object_centers: scene.centers.clone(),
            pickable: scene.valid_candidates(),
            expected_objects: (0..count).map(due).collect(),
            prior: scene.prior(options).unwrap_or_else(|| vec![0.0; count]),
            selection: scene.selection().unwrap_or_default(),
            tip: scene.tip,
        }
    }
}

/// One line from the program.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct IntentResponse {
    /// `time` of the line that it answers.
    pub time: SimTime,
    /// How likely each object is meant: numbers from zero up, in any scale. Those of objects that may not be meant do not count.
    /// `null`, or nothing above zero: the gaze told nothing.
    #[serde(default)]
    pub posterior: Option<Vec<f64>>,
}

/// What an [`ExternalIntentModel`] made of a gaze.
#[derive(Clone, Debug, PartialEq)]
pub struct IntentReply {
    /// Its answer, for the input log.
    pub answer: IntentAnswer,
    /// The posterior, which sums to one; none if the gaze told nothing. Or why the answer cannot be used.
    pub posterior: Result<Option<Posterior>, String>,
}

/// A model that lives in another program: for each gaze a [`IntentRequest`] to it, and within the tick an [`IntentResponse`] from it.
///
/// Deterministic as far as the program is; with the answers of an input log it asks nobody.
pub struct ExternalIntentModel {
    options: IntentOptions,
    process: Option<Box<dyn IntentProcess>>,
}

impl ExternalIntentModel {
    /// Speaks to nobody yet: each answer must come from a log.
    pub fn new(options: IntentOptions) -> Self {
        Self { options, process: None }
    }

    /// From now on speaks to `process`.
    pub fn set_process(&mut self, process: Option<Box<dyn IntentProcess>>) {
        self.process = process;
    }

    /// What the gaze of tick `now` says. `logged` is the answer that the input log has, which is taken instead of asking.
    pub fn observe(
        &mut self,
        now: SimTime,
        gaze: &GazeSample,
        scene: &Candidates,
        logged: Option<&IntentAnswer>,
    ) -> IntentReply {
        let line = IntentRequest::new(now, gaze, scene, &self.options);
        let answer = logged.cloned().unwrap_or_else(|| self.ask(&line));
        let posterior = match &answer {
            IntentAnswer::Line(text) => parse_response(text, &line),
            IntentAnswer::Failed(reason) | IntentAnswer::TimedOut(reason) => Err(reason.clone()),
        };
        IntentReply { answer, posterior }
    }

    fn ask(&mut self, line: &IntentRequest) -> IntentAnswer {
        let Some(process) = &mut self.process else {
            return IntentAnswer::Failed("the log holds no such answer".to_owned());
        };
        match serde_json::to_string(line) {
            Ok(text) => process.ask(line.time, &text),
            Err(error) => IntentAnswer::Failed(error.to_string()),
        }
    }
}

/// The posterior of an answer to `line`, over the objects that may be meant.
fn parse_response(text: &str, line: &IntentRequest) -> Result<Option<Posterior>, String> {
    let excerpt: String = text.chars().take(120).collect();
    let answer: IntentResponse =
        serde_json::from_str(text).map_err(|error| format!("it answered {excerpt:?}: {error}"))?;
    if answer.time != line.time {
        let (got, requested_ms) = (answer.time.0, line.time.0);
        return Err(format!("it answered the gaze of {got} ms, expected {requested_ms} ms"));
    }
    let Some(mut weights) = answer.posterior else { return Ok(None) };
    if weights.len() != line.object_centers.len() {
        let (got, expected) = (weights.len(), line.object_centers.len());
        return Err(format!("posterior has {got} values, expected {expected}, one an object"));
    }
    if let Some(k) = weights.iter().position(|weight| !weight.is_finite() || *weight < 0.0) {
        return Err(format!("posterior {k} is {}, expected a finite number from 0 up", weights[k]));
    }
    for (weight, pickable) in weights.iter_mut().zip(&line.pickable) {
        *weight = if *pickable { *weight } else { 0.0 };
    }
    // By the largest first: the sum of what is finite may not be.
    let largest = weights.iter().copied().fold(0.0, f64::max);
    if largest == 0.0 {
        return Ok(None);
    }
    weights.iter_mut().for_each(|weight| *weight /= largest);
    let sum: f64 = weights.iter().sum();
    weights.iter_mut().for_each(|weight| *weight /= sum);
    Ok(Some(weights))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proact_types::{ObjectSet, TaskContext, Vector};

    /// Answers each line with what it is given for it.
    struct Says(Box<dyn FnMut(IntentRequest) -> IntentAnswer + Send>);

    impl IntentProcess for Says {
        fn ask(&mut self, now: SimTime, line: &str) -> IntentAnswer {
            let line: IntentRequest = serde_json::from_str(line).expect("a line");
            assert_eq!(line.time, now);
            (self.0)(line)
        }
    }

    fn scene() -> Candidates {
        Candidates {
            centers: [0.1, -0.1, 0.2, -0.2].map(|y| Point::new(0.6, y, -0.5)).to_vec(),
            pickable: vec![true, true, false, true],
            context: Some(TaskContext { expected_objects: ObjectSet::first(2), selection_number: 7 }),
            tip: None,
        }
    }

    fn gaze() -> GazeSample {
        GazeSample { origin: Point::origin(), direction: Vector::x(), valid: true }
    }

    fn reply_to(respond: impl FnMut(IntentRequest) -> IntentAnswer + Send + 'static) -> IntentReply {
        let mut model = ExternalIntentModel::new(IntentOptions::default());
        model.set_process(Some(Box::new(Says(Box::new(respond)))));
        model.observe(SimTime(40), &gaze(), &scene(), None)
    }

    fn answered(posterior: &str) -> IntentReply {
        let line = format!("{{\"time\": 40, \"posterior\": {posterior}}}");
        reply_to(move |_| IntentAnswer::Line(line.clone()))
    }

    #[test]
    fn a_program_sees_gaze_and_scene_and_its_numbers_are_brought_to_one_over_what_may_be_meant() {
        let seen = reply_to(|line| {
            assert_eq!(line.expected_objects, [true, true, false, false]);
            assert_eq!(line.pickable, [true, true, false, true]);
            assert_eq!((line.selection, line.prior[2]), (7, 0.0));
            assert!((line.prior.iter().sum::<f64>() - 1.0).abs() < 1e-12);
            assert_eq!(line.gaze, gaze());
            let answer = IntentResponse { time: line.time, posterior: Some(line.prior) };
            IntentAnswer::Line(serde_json::to_string(&answer).expect("numbers"))
        });
        assert!(seen.posterior.is_ok(), "{seen:?}");
        assert_eq!(answered("[1, 2, 5, 1]").posterior, Ok(Some(vec![0.25, 0.5, 0.0, 0.25])));
        assert_eq!(answered("[1e308, 1e308, 0, 0]").posterior, Ok(Some(vec![0.5, 0.5, 0.0, 0.0])));
        for nothing in ["null", "[0, 0, 0, 0]", "[0, 0, 1, 0]"] {
            assert_eq!(answered(nothing).posterior, Ok(None), "{nothing}");
        }
    }

    #[test]
    fn what_cannot_be_used_is_told_with_what_was_got_and_what_was_expected() {
        for (posterior, words) in [
            ("[1, 2]", "posterior has 2 values, expected 4"),
            ("[1, -2, 0, 0]", "posterior 1 is -2, expected a finite number"),
            ("[NaN, 0, 0, 0]", "it answered"),
            ("[null, 0, 0, 0]", "it answered"),
            ("\"red1\"", "it answered"),
            ("[1, 0, 0, 0], \"highlight\": 2", "unknown field"),
        ] {
            let reply = answered(posterior);
            let reason = reply.posterior.expect_err(posterior);
            assert!(reason.contains(words), "{posterior}: {reason}");
            assert!(matches!(reply.answer, IntentAnswer::Line(_)), "what was said belongs to the log");
        }
        let other =
            reply_to(|_| IntentAnswer::Line("{\"time\": 39, \"posterior\": null}".to_owned())).posterior;
        assert_eq!(other, Err("it answered the gaze of 39 ms, expected 40 ms".to_owned()));
        for dead in [IntentAnswer::Failed, IntentAnswer::TimedOut] {
            let reply = reply_to(move |_| dead("it has ended".to_owned()));
            assert_eq!(reply.posterior, Err("it has ended".to_owned()));
        }
    }

    #[test]
    fn a_logged_answer_is_taken_instead_of_asking_and_without_either_nobody_was_asked() {
        let mut model = ExternalIntentModel::new(IntentOptions::default());
        let logged = IntentAnswer::Line("{\"time\":40,\"posterior\":[0,1,0,0]}".to_owned());
        let reply = model.observe(SimTime(40), &gaze(), &scene(), Some(&logged));
        assert_eq!((reply.answer, reply.posterior), (logged, Ok(Some(vec![0.0, 1.0, 0.0, 0.0]))));
        let reply = model.observe(SimTime(40), &gaze(), &scene(), None);
        assert_eq!(reply.posterior, Err("the log holds no such answer".to_owned()));
    }

    #[test]
    fn a_program_is_data_and_what_cannot_be_is_refused_by_name() {
        let program: IntentProgram = toml::from_str("command = [\"python3\", \"model.py\"]").expect("reads");
        assert_eq!((program.deadline_ms, program.check()), (10, Ok(())));
        for (key, bad) in [
            ("command", IntentProgram::new(Vec::new())),
            ("deadline_ms", IntentProgram { deadline_ms: 0, ..program.clone() }),
        ] {
            let error = bad.check().expect_err("refused").to_string();
            assert!(error.starts_with(&format!("intent_process.{key}")), "{error}");
        }
    }
}
