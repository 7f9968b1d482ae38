//! The planning pool, and its running jobs. A pool has one task at a time: a worker that waits for a part of its task takes up whatever
//! else is in its pool, and would come back to the first task only at the end of the other.

use std::collections::{HashMap, HashSet};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use tokio::sync::{Notify, oneshot};

use super::super::kept::Kept;
use super::super::options::Options;
use super::super::planner::{Artifact, JobError, JobInput, Planner};
use super::super::schedule::{Schedule, Share};
use super::super::size::{JobSize, Sizer};
use super::failure::{AttemptError, panic_text};
use super::tracker::Tracker;
use crate::planning::Allowance;
use crate::planning::context::{Context, Silent};
use crate::wire::JobId;

/// Sizes of jobs that are kept: by the job, and by what it is planned with, for others like it.
const SIZES_KEPT: usize = 512;

/// The planning pool and its running jobs.
pub(in crate::service) struct JobRunner {
    pool: rayon::ThreadPool,
    planner: Planner,
    pub(super) sizer: Sizer,
    pub(super) sizes: Kept<JobSize>,
    schedule: Mutex<Schedule>,
    running: Mutex<HashMap<JobId, Arc<AtomicBool>>>,
    /// Jobs whose planning has ended and whose results or end cannot be stored yet.
    waiting: Mutex<HashSet<JobId>>,
    /// Something may start: a job was queued or has ended.
    pub(super) woken: Notify,
    /// Max memory of a job, and of all that run together.
    memory_bytes: u64,
    /// Max planning time of a job.
    limit: Option<Duration>,
}

impl JobRunner {
    pub(in crate::service) fn new(
        options: &Options,
        planner: Planner,
        sizer: Sizer,
    ) -> Result<Self, rayon::ThreadPoolBuildError> {
        let pool = planning_threads(options.planning_threads)?;
        let (memory_bytes, limit) = (options.job_memory_bytes, options.job_limit);
        let job_secs = limit.map_or(f64::INFINITY, |limit| limit.as_secs_f64());
        let threads = pool.current_num_threads();
        let schedule = Mutex::new(Schedule::new(threads, options.concurrent_jobs, memory_bytes as f64, job_secs));
        let (sizes, running, waiting, woken) = (Kept::new(SIZES_KEPT), Mutex::default(), Mutex::default(), Notify::new());
        Ok(Self { pool, planner, sizer, sizes, schedule, running, waiting, woken, memory_bytes, limit })
    }

    /// Wakes the dispatcher: there is a job in the queue, or room for one.
    pub(in crate::service) fn wake(&self) {
        self.woken.notify_one();
    }

    /// Raises the cancel flag of a running job.
    pub(in crate::service) fn cancel(&self, id: JobId) {
        if let Some(flag) = self.lock().get(&id) {
            flag.store(true, Ordering::Relaxed);
        }
    }

    /// Raises every cancel flag.
    pub(in crate::service) fn interrupt(&self) {
        self.lock().values().for_each(|flag| flag.store(true, Ordering::Relaxed));
    }

    /// Notes whether the results or the end of a job wait for the store.
    pub(super) fn set_waiting(&self, id: JobId, is_waiting: bool) {
        // Whole after every operation, so a poisoned lock is usable.
        let mut waiting = self.waiting.lock().unwrap_or_else(PoisonError::into_inner);
        if is_waiting {
            waiting.insert(id);
        } else {
            waiting.remove(&id);
        }
    }

    /// Returns true if the results or the end of a job wait for the store.
    pub(in crate::service) fn is_waiting(&self, id: JobId) -> bool {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner).contains(&id)
    }

    /// Returns true if the pool has threads.
    pub(in crate::service) fn is_alive(&self) -> bool {
        self.pool.current_num_threads() > 0
    }

    pub(super) fn lock(&self) -> std::sync::MutexGuard<'_, HashMap<JobId, Arc<AtomicBool>>> {
        // The map is consistent after every operation, so a poisoned lock is usable.
        self.running.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn schedule(&self) -> std::sync::MutexGuard<'_, Schedule> {
        // Consistent after every operation, so a poisoned lock is usable.
        self.schedule.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A pool for one task beside the jobs, with as many threads as the planning pool; `None` where the machine has no threads left.
    fn own_pool(&self) -> Option<rayon::ThreadPool> {
        let pool = planning_threads(self.pool.current_num_threads());
        pool.inspect_err(|error| tracing::warn!(%error, "no threads can be started; the task is left to the planning pool")).ok()
    }

    /// Runs `work` on threads of its own, and waits for it.
    pub(in crate::service) fn install<T: Send>(&self, work: impl FnOnce() -> T + Send) -> T {
        self.own_pool().as_ref().unwrap_or(&self.pool).install(work)
    }

    /// Runs `work` on threads of its own; an error if it panics.
    pub(in crate::service) async fn compute<T: Send + 'static>(
        &self,
        cancel: Arc<AtomicBool>,
        work: impl FnOnce(&Context<'_>) -> T + Send + 'static,
    ) -> Result<T, String> {
        let (sender, receiver) = oneshot::channel();
        let own = self.own_pool();
        own.as_ref().unwrap_or(&self.pool).spawn(move || {
            // Unwind safe: nothing that the closure uses is used again after a panic.
            let result = catch_unwind(AssertUnwindSafe(|| work(&Context::new(&cancel, &Silent))));
            // The receiver is gone when the process stops.
            let _ = sender.send(result);
        });
        match receiver.await {
            Ok(result) => result.map_err(|panic| panic_text(&*panic)),
            Err(_) => Err("the planning thread ended".to_owned()),
        }
    }

    /// Memory and core time allowed for a job, all threads of the pool together.
    pub(in crate::service) fn allowance(&self) -> Allowance {
        let core_secs = self.limit.map_or(f64::INFINITY, |limit| limit.as_secs_f64() * self.pool.current_num_threads() as f64);
        Allowance { bytes: self.memory_bytes as f64, core_secs }
    }

    /// Plans on its share of the threads, within the time limit.
    pub(super) async fn plan(
        &self,
        input: JobInput,
        share: Share,
        cancel: Arc<AtomicBool>,
        observer: Arc<Tracker>,
    ) -> Result<Vec<Artifact>, AttemptError> {
        let planning = self.begin(input, share, Arc::clone(&cancel), observer);
        tokio::pin!(planning);
        let Some(limit) = self.limit else { return planning.await };
        if let Ok(result) = tokio::time::timeout(limit, &mut planning).await {
            return result;
        }
        let was_cancelled = cancel.swap(true, Ordering::Relaxed);
        match planning.await {
            Err(AttemptError::Job(JobError::Cancelled)) if !was_cancelled => Err(AttemptError::TimedOut(limit)),
            result => result,
        }
    }

    async fn begin(
        &self,
        input: JobInput,
        share: Share,
        cancel: Arc<AtomicBool>,
        observer: Arc<Tracker>,
    ) -> Result<Vec<Artifact>, AttemptError> {
        let own = match share {
            Share::Pool => None,
            Share::Own(threads) => Some(planning_threads(threads).map_err(|error| {
                AttemptError::Job(JobError::Unavailable(format!("no thread can be started for the job: {error}")))
            })?),
        };
        let (sender, receiver) = oneshot::channel();
        let (planner, allowance) = (self.planner.clone(), self.allowance());
        own.as_ref().unwrap_or(&self.pool).spawn(move || {
            let context = Context::new(&cancel, &*observer).with_allowance(allowance);
            // Unwind safe: nothing that the closure uses is used again after a panic.
            let result = catch_unwind(AssertUnwindSafe(|| planner(&input, &context)));
            drop(observer);
            // The receiver is gone when the process stops.
            let _ = sender.send(result);
        });
        match receiver.await {
            Ok(Ok(result)) => result.map_err(AttemptError::Job),
            Ok(Err(panic)) => Err(AttemptError::Panicked(panic_text(&*panic))),
            Err(_) => Err(AttemptError::Panicked("the planning thread ended".to_owned())),
        }
    }
}

/// A pool of threads that plan; 0 for one per core.
fn planning_threads(threads: usize) -> Result<rayon::ThreadPool, rayon::ThreadPoolBuildError> {
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .thread_name(|index| format!("planning-{index}"))
        .start_handler(|_| lower_priority())
        .build()
}

/// Lowers the priority of this thread (Linux has one per thread), so that the threads that answer requests go first.
fn lower_priority() {
    const NICE: i32 = 10;
    if let Err(error) = rustix::process::setpriority_process(Some(rustix::thread::gettid()), NICE) {
        tracing::debug!(%error, "the priority of a planning thread cannot be lowered");
    }
}

#[cfg(test)]
mod tests;
