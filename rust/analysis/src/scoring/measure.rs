//! The columns: one function each, with its name, unit, definition and source.

use super::{
    ActionPhase, FaultKind, FixationTarget, ObjectTransfer, PhaseKind, ScoredTrial, TrialFault, emg, gaze,
    joints, motion::PathMetrics, shoulder,
};
use crate::table::TableColumn;
use proact_types::SimTime;

/// A column of a table of scores, and how it is found.
pub struct Measure<T: 'static> {
    /// Its name, unit, definition and source.
    pub column: TableColumn,
    /// Its value for a row; none where the record cannot say.
    pub compute: fn(&ScoredTrial<'_>, &T) -> Option<f64>,
}

const PAPER: &str = "ProACT paper, Transfer timings and accuracy";
const PAPER_BODY: &str = "ProACT paper, Compensatory movement";
const GAMA: &str = "Valevicius et al. 2018, PLoS ONE e0199549";
const LAVOIE: &str = "Lavoie et al. 2018, J Vis 18(6):18";
const OURS: &str = "ProACT, docs/analysis.md";

macro_rules! measure {
    ($name:literal, $unit:literal, $meaning:literal, $source:expr, $of:expr) => {
        measure!($name formerly "", $unit, $meaning, $source, $of)
    };
    ($name:literal formerly $old:literal, $unit:literal, $meaning:literal, $source:expr, $of:expr) => {
        Measure {
            column: TableColumn { name: $name, unit: $unit, meaning: $meaning, source: $source, formerly: $old },
            compute: $of,
        }
    };
}

/// Millimetres in a metre.
const MM_PER_M: f64 = 1e3;

fn bool_to_f64(yes: bool) -> f64 {
    f64::from(u8::from(yes))
}

/// The way of the hand through a phase.
fn hand_path_metrics(scored: &ScoredTrial<'_>, phase: &ActionPhase) -> Option<PathMetrics> {
    PathMetrics::of(scored.trace.between(phase.from, phase.to), |instant| instant.grasp_center)
}

/// The widest aperture of a phase, metres, and when the hand was first as wide but for a millimetre, as a share of it.
fn peak_aperture(scored: &ScoredTrial<'_>, phase: &ActionPhase) -> Option<(f64, f64)> {
    let within = scored.trace.between(phase.from, phase.to);
    let wide = || within.iter().filter_map(|instant| Some((instant.time, instant.aperture_m?)));
    let widest = wide().map(|(_, aperture)| aperture).reduce(f64::max)?;
    let (at, _) = wide().find(|(_, aperture)| widest - aperture < 1.0 / MM_PER_M)?;
    let length = phase.to.millis_since(phase.from);
    (length > 0).then(|| (widest, at.millis_since(phase.from) as f64 / length as f64))
}

macro_rules! joint {
    ($name:literal, $place:literal) => {
        measure!($name, "rad", "way of this joint of the arm, counted from the base; steps under 0.002 rad add up before they count", OURS, |s, p| {
            joints::joint_path_rad(s.trace, p.from, p.to, $place)
        })
    };
}

/// Of a pick or a place.
pub const PHASE_MEASURES: &[Measure<ActionPhase>] = &[
    measure!("seconds", "s", "length of the phase", PAPER, |_, p| Some(p.secs())),
    measure!(
        "with_method",
        "",
        "1 if a joint of the arm went further than 0.05 rad from where it was first: the person used the method, 0 if only the body moved",
        PAPER,
        |s, p| { joints::is_method_used(s.trace, p.from, p.to).map(bool_to_f64) }
    ),
    measure!(
        "shoulder_sum10_m",
        "m",
        "sum of the shoulder's steps at 10 Hz; depends on the step",
        PAPER_BODY,
        |s, p| { shoulder::translation_sum10(s.trace, p.from, p.to) }
    ),
    measure!(
        "shoulder_turn_sum10_deg",
        "degree",
        "sum of the shoulder's turns at 10 Hz; depends on the step",
        PAPER_BODY,
        |s, p| { shoulder::rotation_sum10(s.trace, p.from, p.to) }
    ),
    measure!("shoulder_path_m", "m", "length of the shoulder's way, low-passed at 6 Hz", OURS, |s, p| {
        shoulder::path(s.trace, p.from, p.to)
    }),
    measure!(
        "shoulder_displacement_mm" formerly "shoulder_range_mm",
        "mm",
        "furthest of the shoulder from where it was first, low-passed at 6 Hz",
        "Major et al. 2014, JNER 11:132",
        |s, p| { shoulder::max_displacement_m(s.trace, p.from, p.to).map(|range| range * MM_PER_M) }
    ),
    measure!(
        "shoulder_turn_deg",
        "degree",
        "furthest turn of the shoulder from how it was first",
        "Major et al. 2014, JNER 11:132",
        |s, p| { shoulder::max_turn_deg(s.trace, p.from, p.to) }
    ),
    measure!(
        "trunk_displacement_mm" formerly "trunk_range_mm",
        "mm",
        "furthest of the trunk's body from where it was first; empty if it was not tracked",
        OURS,
        |s, p| { shoulder::max_trunk_displacement_m(s.trace, p.from, p.to).map(|range| range * MM_PER_M) }
    ),
    measure!(
        "trunk_turn_deg",
        "degree",
        "furthest turn of the trunk from how it was first; empty if it was not tracked",
        OURS,
        |s, p| { shoulder::max_trunk_turn_deg(s.trace, p.from, p.to) }
    ),
    measure!(
        "base_share",
        "1",
        "share of the hand's straight way that the shoulder brought it; the rest is the joints'. Below 0 or above 1 where they worked against each other",
        OURS,
        |s, p| { shoulder::base_contribution(s.trace, p.from, p.to) }
    ),
    measure!("hand_path_m", "m", "length of the hand's way, low-passed at 6 Hz", GAMA, |s, p| {
        hand_path_metrics(s, p).map(|metrics| metrics.length())
    }),
    measure!(
        "path_efficiency",
        "1",
        "straight way of the hand over the way that it went, 0 to 1",
        "LibEMG; BioPatRec",
        |s, p| {
            let metrics = hand_path_metrics(s, p)?;
            (metrics.length() > 0.0).then(|| metrics.end_to_end_distance_m() / metrics.length())
        }
    ),
    measure!("peak_speed_m_per_s", "m/s", "highest speed of the hand, low-passed at 6 Hz", GAMA, |s, p| {
        hand_path_metrics(s, p)?.peak_speed_and_time().map(|peak| peak[0])
    }),
    measure!("peak_time", "1", "when it was, as a share of the phase, 0 to 1", GAMA, |s, p| {
        hand_path_metrics(s, p)?.peak_speed_and_time().map(|peak| peak[1])
    }),
    measure!(
        "peak_deceleration_time",
        "1",
        "when the hand's speed fell fastest, as a share of the phase, 0 to 1",
        GAMA,
        |s, p| hand_path_metrics(s, p)?.peak_deceleration_time()
    ),
    measure!(
        "peak_aperture_mm",
        "mm",
        "widest distance between the last joints of thumb and index finger in the phase; of hands that have both",
        GAMA,
        |s, p| peak_aperture(s, p).map(|(widest, _)| widest * MM_PER_M)
    ),
    measure!(
        "peak_aperture_time",
        "1",
        "when it was first within 1 mm of that, as a share of the phase, 0 to 1",
        GAMA,
        |s, p| peak_aperture(s, p).map(|(_, share)| share)
    ),
    measure!(
        "movement_units",
        "",
        "humps of the hand's speed that rise and fall by 0.02 m/s at least",
        GAMA,
        |s, p| hand_path_metrics(s, p).map(|metrics| metrics.movement_unit_count() as f64)
    ),
    joint!("joint1_rad", 0),
    joint!("joint2_rad", 1),
    joint!("joint3_rad", 2),
    joint!("joint4_rad", 3),
    joint!("joint5_rad", 4),
    joint!("joint6_rad", 5),
    joint!("joint7_rad", 6),
    measure!(
        "gaze_object",
        "1",
        "share of the time with a known gaze on the object, in the hand or not; looks of at least 80 ms within 2 degrees, as in all shares",
        LAVOIE,
        |s, p| { gaze::dwell_fraction(s, p, |at| at == FixationTarget::Object(p.object)) }
    ),
    measure!("gaze_other_objects", "1", "share on other objects", LAVOIE, |s, p| {
        gaze::dwell_fraction(s, p, |at| matches!(at, FixationTarget::Object(object) if object != p.object))
    }),
    measure!("gaze_target", "1", "share on the object's target", LAVOIE, |s, p| {
        gaze::dwell_fraction(s, p, |at| at == FixationTarget::Target(p.object))
    }),
    measure!(
        "gaze_hand",
        "1",
        "share on the prosthetic hand; while it holds the object, the object counts",
        LAVOIE,
        |s, p| { gaze::dwell_fraction(s, p, |at| at == FixationTarget::Hand) }
    ),
    measure!(
        "gaze_arm",
        "1",
        "share on the arm, where the original draws the mode too",
        "ProACT paper, Gaze",
        |s, p| { gaze::dwell_fraction(s, p, |at| at == FixationTarget::Arm) }
    ),
    measure!(
        "gaze_elsewhere",
        "1",
        "share on none of these, in looks of at least 80 ms; the rest were shorter",
        OURS,
        |s, p| {
            gaze::dwell_fraction(s, p, |at| {
                matches!(at, FixationTarget::Elsewhere)
                    || matches!(at, FixationTarget::Target(object) if object != p.object)
            })
        }
    ),
    measure!(
        "eye_arrival_ms",
        "ms",
        "how long before the hand the eye was first at what the hand went to: the object of a pick, the target of a place",
        LAVOIE,
        gaze::eye_arrival_latency_ms
    ),
    measure!(
        "eye_leaving_ms",
        "ms",
        "how long after the hand the eye left that; negative where the eye left first",
        LAVOIE,
        gaze::eye_leaving_latency_ms
    ),
    measure!(
        "eye_switches",
        "",
        "how often the eye went between hand and what the hand went to",
        "JNER 2023, 20:49",
        |s, p| { gaze::switches(s, p).map(|count| count as f64) }
    ),
    measure!(
        "peak_acceleration_m_per_s2",
        "m/s^2",
        "strongest acceleration of the hand, low-passed at 6 Hz",
        OURS,
        |s, p| hand_path_metrics(s, p)?.peak_acceleration_m_per_s2()
    ),
    measure!(
        "shoulder_peak_speed_m_per_s",
        "m/s",
        "highest speed of the shoulder, low-passed at 6 Hz",
        OURS,
        |s, p| { shoulder::peak_speed(s.trace, p.from, p.to) }
    ),
    measure!(
        "joint_speed_share",
        "1",
        "highest speed of a joint of the arm from one instant to the next, as a share of the limit in the arm's description",
        OURS,
        |s, p| { joints::max_speed_ratio(s.trace, p.from, p.to) }
    ),
    measure!(
        "joint_beyond_rad",
        "rad",
        "how far a joint of the arm was outside the limits of the arm's description at most",
        OURS,
        |s, p| { joints::max_limit_excess_rad(s.trace, p.from, p.to) }
    ),
];

/// Of an object in a trial.
pub const OBJECT_MEASURES: &[Measure<ObjectTransfer>] = &[
    measure!("grasps", "", "how often it was taken", OURS, |_, h| Some(h.grasps as f64)),
    measure!("crossed", "", "1 if it was brought or pushed across the partition", PAPER, |_, h| h
        .crossed
        .map(bool_to_f64)),
    measure!(
        "pick_s",
        "s",
        "from the release of the object before, or the start, until it was first taken; of objects that crossed in the end",
        PAPER,
        |_, h| { h.first_pick.filter(|_| h.crossed != Some(false)).map(|pick| pick.secs()) }
    ),
    measure!("pick_with_method", "", "1 if the person moved the arm in that pick", PAPER, |s, h| {
        let pick = h.first_pick.filter(|_| h.crossed != Some(false))?;
        joints::is_method_used(s.trace, pick.from, pick.to).map(bool_to_f64)
    }),
    measure!(
        "place_s",
        "s",
        "from grasping to release, where the object crossed in between and was above its target region before the release",
        PAPER,
        |_, h| { h.successful_place.map(|placement| placement.secs()) }
    ),
    measure!("place_with_method", "", "1 if the person moved the arm in that place", PAPER, |s, h| {
        let placement = h.successful_place?;
        joints::is_method_used(s.trace, placement.from, placement.to).map(bool_to_f64)
    }),
    measure!(
        "least_distance_mm",
        "mm",
        "smallest horizontal distance from its target over the trial",
        PAPER,
        |_, h| { h.min_target_distance_m.map(|distance| distance * MM_PER_M) }
    ),
    measure!(
        "disturbed",
        "",
        "1 if it left its target region without being held, after it was let go there",
        "ProACT paper, Study 2",
        |s, h| {
            let known = s.trace.scene.target(h.object).filter(|_| !s.trace.has_moving_targets());
            known.map(|_| bool_to_f64(h.disturbed_at.is_some()))
        }
    ),
];

fn fault_count(scored: &ScoredTrial<'_>, kind: FaultKind) -> Option<f64> {
    let is_scorable = scored.trace.has_all_events || !kind.needs_events();
    is_scorable.then(|| scored.faults.iter().filter(|fault: &&TrialFault| fault.kind == kind).count() as f64)
}

macro_rules! faults {
    ($name:literal, $meaning:literal, $kind:ident) => {
        measure!($name, "", $meaning, OURS, |s, ()| fault_count(s, FaultKind::$kind))
    };
}

/// A number that the task itself counted.
fn task_metric(scored: &ScoredTrial<'_>, name: &str) -> Option<f64> {
    scored.trace.task_metrics.get(name).copied()
}

const TAC: &str = "Simon et al. 2011, PMC4232230";
const POINTING: &str = "ISO/TS 9241-411:2012; Soukoreff and MacKenzie 2004, IJHCS 61:751";

/// Of a whole trial.
pub const TRIAL_MEASURES: &[Measure<()>] = &[
    measure!("grasps", "", "how often an object was taken", OURS, |s, ()| {
        Some(s.phases.iter().filter(|phase| phase.kind == PhaseKind::Place).count() as f64)
    }),
    measure!("attempts", "", "how often the hand closed to take something", OURS, |s, ()| {
        let taken = s.phases.iter().filter(|phase| phase.kind == PhaseKind::Pick).count() as f64;
        fault_count(s, FaultKind::GraspFailed).map(|failed| taken + failed)
    }),
    faults!("failed_grasps", "how often the hand closed and held nothing", GraspFailed),
    faults!("wrong_objects", "how often an object was taken that the task had not asked for", WrongObject),
    faults!("drops", "how often an object was let go more than 2 cm above the table", Dropped),
    faults!("released_short", "how often one was put down neither across nor in its region", ReleasedShort),
    faults!("on_floor", "objects that fell below the table", OnFloor),
    faults!("disturbed", "objects that left their target region without being held", Disturbed),
    faults!("plan_failures", "how often the planner found no path", PlanFailed),
    faults!(
        "false_triggers",
        "gestures that came and went within 200 ms between two spells of one other gesture",
        FalseTrigger
    ),
    measure!("false_trigger_ms", "ms", "how long those lasted together", OURS, |s, ()| {
        Some(emg::false_triggers(s.trace).into_iter().map(|(_, millis)| millis as f64).sum())
    }),
    faults!("stops", "how often a source of signals died", Stopped),
    measure!("gesture_changes", "", "changes of the gesture in force", OURS, |s, ()| Some(emg::changes(
        s.trace
    ) as f64)),
    measure!("decisions_per_s", "1/s", "decisions of the EMG's classifier a second", OURS, |s, ()| {
        emg::decision_rate(s.trace)
    }),
    measure!(
        "gesture_to_motion_ms",
        "ms",
        "middle one of the times from a gesture to the first 0.002 rad of a joint, within two seconds; to the record's step",
        OURS,
        |s, ()| emg::gesture_to_motion_ms(s.trace)
    ),
    measure!("shoulder_path_m", "m", "length of the shoulder's way, low-passed at 6 Hz", OURS, |s, ()| {
        shoulder::path(s.trace, SimTime(0), s.trace.duration)
    }),
    measure!(
        "shoulder_displacement_mm" formerly "shoulder_range_mm",
        "mm",
        "furthest of the shoulder from where it was first",
        "Major et al. 2014, JNER 11:132",
        |s, ()| {
            shoulder::max_displacement_m(s.trace, SimTime(0), s.trace.duration).map(|range| range * MM_PER_M)
        }
    ),
    measure!(
        "shoulder_turn_deg",
        "degree",
        "furthest turn of the shoulder from how it was first",
        "Major et al. 2014, JNER 11:132",
        |s, ()| { shoulder::max_turn_deg(s.trace, SimTime(0), s.trace.duration) }
    ),
    measure!(
        "trunk_displacement_mm" formerly "trunk_range_mm",
        "mm",
        "furthest of the trunk's body from where it was first; empty if it was not tracked",
        OURS,
        |s, ()| {
            shoulder::max_trunk_displacement_m(s.trace, SimTime(0), s.trace.duration)
                .map(|range| range * MM_PER_M)
        }
    ),
    measure!(
        "trunk_turn_deg",
        "degree",
        "furthest turn of the trunk from how it was first; empty if it was not tracked",
        OURS,
        |s, ()| { shoulder::max_trunk_turn_deg(s.trace, SimTime(0), s.trace.duration) }
    ),
    measure!(
        "task_s",
        "s",
        "from the start until the last object was at its place; empty where one is not",
        OURS,
        |s, ()| task_metric(s, "seconds")
    ),
    measure!("moves_done", "", "moves of an object to its place that were done", OURS, |s, ()| {
        task_metric(s, "moved")
    }),
    measure!(
        "completion_rate",
        "1",
        "share of the goals shown that were reached and kept for the dwell time",
        TAC,
        |s, ()| task_metric(s, "completion_rate")
    ),
    measure!(
        "completion_s",
        "s",
        "mean time from the display of a goal to its last entry, of goals that were reached: reaction included, dwell not",
        TAC,
        |s, ()| task_metric(s, "completion_s")
    ),
    measure!(
        "overshoots",
        "",
        "mean number of times that a goal was left before the dwell was over",
        TAC,
        |s, ()| task_metric(s, "overshoots")
    ),
    measure!(
        "goal_path_efficiency",
        "1",
        "mean of straight way over way taken, of goals that were reached: of the hand in space, or of the joints that count",
        TAC,
        |s, ()| task_metric(s, "goal_path_efficiency")
    ),
    measure!(
        "throughput_bits_per_s",
        "bit/s",
        "of each condition the mean of log2(D/W + 1) over the mean movement time, and of these the mean; reaches that were made, dwell not counted",
        POINTING,
        |s, ()| task_metric(s, "throughput_bits_per_s")
    ),
    measure!(
        "effective_throughput_bits_per_s",
        "bit/s",
        "the same with the effective width, 4.133 standard deviations of the ends along the way, and the effective distance, the mean way along it",
        POINTING,
        |s, ()| task_metric(s, "effective_throughput_bits_per_s")
    ),
    measure!("gaze_known", "1", "share of the trial with a gaze, 0 to 1", OURS, |s, ()| {
        let with = s.trace.points.iter().filter(|i| i.gaze.is_some_and(|gaze| gaze.valid)).count();
        (with > 0).then(|| with as f64 / s.trace.points.len() as f64)
    }),
];
