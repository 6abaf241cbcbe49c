//! `proact model`: judge a description of an arm, or turn a lab's own into one.

use crate::model_size::{self, SizeArgs};
use clap::{Args, Subcommand};
use proact_app::{
    Arm, ArmPlacement, allow_lasting_contacts, arm_comparison::compare_arm, arm_picture, place_arm,
    print_result, print_result_json, print_status, trial_obstacle,
};
use proact_arm::{ArmModel, Grasp, PinchError, PinchGrasp, find_pinch};
use proact_description::{
    ArmChoice, ArmFolder, DescriptionError, DescriptionReport, ImportOptions, ImportedArm, MeshFit,
    MeshFolders, arm_choices, check, collect_meshes, import, parse, read_text, settings_template, to_srdf,
    to_urdf, with_pinch,
};
use proact_files::{OutputFile, WriteError, check_folder, check_output, make_folder, write_atomically};
use proact_types::Number;
use serde_json::json;
use std::{
    error::Error,
    fs,
    io::{BufRead, IsTerminal, Write, stdin},
    path::{Path, PathBuf},
    process::Command,
};

/// Number of places that are tried by a trial, and for each other grasp if none of these moved a block.
const PLACE_TRIALS: usize = 12;
const OTHER_GRASP_TRIALS: usize = 4;
/// Files of an imported arm beside its meshes.
const FILES_BESIDE_MESHES: usize = 4;

/// What to do with a description.
#[derive(Debug, Subcommand)]
pub enum ModelCommand {
    /// Say what is wrong, doubtful or noteworthy about an arm's description
    #[command(after_help = "Examples:\n  proact model check my_arm.urdf\n  \
        proact model check my_arm.urdf --srdf my_arm.srdf --json\n  \
        proact model check my_arm --compare\n\n\
        A file is judged as proact model import would take it; of a folder, or an arm that ships with the program, the start of a \
        trial is run too. The exit code is 0 if the arm can be used, warnings or not; with --compare, if all agree as well.")]
    Check(ModelCheckArgs),
    /// Turn an arm in URDF, or in Gazebo's SDF, into a checked folder: URDF, SRDF, settings and meshes
    #[command(
        after_help = "Examples:\n  proact model import gazebo_models/my_arm/model.sdf --out my_arm\n  \
        proact query --urdf my_arm/arm.urdf\n\n\
        Nothing is written unless the result can be used. What the file lacks is completed, and said: docs/arms.md. Without --srdf the \
        arm ends where several joints lead on, and all beyond is the hand; edit the SRDF file to change that."
    )]
    Import(ImportArgs),
    /// Find how the hand of an arm pinches objects of one width, and store it with the hand
    #[command(after_help = "Examples:\n  proact model grasps my_arm --width 25\n  \
        proact model grasps my_arm --width 25 --friction 0.6 --write\n\n\
        Two digits on opposite faces, from above, by the shapes of the model; docs/grasps.md says how. \
        With --write the grasp and its two hand poses go into the arm's SRDF file. The exit code is 1 if none is found.")]
    Grasps(GraspsArgs),
    /// Give an arm the segment lengths of its wearer, by stature, as a folder of its own
    #[command(after_help = "Examples:\n  proact model size mpl_right --stature 1.68 --out arm_168\n  \
        proact demo --arm arm_168 --task bbt\n\n\
        Upper arm 0.186 and forearm 0.146 of the stature (Drillis and Contini 1966, in Winter's book; recalled, not looked up): what lies between shoulder and \
        wrist is stretched along the limb. The hand keeps its size, masses and limits stay.")]
    Size(SizeArgs),
}

/// What of a file is the arm, and where its meshes are.
#[derive(Debug, Default, Args)]
struct ChosenParts {
    /// SRDF file with groups and poses; without it arm and hand are found from the joints
    #[arg(long)]
    srdf: Option<PathBuf>,
    /// Link at the arm's base; by default the root that carries most joints
    #[arg(long, value_name = "LINK")]
    base: Option<String>,
    /// Link at which the arm ends and the hand begins; joints elsewhere are held
    #[arg(long, value_name = "LINK")]
    tip: Option<String>,
    /// Folder that contains packages of meshes, beside those of ROS_PACKAGE_PATH; may be given several times
    #[arg(long, value_name = "DIR")]
    package_path: Vec<PathBuf>,
}

/// Arguments of `proact model check`.
#[derive(Debug, Args)]
pub struct ModelCheckArgs {
    /// URDF file, the folder of an arm, or the name of one that ships with the program
    #[arg(value_name = "FILE|FOLDER|NAME")]
    file: PathBuf,
    #[command(flatten)]
    chosen: ChosenParts,
    /// Print the largest differences between our arithmetic, KDL, urdfdom and both engines of the physics, and where
    #[arg(long)]
    compare: bool,
    /// Random postures that are compared
    #[arg(long, default_value_t = 100, value_parser = clap::value_parser!(u32).range(1..=100_000), requires = "compare")]
    postures: u32,
    /// Seed of the postures
    #[arg(long, default_value_t = 1, requires = "compare")]
    seed: u64,
}

/// Arguments of `proact model import`.
#[derive(Debug, Args)]
pub struct ImportArgs {
    /// URDF file, or SDF file with one model
    file: PathBuf,
    /// Folder for the result; made if it does not exist
    #[arg(long)]
    out: PathBuf,
    #[command(flatten)]
    chosen: ChosenParts,
    /// Leave an arm without a hand as it is; else it gets a gripper with two fingers
    #[arg(long)]
    no_gripper: bool,
    /// Accept what the import suggests: of a robot with several arms, the right one with a hand
    #[arg(long)]
    yes: bool,
    /// Leave out the search for a place of the base and a start pose, by trials of method D
    #[arg(long)]
    no_placement: bool,
    /// Replace files of an earlier import
    #[arg(long)]
    replace: bool,
}

/// Arguments of `proact model grasps`.
#[derive(Debug, Args)]
pub struct GraspsArgs {
    /// Folder of an arm, or its URDF file
    #[arg(value_name = "FILE|FOLDER")]
    arm: PathBuf,
    /// SRDF file with groups and poses, if it is not in the folder
    #[arg(long)]
    srdf: Option<PathBuf>,
    /// Width of the object, a cube, in millimetres
    #[arg(long, value_name = "MM")]
    width: f64,
    /// Coefficient of friction between fingers and object
    #[arg(long, default_value_t = 0.8)]
    friction: f64,
    /// Put the grasp into the SRDF file
    #[arg(long)]
    write: bool,
}

/// Runs the command; false if the description cannot be used. Prints to standard output.
///
/// # Errors
/// A file that cannot be read or written, named.
pub fn run(command: &ModelCommand, json: bool) -> Result<bool, Box<dyn Error>> {
    match command {
        ModelCommand::Check(args) => run_check(args, json),
        ModelCommand::Import(args) => run_import(args, json),
        ModelCommand::Grasps(args) => run_grasps(args, json),
        ModelCommand::Size(args) => model_size::run(args, json),
    }
}

/// An arm that was looked at: its report, and the model and URDF text of a usable one.
struct CheckedArm {
    report: DescriptionReport,
    usable: Option<(ArmModel, String)>,
}

fn run_check(args: &ModelCheckArgs, json: bool) -> Result<bool, Box<dyn Error>> {
    let shipped = args.file.to_str().filter(|_| !args.file.exists()).and_then(ArmFolder::shipped);
    let is_folder = shipped.is_some() || args.file.is_dir();
    if is_folder && (args.chosen.base.is_some() || args.chosen.tip.is_some()) {
        return Err("--base and --tip are for a file: a folder has its arm in its SRDF file".into());
    }
    let CheckedArm { report, usable } = match shipped {
        Some(folder) => check_arm_folder(folder, &args.file)?,
        None if is_folder && args.chosen.srdf.is_none() => {
            check_arm_folder(ArmFolder::read(&args.file)?, &args.file)?
        }
        None => check_file(args)?,
    };
    let compared = match &usable {
        Some((model, urdf)) if args.compare => {
            Some(compare_arm(model, urdf, args.postures as usize, args.seed)?)
        }
        _ => None,
    };
    if json {
        let mut object = serde_json::to_value(&report)?;
        if let Some(compared) = &compared {
            object["comparison"] = serde_json::to_value(compared)?;
        }
        print_result_json(&object)?;
    } else {
        let urdf = match args.file.is_dir() {
            true => proact_description::arm_files(&args.file)?.0,
            false => args.file.clone(),
        };
        print_result(report.of_file(&urdf))?;
        if report.usable && !is_folder {
            let file = args.file.display();
            print_result(format_args!("a trial needs a folder: proact model import {file} --out FOLDER"))?;
        }
        if let Some(compared) = &compared {
            print_result(compared)?;
        }
    }
    Ok(report.usable && compared.is_none_or(|compared| compared.agrees()))
}

/// The verdict on an arm that is complete: its description, and that a trial runs with it.
fn check_arm_folder(folder: ArmFolder, path: &Path) -> Result<CheckedArm, Box<dyn Error>> {
    let mut report = check(&folder.urdf, folder.srdf.as_deref());
    if !report.usable {
        return Ok(CheckedArm { report, usable: None });
    }
    let urdf = folder.urdf.clone();
    // What a trial would miss too: meshes, poses, and what the settings name.
    let arm = Arm::from_folder(folder, path, false)?;
    match trial_obstacle(&arm) {
        None => Ok(CheckedArm { report, usable: Some(((**arm.model()).clone(), urdf)) }),
        Some(finding) => {
            report.usable = false;
            report.findings.insert(0, finding);
            Ok(CheckedArm { report, usable: None })
        }
    }
}

/// The verdict on the files of an arm: what an import says of them.
fn check_file(args: &ModelCheckArgs) -> Result<CheckedArm, Box<dyn Error>> {
    let (urdf, srdf) = match args.file.is_dir() {
        true => proact_description::arm_files(&args.file)?,
        false => (args.file.clone(), None),
    };
    let srdf = args.chosen.srdf.clone().or(srdf).as_deref().map(read_text).transpose()?;
    let meshes = MeshFolders::with_ros_packages(&urdf, &args.chosen.package_path);
    let options = ImportOptions {
        srdf: srdf.as_deref(),
        base: args.chosen.base.as_deref(),
        tip: args.chosen.tip.as_deref(),
        meshes: Some(&meshes),
        without_gripper: false,
    };
    match import(&read_description(&urdf)?, &options) {
        Ok(ImportedArm { report, model, urdf, .. }) => Ok(CheckedArm { report, usable: Some((model, urdf)) }),
        Err(DescriptionError::Invalid { findings }) => {
            Ok(CheckedArm { report: DescriptionReport::refused(findings), usable: None })
        }
        Err(error) => Err(error.into()),
    }
}

fn run_import(args: &ImportArgs, json: bool) -> Result<bool, Box<dyn Error>> {
    check_folder(&args.out).map_err(|error| format!("{error}. Choose another folder with --out"))?;
    let srdf = args.chosen.srdf.as_deref().map(read_text).transpose()?;
    let meshes = MeshFolders::with_ros_packages(&args.file, &args.chosen.package_path);
    let text = read_description(&args.file)?;
    let named = args.chosen.srdf.is_some() || args.chosen.base.is_some() || args.chosen.tip.is_some();
    let choice = match named || args.yes || json || !stdin().is_terminal() {
        true => None,
        false => ask_for_arm(&arm_choices(&text), &mut stdin().lock())?,
    };
    let (base, tip) = choice.map(|choice| (choice.base, choice.tip)).unzip();
    let options = ImportOptions {
        srdf: srdf.as_deref(),
        base: args.chosen.base.as_deref().or(base.as_deref()),
        tip: args.chosen.tip.as_deref().or(tip.as_deref()),
        meshes: Some(&meshes),
        without_gripper: args.no_gripper,
    };
    match import(&text, &options) {
        Ok(mut imported) => {
            if args.chosen.srdf.is_none() {
                let allowed = allow_lasting_contacts(&mut imported.model)?;
                imported.srdf = to_srdf(&imported.model);
                if !allowed.is_empty() {
                    let pairs: Vec<String> = allowed.iter().map(|pair| pair.join(" and ")).collect();
                    imported
                        .found
                        .push(format!("shapes overlap lastingly and may touch: {}", pairs.join(", ")));
                }
            }
            if !args.no_placement {
                place(&mut imported)?;
            }
            let (files, missing) = write_arm_folder(&imported, &meshes, &args.out, args.replace)?;
            if json {
                let mut object = serde_json::to_value(&imported.report)?;
                object["urdf"] = json!(files[0]);
                object["srdf"] = json!(files[1]);
                object["settings"] = json!(files[2]);
                object["picture"] = json!(files[3]);
                object["missing_meshes"] = json!(missing);
                object["mesh_fits"] = json!(imported.fits);
                object["found"] = json!(imported.found);
                print_result_json(&object)?;
            } else {
                print_result(imported.report.of_file(&args.file))?;
                for sentence in &imported.found {
                    print_result(format_args!("found: {sentence}"))?;
                }
                print_fits(&imported.fits)?;
                for address in missing {
                    print_result(format_args!(
                        "mesh {address} is not drawn; its link is drawn by its collision shapes"
                    ))?;
                }
                let meshes = files.len() - FILES_BESIDE_MESHES;
                let [urdf, srdf, settings, picture] = [0, 1, 2, 3].map(|file| files[file].display());
                print_result(format_args!(
                    "wrote {urdf}, {srdf}, {settings}, {meshes} meshes, and {picture} to look at"
                ))?;
            }
            Ok(true)
        }
        Err(DescriptionError::Invalid { findings }) => {
            let report = DescriptionReport::refused(findings);
            if json {
                print_report(&report)?
            } else {
                print_result(format_args!("{}\nnothing was written", report.of_file(&args.file)))?
            }
            Ok(false)
        }
        Err(error) => Err(error.into()),
    }
}

/// Which arm of a robot is meant: none if there is nothing to choose.
fn ask_for_arm(
    choices: &[ArmChoice],
    answers: &mut impl BufRead,
) -> Result<Option<ArmChoice>, Box<dyn Error>> {
    if choices.len() < 2 {
        return Ok(None);
    }
    print_status("The file describes several arms:");
    for (number, ArmChoice { base, tip, joints, has_hand }) in (1..).zip(choices) {
        let hand = if *has_hand { "with" } else { "without" };
        print_status(format_args!("  {number}  {joints} joints from {base} to {tip}, {hand} a hand"));
    }
    loop {
        print_status("Which one? A number, or Enter for 1:");
        let mut line = String::new();
        if answers.read_line(&mut line)? == 0 || line.trim().is_empty() {
            return Ok(choices.first().cloned());
        }
        let mut numbered = (1..).map(|number: usize| number.to_string()).zip(choices);
        match numbered.find(|(number, _)| number == line.trim()) {
            Some((_, choice)) => return Ok(Some(choice.clone())),
            None => print_status(format_args!("expected a number from 1 to {}", choices.len())),
        }
    }
}

/// Finds where the arm stands and how a trial begins with it.
fn place(imported: &mut ImportedArm) -> Result<(), Box<dyn Error>> {
    if imported.model.hand.is_empty() {
        imported.found.push("it has no hand, so that no trial can be run with it".to_owned());
        return Ok(());
    }
    let mut placement = place_arm(&mut imported.model, PLACE_TRIALS)?;
    // Where no search vouches for a grasp, trials tell which one holds.
    let moved = |place: &Option<ArmPlacement>| place.as_ref().and_then(|place| place.blocks_moved);
    for mut other in std::mem::take(&mut imported.other_grasps) {
        if placement.is_none() || moved(&placement) > Some(0) {
            break;
        }
        other.model.allowed_collisions.clone_from(&imported.model.allowed_collisions);
        let place = place_arm(&mut other.model, OTHER_GRASP_TRIALS)?;
        if moved(&place) > Some(0) {
            imported.model = other.model;
            imported.found.retain(|said| !said.starts_with("the hand closes between"));
            imported.found.push(other.sentence);
            placement = place;
        }
    }
    let said = match placement {
        None => "no place of the base was found from which the hand reaches the blocks".to_owned(),
        Some(ArmPlacement { base, reached, blocks_moved, reason, .. }) => {
            imported.srdf = to_srdf(&imported.model);
            imported.found.retain(|said| !said.starts_with("pose \"start\""));
            let reason =
                |at: &str| reason.as_ref().map_or_else(String::new, |reason| format!("{at}: {reason}"));
            let moved = match blocks_moved {
                Some(0) => {
                    let why = reason("; its last plan failed");
                    format!("a simulated person moved none of 4 blocks in 100 s with method D{why}")
                }
                Some(count) => {
                    format!("a simulated person moved {count} of 4 blocks in 100 s with method D")
                }
                None => reason("no trial could be run"),
            };
            format!(
                "the base stands at {:.2} {:.2} {:.2} m, from where the hand reaches {:.0} % of blocks and targets, obstacles aside; {moved}",
                base.x,
                base.y,
                base.z,
                1e2 * reached
            )
        }
    };
    imported.found.push(said);
    Ok(())
}

/// The text of a description; one with xacro macros is expanded by `xacro`, where that is installed.
fn read_description(file: &Path) -> Result<String, Box<dyn Error>> {
    const XACRO_SECS: &str = "60";
    /// What `timeout` exits with: the time was up, and there is no such program.
    const TIMED_OUT: i32 = 124;
    const NOT_FOUND: i32 = 127;
    let text = read_text(file)?;
    // A xacro file is a program. Only one that is named as such is run.
    if file.extension().is_none_or(|extension| extension != "xacro") {
        return Ok(text);
    }
    // Without the program the reader says what to do.
    let Ok(output) = Command::new("timeout").args([XACRO_SECS, "xacro"]).arg(file).output() else {
        return Ok(text);
    };
    let failed = |reason: &str| format!("xacro cannot expand {}: {reason}", file.display());
    match output.status.code() {
        Some(0) => Ok(String::from_utf8_lossy(&output.stdout).into_owned()),
        Some(NOT_FOUND) => Ok(text),
        Some(TIMED_OUT) => Err(failed(&format!("it takes longer than {XACRO_SECS} s")).into()),
        _ => {
            let reason = String::from_utf8_lossy(&output.stderr);
            let lines: Vec<&str> = reason.lines().map(str::trim).filter(|line| !line.is_empty()).collect();
            let reason = if lines.is_empty() { "it gave no reason".to_owned() } else { lines.join("; ") };
            Err(failed(&reason).into())
        }
    }
}

fn run_grasps(args: &GraspsArgs, json: bool) -> Result<bool, Box<dyn Error>> {
    let (urdf, srdf) = match args.arm.is_dir() {
        true => proact_description::arm_files(&args.arm)?,
        false => (args.arm.clone(), None),
    };
    let path = args.srdf.clone().or(srdf).ok_or_else(|| {
        let arm = args.arm.display();
        format!("{arm} has no SRDF file, which says what the hand is: give one with --srdf")
    })?;
    if args.write {
        check_output(&path)?;
    }
    let srdf = read_text(&path)?;
    let model = parse(&read_text(&urdf)?, &srdf)?;
    let pinch = match find_pinch(&model, args.width / 1e3, args.friction) {
        Ok(pinch) => pinch,
        Err(error @ PinchError::NotFound { .. }) => {
            if json {
                print_result_json(&json!({ "found": false, "reason": error.to_string() }))?
            } else {
                print_result(&error)?
            }
            return Ok(false);
        }
        Err(error) => return Err(error.into()),
    };
    if args.write {
        let text = with_pinch(&srdf, &model, &pinch, &pinch_summary(&pinch, args))?;
        // What is written must be what can be read.
        parse(&read_text(&urdf)?, &text)?;
        write_atomically(&path, text)?;
    }
    if json {
        print_result_json(&json!({
            "found": true, "width_m": args.width / 1e3, "friction": args.friction, "digits": pinch.digits,
            "angle_rad": pinch.contact_angle_rad, "cone_rad": pinch.cone_half_angle_rad, "gap_closed_m": pinch.gaps_m[0],
            "gap_open_m": pinch.gaps_m[1], "table_air_m": pinch.table_clearance_m, "reach_m": pinch.overhang_m,
            "grasp": pinch.grasp, "written": args.write.then_some(&path),
        }))?;
    } else {
        print_result(pinch_summary(&pinch, args))?;
        let Grasp { center, roll_rad: roll, roll_range_rad: roll_range, max_lean_rad: lean, .. } =
            &pinch.grasp;
        let degrees = |rad: f64| Number(rad.to_degrees());
        print_result(format_args!(
            "centre {:.1} {:.1} {:.1} mm in the tip's frame; roll {:.0} degrees ({:.0} to {:.0}), lean up to {:.0}",
            Number(1e3 * center.x),
            Number(1e3 * center.y),
            Number(1e3 * center.z),
            degrees(*roll),
            degrees(roll_range[0]),
            degrees(roll_range[1]),
            degrees(*lean)
        ))?;
        print_result(match args.write {
            true => format!("wrote {}", path.display()),
            false => "nothing was written: --write stores it with the hand".to_owned(),
        })?;
    }
    Ok(true)
}

/// What was found, in one paragraph.
fn pinch_summary(pinch: &PinchGrasp, args: &GraspsArgs) -> String {
    format!(
        "Found by proact model grasps for a cube of {} mm and a friction of {}: {} against {}, line through the contacts \
         {:.1} degrees off the faces' normals (cone of friction: {:.1}), {:.1} mm between the digits when closed and {:.1} \
         before, {:.1} mm above the table, {:.0} mm beyond the object's faces when open and {:.0} mm beside its middle.",
        args.width,
        args.friction,
        pinch.digits[0],
        pinch.digits[1],
        pinch.contact_angle_rad.to_degrees(),
        pinch.cone_half_angle_rad.to_degrees(),
        1e3 * pinch.gaps_m[0],
        1e3 * pinch.gaps_m[1],
        1e3 * pinch.table_clearance_m,
        1e3 * pinch.overhang_m[0],
        1e3 * pinch.overhang_m[1]
    )
}

/// How well primitives enclose the meshes of the links.
fn print_fits(fits: &[MeshFit]) -> Result<(), Box<dyn Error>> {
    if fits.is_empty() {
        return Ok(());
    }
    let width = fits.iter().map(|fit| fit.link.chars().count()).max().unwrap_or_default().max(4);
    print_result(format_args!("\n{:width$}  shapes  volume, cm^3  convex hulls, cm^3  excess", "link"))?;
    for fit in fits {
        print_result(format_args!(
            "{:width$}  {:6}  {:12.1}  {:18.1}  {:5.0} %",
            fit.link,
            fit.shapes,
            Number(fit.volume_cm3),
            Number(fit.hull_volume_cm3),
            Number(100.0 * fit.excess())
        ))?;
    }
    Ok(())
}

fn print_report(report: &DescriptionReport) -> Result<(), Box<dyn Error>> {
    Ok(print_result_json(report)?)
}

/// Writes the arm's folder: descriptions, settings and meshes; what was written, and the meshes that were not found. The
/// files have other names until all of them are there, so that a full disk leaves no half of an arm.
fn write_arm_folder(
    imported: &ImportedArm,
    meshes: &MeshFolders,
    folder: &Path,
    replace: bool,
) -> Result<(Vec<PathBuf>, Vec<String>), Box<dyn Error>> {
    // The robot's name comes from a file; only harmless characters may reach the file system.
    let harmless = |c: char| if c.is_ascii_alphanumeric() || "_-".contains(c) { c } else { '_' };
    let name: String = imported.model.name.chars().map(harmless).collect();
    let mut model = imported.model.clone();
    let (meshes, missing) = collect_meshes(&mut model, &name, meshes);
    let mut files = vec![
        ("arm.urdf".to_owned(), to_urdf(&model).into_bytes()),
        ("arm.srdf".to_owned(), imported.srdf.clone().into_bytes()),
        ("arm.toml".to_owned(), settings_template(&model).into_bytes()),
        ("arm.svg".to_owned(), arm_picture(&model, &imported.mesh_points)?.into_bytes()),
    ];
    files.extend(meshes.into_iter().map(|(name, bytes)| (format!("meshes/{name}"), bytes)));
    let made_folder = !folder.exists();
    let deepest = if files.len() > FILES_BESIDE_MESHES { folder.join("meshes") } else { folder.to_owned() };
    let failed = |error: WriteError| format!("{error}. Choose another folder with --out");
    make_folder(&deepest).map_err(failed)?;
    let path = |(name, _): &(String, Vec<u8>)| folder.join(name);
    if let Some(taken) = files.iter().map(path).find(|path| path.exists() && !replace) {
        let taken = taken.display();
        return Err(
            format!("{taken} exists already. Add --replace to replace it, or choose another --out").into()
        );
    }
    let grow = |file: &(String, Vec<u8>)| {
        let mut grown = OutputFile::create(&path(file)).map_err(failed)?;
        grown.write_all(&file.1).map_err(|error| format!("{error}. Choose another folder with --out"))?;
        Ok(grown)
    };
    let grown: Result<Vec<OutputFile>, String> = files.iter().map(grow).collect();
    let placed = grown.and_then(|grown| grown.into_iter().try_for_each(OutputFile::finish).map_err(failed));
    if let Err(error) = placed {
        // What is left over says nothing to anyone; the error that matters is the first.
        if made_folder {
            drop(fs::remove_dir(&deepest));
            drop(fs::remove_dir(folder));
        }
        return Err(error.into());
    }
    Ok((files.iter().map(path).collect(), missing))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proact_description::{MPL_RIGHT_ARM_SRDF, MPL_RIGHT_ARM_URDF, load};

    fn import_args(file: PathBuf, out: PathBuf, replace: bool) -> ModelCommand {
        ModelCommand::Import(ImportArgs {
            file,
            out,
            chosen: ChosenParts::default(),
            no_gripper: false,
            yes: false,
            no_placement: true,
            replace,
        })
    }

    #[test]
    fn an_imported_arm_can_be_loaded_and_is_not_overwritten_unasked() {
        let folder = tempfile::tempdir().unwrap();
        let (file, out) = (folder.path().join("a.urdf"), folder.path().join("out"));
        fs::write(&file, MPL_RIGHT_ARM_URDF).unwrap();
        assert!(run(&import_args(file.clone(), out.clone(), false), false).unwrap());
        let (urdf, srdf) = (out.join("arm.urdf"), out.join("arm.srdf"));
        assert_eq!(load(&urdf, Some(&srdf)).unwrap().moving_count(), 27);
        assert_eq!(
            fs::read_dir(&out).unwrap().count(),
            4,
            "no part file is left, and its meshes are nowhere"
        );
        let folder = ArmFolder::read(&out).unwrap();
        assert_eq!((folder.meshes.len(), folder.model().unwrap().settings.joints.len()), (0, 7));

        let error = run(&import_args(file.clone(), out.clone(), false), false).unwrap_err().to_string();
        assert!(error.contains("exists already") && error.contains("--replace"), "{error}");
        assert!(run(&import_args(file, out, true), true).unwrap());
    }

    #[test]
    fn an_imported_arm_takes_its_meshes_along() {
        let folder = tempfile::tempdir().unwrap();
        let shipped =
            concat!(env!("CARGO_MANIFEST_DIR"), "/../../ros1_ws/src/proact_description/arms/mpl_right");
        let out = folder.path().join("out");
        assert!(run(&import_args(Path::new(shipped).join("arm.urdf"), out.clone(), false), false).unwrap());
        let arm = ArmFolder::read(&out).unwrap();
        let original = ArmFolder::shipped("mpl_right").unwrap();
        assert!(!arm.meshes.is_empty() && arm.meshes.len() == original.meshes.len());
        let ids = |folder: &ArmFolder| -> std::collections::BTreeSet<String> {
            folder.meshes.values().map(|bytes| proact_description::mesh_id(bytes)).collect()
        };
        assert_eq!(ids(&arm), ids(&original));
        assert!(arm.meshes.keys().all(|address| address.starts_with("package://mpl_right_arm/meshes/")));
    }

    fn check_args(file: PathBuf) -> ModelCommand {
        ModelCommand::Check(ModelCheckArgs {
            file,
            chosen: ChosenParts::default(),
            compare: false,
            postures: 1,
            seed: 1,
        })
    }

    #[test]
    fn check_says_of_a_file_what_an_import_would_and_of_a_folder_what_a_trial_would() {
        let folder = tempfile::tempdir().unwrap();
        let (file, out) = (folder.path().join("a.urdf"), folder.path().join("out"));
        // A frame with a mass of zero, which a description itself may not have.
        let frame = "<link name=\"tcp\"><inertial><mass value=\"0\"/><inertia ixx=\"0\" ixy=\"0\" ixz=\"0\" iyy=\"0\" \
            iyz=\"0\" izz=\"0\"/></inertial></link><joint name=\"tcp_joint\" type=\"fixed\">\
            <parent link=\"mpl_right_arm__wristz_link\"/><child link=\"tcp\"/></joint></robot>";
        fs::write(&file, MPL_RIGHT_ARM_URDF.replace("</robot>", frame)).unwrap();
        assert!(run(&check_args(file.clone()), true).unwrap());
        assert!(!out.exists());
        assert!(run(&import_args(file, out.clone(), false), true).unwrap());
        assert!(run(&check_args(out.clone()), true).unwrap());

        // The elbow far beyond its limits.
        let srdf = fs::read_to_string(out.join("arm.srdf")).unwrap();
        let start = srdf.find("name=\"start\"").unwrap();
        let value = start + srdf[start..].find("value=\"").unwrap() + 7;
        let end = value + srdf[value..].find('"').unwrap();
        fs::write(out.join("arm.srdf"), format!("{}9{}", &srdf[..value], &srdf[end..])).unwrap();
        assert!(!run(&check_args(out.clone()), true).unwrap_or(false));
        fs::write(out.join("arm.srdf"), srdf.replace("name=\"start\"", "name=\"begin\"")).unwrap();
        let error = run(&check_args(out), true).unwrap_err().to_string();
        assert!(error.contains("start"), "{error}");
    }

    #[test]
    fn one_of_several_arms_is_asked_for() {
        let arm = |name: &str| ArmChoice {
            base: format!("{name}_base"),
            tip: format!("{name}_palm"),
            joints: 7,
            has_hand: true,
        };
        let choices = [arm("right"), arm("left")];
        let ask = |answers: &str| ask_for_arm(&choices, &mut answers.as_bytes()).unwrap().unwrap().base;
        assert_eq!(
            ["2\n", "\n", "", "9\nno\n2\n"].map(ask),
            ["left_base", "right_base", "right_base", "left_base"]
        );
        assert_eq!(ask_for_arm(&choices[..1], &mut "".as_bytes()).unwrap(), None);
    }

    #[test]
    fn an_arm_that_cannot_be_used_fails_and_writes_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let (file, out) = (folder.path().join("a.urdf"), folder.path().join("out"));
        fs::write(&file, MPL_RIGHT_ARM_URDF.replacen("<parent link=\"", "<parent link=\"nowhere_", 1))
            .unwrap();
        assert!(!run(&import_args(file.clone(), out.clone(), false), false).unwrap());
        assert!(!out.exists());
        assert!(!run(&check_args(file), true).unwrap());
    }

    #[test]
    fn check_accepts_our_arm_and_names_a_file_that_is_not_there() {
        let folder = tempfile::tempdir().unwrap();
        let (file, srdf) = (folder.path().join("a.urdf"), folder.path().join("a.srdf"));
        fs::write(&file, MPL_RIGHT_ARM_URDF).unwrap();
        fs::write(&srdf, MPL_RIGHT_ARM_SRDF).unwrap();
        assert!(
            run(
                &ModelCommand::Check(ModelCheckArgs {
                    file,
                    chosen: ChosenParts { srdf: Some(srdf), ..ChosenParts::default() },
                    compare: true,
                    postures: 5,
                    seed: 1
                }),
                false
            )
            .unwrap()
        );
        let missing = folder.path().join("none.urdf");
        let error = run(&check_args(missing), false).unwrap_err();
        assert!(error.to_string().contains("none.urdf"), "{error}");
    }

    #[test]
    fn an_output_that_cannot_be_written_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let (file, out) = (folder.path().join("a.urdf"), folder.path().join("a.urdf/below"));
        fs::write(&file, MPL_RIGHT_ARM_URDF).unwrap();
        let error = run(&import_args(file, out, false), false).unwrap_err().to_string();
        assert!(
            error.contains("cannot write") && error.contains("below") && error.contains("--out"),
            "{error}"
        );
    }
}
