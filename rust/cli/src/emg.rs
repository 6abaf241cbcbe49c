//! `proact emg`: what labs compare with their own tools, and live streams.

mod band_check;
mod calibration_page;
mod calibration_ui;
mod decoder_args;
pub(crate) mod recording_checks;
mod select;
mod simulate;
mod source_args;
mod stream;
mod train;
mod train_args;
mod training_output;
mod training_source;
mod usability;
mod usage;
mod window_args;

use clap::{Args, Subcommand};
use proact_app::print_status;
use proact_devices::{
    DeviceError, Recording, Recordings, SampleFile, SourceRegistry, accepted_fault_texts, evaluate,
    findings_json, read_samples,
};
use proact_emg::{DriveScore, EmgConfig, FeatureVector, RecordingFault};
use proact_files::{check_output, write_atomically};
use proact_types::{Gesture, Number};
pub(crate) use recording_checks::FaultArgs;
use std::{
    error::Error,
    io::{self, Write},
    path::PathBuf,
};
pub use window_args::WindowArgs;

/// Subcommands of `proact emg`.
#[derive(Debug, Subcommand)]
pub enum EmgCommand {
    /// Guide a person through a calibration and write a model.
    #[command(
        after_help = "Examples:\n  proact emg train --source ble --out me.json --save recordings/me\n  \
        proact emg train --source ble --page\n  \
        proact emg train --source gforce-sim://127.0.0.1:7410 --json\n  \
        proact emg train --source file:recordings/ --json\n\n\
        Simulated people make what they are prompted. Success only if the target is reached; the model is written all the same."
    )]
    Train(Box<train::TrainArgs>),
    /// Test whether a person can use a model: gestures in order, a longer trial, a cursor.
    #[command(after_help = "Examples:\n  proact emg test --model me.json --source ble\n  \
        proact emg test --model me.json --source ble --tests cursor --page")]
    Test(Box<usability::EmgTestArgs>),
    /// Train on some repetitions of a recording, test on others.
    #[command(
        after_help = "Example:\n  proact emg evaluate --data recordings/ --train-repetitions 0,1 --test-repetitions 2"
    )]
    Evaluate(EvaluateArgs),
    /// Write the features of every window as CSV: one row a window, feature-major.
    #[command(
        after_help = "Example:\n  proact emg features --csv R_0_C_1.csv --window 20 --increment 10 --unit samples"
    )]
    Features(FeaturesArgs),
    /// Choose features by how well recordings are told apart with them.
    #[command(
        after_help = "Example:\n  proact emg select --data recordings/ --features HTD,LS4,TDPSD --max-features 6"
    )]
    Select(select::SelectArgs),
    /// Recognise gestures live, from an armband, the simulator, a file, or LibEMG's classes.
    #[command(
        after_help = "Examples:\n  proact emg stream --source gforce-sim://127.0.0.1:7410 --data recordings/\n  \
        proact emg stream --source ble --data recordings/ --record today.edf\n  \
        proact emg stream --source lsl:MyAmplifier --model me.json --lsl ProACT\n  \
        proact emg stream --source file:recordings/ --data recordings/ --no-realtime --json\n\n\
        With --json: one line per decision, and lines with the key \"event\" for what else happens."
    )]
    Stream(Box<stream::StreamArgs>),
    /// Serve a gForce armband, byte for byte, that replays recordings with the faults of a radio.
    #[command(
        after_help = "Example:\n  proact emg simulate --data recordings/ --repetitions 2 --gesture-sequence no_motion:2,hand_close:3 --loss-rate 0.01"
    )]
    Simulate(simulate::SimulateArmbandArgs),
    /// Tell days and hours of use from the log that `proact serve --usage-log` keeps.
    Usage(usage::UsageArgs),
}

/// Options of `proact emg evaluate`.
#[derive(Debug, Args)]
pub struct EvaluateArgs {
    /// Folder with R_<rep>_C_<class>.csv files or in the myo_readings layout.
    #[arg(long)]
    data: PathBuf,
    /// Repetitions to train on.
    #[arg(long, value_name = "REPS", value_delimiter = ',', default_value = "0,1")]
    train_repetitions: Vec<u32>,
    /// Repetitions to test on.
    #[arg(long, value_name = "REPS", value_delimiter = ',', default_value = "2")]
    test_repetitions: Vec<u32>,
    #[command(flatten)]
    faults: FaultArgs,
    #[command(flatten)]
    window: WindowArgs,
}

/// Options of `proact emg features`.
#[derive(Debug, Args)]
pub struct FeaturesArgs {
    /// Folder as for evaluate. Rows come by repetition, then class.
    #[arg(long, required_unless_present = "csv", conflicts_with = "csv")]
    data: Option<PathBuf>,
    /// One file of samples: a row a sample, a column a channel.
    #[arg(long)]
    csv: Option<PathBuf>,
    /// Only these repetitions; with --test-repetitions, those follow. Default: all.
    #[arg(long, value_name = "REPS", value_delimiter = ',', conflicts_with = "csv")]
    train_repetitions: Vec<u32>,
    /// Only these repetitions, after those of --train-repetitions.
    #[arg(long, value_name = "REPS", value_delimiter = ',', conflicts_with = "csv")]
    test_repetitions: Vec<u32>,
    /// Begin with a row of column names.
    #[arg(long)]
    header: bool,
    /// Write to this file instead of standard output.
    #[arg(long)]
    out: Option<PathBuf>,
    #[command(flatten)]
    faults: FaultArgs,
    #[command(flatten)]
    window: WindowArgs,
}

/// Runs a subcommand; `json` asks for one JSON object on standard output.
///
/// # Errors
/// Recordings that cannot be used, settings that cannot work, or output that cannot be written.
pub(crate) fn run(sources: &SourceRegistry, command: &EmgCommand, json: bool) -> Result<(), Box<dyn Error>> {
    let done = run_command(sources, command, json);
    done.inspect_err(|error| recording_checks::print_refused_findings(error.as_ref(), json))
}

fn run_command(sources: &SourceRegistry, command: &EmgCommand, json: bool) -> Result<(), Box<dyn Error>> {
    let text = match command {
        EmgCommand::Evaluate(args) => evaluation(args, json)?,
        EmgCommand::Features(args) => {
            args.out.as_deref().map_or(Ok(()), check_output)?;
            let text = features(args, json)?;
            if let Some(path) = &args.out {
                return Ok(write_atomically(path, &text)?);
            }
            text
        }
        EmgCommand::Select(args) => select::text(args, json)?,
        EmgCommand::Usage(args) => usage::text(args, json)?,
        EmgCommand::Train(args) => return train::run(sources, args, json),
        EmgCommand::Test(args) => return usability::run(sources, args, json),
        EmgCommand::Stream(args) => return stream::run(sources, args, json),
        EmgCommand::Simulate(args) => return simulate::run(args, json),
    };
    match io::stdout().lock().write_all(text.as_bytes()) {
        // A reader such as `head` has seen enough.
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(()),
        result => Ok(result?),
    }
}

fn evaluation(args: &EvaluateArgs, json: bool) -> Result<String, Box<dyn Error>> {
    let recordings = args.window.open(&args.data)?;
    let config = args.window.config(recordings.rate_hz, recordings.channels, &recordings.imu)?;
    let findings = args
        .faults
        .check_recordings(&recordings, &[&args.train_repetitions[..], &args.test_repetitions].concat())?;
    let result = evaluate(&recordings, &args.train_repetitions, &args.test_repetitions, &config)?;
    if json {
        return with_findings(serde_json::to_value(&result)?, &findings);
    }
    let mut text = format!(
        "accuracy {:.2} % ({} of {} windows)\nactive error {:.2} %, instability {:.3}, precision {:.3}, recall {:.3}, F1 {:.3}\n\
         rows: true class; columns: recognised, same order\n",
        100.0 * result.accuracy,
        result.correct,
        result.windows,
        100.0 * result.metrics.active_error,
        result.metrics.instability,
        result.metrics.precision,
        result.metrics.recall,
        result.metrics.f1,
    );
    for DriveScore { drive, r2, mean_absolute_error } in &result.drives {
        text += &format!("{drive:<32} R2 {:.3}, mean absolute error {mean_absolute_error:.3}\n", Number(*r2));
    }
    for (gesture, row) in result.classes.iter().zip(&result.confusion) {
        let counts: String = row.iter().map(|count| format!("{count:>6}")).collect();
        text += &format!("{gesture:<16}{counts}\n");
    }
    Ok(text)
}

fn features(args: &FeaturesArgs, json: bool) -> Result<String, Box<dyn Error>> {
    let (config, windows, findings) = match (&args.csv, &args.data) {
        (Some(path), _) => {
            let SampleFile { samples, notes } = read_samples(path)?;
            notes.iter().for_each(print_status);
            let channels = samples.first().map_or(0, |s| s.len());
            // Repetition and gesture have no bearing on features.
            let recording = Recording {
                repetition: 0,
                gesture: Gesture::default(),
                samples,
                bridged: Vec::new(),
                path: path.clone(),
            };
            let rate_hz = args.window.rate_or_default(recording.rate_hz(args.window.rate_hz))?;
            let config = args.window.config(rate_hz, channels, &[])?;
            let findings = recording.check_faults(rate_hz, args.faults.policy())?;
            findings.iter().for_each(print_status);
            (config.clone(), recording.windows(&config)?, findings)
        }
        (None, Some(dir)) => {
            let recordings = args.window.open(dir)?;
            let config = args.window.config(recordings.rate_hz, recordings.channels, &recordings.imu)?;
            let findings = args.faults.check_recordings(
                &recordings,
                &[&args.train_repetitions[..], &args.test_repetitions].concat(),
            )?;
            (
                config.clone(),
                windows_of_repetitions(
                    &recordings,
                    &[&args.train_repetitions, &args.test_repetitions],
                    &config,
                )?,
                findings,
            )
        }
        (None, None) => return Err("no recording was named, expected --data DIR or --csv FILE".into()),
    };
    let names = config.column_names();
    if json {
        let object = serde_json::json!({ "windows": windows.len(), "columns": names, "features": windows });
        return with_findings(object, &findings);
    }
    let mut text = String::new();
    if args.header {
        text += &(names.join(",") + "\n");
    }
    for window in &windows {
        text += &(window.iter().map(|value| Number(*value).to_string()).collect::<Vec<_>>().join(",") + "\n");
    }
    Ok(text)
}

/// An answer with what was found in its recordings, and what of it was accepted.
fn with_findings(
    mut object: serde_json::Value,
    findings: &[RecordingFault],
) -> Result<String, Box<dyn Error>> {
    object["findings"] = findings_json(findings);
    object["accepted_faults"] = accepted_fault_texts(findings).into();
    Ok(proact_types::to_json(&object)? + "\n")
}

/// Windows of the repetitions named, in that order; of all, when none is.
fn windows_of_repetitions(
    recordings: &Recordings,
    reps: &[&[u32]],
    config: &EmgConfig,
) -> Result<Vec<FeatureVector>, DeviceError> {
    let mut windows = Vec::new();
    if reps.iter().all(|named| named.is_empty()) {
        for recording in &recordings.items {
            windows.extend(recording.windows(config)?);
        }
    }
    for &rep in reps.iter().copied().flatten() {
        for gesture in recordings.gestures() {
            windows.extend(recordings.find(gesture, rep)?.windows(config)?);
        }
    }
    Ok(windows)
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;
    use std::{fs::File, path::Path};

    #[derive(Parser)]
    struct Line {
        #[command(subcommand)]
        command: EmgCommand,
    }

    fn parse(line: &str) -> Result<EmgCommand, clap::Error> {
        Line::try_parse_from(std::iter::once("emg").chain(line.split_whitespace())).map(|line| line.command)
    }

    /// A fresh folder with three repetitions of two gestures on two channels.
    fn recordings() -> tempfile::TempDir {
        let dir = tempfile::tempdir().expect("a temporary folder can be made");
        for rep in 0..3 {
            for class in [0, 2] {
                // Noise: recordings of tones would be copies of each other, or hum.
                let value = |k: usize, c: usize| {
                    let seed = ((rep * 10 + class) * 10 + c) * 1000 + k;
                    let bits = (seed as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(31);
                    let bits = (bits ^ (bits >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
                    ((bits ^ (bits >> 32)) as f64 / u64::MAX as f64 - 0.5) * (1 + 9 * class) as f64
                };
                let text: String = (0..60).map(|k| format!("{},{}\n", value(k, 0), value(k, 1))).collect();
                let path = dir.path().join(format!("R_{rep}_C_{class}.csv"));
                File::create(path).and_then(|mut f| f.write_all(text.as_bytes())).expect("writable");
            }
        }
        std::fs::write(dir.path().join("metadata.json"), r#"{"rate_hz": 200}"#).expect("writable");
        dir
    }

    fn with_data(line: &str, dir: &Path) -> EmgCommand {
        parse(&format!("{line} --data {}", dir.display())).expect("a good command line")
    }

    #[test]
    fn select_puts_features_in_order_and_names_what_it_lacks() {
        let dir = recordings();
        let run = |line: &str| {
            let EmgCommand::Select(args) = with_data(line, dir.path()) else { panic!("another command") };
            (select::text(&args, false).map_err(|e| e.to_string()), select::text(&args, true))
        };
        let window = "--window 20 --increment 10 --unit samples";
        let (text, json) = run(&format!("select --features MAV,ZC,WL --max-features 2 {window}"));
        let text = text.expect("good recordings");
        assert_eq!(text.lines().count(), 4, "{text}");
        assert!(text.lines().last().is_some_and(|line| line.starts_with("--features ")), "{text}");
        let json: serde_json::Value = serde_json::from_str(&json.expect("good")).expect("it is JSON");
        assert_eq!(json["features"].as_array().map(Vec::len), Some(2));
        assert!(
            parse("select --data x --criterion beauty")
                .is_err_and(|e| e.to_string().contains("separability"))
        );
        std::fs::remove_file(dir.path().join("R_1_C_0.csv")).expect("it is there");
        std::fs::remove_file(dir.path().join("R_1_C_2.csv")).expect("it is there");
        std::fs::remove_file(dir.path().join("R_2_C_0.csv")).expect("it is there");
        std::fs::remove_file(dir.path().join("R_2_C_2.csv")).expect("it is there");
        let (text, _) = run(&format!("select {window}"));
        assert!(text.is_err_and(|e| e.contains("leave out")));
    }

    #[test]
    fn evaluate_tells_accuracy_confusion_and_classes() {
        let dir = recordings();
        let EmgCommand::Evaluate(args) = with_data("evaluate --features htd", dir.path()) else {
            panic!("another command")
        };
        let json = evaluation(&args, true).expect("a good folder");
        let result: serde_json::Value = serde_json::from_str(&json).expect("JSON");
        assert_eq!(result["windows"], 10);
        assert_eq!(result["correct"], 10);
        assert_eq!(result["accuracy"], 1.0);
        assert_eq!(result["confusion"], serde_json::json!([[5, 0], [0, 5]]));
        assert_eq!(result["classes"], serde_json::json!(["hand_close", "no_motion"]));
        assert!(evaluation(&args, false).expect("a good folder").starts_with("accuracy 100.00 % (10 of 10"));
    }

    #[test]
    fn features_come_one_row_a_window_and_whole_files_replace_old_ones() {
        let dir = recordings();
        let out = dir.path().join("features.out");
        let line =
            format!("features --window 20 --increment 10 --unit samples --header --out {}", out.display());
        let command = with_data(&line, dir.path());
        run(&SourceRegistry::standard(), &command, false).expect("a good folder");
        let text = io::read_to_string(File::open(&out).expect("written")).expect("text");
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines.len(), 1 + 3 * 2 * 5);
        assert_eq!(lines[0], "MAV_ch0,MAV_ch1,ZC_ch0,ZC_ch1,SSC_ch0,SSC_ch1,WL_ch0,WL_ch1");
        assert!(
            lines[1].split(',').all(|value| value.parse::<f64>().is_ok()) && lines[1].split(',').count() == 8
        );

        let EmgCommand::Features(args) = with_data("features --train-repetitions 1", dir.path()) else {
            panic!("another command")
        };
        assert_eq!(features(&args, false).expect("good").lines().count(), 10);
    }

    #[test]
    fn features_of_one_file_equal_those_of_the_folder() {
        let dir = recordings();
        let one = parse(&format!("features --csv {}", dir.path().join("R_0_C_0.csv").display()));
        let Ok(EmgCommand::Features(one)) = one else { panic!("a good command line") };
        let EmgCommand::Features(all) = with_data("features", dir.path()) else { panic!("another command") };
        let (one, all) = (features(&one, false).expect("good"), features(&all, false).expect("good"));
        assert!(all.starts_with(&one) && one.lines().count() == 5);
    }

    #[test]
    fn a_rate_that_nobody_says_is_asked_for_only_where_it_matters() {
        let dir = recordings();
        std::fs::remove_file(dir.path().join("metadata.json")).expect("it is there");
        let outcome = |line: &str| match with_data(line, dir.path()) {
            EmgCommand::Evaluate(args) => evaluation(&args, true).map_err(|e| e.to_string()),
            EmgCommand::Features(args) => features(&args, true).map_err(|e| e.to_string()),
            _ => panic!("another command"),
        };
        for line in
            ["evaluate", "features", "features --features MNF --unit samples --window 20 --increment 10"]
        {
            let error = outcome(line).expect_err("a rate is needed");
            assert!(
                error.contains("does not say its rate") && error.contains("--emg-rate HZ"),
                "{line}: {error}"
            );
        }
        for line in ["evaluate", "features"] {
            let samples = outcome(&format!("{line} --unit samples --window 20 --increment 10"));
            assert_eq!(samples, outcome(&format!("{line} --emg-rate 200")), "{line}");
            assert!(samples.is_ok(), "{samples:?}");
        }
    }

    #[test]
    fn bad_options_and_unwritable_output_are_refused() {
        let dir = recordings();
        assert!(parse("features").is_err(), "neither folder nor file");
        assert!(parse("evaluate --data x --features XYZ").is_err_and(|e| e.to_string().contains("HTD")));
        let message = |line: &str| {
            run(&SourceRegistry::standard(), &with_data(line, dir.path()), true)
                .expect_err("refused")
                .to_string()
        };
        assert!(
            message("evaluate --unit samples --window 20.5")
                .contains("20.5 samples, expected a whole number")
        );
        assert!(message("evaluate --window NaN").contains("NaN"));
        assert!(message("evaluate --emg-rate 0").contains("EMG rate is 0"));
        assert!(
            message("evaluate --test-repetitions 5")
                .contains("no repetition 5 of hand_close; there are 0, 1, 2")
        );
        assert!(
            message("evaluate --test-repetitions 1,2").contains("repetition 1 is both trained and tested on")
        );
        let nowhere = dir.path().join("no/such/folder/f.csv");
        assert!(message(&format!("features --out {}", nowhere.display())).contains("cannot write"));
        let folder = dir.path().join("taken");
        std::fs::create_dir(&folder).expect("writable");
        assert!(message(&format!("features --out {}", folder.display())).contains("cannot write"));
        assert!(!dir.path().join("taken.partial").exists(), "nothing half-written is left");
    }
}
