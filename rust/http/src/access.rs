//! Who may connect, and what they may do there.
//!
//! A visitor is known by the first of these that holds; whoever is not known gets 401.
//!
//! | visitor | may |
//! |---|---|
//! | shows the token, in the address or as `Authorization: Bearer`; or the browser keeps it in the cookie of this port | act |
//! | comes from a listed address | what the list says: [`AccessRight::View`] or [`AccessRight::Control`] |
//! | comes from this machine (peer address 127.0.0.0/8 or ::1), and there is no token | act |
//!
//! Whoever is known must then pass these; who does not gets 403.
//!
//! | | [`AllowedOrigins::SameServer`] (the pages) | [`AllowedOrigins::SameHost`] (rosbridge) |
//! |---|---|---|
//! | right | `Watch` sees everything, and what it sends is refused | `Act` only: every client of rosbridge can publish and call |
//! | host name in the request, unless the token is in the address or header | one of ours, see below | the same; programs, whose WebSockets have no origin, may use any |
//! | origin, if there is one | this very server: name and port | any page of the same host; any at all with the token in the address or header |
//! | WebSocket without an origin | as any request | from this machine and listed addresses only, also with the token |
//! | token in the address of a page | the browser gets the cookie and is sent to the same address without the token; the host must be ours | there are no pages |
//!
//! Ours are `localhost` and loopback addresses for a peer on this machine, the address at which the connection came in, the
//! machine's name (also as `NAME.local`), and what [`AccessConfig::host_names`] lists. This stops DNS rebinding: the browser of
//! somebody who may come in runs a page of another site, whose name was made to lead here. Neither a listed address nor the
//! cookie vouches for that page; it cannot know the token. A WebSocket without an origin is no browser's.
//!
//! The origin stops pages of other sites that ask under our own name.
//!
//! rosbridge differs because its clients are programs: they have no cookie, the original headset app can send no token and is
//! let in by its address, and the page of a trial, on another port of the same host, is one of its clients.

use crate::ServeError;
use std::net::IpAddr;

/// Who may connect, and how. By default this machine alone.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct AccessConfig {
    /// Addresses that need no token.
    pub allowed_addresses: Vec<AllowedAddress>,
    /// What everybody else must send: in the address as `?token=..`, or as `Authorization: Bearer ..`. A browser keeps it
    /// once it was in the address of a page.
    pub token: Option<String>,
    /// Names and addresses of this machine that it does not know of itself, such as its name in the lab's DNS.
    pub host_names: Vec<String>,
}

/// An address that needs no token.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AllowedAddress {
    /// Whose.
    pub address: IpAddr,
    /// What may be done from there.
    pub right: AccessRight,
}

/// What somebody who may connect may do, as handlers get it in an extension of the request.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum AccessRight {
    /// See everything.
    View,
    /// Drive, pause, end.
    Control,
}

/// Which pages may ask for anything, in the browser of somebody who may connect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AllowedOrigins {
    /// Those that this server sent.
    SameServer,
    /// Those of any server on the same host, and those that know the token. Programs that are no browsers too.
    SameHost,
}

/// What is known of somebody who asks for something.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RequestCredentials<'a> {
    pub(crate) peer: IpAddr,
    /// The address of ours at which the connection came in.
    pub(crate) local_address: IpAddr,
    pub(crate) host: Option<&'a str>,
    pub(crate) origin: Option<&'a str>,
    pub(crate) query: Option<&'a str>,
    pub(crate) authorization: Option<&'a str>,
    /// All cookies in one text.
    pub(crate) cookies: &'a str,
    /// It wants a WebSocket.
    pub(crate) websocket: bool,
}

/// Why somebody is turned away: one sentence.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum AccessRefusal {
    /// It does not show what it needs.
    Unauthorized(String),
    /// It may not, whatever it shows.
    Forbidden(String),
}

/// Somebody is let in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct AccessGrant {
    pub(crate) right: AccessRight,
    /// The token was in the address.
    pub(crate) token_in_address: bool,
    /// The host name is one of ours: a browser can keep the token for it.
    pub(crate) is_own_host: bool,
}

impl AccessConfig {
    /// True if nobody but this machine can ever get in.
    pub(crate) fn is_local_only(&self) -> bool {
        self.allowed_addresses.is_empty() && self.token.is_none()
    }

    /// A token must survive an address unchanged and be too long to guess; a name must be one that browsers send.
    pub(crate) fn check(&self) -> Result<(), ServeError> {
        let plain = |byte: u8| byte.is_ascii_alphanumeric() || b"-._~".contains(&byte);
        if let Some(token) = &self.token
            && !((8..=200).contains(&token.len()) && token.bytes().all(plain))
        {
            return Err(ServeError::InvalidToken { length: token.chars().count() });
        }
        for name in &self.host_names {
            let host = name.bytes().all(|byte| byte.is_ascii_alphanumeric() || b"-._".contains(&byte));
            if name.is_empty() || !(host || name.parse::<IpAddr>().is_ok()) {
                return Err(ServeError::InvalidHostName { name: name.clone() });
            }
        }
        Ok(())
    }

    fn matches_token<'a>(&self, given: impl IntoIterator<Item = &'a str>) -> bool {
        let Some(token) = &self.token else { return false };
        given.into_iter().any(|given| constant_time_eq(given.as_bytes(), token.as_bytes()))
    }

    /// What may be done from an address without a token.
    fn right_of_address(&self, peer: IpAddr) -> Option<AccessRight> {
        let from_there = self.allowed_addresses.iter().filter(|listed| listed.address.to_canonical() == peer);
        from_there.map(|listed| listed.right).max()
    }
}

/// [`AccessConfig`] at one server.
#[derive(Clone, Debug)]
pub(crate) struct AccessPolicy {
    pub(crate) access: AccessConfig,
    pub(crate) allowed_origins: AllowedOrigins,
    /// Name of the cookie in which a browser keeps the token. Cookies have no ports: each server has a name of its own.
    pub(crate) cookie_name: String,
    /// What the machine calls itself.
    pub(crate) machine: Option<String>,
}

impl AccessPolicy {
    pub(crate) fn new(
        access: AccessConfig,
        pages: AllowedOrigins,
        port: u16,
        machine: Option<String>,
    ) -> AccessPolicy {
        AccessPolicy { access, allowed_origins: pages, cookie_name: format!("proact_token_{port}"), machine }
    }

    /// Whether the visitor may come in, and what it may do.
    pub(crate) fn authorize(&self, visitor: &RequestCredentials<'_>) -> Result<AccessGrant, AccessRefusal> {
        let access = &self.access;
        let peer = visitor.peer.to_canonical();
        let (local, listed) = (peer.is_loopback(), access.right_of_address(peer));
        let token_in_address = access.matches_token(query_values(visitor.query, "token"));
        let shown = token_in_address
            || access.matches_token(visitor.authorization.and_then(|v| v.strip_prefix("Bearer ")));
        let right = match listed {
            _ if shown || access.matches_token(self.cookie_tokens(visitor.cookies)) => AccessRight::Control,
            Some(right) => right,
            None if local && access.token.is_none() => AccessRight::Control,
            None => return Err(refuse_unauthorized(peer, self.allowed_origins)),
        };
        let program = visitor.websocket && visitor.origin.is_none();
        if self.allowed_origins == AllowedOrigins::SameHost && right < AccessRight::Control {
            return Err(AccessRefusal::Forbidden(format!(
                "{peer} may watch only, and every client here can act"
            )));
        }
        if program && self.allowed_origins == AllowedOrigins::SameHost {
            // Any browser sends the origin of a page that opens a WebSocket.
            return match local || listed.is_some() {
                true => Ok(AccessGrant { right, token_in_address, is_own_host: false }),
                false => Err(AccessRefusal::Forbidden(format!(
                    "no origin was sent, which is accepted from this machine and from listed addresses only; list it \
                     with --rosbridge-allow {peer}"
                ))),
            };
        }
        let host = visitor.host.unwrap_or_default();
        let host_is_ours = self.is_own_host_name(host_without_port(host), local, visitor.local_address);
        if !(shown || host_is_ours) {
            return Err(refuse_foreign_host(host));
        }
        if let Some(origin) = visitor.origin {
            check_origin(self.allowed_origins, origin, host, local, shown)?;
        }
        Ok(AccessGrant { right, token_in_address, is_own_host: host_is_ours })
    }

    /// The values of our cookie.
    fn cookie_tokens<'a>(&'a self, cookies: &'a str) -> impl Iterator<Item = &'a str> {
        let pairs = cookies.split(';');
        pairs.filter_map(|pair| pair.trim().strip_prefix(self.cookie_name.as_str())?.strip_prefix('='))
    }

    /// Whether a host name in a request is one of this machine's.
    fn is_own_host_name(&self, name: &str, local: bool, at: IpAddr) -> bool {
        let is = |ours: &str| name.eq_ignore_ascii_case(ours);
        if let Ok(address) = name.parse::<IpAddr>() {
            let is = |ours: IpAddr| address.to_canonical() == ours.to_canonical();
            let given = self.access.host_names.iter().filter_map(|ours| ours.parse().ok());
            return (local && address.is_loopback()) || is(at) || given.into_iter().any(is);
        }
        let machine = self.machine.iter().flat_map(|full| {
            let short = full.split('.').next().unwrap_or_default();
            [full.clone(), short.to_owned(), format!("{short}.local")]
        });
        (local && is_local_name(name))
            || self.access.host_names.iter().any(|ours| is(ours))
            || machine.into_iter().any(|ours| !ours.is_empty() && is(&ours))
    }
}

/// What this machine calls itself; none where the system does not tell.
pub(crate) fn machine_name() -> Option<String> {
    let name = std::fs::read_to_string("/proc/sys/kernel/hostname").ok()?;
    Some(name.trim().to_owned()).filter(|name| !name.is_empty() && name != "(none)")
}

/// Why a host name is refused, and what helps.
pub(crate) fn refuse_foreign_host(host: &str) -> AccessRefusal {
    let name = host_without_port(host);
    AccessRefusal::Forbidden(format!(
        "host {host:?} is not one of this machine's names; use the address that proact printed, or start proact with \
         --host-name {name} if this machine is called so"
    ))
}

fn refuse_unauthorized(peer: IpAddr, pages: AllowedOrigins) -> AccessRefusal {
    let list = if pages == AllowedOrigins::SameServer { "--page-allow" } else { "--rosbridge-allow" };
    AccessRefusal::Unauthorized(format!(
        "{peer} needs the token: open the address that proact printed, with ?token=.., or list the address with {list} \
         {peer}"
    ))
}

fn check_origin(
    pages: AllowedOrigins,
    origin: &str,
    host: &str,
    local: bool,
    shown: bool,
) -> Result<(), AccessRefusal> {
    let page = origin.split_once("://").map(|(_, rest)| rest).unwrap_or_default();
    let ours = match pages {
        AllowedOrigins::SameServer => {
            let web = origin.starts_with("http://") || origin.starts_with("https://");
            web && !page.is_empty() && page == host
        }
        // A foreign page does not know the token.
        AllowedOrigins::SameHost if shown => true,
        AllowedOrigins::SameHost => {
            let (page, host) = (host_without_port(page), host_without_port(host));
            !page.is_empty() && (page == host || (local && is_local_name(page)))
        }
    };
    if ours {
        return Ok(());
    }
    let hint = if pages == AllowedOrigins::SameHost { "; give the page the token" } else { "" };
    Err(AccessRefusal::Forbidden(format!("origin {origin:?} is another site than {host:?}{hint}")))
}

/// The values of a name in a query.
fn query_values<'a>(query: Option<&'a str>, name: &'static str) -> impl Iterator<Item = &'a str> {
    let pairs = query.unwrap_or_default().split('&');
    pairs.filter_map(move |pair| pair.strip_prefix(name)?.strip_prefix('='))
}

/// Compares in a time that does not tell how far they agree.
fn constant_time_eq(a: &[u8], b: &[u8]) -> bool {
    a.len() == b.len() && a.iter().zip(b).fold(0, |all, (a, b)| all | (a ^ b)) == 0
}

/// The name without the port, brackets or path.
fn host_without_port(host: &str) -> &str {
    let host = host.split('/').next().unwrap_or_default();
    match host.strip_prefix('[') {
        Some(rest) => rest.split(']').next().unwrap_or_default(),
        None => host.split(':').next().unwrap_or_default(),
    }
}

fn is_local_name(name: &str) -> bool {
    let name = name.to_ascii_lowercase();
    name == "localhost"
        || name.ends_with(".localhost")
        || name.parse::<IpAddr>().is_ok_and(|address| address.is_loopback())
}

#[cfg(test)]
mod tests;
