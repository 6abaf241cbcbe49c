use crate::method::refusal_view;
use crate::ports::{ArmKinematics, MethodProcess};
use crate::{
    ControlInput, ControlMethod, ControlOutput, FingerCommand, HandCommand, JointStates, MethodDisplay,
    MethodFault, MotionCommand, MotionState, PlanCommand,
};
use proact_types::{
    Command, ControlledDof, Gesture, HandView, JointVector, MAX_METHOD_TEXT_BYTES, MethodAnswer, MethodEvent,
    ModeView, ObjectId, PlanGoal, PlanReply, PlannerView, Point, Pose, SimTime, Target, TargetView, joints,
};
use serde::{Deserialize, Serialize};

/// A goal that is no further from the measured angles than this is one to stay there, rad: what was printed with six digits.
const HOLD_TOLERANCE_RAD: f64 = 1e-6;

/// One line to the outside process: what a method sees at one control step.
///
/// Units and frames are those of [`ControlInput`]. Numbers that are not finite arrive as `null`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MethodRequest {
    /// Milliseconds since the start of the trial; the answer repeats it.
    pub time: SimTime,
    /// [`ControlInput::command`].
    #[serde(rename = "gesture")]
    pub command: Command,
    /// [`ControlInput::recognized_gesture`].
    #[serde(default)]
    #[serde(rename = "recognised")]
    pub recognized_gesture: Gesture,
    /// [`ControlInput::effort`].
    #[serde(default)]
    pub effort: f64,
    /// [`ControlInput::drives`].
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub drives: Vec<f64>,
    /// [`ControlInput::published_command`].
    #[serde(rename = "message")]
    pub published_command: Option<Command>,
    /// [`ControlInput::measured`].
    pub measured: JointVector,
    /// [`ControlInput::commanded_at`].
    pub commanded: JointVector,
    /// [`ControlInput::highlight`].
    pub highlight: Option<ObjectId>,
    /// [`ControlInput::objects`].
    pub objects: Vec<Point>,
    /// [`ControlInput::posterior`].
    pub posterior: Vec<f64>,
    /// [`ControlInput::place`].
    #[serde(rename = "place")]
    pub place_point: Point,
    /// [`ControlInput::hand`].
    pub hand: HandView,
    /// [`ControlInput::world_from_base`].
    pub world_from_base: Pose,
    /// `base_from_tip` at the measured angles, so that simple methods need no kinematics of their own.
    pub base_from_tip: Option<Pose>,
    /// Geometric Jacobian at the commanded angles: 6 rows, linear first, base axes.
    pub jacobian: Option<Vec<Vec<f64>>>,
    /// [`ControlInput::plan`].
    pub plan: Option<PlanReply>,
    /// [`ControlInput::method_motion_state`].
    pub motion: MotionState,
    /// [`ControlInput::joint_states`].
    #[serde(default)]
    #[serde(rename = "felt")]
    pub joint_states: JointStates,
    /// [`ControlInput::targets`].
    pub targets: Vec<Target>,
    /// [`ControlInput::residual_limb`].
    pub limb: Option<JointVector>,
    /// [`ControlInput::emg_age_ms`].
    pub emg_age_ms: Option<u64>,
    /// [`ControlInput::gaze_age_ms`].
    pub gaze_age_ms: Option<u64>,
    /// [`ControlInput::tracking_age_ms`].
    pub tracking_age_ms: Option<u64>,
}

/// One line from the outside process.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MethodResponse {
    /// `time` of the line that it answers. An answer to an older line comes too late and is dropped.
    pub time: SimTime,
    /// For the arm.
    #[serde(default)]
    pub motion: Option<MotionCommand>,
    /// For the hand.
    #[serde(default)]
    pub hand: Option<HandCommand>,
    /// For single fingers.
    #[serde(default)]
    pub fingers: Option<FingerCommand>,
    /// For the planner.
    #[serde(default)]
    pub plan: Option<PlanCommand>,
    /// What happened to the method.
    #[serde(default)]
    pub events: Vec<MethodEvent>,
    /// Shown until the next answer that has one.
    #[serde(default)]
    pub mode: Option<ModeView>,
    /// Shown until the next answer that has one.
    #[serde(default)]
    pub target: Option<TargetView>,
    /// Shown until the next answer that has one.
    #[serde(default)]
    pub planner: Option<PlannerView>,
}

/// A method that lives in another process: at each step an [`MethodRequest`] to it, within the step an [`MethodResponse`]
/// from it.
///
/// While the answer to the present line is missing or cannot be used, the arm holds and [`ControlOutput::fault`] and
/// [`MethodDisplay::planner_view`] say why. Nothing is started here; deterministic as far as the process is.
#[derive(Debug)]
pub struct ExternalMethod<P> {
    process: P,
    /// As the process said last.
    last_display: MethodDisplay,
    /// It commands single fingers: they stop too.
    commands_fingers: bool,
}

impl<P: MethodProcess> ExternalMethod<P> {
    /// Speaks to `process`.
    pub fn new(process: P) -> Self {
        Self { process, last_display: MethodDisplay::default(), commands_fingers: false }
    }

    fn ask(&mut self, line: &MethodRequest, joints: usize) -> Result<MethodResponse, MethodFault> {
        let text = serde_json::to_string(line).map_err(|e| MethodFault::Failed(e.to_string()))?;
        match self.process.ask(line.time, &text) {
            MethodAnswer::Line(answer) => {
                Self::parse_response(&answer, line, joints).map_err(MethodFault::Failed)
            }
            MethodAnswer::Failed(reason) => Err(MethodFault::Failed(reason)),
            MethodAnswer::TimedOut(reason) => Err(MethodFault::TimedOut(reason)),
        }
    }

    /// The `answer` to `line`, of an arm with so many `joints`.
    fn parse_response(answer: &str, line: &MethodRequest, joints: usize) -> Result<MethodResponse, String> {
        let parsed: MethodResponse =
            serde_json::from_str(answer).map_err(|e| format!("the process answered {answer:?}: {e}"))?;
        if parsed.time != line.time {
            let (got, requested_ms) = (parsed.time.0, line.time.0);
            return Err(format!("the process answered the step of {got} ms, expected {requested_ms} ms"));
        }
        check_response(&parsed, joints, line.objects.len())?;
        if let Some(FingerCommand::Goto(angles)) = &parsed.fingers {
            check_joint_values("fingers", angles, line.joint_states.position.len().saturating_sub(joints))?;
        }
        Ok(parsed)
    }
}

/// A finite number for each of `count` joints.
fn check_joint_values(what: &str, values: &[f64], count: usize) -> Result<(), String> {
    match values.iter().position(|value| !value.is_finite()) {
        Some(index) => Err(format!("{what} {index} is {}, expected a finite number", values[index])),
        None if values.len() != count => {
            Err(format!("{what}: got {} values, the arm has {count} joints", values.len()))
        }
        None => Ok(()),
    }
}

/// Commands that fit the arm, and a target that fits the objects; the others are errors of the process.
fn check_response(answer: &MethodResponse, count: usize, objects: usize) -> Result<(), String> {
    if let Some(target) = &answer.target {
        let got = target.posterior.len();
        if got != 0 && got != objects {
            return Err(format!("posterior: got {got} values, expected none or {objects}"));
        }
        if let Some(object) = target.object.filter(|object| object.index() >= objects) {
            return Err(format!("target: got object {}, there are {objects}, counted from 0", object.0));
        }
    }
    for event in &answer.events {
        let MethodEvent::Note { text } = event else { continue };
        check_text("note", text)?;
    }
    answer.mode.as_ref().map_or(Ok(()), |mode| check_mode(mode, count))?;
    match &answer.planner {
        Some(PlannerView::Failed { reason, .. }) => check_text("planner.reason", reason)?,
        Some(PlannerView::Executing { progress, .. }) if !(0.0..=1.0).contains(progress) => {
            return Err(format!("planner.progress is {progress}, expected 0 to 1"));
        }
        _ => {}
    }
    if let Some(PlanCommand::Request(PlanGoal::Pick { object, .. })) = &answer.plan
        && object.index() >= objects
    {
        return Err(format!("plan: got object {}, there are {objects}, counted from 0", object.0));
    }
    match &answer.motion {
        Some(MotionCommand::Velocity(values)) => check_joint_values("velocity", values, count),
        Some(MotionCommand::Goto(values)) => check_joint_values("goto", values, count),
        Some(MotionCommand::Follow(path)) => path.points.iter().try_for_each(|point| {
            check_joint_values("q", &point.q, count).and(check_joint_values("qd", &point.qd, count))
        }),
        Some(MotionCommand::Hold) | None => Ok(()),
    }
}

/// A text that can be shown.
fn check_text(what: &str, text: &str) -> Result<(), String> {
    if text.len() > MAX_METHOD_TEXT_BYTES || text.chars().any(char::is_control) {
        return Err(format!(
            "{what} {text:?}: expected at most {MAX_METHOD_TEXT_BYTES} bytes without control characters"
        ));
    }
    Ok(())
}

/// A mode that an arm of `count` joints has.
fn check_mode(mode: &ModeView, count: usize) -> Result<(), String> {
    match mode.controlled_dof {
        ControlledDof::Joint(joint) if usize::from(joint) > count => {
            return Err(format!(
                "mode: got joint {joint}, expected 0 to {count}: the arm has {count} joints, then comes the hand"
            ));
        }
        ControlledDof::Translation(axis) | ControlledDof::Rotation(axis) if axis > 2 => {
            return Err(format!("mode: got axis {axis}, expected 0 (x), 1 (y) or 2 (z)"));
        }
        _ => {}
    }
    if !(-1..=1).contains(&mode.we_sign) {
        return Err(format!("mode: we_sign is {}, expected -1, 0 or 1", mode.we_sign));
    }
    if let Some(secs) = mode.next_in_secs.filter(|secs| *secs < 0.0) {
        return Err(format!("mode: next_in_secs is {secs}, expected 0 or more"));
    }
    [&mode.name, &mode.directions[0], &mode.directions[1]].into_iter().try_for_each(|t| check_text("mode", t))
}

/// `motion`, or a hold where it asks to go to the `measured` angles: it has let go, and an arm that holds gives up targets that it does
/// not reach. A goal that follows the arm would follow what pushes it.
fn hold_if_at_measured(motion: MotionCommand, measured: &[f64]) -> MotionCommand {
    match motion {
        MotionCommand::Goto(goal)
            if goal.iter().zip(measured).all(|(q, is)| (q - is).abs() <= HOLD_TOLERANCE_RAD) =>
        {
            MotionCommand::Hold
        }
        motion => motion,
    }
}

impl<P: MethodProcess> ControlMethod for ExternalMethod<P> {
    fn step(
        &mut self,
        now: SimTime,
        input: &ControlInput<'_>,
        kinematics: &mut dyn ArmKinematics,
    ) -> ControlOutput {
        let jacobian = kinematics.jacobian(input.commanded).ok();
        let rows =
            |j: nalgebra::DMatrix<f64>| j.row_iter().map(|row| row.iter().copied().collect()).collect();
        let line = MethodRequest {
            time: now,
            command: input.command,
            recognized_gesture: input.recognized_gesture,
            effort: input.effort,
            drives: input.drives.to_vec(),
            published_command: input.published_command,
            measured: joints(input.measured),
            commanded: joints(input.commanded),
            highlight: input.highlight,
            objects: input.objects.to_vec(),
            posterior: input.posterior.to_vec(),
            place_point: input.place_point,
            hand: input.hand,
            world_from_base: input.world_from_base,
            base_from_tip: kinematics.forward(input.measured).ok(),
            jacobian: jacobian.map(rows),
            plan: input.plan.cloned(),
            motion: input.motion,
            joint_states: input.joint_states.clone(),
            targets: input.targets.to_vec(),
            limb: input.limb.map(joints),
            emg_age_ms: input.emg_age_ms,
            gaze_age_ms: input.gaze_age_ms,
            tracking_age_ms: input.tracking_age_ms,
        };
        match self.ask(&line, input.commanded.len()) {
            Ok(answer) => {
                let MethodResponse { time: _, motion, hand, fingers, plan, events, mode, target, planner } =
                    answer;
                let motion = motion.map(|motion| hold_if_at_measured(motion, input.measured));
                self.commands_fingers |= matches!(fingers, Some(FingerCommand::Goto(_)));
                let last_display = &mut self.last_display;
                last_display.mode = mode.or(last_display.mode.take());
                last_display.target = target.unwrap_or_else(|| std::mem::take(&mut last_display.target));
                last_display.planner = planner.unwrap_or_else(|| last_display.planner.clone());
                ControlOutput {
                    motion,
                    hand,
                    fingers,
                    plan,
                    events,
                    display: last_display.clone(),
                    fault: None,
                }
            }
            Err(fault) => {
                let (MethodFault::TimedOut(reason) | MethodFault::Failed(reason)) = &fault;
                ControlOutput {
                    motion: Some(MotionCommand::Hold),
                    fingers: std::mem::take(&mut self.commands_fingers).then_some(FingerCommand::Hold),
                    display: MethodDisplay { planner: refusal_view(reason), ..self.last_display.clone() },
                    fault: Some(fault),
                    ..ControlOutput::default()
                }
            }
        }
    }
}
