//! What the eyes looked at.

use super::{ActionPhase, PhaseKind, ScoredTrial, Trace, TracePoint};
use proact_types::{GazeSample, ObjectId, Point, SimTime, TaskGoal, Vector};
use serde::Serialize;

/// Nearer than this to something, radians, the gaze may mean it: two degrees, above the 1.5 that a HoloLens 2 has (ARETT measured 0.83;
/// `docs/analysis.md`).
const FIXATION_TOLERANCE_RAD: f64 = 0.035;
/// A look is as long as this, milliseconds.
const MIN_DWELL_MS: u64 = 80;
/// How far hand and arm reach from their middle, metres: assumed, half a hand and half a forearm.
const HAND_RADIUS_M: f64 = 0.09;
const ARM_RADIUS_M: f64 = 0.05;

/// What a gaze fell on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum FixationTarget {
    /// An object.
    Object(ObjectId),
    /// The target of an object.
    Target(ObjectId),
    /// The prosthetic hand.
    Hand,
    /// The arm above it, what the original draws on it included.
    Arm,
    /// None of these.
    Elsewhere,
}

/// A spell of the gaze on one thing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dwell {
    /// On what.
    pub target: FixationTarget,
    /// From when.
    pub from: SimTime,
    /// Until when.
    pub to: SimTime,
}

/// What the gaze of an instant falls on: of all things within two degrees of their outline the one whose middle is at the smallest
/// angle, of equal ones the nearest. Nothing hides another: a hand that closes on an object is around it. While an object is held, hand and object are one: the object counts. None without a gaze.
fn find_fixation_target(
    trace: &Trace,
    instant: &TracePoint,
    held: Option<ObjectId>,
) -> Option<FixationTarget> {
    let gaze = instant.gaze.as_ref().filter(|gaze| gaze.valid)?;
    let mut found: Option<(f64, f64, FixationTarget)> = None;
    let mut offer = |at: FixationTarget, center: Point, radius: f64| {
        let Some((beside, angle, depth)) = gaze_angles(gaze, center, radius) else { return };
        if beside <= FIXATION_TOLERANCE_RAD
            && found.is_none_or(|(best, near, _)| (angle, depth) < (best, near))
        {
            found = Some((angle, depth, at));
        }
    };
    for (id, (pose, object)) in trace.scene.ids().zip(instant.objects.iter().zip(&trace.scene.objects)) {
        offer(FixationTarget::Object(id), pose.translation.vector.into(), object.shape.half_height());
    }
    match (&instant.goal, instant.next) {
        // Of several places of an object, the one that it is to go to.
        (Some(TaskGoal::Disc { center, radius }), Some(next)) => {
            offer(FixationTarget::Target(next), *center, *radius);
        }
        (Some(TaskGoal::Ball { .. } | TaskGoal::Posture { .. }), _) => {}
        _ => {
            for target in &trace.scene.targets {
                offer(FixationTarget::Target(target.object), target.center, target.radius);
            }
        }
    }
    offer(held.map_or(FixationTarget::Hand, FixationTarget::Object), instant.grasp_center, HAND_RADIUS_M);
    // Links as beads from joint to joint, some four centimetres apart.
    let beads = instant.joint_origins.iter().zip(instant.joint_origins.iter().skip(1)).flat_map(|(a, b)| {
        let count = ((b - a).norm() / 0.04).ceil() as u32;
        (0..=count).map(move |k| a + (b - a) * (f64::from(k) / f64::from(count.max(1))))
    });
    beads.for_each(|bead| offer(FixationTarget::Arm, bead, ARM_RADIUS_M));
    Some(found.map_or(FixationTarget::Elsewhere, |(_, _, at)| at))
}

/// Angles of the gaze, radians, beside a ball (zero if it goes through it) and to its middle, and the distance to the middle; none where
/// it has no direction.
fn gaze_angles(gaze: &GazeSample, center: Point, radius: f64) -> Option<(f64, f64, f64)> {
    let away: Vector = center - gaze.origin;
    let depth = away.norm();
    let direction = gaze.direction.try_normalize(1e-9)?;
    let angle = if depth > 0.0 { (direction.dot(&away) / depth).clamp(-1.0, 1.0).acos() } else { 0.0 };
    let outline = if depth > radius { (radius / depth).asin() } else { std::f64::consts::PI };
    Some(((angle - outline).max(0.0), angle, depth))
}

/// What the gaze fell on at each instant of a trial; none where there is none.
pub(super) fn find_fixation_targets(trace: &Trace, phases: &[ActionPhase]) -> Vec<Option<FixationTarget>> {
    let placements = phases.iter().filter(|phase| phase.kind == PhaseKind::Place);
    let mut placements = placements.peekable();
    let mut sight = Vec::with_capacity(trace.points.len());
    for instant in &trace.points {
        while placements.next_if(|placement| placement.complete && placement.to <= instant.time).is_some() {}
        let held = placements
            .peek()
            .filter(|placement| placement.from <= instant.time)
            .map(|placement| placement.object);
        sight.push(find_fixation_target(trace, instant, held));
    }
    sight
}

/// The looks of at least 80 ms between two times, and for how many milliseconds the gaze was known.
pub fn find_dwells(scored: &ScoredTrial<'_>, from: SimTime, to: SimTime) -> (Vec<Dwell>, u64) {
    let instants = &scored.trace.points;
    let mut dwells: Vec<Dwell> = Vec::new();
    let mut known = 0;
    let first = instants.partition_point(|instant| instant.time < from);
    let count = instants[first..].partition_point(|instant| instant.time < to);
    for index in first..first + count {
        let begin = instants[index].time;
        let end = instants.get(index + 1).map_or(to, |next| next.time.min(to));
        let Some(at) = scored.fixation_targets[index] else { continue };
        known += end.millis_since(begin);
        match dwells.last_mut() {
            Some(last) if last.target == at && last.to == begin => last.to = end,
            _ => dwells.push(Dwell { target: at, from: begin, to: end }),
        }
    }
    dwells.retain(|dwell| dwell.to.millis_since(dwell.from) >= MIN_DWELL_MS);
    (dwells, known)
}

/// Share of the time with a known gaze that looks of at least 80 ms fell on what `wanted` says, 0 to 1; none without any gaze.
pub(super) fn dwell_fraction(
    scored: &ScoredTrial<'_>,
    phase: &ActionPhase,
    wanted: impl Fn(FixationTarget) -> bool,
) -> Option<f64> {
    let (dwells, known) = find_dwells(scored, phase.from, phase.to);
    let time: u64 = dwells
        .iter()
        .filter(|dwell| wanted(dwell.target))
        .map(|dwell| dwell.to.millis_since(dwell.from))
        .sum();
    (known > 0).then(|| time as f64 / known as f64)
}

/// What the hand is on its way to.
fn phase_goal(phase: &ActionPhase) -> FixationTarget {
    match phase.kind {
        PhaseKind::Pick => FixationTarget::Object(phase.object),
        PhaseKind::Place => FixationTarget::Target(phase.object),
    }
}

/// How long before the hand the eye was at what the hand went to, milliseconds: the object of a pick, the target of a place. Positive
/// where the eye was first; none if it never looked there.
pub(super) fn eye_arrival_latency_ms(scored: &ScoredTrial<'_>, phase: &ActionPhase) -> Option<f64> {
    let (dwells, _) = find_dwells(scored, phase.from, phase.to);
    let first = dwells.iter().find(|dwell| dwell.target == phase_goal(phase))?;
    Some(phase.to.millis_since(first.from) as f64)
}

/// How long after the hand the eye left what the hand had come to, milliseconds. Negative where the eye left first; none if it never
/// looked there, or still does at the end of the record.
pub(super) fn eye_leaving_latency_ms(scored: &ScoredTrial<'_>, phase: &ActionPhase) -> Option<f64> {
    let end = scored.trace.duration;
    let (dwells, _) = find_dwells(scored, phase.from, end);
    let there: Vec<&Dwell> = dwells
        .iter()
        .filter(|dwell| {
            dwell.target == phase_goal(phase)
                || phase.kind == PhaseKind::Place && dwell.target == FixationTarget::Object(phase.object)
        })
        .collect();
    // The look that goes on when the hand is there, or the last one before.
    let last = there.iter().rev().find(|dwell| dwell.from <= phase.to)?;
    (last.to < end).then_some(last.to.0 as f64 - phase.to.0 as f64)
}

/// How often the eye went between the hand, with what it holds, and what the hand is on its way to.
pub(super) fn switches(scored: &ScoredTrial<'_>, phase: &ActionPhase) -> Option<usize> {
    let (dwells, known) = find_dwells(scored, phase.from, phase.to);
    let hand = |at: FixationTarget| {
        at == FixationTarget::Hand
            || phase.kind == PhaseKind::Place && at == FixationTarget::Object(phase.object)
    };
    let ends: Vec<bool> = dwells
        .iter()
        .filter_map(|dwell| {
            if dwell.target == phase_goal(phase) { Some(true) } else { hand(dwell.target).then_some(false) }
        })
        .collect();
    (known > 0).then(|| ends.windows(2).filter(|two| two[0] != two[1]).count())
}
