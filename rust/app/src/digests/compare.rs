use super::{TrialDigest, TrialOutcome};
use proact_testbed::{DigestField, Divergence, SpanDigest, first_divergence};
use std::{collections::BTreeMap, fmt};

/// On another platform the last bits differ, plans and contacts take other turns, and a trial may end this much earlier
/// or later, as a share of its length. With the functions that glibc has for processors without FMA it was 2.2 %.
const MAX_LENGTH_CHANGE: f64 = 0.1;
/// And a block may come to stand this much elsewhere, mm; with those functions it was 8 mm.
const MAX_POSITION_CHANGE_MM: f64 = 30.0;

/// A trial whose digest is not the committed one.
#[derive(Clone, Debug, PartialEq)]
pub struct DigestDifference {
    /// Its name.
    pub trial: String,
    /// The first span that differs, and the fields; none if the trial is committed or run, but not both.
    pub divergence: Option<Divergence>,
    /// The configuration differs as well, or alone.
    pub config_differs: bool,
    /// How it ended when the digests were updated, and how it ends now.
    pub outcomes: [Option<TrialOutcome>; 2],
}

impl fmt::Display for DigestDifference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: ", self.trial)?;
        match &self.divergence {
            Some(Divergence { from, to, fields }) => {
                write!(f, "first differs in ticks {} to {}, in {}", from.0, to.0, fields.join(", "))?;
            }
            None if self.outcomes[0].is_none() => write!(f, "is not among the committed trials")?,
            None if self.outcomes[1].is_none() => write!(f, "is committed, but not in the list of trials")?,
            None => {}
        }
        match (self.config_differs, &self.divergence) {
            (true, Some(_)) => write!(f, "; its configuration is another one too")?,
            (true, None) => write!(f, "its configuration is another one, and no field differs")?,
            (false, _) => {}
        }
        for (when, outcome) in ["was", "is "].iter().zip(&self.outcomes) {
            if let Some(outcome) = outcome {
                write!(f, "\n    {when} {outcome}")?;
            }
        }
        Ok(())
    }
}

impl fmt::Display for TrialOutcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} ms, {} on target", self.ticks, self.on_target)?;
        for block in &self.blocks {
            let [x, y, z] = block.position_mm;
            write!(f, ", {} {} ({x}, {y}, {z})", block.name, block.outcome)?;
        }
        Ok(())
    }
}

/// The trials of `run` whose digests are not those of `committed`, which has no outcomes of its own: those of
/// `outcomes` are shown.
pub fn digest_differences(
    committed: &BTreeMap<String, TrialDigest>,
    outcomes: &[TrialOutcome],
    run: &[TrialDigest],
) -> Vec<DigestDifference> {
    let was = |trial: &str| outcomes.iter().find(|outcome| outcome.trial == trial).cloned();
    let unchained = |spans: &[SpanDigest]| -> Vec<SpanDigest> {
        spans.iter().map(|span| SpanDigest { chain_hash: String::new(), ..span.clone() }).collect()
    };
    let mut found: Vec<DigestDifference> = run
        .iter()
        .filter_map(|now| {
            let trial = now.outcome.trial.clone();
            let Some(before) = committed.get(&trial) else {
                let outcomes = [None, Some(now.outcome.clone())];
                return Some(DigestDifference { trial, divergence: None, config_differs: false, outcomes });
            };
            let divergence = first_divergence(&before.spans, &unchained(&now.spans));
            let configuration = before.configuration != now.configuration;
            let outcomes = [was(&trial), Some(now.outcome.clone())];
            let differs = divergence.is_some() || configuration;
            differs.then_some(DigestDifference { trial, divergence, config_differs: configuration, outcomes })
        })
        .collect();
    let gone = committed.keys().filter(|name| run.iter().all(|now| now.outcome.trial != **name));
    found.extend(gone.map(|name| {
        let outcomes = [Some(was(name).unwrap_or(committed[name].outcome.clone())), None];
        DigestDifference { trial: name.clone(), divergence: None, config_differs: false, outcomes }
    }));
    found
}

/// What in the outcomes of `run` goes beyond what another platform may change; empty if nothing does.
pub fn outcome_violations(outcomes: &[TrialOutcome], run: &[TrialDigest]) -> Vec<String> {
    let mut found = Vec::new();
    for now in run.iter().map(|trial| &trial.outcome) {
        let Some(was) = outcomes.iter().find(|outcome| outcome.trial == now.trial) else {
            found.push(format!("{}: no outcome is committed", now.trial));
            continue;
        };
        let tick_difference = now.ticks.abs_diff(was.ticks) as f64 / was.ticks.max(1) as f64;
        let blocks = was.blocks.len() == now.blocks.len()
            && was.blocks.iter().zip(&now.blocks).all(|(a, b)| {
                let offset = a.position_mm.iter().zip(b.position_mm).map(|(a, b)| (a - b) as f64);
                a.name == b.name
                    && a.outcome == b.outcome
                    && offset.map(|d| d * d).sum::<f64>().sqrt() <= MAX_POSITION_CHANGE_MM
            });
        if tick_difference > MAX_LENGTH_CHANGE || !blocks {
            found.push(format!("{}:\n    was {was}\n    is  {now}", now.trial));
        }
    }
    found
}

/// How many field hashes differ, by stage.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct StageDifferenceCounts {
    /// For each stage, in the order of the tick: hashes that differ, and all.
    pub stages: Vec<(&'static str, usize, usize)>,
}

impl StageDifferenceCounts {
    /// Of `run` against `committed`. A span that only one of them has differs in every field.
    pub fn count(committed: &BTreeMap<String, TrialDigest>, run: &[TrialDigest]) -> Self {
        let mut stages: Vec<(&'static str, usize, usize)> = Vec::new();
        for (k, field) in DigestField::ALL.iter().enumerate() {
            let stage = field.name().split('.').next().unwrap_or_default();
            if stages.last().is_none_or(|(last, ..)| *last != stage) {
                stages.push((stage, 0, 0));
            }
            let Some((_, changed, all)) = stages.last_mut() else { continue };
            for now in run {
                let before = committed.get(&now.outcome.trial).map_or(&[][..], |trial| &trial.spans[..]);
                let spans = before.len().max(now.spans.len());
                let hash = |spans: &[SpanDigest], span: usize| spans.get(span).map(|s| s.fields[k].clone());
                *all += spans;
                *changed += (0..spans).filter(|&s| hash(before, s) != hash(&now.spans, s)).count();
            }
        }
        Self { stages }
    }
}

impl fmt::Display for StageDifferenceCounts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let changed: Vec<String> = self
            .stages
            .iter()
            .filter(|(_, changed, _)| *changed > 0)
            .map(|(stage, changed, all)| format!("{stage} {changed} of {all}"))
            .collect();
        if changed.is_empty() { f.write_str("no field hash") } else { f.write_str(&changed.join(", ")) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::digests::BlockOutcome;
    use proact_testbed::Digest;
    use proact_types::SimTime;

    fn trial(name: &str, change: Option<u64>) -> TrialDigest {
        let mut digest = Digest::new("");
        let spans = (1..=400).filter_map(|tick| {
            digest.field(DigestField::Joints).number(if change == Some(tick) {
                1.0_f64.next_up()
            } else {
                1.0
            });
            digest.end_tick(SimTime(tick), false)
        });
        let spans = spans.collect();
        let red =
            BlockOutcome { name: "red1".into(), outcome: "on_target".into(), position_mm: [58, 208, 1040] };
        let outcome = TrialOutcome { trial: name.into(), ticks: 400, on_target: 1, blocks: vec![red] };
        TrialDigest { outcome, configuration: "c".into(), spans }
    }

    fn committed(trials: &[TrialDigest]) -> BTreeMap<String, TrialDigest> {
        let unchained = |trial: &TrialDigest| {
            let mut trial = trial.clone();
            trial.spans.iter_mut().for_each(|span| span.chain_hash.clear());
            (trial.outcome.trial.clone(), trial)
        };
        trials.iter().map(unchained).collect()
    }

    #[test]
    fn a_changed_digest_is_named_with_trial_span_and_field_and_both_outcomes() {
        let was = [trial("A", None), trial("D", None)];
        let outcomes: Vec<TrialOutcome> = was.iter().map(|trial| trial.outcome.clone()).collect();
        assert_eq!(digest_differences(&committed(&was), &outcomes, &was), []);
        assert_eq!(StageDifferenceCounts::count(&committed(&was), &was).to_string(), "no field hash");

        let now = [trial("A", None), trial("D", Some(250))];
        let [found] = &digest_differences(&committed(&was), &outcomes, &now)[..] else {
            panic!("one differs")
        };
        let text = found.to_string();
        assert!(text.starts_with("D: first differs in ticks 201 to 300, in dynamics.joints\n"), "{text}");
        assert!(text.contains("was 400 ms, 1 on target, red1 on_target (58, 208, 1040)"), "{text}");
        assert_eq!(text.matches("400 ms").count(), 2, "{text}");
        assert_eq!(StageDifferenceCounts::count(&committed(&was), &now).to_string(), "dynamics 1 of 16");
    }

    #[test]
    fn another_configuration_a_new_trial_and_a_lost_one_are_told_apart() {
        let (was, mut now) = ([trial("A", None), trial("B", None)], [trial("A", None), trial("D", None)]);
        now[0].configuration = "other".into();
        let texts: Vec<String> =
            digest_differences(&committed(&was), &[], &now).iter().map(DigestDifference::to_string).collect();
        let [a, d, b] = &texts[..] else { panic!("{texts:?}") };
        assert!(a.contains("configuration is another one, and no field differs"), "{a}");
        assert!(d.contains("not among the committed"), "{d}");
        assert!(b.contains("not in the list"), "{b}");
    }

    #[test]
    fn outcomes_may_differ_by_a_little_and_not_by_more() {
        let was = trial("D", None);
        let violations = |change: &dyn Fn(&mut TrialOutcome)| {
            let mut now = was.clone();
            change(&mut now.outcome);
            outcome_violations(std::slice::from_ref(&was.outcome), &[now])
        };
        assert_eq!(violations(&|_| {}), [""; 0]);
        assert_eq!(violations(&|now| (now.ticks, now.blocks[0].position_mm[0]) = (430, 70)), [""; 0]);
        assert_eq!(violations(&|now| now.ticks = 900).len(), 1);
        assert_eq!(violations(&|now| now.blocks[0].position_mm[1] = -208).len(), 1);
        assert_eq!(violations(&|now| now.blocks[0].outcome = "dropped_floor".into()).len(), 1);
        assert_eq!(violations(&|now| now.trial = "E".into()).len(), 1);
    }
}
