//! The guide defines every column of the scores, in the words of the codebook.
#![allow(clippy::unwrap_used)]
#![allow(clippy::disallowed_methods)] // It reads the guide.

use proact_analysis::{
    scoring::{FaultKind, OBJECT_MEASURES, PHASE_MEASURES, TRIAL_MEASURES},
    table::TableColumn,
};
use std::path::Path;

#[test]
fn every_measure_is_defined_in_the_guide() {
    let guide = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/analysis.md");
    let guide = std::fs::read_to_string(guide).unwrap();
    let columns = PHASE_MEASURES.iter().map(|measure| measure.column);
    let columns = columns.chain(OBJECT_MEASURES.iter().map(|measure| measure.column));
    let columns = columns.chain(TRIAL_MEASURES.iter().map(|measure| measure.column));
    let row = |TableColumn { name, unit, meaning, source, .. }: TableColumn| {
        let unit = if unit.is_empty() { "–" } else { unit };
        format!("| `{name}` | {unit} | {meaning} | {source} |")
    };
    let missing: Vec<String> = columns.map(row).filter(|row| !guide.contains(row)).collect();
    assert!(missing.is_empty(), "docs/analysis.md lacks\n{}", missing.join("\n"));
    for kind in FaultKind::ALL {
        assert!(
            guide.contains(&format!("| `{}` |", kind.label())),
            "docs/analysis.md lacks {}",
            kind.label()
        );
    }
}
