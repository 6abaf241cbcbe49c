//! What a person takes next and where it goes, from what was told and what is seen.

use proact_types::{Briefing, Destination, DisplayFrame, ObjectId, Order, Point, Scene, TaskGoal, Vector};

/// Objects whose room to their neighbours differs by less than this are as easy to take, metres.
const CLEARANCE_TIE_M: f64 = 0.005;
/// Spots that are thought of for putting something down, along x and away from the partition.
const PLACE_GRID: (usize, usize) = (3, 3);
/// What need not stand anywhere may fall once it is so far past the partition, metres: its own size, and the fingers'.
const DROP_MARGIN_M: f64 = 0.04;
/// This much room, from middle to middle, is enough to put something down, metres.
const SUFFICIENT_CLEARANCE_M: f64 = 0.06;

/// What a person was told, and what is being done about it.
#[derive(Clone, Debug)]
pub(crate) struct TargetChoice {
    scene: Scene,
    briefing: Briefing,
    chosen: Option<ObjectId>,
    /// Taken in vain, not to be tried again before another one.
    avoided: Option<ObjectId>,
    /// Where what is in the hand goes.
    place_target: Option<(ObjectId, Point)>,
    /// Where it could not be put down.
    failed_places: Vec<Point>,
}

impl TargetChoice {
    pub(crate) fn new(scene: &Scene, briefing: &Briefing) -> Self {
        let (scene, briefing) = (scene.clone(), briefing.clone());
        Self { scene, briefing, chosen: None, avoided: None, place_target: None, failed_places: Vec::new() }
    }

    /// The object to take next; none if nothing is left.
    pub(crate) fn next_object(&mut self, seen: &DisplayFrame) -> Option<ObjectId> {
        if self.briefing.order == Order::Prescribed {
            return seen.next_object;
        }
        let kept = self.chosen.filter(|id| Some(*id) != self.avoided && self.can_be_taken(*id, seen));
        self.chosen = kept.or_else(|| self.clearest_object(seen));
        self.chosen
    }

    /// What is tried now does not work: another object, if the person may choose.
    pub(crate) fn give_up(&mut self) {
        self.avoided = self.chosen;
    }

    /// Whether `object` is as good as any other to take next: the task says that all are alike, and nothing lies on it.
    pub(crate) fn is_equivalent_target(&self, object: ObjectId, seen: &DisplayFrame) -> bool {
        let all_alike = self.briefing.order == Order::Any && self.briefing.destination == Destination::Across;
        all_alike
            && self.can_be_taken(object, seen)
            && Some(object) != self.avoided
            && !self.scene.is_covered(object, |id| seen.objects[id.index()].translation.vector)
    }

    /// Takes `object` for the one to take next, where it is as good as another.
    pub(crate) fn accept_instead(&mut self, object: ObjectId, seen: &DisplayFrame) {
        if self.is_equivalent_target(object, seen) {
            self.chosen = Some(object);
        }
    }

    /// Where `object` goes; the same for as long as it is carried.
    pub(crate) fn place_for(&mut self, object: ObjectId, seen: &DisplayFrame) -> Point {
        if let Some((_, place_point)) = self.place_target.filter(|(carried, _)| *carried == object) {
            return place_point;
        }
        let own = self.scene.target(object).map(|target| target.center);
        let place_point = match (self.briefing.destination, own) {
            (Destination::OwnTarget, Some(center)) => center,
            (Destination::Displayed, own) => match (&seen.task_goal, own) {
                (Some(TaskGoal::Disc { center, .. }), _) => *center,
                (_, Some(center)) => center,
                _ => self.free_place(object, seen),
            },
            _ => self.free_place(object, seen),
        };
        self.place_target = Some((object, place_point));
        place_point
    }

    /// Whether `object` may be let go of where it is: it is past the partition, over where things are put down, and need not
    /// stand anywhere.
    pub(crate) fn may_drop(&self, object: ObjectId, seen: &DisplayFrame) -> bool {
        let at = seen.objects[object.index()].translation.vector;
        let region = &self.scene.place_region;
        self.briefing.destination == Destination::Across
            && self.target_side() * at.y > DROP_MARGIN_M
            && (0..2).all(|k| at[k] > region.min[k] && at[k] < region.max[k])
    }

    /// It cannot be put down where it was to go: another place.
    pub(crate) fn give_up_place(&mut self, object: ObjectId, seen: &DisplayFrame) {
        let Some((carried, place_point)) = self.place_target.take() else { return };
        if carried == object && self.briefing.destination == Destination::Across {
            self.failed_places.push(place_point);
            self.place_for(object, seen);
        }
    }

    /// The hand is empty: what comes next gets a place of its own.
    pub(crate) fn put_down(&mut self) {
        self.place_target = None;
        self.failed_places.clear();
    }

    /// 1 where things go to y > 0, -1 where they go to y < 0.
    fn target_side(&self) -> f64 {
        if self.scene.place_region.center(0.0).y < 0.0 { -1.0 } else { 1.0 }
    }

    fn can_be_taken(&self, id: ObjectId, seen: &DisplayFrame) -> bool {
        let Some(pose) = seen.objects.get(id.index()) else { return false };
        let at = pose.translation.vector;
        at.z > self.scene.table_height && self.target_side() * at.y < 0.0
    }

    /// The one with the most room around it, as far as others are not below it; of those as easy, the nearest to the partition.
    fn clearest_object(&self, seen: &DisplayFrame) -> Option<ObjectId> {
        let ids = || self.scene.ids().filter(|id| self.can_be_taken(*id, seen));
        let at = |id: &ObjectId| seen.objects[id.index()].translation.vector;
        let clearance = |id: &ObjectId| {
            let height = self.scene.objects[id.index()].shape.half_height();
            let beside = |other: &ObjectId| other != id && at(other).z > at(id).z - height;
            let to_others = ids().filter(beside).map(|other| (at(&other) - at(id)).xy().norm());
            to_others.fold(1.0, f64::min).min(self.distance_to_wall(&at(id)))
        };
        let rank = |id: &ObjectId| ((clearance(id) / CLEARANCE_TIE_M).floor(), -at(id).y.abs());
        let best = ids()
            .filter(|id| Some(*id) != self.avoided)
            .map(|id| (rank(&id), id))
            .reduce(|best, next| if next.0 > best.0 { next } else { best });
        best.map(|(_, id)| id).or(self.avoided.filter(|id| self.can_be_taken(*id, seen)))
    }

    /// To the outer edge of what mirrors the region where things are put down, metres.
    fn distance_to_wall(&self, at: &Vector) -> f64 {
        let region = &self.scene.place_region;
        let furthest = region.min[1].abs().max(region.max[1].abs());
        (at.x - region.min[0]).min(region.max[0] - at.x).min(furthest - at.y.abs())
    }

    /// Just across the partition where there is room, or where there is most of it.
    fn free_place(&self, object: ObjectId, seen: &DisplayFrame) -> Point {
        let region = self.scene.place_region;
        let (low, high) =
            (region.min[1].abs().min(region.max[1].abs()), region.max[1].abs().max(region.min[1].abs()));
        let share = |k: usize, count: usize| (k as f64 + 0.5) / count as f64;
        let grid_point = |k: usize| {
            let (row, column) = (k / PLACE_GRID.0, k % PLACE_GRID.0);
            let x = region.min[0] + (region.max[0] - region.min[0]) * share(column, PLACE_GRID.0);
            let y = low + (high - low) * share(row, PLACE_GRID.1);
            Point::new(x, self.target_side() * y, self.scene.table_height)
        };
        let clearance = |point: &Point| {
            let others = seen.objects.iter().enumerate().filter(|(k, _)| *k != object.index());
            others
                .map(|(_, pose)| (pose.translation.vector - point.coords).xy().norm())
                .fold(1.0, f64::min)
                .min(SUFFICIENT_CLEARANCE_M)
        };
        let middle = region.center(self.scene.table_height);
        // Of those with as much room, the one nearest to the partition and to the middle between near and far wall.
        let rank = |point: &Point| {
            let tried = self.failed_places.iter().any(|other| (other - point).norm() < 1e-6);
            (!tried, clearance(point), -(point.y.abs() + (point.x - middle.x).abs()))
        };
        let ranked_points =
            (0..PLACE_GRID.0 * PLACE_GRID.1).map(grid_point).map(|point| (rank(&point), point));
        let best = ranked_points.reduce(|best, next| if next.0 > best.0 { next } else { best });
        best.map_or(middle, |(_, point)| point)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proact_types::{PlaceRegion, Pose};

    fn scene(count: usize) -> Scene {
        let shape = proact_types::Shape::Box { size: [0.025; 3] };
        let object = |k: usize| proact_types::Object {
            name: format!("cube{k}"),
            label: String::new(),
            color: [0.5; 3],
            ros_name: format!("cube{k}"),
            shape,
            mass: 0.01,
            friction: 0.4,
            finger_friction: 0.8,
            loose: false,
            pose: Pose::identity(),
        };
        Scene {
            fixed: vec![],
            objects: (0..count).map(object).collect(),
            targets: vec![],
            place_region: PlaceRegion { min: [-0.1, 0.02], max: [0.1, 0.25] },
            table_height: 1.0,
        }
    }

    fn briefing() -> Briefing {
        Briefing {
            title: String::new(),
            text: String::new(),
            order: Order::Any,
            destination: Destination::Across,
            score_name: String::new(),
            max_score: None,
            practice_secs: 0.0,
            limit_secs: 60.0,
        }
    }

    fn seen(positions: &[[f64; 2]]) -> DisplayFrame {
        let poses = positions.iter().map(|[x, y]| Pose::translation(*x, *y, 1.0125)).collect();
        DisplayFrame { objects: poses, ..crate::doubles::empty_frame() }
    }

    #[test]
    fn who_may_choose_takes_what_has_room_and_another_one_when_that_does_not_work() {
        let mut choice = TargetChoice::new(&scene(3), &briefing());
        let seen = seen(&[[0.0, -0.1], [0.0, -0.13], [0.0, -0.2]]);
        assert_eq!(choice.next_object(&seen), Some(ObjectId(2)), "the others stand close to each other");
        choice.give_up();
        assert_eq!(choice.next_object(&seen), Some(ObjectId(0)), "as much room as the other one, and nearer");
        assert_eq!(choice.next_object(&seen), Some(ObjectId(0)));
    }

    #[test]
    fn what_lies_below_takes_no_room_from_what_lies_on_it() {
        let mut choice = TargetChoice::new(&scene(3), &briefing());
        let mut seen = seen(&[[0.0, -0.1], [0.0, -0.11], [0.0, -0.13]]);
        assert_eq!(
            choice.next_object(&seen),
            Some(ObjectId(2)),
            "it has the most room of those that stand side by side"
        );
        let mut choice = TargetChoice::new(&scene(3), &briefing());
        seen.objects[0].translation.vector.z += 0.025;
        assert_eq!(
            choice.next_object(&seen),
            Some(ObjectId(0)),
            "it lies on another, and nothing is beside it"
        );
    }

    #[test]
    fn where_all_are_alike_a_person_settles_for_another_one_that_can_be_taken() {
        let mut seen = seen(&[[0.0, -0.1], [0.0, -0.13], [0.0, 0.1], [0.0, -0.2]]);
        seen.objects[3].translation.vector.z = 0.0;
        let settles = |briefing: &Briefing, other: u16, avoids: bool| {
            let mut choice = TargetChoice::new(&scene(4), briefing);
            let first = choice.next_object(&seen);
            choice.accept_instead(ObjectId(other), &seen);
            if avoids {
                choice.give_up();
                choice.next_object(&seen);
                choice.accept_instead(ObjectId(other), &seen);
            }
            (first != choice.next_object(&seen), choice.next_object(&seen) == Some(ObjectId(other)))
        };
        assert_eq!(settles(&briefing(), 1, false), (true, true));
        assert_eq!(settles(&briefing(), 2, false), (false, false), "it is across already");
        assert_eq!(settles(&briefing(), 3, false), (false, false), "it is on the floor");
        assert_eq!(settles(&briefing(), 1, true), (false, false), "it was taken in vain");
        let own = Briefing { destination: Destination::OwnTarget, ..briefing() };
        assert_eq!(settles(&own, 1, false), (false, false), "each belongs somewhere else");
    }

    #[test]
    fn what_is_across_or_on_the_floor_is_not_taken_again() {
        let mut choice = TargetChoice::new(&scene(2), &briefing());
        let mut seen = seen(&[[0.0, 0.1], [0.0, -0.1]]);
        seen.objects[1].translation.vector.z = 0.0;
        assert_eq!(choice.next_object(&seen), None);
    }

    #[test]
    fn what_something_lies_on_is_not_as_good_and_what_is_past_the_partition_may_fall() {
        let mut choice = TargetChoice::new(&scene(2), &briefing());
        let mut seen = seen(&[[0.0, -0.1], [0.005, -0.1]]);
        seen.objects[1].translation.vector.z += 0.025;
        choice.next_object(&seen);
        assert!(!choice.is_equivalent_target(ObjectId(0), &seen), "the other one lies on it");
        assert!(choice.is_equivalent_target(ObjectId(1), &seen));
        for (y, falls) in [(-0.1, false), (0.01, false), (0.1, true), (0.4, false)] {
            seen.objects[0].translation.vector.y = y;
            assert_eq!(choice.may_drop(ObjectId(0), &seen), falls, "{y}");
        }
        let own =
            TargetChoice::new(&scene(2), &Briefing { destination: Destination::OwnTarget, ..briefing() });
        seen.objects[0].translation.vector.y = 0.1;
        assert!(!own.may_drop(ObjectId(0), &seen), "it has a place of its own");
    }

    #[test]
    fn a_place_that_cannot_be_had_is_given_up_for_another_one() {
        let mut choice = TargetChoice::new(&scene(2), &briefing());
        let seen = seen(&[[0.0, 0.3], [0.0, -0.1]]);
        let mut place_points = vec![choice.place_for(ObjectId(0), &seen)];
        for _ in 0..4 {
            choice.give_up_place(ObjectId(0), &seen);
            let place_point = choice.place_for(ObjectId(0), &seen);
            assert!(!place_points.contains(&place_point), "{place_point} was tried");
            place_points.push(place_point);
        }
    }

    #[test]
    fn a_spot_across_is_free_and_stays_while_it_is_carried_there() {
        let mut choice = TargetChoice::new(&scene(2), &briefing());
        let mut seen = seen(&[[0.0, -0.1], [-0.066, 0.058]]);
        let place_point = choice.place_for(ObjectId(0), &seen);
        assert!(
            place_point.y > 0.02
                && (place_point.coords - seen.objects[1].translation.vector).xy().norm() > 0.05,
            "{place_point}"
        );
        seen.objects[1] = Pose::translation(place_point.x, place_point.y, 1.0125);
        assert_eq!(choice.place_for(ObjectId(0), &seen), place_point);
        choice.put_down();
        assert_ne!(choice.place_for(ObjectId(0), &seen), place_point);
    }
}
