//! Background maintenance of the store: pruning of events, sweep of orphans, retention, scrubbing. None of it delays the start.

use std::time::Duration;

use super::app::App;
use super::error::Error;
use super::store::{Due, Policy, blocking};
use crate::wire::{DamagedItem, Retention, RetentionPolicy, RetentionReason, RetiredJob, RetiredMesh, Storage};

/// Interval of the maintenance rounds.
const ROUND_INTERVAL: Duration = Duration::from_secs(3600);
/// Max jobs, and max meshes, that a response lists.
const MAX_LISTED: usize = 1000;

const HOUR_SECS: u64 = 3600;

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

    fn policy(&self) -> Result<Policy, Error> {
        let retention = &self.0.options.retention;
        let max_bytes = if retention.max_disk_share > 0.0 {
            (self.space()?.0.total_bytes as f64 * retention.max_disk_share) as u64
        } else {
            0
        };
        Ok(Policy {
            job_days: retention.job_days,
            jobs_per_part: retention.jobs_per_part,
            unused_mesh_days: retention.unused_mesh_days,
            max_bytes,
            hold_label: retention.hold_label.clone(),
        })
    }

    /// Preview of what the retention policy would delete now.
    ///
    /// # Errors
    /// [`Error::Internal`], [`Error::StorageBusy`].
    pub async fn retention(&self) -> Result<Retention, Error> {
        let due = self.0.store.due(&self.policy()?).await?;
        Ok(self.retention_response(&due))
    }

    /// Applies the retention policy. Skips jobs that are put on hold or deleted meanwhile.
    ///
    /// # Errors
    /// [`Error::Internal`], [`Error::StorageBusy`].
    pub async fn apply_retention(&self) -> Result<Retention, Error> {
        let app = self.clone();
        self.run_to_completion(async move {
            let policy = app.policy()?;
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
            if deleted != Due::default() {
                tracing::info!(jobs = deleted.jobs.len(), meshes = deleted.meshes.len(), "deleted by the retention policy");
            }
            Ok(app.retention_response(&deleted))
        })
        .await
    }

    fn retention_response(&self, due: &Due) -> Retention {
        let retention = &self.0.options.retention;
        let jobs = due.jobs.iter().take(MAX_LISTED).map(|&(id, reason, size_bytes)| RetiredJob { id, reason, size_bytes });
        let meshes = due.meshes.iter().take(MAX_LISTED).map(|&(id, size_bytes)| RetiredMesh { id, size_bytes });
        Retention {
            policy: RetentionPolicy {
                job_days: retention.job_days,
                jobs_per_part: retention.jobs_per_part,
                unused_mesh_days: retention.unused_mesh_days,
                max_disk_share: retention.max_disk_share,
                hold_label: retention.hold_label.clone(),
            },
            job_count: due.jobs.len() as u64,
            mesh_count: due.meshes.len() as u64,
            size_bytes: due.jobs.iter().map(|job| job.2).chain(due.meshes.iter().map(|mesh| mesh.1)).sum(),
            jobs: jobs.collect(),
            meshes: meshes.collect(),
        }
    }

    /// Disk space, sizes and known damage.
    ///
    /// # Errors
    /// [`Error::Internal`], [`Error::StorageBusy`].
    pub async fn storage(&self) -> Result<Storage, Error> {
        let (space, floor_bytes) = self.space()?;
        log("recording damage that was found", self.0.store.scrub_suspects().await);
        let damaged = self.0.store.damage().into_iter().map(|damage| DamagedItem { name: damage.name, reason: damage.reason });
        Ok(Storage {
            free_bytes: space.free_bytes,
            total_bytes: space.total_bytes,
            floor_bytes,
            database_bytes: self.0.store.database_bytes(),
            files_bytes: self.0.store.stored_bytes().await?,
            damaged: damaged.collect(),
        })
    }
}
