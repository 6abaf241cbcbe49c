//! The model of a live stream, for every command that takes one.

use proact_devices::SourceInfo;
use proact_emg::{EmgModel, StreamFormat};
use std::{error::Error, path::Path};

/// Reads a model file and checks that it fits the stream.
///
/// # Errors
/// A file that cannot be read, is no model, or was trained on another stream.
pub fn read_model(path: &Path, info: &SourceInfo) -> Result<EmgModel, Box<dyn Error>> {
    let model = read_model_file(path)?;
    let stream = StreamFormat {
        rate_hz: info.rate_hz,
        channels: info.channels,
        rest_medians: None,
        imu: info.imu.clone(),
    };
    model.check_stream_format(&stream).map_err(|e| format!("{}: {e}", path.display()))?;
    Ok(model)
}

/// Whether the model's stream has an inertial measurement unit, which its source is to be asked for then.
///
/// # Errors
/// A file that cannot be read, or is no model.
pub fn model_uses_imu(path: &Path) -> Result<bool, Box<dyn Error>> {
    Ok(!read_model_file(path)?.config.imu.channels.is_empty())
}

/// Reads a model file.
///
/// # Errors
/// A file that cannot be read, or is no model.
pub fn read_model_file(path: &Path) -> Result<EmgModel, Box<dyn Error>> {
    let json = std::fs::File::open(path)
        .and_then(|file| proact_types::read_text(file, proact_types::MAX_TEXT_BYTES))
        .map_err(|e| format!("cannot read {}: {e}; proact emg train writes such a file", path.display()))?;
    Ok(EmgModel::from_json(&json).map_err(|e| format!("{}: {e}", path.display()))?)
}
