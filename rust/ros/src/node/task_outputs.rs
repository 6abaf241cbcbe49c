//! What follows the world in each tick, whoever moves it: the task, the cues, the display, and what is said of them.

use super::{
    NodeError, RosGraph,
    control_interface::ControlInterface,
    convert,
    testbed::to_json,
    wire::{self, MethodStatus},
};
use crate::{
    frames::WORLD,
    messages::{
        proact_msgs::{Frame, State, View},
        std_msgs::String as Text,
    },
    publishing::Publisher,
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
use proact_types::{Event, EventKind, HandView, PlantState, Pose, SimTime, Stop};
use rosrust::error::Result;
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
    #[serde(rename = "beside")]
    legacy_fields: Map<String, Value>,
    sim_seconds: f64,
}

/// Task, feedback and display of a trial.
pub(super) struct TaskPublisher {
    config: TrialConfig,
    model: Arc<ArmModel>,
    kinematics: Box<dyn ArmKinematics>,
    task: TaskStage,
    feedback: FeedbackStage,
    display: DisplayStage,
    /// What the method showed last, and where the head was.
    pub method_status: Option<MethodStatus>,
    pub head: Pose,
    /// Why the arm is held whatever the method commands; shown in place of the method's own reason.
    pub hold_stop: Option<Stop>,
    state: Publisher<State>,
    frame: Publisher<Frame>,
    cues: Publisher<View>,
    score: Publisher<Text>,
    result: Publisher<Text>,
    control_interface: ControlInterface,
    /// Said last, to be said again in lock-step.
    last_published: Option<(State, Option<Frame>)>,
}

/// The world after a tick.
pub(super) struct WorldUpdate<'a> {
    pub world: &'a PlantState,
    pub hand: HandView,
    pub actuation: &'a ActuationOutput,
    /// The number of the method's last command for the arm.
    pub last_command_number: u64,
}

impl TaskPublisher {
    pub(super) fn new(
        graph: &RosGraph,
        config: &TrialConfig,
        model: Arc<ArmModel>,
        urdf: &str,
        kinematics: Box<dyn ArmKinematics>,
    ) -> std::result::Result<Self, NodeError> {
        let task = TaskStage::new(config.build_task(&model).map_err(TestbedError::Config)?, model.clone());
        Ok(Self {
            config: config.clone(),
            kinematics,
            control_interface: ControlInterface::new(graph, &model, urdf, &config.task.name, task.task())?,
            task,
            feedback: FeedbackStage::new(config, &model),
            display: DisplayStage::new(config, &model),
            model,
            method_status: None,
            head: config.setup.body.head_pose(&Default::default()),
            hold_stop: None,
            state: graph.advertise("proact/state", 100, false)?,
            frame: graph.advertise("proact/frame", 10, false)?,
            cues: graph.advertise("proact/cues", 10, false)?,
            score: graph.advertise("proact/score", 1, true)?,
            result: graph.advertise("proact/result", 1, true)?,
            last_published: None,
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
        moved: &WorldUpdate<'_>,
        events: &mut Vec<EventKind>,
    ) -> Result<TaskOutput> {
        let task = self.task.step(now, TaskStageInput { world: moved.world, held: moved.hand.held_object });
        self.control_interface.publish(now, &task.state)?;
        let has_events = !task.events.is_empty();
        let finished = task.events.contains(&EventKind::TrialFinished);
        events.extend_from_slice(&task.events);
        let timed: Vec<Event> = events.iter().map(|kind| Event { time: now, kind: kind.clone() }).collect();
        let contacts = &moved.world.contacts;
        let cues = self.feedback.step(now, FeedbackInput { events: &timed, contacts });
        self.display.add_events(&timed, &cues);
        for cue in &cues {
            let json = serde_json::to_string(cue).unwrap_or_default();
            self.cues.send(View { header: convert::header(now, WORLD), json })?;
        }
        if has_events {
            let result = self.task.result(&moved.world.objects).result;
            self.score.send(Text { data: to_json("the score", &result).unwrap_or_default() })?;
        }
        if finished {
            let TaskResult { score, result, legacy_fields: beside, .. } =
                self.task.result(&moved.world.objects);
            let result = WorldResult {
                task: self.config.task.name.clone(),
                score,
                score_name: self.task.task().briefing().score_name.clone(),
                result,
                legacy_fields: beside,
                sim_seconds: now.as_secs(),
            };
            self.result.send(Text { data: to_json("the result", &result).unwrap_or_default() })?;
        }
        Ok(task)
    }

    /// Says how the world is, and shows it where a frame is due. `task` as the tick left it; `stamp` is the graph's time.
    pub(super) fn publish(
        &mut self,
        now: SimTime,
        stamp: SimTime,
        moved: &WorldUpdate<'_>,
        task: &TaskState,
        events: &[EventKind],
        state_due: bool,
    ) -> Result<()> {
        // In the last tick of a trial, too, as in one process.
        let frame = (DisplayStage::is_due(now) || events.contains(&EventKind::TrialFinished))
            .then(|| self.build_frame(now, moved, task))
            .flatten();
        let mut state = wire::state(now, stamp, moved.world, moved.hand, moved.actuation, task);
        state.frame = frame.is_some();
        state.acted_on = moved.last_command_number;
        state.events = events.iter().filter_map(|kind| serde_json::to_string(kind).ok()).collect();
        let frame = frame.map(|mut frame| {
            frame.header.stamp = convert::time(stamp);
            frame
        });
        if let Some(frame) = &frame {
            self.frame.send(frame.clone())?;
        }
        if state_due || frame.is_some() {
            self.state.send(state.clone())?;
        }
        self.last_published = Some((state, frame));
        Ok(())
    }

    /// Says it once more.
    pub(super) fn republish_last(&self) -> Result<()> {
        let Some((state, frame)) = &self.last_published else { return Ok(()) };
        if let Some(frame) = frame {
            self.frame.send(frame.clone())?;
        }
        self.state.send(state.clone())
    }

    /// None before the method has shown anything.
    fn build_frame(&mut self, now: SimTime, moved: &WorldUpdate<'_>, task: &TaskState) -> Option<Frame> {
        let status = self.method_status.as_ref()?;
        let emg_output = EmgStageOutput {
            command: status.gesture,
            recognized_gesture: status.recognized,
            confidence: status.confidence,
            effort: status.effort,
            ..EmgStageOutput::default()
        };
        let intent = IntentOutput { gaze: status.gaze, ..IntentOutput::default() };
        let mut method = status.view();
        method.stop = self.hold_stop.clone().or(method.stop);
        let input = DisplayInput {
            emg: &emg_output,
            intent: &intent,
            method,
            actuation: moved.actuation,
            world: moved.world,
            hand: moved.hand,
            task,
            world_from_head: self.head,
        };
        self.display.step(now, input, self.kinematics.as_mut()).ok().map(|frame| wire::frame(&frame))
    }
}
