use crate::ports::PlanService;
use proact_arm::ArmModel;
use proact_control::{
    doubles::SerialKinematics,
    ports::{ArmKinematics, IkOutcome},
};
use proact_types::{
    JointVector, PlanGoal, PlanReply, PlanRequest, PlanStatus, Point, Pose, Trajectory, TrajectoryPoint,
    Vector, zeros,
};
use std::{cell::RefCell, rc::Rc, sync::Arc};

/// A block is put down from this far above where it will stand, metres: half a block and a little.
const RELEASE_HEIGHT: f64 = 0.03;
/// Share of the joints' highest speed that the fastest joint of a plan takes at its peak.
const SPEED_SHARE: f64 = 0.9;
/// Peak over mean speed of a cubic that starts and ends at rest.
const PEAK_OVER_MEAN: f64 = 1.5;

/// What a planner was told.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PlanCall {
    /// To plan request `0`.
    Submit(u64),
    /// To give up.
    Cancel,
}

/// The calls of a planner, oldest first, shared with the test that owns the trial.
pub type PlanCalls = Rc<RefCell<Vec<PlanCall>>>;

/// Plans that are straight lines in joint space, made at once and without regard to obstacles.
///
/// A pick leads the grasp centre to the block's, a place to above its point, whatever the attitude of the hand.
/// Deterministic: the reply depends on the request alone. [`InstantPlans::late_by`] keeps replies back.
pub struct InstantPlans {
    model: Arc<ArmModel>,
    kinematics: SerialKinematics,
    calls: PlanCalls,
    reply: Option<PlanReply>,
    late_by: u32,
    /// Polls that are still answered with nothing.
    polls_left: u32,
}

impl InstantPlans {
    /// Plans for `model`.
    pub fn new(model: Arc<ArmModel>) -> Self {
        let kinematics = SerialKinematics::new(&model);
        Self { model, kinematics, calls: PlanCalls::default(), reply: None, late_by: 0, polls_left: 0 }
    }

    /// The first `polls` polls after each request find nothing: a live trial, which polls every tick from when a plan is
    /// due, gets it that many ticks late.
    pub fn late_by(self, polls: u32) -> Self {
        Self { late_by: polls, ..self }
    }

    /// What it is told, from now on.
    pub fn calls(&self) -> PlanCalls {
        self.calls.clone()
    }

    fn plan(&mut self, request: &PlanRequest) -> PlanReply {
        let reply = |status, trajectory, reason: &str| PlanReply {
            id: request.id,
            status,
            trajectory,
            reason: reason.to_owned(),
            clearance_m: None,
        };
        match self.goal(request) {
            Ok(IkOutcome::Solved(goal)) => {
                reply(PlanStatus::Ok, self.straight_trajectory(&request.start, goal), "")
            }
            Ok(IkOutcome::NotFound) => {
                reply(PlanStatus::Unreachable, Trajectory::default(), "the goal is out of reach")
            }
            Err(error) => reply(PlanStatus::Invalid, Trajectory::default(), &error.to_string()),
        }
    }

    /// The arm angles at the goal.
    fn goal(&mut self, request: &PlanRequest) -> Result<IkOutcome, proact_control::ports::KinematicsError> {
        let base_from_world: Pose = request.world_from_base.inverse();
        let (in_tip, in_world) = match &request.goal {
            PlanGoal::Joints { q } => return Ok(IkOutcome::Solved(q.clone())),
            PlanGoal::TipPose { pose } => {
                return self.kinematics.inverse(&(base_from_world * pose), &request.start);
            }
            PlanGoal::Pick { center, .. } => {
                (Point::from(self.model.grasp_for_request(request).center), *center)
            }
            PlanGoal::Place { point } => {
                let carried =
                    request.attached.as_ref().map(|object| object.tip_from_object.translation.vector);
                let in_tip = Point::from(carried.unwrap_or(self.model.widest_grasp().center));
                (in_tip, point + Vector::z() * RELEASE_HEIGHT)
            }
        };
        self.kinematics.reach(&in_tip, &(base_from_world * in_world), &request.start)
    }

    /// From rest to rest, all joints together, the slowest at its speed.
    fn straight_trajectory(&self, start: &JointVector, goal: JointVector) -> Trajectory {
        let speed = |k: usize| self.model.joints[self.model.arm[k]].limits.velocity * SPEED_SHARE;
        let secs = |(k, (from, to)): (usize, (&f64, &f64))| (to - from).abs() * PEAK_OVER_MEAN / speed(k);
        let duration = start.iter().zip(&goal).enumerate().map(secs).fold(0.1, f64::max);
        let rest = |time_secs: f64, q: JointVector| TrajectoryPoint { time_secs, qd: zeros(q.len()), q };
        Trajectory { points: vec![rest(0.0, start.clone()), rest(duration, goal)] }
    }
}

impl PlanService for InstantPlans {
    fn submit(&mut self, request: PlanRequest) {
        self.calls.borrow_mut().push(PlanCall::Submit(request.id));
        self.polls_left = self.late_by;
        self.reply = Some(self.plan(&request));
    }

    fn poll(&mut self, id: u64) -> Option<PlanReply> {
        if self.polls_left > 0 {
            self.polls_left -= 1;
            return None;
        }
        self.reply.take_if(|reply| reply.id == id)
    }

    fn wait(&mut self, id: u64) -> PlanReply {
        self.reply.take_if(|reply| reply.id == id).unwrap_or_else(|| cancelled(id))
    }

    /// The request that was running is answered as cancelled, to whoever still asks.
    fn cancel(&mut self) {
        self.calls.borrow_mut().push(PlanCall::Cancel);
        self.reply = self.reply.take().map(|reply| cancelled(reply.id));
    }
}

fn cancelled(id: u64) -> PlanReply {
    PlanReply::without_plan(id, PlanStatus::Cancelled, "the request was cancelled")
}
