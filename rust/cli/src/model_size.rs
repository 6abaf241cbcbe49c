//! `proact model size`: an arm in the size of its wearer.

use clap::Args;
use proact_app::print_result;
use proact_arm::{SegmentLengths, VisualGeometry, scale_to_stature};
use proact_description::{ArmFolder, to_urdf};
use proact_files::{check_folder, make_folder, resolve_links, write_atomically};
use serde_json::json;
use std::{error::Error, fs, path::PathBuf};

/// Arguments of `proact model size`.
#[derive(Debug, Args)]
pub struct SizeArgs {
    /// An arm that ships with the program, or the folder of one
    #[arg(value_name = "NAME|FOLDER")]
    arm: String,
    /// Stature of the wearer, metres
    #[arg(long, value_name = "M")]
    stature: f64,
    /// Folder for the result, which must not exist
    #[arg(long)]
    out: PathBuf,
}

/// Writes the folder and says what changed.
///
/// # Errors
/// An arm that cannot be stretched, a folder that is there already, a file that cannot be written.
pub fn run(args: &SizeArgs, json: bool) -> Result<bool, Box<dyn Error>> {
    check_folder(&args.out)?;
    let folder = match ArmFolder::shipped(&args.arm) {
        Some(folder) => folder,
        None => ArmFolder::read(args.arm.as_ref())?,
    };
    let (mut model, [before, after]) = scale_to_stature(&folder.model()?, args.stature)?;
    let mut meshes = Vec::new();
    for (number, (address, bytes)) in folder.meshes.iter().enumerate() {
        // Two meshes of one name, from different folders, keep apart by their number.
        let name = address.rsplit('/').next().unwrap_or(address);
        let file = format!("{number}_{name}");
        let here = format!("package://{}/meshes/{file}", model.name);
        for visual in model.links.iter_mut().flat_map(|link| &mut link.visuals) {
            if let VisualGeometry::Mesh { file, .. } = &mut visual.geometry
                && file == address
            {
                file.clone_from(&here);
            }
        }
        meshes.push((file, bytes));
    }
    let out = &resolve_links(&args.out)?;
    let failed = |error: std::io::Error| {
        format!("cannot write {}: {error}. Choose another folder with --out", out.display())
    };
    if out.exists() {
        return Err(format!("{} exists already, expected a new folder", out.display()).into());
    }
    // Only a whole folder gets the name that was asked for.
    let part = out.with_extension("part");
    let write = || {
        make_folder(&part.join("meshes"))?;
        write_atomically(&part.join("arm.urdf"), to_urdf(&model))?;
        folder.srdf.iter().try_for_each(|text| write_atomically(&part.join("arm.srdf"), text))?;
        folder
            .settings
            .iter()
            .try_for_each(|text| write_atomically(&part.join("arm.toml"), without_aliases(text)))?;
        meshes
            .iter()
            .try_for_each(|(file, bytes)| write_atomically(&part.join("meshes").join(file), bytes))?;
        fs::rename(&part, out)
    };
    write().map_err(failed)?;
    // What was written must be what a trial takes.
    proact_app::Arm::in_folder(out)?;
    let of = |lengths: SegmentLengths| json!({ "upper_arm_m": lengths.upper_arm_m, "forearm_m": lengths.forearm_m });
    if json {
        print_result(
            json!({ "stature_m": args.stature, "before": of(before), "after": of(after), "folder": out }),
        )?;
    } else {
        print_result(format_args!(
            "upper arm {:.0} -> {:.0} mm, forearm {:.0} -> {:.0} mm\nwrote {}: proact demo --arm {}",
            1e3 * before.upper_arm_m,
            1e3 * after.upper_arm_m,
            1e3 * before.forearm_m,
            1e3 * after.forearm_m,
            out.display(),
            out.display()
        ))?;
    }
    Ok(true)
}

/// Settings without the former names of the arm, which this one has not had.
fn without_aliases(text: &str) -> String {
    text.lines()
        .filter(|line| !line.trim_start().starts_with("aliases"))
        .flat_map(|line| [line, "\n"])
        .collect()
}
