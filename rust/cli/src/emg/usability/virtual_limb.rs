//! The tests of miniVIE: motions, and targets of a virtual limb.

use super::{EmgTestArgs, LiveRecognition, TestDisplay};
use proact_bridge::{CalibrationView, TacAxisState};
use proact_devices::random_stream;
use proact_emg::{MotionTest, MotionTestConfig, TacAxis, TacConfig, TacTarget, TacTest};
use proact_types::{Gesture, SimTime};
use rand::RngExt;
use serde_json::{Value, json};
use std::error::Error;

type TestOutcome = Result<(&'static str, Value, bool), Box<dyn Error>>;

/// A target must be reached within so many seconds and held for so many, as in miniVIE.
const TAC_LIMIT_SECS: f64 = 45.0;
const TAC_DWELL_SECS: f64 = 2.0;

/// The motion test.
pub(super) fn motion(args: &EmgTestArgs, live: &mut LiveRecognition, show: &mut TestDisplay) -> TestOutcome {
    let config = MotionTestConfig::for_gestures(&live.gestures, live.rest, args.motion_repetitions.into());
    let mut test = MotionTest::new(config)?;
    while !test.is_finished() {
        live.advance()?;
        let changed = test.step(live.now(), live.in_force);
        if changed {
            live.prompt(test.prompt());
        }
        if let Some(page) = &mut show.page {
            page.publish(changed, || motion_view(&test, live));
        }
        show.show_prompt(test.prompt());
        show.show_progress("motion", test.report().attempts.len() as u64, test.report().prompt_count as u64);
    }
    Ok(("motion", json!(test.report()), true))
}

/// Target achievement control: of each axis by itself, or of all `together`.
pub(super) fn tac(
    args: &EmgTestArgs,
    live: &mut LiveRecognition,
    show: &mut TestDisplay,
    together: bool,
) -> TestOutcome {
    let axes = TacAxis::for_gestures(&live.gestures);
    let name = if together { "tac3" } else { "tac1" };
    if axes.is_empty() || (together && axes.len() < 2) {
        return Err(format!(
            "{name} needs gestures that move a joint both ways, such as wrist_flexion and wrist_extension; the model has {}",
            live.gestures.iter().map(Gesture::as_str).collect::<Vec<_>>().join(", ")
        )
        .into());
    }
    let mut rng = random_stream(args.source.seed, name);
    let mut draw_target = |axis: usize| (axis, axes[axis].target(rng.random()));
    let targets: Vec<TacTarget> = (0..args.tac_repetitions)
        .flat_map(|_| match together {
            true => vec![(0..axes.len()).map(&mut draw_target).collect()],
            false => (0..axes.len()).map(|axis| vec![draw_target(axis)]).collect::<Vec<_>>(),
        })
        .collect();
    let (rest, limit_secs, dwell_secs) = (live.rest, TAC_LIMIT_SECS, TAC_DWELL_SECS);
    let mut test = TacTest::new(TacConfig { axes, targets, rest, limit_secs, dwell_secs })?;
    let mut person = SimulatedTacUser::default();
    live.prompt(None);
    while !test.is_finished() {
        let decided = live.advance()?;
        let over = test.step(live.now(), live.in_force);
        if over {
            person = SimulatedTacUser { extra_secs: person.extra_secs, ..SimulatedTacUser::default() };
            live.prompt(None);
        }
        if decided.is_some()
            && let Some(wanted) = person.next_gesture(&test, live)
        {
            live.prompt(Some(wanted));
        }
        if let Some(page) = &mut show.page {
            page.publish(over, || tac_view(&test, live));
        }
        let shown = test
            .axis_goals()
            .into_iter()
            .map(|(axis, is, goal)| format!("{} {is:.0} to {goal:.0}", axis.name));
        show.bar.set_message(shown.collect::<Vec<_>>().join(", "));
        show.show_progress(name, test.report().trials.len() as u64, test.report().target_count as u64);
    }
    live.prompt(None);
    Ok((name, json!(test.report()), true))
}

/// What the page shows of the motion test.
fn motion_view<'a>(test: &'a MotionTest, live: &LiveRecognition) -> CalibrationView<'a> {
    CalibrationView::Motion {
        prompt: test.prompt().unwrap_or(live.rest),
        relaxing: test.attempt().is_none(),
        in_force: live.in_force,
        correct_decisions: test.attempt().map_or(0, |attempt| attempt.correct),
        required_decisions: test.config().required_correct,
        remaining_secs: test.remaining_secs(),
        limit_secs: test.config().limit_secs,
        report: test.report(),
    }
}

/// What the page shows of target achievement control.
fn tac_view<'a>(test: &'a TacTest, live: &LiveRecognition) -> CalibrationView<'a> {
    let state = |(axis, position, target)| TacAxisState { axis, position, target };
    CalibrationView::Tac {
        axes: test.axis_goals().into_iter().map(state).collect(),
        phase: test.phase(),
        in_force: live.in_force,
        dwell_progress: test.dwell_progress(),
        remaining_secs: test.remaining_secs(),
        limit_secs: test.config().limit_secs,
        report: test.report(),
    }
}

/// A simulated person waits so long for the limb to stand still before the next movement, seconds.
const SETTLE_SECS: f64 = 0.8;

/// What a simulated person does at a target: one movement after the other, each as long as the way needs at the joint's speed, with a
/// pause between them to see where it ended. How long a gesture must be made for a way is learnt from movement to movement.
#[derive(Default)]
struct SimulatedTacUser {
    current_gesture: Option<Gesture>,
    /// Since when the hand has been meant to be relaxed.
    relaxed_since: Option<SimTime>,
    /// The movement under way, or just made.
    movement: Option<TacMovement>,
    /// A gesture is made for so much longer than the joint is to move, seconds.
    extra_secs: f64,
}

/// One movement of a simulated person.
#[derive(Clone, Copy)]
struct TacMovement {
    axis: usize,
    start_position: f64,
    planned_secs: f64,
    began: SimTime,
}

impl SimulatedTacUser {
    /// The gesture to make from now on, if it is another one.
    fn next_gesture(&mut self, test: &TacTest, live: &LiveRecognition) -> Option<Gesture> {
        let (task, now) = (test.axis_goals(), live.now());
        let secs = |since: SimTime| now.millis_since(since) as f64 / 1000.0;
        let wanted = match (self.current_gesture, self.relaxed_since, self.movement) {
            (Some(gesture), None, Some(reach))
                if secs(reach.began) < reach.planned_secs + self.extra_secs =>
            {
                gesture
            }
            (Some(_), Some(since), _) if secs(since) >= SETTLE_SECS && live.in_force == live.rest => {
                self.learn(&task);
                let next = task.iter().enumerate().find_map(|(number, (axis, is, goal))| {
                    let error = goal - is;
                    let (up, planned_secs) = (error > 0.0, error.abs() / axis.speed);
                    let reach = TacMovement { axis: number, start_position: *is, planned_secs, began: now };
                    (error.abs() > 0.8 * axis.tolerance)
                        .then_some((if up { axis.up } else { axis.down }, reach))
                });
                self.movement = next.map(|(_, reach)| reach);
                next.map_or(live.rest, |(gesture, _)| gesture)
            }
            _ => live.rest,
        };
        self.relaxed_since = (wanted == live.rest).then(|| self.relaxed_since.unwrap_or(now));
        (self.current_gesture.replace(wanted) != Some(wanted)).then_some(wanted)
    }

    /// Compares what a movement was to be with what it became.
    fn learn(&mut self, task: &[(&TacAxis, f64, f64)]) {
        let Some(reach) = self.movement.take() else { return };
        let Some((axis, is, _)) = task.get(reach.axis) else { return };
        let moved_secs = (is - reach.start_position).abs() / axis.speed;
        self.extra_secs = (self.extra_secs + 0.5 * (reach.planned_secs - moved_secs)).clamp(-0.2, 0.5);
    }
}

/// What the reports of these tests say.
pub(super) fn report_text(result: &Value) -> String {
    let mut out = String::new();
    let secs = |value: &Value| value.as_f64().map_or("no".to_owned(), |secs| format!("{secs:.2}"));
    let percent = |report: &Value| 100.0 * report["completion_rate"].as_f64().unwrap_or(0.0);
    if let Some(report) = result.get("motion") {
        out += &format!(
            "motion test: {:.0} % of {} motions completed, {} s to select one, {} s to complete it\n",
            percent(report),
            report["asked"],
            secs(&report["mean_selection_secs"]),
            secs(&report["mean_completion_secs"])
        );
    }
    for name in ["tac1", "tac3"] {
        if let Some(report) = result.get(name) {
            out += &format!(
                "{name}: {:.0} % of {} targets reached, in {} s (dwell not counted)\n",
                percent(report),
                report["asked"],
                secs(&report["mean_secs"])
            );
        }
    }
    out
}
