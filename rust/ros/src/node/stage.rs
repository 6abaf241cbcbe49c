//! What the nodes of single stages share: their loop, their time, a sign of life, what is preferred where a stage's
//! own messages and the original's tell of the same.
//!
//! In real time a stage ticks with `/clock`, on what has come so far. In lock-step (`~lockstep`) it ticks when the
//! messages of that very tick are there, says something in every tick, and says it once more when somebody in front of
//! it does: whoever joins late asks again in that way.

use super::{
    NodeError, RosGraph, convert,
    digest::SpanDigestWriter,
    graph::{Jobs, parameter},
};
use crate::{
    clock::NodeClock,
    heartbeat::{self, HEARTBEAT_TIMEOUT_MS, HeartbeatMonitor},
    messages::{
        rosgraph_msgs::Clock,
        std_msgs::{Header, String as Text},
    },
    publishing::Publisher,
};
use proact_types::SimTime;
use std::{collections::BTreeSet, sync::Arc, time::Duration};

/// How long a stage waits for something to happen before it looks after the graph.
const POLL_TIMEOUT: Duration = Duration::from_millis(20);
/// In lock-step a stage says that it lives once in so many ticks.
const HEARTBEAT_PERIOD_TICKS: u64 = 10;

/// A stage of the testbed as a node.
pub(super) trait StageNode: 'static {
    /// What all stages have.
    fn context(&mut self) -> &mut StageContext;

    /// Tick `now`, on what has come since the one before.
    fn tick(&mut self, now: SimTime) -> rosrust::error::Result<()>;

    /// The ticks of one message of the clock are over.
    fn flush(&mut self) -> rosrust::error::Result<()> {
        Ok(())
    }

    /// In lock-step: all that tick `next` needs is there.
    fn is_ready(&self, next: SimTime) -> bool;

    /// In lock-step: says once more what was said last.
    fn republish_last(&mut self) -> rosrust::error::Result<()>;
}

/// What all stages have.
pub(super) struct StageContext {
    pub clock: NodeClock,
    pub node_diagnostics: Arc<super::NodeDiagnostics>,
    pub lockstep: bool,
    /// Field hashes of this stage, where they are asked for.
    pub span_digests: Option<SpanDigestWriter>,
    /// In real time: topics that this stage needs, by the stage's own time.
    pub inputs: HeartbeatMonitor<&'static str>,
    /// Nodes whose typed messages tell what their messages in the original's types tell as well.
    typed_callers: BTreeSet<String>,
    name: String,
    heartbeat: Publisher<Text>,
}

impl StageContext {
    pub(super) fn new(graph: &RosGraph) -> Result<Self, NodeError> {
        Ok(Self {
            clock: NodeClock::default(),
            node_diagnostics: graph.node_diagnostics().clone(),
            lockstep: read_lockstep_parameter()?,
            span_digests: SpanDigestWriter::from_parameter()?,
            inputs: HeartbeatMonitor::default(),
            typed_callers: BTreeSet::new(),
            name: rosrust::name(),
            heartbeat: graph.advertise("proact/heartbeat", 10, false)?,
        })
    }

    /// The stage's own time.
    pub(super) fn now(&self) -> SimTime {
        self.clock.now()
    }

    /// The graph's time.
    pub(super) fn stamp(&self) -> SimTime {
        self.clock.graph_time().unwrap_or_default()
    }

    /// In real time: `topic` brought a message that left its publisher at `sent`, by the graph's time. An old one is no sign of life.
    pub(super) fn record_input(&mut self, topic: &'static str, sent: SimTime) {
        if !self.lockstep && self.stamp().millis_since(sent) <= HEARTBEAT_TIMEOUT_MS {
            self.inputs.record(topic, self.now());
        }
    }

    /// [`StageContext::hear`] by the message's header.
    pub(super) fn record_stamped_input(&mut self, topic: &'static str, header: &Header) {
        self.record_input(topic, convert::tick(&header.stamp));
    }

    /// Notices topics that fell silent.
    pub(super) fn check_inputs(&mut self) {
        for topic in self.inputs.step(self.clock.now()) {
            self.node_diagnostics
                .record_refusal("input", &format!("{topic} is silent for {HEARTBEAT_TIMEOUT_MS} ms"));
        }
    }

    /// Publishes the heartbeat, with the input that this stage misses.
    fn publish_heartbeat(&mut self) -> rosrust::error::Result<()> {
        self.check_inputs();
        let missed = self.inputs.stale().next().copied();
        self.heartbeat.send(Text { data: heartbeat::format_heartbeat(&self.name, missed) })
    }

    /// Refuses what could not be sent or taken.
    pub(super) fn report_error<E: std::fmt::Display>(&self, kind: &'static str, done: Result<(), E>) {
        if let Err(error) = done {
            self.node_diagnostics.record_refusal(kind, &error.to_string());
        }
    }

    /// A node sent a typed message: what it says in the original's types is the same. True for its first one.
    pub(super) fn register_typed_caller(&mut self, caller: &str) -> bool {
        !self.typed_callers.contains(caller) && self.typed_callers.insert(caller.to_owned())
    }

    /// Whether a node's messages in the original's types are passed over.
    pub(super) fn is_typed_caller(&self, caller: &str) -> bool {
        self.typed_callers.contains(caller)
    }
}

/// Whether the graph runs in lock-step: `~lockstep`.
pub(super) fn read_lockstep_parameter() -> Result<bool, NodeError> {
    parameter("~lockstep", false, "true or false")
}

/// A message of a tick, in lock-step.
pub(super) struct TickMessage<T>(Option<(SimTime, T)>);

impl<T> Default for TickMessage<T> {
    fn default() -> Self {
        Self(None)
    }
}

impl<T> TickMessage<T> {
    /// Takes the message of `tick`. False if that was here before: whoever sent it has heard no answer.
    pub(super) fn update(&mut self, tick: SimTime, value: T) -> bool {
        if self.0.as_ref().is_some_and(|(before, _)| tick <= *before) {
            return false;
        }
        self.0 = Some((tick, value));
        true
    }

    /// The newest is that of `tick`.
    pub(super) fn is_at(&self, tick: SimTime) -> bool {
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
pub(super) fn run<S: StageNode>(mut graph: RosGraph, jobs: &Jobs<S>, stage: &mut S) -> Result<(), NodeError> {
    let lockstep = stage.context().lockstep;
    let _clock = if lockstep { None } else { Some(subscribe_clock(&graph, jobs)?) };
    graph.watch_master()?;
    while graph.is_ok() {
        jobs.run_next(stage, POLL_TIMEOUT);
        while lockstep && step(stage) {}
        graph.publish_diagnostics(convert::time(stage.context().stamp()));
    }
    graph.stop_watching();
    Ok(())
}

/// In lock-step: the next tick, if all that it needs is there.
fn step<S: StageNode>(stage: &mut S) -> bool {
    let next = SimTime(stage.context().now().0 + 1);
    if !stage.is_ready(next) {
        return false;
    }
    stage.context().clock.step_to(next);
    let done = stage.tick(next).and_then(|()| stage.flush());
    let common = stage.context();
    common.report_error("publish", done);
    if next.0.is_multiple_of(HEARTBEAT_PERIOD_TICKS) {
        let alive = common.publish_heartbeat();
        common.report_error("publish", alive);
    }
    true
}

fn subscribe_clock<S: StageNode>(graph: &RosGraph, jobs: &Jobs<S>) -> Result<rosrust::Subscriber, NodeError> {
    graph.subscribe("/clock", 10, jobs, |stage: &mut S, message: Clock| {
        let common = stage.context();
        let ticks = match common.clock.advance(convert::tick(&message.clock)) {
            Ok(ticks) => ticks,
            Err(reason) => return common.node_diagnostics.record_refusal("time", &reason),
        };
        let mut done = common.publish_heartbeat();
        for tick in ticks {
            done = done.and(stage.tick(SimTime(tick)));
        }
        let done = done.and(stage.flush());
        stage.context().report_error("publish", done);
    })
}
