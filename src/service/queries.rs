//! Queries on jobs and their results, and what clients change on an accepted job: cancellation, labels, deletion.

use std::io::{Cursor, Read};
use std::sync::Arc;
use std::time::Duration;

use serde::Deserialize;
use tokio::sync::broadcast::error::RecvError;
use tokio::time::{Instant, timeout_at};

use super::app::App;
use super::error::Error;
use super::jobs::results_wait;
use super::plan_job::{Artifact, dialect_of};
use super::presets::PRESETS;
use super::store::{FileEncoding, JobQuery, PartNames, ResultFile};
use crate::cell::{Dialect, SpecLibrary};
use crate::program::dialects::DialectError;
use crate::wire::plan::RegionCoverageDocument;
use crate::wire::warnings::WarningCode;
use crate::wire::{DeletedJobs, Job, JobId, JobSelection, JobSort, JobState, JobUpdate, LabelsRequest, parse, warnings};

impl App {
    /// One job.
    ///
    /// # Errors
    /// [`Error::JobNotFound`], [`Error::Internal`].
    pub async fn job(&self, id: JobId) -> Result<Job, Error> {
        let mut job = self.with_regions(self.0.store.job(id).await?).await;
        if !job.state.is_ended() && self.0.runner.is_waiting(id) {
            job.warnings.push(results_wait());
        }
        Ok(job)
    }

    /// State of a job.
    ///
    /// # Errors
    /// [`Error::JobNotFound`], [`Error::Internal`].
    pub async fn job_state(&self, id: JobId) -> Result<JobState, Error> {
        self.0.store.job_state(id).await
    }

    /// Waits until a job has ended, at most for `wait`; returns it as it is then.
    ///
    /// # Errors
    /// [`Error::JobNotFound`], [`Error::Internal`].
    pub async fn job_when_ended(&self, id: JobId, wait: Duration) -> Result<Job, Error> {
        let until = Instant::now() + wait;
        // Subscribed before the state is read, so that no end is missed in between.
        let mut events = self.0.store.subscribe();
        loop {
            if self.0.store.job_state(id).await?.is_ended() {
                return self.job(id).await;
            }
            let next = async {
                loop {
                    match events.recv().await {
                        Ok(event) if event.job_id != id || !event.state.is_ended() => {}
                        Ok(_) | Err(RecvError::Lagged(_)) => return true,
                        Err(RecvError::Closed) => return false,
                    }
                }
            };
            tokio::select! {
                () = self.0.stopping.cancelled() => return self.job(id).await,
                changed = timeout_at(until, next) => if !matches!(changed, Ok(true)) {
                    return self.job(id).await;
                },
            }
        }
    }

    /// Requests a job's cancellation.
    ///
    /// # Errors
    /// [`Error::JobNotFound`], [`Error::JobEnded`], [`Error::Internal`].
    pub async fn cancel(&self, id: JobId) -> Result<Job, Error> {
        let app = self.clone();
        self.run_to_completion(async move {
            let job = app.freeing(|| app.0.store.cancel(id)).await?;
            app.0.runner.cancel(id);
            // It may be the one that others waited behind.
            app.0.runner.wake();
            Ok(job)
        })
        .await
    }

    /// Deletes an ended job with its results, scans and inspections.
    ///
    /// # Errors
    /// [`Error::JobNotFound`], [`Error::JobNotEnded`], [`Error::JobInUse`], [`Error::JobHeld`], [`Error::Internal`].
    pub async fn delete_job(&self, id: JobId) -> Result<(), Error> {
        let app = self.clone();
        self.run_to_completion(async move {
            let hold = &app.0.options.retention.hold_label;
            app.freeing(|| app.0.store.delete_job(id, hold, None)).await
        })
        .await
    }

    /// Deletes the selected jobs that have ended and are not held; with `dry_run` only counts them.
    ///
    /// # Errors
    /// [`Error::Invalid`], [`Error::StorageFull`], [`Error::StorageBusy`], [`Error::PartlyDeleted`], [`Error::Internal`].
    pub async fn delete_jobs(&self, selection: JobSelection, dry_run: bool) -> Result<DeletedJobs, Error> {
        selection.check().map_err(Error::Invalid)?;
        let query = JobQuery { selection, sort: JobSort::default() };
        let app = self.clone();
        self.run_to_completion(async move {
            let hold = &app.0.options.retention.hold_label;
            let mut counts = DeletedJobs { dry_run, ..DeletedJobs::default() };
            for job in app.0.store.matching(&query, hold).await? {
                let deleted = match (job.has_ended, job.is_held) {
                    (false, _) => Err(Error::JobNotEnded { job: job.id, state: JobState::Queued }),
                    (true, true) => Err(Error::JobHeld { job: job.id, label: hold.clone() }),
                    (true, false) if dry_run => Ok(()),
                    (true, false) => app.freeing(|| app.0.store.delete_job(job.id, hold, None)).await,
                };
                match deleted {
                    Ok(()) => counts.deleted += 1,
                    Err(Error::JobHeld { .. }) => counts.held += 1,
                    Err(Error::JobNotEnded { .. } | Error::JobInUse(_)) => counts.not_ended += 1,
                    // Somebody else deleted it meanwhile.
                    Err(Error::JobNotFound(_)) => {}
                    Err(error) if counts.deleted == 0 => return Err(error),
                    Err(error) => return Err(Error::PartlyDeleted { deleted: counts.deleted, cause: Box::new(error) }),
                }
            }
            Ok(counts)
        })
        .await
    }

    /// Changes a job that waits in the queue.
    ///
    /// # Errors
    /// [`Error::JobNotFound`], [`Error::JobNotQueued`], [`Error::Invalid`], [`Error::StorageBusy`], [`Error::Internal`].
    pub async fn update_job(&self, id: JobId, update: JobUpdate) -> Result<Job, Error> {
        update.check().map_err(Error::Invalid)?;
        let app = self.clone();
        self.run_to_completion(async move {
            let job = app.0.store.put_priority(id, update.priority).await?;
            app.0.runner.wake();
            Ok(job)
        })
        .await
    }

    /// Names by which people know a job's part.
    ///
    /// # Errors
    /// [`Error::JobNotFound`], [`Error::Internal`].
    pub async fn part_names(&self, id: JobId) -> Result<PartNames, Error> {
        self.0.store.part_names(id).await
    }

    /// Replaces a job's labels. Its files keep the labels that it was submitted with.
    ///
    /// # Errors
    /// [`Error::JobNotFound`], [`Error::Invalid`], [`Error::StorageBusy`], [`Error::Internal`].
    pub async fn put_labels(&self, id: JobId, labels: LabelsRequest) -> Result<Job, Error> {
        labels.check().map_err(Error::Invalid)?;
        let app = self.clone();
        self.run_to_completion(async move { Ok(app.with_regions(app.0.store.put_labels(id, &labels.labels).await?).await) }).await
    }

    /// Adds to a job that has succeeded how well its regions are covered. Its state is told even where that cannot be read.
    async fn with_regions(&self, mut job: Job) -> Job {
        let asked = &job.params.regions;
        if job.state != JobState::Succeeded || (asked.interest.is_empty() && asked.features.is_empty()) {
            return job;
        }
        match self.regions(job.id).await {
            Ok(regions) => {
                // Jobs of earlier releases were stored without the warnings of their plan.
                if job.warnings.iter().all(|warning| warning.code != WarningCode::RegionUnmet) {
                    job.warnings.extend(warnings::of_regions(&job.params, &regions, "/params"));
                }
                job.warnings = warnings::by_cause(std::mem::take(&mut job.warnings));
                job.regions = regions;
            }
            Err(error) => {
                tracing::warn!(job = %job.id, error = &error as &dyn std::error::Error, "the coverage of its regions cannot be read");
            }
        }
        job
    }

    /// Coverage of the regions of a job that has succeeded.
    async fn regions(&self, id: JobId) -> Result<Vec<RegionCoverageDocument>, Error> {
        let bytes = self.result(id, "coverage.json").await?.read().await?;
        let result: CoverageResult = parse(&bytes)?;
        Ok(result.coverage.regions)
    }

    /// Reason why a result is refused unless it is forced: a program in the language of another maker than the robot's, stored by a
    /// release that did not tell them apart. Its robot's language is that of its specification or, where that has none, of the preset
    /// of the same name.
    ///
    /// # Errors
    /// [`Error::Internal`].
    pub async fn foreign_reason(&self, id: JobId, name: &str) -> Result<Option<String>, Error> {
        let Some(dialect) = dialect_of(name) else { return Ok(None) };
        let Some((robot, own)) = self.0.store.robot(id).await? else { return Ok(None) };
        let own = match own {
            Some(own) => Dialect::ALL.into_iter().find(|dialect| dialect.as_str() == own),
            None => PRESETS.robot(&robot).ok().and_then(|preset| preset.dialect),
        };
        let foreign = own.filter(|own| *own != dialect);
        Ok(foreign.map(|own| DialectError::Foreign { dialect: dialect.as_str(), robot, own: own.as_str() }.to_string()))
    }

    /// One of a job's results; its file is not read yet. A report that nobody has asked for before is drawn first.
    ///
    /// # Errors
    /// [`Error::JobNotFound`], [`Error::NoResults`], [`Error::NoSuchResult`], [`Error::Internal`].
    pub async fn result(&self, id: JobId, name: &str) -> Result<ResultBody, Error> {
        self.found_result(id, name).await
    }

    /// A result that no file holds, ready to be read.
    pub(super) fn body_of_unstored(&self, artifact: Artifact) -> ResultBody {
        let file = ResultFile::of_bytes(&artifact.name, &artifact.bytes);
        ResultBody { app: self.clone(), file, unstored: Some(artifact.bytes.into()) }
    }

    /// A result file, ready to be read.
    pub(super) fn body_of(&self, file: ResultFile) -> ResultBody {
        ResultBody { app: self.clone(), file, unstored: None }
    }
}

/// Part of `coverage.json` that a job shows.
#[derive(Deserialize)]
struct CoverageResult {
    coverage: CoverageOfRegions,
}

#[derive(Deserialize)]
struct CoverageOfRegions {
    #[serde(default)]
    regions: Vec<RegionCoverageDocument>,
}

/// A result of a job or of an inspection, ready to be read.
#[derive(Clone)]
pub struct ResultBody {
    app: App,
    file: ResultFile,
    /// Bytes of a result that no file holds.
    unstored: Option<Arc<[u8]>>,
}

impl ResultBody {
    /// SHA-256 of the result, lower-case hexadecimal.
    #[must_use]
    pub fn sha256(&self) -> &str {
        &self.file.result.sha256
    }

    /// Size of what [`ResultBody::open`] reads: of the compressed file if `packed`, else of the result.
    #[must_use]
    pub fn size_bytes(&self, packed: bool) -> u64 {
        if packed { self.file.file_bytes } else { self.file.result.size_bytes }
    }

    /// Returns true if the result is stored compressed (gzip) and can be read in that form.
    #[must_use]
    pub fn is_packed(&self) -> bool {
        self.file.encoding == FileEncoding::Gzip
    }

    /// Opens the result, once its file has been compared with its hash: the file as stored if `packed`, else decompressed.
    /// Reading blocks.
    ///
    /// # Errors
    /// [`Error::FileDamaged`], [`Error::StorageBusy`], [`Error::Internal`].
    pub async fn open(&self, packed: bool) -> Result<Box<dyn Read + Send>, Error> {
        if let Some(bytes) = &self.unstored {
            return Ok(Box::new(Cursor::new(Arc::clone(bytes))));
        }
        self.app.0.store.open_result(&self.file, !packed).await
    }

    /// Bytes of the result.
    ///
    /// # Errors
    /// [`Error::FileDamaged`], [`Error::StorageBusy`], [`Error::Internal`].
    pub async fn read(&self) -> Result<Vec<u8>, Error> {
        if let Some(bytes) = &self.unstored {
            return Ok(bytes.to_vec());
        }
        self.app.0.store.read_result(&self.file).await
    }
}
