//! What a browser may ask for, parsed and checked at the door.

use proact_types::{Gesture, Point, TrunkPosture, Vector};
use serde::Deserialize;

/// An eye further than this from the origin of `world` is a mistake, metres.
const MAX_DISTANCE: f64 = 100.0;
/// Largest trunk angle taken over, rad. A bound on nonsense: the body model has its own, tighter limits.
const MAX_TRUNK_ANGLE: f64 = std::f64::consts::FRAC_PI_2;

/// What the person at the page does. All numbers are finite and within sane bounds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ClientInput {
    /// The gesture in force from now on: keys held, or [`Gesture::NoMotion`] when they are released.
    Gesture(Gesture),
    /// Where the person looks, in `world`.
    Gaze {
        /// The eye, metres.
        origin: Point,
        /// Unit vector.
        direction: Vector,
    },
    /// Where the trunk is asked to go.
    Trunk(TrunkPosture),
    /// Begin a new trial.
    Restart,
    /// The client in control is gone; a gesture that it held was released before.
    Disconnected,
}

/// A message of the page on the WebSocket.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub(crate) enum ClientMessage {
    Gesture {
        gesture: Gesture,
    },
    Gaze {
        origin: [f64; 3],
        direction: [f64; 3],
    },
    Trunk {
        forward: f64,
        lateral: f64,
        axial: f64,
    },
    Restart {},
    /// Nothing new, but still there.
    Alive {},
}

/// Parses one text message.
///
/// # Errors
/// One sentence for the person who wrote the client: what was wrong, got, expected.
pub(crate) fn parse(text: &str) -> Result<Option<ClientInput>, String> {
    let message: ClientMessage = serde_json::from_str(text).map_err(|error| {
        format!("message ignored: {error}; expected a JSON object with type gesture, gaze, trunk, restart or alive")
    })?;
    match message {
        ClientMessage::Gesture { gesture } => Ok(Some(ClientInput::Gesture(gesture))),
        ClientMessage::Gaze { origin, direction } => gaze(origin, direction).map(Some),
        ClientMessage::Trunk { forward, lateral, axial } => {
            for (name, angle) in [("forward", forward), ("lateral", lateral), ("axial", axial)] {
                let sane = angle.abs() <= MAX_TRUNK_ANGLE;
                if !sane {
                    return Err(format!(
                        "message ignored: trunk {name} is {angle}, expected at most {MAX_TRUNK_ANGLE:.3} rad"
                    ));
                }
            }
            Ok(Some(ClientInput::Trunk(TrunkPosture { forward, lateral, axial })))
        }
        ClientMessage::Restart {} => Ok(Some(ClientInput::Restart)),
        ClientMessage::Alive {} => Ok(None),
    }
}

fn gaze(origin: [f64; 3], direction: [f64; 3]) -> Result<ClientInput, String> {
    if !origin.iter().all(|x| x.abs() <= MAX_DISTANCE) {
        return Err(format!(
            "message ignored: gaze origin is {origin:?}, expected coordinates up to {MAX_DISTANCE} m"
        ));
    }
    let vector = Vector::from(direction);
    let length = vector.norm();
    if !(length.is_finite() && length > 1e-6) {
        return Err(format!(
            "message ignored: gaze direction is {direction:?}, expected a vector above zero"
        ));
    }
    Ok(ClientInput::Gaze { origin: Point::from(origin), direction: vector / length })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_kind_of_message_is_understood() {
        let cases = [
            (
                r#"{"type":"gesture","gesture":"wrist_extension"}"#,
                Some(ClientInput::Gesture(Gesture::WristExtension)),
            ),
            (
                r#"{"type":"gaze","origin":[0,0,1],"direction":[0,0,-2]}"#,
                Some(ClientInput::Gaze {
                    origin: Point::new(0.0, 0.0, 1.0),
                    direction: Vector::new(0.0, 0.0, -1.0),
                }),
            ),
            (
                r#"{"type":"trunk","forward":0.1,"lateral":-0.2,"axial":0.3}"#,
                Some(ClientInput::Trunk(TrunkPosture { forward: 0.1, lateral: -0.2, axial: 0.3 })),
            ),
            (r#"{"type":"restart"}"#, Some(ClientInput::Restart)),
            (r#"{"type":"alive"}"#, None),
        ];
        for (text, expected) in cases {
            assert_eq!(parse(text).unwrap(), expected, "{text}");
        }
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
        ];
        for (text, part) in cases {
            let error = parse(text).unwrap_err();
            assert!(error.contains(part), "{text:?} gave {error:?}, expected {part:?} in it");
        }
    }
}
