//! The task of a run: prepares, waits to be armed, carries out step by step, stops and gives back.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::pin::pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::task::Poll;
use std::time::Duration;

use tokio::time::{Instant, timeout};

use super::cause::{DeviceRole, PauseCause, StopCause};
use super::gate::{self, Objection, RunJob};
use super::handle::{Control, Halt, StopRequest};
use super::live::Live;
use super::machine::{Drive, Identities, Watch};
use super::state::RunEvent;
use super::steps::Done;
use super::watcher::{Watcher, of_machine};
use super::way;
use super::{Mode, RunOptions, stop};
use crate::cell::Configuration;
use crate::execution::device::{DeviceError, STOP_ATTEMPT, Trigger, WITHDRAWAL};
use crate::execution::record::{DeviceStop, PoseDeviation, RunRecord, StepKind, StepRecord, StopReport};
use crate::geometry::{Part, Pose, Table};
use crate::program::Step;

/// Flag of a work that is cancelled once nobody waits for it any longer.
#[derive(Default)]
struct CancelledOnDrop(Arc<AtomicBool>);

impl Drop for CancelledOnDrop {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// A run.
pub(super) struct Runner<M, T> {
    pub(super) mode: Mode,
    pub(super) job: RunJob,
    pub(super) watcher: Watcher<M>,
    pub(super) trigger: T,
    pub(super) options: RunOptions,
    pub(super) identities: Option<Identities>,
    pub(super) next_step: usize,
    /// Number of the last target.
    pub(super) sequence: u64,
    /// True once devices may hold the right to move.
    pub(super) is_armed: bool,
    /// True until the locating scan is taken.
    pub(super) has_to_locate: bool,
    pub(super) located: Option<Pose<Table, Part>>,
    /// True if the next move leads straight to its target, from wherever the former program led.
    pub(super) rejoins: bool,
    /// Time of the step under way that ran on the devices' clock, s: moves, waits and captures. A twin's clock may run quicker
    /// than the host's.
    pub(super) scheduled_secs: f64,
    /// Configuration in which the devices were found after the stop that ended the run.
    pub(super) last_measured: Option<Configuration>,
}

impl<M: Drive, T: Trigger> Runner<M, T> {
    pub(super) fn new(
        mode: Mode,
        job: RunJob,
        machine: M,
        trigger: T,
        control: Control,
        live: Arc<Live>,
        options: RunOptions,
    ) -> Self {
        let (cell, safeguards, audit) = (Arc::clone(&job.cell), options.safeguards.clone(), options.audit.clone());
        let watcher = Watcher::new(machine, control, live, cell, safeguards, audit, options.time_factor);
        let (next_step, has_to_locate) = (options.from_step, options.relocate.is_some());
        Self {
            mode,
            job,
            watcher,
            trigger,
            options,
            identities: None,
            next_step,
            sequence: 0,
            is_armed: false,
            has_to_locate,
            located: None,
            rejoins: false,
            scheduled_secs: 0.0,
            last_measured: None,
        }
    }

    /// Carries it out to its end, whatever that is.
    pub(super) async fn run(mut self) {
        let end = unless_panicking(self.run_to_end()).await;
        let request = match end {
            Ok(Ok(())) => None,
            Ok(Err(Halt::Stop(request))) => Some(request),
            // A pause is taken up where it arises.
            Ok(Err(Halt::Pause(_))) => Some(stop_now("a pause outside of a step")),
            Err(()) => Some(stop_now("a panic")),
        };
        // Devices that are released stream no more.
        let jitter = self.watcher.machine.jitter();
        let report = match unless_panicking(self.shut_down(request.clone())).await {
            Ok(report) => report,
            Err(()) => Some(self.stop_after_panic(request).await),
        };
        let event = report.as_ref().map_or(RunEvent::Finished, |report| RunEvent::Stopped(report.cause.clone()));
        let record = RunRecord { jitter, ..self.record(&event, report) };
        self.watcher.happen(event);
        self.watcher.control.end(record);
    }

    async fn run_to_end(&mut self) -> Result<(), Halt> {
        self.prepare().await?;
        self.watcher.happen(RunEvent::Prepared);
        self.wait_for_arm().await?;
        self.arm().await?;
        self.watcher.happen(RunEvent::Armed);
        if self.watcher.control.single_step {
            let expiry = self.options.safeguards.arm_expiry;
            self.wait_to_go_on(Some(expiry)).await?;
        }
        self.watcher.happen(RunEvent::Started);
        self.carry_out().await
    }

    async fn prepare(&mut self) -> Result<(), Halt> {
        let objections = gate::to_run(&self.job, self.options.from_step, self.options.speed_override);
        refuse(objections)?;
        let within = self.options.safeguards.connect_timeout;
        self.identities = Some(connect(&mut self.watcher, within).await?);
        self.watcher.tick().await?;
        Ok(())
    }

    async fn wait_for_arm(&mut self) -> Result<(), Halt> {
        while self.watcher.control.needs_arm() && !self.watcher.control.is_armed_by_client() {
            self.watcher.read().await?;
            self.watcher.rest(self.watcher.poll).await?;
        }
        Ok(())
    }

    /// Asks every condition once more, then takes the right to move.
    async fn arm(&mut self) -> Result<(), Halt> {
        let state = self.watcher.tick().await?;
        let here = state.configuration();
        let (_, nearest) = way::nearest(&way::points(&self.job.program, self.next_step), &here);
        let off = if self.rejoins { None } else { gate::to_start(&here, &nearest, &self.options.safeguards) };
        let moving = state.conditions().into_iter().filter(|(_, condition)| condition.moving);
        let moving = moving.map(|(device, _)| Objection::Moves(device));
        refuse(moving.chain(off).collect())?;
        // From here on devices may have the right, whatever they answer.
        self.is_armed = true;
        self.take_right().await?;
        self.watcher.tick().await.map(|_| ())
    }

    async fn take_right(&mut self) -> Result<(), Halt> {
        let (watchdog, within) = (self.options.safeguards.watchdog, self.options.safeguards.arm_timeout);
        let heartbeat = self.options.safeguards.heartbeat_timeout;
        let Watcher { machine, control, .. } = &mut self.watcher;
        let armed = control.guard_motion(heartbeat, machine.arm(watchdog, within)).await?;
        armed.map_err(|error| of_machine(error, Duration::ZERO))
    }

    /// Waits for a client to go on; stops where it takes too long.
    async fn wait_to_go_on(&mut self, expiry: Option<Duration>) -> Result<(), Halt> {
        let began = Instant::now();
        while !std::mem::take(&mut self.watcher.control.go_on) {
            if expiry.is_some_and(|expiry| began.elapsed() > expiry) {
                return Err(Halt::stop(StopCause::ArmExpired));
            }
            self.watcher.tick().await?;
            self.watcher.rest(self.watcher.poll).await?;
        }
        Ok(())
    }

    async fn carry_out(&mut self) -> Result<(), Halt> {
        while self.next_step < self.job.program.steps.len() {
            self.one_step().await?;
            if self.watcher.control.single_step && self.next_step < self.job.program.steps.len() {
                self.pause(PauseCause::SingleStep).await?;
            }
        }
        Ok(())
    }

    /// Carries out the next step, however often it is paused.
    async fn one_step(&mut self) -> Result<(), Halt> {
        let (mut attempts, mut real_secs) = (0, 0.0);
        loop {
            let (index, began) = (self.next_step, Instant::now());
            self.watcher.live.at_step(index);
            attempts += 1;
            let ended = self.step(index).await;
            real_secs += self.device_secs(began.elapsed());
            match ended {
                Ok(done) => {
                    self.note(index, done, attempts, real_secs);
                    self.next_step = index + 1;
                    // Told at once: whoever takes the run up after a crash in the pause that follows goes by it.
                    if self.next_step < self.job.program.steps.len() {
                        self.watcher.live.at_step(self.next_step);
                    }
                    return Ok(());
                }
                Err(Halt::Pause(PauseCause::Locating)) => {
                    self.pause(PauseCause::Locating).await?;
                    (attempts, real_secs) = (0, 0.0);
                }
                Err(Halt::Pause(cause)) => self.pause(cause).await?,
                Err(halt) => return Err(halt),
            }
        }
    }

    /// Comes to rest, waits for a client, and takes the right to move again; comes to rest once more where a pause is asked for before
    /// anything moves.
    async fn pause(&mut self, cause: PauseCause) -> Result<(), Halt> {
        let mut cause = cause;
        loop {
            self.rest_until_told(cause).await?;
            if !self.watcher.control.pauses_again {
                self.arm().await?;
            }
            self.watcher.happen(RunEvent::Resumed);
            // Whoever asked for it was told that the run is paused.
            if !self.watcher.control.pauses_again {
                return Ok(());
            }
            cause = PauseCause::Client;
        }
    }

    /// Comes to rest, and waits until a client tells the run to go on.
    async fn rest_until_told(&mut self, cause: PauseCause) -> Result<(), Halt> {
        (self.watcher.segment, self.watcher.standstill) = (None, None);
        let is_locating = cause == PauseCause::Locating;
        let control = &mut self.watcher.control;
        (control.go_on, control.leaves_pause, control.pauses_again) = (false, false, false);
        let asked = Instant::now();
        // In any other pause arm and table are at rest already.
        if cause == PauseCause::Client {
            self.watcher.happen(RunEvent::Stopping(None));
        }
        // A stop overtakes a pause whose rest is still awaited: it is told, and asked for, at once.
        let (stops, _) = tokio::select! {
            biased;
            request = self.watcher.control.stop_requested() => return Err(Halt::Stop(request)),
            rested = stop::stop(&mut self.watcher.machine, asked, |_| {}) => rested,
        };
        if !stop::is_complete(&stops) {
            let device =
                if stops[0].acknowledged.is_some() && stops[0].at_rest.is_some() { DeviceRole::Table } else { DeviceRole::Arm };
            let reason = "it did not come to rest for a pause; see what moves it, then start a new run from this step".to_owned();
            return Err(Halt::stop(StopCause::Device { device, error: DeviceError::NotReady { reason } }));
        }
        self.watcher.happen(RunEvent::Paused(cause));
        // A scanner that goes by the level would take captures all the while. What is not taken back in time is tried again at the end.
        let _ = self.watcher.during(timeout(WITHDRAWAL, self.trigger.withdraw())).await?;
        if is_locating {
            return self.wait_for_location().await;
        }
        self.wait_to_go_on(None).await?;
        self.watcher.control.leaves_pause = true;
        Ok(())
    }

    async fn wait_for_location(&mut self) -> Result<(), Halt> {
        let table_from_part = loop {
            if let Some(located) = self.watcher.control.located.take() {
                break located;
            }
            self.watcher.tick().await?;
            self.watcher.rest(self.watcher.poll).await?;
        };
        self.watcher.control.leaves_pause = true;
        let Some(relocate) = self.options.relocate.clone() else { return Ok(()) };
        let program = Arc::clone(&self.job.program);
        let search = CancelledOnDrop::default();
        let cancelled = Arc::clone(&search.0);
        let work = tokio::task::spawn_blocking(move || relocate.relocate(&program, &table_from_part, &cancelled));
        let relocated = self.watcher.during(work).await?.map_err(|error| internal(&error))?;
        let relocated = relocated.map_err(|misplaced| Halt::stop(StopCause::Misplaced(misplaced.to_string())))?;
        self.job.program = Arc::new(relocated.program);
        self.job.scene = Arc::new(relocated.scene.with_half_clearance());
        self.located = Some(table_from_part);
        // The view that located the part is taken again, from its new place.
        let before = self.job.program.steps.iter().take(self.next_step).rposition(|step| matches!(step, Step::Move(_)));
        (self.next_step, self.rejoins) = (before.unwrap_or(0), true);
        Ok(())
    }

    pub(super) fn note(&mut self, index: usize, done: Done, attempts: u32, real_secs: f64) {
        let commanded = way::commanded_before(&self.job.program, index + 1);
        let (capture_id, capture_took) = done.taken.map_or((None, None), |taken| (taken.id, Some(taken.took)));
        self.watcher.live.note(StepRecord {
            step: index,
            kind: done.kind,
            view: done.view,
            commanded,
            measured: done.measured,
            deviation: PoseDeviation::of(&self.job.cell, &commanded, &done.measured),
            planned_secs: self.job.program.steps.get(index).map_or(0.0, Step::secs),
            real_secs,
            attempts,
            capture_id,
            capture_took,
        });
    }

    pub(super) fn speed_override(&self) -> f64 {
        self.watcher.control.speed_in_force()
    }

    pub(super) fn paced(&self, secs: f64) -> Duration {
        Duration::from_secs_f64(secs / self.options.time_factor)
    }

    /// Counts what ran on the devices' clock since `began`: at most the `secs` that it was to take.
    pub(super) fn count_scheduled(&mut self, began: Instant, secs: f64) {
        self.scheduled_secs += secs.min(began.elapsed().as_secs_f64() * self.options.time_factor);
    }

    /// Time of a step in the devices' time, s. The host's own work takes as long whatever the clock of a twin: it is not scaled.
    pub(super) fn device_secs(&mut self, wall: Duration) -> f64 {
        wall.as_secs_f64() + std::mem::take(&mut self.scheduled_secs) * (1.0 - 1.0 / self.options.time_factor)
    }

    /// Stops, where something may move, and gives back.
    async fn shut_down(&mut self, request: Option<StopRequest>) -> Option<StopReport> {
        (self.watcher.segment, self.watcher.standstill) = (None, None);
        let report = match request {
            Some(StopRequest { cause, at }) => {
                let asked_secs = at.saturating_duration_since(self.watcher.live.began()).as_secs_f64();
                let [arm, table] = if self.is_armed { self.stop_both(&cause, at).await.map(Some) } else { [None, None] };
                Some(StopReport { cause, asked_secs, arm, table })
            }
            None => None,
        };
        // What cannot be given back is lost with the connection.
        let release = timeout(self.options.safeguards.request_timeout, self.watcher.machine.release());
        let _ = tokio::join!(release, timeout(WITHDRAWAL, self.trigger.withdraw()));
        report
    }

    /// Ends the run after a panic on its way to the end: whatever had been asked by then, arm and table are asked to stop once more.
    async fn stop_after_panic(&mut self, request: Option<StopRequest>) -> StopReport {
        let StopRequest { cause, at } = request.unwrap_or_else(|| stop_now("a panic while the devices were given back"));
        let asked_secs = at.saturating_duration_since(self.watcher.live.began()).as_secs_f64();
        if !self.is_armed {
            return StopReport { cause, asked_secs, arm: None, table: None };
        }
        let unknown = || DeviceStop { error: Some(stop::UNKNOWN.to_owned()), ..DeviceStop::default() };
        let work = async {
            self.begin_stop(&cause);
            stop::stop_once(&mut self.watcher.machine, at).await
        };
        let stopped = unless_panicking(timeout(2 * STOP_ATTEMPT, work)).await;
        let [arm, table] = stopped.ok().and_then(Result::ok).unwrap_or_else(|| [unknown(), unknown()]);
        StopReport { cause, asked_secs, arm: Some(arm), table: Some(table) }
    }

    /// Tells that a stop is sent, and hears no command any more.
    fn begin_stop(&mut self, cause: &StopCause) {
        self.watcher.happen(RunEvent::Stopping(Some(cause.clone())));
        self.watcher.control.refuse_commands();
    }

    async fn stop_both(&mut self, cause: &StopCause, asked: Instant) -> [DeviceStop; 2] {
        self.begin_stop(cause);
        let Watcher { machine, live, .. } = &mut self.watcher;
        let (stops, found) = stop::stop(machine, asked, |stops| live.at_stop(stops)).await;
        let [arm, table] = found.map(Option::unwrap_or_default);
        if let (Ok(joints_rad), Some(table_rad)) = (arm.try_into(), table.first()) {
            self.last_measured = Some(Configuration { joints_rad, table_rad: *table_rad });
        }
        stops
    }

    fn record(&self, event: &RunEvent, stop: Option<StopReport>) -> RunRecord {
        let (status, steps) = (self.watcher.live.status(), self.watcher.live.steps_from(0));
        RunRecord {
            status: status.after(event.clone()).unwrap_or(status),
            mode: self.mode,
            identities: self.identities.clone(),
            planned_secs: steps.iter().filter(|step| step.kind != StepKind::Locate).map(|step| step.planned_secs).sum(),
            real_secs: steps.iter().map(|step| step.real_secs).sum(),
            steps,
            next_step: self.next_step,
            speed_override: self.speed_override(),
            stop,
            objections: Vec::new(),
            last_measured: self.last_measured.or_else(|| self.watcher.last.map(|state| state.configuration())),
            located: self.located,
            jitter: None,
        }
    }
}

pub(super) async fn connect<M: Watch>(watcher: &mut Watcher<M>, within: Duration) -> Result<Identities, Halt> {
    let Watcher { machine, control, .. } = watcher;
    let connected = control.guard(machine.connect(within)).await?;
    connected.map_err(|error| of_machine(error, Duration::ZERO))
}

pub(super) fn refuse(objections: Vec<Objection>) -> Result<(), Halt> {
    if objections.is_empty() { Ok(()) } else { Err(Halt::stop(StopCause::Objections(objections))) }
}

pub(super) fn internal(error: &tokio::task::JoinError) -> Halt {
    Halt::stop(StopCause::Internal(error.to_string()))
}

pub(super) fn stop_now(what: &str) -> StopRequest {
    StopRequest { cause: StopCause::Internal(what.to_owned()), at: Instant::now() }
}

/// The output of `work`, or an error where it panics: devices are stopped all the same.
pub(super) async fn unless_panicking<T>(work: impl Future<Output = T>) -> Result<T, ()> {
    let mut work = pin!(work);
    std::future::poll_fn(|cx| match catch_unwind(AssertUnwindSafe(|| work.as_mut().poll(cx))) {
        Ok(Poll::Ready(output)) => Poll::Ready(Ok(output)),
        Ok(Poll::Pending) => Poll::Pending,
        Err(_) => Poll::Ready(Err(())),
    })
    .await
}
