use super::*;
use AllowedOrigins::{SameHost, SameServer};

const TOKEN: &str = "a-token-of-some-length";
const PORT: u16 = 8090;
/// Where the server is reached.
const AT: &str = "192.168.1.10";
const STRANGER: &str = "192.168.1.21";
const WATCHER: &str = "192.168.1.20";
const ACTOR: &str = "192.168.1.22";

fn access() -> AccessConfig {
    let listed = |address: &str, right| AllowedAddress { address: address.parse().unwrap(), right };
    AccessConfig {
        allowed_addresses: vec![listed(WATCHER, AccessRight::View), listed(ACTOR, AccessRight::Control)],
        token: Some(TOKEN.to_owned()),
        host_names: vec!["testbed.example.org".to_owned(), "203.0.113.7".to_owned()],
    }
}

fn rule(pages: AllowedOrigins) -> AccessPolicy {
    AccessPolicy::new(access(), pages, PORT, Some("lab".to_owned()))
}

fn without_token(pages: AllowedOrigins) -> AccessPolicy {
    AccessPolicy { access: AccessConfig { token: None, ..access() }, ..rule(pages) }
}

/// Somebody whose connection came in where one from that peer does.
fn visitor<'a>(peer: &str, host: &'a str) -> RequestCredentials<'a> {
    let peer: IpAddr = peer.parse().unwrap();
    let at = if peer.to_canonical().is_loopback() { peer } else { AT.parse().unwrap() };
    RequestCredentials {
        peer,
        local_address: at,
        host: Some(host),
        origin: None,
        query: None,
        authorization: None,
        cookies: "",
        websocket: false,
    }
}

fn page<'a>(peer: &str, origin: &'a str, host: &'a str, query: &'a str) -> RequestCredentials<'a> {
    RequestCredentials { origin: Some(origin), query: Some(query), websocket: true, ..visitor(peer, host) }
}

fn right(rule: &AccessPolicy, visitor: &RequestCredentials<'_>) -> Option<AccessRight> {
    rule.authorize(visitor).ok().map(|admission| admission.right)
}

#[test]
fn who_acts_needs_the_token_or_a_listing_that_says_so_on_this_machine_too() {
    let (token, among, wrong) =
        (format!("token={TOKEN}"), format!("quality=1&token={TOKEN}"), format!("token={}x", &TOKEN[1..]));
    let (kept, wrong_kept) =
        (format!("a=b; proact_token_{PORT}={TOKEN}"), format!("proact_token_{PORT}={TOKEN}x"));
    let other_port = format!("proact_token_9999={TOKEN}");
    let bearer = format!("Bearer {TOKEN}");
    let (act, watch) = (Some(AccessRight::Control), Some(AccessRight::View));
    for (peer, host, query, cookies, authorization, with_token, without) in [
        ("127.0.0.1", "localhost:8090", "", "", "", None, act),
        ("::1", "[::1]:8090", "", "", "", None, act),
        ("::ffff:127.0.0.1", "127.0.0.1", "", "", "", None, act),
        ("127.0.0.1", "localhost:8090", &token, "", "", act, act),
        ("127.0.0.1", "localhost:8090", "", &kept, "", act, act),
        ("127.0.0.1", "localhost:8090", "", &other_port, "", None, act),
        (WATCHER, "lab:8090", "", "", "", watch, watch),
        ("::ffff:192.168.1.20", "lab:8090", "", "", "", watch, watch),
        (WATCHER, "lab:8090", "", &kept, "", act, watch),
        (ACTOR, "lab:8090", "", "", "", act, act),
        (STRANGER, "lab:8090", "", "", "", None, None),
        (STRANGER, "localhost:8090", "", "", "", None, None),
        (STRANGER, "lab:8090", &token, "", "", act, None),
        (STRANGER, "lab:8090", &among, "", "", act, None),
        (STRANGER, "lab:8090", &wrong, "", "", None, None),
        (STRANGER, "lab:8090", "token=", "", "", None, None),
        (STRANGER, "lab:8090", "xtoken=", "", "", None, None),
        (STRANGER, "lab:8090", "", &kept, "", act, None),
        (STRANGER, "lab:8090", "", &wrong_kept, "", None, None),
        (STRANGER, "lab:8090", "", "", &bearer, act, None),
        (STRANGER, "lab:8090", "", "", TOKEN, None, None),
    ] {
        let visitor = RequestCredentials {
            query: Some(query),
            cookies,
            authorization: Some(authorization),
            ..visitor(peer, host)
        };
        for (rule, expected) in [(rule(SameServer), with_token), (without_token(SameServer), without)] {
            assert_eq!(right(&rule, &visitor), expected, "{visitor:?}");
        }
        // Who may only watch has no business at rosbridge.
        for (rule, expected) in [(rule(SameHost), with_token), (without_token(SameHost), without)] {
            assert_eq!(
                right(&rule, &visitor),
                expected.filter(|&right| right == AccessRight::Control),
                "{visitor:?}"
            );
        }
    }
    let refused = rule(SameServer).authorize(&visitor(STRANGER, "lab:8090"));
    let named = |text: &str| text.contains("--page-allow 192.168.1.21") && text.contains("token");
    assert!(matches!(&refused, Err(AccessRefusal::Unauthorized(text)) if named(text)), "{refused:?}");
}

#[test]
fn a_foreign_host_name_is_refused_whoever_asks_unless_the_token_is_in_the_request() {
    let kept = format!("proact_token_{PORT}={TOKEN}");
    let (token, bearer) = (format!("token={TOKEN}"), format!("Bearer {TOKEN}"));
    let foreign = [
        "evil.example:8090",
        "192.0.2.5:8090",
        "0.0.0.0:8090",
        "lab.evil.example",
        "localhost.evil.example",
        "",
    ];
    let from_here =
        ["localhost:8090", "LOCALHOST", "page.localhost", "127.0.0.1:8090", "127.9.9.9", "[::1]:8090"];
    let from_anywhere =
        ["lab:8090", "Lab", "lab.local:8090", "testbed.example.org:8090", "203.0.113.7", "192.168.1.10:8090"];
    for (peer, cookies) in
        [("127.0.0.1", kept.as_str()), (WATCHER, ""), (ACTOR, ""), (STRANGER, kept.as_str())]
    {
        let local = peer == "127.0.0.1";
        let hosts = (foreign.map(|host| (host, false)).into_iter())
            .chain(from_here.map(|host| (host, local)))
            .chain(from_anywhere.map(|host| (host, true)));
        for (host, ours) in hosts {
            // On this machine, its address in the lab belongs to connections that came in there.
            let ours = ours && !(local && host.starts_with("192.168"));
            for origin in [None, Some(format!("http://{host}"))] {
                let credentials =
                    RequestCredentials { origin: origin.as_deref(), cookies, ..visitor(peer, host) };
                let result = rule(SameServer).authorize(&credentials);
                assert_eq!(result.is_ok(), ours, "{credentials:?} {result:?}");
                if let Err(refusal) = result {
                    let named = |text: &str| text.contains("host") && text.contains("--host-name");
                    assert!(matches!(&refusal, AccessRefusal::Forbidden(text) if named(text)), "{refusal:?}");
                }
                if let (Some(origin), false) = (&origin, host.is_empty()) {
                    // The rebound page's WebSocket, at both servers.
                    for pages in [SameServer, SameHost] {
                        let socket = RequestCredentials { cookies, ..page(peer, origin, host, "") };
                        let may = ours && (pages == SameServer || peer != WATCHER);
                        assert_eq!(rule(pages).authorize(&socket).is_ok(), may, "{pages:?} {socket:?}");
                    }
                    for (query, authorization) in [(token.as_str(), ""), ("", bearer.as_str())] {
                        let authorization = Some(authorization);
                        let shown = RequestCredentials { authorization, ..page(peer, origin, host, query) };
                        assert_eq!(right(&rule(SameServer), &shown), Some(AccessRight::Control), "{shown:?}");
                    }
                }
            }
        }
    }
    // Without a token this machine's browsers are no safer.
    for origin in [None, Some("http://evil.example:8090")] {
        let rebound = RequestCredentials { origin, ..visitor("127.0.0.1", "evil.example:8090") };
        for pages in [SameServer, SameHost] {
            assert!(
                matches!(without_token(pages).authorize(&rebound), Err(AccessRefusal::Forbidden(_))),
                "{pages:?}"
            );
        }
    }
}

#[test]
fn only_under_a_name_of_ours_can_a_browser_be_given_the_token_to_keep() {
    let query = format!("token={TOKEN}");
    for (host, ours) in [("lab:8090", true), ("somewhere.example:8090", false)] {
        let credentials = RequestCredentials { query: Some(&query), ..visitor(STRANGER, host) };
        let admission = rule(SameServer).authorize(&credentials).unwrap();
        assert_eq!((admission.token_in_address, admission.is_own_host), (true, ours), "{host}");
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
        (ACTOR, "http://lab:8090", "lab:8090", none, true, true),
        (ACTOR, "http://lab:8090", "lab:9090", none, false, true),
        (ACTOR, "http://localhost:8090", "lab:9090", none, false, false),
        (ACTOR, "http://evil.example", "lab:8090", none, false, false),
        (STRANGER, "http://lab:8090", "lab:8090", none, false, false),
    ] {
        for (pages, admitted) in [(SameServer, own), (SameHost, of_this_host)] {
            let result = without_token(pages).authorize(&page(peer, origin, host, query));
            assert_eq!(result.is_ok(), admitted, "{pages:?} {peer} {origin} {host} {query}: {result:?}");
        }
    }
    for (peer, origin, host, own) in [
        ("127.0.0.1", "null", "localhost:8090", false),
        ("127.0.0.1", "http://evil.example", "localhost:8090", false),
        (STRANGER, "http://lab:8090", "lab:8090", true),
        (STRANGER, "http://evil.example", "lab:8090", false),
    ] {
        for (pages, admitted) in [(SameServer, own), (SameHost, true)] {
            let result = rule(pages).authorize(&page(peer, origin, host, &token));
            assert_eq!(result.is_ok(), admitted, "{pages:?} {peer} {origin} {host}: {result:?}");
        }
    }
}

#[test]
fn a_token_that_the_browser_keeps_does_not_vouch_for_the_page_that_runs_in_it() {
    let cookies = format!("proact_token_{PORT}={TOKEN}");
    for pages in [SameServer, SameHost] {
        let foreign =
            RequestCredentials { cookies: &cookies, ..page(STRANGER, "http://evil.example", "lab:8090", "") };
        assert!(matches!(rule(pages).authorize(&foreign), Err(AccessRefusal::Forbidden(_))), "{pages:?}");
    }
}

#[test]
fn a_program_without_an_origin_reaches_rosbridge_from_this_machine_and_listed_ones_only() {
    let token = format!("token={TOKEN}");
    for (peer, host, query, own, of_this_host) in [
        ("127.0.0.1", "localhost:9090", "", false, false),
        ("127.0.0.1", "localhost:9090", &token, true, true),
        ("127.0.1.1", "somewhere:9090", &token, true, true),
        (ACTOR, "lab:9090", "", true, true),
        (ACTOR, "outside.example:9090", "", false, true),
        (WATCHER, "lab:9090", "", true, false),
        (STRANGER, "lab:9090", "", false, false),
        (STRANGER, "lab:9090", &token, true, false),
    ] {
        for (pages, admitted) in [(SameServer, own), (SameHost, of_this_host)] {
            let program = RequestCredentials { query: Some(query), websocket: true, ..visitor(peer, host) };
            let result = rule(pages).authorize(&program);
            assert_eq!(result.is_ok(), admitted, "{pages:?} {peer} {host} {query}: {result:?}");
        }
    }
    let program = RequestCredentials { websocket: true, ..visitor("127.0.0.1", "localhost:9090") };
    assert_eq!(right(&without_token(SameHost), &program), Some(AccessRight::Control));
}

#[test]
fn a_token_and_a_host_name_are_checked_for_length_and_letters() {
    for bad in ["short", "with space and length", "ümlautümlaut"] {
        let access = AccessConfig { token: Some(bad.to_owned()), ..AccessConfig::default() };
        assert!(access.check().unwrap_err().to_string().contains("expected 8 to 200"), "{bad}");
    }
    for bad in ["", "http://lab", "lab:8090", "a b", "lab;"] {
        let access = AccessConfig { host_names: vec![bad.to_owned()], ..AccessConfig::default() };
        assert!(access.check().unwrap_err().to_string().contains("host name"), "{bad}");
    }
    assert!(access().check().is_ok());
}
