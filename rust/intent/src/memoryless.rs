use crate::{Candidates, IntentModel, IntentModelName, IntentOptions, Posterior, posterior, prior_weights};
use proact_types::{GazeSample, SimTime};

/// What a model without memory looks at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum MemorylessKind {
    PriorOnly,
    GazeOnly,
    Product,
}

/// A model without memory: each sample stands for itself.
#[derive(Clone, Copy, Debug)]
pub(crate) struct MemorylessModel {
    kind: MemorylessKind,
    options: IntentOptions,
}

impl MemorylessModel {
    pub(crate) fn new(kind: MemorylessKind, options: IntentOptions) -> Self {
        Self { kind, options }
    }
}

impl IntentModel for MemorylessModel {
    fn name(&self) -> IntentModelName {
        match self.kind {
            MemorylessKind::PriorOnly => IntentModelName::PriorOnly,
            MemorylessKind::GazeOnly => IntentModelName::GazeOnly,
            MemorylessKind::Product => IntentModelName::Product,
        }
    }

    fn observe(&mut self, _now: SimTime, gaze: &GazeSample, scene: &Candidates) -> Option<Posterior> {
        let context = match self.kind {
            MemorylessKind::PriorOnly => return scene.prior(&self.options),
            MemorylessKind::GazeOnly => None,
            MemorylessKind::Product => scene.context.as_ref(),
        };
        if !gaze.valid {
            return None;
        }
        let weights = prior_weights(scene.centers.len(), context, &self.options);
        // A gaze that is no number tells nothing, as a blink does.
        posterior(gaze, &scene.centers, &scene.valid_candidates(), &weights, &self.options).ok().flatten()
    }
}
