//! Who may connect.

use std::net::IpAddr;

/// Who may connect beside this machine. By default nobody.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Access {
    /// Addresses that need no token, such as that of a headset whose app can send none.
    pub allowed: Vec<IpAddr>,
    /// What everybody else must send: `ws://host:port/?token=..`, or as `Authorization: Bearer ..`.
    pub token: Option<String>,
}

/// What is known of somebody who wants to connect.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Visitor<'a> {
    pub(crate) origin: Option<&'a str>,
    pub(crate) host: Option<&'a str>,
    pub(crate) query: Option<&'a str>,
    pub(crate) authorization: Option<&'a str>,
}

impl Access {
    /// True if nobody but this machine can ever get in.
    pub(crate) fn local_only(&self) -> bool {
        self.allowed.is_empty() && self.token.is_none()
    }

    /// A token must survive an address unchanged and be too long to guess.
    pub(crate) fn check(&self) -> Result<(), String> {
        let Some(token) = &self.token else { return Ok(()) };
        let plain = |byte: u8| byte.is_ascii_alphanumeric() || b"-._~".contains(&byte);
        if token.len() >= 8 && token.len() <= 200 && token.bytes().all(plain) {
            return Ok(());
        }
        Err(format!(
            "the token has {} characters; expected 8 to 200 letters, digits, or - . _ ~",
            token.chars().count()
        ))
    }

    /// Whether the visitor may come in; otherwise one sentence why not.
    ///
    /// A page of another site that runs in the browser of somebody who may come in gives itself away by its
    /// origin. With the right token any origin will do: a foreign page does not know it.
    pub(crate) fn admit(&self, peer: IpAddr, visitor: Visitor<'_>) -> Result<(), String> {
        let peer = peer.to_canonical();
        let (local, listed) = (peer.is_loopback(), self.lists(peer));
        let token = self.knows_token(visitor);
        if !(local || listed || token) {
            return Err(format!(
                "{peer} is another machine: it needs the token (ws://host:port/?token=..), or its address must be \
                 listed with --allow {peer}"
            ));
        }
        let Some(origin) = visitor.origin else {
            if local || listed {
                return Ok(());
            }
            return Err(format!(
                "no origin was sent, which is accepted from this machine and from listed addresses only; list it \
                 with --allow {peer}"
            ));
        };
        if token {
            return Ok(());
        }
        let host = visitor.host.map(name_of).unwrap_or_default();
        if local && !listed && !is_local_name(host) {
            // Another site's name that was made to resolve to this machine.
            return Err(format!("host {host:?} is not this machine"));
        }
        let page = origin.split_once("://").map(|(_, rest)| name_of(rest)).unwrap_or_default();
        if !page.is_empty() && (page == host || (local && is_local_name(page))) {
            return Ok(());
        }
        Err(format!("origin {origin:?} is another site than {host:?}; give the page the token"))
    }

    fn lists(&self, peer: IpAddr) -> bool {
        self.allowed.iter().any(|allowed| allowed.to_canonical() == peer)
    }

    fn knows_token(&self, visitor: Visitor<'_>) -> bool {
        let Some(token) = &self.token else { return false };
        let query = visitor.query.unwrap_or_default();
        let in_query = query.split('&').filter_map(|pair| pair.strip_prefix("token="));
        let in_header = visitor.authorization.and_then(|value| value.strip_prefix("Bearer "));
        in_query.chain(in_header).any(|given| same(given.as_bytes(), token.as_bytes()))
    }
}

/// Compares in a time that does not tell how far they agree.
fn same(a: &[u8], b: &[u8]) -> bool {
    a.len() == b.len() && a.iter().zip(b).fold(0, |all, (a, b)| all | (a ^ b)) == 0
}

/// The name without the port, brackets or path.
fn name_of(host: &str) -> &str {
    let host = host.split('/').next().unwrap_or_default();
    match host.strip_prefix('[') {
        Some(rest) => rest.split(']').next().unwrap_or_default(),
        None => host.split(':').next().unwrap_or_default(),
    }
}

fn is_local_name(name: &str) -> bool {
    name == "localhost"
        || name.ends_with(".localhost")
        || name.parse::<IpAddr>().is_ok_and(|address| address.is_loopback())
}

#[cfg(test)]
mod tests {
    use super::*;

    const TOKEN: &str = "a-token-of-some-length";

    fn access() -> Access {
        Access { allowed: vec!["192.168.1.20".parse().unwrap()], token: Some(TOKEN.to_owned()) }
    }

    fn admitted(peer: &str, origin: Option<&str>, host: &str, query: &str) -> bool {
        let visitor = Visitor { origin, host: Some(host), query: Some(query), authorization: None };
        access().admit(peer.parse().unwrap(), visitor).is_ok()
    }

    #[test]
    fn this_machine_and_listed_addresses_come_in_without_origin_and_others_never_do() {
        let token = format!("token={TOKEN}");
        for (peer, query, expected) in [
            ("127.0.0.1", "", true),
            ("::1", "", true),
            ("::ffff:127.0.0.1", "", true),
            ("192.168.1.20", "", true),
            ("::ffff:192.168.1.20", "", true),
            ("192.168.1.21", "", false),
            ("192.168.1.21", token.as_str(), false),
        ] {
            assert_eq!(admitted(peer, None, "192.168.1.2:9090", query), expected, "{peer} {query}");
        }
    }

    #[test]
    fn a_page_comes_in_from_the_same_host_or_with_the_token() {
        let token = format!("a=b&token={TOKEN}");
        for (peer, origin, host, query, expected) in [
            ("127.0.0.1", "http://localhost:8090", "localhost:9090", "", true),
            ("127.0.0.1", "http://127.0.0.1:8090", "localhost:9090", "", true),
            ("127.0.0.1", "http://[::1]:8090", "[::1]:9090", "", true),
            ("127.0.0.1", "http://evil.example", "localhost:9090", "", false),
            ("127.0.0.1", "http://evil.example", "evil.example:9090", "", false),
            ("127.0.0.1", "http://localhost.evil.example", "localhost:9090", "", false),
            ("127.0.0.1", "null", "localhost:9090", "", false),
            ("127.0.0.1", "null", "localhost:9090", token.as_str(), true),
            ("192.168.1.20", "http://lab:8090", "lab:9090", "", true),
            ("192.168.1.20", "http://evil.example", "lab:9090", "", false),
            ("192.168.1.21", "http://lab:8090", "lab:9090", "", false),
            ("192.168.1.21", "http://lab:8090", "lab:9090", token.as_str(), true),
            ("192.168.1.21", "http://lab:8090", "lab:9090", "token=a-token-of-some-lengtH", false),
            ("192.168.1.21", "http://lab:8090", "lab:9090", "token=", false),
        ] {
            assert_eq!(admitted(peer, Some(origin), host, query), expected, "{peer} {origin} {host} {query}");
        }
    }

    #[test]
    fn the_token_is_taken_from_the_header_too_and_checked_for_length() {
        let header = format!("Bearer {TOKEN}");
        let visitor = Visitor { origin: Some("null"), authorization: Some(&header), ..Visitor::default() };
        assert_eq!(access().admit("10.0.0.1".parse().unwrap(), visitor), Ok(()));
        for bad in ["short", "with space and length", "ümlautümlaut"] {
            let access = Access { token: Some(bad.to_owned()), ..Access::default() };
            assert!(access.check().unwrap_err().contains("expected 8 to 200"), "{bad}");
        }
        assert_eq!(access().check(), Ok(()));
    }
}
