//! The dispatcher takes jobs from the queue as `schedule.rs` lets it, and each is planned in a task of its own: on the planning pool, or
//! on threads that it has to itself. Each attempt has its own cancel flag, and a panic ends only its attempt. Stage times are measured
//! here, since planning reads no clock.

use std::any::Any;
use std::collections::{BTreeMap, HashMap};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use sha2::{Digest, Sha256};
use tokio::sync::{Notify, mpsc, oneshot};

use super::app::App;
use super::error::Error;
use super::execute::{Artifact, JobError, JobInput, Planner};
use super::failpoint;
use super::kept::Kept;
use super::options::Options;
use super::progress::{Course, Overall};
use super::schedule::{Ahead, Schedule, Share};
use super::size::{JobSize, Sizer};
use super::store::{Attempt, AttemptOutcome, blocking, hex};
use super::submit::job_input;
use crate::planning::Allowance;
use crate::planning::context::{Context, Observer, Silent, Stage};
use crate::wire::summary::{SUMMARY_FILE, Summary};
use crate::wire::{JobId, JobProblem, JobState, ProblemField, problem_type};

/// Min time between two progress updates within a stage; the beginning of a stage is always reported.
const PROGRESS_INTERVAL: Duration = Duration::from_millis(500);
/// First pause after the store failed; each further one is twice as long, up to [`MAX_STORE_RETRY`].
const STORE_RETRY: Duration = Duration::from_secs(1);
/// Max pause after the store failed.
const MAX_STORE_RETRY: Duration = Duration::from_secs(10);
/// Jobs of the queue that are looked at for one that may start.
const LOOKED_AT: u32 = 64;
/// Sizes of jobs that are kept: by the job, and by what it is planned with, for others like it.
const SIZES_KEPT: usize = 512;

/// Problem codes of failed jobs, with their titles.
pub const FAILURE_CODES: [(&str, &str); 9] = [
    ("job_input_invalid", "This input cannot be planned"),
    ("job_too_long", "Planning took too long"),
    ("no_plan", "No plan is possible"),
    ("no_calibration_possible", "The observations do not give a calibration"),
    ("job_panicked", "Planning crashed"),
    ("job_attempts_exhausted", "The server crashed in every attempt at this job"),
    ("job_unreadable", "The stored job cannot be read by this version"),
    ("file_damaged", "A stored file is damaged"),
    ("internal", "The server is at fault"),
];

/// The planning pool and its running jobs.
pub(super) struct JobRunner {
    pool: rayon::ThreadPool,
    planner: Planner,
    sizer: Sizer,
    sizes: Kept<JobSize>,
    schedule: Mutex<Schedule>,
    running: Mutex<HashMap<JobId, Arc<AtomicBool>>>,
    /// Something may start: a job was queued or has ended.
    woken: Notify,
    /// Max memory of a job, and of all that run together.
    memory_bytes: u64,
    /// Max planning time of a job.
    limit: Option<Duration>,
}

impl JobRunner {
    pub(super) fn new(options: &Options, planner: Planner, sizer: Sizer) -> Result<Self, rayon::ThreadPoolBuildError> {
        let pool = planning_threads(options.planning_threads)?;
        let (memory_bytes, limit) = (options.job_memory_bytes, options.job_limit);
        let job_secs = limit.map_or(f64::INFINITY, |limit| limit.as_secs_f64());
        let threads = pool.current_num_threads();
        let schedule = Mutex::new(Schedule::new(threads, options.concurrent_jobs, memory_bytes as f64, job_secs));
        let (sizes, running, woken) = (Kept::new(SIZES_KEPT), Mutex::default(), Notify::new());
        Ok(Self { pool, planner, sizer, sizes, schedule, running, woken, memory_bytes, limit })
    }

    /// Wakes the dispatcher: there is a job in the queue, or room for one.
    pub(super) fn wake(&self) {
        self.woken.notify_one();
    }

    /// Raises the cancel flag of a running job.
    pub(super) fn cancel(&self, id: JobId) {
        if let Some(flag) = self.lock().get(&id) {
            flag.store(true, Ordering::Relaxed);
        }
    }

    /// Raises every cancel flag.
    pub(super) fn interrupt(&self) {
        self.lock().values().for_each(|flag| flag.store(true, Ordering::Relaxed));
    }

    /// True if the pool has threads.
    pub(super) fn is_alive(&self) -> bool {
        self.pool.current_num_threads() > 0
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, HashMap<JobId, Arc<AtomicBool>>> {
        // The map is consistent after every operation, so a poisoned lock is usable.
        self.running.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn schedule(&self) -> std::sync::MutexGuard<'_, Schedule> {
        // Consistent after every operation, so a poisoned lock is usable.
        self.schedule.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Runs `work` on the planning pool, and waits for it.
    pub(super) fn install<T: Send>(&self, work: impl FnOnce() -> T + Send) -> T {
        self.pool.install(work)
    }

    /// Runs `work` on a thread of the planning pool; an error if it panics.
    pub(super) async fn compute<T: Send + 'static>(
        &self,
        cancel: Arc<AtomicBool>,
        work: impl FnOnce(&Context<'_>) -> T + Send + 'static,
    ) -> Result<T, String> {
        let (sender, receiver) = oneshot::channel();
        self.pool.spawn(move || {
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
    pub(super) fn allowance(&self) -> Allowance {
        let core_secs = self.limit.map_or(f64::INFINITY, |limit| limit.as_secs_f64() * self.pool.current_num_threads() as f64);
        Allowance { bytes: self.memory_bytes as f64, core_secs }
    }

    /// Plans on its share of the threads, within the time limit.
    async fn plan(
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

/// Result of an attempt.
enum Attempted {
    /// Files to store, and the problem that they tell of where the job fails.
    Files(Vec<Artifact>, Option<JobProblem>),
    /// An outcome without files.
    Ended(AttemptOutcome),
}

/// Reasons why an attempt ended without result files.
enum AttemptError {
    Job(JobError),
    Panicked(String),
    /// The time limit.
    TimedOut(Duration),
}

fn panic_text(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().map(|text| (*text).to_owned());
    text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_else(|| "without a message".to_owned())
}

/// Starts jobs of the queue until the service stops.
pub(super) async fn dispatch(app: App) {
    let stopping = app.stopping();
    let mut pause = STORE_RETRY;
    while !stopping.is_cancelled() {
        match app.start_next().await {
            Ok(true) => {}
            Ok(false) => tokio::select! {
                () = stopping.cancelled() => {}
                () = app.0.runner.woken.notified() => {}
            },
            Err(error) => {
                tracing::error!(error = &error as &dyn std::error::Error, "the queue cannot be read");
                app.pause(pause).await;
                pause = (pause * 2).min(MAX_STORE_RETRY);
                continue;
            }
        }
        pause = STORE_RETRY;
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
        let attempts = self.0.options.max_attempts;
        let detail =
            format!("the process died in each of {attempts} attempts; the job may need more memory than the machine has");
        let found = self.0.store.recover(attempts, &failure("job_attempts_exhausted", detail, Vec::new())).await?;
        if found > 0 {
            tracing::warn!(jobs = found, "an earlier process died while jobs were running; they are recovered");
        }
        Ok(())
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
                // Something may have ended meanwhile: from the beginning.
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
            self.0.tasks.spawn(async move {
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
        metrics::counter!("vantage_attempts_total", "state" => state.map_or("unknown", JobState::as_str)).increment(1);
        metrics::histogram!("vantage_attempt_seconds").record(seconds);
        tracing::info!(state = state.map(JobState::as_str), seconds, "attempt ended");
    }

    /// Plans a job and persists its progress. Returns also the stage times.
    async fn plan(&self, attempt: &Attempt, share: Share, cancel: Arc<AtomicBool>) -> (Attempted, BTreeMap<String, f64>) {
        let input = match job_input(attempt, self.0.store.files(), self.0.options.max_triangles) {
            Ok(input) => input,
            Err(error) => {
                tracing::error!(error = &error as &dyn std::error::Error, "a stored job cannot be read; it fails");
                let problem = failure("job_unreadable", error.to_string(), Vec::new());
                return (Attempted::Ended(AttemptOutcome::Failed(problem, Vec::new())), BTreeMap::new());
            }
        };
        let (sender, updates) = mpsc::unbounded_channel();
        let persisting = tokio::spawn(persist_progress(self.clone(), attempt.id, updates));
        let course = Course::of_plan(&input.params, input.cell.is_some());
        let tracker = Arc::new(Tracker::new(sender, &course));
        let times = tracker.times.clone();
        let result = self.0.runner.plan(input, share, cancel, tracker).await;
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
            Err(AttemptError::Job(JobError::NoPlan { reasons, report })) if !report.is_empty() => {
                Attempted::Files(report, Some(failure("no_plan", reasons, Vec::new())))
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
                return self.record_outcome(id, AttemptOutcome::Failed(internal(&error.into()), Vec::new()), timings).await;
            }
        }
        let (summary, artifacts) = (summary_of(&artifacts), Arc::new(artifacts));
        let mut pause = STORE_RETRY;
        let outcome = loop {
            match self.0.store.put_artifacts(Arc::clone(&artifacts)).await {
                // `stored` pins its files until their rows are written.
                Ok(stored) => {
                    let files = stored.files.clone();
                    let outcome = match &problem {
                        None => AttemptOutcome::Succeeded { files, summary },
                        Some(problem) => AttemptOutcome::Failed(problem.clone(), files),
                    };
                    return self.record_outcome(id, outcome, timings).await;
                }
                Err(error) if error.is_transient() => {
                    tracing::warn!(error = &error as &dyn std::error::Error, "results cannot be stored at the moment; retrying");
                }
                Err(error) => {
                    let problem = problem.unwrap_or_else(|| internal(&error));
                    break AttemptOutcome::Failed(problem, Vec::new());
                }
            }
            self.pause(pause).await;
            pause = (pause * 2).min(MAX_STORE_RETRY);
            if self.0.stopping.is_cancelled() {
                break AttemptOutcome::Interrupted;
            }
            if cancel.load(Ordering::Relaxed) {
                break AttemptOutcome::Cancelled;
            }
        };
        self.record_outcome(id, outcome, timings).await
    }

    /// Sleeps, but returns when the service stops.
    async fn pause(&self, pause: Duration) {
        tokio::select! {
            () = self.0.stopping.cancelled() => {}
            () = tokio::time::sleep(pause) => {}
        }
    }

    /// Records the outcome of an attempt. Retries until the service stops: else the job would stay `running` forever.
    async fn record_outcome(&self, id: JobId, outcome: AttemptOutcome, timings: &BTreeMap<String, f64>) -> Option<JobState> {
        let timings = serde_json::to_string(timings).unwrap_or_else(|_| "{}".to_owned());
        loop {
            match self.0.store.end_attempt(id, &outcome, &timings).await {
                Ok(state) => return Some(state),
                // The job was deleted, or its row was lost: there is nothing to record.
                Err(Error::JobNotFound(_)) => return None,
                Err(error) => tracing::error!(error = &error as &dyn std::error::Error, "a job's outcome cannot be recorded"),
            }
            if self.0.stopping.is_cancelled() {
                return None;
            }
            self.pause(STORE_RETRY).await;
        }
    }
}

/// Summary of the plan among the files of an attempt.
fn summary_of(artifacts: &[Artifact]) -> Option<Box<Summary>> {
    let file = artifacts.iter().find(|artifact| artifact.name == SUMMARY_FILE)?;
    let summary = serde_json::from_slice(&file.bytes);
    summary.inspect_err(|error| tracing::warn!(error = error as &dyn std::error::Error, "a summary cannot be read")).ok()
}

fn job_problem(error: AttemptError) -> JobProblem {
    match error {
        AttemptError::Panicked(text) => failure("job_panicked", format!("internal error: {text}"), Vec::new()),
        AttemptError::TimedOut(limit) => failure("job_too_long", too_long(limit), Vec::new()),
        AttemptError::Job(error @ JobError::BadInput(_)) => {
            let detail = error.to_string();
            let JobError::BadInput(errors) = error else { return failure("job_input_invalid", detail, Vec::new()) };
            failure("job_input_invalid", detail, errors.into_iter().map(ProblemField::from).collect())
        }
        AttemptError::Job(JobError::NoPlan { reasons, .. }) => failure("no_plan", reasons, Vec::new()),
        AttemptError::Job(JobError::Damaged(reason)) => failure("file_damaged", reason, Vec::new()),
        AttemptError::Job(error @ (JobError::Unavailable(_) | JobError::Cancelled)) => {
            failure("internal", error.to_string(), Vec::new())
        }
    }
}

fn too_long(limit: Duration) -> String {
    format!(
        "planning took longer than the {} s that limits.job_secs allows; simplify the mesh, choose a larger part.patch_edge_mm \
         or fewer candidates (larger candidates.step_small_deg, fewer rolls_deg), or raise the setting",
        limit.as_secs_f64()
    )
}

fn internal(error: &Error) -> JobProblem {
    tracing::error!(error = error as &dyn std::error::Error, "a job failed with an internal error");
    failure("internal", error.to_string(), Vec::new())
}

/// The problem of a failed job, with the title of its code.
pub(super) fn failure(code: &str, detail: String, errors: Vec<ProblemField>) -> JobProblem {
    let title = FAILURE_CODES.iter().find(|(known, _)| *known == code).map_or("", |(_, title)| title);
    JobProblem { kind: problem_type(code), title: title.to_owned(), detail, code: code.to_owned(), errors }
}

/// Progress of an attempt.
struct Update {
    stage: Stage,
    fraction: f64,
    timings: BTreeMap<String, f64>,
}

/// Persists progress updates as they arrive.
async fn persist_progress(app: App, id: JobId, mut updates: mpsc::UnboundedReceiver<Update>) {
    while let Some(Update { stage, fraction, timings }) = updates.recv().await {
        let timings = serde_json::to_string(&timings).unwrap_or_else(|_| "{}".to_owned());
        if let Err(error) = app.0.store.record_progress(id, stage.as_str(), fraction, &timings).await {
            tracing::warn!(error = &error as &dyn std::error::Error, "progress cannot be persisted");
        }
    }
}

/// Seconds spent in each finished stage, the start of the current one, and how far the whole is.
struct StageTimes {
    began: Instant,
    seconds: BTreeMap<String, f64>,
    now: Option<(Stage, Instant)>,
    overall: Overall,
    /// Stage that goes on when the one within it has ended.
    outer: Option<Stage>,
    sent: Option<Instant>,
}

impl StageTimes {
    fn close(&mut self) {
        if let Some((stage, began)) = self.now.take() {
            // Repetitions of a stage add up.
            *self.seconds.entry(stage.as_str().to_owned()).or_default() += began.elapsed().as_secs_f64();
        }
    }

    fn closed(&mut self) -> BTreeMap<String, f64> {
        self.close();
        self.seconds.clone()
    }
}

/// The observer of one attempt.
struct Tracker {
    updates: mpsc::UnboundedSender<Update>,
    times: Arc<Mutex<StageTimes>>,
}

impl Tracker {
    fn new(updates: mpsc::UnboundedSender<Update>, course: &Course) -> Self {
        let (began, overall) = (Instant::now(), Overall::new(course));
        let times = StageTimes { began, seconds: BTreeMap::new(), now: None, overall, outer: None, sent: None };
        Self { updates, times: Arc::new(Mutex::new(times)) }
    }

    fn send(&self, times: &mut StageTimes, stage: Stage) {
        times.sent = Some(Instant::now());
        let fraction = times.overall.fraction(times.began.elapsed().as_secs_f64());
        let update = Update { stage, fraction, timings: times.seconds.clone() };
        // The receiver is gone when the process stops.
        let _ = self.updates.send(update);
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, StageTimes> {
        self.times.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Observer for Tracker {
    fn begin(&self, stage: Stage) {
        failpoint::hit("stage", stage.as_str());
        let mut times = self.lock();
        times.close();
        times.now = Some((stage, Instant::now()));
        times.outer = None;
        let secs = times.began.elapsed().as_secs_f64();
        times.overall.begin(stage, secs);
        self.send(&mut times, stage);
    }

    fn within(&self, stage: Option<Stage>) {
        if let Some(stage) = stage {
            failpoint::hit("stage", stage.as_str());
        }
        let mut times = self.lock();
        let running = times.now.map(|(stage, _)| stage);
        times.close();
        times.now = stage.or(times.outer).map(|stage| (stage, Instant::now()));
        times.outer = stage.and(running);
    }

    fn progress(&self, done: usize, total: usize) {
        let mut times = self.lock();
        let Some((stage, _)) = times.now else { return };
        times.overall.progress(done, total);
        if times.sent.is_none_or(|sent| sent.elapsed() >= PROGRESS_INTERVAL) {
            self.send(&mut times, stage);
        }
    }
}
