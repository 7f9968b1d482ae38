//! Progress and stage times of an attempt.

use std::collections::{BTreeMap, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use tokio::sync::mpsc;

use super::super::app::App;
use super::super::failpoint;
use super::super::log_pace::LogPace;
use super::super::progress::{Course, Overall};
use crate::planning::context::{Observer, Stage};
use crate::wire::JobId;

/// Min time between two progress updates within a stage; the beginning of a stage is always reported.
const PROGRESS_INTERVAL: Duration = Duration::from_millis(500);

/// Min time between two lines of the log on the progress of an attempt that cannot be persisted: a full disk must not fill it.
const TOLD_INTERVAL: Duration = Duration::from_secs(60);

/// Progress of an attempt.
struct Update {
    stage: Stage,
    fraction: f64,
    timings: BTreeMap<String, f64>,
}

/// Updates that wait to be persisted: of each stage the latest alone, in the order in which they came. However long a commit takes, they
/// do not pile up, and the end of the job waits for at most one of each stage.
#[derive(Clone, Default)]
struct Pending(Arc<Mutex<VecDeque<Update>>>);

impl Pending {
    fn put(&self, update: Update) {
        let mut updates = self.lock();
        updates.retain(|earlier| earlier.stage != update.stage);
        updates.push_back(update);
    }

    fn take_first(&self) -> Option<Update> {
        self.lock().pop_front()
    }

    fn lock(&self) -> MutexGuard<'_, VecDeque<Update>> {
        // Whole after every operation, so a poisoned lock is usable.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Receiver of the updates of a [`Tracker`].
pub(super) struct Updates {
    pending: Pending,
    /// Rung after an update; closed when the tracker is dropped.
    bell: mpsc::Receiver<()>,
}

impl Updates {
    /// The next update, once there is one; `None` after the last.
    async fn next(&mut self) -> Option<Update> {
        loop {
            if let Some(update) = self.pending.take_first() {
                return Some(update);
            }
            self.bell.recv().await?;
        }
    }
}

/// Persists progress updates as they arrive.
pub(super) async fn persist_progress(app: App, id: JobId, mut updates: Updates) {
    let mut pace = LogPace::every(TOLD_INTERVAL);
    while let Some(Update { stage, fraction, timings }) = updates.next().await {
        let timings = serde_json::to_string(&timings).unwrap_or_else(|_| "{}".to_owned());
        if let Err(error) = app.0.store.record_progress(id, stage.as_str(), fraction, &timings).await {
            let Some(updates) = pace.count(Instant::now()) else { continue };
            tracing::warn!(job = %id, updates, error = &error as &dyn std::error::Error, "progress cannot be persisted");
        }
    }
}

/// Seconds spent in each finished stage, the start of the current one, and how far the whole is.
pub(super) struct AttemptTimes {
    began: Instant,
    seconds: BTreeMap<String, f64>,
    now: Option<(Stage, Instant)>,
    overall: Overall,
    /// Stage that goes on when the one within it has ended.
    outer: Option<Stage>,
    sent: Option<Instant>,
}

impl AttemptTimes {
    fn close(&mut self) {
        if let Some((stage, began)) = self.now.take() {
            // Repetitions of a stage add up.
            *self.seconds.entry(stage.as_str().to_owned()).or_default() += began.elapsed().as_secs_f64();
        }
    }

    pub(super) fn closed(&mut self) -> BTreeMap<String, f64> {
        self.close();
        self.seconds.clone()
    }
}

/// The observer of one attempt.
pub(super) struct Tracker {
    pending: Pending,
    bell: mpsc::Sender<()>,
    pub(super) times: Arc<Mutex<AttemptTimes>>,
}

impl Tracker {
    /// An observer and the updates that it sends.
    pub(super) fn new(course: &Course) -> (Self, Updates) {
        let (began, overall) = (Instant::now(), Overall::new(course));
        let times = AttemptTimes { began, seconds: BTreeMap::new(), now: None, overall, outer: None, sent: None };
        let (pending, (ring, bell)) = (Pending::default(), mpsc::channel(1));
        let updates = Updates { pending: pending.clone(), bell };
        (Self { pending, bell: ring, times: Arc::new(Mutex::new(times)) }, updates)
    }

    fn send(&self, times: &mut AttemptTimes, stage: Stage) {
        times.sent = Some(Instant::now());
        let fraction = times.overall.fraction(times.began.elapsed().as_secs_f64());
        self.pending.put(Update { stage, fraction, timings: times.seconds.clone() });
        // The bell has rung already, or the receiver is gone as the process stops.
        let _ = self.bell.try_send(());
    }

    fn lock(&self) -> MutexGuard<'_, AttemptTimes> {
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

#[cfg(test)]
mod tests {
    use super::*;

    /// The end of a job waited until the database had taken every one of them.
    #[tokio::test]
    async fn of_the_updates_that_wait_each_stage_has_its_latest() {
        let (tracker, mut updates) = Tracker::new(&Course::default());
        for _ in 0..1000 {
            tracker.begin(Stage::Candidates);
            tracker.begin(Stage::Visibility);
        }
        tracker.begin(Stage::Selection);
        drop(tracker);
        let mut stages = Vec::new();
        while let Some(update) = updates.next().await {
            stages.push((update.stage, update.timings.len()));
        }
        assert_eq!(stages, [(Stage::Candidates, 2), (Stage::Visibility, 2), (Stage::Selection, 2)]);
    }
}
