use super::{
    ConfidenceInterval, Friedman, PairedEffect, PermutationTest, RepeatedMeasures, StatisticsError, Wilcoxon,
    bootstrap_interval, friedman, friedman::kendalls_w, holm_of_pairs, skewness_test,
    wilcoxon::PairedDifferences,
};
use serde::Serialize;

/// Below this chance of skewness, differences are called skewed.
const SKEWNESS_ALPHA: f64 = 0.05;
/// An interval of fewer people than this is too narrow.
const MIN_PARTICIPANTS_FOR_INTERVAL: usize = 10;

/// All that can be said of one measure under several conditions.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ConditionComparison {
    /// Whether any condition differs; none where that cannot be asked, with the reason in `notes`.
    pub friedman: Option<Friedman>,
    /// Interval of Kendall's W.
    pub kendalls_w_interval: Option<ConfidenceInterval>,
    /// Each two conditions.
    pub pairs: Vec<PairwiseComparison>,
    /// What was presumed, left out, or cannot be said.
    pub notes: Vec<String>,
}

/// Two conditions of a measure.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PairwiseComparison {
    /// One condition.
    pub a: String,
    /// The other one; differences are `b` less `a`.
    pub b: String,
    /// People with both values.
    pub n: usize,
    /// People without one of them.
    #[serde(rename = "left_out")]
    pub excluded: usize,
    /// The test of the ranks; none if nothing differs.
    pub wilcoxon: Option<Wilcoxon>,
    /// Its chance corrected by Holm for all pairs of this measure, those in which nothing differs too.
    pub p_holm: Option<f64>,
    /// The test of the mean; none without people.
    pub permutation: Option<PermutationTest>,
    /// How much they differ.
    pub effect: Option<PairedEffect>,
}

/// Compares the conditions of one measure. What is drawn comes from `seed`.
pub fn compare_conditions(values: &RepeatedMeasures, seed: u64) -> ConditionComparison {
    let mut notes = Vec::new();
    let complete = values.complete();
    let missing = values.participant_count() - complete.len();
    let conditions = values.conditions();
    let mut ranked = None;
    if conditions.len() > 2 {
        match friedman(&complete) {
            Ok(test) => ranked = Some(test),
            Err(error) => notes.push(format!("No Friedman test: {error}.")),
        }
        if missing > 0 {
            notes.push(format!(
                "{missing} of {} people lack a value under some condition and are not in the Friedman test.",
                values.participant_count()
            ));
        }
    }
    let kendalls_w_interval = ranked.as_ref().and_then(|_| {
        bootstrap_interval(complete.len(), seed, |indices| {
            let drawn: Vec<Vec<f64>> = indices.iter().map(|index| complete[*index].clone()).collect();
            kendalls_w(&drawn)
        })
    });
    let mut pairs = Vec::new();
    for a in 0..conditions.len() {
        for b in a + 1..conditions.len() {
            pairs.push(compare_pair(values, a, b, seed, &mut notes));
        }
    }
    let p_values: Vec<_> = pairs.iter().map(|pair| Some(pair.wilcoxon.as_ref()?.p)).collect();
    for (pair, corrected) in pairs.iter_mut().zip(holm_of_pairs(&p_values)) {
        pair.p_holm = corrected;
    }
    let count = pairs.len() as f64;
    if let Some(min_p) = pairs.iter().filter_map(|pair| Some(pair.wilcoxon.as_ref()?.min_p)).reduce(f64::min)
        && min_p * count > 0.05
    {
        notes.push(format!(
            "So few people cannot show a difference: the smallest chance after the correction for {count} pairs is {:.3}.",
            (min_p * count).min(1.0)
        ));
    }
    if (1..MIN_PARTICIPANTS_FOR_INTERVAL).contains(&values.participant_count()) {
        notes.push(format!("Bootstrap intervals of {} people are too narrow.", values.participant_count()));
    }
    ConditionComparison { friedman: ranked, kendalls_w_interval, pairs, notes }
}

fn compare_pair(
    values: &RepeatedMeasures,
    a: usize,
    b: usize,
    seed: u64,
    notes: &mut Vec<String>,
) -> PairwiseComparison {
    let names = values.conditions();
    let (name_a, name_b) = (names[a].clone(), names[b].clone());
    let paired = PairedDifferences::of(&values.pairs(a, b));
    let differences = &paired.values;
    let ranked = match paired.wilcoxon() {
        Ok(test) => Some(test),
        Err(StatisticsError::AllEqual { .. }) => {
            notes.push(format!("{name_a} and {name_b}: nobody differs."));
            None
        }
        Err(error) => {
            notes.push(format!("{name_a} and {name_b}: {error}."));
            None
        }
    };
    if let Some(test) = &ranked
        && test.zeros > 0
    {
        let people = differences.len();
        notes.push(format!(
            "{name_a} and {name_b}: {} of {people} people do not differ and are not ranked.",
            test.zeros
        ));
    }
    let effect = PairedEffect::of_differences(&paired, seed);
    // Without a g the differences spread by rounding alone.
    if effect.is_some_and(|effect| effect.hedges_g.is_some())
        && let Some([skewness, p]) = skewness_test(differences)
        && p < SKEWNESS_ALPHA
    {
        notes.push(format!(
            "{name_a} and {name_b}: differences are skewed ({skewness:.2}, p = {p:.3}); the signed-rank test then speaks of \
             their ranks, not of their median."
        ));
    }
    PairwiseComparison {
        n: differences.len(),
        excluded: values.participant_count() - differences.len(),
        wilcoxon: ranked,
        p_holm: None,
        permutation: paired.permutation(seed).ok(),
        effect,
        a: name_a,
        b: name_b,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn repeated(rows: &[[f64; 3]]) -> RepeatedMeasures {
        let rows = rows.iter().map(|row| row.iter().map(|v| v.is_finite().then_some(*v)).collect()).collect();
        RepeatedMeasures::new(["A", "B", "C"].map(str::to_owned).to_vec(), rows).unwrap()
    }

    #[test]
    fn a_missing_value_costs_only_the_pairs_that_need_it() {
        let found = compare_conditions(
            &repeated(&[[1.0, 2.0, 3.0], [2.0, 4.0, 5.0], [1.0, f64::NAN, 4.0], [0.0, 1.0, 5.0]]),
            1,
        );
        assert_eq!(found.friedman.as_ref().unwrap().n, 3);
        let people: Vec<_> =
            found.pairs.iter().map(|p| (p.a.as_str(), p.b.as_str(), p.n, p.excluded)).collect();
        assert_eq!(people, [("A", "B", 3, 1), ("A", "C", 4, 0), ("B", "C", 3, 1)]);
        // 0.25, 0.125, 0.25: corrected 0.5, 0.375, 0.5.
        let corrected: Vec<_> = found.pairs.iter().filter_map(|p| p.p_holm).collect();
        assert_eq!(corrected, [0.5, 0.375, 0.5]);
        assert!(found.notes.iter().any(|note| note.contains("1 of 4 people lack")), "{:?}", found.notes);
        assert!(
            found.notes.iter().any(|note| note.contains("cannot show a difference")),
            "{:?}",
            found.notes
        );
    }

    /// A pair without a difference fell out of the correction, and the others were corrected for too few: 0.125 x 2 for x 3.
    #[test]
    fn a_pair_without_a_difference_counts_in_the_correction_as_it_does_for_power() {
        let rows = [[0.1 + 0.2, 0.3, 3.0], [2.0, 2.0, 5.0], [1.0, 1.0, 4.0], [0.0, 0.0, 5.0]];
        let found = compare_conditions(&repeated(&rows), 1);
        let corrected: Vec<_> = found.pairs.iter().map(|p| p.p_holm).collect();
        assert_eq!(corrected, [None, Some(0.375), Some(0.375)]);
    }

    #[test]
    fn ties_everywhere_and_nobody_at_all_are_said() {
        let found = compare_conditions(&repeated(&[[4.0; 3]; 5]), 1);
        assert!(found.friedman.is_none() && found.pairs.iter().all(|pair| pair.wilcoxon.is_none()));
        assert_eq!(found.notes.iter().filter(|note| note.contains("nobody differs")).count(), 3);
        let nobody = compare_conditions(&repeated(&[]), 1);
        assert!(nobody.friedman.is_none() && nobody.pairs.iter().all(|pair| pair.effect.is_none()));
        assert!(
            nobody.notes.iter().any(|note| note.contains("at least 2 people, got 0")),
            "{:?}",
            nobody.notes
        );
    }
}
