//! The HTTP server: routes, problem responses, content negotiation, and the accept loop. The only room that knows
//! axum, and the only one that maps errors to status codes (`problem.rs`).

mod auth;
mod client;
mod connection;
mod connection_limiter;
mod dashboard;
mod docs;
mod download;
mod events;
mod extract;
mod fields;
mod hosts;
mod keys;
mod layers;
mod negotiate;
mod network;
mod no_body;
mod openapi;
mod options;
mod pacer;
mod pages;
mod parse_errors;
mod prefix;
mod problem;
mod quotas;
mod router;
mod routes;
mod serve;
mod sessions;
mod socket;
mod static_response;

pub use crate::service::metrics::install as install_metrics;
pub use auth::ApiKey;
pub use connection_limiter::RESERVED_CONNECTIONS;
pub use keys::check_keys_file;
pub use network::IpNetwork;
pub use options::{Quota, ServerOptions};
pub use prefix::is_public_path;
pub use problem::{Code, document as problems_document};
pub use router::{document as openapi, router};
pub use serve::{ServeError, Server};

#[cfg(test)]
mod tests;
