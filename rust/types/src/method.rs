use crate::{Command, EventKind, ObjectId};
use serde::{Deserialize, Serialize};

/// Longest name of a method, bytes: it is part of a trial directory's name.
pub const MAX_METHOD_NAME_BYTES: usize = 32;
/// Longest text that a method gives for display, bytes.
pub const MAX_METHOD_TEXT_BYTES: usize = 400;

/// What is told of a control method to those who choose it, show it, or act in the place of a person.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(deny_unknown_fields)]
pub struct MethodInfo {
    /// By which it is chosen, and called in results and records, such as `D`: letters, digits, `_` and `-`.
    pub name: String,
    /// As shown, such as `gaze and context`.
    pub title: String,
    /// What it cannot do without.
    #[serde(default)]
    pub needs: MethodNeeds,
    /// How a person drives it.
    #[serde(default)]
    pub style: MethodStyle,
    /// What the page says of it.
    #[serde(default)]
    pub help: MethodHelp,
}

/// What a method cannot do without.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(default, deny_unknown_fields)]
pub struct MethodNeeds {
    /// Gaze: a trial without a source of it is refused, and the arm stops when the eye tracker dies.
    pub gaze: bool,
    /// The task's context has a say in the posterior.
    pub prior: bool,
    /// It asks for plans. There is no speed to blend then.
    pub plans: bool,
    /// It drives every joint of the arm: a profile whose level leaves joints to the person's limb is refused.
    pub whole_arm: bool,
    /// The tracked limb of the person: a profile whose level leaves no joint to the limb is refused.
    pub limb: bool,
}

/// How a person drives a method. The page's hints and the simulated participant go by it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(rename_all = "snake_case")]
pub enum MethodStyle {
    /// By moving one joint or axis after the other: HO cycles, WE and WF move, HC toggles the hand.
    #[default]
    Jogging,
    /// By looking at what is meant: WE goes there, WF locks, HC closes the hand, HO opens it.
    Selecting,
    /// By moving the own limb, which the whole arm follows: HC closes the hand, HO opens it.
    Imitating,
}

/// What the page says of a method. Empty texts leave the page's own.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(default, deny_unknown_fields)]
pub struct MethodHelp {
    /// One sentence.
    pub summary: String,
    /// What HC does, in a word or two.
    pub hand_close: String,
    /// What HO does.
    pub hand_open: String,
    /// What WE does.
    pub wrist_extension: String,
    /// What WF does.
    pub wrist_flexion: String,
}

impl MethodHelp {
    /// The texts with the names of their keys.
    pub fn texts(&self) -> [(&'static str, &str); 5] {
        let of = |command: Command, text| (command.ros_name(), text);
        [
            ("summary", self.summary.as_str()),
            of(Command::HandClose, self.hand_close.as_str()),
            of(Command::HandOpen, self.hand_open.as_str()),
            of(Command::WristExtension, self.wrist_extension.as_str()),
            of(Command::WristFlexion, self.wrist_flexion.as_str()),
        ]
    }
}

/// What a method may say that has happened: its own affairs, and nothing of the world, the task or the sources.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "event", rename_all = "snake_case", deny_unknown_fields)]
pub enum MethodEvent {
    /// The selection of an object or a place was locked.
    Locked {
        /// The object, or none for a place.
        object: Option<ObjectId>,
    },
    /// The lock was taken off.
    Unlocked,
    /// The arm stopped before the end of its trajectory.
    MotionStopped,
    /// The trajectory was followed to its end.
    MotionFinished,
    /// Anything else, in words of its own.
    Note {
        /// At most [`MAX_METHOD_TEXT_BYTES`], without control characters.
        text: String,
    },
}

impl From<MethodEvent> for EventKind {
    fn from(event: MethodEvent) -> Self {
        match event {
            MethodEvent::Locked { object } => EventKind::Locked { object },
            MethodEvent::Unlocked => EventKind::Unlocked,
            MethodEvent::MotionStopped => EventKind::MotionStopped,
            MethodEvent::MotionFinished => EventKind::MotionFinished,
            MethodEvent::Note { text } => EventKind::MethodNote { text },
        }
    }
}
