//! Who may connect: pages of this server only, and from other machines only with the token or a listed address.

use crate::PageOptions;
use axum::{
    extract::{ConnectInfo, Request, State},
    http::{HeaderMap, HeaderValue, StatusCode, Uri, header},
    middleware::Next,
    response::{IntoResponse, Response},
};
use std::{
    net::{IpAddr, SocketAddr},
    sync::Arc,
};

const COOKIE: &str = "proact_token";

/// Which machines are let in beside this one.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Access {
    /// What others have to show: in the address once, then the browser keeps it. None lets nobody in.
    pub(crate) token: Option<String>,
    /// Machines that need no token.
    pub(crate) allowed: Vec<IpAddr>,
    /// Only this machine can connect at all.
    pub(crate) local_only: bool,
}

impl Access {
    /// As the options of a server have it.
    pub(crate) fn new(options: &PageOptions) -> Access {
        Access {
            token: options.token.clone(),
            allowed: options.allowed.clone(),
            local_only: options.bind.is_loopback(),
        }
    }
}

/// The other end of a connection.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Peer(pub(crate) IpAddr);

impl From<SocketAddr> for Peer {
    fn from(address: SocketAddr) -> Self {
        Peer(address.ip().to_canonical())
    }
}

/// Refuses other machines without a token, and requests that another site's page makes in the person's browser: such
/// a page could drive the arm.
pub(crate) async fn refuse_strangers(
    State(access): State<Arc<Access>>,
    ConnectInfo(address): ConnectInfo<SocketAddr>,
    request: Request,
    next: Next,
) -> Response {
    if let Some(reason) = foreign(request.headers(), access.local_only) {
        return (StatusCode::FORBIDDEN, reason).into_response();
    }
    match admit(&access, address.into(), request.uri(), request.headers()) {
        Admission::Welcome => next.run(request).await,
        Admission::Remember(token) => {
            let mut response = next.run(request).await;
            let cookie = format!("{COOKIE}={token}; Path=/; HttpOnly; SameSite=Strict");
            if let Ok(cookie) = HeaderValue::from_str(&cookie) {
                response.headers_mut().insert(header::SET_COOKIE, cookie);
            }
            response
        }
        Admission::Refused => {
            let reason = "this page needs the token: open the address that proact printed, or start proact serve with \
                          --page-allow and the address of this machine\n";
            (StatusCode::UNAUTHORIZED, reason).into_response()
        }
    }
}

#[derive(Debug, PartialEq, Eq)]
enum Admission {
    Welcome,
    /// Let in by the address; from now on the browser shows the token by itself.
    Remember(String),
    Refused,
}

fn admit(access: &Access, peer: Peer, uri: &Uri, headers: &HeaderMap) -> Admission {
    if peer.0.is_loopback() || access.allowed.contains(&peer.0) {
        return Admission::Welcome;
    }
    let Some(token) = &access.token else { return Admission::Refused };
    let asked = uri.query().unwrap_or_default().split('&').find_map(|pair| pair.strip_prefix("token="));
    if asked.is_some_and(|asked| same(asked, token)) {
        return Admission::Remember(token.clone());
    }
    let cookies = headers.get_all(header::COOKIE).iter().filter_map(|value| value.to_str().ok());
    let known = cookies
        .flat_map(|text| text.split(';'))
        .filter_map(|pair| pair.trim().strip_prefix(COOKIE)?.strip_prefix('='))
        .any(|shown| same(shown, token));
    if known { Admission::Welcome } else { Admission::Refused }
}

/// Compares without telling by its time how much of it was right.
fn same(a: &str, b: &str) -> bool {
    a.len() == b.len() && a.bytes().zip(b.bytes()).fold(0, |differ, (a, b)| differ | (a ^ b)) == 0
}

fn foreign(headers: &HeaderMap, local_only: bool) -> Option<String> {
    let text = |name| headers.get(name).and_then(|value: &HeaderValue| value.to_str().ok());
    let host = text(header::HOST).unwrap_or_default();
    if local_only && !is_local_name(host) {
        // Another site's name that was made to resolve to this machine.
        return Some(format!("host {host:?} is not this machine\n"));
    }
    let origin = text(header::ORIGIN)?;
    let same = origin.strip_prefix("http://").or_else(|| origin.strip_prefix("https://")) == Some(host);
    (!same).then(|| format!("origin {origin:?} is not this server, which is {host:?}\n"))
}

fn is_local_name(host: &str) -> bool {
    let name = match host.strip_prefix('[') {
        Some(rest) => rest.split(']').next().unwrap_or_default(),
        None => host.split(':').next().unwrap_or_default(),
    };
    name == "localhost"
        || name.ends_with(".localhost")
        || name.parse::<IpAddr>().is_ok_and(|address| address.is_loopback())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn headers(host: &'static str, origin: Option<&'static str>) -> HeaderMap {
        let mut map = HeaderMap::new();
        map.insert(header::HOST, host.parse().unwrap());
        if let Some(origin) = origin {
            map.insert(header::ORIGIN, origin.parse().unwrap());
        }
        map
    }

    #[test]
    fn pages_of_other_sites_are_refused_and_our_own_are_not() {
        for (host, origin, local_only, allowed) in [
            ("127.0.0.1:8090", None, true, true),
            ("127.0.0.1:8090", Some("http://127.0.0.1:8090"), true, true),
            ("localhost:8090", Some("http://localhost:8090"), true, true),
            ("[::1]:8090", Some("http://[::1]:8090"), true, true),
            ("127.0.0.1:8090", Some("http://evil.example"), true, false),
            ("127.0.0.1:8090", Some("null"), true, false),
            ("evil.example:8090", Some("http://evil.example:8090"), true, false),
            ("lab.example:8090", Some("http://lab.example:8090"), false, true),
            ("lab.example:8090", Some("http://evil.example"), false, false),
        ] {
            let refused = foreign(&headers(host, origin), local_only);
            assert_eq!(refused.is_none(), allowed, "{host} {origin:?}: {refused:?}");
        }
    }

    #[test]
    fn another_machine_needs_the_token_or_a_place_on_the_list() {
        let listed: IpAddr = "192.0.2.7".parse().unwrap();
        let access = Access { token: Some("secret".into()), allowed: vec![listed], local_only: false };
        let stranger = Peer("192.0.2.8".parse().unwrap());
        let plain = HeaderMap::new();
        let mut known = HeaderMap::new();
        known.insert(header::COOKIE, "a=b; proact_token=secret".parse().unwrap());
        let mut wrong = HeaderMap::new();
        wrong.insert(header::COOKIE, "proact_token=secreT".parse().unwrap());
        let remember = Admission::Remember("secret".into());
        for (peer, uri, headers, expected) in [
            (Peer("127.0.0.1".parse().unwrap()), "/", &plain, &Admission::Welcome),
            (Peer("::1".parse().unwrap()), "/", &plain, &Admission::Welcome),
            (Peer(listed), "/live", &plain, &Admission::Welcome),
            (stranger, "/", &plain, &Admission::Refused),
            (stranger, "/?token=secret", &plain, &remember),
            (stranger, "/?quality=1&token=secret", &plain, &remember),
            (stranger, "/?token=secre", &plain, &Admission::Refused),
            (stranger, "/?token=", &plain, &Admission::Refused),
            (stranger, "/live", &known, &Admission::Welcome),
            (stranger, "/live", &wrong, &Admission::Refused),
        ] {
            assert_eq!(&admit(&access, peer, &uri.parse().unwrap(), headers), expected, "{peer:?} {uri}");
        }
        let closed = Access { token: None, ..Access::default() };
        assert_eq!(admit(&closed, stranger, &"/?token=".parse().unwrap(), &plain), Admission::Refused);
    }

    #[test]
    fn an_address_mapped_into_ipv6_is_the_same_machine() {
        let mapped: SocketAddr = "[::ffff:127.0.0.1]:80".parse().unwrap();
        assert!(Peer::from(mapped).0.is_loopback());
    }
}
