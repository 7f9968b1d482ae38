//! Floor 8, the product without HTTP: meshes, specifications, jobs and their results, and what happens to them.
//!
//! [`App`] is the one value that everything goes through. What it has said is done is on the disk. Planning runs on a
//! pool of threads of its own, parsing and hashing on threads that may block; the threads that answer never do either.

mod app;
mod error;
mod events;
mod failpoint;
mod jobs;
mod library;
mod meshes;
mod options;
pub mod plan_job;
pub mod run;
mod specs;
mod store;
mod submit;
mod watch;

pub use app::App;
pub use error::{Error, Fault};
pub use events::EventStream;
pub use failpoint::NAMES as FAILPOINTS;
pub use jobs::FAILURE_CODES;
pub use meshes::{FinishedUpload, MeshUpload, Upload};
pub use options::Options;
pub use run::Planner;
pub use specs::SpecEntry;
pub(crate) use store::hex;
pub use store::{OpenError, Precondition};
pub use submit::JobQuery;

#[cfg(test)]
mod tests;
