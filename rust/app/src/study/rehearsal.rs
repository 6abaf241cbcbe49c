//! A study without people: simulated participants drive its trials, and its questions are answered at random.

use super::{
    Study,
    conductor::{Conductor, StudyError, record_name},
};
use crate::{
    Audience, Recorder, Registry, run_to_end,
    trial::{self, Assembly},
    trial_choice::{TrialContext, trial_config},
};
use proact_devices::{EmgOrigin, FeedbackSinks};
use proact_study::{Happening, PlannedTrial, Spot, StepOutcome};
use proact_testbed::{TrialEnd, TrialResult};
use std::{
    error::Error,
    path::Path,
    sync::{
        Mutex, MutexGuard, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
};

/// A trial of a plan with a simulated participant, as fast as it goes; recorded in `dir`, if one is given.
///
/// # Errors
/// A native library or the disk refuses.
pub fn simulated_trial(
    study: &Study,
    registry: &Registry,
    planned: &PlannedTrial,
    dir: Option<&Path>,
    interrupted: &AtomicBool,
) -> Result<TrialResult, Box<dyn Error>> {
    let (arm, config) = study.trial(planned, registry)?;
    let Assembly { session, classifier, plans, .. } =
        trial::simulated_with(&registry.methods, &arm, config, &EmgOrigin::Synthetic, None)?;
    let config = session.testbed().config().clone();
    let recorder = match dir {
        Some(dir) => {
            let bag = format!("{}.bag", record_name(planned));
            let recorder = Recorder::create_as(dir, &bag, &config, &arm, classifier.as_ref())?;
            Some(recorder.with_plans(plans)?)
        }
        None => None,
    };
    let mut nobody = Audience { page: None, rosbridge: None, feedback: FeedbackSinks::default(), interrupted };
    run_to_end(session, recorder, &mut nobody, dir, |_| {})
}

impl Study {
    /// The arm and the configuration of a planned trial.
    ///
    /// # Errors
    /// Names of the plan that mean nothing; [`Study::open`] has found them.
    pub fn trial(
        &self,
        planned: &PlannedTrial,
        registry: &Registry,
    ) -> Result<(crate::Arm, proact_testbed::TrialConfig), Box<dyn Error>> {
        let condition = self.plan.conditions.iter().position(|other| other.name == planned.condition);
        let choice = self.plan.choice(condition.ok_or("a trial of no condition")?);
        let context = TrialContext {
            methods: &registry.methods,
            default_setup: super::DEFAULT_SETUP,
            seed: planned.seed,
            arrangement: planned.arrangement.as_deref(),
            process: None,
            emg: None,
        };
        trial_config(&choice, context)
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

/// Runs all that is left of a study with simulated participants, `jobs` of them at once. True if the study is finished, false
/// if it was interrupted.
///
/// # Errors
/// The first thing that went wrong; the study can be taken up again.
pub fn rehearse(
    conductor: Conductor,
    registry: &Registry,
    jobs: usize,
    interrupted: &AtomicBool,
    tell: impl Fn(Rehearsed<'_>) + Sync,
) -> Result<bool, Box<dyn Error>> {
    let people: Vec<usize> = (1..=conductor.study.plan.participants).collect();
    let study = conductor.study.clone();
    let rehearsal = Rehearsal {
        study: &study,
        registry,
        conductor: Mutex::new(conductor),
        waiting: Mutex::new(people.into_iter()),
        failed: AtomicBool::new(false),
        interrupted,
        tell: &tell,
    };
    let failures: Vec<String> = std::thread::scope(|scope| {
        let work = || {
            let done = rehearsal.work();
            rehearsal.failed.fetch_or(done.is_err(), Ordering::Relaxed);
            done.map_err(|error| error.to_string())
        };
        let workers: Vec<_> = (0..jobs.max(1)).map(|_| scope.spawn(work)).collect();
        workers
            .into_iter()
            .filter_map(|worker| worker.join().unwrap_or_else(|_| Err("a worker panicked".to_owned())).err())
            .collect()
    });
    if let Some(failure) = failures.into_iter().next() {
        return Err(failure.into());
    }
    let conductor = rehearsal.conductor.into_inner().unwrap_or_else(PoisonError::into_inner);
    Ok(conductor.progress().finished())
}

struct Rehearsal<'a, T> {
    study: &'a Study,
    registry: &'a Registry,
    conductor: Mutex<Conductor>,
    waiting: Mutex<std::vec::IntoIter<usize>>,
    failed: AtomicBool,
    interrupted: &'a AtomicBool,
    tell: &'a T,
}

impl<T: Fn(Rehearsed<'_>) + Sync> Rehearsal<'_, T> {
    fn conductor(&self) -> MutexGuard<'_, Conductor> {
        self.conductor.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn stopped(&self) -> bool {
        self.interrupted.load(Ordering::Relaxed) || self.failed.load(Ordering::Relaxed)
    }

    /// Does something with the conductor, and tells of every event that it wrote.
    fn acknowledged<R>(&self, act: impl FnOnce(&mut Conductor) -> Result<R, StudyError>) -> Result<R, StudyError> {
        let mut conductor = self.conductor();
        let before = conductor.last_id();
        let done = act(&mut conductor);
        for id in before + 1..=conductor.last_id() {
            (self.tell)(Rehearsed::Acknowledged(id));
        }
        done
    }

    fn work(&self) -> Result<(), Box<dyn Error>> {
        loop {
            let next = self.waiting.lock().unwrap_or_else(PoisonError::into_inner).next();
            let Some(participant) = next else { return Ok(()) };
            self.person(participant)?;
        }
    }

    /// All sessions that a participant has left.
    fn person(&self, participant: usize) -> Result<(), Box<dyn Error>> {
        while !self.stopped() {
            let session = self.acknowledged(|conductor| {
                if conductor.progress().next_session(participant).is_none() {
                    return Ok(None);
                }
                if !conductor.progress().people().contains_key(&participant) {
                    let id = format!("P{participant:02}");
                    conductor.write(proact_study::StudyEvent::Enrolled { participant, id })?;
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
                self.step(&happening, &spot)?;
            }
        }
        Ok(())
    }

    fn step(&self, happening: &Happening, spot: &Spot) -> Result<(), Box<dyn Error>> {
        let record = self.acknowledged(|conductor| conductor.begin(spot))?;
        let mut outcome = StepOutcome::Done;
        if let (Happening::Trial(planned), Some(record)) = (happening, &record) {
            let dir = self.study.folder.join(record);
            let result = simulated_trial(self.study, self.registry, planned, Some(&dir), self.interrupted)?;
            (self.tell)(Rehearsed::Trial(planned, &result));
            if result.ended == TrialEnd::Interrupt {
                outcome = StepOutcome::Interrupted;
            }
        } else if let Some(form) = happening.form() {
            let conditions = self.study.conditions();
            let seed = self.study.plan.seed ^ ((spot.participant as u64) << 32) ^ spot.step as u64;
            for (item, answer) in self.study.forms[form].rehearsed(&conditions, seed) {
                self.acknowledged(|conductor| conductor.answer(spot, &item, Some(answer)))?;
            }
        }
        self.acknowledged(|conductor| conductor.end(spot, outcome))?;
        Ok(())
    }
}
