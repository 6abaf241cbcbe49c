//! Logs publishers whose message type differs from the one that this node subscribes to.
//!
//! rosrust closes such a connection without a log line, so the topic looks silent. A publisher that does not list this node
//! among its subscribers is asked for its connection header, which has its type and MD5 sum.

use super::master::{self, MasterAddresses};
use crate::publishing;
use rosrust::Message;
use std::{
    collections::BTreeMap,
    net::{TcpStream, ToSocketAddrs},
    sync::{Mutex, PoisonError},
    time::Duration,
};

/// Limit of each step of the connection.
const TIMEOUT: Duration = Duration::from_secs(2);
/// Type or sum that fits every other one.
const ANY: &str = "*";

/// Message type to MD5 sum, of all subscriptions of this node.
static MD5_SUMS: Mutex<BTreeMap<String, String>> = Mutex::new(BTreeMap::new());

/// Keeps the MD5 sum of a message type that this node subscribes to.
pub(super) fn record_type<M: Message>() {
    MD5_SUMS.lock().unwrap_or_else(PoisonError::into_inner).insert(M::msg_type(), M::md5sum());
}

/// Compares the publisher at `uri` with this node's subscription to `topic` of the type `datatype`. Returns the line to log if
/// they do not fit.
///
/// # Errors
/// The publisher cannot be asked, or gives no header.
pub(super) fn describe_mismatch(
    addresses: &MasterAddresses,
    uri: &str,
    node: &str,
    topic: &str,
    datatype: &str,
) -> Result<Option<String>, String> {
    let sums = MD5_SUMS.lock().unwrap_or_else(PoisonError::into_inner);
    let Some(ours) = sums.get(datatype).cloned() else { return Ok(None) };
    drop(sums);
    let (host, port) = master::request_topic(addresses, uri, topic)?;
    let text = |error: std::io::Error| error.to_string();
    let address = (&*host, port).to_socket_addrs().map_err(text)?.next().ok_or("the host has no address")?;
    let mut stream = TcpStream::connect_timeout(&address, TIMEOUT).map_err(text)?;
    stream.set_read_timeout(Some(TIMEOUT)).map_err(text)?;
    stream.set_write_timeout(Some(TIMEOUT)).map_err(text)?;
    let fields = [("callerid", &*addresses.name), ("topic", topic), ("md5sum", ANY), ("type", ANY)];
    let theirs = publishing::exchange_headers(&mut stream, &fields)?;
    Ok(theirs.get("md5sum").filter(|sum| **sum != ours && **sum != ANY && ours != ANY).map(|sum| {
        let published = theirs.get("type").map_or("another type", |name| name);
        format!(
            "{topic}: {node} publishes {published} with MD5 sum {sum}, this node expects {datatype} with MD5 sum {ours}; \
             its messages are not received"
        )
    }))
}
