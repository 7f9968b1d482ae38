//! Working on the queue: one attempt after the other, each on the planning pool, with its own cancel flag. A panic ends
//! its attempt and nothing else. Stage times are measured here, since planning reads no clock.

use std::any::Any;
use std::collections::{BTreeMap, HashMap};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use tokio::sync::{Notify, mpsc, oneshot};

use super::app::App;
use super::error::Error;
use super::failpoint;
use super::options::Options;
use super::run::{Artifact, Planner, RunError, RunInput};
use super::store::{Attempt, Outcome};
use super::submit::run_input;
use crate::planning::Allowance;
use crate::planning::context::{Context, Observer, Stage};
use crate::planning::sequence::Roadmaps;
use crate::wire::{JobId, JobProblem, JobState, ProblemField, problem_type};

/// Progress is told at most this often, the beginning of a stage always.
const PROGRESS_EVERY: Duration = Duration::from_millis(500);
/// How long to wait after the store failed, at first; then twice as long each time, up to the longest.
const STORE_RETRY: Duration = Duration::from_secs(1);
const LONGEST_STORE_RETRY: Duration = Duration::from_secs(10);

/// Codes of a failed job's problem, with their titles.
pub const FAILURE_CODES: [(&str, &str); 8] = [
    ("job_input_invalid", "The job's input cannot be planned with"),
    ("job_too_long", "Planning took too long"),
    ("no_plan", "No plan is possible"),
    ("job_panicked", "Planning broke off"),
    ("job_attempts_exhausted", "The server died in every attempt at this job"),
    ("job_unreadable", "The stored job cannot be read by this version"),
    ("file_damaged", "A stored file is damaged"),
    ("internal", "The server is at fault"),
];

/// The planning pool and what runs on it.
pub(super) struct Runner {
    pool: rayon::ThreadPool,
    planner: Planner,
    running: Mutex<HashMap<JobId, Arc<AtomicBool>>>,
    queue_grew: Notify,
    /// For the next job in the same cell.
    roadmaps: Arc<Roadmaps>,
    /// Memory that a job may need.
    memory_bytes: u64,
    /// Time that it may be planned.
    limit: Option<Duration>,
}

impl Runner {
    pub(super) fn new(options: &Options, planner: Planner) -> Result<Self, rayon::ThreadPoolBuildError> {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(options.planning_threads)
            .thread_name(|index| format!("planning-{index}"))
            .start_handler(|_| yield_to_answers())
            .build()?;
        let (memory_bytes, limit) = (options.job_memory_bytes, options.job_limit);
        let (running, queue_grew, roadmaps) = (Mutex::default(), Notify::new(), Arc::default());
        Ok(Self { pool, planner, running, queue_grew, roadmaps, memory_bytes, limit })
    }

    /// Says that there is a job in the queue.
    pub(super) fn wake(&self) {
        self.queue_grew.notify_one();
    }

    /// Raises the cancel flag of a job that is planned.
    pub(super) fn cancel(&self, id: JobId) {
        if let Some(flag) = self.lock().get(&id) {
            flag.store(true, Ordering::Relaxed);
        }
    }

    /// Raises every cancel flag.
    pub(super) fn interrupt(&self) {
        self.lock().values().for_each(|flag| flag.store(true, Ordering::Relaxed));
    }

    /// Whether the pool has threads to plan on.
    pub(super) fn is_alive(&self) -> bool {
        self.pool.current_num_threads() > 0
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, HashMap<JobId, Arc<AtomicBool>>> {
        // The map is whole after every operation, also where a thread died in between.
        self.running.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What a job may take, all threads of the pool together.
    fn allowance(&self) -> Allowance {
        let core_secs = self.limit.map_or(f64::INFINITY, |limit| limit.as_secs_f64() * self.pool.current_num_threads() as f64);
        Allowance { bytes: self.memory_bytes as f64, core_secs }
    }

    /// Plans on the pool, no longer than is allowed.
    async fn plan(&self, input: RunInput, cancel: Arc<AtomicBool>, observer: Arc<Tracker>) -> Result<Vec<Artifact>, Ended> {
        let planning = self.begin(input, Arc::clone(&cancel), observer);
        tokio::pin!(planning);
        let Some(limit) = self.limit else { return planning.await };
        if let Ok(ended) = tokio::time::timeout(limit, &mut planning).await {
            return ended;
        }
        let was_cancelled = cancel.swap(true, Ordering::Relaxed);
        match planning.await {
            Err(Ended::With(RunError::Cancelled)) if !was_cancelled => Err(Ended::TooLong(limit)),
            ended => ended,
        }
    }

    async fn begin(&self, input: RunInput, cancel: Arc<AtomicBool>, observer: Arc<Tracker>) -> Result<Vec<Artifact>, Ended> {
        let (sender, receiver) = oneshot::channel();
        let (planner, roadmaps, allowance) = (self.planner.clone(), Arc::clone(&self.roadmaps), self.allowance());
        self.pool.spawn(move || {
            let context = Context::new(&cancel, &*observer).with_roadmaps(&roadmaps).with_allowance(allowance);
            // Nothing that the closure touches is used again after a panic.
            let ended = catch_unwind(AssertUnwindSafe(|| planner(&input, &context)));
            drop(observer);
            // Nobody waits when the process stops.
            let _ = sender.send(ended);
        });
        match receiver.await {
            Ok(Ok(result)) => result.map_err(Ended::With),
            Ok(Err(panic)) => Err(Ended::Panicked(panic_text(&*panic))),
            Err(_) => Err(Ended::Panicked("the planning thread ended".to_owned())),
        }
    }
}

/// Lowers the priority of this thread (Linux has one for each thread), so that the threads that answer go first.
fn yield_to_answers() {
    const NICE: i32 = 10;
    if let Err(error) = rustix::process::setpriority_process(Some(rustix::thread::gettid()), NICE) {
        tracing::debug!(%error, "the planning threads keep their priority");
    }
}

/// How an attempt ended without files.
enum Ended {
    With(RunError),
    Panicked(String),
    /// Not within the time allowed.
    TooLong(Duration),
}

fn panic_text(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().map(|text| (*text).to_owned());
    text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_else(|| "without a message".to_owned())
}

/// Works on the queue until the service stops.
pub(super) async fn work(app: App) {
    let stopping = app.stopping();
    let mut pause = STORE_RETRY;
    while !stopping.is_cancelled() {
        match app.0.store.claim().await {
            Ok(Some(attempt)) => app.attempt(attempt).await,
            Ok(None) => tokio::select! {
                () = stopping.cancelled() => {}
                () = app.0.runner.queue_grew.notified() => {}
            },
            Err(error) => {
                tracing::error!(error = &error as &dyn std::error::Error, "the queue cannot be read");
                app.pause(pause).await;
                pause = (pause * 2).min(LONGEST_STORE_RETRY);
                continue;
            }
        }
        pause = STORE_RETRY;
    }
}

impl App {
    /// Puts the jobs of a process that died in order.
    pub(super) async fn recover(&self) -> Result<(), Error> {
        let attempts = self.0.options.max_attempts;
        let why = format!("the process ended during each of {attempts} attempts; the job may need more memory than there is");
        let found = self.0.store.recover(attempts, &failure("job_attempts_exhausted", why, Vec::new())).await?;
        if found > 0 {
            tracing::warn!(jobs = found, "an earlier process ended while jobs were planned; they start again");
        }
        Ok(())
    }

    #[tracing::instrument(skip_all, fields(job = %attempt.id, attempt = attempt.number))]
    async fn attempt(&self, attempt: Attempt) {
        failpoint::hit("job", "claimed");
        let cancel = Arc::new(AtomicBool::new(false));
        self.0.runner.lock().insert(attempt.id, cancel.clone());
        // A cancellation or a stop between the claim and the line above has not seen the flag.
        let cancelled = self.0.store.job_state(attempt.id).await.is_ok_and(|state| state == JobState::Cancelling);
        cancel.fetch_or(cancelled || self.0.stopping.is_cancelled(), Ordering::Relaxed);
        let began = Instant::now();
        let flag = Arc::clone(&cancel);
        let (result, timings) = self.plan(&attempt, cancel).await;
        // Interrupted though the service goes on: for want of something that may be there in a moment.
        let waits = matches!(result, Err(Outcome::Interrupted));
        let state = match result {
            Ok(artifacts) => self.keep(attempt.id, artifacts, &timings, &flag).await,
            Err(outcome) => self.conclude(attempt.id, outcome, &timings).await,
        };
        self.0.runner.lock().remove(&attempt.id);
        if waits {
            self.pause(STORE_RETRY).await;
        }
        let seconds = began.elapsed().as_secs_f64();
        metrics::counter!("vantage_attempts_total", "state" => state.map_or("unknown", JobState::as_str)).increment(1);
        metrics::histogram!("vantage_attempt_seconds").record(seconds);
        tracing::info!(state = state.map(JobState::as_str), seconds, "attempt ended");
    }

    /// Plans, and tells how far it is meanwhile. Returns the files, or how the attempt ended without; and stage times.
    async fn plan(&self, attempt: &Attempt, cancel: Arc<AtomicBool>) -> (Result<Vec<Artifact>, Outcome>, BTreeMap<String, f64>) {
        let input = match run_input(attempt, self.0.store.files(), self.0.options.max_triangles) {
            Ok(input) => input,
            Err(error) => {
                tracing::error!(error = &error as &dyn std::error::Error, "a stored job cannot be read; it fails");
                return (Err(Outcome::Failed(failure("job_unreadable", error.to_string(), Vec::new()))), BTreeMap::new());
            }
        };
        let (updates, told) = mpsc::unbounded_channel();
        let teller = tokio::spawn(tell(self.clone(), attempt.id, told));
        let tracker = Arc::new(Tracker::new(updates));
        let times = tracker.times.clone();
        let result = self.0.runner.plan(input, cancel, tracker).await;
        // It ends with the tracker; what it could not tell is in its log.
        let _ = teller.await;
        let timings = times.lock().unwrap_or_else(PoisonError::into_inner).closed();
        let result = result.map_err(|ended| match ended {
            Ended::With(RunError::Cancelled) if self.0.stopping.is_cancelled() => Outcome::Interrupted,
            Ended::With(RunError::Cancelled) => Outcome::Cancelled,
            Ended::With(RunError::Unavailable(reason)) => {
                tracing::warn!(reason, "the attempt is put off");
                Outcome::Interrupted
            }
            ended => Outcome::Failed(why(ended)),
        });
        (result, timings)
    }

    /// Stores the files of an attempt and ends it. While the disk is full, or the store cannot be used for another reason
    /// that may pass, it waits: what has been planned is not thrown away.
    async fn keep(
        &self,
        id: JobId,
        mut artifacts: Vec<Artifact>,
        timings: &BTreeMap<String, f64>,
        cancel: &AtomicBool,
    ) -> Option<JobState> {
        match serde_json::to_vec_pretty(timings) {
            Ok(bytes) => artifacts.push(Artifact { name: "timings.json", bytes }),
            Err(error) => return self.conclude(id, Outcome::Failed(internal(&error.into())), timings).await,
        }
        let artifacts = Arc::new(artifacts);
        let mut pause = STORE_RETRY;
        let outcome = loop {
            match self.0.store.put_artifacts(Arc::clone(&artifacts)).await {
                // What is stored is kept until its rows are written.
                Ok(stored) => return self.conclude(id, Outcome::Succeeded(stored.files.clone()), timings).await,
                Err(error) if error.is_transient() => {
                    tracing::warn!(error = &error as &dyn std::error::Error, "results wait until they can be stored");
                }
                Err(error) => break Outcome::Failed(internal(&error)),
            }
            self.pause(pause).await;
            pause = (pause * 2).min(LONGEST_STORE_RETRY);
            if self.0.stopping.is_cancelled() {
                break Outcome::Interrupted;
            }
            if cancel.load(Ordering::Relaxed) {
                break Outcome::Cancelled;
            }
        };
        self.conclude(id, outcome, timings).await
    }

    /// Waits, but not beyond the service's end.
    async fn pause(&self, pause: Duration) {
        tokio::select! {
            () = self.0.stopping.cancelled() => {}
            () = tokio::time::sleep(pause) => {}
        }
    }

    /// Writes how an attempt ended, and does not give up before the service stops: else the job would run for ever.
    async fn conclude(&self, id: JobId, outcome: Outcome, timings: &BTreeMap<String, f64>) -> Option<JobState> {
        let timings = serde_json::to_string(timings).unwrap_or_else(|_| "{}".to_owned());
        loop {
            match self.0.store.end_attempt(id, &outcome, &timings).await {
                Ok(state) => return Some(state),
                // It was deleted, or its row is not one any more: nobody waits for its end.
                Err(Error::JobNotFound(_)) => return None,
                Err(error) => tracing::error!(error = &error as &dyn std::error::Error, "the end of a job cannot be written"),
            }
            if self.0.stopping.is_cancelled() {
                return None;
            }
            self.pause(STORE_RETRY).await;
        }
    }
}

fn why(ended: Ended) -> JobProblem {
    match ended {
        Ended::Panicked(text) => failure("job_panicked", format!("a fault of the program: {text}"), Vec::new()),
        Ended::TooLong(limit) => failure("job_too_long", too_long(limit), Vec::new()),
        Ended::With(error @ RunError::BadInput(_)) => {
            let detail = error.to_string();
            let RunError::BadInput(errors) = error else { return failure("job_input_invalid", detail, Vec::new()) };
            failure("job_input_invalid", detail, errors.into_iter().map(ProblemField::from).collect())
        }
        Ended::With(RunError::NoPlan(reasons)) => failure("no_plan", reasons, Vec::new()),
        Ended::With(RunError::Damaged(reason)) => failure("file_damaged", reason, Vec::new()),
        Ended::With(error @ (RunError::Unavailable(_) | RunError::Cancelled)) => {
            failure("internal", error.to_string(), Vec::new())
        }
    }
}

fn too_long(limit: Duration) -> String {
    format!(
        "it was not planned within the {} s that limits.job_secs allows; plan a simpler mesh, take a larger part.patch_edge_mm \
         or fewer candidates (larger candidates.step_small_deg, fewer rolls_deg), or raise the setting",
        limit.as_secs_f64()
    )
}

fn internal(error: &Error) -> JobProblem {
    tracing::error!(error = error as &dyn std::error::Error, "a job failed by a fault of ours");
    failure("internal", error.to_string(), Vec::new())
}

/// The problem of a failed job, by its code.
pub(super) fn failure(code: &str, detail: String, errors: Vec<ProblemField>) -> JobProblem {
    let title = FAILURE_CODES.iter().find(|(known, _)| *known == code).map_or("", |(_, title)| title);
    JobProblem { kind: problem_type(code), title: title.to_owned(), detail, code: code.to_owned(), errors }
}

/// How far an attempt is.
struct Update {
    stage: Stage,
    fraction: f64,
    timings: BTreeMap<String, f64>,
}

/// Writes progress down as it comes.
async fn tell(app: App, id: JobId, mut updates: mpsc::UnboundedReceiver<Update>) {
    while let Some(Update { stage, fraction, timings }) = updates.recv().await {
        let timings = serde_json::to_string(&timings).unwrap_or_else(|_| "{}".to_owned());
        if let Err(error) = app.0.store.progress(id, stage.as_str(), fraction, &timings).await {
            tracing::warn!(error = &error as &dyn std::error::Error, "progress cannot be written");
        }
    }
}

/// Seconds spent in stages: those that are over, and the one that is not.
#[derive(Default)]
struct StageTimes {
    seconds: BTreeMap<String, f64>,
    now: Option<(Stage, Instant)>,
    fraction: f64,
    told: Option<Instant>,
}

impl StageTimes {
    fn close(&mut self) {
        if let Some((stage, began)) = self.now.take() {
            // A stage that repeats adds up.
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

/// Share of the work that is done before each stage begins, and after the last; a rule of thumb.
const DONE_BEFORE: [f64; Stage::ALL.len() + 1] = [0.0, 0.05, 0.1, 0.2, 0.65, 0.7, 0.85, 0.88, 0.92, 1.0];

impl Tracker {
    fn new(updates: mpsc::UnboundedSender<Update>) -> Self {
        Self { updates, times: Arc::default() }
    }

    /// Where in the whole `done` of `total` in `stage` is.
    fn fraction(stage: Stage, done: usize, total: usize) -> f64 {
        let index = Stage::ALL.iter().position(|other| *other == stage).unwrap_or_default();
        let within = if total == 0 { 0.0 } else { (done as f64 / total as f64).min(1.0) };
        DONE_BEFORE[index] + within * (DONE_BEFORE[index + 1] - DONE_BEFORE[index])
    }

    fn send(&self, times: &mut StageTimes, stage: Stage, fraction: f64) {
        // Stages may repeat; the bar does not go back.
        times.fraction = times.fraction.max(fraction);
        times.told = Some(Instant::now());
        let update = Update { stage, fraction: times.fraction, timings: times.seconds.clone() };
        // Nobody listens once the process stops.
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
        self.send(&mut times, stage, Self::fraction(stage, 0, 1));
    }

    fn progress(&self, done: usize, total: usize) {
        let mut times = self.lock();
        let Some((stage, _)) = times.now else { return };
        if times.told.is_none_or(|told| told.elapsed() >= PROGRESS_EVERY) {
            self.send(&mut times, stage, Self::fraction(stage, done, total));
        }
    }
}
