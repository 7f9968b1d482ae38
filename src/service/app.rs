//! The one value that everything goes through.

use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use tokio::sync::{Mutex, Semaphore};
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;

use super::error::{Error, Fault};
use super::jobs::{self, Runner};
use super::maintenance::maintain;
use super::options::Options;
use super::run::{self, Planner};
use super::store::{OpenError, Store};
use crate::wire::{JobState, ReadinessCheck};

/// Requests whose cells and meshes are looked up and built at the same time; others wait for them.
const RESOLVING: usize = 4;
/// The store is tried this often.
const PROBE_EVERY: Duration = Duration::from_secs(1);

/// The service. Clones are the same service.
#[derive(Clone)]
pub struct App(pub(super) Arc<Inner>);

pub(super) struct Inner {
    pub(super) store: Store,
    pub(super) options: Options,
    pub(super) runner: Runner,
    /// Meshes that may be parsed at the same time.
    pub(super) parsing: Arc<Semaphore>,
    /// Requests that may be looked up and checked at the same time.
    pub(super) resolving: Arc<Semaphore>,
    /// Uploads that may come in at the same time.
    pub(super) uploads: Arc<Semaphore>,
    /// When the store was last seen to be writable, or not.
    probed: Mutex<Option<(Instant, bool)>>,
    pub(super) stopping: CancellationToken,
    tasks: TaskTracker,
}

impl App {
    /// Opens the store, puts in order what an earlier process left, and begins to work on the queue.
    ///
    /// # Errors
    /// [`OpenError`].
    pub async fn open(options: Options) -> Result<Self, OpenError> {
        Self::open_with(options, Arc::new(run::run)).await
    }

    /// The same, with another planner.
    ///
    /// # Errors
    /// [`OpenError`].
    pub async fn open_with(options: Options, planner: Planner) -> Result<Self, OpenError> {
        let store = Store::open(&options.data_dir).await?;
        let runner = Runner::new(&options, planner)?;
        let parsing = Arc::new(Semaphore::new(std::thread::available_parallelism().map_or(1, Into::into)));
        let (stopping, tasks) = (CancellationToken::new(), TaskTracker::new());
        let (uploads, resolving) = (Arc::new(Semaphore::new(options.max_uploads.max(1))), Arc::new(Semaphore::new(RESOLVING)));
        let inner = Inner { store, options, runner, parsing, resolving, uploads, probed: Mutex::default(), stopping, tasks };
        let app = Self(Arc::new(inner));
        app.recover().await?;
        for _ in 0..app.0.options.concurrent_jobs.max(1) {
            app.0.tasks.spawn(jobs::work(app.clone()));
        }
        app.0.tasks.spawn(maintain(app.clone()));
        Ok(app)
    }

    /// Takes no more work, interrupts what is planned (it starts again with the next process) and waits for it.
    pub async fn stop(&self) {
        self.0.stopping.cancel();
        self.0.runner.interrupt();
        self.0.tasks.close();
        self.0.tasks.wait().await;
    }

    /// Closes the store, so that a copy of its folder is a backup. Nothing can be asked any more.
    pub async fn close(&self) {
        if let Err(error) = self.0.store.close().await {
            tracing::warn!(
                error = &error as &dyn std::error::Error,
                "the database was not closed; its log is read at the next start"
            );
        }
    }

    /// Cancelled once the service stops.
    #[must_use]
    pub fn stopping(&self) -> CancellationToken {
        self.0.stopping.clone()
    }

    /// The limits that the service was opened with.
    #[must_use]
    pub fn options(&self) -> &Options {
        &self.0.options
    }

    /// What must hold to take work, and whether it does.
    pub async fn readiness(&self) -> Vec<ReadinessCheck> {
        let check = |name: &str, ok: bool| ReadinessCheck { name: name.to_owned(), ok };
        vec![
            check("not_stopping", !self.0.stopping.is_cancelled()),
            check("storage", self.is_writable().await),
            check("free_space", self.check_space(0).is_ok()),
            check("planning", self.0.runner.is_alive()),
        ]
    }

    /// Whether the store can be written. Anybody may ask, and it costs a write: so it is tried once a second at most.
    async fn is_writable(&self) -> bool {
        let mut probed = self.0.probed.lock().await;
        if let Some((at, writable)) = *probed
            && at.elapsed() < PROBE_EVERY
        {
            return writable;
        }
        let result = self.0.store.probe().await;
        if let Err(error) = &result {
            tracing::warn!(error = error as &dyn std::error::Error, "the store cannot be written");
        }
        *probed = Some((Instant::now(), result.is_ok()));
        result.is_ok()
    }

    /// How many jobs are in each state that is not an end.
    ///
    /// # Errors
    /// [`Error::Internal`].
    pub async fn open_jobs(&self) -> Result<Vec<(JobState, u64)>, Error> {
        let mut counts = Vec::new();
        for state in [JobState::Queued, JobState::Running, JobState::Cancelling] {
            counts.push((state, self.0.store.count_jobs(state).await?));
        }
        Ok(counts)
    }

    /// Carries a change through to its end also when the one who asked goes away.
    pub(super) async fn to_the_end<T: Send + 'static>(
        &self,
        change: impl Future<Output = Result<T, Error>> + Send + 'static,
    ) -> Result<T, Error> {
        tokio::spawn(change).await.map_err(|error| Error::from(Fault::Task(error.to_string())))?
    }

    /// The folder of the store.
    #[must_use]
    pub fn data_dir(&self) -> &Path {
        &self.0.options.data_dir
    }
}
