//! Corners of a path are rounded, so that the arm need not slow down for them.

use crate::axis_ik;
use crate::context::PlanningContext;
use crate::failure::PlanFailure;
use crate::joint_path::{JointPath, distance, interpolate};

/// Longest piece of a blend, rad (L2): about as long as control points of the curve are apart, or the arm slows down for each
/// corner between two pieces.
const PIECE_LENGTH_RAD: f64 = 0.02;
/// The same where a place for a corner is looked at: the trajectory itself is looked at later.
const COARSE_PIECE_RAD: f64 = 0.05;
/// Fewest pieces of a blend.
const MIN_PIECES: f64 = 4.0;
/// Shortest leg of a blend, rad (L2).
const MIN_LEG_RAD: f64 = 0.04;
/// Shares of the room for a blend that are tried, the widest first.
const BLEND_FRACTIONS: [f64; 6] = [1.0, 0.75, 0.5, 0.35, 0.25, 0.125];
/// So much of a straight way off the start or into the goal stays straight, metres: a block's height.
const STRAIGHT_LENGTH_M: f64 = 0.05;

/// A path of straight motions whose corners are replaced by parabolas: those between the straight ways, and those at which these
/// meet the rest.
#[derive(Clone)]
pub(crate) struct BlendedPath {
    /// Arm angles from start to goal.
    pub waypoints: Vec<Vec<f64>>,
    /// Where the straight way off the start ends, and where that into the goal begins.
    pub transit_range: [usize; 2],
    /// For each point how wide its blend is, as a share of the room: up to the middle of the motions beside it, or to where a
    /// straight way must stay straight.
    pub blend_fractions: Vec<f64>,
}

impl BlendedPath {
    /// With its corners.
    pub fn new(points: Vec<Vec<f64>>, transit_range: [usize; 2]) -> Self {
        let shares = vec![0.0; points.len()];
        Self { waypoints: points, transit_range, blend_fractions: shares }
    }

    /// Makes each blend as wide as there is room for with `padding`.
    pub fn maximize_blends(
        &mut self,
        context: &mut PlanningContext,
        padding: f64,
    ) -> Result<(), PlanFailure> {
        let [left, entered] = self.transit_range;
        if entered <= left {
            return Ok(());
        }
        context.require_clearance(padding)?;
        let limits = context.search_limits_for(padding);
        for k in left..=entered {
            for share in BLEND_FRACTIONS {
                self.blend_fractions[k] = share;
                context.check_interrupt()?;
                let blend = self.blend(k, PIECE_LENGTH_RAD);
                if blend.len() > 1 && context.scene.path_is_free(blend.iter().map(Vec::as_slice), &limits)? {
                    break;
                }
                self.blend_fractions[k] = 0.0;
            }
        }
        Ok(())
    }

    /// With another straight way into the goal, and the widest blends at its beginning and before it.
    pub fn with_approach(&self, approach: Vec<Vec<f64>>) -> Self {
        let [left, entered] = self.transit_range;
        let mut other = self.clone();
        other.waypoints.splice(entered.., approach);
        other.blend_fractions.resize(other.waypoints.len(), 0.0);
        other.blend_fractions[(entered - 1).max(left + 1)..=entered].fill(1.0);
        other
    }

    /// The curve around the point `k` and those beside it: all that changes if it is moved.
    pub fn curve_around(&self, k: usize) -> Vec<Vec<f64>> {
        let [left, entered] = self.transit_range;
        let (first, last) = (k.saturating_sub(1).max(left), (k + 1).min(entered));
        let mut curve = Vec::new();
        if first > left {
            curve.push(interpolate(&self.waypoints[first - 1], &self.waypoints[first], 0.5));
        }
        for j in first..=last {
            curve.extend(self.blend(j, COARSE_PIECE_RAD));
        }
        if last < entered {
            curve.push(interpolate(&self.waypoints[last], &self.waypoints[last + 1], 0.5));
        }
        curve
    }

    /// The path with its blends, which keeps `searched`, metres, between its straight ways.
    pub fn to_joint_path(&self, searched: f64) -> JointPath {
        let [left, entered] = self.transit_range;
        if entered <= left {
            return JointPath {
                waypoints: self.waypoints.clone(),
                blend_range: self.transit_range,
                clearance_m: searched,
            };
        }
        let [begin, end] = self.transit_range.map(|k| self.straight_leg(k).0);
        let mut points = self.waypoints[..left - begin].to_vec();
        for k in left..=entered {
            points.extend(self.blend(k, PIECE_LENGTH_RAD));
        }
        let curved = [left - begin, points.len() - 1];
        points.extend_from_slice(&self.waypoints[entered + end + 1..]);
        JointPath { waypoints: points, blend_range: curved, clearance_m: searched }
    }

    /// What stands for the point `k`: a parabola, or the point itself where there is no room for one.
    fn blend(&self, k: usize, piece: f64) -> Vec<Vec<f64>> {
        let [left, entered] = self.transit_range;
        let corner = &self.waypoints[k];
        let length = |other: usize| distance(corner, &self.waypoints[other]);
        let towards =
            |other: usize, leg: f64| interpolate(corner, &self.waypoints[other], leg / length(other));
        if k > left && k < entered {
            let leg = 0.5 * self.blend_fractions[k] * length(k - 1).min(length(k + 1));
            return if leg < MIN_LEG_RAD {
                vec![corner.clone()]
            } else {
                parabola(&towards(k - 1, leg), corner, &towards(k + 1, leg), 2.0 * leg, piece)
            };
        }
        let (steps, leg) = self.straight_leg(k);
        if steps == 0 {
            return vec![corner.clone()];
        }
        let (inner, next) = if k == left { (k - steps, k + 1) } else { (k + steps, k - 1) };
        let mut blend = parabola(&self.waypoints[inner], corner, &towards(next, leg), 2.0 * leg, piece);
        if k == entered {
            blend.reverse();
        }
        blend
    }

    /// How many points of its straight way the blend of that end of it takes, and how much of the motion beside it, rad.
    fn straight_leg(&self, k: usize) -> (usize, f64) {
        let is_start = k == self.transit_range[0];
        let steps_to_end = if is_start { k } else { self.waypoints.len() - 1 - k };
        let spare = steps_to_end.saturating_sub(axis_ik::line_steps(STRAIGHT_LENGTH_M));
        let steps = (self.blend_fractions[k] * spare as f64) as usize;
        let (inner, next) = if is_start { (k - steps, k + 1) } else { (k + steps, k - 1) };
        let leg = distance(&self.waypoints[k], &self.waypoints[inner])
            .min(0.5 * distance(&self.waypoints[k], &self.waypoints[next]));
        if leg < MIN_LEG_RAD { (0, 0.0) } else { (steps, leg) }
    }
}

/// A parabola from `from` to `to` whose ends point to `corner`, in pieces of which `length`, rad, is shared out.
fn parabola(from: &[f64], corner: &[f64], to: &[f64], length: f64, piece: f64) -> Vec<Vec<f64>> {
    let pieces = (length / piece).ceil().max(MIN_PIECES) as usize;
    let at = |k: usize| {
        let s = k as f64 / pieces as f64;
        interpolate(&interpolate(from, corner, s), &interpolate(corner, to, s), s)
    };
    (0..=pieces).map(at).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_parabola_leaves_along_the_first_motion_and_arrives_along_the_second() {
        let points = parabola(&[0.0, 0.0], &[1.0, 0.0], &[1.0, 1.0], 4.0, 0.02);
        assert_eq!((&points[0], &points[200]), (&vec![0.0, 0.0], &vec![1.0, 1.0]));
        let slope = |a: &[f64], b: &[f64]| (b[1] - a[1]).atan2(b[0] - a[0]);
        assert!(slope(&points[0], &points[1]).abs() < 0.01);
        assert!((slope(&points[199], &points[200]) - std::f64::consts::FRAC_PI_2).abs() < 0.01);
        // It cuts the corner by half of the way to the chord's middle.
        assert!(distance(&points[100], &[0.75, 0.25]) < 1e-12);
    }
}
