use crate::{ProtocolStep, StudyPlan, StudyPlanError};
use serde::Serialize;

/// A trial that a plan asks for. All numbers count from 1.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PlannedTrial {
    /// Whose.
    pub participant: usize,
    /// In which session.
    pub session: String,
    /// Of which condition.
    pub condition: String,
    /// Place of the condition in the participant's order.
    pub position: usize,
    /// Among the trials of the condition.
    pub trial: usize,
    /// Where the blocks stand, by the task's name for it.
    pub arrangement: Option<String>,
    /// Of every random stream of the trial.
    pub seed: u64,
}

/// Something beside the trials, as a plan has it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PlannedStep {
    /// What.
    #[serde(flatten)]
    pub step: ProtocolStep,
    /// The condition that it belongs to; none at the beginning and the end of a session.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub condition: Option<String>,
}

/// What happens in a session, one after the other.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum SessionItem {
    /// Something beside the trials.
    Step(PlannedStep),
    /// A trial.
    Trial(PlannedTrial),
}

impl SessionItem {
    /// The questionnaire that is answered; none if it is something else.
    pub fn form(&self) -> Option<&str> {
        match self {
            SessionItem::Step(PlannedStep { step: ProtocolStep::Form { form, .. }, .. }) => Some(form),
            _ => None,
        }
    }

    /// The condition that it belongs to.
    pub fn condition(&self) -> Option<&str> {
        match self {
            SessionItem::Step(planned) => planned.condition.as_deref(),
            SessionItem::Trial(trial) => Some(&trial.condition),
        }
    }

    /// In a few words.
    pub fn label(&self) -> String {
        match self {
            SessionItem::Trial(trial) => format!("trial {} of {}", trial.trial, trial.condition),
            SessionItem::Step(planned) => match &planned.step {
                ProtocolStep::Say { text, .. } => format!("spoken text {text:?}"),
                ProtocolStep::Form { form, .. } => format!("questionnaire {form}"),
                ProtocolStep::Train { .. } => "training of the gestures".to_owned(),
                ProtocolStep::CalibrateGaze { .. } => "calibration of the gaze".to_owned(),
                ProtocolStep::Demonstrate { .. } => "demonstration".to_owned(),
                ProtocolStep::Practice { .. } => "practice".to_owned(),
                ProtocolStep::Break { .. } => "break".to_owned(),
            },
        }
    }
}

/// One participant's visit.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ScheduledSession {
    /// Whose, from 1.
    pub participant: usize,
    /// Its name in the plan.
    pub session: String,
    /// Its parts.
    #[serde(rename = "happenings")]
    pub items: Vec<SessionItem>,
}

/// Who does what: each participant's sessions, in their order.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Schedule {
    /// Participant by participant.
    pub sessions: Vec<ScheduledSession>,
}

/// Draws's finaliser: seeds that have nothing to do with each other from numbers that have.
fn mix_seed(seed: u64, number: u64) -> u64 {
    let mut z = seed.wrapping_add(number.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15));
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    // Files of configuration hold no number beyond this.
    (z ^ (z >> 31)) >> 1
}

impl Schedule {
    pub(crate) fn of(plan: &StudyPlan, pool: &[String]) -> Result<Self, StudyPlanError> {
        if let Some(arrangements) = &plan.arrangements {
            arrangements.check_names(pool)?;
        }
        let rows = plan.order.rows(plan)?;
        let mut sessions = Vec::new();
        for (participant, row) in rows.iter().enumerate() {
            for session in &plan.sessions {
                let mut items: Vec<SessionItem> = steps(&session.begin, None).collect();
                for position in plan.positions(session) {
                    let condition = row[position - 1];
                    let own = &plan.conditions[condition];
                    let of = Some(&own.name);
                    items.extend(steps(&session.before_condition, of).chain(steps(&own.begin, of)));
                    for trial in 0..session.trials {
                        let arrangement = plan.arrangements.as_ref().map(|arrangements| {
                            arrangements.of(plan, pool, participant, position - 1, condition, trial)
                        });
                        let numbers = [participant, condition, trial];
                        items.push(SessionItem::Trial(PlannedTrial {
                            participant: participant + 1,
                            session: session.name.clone(),
                            condition: own.name.clone(),
                            position,
                            trial: trial + 1,
                            arrangement,
                            seed: numbers
                                .iter()
                                .fold(plan.seed, |seed, &number| mix_seed(seed, number as u64)),
                        }));
                        let now = session
                            .inter_trial_steps
                            .iter()
                            .filter(|within| within.after_trials.contains(&(trial + 1)));
                        items.extend(now.flat_map(|within| steps(&within.steps, of)));
                        let rests = session.breaks.iter().filter(|rest| rest.after_trial == trial + 1);
                        let rests: Vec<ProtocolStep> =
                            rests.map(|rest| ProtocolStep::Break { minutes: rest.minutes }).collect();
                        items.extend(steps(&rests, of));
                    }
                    items.extend(steps(&own.end, of).chain(steps(&session.after_condition, of)));
                }
                items.extend(steps(&session.end, None));
                let session = session.name.clone();
                sessions.push(ScheduledSession { participant: participant + 1, session, items });
            }
        }
        Ok(Self { sessions })
    }

    /// All trials, in the order in which each participant does them.
    pub fn trials(&self) -> impl Iterator<Item = &PlannedTrial> {
        self.sessions.iter().flat_map(|session| &session.items).filter_map(|item| match item {
            SessionItem::Trial(trial) => Some(trial),
            SessionItem::Step(_) => None,
        })
    }
}

fn steps(steps: &[ProtocolStep], condition: Option<&String>) -> impl Iterator<Item = SessionItem> {
    let planned =
        move |step: &ProtocolStep| PlannedStep { step: step.clone(), condition: condition.cloned() };
    steps.iter().map(move |step| SessionItem::Step(planned(step)))
}
