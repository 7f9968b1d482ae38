//! Live state of a run: the status, and a stream of events with rising numbers of which the last are kept for who comes late.

use std::collections::VecDeque;
use std::sync::{Mutex, MutexGuard, PoisonError};

use tokio::sync::{broadcast, watch};
use tokio::time::Instant;

use super::cause::RunReason;
use super::state::{RunEvent, RunStatus};
use crate::cell::Configuration;
use crate::execution::record::{DeviceStop, StepRecord};
use crate::geometry::{Base, Pose, ScannerFrame};

/// Events that are kept for replay: a minute at 20 Hz.
const KEPT: usize = 1200;

/// One event.
#[derive(Clone, Debug, PartialEq)]
pub struct LiveEvent {
    /// Number, rising by one.
    pub id: u64,
    /// Time since the run was made, seconds.
    pub secs: f64,
    /// Status.
    pub status: RunStatus,
    /// Step that it is in, or that comes next, from 0.
    pub step: Option<usize>,
    /// Number of steps.
    pub steps: usize,
    /// Speed override in force.
    pub speed_override: f64,
    /// Measured joints and table angle.
    pub measured: Option<Configuration>,
    /// Measured pose of the scanner.
    pub base_from_scanner: Option<Pose<Base, ScannerFrame>>,
    /// Largest distance of an axis from its straight way, radians, while it moves.
    pub off_path_rad: Option<f64>,
    /// Stop that ends the run, of arm and table, as far as it has got; none before it is sent, and once the run has ended.
    pub stop: Option<[DeviceStop; 2]>,
}

/// Measured part of an event.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Measurement {
    pub(super) measured: Option<Configuration>,
    pub(super) base_from_scanner: Option<Pose<Base, ScannerFrame>>,
    pub(super) off_path_rad: Option<f64>,
}

#[derive(Debug)]
struct Last {
    events: VecDeque<LiveEvent>,
    next_id: u64,
    step: Option<usize>,
    speed_override: f64,
    measurement: Measurement,
    stop: Option<[DeviceStop; 2]>,
    /// Steps carried out.
    done: Vec<StepRecord>,
}

/// The live side of a run, shared by the run and its handles.
#[derive(Debug)]
pub(super) struct Live {
    began: Instant,
    steps: usize,
    last: Mutex<Last>,
    status: watch::Sender<RunStatus>,
    events: broadcast::Sender<LiveEvent>,
}

impl Live {
    pub(super) fn new(steps: usize, speed_override: f64) -> Self {
        let (events, measurement, done) = (VecDeque::new(), Measurement::default(), Vec::new());
        let last = Last { events, next_id: 1, step: None, speed_override, measurement, stop: None, done };
        let live = Self {
            began: Instant::now(),
            steps,
            last: Mutex::new(last),
            status: watch::Sender::new(RunStatus::FIRST),
            events: broadcast::Sender::new(KEPT),
        };
        live.tell(|_| {});
        live
    }

    pub(super) fn began(&self) -> Instant {
        self.began
    }

    pub(super) fn status(&self) -> RunStatus {
        self.status.borrow().clone()
    }

    pub(super) fn watch_status(&self) -> watch::Receiver<RunStatus> {
        self.status.subscribe()
    }

    /// Takes the status further; returns false where the event does not happen in its state.
    pub(super) fn happen(&self, event: RunEvent) -> bool {
        let next = self.status.borrow().after(event);
        let Some(next) = next else { return false };
        let ends = matches!(next.reason, RunReason::Stopping(Some(_)));
        self.status.send_replace(next);
        self.tell(|last| last.stop = ends.then(<[DeviceStop; 2]>::default));
        true
    }

    /// Tells how far the stop that was sent has got.
    pub(super) fn at_stop(&self, stop: &[DeviceStop; 2]) {
        self.tell(|last| last.stop = Some(stop.clone()));
    }

    /// Tells the step that it is in, or that comes next; once.
    pub(super) fn at_step(&self, step: usize) {
        if self.last().step != Some(step) {
            self.tell(|last| last.step = Some(step));
        }
    }

    /// Notes a step that was carried out.
    pub(super) fn note(&self, step: StepRecord) {
        self.last().done.push(step);
    }

    /// Steps carried out, from the `first` on.
    pub(super) fn steps_from(&self, first: usize) -> Vec<StepRecord> {
        self.last().done.get(first..).unwrap_or_default().to_vec()
    }

    pub(super) fn at_override(&self, speed_override: f64) {
        self.tell(|last| last.speed_override = speed_override);
    }

    pub(super) fn speed_override(&self) -> f64 {
        self.last().speed_override
    }

    pub(super) fn measured(&self, measurement: Measurement) {
        self.tell(|last| last.measurement = measurement);
    }

    /// Events after a number, as far as they are kept, and those that follow.
    pub(super) fn events_after(&self, id: u64) -> (Vec<LiveEvent>, broadcast::Receiver<LiveEvent>) {
        let last = self.last();
        let kept = last.events.iter().filter(|event| event.id > id).cloned().collect();
        (kept, self.events.subscribe())
    }

    pub(super) fn latest(&self) -> Option<LiveEvent> {
        self.last().events.back().cloned()
    }

    fn tell(&self, change: impl FnOnce(&mut Last)) {
        let status = self.status();
        let mut last = self.last();
        change(&mut last);
        let Measurement { measured, base_from_scanner, off_path_rad } = last.measurement;
        let event = LiveEvent {
            id: last.next_id,
            secs: self.began.elapsed().as_secs_f64(),
            status,
            step: last.step,
            steps: self.steps,
            speed_override: last.speed_override,
            measured,
            base_from_scanner,
            off_path_rad,
            stop: last.stop.clone(),
        };
        last.next_id += 1;
        last.events.push_back(event.clone());
        if last.events.len() > KEPT {
            last.events.pop_front();
        }
        // Nobody may be listening. Sent under the lock: numbers reach every listener in order.
        let _ = self.events.send(event);
    }

    fn last(&self) -> MutexGuard<'_, Last> {
        self.last.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
