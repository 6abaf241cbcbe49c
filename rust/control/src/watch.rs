use crate::DeadManProfile;
use proact_types::{EventKind, Gesture, InputSource, ParticipantAnswer, SignKind, SimTime, Stop, StopCause};

/// What a source did within this time tells how it died: whether it goes on sending, ms.
const RECENT_MS: u64 = 250;
/// A tracker that never moved is a fixed mount, and may rest: it takes one pose to compare with, and one that differs.
const MOVING: u32 = 2;

/// Watches every source that drives or informs the arm, and says when the arm must stand still because one of them
/// died: silent, closed, or sending the same for ever.
///
/// What stopped the arm stands until the source is back *and* a relaxed gesture was made: a gesture held through a
/// silence must not start the arm by itself. Ages are those of the profile's [`DeadManProfile`]; without one, only
/// what is certain stops the arm: a link that was closed, and an armband of which the EMG stage says that it died.
///
/// - An armband is dead when the EMG stage says so, or when no decision came for `emg_ms`.
/// - The source that commands gestures, a page or a topic, is dead after `link_ms` without a word. A page may be
///   silent while no gesture is held; a topic may not.
/// - An eye tracker is dead when no new gaze came for `gaze_ms`, for methods that use gaze; its gaze is of no use, and stops the
///   arm of such a method at once, while an intent model in another process gives nothing.
/// - A tracked shoulder or limb that has moved is dead when it has not moved for `tracking_ms`.
/// - A participant in another program is dead from the tick in which it fails to the one in which it acts again.
/// - A method in another process is dead from the step in which it fails to the one in which it answers again.
/// - A limb tracker that the method does not use cannot die, nor can an armband whose gestures are overridden.
/// - A stage that is a process of its own is dead from the sign that it was lost to the sign that it is back.
///
/// Deterministic, and without storage that grows.
#[derive(Clone, Debug)]
pub struct SourceWatch {
    limits: Option<DeadManProfile>,
    uses: UsedSources,
    heard: [Heard; InputSource::ALL.len()],
    /// Which source commands gestures, if not the armband.
    commander: Option<InputSource>,
    /// It gave its last command itself: what a server lets go of in the name of a silent page does not relax a hand.
    spoken: bool,
    /// What the EMG stage says, and whether gestures pass it.
    armband: Option<(StopCause, String)>,
    armed: bool,
    /// Why an intent model in another process gives nothing.
    intent: Option<String>,
    /// Why a participant in another program gives nothing.
    participant: Option<String>,
    /// Why a method in another process gives nothing.
    method: Option<(StopCause, String)>,
    stop: Option<Stop>,
    /// The source that stopped the arm is alive; a relaxed gesture is missing.
    returned: bool,
}

/// The devices that a method of a trial uses. A device that it does not use never stops the arm.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct UsedSources {
    /// Gaze, and whatever infers intent from it.
    pub gaze: bool,
    /// The angles of the person's own limb.
    pub limb: bool,
}

/// When a source did what last.
#[derive(Clone, Copy, Debug, Default)]
struct Heard {
    alive: Option<SimTime>,
    commanded: Option<SimTime>,
    fresh: Option<SimTime>,
    repeated: Option<SimTime>,
    blank: Option<SimTime>,
    /// Values that differed from those before, the first included.
    moves: u32,
    closed: bool,
}

impl SourceWatch {
    /// At the start of a trial whose method uses the devices `uses`.
    pub fn new(limits: Option<DeadManProfile>, uses: UsedSources) -> Self {
        Self {
            limits,
            uses,
            heard: [Heard::default(); InputSource::ALL.len()],
            commander: None,
            spoken: true,
            armband: None,
            armed: true,
            intent: None,
            participant: None,
            method: None,
            stop: None,
            returned: false,
        }
    }

    /// `source` gave a sign at `now`.
    pub fn hear(&mut self, now: SimTime, source: InputSource, kind: SignKind) {
        let heard = &mut self.heard[source.index()];
        match kind {
            SignKind::Commands => {
                if self.commander != Some(source) {
                    // Its silence counts from here, not from before it had anything to say.
                    heard.alive = Some(now);
                    self.commander = Some(source);
                }
                heard.commanded = Some(now);
            }
            SignKind::Alive | SignKind::Points => {
                heard.alive = Some(now);
                heard.closed = false;
            }
            SignKind::Fresh => {
                // An armband that decides takes over from whoever commanded before.
                if source == InputSource::Armband {
                    self.commander = None;
                }
                heard.fresh = Some(now);
                heard.moves = heard.moves.saturating_add(1);
            }
            SignKind::Repeated => heard.repeated = Some(now),
            // A tracker that was taken away is missed by nobody.
            SignKind::Closed if source.is_tracker() => *heard = Heard::default(),
            SignKind::Closed => heard.closed = true,
        }
    }

    /// An eye tracker measured at `now` without seeing the eye.
    pub fn hear_blank(&mut self, now: SimTime) {
        self.heard[InputSource::EyeTracker.index()].blank = Some(now);
    }

    /// What the EMG stage says of its stream now: why it is dead, and whether gestures pass (`armed`).
    pub fn armband(&mut self, fault: Option<(StopCause, String)>, armed: bool) {
        self.armband = fault;
        self.armed = armed;
    }

    /// Why an intent model in another process gives nothing now; none while it answers, or if there is none.
    pub fn intent(&mut self, fault: Option<&str>) {
        if self.intent.as_deref() != fault {
            self.intent = fault.map(str::to_owned);
        }
    }

    /// News of a participant in another program: it acts again, or why it gives nothing.
    pub fn participant(&mut self, answer: &ParticipantAnswer) {
        self.participant = answer.as_ref().err().cloned();
    }

    /// Why a method in another process gives nothing now; none while it answers, or if it is no process.
    pub fn method(&mut self, fault: Option<(StopCause, String)>) {
        self.method = fault;
    }

    /// Why a part of the trial in another process gives nothing now: the method, the decoder of the EMG, the intent model, or
    /// the participant. None while all that the method uses answer.
    pub fn external_fault(&self) -> Option<&str> {
        let decoder = self.armband.as_ref().filter(|(cause, _)| *cause == StopCause::Undecided);
        let intent = self.intent.as_ref().filter(|_| self.uses.gaze);
        let method = self.method.as_ref().or(decoder).map(|(_, reason)| reason);
        method.or(intent).or(self.participant.as_ref()).map(String::as_str)
    }

    /// Decides for `now`. `gesture` is the one in force. An event if the stop began or ended, which the method must
    /// learn of at once.
    pub fn step(&mut self, now: SimTime, gesture: Gesture) -> Option<EventKind> {
        if let Some(heard) = self.commander.map(|source| self.heard[source.index()])
            && heard.commanded == Some(now)
        {
            // A connection that ended holds nothing, so nothing need be let go of.
            self.spoken = heard.alive == Some(now) || heard.closed;
        }
        match (self.dead(now, gesture), &mut self.stop) {
            // The same death, or another of the same source: the first word stands.
            (Some((source, ..)), Some(stop)) if stop.source == source && !self.returned => None,
            (Some((source, cause, what)), _) => Some(self.begin(now, source, cause, what)),
            (None, None) if self.armed => None,
            // The stream was stale and back within one tick.
            (None, None) => {
                let silent = "the armband was silent for a moment".to_owned();
                Some(self.begin(now, InputSource::Armband, StopCause::Silent, silent))
            }
            (None, Some(_)) if self.armed && self.spoken && gesture == Gesture::NoMotion => {
                self.stop = None;
                Some(EventKind::Rearmed)
            }
            (None, Some(stop)) => {
                if !self.returned {
                    stop.reason.push_str("; it is back: relax the hand to go on");
                    self.returned = true;
                }
                None
            }
        }
    }

    /// Why the arm must stand still; none while it need not.
    pub fn stop(&self) -> Option<&Stop> {
        self.stop.as_ref()
    }

    fn begin(&mut self, now: SimTime, source: InputSource, cause: StopCause, what: String) -> EventKind {
        self.returned = false;
        self.stop = Some(Stop { source, cause, since: now, reason: what.clone() });
        EventKind::Stopped { source, cause, reason: what }
    }

    /// The first source that is dead, how it died, and that as a sentence.
    fn dead(&self, now: SimTime, gesture: Gesture) -> Option<(InputSource, StopCause, String)> {
        InputSource::ALL.into_iter().find_map(|source| {
            let (cause, what) = match source {
                InputSource::Armband => self.dead_armband(now),
                InputSource::GestureTopic | InputSource::Page => {
                    let cause = self.dead_link(now, source, gesture)?;
                    let how = if cause == StopCause::Closed { "was closed" } else { "is silent" };
                    Some((cause, format!("the {source} {how}")))
                }
                InputSource::EyeTracker => self.dead_eye_tracker(now),
                InputSource::ShoulderTracker | InputSource::LimbTracker => {
                    let limit = self.limits?.tracking_ms;
                    let moved = self.heard[source.index()].moves >= MOVING;
                    let used = source != InputSource::LimbTracker || self.uses.limb;
                    self.dead_measurement(now, source, limit).filter(|_| moved && used)
                }
                InputSource::Stage => {
                    let lost = self.heard[source.index()].closed;
                    lost.then(|| (StopCause::Lost, "a stage of the testbed was lost".to_owned()))
                }
                InputSource::Participant => {
                    self.participant.clone().map(|reason| (StopCause::Undecided, reason))
                }
                InputSource::Method => self.method.clone(),
            }?;
            Some((source, cause, what))
        })
    }

    fn dead_armband(&self, now: SimTime) -> Option<(StopCause, String)> {
        let silent = || {
            let limit = self.limits?.emg_ms;
            let last = self.heard[InputSource::Armband.index()].fresh?;
            (now.millis_since(last) > limit).then(|| (StopCause::Silent, "the armband is silent".to_owned()))
        };
        self.armband.clone().or_else(silent)
    }

    fn dead_link(&self, now: SimTime, source: InputSource, gesture: Gesture) -> Option<StopCause> {
        if self.commander != Some(source) {
            return None;
        }
        let heard = &self.heard[source.index()];
        if heard.closed {
            return Some(StopCause::Closed);
        }
        let (limit, alive) = (self.limits?.link_ms, heard.alive?);
        // Once silent it is dead until it says something, whatever became of the gesture.
        let stopped = self.stop.as_ref().is_some_and(|stop| stop.source == source && !self.returned);
        let speaks = source == InputSource::GestureTopic || gesture != Gesture::NoMotion || stopped;
        (speaks && now.millis_since(alive) > limit).then_some(StopCause::Silent)
    }

    fn dead_eye_tracker(&self, now: SimTime) -> Option<(StopCause, String)> {
        if let Some(reason) = self.intent.as_ref().filter(|_| self.uses.gaze) {
            return Some((StopCause::Undecided, reason.clone()));
        }
        let limit = self.limits?.gaze_ms;
        let source = InputSource::EyeTracker;
        let (cause, what) = self.dead_measurement(now, source, limit).filter(|_| self.uses.gaze)?;
        let blank = self.heard[source.index()].blank;
        if cause == StopCause::Silent && blank.is_some_and(|at| now.millis_since(at) <= RECENT_MS) {
            return Some((StopCause::Lost, "the eye tracker has lost the eye".to_owned()));
        }
        Some((cause, what))
    }

    /// Nothing new came from a tracker for longer than `limit`.
    fn dead_measurement(&self, now: SimTime, source: InputSource, limit: u64) -> Option<(StopCause, String)> {
        let heard = &self.heard[source.index()];
        if now.millis_since(heard.fresh?) <= limit {
            return None;
        }
        // What the banner says first: the person looks for the cameras, not for a cable.
        let lost = if source == InputSource::ShoulderTracker { "tracking lost: " } else { "" };
        // One that repeated itself once and then brought something new again has not frozen.
        let repeats = heard.repeated.is_some_and(|at| {
            heard.fresh.is_none_or(|fresh| at > fresh) && now.millis_since(at) <= RECENT_MS
        });
        Some(match repeats {
            true => (StopCause::Frozen, format!("{lost}the {source} sends the same again and again")),
            false => (StopCause::Silent, format!("{lost}the {source} is silent")),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use Gesture::{NoMotion, WristExtension};
    use InputSource::{Armband, EyeTracker, GestureTopic, LimbTracker, Page, ShoulderTracker, Stage};
    use SignKind::{Alive, Closed, Commands, Fresh, Repeated};

    const LIMITS: DeadManProfile =
        DeadManProfile { emg_ms: 300, link_ms: 200, gaze_ms: 1000, tracking_ms: 200 };

    const ALL: UsedSources = UsedSources { gaze: true, limb: true };
    const NONE: UsedSources = UsedSources { gaze: false, limb: false };

    fn watch() -> SourceWatch {
        SourceWatch::new(Some(LIMITS), ALL)
    }

    /// Steps from the tick after `from` to `to`; every event with its tick.
    fn run(watch: &mut SourceWatch, from: u64, to: u64, gesture: Gesture) -> Vec<(u64, EventKind)> {
        (from + 1..=to).filter_map(|t| Some((t, watch.step(SimTime(t), gesture)?))).collect()
    }

    fn stopped(events: &[(u64, EventKind)]) -> Vec<(u64, InputSource, StopCause)> {
        let stop = |(t, event): &(u64, EventKind)| match event {
            EventKind::Stopped { source, cause, .. } => Some((*t, *source, *cause)),
            _ => None,
        };
        events.iter().filter_map(stop).collect()
    }

    #[test]
    fn a_page_that_holds_a_gesture_and_falls_silent_stops_the_arm_until_it_is_back_and_relaxed() {
        let mut watch = watch();
        for kind in [Commands, Alive] {
            watch.hear(SimTime(10), Page, kind);
        }
        let events = run(&mut watch, 10, 1000, WristExtension);
        assert_eq!(stopped(&events), [(211, Page, StopCause::Silent)]);
        // What the server lets go of in its name is no word of the page.
        watch.hear(SimTime(1001), Page, Commands);
        assert_eq!(run(&mut watch, 1000, 1500, NoMotion), []);
        watch.hear(SimTime(1500), Page, Alive);
        assert_eq!(run(&mut watch, 1500, 1501, WristExtension), []);
        let reason = watch.stop().map(|stop| stop.reason.clone());
        assert_eq!(reason.as_deref(), Some("the page is silent; it is back: relax the hand to go on"));
        assert_eq!(run(&mut watch, 1501, 1510, NoMotion), [], "it has not said so");
        for kind in [Commands, Alive] {
            watch.hear(SimTime(1511), Page, kind);
        }
        assert_eq!(run(&mut watch, 1510, 1511, NoMotion), [(1511, EventKind::Rearmed)]);
        assert_eq!(watch.stop(), None);
    }

    #[test]
    fn a_page_may_be_silent_while_nothing_is_held_and_a_topic_may_not() {
        let mut watch = watch();
        watch.hear(SimTime(0), Page, Commands);
        assert_eq!(run(&mut watch, 0, 5000, NoMotion), []);
        watch.hear(SimTime(5000), GestureTopic, Commands);
        let events = run(&mut watch, 5000, 6000, NoMotion);
        assert_eq!(stopped(&events), [(5201, GestureTopic, StopCause::Silent)]);
    }

    #[test]
    fn a_link_that_is_closed_stops_the_arm_at_once_with_and_without_limits() {
        for mut watch in [watch(), SourceWatch::new(None, ALL)] {
            watch.hear(SimTime(1), Page, Commands);
            watch.hear(SimTime(5), Page, Closed);
            assert_eq!(stopped(&run(&mut watch, 4, 10, WristExtension)), [(5, Page, StopCause::Closed)]);
        }
        let mut other = watch();
        other.hear(SimTime(1), GestureTopic, Commands);
        other.hear(SimTime(5), Page, Closed);
        assert_eq!(run(&mut other, 4, 10, WristExtension), [], "it commands nothing");
        // A new connection holds nothing.
        let mut again = watch();
        for (tick, kind) in [(1, Commands), (5, Commands), (5, Closed)] {
            again.hear(SimTime(tick), Page, kind);
        }
        assert_eq!(stopped(&run(&mut again, 4, 10, NoMotion)), [(5, Page, StopCause::Closed)]);
        again.hear(SimTime(11), Page, Alive);
        assert_eq!(run(&mut again, 10, 11, NoMotion), [(11, EventKind::Rearmed)]);
    }

    #[test]
    fn an_eye_tracker_that_repeats_a_ray_is_frozen_after_a_second_and_a_blink_is_not() {
        let mut watch = watch();
        watch.hear(SimTime(0), EyeTracker, Fresh);
        let mut events = Vec::new();
        for t in 0..2000 {
            if t % 16 == 0 {
                watch.hear(SimTime(t), EyeTracker, Repeated);
            }
            events.extend(run(&mut watch, t, t + 1, WristExtension));
        }
        assert_eq!(stopped(&events), [(1001, EyeTracker, StopCause::Frozen)]);

        let mut blinks = self::watch();
        blinks.hear(SimTime(0), EyeTracker, Fresh);
        blinks.hear_blank(SimTime(900));
        assert_eq!(run(&mut blinks, 0, 1000, WristExtension), []);
        let events = run(&mut blinks, 1000, 1002, WristExtension);
        assert_eq!(stopped(&events), [(1001, EyeTracker, StopCause::Lost)]);

        let mut unused = SourceWatch::new(Some(LIMITS), NONE);
        unused.hear(SimTime(0), EyeTracker, Fresh);
        assert_eq!(run(&mut unused, 0, 3000, WristExtension), []);
    }

    #[test]
    fn a_tracker_that_never_moved_may_rest_and_one_that_did_may_not() {
        for source in [ShoulderTracker, LimbTracker] {
            let mut watch = watch();
            watch.hear(SimTime(0), source, Fresh);
            assert_eq!(run(&mut watch, 0, 3000, WristExtension), [], "a fixed mount");
            watch.hear(SimTime(3000), source, Fresh);
            watch.hear(SimTime(3190), source, Repeated);
            let events = run(&mut watch, 3000, 4000, WristExtension);
            assert_eq!(stopped(&events), [(3201, source, StopCause::Frozen)]);
            watch.hear(SimTime(4000), source, Fresh);
            assert_eq!(run(&mut watch, 4000, 4001, WristExtension), [], "not before the hand is relaxed");
            assert_eq!(run(&mut watch, 4001, 4002, NoMotion), [(4002, EventKind::Rearmed)]);
            let events = run(&mut watch, 4002, 5000, NoMotion);
            assert_eq!(stopped(&events), [(4201, source, StopCause::Silent)]);
        }
    }

    #[test]
    fn what_the_emg_stage_says_stops_the_arm_and_a_hand_that_it_holds_back_is_not_relaxed() {
        let mut watch = SourceWatch::new(None, NONE);
        watch.armband(Some((StopCause::Frozen, "the armband repeats its samples".to_owned())), false);
        let events = run(&mut watch, 0, 10, NoMotion);
        assert_eq!(stopped(&events), [(1, Armband, StopCause::Frozen)]);
        watch.armband(None, false);
        assert_eq!(run(&mut watch, 10, 20, NoMotion), []);
        watch.armband(None, true);
        assert_eq!(run(&mut watch, 20, 30, NoMotion), [(21, EventKind::Rearmed)]);
        watch.armband(None, false);
        let events = run(&mut watch, 30, 40, NoMotion);
        assert_eq!(stopped(&events), [(31, Armband, StopCause::Silent)], "stale and back within one tick");
    }

    #[test]
    fn of_two_deaths_the_first_is_named_and_then_the_other() {
        let mut watch = watch();
        watch.hear(SimTime(0), EyeTracker, Fresh);
        watch.hear(SimTime(0), Page, Commands);
        let events = run(&mut watch, 0, 1500, WristExtension);
        assert_eq!(stopped(&events), [(201, Page, StopCause::Silent)]);
        watch.hear(SimTime(1500), Page, Alive);
        let events = run(&mut watch, 1500, 1501, NoMotion);
        assert_eq!(stopped(&events), [(1501, EyeTracker, StopCause::Silent)]);
    }

    #[test]
    fn a_stage_that_was_lost_stops_the_arm_until_it_is_back_and_the_hand_relaxed() {
        let mut watch = watch();
        let mut at = |ms: u64, kind: Option<SignKind>, gesture| {
            if let Some(kind) = kind {
                watch.hear(SimTime(ms), Stage, kind);
            }
            watch.step(SimTime(ms), gesture);
            watch.stop().map(|stop| (stop.source, stop.cause))
        };
        assert_eq!(at(1, None, WristExtension), None);
        assert_eq!(at(2, Some(Closed), WristExtension), Some((Stage, StopCause::Lost)));
        assert!(at(500, None, NoMotion).is_some(), "a relaxed hand does not bring the stage back");
        assert!(at(501, Some(Alive), WristExtension).is_some());
        assert_eq!(at(502, None, NoMotion), None);
    }

    #[test]
    fn a_tracker_that_was_taken_away_is_forgotten() {
        let mut watch = watch();
        for ms in [1, 11, 21] {
            watch.hear(SimTime(ms), ShoulderTracker, Fresh);
        }
        watch.hear(SimTime(30), ShoulderTracker, Closed);
        assert_eq!(watch.step(SimTime(900), WristExtension), None);
    }
}
