use std::net::{IpAddr, SocketAddr};

/// Why nothing can be served.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ServeError {
    /// Another program listens there.
    #[error(
        "port {port} on {address} is taken by another program, perhaps another proact; stop that program or choose \
         another port with {option}"
    )]
    PortTaken {
        /// The port asked for.
        port: u16,
        /// The address asked for.
        address: IpAddr,
        /// How another one is asked for.
        option: &'static str,
    },
    /// No port of the range that may be tried is free.
    #[error("ports {first} to {last} on {address} are all taken; choose another port with {option}")]
    NoFreePort {
        /// First port tried.
        first: u16,
        /// Last port tried.
        last: u16,
        /// The address asked for.
        address: IpAddr,
        /// How another one is asked for.
        option: &'static str,
    },
    /// The system refused to listen.
    #[error("cannot listen on {address}: {source}; choose another address or port")]
    Listen {
        /// Where.
        address: SocketAddr,
        /// The system's reason.
        source: std::io::Error,
    },
    /// Other machines could connect, and nothing says which may.
    #[error(
        "{name} would listen on {address} for other machines, and none of them may connect: list them (--rosbridge-allow ADDRESS, \
         for pages --page-allow ADDRESS), set a token, or listen on 127.0.0.1"
    )]
    AccessNotConfigured {
        /// What is served.
        name: &'static str,
        /// The address asked for.
        address: IpAddr,
    },
    /// A token that could be guessed, or would not survive in an address.
    #[error("the token has {length} characters; expected 8 to 200 letters, digits, or - . _ ~")]
    InvalidToken {
        /// How long it is.
        length: usize,
    },
    /// A name that no browser would send.
    #[error(
        "the host name {name:?} cannot be one; expected a name or an address without port, such as lab.example.org"
    )]
    InvalidHostName {
        /// What was given.
        name: String,
    },
    /// The certificate for HTTPS cannot be made.
    #[error("cannot make a certificate for HTTPS: {reason}")]
    Certificate {
        /// The library's reason.
        reason: String,
    },
    /// The server's thread or its runtime could not be started.
    #[error("cannot start the thread of {name}: {source}")]
    Thread {
        /// What is served.
        name: &'static str,
        /// The system's reason.
        source: std::io::Error,
    },
}
