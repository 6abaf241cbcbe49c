//! The power of a study's design.

use super::Study;
use crate::analysis::{ChartError, Collected, power_curve};
pub use proact_analysis::power::PowerOptions;
use proact_analysis::power::{ExpectedEffect, Power, Scores, power};
use proact_types::MOST_TEXT_BYTES;
use serde::Serialize;
use std::{collections::BTreeMap, error::Error, fs, path::Path};

/// The power of a study with so many people.
#[derive(Clone, Debug, Serialize)]
pub struct PowerOfSize {
    /// People.
    pub people: usize,
    /// What they would find.
    #[serde(flatten)]
    pub power: Power,
}

/// Reads what is expected from a file.
///
/// # Errors
/// A file that cannot be read, a name that is not known, a condition that is missing; with the file's name.
pub fn expected_effect(path: &Path) -> Result<Scores, Box<dyn Error>> {
    let failed = |error: &dyn std::fmt::Display| format!("{}: {error}", path.display());
    let text = fs::File::open(path)
        .and_then(|file| proact_types::read_text(file, MOST_TEXT_BYTES))
        .map_err(|error| failed(&error))?;
    let effect: ExpectedEffect = toml::from_str(&text).map_err(|error| failed(&error))?;
    Ok(Scores::Expected(effect))
}

/// Scores of the people of a pilot, recorded or simulated, under the conditions of `study`; the score is the column `measure` of its
/// table of trials.
///
/// # Errors
/// A measure that the trials do not have.
pub fn pilot(study: &Study, pilot: &Collected, measure: &str) -> Result<Scores, Box<dyn Error>> {
    let trials = &pilot.tables["trials"];
    if trials.place(measure).is_none() {
        return Err(format!(
            "the trials have no {measure}, expected a column of trials.csv such as score or seconds"
        )
        .into());
    }
    let conditions = study.conditions();
    let mut people: BTreeMap<String, Vec<Vec<f64>>> = BTreeMap::new();
    for row in &trials.rows {
        let place = conditions.iter().position(|name| *name == trials.words(row, "condition"));
        if let (Some(place), Some(score)) = (place, trials.number(row, measure)) {
            let own = people.entry(trials.words(row, "participant"));
            own.or_insert_with(|| vec![Vec::new(); conditions.len()])[place].push(score);
        }
    }
    Ok(Scores::Pilot(people.into_values().collect()))
}

/// The power of the study's own design with each of `sizes` people. `tell` hears each size before it is simulated.
///
/// # Errors
/// A size for which the plan has no order, an effect that does not fit the plan.
pub fn power_by_size(
    study: &Study,
    scores: &Scores,
    sizes: &[usize],
    options: &PowerOptions,
    mut tell: impl FnMut(usize),
) -> Result<Vec<PowerOfSize>, Box<dyn Error>> {
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
            let place = conditions.iter().position(|name| *name == trial.condition);
            orders.entry(trial.participant).or_default().extend(place);
        }
        // A plan that names its orders has as many as it names, whatever the number of people: these take turns.
        let design: Vec<Vec<usize>> = orders.values().cycle().take(people).cloned().collect();
        found.push(PowerOfSize { people, power: power(&conditions, &design, scores, options)? });
    }
    Ok(found)
}

/// The curve as SVG and PNG.
///
/// # Errors
/// [`ChartError`].
pub fn power_figure(found: &[PowerOfSize]) -> Result<(String, Vec<u8>), ChartError> {
    let mut points = Vec::new();
    for PowerOfSize { people, power } in found {
        let pairs = power.pairs.iter().map(|(a, b, share)| (format!("{a} and {b}"), share.share));
        let any = power.any.map(|share| ("any".to_owned(), share.share));
        points.extend(any.into_iter().chain(pairs).map(|(part, share)| (*people, part, share)));
    }
    power_curve(&points)
}
