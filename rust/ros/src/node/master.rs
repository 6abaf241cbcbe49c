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

/// Whether the master knows this node.
pub(super) fn is_known(addresses: &Addresses) -> bool {
    call(&addresses.master, "lookupNode", &[text(&addresses.name), text(&addresses.name)]).is_ok()
}

/// What the master knows of us now, from its own state: nothing has to be kept by hand.
pub(super) fn known_registrations(addresses: &Addresses, state: SystemState) -> Registrations {
    let types: BTreeMap<String, String> =
        rosrust::topics().unwrap_or_default().into_iter().map(|t| (t.name, t.datatype)).collect();
    let ours = |topics: Vec<(String, Vec<String>)>| {
        topics
            .into_iter()
            .filter(|(_, nodes)| nodes.contains(&addresses.name))
            .map(|(name, _)| (name.clone(), types.get(&name).cloned().unwrap_or_else(|| "*".to_owned())))
            .collect::<BTreeMap<_, _>>()
    };
    let services = ours(state.services.into_iter().map(|t| (t.name, t.connections)).collect())
        .into_keys()
        .filter_map(|service| {
            match call(&addresses.master, "lookupService", &[text(&addresses.name), text(&service)]) {
                Ok(Value::String(uri)) => Some((service, uri)),
                _ => None,
            }
        })
        .collect();
    Registrations {
        publishers: ours(state.publishers.into_iter().map(|t| (t.name, t.connections)).collect()),
        subscribers: ours(state.subscribers.into_iter().map(|t| (t.name, t.connections)).collect()),
        services,
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
        call(&addresses.master, "registerService", &[name.clone(), text(service), text(uri), slave.clone()])?;
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
