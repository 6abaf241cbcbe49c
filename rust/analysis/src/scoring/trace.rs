use proact_types::{
    Event, GazeSample, Gesture, ObjectId, Point, Pose, Scene, SimTime, Target, TaskGoal, Vector,
};
use std::collections::BTreeMap;

/// An object's underside may be this far below the surface that it stands on, metres.
const SUNK: f64 = 0.005;

/// One instant of a trial.
#[derive(Clone, Debug, PartialEq)]
pub struct Instant {
    /// When.
    pub time: SimTime,
    /// `world_from_base`: the shoulder.
    pub base: Pose,
    /// `world_from_tip`: the wrist.
    pub tip: Pose,
    /// Where the hand holds what it holds, `world`, m.
    pub hand: Point,
    /// Joints of the arm from base to tip, rad.
    pub joints: Vec<f64>,
    /// Where these joints are, `world`, m.
    pub places: Vec<Point>,
    /// `world_from_object`, in the order of the scene.
    pub objects: Vec<Pose>,
    /// The gaze; none where the record has none that is recent.
    pub gaze: Option<GazeSample>,
    /// The gesture in force.
    pub gesture: Gesture,
    /// The object that the task asks for next.
    pub next: Option<ObjectId>,
    /// Where that goes, or what is asked for, in tasks where it changes.
    pub asked: Option<TaskGoal>,
    /// Between the ends of thumb and index finger, metres; none where the hand has no such digits.
    pub aperture: Option<f64>,
}

/// What a joint of the arm can do, by the arm's description.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointRange {
    /// Smallest angle, rad.
    pub lower: f64,
    /// Largest angle, rad.
    pub upper: f64,
    /// Highest speed, rad/s.
    pub speed: f64,
}

/// A recorded trial as scoring sees it.
#[derive(Clone, Debug, Default)]
pub struct Trace {
    /// Table, objects and targets.
    pub scene: Scene,
    /// Of the joints of the arm, from base to tip.
    pub joints: Vec<JointRange>,
    /// Where it ended.
    pub length: SimTime,
    /// From the start to the end, in order of time, on an even grid of at least 25 a second; a gap where the record has one.
    pub instants: Vec<Instant>,
    /// What happened, in order of time.
    pub events: Vec<Event>,
    /// Decisions of the EMG's classifier; none where the record does not tell them.
    pub decisions: Option<u64>,
    /// Where a tracked trunk was, `world_from_trunk`, in order of time; empty where it was not tracked.
    pub trunk: Vec<(SimTime, Pose)>,
    /// Whether the record tells what method, planner and grasp rule did: those of the original lab do not.
    pub tells_events: bool,
    /// Numbers that the task itself counted, by name.
    pub counted: BTreeMap<String, f64>,
}

impl Trace {
    /// The instants from `from` to `to`, both included.
    pub(super) fn between(&self, from: SimTime, to: SimTime) -> &[Instant] {
        let first = self.instants.partition_point(|instant| instant.time < from);
        let end = self.instants.partition_point(|instant| instant.time <= to);
        &self.instants[first..end.max(first)]
    }

    /// The poses of the trunk from `from` to `to`, both included.
    pub(super) fn trunk_between(&self, from: SimTime, to: SimTime) -> &[(SimTime, Pose)] {
        let first = self.trunk.partition_point(|(time, _)| *time < from);
        let end = self.trunk.partition_point(|(time, _)| *time <= to);
        &self.trunk[first..end.max(first)]
    }

    /// The last instant at `time` or before it.
    pub(super) fn at(&self, time: SimTime) -> Option<&Instant> {
        let end = self.instants.partition_point(|instant| instant.time <= time);
        self.instants.get(end.checked_sub(1)?)
    }

    /// Whether places change in the course of the trial.
    pub(super) fn has_moves(&self) -> bool {
        self.instants.iter().any(|instant| instant.asked.is_some())
    }

    /// Where `object` belongs at an instant; none if it belongs nowhere.
    pub(super) fn target(&self, object: ObjectId, instant: &Instant) -> Option<Target> {
        match &instant.asked {
            Some(TaskGoal::Disc { centre, radius }) if instant.next == Some(object) => {
                Some(Target { object, centre: *centre, radius: *radius })
            }
            _ => self.scene.target(object).copied(),
        }
    }

    /// 1 where `object` is to be brought to y > 0, -1 for y < 0; none where it starts on the side of its target, or goes from
    /// place to place.
    pub(super) fn far_side(&self, object: ObjectId) -> Option<f64> {
        if self.has_moves() {
            return None;
        }
        let start = self.scene.objects.get(object.index())?.pose.translation.vector.y;
        let goal = self
            .scene
            .target(object)
            .map_or_else(|| self.scene.put_down.centre(0.0).y, |target| target.centre.y);
        (start * goal < 0.0).then(|| goal.signum())
    }

    /// Horizontal distance of `object` from its target at an instant, metres; none without a target.
    pub(super) fn distance(&self, object: ObjectId, instant: &Instant) -> Option<f64> {
        let target = self.target(object, instant)?;
        let away: Vector = instant.objects.get(object.index())?.translation.vector - target.centre.coords;
        Some(away.xy().norm())
    }

    /// How high the underside of `object` is above the table or the shelf below it, metres, if it stands upright.
    pub(super) fn height(&self, object: ObjectId, instant: &Instant) -> Option<f64> {
        let half = self.scene.objects.get(object.index())?.shape.half_height();
        let at = instant.objects.get(object.index())?.translation.vector;
        let under = at.z - half;
        let is_below = |(region, height): &(proact_types::PlaceRegion, f64)| {
            *height <= under + SUNK && (0..2).all(|k| (region.min[k]..=region.max[k]).contains(&at[k]))
        };
        let shelves = self.scene.shelves().into_iter().filter(is_below).map(|(_, height)| height);
        Some(under - shelves.fold(self.scene.table_height, f64::max))
    }
}
