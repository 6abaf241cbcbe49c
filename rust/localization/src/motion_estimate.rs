//! Where a body is and how it moves, from its samples: place and attitude together.

use crate::{
    manoeuvre::{Manoeuvres, MovingVector},
    noise_level::NoiseLevel,
};
use nalgebra::{Matrix3, UnitQuaternion};
use proact_types::{Pose, Vector};

/// A shoulder or a head of somebody who sits: sways, reaches, leans. m and s. Of simulated people, whose sway and leans are
/// those of the bench `localization`, with other seeds; between a half and twice these it is as good to within 0.3 % of frames.
const PLACES: Manoeuvres = Manoeuvres {
    accelerations: [0.05, 0.4, 3.0],
    acceleration_secs: 0.2,
    speed_secs: 1.0,
    first: [1e-3, 0.3, 2.0],
};

/// The same of what turns beside that, rad and s: nods and twists end sooner than leans.
const TURNS: Manoeuvres = Manoeuvres {
    accelerations: [0.3, 0.8, 2.5],
    acceleration_secs: 0.07,
    speed_secs: 0.15,
    first: [5e-3, 0.5, 3.0],
};

/// For so long a person turns with a movement as before, s.
const HABIT_SECS: f64 = 30.0;
/// A habit is believed from movements of this much on: speed squared, summed over samples at 100 Hz, m^2/s^2.
const HABIT_LEAST: f64 = 0.1;

/// The motion of one body at its newest sample.
#[derive(Clone, Debug)]
pub(crate) struct MotionEstimate {
    /// s.
    time: f64,
    place: MovingVector,
    /// About `attitude`, in the axes of tracking, less what goes with the place.
    turn: MovingVector,
    attitude: UnitQuaternion<f64>,
    habit: Habit,
    place_noise: NoiseLevel,
    turn_noise: NoiseLevel,
}

/// How a body turns when it moves: a trunk that leans turns about the hip. rad/m, of the axes of tracking.
///
/// A tracking system knows places ten times better than turns, so a lean is seen in the place first.
#[derive(Clone, Debug)]
struct Habit {
    turn_per_way: Matrix3<f64>,
    moved: Matrix3<f64>,
    turned: Matrix3<f64>,
}

impl Habit {
    fn take(&mut self, secs: f64, speed: &Vector, turning: &Vector) {
        let keep = (-secs / HABIT_SECS).exp();
        self.moved = self.moved * keep + speed * speed.transpose() * (secs * 100.0);
        self.turned = self.turned * keep + turning * speed.transpose() * (secs * 100.0);
        let least = Matrix3::identity() * HABIT_LEAST;
        if let Some(inverse) = (self.moved + least).try_inverse() {
            self.turn_per_way = self.turned * inverse;
        }
    }
}

impl MotionEstimate {
    /// A body that is seen for the first time.
    pub fn new(time: f64, pose: &Pose) -> Self {
        let zeros = Matrix3::zeros();
        Self {
            time,
            place: MovingVector::at(pose.translation.vector, PLACES),
            turn: MovingVector::at(Vector::zeros(), TURNS),
            attitude: pose.rotation,
            habit: Habit { turn_per_way: zeros, moved: zeros, turned: zeros },
            place_noise: NoiseLevel::new(3e-4),
            turn_noise: NoiseLevel::new(3.5e-3),
        }
    }

    /// A sample that is later than the one before.
    pub fn take(&mut self, time: f64, pose: &Pose) {
        let secs = time - self.time;
        self.time = time;
        let noise = self.place_noise.take(time, pose.translation.vector);
        let before = self.place.now();
        self.place.take(secs, &pose.translation.vector, noise);
        let after = self.place.now();
        let per_way = self.habit.turn_per_way;
        let measured = (pose.rotation * self.attitude.inverse()).scaled_axis();
        let about = self.turn_noise.about(&pose.rotation);
        let noise = self.turn_noise.take(time, about);
        // What goes with the place is taken out, and put back.
        let went = per_way * (after[0] - before[0]);
        self.turn.take(secs, &(measured - went), noise);
        let [turned, turning, _] = self.turn.now();
        self.attitude = UnitQuaternion::from_scaled_axis(turned + went) * self.attitude;
        self.habit.take(secs, &after[1], &(turning + per_way * after[1]));
        let change = self.habit.turn_per_way - per_way;
        self.turn.shift([turned, change * after[1], change * after[2]]);
    }

    /// s, of the newest sample.
    pub fn time(&self) -> f64 {
        self.time
    }

    /// Where it is expected at `time`.
    pub fn at(&self, time: f64) -> Pose {
        let secs = time - self.time;
        let place = self.place.ahead(secs);
        let way = place - self.place.now()[0];
        let turn = self.turn.ahead(secs) + self.habit.turn_per_way * way;
        Pose::from_parts(place.into(), UnitQuaternion::from_scaled_axis(turn) * self.attitude)
    }

    /// Standard deviation of a coordinate of a sample, m and rad.
    pub fn noise(&self) -> Option<(f64, f64)> {
        Some((self.place_noise.known()?, self.turn_noise.known()?))
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
            motion.take(f64::from(k) * 0.01, &leaning(f64::from(k) * 0.01));
        }
        let learned = motion.habit.turn_per_way;
        assert!((learned[(1, 0)] - 1.2).abs() < 0.05, "{learned}");
        let off = motion.at(15.03).rotation.angle_to(&leaning(15.03).rotation);
        assert!(off < 2e-4, "{off} rad");
        assert!(motion.noise().unwrap().0 < 1e-4);
    }
}
