use crate::EmgError;
use crate::usability::check_positive;
use proact_types::{Gesture, SimTime};
use serde::{Deserialize, Serialize};

/// How the motion test is done.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MotionTestConfig {
    /// What is asked for, one after the other: gestures that move.
    pub prompts: Vec<Gesture>,
    /// The gesture of a relaxed hand, which comes before each prompt.
    pub rest: Gesture,
    /// A motion must be complete within so many seconds of its prompt. Default 5 (Kuiken et al. 2009).
    pub limit_secs: f64,
    /// Right decisions that complete a motion, in all and not in a row. Default 10 (Kuiken et al. 2009).
    #[serde(rename = "right")]
    pub required_correct: usize,
    /// Time from one decision that counts to the next, seconds. Default 0.1, as in miniVIE.
    pub poll_secs: f64,
}

impl MotionTestConfig {
    /// The default test: each of `gestures` but `rest`, `repetitions` times; miniVIE has three.
    pub fn for_gestures(gestures: &[Gesture], rest: Gesture, repetitions: usize) -> MotionTestConfig {
        let moving: Vec<Gesture> = gestures.iter().copied().filter(|gesture| *gesture != rest).collect();
        let prompts = moving.repeat(repetitions);
        MotionTestConfig { prompts, rest, limit_secs: 5.0, required_correct: 10, poll_secs: 0.1 }
    }
}

/// One motion that was asked for.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct MotionAttempt {
    /// Which.
    pub prompt: Gesture,
    /// From the first decision that is not rest to the first right one, seconds; none if there was none.
    pub selection_secs: Option<f64>,
    /// From there to the last right decision that was needed, seconds; none if time ran out before.
    pub completion_secs: Option<f64>,
    /// Right decisions.
    #[serde(rename = "right")]
    pub correct: usize,
    /// Decisions that were neither rest nor right.
    #[serde(rename = "wrong")]
    pub incorrect: usize,
}

/// How the motion test went.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct MotionReport {
    /// All motions up to now.
    pub attempts: Vec<MotionAttempt>,
    /// Motions asked for in the whole test.
    #[serde(rename = "asked")]
    pub prompt_count: usize,
    /// Share of the motions up to now that were completed.
    pub completion_rate: f64,
    /// Mean over the motions that were selected, seconds; none before one was.
    pub mean_selection_secs: Option<f64>,
    /// Mean over the motions that were completed, seconds; none before one was.
    pub mean_completion_secs: Option<f64>,
}

/// The motion test: how fast, and how surely, each motion is selected and kept (T. A. Kuiken et al., JAMA 301(6), 2009, 619-628).
/// The limb stands still. Before each prompt the hand relaxes.
#[derive(Clone, Debug)]
pub struct MotionTest {
    config: MotionTestConfig,
    report: MotionReport,
    last_decision_at: Option<SimTime>,
    /// Since when the motion is asked for; none while the hand has yet to relax.
    prompted_at: Option<SimTime>,
    /// The first decision that is not rest.
    onset: Option<SimTime>,
    attempt: Option<MotionAttempt>,
}

impl MotionTest {
    /// A test before its first prompt.
    ///
    /// # Errors
    /// No prompts, rest among them, no decisions, or times that are not above zero.
    pub fn new(config: MotionTestConfig) -> Result<MotionTest, EmgError> {
        for (name, count) in [("prompts", config.prompts.len()), ("right decisions", config.required_correct)]
        {
            if count == 0 {
                return Err(EmgError::OutOfRange { name, value: 0.0, expected: "at least 1" });
            }
        }
        if config.prompts.contains(&config.rest) {
            return Err(EmgError::OutOfRange { name: "prompts that rest", value: 1.0, expected: "none" });
        }
        check_positive("limit_secs", config.limit_secs)?;
        check_positive("poll_secs", config.poll_secs)?;
        let report = MotionReport { prompt_count: config.prompts.len(), ..MotionReport::default() };
        Ok(MotionTest {
            config,
            report,
            last_decision_at: None,
            prompted_at: None,
            onset: None,
            attempt: None,
        })
    }

    /// Takes the gesture that is in force at `now`. True if what the person is asked for changed.
    pub fn step(&mut self, now: SimTime, in_force: Gesture) -> bool {
        let secs = |since: SimTime| now.millis_since(since) as f64 / 1000.0;
        if self.is_finished()
            || self.last_decision_at.is_some_and(|polled| secs(polled) < self.config.poll_secs)
        {
            return false;
        }
        let first = self.last_decision_at.replace(now).is_none();
        let prompt = self.config.prompts[self.report.attempts.len()];
        let (Some(prompted_at), Some(attempt)) = (self.prompted_at, &mut self.attempt) else {
            if in_force != self.config.rest {
                return first;
            }
            self.prompted_at = Some(now);
            self.attempt = Some(MotionAttempt {
                prompt,
                selection_secs: None,
                completion_secs: None,
                correct: 0,
                incorrect: 0,
            });
            return true;
        };
        if in_force != self.config.rest {
            let onset = *self.onset.get_or_insert(now);
            if in_force == prompt {
                attempt.selection_secs.get_or_insert(secs(onset));
                attempt.correct += 1;
                attempt.completion_secs =
                    (attempt.correct == self.config.required_correct).then(|| secs(onset));
            } else {
                attempt.incorrect += 1;
            }
        }
        let over = attempt.completion_secs.is_some() || secs(prompted_at) >= self.config.limit_secs;
        if over {
            (self.prompted_at, self.onset) = (None, None);
            self.report.attempts.extend(self.attempt.take());
            self.sum_up();
        }
        over
    }

    fn sum_up(&mut self) {
        let mean = |of: fn(&MotionAttempt) -> Option<f64>| {
            let known: Vec<f64> = self.report.attempts.iter().filter_map(of).collect();
            (!known.is_empty()).then(|| known.iter().sum::<f64>() / known.len() as f64)
        };
        let (selection, completion) =
            (mean(|attempt| attempt.selection_secs), mean(|attempt| attempt.completion_secs));
        let complete =
            self.report.attempts.iter().filter(|attempt| attempt.completion_secs.is_some()).count();
        self.report.completion_rate = complete as f64 / self.report.attempts.len() as f64;
        (self.report.mean_selection_secs, self.report.mean_completion_secs) = (selection, completion);
    }

    /// What the person is asked for: rest before each motion; none after the end.
    pub fn prompt(&self) -> Option<Gesture> {
        let motion =
            self.prompted_at.map_or(self.config.rest, |_| self.config.prompts[self.report.attempts.len()]);
        (!self.is_finished()).then_some(motion)
    }

    /// The motion that is asked for now, as it stands; none while the hand has yet to relax.
    pub fn attempt(&self) -> Option<&MotionAttempt> {
        self.attempt.as_ref()
    }

    /// Seconds that are left for the motion; the whole limit while the hand has yet to relax.
    pub fn remaining_secs(&self) -> f64 {
        let passed = self
            .prompted_at
            .zip(self.last_decision_at)
            .map_or(0, |(prompted_at, polled)| polled.millis_since(prompted_at));
        (self.config.limit_secs - passed as f64 / 1000.0).max(0.0)
    }

    /// How it is done.
    pub fn config(&self) -> &MotionTestConfig {
        &self.config
    }

    /// All motions were asked for.
    pub fn is_finished(&self) -> bool {
        self.report.attempts.len() == self.config.prompts.len()
    }

    /// How it goes.
    pub fn report(&self) -> &MotionReport {
        &self.report
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proact_types::Command;

    /// Steps every 50 ms; at each, `act` says what is in force, from what is asked for and how long it has been, ms.
    fn run(config: MotionTestConfig, act: impl Fn(Gesture, u64) -> Gesture) -> MotionReport {
        let mut test = MotionTest::new(config).expect("as arranged");
        let (mut last_prompt, mut since) = (test.prompt(), 0);
        for tick in 0..4000_u64 {
            let now = 50 * tick;
            let Some(prompt) = last_prompt else { break };
            test.step(SimTime(now), act(prompt, now - since));
            if test.prompt() != last_prompt {
                (last_prompt, since) = (test.prompt(), now);
            }
        }
        assert!(test.is_finished());
        test.report().clone()
    }

    fn config(repetitions: usize) -> MotionTestConfig {
        MotionTestConfig::for_gestures(
            &Command::ALL.map(Gesture::from),
            Command::NoMotion.into(),
            repetitions,
        )
    }

    #[test]
    fn a_motion_counts_its_decisions_and_its_time_as_they_come() {
        let (rest, close) = (Command::NoMotion.into(), Command::HandClose.into());
        let only_close = MotionTestConfig { prompts: vec![close], ..config(1) };
        let mut test = MotionTest::new(only_close).expect("as arranged");
        test.step(SimTime(0), close);
        assert_eq!((test.attempt(), test.remaining_secs()), (None, 5.0), "the hand has yet to relax");
        test.step(SimTime(1000), rest);
        for tick in 1..=3 {
            test.step(SimTime(1000 + 100 * tick), close);
        }
        assert_eq!(test.attempt().map(|attempt| attempt.correct), Some(3));
        assert!((test.remaining_secs() - 4.7).abs() < 1e-9, "{}", test.remaining_secs());
    }

    #[test]
    fn times_count_from_the_first_decision_that_moves_to_the_first_and_the_tenth_right_one() {
        let wrong: Gesture = Command::HandOpen.into();
        let report = run(config(3), |prompt, since| match since {
            0..400 => Command::NoMotion.into(),
            400..600 if prompt != Gesture::from(Command::NoMotion) => wrong,
            _ => prompt,
        });
        assert_eq!((report.attempts.len(), report.prompt_count, report.completion_rate), (12, 12, 1.0));
        for attempt in &report.attempts {
            // Decisions count every 100 ms: two wrong ones, then ten right ones.
            let wrong_ones = if attempt.prompt == wrong { 0 } else { 2 };
            assert_eq!((attempt.correct, attempt.incorrect), (10, wrong_ones));
            let expected = 0.1 * wrong_ones as f64;
            assert!((attempt.selection_secs.expect("as arranged") - expected).abs() < 1e-9, "{attempt:?}");
            assert!(
                (attempt.completion_secs.expect("as arranged") - expected - 0.9).abs() < 1e-9,
                "{attempt:?}"
            );
        }
    }

    #[test]
    fn a_motion_that_is_not_made_ends_after_its_time_and_the_hand_must_relax_first() {
        let close: Gesture = Command::HandClose.into();
        let report = run(config(1), |prompt, since| match prompt {
            // It goes on for a while where rest is asked for.
            _ if prompt == Gesture::from(Command::NoMotion) && since < 700 => close,
            _ if prompt == close => Command::NoMotion.into(),
            _ => prompt,
        });
        let failed = report.attempts.iter().find(|attempt| attempt.prompt == close).expect("as arranged");
        assert_eq!((failed.correct, failed.selection_secs, failed.completion_secs), (0, None, None));
        assert_eq!(report.completion_rate, 0.75);
        assert!(
            report.attempts.iter().all(|attempt| attempt.incorrect == 0),
            "what is made before the prompt does not count"
        );
    }

    #[test]
    fn what_is_no_test_is_refused() {
        let refused = |config| MotionTest::new(config).expect_err("must be refused").to_string();
        assert!(refused(config(0)).contains("prompts"));
        assert!(refused(MotionTestConfig { required_correct: 0, ..config(1) }).contains("right decisions"));
        assert!(refused(MotionTestConfig { limit_secs: 0.0, ..config(1) }).contains("limit_secs"));
        assert!(refused(MotionTestConfig { poll_secs: f64::NAN, ..config(1) }).contains("poll_secs"));
        assert!(
            refused(MotionTestConfig { prompts: vec![Command::NoMotion.into()], ..config(1) })
                .contains("rest")
        );
    }
}
