//! The planner on its thread.
#![allow(clippy::unwrap_used)]

mod common;

use common::*;
use proact_planning::{PlanWorker, PlannerOptions, SearchLimits};
use proact_testbed::ports::PlanService;
use proact_types::{PlanReply, PlanRequest, PlanStatus, joints};

fn worker() -> PlanWorker {
    PlanWorker::new(planner(PlannerOptions::default()))
}

fn requests() -> Vec<PlanRequest> {
    let model = model();
    (0..8_u64)
        .map(|id| {
            let mut request = pick(&model, still(), BlockRegion::ALL[id as usize % 4], id / 4);
            request.id = id + 1;
            request
        })
        .collect()
}

fn answers(requests: &[PlanRequest]) -> Vec<PlanReply> {
    let mut worker = worker();
    requests
        .iter()
        .map(|request| {
            worker.submit(request.clone());
            worker.wait(request.id)
        })
        .collect()
}

#[test]
fn two_workers_side_by_side_give_the_replies_of_one_alone_whatever_was_asked_before() {
    let requests = requests();
    let alone = answers(&requests);
    assert!(alone.iter().all(|reply| reply.status == PlanStatus::Ok));
    let backwards: Vec<PlanRequest> = requests.iter().rev().cloned().collect();
    let (first, second) = std::thread::scope(|scope| {
        let first = scope.spawn(|| answers(&requests));
        let second = scope.spawn(|| answers(&backwards));
        (first.join().unwrap(), second.join().unwrap())
    });
    // Not assert_eq: two trajectories would fill the screen.
    assert!(first == alone);
    assert!(second.into_iter().rev().collect::<Vec<_>>() == alone);
    // Another seed is another search, where no straight motion leads to the goal: the replies must be able to differ.
    let grip = alone[0].trajectory.points.last().unwrap().q.clone();
    let [one, other] = [0, 1]
        .map(|seed| place(&model(), still(), BlockRegion::ALL[0], target(BlockRegion::ALL[0]), &grip, seed));
    let carried = answers(&[one, PlanRequest { id: 2, ..other }]);
    assert!(carried.iter().all(|reply| reply.status == PlanStatus::Ok));
    assert!(carried[0].trajectory != carried[1].trajectory);
}

/// A goal to which no way leads, and a worker that would search for it for ever.
fn unending_request() -> (PlanWorker, PlanRequest) {
    // The time is no bound that a test would see, but more iterations than a million need one.
    let search = |max_iterations| PlannerOptions {
        search: SearchLimits { max_iterations, max_secs: Some(3600.0), ..SearchLimits::default() },
        ..PlannerOptions::default()
    };
    let mut planner = planner(search(100));
    // From an arm stretched ahead to one hanging down through the hole of a floor: the upper arm would have to
    // shrink.
    let mut request = pick(&model(), still(), BlockRegion::NM, 1);
    request.start = joints(&[1.4, -0.1, 0.0, 0.3, 0.0, 0.0, 0.0]);
    request.goal = proact_types::PlanGoal::Joints { q: joints(&[0.0, -0.05, 0.0, 0.1, 0.0, 0.0, 0.0]) };
    request.obstacles.clear();
    let free = planner.solve(&request);
    assert_eq!(free.status, PlanStatus::Ok, "without the floor there is a way: {}", free.reason);
    let sides = [("left", [2.0, 1.0], [0.0, 0.6]), ("right", [2.0, 1.0], [0.0, -0.6])];
    let ends = [("ahead", [1.0, 0.2], [0.6, 0.0]), ("behind", [1.0, 0.2], [-0.6, 0.0])];
    for (name, size, at) in sides.into_iter().chain(ends) {
        request.obstacles.push(proact_types::Obstacle {
            name: name.to_owned(),
            shape: proact_types::Shape::Box { size: [size[0], size[1], 0.01] },
            pose: proact_types::Pose::translation(-0.386 + at[0], at[1], 1.3),
            loose: false,
        });
    }
    let reply = planner.solve(&request);
    assert_eq!(reply.status, PlanStatus::NoPlan, "{}", reply.reason);
    (PlanWorker::new(common::planner(search(u32::MAX))), request)
}

#[test]
fn the_newest_request_wins_and_the_older_one_is_told_so() {
    let mut worker = worker();
    let requests = requests();
    for request in &requests {
        worker.submit(request.clone());
    }
    let last = worker.wait(8);
    assert_eq!((last.id, last.status), (8, PlanStatus::Ok));
    for id in 1..8 {
        let reply = worker.wait(id);
        assert!(matches!(reply.status, PlanStatus::Cancelled | PlanStatus::Ok), "{:?}", reply.status);
    }
    assert!((1..8).any(|id| worker.poll(id).unwrap().status == PlanStatus::Cancelled));
    assert_eq!(last, answers(&requests[7..])[0], "a cancelled request leaves no trace in the next reply");
}

#[test]
fn a_cancel_ends_a_search_without_end_and_the_next_request_is_answered() {
    let (mut worker, mut request) = unending_request();
    request.id = 1;
    worker.submit(request.clone());
    worker.cancel();
    assert_eq!(worker.wait(1).status, PlanStatus::Cancelled);
    // Cancelling with nothing under way harms nothing.
    worker.cancel();
    let next = requests().remove(0);
    worker.submit(PlanRequest { id: 2, ..next });
    assert_eq!(worker.wait(2).status, PlanStatus::Ok);
    // Dropping a busy worker ends its search.
    request.id = 3;
    worker.submit(request);
    drop(worker);
}

#[test]
fn an_unknown_request_is_answered_at_once() {
    let mut worker = worker();
    assert!(worker.poll(7).is_none());
    let reply = worker.wait(7);
    assert_eq!((reply.id, reply.status), (7, PlanStatus::Invalid));
}
