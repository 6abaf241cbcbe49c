//! OMPL's planners by name, each on the same problems, beside the default.

use super::{BenchRun, planner, problems::obstacles};
use crate::{BenchFigure, quantile};
use proact_planning::{PlannerName, PlannerOptions, Roadmap, SearchLimits};
use proact_types::{PlanRequest, PlanStatus, TrunkPosture};
use std::{error::Error, time::Instant};

/// Most problems that every planner is given: the first ones in the box that are not cluttered.
const PROBLEMS: usize = 24;
/// Milestones of the stored roadmap.
const MILESTONES: usize = 1000;
/// Iterations of RRT*, which spends them all.
const STAR_ITERATIONS: u32 = 500;

/// What a planner made of one problem: processor time, ms, and the plan's duration, s, if it found one.
type PlannerOutcome = (f64, Option<f64>);

impl BenchRun {
    pub(super) fn compare_planners(
        &mut self,
        max_problems: usize,
    ) -> Result<Vec<BenchFigure>, Box<dyn Error>> {
        let mut requests = Vec::new();
        let count = max_problems.clamp(1, PROBLEMS);
        for number in (0..2 * PROBLEMS).filter(|n| !n.is_multiple_of(super::CLUTTERED_EVERY)).take(count) {
            requests.push(self.problem_generator.problem(number, false)?.request);
        }
        let begin = Instant::now();
        let roadmap = self.stored_roadmap()?;
        let grown_secs = begin.elapsed().as_secs_f64();
        let usual = self.run_planner(&requests, PlannerOptions::default(), None)?;
        let mut figures = vec![BenchFigure::without_peer(
            "stored roadmap, grown in",
            grown_secs,
            "s",
            &format!(
                "{} milestones, {} edges, in the box without blocks",
                roadmap.milestones.len(),
                roadmap.edges.len()
            ),
        )];
        let others = PlannerName::ALL.into_iter().filter(|&name| name != PlannerName::default());
        for (name, roadmap) in others.map(|name| (name, None)).chain([(PlannerName::Prm, Some(roadmap))]) {
            let title = format!("{name}{}", if roadmap.is_some() { " over the stored roadmap" } else { "" });
            let mut search = SearchLimits::default();
            if name == PlannerName::RrtStar {
                search.max_iterations = STAR_ITERATIONS;
            }
            let options = PlannerOptions { name, search, ..PlannerOptions::default() };
            let made = self.run_planner(&requests, options, roadmap.as_ref())?;
            figures.extend(comparison_figures(&title, &made, &usual));
        }
        Ok(figures)
    }

    /// Grown for the shoulder that keeps still and an open hand; written and read back as it is stored.
    fn stored_roadmap(&mut self) -> Result<Roadmap, Box<dyn Error>> {
        let base = self.setup.body.shoulder_pose(&TrunkPosture::default());
        let hand = self.model.pose("hand", "open")?.to_vec();
        let grown = self.planner.grow_roadmap(MILESTONES, &hand, &obstacles(&[]), &base, 1)?;
        Ok(serde_json::from_str(&serde_json::to_string(&grown)?)?)
    }

    fn run_planner(
        &self,
        requests: &[PlanRequest],
        options: PlannerOptions,
        roadmap: Option<&Roadmap>,
    ) -> Result<Vec<PlannerOutcome>, Box<dyn Error>> {
        let mut planner = planner(&self.model, options)?;
        planner.set_roadmap(roadmap)?;
        let plan = |request| {
            let reply = planner.solve(request);
            let duration = (reply.status == PlanStatus::Ok).then(|| reply.trajectory.duration_secs());
            (planner.stats().cpu_secs * 1e3, duration)
        };
        Ok(requests.iter().map(plan).collect())
    }
}

fn comparison_figures(title: &str, made: &[PlannerOutcome], usual: &[PlannerOutcome]) -> Vec<BenchFigure> {
    let share = |of: &[PlannerOutcome]| of.iter().filter(|m| m.1.is_some()).count() as f64 / of.len() as f64;
    let median = |of: &[PlannerOutcome]| quantile(&of.iter().map(|m| m.0).collect::<Vec<f64>>(), 0.5);
    let both = made.iter().zip(usual).filter_map(|(a, b)| Some(a.1? / b.1?));
    let ratios: Vec<f64> = both.collect();
    let figure = |name: &str, value: f64, peer_value: f64, unit: &str| BenchFigure {
        peer: Some(PlannerName::default().to_string()),
        peer_value: Some(peer_value),
        ..BenchFigure::without_peer(
            &format!("{title}: {name}"),
            value,
            unit,
            &format!("{} problems in the box", made.len()),
        )
    };
    let mut figures = vec![
        figure("solved", share(made), share(usual), "1"),
        figure("plan on the processor, median", median(made), median(usual), "ms"),
    ];
    if !ratios.is_empty() {
        figures.push(figure("duration over the default's, median", quantile(&ratios, 0.5), 1.0, "1"));
    }
    figures
}
