use crate::EmgError;
use crate::usability::check_positive;
use proact_types::{Command, Gesture, SimTime, TargetDwell};
use serde::{Deserialize, Serialize};

/// How the cursor test is done. Lengths are in half heights of the field, whose corners are at -1 and 1.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CursorConfig {
    /// Targets on the ring, an odd number of at least 3. Default 9.
    pub targets: usize,
    /// Rings: diameter of the ring, and of its targets. Default: three difficulties, 1.4, 2.3 and 3.1 bits.
    pub rings: Vec<[f64; 2]>,
    /// Time in the target that completes a movement, seconds. Default 1.
    pub dwell_secs: f64,
    /// Time after which a movement is given up, seconds. Default 15.
    pub limit_secs: f64,
    /// Speed at full effort, per second. Default 0.5.
    #[serde(rename = "full_speed")]
    pub max_speed_per_s: f64,
    /// Least share of the full speed of a gesture that is in force. Default 0.2.
    #[serde(rename = "least_effort")]
    pub min_speed_share: f64,
    /// Speed goes with the effort; otherwise it is always the full one. Default true.
    pub proportional: bool,
    /// The gestures that move the cursor right, left, up and down. Default: wrist extension, wrist flexion, hand open, hand
    /// close.
    pub steering: [Gesture; 4],
}

impl Default for CursorConfig {
    fn default() -> Self {
        use Command::{HandClose, HandOpen, WristExtension, WristFlexion};
        CursorConfig {
            targets: 9,
            rings: vec![[0.8, 0.5], [1.2, 0.3], [1.5, 0.2]],
            dwell_secs: 1.0,
            limit_secs: 15.0,
            max_speed_per_s: 0.5,
            min_speed_share: 0.2,
            proportional: true,
            steering: [WristExtension, WristFlexion, HandOpen, HandClose].map(Gesture::from),
        }
    }
}

/// One movement to a target.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct CursorMovement {
    /// The cursor stayed in the target for the dwell time.
    pub completed: bool,
    /// Distance from the start to the target's centre.
    pub distance: f64,
    /// Diameter of the target.
    pub width: f64,
    /// Index of difficulty, `log2(distance / width + 1)`, bits.
    pub difficulty_bits: f64,
    /// From the moment the target is shown to the last time that the cursor entered it: reaction included, dwell not.
    /// The whole time if it was not completed.
    pub movement_secs: f64,
    /// Straight line over the way taken, to where the cursor came to rest, 0 to 1; 0 if it was not completed.
    pub path_efficiency: f64,
    /// Times that the cursor left the target before the dwell was over.
    pub overshoots: u32,
}

/// How the cursor test went.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct CursorReport {
    /// Movements that are over.
    pub movements: Vec<CursorMovement>,
    /// Share of them that were completed.
    pub completion_rate: f64,
    /// Mean of difficulty over movement time, completed movements, dwell not counted, bits per second.
    pub throughput_bits_per_s: f64,
    /// The same with the dwell counted into the time, as some programs report it.
    pub throughput_with_dwell_bits_per_s: f64,
    /// Mean over completed movements.
    pub path_efficiency: f64,
    /// Mean over all movements.
    pub overshoots: f64,
    /// Movements asked for.
    #[serde(rename = "asked")]
    pub target_count: usize,
}

/// What happened in a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CursorEvent {
    /// A new target is shown.
    TargetShown,
    /// A movement was completed or given up.
    MovementEnded(CursorMovement),
}

/// The multi-directional pointing test of ISO 9241-411: targets on a ring, one after the other across it, steered by
/// four gestures, one for each direction.
///
/// The cursor goes on from where the last movement ended; distances are measured from there. Known weakness: one
/// gesture at a time moves one axis, so the best path to a diagonal target has an efficiency of 0.71.
#[derive(Clone, Debug)]
pub struct CursorTest {
    config: CursorConfig,
    cursor: [f64; 2],
    /// Ring and number of the target in the order of prompts.
    target_index: (usize, usize),
    target_progress: Option<TargetProgress>,
    now: Option<SimTime>,
    report: CursorReport,
}

#[derive(Clone, Copy, Debug)]
struct TargetProgress {
    since: SimTime,
    start: [f64; 2],
    path: f64,
    dwell: TargetDwell,
}

/// Difference of two steps beyond which the cursor does not move further, seconds: a silent stream is not made up for.
const MAX_STEP_SECS: f64 = 0.1;

impl CursorTest {
    /// A test before its first target, the cursor in the middle.
    ///
    /// # Errors
    /// Settings that cannot work.
    pub fn new(config: CursorConfig) -> Result<CursorTest, EmgError> {
        let wrong = |name, value, expected| Err(EmgError::OutOfRange { name, value, expected });
        if config.targets < 3 || config.targets.is_multiple_of(2) || config.targets > 99 {
            return wrong("targets", config.targets as f64, "an odd number from 3 to 99");
        }
        if config.rings.is_empty() {
            return wrong("rings", 0.0, "at least 1");
        }
        for [ring, target] in &config.rings {
            check_positive("ring", *ring)?;
            check_positive("target", *target)?;
            if ring + target > 2.0 {
                return wrong("ring and target", ring + target, "together at most 2, the field");
            }
        }
        check_positive("dwell_secs", config.dwell_secs)?;
        check_positive("limit_secs", config.limit_secs)?;
        check_positive("full_speed", config.max_speed_per_s)?;
        if !(0.0..=1.0).contains(&config.min_speed_share) {
            return wrong("least_effort", config.min_speed_share, "0 to 1");
        }
        let target_count = config.targets * config.rings.len();
        let report = CursorReport { target_count, ..CursorReport::default() };
        Ok(CursorTest {
            config,
            cursor: [0.0; 2],
            target_index: (0, 0),
            target_progress: None,
            now: None,
            report,
        })
    }

    /// Advances to `now` with the gesture that has been in force since the last step, and its effort, 0 to 1. An
    /// effort that is no number counts as none.
    pub fn step(&mut self, now: SimTime, gesture: impl Into<Gesture>, effort: f64) -> Option<CursorEvent> {
        let gesture = gesture.into();
        if self.is_finished() {
            return None;
        }
        let millis = self.now.map_or(0, |before| now.millis_since(before));
        self.now = Some(now);
        let Some(mut shown) = self.target_progress else {
            self.show(now);
            return Some(CursorEvent::TargetShown);
        };
        let before = self.cursor;
        self.steer(gesture, effort, (millis as f64 / 1000.0).min(MAX_STEP_SECS));
        shown.path += distance(before, self.cursor);
        let (target, width) = self.target();
        let inside = distance(self.cursor, target) <= width / 2.0;
        let entered = shown.dwell.step(now, inside, millis_rounded_up(self.config.dwell_secs));
        self.target_progress = Some(shown);
        let secs = |since: SimTime| now.millis_since(since) as f64 / 1000.0;
        if entered.is_none() && secs(shown.since) < self.config.limit_secs {
            return None;
        }
        let distance_to_target = distance(shown.start, target);
        let movement = CursorMovement {
            completed: entered.is_some(),
            distance: distance_to_target,
            width,
            difficulty_bits: (distance_to_target / width + 1.0).log2(),
            movement_secs: entered
                .map_or(secs(shown.since), |at| at.millis_since(shown.since) as f64 / 1000.0),
            path_efficiency: match entered {
                Some(_) if shown.path > 0.0 => distance(shown.start, self.cursor) / shown.path,
                Some(_) => 1.0,
                None => 0.0,
            },
            overshoots: shown.dwell.overshoots(),
        };
        self.finish(movement);
        if !self.is_finished() {
            self.show(now);
        }
        Some(CursorEvent::MovementEnded(movement))
    }

    fn steer(&mut self, gesture: Gesture, effort: f64, secs: f64) {
        let Some(direction) = self.config.steering.iter().position(|steers| *steers == gesture) else {
            return;
        };
        let (axis, sign) = [(0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0)][direction];
        let share = if self.config.proportional {
            // The larger of NaN and a number is the number.
            effort.max(self.config.min_speed_share).min(1.0)
        } else {
            1.0
        };
        let moved = self.cursor[axis] + sign * share * self.config.max_speed_per_s * secs;
        self.cursor[axis] = moved.clamp(-1.0, 1.0);
    }

    fn show(&mut self, now: SimTime) {
        let inside = {
            let (target, width) = self.target();
            distance(self.cursor, target) <= width / 2.0
        };
        self.target_progress = Some(TargetProgress {
            since: now,
            start: self.cursor,
            path: 0.0,
            dwell: TargetDwell::begin(now, inside),
        });
    }

    fn finish(&mut self, movement: CursorMovement) {
        let (ring, number) = self.target_index;
        self.target_index = if number + 1 < self.config.targets { (ring, number + 1) } else { (ring + 1, 0) };
        let report = &mut self.report;
        report.movements.push(movement);
        let all = report.movements.len() as f64;
        let completed: Vec<&CursorMovement> = report.movements.iter().filter(|m| m.completed).collect();
        let mean = |value: &dyn Fn(&CursorMovement) -> f64| {
            completed.iter().map(|m| value(m)).sum::<f64>() / completed.len().max(1) as f64
        };
        let dwell = self.config.dwell_secs;
        // A target that the cursor was in already took no time and says nothing about speed: a millisecond bounds it.
        report.throughput_bits_per_s = mean(&|m| m.difficulty_bits / m.movement_secs.max(1e-3));
        report.throughput_with_dwell_bits_per_s = mean(&|m| m.difficulty_bits / (m.movement_secs + dwell));
        report.path_efficiency = mean(&|m| m.path_efficiency);
        report.completion_rate = completed.len() as f64 / all;
        report.overshoots = report.movements.iter().map(|m| f64::from(m.overshoots)).sum::<f64>() / all;
    }

    /// Where the cursor is.
    pub fn cursor(&self) -> [f64; 2] {
        self.cursor
    }

    /// Centre and diameter of the target; the last one after the end.
    pub fn target(&self) -> ([f64; 2], f64) {
        let (ring, number) = if self.is_finished() {
            (self.config.rings.len() - 1, self.config.targets - 1)
        } else {
            self.target_index
        };
        let [diameter, width] = self.config.rings[ring];
        // Each next one lies across the ring.
        let index = number * (self.config.targets / 2) % self.config.targets;
        let angle = std::f64::consts::TAU * index as f64 / self.config.targets as f64;
        ([0.5 * diameter * angle.cos(), 0.5 * diameter * angle.sin()], width)
    }

    /// Share of the dwell time that the cursor has been in the target, 0 to 1.
    pub fn dwell_progress(&self) -> f64 {
        let since = self.target_progress.and_then(|s| s.dwell.entered_at());
        match (since, self.now) {
            (Some(since), Some(now)) if !self.is_finished() => {
                (now.millis_since(since) as f64 / 1000.0 / self.config.dwell_secs).min(1.0)
            }
            _ => 0.0,
        }
    }

    /// All movements are over.
    pub fn is_finished(&self) -> bool {
        self.report.movements.len() == self.report.target_count
    }

    /// How it goes.
    pub fn report(&self) -> &CursorReport {
        &self.report
    }

    /// The settings.
    pub fn config(&self) -> &CursorConfig {
        &self.config
    }
}

/// Whole milliseconds that are not less; what a product adds to a whole number is rounding.
pub(crate) fn millis_rounded_up(secs: f64) -> u64 {
    (1000.0 * secs - 1e-6).ceil() as u64
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

#[cfg(test)]
mod tests {
    use super::*;
    use Command::{HandClose, HandOpen, NoMotion, WristExtension, WristFlexion};

    fn one_ring(ring: f64, width: f64) -> CursorConfig {
        CursorConfig {
            targets: 3,
            rings: vec![[ring, width]],
            proportional: false,
            ..CursorConfig::default()
        }
    }

    /// What a perfect person does: first along x, then along y.
    fn towards(test: &CursorTest) -> Command {
        let ([x, y], [tx, ty]) = (test.cursor(), test.target().0);
        match (tx - x, ty - y) {
            (dx, _) if dx > 0.01 => WristExtension,
            (dx, _) if dx < -0.01 => WristFlexion,
            (_, dy) if dy > 0.01 => HandOpen,
            (_, dy) if dy < -0.01 => HandClose,
            _ => NoMotion,
        }
    }

    fn run(test: &mut CursorTest, act: impl Fn(&CursorTest, u64) -> Command) {
        for k in 0..100_000_u64 {
            if test.is_finished() {
                return;
            }
            let gesture = act(test, 10 * k);
            test.step(SimTime(10 * k), gesture, 1.0);
        }
    }

    #[test]
    fn a_straight_movement_has_the_throughput_of_the_formula() {
        let mut test = CursorTest::new(one_ring(1.6, 0.2)).expect("good");
        run(&mut test, |test, _| towards(test));
        let report = test.report();
        assert_eq!((report.completion_rate, report.overshoots), (1.0, 0.0));
        // The first target lies 0.8 to the right of the middle; its edge is reached after 0.7 at 0.5 per second.
        let first = report.movements[0];
        assert!(
            (first.distance - 0.8).abs() < 1e-12 && (first.difficulty_bits - 5.0_f64.log2()).abs() < 1e-12
        );
        assert!((first.movement_secs - 1.4).abs() < 0.03, "{first:?}");
        assert!((first.path_efficiency - 1.0).abs() < 1e-9);
        // The second lies across, up to the left: two axes one after the other.
        let second = report.movements[1];
        assert!((0.7..0.9).contains(&second.path_efficiency), "{second:?}");
        let expected =
            report.movements.iter().map(|m| m.difficulty_bits / m.movement_secs).sum::<f64>() / 3.0;
        assert!((report.throughput_bits_per_s - expected).abs() < 1e-12);
        assert!(report.throughput_with_dwell_bits_per_s < report.throughput_bits_per_s);
    }

    #[test]
    fn leaving_the_target_before_the_dwell_is_an_overshoot_and_the_clock_goes_on() {
        let mut test = CursorTest::new(one_ring(1.6, 0.2)).expect("good");
        // Straight through the first target, and back from the rim of the field.
        run(&mut test, |test, _| match test.report().movements.len() {
            0 if test.target_progress.is_some_and(|s| s.dwell.overshoots() == 0) => WristExtension,
            _ => towards(test),
        });
        let first = test.report().movements[0];
        assert_eq!((first.completed, first.overshoots), (true, 1));
        assert!(first.path_efficiency < 0.95 && first.movement_secs > 1.8, "{first:?}");
    }

    #[test]
    fn movements_that_take_too_long_are_given_up_and_count_against_completion() {
        let mut test = CursorTest::new(one_ring(1.6, 0.2)).expect("good");
        run(&mut test, |_, _| NoMotion);
        let report = test.report();
        assert_eq!((report.completion_rate, report.throughput_bits_per_s), (0.0, 0.0));
        assert!(report.movements.iter().all(|m| !m.completed && m.movement_secs >= 15.0));
    }

    #[test]
    fn the_speed_goes_with_the_effort_and_no_number_is_the_least() {
        let speed = |effort: f64, proportional: bool| {
            let config = CursorConfig { proportional, ..CursorConfig::default() };
            let mut test = CursorTest::new(config).expect("good");
            for k in 0..11 {
                test.step(SimTime(10 * k), WristFlexion, effort);
            }
            -test.cursor()[0] / 0.1
        };
        let near = |a: f64, b: f64| (a - b).abs() < 1e-9;
        assert!(near(speed(1.0, true), 0.5) && near(speed(0.5, true), 0.25));
        assert!(
            near(speed(0.0, true), 0.1) && near(speed(f64::NAN, true), 0.1) && near(speed(9.0, true), 0.5)
        );
        assert!(near(speed(0.1, false), 0.5));
    }

    #[test]
    fn settings_that_cannot_work_are_refused() {
        let refused =
            |config: CursorConfig| CursorTest::new(config).map(|_| ()).expect_err("refused").to_string();
        assert!(refused(CursorConfig { targets: 8, ..CursorConfig::default() }).contains("odd"));
        assert!(refused(one_ring(1.9, 0.2)).contains("at most 2"));
        assert!(refused(one_ring(f64::NAN, 0.2)).contains("NaN"));
        assert!(refused(CursorConfig { dwell_secs: 0.0, ..CursorConfig::default() }).contains("dwell_secs"));
    }
}
