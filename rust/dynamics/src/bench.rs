//! How long a tick takes. The clock belongs to the caller, so that this crate needs none.

use crate::RigidBodyPlant;
use proact_testbed::ports::{Plant, PlantError};
use proact_types::PlantCommand;

/// Times of ticks, seconds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TickTimes {
    /// Ticks measured.
    pub ticks: usize,
    /// Mean.
    pub mean_secs: f64,
    /// Half of the ticks were faster.
    pub median_secs: f64,
    /// 99 of 100 ticks were faster.
    pub p99_secs: f64,
    /// Slowest tick.
    pub worst_secs: f64,
}

/// Steps `plant` once for each command and measures each step with `seconds_now`, a clock that gives seconds
/// since any fixed moment. None if there is no command.
///
/// # Errors
/// Those of the step.
pub fn bench_ticks(
    plant: &mut RigidBodyPlant,
    commands: impl IntoIterator<Item = PlantCommand>,
    mut seconds_now: impl FnMut() -> f64,
) -> Result<Option<TickTimes>, PlantError> {
    let mut times = Vec::new();
    for command in commands {
        let start = seconds_now();
        plant.step(&command)?;
        times.push(seconds_now() - start);
    }
    times.sort_by(f64::total_cmp);
    let Some(worst_secs) = times.last().copied() else { return Ok(None) };
    let ticks = times.len();
    Ok(Some(TickTimes {
        ticks,
        mean_secs: times.iter().sum::<f64>() / ticks as f64,
        median_secs: times[ticks / 2],
        p99_secs: times[(ticks * 99 / 100).min(ticks - 1)],
        worst_secs,
    }))
}
