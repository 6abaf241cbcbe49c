//! The leader board: methods in the order of their mean score, each beside the next.

use super::{
    Collected,
    comparisons::repeated_scores,
    summaries::{ReportTable, chance, conditions, printed, values},
};
use proact_analysis::{
    statistics::{Interval, bootstrap, compare, tied},
    summary::SampleSummary,
};
use serde::Serialize;

/// A method's place.
#[derive(Clone, Debug, Serialize)]
pub struct Leader {
    /// From 1; the same for equal means.
    pub place: usize,
    /// The method.
    pub method: String,
    /// Scores of its trials.
    #[serde(flatten)]
    pub scores: SampleSummary,
    /// Of the mean of people's means, bootstrap over people, 95 %.
    pub interval: Option<Interval>,
    /// Share of trials with the highest score of all trials; zero if none scored.
    pub at_most: f64,
    /// Share of trials with score zero.
    pub at_zero: f64,
    /// How much better it is than the next, over the same people.
    pub over_next: Option<Lead>,
}

/// A paired difference.
#[derive(Clone, Debug, Serialize)]
pub struct Lead {
    /// Mean difference of people.
    pub mean: f64,
    /// Its interval, 95 %.
    pub interval: Option<Interval>,
    /// Of Wilcoxon's signed ranks, corrected by Holm over all pairs.
    pub p_holm: Option<f64>,
}

impl std::fmt::Display for Lead {
    fn fmt(&self, to: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(to, "{}", printed(self.mean, 2))?;
        if let Some(Interval { low, high }) = self.interval {
            write!(to, " [{}, {}]", printed(low, 2), printed(high, 2))?;
        }
        self.p_holm.map_or(Ok(()), |p| write!(to, ", p {}", chance(p)))
    }
}

/// The methods of `collected`, best first; `seed` draws the bootstraps.
pub fn leader_board(collected: &Collected, seed: u64) -> Vec<Leader> {
    let conditions = conditions(collected);
    let Some(trials) = collected.table("trials") else { return Vec::new() };
    let found = values(trials, "score", |_| true);
    let most = found.iter().map(|value| value.value).fold(f64::NEG_INFINITY, f64::max);
    let pairs =
        repeated_scores(&conditions, &found).map(|scores| compare(&scores, seed).pairs).unwrap_or_default();
    let mut leaders: Vec<Leader> = conditions
        .iter()
        .filter_map(|method| {
            let own: Vec<&super::summaries::Value> =
                found.iter().filter(|value| value.condition == *method).collect();
            let scores: Vec<f64> = own.iter().map(|value| value.value).collect();
            let mut people: std::collections::BTreeMap<&str, Vec<f64>> = std::collections::BTreeMap::new();
            own.iter().for_each(|value| people.entry(&value.participant).or_default().push(value.value));
            let means: Vec<f64> =
                people.values().map(|own| own.iter().sum::<f64>() / own.len() as f64).collect();
            let mean = |places: &[usize]| {
                Some(places.iter().map(|place| means[*place]).sum::<f64>() / places.len() as f64)
            };
            let share = |score: f64| {
                scores.iter().filter(|own| tied(**own, score)).count() as f64 / scores.len() as f64
            };
            Some(Leader {
                place: 0,
                method: method.clone(),
                scores: SampleSummary::of(&scores)?,
                interval: bootstrap(means.len(), seed, mean),
                at_most: if most > 0.0 { share(most) } else { 0.0 },
                at_zero: share(0.0),
                over_next: None,
            })
        })
        .collect();
    leaders.sort_by(|a, b| b.scores.mean.total_cmp(&a.scores.mean).then(a.method.cmp(&b.method)));
    for k in 0..leaders.len() {
        let shares = k > 0 && tied(leaders[k - 1].scores.mean, leaders[k].scores.mean);
        leaders[k].place = if shares { leaders[k - 1].place } else { k + 1 };
        let Some(next) = leaders.get(k + 1).map(|next| next.method.clone()) else { continue };
        let own = leaders[k].method.clone();
        // A pair's difference is its second less its first.
        leaders[k].over_next = pairs.iter().find_map(|pair| {
            let effect = pair.effect.as_ref()?;
            let (sign, is_it) = if (&pair.b, &pair.a) == (&own, &next) {
                (1.0, true)
            } else {
                (-1.0, (&pair.a, &pair.b) == (&own, &next))
            };
            let turned = |interval: Interval| {
                if sign > 0.0 { interval } else { Interval { low: -interval.high, high: -interval.low } }
            };
            is_it.then(|| Lead {
                mean: sign * effect.mean,
                interval: effect.mean_interval.map(turned),
                p_holm: pair.p_holm,
            })
        });
    }
    leaders
}

/// The same as a table.
pub(super) fn leader_table(leaders: &[Leader]) -> ReportTable {
    let percent = |share: f64| format!("{} %", printed(share * 100.0, 0));
    let row = |leader: &Leader| {
        let interval = leader
            .interval
            .map_or_else(String::new, |i| format!(" [{}, {}]", printed(i.low, 2), printed(i.high, 2)));
        vec![
            leader.place.to_string(),
            leader.method.clone(),
            leader.scores.trials.to_string(),
            printed(leader.scores.mean, 2) + &interval,
            leader.scores.sd.map_or_else(|| "–".to_owned(), |sd| printed(sd, 2)),
            percent(leader.at_most),
            percent(leader.at_zero),
            leader.over_next.as_ref().map_or_else(|| "–".to_owned(), ToString::to_string),
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
        head: ["Place", "method", "trials", "mean", "sd", "all", "none", "over the next"].map(str::to_owned).to_vec(),
        rows: leaders.iter().map(row).collect(),
    }
}
