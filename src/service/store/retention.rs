//! Retention: the policy deletes ended jobs that are too old or too many for their part, meshes that nothing uses any more, runs that
//! ended long ago, and the oldest jobs while the store exceeds its share of the disk. A job with the hold label is never deleted, nor
//! are its runs, and nothing is deleted for its age while the clock is not steady.
//!
//! Runs do not go with their job: they are records of what was moved, and have an age of their own.

use std::collections::{BTreeMap, BTreeSet};

use sqlx::Row;

use super::Store;
use super::jobs::is_used;
use super::runs::not_ended;
use crate::service::error::Error;
use crate::wire::{JobId, MeshId, RetentionReason, RunId};

/// Retention policy.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Policy {
    /// Age at which ended jobs are deleted, days; 0 keeps them.
    pub job_days: u32,
    /// Ended jobs kept for each part (its part number, without one or with a blank one its mesh); 0 keeps all.
    pub jobs_per_part: u32,
    /// Age at which meshes that no job refers to are deleted, days since their upload; 0 keeps them.
    pub unused_mesh_days: u32,
    /// Time after its end at which a run is deleted with its record and its audit log, days; 0 keeps them.
    pub run_days: u32,
    /// Max total size of the stored files; the oldest ended jobs are deleted first. 0 for no limit.
    pub max_bytes: u64,
    /// Key of the label that protects a job from deletion.
    pub hold_label: String,
}

impl Policy {
    fn keeps_everything(&self) -> bool {
        self.job_days == 0 && self.jobs_per_part == 0 && self.unused_mesh_days == 0 && self.max_bytes == 0
    }
}

/// Jobs and meshes that the policy deletes.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Due {
    /// Jobs, oldest first, with the reason and the bytes of their files.
    pub jobs: Vec<(JobId, RetentionReason, u64)>,
    /// Meshes with the bytes of their files.
    pub meshes: Vec<(MeshId, u64)>,
}

/// A run that the policy deletes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct DueRun {
    pub id: RunId,
    /// Name of its cell.
    pub cell: String,
}

/// SQL of the runs that ended `?1` days ago, oldest first, without those of a job that has the label `?2` or is in use. As of jobs, one
/// that ended while the clock was behind is no older than the newest one before it.
const OLD_RUNS: &str = concat!(
    "SELECT id, cell FROM (SELECT rowid AS number, id, job_id, cell, state, ended_at, max(created_at) OVER (ORDER BY rowid) AS newest
        FROM run) AS run
     WHERE max(ended_at, newest) < strftime('%Y-%m-%dT%H:%M:%fZ', 'now', '-' || ?1 || ' days') AND NOT (",
    not_ended!(),
    ") AND NOT EXISTS (SELECT 1 FROM job_label WHERE job_id = run.job_id AND key = ?2)
        AND NOT EXISTS (SELECT 1 FROM job WHERE job.id = run.job_id AND ",
    is_used!(),
    ") ORDER BY number"
);

/// An ended job without the hold label.
struct EndedJob {
    id: JobId,
    part: String,
    is_old: bool,
    size_bytes: u64,
    /// True if files go with the job, or with the last of those that share them.
    has_files: bool,
}

impl Store {
    /// Jobs and meshes that the policy would delete now.
    pub(crate) async fn due(&self, policy: &Policy) -> Result<Due, Error> {
        if policy.keeps_everything() {
            return Ok(Due::default());
        }
        let ended = self.ended_jobs(policy).await?;
        let mut reasons = BTreeMap::new();
        for job in ended.iter().filter(|job| job.is_old) {
            reasons.insert(job.id, RetentionReason::Age);
        }
        if policy.jobs_per_part > 0 {
            let mut kept: BTreeMap<&str, u32> = BTreeMap::new();
            for job in ended.iter().rev() {
                let count = kept.entry(&job.part).or_default();
                *count += 1;
                if *count > policy.jobs_per_part {
                    reasons.entry(job.id).or_insert(RetentionReason::Count);
                }
            }
        }
        if policy.max_bytes > 0 {
            let freed: u64 = ended.iter().filter(|job| reasons.contains_key(&job.id)).map(|job| job.size_bytes).sum();
            let mut taken = self.stored_bytes().await?.saturating_sub(freed);
            // One without files would leave as little room as before.
            for job in ended.iter().filter(|job| job.has_files) {
                if taken <= policy.max_bytes {
                    break;
                }
                if let std::collections::btree_map::Entry::Vacant(place) = reasons.entry(job.id) {
                    place.insert(RetentionReason::Disk);
                    taken = taken.saturating_sub(job.size_bytes);
                }
            }
        }
        let jobs = ended.iter().filter_map(|job| reasons.get(&job.id).map(|reason| (job.id, *reason, job.size_bytes))).collect();
        let meshes = if policy.unused_mesh_days > 0 { self.unused_meshes(policy.unused_mesh_days).await? } else { Vec::new() };
        Ok(Due { jobs, meshes })
    }

    /// Runs that the policy would delete now for their age, oldest first.
    pub(crate) async fn due_runs(&self, policy: &Policy) -> Result<Vec<DueRun>, Error> {
        if policy.run_days == 0 || !self.clock.is_steady() {
            return Ok(Vec::new());
        }
        let rows = sqlx::query(OLD_RUNS).bind(policy.run_days).bind(&policy.hold_label).fetch_all(&self.reader).await?;
        let read = |row: &sqlx::sqlite::SqliteRow| -> Result<Option<DueRun>, Error> {
            // A run whose id cannot be read cannot be deleted by it.
            let Ok(id) = row.try_get::<String, _>("id")?.parse() else { return Ok(None) };
            Ok(Some(DueRun { id, cell: row.try_get("cell")? }))
        };
        rows.iter().filter_map(|row| read(row).transpose()).collect()
    }

    /// Ended jobs without the hold label of which no inspection and no run is open, oldest first.
    async fn ended_jobs(&self, policy: &Policy) -> Result<Vec<EndedJob>, Error> {
        let job_days = if self.clock.is_steady() { policy.job_days } else { 0 };
        // Jobs are in the order in which they were inserted, whatever the clock said: their ids and times follow it. A job that ended
        // while the clock was behind is no older than the newest one before it.
        let rows = sqlx::query(concat!(
            "SELECT id, CASE WHEN trim(part_number) <> '' THEN 'n' || part_number ELSE 'm' || mesh_id END AS part,
                ?1 > 0 AND max(ended_at, newest) < strftime('%Y-%m-%dT%H:%M:%fZ', 'now', '-' || ?1 || ' days') AS is_old,
                (SELECT coalesce(sum(file_bytes), 0) FROM artifact WHERE job_id = job.id)
                    + (SELECT coalesce(sum(size_bytes), 0) FROM
                        (SELECT DISTINCT sha256, size_bytes FROM scan WHERE job_id = job.id))
                    + (SELECT coalesce(sum(file_bytes), 0) FROM inspection_file JOIN inspection
                        ON inspection.id = inspection_file.inspection_id WHERE inspection.job_id = job.id)
                    + (SELECT coalesce(sum(size_bytes), 0) FROM job_mesh AS own WHERE job_id = job.id
                        AND NOT EXISTS (SELECT 1 FROM mesh WHERE mesh.sha256 = own.sha256) AND NOT EXISTS
                            (SELECT 1 FROM job_mesh AS other WHERE other.sha256 = own.sha256 AND other.job_id <> own.job_id))
                    AS size_bytes,
                EXISTS (SELECT 1 FROM job_mesh AS own WHERE job_id = job.id AND sha256 <> ''
                    AND NOT EXISTS (SELECT 1 FROM mesh WHERE mesh.sha256 = own.sha256)) AS has_deleted_mesh
             FROM (SELECT rowid AS number, id, part_number, mesh_id, ended_at, max(created_at) OVER (ORDER BY rowid) AS newest
                FROM job) AS job
             WHERE ended_at IS NOT NULL
                AND NOT EXISTS (SELECT 1 FROM job_label WHERE job_id = job.id AND key = ?2) AND NOT ",
            is_used!(),
            " ORDER BY number"
        ))
        .bind(job_days)
        .bind(&policy.hold_label)
        .fetch_all(&self.reader)
        .await?;
        let read = |row: &sqlx::sqlite::SqliteRow| -> Result<Option<EndedJob>, Error> {
            // A job whose id cannot be read cannot be deleted by it.
            let Ok(id) = row.try_get::<String, _>("id")?.parse() else { return Ok(None) };
            let size_bytes = row.try_get::<i64, _>("size_bytes")?.unsigned_abs();
            let has_files = size_bytes > 0 || row.try_get("has_deleted_mesh")?;
            Ok(Some(EndedJob { id, part: row.try_get("part")?, is_old: row.try_get("is_old")?, size_bytes, has_files }))
        };
        rows.iter().filter_map(|row| read(row).transpose()).collect()
    }

    async fn unused_meshes(&self, days: u32) -> Result<Vec<(MeshId, u64)>, Error> {
        if !self.clock.is_steady() {
            return Ok(Vec::new());
        }
        let rows = sqlx::query(
            "SELECT id, size_bytes + preview_bytes AS size_bytes FROM mesh
             WHERE created_at < strftime('%Y-%m-%dT%H:%M:%fZ', 'now', '-' || ?1 || ' days')
                AND NOT EXISTS (SELECT 1 FROM job_mesh WHERE mesh_id = mesh.id) ORDER BY id",
        )
        .bind(days)
        .fetch_all(&self.reader)
        .await?;
        let read = |row: &sqlx::sqlite::SqliteRow| -> Result<Option<(MeshId, u64)>, Error> {
            let Ok(id) = row.try_get::<String, _>("id")?.parse() else { return Ok(None) };
            Ok(Some((id, row.try_get::<i64, _>("size_bytes")?.unsigned_abs())))
        };
        let unused: Vec<(MeshId, u64)> = rows.iter().filter_map(|row| read(row).transpose()).collect::<Result<_, _>>()?;
        let referenced = self.meshes_of_specs().await?;
        Ok(unused.into_iter().filter(|(id, _)| !referenced.contains(&id.to_string())).collect())
    }

    /// Ids of meshes that stored specifications refer to.
    async fn meshes_of_specs(&self) -> Result<BTreeSet<String>, Error> {
        let ids: Vec<String> = sqlx::query_scalar(
            "SELECT node.value FROM spec, json_tree(CASE WHEN json_valid(spec.body) THEN spec.body ELSE '{}' END) AS node
             WHERE node.key = 'mesh' AND node.type = 'text'",
        )
        .fetch_all(&self.reader)
        .await?;
        Ok(ids.into_iter().map(|id| id.to_lowercase()).collect())
    }

    /// Total size of all files that rows refer to; a file with several references counts once.
    pub(crate) async fn stored_bytes(&self) -> Result<u64, Error> {
        let bytes: i64 = sqlx::query_scalar(
            "SELECT coalesce(sum(bytes), 0) FROM (SELECT max(bytes) AS bytes FROM file_reference GROUP BY sha256)",
        )
        .fetch_one(&self.reader)
        .await?;
        Ok(bytes.unsigned_abs())
    }
}
