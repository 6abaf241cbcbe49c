/// Where changes that are not released stand.
const UNRELEASED: &str = "## Unreleased";
/// The part of them that is about digests.
const DIGESTS: &str = "### Digests";

/// `changelog` with one more line among the digests of what is not released; none if it has no such section. A heading
/// that is missing is added at the section's end.
pub fn add_digest_line(changelog: &str, line: &str) -> Option<String> {
    let lines: Vec<&str> = changelog.lines().collect();
    let section = lines.iter().position(|text| *text == UNRELEASED)?;
    let rest = &lines[section + 1..];
    let end = section + 1 + rest.iter().position(|text| text.starts_with("## ")).unwrap_or(rest.len());
    let heading = lines[section..end].iter().position(|text| *text == DIGESTS).map(|k| section + k);
    let entry = format!("- {line}");
    let (at, added) = match heading {
        Some(heading) => (heading + 1, vec![entry.as_str()]),
        None => {
            let written = lines[..end].iter().rposition(|text| !text.is_empty()).map_or(end, |last| last + 1);
            (written, vec!["", DIGESTS, &entry])
        }
    };
    let whole = [&lines[..at], &added, &lines[at..]].concat();
    Some(whole.join("\n") + "\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_line_goes_under_its_heading_in_the_unreleased_part_newest_first() {
        let before = "# Changelog\n\n## Unreleased\n\n### Added\n- a\n\n## 0.1.0\n\n### Digests\n- old\n";
        let once = add_digest_line(before, "first").expect("there is a section");
        let expected = "# Changelog\n\n## Unreleased\n\n### Added\n- a\n\n### Digests\n- first\n\n## 0.1.0\n\n\
            ### Digests\n- old\n";
        assert_eq!(once, expected);
        let twice = add_digest_line(&once, "second").expect("there is a section");
        assert_eq!(twice, expected.replace("- first", "- second\n- first"));
        let at_the_end = add_digest_line("## Unreleased\n- a\n", "b").expect("there is a section");
        assert_eq!(at_the_end, "## Unreleased\n- a\n\n### Digests\n- b\n");
        assert_eq!(add_digest_line("# Changelog\n", "lost"), None);
    }
}
