//! A study without people: simulated participants drive its trials, and its questions are answered at random.

use super::{
    ParticipantHistory, ParticipantKind, Study,
    conductor::{Conductor, StudyError, record_name, study_place},
    simulated_participant::{participant_histories, participant_overrides},
    worker::{FinishedTrial, TrialJob, TrialWorker, WorkerError},
};
use crate::threads::run_in_threads;
use proact_study::{PlannedTrial, SessionItem, StepId, StepOutcome, StudyEvent};
use proact_testbed::{TrialEnd, TrialResult};
use std::{
    error::Error,
    process::Command,
    sync::{
        Mutex, MutexGuard, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
};

/// So often in a row a trial is begun again whose program ended before it did.
const MAX_WORKER_RESTARTS: usize = 3;

impl Study {
    /// A planned trial as an order, which is not recorded.
    pub fn trial_job(&self, planned: &PlannedTrial) -> TrialJob {
        let condition = self.plan.conditions.iter().position(|other| other.name == planned.condition);
        TrialJob {
            options: self
                .plan
                .trial_options(condition.expect("a schedule names conditions of its plan alone")),
            seed: planned.seed,
            arrangement: planned.arrangement.clone(),
            dir: None,
            bag: format!("{}.bag", record_name(planned)),
            study_place: None,
            with_scores: false,
        }
    }

    /// The same for the attempt with this number, recorded in the folder `record` of the study's.
    pub fn recorded_trial_job(&self, planned: &PlannedTrial, attempt: usize, record: &str) -> TrialJob {
        TrialJob {
            dir: Some(self.folder.join(record)),
            study_place: Some(study_place(planned, attempt)),
            ..self.trial_job(planned)
        }
    }
}

/// What a rehearsal tells while it goes on.
#[derive(Clone, Debug)]
pub enum RehearsalEvent<'a> {
    /// This event is on the disk: what it says is not lost any more.
    Acknowledged(i64),
    /// A trial is over.
    Trial(&'a PlannedTrial, &'a TrialResult),
}

/// How a rehearsal is run.
pub struct RehearsalOptions<'a> {
    /// The kind of simulated participants.
    pub participant_kind: ParticipantKind,
    /// So many participants at once, each with a program for their trials.
    pub jobs: usize,
    /// Starts such a program, which calls [`run_worker`](super::work).
    pub worker_command: &'a (dyn Fn() -> Command + Sync),
    /// Raised by Ctrl-C or a request to end.
    pub interrupted: &'a AtomicBool,
}

/// Runs all that is left of a study with simulated participants. True if the study is finished, false if it was interrupted.
///
/// # Errors
/// The first thing that went wrong; the study can be taken up again.
pub fn rehearse(
    conductor: Conductor,
    options: &RehearsalOptions<'_>,
    tell: impl Fn(RehearsalEvent<'_>) + Sync,
) -> Result<bool, Box<dyn Error>> {
    let people: Vec<usize> = (1..=conductor.study.plan.participants).collect();
    let study = conductor.study.clone();
    let rehearsal = Rehearsal {
        study: &study,
        conductor: Mutex::new(conductor),
        pending_participants: Mutex::new(people.into_iter()),
        failed: AtomicBool::new(false),
        options,
        on_event: &tell,
    };
    run_in_threads(options.jobs, &rehearsal.failed, || rehearsal.work())?;
    let conductor = rehearsal.conductor.into_inner().unwrap_or_else(PoisonError::into_inner);
    Ok(conductor.progress().finished())
}

struct Rehearsal<'a, T> {
    study: &'a Study,
    conductor: Mutex<Conductor>,
    pending_participants: Mutex<std::vec::IntoIter<usize>>,
    failed: AtomicBool,
    options: &'a RehearsalOptions<'a>,
    on_event: &'a T,
}

impl<T: Fn(RehearsalEvent<'_>) + Sync> Rehearsal<'_, T> {
    fn conductor(&self) -> MutexGuard<'_, Conductor> {
        self.conductor.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn stopped(&self) -> bool {
        self.options.interrupted.load(Ordering::Relaxed) || self.failed.load(Ordering::Relaxed)
    }

    /// Does something with the conductor, and tells of every event that it wrote.
    fn write_and_acknowledge<R>(
        &self,
        act: impl FnOnce(&mut Conductor) -> Result<R, StudyError>,
    ) -> Result<R, StudyError> {
        let mut conductor = self.conductor();
        let before = conductor.last_id();
        let done = act(&mut conductor);
        for id in before + 1..=conductor.last_id() {
            (self.on_event)(RehearsalEvent::Acknowledged(id));
        }
        done
    }

    fn work(&self) -> Result<(), Box<dyn Error>> {
        let mut worker = None;
        loop {
            let next = self.pending_participants.lock().unwrap_or_else(PoisonError::into_inner).next();
            let Some(participant) = next else { return Ok(()) };
            self.run_participant(participant, &mut worker)?;
        }
    }

    /// What a participant has done before each trial.
    fn histories(&self, participant: usize) -> Vec<(PlannedTrial, ParticipantHistory)> {
        let plan = &self.study.plan;
        let choices: Vec<_> =
            (0..plan.conditions.len()).map(|condition| plan.trial_options(condition)).collect();
        let sessions = self.study.schedule.sessions.iter().filter(|own| own.participant == participant);
        let sessions: Vec<_> = sessions.cloned().collect();
        let before = participant_histories(plan, &sessions, &choices);
        before.into_iter().map(|(_, planned, history)| (planned.clone(), history)).collect()
    }

    /// All sessions that a participant has left.
    fn run_participant(
        &self,
        participant: usize,
        worker: &mut Option<TrialWorker>,
    ) -> Result<(), Box<dyn Error>> {
        let mut lost = 0;
        let before = self.histories(participant);
        while !self.stopped() {
            let session = self.write_and_acknowledge(|conductor| {
                if conductor.progress().next_session(participant).is_none() {
                    return Ok(None);
                }
                if !conductor.progress().pseudonyms().contains_key(&participant) {
                    let id = format!("P{participant:02}");
                    conductor.write(StudyEvent::Enrolled { participant, id })?;
                }
                conductor.begin_session(participant, true).map(Some)
            })?;
            let Some(session) = session else { return Ok(()) };
            while !self.stopped() {
                let next = {
                    let conductor = self.conductor();
                    let progress = conductor.progress();
                    let own = progress.session(participant, &session);
                    own.and_then(|own| progress.next_step(own))
                        .and_then(|step_id| Some((progress.item(&step_id)?.clone(), step_id)))
                };
                let Some((session_item, step_id)) = next else { break };
                match self.step(&session_item, &step_id, &before, worker)? {
                    None => lost = 0,
                    Some(_) if lost < MAX_WORKER_RESTARTS => lost += 1,
                    Some(error) => return Err(error.into()),
                }
            }
        }
        Ok(())
    }

    /// Does a step; an error if its program was gone, so that it is done again.
    fn step(
        &self,
        session_item: &SessionItem,
        step_id: &StepId,
        before: &[(PlannedTrial, ParticipantHistory)],
        worker: &mut Option<TrialWorker>,
    ) -> Result<Option<WorkerError>, Box<dyn Error>> {
        let record = self.write_and_acknowledge(|conductor| conductor.begin(step_id))?;
        let (mut outcome, mut gone) = (StepOutcome::Done, None);
        if let (SessionItem::Trial(planned), Some(record)) = (session_item, &record) {
            let attempt = self.conductor().progress().step(step_id).attempts;
            let mut order = self.study.recorded_trial_job(planned, attempt, record);
            let history = before.iter().find(|(other, _)| other == planned).map(|(_, history)| *history);
            let seed = self.study.plan.seed;
            let person = participant_overrides(
                self.options.participant_kind,
                seed,
                planned.participant,
                &history.unwrap_or_default(),
            );
            // What the plan sets has the last word about a person.
            order.options.set.splice(0..0, person);
            if worker.is_none() {
                *worker = Some(TrialWorker::start(&mut (self.options.worker_command)())?);
            }
            let done = worker.as_mut().map(|worker| worker.run(&order, || self.stopped()));
            match done.unwrap_or_else(|| {
                Err(WorkerError::WorkerExited { exit_status: "it never began".to_owned() })
            }) {
                Ok(FinishedTrial { result, .. }) => {
                    (self.on_event)(RehearsalEvent::Trial(planned, &result));
                    if result.ended == TrialEnd::Interrupt {
                        outcome = StepOutcome::Interrupted;
                    }
                }
                Err(error @ WorkerError::WorkerExited { .. }) => {
                    (*worker, outcome, gone) = (None, StepOutcome::Interrupted, Some(error));
                }
                Err(error) => {
                    self.write_and_acknowledge(|conductor| conductor.end(step_id, StepOutcome::Interrupted))?;
                    return Err(error.into());
                }
            }
        } else if let Some(form) = session_item.form() {
            let conditions = self.study.conditions();
            let seed = self.study.plan.seed ^ ((step_id.participant as u64) << 32) ^ step_id.step as u64;
            for (item, answer) in self.study.forms[form].random_answers(&conditions, seed) {
                self.write_and_acknowledge(|conductor| conductor.answer(step_id, &item, Some(answer)))?;
            }
        }
        self.write_and_acknowledge(|conductor| conductor.end(step_id, outcome))?;
        Ok(gone)
    }
}
