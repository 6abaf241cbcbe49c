//! What makes cues heard or felt: sinks, found by their schemes, each in a thread of its own.

mod udp;
mod vibration;

pub use udp::UdpFeedback;
pub use vibration::{VibrationDevice, VibrationDriver, VibrationLine};

use crate::DeviceError;
use proact_types::FeedbackCue;
use std::{
    sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TryRecvError, TrySendError, sync_channel},
    thread,
    time::Duration,
};

/// Cues that may wait for a sink. A sink that is slower loses those that come after: what is felt late misleads.
const MAX_QUEUED_CUES: usize = 64;
/// A sink opens within this time, or not at all.
const OPEN_TIMEOUT: Duration = Duration::from_secs(2);

/// Something that makes cues heard or felt. It may wait: it never runs in the thread of the tick.
pub trait FeedbackSink: Send {
    /// Begins a cue.
    ///
    /// # Errors
    /// If the device cannot be reached; the trial goes on without it.
    fn begin(&mut self, cue: &FeedbackCue) -> Result<(), DeviceError>;
}

/// Opens a sink, at the address behind the scheme.
pub type OpenSink = fn(&str) -> Result<Box<dyn FeedbackSink>, DeviceError>;

/// A kind of sink.
#[derive(Clone, Copy, Debug)]
pub struct SinkScheme {
    /// What its address begins with, such as `vibration-udp:`.
    pub scheme: &'static str,
    /// What follows, such as `HOST:PORT`.
    pub address: &'static str,
    /// In a few words.
    pub help: &'static str,
    /// How it is opened.
    pub open: OpenSink,
}

/// The sinks that there are. An address without a scheme is that of the first.
pub const SINK_SCHEMES: [SinkScheme; 3] = [
    SinkScheme {
        scheme: "udp:",
        address: "HOST:PORT",
        help: "each cue as a JSON datagram",
        open: |address| Ok(Box::new(UdpFeedback::connect(address)?)),
    },
    SinkScheme {
        scheme: "vibration-udp:",
        address: "HOST:PORT",
        help: "a driver of motors and tones, a line of text in each datagram",
        open: |address| Ok(Box::new(VibrationDriver::udp(address)?)),
    },
    SinkScheme {
        scheme: "vibration:",
        address: "PATH",
        help: "the same driver at a serial port, 115200 baud",
        open: |path| Ok(Box::new(VibrationDriver::serial(path.as_ref())?)),
    },
];

/// Several sinks at once. Giving them cues never waits; one that is slow loses some, one that fails is left out.
pub struct FeedbackSinks {
    sinks: Vec<RunningSink>,
}

struct RunningSink {
    name: String,
    cues: SyncSender<FeedbackCue>,
    failure: Receiver<DeviceError>,
    lost: u64,
    loss_reported: bool,
}

impl FeedbackSinks {
    /// None yet.
    pub fn new() -> Self {
        Self { sinks: Vec::new() }
    }

    /// Opens a sink for each of `addresses`, such as `udp:127.0.0.1:25041`, among the kinds `schemes`.
    ///
    /// # Errors
    /// [`DeviceError::Sink`] for one that does not exist or does not open in time; what a sink says.
    pub fn open<S: AsRef<str>>(schemes: &[SinkScheme], addresses: &[S]) -> Result<Self, DeviceError> {
        let mut sinks = Self::new();
        for address in addresses.iter().map(AsRef::as_ref) {
            let named = |scheme: &&SinkScheme| address.starts_with(scheme.scheme);
            let plain = || schemes.first().filter(|_| address.rsplit(':').nth(1).is_some_and(is_host));
            let Some(found) = schemes.iter().find(named).or_else(plain) else {
                let known: Vec<String> =
                    schemes.iter().map(|scheme| format!("{}{}", scheme.scheme, scheme.address)).collect();
                let reason = format!("unknown; expected {}", known.join(", "));
                return Err(DeviceError::Sink { sink: address.to_owned(), reason });
            };
            let rest = address.strip_prefix(found.scheme).unwrap_or(address).to_owned();
            let open = found.open;
            sinks.add(address, move || open(&rest))?;
        }
        Ok(sinks)
    }

    /// Adds the sink that `open` gives, under a name for messages. It is opened, and then lives, in a thread of its own.
    ///
    /// # Errors
    /// What `open` says; [`DeviceError::Sink`] if it takes too long.
    pub fn add(
        &mut self,
        name: &str,
        open: impl FnOnce() -> Result<Box<dyn FeedbackSink>, DeviceError> + Send + 'static,
    ) -> Result<(), DeviceError> {
        let (cues, given) = sync_channel::<FeedbackCue>(MAX_QUEUED_CUES);
        let (opened, opening) = sync_channel(1);
        let (failed, failure) = sync_channel(1);
        thread::spawn(move || {
            let mut sink = match open() {
                Ok(sink) => sink,
                Err(error) => {
                    let _ = opened.send(Err(error));
                    return;
                }
            };
            // Nobody waits for it any more: it took too long.
            if opened.send(Ok(())).is_err() {
                return;
            }
            while let Ok(cue) = given.recv() {
                if let Err(error) = sink.begin(&cue) {
                    let _ = failed.send(error);
                    return;
                }
            }
        });
        let late = |reason: &str| DeviceError::Sink { sink: name.to_owned(), reason: reason.to_owned() };
        match opening.recv_timeout(OPEN_TIMEOUT) {
            Ok(outcome) => outcome?,
            Err(RecvTimeoutError::Timeout) => return Err(late("does not open within 2 s")),
            Err(RecvTimeoutError::Disconnected) => return Err(late("ended while it was opened")),
        }
        self.sinks.push(RunningSink { name: name.to_owned(), cues, failure, lost: 0, loss_reported: false });
        Ok(())
    }

    /// Hands `cues` to all of them, without waiting. What there is to tell of a sink comes back: that it is too slow, once,
    /// and that it failed and is left out.
    pub fn send_cues(&mut self, cues: &[FeedbackCue]) -> Vec<String> {
        let mut notices = Vec::new();
        self.sinks.retain_mut(|sink| {
            for cue in cues {
                match sink.cues.try_send(cue.clone()) {
                    Ok(()) | Err(TrySendError::Disconnected(_)) => {}
                    Err(TrySendError::Full(_)) => sink.lost += 1,
                }
            }
            if sink.lost > 0 && !sink.loss_reported {
                sink.loss_reported = true;
                notices.push(format!("feedback {}: too slow, cues are lost", sink.name));
            }
            match sink.failure.try_recv() {
                Ok(error) => notices.push(format!("no more feedback to {}: {error}", sink.name)),
                Err(TryRecvError::Disconnected) => {
                    notices.push(format!("no more feedback to {}: it broke off", sink.name));
                }
                Err(TryRecvError::Empty) => return true,
            }
            false
        });
        notices
    }

    /// How many are left.
    pub fn len(&self) -> usize {
        self.sinks.len()
    }

    /// Whether none is left.
    pub fn is_empty(&self) -> bool {
        self.sinks.is_empty()
    }
}

impl Default for FeedbackSinks {
    fn default() -> Self {
        Self::new()
    }
}

fn is_host(text: &str) -> bool {
    !text.is_empty() && text.chars().all(|c| c.is_ascii_alphanumeric() || ".-_[]".contains(c))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proact_types::{Cue, SimTime};
    use std::{
        sync::mpsc::channel,
        time::{Duration, Instant},
    };

    fn cue(time: u64) -> FeedbackCue {
        FeedbackCue { time: SimTime(time), cue: Cue::OnTarget, digit: None, sound: None, vibration: None }
    }

    struct To<F>(F);

    impl<F: FnMut(&FeedbackCue) -> Result<(), DeviceError> + Send> FeedbackSink for To<F> {
        fn begin(&mut self, cue: &FeedbackCue) -> Result<(), DeviceError> {
            (self.0)(cue)
        }
    }

    #[test]
    fn several_sinks_get_every_cue_and_one_that_fails_is_left_out_and_told() {
        let (sender, received) = channel();
        let mut sinks = FeedbackSinks::new();
        sinks
            .add("good", move || {
                Ok(Box::new(To(move |cue: &FeedbackCue| {
                    sender.send(cue.time).unwrap();
                    Ok(())
                })))
            })
            .unwrap();
        let broken = |_: &FeedbackCue| {
            Err(DeviceError::Sink { sink: "broken".to_owned(), reason: "the wire is off".to_owned() })
        };
        sinks.add("broken", move || Ok(Box::new(To(broken)))).unwrap();
        let mut notices = sinks.send_cues(&[cue(1), cue(2)]);
        let limit = Instant::now() + Duration::from_secs(10);
        while notices.is_empty() && Instant::now() < limit {
            notices = sinks.send_cues(&[]);
        }
        assert_eq!(notices.len(), 1, "{notices:?}");
        assert!(
            notices[0].starts_with("no more feedback to broken: ") && notices[0].contains("the wire is off")
        );
        assert_eq!(sinks.len(), 1);
        sinks.send_cues(&[cue(3)]);
        let got: Vec<SimTime> =
            (0..3).map(|_| received.recv_timeout(Duration::from_secs(10)).unwrap()).collect();
        assert_eq!(got, [SimTime(1), SimTime(2), SimTime(3)]);
    }

    #[test]
    fn a_sink_that_blocks_for_ever_never_holds_up_who_gives_and_is_told_once() {
        let (_never, forever) = channel::<()>();
        let mut sinks = FeedbackSinks::new();
        let blocks = move |_: &FeedbackCue| {
            let _ = forever.recv();
            Ok(())
        };
        sinks.add("stuck", move || Ok(Box::new(To(blocks)))).unwrap();
        let start = Instant::now();
        let notices: Vec<String> = (0..10_000).flat_map(|tick| sinks.send_cues(&[cue(tick)])).collect();
        assert!(start.elapsed() < Duration::from_secs(5), "{:?}", start.elapsed());
        assert_eq!(notices, ["feedback stuck: too slow, cues are lost"]);
    }

    #[test]
    fn addresses_are_told_by_their_schemes_and_unknown_ones_with_those_that_there_are() {
        assert_eq!(FeedbackSinks::open(&SINK_SCHEMES, &["127.0.0.1:9", "udp:127.0.0.1:9"]).unwrap().len(), 2);
        assert_eq!(FeedbackSinks::open(&SINK_SCHEMES, &["vibration-udp:127.0.0.1:9"]).unwrap().len(), 1);
        for unknown in ["smell", "", "nonsense"] {
            let error = FeedbackSinks::open(&SINK_SCHEMES, &[unknown]).err().unwrap().to_string();
            assert!(error.contains("udp:HOST:PORT, vibration-udp:HOST:PORT, vibration:PATH"), "{error}");
        }
        let error =
            FeedbackSinks::open(&SINK_SCHEMES, &["vibration:/no/such/port"]).err().unwrap().to_string();
        assert!(error.contains("/no/such/port"), "{error}");
    }
}
