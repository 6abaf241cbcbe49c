//! Who is in control, and the inputs that wait for the testbed.
//!
//! One client at a time drives: the first that joins or sends anything, until its connection ends or another says that
//! it takes over. The others watch. A stop is taken from everybody. Pure: the time is handed in.

use crate::{
    input::{ClientInput, StudyAction},
    line_delay::LineDelay,
};
use proact_types::Gesture;
use std::{
    collections::BTreeMap,
    time::{Duration, Instant},
};

/// A client that holds a gesture and is silent for longer is taken to be gone: its gesture is released. The page sends
/// a sign of life every 40 ms. It does not bring the gesture back: that takes a new press, or a line that falters would
/// toggle the lock. The testbed, which is told of each sign, stops the arm much sooner.
pub(crate) const MAX_SILENCE: Duration = Duration::from_millis(500);

/// Longest name of a page, characters.
const MAX_NAME_CHARS: usize = 40;

/// Most inputs kept for a testbed that does not drain them: 8 s of gaze at 60 Hz with gestures between.
const MAX_WAITING: usize = 512;

/// Number of a connection, never used twice.
pub(crate) type ClientId = u64;

/// What was heard of the page in control.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Heard {
    /// It is there.
    Alive,
    /// Its line is delayed by more than the limit: what it says is too old to move the arm.
    Delayed,
}

#[derive(Debug)]
struct Driver {
    client: ClientId,
    heard: Instant,
}

/// The client in control and the queue of its inputs.
#[derive(Debug, Default)]
pub(crate) struct InputArbiter {
    driver: Option<Driver>,
    /// Grows whenever another client drives, or the one that drives has another name.
    changes: u64,
    /// What the clients are called.
    names: BTreeMap<ClientId, String>,
    /// The gesture in force, if it is one that moves anything.
    held: Option<Gesture>,
    /// Who drives holds the trial's time: it is released with the wheel.
    holding: bool,
    /// A gesture was released because the client in control fell silent.
    released: bool,
    /// The client in control began to drive, changed its gesture or said that it still holds it, since that was asked for last.
    /// Gaze does not count: it comes from another hand than the gesture, and from a page that is stuck.
    heard: bool,
    /// The lines of the clients.
    lines: BTreeMap<ClientId, LineDelay>,
    /// A line with a longer delay is not driven by; none before a trial says so.
    delay_limit: Option<Duration>,
    /// The client in control was delayed when that was asked for last.
    delayed: bool,
    waiting: Vec<ClientInput>,
}

impl InputArbiter {
    /// Calls `client` by `name`, or by its number where that is empty; a name that another has gets a number.
    pub(crate) fn name(&mut self, client: ClientId, name: &str) {
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
        self.changes += u64::from(self.drives(client));
    }

    /// What `client` is called.
    pub(crate) fn name_of(&self, client: ClientId) -> String {
        self.names.get(&client).cloned().unwrap_or_else(|| format!("Page {client}"))
    }

    /// Gives `client` the wheel if nobody has it.
    pub(crate) fn join(&mut self, client: ClientId, now: Instant) {
        if self.driver.is_none() {
            self.drive(client, now);
        }
    }

    /// Gives `client` the wheel, whoever has it. What is held is released: whoever drives now presses anew.
    pub(crate) fn take_over(&mut self, client: ClientId, now: Instant) {
        if !self.drives(client) {
            self.release();
            self.let_time_go();
            self.drive(client, now);
        }
    }

    /// Who drives, and how often that has changed.
    pub(crate) fn driver(&self) -> (u64, Option<(ClientId, String)>) {
        let driver = self.driver.as_ref().map(|driver| (driver.client, self.name_of(driver.client)));
        (self.changes, driver)
    }

    pub(crate) fn drives(&self, client: ClientId) -> bool {
        self.driver.as_ref().is_some_and(|driver| driver.client == client)
    }

    fn drive(&mut self, client: ClientId, now: Instant) {
        self.driver = Some(Driver { client, heard: now });
        self.released = false;
        // It holds nothing yet, and a stop that another one's silence caused can end.
        self.heard = true;
        self.changes += 1;
    }

    /// Takes what is the experimenter's to ask, who does not drive. Whatever is held ends with a pause, the trial, or
    /// another trial.
    pub(crate) fn command(&mut self, request: ClientInput) {
        use StudyAction::{Abort, Pause};
        if matches!(request, ClientInput::Study(Pause | Abort) | ClientInput::Restart { .. }) {
            self.release();
        }
        self.push(request);
    }

    /// Takes a checked message of `client`; none is a sign of life. False if it was ignored because another drives.
    pub(crate) fn accept(&mut self, client: ClientId, now: Instant, input: Option<ClientInput>) -> bool {
        let stops = input == Some(ClientInput::Gesture(Gesture::NoMotion));
        if self.driver.is_none() && input.is_some() && !stops {
            self.drive(client, now);
        }
        let drives = self.drives(client);
        let holds = matches!(input, None | Some(ClientInput::Gesture(_)));
        if let Some(driver) = self.driver.as_mut().filter(|_| drives && holds) {
            driver.heard = now;
            self.heard = true;
        }
        match input {
            Some(ClientInput::Gesture(Gesture::NoMotion)) => {
                // Said again by who has let go only now: without it the testbed does not know of the relaxed hand.
                if drives && std::mem::take(&mut self.released) && self.held.is_none() {
                    self.push(ClientInput::Gesture(Gesture::NoMotion));
                }
                self.release();
            }
            Some(_) if !drives => return false,
            // Only a change is news.
            Some(ClientInput::Gesture(gesture)) => {
                let before = self.held.replace(gesture);
                self.push_if(before != Some(gesture), ClientInput::Gesture(gesture));
            }
            Some(request @ (ClientInput::Restart { .. } | ClientInput::Study(_))) => self.command(request),
            Some(ClientInput::Hold(on)) => {
                let before = std::mem::replace(&mut self.holding, on);
                self.push_if(before != on, ClientInput::Hold(on));
            }
            Some(input) => self.push(input),
            None => {}
        }
        true
    }

    /// The connection of `client` has ended.
    pub(crate) fn leave(&mut self, client: ClientId) {
        let drove = self.drives(client);
        self.names.remove(&client);
        self.lines.remove(&client);
        if drove {
            self.driver = None;
            // What it said before is no sign of life after its end.
            (self.heard, self.delayed) = (false, false);
            self.changes += 1;
            self.let_time_go();
            self.release();
            self.push(ClientInput::Disconnected);
        }
    }

    /// Releases a gesture whose holder has fallen silent. To be called a few times within [`MAX_SILENCE`].
    pub(crate) fn check_silence(&mut self, now: Instant) {
        if self.driver.as_ref().is_some_and(|driver| now.duration_since(driver.heard) > MAX_SILENCE) {
            self.released |= self.held.is_some();
            self.release();
        }
    }

    /// What the client in control said of its gesture since the last call, if only that it still holds it. A line with a delay over
    /// `limit` is told when it becomes so and with each sign, and its end once.
    pub(crate) fn take_heard(&mut self, now: Instant, limit: Option<Duration>) -> Option<Heard> {
        self.delay_limit = limit;
        let heard = std::mem::take(&mut self.heard);
        let delayed = self.driver.as_ref().is_some_and(|driver| self.delay(driver.client, now).is_some());
        let before = std::mem::replace(&mut self.delayed, delayed);
        (heard || before != delayed).then_some(if delayed { Heard::Delayed } else { Heard::Alive })
    }

    /// The line of `client`.
    pub(crate) fn line(&mut self, client: ClientId) -> &mut LineDelay {
        self.lines.entry(client).or_default()
    }

    /// How much the line of `client` is delayed, if that is more than the limit.
    pub(crate) fn delay(&self, client: ClientId, now: Instant) -> Option<Duration> {
        let (limit, line) = (self.delay_limit?, self.lines.get(&client)?);
        line.at(now).filter(|delay| *delay > limit)
    }

    /// Everything since the last call, oldest first.
    pub(crate) fn drain(&mut self) -> Vec<ClientInput> {
        std::mem::take(&mut self.waiting)
    }

    fn let_time_go(&mut self) {
        if std::mem::take(&mut self.holding) {
            self.push(ClientInput::Hold(false));
        }
    }

    fn release(&mut self) {
        if self.held.take().is_some() {
            self.push(ClientInput::Gesture(Gesture::NoMotion));
        }
    }

    fn push_if(&mut self, news: bool, input: ClientInput) {
        if news {
            self.push(input);
        }
    }

    fn push(&mut self, input: ClientInput) {
        // Of gaze, trunk or head samples in a row only the last one counts.
        let replaces = matches!(
            (self.waiting.last(), &input),
            (Some(ClientInput::Gaze { .. }), ClientInput::Gaze { .. })
                | (Some(ClientInput::Trunk(_)), ClientInput::Trunk(_))
                | (Some(ClientInput::Head(_)), ClientInput::Head(_))
        );
        if replaces {
            self.waiting.pop();
        } else if self.waiting.len() >= MAX_WAITING {
            // Nobody drains. What has piled up is stale, so it goes, and a stop stands in for it.
            self.waiting.clear();
            self.held = None;
            self.let_time_go();
            self.waiting.push(ClientInput::Gesture(Gesture::NoMotion));
            return;
        }
        self.waiting.push(input);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proact_types::{Point, Vector};

    const WE: ClientInput = ClientInput::Gesture(Gesture::WristExtension);
    const HC: ClientInput = ClientInput::Gesture(Gesture::HandClose);
    const NM: ClientInput = ClientInput::Gesture(Gesture::NoMotion);

    /// What was heard, on a line of which nothing is known.
    fn heard(input_arbiter: &mut InputArbiter) -> bool {
        input_arbiter.take_heard(Instant::now(), None).is_some()
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
        input_arbiter.leave(1);
        assert_eq!(input_arbiter.drain(), [WE, NM, ClientInput::Disconnected]);
    }

    #[test]
    fn a_pause_of_the_experimenter_releases_what_is_held_and_takes_nobodys_place() {
        let (mut input_arbiter, now) = (InputArbiter::default(), Instant::now());
        let pause = ClientInput::Study(StudyAction::Pause);
        input_arbiter.accept(1, now, Some(WE));
        input_arbiter.command(pause.clone());
        input_arbiter.accept(1, now, Some(gaze(1.0)));
        input_arbiter.accept(2, now, Some(gaze(2.0)));
        assert_eq!(input_arbiter.drain(), [WE, NM, pause, gaze(1.0)]);
    }

    #[test]
    fn a_spectator_that_leaves_changes_nothing() {
        let (mut input_arbiter, now) = (InputArbiter::default(), Instant::now());
        input_arbiter.accept(1, now, Some(WE));
        input_arbiter.leave(2);
        assert_eq!(input_arbiter.drain(), [WE]);
    }

    #[test]
    fn silence_releases_a_held_gesture_and_a_sign_of_life_keeps_it() {
        let (mut input_arbiter, start) = (InputArbiter::default(), Instant::now());
        input_arbiter.accept(1, start, Some(WE));
        input_arbiter.check_silence(start + MAX_SILENCE);
        input_arbiter.accept(1, start + MAX_SILENCE, None);
        input_arbiter.check_silence(start + 2 * MAX_SILENCE);
        assert_eq!(input_arbiter.drain(), [WE]);
        input_arbiter.check_silence(start + 2 * MAX_SILENCE + Duration::from_millis(1));
        assert_eq!(input_arbiter.drain(), [NM]);
        // A released gesture is no word of the client.
        assert!(heard(&mut input_arbiter));
        input_arbiter.check_silence(start + 3 * MAX_SILENCE);
        assert!(!heard(&mut input_arbiter));
        // Once is enough, and a late sign of life does not press again.
        input_arbiter.check_silence(start + 9 * MAX_SILENCE);
        input_arbiter.accept(1, start + 9 * MAX_SILENCE, None);
        assert_eq!(input_arbiter.drain(), []);
        // That the key is released in the end is news to the testbed.
        input_arbiter.accept(1, start + 9 * MAX_SILENCE, Some(NM));
        assert_eq!(input_arbiter.drain(), [NM]);
        input_arbiter.accept(1, start + 9 * MAX_SILENCE, Some(NM));
        assert_eq!(input_arbiter.drain(), []);
    }

    /// A page whose keys were stuck kept the arm moving as long as the mouse moved.
    #[test]
    fn gaze_keeps_no_gesture_alive() {
        let (mut input_arbiter, start) = (InputArbiter::default(), Instant::now());
        input_arbiter.accept(1, start, Some(WE));
        assert!(heard(&mut input_arbiter));
        let late = start + MAX_SILENCE + Duration::from_millis(1);
        input_arbiter.accept(1, late, Some(gaze(1.0)));
        input_arbiter.accept(1, late, Some(ClientInput::Trunk(proact_types::TrunkPosture::default())));
        assert!(!heard(&mut input_arbiter));
        input_arbiter.check_silence(late);
        assert_eq!(input_arbiter.drain().last(), Some(&NM));
    }

    /// A line with a constant delay moved the arm as if it had none: signs of life came as often as ever.
    #[test]
    fn what_comes_over_a_delayed_line_is_no_sign_of_life() {
        let (mut input_arbiter, start) = (InputArbiter::default(), Instant::now());
        let (ms, limit) = (Duration::from_millis, Some(Duration::from_millis(250)));
        input_arbiter.accept(1, start, Some(WE));
        assert_eq!(input_arbiter.take_heard(start, limit), Some(Heard::Alive));
        let echo = |arbiter: &mut InputArbiter, asked: u64, answered: u64| {
            let ping = arbiter.line(1).ask(start + ms(asked)).unwrap();
            arbiter.line(1).answer(&ping, start + ms(answered));
        };
        echo(&mut input_arbiter, 0, 300);
        assert_eq!(input_arbiter.delay(1, start + ms(300)), Some(ms(300)));
        assert_eq!(input_arbiter.delay(2, start + ms(300)), None);
        // It is told at once, although nothing was said, and with each sign of life.
        assert_eq!(input_arbiter.take_heard(start + ms(300), limit), Some(Heard::Delayed));
        assert_eq!(input_arbiter.take_heard(start + ms(300), limit), None);
        input_arbiter.accept(1, start + ms(340), None);
        assert_eq!(input_arbiter.take_heard(start + ms(340), limit), Some(Heard::Delayed));
        // Another limit, none, and a line that is good again.
        assert_eq!(input_arbiter.take_heard(start + ms(340), Some(ms(300))), Some(Heard::Alive));
        assert_eq!(input_arbiter.take_heard(start + ms(340), limit), Some(Heard::Delayed));
        assert_eq!(input_arbiter.take_heard(start + ms(340), None), Some(Heard::Alive));
        echo(&mut input_arbiter, 400, 420);
        assert_eq!(input_arbiter.take_heard(start + ms(420), limit), None);
    }

    #[test]
    fn a_second_client_only_watches_until_it_takes_over() {
        let (mut input_arbiter, now) = (InputArbiter::default(), Instant::now());
        let restart = || ClientInput::Restart { method: None, again: false };
        input_arbiter.join(1, now);
        input_arbiter.join(2, now);
        assert!(input_arbiter.accept(1, now, Some(WE)));
        // However long the first is silent: who drives is never a matter of chance.
        let later = now + 9 * MAX_SILENCE;
        for input in [gaze(2.0), HC, restart()] {
            assert!(!input_arbiter.accept(2, later, Some(input)));
        }
        assert_eq!(input_arbiter.drain(), [WE]);
        // Whoever takes over begins with a released gesture, and the first watches from then on.
        input_arbiter.take_over(2, later);
        assert!(!input_arbiter.accept(1, later, Some(gaze(1.0))));
        assert!(input_arbiter.accept(2, later, Some(HC)));
        assert_eq!(input_arbiter.drain(), [NM, HC]);
        heard(&mut input_arbiter);
        assert!(input_arbiter.accept(1, later, None));
        assert!(!heard(&mut input_arbiter), "a sign of life of who watches is none of who drives");
    }

    #[test]
    fn who_drives_is_told_by_name_and_each_change_is_counted() {
        let (mut input_arbiter, now) = (InputArbiter::default(), Instant::now());
        assert_eq!(input_arbiter.driver(), (0, None));
        input_arbiter.name(1, " Ann\n ");
        input_arbiter.name(2, "Ann");
        input_arbiter.name(3, "\u{7}");
        input_arbiter.name(4, &"x".repeat(99));
        let names = [1, 2, 3, 4].map(|client| input_arbiter.name_of(client));
        assert_eq!(names, ["Ann".to_owned(), "Ann 2".to_owned(), "Page 3".to_owned(), "x".repeat(40)]);
        input_arbiter.join(1, now);
        assert_eq!(input_arbiter.driver(), (1, Some((1, "Ann".to_owned()))));
        input_arbiter.take_over(2, now);
        input_arbiter.take_over(2, now);
        assert_eq!(input_arbiter.driver(), (2, Some((2, "Ann 2".to_owned()))));
        input_arbiter.name(2, "Bo");
        assert_eq!(input_arbiter.driver(), (3, Some((2, "Bo".to_owned()))));
        input_arbiter.leave(1);
        assert_eq!(input_arbiter.driver().0, 3);
        input_arbiter.leave(2);
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
        input_arbiter.leave(2);
        assert_eq!(input_arbiter.drain(), [hold(true), hold(false), ClientInput::Disconnected]);
    }

    #[test]
    fn another_trial_for_the_experimenter_leaves_the_wheel_where_it_is() {
        let (mut input_arbiter, now) = (InputArbiter::default(), Instant::now());
        let restart = ClientInput::Restart { method: None, again: false };
        input_arbiter.accept(1, now, Some(WE));
        input_arbiter.command(restart.clone());
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
        let restart = ClientInput::Restart { method: None, again: false };
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
        for k in 0..10 * MAX_WAITING {
            input_arbiter.accept(1, now, Some(if k % 2 == 0 { WE } else { HC }));
            assert!(input_arbiter.waiting.len() <= MAX_WAITING);
        }
        assert_eq!(input_arbiter.drain()[0], NM);
    }
}
