//! What is asked of services whose types are known here: a call's arguments by name, checked.

use proact_messages::{MessageType, Time, plain_name};
use serde_json::{Map, Value as Json};
use std::{
    collections::BTreeMap,
    sync::{Arc, LazyLock},
};

/// Fields of the requests, as in the first half of a `.srv` file.
const REQUESTS: [(&str, &str); 27] = [
    ("rosapi/ActionServers", ""),
    ("rosapi/DeleteParam", "string name"),
    ("rosapi/GetParam", "string name\nstring default"),
    ("rosapi/GetParamNames", ""),
    ("rosapi/GetRosVersion", ""),
    ("rosapi/GetTime", ""),
    ("rosapi/HasParam", "string name"),
    ("rosapi/MessageDetails", "string type"),
    ("rosapi/NodeDetails", "string node"),
    ("rosapi/Nodes", ""),
    ("rosapi/Publishers", "string topic"),
    ("rosapi/ServiceHost", "string service"),
    ("rosapi/ServiceNode", "string service"),
    ("rosapi/ServiceProviders", "string service"),
    ("rosapi/ServiceType", "string service"),
    ("rosapi/Services", ""),
    ("rosapi/ServicesForType", "string type"),
    ("rosapi/SetParam", "string name\nstring value"),
    ("rosapi/Subscribers", "string topic"),
    ("rosapi/TopicType", "string topic"),
    ("rosapi/Topics", ""),
    ("rosapi/TopicsAndRawTypes", ""),
    ("rosapi/TopicsForType", "string type"),
    ("shoulder_localization/fixWorld", "bool fixWorld"),
    ("std_srvs/Empty", ""),
    ("std_srvs/SetBool", "bool data"),
    ("std_srvs/Trigger", ""),
];

static KNOWN: LazyLock<BTreeMap<&str, Arc<MessageType>>> = LazyLock::new(|| {
    let request = |(name, text): (&'static str, &str)| {
        let kind = MessageType::load(&format!("{name}Request"), text, &|_| None);
        (name, kind.expect("the table has fields of plain kinds only"))
    };
    REQUESTS.into_iter().map(request).collect()
});

/// The request of a service type, if it is known.
pub(crate) fn known(type_name: &str) -> Option<Arc<MessageType>> {
    KNOWN.get(&*plain_name(&type_name.replacen("/srv/", "/", 1))).cloned()
}

/// The arguments of a call by name. Those of a known type are checked, and may be a list in the order of its fields; what
/// is left out gets zero, empty or false.
///
/// # Errors
/// One sentence.
pub(crate) fn named(request: Option<&MessageType>, arguments: Json) -> Result<Json, String> {
    let arguments = match arguments {
        Json::Null => Json::Object(Map::new()),
        Json::Array(_) | Json::Object(_) => arguments,
        other => return Err(format!("the arguments are {other}, expected an object or a list")),
    };
    let Some(request) = request else { return Ok(arguments) };
    let by_name = match arguments {
        Json::Array(values) if values.len() > request.fields.len() => {
            let names: Vec<&str> = request.fields.iter().map(|field| &*field.name).collect();
            return Err(format!(
                "got {} arguments, expected at most {}: {names:?}",
                values.len(),
                names.len()
            ));
        }
        Json::Array(values) => {
            let names = request.fields.iter().map(|field| field.name.to_string());
            Json::Object(names.zip(values).collect())
        }
        named => named,
    };
    let value = request.read(by_name, Time::default()).map_err(|error| error.to_string())?;
    serde_json::to_value(value).map_err(|error| error.to_string())
}
