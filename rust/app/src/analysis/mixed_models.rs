//! Mixed and ordinal models, by R where it is there.

use super::summaries::{ReportTable, format_number, format_p_value};
use proact_files::write_atomically;
use std::{collections::BTreeMap, error::Error, path::Path, process::Command};

/// The script, which is written beside the tables that it reads.
const SCRIPT: &str = include_str!("mixed_models.R");
pub(super) const SCRIPT_FILE: &str = "mixed_models.R";

/// Writes the script into `out` and runs it: the models as a table, or why there are none.
///
/// # Errors
/// A full disk, a table of the script that cannot be read.
pub(super) fn fit_mixed_models(out: &Path) -> Result<Result<Option<ReportTable>, String>, Box<dyn Error>> {
    write_atomically(&out.join(SCRIPT_FILE), SCRIPT)?;
    let again = format!("Rscript {SCRIPT_FILE} in the report's folder fits them");
    let run = Command::new("Rscript").arg("--vanilla").arg(SCRIPT_FILE).arg(".").current_dir(out).output();
    match run {
        Ok(run) if run.status.success() => {}
        Ok(run) => {
            let stderr = String::from_utf8_lossy(&run.stderr).into_owned();
            let last =
                stderr.lines().rfind(|line| !line.trim().is_empty()).unwrap_or("it said nothing").to_owned();
            return Ok(Err(format!(
                "No mixed models: R could not fit them ({last}). They need R with lme4 and ordinal (apt-get install r-cran-lme4 \
                 r-cran-ordinal); {again}."
            )));
        }
        Err(_) => {
            return Ok(Err(format!(
                "No mixed models: Rscript was not found (apt-get install r-base-core r-cran-lme4 r-cran-ordinal); {again}."
            )));
        }
    }
    let mut reader = csv::Reader::from_path(out.join("tables/mixed_models.csv"))?;
    let mut rows = Vec::new();
    for record in reader.deserialize::<BTreeMap<String, String>>() {
        let record = record?;
        let text = |name: &str| {
            let found = record.get(name).cloned();
            found.ok_or_else(|| format!("{SCRIPT_FILE} wrote no column {name} into tables/mixed_models.csv"))
        };
        // What could not be estimated is empty.
        let number = |name: &str, print: &dyn Fn(f64) -> String| -> Result<String, Box<dyn Error>> {
            match text(name)?.as_str() {
                "" => Ok("–".to_owned()),
                text => {
                    Ok(print(text.parse().map_err(|_| format!("{SCRIPT_FILE} wrote {name} = {text:?}"))?))
                }
            }
        };
        rows.push(vec![
            text("measure")?,
            text("model")?,
            text("term")?,
            number("estimate", &|value| format_number(value, 3))?,
            number("se", &|value| format_number(value, 3))?,
            number("z", &|value| format_number(value, 2))?,
            number("p", &format_p_value)?,
            text("n")?,
            text("participants")?,
            text("note")?,
        ]);
    }
    let head = ["Measure", "model", "term", "estimate", "se", "z", "p (Wald)", "n", "participants", "note"];
    Ok(Ok((!rows.is_empty()).then(|| ReportTable {
        name: "mixed_models",
        title: "Mixed and ordinal models".to_owned(),
        caption: "By R (lme4, ordinal): method as fixed effect beside the first one by name, participants at random; mixed_models.R says \
                  more. Wald's p is too small with few participants. A note says where a model is no evidence."
            .to_owned(),
        headers: head.map(str::to_owned).to_vec(),
        rows,
    })))
}
