//! The tick's dealings with the physics: the base that follows the shoulder, one step, and the grasp.

use crate::{Field, GraspAction, Testbed, TestbedError, TickOutput};
use proact_types::{BlockId, EventKind, JointVector, PlantCommand, Point, joints};

impl Testbed {
    /// Stops arm and hand while the base does not follow the shoulder.
    pub(crate) fn watch_base(&mut self, output: &mut TickOutput) {
        let state = self.parts.plant.state();
        let paused = self.base.paused(state.base_held, state.world_from_base);
        if paused == self.paused {
            return;
        }
        self.paused = paused;
        let way = self.base.goal().translation.vector - state.world_from_base.translation.vector;
        let kind = if paused { EventKind::BaseHeld { distance: way.norm() } } else { EventKind::BaseFollows };
        self.note(output, kind);
    }

    /// One step of physics under the joint targets.
    pub(crate) fn move_world(&mut self) -> Result<(), TestbedError> {
        let both =
            |arm: &JointVector, hand: &JointVector| arm.iter().chain(hand).copied().collect::<JointVector>();
        let mut command = PlantCommand {
            position: both(self.arm.position(), self.hand.position()),
            velocity: both(self.arm.velocity(), self.hand.velocity()),
            world_from_base: self.base.pose(),
        };
        if self.paused {
            command.velocity.iter_mut().for_each(|speed| *speed = 0.0);
        }
        self.digest.field(Field::Motion).numbers(&command.position).pose(&command.world_from_base);
        let time = self.now;
        self.parts.plant.step(&command).map_err(|source| TestbedError::Plant { time, source })?;
        let state = self.parts.plant.state();
        self.digest.field(Field::Joints).numbers(&state.position).numbers(&state.velocity);
        let field = &mut self.digest.field(Field::Blocks);
        for body in &state.blocks {
            field.pose(&body.pose).vector(&body.linear).vector(&body.angular);
        }
        field.word(state.attached.map_or(u64::MAX, |(block, _)| block as u64));
        Ok(())
    }

    /// The hand's state from its joints, and the grasp rule.
    pub(crate) fn grip(&mut self, output: &mut TickOutput) -> Result<(), TestbedError> {
        let state = self.parts.plant.state();
        let arm = self.parts.model.arm_count();
        let fingers = joints(&state.position[arm..]);
        let hand = self.hand_tracker.step(&fingers, &state.velocity[arm..], self.hand.moving());
        let attached = state.attached.map(|(block, _)| block);
        let command = self.hand_tracker.command();
        let action = self.grasp.step(&self.parts.model, state, hand, command);
        let time = self.now;
        let place = |block: usize| Point::from(state.blocks[block].pose.translation.vector);
        match action {
            Some(GraspAction::Attach(block)) => {
                let tip = self.parts.model.tip;
                self.grasped_by = self.grasp.fingers_on(&self.parts.model, &state.contacts, block);
                if let Some(id) = BlockId::ALL.get(block).copied() {
                    let (links, place) = (self.grasped_by.clone(), place(block));
                    self.note(output, EventKind::GraspMade { block: id, links, place });
                }
                self.parts.plant.attach(block, tip).map_err(|source| TestbedError::Plant { time, source })?;
                self.hand.freeze(&fingers);
            }
            Some(GraspAction::Release) => {
                if let Some((block, id)) = attached.and_then(|k| Some((k, *BlockId::ALL.get(k)?))) {
                    let (links, place) = (std::mem::take(&mut self.grasped_by), place(block));
                    self.note(output, EventKind::GraspEnded { block: id, links, place });
                }
                self.parts.plant.release();
            }
            None => {}
        }
        Ok(())
    }
}
