use super::{FaultArgs, WindowArgs};
use clap::Args;
use proact_devices::DeviceError;
use proact_emg::{SelectionCriterion, SelectionData, select_features};
use proact_types::Number;
use std::{error::Error, path::PathBuf};

/// Options of `proact emg select`.
#[derive(Debug, Args)]
pub struct SelectArgs {
    /// Folder with recordings, as for evaluate; at least two repetitions of each gesture.
    #[arg(long)]
    data: PathBuf,
    /// By what: accuracy or active_error (LDA, a repetition left out), mean_semi_principal_axis, feature_efficiency, repeatability or
    /// separability.
    #[arg(long, default_value_t = SelectionCriterion::Accuracy)]
    criterion: SelectionCriterion,
    /// Features to choose.
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = clap::value_parser!(u16).range(1..))]
    max_features: u16,
    #[command(flatten)]
    faults: FaultArgs,
    #[command(flatten)]
    window: WindowArgs,
}

/// The features in the order in which they were chosen.
pub(super) fn text(args: &SelectArgs, json: bool) -> Result<String, Box<dyn Error>> {
    let recordings = args.window.open(&args.data)?;
    let config = args.window.config(recordings.rate_hz, recordings.channels, &recordings.imu)?;
    let findings = args.faults.check_recordings(&recordings, &[])?;
    let gestures = recordings.gestures();
    let (mut windows, mut labels, mut repetitions) = (Vec::new(), Vec::new(), Vec::new());
    for recording in &recordings.items {
        let class = gestures.iter().position(|gesture| *gesture == recording.gesture);
        let Some(class) = class else { continue };
        windows.extend(recording.windows(&config)?);
        labels.resize(windows.len(), class);
        repetitions.resize(windows.len(), recording.repetition);
    }
    let rest = gestures.iter().position(|gesture| *gesture == config.rest);
    if rest.is_none() && args.criterion == SelectionCriterion::ActiveError {
        return Err(format!("active_error needs recordings of the relaxed hand, {}", config.rest).into());
    }
    if repetitions.iter().all(|repetition| repetitions.first() == Some(repetition)) {
        return Err(Box::new(DeviceError::NoRepetitions { purpose: "leave out" }));
    }
    let data = SelectionData {
        windows: &windows,
        layout: config.layout(),
        labels: &labels,
        repetitions: &repetitions,
        rest: rest.unwrap_or(0),
    };
    let chosen = select_features(&data, args.criterion, usize::from(args.max_features))?;
    if json {
        let object =
            serde_json::json!({ "criterion": args.criterion, "windows": windows.len(), "features": chosen });
        return super::with_findings(object, &findings);
    }
    let with =
        if args.criterion == SelectionCriterion::FeatureEfficiency { "alone" } else { "with those above" };
    let mut text = format!("{} windows; {} of each feature {with}\n", windows.len(), args.criterion);
    for (rank, one) in chosen.iter().enumerate() {
        text += &format!("{:>3}  {:<10} {:>9.3}\n", rank + 1, one.feature, Number(one.value));
    }
    let names: Vec<&str> = chosen.iter().map(|one| one.feature.as_str()).collect();
    Ok(text + &format!("--features {}\n", names.join(",")))
}
