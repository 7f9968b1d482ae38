//! Set points of a streamed way: from rest to rest along a straight line in joint space, all axes together, within the speeds and
//! accelerations of a target; a stop is a ramp on the same line.
//!
//! A target's speeds are shares of one synchronised motion from where the program has the arm. The arm stands a little beside: an
//! axis that hardly moves by the program must not hold up the others while it makes that up, so each may be faster than its share by
//! what [`BESIDE_RAD`] takes. The axis that has the furthest to go keeps to its share exactly.

use std::time::Duration;

use crate::execution::device::Target;
use crate::execution::profile::Trapezoid;

/// Distance from the program's place that is made up on the way, radians: a twentieth of a degree.
const BESIDE_RAD: f64 = 0.05 * std::f64::consts::PI / 180.0;

/// Set points of `N` axes, a cycle after the other.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct SetPoints<const N: usize> {
    /// Set point of now, radians.
    at_rad: [f64; N],
    line: Option<Line<N>>,
}

#[derive(Clone, Debug, PartialEq)]
struct Line<const N: usize> {
    from_rad: [f64; N],
    to_rad: [f64; N],
    way: Trapezoid,
    secs: f64,
    /// Time from which it brakes.
    braking_from: Option<f64>,
}

/// Rate of the fraction of a line, 1/s, and its change, 1/s².
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Rates {
    pub(crate) rate_per_s: f64,
    pub(crate) change_per_s2: f64,
}

impl<const N: usize> SetPoints<N> {
    /// At rest.
    pub(crate) fn still(at_rad: [f64; N]) -> Self {
        Self { at_rad, line: None }
    }

    /// Set point of now, radians.
    pub(crate) fn at_rad(&self) -> [f64; N] {
        self.at_rad
    }

    /// Returns true until the end of the line, or of the ramp.
    pub(crate) fn is_moving(&self) -> bool {
        self.line.is_some()
    }

    /// Time until it stands.
    pub(crate) fn left(&self) -> Duration {
        let secs = self.line.as_ref().map_or(0.0, |line| line.ends_at_secs() - line.secs);
        Duration::try_from_secs_f64(secs).unwrap_or_default()
    }

    /// Sets out for a target, from where the set point is.
    pub(crate) fn go(&mut self, target: &Target<N>) {
        let (from_rad, to_rad) = (self.at_rad, target.positions_rad);
        let way = Rates::of(target, &from_rad).and_then(Rates::trapezoid);
        self.line = way.map(|way| Line { from_rad, to_rad, way, secs: 0.0, braking_from: None });
    }

    /// Slows down to rest, on the line.
    pub(crate) fn ramp_down(&mut self) {
        if let Some(line) = &mut self.line {
            line.braking_from.get_or_insert(line.secs);
        }
    }

    /// Goes back by a cycle whose set point was not taken: the next one lies a cycle beyond the last that was, and the arm does not
    /// catch up in a jump.
    pub(crate) fn take_back(&mut self, cycle: Duration) {
        if let Some(line) = &mut self.line {
            line.secs = (line.secs - cycle.as_secs_f64()).max(line.braking_from.unwrap_or(0.0));
        }
    }

    /// The set point after a further cycle.
    pub(crate) fn advance(&mut self, cycle: Duration) -> [f64; N] {
        if let Some(line) = &mut self.line {
            line.secs += cycle.as_secs_f64();
            let share = line.share();
            self.at_rad = std::array::from_fn(|axis| line.position_rad(axis, share));
            if line.secs >= line.ends_at_secs() {
                self.line = None;
            }
        }
        self.at_rad
    }
}

impl<const N: usize> Line<N> {
    fn share(&self) -> f64 {
        match self.braking_from {
            Some(from) => self.way.braking(from, self.secs - from),
            None => self.way.share(self.secs),
        }
    }

    fn ends_at_secs(&self) -> f64 {
        self.braking_from.map_or(self.way.secs(), |from| from + self.way.braked(from).1)
    }

    fn position_rad(&self, axis: usize, share: f64) -> f64 {
        let (from, to) = (self.from_rad[axis], self.to_rad[axis]);
        if share >= 1.0 { to } else { from + share * (to - from) }
    }
}

impl Rates {
    /// The fastest for a target, from a place; `None` where nothing is to move.
    pub(crate) fn of<const N: usize>(target: &Target<N>, from_rad: &[f64; N]) -> Option<Self> {
        let travel = |axis: usize| (target.positions_rad[axis] - from_rad[axis]).abs();
        let (speeds, accelerations) = (&target.max_speed_rad_s, &target.max_acceleration_rad_s2);
        let may_move = |axis: &usize| speeds[*axis] > 0.0 && travel(*axis) > 0.0;
        let leader = (0..N).filter(may_move).max_by(|a, b| travel(*a).total_cmp(&travel(*b)))?;
        let smallest = |limits: &[f64; N]| {
            let exact = limits[leader] / travel(leader).max(BESIDE_RAD);
            (0..N).map(|axis| (limits[axis] + exact * BESIDE_RAD) / travel(axis)).fold(exact, f64::min)
        };
        let rates = Self { rate_per_s: smallest(speeds), change_per_s2: smallest(accelerations) };
        let slower = (target.duration.as_secs_f64() / rates.trapezoid()?.secs()).max(1.0);
        Some(Self { rate_per_s: rates.rate_per_s / slower, change_per_s2: rates.change_per_s2 / (slower * slower) })
    }

    fn trapezoid(self) -> Option<Trapezoid> {
        Trapezoid::within(&[1.0], &[self.rate_per_s], &[self.change_per_s2])
    }
}

#[cfg(test)]
mod tests;
