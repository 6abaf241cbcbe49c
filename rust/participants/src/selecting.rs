mod residual_limb;

use crate::{
    Body, Participant, ParticipantOptions, sensorimotor::SensorimotorModel, target_choice::TargetChoice,
};
use proact_arm::ArmModel;
use proact_types::{
    Briefing, Command, DisplayFrame, HandState, Intention, ObjectId, PlannerView, Point, Scene, SimTime,
    Vector,
};
use residual_limb::{LimbGoal, ResidualLimbReach};
use std::sync::Arc;

/// A gaze correction never exceeds this, metres: people look at what they mean.
const CORRECTION_MAX: f64 = 0.06;
/// Closing on nothing for this long means that the block was missed.
const MISSED_MILLIS: u64 = 900;
/// Holding WE without any movement for this long means that another posture is needed.
const STUCK_MILLIS: u64 = 1500;
/// After so many postures in vain another object is taken, where the person may choose.
const MAX_ATTEMPTS: u32 = 3;
/// Where one object is as good as another, what is highlighted after this long instead of what is meant is taken.
const ACCEPT_HIGHLIGHT_AFTER_MS: u64 = 1500;
/// A gesture that nothing answers for this long was not noticed: the arm forgot it, or waits for a relaxed hand.
const NO_RESPONSE_MS: u64 = 2500;
/// Who does not look closely lets a marker be off by so many times as much.
const CARELESS_TOLERANCE_FACTOR: f64 = 2.0;
/// Who lets go of WE too early takes the arm for arrived after this share of its way.
const EARLY_RELEASE_PROGRESS: f64 = 0.85;
/// The hand then rests this long before it tries again: long enough that any decision rule sees it.
const REST_MILLIS: u64 = 600;

/// A participant who follows the task's order with gaze-assisted control, methods C and D.
///
/// Sees each frame `reaction_ms` late, corrects the gaze when the marker is off, leans toward what is out of
/// comfortable reach, relaxes between gestures and tries again what did not work. Deterministic for its seed.
/// It is no evidence about people: its habits were chosen, not fitted.
pub struct SelectingParticipant {
    sensorimotor: SensorimotorModel,
    target_choice: TargetChoice,
    /// The scene, and what is left of the person's own limb, where that is a part of the arm.
    residual_limb: Option<(Scene, ResidualLimbReach)>,
    table_height: f64,
    goal: Option<TransferGoal>,
    /// Where the eye rests relative to what it looks at, metres in `world`.
    correction: Vector,
    corrected_at: SimTime,
    correct_since: Option<SimTime>,
    /// Something else than what is meant was highlighted then, and something has been ever since.
    wrong_since: Option<SimTime>,
    /// The planner was seen at work since WE began: what it shows is no longer the end of the motion before.
    planner_seen: bool,
    reached: bool,
    closed_since: Option<SimTime>,
    stuck_since: Option<SimTime>,
    no_response_since: Option<SimTime>,
    rest_until: SimTime,
    attempt: u32,
    /// The next step was thought about.
    decided: bool,
    /// Mistakes of this step.
    is_careless: bool,
    omits_lock: bool,
    releases_early: bool,
}

/// What the participant is about.
#[derive(Clone, Copy, Debug, PartialEq)]
enum TransferGoal {
    Pick(ObjectId),
    Place(ObjectId),
}

impl SelectingParticipant {
    /// A participant with `body` before `scene` who was told `briefing`.
    pub fn new(
        options: ParticipantOptions,
        body: Body,
        scene: &Scene,
        briefing: &Briefing,
        seed: u64,
    ) -> Self {
        Self {
            sensorimotor: SensorimotorModel::new(options, body, scene.table_height, seed),
            target_choice: TargetChoice::new(scene, briefing),
            residual_limb: None,
            table_height: scene.table_height,
            goal: None,
            correction: Vector::zeros(),
            corrected_at: SimTime(0),
            correct_since: None,
            wrong_since: None,
            planner_seen: false,
            reached: false,
            closed_since: None,
            stuck_since: None,
            no_response_since: None,
            rest_until: SimTime(0),
            attempt: 0,
            decided: false,
            is_careless: false,
            omits_lock: false,
            releases_early: false,
        }
    }

    /// The same with a limb of which the joints `own` of the arm `model`, by their positions in it, are left: the method
    /// does not move them, and the person brings the hand near.
    pub fn with_residual_limb(mut self, scene: &Scene, model: Arc<ArmModel>, own: Vec<usize>) -> Self {
        if !own.is_empty() {
            self.residual_limb = Some((scene.clone(), ResidualLimbReach::new(model, own)));
        }
        self
    }

    fn next_command(&mut self, now: SimTime, seen: &DisplayFrame) -> Command {
        let goal = match seen.hand.held_object {
            Some(block) => Some(TransferGoal::Place(block)),
            None => {
                self.target_choice.put_down();
                self.target_choice.next_object(seen).map(TransferGoal::Pick)
            }
        };
        if goal != self.goal {
            self.goal = goal;
            self.begin_step();
            self.correction = Vector::zeros();
            self.correct_since = None;
            self.wrong_since = None;
            self.reached = false;
            self.stuck_since = None;
            self.attempt = 0;
            self.sensorimotor.lean_to_reach(0, false);
            if let Some((_, limb)) = &mut self.residual_limb {
                limb.restart();
            }
        }
        let errand = match goal {
            _ if self.reached => None,
            // The hand must be open before it goes down around something.
            Some(TransferGoal::Pick(object)) => {
                (seen.hand.state == HandState::Open).then_some(LimbGoal { object, place: None })
            }
            Some(TransferGoal::Place(object)) => {
                Some(LimbGoal { object, place: Some(self.target_choice.place_for(object, seen)) })
            }
            None => None,
        };
        if let (Some((scene, limb)), Some(errand)) = (&mut self.residual_limb, errand)
            && !limb.move_toward(now, scene, seen, errand)
        {
            return Command::NoMotion;
        }
        // What comes next is thought about with a relaxed hand.
        if !self.decided {
            self.decided = self.sensorimotor.decision_timer.is_decided(now);
            if !self.decided {
                return Command::NoMotion;
            }
        }
        match goal {
            None => Command::NoMotion,
            Some(TransferGoal::Pick(block)) => self.pick(now, seen, block),
            Some(TransferGoal::Place(block)) => self.place(now, seen, block),
        }
    }

    /// A step of the way begins: it is to be thought about, and mistakes to be made.
    fn begin_step(&mut self) {
        self.decided = false;
        self.sensorimotor.decision_timer.cancel();
        self.is_careless = !self.sensorimotor.skill.detects_error();
        self.omits_lock = self.sensorimotor.skill.omits_lock();
        self.releases_early = self.sensorimotor.skill.releases_early();
    }

    fn pick(&mut self, now: SimTime, seen: &DisplayFrame, block: ObjectId) -> Command {
        if self.reached {
            return self.close_hand(now, seen);
        }
        match seen.hand.state {
            HandState::Open => {}
            HandState::Opening => return Command::NoMotion,
            HandState::Closing | HandState::Closed => return Command::HandOpen,
        }
        // Who does not look closely takes whatever is highlighted for what is meant.
        // Who has waited long enough for it settles for what is as good.
        let waited =
            self.wrong_since.is_some_and(|since| now.millis_since(since) > ACCEPT_HIGHLIGHT_AFTER_MS);
        let will_do = |other: &ObjectId| waited && self.target_choice.is_equivalent_target(*other, seen);
        let settles_for = seen.target.object.filter(|other| *other != block).filter(will_do);
        let right = seen.target.object == Some(block)
            || settles_for.is_some()
            || (self.is_careless && seen.target.object.is_some());
        if !right {
            self.shift_gaze_from(now, seen, block);
        }
        match (seen.target.object, settles_for) {
            (_, Some(other)) if seen.target.locked => self.target_choice.accept_instead(other, seen),
            (Some(_), None) if !right => {
                self.wrong_since.get_or_insert(now);
            }
            (None, _) => self.wrong_since = None,
            _ => {}
        }
        if let Some(command) = self.lock(now, right, seen.target.locked) {
            return command;
        }
        self.approach(now, seen)
    }

    fn place(&mut self, now: SimTime, seen: &DisplayFrame, block: ObjectId) -> Command {
        if self.reached {
            return Command::HandOpen;
        }
        let gets_no_further =
            matches!(seen.planner, PlannerView::Arrived { intermediate: true } | PlannerView::Failed { .. });
        if gets_no_further && self.planner_seen && self.target_choice.may_drop(block, seen) {
            self.reached = true;
            return Command::NoMotion;
        }
        let target = self.target_choice.place_for(block, seen);
        let error = seen.target.place.map_or(Vector::repeat(1.0), |marker| target - marker);
        let careless = if self.is_careless { CARELESS_TOLERANCE_FACTOR } else { 1.0 };
        let tolerance = careless
            * self.sensorimotor.options.place_tolerance_m
            * if seen.target.locked { 2.0 } else { 1.0 };
        let right = error.norm() < tolerance;
        // One correction per look: the marker has to be seen where it went before the next.
        if !right
            && !seen.target.locked
            && now.millis_since(self.corrected_at) > self.sensorimotor.options.reaction_ms + 200
        {
            self.corrected_at = now;
            let corrected = self.correction + error.cap_magnitude(0.03) * 0.7;
            self.correction = corrected.cap_magnitude(CORRECTION_MAX);
        }
        if let Some(command) = self.lock(now, right, seen.target.locked) {
            return command;
        }
        self.approach(now, seen)
    }

    /// Brings the selection to a lock on what is meant. None once it is there.
    fn lock(&mut self, now: SimTime, right: bool, locked: bool) -> Option<Command> {
        if !right {
            self.correct_since = None;
        }
        match (right, locked) {
            (true, true) => None,
            (false, true) => Some(Command::WristFlexion),
            (false, false) => Some(Command::NoMotion),
            (true, false) if self.omits_lock => None,
            (true, false) => {
                let since = *self.correct_since.get_or_insert(now);
                let long_enough = now.millis_since(since) >= self.sensorimotor.options.dwell_ms;
                Some(if long_enough { Command::WristFlexion } else { Command::NoMotion })
            }
        }
    }

    /// Holds WE until the arm is there; takes another posture when it gets stuck.
    fn approach(&mut self, now: SimTime, seen: &DisplayFrame) -> Command {
        if self.sensorimotor.command() != Command::WristExtension {
            self.planner_seen = false;
        }
        let stuck = match &seen.planner {
            PlannerView::Executing { progress, intermediate: false }
                if self.releases_early && *progress > EARLY_RELEASE_PROGRESS =>
            {
                self.reached = true;
                self.closed_since = None;
                return Command::NoMotion;
            }
            PlannerView::Planning | PlannerView::Executing { .. } => {
                self.planner_seen = true;
                false
            }
            PlannerView::Arrived { intermediate: false } if self.planner_seen => {
                self.reached = true;
                self.closed_since = None;
                return Command::NoMotion;
            }
            PlannerView::Arrived { .. } | PlannerView::Failed { .. } => self.planner_seen,
            PlannerView::Idle => false,
        };
        if !stuck {
            self.stuck_since = None;
        } else if now.millis_since(*self.stuck_since.get_or_insert(now)) > STUCK_MILLIS {
            self.stuck_since = None;
            self.attempt += 1;
            // A person whose own limb has brought the hand there tries what it can do as it is.
            if self.residual_limb.is_some() {
                self.reached = true;
                self.closed_since = None;
                return Command::NoMotion;
            }
            if self.attempt.is_multiple_of(MAX_ATTEMPTS) {
                match self.goal {
                    Some(TransferGoal::Place(object)) => self.target_choice.give_up_place(object, seen),
                    _ => self.target_choice.give_up(),
                }
            }
            self.sensorimotor.lean_to_reach(self.attempt, true);
        }
        Command::WristExtension
    }

    /// What is wanted, but a rest when the gesture that is made goes unnoticed.
    fn rest_if_no_response(&mut self, now: SimTime, seen: &DisplayFrame, wanted: Command) -> Command {
        if now < self.rest_until {
            return Command::NoMotion;
        }
        let answered = match wanted {
            Command::WristExtension => match seen.planner {
                PlannerView::Planning | PlannerView::Executing { .. } => true,
                PlannerView::Arrived { .. } | PlannerView::Failed { .. } => self.planner_seen,
                PlannerView::Idle => false,
            },
            _ => matches!(seen.hand.state, HandState::Closing | HandState::Opening),
        };
        if wanted == Command::NoMotion || wanted != self.sensorimotor.command() || answered {
            self.no_response_since = None;
        } else if now.millis_since(*self.no_response_since.get_or_insert(now)) > NO_RESPONSE_MS {
            self.no_response_since = None;
            self.rest_until = now.plus_millis(REST_MILLIS);
            return Command::NoMotion;
        }
        wanted
    }

    /// Closes the hand on the block; opens it again and goes back when the block was missed.
    fn close_hand(&mut self, now: SimTime, seen: &DisplayFrame) -> Command {
        if seen.hand.state == HandState::Closed {
            let since = *self.closed_since.get_or_insert(now);
            if now.millis_since(since) > MISSED_MILLIS {
                self.target_choice.give_up();
                self.reached = false;
                self.begin_step();
                if let Some((_, limb)) = &mut self.residual_limb {
                    limb.restart();
                }
                return Command::HandOpen;
            }
        }
        Command::HandClose
    }

    /// Shifts the gaze to the far side of the block that is meant, away from the one that lights up.
    fn shift_gaze_from(&mut self, now: SimTime, seen: &DisplayFrame, block: ObjectId) {
        let Some(wrong) = seen.target.object else { return };
        if seen.target.locked
            || now.millis_since(self.corrected_at) < self.sensorimotor.options.reaction_ms + 400
        {
            return;
        }
        self.corrected_at = now;
        let position = |b: ObjectId| seen.objects[b.index()].translation.vector;
        let away = (position(block) - position(wrong)).try_normalize(1e-6).unwrap_or_else(Vector::x);
        self.correction = (self.correction + away * 0.015).cap_magnitude(CORRECTION_MAX);
    }

    fn fixation_point(&mut self, frame: &DisplayFrame) -> Point {
        match self.goal {
            Some(goal) => self.goal_point(goal, frame),
            None => Point::new(0.0, 0.0, self.table_height),
        }
    }

    fn goal_point(&mut self, goal: TransferGoal, frame: &DisplayFrame) -> Point {
        match goal {
            TransferGoal::Pick(block) => Point::from(frame.objects[block.index()].translation.vector),
            TransferGoal::Place(block) => self.target_choice.place_for(block, frame),
        }
    }
}

impl Participant for SelectingParticipant {
    fn step(&mut self, frame: &DisplayFrame) -> Intention {
        let now = frame.time;
        let seen = self.sensorimotor.perceive(frame);
        let wanted = self.next_command(now, &seen);
        let wanted = self.rest_if_no_response(now, &seen, wanted);
        self.sensorimotor.set_command(now, seen.stop.is_some(), wanted);
        let fixation_point = self.fixation_point(frame) + self.correction;
        // While nothing is locked, the eyes select.
        let moves = matches!(frame.planner, PlannerView::Executing { .. });
        let hand =
            (moves || seen.target.locked).then(|| Point::from(frame.world_from_tip.translation.vector));
        let limb = self.residual_limb.as_ref().and_then(|(_, limb)| limb.target_joints());
        self.sensorimotor.intention(frame, fixation_point, hand, limb)
    }
}
