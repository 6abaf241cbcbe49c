use clap::Args;
use proact_app::{export_xdf, print_result, print_result_json};
use proact_control::MethodRegistry;
use std::{error::Error, path::PathBuf};

/// Arguments of `proact export`.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  proact export trials/D-seated-seed1 --xdf D-seed1.xdf\n\n\
    XDF is the format of the lab streaming layer's recorder, which pyxdf, MNE, EEGLAB and SigViewer read. Streams: EMG, Gestures, Gaze, Joints, \
    Hand, Shoulder, Events; times are seconds of the trial. The record must replay with its digests. Tables of a study are made by `proact \
    study export`.")]
pub(crate) struct ExportArgs {
    /// Trial directory
    #[arg(value_name = "DIR")]
    trial: PathBuf,
    /// The file to write; one that exists is left alone
    #[arg(long, value_name = "FILE")]
    xdf: PathBuf,
    /// One JSON object on standard output
    #[arg(long)]
    json: bool,
}

pub(crate) fn command(methods: &MethodRegistry, args: &ExportArgs) -> Result<bool, Box<dyn Error>> {
    let exported = export_xdf(methods, &args.trial, &args.xdf)?;
    if args.json {
        print_result_json(&exported)?;
        return Ok(true);
    }
    for stream in &exported.streams {
        print_result(format_args!(
            "{:<10} {:>8} samples of {:>3} channels",
            stream.name, stream.samples, stream.channels
        ))?;
    }
    let ended = if exported.finished { "" } else { ", interrupted" };
    print_result(format_args!("{:.3} s{ended}, in {}", exported.seconds, args.xdf.display()))?;
    Ok(true)
}
