//! Number and pitch of a task's objects as keys of a sweep.
#![allow(clippy::disallowed_methods, clippy::unwrap_used)] // A test of files and processes.

use std::{collections::BTreeMap, path::Path, process::Command};

/// Rows of a table as the columns by name.
fn table(path: &Path) -> Vec<BTreeMap<String, String>> {
    let mut reader = csv::Reader::from_path(path).unwrap();
    let columns = reader.headers().unwrap().clone();
    let row = |row: csv::StringRecord| {
        columns.iter().map(str::to_owned).zip(row.iter().map(str::to_owned)).collect()
    };
    reader.records().map(|record| row(record.unwrap())).collect()
}

#[test]
fn number_and_pitch_of_objects_are_swept_by_keys_and_come_out_as_any_other_axis() {
    let temp_dir = tempfile::tempdir().unwrap();
    let task = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/tasks/cluttered.toml");
    let simulate = |words: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_proact"));
        command
            .args(["simulate", "--methods", "C,D", "--seeds", "1", "--time-limit", "0.5", "--task"])
            .arg(&task);
        command.args(words).current_dir(temp_dir.path()).output().unwrap()
    };
    let output = simulate(&[
        "--sweep",
        "task.grid.count=4,[2, 3]",
        "--sweep",
        "task.grid.spacing_m=0.06,[0.1, 0.05]",
        "--out",
        "grid",
    ]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let dir = temp_dir.path().join("grid");
    let rows = table(&dir.join("sweep.csv"));
    let cells: Vec<[&str; 3]> = rows
        .iter()
        .map(|row| ["task.grid.count", "task.grid.spacing_m", "method"].map(|key| &*row[key]))
        .collect();
    assert_eq!(cells.len(), 8, "four cells of two methods: {cells:?}");
    assert_eq!(cells[2], ["4", "[0.1, 0.05]", "C"]);
    assert!(dir.join("sweep/heat_map_1.svg").is_file());
    // Each trial really had so many blocks.
    let mut blocks: BTreeMap<String, usize> = BTreeMap::new();
    for row in table(&dir.join("blocks.csv")) {
        *blocks.entry(row["condition"].clone()).or_default() += 1;
    }
    assert_eq!(blocks["C, task.grid.count=4, task.grid.spacing_m=0.06"], 4);
    assert_eq!(blocks["D, task.grid.count=[2, 3], task.grid.spacing_m=0.06"], 6);
    // What cannot be is told before the first trial.
    let output = simulate(&["--sweep", "task.grid.spacing_m=0.06,0.02", "--out", "other"]);
    let error = String::from_utf8(output.stderr).unwrap();
    assert!(!output.status.success() && error.contains("overlaps"), "{error}");
    assert_eq!(error.trim_end().lines().count(), 1, "one sentence: {error}");
}
