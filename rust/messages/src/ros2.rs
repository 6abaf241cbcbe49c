//! The same messages as ROS 2 writes them: names of types with `msg`, times as `sec` and `nanosec`, headers without `seq`.
//!
//! Fields that only ROS 2 has are not added, and types that only ROS 2 has are not known.

use crate::{
    definition::{FieldType, MessageField, MessageType},
    value::{Duration, MessageValue, Time},
};
use base64::{display::Base64Display, engine::general_purpose::STANDARD as BASE64};
use serde::{
    Serialize, Serializer,
    ser::{Error, SerializeMap},
};
use serde_json::{Map, Value as Json, json};

/// Which ROS a client writes and reads like.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum RosVersion {
    /// `std_msgs/Header`, with `seq`, `secs` and `nsecs`.
    #[default]
    Ros1,
    /// `std_msgs/msg/Header`, with `sec` and `nanosec`.
    Ros2,
}

/// What a name of a type names. ROS 2 has it in the middle.
const INTERFACES: [&str; 3] = ["msg", "srv", "action"];
/// Fields that ROS 2 has under other names: type, name in ROS 1, name in ROS 2.
const RENAMED_FIELDS: [(&str, &str, &str); 4] = [
    ("sensor_msgs/CameraInfo", "D", "d"),
    ("sensor_msgs/CameraInfo", "K", "k"),
    ("sensor_msgs/CameraInfo", "R", "r"),
    ("sensor_msgs/CameraInfo", "P", "p"),
];

impl RosVersion {
    /// That of a name of a type: `std_msgs/msg/String` is ROS 2's, anything else ROS 1's.
    pub fn from_type_name(name: &str) -> Self {
        if split_type_name(name).is_some() { Self::Ros2 } else { Self::Ros1 }
    }
}

fn split_type_name(name: &str) -> Option<(&str, &str)> {
    let (package, rest) = name.split_once('/')?;
    let (interface, short) = rest.split_once('/')?;
    (INTERFACES.contains(&interface) && !package.is_empty() && !short.is_empty()).then_some((package, short))
}

/// The name as ROS 1 has it: `std_msgs/msg/String`, `std_srvs/srv/Trigger` and `lab/action/Move`, as newer clients write,
/// lose the middle.
pub fn ros1_name(name: &str) -> String {
    match split_type_name(name) {
        Some((package, short)) => format!("{package}/{short}"),
        None => name.to_owned(),
    }
}

/// The name as ROS 2 has it, `interface` being `msg`, `srv` or `action`. What is no name of a type stays as it is.
pub fn ros2_name(name: &str, interface: &str) -> String {
    match name.split_once('/') {
        Some((package, short)) if !short.contains('/') => format!("{package}/{interface}/{short}"),
        _ => name.to_owned(),
    }
}

/// The name in ROS 2 of a field that ROS 1 calls otherwise.
pub(crate) fn renamed_field(type_name: &str, field: &str) -> Option<&'static str> {
    let found = RENAMED_FIELDS.iter().find(|(of, name, _)| *of == type_name && *name == field);
    found.map(|(_, _, name)| *name)
}

/// Whether a field of `type_name` makes its messages differ between the two.
pub(crate) fn field_differs(type_name: &str, field: &str, kind: &FieldType) -> bool {
    renamed_field(type_name, field).is_some()
        || match kind {
            FieldType::Time | FieldType::Duration => true,
            FieldType::Message(inner) => inner.differs_in_ros2(),
            _ => false,
        }
}

/// The fields of a message that ROS 2 has too, under its names.
pub(crate) fn ros2_fields<'a>(
    values: &'a [(std::sync::Arc<str>, MessageValue)],
    kind: &'a MessageType,
) -> impl Iterator<Item = (&'a str, &'a MessageValue, &'a MessageField)> {
    let header = kind.name == "std_msgs/Header";
    values
        .iter()
        .zip(&kind.fields)
        .filter(move |((name, _), _)| !(header && &**name == "seq"))
        .map(move |((name, value), field)| (renamed_field(&kind.name, name).unwrap_or(name), value, field))
}

/// Whole seconds, and nanoseconds that are never negative.
pub(crate) fn time_parts(value: &MessageValue) -> Option<(i64, i64)> {
    match value {
        MessageValue::Time(Time { secs, nsecs }) => Some(((*secs).into(), (*nsecs).into())),
        MessageValue::Duration(Duration { secs, nsecs }) => {
            let (secs, nsecs) = (i64::from(*secs), i64::from(*nsecs));
            Some((secs + nsecs.div_euclid(1_000_000_000), nsecs.rem_euclid(1_000_000_000)))
        }
        _ => None,
    }
}

/// A message that is written as ROS 2 has it; without its type, as far as its shape shows.
#[derive(Clone, Copy, Debug)]
pub struct Ros2Message<'a> {
    /// The message.
    pub value: &'a MessageValue,
    /// Its type, if it is known.
    pub kind: Option<&'a MessageType>,
}

impl Serialize for Ros2Message<'_> {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        match (self.value, self.kind) {
            (MessageValue::Message(values), Some(kind)) => to.collect_map(
                ros2_fields(values, kind).map(|(name, value, field)| (name, Ros2Field { value, field })),
            ),
            (MessageValue::Opaque(json), _) => ros2_json(json.clone()).serialize(to),
            (MessageValue::Message(_), None) => {
                ros2_json(serde_json::to_value(self.value).map_err(S::Error::custom)?).serialize(to)
            }
            (value, _) => value.serialize(to),
        }
    }
}

/// A field's value.
struct Ros2Field<'a> {
    value: &'a MessageValue,
    field: &'a MessageField,
}

impl Serialize for Ros2Field<'_> {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        let single = |value| match &self.field.kind {
            FieldType::Message(inner) => Ros2Value { value, kind: Some(inner) },
            _ => Ros2Value { value, kind: None },
        };
        match self.value {
            MessageValue::Bytes(bytes) if to.is_human_readable() => {
                to.collect_str(&Base64Display::new(bytes, &BASE64))
            }
            MessageValue::List(values) => to.collect_seq(values.iter().map(single)),
            value => single(value).serialize(to),
        }
    }
}

struct Ros2Value<'a> {
    value: &'a MessageValue,
    kind: Option<&'a MessageType>,
}

impl Serialize for Ros2Value<'_> {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        match time_parts(self.value) {
            Some((sec, nanosec)) => {
                let mut map = to.serialize_map(Some(2))?;
                map.serialize_entry("sec", &sec)?;
                map.serialize_entry("nanosec", &nanosec)?;
                map.end()
            }
            None => Ros2Message { value: self.value, kind: self.kind }.serialize(to),
        }
    }
}

/// JSON of ROS 1 as ROS 2 has it, by its shape: what has the keys `secs` and `nsecs` and no others is a time, what has `seq`,
/// `stamp` and `frame_id` and no others is a header.
pub fn ros2_json(json: Json) -> Json {
    match json {
        Json::Array(values) => Json::Array(values.into_iter().map(ros2_json).collect()),
        Json::Object(map) => {
            if let (2, Some(secs), Some(nsecs)) = (map.len(), map.get("secs"), map.get("nsecs"))
                && let (Some(secs), Some(nsecs)) = (secs.as_i64(), nsecs.as_i64())
            {
                let sec = secs.saturating_add(nsecs.div_euclid(1_000_000_000));
                return json!({"sec": sec, "nanosec": nsecs.rem_euclid(1_000_000_000)});
            }
            let header =
                map.len() == 3 && ["seq", "stamp", "frame_id"].iter().all(|key| map.contains_key(*key));
            let kept = map.into_iter().filter(|(name, _)| !(header && name == "seq"));
            Json::Object(kept.map(|(name, value)| (name, ros2_json(value))).collect::<Map<_, _>>())
        }
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::builtin_type;

    fn ros2(type_name: &str, json: Json) -> String {
        let kind = builtin_type(type_name).unwrap();
        let value = kind.parse_json(json, Time { secs: 7, nsecs: 8 }).unwrap();
        serde_json::to_string(&Ros2Message { value: &value, kind: Some(&kind) }).unwrap()
    }

    #[test]
    fn names_of_either_ros_are_one_type() {
        for (name, plain) in [
            ("std_msgs/msg/String", "std_msgs/String"),
            ("std_srvs/srv/Trigger", "std_srvs/Trigger"),
            ("control_msgs/action/FollowJointTrajectory", "control_msgs/FollowJointTrajectory"),
        ] {
            assert_eq!(ros1_name(name), plain);
            assert_eq!(RosVersion::from_type_name(name), RosVersion::Ros2);
            assert_eq!(RosVersion::from_type_name(plain), RosVersion::Ros1);
            let interface = name.split('/').nth(1).unwrap();
            assert_eq!(ros2_name(plain, interface), name);
        }
        for name in ["", "/", "String", "a/b/c", "/msg/String", "std_msgs/msg/", "std_msgs//String"] {
            assert_eq!(ros1_name(name), name);
            assert_eq!(RosVersion::from_type_name(name), RosVersion::Ros1);
        }
        assert_eq!(ros2_name("", "msg"), "");
        assert_eq!(ros2_name("std_msgs/msg/String", "msg"), "std_msgs/msg/String");
    }

    #[test]
    fn times_and_headers_are_those_of_ros_2_at_any_depth() {
        assert_eq!(
            ros2("std_msgs/Header", json!({"seq": 5, "frame_id": "a"})),
            r#"{"stamp":{"sec":7,"nanosec":8},"frame_id":"a"}"#
        );
        let text = ros2(
            "trajectory_msgs/JointTrajectory",
            json!({"points": [{"positions": [1.5, null], "time_from_start": {"secs": 1, "nsecs": 2}}, {}]}),
        );
        let point = |positions: &str, time: &str| {
            format!(
                r#"{{"positions":{positions},"velocities":[],"accelerations":[],"effort":[],"time_from_start":{time}}}"#
            )
        };
        let points =
            [point("[1.5,null]", r#"{"sec":1,"nanosec":2}"#), point("[]", r#"{"sec":0,"nanosec":0}"#)];
        assert_eq!(
            text,
            format!(
                r#"{{"header":{{"stamp":{{"sec":7,"nanosec":8}},"frame_id":""}},"joint_names":[],"points":[{}]}}"#,
                points.join(",")
            )
        );
    }

    #[test]
    fn a_duration_below_zero_has_nanoseconds_above_zero() {
        for (given, expected) in [
            (json!({"secs": -1, "nsecs": -500_000_000}), r#"{"data":{"sec":-2,"nanosec":500000000}}"#),
            (json!({"secs": -1, "nsecs": 500_000_000}), r#"{"data":{"sec":-1,"nanosec":500000000}}"#),
            (json!({"sec": -3, "nanosec": 1}), r#"{"data":{"sec":-3,"nanosec":1}}"#),
        ] {
            assert_eq!(ros2("std_msgs/Duration", json!({"data": given.clone()})), expected, "{given}");
        }
    }

    #[test]
    fn fields_with_other_names_are_written_and_read_by_both() {
        let text = ros2("sensor_msgs/CameraInfo", json!({"D": [0.5]}));
        assert!(text.contains(r#""d":[0.5],"k":[0.0,"#) && text.contains(r#""p":["#), "{text}");
        assert!(!text.contains(r#""D""#), "{text}");
        let kind = builtin_type("sensor_msgs/CameraInfo").unwrap();
        let value = kind.parse_json(serde_json::from_str(&text).unwrap(), Time::default()).unwrap();
        assert_eq!(value.get("D"), Some(&MessageValue::Floats(vec![0.5])));
    }

    #[test]
    fn what_ros_2_writes_is_read_again_as_the_same_message() {
        for kind in crate::builtin_types() {
            let value = kind.default_value(Time { secs: 3, nsecs: 4 });
            let text = serde_json::to_string(&Ros2Message { value: &value, kind: Some(kind) }).unwrap();
            let again = kind.parse_json(serde_json::from_str(&text).unwrap(), Time::default()).unwrap();
            assert_eq!(again, value, "{text}");
            // An array without entries is the same in both.
            assert!(kind.differs_in_ros2() || serde_json::to_string(&value).unwrap() == text, "{text}");
        }
    }

    #[test]
    fn without_a_type_the_shape_tells() {
        let header = json!({"seq": 1, "stamp": {"secs": 2, "nsecs": 3}, "frame_id": "f"});
        let given = json!({"header": header, "all": [{"secs": -1, "nsecs": -1}, {"secs": 1}], "seq": 4});
        assert_eq!(
            ros2_json(given),
            json!({
                "header": {"stamp": {"sec": 2, "nanosec": 3}, "frame_id": "f"},
                "all": [{"sec": -2, "nanosec": 999_999_999}, {"secs": 1}],
                "seq": 4,
            })
        );
    }
}
