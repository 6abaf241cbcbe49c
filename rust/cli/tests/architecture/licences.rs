//! Under which licences the dependencies come, and whether THIRD_PARTY.md says so.

use std::{collections::BTreeMap, sync::LazyLock};

use crate::workspace::{load, read};

/// Licences that ask for no more than a notice: the list of `deny.toml`. cargo-deny judges by it too, for all features, but is
/// not on every machine.
static ALLOWED: LazyLock<Vec<String>> = LazyLock::new(|| {
    let deny: toml::Table = toml::from_str(&read("deny.toml")).expect("deny.toml is TOML");
    let list = deny["licenses"]["allow"].as_array().expect("deny.toml has a list of licences");
    list.iter().filter_map(|license| license.as_str().map(str::to_owned)).collect()
});

/// Whether an SPDX expression can be met with allowed licences alone.
///
/// `OR` binds less than `AND`; old manifests write `/` for `OR`.
fn is_allowed(expression: &str) -> bool {
    let spaced = expression.replace('/', " OR ").replace('(', " ( ").replace(')', " ) ");
    let joined = spaced.split_whitespace().collect::<Vec<_>>().join(" ").replace(" WITH ", "\u{1}WITH\u{1}");
    let words: Vec<String> = joined.split(' ').map(|word| word.replace('\u{1}', " ")).collect();
    let mut position = 0;
    let met = any_of(&words, &mut position);
    // Words left over mean that the expression was not understood, which is no permission.
    met && position == words.len()
}

fn any_of(words: &[String], position: &mut usize) -> bool {
    let mut met = all_of(words, position);
    while words.get(*position).is_some_and(|word| word == "OR") {
        *position += 1;
        // Both sides are read in any case, to get past the words.
        met |= all_of(words, position);
    }
    met
}

fn all_of(words: &[String], position: &mut usize) -> bool {
    let mut met = one(words, position);
    while words.get(*position).is_some_and(|word| word == "AND") {
        *position += 1;
        met &= one(words, position);
    }
    met
}

fn one(words: &[String], position: &mut usize) -> bool {
    let Some(word) = words.get(*position) else { return false };
    *position += 1;
    if word != "(" {
        return ALLOWED.contains(word);
    }
    let met = any_of(words, position);
    let closed = words.get(*position).is_some_and(|word| word == ")");
    *position += 1;
    met && closed
}

/// The rows of the tables of THIRD_PARTY.md: name to licence.
fn listed() -> BTreeMap<String, String> {
    read("THIRD_PARTY.md")
        .lines()
        .filter_map(|line| {
            let cells: Vec<&str> = line.split('|').map(str::trim).collect();
            let name = cells.get(1)?.strip_prefix('`')?.strip_suffix('`')?;
            Some((name.to_owned(), (*cells.get(2)?).to_owned()))
        })
        .collect()
}

#[test]
fn expressions_are_judged_as_spdx_defines_them() {
    for good in [
        "MIT",
        "MIT OR GPL-3.0",
        "GPL-3.0/Apache-2.0",
        "(MIT OR Apache-2.0) AND Unicode-3.0",
        "Apache-2.0 WITH LLVM-exception OR GPL-2.0",
        "MIT AND BSD-3-Clause",
    ] {
        assert!(is_allowed(good), "{good}");
    }
    for bad in [
        "",
        "GPL-3.0",
        "MIT AND GPL-3.0",
        "(MIT OR Apache-2.0) AND GPL-3.0",
        "MIT Apache-2.0",
        "(MIT",
        "AGPL-3.0-only",
    ] {
        assert!(!is_allowed(bad), "{bad}");
    }
}

#[test]
fn every_package_in_the_program_comes_under_an_allowed_licence() {
    for (package, license) in &load().licences {
        assert!(
            is_allowed(license),
            "{package} is under \"{license}\", expected something that {:?} can meet: take another crate, or \
             add the licence to deny.toml and explain in THIRD_PARTY.md what it asks of those who ship the program",
            *ALLOWED
        );
    }
}

#[test]
fn every_direct_dependency_is_listed_with_its_licence() {
    let workspace = load();
    let listed = listed();
    let mut missing = Vec::new();
    for member in workspace.members.values() {
        for (dependency, _) in &member.dependencies {
            let prefix = format!("{dependency} ");
            let licenses: Vec<&String> = workspace
                .licences
                .iter()
                .filter(|(p, _)| p.starts_with(&prefix))
                .map(|(_, license)| license)
                .collect();
            let row = listed.get(dependency);
            if !licenses.is_empty() && !licenses.iter().any(|license| row == Some(license)) {
                missing.push(format!("| `{dependency}` | {} |", licenses[0]));
            }
        }
    }
    missing.sort();
    missing.dedup();
    assert!(
        missing.is_empty(),
        "THIRD_PARTY.md lacks these rows, or has another licence:\n{}",
        missing.join("\n")
    );
}

#[test]
fn every_library_of_the_page_is_listed() {
    let listed = listed();
    let package: serde_json::Value =
        serde_json::from_str(&read("rust/bridge/web/package.json")).expect("npm read it already");
    for kind in ["dependencies", "devDependencies"] {
        for name in package[kind].as_object().into_iter().flat_map(|table| table.keys()) {
            assert!(
                listed.contains_key(name),
                "THIRD_PARTY.md lacks `{name}` of rust/bridge/web/package.json"
            );
        }
    }
}

#[test]
fn every_native_library_is_listed() {
    let listed = listed();
    for library in ["KDL", "OMPL", "ODE", "urdfdom", "FCL", "libccd", "Eigen"] {
        assert!(listed.contains_key(library), "THIRD_PARTY.md lacks `{library}`");
    }
}
