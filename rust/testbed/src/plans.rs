//! Plans: asked for with the whole scene, taken when they are due, and dropped when nobody waits for them.

use crate::{TrialConfig, ports::PlanService};
use proact_arm::ArmModel;
use proact_types::{
    AttachedObject, JointVector, Obstacle, PlanGoal, PlanReply, PlanRequest, PlantState, Scene, SimTime,
    joints,
};

/// The plans that a method waits for: at most one.
pub(crate) struct PendingPlan {
    service: Box<dyn PlanService>,
    latency_ms: u64,
    /// The tick at which a plan is due waits for it.
    wait_for_plan: bool,
    seed: u64,
    request_and_due_time: Option<(u64, SimTime)>,
    request_count: u64,
}

impl PendingPlan {
    pub(crate) fn new(config: &TrialConfig, service: Box<dyn PlanService>) -> Self {
        Self {
            service,
            latency_ms: config.plan_latency_ms,
            wait_for_plan: config.wait_for_plans,
            seed: config.seed,
            request_and_due_time: None,
            request_count: 0,
        }
    }

    /// The trial's seed, from which each request has its own.
    pub(crate) fn seed(&self) -> u64 {
        self.seed
    }

    /// The number of the next request.
    pub(crate) fn next_id(&self) -> u64 {
        self.request_count + 1
    }

    /// The plan that takes effect in this tick; `logged` is what the input log has for it.
    pub(crate) fn take_due_plan(&mut self, now: SimTime, logged: Option<&PlanReply>) -> Option<PlanReply> {
        let (id, due) = self.request_and_due_time?;
        let reply = match logged {
            Some(reply) if reply.id == id => reply.clone(),
            // The answer to a request that was cancelled or replaced meanwhile moves nothing.
            Some(_) => return None,
            None if now < due => return None,
            None if self.wait_for_plan => self.service.wait(id),
            None => self.service.poll(id)?,
        };
        self.request_and_due_time = None;
        Some(reply)
    }

    /// Hands `request` to the planner, in place of one that is waited for.
    pub(crate) fn submit(&mut self, now: SimTime, request: PlanRequest) {
        self.request_count = request.id;
        self.request_and_due_time = Some((request.id, now.plus_millis(self.latency_ms)));
        self.service.submit(request);
    }

    /// Nobody waits any more.
    pub(crate) fn cancel(&mut self) {
        self.request_and_due_time = None;
        self.service.cancel();
    }
}

/// The question to the planner about `goal` in the world as it is: what is fixed, the blocks where they are, the held
/// one as part of the arm. `start`: arm angles asked of the position control, rad. `seed`: the trial's.
///
/// The base is that of the physics, not of the tracking: a jump of the tracker holds the base where it was.
pub fn plan_request(
    id: u64,
    model: &ArmModel,
    scene: &Scene,
    state: &PlantState,
    start: JointVector,
    goal: PlanGoal,
    seed: u64,
) -> PlanRequest {
    let held = state.attached.map(|(block, _)| block);
    let mut obstacles: Vec<Obstacle> = scene
        .fixed
        .iter()
        .map(|o| Obstacle { name: o.name.clone(), shape: o.shape, pose: o.pose, loose: false })
        .collect();
    for (k, block) in scene.objects.iter().enumerate().filter(|(k, _)| Some(*k) != held) {
        let pose = state.objects[k].pose;
        obstacles.push(Obstacle { name: block.name.clone(), shape: block.shape, pose, loose: block.loose });
    }
    let attached = state.attached.map(|(k, tip_from_object)| AttachedObject {
        name: scene.objects[k].name.clone(),
        shape: scene.objects[k].shape,
        tip_from_object,
        loose: scene.objects[k].loose,
    });
    let picked = match &goal {
        PlanGoal::Pick { object, .. } => Some(scene.name(*object)),
        _ => None,
    };
    PlanRequest {
        id,
        world_from_base: state.world_from_base,
        start,
        hand: joints(&state.position[model.arm_count()..]),
        goal,
        picked_object: picked,
        obstacles,
        held_joints: Vec::new(),
        attached,
        // Requests of one trial differ, and so do trials.
        seed: seed.wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(id),
    }
}
