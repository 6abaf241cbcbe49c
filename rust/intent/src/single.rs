use crate::{Candidates, IntentModel, IntentModelName, IntentOptions, Posterior, posterior, prior_weights};
use proact_types::{GazeSample, SimTime};

/// What a model without memory looks at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum SingleKind {
    PriorOnly,
    GazeOnly,
    Product,
}

/// A model without memory: each sample stands for itself.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Single {
    kind: SingleKind,
    options: IntentOptions,
}

impl Single {
    pub(crate) fn new(kind: SingleKind, options: IntentOptions) -> Self {
        Self { kind, options }
    }
}

impl IntentModel for Single {
    fn name(&self) -> IntentModelName {
        match self.kind {
            SingleKind::PriorOnly => IntentModelName::PriorOnly,
            SingleKind::GazeOnly => IntentModelName::GazeOnly,
            SingleKind::Product => IntentModelName::Product,
        }
    }

    fn observe(&mut self, _now: SimTime, gaze: &GazeSample, scene: &Candidates) -> Option<Posterior> {
        let context = match self.kind {
            SingleKind::PriorOnly => return scene.prior(&self.options),
            SingleKind::GazeOnly => None,
            SingleKind::Product => scene.context.as_ref(),
        };
        if !gaze.valid {
            return None;
        }
        let weights = prior_weights(scene.centres.len(), context, &self.options);
        // A gaze that is no number tells nothing, as a blink does.
        posterior(gaze, &scene.centres, &scene.possible(), &weights, &self.options).ok().flatten()
    }
}
