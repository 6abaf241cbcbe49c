//! Corners of a path are rounded, so that the arm need not slow down for them.

use crate::context::PlanningContext;
use crate::failure::Failure;
use crate::route::{Route, distance, mix};

/// Longest piece of a blend that is checked as one straight motion, rad (L2).
const PIECE: f64 = 0.04;
/// Shares of the room up to the middle of the next motion that a blend may take, the widest first.
const SHARES: [f64; 4] = [1.0, 0.5, 0.25, 0.125];

/// `route` with its corners between the straight ways replaced by parabolas, as wide as there is room for. A corner without
/// room stays.
pub(crate) fn blended(context: &mut PlanningContext, route: &Route) -> Result<Route, Failure> {
    context.keep(route.searched)?;
    let path = &route.points;
    let [left, entered] = route.curved;
    let mut round = path[..=left].to_vec();
    let corners = if entered > left { path[left..=entered].windows(3) } else { [].windows(3) };
    for around in corners {
        match blend(context, around, route.searched)? {
            Some(blend) => round.extend(blend),
            None => round.push(around[1].clone()),
        }
    }
    if entered > left {
        round.push(path[entered].clone());
    }
    let end = round.len() - 1;
    round.extend_from_slice(&path[entered + 1..]);
    Ok(Route { points: round, curved: [left, end], searched: route.searched })
}

/// The widest blend that keeps `padding` of the corner at the second of three points; none if no width is free.
fn blend(
    context: &mut PlanningContext,
    around: &[Vec<f64>],
    padding: f64,
) -> Result<Option<Vec<Vec<f64>>>, Failure> {
    let [before, corner, after] = around else { return Ok(None) };
    let lengths = [before, after].map(|end| distance(corner, end));
    let half = 0.5 * lengths[0].min(lengths[1]);
    let limits = context.limits_with(padding);
    for share in SHARES {
        let leg = share * half;
        if leg < PIECE {
            break;
        }
        context.go_on()?;
        let ends =
            [(before, lengths[0]), (after, lengths[1])].map(|(end, length)| mix(corner, end, leg / length));
        let blend = parabola(&ends[0], corner, &ends[1], (2.0 * leg / PIECE).ceil() as usize);
        if context.scene.path_is_free(blend.iter().map(Vec::as_slice), &limits)? {
            return Ok(Some(blend));
        }
    }
    Ok(None)
}

/// A parabola from `from` to `to` whose ends point to `corner`, in so many pieces.
fn parabola(from: &[f64], corner: &[f64], to: &[f64], pieces: usize) -> Vec<Vec<f64>> {
    let at = |k: usize| {
        let s = k as f64 / pieces as f64;
        mix(&mix(from, corner, s), &mix(corner, to, s), s)
    };
    (0..=pieces).map(at).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_parabola_leaves_along_the_first_motion_and_arrives_along_the_second() {
        let points = parabola(&[0.0, 0.0], &[1.0, 0.0], &[1.0, 1.0], 200);
        assert_eq!((&points[0], &points[200]), (&vec![0.0, 0.0], &vec![1.0, 1.0]));
        let slope = |a: &[f64], b: &[f64]| (b[1] - a[1]).atan2(b[0] - a[0]);
        assert!(slope(&points[0], &points[1]).abs() < 0.01);
        assert!((slope(&points[199], &points[200]) - std::f64::consts::FRAC_PI_2).abs() < 0.01);
        // It cuts the corner by half of the way to the chord's middle.
        assert!(distance(&points[100], &[0.75, 0.25]) < 1e-12);
    }
}
