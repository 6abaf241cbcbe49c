//! `proact bench localization`: simulated sessions with known truth, ours beside the original's method, what each source of error
//! costs, and what no filter can do better.
//!
//! A minute of free head movement calibrates, then a minute of work is shown. Noise 0.3 mm and 0.2 degrees in each coordinate of
//! both systems, 5 % occlusion in bursts, delays of 4 ms and up to 20 ms more, a drift of 1 cm a minute whose direction
//! wanders. Movements are sums of sines of random phases, 0.1 to 2 Hz, and leans of minimum jerk.

mod accuracy_bound;
mod simulated_tracking;
mod tracking_run;

use crate::{BenchFigure, BenchReport, quantile};
use simulated_tracking::{SimulatedTracking, TrackingConditions};
use std::{error::Error, ops::Range};
use tracking_run::{LocalizationResults, simulate_run};

const SEEDS: Range<u64> = 0..100;
/// Seeds on which the filter was made, and on which sources of error are left out one by one.
const DESIGN_SEEDS: Range<u64> = 50_000..50_010;
/// 0.2 degrees in all, instead of in each of three coordinates.
const TOTAL_NOISE_DEG: f64 = 0.115_470_053_837_925_16;

/// All sessions of `seeds`, ours and the original's, on all cores; in the order of their seeds.
fn simulate_runs(
    seeds: Range<u64>,
    conditions: &TrackingConditions,
    bar: &indicatif::ProgressBar,
) -> Result<(LocalizationResults, LocalizationResults), Box<dyn Error>> {
    let jobs = std::thread::available_parallelism().map_or(1, |cores| cores.get() as u64);
    let each = (seeds.end - seeds.start).div_ceil(jobs).max(1);
    let run = |part: Range<u64>| -> Result<(LocalizationResults, LocalizationResults), String> {
        let (mut ours, mut original) = (LocalizationResults::default(), LocalizationResults::default());
        for seed in part {
            simulate_run(seed, conditions, &mut ours, &mut original).map_err(|error| error.to_string())?;
            bar.inc(1);
        }
        Ok((ours, original))
    };
    let parts: Vec<_> = std::thread::scope(|scope| {
        let run = &run;
        let starts = (seeds.start..seeds.end).step_by(each as usize);
        let threads: Vec<_> =
            starts.map(|start| scope.spawn(move || run(start..(start + each).min(seeds.end)))).collect();
        threads.into_iter().map(std::thread::ScopedJoinHandle::join).collect()
    });
    let (mut ours, mut original) = (LocalizationResults::default(), LocalizationResults::default());
    for part in parts {
        let (some, others) = part.map_err(|_| "a session panicked")??;
        ours.append(some);
        original.append(others);
    }
    Ok((ours, original))
}

/// All sessions as figures.
pub(crate) fn localization() -> Result<BenchReport, Box<dyn Error>> {
    let left_out = sources_of_error();
    let count = SEEDS.end - SEEDS.start + left_out.len() as u64 * (DESIGN_SEEDS.end - DESIGN_SEEDS.start);
    let bar = indicatif::ProgressBar::new(count);
    let (ours, original) = simulate_runs(SEEDS, &TrackingConditions::NOMINAL, &bar)?;
    let mut figures = Vec::new();
    let peer = "original's method";
    let mut all = |name: &str, unit: &str, factor: f64, note: &str, ours: &[f64], original: &[f64]| {
        for (share, word) in [(0.5, "median"), (0.99, "99 %"), (1.0, "worst")] {
            let figure = BenchFigure::without_peer(
                &format!("{name}, {word}"),
                factor * quantile(ours, share),
                unit,
                note,
            );
            figures.push(figure.with_peer(peer, factor * quantile(original, share)));
        }
    };
    let note = "of 100 seeds, at the head; the original is given the true place of its markers";
    all(
        "calibration, place",
        "mm",
        1e3,
        note,
        &ours.calibration.position_m,
        &original.calibration.position_m,
    );
    all(
        "calibration, attitude",
        "deg",
        1.0,
        note,
        &ours.calibration.rotation_deg,
        &original.calibration.rotation_deg,
    );
    let note = "every frame of 57 s, 100 seeds, occlusions included";
    all(
        "displayed base, place",
        "mm",
        1e3,
        note,
        &ours.displayed_base.position_m,
        &original.displayed_base.position_m,
    );
    all(
        "displayed base, attitude",
        "deg",
        1.0,
        note,
        &ours.displayed_base.rotation_deg,
        &original.displayed_base.rotation_deg,
    );
    all(
        "lag of the displayed base",
        "ms",
        1.0,
        "best fitting shift, in steps of 1 ms",
        &ours.lag_ms,
        &original.lag_ms,
    );
    let within = BenchFigure::without_peer(
        "displayed base within 5 mm and 0.5 deg",
        100.0 * ours.displayed_base.proportion_within(),
        "%",
        "of frames",
    );
    figures.push(within.with_peer(peer, 100.0 * original.displayed_base.proportion_within()));
    for (seen, words) in [(true, "seen in the last 60 ms"), (false, "in longer gaps")] {
        let name = format!("displayed base within 5 mm and 0.5 deg, {words}");
        let share = 100.0 * ours.brace_visible.iter().filter(|is| **is == seen).count() as f64
            / ours.brace_visible.len() as f64;
        let value = 100.0 * ours.displayed_base.proportion_within_where(|k| ours.brace_visible[k] == seen);
        figures.push(BenchFigure::without_peer(
            &name,
            value,
            "%",
            &format!("of the {share:.1} % of frames that are so"),
        ));
    }
    for (name, conditions) in left_out {
        let (ours, _) = simulate_runs(DESIGN_SEEDS, &conditions, &bar)?;
        let name = format!("displayed base within 5 mm and 0.5 deg, {name}");
        figures.push(BenchFigure::without_peer(
            &name,
            100.0 * ours.displayed_base.proportion_within(),
            "%",
            "10 other seeds",
        ));
        for (part, errors) in
            [("headset's world alone", &ours.headset_world), ("shoulder's filter alone", &ours.tracked_base)]
        {
            let name = name.replace("displayed base", part);
            figures.push(BenchFigure::without_peer(
                &name,
                100.0 * errors.proportion_within(),
                "%",
                "10 other seeds",
            ));
        }
    }
    bar.finish_and_clear();
    for (words, noise_deg) in [("in each coordinate", 0.2), ("in all", TOTAL_NOISE_DEG)] {
        let conditions = TrackingConditions { noise_deg, ..TrackingConditions::NOMINAL };
        let streams: Vec<_> =
            DESIGN_SEEDS.map(|seed| SimulatedTracking::new(seed, &conditions).shoulder).collect();
        let name = format!("most that any filter can have within 0.5 deg, 0.2 deg {words}");
        let note = "sway of known spectrum without leans, errors of place and headset left out";
        figures.push(BenchFigure::without_peer(
            &name,
            accuracy_bound::max_proportion_within(&conditions, &streams),
            "%",
            note,
        ));
    }
    Ok(BenchReport::new("localization", figures))
}

/// What a session is without one source of error each.
fn sources_of_error() -> [(&'static str, TrackingConditions); 7] {
    let stated = TrackingConditions::NOMINAL;
    [
        ("10 other seeds", stated),
        ("without occlusion", TrackingConditions { occluded_proportion: 0.0, ..stated }),
        ("without noise of attitude", TrackingConditions { noise_deg: 0.0, ..stated }),
        (
            "with 0.2 deg in all, not in each coordinate",
            TrackingConditions { noise_deg: TOTAL_NOISE_DEG, ..stated },
        ),
        ("without jitter", TrackingConditions { jitter_secs: 0.0, ..stated }),
        ("without drift", TrackingConditions { drift_m_per_s: 0.0, ..stated }),
        ("without leans", TrackingConditions { leans: false, ..stated }),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_sessions_are_calibrated_to_3_mm_and_less_late_than_the_originals() {
        let (mut ours, mut original) = (LocalizationResults::default(), LocalizationResults::default());
        for seed in 1000..1003 {
            simulate_run(seed, &TrackingConditions::NOMINAL, &mut ours, &mut original).unwrap();
        }
        assert!(ours.calibration.position_m.iter().all(|m| *m < 0.003), "{:?}", ours.calibration.position_m);
        assert!(
            ours.calibration.rotation_deg.iter().all(|deg| *deg < 0.3),
            "{:?}",
            ours.calibration.rotation_deg
        );
        assert!(quantile(&ours.lag_ms, 1.0) < 20.0 && quantile(&original.lag_ms, 0.5) > 40.0);
        assert!(
            ours.displayed_base.proportion_within() > 0.95
                && original.displayed_base.proportion_within() < 0.3,
            "{}",
            ours.displayed_base.proportion_within()
        );
    }
}
