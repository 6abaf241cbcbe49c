//! Services: those that a client offers, and those that a function answers.

use crate::{
    bus::{ServiceProvider, ServiceReply},
    outbox::{self, Compression, Outbox},
};
use proact_messages::{RosVersion, ros2_json};
use serde_json::{Value as Json, json};
use std::{
    collections::{HashMap, HashSet},
    sync::{Arc, Mutex, MutexGuard, PoisonError},
    time::Instant,
};

/// Most calls that wait for the answer of one client.
const MAX_CALLS: usize = 10_000;

/// The services that one client offers, and the calls that it has not answered yet.
#[derive(Default)]
pub(crate) struct OfferedServices {
    state: Mutex<State>,
}

#[derive(Default)]
struct State {
    services: HashSet<String>,
    calls: HashMap<String, (String, ServiceReply)>,
    next_id: u64,
    closed: bool,
}

impl OfferedServices {
    fn lock(&self) -> MutexGuard<'_, State> {
        // No code that holds the lock can panic half way through a change.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Counts a service in; false if there are `max_pending` already.
    pub(crate) fn add(&self, service: &str, max_pending: usize) -> bool {
        let mut state = self.lock();
        let fits = state.services.contains(service) || state.services.len() < max_pending;
        if fits {
            state.services.insert(service.to_owned());
        }
        fits
    }

    /// Counts a service out. Calls that wait may still be answered.
    pub(crate) fn remove(&self, service: &str) {
        self.lock().services.remove(service);
    }

    /// The client's answer to a call; false if no such call waits.
    pub(crate) fn answer(&self, service: &str, id: &str, result: Result<Json, String>) -> bool {
        let mut state = self.lock();
        if state.calls.get(id).is_none_or(|(called, _)| !same_name(called, service)) {
            return false;
        }
        let call = state.calls.remove(id);
        drop(state);
        if let Some((_, reply)) = call {
            reply.answer(result);
        }
        true
    }

    /// Tells callers who have waited long enough.
    pub(crate) fn expire(&self, now: Instant) {
        let mut state = self.lock();
        let late: Vec<String> = state
            .calls
            .iter()
            .filter(|(_, (_, reply))| reply.deadline().is_some_and(|deadline| deadline <= now))
            .map(|(id, _)| id.clone())
            .collect();
        let late: Vec<_> = late.into_iter().filter_map(|id| state.calls.remove(&id)).collect();
        drop(state);
        for (service, reply) in late {
            reply.answer(Err(format!("service {service} gave no answer in time")));
        }
    }

    /// The client is gone: all that wait are told.
    pub(crate) fn close(&self) {
        let mut state = self.lock();
        state.closed = true;
        let calls = std::mem::take(&mut state.calls);
        drop(state);
        // A reply that is dropped tells its caller.
        drop(calls);
    }

    /// Keeps a call until it is answered; its id, or the reply if it cannot be kept.
    fn store_call(&self, service: &str, reply: ServiceReply) -> Result<String, (ServiceReply, &'static str)> {
        let mut state = self.lock();
        if state.closed {
            return Err((reply, "went away"));
        }
        if state.calls.len() >= MAX_CALLS {
            return Err((reply, "is busy: too many calls wait for its answer"));
        }
        state.next_id += 1;
        let id = format!("call:{service}:{}", state.next_id);
        state.calls.insert(id.clone(), (service.to_owned(), reply));
        Ok(id)
    }
}

/// Whether two names are the same but for the first slash.
fn same_name(a: &str, b: &str) -> bool {
    a.trim_start_matches('/') == b.trim_start_matches('/')
}

/// A service that a client of rosbridge answers.
pub(crate) struct RemoteProvider {
    service: String,
    ros_version: RosVersion,
    outbox: Arc<Outbox>,
    offered_services: Arc<OfferedServices>,
}

impl RemoteProvider {
    pub(crate) fn new(
        service: &str,
        convention: RosVersion,
        outbox: Arc<Outbox>,
        offered: Arc<OfferedServices>,
    ) -> Self {
        RemoteProvider {
            service: service.to_owned(),
            ros_version: convention,
            outbox,
            offered_services: offered,
        }
    }
}

impl ServiceProvider for RemoteProvider {
    fn call(&self, arguments: Json, reply: ServiceReply) {
        let arguments = if self.ros_version == RosVersion::Ros2 { ros2_json(arguments) } else { arguments };
        match self.offered_services.store_call(&self.service, reply) {
            Ok(id) => {
                let call =
                    json!({"op": "call_service", "id": id, "service": self.service, "args": arguments});
                self.outbox.reply(outbox::QueuedReply {
                    text: call.to_string().into(),
                    fragment_size: None,
                    compression: Compression::None,
                });
            }
            Err((reply, why)) => reply.answer(Err(format!("the provider of service {} {why}", self.service))),
        }
    }
}

/// A service that a function answers at once: the values, or one sentence why not.
pub struct FunctionService<F>(
    /// The function.
    pub F,
);

impl<F: Fn(&Json) -> Result<Json, String> + Send + Sync> ServiceProvider for FunctionService<F> {
    fn call(&self, arguments: Json, reply: ServiceReply) {
        reply.answer((self.0)(&arguments));
    }
}
