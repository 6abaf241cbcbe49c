//! Registering again after the master was restarted. rosrust does not; the master's interface lets us do it.

use rosrust::api::SystemState;
use std::collections::{BTreeMap, BTreeSet};
use xml_rpc::{Client, Params, Url, Value};

/// What this node has told the master.
#[derive(Clone, Debug, Default)]
pub(super) struct Registrations {
    /// Topic to type.
    pub publishers: BTreeMap<String, String>,
    /// Topic to type.
    pub subscribers: BTreeMap<String, String>,
    /// Service to address.
    pub services: BTreeMap<String, String>,
}

/// The master and ourselves as addresses.
#[derive(Clone, Debug)]
pub(super) struct MasterAddresses {
    pub master: Url,
    pub slave: Url,
    /// Our own address to the letter: the master compares it when we unregister.
    pub slave_uri: String,
    pub name: String,
}

/// What is wrong with a call.
type CallError = String;

fn call(uri: &Url, method: &str, arguments: &[Value]) -> Result<Value, CallError> {
    let mut client = Client::new().map_err(|e| e.to_string())?;
    let params: Params = arguments.to_vec();
    let answer = client.call_value(uri, method, params).map_err(|e| e.to_string())?;
    let mut values = answer.map_err(|fault| format!("{fault:?}"))?;
    match values.pop() {
        // Code, message, value.
        Some(Value::Array(parts)) if parts.len() == 3 => match &parts[0] {
            Value::Int(1) => Ok(parts[2].clone()),
            code => Err(format!("{method} answered {code:?}: {:?}", parts[1])),
        },
        other => Err(format!("{method} answered {other:?}")),
    }
}

fn string_value(s: &str) -> Value {
    Value::String(s.to_owned())
}

/// The master's process number: a restarted master has another one.
pub(super) fn master_pid(addresses: &MasterAddresses) -> Result<i32, CallError> {
    match call(&addresses.master, "getPid", &[string_value(&addresses.name)])? {
        Value::Int(pid) => Ok(pid),
        other => Err(format!("getPid answered {other:?}")),
    }
}

/// Whether a master answers at `uri`.
pub(super) fn check_master(uri: &str) -> Result<(), CallError> {
    let address: Url = uri.parse().map_err(|error| format!("{error:?}"))?;
    call(&address, "getPid", &[string_value("/proact")]).map(|_| ())
}

/// Whether the master knows this node.
pub(super) fn is_registered(addresses: &MasterAddresses) -> bool {
    call(&addresses.master, "lookupNode", &[string_value(&addresses.name), string_value(&addresses.name)])
        .is_ok()
}

/// Where a service is offered.
pub(super) fn service_address(addresses: &MasterAddresses, service: &str) -> Result<String, CallError> {
    match call(&addresses.master, "lookupService", &[string_value(&addresses.name), string_value(service)])? {
        Value::String(uri) => Ok(uri),
        other => Err(format!("lookupService answered {other:?}")),
    }
}

/// Tells the master of a service of ours.
pub(super) fn register_service(
    addresses: &MasterAddresses,
    service: &str,
    uri: &str,
) -> Result<(), CallError> {
    let words = [&addresses.name, service, uri, &addresses.slave_uri];
    call(&addresses.master, "registerService", &words.map(string_value)).map(|_| ())
}

/// Tells the master that a service of ours is gone.
pub(super) fn unregister_service(
    addresses: &MasterAddresses,
    service: &str,
    uri: &str,
) -> Result<(), CallError> {
    call(&addresses.master, "unregisterService", &[&addresses.name, service, uri].map(string_value))
        .map(|_| ())
}

/// What we have registered now: topics as our own slave has them, services as the master has them.
pub(super) fn registrations(
    addresses: &MasterAddresses,
    state: SystemState,
) -> Result<Registrations, CallError> {
    let ours = state.services.into_iter().filter(|service| service.connections.contains(&addresses.name));
    let services = ours.filter_map(|service| {
        let uri = service_address(addresses, &service.name).ok()?;
        Some((service.name, uri))
    });
    let mut all = Registrations { services: services.collect(), ..Registrations::default() };
    refresh_topics(addresses, &mut all)?;
    Ok(all)
}

/// Topics that this node subscribes to, with their types.
pub(super) fn subscriptions(addresses: &MasterAddresses) -> Result<BTreeMap<String, String>, CallError> {
    let mut all = Registrations::default();
    refresh_topics(addresses, &mut all)?;
    Ok(all.subscribers)
}

/// Host and TCP port at which the publisher at `uri` sends `topic`.
pub(super) fn request_topic(
    addresses: &MasterAddresses,
    uri: &str,
    topic: &str,
) -> Result<(String, u16), CallError> {
    let publisher: Url = uri.parse().map_err(|error| format!("{uri}: {error:?}"))?;
    let protocols = Value::Array(vec![Value::Array(vec![string_value("TCPROS")])]);
    let answer =
        call(&publisher, "requestTopic", &[string_value(&addresses.name), string_value(topic), protocols])?;
    let no_port = || format!("requestTopic answered {answer:?}");
    let Value::Array(parts) = &answer else { return Err(no_port()) };
    let [Value::String(_), Value::String(host), Value::Int(port)] = &parts[..] else { return Err(no_port()) };
    Ok((host.clone(), u16::try_from(*port).map_err(|_| no_port())?))
}

/// The XML-RPC address of a node.
pub(super) fn node_address(addresses: &MasterAddresses, node: &str) -> Result<String, CallError> {
    match call(&addresses.master, "lookupNode", &[string_value(&addresses.name), string_value(node)])? {
        Value::String(uri) => Ok(uri),
        other => Err(format!("lookupNode answered {other:?}")),
    }
}

/// Topics that the node at `uri` sends to this one now.
pub(super) fn topics_received_from(
    addresses: &MasterAddresses,
    uri: &str,
) -> Result<BTreeSet<String>, CallError> {
    let publisher: Url = uri.parse().map_err(|error| format!("{uri}: {error:?}"))?;
    let Value::Array(connections) = call(&publisher, "getBusInfo", &[string_value(&addresses.name)])? else {
        return Err("getBusInfo gave no list".to_owned());
    };
    // Number, node at the other end, direction, transport, topic.
    let topic = |connection: &Value| match connection {
        Value::Array(parts) => match &parts[..] {
            [_, Value::String(node), Value::String(direction), _, Value::String(topic), ..]
                if *node == addresses.name && direction == "o" =>
            {
                Some(topic.clone())
            }
            _ => None,
        },
        _ => None,
    };
    Ok(connections.iter().filter_map(topic).collect())
}

/// Tells our own slave who publishes a topic.
pub(super) fn send_publisher_update(
    addresses: &MasterAddresses,
    topic: &str,
    uris: &[&str],
) -> Result<(), CallError> {
    let publishers = Value::Array(uris.iter().copied().map(string_value).collect());
    call(&addresses.slave, "publisherUpdate", &[string_value("/master"), string_value(topic), publishers])
        .map(|_| ())
}

/// Topics may have come and gone since; our own slave knows without a master.
pub(super) fn refresh_topics(addresses: &MasterAddresses, all: &mut Registrations) -> Result<(), CallError> {
    let listed = |method: &str| match call(&addresses.slave, method, &[string_value(&addresses.name)])? {
        Value::Array(topics) => topics.iter().map(name_and_type).collect(),
        other => Err(format!("{method} answered {other:?}")),
    };
    all.publishers = listed("getPublications")?;
    all.subscribers = listed("getSubscriptions")?;
    Ok(())
}

/// Tells the master that no topic is ours any more. One that is gone knows of none.
pub(super) fn unregister_topics(addresses: &MasterAddresses) {
    let mut ours = Registrations::default();
    if refresh_topics(addresses, &mut ours).is_err() {
        return;
    }
    let leave = |method: &str, topic: &str| {
        let _ = call(
            &addresses.master,
            method,
            &[&*addresses.name, topic, &addresses.slave_uri].map(string_value),
        );
    };
    ours.publishers.keys().for_each(|topic| leave("unregisterPublisher", topic));
    ours.subscribers.keys().for_each(|topic| leave("unregisterSubscriber", topic));
}

fn name_and_type(topic: &Value) -> Result<(String, String), CallError> {
    match topic {
        Value::Array(pair) => match &pair[..] {
            [Value::String(name), Value::String(datatype)] => Ok((name.clone(), datatype.clone())),
            other => Err(format!("a topic is {other:?}")),
        },
        other => Err(format!("a topic is {other:?}")),
    }
}

/// Tells a fresh master everything again, and our own slave who publishes what it listens to.
pub(super) fn register(addresses: &MasterAddresses, all: &Registrations) -> Result<(), CallError> {
    let (name, slave) = (string_value(&addresses.name), string_value(&addresses.slave_uri));
    for (topic, datatype) in &all.publishers {
        call(
            &addresses.master,
            "registerPublisher",
            &[name.clone(), string_value(topic), string_value(datatype), slave.clone()],
        )?;
    }
    for (service, uri) in &all.services {
        register_service(addresses, service, uri)?;
    }
    for (topic, datatype) in &all.subscribers {
        let publishers = call(
            &addresses.master,
            "registerSubscriber",
            &[name.clone(), string_value(topic), string_value(datatype), slave.clone()],
        )?;
        // The master tells later publishers; those that came back before us, we have to pass on ourselves.
        call(
            &addresses.slave,
            "publisherUpdate",
            &[string_value("/master"), string_value(topic), publishers],
        )?;
    }
    Ok(())
}
