//! From a path to a trajectory: a smooth curve through joint space, run as fast as the limits allow.
//!
//! The path's points, closely resampled, are the control points of a uniform cubic B-spline: it has continuous
//! second derivatives, is straight where the path is, and cuts a corner by at most a sixth of the second
//! difference of its control points. Along the curve q(u) the speed profile x = (du/dt)^2 is the fastest one
//! under |q'| sqrt(x) <= v and |q' w + q'' x| <= a with w = d2u/dt2, found by one backward and one forward pass
//! (reachability analysis: Pham and Pham, IEEE T-RO 34(3), 2018). Jerk is limited afterwards, by averaging over time.

use crate::joint_path::{distance, interpolate};
use proact_types::{JointVector, Trajectory, TrajectoryPoint, joints};

/// Speed and acceleration limits, one per arm joint.
#[derive(Clone, Debug)]
pub(crate) struct MotionLimits {
    /// rad/s.
    pub velocity_rad_per_s: Vec<f64>,
    /// rad/s^2.
    pub acceleration_rad_per_s2: Vec<f64>,
}

/// Grid points per control point: between them the curve is nearly a parabola.
pub(crate) const GRID_POINTS_PER_SPAN: usize = 4;
/// Share of the limits that is used: between grid points, and in the cubic between trajectory points, the true
/// values overshoot those at the points by a few per cent.
const LIMIT_FRACTION: f64 = 0.93;

/// Joint-space curve with the path's ends as its ends.
pub(crate) struct JointSpline {
    /// Control points, one phantom at each end.
    control_points: Vec<JointVector>,
    /// The parameters at which the curve passes the points of the path that were to be kept, or beside them by a sixth of the
    /// spacing.
    pub kept_parameters: [f64; 2],
}

impl JointSpline {
    /// A curve along `path` whose control points are at most `spacing` rad (L2) apart, and evenly spread before, between and
    /// behind the two `kept` points of the path: where their distance changes, the arm slows down for nothing. None if the path
    /// has no length.
    pub fn from_path(path: &[Vec<f64>], kept: [usize; 2], spacing: f64) -> Option<Self> {
        let [first, second] = kept;
        let mut control = vec![joints(path.first()?)];
        resample(&path[..=first], spacing, &mut control);
        let from = (control.len() - 1) as f64;
        resample(&path[first..=second], spacing, &mut control);
        let to = (control.len() - 1) as f64;
        resample(&path[second..], spacing, &mut control);
        if control.len() < 2 {
            return None;
        }
        // A phantom point mirrored at each end makes the curve start and end exactly on the path.
        let mirror = |end: &[f64], next: &[f64]| -> JointVector {
            end.iter().zip(next).map(|(e, n)| 2.0 * e - n).collect()
        };
        let first = mirror(&control[0], &control[1]);
        let last = mirror(&control[control.len() - 1], &control[control.len() - 2]);
        control.insert(0, first);
        control.push(last);
        Some(Self { control_points: control, kept_parameters: [from, to] })
    }

    /// Number of spans; the parameter runs from 0 to this.
    pub fn spans(&self) -> usize {
        self.control_points.len() - 3
    }

    /// The joint vector at `u`.
    pub fn position(&self, u: f64) -> JointVector {
        let mut q = JointVector::new();
        self.combine_control_points(u, position_weights, |value| q.push(value));
        q
    }

    /// Value, first and second derivative at `u`, one after the other.
    fn add_derivatives(&self, u: f64, row: &mut Vec<f64>) {
        let first =
            |s: f64, r: f64| [-0.5 * r * r, 1.5 * s * s - 2.0 * s, -1.5 * s * s + s + 0.5, 0.5 * s * s];
        let second = |s: f64, r: f64| [r, 3.0 * s - 2.0, 1.0 - 3.0 * s, s];
        self.combine_control_points(u, position_weights, |value| row.push(value));
        self.combine_control_points(u, first, |value| row.push(value));
        self.combine_control_points(u, second, |value| row.push(value));
    }

    /// The four control points around `u` by weights that depend on the distances from both ends of the span.
    fn combine_control_points(
        &self,
        u: f64,
        weights: impl Fn(f64, f64) -> [f64; 4],
        mut add: impl FnMut(f64),
    ) {
        let span = (u.floor() as usize).min(self.spans() - 1);
        let s = u - span as f64;
        let [a, b, c, d] = weights(s, 1.0 - s);
        let points = &self.control_points[span..span + 4];
        for (k, first) in points[0].iter().enumerate() {
            add(a * first + b * points[1][k] + c * points[2][k] + d * points[3][k]);
        }
    }

    /// The fastest trajectory along the curve under `limits`, at rest at both ends.
    pub fn time_optimal(&self, limits: &MotionLimits) -> Trajectory {
        let intervals = self.spans() * GRID_POINTS_PER_SPAN;
        let du = 1.0 / GRID_POINTS_PER_SPAN as f64;
        let joint_count = limits.acceleration_rad_per_s2.len();
        let mut rows = Vec::with_capacity(3 * joint_count * (intervals + 1));
        for i in 0..=intervals {
            self.add_derivatives(i as f64 * du, &mut rows);
        }
        let grid: Vec<Derivatives> = rows.chunks_exact(3 * joint_count).map(Derivatives::from_row).collect();

        // Backward: the largest x at each grid point from which the rest can still be braked.
        let bounds: Vec<AccelerationBounds> = grid
            .windows(2)
            .map(|pair| AccelerationBounds::for_interval(&pair[0], &pair[1], limits, du))
            .collect();
        let mut highest = vec![0.0; intervals + 1];
        for i in (0..intervals).rev() {
            let top = max_path_speed_squared(grid[i].first, limits);
            highest[i] = bounds[i].max_controllable(top, highest[i + 1], du);
        }
        // Forward: as fast as that and the acceleration allow.
        let mut x = vec![0.0; intervals + 1];
        for i in 0..intervals {
            x[i + 1] = (x[i] + 2.0 * du * bounds[i].max_path_acceleration(x[i])).clamp(0.0, highest[i + 1]);
        }

        let mut time_secs = 0.0;
        let mut points = Vec::with_capacity(intervals + 1);
        for i in 0..=intervals {
            if i > 0 {
                time_secs += 2.0 * du / (x[i].sqrt() + x[i - 1].sqrt());
            }
            let speed = x[i].sqrt();
            points.push(TrajectoryPoint {
                time_secs,
                q: joints(grid[i].value),
                qd: grid[i].first.iter().map(|d| d * speed).collect(),
            });
        }
        // The ends to the last bit: the sum over the basis rounds.
        points[0].q = self.control_points[1].clone();
        points[intervals].q = self.control_points[self.control_points.len() - 2].clone();
        Trajectory { points }
    }
}

/// Adds points along `path`, evenly spread and at most `spacing` rad (L2) apart, behind its first, with which `control` ends.
fn resample(path: &[Vec<f64>], spacing: f64, control: &mut Vec<JointVector>) {
    let total: f64 = path.windows(2).map(|pair| distance(&pair[0], &pair[1])).sum();
    // A point that stands almost still would put a needless kink into the curve.
    if total <= 1e-6 {
        return;
    }
    let pieces = (total / spacing).ceil() as usize;
    let mut next = 1;
    let mut traveled = 0.0;
    for pair in path.windows(2) {
        let length = distance(&pair[0], &pair[1]);
        while next < pieces {
            let on = total * next as f64 / pieces as f64 - traveled;
            if on > length {
                break;
            }
            control.push(joints(&interpolate(&pair[0], &pair[1], on / length)));
            next += 1;
        }
        traveled += length;
    }
    control.extend(path.last().map(|last| joints(last)));
}

/// Basis of a uniform cubic B-spline over the four control points of a span, by the distances from its ends.
fn position_weights(s: f64, r: f64) -> [f64; 4] {
    [
        r * r * r / 6.0,
        (3.0 * s * s * s - 6.0 * s * s + 4.0) / 6.0,
        (-3.0 * s * s * s + 3.0 * s * s + 3.0 * s + 1.0) / 6.0,
        s * s * s / 6.0,
    ]
}

/// The curve at a grid point: its value and its derivatives by the parameter.
struct Derivatives<'a> {
    value: &'a [f64],
    first: &'a [f64],
    second: &'a [f64],
}

impl<'a> Derivatives<'a> {
    /// From a row of [`JointSpline::add_derivatives`].
    fn from_row(row: &'a [f64]) -> Self {
        let (value, rest) = row.split_at(row.len() / 3);
        let (first, second) = rest.split_at(rest.len() / 2);
        Self { value, first, second }
    }
}

/// A bound of w = d2u/dt2 that is linear in x, from an acceleration limit |c w + d x| <= a: |w - slope x| <= base.
#[derive(Clone, Copy)]
struct AccelerationBound {
    base: f64,
    slope: f64,
}

/// The acceleration limits of all joints for one interval.
struct AccelerationBounds {
    linear_bounds: Vec<AccelerationBound>,
    /// Above it a joint that turns round here would bend too fast.
    max_speed_squared: f64,
}

impl AccelerationBounds {
    /// For the interval from `here` to `next`, at both its ends: w is constant in between, so that x has grown by 2 du w at
    /// the far end (the interpolation scheme of Pham and Pham, section III-C).
    fn for_interval(here: &Derivatives, next: &Derivatives, limits: &MotionLimits, du: f64) -> Self {
        let mut lines = Vec::with_capacity(2 * limits.acceleration_rad_per_s2.len());
        let mut max_speed = f64::INFINITY;
        let mut add = |c: f64, d: f64, a: f64| {
            if c.abs() >= 1e-9 {
                lines.push(AccelerationBound { base: (a / c).abs(), slope: -d / c });
            } else if d != 0.0 {
                // This joint turns round here; its acceleration is the bend alone.
                max_speed = max_speed.min(a / d.abs());
            }
        };
        for (k, limit) in limits.acceleration_rad_per_s2.iter().enumerate() {
            let a = LIMIT_FRACTION * limit;
            add(here.first[k], here.second[k], a);
            add(next.first[k] + 2.0 * du * next.second[k], next.second[k], a);
        }
        Self { linear_bounds: lines, max_speed_squared: max_speed }
    }

    /// True if some allowed w leads from x to at most `next` after `du`.
    fn can_reach_below(&self, x: f64, next: f64, du: f64) -> bool {
        let mut min_speed = f64::NEG_INFINITY;
        for line in &self.linear_bounds {
            min_speed = min_speed.max(line.slope * x - line.base);
        }
        min_speed <= self.max_path_acceleration(x) && x + 2.0 * du * min_speed <= next
    }

    /// The largest w that the limits leave for x.
    fn max_path_acceleration(&self, x: f64) -> f64 {
        let mut largest = f64::INFINITY;
        for line in &self.linear_bounds {
            largest = largest.min(line.base + line.slope * x);
        }
        largest
    }

    /// The largest x, at most `top`, from which some allowed w leads to an x of at most `next` after `du`.
    ///
    /// The allowed (x, w) form a convex set that contains x = 0, and every condition is linear in x: each lower bound of w
    /// stays below each upper one, and none leads beyond `next`.
    fn max_controllable(&self, top: f64, next: f64, du: f64) -> f64 {
        // Where no joint moves along the curve, as at a turning point, the arm stands for an instant.
        if !top.is_finite() {
            return 0.0;
        }
        let mut largest = top.min(self.max_speed_squared);
        // Mostly all of it is allowed.
        if self.can_reach_below(largest, next, du) {
            return largest;
        }
        let mut keep = |base: f64, slope: f64| {
            if base + slope * largest > 0.0 && slope > 0.0 {
                largest = (-base / slope).clamp(0.0, largest);
            }
        };
        for low in &self.linear_bounds {
            keep(-2.0 * du * low.base - next, 1.0 + 2.0 * du * low.slope);
        }
        for low in &self.linear_bounds {
            for high in &self.linear_bounds {
                keep(-low.base - high.base, low.slope - high.slope);
            }
        }
        largest
    }
}

/// The largest x that the speed limits leave where the curve's derivative is `first`.
fn max_path_speed_squared(first: &[f64], limits: &MotionLimits) -> f64 {
    let of_joint =
        |(d, v): (&f64, &f64)| if d.abs() > 1e-9 { (LIMIT_FRACTION * v / d).powi(2) } else { f64::INFINITY };
    first.iter().zip(&limits.velocity_rad_per_s).map(of_joint).fold(f64::INFINITY, f64::min)
}

/// Time between the points of a trajectory whose jerk is limited, seconds.
const JERK_SAMPLE_SECS: f64 = 0.01;

/// `trajectory` with its angles averaged over the `window_secs` before each instant: its duration grows by that.
///
/// Averaging keeps every bound on speed and acceleration. The new jerk is the difference of two accelerations over
/// the window, at most 2 a / window. An angle strays from where it would be half a window earlier by at most
/// a window^2 / 24. Between the new points the cubic's jerk is a weighted mean of the true one, so that it keeps
/// the bound too.
pub(crate) fn moving_average(trajectory: &Trajectory, window_secs: f64) -> Trajectory {
    let trajectory_points = &trajectory.points;
    let (Some(first), Some(last)) = (trajectory_points.first(), trajectory_points.last()) else {
        return trajectory.clone();
    };
    let joint_count = first.q.len();
    let off = |q: &[f64], k: usize| q[k] - first.q[k];
    // The integral of q - q(0) from the start to each knot.
    let mut integral = vec![proact_types::zeros(joint_count)];
    for pair in trajectory_points.windows(2) {
        let h = pair[1].time_secs - pair[0].time_secs;
        let before = &integral[integral.len() - 1];
        let next = (0..joint_count)
            .map(|k| {
                let ends = off(&pair[0].q, k) + off(&pair[1].q, k);
                before[k] + h / 2.0 * ends + h * h / 12.0 * (pair[0].qd[k] - pair[1].qd[k])
            })
            .collect();
        integral.push(next);
    }
    let integral_at = |t: f64| -> JointVector {
        if t <= 0.0 {
            return proact_types::zeros(joint_count);
        }
        if t >= last.time_secs {
            let beyond =
                |k| integral[trajectory_points.len() - 1][k] + (t - last.time_secs) * off(&last.q, k);
            return (0..joint_count).map(beyond).collect();
        }
        let next = trajectory_points.partition_point(|p| p.time_secs <= t);
        let (a, b) = (&trajectory_points[next - 1], &trajectory_points[next]);
        let h = b.time_secs - a.time_secs;
        let s = (t - a.time_secs) / h;
        let (s2, s3, s4) = (s * s, s * s * s, s * s * s * s);
        // Integrals of the cubic Hermite basis.
        let of_values = [s - s3 + 0.5 * s4, s3 - 0.5 * s4];
        let of_slopes = [s2 / 2.0 - s3 * 2.0 / 3.0 + s4 / 4.0, s4 / 4.0 - s3 / 3.0];
        let within = |k| {
            let values = of_values[0] * off(&a.q, k) + of_values[1] * off(&b.q, k);
            let slopes = of_slopes[0] * a.qd[k] + of_slopes[1] * b.qd[k];
            integral[next - 1][k] + h * (values + h * slopes)
        };
        (0..joint_count).map(within).collect()
    };
    let duration = last.time_secs + window_secs;
    let count = (duration / JERK_SAMPLE_SECS).ceil() as usize;
    let mut points: Vec<TrajectoryPoint> = Vec::with_capacity(count + 1);
    for n in 0..=count {
        let time_secs = duration * n as f64 / count as f64;
        let (Some((now, _)), Some((then, _))) =
            (trajectory.sample(time_secs), trajectory.sample(time_secs - window_secs))
        else {
            continue;
        };
        let (until, before) = (integral_at(time_secs), integral_at(time_secs - window_secs));
        let mean = |k| (until[k] - before[k]) / window_secs;
        points.push(TrajectoryPoint {
            time_secs,
            q: (0..joint_count).map(|k| first.q[k] + mean(k)).collect(),
            qd: now.iter().zip(&then).map(|(a, b)| (a - b) / window_secs).collect(),
        });
    }
    // The ends to the last bit: the integrals round.
    points[0].q = first.q.clone();
    points[count].q = last.q.clone();
    Trajectory { points }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches control points at each point of the path, between which the distance jumps.
    #[test]
    fn a_straight_motion_takes_as_long_whatever_points_lie_on_it() {
        let limits = MotionLimits { velocity_rad_per_s: vec![0.5; 2], acceleration_rad_per_s2: vec![1.0; 2] };
        let secs = |shares: &[f64], kept: [usize; 2]| {
            let path: Vec<Vec<f64>> = shares.iter().map(|share| vec![*share, -0.5 * share]).collect();
            let curve = JointSpline::from_path(&path, kept, 0.02).unwrap();
            for (index, parameter) in kept.into_iter().zip(curve.kept_parameters) {
                let off = distance(&curve.position(parameter), &path[index]);
                assert!(off < 0.02 / 6.0, "point {index} is {off} off");
            }
            curve.time_optimal(&limits).duration_secs()
        };
        let alone = secs(&[0.0, 1.0], [0, 1]);
        let among = secs(&[0.0, 0.013, 0.041, 0.05, 0.3, 0.33, 0.331, 0.7, 1.0], [0, 8]);
        assert!((alone - among).abs() < 1e-9, "{alone} s, among points {among} s");
        let in_parts = secs(&[0.0, 0.1, 0.33, 0.9, 1.0], [1, 3]);
        assert!((alone - in_parts).abs() < 0.01, "{alone} s, in three parts {in_parts} s");
    }

    #[test]
    fn the_largest_controllable_speed_is_the_one_that_bisection_finds() {
        let limits =
            MotionLimits { velocity_rad_per_s: vec![0.5; 2], acceleration_rad_per_s2: vec![1.0, 0.6] };
        let row = |at: f64| [0.0, 0.0, at.cos(), (3.0 * at).sin(), -2.0 * at.sin(), 4.0 * (5.0 * at).cos()];
        let du = 0.25;
        let mut less_than_top = 0;
        for k in 0..200 {
            let (here, next) = (row(0.1 * f64::from(k)), row(0.1 * f64::from(k) + 0.05));
            let bounds = AccelerationBounds::for_interval(
                &Derivatives::from_row(&here),
                &Derivatives::from_row(&next),
                &limits,
                du,
            );
            let (top, wanted) = (2.0, 0.01 * f64::from(k));
            let found = bounds.max_controllable(top, wanted, du);
            let possible = |x: f64| x <= bounds.max_speed_squared && bounds.can_reach_below(x, wanted, du);
            let (mut low, mut high) = (0.0, top);
            for _ in 0..60 {
                let middle = 0.5 * (low + high);
                if possible(middle) { low = middle } else { high = middle }
            }
            let bisected = if possible(top) { top } else { low };
            assert!((found - bisected).abs() < 1e-9, "{k}: {found} instead of {bisected}");
            less_than_top += usize::from(found < top);
        }
        assert!(less_than_top > 50, "{less_than_top} of 200 are bounded by the acceleration");
    }
}
