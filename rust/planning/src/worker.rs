//! The planner on a thread of its own, as the testbed's plan service.

use crate::plan_stats::SharedPlanStage;
use crate::{ArmPlanner, CancelFlag, PersonGeometry, PlanStage, PlanStats, person_obstacles};
use proact_testbed::ports::PlanService;
use proact_types::{PlanReply, PlanRequest, PlanStatus};
use std::collections::BTreeMap;
use std::sync::{Arc, Condvar, Mutex, MutexGuard};
use std::thread::JoinHandle;

/// Replies that are kept for a late question; a trial has one request under way at a time.
const MAX_KEPT_REPLIES: usize = 64;

/// A background thread that owns an [`ArmPlanner`]. The newest request wins; dropping the worker ends the
/// thread.
pub struct PlanWorker {
    shared: Arc<PlanWorkerShared>,
    cancel: CancelFlag,
    stage: SharedPlanStage,
    person: Option<PersonGeometry>,
    thread: Option<JoinHandle<()>>,
}

/// What each plan of a worker took, readable while it works.
#[derive(Clone)]
pub struct PlanLog(Arc<PlanWorkerShared>);

impl PlanLog {
    /// One entry for each request that was answered by planning, oldest first.
    pub fn entries(&self) -> Vec<PlanStats> {
        self.0.lock().log.clone()
    }

    /// Seconds that the planner's thread was busy.
    pub fn busy_secs(&self) -> f64 {
        self.0.lock().log.iter().map(|entry| entry.wall_secs).sum()
    }
}

struct PlanWorkerShared {
    state: Mutex<PlanWorkerState>,
    changed: Condvar,
}

#[derive(Default)]
struct PlanWorkerState {
    waiting: Option<PlanRequest>,
    running: Option<u64>,
    replies: BTreeMap<u64, PlanReply>,
    log: Vec<PlanStats>,
    shutdown: bool,
    /// The thread's clock of processor time, once it runs.
    cpu_clock: Option<i32>,
}

impl PlanWorkerShared {
    /// The state; a panic of the other side leaves it whole, because nothing is changed in steps.
    fn lock(&self) -> MutexGuard<'_, PlanWorkerState> {
        self.state.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
    }
}

impl PlanWorkerState {
    fn store_reply(&mut self, reply: PlanReply) {
        self.replies.insert(reply.id, reply);
        while self.replies.len() > MAX_KEPT_REPLIES {
            self.replies.pop_first();
        }
    }
}

impl PlanWorker {
    /// Starts the thread.
    pub fn new(planner: ArmPlanner) -> Self {
        let shared = Arc::new(PlanWorkerShared {
            state: Mutex::new(PlanWorkerState::default()),
            changed: Condvar::new(),
        });
        let cancel = planner.cancel_flag();
        let stage = planner.stage();
        let theirs = shared.clone();
        let thread = std::thread::spawn(move || run_worker(planner, &theirs));
        Self { shared, cancel, stage, person: None, thread: Some(thread) }
    }

    /// The same, with the person who wears the arm among the obstacles of every request, where its base has them.
    #[must_use]
    pub fn with_person(mut self, person: PersonGeometry) -> Self {
        self.person = Some(person);
        self
    }

    /// What the plans took.
    pub fn log(&self) -> PlanLog {
        PlanLog(self.shared.clone())
    }

    /// Processor time that the worker's thread has used so far, seconds.
    pub fn cpu_secs(&self) -> f64 {
        self.shared.lock().cpu_clock.map_or(0.0, crate::bridge::ffi::cpu_secs_of)
    }

    /// The request under way, and how far it has got; none while idle.
    pub fn progress(&self) -> Option<(u64, PlanStage)> {
        Some((self.shared.lock().running?, self.stage.get()))
    }
}

fn run_worker(mut planner: ArmPlanner, shared: &PlanWorkerShared) {
    let flag = planner.cancel_flag();
    let mut state = shared.lock();
    state.cpu_clock = Some(crate::bridge::ffi::thread_cpu_clock());
    loop {
        if state.shutdown {
            return;
        }
        let Some(request) = state.waiting.take() else {
            state = shared.changed.wait(state).unwrap_or_else(std::sync::PoisonError::into_inner);
            continue;
        };
        state.running = Some(request.id);
        // Under the lock, so that a cancel that arrives from now on is meant for this request.
        flag.lower();
        drop(state);
        let reply = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| planner.solve(&request)));
        state = shared.lock();
        state.running = None;
        if reply.is_ok() {
            state.log.push(planner.stats().clone());
        }
        state.store_reply(
            reply.unwrap_or_else(|_| {
                failed_reply(request.id, PlanStatus::Invalid, "The planner failed inside.")
            }),
        );
        shared.changed.notify_all();
    }
}

fn failed_reply(id: u64, status: PlanStatus, reason: &str) -> PlanReply {
    PlanReply::without_plan(id, status, reason)
}

impl PlanService for PlanWorker {
    fn submit(&mut self, mut request: PlanRequest) {
        self.cancel();
        if let Some(person) = &self.person {
            request.obstacles.extend(person_obstacles(&request.world_from_base, person));
        }
        let mut state = self.shared.lock();
        state.replies.remove(&request.id);
        state.waiting = Some(request);
        self.shared.changed.notify_all();
    }

    fn poll(&mut self, id: u64) -> Option<PlanReply> {
        self.shared.lock().replies.get(&id).cloned()
    }

    fn wait(&mut self, id: u64) -> PlanReply {
        let mut state = self.shared.lock();
        loop {
            if let Some(reply) = state.replies.get(&id) {
                return reply.clone();
            }
            let pending = state.running == Some(id) || state.waiting.as_ref().is_some_and(|r| r.id == id);
            if !pending {
                return failed_reply(id, PlanStatus::Invalid, "No such request was handed in.");
            }
            state = self.shared.changed.wait(state).unwrap_or_else(std::sync::PoisonError::into_inner);
        }
    }

    fn cancel(&mut self) {
        let mut state = self.shared.lock();
        if let Some(request) = state.waiting.take() {
            state.store_reply(failed_reply(request.id, PlanStatus::Cancelled, "The request was cancelled."));
        }
        if state.running.is_some() {
            self.cancel.raise();
        }
        self.shared.changed.notify_all();
    }
}

impl Drop for PlanWorker {
    fn drop(&mut self) {
        self.cancel();
        self.shared.lock().shutdown = true;
        self.shared.changed.notify_all();
        if let Some(thread) = self.thread.take() {
            // A panic inside was already turned into a reply; there is nobody left to tell.
            let _ = thread.join();
        }
    }
}
