//! What the plans are compared with: OMPL's own search, and planning for seconds instead of milliseconds.

use super::{Bench, length};
use crate::bench::{BenchFigure, quantile};
use proact_planning::{CancelFlag, CollisionScene, PlannerOptions, SearchLimits, SearchOutcome};
use proact_types::{PlanRequest, PlanStatus, Trajectory};
use std::{error::Error, time::Instant};

/// Share of the joint space's extent between the states that the original checked.
const ORIGINAL_STEP: f64 = 0.005;
/// How long the best of many plans is looked for, seconds.
const LONG_SECS: f64 = 5.0;

/// One search in joint space.
pub(super) struct Search {
    time_ms: f64,
    solved: bool,
    /// Its path touches something, unpadded, at fine steps.
    touches: bool,
}

impl Bench {
    /// Searches between the two ends of the part of a plan that keeps clear by the padding: once as the planner
    /// does, once by OMPL's own equal steps and full simplification, in the scene that `touches` has put up.
    pub(super) fn search_beside_plain_ompl(
        &mut self,
        request: &PlanRequest,
        trajectory: &Trajectory,
    ) -> Result<(), Box<dyn Error>> {
        let scene = &mut self.checker;
        scene.set_padding(PlannerOptions::default().padding)?;
        let mut clear = Vec::new();
        for point in &trajectory.points {
            if scene.is_free(&point.q)? {
                clear.push(point.q.to_vec());
            }
        }
        let ours = SearchLimits::default();
        let plain = SearchLimits { equal_steps: Some(ORIGINAL_STEP), ..ours };
        if let [from, .., to] = clear.as_slice() {
            let both = [ours, plain];
            for (k, limits) in both.into_iter().enumerate() {
                scene.set_padding(PlannerOptions::default().padding)?;
                let (goals, cancel) = (std::slice::from_ref(to), CancelFlag::new());
                let begin = Instant::now();
                let outcome = scene.search(from, goals, request.seed, &limits, &cancel)?;
                let time_ms = begin.elapsed().as_secs_f64() * 1e3;
                scene.set_padding(0.0)?;
                let mut touches = false;
                if let SearchOutcome::Solved { path, .. } = &outcome {
                    for pair in path.windows(2) {
                        touches |= !fine_motion_is_free(scene, &pair[0], &pair[1])?;
                    }
                }
                let solved = matches!(outcome, SearchOutcome::Solved { .. });
                self.searches[k].push(Search { time_ms, solved, touches });
            }
        }
        Ok(self.checker.set_padding(0.0)?)
    }

    pub(super) fn search_figures(&self) -> Vec<BenchFigure> {
        let [ours, plain] = &self.searches;
        if ours.is_empty() {
            return Vec::new();
        }
        let times = |all: &[Search]| all.iter().map(|s| s.time_ms).collect::<Vec<_>>();
        let share = |all: &[Search], of: fn(&Search) -> bool| {
            all.iter().filter(|s| of(s)).count() as f64 / all.len() as f64
        };
        let beside = |name: &str, unit: &str, value: f64, peer_value: f64, note: &str| BenchFigure {
            peer: Some("OMPL's own motion checks and simplifier".to_owned()),
            peer_value: Some(peer_value),
            ..BenchFigure::alone(&format!("box: joint search, {name}"), value, unit, note)
        };
        let note = "same scene and state checks; both RRTConnect; the peer takes the original's equal steps of 0.005";
        let at = |q: f64| (quantile(&times(ours), q), quantile(&times(plain), q));
        let ((median, peer_median), (high, peer_high)) = (at(0.5), at(0.99));
        vec![
            beside("median", "ms", median, peer_median, note),
            beside("99 %", "ms", high, peer_high, ""),
            beside("solved", "1", share(ours, |s| s.solved), share(plain, |s| s.solved), ""),
            beside(
                "with a contact",
                "1",
                share(ours, |s| s.touches),
                share(plain, |s| s.touches),
                "unpadded, every 3 mrad",
            ),
        ]
    }

    /// Length and duration beside the best of the plans that five seconds of other seeds give.
    pub(super) fn beside_long_searches(&mut self) -> Vec<BenchFigure> {
        let (mut lengths, mut durations) = (Vec::new(), Vec::new());
        for (request, length_once, duration_once) in std::mem::take(&mut self.kept) {
            let (mut shortest, mut quickest) = (length_once, duration_once);
            let begin = Instant::now();
            let mut seed = request.seed;
            while begin.elapsed().as_secs_f64() < LONG_SECS {
                seed = seed.wrapping_add(1);
                let reply = self.planner.solve(&PlanRequest { seed, ..request.clone() });
                if reply.status == PlanStatus::Ok {
                    shortest = shortest.min(length(&reply.trajectory));
                    quickest = quickest.min(reply.trajectory.duration_secs());
                }
            }
            lengths.push(length_once / shortest);
            durations.push(duration_once / quickest);
        }
        if lengths.is_empty() {
            return Vec::new();
        }
        let note = format!("{} problems, best of 5 s of other seeds; goal: at most 1.1", lengths.len());
        [("path length, ratio to the best", lengths), ("duration, ratio to the best", durations)]
            .map(|(name, ratios)| BenchFigure {
                peer: Some("the same planner for 5 s".to_owned()),
                peer_value: Some(1.0),
                ..BenchFigure::alone(&format!("box: {name}, median"), quantile(&ratios, 0.5), "1", &note)
            })
            .into()
    }
}

/// Looks at a straight joint motion every 3 mrad (L2).
fn fine_motion_is_free(scene: &mut CollisionScene, a: &[f64], b: &[f64]) -> Result<bool, Box<dyn Error>> {
    let long = a.iter().zip(b).map(|(x, y)| (x - y) * (x - y)).sum::<f64>().sqrt();
    let steps = (long / 0.003).ceil().max(1.0) as usize;
    for k in 0..=steps {
        let share = k as f64 / steps as f64;
        let q: Vec<f64> = a.iter().zip(b).map(|(x, y)| x + share * (y - x)).collect();
        if !scene.is_free(&q)? {
            return Ok(false);
        }
    }
    Ok(true)
}
