//! What follows from the band check before a calibration.

use super::write_whole;
use proact_emg::{BandProposal, EmgModel, RotationReport};
use serde_json::{Value, json};
use std::{error::Error, path::Path};

/// What follows from the band check; some if there is nothing more to do.
pub(super) fn verdict(
    band: &RotationReport,
    earlier: &EmgModel,
    out: &Path,
    accept_roll: bool,
) -> Result<Option<Value>, Box<dyn Error>> {
    let path = out.display();
    let object = |text: &str| json!({ "model": path.to_string(), "band": band, "verdict": text });
    match band.proposal {
        BandProposal::Keep => {
            write_whole(out, &earlier.to_json()?)?;
            Ok(Some(object("the band sits as it did: the earlier model is used again")))
        }
        BandProposal::Roll(shift) if accept_roll => {
            write_whole(out, &earlier.rolled(shift)?.to_json()?)?;
            Ok(Some(object("the band is turned: the earlier model was rolled to it")))
        }
        BandProposal::Roll(shift) => Err(format!(
            "the band is turned by {shift} channels; turn it back and check again, or take it as it sits with --accept-roll"
        )
        .into()),
        BandProposal::Recalibrate => Ok(None),
    }
}

/// What was found, with its evidence.
pub(super) fn text(band: &RotationReport) -> String {
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
        BandProposal::Recalibrate => {
            format!("the earlier model fits no position of the band ({evidence}): calibrating anew")
        }
    }
}
