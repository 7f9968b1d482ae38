//! Background maintenance of the store: pruning of events, sweep of orphans, retention, scrubbing. None of it delays the start.

use std::collections::BTreeMap;
use std::time::Duration;

use super::app::App;
use super::error::Error;
use super::runs::log_sizes;
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
        let app = self.clone();
        let keep = move || {
            app.keep_reserve();
            Ok(())
        };
        log("keeping room for deletions", blocking(keep).await);
        log("scrubbing the rows", store.scrub_rows().await);
        log("recording damage that was found", store.scrub_suspects().await);
        log("pruning old events", store.prune_events(options.event_retention_hours).await);
        log("pruning old events of runs", store.prune_run_events(options.event_retention_hours).await);
        let swept = store.sweep(hours(options.orphan_hours), hours(options.swept_hours)).await;
        log("sweeping orphaned files", swept.map(drop));
        metrics::gauge!("vantage_store_damaged").set(store.damage().len() as f64);
    }

    /// Sizes of all audit logs.
    async fn log_sizes(&self) -> Result<BTreeMap<RunId, u64>, Error> {
        let folder = self.0.options.execution.audit_dir.clone();
        blocking(move || Ok(log_sizes(&folder)?)).await
    }

    /// The policy, and the runs that it would delete now for their age. What the logs of the others leave of the share of the disk is
    /// for the stored files.
    async fn policy(&self) -> Result<(Policy, SizedRuns), Error> {
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
            return Ok((policy, Vec::new()));
        }
        let mut logs = self.log_sizes().await?;
        let (due, leased) = (self.0.store.due_runs(&policy).await?, self.0.runs.leased_cells());
        // Whoever holds the cell may be about to go on from where a run stopped.
        let due = due.into_iter().filter(|run| !leased.contains(&run.cell));
        let due = due.map(|run| (run.id, logs.remove(&run.id).unwrap_or_default())).collect();
        if retention.max_disk_share > 0.0 {
            policy.max_bytes = self.max_files_bytes(logs.values().sum())?;
        }
        Ok((policy, due))
    }

    /// Max size of the stored files by the share of the disk, of which the audit logs on that disk take their part. Where they take
    /// all of it, there is no limit, which is 0: what deleted jobs leave would not make up for it.
    fn max_files_bytes(&self, logs_bytes: u64) -> Result<u64, Error> {
        let options = &self.0.options;
        let max_bytes = (self.space()?.0.total_bytes as f64 * options.retention.max_disk_share) as u64;
        let is_beside = share_a_disk(&options.data_dir, &options.execution.audit_dir);
        Ok(if is_beside { max_bytes.saturating_sub(logs_bytes) } else { max_bytes })
    }

    /// Preview of what the retention policy would delete now.
    ///
    /// # Errors
    /// [`Error::Internal`], [`Error::StorageBusy`].
    pub async fn retention(&self) -> Result<Retention, Error> {
        let (policy, runs) = self.policy().await?;
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
            let (policy, due_runs) = app.policy().await?;
            if app.0.options.retention.max_disk_share > 0.0 && policy.max_bytes == 0 {
                tracing::warn!(
                    "the audit logs alone take more of the disk than retention.max_disk_share allows, and no job is deleted for it; \
                     set retention.run_days, or have the logs on another disk (execution.audit_dir)"
                );
            }
            let runs = app.retire_runs(due_runs).await?;
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
                    Ok(()) => deleted.jobs.push((id, reason, size_bytes)),
                    Err(Error::JobHeld { .. } | Error::JobInUse(_) | Error::JobNotFound(_) | Error::JobNotEnded { .. }) => {}
                    Err(error) => return Err(error),
                }
            }
            for (id, size_bytes) in due.meshes {
                // One that was uploaded again meanwhile is as new.
                match app.freeing(|| store.delete_mesh(id, policy.unused_mesh_days)).await {
                    Ok(()) => deleted.meshes.push((id, size_bytes)),
                    Err(Error::MeshNotFound(_) | Error::MeshInUse(_) | Error::MeshInSpec { .. }) => {}
                    Err(error) => return Err(error),
                }
            }
            // Runs have no events: the log alone tells which records are gone.
            runs.iter().for_each(|(run, _)| tracing::info!(%run, "run and audit log deleted by the retention policy"));
            if deleted != Due::default() || !runs.is_empty() {
                let (jobs, meshes) = (deleted.jobs.len(), deleted.meshes.len());
                tracing::info!(jobs, meshes, runs = runs.len(), "deleted by the retention policy");
            }
            Ok(app.retention_response(&deleted, &runs))
        })
        .await
    }

    /// Deletes runs that are due, with their audit logs; returns those that it deleted.
    async fn retire_runs(&self, due: SizedRuns) -> Result<SizedRuns, Error> {
        let hold = &self.0.options.retention.hold_label;
        let mut deleted = Vec::new();
        for (id, size_bytes) in due {
            match self.delete_run_and_log(id, Some(hold.as_str())).await {
                Ok(()) => deleted.push((id, size_bytes)),
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
        Ok(Storage {
            free_bytes: space.free_bytes,
            total_bytes: space.total_bytes,
            floor_bytes,
            database_bytes: self.0.store.database_bytes(),
            files_bytes: self.0.store.stored_bytes().await?,
            swept_bytes: blocking(move || Ok(files.swept_bytes()?)).await?,
            audit_bytes: self.log_sizes().await?.values().sum(),
            damaged: damaged.collect(),
        })
    }
}

#[cfg(test)]
mod tests;
