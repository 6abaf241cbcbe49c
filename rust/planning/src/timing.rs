//! From a path to a trajectory: a smooth curve through joint space, run as fast as the limits allow.
//!
//! The path's points, closely resampled, are the control points of a uniform cubic B-spline: it has continuous
//! second derivatives, is straight where the path is, and cuts a corner by at most a sixth of the second
//! difference of its control points. Along the curve q(u) the speed profile x = (du/dt)^2 is the fastest one
//! under |q'| sqrt(x) <= v and |q' w + q'' x| <= a with w = d2u/dt2, found by one backward and one forward pass
//! (reachability analysis: Pham and Pham, IEEE T-RO 34(3), 2018). Jerk is limited afterwards, by averaging over time.

use crate::route::distance;
use proact_types::{Trajectory, TrajectoryPoint, joints};

/// Speed and acceleration limits, one per arm joint.
#[derive(Clone, Debug)]
pub(crate) struct MotionLimits {
    /// rad/s.
    pub velocity: Vec<f64>,
    /// rad/s^2.
    pub acceleration: Vec<f64>,
}

/// Grid points per control point: between them the curve is nearly a parabola.
pub(crate) const GRID: usize = 4;
/// Share of the limits that is used: between grid points, and in the cubic between trajectory points, the true
/// values overshoot those at the points by a few per cent.
const USED: f64 = 0.93;

/// Joint-space curve with the path's ends as its ends.
pub(crate) struct Curve {
    /// Control points, one phantom at each end.
    control: Vec<Vec<f64>>,
    /// For each point of the path, the parameter at which the curve passes it.
    pub path_parameter: Vec<f64>,
}

impl Curve {
    /// A curve along `path` whose control points are at most `spacing` rad (L2) apart. None if the path has no
    /// length.
    pub fn along(path: &[Vec<f64>], spacing: f64) -> Option<Self> {
        let mut control: Vec<Vec<f64>> = Vec::new();
        let mut path_parameter = Vec::with_capacity(path.len());
        for point in path {
            let Some(last) = control.last().cloned() else {
                control.push(point.clone());
                path_parameter.push(0.0);
                continue;
            };
            let length = distance(&last, point);
            // A point that stands almost still would put a needless kink into the curve.
            if length > 1e-6 {
                let pieces = (length / spacing).ceil() as usize;
                for k in 1..pieces {
                    let s = k as f64 / pieces as f64;
                    control.push(last.iter().zip(point).map(|(a, b)| a + s * (b - a)).collect());
                }
                control.push(point.clone());
            }
            path_parameter.push((control.len() - 1) as f64);
        }
        if control.len() < 2 {
            return None;
        }
        // A phantom point mirrored at each end makes the curve start and end exactly on the path.
        let mirror = |end: &[f64], next: &[f64]| -> Vec<f64> {
            end.iter().zip(next).map(|(e, n)| 2.0 * e - n).collect()
        };
        let first = mirror(&control[0], &control[1]);
        let last = mirror(&control[control.len() - 1], &control[control.len() - 2]);
        control.insert(0, first);
        control.push(last);
        Some(Self { control, path_parameter })
    }

    /// Number of spans; the parameter runs from 0 to this.
    pub fn spans(&self) -> usize {
        self.control.len() - 3
    }

    /// Value, first and second derivative at `u`.
    pub fn at(&self, u: f64) -> [Vec<f64>; 3] {
        let span = (u.floor() as usize).min(self.spans() - 1);
        let s = u - span as f64;
        let r = 1.0 - s;
        // Uniform cubic B-spline basis over four control points, and its derivatives.
        let value = [
            r * r * r / 6.0,
            (3.0 * s * s * s - 6.0 * s * s + 4.0) / 6.0,
            (-3.0 * s * s * s + 3.0 * s * s + 3.0 * s + 1.0) / 6.0,
            s * s * s / 6.0,
        ];
        let first = [-0.5 * r * r, 1.5 * s * s - 2.0 * s, -1.5 * s * s + s + 0.5, 0.5 * s * s];
        let second = [r, 3.0 * s - 2.0, 1.0 - 3.0 * s, s];
        [value, first, second].map(|weights| {
            (0..self.control[span].len())
                .map(|k| (0..4).map(|i| weights[i] * self.control[span + i][k]).sum())
                .collect()
        })
    }

    /// The fastest trajectory along the curve under `limits`, at rest at both ends.
    pub fn timed(&self, limits: &MotionLimits) -> Trajectory {
        let intervals = self.spans() * GRID;
        let du = 1.0 / GRID as f64;
        let grid: Vec<[Vec<f64>; 3]> = (0..=intervals).map(|i| self.at(i as f64 * du)).collect();

        // Backward: the largest x at each grid point from which the rest can still be braked.
        let bounds: Vec<Vec<Bound>> =
            (0..intervals).map(|i| bounds(&grid[i], &grid[i + 1], limits, du)).collect();
        let mut highest = vec![0.0; intervals + 1];
        for i in (0..intervals).rev() {
            let top = fastest(&grid[i][1], limits);
            highest[i] = largest_controllable(&bounds[i], top, highest[i + 1], du);
        }
        // Forward: as fast as that and the acceleration allow.
        let mut x = vec![0.0; intervals + 1];
        for i in 0..intervals {
            let (_, up) = acceleration_range(&bounds[i], x[i]);
            x[i + 1] = (x[i] + 2.0 * du * up).clamp(0.0, highest[i + 1]);
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
                q: joints(&grid[i][0]),
                qd: grid[i][1].iter().map(|d| d * speed).collect(),
            });
        }
        // The ends to the last bit: the sum over the basis rounds.
        points[0].q = joints(&self.control[1]);
        points[intervals].q = joints(&self.control[self.control.len() - 2]);
        Trajectory { points }
    }
}

/// |c w + d x| <= a: one acceleration limit at one grid point.
struct Bound {
    c: f64,
    d: f64,
    a: f64,
}

/// The acceleration limits of all joints for the interval from `here` to `next`, at both its ends: w is constant
/// in between, so that x has grown by 2 du w at the far end (the interpolation scheme of Pham and Pham, section
/// III-C).
fn bounds(here: &[Vec<f64>; 3], next: &[Vec<f64>; 3], limits: &MotionLimits, du: f64) -> Vec<Bound> {
    let mut all = Vec::with_capacity(2 * limits.acceleration.len());
    for (k, limit) in limits.acceleration.iter().enumerate() {
        let a = USED * limit;
        all.push(Bound { c: here[1][k], d: here[2][k], a });
        all.push(Bound { c: next[1][k] + 2.0 * du * next[2][k], d: next[2][k], a });
    }
    all
}

/// The largest x that the speed limits leave where the curve's derivative is `first`.
fn fastest(first: &[f64], limits: &MotionLimits) -> f64 {
    let of_joint = |(d, v): (&f64, &f64)| if d.abs() > 1e-9 { (USED * v / d).powi(2) } else { f64::INFINITY };
    first.iter().zip(&limits.velocity).map(of_joint).fold(f64::INFINITY, f64::min)
}

/// The range of w = d2u/dt2 that the acceleration limits leave for x. Empty (low above high) where x is too
/// large.
fn acceleration_range(bounds: &[Bound], x: f64) -> (f64, f64) {
    let (mut low, mut high) = (f64::NEG_INFINITY, f64::INFINITY);
    for Bound { c, d, a } in bounds {
        let bend = d * x;
        if c.abs() < 1e-9 {
            // This joint turns round here; its acceleration is the bend alone.
            if bend.abs() > *a {
                return (1.0, -1.0);
            }
        } else {
            let (one, other) = ((-a - bend) / c, (a - bend) / c);
            low = low.max(one.min(other));
            high = high.min(one.max(other));
        }
    }
    (low, high)
}

/// The largest x, at most `top`, from which some allowed w leads to an x of at most `next` after `du`.
fn largest_controllable(bounds: &[Bound], top: f64, next: f64, du: f64) -> f64 {
    // Where no joint moves along the curve, as at a turning point, the arm stands for an instant.
    if !top.is_finite() {
        return 0.0;
    }
    let possible = |x: f64| {
        let (low, high) = acceleration_range(bounds, x);
        low <= high && x + 2.0 * du * low <= next
    };
    if possible(top) {
        return top;
    }
    // The allowed (x, w) form a convex set that contains x = 0, so bisection finds its far end.
    let (mut bottom, mut top) = (0.0, top);
    for _ in 0..50 {
        let middle = 0.5 * (bottom + top);
        if possible(middle) {
            bottom = middle;
        } else {
            top = middle;
        }
    }
    bottom
}

/// Time between the points of a trajectory whose jerk is limited, seconds.
const JERK_STEP: f64 = 0.01;

/// `trajectory` with its angles averaged over the `window_secs` before each instant: its duration grows by that.
///
/// Averaging keeps every bound on speed and acceleration. The new jerk is the difference of two accelerations over
/// the window, at most 2 a / window. An angle strays from where it would be half a window earlier by at most
/// a window^2 / 24. Between the new points the cubic's jerk is a weighted mean of the true one, so that it keeps
/// the bound too.
pub(crate) fn averaged(trajectory: &Trajectory, window_secs: f64) -> Trajectory {
    let knots = &trajectory.points;
    let (Some(first), Some(last)) = (knots.first(), knots.last()) else { return trajectory.clone() };
    let joint_count = first.q.len();
    let off = |q: &[f64], k: usize| q[k] - first.q[k];
    // The integral of q - q(0) from the start to each knot.
    let mut integral = vec![vec![0.0; joint_count]];
    for pair in knots.windows(2) {
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
    let integral_at = |t: f64, k: usize| {
        if t <= 0.0 {
            return 0.0;
        }
        if t >= last.time_secs {
            return integral[knots.len() - 1][k] + (t - last.time_secs) * off(&last.q, k);
        }
        let next = knots.partition_point(|p| p.time_secs <= t);
        let (a, b) = (&knots[next - 1], &knots[next]);
        let h = b.time_secs - a.time_secs;
        let s = (t - a.time_secs) / h;
        let (s2, s3, s4) = (s * s, s * s * s, s * s * s * s);
        // Integrals of the cubic Hermite basis.
        let values = (s - s3 + 0.5 * s4) * off(&a.q, k) + (s3 - 0.5 * s4) * off(&b.q, k);
        let slopes = (s2 / 2.0 - s3 * 2.0 / 3.0 + s4 / 4.0) * a.qd[k] + (s4 / 4.0 - s3 / 3.0) * b.qd[k];
        integral[next - 1][k] + h * (values + h * slopes)
    };
    let duration = last.time_secs + window_secs;
    let count = (duration / JERK_STEP).ceil() as usize;
    let mut points: Vec<TrajectoryPoint> = Vec::with_capacity(count + 1);
    for n in 0..=count {
        let time_secs = duration * n as f64 / count as f64;
        let (Some((now, _)), Some((then, _))) =
            (trajectory.sample(time_secs), trajectory.sample(time_secs - window_secs))
        else {
            continue;
        };
        let mean = |k| (integral_at(time_secs, k) - integral_at(time_secs - window_secs, k)) / window_secs;
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
