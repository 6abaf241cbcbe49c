use super::{ActionPhase, PhaseKind, Trace};
use proact_types::{ObjectId, SimTime};

/// An object that left its region by less than this did not leave it, metres.
const LEFT_M: f64 = 0.005;

/// What became of an object in a trial.
#[derive(Clone, Debug, PartialEq)]
pub struct Handling {
    /// Which object.
    pub object: ObjectId,
    /// How often it was taken.
    pub grasps: usize,
    /// It ended beyond the partition, or was brought there once; none where there is none between start and target.
    pub crossed: Option<bool>,
    /// Its first pick, if the object was taken.
    pub first_pick: Option<ActionPhase>,
    /// The place that counts: it crossed in it and was above its target region in it, the first such.
    pub good_place: Option<ActionPhase>,
    /// Smallest horizontal distance from its target over the trial, metres; none without a target.
    pub least_distance: Option<f64>,
    /// When it left its target region without being held, after it was let go in there; none if it did not.
    pub disturbed: Option<SimTime>,
}

/// Every object of the trial, in the order of the scene.
pub fn handlings(trace: &Trace, phases: &[ActionPhase]) -> Vec<Handling> {
    trace.scene.ids().map(|object| handling(trace, phases, object)).collect()
}

fn handling(trace: &Trace, phases: &[ActionPhase], object: ObjectId) -> Handling {
    let own = |kind| phases.iter().filter(move |phase| phase.object == object && phase.kind == kind);
    let places: Vec<&ActionPhase> = own(PhaseKind::Place).collect();
    let crossed = trace.far_side(object).map(|far| {
        let last = trace.instants.last().and_then(|instant| instant.objects.get(object.index()));
        let ended_there = last.is_some_and(|pose| pose.translation.vector.y * far > 0.0);
        ended_there || places.iter().any(|place| place.crossed == Some(true))
    });
    let good =
        |place: &&&ActionPhase| place.ended && place.entered == Some(true) && place.crossed != Some(false);
    Handling {
        object,
        grasps: places.len(),
        crossed,
        first_pick: own(PhaseKind::Pick).next().copied(),
        good_place: places.iter().find(good).map(|place| **place),
        least_distance: trace.instants.iter().filter_map(|i| trace.distance(object, i)).reduce(f64::min),
        disturbed: disturbed(trace, &places, object),
    }
}

fn disturbed(trace: &Trace, places: &[&ActionPhase], object: ObjectId) -> Option<SimTime> {
    // Where places change, what lay at the last one lies beside the next.
    if trace.has_moves() {
        return None;
    }
    let radius = trace.scene.target(object)?.radius;
    let mut lay_there = false;
    let mut rest = places.iter().peekable();
    for instant in &trace.instants {
        // Past transports are over, the one at the front is yet to come or goes on.
        while let Some(over) = rest.next_if(|place| place.ended && place.to <= instant.time) {
            let then = trace.at(over.to).and_then(|instant| trace.distance(object, instant));
            lay_there = then.is_some_and(|away| away <= radius);
        }
        let held = rest.peek().is_some_and(|place| place.from <= instant.time);
        if held {
            lay_there = false;
        }
        if lay_there && trace.distance(object, instant).is_some_and(|away| away > radius + LEFT_M) {
            return Some(instant.time);
        }
    }
    None
}
