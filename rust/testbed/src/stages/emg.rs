use crate::{TestbedError, TrialConfig};
use proact_control::{ControlError, Simultaneous};
use proact_emg::{Classifier, DecoderProcess, EmgOutput, EmgPipeline};
use proact_types::{
    Command, CommandMap, DegreeOfFreedom, Drives, EmgSample, EventKind, Gesture, SimTime, StopCause,
    WindowAnswer,
};

/// From muscle, or from keys, to the gesture in force, and the command that it is to the method.
pub struct EmgStage {
    /// None when gestures are given directly.
    pipeline: Option<(EmgPipeline, CommandMap)>,
    direct_command: Option<Command>,
    recognized_gesture: Gesture,
    confidence: f64,
    effort: f64,
    decided_at: Option<SimTime>,
    /// Degrees of freedom of the profile, each with its place in the model; empty where gestures alone act.
    dof_indices: Vec<(DegreeOfFreedom, usize)>,
    drives: Drives,
}

/// What enters the EMG stage in one tick.
#[derive(Clone, Copy, Debug, Default)]
pub struct EmgStageInput<'a> {
    /// Samples that arrived, oldest first.
    pub samples: &'a [EmgSample],
    /// A gesture given directly, in force until the next one. Overrides the classifier.
    pub direct_command: Option<Command>,
    /// What the input log has of a process that decodes; empty live.
    pub answers: &'a [WindowAnswer],
}

/// What the EMG stage says in one tick.
#[derive(Clone, Debug, PartialEq)]
pub struct EmgStageOutput {
    /// The command in force.
    pub command: Command,
    /// The gesture that gives it, as the model calls it; that of the command's name when it is given directly.
    pub recognized_gesture: Gesture,
    /// A window of EMG ended in this tick, or the stream became stale.
    pub decision: Option<Box<EmgOutput>>,
    /// The command that goes out as a message in this tick, for methods that act on messages.
    pub published_command: Option<Command>,
    /// When there was a decision last; none when gestures are given directly.
    pub decided_at: Option<SimTime>,
    /// Probability of the recognised class, 0 to 1; one for a gesture given directly.
    pub confidence: f64,
    /// How hard it is made, 0 to 1; one for a gesture given directly.
    pub effort: f64,
    /// Drive of each degree of freedom of the profile's `jog.simultaneous.drives`, in their order, -1 to 1; empty without that
    /// setting. All zero while the stream is stale, until a relaxed hand was seen after that, and while windows are spoilt;
    /// a gesture given directly is a whole drive.
    pub drives: Drives,
    /// Why the stream is dead, and that as a sentence; none while it lives.
    pub fault: Option<(StopCause, String)>,
    /// Gestures pass: no relaxed hand is waited for.
    pub armed: bool,
    /// A gesture is given directly, so that what the EMG says is not used: its stream may die.
    pub overridden: bool,
    /// What befell the stream, for the record.
    pub events: Vec<EventKind>,
    /// What a process that decodes said of the windows that ended.
    pub answers: Vec<WindowAnswer>,
}

impl Default for EmgStageOutput {
    /// Before the first word: a relaxed hand, and nothing that died.
    fn default() -> Self {
        Self {
            command: Command::NoMotion,
            recognized_gesture: Gesture::default(),
            decision: None,
            published_command: None,
            decided_at: None,
            confidence: 0.0,
            effort: 0.0,
            drives: Drives::new(),
            fault: None,
            armed: true,
            overridden: false,
            events: Vec::new(),
            answers: Vec::new(),
        }
    }
}

impl EmgStage {
    /// The stage of a trial; without a classifier, or settings for one, gestures are given directly.
    ///
    /// # Errors
    /// Settings that do not fit the classifier, a table of commands that does not fit its gestures, or a regressor and the
    /// profile's `jog.simultaneous` that do not go together.
    pub fn new(config: &TrialConfig, classifier: Option<Classifier>) -> Result<Self, TestbedError> {
        let simultaneous = config.profile.jog.simultaneous();
        let drive_indices = match &classifier {
            Some(classifier) => dof_indices(simultaneous, classifier)?,
            None => simultaneous.into_iter().flat_map(Simultaneous::degrees_of_freedom).zip(0..).collect(),
        };
        let muscles = match (&config.emg, classifier) {
            (Some(emg), Some(classifier)) => {
                let commands = config.command_map(emg.rest, &classifier)?;
                Some((EmgPipeline::new(emg, classifier)?.with_dc_offset(&config.emg_dc_offset)?, commands))
            }
            _ => None,
        };
        let recognized =
            config.emg.as_ref().filter(|_| muscles.is_some()).map_or_else(Default::default, |emg| emg.rest);
        let drives = drive_indices.iter().map(|_| 0.0).collect();
        let (confidence, effort) = (0.0, 0.0);
        Ok(Self {
            pipeline: muscles,
            direct_command: None,
            recognized_gesture: recognized,
            confidence,
            effort,
            decided_at: None,
            dof_indices: drive_indices,
            drives,
        })
    }

    /// The same stage, whose windows `decoder` decodes; none in a replay.
    pub fn with_decoder(mut self, decoder: Option<Box<dyn DecoderProcess>>) -> Self {
        self.pipeline = self.pipeline.map(|(pipeline, commands)| (pipeline.with_decoder(decoder), commands));
        self
    }

    /// The gestures that are told apart, in the order of [`EmgOutput::posterior`]; none when gestures are given directly.
    pub fn gestures(&self) -> &[Gesture] {
        self.pipeline.as_ref().map_or(&[], |(pipeline, _)| pipeline.gestures())
    }

    /// One tick, with no samples too: time alone makes a stream stale.
    pub fn step(&mut self, now: SimTime, input: EmgStageInput<'_>) -> EmgStageOutput {
        let mut output = EmgStageOutput::default();
        let mut acts = None;
        if let Some((pipeline, commands)) = &mut self.pipeline {
            output.decision = pipeline.step_with_answers(now, input.samples, input.answers).map(Box::new);
            output.answers = pipeline.answers().to_vec();
            let counts = pipeline.events().counts;
            let (gaps, unusable_samples) = (counts.gaps, counts.unusable_samples);
            let rejected_windows = counts.rejected_windows;
            if gaps + unusable_samples + rejected_windows > 0 {
                output.events.push(EventKind::EmgGap { gaps, unusable_samples, rejected_windows });
            }
            output.fault = pipeline.stale_cause();
            output.armed = !pipeline.is_disarmed();
            // Whatever a window says that came in the same tick: of another nobody knows what the hand did.
            let spoilt =
                rejected_windows > 0 || pipeline.is_undecided() || !output.armed || output.fault.is_some();
            if let Some(decision) = &output.decision {
                let drive =
                    |(_, drive_index): &(DegreeOfFreedom, usize)| decision.drives.get(*drive_index).copied();
                self.drives =
                    self.dof_indices.iter().map(|drive_index| drive(drive_index).unwrap_or(0.0)).collect();
            }
            if spoilt {
                self.drives.iter_mut().for_each(|drive| *drive = 0.0);
            }
            if let Some(decision) = &output.decision {
                self.recognized_gesture = decision.gesture;
                output.published_command = decision.published.then(|| commands.command(decision.gesture));
            }
            acts = Some(commands.command(self.recognized_gesture));
        }
        if let Some(decision) = &output.decision {
            self.decided_at = Some(now);
            (self.confidence, self.effort) = (decision.confidence, decision.effort);
        }
        if input.direct_command.is_some() {
            self.direct_command = input.direct_command;
            (self.confidence, self.effort) = (1.0, 1.0);
        }
        if let Some(given) = self.direct_command {
            (output.fault, output.armed, output.overridden) = (None, true, true);
            self.drives = self.dof_indices.iter().map(|(drive, _)| drive.target(given.into())).collect();
        }
        output.drives = self.drives.clone();
        output.command = self.direct_command.or(acts).unwrap_or_default();
        output.recognized_gesture = self.direct_command.map_or(self.recognized_gesture, Gesture::from);
        output.decided_at = self.decided_at;
        (output.confidence, output.effort) = (self.confidence, self.effort);
        output
    }
}

/// The degrees of freedom of the profile, each with its place in the model.
///
/// # Errors
/// A regressor without the setting, a classifier with it, or other degrees of freedom than the model has.
fn dof_indices(
    simultaneous: Option<&Simultaneous>,
    classifier: &Classifier,
) -> Result<Vec<(DegreeOfFreedom, usize)>, ControlError> {
    let known = classifier.degrees_of_freedom();
    let list = |drives: &mut dyn Iterator<Item = DegreeOfFreedom>| {
        drives.map(|drive| format!("\"{drive}\"")).collect::<Vec<_>>().join(", ")
    };
    let (model, kind) = (list(&mut known.iter().copied()), classifier.kind());
    let refused = |reason| Err(ControlError::Drives { reason });
    match (simultaneous, known) {
        (None, []) => Ok(Vec::new()),
        (None, _) => refused(format!(
            "the EMG model ({kind}) drives {model}, and nothing says what they move: set jog.simultaneous.drives, for each a \
             joint (method A), x to z or rx to rz (method B) or hand, or train a classifier, such as lda"
        )),
        (Some(_), []) => refused(format!(
            "jog.simultaneous is set, but the EMG model ({kind}) tells gestures apart and drives nothing: leave the setting \
             out, or train with --classifier linear or ridge"
        )),
        (Some(profile), known) => {
            let requested: Vec<DegreeOfFreedom> = profile.degrees_of_freedom().collect();
            let find_drive = |drive: &DegreeOfFreedom| Some((*drive, known.iter().position(|k| k == drive)?));
            let drive_indices: Option<Vec<_>> = requested.iter().map(find_drive).collect();
            match drive_indices.filter(|drive_indices| drive_indices.len() == known.len()) {
                Some(drive_indices) => Ok(drive_indices),
                None => refused(format!(
                    "jog.simultaneous.drives has {}, the EMG model {model}: expected the same",
                    list(&mut requested.into_iter())
                )),
            }
        }
    }
}
