use crate::{Point, Pose, Vector};
use serde::{Deserialize, Serialize};

/// A convex shape, metres, centred in its own frame; axes along z.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(tag = "type", rename_all = "snake_case")]
pub enum Shape {
    /// Full side lengths.
    Box {
        /// Along x, y, z.
        size: [f64; 3],
    },
    /// A ball.
    Sphere {
        /// Radius.
        radius: f64,
    },
    /// Axis along z.
    Cylinder {
        /// Radius.
        radius: f64,
        /// Full length along z, flat ends.
        length: f64,
    },
    /// Axis along z.
    Capsule {
        /// Radius of the tube and of the round ends.
        radius: f64,
        /// Length of the tube without the round ends.
        length: f64,
    },
}

/// Surfaces whose heights differ by less than this are one, metres.
const SAME_SHELF_HEIGHT_M: f64 = 1e-4;

/// Most objects that a scene may have.
pub const MAX_OBJECTS: usize = 512;

/// A movable object of the scene, by its place in [`Scene::objects`]. All arrays over objects have that order.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(transparent)]
pub struct ObjectId(pub u16);

impl ObjectId {
    /// The object at `index` of [`Scene::objects`].
    ///
    /// # Panics
    /// If `index` is not below [`MAX_OBJECTS`]; scenes with more objects are refused when they are made.
    pub fn new(index: usize) -> Self {
        assert!(index < MAX_OBJECTS, "object {index}, a scene has at most {MAX_OBJECTS}");
        Self(index as u16)
    }

    /// Its place in [`Scene::objects`].
    pub fn index(self) -> usize {
        usize::from(self.0)
    }
}

/// Some of the objects of a scene.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(from = "Vec<ObjectId>", into = "Vec<ObjectId>")]
pub struct ObjectSet([u64; MAX_OBJECTS / 64]);

impl ObjectSet {
    /// The first `count` objects.
    pub fn first(count: usize) -> Self {
        (0..count).map(ObjectId::new).collect()
    }

    /// True if `object` is one of them.
    pub fn contains(&self, object: ObjectId) -> bool {
        self.0.get(object.index() / 64).is_some_and(|word| word >> (object.index() % 64) & 1 == 1)
    }

    /// Takes `object` in. One that no scene can have is left out.
    pub fn insert(&mut self, object: ObjectId) {
        if let Some(word) = self.0.get_mut(object.index() / 64) {
            *word |= 1 << (object.index() % 64);
        }
    }

    /// Takes `object` out.
    pub fn remove(&mut self, object: ObjectId) {
        if let Some(word) = self.0.get_mut(object.index() / 64) {
            *word &= !(1 << (object.index() % 64));
        }
    }

    /// How many they are.
    pub fn len(&self) -> usize {
        self.0.iter().map(|word| word.count_ones() as usize).sum()
    }

    /// True if they are none.
    pub fn is_empty(&self) -> bool {
        self.0 == [0; MAX_OBJECTS / 64]
    }

    /// They, in the order of the scene.
    pub fn iter(&self) -> impl Iterator<Item = ObjectId> + '_ {
        self.0.iter().enumerate().flat_map(|(word_index, &word)| {
            // From the lowest bit that is left to the next one.
            let words = std::iter::successors(Some(word), |left| Some(left & left.wrapping_sub(1)));
            let bits = words.take_while(|left| *left != 0).map(|left| left.trailing_zeros() as usize);
            bits.map(move |bit| ObjectId::new(64 * word_index + bit))
        })
    }
}

impl FromIterator<ObjectId> for ObjectSet {
    fn from_iter<I: IntoIterator<Item = ObjectId>>(objects: I) -> Self {
        let mut set = Self::default();
        objects.into_iter().for_each(|object| set.insert(object));
        set
    }
}

impl From<Vec<ObjectId>> for ObjectSet {
    fn from(objects: Vec<ObjectId>) -> Self {
        objects.into_iter().collect()
    }
}

impl From<ObjectSet> for Vec<ObjectId> {
    fn from(set: ObjectSet) -> Self {
        set.iter().collect()
    }
}

/// An immovable body of the scene, such as a wall of the box.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct SceneObject {
    /// Unique name.
    pub name: String,
    /// Its shape.
    pub shape: Shape,
    /// `world_from_object`.
    #[cfg_attr(feature = "ts", ts(as = "crate::typescript::Pose"))]
    pub pose: Pose,
    /// Coulomb friction coefficient against blocks.
    pub friction: f64,
}

/// A movable object.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[cfg_attr(feature = "ts", ts(rename = "SceneThing"))]
pub struct Object {
    /// Unique name in results and plans, such as `red1`.
    pub name: String,
    /// What is painted on it; empty for nothing.
    pub label: String,
    /// Red, green, blue, 0 to 1 (sRGB).
    #[serde(rename = "colour")]
    pub color: [f64; 3],
    /// Name of its model and tf frame on a ROS graph.
    pub ros_name: String,
    /// Its shape; the origin is the centre of mass.
    pub shape: Shape,
    /// Mass, kg, spread evenly.
    pub mass: f64,
    /// Friction against table, walls and other objects.
    pub friction: f64,
    /// Friction against fingers.
    #[serde(rename = "friction_finger")]
    pub finger_friction: f64,
    /// It may be pushed about and dropped, as the cubes of a heap: a plan that finds no grip without a contact may touch it on
    /// the straight way into one and out, and one that cannot put it down may let it fall.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub loose: bool,
    /// `world_from_object` at the start: resting.
    #[cfg_attr(feature = "ts", ts(as = "crate::typescript::Pose"))]
    pub pose: Pose,
}

impl Object {
    /// An object with the friction of the modified box-and-blocks test: 0.4 against the table, 0.8 against fingers.
    pub fn with_default_friction(name: &str, shape: Shape, mass: f64, pose: Pose) -> Self {
        Self {
            name: name.to_owned(),
            label: String::new(),
            color: [0.5; 3],
            ros_name: name.to_owned(),
            shape,
            mass,
            friction: 0.4,
            finger_friction: 0.8,
            loose: false,
            pose,
        }
    }
}

/// Where an object has to go.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct Target {
    /// The object that belongs here.
    pub object: ObjectId,
    /// Centre of the disc on the table top, in `world`.
    #[cfg_attr(feature = "ts", ts(as = "[f64; 3]"))]
    #[serde(rename = "centre")]
    pub center: Point,
    /// Radius of the disc, metres: an object counts with its centre above it.
    pub radius: f64,
}

/// The part of the table top on which an object may be put down, along the axes of `world`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(deny_unknown_fields)]
pub struct PlaceRegion {
    /// Smallest x and y, metres.
    pub min: [f64; 2],
    /// Largest x and y, metres.
    pub max: [f64; 2],
}

impl PlaceRegion {
    /// The point of the region nearest to `point`, at `height`.
    pub fn clamp(&self, point: &Point, height: f64) -> Point {
        Point::new(point.x.clamp(self.min[0], self.max[0]), point.y.clamp(self.min[1], self.max[1]), height)
    }

    /// Its middle, at `height`.
    pub fn center(&self, height: f64) -> Point {
        Point::new((self.min[0] + self.max[0]) / 2.0, (self.min[1] + self.max[1]) / 2.0, height)
    }
}

/// Everything in the room except the arm.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct Scene {
    /// Table, walls, partition, legs, floor.
    pub fixed: Vec<SceneObject>,
    /// What can be moved.
    pub objects: Vec<Object>,
    /// Where objects belong; some may have no such place.
    pub targets: Vec<Target>,
    /// Where objects may be put down.
    #[serde(rename = "put_down")]
    pub place_region: PlaceRegion,
    /// Height of the table top, metres in `world`.
    pub table_height: f64,
}

impl Scene {
    /// Its objects' ids, in their order.
    pub fn ids(&self) -> impl ExactSizeIterator<Item = ObjectId> + Clone + use<> {
        (0..self.objects.len()).map(ObjectId::new)
    }

    /// The object called `name`.
    pub fn find_object(&self, name: &str) -> Option<ObjectId> {
        self.objects.iter().position(|object| object.name == name).map(ObjectId::new)
    }

    /// The name of `object`; `object 7` for one that the scene does not have.
    pub fn name(&self, object: ObjectId) -> String {
        let known = self.objects.get(object.index()).map(|object| object.name.clone());
        known.unwrap_or_else(|| format!("object {}", object.0))
    }

    /// Whether one of the other objects lies on `object`, when their centres are where `center` says, in `world`.
    pub fn is_covered(&self, object: ObjectId, center: impl Fn(ObjectId) -> Vector) -> bool {
        let shape = self.objects[object.index()].shape;
        let at = center(object);
        self.ids().filter(|other| *other != object).any(|other| {
            let offset = center(other) - at;
            offset.z >= shape.half_height() && offset.xy().norm() <= shape.half_width()
        })
    }

    /// Where something can be put down other than on the table: the tops of boxes that do not move, at whose height something
    /// stands at the start or has its target. Region and height, each once, as they stand in the scene.
    pub fn shelves(&self) -> Vec<(PlaceRegion, f64)> {
        let foot = |object: &Object| {
            let at = object.pose.translation.vector;
            Point::new(at.x, at.y, at.z - object.shape.half_height())
        };
        let used = self.targets.iter().map(|target| target.center).chain(self.objects.iter().map(foot));
        let used: Vec<Point> =
            used.filter(|at| (at.z - self.table_height).abs() > SAME_SHELF_HEIGHT_M).collect();
        let shelf = |body: &SceneObject| {
            let Shape::Box { size } = body.shape else { return None };
            let at = body.pose.translation.vector;
            let top = at.z + size[2] / 2.0;
            let on = |point: &Point| {
                (point.z - top).abs() < SAME_SHELF_HEIGHT_M
                    && (0..2).all(|k| (point[k] - at[k]).abs() <= size[k] / 2.0)
            };
            let [min, max] = [-0.5, 0.5].map(|half| [at.x + half * size[0], at.y + half * size[1]]);
            used.iter().any(on).then_some((PlaceRegion { min, max }, top))
        };
        self.fixed.iter().filter_map(shelf).collect()
    }

    /// Where `object` belongs; none if it has no place of its own.
    pub fn target(&self, object: ObjectId) -> Option<&Target> {
        self.targets.iter().find(|target| target.object == object)
    }
}

impl Shape {
    /// Half of its height where it stands upright, metres.
    pub fn half_height(&self) -> f64 {
        match *self {
            Shape::Box { size } => size[2] / 2.0,
            Shape::Sphere { radius } => radius,
            Shape::Cylinder { length, .. } => length / 2.0,
            Shape::Capsule { radius, length } => length / 2.0 + radius,
        }
    }

    /// How far it reaches from its axis where it stands upright, metres: the narrowest side of a box counts.
    pub fn half_width(&self) -> f64 {
        match *self {
            Shape::Box { size } => size[0].min(size[1]) / 2.0,
            Shape::Sphere { radius } | Shape::Cylinder { radius, .. } | Shape::Capsule { radius, .. } => {
                radius
            }
        }
    }

    /// Least width that fingers close on while it stands upright, metres.
    pub fn grip_width(&self) -> f64 {
        2.0 * self.half_width()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_set_holds_what_was_put_in_in_the_order_of_the_scene_and_survives_its_text() {
        let set: ObjectSet = [70, 3, 511, 64, 3, 63].map(ObjectId::new).into_iter().collect();
        assert_eq!(set.iter().map(ObjectId::index).collect::<Vec<_>>(), [3, 63, 64, 70, 511]);
        assert_eq!((set.len(), ObjectSet::first(4).len(), ObjectSet::default().is_empty()), (5, 4, true));
        assert!(
            set.contains(ObjectId(70)) && !set.contains(ObjectId(71)) && !set.contains(ObjectId(u16::MAX))
        );
        let text = serde_json::to_string(&set).expect("writes");
        assert_eq!(text, "[3,63,64,70,511]");
        assert_eq!(serde_json::from_str::<ObjectSet>(&text).expect("reads"), set);
    }

    #[test]
    fn shelves_are_tops_at_another_height_on_which_something_stands_or_belongs() {
        let board = |name: &str, x: f64, top: f64| SceneObject {
            name: name.to_owned(),
            shape: Shape::Box { size: [0.2, 0.1, 0.02] },
            pose: Pose::translation(x, 0.0, top - 0.01),
            friction: 0.4,
        };
        let cube = Shape::Box { size: [0.05; 3] };
        let at = |x: f64, foot: f64| {
            Object::with_default_friction("cube", cube, 0.1, Pose::translation(x, 0.0, foot + 0.025))
        };
        let target = Target { object: ObjectId(0), center: Point::new(1.05, 0.04, 1.3), radius: 0.05 };
        let scene = Scene {
            fixed: vec![
                board("table", 0.0, 1.0),
                board("high", 1.0, 1.3),
                board("low", 2.0, 0.8),
                board("free", 3.0, 1.1),
            ],
            objects: vec![at(0.0, 1.0), at(2.0, 0.8)],
            targets: vec![target],
            table_height: 1.0,
            ..Scene::default()
        };
        let shelves = scene.shelves();
        let heights: Vec<f64> = shelves.iter().map(|(_, height)| *height).collect();
        assert_eq!(heights.len(), 2, "neither the table nor a board that nothing is for: {shelves:?}");
        assert!((heights[0] - 1.3).abs() < 1e-12 && (heights[1] - 0.8).abs() < 1e-12);
        assert!((shelves[0].0.min[0] - 0.9).abs() < 1e-12 && (shelves[0].0.max[1] - 0.05).abs() < 1e-12);
    }

    #[test]
    fn defect_44_a_place_outside_the_region_goes_to_its_nearest_point() {
        let region = PlaceRegion { min: [-0.125, 0.0275], max: [0.125, 0.275] };
        let inside = Point::new(0.05, 0.2, 1.0);
        assert_eq!(region.clamp(&inside, 1.0), inside);
        assert_eq!(region.clamp(&Point::new(9.0, 0.1, 1.0), 1.0), Point::new(0.125, 0.1, 1.0));
        assert_eq!(region.clamp(&Point::new(-9.0, -9.0, 2.0), 1.0), Point::new(-0.125, 0.0275, 1.0));
    }
}
