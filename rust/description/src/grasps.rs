//! Puts a grasp into the SRDF text of its hand.

use crate::{
    finding::{DescriptionError, Findings},
    write::grasp_element,
    xml,
};
use proact_arm::{ArmModel, Grasp, NamedPose, PinchGrasp};
use roxmltree::Node;
use std::fmt::Write;

/// `srdf` with the grasp of `pinch` and its two hand poses, before its end. What has the same names goes, and so does a
/// grasp that the new one's narrowest or widest object would fall to; a grasp whose widths overlap otherwise gives way.
/// `model` is the arm that `srdf` belongs to; `note` is written above as a comment.
///
/// # Errors
/// [`DescriptionError::Invalid`] if the text is not XML, or has no robot or no group for the hand.
pub fn with_pinch(
    srdf: &str,
    model: &ArmModel,
    pinch: &PinchGrasp,
    note: &str,
) -> Result<String, DescriptionError> {
    let mut findings = Findings::default();
    let remedy = "Give the SRDF file of the arm.";
    let document = xml::parse_document(srdf, "SRDF", "one robot element", remedy, &mut findings);
    let Some(document) = document.filter(|document| document.root_element().has_tag_name("robot")) else {
        return Err(DescriptionError::Invalid { findings: findings.0 });
    };
    let robot = document.root_element();
    let of_tag = |tag: &'static str| robot.children().filter(move |n| n.has_tag_name(tag));
    let Some(group) = of_tag("end_effector").find_map(|n| n.attribute("group")) else {
        findings.error(
            "SRDF",
            "no end_effector says which group is the hand",
            "none",
            "one",
            "Add the end_effector.",
        );
        return Err(DescriptionError::Invalid { findings: findings.0 });
    };
    let mut edits: Vec<(std::ops::Range<usize>, String)> = Vec::new();
    let mut remove = |node: Node<'_, '_>| edits.push((range_with_comment(srdf, node), String::new()));
    for node in of_tag("group_state") {
        let named = |pose: &NamedPose| node.attribute("name") == Some(&pose.name);
        if node.attribute("group") == Some(group) && (named(&pinch.open) || named(&pinch.closed)) {
            remove(node);
        }
    }
    for node in of_tag("grasp") {
        if node.attribute("closed") == Some(&pinch.closed.name) {
            remove(node);
        }
    }
    for node in of_tag("grasp").filter(|n| n.attribute("closed") != Some(&pinch.closed.name)) {
        let Some(widths) = trimmed_widths(node.attribute("widths"), &pinch.grasp) else { continue };
        match node.attribute_node("widths") {
            Some(value) => edits.push((value.range_value(), widths)),
            None => {
                let after = node.range().start + "<grasp".len();
                edits.push((after..after, format!(" widths=\"{widths}\"")));
            }
        }
    }
    let end = srdf.rfind("</robot>").unwrap_or(srdf.len());
    edits.push((end..end, pinch_elements(model, pinch, group, note)));
    // From the end, so that earlier ranges stay valid.
    edits.sort_by_key(|(range, _)| std::cmp::Reverse(range.start));
    let mut out = srdf.to_owned();
    for (range, text) in edits {
        out.replace_range(range, &text);
    }
    Ok(out)
}

/// The range of an element with its line, with the comment right above it, and the empty lines before.
fn range_with_comment(text: &str, node: Node<'_, '_>) -> std::ops::Range<usize> {
    let mut start = node.range().start;
    if let Some(blank) = node.prev_sibling().filter(Node::is_text)
        && blank.text().is_some_and(|t| t.trim().is_empty() && t.matches('\n').count() == 1)
        && let Some(note) = blank.prev_sibling().filter(Node::is_comment)
    {
        start = note.range().start;
    }
    let lines = text[..start].trim_end().len();
    let start = lines + usize::from(text[lines..].starts_with('\n'));
    let end = node.range().end;
    start..if text[end..].starts_with('\n') { end + 1 } else { end }
}

/// What is left of the `widths` of another grasp, as text; none if that stays as it is. It keeps the wider part.
fn trimmed_widths(widths: Option<&str>, new: &Grasp) -> Option<String> {
    let usual = Grasp::default().width_range_m;
    let read = |text: &str| {
        let mut numbers = text.split_whitespace().map(crate::srdf::number);
        Some([numbers.next()??, numbers.next()??])
    };
    let [low, high] = widths.and_then(read).unwrap_or(usual);
    let overlaps = low < new.width_range_m[1] && new.width_range_m[0] < high;
    if !overlaps {
        return None;
    }
    let [low, high] = if high > new.width_range_m[1] {
        [new.width_range_m[1], high]
    } else {
        [low.min(new.width_range_m[0]), new.width_range_m[0]]
    };
    Some(format!("{low} {high}"))
}

fn pinch_elements(model: &ArmModel, pinch: &PinchGrasp, group: &str, note: &str) -> String {
    let mut out = String::new();
    // A comment must not contain two dashes.
    let note = note.replace("--", "- -");
    let _ = writeln!(out, "\n  <!-- {note} -->\n  {}", grasp_element(&pinch.grasp));
    for pose in [&pinch.open, &pinch.closed] {
        let _ = writeln!(out, "  <group_state name=\"{}\" group=\"{group}\">", pose.name);
        for (&joint, angle) in model.hand.iter().zip(&pose.angles) {
            let _ = writeln!(out, "    <joint name=\"{}\" value=\"{angle}\"/>", model.joints[joint].name);
        }
        let _ = writeln!(out, "  </group_state>");
    }
    out
}
