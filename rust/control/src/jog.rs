use crate::inverse::NOT_FOLLOWING;
use crate::method::refusal_view;
use crate::simultaneous::all_modes;
use crate::{
    ControlInput, HandCommand, JogProfile, JogSteps, MethodDisplay, MotionCommand, ProportionalSpeed,
    VelocityRamp,
};
use proact_types::{Command, HandState, ModeView, PlannerView, SimTime, TargetView, zeros};

/// From gestures to motion, modes and hand: what methods A and B share.
///
/// HO cycles through the modes, WE and WF move along the selected one, HC toggles the hand.
#[derive(Clone, Debug)]
pub(crate) struct Jog {
    modes: Vec<ModeView>,
    selected: usize,
    timing: JogTiming,
}

/// What the gestures ask of the arm at one step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum JogMotion {
    /// Nothing new.
    None,
    /// The motion gesture is over.
    Stop,
    /// WE (1) or WF (-1) is held: the share of the method's speed, with that sign.
    Speed(f64),
    /// A message WE (1) or WF (-1); `repeated` if the message before was the same.
    Step { sign: f64, repeated: bool },
}

#[derive(Clone, Debug)]
enum JogTiming {
    Time(TimedJog),
    Message(StepPerMessageJog),
}

impl Jog {
    /// Cycles through `modes`. `ignores_open_after_close`: a message HO straight after HC counts as NM.
    pub(crate) fn new(modes: Vec<ModeView>, profile: &JogProfile, ignores_open_after_close: bool) -> Self {
        let pace = match *profile {
            JogProfile::Time {
                reverse_cycle_after_ms: back_after_ms,
                open_after_close_ms,
                confirm_open_ms,
                speed_steps: steps,
                proportional,
                ramp,
                simultaneous: _,
            } => JogTiming::Time(TimedJog {
                reverse_cycle_after_ms: back_after_ms,
                open_after_close_ms,
                confirm: DoubleConfirmation::new(confirm_open_ms),
                steps,
                proportional,
                ramp: ramp.map(|ramp| (ramp, [0.0; 2])),
                stepped_at: SimTime(0),
                command: Command::NoMotion,
                previous_command: Command::NoMotion,
                since: SimTime(0),
                moves: 0,
                next_in_secs: None,
                confirm_in_secs: None,
            }),
            JogProfile::Message { nominal_period_ms: nominal_ms, joint_state_period_ms: joint_state_ms } => {
                JogTiming::Message(StepPerMessageJog {
                    nominal_period_ms: nominal_ms,
                    joint_state_period_ms: joint_state_ms.max(1),
                    ignores_open_after_close,
                    received_message: false,
                    last_at: SimTime(0),
                    last: None,
                    repeat_count: 0,
                    awaiting_joint_state_since: None,
                    closed: false,
                })
            }
        };
        Self { modes, selected: 0, timing: pace }
    }

    /// Position of the selected mode.
    pub(crate) fn selected(&self) -> usize {
        self.selected
    }

    /// The selected mode, and `refusal` if there is one.
    pub(crate) fn display(&self, refusal: Option<&str>) -> MethodDisplay {
        MethodDisplay {
            mode: self.mode(),
            target: TargetView::default(),
            planner: self.planner_view(refusal),
        }
    }

    fn mode(&self) -> Option<ModeView> {
        let next_in_secs = match &self.timing {
            JogTiming::Time(pace) => pace.next_in_secs,
            JogTiming::Message(_) => None,
        };
        self.modes.get(self.selected).map(|mode| ModeView { next_in_secs, ..mode.clone() })
    }

    /// Shows `refusal` if there is one, else that opening the hand waits for a second HC.
    fn planner_view(&self, refusal: Option<&str>) -> PlannerView {
        let waits = match &self.timing {
            JogTiming::Time(pace) => {
                pace.confirm_in_secs.map(|secs| format!("HC again within {secs:.1} s opens the hand"))
            }
            JogTiming::Message(_) => None,
        };
        match refusal.map(str::to_owned).or(waits) {
            Some(reason) => refusal_view(&reason),
            None => PlannerView::Idle,
        }
    }

    /// All modes at once, for a regressor's drives; `waits_secs` is the time left for a second command that opens the hand.
    pub(crate) fn display_all(&self, refusal: Option<&str>, waits_secs: Option<f64>) -> MethodDisplay {
        let waits = waits_secs.map(|secs| format!("opening again within {secs:.1} s opens the hand"));
        let planner =
            refusal.map(str::to_owned).or(waits).map_or(PlannerView::Idle, |reason| refusal_view(&reason));
        MethodDisplay { mode: all_modes(&self.modes), target: TargetView::default(), planner }
    }

    /// Advances to `now`.
    pub(crate) fn step(
        &mut self,
        now: SimTime,
        input: &ControlInput<'_>,
    ) -> (JogMotion, Option<HandCommand>) {
        let (motion, hand, steps) = match &mut self.timing {
            JogTiming::Time(pace) => pace.step(now, input),
            JogTiming::Message(pace) => pace.step(now, input),
        };
        let count = self.modes.len().max(1) as i64;
        self.selected = (self.selected as i64 + steps).rem_euclid(count) as usize;
        (motion, hand)
    }
}

/// What a motion that is refused asks of the arm. While the gesture lasts, an arm that something stops goes on pressing as
/// hard as it does: it is asked to stop, and then for no speed, since an arm that holds gives up what it does not reach.
#[derive(Clone, Debug, Default)]
pub(crate) struct BlockedMotion {
    already_stopped: bool,
}

impl BlockedMotion {
    /// For one step of an arm of `joints` joints.
    pub(crate) fn command(&mut self, refusal: Option<&str>, joints: usize) -> MotionCommand {
        let presses = refusal == Some(NOT_FOLLOWING);
        if std::mem::replace(&mut self.already_stopped, presses) && presses {
            return MotionCommand::Velocity(zeros(joints));
        }
        MotionCommand::Hold
    }
}

fn command_sign(command: Command) -> f64 {
    if command == Command::WristFlexion { -1.0 } else { 1.0 }
}

/// At a speed while a gesture is held.
#[derive(Clone, Debug)]
struct TimedJog {
    reverse_cycle_after_ms: u64,
    open_after_close_ms: u64,
    confirm: DoubleConfirmation,
    steps: Option<JogSteps>,
    proportional: Option<ProportionalSpeed>,
    /// With the counters of WE and of WF.
    ramp: Option<(VelocityRamp, [f64; 2])>,
    stepped_at: SimTime,
    command: Command,
    /// The gesture before the present one.
    previous_command: Command,
    since: SimTime,
    /// Changes of mode since HO began.
    moves: u64,
    next_in_secs: Option<f64>,
    confirm_in_secs: Option<f64>,
}

impl TimedJog {
    fn step(&mut self, now: SimTime, input: &ControlInput<'_>) -> (JogMotion, Option<HandCommand>, i64) {
        let changed = input.command != self.command;
        let moved = matches!(self.command, Command::WristExtension | Command::WristFlexion);
        if changed {
            self.previous_command = std::mem::replace(&mut self.command, input.command);
            self.since = now;
            self.moves = 0;
        }
        self.next_in_secs = None;
        let steps = if self.command == Command::HandOpen { self.cycle(now) } else { 0 };
        let hand = (changed && self.command == Command::HandClose).then(|| self.toggle(now, input)).flatten();
        self.confirm_in_secs = self.confirm.remaining_secs(now);
        let ramped = self.ramp_factor(now);
        let motion = match self.command {
            Command::WristExtension | Command::WristFlexion => {
                let held = self.steps.map_or(1.0, |steps| steps.speed_factor(now.millis_since(self.since)));
                let effort = self.proportional.map_or(1.0, |by| by.speed_factor(input.effort));
                let share = held * effort * ramped;
                // Nothing is asked for: the command before runs out within two steps.
                if share > 0.0 {
                    JogMotion::Speed(share * command_sign(self.command))
                } else {
                    JogMotion::None
                }
            }
            _ if changed && moved => JogMotion::Stop,
            _ => JogMotion::None,
        };
        (motion, hand, steps)
    }

    /// The ramp's share of the speed in the present direction, after the time since the last step.
    fn ramp_factor(&mut self, now: SimTime) -> f64 {
        let millis = now.millis_since(self.stepped_at);
        self.stepped_at = now;
        let Some((ramp, counts)) = &mut self.ramp else { return 1.0 };
        let directions = [Command::WristExtension, Command::WristFlexion];
        for (count, direction) in counts.iter_mut().zip(directions) {
            *count = ramp.next_counter(*count, millis, direction == self.command);
        }
        directions
            .iter()
            .zip(counts)
            .find(|(direction, _)| **direction == self.command)
            .map_or(0.0, |(_, count)| *count)
    }

    /// Forward when HO is made, back by one from there when it is held.
    fn cycle(&mut self, now: SimTime) -> i64 {
        // The muscles pass through HO when a fist relaxes.
        let wait = if self.previous_command == Command::HandClose { self.open_after_close_ms } else { 0 };
        let Some(held) = now.millis_since(self.since).checked_sub(wait) else { return 0 };
        let due = self.reverse_cycle_after_ms * self.moves;
        let steps = match self.moves {
            0 => 1,
            _ if self.reverse_cycle_after_ms == 0 || held < due => 0,
            1 => -2,
            _ => -1,
        };
        self.moves += u64::from(steps != 0);
        if self.reverse_cycle_after_ms > 0 {
            let left = (self.reverse_cycle_after_ms * self.moves).saturating_sub(held);
            self.next_in_secs = Some(left as f64 * 1e-3);
        }
        steps
    }

    /// The hand's own state decides where it goes.
    fn toggle(&mut self, now: SimTime, input: &ControlInput<'_>) -> Option<HandCommand> {
        match input.hand.state {
            HandState::Open | HandState::Opening => Some(HandCommand::Close),
            HandState::Closed | HandState::Closing => {
                let granted = input.hand.held_object.is_none() || self.confirm.is_confirmed(now);
                granted.then_some(HandCommand::Open)
            }
        }
    }
}

/// By a step for each message, with the original's quirks.
#[derive(Clone, Debug)]
struct StepPerMessageJog {
    nominal_period_ms: u64,
    joint_state_period_ms: u64,
    ignores_open_after_close: bool,
    /// A message of the classifier has come.
    received_message: bool,
    last_at: SimTime,
    last: Option<Command>,
    /// Equal messages in a row.
    repeat_count: u64,
    /// The mode changed then and no joint state has come since.
    awaiting_joint_state_since: Option<SimTime>,
    /// What the node believes of the hand.
    closed: bool,
}

impl StepPerMessageJog {
    fn step(&mut self, now: SimTime, input: &ControlInput<'_>) -> (JogMotion, Option<HandCommand>, i64) {
        let nothing = (JogMotion::None, None, 0);
        self.received_message |= input.published_command.is_some();
        // Gestures from keys make no messages; the classifier's nominal rate stands in for them.
        let due = !self.received_message && now.millis_since(self.last_at) >= self.nominal_period_ms;
        let Some(message) = input.published_command.or(due.then_some(input.command)) else { return nothing };
        self.last_at = now;
        if let Some(since) = self.awaiting_joint_state_since {
            if now.0 / self.joint_state_period_ms == since.0 / self.joint_state_period_ms {
                return nothing;
            }
            self.awaiting_joint_state_since = None;
        }
        let follows_close = self.last == Some(Command::HandClose) && message == Command::HandOpen;
        let message =
            if self.ignores_open_after_close && follows_close { Command::NoMotion } else { message };
        let repeated = self.last.replace(message) == Some(message);
        self.repeat_count = if repeated { self.repeat_count + 1 } else { 1 };
        match message {
            Command::WristExtension | Command::WristFlexion => {
                (JogMotion::Step { sign: command_sign(message), repeated }, None, 0)
            }
            Command::HandOpen if self.repeat_count == 2 => {
                self.awaiting_joint_state_since = Some(now);
                (JogMotion::None, None, 1)
            }
            Command::HandClose if !repeated => {
                self.closed = !self.closed;
                let hand = if self.closed { HandCommand::Close } else { HandCommand::Open };
                (JogMotion::None, Some(hand), 0)
            }
            _ => nothing,
        }
    }
}

/// Asks for a command twice within a time.
#[derive(Clone, Debug)]
pub(crate) struct DoubleConfirmation {
    window_ms: u64,
    first_request_at: Option<SimTime>,
}

impl DoubleConfirmation {
    /// Within `window_ms`; zero grants at once.
    pub(crate) fn new(window_ms: u64) -> Self {
        Self { window_ms, first_request_at: None }
    }

    /// True for the second of two commands within the time.
    pub(crate) fn is_confirmed(&mut self, now: SimTime) -> bool {
        let second = self.first_request_at.take().is_some_and(|at| now.millis_since(at) <= self.window_ms);
        if self.window_ms == 0 || second {
            return true;
        }
        self.first_request_at = Some(now);
        false
    }

    /// Seconds left for the second command.
    pub(crate) fn remaining_secs(&self, now: SimTime) -> Option<f64> {
        let left = self.window_ms.checked_sub(now.millis_since(self.first_request_at?))?;
        (left > 0).then_some(left as f64 * 1e-3)
    }
}
