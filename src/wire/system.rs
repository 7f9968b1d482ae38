//! Answers about the server itself.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// The process runs.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Health {
    /// Always `ok`.
    pub status: String,
}

/// One thing that must hold for the server to take work.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct ReadinessCheck {
    /// Subject of the check.
    pub name: String,
    /// True if the check passed.
    pub ok: bool,
}

/// The server takes work.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Readiness {
    /// Always `ready`; else the answer is a problem with status 503.
    pub status: String,
    /// The checks.
    pub checks: Vec<ReadinessCheck>,
}

/// Name and version of the program that answers.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Version {
    /// Name of the program.
    pub name: String,
    /// Its version.
    pub version: String,
    /// Version of the HTTP interface.
    pub api: String,
}
