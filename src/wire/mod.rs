//! Documents that leave the house: versioned JSON and CSV documents with typed ids, and the words that all outputs share.
//! Keys carry their units; degrees and plain arrays exist only here; unknown fields in a request are refused with their
//! JSON pointer.

mod angle;
mod bulk;
pub mod calibration;
pub mod candidates;
mod check;
pub mod coverage;
pub(crate) mod csv;
pub mod echo;
mod event;
pub mod example;
mod hex;
mod ids;
pub mod inspection;
mod job;
mod job_sort;
mod json;
mod json_fault;
mod json_file;
mod located;
mod mesh;
mod mesh_health;
pub mod missed;
pub mod output_record;
pub mod ovp;
pub mod parameters;
pub mod part_size;
pub mod plan;
pub mod preset;
mod problem;
pub mod program;
pub mod regions;
pub mod run;
pub mod scanner_calibration;
pub mod scanner_facts;
mod schema_name;
mod shape;
mod spec;
mod storage;
pub mod summary;
mod system;
mod tally;
mod total;
mod utc_time;
pub mod viewpoints;
pub mod warnings;
pub mod words;

pub use bulk::{DeletedJobs, JobBatch, JobBatchRequest, JobSelection, JobUpdate};
pub use check::{CheckReport, CheckRequest, DocumentKind, UnverifiedStatement};
pub use event::{EventKind, JobEvent};
pub use hex::hex;
pub use ids::{CalibrationId, InspectionId, JobId, LeaseId, MeshId, RunId, ScanId, continue_after};
pub(crate) use job::unless_blank;
pub use job::{Job, JobFile, JobListItem, JobPage, JobRequest, JobState, LabelsRequest, MAX_LABELS, label_filter_fault};
pub use job_sort::{JobSort, JobSortKey};
pub(crate) use json::{Distinct, given_twice, json_error};
pub use json::{ParseError, decode, parse, parse_document};
pub use json_file::json_file_bytes;
pub use mesh::{MeshPage, MeshUnit, UploadedMesh};
pub use mesh_health::{MeshHealthReport, MeshNoteCode};
pub use problem::{FailureCode, JobProblem, Problem, ProblemField, problem_type};
pub use shape::from_value;
pub use spec::{SpecCollection, SpecList, SpecListItem, is_spec_name};
pub use storage::{DamagedItem, Retention, RetentionPolicy, RetentionReason, RetiredJob, RetiredMesh, RetiredRun, Storage};
pub use system::{Health, HealthStatus, Readiness, ReadinessCheck, ReadinessStatus, ReadinessSubject, VERSION_LINE, Version};
pub use utc_time::UtcTime;

#[cfg(test)]
mod tests;
