//! The rule in front of a router: nothing is reached but through [`AccessConfig`](crate::Access), and no answer goes out without
//! what keeps browsers from misusing it.

use crate::{
    access::{
        AccessGrant, AccessPolicy, AccessRefusal, AccessRight, RequestCredentials, refuse_foreign_host,
    },
    connections::ConnectionSlot,
    server::Peer,
};
use axum::{
    extract::{Request, State},
    http::{HeaderMap, HeaderName, HeaderValue, StatusCode, Uri, header},
    middleware::Next,
    response::{IntoResponse, Response},
};
use base64::{Engine, engine::general_purpose::STANDARD as BASE64};
use std::sync::Arc;

/// In the address of a page: the token was in it before.
const TOKEN_REMOVED_MARK: &str = "entered";

/// Told of everybody who is turned away, in a sentence.
type RefusalReporter = dyn Fn(String) + Send + Sync;

/// The rule, and who is told of those that it turns away.
#[derive(Clone)]
pub(crate) struct AccessGuard {
    pub(crate) policy: Arc<AccessPolicy>,
    pub(crate) https: bool,
    pub(crate) report_refusal: Arc<RefusalReporter>,
}

/// Hands a request on if the rule allows it.
pub(crate) async fn check_access(
    State(guard): State<AccessGuard>,
    axum::Extension(peer): axum::Extension<Peer>,
    axum::Extension(slot): axum::Extension<Arc<ConnectionSlot>>,
    mut request: Request,
    next: Next,
) -> Response {
    let policy = content_security_policy(request.headers());
    let entered =
        request.uri().query().is_some_and(|query| query.split('&').any(|pair| pair == TOKEN_REMOVED_MARK));
    let mut response = match authorize_request(&guard.policy, peer, &request) {
        Ok(admission) => {
            slot.mark_authorized();
            let (uri, host) = (request.uri().clone(), request.headers().get(header::HOST).cloned());
            request.extensions_mut().insert::<AccessRight>(admission.right);
            let response = next.run(request).await;
            match is_page(&response) {
                true if admission.token_in_address => {
                    store_token_cookie(&guard, admission, &uri, host.as_ref())
                }
                true if entered => redirect_without_mark(&uri),
                _ => response,
            }
        }
        Err(_) if entered => redirect_without_mark(request.uri()),
        Err(refusal) => refuse(&guard, peer, refusal),
    };
    set_security_headers(response.headers_mut(), policy);
    response
}

fn refuse(guard: &AccessGuard, peer: Peer, refusal: AccessRefusal) -> Response {
    let (status, reason) = match refusal {
        AccessRefusal::Unauthorized(reason) => (StatusCode::UNAUTHORIZED, reason),
        AccessRefusal::Forbidden(reason) => (StatusCode::FORBIDDEN, reason),
    };
    (guard.report_refusal)(format!("refused {}: {reason}", peer.address.ip()));
    (status, reason + "\n").into_response()
}

/// A page was asked for with the token in its address: the browser keeps the token in a cookie, and asks again without it,
/// so that the token stays in no address bar and no history.
fn store_token_cookie(
    guard: &AccessGuard,
    admission: AccessGrant,
    uri: &Uri,
    host: Option<&HeaderValue>,
) -> Response {
    if !admission.is_own_host {
        // The page itself would be refused next.
        let host = host.and_then(|host| host.to_str().ok()).unwrap_or_default();
        return match refuse_foreign_host(host) {
            AccessRefusal::Forbidden(reason) | AccessRefusal::Unauthorized(reason) => {
                (StatusCode::FORBIDDEN, reason + "\n").into_response()
            }
        };
    }
    let secret = guard.policy.access.token.as_deref().unwrap_or_default();
    let secure = if guard.https { "; Secure" } else { "" };
    let cookie = format!("{}={secret}; Path=/; HttpOnly; SameSite=Strict{secure}", guard.policy.cookie_name);
    let headers = [
        (header::SET_COOKIE, cookie),
        (header::LOCATION, add_mark(&without_token(uri))),
        (header::CACHE_CONTROL, "no-store".to_owned()),
    ];
    (StatusCode::SEE_OTHER, headers).into_response()
}

/// Second step of [`enter`]: a page of ours asks again, for the address without the mark. A browser that came by a link from
/// another site follows the first step, and even loads again, without the cookie, since the other site is what asks.
fn redirect_without_mark(uri: &Uri) -> Response {
    let refresh = format!("0; url={}", without_token(uri));
    let headers = [
        (header::REFRESH, refresh),
        (header::CONTENT_TYPE, "text/html".to_owned()),
        (header::CACHE_CONTROL, "no-store".to_owned()),
    ];
    (headers, "").into_response()
}

fn add_mark(address: &str) -> String {
    let sign = if address.contains('?') { '&' } else { '?' };
    format!("{address}{sign}{TOKEN_REMOVED_MARK}")
}

/// The same address on this server without the token and the mark.
fn without_token(uri: &Uri) -> String {
    // Two slashes in front would name another server.
    let path = uri.path().trim_start_matches('/');
    let pairs = uri.query().unwrap_or_default().split('&');
    let rest: Vec<&str> = pairs
        .filter(|pair| !pair.is_empty() && !pair.starts_with("token=") && *pair != TOKEN_REMOVED_MARK)
        .collect();
    if rest.is_empty() { format!("/{path}") } else { format!("/{path}?{}", rest.join("&")) }
}

fn is_page(response: &Response) -> bool {
    let kind = response.headers().get(header::CONTENT_TYPE).map(HeaderValue::as_bytes).unwrap_or_default();
    response.status().is_success() && kind.starts_with(b"text/html")
}

/// What a page of ours may do: load what this server sends, and talk to it. Nothing is inline, nothing is evaluated, nobody
/// frames it. The WebSocket is named because browsers before 2022 do not count it as `'self'`.
fn content_security_policy(headers: &HeaderMap) -> HeaderValue {
    let host = headers.get(header::HOST).and_then(|host| host.to_str().ok()).unwrap_or_default();
    let plain = |byte: u8| byte.is_ascii_alphanumeric() || b"-._:[]".contains(&byte);
    let sockets = match !host.is_empty() && host.bytes().all(plain) {
        true => format!(" ws://{host} wss://{host}"),
        false => String::new(),
    };
    let policy = format!(
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self'{sockets}; \
         base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    );
    HeaderValue::from_str(&policy).unwrap_or(HeaderValue::from_static("default-src 'none'"))
}

/// What every answer says to browsers. A page may bring a policy of its own.
fn set_security_headers(headers: &mut HeaderMap, policy: HeaderValue) {
    headers.entry(header::CONTENT_SECURITY_POLICY).or_insert(policy);
    headers.insert(header::X_FRAME_OPTIONS, HeaderValue::from_static("DENY"));
    headers.insert(header::X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
    headers.insert(header::REFERRER_POLICY, HeaderValue::from_static("no-referrer"));
    let ours_only = HeaderValue::from_static("same-origin");
    headers.insert(HeaderName::from_static("cross-origin-resource-policy"), ours_only);
}

fn authorize_request(
    rule: &AccessPolicy,
    peer: Peer,
    request: &Request,
) -> Result<AccessGrant, AccessRefusal> {
    let headers = request.headers();
    let websocket =
        headers.get(header::UPGRADE).is_some_and(|to| to.as_bytes().eq_ignore_ascii_case(b"websocket"));
    // RFC 6455, 4.2.1: sixteen bytes in base64.
    let key = headers.get(header::SEC_WEBSOCKET_KEY).map(|key| BASE64.decode(key.as_bytes()));
    if websocket && !matches!(key, Some(Ok(key)) if key.len() == 16) {
        return Err(AccessRefusal::Forbidden(
            "the key of the WebSocket is not 16 bytes in base64".to_owned(),
        ));
    }
    let cookies: Vec<&str> = headers.get_all(header::COOKIE).iter().filter_map(|v| v.to_str().ok()).collect();
    rule.authorize(&RequestCredentials {
        peer: peer.address.ip(),
        local_address: peer.local_address,
        host: single_header(headers, header::HOST)?,
        origin: single_header(headers, header::ORIGIN)?,
        query: request.uri().query(),
        authorization: headers.get(header::AUTHORIZATION).and_then(|value| value.to_str().ok()),
        cookies: &cookies.join(";"),
        websocket,
    })
}

/// A header that may be there once. One of strange bytes must not pass for a missing one, nor the first of two for both.
fn single_header(headers: &HeaderMap, name: HeaderName) -> Result<Option<&str>, AccessRefusal> {
    let mut values = headers.get_all(&name).iter();
    match (values.next(), values.next()) {
        (None, _) => Ok(None),
        (Some(value), None) if value.to_str().is_ok() => Ok(value.to_str().ok()),
        _ => Err(AccessRefusal::Forbidden(format!("the header {name} cannot be read"))),
    }
}
