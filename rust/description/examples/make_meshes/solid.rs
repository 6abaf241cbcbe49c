//! Small solid modelling: lofted superellipses, panels on their surface, binary STL.

use nalgebra::Vector3;
use std::f64::consts::{FRAC_PI_2, TAU};

/// Vertices are rounded to this, metres, so that another machine's sine yields the same bytes.
const GRID: f64 = 1e-6;
/// Rings of a rounded end: few on an edge, enough on a dome.
fn cap_rings(radius: f64) -> usize {
    match radius {
        r if r < 0.001 => 1,
        r if r < 0.004 => 2,
        r if r < 0.010 => 3,
        _ => 4,
    }
}

/// A triangle soup, metres.
#[derive(Clone, Default)]
pub struct Solid {
    triangles: Vec<[Vector3<f64>; 3]>,
}

impl Solid {
    /// Both solids in one.
    pub fn merged_with(mut self, other: Solid) -> Solid {
        self.triangles.extend(other.triangles);
        self
    }

    /// Moved by `x`, `y`, `z` metres.
    pub fn translated(mut self, x: f64, y: f64, z: f64) -> Solid {
        for vertex in self.triangles.iter_mut().flatten() {
            *vertex += Vector3::new(x, y, z);
        }
        self
    }

    /// Stretched along each axis; the factors are above zero.
    pub fn scaled(mut self, x: f64, y: f64, z: f64) -> Solid {
        for vertex in self.triangles.iter_mut().flatten() {
            vertex.component_mul_assign(&Vector3::new(x, y, z));
        }
        self
    }

    /// Binary STL: 80 bytes of header, a count, then 50 bytes a triangle.
    pub fn to_stl(&self) -> Vec<u8> {
        let snapped = self.triangles.iter().map(|t| t.map(|v| v.map(|c| (c / GRID).round() * GRID)));
        // Slivers that the rounding collapsed have no normal and nothing to show.
        let solid: Vec<_> = snapped.filter(|[a, b, c]| (b - a).cross(&(c - a)).norm() > 0.0).collect();
        let mut out = vec![0; 80];
        let count = u32::try_from(solid.len()).expect("a mesh has far fewer than 2^32 triangles");
        out.extend(count.to_le_bytes());
        for [a, b, c] in solid {
            let normal = (b - a).cross(&(c - a)).normalize();
            for component in [normal, a, b, c].iter().flatten() {
                out.extend((*component as f32).to_le_bytes());
            }
            out.extend([0, 0]);
        }
        out
    }

    fn quad(&mut self, a: Vector3<f64>, b: Vector3<f64>, c: Vector3<f64>, d: Vector3<f64>) {
        self.triangles.push([a, b, c]);
        self.triangles.push([a, c, d]);
    }

    /// Turns all triangles so that they face outwards; the solid is closed.
    fn oriented_outward(mut self) -> Solid {
        let volume: f64 = self.triangles.iter().map(|[a, b, c]| a.dot(&b.cross(c))).sum();
        if volume < 0.0 {
            self.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        }
        self
    }
}

/// The link axis along which a loft runs.
#[derive(Clone, Copy, PartialEq)]
pub enum LoftAxis {
    /// Sections span y and z.
    X,
    /// Sections span x and z.
    Y,
    /// Sections span x and y.
    Z,
}

/// A cross-section: a superellipse `|u/a|^n + |v/b|^n = 1` around (`u`, `v`).
///
/// u and v are the two other link axes in alphabetical order, t is the coordinate along the loft; metres.
#[derive(Clone, Copy)]
pub struct LoftSection {
    t: f64,
    u: f64,
    v: f64,
    a: f64,
    b: f64,
    n: f64,
}

/// A section at `t`, centred at (`u`, `v`), with half widths `a` and `b`, moderately boxy.
pub fn section(t: f64, (u, v): (f64, f64), (a, b): (f64, f64)) -> LoftSection {
    LoftSection { t, u, v, a, b, n: 2.4 }
}

impl LoftSection {
    /// With exponent `n`: 2 is an ellipse, more is boxier.
    pub fn with_exponent(mut self, n: f64) -> LoftSection {
        self.n = n;
        self
    }

    fn numbers(&self) -> [f64; 5] {
        [self.u, self.v, self.a, self.b, self.n]
    }

    /// The point in direction `angle`, `lift` metres outside the surface.
    fn point(&self, along: LoftAxis, angle: f64, lift: f64) -> Vector3<f64> {
        let power = 2.0 / self.n;
        let (sin, cos) = angle.sin_cos();
        let u = self.u + (self.a + lift) * cos.abs().powf(power).copysign(cos);
        let v = self.v + (self.b + lift) * sin.abs().powf(power).copysign(sin);
        along_axis(along, self.t, u, v)
    }
}

fn along_axis(along: LoftAxis, t: f64, u: f64, v: f64) -> Vector3<f64> {
    match along {
        LoftAxis::X => Vector3::new(t, u, v),
        LoftAxis::Y => Vector3::new(u, t, v),
        LoftAxis::Z => Vector3::new(u, v, t),
    }
}

/// A body through cross-sections, with rounded ends and, if wanted, grooves around it.
pub struct Loft {
    along: LoftAxis,
    sections: Vec<LoftSection>,
    rounding: (f64, f64),
    grooves: Vec<f64>,
    rings: usize,
    segments: usize,
}

impl Loft {
    /// A body through `sections`, whose `t` ascend or descend.
    pub fn new(along: LoftAxis, sections: &[LoftSection]) -> Loft {
        Loft {
            along,
            sections: sections.to_vec(),
            rounding: (0.002, 0.002),
            grooves: Vec::new(),
            rings: 12,
            segments: 28,
        }
    }

    /// Radii, metres, of the rounded edges at the first and the last section; they add to the length.
    pub fn rounded(mut self, first: f64, last: f64) -> Loft {
        self.rounding = (first, last);
        self
    }

    /// Grooves at these places along the axis, as between two shells.
    pub fn grooved(mut self, at: &[f64]) -> Loft {
        self.grooves = at.to_vec();
        self
    }

    /// Rings along the body and points around it.
    pub fn with_resolution(mut self, rings: usize, around: usize) -> Loft {
        (self.rings, self.segments) = (rings, around);
        self
    }

    /// The section at `t`: monotone cubic interpolation, so that nothing bulges beyond what was asked for.
    fn at(&self, t: f64) -> LoftSection {
        let s = &self.sections;
        let falling = s[0].t > s[s.len() - 1].t;
        let key = |x: f64| if falling { -x } else { x };
        let k = s.partition_point(|x| key(x.t) <= key(t)).clamp(1, s.len() - 1);
        let slope = |k: usize, c: usize| (s[k + 1].numbers()[c] - s[k].numbers()[c]) / (s[k + 1].t - s[k].t);
        // Tangents: zero at a turning point, otherwise the harmonic mean of the two slopes.
        let tangent = |k: usize, c: usize| {
            if k == 0 || k + 1 == s.len() {
                return slope(k.min(s.len() - 2), c);
            }
            let (left, right) = (slope(k - 1, c), slope(k, c));
            if left * right <= 0.0 { 0.0 } else { 2.0 * left * right / (left + right) }
        };
        let (from, to) = (&s[k - 1], &s[k]);
        let h = to.t - from.t;
        let x = ((t - from.t) / h).clamp(0.0, 1.0);
        let mut out = [0.0; 5];
        for (c, value) in out.iter_mut().enumerate() {
            let (p0, p1) = (from.numbers()[c], to.numbers()[c]);
            let (m0, m1) = (tangent(k - 1, c) * h, tangent(k, c) * h);
            *value = p0 * (1.0 + 2.0 * x) * (1.0 - x).powi(2)
                + p1 * x.powi(2) * (3.0 - 2.0 * x)
                + m0 * x * (1.0 - x).powi(2)
                + m1 * x.powi(2) * (x - 1.0);
        }
        let [u, v, a, b, n] = out;
        LoftSection { t, u, v, a, b, n }
    }

    fn all_rings(&self) -> Vec<LoftSection> {
        let (first, last) = (self.sections[0], self.sections[self.sections.len() - 1]);
        let sense = (last.t - first.t).signum();
        let mut ring_points: Vec<(f64, f64)> = (0..=self.rings)
            .map(|k| (first.t + (last.t - first.t) * k as f64 / self.rings as f64, 0.0))
            .collect();
        // A groove is 2 mm wide and 0.9 mm deep with bevelled edges.
        for &groove in &self.grooves {
            ring_points.retain(|(t, _)| (t - groove).abs() > 0.0017);
            ring_points.extend(
                [(-0.0016, 0.0), (-0.001, 0.0009), (0.001, 0.0009), (0.0016, 0.0)]
                    .map(|(d, sink)| (groove + d, sink)),
            );
        }
        ring_points.sort_by(|p, q| (p.0 * sense).total_cmp(&(q.0 * sense)));

        let edge = |s: LoftSection, radius: f64, outward: f64| {
            let rings = cap_rings(radius);
            (1..=rings).map(move |k| {
                let angle = FRAC_PI_2 * k as f64 / rings as f64;
                let inset = radius * (1.0 - angle.cos());
                let (a, b) = ((s.a - inset).max(0.0), (s.b - inset).max(0.0));
                LoftSection { t: s.t + outward * radius * angle.sin(), a, b, ..s }
            })
        };
        let mut rings: Vec<LoftSection> = edge(first, self.rounding.0, -sense).collect();
        rings.reverse();
        rings.extend(ring_points.iter().map(|&(t, sink)| {
            let s = self.at(t);
            LoftSection { a: s.a - sink, b: s.b - sink, ..s }
        }));
        rings.extend(edge(last, self.rounding.1, sense));
        rings
    }

    /// The closed body.
    pub fn solid(&self) -> Solid {
        let rings: Vec<Vec<Vector3<f64>>> = self
            .all_rings()
            .iter()
            .map(|s| {
                (0..self.segments)
                    .map(|k| s.point(self.along, TAU * k as f64 / self.segments as f64, 0.0))
                    .collect()
            })
            .collect();
        let mut solid = Solid::default();
        for pair in rings.windows(2) {
            for k in 0..self.segments {
                let next = (k + 1) % self.segments;
                solid.quad(pair[0][k], pair[0][next], pair[1][next], pair[1][k]);
            }
        }
        for (ring, turned) in [(&rings[0], true), (&rings[rings.len() - 1], false)] {
            let middle = ring.iter().sum::<Vector3<f64>>() / self.segments as f64;
            for k in 0..self.segments {
                let (a, b) = (ring[k], ring[(k + 1) % self.segments]);
                solid.triangles.push(if turned { [middle, b, a] } else { [middle, a, b] });
            }
        }
        solid.oriented_outward()
    }

    /// A plate with rounded corners that lies on the surface: from `t` to `t`, between two angles (zero along u,
    /// a quarter turn along v), `lift` metres high.
    pub fn panel(&self, (from, to): (f64, f64), (start, end): (f64, f64), lift: f64) -> Solid {
        const ROWS: usize = 10;
        const COLUMNS: usize = 5;
        let row = |i: usize, lift: f64, shrink: f64| -> Vec<Vector3<f64>> {
            let x = (2.0 * i as f64 / ROWS as f64 - 1.0) * shrink;
            let half = (end - start) / 2.0 * shrink * (1.0 - x.abs().powi(6)).max(0.0).powf(1.0 / 6.0);
            let s = self.at(from + (to - from) * (x + 1.0) / 2.0);
            (0..=COLUMNS)
                .map(|j| {
                    let angle = (start + end) / 2.0 + half * (2.0 * j as f64 / COLUMNS as f64 - 1.0);
                    s.point(self.along, angle, lift)
                })
                .collect()
        };
        // The top is a little smaller than the foot, which stands below the surface: a bevelled edge.
        let top: Vec<_> = (0..=ROWS).map(|i| row(i, lift, 0.97)).collect();
        let foot: Vec<_> = (0..=ROWS).map(|i| row(i, -0.002, 1.0)).collect();
        let mut solid = Solid::default();
        for i in 0..ROWS {
            for j in 0..COLUMNS {
                solid.quad(top[i][j], top[i][j + 1], top[i + 1][j + 1], top[i + 1][j]);
                solid.quad(foot[i][j], foot[i + 1][j], foot[i + 1][j + 1], foot[i][j + 1]);
            }
            solid.quad(top[i][0], top[i + 1][0], foot[i + 1][0], foot[i][0]);
            solid.quad(top[i][COLUMNS], foot[i][COLUMNS], foot[i + 1][COLUMNS], top[i + 1][COLUMNS]);
        }
        for j in 0..COLUMNS {
            solid.quad(top[0][j], foot[0][j], foot[0][j + 1], top[0][j + 1]);
            solid.quad(top[ROWS][j], top[ROWS][j + 1], foot[ROWS][j + 1], foot[ROWS][j]);
        }
        solid.oriented_outward()
    }
}

/// A joint's barrel around the link's origin: rounded edges, and a smaller hub on either face.
pub fn barrel(along: LoftAxis, radius: f64, length: f64, around: usize) -> Solid {
    let body = |radius: f64, length: f64, edge: f64| {
        let half = length / 2.0 - edge;
        let ends = [-half, half].map(|t| section(t, (0.0, 0.0), (radius, radius)).with_exponent(2.0));
        Loft::new(along, &ends).rounded(edge, edge).with_resolution(1, around).solid()
    };
    body(radius, length, 0.12 * radius).merged_with(body(0.55 * radius, 1.1 * length, 0.05 * radius))
}

/// A ball of radius `radius` around the link's origin.
pub fn ball(radius: f64, around: usize) -> Solid {
    let equator = [-1e-5, 1e-5].map(|t| section(t, (0.0, 0.0), (radius, radius)).with_exponent(2.0));
    Loft::new(LoftAxis::Y, &equator).rounded(radius, radius).with_resolution(1, around).solid()
}
