//! Who may connect: this machine; others with the token or from a list; and in browsers no page of another site.
//!
//! | | [`Pages::Own`] (the pages) | [`Pages::OfThisHost`] (rosbridge) |
//! |---|---|---|
//! | peer | this machine, a listed one, or whoever shows the token | the same |
//! | host name in the request, from this machine without the token | must name this machine | the same; programs, whose WebSockets have no origin, may use any |
//! | origin, if there is one | this very server: scheme, name and port | any page of the same host; any at all with the token in the address or header |
//! | WebSocket without an origin | as any request | from this machine and listed ones only |
//!
//! The host name stops DNS rebinding: a name of another site that was made to resolve to this machine. The origin stops
//! pages of other sites that run in the browser of somebody who may come in.

use crate::ServeError;
use std::net::IpAddr;

/// Name of the cookie in which a browser keeps the token.
pub(crate) const COOKIE: &str = "proact_token";

/// Who may connect beside this machine. By default nobody.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Access {
    /// Addresses that need no token, such as that of a headset whose app can send none.
    pub allowed: Vec<IpAddr>,
    /// What everybody else must send: in the address as `?token=..`, or as `Authorization: Bearer ..`. A browser keeps it
    /// once it was in the address of a page.
    pub token: Option<String>,
}

/// Which pages may ask for anything, in the browser of somebody who may connect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pages {
    /// Those that this server sent.
    Own,
    /// Those of any server on the same host, and those that know the token. Programs that are no browsers too.
    OfThisHost,
}

/// What is known of somebody who asks for something.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Visitor<'a> {
    pub(crate) peer: IpAddr,
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
pub(crate) enum Refusal {
    /// It does not show what it needs.
    Unknown(String),
    /// It may not, whatever it shows.
    Foreign(String),
}

/// Somebody is let in.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Admission {
    Welcome,
    /// The token was in the address: a browser is to keep it.
    Remember(String),
}

impl Access {
    /// True if nobody but this machine can ever get in.
    pub(crate) fn local_only(&self) -> bool {
        self.allowed.is_empty() && self.token.is_none()
    }

    /// A token must survive an address unchanged and be too long to guess.
    pub(crate) fn check(&self) -> Result<(), ServeError> {
        let Some(token) = &self.token else { return Ok(()) };
        let plain = |byte: u8| byte.is_ascii_alphanumeric() || b"-._~".contains(&byte);
        if (8..=200).contains(&token.len()) && token.bytes().all(plain) {
            return Ok(());
        }
        Err(ServeError::Token { length: token.chars().count() })
    }

    /// Whether the visitor may come in.
    pub(crate) fn admit(&self, pages: Pages, visitor: &Visitor<'_>) -> Result<Admission, Refusal> {
        let peer = visitor.peer.to_canonical();
        let (local, listed) = (peer.is_loopback(), self.lists(peer));
        let in_address = self.is_token(words_of(visitor.query, "token"));
        let shown =
            in_address || self.is_token(visitor.authorization.and_then(|v| v.strip_prefix("Bearer ")));
        let kept =
            visitor.cookies.split(';').filter_map(|pair| pair.trim().strip_prefix(COOKIE)?.strip_prefix('='));
        let known = shown || self.is_token(kept);
        if !(local || listed || known) {
            return Err(Refusal::Unknown(format!(
                "{peer} is another machine: it needs the token (the address that proact printed, with ?token=..), or its \
                 address must be listed, with --page-allow {peer} for pages, with --allow {peer} for rosbridge"
            )));
        }
        let host = visitor.host.unwrap_or_default();
        let program = visitor.websocket && visitor.origin.is_none();
        if program && pages == Pages::OfThisHost {
            // Any browser sends the origin of a page that opens a WebSocket.
            return match local || listed {
                true => Ok(Admission::Welcome),
                false => Err(Refusal::Foreign(format!(
                    "no origin was sent, which is accepted from this machine and from listed addresses only; list it \
                     with --allow {peer}"
                ))),
            };
        }
        if local && !known && !is_local_name(name_of(host)) {
            return Err(Refusal::Foreign(format!(
                "host {host:?} is not this machine; use localhost, or the address that proact printed"
            )));
        }
        if let Some(origin) = visitor.origin {
            check_origin(pages, origin, host, local, shown)?;
        }
        match &self.token {
            Some(token) if in_address && !visitor.websocket => Ok(Admission::Remember(token.clone())),
            _ => Ok(Admission::Welcome),
        }
    }

    fn lists(&self, peer: IpAddr) -> bool {
        self.allowed.iter().any(|allowed| allowed.to_canonical() == peer)
    }

    fn is_token<'a>(&self, given: impl IntoIterator<Item = &'a str>) -> bool {
        let Some(token) = &self.token else { return false };
        given.into_iter().any(|given| same(given.as_bytes(), token.as_bytes()))
    }
}

fn check_origin(pages: Pages, origin: &str, host: &str, local: bool, shown: bool) -> Result<(), Refusal> {
    let page = origin.split_once("://").map(|(_, rest)| rest).unwrap_or_default();
    let ours = match pages {
        Pages::Own => {
            let web = origin.starts_with("http://") || origin.starts_with("https://");
            web && !page.is_empty() && page == host
        }
        // A foreign page does not know the token.
        Pages::OfThisHost if shown => true,
        Pages::OfThisHost => {
            let (page, host) = (name_of(page), name_of(host));
            !page.is_empty() && (page == host || (local && is_local_name(page)))
        }
    };
    if ours {
        return Ok(());
    }
    let hint = if pages == Pages::OfThisHost { "; give the page the token" } else { "" };
    Err(Refusal::Foreign(format!("origin {origin:?} is another site than {host:?}{hint}")))
}

/// The values of a name in a query.
fn words_of<'a>(query: Option<&'a str>, name: &'static str) -> impl Iterator<Item = &'a str> {
    let pairs = query.unwrap_or_default().split('&');
    pairs.filter_map(move |pair| pair.strip_prefix(name)?.strip_prefix('='))
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
    use Pages::{OfThisHost, Own};

    const TOKEN: &str = "a-token-of-some-length";
    const STRANGER: &str = "192.168.1.21";
    const LISTED: &str = "192.168.1.20";

    fn access() -> Access {
        Access { allowed: vec![LISTED.parse().unwrap()], token: Some(TOKEN.to_owned()) }
    }

    fn visitor<'a>(peer: &str, host: &'a str) -> Visitor<'a> {
        Visitor {
            peer: peer.parse().unwrap(),
            host: Some(host),
            origin: None,
            query: None,
            authorization: None,
            cookies: "",
            websocket: false,
        }
    }

    fn page<'a>(peer: &str, origin: &'a str, host: &'a str, query: &'a str) -> Visitor<'a> {
        Visitor { origin: Some(origin), query: Some(query), websocket: true, ..visitor(peer, host) }
    }

    #[test]
    fn another_machine_needs_the_token_or_a_place_on_the_list_everywhere() {
        let (token, among, wrong) =
            (format!("token={TOKEN}"), format!("quality=1&token={TOKEN}"), format!("token={}x", &TOKEN[1..]));
        let (kept, wrong_kept) = (format!("a=b; {COOKIE}={TOKEN}"), format!("{COOKIE}={TOKEN}x"));
        let bearer = format!("Bearer {TOKEN}");
        for pages in [Own, OfThisHost] {
            for (peer, host, query, cookies, authorization, admitted) in [
                ("127.0.0.1", "localhost:8090", "", "", "", true),
                ("::1", "[::1]:8090", "", "", "", true),
                ("::ffff:127.0.0.1", "127.0.0.1", "", "", "", true),
                (LISTED, "lab:8090", "", "", "", true),
                ("::ffff:192.168.1.20", "lab:8090", "", "", "", true),
                (STRANGER, "lab:8090", "", "", "", false),
                (STRANGER, "localhost:8090", "", "", "", false),
                (STRANGER, "lab:8090", &token, "", "", true),
                (STRANGER, "lab:8090", &among, "", "", true),
                (STRANGER, "lab:8090", &wrong, "", "", false),
                (STRANGER, "lab:8090", "token=", "", "", false),
                (STRANGER, "lab:8090", "xtoken=", "", "", false),
                (STRANGER, "lab:8090", "", &kept, "", true),
                (STRANGER, "lab:8090", "", &wrong_kept, "", false),
                (STRANGER, "lab:8090", "", "", &bearer, true),
                (STRANGER, "lab:8090", "", "", TOKEN, false),
            ] {
                let visitor = Visitor {
                    query: Some(query),
                    cookies,
                    authorization: Some(authorization),
                    ..visitor(peer, host)
                };
                let result = access().admit(pages, &visitor);
                assert_eq!(result.is_ok(), admitted, "{pages:?} {visitor:?}: {result:?}");
                if let Err(reason) = result {
                    assert!(
                        matches!(&reason, Refusal::Unknown(text) if text.contains("--allow 192.168.1.21")),
                        "{reason:?}"
                    );
                }
                let closed = Access { token: None, ..access() }.admit(pages, &visitor);
                assert!(closed.is_err() || peer != STRANGER, "there is no token to know: {visitor:?}");
            }
        }
    }

    #[test]
    fn a_browser_is_to_keep_the_token_of_a_pages_address_and_of_nothing_else() {
        let query = format!("token={TOKEN}");
        let remember = Ok(Admission::Remember(TOKEN.to_owned()));
        let address = Visitor { query: Some(&query), ..visitor(STRANGER, "lab:8090") };
        assert_eq!(access().admit(Own, &address), remember);
        let socket = page(STRANGER, "http://lab:8090", "lab:8090", &query);
        assert_eq!(access().admit(Own, &socket), Ok(Admission::Welcome));
        let cookies = format!("{COOKIE}={TOKEN}");
        let kept = Visitor { cookies: &cookies, ..visitor(STRANGER, "lab:8090") };
        assert_eq!(access().admit(Own, &kept), Ok(Admission::Welcome));
    }

    #[test]
    fn a_name_that_was_made_to_resolve_to_this_machine_is_refused_without_the_token() {
        for pages in [Own, OfThisHost] {
            for origin in [None, Some("http://evil.example:8090")] {
                let rebound = Visitor { origin, ..visitor("127.0.0.1", "evil.example:8090") };
                let result = access().admit(pages, &rebound);
                assert!(
                    matches!(&result, Err(Refusal::Foreign(text)) if text.contains("not this machine")),
                    "{pages:?} {result:?}"
                );
            }
            for host in [None, Some("")] {
                let nameless = Visitor { host, ..visitor("127.0.0.1", "") };
                assert!(access().admit(pages, &nameless).is_err(), "{pages:?}");
            }
            // Somebody on this machine who calls it by its name in the lab, and has the token from the address.
            let cookies = format!("{COOKIE}={TOKEN}");
            let by_name = Visitor { cookies: &cookies, ..visitor("127.0.1.1", "lab:8090") };
            assert_eq!(access().admit(pages, &by_name), Ok(Admission::Welcome));
        }
    }

    #[test]
    fn a_page_of_another_site_is_refused() {
        let token = format!("a=b&token={TOKEN}");
        let none = "";
        for (peer, origin, host, query, own, of_this_host) in [
            ("127.0.0.1", "http://127.0.0.1:8090", "127.0.0.1:8090", none, true, true),
            ("127.0.0.1", "https://localhost:8090", "localhost:8090", none, true, true),
            ("127.0.0.1", "http://[::1]:8090", "[::1]:8090", none, true, true),
            // The page on its port, rosbridge on another.
            ("127.0.0.1", "http://localhost:8090", "localhost:9090", none, false, true),
            ("127.0.0.1", "http://127.0.0.1:8090", "localhost:9090", none, false, true),
            ("127.0.0.1", "http://[::1]:8090", "[::1]:9090", none, false, true),
            ("127.0.0.1", "http://evil.example", "localhost:8090", none, false, false),
            ("127.0.0.1", "http://evil.example", "evil.example:8090", none, false, false),
            ("127.0.0.1", "http://localhost.evil.example", "localhost:8090", none, false, false),
            ("127.0.0.1", "null", "localhost:8090", none, false, false),
            ("127.0.0.1", "", "localhost:8090", none, false, false),
            ("127.0.0.1", "file://localhost:8090", "localhost:8090", none, false, true),
            ("127.0.0.1", "null", "localhost:8090", &token, false, true),
            ("127.0.0.1", "http://evil.example", "localhost:8090", &token, false, true),
            (LISTED, "http://lab:8090", "lab:8090", none, true, true),
            (LISTED, "http://lab:8090", "lab:9090", none, false, true),
            (LISTED, "http://localhost:8090", "lab:9090", none, false, false),
            (LISTED, "http://evil.example", "lab:8090", none, false, false),
            (STRANGER, "http://lab:8090", "lab:8090", none, false, false),
            (STRANGER, "http://lab:8090", "lab:8090", &token, true, true),
            (STRANGER, "http://evil.example", "lab:8090", &token, false, true),
        ] {
            for (pages, admitted) in [(Own, own), (OfThisHost, of_this_host)] {
                let result = access().admit(pages, &page(peer, origin, host, query));
                assert_eq!(result.is_ok(), admitted, "{pages:?} {peer} {origin} {host} {query}: {result:?}");
            }
        }
    }

    #[test]
    fn a_token_that_the_browser_keeps_does_not_vouch_for_the_page_that_runs_in_it() {
        let cookies = format!("{COOKIE}={TOKEN}");
        for pages in [Own, OfThisHost] {
            let foreign =
                Visitor { cookies: &cookies, ..page(STRANGER, "http://evil.example", "lab:8090", "") };
            assert!(matches!(access().admit(pages, &foreign), Err(Refusal::Foreign(_))), "{pages:?}");
        }
    }

    #[test]
    fn a_program_without_an_origin_reaches_rosbridge_from_this_machine_and_listed_ones_only() {
        let token = format!("token={TOKEN}");
        for (peer, host, query, own, of_this_host) in [
            ("127.0.0.1", "localhost:9090", "", true, true),
            ("127.0.1.1", "lab:9090", "", false, true),
            (LISTED, "lab:9090", "", true, true),
            (STRANGER, "lab:9090", "", false, false),
            (STRANGER, "lab:9090", &token, true, false),
        ] {
            for (pages, admitted) in [(Own, own), (OfThisHost, of_this_host)] {
                let program = Visitor { query: Some(query), websocket: true, ..visitor(peer, host) };
                let result = access().admit(pages, &program);
                assert_eq!(result.is_ok(), admitted, "{pages:?} {peer} {host} {query}: {result:?}");
            }
        }
    }

    #[test]
    fn a_token_is_checked_for_length_and_letters() {
        for bad in ["short", "with space and length", "ümlautümlaut"] {
            let access = Access { token: Some(bad.to_owned()), ..Access::default() };
            assert!(access.check().unwrap_err().to_string().contains("expected 8 to 200"), "{bad}");
        }
        assert!(access().check().is_ok());
    }
}
