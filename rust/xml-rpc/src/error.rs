//! What can be wrong with a call.

/// Why there is no answer.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The address of a node or a master.
    #[error("{text:?} is no address; expected one such as http://host:11311/")]
    Address {
        /// What was given.
        text: String,
    },
    /// The connection.
    #[error("no answer from {address}: {source}")]
    Connection {
        /// With whom.
        address: String,
        /// The system's reason.
        source: std::io::Error,
    },
    /// A message that is no XML-RPC, or beyond what is accepted.
    #[error("not understood: {what}")]
    Message {
        /// What is wrong, got and expected.
        what: String,
    },
    /// A value of another type than was asked for, or of none that XML-RPC has.
    #[error("{what}")]
    Value {
        /// What is wrong, got and expected.
        what: String,
    },
    /// The system refused to listen.
    #[error("cannot listen on {address}: {source}")]
    Listen {
        /// Where.
        address: std::net::SocketAddr,
        /// The system's reason.
        source: std::io::Error,
    },
}

/// With [`Error`].
pub type Result<T> = std::result::Result<T, Error>;

impl serde::de::Error for Error {
    fn custom<T: std::fmt::Display>(what: T) -> Self {
        Error::Value { what: what.to_string() }
    }
}
