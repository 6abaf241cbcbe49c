#![allow(clippy::disallowed_methods)] // The page of renames is a file.

use super::*;

/// A row whose unit changes as well.
const MILLISECONDS: RenamedKey = RenamedKey {
    file: ConfigFile::Trial,
    old: "dead_man.wait",
    new: "dead_man.timeout_ms",
    factor: 1000.0,
    since: "0.1.0",
};

fn toml_tree(text: &str) -> toml::Value {
    toml::Value::Table(toml::from_str(text).unwrap())
}

#[test]
fn the_factor_is_applied_to_numbers_and_lists_of_them_and_told() {
    let renamed = |value: &str| {
        let mut tree = toml_tree(&format!("dead_man.wait = {value}"));
        let used = rename_keys_of(&[MILLISECONDS], &mut tree, ConfigFile::Trial, "").unwrap();
        assert_eq!(used.len(), 1);
        tree["dead_man"]["timeout_ms"].clone()
    };
    assert_eq!(renamed("0.25"), toml::Value::Integer(250), "whole where it can be");
    assert_eq!(renamed("0.0005"), toml::Value::Float(0.5));
    assert_eq!(renamed("2"), toml::Value::Integer(2000));
    assert_eq!(renamed("[1, 0.5]").to_string(), "[1000, 500]");
    assert_eq!(renamed("inf"), toml::Value::Float(f64::INFINITY));
    assert_eq!(renamed("\"long\"").as_str(), Some("long"), "its reader refuses it");
    let mut json = serde_json::json!({"wait": 0.25});
    rename_keys_of(&[MILLISECONDS], &mut json, ConfigFile::Trial, "dead_man").unwrap();
    assert_eq!(json, serde_json::json!({"timeout_ms": 250}));
    assert_eq!(
        MILLISECONDS.to_string(),
        "dead_man.wait is now dead_man.timeout_ms, the old value times 1000"
    );
}

#[test]
fn each_row_renames_its_key_in_toml_and_in_json_and_is_told_once() {
    for row in RENAMED_KEYS {
        let section = if row.file == ConfigFile::NodeParameter { continue } else { row.old };
        let (mut tree, mut json) =
            (nested(section, toml::Value::Integer(1)), nested(section, serde_json::json!(1)));
        let used = rename_keys(&mut tree, row.file, "").unwrap();
        assert_eq!(tree, nested(row.new, toml::Value::Integer(1)), "{row}");
        assert_eq!(used.iter().filter(|used| **used == row).count(), 1, "{row}");
        let mut shown = ShownRenames::new();
        assert_eq!(shown.first_uses(&used), used);
        assert!(shown.first_uses(&used).is_empty(), "{row} is told once");
        assert_eq!(rename_keys(&mut json, row.file, ""), Ok(used));
        assert_eq!(json, nested(row.new, serde_json::json!(1)), "{row}");
        assert_eq!(
            rename_keys(&mut tree, row.file, ""),
            Ok(Vec::new()),
            "{row}: the new name is none of the old ones"
        );
    }
}

/// `value` at `path`, with lists of one.
fn nested<T: ConfigTree + Listed>(path: &str, value: T) -> T {
    path.split('.').rev().fold(value, |inner, step| match step.strip_suffix("[]") {
        Some(list) => T::table(list, T::list(inner)),
        None => T::table(step, inner),
    })
}

trait Listed {
    fn list(item: Self) -> Self;
}

impl Listed for toml::Value {
    fn list(item: Self) -> Self {
        toml::Value::Array(vec![item])
    }
}

impl Listed for serde_json::Value {
    fn list(item: Self) -> Self {
        serde_json::Value::Array(vec![item])
    }
}

// Catches a row whose value a node would take for one of the new unit.
#[test]
fn parameters_of_nodes_keep_their_units() {
    let rows = RENAMED_KEYS.iter().filter(|row| row.file == ConfigFile::NodeParameter);
    assert!(rows.inspect(|row| assert!(row.new.starts_with('~'), "{row}")).all(|row| row.factor == 1.0));
}

#[test]
fn the_table_is_in_an_order_in_which_it_can_be_applied() {
    let mut tables = vec![];
    for row in RENAMED_KEYS {
        let table = |path: &'static str| path.rsplit_once('.').map_or("", |(table, _)| table);
        let (old, new) = (table(row.old), table(row.new));
        let present = tables.iter().rev().fold(old.to_owned(), |path, earlier: &&RenamedKey| {
            match path.strip_prefix(earlier.old).map(|rest| rest.trim_start_matches("[]")) {
                Some(rest) if earlier.file == row.file && (rest.is_empty() || rest.starts_with('.')) => {
                    path.replacen(earlier.old, earlier.new, 1)
                }
                _ => path,
            }
        });
        assert_eq!(present, new, "{row}: the row of its table comes first");
        let of_file = |other: &&RenamedKey| other.file == row.file;
        assert_eq!(
            RENAMED_KEYS.iter().filter(of_file).filter(|other| other.old == row.old).count(),
            1,
            "{row}"
        );
        assert_eq!(
            RENAMED_KEYS.iter().filter(of_file).filter(|other| other.new == row.new).count(),
            1,
            "{row}"
        );
        assert!(!RENAMED_KEYS.iter().filter(of_file).any(|other| other.old == row.new), "{row}");
        tables.push(row);
    }
}

#[test]
fn a_key_by_both_names_is_refused_in_a_sentence() {
    for row in RENAMED_KEYS {
        let (_, old, new) = row.split();
        let path = row.new.strip_suffix(new).unwrap();
        let one = toml::Value::Integer(1);
        let mut tree = nested(&format!("{path}{old}"), one.clone());
        let mut inner = &mut tree;
        for step in path.split('.').filter(|step| !step.is_empty()) {
            inner = inner.child_mut(step.trim_end_matches("[]")).unwrap();
            if step.ends_with("[]") {
                inner = &mut inner.items_mut()[0];
            }
        }
        inner.put(new, one);
        let error = rename_keys(&mut tree, row.file, "").unwrap_err().to_string();
        assert_eq!(
            error,
            format!("{} is the old name of {1}: both are given, expected {1} alone", row.old, row.new)
        );
    }
}

#[test]
fn an_assignment_has_the_depth_that_it_had_and_its_value_is_renamed_too() {
    let number = toml::Value::Float(0.4);
    let (key, value, used) =
        rename_assignment("planner.max_velocity", number.clone(), ConfigFile::Trial).unwrap();
    assert_eq!((key.as_str(), value, used.len()), ("planner.max_velocity_rad_per_s", number.clone(), 1));
    let inner = toml_tree("max_velocity = 0.4\nmax_jerk = 2.0");
    let (key, value, used) = rename_assignment("planner", inner, ConfigFile::Trial).unwrap();
    assert_eq!((key.as_str(), used.len()), ("planner", 2));
    assert_eq!(value, toml_tree("max_velocity_rad_per_s = 0.4\nmax_jerk_rad_per_s3 = 2.0"));
    let (key, _, used) = rename_assignment("profile.jog.steps.slow", number, ConfigFile::Trial).unwrap();
    assert_eq!((key.as_str(), used.len()), ("profile.jog.speed_steps.slow_factor", 2));
    let list = toml_tree("impairments = [{link = \"gaze\", loss = 0.1}]")["impairments"].clone();
    let (_, value, _) = rename_assignment("impairments", list, ConfigFile::Trial).unwrap();
    assert_eq!(value.to_string(), "[{ link = \"gaze\", loss_probability = 0.1 }]");
}

#[test]
fn a_text_without_old_names_stays_as_it_is() {
    for text in ["seed = 1\n# nothing\n", "no toml", ""] {
        let (same, used) = rename_keys_in_toml(text, ConfigFile::Trial, "").unwrap();
        assert!(matches!(same, Cow::Borrowed(same) if same == text) && used.is_empty());
    }
    let (text, used) = rename_keys_in_toml("[blend]\nshare = 0.5\n", ConfigFile::Trial, "profile").unwrap();
    assert_eq!((text.trim(), used.len()), ("[blend]\nassistance_share = 0.5", 1));
}

#[test]
fn lines_stay_where_they_are() {
    let text = "# our lab\n\n[emg]\nrequired = 5 # of three\n\n[gaze]\nfilter_hz = 3\n";
    let (renamed, used) = rename_keys_in_toml(text, ConfigFile::Trial, "").unwrap();
    assert_eq!(
        (renamed.as_ref(), used.len()),
        (text.replace("required", "consecutive_decisions").as_str(), 1)
    );
    // An old name that is a key elsewhere too: the text is written anew, and means the same.
    let text = "[emg]\nrequired = 5\n[other]\nrequired = 1\n";
    let (renamed, _) = rename_keys_in_toml(text, ConfigFile::Trial, "").unwrap();
    let table: toml::Table = renamed.parse().unwrap();
    assert_eq!(table["emg"]["consecutive_decisions"].as_integer(), Some(5));
    assert_eq!(table["other"]["required"].as_integer(), Some(1));
}

/// `docs/renames.md` lists the table. With `UPDATE_EXPECTED=1` the test writes it there.
#[test]
fn the_page_of_renames_has_every_row() {
    const HEADING: &str = "## Configuration keys\n";
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/renames.md");
    let page = std::fs::read_to_string(path).unwrap();
    let start = page.find(HEADING).expect("the heading") + HEADING.len();
    let end = page[start..].find("\n## ").map_or(page.len(), |length| start + length + 1);
    let section = &page[start..end];
    let first = section.find("### ").unwrap_or(section.len());
    let expected = renamed_keys_page();
    if std::env::var_os("UPDATE_EXPECTED").is_some() {
        let written = format!("{}{expected}{}", &page[..start + first], &page[end..]);
        std::fs::write(path, written.trim_end().to_owned() + "\n").unwrap();
    } else {
        assert_eq!(section[first..].trim(), expected.trim(), "UPDATE_EXPECTED=1 writes it");
    }
}
