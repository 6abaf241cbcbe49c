//! What follows the world in each tick, whoever moves it: the task, the cues, the display, and what is said of them.

use super::{
    NodeError, RosGraph, convert,
    testbed::json,
    wire::{self, MethodShown},
};
use crate::{
    frames::WORLD,
    messages::{
        proact_msgs::{Frame, State, View},
        std_msgs::String as Text,
    },
};
use proact_arm::ArmModel;
use proact_control::ports::ArmKinematics;
use proact_tasks::{Task, TaskResult, TaskState};
use proact_testbed::{
    TestbedError, TrialConfig,
    stages::{
        ActuationOutput, DisplayInput, DisplayStage, EmgStageOutput, FeedbackInput, FeedbackStage,
        IntentOutput, TaskOutput, TaskStage, TaskStageInput,
    },
};
use proact_types::{Event, EventKind, HandView, PlantState, Pose, SimTime};
use rosrust::{Publisher, error::Result};
use serde::Serialize;
use serde_json::{Map, Value};
use std::sync::Arc;

/// How the trial in this world went: the text on `/proact/result`.
#[derive(Serialize)]
struct WorldResult {
    task: String,
    score: f64,
    score_name: String,
    result: Map<String, Value>,
    #[serde(flatten)]
    beside: Map<String, Value>,
    sim_seconds: f64,
}

/// Task, feedback and display of a trial.
pub(super) struct Judge {
    config: TrialConfig,
    model: Arc<ArmModel>,
    kinematics: Box<dyn ArmKinematics>,
    task: TaskStage,
    feedback: FeedbackStage,
    display: DisplayStage,
    /// What the method showed last, and where the head was.
    pub shown: Option<MethodShown>,
    pub head: Pose,
    state: Publisher<State>,
    frame: Publisher<Frame>,
    cues: Publisher<View>,
    score: Publisher<Text>,
    result: Publisher<Text>,
    /// Said last, to be said again in lock-step.
    said: Option<(State, Option<Frame>)>,
}

/// The world after a tick.
pub(super) struct Moved<'a> {
    pub world: &'a PlantState,
    pub hand: HandView,
    pub actuation: &'a ActuationOutput,
    /// The number of the method's last command for the arm.
    pub acted_on: u64,
}

impl Judge {
    pub(super) fn new(
        graph: &RosGraph,
        config: &TrialConfig,
        model: Arc<ArmModel>,
        kinematics: Box<dyn ArmKinematics>,
    ) -> std::result::Result<Self, NodeError> {
        Ok(Self {
            config: config.clone(),
            kinematics,
            task: TaskStage::new(config.build_task(&model).map_err(TestbedError::Config)?, model.clone()),
            feedback: FeedbackStage::new(config, &model),
            display: DisplayStage::new(config, &model),
            model,
            shown: None,
            head: config.setup.body.head_pose(&Default::default()),
            state: graph.publish("proact/state", 100, false)?,
            frame: graph.publish("proact/frame", 10, false)?,
            cues: graph.publish("proact/cues", 10, false)?,
            score: graph.publish("proact/score", 1, true)?,
            result: graph.publish("proact/result", 1, true)?,
            said: None,
        })
    }

    pub(super) fn task(&self) -> &dyn Task {
        self.task.task()
    }

    /// The task begins anew.
    pub(super) fn reset(&mut self) {
        // It could be built before.
        if let Ok(task) = self.config.build_task(&self.model) {
            self.task = TaskStage::new(task, self.model.clone());
        }
    }

    /// Judges tick `now`. `events` are those of the stages before, and get those of the task.
    pub(super) fn step(
        &mut self,
        now: SimTime,
        moved: &Moved<'_>,
        events: &mut Vec<EventKind>,
    ) -> Result<TaskOutput> {
        let task = self.task.step(now, TaskStageInput { world: moved.world, held: moved.hand.holds });
        let judged = !task.events.is_empty();
        let finished = task.events.contains(&EventKind::TrialFinished);
        events.extend_from_slice(&task.events);
        let timed: Vec<Event> = events.iter().map(|kind| Event { time: now, kind: kind.clone() }).collect();
        let contacts = &moved.world.contacts;
        let cues = self.feedback.step(now, FeedbackInput { events: &timed, contacts });
        self.display.note(&timed, &cues);
        for cue in &cues {
            let json = serde_json::to_string(cue).unwrap_or_default();
            self.cues.send(View { header: convert::header(now, WORLD), json })?;
        }
        if judged {
            let result = self.task.result(&moved.world.objects).result;
            self.score.send(Text { data: json("the score", &result).unwrap_or_default() })?;
        }
        if finished {
            let TaskResult { score, result, beside, .. } = self.task.result(&moved.world.objects);
            let result = WorldResult {
                task: self.config.task.name.clone(),
                score,
                score_name: self.task.task().briefing().score_name.clone(),
                result,
                beside,
                sim_seconds: now.as_secs(),
            };
            self.result.send(Text { data: json("the result", &result).unwrap_or_default() })?;
        }
        Ok(task)
    }

    /// Says how the world is, and shows it where a frame is due. `task` as the tick left it.
    pub(super) fn tell(
        &mut self,
        now: SimTime,
        moved: &Moved<'_>,
        task: &TaskState,
        events: &[EventKind],
        state_due: bool,
    ) -> Result<()> {
        // In the last tick of a trial, too, as in one process.
        let frame = (DisplayStage::is_due(now) || events.contains(&EventKind::TrialFinished))
            .then(|| self.draw(now, moved, task))
            .flatten();
        let mut state = wire::state(now, now, moved.world, moved.hand, moved.actuation, task);
        state.frame = frame.is_some();
        state.acted_on = moved.acted_on;
        state.events = events.iter().filter_map(|kind| serde_json::to_string(kind).ok()).collect();
        if let Some(frame) = &frame {
            self.frame.send(frame.clone())?;
        }
        if state_due || frame.is_some() {
            self.state.send(state.clone())?;
        }
        self.said = Some((state, frame));
        Ok(())
    }

    /// Says it once more.
    pub(super) fn repeat(&self) -> Result<()> {
        let Some((state, frame)) = &self.said else { return Ok(()) };
        if let Some(frame) = frame {
            self.frame.send(frame.clone())?;
        }
        self.state.send(state.clone())
    }

    /// None before the method has shown anything.
    fn draw(&mut self, now: SimTime, moved: &Moved<'_>, task: &TaskState) -> Option<Frame> {
        let shown = self.shown.as_ref()?;
        let gesture = EmgStageOutput {
            gesture: shown.gesture,
            recognised: shown.recognised,
            confidence: shown.confidence,
            effort: shown.effort,
            ..EmgStageOutput::default()
        };
        let intent = IntentOutput { gaze: shown.gaze, ..IntentOutput::default() };
        let input = DisplayInput {
            gesture: &gesture,
            intent: &intent,
            method: shown.view(),
            actuation: moved.actuation,
            world: moved.world,
            hand: moved.hand,
            task,
            world_from_head: self.head,
        };
        self.display.step(now, input, self.kinematics.as_mut()).ok().map(|frame| wire::frame(&frame))
    }
}
