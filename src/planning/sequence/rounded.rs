//! Paths that are run without stopping: each corner is cut by a parabola, as wide as is free, and what is emitted is the
//! polyline beside it. The curve itself is nowhere further from it than the tolerance. Both are checked: executors run either.

use super::moves::Moves;
use crate::cell::Configuration;
use crate::cell::time_parameterisation::SmoothPath;

/// Largest distance from the corner at which a cut begins, radians along the path (30°).
const MAX_CUT_RAD: f64 = std::f64::consts::FRAC_PI_6;
/// Times that the cut is halved at most where it is not free.
const HALVINGS: u32 = 4;

/// A path without stops.
pub(super) struct Rounded {
    /// Points, both ends among them.
    pub(super) points: Vec<Configuration>,
    pub(super) secs: f64,
}

/// Cuts the corners of a path; `None` where it has none, or would not be free, or not quicker.
pub(super) fn rounded(points: &[Configuration], moves: &Moves<'_>, tolerance_rad: f64) -> Option<Rounded> {
    let [first, .., last] = points else { return None };
    let mut path = vec![*first];
    for corner in points.windows(3) {
        path.extend(cut(&[corner[0], corner[1], corner[2]], moves, tolerance_rad));
    }
    path.push(*last);
    if path.len() < 3 || !path.windows(2).all(|ends| moves.is_free(&ends[0], &ends[1])) {
        return None;
    }
    let curve = SmoothPath::through(&path, tolerance_rad);
    if !curve.bends().all(|bend| bend.windows(2).all(|ends| moves.is_free(&ends[0], &ends[1]))) {
        return None;
    }
    let secs = curve.secs(&moves.axes, moves.motion.speed_fraction);
    (secs < moves.secs(points)).then_some(Rounded { points: path, secs })
}

/// Replaces a corner by points along a parabola, or by itself where no parabola is free.
fn cut([before, corner, after]: &[Configuration; 3], moves: &Moves<'_>, tolerance_rad: f64) -> Vec<Configuration> {
    let half = |end: &Configuration| 0.5 * corner.distance_rad(end);
    let mut reach_rad = MAX_CUT_RAD.min(half(before)).min(half(after));
    for _ in 0..HALVINGS {
        let arc = arc(&[toward(corner, before, reach_rad), *corner, toward(corner, after, reach_rad)], tolerance_rad);
        if arc.windows(2).all(|ends| moves.is_free(&ends[0], &ends[1])) {
            return arc;
        }
        reach_rad *= 0.5;
    }
    vec![*corner]
}

/// Points on the quadratic Bézier curve with these control points, a parabola, so many that no
/// chord is further from it than half the tolerance.
fn arc(controls: &[Configuration; 3], tolerance_rad: f64) -> Vec<Configuration> {
    let [from, pull, to] = controls.map(|control| control.axes_rad());
    let bend = (0..7).map(|axis| (from[axis] - 2.0 * pull[axis] + to[axis]).abs()).fold(0.0, f64::max);
    // A chord of a share h leaves the curve by bend · h² / 4.
    let chords = (bend / (2.0 * tolerance_rad)).sqrt().ceil().max(1.0);
    let at = |chord: u32| {
        let share = f64::from(chord) / chords;
        let [a, b, c] = [(1.0 - share).powi(2), 2.0 * share * (1.0 - share), share * share];
        Configuration::from_axes_rad(std::array::from_fn(|axis| a * from[axis] + b * pull[axis] + c * to[axis]))
    };
    (0..=chords as u32).map(at).collect()
}

fn toward(from: &Configuration, to: &Configuration, reach_rad: f64) -> Configuration {
    from.toward(to, reach_rad / from.distance_rad(to).max(f64::MIN_POSITIVE))
}
