//! What connects a person to a trial beside the page: an eye tracker, and something to hear or feel.

use crate::{
    limb::LimbReceiver,
    rosbridge::{Rosbridge, RosbridgeArgs},
};
use clap::Args;
use proact_bridge::{ClientInput, PageServer};
#[cfg(feature = "lsl")]
use proact_devices::LslGaze;
use proact_devices::{
    DeviceError, FeedbackSink, GazeFrame, GazeReceiver, GazeTracker, SentGaze, UdpFeedback,
};
use proact_testbed::{FeedbackCue, Session, Step};
use proact_types::{GazeSample, InputSource};
use std::error::Error;

/// Where cues go.
#[derive(Debug, Args)]
pub(crate) struct FeedbackArgs {
    /// Send sound and vibration cues as JSON datagrams, for a program that drives an actuator
    #[arg(long, value_name = "HOST:PORT")]
    feedback: Option<String>,
}

/// Sends the cues of a trial, as long as that works.
pub(crate) struct Feedback(Option<UdpFeedback>);

impl FeedbackArgs {
    pub(crate) fn open(&self) -> Result<Feedback, DeviceError> {
        Ok(Feedback(self.feedback.as_deref().map(UdpFeedback::connect).transpose()?))
    }
}

impl Feedback {
    /// Begins the cues of a tick.
    pub(crate) fn begin(&mut self, cues: &[FeedbackCue]) {
        for cue in cues {
            let Some(sink) = &mut self.0 else { return };
            if let Err(error) = sink.begin(cue) {
                eprintln!("no more feedback: {error}");
                self.0 = None;
            }
        }
    }
}

/// What a person who drives may have connected.
#[derive(Debug, Args)]
pub(crate) struct PersonArgs {
    /// Take gaze from an eye tracker's program over UDP, on port 25040 unless another is given
    #[arg(long, value_name = "PORT", num_args = 0..=1, default_missing_value = "25040")]
    gaze_udp: Option<u16>,
    /// Take gaze from an eye tracker's stream of the lab streaming layer: its name, or the only one of type Gaze
    #[cfg(feature = "lsl")]
    #[arg(long, value_name = "NAME", num_args = 0..=1, conflicts_with = "gaze_udp")]
    gaze_lsl: Option<Option<String>>,
    /// Follow a tracked limb that a program sends over UDP as {"angles": [..]}, on port 25041 unless another is given
    #[arg(long, value_name = "PORT", num_args = 0..=1, default_missing_value = "25041")]
    limb_udp: Option<u16>,
    #[command(flatten)]
    feedback: FeedbackArgs,
    #[command(flatten)]
    rosbridge: RosbridgeArgs,
}

/// What a person who drives has connected.
pub(crate) struct Person {
    tracker: Option<EyeTracker>,
    limb: Option<LimbReceiver>,
    /// Why the limb was refused last.
    limb_refused: Option<String>,
    feedback: Feedback,
    rosbridge: Option<Rosbridge>,
}

impl PersonArgs {
    pub(crate) fn open(&self, session: &Session) -> Result<Person, Box<dyn Error>> {
        let tracker = self.tracker()?.map(EyeTracker::new);
        let limb = self.limb_udp.map(LimbReceiver::bind).transpose()?;
        if let Some(limb) = &limb {
            eprintln!("limb: UDP {}", limb.address()?);
        }
        let (feedback, rosbridge) = (self.feedback.open()?, self.rosbridge.open(session)?);
        Ok(Person { tracker, limb, limb_refused: None, feedback, rosbridge })
    }

    fn tracker(&self) -> Result<Option<Box<dyn GazeTracker>>, Box<dyn Error>> {
        #[cfg(feature = "lsl")]
        if let Some(name) = &self.gaze_lsl {
            let tracker = LslGaze::open(name.as_deref())?;
            eprintln!("gaze: {}, lab streaming layer", tracker.name());
            return Ok(Some(Box::new(tracker)));
        }
        let Some(port) = self.gaze_udp else { return Ok(None) };
        let tracker = GazeReceiver::bind(port)?;
        eprintln!("gaze: UDP {}", tracker.address()?);
        Ok(Some(Box::new(tracker)))
    }
}

impl Person {
    /// What gives gaze instead of the page; none if nothing does.
    pub(crate) fn gaze_source(&self) -> Option<&'static str> {
        self.tracker.as_ref().map(|_| "eye tracker")
    }

    /// Another trial begins.
    pub(crate) fn restart(&self, session: &Session) {
        if let Some(rosbridge) = &self.rosbridge {
            rosbridge.restart(session);
        }
    }

    /// Hands over what came in. Of several sources of gaze the eye tracker counts.
    pub(crate) fn drive(&mut self, session: &mut Session) -> Result<(), Box<dyn Error>> {
        if let Some(rosbridge) = &self.rosbridge {
            rosbridge.drive(session);
        }
        if let Some(limb) = &mut self.limb {
            let refused = limb.drive(session).err().map(|error| error.to_string());
            // A stream of broken datagrams is said once, and the limb stays where it was.
            if let Some(reason) = refused.as_ref().filter(|_| refused != self.limb_refused) {
                eprintln!("{reason}");
            }
            self.limb_refused = refused.or(self.limb_refused.take());
        }
        if let Some(tracker) = &mut self.tracker {
            tracker.drive(session)?;
        }
        Ok(())
    }

    /// Publishes an instant, and begins the cues of a tick.
    pub(crate) fn show(&mut self, step: &Step) {
        self.feedback.begin(&step.output.cues);
        if let (Some(rosbridge), Some(frame)) = (&self.rosbridge, &step.frame) {
            rosbridge.publish(frame);
        }
    }
}

/// Hands what the page in control brought, `inputs`, to a person's trial. What is not the person's comes back.
pub(crate) fn drive_by_page(
    page: &PageServer,
    inputs: Vec<ClientInput>,
    session: &mut Session,
) -> Vec<ClientInput> {
    let mut others = Vec::new();
    for input in inputs {
        match input {
            ClientInput::Gesture(gesture) => session.person().command(InputSource::Page, gesture),
            ClientInput::Gaze { origin, direction, measured } => {
                let gaze = GazeSample { origin, direction, valid: true };
                if measured { session.person().look(gaze) } else { session.person().point(gaze) }
            }
            ClientInput::Trunk(posture) => session.person().lean(posture),
            ClientInput::Head(pose) => session.person().track_head(pose),
            ClientInput::Disconnected => session.person().close(InputSource::Page),
            other => others.push(other),
        }
    }
    if page.take_heard() {
        session.person().hear(InputSource::Page);
    }
    others
}

/// An eye tracker, and what it sent last.
pub(crate) struct EyeTracker {
    tracker: Box<dyn GazeTracker>,
    last: Option<SentGaze>,
}

impl EyeTracker {
    pub(crate) fn new(tracker: Box<dyn GazeTracker>) -> Self {
        Self { tracker, last: None }
    }

    /// Hands the newest sample to a person's trial. False if none came.
    pub(crate) fn drive(&mut self, session: &mut Session) -> Result<bool, DeviceError> {
        let Some(sent) = self.tracker.latest()? else { return Ok(false) };
        let GazeSample { origin, direction, valid } = sent.sample;
        let gaze = match sent.frame {
            GazeFrame::World => sent.sample,
            GazeFrame::Head => {
                let head = session.head();
                GazeSample { origin: head * origin, direction: head.rotation * direction, valid }
            }
        };
        // Compared as sent: a frozen ray would move in the world with the head.
        let repeats = self.last.replace(sent) == Some(sent);
        if repeats && valid {
            session.person().look_again(gaze)
        } else {
            session.person().look(gaze)
        }
        Ok(true)
    }
}
