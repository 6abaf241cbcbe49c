//! What gaze and task say of what is meant, each for itself: for whoever watches. No stage reads it.

use proact_bridge::{IntentDomain, IntentEstimate};
use proact_intent::{Candidates, IntentModel, IntentModelName, Posterior};
use proact_testbed::Testbed;
use proact_types::{GazeSample, MethodStyle, ObjectId, ObjectSet, Point, SimTime, TaskContext};

/// Probabilities are told to a ten-thousandth.
const PROBABILITY_STEPS: f64 = 1e4;

/// The three parts of Bayes' rule, from the gaze of the moment.
pub(crate) struct IntentView {
    likelihood: Box<dyn IntentModel>,
    prior: Box<dyn IntentModel>,
    posterior: Box<dyn IntentModel>,
    /// The last valid gaze.
    gaze: Option<GazeSample>,
}

impl IntentView {
    /// Of the trial of `testbed`; none where the method does not select by gaze, or where a model in another process says what is
    /// meant, of which these numbers are not.
    pub(crate) fn for_testbed(testbed: &Testbed) -> Option<Self> {
        let method = testbed.method();
        let own = testbed.config().intent_process.is_none();
        let selects = own && method.needs.gaze && method.style == MethodStyle::Selecting;
        // Options that no model takes have been refused with the trial.
        let model = |name: IntentModelName| name.build(&testbed.config().intent).ok();
        selects.then_some(())?;
        Some(Self {
            likelihood: model(IntentModelName::GazeOnly)?,
            prior: model(IntentModelName::PriorOnly)?,
            posterior: model(IntentModelName::Product)?,
            gaze: None,
        })
    }

    /// A new gaze; a blink changes nothing.
    pub(crate) fn update_gaze(&mut self, gaze: GazeSample) {
        if gaze.valid {
            self.gaze = Some(gaze);
        }
    }

    /// What is said at `now`: of objects while the hand is empty, else of the places where they go.
    pub(crate) fn current_intent(&mut self, now: SimTime, testbed: &Testbed) -> Option<IntentEstimate> {
        let gaze = self.gaze?;
        let held = testbed.plant().state().attached;
        let (over, candidates) = match held {
            None => (IntentDomain::Objects, object_candidates(testbed)),
            Some((object, _)) => (IntentDomain::Targets, target_candidates(testbed, ObjectId::new(object))?),
        };
        let ask = |model: &mut Box<dyn IntentModel>| {
            model.observe(now, &gaze, &candidates).map(|found: Posterior| {
                found
                    .into_iter()
                    .map(|p| (p * PROBABILITY_STEPS).round() / PROBABILITY_STEPS)
                    .collect::<Vec<f64>>()
            })
        };
        Some(IntentEstimate {
            domain: over,
            likelihood: ask(&mut self.likelihood)?,
            prior: ask(&mut self.prior)?,
            posterior: ask(&mut self.posterior)?,
        })
    }
}

/// The objects that may be taken, and which of them the task asks for, whatever the method takes of that.
fn object_candidates(testbed: &Testbed) -> Candidates {
    let (state, scene) = (testbed.task().state(), testbed.task().scene());
    let objects = &testbed.plant().state().objects;
    let center = |id: ObjectId| objects[id.index()].pose.translation.vector;
    let buried = |id: ObjectId| scene.objects[id.index()].loose && scene.is_covered(id, center);
    Candidates {
        centers: objects.iter().map(|object| Point::from(object.pose.translation.vector)).collect(),
        pickable: scene.ids().map(|id| state.candidates.contains(id) && !buried(id)).collect(),
        context: Some(match testbed.config().intent.context_changes_at_grasp {
            true => state.context_at_grasp,
            false => state.context,
        }),
        tip: None,
    }
}

/// The targets of the scene; the task asks for those of what is held. None where objects have no targets.
fn target_candidates(testbed: &Testbed, held: ObjectId) -> Option<Candidates> {
    let targets = &testbed.task().scene().targets;
    let mut due = ObjectSet::default();
    for (index, _) in targets.iter().enumerate().filter(|(_, target)| target.object == held) {
        due.insert(ObjectId::new(index));
    }
    (!targets.is_empty()).then(|| Candidates {
        centers: targets.iter().map(|target| target.center).collect(),
        pickable: vec![true; targets.len()],
        context: Some(TaskContext { expected_objects: due, selection_number: 0 }),
        tip: None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trial::{self, Assembly};
    use proact_devices::EmgOrigin;
    use proact_testbed::{Setup, TrialConfig};

    fn trial(method: &str) -> Assembly {
        let config = TrialConfig::new(method, 1, Setup::named("still").unwrap());
        trial::simulated_trial(config, &EmgOrigin::Synthetic).unwrap()
    }

    #[test]
    fn who_selects_by_gaze_is_told_what_gaze_and_task_say_and_both_over_blocks_and_places() {
        let Assembly { mut trial, .. } = trial("D");
        let mut view = IntentView::for_testbed(trial.testbed()).unwrap();
        let mut seen = [false; 2];
        while trial.testbed().now().0 < 60_000 && seen != [true; 2] {
            let step = trial.step(false).unwrap();
            if let Some(gaze) = step.input.gaze {
                view.update_gaze(gaze);
            }
            let Some(intent) = view.current_intent(step.time, trial.testbed()) else { continue };
            for list in [&intent.likelihood, &intent.prior, &intent.posterior] {
                assert_eq!(list.len(), 4);
                assert!((list.iter().sum::<f64>() - 1.0).abs() < 1e-3, "{intent:?}");
            }
            assert!(intent.prior.iter().any(|p| *p > 0.3), "the task asks for something: {intent:?}");
            // Bayes' rule, where the numbers are large enough to have survived the rounding.
            for k in (0..4).filter(|k| intent.likelihood[*k] > 0.05) {
                let unscaled = |j: usize| intent.likelihood[j] * intent.prior[j];
                let whole: f64 = (0..4).map(unscaled).sum();
                assert!((intent.posterior[k] - unscaled(k) / whole).abs() < 0.01, "{intent:?}");
            }
            seen[usize::from(intent.domain == IntentDomain::Targets)] = true;
        }
        assert_eq!(seen, [true; 2], "blocks, then places");
    }

    #[test]
    fn who_drives_joints_means_nothing_by_gaze() {
        assert!(IntentView::for_testbed(trial("A").trial.testbed()).is_none());
    }
}
