use crate::BusError;
use proact_http::ServeError;

/// Why rosbridge cannot be served.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RosbridgeError {
    /// The port, the address, or who may connect.
    #[error(transparent)]
    Serve(#[from] ServeError),
    /// The bus takes no more services.
    #[error("rosbridge cannot offer its own services: {0}")]
    Bus(#[from] BusError),
}
