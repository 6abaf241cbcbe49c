use crate::decoder_tap::{DecodeFailure, DecoderTap};
use crate::drives::DriveFilter;
use crate::filter::FilterBank;
use crate::two_site::CocontractionDetector;
use crate::{
    ClassPosterior, Classifier, Decision, DecisionRule, DecoderProcess, EmgConfig, EmgError,
    FeatureExtractor, FeatureVector, Liveness, MajorityVote, SignalFault, SlidingWindow, StreamCounts,
};
use proact_types::{
    ChannelValues, DegreeOfFreedom, Drives, EmgSample, Gesture, SimTime, StopCause, WindowAnswer,
};

/// What the EMG stage says at the end of a window, or when the stream became stale.
#[derive(Clone, Debug, PartialEq)]
pub struct EmgOutput {
    /// The gesture in force.
    pub gesture: Gesture,
    /// Its place in [`Classifier::gestures`].
    pub class_index: usize,
    /// A message goes out: see [`crate::PublishRule`].
    pub published: bool,
    /// The class of the newest window alone; rest when stale.
    pub window_class: Gesture,
    /// Probability of each gesture in the order of [`Classifier::gestures`]; all zero when stale.
    pub posterior: ClassPosterior,
    /// Probability of `window_class`; zero when stale.
    pub confidence: f64,
    /// What went to the decision rule: `window_class`, none if it was rejected, or the winner of the majority vote.
    /// None when stale.
    pub class: Option<Gesture>,
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
    rest: Gesture,
    rule: DecisionRule,
    drives: DriveFilter,
    tap: DecoderTap,
    switch: CocontractionDetector,
    overflows: u64,
    /// Of the newest window.
    newest: FeatureVector,
    /// Subtracted from each channel; empty for a stream that is centred.
    dc_offset: ChannelValues,
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
        if classifier.class_index(config.rest).is_err() {
            return Err(EmgError::NoRest { rest: config.rest, known: classifier.gestures().to_vec() });
        }
        let (got, expected) = (
            classifier.feature_count(),
            EmgConfig { features: classifier.features(), ..config.clone() }.layout().count(),
        );
        if got != expected {
            return Err(EmgError::FeatureCount { got, expected });
        }
        let (requested, trained) = (config.classifier, classifier.kind());
        // Settings that say more than a classifier's own are those of the other kinds.
        let alike = requested.has_posterior() && trained.has_posterior();
        if requested != trained && (requested.is_process() || trained.is_process() || !alike) {
            return Err(EmgError::ClassifierMismatch { requested, trained });
        }
        let classifier = classifier.with_dead_band(config.regression.dead_band);
        // The classifier knows its features, whatever the settings say.
        let config = &EmgConfig { features: classifier.features(), ..config.clone() };
        Ok(EmgPipeline {
            features: FeatureExtractor::new(config)?,
            rejection: config.rejection_threshold,
            vote: config.majority_vote_windows.map(MajorityVote::new),
            events: StreamEvents::default(),
            filters: FilterBank::new(&config.filters, config.rate_hz, config.channels)?,
            liveness: Liveness::new(&config.liveness, config.rate_hz, config.channels)?.with_imu(&config.imu),
            window: SlidingWindow::new(config)?,
            rule: DecisionRule::new(config),
            switch: CocontractionDetector::new(&config.two_site),
            tap: DecoderTap::new(config),
            drives: DriveFilter::new(config, classifier.degrees_of_freedom().len())?,
            rest: config.rest,
            newest: FeatureVector::with_capacity(classifier.layout().count()),
            classifier,
            overflows: 0,
            dc_offset: ChannelValues::new(),
            prepared: EmgSample { counter: 0, channels: ChannelValues::new() },
        })
    }

    /// The same pipeline for raw codes: `levels`, one a channel, are subtracted first. None for a centred stream.
    ///
    /// # Errors
    /// [`EmgError::DcOffsetCount`] for another number of levels, or one that is not finite.
    pub fn with_dc_offset(mut self, levels: &[f64]) -> Result<Self, EmgError> {
        let expected = self.classifier.channels();
        let fits = levels.is_empty() || levels.len() == expected;
        if !fits || !levels.iter().all(|level| level.is_finite()) {
            return Err(EmgError::DcOffsetCount { got: levels.len(), expected });
        }
        self.dc_offset = levels.iter().copied().collect();
        self.liveness.set_dc_offset(levels);
        Ok(self)
    }

    /// The same pipeline, whose windows `decoder` decodes; none where a log has the answers.
    pub fn with_decoder(mut self, decoder: Option<Box<dyn DecoderProcess>>) -> Self {
        self.tap.set_process(decoder);
        self
    }

    /// What a process that decodes said in the newest step.
    pub fn answers(&self) -> &[WindowAnswer] {
        self.tap.answers()
    }

    /// Whether a process that decodes gave no decision for a window of the newest step.
    pub fn is_undecided(&self) -> bool {
        self.tap.is_undecided()
    }

    /// Takes the samples that arrived at `now`, oldest first. Some if a window ended with one of them, or if the
    /// stream became stale now, by silence or because its samples are not those of a living arm ([`Liveness`]); if several windows ended, the decision rule saw them all and the newest is
    /// returned. Call it every tick, with no samples too. Does not allocate.
    pub fn step(&mut self, now: SimTime, samples: &[EmgSample]) -> Option<EmgOutput> {
        self.step_with_answers(now, samples, &[])
    }

    /// [`EmgPipeline::step`] with what the input log has of a process that decodes, which is not asked then.
    pub fn step_with_answers(
        &mut self,
        now: SimTime,
        samples: &[EmgSample],
        answers: &[WindowAnswer],
    ) -> Option<EmgOutput> {
        self.tap.begin(answers);
        let (before, disarmed) = (self.counts(), self.rule.is_disarmed());
        let mut output = None;
        self.liveness.begin_tick(now);
        for sample in samples {
            let changed = !(self.dc_offset.is_empty() && self.filters.is_empty());
            if changed {
                // Of many channels, too, no memory is asked for.
                let prepared = &mut self.prepared;
                prepared.counter = sample.counter;
                prepared.channels.clear();
                prepared.channels.extend_from_slice(&sample.channels);
                prepared.channels.iter_mut().zip(&self.dc_offset).for_each(|(value, zero)| *value -= zero);
            }
            let level = if changed { &self.prepared } else { sample };
            if !self.liveness.push(level) {
                self.window.invalidate();
                output = self.rule.mark_stale().map(|decision| self.stale_output(decision)).or(output);
            }
            if !self.filters.is_empty() {
                self.filters.apply(&mut self.prepared);
            }
            let filtered = if changed { &self.prepared } else { sample };
            let Some(window) = self.window.push(filtered) else { continue };
            let features = self.features.compute(&window);
            let prediction = if self.classifier.kind().is_process() {
                match self.tap.decode(now, &window, features, &self.classifier) {
                    Ok(prediction) => prediction,
                    // As good as no window; several of them make a silence.
                    Err(DecodeFailure::Late) => continue,
                    Err(DecodeFailure::Failed) => {
                        output =
                            self.rule.mark_stale().map(|decision| self.stale_output(decision)).or(output);
                        continue;
                    }
                }
            } else {
                // Finite samples whose sums overflow: as good as no window.
                let Ok(prediction) = self.classifier.predict(features) else {
                    self.overflows += 1;
                    continue;
                };
                prediction
            };
            let bridged = window.interpolated() > 0;
            // Nothing is learnt from samples that nobody measured.
            self.newest.clear();
            if !bridged {
                self.newest.extend_from_slice(features);
            }
            let confidence = prediction.confidence();
            // A rejection needs more than the threshold: LibEMG compares strictly.
            let kept = self.rejection.is_none_or(|threshold| confidence > threshold);
            let direct = self.classifier.two_site_command(&mut self.switch, now, features);
            let mut class = direct.map_or_else(|| kept.then_some(prediction.class), |(class, _)| Some(class));
            if let Some(vote) = self.vote.as_mut().filter(|_| !bridged) {
                class = vote.push(class);
            }
            let decision = match class {
                class if bridged => self.rule.step_interpolated(now, class),
                Some(class) => match self.rule.step(now, Some(class)) {
                    Some(decision) => decision,
                    None => continue,
                },
                None => self.rule.reject(now),
            };
            // Nobody knows what the hand does, or it may have been so all through a silence.
            let drives = if bridged || self.rule.is_disarmed() {
                self.drives.reset()
            } else {
                self.drives.step(&prediction.drives)
            };
            let effort = match class {
                _ if !drives.is_empty() => drives.iter().fold(0.0, |max: f64, drive| max.max(drive.abs())),
                _ if direct.is_some() => direct.map_or(0.0, |(_, effort)| effort),
                Some(class) if class != self.rest => {
                    self.classifier.effort_of(class, window.amplitude()).unwrap_or(0.0)
                }
                _ => 0.0,
            };
            output = Some(EmgOutput {
                gesture: decision.gesture,
                class_index: self.classifier.class_index(decision.gesture).unwrap_or_default(),
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
            output = self.rule.step(now, None).map(|decision| self.stale_output(decision));
        }
        if let (Some(EmgOutput { stale: true, .. }), Some(vote)) = (&output, &mut self.vote) {
            // Votes from before a silence say nothing about the hand now.
            vote.clear();
        }
        if output.as_ref().is_some_and(|output| output.stale) {
            self.drives.reset();
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
    pub fn gestures(&self) -> &[Gesture] {
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
    fn stale_output(&self, decision: Decision) -> EmgOutput {
        EmgOutput {
            gesture: decision.gesture,
            class_index: self.classifier.class_index(decision.gesture).unwrap_or_default(),
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

    /// Why the stream is stale, as a cause and a sentence: a process that gives no decision has a say beside [`EmgPipeline::fault`].
    pub fn stale_cause(&self) -> Option<(StopCause, String)> {
        let undecided = self.tap.fault().filter(|_| self.rule.is_stale() && self.liveness.fault().is_none());
        match undecided {
            Some(reason) => Some((StopCause::UnusableOutput, reason.to_owned())),
            None => self.fault().map(|fault| (fault.cause(), fault.to_string())),
        }
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
mod tests;
