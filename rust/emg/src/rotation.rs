use crate::classifier::distinct;
use crate::{Classifier, EmgError, FeatureVector};
use proact_types::GestureName;
use serde::{Deserialize, Serialize};

/// What speaks for one position of the band.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RollEvidence {
    /// Channel c of the model is channel `(c + shift) mod channels` of the stream.
    pub shift: usize,
    /// Share of the windows that get the gesture that was asked for, mean over the gestures.
    pub accuracy: f64,
    /// Mean logarithm of that gesture's probability, mean over the gestures; not below -20.
    pub log_probability: f64,
}

/// What to do about the band.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum BandProposal {
    /// It sits as in calibration.
    Keep,
    /// Read the channels rolled by so many, or turn the band back by as many.
    Roll(usize),
    /// No position fits, or two fit alike: calibrate again.
    Recalibrate,
}

/// Result of [`check_rotation`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RotationReport {
    /// All positions, the best first.
    pub ranked: Vec<RollEvidence>,
    /// Log probability of the best less that of the second.
    pub margin: f64,
    /// The proposal.
    pub proposal: BandProposal,
}

/// The classifier is over-confident off its data, so one window must not outweigh all others.
const LEAST_LOG_PROBABILITY: f64 = -20.0;
/// Least accuracy of a position worth proposing: with two gestures known and five possible, chance is 0.2.
const LEAST_ACCURACY: f64 = 0.6;
/// Least lead over the second position, in natural units of log probability.
const LEAST_MARGIN: f64 = 1.0;

/// Tries every position of the band around the arm on windows of gestures that the person was asked for, at least two
/// different ones besides `rest`, which looks alike at every position and is left out, and says which fits the model best. The channels must be evenly spaced around the arm.
///
/// Whole channels only: a turn by half a channel is half wrong at both neighbours, and then the margin is small.
///
/// # Errors
/// Fewer than two gestures besides `rest`, a gesture that was not trained, or windows that the classifier refuses.
pub fn check_rotation<G: Copy + Into<GestureName>>(
    classifier: &Classifier,
    rest: GestureName,
    windows: &[(G, FeatureVector)],
) -> Result<RotationReport, EmgError> {
    let windows: Vec<(GestureName, &FeatureVector)> =
        windows.iter().map(|(of, w)| ((*of).into(), w)).collect();
    let asked = distinct(windows.iter().map(|(of, _)| *of).filter(|of| *of != rest));
    if asked.len() < 2 {
        return Err(EmgError::BandEvidence { got: asked.len() });
    }
    let (set, channels) = (classifier.features(), classifier.channels());
    let expected = set.count(channels);
    if let Some((_, wrong)) = windows.iter().find(|(_, w)| w.len() != expected) {
        return Err(EmgError::FeatureCount { got: wrong.len(), expected });
    }
    let mut ranked = Vec::with_capacity(channels);
    let mut rolled = vec![0.0; expected];
    for shift in 0..channels {
        let (mut accuracy, mut log_probability) = (0.0, 0.0);
        for gesture in &asked {
            let place = classifier.place(*gesture)?;
            let of_gesture = || windows.iter().filter(|(of, _)| of == gesture);
            let share = 1.0 / (asked.len() * of_gesture().count()) as f64;
            for (_, window) in of_gesture() {
                set.roll(window, channels, shift, &mut rolled);
                let prediction = classifier.predict(&rolled)?;
                accuracy += if prediction.class == *gesture { share } else { 0.0 };
                let probability = prediction.posterior[place];
                log_probability += share * probability.ln().max(LEAST_LOG_PROBABILITY);
            }
        }
        ranked.push(RollEvidence { shift, accuracy, log_probability });
    }
    // Stable, so the smaller shift goes first among equals.
    ranked.sort_by(|a, b| b.log_probability.total_cmp(&a.log_probability));
    let best = ranked[0];
    let margin = ranked.get(1).map_or(f64::INFINITY, |second| best.log_probability - second.log_probability);
    let proposal = if best.accuracy < LEAST_ACCURACY || margin < LEAST_MARGIN {
        BandProposal::Recalibrate
    } else if best.shift == 0 {
        BandProposal::Keep
    } else {
        BandProposal::Roll(best.shift)
    };
    Ok(RotationReport { ranked, margin, proposal })
}
