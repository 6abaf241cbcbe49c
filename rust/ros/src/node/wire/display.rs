//! What there is to see, of the method and of an instant as it is drawn, as messages and back.

use super::{
    DecodeError, ExpectedCounts, decode_object, element_at, encode_object, events_from_json, events_to_json,
    exact_pose, finite, gaze, joints, optional_value, parse_gesture, read_gaze,
};
use crate::{
    frames::WORLD,
    messages::proact_msgs::{self, Planner},
    node::convert,
};
use proact_testbed::stages::MethodView;
use proact_types::{
    Command, ControlledDof, DisplayFrame, GazeSample, Gesture, HandState, HandView, InputSource, JointVector,
    ModeView, PlanStatus, PlannerView, Point, SimTime, Stop, StopCause, TargetView,
};
use serde::{Deserialize, Serialize};

/// What there is to see of the method: the JSON on `/proact/method`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MethodStatus {
    /// Name of the method, such as `D`.
    pub method: String,
    /// Command that it acts on.
    pub gesture: Command,
    /// The gesture that gives it, as the EMG model calls it.
    #[serde(rename = "recognised")]
    pub recognized: Gesture,
    /// Probability of that gesture, 0 to 1.
    pub confidence: f64,
    /// How hard it is made, 0 to 1.
    pub effort: f64,
    /// The hand as the method sees it.
    pub hand: HandView,
    /// Gaze as measured.
    pub gaze: Option<GazeSample>,
    /// Why the arm must stand still; none while it need not.
    pub stop: Option<Stop>,
    /// Selection marker.
    pub target: TargetView,
    /// Planner and motion.
    pub planner: PlannerView,
    /// Joint or axis of the movement gestures.
    pub mode: Option<ModeView>,
    /// Arm angles at the end of the path that is followed, rad.
    pub goal: Option<JointVector>,
}

impl MethodStatus {
    /// The part of it that is the method's own.
    pub(in crate::node) fn view(&self) -> MethodView {
        MethodView {
            name: self.method.clone(),
            target: self.target.clone(),
            planner: self.planner.clone(),
            mode: self.mode.clone(),
            stop: self.stop.clone(),
        }
    }
}

fn target(view: &TargetView) -> proact_msgs::Target {
    proact_msgs::Target {
        object: encode_object(view.object),
        place: view.place.iter().map(convert::point).collect(),
        locked: view.locked,
        posterior: view.posterior.clone(),
    }
}

fn read_target(message: &proact_msgs::Target, objects: usize) -> Result<TargetView, DecodeError> {
    finite("the target's posterior", &message.posterior)?;
    let got = message.posterior.len();
    if got != 0 && got != objects {
        return Err(format!("the target's posterior has {got} values, expected none or {objects}"));
    }
    let place_point = optional_value("the target's place", &message.place)?;
    let place_point = place_point.map(|place_point| Point::new(place_point.x, place_point.y, place_point.z));
    if let Some(place_point) = &place_point {
        finite("the target's place", place_point.coords.as_slice())?;
    }
    Ok(TargetView {
        object: decode_object("the target's object", message.object, objects)?,
        place: place_point,
        locked: message.locked,
        posterior: message.posterior.clone(),
    })
}

fn planner(view: &PlannerView) -> Planner {
    match view {
        PlannerView::Idle => Planner { state: Planner::IDLE, ..Planner::default() },
        PlannerView::Planning => Planner { state: Planner::PLANNING, ..Planner::default() },
        PlannerView::Executing { progress, intermediate } => Planner {
            state: Planner::EXECUTING,
            progress: *progress,
            intermediate: *intermediate,
            ..Planner::default()
        },
        PlannerView::Arrived { intermediate } => {
            Planner { state: Planner::ARRIVED, intermediate: *intermediate, ..Planner::default() }
        }
        PlannerView::Failed { status, reason } => Planner {
            state: Planner::FAILED,
            status: *status as u8,
            reason: reason.clone(),
            ..Planner::default()
        },
    }
}

fn read_planner(message: &Planner) -> Result<PlannerView, DecodeError> {
    let intermediate = message.intermediate;
    Ok(match message.state {
        Planner::IDLE => PlannerView::Idle,
        Planner::PLANNING => PlannerView::Planning,
        Planner::EXECUTING => {
            finite("the planner's progress", &[message.progress])?;
            PlannerView::Executing { progress: message.progress, intermediate }
        }
        Planner::ARRIVED => PlannerView::Arrived { intermediate },
        Planner::FAILED => PlannerView::Failed {
            status: element_at("the planner's status", &PlanStatus::ALL, usize::from(message.status))?,
            reason: message.reason.clone(),
        },
        other => return Err(format!("the planner's state is {other}, expected 0 to 4")),
    })
}

fn mode(view: &ModeView) -> proact_msgs::Mode {
    let [extension_does, flexion_does] = view.directions.clone();
    let (kind, index) = match view.controlled_dof {
        ControlledDof::Joint(index) => (proact_msgs::Mode::JOINT, index),
        ControlledDof::Translation(index) => (proact_msgs::Mode::TRANSLATION, index),
        ControlledDof::Rotation(index) => (proact_msgs::Mode::ROTATION, index),
    };
    proact_msgs::Mode {
        kind,
        index,
        name: view.name.clone(),
        extension_does,
        flexion_does,
        extension_sign: view.we_sign,
        next_in_secs: view.next_in_secs.into_iter().collect(),
    }
}

fn read_mode(message: &proact_msgs::Mode) -> Result<ModeView, DecodeError> {
    finite("the mode's next_in_secs", &message.next_in_secs)?;
    Ok(ModeView {
        controlled_dof: match message.kind {
            proact_msgs::Mode::JOINT => ControlledDof::Joint(message.index),
            proact_msgs::Mode::TRANSLATION => ControlledDof::Translation(message.index),
            proact_msgs::Mode::ROTATION => ControlledDof::Rotation(message.index),
            other => return Err(format!("the mode's kind is {other}, expected 0 to 2")),
        },
        name: message.name.clone(),
        directions: [message.extension_does.clone(), message.flexion_does.clone()],
        we_sign: message.extension_sign,
        next_in_secs: optional_value("the mode's next_in_secs", &message.next_in_secs)?.copied(),
    })
}

fn stop(stop: &Stop) -> proact_msgs::Stop {
    proact_msgs::Stop {
        source: stop.source.index() as u8,
        cause: stop.cause as u8,
        since: stop.since.0,
        reason: stop.reason.clone(),
    }
}

fn read_stop(message: &proact_msgs::Stop) -> Result<Stop, DecodeError> {
    Ok(Stop {
        source: element_at("the stop's source", &InputSource::ALL, usize::from(message.source))?,
        cause: element_at("the stop's cause", &StopCause::ALL, usize::from(message.cause))?,
        since: SimTime(message.since),
        reason: message.reason.clone(),
    })
}

/// What there is to see of the method.
pub(super) fn method_view(method_status: &MethodStatus) -> proact_msgs::MethodView {
    proact_msgs::MethodView {
        method: method_status.method.clone(),
        gesture: method_status.gesture.index() as u8,
        recognised: method_status.recognized.to_string(),
        confidence: method_status.confidence,
        effort: method_status.effort,
        hand: method_status.hand.state as u8,
        holds: encode_object(method_status.hand.held_object),
        gaze: method_status.gaze.iter().map(gaze).collect(),
        stop: method_status.stop.iter().map(stop).collect(),
        target: target(&method_status.target),
        planner: planner(&method_status.planner),
        mode: method_status.mode.iter().map(mode).collect(),
        goal: method_status.goal.iter().flatten().copied().collect(),
    }
}

/// What there was to see of the method.
pub(super) fn read_method_view(
    message: &proact_msgs::MethodView,
    counts: ExpectedCounts,
) -> Result<MethodStatus, DecodeError> {
    let ExpectedCounts { arm, objects, .. } = counts;
    finite("the confidence", &[message.confidence])?;
    finite("the effort", &[message.effort])?;
    if !message.goal.is_empty() && message.goal.len() != arm {
        return Err(format!("goal has {} values, expected none or {arm}", message.goal.len()));
    }
    Ok(MethodStatus {
        method: message.method.clone(),
        gesture: element_at("gesture", &Command::ALL, usize::from(message.gesture))?,
        recognized: parse_gesture(&message.recognised)?,
        confidence: message.confidence,
        effort: message.effort,
        hand: HandView {
            state: element_at("hand", &HandState::ALL, usize::from(message.hand))?,
            held_object: decode_object("the object in the hand", message.holds, objects)?,
        },
        gaze: optional_value("gaze", &message.gaze)?.map(read_gaze),
        stop: optional_value("stop", &message.stop)?.map(read_stop).transpose()?,
        target: read_target(&message.target, objects)?,
        planner: read_planner(&message.planner)?,
        mode: optional_value("mode", &message.mode)?.map(read_mode).transpose()?,
        goal: (!message.goal.is_empty()).then(|| joints("goal", &message.goal)).transpose()?,
    })
}

/// One instant as it is drawn, stamped with its time.
pub(in crate::node) fn frame(frame: &DisplayFrame) -> proact_msgs::Frame {
    let method_status = MethodStatus {
        method: frame.method.clone(),
        gesture: frame.command,
        recognized: frame.recognized_gesture,
        confidence: frame.confidence,
        effort: frame.effort,
        hand: frame.hand,
        gaze: frame.gaze,
        stop: frame.stop.clone(),
        target: frame.target.clone(),
        planner: frame.planner.clone(),
        mode: frame.mode.clone(),
        goal: frame.plan_goal.clone(),
    };
    proact_msgs::Frame {
        header: convert::header(frame.time, WORLD),
        tick: frame.time.0,
        view: method_view(&method_status),
        joints: frame.joints.to_vec(),
        base: convert::pose(&frame.world_from_base),
        tip: convert::pose(&frame.world_from_tip),
        head: convert::pose(&frame.world_from_head),
        objects: frame.objects.iter().map(convert::pose).collect(),
        emg_source: frame.emg_source.clone(),
        time_left_secs: frame.time_left_secs,
        next: encode_object(frame.next_object),
        score: frame.score,
        finished: frame.finished,
        events: events_to_json(&frame.events),
        contacts: events_to_json(&frame.contacts),
        feedback: events_to_json(&frame.feedback),
    }
}

/// The instant as it was drawn.
pub(in crate::node) fn read_frame(
    message: &proact_msgs::Frame,
    counts: ExpectedCounts,
) -> Result<DisplayFrame, DecodeError> {
    let ExpectedCounts { moving, objects, .. } = counts;
    let method_status = read_method_view(&message.view, counts)?;
    if message.joints.len() != moving {
        return Err(format!("joints has {} values, expected {moving}", message.joints.len()));
    }
    if message.objects.len() != objects {
        return Err(format!("{} objects, expected {objects}", message.objects.len()));
    }
    finite("time_left_secs", &[message.time_left_secs])?;
    Ok(DisplayFrame {
        time: SimTime(message.tick),
        method: method_status.method,
        joints: joints("joints", &message.joints)?,
        world_from_base: exact_pose(&message.base)?,
        world_from_tip: exact_pose(&message.tip)?,
        world_from_head: exact_pose(&message.head)?,
        objects: message.objects.iter().map(exact_pose).collect::<Result<_, _>>()?,
        hand: method_status.hand,
        gaze: method_status.gaze,
        target: method_status.target,
        planner: method_status.planner,
        plan_goal: method_status.goal,
        mode: method_status.mode,
        stop: method_status.stop,
        command: method_status.gesture,
        recognized_gesture: method_status.recognized,
        confidence: method_status.confidence,
        effort: method_status.effort,
        emg_source: message.emg_source.clone(),
        time_left_secs: message.time_left_secs,
        next_object: decode_object("next", message.next, objects)?,
        // The messages do not carry it: tasks whose goals change run without a ROS graph.
        task_goal: None,
        score: message.score,
        finished: message.finished,
        events: events_from_json(&message.events)?,
        contacts: events_from_json(&message.contacts)?,
        feedback: events_from_json(&message.feedback)?,
    })
}

#[cfg(test)]
mod tests;
