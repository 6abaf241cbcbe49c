//! `proact node emg`: samples of an armband in, the gesture on `/emg` out.

use super::{
    Graph, NodeError,
    graph::Jobs,
    stage::{self, Common, Stage},
};
use crate::messages::{proact_msgs::EmgSamples, std_msgs::String as Text};
use arrayvec::ArrayVec;
use proact_emg::{EmgOutput, EmgPipeline};
use proact_types::{EmgSample, MAX_EMG_CHANNELS};
use rosrust::Publisher;
use std::ops::RangeInclusive;

struct EmgNode {
    common: Common,
    pipeline: EmgPipeline,
    emg: Publisher<Text>,
}

/// Runs the EMG stage until the graph ends the node.
///
/// # Errors
/// [`NodeError`].
pub fn run_emg(pipeline: EmgPipeline) -> Result<(), NodeError> {
    let graph = Graph::join("proact_emg")?;
    let mut node = EmgNode { common: Common::new(&graph)?, pipeline, emg: graph.publish("emg", 10, false)? };
    let jobs: Jobs<EmgNode> = Jobs::default();
    let _samples = graph.listen(
        "proact/emg_samples",
        20,
        &jobs,
        |node: &mut EmgNode, message: EmgSamples| match samples(&message) {
            Ok(samples) => {
                let done = node.take(&samples);
                node.common.note("publish", done);
            }
            Err(reason) => node.common.faults.refuse("emg_samples", &reason),
        },
    )?;
    stage::run(graph, &jobs, &mut node)
}

impl EmgNode {
    fn take(&mut self, samples: &[EmgSample]) -> rosrust::error::Result<()> {
        let output = self.pipeline.step(self.common.now(), samples);
        let events = *self.pipeline.events();
        let counts = events.counts;
        if counts.gaps + counts.unusable_samples > 0 {
            let reason = format!("{} gaps, {} unusable samples", counts.gaps, counts.unusable_samples);
            self.common.faults.refuse("emg_samples", &reason);
        }
        if let Some(fault) = self.pipeline.fault().filter(|_| events.stale) {
            self.common.faults.refuse("emg_stale", &format!("{fault}: no motion"));
        }
        self.tell(output)
    }

    fn tell(&self, output: Option<EmgOutput>) -> rosrust::error::Result<()> {
        match output.filter(|decision| decision.published || decision.stale) {
            Some(decision) => self.emg.send(Text { data: decision.gesture.ros_name().to_owned() }),
            None => Ok(()),
        }
    }
}

impl Stage for EmgNode {
    fn common(&mut self) -> &mut Common {
        &mut self.common
    }

    /// Time alone makes a stream stale.
    fn ticks(&mut self, _ticks: RangeInclusive<u64>) -> rosrust::error::Result<()> {
        self.take(&[])
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
    let sample = |(counter, values): (u64, &[f64])| {
        let channels: ArrayVec<f64, MAX_EMG_CHANNELS> = values.iter().copied().collect();
        EmgSample { counter, channels }
    };
    Ok((message.counter..).zip(message.data.chunks(channels)).map(sample).collect())
}
