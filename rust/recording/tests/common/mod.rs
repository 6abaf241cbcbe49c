//! A trial to be written and read back.

use proact_recording::{StudyTrialId, TrialHeader, TrialWriter};
use proact_types::{
    Command, EmgSample, Event, EventKind, GazeSample, ObjectId, PlanReply, PlanStatus, Point, Pose, SimTime,
    TickInput, Trajectory, TrajectoryPoint, Vector, joints,
};
use serde::{Deserialize, Serialize};
use std::path::Path;

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Digest {
    pub tick: u64,
    pub stages: Vec<String>,
}

pub fn header() -> TrialHeader {
    TrialHeader {
        config_toml: "# a trial\nmethod = \"D\"\n".to_owned(),
        seed: u64::MAX,
        versions: [("proact".to_owned(), "0.1.0".to_owned())].into(),
        commit: "0123456789ab".to_owned(),
        study_trial: Some(StudyTrialId {
            participant: 1,
            session: "first".to_owned(),
            condition: "gaze \"D\"".to_owned(),
            trial: 2,
            attempt: 3,
        }),
        files: [("classifier.json".to_owned(), b"{\"classes\": []}".to_vec())].into(),
    }
}

/// Something different for every tick; empty for every third.
pub fn input(tick: u64) -> TickInput {
    let x = (tick as f64).sqrt();
    let mut input = TickInput::default();
    match tick % 3 {
        0 => {}
        1 => {
            for counter in 0..tick % 5 + 1 {
                let channels = (0..8).map(|c| x * f64::from(c)).collect();
                input.emg.push(EmgSample { counter, channels });
            }
            input.gaze =
                Some(GazeSample { origin: Point::new(x, 0.1, 1.5), direction: Vector::x(), valid: true });
        }
        _ => {
            input.command = Some(Command::ALL[tick as usize % 5]);
            input.shoulder = Some(Pose::new(Vector::new(-x, 0.12, 1.5), Vector::new(0.1, x, 0.3)));
            let q = joints(&[x; 7]);
            input.plan = Some(PlanReply {
                id: tick,
                status: PlanStatus::Intermediate,
                trajectory: Trajectory {
                    points: vec![TrajectoryPoint { time_secs: 0.0, q: q.clone(), qd: q }],
                },
                reason: "the goal is out of reach".to_owned(),
                clearance_m: None,
            });
        }
    }
    input
}

pub fn event(time: u64) -> Event {
    Event {
        time: SimTime(time),
        kind: EventKind::ObjectOnTarget { object: ObjectId(3), distance: 0.1 + 0.2 },
    }
}

pub fn digest(tick: u64) -> Digest {
    Digest { tick, stages: vec![format!("{tick:x}")] }
}

/// A finished trial of `ticks` ticks.
pub fn write_trial(dir: &Path, ticks: u64) {
    let mut trial = TrialWriter::create(dir, &header()).unwrap();
    for tick in 1..=ticks {
        trial.write_input(SimTime(tick), &input(tick)).unwrap();
        if tick % 100 == 0 {
            trial.write_event(&event(tick)).unwrap();
        }
        if tick % 100 == 0 || tick == ticks {
            trial.write_digest(&digest(tick)).unwrap();
        }
    }
    trial.finish(SimTime(ticks), &serde_json::json!({"on_target": 3})).unwrap();
}
