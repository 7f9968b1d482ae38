//! Floor 10, the server's settings: built-in `config/default.toml` < file < `VANTAGE_…__…` environment < flags. Unknown
//! keys are refused; an error names the key, the layer it comes from and what is allowed.

mod layers;
pub mod machine;
mod server;

use std::path::{Path, PathBuf};
use std::time::Duration;

use serde::Deserialize;

pub use server::ServerSettings;

use crate::cell::Findings;
use crate::{http, service};

/// All settings.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Addresses, keys and times.
    pub server: ServerSettings,
    /// Sizes and numbers.
    pub limits: LimitSettings,
    /// What is kept.
    pub store: StoreSettings,
    /// What is let go, and when.
    pub retention: RetentionSettings,
    /// How jobs are worked on.
    pub planning: PlanningSettings,
    /// What is logged.
    pub telemetry: TelemetrySettings,
}

/// Sizes and numbers.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LimitSettings {
    /// Largest upload.
    pub upload_bytes: u64,
    /// Largest JSON body.
    pub json_bytes: u64,
    /// Uploads at the same time.
    pub uploads_at_once: u32,
    /// Uploads at the same time of one client.
    pub uploads_at_once_per_address: u32,
    /// Most triangles of a mesh.
    pub mesh_triangles: u64,
    /// Jobs that may wait.
    pub queued_jobs: u64,
    /// Time to make out what an uploaded mesh is.
    pub parse_secs: f64,
    /// Memory that a job may need; 0 for a share of the machine's.
    pub job_memory_bytes: u64,
    /// Time that a job may be planned; 0 for no limit.
    pub job_secs: f64,
}

/// What is kept.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StoreSettings {
    /// Folder of the database and the files.
    pub data_dir: PathBuf,
    /// Events of ended jobs are kept this long.
    pub event_retention_hours: u32,
    /// Free space that uploads and new jobs leave on the disk, unless `min_free_share` of it is less.
    pub min_free_bytes: u64,
    /// Share of the disk that they leave free, unless `min_free_bytes` is less.
    pub min_free_share: f64,
    /// Files that nothing refers to are moved to `swept/` once they are this old.
    pub orphan_hours: u32,
    /// Swept files are removed after this time.
    pub swept_hours: u32,
    /// Every stored file is compared with its hash this often; 0 for never.
    pub scrub_hours: u32,
}

/// What is let go, and when.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RetentionSettings {
    /// Ended jobs older than this are deleted; 0 keeps them.
    pub job_days: u32,
    /// Of each part this many ended jobs are kept; 0 keeps all.
    pub jobs_per_part: u32,
    /// Unused meshes are deleted this long after their upload; 0 keeps them.
    pub unused_mesh_days: u32,
    /// Share of the disk that stored files may take; 0 for no limit.
    pub max_disk_share: f64,
    /// Key of the label that keeps a job from being deleted.
    pub hold_label: String,
}

/// How jobs are worked on.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlanningSettings {
    /// Threads that plan; 0 for one a core.
    pub threads: u32,
    /// Jobs planned at the same time.
    pub concurrent_jobs: u32,
    /// How often a job is started before the death of the server in it counts as its fault.
    pub max_attempts: u32,
}

/// What is logged.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TelemetrySettings {
    /// Filter of the log.
    pub log: String,
    /// Form of the log.
    pub format: LogFormat,
}

/// Form of the log.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum LogFormat {
    /// Lines for people.
    Text,
    /// One JSON object a line.
    Json,
}

/// What the flags of a command say, by key.
pub type Flags = Vec<(&'static str, String)>;

/// Why the settings cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{}", .0.join("\n"))]
pub struct SettingsError(pub Vec<String>);

impl Settings {
    /// The settings from all layers.
    ///
    /// # Errors
    /// [`SettingsError`] with a line for each fault.
    pub fn load(file: Option<&Path>, flags: &Flags) -> Result<Self, SettingsError> {
        Self::from_layers(file, std::env::vars(), flags)
    }

    /// The settings from all layers, with the environment given.
    ///
    /// # Errors
    /// [`SettingsError`] with a line for each fault.
    pub fn from_layers(
        file: Option<&Path>,
        environment: impl Iterator<Item = (String, String)>,
        flags: &Flags,
    ) -> Result<Self, SettingsError> {
        let layers = layers::Layers::read(file, environment, flags)?;
        let settings: Self = layers.settings()?;
        settings.check().map_err(|errors| {
            let line = |pointer: &str, detail: &str| {
                let key = pointer.trim_start_matches('/').replace('/', ".");
                format!("{key} ({}) {detail}", layers.origin(&key))
            };
            SettingsError(errors.iter().map(|error| line(&error.pointer, &error.detail)).collect())
        })?;
        Ok(settings)
    }

    fn check(&self) -> Result<(), Vec<crate::cell::FieldError>> {
        let mut findings = Findings::default();
        self.server.check(&mut findings);
        let mut whole = |pointer: &str, value: u64, low: f64, high: f64| findings.range(pointer, value as f64, low, high, "");
        whole("/limits/upload_bytes", self.limits.upload_bytes, 1024.0, 1_099_511_627_776.0);
        whole("/limits/json_bytes", self.limits.json_bytes, 1024.0, 1_073_741_824.0);
        whole("/limits/uploads_at_once", self.limits.uploads_at_once.into(), 1.0, 256.0);
        whole("/limits/uploads_at_once_per_address", self.limits.uploads_at_once_per_address.into(), 1.0, 256.0);
        whole("/limits/mesh_triangles", self.limits.mesh_triangles, 1.0, 1e9);
        whole("/limits/queued_jobs", self.limits.queued_jobs, 1.0, 1e6);
        whole("/store/event_retention_hours", self.store.event_retention_hours.into(), 1.0, 87_600.0);
        whole("/store/min_free_bytes", self.store.min_free_bytes, 0.0, 1e15);
        whole("/store/orphan_hours", self.store.orphan_hours.into(), 1.0, 87_600.0);
        whole("/store/swept_hours", self.store.swept_hours.into(), 1.0, 87_600.0);
        whole("/store/scrub_hours", self.store.scrub_hours.into(), 0.0, 87_600.0);
        whole("/retention/job_days", self.retention.job_days.into(), 0.0, 36_500.0);
        whole("/retention/jobs_per_part", self.retention.jobs_per_part.into(), 0.0, 1e6);
        whole("/retention/unused_mesh_days", self.retention.unused_mesh_days.into(), 0.0, 36_500.0);
        whole("/planning/threads", self.planning.threads.into(), 0.0, 1024.0);
        whole("/planning/concurrent_jobs", self.planning.concurrent_jobs.into(), 1.0, 64.0);
        whole("/planning/max_attempts", self.planning.max_attempts.into(), 1.0, 100.0);
        findings.range("/store/min_free_share", self.store.min_free_share, 0.0, 0.9, "");
        findings.range("/retention/max_disk_share", self.retention.max_disk_share, 0.0, 1.0, "");
        let label = &self.retention.hold_label;
        findings.require((1..=64).contains(&label.chars().count()), "/retention/hold_label", || {
            format!("has {} characters; allowed are 1 to 64", label.chars().count())
        });
        findings.range("/limits/parse_secs", self.limits.parse_secs, 1.0, 3600.0, "s");
        let zero_or_more = |value: f64, least: f64| if value == 0.0 { least } else { value };
        let memory = zero_or_more(self.limits.job_memory_bytes as f64, MIN_JOB_MEMORY_BYTES);
        findings.require(memory >= MIN_JOB_MEMORY_BYTES, "/limits/job_memory_bytes", || {
            format!("is {memory:.0}; allowed is 0, for a share of the machine's memory, or {MIN_JOB_MEMORY_BYTES} or more")
        });
        let secs = zero_or_more(self.limits.job_secs, 1.0);
        findings.require((1.0..=MAX_JOB_SECS).contains(&secs), "/limits/job_secs", || {
            format!("is {secs} s; allowed is 0, for no limit, or 1 to {MAX_JOB_SECS} s")
        });
        findings.into_result()
    }

    /// What the HTTP side is told.
    #[must_use]
    pub fn http(&self) -> http::Options {
        self.server.http(&self.limits)
    }

    /// What the service is told.
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
            job_memory_bytes: match self.limits.job_memory_bytes {
                0 => job_memory_bytes(self.planning.concurrent_jobs),
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
                max_disk_share: self.retention.max_disk_share,
                hold_label: self.retention.hold_label.clone(),
            },
        }
    }
}

/// Share of the machine's memory that planning may need; the rest is for what the estimate does not know, and for others.
const PLANNING_SHARE: u64 = 60;
/// What a job may need where the system does not say what it has.
const JOB_MEMORY_BYTES: u64 = 4 << 30;
/// Less than this is not enough for any job.
const MIN_JOB_MEMORY_BYTES: f64 = 268_435_456.0;
/// A week.
const MAX_JOB_SECS: f64 = 604_800.0;

/// Memory that each of so many jobs may need that are planned at the same time.
#[must_use]
pub fn job_memory_bytes(concurrent_jobs: u32) -> u64 {
    let jobs = u64::from(concurrent_jobs.max(1));
    machine::memory_bytes().map_or(JOB_MEMORY_BYTES, |bytes| bytes / 100 * PLANNING_SHARE / jobs)
}

#[cfg(test)]
mod tests;
