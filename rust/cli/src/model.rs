//! `proact model`: judge a description of an arm, or turn a lab's own into one.

use clap::{Args, Subcommand};
use proact_app::{answer, compare::compare};
use proact_description::{DescriptionError, Imported, Report, check, import, parse, parse_urdf, read_text};
use serde_json::json;
use std::{
    error::Error,
    fs,
    path::{Path, PathBuf},
};

/// What to do with a description.
#[derive(Debug, Subcommand)]
pub enum ModelCommand {
    /// Say what is wrong, doubtful or noteworthy about an arm's description
    #[command(after_help = "Examples:\n  proact model check my_arm.urdf\n  \
        proact model check my_arm.urdf --srdf my_arm.srdf --json\n  \
        proact model check my_arm --compare\n\n\
        The exit code is 0 if the description can be used, warnings or not; with --compare, if all agree as well.")]
    Check(CheckArgs),
    /// Turn an arm in URDF, or in Gazebo's SDF, into a checked URDF and SRDF
    #[command(
        after_help = "Examples:\n  proact model import gazebo_models/my_arm/model.sdf --out my_arm\n  \
        proact query --urdf my_arm/my_arm.urdf\n\n\
        Nothing is written unless the result can be used. Without --srdf the arm ends where the tree of links \
        branches, and all beyond is the hand; edit the SRDF file to change that."
    )]
    Import(ImportArgs),
}

/// Arguments of `proact model check`.
#[derive(Debug, Args)]
pub struct CheckArgs {
    /// URDF file, or the folder of an arm with one URDF, at most one SRDF, and its meshes
    #[arg(value_name = "FILE|FOLDER")]
    file: PathBuf,
    /// SRDF file with groups and poses; without it they are guessed
    #[arg(long)]
    srdf: Option<PathBuf>,
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
    /// SRDF file with groups and poses; without it they are guessed
    #[arg(long)]
    srdf: Option<PathBuf>,
    /// Replace files of an earlier import
    #[arg(long)]
    force: bool,
}

/// Runs the command; false if the description cannot be used. Prints to standard output.
///
/// # Errors
/// A file that cannot be read or written, named.
pub fn run(command: &ModelCommand, json: bool) -> Result<bool, Box<dyn Error>> {
    match command {
        ModelCommand::Check(args) => run_check(args, json),
        ModelCommand::Import(args) => run_import(args, json),
    }
}

fn run_check(args: &CheckArgs, json: bool) -> Result<bool, Box<dyn Error>> {
    let (urdf, srdf) = match args.file.is_dir() {
        true => proact_app::arm_files(&args.file)?,
        false => (args.file.clone(), None),
    };
    let srdf = args.srdf.clone().or(srdf);
    let (urdf, srdf) = (read_text(&urdf)?, srdf.as_deref().map(read_text).transpose()?);
    let report = check(&urdf, srdf.as_deref());
    let compared = if args.compare && report.usable {
        let model = match &srdf {
            Some(srdf) => parse(&urdf, srdf)?,
            None => parse_urdf(&urdf)?,
        };
        Some(compare(&model, &urdf, args.postures as usize, args.seed)?)
    } else {
        None
    };
    if json {
        let mut object = serde_json::to_value(&report)?;
        if let Some(compared) = &compared {
            object["comparison"] = serde_json::to_value(compared)?;
        }
        answer(&object)?;
    } else {
        answer(&report)?;
        if let Some(compared) = &compared {
            answer(compared)?;
        }
    }
    if args.file.is_dir() && report.usable {
        // What a trial would miss too: the meshes.
        proact_app::Arm::in_folder(&args.file)?;
    }
    Ok(report.usable && compared.is_none_or(|compared| compared.agrees()))
}

fn run_import(args: &ImportArgs, json: bool) -> Result<bool, Box<dyn Error>> {
    let srdf = args.srdf.as_deref().map(read_text).transpose()?;
    match import(&read_text(&args.file)?, srdf.as_deref()) {
        Ok(imported) => {
            let (urdf, srdf) = write(&imported, &args.out, args.force)?;
            if json {
                let mut object = serde_json::to_value(&imported.report)?;
                object["urdf"] = json!(urdf);
                object["srdf"] = json!(srdf);
                answer(&object)?;
            } else {
                answer(format_args!("{}\nwrote {} and {}", imported.report, urdf.display(), srdf.display()))?;
            }
            Ok(true)
        }
        Err(DescriptionError::Invalid { findings }) => {
            let report = Report { usable: false, summary: None, findings };
            if json {
                print_json(&report)?
            } else {
                answer(format_args!("{report}\nnothing was written"))?
            }
            Ok(false)
        }
        Err(error) => Err(error.into()),
    }
}

fn print_json(report: &Report) -> Result<(), Box<dyn Error>> {
    Ok(answer(serde_json::to_string(report)?)?)
}

/// Writes both files under other names first, so that a full disk leaves no half of a description.
fn write(imported: &Imported, folder: &Path, force: bool) -> Result<(PathBuf, PathBuf), Box<dyn Error>> {
    // The robot's name comes from a file; only harmless characters may reach the file system.
    let harmless = |c: char| if c.is_ascii_alphanumeric() || "_-".contains(c) { c } else { '_' };
    let name: String = imported.model.name.chars().map(harmless).collect();
    let failed = |path: &Path, error: std::io::Error| {
        format!("cannot write {}: {error}. Choose another folder with --out", path.display())
    };
    let made_folder = !folder.exists();
    fs::create_dir_all(folder).map_err(|error| failed(folder, error))?;
    let paths = [folder.join(format!("{name}.urdf")), folder.join(format!("{name}.srdf"))];
    if let Some(taken) = paths.iter().find(|path| path.exists() && !force) {
        let taken = taken.display();
        return Err(
            format!("{taken} exists already. Add --force to replace it, or choose another --out").into()
        );
    }
    let parts = ["urdf.part", "srdf.part"].map(|ending| folder.join(format!("{name}.{ending}")));
    let written = parts
        .iter()
        .zip([&imported.urdf, &imported.srdf])
        .try_for_each(|(part, text)| fs::write(part, text).map_err(|error| failed(part, error)));
    let placed = written.and_then(|()| {
        parts
            .iter()
            .zip(&paths)
            .try_for_each(|(part, path)| fs::rename(part, path).map_err(|error| failed(path, error)))
    });
    if let Err(error) = placed {
        // What is left over says nothing to anyone; the error that matters is the first.
        parts.iter().for_each(|part| drop(fs::remove_file(part)));
        if made_folder {
            drop(fs::remove_dir(folder));
        }
        return Err(error.into());
    }
    let [urdf, srdf] = paths;
    Ok((urdf, srdf))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proact_description::{MPL_RIGHT_ARM_SRDF, MPL_RIGHT_ARM_URDF, load};

    fn import_args(file: PathBuf, out: PathBuf, force: bool) -> ModelCommand {
        ModelCommand::Import(ImportArgs { file, out, srdf: None, force })
    }

    #[test]
    fn an_imported_arm_can_be_loaded_and_is_not_overwritten_unasked() {
        let folder = tempfile::tempdir().unwrap();
        let (file, out) = (folder.path().join("a.urdf"), folder.path().join("out"));
        fs::write(&file, MPL_RIGHT_ARM_URDF).unwrap();
        assert!(run(&import_args(file.clone(), out.clone(), false), false).unwrap());
        let (urdf, srdf) = (out.join("mpl_right_arm.urdf"), out.join("mpl_right_arm.srdf"));
        assert_eq!(load(&urdf, Some(&srdf)).unwrap().moving_count(), 27);
        assert_eq!(fs::read_dir(&out).unwrap().count(), 2, "no part file is left");

        let error = run(&import_args(file.clone(), out.clone(), false), false).unwrap_err().to_string();
        assert!(error.contains("exists already") && error.contains("--force"), "{error}");
        assert!(run(&import_args(file, out, true), true).unwrap());
    }

    #[test]
    fn an_arm_that_cannot_be_used_fails_and_writes_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let (file, out) = (folder.path().join("a.urdf"), folder.path().join("out"));
        fs::write(
            &file,
            MPL_RIGHT_ARM_URDF.replacen("<mass value=\"0.0363799\"/>", "<mass value=\"0\"/>", 1),
        )
        .unwrap();
        assert!(!run(&import_args(file.clone(), out.clone(), false), false).unwrap());
        assert!(!out.exists());
        assert!(
            !run(
                &ModelCommand::Check(CheckArgs { file, srdf: None, compare: false, postures: 1, seed: 1 }),
                true
            )
            .unwrap()
        );
    }

    #[test]
    fn check_accepts_our_arm_and_names_a_file_that_is_not_there() {
        let folder = tempfile::tempdir().unwrap();
        let (file, srdf) = (folder.path().join("a.urdf"), folder.path().join("a.srdf"));
        fs::write(&file, MPL_RIGHT_ARM_URDF).unwrap();
        fs::write(&srdf, MPL_RIGHT_ARM_SRDF).unwrap();
        assert!(
            run(
                &ModelCommand::Check(CheckArgs {
                    file,
                    srdf: Some(srdf),
                    compare: true,
                    postures: 5,
                    seed: 1
                }),
                false
            )
            .unwrap()
        );
        let missing = folder.path().join("none.urdf");
        let error = run(
            &ModelCommand::Check(CheckArgs {
                file: missing,
                srdf: None,
                compare: false,
                postures: 1,
                seed: 1,
            }),
            false,
        )
        .unwrap_err();
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
