//! ROS messages and their definitions, and the calls between nodes and their master.

use super::{TargetFn, utf8_text};
use proact_messages::{MessageType, Ros2Message, RosVersion, Time, builtin_types};
use std::{path::Path, sync::Arc};
use xml_rpc::text::{read_call, read_response, write_call, write_response};

/// A definition as a connection or a bag carries it; with it an empty message is made, written and read.
pub(super) fn definition(_: &Path) -> TargetFn {
    Box::new(|bytes| {
        let Some(Ok(kind)) = utf8_text(bytes).map(|text| MessageType::from_text("lab_msgs/Fuzz", text))
        else {
            return;
        };
        assert!(!kind.md5().is_empty());
        let value = kind.default_value(Time::default());
        let Ok(written) = kind.to_bytes(&value) else { return };
        assert_eq!(kind.from_bytes(&written).as_ref(), Ok(&value), "{}", kind.full_text());
    })
}

/// What is read from bytes is written as the same bytes again.
pub(super) fn bytes(_: &Path) -> TargetFn {
    let kinds: Vec<&Arc<MessageType>> = builtin_types().collect();
    Box::new(move |bytes| {
        let [number, message @ ..] = bytes else { return };
        let kind = kinds[usize::from(*number) % kinds.len()];
        let Ok(value) = kind.from_bytes(message) else { return };
        let written = kind.to_bytes(&value).expect("a value that was read can be written");
        let again = kind.from_bytes(&written).expect("and read again");
        // Compared as bytes: what is not a number does not equal itself.
        assert_eq!(kind.to_bytes(&again).ok().as_ref(), Some(&written), "{}", kind.name);
        let _ = serde_json::to_string(&value);
        for convention in [RosVersion::Ros1, RosVersion::Ros2] {
            let _ = value.to_cbor(Some(kind), convention);
        }
        let _ = serde_json::to_string(&Ros2Message { value: &value, kind: Some(kind) });
    })
}

pub(super) fn json(_: &Path) -> TargetFn {
    Box::new(|bytes| {
        let Some((name, json)) = utf8_text(bytes).and_then(|text| text.split_once('\n')) else { return };
        let Some(kind) = builtin_types().find(|kind| kind.name == name) else { return };
        let Ok(json) = serde_json::from_str(json) else { return };
        let Ok(value) = kind.parse_json(json, Time::default()) else { return };
        let written = kind.to_bytes(&value).expect("a value that was read can be written");
        kind.from_bytes(&written).expect("and read again");
    })
}

/// A call as a node's server reads it; what was read can be sent on.
pub(super) fn xml_rpc_call(_: &Path) -> TargetFn {
    Box::new(|bytes| {
        let Some(Ok((name, params))) = utf8_text(bytes).map(read_call) else { return };
        // Not compared: the members of a struct have no order, and what is not a number does not equal itself.
        let (again, _) = read_call(&write_call(&name, &params)).expect("what was written can be read");
        assert_eq!(again, name);
    })
}

/// What a master or another node answers.
pub(super) fn xml_rpc_response(_: &Path) -> TargetFn {
    Box::new(|bytes| {
        let Some(Ok(answer)) = utf8_text(bytes).map(read_response) else { return };
        let again = read_response(&write_response(&answer)).expect("what was written can be read");
        assert_eq!(again.is_ok(), answer.is_ok());
    })
}
