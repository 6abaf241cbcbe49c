use crate::{ChannelValues, DeviceError, Recordings, SyntheticEmg, stream};
use arrayvec::ArrayVec;
use proact_types::{EmgSample, Gesture, SimTime};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

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
    next: u64,
    /// Repetitions to feed, in [`Gesture::ALL`] order.
    recorded: [Vec<Vec<ChannelValues>>; 5],
    synthetic: Option<SyntheticEmg>,
    rng: ChaCha8Rng,
    intended: Option<Gesture>,
    /// Repetition and sample to be fed next.
    at: (usize, usize),
}

impl EmgFeed {
    /// A feed of repetitions `reps` of all recorded gestures, and of `synthetic` for the others. Choices are drawn
    /// from the stream `emg/feed` of `seed`.
    ///
    /// # Errors
    /// No repetitions, one that does not exist, or a gesture that neither has.
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
        if reps.is_empty() && !recordings.items.is_empty() {
            return Err(DeviceError::NoRepetitions { purpose: "feed" });
        }
        let mut recorded: [Vec<Vec<ChannelValues>>; 5] = Default::default();
        for gesture in recordings.gestures() {
            for &rep in reps {
                recorded[gesture.index()].push(recordings.find(gesture, rep)?.samples.clone());
            }
        }
        Ok(EmgFeed {
            rate_hz: recordings.rate_hz,
            next: 0,
            recorded,
            synthetic,
            rng: stream(seed, "emg/feed"),
            intended: None,
            at: (0, 0),
        })
    }

    /// Samples per second.
    pub fn rate_hz(&self) -> f64 {
        self.rate_hz
    }

    /// The samples that arrive in the tick `now` of a person who makes `intended`, oldest first. Call it every
    /// tick: when more than eight samples are due, the older ones are lost and leave a gap in the counter.
    /// Does not allocate.
    pub fn sample_at(&mut self, now: SimTime, intended: Gesture) -> ArrayVec<EmgSample, 8> {
        let mut samples = ArrayVec::new();
        // Counted from the start, so that rates that do not divide 1000 do not drift. The small share makes a
        // product that should be whole, such as 3 ticks at 333.333.. Hz, not fall below.
        let due = (now.0 as f64 * self.rate_hz / 1000.0 + 1e-9).floor() as u64 + 1;
        if due <= self.next {
            return samples;
        }
        self.next = self.next.max(due.saturating_sub(samples.capacity() as u64));
        self.turn_to(intended);
        while self.next < due {
            let channels = self.next_values(intended);
            samples.push(EmgSample { counter: self.next, channels });
            self.next += 1;
        }
        samples
    }

    /// Chooses where a new intention begins.
    fn turn_to(&mut self, intended: Gesture) {
        if self.intended == Some(intended) {
            return;
        }
        self.intended = Some(intended);
        let repetitions = &self.recorded[intended.index()];
        if !repetitions.is_empty() {
            let repetition = self.rng.random_range(0..repetitions.len());
            let half = repetitions[repetition].len().div_ceil(2);
            self.at = (repetition, self.rng.random_range(0..half));
        }
    }

    fn next_values(&mut self, intended: Gesture) -> ChannelValues {
        let repetitions = &self.recorded[intended.index()];
        let (repetition, sample) = self.at;
        match (repetitions.get(repetition).and_then(|r| r.get(sample)), &mut self.synthetic) {
            (Some(values), _) => {
                self.at = if sample + 1 < repetitions[repetition].len() {
                    (repetition, sample + 1)
                } else {
                    ((repetition + 1) % repetitions.len(), 0)
                };
                values.clone()
            }
            (None, Some(synthetic)) => synthetic.next(intended),
            // The constructor leaves no gesture without a source.
            (None, None) => ChannelValues::new(),
        }
    }
}
