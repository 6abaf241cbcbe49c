//! A left arm from a right one, and back.
//!
//! Mirrors across the x-z plane of the base, which is the wearer's sagittal plane. With `S = diag(1, -1, 1)`
//! every pose `X` becomes `S X S`: `y` of a position changes sign, and so do roll and yaw. A turn by `q` about
//! `a` becomes `S R(a, q) S = R(-S a, q)`, so `x` and `z` of an axis change sign while angles, limits and named
//! poses keep theirs: flexion stays positive. Inertias become `S I S`, meshes are scaled by -1 along y.
//!
//! Works on the text, so that no digit changes. Comments are dropped: what they say about sides would be wrong.

use crate::{
    finding::{DescriptionError, Findings},
    xml,
};
use roxmltree::Node;
use std::ops::Range;

/// Attributes that hold names of links and joints.
const NAME_ATTRIBUTES: &[&str] = &[
    "name",
    "link",
    "joint",
    "link1",
    "link2",
    "base_link",
    "tip_link",
    "parent_link",
    "child_link",
    "reference",
];

/// The mirror image of a URDF or SRDF text. `right` and `left` change places in the names of robot, links and
/// joints.
///
/// # Errors
/// [`DescriptionError::Invalid`] if the text is not XML, or a number in it cannot be read.
pub fn mirror(text: &str) -> Result<String, DescriptionError> {
    let mut findings = Findings::default();
    let remedy = "Correct the file at that place.";
    let Some(document) = xml::parse_document(text, "description", "URDF or SRDF", remedy, &mut findings)
    else {
        return Err(DescriptionError::Invalid { findings: findings.0 });
    };
    let mut edits = Vec::new();
    for node in document.descendants() {
        if node.is_comment() {
            edits.push((whole_line(text, node.range()), String::new()));
        } else if node.is_element() {
            collect_edits(node, &mut edits, &mut findings);
        }
    }
    if findings.has_error() {
        return Err(DescriptionError::Invalid { findings: findings.0 });
    }

    // From the end, so that earlier ranges stay valid.
    edits.sort_by_key(|(range, _)| std::cmp::Reverse(range.start));
    let mut out = text.to_owned();
    for (range, replacement) in edits {
        out.replace_range(range, &replacement);
    }
    Ok(out)
}

/// A name with its side swapped.
fn swap_sides(name: &str) -> String {
    // The placeholder cannot be part of a name.
    name.replace("right", "\u{0}").replace("left", "right").replace('\u{0}', "left")
}

/// The range, with the whole line if nothing else stands on it, otherwise with the blanks before it.
fn whole_line(text: &str, range: Range<usize>) -> Range<usize> {
    let before = text[..range.start].trim_end_matches([' ', '\t']).len();
    let alone = before == 0 || text[..before].ends_with('\n');
    let end = if alone && text[range.end..].starts_with('\n') { range.end + 1 } else { range.end };
    before..end
}

fn collect_edits(node: Node<'_, '_>, edits: &mut Vec<(Range<usize>, String)>, findings: &mut Findings) {
    let tag = node.tag_name().name();
    let mut flip = |attribute: &str, signs: [bool; 3]| {
        let Some(value) = node.attribute_node(attribute) else { return };
        match negate_components(value.value(), signs) {
            Some(text) => edits.push((value.range_value(), text)),
            None => findings.error(
                format!("<{tag}> at line {}", xml::line_of(node)),
                format!("{attribute} cannot be mirrored"),
                format!("\"{}\"", value.value()),
                "three finite numbers",
                "Correct the numbers.",
            ),
        }
    };
    match tag {
        "origin" => {
            flip("xyz", [false, true, false]);
            flip("rpy", [true, false, true]);
        }
        "axis" => flip("xyz", [true, false, true]),
        "grasp_centre" => flip("xyz", [false, true, false]),
        "grasp" => {
            for vector in ["withdrawal", "centre", "closing"] {
                flip(vector, [false, true, false]);
            }
            if let Some(value) = node.attribute_node("roll") {
                edits.push((value.range_value(), negate(value.value())));
            }
            // From the other end, so that the smaller one stays first.
            if let Some(value) = node.attribute_node("roll_range") {
                let range: Vec<String> = value.value().split_whitespace().rev().map(negate).collect();
                edits.push((value.range_value(), range.join(" ")));
            }
        }
        "mesh" => {
            flip("scale", [false, true, false]);
            if let (None, Some(file)) = (node.attribute("scale"), node.attribute_node("filename")) {
                edits.push((file.range().end..file.range().end, " scale=\"1 -1 1\"".to_owned()));
            }
        }
        "inertia" => {
            for attribute in ["ixy", "iyz"] {
                if let Some(value) = node.attribute_node(attribute) {
                    edits.push((value.range_value(), negate(value.value())));
                }
            }
        }
        _ => {}
    }
    if tag != "material" {
        for attribute in node.attributes().filter(|a| NAME_ATTRIBUTES.contains(&a.name())) {
            edits.push((attribute.range_value(), swap_sides(attribute.value())));
        }
    }
}

/// Three numbers, with the sign of some of them changed; none if they are not three finite numbers.
fn negate_components(value: &str, signs: [bool; 3]) -> Option<String> {
    crate::srdf::vector(value)?;
    let words = value.split_whitespace().zip(signs);
    let words: Vec<String> = words.map(|(w, flip)| if flip { negate(w) } else { w.to_owned() }).collect();
    Some(words.join(" "))
}

fn negate(number: &str) -> String {
    let number = number.trim();
    match number.strip_prefix('-') {
        Some(positive) => positive.to_owned(),
        None if crate::srdf::number(number) == Some(0.0) => number.to_owned(),
        None => format!("-{}", number.trim_start_matches('+')),
    }
}
