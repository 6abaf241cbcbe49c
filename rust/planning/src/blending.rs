//! Corners of a path are rounded, so that the arm need not slow down for them.

use crate::context::PlanningContext;
use crate::failure::Failure;
use crate::reach;
use crate::route::{Route, distance, mix};

/// Longest piece of a blend, rad (L2): about as long as control points of the curve are apart, or the arm slows down for each
/// corner between two pieces.
const PIECE: f64 = 0.02;
/// Shortest leg of a blend, rad (L2).
const SHORTEST: f64 = 0.04;
/// Shares of the room up to the middle of the next motion that a blend may take, the widest first.
const SHARES: [f64; 4] = [1.0, 0.5, 0.25, 0.125];
/// So much of a straight way off the start or into the goal stays straight, metres: a block's height.
const STRAIGHT: f64 = 0.05;

/// `route` with its corners replaced by parabolas, as wide as there is room for: those between the straight ways, and those at
/// which these meet the rest. A corner without room stays.
pub(crate) fn blended(context: &mut PlanningContext, route: &Route) -> Result<Route, Failure> {
    context.keep(route.searched)?;
    let path = &route.points;
    let [left, entered] = route.curved;
    if entered <= left {
        return Ok(Route { points: path.clone(), ..*route });
    }
    let spare = |points: usize| points.saturating_sub(reach::line_steps(STRAIGHT));
    let way_out = &path[left - spare(left)..=left];
    let (begin, off) = blend_of_way(context, way_out, &path[left + 1], route.searched)?;
    let mut way_in = path[entered..=entered + spare(path.len() - 1 - entered)].to_vec();
    way_in.reverse();
    let (end, mut onto) = blend_of_way(context, &way_in, &path[entered - 1], route.searched)?;
    onto.reverse();

    let mut round = path[..=left - begin].to_vec();
    round.extend(off);
    for around in path[left..=entered].windows(3) {
        match blend(context, around, route.searched)? {
            Some(blend) => round.extend(blend),
            None => round.push(around[1].clone()),
        }
    }
    round.extend(onto);
    let curved = [left - begin, round.len()];
    round.extend_from_slice(&path[entered + end..]);
    Ok(Route { points: round, curved, searched: route.searched })
}

/// The widest blend that keeps `padding` of the corner at the end of a straight way, from which a motion leads to `next`: how
/// many points before the corner it begins, and its points but for the first.
fn blend_of_way(
    context: &mut PlanningContext,
    way: &[Vec<f64>],
    next: &[f64],
    padding: f64,
) -> Result<(usize, Vec<Vec<f64>>), Failure> {
    let last = way.len() - 1;
    let corner = &way[last];
    let length = distance(corner, next);
    let limits = context.limits_with(padding);
    let mut points = last;
    while points > 0 {
        let from = &way[last - points];
        let leg = distance(from, corner).min(0.5 * length);
        if leg < SHORTEST {
            break;
        }
        context.go_on()?;
        let to = mix(corner, next, leg / length);
        let mut blend = parabola(from, corner, &to, (2.0 * leg / PIECE).ceil() as usize);
        if context.scene.path_is_free(blend.iter().map(Vec::as_slice), &limits)? {
            blend.remove(0);
            return Ok((points, blend));
        }
        points /= 2;
    }
    Ok((0, Vec::new()))
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
        if leg < SHORTEST {
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
