//! One step of a program on the devices: its way from wherever on it they stand, segment by segment; its standstill; its capture.

use std::sync::Arc;
use std::time::Duration;

use tokio::time::{Instant, timeout};

use super::cause::{PauseCause, StopCause};
use super::gate::{self, Objection};
use super::handle::Halt;
use super::machine::Drive;
use super::runner::{Runner, internal, refuse};
use super::watcher::{Watcher, of_machine};
use super::way;
use crate::cell::Configuration;
use crate::execution::device::{Capture, Captured, Trigger};
use crate::execution::located::moves_alone;
use crate::execution::profile::segment;
use crate::execution::record::StepKind;
use crate::planning::plan::ViewId;
use crate::program::{Move, Program, Step, interlock};

/// Time that a trigger is given beyond its own deadline.
const LATE: Duration = Duration::from_millis(200);

/// Outcome of a step.
pub(super) struct Done {
    pub(super) kind: StepKind,
    pub(super) view: Option<ViewId>,
    pub(super) measured: Configuration,
    pub(super) taken: Option<Captured>,
}

/// One straight piece of a move.
struct Segment<'a> {
    from: &'a Configuration,
    to: &'a Configuration,
    speed_fraction: f64,
    /// States in position that end it.
    cycles: u32,
}

impl<M: Drive, T: Trigger> Runner<M, T> {
    pub(super) async fn step(&mut self, index: usize) -> Result<Done, Halt> {
        let program = Arc::clone(&self.job.program);
        let Some(step) = program.steps.get(index) else { return Err(Halt::stop(StopCause::Internal("no such step".into()))) };
        match step {
            Step::Move(step) => self.travel(index, step).await,
            Step::Settle { secs } => {
                let began = Instant::now();
                let waited = self.watcher.during(tokio::time::sleep(self.paced(*secs))).await;
                self.count_scheduled(began, *secs);
                waited?;
                self.done(StepKind::Settle).await
            }
            Step::Scan { view, brightness, capture_secs } => {
                let (run, expected) = (self.options.run.clone(), Duration::from_secs_f64(*capture_secs));
                let deadline = expected + self.options.safeguards.trigger_timeout;
                let capture = Capture { run, step: index, view: view.0, brightness: *brightness, expected, deadline };
                self.scan(index, *view, &capture).await
            }
        }
    }

    /// Follows a polyline from wherever on it the devices stand.
    async fn travel(&mut self, index: usize, step: &Move) -> Result<Done, Halt> {
        let mut here = self.watcher.tick().await?.configuration();
        let points = if self.rejoins { self.rejoining(here, step).await? } else { way::points(&self.job.program, index) };
        let (passed, nearest) = way::nearest(&points, &here);
        refuse(gate::to_start(&here, &nearest, &self.options.safeguards).into_iter().collect())?;
        for (number, to) in points.iter().enumerate().skip(passed + 1) {
            let is_last = number + 1 == points.len();
            let cycles = if is_last { self.options.safeguards.in_position_cycles.max(1) } else { 1 };
            let segment = Segment { from: &points[number - 1], to, speed_fraction: step.speed_fraction, cycles };
            here = self.go(here, segment).await?;
        }
        // A pause on the way leaves it to rejoin the program.
        self.rejoins = false;
        Ok(Done { kind: StepKind::Move, view: None, measured: here, taken: None })
    }

    /// Points from where the devices stand to the target of a move. In a program that moves arm and table one after the other they do so
    /// here too: their controllers may not be able to move them together, or do not keep in step with each other.
    async fn rejoining(&mut self, here: Configuration, step: &Move) -> Result<Vec<Configuration>, Halt> {
        let to = step.target_rad;
        if !moves_alone(&self.job.program) {
            return Ok(vec![here, to]);
        }
        // A device that stands there already, within the tolerance, is left alone.
        let from = standing(&to, &to, &here, self.options.safeguards.position_tolerance_rad);
        let (job, straight) = (self.job.clone(), Step::Move(Move { via_rad: Vec::new(), ..step.clone() }));
        let work = tokio::task::spawn_blocking(move || {
            let alone = Program { home_rad: from, steps: vec![straight], ..Program::clone(&job.program) };
            interlock(&alone, &job.cell, &job.scene).map(|separate| way::points(&separate, 0))
        });
        let separate = self.watcher.during(work).await?.map_err(|error| internal(&error))?;
        separate.map_err(|together| Halt::stop(StopCause::Objections(vec![Objection::Collision(together.contact)])))
    }

    /// One segment: checked from where the devices were just measured, sent, and watched until it is reached; where they are then.
    async fn go(&mut self, here: Configuration, way: Segment<'_>) -> Result<Configuration, Halt> {
        let (safeguards, to) = (self.options.safeguards.clone(), way.to);
        let begin = standing(way.from, to, &here, safeguards.position_tolerance_rad);
        let speed = way.speed_fraction * self.speed_override();
        let Some(target) = segment(&self.job.cell.axes(), &begin, to, speed, self.sequence + 1) else {
            return self.reach(to, Duration::ZERO, way.cycles).await;
        };
        self.sequence += 1;
        let (job, checked) = (self.job.clone(), target.clone());
        let work = tokio::task::spawn_blocking(move || gate::to_target(&job, &here, &checked, &safeguards));
        let objection = self.watcher.during(work).await?.map_err(|error| internal(&error))?;
        refuse(objection.into_iter().collect())?;
        let now_here = self.watcher.tick().await?.configuration();
        refuse(gate::to_start(&now_here, &here, &self.options.safeguards).into_iter().collect())?;
        self.watcher.segment = Some((here, *to));
        let (within, heartbeat) = (self.options.safeguards.request_timeout, self.options.safeguards.heartbeat_timeout);
        let Watcher { machine, control, .. } = &mut self.watcher;
        let started = control.guard_motion(heartbeat, machine.start(&target, within)).await?;
        started.map_err(|error| of_machine(error, Duration::ZERO))?;
        let began = Instant::now();
        let reached = self.reach(to, self.paced(target.duration.as_secs_f64()), way.cycles).await;
        self.count_scheduled(began, target.duration.as_secs_f64());
        if reached.is_ok() {
            self.watcher.segment = None;
        }
        reached
    }

    /// Waits in position: so many fresh states in a row within the tolerance, at rest; the last of them.
    async fn reach(&mut self, to: &Configuration, predicted: Duration, cycles: u32) -> Result<Configuration, Halt> {
        let tolerance_rad = self.options.safeguards.position_tolerance_rad;
        let due = Instant::now() + predicted;
        let deadline = due + predicted / 2 + self.options.safeguards.reach_timeout;
        let mut reached = 0;
        loop {
            let state = self.watcher.tick().await?;
            let here = state.configuration();
            let (axis, off_rad) = gate::furthest_axis(to, &here);
            let is_at_rest = state.conditions().iter().all(|(_, condition)| condition.in_position && !condition.moving);
            // A device that has accepted a short way may not say yet that it moves.
            let is_due = Instant::now() >= due;
            reached = if is_due && is_at_rest && off_rad <= tolerance_rad { reached + 1 } else { 0 };
            if reached >= cycles {
                return Ok(here);
            }
            let now = Instant::now();
            if now > deadline {
                return Err(Halt::stop(StopCause::NotReached { axis, off_deg: off_rad.to_degrees() }));
            }
            // The first look after the predicted end is just behind it, and the others follow twice as quickly.
            let until_due = due.saturating_duration_since(now);
            let poll = self.watcher.poll;
            self.watcher.rest(if until_due.is_zero() { poll / 2 } else { poll.min(until_due) }).await?;
        }
    }

    async fn scan(&mut self, index: usize, view: ViewId, capture: &Capture) -> Result<Done, Halt> {
        let began = Instant::now();
        let to = way::commanded_before(&self.job.program, index);
        let here = self.watcher.tick().await?.configuration();
        refuse(gate::to_start(&here, &to, &self.options.safeguards).into_iter().collect())?;
        let taken = self.capture(capture).await?;
        let kind = if self.has_to_locate { StepKind::Locate } else { StepKind::Scan };
        let done = Done { kind, view: Some(view), measured: here, taken: Some(taken) };
        if std::mem::take(&mut self.has_to_locate) {
            let real_secs = self.device_secs(began.elapsed());
            self.note(index, done, 1, real_secs);
            return Err(Halt::Pause(PauseCause::Locating));
        }
        Ok(done)
    }

    async fn capture(&mut self, capture: &Capture) -> Result<Captured, Halt> {
        let (trigger, watcher) = (&mut self.trigger, &mut self.watcher);
        let deadline = capture.deadline;
        let late =
            || capture.unacknowledged("the trigger's driver did not end", "see what keeps the scanner or this machine busy");
        let work = async {
            trigger.set_brightness(capture.brightness).await?;
            // The trigger's own deadline comes first; one that does not keep it is not waited for either.
            timeout(deadline + LATE, trigger.capture(capture)).await.unwrap_or_else(|_| Err(late()))
        };
        let began = Instant::now();
        let taken = watcher.standing_still(timeout(deadline + 2 * LATE, work)).await;
        // A trigger that stays silent is waited for in real time.
        if matches!(taken, Ok(Ok(Ok(_)))) {
            self.count_scheduled(began, capture.expected.as_secs_f64());
        }
        let taken = taken?.unwrap_or_else(|_| Err(late()));
        let (step, view) = (capture.step, capture.view);
        taken.map_err(|error| Halt::Pause(PauseCause::Trigger { step, view, error }))
    }

    /// A step that ends where the devices stand now.
    async fn done(&mut self, kind: StepKind) -> Result<Done, Halt> {
        let measured = self.watcher.tick().await?.configuration();
        Ok(Done { kind, view: None, measured, taken: None })
    }
}

/// Beginning of a segment: where the devices are measured, save that one which has nowhere to go, and stands there within the
/// tolerance, is left alone.
fn standing(from: &Configuration, to: &Configuration, here: &Configuration, tolerance_rad: f64) -> Configuration {
    let stays = |part: &Configuration| !from.moves_arm(part) && gate::furthest_axis(part, here).1 <= tolerance_rad;
    let arm_to = Configuration { joints_rad: to.joints_rad, table_rad: here.table_rad };
    let joints_rad = if stays(&arm_to) { to.joints_rad } else { here.joints_rad };
    let table_off = (to.table_rad - here.table_rad).abs();
    let table_rad = if !from.turns_table(to) && table_off <= tolerance_rad { to.table_rad } else { here.table_rad };
    Configuration { joints_rad, table_rad }
}
