//! An arm as a drawing: its shapes over its meshes, the hand open and closed, the start of a trial, and what it reaches.

use crate::ReachMap;
use nalgebra::{Point2, Point3};
use proact_arm::{ArmModel, CLOSED_POSE, OPEN_POSE};
use proact_testbed::{Setup, TrialConfig};
use proact_types::{Pose, Scene, Shape, Vector};
use std::{collections::BTreeMap, error::Error, f64::consts::TAU, fmt::Write};

/// Size of a panel and the room for its title, pixels.
const PANEL_PX: f64 = 380.0;
const TITLE_PX: f64 = 26.0;
const MARGIN_PX: f64 = 12.0;
const PANELS_PER_ROW: usize = 3;
/// Points around a rim.
const RIM_POINTS: usize = 16;
const ARM: &str = "#4a7fb5";
const HAND: &str = "#d9822b";
const MESH: &str = "#222222";
const BOX: &str = "#9a9a9a";
const BLOCK: &str = "#b03a3a";

/// Where points of a mesh are, in the frame of its link, by the link's name.
pub type MeshPoints = BTreeMap<String, Vec<Point3<f64>>>;

/// A polygon or a cloud of points in the plane of a panel, metres.
struct Figure {
    points: Vec<Point2<f64>>,
    color: &'static str,
    is_cloud: bool,
}

/// A view along an axis of `world`.
#[derive(Clone, Copy)]
enum View {
    /// From the right side of the person: ahead to the right, up.
    Side,
    /// From above: ahead up, left to the left.
    Top,
}

impl View {
    fn project(self, point: &Point3<f64>) -> Point2<f64> {
        match self {
            Self::Side => Point2::new(point.x, point.z),
            Self::Top => Point2::new(-point.y, point.x),
        }
    }
}

/// The drawing as SVG: the arm where it stands at the start of a trial among the blocks of the modified test, from the side and from above; its hand open and
/// closed in the directions of its grasp; its shapes over `meshes`; and which places of the box the hand reaches.
///
/// # Errors
/// A set-up that cannot be read.
pub fn arm_picture(model: &ArmModel, meshes: &MeshPoints) -> Result<String, Box<dyn Error>> {
    let config = TrialConfig::new("D", 1, Setup::named("still")?.with_arm(model));
    let (scene, body) = (config.build_task(model)?.scene().clone(), config.setup.body);
    let scene = &scene;
    let base = body.shoulder_pose(&Default::default());
    let pose = |group: &str, name: &str| model.pose(group, name).map(<[f64]>::to_vec).unwrap_or_default();
    let joints =
        |hand: &str| -> Vec<f64> { pose("arm", "start").into_iter().chain(pose("hand", hand)).collect() };
    let placed = |hand: &str| -> Vec<Pose> {
        model.link_poses(&joints(hand)).into_iter().map(|pose| base * pose).collect()
    };
    let (open, closed) = (placed(OPEN_POSE), placed(CLOSED_POSE));
    // In the frame of the grasp x is the line along which the hand closes, and z is up.
    let hand_view = |poses: &[Pose]| -> Vec<Figure> {
        let from_tip = poses[model.tip].inverse();
        let local: Vec<Pose> = poses.iter().map(|pose| from_tip * pose).collect();
        links(model, &local, true, &|point| Point2::new(point.x, point.z))
    };
    let mut panels = Vec::new();
    for (title, view) in [("start, from the side", View::Side), ("start, from above", View::Top)] {
        let mut figures = scenery(scene, view);
        figures.extend(links(model, &open, false, &|point| view.project(point)));
        panels.push(panel(title, &figures));
    }
    panels.push(reach_panel(&ReachMap::new(model, scene, &body)));
    panels.push(panel("hand open: closes along the horizontal", &hand_view(&open)));
    panels.push(panel("hand closed", &hand_view(&closed)));
    panels.push(panel("shapes over meshes, from the side", &over_meshes(model, &open, meshes)));

    let rows = panels.len().div_ceil(PANELS_PER_ROW);
    let (width, height) = (PANEL_PX * PANELS_PER_ROW as f64, (PANEL_PX + TITLE_PX) * rows as f64);
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" width=\"{width}\" height=\"{height}\" \
         font-family=\"sans-serif\" font-size=\"15\">\n<rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n"
    );
    for (index, panel) in panels.iter().enumerate() {
        let x = PANEL_PX * (index % PANELS_PER_ROW) as f64;
        let y = (PANEL_PX + TITLE_PX) * (index / PANELS_PER_ROW) as f64;
        let _ = writeln!(svg, "<g transform=\"translate({x} {y})\">{panel}</g>");
    }
    Ok(svg + "</svg>\n")
}

/// The shapes of the links, of palm and fingers alone if `hand_only`.
fn links(
    model: &ArmModel,
    poses: &[Pose],
    hand_only: bool,
    project: &dyn Fn(&Point3<f64>) -> Point2<f64>,
) -> Vec<Figure> {
    let (palm, digits) = (model.palm(), model.digits());
    let mut figures = Vec::new();
    for (index, link) in model.links.iter().enumerate() {
        let is_hand = digits[index].is_some();
        if hand_only && !is_hand && !palm[index] {
            continue;
        }
        for part in &link.collisions {
            let placed = poses[index] * part.pose;
            let points = outline(&part.shape).into_iter().map(|point| project(&(placed * point))).collect();
            figures.push(Figure {
                points: convex_hull(points),
                color: if is_hand { HAND } else { ARM },
                is_cloud: false,
            });
        }
    }
    figures
}

fn over_meshes(model: &ArmModel, poses: &[Pose], meshes: &MeshPoints) -> Vec<Figure> {
    let view = View::Side;
    let mut figures = links(model, poses, false, &|point| view.project(point));
    for (index, link) in model.links.iter().enumerate() {
        let Some(points) = meshes.get(&link.name) else { continue };
        let points = points.iter().map(|point| view.project(&(poses[index] * point))).collect();
        figures.push(Figure { points, color: MESH, is_cloud: true });
    }
    figures
}

fn scenery(scene: &Scene, view: View) -> Vec<Figure> {
    let figure = |shape: &Shape, pose: &Pose, color| {
        let points = outline(shape).into_iter().map(|point| view.project(&(pose * point))).collect();
        Figure { points: convex_hull(points), color, is_cloud: false }
    };
    // What is larger than a table, such as the floor, would make all else small.
    let is_small = |shape: &Shape| outline(shape).iter().all(|point| point.coords.norm() < 1.0);
    let fixed = scene.fixed.iter().filter(|object| is_small(&object.shape));
    let mut figures: Vec<Figure> = fixed.map(|object| figure(&object.shape, &object.pose, BOX)).collect();
    figures.extend(scene.objects.iter().map(|object| figure(&object.shape, &object.pose, BLOCK)));
    figures
}

/// Points whose hull is about the shape.
fn outline(shape: &Shape) -> Vec<Point3<f64>> {
    let rim = |radius: f64, z: f64| {
        (0..RIM_POINTS).map(move |k| {
            let angle = TAU * k as f64 / RIM_POINTS as f64;
            Point3::new(radius * angle.cos(), radius * angle.sin(), z)
        })
    };
    let ball = |radius: f64, z: f64| {
        [0.0_f64, 0.5, 0.87, -0.5, -0.87, 1.0, -1.0].into_iter().flat_map(move |height| {
            rim(radius * (1.0 - height * height).max(0.0).sqrt(), z + radius * height)
        })
    };
    match *shape {
        Shape::Box { size } => {
            let half = Vector::from(size) / 2.0;
            let sign = |k: usize, bit: usize| if k >> bit & 1 == 0 { 1.0 } else { -1.0 };
            (0..8)
                .map(|k| Point3::new(half.x * sign(k, 0), half.y * sign(k, 1), half.z * sign(k, 2)))
                .collect()
        }
        Shape::Sphere { radius } => ball(radius, 0.0).collect(),
        Shape::Cylinder { radius, length } => {
            rim(radius, length / 2.0).chain(rim(radius, -length / 2.0)).collect()
        }
        Shape::Capsule { radius, length } => {
            ball(radius, length / 2.0).chain(ball(radius, -length / 2.0)).collect()
        }
    }
}

/// The corners of the convex hull, counter-clockwise (A. M. Andrew's chains, 1979).
fn convex_hull(mut points: Vec<Point2<f64>>) -> Vec<Point2<f64>> {
    points.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    let turns_left = |a: &Point2<f64>, b: &Point2<f64>, c: &Point2<f64>| (b - a).perp(&(c - a)) > 0.0;
    let chain = |points: &mut dyn Iterator<Item = Point2<f64>>| {
        let mut chain: Vec<Point2<f64>> = Vec::new();
        for point in points {
            while let [.., a, b] = chain.as_slice()
                && !turns_left(a, b, &point)
            {
                chain.pop();
            }
            chain.push(point);
        }
        chain.pop();
        chain
    };
    let mut hull = chain(&mut points.iter().copied());
    hull.extend(chain(&mut points.iter().rev().copied()));
    hull
}

/// A panel that its figures fill, with a bar for the scale.
fn panel(title: &str, figures: &[Figure]) -> String {
    let all: Vec<Point2<f64>> = figures.iter().flat_map(|figure| figure.points.iter().copied()).collect();
    let infinite = Point2::new(f64::INFINITY, f64::INFINITY);
    let (low, high) =
        all.iter().fold((infinite, -infinite), |(low, high), point| (low.inf(point), high.sup(point)));
    let size = if all.is_empty() { 1.0 } else { (high - low).max().max(1e-3) };
    let scale = (PANEL_PX - 2.0 * MARGIN_PX) / size;
    let place = |point: &Point2<f64>| {
        (MARGIN_PX + scale * (point.x - low.x), TITLE_PX + PANEL_PX - MARGIN_PX - scale * (point.y - low.y))
    };
    let mut text = heading(title);
    for figure in figures {
        if figure.is_cloud {
            for point in &figure.points {
                let (x, y) = place(point);
                let _ =
                    write!(text, "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"0.8\" fill=\"{}\"/>", figure.color);
            }
            continue;
        }
        let corners: String =
            figure.points.iter().map(place).map(|(x, y)| format!("{x:.1},{y:.1} ")).collect();
        let color = figure.color;
        let _ = write!(
            text,
            "<polygon points=\"{corners}\" fill=\"{color}\" fill-opacity=\"0.35\" stroke=\"{color}\" stroke-width=\"1\"/>"
        );
    }
    // A bar of one, two or five of something.
    let bar = [0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0]
        .into_iter()
        .rfind(|bar| *bar < 0.4 * size)
        .unwrap_or(0.01);
    let (x, y) = (PANEL_PX - MARGIN_PX, TITLE_PX + PANEL_PX - 4.0);
    let _ = write!(
        text,
        "<line x1=\"{:.1}\" y1=\"{y}\" x2=\"{x}\" y2=\"{y}\" stroke=\"black\" stroke-width=\"2\"/>\
         <text x=\"{x}\" y=\"{:.1}\" text-anchor=\"end\" font-size=\"12\">{:.0} mm</text>",
        x - bar * scale,
        y - 5.0,
        1e3 * bar
    );
    text
}

fn reach_panel(map: &ReachMap) -> String {
    let mut text =
        heading(&format!("{:.0} % of the box is reached, from above", 1e2 * map.reachable_fraction(0.0)));
    let columns = map.rows.iter().map(Vec::len).max().unwrap_or(1);
    let side = (PANEL_PX - 2.0 * MARGIN_PX) / columns.max(map.rows.len()).max(1) as f64;
    for (row, points) in map.rows.iter().enumerate() {
        for (column, point) in points.iter().enumerate() {
            let fill = if point.lean_deg.is_some() { "#6aa84f" } else { "#dddddd" };
            let (x, y) = (MARGIN_PX + side * column as f64, TITLE_PX + MARGIN_PX + side * row as f64);
            let _ = write!(
                text,
                "<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{:.1}\" height=\"{:.1}\" fill=\"{fill}\"/>",
                side - 1.0,
                side - 1.0
            );
        }
    }
    text
}

fn heading(title: &str) -> String {
    format!("<text x=\"{MARGIN_PX}\" y=\"18\">{title}</text>")
}
