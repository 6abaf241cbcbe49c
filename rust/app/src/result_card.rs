//! How a trial went, as the page shows it when the trial is over.

use proact_bridge::{ObjectResultRow, PageServer, PostTrialAction, ResultCard, TrialStatus};
use proact_tasks::{ObjectResult, norms_in_result, object_results};
use proact_testbed::{TrialEnd, TrialResult};
use proact_types::{DisplayFrame, EventKind, Point};

/// Results that a page keeps, the latest: more than a visit has.
const MAX_CARDS: usize = 200;

/// What a result card counts in the instants that are displayed.
#[derive(Clone, Copy, Debug, Default)]
pub struct ResultCardCounter {
    last: Option<Point>,
    path_m: f64,
    attempts: u32,
}

impl ResultCardCounter {
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
    /// Adds the `result` of a trial with a score of at most `max_score` that `who` drove by `counter`, and shows it with what may be
    /// asked for next.
    /// A trial that was given up for another one is no result.
    pub fn show(
        &mut self,
        page: &PageServer,
        max_score: Option<u32>,
        result: &TrialResult,
        who: &str,
        counter: ResultCardCounter,
        offers: &[PostTrialAction],
    ) {
        if matches!(result.ended, TrialEnd::Restart | TrialEnd::Interrupt) {
            return;
        }
        self.cards.insert(0, card(result, who, max_score, counter));
        self.cards.truncate(MAX_CARDS);
        page.set_status(&TrialStatus {
            aborted: result.ended == TrialEnd::Abort,
            seed: result.seed,
            record: result.trial_dir.clone(),
            post_trial_actions: offers.to_vec(),
            results: self.cards.clone(),
            ..TrialStatus::default()
        });
    }
}

fn card(result: &TrialResult, who: &str, max_score: Option<u32>, counter: ResultCardCounter) -> ResultCard {
    let own = "the task of this very trial wrote it";
    let object = |line: ObjectResult| ObjectResultRow {
        name: line.block,
        outcome: line.outcome.as_str().to_owned(),
        pick_s: line.pick_s,
        place_s: line.place_s,
        error_m: Some(line.distance_m),
    };
    ResultCard {
        driver: who.to_owned(),
        method: result.method.clone(),
        score: result.score,
        max_score,
        score_name: result.score_name.clone(),
        seconds: result.sim_seconds,
        path_m: counter.path_m,
        attempts: counter.attempts,
        // A task that tells of other things has no such list.
        objects: object_results(&result.legacy_fields).expect(own).into_iter().map(object).collect(),
        norms: norms_in_result(&result.result).expect(own).iter().map(ToString::to_string).collect(),
        faults: result.trial_faults.iter().map(|fault| fault.reason.clone()).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trial::{self, Assembly};
    use proact_devices::EmgOrigin;
    use proact_tasks::{Sex, TaskSpec, UserProfile};
    use proact_testbed::{Setup, TrialConfig};

    #[test]
    fn a_card_of_the_standard_test_has_norms_beside_the_score() {
        let config = TrialConfig::new("D", 1, Setup::named("still").unwrap());
        let mut config = config.with_task(TaskSpec::named("bbt", 1).unwrap()).unwrap();
        config.user_profile = Some(UserProfile { age_years: Some(44), sex: Some(Sex::Male) });
        let Assembly { trial, .. } = trial::simulated_trial(config, &EmgOrigin::Synthetic).unwrap();
        let card = card(&trial.result(), "Simulated participant", None, ResultCardCounter::default());
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
        let Assembly { mut trial, .. } = trial::simulated_trial(config, &EmgOrigin::Synthetic).unwrap();
        let mut counter = ResultCardCounter::default();
        loop {
            let step = trial.step(false).unwrap();
            step.frame.iter().for_each(|frame| counter.add(frame));
            if step.output.finished {
                break;
            }
        }
        let result = TrialResult { ended: TrialEnd::Task, ..trial.result() };
        let card = card(&result, "Simulated participant", Some(4), counter);
        assert_eq!((card.score, card.max_score, card.seconds), (result.score, Some(4), result.sim_seconds));
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
