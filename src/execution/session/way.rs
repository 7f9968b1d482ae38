//! The program's way: where it stands before a step, and where on a step's way the devices are found.

use super::gate::furthest_axis;
use crate::cell::Configuration;
use crate::program::{Program, Step};

/// Commanded configuration before a step.
pub(super) fn commanded_before(program: &Program, step: usize) -> Configuration {
    let target = program.steps.iter().take(step).rev().find_map(|step| match step {
        Step::Move(step) => Some(step.target_rad),
        Step::Settle { .. } | Step::Scan { .. } => None,
    });
    target.unwrap_or(program.home_rad)
}

/// Points of a step's way, from where it begins; alone that where the devices stand.
pub(super) fn points(program: &Program, step: usize) -> Vec<Configuration> {
    let from = commanded_before(program, step);
    match program.steps.get(step) {
        Some(Step::Move(step)) => std::iter::once(from).chain(step.via_rad.iter().copied()).chain([step.target_rad]).collect(),
        Some(Step::Settle { .. } | Step::Scan { .. }) | None => vec![from],
    }
}

/// Point of a straight segment that is nearest to a configuration, for arm and table each on its own: two controllers that begin and
/// brake by themselves are not in step on the way.
pub(super) fn nearest_on(from: &Configuration, to: &Configuration, here: &Configuration) -> Configuration {
    let (way, gone) = (from.travel_rad(to), from.travel_rad(here));
    let along = |axes: std::ops::Range<usize>| {
        let length: f64 = way[axes.clone()].iter().map(|turn| turn * turn).sum();
        let along: f64 = axes.map(|axis| way[axis] * gone[axis]).sum();
        if length > 0.0 { from.along(&way, (along / length).clamp(0.0, 1.0)) } else { *from }
    };
    Configuration { joints_rad: along(0..6).joints_rad, table_rad: along(6..7).table_rad }
}

/// Point of a polyline that is nearest to a configuration, with the number of points passed before it; the latest of equals.
pub(super) fn nearest(points: &[Configuration], here: &Configuration) -> (usize, Configuration) {
    let first = (0, points[0], furthest_axis(&points[0], here).1);
    let segments = points.windows(2).enumerate();
    let best = segments.fold(first, |best, (segment, ends)| {
        let point = nearest_on(&ends[0], &ends[1], here);
        let off = furthest_axis(&point, here).1;
        if off <= best.2 { (segment, point, off) } else { best }
    });
    (best.0, best.1)
}

/// Largest distance of an axis from a segment, of arm and table each on its own.
pub(super) fn off_segment(from: &Configuration, to: &Configuration, here: &Configuration) -> (usize, f64) {
    furthest_axis(&nearest_on(from, to, here), here)
}

#[cfg(test)]
mod tests;
