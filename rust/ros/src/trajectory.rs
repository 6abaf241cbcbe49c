//! Trajectories as ros_control's controllers take them: checked, then sampled.

/// Why a trajectory is refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum TrajectoryError {
    /// Other joints than the controller's.
    #[error("joints {got:?}, expected exactly {expected:?}, in any order")]
    Joints {
        /// As named in the message.
        got: Vec<String>,
        /// The controller's.
        expected: Vec<String>,
    },
    /// A point has another number of values than there are joints.
    #[error("point {point} has {got} {what}, expected {expected}")]
    Length {
        /// Which point, from 0.
        point: usize,
        /// `positions`, `velocities` or `accelerations`.
        what: &'static str,
        /// Values there.
        got: usize,
        /// Joints.
        expected: usize,
    },
    /// A value is NaN or infinite.
    #[error("point {point}: {what} of {joint} is {value}, expected a finite number")]
    NotFinite {
        /// Which point, from 0.
        point: usize,
        /// `positions`, `velocities` or `accelerations`.
        what: &'static str,
        /// Which joint.
        joint: String,
        /// Its value.
        value: f64,
    },
    /// Times do not ascend.
    #[error("point {point} is due at {got} s, expected more than {before} s")]
    Order {
        /// Which point, from 0.
        point: usize,
        /// Its time, s.
        got: f64,
        /// The time before it, s.
        before: f64,
    },
    /// It begins so late that its stamp is most likely of another clock.
    #[error(
        "the trajectory begins in {ahead:.1} s, expected at most {most} s; a node that lives on wall time needs the \
         parameter /use_sim_time, or a stamp of 0 for now"
    )]
    Future {
        /// From now, s.
        ahead: f64,
        /// The longest wait, s.
        most: f64,
    },
    /// All of it is over already.
    #[error("the trajectory ended {ago} s before it came")]
    Past {
        /// By how much, s.
        ago: f64,
    },
}

impl TrajectoryError {
    /// The number that `control_msgs/FollowJointTrajectoryResult` has for it.
    pub fn code(&self) -> i32 {
        match self {
            TrajectoryError::Joints { .. } => -2,
            TrajectoryError::Past { .. } => -3,
            _ => -1,
        }
    }
}

/// A point as it comes in, values in the order of the message's joints.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RawPoint {
    /// Angles, rad.
    pub positions: Vec<f64>,
    /// Speeds, rad/s; may be empty.
    pub velocities: Vec<f64>,
    /// Accelerations, rad/s^2; may be empty.
    pub accelerations: Vec<f64>,
    /// Seconds from the start.
    pub time_secs: f64,
}

/// Angle, speed and acceleration of one joint.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct JointSetpoint {
    /// rad.
    pub position: f64,
    /// rad/s.
    pub velocity: Option<f64>,
    /// rad/s^2.
    pub acceleration: Option<f64>,
}

/// A checked trajectory: per point its time and one knot per joint of the controller.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ControllerTrajectory {
    points: Vec<(f64, Vec<JointSetpoint>)>,
}

impl ControllerTrajectory {
    /// Checks `points` for a controller of `joints` and begins them at `start` (where the controller is now).
    /// `begin_secs` is the message's own start relative to now: negative when it lies in the past, in which case
    /// the points that are over are left out.
    ///
    /// # Errors
    /// [`TrajectoryError`], naming the first thing that is wrong.
    pub fn new(
        joints: &[String],
        named: &[String],
        points: &[RawPoint],
        begin_secs: f64,
        start: &[JointSetpoint],
    ) -> Result<Self, TrajectoryError> {
        let wrong_joints = || TrajectoryError::Joints { got: named.to_vec(), expected: joints.to_vec() };
        if named.len() != joints.len() {
            return Err(wrong_joints());
        }
        let order: Vec<usize> = joints
            .iter()
            .map(|joint| named.iter().position(|n| n == joint).ok_or_else(wrong_joints))
            .collect::<Result<_, _>>()?;
        let mut checked = Vec::new();
        let mut before = -1e-9;
        for (k, point) in points.iter().enumerate() {
            let values: [(&'static str, &[f64], bool); 3] = [
                ("positions", &point.positions, false),
                ("velocities", &point.velocities, true),
                ("accelerations", &point.accelerations, true),
            ];
            for (what, values, optional) in values {
                if values.len() != joints.len() && !(optional && values.is_empty()) {
                    return Err(TrajectoryError::Length {
                        point: k,
                        what,
                        got: values.len(),
                        expected: joints.len(),
                    });
                }
                if let Some(bad) = values.iter().position(|v| !v.is_finite()) {
                    return Err(TrajectoryError::NotFinite {
                        point: k,
                        what,
                        joint: named[bad].clone(),
                        value: values[bad],
                    });
                }
            }
            if point.time_secs.is_nan() || point.time_secs <= before {
                return Err(TrajectoryError::Order {
                    point: k,
                    got: point.time_secs,
                    before: before.max(0.0),
                });
            }
            before = point.time_secs;
            let setpoint = |j: &usize| JointSetpoint {
                position: point.positions[*j],
                velocity: point.velocities.get(*j).copied(),
                acceleration: point.accelerations.get(*j).copied(),
            };
            checked.push((point.time_secs + begin_secs, order.iter().map(setpoint).collect::<Vec<_>>()));
        }
        if let Some((last, _)) = checked.last()
            && *last < 0.0
        {
            return Err(TrajectoryError::Past { ago: -last });
        }
        checked.retain(|(time, _)| *time >= 0.0);
        // From where the controller is to the first point.
        if checked.first().is_some_and(|(time, _)| *time > 0.0) {
            checked.insert(0, (0.0, start.to_vec()));
        }
        Ok(Self { points: checked })
    }

    /// Seconds until the last point.
    pub fn duration_secs(&self) -> f64 {
        self.points.last().map_or(0.0, |(time, _)| *time)
    }

    /// Knots at `time_secs`, clamped to both ends; none for a course without points.
    ///
    /// Between points that have speeds the way is a cubic, with accelerations as well a quintic, otherwise a line,
    /// as ros_control has it.
    pub fn sample(&self, time_secs: f64) -> Option<Vec<JointSetpoint>> {
        let (first, last) = (self.points.first()?, self.points.last()?);
        let still = |k: &JointSetpoint| JointSetpoint { velocity: Some(0.0), acceleration: Some(0.0), ..*k };
        if time_secs >= last.0 {
            return Some(last.1.iter().map(still).collect());
        }
        if time_secs <= first.0 {
            return Some(first.1.iter().map(still).collect());
        }
        let next = self.points.partition_point(|(time, _)| *time <= time_secs);
        let (a, b) = (&self.points[next - 1], &self.points[next]);
        let h = b.0 - a.0;
        Some(a.1.iter().zip(&b.1).map(|(p, q)| interpolate(p, q, h, (time_secs - a.0) / h)).collect())
    }
}

/// The knot at share `s` of a segment that lasts `h` seconds: its polynomial's coefficients are those that match
/// what is given at both ends.
fn interpolate(a: &JointSetpoint, b: &JointSetpoint, h: f64, s: f64) -> JointSetpoint {
    let (p0, p1) = (a.position, b.position);
    let coefficients = match (a.velocity, b.velocity, a.acceleration, b.acceleration) {
        (Some(v0), Some(v1), Some(a0), Some(a1)) => {
            let (v0, v1, a0, a1) = (v0 * h, v1 * h, a0 * h * h, a1 * h * h);
            let d = p1 - p0;
            [
                p0,
                v0,
                a0 / 2.0,
                10.0 * d - 6.0 * v0 - 4.0 * v1 - 1.5 * a0 + 0.5 * a1,
                -15.0 * d + 8.0 * v0 + 7.0 * v1 + 1.5 * a0 - a1,
                6.0 * d - 3.0 * (v0 + v1) - 0.5 * (a0 - a1),
            ]
        }
        (Some(v0), Some(v1), ..) => {
            let (v0, v1, d) = (v0 * h, v1 * h, p1 - p0);
            [p0, v0, 3.0 * d - 2.0 * v0 - v1, -2.0 * d + v0 + v1, 0.0, 0.0]
        }
        _ => [p0, p1 - p0, 0.0, 0.0, 0.0, 0.0],
    };
    let (mut position, mut velocity, mut acceleration) = (0.0, 0.0, 0.0);
    for c in coefficients.iter().rev() {
        acceleration = acceleration * s + 2.0 * velocity;
        velocity = velocity * s + position;
        position = position * s + c;
    }
    JointSetpoint { position, velocity: Some(velocity / h), acceleration: Some(acceleration / (h * h)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names() -> Vec<String> {
        ["a", "b"].map(str::to_owned).into()
    }

    fn start() -> Vec<JointSetpoint> {
        vec![JointSetpoint { position: 0.0, velocity: Some(0.0), acceleration: Some(0.0) }; 2]
    }

    fn point(time_secs: f64, positions: &[f64], velocities: &[f64], accelerations: &[f64]) -> RawPoint {
        RawPoint {
            positions: positions.into(),
            velocities: velocities.into(),
            accelerations: accelerations.into(),
            time_secs,
        }
    }

    #[test]
    fn joints_may_come_in_any_order_but_must_be_the_controllers() {
        let swapped: Vec<String> = ["b", "a"].map(str::to_owned).into();
        let points = [point(1.0, &[2.0, 1.0], &[], &[])];
        let trajectory =
            ControllerTrajectory::new(&names(), &swapped, &points, 0.0, &start()).expect("valid");
        let end = trajectory.sample(1.0).expect("has points");
        assert_eq!((end[0].position, end[1].position), (1.0, 2.0));
        for wrong in [vec!["a".to_owned()], vec!["a".to_owned(), "c".to_owned()], vec![]] {
            let error = ControllerTrajectory::new(&names(), &wrong, &points, 0.0, &start())
                .expect_err("other joints");
            assert_eq!(error.code(), -2, "{error}");
        }
    }

    #[test]
    fn wrong_lengths_not_a_number_and_times_that_do_not_ascend_are_refused_with_their_place() {
        let refuse = |points: &[RawPoint]| {
            ControllerTrajectory::new(&names(), &names(), points, 0.0, &start())
                .expect_err("refused")
                .to_string()
        };
        let good = point(1.0, &[0.0, 0.0], &[], &[]);
        assert_eq!(
            refuse(&[good.clone(), point(2.0, &[0.0], &[], &[])]),
            "point 1 has 1 positions, expected 2"
        );
        assert_eq!(refuse(&[point(1.0, &[0.0, 0.0], &[1.0], &[])]), "point 0 has 1 velocities, expected 2");
        assert!(refuse(&[point(1.0, &[0.0, f64::NAN], &[], &[])]).contains("positions of b is NaN"));
        assert!(refuse(&[good.clone(), good.clone()]).contains("more than 1 s"));
        assert!(refuse(&[point(f64::NAN, &[0.0, 0.0], &[], &[])]).contains("NaN"));
        let past = ControllerTrajectory::new(&names(), &names(), &[good], -3.0, &start()).expect_err("over");
        assert_eq!((past.code(), past.to_string().as_str()), (-3, "the trajectory ended 2 s before it came"));
    }

    #[test]
    fn every_kind_of_segment_meets_its_ends_and_its_speed_is_the_derivative_of_its_angle() {
        let kinds: [(&[f64], &[f64]); 3] = [(&[], &[]), (&[0.3, -0.2], &[]), (&[0.3, -0.2], &[0.5, 0.1])];
        for (velocities, accelerations) in kinds {
            let points = [
                point(0.5, &[1.0, -1.0], velocities, accelerations),
                point(2.0, &[0.2, 0.4], velocities, accelerations),
            ];
            let trajectory =
                ControllerTrajectory::new(&names(), &names(), &points, 0.0, &start()).expect("valid");
            let angle = |t: f64| trajectory.sample(t).expect("has points")[0].position;
            assert!((angle(0.5) - 1.0).abs() < 1e-12 && (angle(2.0) - 0.2).abs() < 1e-12);
            assert_eq!(angle(-1.0), 0.0);
            for k in 1..40 {
                let t = f64::from(k) * 0.047;
                let h = 1e-6;
                if (t - 0.5).abs() < 2.0 * h {
                    continue;
                }
                let speed = trajectory.sample(t).expect("has points")[0].velocity.expect("always given");
                assert!(((angle(t + h) - angle(t - h)) / (2.0 * h) - speed).abs() < 1e-6, "at {t}");
            }
            if let Some(v) = velocities.first() {
                let before_end = trajectory.sample(2.0 - 1e-9).expect("has points")[0].velocity;
                assert!((before_end.expect("given") - v).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn a_course_that_began_before_goes_on_from_where_it_should_be() {
        let points = [point(1.0, &[1.0, 0.0], &[], &[]), point(3.0, &[3.0, 0.0], &[], &[])];
        let trajectory =
            ControllerTrajectory::new(&names(), &names(), &points, -2.0, &start()).expect("valid");
        assert_eq!(trajectory.duration_secs(), 1.0);
        assert_eq!(trajectory.sample(0.5).expect("has points")[0].position, 1.5);
    }
}
