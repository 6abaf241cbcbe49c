//! How a trial went, as the page shows it when the trial is over.

use proact_bridge::{AfterTrial, PageServer, ResultCard, ResultLine, TrialStatus};
use proact_tasks::Norm;
use proact_testbed::{TrialEnd, TrialResult};
use proact_types::{DisplayFrame, EventKind, Point};

/// Results that a page keeps, the latest: more than a visit has.
const MOST_CARDS: usize = 200;

/// What a result card counts in the instants that are displayed.
#[derive(Clone, Copy, Debug, Default)]
pub struct CardTally {
    last: Option<Point>,
    path_m: f64,
    attempts: u32,
}

impl CardTally {
    /// Takes in one instant.
    pub fn add(&mut self, frame: &DisplayFrame) {
        let now = Point::from(frame.world_from_tip.translation.vector);
        self.path_m += self.last.replace(now).map_or(0.0, |last| (now - last).norm());
        // As the measure `attempts` of the analysis: the hand closed and took something, or failed to.
        let tried = |kind: &EventKind| {
            matches!(kind, EventKind::ObjectAttached { .. } | EventKind::GraspFailed { .. })
        };
        self.attempts += frame.events.iter().filter(|event| tried(&event.kind)).count() as u32;
    }
}

/// The results of the trials that a page has seen, the newest first.
#[derive(Clone, Debug, Default)]
pub struct ResultCards {
    cards: Vec<ResultCard>,
}

impl ResultCards {
    /// Adds the `result` of a trial with a score of at most `most` that `who` drove by `tally`, and shows it with what may be
    /// asked for next.
    /// A trial that was given up for another one is no result.
    pub fn show(
        &mut self,
        page: &PageServer,
        most: Option<u32>,
        result: &TrialResult,
        who: &str,
        tally: CardTally,
        offers: &[AfterTrial],
    ) {
        if matches!(result.ended, TrialEnd::Restart | TrialEnd::Interrupt) {
            return;
        }
        self.cards.insert(0, card(result, who, most, tally));
        self.cards.truncate(MOST_CARDS);
        page.set_status(&TrialStatus {
            aborted: result.ended == TrialEnd::Abort,
            seed: result.seed,
            record: result.trial_dir.clone(),
            offers: offers.to_vec(),
            results: self.cards.clone(),
            ..TrialStatus::default()
        });
    }
}

fn card(result: &TrialResult, who: &str, most: Option<u32>, tally: CardTally) -> ResultCard {
    let outcomes = result.beside.get("outcomes").cloned().unwrap_or_default();
    let norms = result.result.get("norms").cloned().unwrap_or_default();
    let norms = serde_json::from_value::<Vec<Norm>>(norms).unwrap_or_default();
    ResultCard {
        who: who.to_owned(),
        method: result.method.clone(),
        score: result.score,
        most,
        score_name: result.score_name.clone(),
        seconds: result.sim_seconds,
        path_m: tally.path_m,
        attempts: tally.attempts,
        // A task that tells of other things has no such list.
        objects: serde_json::from_value::<Vec<ResultLine>>(outcomes).unwrap_or_default(),
        norms: norms.iter().map(ToString::to_string).collect(),
        faults: result.trial_faults.iter().map(|fault| fault.reason.clone()).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trial::{self, Assembly};
    use proact_devices::EmgOrigin;
    use proact_tasks::{Sex, TaskChoice, Wearer};
    use proact_testbed::{Setup, TrialConfig};

    #[test]
    fn a_card_of_the_standard_test_has_norms_beside_the_score() {
        let config = TrialConfig::new("D", 1, Setup::named("still").unwrap());
        let mut config = config.with_task(TaskChoice::named("bbt", 1).unwrap()).unwrap();
        config.wearer = Some(Wearer { age_years: Some(44), sex: Some(Sex::Male) });
        let Assembly { session, .. } = trial::simulated(config, &EmgOrigin::Synthetic).unwrap();
        let card = card(&session.result(), "Simulated participant", None, CardTally::default());
        assert_eq!(
            card.norms,
            [
                "norm 79.0 (SD 16.6), men: Benin, 692 people, dominant hand",
                "norm 83.0 (SD 8.1), men, 40 to 44 years, right hand: Mathiowetz et al. 1985 (unconfirmed: recalled)",
            ]
        );
    }

    #[test]
    fn a_card_has_times_errors_and_path_of_the_trial() {
        let mut config = TrialConfig::new("D", 1, Setup::named("still").unwrap());
        config.limit_secs = 30.0;
        let Assembly { mut session, .. } = trial::simulated(config, &EmgOrigin::Synthetic).unwrap();
        let mut tally = CardTally::default();
        loop {
            let step = session.step(false).unwrap();
            step.frame.iter().for_each(|frame| tally.add(frame));
            if step.output.finished {
                break;
            }
        }
        let result = TrialResult { ended: TrialEnd::Task, ..session.result() };
        let card = card(&result, "Simulated participant", Some(4), tally);
        assert_eq!((card.score, card.most, card.seconds), (result.score, Some(4), result.sim_seconds));
        assert!((0.5..60.0).contains(&card.path_m), "{} m", card.path_m);
        assert_eq!(card.objects.len(), 4);
        let taken = card.objects.iter().filter(|object| object.pick_s.is_some()).count();
        assert!(card.attempts as usize >= taken && taken > 0, "{card:?}");
        assert!(card.norms.is_empty(), "nobody measured this task on people with sound hands");
        let first = &card.objects[0];
        assert!(first.name.starts_with("red"), "{first:?}");
        assert!(
            card.objects.iter().any(|object| object.pick_s.is_some() && object.error_m.is_some()),
            "{card:?}"
        );
    }
}
