//! Plans: asked for with the whole scene, taken when they are due, and dropped when nobody waits for them.

use crate::{Field, Testbed, TestbedError, TickOutput};
use proact_types::{
    ArmModel, AttachedObject, EventKind, JointVector, Obstacle, PlanGoal, PlanReply, PlanRequest, PlantState,
    Scene, TickInput, joints,
};

impl Testbed {
    /// The plan that takes effect in this tick.
    pub(crate) fn due_plan(&mut self, input: &TickInput) -> Option<PlanReply> {
        let (id, due) = self.pending?;
        let reply = match &input.plan {
            Some(reply) if reply.id == id => reply.clone(),
            // The answer to a request that was cancelled or replaced meanwhile moves nothing.
            Some(_) => return None,
            None if self.now < due => return None,
            None if self.config.wait_for_plans => self.parts.plans.wait(id),
            None => self.parts.plans.poll(id)?,
        };
        self.pending = None;
        let field = &mut self.digest.field(Field::InputPlan);
        field.word(reply.id).word(reply.status as u64).text(&reply.reason);
        for point in &reply.trajectory.points {
            field.number(point.time_secs).numbers(&point.q).numbers(&point.qd);
        }
        Some(reply)
    }

    /// Asks for a plan to `goal` in the world as it is now.
    pub(crate) fn request(&mut self, goal: PlanGoal, output: &mut TickOutput) -> Result<(), TestbedError> {
        self.requests += 1;
        let id = self.requests;
        let request = plan_request(
            id,
            &self.parts.model,
            self.task.scene(),
            self.parts.plant.state(),
            self.arm.position().clone(),
            goal,
            self.config.seed,
        );
        output.request = Some(request.clone());
        self.parts.plans.submit(request);
        self.pending = Some((id, self.now.plus_millis(self.config.plan_latency_ms)));
        self.note(output, EventKind::PlanRequested { request: id });
        Ok(())
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
    let mut obstacles: Vec<Obstacle> =
        scene.fixed.iter().map(|o| Obstacle { name: o.name.clone(), shape: o.shape, pose: o.pose }).collect();
    for (k, block) in scene.blocks.iter().enumerate().filter(|(k, _)| Some(*k) != held) {
        let pose = state.blocks[k].pose;
        obstacles.push(Obstacle { name: block.id.name().to_owned(), shape: block.shape, pose });
    }
    let attached = state.attached.map(|(k, tip_from_object)| AttachedObject {
        name: scene.blocks[k].id.name().to_owned(),
        shape: scene.blocks[k].shape,
        tip_from_object,
    });
    PlanRequest {
        id,
        world_from_base: state.world_from_base,
        start,
        hand: joints(&state.position[model.arm_count()..]),
        goal,
        obstacles,
        attached,
        // Requests of one trial differ, and so do trials.
        seed: seed.wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(id),
    }
}
