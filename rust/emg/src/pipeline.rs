use crate::drives::DriveFilter;
use crate::filter::FilterBank;
use crate::two_site::SiteSwitch;
use crate::{
    ClassPosterior, Classifier, Decision, DecisionRule, EmgConfig, EmgError, FeatureExtractor, FeatureVector,
    Liveness, MajorityVote, SignalFault, SlidingWindow, StreamCounts,
};
use proact_types::{ChannelValues, DegreeOfFreedom, Drives, EmgSample, GestureName, SimTime};

/// What the EMG stage says at the end of a window, or when the stream became stale.
#[derive(Clone, Debug, PartialEq)]
pub struct EmgOutput {
    /// The gesture in force.
    pub gesture: GestureName,
    /// Its place in [`Classifier::gestures`].
    pub place: usize,
    /// A message goes out: see [`crate::RuleKind`].
    pub published: bool,
    /// The class of the newest window alone; rest when stale.
    pub window_class: GestureName,
    /// Probability of each gesture in the order of [`Classifier::gestures`]; all zero when stale.
    pub posterior: ClassPosterior,
    /// Probability of `window_class`; zero when stale.
    pub confidence: f64,
    /// What went to the decision rule: `window_class`, none if it was rejected, or the winner of the majority vote.
    /// None when stale.
    pub class: Option<GestureName>,
    /// How hard `class` is performed, 0 to 1; zero for rest, when rejected and when stale.
    pub effort: f64,
    /// Drive of each of [`EmgPipeline::degrees_of_freedom`], -1 to 1, smoothed and zero within the dead band; all zero when
    /// stale, in a window with bridged samples, and until a relaxed hand is seen after a silence. Empty of a classifier.
    pub drives: Drives,
    /// No window came for longer than the allowed age.
    pub stale: bool,
}

/// What befell the stream in one step, for the record.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StreamEvents {
    /// Gaps, windows that they spoilt, unusable samples and so on in this step.
    pub counts: StreamCounts,
    /// The stream became stale.
    pub stale: bool,
    /// A relaxed hand was seen after a silence: gestures act again.
    pub rearmed: bool,
}

impl StreamEvents {
    /// Whether there is anything to record.
    pub fn is_eventful(&self) -> bool {
        *self
            != StreamEvents {
                counts: StreamCounts { windows: self.counts.windows, ..Default::default() },
                ..Default::default()
            }
    }
}

/// The whole EMG stage for a live stream.
#[derive(Clone, Debug)]
pub struct EmgPipeline {
    features: FeatureExtractor,
    rejection: Option<f64>,
    vote: Option<MajorityVote>,
    events: StreamEvents,
    liveness: Liveness,
    filters: FilterBank,
    window: SlidingWindow,
    classifier: Classifier,
    rest: GestureName,
    rule: DecisionRule,
    drives: DriveFilter,
    switch: SiteSwitch,
    overflows: u64,
    /// Of the newest window.
    newest: FeatureVector,
    /// Subtracted from each channel; empty for a stream that is centred.
    centring: ChannelValues,
    /// The newest sample less those, then filtered.
    prepared: EmgSample,
}

impl EmgPipeline {
    /// A pipeline at the start of a stream.
    ///
    /// # Errors
    /// Settings that cannot work, a classifier that was trained on another number of channels, or one that does not know
    /// the rest gesture of the settings.
    pub fn new(config: &EmgConfig, classifier: Classifier) -> Result<Self, EmgError> {
        if classifier.channels() != config.channels {
            return Err(EmgError::ClassifierChannels {
                trained: classifier.channels(),
                stream: config.channels,
            });
        }
        // It may come from a file that someone edited.
        if !classifier.is_sound() {
            return Err(EmgError::ModelFile {
                reason: "lengths or values of the classifier are wrong".to_owned(),
            });
        }
        if classifier.place(config.rest).is_err() {
            return Err(EmgError::NoRest { rest: config.rest, known: classifier.gestures().to_vec() });
        }
        let (got, expected) = (
            classifier.feature_count(),
            classifier.features().layout(config.channels, config.rate_hz).count(),
        );
        if got != expected {
            return Err(EmgError::FeatureCount { got, expected });
        }
        let (asked, trained) = (config.classifier, classifier.kind());
        // Settings that say more than a classifier's own are those of the other kinds.
        if asked != trained && !(asked.has_posterior() && trained.has_posterior()) {
            return Err(EmgError::OtherDecoder { asked, trained });
        }
        let classifier = classifier.with_dead_band(config.regression.dead_band);
        // The classifier knows its features, whatever the settings say.
        let config = &EmgConfig { features: classifier.features(), ..config.clone() };
        Ok(EmgPipeline {
            features: FeatureExtractor::new(config)?,
            rejection: config.rejection,
            vote: config.majority.map(MajorityVote::new),
            events: StreamEvents::default(),
            filters: FilterBank::new(&config.filters, config.rate_hz, config.channels)?,
            liveness: Liveness::new(&config.liveness, config.rate_hz, config.channels)?,
            window: SlidingWindow::new(config)?,
            rule: DecisionRule::new(config),
            switch: SiteSwitch::new(&config.two_site),
            drives: DriveFilter::new(config, classifier.degrees_of_freedom().len())?,
            rest: config.rest,
            newest: FeatureVector::with_capacity(classifier.layout().count()),
            classifier,
            overflows: 0,
            centring: ChannelValues::new(),
            prepared: EmgSample { counter: 0, channels: ChannelValues::new() },
        })
    }

    /// The same pipeline for raw codes: `levels`, one a channel, are subtracted first. None for a centred stream.
    ///
    /// # Errors
    /// [`EmgError::Centring`] for another number of levels, or one that is not finite.
    pub fn with_centring(mut self, levels: &[f64]) -> Result<Self, EmgError> {
        let expected = self.classifier.channels();
        let fits = levels.is_empty() || levels.len() == expected;
        if !fits || !levels.iter().all(|level| level.is_finite()) {
            return Err(EmgError::Centring { got: levels.len(), expected });
        }
        self.centring = levels.iter().copied().collect();
        self.liveness.set_centring(levels);
        Ok(self)
    }

    /// Takes the samples that arrived at `now`, oldest first. Some if a window ended with one of them, or if the
    /// stream became stale now, by silence or because its samples are not those of a living arm ([`Liveness`]); if several windows ended, the decision rule saw them all and the newest is
    /// returned. Call it every tick, with no samples too. Does not allocate.
    pub fn step(&mut self, now: SimTime, samples: &[EmgSample]) -> Option<EmgOutput> {
        let (before, disarmed) = (self.counts(), self.rule.is_disarmed());
        let mut output = None;
        self.liveness.begin_tick(now);
        for sample in samples {
            let changed = !(self.centring.is_empty() && self.filters.is_empty());
            if changed {
                // Of many channels, too, no memory is asked for.
                let prepared = &mut self.prepared;
                prepared.counter = sample.counter;
                prepared.channels.clear();
                prepared.channels.extend_from_slice(&sample.channels);
                prepared.channels.iter_mut().zip(&self.centring).for_each(|(value, zero)| *value -= zero);
            }
            let level = if changed { &self.prepared } else { sample };
            if !self.liveness.push(level) {
                self.window.spoil();
                output = self.rule.fail().map(|decision| self.stale(decision)).or(output);
            }
            if !self.filters.is_empty() {
                self.filters.apply(&mut self.prepared);
            }
            let filtered = if changed { &self.prepared } else { sample };
            let Some(window) = self.window.push(filtered) else { continue };
            let features = self.features.compute(&window);
            // Finite samples whose sums overflow: as good as no window.
            let Ok(prediction) = self.classifier.predict(features) else {
                self.overflows += 1;
                continue;
            };
            let bridged = window.bridged() > 0;
            // Nothing is learnt from samples that nobody measured.
            self.newest.clear();
            if !bridged {
                self.newest.extend_from_slice(features);
            }
            let confidence = prediction.confidence();
            // A rejection needs more than the threshold: LibEMG compares strictly.
            let kept = self.rejection.is_none_or(|threshold| confidence > threshold);
            let direct = self.classifier.direct(&mut self.switch, now, features);
            let mut class = direct.map_or_else(|| kept.then_some(prediction.class), |(class, _)| Some(class));
            if let Some(vote) = self.vote.as_mut().filter(|_| !bridged) {
                class = vote.push(class);
            }
            let decision = match class {
                class if bridged => self.rule.bridged(now, class),
                Some(class) => match self.rule.step(now, Some(class)) {
                    Some(decision) => decision,
                    None => continue,
                },
                None => self.rule.reject(now),
            };
            // Nobody knows what the hand does, or it may have been so all through a silence.
            let drives = if bridged || self.rule.is_disarmed() {
                self.drives.rest()
            } else {
                self.drives.step(&prediction.drives)
            };
            let effort = match class {
                _ if !drives.is_empty() => drives.iter().fold(0.0, |most: f64, drive| most.max(drive.abs())),
                _ if direct.is_some() => direct.map_or(0.0, |(_, effort)| effort),
                Some(class) if class != self.rest => {
                    self.classifier.effort_of(class, window.amplitude()).unwrap_or(0.0)
                }
                _ => 0.0,
            };
            output = Some(EmgOutput {
                gesture: decision.gesture,
                place: self.classifier.place(decision.gesture).unwrap_or_default(),
                published: decision.published,
                window_class: prediction.class,
                posterior: prediction.posterior,
                confidence,
                class,
                effort,
                drives,
                stale: false,
            });
        }
        if output.is_none() {
            output = self.rule.step(now, None).map(|decision| self.stale(decision));
        }
        if let (Some(EmgOutput { stale: true, .. }), Some(vote)) = (&output, &mut self.vote) {
            // Votes from before a silence say nothing about the hand now.
            vote.clear();
        }
        if output.as_ref().is_some_and(|output| output.stale) {
            self.drives.rest();
            self.switch.clear();
        }
        self.events = StreamEvents {
            counts: self.counts().since(before),
            // A silence that ended within this step disarms too.
            stale: output.as_ref().is_some_and(|o| o.stale) || (!disarmed && self.rule.is_disarmed()),
            rearmed: disarmed && !self.rule.is_disarmed(),
        };
        output
    }

    /// Features of the newest window that was classified, for [`crate::Adaptation::confirm`]; empty before the first, and
    /// if samples of it were lost.
    pub fn features(&self) -> &[f64] {
        &self.newest
    }

    /// The gestures that are told apart, in the order of [`EmgOutput::posterior`].
    pub fn gestures(&self) -> &[GestureName] {
        self.classifier.gestures()
    }

    /// The degrees of freedom, in the order of [`EmgOutput::drives`]; none of a classifier.
    pub fn degrees_of_freedom(&self) -> &[DegreeOfFreedom] {
        self.classifier.degrees_of_freedom()
    }

    /// Goes on with another classifier of the same features and channels, as adaptation makes them.
    ///
    /// # Errors
    /// If features or channels differ; the classifier in use stays.
    pub fn set_classifier(&mut self, classifier: Classifier) -> Result<(), EmgError> {
        let stream = self.classifier.channels();
        if classifier.channels() != stream {
            return Err(EmgError::ClassifierChannels { trained: classifier.channels(), stream });
        }
        if classifier.features() != self.classifier.features() {
            return Err(EmgError::FeatureCount {
                got: classifier.feature_count(),
                expected: self.classifier.feature_count(),
            });
        }
        self.classifier = classifier;
        Ok(())
    }

    /// What is said when the stream became stale.
    fn stale(&self, decision: Decision) -> EmgOutput {
        EmgOutput {
            gesture: decision.gesture,
            place: self.classifier.place(decision.gesture).unwrap_or_default(),
            published: decision.published,
            window_class: self.rest,
            posterior: self.classifier.gestures().iter().map(|_| 0.0).collect(),
            confidence: 0.0,
            class: None,
            effort: 0.0,
            drives: self.classifier.degrees_of_freedom().iter().map(|_| 0.0).collect(),
            stale: decision.stale,
        }
    }

    /// Why the stream is stale; none while it is not.
    pub fn fault(&self) -> Option<SignalFault> {
        let silent = self.rule.is_stale().then_some(SignalFault::Silent);
        self.liveness.fault().or(silent)
    }

    /// True while gestures are held back until a relaxed hand is seen.
    pub fn is_disarmed(&self) -> bool {
        self.rule.is_disarmed()
    }

    /// What befell the stream in the newest step.
    pub fn events(&self) -> &StreamEvents {
        &self.events
    }

    /// Counters since the start.
    pub fn counts(&self) -> StreamCounts {
        let mut counts = self.window.counts();
        counts.windows -= self.overflows;
        counts.rejected_windows += self.overflows;
        counts
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::extract;
    use proact_types::Gesture;

    fn config() -> EmgConfig {
        EmgConfig { channels: 2, rate_hz: 200.0, ..EmgConfig::default() }
    }

    fn sample(counter: u64, amplitude: f64) -> EmgSample {
        let k = counter as f64;
        EmgSample { counter, channels: [amplitude * (k * 1.7).sin(), (k * 2.9).cos()].into_iter().collect() }
    }

    fn pipeline() -> EmgPipeline {
        let config = config();
        let mut windows = Vec::new();
        let mut labels = Vec::new();
        for (gesture, amplitude) in [(Gesture::NoMotion, 1.0), (Gesture::HandClose, 20.0)] {
            let samples: Vec<EmgSample> = (0..400).map(|k| sample(k, amplitude)).collect();
            windows.extend(extract(&config, &samples).expect("good samples"));
            labels.resize(windows.len(), gesture);
        }
        let classifier = Classifier::train(&config, &windows, &labels).expect("good data");
        EmgPipeline::new(&config, classifier).expect("they fit")
    }

    /// Runs `ticks` ticks from `from`; samples every 5 ms unless `lost`.
    fn run(
        pipeline: &mut EmgPipeline,
        from: u64,
        ticks: u64,
        amplitude: f64,
        lost: bool,
    ) -> Vec<(u64, EmgOutput)> {
        (from..from + ticks)
            .filter_map(|t| {
                let sample = (t % 5 == 0 && !lost).then(|| sample(t / 5, amplitude));
                pipeline.step(SimTime(t), sample.as_slice()).map(|out| (t, out))
            })
            .collect()
    }

    #[test]
    fn a_decision_belongs_to_the_tick_of_the_last_sample_of_its_window() {
        let times: Vec<u64> = run(&mut pipeline(), 0, 250, 1.0, false).iter().map(|(t, _)| *t).collect();
        assert_eq!(times, [95, 145, 195, 245]);
    }

    /// Mains a hundred times as strong as the muscle: nothing without the filter, nothing wrong with it; and live windows are those
    /// of the training.
    #[test]
    fn a_filter_takes_the_mains_out_of_training_and_stream_alike() {
        let hum = |k: u64| 2000.0 * (2.0 * std::f64::consts::PI * 50.0 * k as f64 / 200.0).sin();
        let spoilt = |k: u64, amplitude: f64| {
            let mut sample = sample(k, amplitude);
            sample.channels.iter_mut().for_each(|v| *v += hum(k));
            sample
        };
        let recording = |amplitude: f64| (0..400).map(|k| spoilt(k, amplitude)).collect::<Vec<_>>();
        let right = |filters: Vec<crate::EmgFilter>| {
            let config = EmgConfig { filters, ..config() };
            let (mut windows, mut labels) = (Vec::new(), Vec::new());
            for (gesture, amplitude) in [(Gesture::NoMotion, 1.0), (Gesture::HandClose, 20.0)] {
                windows.extend(extract(&config, &recording(amplitude)).expect("good samples"));
                labels.resize(windows.len(), gesture);
            }
            let classifier = Classifier::train(&config, &windows, &labels).expect("good data");
            let mut pipeline = EmgPipeline::new(&config, classifier).expect("they fit");
            let mut live = Vec::new();
            for sample in recording(1.0) {
                let output = pipeline.step(SimTime(5 * sample.counter), std::slice::from_ref(&sample));
                live.extend(output.map(|_| pipeline.features().to_vec()));
            }
            assert_eq!(live, windows[..live.len()], "live windows are those of the training");
            // The notch needs some tenths of a second to settle.
            live.last().map_or(f64::NAN, |window| window[0])
        };
        assert!(right(Vec::new()) > 1000.0);
        assert!(right(vec!["notch:50".parse().expect("written right")]) < 20.0);
    }

    #[test]
    fn a_drop_out_stops_the_arm_and_only_a_relaxed_hand_rearms_it() {
        let mut pipeline = pipeline();
        let before = run(&mut pipeline, 0, 400, 20.0, false);
        assert!(before.last().is_some_and(|(_, out)| out.gesture == Gesture::HandClose));

        assert!(!pipeline.events().is_eventful());
        let mut silenced = pipeline.clone();
        run(&mut silenced, 400, 197, 20.0, true);
        assert!(silenced.events().stale, "the last of these steps makes it stale");

        let silent = run(&mut pipeline, 400, 600, 20.0, true);
        assert_eq!(silent.len(), 1, "{silent:?}");
        let (at, out) = &silent[0];
        assert_eq!((*at, out.stale, out.gesture), (395 + 201, true, Gesture::NoMotion.into()));

        let held_through = run(&mut pipeline, 1000, 500, 20.0, false);
        assert!(held_through.iter().all(|(_, out)| out.gesture == Gesture::NoMotion), "{held_through:?}");
        assert_eq!(held_through.last().map(|(_, out)| out.window_class), Some(Gesture::HandClose.into()));
        assert_eq!(pipeline.counts().gaps, 1);
        assert!(!pipeline.events().is_eventful());

        run(&mut pipeline, 1500, 400, 1.0, false);
        let mut gapped = pipeline.clone();
        gapped.step(SimTime(1950), &[sample(390, 1.0)]);
        assert_eq!((gapped.events().counts.gaps, gapped.events().counts.rejected_windows), (1, 1));
        let rearmed = run(&mut pipeline, 1900, 400, 20.0, false);
        assert_eq!(rearmed.last().map(|(_, out)| out.gesture), Some(Gesture::HandClose.into()));
    }

    #[test]
    fn samples_that_overflow_the_sums_reject_the_window() {
        let mut pipeline = pipeline();
        let outputs = run(&mut pipeline, 0, 400, f64::MAX, false);
        assert!(outputs.iter().all(|(_, out)| out.stale), "{outputs:?}");
        assert_eq!((pipeline.counts().windows, pipeline.counts().rejected_windows), (0, 7));
    }

    #[test]
    fn raw_codes_less_their_zero_level_give_the_decisions_of_centred_samples() {
        let (mut centred, raw) = (pipeline(), pipeline());
        let levels = [128.0, -40.0];
        let mut raw = raw.with_centring(&levels).expect("one a channel");
        for t in 0..1000 {
            let sample = sample(t, if t < 500 { 1.0 } else { 20.0 });
            // Whole numbers, so that the shift loses no digits.
            let whole: Vec<f64> = sample.channels.iter().map(|v| v.round()).collect();
            let shifted = whole.iter().zip(levels).map(|(v, level)| v + level);
            let at = SimTime(5 * t);
            let ours = raw.step(at, &[EmgSample { counter: t, channels: shifted.collect() }]);
            let theirs =
                centred.step(at, &[EmgSample { counter: t, channels: whole.iter().copied().collect() }]);
            assert_eq!(ours, theirs);
        }
        let wrong = pipeline().with_centring(&[1.0]).map(|_| ()).expect_err("two channels");
        assert_eq!(wrong, EmgError::Centring { got: 1, expected: 2 });
        assert!(pipeline().with_centring(&[f64::NAN, 0.0]).is_err());
    }

    #[test]
    fn a_classifier_of_another_band_is_refused() {
        let classifier = pipeline().classifier;
        let error = EmgPipeline::new(&EmgConfig::default(), classifier).expect_err("8 channels");
        assert_eq!(error, EmgError::ClassifierChannels { trained: 2, stream: 8 });
    }
}
