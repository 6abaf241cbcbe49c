//! What a hand in some posture has between two of its digits.

use crate::{ArmModel, Grasp, MimicCouplings, upright_axis};
use proact_types::{Point, Pose, Shape, Vector};

/// Air between the hand and the table that the object stands on, metres.
pub(super) const TABLE_CLEARANCE_M: f64 = 0.003;
/// So far from the edge of a face its contact is safe, metres.
const EDGE_MARGIN_M: f64 = 0.004;
/// Beyond the faces that they touch the digits may take up so much room among neighbours, metres: half as much again as
/// a fingertip of 15 mm.
const MAX_OVERHANG_ALONG_M: f64 = 0.022;
/// ... and so much beside the middle of the object, metres.
const MAX_OVERHANG_ACROSS_M: f64 = 0.013;
/// What is not meant to touch stays so far above object and neighbours, metres.
const TOP_CLEARANCE_M: f64 = 0.002;

/// The hand's shapes, and those of the two digits that pinch.
pub(super) struct PinchHand<'a> {
    pub model: &'a ArmModel,
    /// Links of palm and digits, with the digit that each belongs to.
    links: Vec<(usize, Option<usize>)>,
    /// The two digits, by their first links, and their last links.
    pub pair: [(usize, usize); 2],
    couplings: MimicCouplings,
    poses: Vec<Pose>,
    angles: Vec<f64>,
}

/// How the two digits hold a box of one width, all in the tip's frame, metres and rad.
#[derive(Clone, Debug)]
pub(super) struct TwoDigitGrip {
    /// From the first digit's contact to the second's, level, unit length.
    pub closing: Vector,
    /// Between the digits' surfaces along `closing`.
    pub gap_m: f64,
    /// Largest angle between the line through the contacts and the normals of the faces that they touch.
    pub contact_angle_rad: f64,
    /// Centre of the box.
    pub center: Point,
    /// From the height of the contacts to the centre's.
    pub height_offset_m: f64,
    /// How far the digits stick out beyond the box among its neighbours: along `closing`, and aside.
    pub overhang_m: [f64; 2],
    /// How deep other parts of the hand are in the box or below its top.
    pub obstruction_m: f64,
    /// Lowest part of the hand over the table.
    pub table_clearance_m: f64,
}

impl<'a> PinchHand<'a> {
    pub fn new(model: &'a ArmModel, pair: [usize; 2]) -> Self {
        let digits = model.digits();
        let palm = model.palm();
        let links = (0..model.links.len()).filter(|&l| palm[l] || digits[l].is_some());
        let last = |digit: usize| {
            let of_digit = |l: &usize| digits[*l] == Some(digit) && !model.links[*l].collisions.is_empty();
            (0..model.links.len()).rfind(of_digit).unwrap_or(digit)
        };
        Self {
            model,
            links: links.map(|l| (l, digits[l])).collect(),
            pair: pair.map(|digit| (digit, last(digit))),
            couplings: model.couplings(),
            poses: Vec::new(),
            angles: Vec::new(),
        }
    }

    /// Places the hand at `hand`, one position a hand joint, rad or m; joints that follow others go where these take them.
    pub fn set_posture(&mut self, hand: &[f64]) {
        let arm = self.model.arm_count();
        self.angles.clear();
        self.angles.resize(arm, 0.0);
        self.angles.extend_from_slice(hand);
        self.couplings.place(&mut self.angles[arm..]);
        self.model.hand_poses_into(&self.angles, &mut self.poses);
    }

    fn shapes(&self, link: usize) -> impl Iterator<Item = (Pose, Shape)> + '_ {
        self.model.links[link].collisions.iter().map(move |part| (self.poses[link] * part.pose, part.shape))
    }

    /// Middle of the part with which digit `which` of the pair touches.
    pub fn contact_pad(&self, which: usize) -> Point {
        let link = self.pair[which].1;
        let last = self.shapes(link).last().map_or(self.poses[link], |(pose, _)| pose);
        Point::from(last.translation.vector)
    }

    /// The point of digit `which` that is farthest along `direction`; of a face that is as far everywhere, the point nearest to
    /// `wanted`.
    pub fn support_point(&self, which: usize, direction: &Vector, wanted: &Point) -> Point {
        let digit = self.pair[which].0;
        let links = self.links.iter().filter(|(_, of)| *of == Some(digit)).map(|(link, _)| *link);
        let ends = links
            .flat_map(|link| self.shapes(link))
            .map(|(pose, shape)| (support(&pose, &shape, direction), pose, shape));
        let along = |p: &Point| p.coords.dot(direction);
        let farthest = ends.max_by(|a, b| along(&a.0).total_cmp(&along(&b.0)));
        farthest.map_or_else(
            || self.contact_pad(which),
            |(point, pose, shape)| nearest_on_face(&pose, &shape, direction, wanted).unwrap_or(point),
        )
    }

    /// What is between the pair for a box of `width` on a table, the hand rolled by `roll`; none while they are in one
    /// place.
    pub fn grip(&self, width: f64, roll: f64) -> Option<TwoDigitGrip> {
        let up = upright_axis(roll, 0.0);
        let between = self.contact_pad(1) - self.contact_pad(0);
        let closing = (between - up * up.dot(&between)).try_normalize(1e-6)?;
        Some(self.grip_along(width, &up, &closing))
    }

    /// As [`PinchHand::hold`], with the faces across `closing`, level and of unit length.
    pub fn grip_along(&self, width: f64, up: &Vector, closing: &Vector) -> TwoDigitGrip {
        let aside = up.cross(closing);
        // The middle of the box at the height of what stands on the table, for fingers whose pads are flat.
        let between = nalgebra::center(&self.contact_pad(0), &self.contact_pad(1));
        let level = self.lowest_height(up) + 0.5 * width - TABLE_CLEARANCE_M;
        let wanted = between + up * (level - between.coords.dot(up));
        let (first, second) =
            (self.support_point(0, closing, &wanted), self.support_point(1, &-closing, &wanted));
        let line = second - first;
        let off = line.dot(up).hypot(line.dot(&aside));
        let middle = nalgebra::center(&first, &second);
        // The hand is as low as the table allows, but no lower than the middle of the box.
        let low = self.lowest_height(up);
        let height = middle.coords.dot(up).min(low + 0.5 * width - TABLE_CLEARANCE_M);
        let center = middle + up * (height - middle.coords.dot(up));
        let mut hold = TwoDigitGrip {
            closing: *closing,
            gap_m: line.dot(closing),
            contact_angle_rad: off.atan2(width),
            center,
            height_offset_m: middle.coords.dot(up) - height,
            overhang_m: [0.0; 2],
            obstruction_m: 0.0,
            table_clearance_m: low - (height - 0.5 * width),
        };
        for &(link, digit) in &self.links {
            let tip_of_pair = self.pair.iter().any(|(_, last)| *last == link);
            for (pose, shape) in self.shapes(link) {
                let extent = |direction: &Vector| {
                    let end = |d: Vector| (support(&pose, &shape, &d) - center).dot(&d);
                    (-end(-direction), end(*direction))
                };
                let above_top = extent(up).0 - 0.5 * width - TOP_CLEARANCE_M;
                if above_top >= 0.0 {
                    continue;
                }
                let (ahead, beside) = (extent(closing), extent(&aside));
                for (bead, radius) in bounding_spheres(&pose, &shape) {
                    let off = bead - center;
                    if off.dot(up) - radius < 0.5 * width + TOP_CLEARANCE_M {
                        hold.overhang_m[0] =
                            hold.overhang_m[0].max(off.dot(closing).abs() + radius - 0.5 * width);
                        hold.overhang_m[1] = hold.overhang_m[1].max(off.dot(&aside).abs() + radius);
                    }
                }
                // The last links press on the faces; whatever else is in the box is in the way.
                let inside = |(low, high): (f64, f64)| (high + 0.5 * width).min(0.5 * width - low);
                let depth = inside(ahead).min(inside(beside)).min(-above_top);
                let in_pair = digit.is_some_and(|digit| self.pair.iter().any(|(of, _)| *of == digit));
                if !tip_of_pair && (depth > 0.0 || !in_pair) {
                    hold.obstruction_m = hold.obstruction_m.max(if in_pair { depth } else { -above_top });
                }
            }
        }
        hold
    }

    /// Lowest point of the hand along `up`.
    pub fn lowest_height(&self, up: &Vector) -> f64 {
        let shapes = self.links.iter().flat_map(|(link, _)| self.shapes(*link));
        shapes.map(|(pose, shape)| support(&pose, &shape, &-up).coords.dot(up)).fold(f64::INFINITY, f64::min)
    }

    /// Lowest point of the links of `digit`, by its first link.
    pub fn lowest_height_of(&self, digit: usize, up: &Vector) -> f64 {
        let links = self.links.iter().filter(|(_, of)| *of == Some(digit));
        let shapes = links.flat_map(|(link, _)| self.shapes(*link));
        shapes.map(|(pose, shape)| support(&pose, &shape, &-up).coords.dot(up)).fold(f64::INFINITY, f64::min)
    }

    /// How deep digits of the pair are in other digits, metres: shapes as the capsules within them.
    pub fn digit_overlap(&self) -> f64 {
        let capsules = |link: usize| {
            self.shapes(link).map(|(pose, shape)| {
                let (half, radius) = match shape {
                    Shape::Box { size } => (0.5 * size[2], 0.5 * size[0].min(size[1])),
                    Shape::Sphere { radius } => (0.0, radius),
                    Shape::Cylinder { radius, length } => ((0.5 * length - radius).max(0.0), radius),
                    Shape::Capsule { radius, length } => (0.5 * length, radius),
                };
                (pose * Point::new(0.0, 0.0, -half), pose * Point::new(0.0, 0.0, half), radius)
            })
        };
        let mut deepest = 0.0_f64;
        for &(link, digit) in &self.links {
            let Some(mine) = digit.filter(|digit| self.pair.iter().any(|(of, _)| of == digit)) else {
                continue;
            };
            for &(other, of) in &self.links {
                let Some(theirs) = of.filter(|of| *of != mine) else { continue };
                // Roots of digits are next to each other in the palm.
                if link == mine && other == theirs {
                    continue;
                }
                for a in capsules(link) {
                    for b in capsules(other) {
                        deepest = deepest.max(a.2 + b.2 - segment_distance(&a.0, &a.1, &b.0, &b.1));
                    }
                }
            }
        }
        deepest
    }
}

impl TwoDigitGrip {
    /// How far this is from a grasp of a box of `width` with a gap of `gap`: zero is a good one. Each fault counts one
    /// where it is a millimetre, or the line between the contacts is five degrees off.
    pub fn cost(&self, width: f64, gap: f64) -> f64 {
        let squared_millimeters = |over: f64| (over.max(0.0) * 1e3).powi(2);
        let line = (self.contact_angle_rad.to_degrees() / 5.0).powi(2);
        line + 4.0 * squared_millimeters((self.gap_m - gap).abs())
            + squared_millimeters(self.height_offset_m - (0.5 * width - EDGE_MARGIN_M))
            + 0.05 * squared_millimeters(self.height_offset_m)
            + 0.3 * squared_millimeters(self.overhang_m[0] - MAX_OVERHANG_ALONG_M)
            + 0.3 * squared_millimeters(self.overhang_m[1] - MAX_OVERHANG_ACROSS_M)
            + squared_millimeters(self.obstruction_m)
    }

    /// True if the contacts are on the faces, and nothing else is in the way.
    pub fn is_clear(&self, width: f64) -> bool {
        self.height_offset_m <= 0.5 * width - 0.5 * EDGE_MARGIN_M
            && self.obstruction_m < 1e-3
            && self.table_clearance_m > 0.5 * TABLE_CLEARANCE_M
    }
}

/// Balls along a shape's longest axis that are about as thick as it.
fn bounding_spheres(pose: &Pose, shape: &Shape) -> impl Iterator<Item = (Point, f64)> {
    let (axis, radius) = match *shape {
        Shape::Box { size } => {
            let longest_axis = (0..3).fold(0, |l, k| if size[k] > size[l] { k } else { l });
            let radius = 0.5 * (size[0] + size[1] + size[2] - size[longest_axis]) * 0.5;
            let mut axis = Vector::zeros();
            axis[longest_axis] = (0.5 * size[longest_axis] - radius).max(0.0);
            (axis, radius)
        }
        Shape::Sphere { radius } => (Vector::zeros(), radius),
        Shape::Cylinder { radius, length } => (Vector::z() * (0.5 * length - radius).max(0.0), radius),
        Shape::Capsule { radius, length } => (Vector::z() * 0.5 * length, radius),
    };
    let pose = *pose;
    (-2..=2).map(move |k| (pose * Point::from(axis * (f64::from(k) / 2.0)), radius))
}

/// The point of a shape that is farthest along `direction`.
fn support(pose: &Pose, shape: &Shape, direction: &Vector) -> Point {
    let d = pose.inverse_transform_vector(direction);
    let local = match *shape {
        Shape::Box { size } => {
            Vector::new(0.5 * size[0].copysign(d.x), 0.5 * size[1].copysign(d.y), 0.5 * size[2].copysign(d.z))
        }
        Shape::Sphere { radius } => d * radius,
        Shape::Cylinder { radius, length } => {
            let across = Vector::new(d.x, d.y, 0.0).try_normalize(1e-9).unwrap_or_default();
            // A flat end has no farthest point: its middle stands for it.
            across * radius + Vector::z() * if d.z.abs() < 1e-9 { 0.0 } else { 0.5 * length.copysign(d.z) }
        }
        Shape::Capsule { radius, length } => d * radius + Vector::z() * 0.5 * length.copysign(d.z),
    };
    pose * Point::from(local)
}

/// The point nearest to `wanted` on the face of a box that is across `direction`; none of other shapes, and if no face is.
fn nearest_on_face(pose: &Pose, shape: &Shape, direction: &Vector, wanted: &Point) -> Option<Point> {
    /// Sine of the angle at which a face is still across a direction.
    const FLAT: f64 = 0.02;
    let Shape::Box { size } = *shape else { return None };
    let d = pose.inverse_transform_vector(direction);
    let axis = d.iamax();
    let across = (0..3).filter(|&k| k != axis).map(|k| d[k] * d[k]).sum::<f64>().sqrt();
    if across > FLAT {
        return None;
    }
    let local = pose.inverse_transform_point(wanted);
    let mut point = Point::origin();
    for k in 0..3 {
        let half = 0.5 * size[k];
        point[k] = if k == axis { half.copysign(d[k]) } else { local[k].clamp(-half, half) };
    }
    Some(pose * point)
}

/// Least distance between two segments (Ericson, Real-Time Collision Detection, section 5.1.9).
fn segment_distance(a: &Point, b: &Point, c: &Point, d: &Point) -> f64 {
    let (u, v, w) = (b - a, d - c, a - c);
    let (uu, vv, uv, uw, vw) = (u.norm_squared(), v.norm_squared(), u.dot(&v), u.dot(&w), v.dot(&w));
    let across = uu * vv - uv * uv;
    let s = if across > 1e-15 { ((uv * vw - vv * uw) / across).clamp(0.0, 1.0) } else { 0.0 };
    let mut t = if vv > 1e-15 { (uv * s + vw) / vv } else { 0.0 };
    let mut s = s;
    if !(0.0..=1.0).contains(&t) {
        t = t.clamp(0.0, 1.0);
        s = if uu > 1e-15 { ((uv * t - uw) / uu).clamp(0.0, 1.0) } else { 0.0 };
    } else if across <= 1e-15 && uu > 1e-15 {
        s = ((uv * t - uw) / uu).clamp(0.0, 1.0);
    }
    ((a + u * s) - (c + v * t)).norm()
}

/// The withdrawal and the ranges of roll that a hand's other grasps have: a new one keeps to them.
pub(super) fn reference_grasp(model: &ArmModel) -> Grasp {
    model.widest_grasp().clone()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn segments_are_as_far_apart_as_their_nearest_points() {
        let p = Point::new;
        let (a, b) = (p(0.0, 0.0, 0.0), p(2.0, 0.0, 0.0));
        for (c, d, expected) in [
            (p(1.0, -1.0, 0.5), p(1.0, 1.0, 0.5), 0.5),
            (p(3.0, 0.0, 0.0), p(4.0, 1.0, 0.0), 1.0),
            (p(-1.0, 0.7, 0.0), p(5.0, 0.7, 0.0), 0.7),
            (p(1.0, 0.3, 0.0), p(1.0, 0.3, 0.0), 0.3),
        ] {
            assert!((segment_distance(&a, &b, &c, &d) - expected).abs() < 1e-12, "{c} {d}");
            assert!((segment_distance(&c, &d, &a, &b) - expected).abs() < 1e-12, "{c} {d}");
        }
    }

    #[test]
    fn the_farthest_point_of_a_shape_is_on_it_and_no_corner_is_farther() {
        let pose = Pose::translation(0.1, 0.0, 0.0) * Pose::rotation(Vector::new(0.3, -0.5, 0.9));
        let d = Vector::new(0.2, -0.7, 0.4).normalize();
        for (shape, farthest) in
            [(Shape::Sphere { radius: 0.02 }, 0.02), (Shape::Capsule { radius: 0.01, length: 0.0 }, 0.01)]
        {
            assert!(((support(&pose, &shape, &d) - pose * Point::origin()).dot(&d) - farthest).abs() < 1e-12);
        }
        let size = [0.02, 0.03, 0.05];
        let far = support(&pose, &Shape::Box { size }, &d).coords.dot(&d);
        for k in 0..8 {
            let sign = |bit: usize| if k >> bit & 1 == 0 { 0.5 } else { -0.5 };
            let corner = pose * Point::new(size[0] * sign(0), size[1] * sign(1), size[2] * sign(2));
            assert!(corner.coords.dot(&d) <= far + 1e-12);
        }
    }
}
