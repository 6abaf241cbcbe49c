use std::collections::HashMap;

/// What is sent.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// A number without fraction.
    Int(i32),
    /// True or false.
    Bool(bool),
    /// A text.
    String(String),
    /// A number.
    Double(f64),
    /// A time of day, as it is written.
    DateTime(String),
    /// Bytes.
    Base64(Vec<u8>),
    /// Several values.
    Array(Vec<Value>),
    /// Values by name.
    Struct(HashMap<String, Value>),
}

/// The arguments of a call, or what it answers.
pub type Params = Vec<Value>;

/// What a call answers.
pub type Response = std::result::Result<Params, Fault>;

/// A call that went wrong at the other end.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fault {
    /// Its number.
    pub code: i32,
    /// Its reason.
    pub message: String,
}

impl Fault {
    /// A fault of that number, for that reason.
    pub fn new(code: i32, message: impl Into<String>) -> Fault {
        Fault { code, message: message.into() }
    }
}
