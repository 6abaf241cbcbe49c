//! A gaze that is no number, blinks, or is frozen: what is highlighted, what stops the arm, and that nothing else does.

mod common;

use common::{Outcome, Run, config, stare};
use proact_testbed::doubles::{GazeFault, ScriptedGaze};
use proact_types::{Command, EventKind, InputSource, StopCause};

/// A highlight outlives the eye by this, ms, and a frame of the display.
const LOST_BY: std::ops::RangeInclusive<u64> = 500..=540;
/// An eye tracker is dead a second after its last measurement, which was up to 8 ms before the fault.
const DEAD_BY: std::ops::RangeInclusive<u64> = 993..=1001;

/// Looks at a block for six seconds, with WE from 2 s on; `fault` from 3 s on for `fault_ms`.
fn run(fault: GazeFault, fault_ms: u64) -> Outcome<Run> {
    let script = vec![(0, Command::NoMotion), (2000, Command::WristExtension)];
    let gaze = ScriptedGaze::default().with_fault(3000..3000 + fault_ms, fault);
    Run::of(&mut stare(config("C", 60.0), script, gaze)?, 6000)
}

fn stops(run: &Run) -> Vec<(u64, InputSource, StopCause)> {
    let of = |event: &proact_types::Event| match &event.kind {
        EventKind::Stopped { source, cause, .. } => Some((event.time.0, *source, *cause)),
        _ => None,
    };
    run.events.iter().filter_map(of).collect()
}

fn assert_stopped(run: &Run, cause: StopCause) {
    let stops = stops(run);
    let [(at, source, how)] = stops[..] else { panic!("expected one stop, got {stops:?}") };
    assert_eq!((source, how), (InputSource::EyeTracker, cause));
    assert!(DEAD_BY.contains(&(at - 3000)), "stopped at {at} ms");
    assert!(run.turned(3000, at) > 0.0, "it moved before");
    assert_eq!(run.turned(at + 1, 6000), 0.0, "it stands afterwards, although WE is held");
}

// Catches a highlight that flickers, or a stop, at every blink.
#[test]
fn a_blink_changes_nothing() -> Outcome {
    let run = run(GazeFault::Blink, 200)?;
    assert_eq!(run.highlighted(500, None), None);
    assert_eq!(stops(&run), []);
    assert!(run.times(|kind| matches!(kind, EventKind::GazeUnusable)).is_empty());
    Ok(())
}

// Catches a posterior that becomes NaN and stays so, an event for each of hundreds of samples, and a tracker that is
// taken for alive because it talks.
#[test]
fn a_gaze_that_is_no_number_counts_as_a_blink_is_said_once_and_stops_the_arm_in_time() -> Outcome {
    let short = run(GazeFault::NotANumber, 800)?;
    assert_eq!(short.times(|kind| matches!(kind, EventKind::GazeUnusable)).len(), 1);
    assert_eq!(stops(&short), []);
    let whole = run(GazeFault::NotANumber, 3000)?;
    assert_eq!(whole.times(|kind| matches!(kind, EventKind::GazeUnusable)).len(), 1);
    assert_stopped(&whole, StopCause::TrackingLost);
    Ok(())
}

// Catches a selection that is kept for ever without an eye, or does not come back with it.
#[test]
fn without_an_eye_nothing_is_highlighted_after_half_a_second_and_with_it_the_block_again() -> Outcome {
    for fault in [GazeFault::Blink, GazeFault::NotANumber, GazeFault::Silent] {
        // At rest: what the arm moves to stays shown.
        let gaze = ScriptedGaze::default().with_fault(3000..3900, fault);
        let run = Run::of(&mut stare(config("C", 60.0), vec![], gaze)?, 6000)?;
        let lost = run.highlighted(3000, None).ok_or("it stays")?;
        assert!(LOST_BY.contains(&(lost - 3000)), "{fault:?}: lost at {lost} ms");
        let back = run.highlighted(lost, Some(0)).ok_or("it stays away")?;
        assert!((3900..=3930).contains(&back), "{fault:?}: back at {back} ms");
    }
    Ok(())
}

// Catches a watch that takes measurements that repeat to the bit for signs of life.
#[test]
fn a_frozen_or_a_silent_tracker_stops_the_arm() -> Outcome {
    assert_stopped(&run(GazeFault::Frozen, 3000)?, StopCause::Frozen);
    assert_stopped(&run(GazeFault::Silent, 3000)?, StopCause::Silent);
    assert_stopped(&run(GazeFault::Blink, 3000)?, StopCause::TrackingLost);
    Ok(())
}
