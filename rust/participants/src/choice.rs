//! What a person takes next and where it goes, from what was told and what is seen.

use proact_types::{Briefing, Destination, DisplayFrame, ObjectId, Order, Point, Scene, TaskGoal, Vector};

/// Objects whose room to their neighbours differs by less than this are as easy to take, metres.
const AS_EASY: f64 = 0.005;
/// Spots that are thought of for putting something down, along x and away from the partition.
const SPOTS: (usize, usize) = (3, 3);
/// What need not stand anywhere may fall once it is so far past the partition, metres: its own size, and the fingers'.
const FALLS_PAST: f64 = 0.04;
/// This much room, from middle to middle, is enough to put something down, metres.
const ENOUGH: f64 = 0.06;

/// What a person was told, and what is being done about it.
#[derive(Clone, Debug)]
pub(crate) struct Choice {
    scene: Scene,
    briefing: Briefing,
    chosen: Option<ObjectId>,
    /// Taken in vain, not to be tried again before another one.
    avoided: Option<ObjectId>,
    /// Where what is in the hand goes.
    spot: Option<(ObjectId, Point)>,
    /// Where it could not be put down.
    spots_in_vain: Vec<Point>,
}

impl Choice {
    pub(crate) fn new(scene: &Scene, briefing: &Briefing) -> Self {
        let (scene, briefing) = (scene.clone(), briefing.clone());
        Self { scene, briefing, chosen: None, avoided: None, spot: None, spots_in_vain: Vec::new() }
    }

    /// The object to take next; none if nothing is left.
    pub(crate) fn next(&mut self, seen: &DisplayFrame) -> Option<ObjectId> {
        if self.briefing.order == Order::Prescribed {
            return seen.next;
        }
        let kept = self.chosen.filter(|id| Some(*id) != self.avoided && self.can_be_taken(*id, seen));
        self.chosen = kept.or_else(|| self.easiest(seen));
        self.chosen
    }

    /// What is tried now does not work: another object, if the person may choose.
    pub(crate) fn give_up(&mut self) {
        self.avoided = self.chosen;
    }

    /// Whether `object` is as good as any other to take next: the task says that all are alike, and nothing lies on it.
    pub(crate) fn is_as_good(&self, object: ObjectId, seen: &DisplayFrame) -> bool {
        let all_alike = self.briefing.order == Order::Any && self.briefing.destination == Destination::Across;
        all_alike
            && self.can_be_taken(object, seen)
            && Some(object) != self.avoided
            && !self.scene.is_covered(object, |id| seen.objects[id.index()].translation.vector)
    }

    /// Takes `object` for the one to take next, where it is as good as another.
    pub(crate) fn settle_for(&mut self, object: ObjectId, seen: &DisplayFrame) {
        if self.is_as_good(object, seen) {
            self.chosen = Some(object);
        }
    }

    /// Where `object` goes; the same for as long as it is carried.
    pub(crate) fn place(&mut self, object: ObjectId, seen: &DisplayFrame) -> Point {
        if let Some((_, spot)) = self.spot.filter(|(carried, _)| *carried == object) {
            return spot;
        }
        let own = self.scene.target(object).map(|target| target.centre);
        let spot = match (self.briefing.destination, own) {
            (Destination::OwnTarget, Some(centre)) => centre,
            (Destination::Shown, own) => match (&seen.asked, own) {
                (Some(TaskGoal::Disc { centre, .. }), _) => *centre,
                (_, Some(centre)) => centre,
                _ => self.free_spot(object, seen),
            },
            _ => self.free_spot(object, seen),
        };
        self.spot = Some((object, spot));
        spot
    }

    /// Whether `object` may be let go of where it is: it is past the partition, over where things are put down, and need not
    /// stand anywhere.
    pub(crate) fn may_fall(&self, object: ObjectId, seen: &DisplayFrame) -> bool {
        let at = seen.objects[object.index()].translation.vector;
        let region = &self.scene.put_down;
        self.briefing.destination == Destination::Across
            && self.side() * at.y > FALLS_PAST
            && (0..2).all(|k| at[k] > region.min[k] && at[k] < region.max[k])
    }

    /// It cannot be put down where it was to go: another place.
    pub(crate) fn give_up_place(&mut self, object: ObjectId, seen: &DisplayFrame) {
        let Some((carried, spot)) = self.spot.take() else { return };
        if carried == object && self.briefing.destination == Destination::Across {
            self.spots_in_vain.push(spot);
            self.place(object, seen);
        }
    }

    /// The hand is empty: what comes next gets a place of its own.
    pub(crate) fn put_down(&mut self) {
        self.spot = None;
        self.spots_in_vain.clear();
    }

    /// 1 where things go to y > 0, -1 where they go to y < 0.
    fn side(&self) -> f64 {
        if self.scene.put_down.centre(0.0).y < 0.0 { -1.0 } else { 1.0 }
    }

    fn can_be_taken(&self, id: ObjectId, seen: &DisplayFrame) -> bool {
        let Some(pose) = seen.objects.get(id.index()) else { return false };
        let at = pose.translation.vector;
        at.z > self.scene.table_height && self.side() * at.y < 0.0
    }

    /// The one with the most room around it, as far as others are not below it; of those as easy, the nearest to the partition.
    fn easiest(&self, seen: &DisplayFrame) -> Option<ObjectId> {
        let ids = || self.scene.ids().filter(|id| self.can_be_taken(*id, seen));
        let at = |id: &ObjectId| seen.objects[id.index()].translation.vector;
        let room = |id: &ObjectId| {
            let height = self.scene.objects[id.index()].shape.half_height();
            let beside = |other: &ObjectId| other != id && at(other).z > at(id).z - height;
            let to_others = ids().filter(beside).map(|other| (at(&other) - at(id)).xy().norm());
            to_others.fold(1.0, f64::min).min(self.to_wall(&at(id)))
        };
        let rank = |id: &ObjectId| ((room(id) / AS_EASY).floor(), -at(id).y.abs());
        let best = ids()
            .filter(|id| Some(*id) != self.avoided)
            .map(|id| (rank(&id), id))
            .reduce(|best, next| if next.0 > best.0 { next } else { best });
        best.map(|(_, id)| id).or(self.avoided.filter(|id| self.can_be_taken(*id, seen)))
    }

    /// To the outer edge of what mirrors the region where things are put down, metres.
    fn to_wall(&self, at: &Vector) -> f64 {
        let region = &self.scene.put_down;
        let furthest = region.min[1].abs().max(region.max[1].abs());
        (at.x - region.min[0]).min(region.max[0] - at.x).min(furthest - at.y.abs())
    }

    /// Just across the partition where there is room, or where there is most of it.
    fn free_spot(&self, object: ObjectId, seen: &DisplayFrame) -> Point {
        let region = self.scene.put_down;
        let (low, high) =
            (region.min[1].abs().min(region.max[1].abs()), region.max[1].abs().max(region.min[1].abs()));
        let share = |k: usize, count: usize| (k as f64 + 0.5) / count as f64;
        let spot = |k: usize| {
            let (row, column) = (k / SPOTS.0, k % SPOTS.0);
            let x = region.min[0] + (region.max[0] - region.min[0]) * share(column, SPOTS.0);
            let y = low + (high - low) * share(row, SPOTS.1);
            Point::new(x, self.side() * y, self.scene.table_height)
        };
        let room = |spot: &Point| {
            let others = seen.objects.iter().enumerate().filter(|(k, _)| *k != object.index());
            others
                .map(|(_, pose)| (pose.translation.vector - spot.coords).xy().norm())
                .fold(1.0, f64::min)
                .min(ENOUGH)
        };
        let middle = region.centre(self.scene.table_height);
        // Of those with as much room, the one nearest to the partition and to the middle between near and far wall.
        let rank = |spot: &Point| {
            let tried = self.spots_in_vain.iter().any(|other| (other - spot).norm() < 1e-6);
            (!tried, room(spot), -(spot.y.abs() + (spot.x - middle.x).abs()))
        };
        let spots = (0..SPOTS.0 * SPOTS.1).map(spot).map(|spot| (rank(&spot), spot));
        let best = spots.reduce(|best, next| if next.0 > best.0 { next } else { best });
        best.map_or(middle, |(_, spot)| spot)
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
            colour: [0.5; 3],
            ros_name: format!("cube{k}"),
            shape,
            mass: 0.01,
            friction: 0.4,
            friction_finger: 0.8,
            loose: false,
            pose: Pose::identity(),
        };
        Scene {
            fixed: vec![],
            objects: (0..count).map(object).collect(),
            targets: vec![],
            put_down: PlaceRegion { min: [-0.1, 0.02], max: [0.1, 0.25] },
            table_height: 1.0,
        }
    }

    fn told() -> Briefing {
        Briefing {
            title: String::new(),
            text: String::new(),
            order: Order::Any,
            destination: Destination::Across,
            score_name: String::new(),
            most: None,
            practice_secs: 0.0,
            limit_secs: 60.0,
        }
    }

    fn seen(places: &[[f64; 2]]) -> DisplayFrame {
        let poses = places.iter().map(|[x, y]| Pose::translation(*x, *y, 1.0125)).collect();
        DisplayFrame { objects: poses, ..crate::doubles::frame() }
    }

    #[test]
    fn who_may_choose_takes_what_has_room_and_another_one_when_that_does_not_work() {
        let mut choice = Choice::new(&scene(3), &told());
        let seen = seen(&[[0.0, -0.1], [0.0, -0.13], [0.0, -0.2]]);
        assert_eq!(choice.next(&seen), Some(ObjectId(2)), "the others stand close to each other");
        choice.give_up();
        assert_eq!(choice.next(&seen), Some(ObjectId(0)), "as much room as the other one, and nearer");
        assert_eq!(choice.next(&seen), Some(ObjectId(0)));
    }

    #[test]
    fn what_lies_below_takes_no_room_from_what_lies_on_it() {
        let mut choice = Choice::new(&scene(3), &told());
        let mut seen = seen(&[[0.0, -0.1], [0.0, -0.11], [0.0, -0.13]]);
        assert_eq!(
            choice.next(&seen),
            Some(ObjectId(2)),
            "it has the most room of those that stand side by side"
        );
        let mut choice = Choice::new(&scene(3), &told());
        seen.objects[0].translation.vector.z += 0.025;
        assert_eq!(choice.next(&seen), Some(ObjectId(0)), "it lies on another, and nothing is beside it");
    }

    #[test]
    fn where_all_are_alike_a_person_settles_for_another_one_that_can_be_taken() {
        let mut seen = seen(&[[0.0, -0.1], [0.0, -0.13], [0.0, 0.1], [0.0, -0.2]]);
        seen.objects[3].translation.vector.z = 0.0;
        let settles = |briefing: &Briefing, other: u16, avoids: bool| {
            let mut choice = Choice::new(&scene(4), briefing);
            let first = choice.next(&seen);
            choice.settle_for(ObjectId(other), &seen);
            if avoids {
                choice.give_up();
                choice.next(&seen);
                choice.settle_for(ObjectId(other), &seen);
            }
            (first != choice.next(&seen), choice.next(&seen) == Some(ObjectId(other)))
        };
        assert_eq!(settles(&told(), 1, false), (true, true));
        assert_eq!(settles(&told(), 2, false), (false, false), "it is across already");
        assert_eq!(settles(&told(), 3, false), (false, false), "it is on the floor");
        assert_eq!(settles(&told(), 1, true), (false, false), "it was taken in vain");
        let own = Briefing { destination: Destination::OwnTarget, ..told() };
        assert_eq!(settles(&own, 1, false), (false, false), "each belongs somewhere else");
    }

    #[test]
    fn what_is_across_or_on_the_floor_is_not_taken_again() {
        let mut choice = Choice::new(&scene(2), &told());
        let mut seen = seen(&[[0.0, 0.1], [0.0, -0.1]]);
        seen.objects[1].translation.vector.z = 0.0;
        assert_eq!(choice.next(&seen), None);
    }

    #[test]
    fn what_something_lies_on_is_not_as_good_and_what_is_past_the_partition_may_fall() {
        let mut choice = Choice::new(&scene(2), &told());
        let mut seen = seen(&[[0.0, -0.1], [0.005, -0.1]]);
        seen.objects[1].translation.vector.z += 0.025;
        choice.next(&seen);
        assert!(!choice.is_as_good(ObjectId(0), &seen), "the other one lies on it");
        assert!(choice.is_as_good(ObjectId(1), &seen));
        for (y, falls) in [(-0.1, false), (0.01, false), (0.1, true), (0.4, false)] {
            seen.objects[0].translation.vector.y = y;
            assert_eq!(choice.may_fall(ObjectId(0), &seen), falls, "{y}");
        }
        let own = Choice::new(&scene(2), &Briefing { destination: Destination::OwnTarget, ..told() });
        seen.objects[0].translation.vector.y = 0.1;
        assert!(!own.may_fall(ObjectId(0), &seen), "it has a place of its own");
    }

    #[test]
    fn a_place_that_cannot_be_had_is_given_up_for_another_one() {
        let mut choice = Choice::new(&scene(2), &told());
        let seen = seen(&[[0.0, 0.3], [0.0, -0.1]]);
        let mut spots = vec![choice.place(ObjectId(0), &seen)];
        for _ in 0..4 {
            choice.give_up_place(ObjectId(0), &seen);
            let spot = choice.place(ObjectId(0), &seen);
            assert!(!spots.contains(&spot), "{spot} was tried");
            spots.push(spot);
        }
    }

    #[test]
    fn a_spot_across_is_free_and_stays_while_it_is_carried_there() {
        let mut choice = Choice::new(&scene(2), &told());
        let mut seen = seen(&[[0.0, -0.1], [-0.066, 0.058]]);
        let spot = choice.place(ObjectId(0), &seen);
        assert!(
            spot.y > 0.02 && (spot.coords - seen.objects[1].translation.vector).xy().norm() > 0.05,
            "{spot}"
        );
        seen.objects[1] = Pose::translation(spot.x, spot.y, 1.0125);
        assert_eq!(choice.place(ObjectId(0), &seen), spot);
        choice.put_down();
        assert_ne!(choice.place(ObjectId(0), &seen), spot);
    }
}
