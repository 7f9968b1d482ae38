//! Background maintenance of the store: pruning of events, sweep of orphans, retention, scrubbing. None of it delays the start.

use std::time::Duration;

use super::app::App;
use super::error::Error;
use super::runs::{LogSizes, log_sizes};
use super::space::share_a_disk;
use super::store::{Due, Policy, blocking};
use crate::wire::{
    DamagedItem, Retention, RetentionPolicy, RetentionReason, RetiredJob, RetiredMesh, RetiredRun, RunId, Storage,
};

/// Interval of the maintenance rounds.
const ROUND_INTERVAL: Duration = Duration::from_secs(3600);
/// Max jobs, max meshes and max runs that a response lists.
const MAX_LISTED: usize = 1000;

const HOUR_SECS: u64 = 3600;

/// Runs with the sizes of their audit logs.
type SizedRuns = Vec<(RunId, u64)>;

/// The retention policy as it applies now.
struct PolicyNow {
    policy: Policy,
    /// Runs that it deletes for their age.
    runs: SizedRuns,
    /// Share of the disk; `None` without a limit.
    share: Option<DiskShare>,
}

/// The share of the disk that `retention.max_disk_share` allows, with the audit logs on that disk. Audit logs record what was moved, and
/// have an age of their own: none is deleted for the share. Half of it is for the stored files, whatever the logs take, so that logs
/// that grow do not delete every job.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct DiskShare {
    max_bytes: u64,
    logs_bytes: u64,
}

impl DiskShare {
    /// Max size of the stored files: what the logs leave, and half of the share at least.
    fn max_files_bytes(self) -> u64 {
        self.max_bytes - self.logs_bytes.min(self.max_bytes / 2)
    }

    /// Warns of logs that take the half that is for the stored files: with these, they may exceed the share.
    fn warn_of_logs(self) {
        let Self { max_bytes, logs_bytes } = self;
        if logs_bytes > max_bytes / 2 {
            tracing::warn!(
                logs_bytes,
                max_bytes,
                "the audit logs take more than half of the max_bytes that retention.max_disk_share allows; none is deleted for it, and no \
                 job is for what they take beyond half, so that logs and files together may exceed the share: set retention.run_days, \
                 delete runs, or have the logs on another disk (execution.audit_dir)"
            );
        }
    }
}

/// Maintains the store until the service stops.
pub(super) async fn maintain(app: App) {
    let stopping = app.stopping();
    tokio::select! {
        () = stopping.cancelled() => {}
        _ = async { tokio::join!(rounds(&app), scrub(&app)) } => {}
    }
}

/// Runs the short tasks at every interval. The first round deletes nothing by the retention policy: whoever has just set it can look
/// for an hour at what it would delete.
async fn rounds(app: &App) {
    let mut rounds = tokio::time::interval(ROUND_INTERVAL);
    rounds.tick().await;
    loop {
        app.round().await;
        rounds.tick().await;
        log("applying the retention policy", app.apply_retention().await.map(drop));
    }
}

/// Verifies every stored file, which may take hours, and repeats after the configured interval.
async fn scrub(app: &App) {
    let hours = app.0.options.scrub_hours;
    if hours == 0 {
        return std::future::pending().await;
    }
    let mut rounds = tokio::time::interval(Duration::from_secs(u64::from(hours) * HOUR_SECS));
    rounds.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
    loop {
        rounds.tick().await;
        log("scrubbing the files", app.0.store.scrub_files().await);
    }
}

fn log(what: &str, result: Result<(), Error>) {
    if let Err(error) = result {
        tracing::warn!(error = &error as &dyn std::error::Error, "{what} failed; it is retried in the next round");
    }
}

impl App {
    /// One round of the short tasks.
    async fn round(&self) {
        let (store, options) = (&self.0.store, &self.0.options);
        let hours = |hours: u32| Duration::from_secs(u64::from(hours) * HOUR_SECS);
        log("keeping room for deletions", self.keep_reserve().await);
        log("removing the audit logs of deleted runs", self.finish_deletions().await);
        log("scrubbing the rows", store.scrub_rows().await);
        log("recording damage that was found", store.scrub_suspects().await);
        log("pruning old events", store.prune_events(options.event_retention_hours).await);
        log("pruning old events of runs", store.prune_run_events(options.event_retention_hours).await);
        let swept = store.sweep(hours(options.orphan_hours), hours(options.swept_hours)).await;
        log("sweeping orphaned files", swept.map(drop));
    }

    /// Sizes of all audit logs that can be read; the server's log tells of the others.
    async fn log_sizes(&self) -> Result<LogSizes, Error> {
        let folder = self.0.options.execution.audit_dir.clone();
        let found = blocking(move || Ok(log_sizes(&folder))).await?;
        if let Some(error) = &found.fault {
            let error = error as &dyn std::error::Error;
            tracing::warn!(
                error,
                "audit logs cannot be read, and are not counted; let the server's user read execution.audit_dir"
            );
        }
        Ok(found)
    }

    /// The policy, and the runs that it would delete now for their age. The logs of the others count towards the share of the disk.
    async fn policy(&self) -> Result<PolicyNow, Error> {
        let retention = &self.0.options.retention;
        let mut policy = Policy {
            job_days: retention.job_days,
            jobs_per_part: retention.jobs_per_part,
            unused_mesh_days: retention.unused_mesh_days,
            run_days: retention.run_days,
            max_bytes: 0,
            hold_label: retention.hold_label.clone(),
        };
        if policy.run_days == 0 && retention.max_disk_share <= 0.0 {
            return Ok(PolicyNow { policy, runs: Vec::new(), share: None });
        }
        let mut logs = self.log_sizes().await?.bytes;
        let (due, leased) = (self.0.store.due_runs(&policy).await?, self.0.runs.leased_cells());
        // Whoever holds the cell may be about to go on from where a run stopped.
        let due = due.into_iter().filter(|run| !leased.contains(&run.cell));
        let runs = due.map(|run| (run.id, logs.remove(&run.id).unwrap_or_default())).collect();
        let share = if retention.max_disk_share > 0.0 { Some(self.disk_share(logs.values().sum())?) } else { None };
        policy.max_bytes = share.map_or(0, DiskShare::max_files_bytes);
        Ok(PolicyNow { policy, runs, share })
    }

    /// The share of the disk that is allowed, with logs of so many bytes where they lie on it.
    fn disk_share(&self, logs_bytes: u64) -> Result<DiskShare, Error> {
        let options = &self.0.options;
        let max_bytes = (self.space()?.0.total_bytes as f64 * options.retention.max_disk_share) as u64;
        let is_beside = share_a_disk(&options.data_dir, &options.execution.audit_dir);
        Ok(DiskShare { max_bytes, logs_bytes: if is_beside { logs_bytes } else { 0 } })
    }

    /// Preview of what the retention policy would delete now.
    ///
    /// # Errors
    /// [`Error::Internal`], [`Error::StorageBusy`].
    pub async fn retention(&self) -> Result<Retention, Error> {
        let PolicyNow { policy, runs, .. } = self.policy().await?;
        let due = self.0.store.due(&policy).await?;
        Ok(self.retention_response(&due, &runs))
    }

    /// Applies the retention policy. Skips jobs that are put on hold or deleted meanwhile, and their runs.
    ///
    /// # Errors
    /// [`Error::Internal`], [`Error::StorageBusy`].
    pub async fn apply_retention(&self) -> Result<Retention, Error> {
        let app = self.clone();
        self.run_to_completion(async move {
            let PolicyNow { policy, runs, share } = app.policy().await?;
            if let Some(share) = share {
                share.warn_of_logs();
            }
            let runs = app.retire_runs(runs).await?;
            let store = &app.0.store;
            let due = store.due(&policy).await?;
            // What goes is counted from before the sum on, so that too little is deleted rather than too much.
            let removed = store.removed_bytes();
            let stored = if policy.max_bytes > 0 { store.stored_bytes().await? } else { 0 };
            let mut deleted = Due::default();
            for (id, reason, size_bytes) in due.jobs {
                // What jobs share goes with the last of them: how much room there is shows only then.
                let left = stored.saturating_sub(store.removed_bytes().saturating_sub(removed));
                if reason == RetentionReason::Disk && left <= policy.max_bytes {
                    continue;
                }
                let hold = &app.0.options.retention.hold_label;
                match app.freeing(|| store.delete_job(id, hold, Some(reason.code()))).await {
                    Ok(()) => {
                        tracing::info!(job = %id, reason = reason.code(), size_bytes, "job deleted by the retention policy");
                        deleted.jobs.push((id, reason, size_bytes));
                    }
                    Err(Error::JobHeld { .. } | Error::JobInUse(_) | Error::JobNotFound(_) | Error::JobNotEnded { .. }) => {}
                    Err(error) => return Err(error),
                }
            }
            for (id, size_bytes) in due.meshes {
                // One that was uploaded again meanwhile is as new.
                match app.freeing(|| store.delete_mesh(id, policy.unused_mesh_days)).await {
                    Ok(()) => {
                        tracing::info!(mesh = %id, size_bytes, "unused mesh deleted by the retention policy");
                        deleted.meshes.push((id, size_bytes));
                    }
                    Err(Error::MeshNotFound(_) | Error::MeshInUse(_) | Error::MeshInSpec { .. }) => {}
                    Err(error) => return Err(error),
                }
            }
            app.warn_of_rest(&policy).await?;
            if deleted != Due::default() || !runs.is_empty() {
                let (jobs, meshes) = (deleted.jobs.len(), deleted.meshes.len());
                tracing::info!(jobs, meshes, runs = runs.len(), "deleted by the retention policy");
            }
            Ok(app.retention_response(&deleted, &runs))
        })
        .await
    }

    /// Warns of stored files beyond their max size, which no deletion of a job frees.
    async fn warn_of_rest(&self, policy: &Policy) -> Result<(), Error> {
        let (store, max_bytes) = (&self.0.store, policy.max_bytes);
        let files_bytes = if max_bytes > 0 { store.stored_bytes().await? } else { 0 };
        // Files that jobs share go with the last of them: what is left may be due in the next round.
        if files_bytes > max_bytes && store.due(policy).await?.jobs.is_empty() {
            tracing::warn!(
                files_bytes,
                max_bytes,
                "the stored files take more than retention.max_disk_share leaves them, and no ended job that may be deleted has \
                 any: delete meshes, set retention.unused_mesh_days, or raise the share"
            );
        }
        Ok(())
    }

    /// Deletes runs that are due, with their audit logs; returns those that it deleted. A log that cannot be removed keeps nothing else
    /// from being deleted: the next round tries again.
    async fn retire_runs(&self, due: SizedRuns) -> Result<SizedRuns, Error> {
        let mut deleted = Vec::new();
        for (run, size_bytes) in due {
            match self.delete_run_row(run, true).await {
                Ok(()) => {
                    // Once its events are pruned, the server's log alone tells that this record is gone.
                    tracing::info!(%run, size_bytes, "run deleted by the retention policy, for its age");
                    let removed = self.remove_log(run).await;
                    // A log that is left has freed nothing.
                    deleted.push((run, if removed.is_ok() { size_bytes } else { 0 }));
                    log(&format!("removing the audit log of the deleted run {run}"), removed);
                }
                Err(Error::RunNotFound(_) | Error::JobHeld { .. } | Error::JobInUse(_)) => {}
                Err(error) => return Err(error),
            }
        }
        Ok(deleted)
    }

    fn retention_response(&self, due: &Due, runs: &[(RunId, u64)]) -> Retention {
        let retention = &self.0.options.retention;
        let jobs = due.jobs.iter().take(MAX_LISTED).map(|&(id, reason, size_bytes)| RetiredJob { id, reason, size_bytes });
        let meshes = due.meshes.iter().take(MAX_LISTED).map(|&(id, size_bytes)| RetiredMesh { id, size_bytes });
        let jobs_bytes: u64 = due.jobs.iter().map(|job| job.2).sum();
        let meshes_bytes: u64 = due.meshes.iter().map(|mesh| mesh.1).sum();
        Retention {
            policy: RetentionPolicy {
                job_days: retention.job_days,
                jobs_per_part: retention.jobs_per_part,
                unused_mesh_days: retention.unused_mesh_days,
                run_days: retention.run_days,
                max_disk_share: retention.max_disk_share,
                hold_label: retention.hold_label.clone(),
            },
            job_count: due.jobs.len() as u64,
            mesh_count: due.meshes.len() as u64,
            run_count: runs.len() as u64,
            size_bytes: jobs_bytes + meshes_bytes + runs.iter().map(|run| run.1).sum::<u64>(),
            jobs: jobs.collect(),
            meshes: meshes.collect(),
            runs: runs.iter().take(MAX_LISTED).map(|&(id, size_bytes)| RetiredRun { id, size_bytes }).collect(),
        }
    }

    /// Disk space, sizes and known damage.
    ///
    /// # Errors
    /// [`Error::Internal`], [`Error::StorageBusy`].
    pub async fn storage(&self) -> Result<Storage, Error> {
        let (space, floor_bytes) = self.space()?;
        log("recording damage that was found", self.0.store.scrub_suspects().await);
        let files = self.0.store.files().clone();
        let damaged = self.0.store.damage().into_iter().map(|damage| DamagedItem { name: damage.name, reason: damage.reason });
        let mut damaged: Vec<DamagedItem> = damaged.collect();
        let logs = self.log_sizes().await?;
        if let Some(error) = &logs.fault {
            let reason = format!(
                "some cannot be read, and audit_bytes is without them ({error}); let the server's user read execution.audit_dir"
            );
            damaged.push(DamagedItem { name: "audit logs".to_owned(), reason });
        }
        Ok(Storage {
            free_bytes: space.free_bytes,
            total_bytes: space.total_bytes,
            floor_bytes,
            database_bytes: self.0.store.database_bytes(),
            files_bytes: self.0.store.stored_bytes().await?,
            swept_bytes: blocking(move || Ok(files.swept_bytes()?)).await?,
            audit_bytes: logs.bytes.values().sum(),
            damaged,
        })
    }
}

#[cfg(test)]
mod tests;
