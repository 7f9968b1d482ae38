//! Floor 10, the server's settings: built-in `config/default.toml` < file < `VANTAGE_…__…` environment < flags. Unknown
//! keys are refused; an error names the key, the layer it comes from and what is allowed.

mod layers;

use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::time::Duration;

use serde::Deserialize;

use crate::cell::Findings;
use crate::{http, service};

/// All settings.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Addresses, keys and times.
    pub server: ServerSettings,
    /// Sizes.
    pub limits: LimitSettings,
    /// What is kept.
    pub store: StoreSettings,
    /// How jobs are worked on.
    pub planning: PlanningSettings,
    /// What is logged.
    pub telemetry: TelemetrySettings,
}

/// Addresses, keys and times of the HTTP side.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ServerSettings {
    /// Address and port.
    pub listen: SocketAddr,
    /// Take requests from other machines without a key.
    pub insecure: bool,
    /// The key that everything under `/api` asks for.
    pub api_key: Option<http::ApiKey>,
    /// Connections at the same time.
    pub max_connections: u32,
    /// Streams at the same time on one HTTP/2 connection.
    pub http2_max_streams: u32,
    /// Time for a request's headers.
    pub header_timeout_secs: f64,
    /// Time for the next piece of a body.
    pub body_idle_timeout_secs: f64,
    /// Time until an answer begins.
    pub request_timeout_secs: f64,
    /// Time for open requests after SIGTERM.
    pub drain_timeout_secs: f64,
}

/// Sizes.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LimitSettings {
    /// Largest upload.
    pub upload_bytes: u64,
    /// Largest JSON body.
    pub json_bytes: u64,
    /// Most triangles of a mesh.
    pub mesh_triangles: u64,
    /// Jobs that may wait.
    pub queued_jobs: u64,
}

/// What is kept.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StoreSettings {
    /// Folder of the database and the files.
    pub data_dir: PathBuf,
    /// Events of ended jobs are kept this long.
    pub event_retention_hours: u32,
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
        whole("/limits/mesh_triangles", self.limits.mesh_triangles, 1.0, 1e9);
        whole("/limits/queued_jobs", self.limits.queued_jobs, 1.0, 1e6);
        whole("/store/event_retention_hours", self.store.event_retention_hours.into(), 1.0, 87_600.0);
        whole("/planning/threads", self.planning.threads.into(), 0.0, 1024.0);
        whole("/planning/concurrent_jobs", self.planning.concurrent_jobs.into(), 1.0, 64.0);
        whole("/planning/max_attempts", self.planning.max_attempts.into(), 1.0, 100.0);
        findings.into_result()
    }

    /// What the HTTP side is told.
    #[must_use]
    pub fn http(&self) -> http::Options {
        let server = &self.server;
        http::Options {
            listen: server.listen,
            api_key: server.api_key.clone(),
            max_connections: server.max_connections as usize,
            http2_max_streams: server.http2_max_streams,
            header_timeout: Duration::from_secs_f64(server.header_timeout_secs),
            body_idle_timeout: Duration::from_secs_f64(server.body_idle_timeout_secs),
            request_timeout: Duration::from_secs_f64(server.request_timeout_secs),
            drain_timeout: Duration::from_secs_f64(server.drain_timeout_secs),
            max_json_bytes: usize::try_from(self.limits.json_bytes).unwrap_or(usize::MAX),
        }
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
            max_upload_bytes: self.limits.upload_bytes,
            max_triangles: usize::try_from(self.limits.mesh_triangles).unwrap_or(usize::MAX),
            event_retention_hours: self.store.event_retention_hours,
        }
    }
}

impl ServerSettings {
    fn check(&self, findings: &mut Findings) {
        findings.range("/server/max_connections", self.max_connections.into(), 1.0, 1e5, "");
        findings.range("/server/http2_max_streams", self.http2_max_streams.into(), 1.0, 1e4, "");
        findings.range("/server/header_timeout_secs", self.header_timeout_secs, 0.1, 600.0, "s");
        findings.range("/server/body_idle_timeout_secs", self.body_idle_timeout_secs, 0.1, 600.0, "s");
        findings.range("/server/request_timeout_secs", self.request_timeout_secs, 0.1, 600.0, "s");
        findings.range("/server/drain_timeout_secs", self.drain_timeout_secs, 0.0, 600.0, "s");
        if let Some(key) = &self.api_key {
            findings.require(key.is_usable(), "/server/api_key", || {
                "has to be 16 to 256 visible ASCII characters without ; and ,".to_owned()
            });
        }
        let guarded = self.listen.ip().is_loopback() || self.insecure || self.api_key.is_some();
        findings.require(guarded, "/server/listen", || {
            format!("is {}, which other machines reach; set server.api_key, or say --insecure to let everybody in", self.listen)
        });
    }
}

#[cfg(test)]
mod tests;
