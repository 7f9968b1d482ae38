//! Set points of a streamed way: from rest to rest along a straight line in joint space, all axes together, within the speed and the
//! acceleration of each; a stop is a ramp along the same line. The fraction s of the line runs a trapezoid of speed v and
//! acceleration a: v = min vᵢ / |Δqᵢ|, a = min aᵢ / |Δqᵢ|, both slowed down where the target asks for more time.

use std::time::Duration;

use crate::execution::device::Target;

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
    law: Law,
    secs: f64,
}

/// Fraction of the line by time.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Law {
    /// From 0 to 1.
    Trapezoid { speed: f64, acceleration: f64 },
    /// From a fraction on, until it stands.
    Ramp { fraction: f64, speed: f64, acceleration: f64 },
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
        let secs = self.line.as_ref().map_or(0.0, |line| line.law.secs() - line.secs);
        Duration::try_from_secs_f64(secs).unwrap_or_default()
    }

    /// Sets out for a target, from where the set point is.
    pub(crate) fn go(&mut self, target: &Target<N>) {
        let (from_rad, to_rad) = (self.at_rad, target.positions_rad);
        let law = Law::within(target, &from_rad);
        self.line = law.map(|law| Line { from_rad, to_rad, law, secs: 0.0 });
    }

    /// Slows down to rest, on the line.
    pub(crate) fn ramp_down(&mut self) {
        if let Some(line) = &mut self.line
            && let Law::Trapezoid { acceleration, .. } = line.law
        {
            let (fraction, speed) = line.law.at(line.secs);
            line.law = Law::Ramp { fraction, speed, acceleration };
            line.secs = 0.0;
        }
    }

    /// The set point after a further cycle.
    pub(crate) fn advance(&mut self, cycle: Duration) -> [f64; N] {
        if let Some(line) = &mut self.line {
            line.secs += cycle.as_secs_f64();
            let (fraction, _) = line.law.at(line.secs);
            let is_over = line.secs >= line.law.secs();
            self.at_rad = std::array::from_fn(|axis| line.position_rad(axis, fraction));
            if is_over {
                self.line = None;
            }
        }
        self.at_rad
    }
}

impl<const N: usize> Line<N> {
    fn position_rad(&self, axis: usize, fraction: f64) -> f64 {
        let (from, to) = (self.from_rad[axis], self.to_rad[axis]);
        if fraction >= 1.0 { to } else { from + fraction * (to - from) }
    }
}

impl Law {
    /// The fastest that keeps to a target's limits and time; `None` where there is no way to go.
    fn within<const N: usize>(target: &Target<N>, from_rad: &[f64; N]) -> Option<Self> {
        let smallest = |limits: &[f64; N]| {
            let ratio = |axis: usize| limits[axis] / (target.positions_rad[axis] - from_rad[axis]).abs();
            (0..N).map(ratio).fold(f64::INFINITY, f64::min)
        };
        let (speed, acceleration) = (smallest(&target.max_speed_rad_s), smallest(&target.max_acceleration_rad_s2));
        if !(speed.is_finite() && acceleration.is_finite() && speed > 0.0 && acceleration > 0.0) {
            return None;
        }
        let shortest = Self::Trapezoid { speed, acceleration };
        let slower = (target.duration.as_secs_f64() / shortest.secs()).max(1.0);
        Some(Self::Trapezoid { speed: speed / slower, acceleration: acceleration / (slower * slower) })
    }

    /// Time until it stands.
    fn secs(self) -> f64 {
        match self {
            Self::Trapezoid { speed, acceleration } if speed * speed >= acceleration => 2.0 / acceleration.sqrt(),
            Self::Trapezoid { speed, acceleration } => 1.0 / speed + speed / acceleration,
            Self::Ramp { speed, acceleration, .. } => speed / acceleration,
        }
    }

    /// Fraction and its speed at a time.
    fn at(self, secs: f64) -> (f64, f64) {
        let whole = self.secs();
        match self {
            Self::Trapezoid { speed, acceleration } => {
                let ramp_secs = (speed / acceleration).min(0.5 * whole);
                let left_secs = (whole - secs).max(0.0);
                if secs < ramp_secs {
                    (0.5 * acceleration * secs * secs, acceleration * secs)
                } else if left_secs < ramp_secs {
                    (1.0 - 0.5 * acceleration * left_secs * left_secs, acceleration * left_secs)
                } else {
                    (0.5 * acceleration * ramp_secs * ramp_secs + acceleration * ramp_secs * (secs - ramp_secs), speed)
                }
            }
            Self::Ramp { fraction, speed, acceleration } => {
                let secs = secs.min(whole);
                (fraction + speed * secs - 0.5 * acceleration * secs * secs, speed - acceleration * secs)
            }
        }
    }
}

#[cfg(test)]
mod tests;
