use crate::classifier::distinct;
use crate::{Classifier, EmgError, EmgModel, Feature, FeatureVector};
use proact_types::Gesture;
use serde::{Deserialize, Serialize};

/// What speaks for one position of the band.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ShiftEvidence {
    /// Channel c of the model is channel `(c + shift) mod channels` of the stream.
    pub shift: usize,
    /// Share of the windows that get the gesture that was asked for, mean over the gestures.
    pub accuracy: f64,
    /// Mean logarithm of that gesture's probability, mean over the gestures; not below -20.
    pub log_probability: f64,
    /// How far the pattern of strength around the arm is from that of the calibration: root mean square over channels of
    /// the logarithm of the ratio, its mean taken out, mean over the gestures. None if the features tell no strength.
    #[serde(default)]
    pub pattern_distance: Option<f64>,
}

/// What to do about the band.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum BandProposal {
    /// It sits as in calibration.
    Keep,
    /// Read the channels rolled by so many, or turn the band back by as many.
    Roll(usize),
    /// Two electrodes have changed places: put them right.
    Swap([usize; 2]),
    /// No position fits, or two fit alike: calibrate again.
    Recalibrate,
}

/// Result of [`check_rotation`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RotationReport {
    /// All positions, the best first.
    pub ranked: Vec<ShiftEvidence>,
    /// Log probability of the best less that of the likeliest other; below zero if the classifier prefers that.
    pub margin: f64,
    /// The proposal.
    pub proposal: BandProposal,
}

/// The classifier is over-confident off its data, so one window must not outweigh all others.
const MIN_LOG_PROBABILITY: f64 = -20.0;
/// Least accuracy of a position worth proposing: with two gestures known and five possible, chance is 0.2.
const MIN_ACCURACY: f64 = 0.6;
/// Least lead over the second position, in natural units of log probability, where there are no patterns.
const MIN_MARGIN: f64 = 1.0;
/// Most of the second position's pattern distance that the best may have. Between sessions of five people
/// (`proact-devices`, `examples/band_check.rs`) the right position has at most 0.71 of it.
const MAX_DISTANCE_RATIO_TO_SECOND: f64 = 0.75;
/// Most of the best position's pattern distance that a swap may have to be named: without a swap it has at least 0.73 of
/// it (same recordings).
const MAX_SWAP_DISTANCE_RATIO: f64 = 1.0 / 1.5;
/// Added to the strength of each channel, as a share of the mean over channels: the logarithm of a silent channel is
/// noise.
const FLOOR: f64 = 0.05;
/// Features that tell strength, one value a channel.
const STRENGTHS: [Feature; 4] = [Feature::Mav, Feature::Rms, Feature::Iav, Feature::Ls];

/// Tries every position of the band around the arm on windows of gestures that the person was asked for, at least two
/// different ones besides `rest`, which looks alike at every position and is left out, and says which fits the model best. The channels must be evenly spaced around the arm.
///
/// The position is told by the pattern of strength around the arm, which moves with the band; what the classifier makes of
/// it says whether the model is still of use there. A classifier alone tells badly: trained to separate gestures, it may
/// separate them as well one channel further. Where the pattern's lead is small the classifier has to agree. Two electrodes that changed places are a pattern of their own.
///
/// Whole channels only: a turn by half a channel is half wrong at both neighbours, and then the lead is small, but not
/// always too small.
///
/// # Errors
/// Fewer than two gestures besides `rest`, a gesture that was not trained, or windows that the classifier refuses.
pub fn check_rotation<G: Copy + Into<Gesture>>(
    model: &EmgModel,
    windows: &[(G, FeatureVector)],
) -> Result<RotationReport, EmgError> {
    let (classifier, rest) = (&model.classifier, model.config.rest);
    let windows: Vec<(Gesture, &FeatureVector)> = windows.iter().map(|(of, w)| ((*of).into(), w)).collect();
    let gestures_checked = distinct(windows.iter().map(|(of, _)| *of).filter(|of| *of != rest));
    if gestures_checked.len() < 2 {
        return Err(EmgError::TooFewBandGestures { got: gestures_checked.len() });
    }
    let moving: Vec<(Gesture, &FeatureVector)> =
        windows.into_iter().filter(|(of, _)| gestures_checked.contains(of)).collect();
    let channels = classifier.channels();
    let mut ranked = Vec::with_capacity(channels);
    for shift in 0..channels {
        let (accuracy, log_probability) = accuracy_and_log_probability(classifier, &moving, shift)?;
        ranked.push(ShiftEvidence { shift, accuracy, log_probability, pattern_distance: None });
    }
    let patterns = Patterns::of(model, &gestures_checked, &moving)?;
    let proposal = match &patterns {
        Some(patterns) => {
            for evidence in &mut ranked {
                evidence.pattern_distance = Some(patterns.distance(|c| (c + evidence.shift) % channels));
            }
            // Stable, so the smaller shift goes first among equals.
            let distance = |evidence: &ShiftEvidence| evidence.pattern_distance.unwrap_or(f64::INFINITY);
            ranked.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
            let second = ranked.get(1).map_or(f64::INFINITY, distance);
            let swap =
                patterns.best_swap().filter(|(_, d)| *d < MAX_SWAP_DISTANCE_RATIO * distance(&ranked[0]));
            match swap {
                Some((pair, _)) => BandProposal::Swap(pair),
                None => {
                    let likely = ranked.iter().max_by(|a, b| a.log_probability.total_cmp(&b.log_probability));
                    let agree =
                        likely.is_some_and(|l| l.shift == ranked[0].shift) && margin(&ranked) >= MIN_MARGIN;
                    proposal(
                        &ranked[0],
                        agree || distance(&ranked[0]) <= MAX_DISTANCE_RATIO_TO_SECOND * second,
                    )
                }
            }
        }
        None => {
            ranked.sort_by(|a, b| b.log_probability.total_cmp(&a.log_probability));
            proposal(&ranked[0], margin(&ranked) >= MIN_MARGIN)
        }
    };
    Ok(RotationReport { margin: margin(&ranked), ranked, proposal })
}

/// Share of windows that `classifier` recognises if the band sits `shift` channels further, mean over their gestures: on
/// windows that did not propose the turn it says whether the turn is better than none.
///
/// # Errors
/// A gesture that was not trained, or windows that the classifier refuses.
pub fn accuracy_at_shift<G: Copy + Into<Gesture>>(
    classifier: &Classifier,
    windows: &[(G, FeatureVector)],
    shift: usize,
) -> Result<f64, EmgError> {
    let windows: Vec<(Gesture, &FeatureVector)> = windows.iter().map(|(of, w)| ((*of).into(), w)).collect();
    Ok(accuracy_and_log_probability(classifier, &windows, shift)?.0)
}

/// Log probability of the first less that of the likeliest other.
fn margin(ranked: &[ShiftEvidence]) -> f64 {
    let others = ranked.iter().skip(1).map(|other| other.log_probability);
    ranked[0].log_probability - others.fold(f64::NEG_INFINITY, f64::max)
}

fn proposal(best: &ShiftEvidence, is_clear: bool) -> BandProposal {
    match best.shift {
        _ if best.accuracy < MIN_ACCURACY || !is_clear => BandProposal::Recalibrate,
        0 => BandProposal::Keep,
        shift => BandProposal::Roll(shift),
    }
}

/// Accuracy and log probability at a position, means over the gestures.
fn accuracy_and_log_probability(
    classifier: &Classifier,
    windows: &[(Gesture, &FeatureVector)],
    shift: usize,
) -> Result<(f64, f64), EmgError> {
    let layout = classifier.layout();
    let expected = layout.count();
    let gestures = distinct(windows.iter().map(|(of, _)| *of));
    let (mut accuracy, mut log_probability) = (0.0, 0.0);
    let mut rolled = vec![0.0; expected];
    for gesture in &gestures {
        let class_index = classifier.class_index(*gesture)?;
        let of_gesture = || windows.iter().filter(|(of, _)| of == gesture);
        let share = 1.0 / (gestures.len() * of_gesture().count()) as f64;
        for (_, window) in of_gesture() {
            if window.len() != expected {
                return Err(EmgError::FeatureCount { got: window.len(), expected });
            }
            layout.roll(window, shift, &mut rolled);
            let prediction = classifier.predict(&rolled)?;
            accuracy += if prediction.class == *gesture { share } else { 0.0 };
            log_probability += share * prediction.posterior[class_index].ln().max(MIN_LOG_PROBABILITY);
        }
    }
    Ok((accuracy, log_probability))
}

/// Logarithms of the strength of each channel, in calibration and now, per gesture.
struct Patterns {
    pairs: Vec<[Vec<f64>; 2]>,
    channels: usize,
}

impl Patterns {
    /// None if no feature of the model tells strength.
    fn of(
        model: &EmgModel,
        gestures_checked: &[Gesture],
        windows: &[(Gesture, &FeatureVector)],
    ) -> Result<Option<Patterns>, EmgError> {
        let (layout, channels) = (model.classifier.layout(), model.classifier.channels());
        let Some(range) = STRENGTHS.iter().find_map(|feature| layout.range_of(*feature)) else {
            return Ok(None);
        };
        let logs = |strengths: &[f64]| -> Vec<f64> {
            let mean = strengths.iter().sum::<f64>() / channels as f64;
            strengths.iter().map(|v| (v + FLOOR * mean).max(f64::MIN_POSITIVE).ln()).collect()
        };
        let mut pairs = Vec::with_capacity(gestures_checked.len());
        for gesture in gestures_checked {
            let trained = &model.moments.means[model.classifier.class_index(*gesture)?][range.clone()];
            let mut now = vec![0.0; channels];
            let of_gesture = || windows.iter().filter(|(of, _)| of == gesture);
            let count = of_gesture().count() as f64;
            for (_, window) in of_gesture() {
                now.iter_mut().zip(&window[range.clone()]).for_each(|(sum, v)| *sum += v / count);
            }
            pairs.push([logs(trained), logs(&now)]);
        }
        Ok(Some(Patterns { pairs, channels }))
    }

    /// The distance if channel c of the model is channel `place(c)` of the stream.
    fn distance(&self, rotated_channel: impl Fn(usize) -> usize) -> f64 {
        let of_gesture = |[trained, now]: &[Vec<f64>; 2]| {
            let off: Vec<f64> = (0..self.channels).map(|c| now[rotated_channel(c)] - trained[c]).collect();
            let mean = off.iter().sum::<f64>() / self.channels as f64;
            (off.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / self.channels as f64).sqrt()
        };
        self.pairs.iter().map(of_gesture).sum::<f64>() / self.pairs.len() as f64
    }

    /// The two channels whose swap fits best, and the distance then.
    fn best_swap(&self) -> Option<([usize; 2], f64)> {
        let pairs = (0..self.channels).flat_map(|a| (a + 1..self.channels).map(move |b| [a, b]));
        let swapped = |[a, b]: [usize; 2]| {
            let rotated_channel = move |c| {
                if c == a {
                    b
                } else if c == b {
                    a
                } else {
                    c
                }
            };
            ([a, b], self.distance(rotated_channel))
        };
        pairs.map(swapped).min_by(|(_, d), (_, e)| d.total_cmp(e))
    }
}
