//! The services of `rosapi` that clients ask for: what topics, services, types and parameters there are.

use crate::{
    bus::{BusError, Graph, MemberId, TopicBus, TopicInfo, check_name},
    services::Answering,
};
use proact_messages::{Count, Kind, MessageType, Time, known_type, plain_name};
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
pub(crate) fn offer(bus: &Arc<dyn TopicBus>, member: MemberId, clock: fn() -> Time) -> Result<(), BusError> {
    for (name, question) in GRAPH_QUESTIONS {
        // The bus owns the service, so the service must not own the bus.
        let weak: Weak<dyn TopicBus> = Arc::downgrade(bus);
        let answer = move |arguments: &Json| {
            let bus = weak.upgrade().ok_or("the bus is closing")?;
            question(&bus.graph(), arguments)
        };
        advertise(bus, member, name, answer)?;
    }
    let time = move |_: &Json| {
        let Time { secs, nsecs } = clock();
        Ok(json!({"time": {"secs": secs, "nsecs": nsecs}}))
    };
    advertise(bus, member, "get_time", time)?;
    let parameters: Arc<Parameters> = Arc::default();
    for (name, question) in PARAMETER_QUESTIONS {
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
    let words = name.split('_').map(|word| {
        let (first, rest) = word.split_at(1);
        first.to_uppercase() + rest
    });
    let type_name = format!("rosapi/{}", words.collect::<String>());
    bus.advertise_service(member, &format!("/rosapi/{name}"), &type_name, Arc::new(Answering(answer)))
}

type GraphQuestion = fn(&Graph, &Json) -> Result<Json, String>;

const GRAPH_QUESTIONS: [(&str, GraphQuestion); 17] = [
    ("topics", |graph, _| {
        let (topics, types): (Vec<_>, Vec<_>) =
            graph.topics.iter().map(|(name, info)| (name, &info.type_name)).unzip();
        Ok(json!({"topics": topics, "types": types}))
    }),
    ("topics_for_type", |graph, arguments| {
        let wanted = plain_name(text(arguments, "type")?);
        let topics: Vec<&String> =
            graph.topics.iter().filter(|(_, info)| info.type_name == wanted).map(|(name, _)| name).collect();
        Ok(json!({"topics": topics}))
    }),
    ("topics_and_raw_types", |graph, _| {
        let (topics, types): (Vec<_>, Vec<_>) =
            graph.topics.iter().map(|(name, info)| (name, &info.type_name)).unzip();
        let raw: Vec<String> = graph.topics.values().map(|info| raw_definition(&info.type_name)).collect();
        Ok(json!({"topics": topics, "types": types, "typedefs_full_text": raw}))
    }),
    ("topic_type", |graph, arguments| {
        let topic = graph.topics.get(text(arguments, "topic")?);
        Ok(json!({"type": topic.map_or("", |info| &info.type_name)}))
    }),
    ("publishers", |graph, arguments| {
        let topic = graph.topics.get(text(arguments, "topic")?);
        Ok(json!({"publishers": topic.map(|info| &info.publishers[..]).unwrap_or_default()}))
    }),
    ("subscribers", |graph, arguments| {
        let topic = graph.topics.get(text(arguments, "topic")?);
        Ok(json!({"subscribers": topic.map(|info| &info.subscribers[..]).unwrap_or_default()}))
    }),
    ("services", |graph, _| Ok(json!({"services": graph.services.keys().collect::<Vec<_>>()}))),
    ("services_for_type", |graph, arguments| {
        let wanted = text(arguments, "type")?;
        let found = graph.services.iter().filter(|(_, info)| info.type_name == wanted);
        Ok(json!({"services": found.map(|(name, _)| name).collect::<Vec<_>>()}))
    }),
    ("service_type", |graph, arguments| {
        let service = graph.services.get(text(arguments, "service")?);
        Ok(json!({"type": service.map_or("", |info| &info.type_name)}))
    }),
    ("service_node", |graph, arguments| {
        let service = graph.services.get(text(arguments, "service")?);
        Ok(json!({"node": service.map_or("", |info| &info.provider)}))
    }),
    ("service_providers", |graph, arguments| {
        let wanted = text(arguments, "service")?;
        let found = graph.services.iter().filter(|(_, info)| info.type_name == wanted);
        Ok(json!({"providers": found.map(|(_, info)| &info.provider).collect::<Vec<_>>()}))
    }),
    ("nodes", |graph, _| Ok(json!({"nodes": graph.members}))),
    ("node_details", |graph, arguments| {
        let node = text(arguments, "node")?.to_owned();
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
    ("message_details", |_, arguments| {
        let name = text(arguments, "type")?;
        let kind = known_type(name).ok_or_else(|| format!("the fields of {name} are not known here"))?;
        let mut details = Vec::new();
        describe(&kind, &mut details);
        Ok(json!({"typedefs": details}))
    }),
    // There are no action servers here.
    ("action_servers", |_, _| Ok(json!({"action_servers": []}))),
    ("service_host", |graph, arguments| {
        let known = graph.services.contains_key(text(arguments, "service")?);
        Ok(json!({"host": if known { "localhost" } else { "" }}))
    }),
    ("get_ros_version", |_, _| Ok(json!({"version": 1, "distro": "noetic"}))),
];

/// A type and the types that it needs, each once, as rosapi's `TypeDef`s.
fn describe(kind: &MessageType, details: &mut Vec<Json>) {
    if details.iter().any(|known| known["type"] == kind.name.as_str()) {
        return;
    }
    let lengths: Vec<i64> = kind
        .fields
        .iter()
        .map(|field| match field.count {
            Count::One => -1,
            Count::Any => 0,
            Count::Exactly(length) => i64::try_from(length).unwrap_or(i64::MAX),
        })
        .collect();
    details.push(json!({
        "type": kind.name,
        "fieldnames": kind.fields.iter().map(|field| &*field.name).collect::<Vec<_>>(),
        "fieldtypes": kind.fields.iter().map(|field| field.kind.name()).collect::<Vec<_>>(),
        "fieldarraylen": lengths,
        "examples": vec![""; kind.fields.len()],
        "constnames": [],
        "constvalues": [],
    }));
    for field in &kind.fields {
        if let Kind::Message(inner) = &field.kind {
            describe(inner, details);
        }
    }
}

/// The definition with those that it needs; empty if it is not known.
fn raw_definition(name: &str) -> String {
    known_type(name).map(|kind| kind.text()).unwrap_or_default()
}

type ParameterQuestion = fn(&Parameters, &Json) -> Result<Json, String>;

/// Values of parameters travel as JSON text, as rosapi has it.
const PARAMETER_QUESTIONS: [(&str, ParameterQuestion); 5] = [
    ("get_param", |parameters, arguments| {
        let name = text(arguments, "name")?;
        let parameters = parameters.lock().unwrap_or_else(PoisonError::into_inner);
        let default = arguments.get("default").and_then(Json::as_str).filter(|text| !text.is_empty());
        match (parameters.get(name), default) {
            (Some(value), _) => Ok(json!({"value": value.to_string()})),
            (None, default) => Ok(json!({"value": default.unwrap_or("null")})),
        }
    }),
    ("set_param", |parameters, arguments| {
        let (name, value) = (text(arguments, "name")?, text(arguments, "value")?);
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
        Ok(json!({"exists": parameters.contains_key(text(arguments, "name")?)}))
    }),
    ("delete_param", |parameters, arguments| {
        let name = text(arguments, "name")?;
        let removed = parameters.lock().unwrap_or_else(PoisonError::into_inner).remove(name);
        removed.map(|_| json!({})).ok_or_else(|| format!("there is no parameter {name}"))
    }),
    ("get_param_names", |parameters, _| {
        let parameters = parameters.lock().unwrap_or_else(PoisonError::into_inner);
        Ok(json!({"names": parameters.keys().collect::<Vec<_>>()}))
    }),
];

/// A text among the arguments.
fn text<'a>(arguments: &'a Json, name: &str) -> Result<&'a str, String> {
    arguments
        .get(name)
        .and_then(Json::as_str)
        .ok_or_else(|| format!("expected the argument {name:?}, a text"))
}
