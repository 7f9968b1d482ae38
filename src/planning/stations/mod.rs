//! Viewpoints to stations: table angle and joint vector, within limits and free of collision.
//!
//! The table's angle φ is free, so it is sampled over one turn; at each φ the arm must bring the flange to
//! base_from_table · Rz(φ) · table_from_part · part_from_scanner · flange_from_scanner⁻¹, which the closed form answers
//! with all its branches, each wound by whole turns as far as the limits go. The result is tried in the order of its
//! distance from home in time, and tested for collision only then. One view costs about 0.2 ms, plus a few microseconds
//! for each test.

use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};

use super::context::{Cancelled, Context};
use crate::cell::{Axes, Cell, CollisionScene, Configuration, joints_of};
use crate::geometry::{Part, Pose, ScannerFrame, Table, plate_from_placed};

/// Step of the table, in whole parts of a turn: 5°.
const TABLE_STEPS: u32 = 72;
/// Each is divided into so many where a view has no station at any of them: 0.25°. In a hundred cluttered cells 14 of 56 views
/// without a station get one so, four fifths of them at 1° already.
const FINER: u32 = 20;
/// Stations kept a view: enough for the sequence to choose from.
const KEEP: usize = 12;
/// Two stations of a view differ in some axis by at least this, radians (20°); else the cheaper one stands for both.
const SPREAD_RAD: f64 = std::f64::consts::PI / 9.0;
/// Collision tests between two looks at the cancel flag.
const TESTS_PER_LOOK: usize = 64;

/// Where the cell takes a view from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Station {
    /// Angle of the table.
    pub table_angle_rad: f64,
    /// Joints of the arm, vendor's convention, windings included.
    pub joints_rad: [f64; 6],
}

impl Station {
    /// Joints and table angle together.
    #[must_use]
    pub fn configuration(&self) -> Configuration {
        std::array::from_fn(|axis| self.joints_rad.get(axis).copied().unwrap_or(self.table_angle_rad))
    }
}

impl From<Configuration> for Station {
    fn from(configuration: Configuration) -> Self {
        Self { table_angle_rad: configuration[6], joints_rad: joints_of(&configuration) }
    }
}

/// Why a view has no station.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Blocked {
    /// No joint vector within limits at any table angle.
    Unreachable,
    /// Something collides at every one.
    Collision,
}

/// For each view its stations, cheapest from home first and all different from each other, or why there is none.
/// Runs on the caller's rayon pool; the result does not depend on the number of threads. `scene` must hold the part
/// as `table_from_part` places it.
///
/// # Errors
/// [`Cancelled`].
pub fn solve(
    views: &[Pose<Part, ScannerFrame>],
    cell: &Cell,
    scene: &CollisionScene,
    table_from_part: &Pose<Table, Part>,
    ctx: &Context<'_>,
) -> Result<Vec<Result<Vec<Station>, Blocked>>, Cancelled> {
    solve_some(views, cell, scene, table_from_part, KEEP, ctx)
}

/// As [`solve`], with at most `keep` stations a view: 1 answers whether there is one.
///
/// # Errors
/// [`Cancelled`].
pub fn solve_some(
    views: &[Pose<Part, ScannerFrame>],
    cell: &Cell,
    scene: &CollisionScene,
    table_from_part: &Pose<Table, Part>,
    keep: usize,
    ctx: &Context<'_>,
) -> Result<Vec<Result<Vec<Station>, Blocked>>, Cancelled> {
    let search = Search { cell, axes: cell.axes(), scene, table_from_part, keep };
    let done = AtomicUsize::new(0);
    views
        .par_iter()
        .map(|view| {
            let stations = search.stations(view, ctx)?;
            ctx.progress(done.fetch_add(1, Ordering::Relaxed) + 1, views.len());
            Ok(stations)
        })
        .collect()
}

/// Joints and table that take the view as near to home as can be, whatever collides there; `None` where none reach it.
#[must_use]
pub fn nearest_way(
    view: &Pose<Part, ScannerFrame>,
    cell: &Cell,
    scene: &CollisionScene,
    table_from_part: &Pose<Table, Part>,
) -> Option<Configuration> {
    let search = Search { cell, axes: cell.axes(), scene, table_from_part, keep: 1 };
    search.ways(view, &table_angles().collect::<Vec<_>>()).0.first().map(|way| way.configuration)
}

/// Whether the viewpoint lies inside a body that stands still at every table angle: a quick filter ahead of [`solve`].
#[must_use]
pub fn inside_obstacle(
    view: &Pose<Part, ScannerFrame>,
    cell: &Cell,
    scene: &CollisionScene,
    table_from_part: &Pose<Table, Part>,
) -> bool {
    table_angles().all(|angle| {
        let base_from_scanner = base_from_scanner(view, cell, table_from_part, angle);
        scene.is_blocked(&base_from_scanner.origin_mm())
    })
}

fn table_angles() -> impl Iterator<Item = f64> {
    (0..TABLE_STEPS).map(|step| turned(step, TABLE_STEPS))
}

/// So many of the parts that a turn is divided into.
fn turned(step: u32, parts: u32) -> f64 {
    std::f64::consts::TAU * f64::from(step) / f64::from(parts)
}

fn base_from_scanner(
    part_from_scanner: &Pose<Part, ScannerFrame>,
    cell: &Cell,
    table_from_part: &Pose<Table, Part>,
    table_angle_rad: f64,
) -> Pose<crate::geometry::Base, ScannerFrame> {
    cell.base_from_plate(table_angle_rad) * plate_from_placed(table_from_part) * *part_from_scanner
}

struct Search<'a> {
    cell: &'a Cell,
    axes: Axes,
    scene: &'a CollisionScene,
    table_from_part: &'a Pose<Table, Part>,
    keep: usize,
}

/// One way to take a view, before collision is tested.
struct Way {
    secs_from_home: f64,
    /// Ways that differ by whole turns share a pose, and so a verdict.
    pose: usize,
    configuration: Configuration,
}

impl Search<'_> {
    fn stations(&self, view: &Pose<Part, ScannerFrame>, ctx: &Context<'_>) -> Result<Result<Vec<Station>, Blocked>, Cancelled> {
        let between = (0..TABLE_STEPS * FINER).filter(|step| step % FINER != 0).map(|step| turned(step, TABLE_STEPS * FINER));
        let mut blocked = Blocked::Unreachable;
        for table_angles in [table_angles().collect::<Vec<_>>(), between.collect()] {
            ctx.check()?;
            let (ways, poses) = self.ways(view, &table_angles);
            let Some(way) = ways.first() else { continue };
            blocked = Blocked::Collision;
            if self.scene.check_view(&way.configuration).is_some() {
                break;
            }
            let kept = self.free(&ways, poses, ctx)?;
            if !kept.is_empty() {
                return Ok(Ok(kept.into_iter().map(Station::from).collect()));
            }
        }
        Ok(Err(blocked))
    }

    /// The cheapest of these ways that are free and differ.
    fn free(&self, ways: &[Way], poses: usize, ctx: &Context<'_>) -> Result<Vec<Configuration>, Cancelled> {
        let mut free: Vec<Option<bool>> = vec![None; poses];
        let mut kept: Vec<Configuration> = Vec::new();
        for (index, way) in ways.iter().enumerate() {
            if index % TESTS_PER_LOOK == 0 {
                ctx.check()?;
            }
            if kept.iter().any(|other| is_close(other, &way.configuration)) {
                continue;
            }
            if *free[way.pose].get_or_insert_with(|| self.scene.check(&way.configuration).is_none()) {
                kept.push(way.configuration);
                if kept.len() == self.keep {
                    break;
                }
            }
        }
        Ok(kept)
    }

    /// Every way within the limits at these angles, cheapest from home first, and the number of different poses among them.
    fn ways(&self, view: &Pose<Part, ScannerFrame>, table_angles: &[f64]) -> (Vec<Way>, usize) {
        let (mut ways, mut poses) = (Vec::new(), 0);
        let scanner_from_flange = self.cell.flange_from_scanner.inverse();
        for table_angle in table_angles.iter().copied() {
            if self.axes.0[6].windings(table_angle).next().is_none() {
                continue;
            }
            let base_from_flange = base_from_scanner(view, self.cell, self.table_from_part, table_angle) * scanner_from_flange;
            for joints in self.cell.robot.kinematics.ik_solutions(&base_from_flange) {
                let wound = self.axes.windings(&Station { table_angle_rad: table_angle, joints_rad: joints }.configuration());
                ways.extend(wound.into_iter().map(|configuration| Way {
                    secs_from_home: self.axes.move_secs(&self.cell.home_rad, &configuration, 1.0),
                    pose: poses,
                    configuration,
                }));
                poses += 1;
            }
        }
        // Stable: ties keep the order of table angle and branch.
        ways.sort_by(|a, b| a.secs_from_home.total_cmp(&b.secs_from_home));
        (ways, poses)
    }
}

fn is_close(a: &Configuration, b: &Configuration) -> bool {
    a.iter().zip(b).all(|(a, b)| (a - b).abs() < SPREAD_RAD)
}

#[cfg(test)]
mod tests;
