use crate::{TestbedError, TrialConfig};
use proact_emg::{Classifier, EmgOutput, EmgPipeline};
use proact_types::{EmgSample, EventKind, Gesture, GestureCommands, GestureName, SimTime, StopCause};

/// From muscle, or from keys, to the gesture in force, and the command that it is to the method.
pub struct EmgStage {
    /// None when gestures are given directly.
    muscles: Option<(EmgPipeline, GestureCommands)>,
    given: Option<Gesture>,
    recognised: GestureName,
    confidence: f64,
    effort: f64,
    decided_at: Option<SimTime>,
}

/// What enters the EMG stage in one tick.
#[derive(Clone, Copy, Debug, Default)]
pub struct EmgStageInput<'a> {
    /// Samples that arrived, oldest first.
    pub samples: &'a [EmgSample],
    /// A gesture given directly, in force until the next one. Overrides the classifier.
    pub gesture: Option<Gesture>,
}

/// What the EMG stage says in one tick.
#[derive(Clone, Debug, PartialEq)]
pub struct EmgStageOutput {
    /// The command in force.
    pub gesture: Gesture,
    /// The gesture that gives it, as the model calls it; that of the command's name when it is given directly.
    pub recognised: GestureName,
    /// A window of EMG ended in this tick, or the stream became stale.
    pub decision: Option<EmgOutput>,
    /// The command that goes out as a message in this tick, for methods that act on messages.
    pub message: Option<Gesture>,
    /// When there was a decision last; none when gestures are given directly.
    pub decided_at: Option<SimTime>,
    /// Probability of the recognised class, 0 to 1; one for a gesture given directly.
    pub confidence: f64,
    /// How hard it is made, 0 to 1; one for a gesture given directly.
    pub effort: f64,
    /// Why the stream is dead, and that as a sentence; none while it lives.
    pub fault: Option<(StopCause, String)>,
    /// Gestures pass: no relaxed hand is waited for.
    pub armed: bool,
    /// What befell the stream, for the record.
    pub events: Vec<EventKind>,
}

impl Default for EmgStageOutput {
    /// Before the first word: a relaxed hand, and nothing that died.
    fn default() -> Self {
        Self {
            gesture: Gesture::NoMotion,
            recognised: GestureName::default(),
            decision: None,
            message: None,
            decided_at: None,
            confidence: 0.0,
            effort: 0.0,
            fault: None,
            armed: true,
            events: Vec::new(),
        }
    }
}

impl EmgStage {
    /// The stage of a trial; without a classifier, or settings for one, gestures are given directly.
    ///
    /// # Errors
    /// Settings that do not fit the classifier, or a table of commands that does not fit its gestures.
    pub fn new(config: &TrialConfig, classifier: Option<Classifier>) -> Result<Self, TestbedError> {
        let muscles = match (&config.emg, classifier) {
            (Some(emg), Some(classifier)) => {
                let commands = config.gesture_commands(emg.rest, &classifier)?;
                Some((EmgPipeline::new(emg, classifier)?.with_centring(&config.emg_centring)?, commands))
            }
            _ => None,
        };
        let recognised =
            config.emg.as_ref().filter(|_| muscles.is_some()).map_or_else(Default::default, |emg| emg.rest);
        Ok(Self { muscles, given: None, recognised, confidence: 0.0, effort: 0.0, decided_at: None })
    }

    /// The gestures that are told apart, in the order of [`EmgOutput::posterior`]; none when gestures are given directly.
    pub fn gestures(&self) -> &[GestureName] {
        self.muscles.as_ref().map_or(&[], |(pipeline, _)| pipeline.gestures())
    }

    /// One tick, with no samples too: time alone makes a stream stale.
    pub fn step(&mut self, now: SimTime, input: EmgStageInput<'_>) -> EmgStageOutput {
        let mut output = EmgStageOutput::default();
        let mut acts = None;
        if let Some((pipeline, commands)) = &mut self.muscles {
            output.decision = pipeline.step(now, input.samples);
            let counts = pipeline.events().counts;
            let (gaps, unusable_samples) = (counts.gaps, counts.unusable_samples);
            let rejected_windows = counts.rejected_windows;
            if gaps + unusable_samples + rejected_windows > 0 {
                output.events.push(EventKind::EmgGap { gaps, unusable_samples, rejected_windows });
            }
            output.fault = pipeline.fault().map(|fault| (fault.cause(), fault.to_string()));
            output.armed = !pipeline.is_disarmed();
            if let Some(decision) = &output.decision {
                self.recognised = decision.gesture;
                output.message = decision.published.then(|| commands.command(decision.gesture));
            }
            acts = Some(commands.command(self.recognised));
        }
        if let Some(decision) = &output.decision {
            self.decided_at = Some(now);
            (self.confidence, self.effort) = (decision.confidence, decision.effort);
        }
        if input.gesture.is_some() {
            self.given = input.gesture;
            (self.confidence, self.effort) = (1.0, 1.0);
        }
        output.gesture = self.given.or(acts).unwrap_or_default();
        output.recognised = self.given.map_or(self.recognised, GestureName::from);
        output.decided_at = self.decided_at;
        (output.confidence, output.effort) = (self.confidence, self.effort);
        output
    }
}
