//! What tests show to a participant.

use proact_types::{DisplayFrame, Gesture, HandView, PlannerView, Pose, SimTime, TargetView};

/// A frame with nothing in it.
pub(crate) fn frame() -> DisplayFrame {
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
        goal: None,
        mode: None,
        stop: None,
        gesture: Gesture::NoMotion,
        recognised: Gesture::NoMotion.into(),
        confidence: 1.0,
        effort: 0.0,
        emg_source: String::new(),
        time_left_secs: 60.0,
        next: None,
        asked: None,
        score: 0,
        finished: false,
        events: Vec::new(),
        contacts: Vec::new(),
        feedback: Vec::new(),
    }
}
