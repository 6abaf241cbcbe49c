//! What follows from the band check before a calibration.

use proact_emg::{BandProposal, EmgError, EmgModel, FeatureVector, RotationReport, extract_features};
use proact_files::write_atomically;
use proact_types::{Command, EmgSample, Gesture};
use serde_json::{Value, json};
use std::{error::Error, path::Path};

/// What follows from the band check; `held_out` is the share of windows that did not propose a turn which the model
/// recognises as it is, and turned. Some if there is nothing more to do.
pub(super) fn verdict(
    band: &RotationReport,
    earlier: &EmgModel,
    out: &Path,
    accept_rotation: bool,
    held_out: Option<[f64; 2]>,
) -> Result<Option<Value>, Box<dyn Error>> {
    let path = out.display();
    let object = |text: &str| json!({ "model": path.to_string(), "band": band, "verdict": text });
    match band.proposal {
        BandProposal::Keep => {
            write_atomically(out, &earlier.to_json()?)?;
            Ok(Some(object("the band sits as it did: the earlier model is used again")))
        }
        BandProposal::Roll(shift) if accept_rotation => {
            let Some([straight, rolled]) = held_out else {
                return Err(format!(
                    "the band is turned by {shift} channels, by two gestures; there are no other recordings to test the \
                     turned model on, which --accept-rotation needs"
                )
                .into());
            };
            if rolled <= straight {
                return Err(format!(
                    "two gestures propose a band that is turned by {shift} channels, but of windows that did not propose \
                     it the model recognises {:.1} % turned and {:.1} % as it is: not accepted; calibrate anew without --band-check",
                    100.0 * rolled,
                    100.0 * straight
                )
                .into());
            }
            write_atomically(out, &earlier.with_channel_shift(shift)?.to_json()?)?;
            Ok(Some(object("the band is turned: the earlier model was rolled to it")))
        }
        BandProposal::Roll(shift) => Err(format!(
            "the band is turned by {shift} channels; turn it back and check again, or take it as it sits with --accept-rotation"
        )
        .into()),
        BandProposal::Swap(pair) => Err(swapped_channels_text(pair).into()),
        BandProposal::Recalibrate => Ok(None),
    }
}

fn swapped_channels_text([a, b]: [usize; 2]) -> String {
    format!(
        "channels {a} and {b} have changed places: put their electrodes or plugs right and check again, or calibrate anew without --band-check"
    )
}

/// What was found, with its evidence.
pub(super) fn evidence_text(band: &RotationReport) -> String {
    let evidence = band.ranked.first().map_or(String::new(), |best| {
        format!(
            "best at {} channels with {:.0} % recognised, lead {:.1}",
            best.shift,
            100.0 * best.accuracy,
            band.margin
        )
    });
    match band.proposal {
        BandProposal::Keep => format!("the band sits as it did ({evidence})"),
        BandProposal::Roll(shift) => format!("the band is turned by {shift} channels ({evidence})"),
        BandProposal::Swap(pair) => format!("{} ({evidence})", swapped_channels_text(pair)),
        BandProposal::Recalibrate => {
            format!("the earlier model fits no position of the band ({evidence}): calibrating anew")
        }
    }
}

/// The two gestures of the band check by `model`: where it knows them those of the wrist, which use opposite sides of the
/// forearm, else its first two.
pub(super) fn band_check_gestures(model: &EmgModel) -> Vec<Gesture> {
    let known = model.classifier.gestures();
    let wrist = [Command::WristFlexion, Command::WristExtension].map(Gesture::from);
    if wrist.iter().all(|gesture| known.contains(gesture)) {
        return wrist.into();
    }
    known.iter().copied().filter(|gesture| *gesture != model.config.rest).take(2).collect()
}

/// Windows of raw recordings as `model` sees them.
///
/// # Errors
/// As [`extract`].
pub(super) fn extract_windows(
    model: &EmgModel,
    recordings: Vec<(Gesture, Vec<EmgSample>)>,
) -> Result<Vec<(Gesture, FeatureVector)>, EmgError> {
    let mut windows = Vec::new();
    for (gesture, samples) in recordings {
        let centered: Vec<EmgSample> = samples.iter().map(|s| model.subtract_dc_offset(s)).collect();
        windows
            .extend(extract_features(&model.config, &centered)?.into_iter().map(|vector| (gesture, vector)));
    }
    Ok(windows)
}
