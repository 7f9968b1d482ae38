//! Motion along a straight segment in joint space, from rest to rest: the trapezoid of `cell::Axes::move_secs`, sampled; and the
//! braking from anywhere on it. A target's speeds and accelerations are those of one synchronised motion, so every device that
//! follows them for its own axes keeps in step with the others.

use std::time::Duration;

use super::device::Target;
use crate::cell::{Axes, Configuration};

/// Share of the way as a function of time: rises from 0 to 1 with limited rate and change of rate, at rest at both ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Trapezoid {
    rate_per_s: f64,
    change_per_s2: f64,
}

impl Trapezoid {
    /// The quickest within these limits for each axis, over its travel; `None` where no axis moves, or one that has to move may not.
    #[must_use]
    pub fn within<const N: usize>(travel_rad: &[f64; N], speed: &[f64; N], acceleration: &[f64; N]) -> Option<Self> {
        let least = |limits: &[f64; N]| {
            let shares = limits.iter().zip(travel_rad).filter(|(_, travel)| **travel != 0.0);
            shares.map(|(limit, travel)| limit / travel.abs()).fold(f64::INFINITY, f64::min)
        };
        let (rate_per_s, change_per_s2) = (least(speed), least(acceleration));
        let is_motion = rate_per_s.is_finite() && rate_per_s > 0.0 && change_per_s2.is_finite() && change_per_s2 > 0.0;
        is_motion.then_some(Self { rate_per_s, change_per_s2 })
    }

    /// Time from rest to rest.
    #[must_use]
    pub fn secs(&self) -> f64 {
        let (top, ramp) = self.top();
        2.0 * ramp + (1.0 - top * ramp) / top
    }

    /// Share of the way at a time; 0 before and 1 after.
    #[must_use]
    pub fn share(&self, secs: f64) -> f64 {
        let (whole, (top, ramp)) = (self.secs(), self.top());
        let from_rest = |secs: f64| 0.5 * self.change_per_s2 * secs * secs;
        match secs {
            _ if secs <= 0.0 => 0.0,
            _ if secs < ramp => from_rest(secs),
            _ if secs <= whole - ramp => from_rest(ramp) + top * (secs - ramp),
            _ if secs < whole => 1.0 - from_rest(whole - secs),
            _ => 1.0,
        }
    }

    /// Change of the share at a time, 1/s.
    #[must_use]
    pub fn rate(&self, secs: f64) -> f64 {
        (self.change_per_s2 * secs.min(self.secs() - secs)).clamp(0.0, self.top().0)
    }

    /// Share at which it rests if it brakes from a time on, and the time that takes.
    #[must_use]
    pub fn braked(&self, secs: f64) -> (f64, f64) {
        let rate = self.rate(secs);
        let share = self.share(secs) + 0.5 * rate * rate / self.change_per_s2;
        (share.min(1.0), rate / self.change_per_s2)
    }

    /// Share at `since` seconds of braking from `secs` on.
    #[must_use]
    pub fn braking(&self, secs: f64, since: f64) -> f64 {
        let (rest, takes) = self.braked(secs);
        if since >= takes { rest } else { (rest - 0.5 * self.change_per_s2 * (takes - since).powi(2)).max(self.share(secs)) }
    }

    /// Largest rate that is reached, and the time to it.
    fn top(&self) -> (f64, f64) {
        let top = self.rate_per_s.min(self.change_per_s2.sqrt());
        (top, top / self.change_per_s2)
    }
}

/// The straight segment between two configurations as a target of seven axes; `None` where nothing moves.
#[must_use]
pub fn segment(axes: &Axes, from: &Configuration, to: &Configuration, speed_fraction: f64, sequence: u64) -> Option<Target<7>> {
    let travel_rad = from.travel_rad(to);
    let speeds = axes.0.map(|axis| axis.max_speed_rad_per_s * speed_fraction);
    let accelerations = axes.0.map(|axis| axis.max_acceleration_rad_per_s2 * speed_fraction);
    let motion = Trapezoid::within(&travel_rad, &speeds, &accelerations)?;
    Some(Target {
        sequence,
        positions_rad: to.axes_rad(),
        max_speed_rad_s: travel_rad.map(|travel| travel.abs() * motion.rate_per_s),
        max_acceleration_rad_s2: travel_rad.map(|travel| travel.abs() * motion.change_per_s2),
        duration: Duration::from_secs_f64(motion.secs()),
    })
}

#[cfg(test)]
mod tests;
