//! A lab's own arm, as URDF or SDF, into a checked description.
//!
//! What a file lacks is completed, and said: mass and inertia, limits, poses of the hand; meshes become the primitives that physics
//! and planner know. The result is written as URDF and SRDF and read once more by urdfdom, so that what is handed out is what was
//! checked.

mod complete;
mod fit;
mod hand;
mod meshes;
mod mount;
mod parts;
mod sdf;
mod urdf;

pub use meshes::{MeshFolders, TriangleMesh};
pub use mount::ArmChoice;

use crate::{
    DescriptionError, DescriptionReport, Finding, check, examine,
    finding::{Findings, Severity},
    write, xml,
};
use nalgebra::Point3;
use parts::{PartKind, RobotParts};
use proact_arm::{
    ArmModel, CLOSED_POSE, CollisionShape, Joint, JointKind, JointLimits, Link, Mimic, OPEN_POSE,
    VisualGeometry, find_pinch,
};
use proact_types::Vector;
use serde::Serialize;
use std::collections::BTreeMap;

/// Width of the cube for which a grasp is looked for, metres, and the friction between finger and cube.
const BLOCK_WIDTH_M: f64 = 0.05;
const FRICTION: f64 = 0.8;
/// Number of ways to hold it from which a pinch is looked for.
const SEARCHED_SHAPES: usize = 3;

/// How a file is imported.
#[derive(Clone, Copy, Debug, Default)]
pub struct ImportOptions<'a> {
    /// Groups and poses; without them arm and hand are found from the joints.
    pub srdf: Option<&'a str>,
    /// Link at the arm's base; without it the root that carries most joints.
    pub base: Option<&'a str>,
    /// Link at which the arm ends and the hand begins; without it the first one from which several joints lead on.
    pub tip: Option<&'a str>,
    /// Where meshes may lie.
    pub meshes: Option<&'a MeshFolders>,
    /// Leaves an arm without a hand as it is; else it gets a gripper.
    pub without_gripper: bool,
}

/// What [`import`] made.
#[derive(Clone, Debug)]
pub struct ImportedArm {
    /// The model.
    pub model: ArmModel,
    /// Its URDF text.
    pub urdf: String,
    /// Its SRDF text; groups are called `arm` and `hand`.
    pub srdf: String,
    /// What was found on the way and in the result.
    pub report: DescriptionReport,
    /// How well primitives enclose the meshes that were given for collision.
    pub fits: Vec<MeshFit>,
    /// What was found out about the hand and the poses, a sentence each.
    pub found: Vec<String>,
    /// The arm with other grasps, the most promising first, where no search vouches for one: a trial tells which holds.
    pub other_grasps: Vec<OtherGrasp>,
    /// Corners of the collision meshes of each link, in its frame, some hundred at most: for pictures.
    pub mesh_points: BTreeMap<String, Vec<Point3<f64>>>,
}

/// An imported arm that grips in another way.
#[derive(Clone, Debug)]
pub struct OtherGrasp {
    /// The model.
    pub model: ArmModel,
    /// Between which digits, one sentence.
    pub sentence: String,
}

/// Corners of meshes by the name of their link, in its frame.
type MeshPoints = BTreeMap<String, Vec<Point3<f64>>>;

/// How primitives enclose the collision mesh of a link.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MeshFit {
    /// The link.
    pub link: String,
    /// Address of the mesh.
    pub mesh: String,
    /// How many primitives.
    pub shapes: usize,
    /// Their volume, cm^3.
    pub volume_cm3: f64,
    /// Volume of the convex hulls of what they enclose, cm^3.
    pub hull_volume_cm3: f64,
}

impl MeshFit {
    /// By how much the primitives are larger than what they enclose, as a share.
    pub fn excess(&self) -> f64 {
        self.volume_cm3 / self.hull_volume_cm3 - 1.0
    }
}

/// Turns the text of a URDF file, or of an SDF file with one model, into a description that passes [`check`].
///
/// Links of a hand that was found without SRDF may touch each other and the link that carries them. Addresses of meshes that are
/// drawn are kept as they are. Deterministic.
///
/// # Errors
/// [`DescriptionError::Invalid`] with all findings, if one of them is an error.
pub fn import(text: &str, options: &ImportOptions<'_>) -> Result<ImportedArm, DescriptionError> {
    let mut findings = Findings::default();
    let text = strip_preamble(text, &mut findings);
    let declared = xml::declare_prefixes(text);
    let text = &*declared;
    let Some(parts) = read_parts(text, &mut findings).filter(|_| !findings.has_error()) else {
        return Err(invalid(text, findings));
    };
    let Some((urdf_text, fits, mesh_points)) = complete(parts, options, &mut findings) else {
        return Err(invalid(text, findings));
    };
    let (model, mut more) = examine(&urdf_text, options.srdf);
    // Lines of the text that was written are in no file of the user's.
    more.iter_mut().for_each(|finding| finding.line = None);
    let Some(mut model) = model else {
        findings.0.extend(more);
        return Err(invalid(text, findings));
    };
    if options.srdf.is_none() {
        allow_hand_self_contact(&mut model);
    }
    let mut found = hand::add_poses(&mut model);
    let mut other_grasps = add_grasp(&mut model, &mut found);
    let (urdf, srdf) = (write::to_urdf(&model), write::to_srdf(&model));
    // What is handed out is what was checked: the texts are read once more.
    let mut report = check(&urdf, Some(&srdf));
    if report.usable {
        model = crate::parse(&urdf, &srdf)?;
        for other in &mut other_grasps {
            other.model = crate::parse(&write::to_urdf(&other.model), &write::to_srdf(&other.model))?;
        }
    }
    // Lines of the text that was written are in no file of the user's.
    report.findings.iter_mut().for_each(|finding| finding.line = None);
    crate::lint::add_line_numbers(text, &mut report.findings);
    let new_findings: Vec<Finding> =
        more.into_iter().filter(|f| !is_known_finding(f, &report.findings)).collect();
    let mut own = findings.0;
    own.extend(new_findings);
    crate::lint::add_line_numbers(text, &mut own);
    report.findings.extend(own);
    report.findings.sort_by_key(|f| f.severity);
    // Such as a joint without a name, which the model can hold and the text cannot.
    if !report.usable {
        return Err(DescriptionError::Invalid { findings: report.findings });
    }
    Ok(ImportedArm { model, urdf, srdf, report, fits, found, other_grasps, mesh_points })
}

/// The arms of a robot that has several, the one that [`import`] takes by itself first. Empty for one arm, and for a text that
/// [`import`] refuses.
pub fn arm_choices(text: &str) -> Vec<ArmChoice> {
    let mut findings = Findings::default();
    let text = strip_preamble(text, &mut findings);
    let declared = xml::declare_prefixes(text);
    let Some(mut parts) = read_parts(&declared, &mut findings).filter(|_| !findings.has_error()) else {
        return Vec::new();
    };
    complete::choose_base(&mut parts, None, &mut findings);
    if findings.has_error() { Vec::new() } else { mount::arm_choices(&parts) }
}

fn read_parts(text: &str, findings: &mut Findings) -> Option<RobotParts> {
    if is_sdf(text) { sdf::read(text, findings) } else { urdf::read(text, findings) }
}

fn invalid(text: &str, mut findings: Findings) -> DescriptionError {
    crate::lint::add_line_numbers(text, &mut findings.0);
    findings.0.sort_by_key(|f| f.severity);
    DescriptionError::Invalid { findings: findings.0 }
}

/// Completes the parts and writes them as URDF; none if an error was found.
fn complete(
    mut parts: RobotParts,
    options: &ImportOptions<'_>,
    findings: &mut Findings,
) -> Option<(String, Vec<MeshFit>, MeshPoints)> {
    complete::find_wrong_units(&parts, findings);
    complete::choose_base(&mut parts, options.base, findings);
    if let Some(tip) = options.tip.filter(|_| !findings.has_error()) {
        complete::hold_beside_chain(&mut parts, tip, findings);
    }
    if !findings.has_error() && options.srdf.is_none() && options.tip.is_none() {
        mount::choose_arm(&mut parts, findings);
    }
    if !findings.has_error() && options.srdf.is_none() {
        mount::hold_surplus(&mut parts, findings);
    }
    if findings.has_error() {
        return None;
    }
    complete::resolve_mimics(&mut parts, findings);
    complete::complete_collisions(&mut parts, findings);
    let nowhere = MeshFolders::default();
    let meshes = meshes::load_collision_meshes(&parts, options.meshes.unwrap_or(&nowhere));
    complete::note_missing_meshes(&parts, &meshes, findings);
    if options.srdf.is_none() {
        parts = mount::make_whole(parts, options.tip, !options.without_gripper, &meshes, findings)?;
        let palm = mount::palm(&parts);
        complete::uncouple_arm(&mut parts, palm, findings);
    }
    complete::complete_masses(&mut parts, &meshes, findings);
    complete::complete_limits(&mut parts, findings);
    complete::complete_followers(&mut parts, findings);
    if options.srdf.is_none() && !mount::arm_moves(&parts) {
        let remedy = "Correct the limits of its joints, or name another end with --tip.";
        findings.error(
            "URDF",
            "no joint of the arm moves",
            "joints that cannot move",
            "one that moves",
            remedy,
        );
        return None;
    }
    let mut fits = Vec::new();
    let mut mesh_points = MeshPoints::new();
    let links: Vec<Link> = parts
        .links
        .iter()
        .map(|link| {
            let points = mesh_corners(link, &meshes);
            if !points.is_empty() {
                mesh_points.insert(link.name.clone(), points);
            }
            enclose_link(link, &meshes, &mut fits)
        })
        .collect();
    let (joints, mimics) = finish_joints(&parts);
    Some((write::urdf(&parts.name, &links, &joints, &mimics), fits, mesh_points))
}

/// Some corners of the collision meshes of a link, in its frame.
fn mesh_corners(
    part: &parts::PartLink,
    meshes: &BTreeMap<String, Result<TriangleMesh, String>>,
) -> Vec<Point3<f64>> {
    const MAX_CORNERS: usize = 300;
    let mut corners = Vec::new();
    for collision in &part.collisions {
        let VisualGeometry::Mesh { file, scale } = &collision.geometry else { continue };
        let Some(Ok(mesh)) = meshes.get(file) else { continue };
        let step = mesh.points.len().div_ceil(MAX_CORNERS).max(1);
        let scale = Vector::from(*scale);
        let place = |point: &Point3<f64>| collision.pose * Point3::from(point.coords.component_mul(&scale));
        corners.extend(mesh.points.iter().step_by(step).map(place));
    }
    corners
}

/// A link with primitives in the place of its collision meshes.
fn enclose_link(
    part: &parts::PartLink,
    meshes: &BTreeMap<String, Result<TriangleMesh, String>>,
    fits: &mut Vec<MeshFit>,
) -> Link {
    let mut collisions = Vec::new();
    for collision in &part.collisions {
        match &collision.geometry {
            VisualGeometry::Shape(shape) => {
                collisions.push(CollisionShape { pose: collision.pose, shape: *shape })
            }
            VisualGeometry::Mesh { file, scale } => {
                let mesh = meshes.get(file).and_then(|mesh| mesh.as_ref().ok());
                let Some(fit) = mesh.and_then(|mesh| fit::enclose(mesh, *scale)) else { continue };
                let placed = fit
                    .shapes
                    .iter()
                    .map(|(pose, shape)| CollisionShape { pose: collision.pose * pose, shape: *shape });
                collisions.extend(placed);
                fits.push(MeshFit {
                    link: part.name.clone(),
                    mesh: file.clone(),
                    shapes: fit.shapes.len(),
                    volume_cm3: fit.volume * 1e6,
                    hull_volume_cm3: fit.hull_volume * 1e6,
                });
            }
        }
    }
    Link { name: part.name.clone(), inertial: part.inertial, collisions, visuals: part.visuals.clone() }
}

fn finish_joints(parts: &RobotParts) -> (Vec<Joint>, Vec<Mimic>) {
    let mut mimics = Vec::new();
    let mut joints = Vec::new();
    for (index, part) in parts.joints.iter().enumerate() {
        let kind = match part.kind {
            PartKind::Fixed => JointKind::Fixed,
            PartKind::Revolute => JointKind::Revolute,
            PartKind::Continuous => JointKind::Continuous,
            PartKind::Prismatic => JointKind::Prismatic,
        };
        let [lower, upper] = part.range.unwrap_or_default();
        let limits = JointLimits {
            lower,
            upper,
            velocity: part.velocity.unwrap_or_default(),
            effort: part.effort.unwrap_or_default(),
        };
        joints.push(Joint {
            name: part.name.clone(),
            kind,
            parent: part.parent,
            child: part.child,
            origin: part.origin,
            axis: part.axis,
            limits: if kind.moves() { limits } else { JointLimits::default() },
            damping: part.damping,
            friction: part.friction,
        });
        let master =
            part.mimic.as_ref().and_then(|m| parts.joints.iter().position(|joint| joint.name == m.master));
        if let (Some(mimic), Some(master)) = (&part.mimic, master) {
            mimics.push(Mimic { joint: index, master, multiplier: mimic.multiplier, offset: mimic.offset });
        }
    }
    (joints, mimics)
}

/// A pinch of the usual block, if the hand can.
fn add_grasp(model: &mut ArmModel, found: &mut Vec<String>) -> Vec<OtherGrasp> {
    let is_default = |grasp: &proact_arm::Grasp| *grasp == proact_arm::Grasp::default();
    if model.hand.is_empty() || !model.grasps.iter().all(is_default) {
        return Vec::new();
    }
    let mut shapes = hand::grasp_shapes(model, BLOCK_WIDTH_M).into_iter();
    let Some(first) = shapes.next() else {
        found.push("the hand does not close: it grips nothing".to_owned());
        return Vec::new();
    };
    let bare = model.clone();
    let take = |model: &mut ArmModel, shape: &hand::GraspShape| {
        // The directions of a grasp are those of the tip's frame: z up, and the fingers close along x.
        hand::add_grasp_frame(model, shape);
        model.poses.extend(shape.poses.clone());
        model.grasps = vec![shape.grasp.clone()];
    };
    take(model, &first);
    let mut search = find_pinch(model, BLOCK_WIDTH_M, FRICTION);
    let mut sentence = first.sentence;
    let mut others = Vec::new();
    for (tried, shape) in (1..).zip(shapes) {
        if search.is_ok() {
            break;
        }
        let mut other = bare.clone();
        take(&mut other, &shape);
        // A search takes seconds for a hand of five digits.
        let searched = (tried < SEARCHED_SHAPES).then(|| find_pinch(&other, BLOCK_WIDTH_M, FRICTION).ok());
        match searched.flatten() {
            Some(pinch) => (*model, search, sentence) = (other, Ok(pinch), shape.sentence),
            None => others.push(OtherGrasp { model: other, sentence: shape.sentence }),
        }
    }
    if search.is_ok() {
        others.clear();
    }
    found.push(sentence);
    match search {
        Ok(pinch) => {
            found.push(format!(
                "the hand pinches a block of {:.0} mm between {} and {}",
                1e3 * BLOCK_WIDTH_M,
                pinch.digits[0],
                pinch.digits[1]
            ));
            let replaced =
                [&model.grasps[0].open_pose, &model.grasps[0].closed_pose].map(|name| name.to_string());
            model.poses.retain(|pose| {
                let is_default = [OPEN_POSE, CLOSED_POSE].contains(&pose.name.as_str());
                let is_new = pose.name == pinch.open.name || pose.name == pinch.closed.name;
                pose.group != "hand" || is_default || !(is_new || replaced.contains(&pose.name))
            });
            model.poses.extend([pinch.open, pinch.closed]);
            model.grasps = vec![pinch.grasp];
        }
        Err(error) => found.push(format!(
            "the search for a pinch of a block of {:.0} mm does not vouch for it: {error}",
            1e3 * BLOCK_WIDTH_M
        )),
    }
    others
}

/// Lines move when the text is written anew, so findings are compared without them.
fn is_known_finding(finding: &Finding, others: &[Finding]) -> bool {
    others
        .iter()
        .any(|o| o.location == finding.location && o.problem == finding.problem && o.got == finding.got)
}

/// The text from its XML declaration on. Some published models have a comment or blank lines before it, which XML forbids.
fn strip_preamble<'a>(text: &'a str, findings: &mut Findings) -> &'a str {
    let text = text.trim_start_matches('\u{feff}').trim_start();
    let Some(start) = text.find("<?xml") else { return text };
    let preamble = text[..start].trim();
    let comment =
        preamble.starts_with("<!--") && preamble.ends_with("-->") && preamble.matches("-->").count() == 1;
    if !comment {
        return text;
    }
    findings.add(
        Severity::Note,
        "file",
        "a comment stands before the XML declaration, where none may be",
        "a comment",
        "<?xml ..?> first",
        "It was skipped.",
    );
    &text[start..]
}

fn is_sdf(text: &str) -> bool {
    // Text that is refused is refused by the reader of URDF, which says why.
    let document = xml::parse_document(text, "", "", "", &mut Findings::default());
    document.is_some_and(|d| d.root_element().has_tag_name("sdf"))
}

/// Fingers are allowed to touch each other and the palm.
fn allow_hand_self_contact(model: &mut ArmModel) {
    let (palm, digits) = (model.palm(), model.digits());
    let hand: Vec<usize> =
        (0..model.links.len()).filter(|&link| palm[link] || digits[link].is_some()).collect();
    for (k, &a) in hand.iter().enumerate() {
        model.allowed_collisions.extend(hand[k + 1..].iter().map(|&b| (a.min(b), a.max(b))));
    }
    model.allowed_collisions.sort_unstable();
    model.allowed_collisions.dedup();
}
