use crate::{DeviceError, Recordings, SyntheticEmg, random_stream};
use proact_emg::{ClassifierKind, EmgConfig};
use proact_types::{ChannelValues, Command, CommandMap, EmgSample, Gesture, MAX_TICK_SAMPLES, SimTime};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use std::collections::BTreeMap;

/// What the armband sends while a person makes the gestures that they intend.
///
/// Sample n is due at n / rate. It comes from the recordings of the intended gesture: at each change of intention
/// from a seeded place in the first half of a seeded repetition, then onwards, from the end of one repetition to
/// the start of the next. A change takes effect with the next sample: delays of the person are the participant's.
/// Gestures without recordings come from the synthetic generator.
///
/// Known weakness: a recorded gesture begins at full strength; the transition is a cut, so one window holds both.
#[derive(Clone, Debug)]
pub struct EmgFeed {
    rate_hz: f64,
    /// Counter of the next sample.
    next_counter: u64,
    /// Gestures that were recorded, and their repetitions to feed.
    recorded: Vec<(Gesture, Vec<Vec<ChannelValues>>)>,
    /// What the person makes to give a command.
    commands: CommandMap,
    synthetic: Option<SyntheticEmg>,
    rng: ChaCha8Rng,
    intended: Option<SampleOrigin>,
    /// Repetition and sample to be fed next.
    position: (usize, usize),
}

/// Where the samples of a gesture come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum SampleOrigin {
    /// The place among those that were recorded.
    Recorded(usize),
    /// The generator.
    Synthetic(Command),
    /// Nobody can make it.
    Unavailable,
}

impl EmgFeed {
    /// A feed of repetitions `reps` of all recorded gestures, and of `synthetic` for the others. Choices are drawn
    /// from the stream `emg/feed` of `seed`.
    ///
    /// # Errors
    /// No repetitions, one that does not exist, or a gesture that neither has; the generator makes the five alone.
    pub fn new(
        recordings: &Recordings,
        reps: &[u32],
        synthetic: Option<SyntheticEmg>,
        seed: u64,
    ) -> Result<EmgFeed, DeviceError> {
        let missing = recordings.missing();
        if synthetic.is_none() && !missing.is_empty() {
            return Err(DeviceError::MissingGestures { path: recordings.path.clone(), missing });
        }
        check_synthesizable(recordings)?;
        if reps.is_empty() && !recordings.items.is_empty() {
            return Err(DeviceError::NoRepetitions { purpose: "feed" });
        }
        let mut recorded = Vec::new();
        for gesture in recordings.gestures() {
            let samples = |rep: &u32| Ok(recordings.find(gesture, *rep)?.samples.clone());
            recorded.push((gesture, reps.iter().map(samples).collect::<Result<_, DeviceError>>()?));
        }
        let known: Vec<Gesture> = recordings.gestures().into_iter().chain(recordings.missing()).collect();
        let commands = CommandMap::new(&known, recordings.rest, &BTreeMap::new())?;
        Ok(EmgFeed {
            rate_hz: recordings.rate_hz,
            next_counter: 0,
            recorded,
            commands,
            synthetic,
            rng: random_stream(seed, "emg/feed"),
            intended: None,
            position: (0, 0),
        })
    }

    /// Samples per second.
    pub fn rate_hz(&self) -> f64 {
        self.rate_hz
    }

    /// The same feed of a person who gives commands by other gestures than those of their names.
    pub fn with_commands(mut self, commands: CommandMap) -> EmgFeed {
        self.commands = commands;
        self
    }

    /// The same feed of a person who co-contracts the muscles of two sites where `config` has direct control by these. Only the
    /// generator can: with recordings of the switching gesture, these are fed.
    ///
    /// # Errors
    /// Figures whose sum is no covariance.
    pub(crate) fn with_cocontraction_of(mut self, config: &EmgConfig) -> Result<EmgFeed, DeviceError> {
        let sites = &config.two_site;
        let names = [sites.switch_gesture, sites.pair.positive(), sites.pair.negative()]
            .map(Gesture::same_named_command);
        let (ClassifierKind::TwoSite, [Some(switch), Some(a), Some(b)]) = (config.classifier, names) else {
            return Ok(self);
        };
        let synthetic = self.synthetic.take();
        self.synthetic = synthetic.map(|made| made.with_cocontraction(switch, [a, b])).transpose()?;
        Ok(self)
    }

    /// What the person makes to give `command`.
    pub fn gesture_for(&self, command: Command) -> Gesture {
        self.commands.gesture_for(command)
    }

    /// The samples that arrive in the tick `now` of a person who makes `intended`, oldest first. Call it every
    /// tick: when more than eight samples are due, the older ones are lost and leave a gap in the counter.
    pub fn sample_at(&mut self, now: SimTime, intended: impl Into<Gesture>) -> Vec<EmgSample> {
        let mut samples = Vec::new();
        // Counted from the start, so that rates that do not divide 1000 do not drift. The small share makes a
        // product that should be whole, such as 3 ticks at 333.333.. Hz, not fall below.
        let due = (now.0 as f64 * self.rate_hz / 1000.0 + 1e-9).floor() as u64 + 1;
        if due <= self.next_counter {
            return samples;
        }
        self.next_counter = self.next_counter.max(due.saturating_sub(MAX_TICK_SAMPLES as u64));
        let made = self.origin_of(intended.into());
        self.begin_gesture(made);
        while self.next_counter < due {
            let channels = self.next_values(made);
            samples.push(EmgSample { counter: self.next_counter, channels });
            self.next_counter += 1;
        }
        samples
    }

    /// Where the samples of `gesture` come from; a gesture that is nowhere is made as rest.
    fn origin_of(&self, gesture: Gesture) -> SampleOrigin {
        let source = |gesture: Gesture| match self.recorded.binary_search_by_key(&gesture, |(of, _)| *of) {
            Ok(recorded_index) => Some(SampleOrigin::Recorded(recorded_index)),
            Err(_) => {
                gesture.same_named_command().filter(|_| self.synthetic.is_some()).map(SampleOrigin::Synthetic)
            }
        };
        source(gesture)
            .or_else(|| source(self.commands.gesture_for(Command::NoMotion)))
            .unwrap_or(SampleOrigin::Unavailable)
    }

    /// Chooses where a new intention begins.
    fn begin_gesture(&mut self, intended: SampleOrigin) {
        if self.intended == Some(intended) {
            return;
        }
        self.intended = Some(intended);
        if let SampleOrigin::Recorded(recorded_index) = intended {
            let repetitions = &self.recorded[recorded_index].1;
            let repetition = self.rng.random_range(0..repetitions.len());
            let half = repetitions[repetition].len().div_ceil(2);
            self.position = (repetition, self.rng.random_range(0..half));
        }
    }

    fn next_values(&mut self, intended: SampleOrigin) -> ChannelValues {
        match (intended, &mut self.synthetic) {
            (SampleOrigin::Recorded(recorded_index), _) => {
                let repetitions = &self.recorded[recorded_index].1;
                let (repetition, sample) = self.position;
                let values = repetitions[repetition][sample].clone();
                self.position = if sample + 1 < repetitions[repetition].len() {
                    (repetition, sample + 1)
                } else {
                    ((repetition + 1) % repetitions.len(), 0)
                };
                values
            }
            (SampleOrigin::Synthetic(gesture), Some(synthetic)) => synthetic.next(gesture),
            // The constructor leaves no feed without a source.
            _ => ChannelValues::new(),
        }
    }
}

/// Whether the generator could make what is missing.
///
/// # Errors
/// [`DeviceError::NotSynthesizable`] for what it could not.
pub(crate) fn check_synthesizable(recordings: &Recordings) -> Result<(), DeviceError> {
    let missing: Vec<Gesture> =
        recordings.missing().into_iter().filter(|gesture| gesture.same_named_command().is_none()).collect();
    if missing.is_empty() {
        return Ok(());
    }
    Err(DeviceError::NotSynthesizable { path: recordings.path.clone(), missing })
}
