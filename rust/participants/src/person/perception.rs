use super::{PersonTraits, stream};
use proact_types::{DisplayFrame, Point, Pose, Vector};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// What a person takes in of a frame: only what the headset's field of view shows is seen anew, the rest is remembered as
/// it was, and depth is misjudged.
pub(crate) struct Perception {
    rng: ChaCha8Rng,
    /// Half width and half height of the field of view, rad; none where it is everything.
    half_field_of_view_rad: Option<[f64; 2]>,
    depth_error_m: f64,
    /// `world_from_object` as each was last seen.
    remembered: Vec<Pose>,
    /// How much further away than it is each object seems, metres.
    depth: Vec<f64>,
}

impl Perception {
    pub(crate) fn new(traits: &PersonTraits, seed: u64) -> Self {
        let [width, height] = traits.field_of_view_deg;
        let half_view = (width < 360.0 || height < 180.0)
            .then(|| [width, height].map(|degrees| degrees.to_radians() / 2.0));
        Self {
            rng: stream(seed, "perception"),
            half_field_of_view_rad: half_view,
            depth_error_m: traits.depth_error_m,
            remembered: Vec::new(),
            depth: Vec::new(),
        }
    }

    /// Replaces what `frame` shows of objects by what is taken in of it, with the head turned to what is looked at along
    /// `gaze`, `world`.
    pub(crate) fn update(&mut self, frame: &mut DisplayFrame, gaze: &Vector) {
        if self.half_field_of_view_rad.is_none() && self.depth_error_m <= 0.0 {
            return;
        }
        // At the beginning of a trial everything is looked at once.
        self.remembered.extend(frame.objects.iter().skip(self.remembered.len()));
        while self.depth.len() < frame.objects.len() {
            let error = self.draw();
            self.depth.push(error);
        }
        let eye = Point::from(frame.world_from_head.translation.vector);
        for (k, pose) in frame.objects.iter_mut().enumerate() {
            let held = frame.hand.held_object.is_some_and(|object| object.index() == k);
            let to_object = pose.translation.vector - eye.coords;
            if held || self.is_in_view(&to_object, gaze) {
                self.remembered[k] = *pose;
            } else {
                *pose = self.remembered[k];
            }
            // What is in the hand is where the hand is.
            if !held && let Some(away) = (pose.translation.vector - eye.coords).try_normalize(1e-9) {
                // On the table it stands, so that the error runs along the table.
                let along = Vector::new(away.x, away.y, 0.0).try_normalize(1e-9).unwrap_or_default();
                pose.translation.vector += along * self.depth[k];
            }
        }
    }

    /// An object is looked at anew: its depth is judged once more, better than the time before by what was just felt.
    pub(crate) fn resample_depth(&mut self, object: usize) {
        let error = self.draw() / 2.0;
        if let Some(depth) = self.depth.get_mut(object) {
            *depth = error;
        }
    }

    fn is_in_view(&self, to_object: &Vector, gaze: &Vector) -> bool {
        let Some([half_width, half_height]) = self.half_field_of_view_rad else { return true };
        let heading = |v: &Vector| v.y.atan2(v.x);
        let pitch = |v: &Vector| v.z.atan2(v.xy().norm());
        let turn = heading(to_object) - heading(gaze);
        let turn = turn.sin().atan2(turn.cos());
        // A degree of heading is less the further down one looks.
        (turn * pitch(gaze).cos()).abs() <= half_width
            && (pitch(to_object) - pitch(gaze)).abs() <= half_height
    }

    fn draw(&mut self) -> f64 {
        if self.depth_error_m <= 0.0 {
            return 0.0;
        }
        let unit: f64 = StandardNormal.sample(&mut self.rng);
        self.depth_error_m * unit
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(x: f64) -> DisplayFrame {
        let objects = vec![Pose::translation(x, 0.0, 0.0), Pose::translation(0.0, 2.0, 0.0)];
        DisplayFrame { objects, ..crate::doubles::empty_frame() }
    }

    #[test]
    fn what_the_headset_does_not_show_stays_where_it_was_seen_last() {
        let traits = PersonTraits { field_of_view_deg: [43.0, 29.0], ..PersonTraits::default() };
        let mut perception = Perception::new(&traits, 1);
        let mut first = frame(1.0);
        perception.update(&mut first, &Vector::x());
        assert_eq!(first.objects, frame(1.0).objects, "the scene is looked over at first");
        let (mut seen, mut unseen) = (frame(1.5), frame(2.0));
        perception.update(&mut seen, &Vector::x());
        assert_eq!(seen.objects[0].translation.x, 1.5);
        perception.update(&mut unseen, &Vector::y());
        assert_eq!(unseen.objects[0].translation.x, 1.5);
    }

    #[test]
    fn depth_is_misjudged_along_the_line_of_sight_and_better_when_looked_at_again() {
        let traits = PersonTraits { depth_error_m: 0.02, ..PersonTraits::default() };
        let error = |seed: u64, again: bool| {
            let mut perception = Perception::new(&traits, seed);
            let mut seen = frame(1.0);
            perception.update(&mut seen, &Vector::x());
            if again {
                seen = frame(1.0);
                perception.resample_depth(0);
                perception.update(&mut seen, &Vector::x());
            }
            let at = seen.objects[0].translation.vector;
            assert_eq!((at.y, at.z), (0.0, 0.0));
            at.x - 1.0
        };
        let rms = |again| {
            let sum: f64 = (0..400).map(|seed| error(seed, again).powi(2)).sum();
            (sum / 400.0).sqrt()
        };
        assert!((0.018..0.022).contains(&rms(false)), "{}", rms(false));
        assert!((0.009..0.011).contains(&rms(true)), "{}", rms(true));
    }
}
