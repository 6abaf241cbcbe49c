use crate::{BenchFigure, BenchReport, quantile};
use nalgebra::DMatrix;
use proact_app::query::low_discrepancy;
use proact_arm::ArmModel;
use proact_kinematics::{ArmKinematics, IkOutcome, Kinematics, KinematicsError, time_raw_kdl};
use proact_types::{JointVector, Pose, zeros};
use std::{hint::black_box, time::Instant};

/// Rounds in which bridge and peer take turns, so that both see the same moods of the machine.
const ROUNDS: usize = 20;
/// Configurations in a round.
const CALLS: usize = 2_000;
/// Targets of the inverse kinematics.
const TARGETS: usize = 2_000;

/// Forward kinematics and Jacobian through the bridge beside a C++ loop on KDL, inverse kinematics and inverse
/// dynamics. About half a second. Every call is timed by itself, on both sides with the same clock.
///
/// # Errors
/// [`KinematicsError`] if the arm cannot be used.
pub fn kinematics() -> Result<BenchReport, KinematicsError> {
    let model = proact_description::mpl_right_arm();
    let mut kinematics = Kinematics::new(&model)?;
    let (bridge, raw) = forward_and_jacobian(&model, &mut kinematics)?;
    let peer = "C++ loop on KDL";
    let mut figures: Vec<BenchFigure> = [("median", 0.5), ("99 %", 0.99), ("worst", 1.0)]
        .into_iter()
        .map(|(name, share)| {
            let note = if share < 1.0 { "" } else { "the machine's interruptions included" };
            BenchFigure::without_peer(
                &format!("pose and Jacobian, {name}"),
                quantile(&bridge, share),
                "ns",
                note,
            )
            .with_peer(peer, quantile(&raw, share))
        })
        .collect();
    let ratio = quantile(&bridge, 0.5) / quantile(&raw, 0.5);
    figures.push(
        BenchFigure::without_peer("pose and Jacobian, ratio of medians", ratio, "1", "goal: at most 1.1")
            .with_peer(peer, 1.0),
    );

    let (times, solved) = inverse(&model, &mut kinematics)?;
    let note = "random reachable targets, start in the middle of the limits";
    for (name, share) in [("median", 0.5), ("99 %", 0.99), ("worst", 1.0)] {
        let name = format!("inverse kinematics, {name}");
        figures.push(BenchFigure::without_peer(&name, quantile(&times, share) / 1e3, "us", note));
    }
    figures.push(BenchFigure::without_peer("inverse kinematics, solved", solved, "1", "goal: at least 0.99"));

    let times = inverse_dynamics(&model, &mut kinematics)?;
    let note = "27 joints, same gravity from call to call";
    let median = quantile(&times, 0.5) / 1e3;
    figures.push(BenchFigure::without_peer("inverse dynamics of the tree, median", median, "us", note));
    Ok(BenchReport::new("kinematics", figures))
}

/// Nanoseconds of each call through the bridge, and of the peer's.
fn forward_and_jacobian(
    model: &ArmModel,
    kinematics: &mut Kinematics,
) -> Result<(Vec<f64>, Vec<f64>), KinematicsError> {
    let configurations: Vec<JointVector> = (0..CALLS as u64).map(|n| configuration(model, n)).collect();
    let (mut bridge, mut raw) = (Vec::new(), Vec::new());
    let mut pose = Pose::identity();
    let mut jacobian = DMatrix::zeros(6, model.arm_count());
    for _ in 0..ROUNDS {
        raw.extend(time_raw_kdl(model, &configurations)?);
        // The peer runs twice and keeps the second; so does this.
        for keep in [false, true] {
            for q in &configurations {
                let begin = Instant::now();
                kinematics.forward_into(q, &mut pose)?;
                kinematics.jacobian_into(q, &mut jacobian)?;
                let nanoseconds = begin.elapsed().as_secs_f64() * 1e9;
                black_box((&pose, &jacobian));
                if keep {
                    bridge.push(nanoseconds);
                }
            }
        }
    }
    Ok((bridge, raw))
}

/// Nanoseconds of each search, and the share of targets reached.
fn inverse(model: &ArmModel, kinematics: &mut Kinematics) -> Result<(Vec<f64>, f64), KinematicsError> {
    let middle: JointVector = model
        .arm
        .iter()
        .map(|&joint| (model.joints[joint].limits.lower + model.joints[joint].limits.upper) / 2.0)
        .collect();
    let mut times = Vec::new();
    let mut solved = 0;
    for n in 0..TARGETS as u64 {
        let target = kinematics.forward(&configuration(model, n))?;
        let begin = Instant::now();
        let outcome = kinematics.inverse(&target, &middle)?;
        times.push(begin.elapsed().as_secs_f64() * 1e9);
        solved += usize::from(outcome != IkOutcome::NotFound);
    }
    Ok((times, solved as f64 / TARGETS as f64))
}

fn inverse_dynamics(model: &ArmModel, kinematics: &mut Kinematics) -> Result<Vec<f64>, KinematicsError> {
    let mut q = zeros(model.moving_count());
    let rest = zeros(model.moving_count());
    let gravity = proact_types::Vector::new(0.0, 0.0, -9.80665);
    let mut times = Vec::new();
    for n in 0..CALLS as u64 {
        let arm = configuration(model, n);
        q[..arm.len()].copy_from_slice(&arm);
        let begin = Instant::now();
        black_box(kinematics.inverse_dynamics(&q, &rest, &rest, &gravity)?);
        times.push(begin.elapsed().as_secs_f64() * 1e9);
    }
    Ok(times)
}

/// Arm angles spread over the limits.
fn configuration(model: &ArmModel, number: u64) -> JointVector {
    let limits = model.arm.iter().map(|&joint| &model.joints[joint].limits);
    limits.enumerate().map(|(k, l)| l.lower + low_discrepancy(number, k) * (l.upper - l.lower)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Figures belong to the bench, not to tests; what is tested is that they are there and add up.
    #[test]
    fn the_report_has_every_figure_and_the_keys_of_the_machine_contract() {
        let report = kinematics().expect("the arm is usable");
        assert!(report.figures.iter().all(|figure| figure.value.is_finite() && figure.value > 0.0));
        let solved =
            report.figures.iter().find(|figure| figure.name.ends_with("solved")).expect("it is there");
        assert!(solved.value >= 0.99, "{}", solved.value);
        let json = serde_json::to_value(&report).expect("a report is plain data");
        assert_eq!(json["stage"], "kinematics");
        for key in ["name", "value", "unit", "peer", "peer_value", "note"] {
            assert!(json["figures"][0].get(key).is_some(), "{key}");
        }
    }
}
