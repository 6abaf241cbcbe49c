use crate::DeadManProfile;
use proact_types::{
    Command, EventKind, HeartbeatKind, InputSource, ParticipantAnswer, SimTime, Stop, StopCause,
};

/// What a source did within this time tells how it died: whether it goes on sending, ms.
const RECENT_ACTIVITY_MS: u64 = 250;
/// A tracker that never moved is a fixed mount, and may rest: it takes one pose to compare with, and one that differs.
const MIN_CHANGES_WHEN_MOVING: u32 = 2;

/// Watches every source that drives or informs the arm, and says when the arm must stand still because one of them
/// died: silent, closed, or sending the same for ever.
///
/// What stopped the arm stands until the source is back *and* a relaxed gesture was made: a gesture held through a
/// silence must not start the arm by itself. Ages are those of the profile's [`DeadManProfile`]; without one, only
/// what is certain stops the arm: a link that was closed, and an armband of which the EMG stage says that it died.
///
/// - An armband is dead when the EMG stage says so, or when no decision came for `emg_timeout_ms`.
/// - The source that commands gestures, a page or a topic, is dead after `command_timeout_ms` without a word or when its server let a gesture go for its
///   silence, and while what it says is older
///   than `max_delay_ms`. A page may be silent while no gesture is held; a topic may not. Gaze is no word.
/// - An eye tracker is dead when no new gaze came for `gaze_timeout_ms`, for methods that use gaze; its gaze is of no use, and stops the
///   arm of such a method at once, while an intent model in another process gives nothing.
/// - A tracked shoulder or limb that has moved is dead when it has not moved for `tracking_timeout_ms`.
/// - A participant in another program is dead from the tick in which it fails to the one in which it acts again.
/// - A method in another process is dead from the step in which it fails to the one in which it answers again.
/// - A limb tracker that the method does not use cannot die, nor can an armband whose gestures are overridden.
/// - A stage that is a process of its own is dead while [`SourceWatchdog::stages`] has a reason.
///
/// Deterministic, and without storage that grows.
#[derive(Clone, Debug)]
pub struct SourceWatchdog {
    limits: Option<DeadManProfile>,
    used_sources: UsedSources,
    last_heartbeats: [LastHeartbeats; InputSource::ALL.len()],
    /// Which source commands gestures, if not the armband.
    command_source: Option<InputSource>,
    /// It gave its last command itself: what a server lets go of in the name of a silent page does not relax a hand.
    source_gave_last_command: bool,
    /// What the EMG stage says, and whether gestures pass it.
    armband_fault: Option<(StopCause, String)>,
    commands_armed: bool,
    /// Why an intent model in another process gives nothing.
    intent_fault: Option<String>,
    /// Why a participant in another program gives nothing.
    participant_fault: Option<String>,
    /// Why a method in another process gives nothing.
    method_fault: Option<(StopCause, String)>,
    /// Why a stage that is a process of its own gives nothing.
    stage_fault: Option<(StopCause, String)>,
    stop: Option<Stop>,
    /// The source that stopped the arm is alive; a relaxed gesture is missing.
    is_source_back: bool,
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
struct LastHeartbeats {
    alive_at: Option<SimTime>,
    commanded_at: Option<SimTime>,
    changed_at: Option<SimTime>,
    repeated_at: Option<SimTime>,
    eye_lost_at: Option<SimTime>,
    /// Values that differed from those before, the first included.
    change_count: u32,
    closed: bool,
    /// What it said last was too old.
    delayed: bool,
    /// A gesture was let go for its silence, which lasts.
    released_for_silence: bool,
}

impl SourceWatchdog {
    /// At the start of a trial whose method uses the devices `uses`.
    pub fn new(limits: Option<DeadManProfile>, uses: UsedSources) -> Self {
        Self {
            limits,
            used_sources: uses,
            last_heartbeats: [LastHeartbeats::default(); InputSource::ALL.len()],
            command_source: None,
            source_gave_last_command: true,
            armband_fault: None,
            commands_armed: true,
            intent_fault: None,
            participant_fault: None,
            method_fault: None,
            stage_fault: None,
            stop: None,
            is_source_back: false,
        }
    }

    /// Ages over which input stops the arm; none: no such limits.
    pub fn limits(&self) -> Option<DeadManProfile> {
        self.limits
    }

    /// `source` gave a sign at `now`.
    pub fn record_heartbeat(&mut self, now: SimTime, source: InputSource, kind: HeartbeatKind) {
        let heartbeat = &mut self.last_heartbeats[source.index()];
        match kind {
            HeartbeatKind::Command => {
                if self.command_source != Some(source) {
                    // Its silence counts from here, not from before it had anything to say.
                    heartbeat.alive_at = Some(now);
                    self.command_source = Some(source);
                }
                heartbeat.commanded_at = Some(now);
            }
            HeartbeatKind::Alive | HeartbeatKind::Delayed => {
                heartbeat.alive_at = Some(now);
                heartbeat.closed = false;
                heartbeat.released_for_silence = false;
                heartbeat.delayed = kind == HeartbeatKind::Delayed;
            }
            HeartbeatKind::Silent => heartbeat.released_for_silence = true,
            // Gaze keeps no gesture alive.
            HeartbeatKind::PointingDevice => {}
            HeartbeatKind::Fresh => {
                // An armband that decides takes over from whoever commanded before.
                if source == InputSource::Armband {
                    self.command_source = None;
                }
                heartbeat.changed_at = Some(now);
                heartbeat.change_count = heartbeat.change_count.saturating_add(1);
            }
            HeartbeatKind::Repeated => heartbeat.repeated_at = Some(now),
            // A tracker that was taken away is missed by nobody.
            HeartbeatKind::Closed if source.is_tracker() => *heartbeat = LastHeartbeats::default(),
            HeartbeatKind::Closed => heartbeat.closed = true,
        }
    }

    /// Gestures are given directly from now on: the armband is not used, and nobody misses it until it decides again.
    pub fn ignore_armband(&mut self) {
        self.last_heartbeats[InputSource::Armband.index()] = LastHeartbeats::default();
    }

    /// An eye tracker measured at `now` without seeing the eye.
    pub fn record_eye_lost(&mut self, now: SimTime) {
        self.last_heartbeats[InputSource::EyeTracker.index()].eye_lost_at = Some(now);
    }

    /// What the EMG stage says of its stream now: why it is dead, and whether gestures pass (`armed`).
    pub fn set_armband_state(&mut self, fault: Option<(StopCause, String)>, armed: bool) {
        self.armband_fault = fault;
        self.commands_armed = armed;
    }

    /// Why an intent model in another process gives nothing now; none while it answers, or if there is none.
    pub fn set_intent_fault(&mut self, fault: Option<&str>) {
        if self.intent_fault.as_deref() != fault {
            self.intent_fault = fault.map(str::to_owned);
        }
    }

    /// News of a participant in another program: it acts again, or why it gives nothing.
    pub fn set_participant_fault(&mut self, answer: &ParticipantAnswer) {
        self.participant_fault = answer.as_ref().err().cloned();
    }

    /// Why a method in another process gives nothing now; none while it answers, or if it is no process.
    pub fn set_method_fault(&mut self, fault: Option<(StopCause, String)>) {
        self.method_fault = fault;
    }

    /// Why a stage that is a process of its own gives nothing now; none while all speak.
    pub fn set_stage_fault(&mut self, fault: Option<(StopCause, String)>) {
        self.stage_fault = fault;
    }

    /// Why a part of the trial in another process gives nothing now: the method, the decoder of the EMG, the intent model, or
    /// the participant. None while all that the method uses answer.
    pub fn external_fault(&self) -> Option<&str> {
        let decoder = self.armband_fault.as_ref().filter(|(cause, _)| *cause == StopCause::UnusableOutput);
        let intent = self.intent_fault.as_ref().filter(|_| self.used_sources.gaze);
        let method = self.method_fault.as_ref().or(decoder).map(|(_, reason)| reason);
        method.or(intent).or(self.participant_fault.as_ref()).map(String::as_str)
    }

    /// Decides for `now`. `command` is the one in force. An event if the stop began or ended, which the method must
    /// learn of at once.
    pub fn step(&mut self, now: SimTime, command: Command) -> Option<EventKind> {
        if let Some(heartbeat) = self.command_source.map(|source| self.last_heartbeats[source.index()])
            && heartbeat.commanded_at == Some(now)
        {
            // A connection that ended holds nothing, so nothing need be let go of.
            self.source_gave_last_command = heartbeat.alive_at == Some(now) || heartbeat.closed;
        }
        match (self.first_dead_source(now, command), &mut self.stop) {
            // The same death, or another of the same source: the first word stands.
            (Some((source, ..)), Some(stop)) if stop.source == source && !self.is_source_back => None,
            (Some((source, cause, what)), _) => Some(self.begin_stop(now, source, cause, what)),
            (None, None) if self.commands_armed => None,
            // The stream was stale and back within one tick.
            (None, None) => {
                let silent = "the armband was silent for a moment".to_owned();
                Some(self.begin_stop(now, InputSource::Armband, StopCause::Silent, silent))
            }
            (None, Some(_))
                if self.commands_armed && self.source_gave_last_command && command == Command::NoMotion =>
            {
                self.stop = None;
                Some(EventKind::Rearmed)
            }
            (None, Some(stop)) => {
                if !self.is_source_back {
                    stop.reason.push_str("; it is back: relax the hand to go on");
                    self.is_source_back = true;
                }
                None
            }
        }
    }

    /// Why the arm must stand still; none while it need not.
    pub fn stop(&self) -> Option<&Stop> {
        self.stop.as_ref()
    }

    fn begin_stop(&mut self, now: SimTime, source: InputSource, cause: StopCause, what: String) -> EventKind {
        self.is_source_back = false;
        self.stop = Some(Stop { source, cause, since: now, reason: what.clone() });
        EventKind::Stopped { source, cause, reason: what }
    }

    /// The first source that is dead, how it died, and that as a sentence.
    fn first_dead_source(&self, now: SimTime, command: Command) -> Option<(InputSource, StopCause, String)> {
        InputSource::ALL.into_iter().find_map(|source| {
            let (cause, what) = match source {
                InputSource::Armband => self.armband_stop_cause(now),
                InputSource::GestureTopic | InputSource::Page => {
                    let cause = self.command_link_stop_cause(now, source, command)?;
                    let delay = self.limits.map_or(0, |limits| limits.max_delay_ms);
                    Some(match cause {
                        StopCause::Closed => (cause, format!("the {source} was closed")),
                        StopCause::Delayed => (
                            cause,
                            format!("the connection of the {source} is delayed by more than {delay} ms"),
                        ),
                        _ => (cause, format!("the {source} is silent")),
                    })
                }
                InputSource::EyeTracker => self.eye_tracker_stop_cause(now),
                InputSource::ShoulderTracker | InputSource::LimbTracker => {
                    let limit = self.limits?.tracking_timeout_ms;
                    let moved = self.last_heartbeats[source.index()].change_count >= MIN_CHANGES_WHEN_MOVING;
                    let used = source != InputSource::LimbTracker || self.used_sources.limb;
                    self.measurement_stop_cause(now, source, limit).filter(|_| moved && used)
                }
                InputSource::Stage => self.stage_fault.clone(),
                InputSource::Participant => {
                    self.participant_fault.clone().map(|reason| (StopCause::UnusableOutput, reason))
                }
                InputSource::Method => self.method_fault.clone(),
            }?;
            Some((source, cause, what))
        })
    }

    fn armband_stop_cause(&self, now: SimTime) -> Option<(StopCause, String)> {
        let silent = || {
            let limit = self.limits?.emg_timeout_ms;
            let last = self.last_heartbeats[InputSource::Armband.index()].changed_at?;
            (now.millis_since(last) > limit).then(|| (StopCause::Silent, "the armband is silent".to_owned()))
        };
        self.armband_fault.clone().or_else(silent)
    }

    fn command_link_stop_cause(
        &self,
        now: SimTime,
        source: InputSource,
        command: Command,
    ) -> Option<StopCause> {
        if self.command_source != Some(source) {
            return None;
        }
        let heartbeat = &self.last_heartbeats[source.index()];
        if heartbeat.closed {
            return Some(StopCause::Closed);
        }
        // What has already happened to its gesture has a reason, whatever the limits are.
        if heartbeat.released_for_silence {
            return Some(StopCause::Silent);
        }
        let (limit, alive) = (self.limits?.command_timeout_ms, heartbeat.alive_at?);
        // Once silent it is dead until it says something, whatever became of the gesture.
        let stopped = self.stop.as_ref().is_some_and(|stop| stop.source == source && !self.is_source_back);
        let speaks = source == InputSource::GestureTopic || command != Command::NoMotion || stopped;
        if speaks && heartbeat.delayed {
            return Some(StopCause::Delayed);
        }
        (speaks && now.millis_since(alive) > limit).then_some(StopCause::Silent)
    }

    fn eye_tracker_stop_cause(&self, now: SimTime) -> Option<(StopCause, String)> {
        if let Some(reason) = self.intent_fault.as_ref().filter(|_| self.used_sources.gaze) {
            return Some((StopCause::UnusableOutput, reason.clone()));
        }
        let limit = self.limits?.gaze_timeout_ms;
        let source = InputSource::EyeTracker;
        let (cause, what) =
            self.measurement_stop_cause(now, source, limit).filter(|_| self.used_sources.gaze)?;
        let blank = self.last_heartbeats[source.index()].eye_lost_at;
        if cause == StopCause::Silent && blank.is_some_and(|at| now.millis_since(at) <= RECENT_ACTIVITY_MS) {
            return Some((StopCause::TrackingLost, "the eye tracker has lost the eye".to_owned()));
        }
        Some((cause, what))
    }

    /// Nothing new came from a tracker for longer than `limit`.
    fn measurement_stop_cause(
        &self,
        now: SimTime,
        source: InputSource,
        limit: u64,
    ) -> Option<(StopCause, String)> {
        let heartbeat = &self.last_heartbeats[source.index()];
        if now.millis_since(heartbeat.changed_at?) <= limit {
            return None;
        }
        // What the banner says first: the person looks for the cameras, not for a cable.
        let lost = if source == InputSource::ShoulderTracker { "tracking lost: " } else { "" };
        // One that repeated itself once and then brought something new again has not frozen.
        let repeats = heartbeat.repeated_at.is_some_and(|at| {
            heartbeat.changed_at.is_none_or(|fresh| at > fresh) && now.millis_since(at) <= RECENT_ACTIVITY_MS
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
    use Command::{NoMotion, WristExtension};
    use HeartbeatKind::{
        Alive, Closed, Command as CommandHeartbeat, Delayed, Fresh, PointingDevice, Repeated, Silent,
    };
    use InputSource::{Armband, EyeTracker, GestureTopic, LimbTracker, Page, ShoulderTracker, Stage};

    const LIMITS: DeadManProfile = DeadManProfile {
        emg_timeout_ms: 300,
        command_timeout_ms: 200,
        max_delay_ms: 250,
        gaze_timeout_ms: 1000,
        tracking_timeout_ms: 200,
    };

    const ALL: UsedSources = UsedSources { gaze: true, limb: true };
    const NONE: UsedSources = UsedSources { gaze: false, limb: false };

    fn watch() -> SourceWatchdog {
        SourceWatchdog::new(Some(LIMITS), ALL)
    }

    /// Steps from the tick after `from` to `to`; every event with its tick.
    fn run(watch: &mut SourceWatchdog, from: u64, to: u64, command: Command) -> Vec<(u64, EventKind)> {
        (from + 1..=to).filter_map(|t| Some((t, watch.step(SimTime(t), command)?))).collect()
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
        for kind in [CommandHeartbeat, Alive] {
            watch.record_heartbeat(SimTime(10), Page, kind);
        }
        let events = run(&mut watch, 10, 1000, WristExtension);
        assert_eq!(stopped(&events), [(211, Page, StopCause::Silent)]);
        // What the server lets go of in its name is no word of the page.
        watch.record_heartbeat(SimTime(1001), Page, CommandHeartbeat);
        assert_eq!(run(&mut watch, 1000, 1500, NoMotion), []);
        watch.record_heartbeat(SimTime(1500), Page, Alive);
        assert_eq!(run(&mut watch, 1500, 1501, WristExtension), []);
        let reason = watch.stop().map(|stop| stop.reason.clone());
        assert_eq!(reason.as_deref(), Some("the page is silent; it is back: relax the hand to go on"));
        assert_eq!(run(&mut watch, 1501, 1510, NoMotion), [], "it has not said so");
        for kind in [CommandHeartbeat, Alive] {
            watch.record_heartbeat(SimTime(1511), Page, kind);
        }
        assert_eq!(run(&mut watch, 1510, 1511, NoMotion), [(1511, EventKind::Rearmed)]);
        assert_eq!(watch.stop(), None);
    }

    /// With a longer limit, or none, the arm stopped without a reason when the server let go of a silent page's gesture.
    #[test]
    fn a_gesture_that_was_let_go_for_silence_stops_the_arm_with_that_reason_with_and_without_limits() {
        let long = DeadManProfile { command_timeout_ms: 60_000, max_delay_ms: 60_000, ..LIMITS };
        for limits in [None, Some(long)] {
            let mut watch = SourceWatchdog::new(limits, ALL);
            for kind in [CommandHeartbeat, Alive] {
                watch.record_heartbeat(SimTime(10), Page, kind);
            }
            assert_eq!(run(&mut watch, 9, 510, WristExtension), []);
            for kind in [CommandHeartbeat, Silent] {
                watch.record_heartbeat(SimTime(511), Page, kind);
            }
            let events = run(&mut watch, 510, 900, NoMotion);
            assert_eq!(stopped(&events), [(511, Page, StopCause::Silent)]);
            assert_eq!(watch.stop().map(|stop| stop.reason.as_str()), Some("the page is silent"));
            watch.record_heartbeat(SimTime(901), Page, Alive);
            assert_eq!(run(&mut watch, 900, 910, NoMotion), [], "it has not let go itself");
            for kind in [CommandHeartbeat, Alive] {
                watch.record_heartbeat(SimTime(911), Page, kind);
            }
            assert_eq!(run(&mut watch, 910, 911, NoMotion), [(911, EventKind::Rearmed)]);
        }
    }

    /// A mouse that moved kept a gesture in force whose key nobody vouched for.
    #[test]
    fn gaze_keeps_no_gesture_alive() {
        let mut watch = watch();
        for kind in [CommandHeartbeat, Alive] {
            watch.record_heartbeat(SimTime(10), Page, kind);
        }
        let gazes = (11..=1000).flat_map(|t| {
            watch.record_heartbeat(SimTime(t), Page, PointingDevice);
            Some((t, watch.step(SimTime(t), WristExtension)?))
        });
        assert_eq!(stopped(&gazes.collect::<Vec<_>>()), [(211, Page, StopCause::Silent)]);
    }

    /// Over a line with a constant delay the arm moved as if there were none.
    #[test]
    fn a_page_whose_line_is_delayed_moves_nothing_until_it_is_not_and_the_hand_relaxed() {
        let mut watch = watch();
        for kind in [CommandHeartbeat, Delayed] {
            watch.record_heartbeat(SimTime(10), Page, kind);
        }
        assert_eq!(stopped(&run(&mut watch, 9, 12, WristExtension)), [(10, Page, StopCause::Delayed)]);
        let reason = watch.stop().map(|stop| stop.reason.clone());
        assert_eq!(reason.as_deref(), Some("the connection of the page is delayed by more than 250 ms"));
        for kind in [CommandHeartbeat, Delayed] {
            watch.record_heartbeat(SimTime(20), Page, kind);
        }
        assert_eq!(run(&mut watch, 12, 900, NoMotion), [], "the key is up, and the line as slow");
        watch.record_heartbeat(SimTime(901), Page, Alive);
        assert_eq!(run(&mut watch, 900, 901, NoMotion), [(901, EventKind::Rearmed)]);
        // In the middle of a movement.
        for kind in [CommandHeartbeat, Alive] {
            watch.record_heartbeat(SimTime(1000), Page, kind);
        }
        assert_eq!(run(&mut watch, 999, 1010, WristExtension), []);
        watch.record_heartbeat(SimTime(1011), Page, Delayed);
        let events = run(&mut watch, 1010, 1020, WristExtension);
        assert_eq!(stopped(&events), [(1011, Page, StopCause::Delayed)]);
        watch.record_heartbeat(SimTime(1021), Page, Alive);
        assert_eq!(run(&mut watch, 1020, 1100, WristExtension), [], "the key is still down");
    }

    #[test]
    fn a_page_may_be_silent_while_nothing_is_held_and_a_topic_may_not() {
        let mut watch = watch();
        watch.record_heartbeat(SimTime(0), Page, CommandHeartbeat);
        assert_eq!(run(&mut watch, 0, 5000, NoMotion), []);
        watch.record_heartbeat(SimTime(5000), GestureTopic, CommandHeartbeat);
        let events = run(&mut watch, 5000, 6000, NoMotion);
        assert_eq!(stopped(&events), [(5201, GestureTopic, StopCause::Silent)]);
    }

    #[test]
    fn a_link_that_is_closed_stops_the_arm_at_once_with_and_without_limits() {
        for mut watch in [watch(), SourceWatchdog::new(None, ALL)] {
            watch.record_heartbeat(SimTime(1), Page, CommandHeartbeat);
            watch.record_heartbeat(SimTime(5), Page, Closed);
            assert_eq!(stopped(&run(&mut watch, 4, 10, WristExtension)), [(5, Page, StopCause::Closed)]);
        }
        let mut other = watch();
        other.record_heartbeat(SimTime(1), GestureTopic, CommandHeartbeat);
        other.record_heartbeat(SimTime(5), Page, Closed);
        assert_eq!(run(&mut other, 4, 10, WristExtension), [], "it commands nothing");
        // A new connection holds nothing.
        let mut again = watch();
        for (tick, kind) in [(1, CommandHeartbeat), (5, CommandHeartbeat), (5, Closed)] {
            again.record_heartbeat(SimTime(tick), Page, kind);
        }
        assert_eq!(stopped(&run(&mut again, 4, 10, NoMotion)), [(5, Page, StopCause::Closed)]);
        again.record_heartbeat(SimTime(11), Page, Alive);
        assert_eq!(run(&mut again, 10, 11, NoMotion), [(11, EventKind::Rearmed)]);
    }

    #[test]
    fn an_eye_tracker_that_repeats_a_ray_is_frozen_after_a_second_and_a_blink_is_not() {
        let mut watch = watch();
        watch.record_heartbeat(SimTime(0), EyeTracker, Fresh);
        let mut events = Vec::new();
        for t in 0..2000 {
            if t % 16 == 0 {
                watch.record_heartbeat(SimTime(t), EyeTracker, Repeated);
            }
            events.extend(run(&mut watch, t, t + 1, WristExtension));
        }
        assert_eq!(stopped(&events), [(1001, EyeTracker, StopCause::Frozen)]);

        let mut blinks = self::watch();
        blinks.record_heartbeat(SimTime(0), EyeTracker, Fresh);
        blinks.record_eye_lost(SimTime(900));
        assert_eq!(run(&mut blinks, 0, 1000, WristExtension), []);
        let events = run(&mut blinks, 1000, 1002, WristExtension);
        assert_eq!(stopped(&events), [(1001, EyeTracker, StopCause::TrackingLost)]);

        let mut unused = SourceWatchdog::new(Some(LIMITS), NONE);
        unused.record_heartbeat(SimTime(0), EyeTracker, Fresh);
        assert_eq!(run(&mut unused, 0, 3000, WristExtension), []);
    }

    #[test]
    fn a_tracker_that_never_moved_may_rest_and_one_that_did_may_not() {
        for source in [ShoulderTracker, LimbTracker] {
            let mut watch = watch();
            watch.record_heartbeat(SimTime(0), source, Fresh);
            assert_eq!(run(&mut watch, 0, 3000, WristExtension), [], "a fixed mount");
            watch.record_heartbeat(SimTime(3000), source, Fresh);
            watch.record_heartbeat(SimTime(3190), source, Repeated);
            let events = run(&mut watch, 3000, 4000, WristExtension);
            assert_eq!(stopped(&events), [(3201, source, StopCause::Frozen)]);
            watch.record_heartbeat(SimTime(4000), source, Fresh);
            assert_eq!(run(&mut watch, 4000, 4001, WristExtension), [], "not before the hand is relaxed");
            assert_eq!(run(&mut watch, 4001, 4002, NoMotion), [(4002, EventKind::Rearmed)]);
            let events = run(&mut watch, 4002, 5000, NoMotion);
            assert_eq!(stopped(&events), [(4201, source, StopCause::Silent)]);
        }
    }

    #[test]
    fn what_the_emg_stage_says_stops_the_arm_and_a_hand_that_it_holds_back_is_not_relaxed() {
        let mut watch = SourceWatchdog::new(None, NONE);
        watch.set_armband_state(
            Some((StopCause::Frozen, "the armband repeats its samples".to_owned())),
            false,
        );
        let events = run(&mut watch, 0, 10, NoMotion);
        assert_eq!(stopped(&events), [(1, Armband, StopCause::Frozen)]);
        watch.set_armband_state(None, false);
        assert_eq!(run(&mut watch, 10, 20, NoMotion), []);
        watch.set_armband_state(None, true);
        assert_eq!(run(&mut watch, 20, 30, NoMotion), [(21, EventKind::Rearmed)]);
        watch.set_armband_state(None, false);
        let events = run(&mut watch, 30, 40, NoMotion);
        assert_eq!(stopped(&events), [(31, Armband, StopCause::Silent)], "stale and back within one tick");
    }

    #[test]
    fn of_two_deaths_the_first_is_named_and_then_the_other() {
        let mut watch = watch();
        watch.record_heartbeat(SimTime(0), EyeTracker, Fresh);
        watch.record_heartbeat(SimTime(0), Page, CommandHeartbeat);
        let events = run(&mut watch, 0, 1500, WristExtension);
        assert_eq!(stopped(&events), [(201, Page, StopCause::Silent)]);
        watch.record_heartbeat(SimTime(1500), Page, Alive);
        let events = run(&mut watch, 1500, 1501, NoMotion);
        assert_eq!(stopped(&events), [(1501, EyeTracker, StopCause::Silent)]);
    }

    #[test]
    fn a_stage_that_was_lost_stops_the_arm_until_it_is_back_and_the_hand_relaxed() {
        let mut watch = watch();
        let mut at = |ms: u64, lost: Option<&str>, command| {
            watch.set_stage_fault(lost.map(|reason| (StopCause::TrackingLost, reason.to_owned())));
            watch.step(SimTime(ms), command);
            watch.stop().map(|stop| (stop.source, stop.cause, stop.reason.clone()))
        };
        let lost = Some("/proact_emg is silent");
        let stopped = |reason: &str| Some((Stage, StopCause::TrackingLost, reason.to_owned()));
        assert_eq!(at(1, None, WristExtension), None);
        assert_eq!(at(2, lost, WristExtension), stopped("/proact_emg is silent"));
        assert!(at(500, lost, NoMotion).is_some(), "a relaxed hand does not bring the stage back");
        let back = "/proact_emg is silent; it is back: relax the hand to go on";
        assert_eq!(at(501, None, WristExtension), stopped(back));
        assert_eq!(at(502, None, NoMotion), None);
    }

    #[test]
    fn a_tracker_that_was_taken_away_is_forgotten() {
        let mut watch = watch();
        for ms in [1, 11, 21] {
            watch.record_heartbeat(SimTime(ms), ShoulderTracker, Fresh);
        }
        watch.record_heartbeat(SimTime(30), ShoulderTracker, Closed);
        assert_eq!(watch.step(SimTime(900), WristExtension), None);
    }
}
