//! What the nodes of single stages share: their loop, their time, a sign of life, what is preferred where a stage's
//! own messages and the original's tell of the same.
//!
//! In real time a stage ticks with `/clock`, on what has come so far. In lock-step (`~lockstep`) it ticks when the
//! messages of that very tick are there, says something in every tick, and says it once more when somebody in front of
//! it does: whoever joins late asks again in that way.

use super::{
    NodeError, RosGraph, convert,
    digest::Spans,
    graph::{Jobs, parameter},
};
use crate::{
    clock::StageClock,
    messages::{rosgraph_msgs::Clock, std_msgs::String as Text},
};
use proact_types::SimTime;
use rosrust::Publisher;
use std::{collections::BTreeSet, sync::Arc, time::Duration};

/// How long a stage waits for something to happen before it looks after the graph.
const PATIENCE: Duration = Duration::from_millis(20);
/// In lock-step a stage says that it lives once in so many ticks.
const ALIVE_TICKS: u64 = 10;

/// A stage of the testbed as a node.
pub(super) trait Stage: 'static {
    /// What all stages have.
    fn common(&mut self) -> &mut Common;

    /// Tick `now`, on what has come since the one before.
    fn tick(&mut self, now: SimTime) -> rosrust::error::Result<()>;

    /// The ticks of one message of the clock are over.
    fn show(&mut self) -> rosrust::error::Result<()> {
        Ok(())
    }

    /// In lock-step: all that tick `next` needs is there.
    fn is_ready(&self, next: SimTime) -> bool;

    /// In lock-step: says once more what was said last.
    fn repeat(&mut self) -> rosrust::error::Result<()>;
}

/// What all stages have.
pub(super) struct Common {
    pub clock: StageClock,
    pub faults: Arc<super::Faults>,
    pub lockstep: bool,
    /// Field hashes of this stage, where they are asked for.
    pub spans: Option<Spans>,
    /// Nodes whose typed messages tell what their messages in the original's types tell as well.
    typed: BTreeSet<String>,
    name: String,
    heartbeat: Publisher<Text>,
}

impl Common {
    pub(super) fn new(graph: &RosGraph) -> Result<Self, NodeError> {
        Ok(Self {
            clock: StageClock::default(),
            faults: graph.faults().clone(),
            lockstep: lockstep()?,
            spans: Spans::of_parameter()?,
            typed: BTreeSet::new(),
            name: rosrust::name(),
            heartbeat: graph.publish("proact/heartbeat", 10, false)?,
        })
    }

    /// The stage's own time.
    pub(super) fn now(&self) -> SimTime {
        self.clock.now()
    }

    /// The graph's time.
    pub(super) fn stamp(&self) -> SimTime {
        self.clock.graph().unwrap_or_default()
    }

    /// Refuses what could not be sent or taken.
    pub(super) fn note<E: std::fmt::Display>(&self, kind: &'static str, done: Result<(), E>) {
        if let Err(error) = done {
            self.faults.refuse(kind, &error.to_string());
        }
    }

    /// A node sent a typed message: what it says in the original's types is the same. True for its first one.
    pub(super) fn prefer(&mut self, caller: &str) -> bool {
        !self.typed.contains(caller) && self.typed.insert(caller.to_owned())
    }

    /// Whether a node's messages in the original's types are passed over.
    pub(super) fn is_preferred(&self, caller: &str) -> bool {
        self.typed.contains(caller)
    }
}

/// Whether the graph runs in lock-step: `~lockstep`.
pub(super) fn lockstep() -> Result<bool, NodeError> {
    parameter("~lockstep", false, "true or false")
}

/// A message of a tick, in lock-step.
pub(super) struct Tagged<T>(Option<(SimTime, T)>);

impl<T> Default for Tagged<T> {
    fn default() -> Self {
        Self(None)
    }
}

impl<T> Tagged<T> {
    /// Takes the message of `tick`. False if that was here before: whoever sent it has heard no answer.
    pub(super) fn take(&mut self, tick: SimTime, value: T) -> bool {
        if self.0.as_ref().is_some_and(|(before, _)| tick <= *before) {
            return false;
        }
        self.0 = Some((tick, value));
        true
    }

    /// The newest is that of `tick`.
    pub(super) fn is(&self, tick: SimTime) -> bool {
        self.0.as_ref().is_some_and(|(at, _)| *at == tick)
    }

    /// The newest, to put right.
    pub(super) fn get_mut(&mut self) -> Option<&mut T> {
        self.0.as_mut().map(|(_, value)| value)
    }

    /// The newest.
    pub(super) fn get(&self) -> Option<&T> {
        self.0.as_ref().map(|(_, value)| value)
    }
}

/// Runs a stage until the graph ends the node.
pub(super) fn run<S: Stage>(mut graph: RosGraph, jobs: &Jobs<S>, stage: &mut S) -> Result<(), NodeError> {
    let lockstep = stage.common().lockstep;
    let _clock = if lockstep { None } else { Some(listen_to_clock(&graph, jobs)?) };
    graph.watch_master()?;
    while graph.is_ok() {
        jobs.run_next(stage, PATIENCE);
        while lockstep && step(stage) {}
        graph.tell(convert::time(stage.common().stamp()));
    }
    graph.stop_watching();
    Ok(())
}

/// In lock-step: the next tick, if all that it needs is there.
fn step<S: Stage>(stage: &mut S) -> bool {
    let next = SimTime(stage.common().now().0 + 1);
    if !stage.is_ready(next) {
        return false;
    }
    stage.common().clock.step_to(next);
    let done = stage.tick(next).and_then(|()| stage.show());
    let common = stage.common();
    common.note("publish", done);
    if next.0.is_multiple_of(ALIVE_TICKS) {
        let alive = common.heartbeat.send(Text { data: common.name.clone() });
        common.note("publish", alive);
    }
    true
}

fn listen_to_clock<S: Stage>(graph: &RosGraph, jobs: &Jobs<S>) -> Result<rosrust::Subscriber, NodeError> {
    graph.listen("/clock", 10, jobs, |stage: &mut S, message: Clock| {
        let common = stage.common();
        let ticks = match common.clock.take(convert::tick(&message.clock)) {
            Ok(ticks) => ticks,
            Err(reason) => return common.faults.refuse("time", &reason),
        };
        let alive = common.heartbeat.send(Text { data: common.name.clone() });
        let mut done = alive;
        for tick in ticks {
            done = done.and(stage.tick(SimTime(tick)));
        }
        let done = done.and(stage.show());
        stage.common().note("publish", done);
    })
}
