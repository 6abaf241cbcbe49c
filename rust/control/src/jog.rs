use crate::inverse::RUNS_AHEAD;
use crate::method::refused;
use crate::simultaneous::all_modes;
use crate::{
    ControlInput, HandCommand, JogProfile, JogSteps, MotionCommand, ProportionalSpeed, Shown, VelocityRamp,
};
use proact_types::{Gesture, HandState, ModeView, PlannerView, SimTime, TargetView, zeros};

/// From gestures to motion, modes and hand: what methods A and B share.
///
/// HO cycles through the modes, WE and WF move along the selected one, HC toggles the hand.
#[derive(Clone, Debug)]
pub(crate) struct Jog {
    modes: Vec<ModeView>,
    selected: usize,
    pace: Pace,
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
enum Pace {
    Time(TimePace),
    Message(MessagePace),
}

impl Jog {
    /// Cycles through `modes`. `drops_open_after_close`: a message HO straight after HC counts as NM.
    pub(crate) fn new(modes: Vec<ModeView>, profile: &JogProfile, drops_open_after_close: bool) -> Self {
        let pace = match *profile {
            JogProfile::Time {
                back_after_ms,
                open_after_close_ms,
                confirm_open_ms,
                steps,
                proportional,
                ramp,
                simultaneous: _,
            } => Pace::Time(TimePace {
                back_after_ms,
                open_after_close_ms,
                confirm: Confirm::new(confirm_open_ms),
                steps,
                proportional,
                ramp: ramp.map(|ramp| (ramp, [0.0; 2])),
                stepped_at: SimTime(0),
                gesture: Gesture::NoMotion,
                before: Gesture::NoMotion,
                since: SimTime(0),
                moves: 0,
                next_in_secs: None,
                confirm_in_secs: None,
            }),
            JogProfile::Message { nominal_ms, joint_state_ms } => Pace::Message(MessagePace {
                nominal_ms,
                joint_state_ms: joint_state_ms.max(1),
                drops_open_after_close,
                heard: false,
                last_at: SimTime(0),
                last: None,
                count: 0,
                blind_since: None,
                closed: false,
            }),
        };
        Self { modes, selected: 0, pace }
    }

    /// Position of the selected mode.
    pub(crate) fn selected(&self) -> usize {
        self.selected
    }

    /// The selected mode, and `refusal` if there is one.
    pub(crate) fn shown(&self, refusal: Option<&str>) -> Shown {
        Shown { mode: self.mode(), target: TargetView::default(), planner: self.planner(refusal) }
    }

    fn mode(&self) -> Option<ModeView> {
        let next_in_secs = match &self.pace {
            Pace::Time(pace) => pace.next_in_secs,
            Pace::Message(_) => None,
        };
        self.modes.get(self.selected).map(|mode| ModeView { next_in_secs, ..mode.clone() })
    }

    /// Shows `refusal` if there is one, else that opening the hand waits for a second HC.
    fn planner(&self, refusal: Option<&str>) -> PlannerView {
        let waits = match &self.pace {
            Pace::Time(pace) => {
                pace.confirm_in_secs.map(|secs| format!("HC again within {secs:.1} s opens the hand"))
            }
            Pace::Message(_) => None,
        };
        match refusal.map(str::to_owned).or(waits) {
            Some(reason) => refused(&reason),
            None => PlannerView::Idle,
        }
    }

    /// All modes at once, for a regressor's drives; `waits_secs` is the time left for a second command that opens the hand.
    pub(crate) fn shown_at_once(&self, refusal: Option<&str>, waits_secs: Option<f64>) -> Shown {
        let waits = waits_secs.map(|secs| format!("opening again within {secs:.1} s opens the hand"));
        let planner = refusal.map(str::to_owned).or(waits).map_or(PlannerView::Idle, |said| refused(&said));
        Shown { mode: all_modes(&self.modes), target: TargetView::default(), planner }
    }

    /// Advances to `now`.
    pub(crate) fn step(
        &mut self,
        now: SimTime,
        input: &ControlInput<'_>,
    ) -> (JogMotion, Option<HandCommand>) {
        let (motion, hand, steps) = match &mut self.pace {
            Pace::Time(pace) => pace.step(now, input),
            Pace::Message(pace) => pace.step(now, input),
        };
        let count = self.modes.len().max(1) as i64;
        self.selected = (self.selected as i64 + steps).rem_euclid(count) as usize;
        (motion, hand)
    }
}

/// What a motion that is refused asks of the arm. While the gesture lasts, an arm that something stops goes on pressing as
/// hard as it does: it is asked to stop, and then for no speed, since an arm that holds gives up what it does not reach.
#[derive(Clone, Debug, Default)]
pub(crate) struct Press {
    stopped: bool,
}

impl Press {
    /// For one step of an arm of `joints` joints.
    pub(crate) fn on(&mut self, refusal: Option<&str>, joints: usize) -> MotionCommand {
        let presses = refusal == Some(RUNS_AHEAD);
        if std::mem::replace(&mut self.stopped, presses) && presses {
            return MotionCommand::Velocity(zeros(joints));
        }
        MotionCommand::Hold
    }
}

fn sign(gesture: Gesture) -> f64 {
    if gesture == Gesture::WristFlexion { -1.0 } else { 1.0 }
}

/// At a speed while a gesture is held.
#[derive(Clone, Debug)]
struct TimePace {
    back_after_ms: u64,
    open_after_close_ms: u64,
    confirm: Confirm,
    steps: Option<JogSteps>,
    proportional: Option<ProportionalSpeed>,
    /// With the counters of WE and of WF.
    ramp: Option<(VelocityRamp, [f64; 2])>,
    stepped_at: SimTime,
    gesture: Gesture,
    /// The gesture before the present one.
    before: Gesture,
    since: SimTime,
    /// Changes of mode since HO began.
    moves: u64,
    next_in_secs: Option<f64>,
    confirm_in_secs: Option<f64>,
}

impl TimePace {
    fn step(&mut self, now: SimTime, input: &ControlInput<'_>) -> (JogMotion, Option<HandCommand>, i64) {
        let changed = input.gesture != self.gesture;
        let moved = matches!(self.gesture, Gesture::WristExtension | Gesture::WristFlexion);
        if changed {
            self.before = std::mem::replace(&mut self.gesture, input.gesture);
            self.since = now;
            self.moves = 0;
        }
        self.next_in_secs = None;
        let steps = if self.gesture == Gesture::HandOpen { self.cycle(now) } else { 0 };
        let hand = (changed && self.gesture == Gesture::HandClose).then(|| self.toggle(now, input)).flatten();
        self.confirm_in_secs = self.confirm.waits_secs(now);
        let ramped = self.ramped(now);
        let motion = match self.gesture {
            Gesture::WristExtension | Gesture::WristFlexion => {
                let held = self.steps.map_or(1.0, |steps| steps.share(now.millis_since(self.since)));
                let effort = self.proportional.map_or(1.0, |by| by.share(input.effort));
                let share = held * effort * ramped;
                // Nothing is asked for: the command before runs out within two steps.
                if share > 0.0 { JogMotion::Speed(share * sign(self.gesture)) } else { JogMotion::None }
            }
            _ if changed && moved => JogMotion::Stop,
            _ => JogMotion::None,
        };
        (motion, hand, steps)
    }

    /// The ramp's share of the speed in the present direction, after the time since the last step.
    fn ramped(&mut self, now: SimTime) -> f64 {
        let millis = now.millis_since(self.stepped_at);
        self.stepped_at = now;
        let Some((ramp, counts)) = &mut self.ramp else { return 1.0 };
        let directions = [Gesture::WristExtension, Gesture::WristFlexion];
        for (count, direction) in counts.iter_mut().zip(directions) {
            *count = ramp.count(*count, millis, direction == self.gesture);
        }
        directions
            .iter()
            .zip(counts)
            .find(|(direction, _)| **direction == self.gesture)
            .map_or(0.0, |(_, count)| *count)
    }

    /// Forward when HO is made, back by one from there when it is held.
    fn cycle(&mut self, now: SimTime) -> i64 {
        // The muscles pass through HO when a fist relaxes.
        let wait = if self.before == Gesture::HandClose { self.open_after_close_ms } else { 0 };
        let Some(held) = now.millis_since(self.since).checked_sub(wait) else { return 0 };
        let due = self.back_after_ms * self.moves;
        let steps = match self.moves {
            0 => 1,
            _ if self.back_after_ms == 0 || held < due => 0,
            1 => -2,
            _ => -1,
        };
        self.moves += u64::from(steps != 0);
        if self.back_after_ms > 0 {
            let left = (self.back_after_ms * self.moves).saturating_sub(held);
            self.next_in_secs = Some(left as f64 * 1e-3);
        }
        steps
    }

    /// The hand's own state decides where it goes.
    fn toggle(&mut self, now: SimTime, input: &ControlInput<'_>) -> Option<HandCommand> {
        match input.hand.state {
            HandState::Open | HandState::Opening => Some(HandCommand::Close),
            HandState::Closed | HandState::Closing => {
                let granted = input.hand.holds.is_none() || self.confirm.granted(now);
                granted.then_some(HandCommand::Open)
            }
        }
    }
}

/// By a step for each message, with the original's quirks.
#[derive(Clone, Debug)]
struct MessagePace {
    nominal_ms: u64,
    joint_state_ms: u64,
    drops_open_after_close: bool,
    /// A message of the classifier has come.
    heard: bool,
    last_at: SimTime,
    last: Option<Gesture>,
    /// Equal messages in a row.
    count: u64,
    /// The mode changed then and no joint state has come since.
    blind_since: Option<SimTime>,
    /// What the node believes of the hand.
    closed: bool,
}

impl MessagePace {
    fn step(&mut self, now: SimTime, input: &ControlInput<'_>) -> (JogMotion, Option<HandCommand>, i64) {
        let nothing = (JogMotion::None, None, 0);
        self.heard |= input.message.is_some();
        // Gestures from keys make no messages; the classifier's nominal rate stands in for them.
        let due = !self.heard && now.millis_since(self.last_at) >= self.nominal_ms;
        let Some(message) = input.message.or(due.then_some(input.gesture)) else { return nothing };
        self.last_at = now;
        if let Some(since) = self.blind_since {
            if now.0 / self.joint_state_ms == since.0 / self.joint_state_ms {
                return nothing;
            }
            self.blind_since = None;
        }
        let follows_close = self.last == Some(Gesture::HandClose) && message == Gesture::HandOpen;
        let message = if self.drops_open_after_close && follows_close { Gesture::NoMotion } else { message };
        let repeated = self.last.replace(message) == Some(message);
        self.count = if repeated { self.count + 1 } else { 1 };
        match message {
            Gesture::WristExtension | Gesture::WristFlexion => {
                (JogMotion::Step { sign: sign(message), repeated }, None, 0)
            }
            Gesture::HandOpen if self.count == 2 => {
                self.blind_since = Some(now);
                (JogMotion::None, None, 1)
            }
            Gesture::HandClose if !repeated => {
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
pub(crate) struct Confirm {
    window_ms: u64,
    asked: Option<SimTime>,
}

impl Confirm {
    /// Within `window_ms`; zero grants at once.
    pub(crate) fn new(window_ms: u64) -> Self {
        Self { window_ms, asked: None }
    }

    /// True for the second of two commands within the time.
    pub(crate) fn granted(&mut self, now: SimTime) -> bool {
        let second = self.asked.take().is_some_and(|at| now.millis_since(at) <= self.window_ms);
        if self.window_ms == 0 || second {
            return true;
        }
        self.asked = Some(now);
        false
    }

    /// Seconds left for the second command.
    pub(crate) fn waits_secs(&self, now: SimTime) -> Option<f64> {
        let left = self.window_ms.checked_sub(now.millis_since(self.asked?))?;
        (left > 0).then_some(left as f64 * 1e-3)
    }
}
