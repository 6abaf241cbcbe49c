//! The person who wears the arm, as obstacles: trunk, head and legs.

use nalgebra::{Unit, UnitQuaternion};
use proact_types::{Obstacle, Point, Pose, Shape, Vector};

/// Sizes of a person, metres. Points are in the frame of the shoulder (`base_link`): x ahead, y left, z up, upright.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PersonGeometry {
    /// Pivot of the trunk between the hips. The set-ups have it half a shoulder breadth (0.18 m) inwards of the
    /// shoulder and 0.45 m below.
    pub hip: Vector,
    /// Middle of the head: level with the eyes of the set-ups (0.25 m above the shoulder), over the hip.
    pub head: Vector,
    /// Radius of the head. 0.13 of the stature is the height of head and neck (Drillis and Contini 1966); a head
    /// is about 0.15 m wide and 0.19 m long, so a ball of 0.095 holds it.
    pub head_radius: f64,
    /// Radius of the trunk: half the depth of a chest, 0.22 m (assumed). A trunk is wider than deep; what is left
    /// out beside it is where the upper arm hangs.
    pub trunk_radius: f64,
    /// Length of a thigh: 0.245 of a stature of 1.75 m (Drillis and Contini 1966).
    pub thigh_length: f64,
    /// Radius of a thigh (assumed).
    pub thigh_radius: f64,
    /// Length of a lower leg with the foot: 0.285 of the stature (Drillis and Contini 1966).
    pub shank_length: f64,
    /// Radius of a lower leg (assumed).
    pub shank_radius: f64,
    /// Distance of each hip joint from the midline: half of 0.191 of the stature, the breadth of the hips
    /// (Drillis and Contini 1966), less the radius of the thigh.
    pub hip_offset: f64,
    /// A seated person's thighs are level and lie this far below the pivot of the trunk, so that they fit under a
    /// table (assumed). A standing person's legs hang straight down.
    pub seated: bool,
}

/// How far the middle of a seated thigh lies below the trunk's pivot, metres: it clears the table slab (0.985 m)
/// in front of a pivot at 0.995 m.
const THIGH_DROP: f64 = 0.11;

impl PersonGeometry {
    /// A seated person of 1.75 m with the right arm amputated; the arm is on the right.
    pub const SEATED: PersonGeometry = PersonGeometry {
        hip: Vector::new(0.0, 0.18, -0.45),
        head: Vector::new(0.0, 0.18, 0.25),
        head_radius: 0.095,
        trunk_radius: 0.11,
        thigh_length: 0.43,
        thigh_radius: 0.07,
        shank_length: 0.5,
        shank_radius: 0.05,
        hip_offset: 0.097,
        seated: true,
    };
    /// The same person with the arm on the left.
    pub fn mirrored(&self) -> Self {
        let across = |v: Vector| Vector::new(v.x, -v.y, v.z);
        Self { hip: across(self.hip), head: across(self.head), ..*self }
    }

    /// The same person standing.
    pub const STANDING: PersonGeometry = PersonGeometry { seated: false, ..Self::SEATED };
}

/// Trunk, head and legs of `person` whose shoulder is at `world_from_base`, as capsules and a ball in `world`.
///
/// Trunk and head lean and turn with the shoulder about the hip; the legs keep still and point along x of `world`,
/// where the set-ups have the box. The names are `person_trunk`, `person_head`, `person_thigh_left` and so on. The
/// trunk ends one radius below the shoulders' height, so that the socket has room.
///
/// Known weakness: no neck, no left arm, no clothes; knees keep straight below a standing person.
pub fn person_obstacles(world_from_base: &Pose, person: &PersonGeometry) -> Vec<Obstacle> {
    let hip = world_from_base * Point::from(person.hip);
    let head = world_from_base * Point::from(person.head);
    let up = (head - hip).normalize();
    let trunk_top = world_from_base * Point::new(person.hip.x, person.hip.y, -person.trunk_radius);
    let mut all = vec![
        capsule("person_trunk", hip + up * person.trunk_radius, trunk_top, person.trunk_radius),
        Obstacle {
            name: "person_head".to_owned(),
            shape: Shape::Sphere { radius: person.head_radius },
            pose: Pose::translation(head.x, head.y, head.z),
            loose: false,
        },
    ];
    for (side, offset) in [("left", person.hip_offset), ("right", -person.hip_offset)] {
        let root = hip + Vector::new(0.0, offset, -THIGH_DROP);
        let down = -Vector::z();
        let ahead = if person.seated { Vector::x() } else { down };
        let knee = root + ahead * person.thigh_length;
        let foot = knee + down * person.shank_length;
        all.push(capsule(&format!("person_thigh_{side}"), root, knee, person.thigh_radius));
        all.push(capsule(&format!("person_shank_{side}"), knee, foot, person.shank_radius));
    }
    all
}

/// A tube with round ends whose ends are centred at `a` and `b`.
fn capsule(name: &str, a: Point, b: Point, radius: f64) -> Obstacle {
    let along = b - a;
    let turn =
        Unit::try_new(along, 1e-9).and_then(|axis| UnitQuaternion::rotation_between(&Vector::z(), &axis));
    // Upside down has no shortest turn; any half turn about a level axis will do.
    let turn =
        turn.unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector::x_axis(), std::f64::consts::PI));
    let middle = a + along / 2.0;
    Obstacle {
        name: name.to_owned(),
        shape: Shape::Capsule { radius, length: along.norm().max(1e-3) },
        pose: Pose::from_parts(middle.coords.into(), turn),
        loose: false,
    }
}
