use crate::{Command, Gesture};
use std::collections::BTreeMap;

/// Why gestures and commands do not go together.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum CommandMapError {
    /// An entry for a gesture that the model does not tell apart.
    #[error("gestures.{gesture:?} = {command:?}, but the EMG model has no such gesture; it has {known}")]
    UnknownGesture {
        /// As in the table.
        gesture: Gesture,
        /// What it should do.
        command: Command,
        /// What there is.
        known: String,
    },
    /// The gesture of a relaxed hand would move something.
    #[error(
        "gestures.{gesture:?} = {command:?}, but {gesture} is the rest gesture of the EMG model, which stops the arm; \
         leave the entry out"
    )]
    RestHasCommand {
        /// The rest gesture.
        gesture: Gesture,
        /// What it should do.
        command: Command,
    },
}

/// What the gestures of an EMG model are to a control method: the command of the table, else the command of the same
/// name, else nothing ([`Command::NoMotion`]).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CommandMap {
    rest: Gesture,
    /// Each gesture of the model with its command; none for one that does nothing.
    commands: Vec<(Gesture, Option<Command>)>,
}

impl CommandMap {
    /// The commands of the gestures `known`, of which `rest` is that of a relaxed hand, by `table`.
    ///
    /// # Errors
    /// An entry for a gesture that is not known, or one that gives the rest gesture another command than
    /// [`Command::NoMotion`].
    pub fn new(
        known: &[Gesture],
        rest: Gesture,
        table: &BTreeMap<Gesture, Command>,
    ) -> Result<Self, CommandMapError> {
        for (&gesture, &command) in table {
            if !known.contains(&gesture) {
                let known = known.iter().map(Gesture::as_str).collect::<Vec<_>>().join(", ");
                return Err(CommandMapError::UnknownGesture { gesture, command, known });
            }
            if gesture == rest && command != Command::NoMotion {
                return Err(CommandMapError::RestHasCommand { gesture, command });
            }
        }
        let command = |name: &Gesture| {
            let mapped = if *name == rest { Some(Command::NoMotion) } else { table.get(name).copied() };
            (*name, mapped.or_else(|| name.same_named_command()))
        };
        Ok(Self { rest, commands: known.iter().map(command).collect() })
    }

    /// What `gesture` asks the method for; nothing for a gesture that is not the model's.
    pub fn command(&self, gesture: Gesture) -> Command {
        let found = self.commands.iter().find(|(name, _)| *name == gesture);
        found.and_then(|(_, command)| *command).unwrap_or_default()
    }

    /// The gesture by which a person gives `command`: that of the same name where it does that, else the first of the
    /// model that does, else rest.
    pub fn gesture_for(&self, command: Command) -> Gesture {
        if command == Command::NoMotion {
            return self.rest;
        }
        let mut of_command = self.commands.iter().filter(|(_, does)| *does == Some(command));
        let first = of_command.clone().next();
        let namesake = of_command.find(|(name, _)| *name == command);
        namesake.or(first).map_or(self.rest, |(name, _)| *name)
    }

    /// One sentence on the gestures that do nothing and the commands that no gesture gives; none if there are neither.
    pub fn describe_unmapped(&self) -> Option<String> {
        let idle = self.commands.iter().filter(|(_, command)| command.is_none());
        let idle: Vec<&str> = idle.map(|(name, _)| name.as_str()).collect();
        let given = |command: &Command| self.commands.iter().any(|(_, does)| *does == Some(*command));
        let missing = Command::ALL.into_iter().filter(|g| *g != Command::NoMotion && !given(g));
        let missing: Vec<&str> = missing.map(Command::ros_name).collect();
        let parts = [
            (!idle.is_empty()).then(|| format!("these gestures do nothing: {}", idle.join(", "))),
            (!missing.is_empty()).then(|| format!("no gesture gives {}", missing.join(", "))),
        ];
        let parts: Vec<String> = parts.into_iter().flatten().collect();
        (!parts.is_empty())
            .then(|| format!("{}; the profile's table [gestures] changes that", parts.join("; ")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use Command::{HandClose, HandOpen, NoMotion, WristExtension};

    fn name(text: &str) -> Gesture {
        text.parse().unwrap()
    }

    fn names(texts: &[&str]) -> Vec<Gesture> {
        texts.iter().map(|text| name(text)).collect()
    }

    #[test]
    fn the_table_comes_before_the_name_and_what_has_neither_does_nothing() {
        let known = names(&["fist", "hand_open", "pinch", "relax", "wave"]);
        let table =
            [(name("fist"), HandClose), (name("hand_open"), WristExtension), (name("wave"), HandOpen)];
        let commands = CommandMap::new(&known, name("relax"), &table.into()).unwrap();
        let of = |text| commands.command(name(text));
        assert_eq!(
            ["fist", "hand_open", "pinch", "relax", "wave", "unheard"].map(of),
            [HandClose, WristExtension, NoMotion, NoMotion, HandOpen, NoMotion]
        );
        let made = |command| commands.gesture_for(command);
        assert_eq!(
            [HandClose, HandOpen, NoMotion, WristExtension, Command::WristFlexion].map(made).to_vec(),
            names(&["fist", "wave", "relax", "hand_open", "relax"])
        );
        let remark = commands.describe_unmapped().unwrap();
        assert!(remark.contains("do nothing: pinch; no gesture gives wrist_flexion;"), "{remark}");
    }

    #[test]
    fn the_five_are_themselves_and_there_is_nothing_to_remark() {
        let five = Command::ALL.map(Gesture::from);
        let commands = CommandMap::new(&five, five[2], &BTreeMap::new()).unwrap();
        for gesture in Command::ALL {
            assert_eq!(
                (commands.command(gesture.into()), commands.gesture_for(gesture)),
                (gesture, gesture.into())
            );
        }
        assert_eq!(commands.describe_unmapped(), None);
        // A second gesture for a command does not take the place of its namesake.
        let both = names(&["fist", "hand_close", "no_motion"]);
        let commands = CommandMap::new(&both, five[2], &[(both[0], HandClose)].into()).unwrap();
        assert_eq!((commands.command(both[0]), commands.gesture_for(HandClose)), (HandClose, both[1]));
    }

    #[test]
    fn entries_that_cannot_act_are_refused() {
        let known = names(&["fist", "relax"]);
        let refused = |gesture: &str, command| {
            CommandMap::new(&known, known[1], &[(name(gesture), command)].into()).unwrap_err().to_string()
        };
        let text = refused("wave", HandOpen);
        assert!(text.contains("\"wave\"") && text.contains("it has fist, relax"), "{text}");
        assert!(refused("relax", HandClose).contains("relax is the rest gesture"));
        assert!(CommandMap::new(&known, known[1], &[(known[1], NoMotion)].into()).is_ok());
    }
}
