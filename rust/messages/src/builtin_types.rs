//! Types that are known without a ROS installation.

use crate::{
    definition::{DefinitionError, MessageType},
    ros2::ros1_name,
};
use std::{
    collections::BTreeMap,
    sync::{Arc, LazyLock},
};

/// The types of `messages.txt`.
static BUILTIN_TYPES: LazyLock<BTreeMap<String, Arc<MessageType>>> =
    LazyLock::new(|| read_table(include_str!("messages.txt")).expect("the table is tested line by line"));

/// A table with a type in each line; a type stands below those that it needs.
fn read_table(table: &str) -> Result<BTreeMap<String, Arc<MessageType>>, DefinitionError> {
    let mut known: BTreeMap<String, Arc<MessageType>> = BTreeMap::new();
    for line in table.lines().filter(|line| !line.starts_with('#')) {
        let (name, lines) = line.split_once(':').unwrap_or((line, ""));
        let parsed = MessageType::parse(name, &lines.replace(',', "\n"), &mut |needed| {
            known.get(needed).cloned().ok_or_else(|| DefinitionError {
                type_name: name.to_owned(),
                text: needed.to_owned(),
                reason: "it is not above in the table".to_owned(),
            })
        })?;
        known.insert(name.to_owned(), Arc::new(parsed));
    }
    Ok(known)
}

/// A type that is known without a ROS installation, by its name in either spelling.
pub fn builtin_type(name: &str) -> Option<Arc<MessageType>> {
    BUILTIN_TYPES.get(&ros1_name(name)).cloned()
}

/// All of them, by name.
pub fn builtin_types() -> impl Iterator<Item = &'static Arc<MessageType>> {
    BUILTIN_TYPES.values()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::definition::ArrayKind;

    #[test]
    fn the_table_is_read_whole_and_keeps_the_order_of_the_fields() {
        assert!(builtin_types().count() > 60);
        let state = builtin_type("sensor_msgs/msg/JointState").unwrap();
        let names: Vec<&str> = state.fields.iter().map(|field| &*field.name).collect();
        assert_eq!(names, ["header", "name", "position", "velocity", "effort"]);
        assert_eq!(state.fields[1].count, ArrayKind::Variable);
        assert_eq!(state.fields[0].kind.name(), "std_msgs/Header");
        assert_eq!(builtin_type("std_msgs/Nothing"), None);
        assert!(read_table("a/B: C c").unwrap_err().to_string().contains("a/C"));
    }

    /// `tests/bag/sums.py` writes this list from ROS's own packages.
    #[test]
    fn the_sum_of_every_known_type_is_that_of_ros() {
        let sums: BTreeMap<&str, &str> =
            include_str!("checksums.txt").lines().filter_map(|line| line.split_once(' ')).collect();
        for kind in builtin_types() {
            assert_eq!(Some(&kind.md5()), sums.get(kind.name.as_str()), "{}", kind.name);
        }
    }
}
