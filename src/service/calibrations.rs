//! Calibrations: accepted like jobs, computed one after another beside them, and kept as they came out. One that an earlier process
//! left is computed anew, from the cell as it was then.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, PoisonError};
use std::time::Duration;

use sha2::{Digest, Sha256};
use tokio::sync::{Mutex, Notify};
use tokio::time::{Instant, timeout_at};

use super::app::App;
use super::cells::BuiltCell;
use super::error::{Error, InternalError};
use super::jobs::{failure, problem_of_error};
use super::library::Library;
use super::store::{CalibrationInput, LeftOver, Page};
use super::submit::{Lookup, Submission};
use crate::cell::calibration::observability::MIN_OBSERVATIONS;
use crate::cell::calibration::watch::{CalibrationStage, CalibrationWatch};
use crate::cell::{CellSpec, FieldError, SpecKind, preset_text};
use crate::planning::context::Context;
use crate::report::calibration::calibration_html;
use crate::wire::calibration::{
    CalibrationDocument, CalibrationError, CalibrationJob, CalibrationPage, CalibrationRequest, CalibrationSelection,
    CalibrationState, FindingDocument,
};
use crate::wire::hex;
use crate::wire::warnings::FieldWarning;
use crate::wire::{CalibrationId, FailureCode, JobProblem, ProblemField};

/// Longest wait for a computation to hear of its cancellation: stages take less.
const CANCEL_WAIT: Duration = Duration::from_secs(5);
/// Max number of calibrations that wait.
const MAX_QUEUED: u64 = 1000;

/// State that calibrations share.
#[derive(Default)]
pub(super) struct Calibrations {
    /// Held while one is computed.
    turn: Mutex<()>,
    /// One of them has changed.
    changed: Notify,
    /// The one that is computed.
    running: std::sync::Mutex<Option<RunningCalibration>>,
}

/// A calibration that is computed.
#[derive(Clone)]
struct RunningCalibration {
    id: CalibrationId,
    watch: Arc<Watch>,
}

/// Surroundings of a computation: cancel flag and stage.
#[derive(Default)]
struct Watch {
    cancel: Arc<AtomicBool>,
    /// Place of the stage in the list of stages, from 1; 0 before the first.
    stage: AtomicUsize,
}

impl CalibrationWatch for Watch {
    fn begins(&self, stage: CalibrationStage) {
        let place = CalibrationStage::ALL.iter().position(|known| *known == stage).unwrap_or_default();
        self.stage.store(place + 1, Ordering::Relaxed);
    }

    fn is_cancelled(&self) -> bool {
        self.cancel.load(Ordering::Relaxed)
    }
}

impl Watch {
    fn stage(&self) -> Option<CalibrationStage> {
        let place = self.stage.load(Ordering::Relaxed).checked_sub(1)?;
        CalibrationStage::ALL.get(place).copied()
    }
}

impl Calibrations {
    /// Watch of a calibration, if it is the one that is computed.
    fn watch_of(&self, id: CalibrationId) -> Option<Arc<Watch>> {
        let running = self.running.lock().unwrap_or_else(PoisonError::into_inner);
        running.as_ref().filter(|running| running.id == id).map(|running| Arc::clone(&running.watch))
    }

    fn set_running(&self, running: Option<RunningCalibration>) {
        *self.running.lock().unwrap_or_else(PoisonError::into_inner) = running;
    }
}

/// Outcome of a computation.
type Computed = Result<CalibrationDocument, CalibrationError>;

impl App {
    /// Accepts a calibration. Its cell is resolved and its observations are read first. If the idempotency key was used for the same
    /// request before, returns the earlier answer.
    ///
    /// # Errors
    /// [`Error::Invalid`], [`Error::IdempotencyMismatch`], [`Error::QueueFull`], [`Error::Draining`], [`Error::TooSlow`],
    /// [`Error::StorageFull`], [`Error::StorageLow`], [`Error::Unrecovered`], [`Error::StorageBusy`], [`Error::Internal`].
    pub async fn submit_calibration(&self, request: CalibrationRequest, submission: Submission) -> Result<CalibrationJob, Error> {
        let idempotency = submission.idempotency(&format!("POST /api/v1/calibrations {}", serde_json::to_string(&request)?));
        if let Some(answer) = self.answered_before(idempotency.as_ref()).await? {
            return Ok(answer);
        }
        let resolve = move |library: &Library| resolved(request, library).map_err(Error::Invalid);
        let (request, cell) = self.with_library(submission.limit, resolve).await?;
        let data = serde_json::to_vec(&request.data)?;
        let job = CalibrationJob {
            id: CalibrationId::generate(),
            state: CalibrationState::Queued,
            cell: cell.name.clone(),
            solve: request.solve,
            hold_out: request.hold_out,
            observations: request.data.observations.len(),
            data_sha256: hex(&Sha256::digest(data)),
            submitted_by: submission.submitted_by,
            created_at: String::new(),
            ended_at: None,
            summary: None,
            point_at_best_focus_sd_mm: None,
            findings: Vec::new(),
            warnings: Vec::new(),
            problem: None,
            stage: None,
        };
        let input = CalibrationInput { cell, data: request.data };
        let app = self.clone();
        self.run_to_completion(async move {
            let accepted = app.0.store.insert_calibration(&job, &input, idempotency.as_ref(), MAX_QUEUED).await?;
            // Else another request with the same key came first.
            if accepted.id == job.id {
                app.spawn(app.clone().carry_out_calibration(job.id));
            }
            Ok(accepted)
        })
        .await
    }

    /// One calibration.
    ///
    /// # Errors
    /// [`Error::CalibrationNotFound`], [`Error::Internal`].
    pub async fn calibration(&self, id: CalibrationId) -> Result<CalibrationJob, Error> {
        let mut job = self.0.store.calibration(id).await?;
        if job.state == CalibrationState::Running {
            job.stage = self.0.calibrations.watch_of(id).and_then(|watch| watch.stage());
        }
        Ok(job)
    }

    /// Waits until a calibration has ended, at most for `wait`; returns it as it is then.
    ///
    /// # Errors
    /// [`Error::CalibrationNotFound`], [`Error::Internal`].
    pub async fn calibration_when_ended(&self, id: CalibrationId, wait: Duration) -> Result<CalibrationJob, Error> {
        let until = Instant::now() + wait;
        loop {
            // Made before the calibration is read, so that no change is missed in between.
            let changed = self.0.calibrations.changed.notified();
            let job = self.calibration(id).await?;
            if job.state.is_ended() {
                return Ok(job);
            }
            tokio::select! {
                () = self.0.stopping.cancelled() => return self.calibration(id).await,
                in_time = timeout_at(until, changed) => if in_time.is_err() {
                    return self.calibration(id).await;
                },
            }
        }
    }

    /// A page of calibrations, newest first.
    ///
    /// # Errors
    /// [`Error::BadPageToken`], [`Error::Internal`].
    pub async fn calibrations(
        &self,
        selection: &CalibrationSelection,
        page_size: u32,
        page_token: Option<&str>,
    ) -> Result<CalibrationPage, Error> {
        let filters = format!("calibrations {}", serde_json::to_string(selection)?);
        self.0.store.calibrations(selection, &Page::new(page_size, page_token, &filters)?).await
    }

    /// Result of a calibration.
    ///
    /// # Errors
    /// [`Error::CalibrationNotFound`], [`Error::NoCalibration`], [`Error::Internal`].
    pub async fn calibration_result(&self, id: CalibrationId) -> Result<CalibrationDocument, Error> {
        let job = self.calibration(id).await?;
        let found = self.0.store.calibration_result(id).await?;
        found.ok_or(Error::NoCalibration { calibration: id, state: job.state })
    }

    /// Report of a calibration, a page.
    ///
    /// # Errors
    /// Errors of [`App::calibration_result`].
    pub async fn calibration_report(&self, id: CalibrationId) -> Result<String, Error> {
        self.calibration_result(id).await.map(|document| calibration_html(&document))
    }

    /// The cell of a calibration with the poses that it found. A preset, which cannot be replaced, gets a name of its own.
    ///
    /// # Errors
    /// Errors of [`App::calibration_result`]; [`Error::NotOnFlange`].
    pub async fn calibrated_cell(&self, id: CalibrationId) -> Result<CellSpec, Error> {
        let document = self.calibration_result(id).await?;
        let input = self.0.store.calibration_input(id).await?;
        let mut cell = document.calibrated(input.cell).ok_or(Error::NotOnFlange(id))?;
        if preset_text(SpecKind::Cell, &cell.name).is_some() {
            cell.name.push_str("-calibrated");
        }
        Ok(cell)
    }

    /// Cancels a calibration that waits or is computed. One that ends before it hears of it stays as it ended.
    ///
    /// # Errors
    /// [`Error::CalibrationNotFound`], [`Error::CalibrationNotQueued`], [`Error::StorageBusy`], [`Error::Internal`].
    pub async fn cancel_calibration(&self, id: CalibrationId) -> Result<CalibrationJob, Error> {
        let app = self.clone();
        // To its end though the caller goes away: what is told as cancelled is stopped, and the reserve is filled again.
        let change = async move {
            let cancel = |job: &mut CalibrationJob| job.state = CalibrationState::Cancelled;
            let job = app.freeing(|| app.change_calibration(id, app.cancelled_at_once(id), cancel, None)).await?;
            let watch = app.0.calibrations.watch_of(id);
            if let Some(watch) = &watch {
                watch.cancel.store(true, Ordering::Relaxed);
            }
            Ok::<_, Error>((job, watch.is_some()))
        };
        let (job, is_computed) = self.run_to_completion(change).await?;
        let job = if is_computed && job.state == CalibrationState::Running {
            self.calibration_when_ended(id, CANCEL_WAIT).await?
        } else {
            job
        };
        match job.state {
            // It hears of it at the next stage.
            CalibrationState::Cancelled | CalibrationState::Running => Ok(job),
            CalibrationState::Queued | CalibrationState::Succeeded | CalibrationState::Failed => {
                Err(Error::CalibrationNotQueued { calibration: id, state: job.state })
            }
        }
    }

    /// States in which a calibration is cancelled by its row alone. One that is called running before all is recovered, and is not
    /// computed, was left so by an earlier process: nobody else would hear of the cancellation, and recovery would begin it again.
    fn cancelled_at_once(&self, id: CalibrationId) -> &'static [CalibrationState] {
        let is_left = self.unrecovered().is_some() && self.0.calibrations.watch_of(id).is_none();
        if is_left { &OPEN } else { &[CalibrationState::Queued] }
    }

    /// Deletes an ended calibration.
    ///
    /// # Errors
    /// [`Error::CalibrationNotFound`], [`Error::CalibrationNotEnded`], [`Error::StorageBusy`], [`Error::Internal`].
    pub async fn delete_calibration(&self, id: CalibrationId) -> Result<(), Error> {
        let app = self.clone();
        self.run_to_completion(async move { app.freeing(|| app.0.store.delete_calibration(id)).await }).await
    }

    /// Begins again what an earlier process left.
    pub(super) async fn recover_calibrations(&self) -> Result<(), Error> {
        let exhausted = self.exhausted();
        for LeftOver { id, attempts } in self.recovering(|| self.0.store.calibrations_left_over()).await? {
            let problem = (attempts >= self.0.options.max_attempts).then(|| exhausted.clone());
            let again = move |job: &mut CalibrationJob| {
                job.state = if problem.is_some() { CalibrationState::Failed } else { CalibrationState::Queued };
                job.problem = problem;
            };
            let change = || self.change_calibration(id, &[CalibrationState::Running], again.clone(), None);
            match self.recovering(change).await {
                Ok(job) if job.state == CalibrationState::Queued => self.spawn(self.clone().carry_out_calibration(id)),
                // Deleted meanwhile: recovery may have waited for room.
                Ok(_) | Err(Error::CalibrationNotFound(_)) => {}
                Err(Error::Internal(InternalError::Row(reason))) => {
                    tracing::error!(calibration = %id, reason, "a stored calibration cannot be read; it counts as failed");
                    self.recovering(|| self.0.store.give_up_calibration(id)).await?;
                }
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }

    async fn change_calibration(
        &self,
        id: CalibrationId,
        from: &'static [CalibrationState],
        change: impl FnOnce(&mut CalibrationJob) + Send + 'static,
        result: Option<CalibrationDocument>,
    ) -> Result<CalibrationJob, Error> {
        let app = self.clone();
        // One type for all changes, so that what follows is compiled once.
        let change: Box<dyn FnOnce(&mut CalibrationJob) + Send> = Box::new(change);
        let changed =
            self.run_to_completion(async move { app.0.store.change_calibration(id, from, change, result.as_ref()).await }).await;
        self.0.calibrations.changed.notify_waiters();
        changed
    }

    /// Changes a calibration that is carried out; tries again while the store is temporarily unavailable.
    async fn advance_calibration(
        &self,
        id: CalibrationId,
        from: &'static [CalibrationState],
        change: impl FnOnce(&mut CalibrationJob) + Clone + Send + 'static,
        result: Option<CalibrationDocument>,
    ) -> Result<CalibrationJob, Error> {
        let change = move || self.change_calibration(id, from, change.clone(), result.clone());
        self.retried("storing the state of a calibration", || false, change).await
    }

    /// Computes a calibration when its turn comes. What the service's stop leaves is computed by the next process.
    async fn carry_out_calibration(self, id: CalibrationId) {
        let _turn = tokio::select! {
            turn = self.0.calibrations.turn.lock() => turn,
            () = self.0.stopping.cancelled() => return,
        };
        let ended = match self.compute_calibration(id).await {
            Err(error) if !error.is_transient() => {
                tracing::error!(calibration = %id, error = &error as &dyn std::error::Error, "a calibration cannot be computed");
                let problem = problem_of_error(&error);
                let fail = move |job: &mut CalibrationJob| (job.state, job.problem) = (CalibrationState::Failed, Some(problem));
                self.advance_calibration(id, &OPEN, fail, None).await.map(drop)
            }
            ended => ended,
        };
        if let Err(error) = ended {
            tracing::error!(calibration = %id, error = &error as &dyn std::error::Error, "the end of a calibration cannot be stored");
        }
    }

    /// Computes a calibration; an error is transient only where the service stops.
    async fn compute_calibration(&self, id: CalibrationId) -> Result<(), Error> {
        // Before its state says so: whoever sees that it runs can cancel it.
        let watch = Arc::new(Watch::default());
        self.0.calibrations.set_running(Some(RunningCalibration { id, watch: Arc::clone(&watch) }));
        let done = self.compute_watched(id, watch).await;
        self.0.calibrations.set_running(None);
        done
    }

    async fn compute_watched(&self, id: CalibrationId, watch: Arc<Watch>) -> Result<(), Error> {
        let run = |job: &mut CalibrationJob| job.state = CalibrationState::Running;
        let job = self.advance_calibration(id, &[CalibrationState::Queued], run, None).await?;
        if job.state != CalibrationState::Running {
            return Ok(());
        }
        let read = || self.0.store.calibration_input(id);
        let input = self.retried("reading the observations of a calibration", || false, read).await?;
        let build = || {
            let spec = input.cell.clone();
            self.with_library(None, move |library| library.built(&spec).map_err(of_cell))
        };
        let cell = self.retried("building the cell of a calibration", || false, build).await?;
        let (how, digest, at) = ((job.solve, usize::from(job.hold_out)), job.data_sha256.clone(), job.created_at.clone());
        let (cancel, spec) = (Arc::clone(&watch.cancel), input.cell.clone());
        let compute = move |_: &Context<'_>| -> Computed {
            let BuiltCell { cell, .. } = &*cell;
            CalibrationDocument::solved_watched(&input.data, cell, how, [&digest, &at], &*watch)
        };
        let (computed, is_interrupted) = self.computed_until_stop(cancel, compute).await;
        if matches!(computed, Ok(Err(CalibrationError::Cancelled))) {
            // What the stop of the service interrupts is computed by the next process; this attempt does not count.
            let state = if is_interrupted { CalibrationState::Queued } else { CalibrationState::Cancelled };
            let end = move |job: &mut CalibrationJob| job.state = state;
            return self.advance_calibration(id, &[CalibrationState::Running], end, None).await.map(drop);
        }
        let ended = ended(computed);
        let result = ended.as_ref().ok().cloned();
        let end = move |job: &mut CalibrationJob| match ended {
            Ok(document) => {
                job.warnings = doubts(&document, &spec);
                (job.state, job.summary) = (CalibrationState::Succeeded, Some(document.summary));
                job.point_at_best_focus_sd_mm = Some(document.point_at_best_focus_sd_mm);
                job.findings = document.findings;
            }
            Err((problem, findings)) => {
                (job.state, job.problem, job.findings) = (CalibrationState::Failed, Some(problem), findings);
            }
        };
        self.advance_calibration(id, &[CalibrationState::Running], end, result).await.map(drop)
    }

    /// Computes, and raises the flag `cancel` once the service stops; true if nobody had raised it before.
    async fn computed_until_stop(
        &self,
        cancel: Arc<AtomicBool>,
        compute: impl FnOnce(&Context<'_>) -> Computed + Send + 'static,
    ) -> (Result<Computed, String>, bool) {
        let computed = self.0.runner.compute(Arc::clone(&cancel), compute);
        tokio::pin!(computed);
        tokio::select! {
            biased;
            () = self.0.stopping.cancelled() => {
                let is_interrupted = !cancel.swap(true, Ordering::Relaxed);
                ((&mut computed).await, is_interrupted)
            }
            computed = &mut computed => (computed, false),
        }
    }
}

/// States before the end.
const OPEN: [CalibrationState; 2] = [CalibrationState::Queued, CalibrationState::Running];

/// Errors at the cell of a calibration: a mesh of its bodies, for one, may have been deleted since it was accepted.
fn of_cell(errors: Vec<FieldError>) -> Error {
    Error::Invalid(errors.into_iter().map(|error| error.below("/cell")).collect())
}

/// The request and its cell with the devices inlined.
fn resolved(request: CalibrationRequest, library: &Library) -> Result<(CalibrationRequest, CellSpec), Vec<FieldError>> {
    let mut errors = request.check().err().unwrap_or_default();
    let (count, held_out) = (request.data.observations.len(), usize::from(request.hold_out));
    if errors.is_empty() && held_out > 0 && count.saturating_sub(held_out) < MIN_OBSERVATIONS {
        let detail = format!("is {held_out} of {count} observations; at least {MIN_OBSERVATIONS} must remain");
        errors.push(FieldError { pointer: "/hold_out".to_owned(), detail });
    }
    let mut lookup = Lookup::new(library, &mut errors);
    let spec = lookup.cell(&request.cell);
    if spec.is_none() && lookup.errors().is_empty() {
        lookup.refuse("/cell", "is \"none\"; a calibration needs the cell that was observed".to_owned());
    }
    if let Some(built) = lookup.built_cell.take()
        && let Err(found) = request.data.task(&built.cell, request.solve, usize::from(request.hold_out))
    {
        errors.extend(found.into_iter().map(|error| error.below("/data")));
    }
    match spec {
        Some(spec) if errors.is_empty() => Ok((request, spec)),
        _ => Err(errors),
    }
}

/// Doubts about a result far from the cell that was observed, with pointers into the request.
fn doubts(document: &CalibrationDocument, spec: &CellSpec) -> Vec<FieldWarning> {
    let below = |warning: FieldWarning| FieldWarning { pointer: format!("/cell{}", warning.pointer), ..warning };
    document.far_from(spec).into_iter().map(below).collect()
}

/// Result of a computation, or the problem that it ended with.
fn ended(computed: Result<Computed, String>) -> Result<CalibrationDocument, (JobProblem, Vec<FindingDocument>)> {
    match computed {
        Ok(Ok(document)) => Ok(document),
        Ok(Err(CalibrationError::Fields(errors))) => {
            let detail = "the observations cannot be read".to_owned();
            let errors = errors.into_iter().map(|error| ProblemField::from(error.below("/data"))).collect();
            Err((failure(FailureCode::JobInputInvalid, detail, errors), Vec::new()))
        }
        Ok(Err(CalibrationError::Cancelled)) => {
            Err((failure(FailureCode::NoCalibrationPossible, "it was cancelled".to_owned(), Vec::new()), Vec::new()))
        }
        Ok(Err(CalibrationError::Findings(findings))) => {
            let findings: Vec<FindingDocument> = findings.iter().map(FindingDocument::from).collect();
            let detail = findings.iter().map(|finding| finding.detail.clone()).collect::<Vec<_>>().join("; ");
            Err((failure(FailureCode::NoCalibrationPossible, detail, Vec::new()), findings))
        }
        Err(panic) => Err((failure(FailureCode::JobPanicked, format!("internal error: {panic}"), Vec::new()), Vec::new())),
    }
}

#[cfg(test)]
mod tests;
