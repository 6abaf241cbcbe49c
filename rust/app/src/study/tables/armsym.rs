//! A trial's events under the names of ArmSym, in the layout of its file `trialdata.json` (MPI-IS/ArmSym, tutorial 4): three arrays of
//! the same length, the time of a message, the message, and a number that belongs to it or 0. Its joints are in `joint_data.rs`.

use super::{StudyTables, joint_data::joint_data};
use crate::{record_keys::with_path, replay::read_trial};
use proact_control::MethodRegistry;
use proact_study::{FormAnswer, FormItem, SessionItem, StepId, StepOutcome};
use proact_types::{Event, EventKind, ObjectId, SimTime};
use serde::Serialize;
use std::{collections::BTreeSet, error::Error};

/// The events of a trial as ArmSym writes them.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub(crate) struct ArmSymTrialData {
    /// Since the trial's start, s. (ArmSym: since its program's.)
    #[serde(rename = "Times")]
    times: Vec<f64>,
    #[serde(rename = "Message")]
    messages: Vec<String>,
    #[serde(rename = "Val_message")]
    values: Vec<f64>,
}

impl ArmSymTrialData {
    fn push(&mut self, time: SimTime, message: impl Into<String>, value: f64) {
        self.times.push(time.0 as f64 / 1e3);
        self.messages.push(message.into());
        self.values.push(value);
    }

    /// What `events` of a trial that scored `score`, if its score counts, and ended at `end` are called there. What ArmSym has no
    /// word for is left out.
    fn of_events(events: &[Event], score: Option<f64>, end: SimTime) -> ArmSymTrialData {
        let mut data = ArmSymTrialData::default();
        let has_practiced = events.iter().any(|event| event.kind == EventKind::PracticeFinished);
        let began = if has_practiced { "Practice trial started" } else { "TrialStarted" };
        data.push(SimTime(0), began, 0.0);
        let mut counted: BTreeSet<ObjectId> = BTreeSet::new();
        let mut count = 0.0;
        for Event { time, kind } in events {
            match kind {
                EventKind::PracticeFinished => {
                    data.push(*time, "Practice trial ended", 0.0);
                    data.push(*time, "TrialStarted", 0.0);
                }
                EventKind::ObjectAttached { .. } => data.push(*time, "GotACube", 0.0),
                EventKind::ObjectReleased { .. } => data.push(*time, "ReleasedACube", 0.0),
                EventKind::ObjectCrossed { object } | EventKind::ObjectOnTarget { object, .. } => {
                    counted.insert(*object);
                    count += 1.0;
                    data.push(*time, "BarrierCross", count);
                }
                EventKind::ObjectOffTarget { object } if counted.remove(object) => {
                    count -= 1.0;
                    data.push(*time, "Cube_Fell_Back", count);
                }
                EventKind::PlanRequested { .. } => data.push(*time, "New Command", 0.0),
                _ => {}
            }
        }
        data.push(end, "TrialFinished", 0.0);
        if let Some(score) = score {
            data.push(end, "Total_Score", score);
        }
        data
    }
}

/// A trial in ArmSym's folders.
pub(crate) struct ArmSymTrialFiles {
    /// Whose it is: there a subject has one condition.
    pub(crate) subject: String,
    /// Its number.
    pub(crate) trial: usize,
    /// What is in `trialdata.json`.
    pub(crate) events: ArmSymTrialData,
    /// What is in `Joint_Data.csv`.
    pub(crate) joints: String,
}

/// Hands the files of each trial that counts to `write`; trials are recomputed with `methods`.
///
/// # Errors
/// A record that cannot be read or recomputed, by its name; what `write` refuses.
pub(super) fn trial_files(
    tables: &StudyTables<'_>,
    methods: &MethodRegistry,
    mut write: impl FnMut(ArmSymTrialFiles) -> Result<(), Box<dyn Error>>,
) -> Result<(), Box<dyn Error>> {
    for counted in tables.counted_trials() {
        let dir = tables.study.folder.join(&counted.record);
        let read = || -> Result<(ArmSymTrialData, String), Box<dyn Error>> {
            let (record, result) = read_trial(&dir)?;
            let events = ArmSymTrialData::of_events(&record.events()?, result.counted_score(), record.end());
            Ok((events, joint_data(methods, &dir)?))
        };
        let (mut data, joints) = read().map_err(|error| with_path(&dir, &error))?;
        let end = SimTime::from_secs(data.times.last().copied().unwrap_or_default());
        for (question, answer) in tables.questions_after(&counted.step_id) {
            data.push(end, question, answer);
        }
        let planned = counted.planned;
        let who = tables.view.progress.pseudonyms().get(&planned.participant).cloned();
        let who = who.unwrap_or_else(|| planned.participant.to_string());
        let subject = format!("{who}_{}", planned.condition);
        write(ArmSymTrialFiles { subject, trial: planned.trial, events: data, joints })?;
    }
    Ok(())
}

impl StudyTables<'_> {
    /// Questions on a scale that were answered between the trial at `step_id` and the next, with ArmSym's message and the answer.
    fn questions_after(&self, step_id: &StepId) -> Vec<(String, f64)> {
        let progress = &self.view.progress;
        let sessions = &progress.schedule().sessions;
        let of = |own: &&proact_study::ScheduledSession| {
            own.participant == step_id.participant && own.session == step_id.session
        };
        let Some(session) = sessions.iter().find(of) else { return Vec::new() };
        let after = progress.step_ids(session).zip(&session.items).skip(step_id.step);
        let mut questions = Vec::new();
        for (step_id, session_item) in after.take_while(|(_, next)| !matches!(next, SessionItem::Trial(_))) {
            let state = progress.step(&step_id);
            let (Some(name), Some(StepOutcome::Done)) = (session_item.form(), state.outcome) else {
                continue;
            };
            for item in &self.study.forms[name].items {
                let FormItem::Scale { key, text, .. } = item else { continue };
                let Some(FormAnswer::Number(answer)) = state.answers.get(key) else { continue };
                let text = crate::study::export::preferred_text(text);
                questions.push((format!("Question: {} {text}", questions.len() + 1), *answer));
            }
        }
        questions
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn event(millis: u64, kind: EventKind) -> Event {
        Event { time: SimTime(millis), kind }
    }

    #[test]
    fn events_have_armsyms_names_times_and_counts() {
        let (a, b) = (ObjectId(0), ObjectId(1));
        let events = [
            event(100, EventKind::PlanRequested { request: 1 }),
            event(1500, EventKind::ObjectAttached { object: a }),
            event(2000, EventKind::ObjectCrossed { object: a }),
            event(2500, EventKind::ObjectReleased { object: a }),
            event(2600, EventKind::MotionFinished),
            event(3000, EventKind::ObjectOnTarget { object: b, distance: 0.01 }),
            event(4000, EventKind::ObjectOffTarget { object: b }),
            event(5000, EventKind::TrialFinished),
        ];
        let data = ArmSymTrialData::of_events(&events, Some(1.0), SimTime(5000));
        let readings: Vec<(f64, &str, f64)> = (0..data.times.len())
            .map(|k| (data.times[k], data.messages[k].as_str(), data.values[k]))
            .collect();
        let expected = [
            (0.0, "TrialStarted", 0.0),
            (0.1, "New Command", 0.0),
            (1.5, "GotACube", 0.0),
            (2.0, "BarrierCross", 1.0),
            (2.5, "ReleasedACube", 0.0),
            (3.0, "BarrierCross", 2.0),
            (4.0, "Cube_Fell_Back", 1.0),
            (5.0, "TrialFinished", 0.0),
            (5.0, "Total_Score", 1.0),
        ];
        assert_eq!(readings, expected);
        let json = serde_json::to_value(&data).unwrap();
        let keys: Vec<&String> = json.as_object().unwrap().keys().collect();
        assert_eq!(keys, ["Message", "Times", "Val_message"]);
    }

    #[test]
    fn practice_in_a_trial_comes_before_its_start_and_a_block_that_never_counted_does_not_fall_back() {
        let events = [
            event(0, EventKind::ObjectOffTarget { object: ObjectId(0) }),
            event(15_000, EventKind::PracticeFinished),
        ];
        let data = ArmSymTrialData::of_events(&events, None, SimTime(20_000));
        let expected = ["Practice trial started", "Practice trial ended", "TrialStarted", "TrialFinished"];
        assert_eq!(data.messages, expected, "no score of a trial that has none");
        assert_eq!(data.times, [0.0, 15.0, 15.0, 20.0]);
    }
}
