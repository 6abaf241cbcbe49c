use proact_types::{Event, GazeSample, Gesture, ObjectId, Point, Pose, Scene, SimTime, Vector};

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
}

/// A recorded trial as scoring sees it.
#[derive(Clone, Debug, Default)]
pub struct Trace {
    /// Table, objects and targets.
    pub scene: Scene,
    /// Where it ended.
    pub length: SimTime,
    /// From the start to the end, in order of time, at least 25 a second.
    pub instants: Vec<Instant>,
    /// What happened, in order of time.
    pub events: Vec<Event>,
    /// Decisions of the EMG's classifier; none where the record does not tell them.
    pub decisions: Option<u64>,
    /// Where a tracked trunk was, `world_from_trunk`, in order of time; empty where it was not tracked.
    pub trunk: Vec<(SimTime, Pose)>,
    /// Whether the record tells what method, planner and grasp rule did: those of the original lab do not.
    pub tells_events: bool,
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

    /// 1 where `object` is to be brought to y > 0, -1 for y < 0; none where it starts on the side of its target.
    pub(super) fn far_side(&self, object: ObjectId) -> Option<f64> {
        let start = self.scene.objects.get(object.index())?.pose.translation.vector.y;
        let goal = self
            .scene
            .target(object)
            .map_or_else(|| self.scene.put_down.centre(0.0).y, |target| target.centre.y);
        (start * goal < 0.0).then(|| goal.signum())
    }

    /// Horizontal distance of `object` from its target at an instant, metres; none without a target.
    pub(super) fn distance(&self, object: ObjectId, instant: &Instant) -> Option<f64> {
        let target = self.scene.target(object)?;
        let away: Vector = instant.objects.get(object.index())?.translation.vector - target.centre.coords;
        Some(away.xy().norm())
    }

    /// How high the underside of `object` is above the table, metres, if it stands upright.
    pub(super) fn height(&self, object: ObjectId, instant: &Instant) -> Option<f64> {
        let half = self.scene.objects.get(object.index())?.shape.half_height();
        Some(instant.objects.get(object.index())?.translation.vector.z - half - self.scene.table_height)
    }
}
