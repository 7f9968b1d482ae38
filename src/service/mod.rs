//! The product without HTTP: meshes, specifications, jobs, results and events.
//!
//! [`App`] is the single entry point. A change that it has acknowledged is on the disk. Planning runs on a thread pool of its
//! own, parsing and hashing on threads that may block; the threads that answer requests do neither.

mod app;
pub mod calibration_poses;
mod calibrations;
mod cells;
mod checks;
mod drawing;
mod error;
mod events;
mod failpoint;
mod hashing_reader;
pub mod inspect_job;
mod inspections;
mod jobs;
mod kept;
mod library;
mod log_pace;
mod maintenance;
mod meshes;
pub(crate) mod metrics;
mod options;
mod parse_memory;
pub mod plan_job;
pub mod planner;
mod presets;
pub mod progress;
mod queries;
mod recovery;
pub mod rescan_job;
mod retry;
pub mod runs;
mod scans;
mod schedule;
pub mod simulate_scans;
mod size;
mod space;
mod specs;
mod store;
mod submit;

pub use app::App;
pub use cells::{BuiltCell, KeptCells};
pub use error::{Error, InternalError, MissingRun, RunDeletion};
pub use events::EventStream;
pub use failpoint::NAMES as FAILPOINTS;
pub(crate) use hashing_reader::HashingReader;
pub(crate) use log_pace::LogPace;
pub use meshes::{FinishedUpload, MeshUpload, Upload};
pub use options::{ExecutionOptions, OperatorCell, Options, RetentionOptions};
pub use planner::Planner;
pub use queries::ResultBody;
pub use runs::{RunCursor, RunMessage, RunStream};
pub use scans::ScanUpload;
pub use size::{JobSize, Sizer};
pub use specs::SpecEntry;
pub use store::{BackupError, BackupReport, JobQuery, OpenError, PartNames, Precondition, backup, restore};
pub use submit::Submission;

/// Stack of a thread that carries tasks, bytes: as much as a main thread has. Futures lie there, large ones without optimisation.
pub(crate) const THREAD_STACK_BYTES: usize = 8 << 20;

#[cfg(test)]
mod tests;
