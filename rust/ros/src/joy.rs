//! The original's joystick as gestures.

use proact_types::Command;

/// A stick counts as pushed beyond this share of its way.
const STICK_THRESHOLD: f32 = 0.5;
/// Closes and opens the hand.
const GRASP_BUTTON: usize = 4;
/// Locks a block (C, D).
const PICK_BUTTON: usize = 10;
/// Goes to the next joint or axis (A, B); locks a place (C, D).
const MODE_BUTTON: usize = 11;
/// Forward and back: moves (A, B); forward executes (C, D).
const STICK_AXIS: usize = 1;

/// The gesture that a state of the joystick stands for. `gazes`: the method selects by gaze (C, D). `closed`: the hand
/// is closed; the grasp button then opens it where a gesture of its own does that. Buttons go before the stick;
/// buttons and axes that the device lacks count as not pressed.
pub fn gesture_from_joystick(axes: &[f32], buttons: &[i32], gazes: bool, closed: bool) -> Command {
    let pressed = |k: usize| buttons.get(k).is_some_and(|value| *value != 0);
    let stick = axes.get(STICK_AXIS).copied().unwrap_or(0.0);
    if pressed(GRASP_BUTTON) {
        // In A and B the gesture toggles by itself.
        return if gazes && closed { Command::HandOpen } else { Command::HandClose };
    }
    if pressed(PICK_BUTTON) && gazes {
        return Command::WristFlexion;
    }
    if pressed(MODE_BUTTON) {
        return if gazes { Command::WristFlexion } else { Command::HandOpen };
    }
    if stick > STICK_THRESHOLD {
        Command::WristExtension
    } else if stick < -STICK_THRESHOLD && !gazes {
        Command::WristFlexion
    } else {
        Command::NoMotion
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
            assert_eq!(gesture_from_joystick(&[0.0, 1.0], &[], true, hand), Command::WristExtension);
            assert_eq!(
                gesture_from_joystick(&[0.0, -1.0], &[], true, hand),
                Command::NoMotion,
                "C and D only go ahead"
            );
            assert_eq!(gesture_from_joystick(&[0.0, -1.0], &[], false, hand), Command::WristFlexion);
            assert_eq!(gesture_from_joystick(&[], &button(MODE_BUTTON), false, hand), Command::HandOpen);
            assert_eq!(gesture_from_joystick(&[], &button(MODE_BUTTON), true, hand), Command::WristFlexion);
            assert_eq!(gesture_from_joystick(&[], &button(PICK_BUTTON), true, hand), Command::WristFlexion);
            assert_eq!(
                gesture_from_joystick(&[0.0, 1.0], &button(GRASP_BUTTON), false, hand),
                Command::HandClose
            );
        }
        assert_eq!(
            closed.map(|c| gesture_from_joystick(&[], &button(GRASP_BUTTON), true, c)),
            [Command::HandClose, Command::HandOpen]
        );
    }

    #[test]
    fn a_device_with_fewer_buttons_or_a_stick_at_rest_does_nothing() {
        assert_eq!(gesture_from_joystick(&[], &[], true, false), Command::NoMotion);
        assert_eq!(gesture_from_joystick(&[0.0, 0.3], &[0; 4], false, true), Command::NoMotion);
        assert_eq!(gesture_from_joystick(&[0.0, f32::NAN], &[], false, true), Command::NoMotion);
    }
}
