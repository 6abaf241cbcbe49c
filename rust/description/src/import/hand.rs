//! Finds how the hand of an imported arm opens and closes.

use proact_arm::{ArmModel, CLOSED_POSE, NamedPose, OPEN_POSE};
use proact_types::Point;

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

/// Mean distance between the tips of different digits, metres, and for a single digit its distance from the tip's link.
fn fingertip_spread(model: &ArmModel, hand: &[f64]) -> f64 {
    let mut hand = hand.to_vec();
    let mut rates = vec![0.0; hand.len()];
    model.couplings().apply(&mut hand, &mut rates);
    let mut angles: Vec<f64> = model.arm.iter().map(|&joint| rest_angle(model, joint)).collect();
    angles.extend(hand);
    let poses = model.link_poses(&angles);
    let tips = fingertips(model, &poses);
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

/// The point of each digit that lies farthest out: the middle of the last link's shapes.
fn fingertips(model: &ArmModel, poses: &[proact_types::Pose]) -> Vec<Point> {
    let digits = model.digits();
    let mut roots: Vec<usize> = digits.iter().flatten().copied().collect();
    roots.sort_unstable();
    roots.dedup();
    roots
        .into_iter()
        .filter_map(|root| {
            let mut links = (0..model.links.len()).filter(|&link| digits[link] == Some(root));
            // Parents stand first, so the last link is at the end of the digit.
            let last =
                links.clone().rfind(|&link| !model.links[link].collisions.is_empty()).or(links.next_back())?;
            let shapes = &model.links[last].collisions;
            let middle = shapes
                .iter()
                .map(|shape| (poses[last] * shape.pose).translation.vector)
                .sum::<proact_types::Vector>();
            Some(match shapes.len() {
                0 => Point::from(poses[last].translation.vector),
                count => Point::from(middle / count as f64),
            })
        })
        .collect()
}
