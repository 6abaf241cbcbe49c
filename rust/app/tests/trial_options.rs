//! Options of the trial configuration, each through a whole short trial on the real stack: levels of limb loss,
//! safeguards, assistant, and what becomes of the posterior.

use proact_app::trial;
use proact_devices::EmgOrigin;
use proact_testbed::{RunningTrial, Setup, TrialConfig};
use proact_types::{
    Command, ControlledDof, DisplayFrame, GazeSample, ObjectId, PlanReply, PlanStatus, PlannerView, Point,
    Vector,
};
use std::error::Error;

type Outcome<T = ()> = Result<T, Box<dyn Error>>;

/// Positions of the joints from the elbow on, and of the wrist's, among the arm's.
const FROM_ELBOW: std::ops::Range<usize> = 3..7;
const WRIST: std::ops::Range<usize> = 4..7;

fn config(method: &str, values: &[&str]) -> Outcome<TrialConfig> {
    Ok(TrialConfig::new(method, 1, Setup::named("still")?).with_overrides(values)?)
}

/// A live trial with the values of the configuration changed.
fn live(method: &str, values: &[&str]) -> Outcome<RunningTrial> {
    Ok(trial::live_trial(config(method, values)?)?.trial)
}

/// Where a block stands.
fn block(trial: &RunningTrial, block: ObjectId) -> Vector {
    trial.testbed().plant().state().objects[block.index()].pose.translation.vector
}

/// Makes a gesture for `ms`, looking at `point` if there is one; the last frame.
fn make(trial: &mut RunningTrial, command: Command, point: Option<Vector>, ms: u64) -> Outcome<DisplayFrame> {
    let mut last = None;
    trial.person_stage_mut().set_command(command);
    for tick in 0..ms {
        if let Some(point) = point.filter(|_| tick % 10 == 0) {
            let origin = Point::from(trial.head_pose().translation.vector);
            trial.person_stage_mut().set_pointer_gaze(GazeSample {
                origin,
                direction: point - origin.coords,
                valid: true,
            });
        }
        last = trial.step(false)?.frame.map(|frame| *frame).or(last);
    }
    Ok(last.ok_or("less than one frame")?)
}

/// A whole short trial of method A with a simulated participant.
struct ShortTrial {
    /// The greatest way of each arm joint from the start, rad.
    joint_travel_rad: [f64; 7],
    /// All modes that were shown, ascending.
    modes: Vec<u8>,
    /// Where the limb and the arm were in the end, rad; no limb where none was tracked.
    limb: Option<Vec<f64>>,
    end: Vec<f64>,
}

fn short_trial(level: &str) -> Outcome<ShortTrial> {
    let level = format!("profile.level={level}");
    let config = config("A", &[&level, "limit_secs=25.0"])?;
    let mut trial = trial::simulated_trial(config, &EmgOrigin::Synthetic)?.trial;
    let start = trial.testbed().plant().state().position.clone();
    let (mut joint_travel_rad, mut modes, mut limb) = ([0.0_f64; 7], Vec::new(), None);
    loop {
        let step = trial.step(false)?;
        let state = trial.testbed().plant().state();
        joint_travel_rad
            .iter_mut()
            .enumerate()
            .for_each(|(k, travel)| *travel = travel.max((state.position[k] - start[k]).abs()));
        modes.extend(step.frame.as_ref().and_then(|frame| frame.mode.as_ref()).map(|mode| {
            match mode.controlled_dof {
                ControlledDof::Joint(joint) => joint,
                other => panic!("method A moves joints, not {other:?}"),
            }
        }));
        limb = step.input.limb.map(|limb| limb.to_vec()).or(limb);
        if step.output.finished {
            modes.sort_unstable();
            modes.dedup();
            let end = state.position[..7].to_vec();
            return Ok(ShortTrial { joint_travel_rad, modes, limb, end });
        }
    }
}

#[test]
fn a_whole_arm_is_driven_by_the_method_and_no_limb_is_followed() -> Outcome {
    let ShortTrial { joint_travel_rad, modes, limb, .. } = short_trial("shoulder")?;
    assert_eq!(limb, None);
    assert!(joint_travel_rad.iter().any(|travel| *travel > 0.2), "{joint_travel_rad:?}");
    assert!(modes.iter().all(|&mode| mode < 7), "{modes:?}");
    Ok(())
}

#[test]
fn above_the_elbow_the_shoulder_follows_the_limb_and_the_method_has_the_rest() -> Outcome {
    let ShortTrial { joint_travel_rad, modes, limb, end } = short_trial("above_elbow")?;
    let limb = limb.ok_or("a limb was tracked")?;
    assert!(modes.iter().all(|&mode| FROM_ELBOW.contains(&mode.into())), "{modes:?}");
    assert!(
        joint_travel_rad[..FROM_ELBOW.start].iter().any(|travel| *travel > 0.1),
        "the limb moved: {joint_travel_rad:?}"
    );
    let off = (0..FROM_ELBOW.start).map(|k| (limb[k] - end[k]).abs()).fold(0.0, f64::max);
    assert!(off < 0.05, "the arm is {off} rad off the limb");
    Ok(())
}

#[test]
fn below_the_elbow_shoulder_and_elbow_follow_the_limb_and_the_method_has_the_wrist() -> Outcome {
    let ShortTrial { joint_travel_rad, modes, limb, end } = short_trial("below_elbow")?;
    let limb = limb.ok_or("a limb was tracked")?;
    assert!(modes.iter().all(|&mode| WRIST.contains(&mode.into())), "{modes:?}");
    assert!(
        joint_travel_rad[..WRIST.start].iter().any(|travel| *travel > 0.1),
        "the limb moved: {joint_travel_rad:?}"
    );
    let off = (0..WRIST.start).map(|k| (limb[k] - end[k]).abs()).fold(0.0, f64::max);
    assert!(off < 0.05, "the arm is {off} rad off the limb");
    Ok(())
}

/// Caught a limb that pressed against something for the rest of the trial, and a person who waited as long for the mode of a
/// joint that the limb has.
#[test]
fn with_a_limb_of_its_own_a_person_brings_blocks_across_by_method_a() -> Outcome {
    for (level, seed) in [("below_elbow", 1), ("above_elbow", 2)] {
        let words = [&*format!("profile.level={level}"), "limit_secs=90.0"];
        let config = TrialConfig::new("A", seed, Setup::named("seated")?).with_overrides(&words)?;
        let mut trial = trial::simulated_trial(config, &EmgOrigin::Synthetic)?.trial;
        while !trial.step(false)?.output.finished {}
        let score = trial.result().score;
        assert!(score >= 1.0, "{level}: {score} blocks on target");
    }
    Ok(())
}

/// Runs `D` with a simulated participant of this level; plans and digest.
fn planned_trial(level: &str) -> Outcome<(Vec<PlanReply>, String, bool)> {
    let config = config("D", &[&format!("profile.level={level}"), "limit_secs=40.0"])?;
    let mut trial = trial::simulated_trial(config, &EmgOrigin::Synthetic)?.trial;
    let (mut plans, mut limb) = (Vec::new(), false);
    loop {
        let step = trial.step(false)?;
        limb |= step.input.limb.is_some();
        plans.extend(step.output.plan);
        if step.output.finished {
            return Ok((plans, trial.testbed().digest(), limb));
        }
    }
}

#[test]
fn c_and_d_plan_for_the_joints_that_the_prosthesis_has() -> Outcome {
    for (level, driven) in [("above_elbow", FROM_ELBOW), ("below_elbow", WRIST)] {
        let (plans, digest, limb) = planned_trial(level)?;
        assert!(limb, "{level}: the person moves the limb");
        assert!(!plans.is_empty(), "{level}: the person asks for plans");
        for plan in &plans {
            assert_ne!(plan.status, PlanStatus::Invalid, "{level}: {}", plan.reason);
            let Some(first) = plan.trajectory.points.first() else { continue };
            for point in &plan.trajectory.points {
                assert_eq!(
                    point.q[..driven.start],
                    first.q[..driven.start],
                    "{level}: the limb is not moved"
                );
            }
        }
        assert_eq!(planned_trial(level)?.1, digest, "{level}: the same trial again");
    }
    Ok(())
}

#[test]
fn a_persons_tracked_limb_is_followed_while_the_method_turns_the_wrist() -> Outcome {
    let mut trial = live("A", &["profile.level=below_elbow"])?;
    let start = trial.testbed().plant().state().position.clone();
    let mut limb = start[..7].to_vec();
    limb[3] += 0.3;
    trial.person_stage_mut().track_limb(&limb)?;
    // At the start the wrist stands at the limit to which WE turns it.
    make(&mut trial, Command::WristFlexion, None, 1500)?;
    let moved: Vec<f64> =
        trial.testbed().plant().state().position.iter().zip(&start).map(|(q, s)| q - s).collect();
    assert!((moved[3] - 0.3).abs() < 0.02, "the elbow follows: {moved:?}");
    assert!(moved[4].abs() > 0.3, "the method turns the wrist: {moved:?}");
    assert!(moved[..3].iter().all(|q| q.abs() < 0.02), "{moved:?}");
    for wrong in [vec![0.0; 3], vec![f64::NAN; 7]] {
        let error = trial.person_stage_mut().track_limb(&wrong).expect_err("no limb").to_string();
        assert!(error.contains("expected 7 finite angles"), "{error}");
    }
    Ok(())
}

#[test]
fn the_limiter_and_its_acceleration_are_options() -> Outcome {
    let speed_after_100_ms = |values: &[&str]| -> Outcome<f64> {
        let mut trial = live("A", values)?;
        make(&mut trial, Command::WristExtension, None, 100)?;
        Ok(trial.testbed().plant().state().velocity[0].abs())
    };
    let gentle = speed_after_100_ms(&["profile.limiter.acceleration_rad_per_s2=0.5"])?;
    let none = speed_after_100_ms(&["profile.limiter="])?;
    // Keys begin with the slow step: 0.4 of 0.4 rad/s.
    assert!(gentle < 0.07 && none > 0.15, "{gentle} and {none} rad/s");
    Ok(())
}

#[test]
fn the_dead_man_and_its_times_are_options() -> Outcome {
    let refusal = |values: &[&str]| -> Outcome<bool> {
        let mut trial = live("D", values)?;
        let red = block(&trial, ObjectId(0));
        make(&mut trial, Command::NoMotion, Some(red), 100)?;
        let frame = make(&mut trial, Command::WristExtension, None, 450)?;
        Ok(
            matches!(frame.planner, PlannerView::Failed { reason, .. } if reason.contains("eye tracker is silent")),
        )
    };
    assert!(refusal(&["profile.dead_man.gaze_timeout_ms=200"])?);
    assert!(!refusal(&["profile.dead_man="])?);
    Ok(())
}

#[test]
fn an_assistant_that_shares_the_speeds_is_an_option_of_methods_a_and_b() -> Outcome {
    let aside = |values: &[&str]| -> Outcome<f64> {
        let mut trial = live("B", values)?;
        let position = trial.testbed().plant().state().objects[0].pose.translation.vector;
        let before = make(&mut trial, Command::NoMotion, Some(position), 50)?;
        let after = make(&mut trial, Command::WristExtension, Some(position), 1000)?;
        let tip = |frame: &DisplayFrame| frame.world_from_tip.translation.vector;
        // WE moves along x; to the block it also goes down.
        Ok(tip(&before).z - tip(&after).z)
    };
    let (alone, helped) = (aside(&[])?, aside(&["profile.blend.assistance_share=0.5"])?);
    assert!(alone.abs() < 0.01 && helped > 0.015, "{alone} m alone, {helped} m with the assistant");
    let error = live("D", &["profile.blend.assistance_share=0.5"]).err().ok_or("D plans")?.to_string();
    assert!(error.contains("profile.blend"), "{error}");
    let error = config("B", &["profile.blend.assistance_share=1.5"]).expect_err("over one").to_string();
    assert!(error.contains("blend.assistance_share"), "{error}");
    Ok(())
}

/// Looks for a second at the first red block, then for `ms` at a point on the way to the other red one.
fn highlight_after(values: &[&str], share: f64, ms: u64) -> Outcome<Option<ObjectId>> {
    let mut trial = live("D", values)?;
    let (first, second) = (block(&trial, ObjectId(0)), block(&trial, ObjectId(1)));
    let frame = make(&mut trial, Command::NoMotion, Some(first), 1000)?;
    assert_eq!(frame.target.object, Some(ObjectId(0)));
    let point = first + (second - first) * share;
    Ok(make(&mut trial, Command::NoMotion, Some(point), ms)?.target.object)
}

#[test]
fn the_filtered_model_is_an_option_and_does_not_follow_a_glance() -> Outcome {
    assert_eq!(highlight_after(&[], 1.0, 60)?, Some(ObjectId(1)));
    assert_eq!(highlight_after(&["intent_model=filtered"], 1.0, 60)?, Some(ObjectId(0)));
    assert_eq!(highlight_after(&["intent_model=filtered"], 1.0, 1500)?, Some(ObjectId(1)));
    Ok(())
}

#[test]
fn hysteresis_is_an_option_and_keeps_the_highlight_on_a_look_between_two_blocks() -> Outcome {
    assert_eq!(highlight_after(&[], 0.55, 200)?, Some(ObjectId(1)));
    assert_eq!(highlight_after(&["intent.highlight_hysteresis=20.0"], 0.55, 200)?, Some(ObjectId(0)));
    assert_eq!(highlight_after(&["intent.highlight_hysteresis=20.0"], 1.0, 200)?, Some(ObjectId(1)));
    Ok(())
}

#[test]
fn values_that_set_nothing_or_something_unknown_are_refused_with_what_was_given() -> Outcome {
    for (value, expected) in [
        ("limit_secs", "KEY=VALUE"),
        ("limit_secs.x=1", "KEY=VALUE"),
        ("colour=red", "colour"),
        ("limit_secs=-1.0", "limit_secs"),
        ("intent_model=guess", "guess"),
    ] {
        let error = config("A", &[value]).expect_err(value).to_string();
        assert!(error.contains(expected), "{value}: {error}");
    }
    // Which levels there are is the arm's to say.
    let error = live("A", &["profile.level=knee"]).err().ok_or("a level that no arm has")?.to_string();
    assert!(error.contains("knee") && error.contains("below_elbow"), "{error}");
    Ok(())
}
