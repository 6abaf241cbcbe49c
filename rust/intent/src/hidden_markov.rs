use crate::{
    Candidates, IntentModel, IntentModelName, IntentOptions, Posterior,
    posterior::{log_likelihood, normalize_log_weights},
};
use proact_types::{GazeSample, SimTime};

/// A hidden Markov model over goals. The goal is one of the objects; with the rate `goal_switching_rate_per_s` it is drawn
/// anew from the task's prior. Between samples dt apart
///
/// predict: p_i <- e^(-rate dt) p_i + (1 - e^(-rate dt)) prior_i
/// update:  p_i <- p_i ((1 - elsewhere) e^(-x_i^2 / 2 sigma^2) + elsewhere)^(min(1, dt / look))
///
/// with x_i as in [`crate::posterior`]. The exponent makes the belief depend on how long was looked, not on how
/// many samples the tracker gave. Blinks predict and do not update, so that the belief fades toward the prior.
/// The first sample has no duration and gives the prior.
#[derive(Clone, Debug)]
pub(crate) struct HiddenMarkovModel {
    options: IntentOptions,
    belief: Option<Belief>,
}

#[derive(Clone, Debug)]
struct Belief {
    at: SimTime,
    selection: Option<u32>,
    probability: Posterior,
}

impl HiddenMarkovModel {
    pub(crate) fn new(options: IntentOptions) -> Self {
        Self { options, belief: None }
    }
}

impl IntentModel for HiddenMarkovModel {
    fn name(&self) -> IntentModelName {
        IntentModelName::Filtered
    }

    fn observe(&mut self, now: SimTime, gaze: &GazeSample, scene: &Candidates) -> Option<Posterior> {
        let prior = scene.prior(&self.options)?;
        // A release that changes what is due begins a new selection.
        let belief = self.belief.take().filter(|b| b.selection == scene.selection());
        let millis = belief.as_ref().map_or(0.0, |b| now.millis_since(b.at) as f64);
        let stay = (-self.options.goal_switching_rate_per_s * millis * 1e-3).exp();
        let held = belief.map_or_else(|| prior.clone(), |b| b.probability);
        let possible = scene.valid_candidates();
        let predict = |i: usize| {
            let p = stay * held[i] + (1.0 - stay) * prior[i];
            (possible[i] && p > 0.0).then(|| p.ln())
        };
        let predicted: Vec<Option<f64>> = (0..prior.len()).map(predict).collect();

        let seen = if gaze.valid {
            log_likelihood(gaze, &scene.centers, self.options.gaze_sigma).ok()
        } else {
            None
        };
        let weight = (millis / self.options.independent_fixation_ms).min(1.0);
        let updated = seen.and_then(|seen| {
            let elsewhere = self.options.off_target_likelihood;
            normalize_log_weights((0..seen.len()).map(|i| {
                // An object behind the eye has the likelihood of one that is not looked at.
                let near = seen[i].map_or(0.0, f64::exp);
                let log = ((1.0 - elsewhere) * near + elsewhere).ln();
                // Zero times minus infinity is no number: no duration, no evidence.
                predicted[i].map(|p| if weight > 0.0 { p + weight * log } else { p })
            }))
        });
        // Without evidence, or when the evidence excludes all objects, the prediction stands.
        let probability = updated.or_else(|| normalize_log_weights(predicted.into_iter())).unwrap_or(prior);
        self.belief =
            Some(Belief { at: now, selection: scene.selection(), probability: probability.clone() });
        Some(probability)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::assert_close;
    use proact_types::{ObjectId, ObjectSet, Point, TaskContext, Vector};

    /// Two red ones, which are due, and two blue ones.
    fn scene() -> Candidates {
        Candidates {
            centers: [0.0, 0.5, -0.1, -0.5].map(|y| Point::new(1.0, y, 0.0)).to_vec(),
            pickable: vec![true; 4],
            context: Some(TaskContext { expected_objects: ObjectSet::first(2), selection_number: 0 }),
            tip: None,
        }
    }

    fn look(at: usize) -> GazeSample {
        GazeSample { origin: Point::origin(), direction: scene().centers[at].coords, valid: true }
    }

    fn watch(
        model: &mut HiddenMarkovModel,
        from: u64,
        millis: u64,
        period: u64,
        gaze: &GazeSample,
    ) -> Posterior {
        let mut last = Vec::new();
        for t in (from..=from + millis).step_by(period as usize) {
            last = model.observe(SimTime(t), gaze, &scene()).expect("blocks to pick");
        }
        last
    }

    #[test]
    fn one_look_without_switching_counts_as_one_likelihood() {
        // By hand: sigma 0.05, blue 1 is 0.1 from the gaze: e^(-2). Prior 3 to 1 for red 1.
        let options = IntentOptions {
            gaze_sigma: 0.05,
            goal_switching_rate_per_s: 0.0,
            off_target_likelihood: 0.0,
            independent_fixation_ms: 250.0,
            ..Default::default()
        };
        let p = watch(&mut HiddenMarkovModel::new(options), 0, 250, 25, &look(0));
        assert!((p[2] / p[0] - (-2.0_f64).exp() / 3.0).abs() < 1e-9, "{p:?}");
    }

    #[test]
    fn the_rate_of_the_tracker_hardly_matters() {
        let ask = |period| {
            watch(&mut HiddenMarkovModel::new(IntentOptions::default()), 0, 1200, period, &look(2))[2]
        };
        assert!((ask(10) - ask(40)).abs() < 0.01, "{} {}", ask(10), ask(40));
    }

    #[test]
    fn a_glance_does_not_change_the_belief_and_a_long_look_does() {
        let mut model = HiddenMarkovModel::new(IntentOptions::default());
        assert!(watch(&mut model, 0, 1000, 20, &look(0))[0] > 0.9);
        assert!(watch(&mut model, 1020, 80, 20, &look(2))[0] > 0.5, "80 ms at another block");
        assert!(watch(&mut model, 1120, 1500, 20, &look(2))[2] > 0.9, "1.5 s at another block");
    }

    #[test]
    fn blinks_fade_toward_the_prior_and_a_release_begins_anew() {
        let mut model = HiddenMarkovModel::new(IntentOptions::default());
        let sure = watch(&mut model, 0, 1500, 20, &look(2));
        let blink = GazeSample { valid: false, direction: Vector::zeros(), ..look(0) };
        let after = watch(&mut model, 1520, 200, 20, &blink);
        assert!(after[2] < sure[2] && after[2] > 0.8, "{sure:?} {after:?}");
        let long = model.observe(SimTime(60_000), &blink, &scene()).expect("blocks to pick");
        assert!((long[0] - 0.375).abs() < 1e-6 && (long[2] - 0.125).abs() < 1e-6, "{long:?}");

        watch(&mut model, 60_020, 1500, 20, &look(2));
        let blue = [2, 3].map(ObjectId::new).into_iter().collect();
        let next = Candidates {
            context: Some(TaskContext { expected_objects: blue, selection_number: 1 }),
            ..scene()
        };
        let p = model.observe(SimTime(61_600), &look(2), &next).expect("blocks to pick");
        assert_close(Some(p), [0.125, 0.125, 0.375, 0.375]);
    }
}
