//! Runs of programs: accepted like jobs, carried out by a session of `execution` each, followed, steered, recorded. A run that the
//! process did not end itself is `stopped` at the next start, and never resumed by itself.
//!
//! Not safety-rated: a stop here asks the controllers to stop in order; it is not an emergency stop.

mod commands;
mod devices;
mod leases;
mod logs;
mod order;
mod queries;
pub mod session;
mod stream;
mod supervise;

use std::collections::{BTreeSet, HashMap};
use std::io;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio::runtime::{Handle, Runtime};
use tokio::sync::{broadcast, watch};
use tokio_util::sync::CancellationToken;

pub(super) use logs::{LogSizes, log_sizes};
pub use order::{cell_sha256, coverage};
pub use stream::{RunCursor, RunMessage, RunStream};

use self::leases::HeldLeases;
use super::THREAD_STACK_BYTES;
use super::error::Error;
use crate::execution::session::{RunHandle, StopCause};
use crate::wire::RunId;
use crate::wire::run::{RunEventDocument, RunMode};

/// Events that a listener may fall behind before it has to read them from the database.
const FEED_LENGTH: usize = 1024;

/// Runs that have not ended, leases of cells, and the feed of stored events.
pub(super) struct Runs {
    carrier: Carrier,
    leases: HeldLeases,
    /// Held while a run or a lease is accepted, so that a repetition of its request that comes at the same time finds its answer.
    accepting: tokio::sync::Mutex<()>,
    open: Mutex<HashMap<RunId, Arc<OpenRun>>>,
    feed: broadcast::Sender<Arc<RunEventDocument>>,
}

/// A run that has not ended in this process.
pub(super) struct OpenRun {
    cell: String,
    mode: RunMode,
    /// Cancelled once a stop was asked for, which counts before there is a session too.
    stop: CancellationToken,
    /// The session, once the program was checked.
    session: watch::Sender<Option<RunHandle>>,
    /// Operator who armed it.
    armed_by: Mutex<Option<String>>,
    /// Cancelled once all of it is stored, what is evaluated after its end too.
    left: CancellationToken,
}

impl Runs {
    /// An empty set of runs; fencing tokens are above `last_token`.
    pub(super) fn new(last_token: u64) -> io::Result<Self> {
        let (leases, feed) = (HeldLeases::after(last_token), broadcast::Sender::new(FEED_LENGTH));
        Ok(Self { carrier: Carrier::new()?, leases, accepting: tokio::sync::Mutex::default(), open: Mutex::default(), feed })
    }

    /// Adds a run, unless another one holds the controllers of its cell.
    fn enter(&self, id: RunId, cell: &str, mode: RunMode) -> Result<Arc<OpenRun>, Error> {
        let mut open = self.open();
        let is_rival = |other: &OpenRun| mode != RunMode::Simulate && other.mode != RunMode::Simulate && other.cell == cell;
        if let Some((run, other)) = open.iter().find(|(_, other)| is_rival(other)) {
            return Err(Error::CellInUse { cell: cell.to_owned(), run: *run, mode: other.mode });
        }
        let run = Arc::new(OpenRun {
            cell: cell.to_owned(),
            mode,
            stop: CancellationToken::new(),
            session: watch::Sender::new(None),
            armed_by: Mutex::default(),
            left: CancellationToken::new(),
        });
        open.insert(id, Arc::clone(&run));
        Ok(run)
    }

    fn leave(&self, id: RunId) {
        let run = self.open().remove(&id);
        if let Some(run) = run {
            run.left.cancel();
        }
    }

    fn get(&self, id: RunId) -> Option<Arc<OpenRun>> {
        self.open().get(&id).cloned()
    }

    fn publish(&self, event: Arc<RunEventDocument>) {
        // Having no subscriber is not an error.
        let _ = self.feed.send(event);
    }

    fn subscribe(&self) -> broadcast::Receiver<Arc<RunEventDocument>> {
        self.feed.subscribe()
    }

    /// Names of the cells whose leases are held.
    pub(super) fn leased_cells(&self) -> BTreeSet<String> {
        self.leases.current().into_iter().map(|lease| lease.cell).collect()
    }

    /// Stops every session: not by way of the tasks of their runs, which may be waiting for the store.
    pub(super) fn stop_all(&self) {
        let sessions: Vec<RunHandle> = self.open().values().filter_map(|run| run.session()).collect();
        sessions.iter().for_each(|session| session.stop(StopCause::ServerGone));
    }

    /// Runs that move or read controllers under a lease.
    fn under_lease(&self, cell: &str) -> Vec<RunHandle> {
        let open = self.open();
        let live = open.values().filter(|run| run.mode == RunMode::Live && run.cell == cell);
        live.filter_map(|run| run.session.borrow().clone()).collect()
    }

    fn open(&self) -> MutexGuard<'_, HashMap<RunId, Arc<OpenRun>>> {
        // Consistent after every operation, so a poisoned lock is usable.
        self.open.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Threads that carry the sessions, so that nothing that answers requests or plans delays a run.
struct Carrier(Option<Runtime>);

impl Carrier {
    fn new() -> io::Result<Self> {
        let mut builder = tokio::runtime::Builder::new_multi_thread();
        builder.worker_threads(1).thread_name("execution").thread_stack_size(THREAD_STACK_BYTES).enable_all();
        builder.build().map(|runtime| Self(Some(runtime)))
    }

    fn handle(&self) -> Option<&Handle> {
        self.0.as_ref().map(Runtime::handle)
    }
}

impl Drop for Carrier {
    fn drop(&mut self) {
        // Sessions have ended by then, or the process ends: waiting here would block a thread that must not.
        if let Some(runtime) = self.0.take() {
            runtime.shutdown_background();
        }
    }
}

impl OpenRun {
    fn session(&self) -> Option<RunHandle> {
        self.session.borrow().clone()
    }

    fn armed_by(&self) -> Option<String> {
        self.armed_by.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Returns who it was before.
    fn set_armed_by(&self, operator: &str) -> Option<String> {
        self.armed_by.lock().unwrap_or_else(PoisonError::into_inner).replace(operator.to_owned())
    }

    /// Takes an operator back who was refused, unless another has come since.
    fn restore_armed_by(&self, operator: &str, before: Option<String>) {
        let mut armed_by = self.armed_by.lock().unwrap_or_else(PoisonError::into_inner);
        if armed_by.as_deref() == Some(operator) {
            *armed_by = before;
        }
    }
}
