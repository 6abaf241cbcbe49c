//! Plans for part of an arm: the joints of the person's own limb stay, and the others do what they can.
//!
//! The held joints become fixed ones of a smaller arm, for which a planner of its own is made: inverse kinematics and search
//! know nothing of them. With fewer than six joints few poses of the hand can be met exactly, so that a goal counts as
//! reached within a [`GoalTolerance`].

use crate::axis_ik::{ArmJointLimits, IkGoal, solve_ik};
use crate::problem::LIMIT_TOLERANCE_RAD;
use crate::{ArmPlanner, PlanningError};
use proact_arm::{ArmModel, Chain, ChainPoses};
use proact_control::ports::{ArmKinematics, IkOutcome, KinematicsError};
use proact_types::{JointVector, PlanGoal, PlanReply, PlanRequest, PlanStatus, Point, Pose, Vector};
use std::sync::Arc;

/// How far off the hand of part of an arm may be, metres and rad.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct GoalTolerance {
    /// The point of the hand from its target.
    pub position_m: f64,
    /// The axis of the hand from its direction.
    pub axis_rad: f64,
}

impl GoalTolerance {
    /// Assumed: a third of the opening of the grasps' tilt, and what a closing hand pulls in, a third of a block's width.
    pub const PARTIAL_ARM: Self = Self { position_m: 0.012, axis_rad: 0.15 };
}

/// The answer to `request`, which holds joints of the arm of `whole`.
pub(crate) fn plan_with_held_joints(whole: &ArmPlanner, request: &PlanRequest) -> PlanReply {
    let refused = |reason: String| PlanReply::without_plan(request.id, PlanStatus::Invalid, reason);
    let joints = whole.context.model.arm_count();
    if request.start.len() != joints || request.held_joints.iter().any(|joint| *joint >= joints) {
        return refused(format!(
            "the plan holds joints {:?} of {} angles, the arm has {joints}",
            request.held_joints,
            request.start.len()
        ));
    }
    if !request.start.iter().all(|angle| angle.is_finite()) {
        return refused("an angle of the start is not finite".to_owned());
    }
    // A limb that is tracked beyond what the arm could do is where it is.
    let held: Vec<(usize, f64)> =
        request.held_joints.iter().map(|&joint| (joint, request.start[joint])).collect();
    let moves: Vec<usize> = (0..joints).filter(|joint| !request.held_joints.contains(joint)).collect();
    if moves.is_empty() {
        return refused("the person's own limb has all joints: there is nothing to plan".to_owned());
    }
    let part_of = |angles: &[f64]| -> JointVector { moves.iter().map(|&joint| angles[joint]).collect() };
    let goal = match &request.goal {
        PlanGoal::Joints { q } if q.len() == joints => {
            let off = held.iter().any(|&(joint, angle)| (q[joint] - angle).abs() > LIMIT_TOLERANCE_RAD);
            if off {
                return refused("the goal moves joints of the person's own limb".to_owned());
            }
            PlanGoal::Joints { q: part_of(q) }
        }
        other => other.clone(),
    };
    let partial_request =
        PlanRequest { start: part_of(&request.start), goal, held_joints: Vec::new(), ..request.clone() };
    let mut planner = match partial_arm_planner(whole, &held) {
        Ok(planner) => planner,
        Err(error) => return refused(error.to_string()),
    };
    let mut reply = planner.plan_all_joints(&partial_request);
    for point in &mut reply.trajectory.points {
        let (q, qd) = (std::mem::take(&mut point.q), std::mem::take(&mut point.qd));
        point.q = request.start.clone();
        point.qd = request.start.iter().map(|_| 0.0).collect();
        for (k, &joint) in moves.iter().enumerate() {
            (point.q[joint], point.qd[joint]) = (q[k], qd[k]);
        }
    }
    reply
}

fn partial_arm_planner(whole: &ArmPlanner, held: &[(usize, f64)]) -> Result<ArmPlanner, PlanningError> {
    let context = &whole.context;
    let model = Arc::new(context.model.with_held_joints(held));
    let kinematics = Box::new(PartialArmKinematics::new(&model));
    let mut planner = ArmPlanner::new(model, kinematics, context.options.clone())?;
    planner.context.goal_tolerance = Some(GoalTolerance::PARTIAL_ARM);
    planner.context.cancel = context.cancel.clone();
    planner.context.stage = context.stage.clone();
    planner.context.deadline = context.deadline;
    planner.context.set_meshes(context.meshes().to_vec())?;
    Ok(planner)
}

/// Kinematics of a smaller arm, by the same chain that the planner uses; that of the whole arm was compared with KDL.
struct PartialArmKinematics {
    chain: Chain,
    limits: ArmJointLimits,
}

impl PartialArmKinematics {
    fn new(model: &ArmModel) -> Self {
        let chain = Chain::new(model);
        let limits = ArmJointLimits(chain.limits().to_vec());
        Self { chain, limits }
    }

    fn check(&self, q: &[f64]) -> Result<(), KinematicsError> {
        let expected = self.chain.joint_count();
        if q.len() != expected {
            return Err(KinematicsError::WrongJointCount { got: q.len(), expected });
        }
        match q.iter().position(|angle| !angle.is_finite()) {
            Some(index) => Err(KinematicsError::NotFinite { what: "joint angle", index, value: q[index] }),
            None => Ok(()),
        }
    }
}

impl ArmKinematics for PartialArmKinematics {
    fn joint_count(&self) -> usize {
        self.chain.joint_count()
    }

    fn forward(&mut self, q: &[f64]) -> Result<Pose, KinematicsError> {
        self.check(q)?;
        Ok(self.chain.forward(q))
    }

    fn jacobian(&mut self, q: &[f64]) -> Result<nalgebra::DMatrix<f64>, KinematicsError> {
        self.check(q)?;
        let mut poses = ChainPoses::default();
        self.chain.link_poses_into(q, &mut poses);
        let columns = self.chain.jacobian(&poses, &Point::from(poses.tip.translation.vector));
        Ok(nalgebra::DMatrix::from_fn(6, columns.len(), |row, column| columns[column][row]))
    }

    fn inverse(&mut self, base_from_tip: &Pose, seed: &[f64]) -> Result<IkOutcome, KinematicsError> {
        self.check(seed)?;
        let reach = IkGoal {
            point: Point::origin(),
            axis: Vector::z(),
            target: Point::from(base_from_tip.translation.vector),
            direction: Vector::z(),
            orientation: Some(base_from_tip.rotation),
            tolerance: None,
        };
        let found = solve_ik(&self.chain, &self.limits, &reach, seed);
        Ok(found.map_or(IkOutcome::NotFound, |q| IkOutcome::Solved(q.into_iter().collect())))
    }
}
