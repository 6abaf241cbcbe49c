//! The keys of a client's message, and what is said of those that cannot be obeyed.

use crate::outbox::Compression;
use serde_json::{Map, Value as Json};

/// How much a client wants to be told.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum StatusLevel {
    Info,
    Warning,
    Error,
    Silent,
}

/// A message of the client that was not obeyed.
pub(crate) struct RequestError(pub(crate) StatusLevel, pub(crate) String);

impl<E: std::error::Error> From<E> for RequestError {
    fn from(error: E) -> Self {
        RequestError(StatusLevel::Error, error.to_string())
    }
}

pub(crate) fn refuse<T>(text: impl Into<String>) -> Result<T, RequestError> {
    Err(RequestError(StatusLevel::Error, text.into()))
}

pub(crate) fn json_type_name(json: &Json) -> &'static str {
    match json {
        Json::Null => "null",
        Json::Bool(_) => "true or false",
        Json::Number(_) => "a number",
        Json::String(_) => "a text",
        Json::Array(_) => "an array",
        Json::Object(_) => "an object",
    }
}

/// A name in the root namespace: `chat` is `/chat`, as for a node of ROS without a namespace.
pub(crate) fn absolute_name(name: &str) -> String {
    if name.starts_with('/') || name.is_empty() { name.to_owned() } else { format!("/{name}") }
}

/// The keys of a message, taken one by one.
pub(crate) struct RequestFields {
    pub(crate) map: Map<String, Json>,
    pub(crate) op: String,
}

impl RequestFields {
    fn type_error<T>(&self, name: &str, got: &Json, expected: &str) -> Result<T, RequestError> {
        let separator = if self.op.is_empty() { "" } else { ": " };
        refuse(format!("{}{separator}{name:?} is {}, expected {expected}", self.op, json_type_name(got)))
    }

    pub(crate) fn text(&mut self, name: &str) -> Result<String, RequestError> {
        match self.map.remove(name) {
            Some(Json::String(text)) => Ok(text),
            Some(other) => self.type_error(name, &other, "a text"),
            None => refuse(format!("{}: the key {name:?} is missing, expected a text", self.op)),
        }
    }

    /// The name of a topic or service.
    pub(crate) fn name(&mut self, name: &str) -> Result<String, RequestError> {
        Ok(absolute_name(&self.text(name)?))
    }

    pub(crate) fn optional_text(&mut self, name: &str) -> Result<Option<String>, RequestError> {
        match self.map.remove(name) {
            None | Some(Json::Null) => Ok(None),
            Some(Json::String(text)) => Ok(Some(text)),
            Some(other) => self.type_error(name, &other, "a text"),
        }
    }

    /// Ids are texts; some clients send numbers.
    pub(crate) fn id(&mut self) -> Result<Option<String>, RequestError> {
        match self.map.remove("id") {
            None | Some(Json::Null) => Ok(None),
            Some(Json::String(text)) => Ok(Some(text)),
            Some(Json::Number(number)) => Ok(Some(number.to_string())),
            Some(other) => self.type_error("id", &other, "a text"),
        }
    }

    pub(crate) fn number(&mut self, name: &str) -> Result<Option<f64>, RequestError> {
        match self.map.remove(name) {
            None | Some(Json::Null) => Ok(None),
            Some(Json::Number(number)) if number.as_f64().is_some_and(|x| x >= 0.0) => Ok(number.as_f64()),
            Some(other) => self.type_error(name, &other, "a number that is not negative"),
        }
    }

    /// A number of things; fractions are cut off.
    pub(crate) fn count(&mut self, name: &str) -> Result<Option<usize>, RequestError> {
        Ok(self.number(name)?.map(|x| x as usize))
    }

    pub(crate) fn flag(&mut self, name: &str) -> Result<Option<bool>, RequestError> {
        match self.map.remove(name) {
            None | Some(Json::Null) => Ok(None),
            Some(Json::Bool(flag)) => Ok(Some(flag)),
            Some(other) => self.type_error(name, &other, "true or false"),
        }
    }

    pub(crate) fn compression(&mut self) -> Result<Compression, RequestError> {
        match self.optional_text("compression")?.as_deref() {
            None | Some("" | "none") => Ok(Compression::None),
            Some("png") => Ok(Compression::Png),
            Some("cbor") => Ok(Compression::Cbor),
            Some("cbor-raw") => Ok(Compression::CborRaw),
            Some(other) => refuse(format!(
                "{}: compression {other:?} is not known, expected none, png, cbor or cbor-raw",
                self.op
            )),
        }
    }
}
