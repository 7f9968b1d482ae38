//! Progress and stage times of an attempt.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use tokio::sync::mpsc;

use super::super::app::App;
use super::super::failpoint;
use super::super::progress::{Course, Overall};
use crate::planning::context::{Observer, Stage};
use crate::wire::JobId;

/// Min time between two progress updates within a stage; the beginning of a stage is always reported.
const PROGRESS_INTERVAL: Duration = Duration::from_millis(500);

/// Min time between two lines of the log on the progress of an attempt that cannot be persisted: a full disk must not fill it.
const TOLD_INTERVAL: Duration = Duration::from_secs(60);

/// Progress of an attempt.
pub(super) struct Update {
    stage: Stage,
    fraction: f64,
    timings: BTreeMap<String, f64>,
}

/// Persists progress updates as they arrive.
pub(super) async fn persist_progress(app: App, id: JobId, mut updates: mpsc::UnboundedReceiver<Update>) {
    let mut unstored = Unstored::default();
    while let Some(Update { stage, fraction, timings }) = updates.recv().await {
        let timings = serde_json::to_string(&timings).unwrap_or_else(|_| "{}".to_owned());
        if let Err(error) = app.0.store.record_progress(id, stage.as_str(), fraction, &timings).await {
            let Some(updates) = unstored.count(Instant::now()) else { continue };
            tracing::warn!(job = %id, updates, error = &error as &dyn std::error::Error, "progress cannot be persisted");
        }
    }
}

/// Updates of one attempt that could not be persisted.
#[derive(Default)]
struct Unstored {
    /// Time at which the log was told of them last.
    told: Option<Instant>,
    /// Number of those since then.
    untold: u64,
}

impl Unstored {
    /// Counts one more. Where the log is to be told, returns the number of those that it was not told of.
    fn count(&mut self, now: Instant) -> Option<u64> {
        self.untold += 1;
        if self.told.is_some_and(|told| now.saturating_duration_since(told) < TOLD_INTERVAL) {
            return None;
        }
        self.told = Some(now);
        Some(std::mem::take(&mut self.untold))
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
    updates: mpsc::UnboundedSender<Update>,
    pub(super) times: Arc<Mutex<AttemptTimes>>,
}

impl Tracker {
    pub(super) fn new(updates: mpsc::UnboundedSender<Update>, course: &Course) -> Self {
        let (began, overall) = (Instant::now(), Overall::new(course));
        let times = AttemptTimes { began, seconds: BTreeMap::new(), now: None, overall, outer: None, sent: None };
        Self { updates, times: Arc::new(Mutex::new(times)) }
    }

    fn send(&self, times: &mut AttemptTimes, stage: Stage) {
        times.sent = Some(Instant::now());
        let fraction = times.overall.fraction(times.began.elapsed().as_secs_f64());
        let update = Update { stage, fraction, timings: times.seconds.clone() };
        // The receiver is gone when the process stops.
        let _ = self.updates.send(update);
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, AttemptTimes> {
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

    /// A full disk gave two lines a second of every job.
    #[test]
    fn the_log_is_told_of_progress_that_cannot_be_persisted_now_and_then() {
        let (mut unstored, began) = (Unstored::default(), Instant::now());
        let told = [0, 1, 59, 60, 61, 200].map(|secs| unstored.count(began + Duration::from_secs(secs)));
        assert_eq!(told, [Some(1), None, None, Some(3), None, Some(2)]);
    }
}
