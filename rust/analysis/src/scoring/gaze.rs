//! What the eyes looked at.

use super::{ActionPhase, Instant, PhaseKind, Scored, Trace};
use proact_types::{GazeSample, ObjectId, Point, SimTime, TaskGoal, Vector};
use serde::Serialize;

/// Nearer than this to something, radians, the gaze may mean it: two degrees, above the 1.5 that a HoloLens 2 has (ARETT measured 0.83;
/// `docs/analysis.md`).
const NEAR_RAD: f64 = 0.035;
/// A look is as long as this, milliseconds.
const LOOK_MS: u64 = 80;
/// How far hand and arm reach from their middle, metres: assumed, half a hand and half a forearm.
const HAND_M: f64 = 0.09;
const ARM_M: f64 = 0.05;

/// What a gaze fell on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum LookedAt {
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
    pub at: LookedAt,
    /// From when.
    pub from: SimTime,
    /// Until when.
    pub to: SimTime,
}

/// What the gaze of an instant falls on: of all things within two degrees of their outline the one whose middle is at the smallest
/// angle, of equal ones the nearest. Nothing hides another: a hand that closes on an object is around it. While an object is held, hand and object are one: the object counts. None without a gaze.
fn looked_at(trace: &Trace, instant: &Instant, held: Option<ObjectId>) -> Option<LookedAt> {
    let gaze = instant.gaze.as_ref().filter(|gaze| gaze.valid)?;
    let mut found: Option<(f64, f64, LookedAt)> = None;
    let mut offer = |at: LookedAt, centre: Point, radius: f64| {
        let Some((beside, angle, depth)) = seen(gaze, centre, radius) else { return };
        if beside <= NEAR_RAD && found.is_none_or(|(best, near, _)| (angle, depth) < (best, near)) {
            found = Some((angle, depth, at));
        }
    };
    for (id, (pose, object)) in trace.scene.ids().zip(instant.objects.iter().zip(&trace.scene.objects)) {
        offer(LookedAt::Object(id), pose.translation.vector.into(), object.shape.half_height());
    }
    match (&instant.asked, instant.next) {
        // Of several places of an object, the one that it is to go to.
        (Some(TaskGoal::Disc { centre, radius }), Some(next)) => {
            offer(LookedAt::Target(next), *centre, *radius);
        }
        (Some(TaskGoal::Ball { .. } | TaskGoal::Posture { .. }), _) => {}
        _ => {
            for target in &trace.scene.targets {
                offer(LookedAt::Target(target.object), target.centre, target.radius);
            }
        }
    }
    offer(held.map_or(LookedAt::Hand, LookedAt::Object), instant.hand, HAND_M);
    // Links as beads from joint to joint, some four centimetres apart.
    let beads = instant.places.iter().zip(instant.places.iter().skip(1)).flat_map(|(a, b)| {
        let count = ((b - a).norm() / 0.04).ceil() as u32;
        (0..=count).map(move |k| a + (b - a) * (f64::from(k) / f64::from(count.max(1))))
    });
    beads.for_each(|bead| offer(LookedAt::Arm, bead, ARM_M));
    Some(found.map_or(LookedAt::Elsewhere, |(_, _, at)| at))
}

/// Angles of the gaze, radians, beside a ball (zero if it goes through it) and to its middle, and the distance to the middle; none where
/// it has no direction.
fn seen(gaze: &GazeSample, centre: Point, radius: f64) -> Option<(f64, f64, f64)> {
    let away: Vector = centre - gaze.origin;
    let depth = away.norm();
    let direction = gaze.direction.try_normalize(1e-9)?;
    let angle = if depth > 0.0 { (direction.dot(&away) / depth).clamp(-1.0, 1.0).acos() } else { 0.0 };
    let outline = if depth > radius { (radius / depth).asin() } else { std::f64::consts::PI };
    Some(((angle - outline).max(0.0), angle, depth))
}

/// What the gaze fell on at each instant of a trial; none where there is none.
pub(super) fn sight(trace: &Trace, phases: &[ActionPhase]) -> Vec<Option<LookedAt>> {
    let places = phases.iter().filter(|phase| phase.kind == PhaseKind::Place);
    let mut places = places.peekable();
    let mut sight = Vec::with_capacity(trace.instants.len());
    for instant in &trace.instants {
        while places.next_if(|place| place.ended && place.to <= instant.time).is_some() {}
        let held = places.peek().filter(|place| place.from <= instant.time).map(|place| place.object);
        sight.push(looked_at(trace, instant, held));
    }
    sight
}

/// The looks of at least 80 ms between two times, and for how many milliseconds the gaze was known.
pub fn looks(scored: &Scored<'_>, from: SimTime, to: SimTime) -> (Vec<Dwell>, u64) {
    let instants = &scored.trace.instants;
    let mut looks: Vec<Dwell> = Vec::new();
    let mut known = 0;
    let first = instants.partition_point(|instant| instant.time < from);
    let count = instants[first..].partition_point(|instant| instant.time < to);
    for place in first..first + count {
        let begin = instants[place].time;
        let end = instants.get(place + 1).map_or(to, |next| next.time.min(to));
        let Some(at) = scored.sight[place] else { continue };
        known += end.millis_since(begin);
        match looks.last_mut() {
            Some(last) if last.at == at && last.to == begin => last.to = end,
            _ => looks.push(Dwell { at, from: begin, to: end }),
        }
    }
    looks.retain(|look| look.to.millis_since(look.from) >= LOOK_MS);
    (looks, known)
}

/// Share of the time with a known gaze that looks of at least 80 ms fell on what `wanted` says, 0 to 1; none without any gaze.
pub(super) fn share(
    scored: &Scored<'_>,
    phase: &ActionPhase,
    wanted: impl Fn(LookedAt) -> bool,
) -> Option<f64> {
    let (looks, known) = looks(scored, phase.from, phase.to);
    let time: u64 =
        looks.iter().filter(|look| wanted(look.at)).map(|look| look.to.millis_since(look.from)).sum();
    (known > 0).then(|| time as f64 / known as f64)
}

/// What the hand is on its way to.
fn goal(phase: &ActionPhase) -> LookedAt {
    match phase.kind {
        PhaseKind::Pick => LookedAt::Object(phase.object),
        PhaseKind::Place => LookedAt::Target(phase.object),
    }
}

/// How long before the hand the eye was at what the hand went to, milliseconds: the object of a pick, the target of a place. Positive
/// where the eye was first; none if it never looked there.
pub(super) fn arrival(scored: &Scored<'_>, phase: &ActionPhase) -> Option<f64> {
    let (looks, _) = looks(scored, phase.from, phase.to);
    let first = looks.iter().find(|look| look.at == goal(phase))?;
    Some(phase.to.millis_since(first.from) as f64)
}

/// How long after the hand the eye left what the hand had come to, milliseconds. Negative where the eye left first; none if it never
/// looked there, or still does at the end of the record.
pub(super) fn leaving(scored: &Scored<'_>, phase: &ActionPhase) -> Option<f64> {
    let end = scored.trace.length;
    let (looks, _) = looks(scored, phase.from, end);
    let there: Vec<&Dwell> = looks
        .iter()
        .filter(|look| {
            look.at == goal(phase)
                || phase.kind == PhaseKind::Place && look.at == LookedAt::Object(phase.object)
        })
        .collect();
    // The look that goes on when the hand is there, or the last one before.
    let last = there.iter().rev().find(|look| look.from <= phase.to)?;
    (last.to < end).then_some(last.to.0 as f64 - phase.to.0 as f64)
}

/// How often the eye went between the hand, with what it holds, and what the hand is on its way to.
pub(super) fn switches(scored: &Scored<'_>, phase: &ActionPhase) -> Option<usize> {
    let (looks, known) = looks(scored, phase.from, phase.to);
    let hand = |at: LookedAt| {
        at == LookedAt::Hand || phase.kind == PhaseKind::Place && at == LookedAt::Object(phase.object)
    };
    let ends: Vec<bool> = looks
        .iter()
        .filter_map(|look| if look.at == goal(phase) { Some(true) } else { hand(look.at).then_some(false) })
        .collect();
    (known > 0).then(|| ends.windows(2).filter(|two| two[0] != two[1]).count())
}
