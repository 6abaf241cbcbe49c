//! Where a body is and how it moves, from its samples: place and attitude together.

use crate::{
    imm_filter::{ImmFilter, ManeuverModel},
    noise_level::NoiseLevel,
};
use nalgebra::{Matrix3, UnitQuaternion};
use proact_types::{Pose, Vector};

/// A shoulder or a head of somebody who sits: sways, reaches, leans. m and s. Of simulated people, whose sway and leans are
/// those of the bench `localization`, with other seeds; between a half and twice these it is as good to within 0.3 % of frames.
const POSITION_MODEL: ManeuverModel = ManeuverModel {
    acceleration_sds: [0.05, 0.4, 3.0],
    acceleration_secs: 0.2,
    speed_secs: 1.0,
    initial_sds: [1e-3, 0.3, 2.0],
};

/// The same of what turns beside that, rad and s: nods and twists end sooner than leans.
const ROTATION_MODEL: ManeuverModel = ManeuverModel {
    acceleration_sds: [0.3, 0.8, 2.5],
    acceleration_secs: 0.07,
    speed_secs: 0.15,
    initial_sds: [5e-3, 0.5, 3.0],
};

/// For so long a person turns with a movement as before, s.
const COUPLING_TIME_CONSTANT_SECS: f64 = 30.0;
/// A habit is believed from movements of this much on: speed squared, summed over samples at 100 Hz, m^2/s^2.
const COUPLING_REGULARIZATION: f64 = 0.1;

/// The motion of one body at its newest sample.
#[derive(Clone, Debug)]
pub(crate) struct MotionEstimate {
    /// s.
    time: f64,
    position: ImmFilter,
    /// About `attitude`, in the axes of tracking, less what goes with the place.
    rotation: ImmFilter,
    attitude: UnitQuaternion<f64>,
    coupling: LeanCoupling,
    position_noise: NoiseLevel,
    rotation_noise: NoiseLevel,
}

/// How a body turns when it moves: a trunk that leans turns about the hip. rad/m, of the axes of tracking.
///
/// A tracking system knows places ten times better than turns, so a lean is seen in the place first.
#[derive(Clone, Debug)]
struct LeanCoupling {
    rotation_per_translation: Matrix3<f64>,
    velocity_moment: Matrix3<f64>,
    cross_moment: Matrix3<f64>,
}

impl LeanCoupling {
    fn update(&mut self, secs: f64, speed: &Vector, turning: &Vector) {
        let keep = (-secs / COUPLING_TIME_CONSTANT_SECS).exp();
        self.velocity_moment = self.velocity_moment * keep + speed * speed.transpose() * (secs * 100.0);
        self.cross_moment = self.cross_moment * keep + turning * speed.transpose() * (secs * 100.0);
        let regularization = Matrix3::identity() * COUPLING_REGULARIZATION;
        if let Some(inverse) = (self.velocity_moment + regularization).try_inverse() {
            self.rotation_per_translation = self.cross_moment * inverse;
        }
    }
}

impl MotionEstimate {
    /// A body that is seen for the first time.
    pub fn new(time: f64, pose: &Pose) -> Self {
        let zeros = Matrix3::zeros();
        Self {
            time,
            position: ImmFilter::at(pose.translation.vector, POSITION_MODEL),
            rotation: ImmFilter::at(Vector::zeros(), ROTATION_MODEL),
            attitude: pose.rotation,
            coupling: LeanCoupling {
                rotation_per_translation: zeros,
                velocity_moment: zeros,
                cross_moment: zeros,
            },
            position_noise: NoiseLevel::new(3e-4),
            rotation_noise: NoiseLevel::new(3.5e-3),
        }
    }

    /// A sample that is later than the one before.
    pub fn update(&mut self, time: f64, pose: &Pose) {
        let secs = time - self.time;
        self.time = time;
        let noise = self.position_noise.update(time, pose.translation.vector);
        let before = self.position.state();
        self.position.update(secs, &pose.translation.vector, noise);
        let after = self.position.state();
        let rotation_per_translation = self.coupling.rotation_per_translation;
        let measured = (pose.rotation * self.attitude.inverse()).scaled_axis();
        let about = self.rotation_noise.rotation_vector(&pose.rotation);
        let noise = self.rotation_noise.update(time, about);
        // What goes with the place is taken out, and put back.
        let went = rotation_per_translation * (after[0] - before[0]);
        self.rotation.update(secs, &(measured - went), noise);
        let [turned, turning, _] = self.rotation.state();
        self.attitude = UnitQuaternion::from_scaled_axis(turned + went) * self.attitude;
        self.coupling.update(secs, &after[1], &(turning + rotation_per_translation * after[1]));
        let change = self.coupling.rotation_per_translation - rotation_per_translation;
        self.rotation.subtract_state([turned, change * after[1], change * after[2]]);
    }

    /// s, of the newest sample.
    pub fn time(&self) -> f64 {
        self.time
    }

    /// Where it is expected at `time`.
    pub fn pose_at(&self, time: f64) -> Pose {
        let secs = time - self.time;
        let position = self.position.predict(secs);
        let displacement = position - self.position.state()[0];
        let turn = self.rotation.predict(secs) + self.coupling.rotation_per_translation * displacement;
        Pose::from_parts(position.into(), UnitQuaternion::from_scaled_axis(turn) * self.attitude)
    }

    /// Standard deviation of a coordinate of a sample, m and rad.
    pub fn noise(&self) -> Option<(f64, f64)> {
        Some((self.position_noise.converged_sd()?, self.rotation_noise.converged_sd()?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    /// Somebody who leans 10 cm ahead and back every two seconds and turns by 1.2 rad/m with it.
    fn leaning(t: f64) -> Pose {
        let x = 0.05 * (TAU * 0.5 * t).sin();
        Pose::from_parts(
            Vector::new(x, 0.0, 1.4).into(),
            UnitQuaternion::from_scaled_axis(Vector::y() * 1.2 * x),
        )
    }

    #[test]
    fn the_turn_that_goes_with_a_lean_is_learned_and_predicted_from_the_place() {
        let mut motion = MotionEstimate::new(0.0, &leaning(0.0));
        for k in 1..1500 {
            motion.update(f64::from(k) * 0.01, &leaning(f64::from(k) * 0.01));
        }
        let learned = motion.coupling.rotation_per_translation;
        assert!((learned[(1, 0)] - 1.2).abs() < 0.05, "{learned}");
        let off = motion.pose_at(15.03).rotation.angle_to(&leaning(15.03).rotation);
        assert!(off < 2e-4, "{off} rad");
        assert!(motion.noise().unwrap().0 < 1e-4);
    }
}
