use crate::EmgError;
use crate::calibration::prompted_gestures;
use proact_types::{Command, Gesture, SimTime};
use serde::{Deserialize, Serialize};

/// How the sequence test is done.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SequenceConfig {
    /// The prescribed order.
    pub order: Vec<Gesture>,
    /// The gesture of a relaxed hand, which is no mistake on the way. Default `no_motion`.
    pub rest: Gesture,
    /// Sequences without a mistake, one after the other, that pass. Default 3 (ProACT, arXiv:2407.05025, Study 2).
    #[serde(rename = "in_a_row")]
    pub required_consecutive: usize,
    /// Sequences after which the test is failed. Default 12: four times as many as are needed.
    pub attempts: usize,
    /// A gesture must be in force within so many seconds of its prompt. Default 5.
    pub limit_secs: f64,
    /// And stay in force for so many. Default 0.5, ten decisions.
    pub hold_secs: f64,
}

impl Default for SequenceConfig {
    fn default() -> Self {
        SequenceConfig::for_gestures(&Command::ALL.map(Gesture::from), Gesture::default())
    }
}

impl SequenceConfig {
    /// The default test of the gestures of a model: all that move, then `rest`.
    pub fn for_gestures(gestures: &[Gesture], rest: Gesture) -> SequenceConfig {
        SequenceConfig {
            order: prompted_gestures(gestures, rest).chain([rest]).collect(),
            rest,
            required_consecutive: 3,
            attempts: 12,
            limit_secs: 5.0,
            hold_secs: 0.5,
        }
    }
}

/// A mistake in a sequence.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct SequenceMistake {
    /// Sequence in which it was made, from 0.
    pub attempt: usize,
    /// What was asked for.
    pub prompt: Gesture,
    /// What came into force instead; none if the time ran out.
    pub got: Option<Gesture>,
}

/// How the sequence test went.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct SequenceReport {
    /// As many sequences as asked for went without a mistake, one after the other.
    pub passed: bool,
    /// Sequences begun.
    pub attempts: usize,
    /// Sequences without a mistake up to now, in a row.
    #[serde(rename = "in_a_row")]
    pub consecutive_correct: usize,
    /// All mistakes.
    pub mistakes: Vec<SequenceMistake>,
    /// Seconds from each prompt to its gesture, mean over those that came.
    pub mean_delay_secs: f64,
}

/// The paper's test: all gestures in a prescribed order, several times in a row, without a misclassification.
///
/// What counts is the gesture in force, as it would drive the arm. From a prompt on the gesture before and no motion are
/// no mistake, since the hand has to move; any other gesture is, and so is losing the prompted gesture before it was
/// held long enough. After a mistake the sequence begins anew, and the count of those in a row at zero.
#[derive(Clone, Debug)]
pub struct SequenceTest {
    config: SequenceConfig,
    report: SequenceReport,
    gesture_index: usize,
    previous_gesture: Gesture,
    prompted_at: Option<SimTime>,
    reached: Option<SimTime>,
    delays: Vec<f64>,
    finished: bool,
}

impl SequenceTest {
    /// A test before its first prompt.
    ///
    /// # Errors
    /// An empty order, no sequences, or times that are not above zero.
    pub fn new(config: SequenceConfig) -> Result<SequenceTest, EmgError> {
        let counts = [
            ("gestures of the order", config.order.len()),
            ("in_a_row", config.required_consecutive),
            ("attempts", config.attempts),
        ];
        if let Some((name, _)) = counts.into_iter().find(|(_, count)| *count == 0) {
            return Err(EmgError::OutOfRange { name, value: 0.0, expected: "at least 1" });
        }
        check_positive("limit_secs", config.limit_secs)?;
        check_positive("hold_secs", config.hold_secs)?;
        Ok(SequenceTest {
            previous_gesture: config.rest,
            config,
            report: SequenceReport::default(),
            gesture_index: 0,
            prompted_at: None,
            reached: None,
            delays: Vec::new(),
            finished: false,
        })
    }

    /// Takes the gesture that is in force at `now`. True if the prompt changed, or the test ended.
    pub fn step(&mut self, now: SimTime, in_force: impl Into<Gesture>) -> bool {
        let in_force = in_force.into();
        if self.finished {
            return false;
        }
        let Some(prompted_at) = self.prompted_at else {
            self.prompted_at = Some(now);
            self.report.attempts = 1;
            self.previous_gesture = in_force;
            return true;
        };
        let prompt = self.config.order[self.gesture_index];
        let secs = |since: SimTime| now.millis_since(since) as f64 / 1000.0;
        match self.reached {
            None if in_force == prompt => {
                self.reached = Some(now);
                self.delays.push(secs(prompted_at));
                self.report.mean_delay_secs = self.delays.iter().sum::<f64>() / self.delays.len() as f64;
                false
            }
            None if in_force != self.previous_gesture && in_force != self.config.rest => {
                self.mistake(now, Some(in_force))
            }
            None if secs(prompted_at) > self.config.limit_secs => self.mistake(now, None),
            None => {
                // Once the hand has relaxed, the gesture before must not come back.
                if in_force == self.config.rest {
                    self.previous_gesture = self.config.rest;
                }
                false
            }
            Some(_) if in_force != prompt => self.mistake(now, Some(in_force)),
            Some(since) if secs(since) >= self.config.hold_secs => self.next(now),
            Some(_) => false,
        }
    }

    fn next(&mut self, now: SimTime) -> bool {
        self.previous_gesture = self.config.order[self.gesture_index];
        self.gesture_index += 1;
        if self.gesture_index == self.config.order.len() {
            self.gesture_index = 0;
            self.report.consecutive_correct += 1;
            self.report.passed = self.report.consecutive_correct >= self.config.required_consecutive;
            return self.begin(now);
        }
        (self.prompted_at, self.reached) = (Some(now), None);
        true
    }

    fn mistake(&mut self, now: SimTime, got: Option<Gesture>) -> bool {
        let (attempt, prompt) = (self.report.attempts - 1, self.config.order[self.gesture_index]);
        self.report.mistakes.push(SequenceMistake { attempt, prompt, got });
        self.report.consecutive_correct = 0;
        self.gesture_index = 0;
        // Whatever the hand does now, it did not begin to do it for the new prompt.
        self.previous_gesture = got.unwrap_or(self.previous_gesture);
        self.begin(now)
    }

    fn begin(&mut self, now: SimTime) -> bool {
        self.finished = self.report.passed || self.report.attempts == self.config.attempts;
        if !self.finished {
            self.report.attempts += 1;
        }
        (self.prompted_at, self.reached) = (Some(now), None);
        true
    }

    /// What the person is asked for; none before the first step and after the end.
    pub fn prompt(&self) -> Option<Gesture> {
        (self.prompted_at.is_some() && !self.finished).then(|| self.config.order[self.gesture_index])
    }

    /// Passed or failed for good.
    pub fn is_finished(&self) -> bool {
        self.finished
    }

    /// How it goes.
    pub fn report(&self) -> &SequenceReport {
        &self.report
    }
}

/// How the longer trial is done.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct HoldConfig {
    /// The gestures of the model.
    pub gestures: Vec<Gesture>,
    /// Prompts, one after the other; shuffle them, so that nobody learns the order.
    pub prompts: Vec<Gesture>,
    /// Length of each, seconds. Default 3.
    pub hold_secs: f64,
    /// Seconds after each prompt that do not count: the time to read it and to move. Default 1.
    pub reaction_secs: f64,
    /// Share of decisions that passes. Default 0.75 (ProACT, arXiv:2407.05025, section on limitations).
    #[serde(rename = "target")]
    pub target_accuracy: f64,
}

impl Default for HoldConfig {
    fn default() -> Self {
        let gestures: Vec<Gesture> = Command::ALL.map(Gesture::from).into();
        let prompts = std::iter::repeat_n(&gestures, 4).flatten().copied().collect();
        HoldConfig { gestures, prompts, hold_secs: 3.0, reaction_secs: 1.0, target_accuracy: 0.75 }
    }
}

/// How the longer trial went.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct HoldReport {
    /// The share is reached. False until all prompts are over.
    pub passed: bool,
    /// Share of decisions after the reaction time with the prompted gesture in force.
    pub accuracy: f64,
    /// Decisions counted.
    #[cfg_attr(feature = "ts", ts(type = "number"))]
    pub decisions: u64,
    /// Prompts that are over.
    pub prompts: usize,
    /// The gesture of each row and column.
    pub classes: Vec<Gesture>,
    /// `[prompted][in force]`, decisions.
    #[cfg_attr(feature = "ts", ts(type = "Array<Array<number>>"))]
    pub confusion: Vec<Vec<u64>>,
}

/// The longer trial: gestures are prompted one after the other, each is held, and the share of decisions that are right
/// counts. A stale stream counts as rest, since it stops the arm.
#[derive(Clone, Debug)]
pub struct HoldTest {
    config: HoldConfig,
    report: HoldReport,
    prompted_at: Option<SimTime>,
}

impl HoldTest {
    /// A trial before its first prompt.
    ///
    /// # Errors
    /// No prompts, one that is none of the gestures, times that are not above zero, or a reaction time as long as a prompt.
    pub fn new(config: HoldConfig) -> Result<HoldTest, EmgError> {
        if config.prompts.is_empty() {
            return Err(EmgError::OutOfRange { name: "prompts", value: 0.0, expected: "at least 1" });
        }
        if let Some(unknown) = config.prompts.iter().find(|prompt| !config.gestures.contains(prompt)) {
            return Err(EmgError::NotTrained(*unknown));
        }
        check_positive("hold_secs", config.hold_secs)?;
        if !(0.0..config.hold_secs).contains(&config.reaction_secs) {
            let expected = "at least 0 and less than hold_secs";
            return Err(EmgError::OutOfRange {
                name: "reaction_secs",
                value: config.reaction_secs,
                expected,
            });
        }
        if !(0.0..=1.0).contains(&config.target_accuracy) {
            return Err(EmgError::OutOfRange {
                name: "target",
                value: config.target_accuracy,
                expected: "0 to 1",
            });
        }
        let classes = config.gestures.clone();
        let confusion = vec![vec![0; classes.len()]; classes.len()];
        Ok(HoldTest {
            config,
            report: HoldReport { classes, confusion, ..HoldReport::default() },
            prompted_at: None,
        })
    }

    /// Advances to `now`, with the gesture in force if there was a decision. True if the prompt changed, or the trial
    /// ended.
    pub fn step<G: Into<Gesture>>(&mut self, now: SimTime, decided: Option<G>) -> bool {
        let Some(prompt) = self.config.prompts.get(self.report.prompts).copied() else { return false };
        let Some(prompted_at) = self.prompted_at else {
            self.prompted_at = Some(now);
            return true;
        };
        let secs = now.millis_since(prompted_at) as f64 / 1000.0;
        if secs >= self.config.hold_secs {
            self.prompted_at = Some(now);
            self.report.prompts += 1;
            self.report.passed = self.is_finished()
                && self.report.decisions > 0
                && self.report.accuracy >= self.config.target_accuracy;
            return true;
        }
        if let Some(gesture) = decided.filter(|_| secs >= self.config.reaction_secs) {
            let gesture = gesture.into();
            let index = |of: Gesture| self.config.gestures.iter().position(|known| *known == of);
            if let (Some(row), Some(column)) = (index(prompt), index(gesture)) {
                self.report.confusion[row][column] += 1;
            }
            self.report.decisions += 1;
            let right: u64 = (0..self.report.classes.len()).map(|k| self.report.confusion[k][k]).sum();
            self.report.accuracy = right as f64 / self.report.decisions as f64;
        }
        false
    }

    /// What the person is asked for; none before the first step and after the end.
    pub fn prompt(&self) -> Option<Gesture> {
        self.prompted_at.and_then(|_| self.config.prompts.get(self.report.prompts).copied())
    }

    /// All prompts are over.
    pub fn is_finished(&self) -> bool {
        self.report.prompts == self.config.prompts.len()
    }

    /// How it goes.
    pub fn report(&self) -> &HoldReport {
        &self.report
    }
}

pub(crate) fn check_positive(name: &'static str, value: f64) -> Result<(), EmgError> {
    if (1e-6..=1e6).contains(&value) {
        return Ok(());
    }
    Err(EmgError::OutOfRange { name, value, expected: "0.000001 to 1000000" })
}

#[cfg(test)]
mod tests {
    use super::*;
    use Command::{HandClose, HandOpen, NoMotion, WristFlexion};

    /// Steps every 50 ms; the person makes `act(prompt)`, in force 300 ms after the prompt.
    fn run(test: &mut SequenceTest, mut act: impl FnMut(usize, Gesture) -> Gesture) {
        let (mut since, mut in_force, mut prompts) = (0, Gesture::default(), 0);
        for k in 0..10_000_u64 {
            if test.is_finished() {
                return;
            }
            if k - since == 6
                && let Some(prompt) = test.prompt()
            {
                in_force = act(prompts - 1, prompt);
            }
            if test.step(SimTime(50 * k), in_force) {
                since = k;
                prompts += 1;
            }
        }
    }

    #[test]
    fn three_sequences_without_a_mistake_pass_and_the_delay_is_measured() {
        let mut test = SequenceTest::new(SequenceConfig::default()).expect("good");
        run(&mut test, |_, prompt| prompt);
        let report = test.report();
        assert!(report.passed && report.mistakes.is_empty(), "{report:?}");
        assert_eq!((report.attempts, report.consecutive_correct), (3, 3));
        assert!((report.mean_delay_secs - 0.3).abs() < 0.06, "{report:?}");
        assert_eq!(test.prompt(), None);
    }

    #[test]
    fn one_wrong_gesture_begins_the_count_anew() {
        let mut test = SequenceTest::new(SequenceConfig::default()).expect("good");
        // The seventh prompt is the second of the second sequence: hand open.
        run(&mut test, |k, prompt| if k == 6 { WristFlexion.into() } else { prompt });
        let report = test.report();
        let mistake = SequenceMistake { attempt: 1, prompt: HandOpen.into(), got: Some(WristFlexion.into()) };
        assert_eq!((report.passed, report.attempts, report.mistakes.as_slice()), (true, 5, &[mistake][..]));
    }

    #[test]
    fn a_gesture_that_never_comes_fails_after_the_last_attempt() {
        let config = SequenceConfig { attempts: 4, ..SequenceConfig::default() };
        let mut test = SequenceTest::new(config).expect("good");
        run(&mut test, |_, _| NoMotion.into());
        let report = test.report();
        assert!(!report.passed && test.is_finished());
        assert_eq!(report.mistakes.len(), 4);
        assert!(report.mistakes.iter().all(|m| (m.prompt, m.got) == (HandClose.into(), None)), "{report:?}");
    }

    #[test]
    fn the_longer_trial_counts_decisions_after_the_reaction_time() {
        let prompts = [HandClose, HandOpen, NoMotion, HandClose].map(Gesture::from).into();
        let config = HoldConfig { prompts, ..HoldConfig::default() };
        let mut test = HoldTest::new(config).expect("good");
        for k in 0..400_u64 {
            // Always closed: right for two prompts of four.
            test.step(SimTime(50 * k), Some(HandClose));
        }
        let report = test.report();
        assert!(test.is_finished() && !report.passed, "{report:?}");
        assert_eq!((report.accuracy, report.decisions, report.prompts), (0.5, 160, 4));
        assert_eq!(report.confusion[HandOpen.index()][HandClose.index()], 40);
    }

    #[test]
    fn a_model_of_any_gestures_is_tested_in_its_own_order_with_its_own_rest() {
        let names: Vec<Gesture> =
            ["fist", "hand_open", "point", "relax", "wave"].map(|n| n.parse().expect("a name")).into();
        let config = SequenceConfig::for_gestures(&names, names[3]);
        assert_eq!(config.order, [names[1], names[0], names[2], names[4], names[3]]);
        let mut test = SequenceTest::new(config).expect("good");
        run(&mut test, |_, prompt| prompt);
        assert!(test.report().passed, "{:?}", test.report());
        let config = HoldConfig {
            gestures: names.clone(),
            prompts: vec![names[0], names[4]],
            ..HoldConfig::default()
        };
        let mut test = HoldTest::new(config).expect("good");
        for k in 0..200_u64 {
            test.step(SimTime(50 * k), Some(names[4]));
        }
        assert_eq!(
            (test.report().accuracy, test.report().confusion[0][4], test.report().confusion[4][4]),
            (0.5, 40, 40)
        );
    }

    #[test]
    fn tests_that_cannot_work_are_refused() {
        let order = SequenceConfig { order: vec![], ..SequenceConfig::default() };
        assert!(SequenceTest::new(order).is_err_and(|e| e.to_string().contains("at least 1")));
        let limit = SequenceConfig { limit_secs: f64::NAN, ..SequenceConfig::default() };
        assert!(SequenceTest::new(limit).is_err_and(|e| e.to_string().contains("NaN")));
        let reaction = HoldConfig { reaction_secs: 3.0, ..HoldConfig::default() };
        let unknown = HoldConfig { gestures: vec![HandClose.into()], ..HoldConfig::default() };
        assert!(HoldTest::new(unknown).is_err_and(|e| e.to_string().contains("not trained on hand_open")));
        assert!(HoldTest::new(reaction).is_err_and(|e| e.to_string().contains("less than hold_secs")));
    }
}
