use crate::EmgError;
use crate::fitts::millis_rounded_up;
use crate::usability::check_positive;
use proact_types::{Gesture, SimTime, TargetDwell};
use serde::{Deserialize, Serialize};

/// A target is at least this share of its range away, as in miniVIE.
const MIN_TARGET_DISTANCE_SHARE: f64 = 0.25;

/// A joint of the virtual hand, or its grasp, that two gestures move.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(deny_unknown_fields)]
pub struct TacAxis {
    /// Such as `wrist flexion`.
    pub name: String,
    /// The gesture that moves it up.
    pub up: Gesture,
    /// The gesture that moves it down.
    pub down: Gesture,
    /// Its range, degrees, or per cent of a grasp.
    pub range: [f64; 2],
    /// How near to the target it must be, in the same unit.
    pub tolerance: f64,
    /// In the same unit each second.
    pub speed: f64,
}

impl TacAxis {
    /// Those whose two gestures are among `gestures`, with miniVIE's ranges, tolerances (5 degrees, 5 % of a grasp) and speeds (1.4 rad/s, 1.2
    /// grasps a second), at most three.
    pub fn for_gestures(gestures: &[Gesture]) -> Vec<TacAxis> {
        // Our names, then miniVIE's.
        let turn = 1.4_f64.to_degrees();
        type Known<'a> = (&'a str, &'a [&'a str], &'a [&'a str], [f64; 2], f64);
        let known: [Known<'_>; 4] = [
            (
                "wrist flexion",
                &["wrist_flexion", "Wrist Flex In"],
                &["wrist_extension", "Wrist Extend Out"],
                [-60.0, 60.0],
                turn,
            ),
            (
                "grasp",
                &["hand_close", "Power Grasp", "Spherical Grasp"],
                &["hand_open", "Hand Open"],
                [0.0, 100.0],
                120.0,
            ),
            (
                "wrist rotation",
                &["pronation", "Wrist Rotate In"],
                &["supination", "Wrist Rotate Out"],
                [-85.0, 85.0],
                turn,
            ),
            (
                "elbow flexion",
                &["elbow_flexion", "Elbow Flexion"],
                &["elbow_extension", "Elbow Extension"],
                [0.0, 130.0],
                turn,
            ),
        ];
        let find = |names: &[&str]| {
            names.iter().find_map(|name| gestures.iter().copied().find(|gesture| gesture.as_str() == *name))
        };
        let axis = |(name, up, down, range, speed): (&str, &[&str], &[&str], [f64; 2], f64)| {
            let (up, down) = find(up).zip(find(down))?;
            Some(TacAxis { name: name.to_owned(), up, down, range, tolerance: 5.0, speed })
        };
        known.into_iter().filter_map(axis).take(3).collect()
    }

    /// Where it stands at the start of a trial: the middle of a joint's range, an open hand.
    pub fn start(&self) -> f64 {
        0.0_f64.clamp(self.range[0], self.range[1])
    }

    /// A target: `share`, 0 to 1, of the places that are far enough from the start, and further from the limits than the tolerance.
    pub fn target(&self, share: f64) -> f64 {
        let [low, high] = self.range;
        let (start, gap) = (self.start(), MIN_TARGET_DISTANCE_SHARE * (high - low));
        let (first, last) = (low + self.tolerance, high - self.tolerance);
        // Below the start, and above it.
        let below = (start - gap - first).max(0.0);
        let above = (last - start - gap).max(0.0);
        let offset = share * (below + above);
        if offset < below { first + offset } else { start + gap + offset - below }
    }

    fn check(&self) -> Result<(), EmgError> {
        let wrong = |name, value, expected| Err(EmgError::OutOfRange { name, value, expected });
        check_positive("tolerance", self.tolerance)?;
        check_positive("speed", self.speed)?;
        let width = self.range[1] - self.range[0];
        if !(width.is_finite() && width > 4.0 * self.tolerance) {
            return wrong("range", width, "wider than four tolerances");
        }
        Ok(())
    }
}

/// One target: which axes, and where each has to go.
pub type TacTarget = Vec<(usize, f64)>;

/// How the target achievement control test is done.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TacConfig {
    /// What can be moved.
    pub axes: Vec<TacAxis>,
    /// The targets, one after the other; axes that a target does not name stand still.
    pub targets: Vec<TacTarget>,
    /// The gesture of a relaxed hand, with which each trial begins.
    pub rest: Gesture,
    /// A target must be reached within so many seconds. 45 in miniVIE.
    pub limit_secs: f64,
    /// And held for so many. 2 in miniVIE.
    pub dwell_secs: f64,
}

/// One target, when it is over.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct TacTrial {
    /// What was asked for, by the axes' names.
    pub target: Vec<(String, f64)>,
    /// From the first gesture to the target, seconds, the time in it at the end not counted; none if it was not reached.
    #[serde(rename = "secs")]
    pub completion_secs: Option<f64>,
    /// How often the target was left again.
    pub overshoots: usize,
    /// Shortest over travelled way, both as sums of shares of the ranges; none if nothing moved.
    pub path_efficiency: Option<f64>,
}

/// How the test went.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct TacReport {
    /// All targets up to now.
    pub trials: Vec<TacTrial>,
    /// Targets of the whole test.
    #[serde(rename = "asked")]
    pub target_count: usize,
    /// Share of the targets up to now that were reached.
    pub completion_rate: f64,
    /// Mean over those that were reached, seconds; none before one was.
    #[serde(rename = "mean_secs")]
    pub mean_completion_secs: Option<f64>,
}

/// What a trial waits for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(rename_all = "snake_case")]
pub enum TacPhase {
    /// The hand has yet to relax.
    Relaxing,
    /// For the first gesture: time does not run yet.
    Ready,
    /// For the target to be reached and held.
    Moving,
}

/// The target achievement control test (A. M. Simon et al., J. Rehabil. Res. Dev. 48(6), 2011, 619-628) with miniVIE's rules: a virtual
/// joint, or several, is brought into a target posture and held there. Gestures move at one speed.
#[derive(Clone, Debug)]
pub struct TacTest {
    config: TacConfig,
    report: TacReport,
    position: Vec<f64>,
    /// Of the step before.
    last_step_at: Option<SimTime>,
    /// The hand has been relaxed since the target came.
    relaxed: bool,
    /// The first gesture.
    started_at: Option<SimTime>,
    dwell: TargetDwell,
    path_length: f64,
}

impl TacTest {
    /// A test before its first target.
    ///
    /// # Errors
    /// No targets, one without axes or beyond them, an axis of no width, times that are not above zero.
    pub fn new(config: TacConfig) -> Result<TacTest, EmgError> {
        let wrong = |name, value, expected| Err(EmgError::OutOfRange { name, value, expected });
        config.axes.iter().try_for_each(TacAxis::check)?;
        if config.targets.is_empty() {
            return wrong("targets", 0.0, "at least 1");
        }
        for (axis, value) in config.targets.iter().flatten() {
            let Some(known) = config.axes.get(*axis) else {
                return wrong("axis of a target", *axis as f64, "one of the axes, from 0");
            };
            if !(known.range[0]..=known.range[1]).contains(value) {
                return wrong("target", *value, "within the range of its axis");
            }
        }
        if config.targets.iter().any(Vec::is_empty) {
            return wrong("axes of a target", 0.0, "at least 1");
        }
        check_positive("limit_secs", config.limit_secs)?;
        check_positive("dwell_secs", config.dwell_secs)?;
        let report = TacReport { target_count: config.targets.len(), ..TacReport::default() };
        let position = config.axes.iter().map(TacAxis::start).collect();
        Ok(TacTest {
            config,
            report,
            position,
            last_step_at: None,
            relaxed: false,
            started_at: None,
            dwell: TargetDwell::default(),
            path_length: 0.0,
        })
    }

    /// Takes the gesture that is in force at `now`. True if a target is over.
    pub fn step(&mut self, now: SimTime, in_force: Gesture) -> bool {
        let secs = |since: SimTime| now.millis_since(since) as f64 / 1000.0;
        let passed = self.last_step_at.replace(now).map_or(0.0, secs);
        let Some(target) = self.config.targets.get(self.report.trials.len()) else { return false };
        self.relaxed |= in_force == self.config.rest;
        if !self.relaxed {
            return false;
        }
        if in_force != self.config.rest {
            self.started_at.get_or_insert(now);
        }
        let Some(started_at) = self.started_at else { return false };
        for (axis, _) in target {
            let known = &self.config.axes[*axis];
            let displacement = match in_force {
                gesture if gesture == known.up => known.speed * passed,
                gesture if gesture == known.down => -known.speed * passed,
                _ => continue,
            };
            let axis_position = &mut self.position[*axis];
            let goal = (*axis_position + displacement).clamp(known.range[0], known.range[1]);
            self.path_length += (goal - *axis_position).abs() / (known.range[1] - known.range[0]);
            *axis_position = goal;
        }
        let inside = target
            .iter()
            .all(|(axis, goal)| (self.position[*axis] - goal).abs() <= self.config.axes[*axis].tolerance);
        let reached = self.dwell.step(now, inside, millis_rounded_up(self.config.dwell_secs));
        let over = reached.is_some() || secs(started_at) >= self.config.limit_secs;
        if over {
            self.end(reached.map(|since| since.millis_since(started_at) as f64 / 1000.0));
        }
        over
    }

    fn end(&mut self, secs: Option<f64>) {
        let target = &self.config.targets[self.report.trials.len()];
        let named = |(axis, goal): &(usize, f64)| (self.config.axes[*axis].name.clone(), *goal);
        let shares = target.iter().map(|(axis, goal)| {
            let known = &self.config.axes[*axis];
            ((goal - known.start()).abs() - known.tolerance).max(0.0) / (known.range[1] - known.range[0])
        });
        let min_range: f64 = shares.sum();
        self.report.trials.push(TacTrial {
            target: target.iter().map(named).collect(),
            completion_secs: secs,
            overshoots: self.dwell.overshoots() as usize,
            path_efficiency: (self.path_length > 0.0).then(|| (min_range / self.path_length).min(1.0)),
        });
        let reached: Vec<f64> = self.report.trials.iter().filter_map(|trial| trial.completion_secs).collect();
        self.report.completion_rate = reached.len() as f64 / self.report.trials.len() as f64;
        self.report.mean_completion_secs =
            (!reached.is_empty()).then(|| reached.iter().sum::<f64>() / reached.len() as f64);
        self.position = self.config.axes.iter().map(TacAxis::start).collect();
        (self.relaxed, self.started_at) = (false, None);
        (self.dwell, self.path_length) = (TargetDwell::default(), 0.0);
    }

    /// What has to go where: each axis of the target, where it is and where it should be; nothing after the end.
    pub fn axis_goals(&self) -> Vec<(&TacAxis, f64, f64)> {
        let target = self.config.targets.get(self.report.trials.len());
        target
            .into_iter()
            .flatten()
            .map(|(axis, goal)| (&self.config.axes[*axis], self.position[*axis], *goal))
            .collect()
    }

    /// What the trial waits for.
    pub fn phase(&self) -> TacPhase {
        match (self.relaxed, self.started_at) {
            (false, _) => TacPhase::Relaxing,
            (true, None) => TacPhase::Ready,
            (true, Some(_)) => TacPhase::Moving,
        }
    }

    /// Seconds that are left for the target; the whole limit before the first gesture.
    pub fn remaining_secs(&self) -> f64 {
        (self.config.limit_secs - self.secs_since(self.started_at)).max(0.0)
    }

    /// Share of the dwell time that is over, 0 to 1.
    pub fn dwell_progress(&self) -> f64 {
        (self.secs_since(self.dwell.entered_at()) / self.config.dwell_secs).min(1.0)
    }

    fn secs_since(&self, start: Option<SimTime>) -> f64 {
        start.zip(self.last_step_at).map_or(0.0, |(start, now)| now.millis_since(start) as f64 / 1000.0)
    }

    /// How it is done.
    pub fn config(&self) -> &TacConfig {
        &self.config
    }

    /// All targets are over.
    pub fn is_finished(&self) -> bool {
        self.report.trials.len() == self.config.targets.len()
    }

    /// How it goes.
    pub fn report(&self) -> &TacReport {
        &self.report
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proact_types::Command;

    const REST: Command = Command::NoMotion;

    fn axes() -> Vec<TacAxis> {
        TacAxis::for_gestures(&Command::ALL.map(Gesture::from))
    }

    fn config(targets: Vec<TacTarget>) -> TacConfig {
        TacConfig { axes: axes(), targets, rest: REST.into(), limit_secs: 45.0, dwell_secs: 2.0 }
    }

    /// Steps every 10 ms until the test is over, with what `act` makes of what is to do and of the time since the target came, ms.
    fn run(config: TacConfig, act: impl Fn(&TacTest, u64) -> Gesture) -> TacReport {
        let mut test = TacTest::new(config).expect("as arranged");
        let mut since = 0;
        for tick in 0..100_000_u64 {
            if test.is_finished() {
                break;
            }
            let now = 10 * tick;
            let gesture = act(&test, now - since);
            if test.step(SimTime(now), gesture) {
                since = now;
            }
        }
        assert!(test.is_finished());
        test.report().clone()
    }

    /// Goes straight to the target, one axis after the other.
    fn straight(test: &TacTest, since: u64) -> Gesture {
        let off = |(axis, is, goal): &(&TacAxis, f64, f64)| {
            let error = goal - is;
            (error.abs() > 0.5 * axis.tolerance).then_some(if error > 0.0 { axis.up } else { axis.down })
        };
        if since < 300 { REST.into() } else { test.axis_goals().iter().find_map(off).unwrap_or(REST.into()) }
    }

    #[test]
    fn a_trial_says_what_it_waits_for_and_how_much_of_its_times_is_left() {
        let mut test = TacTest::new(config(vec![vec![(0, 40.0)]])).expect("as arranged");
        let (up, rest) = (test.config().axes[0].up, REST.into());
        assert_eq!(
            (test.phase(), test.remaining_secs(), test.dwell_progress()),
            (TacPhase::Relaxing, 45.0, 0.0)
        );
        test.step(SimTime(0), rest);
        test.step(SimTime(10_000), rest);
        assert_eq!((test.phase(), test.remaining_secs()), (TacPhase::Ready, 45.0), "time does not run yet");
        // 40 degrees at 80 degrees a second.
        for tick in 0..=50 {
            test.step(SimTime(10_010 + 10 * tick), up);
        }
        assert_eq!(test.phase(), TacPhase::Moving);
        assert!((test.remaining_secs() - 44.5).abs() < 1e-9, "{}", test.remaining_secs());
        let before = test.dwell_progress();
        test.step(SimTime(11_010), rest);
        assert!(
            (test.dwell_progress() - before - 0.25).abs() < 1e-9,
            "half a second of two: {}",
            test.dwell_progress()
        );
    }

    #[test]
    fn targets_are_far_enough_from_the_start_and_from_the_limits() {
        for axis in axes() {
            let [low, high] = axis.range;
            for k in 0..=100 {
                let target = axis.target(f64::from(k) / 100.0);
                assert!(
                    (target - axis.start()).abs() >= 0.25 * (high - low) - 1e-9,
                    "{}: {target}",
                    axis.name
                );
                assert!((low + 5.0 - 1e-9..=high - 5.0 + 1e-9).contains(&target), "{}: {target}", axis.name);
            }
            assert!(axis.target(0.0) < axis.target(0.9));
        }
        assert_eq!(axes().len(), 2, "a wrist and a grasp; no gesture rotates");
    }

    #[test]
    fn a_straight_way_takes_its_time_and_two_axes_take_both_of_theirs() {
        let report = run(config(vec![vec![(0, -40.0)], vec![(0, 40.0), (1, 60.0)]]), straight);
        assert_eq!((report.completion_rate, report.target_count), (1.0, 2));
        // To 5 degrees before 40 at 80.2 degrees a second.
        let first = report.trials[0].completion_secs.expect("as arranged");
        assert!((first - 35.0 / 1.4_f64.to_degrees()).abs() < 0.03, "{first} s");
        let second = report.trials[1].completion_secs.expect("as arranged");
        assert!((second - 37.5 / 1.4_f64.to_degrees() - 55.0 / 120.0).abs() < 0.06, "{second} s");
        for trial in &report.trials {
            assert_eq!(trial.overshoots, 0);
            assert!((0.85..=1.0).contains(&trial.path_efficiency.expect("as arranged")), "{trial:?}");
        }
    }

    #[test]
    fn a_target_that_is_left_counts_anew_and_one_that_is_never_reached_ends_after_its_time() {
        let overshooting = run(config(vec![vec![(0, 40.0)]]), |test, since| match since {
            0..100 => REST.into(),
            100..800 => Command::WristFlexion.into(),
            _ => straight(test, since),
        });
        let trial = &overshooting.trials[0];
        assert_eq!(trial.overshoots, 1);
        assert!(
            trial.completion_secs.expect("as arranged") > 0.7
                && trial.path_efficiency.expect("as arranged") < 0.8,
            "{trial:?}"
        );
        let failed = run(config(vec![vec![(0, 40.0)]]), |_, since| match since {
            0..100 => REST.into(),
            _ => Command::WristExtension.into(),
        });
        assert_eq!(
            (failed.trials[0].completion_secs, failed.completion_rate, failed.mean_completion_secs),
            (None, 0.0, None)
        );
    }

    #[test]
    fn a_gesture_that_is_made_before_the_hand_relaxed_moves_nothing() {
        let mut test = TacTest::new(config(vec![vec![(0, 40.0)]])).expect("as arranged");
        for tick in 0..100 {
            test.step(SimTime(10 * tick), Command::WristFlexion.into());
        }
        assert_eq!(test.axis_goals()[0].1, 0.0);
        test.step(SimTime(1000), REST.into());
        test.step(SimTime(1010), Command::WristFlexion.into());
        assert!(test.axis_goals()[0].1 > 0.5);
    }

    #[test]
    fn what_is_no_test_is_refused() {
        let refused = |config| TacTest::new(config).expect_err("must be refused").to_string();
        assert!(refused(config(vec![])).contains("targets"));
        assert!(refused(config(vec![vec![]])).contains("axes of a target"));
        assert!(refused(config(vec![vec![(2, 0.0)]])).contains("axis of a target"));
        assert!(refused(config(vec![vec![(0, 61.0)]])).contains("within the range"));
        assert!(
            refused(TacConfig { dwell_secs: 0.0, ..config(vec![vec![(0, 40.0)]]) }).contains("dwell_secs")
        );
        let mut narrow = config(vec![vec![(0, 40.0)]]);
        narrow.axes[0].tolerance = 40.0;
        assert!(refused(narrow).contains("four tolerances"));
    }
}
