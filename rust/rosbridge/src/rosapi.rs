//! The services of `rosapi` that clients ask for: what topics, services, types and parameters there are.

use crate::{
    actions::action_servers,
    bus::{BusError, MemberId, TopicBus, TopicInfo, check_name},
    services::FunctionService,
};
use proact_messages::{ArrayKind, FieldType, MessageField, MessageType, Time, ros1_name, ros2_name};
use serde_json::{Value as Json, json};
use std::{
    collections::BTreeMap,
    sync::{Arc, Mutex, PoisonError, Weak},
};

/// Most parameters, and most bytes of one.
const MAX_PARAMETERS: usize = 10_000;
const MAX_PARAMETER_BYTES: usize = 64 * 1024;

type Parameters = Mutex<BTreeMap<String, Json>>;

/// Offers the services on a bus, in the name of a member; `clock` is read for `/rosapi/get_time`.
///
/// # Errors
/// [`BusError::TooMany`] if the bus is full.
pub(crate) fn advertise_services(
    bus: &Arc<dyn TopicBus>,
    member: MemberId,
    clock: fn() -> Time,
) -> Result<(), BusError> {
    for (name, question) in GRAPH_QUERIES {
        // The bus owns the service, so the service must not own the bus.
        let weak: Weak<dyn TopicBus> = Arc::downgrade(bus);
        let answer = move |arguments: &Json| {
            let bus = weak.upgrade().ok_or("the bus is closing")?;
            question(&*bus, arguments)
        };
        advertise(bus, member, name, answer)?;
    }
    let time = move |_: &Json| {
        let Time { secs, nsecs } = clock();
        Ok(json!({"time": {"secs": secs, "nsecs": nsecs}}))
    };
    advertise(bus, member, "get_time", time)?;
    let parameters: Arc<Parameters> = Arc::default();
    for (name, question) in PARAMETER_REQUESTS {
        let parameters = Arc::clone(&parameters);
        advertise(bus, member, name, move |arguments: &Json| question(&parameters, arguments))?;
    }
    Ok(())
}

fn advertise(
    bus: &Arc<dyn TopicBus>,
    member: MemberId,
    name: &str,
    answer: impl Fn(&Json) -> Result<Json, String> + Send + Sync + 'static,
) -> Result<(), BusError> {
    let type_name = match name {
        "action_servers" => "rosapi/GetActionServers".to_owned(),
        "get_ros_version" => "rosapi/GetROSVersion".to_owned(),
        _ => {
            let words = name.split('_').map(|word| {
                let (first, rest) = word.split_at(1);
                first.to_uppercase() + rest
            });
            format!("rosapi/{}", words.collect::<String>())
        }
    };
    bus.advertise_service(member, &format!("/rosapi/{name}"), &type_name, Arc::new(FunctionService(answer)))
}

type GraphQuery = fn(&dyn TopicBus, &Json) -> Result<Json, String>;

const GRAPH_QUERIES: [(&str, GraphQuery); 19] = [
    ("topics", |bus, _| {
        let graph = bus.graph();
        let (topics, types): (Vec<_>, Vec<_>) =
            graph.topics.iter().map(|(name, info)| (name, &info.type_name)).unzip();
        Ok(json!({"topics": topics, "types": types}))
    }),
    ("topics_for_type", |bus, arguments| {
        let graph = bus.graph();
        let wanted = ros1_name(text_argument(arguments, "type")?);
        let topics: Vec<&String> =
            graph.topics.iter().filter(|(_, info)| info.type_name == wanted).map(|(name, _)| name).collect();
        Ok(json!({"topics": topics}))
    }),
    ("topics_and_raw_types", |bus, _| {
        let graph = bus.graph();
        let (topics, types): (Vec<_>, Vec<_>) =
            graph.topics.iter().map(|(name, info)| (name, &info.type_name)).unzip();
        let raw: Vec<String> =
            graph.topics.values().map(|info| raw_definition(bus, &info.type_name)).collect();
        Ok(json!({"topics": topics, "types": types, "typedefs_full_text": raw}))
    }),
    ("topic_type", |bus, arguments| {
        let graph = bus.graph();
        let topic = graph.topics.get(text_argument(arguments, "topic")?);
        Ok(json!({"type": topic.map_or("", |info| &info.type_name)}))
    }),
    ("publishers", |bus, arguments| {
        let graph = bus.graph();
        let topic = graph.topics.get(text_argument(arguments, "topic")?);
        Ok(json!({"publishers": topic.map(|info| &info.publishers[..]).unwrap_or_default()}))
    }),
    ("subscribers", |bus, arguments| {
        let graph = bus.graph();
        let topic = graph.topics.get(text_argument(arguments, "topic")?);
        Ok(json!({"subscribers": topic.map(|info| &info.subscribers[..]).unwrap_or_default()}))
    }),
    ("services", |bus, _| Ok(json!({"services": bus.graph().services.keys().collect::<Vec<_>>()}))),
    ("services_for_type", |bus, arguments| {
        let graph = bus.graph();
        let wanted = ros1_name(text_argument(arguments, "type")?);
        let found = graph.services.iter().filter(|(_, info)| info.type_name == wanted);
        Ok(json!({"services": found.map(|(name, _)| name).collect::<Vec<_>>()}))
    }),
    ("service_type", |bus, arguments| {
        let graph = bus.graph();
        let service = graph.services.get(text_argument(arguments, "service")?);
        Ok(json!({"type": service.map_or("", |info| &info.type_name)}))
    }),
    ("service_node", |bus, arguments| {
        let graph = bus.graph();
        let service = graph.services.get(text_argument(arguments, "service")?);
        Ok(json!({"node": service.map_or("", |info| &info.provider)}))
    }),
    ("service_providers", |bus, arguments| {
        let graph = bus.graph();
        let wanted = ros1_name(text_argument(arguments, "service")?);
        let found = graph.services.iter().filter(|(_, info)| info.type_name == wanted);
        Ok(json!({"providers": found.map(|(_, info)| &info.provider).collect::<Vec<_>>()}))
    }),
    ("nodes", |bus, _| Ok(json!({"nodes": bus.graph().members}))),
    ("node_details", |bus, arguments| {
        let graph = bus.graph();
        let node = text_argument(arguments, "node")?.to_owned();
        let of = |members: fn(&TopicInfo) -> &Vec<String>| -> Vec<&String> {
            let topics = graph.topics.iter();
            topics.filter(|(_, info)| members(info).contains(&node)).map(|(name, _)| name).collect()
        };
        let services: Vec<&String> =
            graph.services.iter().filter(|(_, info)| info.provider == node).map(|(name, _)| name).collect();
        Ok(json!({
            "subscribing": of(|info| &info.subscribers),
            "publishing": of(|info| &info.publishers),
            "services": services,
        }))
    }),
    ("message_details", |bus, arguments| {
        let name = text_argument(arguments, "type")?;
        type_details(name, bus.message_type(name).as_deref())
    }),
    ("service_request_details", |bus, arguments| {
        let name = text_argument(arguments, "type")?;
        type_details(name, bus.service_type(name).map(|kind| Arc::clone(&kind.request)).as_deref())
    }),
    ("service_response_details", |bus, arguments| {
        let name = text_argument(arguments, "type")?;
        type_details(name, bus.service_type(name).map(|kind| Arc::clone(&kind.response)).as_deref())
    }),
    ("action_servers", |bus, _| {
        let graph = bus.graph();
        Ok(json!({"action_servers": action_servers(&graph).keys().collect::<Vec<_>>()}))
    }),
    ("service_host", |bus, arguments| {
        let graph = bus.graph();
        let known = graph.services.contains_key(text_argument(arguments, "service")?);
        Ok(json!({"host": if known { "localhost" } else { "" }}))
    }),
    ("get_ros_version", |_, _| Ok(json!({"version": 1, "distro": "noetic"}))),
];

/// An answer of a service as a client of ROS 2 has it: names of types with `msg` or `srv`, fields as ROS 2 has them. Texts
/// of definitions stay ROS 1's. The service may be a client's, so the values may be anything.
pub(crate) fn response_to_ros2(service: &str, mut values: Json) -> Json {
    let rename = |name: Option<&mut Json>, interface: &str| {
        if let Some(Json::String(text)) = name {
            *text = ros2_name(text, interface);
        }
    };
    match service.strip_prefix("/rosapi/") {
        Some("topics" | "topics_and_raw_types") => {
            let types = values.get_mut("types").and_then(Json::as_array_mut);
            types.into_iter().flatten().for_each(|name| rename(Some(name), "msg"));
        }
        Some("topic_type") => rename(values.get_mut("type"), "msg"),
        Some("service_type") => rename(values.get_mut("type"), "srv"),
        Some("message_details" | "service_request_details" | "service_response_details") => {
            if let Some(typedefs) = values.get_mut("typedefs").and_then(Json::as_array_mut) {
                typedefs_to_ros2(typedefs);
            }
        }
        _ => {}
    }
    values
}

/// Headers without `seq`; times by the names that ROS 2 has for them and their fields.
fn typedefs_to_ros2(typedefs: &mut [Json]) {
    const TIMES: [(&str, &str); 2] =
        [("time", "builtin_interfaces/Time"), ("duration", "builtin_interfaces/Duration")];
    let renamed = |name: &Json| TIMES.iter().find(|(ros1, _)| name == ros1).map(|(_, ros2)| json!(ros2));
    for typedef in typedefs.iter_mut().filter_map(Json::as_object_mut) {
        if let Some(name) = typedef.get("type").and_then(renamed) {
            typedef.insert("type".to_owned(), name);
            typedef.insert("fieldnames".to_owned(), json!(["sec", "nanosec"]));
            typedef.insert("fieldtypes".to_owned(), json!(["int32", "uint32"]));
        }
        let names = typedef.get("fieldnames").and_then(Json::as_array);
        let seq = names.and_then(|names| names.iter().position(|name| name == "seq"));
        let is_header = typedef.get("type").is_some_and(|name| name == "std_msgs/Header");
        for key in ["fieldnames", "fieldtypes", "fieldarraylen", "examples"] {
            let Some(values) = typedef.get_mut(key).and_then(Json::as_array_mut) else { continue };
            if let Some(seq) = seq.filter(|seq| is_header && *seq < values.len()) {
                values.remove(seq);
            }
            for value in values.iter_mut().filter(|_| key == "fieldtypes") {
                if let Some(name) = renamed(value) {
                    *value = name;
                }
            }
        }
    }
}

/// The answer that describes a type, if it is known.
fn type_details(name: &str, kind: Option<&MessageType>) -> Result<Json, String> {
    let kind = kind.ok_or_else(|| format!("the fields of {name} are not known here"))?;
    let mut details = Vec::new();
    add_typedefs(kind, &mut details);
    Ok(json!({"typedefs": details}))
}

/// What a field holds that is left out, in the words of ROS's Python.
fn default_text(field: &MessageField) -> &'static str {
    match (field.count, &field.kind) {
        (ArrayKind::Variable | ArrayKind::Fixed(_), _) => "[]",
        (_, FieldType::Bool) => "False",
        (_, FieldType::Int { .. }) => "0",
        (_, FieldType::Float32 | FieldType::Float64) => "0.0",
        (_, FieldType::Text) => "",
        (_, FieldType::Time | FieldType::Duration | FieldType::Message(_)) => "{}",
    }
}

/// A type and the types that it needs, each once, as rosapi's `TypeDef`s.
fn add_typedefs(kind: &MessageType, details: &mut Vec<Json>) {
    if details.iter().any(|known| known["type"] == kind.name.as_str()) {
        return;
    }
    let lengths: Vec<i64> = kind
        .fields
        .iter()
        .map(|field| match field.count {
            ArrayKind::Single => -1,
            ArrayKind::Variable => 0,
            ArrayKind::Fixed(length) => i64::try_from(length).unwrap_or(i64::MAX),
        })
        .collect();
    details.push(json!({
        "type": kind.name,
        "fieldnames": kind.fields.iter().map(|field| &*field.name).collect::<Vec<_>>(),
        "fieldtypes": kind.fields.iter().map(|field| field.kind.name()).collect::<Vec<_>>(),
        "fieldarraylen": lengths,
        "examples": kind.fields.iter().map(default_text).collect::<Vec<_>>(),
        "constnames": kind.constants.iter().map(|constant| &constant.name).collect::<Vec<_>>(),
        "constvalues": kind.constants.iter().map(|constant| &constant.value).collect::<Vec<_>>(),
    }));
    for field in &kind.fields {
        match &field.kind {
            FieldType::Message(inner) => add_typedefs(inner, details),
            FieldType::Time | FieldType::Duration => add_time_typedef(&field.kind.name(), details),
            _ => {}
        }
    }
}

/// Times count as types with two fields.
fn add_time_typedef(name: &str, details: &mut Vec<Json>) {
    if !details.iter().any(|known| known["type"] == name) {
        details.push(json!({
            "type": name, "fieldnames": ["secs", "nsecs"], "fieldtypes": ["int32", "int32"],
            "fieldarraylen": [-1, -1], "examples": ["0", "0"], "constnames": [], "constvalues": [],
        }));
    }
}

/// The definition with those that it needs; empty if it is not known.
fn raw_definition(bus: &dyn TopicBus, name: &str) -> String {
    bus.message_type(name).map(|kind| kind.full_text()).unwrap_or_default()
}

type ParameterRequest = fn(&Parameters, &Json) -> Result<Json, String>;

/// Values of parameters travel as JSON text, as rosapi has it.
const PARAMETER_REQUESTS: [(&str, ParameterRequest); 5] = [
    ("get_param", |parameters, arguments| {
        let name = text_argument(arguments, "name")?;
        let parameters = parameters.lock().unwrap_or_else(PoisonError::into_inner);
        let default = arguments.get("default").and_then(Json::as_str).filter(|text| !text.is_empty());
        match (parameters.get(name), default) {
            (Some(value), _) => Ok(json!({"value": value.to_string()})),
            (None, default) => Ok(json!({"value": default.unwrap_or("null")})),
        }
    }),
    ("set_param", |parameters, arguments| {
        let (name, value) = (text_argument(arguments, "name")?, text_argument(arguments, "value")?);
        check_name("parameter", name).map_err(|error| error.to_string())?;
        if value.len() > MAX_PARAMETER_BYTES {
            return Err(format!("the value has {} bytes, at most {MAX_PARAMETER_BYTES} fit", value.len()));
        }
        let value = serde_json::from_str(value).map_err(|error| format!("the value is not JSON: {error}"))?;
        let mut parameters = parameters.lock().unwrap_or_else(PoisonError::into_inner);
        if !parameters.contains_key(name) && parameters.len() >= MAX_PARAMETERS {
            return Err(format!("there are {MAX_PARAMETERS} parameters already"));
        }
        parameters.insert(name.to_owned(), value);
        Ok(json!({}))
    }),
    ("has_param", |parameters, arguments| {
        let parameters = parameters.lock().unwrap_or_else(PoisonError::into_inner);
        Ok(json!({"exists": parameters.contains_key(text_argument(arguments, "name")?)}))
    }),
    ("delete_param", |parameters, arguments| {
        let name = text_argument(arguments, "name")?;
        let removed = parameters.lock().unwrap_or_else(PoisonError::into_inner).remove(name);
        removed.map(|_| json!({})).ok_or_else(|| format!("there is no parameter {name}"))
    }),
    ("get_param_names", |parameters, _| {
        let parameters = parameters.lock().unwrap_or_else(PoisonError::into_inner);
        Ok(json!({"names": parameters.keys().collect::<Vec<_>>()}))
    }),
];

/// A text among the arguments.
fn text_argument<'a>(arguments: &'a Json, name: &str) -> Result<&'a str, String> {
    arguments
        .get(name)
        .and_then(Json::as_str)
        .ok_or_else(|| format!("expected the argument {name:?}, a text"))
}
