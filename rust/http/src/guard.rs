//! The rule in front of a router: nothing is reached but through [`Access`].

use crate::{
    access::{Access, Admission, COOKIE, Pages, Refusal, Visitor},
    server::Peer,
};
use axum::{
    extract::{Request, State},
    http::{HeaderMap, HeaderName, HeaderValue, StatusCode, header},
    middleware::Next,
    response::{IntoResponse, Response},
};
use base64::{Engine, engine::general_purpose::STANDARD as BASE64};
use std::sync::Arc;

/// Told of everybody who is turned away, in a sentence.
type Refused = dyn Fn(String) + Send + Sync;

/// The rule, and who is told of those that it turns away.
#[derive(Clone)]
pub(crate) struct Guard {
    pub(crate) access: Arc<Access>,
    pub(crate) pages: Pages,
    pub(crate) refused: Arc<Refused>,
}

/// Hands a request on if the rule allows it.
pub(crate) async fn admit(
    State(guard): State<Guard>,
    axum::Extension(peer): axum::Extension<Peer>,
    request: Request,
    next: Next,
) -> Response {
    match judge(&guard, peer, &request) {
        Ok(Admission::Welcome) => next.run(request).await,
        Ok(Admission::Remember(token)) => {
            let mut response = next.run(request).await;
            let cookie = format!("{COOKIE}={token}; Path=/; HttpOnly; SameSite=Strict");
            if response.status().is_success()
                && let Ok(cookie) = HeaderValue::from_str(&cookie)
            {
                response.headers_mut().insert(header::SET_COOKIE, cookie);
            }
            response
        }
        Err(refusal) => {
            let (status, reason) = match refusal {
                Refusal::Unknown(reason) => (StatusCode::UNAUTHORIZED, reason),
                Refusal::Foreign(reason) => (StatusCode::FORBIDDEN, reason),
            };
            (guard.refused)(format!("refused {}: {reason}", peer.0));
            (status, reason + "\n").into_response()
        }
    }
}

fn judge(guard: &Guard, peer: Peer, request: &Request) -> Result<Admission, Refusal> {
    let headers = request.headers();
    let websocket =
        headers.get(header::UPGRADE).is_some_and(|to| to.as_bytes().eq_ignore_ascii_case(b"websocket"));
    // RFC 6455, 4.2.1: sixteen bytes in base64.
    let key = headers.get(header::SEC_WEBSOCKET_KEY).map(|key| BASE64.decode(key.as_bytes()));
    if websocket && !matches!(key, Some(Ok(key)) if key.len() == 16) {
        return Err(Refusal::Foreign("the key of the WebSocket is not 16 bytes in base64".to_owned()));
    }
    let cookies: Vec<&str> = headers.get_all(header::COOKIE).iter().filter_map(|v| v.to_str().ok()).collect();
    let visitor = Visitor {
        peer: peer.0.ip(),
        host: only(headers, header::HOST)?,
        origin: only(headers, header::ORIGIN)?,
        query: request.uri().query(),
        authorization: headers.get(header::AUTHORIZATION).and_then(|value| value.to_str().ok()),
        cookies: &cookies.join(";"),
        websocket,
    };
    guard.access.admit(guard.pages, &visitor)
}

/// A header that may be there once. One of strange bytes must not pass for a missing one, nor the first of two for both.
fn only(headers: &HeaderMap, name: HeaderName) -> Result<Option<&str>, Refusal> {
    let mut values = headers.get_all(&name).iter();
    match (values.next(), values.next()) {
        (None, _) => Ok(None),
        (Some(value), None) if value.to_str().is_ok() => Ok(value.to_str().ok()),
        _ => Err(Refusal::Foreign(format!("the header {name} cannot be read"))),
    }
}
