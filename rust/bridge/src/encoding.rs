//! What goes over the line in a form that browsers take: compressed answers, and whole numbers as text.

use axum::{
    body::Body,
    http::{HeaderMap, HeaderValue, header},
    response::{IntoResponse, Response},
};
use flate2::{Compression, write::GzEncoder};
use serde::Serializer;
use std::io::Write;

/// Writes a whole number, or none, as text. A browser reads numbers of JSON as doubles and would show another one above 2^53.
pub(crate) fn as_text<T: Copy + Into<Option<u64>>, S: Serializer>(
    number: &T,
    to: S,
) -> Result<S::Ok, S::Error> {
    match (*number).into() {
        Some(number) => to.collect_str(&number),
        None => to.serialize_none(),
    }
}

/// Whether the browser takes gzip.
pub(crate) fn accepts_gzip(headers: &HeaderMap) -> bool {
    let named = headers.get_all(header::ACCEPT_ENCODING).into_iter().filter_map(|value| value.to_str().ok());
    named.flat_map(|value| value.split(',')).any(|coding| {
        let (name, quality) = coding.split_once(';').unwrap_or((coding, ""));
        name.trim() == "gzip" && !matches!(quality.trim(), "q=0" | "q=0.0" | "q=0.00" | "q=0.000")
    })
}

/// An answer whose `body` is compressed already if `gzip` says so. Caches keep both kinds apart.
pub(crate) fn encoded_response(
    headers: impl IntoIterator<Item = (header::HeaderName, &'static str)>,
    body: impl Into<Body>,
    gzip: bool,
) -> Response {
    let mut response = body.into().into_response();
    let response_headers = response.headers_mut();
    for (name, value) in headers {
        response_headers.insert(name, HeaderValue::from_static(value));
    }
    response_headers.insert(header::VARY, HeaderValue::from_static("accept-encoding"));
    if gzip {
        response_headers.insert(header::CONTENT_ENCODING, HeaderValue::from_static("gzip"));
    }
    response
}

/// `body` compressed, as fast as that goes.
pub(crate) fn gzip(body: &[u8]) -> std::io::Result<Vec<u8>> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(body)?;
    encoder.finish()
}

/// The same for a `body` that is compressed now, if `gzip` asks for that.
pub(crate) fn encode_response(
    headers: impl IntoIterator<Item = (header::HeaderName, &'static str)>,
    body: &[u8],
    gzip: bool,
) -> Response {
    // Small enough for the server's only thread: a mesh takes about a millisecond.
    match gzip.then(|| self::gzip(body)) {
        Some(Ok(small)) => encoded_response(headers, small, true),
        // Memory takes every byte; should it not, the answer goes as it is.
        _ => encoded_response(headers, body.to_vec(), false),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gzip_is_sent_to_who_takes_it() {
        let accepts = |value: &'static str| {
            accepts_gzip(&HeaderMap::from_iter([(header::ACCEPT_ENCODING, HeaderValue::from_static(value))]))
        };
        assert!(accepts("gzip, deflate, br") && accepts("br;q=1.0, gzip;q=0.5") && accepts("gzip"));
        assert!(!accepts("br") && !accepts("gzip;q=0, br") && !accepts_gzip(&HeaderMap::new()));
    }

    #[test]
    fn what_is_compressed_is_smaller_and_says_so() {
        let body = "the same again and again, ".repeat(100);
        let headers = [(header::CONTENT_TYPE, "text/plain")];
        let (small, plain) = (
            encode_response(headers.clone(), body.as_bytes(), true),
            encode_response(headers, body.as_bytes(), false),
        );
        assert_eq!(small.headers()[header::CONTENT_ENCODING], "gzip");
        assert!(!plain.headers().contains_key(header::CONTENT_ENCODING));
        assert_eq!(plain.headers()[header::VARY], "accept-encoding");
    }
}
