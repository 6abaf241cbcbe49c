use crate::{BenchFigure, BenchReport, quantile};
use proact_app::trial::{self, Assembly};
use proact_bridge::{PageContent, PageOptions, PageServer};
use proact_devices::EmgOrigin;
use proact_testbed::{Setup, TrialConfig};
use std::{error::Error, process::Command, time::Instant};

/// Starts measured. The worst of twenty stands for what a visitor may meet.
const ROUNDS: usize = 20;

/// From nothing to the first display frame on a page that is up: what a visitor waits for after the build.
///
/// # Errors
/// A trial that cannot be put together, or no free port.
pub(crate) fn start() -> Result<BenchReport, Box<dyn Error>> {
    let mut process = Vec::new();
    let mut frame = Vec::new();
    let program = std::env::current_exe()?;
    for _ in 0..ROUNDS {
        // Not --version, which asks the package manager for those of the libraries.
        let begin = Instant::now();
        Command::new(&program).arg("--help").output()?;
        process.push(begin.elapsed().as_secs_f64() * 1e3);

        let begin = Instant::now();
        first_frame()?;
        frame.push(begin.elapsed().as_secs_f64() * 1e3);
    }
    let mut figures = Vec::new();
    for (name, share) in [("median", 0.5), ("99 %", 0.99), ("worst", 1.0)] {
        let note = if share == 0.5 { "goal: under 60" } else { "" };
        let value = quantile(&process, share) + quantile(&frame, share);
        figures.push(BenchFigure::without_peer(
            &format!("command to first frame, {name}"),
            value,
            "ms",
            note,
        ));
    }
    let note = "process start and libraries alone";
    figures.push(BenchFigure::without_peer("process, median", quantile(&process, 0.5), "ms", note));
    Ok(BenchReport::new("start", figures))
}

/// Trains, assembles, serves and runs to the first frame, as `demo` does.
fn first_frame() -> Result<(), Box<dyn Error>> {
    let config = TrialConfig::new("D", 1, Setup::named("seated")?);
    let Assembly { mut trial, arm, .. } = trial::simulated_trial(config, &EmgOrigin::Synthetic)?;
    let content = PageContent {
        title: "bench".to_owned(),
        setup: "seated".to_owned(),
        arm: arm.model().as_ref().clone(),
        meshes: arm.meshes(),
        scene: trial.testbed().task().scene().clone(),
        briefing: trial.testbed().task().briefing().clone(),
        interactive: false,
        lean: false,
        method: Default::default(),
        methods: vec![],
    };
    let server = PageServer::start(PageOptions { port: 0, ..PageOptions::default() }, content)?;
    loop {
        if let Some(frame) = trial.step(false)?.frame {
            server.publish(&frame);
            return Ok(());
        }
    }
}
