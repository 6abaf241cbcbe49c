//! Figures of each stage, with those of a peer from the same run beside them where there is one.
// They panic where the output is closed or full.
#![deny(clippy::print_stdout, clippy::print_stderr)]
#![allow(clippy::disallowed_methods)] // A bench reads the clock, and starts peers as processes.
#![cfg_attr(test, allow(clippy::unwrap_used))]

mod bridge;
mod chain;
mod dynamics;
mod emg;
mod kinematics;
mod localization;
mod planning;
mod python_peer;
#[cfg(feature = "ros")]
mod ros;
pub mod safety;
mod scaling;
mod start;

use rustix::time::{ClockId, clock_gettime};
use serde::Serialize;
use std::error::Error;

/// Ticks of the bench `chain` for each method: 400 windows.
const CHAIN_TICKS: u64 = 20_000;

/// The stages that can be measured.
pub const STAGES: [&str; 11] = [
    "bridge",
    "chain",
    "emg",
    "growth",
    "kinematics",
    "localization",
    "dynamics",
    "planning",
    "ros",
    "safety",
    "start",
];

/// Measures one of [`STAGES`]; `problems` are those of the stage `planning`.
///
/// # Errors
/// No such stage, one that this build lacks, or a part that refuses.
pub fn run(stage: &str, problems: PlanningBench) -> Result<BenchReport, Box<dyn Error>> {
    match stage {
        "bridge" => bridge::bridge(),
        "chain" => chain::chain(CHAIN_TICKS),
        "emg" => emg::emg(),
        "growth" => scaling::scaling(),
        "kinematics" => Ok(kinematics::kinematics()?),
        "localization" => localization::localization(),
        "dynamics" => dynamics::dynamics(),
        "planning" => planning::planning(problems),
        #[cfg(feature = "ros")]
        "ros" => ros::ros(),
        #[cfg(not(feature = "ros"))]
        "ros" => Err("this build knows no ROS; ./proact ros-binary FILE builds a program that does, then FILE bench ros".into()),
        "safety" => safety::safety(),
        "start" => start::start(),
        _ => Err(format!("there is no stage {stage:?} to measure; expected one of {}", STAGES.join(", ")).into()),
    }
}

pub use planning::PlanningBench;

/// Figures of one stage.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BenchReport {
    /// Such as `kinematics`.
    pub stage: String,
    /// What was measured.
    pub figures: Vec<BenchFigure>,
    /// The same drawn, where that says more.
    #[serde(skip)]
    pub charts: Vec<BenchChart>,
}

/// A chart.
#[derive(Clone, Debug, PartialEq)]
pub struct BenchChart {
    /// Its name as a file, without an ending.
    pub name: String,
    /// What it is, as SVG.
    pub svg: String,
}

/// One figure.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BenchFigure {
    /// What it is.
    pub name: String,
    /// Its value.
    pub value: f64,
    /// Unit of value and peer's value.
    pub unit: String,
    /// Whom it is compared with.
    pub peer: Option<String>,
    /// The same of the peer, from the same run.
    pub peer_value: Option<f64>,
    /// What helps to read it.
    pub note: String,
}

impl BenchReport {
    pub(crate) fn new(stage: &str, figures: Vec<BenchFigure>) -> Self {
        Self { stage: stage.to_owned(), figures, charts: Vec::new() }
    }
}

impl std::fmt::Display for BenchReport {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        writeln!(f, "{}", self.stage)?;
        for figure in &self.figures {
            write!(f, "  {:42} {:12.3} {:3}", figure.name, figure.value, figure.unit)?;
            if let (Some(peer), Some(value)) = (&figure.peer, figure.peer_value) {
                write!(f, "  {peer}: {value:.3}")?;
            }
            if !figure.note.is_empty() {
                write!(f, "  ({})", figure.note)?;
            }
            writeln!(f)?;
        }
        Ok(())
    }
}

impl BenchFigure {
    pub(crate) fn without_peer(name: &str, value: f64, unit: &str, note: &str) -> Self {
        let (name, unit, note) = (name.to_owned(), unit.to_owned(), note.to_owned());
        Self { name, value, unit, peer: None, peer_value: None, note }
    }

    pub(crate) fn with_peer(mut self, peer: &str, value: f64) -> Self {
        (self.peer, self.peer_value) = (Some(peer.to_owned()), Some(value));
        self
    }
}

/// The value below which `share` of the values lie; the largest for a share of one.
pub(crate) fn quantile(values: &[f64], share: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let index = (share * sorted.len() as f64).ceil() as usize;
    sorted[index.clamp(1, sorted.len()) - 1]
}

/// Seconds that this thread has spent on a core: what others on the machine take is not in it.
pub(crate) fn thread_cpu_secs() -> f64 {
    let spent = clock_gettime(ClockId::ThreadCPUTime);
    spent.tv_sec as f64 + 1e-9 * spent.tv_nsec as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_of_a_hundred_numbers_are_those_numbers() {
        let values: Vec<f64> = (1..=100).rev().map(f64::from).collect();
        assert_eq!([0.5, 0.99, 1.0].map(|share| quantile(&values, share)), [50.0, 99.0, 100.0]);
        assert_eq!(quantile(&[3.0], 0.5), 3.0);
    }
}
