//! Primitives around a cloud of triangles.
//!
//! A link's mesh becomes a few boxes, cylinders and balls that enclose all of its corners. They are what both engines, the planner
//! and the display know; a shape is a few numbers, so a tick costs the same as for an arm that was described with primitives. Convex
//! hulls would follow a surface more closely, at twenty times the cost of a contact; a part that is badly filled is cut in two
//! instead, as long as that helps.

use super::meshes::TriangleMesh;
use nalgebra::{Matrix3, Point3, Rotation3, SymmetricEigen, Translation3, UnitQuaternion, Vector3};
use parry3d_f64::{math::Vector as ParryVector, transformation::try_convex_hull};
use proact_types::{Pose, Shape};
use std::collections::{BTreeMap, BTreeSet};

/// Most primitives of a mesh.
pub(crate) const MAX_PIECES: usize = 6;
/// A cut must save so much of the volume.
const MIN_SAVING: f64 = 0.12;
/// Weight of what a cut saves at once beside what it saves with another one.
const SOON: f64 = 0.1;
/// Planes that are tried along an axis.
const CUTS: usize = 5;
/// Of a mesh with more triangles, corners are joined on a grid with this number of cells along its longest side.
const MAX_TRIANGLES: usize = 1500;
const GRID: f64 = 40.0;
/// No side of a shape is thinner, metres: sheets would fall through each other.
const MIN_THICKNESS_M: f64 = 1e-3;

/// Primitives that enclose a mesh, and how well.
#[derive(Clone, Debug)]
pub(crate) struct Fit {
    /// In the frame of the mesh.
    pub(crate) shapes: Vec<(Pose, Shape)>,
    /// Volume of the primitives, m^3; where they overlap it counts twice.
    pub(crate) volume: f64,
    /// Volume of the convex hulls of the pieces, m^3.
    pub(crate) hull_volume: f64,
}

/// The triangles of a piece with the primitive around them.
struct Piece {
    triangles: Vec<[Point3<f64>; 3]>,
    pose: Pose,
    shape: Shape,
    volume: f64,
    hull: f64,
}

/// Encloses `mesh`, scaled by `scale`; none if it has no extent.
pub(crate) fn enclose(mesh: &TriangleMesh, scale: [f64; 3]) -> Option<Fit> {
    let scale = Vector3::from(scale);
    let corner = |index: usize| Point3::from(mesh.points[index].coords.component_mul(&scale));
    let triangles: Vec<[Point3<f64>; 3]> = mesh.triangles.iter().map(|t| t.map(corner)).collect();
    let mut pieces = vec![Piece::around(coarsen(triangles))?];
    while pieces.len() + 1 < MAX_PIECES {
        let whole: f64 = pieces.iter().map(|piece| piece.volume).sum();
        let cuts = pieces.iter().enumerate().filter_map(|(k, piece)| Some((k, piece.best_cut()?)));
        let best = cuts.max_by(|a, b| a.1.saving.total_cmp(&b.1.saving));
        let Some((worst, cut)) = best.filter(|(_, cut)| cut.saving >= MIN_SAVING * whole) else { break };
        let [Some(below), Some(above)] = pieces[worst].split(cut.axis, cut.at).map(Piece::around) else {
            break;
        };
        pieces.swap_remove(worst);
        pieces.extend([below, above]);
    }
    let shapes = pieces.iter().map(|piece| (piece.pose, piece.shape)).collect();
    let (volume, hull_volume) = pieces.iter().fold((0.0, 0.0), |sum, p| (sum.0 + p.volume, sum.1 + p.hull));
    Some(Fit { shapes, volume, hull_volume })
}

/// The triangles on a grid so coarse that few enough are left: what a scanner or a CAD program wrote has a hundred thousand.
fn coarsen(triangles: Vec<[Point3<f64>; 3]>) -> Vec<[Point3<f64>; 3]> {
    if triangles.len() <= MAX_TRIANGLES {
        return triangles;
    }
    let corners: Vec<Vector3<f64>> = triangles.iter().flatten().map(|corner| corner.coords).collect();
    let (low, high) = bounds(&corners);
    let cell = (high - low).max() / GRID;
    let key = |corner: &Point3<f64>| ((corner.coords - low) / cell).map(|v| v.round() as i64);
    // The first corner of a cell stands for all of it, so that what is left lies on the surface.
    let mut kept: BTreeMap<[i64; 3], Point3<f64>> = BTreeMap::new();
    for corner in triangles.iter().flatten() {
        kept.entry(key(corner).into()).or_insert(*corner);
    }
    let mut seen = BTreeSet::new();
    let coarse = triangles.iter().filter_map(|triangle| {
        let mut cells = triangle.each_ref().map(|corner| <[i64; 3]>::from(key(corner)));
        let corners = cells.map(|cell| kept[&cell]);
        cells.sort_unstable();
        (cells[0] != cells[1] && cells[1] != cells[2] && seen.insert(cells)).then_some(corners)
    });
    coarse.collect()
}

impl Piece {
    /// The smallest primitive around triangles; none without triangles.
    fn around(triangles: Vec<[Point3<f64>; 3]>) -> Option<Self> {
        let points: Vec<Point3<f64>> = triangles.iter().flatten().copied().collect();
        points.first()?;
        let (hull_points, hull) = convex_hull(&points);
        let (pose, shape) =
            candidates(&hull_points).into_iter().min_by(|a, b| volume(&a.1).total_cmp(&volume(&b.1)))?;
        Some(Self { triangles, pose, shape, volume: volume(&shape), hull })
    }

    /// The cut across one of its axes after which, with one cut more of each half, the boxes around the parts are smallest: the first
    /// cut of a fork saves nothing yet. None if it is flat.
    fn best_cut(&self) -> Option<Cut> {
        let inside = self.pose.inverse();
        let triangles: Vec<Triangle> =
            self.triangles.iter().map(|triangle| triangle.map(|corner| inside * corner)).collect();
        let whole = box_volume(&triangles);
        let first = planes(&triangles).filter_map(|(axis, at)| {
            let halves = split(&triangles, axis, at);
            let after = |half: &Vec<Triangle>| {
                let cuts = planes(half)
                    .map(|(axis, at)| split(half, axis, at).iter().map(|part| box_volume(part)).sum());
                cuts.fold(box_volume(half), f64::min)
            };
            let now = whole - halves.iter().map(|half| box_volume(half)).sum::<f64>();
            let saving = whole - halves.iter().map(after).sum::<f64>();
            // Of equals the one that saves at once.
            let score = saving + SOON * now;
            halves.iter().all(|half| !half.is_empty()).then_some((score, Cut { axis, at, saving }))
        });
        first.max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, cut)| cut)
    }

    fn split(&self, axis: usize, at: f64) -> [Vec<Triangle>; 2] {
        let inside = self.pose.inverse();
        let triangles: Vec<Triangle> =
            self.triangles.iter().map(|triangle| triangle.map(|corner| inside * corner)).collect();
        split(&triangles, axis, at)
            .map(|half| half.into_iter().map(|triangle| triangle.map(|corner| self.pose * corner)).collect())
    }
}

/// Three corners.
type Triangle = [Point3<f64>; 3];

/// A plane across an axis of a piece, and how much smaller boxes get by it, m^3.
struct Cut {
    axis: usize,
    at: f64,
    saving: f64,
}

/// Planes across each axis, evenly between the ends.
fn planes(triangles: &[Triangle]) -> impl Iterator<Item = (usize, f64)> + use<> {
    let corners: Vec<Vector3<f64>> = triangles.iter().flatten().map(|corner| corner.coords).collect();
    let (low, high) = bounds(&corners);
    let steps = if corners.is_empty() { 0 } else { CUTS };
    (0..3).flat_map(move |axis| {
        (1..=steps)
            .map(move |step| (axis, low[axis] + (high[axis] - low[axis]) * step as f64 / (steps + 1) as f64))
    })
}

fn box_volume(triangles: &[Triangle]) -> f64 {
    if triangles.is_empty() {
        return 0.0;
    }
    let corners: Vec<Vector3<f64>> = triangles.iter().flatten().map(|corner| corner.coords).collect();
    let (low, high) = bounds(&corners);
    (high - low).map(|side| side.max(MIN_THICKNESS_M)).product()
}

/// The parts of triangles below and above the plane `at` across `axis`.
fn split(triangles: &[Triangle], axis: usize, at: f64) -> [Vec<Triangle>; 2] {
    let mut halves = [Vec::new(), Vec::new()];
    for triangle in triangles {
        let height = triangle.map(|corner| corner[axis] - at);
        for (half, sign) in halves.iter_mut().zip([-1.0, 1.0]) {
            let inside = |h: f64| sign * h >= 0.0;
            let mut corners: Vec<Point3<f64>> = Vec::with_capacity(4);
            for k in 0..3 {
                let next = (k + 1) % 3;
                if inside(height[k]) {
                    corners.push(triangle[k]);
                }
                if inside(height[k]) != inside(height[next]) {
                    let share = height[k] / (height[k] - height[next]);
                    corners.push(triangle[k] + (triangle[next] - triangle[k]) * share);
                }
            }
            half.extend((2..corners.len()).map(|k| [corners[0], corners[k - 1], corners[k]]));
        }
    }
    halves
}

/// The corners of the convex hull of `points` with its volume; all of them and none where they are flat.
fn convex_hull(points: &[Point3<f64>]) -> (Vec<Point3<f64>>, f64) {
    let input: Vec<ParryVector> = points.iter().map(|p| ParryVector::new(p.x, p.y, p.z)).collect();
    let Ok((corners, faces)) = try_convex_hull(&input) else { return (points.to_vec(), 0.0) };
    let corners: Vec<Point3<f64>> = corners.iter().map(|p| Point3::new(p.x, p.y, p.z)).collect();
    let triangles = faces.iter().map(|face| face.map(|corner| corner as usize)).collect();
    let mesh = TriangleMesh { points: corners, triangles };
    let volume = mesh.volume();
    (mesh.points, volume)
}

/// Boxes, cylinders and a ball around `points`.
fn candidates(points: &[Point3<f64>]) -> Vec<(Pose, Shape)> {
    let count = points.len().max(1) as f64;
    let mean = points.iter().map(|p| p.coords).sum::<Vector3<f64>>() / count;
    let spread: Matrix3<f64> =
        points.iter().map(|p| (p.coords - mean) * (p.coords - mean).transpose()).sum::<Matrix3<f64>>()
            / count;
    let mut axes = SymmetricEigen::new(spread).eigenvectors;
    if axes.determinant() < 0.0 {
        axes.column_mut(2).neg_mut();
    }
    let principal = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix(&axes));
    // The file's own axes fit parts of a machine best; the principal ones what lies askew.
    let mut found = Vec::new();
    for rotation in [UnitQuaternion::identity(), principal] {
        let turned: Vec<Vector3<f64>> = points.iter().map(|p| rotation.inverse() * p.coords).collect();
        let (low, high) = bounds(&turned);
        let center = (low + high) / 2.0;
        let size = (high - low).map(|side| side.max(MIN_THICKNESS_M));
        let pose = |center: Vector3<f64>, turn: UnitQuaternion<f64>| {
            Pose::from_parts(Translation3::from(rotation * center), rotation * turn)
        };
        found.push((pose(center, UnitQuaternion::identity()), Shape::Box { size: size.into() }));
        for axis in 0..3 {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            let radius = turned
                .iter()
                .map(|p| (p[u] - center[u]).hypot(p[v] - center[v]))
                .fold(MIN_THICKNESS_M / 2.0, f64::max);
            // A cylinder's axis is its z.
            let axis_direction = Vector3::ith(axis, 1.0);
            let turn = UnitQuaternion::rotation_between(&Vector3::z(), &axis_direction).unwrap_or_default();
            found.push((pose(center, turn), Shape::Cylinder { radius, length: size[axis] }));
        }
        let radius = turned.iter().map(|p| (p - center).norm()).fold(MIN_THICKNESS_M / 2.0, f64::max);
        found.push((pose(center, UnitQuaternion::identity()), Shape::Sphere { radius }));
    }
    found
}

fn bounds(points: &[Vector3<f64>]) -> (Vector3<f64>, Vector3<f64>) {
    let infinite = Vector3::repeat(f64::INFINITY);
    points.iter().fold((infinite, -infinite), |(low, high), p| (low.inf(p), high.sup(p)))
}

/// Volume of a primitive, m^3.
pub(crate) fn volume(shape: &Shape) -> f64 {
    use std::f64::consts::PI;
    match *shape {
        Shape::Box { size: [a, b, c] } => a * b * c,
        Shape::Sphere { radius } => 4.0 / 3.0 * PI * radius.powi(3),
        Shape::Cylinder { radius, length } => PI * radius * radius * length,
        Shape::Capsule { radius, length } => PI * radius * radius * (length + 4.0 / 3.0 * radius),
    }
}
