use proact_http::ServeError;

/// Why the page cannot be served.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BridgeError {
    /// The port, the address, the certificate, or who may connect.
    #[error(transparent)]
    Serve(#[from] ServeError),
    /// Arm or scene cannot be shown.
    #[error("the page cannot show this content: {what}")]
    Content {
        /// What is wrong, got and expected.
        what: String,
    },
}
