mod limb;

use crate::{Body, Participant, ParticipantOptions, choice::Choice, habits::Habits};
use limb::{Errand, OwnLimb};
use proact_arm::ArmModel;
use proact_types::{
    Briefing, DisplayFrame, Gesture, HandState, Intention, ObjectId, PlannerView, Point, Scene, SimTime,
    Vector,
};
use std::sync::Arc;

/// A gaze correction never exceeds this, metres: people look at what they mean.
const CORRECTION_MAX: f64 = 0.06;
/// Closing on nothing for this long means that the block was missed.
const MISSED_MILLIS: u64 = 900;
/// Holding WE without any movement for this long means that another posture is needed.
const STUCK_MILLIS: u64 = 1500;
/// After so many postures in vain another object is taken, where the person may choose.
const GIVES_UP_AFTER: u32 = 3;
/// Where one object is as good as another, what is highlighted after this long instead of what is meant is taken.
const SETTLES_MILLIS: u64 = 1500;
/// A gesture that nothing answers for this long was not noticed: the arm forgot it, or waits for a relaxed hand.
const UNNOTICED_MILLIS: u64 = 2500;
/// Who does not look closely lets a marker be off by so many times as much.
const CARELESS: f64 = 2.0;
/// Who lets go of WE too early takes the arm for arrived after this share of its way.
const EARLY_PROGRESS: f64 = 0.85;
/// The hand then rests this long before it tries again: long enough that any decision rule sees it.
const REST_MILLIS: u64 = 600;

/// A participant who follows the task's order with gaze-assisted control, methods C and D.
///
/// Sees each frame `reaction_ms` late, corrects the gaze when the marker is off, leans toward what is out of
/// comfortable reach, relaxes between gestures and tries again what did not work. Deterministic for its seed.
/// It is no evidence about people: its habits were chosen, not fitted.
pub struct SelectingParticipant {
    habits: Habits,
    choice: Choice,
    /// The scene, and what is left of the person's own limb, where that is a part of the arm.
    own: Option<(Scene, OwnLimb)>,
    table_height: f64,
    goal: Option<Goal>,
    /// Where the eye rests relative to what it looks at, metres in `world`.
    correction: Vector,
    corrected_at: SimTime,
    right_since: Option<SimTime>,
    /// Something else than what is meant was highlighted then, and something has been ever since.
    wrong_since: Option<SimTime>,
    /// The planner was seen at work since WE began: what it shows is no longer the end of the motion before.
    under_way: bool,
    reached: bool,
    closed_since: Option<SimTime>,
    stuck_since: Option<SimTime>,
    unnoticed_since: Option<SimTime>,
    rest_until: SimTime,
    attempt: u32,
    /// The next step was thought about.
    decided: bool,
    /// Mistakes of this step.
    careless: bool,
    forgets_lock: bool,
    lets_go_early: bool,
}

/// What the participant is about.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Goal {
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
            habits: Habits::new(options, body, scene.table_height, seed),
            choice: Choice::new(scene, briefing),
            own: None,
            table_height: scene.table_height,
            goal: None,
            correction: Vector::zeros(),
            corrected_at: SimTime(0),
            right_since: None,
            wrong_since: None,
            under_way: false,
            reached: false,
            closed_since: None,
            stuck_since: None,
            unnoticed_since: None,
            rest_until: SimTime(0),
            attempt: 0,
            decided: false,
            careless: false,
            forgets_lock: false,
            lets_go_early: false,
        }
    }

    /// The same with a limb of which the joints `own` of the arm `model`, by their positions in it, are left: the method
    /// does not move them, and the person brings the hand near.
    pub fn with_limb(mut self, scene: &Scene, model: Arc<ArmModel>, own: Vec<usize>) -> Self {
        if !own.is_empty() {
            self.own = Some((scene.clone(), OwnLimb::new(model, own)));
        }
        self
    }

    fn decide(&mut self, now: SimTime, seen: &DisplayFrame) -> Gesture {
        let goal = match seen.hand.holds {
            Some(block) => Some(Goal::Place(block)),
            None => {
                self.choice.put_down();
                self.choice.next(seen).map(Goal::Pick)
            }
        };
        if goal != self.goal {
            self.goal = goal;
            self.begin_step();
            self.correction = Vector::zeros();
            self.right_since = None;
            self.wrong_since = None;
            self.reached = false;
            self.stuck_since = None;
            self.attempt = 0;
            self.habits.lean_to_reach(0, false);
            if let Some((_, limb)) = &mut self.own {
                limb.begin();
            }
        }
        let errand = match goal {
            _ if self.reached => None,
            // The hand must be open before it goes down around something.
            Some(Goal::Pick(object)) => {
                (seen.hand.state == HandState::Open).then_some(Errand { object, place: None })
            }
            Some(Goal::Place(object)) => {
                Some(Errand { object, place: Some(self.choice.place(object, seen)) })
            }
            None => None,
        };
        if let (Some((scene, limb)), Some(errand)) = (&mut self.own, errand)
            && !limb.bring(now, scene, seen, errand)
        {
            return Gesture::NoMotion;
        }
        // What comes next is thought about with a relaxed hand.
        if !self.decided {
            self.decided = self.habits.thinking.is_over(now);
            if !self.decided {
                return Gesture::NoMotion;
            }
        }
        match goal {
            None => Gesture::NoMotion,
            Some(Goal::Pick(block)) => self.pick(now, seen, block),
            Some(Goal::Place(block)) => self.place(now, seen, block),
        }
    }

    /// A step of the way begins: it is to be thought about, and mistakes to be made.
    fn begin_step(&mut self) {
        self.decided = false;
        self.habits.thinking.drop_it();
        self.careless = !self.habits.skill.notices();
        self.forgets_lock = self.habits.skill.forgets_lock();
        self.lets_go_early = self.habits.skill.lets_go_early();
    }

    fn pick(&mut self, now: SimTime, seen: &DisplayFrame, block: ObjectId) -> Gesture {
        if self.reached {
            return self.grip(now, seen);
        }
        match seen.hand.state {
            HandState::Open => {}
            HandState::Opening => return Gesture::NoMotion,
            HandState::Closing | HandState::Closed => return Gesture::HandOpen,
        }
        // Who does not look closely takes whatever is highlighted for what is meant.
        // Who has waited long enough for it settles for what is as good.
        let waited = self.wrong_since.is_some_and(|since| now.millis_since(since) > SETTLES_MILLIS);
        let will_do = |other: &ObjectId| waited && self.choice.is_as_good(*other, seen);
        let settles_for = seen.target.object.filter(|other| *other != block).filter(will_do);
        let right = seen.target.object == Some(block)
            || settles_for.is_some()
            || (self.careless && seen.target.object.is_some());
        if !right {
            self.look_away_from(now, seen, block);
        }
        match (seen.target.object, settles_for) {
            (_, Some(other)) if seen.target.locked => self.choice.settle_for(other, seen),
            (Some(_), None) if !right => {
                self.wrong_since.get_or_insert(now);
            }
            (None, _) => self.wrong_since = None,
            _ => {}
        }
        if let Some(gesture) = self.lock(now, right, seen.target.locked) {
            return gesture;
        }
        self.approach(now, seen)
    }

    fn place(&mut self, now: SimTime, seen: &DisplayFrame, block: ObjectId) -> Gesture {
        if self.reached {
            return Gesture::HandOpen;
        }
        let gets_no_further =
            matches!(seen.planner, PlannerView::Arrived { intermediate: true } | PlannerView::Failed { .. });
        if gets_no_further && self.under_way && self.choice.may_fall(block, seen) {
            self.reached = true;
            return Gesture::NoMotion;
        }
        let target = self.choice.place(block, seen);
        let error = seen.target.place.map_or(Vector::repeat(1.0), |marker| target - marker);
        let careless = if self.careless { CARELESS } else { 1.0 };
        let tolerance =
            careless * self.habits.options.place_tolerance_m * if seen.target.locked { 2.0 } else { 1.0 };
        let right = error.norm() < tolerance;
        // One correction per look: the marker has to be seen where it went before the next.
        if !right
            && !seen.target.locked
            && now.millis_since(self.corrected_at) > self.habits.options.reaction_ms + 200
        {
            self.corrected_at = now;
            let corrected = self.correction + error.cap_magnitude(0.03) * 0.7;
            self.correction = corrected.cap_magnitude(CORRECTION_MAX);
        }
        if let Some(gesture) = self.lock(now, right, seen.target.locked) {
            return gesture;
        }
        self.approach(now, seen)
    }

    /// Brings the selection to a lock on what is meant. None once it is there.
    fn lock(&mut self, now: SimTime, right: bool, locked: bool) -> Option<Gesture> {
        if !right {
            self.right_since = None;
        }
        match (right, locked) {
            (true, true) => None,
            (false, true) => Some(Gesture::WristFlexion),
            (false, false) => Some(Gesture::NoMotion),
            (true, false) if self.forgets_lock => None,
            (true, false) => {
                let since = *self.right_since.get_or_insert(now);
                let long_enough = now.millis_since(since) >= self.habits.options.dwell_ms;
                Some(if long_enough { Gesture::WristFlexion } else { Gesture::NoMotion })
            }
        }
    }

    /// Holds WE until the arm is there; takes another posture when it gets stuck.
    fn approach(&mut self, now: SimTime, seen: &DisplayFrame) -> Gesture {
        if self.habits.gesture() != Gesture::WristExtension {
            self.under_way = false;
        }
        let stuck = match &seen.planner {
            PlannerView::Executing { progress, intermediate: false }
                if self.lets_go_early && *progress > EARLY_PROGRESS =>
            {
                self.reached = true;
                self.closed_since = None;
                return Gesture::NoMotion;
            }
            PlannerView::Planning | PlannerView::Executing { .. } => {
                self.under_way = true;
                false
            }
            PlannerView::Arrived { intermediate: false } if self.under_way => {
                self.reached = true;
                self.closed_since = None;
                return Gesture::NoMotion;
            }
            PlannerView::Arrived { .. } | PlannerView::Failed { .. } => self.under_way,
            PlannerView::Idle => false,
        };
        if !stuck {
            self.stuck_since = None;
        } else if now.millis_since(*self.stuck_since.get_or_insert(now)) > STUCK_MILLIS {
            self.stuck_since = None;
            self.attempt += 1;
            // A person whose own limb has brought the hand there tries what it can do as it is.
            if self.own.is_some() {
                self.reached = true;
                self.closed_since = None;
                return Gesture::NoMotion;
            }
            if self.attempt.is_multiple_of(GIVES_UP_AFTER) {
                match self.goal {
                    Some(Goal::Place(object)) => self.choice.give_up_place(object, seen),
                    _ => self.choice.give_up(),
                }
            }
            self.habits.lean_to_reach(self.attempt, true);
        }
        Gesture::WristExtension
    }

    /// What is wanted, but a rest when the gesture that is made goes unnoticed.
    fn insist(&mut self, now: SimTime, seen: &DisplayFrame, wanted: Gesture) -> Gesture {
        if now < self.rest_until {
            return Gesture::NoMotion;
        }
        let answered = match wanted {
            Gesture::WristExtension => match seen.planner {
                PlannerView::Planning | PlannerView::Executing { .. } => true,
                PlannerView::Arrived { .. } | PlannerView::Failed { .. } => self.under_way,
                PlannerView::Idle => false,
            },
            _ => matches!(seen.hand.state, HandState::Closing | HandState::Opening),
        };
        if wanted == Gesture::NoMotion || wanted != self.habits.gesture() || answered {
            self.unnoticed_since = None;
        } else if now.millis_since(*self.unnoticed_since.get_or_insert(now)) > UNNOTICED_MILLIS {
            self.unnoticed_since = None;
            self.rest_until = now.plus_millis(REST_MILLIS);
            return Gesture::NoMotion;
        }
        wanted
    }

    /// Closes the hand on the block; opens it again and goes back when the block was missed.
    fn grip(&mut self, now: SimTime, seen: &DisplayFrame) -> Gesture {
        if seen.hand.state == HandState::Closed {
            let since = *self.closed_since.get_or_insert(now);
            if now.millis_since(since) > MISSED_MILLIS {
                self.choice.give_up();
                self.reached = false;
                self.begin_step();
                if let Some((_, limb)) = &mut self.own {
                    limb.begin();
                }
                return Gesture::HandOpen;
            }
        }
        Gesture::HandClose
    }

    /// Shifts the gaze to the far side of the block that is meant, away from the one that lights up.
    fn look_away_from(&mut self, now: SimTime, seen: &DisplayFrame, block: ObjectId) {
        let Some(wrong) = seen.target.object else { return };
        if seen.target.locked || now.millis_since(self.corrected_at) < self.habits.options.reaction_ms + 400 {
            return;
        }
        self.corrected_at = now;
        let position = |b: ObjectId| seen.objects[b.index()].translation.vector;
        let away = (position(block) - position(wrong)).try_normalize(1e-6).unwrap_or_else(Vector::x);
        self.correction = (self.correction + away * 0.015).cap_magnitude(CORRECTION_MAX);
    }

    fn looked_at(&mut self, frame: &DisplayFrame) -> Point {
        match self.goal {
            Some(goal) => self.place_of(goal, frame),
            None => Point::new(0.0, 0.0, self.table_height),
        }
    }

    fn place_of(&mut self, goal: Goal, frame: &DisplayFrame) -> Point {
        match goal {
            Goal::Pick(block) => Point::from(frame.objects[block.index()].translation.vector),
            Goal::Place(block) => self.choice.place(block, frame),
        }
    }
}

impl Participant for SelectingParticipant {
    fn step(&mut self, frame: &DisplayFrame) -> Intention {
        let now = frame.time;
        let seen = self.habits.see(frame);
        let wanted = self.decide(now, &seen);
        let wanted = self.insist(now, &seen, wanted);
        self.habits.make(now, seen.stop.is_some(), wanted);
        let looked_at = self.looked_at(frame) + self.correction;
        // While nothing is locked, the eyes select.
        let moves = matches!(frame.planner, PlannerView::Executing { .. });
        let hand =
            (moves || seen.target.locked).then(|| Point::from(frame.world_from_tip.translation.vector));
        let limb = self.own.as_ref().and_then(|(_, limb)| limb.to());
        self.habits.intend(frame, looked_at, hand, limb)
    }
}
