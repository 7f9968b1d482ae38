//! Inspections: scans of a job held against its plan. Accepted like jobs, computed one after another beside them, kept as they came
//! out. One that an earlier process left is computed anew.

use std::collections::HashMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex as StdMutex, PoisonError};
use std::time::Duration;

use tokio::sync::{Mutex, Notify};
use tokio::time::{Instant, timeout_at};

use super::app::App;
use super::error::{Error, InternalError, MissingRun};
use super::inspect_job::{InspectError, InspectJob, Inspected, ScanSource};
use super::jobs::{failure, problem_of_error};
use super::plan_job::PLAN_FILE;
use super::planner::JobInput;
use super::queries::ResultBody;
use super::rescan_job::RESCAN_STATE_FILE;
use super::store::{LeftOver, Page, StoredArtifacts, StoredInspection};
use super::submit::{StoredRescan, Submission, job_input};
use crate::cell::FieldError;
use crate::planning::context::Context;
use crate::wire::inspection::{
    InspectionJob, InspectionPage, InspectionRequest, InspectionSelection, InspectionSummary, RescanRequest, Scan,
};
use crate::wire::run::{RunMode, RunRecordDocument};
use crate::wire::{FailureCode, InspectionId, Job, JobId, JobProblem, JobState, ProblemField, RunId, ScanId, parse};

/// Max number of inspections that wait.
const MAX_QUEUED: u64 = 1000;

/// State that inspections share.
#[derive(Default)]
pub(super) struct Inspections {
    /// Held while one is computed.
    turn: Mutex<()>,
    /// One of them has changed.
    changed: Notify,
    /// Inspections that are computed, with their cancel flag and their share done.
    running: StdMutex<HashMap<InspectionId, (Arc<AtomicBool>, f64)>>,
}

impl Inspections {
    fn running(&self) -> std::sync::MutexGuard<'_, HashMap<InspectionId, (Arc<AtomicBool>, f64)>> {
        // Entries are inserted and removed whole, so a poisoned lock is usable.
        self.running.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn set_fraction(&self, id: InspectionId, fraction: f64) {
        if let Some((_, done)) = self.running().get_mut(&id) {
            *done = fraction;
        }
    }
}

impl App {
    /// Accepts an inspection of a job that has a plan and scans. If the idempotency key was used for the same request before,
    /// returns the earlier answer.
    ///
    /// # Errors
    /// [`Error::JobNotFound`], [`Error::NoResults`], [`Error::NoScans`], [`Error::Invalid`], [`Error::IdempotencyMismatch`],
    /// [`Error::QueueFull`], [`Error::Draining`], [`Error::StorageFull`], [`Error::StorageLow`], [`Error::StorageBusy`],
    /// [`Error::Unrecovered`], [`Error::Internal`].
    pub async fn submit_inspection(
        &self,
        job_id: JobId,
        request: InspectionRequest,
        submission: Submission,
    ) -> Result<InspectionJob, Error> {
        let canonical = format!("POST /api/v1/jobs/{job_id}/inspections {}", serde_json::to_string(&request)?);
        let idempotency = submission.idempotency(&canonical);
        if let Some(answer) = self.answered_before(idempotency.as_ref()).await? {
            return Ok(answer);
        }
        self.check_planned(job_id).await?;
        let scans = self.chosen_scans(job_id, request.scans.as_deref()).await?;
        request.params.check().map_err(|errors| Error::Invalid(below_params(errors)))?;
        if let Some(run) = request.run_id {
            self.check_run(job_id, run).await?;
        }
        let job = InspectionJob {
            id: InspectionId::generate(),
            job_id,
            state: JobState::Queued,
            scans: scans.iter().map(|scan| scan.id).collect(),
            run_id: request.run_id,
            params: request.params,
            fraction: 0.0,
            submitted_by: submission.submitted_by,
            created_at: String::new(),
            ended_at: None,
            summary: None,
            files: Vec::new(),
            problem: None,
        };
        let app = self.clone();
        self.run_to_completion(async move {
            let input = StoredInspection { scans };
            let accepted = app.0.store.insert_inspection(&job, &input, idempotency.as_ref(), MAX_QUEUED).await?;
            // Else another request with the same key came first.
            if accepted.id == job.id {
                app.spawn(app.clone().carry_out_inspection(job.id));
            }
            Ok(accepted)
        })
        .await
    }

    /// The scans that a request names, or all of the job's.
    async fn chosen_scans(&self, job: JobId, named: Option<&[ScanId]>) -> Result<Vec<Scan>, Error> {
        let all = self.0.store.all_scans(job).await?;
        if all.is_empty() {
            return Err(Error::NoScans(job));
        }
        let Some(named) = named else { return Ok(all) };
        let (count, limit) = (named.len(), InspectionRequest::MAX_SCANS);
        if count > limit {
            let detail = format!("has {count} entries; at most {limit} are allowed");
            return Err(Error::Invalid(vec![FieldError { pointer: "/scans".to_owned(), detail }]));
        }
        let (mut chosen, mut errors) = (Vec::new(), Vec::new());
        if named.is_empty() {
            let detail = "is empty; name at least one scan, or leave it out to compare all scans of the job".to_owned();
            errors.push(FieldError { pointer: "/scans".to_owned(), detail });
        }
        for (index, id) in named.iter().enumerate() {
            if let Some(first) = named[..index].iter().position(|other| other == id) {
                let detail = format!("is {id}, which is given at /scans/{first} already");
                errors.push(FieldError { pointer: format!("/scans/{index}"), detail });
                continue;
            }
            match all.iter().find(|scan| scan.id == *id) {
                Some(scan) => chosen.push(scan.clone()),
                None => errors.push(FieldError {
                    pointer: format!("/scans/{index}"),
                    detail: format!("is {id}; job {job} has no scan of this id"),
                }),
            }
        }
        if errors.is_empty() { Ok(chosen) } else { Err(Error::Invalid(errors)) }
    }

    /// Refuses a run that is not there, one of another job, a dry run, and one that has taken no scan.
    async fn check_run(&self, job: JobId, id: RunId) -> Result<(), Error> {
        let run = self.run(id).await.map_err(of_missing_run)?;
        if run.job_id != Some(job) {
            return Err(of_run(format!("is {id}, which is a run of another job than {job}")));
        }
        if run.mode == RunMode::DryRun {
            let detail = "a dry run, which moves nothing and takes no scans; name the run in which they were taken, or leave it out, so \
                          that the poses of the plan count";
            return Err(of_run(format!("is {id}, {detail}")));
        }
        if run.scans == 0 {
            let detail = "a run that has taken no scan; name the run in which the scans were taken, or leave it out, so that the poses of \
                          the plan count";
            return Err(of_run(format!("is {id}, {detail}")));
        }
        Ok(())
    }

    /// One inspection.
    ///
    /// # Errors
    /// [`Error::InspectionNotFound`], [`Error::Internal`].
    pub async fn inspection(&self, id: InspectionId) -> Result<InspectionJob, Error> {
        let mut job = self.0.store.inspection(id).await?;
        if let Some((_, fraction)) = self.0.inspections.running().get(&id) {
            job.fraction = *fraction;
        }
        Ok(job)
    }

    /// Waits until an inspection has ended, at most for `wait`; returns it as it is then.
    ///
    /// # Errors
    /// [`Error::InspectionNotFound`], [`Error::Internal`].
    pub async fn inspection_when_ended(&self, id: InspectionId, wait: Duration) -> Result<InspectionJob, Error> {
        let until = Instant::now() + wait;
        loop {
            // Made before the inspection is read, so that no change is missed in between.
            let changed = self.0.inspections.changed.notified();
            let job = self.inspection(id).await?;
            if job.state.is_ended() {
                return Ok(job);
            }
            tokio::select! {
                () = self.0.stopping.cancelled() => return self.inspection(id).await,
                in_time = timeout_at(until, changed) => if in_time.is_err() {
                    return self.inspection(id).await;
                },
            }
        }
    }

    /// A page of inspections, newest first.
    ///
    /// # Errors
    /// [`Error::BadPageToken`], [`Error::Internal`].
    pub async fn inspections(
        &self,
        selection: &InspectionSelection,
        page_size: u32,
        page_token: Option<&str>,
    ) -> Result<InspectionPage, Error> {
        let filters = format!("inspections {}", serde_json::to_string(selection)?);
        self.0.store.inspections(selection, &Page::new(page_size, page_token, &filters)?).await
    }

    /// A file of an inspection.
    ///
    /// # Errors
    /// [`Error::InspectionNotFound`], [`Error::NoInspection`], [`Error::NoInspectionFile`], [`Error::Internal`].
    pub async fn inspection_result(&self, id: InspectionId, name: &str) -> Result<ResultBody, Error> {
        let file = self.0.store.inspection_file(id, name).await?;
        Ok(self.body_of(file))
    }

    /// Accepts a job that plans further views for what the scans of an inspection lack.
    ///
    /// # Errors
    /// [`Error::InspectionNotFound`], [`Error::NoInspection`], those of [`App::submit`].
    pub async fn submit_rescan_of(&self, id: InspectionId, request: RescanRequest, submission: Submission) -> Result<Job, Error> {
        request.params.check().map_err(|errors| Error::Invalid(below_params(errors)))?;
        let job = self.inspection(id).await?;
        let state = parse(&self.inspection_result(id, RESCAN_STATE_FILE).await?.read().await?)?;
        self.submit_rescan(&job, StoredRescan { state, params: request.params }, submission).await
    }

    /// Cancels an inspection.
    ///
    /// # Errors
    /// [`Error::InspectionNotFound`], [`Error::InspectionEnded`], [`Error::StorageBusy`], [`Error::Internal`].
    pub async fn cancel_inspection(&self, id: InspectionId) -> Result<InspectionJob, Error> {
        let cancel = |job: &mut InspectionJob| {
            job.state = if job.state == JobState::Queued { JobState::Cancelled } else { JobState::Cancelling };
        };
        let app = self.clone();
        // To its end though the caller goes away: what is told as cancelled is stopped, and the reserve is filled again.
        let change = async move {
            let change = || app.change_inspection(id, &[JobState::Queued, JobState::Running], cancel, None);
            let job = app.freeing(change).await?;
            if let Some((flag, _)) = app.0.inspections.running().get(&id) {
                flag.store(true, Ordering::Relaxed);
            }
            Ok::<_, Error>(job)
        };
        let job = self.run_to_completion(change).await?;
        match job.state {
            JobState::Succeeded | JobState::Failed => Err(Error::InspectionEnded { inspection: id, state: job.state }),
            JobState::Queued | JobState::Running | JobState::Cancelling | JobState::Cancelled => Ok(job),
        }
    }

    /// Deletes an ended inspection of a job that is not held.
    ///
    /// # Errors
    /// [`Error::InspectionNotFound`], [`Error::InspectionNotEnded`], [`Error::JobHeld`], [`Error::StorageBusy`],
    /// [`Error::Internal`].
    pub async fn delete_inspection(&self, id: InspectionId) -> Result<(), Error> {
        let app = self.clone();
        self.run_to_completion(async move {
            let hold = &app.0.options.retention.hold_label;
            app.freeing(|| app.0.store.delete_inspection(id, hold)).await
        })
        .await
    }

    /// Begins again what an earlier process left.
    pub(super) async fn recover_inspections(&self) -> Result<(), Error> {
        let exhausted = self.exhausted();
        for LeftOver { id, attempts } in self.recovering(|| self.0.store.inspections_left_over()).await? {
            let problem = (attempts >= self.0.options.max_attempts).then(|| exhausted.clone());
            let again = move |job: &mut InspectionJob| {
                job.state = match (job.state, &problem) {
                    (JobState::Cancelling, _) => JobState::Cancelled,
                    (_, Some(_)) => JobState::Failed,
                    (_, None) => JobState::Queued,
                };
                job.problem = problem.filter(|_| job.state == JobState::Failed);
            };
            let change = || self.change_inspection(id, &[JobState::Running, JobState::Cancelling], again.clone(), None);
            match self.recovering(change).await {
                Ok(job) if job.state == JobState::Queued => self.spawn(self.clone().carry_out_inspection(id)),
                // Deleted meanwhile: recovery may have waited for room.
                Ok(_) | Err(Error::InspectionNotFound(_)) => {}
                Err(Error::Internal(InternalError::Row(reason))) => {
                    tracing::error!(inspection = %id, reason, "a stored inspection cannot be read; it counts as failed");
                    self.recovering(|| self.0.store.give_up_inspection(id)).await?;
                }
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }

    async fn change_inspection(
        &self,
        id: InspectionId,
        from: &'static [JobState],
        change: impl FnOnce(&mut InspectionJob) + Send + 'static,
        files: Option<Arc<StoredArtifacts>>,
    ) -> Result<InspectionJob, Error> {
        let app = self.clone();
        // One type for all changes, so that what follows is compiled once.
        let change: Box<dyn FnOnce(&mut InspectionJob) + Send> = Box::new(change);
        let changed =
            self.run_to_completion(async move { app.0.store.change_inspection(id, from, change, files.as_deref()).await }).await;
        self.0.inspections.changed.notify_waiters();
        changed
    }

    /// Changes an inspection that is carried out; tries again while the store is temporarily unavailable.
    async fn advance_inspection(
        &self,
        id: InspectionId,
        from: &'static [JobState],
        change: impl FnOnce(&mut InspectionJob) + Clone + Send + 'static,
        files: Option<Arc<StoredArtifacts>>,
    ) -> Result<InspectionJob, Error> {
        let change = move || self.change_inspection(id, from, change.clone(), files.clone());
        self.retried("storing the state of an inspection", || false, change).await
    }

    /// Computes an inspection when its turn comes. What the service's stop leaves is computed by the next process.
    async fn carry_out_inspection(self, id: InspectionId) {
        let _turn = tokio::select! {
            turn = self.0.inspections.turn.lock() => turn,
            () = self.0.stopping.cancelled() => return,
        };
        let flag = Arc::new(AtomicBool::new(false));
        self.0.inspections.running().insert(id, (Arc::clone(&flag), 0.0));
        let computed = self.compute_inspection(id, flag).await;
        self.0.inspections.running().remove(&id);
        let ended = match computed {
            // It was cancelled while it waited for the store.
            Err(error) if error.is_transient() && !self.0.stopping.is_cancelled() => self.end_inspection(id, None).await,
            Err(error) if !error.is_transient() => {
                tracing::error!(inspection = %id, error = &error as &dyn std::error::Error, "an inspection cannot be computed");
                let problem = problem_of_error(&error);
                let fail = move |job: &mut InspectionJob| (job.state, job.problem) = (JobState::Failed, Some(problem));
                self.advance_inspection(id, &OPEN, fail, None).await.map(drop)
            }
            ended => ended,
        };
        if let Err(error) = ended {
            tracing::error!(inspection = %id, error = &error as &dyn std::error::Error, "the end of an inspection cannot be stored");
        }
    }

    /// Computes an inspection; an error is transient only where the service stops or the inspection is cancelled.
    async fn compute_inspection(&self, id: InspectionId, flag: Arc<AtomicBool>) -> Result<(), Error> {
        let run = |job: &mut InspectionJob| job.state = JobState::Running;
        let job = self.advance_inspection(id, &[JobState::Queued], run, None).await?;
        if job.state != JobState::Running {
            return Ok(());
        }
        let is_cancelled = || flag.load(Ordering::Relaxed);
        let order = self.retried("reading the plan of an inspection", is_cancelled, || self.inspection_order(&job)).await?;
        let (cells, app) = (Arc::clone(&self.0.cells), self.clone());
        let compute = move |ctx: &Context<'_>| {
            let progress = |fraction: f64| app.0.inspections.set_fraction(id, fraction);
            order.job.execute(&order.input, &cells, &progress, ctx)
        };
        let cancel = Arc::clone(&flag);
        let computed = self.0.runner.compute(flag, compute);
        tokio::pin!(computed);
        let computed = tokio::select! {
            computed = &mut computed => computed,
            () = self.0.stopping.cancelled() => {
                cancel.store(true, Ordering::Relaxed);
                (&mut computed).await
            }
        };
        match computed {
            Ok(Ok(inspected)) => self.store_inspection(id, inspected, &cancel).await,
            Ok(Err(InspectError::Cancelled)) if self.0.stopping.is_cancelled() => {
                // The next process computes it; this attempt does not count.
                let again = |job: &mut InspectionJob| job.state = JobState::Queued;
                self.advance_inspection(id, &[JobState::Running], again, None).await.map(drop)
            }
            Ok(Err(error)) => self.end_inspection(id, problem_of(error)).await,
            Err(panic) => {
                let problem = failure(FailureCode::JobPanicked, format!("internal error: {panic}"), Vec::new());
                self.end_inspection(id, Some(problem)).await
            }
        }
    }

    /// Everything that an inspection reads.
    async fn inspection_order(&self, job: &InspectionJob) -> Result<InspectionOrder, Error> {
        let attempt = self.0.store.body(job.job_id).await?.ok_or(Error::JobNotFound(job.job_id))?;
        let files = self.0.store.files();
        let input = job_input(&attempt, files, self.0.options.max_triangles)?;
        let stored = self.0.store.inspection_input(job.id).await?;
        let source = |scan: Scan| ScanSource {
            path: files.path(&scan.sha256),
            sha256: scan.sha256.clone(),
            name: scan.name.clone().unwrap_or_else(|| scan.id.to_string()),
            is_named: scan.name.is_some(),
            view: scan.view,
            unit: scan.unit.clone(),
            frame: scan.frame,
        };
        let scans = stored.scans.into_iter().map(source).collect();
        let plan = self.result(job.job_id, PLAN_FILE).await?.read().await?;
        let record: Option<RunRecordDocument> = match job.run_id {
            Some(run) => Some(self.run_record(run).await.map_err(of_missing_run)?),
            None => None,
        };
        Ok(InspectionOrder {
            job: InspectJob {
                plan,
                scans,
                params: job.params.clone(),
                record,
                before: input.rescan.as_ref().map(|rescan| rescan.state.clone()),
                date: Some(job.created_at.clone()),
            },
            input,
        })
    }

    async fn store_inspection(&self, id: InspectionId, inspected: Inspected, cancel: &AtomicBool) -> Result<(), Error> {
        let files = Arc::new(inspected.files);
        let put = || self.put_results(Arc::clone(&files));
        let stored = self.retried("storing an inspection", || cancel.load(Ordering::Relaxed), put).await?;
        self.keep_inspection(id, inspected.summary, stored).await
    }

    /// Ends an inspection with its stored result, unless it was cancelled meanwhile: then no row names the files, which are taken back.
    async fn keep_inspection(&self, id: InspectionId, summary: InspectionSummary, stored: StoredArtifacts) -> Result<(), Error> {
        let written = stored.written.clone();
        let end = move |job: &mut InspectionJob| {
            (job.state, job.fraction, job.summary) = (JobState::Succeeded, 1.0, Some(summary));
        };
        let job = self.advance_inspection(id, &[JobState::Running], end, Some(Arc::new(stored))).await?;
        if job.state != JobState::Cancelling {
            return Ok(());
        }
        // Whoever cancelled it was told so: it came too late to save the work, and in time to be heard.
        self.0.store.take_back(written).await;
        self.end_inspection(id, None).await
    }

    /// Ends an inspection without a result: failed with a problem, or cancelled.
    async fn end_inspection(&self, id: InspectionId, problem: Option<JobProblem>) -> Result<(), Error> {
        let end = move |job: &mut InspectionJob| {
            job.state = if problem.is_some() { JobState::Failed } else { JobState::Cancelled };
            job.problem = problem;
        };
        self.advance_inspection(id, &[JobState::Running, JobState::Cancelling], end, None).await.map(drop)
    }
}

/// An inspection with everything that it reads.
struct InspectionOrder {
    job: InspectJob,
    input: JobInput,
}

/// States before the end.
const OPEN: [JobState; 3] = [JobState::Queued, JobState::Running, JobState::Cancelling];

/// Error at the run that a request names.
fn of_run(detail: String) -> Error {
    Error::Invalid(vec![FieldError { pointer: "/run_id".to_owned(), detail }])
}

/// Error at a run that is not there. An accepted inspection does not keep its run from being deleted, which is no fault of the server.
fn of_missing_run(error: Error) -> Error {
    let Error::RunNotFound(MissingRun { run, deletion }) = error else { return error };
    let gone = match deletion {
        Some(deletion) => format!("that run was deleted {deletion}, and with it the poses that it measured"),
        None => "no run has this id: it was deleted, or never was".to_owned(),
    };
    of_run(format!("is {run}; {gone}; scans and plan remain: inspect without run_id, which uses the poses of the plan"))
}

fn below_params(errors: Vec<FieldError>) -> Vec<FieldError> {
    errors.into_iter().map(|error| error.below("/params")).collect()
}

/// Problem of an inspection that has no result; `None` if it was cancelled.
fn problem_of(error: InspectError) -> Option<JobProblem> {
    let detail = error.to_string();
    match error {
        InspectError::Cancelled => None,
        InspectError::Refused(errors) => {
            Some(failure(FailureCode::JobInputInvalid, detail, errors.into_iter().map(ProblemField::from).collect()))
        }
        InspectError::Damaged(_) => Some(failure(FailureCode::FileDamaged, detail, Vec::new())),
    }
}

#[cfg(test)]
mod tests;
