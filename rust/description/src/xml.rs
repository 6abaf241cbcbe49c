//! XML of strangers. Parsers descend once a level and compare every attribute with every other, so depth and numbers are
//! looked at before they are called.

use crate::{
    finding::Findings,
    size_limits::{MAX_ATTRIBUTES, MAX_ELEMENT_DEPTH, MAX_TEXT_BYTES},
};
use roxmltree::{Document, Node};
use std::borrow::Cow;

/// The document of `text`, or a finding of `file`, such as `URDF`, that says why there is none.
///
/// `expected` and `remedy` are for text that is not well-formed.
pub(crate) fn parse_document<'a>(
    text: &'a str,
    file: &str,
    expected: &str,
    remedy: &str,
    findings: &mut Findings,
) -> Option<Document<'a>> {
    let mut refuse = |problem: &str, got: String, max: usize, unit: &str, remedy: &str| {
        findings.error(file, problem, got, format!("at most {max}{unit}"), remedy);
        None
    };
    if text.len() > MAX_TEXT_BYTES {
        let got = format!("{} bytes", text.len());
        let remedy = "Give the description alone; meshes are files of their own.";
        return refuse("the text is too long", got, MAX_TEXT_BYTES, " bytes", remedy);
    }
    let extent = measure_extent(text);
    if extent.depth > MAX_ELEMENT_DEPTH {
        let got = extent.depth.to_string();
        let remedy = "Write the parts one beside the other.";
        return refuse("elements stand too deep in each other", got, MAX_ELEMENT_DEPTH, "", remedy);
    }
    if extent.attributes > MAX_ATTRIBUTES {
        let got = extent.attributes.to_string();
        return refuse(
            "an element has too many attributes",
            got,
            MAX_ATTRIBUTES,
            "",
            "Leave out what URDF does not know.",
        );
    }
    match Document::parse(text) {
        Ok(document) => Some(document),
        Err(roxmltree::Error::DtdDetected) => {
            let remedy = "Remove <!DOCTYPE ..> and what is in it.";
            findings.error(file, "the text has a document type definition", "<!DOCTYPE", "none", remedy);
            None
        }
        Err(error) => {
            let line = error.pos().row;
            findings.error(file, "the text is not well-formed XML", error, expected, remedy);
            if let Some(finding) = findings.0.last_mut() {
                finding.line = Some(line);
            }
            None
        }
    }
}

/// `text` with those prefixes declared that it uses and does not declare, such as `sensor:` of old Gazebo: other readers take them as
/// parts of names. Lines stay where they are.
pub(crate) fn declare_prefixes(text: &str) -> Cow<'_, str> {
    const MAX_PREFIXES: usize = 20;
    let mut text = Cow::Borrowed(text);
    // Texts beyond a size limit are refused later.
    let extent = measure_extent(&text);
    if text.len() > MAX_TEXT_BYTES || extent.depth > MAX_ELEMENT_DEPTH || extent.attributes > MAX_ATTRIBUTES {
        return text;
    }
    for _ in 0..MAX_PREFIXES {
        let Err(roxmltree::Error::UnknownNamespace(prefix, _)) = Document::parse(&text) else { break };
        let Some(at) = text.find("<robot").map(|at| at + "<robot".len()) else { break };
        text = Cow::Owned(format!("{} xmlns:{prefix}=\"urn:{prefix}\"{}", &text[..at], &text[at..]));
    }
    text
}

/// The line on which `node` begins.
pub(crate) fn line_of(node: Node<'_, '_>) -> u32 {
    let before = &node.document().input_text().as_bytes()[..node.range().start];
    1 + before.iter().map(|byte| u32::from(*byte == b'\n')).sum::<u32>()
}

/// How deep the elements stand in each other, and how many attributes one of them has at most.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct XmlExtent {
    depth: usize,
    attributes: usize,
}

/// Goes from tag to tag. Where the text is malformed it may miscount, but a parser comes no farther than there.
fn measure_extent(text: &str) -> XmlExtent {
    let mut extent = XmlExtent::default();
    let mut depth = 0_usize;
    let mut rest = text;
    while let Some(at) = rest.find('<') {
        rest = &rest[at..];
        let skipped = [("<!--", "-->"), ("<![CDATA[", "]]>"), ("<?", "?>"), ("<!", ">")]
            .into_iter()
            .find(|(begin, _)| rest.starts_with(begin));
        if let Some((begin, end)) = skipped {
            let Some(over) = rest[begin.len()..].find(end) else { break };
            rest = &rest[begin.len() + over + end.len()..];
            continue;
        }
        let Some(tag) = XmlTag::parse(rest) else { break };
        rest = &rest[tag.length..];
        extent.attributes = extent.attributes.max(tag.attributes);
        if tag.is_closing {
            depth = depth.saturating_sub(1);
        } else {
            extent.depth = extent.depth.max(depth + 1);
            depth += usize::from(!tag.is_empty);
        }
    }
    extent
}

/// One tag, from `<` to `>`.
struct XmlTag {
    length: usize,
    attributes: usize,
    is_closing: bool,
    is_empty: bool,
}

impl XmlTag {
    /// The tag with which `text` begins; none if it does not end.
    fn parse(text: &str) -> Option<XmlTag> {
        let mut quote = None;
        let mut attributes = 0;
        for (at, byte) in text.bytes().enumerate() {
            match (quote, byte) {
                (None, b'"' | b'\'') => quote = Some(byte),
                (Some(open), _) if open == byte => quote = None,
                (None, b'=') => attributes += 1,
                (None, b'>') => {
                    let (closes, is_empty) = (text.starts_with("</"), text[..at].ends_with('/'));
                    return Some(XmlTag { length: at + 1, attributes, is_closing: closes, is_empty });
                }
                _ => {}
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depth_and_attributes_are_counted_past_comments_quotes_and_declarations() {
        let text =
            "<?xml version=\"1.0\"?><!-- <a><b> --><a x='>' y=\"/>\"><b/><c><![CDATA[<d>]]></c></a><e/>";
        assert_eq!(measure_extent(text), XmlExtent { depth: 2, attributes: 2 });
        assert_eq!(measure_extent("<a><b><c>"), XmlExtent { depth: 3, attributes: 0 });
        assert_eq!(measure_extent("<a"), XmlExtent::default());
        assert_eq!(measure_extent("</a></a><b>"), XmlExtent { depth: 1, attributes: 0 });
    }
}
