//! Viewpoints to stations: table angle and joint vector, within limits and free of collision.
//!
//! The table's angle φ is free, so it is sampled over one turn; at each φ the arm must bring the flange to
//! base_from_table · Rz(φ) · table_from_part · part_from_scanner · flange_from_scanner⁻¹, for which the
//! closed form gives all IK solutions, each wound by whole turns as far as the limits go. They are tried in the order of their
//! distance from home in time, and tested for collision only then. One view costs about 0.2 ms, plus a few microseconds
//! for each test.

use std::sync::atomic::{AtomicUsize, Ordering};

use super::context::{Cancelled, Context};
use super::params::TableMotion;
use crate::cell::{Axes, Cell, CollisionScene, Configuration};
use crate::geometry::{Part, Pose, ScannerFrame, Table, parallel, plate_from_placed, sort_ascending};

/// Step of the table, in whole parts of a turn: 5°.
const TABLE_STEPS: u32 = 72;
/// Every so many of them all views are tried first where the table turns alone: 15°.
const SHARED_EVERY: u32 = 3;
/// Finer steps in each where a view has no station at any of them: 0.25°. In a hundred cluttered cells 14 of 56 views
/// without a station get one so, four fifths of them at 1° already.
const FINE_STEPS: u32 = 20;
/// Stations of a view that are kept at most: enough for the sequence to choose from; of a table that turns alone, for views to share an
/// angle.
const MAX_STATIONS: usize = 12;
const MAX_STATIONS_ALONE: usize = 24;
/// Smallest difference in some axis between two stations of a view, radians (20°); of nearer ones the cheaper is kept.
const MIN_SPREAD_RAD: f64 = std::f64::consts::PI / 9.0;
/// Collision tests between two checks of the cancel flag.
const TESTS_PER_CHECK: usize = 64;

/// Table angle and joints from which the cell takes a view.
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
        Configuration { joints_rad: self.joints_rad, table_rad: self.table_angle_rad }
    }
}

impl From<Configuration> for Station {
    fn from(Configuration { joints_rad, table_rad }: Configuration) -> Self {
        Self { table_angle_rad: table_rad, joints_rad }
    }
}

/// Reason for which a view has no station.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StationFailure {
    /// The view has no joint vector within limits at any table angle.
    Unreachable,
    /// Something collides at every joint vector within limits.
    Collision,
}

/// Finds the stations of each view, cheapest from home first and all different from each other, or the reason why there are none.
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
) -> Result<Vec<Result<Vec<Station>, StationFailure>>, Cancelled> {
    solve_as_moved(views, cell, scene, table_from_part, TableMotion::WithArm, ctx)
}

/// Finds the stations of each view as [`solve`]; where the `table` turns alone, one at each multiple of 15° before others, so that views
/// can share an angle.
///
/// # Errors
/// [`Cancelled`].
pub fn solve_as_moved(
    views: &[Pose<Part, ScannerFrame>],
    cell: &Cell,
    scene: &CollisionScene,
    table_from_part: &Pose<Table, Part>,
    table: TableMotion,
    ctx: &Context<'_>,
) -> Result<Vec<Result<Vec<Station>, StationFailure>>, Cancelled> {
    let search = StationSearch { cell, axes: cell.axes(), scene, table_from_part, table, max_stations: max_stations(table) };
    search.of_views(views, ctx)
}

/// Finds at most `max_stations` stations a view, otherwise as [`solve`]: 1 tells whether there is one.
///
/// # Errors
/// [`Cancelled`].
pub fn solve_some(
    views: &[Pose<Part, ScannerFrame>],
    cell: &Cell,
    scene: &CollisionScene,
    table_from_part: &Pose<Table, Part>,
    max_stations: usize,
    ctx: &Context<'_>,
) -> Result<Vec<Result<Vec<Station>, StationFailure>>, Cancelled> {
    StationSearch { cell, axes: cell.axes(), scene, table_from_part, table: TableMotion::WithArm, max_stations }
        .of_views(views, ctx)
}

/// Finds the stations of a view at those of the 72 table angles that `accept` lets through, otherwise as [`solve`]; none where
/// there are none.
///
/// # Errors
/// [`Cancelled`].
pub fn solve_at(
    view: &Pose<Part, ScannerFrame>,
    cell: &Cell,
    scene: &CollisionScene,
    table_from_part: &Pose<Table, Part>,
    (table, accept): (TableMotion, &dyn Fn(f64) -> bool),
    ctx: &Context<'_>,
) -> Result<Vec<Station>, Cancelled> {
    let search = StationSearch { cell, axes: cell.axes(), scene, table_from_part, table, max_stations: max_stations(table) };
    let angles: Vec<f64> = table_angles().filter(|angle| accept(*angle)).collect();
    let (solutions, poses) = search.ik_solutions(view, &angles);
    Ok(search.free(&solutions, poses, ctx)?.into_iter().map(Station::from).collect())
}

/// The IK solution nearest to home at any table angle, collisions ignored; `None` where the view is out of reach.
#[must_use]
pub fn nearest_ik_solution(
    view: &Pose<Part, ScannerFrame>,
    cell: &Cell,
    scene: &CollisionScene,
    table_from_part: &Pose<Table, Part>,
) -> Option<Configuration> {
    let table = TableMotion::WithArm;
    let search = StationSearch { cell, axes: cell.axes(), scene, table_from_part, table, max_stations: 1 };
    search.ik_solutions(view, &table_angles().collect::<Vec<_>>()).0.first().map(|solution| solution.configuration)
}

/// Returns true if the viewpoint lies inside a body that stands still at every table angle: a quick filter ahead of [`solve`].
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

/// Stations of a view that are kept at most.
pub(super) fn max_stations(table: TableMotion) -> usize {
    match table {
        TableMotion::WithArm => MAX_STATIONS,
        TableMotion::Alone => MAX_STATIONS_ALONE,
    }
}

fn table_angles() -> impl Iterator<Item = f64> {
    (0..TABLE_STEPS).map(|step| turned(step, TABLE_STEPS))
}

/// Angle of `step` of the `parts` into which a turn is divided.
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

struct StationSearch<'a> {
    cell: &'a Cell,
    axes: Axes,
    scene: &'a CollisionScene,
    table_from_part: &'a Pose<Table, Part>,
    table: TableMotion,
    max_stations: usize,
}

/// An IK solution for a view, before collision is tested.
struct IkSolution {
    secs_from_home: f64,
    /// Number of the arm's pose: solutions that differ by whole turns share it, and so the result of the collision test.
    pose: usize,
    configuration: Configuration,
}

impl StationSearch<'_> {
    fn of_views(
        &self,
        views: &[Pose<Part, ScannerFrame>],
        ctx: &Context<'_>,
    ) -> Result<Vec<Result<Vec<Station>, StationFailure>>, Cancelled> {
        let done = AtomicUsize::new(0);
        parallel::try_map(views, |view| {
            let stations = self.stations(view, ctx)?;
            ctx.progress(done.fetch_add(1, Ordering::Relaxed) + 1, views.len());
            Ok(stations)
        })
    }

    fn stations(
        &self,
        view: &Pose<Part, ScannerFrame>,
        ctx: &Context<'_>,
    ) -> Result<Result<Vec<Station>, StationFailure>, Cancelled> {
        let between = (0..TABLE_STEPS * FINE_STEPS)
            .filter(|step| step % FINE_STEPS != 0)
            .map(|step| turned(step, TABLE_STEPS * FINE_STEPS));
        let mut failure = StationFailure::Unreachable;
        for table_angles in [table_angles().collect::<Vec<_>>(), between.collect()] {
            ctx.check()?;
            let (solutions, poses) = self.ik_solutions(view, &table_angles);
            let Some(first) = solutions.first() else { continue };
            failure = StationFailure::Collision;
            if self.scene.check_view(&first.configuration).is_some() {
                break;
            }
            let free = self.free(&solutions, poses, ctx)?;
            if !free.is_empty() {
                return Ok(Ok(free.into_iter().map(Station::from).collect()));
            }
        }
        Ok(Err(failure))
    }

    /// The cheapest of these solutions that are free and differ. Where the table turns alone, the cheapest at each shared angle come
    /// before others.
    fn free(&self, solutions: &[IkSolution], poses: usize, ctx: &Context<'_>) -> Result<Vec<Configuration>, Cancelled> {
        let mut free: Vec<Option<bool>> = vec![None; poses];
        let mut taken: Vec<&IkSolution> = Vec::new();
        let passes: &[bool] = if self.table == TableMotion::Alone { &[true, false] } else { &[false] };
        for is_for_shared in passes {
            for (index, solution) in solutions.iter().enumerate() {
                if index % TESTS_PER_CHECK == 0 {
                    ctx.check()?;
                }
                let angle_rad = solution.configuration.table_rad;
                let is_wanted = match is_for_shared {
                    true => {
                        is_shared(angle_rad)
                            && taken.iter().all(|other| other.configuration.table_rad.to_bits() != angle_rad.to_bits())
                    }
                    false => !taken.iter().any(|other| is_close(&other.configuration, &solution.configuration)),
                };
                if is_wanted && *free[solution.pose].get_or_insert_with(|| self.scene.check(&solution.configuration).is_none()) {
                    taken.push(solution);
                    if taken.len() == self.max_stations {
                        break;
                    }
                }
            }
            if taken.len() == self.max_stations {
                break;
            }
        }
        // Stable, as the solutions are sorted.
        sort_ascending(&mut taken, |station| station.secs_from_home);
        Ok(taken.into_iter().map(|solution| solution.configuration).collect())
    }

    /// Every IK solution within the limits at these angles, cheapest from home first, and the number of different poses among them.
    fn ik_solutions(&self, view: &Pose<Part, ScannerFrame>, table_angles: &[f64]) -> (Vec<IkSolution>, usize) {
        let (mut solutions, mut poses) = (Vec::new(), 0);
        let scanner_from_flange = self.cell.flange_from_scanner.inverse();
        for table_rad in table_angles.iter().copied() {
            if self.cell.turntable.axis.windings(table_rad).next().is_none() {
                continue;
            }
            let base_from_flange = base_from_scanner(view, self.cell, self.table_from_part, table_rad) * scanner_from_flange;
            for joints_rad in self.cell.robot.kinematics.ik_solutions(&base_from_flange) {
                let wound = self.axes.windings(&Configuration { joints_rad, table_rad });
                // A whole turn that is added or taken off costs the last digit.
                solutions.extend(wound.into_iter().map(Configuration::with_rounded_table).map(|configuration| IkSolution {
                    secs_from_home: self.axes.move_secs(&self.cell.home_rad, &configuration, 1.0),
                    pose: poses,
                    configuration,
                }));
                poses += 1;
            }
        }
        // Stable: ties keep the order of table angle and IK solution.
        sort_ascending(&mut solutions, |station| station.secs_from_home);
        (solutions, poses)
    }
}

/// Returns true for an angle that all views are tried at first where the table turns alone.
fn is_shared(table_rad: f64) -> bool {
    /// Share of a step that rounding of the table's angle leaves.
    const ROUNDED: f64 = 1e-6;
    let steps = table_rad / turned(SHARED_EVERY, TABLE_STEPS);
    (steps - steps.round()).abs() < ROUNDED
}

fn is_close(a: &Configuration, b: &Configuration) -> bool {
    a.travel_rad(b).iter().all(|turn| turn.abs() < MIN_SPREAD_RAD)
}

#[cfg(test)]
mod tests;
