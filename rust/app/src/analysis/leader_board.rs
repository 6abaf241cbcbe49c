//! The leader board: methods in the order of their mean score, each beside the next.

use super::{
    AnalysisData,
    comparisons::mean_scores_by_participant,
    summaries::{ReportTable, conditions, format_number, format_p_value, values},
};
use proact_analysis::{
    statistics::{ConfidenceInterval, bootstrap_interval, compare_conditions, tied},
    summary::SampleSummary,
};
use serde::Serialize;

/// A method's place.
#[derive(Clone, Debug, Serialize)]
pub struct LeaderBoardRow {
    /// From 1; the same for equal means.
    #[serde(rename = "place")]
    pub rank: usize,
    /// The method.
    pub method: String,
    /// Scores of its trials.
    #[serde(flatten)]
    pub scores: SampleSummary,
    /// Of the mean of people's means, bootstrap over people, 95 %.
    pub interval: Option<ConfidenceInterval>,
    /// Share of trials with the highest score of all trials; zero if none scored.
    #[serde(rename = "at_most")]
    pub top_score_fraction: f64,
    /// Share of trials with score zero.
    #[serde(rename = "at_zero")]
    pub zero_score_fraction: f64,
    /// How much better it is than the next, over the same people.
    #[serde(rename = "over_next")]
    pub versus_next: Option<PairwiseResult>,
}

/// A paired difference.
#[derive(Clone, Debug, Serialize)]
pub struct PairwiseResult {
    /// Mean difference of people.
    pub mean: f64,
    /// Its interval, 95 %.
    pub interval: Option<ConfidenceInterval>,
    /// Of Wilcoxon's signed ranks, corrected by Holm over all pairs.
    pub p_holm: Option<f64>,
}

impl std::fmt::Display for PairwiseResult {
    fn fmt(&self, to: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(to, "{}", format_number(self.mean, 2))?;
        if let Some(ConfidenceInterval { low, high }) = self.interval {
            write!(to, " [{}, {}]", format_number(low, 2), format_number(high, 2))?;
        }
        self.p_holm.map_or(Ok(()), |p| write!(to, ", p {}", format_p_value(p)))
    }
}

/// The methods of `collected`, best first; `seed` draws the bootstraps.
pub fn leader_board(collected: &AnalysisData, seed: u64) -> Vec<LeaderBoardRow> {
    let conditions = conditions(collected);
    let Some(trials) = collected.table("trials") else { return Vec::new() };
    let found = values(trials, "score", |_| true);
    let max_value = found.iter().map(|value| value.value).fold(f64::NEG_INFINITY, f64::max);
    let pairs = mean_scores_by_participant(&conditions, &found)
        .map(|scores| compare_conditions(&scores, seed).pairs)
        .unwrap_or_default();
    let mut leaders: Vec<LeaderBoardRow> = conditions
        .iter()
        .filter_map(|method| {
            let own: Vec<&super::summaries::ParticipantValue> =
                found.iter().filter(|value| value.condition == *method).collect();
            let scores: Vec<f64> = own.iter().map(|value| value.value).collect();
            let mut people: std::collections::BTreeMap<&str, Vec<f64>> = std::collections::BTreeMap::new();
            own.iter().for_each(|value| people.entry(&value.participant).or_default().push(value.value));
            let means: Vec<f64> =
                people.values().map(|own| own.iter().sum::<f64>() / own.len() as f64).collect();
            let mean = |indices: &[usize]| {
                Some(indices.iter().map(|index| means[*index]).sum::<f64>() / indices.len() as f64)
            };
            let share = |score: f64| {
                scores.iter().filter(|own| tied(**own, score)).count() as f64 / scores.len() as f64
            };
            Some(LeaderBoardRow {
                rank: 0,
                method: method.clone(),
                scores: SampleSummary::of(&scores)?,
                interval: bootstrap_interval(means.len(), seed, mean),
                top_score_fraction: if max_value > 0.0 { share(max_value) } else { 0.0 },
                zero_score_fraction: share(0.0),
                versus_next: None,
            })
        })
        .collect();
    leaders.sort_by(|a, b| b.scores.mean.total_cmp(&a.scores.mean).then(a.method.cmp(&b.method)));
    for k in 0..leaders.len() {
        let shares = k > 0 && tied(leaders[k - 1].scores.mean, leaders[k].scores.mean);
        leaders[k].rank = if shares { leaders[k - 1].rank } else { k + 1 };
        let Some(next) = leaders.get(k + 1).map(|next| next.method.clone()) else { continue };
        let own = leaders[k].method.clone();
        // A pair's difference is its second less its first.
        leaders[k].versus_next = pairs.iter().find_map(|pair| {
            let effect = pair.effect.as_ref()?;
            let (sign, is_it) = if (&pair.b, &pair.a) == (&own, &next) {
                (1.0, true)
            } else {
                (-1.0, (&pair.a, &pair.b) == (&own, &next))
            };
            let turned = |interval: ConfidenceInterval| {
                if sign > 0.0 {
                    interval
                } else {
                    ConfidenceInterval { low: -interval.high, high: -interval.low }
                }
            };
            is_it.then(|| PairwiseResult {
                mean: sign * effect.mean,
                interval: effect.mean_interval.map(turned),
                p_holm: pair.p_holm,
            })
        });
    }
    leaders
}

/// The same as a table.
pub(super) fn leader_table(leaders: &[LeaderBoardRow]) -> ReportTable {
    let percent = |share: f64| format!("{} %", format_number(share * 100.0, 0));
    let row = |leader: &LeaderBoardRow| {
        let interval = leader.interval.map_or_else(String::new, |i| {
            format!(" [{}, {}]", format_number(i.low, 2), format_number(i.high, 2))
        });
        vec![
            leader.rank.to_string(),
            leader.method.clone(),
            leader.scores.count.to_string(),
            format_number(leader.scores.mean, 2) + &interval,
            leader.scores.sd.map_or_else(|| "–".to_owned(), |sd| format_number(sd, 2)),
            percent(leader.top_score_fraction),
            percent(leader.zero_score_fraction),
            leader.versus_next.as_ref().map_or_else(|| "–".to_owned(), ToString::to_string),
        ]
    };
    ReportTable {
        name: "leaders",
        title: "Leader board".to_owned(),
        caption: "Methods by the mean of their scores. All meet the same simulated people and seeds; these are no evidence about people. \
                  Interval of the mean: bootstrap over people, 95 %. All, none: trials with the highest score of any trial, and with zero. \
                  Over the next: mean paired difference over people with its interval, and p of Wilcoxon's signed ranks, corrected by Holm \
                  over all pairs."
            .to_owned(),
        headers: ["Place", "method", "trials", "mean", "sd", "all", "none", "over the next"].map(str::to_owned).to_vec(),
        rows: leaders.iter().map(row).collect(),
    }
}
