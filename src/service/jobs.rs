//! The dispatcher takes jobs from the queue as `schedule.rs` lets it, and each is planned in a task of its own: on the planning pool, or
//! on threads that it has to itself. Each attempt has its own cancel flag, and a panic ends only its attempt. Stage times are measured
//! here, since planning reads no clock.

mod failure;
mod runner;
mod tracker;

use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, PoisonError};
use std::time::Instant;

use serde::Deserialize;
use sha2::{Digest, Sha256};

use self::failure::{AttemptError, input_invalid, job_problem, unstored};
pub(super) use self::failure::{failure, problem_of_error};
pub(super) use self::runner::JobRunner;
use self::tracker::{Tracker, persist_progress};
use super::app::App;
use super::error::Error;
use super::failpoint;
use super::metrics;
use super::plan_job::{PLAN_FILE, left_out_candidates};
use super::planner::{Artifact, JobError};
use super::progress::Course;
use super::retry::{Attempts, MAX_STORE_RETRY, STORE_RETRY};
use super::schedule::{Ahead, Share};
use super::size::JobSize;
use super::store::{Attempt, AttemptOutcome, blocking};
use super::submit::job_input;
use crate::wire::summary::{SUMMARY_FILE, Summary};
use crate::wire::warnings::{FieldWarning, WarningCode};
use crate::wire::{FailureCode, JobId, JobProblem, JobState, hex, parse};

/// Jobs of the queue that are looked at for one that may start.
const LOOKED_AT: u32 = 64;

/// Result of an attempt.
enum Attempted {
    /// Files to store, and the problem that they tell of where the job fails.
    Files(Vec<Artifact>, Option<JobProblem>),
    /// An outcome without files.
    Ended(AttemptOutcome),
}

/// Starts jobs of the queue until the service stops.
pub(super) async fn dispatch(app: App) {
    let stopping = app.stopping();
    let (mut pause, mut attempts) = (STORE_RETRY, Attempts::new());
    while !stopping.is_cancelled() {
        match app.start_next().await {
            Ok(true) => {}
            Ok(false) => tokio::select! {
                () = stopping.cancelled() => {}
                () = app.0.runner.woken.notified() => {}
            },
            Err(error) => {
                if let Some(failed) = attempts.count_failed(Instant::now()) {
                    tracing::error!(failed, error = &error as &dyn std::error::Error, "the queue cannot be read; retrying");
                }
                app.pause(pause).await;
                pause = (pause * 2).min(MAX_STORE_RETRY);
                continue;
            }
        }
        if let Some(failed) = attempts.failed_before() {
            tracing::info!(failed, "the queue was read again");
        }
        (pause, attempts) = (STORE_RETRY, Attempts::new());
    }
}

/// A job's threads; given back when dropped, however its task ends.
struct SeatGuard {
    app: App,
    id: JobId,
}

impl Drop for SeatGuard {
    fn drop(&mut self) {
        let runner = &self.app.0.runner;
        runner.lock().remove(&self.id);
        runner.schedule().leave(self.id);
        runner.wake();
    }
}

impl App {
    /// Recovers the jobs that an earlier process left unfinished.
    pub(super) async fn recover(&self) -> Result<(), Error> {
        let exhausted = self.exhausted();
        let found = self.recovering(|| self.0.store.recover(self.0.options.max_attempts, &exhausted)).await?;
        if found > 0 {
            tracing::warn!(jobs = found, "an earlier process died while jobs were running; they are recovered");
        }
        Ok(())
    }

    /// Problem of what the process died of in every attempt.
    pub(super) fn exhausted(&self) -> JobProblem {
        let attempts = self.0.options.max_attempts;
        let detail =
            format!("the process died in each of {attempts} attempts; the job may need more memory than the machine has");
        failure(FailureCode::JobAttemptsExhausted, detail, Vec::new())
    }

    /// Starts the first job of the queue that may, or finds out the size of one; false if nothing is left to do.
    async fn start_next(&self) -> Result<bool, Error> {
        let runner = &self.0.runner;
        if runner.schedule().is_full() {
            return Ok(false);
        }
        let queue = self.0.store.queue(LOOKED_AT).await?;
        let is_shared = runner.schedule().is_shared();
        let unknown = runner.schedule().of_unknown_size().filter(|_| is_shared && !queue.is_empty());
        if let Some(id) = unknown {
            let size = self.measure(id).await?;
            runner.schedule().note_size(id, size);
            return Ok(true);
        }
        let (is_alone, mut ahead) = (queue.len() == 1, Ahead::default());
        for text in &queue {
            let Ok(id) = text.parse::<JobId>() else { return self.start(text, None, None).await };
            // Its attempt was postponed, and is not quite over.
            if runner.schedule().has(id) {
                continue;
            }
            let is_first = runner.schedule().share_for(None, is_alone, &ahead).is_some();
            let size = runner.sizes.get(text);
            if size.is_none() && is_shared && !(is_alone && is_first) {
                self.measure(id).await?;
                // That takes far longer than a reading of the queue, and something may have ended or come meanwhile: from the beginning.
                return Ok(true);
            }
            let share = runner.schedule().share_for(size.as_ref(), is_alone, &ahead);
            match share {
                Some(share) => return self.start(text, Some((id, share)), size).await,
                None => runner.schedule().pass(&size.unwrap_or(JobSize::UNKNOWN), &mut ahead),
            }
        }
        Ok(false)
    }

    /// Claims a job and plans it in a task of its own. One without a share fails, since its id cannot be read.
    async fn start(&self, text: &str, share: Option<(JobId, Share)>, size: Option<JobSize>) -> Result<bool, Error> {
        let Some(attempt) = self.0.store.claim(text).await? else { return Ok(true) };
        if let Some((id, share)) = share {
            self.0.runner.schedule().seat(id, share, size);
            let seat = SeatGuard { app: self.clone(), id };
            let app = self.clone();
            self.spawn(async move {
                app.attempt(attempt, share).await;
                drop(seat);
            });
        }
        Ok(true)
    }

    /// Size of a job, which is kept: of another with the same input, or estimated on a thread that may block. A job that cannot be
    /// read fails with the reason when it is started.
    async fn measure(&self, id: JobId) -> Result<JobSize, Error> {
        let runner = &self.0.runner;
        let size = match self.0.store.body(id).await? {
            None => JobSize::NOTHING,
            Some(attempt) => {
                let content = format!("{} {}", attempt.input, serde_json::to_string(&attempt.request.params)?);
                let content = hex(&Sha256::digest(content));
                match runner.sizes.get(&content) {
                    Some(size) => size,
                    None => {
                        let size = self.estimate(attempt).await?;
                        if size != JobSize::UNKNOWN {
                            runner.sizes.put(content, size);
                        }
                        size
                    }
                }
            }
        };
        tracing::debug!(job = %id, core_secs = size.core_secs, bytes = size.bytes, "size estimated");
        runner.sizes.put(id.to_string(), size);
        Ok(size)
    }

    async fn estimate(&self, attempt: Attempt) -> Result<JobSize, Error> {
        let Ok(input) = job_input(&attempt, self.0.store.files(), self.0.options.max_triangles) else {
            return Ok(JobSize::NOTHING);
        };
        let (sizer, stopping) = (self.0.runner.sizer.clone(), self.stopping());
        blocking(move || {
            let stop = || stopping.is_cancelled();
            // Unwind safe: nothing that the closure uses is used again after a panic, and the job itself panics again.
            Ok(catch_unwind(AssertUnwindSafe(|| sizer(&input, &stop))).unwrap_or(JobSize::NOTHING))
        })
        .await
    }

    #[tracing::instrument(skip_all, fields(job = %attempt.id, attempt = attempt.number))]
    async fn attempt(&self, attempt: Attempt, share: Share) {
        failpoint::hit("job", "claimed");
        let cancel = Arc::new(AtomicBool::new(false));
        self.0.runner.lock().insert(attempt.id, cancel.clone());
        // A cancellation or a stop between the claim and the line above did not see the flag.
        let cancelled = self.0.store.job_state(attempt.id).await.is_ok_and(|state| state == JobState::Cancelling);
        cancel.fetch_or(cancelled || self.0.stopping.is_cancelled(), Ordering::Relaxed);
        let began = Instant::now();
        let flag = Arc::clone(&cancel);
        let (attempted, timings) = self.plan(&attempt, share, cancel).await;
        // Interrupted although the service goes on: the machine is temporarily short of a resource.
        let is_postponed = matches!(attempted, Attempted::Ended(AttemptOutcome::Interrupted));
        let state = match attempted {
            Attempted::Files(artifacts, problem) => self.store_artifacts(attempt.id, (artifacts, problem), &timings, &flag).await,
            Attempted::Ended(outcome) => self.record_outcome(attempt.id, outcome, &timings).await,
        };
        if is_postponed {
            self.pause(STORE_RETRY).await;
        }
        let seconds = began.elapsed().as_secs_f64();
        metrics::record(|metrics| {
            metrics.attempts.with_label_values(&[state.map_or("unknown", JobState::as_str)]).inc();
            metrics.attempt_seconds.observe(seconds);
        });
        tracing::info!(state = state.map(JobState::as_str), seconds, "attempt ended");
    }

    /// Plans a job and persists its progress. Returns also the stage times.
    async fn plan(&self, attempt: &Attempt, share: Share, cancel: Arc<AtomicBool>) -> (Attempted, BTreeMap<String, f64>) {
        let input = match job_input(attempt, self.0.store.files(), self.0.options.max_triangles) {
            Ok(input) => input,
            Err(error) => {
                tracing::error!(error = &error as &dyn std::error::Error, "a stored job cannot be read; it fails");
                let problem = failure(FailureCode::JobUnreadable, error.to_string(), Vec::new());
                return (Attempted::Ended(AttemptOutcome::Failed(problem, Vec::new())), BTreeMap::new());
            }
        };
        let (tracker, updates) = Tracker::new(&Course::of_plan(&input.params, input.cell.is_some()));
        let persisting = tokio::spawn(persist_progress(self.clone(), attempt.id, updates));
        let times = tracker.times.clone();
        let result = self.0.runner.plan(input, share, cancel, Arc::new(tracker)).await;
        // The task ends when the tracker is dropped; its errors are in the log.
        let _ = persisting.await;
        let timings = times.lock().unwrap_or_else(PoisonError::into_inner).closed();
        let attempted = match result {
            Ok(artifacts) => Attempted::Files(artifacts, None),
            Err(AttemptError::Job(JobError::Cancelled)) if self.0.stopping.is_cancelled() => {
                Attempted::Ended(AttemptOutcome::Interrupted)
            }
            Err(AttemptError::Job(JobError::Cancelled)) => Attempted::Ended(AttemptOutcome::Cancelled),
            Err(AttemptError::Job(JobError::Unavailable(reason))) => {
                tracing::warn!(reason, "the attempt is postponed");
                Attempted::Ended(AttemptOutcome::Interrupted)
            }
            Err(AttemptError::Job(JobError::PartRefused { errors, report })) if !report.is_empty() => {
                Attempted::Files(report, Some(input_invalid(errors)))
            }
            Err(AttemptError::Job(JobError::NoPlan { reasons, report })) if !report.is_empty() => {
                Attempted::Files(report, Some(failure(FailureCode::NoPlan, reasons, Vec::new())))
            }
            Err(error @ (AttemptError::Job(_) | AttemptError::Panicked(_) | AttemptError::TimedOut(_))) => {
                Attempted::Ended(AttemptOutcome::Failed(job_problem(error), Vec::new()))
            }
        };
        (attempted, timings)
    }

    /// Stores the files of an attempt and records its outcome: a failure where there is a problem. While the disk is full or the
    /// store is temporarily unavailable, it retries: finished plans are not thrown away.
    async fn store_artifacts(
        &self,
        id: JobId,
        (mut artifacts, problem): (Vec<Artifact>, Option<JobProblem>),
        timings: &BTreeMap<String, f64>,
        cancel: &AtomicBool,
    ) -> Option<JobState> {
        match serde_json::to_vec_pretty(timings) {
            Ok(bytes) => artifacts.push(Artifact { name: "timings.json".into(), bytes }),
            Err(error) => {
                return self.record_outcome(id, AttemptOutcome::Failed(unstored(&error.into()), Vec::new()), timings).await;
            }
        }
        let (summary, warnings, artifacts) = (summary_of(&artifacts), warnings_of(&artifacts), Arc::new(artifacts));
        let put = || async {
            let stored = self.put_results(Arc::clone(&artifacts)).await;
            self.0.runner.set_waiting(id, stored.as_ref().is_err_and(Error::is_transient));
            stored
        };
        // Held until the rows are written: it pins the files.
        let stored = self.retried("storing the results of a job", || cancel.load(Ordering::Relaxed), put).await;
        let outcome = match (&stored, problem) {
            (Ok(stored), None) => AttemptOutcome::Succeeded { files: stored.files.clone(), summary, warnings },
            (Ok(stored), Some(problem)) => AttemptOutcome::Failed(problem, stored.files.clone()),
            (Err(error), _) if error.is_transient() && self.0.stopping.is_cancelled() => AttemptOutcome::Interrupted,
            (Err(error), _) if error.is_transient() => AttemptOutcome::Cancelled,
            (Err(error), problem) => AttemptOutcome::Failed(problem.unwrap_or_else(|| unstored(error)), Vec::new()),
        };
        let state = self.record_outcome(id, outcome, timings).await;
        if let (Ok(stored), Some(JobState::Cancelled | JobState::Queued | JobState::Failed)) = (stored, state) {
            // No row names them where the job was cancelled meanwhile, for one. They are pinned until they are dropped.
            let written = stored.written.clone();
            drop(stored);
            self.0.store.take_back(written).await;
        }
        state
    }

    /// Records the outcome of an attempt. One that the store refuses twice becomes a failure with the reason. `None` where nothing is
    /// stored yet, where the service stops, and for a job that was deleted.
    async fn record_outcome(&self, id: JobId, outcome: AttemptOutcome, timings: &BTreeMap<String, f64>) -> Option<JobState> {
        let timings = serde_json::to_string(timings).unwrap_or_else(|_| "{}".to_owned());
        let error = match self.try_to_end(id, &outcome, &timings).await {
            Ok(state) => return state,
            Err(error) => error,
        };
        self.pause(STORE_RETRY).await;
        if let Ok(state) = self.try_to_end(id, &outcome, &timings).await {
            return state;
        }
        if error.is_transient() && self.0.stopping.is_cancelled() {
            // Left as it is, the job is planned again at the next start.
            return None;
        }
        let failed = AttemptOutcome::Failed(unstored(&error), Vec::new());
        if let Ok(state) = self.try_to_end(id, &failed, &timings).await {
            return state;
        }
        // The job does not stay `running`, nor does it hold its place until then.
        let app = self.clone();
        tokio::spawn(async move {
            while !app.0.stopping.is_cancelled() {
                app.pause(MAX_STORE_RETRY).await;
                if app.try_to_end(id, &failed, &timings).await.is_ok() {
                    return;
                }
            }
        });
        None
    }

    /// Stores the outcome of an attempt; `None` for a job that was deleted, or whose row was lost: there is nothing to record.
    async fn try_to_end(&self, id: JobId, outcome: &AttemptOutcome, timings: &str) -> Result<Option<JobState>, Error> {
        match self.end_attempt(id, outcome, timings).await {
            Ok(state) => Ok(Some(state)),
            Err(Error::JobNotFound(_)) => Ok(None),
            Err(error) => {
                tracing::error!(error = &error as &dyn std::error::Error, "a job's outcome cannot be recorded");
                Err(error)
            }
        }
    }

    async fn end_attempt(&self, id: JobId, outcome: &AttemptOutcome, timings: &str) -> Result<JobState, Error> {
        let end = || async {
            let ended = self.0.store.end_attempt(id, outcome, timings).await;
            self.0.runner.set_waiting(id, ended.as_ref().is_err_and(Error::is_transient));
            ended
        };
        self.retried("recording the outcome of a job", || false, end).await
    }
}

/// Warning on a job whose planning has ended and whose results or end cannot be stored yet.
pub(super) fn results_wait() -> FieldWarning {
    FieldWarning {
        code: WarningCode::ResultsWait,
        pointer: String::new(),
        detail: "planning has ended, but the results or the end of the job cannot be stored yet: the disk is full, or the store \
                 is temporarily unavailable"
            .into(),
        remedy:
            "free space on the disk of the data folder, or see the server's log for another cause; the job ends as soon as that \
                 is possible"
                .into(),
    }
}

/// Summary of the plan among the files of an attempt.
fn summary_of(artifacts: &[Artifact]) -> Option<Box<Summary>> {
    let file = artifacts.iter().find(|artifact| artifact.name == SUMMARY_FILE)?;
    let summary = parse(&file.bytes);
    summary.inspect_err(|error| tracing::warn!(error = error as &dyn std::error::Error, "a summary cannot be read")).ok()
}

/// Part of `plan.json` that its job tells.
#[derive(Deserialize)]
struct PlanWarnings {
    #[serde(default)]
    warnings: Vec<FieldWarning>,
}

/// Warnings on what an attempt came to, but for those that its job has had since it was submitted.
fn warnings_of(artifacts: &[Artifact]) -> Vec<FieldWarning> {
    let of_plan = warnings_of_plan(artifacts).into_iter().filter(|warning| warning.code.is_of_plan());
    of_plan.chain(left_out_candidates(artifacts, "/params")).collect()
}

/// Warnings of the plan among the files of an attempt.
fn warnings_of_plan(artifacts: &[Artifact]) -> Vec<FieldWarning> {
    let Some(file) = artifacts.iter().find(|artifact| artifact.name == PLAN_FILE) else { return Vec::new() };
    // Not by way of a value: a plan is large, and little of it is kept.
    match serde_json::from_slice::<PlanWarnings>(&file.bytes) {
        Ok(plan) => plan.warnings,
        Err(error) => {
            tracing::warn!(error = &error as &dyn std::error::Error, "the warnings of a plan cannot be read");
            Vec::new()
        }
    }
}

#[cfg(test)]
mod tests;
