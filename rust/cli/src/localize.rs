//! `proact localize`: records poses, and calibrates headset and shoulder from what was recorded.

use crate::{interrupt::interrupt_flag, trial_args::TrialArgs};
use clap::{Args, Subcommand};
use proact_app::{
    CALIBRATIONS_DIR, CalibrationFile, Calibrations, HEAD_BODY, HeadsetMarkerCalibration, MocapAxes, PoseLog,
    ReachMap, RecordedBodies, Registry, SavedCalibration, print_result, print_result_json, print_status,
    recorded_poses,
};
use proact_devices::{
    SourceName,
    motion_capture::{CaptureStatus, OpenedCapture},
};
use proact_files::{check_folder, check_output};
use proact_localization::{
    HeadsetCalibrationOptions, PlacementProfile, ShoulderCalibration, ShoulderOptions, calibrate_headset,
    calibrate_shoulder,
};
use proact_types::Number;
use serde_json::{Value, json};
use std::{
    error::Error,
    path::PathBuf,
    sync::atomic::Ordering,
    time::{Duration, Instant},
};

/// What to do about where things are.
#[derive(Debug, Subcommand)]
pub enum LocalizeCommand {
    /// Record the poses of all bodies of a motion capture system to a file
    #[command(
        after_help = "Example:\n  proact localize record vrpn:192.168.1.5/Shoulderpad --seconds 10 --out rest.csv\n\n\
        Poses of a headset are recorded beside those of its markers by: proact serve --headset --mocap SOURCE --mocap-record FILE"
    )]
    Record(RecordArgs),
    /// Calibrate where the markers sit on a headset, from a minute of free head movement
    #[command(after_help = "Example:\n  proact localize headset minute.csv --marker-body HololensSG\n\n\
        The exit code is 0 only if the verdict is good: then serve and study run use it.")]
    Headset(HeadsetArgs),
    /// Calibrate where the arm sits on the person, and where the box stands
    #[command(
        after_help = "Examples:\n  proact localize shoulder rest.csv --body Shoulderpad --heading-deg 90\n  \
        proact localize shoulder rest.csv --body Shoulderpad --circles circles.csv --upper-arm-body UpperArm --box-placement study_1 --knee-distance 0.25\n\n\
        The exit code is 0 only if the verdict is good: then serve and study run use it."
    )]
    Shoulder(ShoulderArgs),
    /// Show which part of the box this person reaches, before a trial begins: from the calibrated shoulder, or the set-up's
    #[command(
        after_help = "Examples:\n  proact localize reach\n  proact localize reach --setup still --arm mpl_left --json\n\n\
        Seen from above. Within the joints' limits, gripping from above; walls and objects in the way are not looked at."
    )]
    Reach(ReachArgs),
    /// Move the calibrated box by keys: w ahead, s back, a left, d right, r up, f down, 5 mm each; q or the end of input saves
    #[command(
        after_help = "Examples:\n  proact localize correct\n  echo wwa | proact localize correct --json\n\n\
        Keys count when Enter is pressed. All corrections together go no further than 10 cm."
    )]
    Correct(CalibrationsDirArgs),
    /// Show the calibrations that are in use
    #[command(after_help = "Example:\n  proact localize show --json")]
    Show(CalibrationsDirArgs),
}

/// Where calibrations are.
#[derive(Debug, Args)]
pub struct CalibrationsDirArgs {
    /// Folder of the calibrations
    #[arg(long, value_name = "DIR", default_value = CALIBRATIONS_DIR)]
    calibrations: PathBuf,
}

/// Arguments of `proact localize reach`.
#[derive(Debug, Args)]
pub struct ReachArgs {
    #[command(flatten)]
    trial: TrialArgs,
    #[command(flatten)]
    folder: CalibrationsDirArgs,
}

/// Arguments of `proact localize record`.
#[derive(Debug, Args)]
pub struct RecordArgs {
    /// As for serve --mocap
    #[arg(value_name = "SOURCE")]
    source: SourceName,
    /// How long, s
    #[arg(long, default_value_t = 60.0)]
    seconds: f64,
    /// The file
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
}

/// Arguments of `proact localize headset`.
#[derive(Debug, Args)]
pub struct HeadsetArgs {
    /// Recorded poses of head and markers
    #[arg(value_name = "FILE")]
    poses: PathBuf,
    /// Name of the marker body on the headset
    #[arg(long, value_name = "BODY")]
    marker_body: String,
    /// Name under which the headset's own poses were recorded
    #[arg(long, value_name = "BODY", default_value = HEAD_BODY)]
    head: String,
    /// How the tracking system's axes lie, as for serve
    #[arg(long, value_name = "KEY=VALUE,..")]
    mocap_axes: Option<MocapAxes>,
    #[command(flatten)]
    folder: CalibrationsDirArgs,
}

/// Arguments of `proact localize shoulder`.
#[derive(Debug, Args)]
pub struct ShoulderArgs {
    /// Recorded poses of the brace while the person sits upright and still for some seconds
    #[arg(value_name = "FILE")]
    rest: PathBuf,
    /// Name of the brace's body, such as Shoulderpad or ShoulderpadL
    #[arg(long, value_name = "BODY")]
    body: String,
    /// Recorded poses of brace and upper arm while the arm circles about the shoulder
    #[arg(long, value_name = "FILE", requires = "upper_arm_body")]
    circles: Option<PathBuf>,
    /// Name of the body, or of the single marker, on the upper arm
    #[arg(long, value_name = "BODY", requires = "circles")]
    upper_arm_body: Option<String>,
    /// The arm is worn on the left
    #[arg(long)]
    left_arm: bool,
    /// Where the person looks, counter-clockwise from the tracking system's x axis seen from above (z up)
    #[arg(long, value_name = "DEGREES", default_value_t = 0.0, allow_negative_numbers = true)]
    heading_deg: f64,
    /// From the shoulder to the middle of the body, m
    #[arg(long, value_name = "M", default_value_t = 0.18)]
    half_shoulder_width: f64,
    /// How the box is placed: study_1, study_2 or original
    #[arg(long, value_name = "NAME", default_value = "study_2")]
    box_placement: String,
    /// How far the knees reach ahead of the shoulder, m; needed by study_1
    #[arg(long, value_name = "M")]
    knee_distance: Option<f64>,
    /// Small corrections of the box: ahead, left, up, m, with commas between; the file stands before them
    #[arg(long, value_name = "M,M,M", value_delimiter = ',', num_args = 1..=3, allow_negative_numbers = true)]
    box_offset: Option<Vec<f64>>,
    /// How the tracking system's axes lie, as for serve
    #[arg(long, value_name = "KEY=VALUE,..")]
    mocap_axes: Option<MocapAxes>,
    #[command(flatten)]
    folder: CalibrationsDirArgs,
}

pub(crate) fn run(
    registry: &Registry,
    command: &LocalizeCommand,
    json: bool,
) -> Result<bool, Box<dyn Error>> {
    match command {
        LocalizeCommand::Record(args) => record(registry, args, json),
        LocalizeCommand::Headset(args) => headset(args, json),
        LocalizeCommand::Shoulder(args) => shoulder(args, json),
        LocalizeCommand::Reach(args) => reach(registry, args, json),
        LocalizeCommand::Correct(args) => correct(args, json),
        LocalizeCommand::Show(args) => show(args, json),
    }
}

fn record(registry: &Registry, args: &RecordArgs, json: bool) -> Result<bool, Box<dyn Error>> {
    if !(args.seconds > 0.0 && args.seconds <= 600.0) {
        return Err(format!("--seconds is {}, expected above 0 and at most 600", args.seconds).into());
    }
    check_output(&args.out)?;
    let interrupted = interrupt_flag()?;
    let mut opened = OpenedCapture::open(&registry.captures, &args.source)?;
    let mut log = PoseLog::new(&args.out);
    let mut poses = Vec::new();
    let bar = crate::progress::progress_bar(!json, args.seconds.ceil() as u64, "{elapsed} {bar:40} {msg}");
    // From the first pose on: a system may take its time to answer.
    let (mut began, deadline) = (None, Instant::now() + Duration::from_secs(20));
    while began.is_none_or(|began: Instant| began.elapsed().as_secs_f64() < args.seconds) {
        poses.clear();
        let link = opened.capture.drain_poses(&mut poses)?;
        poses.iter().for_each(|raw| log.push_pose(raw));
        if began.is_none() && !log.is_empty() {
            began = Some(Instant::now());
        }
        if link == CaptureStatus::Ended || interrupted.load(Ordering::Relaxed) {
            break;
        }
        if began.is_none() && Instant::now() > deadline {
            let reason = match link {
                CaptureStatus::Waiting { reason } => reason,
                _ => "no body is streamed".to_owned(),
            };
            return Err(format!("{}: nothing came in 20 s: {reason}", args.source).into());
        }
        bar.set_position(began.map_or(0, |began| began.elapsed().as_secs()));
        bar.set_message(format!("{} poses", log.len()));
        std::thread::sleep(Duration::from_millis(5));
    }
    bar.finish_and_clear();
    log.write()?;
    let report = json!({ "poses": log.len(), "file": args.out });
    print_json_or_text(json, &report, &format!("{} poses in {}", log.len(), args.out.display()))?;
    Ok(!log.is_empty())
}

fn headset(args: &HeadsetArgs, json: bool) -> Result<bool, Box<dyn Error>> {
    check_folder(&args.folder.calibrations)?;
    let axes = args.mocap_axes.unwrap_or_default();
    let recorded = RecordedBodies::open(&args.poses)?;
    // The head is in the page's world, which is in metres with z up.
    let head = recorded.body(&args.head, &MocapAxes::default(), false)?;
    let markers = recorded.body(&args.marker_body, &axes, true)?;
    let found = calibrate_headset(
        &recorded_poses(&head),
        &recorded_poses(&markers),
        &HeadsetCalibrationOptions::default(),
    )?;
    let details = json!({
        "residual_deg": found.residual_deg, "pairs": found.pairs, "rejected": found.rejected,
        "clock_offset_secs": found.clock_offset_secs, "observability": found.observability,
        "drift_m_per_s": found.drift_m_per_s.norm(),
    });
    let known = &found.observability;
    print_status(format_args!(
        "{} pairs, {} of them left out; residual {:.1} mm, {:.2} deg; markers on the headset known to {:.1} mm, {:.2} deg; the head \
         turned by {:.0} (tilt), {:.0} (nod), {:.0} (turn) deg; drift {:.1} mm a minute; clocks {:.0} ms apart",
        found.pairs,
        found.rejected,
        1e3 * found.residual_m,
        found.residual_deg,
        1e3 * known.head_from_markers_m,
        known.head_from_markers_deg,
        known.head_rotation_sd_deg[0],
        known.head_rotation_sd_deg[1],
        known.head_rotation_sd_deg[2],
        6e4 * found.drift_m_per_s.norm(),
        1e3 * found.clock_offset_secs,
    ));
    let marked = HeadsetMarkerCalibration { markers: args.marker_body.clone(), headset: found };
    save(marked, std::slice::from_ref(&args.poses), &args.folder, details, json)
}

fn shoulder(args: &ShoulderArgs, json: bool) -> Result<bool, Box<dyn Error>> {
    check_folder(&args.folder.calibrations)?;
    let axes = args.mocap_axes.unwrap_or_default();
    let profile = PlacementProfile::from_name(&args.box_placement).ok_or_else(|| {
        format!("no box placement {:?}; expected study_1, study_2 or original", args.box_placement)
    })?;
    let rest = RecordedBodies::open(&args.rest)?.body(&args.body, &axes, true)?;
    let circles = match (&args.circles, &args.upper_arm_body) {
        (Some(file), Some(arm)) => {
            let recorded = RecordedBodies::open(file)?;
            let brace = recorded_poses(&recorded.body(&args.body, &axes, true)?);
            Some((brace, recorded_poses(&recorded.body(arm, &axes, false)?)))
        }
        _ => None,
    };
    let correction = args.box_offset.as_deref().unwrap_or(&[0.0; 3]);
    let correction =
        correction.try_into().map_err(|_| "--box-offset takes three numbers: ahead, left, up")?;
    let options = ShoulderOptions {
        left_arm: args.left_arm,
        heading_rad: args.heading_deg.to_radians() + axes.heading_rad,
        half_width_m: args.half_shoulder_width,
        profile,
        legs_ahead_m: args.knee_distance,
        correction_m: correction,
    };
    let circled = circles.as_ref().map(|(brace, arm)| (brace.as_slice(), arm.as_slice()));
    let found: ShoulderCalibration = calibrate_shoulder(&rest, circled, &options)?;
    let position = found.placement.world_from_shoulder.translation.vector;
    let details = json!({
        "moved_m": found.moved_m, "samples": found.samples, "box_ahead_m": found.placement.box_ahead_m,
        "world_from_shoulder": [position.x, position.y, position.z], "center": found.center,
    });
    print_status(format_args!(
        "{} samples, moved by {:.1} mm; the shoulder is at {:.3}, {:.3}, {:.3} m in world, the box {:.2} m ahead of it{}",
        found.samples,
        1e3 * found.moved_m,
        Number(position.x),
        Number(position.y),
        Number(position.z),
        found.placement.box_ahead_m,
        found.center.map_or(String::new(), |fit| format!(
            "; centre of the circles {:.0} mm from the brace's origin, residual {:.1} mm",
            1e3 * fit.center.coords.norm(),
            1e3 * fit.residual_m
        )),
    ));
    let files: Vec<PathBuf> = std::iter::once(&args.rest).chain(&args.circles).cloned().collect();
    save(found, &files, &args.folder, details, json)
}

/// Saves what was found if it is good, and says which.
fn save<T: CalibrationFile>(
    found: T,
    files: &[PathBuf],
    folder: &CalibrationsDirArgs,
    details: Value,
    json: bool,
) -> Result<bool, Box<dyn Error>> {
    let saved = SavedCalibration::new(found, files)?;
    let (verdict, good) = (saved.calibration.verdict(), saved.calibration.is_good());
    // What a trial may rest on is not lost to what it may not.
    let path = if good { Some(saved.save(&folder.calibrations)?) } else { None };
    let report = json!({
        "kind": T::FILE.trim_end_matches(".toml"), "good": good, "verdict": verdict, "made_at": saved.made_at,
        "residual_m": saved.calibration.residual_m(), "file": path, "details": details,
    });
    let saved_text = path.map_or("not saved".to_owned(), |path| format!("saved as {}", path.display()));
    print_json_or_text(json, &report, &format!("{verdict}\n{saved_text}"))?;
    Ok(good)
}

fn show(args: &CalibrationsDirArgs, json: bool) -> Result<bool, Box<dyn Error>> {
    let found = Calibrations::load(&args.calibrations)?;
    let lines = found.summaries();
    let listed: Vec<Value> =
        lines.iter().map(|(kind, line, good)| json!({ "kind": kind, "line": line, "good": good })).collect();
    let mut text: Vec<String> = lines.iter().map(|(kind, line, _)| format!("{kind}: {line}")).collect();
    if text.is_empty() {
        text.push(format!("no calibration in {}", args.calibrations.display()));
    }
    print_json_or_text(json, &json!({ "calibrations": listed }), &text.join("\n"))?;
    Ok(lines.iter().all(|(_, _, good)| *good))
}

/// What a key moves box and table by: ahead, left, up, m.
fn key_step_m(key: char) -> Option<[f64; 3]> {
    const STEP_M: f64 = 0.005;
    Some(match key {
        'w' => [STEP_M, 0.0, 0.0],
        's' => [-STEP_M, 0.0, 0.0],
        'a' => [0.0, STEP_M, 0.0],
        'd' => [0.0, -STEP_M, 0.0],
        'r' => [0.0, 0.0, STEP_M],
        'f' => [0.0, 0.0, -STEP_M],
        _ => return None,
    })
}

fn correct(args: &CalibrationsDirArgs, json: bool) -> Result<bool, Box<dyn Error>> {
    let found: Option<SavedCalibration<ShoulderCalibration>> = SavedCalibration::load(&args.calibrations)?;
    let Some(mut saved) = found else {
        let folder = args.calibrations.display();
        return Err(
            format!("no calibration of the shoulder in {folder}: proact localize shoulder --help").into()
        );
    };
    let words = |correction: &[f64; 3]| {
        let [ahead, left, up] = correction.map(|meters| Number(1e3 * meters));
        format!("the box is moved by {ahead:.0} mm ahead, {left:.0} mm left, {up:.0} mm up in all")
    };
    'lines: for line in std::io::stdin().lines() {
        for key in line?.chars().filter(|key| !key.is_whitespace()) {
            if key == 'q' {
                break 'lines;
            }
            let step = key_step_m(key).ok_or_else(|| {
                format!("key {key:?}; expected w, s, a, d, r, f, or q to end; nothing is saved")
            })?;
            saved.calibration.apply_correction(step)?;
        }
        print_status(words(&saved.calibration.correction_m));
    }
    let file = saved.save(&args.calibrations)?;
    let correction = saved.calibration.correction_m;
    let report = json!({ "correction_m": correction, "box_ahead_m": saved.calibration.placement.box_ahead_m, "file": file });
    print_json_or_text(json, &report, &format!("{}\nsaved as {}", words(&correction), file.display()))?;
    Ok(true)
}

fn reach(registry: &Registry, args: &ReachArgs, json: bool) -> Result<bool, Box<dyn Error>> {
    let (arm, mut config) = args.trial.config(&registry.methods, "seated", None)?;
    let found = Calibrations::load(&args.folder.calibrations)?;
    let used = found.shoulder.as_ref().filter(|saved| saved.calibration.is_good());
    if used.is_some() {
        found.place_person(&mut config.setup);
    }
    let from = match used {
        Some(saved) => format!("from the shoulder that was calibrated {}", saved.summary()),
        None => format!(
            "from the shoulder of the set-up {}; there is no good calibration in {}",
            config.setup.name,
            args.folder.calibrations.display()
        ),
    };
    let task = config.build_task(arm.model())?;
    let map = ReachMap::new(arm.model(), task.scene(), &config.setup.body);
    let report = json!({
        "from": from, "calibrated": used.is_some(), "still_share": map.reachable_fraction(0.0),
        "leaning_share": map.reachable_fraction(f64::INFINITY), "map": map,
    });
    print_json_or_text(json, &report, &format!("{from}\n\n{}", map.to_text_picture()))?;
    Ok(true)
}

fn print_json_or_text(json: bool, object: &Value, text: &str) -> Result<(), Box<dyn Error>> {
    if json {
        print_result_json(object)?
    } else {
        print_result(text)?
    }
    Ok(())
}
