//! What there is to see, of the method and of an instant as it is drawn, as messages and back.

use super::{
    Counts, Refused, events, exact_pose, finite, gaze, joints, named, none_or_one, object_place, placed,
    read_gaze, read_object, texts,
};
use crate::{
    frames::WORLD,
    messages::proact_msgs::{self, Planner},
    node::convert,
};
use proact_testbed::stages::MethodView;
use proact_types::{
    DisplayFrame, GazeSample, Gesture, GestureName, HandState, HandView, InputSource, JointVector, ModeView,
    Moves, PlanStatus, PlannerView, Point, SimTime, Stop, StopCause, TargetView,
};
use serde::{Deserialize, Serialize};

/// What there is to see of the method: the JSON on `/proact/method`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MethodShown {
    /// Name of the method, such as `D`.
    pub method: String,
    /// Command that it acts on.
    pub gesture: Gesture,
    /// The gesture that gives it, as the EMG model calls it.
    pub recognised: GestureName,
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

impl MethodShown {
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
        object: object_place(view.object),
        place: view.place.iter().map(convert::point).collect(),
        locked: view.locked,
        posterior: view.posterior.clone(),
    }
}

fn read_target(message: &proact_msgs::Target, objects: usize) -> Result<TargetView, Refused> {
    finite("the target's posterior", &message.posterior)?;
    let got = message.posterior.len();
    if got != 0 && got != objects {
        return Err(format!("the target's posterior has {got} values, expected none or {objects}"));
    }
    let place = none_or_one("the target's place", &message.place)?;
    let place = place.map(|place| Point::new(place.x, place.y, place.z));
    if let Some(place) = &place {
        finite("the target's place", place.coords.as_slice())?;
    }
    Ok(TargetView {
        object: read_object("the target's object", message.object, objects)?,
        place,
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

fn read_planner(message: &Planner) -> Result<PlannerView, Refused> {
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
            status: placed("the planner's status", &PlanStatus::ALL, usize::from(message.status))?,
            reason: message.reason.clone(),
        },
        other => return Err(format!("the planner's state is {other}, expected 0 to 4")),
    })
}

fn mode(view: &ModeView) -> proact_msgs::Mode {
    let [extension_does, flexion_does] = view.directions.clone();
    let (kind, index) = match view.moves {
        Moves::Joint(index) => (proact_msgs::Mode::JOINT, index),
        Moves::Translation(index) => (proact_msgs::Mode::TRANSLATION, index),
        Moves::Rotation(index) => (proact_msgs::Mode::ROTATION, index),
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

fn read_mode(message: &proact_msgs::Mode) -> Result<ModeView, Refused> {
    finite("the mode's next_in_secs", &message.next_in_secs)?;
    Ok(ModeView {
        moves: match message.kind {
            proact_msgs::Mode::JOINT => Moves::Joint(message.index),
            proact_msgs::Mode::TRANSLATION => Moves::Translation(message.index),
            proact_msgs::Mode::ROTATION => Moves::Rotation(message.index),
            other => return Err(format!("the mode's kind is {other}, expected 0 to 2")),
        },
        name: message.name.clone(),
        directions: [message.extension_does.clone(), message.flexion_does.clone()],
        we_sign: message.extension_sign,
        next_in_secs: none_or_one("the mode's next_in_secs", &message.next_in_secs)?.copied(),
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

fn read_stop(message: &proact_msgs::Stop) -> Result<Stop, Refused> {
    Ok(Stop {
        source: placed("the stop's source", &InputSource::ALL, usize::from(message.source))?,
        cause: placed("the stop's cause", &StopCause::ALL, usize::from(message.cause))?,
        since: SimTime(message.since),
        reason: message.reason.clone(),
    })
}

/// What there is to see of the method.
pub(super) fn method_view(shown: &MethodShown) -> proact_msgs::MethodView {
    proact_msgs::MethodView {
        method: shown.method.clone(),
        gesture: shown.gesture.index() as u8,
        recognised: shown.recognised.to_string(),
        confidence: shown.confidence,
        effort: shown.effort,
        hand: shown.hand.state as u8,
        holds: object_place(shown.hand.holds),
        gaze: shown.gaze.iter().map(gaze).collect(),
        stop: shown.stop.iter().map(stop).collect(),
        target: target(&shown.target),
        planner: planner(&shown.planner),
        mode: shown.mode.iter().map(mode).collect(),
        goal: shown.goal.iter().flatten().copied().collect(),
    }
}

/// What there was to see of the method.
pub(super) fn read_method_view(
    message: &proact_msgs::MethodView,
    counts: Counts,
) -> Result<MethodShown, Refused> {
    let Counts { arm, objects, .. } = counts;
    finite("the confidence", &[message.confidence])?;
    finite("the effort", &[message.effort])?;
    if !message.goal.is_empty() && message.goal.len() != arm {
        return Err(format!("goal has {} values, expected none or {arm}", message.goal.len()));
    }
    Ok(MethodShown {
        method: message.method.clone(),
        gesture: placed("gesture", &Gesture::ALL, usize::from(message.gesture))?,
        recognised: named(&message.recognised)?,
        confidence: message.confidence,
        effort: message.effort,
        hand: HandView {
            state: placed("hand", &HandState::ALL, usize::from(message.hand))?,
            holds: read_object("the object in the hand", message.holds, objects)?,
        },
        gaze: none_or_one("gaze", &message.gaze)?.map(read_gaze),
        stop: none_or_one("stop", &message.stop)?.map(read_stop).transpose()?,
        target: read_target(&message.target, objects)?,
        planner: read_planner(&message.planner)?,
        mode: none_or_one("mode", &message.mode)?.map(read_mode).transpose()?,
        goal: (!message.goal.is_empty()).then(|| joints("goal", &message.goal)).transpose()?,
    })
}

/// One instant as it is drawn, stamped with its time.
pub(in crate::node) fn frame(frame: &DisplayFrame) -> proact_msgs::Frame {
    let shown = MethodShown {
        method: frame.method.clone(),
        gesture: frame.gesture,
        recognised: frame.recognised,
        confidence: frame.confidence,
        effort: frame.effort,
        hand: frame.hand,
        gaze: frame.gaze,
        stop: frame.stop.clone(),
        target: frame.target.clone(),
        planner: frame.planner.clone(),
        mode: frame.mode.clone(),
        goal: frame.goal.clone(),
    };
    proact_msgs::Frame {
        header: convert::header(frame.time, WORLD),
        tick: frame.time.0,
        view: method_view(&shown),
        joints: frame.joints.to_vec(),
        base: convert::pose(&frame.world_from_base),
        tip: convert::pose(&frame.world_from_tip),
        head: convert::pose(&frame.world_from_head),
        objects: frame.objects.iter().map(convert::pose).collect(),
        emg_source: frame.emg_source.clone(),
        time_left_secs: frame.time_left_secs,
        next: object_place(frame.next),
        score: frame.score,
        finished: frame.finished,
        events: texts(&frame.events),
        contacts: texts(&frame.contacts),
        feedback: texts(&frame.feedback),
    }
}

/// The instant as it was drawn.
pub(in crate::node) fn read_frame(
    message: &proact_msgs::Frame,
    counts: Counts,
) -> Result<DisplayFrame, Refused> {
    let Counts { moving, objects, .. } = counts;
    let shown = read_method_view(&message.view, counts)?;
    if message.joints.len() != moving {
        return Err(format!("joints has {} values, expected {moving}", message.joints.len()));
    }
    if message.objects.len() != objects {
        return Err(format!("{} objects, expected {objects}", message.objects.len()));
    }
    finite("time_left_secs", &[message.time_left_secs])?;
    Ok(DisplayFrame {
        time: SimTime(message.tick),
        method: shown.method,
        joints: joints("joints", &message.joints)?,
        world_from_base: exact_pose(&message.base)?,
        world_from_tip: exact_pose(&message.tip)?,
        world_from_head: exact_pose(&message.head)?,
        objects: message.objects.iter().map(exact_pose).collect::<Result<_, _>>()?,
        hand: shown.hand,
        gaze: shown.gaze,
        target: shown.target,
        planner: shown.planner,
        goal: shown.goal,
        mode: shown.mode,
        stop: shown.stop,
        gesture: shown.gesture,
        recognised: shown.recognised,
        confidence: shown.confidence,
        effort: shown.effort,
        emg_source: message.emg_source.clone(),
        time_left_secs: message.time_left_secs,
        next: read_object("next", message.next, objects)?,
        // The messages do not carry it: tasks whose goals change run without a ROS graph.
        asked: None,
        score: message.score,
        finished: message.finished,
        events: events(&message.events)?,
        contacts: events(&message.contacts)?,
        feedback: events(&message.feedback)?,
    })
}

#[cfg(test)]
mod tests;
