use super::{ActionPhase, PhaseKind, Trace};
use proact_types::{ObjectId, SimTime};

/// An object that left its region by less than this did not leave it, metres.
const LEFT_REGION_TOLERANCE_M: f64 = 0.005;

/// What became of an object in a trial.
#[derive(Clone, Debug, PartialEq)]
pub struct ObjectTransfer {
    /// Which object.
    pub object: ObjectId,
    /// How often it was taken.
    pub grasps: usize,
    /// It ended beyond the partition, or was brought there once; none where there is none between start and target.
    pub crossed: Option<bool>,
    /// Its first pick, if the object was taken.
    pub first_pick: Option<ActionPhase>,
    /// The place that counts: it crossed in it and was above its target region in it, the first such.
    pub successful_place: Option<ActionPhase>,
    /// Smallest horizontal distance from its target over the trial, metres; none without a target.
    pub min_target_distance_m: Option<f64>,
    /// When it left its target region without being held, after it was let go in there; none if it did not.
    pub disturbed_at: Option<SimTime>,
}

/// Every object of the trial, in the order of the scene.
pub fn find_object_transfers(trace: &Trace, phases: &[ActionPhase]) -> Vec<ObjectTransfer> {
    trace.scene.ids().map(|object| object_transfer(trace, phases, object)).collect()
}

fn object_transfer(trace: &Trace, phases: &[ActionPhase], object: ObjectId) -> ObjectTransfer {
    let own = |kind| phases.iter().filter(move |phase| phase.object == object && phase.kind == kind);
    let placements: Vec<&ActionPhase> = own(PhaseKind::Place).collect();
    let crossed = trace.far_side_sign(object).map(|far| {
        let last = trace.points.last().and_then(|instant| instant.objects.get(object.index()));
        let ended_there = last.is_some_and(|pose| pose.translation.vector.y * far > 0.0);
        ended_there || placements.iter().any(|placement| placement.crossed == Some(true))
    });
    let good = |placement: &&&ActionPhase| {
        placement.complete && placement.entered_target == Some(true) && placement.crossed != Some(false)
    };
    ObjectTransfer {
        object,
        grasps: placements.len(),
        crossed,
        first_pick: own(PhaseKind::Pick).next().copied(),
        successful_place: placements.iter().find(good).map(|placement| **placement),
        min_target_distance_m: trace
            .points
            .iter()
            .filter_map(|i| trace.target_distance_m(object, i))
            .reduce(f64::min),
        disturbed_at: find_disturbance(trace, &placements, object),
    }
}

fn find_disturbance(trace: &Trace, placements: &[&ActionPhase], object: ObjectId) -> Option<SimTime> {
    // Where places change, what lay at the last one lies beside the next.
    if trace.has_moving_targets() {
        return None;
    }
    let radius = trace.scene.target(object)?.radius;
    let mut lay_there = false;
    let mut rest = placements.iter().peekable();
    for instant in &trace.points {
        // Past transports are over, the one at the front is yet to come or goes on.
        while let Some(over) = rest.next_if(|placement| placement.complete && placement.to <= instant.time) {
            let then = trace.at(over.to).and_then(|instant| trace.target_distance_m(object, instant));
            lay_there = then.is_some_and(|away| away <= radius);
        }
        let held = rest.peek().is_some_and(|placement| placement.from <= instant.time);
        if held {
            lay_there = false;
        }
        if lay_there
            && trace
                .target_distance_m(object, instant)
                .is_some_and(|away| away > radius + LEFT_REGION_TOLERANCE_M)
        {
            return Some(instant.time);
        }
    }
    None
}
