use proact_types::{Shape, Vector};

/// Where a ray meets a shape from outside: the factor of `along` to get there, above `nearest`, and the outward unit
/// normal. Both vectors in the shape's frame; `along` has any length above zero.
pub(super) fn intersect_ray(
    shape: &Shape,
    from: &Vector,
    along: &Vector,
    nearest: f64,
) -> Option<(f64, Vector)> {
    let hit = match *shape {
        Shape::Box { size } => intersect_box(&(Vector::from(size) / 2.0), from, along),
        Shape::Sphere { radius } => intersect_sphere(radius, 0.0, from, along),
        Shape::Cylinder { radius, length } => nearer(
            intersect_cylinder_side(radius, length / 2.0, from, along),
            intersect_cylinder_cap(radius, length / 2.0, from, along),
        ),
        Shape::Capsule { radius, length } => nearer(
            intersect_cylinder_side(radius, length / 2.0, from, along),
            nearer(
                intersect_sphere(radius, length / 2.0, from, along),
                intersect_sphere(radius, -length / 2.0, from, along),
            ),
        ),
    };
    hit.filter(|(t, _)| *t > nearest)
}

/// Radius of the ball about the shape's origin that holds it.
pub(super) fn bounding_radius(shape: &Shape) -> f64 {
    match *shape {
        Shape::Box { size } => Vector::from(size).norm() / 2.0,
        Shape::Sphere { radius } => radius,
        Shape::Cylinder { radius, length } => radius.hypot(length / 2.0),
        Shape::Capsule { radius, length } => radius + length / 2.0,
    }
}

type Hit = Option<(f64, Vector)>;

fn nearer(a: Hit, b: Hit) -> Hit {
    match (a, b) {
        (Some(a), Some(b)) => Some(if a.0 <= b.0 { a } else { b }),
        (a, b) => a.or(b),
    }
}

/// The slab method: the last of the three entries, if it lies before the first exit.
fn intersect_box(half: &Vector, from: &Vector, along: &Vector) -> Hit {
    let (mut entry, mut exit, mut face) = (f64::NEG_INFINITY, f64::INFINITY, 0);
    for axis in 0..3 {
        if along[axis] == 0.0 {
            if from[axis].abs() > half[axis] {
                return None;
            }
            continue;
        }
        let middle = -from[axis] / along[axis];
        let reach = (half[axis] / along[axis]).abs();
        if middle - reach > entry {
            (entry, face) = (middle - reach, axis);
        }
        exit = exit.min(middle + reach);
    }
    let mut normal = Vector::zeros();
    normal[face] = -along[face].signum();
    (entry <= exit).then_some((entry, normal))
}

/// A ball whose centre is `height` up the z axis.
fn intersect_sphere(radius: f64, height: f64, from: &Vector, along: &Vector) -> Hit {
    let from = from - Vector::new(0.0, 0.0, height);
    let t = smaller_root(along.norm_squared(), from.dot(along), from.norm_squared() - radius * radius)?;
    Some((t, (from + t * along) / radius))
}

/// The round side of a cylinder about z.
fn intersect_cylinder_side(radius: f64, half: f64, from: &Vector, along: &Vector) -> Hit {
    let (p, d) = (from.xy(), along.xy());
    let t = smaller_root(d.norm_squared(), p.dot(&d), p.norm_squared() - radius * radius)?;
    let at = from + t * along;
    (at.z.abs() <= half).then(|| (t, Vector::new(at.x, at.y, 0.0) / radius))
}

/// The flat end of a cylinder about z that faces the ray.
fn intersect_cylinder_cap(radius: f64, half: f64, from: &Vector, along: &Vector) -> Hit {
    let side = -along.z.signum();
    let t = (side * half - from.z) / along.z;
    let at = from + t * along;
    (at.xy().norm_squared() <= radius * radius).then(|| (t, Vector::new(0.0, 0.0, side)))
}

/// The smaller root of `a t^2 + 2 b t + c`, if there are two.
fn smaller_root(a: f64, b: f64, c: f64) -> Option<f64> {
    let discriminant = b * b - a * c;
    (a > 0.0 && discriminant > 0.0).then(|| (-b - discriminant.sqrt()) / a)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Signed distance to the surface, below zero inside: the textbook formulas, for a second opinion.
    fn distance(shape: &Shape, p: &Vector) -> f64 {
        let round = |half: f64| Vector::new(p.x, p.y, p.z - p.z.clamp(-half, half)).norm();
        match *shape {
            Shape::Box { size } => {
                let q = p.abs() - Vector::from(size) / 2.0;
                q.sup(&Vector::zeros()).norm() + q.max().min(0.0)
            }
            Shape::Sphere { radius } => p.norm() - radius,
            Shape::Cylinder { radius, length } => {
                let (side, end) = (p.xy().norm() - radius, p.z.abs() - length / 2.0);
                side.max(0.0).hypot(end.max(0.0)) + side.max(end).min(0.0)
            }
            Shape::Capsule { radius, length } => round(length / 2.0) - radius,
        }
    }

    fn shapes() -> impl Strategy<Value = Shape> {
        let size = 0.1..1.0;
        prop_oneof![
            prop::array::uniform3(size.clone()).prop_map(|size| Shape::Box { size }),
            size.clone().prop_map(|radius| Shape::Sphere { radius }),
            (size.clone(), size.clone()).prop_map(|(radius, length)| Shape::Cylinder { radius, length }),
            (size.clone(), size).prop_map(|(radius, length)| Shape::Capsule { radius, length }),
        ]
    }

    proptest! {
        #[test]
        fn a_ray_ends_where_marching_along_the_distance_ends(
            shape in shapes(),
            from in prop::array::uniform3(-1.0..1.0),
            to in prop::array::uniform3(-0.7..0.7),
        ) {
            let from = Vector::from(from).normalize() * 4.0;
            let along = Vector::from(to) - from;
            let mut t = 0.0;
            while t < 3.0 && distance(&shape, &(from + t * along)) > 1e-9 {
                t += distance(&shape, &(from + t * along)) / along.norm();
            }
            // What a ray only grazes, one may miss and the other not.
            prop_assume!((0..100).any(|k| distance(&shape, &(from + f64::from(k) / 50.0 * along)) < -0.01) || t >= 3.0);
            match intersect_ray(&shape, &from, &along, 0.0) {
                Some((hit, normal)) => {
                    prop_assert!((hit - t).abs() < 1e-6, "{hit} for {t}");
                    prop_assert!((normal.norm() - 1.0).abs() < 1e-9);
                    prop_assert!(normal.dot(&along) <= 0.0);
                }
                None => prop_assert!(t >= 3.0),
            }
        }

        #[test]
        fn all_of_a_shape_is_within_its_reach(shape in shapes(), p in prop::array::uniform3(-2.0..2.0)) {
            let p = Vector::from(p);
            prop_assert!(distance(&shape, &p) > 0.0 || p.norm() <= bounding_radius(&shape) + 1e-12);
        }
    }
}
