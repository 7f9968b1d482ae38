//! Time-optimal parameterisation of a path that is run without stopping at its points: every corner is rounded by a parabola
//! within a stated tolerance, and the curve is run as quickly as the axes' speeds and accelerations allow, from rest to rest,
//! by reachability analysis (H. Pham and Q.-C. Pham, "A New Approach to Time-Optimal Path Parameterization Based on
//! Reachability Analysis", IEEE Trans. Robotics 34(3), 2018, TOPP-RA).
//!
//! The curve q(s) has pieces of constant second derivative. With x = ṡ² and u = s̈ the limits are |q'_k|² x ≤ v_k² and
//! |q'_k u + q''_k x| ≤ a_k, and x' = x + 2 Δ u from one grid point to the next. Backwards over the grid, the largest x from
//! which the end can still be reached; forwards, the largest u that stays below it. Cost: microseconds a grid point.

use super::axis::{Axes, Configuration};

/// Grid points of a path, of each straight piece and of each bend at least: a limit that is met between two grid points is
/// met a little late.
const GRID: f64 = 400.0;
const GRID_OF_A_LINE: usize = 100;
const GRID_OF_A_BEND: usize = 32;
/// Pieces shorter than this are none, radians along the path.
const NOTHING_RAD: f64 = 1e-12;
/// Shares of the grid that differ by less are the same, whatever a file did to the points.
const ROUNDING: f64 = 1e-6;
/// Largest distance of a chord from a bend in any axis, radians: a tenth of a millimetre at the end of a long arm.
const CHORD_RAD: f64 = 1e-5;
/// Directions that differ by less are one: what is left of a straight way that went through a file.
const STRAIGHT: f64 = 1e-7;

/// A curve in joint space whose direction never jumps.
#[derive(Clone, Debug, PartialEq)]
pub struct SmoothPath {
    pieces: Vec<Piece>,
}

/// q(t) = start + t·slope + ½ t²·bend for t from 0 to `length_rad`; the slope has length one where there is no bend.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Piece {
    /// Range of the parameter, radians along the path.
    pub length_rad: f64,
    /// q at its beginning.
    pub start_rad: Configuration,
    /// q' there.
    pub slope: [f64; 7],
    /// q'', 1/rad.
    pub bend_per_rad: [f64; 7],
}

impl Piece {
    fn is_straight(&self) -> bool {
        self.bend_per_rad.iter().all(|bend| *bend == 0.0)
    }

    fn at(&self, t: f64) -> Configuration {
        self.start_rad.along(&self.slope, t).along(&self.bend_per_rad, 0.5 * t * t)
    }

    /// Points from end to end; a chord over h leaves the curve by h² · q'' / 8.
    fn chords(&self) -> Vec<Configuration> {
        let bend_per_rad = self.bend_per_rad.iter().map(|bend| bend.abs()).fold(0.0, f64::max);
        let chords = (self.length_rad * (bend_per_rad / (8.0 * CHORD_RAD)).sqrt()).ceil().max(1.0);
        (0..=chords as u32).map(|chord| self.at(self.length_rad * f64::from(chord) / chords)).collect()
    }
}

impl SmoothPath {
    /// Straight from point to point, each corner rounded so that no axis is further than `tolerance_rad` from it where the
    /// curve passes it by; by less where that would take more than half of a segment. The tolerance is above zero.
    #[must_use]
    pub fn through(points: &[Configuration], tolerance_rad: f64) -> Self {
        let mut corners = points.to_vec();
        corners.dedup_by(|next, last| last.distance_rad(next) <= NOTHING_RAD);
        let lengths: Vec<f64> = corners.windows(2).map(|ends| ends[0].distance_rad(&ends[1])).collect();
        let direction = |(ends, length): (&[Configuration], &f64)| ends[0].travel_rad(&ends[1]).map(|turn| turn / length);
        let directions: Vec<[f64; 7]> = corners.windows(2).zip(&lengths).map(direction).collect();
        // How far before and after each point its parabola begins and ends.
        let cut = |corner: usize| {
            let [before, after] = [&directions[corner - 1], &directions[corner]];
            let widest = map(|axis| (after[axis] - before[axis]).abs()).into_iter().fold(0.0, f64::max);
            // The parabola passes its corner at a quarter of cut · (change of direction).
            let cut = if widest > STRAIGHT { 4.0 * tolerance_rad / widest } else { 0.0 };
            cut.min(0.5 * lengths[corner - 1]).min(0.5 * lengths[corner])
        };
        let cuts: Vec<f64> = (0..corners.len()).map(|c| if c == 0 || c + 1 >= corners.len() { 0.0 } else { cut(c) }).collect();
        let mut pieces = Vec::with_capacity(2 * corners.len());
        for (segment, (direction, length)) in directions.iter().zip(&lengths).enumerate() {
            let straight = length - cuts[segment] - cuts[segment + 1];
            let start_rad = corners[segment].along(direction, cuts[segment]);
            pieces.push(Piece { length_rad: straight, start_rad, slope: *direction, bend_per_rad: [0.0; 7] });
            let Some(next) = directions.get(segment + 1) else { break };
            let cut = cuts[segment + 1];
            let start_rad = corners[segment + 1].along(direction, -cut);
            let bend_per_rad = map(|axis| (next[axis] - direction[axis]) / (2.0 * cut));
            pieces.push(Piece { length_rad: 2.0 * cut, start_rad, slope: *direction, bend_per_rad });
        }
        pieces.retain(|piece| piece.length_rad > NOTHING_RAD);
        Self { pieces }
    }

    /// Pieces of the path in order.
    #[must_use]
    pub fn pieces(&self) -> &[Piece] {
        &self.pieces
    }

    /// Points on each bend, so many that straight moves from one to the next stay on the curve, but for a tenth of a millimetre. Between
    /// bends the curve is that of its points.
    pub fn bends(&self) -> impl Iterator<Item = Vec<Configuration>> {
        self.pieces.iter().filter(|piece| !piece.is_straight()).map(Piece::chords)
    }

    /// Seconds that the axes need at least, from rest to rest; `speed_fraction` scales rated speeds and accelerations.
    #[must_use]
    pub fn secs(&self, axes: &Axes, speed_fraction: f64) -> f64 {
        let grid = self.grid(axes, speed_fraction);
        // The largest x from which rest can be reached, from the end back.
        let mut reachable = vec![0.0; grid.len() + 1];
        for (at, point) in grid.iter().enumerate().rev() {
            reachable[at] = point.largest_x(reachable[at + 1]);
        }
        let (mut x, mut secs) = (0.0_f64, 0.0);
        for (at, point) in grid.iter().enumerate() {
            let next = (x + 2.0 * point.step_rad * point.largest_u(x)).clamp(0.0, reachable[at + 1]);
            secs += 2.0 * point.step_rad / (x.sqrt() + next.sqrt());
            x = next;
        }
        secs
    }

    fn grid(&self, axes: &Axes, speed_fraction: f64) -> Vec<GridPoint> {
        let whole_rad: f64 = self.pieces.iter().map(|piece| piece.length_rad).sum();
        let mut grid = Vec::new();
        for piece in &self.pieces {
            let min = if piece.is_straight() { GRID_OF_A_LINE } else { GRID_OF_A_BEND };
            let steps = ((piece.length_rad / whole_rad * GRID - ROUNDING).ceil() as usize).max(min);
            let step_rad = piece.length_rad / steps as f64;
            for step in 0..steps {
                let t = step_rad * step as f64;
                let slope = map(|axis| piece.slope[axis] + t * piece.bend_per_rad[axis]);
                grid.push(GridPoint::new(step_rad, &slope, &piece.bend_per_rad, axes, speed_fraction));
            }
        }
        grid
    }
}

/// The limits at a point of the curve: α u + β x ≤ γ for each axis and its opposite.
struct GridPoint {
    step_rad: f64,
    /// Limit of x alone.
    x_max: f64,
    limits: Vec<[f64; 3]>,
}

impl GridPoint {
    fn new(step_rad: f64, slope: &[f64; 7], bend: &[f64; 7], axes: &Axes, speed_fraction: f64) -> Self {
        let (mut x_max, mut limits) = (f64::INFINITY, Vec::with_capacity(14));
        for ((axis, slope), bend) in axes.0.iter().zip(slope).zip(bend) {
            let speed = axis.max_speed_rad_per_s * speed_fraction;
            let acceleration = axis.max_acceleration_rad_per_s2 * speed_fraction;
            if slope.abs() > NOTHING_RAD {
                x_max = x_max.min((speed / slope).powi(2));
                limits.extend([[*slope, *bend, acceleration], [-slope, -bend, acceleration]]);
            } else if bend.abs() > 0.0 {
                x_max = x_max.min(acceleration / bend.abs());
            }
        }
        Self { step_rad, x_max, limits }
    }

    /// The line that bounds u from above at `x`, as value and change with x; below with `sign` −1.
    fn bound(&self, x: f64, sign: f64, next_max: Option<f64>) -> (f64, f64) {
        let line = |[alpha, beta, gamma]: &[f64; 3]| (sign * alpha > 0.0).then(|| ((gamma - beta * x) / alpha, -beta / alpha));
        let step = 2.0 * self.step_rad;
        let next = next_max.map(|next| ((next - x) / step, -1.0 / step));
        let tighter = |a: (f64, f64), b: (f64, f64)| if sign * b.0 < sign * a.0 { b } else { a };
        self.limits.iter().filter_map(line).chain(next).fold((sign * f64::INFINITY, 0.0), tighter)
    }

    /// The largest x from which the next point can be reached with at most `next_max`. The room that is left for u is a
    /// concave function of x, positive at rest: from the right, the tangents lead to where it ends.
    fn largest_x(&self, next_max: f64) -> f64 {
        let mut x = self.x_max;
        for _ in 0..self.limits.len() * self.limits.len() + 4 {
            let (high, high_slope) = self.bound(x, 1.0, Some(next_max));
            // Nothing keeps the next x from being zero but that it is not negative.
            let (low, low_slope) = self.bound(x, -1.0, Some(0.0));
            let (room, change) = (high - low, high_slope - low_slope);
            if room >= -1e-12 * (1.0 + high.abs()) || change >= 0.0 {
                break;
            }
            x -= room / change;
        }
        x.max(0.0)
    }

    fn largest_u(&self, x: f64) -> f64 {
        self.bound(x, 1.0, None).0
    }
}

fn map(of: impl Fn(usize) -> f64) -> [f64; 7] {
    std::array::from_fn(of)
}

#[cfg(test)]
mod tests;
