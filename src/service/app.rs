//! The service's entry point: its state, start and stop.

use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use futures_util::future::BoxFuture;
use tokio::sync::{Mutex, Semaphore};
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;

use super::calibrations::Calibrations;
use super::cells::KeptCells;
use super::error::{Error, InternalError};
use super::inspections::Inspections;
use super::jobs::JobRunner;
use super::log_pace::LogPace;
use super::maintenance::maintain;
use super::options::Options;
use super::parse_memory::ParseMemory;
use super::planner::{JobInput, Planner, plan_files};
use super::recovery::Recovery;
use super::runs::Runs;
use super::size::{Sizer, size_of};
use super::store::{OpenError, Store};
use crate::wire::{JobState, ReadinessCheck, ReadinessSubject as Subject};

/// Max requests whose cells and meshes are resolved at the same time; others wait.
const MAX_RESOLVING: usize = 4;
/// Min time between two probes of the store.
const PROBE_INTERVAL: Duration = Duration::from_secs(1);
/// Time between two lines of the log on a reserve that could not be filled.
const UNKEPT_INTERVAL: Duration = Duration::from_secs(60);

/// The service. Clones share one state.
#[derive(Clone)]
pub struct App(pub(super) Arc<Inner>);

pub(super) struct Inner {
    pub(super) store: Store,
    pub(super) options: Options,
    pub(super) runner: JobRunner,
    /// Cells built lately.
    pub(super) cells: Arc<KeptCells>,
    /// Limits the meshes parsed at the same time.
    pub(super) parsing: Arc<Semaphore>,
    /// Memory of the meshes parsed at the same time.
    pub(super) parse_memory: ParseMemory,
    /// Limits the requests resolved at the same time.
    pub(super) resolving: Arc<Semaphore>,
    /// Limits the concurrent uploads.
    pub(super) uploads: Arc<Semaphore>,
    /// Held while the reserve is given up or filled.
    pub(super) reserve: Mutex<()>,
    /// Lines of the log on a reserve that could not be filled.
    pub(super) unkept_reserve: std::sync::Mutex<LogPace>,
    /// State of the recovery.
    pub(super) recovery: Recovery,
    /// Held while a report is drawn.
    pub(super) drawing: Mutex<()>,
    /// Runs that have not ended, and leases.
    pub(super) runs: Runs,
    /// Turn and changes of calibrations.
    pub(super) calibrations: Calibrations,
    /// Turn, progress and changes of inspections.
    pub(super) inspections: Inspections,
    /// Time and result of the last probe of the store.
    probed: Mutex<Option<(Instant, bool)>>,
    pub(super) stopping: CancellationToken,
    pub(super) tasks: TaskTracker,
}

impl App {
    /// Opens the store, recovers the jobs that an earlier process left unfinished, and starts the workers. On a full disk, recovery
    /// waits for room, and only reads, cancellations and deletions are possible until then.
    ///
    /// # Errors
    /// [`OpenError`].
    pub async fn open(options: Options) -> Result<Self, OpenError> {
        // Kept for the next job in the same cell.
        let cells = Arc::new(KeptCells::default());
        let of_planner = Arc::clone(&cells);
        Self::open_keeping(cells, options, Arc::new(move |input, ctx| plan_files(input, &of_planner, ctx)), None).await
    }

    /// Opens the service with another planner, for tests. `sizer` tells the sizes of jobs; those of real plans if there is none.
    ///
    /// # Errors
    /// [`OpenError`].
    pub async fn open_with(options: Options, planner: Planner, sizer: Option<Sizer>) -> Result<Self, OpenError> {
        Self::open_keeping(Arc::default(), options, planner, sizer).await
    }

    async fn open_keeping(
        cells: Arc<KeptCells>,
        options: Options,
        planner: Planner,
        sizer: Option<Sizer>,
    ) -> Result<Self, OpenError> {
        let store = Store::open(&options.data_dir).await?;
        let threads = match options.planning_threads {
            0 => std::thread::available_parallelism().map_or(1, Into::into),
            threads => threads,
        };
        let of_sizer = Arc::clone(&cells);
        let sizer = sizer.unwrap_or_else(|| {
            Arc::new(move |input: &JobInput, stop: &dyn Fn() -> bool| size_of(input, &of_sizer, threads, stop))
        });
        let runner = JobRunner::new(&options, planner, sizer)?;
        let parsing = Arc::new(Semaphore::new(std::thread::available_parallelism().map_or(1, Into::into)));
        let parse_memory = ParseMemory::new(options.parse_memory_bytes);
        let (stopping, tasks) = (CancellationToken::new(), TaskTracker::new());
        let (uploads, resolving) =
            (Arc::new(Semaphore::new(options.max_uploads.max(1))), Arc::new(Semaphore::new(MAX_RESOLVING)));
        let (drawing, probed, reserve) = (Mutex::default(), Mutex::default(), Mutex::default());
        let runs = Runs::new(store.last_fence().await?).map_err(OpenError::Carrier)?;
        let (calibrations, inspections) = (Calibrations::default(), Inspections::default());
        let inner = Inner {
            store,
            options,
            runner,
            cells,
            parsing,
            parse_memory,
            resolving,
            uploads,
            reserve,
            unkept_reserve: std::sync::Mutex::new(LogPace::every(UNKEPT_INTERVAL)),
            recovery: Recovery::default(),
            drawing,
            runs,
            calibrations,
            inspections,
            probed,
            stopping,
            tasks,
        };
        let app = Self(Arc::new(inner));
        app.begin().await?;
        app.spawn(maintain(app.clone()));
        Ok(app)
    }

    /// Stops the service: takes no more work, stops runs, interrupts running jobs (the next process starts them again) and waits for
    /// them.
    pub async fn stop(&self) {
        self.0.stopping.cancel();
        self.0.runs.stop_all();
        self.0.runner.interrupt();
        self.0.tasks.close();
        self.0.tasks.wait().await;
    }

    /// Closes the store, so that a copy of its folder is a backup. The service cannot be used afterwards.
    pub async fn close(&self) {
        if let Err(error) = self.0.store.close().await {
            tracing::warn!(
                error = &error as &dyn std::error::Error,
                "the database was not closed; the next start replays its write-ahead log"
            );
        }
    }

    /// Token that is cancelled when the service stops.
    #[must_use]
    pub fn stopping(&self) -> CancellationToken {
        self.0.stopping.clone()
    }

    /// Options that the service was opened with.
    #[must_use]
    pub fn options(&self) -> &Options {
        &self.0.options
    }

    /// Conditions for taking work; each that does not hold with what is wrong, and what to do.
    pub async fn readiness(&self) -> Vec<(ReadinessCheck, Option<String>)> {
        let check = |name: Subject, fault: Option<String>| (ReadinessCheck { name, ok: fault.is_none() }, fault);
        let unless = |holds: bool, fault: &str| (!holds).then(|| fault.to_owned());
        let stopping = "the server is shutting down; send the request again once it has been restarted";
        let unusable = "the store cannot be read or written; the server's log gives the cause, the data folder and what to check";
        vec![
            check(Subject::NotStopping, unless(!self.0.stopping.is_cancelled(), stopping)),
            check(Subject::Storage, unless(self.is_usable().await, unusable)),
            check(Subject::FreeSpace, self.unrecovered().or_else(|| self.check_space(0).err().map(|error| error.to_string()))),
            check(Subject::Planning, unless(self.0.runner.is_alive(), "no planning thread is left; restart the server")),
        ]
    }

    /// Returns true if the store can be read and written. Any client may ask, and a probe costs a write: so there is at most one per second.
    async fn is_usable(&self) -> bool {
        let mut probed = self.0.probed.lock().await;
        if let Some((at, usable)) = *probed
            && at.elapsed() < PROBE_INTERVAL
        {
            return usable;
        }
        let result = match self.0.store.probe().await {
            // Other connections read than the one that writes.
            Ok(()) => self.0.store.count_jobs(JobState::Queued).await.map(drop),
            Err(error) => Err(error),
        };
        if let Err(error) = &result {
            let (error, folder) = (error as &dyn std::error::Error, self.data_dir().display());
            tracing::warn!(
                error,
                %folder,
                "the store in the data folder cannot be read or written: check that its disk is mounted, has room and no errors, \
                 and that the server may write to the folder"
            );
        }
        *probed = Some((Instant::now(), result.is_ok()));
        result.is_ok()
    }

    /// Number of jobs in each state before the end; `None` where the store cannot be read.
    pub async fn open_jobs(&self) -> Vec<(JobState, Option<u64>)> {
        let mut counts = Vec::new();
        for state in [JobState::Queued, JobState::Running, JobState::Cancelling] {
            counts.push((state, self.0.store.count_jobs(state).await.ok()));
        }
        counts
    }

    /// Starts a task that [`Self::stop`] waits for.
    pub(super) fn spawn(&self, task: impl Future<Output = ()> + Send + 'static) {
        let task: BoxFuture<'static, ()> = Box::pin(task);
        self.0.tasks.spawn(task);
    }

    /// Runs a change to completion, even if the caller goes away.
    pub(super) async fn run_to_completion<T: Send + 'static>(
        &self,
        change: impl Future<Output = Result<T, Error>> + Send + 'static,
    ) -> Result<T, Error> {
        // One type of task for each result: tokio compiles a hundred functions for every one.
        let change: BoxFuture<'static, Result<T, Error>> = Box::pin(change);
        let done = tokio::spawn(change).await.map_err(|error| Error::from(InternalError::Task(error.to_string())))?;
        self.told_full(done).await
    }

    /// Folder of the store.
    #[must_use]
    pub fn data_dir(&self) -> &Path {
        &self.0.options.data_dir
    }
}

#[cfg(test)]
mod tests {
    use sqlx::{Connection as _, SqliteConnection};

    use super::*;
    use crate::service::tests::service;

    #[tokio::test]
    async fn a_store_that_cannot_be_read_is_not_ready_and_its_numbers_are_unknown() {
        let (app, folder) = service().await;
        let is_known = |counts: &[(JobState, Option<u64>)]| counts.iter().any(|(_, count)| count.is_some());
        assert!(is_known(&app.open_jobs().await));
        let database = format!("sqlite://{}", folder.path().join("vantage.db").display());
        let mut other = SqliteConnection::connect(&database).await.expect("a connection");
        sqlx::query("ALTER TABLE job RENAME TO gone").execute(&mut other).await.expect("renamed");
        // What is written by a probe is still there.
        app.0.store.probe().await.expect("written");
        let storage = app.readiness().await.into_iter().find(|(check, _)| check.name == Subject::Storage);
        let (check, fault) = storage.expect("a check");
        assert!(!check.ok && fault.is_some_and(|fault| fault.contains("the server's log")));
        assert!(!is_known(&app.open_jobs().await));
    }
}
