use proact_types::{
    Command, Event, GazeSample, ObjectId, Point, Pose, Scene, SimTime, Target, TaskGoal, Vector,
};
use std::collections::BTreeMap;

/// An object's underside may be this far below the surface that it stands on, metres.
const SUPPORT_TOLERANCE_M: f64 = 0.005;

/// One instant of a trial.
#[derive(Clone, Debug, PartialEq)]
pub struct TracePoint {
    /// When.
    pub time: SimTime,
    /// `world_from_base`: the shoulder.
    pub world_from_base: Pose,
    /// `world_from_tip`: the wrist.
    pub world_from_tip: Pose,
    /// Where the hand holds what it holds, `world`, m.
    pub grasp_center: Point,
    /// Joints of the arm from base to tip, rad.
    pub joint_positions: Vec<f64>,
    /// Where these joints are, `world`, m.
    pub joint_origins: Vec<Point>,
    /// `world_from_object`, in the order of the scene.
    pub objects: Vec<Pose>,
    /// The gaze; none where the record has none that is recent.
    pub gaze: Option<GazeSample>,
    /// The gesture in force.
    pub gesture: Command,
    /// The object that the task asks for next.
    pub next: Option<ObjectId>,
    /// Where that goes, or what is asked for, in tasks where it changes.
    pub goal: Option<TaskGoal>,
    /// Between the ends of thumb and index finger, metres; none where the hand has no such digits.
    pub aperture_m: Option<f64>,
}

/// What a joint of the arm can do, by the arm's description.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointRange {
    /// Smallest angle, rad.
    pub lower_rad: f64,
    /// Largest angle, rad.
    pub upper_rad: f64,
    /// Highest speed, rad/s.
    pub max_speed_rad_per_s: f64,
}

/// A recorded trial as scoring sees it.
#[derive(Clone, Debug, Default)]
pub struct Trace {
    /// Table, objects and targets.
    pub scene: Scene,
    /// Of the joints of the arm, from base to tip.
    pub joints: Vec<JointRange>,
    /// Where it ended.
    pub duration: SimTime,
    /// From the start to the end, in order of time, on an even grid of at least 25 a second; a gap where the record has one.
    pub points: Vec<TracePoint>,
    /// What happened, in order of time.
    pub events: Vec<Event>,
    /// Decisions of the EMG's classifier; none where the record does not tell them.
    pub decisions: Option<u64>,
    /// Where a tracked trunk was, `world_from_trunk`, in order of time; empty where it was not tracked.
    pub trunk: Vec<(SimTime, Pose)>,
    /// Whether the record tells what method, planner and grasp rule did: those of the original lab do not.
    pub has_all_events: bool,
    /// Numbers that the task itself counted, by name.
    pub task_metrics: BTreeMap<String, f64>,
}

impl Trace {
    /// The instants from `from` to `to`, both included.
    pub(super) fn between(&self, from: SimTime, to: SimTime) -> &[TracePoint] {
        let first = self.points.partition_point(|instant| instant.time < from);
        let end = self.points.partition_point(|instant| instant.time <= to);
        &self.points[first..end.max(first)]
    }

    /// The poses of the trunk from `from` to `to`, both included.
    pub(super) fn trunk_between(&self, from: SimTime, to: SimTime) -> &[(SimTime, Pose)] {
        let first = self.trunk.partition_point(|(time, _)| *time < from);
        let end = self.trunk.partition_point(|(time, _)| *time <= to);
        &self.trunk[first..end.max(first)]
    }

    /// The last instant at `time` or before it.
    pub(super) fn at(&self, time: SimTime) -> Option<&TracePoint> {
        let end = self.points.partition_point(|instant| instant.time <= time);
        self.points.get(end.checked_sub(1)?)
    }

    /// Whether places change in the course of the trial.
    pub(super) fn has_moving_targets(&self) -> bool {
        self.points.iter().any(|instant| instant.goal.is_some())
    }

    /// Where `object` belongs at an instant; none if it belongs nowhere.
    pub(super) fn target(&self, object: ObjectId, instant: &TracePoint) -> Option<Target> {
        match &instant.goal {
            Some(TaskGoal::Disc { center, radius }) if instant.next == Some(object) => {
                Some(Target { object, center: *center, radius: *radius })
            }
            _ => self.scene.target(object).copied(),
        }
    }

    /// 1 where `object` is to be brought to y > 0, -1 for y < 0; none where it starts on the side of its target, or goes from
    /// place to place.
    pub(super) fn far_side_sign(&self, object: ObjectId) -> Option<f64> {
        if self.has_moving_targets() {
            return None;
        }
        let start = self.scene.objects.get(object.index())?.pose.translation.vector.y;
        let goal = self
            .scene
            .target(object)
            .map_or_else(|| self.scene.place_region.center(0.0).y, |target| target.center.y);
        (start * goal < 0.0).then(|| goal.signum())
    }

    /// Horizontal distance of `object` from its target at an instant, metres; none without a target.
    pub(super) fn target_distance_m(&self, object: ObjectId, instant: &TracePoint) -> Option<f64> {
        let target = self.target(object, instant)?;
        let away: Vector = instant.objects.get(object.index())?.translation.vector - target.center.coords;
        Some(away.xy().norm())
    }

    /// How high the underside of `object` is above the table or the shelf below it, metres, if it stands upright.
    pub(super) fn height_above_support_m(&self, object: ObjectId, instant: &TracePoint) -> Option<f64> {
        let half = self.scene.objects.get(object.index())?.shape.half_height();
        let at = instant.objects.get(object.index())?.translation.vector;
        let under = at.z - half;
        let is_below = |(region, height): &(proact_types::PlaceRegion, f64)| {
            *height <= under + SUPPORT_TOLERANCE_M
                && (0..2).all(|k| (region.min[k]..=region.max[k]).contains(&at[k]))
        };
        let shelves = self.scene.shelves().into_iter().filter(is_below).map(|(_, height)| height);
        Some(under - shelves.fold(self.scene.table_height, f64::max))
    }
}
