use crate::{EmgConfig, MAX_MAJORITY_VOTE_WINDOWS, PublishRule};
use arrayvec::ArrayVec;
use proact_types::{Gesture, SimTime};
use std::num::NonZeroU32;

/// The most frequent of the newest classes, LibEMG's majority vote: fewer votes at the start; rejected windows (none)
/// vote too; of equals the first by name wins, rejected before all.
#[derive(Clone, Debug)]
pub struct MajorityVote {
    votes: usize,
    newest: ArrayVec<Option<Gesture>, { MAX_MAJORITY_VOTE_WINDOWS as usize }>,
}

impl MajorityVote {
    /// A vote over the newest `votes` classes, at most [`MAX_MAJORITY_VOTE_WINDOWS`].
    pub fn new(votes: NonZeroU32) -> Self {
        MajorityVote { votes: votes.get().min(MAX_MAJORITY_VOTE_WINDOWS) as usize, newest: ArrayVec::new() }
    }

    /// Takes the class of a window, or none if it was rejected; returns the winner.
    pub fn push(&mut self, class: Option<Gesture>) -> Option<Gesture> {
        if self.newest.len() == self.votes {
            self.newest.remove(0);
        }
        self.newest.push(class);
        let count = |candidate| self.newest.iter().filter(|vote| **vote == candidate).count();
        let mut winner = (None, count(None));
        for candidate in self.newest.iter().filter(|vote| vote.is_some()) {
            let votes = count(*candidate);
            // None is the least of all, so it keeps its place among equals.
            if votes > winner.1 || (votes == winner.1 && *candidate < winner.0) {
                winner = (*candidate, votes);
            }
        }
        winner.0
    }

    /// Forgets all votes.
    pub fn clear(&mut self) {
        self.newest.clear();
    }
}

/// What the rule says about one classifier output, or about its absence.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Decision {
    /// The gesture in force.
    pub gesture: Gesture,
    /// A message goes out: always under [`PublishRule::Hold`], on a full run of equal classes under
    /// [`PublishRule::Strict`], always when the stream became stale.
    pub published: bool,
    /// No output came for longer than the allowed age, so the arm must stop.
    pub stale: bool,
}

/// From a stream of classifier outputs to the gesture that drives the arm.
///
/// One misclassified window must not move the arm, so the gesture in force changes only after several equal
/// outputs in a row (three in ProACT, arXiv:2407.05025, section "System architecture").
///
/// Known weakness: it filters isolated errors only; a burst of wrong windows as long as the run passes.
#[derive(Clone, Debug)]
pub struct DecisionRule {
    publish_rule: PublishRule,
    consecutive_decisions: u32,
    act_on_first_window: bool,
    stale_timeout_ms: u64,
    rest: Gesture,
    current_gesture: Gesture,
    /// Class of the present run; none while windows are rejected.
    candidate: Option<Gesture>,
    streak: u32,
    /// Windows in a row that contradict the motion in force.
    contradicting_windows: u32,
    outputs: u32,
    /// Time of the last output, or of the first step before there was one.
    last_output_at: Option<SimTime>,
    /// After a silence only a relaxed hand lets gestures through again; otherwise one that is held through a
    /// radio drop-out would restart the arm by itself.
    armed: bool,
    stale: bool,
}

impl DecisionRule {
    /// A rule that starts at [`EmgConfig::reset`]; age counts from the first step.
    pub fn new(config: &EmgConfig) -> Self {
        DecisionRule {
            publish_rule: config.publish_rule,
            consecutive_decisions: config.consecutive_decisions.get(),
            act_on_first_window: config.act_on_first_window,
            stale_timeout_ms: config.stale_timeout_ms,
            rest: config.rest,
            current_gesture: config.rest,
            candidate: Some(config.rest),
            streak: 0,
            contradicting_windows: 0,
            outputs: 0,
            last_output_at: None,
            armed: true,
            stale: false,
        }
    }

    /// Advances to `now` with the classifier's output at that time, if there was one. None while nothing is due;
    /// a silence is reported once, when it exceeds the allowed age.
    pub fn step(&mut self, now: SimTime, output: Option<Gesture>) -> Option<Decision> {
        match output {
            Some(output) => Some(self.decide(now, Some(output))),
            None => self.check_age(now),
        }
    }

    /// Advances to `now` with a window that was rejected. It breaks a run of equal classes; a full run of rejected
    /// windows means that the hand does nothing known, so the arm stops.
    pub fn reject(&mut self, now: SimTime) -> Decision {
        self.decide(now, None)
    }

    /// Advances to `now` with the class of a window in which lost samples were bridged, none if it was rejected. It
    /// confirms the motion in force, or counts towards a stop; it never begins a motion, nor lets gestures through again
    /// after a silence. As many windows in a row as change the gesture, of which one or more were bridged and none is of
    /// the motion in force, stop it.
    pub fn step_interpolated(&mut self, now: SimTime, class: Option<Gesture>) -> Decision {
        let confirms = class == Some(self.current_gesture) && self.current_gesture != self.rest;
        if confirms || (self.armed && (class.is_none() || class == Some(self.rest))) {
            return self.decide(now, class);
        }
        self.record_output(now);
        // What runs on is neither broken by a window of the same class nor completed by it.
        if class != self.candidate {
            (self.candidate, self.streak) = (class, 0);
        }
        self.count_contradiction();
        Decision {
            gesture: self.current_gesture,
            published: self.publish_rule == PublishRule::Hold,
            stale: false,
        }
    }

    /// A window contradicts the motion in force.
    fn count_contradiction(&mut self) {
        self.contradicting_windows = self.contradicting_windows.saturating_add(1);
        if self.contradicting_windows >= self.consecutive_decisions {
            self.current_gesture = self.rest;
        }
    }

    /// The stream is not that of a living arm: the arm must stop. Some if that is news, until the next output.
    pub fn mark_stale(&mut self) -> Option<Decision> {
        let becomes_stale = !self.stale;
        self.current_gesture = self.rest;
        self.streak = 0;
        self.armed = false;
        self.stale = true;
        becomes_stale.then_some(Decision { gesture: self.rest, published: true, stale: true })
    }

    /// True from the moment in which the stream became stale to the next output.
    pub fn is_stale(&self) -> bool {
        self.stale
    }

    /// True while gestures are held back because no relaxed hand was seen since the last silence.
    pub fn is_disarmed(&self) -> bool {
        !self.armed
    }

    fn decide(&mut self, now: SimTime, output: Option<Gesture>) -> Decision {
        self.record_output(now);
        self.outputs = self.outputs.saturating_add(1);
        self.streak = if output == self.candidate { self.streak.saturating_add(1) } else { 1 };
        self.candidate = output;

        let needed = if self.act_on_first_window {
            self.consecutive_decisions.min(self.outputs)
        } else {
            self.consecutive_decisions
        };
        let unanimous = self.streak >= needed;
        if unanimous {
            self.armed |= output == Some(self.rest);
            self.current_gesture = output.filter(|_| self.armed).unwrap_or(self.rest);
        }
        // A window of the motion in force clears all doubt. Whole windows change it by their own run, so that without a
        // bridged one between them a doubt has no effect.
        self.contradicting_windows = if output == Some(self.current_gesture) {
            0
        } else {
            (self.contradicting_windows + 1).min(self.consecutive_decisions - 1)
        };
        let published = self.publish_rule == PublishRule::Hold || unanimous;
        Decision { gesture: self.current_gesture, published, stale: false }
    }

    /// An output came at `now`.
    fn record_output(&mut self, now: SimTime) {
        // The silence may have ended in the very tick in which it became too long.
        self.check_age(now);
        self.last_output_at = Some(now);
        self.stale = false;
    }

    fn check_age(&mut self, now: SimTime) -> Option<Decision> {
        let since = *self.last_output_at.get_or_insert(now);
        if self.stale || now.millis_since(since) <= self.stale_timeout_ms {
            return None;
        }
        self.mark_stale()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proact_types::Command::{self, NoMotion, WristExtension, WristFlexion};

    const INCREMENT_MILLIS: u64 = 50;

    fn rule() -> DecisionRule {
        DecisionRule::new(&EmgConfig::default())
    }

    fn feed(rule: &mut DecisionRule, from: u64, outputs: &[Command]) -> Vec<Gesture> {
        outputs
            .iter()
            .enumerate()
            .map(|(k, &g)| {
                let now = SimTime(from + k as u64 * INCREMENT_MILLIS);
                rule.step(now, Some(g.into())).expect("every output gives a decision").gesture
            })
            .collect()
    }

    #[test]
    fn two_equal_outputs_do_not_move_the_arm_and_the_third_does() {
        assert_eq!(feed(&mut rule(), 0, &[WristExtension; 3]), [NoMotion, NoMotion, WristExtension]);
    }

    #[test]
    fn one_wrong_window_in_a_held_gesture_changes_nothing() {
        let mut rule = rule();
        feed(&mut rule, 0, &[WristExtension; 3]);
        assert_eq!(feed(&mut rule, 150, &[WristFlexion, WristExtension]), [WristExtension; 2]);
    }

    #[test]
    fn the_original_start_lets_the_first_output_act_and_a_mixed_start_not() {
        let original = || DecisionRule::new(&EmgConfig { act_on_first_window: true, ..EmgConfig::default() });
        assert_eq!(feed(&mut original(), 0, &[WristExtension]), [WristExtension]);
        assert_eq!(
            feed(&mut original(), 0, &[WristExtension, WristFlexion, WristFlexion, WristFlexion]),
            [WristExtension, WristExtension, WristExtension, WristFlexion]
        );
    }

    #[test]
    fn a_rejected_window_breaks_a_run_and_three_of_them_stop_the_arm() {
        let mut rule = rule();
        feed(&mut rule, 0, &[WristExtension; 2]);
        assert_eq!(rule.reject(SimTime(100)).gesture, NoMotion);
        assert_eq!(feed(&mut rule, 150, &[WristExtension; 3]), [NoMotion, NoMotion, WristExtension]);
        let held: Vec<Gesture> = (0..3).map(|k: u64| rule.reject(SimTime(300 + k * 50)).gesture).collect();
        assert_eq!(held, [WristExtension, WristExtension, NoMotion]);
        assert_eq!(rule.step(SimTime(500), None), None, "rejected windows are no silence");
    }

    #[test]
    fn a_bridged_window_confirms_or_stops_and_never_begins_a_motion() {
        let at = |k: u64| SimTime(k * INCREMENT_MILLIS);
        let (held, other) = (Gesture::from(WristExtension), Gesture::from(WristFlexion));
        let begin = |bridged: &[bool], class: Gesture| {
            let mut rule = rule();
            let gesture = |(k, bridged): (u64, &bool)| match bridged {
                true => rule.step_interpolated(at(k), Some(class)).gesture,
                false => rule.decide(at(k), Some(class)).gesture,
            };
            (0..).zip(bridged).map(gesture).collect::<Vec<_>>()
        };
        assert_eq!(begin(&[true; 20], held), [NoMotion; 20]);
        // Three whole ones are needed still, and those between them do not break the run.
        let expected = [NoMotion, NoMotion, NoMotion, WristExtension, WristExtension];
        assert_eq!(begin(&[false, true, false, false, true], held), expected);

        let moving = || {
            let mut rule = rule();
            feed(&mut rule, 0, &[WristExtension; 3]);
            rule
        };
        let bridged = |rule: &mut DecisionRule, classes: &[Gesture]| -> Vec<Gesture> {
            (3..).zip(classes).map(|(k, class)| rule.step_interpolated(at(k), Some(*class)).gesture).collect()
        };
        assert_eq!(bridged(&mut moving(), &[held; 9]), [WristExtension; 9], "held through losses");
        let stopped = [WristExtension, WristExtension, NoMotion, NoMotion];
        assert_eq!(bridged(&mut moving(), &[NoMotion.into(); 4]), stopped);
        assert_eq!(
            bridged(&mut moving(), &[other; 4]),
            stopped,
            "contradicted, so it ends; the other does not begin"
        );
        assert_eq!(
            bridged(&mut moving(), &[other, NoMotion.into(), other, other]),
            stopped,
            "whatever contradicts it"
        );
        let confirmed = [other, other, held, other, other, held];
        assert_eq!(bridged(&mut moving(), &confirmed), [WristExtension; 6]);

        // After a silence a relaxed hand has to be seen whole.
        let mut rule = moving();
        assert!(rule.step(SimTime(1000), None).is_some_and(|d| d.stale));
        for k in 0..9 {
            assert_eq!(
                rule.step_interpolated(SimTime(1000 + 50 * k), Some(NoMotion.into())).gesture,
                NoMotion
            );
        }
        assert!(rule.is_disarmed());
        feed(&mut rule, 1450, &[NoMotion; 3]);
        assert!(!rule.is_disarmed());
    }

    #[test]
    fn the_most_frequent_of_the_newest_classes_wins_and_ties_go_to_the_first() {
        let mut votes = MajorityVote::new(NonZeroU32::new(3).expect("three"));
        let mut vote =
            |class: Option<Command>| votes.push(class.map(Into::into)).and_then(Gesture::same_named_command);
        assert_eq!(vote(Some(WristFlexion)), Some(WristFlexion));
        assert_eq!(vote(Some(WristExtension)), Some(WristExtension), "one each: the first in order");
        assert_eq!(vote(None), None, "one each: rejected before all");
        assert_eq!(vote(None), None);
        assert_eq!(vote(Some(NoMotion)), None);
        assert_eq!(vote(Some(NoMotion)), Some(NoMotion));
    }

    #[test]
    fn the_strict_rule_sends_only_full_runs() {
        let mut rule =
            DecisionRule::new(&EmgConfig { publish_rule: PublishRule::Strict, ..EmgConfig::default() });
        let outputs = [WristExtension, WristExtension, WristExtension, WristFlexion, WristExtension];
        let sent: Vec<bool> = outputs
            .iter()
            .zip(0..)
            .map(|(&g, k)| rule.step(SimTime(k * 50), Some(g.into())).expect("a decision").published)
            .collect();
        assert_eq!(sent, [false, false, true, false, false]);
    }

    #[test]
    fn silence_stops_the_arm_and_a_gesture_held_through_it_cannot_restart_it() {
        let mut rule = rule();
        feed(&mut rule, 0, &[WristExtension; 3]);
        assert_eq!(rule.step(SimTime(300), None), None, "exactly at the limit is not yet stale");
        let stale = Decision { gesture: NoMotion.into(), published: true, stale: true };
        assert_eq!(rule.step(SimTime(301), None), Some(stale));
        assert_eq!(rule.step(SimTime(302), None), None, "a silence is reported once");

        assert_eq!(feed(&mut rule, 350, &[WristExtension; 4]), [NoMotion; 4]);
        feed(&mut rule, 550, &[NoMotion; 3]);
        assert_eq!(feed(&mut rule, 700, &[WristExtension; 3]).last(), Some(&WristExtension.into()));
    }

    #[test]
    fn a_silence_that_ends_between_two_steps_still_disarms() {
        let mut rule = rule();
        feed(&mut rule, 0, &[WristExtension; 3]);
        assert_eq!(feed(&mut rule, 400, &[WristExtension; 3]), [NoMotion; 3]);
    }

    #[test]
    fn a_stream_that_never_starts_becomes_stale() {
        let mut rule = rule();
        assert_eq!(rule.step(SimTime(1000), None), None, "age counts from the first step");
        assert!(rule.step(SimTime(1201), None).is_some_and(|d| d.stale));
    }
}
