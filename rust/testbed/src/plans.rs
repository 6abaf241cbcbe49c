//! Plans: asked for with the whole scene, taken when they are due, and dropped when nobody waits for them.

use crate::{Field, Testbed, TestbedError, TickOutput};
use proact_types::{
    AttachedObject, EventKind, Obstacle, PlanGoal, PlanReply, PlanRequest, TickInput, joints,
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
        let state = self.parts.plant.state();
        let scene = self.task.scene();
        let held = state.attached.map(|(block, _)| block);
        let mut obstacles: Vec<Obstacle> = scene
            .fixed
            .iter()
            .map(|o| Obstacle { name: o.name.clone(), shape: o.shape, pose: o.pose })
            .collect();
        for (k, block) in scene.blocks.iter().enumerate().filter(|(k, _)| Some(*k) != held) {
            let pose = state.blocks[k].pose;
            obstacles.push(Obstacle { name: block.id.name().to_owned(), shape: block.shape, pose });
        }
        let attached = state.attached.map(|(k, tip_from_object)| AttachedObject {
            name: scene.blocks[k].id.name().to_owned(),
            shape: scene.blocks[k].shape,
            tip_from_object,
        });
        let hand = joints(&state.position[self.parts.model.arm_count()..]);
        self.parts.plans.submit(PlanRequest {
            id,
            // Where the base is, not where tracking has it: a jump holds the plant's base where it was.
            world_from_base: state.world_from_base,
            start: self.arm.position().clone(),
            hand,
            goal,
            obstacles,
            attached,
            // Requests of one trial differ, and so do trials.
            seed: self.config.seed.wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(id),
        });
        self.pending = Some((id, self.now.plus_millis(self.config.plan_latency_ms)));
        self.note(output, EventKind::PlanRequested { request: id });
        Ok(())
    }
}
