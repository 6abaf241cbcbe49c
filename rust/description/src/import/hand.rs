//! Finds how the hand of an imported arm opens and closes.

use super::mount;
use nalgebra::UnitQuaternion;
use proact_arm::{ArmModel, CLOSED_POSE, Grasp, Joint, JointKind, Link, NamedPose, OPEN_POSE};
use proact_types::{Point, Pose, Shape, Vector};
use std::borrow::Cow;

/// Pose of the arm in which a trial starts.
const START_POSE: &str = "start";
/// A joint that brings the fingertips together by less than this share of what the best joint does spreads the fingers or turns
/// them, and stays in the middle.
const MIN_SHARE: f64 = 0.15;

/// Adds the poses `start`, `open` and `closed` where they are missing; what was found, in one sentence each.
pub(crate) fn add_poses(model: &mut ArmModel) -> Vec<String> {
    let mut said = Vec::new();
    if model.pose("arm", START_POSE).is_err() {
        // Zero, or the nearest angle within the limits, as a maker's drawings show the arm.
        let angles = model.arm.iter().map(|&joint| rest_angle(model, joint)).collect();
        model.poses.push(NamedPose { name: START_POSE.to_owned(), group: "arm".to_owned(), angles });
        said.push("pose \"start\" of the arm is zero, or the nearest angle within the limits".to_owned());
    }
    if model.hand.is_empty()
        || model.pose("hand", OPEN_POSE).is_ok() && model.pose("hand", CLOSED_POSE).is_ok()
    {
        return said;
    }
    let (open, closed) = opposite_poses(model);
    if open == closed {
        said.push("no joint of the hand brings the fingertips together: correct the poses \"open\" and \"closed\" in arm.srdf".to_owned());
        for name in [OPEN_POSE, CLOSED_POSE] {
            if model.pose("hand", name).is_err() {
                let (name, group) = (name.to_owned(), "hand".to_owned());
                model.poses.push(NamedPose { name, group, angles: open.clone() });
            }
        }
        return said;
    }
    for (name, angles) in [(OPEN_POSE, open), (CLOSED_POSE, closed)] {
        if model.pose("hand", name).is_err() {
            model.poses.push(NamedPose { name: name.to_owned(), group: "hand".to_owned(), angles });
            said.push(format!(
                "pose \"{name}\" of the hand is where its joints bring the fingertips {}",
                if name == OPEN_POSE { "apart" } else { "together" }
            ));
        }
    }
    said
}

/// Zero, or the nearest angle within the limits.
fn rest_angle(model: &ArmModel, joint: usize) -> f64 {
    let limits = model.joints[joint].limits;
    0.0_f64.clamp(limits.lower, limits.upper)
}

/// Angles of the hand's joints at which the fingertips are farthest from each other, and nearest: each joint by itself, at one end
/// of its range or the other.
fn opposite_poses(model: &ArmModel) -> (Vec<f64>, Vec<f64>) {
    let range = |joint: usize| [model.joints[joint].limits.lower, model.joints[joint].limits.upper];
    let middle: Vec<f64> = model.hand.iter().map(|&joint| range(joint).iter().sum::<f64>() / 2.0).collect();
    let follows = |joint: usize| model.mimics.iter().any(|mimic| mimic.joint == joint);
    let effects: Vec<Option<[f64; 2]>> = model
        .hand
        .iter()
        .enumerate()
        .map(|(index, &joint)| {
            (!follows(joint)).then(|| {
                range(joint).map(|angle| {
                    let mut angles = middle.clone();
                    angles[index] = angle;
                    fingertip_spread(model, &angles)
                })
            })
        })
        .collect();
    let largest = effects.iter().flatten().map(|[low, high]| (high - low).abs()).fold(0.0, f64::max);
    let (mut open, mut closed) = (Vec::new(), Vec::new());
    for (effect, &joint) in effects.iter().zip(&model.hand) {
        let [low, high] = range(joint);
        let (apart, together) =
            match effect {
                Some([at_low, at_high]) if (at_high - at_low).abs() > MIN_SHARE * largest => {
                    if at_low > at_high { (low, high) } else { (high, low) }
                }
                _ => (rest_angle(model, joint), rest_angle(model, joint)),
            };
        open.push(apart);
        closed.push(together);
    }
    for angles in [&mut open, &mut closed] {
        let mut rates = vec![0.0; angles.len()];
        model.couplings().apply(angles, &mut rates);
    }
    (open, closed)
}

/// Mean distance between the tips of different digits, metres, and for a single digit its distance from the palm.
fn fingertip_spread(model: &ArmModel, hand: &[f64]) -> f64 {
    let poses = hand_poses(model, hand);
    let tips: Vec<Point> = fingertips(model).iter().map(|tip| tip.place(&poses)).collect();
    let pairs: Vec<f64> = tips
        .iter()
        .enumerate()
        .flat_map(|(k, a)| tips[k + 1..].iter().map(move |b| (a - b).norm()))
        .collect();
    match (pairs.is_empty(), tips.first()) {
        (false, _) => pairs.iter().sum::<f64>() / pairs.len() as f64,
        (true, Some(tip)) => (tip - Point::from(poses[model.tip].translation.vector)).norm(),
        (true, None) => 0.0,
    }
}

/// The poses of all links with the arm at rest, and the hand so.
fn hand_poses(model: &ArmModel, hand: &[f64]) -> Vec<Pose> {
    let mut hand = hand.to_vec();
    model.couplings().place(&mut hand);
    let mut positions: Vec<f64> = model.arm.iter().map(|&joint| rest_angle(model, joint)).collect();
    positions.extend(hand);
    model.link_poses(&positions)
}

/// The end of a digit.
#[derive(Clone, Copy, Debug)]
struct FingerTip {
    /// First link of the digit.
    root: usize,
    link: usize,
    /// In the frame of `link`.
    point: Point,
}

impl FingerTip {
    fn place(&self, poses: &[Pose]) -> Point {
        poses[self.link] * self.point
    }
}

/// The point of each digit that is farthest from the palm in the middle of the joints' ranges: a point of its last links, which
/// moves with them.
fn fingertips(model: &ArmModel) -> Vec<FingerTip> {
    let digits = model.digits();
    let middle: Vec<f64> = model
        .hand
        .iter()
        .map(|&joint| 0.5 * (model.joints[joint].limits.lower + model.joints[joint].limits.upper))
        .collect();
    let poses = hand_poses(model, &middle);
    let palm = poses[model.tip].translation.vector;
    let roots = (0..model.links.len()).filter(|&link| digits[link] == Some(link));
    roots
        .map(|root| {
            let links = (0..model.links.len()).filter(|&link| digits[link] == Some(root));
            let points = links.flat_map(|link| {
                let shapes = model.links[link].collisions.iter();
                let ends = shapes.flat_map(|part| end_points(&part.shape).map(|end| part.pose * end));
                // A link without a shape has its origin alone.
                ends.chain([Point::origin()]).map(move |point| FingerTip { root, link, point })
            });
            let far = |tip: &FingerTip| (tip.place(&poses).coords - palm).norm();
            points.max_by(|a, b| far(a).total_cmp(&far(b))).unwrap_or(FingerTip {
                root,
                link: root,
                point: Point::origin(),
            })
        })
        .collect()
}

/// The middles of the ends of a shape along its axes.
fn end_points(shape: &Shape) -> [Point; 6] {
    let [x, y, z] = match *shape {
        Shape::Box { size } => size.map(|side| 0.5 * side),
        Shape::Sphere { radius } => [radius; 3],
        Shape::Cylinder { radius, length } => [radius, radius, 0.5 * length],
        Shape::Capsule { radius, length } => [radius, radius, 0.5 * length + radius],
    };
    [[x, 0.0, 0.0], [-x, 0.0, 0.0], [0.0, y, 0.0], [0.0, -y, 0.0], [0.0, 0.0, z], [0.0, 0.0, -z]]
        .map(Point::from)
}

/// How a hand grips from above.
#[derive(Clone)]
pub(crate) struct GraspShape {
    /// `tip_from_frame` of a frame whose z is up and along whose x the fingers close.
    frame: UnitQuaternion<f64>,
    /// In that frame.
    pub(crate) grasp: Grasp,
    /// The poses before and after the hand closes, where they are others than `open` and `closed`.
    pub(crate) poses: Vec<NamedPose>,
    pub(crate) sentence: String,
    /// How much room the hand has about the block and above the table, metres: less than none touches.
    room: f64,
    pair: Vec<usize>,
    approach: Vector,
    /// By how much the two digits come together, metres, and how straight the hand comes from their roots, -1 to 1.
    closing_m: f64,
    straightness: f64,
}

/// How far the ends of the fingers reach below the middle of what they hold, metres.
const FINGER_DEPTH_M: f64 = 0.02;
/// How far a hand may be tilted about the line along which it closes, and lean to the side, rad.
const MAX_ROLL_RAD: f64 = 0.45;
const MAX_LEAN_RAD: f64 = 0.26;
/// Room that the open hand has on each side of what it holds, metres.
const ROOM_M: f64 = 0.003;
/// Room that a hand opens by before it grips, metres on each side: one of several digits, and a gripper of two.
const PREGRASP_ROOM_M: f64 = 0.0065;
const GRIPPER_ROOM_M: f64 = 0.02;
/// A hand stays within a cone above the fingertips, so that it passes walls: its slope, and its radius at the fingertips, metres.
const CONE_SLOPE: f64 = 0.6;
const CONE_RADIUS_M: f64 = 0.06;
/// Number of directions from which a hand is brought to a block, about the line along which it closes.
const APPROACHES: u32 = 24;
/// What fingertips that slide past each other cost, metres: all of their way, or none.
const SLIDING_COST_M: f64 = 0.03;
/// Steps between the open and the closed hand.
const CLOSING_STEPS: u32 = 40;
/// Number of shapes that are kept, and the angle between the approaches of two with the same digits, rad.
const MAX_SHAPES: usize = 6;
const MAX_SHAPES_OF_PAIR: usize = 2;
const DISTINCT_RAD: f64 = 0.5;

/// A hand at one moment of closing: the poses of its links in the palm's frame.
struct ClosingHand<'a> {
    model: &'a ArmModel,
    open: &'a [f64],
    closed: &'a [f64],
}

impl ClosingHand<'_> {
    fn angles(&self, share: f64) -> Vec<f64> {
        self.open.iter().zip(self.closed).map(|(a, b)| a + share * (b - a)).collect()
    }

    /// Two digits closed, and the others where they are at `share`.
    fn angles_of_pair(&self, pair: &[FingerTip], share: f64) -> Vec<f64> {
        let digits = self.model.digits();
        let moves = |joint: usize| {
            let digit = digits[self.model.joints[joint].child];
            pair.iter().any(|tip| digit == Some(tip.root))
        };
        let held = self.angles(share).into_iter().zip(self.closed).zip(&self.model.hand);
        held.map(|((held, closed), &joint)| if moves(joint) { *closed } else { held }).collect()
    }

    fn poses(&self, share: f64) -> Vec<Pose> {
        let poses = hand_poses(self.model, &self.angles(share));
        let palm_from_base = poses[self.model.tip].inverse();
        poses.into_iter().map(|pose| palm_from_base * pose).collect()
    }

    /// Where the ends of two digits are; of one, where it is and where it goes.
    fn ends(&self, pair: &[FingerTip], poses: &[Pose]) -> [Vector; 2] {
        let place = |tip: &FingerTip, poses: &[Pose]| tip.place(poses).coords;
        match pair {
            [a, b] => [place(a, poses), place(b, poses)],
            [a, ..] => [place(a, poses), place(a, &self.poses(1.0))],
            [] => [Vector::zeros(); 2],
        }
    }

    fn gap(&self, pair: &[FingerTip], share: f64) -> f64 {
        let [a, b] = self.ends(pair, &self.poses(share));
        (b - a).norm()
    }
}

/// How the hand may hold a block of `width`, metres: each way between two digits that come together as it closes, from where it
/// has most room, the best first. Empty if no digits come together.
pub(crate) fn grasp_shapes(model: &ArmModel, width: f64) -> Vec<GraspShape> {
    let (Ok(open), Ok(closed)) = (model.pose("hand", OPEN_POSE), model.pose("hand", CLOSED_POSE)) else {
        return Vec::new();
    };
    let hand = ClosingHand { model, open, closed };
    let tips = fingertips(model);
    let pairs: Vec<Vec<FingerTip>> = match tips.as_slice() {
        [one] => vec![vec![*one]],
        several => several
            .iter()
            .enumerate()
            .flat_map(|(k, a)| several[k + 1..].iter().map(|b| vec![*a, *b]))
            .collect(),
    };
    let several_digits = tips.len() > 2;
    // All digits close, or the two alone.
    let variants: &[bool] = if several_digits { &[false, true] } else { &[false] };
    let mut shapes: Vec<GraspShape> = variants
        .iter()
        .flat_map(|&alone| pairs.iter().map(move |pair| (pair, alone)))
        .flat_map(|(pair, alone)| shapes_of_pair(&hand, pair, width, several_digits, alone))
        .collect();
    shapes.sort_by(|a, b| b.room.total_cmp(&a.room));
    // The one that the hand's own build suggests, wherever it has room.
    let by_build = shapes.iter().max_by(|a, b| {
        let order = a.closing_m.total_cmp(&b.closing_m);
        order.then(a.straightness.total_cmp(&b.straightness))
    });
    let by_build = by_build.cloned();
    let mut kept: Vec<GraspShape> = Vec::new();
    for shape in shapes {
        let of_pair = kept.iter().filter(|other| other.pair == shape.pair);
        let is_same = |other: &&GraspShape| {
            other.grasp.closed_pose == shape.grasp.closed_pose
                && other.approach.angle(&shape.approach) < DISTINCT_RAD
        };
        if kept.len() < MAX_SHAPES
            && of_pair.clone().count() < MAX_SHAPES_OF_PAIR
            && !of_pair.clone().any(|other| is_same(&other))
        {
            kept.push(shape);
        }
    }
    kept.extend(by_build);
    kept
}

/// The shapes of two digits, one for each direction from which the hand may come.
fn shapes_of_pair(
    hand: &ClosingHand<'_>,
    pair: &[FingerTip],
    width: f64,
    several_digits: bool,
    pair_alone: bool,
) -> Vec<GraspShape> {
    let model = hand.model;
    // Where their ends are a block and two fingertips apart; else as near to that as they come.
    let thick = 2.0 * pair.iter().map(|tip| thickness(model, tip)).sum::<f64>() / pair.len() as f64;
    let share_at = |gap: f64| {
        let off = |share: f64| (hand.gap(pair, share) - gap).abs();
        (0..=CLOSING_STEPS)
            .map(|k| f64::from(k) / f64::from(CLOSING_STEPS))
            .min_by(|a, b| off(*a).total_cmp(&off(*b)))
            .unwrap_or_default()
    };
    let closing_m = hand.gap(pair, 0.0) - hand.gap(pair, 1.0);
    if closing_m < 1e-3 {
        return Vec::new();
    }
    let gripping = share_at(width + thick);
    // The other digits of a hand come down with the two: they are not left standing out.
    let room_before = if several_digits { PREGRASP_ROOM_M } else { GRIPPER_ROOM_M };
    let before = share_at(width + thick + 2.0 * room_before).min(gripping);
    let (apart, together) = (hand.poses(before), hand.poses(gripping));
    let ([far_a, far_b], [a, b]) = (hand.ends(pair, &apart), hand.ends(pair, &together));
    let opening = (far_b - far_a).norm() - thick;
    let Some(closing) = (b - a).try_normalize(1e-6).or_else(|| (far_b - far_a).try_normalize(1e-6)) else {
        return Vec::new();
    };
    let middle = (a + b) / 2.0;
    let (way_a, way_b) = (a - far_a, b - far_b);
    let way = way_a.norm() + way_b.norm();
    let along = if way > 1e-9 { (way_a - way_b).dot(&closing).abs() / way } else { 1.0 };
    let too_narrow = (width + ROOM_M - opening).max(0.0);
    let roots = pair.iter().map(|tip| apart[tip.root].translation.vector).sum::<Vector>() / pair.len() as f64;
    let from_roots = (middle - roots).try_normalize(1e-6).unwrap_or_else(Vector::zeros);
    let across = if closing.x.abs() < 0.9 { Vector::x() } else { Vector::y() };
    let across = (across - closing * closing.dot(&across)).normalize();
    let names: Vec<&str> = pair.iter().map(|tip| model.links[tip.root].name.as_str()).collect();
    let narrow =
        if opening < width + ROOM_M { ", which is too narrow for the blocks of the task" } else { "" };
    let sentence = format!(
        "the hand closes between the digits on {} and opens to {:.0} mm{narrow}",
        names.join(" and "),
        1e3 * opening.max(0.0)
    );
    let pose = |name: &str, angles: Vec<f64>| NamedPose {
        name: format!("grip_{:.0}_{name}", 1e3 * width),
        group: "hand".to_owned(),
        angles,
    };
    let mut poses = Vec::new();
    if before > 0.0 {
        poses.push(pose("open", hand.angles(before)));
    }
    if pair_alone {
        poses.push(pose("closed", hand.angles_of_pair(pair, before)));
    }
    let name_of = |ending: &str, default: &'static str| -> Cow<'static, str> {
        let named = poses.iter().find(|pose| pose.name.ends_with(ending));
        named.map_or(default.into(), |pose| pose.name.clone().into())
    };
    let (open_pose, closed_pose) = (name_of("_open", OPEN_POSE), name_of("_closed", CLOSED_POSE));
    let points = [hand_points(model, pair, &apart), hand_points(model, pair, &together)].concat();
    let shape = |k: u32| {
        let angle = f64::from(k) * std::f64::consts::TAU / f64::from(APPROACHES);
        let approach = UnitQuaternion::from_scaled_axis(closing * angle) * across;
        // Of digits without shapes, where their links end.
        let tips = a.dot(&approach).max(b.dot(&approach));
        let of_pair = points.iter().filter(|point| point.grips).map(|point| point.at.dot(&approach));
        let end = of_pair.fold(tips, f64::max);
        let center = middle + approach * (end - FINGER_DEPTH_M - middle.dot(&approach));
        let frame = mount::grasp_rotation(&closing, &approach);
        let grasp = Grasp {
            width_range_m: [0.0, (((opening - ROOM_M) * 1e3).floor() / 1e3).max(0.005)],
            center: (frame.inverse() * center).map(|x| (x * 1e5).round() / 1e5),
            open_pose: open_pose.clone(),
            closed_pose: closed_pose.clone(),
            closing_direction: Some(Vector::x()),
            roll_rad: 0.0,
            roll_range_rad: [-MAX_ROLL_RAD, MAX_ROLL_RAD],
            max_lean_rad: MAX_LEAN_RAD,
            capture_radius_m: 0.5 * (opening + width),
            withdrawal_direction: Vector::z(),
        };
        let room =
            room(&points, &center, &approach, &closing, width) - too_narrow + SLIDING_COST_M * (along - 1.0);
        GraspShape {
            frame,
            grasp,
            poses: poses.clone(),
            sentence: sentence.clone(),
            room,
            pair: pair.iter().map(|tip| tip.root).collect(),
            approach,
            closing_m,
            straightness: from_roots.dot(&approach),
        }
    };
    (0..APPROACHES).map(shape).collect()
}

/// A point of the hand, in the palm's frame.
#[derive(Clone, Copy, Debug)]
struct HandPoint {
    at: Vector,
    /// It is of the two digits that grip.
    grips: bool,
    /// It is of the last link of one of them, which is beside the block.
    is_beside: bool,
}

/// Corners of the hand's shapes, and where its wrist turns.
fn hand_points(model: &ArmModel, pair: &[FingerTip], poses: &[Pose]) -> Vec<HandPoint> {
    let (palm, digits) = (model.palm(), model.digits());
    let mut points = Vec::new();
    for link in 0..model.links.len() {
        if !palm[link] && digits[link].is_none() {
            continue;
        }
        let grips = digits[link].is_some() && pair.iter().any(|tip| digits[link] == Some(tip.root));
        let is_beside = pair.iter().any(|tip| tip.link == link);
        let shapes = model.links[link].collisions.iter();
        points.extend(
            shapes
                .flat_map(|part| corners(&part.shape).map(move |corner| part.pose * corner))
                .map(|corner| HandPoint { at: (poses[link] * corner).coords, grips, is_beside }),
        );
    }
    let wrist = model.arm.iter().rev().take(2);
    points.extend(wrist.map(|&joint| HandPoint {
        at: poses[model.joints[joint].child].translation.vector,
        grips: false,
        is_beside: false,
    }));
    points
}

/// The least room of a hand about a block on the table, metres: above the table, above the block, and within the cone.
fn room(points: &[HandPoint], center: &Vector, approach: &Vector, closing: &Vector, width: f64) -> f64 {
    let half = 0.5 * width;
    let side = approach.cross(closing);
    let of_point = |point: &HandPoint| {
        let from = point.at - center;
        let (depth, along, aside) = (from.dot(approach), from.dot(closing), from.dot(&side));
        let outward = along.hypot(aside);
        let over_table = half - ROOM_M - depth;
        let in_cone = over_table - CONE_SLOPE * (outward - CONE_RADIUS_M).max(0.0);
        let is_over = !point.is_beside && along.abs() < half + ROOM_M && aside.abs() < half;
        if is_over { in_cone.min(-half - ROOM_M - depth) } else { in_cone }
    };
    points.iter().map(of_point).fold(f64::INFINITY, f64::min)
}

/// Corners of the box about a shape.
fn corners(shape: &Shape) -> [Point; 8] {
    let [x, y, z] = match *shape {
        Shape::Box { size } => size.map(|side| 0.5 * side),
        Shape::Sphere { radius } => [radius / 3_f64.sqrt(); 3],
        Shape::Cylinder { radius, length } => [radius / 2_f64.sqrt(), radius / 2_f64.sqrt(), 0.5 * length],
        Shape::Capsule { radius, length } => [radius / 2_f64.sqrt(), radius / 2_f64.sqrt(), 0.5 * length],
    };
    std::array::from_fn(|k| {
        let sign = |bit: usize| if k >> bit & 1 == 0 { 1.0 } else { -1.0 };
        Point::new(x * sign(0), y * sign(1), z * sign(2))
    })
}

/// Half the least side of the shapes at the end of a digit, metres.
fn thickness(model: &ArmModel, tip: &FingerTip) -> f64 {
    let shapes = model.links[tip.link].collisions.iter().map(|part| match part.shape {
        Shape::Box { size } => 0.5 * size.iter().copied().fold(f64::INFINITY, f64::min),
        Shape::Sphere { radius } | Shape::Capsule { radius, .. } => radius,
        Shape::Cylinder { radius, length } => radius.min(0.5 * length),
    });
    let least = shapes.fold(f64::INFINITY, f64::min);
    if least.is_finite() { least } else { 0.0 }
}

/// Adds the frame in which the grasp is given, and makes it the arm's tip.
pub(crate) fn add_grasp_frame(model: &mut ArmModel, shape: &GraspShape) {
    let mut name = "grasp_frame".to_owned();
    while model.link(&name).is_ok() || model.joint(&format!("{name}_joint")).is_ok() {
        name.push('_');
    }
    model.links.push(Link {
        name: name.clone(),
        inertial: None,
        collisions: Vec::new(),
        visuals: Vec::new(),
    });
    model.joints.push(Joint {
        name: format!("{name}_joint"),
        kind: JointKind::Fixed,
        parent: model.tip,
        child: model.links.len() - 1,
        origin: Pose::from_parts(nalgebra::Translation3::identity(), shape.frame),
        axis: Vector::x(),
        limits: proact_arm::JointLimits::default(),
        damping: 0.0,
        friction: 0.0,
    });
    model.tip = model.links.len() - 1;
}
