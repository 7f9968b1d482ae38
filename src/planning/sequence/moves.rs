//! Moves in joint space as a cell makes them: arm and table together, or one after the other where its controllers know no
//! more. Every point is a stop, so a move's time is that of its segments, each the controller's own trapezoid; unless corners
//! are to be passed without stopping (`rounded.rs`).

use std::collections::HashMap;

use super::rounded::{Rounded, rounded};
use crate::cell::{Axes, Cell, CollisionScene, Configuration};
use crate::planning::params::{Corners, MotionParams, TableMotion};

/// Timing and checking of moves in one scene.
pub(super) struct Moves<'a> {
    pub(super) axes: Axes,
    pub(super) scene: &'a CollisionScene,
    pub(super) motion: MotionParams,
    /// Tolerance within which corners are passed without stopping, radians; `None`: every point is a stop.
    rounded_within_rad: Option<f64>,
}

/// Seconds of the straight move from rest to rest.
#[must_use]
pub fn straight_secs(axes: &Axes, from: &Configuration, to: &Configuration, motion: &MotionParams) -> f64 {
    match motion.table {
        TableMotion::WithArm => axes.move_secs(from, to, motion.speed_fraction),
        TableMotion::Alone => {
            let corner = turned(from, to);
            axes.move_secs(from, &corner, motion.speed_fraction) + axes.move_secs(&corner, to, motion.speed_fraction)
        }
    }
}

/// Lower bound of the seconds of any move from rest to rest along points that may be passed without stopping: the time of the
/// axis that takes longest on its own. The straight move is not such a bound: all axes share one trapezoid there, whose speed one
/// axis may limit and whose acceleration another. Where every point is a stop, the straight move is the quickest.
pub(super) fn min_secs(axes: &Axes, from: &Configuration, to: &Configuration, motion: &MotionParams) -> f64 {
    if motion.corners == Corners::Stop {
        return straight_secs(axes, from, to, motion);
    }
    let at_rest = Configuration::from_axes_rad([0.0; 7]);
    let alone_secs = |(axis, travel_rad): (usize, f64)| {
        let mut travels_rad = [0.0; 7];
        travels_rad[axis] = travel_rad;
        axes.move_secs(&at_rest, &Configuration::from_axes_rad(travels_rad), motion.speed_fraction)
    };
    from.travel_rad(to).into_iter().enumerate().map(alone_secs).fold(0.0, f64::max)
}

/// Configuration with the arm as in `from` and the table as in `to`.
fn turned(from: &Configuration, to: &Configuration) -> Configuration {
    Configuration { table_rad: to.table_rad, ..*from }
}

impl<'a> Moves<'a> {
    pub(super) fn new(cell: &Cell, scene: &'a CollisionScene, motion: &MotionParams) -> Self {
        let rounded_within_rad = (motion.corners == Corners::Round).then(|| motion.path_tolerance_deg.to_radians());
        Self { axes: cell.axes(), scene, motion: motion.clone(), rounded_within_rad }
    }

    /// Seconds of the straight move, free or not.
    pub(super) fn straight_secs(&self, from: &Configuration, to: &Configuration) -> f64 {
        straight_secs(&self.axes, from, to, &self.motion)
    }

    /// Seconds along `points`.
    pub(super) fn secs(&self, points: &[Configuration]) -> f64 {
        points.windows(2).map(|ends| self.straight_secs(&ends[0], &ends[1])).sum()
    }

    /// Seconds along `points` in which the table turns; `points` must be as [`Moves::with_all_stops`] returns them.
    pub(super) fn turning_secs(&self, points: &[Configuration]) -> f64 {
        let turns = |ends: &&[Configuration]| ends[0].turns_table(&ends[1]);
        points.windows(2).filter(turns).map(|ends| self.straight_secs(&ends[0], &ends[1])).sum()
    }

    /// Rounds the corners of a path, where that is asked for and quicker; returns the tolerance too, radians.
    pub(super) fn without_stops(&self, points: &[Configuration]) -> Option<(Rounded, f64)> {
        let tolerance_rad = self.rounded_within_rad?;
        Some((rounded(points, self, tolerance_rad)?, tolerance_rad))
    }

    /// Returns true if the straight move meets nothing.
    pub(super) fn is_free(&self, from: &Configuration, to: &Configuration) -> bool {
        match self.motion.table {
            TableMotion::WithArm => self.scene.check_segment(from, to).is_none(),
            TableMotion::Alone => self.scene.corner_between(from, to).is_ok(),
        }
    }

    /// Adds the stops between arm and table motion to free moves along `points`.
    pub(super) fn with_all_stops(&self, points: &[Configuration]) -> Vec<Configuration> {
        let mut all = points[..points.len().min(1)].to_vec();
        for ends in points.windows(2) {
            if self.motion.table == TableMotion::Alone {
                all.extend(self.scene.corner_between(&ends[0], &ends[1]).ok().flatten());
            }
            all.push(ends[1]);
        }
        all
    }
}

/// Straight moves that were checked, each once: routes that are compared share most of theirs.
pub(super) struct SegmentCache<'a> {
    moves: &'a Moves<'a>,
    /// Results by the bits of both ends.
    is_free: HashMap<[[u64; 7]; 2], bool>,
}

impl<'a> SegmentCache<'a> {
    pub(super) fn new(moves: &'a Moves<'a>) -> Self {
        Self { moves, is_free: HashMap::new() }
    }

    /// Returns true if the straight move meets nothing.
    pub(super) fn is_free(&mut self, from: &Configuration, to: &Configuration) -> bool {
        let ends = [from, to].map(|end| end.axes_rad().map(f64::to_bits));
        *self.is_free.entry(ends).or_insert_with(|| self.moves.is_free(from, to))
    }
}
