//! Queries on runs, their start and their deletion.

use std::collections::BTreeMap;
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use tokio::sync::broadcast::error::RecvError;
use tokio::time::{Instant, timeout_at};

use super::logs::end_of_log;
use super::supervise::{DoneSteps, Supervisor};
use crate::service::app::App;
use crate::service::error::{Error, InternalError};
use crate::service::store::{Page, blocking};
use crate::service::submit::Submission;
use crate::wire::RunId;
use crate::wire::run::{
    RUN_RECORD_SCHEMA, ReportedState, Run, RunAudit, RunMode, RunPage, RunRecordDocument, RunRequest, RunSelection,
};

/// Words of a run that an earlier process left open.
const LEFT_OPEN: &str = "the server was restarted while the run was under way; arm and table may still move: see that they stand \
                         before anybody goes near them. Then start a new run from the step that was reached, once they are where \
                         that step begins";

impl App {
    /// Accepts a run and begins it.
    ///
    /// # Errors
    /// Errors of [`App::submit_run`].
    pub async fn start_run(&self, request: RunRequest, token: Option<u64>, submitted_by: Option<String>) -> Result<Run, Error> {
        self.submit_run(request, token, Submission { submitted_by, ..Submission::default() }).await
    }

    /// Accepts a run and begins it. If the idempotency key was used for the same request before, returns the earlier answer and begins
    /// nothing.
    ///
    /// # Errors
    /// [`Error::Invalid`], [`Error::IdempotencyMismatch`], [`Error::JobNotFound`], [`Error::NoResults`], [`Error::NoProgram`],
    /// [`Error::LiveDisabled`], [`Error::NoControllers`], [`Error::OtherCell`], [`Error::CellInUse`], [`Error::LeaseRequired`],
    /// [`Error::TokenRefused`], [`Error::TooManyRuns`], [`Error::StorageLow`], [`Error::Draining`], [`Error::StorageBusy`],
    /// [`Error::Unrecovered`], [`Error::Internal`].
    pub async fn submit_run(&self, request: RunRequest, token: Option<u64>, submission: Submission) -> Result<Run, Error> {
        // The token is the right to ask, no part of what is asked for: a repetition may come under a newer lease.
        let idempotency = submission.idempotency(&format!("POST /api/v1/runs {}", serde_json::to_string(&request)?));
        // Refused on a disk that is nearly full: its record and its audit log need room; without it, it would stop on its way.
        if let Some(answer) = self.answered_before(idempotency.as_ref()).await? {
            return Ok(answer);
        }
        let submitted_by = submission.submitted_by;
        let order = self.run_order(request, token).await?;
        let (request, job) = (&order.request, Some(order.request.job_id));
        let run = Run::new(request, job, &order.cell.name, &order.program, &order.program_sha256);
        let run = Run { submitted_by, ..run };
        let app = self.clone();
        self.run_to_completion(async move {
            let _turn = app.0.runs.accepting.lock().await;
            // A request with the same key may have come first: its run, not a cell in use.
            if let Some(answer) = app.answered_before(idempotency.as_ref()).await? {
                return Ok(answer);
            }
            let open = app.0.runs.enter(run.id, &run.cell, run.mode)?;
            // From here on the entry is given back by the supervisor, whatever comes.
            let mut supervisor = Supervisor { app: app.clone(), run, open, stored: DoneSteps::default() };
            let max_runs = app.0.options.execution.max_runs;
            let (run, event) = app.0.store.insert_run(&supervisor.run, idempotency.as_ref(), max_runs).await?;
            supervisor.run = run.clone();
            app.0.runs.publish(event);
            app.spawn(supervisor.carry_out(order));
            Ok(run)
        })
        .await
    }

    /// One run.
    ///
    /// # Errors
    /// [`Error::RunNotFound`], [`Error::Internal`].
    pub async fn run(&self, id: RunId) -> Result<Run, Error> {
        self.0.store.run(id).await
    }

    /// A page of runs, newest first.
    ///
    /// # Errors
    /// [`Error::BadPageToken`], [`Error::Internal`].
    pub async fn runs(&self, selection: &RunSelection, page_size: u32, page_token: Option<&str>) -> Result<RunPage, Error> {
        let filters = format!("runs {}", serde_json::to_string(selection)?);
        self.0.store.runs(selection, &Page::new(page_size, page_token, &filters)?).await
    }

    /// Waits until a run has ended and its coverage is stored, at most for `wait`; returns it as it is then.
    ///
    /// # Errors
    /// [`Error::RunNotFound`], [`Error::Internal`].
    pub async fn run_when_ended(&self, id: RunId, wait: Duration) -> Result<Run, Error> {
        let until = Instant::now() + wait;
        // Looked up before the run is read: without it, all of the run was stored by then.
        let open = self.0.runs.get(id);
        let run = self.run_when(id, wait, |run| run.state.is_ended()).await?;
        let Some(open) = open.filter(|_| run.state.is_ended()) else { return Ok(run) };
        tokio::select! {
            () = self.0.stopping.cancelled() => {}
            // In time or not, it is read as it is.
            _ = timeout_at(until, open.left.cancelled()) => {}
        }
        self.run(id).await
    }

    /// Waits until a run can be armed, or has ended, at most for `wait`; returns it as it is then.
    ///
    /// # Errors
    /// [`Error::RunNotFound`], [`Error::Internal`].
    pub async fn run_when_prepared(&self, id: RunId, wait: Duration) -> Result<Run, Error> {
        self.run_when(id, wait, |run| run.state != ReportedState::Preparing).await
    }

    /// Waits until a run is as wanted or has ended, at most for `wait`; returns it as it is then.
    pub(super) async fn run_when(&self, id: RunId, wait: Duration, is_wanted: impl Fn(&Run) -> bool) -> Result<Run, Error> {
        let until = Instant::now() + wait;
        // Subscribed before the run is read, so that no change is missed in between.
        let mut events = self.0.runs.subscribe();
        loop {
            let run = self.run(id).await?;
            if is_wanted(&run) || run.state.is_ended() {
                return Ok(run);
            }
            let next = async {
                loop {
                    match events.recv().await {
                        Ok(event) if event.run_id != id => {}
                        Ok(_) | Err(RecvError::Lagged(_)) => return true,
                        Err(RecvError::Closed) => return false,
                    }
                }
            };
            tokio::select! {
                () = self.0.stopping.cancelled() => return self.run(id).await,
                changed = timeout_at(until, next) => if !matches!(changed, Ok(true)) {
                    return self.run(id).await;
                },
            }
        }
    }

    /// Record of a run, as far as it has come.
    ///
    /// # Errors
    /// [`Error::RunNotFound`], [`Error::Internal`].
    pub async fn run_record(&self, id: RunId) -> Result<RunRecordDocument, Error> {
        let run = self.run(id).await?;
        let steps = self.0.store.run_steps(id).await?;
        Ok(RunRecordDocument { schema: RUN_RECORD_SCHEMA.to_owned(), run, steps })
    }

    /// Audit log of a run: its files, oldest first. Empty for a simulated run, which exchanges nothing with controllers; `None` for
    /// another one whose log is not there.
    ///
    /// # Errors
    /// [`Error::RunNotFound`], [`Error::StorageBusy`], [`Error::Internal`].
    pub async fn run_audit(&self, id: RunId) -> Result<Option<Box<dyn Read + Send>>, Error> {
        let is_simulated = self.run(id).await?.mode == RunMode::Simulate;
        let folder = self.audit_folder(id);
        blocking(move || {
            let files = audit_files(&folder)?;
            if files.is_empty() && !is_simulated {
                return Ok(None);
            }
            let mut log: Box<dyn Read + Send> = Box::new(io::empty());
            for path in files {
                log = Box::new(log.chain(std::fs::File::open(path)?));
            }
            Ok(Some(log))
        })
        .await
    }

    /// Deletes an ended run, its record and its audit log. Where the log cannot be removed, the same request removes it later.
    ///
    /// # Errors
    /// [`Error::RunNotFound`], [`Error::RunNotEnded`], [`Error::JobHeld`], [`Error::LogLeft`], [`Error::StorageBusy`],
    /// [`Error::Internal`].
    pub async fn delete_run(&self, id: RunId) -> Result<(), Error> {
        let app = self.clone();
        self.run_to_completion(async move {
            if let Err(error) = app.delete_run_row(id, false).await {
                let was_deleted = matches!(&error, Error::RunNotFound(missing) if missing.deletion.is_some());
                if !was_deleted || !app.may_have_log(id).await? {
                    return Err(error);
                }
            }
            app.remove_log(id).await
        })
        .await
    }

    /// Deletes an ended run of a job that is not held, and its record; by retention, not that of a job in use either.
    pub(in crate::service) async fn delete_run_row(&self, id: RunId, by_retention: bool) -> Result<(), Error> {
        let hold = &self.0.options.retention.hold_label;
        if let Some(event) = self.freeing(|| self.0.store.delete_run(id, hold, by_retention)).await? {
            self.0.runs.publish(event);
        }
        Ok(())
    }

    /// Removes the audit log of a deleted run.
    ///
    /// # Errors
    /// [`Error::LogLeft`].
    pub(in crate::service) async fn remove_log(&self, id: RunId) -> Result<(), Error> {
        let folder = self.audit_folder(id);
        let left = move |error| Error::LogLeft { run: id, cause: InternalError::File(Arc::new(error)) };
        blocking(move || remove_folder(&folder).map_err(left)).await
    }

    /// Returns true unless the folder of the run's audit log is known not to be there.
    async fn may_have_log(&self, id: RunId) -> Result<bool, Error> {
        let folder = self.audit_folder(id);
        let is_gone = move || std::fs::symlink_metadata(&folder).is_err_and(|error| error.kind() == io::ErrorKind::NotFound);
        blocking(move || Ok(!is_gone())).await
    }

    /// Removes audit logs that were left when their runs were deleted: the process ended in between, or the folder could not be removed.
    /// Only the event of its deletion tells that a run was of this store; logs of others, of the command line or of another server with
    /// the same folder, are left alone.
    pub(in crate::service) async fn finish_deletions(&self) -> Result<(), Error> {
        let deleted = self.0.store.deleted_runs().await?;
        let folders: Vec<(RunId, PathBuf)> = deleted.into_iter().map(|run| (run, self.audit_folder(run))).collect();
        blocking(move || {
            for (run, folder) in folders.into_iter().filter(|(_, folder)| folder.is_dir()) {
                match remove_folder(&folder) {
                    Ok(()) => tracing::info!(%run, "the audit log of a deleted run, which was left, is removed"),
                    Err(error) => {
                        let error = &error as &dyn std::error::Error;
                        tracing::warn!(%run, error, "the audit log of a deleted run cannot be removed; the next round tries again");
                    }
                }
            }
            Ok(())
        })
        .await
    }

    /// Stops the runs that an earlier process left open, each with the end of its audit log.
    pub(in crate::service) async fn recover_runs(&self) -> Result<(), Error> {
        let ends = self.ends_of_logs(self.0.store.open_run_ids().await?).await;
        let events = self.recovering(|| self.0.store.stop_open_runs(LEFT_OPEN, &ends)).await?;
        if !events.is_empty() {
            tracing::warn!(runs = events.len(), "an earlier process ended while runs were under way; they are stopped");
        }
        // On a full disk, the service is there already, and clients listen.
        events.into_iter().for_each(|event| self.0.runs.publish(event));
        Ok(())
    }

    /// Ends of the audit logs of runs that an earlier process left open. A log that cannot be read keeps no server from starting.
    async fn ends_of_logs(&self, runs: Vec<RunId>) -> BTreeMap<RunId, RunAudit> {
        let folders: Vec<(RunId, PathBuf)> = runs.into_iter().map(|run| (run, self.audit_folder(run))).collect();
        let read = move || {
            let mut ends = BTreeMap::new();
            for (run, folder) in folders {
                match end_of_log(&folder) {
                    Ok(Some(end)) => drop(ends.insert(run, RunAudit::from(end))),
                    Ok(None) => {}
                    Err(error) => {
                        let error = &error as &dyn std::error::Error;
                        tracing::warn!(%run, error, "the audit log of a run cannot be read; its end is not kept with the run");
                    }
                }
            }
            Ok(ends)
        };
        blocking(read).await.unwrap_or_default()
    }

    /// Number of runs in each state before the end; `None` where the store cannot be read.
    pub async fn open_runs(&self) -> Vec<(ReportedState, Option<u64>)> {
        let mut counts = Vec::new();
        for state in ReportedState::ALL.into_iter().filter(|state| !state.is_ended()) {
            counts.push((state, self.0.store.count_runs(state).await.ok()));
        }
        counts
    }

    fn audit_folder(&self, id: RunId) -> PathBuf {
        self.0.options.execution.audit_dir.join(id.to_string())
    }

    /// Mode of a run that has not ended in this process; for one that has, the error.
    pub(super) async fn ended_or_unknown(&self, id: RunId, deed: &'static str) -> Error {
        match self.run(id).await {
            Ok(run) => Error::RunStateRefused { run: id, state: run.state, deed },
            Err(error) => error,
        }
    }
}

/// Removes a folder with everything in it, if it is there.
fn remove_folder(folder: &Path) -> io::Result<()> {
    match std::fs::remove_dir_all(folder) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
        Ok(()) | Err(_) => Ok(()),
    }
}

/// Files of an audit log, by name: the order in which they were written.
fn audit_files(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let entries = match std::fs::read_dir(folder) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        entries => entries?,
    };
    let mut paths = entries.map(|entry| entry.map(|entry| entry.path())).collect::<io::Result<Vec<_>>>()?;
    paths.retain(|path| path.is_file());
    paths.sort();
    Ok(paths)
}
