//! Floor 8, the product without HTTP: meshes, specifications, jobs and their results, and what happens to them.
//!
//! [`App`] is the one value that everything goes through. What it has said is done is on the disk. Planning runs on a
//! pool of threads of its own, parsing and hashing on threads that may block; the threads that answer never do either.

mod app;
mod error;
mod events;
mod failpoint;
mod hashed;
mod jobs;
mod library;
mod maintenance;
mod meshes;
mod options;
pub mod plan_job;
pub mod run;
mod space;
mod specs;
mod store;
mod submit;
mod watch;

pub use app::App;
pub use error::{Error, Fault};
pub use events::EventStream;
pub use failpoint::NAMES as FAILPOINTS;
pub(crate) use hashed::Hashed;
pub use jobs::FAILURE_CODES;
pub use meshes::{FinishedUpload, MeshUpload, Upload};
pub use options::{Options, RetentionOptions};
pub use run::Planner;
pub use specs::SpecEntry;
pub(crate) use store::hex;
pub use store::{BackupError, BackupReport, OpenError, Precondition, backup, restore};
pub use submit::JobQuery;
pub use watch::ResultBody;

#[cfg(test)]
mod tests;
