use super::Trace;
use proact_types::{EventKind, ObjectId, SimTime};
use serde::Serialize;

/// What the hand does in a phase.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum PhaseKind {
    /// From the release of the object before, or the start of the trial, until contact was made: the paper's pick.
    Pick,
    /// From grasping to release: the paper's place.
    Place,
}

impl PhaseKind {
    /// For a table.
    pub fn label(self) -> &'static str {
        match self {
            PhaseKind::Pick => "pick",
            PhaseKind::Place => "place",
        }
    }
}

/// A reach that ended with an object in the hand, or its transport. Reaches for nothing have no phase.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ActionPhase {
    /// Which of the two.
    pub kind: PhaseKind,
    /// The object.
    pub object: ObjectId,
    /// Which attempt at this object, from 1.
    pub attempt: usize,
    /// When it began.
    pub from: SimTime,
    /// When it ended.
    pub to: SimTime,
    /// False for a transport that the end of the trial cut off.
    pub complete: bool,
    /// The object was brought across the partition in it; none where there is none between start and target.
    pub crossed: Option<bool>,
    /// The object's centre was above its target region in it; none without a target.
    pub entered_target: Option<bool>,
}

impl ActionPhase {
    /// Its length, seconds.
    pub fn secs(&self) -> f64 {
        // Divided, so that 18 ms are 0.018 and not a digit more.
        self.to.millis_since(self.from) as f64 / 1e3
    }
}

/// The phases of a trial: of each grasp a pick and a place, in their order.
///
/// Source: ProACT paper, section "Transfer timings and accuracy".
pub fn phases(trace: &Trace) -> Vec<ActionPhase> {
    let mut phases = Vec::new();
    let mut free_since = SimTime(0);
    let mut held: Option<(ObjectId, SimTime)> = None;
    let mut times = vec![0; trace.scene.objects.len()];
    for event in &trace.events {
        match event.kind {
            // Told twice, by the hand and by the task, it is one grasp.
            EventKind::ObjectAttached { object } if held.is_some_and(|(holds, _)| holds == object) => {}
            EventKind::ObjectAttached { object } if object.index() < times.len() => {
                if let Some((before, since)) = held.take() {
                    phases.push(place(trace, before, since, event.time, true, times[before.index()]));
                    free_since = event.time;
                }
                times[object.index()] += 1;
                phases.push(ActionPhase {
                    kind: PhaseKind::Pick,
                    object,
                    attempt: times[object.index()],
                    from: free_since,
                    to: event.time,
                    complete: true,
                    crossed: None,
                    entered_target: None,
                });
                held = Some((object, event.time));
            }
            EventKind::ObjectReleased { object } => {
                if let Some((_, since)) = held.take_if(|(holds, _)| *holds == object) {
                    phases.push(place(trace, object, since, event.time, true, times[object.index()]));
                    free_since = event.time;
                }
            }
            _ => {}
        }
    }
    if let Some((object, since)) = held {
        phases.push(place(trace, object, since, trace.duration, false, times[object.index()]));
    }
    phases
}

fn place(
    trace: &Trace,
    object: ObjectId,
    from: SimTime,
    to: SimTime,
    ended: bool,
    time: usize,
) -> ActionPhase {
    let within = trace.between(from, to);
    let side = |time| Some(trace.at(time)?.objects.get(object.index())?.translation.vector.y);
    let crossed =
        trace.far_side_sign(object).and_then(|far| Some(side(from)? * far <= 0.0 && side(to)? * far > 0.0));
    let target = trace.at(from).and_then(|instant| trace.target(object, instant));
    let entered = target.map(|target| {
        within
            .iter()
            .any(|instant| trace.target_distance_m(object, instant).is_some_and(|away| away <= target.radius))
    });
    ActionPhase {
        kind: PhaseKind::Place,
        object,
        attempt: time,
        from,
        to,
        complete: ended,
        crossed,
        entered_target: entered,
    }
}
