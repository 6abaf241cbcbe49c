//! An arm side by side: what our arithmetic, KDL, urdfdom and the two engines of the physics say of it, at random angles.

use proact_arm::{ArmModel, Chain, ChainPoses};
use proact_control::ports::ArmKinematics;
use proact_description::{DescriptionError, urdfdom_link_poses};
use proact_dynamics::{DynamicsOptions, PhysicsEngine, RigidBodyPlant};
use proact_kinematics::Kinematics;
use proact_testbed::ports::Plant;
use proact_types::{Number, PlantCommand, Point, Pose, Scene, TICK_SECS, Vector, joints, zeros};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::Serialize;
use std::fmt;

/// Poses and Jacobians of one arm that differ by more than this, in metres, rad or their ratio, are not rounding.
const ROUNDING_TOLERANCE: f64 = 1e-9;
/// Share of the largest torque of gravity by which a motion of the physics may miss KDL's equation of motion: the motion of
/// a whole tick stands for the acceleration at its beginning.
const MOTION_TOLERANCE: f64 = 2e-3;
/// ... and in the engine `ode`, whose solver loses digits where heavy links carry light fingers.
const ODE_MOTION_TOLERANCE: f64 = 1e-2;
/// The joints of the engine `ode` yield less than in a trial, where they are soft enough to show: what is compared is the arm.
const JOINT_CFM: f64 = 1e-12;

/// The largest difference between two who compute the same.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ArmDifference {
    /// What is compared, and between whom.
    pub what: String,
    /// How far apart they are at most, or why they cannot be compared.
    pub largest: Result<LargestDifference, String>,
}

/// Where two are furthest apart.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LargestDifference {
    /// How far.
    pub difference: f64,
    /// `m`, `rad`, `m, or rad, per rad`, `N m`.
    pub unit: &'static str,
    /// Up to here it is rounding, or the length of a tick.
    #[serde(rename = "expected")]
    pub tolerance: f64,
    /// Link or joint.
    pub at: String,
    /// Angles of all moving joints there, rad.
    pub angles: Vec<f64>,
    /// Torques of gravity there by KDL, N m, where torques are compared.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub torques: Vec<f64>,
}

/// An arm side by side.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ArmComparison {
    /// Its name.
    pub arm: String,
    /// Postures that were compared.
    pub postures: usize,
    /// Names of the moving joints, in the order of all vectors.
    pub joints: Vec<String>,
    /// One for each pair.
    pub differences: Vec<ArmDifference>,
}

impl ArmComparison {
    /// Whether all agrees; what cannot be compared does not.
    pub fn agrees(&self) -> bool {
        let agrees = |row: &ArmDifference| {
            row.largest.as_ref().is_ok_and(|largest| largest.difference <= largest.tolerance)
        };
        self.differences.iter().all(agrees)
    }
}

/// Why an arm cannot be compared at all.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CompareError {
    /// KDL.
    #[error("kinematics: {0}")]
    Kinematics(#[from] proact_control::ports::KinematicsError),
    /// urdfdom.
    #[error(transparent)]
    Description(#[from] DescriptionError),
}

/// Keeps the largest of what it is shown.
struct MaxTracker {
    unit: &'static str,
    expected: f64,
    largest: Option<LargestDifference>,
}

impl MaxTracker {
    fn new(unit: &'static str, expected: f64) -> Self {
        Self { unit, expected, largest: None }
    }

    fn update(&mut self, difference: f64, at: &str, angles: &[f64], torques: &[f64]) {
        // Written so that a difference that is no number is the largest.
        if self.largest.as_ref().is_some_and(|largest_difference| difference <= largest_difference.difference)
        {
            return;
        }
        self.largest = Some(LargestDifference {
            difference,
            unit: self.unit,
            tolerance: self.expected,
            at: at.to_owned(),
            angles: angles.to_vec(),
            torques: torques.to_vec(),
        });
    }

    fn into_difference(self, what: &str) -> ArmDifference {
        ArmDifference { what: what.to_owned(), largest: self.largest.ok_or("no posture".to_owned()) }
    }
}

/// Compares the arm `model`, which was read from the text `urdf`, at `postures` random ones.
///
/// # Errors
/// [`CompareError`]; an engine that cannot simulate the arm says so in its row.
pub fn compare_arm(
    model: &ArmModel,
    urdf: &str,
    postures: usize,
    seed: u64,
) -> Result<ArmComparison, CompareError> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let angles: Vec<Vec<f64>> = (0..postures).map(|_| posture(model, &mut random)).collect();
    let mut kinematics = Kinematics::new(model)?;
    let mut differences = kinematics_rows(model, urdf, &mut kinematics, &angles)?;
    for engine in [PhysicsEngine::Reduced, PhysicsEngine::Ode] {
        let name = if engine == PhysicsEngine::Reduced { "reduced" } else { "ode" };
        match engine_rows(model, engine, name, &mut kinematics, &angles) {
            Ok(rows) => differences.extend(rows),
            Err(reason) => differences.push(ArmDifference {
                what: format!("engine {name}, KDL"),
                largest: Err(reason.to_string()),
            }),
        }
    }
    let names = model.moving().map(|joint| model.joints[joint].name.clone()).collect();
    Ok(ArmComparison { arm: model.name.clone(), postures, joints: names, differences })
}

fn posture(model: &ArmModel, random: &mut ChaCha8Rng) -> Vec<f64> {
    let draw = |joint: usize| {
        let limits = model.joints[joint].limits;
        let (middle, half) = ((limits.lower + limits.upper) / 2.0, (limits.upper - limits.lower) / 2.0);
        middle + half * random.random_range(-1.0..=1.0)
    };
    model.moving().map(draw).collect()
}

/// Distance and angle between two poses.
fn pose_distance(one: &Pose, other: &Pose) -> (f64, f64) {
    let between = one.inv_mul(other);
    (between.translation.vector.norm(), between.rotation.angle())
}

/// Poses of all links and the tip's Jacobian: ours beside KDL's, urdfdom's beside ours.
fn kinematics_rows(
    model: &ArmModel,
    urdf: &str,
    kinematics: &mut Kinematics,
    angles: &[Vec<f64>],
) -> Result<Vec<ArmDifference>, CompareError> {
    let mut rows = [(); 2]
        .map(|()| [MaxTracker::new("m", ROUNDING_TOLERANCE), MaxTracker::new("rad", ROUNDING_TOLERANCE)]);
    let mut jacobian = MaxTracker::new("m, or rad, per rad", ROUNDING_TOLERANCE);
    let (chain, mut poses) = (Chain::new(model), ChainPoses::default());
    for q in angles {
        let ours = model.link_poses(q);
        let peers = [kinematics.link_poses(q)?, urdfdom_link_poses(urdf, model, q)?];
        for ([meters, radians], theirs) in rows.iter_mut().zip(peers) {
            for ((ours, theirs), link) in ours.iter().zip(&theirs).zip(&model.links) {
                let (distance, angle) = pose_distance(ours, theirs);
                meters.update(distance, &link.name, q, &[]);
                radians.update(angle, &link.name, q, &[]);
            }
        }
        let arm = &q[..model.arm_count()];
        chain.link_poses_into(arm, &mut poses);
        let columns = chain.jacobian(&poses, &Point::from(poses.tip.translation.vector));
        let theirs = kinematics.jacobian(arm)?;
        for (k, column) in columns.iter().enumerate() {
            let difference = (column - theirs.fixed_view::<6, 1>(0, k)).amax();
            jacobian.update(difference, &model.joints[model.arm[k]].name, q, &[]);
        }
    }
    let [[kdl_m, kdl_rad], [urdf_m, urdf_rad]] = rows;
    Ok(vec![
        kdl_m.into_difference("place of a link: ours, KDL"),
        kdl_rad.into_difference("attitude of a link: ours, KDL"),
        urdf_m.into_difference("place of a link: ours, urdfdom"),
        urdf_rad.into_difference("attitude of a link: ours, urdfdom"),
        jacobian.into_difference("Jacobian of the tip: ours, KDL"),
    ])
}

/// Where an engine has the links, and the torque that KDL's equation of motion lacks for the motion that the engine makes of
/// the limp arm under gravity.
fn engine_rows(
    model: &ArmModel,
    engine: PhysicsEngine,
    name: &str,
    kinematics: &mut Kinematics,
    angles: &[Vec<f64>],
) -> Result<[ArmDifference; 2], Box<dyn std::error::Error>> {
    let options =
        DynamicsOptions { engine, lock_idle_hand: false, joint_cfm: JOINT_CFM, ..DynamicsOptions::default() };
    let nothing = Scene::default();
    let (base, rest) = (Pose::identity(), zeros(model.moving_count()));
    let limp = without_joint_forces(model);
    let mut position = MaxTracker::new("m", ROUNDING_TOLERANCE);
    let mut missing: Vec<(f64, String, &[f64], Vec<f64>)> = Vec::new();
    let mut strongest = 0.0_f64;
    for q in angles {
        let mut plant = RigidBodyPlant::new(&limp, &nothing, q, &base, options)?;
        for ((link, ours), of) in model.link_poses(q).iter().enumerate().zip(&model.links) {
            position.update(pose_distance(ours, &plant.link_pose(link)?).0, &of.name, q, &[]);
        }
        plant.step(&PlantCommand { position: joints(q), velocity: rest.clone(), world_from_base: base })?;
        let acceleration: Vec<f64> = plant.state().velocity.iter().map(|speed| speed / TICK_SECS).collect();
        let gravity: &Vector = &options.gravity;
        let effort_residual = kinematics.inverse_dynamics(q, &rest, &acceleration, gravity)?;
        let still = kinematics.inverse_dynamics(q, &rest, &rest, gravity)?;
        strongest = still.iter().fold(strongest, |max, torque| max.max(torque.abs()));
        // A joint that cannot move bears what there is.
        let turns = |joint: &usize| model.joints[*joint].limits.lower < model.joints[*joint].limits.upper;
        for (torque, joint) in effort_residual.iter().zip(model.moving()).filter(|(_, joint)| turns(joint)) {
            missing.push((torque.abs(), model.joints[joint].name.clone(), q, still.to_vec()));
        }
    }
    let share = if engine == PhysicsEngine::Ode { ODE_MOTION_TOLERANCE } else { MOTION_TOLERANCE };
    let mut torque = MaxTracker::new("N m", share * strongest);
    for (difference, joint, q, still) in &missing {
        torque.update(*difference, joint, q, still);
    }
    Ok([
        position.into_difference(&format!("place of a link: ours, engine {name}")),
        torque.into_difference(&format!("torque: engine {name}, KDL")),
    ])
}

/// The arm without damping, friction, stops and motors.
fn without_joint_forces(model: &ArmModel) -> ArmModel {
    let mut model = model.clone();
    for joint in &mut model.joints {
        (joint.damping, joint.friction, joint.limits.effort) = (0.0, 0.0, 0.0);
        // A joint that cannot move stays so.
        if joint.limits.lower < joint.limits.upper {
            (joint.limits.lower, joint.limits.upper) = (f64::NEG_INFINITY, f64::INFINITY);
        }
    }
    model
}

impl fmt::Display for ArmComparison {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}: largest differences at {} random postures", self.arm, self.postures)?;
        for ArmDifference { what, largest } in &self.differences {
            match largest {
                Err(reason) => writeln!(f, "  {what:36} cannot be compared: {reason}")?,
                Ok(largest_difference) => {
                    let verdict = if largest_difference.difference <= largest_difference.tolerance {
                        "agree"
                    } else {
                        "DIFFER"
                    };
                    let (difference, expected) =
                        (largest_difference.difference, largest_difference.tolerance);
                    writeln!(
                        f,
                        "  {what:36} {difference:9.2e} {} at {} ({verdict}: up to {expected:.1e} expected)",
                        largest_difference.unit, largest_difference.at
                    )?;
                    writeln!(f, "    angles, rad:  {}", numbers(&largest_difference.angles))?;
                    if !largest_difference.torques.is_empty() {
                        writeln!(f, "    torques of gravity, N m: {}", numbers(&largest_difference.torques))?;
                    }
                }
            }
        }
        write!(f, "{}", if self.agrees() { "all agree" } else { "NOT all agree" })
    }
}

fn numbers(values: &[f64]) -> String {
    values.iter().map(|value| format!("{:.4}", Number(*value))).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use proact_description::{MPL_RIGHT_ARM_URDF, mpl_right_arm};

    #[test]
    fn the_shipped_arm_is_the_same_for_all_and_a_changed_one_is_told_with_link_posture_and_torques() {
        let model = mpl_right_arm();
        let agreed = compare_arm(&model, MPL_RIGHT_ARM_URDF, 10, 1).unwrap();
        assert!(agreed.agrees(), "{agreed}");
        assert_eq!(agreed.differences.len(), 9, "{agreed}");
        assert!(agreed.differences.iter().all(|row| row.largest.is_ok()), "{agreed}");

        // The text has another forearm than the model.
        let mut moved = model.clone();
        let elbow = moved.joint("mpl_right_arm__forearm").unwrap();
        moved.joints[elbow].origin.translation.vector.x += 1e-6;
        let differs = compare_arm(&moved, MPL_RIGHT_ARM_URDF, 10, 1).unwrap();
        let rows = differs.differences.iter().filter(|row| {
            !row.largest
                .as_ref()
                .is_ok_and(|largest_difference| largest_difference.difference <= largest_difference.tolerance)
        });
        let names: Vec<&str> = rows.map(|row| row.what.as_str()).collect();
        assert_eq!(names, ["place of a link: ours, urdfdom"], "{differs}");
        assert!(!differs.agrees() && differs.to_string().contains("DIFFER"), "{differs}");
    }

    #[test]
    fn an_arm_that_cannot_be_simulated_is_compared_as_far_as_it_goes() {
        let mut model = mpl_right_arm();
        let link = model.link("mpl_right_arm__elbow_link").unwrap();
        model.links[link].inertial = None;
        let compared = compare_arm(&model, MPL_RIGHT_ARM_URDF, 3, 1).unwrap();
        let refused: Vec<_> = compared.differences.iter().filter(|row| row.largest.is_err()).collect();
        assert_eq!(refused.len(), 2, "{compared}");
        assert!(compared.to_string().contains("cannot be compared"), "{compared}");
    }
}
