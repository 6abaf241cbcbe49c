//! A lab's own arm, as URDF or SDF, into a checked description.

use crate::{
    DescriptionError, DescriptionReport, Finding, check, examine,
    finding::{Findings, Severity},
    sdf, write, xml,
};
use proact_arm::ArmModel;

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
}

/// Turns the text of a URDF file, or of an SDF file with one model, into a description that passes [`check`].
///
/// `srdf` names groups and poses. Without it the arm ends where the tree branches, and links of the hand may touch
/// each other and the link that carries them. Addresses of meshes are kept as they are.
///
/// # Errors
/// [`DescriptionError::Invalid`] with all findings, if one of them is an error.
pub fn import(text: &str, srdf: Option<&str>) -> Result<ImportedArm, DescriptionError> {
    let mut findings = Findings::default();
    let text = strip_preamble(text, &mut findings);
    let urdf = if is_sdf(text) {
        match sdf::read(text, &mut findings) {
            Some(parts) if !findings.has_error() => {
                write::urdf(&parts.name, &parts.links, &parts.joints, &[])
            }
            _ => return Err(DescriptionError::Invalid { findings: findings.0 }),
        }
    } else {
        text.to_owned()
    };
    let (model, more) = examine(&urdf, srdf);
    let Some(mut model) = model else {
        findings.0.extend(more);
        return Err(DescriptionError::Invalid { findings: findings.0 });
    };
    if srdf.is_none() {
        allow_hand_self_contact(&mut model);
    }
    let (urdf, srdf) = (write::to_urdf(&model), write::to_srdf(&model));
    // What is handed out is what was checked: the texts are read once more.
    let mut report = check(&urdf, Some(&srdf));
    let new_findings: Vec<Finding> =
        more.into_iter().filter(|f| !is_known_finding(f, &report.findings)).collect();
    report.findings.extend(findings.0.into_iter().chain(new_findings));
    report.findings.sort_by_key(|f| f.severity);
    // Such as a joint without a name, which the model can hold and the text cannot.
    if !report.usable {
        return Err(DescriptionError::Invalid { findings: report.findings });
    }
    Ok(ImportedArm { model, urdf, srdf, report })
}

/// Lines move when the text is written anew, so findings are compared without them.
fn is_known_finding(finding: &Finding, others: &[Finding]) -> bool {
    others
        .iter()
        .any(|o| o.location == finding.location && o.problem == finding.problem && o.got == finding.got)
}

/// The text from its XML declaration on. Some published models have a comment before it, which XML forbids.
fn strip_preamble<'a>(text: &'a str, findings: &mut Findings) -> &'a str {
    let text = text.trim_start_matches('\u{feff}');
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
        "Nothing: it was skipped.",
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
    let tip = model.tip;
    let mut hand = vec![tip];
    for joint in &model.joints {
        // Parents come first, so one pass finds all that hangs on the tip.
        if hand.contains(&joint.parent) {
            hand.push(joint.child);
        }
    }
    for (k, &a) in hand.iter().enumerate() {
        model.allowed_collisions.extend(hand[k + 1..].iter().map(|&b| (a.min(b), a.max(b))));
    }
    model.allowed_collisions.sort_unstable();
    model.allowed_collisions.dedup();
}
