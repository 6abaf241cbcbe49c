//! A study without people: simulated participants drive its trials, and its questions are answered at random.

use super::{
    People, Study, TrialHistory,
    conductor::{Conductor, StudyError, record_name, study_place},
    people::{histories, person_values},
    worker::{TrialDone, TrialOrder, Worker, WorkerError},
};
use crate::threads::in_threads;
use proact_study::{Happening, PlannedTrial, Spot, StepOutcome, StudyEvent};
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
const MOST_LOST: usize = 3;

impl Study {
    /// A planned trial as an order, which is not recorded.
    pub fn order(&self, planned: &PlannedTrial) -> TrialOrder {
        let condition = self.plan.conditions.iter().position(|other| other.name == planned.condition);
        TrialOrder {
            choice: self.plan.choice(condition.expect("a schedule names conditions of its plan alone")),
            seed: planned.seed,
            arrangement: planned.arrangement.clone(),
            dir: None,
            bag: format!("{}.bag", record_name(planned)),
            place: None,
            scored: false,
        }
    }

    /// The same for the attempt with this number, recorded in the folder `record` of the study's.
    pub fn recorded_order(&self, planned: &PlannedTrial, attempt: usize, record: &str) -> TrialOrder {
        TrialOrder {
            dir: Some(self.folder.join(record)),
            place: Some(study_place(planned, attempt)),
            ..self.order(planned)
        }
    }
}

/// What a rehearsal tells while it goes on.
#[derive(Clone, Debug)]
pub enum Rehearsed<'a> {
    /// This event is on the disk: what it says is not lost any more.
    Acknowledged(i64),
    /// A trial is over.
    Trial(&'a PlannedTrial, &'a TrialResult),
}

/// How a rehearsal is run.
pub struct RehearsalOptions<'a> {
    /// The kind of simulated participants.
    pub people: People,
    /// So many participants at once, each with a program for their trials.
    pub jobs: usize,
    /// Starts such a program, which calls [`work`](super::work).
    pub worker: &'a (dyn Fn() -> Command + Sync),
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
    tell: impl Fn(Rehearsed<'_>) + Sync,
) -> Result<bool, Box<dyn Error>> {
    let people: Vec<usize> = (1..=conductor.study.plan.participants).collect();
    let study = conductor.study.clone();
    let rehearsal = Rehearsal {
        study: &study,
        conductor: Mutex::new(conductor),
        waiting: Mutex::new(people.into_iter()),
        failed: AtomicBool::new(false),
        options,
        tell: &tell,
    };
    in_threads(options.jobs, &rehearsal.failed, || rehearsal.work())?;
    let conductor = rehearsal.conductor.into_inner().unwrap_or_else(PoisonError::into_inner);
    Ok(conductor.progress().finished())
}

struct Rehearsal<'a, T> {
    study: &'a Study,
    conductor: Mutex<Conductor>,
    waiting: Mutex<std::vec::IntoIter<usize>>,
    failed: AtomicBool,
    options: &'a RehearsalOptions<'a>,
    tell: &'a T,
}

impl<T: Fn(Rehearsed<'_>) + Sync> Rehearsal<'_, T> {
    fn conductor(&self) -> MutexGuard<'_, Conductor> {
        self.conductor.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn stopped(&self) -> bool {
        self.options.interrupted.load(Ordering::Relaxed) || self.failed.load(Ordering::Relaxed)
    }

    /// Does something with the conductor, and tells of every event that it wrote.
    fn acknowledged<R>(
        &self,
        act: impl FnOnce(&mut Conductor) -> Result<R, StudyError>,
    ) -> Result<R, StudyError> {
        let mut conductor = self.conductor();
        let before = conductor.last_id();
        let done = act(&mut conductor);
        for id in before + 1..=conductor.last_id() {
            (self.tell)(Rehearsed::Acknowledged(id));
        }
        done
    }

    fn work(&self) -> Result<(), Box<dyn Error>> {
        let mut worker = None;
        loop {
            let next = self.waiting.lock().unwrap_or_else(PoisonError::into_inner).next();
            let Some(participant) = next else { return Ok(()) };
            self.person(participant, &mut worker)?;
        }
    }

    /// What a participant has done before each trial.
    fn histories(&self, participant: usize) -> Vec<(PlannedTrial, TrialHistory)> {
        let plan = &self.study.plan;
        let choices: Vec<_> = (0..plan.conditions.len()).map(|condition| plan.choice(condition)).collect();
        let sessions = self.study.schedule.sessions.iter().filter(|own| own.participant == participant);
        let sessions: Vec<_> = sessions.cloned().collect();
        let before = histories(plan, &sessions, &choices);
        before.into_iter().map(|(_, planned, history)| (planned.clone(), history)).collect()
    }

    /// All sessions that a participant has left.
    fn person(&self, participant: usize, worker: &mut Option<Worker>) -> Result<(), Box<dyn Error>> {
        let mut lost = 0;
        let before = self.histories(participant);
        while !self.stopped() {
            let session = self.acknowledged(|conductor| {
                if conductor.progress().next_session(participant).is_none() {
                    return Ok(None);
                }
                if !conductor.progress().people().contains_key(&participant) {
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
                        .and_then(|spot| Some((progress.happening(&spot)?.clone(), spot)))
                };
                let Some((happening, spot)) = next else { break };
                match self.step(&happening, &spot, &before, worker)? {
                    None => lost = 0,
                    Some(_) if lost < MOST_LOST => lost += 1,
                    Some(error) => return Err(error.into()),
                }
            }
        }
        Ok(())
    }

    /// Does a step; an error if its program was gone, so that it is done again.
    fn step(
        &self,
        happening: &Happening,
        spot: &Spot,
        before: &[(PlannedTrial, TrialHistory)],
        worker: &mut Option<Worker>,
    ) -> Result<Option<WorkerError>, Box<dyn Error>> {
        let record = self.acknowledged(|conductor| conductor.begin(spot))?;
        let (mut outcome, mut gone) = (StepOutcome::Done, None);
        if let (Happening::Trial(planned), Some(record)) = (happening, &record) {
            let attempt = self.conductor().progress().step(spot).attempts;
            let mut order = self.study.recorded_order(planned, attempt, record);
            let history = before.iter().find(|(other, _)| other == planned).map(|(_, history)| *history);
            let seed = self.study.plan.seed;
            let person =
                person_values(self.options.people, seed, planned.participant, &history.unwrap_or_default());
            // What the plan sets has the last word about a person.
            order.choice.set.splice(0..0, person);
            if worker.is_none() {
                *worker = Some(Worker::start(&mut (self.options.worker)())?);
            }
            let done = worker.as_mut().map(|worker| worker.run(&order, || self.stopped()));
            match done.unwrap_or_else(|| Err(WorkerError::Gone { how: "it never began".to_owned() })) {
                Ok(TrialDone { result, .. }) => {
                    (self.tell)(Rehearsed::Trial(planned, &result));
                    if result.ended == TrialEnd::Interrupt {
                        outcome = StepOutcome::Interrupted;
                    }
                }
                Err(error @ WorkerError::Gone { .. }) => {
                    (*worker, outcome, gone) = (None, StepOutcome::Interrupted, Some(error));
                }
                Err(error) => {
                    self.acknowledged(|conductor| conductor.end(spot, StepOutcome::Interrupted))?;
                    return Err(error.into());
                }
            }
        } else if let Some(form) = happening.form() {
            let conditions = self.study.conditions();
            let seed = self.study.plan.seed ^ ((spot.participant as u64) << 32) ^ spot.step as u64;
            for (item, answer) in self.study.forms[form].rehearsed(&conditions, seed) {
                self.acknowledged(|conductor| conductor.answer(spot, &item, Some(answer)))?;
            }
        }
        self.acknowledged(|conductor| conductor.end(spot, outcome))?;
        Ok(gone)
    }
}
