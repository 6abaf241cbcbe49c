//! Registering again after the master was restarted. rosrust does not; the master's interface lets us do it.

use rosrust::api::SystemState;
use std::collections::BTreeMap;
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
pub(super) struct Addresses {
    pub master: Url,
    pub slave: Url,
    /// Our own address to the letter: the master compares it when we unregister.
    pub slave_text: String,
    pub name: String,
}

/// What is wrong with a call.
type Failure = String;

fn call(uri: &Url, method: &str, arguments: &[Value]) -> Result<Value, Failure> {
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

fn text(s: &str) -> Value {
    Value::String(s.to_owned())
}

/// The master's process number: a restarted master has another one.
pub(super) fn master_pid(addresses: &Addresses) -> Result<i32, Failure> {
    match call(&addresses.master, "getPid", &[text(&addresses.name)])? {
        Value::Int(pid) => Ok(pid),
        other => Err(format!("getPid answered {other:?}")),
    }
}

/// Whether a master answers at `uri`.
pub(super) fn answers(uri: &str) -> Result<(), Failure> {
    let address: Url = uri.parse().map_err(|error| format!("{error:?}"))?;
    call(&address, "getPid", &[text("/proact")]).map(|_| ())
}

/// Whether the master knows this node.
pub(super) fn is_known(addresses: &Addresses) -> bool {
    call(&addresses.master, "lookupNode", &[text(&addresses.name), text(&addresses.name)]).is_ok()
}

/// Where a service is offered.
pub(super) fn service_address(addresses: &Addresses, service: &str) -> Result<String, Failure> {
    match call(&addresses.master, "lookupService", &[text(&addresses.name), text(service)])? {
        Value::String(uri) => Ok(uri),
        other => Err(format!("lookupService answered {other:?}")),
    }
}

/// Tells the master of a service of ours.
pub(super) fn register_service(addresses: &Addresses, service: &str, uri: &str) -> Result<(), Failure> {
    let words = [&addresses.name, service, uri, &addresses.slave_text];
    call(&addresses.master, "registerService", &words.map(text)).map(|_| ())
}

/// Tells the master that a service of ours is gone.
pub(super) fn unregister_service(addresses: &Addresses, service: &str, uri: &str) -> Result<(), Failure> {
    call(&addresses.master, "unregisterService", &[&addresses.name, service, uri].map(text)).map(|_| ())
}

/// What we have registered now: topics as our own slave has them, services as the master has them.
pub(super) fn registrations(addresses: &Addresses, state: SystemState) -> Result<Registrations, Failure> {
    let ours = state.services.into_iter().filter(|service| service.connections.contains(&addresses.name));
    let services = ours.filter_map(|service| {
        let uri = service_address(addresses, &service.name).ok()?;
        Some((service.name, uri))
    });
    let mut all = Registrations { services: services.collect(), ..Registrations::default() };
    renew_topics(addresses, &mut all)?;
    Ok(all)
}

/// Topics may have come and gone since; our own slave knows without a master.
pub(super) fn renew_topics(addresses: &Addresses, all: &mut Registrations) -> Result<(), Failure> {
    let listed = |method: &str| match call(&addresses.slave, method, &[text(&addresses.name)])? {
        Value::Array(topics) => topics.iter().map(name_and_type).collect(),
        other => Err(format!("{method} answered {other:?}")),
    };
    all.publishers = listed("getPublications")?;
    all.subscribers = listed("getSubscriptions")?;
    Ok(())
}

/// Tells the master that no topic is ours any more. One that is gone knows of none.
pub(super) fn unregister_topics(addresses: &Addresses) {
    let mut ours = Registrations::default();
    if renew_topics(addresses, &mut ours).is_err() {
        return;
    }
    let leave = |method: &str, topic: &str| {
        let _ = call(&addresses.master, method, &[&*addresses.name, topic, &addresses.slave_text].map(text));
    };
    ours.publishers.keys().for_each(|topic| leave("unregisterPublisher", topic));
    ours.subscribers.keys().for_each(|topic| leave("unregisterSubscriber", topic));
}

fn name_and_type(topic: &Value) -> Result<(String, String), Failure> {
    match topic {
        Value::Array(pair) => match &pair[..] {
            [Value::String(name), Value::String(datatype)] => Ok((name.clone(), datatype.clone())),
            other => Err(format!("a topic is {other:?}")),
        },
        other => Err(format!("a topic is {other:?}")),
    }
}

/// Tells a fresh master everything again, and our own slave who publishes what it listens to.
pub(super) fn register(addresses: &Addresses, all: &Registrations) -> Result<(), Failure> {
    let (name, slave) = (text(&addresses.name), text(&addresses.slave_text));
    for (topic, datatype) in &all.publishers {
        call(
            &addresses.master,
            "registerPublisher",
            &[name.clone(), text(topic), text(datatype), slave.clone()],
        )?;
    }
    for (service, uri) in &all.services {
        register_service(addresses, service, uri)?;
    }
    for (topic, datatype) in &all.subscribers {
        let publishers = call(
            &addresses.master,
            "registerSubscriber",
            &[name.clone(), text(topic), text(datatype), slave.clone()],
        )?;
        // The master tells later publishers; those that came back before us, we have to pass on ourselves.
        call(&addresses.slave, "publisherUpdate", &[text("/master"), text(topic), publishers])?;
    }
    Ok(())
}
