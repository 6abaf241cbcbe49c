//! `proact bench localization`: simulated sessions with known truth, ours beside the original's method, what each source of error
//! costs, and what no filter can do better.
//!
//! A minute of free head movement calibrates, then a minute of work is shown. Noise 0.3 mm and 0.2 degrees in each coordinate of
//! both systems, 5 % occlusion in bursts, delays of 4 ms and up to 20 ms more, a drift of 1 cm a minute whose direction
//! wanders. Movements are sums of sines of random phases, 0.1 to 2 Hz, and leans of minimum jerk.

mod bound;
mod session;
mod simulated;

use crate::{BenchFigure, BenchReport, quantile};
use session::{Found, session};
use simulated::{Conditions, Simulated};
use std::{error::Error, ops::Range};

const SEEDS: Range<u64> = 0..100;
/// Seeds on which the filter was made, and on which sources of error are left out one by one.
const DESIGN_SEEDS: Range<u64> = 50_000..50_010;
/// 0.2 degrees in all, instead of in each of three coordinates.
const TOTAL_NOISE_DEG: f64 = 0.115_470_053_837_925_16;

/// All sessions of `seeds`, ours and the original's, on all cores; in the order of their seeds.
fn sessions(
    seeds: Range<u64>,
    conditions: &Conditions,
    bar: &indicatif::ProgressBar,
) -> Result<(Found, Found), Box<dyn Error>> {
    let jobs = std::thread::available_parallelism().map_or(1, |cores| cores.get() as u64);
    let each = (seeds.end - seeds.start).div_ceil(jobs).max(1);
    let run = |part: Range<u64>| -> Result<(Found, Found), String> {
        let (mut ours, mut original) = (Found::default(), Found::default());
        for seed in part {
            session(seed, conditions, &mut ours, &mut original).map_err(|error| error.to_string())?;
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
    let (mut ours, mut original) = (Found::default(), Found::default());
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
    let (ours, original) = sessions(SEEDS, &Conditions::STATED, &bar)?;
    let mut figures = Vec::new();
    let peer = "original's method";
    let mut all = |name: &str, unit: &str, factor: f64, note: &str, ours: &[f64], original: &[f64]| {
        for (share, word) in [(0.5, "median"), (0.99, "99 %"), (1.0, "worst")] {
            let figure =
                BenchFigure::alone(&format!("{name}, {word}"), factor * quantile(ours, share), unit, note);
            figures.push(figure.beside(peer, factor * quantile(original, share)));
        }
    };
    let note = "of 100 seeds, at the head; the original is given the true place of its markers";
    all("calibration, place", "mm", 1e3, note, &ours.calibration.m, &original.calibration.m);
    all("calibration, attitude", "deg", 1.0, note, &ours.calibration.deg, &original.calibration.deg);
    let note = "every frame of 57 s, 100 seeds, occlusions included";
    all("displayed base, place", "mm", 1e3, note, &ours.shown.m, &original.shown.m);
    all("displayed base, attitude", "deg", 1.0, note, &ours.shown.deg, &original.shown.deg);
    all(
        "lag of the displayed base",
        "ms",
        1.0,
        "best fitting shift, in steps of 1 ms",
        &ours.lag_ms,
        &original.lag_ms,
    );
    let within = BenchFigure::alone(
        "displayed base within 5 mm and 0.5 deg",
        100.0 * ours.shown.within(),
        "%",
        "of frames",
    );
    figures.push(within.beside(peer, 100.0 * original.shown.within()));
    for (seen, words) in [(true, "seen in the last 60 ms"), (false, "in longer gaps")] {
        let name = format!("displayed base within 5 mm and 0.5 deg, {words}");
        let share =
            100.0 * ours.seen.iter().filter(|is| **is == seen).count() as f64 / ours.seen.len() as f64;
        let value = 100.0 * ours.shown.within_where(|k| ours.seen[k] == seen);
        figures.push(BenchFigure::alone(
            &name,
            value,
            "%",
            &format!("of the {share:.1} % of frames that are so"),
        ));
    }
    for (name, conditions) in left_out {
        let (ours, _) = sessions(DESIGN_SEEDS, &conditions, &bar)?;
        let name = format!("displayed base within 5 mm and 0.5 deg, {name}");
        figures.push(BenchFigure::alone(&name, 100.0 * ours.shown.within(), "%", "10 other seeds"));
        for (part, errors) in
            [("headset's world alone", &ours.headset), ("shoulder's filter alone", &ours.followed)]
        {
            let name = name.replace("displayed base", part);
            figures.push(BenchFigure::alone(&name, 100.0 * errors.within(), "%", "10 other seeds"));
        }
    }
    bar.finish_and_clear();
    for (words, noise_deg) in [("in each coordinate", 0.2), ("in all", TOTAL_NOISE_DEG)] {
        let conditions = Conditions { noise_deg, ..Conditions::STATED };
        let streams: Vec<_> = DESIGN_SEEDS.map(|seed| Simulated::new(seed, &conditions).shoulder).collect();
        let name = format!("most that any filter can have within 0.5 deg, 0.2 deg {words}");
        let note = "sway of known spectrum without leans, errors of place and headset left out";
        figures.push(BenchFigure::alone(&name, bound::most_within(&conditions, &streams), "%", note));
    }
    Ok(BenchReport::new("localization", figures))
}

/// What a session is without one source of error each.
fn sources_of_error() -> [(&'static str, Conditions); 7] {
    let stated = Conditions::STATED;
    [
        ("10 other seeds", stated),
        ("without occlusion", Conditions { occluded: 0.0, ..stated }),
        ("without noise of attitude", Conditions { noise_deg: 0.0, ..stated }),
        ("with 0.2 deg in all, not in each coordinate", Conditions { noise_deg: TOTAL_NOISE_DEG, ..stated }),
        ("without jitter", Conditions { jitter_secs: 0.0, ..stated }),
        ("without drift", Conditions { drift_m_per_s: 0.0, ..stated }),
        ("without leans", Conditions { leans: false, ..stated }),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_sessions_are_calibrated_to_3_mm_and_less_late_than_the_originals() {
        let (mut ours, mut original) = (Found::default(), Found::default());
        for seed in 1000..1003 {
            session(seed, &Conditions::STATED, &mut ours, &mut original).unwrap();
        }
        assert!(ours.calibration.m.iter().all(|m| *m < 0.003), "{:?}", ours.calibration.m);
        assert!(ours.calibration.deg.iter().all(|deg| *deg < 0.3), "{:?}", ours.calibration.deg);
        assert!(quantile(&ours.lag_ms, 1.0) < 20.0 && quantile(&original.lag_ms, 0.5) > 40.0);
        assert!(ours.shown.within() > 0.95 && original.shown.within() < 0.3, "{}", ours.shown.within());
    }
}
