//! Settings of the execution of programs, and their allowed values.

use std::path::{Path, PathBuf};
use std::time::Duration;

use serde::Deserialize;

use super::server::list;
use crate::cell::Findings;
use crate::service::ExecutionOptions;

/// Execution of programs on controllers.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExecutionSettings {
    /// Let runs move arms and tables.
    pub live: bool,
    /// Cell files with a section `[controllers]`.
    #[serde(deserialize_with = "list")]
    pub cells: Vec<PathBuf>,
    /// Time after which a lease ends unless it is renewed.
    pub lease_secs: f64,
    /// Interval at which holders are told to renew it.
    pub heartbeat_secs: f64,
    /// Folder of the audit logs; empty for `audit/` in the folder of the store.
    pub audit_dir: PathBuf,
    /// Size at which a file of an audit log is closed.
    pub audit_file_bytes: u64,
    /// Number of files kept of one audit log.
    pub audit_files: u32,
    /// Largest number of runs that have not ended.
    pub max_runs: u32,
}

impl ExecutionSettings {
    /// Adds a finding for each value that is not allowed.
    pub(super) fn check(&self, findings: &mut Findings) {
        findings.require(2.0 * self.heartbeat_secs <= self.lease_secs, "/execution/heartbeat_secs", || {
            let (secs, lease_secs) = (self.heartbeat_secs, self.lease_secs);
            let most = lease_secs / 2.0;
            format!(
                "is {secs} s; allowed is half of execution.lease_secs at most, {most} s: lower it, or raise execution.lease_secs"
            )
        });
        let has_empty = self.cells.iter().any(|cell| cell.as_os_str().is_empty());
        findings.require(!has_empty, "/execution/cells", || "contains an empty path; give the paths of cell files".to_owned());
        let is_served = !self.live || !self.cells.is_empty();
        findings.require(is_served, "/execution/live", || {
            "is true, but execution.cells names no cell file; name those of the cells to run there, or set it to false".to_owned()
        });
    }

    /// Options of the service, without the cells, whose files the command reads.
    pub(super) fn service(&self, data_dir: &Path) -> ExecutionOptions {
        let is_default = self.audit_dir.as_os_str().is_empty();
        ExecutionOptions {
            live: self.live,
            cells: Vec::new(),
            lease_ttl: Duration::from_secs_f64(self.lease_secs),
            heartbeat: Duration::from_secs_f64(self.heartbeat_secs),
            audit_dir: if is_default { data_dir.join("audit") } else { self.audit_dir.clone() },
            audit_file_bytes: self.audit_file_bytes,
            audit_files: self.audit_files as usize,
            max_runs: self.max_runs as usize,
        }
    }
}
