//! Plans that are in time, late, cancelled, or come from the log.

mod common;

use common::{Outcome, Run, config, replayed, stare_with};
use proact_control::doubles::test_hand;
use proact_testbed::{
    ResultFaultKind, TestbedParts, TrialConfig,
    doubles::{self, InstantPlans, PlanCall, PlanCalls, ScriptedGaze},
    first_divergence,
    ports::PlanService,
};
use proact_types::{Command, EventKind, PlanReply, PlanRequest, PlanStatus, SimTime, Trajectory};
use std::sync::Arc;

/// From a request to the tick in which its plan is due, as the default configuration has it.
const LATENCY_MS: u64 = 50;

/// A look at a block, WE from 1 s on until `until`, plans `late_by` polls; a trial that waits for plans or does not.
fn run(waits: bool, late_by: u32, until: u64) -> Outcome<(TrialConfig, Run, PlanCalls)> {
    let config = TrialConfig { wait_for_plans: waits, ..config("C", 60.0) };
    let plans = InstantPlans::new(Arc::new(test_hand())).late_by(late_by);
    let calls = plans.calls();
    let parts = TestbedParts { plans: Box::new(plans), ..doubles::testbed_parts(&config) };
    let script = vec![(1000, Command::WristExtension), (until, Command::NoMotion)];
    let mut trial = stare_with(config.clone(), parts, script, ScriptedGaze::default())?;
    Ok((config, Run::of(&mut trial, 3000)?, calls))
}

fn requested(run: &Run) -> Vec<u64> {
    run.times(|kind| matches!(kind, EventKind::PlanRequested { .. }))
}

fn finished(run: &Run) -> Vec<u64> {
    run.times(|kind| matches!(kind, EventKind::PlanFinished { status: PlanStatus::Ok, .. }))
}

// Catches a plan that acts before its latency, which would make a batch faster than life, or a poll in a batch.
#[test]
fn a_plan_takes_effect_when_it_is_due_and_the_arm_stands_until_then() -> Outcome {
    let (_, run, calls) = run(true, 500, 3000)?;
    let (requested_at, took) = (requested(&run), finished(&run));
    assert_eq!((requested_at.len(), took.len()), (1, 1));
    assert_eq!(took[0], requested_at[0] + LATENCY_MS, "a batch waits, however late the planner is");
    assert_eq!(run.turned(1, took[0] - 1), 0.0);
    assert!(run.turned(took[0], 3000) > 0.01);
    assert_eq!(*calls.borrow(), [PlanCall::Submit(1)]);
    Ok(())
}

// Catches a live tick that waits, a late plan that is dropped, and a replay that takes it at another tick.
#[test]
fn a_late_plan_acts_when_it_comes_and_a_replay_takes_it_in_the_same_tick() -> Outcome {
    let (config, run, _) = run(false, 200, 3000)?;
    let (requested_at, took) = (requested(&run), finished(&run));
    assert_eq!(took, [requested_at[0] + LATENCY_MS + 200]);
    assert_eq!(run.turned(1, took[0] - 1), 0.0);
    assert!(run.turned(took[0], 3000) > 0.01);
    assert_eq!(first_divergence(&run.spans, &replayed(&config, &run.inputs)?), None);
    Ok(())
}

// Catches an arm that sets off after the person let go.
#[test]
fn a_plan_that_is_cancelled_moves_nothing_and_the_planner_is_told() -> Outcome {
    let (config, run, calls) = run(false, 400, 1300)?;
    assert_eq!(*calls.borrow(), [PlanCall::Submit(1), PlanCall::Cancel]);
    assert!(finished(&run).is_empty());
    assert_eq!(run.turned(1, 3000), 0.0);
    assert!(run.inputs.iter().all(|(_, input)| input.plan.is_none()));
    assert_eq!(first_divergence(&run.spans, &replayed(&config, &run.inputs)?), None);
    Ok(())
}

// Catches a replay that asks a planner, or one that goes on without a plan that the log has lost.
#[test]
fn a_logged_plan_is_taken_in_place_of_the_planners_and_a_lost_one_is_named() -> Outcome {
    let (config, run, _) = run(true, 0, 3000)?;
    assert_eq!(first_divergence(&run.spans, &replayed(&config, &run.inputs)?), None);

    let mut inputs = run.inputs.clone();
    inputs.iter_mut().for_each(|(_, input)| input.plan = None);
    let lost = first_divergence(&run.spans, &replayed(&config, &inputs)?).ok_or("goes unnoticed")?;
    assert_eq!(lost.fields.first().map(String::as_str), Some("input.plan"), "{lost:?}");
    let took = SimTime(finished(&run)[0]);
    assert!((lost.from..=lost.to).contains(&took), "{lost:?}, taken at {took:?}");
    Ok(())
}

// Catches a plan that is taken although nobody waits for it: that of an earlier request.
#[test]
fn the_answer_to_another_request_moves_nothing() -> Outcome {
    let (config, run, _) = run(false, 400, 3000)?;
    let requested_at = requested(&run)[0];
    let stray = PlanReply {
        id: 99,
        status: PlanStatus::Ok,
        trajectory: Trajectory::default(),
        reason: String::new(),
        clearance_m: None,
    };
    let mut inputs = run.inputs.clone();
    inputs[requested_at as usize + 100].1.plan = Some(stray);
    assert_eq!(first_divergence(&run.spans, &replayed(&config, &inputs)?), None);
    Ok(())
}

/// Finds something in the way of every goal.
struct Blocked;

const WHY: &str = "The arm would touch something at the goal: wristz_link and lid.";

impl PlanService for Blocked {
    fn submit(&mut self, _request: PlanRequest) {}

    fn poll(&mut self, id: u64) -> Option<PlanReply> {
        Some(self.wait(id))
    }

    fn wait(&mut self, id: u64) -> PlanReply {
        PlanReply::without_plan(id, PlanStatus::GoalInCollision, WHY)
    }

    fn cancel(&mut self) {}
}

/// A trial whose planner refused everything ended without a word, and its events did not say what was in the way.
#[test]
fn ten_failed_plans_in_a_row_are_a_fault_of_the_trial_and_each_event_says_what_collides() -> Outcome {
    for (requests, faults) in [(9, 0), (12, 1)] {
        let config = config("C", 60.0);
        let parts = TestbedParts { plans: Box::new(Blocked), ..doubles::testbed_parts(&config) };
        let each = |k: u64| [(1000 + 400 * k, Command::WristExtension), (1200 + 400 * k, Command::NoMotion)];
        let script = (0..requests).flat_map(each).collect();
        let mut trial = stare_with(config.clone(), parts, script, ScriptedGaze::default())?;
        let run = Run::of(&mut trial, 1000 + 400 * requests)?;
        let failed = |kind: &EventKind| matches!(kind, EventKind::PlanFinished { reason, .. } if reason.as_deref() == Some(WHY));
        assert_eq!(run.times(failed).len() as u64, requests);
        let in_a_row = |kind: &EventKind| matches!(kind, EventKind::PlansFailed { count: 10, .. });
        assert_eq!(run.times(in_a_row).len(), faults);
        let found = trial.result().trial_faults;
        assert_eq!(found.len(), faults, "{found:?}");
        if let [fault] = found.as_slice() {
            assert_eq!(fault.kind, ResultFaultKind::FailedPlans);
            assert!(fault.reason.starts_with("12 plans failed in a row"), "{}", fault.reason);
            assert!(fault.reason.contains("wristz_link and lid"), "{}", fault.reason);
        }
        assert_eq!(replayed(&config, &run.inputs)?, run.spans);
    }
    Ok(())
}
