use std::net::SocketAddr;

/// Why the page cannot be served.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BridgeError {
    /// Another program listens there.
    #[error(
        "port {port} on {address} is taken by another program; stop that program, choose another port with \
         --port, or let the next free port be used"
    )]
    PortTaken {
        /// The port asked for.
        port: u16,
        /// The address asked for.
        address: std::net::IpAddr,
    },
    /// No port of the range that may be tried is free.
    #[error("ports {first} to {last} on {address} are all taken; choose another port with --port")]
    NoFreePort {
        /// First port tried.
        first: u16,
        /// Last port tried.
        last: u16,
        /// The address asked for.
        address: std::net::IpAddr,
    },
    /// Another program listens where rosbridge was to listen.
    #[error(
        "port {port} on {address} is taken by another program, perhaps another rosbridge; stop it or choose \
         another port with --rosbridge PORT"
    )]
    RosbridgePortTaken {
        /// The port asked for.
        port: u16,
        /// The address asked for.
        address: std::net::IpAddr,
    },
    /// Other machines could connect, and nothing says which may.
    #[error(
        "rosbridge would listen on {address} for other machines, and none of them may connect: list them with \
         --allow ADDRESS, set a --token TOKEN, or listen on 127.0.0.1"
    )]
    Unguarded {
        /// The address asked for.
        address: std::net::IpAddr,
    },
    /// The system refused to listen.
    #[error("cannot listen on {address}: {source}; choose another address or port")]
    Listen {
        /// Where.
        address: SocketAddr,
        /// The system's reason.
        source: std::io::Error,
    },
    /// The certificate for HTTPS cannot be made.
    #[error("cannot make a certificate for HTTPS: {what}")]
    Certificate {
        /// The library's reason.
        what: String,
    },
    /// The server's thread or its runtime could not be started.
    #[error("cannot start the page's server thread: {source}")]
    Thread {
        /// The system's reason.
        source: std::io::Error,
    },
    /// Arm or scene cannot be shown.
    #[error("the page cannot show this content: {what}")]
    Content {
        /// What is wrong, got and expected.
        what: String,
    },
}
