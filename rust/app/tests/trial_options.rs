//! Options of the trial configuration, each through a whole short trial on the real stack: levels of limb loss,
//! safeguards, assistant, and what becomes of the posterior.

use proact_app::trial;
use proact_devices::EmgOrigin;
use proact_testbed::{MethodName, Session, Setup, TrialConfig};
use proact_types::{BlockId, DisplayFrame, GazeSample, Gesture, PlannerView, Point, Vector};
use std::error::Error;

type Outcome<T = ()> = Result<T, Box<dyn Error>>;

/// Positions of the joints from the elbow on, and of the wrist's, among the arm's.
const FROM_ELBOW: std::ops::Range<usize> = 3..7;
const WRIST: std::ops::Range<usize> = 4..7;

fn config(method: MethodName, values: &[&str]) -> Outcome<TrialConfig> {
    Ok(TrialConfig::new(method, 1, Setup::named("still")?).with_values(values)?)
}

/// A live trial with the values of the configuration changed.
fn live(method: MethodName, values: &[&str]) -> Outcome<Session> {
    Ok(trial::live(config(method, values)?)?.session)
}

/// Where a block stands.
fn block(session: &Session, block: BlockId) -> Vector {
    session.testbed().plant().state().blocks[block.index()].pose.translation.vector
}

/// Makes a gesture for `ms`, looking at `point` if there is one; the last frame.
fn make(session: &mut Session, gesture: Gesture, point: Option<Vector>, ms: u64) -> Outcome<DisplayFrame> {
    let mut last = None;
    session.person().act(gesture);
    for tick in 0..ms {
        if let Some(point) = point.filter(|_| tick % 10 == 0) {
            let origin = Point::from(session.head().translation.vector);
            session.person().point(GazeSample { origin, direction: point - origin.coords, valid: true });
        }
        last = session.step(false)?.frame.or(last);
    }
    Ok(last.ok_or("less than one frame")?)
}

/// A whole short trial of method A with a simulated participant.
struct ShortTrial {
    /// The greatest way of each arm joint from the start, rad.
    way: [f64; 7],
    /// All modes that were shown, ascending.
    modes: Vec<u8>,
    /// Where the limb and the arm were in the end, rad; no limb where none was tracked.
    limb: Option<Vec<f64>>,
    end: Vec<f64>,
}

fn short_trial(level: &str) -> Outcome<ShortTrial> {
    let level = format!("profile.level={level}");
    let config = config(MethodName::A, &[&level, "limit_secs=25.0"])?;
    let mut session = trial::simulated(config, &EmgOrigin::Synthetic)?.session;
    let start = session.testbed().plant().state().position.clone();
    let (mut way, mut modes, mut limb) = ([0.0_f64; 7], Vec::new(), None);
    loop {
        let step = session.step(false)?;
        let state = session.testbed().plant().state();
        way.iter_mut().enumerate().for_each(|(k, way)| *way = way.max((state.position[k] - start[k]).abs()));
        modes.extend(step.frame.as_ref().and_then(|frame| frame.mode.as_ref()).map(|mode| mode.number));
        limb = step.input.limb.map(|limb| limb.to_vec()).or(limb);
        if step.output.finished {
            modes.sort_unstable();
            modes.dedup();
            let end = state.position[..7].to_vec();
            return Ok(ShortTrial { way, modes, limb, end });
        }
    }
}

#[test]
fn a_whole_arm_is_driven_by_the_method_and_no_limb_is_followed() -> Outcome {
    let ShortTrial { way, modes, limb, .. } = short_trial("shoulder")?;
    assert_eq!(limb, None);
    assert!(way.iter().any(|way| *way > 0.2), "{way:?}");
    assert!(modes.iter().all(|&mode| mode < 7), "{modes:?}");
    Ok(())
}

#[test]
fn above_the_elbow_the_shoulder_follows_the_limb_and_the_method_has_the_rest() -> Outcome {
    let ShortTrial { way, modes, limb, end } = short_trial("above_elbow")?;
    let limb = limb.ok_or("a limb was tracked")?;
    assert!(modes.iter().all(|&mode| FROM_ELBOW.contains(&mode.into())), "{modes:?}");
    assert!(way[..FROM_ELBOW.start].iter().any(|way| *way > 0.1), "the limb moved: {way:?}");
    let off = (0..FROM_ELBOW.start).map(|k| (limb[k] - end[k]).abs()).fold(0.0, f64::max);
    assert!(off < 0.05, "the arm is {off} rad off the limb");
    Ok(())
}

#[test]
fn below_the_elbow_shoulder_and_elbow_follow_the_limb_and_the_method_has_the_wrist() -> Outcome {
    let ShortTrial { way, modes, limb, end } = short_trial("below_elbow")?;
    let limb = limb.ok_or("a limb was tracked")?;
    assert!(modes.iter().all(|&mode| WRIST.contains(&mode.into())), "{modes:?}");
    assert!(way[..WRIST.start].iter().any(|way| *way > 0.1), "the limb moved: {way:?}");
    let off = (0..WRIST.start).map(|k| (limb[k] - end[k]).abs()).fold(0.0, f64::max);
    assert!(off < 0.05, "the arm is {off} rad off the limb");
    Ok(())
}

#[test]
fn a_persons_tracked_limb_is_followed_while_the_method_turns_the_wrist() -> Outcome {
    let mut session = live(MethodName::A, &["profile.level=below_elbow"])?;
    let start = session.testbed().plant().state().position.clone();
    let mut limb = start[..7].to_vec();
    limb[3] += 0.3;
    session.person().track_limb(&limb)?;
    // At the start the wrist stands at the limit to which WE turns it.
    make(&mut session, Gesture::WristFlexion, None, 1500)?;
    let moved: Vec<f64> =
        session.testbed().plant().state().position.iter().zip(&start).map(|(q, s)| q - s).collect();
    assert!((moved[3] - 0.3).abs() < 0.02, "the elbow follows: {moved:?}");
    assert!(moved[4].abs() > 0.3, "the method turns the wrist: {moved:?}");
    assert!(moved[..3].iter().all(|q| q.abs() < 0.02), "{moved:?}");
    for wrong in [vec![0.0; 3], vec![f64::NAN; 7]] {
        let error = session.person().track_limb(&wrong).expect_err("no limb").to_string();
        assert!(error.contains("expected 7 finite angles"), "{error}");
    }
    Ok(())
}

#[test]
fn the_limiter_and_its_acceleration_are_options() -> Outcome {
    let speed_after_100_ms = |values: &[&str]| -> Outcome<f64> {
        let mut session = live(MethodName::A, values)?;
        make(&mut session, Gesture::WristExtension, None, 100)?;
        Ok(session.testbed().plant().state().velocity[0].abs())
    };
    let gentle = speed_after_100_ms(&["profile.limiter.acceleration_rad_per_s2=0.5"])?;
    let none = speed_after_100_ms(&["profile.limiter="])?;
    assert!(gentle < 0.07 && none > 0.2, "{gentle} and {none} rad/s");
    Ok(())
}

#[test]
fn the_dead_man_and_its_times_are_options() -> Outcome {
    let refusal = |values: &[&str]| -> Outcome<bool> {
        let mut session = live(MethodName::D, values)?;
        let red = block(&session, BlockId::Red1);
        make(&mut session, Gesture::NoMotion, Some(red), 100)?;
        let frame = make(&mut session, Gesture::WristExtension, None, 450)?;
        Ok(
            matches!(frame.planner, PlannerView::Failed { reason, .. } if reason.contains("eye tracker is silent")),
        )
    };
    assert!(refusal(&["profile.dead_man.gaze_ms=200"])?);
    assert!(!refusal(&["profile.dead_man="])?);
    Ok(())
}

#[test]
fn an_assistant_that_shares_the_speeds_is_an_option_of_methods_a_and_b() -> Outcome {
    let aside = |values: &[&str]| -> Outcome<f64> {
        let mut session = live(MethodName::B, values)?;
        let place = session.testbed().plant().state().blocks[0].pose.translation.vector;
        let before = make(&mut session, Gesture::NoMotion, Some(place), 50)?;
        let after = make(&mut session, Gesture::WristExtension, Some(place), 1000)?;
        let tip = |frame: &DisplayFrame| frame.world_from_tip.translation.vector;
        // WE moves along x; to the block it also goes down.
        Ok(tip(&before).z - tip(&after).z)
    };
    let (alone, helped) = (aside(&[])?, aside(&["profile.blend.share=0.5"])?);
    assert!(alone.abs() < 0.01 && helped > 0.015, "{alone} m alone, {helped} m with the assistant");
    let error = live(MethodName::D, &["profile.blend.share=0.5"]).err().ok_or("D plans")?.to_string();
    assert!(error.contains("profile.blend"), "{error}");
    let error = config(MethodName::B, &["profile.blend.share=1.5"]).expect_err("over one").to_string();
    assert!(error.contains("blend.share"), "{error}");
    Ok(())
}

/// Looks for a second at the first red block, then for `ms` at a point on the way to the other red one.
fn highlight_after(values: &[&str], share: f64, ms: u64) -> Outcome<Option<BlockId>> {
    let mut session = live(MethodName::D, values)?;
    let (first, second) = (block(&session, BlockId::Red1), block(&session, BlockId::Red2));
    let frame = make(&mut session, Gesture::NoMotion, Some(first), 1000)?;
    assert_eq!(frame.target.block, Some(BlockId::Red1));
    let point = first + (second - first) * share;
    Ok(make(&mut session, Gesture::NoMotion, Some(point), ms)?.target.block)
}

#[test]
fn the_filtered_model_is_an_option_and_does_not_follow_a_glance() -> Outcome {
    assert_eq!(highlight_after(&[], 1.0, 60)?, Some(BlockId::Red2));
    assert_eq!(highlight_after(&["intent_model=filtered"], 1.0, 60)?, Some(BlockId::Red1));
    assert_eq!(highlight_after(&["intent_model=filtered"], 1.0, 1500)?, Some(BlockId::Red2));
    Ok(())
}

#[test]
fn hysteresis_is_an_option_and_keeps_the_highlight_on_a_look_between_two_blocks() -> Outcome {
    assert_eq!(highlight_after(&[], 0.55, 200)?, Some(BlockId::Red2));
    assert_eq!(highlight_after(&["intent.hysteresis=20.0"], 0.55, 200)?, Some(BlockId::Red1));
    assert_eq!(highlight_after(&["intent.hysteresis=20.0"], 1.0, 200)?, Some(BlockId::Red2));
    Ok(())
}

#[test]
fn values_that_set_nothing_or_something_unknown_are_refused_with_what_was_given() -> Outcome {
    for (value, expected) in [
        ("limit_secs", "KEY=VALUE"),
        ("limit_secs.x=1", "KEY=VALUE"),
        ("colour=red", "colour"),
        ("limit_secs=-1.0", "limit_secs"),
        ("profile.level=knee", "knee"),
        ("intent_model=guess", "guess"),
    ] {
        let error = config(MethodName::A, &[value]).expect_err(value).to_string();
        assert!(error.contains(expected), "{value}: {error}");
    }
    Ok(())
}
