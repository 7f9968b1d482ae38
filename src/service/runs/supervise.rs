//! The task of a run: checks its program, begins its session, stores what the session tells and each step that is done, and at the
//! end its record. What the session measures many times a second goes to those who follow the run, never to the database.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use tokio::sync::broadcast;
use tokio::sync::broadcast::error::RecvError;
use tokio_util::sync::CancellationToken;

use super::OpenRun;
use super::order::{CheckedOrder, RunOrder};
use super::session::{self, SessionOrder};
use crate::execution::audit::AuditLog;
use crate::execution::record::{RunRecord, StepKind, StepRecord};
use crate::execution::session::streamer::Jitter;
use crate::execution::session::{Authority, LiveEvent, RunHandle, RunStatus, StopCause};
use crate::planning::context::Context;
use crate::service::app::App;
use crate::service::error::Error;
use crate::service::metrics;
use crate::wire::RunId;
use crate::wire::run::{
    ReportedReason, ReportedState, Run, RunCoverage, RunEventDocument, RunEventKind, RunMode, RunStepRecord, RunStop,
};

/// A run's task; what it holds is given back when it is dropped, however the task ends.
pub(super) struct Supervisor {
    pub(super) app: App,
    pub(super) run: Run,
    pub(super) open: Arc<OpenRun>,
    /// Steps of its record that are in the database.
    pub(super) stored: DoneSteps,
}

/// Sums over the first steps of a record.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct DoneSteps {
    count: usize,
    scans: usize,
    /// Time of the steps alone, as in the record: time in a pause is not theirs.
    secs: f64,
}

impl DoneSteps {
    /// The sums with those of the steps that follow.
    fn and(self, steps: &[StepRecord]) -> Self {
        Self {
            count: self.count + steps.len(),
            scans: self.scans + steps.iter().filter(|step| step.kind == StepKind::Scan).count(),
            // In the order of the record, in which its own sum is made.
            secs: steps.iter().fold(self.secs, |secs, step| secs + step.real_secs),
        }
    }
}

impl Drop for Supervisor {
    fn drop(&mut self) {
        self.app.0.runs.leave(self.run.id);
    }
}

/// Raises a flag once a token is cancelled, for work that asks a flag.
struct FlagOf(Arc<AtomicBool>, tokio::task::JoinHandle<()>);

impl FlagOf {
    fn new(token: CancellationToken) -> Self {
        let flag = Arc::new(AtomicBool::new(false));
        let raised = Arc::clone(&flag);
        let task = tokio::spawn(async move {
            token.cancelled().await;
            raised.store(true, Ordering::Relaxed);
        });
        Self(flag, task)
    }
}

impl Drop for FlagOf {
    fn drop(&mut self) {
        // Nobody waits for that work any more, and its task may not have come to raise the flag.
        self.0.store(true, Ordering::Relaxed);
        self.1.abort();
    }
}

impl Supervisor {
    /// Carries out the run to its end.
    pub(super) async fn carry_out(mut self, order: RunOrder) {
        let order = Arc::new(order);
        let checked = match self.checked(&order).await {
            Ok(checked) => Arc::new(checked),
            Err(ended) => return self.end_early(ended).await,
        };
        // Where arm and table move in turn, they take longer than planned.
        self.run.planned_secs = checked.job.program().cycle_secs;
        let (handle, log) = match self.begin(&order, &checked).await {
            Ok(begun) => begun,
            Err(reason) => return self.end_early((ReportedState::Failed, ReportedReason::NotAllowed, Some(reason))).await,
        };
        self.open.session.send_replace(Some(handle.clone()));
        self.follow(&handle).await;
        let record = handle.ended().await;
        self.close_log(log).await;
        self.end(&order, &checked, &record).await;
    }

    /// Checks the program on a thread that may block.
    async fn checked(&self, order: &Arc<RunOrder>) -> Result<CheckedOrder, Ended> {
        let stop = self.open.stop.child_token();
        let flag = FlagOf::new(stop.clone());
        let (order, cells, raised) = (Arc::clone(order), Arc::clone(&self.app.0.cells), Arc::clone(&flag.0));
        let check = tokio::task::spawn_blocking(move || order.check(&cells, &|| raised.load(Ordering::Relaxed)));
        let checked = tokio::select! {
            checked = check => checked,
            () = stop.cancelled() => return Err((ReportedState::Stopped, ReportedReason::ByClient, None)),
            () = self.app.0.stopping.cancelled() => return Err((ReportedState::Stopped, ReportedReason::ServerGone, None)),
        };
        match checked {
            Ok(Ok(checked)) => Ok(checked),
            Ok(Err(reason)) => Err((ReportedState::Failed, ReportedReason::ProgramRefused, Some(reason))),
            Err(error) => Err((ReportedState::Failed, ReportedReason::Internal, Some(error.to_string()))),
        }
    }

    async fn begin(&self, order: &RunOrder, checked: &CheckedOrder) -> Result<(RunHandle, Option<Arc<AuditLog>>), String> {
        let options = &self.app.0.options.execution;
        let carrier = self.app.0.runs.carrier.handle().ok_or("the server is shutting down")?;
        let was_completed = self.app.0.store.was_completed(&order.program_sha256, &order.cell_sha256).await;
        let authority = (self.run.mode == RunMode::Live)
            .then(|| Authority { leases: self.app.0.runs.leases.leases.clone(), cell: self.run.cell.clone() });
        let order = SessionOrder {
            name: self.run.id.to_string(),
            job: checked.job.clone(),
            request: &order.request,
            controllers: order.controllers.as_ref(),
            authority,
            is_first: !was_completed.unwrap_or(false),
            heartbeat_timeout: options.lease_ttl,
            relocate: if order.request.locate { checked.locating() } else { None },
            audit: (self.run.mode != RunMode::Simulate).then(|| session::AuditPlace {
                folder: options.audit_dir.join(self.run.id.to_string()),
                file_bytes: options.audit_file_bytes,
                files: options.audit_files,
            }),
        };
        let _on_carrier = carrier.enter();
        session::begin(order)
    }

    /// Stores what the session tells until its end.
    async fn follow(&mut self, handle: &RunHandle) {
        let stopping = self.app.stopping();
        let (mut last_id, mut is_stopping) = (0, false);
        let (is_over, mut live) = self.replayed(handle, 0).await;
        if is_over {
            return;
        }
        while !self.run.state.is_ended() {
            let told = tokio::select! {
                told = live.recv() => told,
                () = self.open.stop.cancelled(), if !is_stopping => {
                    is_stopping = true;
                    handle.stop(StopCause::Client);
                    continue;
                }
                () = stopping.cancelled(), if !is_stopping => {
                    is_stopping = true;
                    handle.stop(StopCause::ServerGone);
                    continue;
                }
            };
            match told {
                Ok(event) => {
                    last_id = event.id;
                    if self.hear(handle, &event).await {
                        return;
                    }
                }
                Err(RecvError::Lagged(_)) => {
                    let (is_over, again) = self.replayed(handle, last_id).await;
                    live = again;
                    if is_over {
                        return;
                    }
                }
                Err(RecvError::Closed) => return,
            }
        }
    }

    /// Hears the events that are kept after a number; true if the run has ended.
    async fn replayed(&mut self, handle: &RunHandle, after: u64) -> (bool, broadcast::Receiver<LiveEvent>) {
        let (kept, live) = handle.events_after(after);
        for event in kept {
            if self.hear(handle, &event).await {
                return (true, live);
            }
        }
        (false, live)
    }

    /// Stores what is new in an event; true if the run has ended, of which the record tells more.
    async fn hear(&mut self, handle: &RunHandle, event: &LiveEvent) -> bool {
        if event.status.state.is_final() {
            return true;
        }
        let (state, reason) = words_of(&event.status);
        let step = event.step.unwrap_or(self.run.step);
        let stop: Option<RunStop> = event.stop.as_ref().map(Into::into);
        let kind = match () {
            () if (state, reason) != (self.run.state, self.run.reason) || stop != self.run.stop => RunEventKind::State,
            () if step != self.run.step => RunEventKind::Step,
            () if event.speed_override.total_cmp(&self.run.speed_override).is_ne() => RunEventKind::Override,
            () => return false,
        };
        (self.run.state, self.run.reason, self.run.detail) = (state, reason, Some(event.status.reason.to_string()));
        self.run.stop = stop;
        (self.run.step, self.run.speed_override, self.run.armed_by) = (step, event.speed_override, self.open.armed_by());
        let unstored = handle.steps_from(self.stored.count);
        let done = self.stored.and(&unstored);
        (self.run.elapsed_secs, self.run.scans) = (done.secs, done.scans);
        self.store(kind, &unstored).await;
        false
    }

    async fn end_early(&mut self, (state, reason, detail): Ended) {
        (self.run.state, self.run.reason, self.run.detail) = (state, reason, detail);
        self.store(RunEventKind::State, &[]).await;
        self.count();
    }

    /// Ends the audit log and notes its head.
    async fn close_log(&mut self, log: Option<Arc<AuditLog>>) {
        let Some(log) = log else { return };
        match session::close_log(log).await {
            Ok(head) => self.run.audit = Some(head.into()),
            Err(reason) => {
                tracing::error!(run = %self.run.id, reason, "the audit log was not closed; its end is not kept with the run");
            }
        }
    }

    /// Stores the record and how the run ended, then its coverage.
    async fn end(&mut self, order: &Arc<RunOrder>, checked: &Arc<CheckedOrder>, record: &Arc<RunRecord>) {
        let coverage = coverage_at(self.app.clone(), self.run.id, Arc::clone(checked), Arc::clone(record));
        self.run.conclude(record);
        self.run.armed_by = self.open.armed_by();
        if has_completed_program(&self.run) {
            let noted = self.app.0.store.note_completed(&order.program_sha256, &order.cell_sha256).await;
            warn(&self.run, "noting that the program was completed", noted);
        }
        record.jitter.iter().for_each(count_jitter);
        self.store_end(record.steps.get(self.stored.count..).unwrap_or_default(), coverage).await;
        self.count();
    }

    /// Stores the end of the run, and only then what `coverage` evaluates: a crash meanwhile leaves the run as it ended. Those who follow
    /// it are told last, so that they find its coverage.
    async fn store_end(&mut self, steps: &[StepRecord], coverage: impl Future<Output = Option<RunCoverage>>) {
        let Some(ended) = self.stored(RunEventKind::State, steps).await else { return };
        if let Some(coverage) = coverage.await {
            let (store, id) = (&self.app.0.store, self.run.id);
            let add = || store.add_run_coverage(id, coverage);
            let added = self.app.retried("storing the coverage of a run", || false, add).await;
            warn(&self.run, "storing the coverage at the measured poses", added);
            self.run.coverage = Some(coverage);
        }
        self.app.0.runs.publish(ended);
    }

    /// Stores the run as it stands, and tells those who follow it.
    async fn store(&mut self, kind: RunEventKind, steps: &[StepRecord]) {
        if let Some(event) = self.stored(kind, steps).await {
            self.app.0.runs.publish(event);
        }
    }

    /// Stores the run as it stands; returns the event to publish. While the store is temporarily unavailable, its end is tried again;
    /// a change before that is not, since a stop must not wait for it, and the next change stores as much.
    async fn stored(&mut self, kind: RunEventKind, steps: &[StepRecord]) -> Option<Arc<RunEventDocument>> {
        let rows: Vec<RunStepRecord> = steps.iter().map(RunStepRecord::from).collect();
        let (store, rows, first) = (&self.app.0.store, &rows, self.stored.count);
        let update = || {
            let mut run = self.run.clone();
            async move { store.update_run(&mut run, kind, (first, rows)).await.map(|event| (run, event)) }
        };
        let stored = if self.run.state.is_ended() {
            self.app.retried("storing the end of a run", || false, update).await
        } else {
            update().await
        };
        match stored {
            Ok((run, Some(event))) => {
                self.run = run;
                self.stored = self.stored.and(steps);
                Some(event)
            }
            Ok((_, None)) => None,
            Err(error) => {
                warn(&self.run, "storing the run", Err(error));
                None
            }
        }
    }

    fn count(&self) {
        let (mode, state) = (self.run.mode.as_str(), self.run.state.as_str());
        metrics::record(|metrics| {
            metrics.run_ended.with_label_values(&[mode, state]).inc();
            metrics.run_seconds.with_label_values(&[mode]).observe(self.run.elapsed_secs);
        });
        let devices = self.run.stop.iter().flat_map(|stop| [&stop.arm, &stop.table]).flatten();
        for device in devices {
            let stages = [("sent", device.sent_ms), ("acknowledged", device.acknowledged_ms), ("at_rest", device.at_rest_ms)];
            for (stage, ms) in stages.into_iter().filter_map(|(stage, ms)| Some((stage, ms?))) {
                metrics::record(|metrics| metrics.run_stop_seconds.with_label_values(&[stage]).observe(ms / 1000.0));
            }
        }
    }
}

/// Coverage at the measured poses, for a run that is done.
async fn coverage_at(app: App, run: RunId, checked: Arc<CheckedOrder>, record: Arc<RunRecord>) -> Option<RunCoverage> {
    let (state, _) = words_of(&record.status);
    if state != ReportedState::Done || record.scans().next().is_none() {
        return None;
    }
    let flag = FlagOf::new(app.stopping());
    let compute = move |ctx: &Context<'_>| checked.coverage(&record, ctx);
    let computed = app.0.runner.compute(Arc::clone(&flag.0), compute).await;
    match computed.and_then(|coverage| coverage) {
        Ok(coverage) => coverage,
        Err(error) => {
            tracing::warn!(%run, error, "the coverage at the measured poses cannot be evaluated");
            None
        }
    }
}

/// Adds the jitter of streamed set points to the metrics, a hundredth of the periods at a time.
fn count_jitter(jitter: &Jitter) {
    const SHARES: u32 = 100;
    metrics::record(|metrics| {
        // Joins the metric once, after all values.
        let histogram = metrics.run_jitter_seconds.local();
        for share in 0..SHARES {
            let seconds = jitter.quantile((f64::from(share) + 0.5) / f64::from(SHARES)).as_secs_f64();
            for _ in 0..jitter.periods / u64::from(SHARES) {
                histogram.observe(seconds);
            }
        }
        histogram.flush();
        metrics.run_periods_missed.inc_by(jitter.missed);
    });
}

/// Returns true for a run that moved through the whole program live: later ones may be faster. One that began at a later step has shown
/// nothing of the motions before it.
fn has_completed_program(run: &Run) -> bool {
    run.state == ReportedState::Done && run.mode == RunMode::Live && run.from_step == 0
}

/// State, reason and words of a run that ended before its session began.
type Ended = (ReportedState, ReportedReason, Option<String>);

/// A session's status in the words of the interfaces.
fn words_of(status: &RunStatus) -> (ReportedState, ReportedReason) {
    (status.state.into(), ReportedReason::of(&status.reason))
}

fn warn(run: &Run, what: &str, result: Result<(), Error>) {
    if let Err(error) = result {
        tracing::error!(run = %run.id, error = &error as &dyn std::error::Error, "{what} failed");
    }
}

#[cfg(test)]
mod tests;
