//! Moves in joint space as a cell makes them: arm and table together, or one after the other where its controllers know no
//! more. Every point is a stop, so a move's time is that of its segments, each the controller's own trapezoid; unless corners
//! are to be passed without stopping (`rounded.rs`).

use std::collections::HashMap;

use super::rounded::{Rounded, rounded};
use crate::cell::{Axes, Cell, CollisionScene, Configuration};
use crate::planning::params::{Corners, MotionParams, TableMotion};

/// How moves are made and what they may not meet.
pub(super) struct Moves<'a> {
    pub(super) axes: Axes,
    pub(super) scene: &'a CollisionScene,
    pub(super) motion: MotionParams,
    /// How near corners that are not stopped at are passed, radians; `None`: all are stopped at.
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

/// The arm as in `from`, the table as in `to`.
fn turned(from: &Configuration, to: &Configuration) -> Configuration {
    std::array::from_fn(|axis| if axis == 6 { to[6] } else { from[axis] })
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

    /// Of the seconds along `points`, which are as [`Moves::spelled_out`] gives them, those in which the table turns.
    pub(super) fn turning_secs(&self, points: &[Configuration]) -> f64 {
        let turns = |ends: &&[Configuration]| ends[0][6] != ends[1][6];
        points.windows(2).filter(turns).map(|ends| self.straight_secs(&ends[0], &ends[1])).sum()
    }

    /// The same way without stops, and within what tolerance its corners are passed, where that is asked for and quicker.
    pub(super) fn without_stops(&self, points: &[Configuration]) -> Option<(Rounded, f64)> {
        let tolerance_rad = self.rounded_within_rad?;
        Some((rounded(points, self, tolerance_rad)?, tolerance_rad))
    }

    /// Whether the straight move meets nothing.
    pub(super) fn is_free(&self, from: &Configuration, to: &Configuration) -> bool {
        match self.motion.table {
            TableMotion::WithArm => self.scene.check_segment(from, to).is_none(),
            TableMotion::Alone => self.scene.corner_between(from, to).is_ok(),
        }
    }

    /// Free moves along `points` with every stop on the way, both ends kept.
    pub(super) fn spelled_out(&self, points: &[Configuration]) -> Vec<Configuration> {
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

/// Straight moves that were looked at, each once: ways that are compared share most of theirs.
pub(super) struct Looks<'a> {
    moves: &'a Moves<'a>,
    /// By the bits of both ends.
    is_free: HashMap<[[u64; 7]; 2], bool>,
}

impl<'a> Looks<'a> {
    pub(super) fn new(moves: &'a Moves<'a>) -> Self {
        Self { moves, is_free: HashMap::new() }
    }

    /// Whether the straight move meets nothing.
    pub(super) fn is_free(&mut self, from: &Configuration, to: &Configuration) -> bool {
        let ends = [from.map(f64::to_bits), to.map(f64::to_bits)];
        *self.is_free.entry(ends).or_insert_with(|| self.moves.is_free(from, to))
    }
}
