//! The server's half of actionlib's protocol, as a state machine: goals, cancels, preemption, status.
//!
//! One goal is active at a time; a new one preempts it. Knows nothing of the goal's content.

use proact_types::SimTime;

/// How long a goal that has ended stays in the status list, ms (actionlib: 5 s).
const STATUS_LIST_TIMEOUT_MS: u64 = 5000;

/// Name of a goal, as its client gave it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct GoalId {
    /// Unique among clients.
    pub id: String,
    /// When the client made it, nanoseconds on the graph's clock; zero when it left that open.
    pub stamp_ns: u64,
}

/// Where a goal stands; the numbers are those of `actionlib_msgs/GoalStatus`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GoalState {
    /// It is being worked on.
    Active = 1,
    /// It was cancelled, or a newer goal took its place.
    Preempted = 2,
    /// It was reached.
    Succeeded = 3,
    /// It was given up.
    Aborted = 4,
    /// It was never taken on.
    Rejected = 5,
    /// It was cancelled before it began.
    Recalled = 8,
}

/// A goal in the status list.
#[derive(Clone, Debug, PartialEq)]
pub struct ActionGoal {
    /// Its name.
    pub id: GoalId,
    /// Where it stands.
    pub state: GoalState,
    /// One sentence.
    pub text: String,
    ended_at: Option<SimTime>,
}

/// What a goal that comes in may do.
#[derive(Clone, Debug, PartialEq)]
pub enum GoalAdmission {
    /// Begin; the goal that it takes the place of, if there was one, has ended.
    Begin {
        /// The one before.
        preempted: Option<ActionGoal>,
    },
    /// It was cancelled before it came, or came before: nothing begins.
    Ended(Option<ActionGoal>),
}

/// The goals of one action server.
#[derive(Clone, Debug, Default)]
pub struct GoalList {
    goals: Vec<ActionGoal>,
    /// Everything stamped up to here is cancelled when it comes, ns.
    cancelled_before_ns: u64,
    /// Cancels that overtook their goals.
    cancelled_ids: Vec<(String, SimTime)>,
}

impl GoalList {
    /// The goal that is worked on.
    pub fn active(&self) -> Option<&ActionGoal> {
        self.goals.iter().find(|g| g.state == GoalState::Active)
    }

    /// Whether a goal of this name would begin: it is not known yet, and no cancel overtook it. What the goal asks for
    /// is started only then.
    pub fn would_begin(&self, id: &GoalId) -> bool {
        !self.is_known(id) && !self.is_cancelled_early(id)
    }

    fn is_known(&self, id: &GoalId) -> bool {
        self.goals.iter().any(|g| g.id.id == id.id)
    }

    fn is_cancelled_early(&self, id: &GoalId) -> bool {
        self.cancelled_ids.iter().any(|(cancelled, _)| *cancelled == id.id)
            || (id.stamp_ns != 0 && id.stamp_ns <= self.cancelled_before_ns)
    }

    /// A valid goal came in.
    pub fn admit(&mut self, id: GoalId, now: SimTime) -> GoalAdmission {
        if self.is_known(&id) {
            return GoalAdmission::Ended(None);
        }
        if self.is_cancelled_early(&id) {
            let text = "cancelled before it began";
            return GoalAdmission::Ended(Some(self.add(id, GoalState::Recalled, text, Some(now))));
        }
        let preempted = self.end(GoalState::Preempted, "a newer goal took its place", now);
        self.add(id, GoalState::Active, "", None);
        GoalAdmission::Begin { preempted }
    }

    /// A goal came in that cannot be taken on. The one that is worked on goes on.
    pub fn reject(&mut self, id: GoalId, text: &str, now: SimTime) -> ActionGoal {
        self.add(id, GoalState::Rejected, text, Some(now))
    }

    /// A cancel came in: actionlib's rules for empty names and stamps. True if it concerns the active goal, which
    /// the caller then stops and ends.
    pub fn cancel(&mut self, which: &GoalId, now: SimTime) -> bool {
        let all = which.id.is_empty() && which.stamp_ns == 0;
        self.cancelled_before_ns = self.cancelled_before_ns.max(which.stamp_ns);
        let known = self.goals.iter().any(|g| g.id.id == which.id);
        if !which.id.is_empty() && !known {
            self.cancelled_ids.push((which.id.clone(), now));
        }
        self.active().is_some_and(|active| {
            all || active.id.id == which.id
                || (which.stamp_ns != 0 && active.id.stamp_ns != 0 && active.id.stamp_ns <= which.stamp_ns)
        })
    }

    /// Ends the active goal.
    pub fn end(&mut self, state: GoalState, text: &str, now: SimTime) -> Option<ActionGoal> {
        let goal = self.goals.iter_mut().find(|g| g.state == GoalState::Active)?;
        goal.state = state;
        goal.text = text.to_owned();
        goal.ended_at = Some(now);
        Some(goal.clone())
    }

    /// The status list as of `now`.
    pub fn status(&mut self, now: SimTime) -> &[ActionGoal] {
        self.goals
            .retain(|g| g.ended_at.is_none_or(|ended| now.millis_since(ended) < STATUS_LIST_TIMEOUT_MS));
        self.cancelled_ids.retain(|(_, at)| now.millis_since(*at) < STATUS_LIST_TIMEOUT_MS);
        &self.goals
    }

    fn add(&mut self, id: GoalId, state: GoalState, text: &str, ended: Option<SimTime>) -> ActionGoal {
        let goal = ActionGoal { id, state, text: text.to_owned(), ended_at: ended };
        self.goals.push(goal.clone());
        goal
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOW: SimTime = SimTime(100);

    fn id(name: &str, stamp_ns: u64) -> GoalId {
        GoalId { id: name.to_owned(), stamp_ns }
    }

    fn active(list: &GoalList) -> Option<&str> {
        list.active().map(|g| g.id.id.as_str())
    }

    #[test]
    fn a_new_goal_preempts_the_one_before_and_the_same_goal_twice_counts_once() {
        let mut list = GoalList::default();
        assert_eq!(list.admit(id("a", 1), NOW), GoalAdmission::Begin { preempted: None });
        let GoalAdmission::Begin { preempted: Some(before) } = list.admit(id("b", 2), NOW) else {
            panic!("b begins and a ends")
        };
        assert_eq!((before.id.id.as_str(), before.state), ("a", GoalState::Preempted));
        assert!(!list.would_begin(&id("b", 2)) && list.would_begin(&id("c", 3)));
        assert_eq!(list.admit(id("b", 2), NOW), GoalAdmission::Ended(None));
        assert_eq!(active(&list), Some("b"));
    }

    #[test]
    fn cancels_follow_the_rules_for_names_and_stamps() {
        for (cancel, hit) in [
            (id("", 0), true),
            (id("b", 0), true),
            (id("other", 0), false),
            (id("", 20), true),
            (id("", 19), false),
            (id("other", 25), true),
        ] {
            let mut list = GoalList::default();
            list.admit(id("b", 20), NOW);
            assert_eq!(list.cancel(&cancel, NOW), hit, "{cancel:?}");
        }
    }

    #[test]
    fn a_cancel_that_overtakes_its_goal_recalls_it() {
        let mut list = GoalList::default();
        list.cancel(&id("late", 0), NOW);
        assert!(!list.would_begin(&id("late", 5)));
        let GoalAdmission::Ended(Some(goal)) = list.admit(id("late", 5), NOW) else {
            panic!("it does not begin")
        };
        assert_eq!(goal.state, GoalState::Recalled);
        list.cancel(&id("", 50), NOW);
        assert!(matches!(list.admit(id("old", 50), NOW), GoalAdmission::Ended(Some(_))));
        assert!(matches!(list.admit(id("new", 51), NOW), GoalAdmission::Begin { .. }));
    }

    #[test]
    fn ended_goals_leave_the_status_list_after_five_seconds_and_the_active_one_never() {
        let mut list = GoalList::default();
        list.admit(id("a", 1), NOW);
        list.reject(id("bad", 2), "no", NOW);
        assert_eq!(list.status(NOW.plus_millis(STATUS_LIST_TIMEOUT_MS - 1)).len(), 2);
        assert_eq!(list.status(NOW.plus_millis(STATUS_LIST_TIMEOUT_MS)).len(), 1);
        list.end(GoalState::Succeeded, "", NOW.plus_millis(STATUS_LIST_TIMEOUT_MS));
        assert!(active(&list).is_none());
        assert!(list.status(NOW.plus_millis(3 * STATUS_LIST_TIMEOUT_MS)).is_empty());
    }
}
