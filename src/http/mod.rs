//! Floor 9, the service over HTTP: routes, problems, negotiation, and the loop that accepts connections. The only room
//! that knows axum, and the one that knows which status means what (`problem.rs`).

mod auth;
mod docs;
mod events;
mod extract;
mod layers;
mod metrics;
mod negotiate;
mod openapi;
mod options;
mod page;
mod problem;
mod router;
mod routes;
mod serve;
mod socket;

pub use auth::ApiKey;
pub use metrics::install as install_metrics;
pub use options::Options;
pub use problem::{Code, document as problems_document};
pub use router::{document as openapi, router};
pub use serve::{ServeError, Server};

#[cfg(test)]
mod tests;
