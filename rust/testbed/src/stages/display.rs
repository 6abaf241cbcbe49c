use super::{ActuationOutput, EmgStageOutput, IntentOutput, MethodView};
use crate::{TestbedError, TrialConfig};
use proact_arm::ArmModel;
use proact_control::ports::ArmKinematics;
use proact_tasks::TaskState;
use proact_types::{ContactView, DisplayFrame, Event, FeedbackCue, HandView, PlantState, Pose, SimTime};

/// From the outputs of all stages to what page, headset and participant see.
pub struct DisplayStage {
    limit_secs: f64,
    gesture_source: String,
    /// Since the frame before.
    events: Vec<Event>,
    cues: Vec<FeedbackCue>,
    /// Names of the links.
    links: Vec<String>,
}

/// One instant, as the stages say it.
#[derive(Clone, Debug)]
pub struct DisplayInput<'a> {
    /// What the EMG stage says.
    pub emg: &'a EmgStageOutput,
    /// What the intent stage says.
    pub intent: &'a IntentOutput,
    /// What the method shows.
    pub method: MethodView,
    /// What is asked of the joints.
    pub actuation: &'a ActuationOutput,
    /// Joints, base and objects.
    pub world: &'a PlantState,
    /// The hand.
    pub hand: HandView,
    /// The task.
    pub task: &'a TaskState,
    /// `world_from_head`, from whoever tracks the head.
    pub world_from_head: Pose,
}

impl DisplayStage {
    /// The stage of a trial.
    pub fn new(config: &TrialConfig, model: &ArmModel) -> Self {
        Self {
            limit_secs: config.limit_secs,
            gesture_source: config.gesture_source.clone(),
            events: Vec::new(),
            cues: Vec::new(),
            links: model.links.iter().map(|link| link.name.clone()).collect(),
        }
    }

    /// True if a frame belongs to tick `now`: 60 Hz, by accumulation.
    pub fn is_due(now: SimTime) -> bool {
        let frames = |tick: u64| tick * 60 / 1000;
        now.0 > 0 && frames(now.0) > frames(now.0 - 1)
    }

    /// Events of this tick, and what was to be heard and felt, which the next frame shows.
    pub fn add_events(&mut self, events: &[Event], cues: &[FeedbackCue]) {
        self.events.extend_from_slice(events);
        self.cues.extend_from_slice(cues);
    }

    /// The instant as drawn; events since the frame before go with it. `kinematics` is that of the arm, base to tip.
    ///
    /// # Errors
    /// If the kinematics refuse the arm's angles.
    pub fn step(
        &mut self,
        now: SimTime,
        input: DisplayInput<'_>,
        kinematics: &mut dyn ArmKinematics,
    ) -> Result<DisplayFrame, TestbedError> {
        let DisplayInput { emg: emg_output, world, task, method, .. } = input;
        let arm = kinematics.joint_count();
        let base_from_tip = kinematics.forward(&world.position[..arm])?;
        Ok(DisplayFrame {
            time: now,
            method: method.name,
            joints: world.position.clone(),
            world_from_base: world.world_from_base,
            world_from_tip: world.world_from_base * base_from_tip,
            world_from_head: input.world_from_head,
            objects: world.objects.iter().map(|body| body.pose).collect(),
            hand: input.hand,
            gaze: input.intent.gaze,
            target: method.target,
            planner: method.planner,
            plan_goal: input.actuation.goal.clone(),
            mode: method.mode,
            stop: method.stop,
            command: emg_output.command,
            recognized_gesture: emg_output.recognized_gesture,
            confidence: emg_output.confidence,
            effort: emg_output.effort,
            emg_source: self.gesture_source.clone(),
            time_left_secs: (self.limit_secs - now.as_secs()).max(0.0),
            next_object: task.next_object,
            task_goal: task.goal.clone(),
            score: task.score,
            finished: task.finished,
            events: std::mem::take(&mut self.events),
            contacts: self.contacts(world),
            feedback: std::mem::take(&mut self.cues),
        })
    }

    /// The links that touch blocks, each once, in the order of the first contacts.
    fn contacts(&self, world: &PlantState) -> Vec<ContactView> {
        let mut forces: Vec<(usize, f64)> = Vec::new();
        for contact in &world.contacts {
            match forces.iter_mut().find(|(link, _)| *link == contact.link) {
                Some((_, force)) => *force += contact.force,
                None => forces.push((contact.link, contact.force)),
            }
        }
        let named =
            |(link, force): (usize, f64)| Some(ContactView { link: self.links.get(link)?.clone(), force });
        forces.into_iter().filter_map(named).collect()
    }
}
