//! actionlib's five topics around a [`GoalList`].

use crate::node::{NodeError, RosGraph, convert, graph::Jobs};
use crate::{
    action::{ActionGoal, GoalAdmission, GoalId, GoalList, GoalState},
    messages::{actionlib_msgs, std_msgs},
    publishing::Publisher,
};
use proact_types::SimTime;
use rosrust::{Message, Subscriber, error::Result};

/// The server's ends of an action: `R` is its `ActionResult`, `F` its `ActionFeedback`.
pub(super) struct ActionServer<R: Message, F: Message> {
    pub goals: GoalList,
    status: Publisher<actionlib_msgs::GoalStatusArray>,
    result: Publisher<R>,
    feedback: Publisher<F>,
}

pub(super) fn goal_id(id: &actionlib_msgs::GoalID) -> GoalId {
    GoalId { id: id.id.clone(), stamp_ns: u64::from(id.stamp.sec) * 1_000_000_000 + u64::from(id.stamp.nsec) }
}

fn goal_status(goal: &ActionGoal) -> actionlib_msgs::GoalStatus {
    let (sec, nsec) = (goal.id.stamp_ns / 1_000_000_000, goal.id.stamp_ns % 1_000_000_000);
    actionlib_msgs::GoalStatus {
        goal_id: actionlib_msgs::GoalID {
            stamp: rosrust::Time { sec: sec as u32, nsec: nsec as u32 },
            id: goal.id.id.clone(),
        },
        status: goal.state as u8,
        text: goal.text.clone(),
    }
}

impl<R: Message, F: Message> ActionServer<R, F> {
    /// Sets the server's publishers up under `name`.
    pub(super) fn new(graph: &RosGraph, name: &str) -> std::result::Result<Self, NodeError> {
        Ok(Self {
            goals: GoalList::default(),
            status: graph.advertise(&format!("{name}/status"), 50, true)?,
            result: graph.advertise(&format!("{name}/result"), 50, false)?,
            feedback: graph.advertise(&format!("{name}/feedback"), 50, false)?,
        })
    }

    /// Listens to goals and cancels.
    pub(super) fn subscribe<G: Message, S: 'static>(
        graph: &RosGraph,
        name: &str,
        jobs: &Jobs<S>,
        goal: impl Fn(&mut S, G, &str) + Send + Sync + 'static,
        cancel: impl Fn(&mut S, GoalId) + Send + Sync + 'static,
    ) -> std::result::Result<[Subscriber; 2], NodeError> {
        Ok([
            graph.subscribe_with_caller(&format!("{name}/goal"), 50, jobs, goal)?,
            graph.subscribe(
                &format!("{name}/cancel"),
                50,
                jobs,
                move |state: &mut S, id: actionlib_msgs::GoalID| cancel(state, goal_id(&id)),
            )?,
        ])
    }

    /// Admits a valid goal; tells the client of the one that it takes the place of. True if it begins.
    pub(super) fn admit(
        &mut self,
        id: GoalId,
        now: SimTime,
        result: impl Fn(std_msgs::Header, actionlib_msgs::GoalStatus) -> R,
    ) -> Result<bool> {
        let (ended, begins) = match self.goals.admit(id, now) {
            GoalAdmission::Begin { preempted } => (preempted, true),
            GoalAdmission::Ended(goal) => (goal, false),
        };
        if let Some(goal) = ended {
            self.result.send(result(convert::header(now, ""), goal_status(&goal)))?;
        }
        self.status(now)?;
        Ok(begins)
    }

    /// Rejects a goal.
    pub(super) fn reject(
        &mut self,
        id: GoalId,
        text: &str,
        now: SimTime,
        result: impl Fn(std_msgs::Header, actionlib_msgs::GoalStatus) -> R,
    ) -> Result<()> {
        let goal = self.goals.reject(id, text, now);
        self.result.send(result(convert::header(now, ""), goal_status(&goal)))?;
        self.status(now)
    }

    /// Ends the active goal, if there is one.
    pub(super) fn end(
        &mut self,
        state: GoalState,
        text: &str,
        now: SimTime,
        result: impl Fn(std_msgs::Header, actionlib_msgs::GoalStatus) -> R,
    ) -> Result<()> {
        if let Some(goal) = self.goals.end(state, text, now) {
            self.status(now)?;
            self.result.send(result(convert::header(now, ""), goal_status(&goal)))?;
        }
        Ok(())
    }

    /// Feedback on the active goal, if there is one.
    pub(super) fn feedback(
        &self,
        now: SimTime,
        feedback: impl Fn(std_msgs::Header, actionlib_msgs::GoalStatus) -> F,
    ) -> Result<()> {
        match self.goals.active() {
            Some(goal) => self.feedback.send(feedback(convert::header(now, ""), goal_status(goal))),
            None => Ok(()),
        }
    }

    /// The status list; clients take it as the server's sign of life.
    pub(super) fn status(&mut self, now: SimTime) -> Result<()> {
        let status_list = self.goals.status(now).iter().map(goal_status).collect();
        self.status.send(actionlib_msgs::GoalStatusArray { header: convert::header(now, ""), status_list })
    }
}
