//! Who is in control, and the inputs that wait for the testbed.
//!
//! One client at a time drives: the first that joins or sends anything, until its connection ends or another says that
//! it takes over. The others watch. A stop is taken from everybody. Pure: the time is handed in.

use crate::{
    input::{ClientInput, StudyAction},
    round_trip::RoundTripMonitor,
};
use proact_types::Command;
use std::{
    collections::BTreeMap,
    time::{Duration, Instant},
};

/// A client that holds a gesture and is silent for longer is taken to be gone: its gesture is released. The page sends
/// a sign of life every 40 ms. It does not bring the gesture back: that takes a new press, or a line that falters would
/// toggle the lock. The testbed, which is told of each sign, stops the arm much sooner.
pub(crate) const HEARTBEAT_TIMEOUT: Duration = Duration::from_millis(500);

/// Longest name of a page, characters.
const MAX_NAME_CHARS: usize = 40;

/// Most inputs kept for a testbed that does not drain them: 8 s of gaze at 60 Hz with gestures between.
const MAX_QUEUED_INPUTS: usize = 512;

/// Number of a connection, never used twice.
pub(crate) type ClientId = u64;

/// What was heard of the page in control.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PageHeartbeat {
    /// It is there.
    Alive,
    /// Its line is delayed by more than the limit: what it says is too old to move the arm.
    Delayed,
    /// It said nothing for so long that the gesture that it held was let go.
    Silent,
}

#[derive(Debug)]
struct DrivingClient {
    client: ClientId,
    last_heartbeat: Instant,
}

/// The client in control and the queue of its inputs.
#[derive(Debug, Default)]
pub(crate) struct InputArbiter {
    driver: Option<DrivingClient>,
    /// Grows whenever another client drives, or the one that drives has another name.
    driver_revision: u64,
    /// What the clients are called.
    names: BTreeMap<ClientId, String>,
    /// The gesture in force, if it is one that moves anything.
    held_gesture: Option<Command>,
    /// Who drives holds the trial's time: it is released with the wheel.
    holds_trial_time: bool,
    /// A gesture was released because the client in control fell silent.
    released_by_timeout: bool,
    /// The client in control began to drive, changed its gesture or said that it still holds it, since that was asked for last.
    /// Gaze does not count: it comes from another hand than the gesture, and from a page that is stuck.
    heartbeat_pending: bool,
    /// A gesture was let go for its silence since that was asked for last.
    timeout_pending: bool,
    /// The lines of the clients.
    round_trips: BTreeMap<ClientId, RoundTripMonitor>,
    /// A line with a longer delay is not driven by; none before a trial says so.
    delay_limit: Option<Duration>,
    /// The client in control was delayed when that was asked for last.
    delayed: bool,
    queue: Vec<ClientInput>,
}

impl InputArbiter {
    /// Calls `client` by `name`, or by its number where that is empty; a name that another has gets a number.
    pub(crate) fn set_name(&mut self, client: ClientId, name: &str) {
        let clean: String = name.chars().filter(|c| !c.is_control()).take(MAX_NAME_CHARS).collect();
        let wanted = match clean.trim() {
            "" => format!("Page {client}"),
            name => name.to_owned(),
        };
        self.names.remove(&client);
        let numbered = (2..).map(|k: u32| format!("{wanted} {k}"));
        let free = |name: &String| !self.names.values().any(|other| other == name);
        let name = std::iter::once(wanted.clone()).chain(numbered).find(free).unwrap_or(wanted);
        self.names.insert(client, name);
        self.driver_revision += u64::from(self.is_driver(client));
    }

    /// What `client` is called.
    pub(crate) fn client_name(&self, client: ClientId) -> String {
        self.names.get(&client).cloned().unwrap_or_else(|| format!("Page {client}"))
    }

    /// Gives `client` the wheel if nobody has it.
    pub(crate) fn join(&mut self, client: ClientId, now: Instant) {
        if self.driver.is_none() {
            self.set_driver(client, now);
        }
    }

    /// Gives `client` the wheel, whoever has it. What is held is released: whoever drives now presses anew.
    pub(crate) fn take_over(&mut self, client: ClientId, now: Instant) {
        if !self.is_driver(client) {
            self.release_gesture();
            self.resume_trial_time();
            self.set_driver(client, now);
        }
    }

    /// Who drives, and how often that has changed.
    pub(crate) fn driver(&self) -> (u64, Option<(ClientId, String)>) {
        let driver = self.driver.as_ref().map(|driver| (driver.client, self.client_name(driver.client)));
        (self.driver_revision, driver)
    }

    pub(crate) fn is_driver(&self, client: ClientId) -> bool {
        self.driver.as_ref().is_some_and(|driver| driver.client == client)
    }

    fn set_driver(&mut self, client: ClientId, now: Instant) {
        self.driver = Some(DrivingClient { client, last_heartbeat: now });
        (self.released_by_timeout, self.timeout_pending) = (false, false);
        // It holds nothing yet, and a stop that another one's silence caused can end.
        self.heartbeat_pending = true;
        self.driver_revision += 1;
    }

    /// Takes what is the experimenter's to ask, who does not drive. Whatever is held ends with a pause, the trial, or
    /// another trial.
    pub(crate) fn accept_command(&mut self, request: ClientInput) {
        use StudyAction::{Abort, Pause};
        if matches!(request, ClientInput::Study(Pause | Abort) | ClientInput::Restart { .. }) {
            self.release_gesture();
        }
        self.push(request);
    }

    /// Takes a checked message of `client`; none is a sign of life. False if it was ignored because another drives.
    pub(crate) fn accept(&mut self, client: ClientId, now: Instant, input: Option<ClientInput>) -> bool {
        let stops = input == Some(ClientInput::Gesture(Command::NoMotion));
        if self.driver.is_none() && input.is_some() && !stops {
            self.set_driver(client, now);
        }
        let drives = self.is_driver(client);
        let holds = matches!(input, None | Some(ClientInput::Gesture(_)));
        if let Some(driver) = self.driver.as_mut().filter(|_| drives && holds) {
            driver.last_heartbeat = now;
            self.heartbeat_pending = true;
        }
        match input {
            Some(ClientInput::Gesture(Command::NoMotion)) => {
                // Said again by who has let go only now: without it the testbed does not know of the relaxed hand.
                if drives && std::mem::take(&mut self.released_by_timeout) && self.held_gesture.is_none() {
                    self.push(ClientInput::Gesture(Command::NoMotion));
                }
                self.release_gesture();
            }
            Some(_) if !drives => return false,
            // Only a change is news.
            Some(ClientInput::Gesture(command)) => {
                let before = self.held_gesture.replace(command);
                self.push_if(before != Some(command), ClientInput::Gesture(command));
            }
            Some(request @ (ClientInput::Restart { .. } | ClientInput::Study(_))) => {
                self.accept_command(request)
            }
            Some(ClientInput::Hold(on)) => {
                let before = std::mem::replace(&mut self.holds_trial_time, on);
                self.push_if(before != on, ClientInput::Hold(on));
            }
            Some(input) => self.push(input),
            None => {}
        }
        true
    }

    /// The connection of `client` has ended.
    pub(crate) fn disconnect(&mut self, client: ClientId) {
        let drove = self.is_driver(client);
        self.names.remove(&client);
        self.round_trips.remove(&client);
        if drove {
            self.driver = None;
            // What it said before is no sign of life after its end.
            (self.heartbeat_pending, self.delayed, self.timeout_pending) = (false, false, false);
            self.driver_revision += 1;
            self.resume_trial_time();
            self.release_gesture();
            self.push(ClientInput::Disconnected);
        }
    }

    /// Releases a gesture whose holder has fallen silent. To be called a few times within [`HEARTBEAT_TIMEOUT`].
    pub(crate) fn check_timeout(&mut self, now: Instant) {
        if self
            .driver
            .as_ref()
            .is_some_and(|driver| now.duration_since(driver.last_heartbeat) > HEARTBEAT_TIMEOUT)
        {
            if self.held_gesture.is_some() {
                // What it said before is no sign that it is back.
                (self.timeout_pending, self.heartbeat_pending, self.released_by_timeout) =
                    (true, false, true);
            }
            self.release_gesture();
        }
    }

    /// What the client in control said of its gesture since the last call, if only that it still holds it. A line with a delay over
    /// `limit` is reported when it becomes so and with each sign, and its end once. A gesture that was let go for the client's silence
    /// is reported once.
    pub(crate) fn take_heartbeat(&mut self, now: Instant, limit: Option<Duration>) -> Option<PageHeartbeat> {
        self.delay_limit = limit;
        if std::mem::take(&mut self.timeout_pending) {
            return Some(PageHeartbeat::Silent);
        }
        let has_heartbeat = std::mem::take(&mut self.heartbeat_pending);
        let driver = self.driver.as_ref().map(|driver| driver.client);
        let delayed = driver.is_some_and(|client| self.excess_delay(client, now).is_some());
        let before = std::mem::replace(&mut self.delayed, delayed);
        (has_heartbeat || before != delayed).then_some(if delayed {
            PageHeartbeat::Delayed
        } else {
            PageHeartbeat::Alive
        })
    }

    /// The line of `client`.
    pub(crate) fn round_trip(&mut self, client: ClientId) -> &mut RoundTripMonitor {
        self.round_trips.entry(client).or_default()
    }

    /// How much the line of `client` is delayed, while that is more than the limit ([`RoundTripMonitor::over`]).
    pub(crate) fn excess_delay(&mut self, client: ClientId, now: Instant) -> Option<Duration> {
        self.round_trips.get_mut(&client)?.excess_at(now, self.delay_limit)
    }

    /// Everything since the last call, oldest first.
    pub(crate) fn drain(&mut self) -> Vec<ClientInput> {
        std::mem::take(&mut self.queue)
    }

    fn resume_trial_time(&mut self) {
        if std::mem::take(&mut self.holds_trial_time) {
            self.push(ClientInput::Hold(false));
        }
    }

    fn release_gesture(&mut self) {
        if self.held_gesture.take().is_some() {
            self.push(ClientInput::Gesture(Command::NoMotion));
        }
    }

    fn push_if(&mut self, is_new: bool, input: ClientInput) {
        if is_new {
            self.push(input);
        }
    }

    fn push(&mut self, input: ClientInput) {
        // Of gaze, trunk or head samples in a row only the last one counts.
        let replaces = matches!(
            (self.queue.last(), &input),
            (Some(ClientInput::Gaze { .. }), ClientInput::Gaze { .. })
                | (Some(ClientInput::Trunk(_)), ClientInput::Trunk(_))
                | (Some(ClientInput::Head(_)), ClientInput::Head(_))
        );
        if replaces {
            self.queue.pop();
        } else if self.queue.len() >= MAX_QUEUED_INPUTS {
            // Nobody drains. What has piled up is stale, so it goes, and a stop stands in for it.
            self.queue.clear();
            self.held_gesture = None;
            self.resume_trial_time();
            self.queue.push(ClientInput::Gesture(Command::NoMotion));
            return;
        }
        self.queue.push(input);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proact_types::{Point, Vector};

    const WE: ClientInput = ClientInput::Gesture(Command::WristExtension);
    const HC: ClientInput = ClientInput::Gesture(Command::HandClose);
    const NM: ClientInput = ClientInput::Gesture(Command::NoMotion);

    /// What was heard, on a line of which nothing is known.
    fn has_heartbeat(input_arbiter: &mut InputArbiter) -> bool {
        input_arbiter.take_heartbeat(Instant::now(), None).is_some()
    }

    fn gaze(x: f64) -> ClientInput {
        ClientInput::Gaze { origin: Point::origin(), direction: Vector::new(x, 0.0, 1.0), measured: false }
    }

    #[test]
    fn a_held_gesture_that_is_repeated_is_handed_on_once() {
        let (mut input_arbiter, now) = (InputArbiter::default(), Instant::now());
        for _ in 0..5 {
            input_arbiter.accept(1, now, Some(WE));
        }
        input_arbiter.accept(1, now, Some(NM));
        assert_eq!(input_arbiter.drain(), [WE, NM]);
        assert_eq!(input_arbiter.drain(), []);
    }

    #[test]
    fn a_client_that_vanishes_with_a_held_gesture_stops_the_arm() {
        let (mut input_arbiter, now) = (InputArbiter::default(), Instant::now());
        input_arbiter.accept(1, now, Some(WE));
        input_arbiter.disconnect(1);
        assert_eq!(input_arbiter.drain(), [WE, NM, ClientInput::Disconnected]);
    }

    #[test]
    fn a_pause_of_the_experimenter_releases_what_is_held_and_takes_nobodys_place() {
        let (mut input_arbiter, now) = (InputArbiter::default(), Instant::now());
        let pause = ClientInput::Study(StudyAction::Pause);
        input_arbiter.accept(1, now, Some(WE));
        input_arbiter.accept_command(pause.clone());
        input_arbiter.accept(1, now, Some(gaze(1.0)));
        input_arbiter.accept(2, now, Some(gaze(2.0)));
        assert_eq!(input_arbiter.drain(), [WE, NM, pause, gaze(1.0)]);
    }

    #[test]
    fn a_spectator_that_leaves_changes_nothing() {
        let (mut input_arbiter, now) = (InputArbiter::default(), Instant::now());
        input_arbiter.accept(1, now, Some(WE));
        input_arbiter.disconnect(2);
        assert_eq!(input_arbiter.drain(), [WE]);
    }

    #[test]
    fn silence_releases_a_held_gesture_and_a_sign_of_life_keeps_it() {
        let (mut input_arbiter, start) = (InputArbiter::default(), Instant::now());
        input_arbiter.accept(1, start, Some(WE));
        input_arbiter.check_timeout(start + HEARTBEAT_TIMEOUT);
        input_arbiter.accept(1, start + HEARTBEAT_TIMEOUT, None);
        input_arbiter.check_timeout(start + 2 * HEARTBEAT_TIMEOUT);
        assert_eq!(input_arbiter.drain(), [WE]);
        assert!(has_heartbeat(&mut input_arbiter));
        input_arbiter.check_timeout(start + 2 * HEARTBEAT_TIMEOUT + Duration::from_millis(1));
        assert_eq!(input_arbiter.drain(), [NM]);
        // A released gesture is no message of the client. The reason is reported once, also if the client is back at once.
        assert_eq!(input_arbiter.take_heartbeat(start, None), Some(PageHeartbeat::Silent));
        input_arbiter.check_timeout(start + 3 * HEARTBEAT_TIMEOUT);
        assert!(!has_heartbeat(&mut input_arbiter));
        // Once is enough, and a late sign of life does not press again.
        input_arbiter.check_timeout(start + 9 * HEARTBEAT_TIMEOUT);
        input_arbiter.accept(1, start + 9 * HEARTBEAT_TIMEOUT, None);
        assert_eq!(input_arbiter.drain(), []);
        // That the key is released in the end is news to the testbed.
        input_arbiter.accept(1, start + 9 * HEARTBEAT_TIMEOUT, Some(NM));
        assert_eq!(input_arbiter.drain(), [NM]);
        input_arbiter.accept(1, start + 9 * HEARTBEAT_TIMEOUT, Some(NM));
        assert_eq!(input_arbiter.drain(), []);
    }

    /// A page whose keys were stuck kept the arm moving as long as the mouse moved.
    #[test]
    fn gaze_keeps_no_gesture_alive() {
        let (mut input_arbiter, start) = (InputArbiter::default(), Instant::now());
        input_arbiter.accept(1, start, Some(WE));
        assert!(has_heartbeat(&mut input_arbiter));
        let late = start + HEARTBEAT_TIMEOUT + Duration::from_millis(1);
        input_arbiter.accept(1, late, Some(gaze(1.0)));
        input_arbiter.accept(1, late, Some(ClientInput::Trunk(proact_types::TrunkPosture::default())));
        assert!(!has_heartbeat(&mut input_arbiter));
        input_arbiter.check_timeout(late);
        assert_eq!(input_arbiter.drain().last(), Some(&NM));
    }

    /// A line with a constant delay moved the arm as if it had none: signs of life came as often as ever.
    #[test]
    fn what_comes_over_a_delayed_line_is_no_sign_of_life() {
        let (mut input_arbiter, start) = (InputArbiter::default(), Instant::now());
        let (ms, limit) = (Duration::from_millis, Some(Duration::from_millis(250)));
        input_arbiter.accept(1, start, Some(WE));
        assert_eq!(input_arbiter.take_heartbeat(start, limit), Some(PageHeartbeat::Alive));
        let echo = |arbiter: &mut InputArbiter, sent_ms: u64, answered: u64| {
            let ping = arbiter.round_trip(1).next_ping(start + ms(sent_ms)).unwrap();
            arbiter.round_trip(1).record_pong(&ping, start + ms(answered));
        };
        echo(&mut input_arbiter, 0, 300);
        assert_eq!(input_arbiter.excess_delay(1, start + ms(300)), Some(ms(300)));
        assert_eq!(input_arbiter.excess_delay(2, start + ms(300)), None);
        // It is told at once, although nothing was said, and with each sign of life.
        assert_eq!(input_arbiter.take_heartbeat(start + ms(300), limit), Some(PageHeartbeat::Delayed));
        assert_eq!(input_arbiter.take_heartbeat(start + ms(300), limit), None);
        input_arbiter.accept(1, start + ms(340), None);
        assert_eq!(input_arbiter.take_heartbeat(start + ms(340), limit), Some(PageHeartbeat::Delayed));
        // Another limit, none, and a line that is good again.
        assert_eq!(input_arbiter.take_heartbeat(start + ms(340), Some(ms(400))), Some(PageHeartbeat::Alive));
        assert_eq!(input_arbiter.take_heartbeat(start + ms(340), limit), Some(PageHeartbeat::Delayed));
        assert_eq!(input_arbiter.take_heartbeat(start + ms(340), None), Some(PageHeartbeat::Alive));
        echo(&mut input_arbiter, 400, 420);
        assert_eq!(input_arbiter.take_heartbeat(start + ms(420), limit), None);
    }

    #[test]
    fn a_second_client_only_watches_until_it_takes_over() {
        let (mut input_arbiter, now) = (InputArbiter::default(), Instant::now());
        let restart = || ClientInput::Restart { method: None, same_seed: false };
        input_arbiter.join(1, now);
        input_arbiter.join(2, now);
        assert!(input_arbiter.accept(1, now, Some(WE)));
        // However long the first is silent: who drives is never a matter of chance.
        let later = now + 9 * HEARTBEAT_TIMEOUT;
        for input in [gaze(2.0), HC, restart()] {
            assert!(!input_arbiter.accept(2, later, Some(input)));
        }
        assert_eq!(input_arbiter.drain(), [WE]);
        // Whoever takes over begins with a released gesture, and the first watches from then on.
        input_arbiter.take_over(2, later);
        assert!(!input_arbiter.accept(1, later, Some(gaze(1.0))));
        assert!(input_arbiter.accept(2, later, Some(HC)));
        assert_eq!(input_arbiter.drain(), [NM, HC]);
        has_heartbeat(&mut input_arbiter);
        assert!(input_arbiter.accept(1, later, None));
        assert!(!has_heartbeat(&mut input_arbiter), "a sign of life of who watches is none of who drives");
    }

    #[test]
    fn who_drives_is_told_by_name_and_each_change_is_counted() {
        let (mut input_arbiter, now) = (InputArbiter::default(), Instant::now());
        assert_eq!(input_arbiter.driver(), (0, None));
        input_arbiter.set_name(1, " Ann\n ");
        input_arbiter.set_name(2, "Ann");
        input_arbiter.set_name(3, "\u{7}");
        input_arbiter.set_name(4, &"x".repeat(99));
        let names = [1, 2, 3, 4].map(|client| input_arbiter.client_name(client));
        assert_eq!(names, ["Ann".to_owned(), "Ann 2".to_owned(), "Page 3".to_owned(), "x".repeat(40)]);
        input_arbiter.join(1, now);
        assert_eq!(input_arbiter.driver(), (1, Some((1, "Ann".to_owned()))));
        input_arbiter.take_over(2, now);
        input_arbiter.take_over(2, now);
        assert_eq!(input_arbiter.driver(), (2, Some((2, "Ann 2".to_owned()))));
        input_arbiter.set_name(2, "Bo");
        assert_eq!(input_arbiter.driver(), (3, Some((2, "Bo".to_owned()))));
        input_arbiter.disconnect(1);
        assert_eq!(input_arbiter.driver().0, 3);
        input_arbiter.disconnect(2);
        assert_eq!(input_arbiter.driver(), (4, None));
    }

    #[test]
    fn time_that_a_dialog_holds_goes_on_when_its_page_gives_up_the_wheel() {
        let (mut input_arbiter, now) = (InputArbiter::default(), Instant::now());
        let hold = ClientInput::Hold;
        for on in [true, true] {
            input_arbiter.accept(1, now, Some(hold(on)));
        }
        input_arbiter.take_over(2, now);
        assert!(!input_arbiter.accept(1, now, Some(hold(true))));
        assert_eq!(input_arbiter.drain(), [hold(true), hold(false)]);
        input_arbiter.accept(2, now, Some(hold(true)));
        input_arbiter.disconnect(2);
        assert_eq!(input_arbiter.drain(), [hold(true), hold(false), ClientInput::Disconnected]);
    }

    #[test]
    fn another_trial_for_the_experimenter_leaves_the_wheel_where_it_is() {
        let (mut input_arbiter, now) = (InputArbiter::default(), Instant::now());
        let restart = ClientInput::Restart { method: None, same_seed: false };
        input_arbiter.accept(1, now, Some(WE));
        input_arbiter.accept_command(restart.clone());
        assert!(input_arbiter.accept(1, now, Some(gaze(1.0))));
        assert_eq!(input_arbiter.drain(), [WE, NM, restart, gaze(1.0)]);
    }

    #[test]
    fn a_stop_is_taken_from_everybody() {
        let (mut input_arbiter, now) = (InputArbiter::default(), Instant::now());
        input_arbiter.accept(1, now, Some(WE));
        input_arbiter.accept(2, now, Some(NM));
        assert_eq!(input_arbiter.drain(), [WE, NM]);
    }

    #[test]
    fn a_restart_releases_what_is_held_first() {
        let (mut input_arbiter, now) = (InputArbiter::default(), Instant::now());
        input_arbiter.accept(1, now, Some(WE));
        let restart = ClientInput::Restart { method: None, same_seed: false };
        input_arbiter.accept(1, now, Some(restart.clone()));
        assert_eq!(input_arbiter.drain(), [WE, NM, restart]);
    }

    #[test]
    fn of_gaze_samples_in_a_row_the_last_one_is_kept() {
        let (mut input_arbiter, now) = (InputArbiter::default(), Instant::now());
        for x in [1.0, 2.0, 3.0] {
            input_arbiter.accept(1, now, Some(gaze(x)));
        }
        input_arbiter.accept(1, now, Some(HC));
        input_arbiter.accept(1, now, Some(gaze(4.0)));
        assert_eq!(input_arbiter.drain(), [gaze(3.0), HC, gaze(4.0)]);
    }

    #[test]
    fn a_testbed_that_never_drains_costs_bounded_memory_and_ends_with_a_stop() {
        let (mut input_arbiter, now) = (InputArbiter::default(), Instant::now());
        for k in 0..10 * MAX_QUEUED_INPUTS {
            input_arbiter.accept(1, now, Some(if k % 2 == 0 { WE } else { HC }));
            assert!(input_arbiter.queue.len() <= MAX_QUEUED_INPUTS);
        }
        assert_eq!(input_arbiter.drain()[0], NM);
    }
}
