use crate::{
    Candidates, IntentModel, IntentModelName, IntentOptions, Posterior, posterior::normalize_log_weights,
};
use proact_types::{GazeSample, Point, SimTime};

/// Without an observation for this long the hand has been about something else, ms.
const RESET_AFTER_MS: u64 = 1000;

/// Maximum-entropy inference of the goal from the way of the hand. Ways to a goal G have probability
/// proportional to e^(-cost), cost = straightness times length; then a way from S to U, so far, has the likelihood
///
/// e^(-cost(S to U) - V_G(U)) / e^(-V_G(S)),   V_G(x) = straightness |x - G|
///
/// with the cost of the best rest of the way for the sum over all of them (Dragan and Srinivasa, "A policy-blending
/// formalism for shared control", IJRR 2013, section 3, after Ziebart et al. 2008). The cost so far is the same for all
/// goals, so that log-odds are straightness times the way gained: |S - G| - |U - G|.
///
/// S is where the hand was when the selection began. With methods C and D the arm moves only after the selection,
/// so that this model can confirm, and cannot foresee.
#[derive(Clone, Debug)]
pub(crate) struct HandMotionModel {
    options: IntentOptions,
    start: Option<Point>,
    last: Option<(SimTime, Option<u32>)>,
}

impl HandMotionModel {
    pub(crate) fn new(options: IntentOptions) -> Self {
        Self { options, start: None, last: None }
    }
}

impl IntentModel for HandMotionModel {
    fn name(&self) -> IntentModelName {
        IntentModelName::HandMotion
    }

    fn observe(&mut self, now: SimTime, _gaze: &GazeSample, scene: &Candidates) -> Option<Posterior> {
        let goes_on = self.last.is_some_and(|(at, selection)| {
            selection == scene.selection() && now.millis_since(at) <= RESET_AFTER_MS
        });
        if !goes_on {
            self.start = None;
        }
        self.last = Some((now, scene.selection()));
        let prior = scene.prior(&self.options)?;
        let Some(tip) = scene.tip.filter(|tip| tip.coords.iter().all(|v| v.is_finite())) else {
            return Some(prior);
        };
        let start = *self.start.get_or_insert(tip);
        normalize_log_weights(prior.iter().zip(&scene.centers).map(|(prior, center)| {
            let gained = (start - center).norm() - (tip - center).norm();
            (*prior > 0.0).then(|| prior.ln() + self.options.straightness_per_m * gained)
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::assert_close;
    use proact_types::{ObjectId, ObjectSet, TaskContext, Vector};

    fn scene(tip: Option<Point>) -> Candidates {
        Candidates {
            centers: vec![
                Point::new(1.0, 0.0, 0.0),
                Point::new(-1.0, 0.0, 0.0),
                Point::new(0.0, 1.0, 0.0),
                Point::new(0.0, -1.0, 0.0),
            ],
            pickable: vec![true; 4],
            context: Some(TaskContext { expected_objects: ObjectSet::first(2), selection_number: 0 }),
            tip,
        }
    }

    const GAZE: GazeSample =
        GazeSample { origin: Point::new(0.0, 0.0, 0.0), direction: Vector::new(0.0, 1.0, 0.0), valid: true };

    #[test]
    fn the_log_odds_are_straightness_times_the_way_gained() {
        let mut model = HandMotionModel::new(IntentOptions::default());
        let first = model.observe(SimTime(0), &GAZE, &scene(Some(Point::origin())));
        assert_close(first, [0.375, 0.375, 0.125, 0.125]);
        // By hand: 0.1 m gained on red 1, 0.1 m lost on red 2: log-odds 20 * 0.2 = 4.
        let p = model
            .observe(SimTime(20), &GAZE, &scene(Some(Point::new(0.1, 0.0, 0.0))))
            .expect("blocks to pick");
        assert!(((p[0] / p[1]).ln() - 4.0).abs() < 1e-9, "{p:?}");
        assert_eq!(p[2], p[3], "neither gained nor lost");
    }

    #[test]
    fn a_release_and_a_pause_begin_anew_and_an_unknown_hand_gives_the_prior() {
        let mut model = HandMotionModel::new(IntentOptions::default());
        model.observe(SimTime(0), &GAZE, &scene(Some(Point::origin())));
        let moved = scene(Some(Point::new(0.3, 0.0, 0.0)));
        assert!(model.observe(SimTime(20), &GAZE, &moved).expect("blocks")[0] > 0.9);
        assert_eq!(
            model.observe(SimTime(40), &GAZE, &scene(Some(Point::new(f64::NAN, 0.0, 0.0)))),
            Some(vec![0.375, 0.375, 0.125, 0.125])
        );
        let paused = model.observe(SimTime(5000), &GAZE, &moved).expect("blocks");
        assert_close(Some(paused), [0.375, 0.375, 0.125, 0.125]);
        let blue = [2, 3].map(ObjectId::new).into_iter().collect();
        let context = Some(TaskContext { expected_objects: blue, selection_number: 1 });
        let released = Candidates { context, ..scene(Some(Point::origin())) };
        assert_close(model.observe(SimTime(5020), &GAZE, &released), [0.125, 0.125, 0.375, 0.375]);
    }
}
