//! Floor 9, the service over HTTP: routes, problems, negotiation, and the loop that accepts connections. The only room
//! that knows axum, and the one that knows which status means what (`problem.rs`).

mod auth;
mod client;
mod docs;
mod events;
mod extract;
mod hosts;
mod layers;
mod metrics;
mod negotiate;
mod openapi;
mod options;
mod packed;
mod page;
mod places;
mod problem;
mod router;
mod routes;
mod seated;
mod serve;
mod sessions;
mod shares;
mod socket;

pub use auth::ApiKey;
pub use metrics::install as install_metrics;
pub use options::{Options, Quota};
pub use places::RESERVE as RESERVED_CONNECTIONS;
pub use problem::{Code, document as problems_document};
pub use router::{document as openapi, router};
pub use serve::{ServeError, Server};

#[cfg(test)]
mod tests;
