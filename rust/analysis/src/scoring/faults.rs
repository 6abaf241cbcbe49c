use super::{ActionPhase, ObjectTransfer, PhaseKind, Trace, emg};
use crate::table::serialized_name;
use proact_types::{EventKind, ObjectId, PlanStatus, SimTime};
use serde::Serialize;

/// An object that is let go with its underside higher than this above the table falls, metres.
const MIN_DROP_HEIGHT_M: f64 = 0.02;

/// What can go wrong in a trial.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum FaultKind {
    /// An object was taken that was not the one that the task asks for.
    WrongObject,
    /// The hand closed and holds nothing.
    GraspFailed,
    /// An object was let go more than 2 cm above the table.
    Dropped,
    /// An object was put down, but neither above its target region nor across the partition.
    ReleasedShort,
    /// An object lies below the table.
    OnFloor,
    /// An object that lay in its target region left it without being held.
    Disturbed,
    /// The planner found no path to the goal.
    PlanFailed,
    /// As many plans failed in a row as the configuration allows.
    PlansFailedInARow,
    /// A gesture came and went within 200 ms.
    FalseTrigger,
    /// A source of signals died, and the arm stood still.
    Stopped,
    /// The tracked shoulder jumped, and the arm stood still.
    ShoulderJumped,
}

impl FaultKind {
    /// All of them.
    pub const ALL: [FaultKind; 11] = [
        FaultKind::WrongObject,
        FaultKind::GraspFailed,
        FaultKind::Dropped,
        FaultKind::ReleasedShort,
        FaultKind::OnFloor,
        FaultKind::Disturbed,
        FaultKind::PlanFailed,
        FaultKind::PlansFailedInARow,
        FaultKind::FalseTrigger,
        FaultKind::Stopped,
        FaultKind::ShoulderJumped,
    ];

    /// For a table.
    pub fn label(self) -> &'static str {
        match self {
            FaultKind::WrongObject => "wrong_object",
            FaultKind::GraspFailed => "grasp_failed",
            FaultKind::Dropped => "dropped",
            FaultKind::ReleasedShort => "released_short",
            FaultKind::OnFloor => "on_floor",
            FaultKind::Disturbed => "disturbed",
            FaultKind::PlanFailed => "plan_failed",
            FaultKind::PlansFailedInARow => "plans_failed_in_a_row",
            FaultKind::FalseTrigger => "false_trigger",
            FaultKind::Stopped => "stopped",
            FaultKind::ShoulderJumped => "shoulder_jumped",
        }
    }

    /// Whether only a record with all events tells it.
    pub(super) fn needs_events(self) -> bool {
        matches!(
            self,
            FaultKind::GraspFailed
                | FaultKind::PlanFailed
                | FaultKind::PlansFailedInARow
                | FaultKind::Stopped
                | FaultKind::ShoulderJumped
        )
    }
}

/// Something that went wrong.
#[derive(Clone, Debug, PartialEq)]
pub struct TrialFault {
    /// When.
    pub time: SimTime,
    /// What.
    pub kind: FaultKind,
    /// With which object.
    pub object: Option<ObjectId>,
    /// More of it, such as the planner's status.
    pub detail: String,
}

/// What went wrong, in order of time.
pub fn faults(trace: &Trace, phases: &[ActionPhase], objects: &[ObjectTransfer]) -> Vec<TrialFault> {
    let mut faults: Vec<TrialFault> = phases.iter().filter_map(|phase| of_phase(trace, phase)).collect();
    let fault = |time, kind, object, detail: String| TrialFault { time, kind, object, detail };
    let shelves = trace.scene.shelves().into_iter().map(|(_, height)| height);
    let lowest = shelves.fold(trace.scene.table_height, f64::min);
    for transfer in objects {
        let object = Some(transfer.object);
        faults.extend(transfer.disturbed_at.map(|at| fault(at, FaultKind::Disturbed, object, String::new())));
        let below = |instant: &&super::TracePoint| {
            let pose = instant.objects.get(transfer.object.index());
            pose.is_some_and(|pose| pose.translation.vector.z < lowest)
        };
        let fell = trace.points.iter().find(below).map(|instant| instant.time);
        faults.extend(fell.map(|at| fault(at, FaultKind::OnFloor, object, String::new())));
    }
    for event in &trace.events {
        let (kind, object, detail) = match &event.kind {
            EventKind::GraspFailed { object, reason } => {
                (FaultKind::GraspFailed, *object, serialized_name(reason))
            }
            EventKind::PlanFinished { status, reason, .. }
                if !matches!(status, PlanStatus::Ok | PlanStatus::Intermediate | PlanStatus::Cancelled) =>
            {
                let why = reason.as_ref().map_or(String::new(), |reason| format!(": {reason}"));
                (FaultKind::PlanFailed, None, serialized_name(status) + &why)
            }
            EventKind::PlansFailed { count, reason } => {
                (FaultKind::PlansFailedInARow, None, format!("{count} in a row: {reason}"))
            }
            EventKind::Stopped { reason, .. } => (FaultKind::Stopped, None, reason.clone()),
            EventKind::BaseHeld { distance } => (FaultKind::ShoulderJumped, None, format!("{distance:.3} m")),
            _ => continue,
        };
        faults.push(fault(event.time, kind, object, detail));
    }
    for (at, millis) in emg::false_triggers(trace) {
        faults.push(fault(at, FaultKind::FalseTrigger, None, format!("{millis} ms")));
    }
    faults.sort_by_key(|fault| (fault.time, fault.kind));
    faults
}

fn of_phase(trace: &Trace, phase: &ActionPhase) -> Option<TrialFault> {
    let fault =
        |kind, detail: String| TrialFault { time: phase.to, kind, object: Some(phase.object), detail };
    match phase.kind {
        PhaseKind::Pick => {
            // What was asked for before it was taken.
            let expected = trace.at(SimTime(phase.to.0.saturating_sub(1)))?.next?;
            (expected != phase.object)
                .then(|| fault(FaultKind::WrongObject, format!("for {}", trace.scene.name(expected))))
        }
        PhaseKind::Place if phase.complete => {
            let then = trace.at(phase.to)?;
            let height = trace.height_above_support_m(phase.object, then)?;
            if height > MIN_DROP_HEIGHT_M {
                return Some(fault(FaultKind::Dropped, format!("{height:.3} m")));
            }
            let short = phase.crossed == Some(false) && phase.entered_target != Some(true);
            short.then(|| fault(FaultKind::ReleasedShort, String::new()))
        }
        PhaseKind::Place => None,
    }
}
