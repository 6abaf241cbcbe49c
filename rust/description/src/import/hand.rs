//! Finds how the hand of an imported arm opens and closes.

use super::mount;
use nalgebra::UnitQuaternion;
use proact_arm::{ArmModel, CLOSED_POSE, Grasp, Joint, JointKind, Link, NamedPose, OPEN_POSE};
use proact_types::{Point, Pose, Shape, Vector};

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
pub(crate) struct GraspShape {
    /// `tip_from_frame` of a frame whose z is up and along whose x the fingers close.
    frame: UnitQuaternion<f64>,
    /// In that frame.
    pub(crate) grasp: Grasp,
    pub(crate) sentence: String,
}

/// How far the ends of the fingers reach below the middle of what they hold, metres.
const FINGER_DEPTH_M: f64 = 0.02;
/// How far a hand may be tilted about the line along which it closes, and lean to the side, rad.
const MAX_ROLL_RAD: f64 = 0.45;
const MAX_LEAN_RAD: f64 = 0.26;
/// Room that the open hand has on each side of what it holds, metres.
const ROOM_M: f64 = 0.003;

/// Where the hand holds a block of `width`, metres: between the two digits that come together most as it closes, approached from
/// where the fingers point. None if no digits come together.
pub(crate) fn grasp_shape(model: &ArmModel, width: f64) -> Option<GraspShape> {
    let (open, closed) = (model.pose("hand", OPEN_POSE).ok()?, model.pose("hand", CLOSED_POSE).ok()?);
    let at = |share: f64| -> Vec<Pose> {
        let hand: Vec<f64> = open.iter().zip(closed).map(|(a, b)| a + share * (b - a)).collect();
        hand_poses(model, &hand)
    };
    let (apart, together) = (at(0.0), at(1.0));
    let tips = fingertips(model);
    let palm_from_base = apart[model.tip].inverse();
    // Two digits, or one against the palm: where their ends are, palm's frame.
    let ends = |pair: &[FingerTip], poses: &[Pose]| -> [Vector; 2] {
        let place = |tip: &FingerTip| (palm_from_base * tip.place(poses)).coords;
        match pair {
            [a, b] => [place(a), place(b)],
            // What does not move is where the one that moves goes.
            [a, ..] => [place(a), place_at_end(a, &together, &palm_from_base)],
            [] => [Vector::zeros(); 2],
        }
    };
    let closing_of = |pair: &[FingerTip]| {
        let gap = |poses: &[Pose]| {
            let [a, b] = ends(pair, poses);
            (b - a).norm()
        };
        gap(&apart) - gap(&together)
    };
    let pairs: Vec<Vec<FingerTip>> = match tips.as_slice() {
        [one] => vec![vec![*one]],
        several => several
            .iter()
            .enumerate()
            .flat_map(|(k, a)| several[k + 1..].iter().map(|b| vec![*a, *b]))
            .collect(),
    };
    let pair = pairs.iter().max_by(|a, b| closing_of(a).total_cmp(&closing_of(b)))?;
    // Where their ends are a block and two fingertips apart; else as near to that as they come.
    let thick = 2.0 * pair.iter().map(|tip| thickness(model, tip)).sum::<f64>() / pair.len() as f64;
    let wanted = width + thick;
    let off = |share: f64| {
        let [a, b] = ends(pair, &at(share));
        ((b - a).norm() - wanted).abs()
    };
    let steps = 40;
    let share =
        (0..=steps).map(|k| f64::from(k) / f64::from(steps)).min_by(|a, b| off(*a).total_cmp(&off(*b)))?;
    let poses = at(share);
    let [a, b] = ends(pair, &poses);
    let [far_a, far_b] = ends(pair, &apart);
    let opening = (far_b - far_a).norm() - thick;
    if closing_of(pair) < 1e-3 {
        return None;
    }
    let closing = (b - a).try_normalize(1e-6).or_else(|| (far_b - far_a).try_normalize(1e-6))?;
    let middle = (a + b) / 2.0;
    let roots = pair.iter().map(|tip| (palm_from_base * apart[tip.root]).translation.vector);
    let knuckles = roots.sum::<Vector>() / pair.len() as f64;
    let across = |way: Vector| way - closing * way.dot(&closing);
    let approach =
        [across(middle - knuckles), across(middle)].into_iter().find(|way| way.norm() > 0.005)?.normalize();
    let end = a.dot(&approach).max(b.dot(&approach));
    let center = middle + approach * (end - FINGER_DEPTH_M - middle.dot(&approach));
    let frame = mount::grasp_rotation(&closing, &approach);
    let names: Vec<&str> = pair.iter().map(|tip| model.links[tip.root].name.as_str()).collect();
    let grasp = Grasp {
        width_range_m: [0.0, (((opening - ROOM_M) * 1e3).floor() / 1e3).max(0.005)],
        center: (frame.inverse() * center).map(|x| (x * 1e5).round() / 1e5),
        closing_direction: Some(Vector::x()),
        roll_rad: 0.0,
        roll_range_rad: [-MAX_ROLL_RAD, MAX_ROLL_RAD],
        max_lean_rad: MAX_LEAN_RAD,
        capture_radius_m: 0.5 * (opening + width),
        withdrawal_direction: Vector::z(),
        ..Grasp::default()
    };
    let narrow =
        if opening < width + ROOM_M { ", which is too narrow for the blocks of the task" } else { "" };
    let sentence = format!(
        "the hand closes between the digits on {} and opens to {:.0} mm{narrow}",
        names.join(" and "),
        1e3 * opening.max(0.0)
    );
    Some(GraspShape { frame, grasp, sentence })
}

fn place_at_end(tip: &FingerTip, poses: &[Pose], palm_from_base: &Pose) -> Vector {
    (palm_from_base * tip.place(poses)).coords
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
