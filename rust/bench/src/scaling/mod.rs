//! `proact bench growth`: how cost grows with what is asked for, and where that ends.

mod processes;
mod stages;

use crate::{BenchChart, BenchFigure, BenchReport};
use proact_app::analysis::growth_curve;
use std::error::Error;

/// One thing that grows: a cost at several sizes.
struct ScalingChart {
    /// Of the chart's file.
    file: &'static str,
    /// What there is more and more of.
    size_label: &'static str,
    /// What it costs, with its unit.
    cost_label: &'static str,
    unit: &'static str,
    lines: Vec<ScalingLine>,
}

struct ScalingLine {
    name: String,
    /// Size and cost.
    points: Vec<(f64, f64)>,
    /// What bounds it.
    bound: String,
}

/// Ticks over objects, plans over clutter, the page over clients, batches over jobs and memory over minutes. About five minutes.
///
/// # Errors
/// A part that refuses, or a program that cannot be started.
pub(crate) fn scaling() -> Result<BenchReport, Box<dyn Error>> {
    let grown = [
        stages::objects()?,
        stages::clutter()?,
        stages::clients()?,
        processes::jobs()?,
        processes::minutes()?,
    ];
    let mut figures = Vec::new();
    let mut charts = Vec::new();
    for ScalingChart { file, size_label: of, cost_label: cost, unit, lines } in &grown {
        for ScalingLine { name, points, bound } in lines {
            for (size, value) in points {
                figures.push(BenchFigure::without_peer(&format!("{name}: {size} {of}"), *value, unit, ""));
            }
            let note = format!("{cost} grows with this power of {of} over the upper half; {bound}");
            figures.push(BenchFigure::without_peer(
                &format!("{name}: exponent"),
                exponent(points),
                "1",
                &note,
            ));
        }
        let points: Vec<(String, f64, f64)> = lines
            .iter()
            .flat_map(|line| line.points.iter().map(|&(size, cost)| (line.name.clone(), size, cost)))
            .collect();
        let (svg, _) = growth_curve(of, &format!("{cost}, {unit}"), &points)?;
        charts.push(BenchChart { name: (*file).to_owned(), svg });
    }
    Ok(BenchReport { charts, ..BenchReport::new("growth", figures) })
}

/// The power of the size with which the cost grows over the upper half of the sizes: the slope of the least squares line through
/// the logarithms. What does not depend on the size has zero.
fn exponent(points: &[(f64, f64)]) -> f64 {
    let upper: Vec<(f64, f64)> =
        points[points.len() / 2..].iter().map(|(size, cost)| (size.ln(), cost.ln())).collect();
    let count = upper.len() as f64;
    let [x, y] =
        [upper.iter().map(|p| p.0).sum::<f64>() / count, upper.iter().map(|p| p.1).sum::<f64>() / count];
    let across: f64 = upper.iter().map(|p| (p.0 - x) * (p.1 - y)).sum();
    across / upper.iter().map(|p| (p.0 - x).powi(2)).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_exponent_is_that_of_the_upper_half() {
        let cost = |size: f64| if size < 10.0 { 7.0 } else { 3.0 * size.powf(1.5) };
        let points: Vec<(f64, f64)> = [1.0, 2.0, 5.0, 10.0, 20.0, 50.0].map(|n| (n, cost(n))).to_vec();
        assert!((exponent(&points) - 1.5).abs() < 1e-9);
        assert_eq!(exponent(&[(1.0, 4.0), (2.0, 4.0), (4.0, 4.0), (8.0, 4.0)]), 0.0);
    }
}
