//! Every source dies in every way it can, at the far end of a real connection, and the arm is at rest in time.
//!
//! Until the issue of the frozen armband an arm went on for ever when samples stood still, and when a locked target was
//! followed by a frozen eye; half a second after the last word of a page or topic.

#![allow(clippy::unwrap_used, clippy::disallowed_methods)] // A test of files.

use proact_app::{Recorder, ReplayOptions, replay_trial, trial};
use proact_bench::safety::{FailureMode, StopCase, StopTime, cases, measure};
use proact_testbed::{Setup, TrialConfig};
use proact_types::{Command, GazeSample, InputSource, Point, StopCause, Vector};

/// Runs the cases of a source; what each gave.
fn run(source: InputSource) -> Vec<(StopCase, StopTime)> {
    let of_source: Vec<StopCase> = cases().into_iter().filter(|case| case.source == source).collect();
    assert!(!of_source.is_empty());
    let measured = of_source.into_iter().map(|case| {
        let found = measure(case).unwrap_or_else(|error| panic!("{case:?}: {error}"));
        println!("{case:?}: {found:?}");
        assert!(found.rest_ms <= case.limit_ms, "{case:?}: {found:?}");
        assert!(found.detection_ms <= found.rest_ms, "{case:?}: {found:?}");
        assert!(found.stays_at_rest, "{case:?}: a gesture held all through moved the arm again");
        assert!(found.moves_again, "{case:?}: nothing moves after the hand was relaxed");
        (case, found)
    });
    measured.collect()
}

fn causes(found: &[(StopCase, StopTime)]) -> Vec<(FailureMode, StopCause)> {
    found.iter().map(|(case, found)| (case.failure, found.cause)).collect()
}

#[test]
fn an_armband_that_dies_or_freezes_stops_the_arm() {
    let found = causes(&run(InputSource::Armband));
    for expected in [
        (FailureMode::Silent, StopCause::Silent),
        (FailureMode::Garbage, StopCause::Silent),
        (FailureMode::Constant, StopCause::Frozen),
        (FailureMode::Repeated, StopCause::Frozen),
        (FailureMode::Zeros, StopCause::Frozen),
        (FailureMode::Flat, StopCause::Flat),
        (FailureMode::Railed, StopCause::Railed),
        (FailureMode::HalfLost, StopCause::Lossy),
        (FailureMode::HalfRate, StopCause::WrongRate),
    ] {
        assert!(found.contains(&expected), "{expected:?} in {found:?}");
    }
}

#[test]
fn a_page_that_holds_a_gesture_and_dies_stops_the_arm_and_its_end_does_at_once() {
    for (case, found) in run(InputSource::Page) {
        let ended = matches!(case.failure, FailureMode::Closed | FailureMode::Killed);
        assert_eq!(found.cause, if ended { StopCause::Closed } else { StopCause::Silent }, "{case:?}");
        assert!(!ended || found.detection_ms <= 1, "{case:?}: {found:?}");
    }
}

#[test]
fn a_topic_of_gestures_that_dies_stops_the_arm() {
    assert!(run(InputSource::GestureTopic).iter().all(|(_, found)| found.cause == StopCause::Silent));
}

#[test]
fn an_eye_tracker_that_dies_stops_a_motion_that_follows_it() {
    let found = causes(&run(InputSource::EyeTracker));
    assert!(found.contains(&(FailureMode::Constant, StopCause::Frozen)), "{found:?}");
    assert!(found.contains(&(FailureMode::Blank, StopCause::TrackingLost)), "{found:?}");
    assert!(found.contains(&(FailureMode::Silent, StopCause::Silent)), "{found:?}");
}

#[test]
fn a_tracked_limb_or_shoulder_that_dies_holds_the_arm_and_is_named() {
    for source in [InputSource::LimbTracker, InputSource::ShoulderTracker] {
        for (case, found) in run(source) {
            let frozen = case.failure == FailureMode::Constant;
            assert_eq!(found.cause, if frozen { StopCause::Frozen } else { StopCause::Silent }, "{case:?}");
            assert!(found.reason.contains(&source.to_string()), "{}", found.reason);
        }
    }
}

/// What was heard of the sources is input: the record holds it, and a replay stops in the same tick.
#[test]
fn a_stop_is_on_the_record_with_its_reason_and_a_replay_stops_where_the_trial_did() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path().join("trial");
    let config = TrialConfig::new("A", 1, Setup::named("still").unwrap());
    let trial::Assembly { mut trial, arm, .. } = trial::live_trial(config).unwrap();
    let config = trial.testbed().config().clone();
    let mut recorder = Recorder::create(&dir, &config, &arm, None).unwrap();
    trial.person_stage_mut().set_command_from(InputSource::Page, Command::WristExtension);
    for tick in 1..=1500_u64 {
        if tick <= 400 && tick.is_multiple_of(40) {
            trial.person_stage_mut().record_heartbeat(InputSource::Page);
        }
        let step = trial.step(tick == 1500).unwrap();
        recorder.write(&step, trial.testbed().plant().state()).unwrap();
    }
    recorder.finish(&trial.result()).unwrap();
    let events = std::fs::read_to_string(dir.join("events.jsonl")).unwrap();
    let stopped =
        r#"{"time":601,"event":"stopped","source":"page","cause":"silent","reason":"the page is silent"}"#;
    assert!(events.contains(stopped), "{events}");
    let replayed = replay_trial(&dir, ReplayOptions::default()).unwrap();
    assert!(replayed.agrees, "{replayed:?}");
}

/// Neither a mouse that rests nor a participant without hands stops anything.
#[test]
fn a_mouse_that_rests_may_do_so_and_an_eye_that_does_may_not() {
    let stops = |measured: bool| {
        let config = TrialConfig::new("D", 1, Setup::named("still").unwrap());
        let mut trial = trial::live_trial(config).unwrap().trial;
        let ray = GazeSample {
            origin: Point::new(-0.5, 0.0, 1.6),
            direction: Vector::new(0.6, 0.1, -0.6),
            valid: true,
        };
        let mut stops = Vec::new();
        for tick in 1..=3000_u64 {
            if tick.is_multiple_of(20) {
                if measured {
                    trial.person_stage_mut().set_gaze(ray)
                } else {
                    trial.person_stage_mut().set_pointer_gaze(ray)
                }
            }
            trial.step(false).unwrap();
            stops.extend(trial.testbed().stop().map(|stop| (stop.source, stop.cause)));
        }
        stops.dedup();
        stops
    };
    assert_eq!(stops(false), []);
    assert_eq!(stops(true), [(InputSource::EyeTracker, StopCause::Frozen)]);
}
