//! `proact node emg`: samples of an armband in, the gesture out. With an armband of its own the node puts its samples on the
//! graph, where it hears them itself: every sample goes one way, and whoever records the graph has them all.

use super::{
    NodeError, RosGraph,
    graph::Jobs,
    stage::{self, Common, Stage, Tagged},
    wire,
};
use crate::messages::{
    proact_msgs::{Decision, EmgSamples, Person},
    std_msgs::{Header, String as Text},
};
use proact_messages::original::relative;
use proact_testbed::{
    Field,
    stages::{EmgStage, EmgStageInput, EmgStageOutput},
};
use proact_types::{EmgSample, EventKind, MAX_EMG_CHANNELS, SimTime, TickInput};
use rosrust::Publisher;
use std::{
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    thread::JoinHandle,
    time::Duration,
};

/// In real time a stage without news says how things are once in so many ticks.
const TELL_TICKS: u64 = 50;

const EMG_SAMPLES: &str = "proact/emg_samples";
/// How long the armband is waited for before the node looks whether it has ended.
const PATIENCE: Duration = Duration::from_millis(20);

struct EmgNode {
    common: Common,
    stage: EmgStage,
    /// In lock-step.
    person: Tagged<TickInput>,
    said: Option<EmgStageOutput>,
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
        common: Common::new(&graph)?,
        stage,
        person: Tagged::default(),
        said: None,
        emg: graph.publish(relative::EMG, 10, false)?,
        decision: graph.publish("proact/decision", 100, false)?,
    };
    let jobs: Jobs<EmgNode> = Jobs::default();
    let _listening = if node.common.lockstep {
        graph.listen("proact/person", 100, &jobs, |node: &mut EmgNode, message: Person| {
            match wire::read_person(&message) {
                Ok((input, _)) => {
                    if !node.person.take(SimTime(message.tick), input) {
                        let done = node.repeat();
                        node.common.note("publish", done);
                    }
                }
                Err(reason) => node.common.faults.refuse("person", &reason),
            }
        })?
    } else {
        graph.listen(EMG_SAMPLES, 20, &jobs, |node: &mut EmgNode, message: EmgSamples| {
            match samples(&message) {
                Ok(samples) => {
                    let now = node.common.now();
                    let done =
                        node.take(now, EmgStageInput { samples: &samples, ..EmgStageInput::default() });
                    node.common.note("publish", done);
                }
                Err(reason) => node.common.faults.refuse("emg_samples", &reason),
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
    let publisher: Publisher<EmgSamples> = graph.publish(EMG_SAMPLES, 20, false)?;
    let faults = graph.faults().clone();
    Ok(std::thread::spawn(move || {
        while !ended.load(Ordering::Relaxed) {
            let samples = wait(PATIENCE);
            // A message counts on from its first sample: a loss begins another.
            let follows = |a: &EmgSample, b: &EmgSample| {
                b.counter == a.counter + 1 && a.channels.len() == b.channels.len()
            };
            for run in samples.chunk_by(follows) {
                if let Err(error) = publisher.send(message(run)) {
                    faults.refuse("publish", &error.to_string());
                }
            }
        }
    }))
}

fn message(samples: &[EmgSample]) -> EmgSamples {
    EmgSamples {
        header: Header { seq: 0, stamp: rosrust::now(), frame_id: String::new() },
        counter: samples.first().map_or(0, |first| first.counter),
        channels: samples.first().map_or(0, |first| first.channels.len()) as u32,
        data: samples.iter().flat_map(|sample| sample.channels.iter().copied()).collect(),
    }
}

impl EmgNode {
    fn take(&mut self, now: SimTime, input: EmgStageInput<'_>) -> rosrust::error::Result<()> {
        let output = self.stage.step(now, input);
        for event in &output.events {
            if let EventKind::EmgGap { gaps, unusable_samples, .. } = event
                && gaps + unusable_samples > 0
            {
                let reason = format!("{gaps} gaps, {unusable_samples} unusable samples");
                self.common.faults.refuse("emg_samples", &reason);
            }
        }
        let before = self.said.replace(output.clone());
        let was_dead = before.as_ref().is_some_and(|said| said.fault.is_some());
        if let Some((_, fault)) = output.fault.as_ref().filter(|_| !was_dead) {
            self.common.faults.refuse("emg_stale", &format!("{fault}: no motion"));
        }
        let changed =
            before.is_none_or(|said| (said.fault, said.armed) != (output.fault.clone(), output.armed));
        let due = changed || output.decision.is_some() || now.0.is_multiple_of(TELL_TICKS);
        // Before the text, which listeners that know the typed message pass over.
        if due || self.common.lockstep {
            self.decision.send(wire::decision(now, self.common.stamp(), &output))?;
        }
        let stale = output.decision.as_ref().is_some_and(|decision| decision.stale);
        match output.message.or(stale.then_some(output.gesture)) {
            Some(gesture) => self.emg.send(Text { data: gesture.ros_name().to_owned() }),
            None => Ok(()),
        }
    }
}

impl Stage for EmgNode {
    fn common(&mut self) -> &mut Common {
        &mut self.common
    }

    /// Time alone makes a stream stale.
    fn tick(&mut self, now: SimTime) -> rosrust::error::Result<()> {
        let Some(input) = self.person.get().cloned() else { return self.take(now, EmgStageInput::default()) };
        let heard = EmgStageInput { samples: &input.emg, gesture: input.gesture, ..EmgStageInput::default() };
        let done = self.take(now, heard);
        if let (Some(spans), Some(said)) = (&mut self.common.spans, &self.said) {
            spans.digest.input(&TickInput { emg: input.emg, ..TickInput::default() });
            spans.digest.gesture(said);
            spans.end_tick(now, &[Field::InputEmg, Field::Emg], false);
        }
        done
    }

    fn is_ready(&self, next: SimTime) -> bool {
        self.person.is(next)
    }

    fn repeat(&mut self) -> rosrust::error::Result<()> {
        match &self.said {
            Some(said) => self.decision.send(wire::decision(self.common.now(), self.common.stamp(), said)),
            None => Ok(()),
        }
    }
}

/// The samples of a message. Values that are not finite pass: the pipeline counts them.
fn samples(message: &EmgSamples) -> Result<Vec<EmgSample>, String> {
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
