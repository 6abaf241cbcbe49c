//! What a browser may ask for, parsed and checked at the door.

use crate::{
    frame_latency::DisplayedFrame,
    gaze_check::GazeCheck,
    study::{AnswerInput, StudyRequest},
};
use nalgebra::{Quaternion, Translation3, UnitQuaternion};
use proact_arm::Side;
use proact_types::{Command, Point, Pose, TrunkPosture, Vector};
use serde::{Deserialize, Serialize};

/// An eye further than this from the origin of `world` is a mistake, metres.
const MAX_DISTANCE_M: f64 = 100.0;
/// Largest trunk angle taken over, rad. A bound on nonsense: the body model has its own, tighter limits.
const MAX_TRUNK_ANGLE_RAD: f64 = std::f64::consts::FRAC_PI_2;

/// A page that has been open for longer than thirty years is a mistake, ms.
const MAX_TIME_MS: f64 = 1e12;

/// What the person at the page does. All numbers are finite and within sane bounds.
#[derive(Clone, Debug, PartialEq)]
pub enum ClientInput {
    /// The gesture in force from now on: keys held, or [`Command::NoMotion`] when they are released.
    Gesture(Command),
    /// Where the person looks, in `world`.
    Gaze {
        /// The eye, metres.
        origin: Point,
        /// Unit vector.
        direction: Vector,
        /// By a tracker, and not by a mouse or a stick, which may rest.
        measured: bool,
    },
    /// Where the trunk is asked to go.
    Trunk(TrunkPosture),
    /// Where a headset is: `world_from_head`, x ahead, y left, z up.
    Head(Pose),
    /// Where a headset's controller is.
    Controller(ControllerPose),
    /// Begin a new trial.
    Restart {
        /// With the method of this name, one of [`PageContent::methods`](crate::PageContent::methods); none for the same
        /// one.
        method: Option<String>,
        /// With the same seed, so that the blocks stand where they stood at the start of this one.
        same_seed: bool,
    },
    /// What the experimenter asks for.
    Study(StudyAction),
    /// A gaze check was made.
    GazeCheck(GazeCheck),
    /// Simulated time stands still from now on, or goes on: the person who drives reads a dialog.
    Hold(bool),
    /// What comes after a trial that was shown.
    After(PostTrialAction),
    /// What whoever conducts a study asks for.
    Conduct(StudyRequest),
    /// A question of a study was answered.
    Answer(AnswerInput),
    /// The questionnaire at this step of the session is filled in.
    Submit {
        /// The step.
        step: usize,
    },
    /// The client in control is gone; a gesture that it held was released before.
    Disconnected,
}

/// Where a headset's controller is in `world`, as the headset's browser tells it.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(deny_unknown_fields)]
pub struct ControllerPose {
    /// In which hand, or on which arm.
    pub hand: Side,
    /// On the page's clock, ms.
    pub time_ms: f64,
    /// m.
    pub position: [f64; 3],
    /// x, y, z, w.
    pub quaternion: [f64; 4],
    /// Seen by the headset now; otherwise its place is a guess.
    pub tracked: bool,
}

/// What the experimenter's page asks of the trial.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(rename_all = "snake_case")]
pub enum StudyAction {
    /// Simulated time stands still.
    Pause,
    /// It goes on.
    Resume,
    /// The trial ends here.
    Abort,
    /// The participant's page begins a gaze check.
    CheckGaze,
    /// The same points, and what they tell is taken off the gaze.
    CalibrateGaze,
}

/// What a person asks for after a trial that was shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(rename_all = "snake_case")]
pub enum PostTrialAction {
    /// The same trial once more.
    WatchAgain,
    /// To drive the arm.
    Drive,
}

/// A message of the page on the WebSocket.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub(crate) enum ClientMessage {
    Gesture {
        gesture: Command,
    },
    Gaze {
        origin: [f64; 3],
        direction: [f64; 3],
        #[serde(default)]
        #[cfg_attr(feature = "ts", ts(as = "Option<bool>", optional))]
        measured: bool,
    },
    Trunk {
        forward: f64,
        lateral: f64,
        axial: f64,
    },
    Head {
        position: [f64; 3],
        /// x, y, z, w.
        quaternion: [f64; 4],
    },
    Controller(ControllerPose),
    Restart {
        #[serde(default)]
        #[cfg_attr(feature = "ts", ts(optional))]
        method: Option<String>,
        #[serde(default)]
        #[cfg_attr(feature = "ts", ts(as = "Option<bool>", optional))]
        #[serde(rename = "again")]
        same_seed: bool,
    },
    Study {
        action: StudyAction,
    },
    GazeCheck(GazeCheck),
    /// A person is here, who is called so; whoever joins first drives.
    Join {
        name: String,
    },
    /// Drives from now on.
    TakeOver {},
    /// The first picture of the trial is on the screen.
    Drawn {},
    /// A dialog is open, or no longer.
    Hold {
        on: bool,
    },
    /// Signals are wanted, or no longer.
    Watch {
        signals: bool,
    },
    /// The trial that was shown is over.
    After {
        ask: PostTrialAction,
    },
    /// Of a study.
    Conduct(StudyRequest),
    Answer(AnswerInput),
    Submit {
        step: usize,
    },
    /// Nothing new, but still there.
    Alive {},
    /// Frames that were on a picture since the last message of this kind.
    Seen {
        frames: Vec<DisplayedFrame>,
    },
    /// To be answered with a `pong` of the same number.
    Ping {
        id: u32,
    },
}

/// A checked message.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum ParsedMessage {
    /// For the testbed.
    Input(ClientInput),
    /// Who is here.
    Join(String),
    /// Drives from now on.
    TakeOver,
    /// The page has drawn.
    Drawn,
    /// A sign of life.
    Alive,
    /// Signals are wanted, or no longer.
    Watch(bool),
    /// Frames were on a picture.
    Seen(Vec<DisplayedFrame>),
    /// To be answered.
    Ping(u32),
}

/// Parses one text message.
///
/// # Errors
/// One sentence for the person who wrote the client: what was wrong, got, expected.
pub(crate) fn parse(text: &str) -> Result<ParsedMessage, String> {
    let message: ClientMessage = serde_json::from_str(text).map_err(|error| {
        format!(
            "message ignored: {error}; expected a JSON object with type gesture, gaze, trunk, head, controller, restart, study, \
             gaze_check, join, take_over, drawn, hold, watch, after, conduct, answer, submit, alive, seen or ping"
        )
    })?;
    match message {
        ClientMessage::Gesture { gesture } => Ok(ParsedMessage::Input(ClientInput::Gesture(gesture))),
        ClientMessage::Gaze { origin, direction, measured } => {
            parse_gaze(origin, direction, measured).map(ParsedMessage::Input)
        }
        ClientMessage::Head { position, quaternion } => {
            parse_head(position, quaternion).map(ParsedMessage::Input)
        }
        ClientMessage::Controller(pose) => parse_controller(pose).map(ParsedMessage::Input),
        ClientMessage::Trunk { forward, lateral, axial } => {
            for (name, angle) in [("forward", forward), ("lateral", lateral), ("axial", axial)] {
                let sane = angle.abs() <= MAX_TRUNK_ANGLE_RAD;
                if !sane {
                    return Err(format!(
                        "message ignored: trunk {name} is {angle}, expected at most {MAX_TRUNK_ANGLE_RAD:.3} rad"
                    ));
                }
            }
            Ok(ParsedMessage::Input(ClientInput::Trunk(TrunkPosture { forward, lateral, axial })))
        }
        ClientMessage::Restart { method, same_seed: again } => {
            Ok(ParsedMessage::Input(ClientInput::Restart { method, same_seed: again }))
        }
        ClientMessage::Study { action } => Ok(ParsedMessage::Input(ClientInput::Study(action))),
        ClientMessage::GazeCheck(check) => {
            check.validate().map_err(|reason| format!("message ignored: {reason}"))?;
            Ok(ParsedMessage::Input(ClientInput::GazeCheck(check)))
        }
        ClientMessage::Join { name } => Ok(ParsedMessage::Join(name)),
        ClientMessage::Hold { on } => Ok(ParsedMessage::Input(ClientInput::Hold(on))),
        ClientMessage::Watch { signals } => Ok(ParsedMessage::Watch(signals)),
        ClientMessage::After { ask } => Ok(ParsedMessage::Input(ClientInput::After(ask))),
        ClientMessage::Conduct(request) => Ok(ParsedMessage::Input(ClientInput::Conduct(request))),
        ClientMessage::Answer(given) => Ok(ParsedMessage::Input(ClientInput::Answer(given))),
        ClientMessage::Submit { step } => Ok(ParsedMessage::Input(ClientInput::Submit { step })),
        ClientMessage::Drawn {} => Ok(ParsedMessage::Drawn),
        ClientMessage::TakeOver {} => Ok(ParsedMessage::TakeOver),
        ClientMessage::Alive {} => Ok(ParsedMessage::Alive),
        ClientMessage::Seen { frames } => Ok(ParsedMessage::Seen(frames)),
        ClientMessage::Ping { id } => Ok(ParsedMessage::Ping(id)),
    }
}

fn check_position(name: &str, point: [f64; 3]) -> Result<Point, String> {
    if point.iter().all(|x| x.abs() <= MAX_DISTANCE_M) {
        return Ok(Point::from(point));
    }
    Err(format!("message ignored: {name} is {point:?}, expected coordinates up to {MAX_DISTANCE_M} m"))
}

fn parse_head(position: [f64; 3], quaternion: [f64; 4]) -> Result<ClientInput, String> {
    let position = check_position("head position", position)?;
    let rotation = Quaternion::from(quaternion);
    let length = rotation.norm();
    if !(length.is_finite() && (length - 1.0).abs() < 1e-3) {
        return Err(format!(
            "message ignored: head quaternion is {quaternion:?}, expected x, y, z, w of length 1"
        ));
    }
    let rotation = UnitQuaternion::from_quaternion(rotation);
    Ok(ClientInput::Head(Pose::from_parts(Translation3::from(position.coords), rotation)))
}

/// What is no rotation is for whoever follows the controller to name.
fn parse_controller(pose: ControllerPose) -> Result<ClientInput, String> {
    check_position("controller position", pose.position)?;
    if !(pose.time_ms >= 0.0 && pose.time_ms < MAX_TIME_MS) {
        return Err(format!(
            "message ignored: controller time_ms is {}, expected 0 to {MAX_TIME_MS:e}",
            pose.time_ms
        ));
    }
    Ok(ClientInput::Controller(pose))
}

fn parse_gaze(origin: [f64; 3], direction: [f64; 3], measured: bool) -> Result<ClientInput, String> {
    let origin = check_position("gaze origin", origin)?;
    let vector = Vector::from(direction);
    let length = vector.norm();
    if !(length.is_finite() && length > 1e-6) {
        return Err(format!(
            "message ignored: gaze direction is {direction:?}, expected a vector above zero"
        ));
    }
    Ok(ClientInput::Gaze { origin, direction: vector / length, measured })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_kind_of_message_is_understood() {
        let cases: [(&str, Option<ClientInput>); 11] = [
            (
                r#"{"type":"controller","hand":"right","time_ms":16.5,"position":[1,2,1.4],"quaternion":[0,0,0,1],"tracked":false}"#,
                Some(ClientInput::Controller(ControllerPose {
                    hand: Side::Right,
                    time_ms: 16.5,
                    position: [1.0, 2.0, 1.4],
                    quaternion: [0.0, 0.0, 0.0, 1.0],
                    tracked: false,
                })),
            ),
            (
                r#"{"type":"gesture","gesture":"wrist_extension"}"#,
                Some(ClientInput::Gesture(Command::WristExtension)),
            ),
            (
                r#"{"type":"gaze","origin":[0,0,1],"direction":[0,0,-2]}"#,
                Some(ClientInput::Gaze {
                    origin: Point::new(0.0, 0.0, 1.0),
                    direction: Vector::new(0.0, 0.0, -1.0),
                    measured: false,
                }),
            ),
            (
                r#"{"type":"gaze","origin":[0,0,1],"direction":[0,0,-2],"measured":true}"#,
                Some(ClientInput::Gaze {
                    origin: Point::new(0.0, 0.0, 1.0),
                    direction: Vector::new(0.0, 0.0, -1.0),
                    measured: true,
                }),
            ),
            (
                r#"{"type":"trunk","forward":0.1,"lateral":-0.2,"axial":0.3}"#,
                Some(ClientInput::Trunk(TrunkPosture { forward: 0.1, lateral: -0.2, axial: 0.3 })),
            ),
            (r#"{"type":"restart"}"#, Some(ClientInput::Restart { method: None, same_seed: false })),
            (
                r#"{"type":"restart","method":"B","again":true}"#,
                Some(ClientInput::Restart { method: Some("B".to_owned()), same_seed: true }),
            ),
            (r#"{"type":"study","action":"pause"}"#, Some(ClientInput::Study(StudyAction::Pause))),
            (
                r#"{"type":"head","position":[1,2,3],"quaternion":[0,0,0,1]}"#,
                Some(ClientInput::Head(Pose::translation(1.0, 2.0, 3.0))),
            ),
            (r#"{"type":"alive"}"#, None),
            (
                r#"{"type":"gaze_check","source":"mouse","points":[{"accuracy_deg":0.5,"precision_deg":0.1,
                    "offset_deg":[0.4,-0.3],"lost_share":0,"blinks":1,"samples":60}],"correction_deg":[0.4,-0.3]}"#,
                Some(ClientInput::GazeCheck(GazeCheck {
                    correction_deg: Some([0.4, -0.3]),
                    ..crate::gaze_check::tests::sample_check()
                })),
            ),
        ];
        for (text, expected) in cases {
            assert_eq!(
                parse(text).unwrap(),
                expected.map_or(ParsedMessage::Alive, ParsedMessage::Input),
                "{text}"
            );
        }
        assert_eq!(parse(r#"{"type":"ping","id":7}"#).unwrap(), ParsedMessage::Ping(7));
        assert_eq!(parse(r#"{"type":"watch","signals":true}"#).unwrap(), ParsedMessage::Watch(true));
    }

    #[test]
    fn every_malformed_message_is_refused_with_the_reason() {
        let cases = [
            ("", "EOF"),
            ("[1,2]", "expected"),
            ("nonsense", "expected"),
            (r#"{"type":"fly"}"#, "unknown variant `fly`"),
            (r#"{"type":"gesture","gesture":"wave"}"#, "unknown variant `wave`"),
            (r#"{"type":"gesture"}"#, "missing field `gesture`"),
            (r#"{"type":"gaze","origin":[0,0],"direction":[0,0,1]}"#, "length"),
            (r#"{"type":"gaze","origin":[0,0,1e9],"direction":[0,0,1]}"#, "up to 100 m"),
            (r#"{"type":"gaze","origin":[0,0,1],"direction":[0,0,0]}"#, "above zero"),
            (r#"{"type":"gaze","origin":[0,0,1],"direction":[1e999,0,0]}"#, "out of range"),
            (r#"{"type":"gaze","origin":[0,0,1],"direction":[NaN,0,0]}"#, "expected"),
            (r#"{"type":"gaze","origin":[0,0,1],"direction":[1e300,1e300,0]}"#, "above zero"),
            (r#"{"type":"trunk","forward":9,"lateral":0,"axial":0}"#, "trunk forward is 9"),
            (r#"{"type":"restart","extra":1}"#, "unknown field"),
            (r#"{"type":"study","action":"fly"}"#, "unknown variant"),
            (r#"{"type":"head","position":[1,2,3],"quaternion":[0,0,0,2]}"#, "of length 1"),
            (r#"{"type":"head","position":[1,2,1e9],"quaternion":[0,0,0,1]}"#, "up to 100 m"),
            (r#"{"type":"gaze_check","source":"mouse","points":[]}"#, "1 to 32 points"),
            (
                r#"{"type":"controller","hand":"both","time_ms":1,"position":[1,2,3],"quaternion":[0,0,0,1],"tracked":true}"#,
                "unknown variant `both`",
            ),
            (
                r#"{"type":"controller","hand":"left","time_ms":-1,"position":[1,2,3],"quaternion":[0,0,0,1],"tracked":true}"#,
                "time_ms is -1",
            ),
            (r#"{"type":"ping","id":-1}"#, "expected u32"),
        ];
        for (text, part) in cases {
            let error = parse(text).unwrap_err();
            assert!(error.contains(part), "{text:?} gave {error:?}, expected {part:?} in it");
        }
    }
}
