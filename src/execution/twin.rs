//! Kinematic twin of an arm and a table: the devices of a simulated run. They follow each target by the trapezoid that the program's
//! times are predicted with, brake along the way when stopped, and can be planted with errors and faults.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::time::{Instant, sleep};

use super::device::{Capture, Captured, Condition, DeviceError, DeviceState, FaultCode, Identity, MotionDevice, Target, Trigger};
use super::drivers::stream::NOT_ARMED;
use super::profile::Trapezoid;

/// Error or fault that is planted in a twin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Planted {
    /// Emergency stop.
    EmergencyStop,
    /// Guard open.
    GuardOpen,
    /// Guided by hand.
    HandGuided,
    /// Paused at its controller.
    Held,
    /// Drives without power.
    PowerLost,
    /// Brakes closed.
    BrakesClosed,
    /// Fault.
    Fault(FaultCode),
    /// Answers nothing.
    Silent,
    /// Answers so much later.
    Late(Duration),
    /// Reads states of that age.
    Aged(Duration),
    /// Closes the connection at every request.
    Closed,
    /// Refuses every target.
    Refuses,
    /// Accepts targets and stays.
    Stuck,
    /// Leaves its way by that much on its first axis, radians.
    OffWay(f64),
    /// Measures NaN.
    NotANumber,
}

/// Requests to a twin so far, for tests of what must not be asked.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Asked {
    /// Number of targets accepted.
    pub targets: u64,
    /// Sequence of the last.
    pub last_sequence: u64,
    /// Number of targets after a stop and before a new arm, or before any.
    pub targets_unarmed: u64,
    /// Number of targets whose sequence did not rise.
    pub targets_out_of_order: u64,
    /// Number of stops.
    pub stops: u64,
    /// Number of times armed.
    pub arms: u64,
    /// Number of times the watchdog was fed.
    pub keep_alives: u64,
}

#[derive(Debug)]
struct Motion<const N: usize> {
    began: Instant,
    from_rad: [f64; N],
    to_rad: [f64; N],
    way: Trapezoid,
    braking_from: Option<Instant>,
}

#[derive(Debug)]
struct Body<const N: usize> {
    rest_rad: [f64; N],
    motion: Option<Motion<N>>,
    /// Constant error of what is measured.
    error_rad: [f64; N],
    planted: Option<Planted>,
    is_armed: bool,
    watchdog: Option<(Duration, Instant)>,
    factor: f64,
    asked: Asked,
}

/// A device that moves in time alone.
#[derive(Debug)]
pub struct Twin<const N: usize>(Arc<Mutex<Body<N>>>);

/// Way into a twin while a session holds it: to plant errors, and to see where it is.
#[derive(Clone, Debug)]
pub struct TwinAccess<const N: usize>(Arc<Mutex<Body<N>>>);

impl<const N: usize> Twin<N> {
    /// A twin at rest; its time runs `factor` times as quickly.
    #[must_use]
    pub fn at(positions_rad: [f64; N], factor: f64) -> Self {
        Self(Arc::new(Mutex::new(Body {
            rest_rad: positions_rad,
            motion: None,
            error_rad: [0.0; N],
            planted: None,
            is_armed: false,
            watchdog: None,
            factor,
            asked: Asked::default(),
        })))
    }

    /// A way into it.
    #[must_use]
    pub fn access(&self) -> TwinAccess<N> {
        TwinAccess(Arc::clone(&self.0))
    }

    /// Waits as long as the planted fault says, and fails where it says so.
    async fn answer(&self) -> Result<(), DeviceError> {
        let planted = lock(&self.0).planted;
        if let Some(Planted::Late(by)) = planted {
            sleep(by).await;
        }
        if planted == Some(Planted::Silent) {
            std::future::pending::<()>().await;
        }
        if planted == Some(Planted::Closed) { Err(DeviceError::Closed { reason: "planted".into() }) } else { Ok(()) }
    }
}

impl<const N: usize> TwinAccess<N> {
    /// Plants a fault in place of the last, or takes it away.
    pub fn plant(&self, planted: Option<Planted>) {
        let mut body = lock(&self.0);
        body.settle(Instant::now());
        if matches!(planted, Some(Planted::EmergencyStop | Planted::PowerLost | Planted::BrakesClosed | Planted::Fault(_))) {
            body.brake(Instant::now());
        }
        body.planted = planted;
    }

    /// Adds a constant error to what is measured.
    pub fn mismeasure(&self, error_rad: [f64; N]) {
        lock(&self.0).error_rad = error_rad;
    }

    /// Positions now, without any error.
    #[must_use]
    pub fn positions_rad(&self) -> [f64; N] {
        let mut body = lock(&self.0);
        body.settle(Instant::now());
        body.positions_rad(Instant::now())
    }

    /// Returns true if it moves now.
    #[must_use]
    pub fn is_moving(&self) -> bool {
        let mut body = lock(&self.0);
        body.settle(Instant::now());
        body.motion.is_some()
    }

    /// Requests so far.
    #[must_use]
    pub fn asked(&self) -> Asked {
        lock(&self.0).asked
    }
}

impl<const N: usize> MotionDevice<N> for Twin<N> {
    async fn connect(&mut self) -> Result<Identity, DeviceError> {
        self.answer().await?;
        let model = format!("kinematic twin, {N} {}", if N == 1 { "axis" } else { "axes" });
        Ok(Identity { maker: "Vantage".into(), model, serial: None, firmware: None })
    }

    async fn state(&mut self) -> Result<DeviceState<N>, DeviceError> {
        self.answer().await?;
        let (mut body, now) = (lock(&self.0), Instant::now());
        body.settle(now);
        Ok(body.state(now))
    }

    async fn arm(&mut self, watchdog: Duration) -> Result<(), DeviceError> {
        self.answer().await?;
        let mut body = lock(&self.0);
        (body.is_armed, body.watchdog) = (true, Some((watchdog, Instant::now())));
        body.asked.arms += 1;
        Ok(())
    }

    async fn start(&mut self, target: &Target<N>) -> Result<(), DeviceError> {
        self.answer().await?;
        lock(&self.0).start(target, Instant::now())
    }

    async fn keep_alive(&mut self) -> Result<(), DeviceError> {
        self.answer().await?;
        let mut body = lock(&self.0);
        body.settle(Instant::now());
        body.asked.keep_alives += 1;
        if let Some((_, fed)) = &mut body.watchdog {
            *fed = Instant::now();
        }
        Ok(())
    }

    async fn stop(&mut self, sent_at: &mut Option<Instant>) -> Result<Instant, DeviceError> {
        if lock(&self.0).planted != Some(Planted::Closed) {
            sent_at.get_or_insert_with(Instant::now);
        }
        self.answer().await?;
        let mut body = lock(&self.0);
        body.settle(Instant::now());
        body.brake(Instant::now());
        body.asked.stops += 1;
        Ok(Instant::now())
    }

    async fn release(&mut self) -> Result<(), DeviceError> {
        self.answer().await?;
        let mut body = lock(&self.0);
        (body.is_armed, body.watchdog) = (false, None);
        Ok(())
    }

    fn fault_text(&self, _fault: FaultCode) -> Option<&'static str> {
        Some("planted")
    }
}

impl<const N: usize> Body<N> {
    fn start(&mut self, target: &Target<N>, now: Instant) -> Result<(), DeviceError> {
        self.settle(now);
        if !self.is_armed {
            self.asked.targets_unarmed += 1;
            return Err(DeviceError::NotReady { reason: NOT_ARMED.into() });
        }
        if self.motion.is_some() || self.planted == Some(Planted::Refuses) {
            return Err(DeviceError::Refused { code: 20004, text: "it moves already, or a refusal is planted".into() });
        }
        if target.sequence <= self.asked.last_sequence {
            self.asked.targets_out_of_order += 1;
        }
        self.asked.targets += 1;
        self.asked.last_sequence = target.sequence;
        let travel = std::array::from_fn(|axis| target.positions_rad[axis] - self.rest_rad[axis]);
        if self.planted != Some(Planted::Stuck)
            && let Some(way) = Trapezoid::within(&travel, &target.max_speed_rad_s, &target.max_acceleration_rad_s2)
        {
            let (from_rad, to_rad) = (self.rest_rad, target.positions_rad);
            self.motion = Some(Motion { began: now, from_rad, to_rad, way, braking_from: None });
        }
        Ok(())
    }

    fn brake(&mut self, now: Instant) {
        self.is_armed = false;
        if let Some(motion) = &mut self.motion {
            motion.braking_from.get_or_insert(now);
        }
    }

    /// Ends a motion that is over; a watchdog that was not fed brakes.
    fn settle(&mut self, now: Instant) {
        if let Some((watchdog, fed)) = self.watchdog
            && now > fed + watchdog
        {
            self.brake(fed + watchdog);
        }
        let factor = self.factor;
        if let Some(motion) = &self.motion
            && motion.is_over(now, factor)
        {
            self.rest_rad = motion.positions_rad(now, factor);
            self.motion = None;
        }
    }

    fn positions_rad(&self, now: Instant) -> [f64; N] {
        self.motion.as_ref().map_or(self.rest_rad, |motion| motion.positions_rad(now, self.factor))
    }

    fn state(&self, now: Instant) -> DeviceState<N> {
        let (mut at, mut condition) =
            (now, Condition { moving: self.motion.is_some(), in_position: self.motion.is_none(), ..Condition::READY });
        let mut positions_rad = self.positions_rad(now);
        for (position, error) in positions_rad.iter_mut().zip(self.error_rad) {
            *position += error;
        }
        match self.planted {
            Some(Planted::EmergencyStop) => condition.emergency_stop = true,
            Some(Planted::GuardOpen) => condition.guard_open = true,
            Some(Planted::HandGuided) => condition.hand_guided = true,
            Some(Planted::Held) => condition.paused = true,
            Some(Planted::PowerLost) => condition.powered = false,
            Some(Planted::BrakesClosed) => condition.brakes_open = false,
            Some(Planted::Fault(fault)) => condition.fault = Some(fault),
            Some(Planted::Aged(by)) => at = now.checked_sub(by).unwrap_or(now),
            Some(Planted::OffWay(by)) => positions_rad[0] += by,
            Some(Planted::NotANumber) => positions_rad[0] = f64::NAN,
            Some(Planted::Silent | Planted::Late(_) | Planted::Closed | Planted::Refuses | Planted::Stuck) | None => {}
        }
        DeviceState { at, positions_rad, condition }
    }
}

impl<const N: usize> Motion<N> {
    fn secs(&self, until: Instant, factor: f64) -> f64 {
        until.saturating_duration_since(self.began).as_secs_f64() * factor
    }

    fn share(&self, now: Instant, factor: f64) -> f64 {
        let Some(braking) = self.braking_from else { return self.way.share(self.secs(now, factor)) };
        let (from, now) = (self.secs(braking, factor), self.secs(now, factor));
        self.way.braking(from, now - from)
    }

    fn is_over(&self, now: Instant, factor: f64) -> bool {
        let Some(braking) = self.braking_from else { return self.secs(now, factor) >= self.way.secs() };
        let from = self.secs(braking, factor);
        self.secs(now, factor) - from >= self.way.braked(from).1
    }

    fn positions_rad(&self, now: Instant, factor: f64) -> [f64; N] {
        let share = self.share(now, factor);
        // At the end to the bit.
        let at = |axis: usize| self.from_rad[axis] + share * (self.to_rad[axis] - self.from_rad[axis]);
        std::array::from_fn(|axis| if share >= 1.0 { self.to_rad[axis] } else { at(axis) })
    }
}

fn lock<T>(body: &Mutex<T>) -> MutexGuard<'_, T> {
    body.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A trigger that takes each capture's predicted time.
#[derive(Debug)]
pub struct TwinTrigger {
    factor: f64,
    is_silent: Arc<Mutex<bool>>,
}

/// Way into a twin's trigger while a session holds it.
#[derive(Clone, Debug)]
pub struct TriggerAccess(Arc<Mutex<bool>>);

impl TwinTrigger {
    /// A trigger whose time runs `factor` times as quickly.
    #[must_use]
    pub fn new(factor: f64) -> Self {
        Self { factor, is_silent: Arc::new(Mutex::new(false)) }
    }

    /// A way into it.
    #[must_use]
    pub fn access(&self) -> TriggerAccess {
        TriggerAccess(Arc::clone(&self.is_silent))
    }
}

impl TriggerAccess {
    /// Keeps acknowledgements back, or gives them again.
    pub fn silence(&self, is_silent: bool) {
        *lock(&self.0) = is_silent;
    }
}

impl Trigger for TwinTrigger {
    async fn set_brightness(&mut self, _level: u8) -> Result<(), DeviceError> {
        Ok(())
    }

    async fn capture(&mut self, capture: &Capture) -> Result<Captured, DeviceError> {
        let began = Instant::now();
        if *lock(&self.is_silent) {
            sleep(capture.deadline).await;
            return Err(DeviceError::Silent { waited: capture.deadline });
        }
        sleep(capture.expected.div_f64(self.factor)).await;
        let took = began.elapsed() + capture.expected.mul_f64(1.0 - 1.0 / self.factor);
        Ok(Captured { id: Some(format!("{}-{}", capture.step, capture.view)), took })
    }
}

#[cfg(test)]
mod tests;
