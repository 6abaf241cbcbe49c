use super::{Characteristic, Connect, GattLink, LinkError};
use std::time::{Duration, Instant};

/// A stream without any sample for so long is given up, and the connection made anew.
const SILENCE: Duration = Duration::from_secs(2);
/// Wait before the first attempt to reconnect; doubled with each until the longest.
const FIRST_WAIT: Duration = Duration::from_millis(250);
const LONGEST_WAIT: Duration = Duration::from_secs(5);

/// The connection to an armband, which is made anew with growing waits when it is lost.
pub(crate) struct KeptLink {
    connector: Box<dyn Connect>,
    state: State,
}

enum State {
    Streaming { link: Box<dyn GattLink>, heard: Instant },
    Waiting { until: Instant, wait: Duration },
}

/// What a kept link brought.
pub(crate) enum Heard<T> {
    /// A notification of this characteristic.
    Notification(Characteristic),
    /// Nothing yet.
    Nothing,
    /// The end of the connection, and why.
    Lost(String),
    /// A new connection, and what setting it up found out.
    Restored(T),
}

impl KeptLink {
    /// A link that is set up and sends.
    pub(crate) fn new(connector: Box<dyn Connect>, link: Box<dyn GattLink>) -> KeptLink {
        KeptLink { connector, state: State::Streaming { link, heard: Instant::now() } }
    }

    /// The link, unless it is lost.
    pub(crate) fn link(&mut self) -> Option<&mut dyn GattLink> {
        match &mut self.state {
            State::Streaming { link, .. } => Some(link.as_mut()),
            State::Waiting { .. } => None,
        }
    }

    /// The newest notification had samples.
    pub(crate) fn note_samples(&mut self) {
        if let State::Streaming { heard, .. } = &mut self.state {
            *heard = Instant::now();
        }
    }

    /// Waits until `deadline` for a notification, whose bytes take the place of `bytes`, or for the next attempt to reconnect;
    /// `set_up` prepares a new connection. Connecting may take longer than until the deadline.
    pub(crate) fn next<T, E: From<LinkError>>(
        &mut self,
        deadline: Instant,
        bytes: &mut Vec<u8>,
        set_up: impl FnOnce(&mut dyn GattLink) -> Result<T, E>,
    ) -> Heard<T> {
        let left = deadline.saturating_duration_since(Instant::now());
        match &mut self.state {
            State::Streaming { link, heard } => match link.next_notification(left, bytes) {
                Ok(Some(characteristic)) => Heard::Notification(characteristic),
                Ok(None) if heard.elapsed() <= SILENCE => Heard::Nothing,
                Ok(None) => {
                    let reason = format!("no samples for {:.1} s", heard.elapsed().as_secs_f64());
                    self.lose(reason)
                }
                Err(error) => self.lose(error.to_string()),
            },
            State::Waiting { until, wait } => {
                let (pause, wait) = (until.saturating_duration_since(Instant::now()), *wait);
                std::thread::sleep(pause.min(left));
                if pause > left {
                    return Heard::Nothing;
                }
                self.reconnect(wait, set_up)
            }
        }
    }

    fn lose<T>(&mut self, reason: String) -> Heard<T> {
        self.state = State::Waiting { until: Instant::now() + FIRST_WAIT, wait: FIRST_WAIT };
        Heard::Lost(reason)
    }

    /// One attempt to get the armband back.
    fn reconnect<T, E: From<LinkError>>(
        &mut self,
        wait: Duration,
        set_up: impl FnOnce(&mut dyn GattLink) -> Result<T, E>,
    ) -> Heard<T> {
        let attempt = self.connector.connect().map_err(E::from).and_then(|mut link| {
            let ready = set_up(link.as_mut())?;
            Ok((link, ready))
        });
        match attempt {
            Ok((link, ready)) => {
                self.state = State::Streaming { link, heard: Instant::now() };
                Heard::Restored(ready)
            }
            // The loss was reported; what hinders an attempt may be over at the next.
            Err(_) => {
                let wait = (2 * wait).min(LONGEST_WAIT);
                self.state = State::Waiting { until: Instant::now() + wait, wait };
                Heard::Nothing
            }
        }
    }
}
