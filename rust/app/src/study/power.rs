//! The power of a study's design.

use super::Study;
use crate::{
    analysis::{AnalysisData, ChartError, power_curve},
    warn_of_renamed_keys,
};
pub use proact_analysis::power::PowerOptions;
use proact_analysis::power::{ExpectedEffect, ScoreModel, StatisticalPower, simulate_power};
use proact_types::{
    MAX_TEXT_BYTES,
    renamed_keys::{ConfigFile, RenamedKey, rename_keys_in_toml},
};
use serde::Serialize;
use std::{collections::BTreeMap, error::Error, fs, path::Path};

/// The power of a study with so many people.
#[derive(Clone, Debug, Serialize)]
pub struct PowerAtSampleSize {
    /// People.
    #[serde(rename = "people")]
    pub participants: usize,
    /// What they would find.
    #[serde(flatten)]
    pub power: StatisticalPower,
}

/// Reads what is expected from a file.
///
/// # Errors
/// A file that cannot be read, a name that is not known, a condition that is missing; with the file's name.
pub fn read_expected_effect(path: &Path) -> Result<ScoreModel, Box<dyn Error>> {
    let failed = |error: &dyn std::fmt::Display| format!("{}: {error}", path.display());
    let text = fs::File::open(path)
        .and_then(|file| proact_types::read_text(file, MAX_TEXT_BYTES))
        .map_err(|error| failed(&error))?;
    let (effect, renamed) = expected_effect(&text).map_err(|error| failed(&error))?;
    warn_of_renamed_keys(&renamed);
    Ok(ScoreModel::Expected(effect))
}

/// What `text` says, and the keys in it that have another name now.
fn expected_effect(text: &str) -> Result<(ExpectedEffect, Vec<&'static RenamedKey>), Box<dyn Error>> {
    let (text, renamed) = rename_keys_in_toml(text, ConfigFile::ExpectedEffect, "")?;
    Ok((toml::from_str(&text)?, renamed))
}

/// Scores of the people of a pilot, recorded or simulated, under the conditions of `study`; the score is the column `measure` of its
/// table of trials.
///
/// # Errors
/// A measure that the trials do not have.
pub fn pilot_scores(
    study: &Study,
    pilot: &AnalysisData,
    measure: &str,
) -> Result<ScoreModel, Box<dyn Error>> {
    let trials = &pilot.tables["trials"];
    if trials.column_index(measure).is_none() {
        return Err(format!(
            "the trials have no {measure}, expected a column of trials.csv such as score or seconds"
        )
        .into());
    }
    let conditions = study.conditions();
    let mut people: BTreeMap<String, Vec<Vec<f64>>> = BTreeMap::new();
    for row in &trials.rows {
        let index = conditions.iter().position(|name| *name == trials.text(row, "condition"));
        if let (Some(index), Some(score)) = (index, trials.number(row, measure)) {
            let own = people.entry(trials.text(row, "participant"));
            own.or_insert_with(|| vec![Vec::new(); conditions.len()])[index].push(score);
        }
    }
    Ok(ScoreModel::Pilot(people.into_values().collect()))
}

/// The power of the study's own design with each of `sizes` people. `tell` hears each size before it is simulated.
///
/// # Errors
/// A size for which the plan has no order, an effect that does not fit the plan.
pub fn power_by_size(
    study: &Study,
    scores: &ScoreModel,
    sizes: &[usize],
    options: &PowerOptions,
    mut tell: impl FnMut(usize),
) -> Result<Vec<PowerAtSampleSize>, Box<dyn Error>> {
    let conditions = study.conditions();
    let mut found = Vec::new();
    for &people in sizes {
        tell(people);
        let mut plan = study.plan.clone();
        plan.participants = people;
        let schedule =
            plan.schedule(&study.arrangements).map_err(|error| format!("{people} people: {error}"))?;
        let mut orders: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        for trial in schedule.trials() {
            let index = conditions.iter().position(|name| *name == trial.condition);
            orders.entry(trial.participant).or_default().extend(index);
        }
        // A plan that names its orders has as many as it names, whatever the number of people: these take turns.
        let design: Vec<Vec<usize>> = orders.values().cycle().take(people).cloned().collect();
        found.push(PowerAtSampleSize {
            participants: people,
            power: simulate_power(&conditions, &design, scores, options)?,
        });
    }
    Ok(found)
}

/// The curve as SVG and PNG.
///
/// # Errors
/// [`ChartError`].
pub fn power_figure(found: &[PowerAtSampleSize]) -> Result<(String, Vec<u8>), ChartError> {
    let mut points = Vec::new();
    for PowerAtSampleSize { participants: people, power } in found {
        let pairs = power.pairs.iter().map(|(a, b, share)| (format!("{a} and {b}"), share.value));
        let any = power.any_difference.map(|share| ("any".to_owned(), share.value));
        points.extend(any.into_iter().chain(pairs).map(|(part, share)| (*people, part, share)));
    }
    power_curve(&points)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proact_types::renamed_keys::RENAMED_KEYS;

    #[test]
    fn an_effect_of_old_keys_is_that_of_the_present_ones_and_each_is_told() {
        let read =
            |text: &str| expected_effect(&format!("{text}[conditions]\nA = {{ mean = 2.0, sd = 1.5 }}\n"));
        let old = "least = 0\nmost = 4\nstep = 1\nperson_share = 0.3\nsame_person = 0.6\n";
        let new = "min_score = 0\nmax_score = 4\nscore_step = 1\nintraclass_correlation = 0.3\ncondition_correlation = 0.6\n";
        let ((from_old, noted), (from_new, none)) = (read(old).unwrap(), read(new).unwrap());
        assert_eq!((from_old, none.len()), (from_new, 0));
        let rows = RENAMED_KEYS.iter().filter(|row| row.file == ConfigFile::ExpectedEffect);
        assert_eq!(noted, rows.collect::<Vec<_>>());
        let error = read(&(old.to_owned() + "max_score = 5\n")).unwrap_err().to_string();
        assert_eq!(error, "most is the old name of max_score: both are given, expected max_score alone");
    }
}
