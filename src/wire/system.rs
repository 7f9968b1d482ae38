//! Responses about the server itself.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::cell::closed_list;

closed_list! {
    /// Liveness of the process, in a word.
    pub enum HealthStatus {
        /// The process responds.
        Ok = "ok",
    }
}

/// Liveness of the process.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Health {
    /// Always `ok`.
    pub status: HealthStatus,
}

closed_list! {
    /// Subject of a check of readiness.
    pub enum ReadinessSubject {
        /// The server is not shutting down.
        NotStopping = "not_stopping",
        /// The store can be read and written.
        Storage = "storage",
        /// The store's disk has room.
        FreeSpace = "free_space",
        /// A planning thread is left.
        Planning = "planning",
    }
}

closed_list! {
    /// Readiness of the server, in a word.
    pub enum ReadinessStatus {
        /// The server accepts work.
        Ready = "ready",
    }
}

/// A condition that must hold for the server to accept work.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct ReadinessCheck {
    /// Subject of the check.
    pub name: ReadinessSubject,
    /// True if the check passed.
    pub ok: bool,
}

/// Readiness of the server to accept work.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Readiness {
    /// Always `ready`; otherwise the response is a problem with status 503.
    pub status: ReadinessStatus,
    /// Checks that were made.
    pub checks: Vec<ReadinessCheck>,
}

/// Version with commit and target, as `vantage --version` prints it.
pub const VERSION_LINE: &str =
    concat!(env!("CARGO_PKG_VERSION"), " (commit ", env!("VANTAGE_COMMIT"), ", ", env!("VANTAGE_TARGET"), ")");

/// Name and version of the program.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Version {
    /// Name of the program.
    pub name: String,
    /// Version of the program.
    pub version: String,
    /// Version of the HTTP interface.
    pub api: String,
    /// Commit that the program was built from: its first digits, `unknown` where the sources name none, or `development` for a
    /// build without optimisation.
    pub commit: String,
    /// Target that the program was built for, as Rust names it.
    pub target: String,
}

impl Version {
    /// Version of this program.
    #[must_use]
    pub fn of_this_program() -> Self {
        Self {
            name: env!("CARGO_PKG_NAME").to_owned(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            api: "v1".to_owned(),
            commit: env!("VANTAGE_COMMIT").to_owned(),
            target: env!("VANTAGE_TARGET").to_owned(),
        }
    }
}
