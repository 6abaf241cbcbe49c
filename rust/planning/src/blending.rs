//! Corners of a path are rounded, so that the arm need not slow down for them.

use crate::context::{Clearance, PlanningContext};
use crate::failure::Failure;

/// Longest piece of a blend that is checked as one straight motion, rad (L2).
const PIECE: f64 = 0.04;
/// Shares of the room up to the middle of the next motion that a blend may take, the widest first.
const SHARES: [f64; 4] = [1.0, 0.5, 0.25, 0.125];

/// `path` with its corners between the points `left` and `entered` replaced by parabolas, as wide as there is
/// room for; and where the last of the two now stands. A corner without room stays.
pub(crate) fn blended(
    context: &mut PlanningContext,
    path: &[Vec<f64>],
    left: usize,
    entered: usize,
) -> Result<(Vec<Vec<f64>>, usize), Failure> {
    context.set_clearance(Clearance::Transit)?;
    let mut round = path[..=left].to_vec();
    for k in left + 1..entered {
        match blend(context, &path[k - 1], &path[k], &path[k + 1])? {
            Some(blend) => round.extend(blend),
            None => round.push(path[k].clone()),
        }
    }
    if entered > left {
        round.push(path[entered].clone());
    }
    let end = round.len() - 1;
    round.extend_from_slice(&path[entered + 1..]);
    Ok((round, end))
}

/// The widest free blend of the corner between two straight motions; none if no width is free.
fn blend(
    context: &mut PlanningContext,
    before: &[f64],
    corner: &[f64],
    after: &[f64],
) -> Result<Option<Vec<Vec<f64>>>, Failure> {
    let lengths = [before, after].map(|end| distance(corner, end));
    let half = 0.5 * lengths[0].min(lengths[1]);
    let limits = context.limits_of_transit();
    'narrower: for share in SHARES {
        let leg = share * half;
        if leg < PIECE {
            break;
        }
        context.go_on()?;
        let ends =
            [(before, lengths[0]), (after, lengths[1])].map(|(end, length)| mix(corner, end, leg / length));
        let blend = parabola(&ends[0], corner, &ends[1], (2.0 * leg / PIECE).ceil() as usize);
        for pair in blend.windows(2) {
            if !context.scene.motion_is_free(&pair[0], &pair[1], &limits)? {
                continue 'narrower;
            }
        }
        return Ok(Some(blend));
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

/// The point a share of the way from `a` to `b`.
fn mix(a: &[f64], b: &[f64], share: f64) -> Vec<f64> {
    a.iter().zip(b).map(|(x, y)| x + share * (y - x)).collect()
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| (x - y) * (x - y)).sum::<f64>().sqrt()
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
