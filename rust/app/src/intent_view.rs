//! What gaze and task say of what is meant, each for itself: for whoever watches. No stage reads it.

use proact_bridge::{Intent, IntentOver};
use proact_intent::{Candidates, IntentModel, IntentModelName, Posterior};
use proact_testbed::Testbed;
use proact_types::{GazeSample, MethodStyle, ObjectId, ObjectSet, Point, SimTime, TaskContext};

/// Probabilities are told to a ten-thousandth.
const STEPS: f64 = 1e4;

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
    pub(crate) fn of(testbed: &Testbed) -> Option<Self> {
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
    pub(crate) fn look(&mut self, gaze: GazeSample) {
        if gaze.valid {
            self.gaze = Some(gaze);
        }
    }

    /// What is said at `now`: of objects while the hand is empty, else of the places where they go.
    pub(crate) fn told(&mut self, now: SimTime, testbed: &Testbed) -> Option<Intent> {
        let gaze = self.gaze?;
        let held = testbed.plant().state().attached;
        let (over, candidates) = match held {
            None => (IntentOver::Objects, objects(testbed)),
            Some((object, _)) => (IntentOver::Places, places(testbed, ObjectId::new(object))?),
        };
        let ask = |model: &mut Box<dyn IntentModel>| {
            model.observe(now, &gaze, &candidates).map(|found: Posterior| {
                found.into_iter().map(|p| (p * STEPS).round() / STEPS).collect::<Vec<f64>>()
            })
        };
        Some(Intent {
            over,
            likelihood: ask(&mut self.likelihood)?,
            prior: ask(&mut self.prior)?,
            posterior: ask(&mut self.posterior)?,
        })
    }
}

/// The objects that may be taken, and which of them the task asks for, whatever the method takes of that.
fn objects(testbed: &Testbed) -> Candidates {
    let (state, scene) = (testbed.task().state(), testbed.task().scene());
    let objects = &testbed.plant().state().objects;
    let centre = |id: ObjectId| objects[id.index()].pose.translation.vector;
    let buried = |id: ObjectId| scene.objects[id.index()].loose && scene.is_covered(id, centre);
    Candidates {
        centres: objects.iter().map(|object| Point::from(object.pose.translation.vector)).collect(),
        pickable: scene.ids().map(|id| state.candidates.contains(id) && !buried(id)).collect(),
        context: Some(match testbed.config().intent.changes_at_grasp {
            true => state.context_at_grasp,
            false => state.context,
        }),
        tip: None,
    }
}

/// The targets of the scene; the task asks for those of what is held. None where objects have no targets.
fn places(testbed: &Testbed, held: ObjectId) -> Option<Candidates> {
    let targets = &testbed.task().scene().targets;
    let mut due = ObjectSet::default();
    for (place, _) in targets.iter().enumerate().filter(|(_, target)| target.object == held) {
        due.insert(ObjectId::new(place));
    }
    (!targets.is_empty()).then(|| Candidates {
        centres: targets.iter().map(|target| target.centre).collect(),
        pickable: vec![true; targets.len()],
        context: Some(TaskContext { due, number: 0 }),
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
        trial::simulated(config, &EmgOrigin::Synthetic).unwrap()
    }

    #[test]
    fn who_selects_by_gaze_is_told_what_gaze_and_task_say_and_both_over_blocks_and_places() {
        let Assembly { mut session, .. } = trial("D");
        let mut view = IntentView::of(session.testbed()).unwrap();
        let mut seen = [false; 2];
        while session.testbed().now().0 < 60_000 && seen != [true; 2] {
            let step = session.step(false).unwrap();
            if let Some(gaze) = step.input.gaze {
                view.look(gaze);
            }
            let Some(told) = view.told(step.time, session.testbed()) else { continue };
            for list in [&told.likelihood, &told.prior, &told.posterior] {
                assert_eq!(list.len(), 4);
                assert!((list.iter().sum::<f64>() - 1.0).abs() < 1e-3, "{told:?}");
            }
            assert!(told.prior.iter().any(|p| *p > 0.3), "the task asks for something: {told:?}");
            // Bayes' rule, where the numbers are large enough to have survived the rounding.
            for k in (0..4).filter(|k| told.likelihood[*k] > 0.05) {
                let unscaled = |j: usize| told.likelihood[j] * told.prior[j];
                let whole: f64 = (0..4).map(unscaled).sum();
                assert!((told.posterior[k] - unscaled(k) / whole).abs() < 0.01, "{told:?}");
            }
            seen[usize::from(told.over == IntentOver::Places)] = true;
        }
        assert_eq!(seen, [true; 2], "blocks, then places");
    }

    #[test]
    fn who_drives_joints_means_nothing_by_gaze() {
        assert!(IntentView::of(trial("A").session.testbed()).is_none());
    }
}
