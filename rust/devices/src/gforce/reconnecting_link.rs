use super::{Characteristic, GattConnector, GattLink, LinkError};
use std::time::{Duration, Instant};

/// A stream without any sample for so long is given up, and the connection made anew.
const SAMPLE_TIMEOUT: Duration = Duration::from_secs(2);
/// Wait before the first attempt to reconnect; doubled with each until the longest.
const FIRST_RETRY_DELAY: Duration = Duration::from_millis(250);
const MAX_RETRY_DELAY: Duration = Duration::from_secs(5);

/// The connection to an armband, which is made anew with growing waits when it is lost.
pub(crate) struct ReconnectingLink {
    connector: Box<dyn GattConnector>,
    state: ReconnectState,
}

enum ReconnectState {
    Streaming { link: Box<dyn GattLink>, last_sample: Instant },
    Waiting { retry_at: Instant, retry_delay: Duration },
}

/// What a kept link brought.
pub(crate) enum LinkEvent<T> {
    /// A notification of this characteristic.
    Notification(Characteristic),
    /// Nothing yet.
    Nothing,
    /// The end of the connection, and why.
    Lost(String),
    /// A new connection, and what setting it up found out.
    Restored(T),
}

impl ReconnectingLink {
    /// A link that is set up and sends.
    pub(crate) fn new(connector: Box<dyn GattConnector>, link: Box<dyn GattLink>) -> ReconnectingLink {
        ReconnectingLink { connector, state: ReconnectState::Streaming { link, last_sample: Instant::now() } }
    }

    /// The link, unless it is lost.
    pub(crate) fn link(&mut self) -> Option<&mut dyn GattLink> {
        match &mut self.state {
            ReconnectState::Streaming { link, .. } => Some(link.as_mut()),
            ReconnectState::Waiting { .. } => None,
        }
    }

    /// The newest notification had samples.
    pub(crate) fn note_samples(&mut self) {
        if let ReconnectState::Streaming { last_sample, .. } = &mut self.state {
            *last_sample = Instant::now();
        }
    }

    /// Waits until `deadline` for a notification, whose bytes take the place of `bytes`, or for the next attempt to reconnect;
    /// `set_up` prepares a new connection. Connecting may take longer than until the deadline.
    pub(crate) fn next_event<T, E: From<LinkError>>(
        &mut self,
        deadline: Instant,
        bytes: &mut Vec<u8>,
        set_up: impl FnOnce(&mut dyn GattLink) -> Result<T, E>,
    ) -> LinkEvent<T> {
        let left = deadline.saturating_duration_since(Instant::now());
        match &mut self.state {
            ReconnectState::Streaming { link, last_sample } => match link.next_notification(left, bytes) {
                Ok(Some(characteristic)) => LinkEvent::Notification(characteristic),
                Ok(None) if last_sample.elapsed() <= SAMPLE_TIMEOUT => LinkEvent::Nothing,
                Ok(None) => {
                    let reason = format!("no samples for {:.1} s", last_sample.elapsed().as_secs_f64());
                    self.mark_lost(reason)
                }
                Err(error) => self.mark_lost(error.to_string()),
            },
            ReconnectState::Waiting { retry_at: until, retry_delay: wait } => {
                let (pause, wait) = (until.saturating_duration_since(Instant::now()), *wait);
                std::thread::sleep(pause.min(left));
                if pause > left {
                    return LinkEvent::Nothing;
                }
                self.reconnect(wait, set_up)
            }
        }
    }

    fn mark_lost<T>(&mut self, reason: String) -> LinkEvent<T> {
        self.state = ReconnectState::Waiting {
            retry_at: Instant::now() + FIRST_RETRY_DELAY,
            retry_delay: FIRST_RETRY_DELAY,
        };
        LinkEvent::Lost(reason)
    }

    /// One attempt to get the armband back.
    fn reconnect<T, E: From<LinkError>>(
        &mut self,
        wait: Duration,
        set_up: impl FnOnce(&mut dyn GattLink) -> Result<T, E>,
    ) -> LinkEvent<T> {
        let attempt = self.connector.connect().map_err(E::from).and_then(|mut link| {
            let ready = set_up(link.as_mut())?;
            Ok((link, ready))
        });
        match attempt {
            Ok((link, ready)) => {
                self.state = ReconnectState::Streaming { link, last_sample: Instant::now() };
                LinkEvent::Restored(ready)
            }
            // The loss was reported; what hinders an attempt may be over at the next.
            Err(_) => {
                let wait = (2 * wait).min(MAX_RETRY_DELAY);
                self.state = ReconnectState::Waiting { retry_at: Instant::now() + wait, retry_delay: wait };
                LinkEvent::Nothing
            }
        }
    }
}
