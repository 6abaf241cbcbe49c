//! The arm's description: URDF by urdfdom, SRDF beside it, into one immutable [`ArmModel`].
//!
//! What it does: reads, judges ([`check`]), mirrors ([`mirror`]), imports ([`import`]) and writes descriptions.
//! What it never does: load meshes, compute kinematics, or keep state. Reading is deterministic: links are
//! ordered depth first, siblings by the name of their joint, whatever the order in the file.
//!
//! ```
//! let arm = proact_description::mpl_right_arm();
//! assert_eq!((arm.arm_count(), arm.moving_count()), (7, 27));
//! assert_eq!(arm.pose("hand", "closed").expect("the hand can close").len(), 20);
//! ```
// Files are this crate's input: the command line hands it paths of a lab's descriptions.
#![allow(clippy::disallowed_methods)]
#![cfg_attr(test, allow(clippy::unwrap_used))]

mod assemble;
mod size_limits;
// The generated half of the bridge is unsafe; what is written by hand here is signatures.
#[allow(unsafe_code)]
mod bridge;
mod finding;
mod folder;
mod grasps;
mod import;
mod lint;
mod mirror;
mod report;
mod settings;
mod srdf;
mod tree;
mod write;
mod xml;

pub use finding::{DescriptionError, Finding, Severity};
pub use folder::{ArmFolder, FolderError, arm_files, collect_meshes, mesh_id, mesh_uris, settings_template};
pub use grasps::with_pinch;
pub use import::{
    ArmChoice, ImportOptions, ImportedArm, MeshFit, MeshFolders, OtherGrasp, TriangleMesh, arm_choices,
    import,
};
pub use mirror::mirror;
pub use report::{DescriptionReport, DescriptionSummary, check};
pub use write::{to_srdf, to_urdf};

use finding::Findings;
use nalgebra::{Quaternion, Translation3, UnitQuaternion};
use proact_arm::{ArmModel, Link, Mimic};
use proact_types::Pose;
use std::path::Path;

/// The MPL right arm, as URDF.
pub const MPL_RIGHT_ARM_URDF: &str =
    include_str!("../../../ros1_ws/src/proact_description/arms/mpl_right/arm.urdf");
/// Groups, poses and allowed collisions of the MPL right arm, as SRDF.
pub const MPL_RIGHT_ARM_SRDF: &str =
    include_str!("../../../ros1_ws/src/proact_description/arms/mpl_right/arm.srdf");

/// The mirror image of [`MPL_RIGHT_ARM_URDF`].
pub const MPL_LEFT_ARM_URDF: &str =
    include_str!("../../../ros1_ws/src/proact_description/arms/mpl_left/arm.urdf");
/// The mirror image of [`MPL_RIGHT_ARM_SRDF`].
pub const MPL_LEFT_ARM_SRDF: &str =
    include_str!("../../../ros1_ws/src/proact_description/arms/mpl_left/arm.srdf");

/// The MPL left arm: the mirror image of [`mpl_right_arm`].
pub fn mpl_left_arm() -> ArmModel {
    embedded_arm("mpl_left")
}

/// The MPL right arm: 7 arm and 20 hand joints, base `base_link`.
pub fn mpl_right_arm() -> ArmModel {
    embedded_arm("mpl_right")
}

/// The arm of that name that ships with the program.
///
/// # Panics
/// If there is none.
fn embedded_arm(name: &str) -> ArmModel {
    let folder = ArmFolder::shipped(name).expect("ships with the program");
    folder.model().expect("a test reads the shipped descriptions")
}

/// URDF and SRDF of the left arm, made anew from the right one, with a line that says so.
///
/// # Errors
/// As [`mirror`]; never for the right arm.
pub fn left_arm_texts() -> Result<(String, String), DescriptionError> {
    const DECLARATION: &str = "<?xml version=\"1.0\"?>\n";
    let made = |text: &str, source: &str| -> Result<String, DescriptionError> {
        let note = format!(
            "<!-- Made from {source} by rust/description/examples/make_left_arm: do not edit; origin and licence are told there. -->"
        );
        let mirrored = mirror(text)?;
        let body = mirrored.strip_prefix(DECLARATION).unwrap_or(&mirrored);
        Ok(format!("{DECLARATION}{note}\n{body}"))
    };
    Ok((made(MPL_RIGHT_ARM_URDF, "mpl_right/arm.urdf")?, made(MPL_RIGHT_ARM_SRDF, "mpl_right/arm.srdf")?))
}

/// Reads a description from the texts of its URDF and SRDF files.
///
/// # Errors
/// [`DescriptionError::Invalid`] with every error found, not only the first.
pub fn parse(urdf: &str, srdf: &str) -> Result<ArmModel, DescriptionError> {
    parse_description(urdf, Some(srdf))
}

/// Reads a description from the text of a URDF file alone.
///
/// The arm runs from the base to the first link at which the tree branches, or to its end; all joints beyond are
/// the hand. No pair of links may touch except neighbours, and the grasp centre is the tip's origin.
///
/// # Errors
/// As [`parse`].
pub fn parse_urdf(urdf: &str) -> Result<ArmModel, DescriptionError> {
    parse_description(urdf, None)
}

/// `root_from_link` of every link of `model` at the moving joints' angles `q`, rad, by the tree and the arithmetic of
/// urdfdom, from the text that the model was read from. For comparison; about a millisecond.
///
/// # Errors
/// [`DescriptionError::Library`] if urdfdom refuses the text, or has no link or joint of the model's name.
///
/// # Panics
/// If `q` has another length than the model has moving joints.
pub fn urdfdom_link_poses(urdf: &str, model: &ArmModel, q: &[f64]) -> Result<Vec<Pose>, DescriptionError> {
    assert_eq!(q.len(), model.moving_count(), "an angle for each moving joint");
    let joints: Vec<String> = model.moving().map(|joint| model.joints[joint].name.clone()).collect();
    let links: Vec<String> = model.links.iter().map(|link| link.name.clone()).collect();
    let refused = |error: cxx::Exception| DescriptionError::Library { reason: error.what().to_owned() };
    let numbers = bridge::ffi::link_poses(urdf, &joints, q, &links).map_err(refused)?;
    let pose = |n: &[f64; 7]| {
        let rotation = Quaternion::new(n[6], n[3], n[4], n[5]);
        Pose::from_parts(Translation3::new(n[0], n[1], n[2]), UnitQuaternion::from_quaternion(rotation))
    };
    Ok(numbers.as_chunks().0.iter().map(pose).collect())
}

/// Reads a description from its files; without SRDF as [`parse_urdf`].
///
/// # Errors
/// [`DescriptionError::Read`], or as [`parse`].
pub fn load(urdf: &Path, srdf: Option<&Path>) -> Result<ArmModel, DescriptionError> {
    let urdf = read_text(urdf)?;
    let srdf = srdf.map(read_text).transpose()?;
    parse_description(&urdf, srdf.as_deref())
}

/// The part of `model` that hangs on link `base`, with the arm ending at link `tip`.
///
/// Joints of the chain are the arm; those that hang on the tip are the hand; the rest are left out with their
/// links. Poses and grasps stay only if arm, hand and tip are unchanged.
///
/// # Errors
/// [`DescriptionError::Unknown`] for a link that does not exist, [`DescriptionError::NoChain`] if `tip` does not
/// hang on `base`.
pub fn select_chain(model: &ArmModel, base: &str, tip: &str) -> Result<ArmModel, DescriptionError> {
    let (base_index, tip_index) = (model.link(base)?, model.link(tip)?);
    let no_chain = || DescriptionError::NoChain { base: base.to_owned(), tip: tip.to_owned() };
    let path = assemble::chain(model, base_index, tip_index).ok_or_else(no_chain)?;
    let below_tip = |mut link: usize| {
        while link > tip_index {
            link = model.joints[link - 1].parent;
        }
        link == tip_index
    };

    // Parents come before children, so the old order is kept and stays valid.
    let mut kept = vec![base_index];
    kept.extend(
        (0..model.links.len())
            .filter(|&l| l > 0 && (path.contains(&(l - 1)) || (l > tip_index && below_tip(l)))),
    );
    let new_index = |old: usize| kept.iter().position(|&k| k == old).unwrap_or_default();
    let links: Vec<Link> = kept.iter().map(|&l| model.links[l].clone()).collect();
    let mut joints = Vec::new();
    for &link in &kept[1..] {
        let mut joint = model.joints[link - 1].clone();
        (joint.parent, joint.child) = (new_index(joint.parent), joints.len() + 1);
        joints.push(joint);
    }
    let moving = |old: &[usize]| -> Vec<usize> { old.iter().map(|&j| new_index(j + 1) - 1).collect() };
    let revolute = |j: &usize| model.joints[*j].kind.moves();
    let arm: Vec<usize> = path.iter().copied().filter(revolute).collect();
    let hand: Vec<usize> = if tip_index == model.tip {
        model.hand.clone()
    } else {
        kept.iter().filter(|&&l| l > tip_index && below_tip(l)).map(|&l| l - 1).filter(revolute).collect()
    };
    let same = arm == model.arm && tip_index == model.tip;
    let kept_joint = |joint: usize| kept.contains(&(joint + 1));
    let mimics = model.mimics.iter().filter(|m| kept_joint(m.joint) && kept_joint(m.master));
    let mimics = mimics.map(|m| Mimic {
        joint: new_index(m.joint + 1) - 1,
        master: new_index(m.master + 1) - 1,
        ..*m
    });
    Ok(ArmModel {
        name: model.name.clone(),
        mimics: mimics.collect(),
        poses: if same { model.poses.clone() } else { Vec::new() },
        grasps: if same { model.grasps.clone() } else { Vec::new() },
        side: model.side,
        settings: model.settings.clone(),
        allowed_collisions: model
            .allowed_collisions
            .iter()
            .filter(|(a, b)| kept.contains(a) && kept.contains(b))
            .map(|&(a, b)| (new_index(a), new_index(b)))
            .collect(),
        arm: moving(&arm),
        hand: moving(&hand),
        tip: new_index(tip_index),
        links,
        joints,
    })
}

/// The text of a description's file, URDF, SRDF or SDF.
///
/// # Errors
/// [`DescriptionError::Read`] for a file that cannot be read, is no text, or is longer than any description.
pub fn read_text(path: &Path) -> Result<String, DescriptionError> {
    std::fs::File::open(path)
        .and_then(|file| proact_types::read_text(file, size_limits::MAX_TEXT_BYTES))
        .map_err(|source| DescriptionError::Read { path: path.to_owned(), source })
}

fn parse_description(urdf: &str, srdf: Option<&str>) -> Result<ArmModel, DescriptionError> {
    let (model, findings) = examine(urdf, srdf);
    model.ok_or(DescriptionError::Invalid { findings })
}

/// Reads a description and everything that can be said against it. There is a model unless one of the findings
/// is an error.
fn examine(urdf: &str, srdf: Option<&str>) -> (Option<ArmModel>, Vec<Finding>) {
    let mut findings = Findings::default();
    let semantics = srdf.map(|text| srdf::read(text, &mut findings));
    let mut model = None;
    if lint::check_urdf(urdf, &mut findings) {
        match bridge::ffi::read(urdf) {
            Ok(raw) => {
                let tree = tree::build(&raw, &mut findings);
                model = assemble::assemble(&raw.name, tree, semantics, &mut findings);
            }
            Err(refusal) => {
                let remedy = "Correct what urdfdom names.";
                findings.error("URDF", "urdfdom refuses the text", refusal.what(), "a URDF robot", remedy);
            }
        }
    }
    let mut findings = findings.0;
    lint::add_line_numbers(urdf, &mut findings);
    // Worst first; findings of one kind stay in the order of the file.
    findings.sort_by_key(|f| f.severity);
    (model, findings)
}

#[cfg(test)]
mod tests;
