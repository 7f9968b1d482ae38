//! The server's settings, in order of precedence: built-in `config/default.toml` < file < `VANTAGE_…__…`
//! environment < flags. Unknown keys are refused; an error names the key, its layer and what is allowed.

mod execution;
mod layers;
pub mod machine;
mod server;
mod values;

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::time::Duration;

use serde::Deserialize;

pub use execution::ExecutionSettings;
pub use layers::DEFAULTS;
pub use server::ServerSettings;

use crate::cell::Findings;
use crate::wire::words::is_control;
use crate::{http, service};

/// All settings.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Addresses, keys and timeouts.
    pub server: ServerSettings,
    /// Limits of sizes, numbers and times.
    pub limits: LimitSettings,
    /// Storage.
    pub store: StoreSettings,
    /// Automatic deletion.
    pub retention: RetentionSettings,
    /// Execution of jobs.
    pub planning: PlanningSettings,
    /// Execution of programs on controllers.
    pub execution: ExecutionSettings,
    /// Logging.
    pub telemetry: TelemetrySettings,
}

impl Settings {
    /// Returns true for the name of a section of a file of settings: of one that the built-in defaults have.
    #[must_use]
    pub fn has_section(name: &str) -> bool {
        layers::DEFAULTS.lines().any(|line| line.strip_prefix('[').and_then(|rest| rest.strip_suffix(']')) == Some(name))
    }
}

/// Limits of sizes, numbers and times.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LimitSettings {
    /// Largest upload, bytes.
    pub upload_bytes: u64,
    /// Largest JSON body, bytes.
    pub json_bytes: u64,
    /// Maximum rate of all downloads together, bytes per second.
    pub download_bytes_per_sec: u64,
    /// Largest number of concurrent uploads.
    pub uploads_at_once: u32,
    /// Largest number of concurrent uploads of one client.
    pub uploads_at_once_per_address: u32,
    /// Largest number of triangles of a mesh.
    pub mesh_triangles: u64,
    /// Largest number of queued jobs.
    pub queued_jobs: u64,
    /// Time limit for reading an uploaded mesh, s.
    pub parse_secs: f64,
    /// Largest estimated memory of the meshes that are read at the same time after uploads and for previews; 0 for a share of the
    /// machine's memory.
    pub parse_memory_bytes: u64,
    /// Largest estimated memory of a job, and of all that run at the same time; 0 for a share of the machine's memory.
    pub job_memory_bytes: u64,
    /// Time limit for planning a job, s; 0 for no limit.
    pub job_secs: f64,
}

/// Storage.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StoreSettings {
    /// Folder of the database and the files.
    pub data_dir: PathBuf,
    /// Time for which events of ended jobs are kept, hours.
    pub event_retention_hours: u32,
    /// Free space that uploads and new jobs must leave on the disk, bytes, unless `min_free_share` of the disk is less.
    pub min_free_bytes: u64,
    /// Share of the disk that uploads and new jobs must leave free, unless `min_free_bytes` is less.
    pub min_free_share: f64,
    /// Age at which unreferenced files are moved to `swept/`, hours.
    pub orphan_hours: u32,
    /// Time after which swept files are deleted, hours.
    pub swept_hours: u32,
    /// Interval at which every stored file is checked against its hash, hours; 0 for never.
    pub scrub_hours: u32,
}

/// Automatic deletion.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RetentionSettings {
    /// Age at which ended jobs are deleted with their results, scans and inspections, days; 0 keeps them.
    pub job_days: u32,
    /// Number of ended jobs kept per part; the others are deleted with their results, scans and inspections. 0 keeps all.
    pub jobs_per_part: u32,
    /// Time after the upload at which unused meshes are deleted, days; 0 keeps them.
    pub unused_mesh_days: u32,
    /// Time after its end at which a run is deleted with its record and its audit log, days; 0 keeps them.
    pub run_days: u32,
    /// Maximum share of the disk for stored files and the audit logs on it; 0 for no limit. At least half of it is for the files.
    pub max_disk_share: f64,
    /// Key of the label that protects a job from deletion.
    pub hold_label: String,
}

/// Execution of jobs.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlanningSettings {
    /// Number of planning threads; 0 for one per core.
    pub threads: u32,
    /// Number of jobs planned concurrently; 0 for as many as there are planning threads.
    pub concurrent_jobs: u32,
    /// Number of attempts after which a job, an inspection or a calibration that keeps crashing the server fails.
    pub max_attempts: u32,
}

/// Logging.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TelemetrySettings {
    /// Filter of log entries, by level and module.
    pub log: String,
    /// Format of the log.
    pub format: LogFormat,
}

/// Format of the log.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(try_from = "String")]
pub enum LogFormat {
    /// Lines for people.
    Text,
    /// One JSON object per line.
    Json,
}

impl TryFrom<String> for LogFormat {
    type Error = String;

    fn try_from(name: String) -> Result<Self, String> {
        match name.to_ascii_lowercase().as_str() {
            "text" => Ok(Self::Text),
            "json" => Ok(Self::Json),
            _ => Err(format!("is {name:?}; allowed is text or json")),
        }
    }
}

/// Settings from the flags of a command: keys and values.
pub type Flags = Vec<(&'static str, String)>;

/// Faults for which the settings cannot be used, one line each.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{}", .0.join("\n"))]
pub struct SettingsError(pub Vec<String>);

impl Settings {
    /// Loads the settings from all layers.
    ///
    /// # Errors
    /// [`SettingsError`] with a line for each fault.
    pub fn load(file: Option<&Path>, flags: &Flags) -> Result<Self, SettingsError> {
        Self::from_layers(file, std::env::vars_os(), flags)
    }

    /// Loads the settings from all layers, with the given environment.
    ///
    /// # Errors
    /// [`SettingsError`] with a line for each fault.
    pub fn from_layers(
        file: Option<&Path>,
        environment: impl Iterator<Item = (OsString, OsString)>,
        flags: &Flags,
    ) -> Result<Self, SettingsError> {
        let layers = layers::Layers::read(file, environment, flags)?;
        let (settings, mut findings): (Self, Findings) = layers.settings()?;
        settings.check(&mut findings);
        findings.into_result().map_err(|errors| SettingsError(layers.lines(&errors)))?;
        Ok(settings)
    }

    /// Adds a finding for each value that is not allowed, though it is of the right kind and in its range (`values.rs`).
    fn check(&self, findings: &mut Findings) {
        self.server.check(findings);
        self.execution.check(findings);
        findings.require(!self.store.data_dir.as_os_str().is_empty(), "/store/data_dir", || {
            "is empty; give the path of a folder, \".\" for the current one".to_owned()
        });
        let label = &self.retention.hold_label;
        findings.require((1..=64).contains(&label.chars().count()), "/retention/hold_label", || {
            format!("has {} characters; allowed are 1 to 64", label.chars().count())
        });
        // No job can have such a label: it would hold nothing.
        findings.require(!label.contains('=') && !label.chars().any(is_control), "/retention/hold_label", || {
            format!("is {label:?}; the key of a label has no = and no control character: leave them out")
        });
    }

    /// Options of the HTTP server.
    #[must_use]
    pub fn http(&self) -> http::ServerOptions {
        self.server.http(&self.limits)
    }

    /// Options of the service.
    #[must_use]
    pub fn service(&self) -> service::Options {
        service::Options {
            data_dir: self.store.data_dir.clone(),
            planning_threads: self.planning.threads as usize,
            concurrent_jobs: self.planning.concurrent_jobs as usize,
            max_attempts: self.planning.max_attempts,
            max_queued_jobs: self.limits.queued_jobs,
            max_uploads: self.limits.uploads_at_once as usize,
            max_upload_bytes: self.limits.upload_bytes,
            max_triangles: usize::try_from(self.limits.mesh_triangles).unwrap_or(usize::MAX),
            parse_limit: Duration::from_secs_f64(self.limits.parse_secs),
            parse_memory_bytes: match self.limits.parse_memory_bytes {
                0 => machine::memory_bytes().map_or(FALLBACK_PARSE_MEMORY_BYTES, |bytes| bytes / 100 * PARSE_PERCENT),
                bytes => bytes,
            },
            job_memory_bytes: match self.limits.job_memory_bytes {
                0 => job_memory_bytes(),
                bytes => bytes,
            },
            job_limit: (self.limits.job_secs > 0.0).then(|| Duration::from_secs_f64(self.limits.job_secs)),
            event_retention_hours: self.store.event_retention_hours,
            min_free_bytes: self.store.min_free_bytes,
            min_free_share: self.store.min_free_share,
            orphan_hours: self.store.orphan_hours,
            swept_hours: self.store.swept_hours,
            scrub_hours: self.store.scrub_hours,
            retention: service::RetentionOptions {
                job_days: self.retention.job_days,
                jobs_per_part: self.retention.jobs_per_part,
                unused_mesh_days: self.retention.unused_mesh_days,
                run_days: self.retention.run_days,
                max_disk_share: self.retention.max_disk_share,
                hold_label: self.retention.hold_label.clone(),
            },
            execution: self.execution.service(&self.store.data_dir),
        }
    }
}

/// Percentage of the machine's memory for planning; the rest is for errors of the estimate and for other processes.
const PLANNING_PERCENT: u64 = 60;
/// Percentage of the machine's memory for meshes that are read after uploads and for previews: half of what planning leaves.
const PARSE_PERCENT: u64 = 20;
/// Memory limit of those meshes if the system does not report its memory, bytes.
const FALLBACK_PARSE_MEMORY_BYTES: u64 = 1 << 30;
/// Memory limit of a job if the system does not report its memory, bytes.
const FALLBACK_JOB_MEMORY_BYTES: u64 = 4 << 30;

/// Default memory limit of a job, and of all that run at the same time, bytes.
#[must_use]
pub fn job_memory_bytes() -> u64 {
    machine::memory_bytes().map_or(FALLBACK_JOB_MEMORY_BYTES, |bytes| bytes / 100 * PLANNING_PERCENT)
}

#[cfg(test)]
mod tests;
