//! Axes that move in time: straight, synchronised segments from rest to rest, and braking on the way.

use crate::execution::profile::Trapezoid;

/// Motion under way.
#[derive(Clone, Copy, Debug)]
struct Segment<const N: usize> {
    began_secs: f64,
    from: [f64; N],
    to: [f64; N],
    way: Trapezoid,
    /// Time since the beginning at which it began to brake.
    braking_secs: Option<f64>,
}

/// Axes, at rest or in motion. Units are the caller's; times are seconds of simulated time and never fall.
#[derive(Clone, Debug)]
pub(super) struct MovingAxes<const N: usize> {
    rest: [f64; N],
    segment: Option<Segment<N>>,
}

impl<const N: usize> MovingAxes<N> {
    /// Axes at rest.
    pub(super) fn at(rest: [f64; N]) -> Self {
        Self { rest, segment: None }
    }

    /// Positions at a time.
    pub(super) fn positions(&self, now: f64) -> [f64; N] {
        let Some(segment) = self.segment else { return self.rest };
        let share = segment.share(now);
        if share >= 1.0 {
            return segment.to;
        }
        std::array::from_fn(|axis| segment.from[axis] + share * (segment.to[axis] - segment.from[axis]))
    }

    /// Speeds at a time.
    pub(super) fn speeds(&self, now: f64) -> [f64; N] {
        const STEP: f64 = 1e-4;
        let (here, there) = (self.positions(now), self.positions(now + STEP));
        std::array::from_fn(|axis| (there[axis] - here[axis]) / STEP)
    }

    /// Returns true if they move at a time.
    pub(super) fn is_moving(&self, now: f64) -> bool {
        self.segment.is_some_and(|segment| !segment.is_over(now))
    }

    /// Begins a segment within limits of each axis, from wherever they are; false if it cannot.
    pub(super) fn start(&mut self, to: [f64; N], speed: &[f64; N], acceleration: &[f64; N], now: f64) -> bool {
        let from = self.positions(now);
        let travel = std::array::from_fn(|axis| to[axis] - from[axis]);
        (self.rest, self.segment) = (from, None);
        let Some(way) = Trapezoid::within(&travel, speed, acceleration) else { return travel.iter().all(|axis| *axis == 0.0) };
        self.segment = Some(Segment { began_secs: now, from, to, way, braking_secs: None });
        true
    }

    /// Brakes with the acceleration of the segment.
    pub(super) fn brake(&mut self, now: f64) {
        if let Some(segment) = &mut self.segment {
            segment.braking_secs.get_or_insert(now - segment.began_secs);
        }
    }

    /// Puts them elsewhere at once, at rest.
    pub(super) fn place(&mut self, positions: [f64; N]) {
        *self = Self::at(positions);
    }
}

impl<const N: usize> Segment<N> {
    fn share(&self, now: f64) -> f64 {
        let secs = now - self.began_secs;
        match self.braking_secs {
            None => self.way.share(secs),
            Some(braking) => self.way.braking(braking, secs - braking),
        }
    }

    fn is_over(&self, now: f64) -> bool {
        let secs = now - self.began_secs;
        match self.braking_secs {
            None => secs >= self.way.secs(),
            Some(braking) => secs - braking >= self.way.braked(braking).1,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_arrive_together_and_rest_where_they_braked() {
        let mut axes = MovingAxes::at([0.0, 10.0]);
        assert!(axes.start([2.0, 9.0], &[1.0, 1.0], &[1.0, 1.0], 5.0));
        assert!((axes.positions(6.5)[0] - 1.0).abs() < 1e-9 && (axes.positions(6.5)[1] - 9.5).abs() < 1e-9);
        assert!(axes.is_moving(7.9) && !axes.is_moving(8.1));
        assert_eq!(axes.positions(8.1), [2.0, 9.0]);
        assert!(axes.start([0.0, 9.0], &[1.0, 1.0], &[1.0, 1.0], 10.0));
        axes.brake(11.5);
        // From 1 it brakes at 1 a second squared: half a unit further.
        assert!(axes.is_moving(12.0) && !axes.is_moving(12.6));
        assert!((axes.positions(20.0)[0] - 0.5).abs() < 1e-9, "{:?}", axes.positions(20.0));
    }
}
