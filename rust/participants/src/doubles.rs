//! What tests show to a participant.

use proact_types::{Command, DisplayFrame, HandView, PlannerView, Pose, SimTime, TargetView};

/// A frame with nothing in it.
pub(crate) fn empty_frame() -> DisplayFrame {
    DisplayFrame {
        time: SimTime(0),
        method: "D".to_owned(),
        joints: Default::default(),
        world_from_base: Pose::identity(),
        world_from_tip: Pose::identity(),
        world_from_head: Pose::identity(),
        objects: Vec::new(),
        hand: HandView::default(),
        gaze: None,
        target: TargetView::default(),
        planner: PlannerView::Idle,
        plan_goal: None,
        mode: None,
        stop: None,
        command: Command::NoMotion,
        recognized_gesture: Command::NoMotion.into(),
        confidence: 1.0,
        effort: 0.0,
        emg_source: String::new(),
        time_left_secs: 60.0,
        next_object: None,
        task_goal: None,
        score: 0,
        finished: false,
        events: Vec::new(),
        contacts: Vec::new(),
        feedback: Vec::new(),
    }
}
