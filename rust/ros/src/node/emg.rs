//! `proact node emg`: samples of an armband in, the gesture out. With an armband of its own the node puts its samples on the
//! graph, where it hears them itself: every sample goes one way, and whoever records the graph has them all.

use super::{
    NodeError, RosGraph,
    graph::Jobs,
    stage::{self, StageContext, StageNode, TickMessage},
    wire,
};
use crate::messages::{
    proact_msgs::{Decision, EmgSamples, Person},
    std_msgs::{Header, String as Text},
};
use crate::publishing::Publisher;
use proact_messages::original::relative;
use proact_testbed::{
    DigestField,
    stages::{EmgStage, EmgStageInput, EmgStageOutput},
};
use proact_types::{EmgSample, EventKind, MAX_EMG_CHANNELS, SimTime, TickInput};
use std::{
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    thread::JoinHandle,
    time::Duration,
};

/// In real time a stage without news says how things are once in so many ticks.
const REPUBLISH_TICKS: u64 = 50;

const EMG_SAMPLES: &str = "proact/emg_samples";
/// How long the armband is waited for before the node looks whether it has ended.
const ARMBAND_POLL_TIMEOUT: Duration = Duration::from_millis(20);

struct EmgNode {
    context: StageContext,
    stage: EmgStage,
    /// In lock-step.
    person: TickMessage<TickInput>,
    last_output: Option<EmgStageOutput>,
    emg: Publisher<Text>,
    decision: Publisher<Decision>,
}

/// Waits for samples of an armband at most for so long; those that came, oldest first.
pub type WaitForSamples = Box<dyn FnMut(Duration) -> Vec<EmgSample> + Send>;

/// Runs the EMG stage until the graph ends the node, with the samples of an `armband` or those that others publish.
///
/// # Errors
/// [`NodeError`].
pub fn run_emg(stage: EmgStage, armband: Option<WaitForSamples>) -> Result<(), NodeError> {
    let graph = RosGraph::join("proact_emg")?;
    let mut node = EmgNode {
        context: StageContext::new(&graph)?,
        stage,
        person: TickMessage::default(),
        last_output: None,
        emg: graph.advertise(relative::EMG, 10, false)?,
        decision: graph.advertise("proact/decision", 100, false)?,
    };
    let jobs: Jobs<EmgNode> = Jobs::default();
    let _listening =
        if node.context.lockstep {
            graph.subscribe("proact/person", 100, &jobs, |node: &mut EmgNode, message: Person| {
                match wire::read_person(&message) {
                    Ok((input, _)) => {
                        if !node.person.update(SimTime(message.tick), input) {
                            let done = node.republish_last();
                            node.context.report_error("publish", done);
                        }
                    }
                    Err(reason) => node.context.node_diagnostics.record_refusal("person", &reason),
                }
            })?
        } else {
            graph.subscribe(EMG_SAMPLES, 20, &jobs, |node: &mut EmgNode, message: EmgSamples| {
                match parse_samples(&message) {
                    Ok(samples) => {
                        let now = node.context.now();
                        let done = node.process_samples(
                            now,
                            EmgStageInput { samples: &samples, ..EmgStageInput::default() },
                        );
                        node.context.report_error("publish", done);
                    }
                    Err(reason) => node.context.node_diagnostics.record_refusal("emg_samples", &reason),
                }
            })?
        };
    let ended = Arc::new(AtomicBool::new(false));
    let publishing = match armband {
        Some(wait) => Some(publish_samples(&graph, wait, ended.clone())?),
        None => None,
    };
    let done = stage::run(graph, &jobs, &mut node);
    ended.store(true, Ordering::Relaxed);
    if let Some(thread) = publishing {
        // One that panicked has told so itself.
        let _ = thread.join();
    }
    done
}

/// Samples of the armband become messages on a thread of their own: it waits for the radio.
fn publish_samples(
    graph: &RosGraph,
    mut wait: WaitForSamples,
    ended: Arc<AtomicBool>,
) -> Result<JoinHandle<()>, NodeError> {
    let publisher: Publisher<EmgSamples> = graph.advertise(EMG_SAMPLES, 20, false)?;
    let faults = graph.node_diagnostics().clone();
    Ok(std::thread::spawn(move || {
        while !ended.load(Ordering::Relaxed) {
            let samples = wait(ARMBAND_POLL_TIMEOUT);
            // A message counts on from its first sample: a loss begins another.
            let follows = |a: &EmgSample, b: &EmgSample| {
                b.counter == a.counter + 1 && a.channels.len() == b.channels.len()
            };
            for run in samples.chunk_by(follows) {
                if let Err(error) = publisher.send(samples_message(run)) {
                    faults.record_refusal("publish", &error.to_string());
                }
            }
        }
    }))
}

fn samples_message(samples: &[EmgSample]) -> EmgSamples {
    EmgSamples {
        header: Header { seq: 0, stamp: rosrust::now(), frame_id: String::new() },
        counter: samples.first().map_or(0, |first| first.counter),
        channels: samples.first().map_or(0, |first| first.channels.len()) as u32,
        data: samples.iter().flat_map(|sample| sample.channels.iter().copied()).collect(),
    }
}

impl EmgNode {
    fn process_samples(&mut self, now: SimTime, input: EmgStageInput<'_>) -> rosrust::error::Result<()> {
        let output = self.stage.step(now, input);
        for event in &output.events {
            if let EventKind::EmgGap { gaps, unusable_samples, .. } = event
                && gaps + unusable_samples > 0
            {
                let reason = format!("{gaps} gaps, {unusable_samples} unusable samples");
                self.context.node_diagnostics.record_refusal("emg_samples", &reason);
            }
        }
        let before = self.last_output.replace(output.clone());
        let was_dead = before.as_ref().is_some_and(|previous| previous.fault.is_some());
        if let Some((_, fault)) = output.fault.as_ref().filter(|_| !was_dead) {
            self.context.node_diagnostics.record_refusal("emg_stale", &format!("{fault}: no motion"));
        }
        let changed = before
            .is_none_or(|previous| (previous.fault, previous.armed) != (output.fault.clone(), output.armed));
        let due = changed || output.decision.is_some() || now.0.is_multiple_of(REPUBLISH_TICKS);
        // Before the text, which listeners that know the typed message pass over.
        if due || self.context.lockstep {
            self.decision.send(wire::decision(now, self.context.stamp(), &output))?;
        }
        let stale = output.decision.as_ref().is_some_and(|decision| decision.stale);
        match output.published_command.or(stale.then_some(output.command)) {
            Some(command) => self.emg.send(Text { data: command.ros_name().to_owned() }),
            None => Ok(()),
        }
    }
}

impl StageNode for EmgNode {
    fn context(&mut self) -> &mut StageContext {
        &mut self.context
    }

    /// Time alone makes a stream stale.
    fn tick(&mut self, now: SimTime) -> rosrust::error::Result<()> {
        let Some(input) = self.person.get().cloned() else {
            return self.process_samples(now, EmgStageInput::default());
        };
        let stage_input =
            EmgStageInput { samples: &input.emg, direct_command: input.command, ..EmgStageInput::default() };
        let done = self.process_samples(now, stage_input);
        if let (Some(spans), Some(last_output)) = (&mut self.context.span_digests, &self.last_output) {
            spans.digest.input(&TickInput { emg: input.emg, ..TickInput::default() });
            spans.digest.emg(last_output);
            spans.end_tick(now, &[DigestField::InputEmg, DigestField::Emg], false);
        }
        done
    }

    fn is_ready(&self, next: SimTime) -> bool {
        self.person.is_at(next)
    }

    fn republish_last(&mut self) -> rosrust::error::Result<()> {
        match &self.last_output {
            Some(last_output) => {
                self.decision.send(wire::decision(self.context.now(), self.context.stamp(), last_output))
            }
            None => Ok(()),
        }
    }
}

/// The samples of a message. Values that are not finite pass: the pipeline counts them.
fn parse_samples(message: &EmgSamples) -> Result<Vec<EmgSample>, String> {
    let channels = message.channels as usize;
    if !(1..=MAX_EMG_CHANNELS).contains(&channels) {
        return Err(format!("{channels} channels, expected 1 to {MAX_EMG_CHANNELS}"));
    }
    if !message.data.len().is_multiple_of(channels) {
        return Err(format!("{} values are no whole number of {channels} channels", message.data.len()));
    }
    let sample = |(counter, values): (u64, &[f64])| EmgSample { counter, channels: values.into() };
    Ok((message.counter..).zip(message.data.chunks(channels)).map(sample).collect())
}
