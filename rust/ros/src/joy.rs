//! The original's joystick as gestures.

use proact_types::Gesture;

/// A stick counts as pushed beyond this share of its way.
const PUSHED: f32 = 0.5;
/// Closes and opens the hand.
const GRASP: usize = 4;
/// Locks a block (C, D).
const PICK: usize = 10;
/// Goes to the next joint or axis (A, B); locks a place (C, D).
const MODE: usize = 11;
/// Forward and back: moves (A, B); forward executes (C, D).
const STICK: usize = 1;

/// The gesture that a state of the joystick stands for. `gazes`: the method selects by gaze (C, D). `closed`: the hand
/// is closed; the grasp button then opens it where a gesture of its own does that. Buttons go before the stick;
/// buttons and axes that the device lacks count as not pressed.
pub fn gesture(axes: &[f32], buttons: &[i32], gazes: bool, closed: bool) -> Gesture {
    let pressed = |k: usize| buttons.get(k).is_some_and(|value| *value != 0);
    let stick = axes.get(STICK).copied().unwrap_or(0.0);
    if pressed(GRASP) {
        // In A and B the gesture toggles by itself.
        return if gazes && closed { Gesture::HandOpen } else { Gesture::HandClose };
    }
    if pressed(PICK) && gazes {
        return Gesture::WristFlexion;
    }
    if pressed(MODE) {
        return if gazes { Gesture::WristFlexion } else { Gesture::HandOpen };
    }
    if stick > PUSHED {
        Gesture::WristExtension
    } else if stick < -PUSHED && !gazes {
        Gesture::WristFlexion
    } else {
        Gesture::NoMotion
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn button(k: usize) -> Vec<i32> {
        (0..12).map(|b| i32::from(b == k)).collect()
    }

    #[test]
    fn buttons_and_stick_stand_for_the_originals_commands() {
        let closed = [false, true];
        for hand in closed {
            assert_eq!(gesture(&[0.0, 1.0], &[], true, hand), Gesture::WristExtension);
            assert_eq!(gesture(&[0.0, -1.0], &[], true, hand), Gesture::NoMotion, "C and D only go ahead");
            assert_eq!(gesture(&[0.0, -1.0], &[], false, hand), Gesture::WristFlexion);
            assert_eq!(gesture(&[], &button(MODE), false, hand), Gesture::HandOpen);
            assert_eq!(gesture(&[], &button(MODE), true, hand), Gesture::WristFlexion);
            assert_eq!(gesture(&[], &button(PICK), true, hand), Gesture::WristFlexion);
            assert_eq!(gesture(&[0.0, 1.0], &button(GRASP), false, hand), Gesture::HandClose);
        }
        assert_eq!(
            closed.map(|c| gesture(&[], &button(GRASP), true, c)),
            [Gesture::HandClose, Gesture::HandOpen]
        );
    }

    #[test]
    fn a_device_with_fewer_buttons_or_a_stick_at_rest_does_nothing() {
        assert_eq!(gesture(&[], &[], true, false), Gesture::NoMotion);
        assert_eq!(gesture(&[0.0, 0.3], &[0; 4], false, true), Gesture::NoMotion);
        assert_eq!(gesture(&[0.0, f32::NAN], &[], false, true), Gesture::NoMotion);
    }
}
