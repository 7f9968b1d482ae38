//! Responses about the server itself.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Liveness of the process.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Health {
    /// Always `ok`.
    pub status: String,
}

/// A condition that must hold for the server to accept work.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct ReadinessCheck {
    /// Subject of the check.
    pub name: String,
    /// True if the check passed.
    pub ok: bool,
}

/// Readiness of the server to accept work.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Readiness {
    /// Always `ready`; otherwise the response is a problem with status 503.
    pub status: String,
    /// Checks that were made.
    pub checks: Vec<ReadinessCheck>,
}

/// Name and version of the program.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Version {
    /// Name of the program.
    pub name: String,
    /// Version of the program.
    pub version: String,
    /// Version of the HTTP interface.
    pub api: String,
}
