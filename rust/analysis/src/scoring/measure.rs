//! The columns: one function each, with its name, unit, definition and source.

use super::{
    ActionPhase, FaultKind, Handling, LookedAt, PhaseKind, Scored, TrialFault, emg, gaze, joints,
    motion::Way, shoulder,
};
use crate::table::Column;
use proact_types::SimTime;

/// A column of a table of scores, and how it is found.
pub struct Measure<T: 'static> {
    /// Its name, unit, definition and source.
    pub column: Column,
    /// Its value for a row; none where the record cannot say.
    pub of: fn(&Scored<'_>, &T) -> Option<f64>,
}

const PAPER: &str = "ProACT paper, Transfer timings and accuracy";
const PAPER_BODY: &str = "ProACT paper, Compensatory movement";
const GAMA: &str = "Valevicius et al. 2018, PLoS ONE e0199549";
const LAVOIE: &str = "Lavoie et al. 2018, J Vis 18(6):18";
const OURS: &str = "ProACT, docs/analysis.md";

macro_rules! measure {
    ($name:literal, $unit:literal, $meaning:literal, $source:expr, $of:expr) => {
        Measure { column: Column { name: $name, unit: $unit, meaning: $meaning, source: $source }, of: $of }
    };
}

/// Millimetres in a metre.
const MM: f64 = 1e3;

fn truth(yes: bool) -> f64 {
    f64::from(u8::from(yes))
}

/// The way of the hand through a phase.
fn hand(scored: &Scored<'_>, phase: &ActionPhase) -> Option<Way> {
    Way::of(scored.trace.between(phase.from, phase.to), |instant| instant.hand)
}

/// The widest aperture of a phase, metres, and when the hand was first as wide but for a millimetre, as a share of it.
fn peak_aperture(scored: &Scored<'_>, phase: &ActionPhase) -> Option<(f64, f64)> {
    let within = scored.trace.between(phase.from, phase.to);
    let wide = || within.iter().filter_map(|instant| Some((instant.time, instant.aperture?)));
    let widest = wide().map(|(_, aperture)| aperture).reduce(f64::max)?;
    let (at, _) = wide().find(|(_, aperture)| widest - aperture < 1.0 / MM)?;
    let length = phase.to.millis_since(phase.from);
    (length > 0).then(|| (widest, at.millis_since(phase.from) as f64 / length as f64))
}

macro_rules! joint {
    ($name:literal, $place:literal) => {
        measure!($name, "rad", "way of this joint of the arm, counted from the base; steps under 0.002 rad add up before they count", OURS, |s, p| {
            joints::path(s.trace, p.from, p.to, $place)
        })
    };
}

/// Of a pick or a place.
pub const OF_PHASE: &[Measure<ActionPhase>] = &[
    measure!("seconds", "s", "length of the phase", PAPER, |_, p| Some(p.secs())),
    measure!(
        "with_method",
        "",
        "1 if a joint of the arm went further than 0.05 rad from where it was first: the person used the method, 0 if only the body moved",
        PAPER,
        |s, p| { joints::used(s.trace, p.from, p.to).map(truth) }
    ),
    measure!(
        "shoulder_sum10_m",
        "m",
        "sum of the shoulder's steps at 10 Hz; hangs on the step",
        PAPER_BODY,
        |s, p| { shoulder::translation_sum10(s.trace, p.from, p.to) }
    ),
    measure!(
        "shoulder_turn_sum10_deg",
        "degree",
        "sum of the shoulder's turns at 10 Hz; hangs on the step",
        PAPER_BODY,
        |s, p| { shoulder::rotation_sum10(s.trace, p.from, p.to) }
    ),
    measure!("shoulder_path_m", "m", "length of the shoulder's way, low-passed at 6 Hz", OURS, |s, p| {
        shoulder::path(s.trace, p.from, p.to)
    }),
    measure!(
        "shoulder_range_mm",
        "mm",
        "furthest of the shoulder from where it was first, low-passed at 6 Hz",
        "Major et al. 2014, JNER 11:132",
        |s, p| { shoulder::range(s.trace, p.from, p.to).map(|range| range * MM) }
    ),
    measure!(
        "shoulder_turn_deg",
        "degree",
        "furthest turn of the shoulder from how it was first",
        "Major et al. 2014, JNER 11:132",
        |s, p| { shoulder::turn(s.trace, p.from, p.to) }
    ),
    measure!(
        "trunk_range_mm",
        "mm",
        "furthest of the trunk's body from where it was first; empty if it was not tracked",
        OURS,
        |s, p| { shoulder::trunk_range(s.trace, p.from, p.to).map(|range| range * MM) }
    ),
    measure!(
        "trunk_turn_deg",
        "degree",
        "furthest turn of the trunk from how it was first; empty if it was not tracked",
        OURS,
        |s, p| { shoulder::trunk_turn(s.trace, p.from, p.to) }
    ),
    measure!(
        "base_share",
        "1",
        "share of the hand's straight way that the shoulder brought it; the rest is the joints'. Below 0 or above 1 where they worked against each other",
        OURS,
        |s, p| { shoulder::base_share(s.trace, p.from, p.to) }
    ),
    measure!("hand_path_m", "m", "length of the hand's way, low-passed at 6 Hz", GAMA, |s, p| hand(s, p)
        .map(|way| way.length())),
    measure!(
        "path_efficiency",
        "1",
        "straight way of the hand over the way that it went, 0 to 1",
        "LibEMG; BioPatRec",
        |s, p| {
            let way = hand(s, p)?;
            (way.length() > 0.0).then(|| way.straight() / way.length())
        }
    ),
    measure!("peak_speed_m_per_s", "m/s", "highest speed of the hand, low-passed at 6 Hz", GAMA, |s, p| {
        hand(s, p)?.peak().map(|peak| peak[0])
    }),
    measure!("peak_time", "1", "when it was, as a share of the phase, 0 to 1", GAMA, |s, p| hand(s, p)?
        .peak()
        .map(|peak| peak[1])),
    measure!(
        "peak_deceleration_time",
        "1",
        "when the hand's speed fell fastest, as a share of the phase, 0 to 1",
        GAMA,
        |s, p| hand(s, p)?.strongest_braking()
    ),
    measure!(
        "peak_aperture_mm",
        "mm",
        "widest distance between the last joints of thumb and index finger in the phase; of hands that have both",
        GAMA,
        |s, p| peak_aperture(s, p).map(|(widest, _)| widest * MM)
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
        |s, p| hand(s, p).map(|way| way.units() as f64)
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
        |s, p| { gaze::share(s, p, |at| at == LookedAt::Object(p.object)) }
    ),
    measure!("gaze_other_objects", "1", "share on other objects", LAVOIE, |s, p| {
        gaze::share(s, p, |at| matches!(at, LookedAt::Object(object) if object != p.object))
    }),
    measure!("gaze_target", "1", "share on the object's target", LAVOIE, |s, p| {
        gaze::share(s, p, |at| at == LookedAt::Target(p.object))
    }),
    measure!(
        "gaze_hand",
        "1",
        "share on the prosthetic hand; while it holds the object, the object counts",
        LAVOIE,
        |s, p| { gaze::share(s, p, |at| at == LookedAt::Hand) }
    ),
    measure!(
        "gaze_arm",
        "1",
        "share on the arm, where the original draws the mode too",
        "ProACT paper, Gaze",
        |s, p| { gaze::share(s, p, |at| at == LookedAt::Arm) }
    ),
    measure!(
        "gaze_elsewhere",
        "1",
        "share on none of these, in looks of at least 80 ms; the rest were shorter",
        OURS,
        |s, p| {
            gaze::share(s, p, |at| {
                matches!(at, LookedAt::Elsewhere)
                    || matches!(at, LookedAt::Target(object) if object != p.object)
            })
        }
    ),
    measure!(
        "eye_arrival_ms",
        "ms",
        "how long before the hand the eye was first at what the hand went to: the object of a pick, the target of a place",
        LAVOIE,
        gaze::arrival
    ),
    measure!(
        "eye_leaving_ms",
        "ms",
        "how long after the hand the eye left that; negative where the eye left first",
        LAVOIE,
        gaze::leaving
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
        |s, p| hand(s, p)?.strongest_acceleration()
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
        |s, p| { joints::speed_share(s.trace, p.from, p.to) }
    ),
    measure!(
        "joint_beyond_rad",
        "rad",
        "how far a joint of the arm was outside the limits of the arm's description at most",
        OURS,
        |s, p| { joints::beyond(s.trace, p.from, p.to) }
    ),
];

/// Of an object in a trial.
pub const OF_OBJECT: &[Measure<Handling>] = &[
    measure!("grasps", "", "how often it was taken", OURS, |_, h| Some(h.grasps as f64)),
    measure!("crossed", "", "1 if it was brought or pushed across the partition", PAPER, |_, h| h
        .crossed
        .map(truth)),
    measure!(
        "pick_s",
        "s",
        "from the release of the object before, or the start, until it was first taken; of objects that crossed in the end",
        PAPER,
        |_, h| { h.first_pick.filter(|_| h.crossed != Some(false)).map(|pick| pick.secs()) }
    ),
    measure!("pick_with_method", "", "1 if the person moved the arm in that pick", PAPER, |s, h| {
        let pick = h.first_pick.filter(|_| h.crossed != Some(false))?;
        joints::used(s.trace, pick.from, pick.to).map(truth)
    }),
    measure!(
        "place_s",
        "s",
        "from grasping to release, where the object crossed in between and was above its target region before the release",
        PAPER,
        |_, h| { h.good_place.map(|place| place.secs()) }
    ),
    measure!("place_with_method", "", "1 if the person moved the arm in that place", PAPER, |s, h| {
        let place = h.good_place?;
        joints::used(s.trace, place.from, place.to).map(truth)
    }),
    measure!(
        "least_distance_mm",
        "mm",
        "smallest horizontal distance from its target over the trial",
        PAPER,
        |_, h| { h.least_distance.map(|distance| distance * MM) }
    ),
    measure!(
        "disturbed",
        "",
        "1 if it left its target region without being held, after it was let go there",
        "ProACT paper, Study 2",
        |s, h| {
            let known = s.trace.scene.target(h.object).filter(|_| !s.trace.has_moves());
            known.map(|_| truth(h.disturbed.is_some()))
        }
    ),
];

fn count(scored: &Scored<'_>, kind: FaultKind) -> Option<f64> {
    let told = scored.trace.tells_events || !kind.needs_events();
    told.then(|| scored.faults.iter().filter(|fault: &&TrialFault| fault.kind == kind).count() as f64)
}

macro_rules! faults {
    ($name:literal, $meaning:literal, $kind:ident) => {
        measure!($name, "", $meaning, OURS, |s, ()| count(s, FaultKind::$kind))
    };
}

/// A number that the task itself counted.
fn counted(scored: &Scored<'_>, name: &str) -> Option<f64> {
    scored.trace.counted.get(name).copied()
}

const TAC: &str = "Simon et al. 2011, PMC4232230";
const POINTING: &str = "ISO/TS 9241-411:2012; Soukoreff and MacKenzie 2004, IJHCS 61:751";

/// Of a whole trial.
pub const OF_TRIAL: &[Measure<()>] = &[
    measure!("grasps", "", "how often an object was taken", OURS, |s, ()| {
        Some(s.phases.iter().filter(|phase| phase.kind == PhaseKind::Place).count() as f64)
    }),
    measure!("attempts", "", "how often the hand closed to take something", OURS, |s, ()| {
        let taken = s.phases.iter().filter(|phase| phase.kind == PhaseKind::Pick).count() as f64;
        count(s, FaultKind::GraspFailed).map(|failed| taken + failed)
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
        Some(emg::bursts(s.trace).into_iter().map(|(_, millis)| millis as f64).sum())
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
        |s, ()| emg::latency(s.trace)
    ),
    measure!("shoulder_path_m", "m", "length of the shoulder's way, low-passed at 6 Hz", OURS, |s, ()| {
        shoulder::path(s.trace, SimTime(0), s.trace.length)
    }),
    measure!(
        "shoulder_range_mm",
        "mm",
        "furthest of the shoulder from where it was first",
        "Major et al. 2014, JNER 11:132",
        |s, ()| { shoulder::range(s.trace, SimTime(0), s.trace.length).map(|range| range * MM) }
    ),
    measure!(
        "shoulder_turn_deg",
        "degree",
        "furthest turn of the shoulder from how it was first",
        "Major et al. 2014, JNER 11:132",
        |s, ()| { shoulder::turn(s.trace, SimTime(0), s.trace.length) }
    ),
    measure!(
        "trunk_range_mm",
        "mm",
        "furthest of the trunk's body from where it was first; empty if it was not tracked",
        OURS,
        |s, ()| { shoulder::trunk_range(s.trace, SimTime(0), s.trace.length).map(|range| range * MM) }
    ),
    measure!(
        "trunk_turn_deg",
        "degree",
        "furthest turn of the trunk from how it was first; empty if it was not tracked",
        OURS,
        |s, ()| { shoulder::trunk_turn(s.trace, SimTime(0), s.trace.length) }
    ),
    measure!(
        "task_s",
        "s",
        "from the start until the last object was at its place; empty where one is not",
        OURS,
        |s, ()| counted(s, "seconds")
    ),
    measure!("moves_done", "", "moves of an object to its place that were done", OURS, |s, ()| {
        counted(s, "moved")
    }),
    measure!(
        "completion_rate",
        "1",
        "share of the goals shown that were reached and kept for the dwell time",
        TAC,
        |s, ()| counted(s, "completion_rate")
    ),
    measure!(
        "completion_s",
        "s",
        "mean time from the display of a goal to its last entry, of goals that were reached: reaction included, dwell not",
        TAC,
        |s, ()| counted(s, "completion_s")
    ),
    measure!(
        "overshoots",
        "",
        "mean number of times that a goal was left before the dwell was over",
        TAC,
        |s, ()| counted(s, "overshoots")
    ),
    measure!(
        "goal_path_efficiency",
        "1",
        "mean of straight way over way taken, of goals that were reached: of the hand in space, or of the joints that count",
        TAC,
        |s, ()| counted(s, "goal_path_efficiency")
    ),
    measure!(
        "throughput_bits_per_s",
        "bit/s",
        "of each condition the mean of log2(D/W + 1) over the mean movement time, and of these the mean; reaches that were made, dwell not counted",
        POINTING,
        |s, ()| counted(s, "throughput_bits_per_s")
    ),
    measure!(
        "effective_throughput_bits_per_s",
        "bit/s",
        "the same with the effective width, 4.133 standard deviations of the ends along the way, and the effective distance, the mean way along it",
        POINTING,
        |s, ()| counted(s, "effective_throughput_bits_per_s")
    ),
    measure!("gaze_known", "1", "share of the trial with a gaze, 0 to 1", OURS, |s, ()| {
        let with = s.trace.instants.iter().filter(|i| i.gaze.is_some_and(|gaze| gaze.valid)).count();
        (with > 0).then(|| with as f64 / s.trace.instants.len() as f64)
    }),
];
