//! Where the arm of a cell can go whatever lies on its table: places at which it clears the cell alone, and the straight
//! roads between them (L. Kavraki, P. Švestka, J.-C. Latombe and M. Overmars, "Probabilistic roadmaps for path planning in
//! high-dimensional configuration spaces", IEEE Trans. Robotics and Automation 12(4), 1996). The plate is round, so the
//! table's angle is of no matter here. A roadmap follows from its cell alone and holds for every part on it: who plans many
//! parts in one cell keeps it ([`Roadmaps`]), and plans the same as who makes it anew each time.
//!
//! Cost: about a thousand places, a few thousand roads to prove free, some tenths of a second on two cores.

use std::collections::{BTreeSet, VecDeque};
use std::fmt::{self, Write};
use std::sync::{Arc, Mutex, PoisonError};

use nalgebra::Vector3;
use rayon::prelude::*;
use sha2::{Digest, Sha256};

use crate::cell::collision::MIN_CLEARANCE_MM;
use crate::cell::{Axes, Cell, CollisionScene, Configuration};
use crate::geometry::{Base, Pose, ScannerFrame, Table};
use crate::planning::candidates::{looking_along, spiral};
use crate::planning::context::{Cancelled, Context};
use crate::planning::random::Stream;

/// Directions from which the scanner looks at the table in a place, …
const DIRECTIONS: usize = 32;
/// … rolls about each, …
const ROLLS: usize = 4;
/// … and how far beyond its best distance, in radii of the plate: beside what stands on it, and clear of it.
const BEYOND_RADII: [f64; 2] = [0.5, 1.2];
/// The point looked at is so far above the plate, in radii.
const ABOVE_RADII: f64 = 0.3;
/// Further places, anywhere within the limits.
const ANYWHERE: usize = 96;
/// Names their stream.
const STREAM: u64 = 0x726f_6164;
/// Roads from a place to the nearest others, before those that collide are left out.
const NEAREST: usize = 6;
/// Roadmaps that are kept.
const KEPT: usize = 8;

/// Places of one cell and roads between them.
#[derive(Debug, PartialEq)]
pub(super) struct Roadmap {
    /// Home first. All at home's table angle, which says nothing.
    pub(super) places: Vec<Configuration>,
    /// Numbers of two places each.
    pub(super) roads: Vec<[usize; 2]>,
    /// Roads of each place.
    pub(super) roads_at: Vec<Vec<usize>>,
}

impl Roadmap {
    fn of(cell: &Cell, ctx: &Context<'_>) -> Result<Self, Cancelled> {
        let scene = CollisionScene::without_part(cell, MIN_CLEARANCE_MM);
        let axes = cell.axes();
        let mut places: Vec<_> = looking(cell, &axes).into_iter().chain(anywhere(&axes)).collect();
        places.iter_mut().for_each(|place| place[6] = cell.home_rad[6]);
        ctx.check()?;
        let free: Vec<_> = places.into_par_iter().filter(|place| scene.check(place).is_none()).collect();
        let places: Vec<_> = std::iter::once(cell.home_rad).chain(free).collect();
        let pairs: BTreeSet<[usize; 2]> =
            (0..places.len()).into_par_iter().flat_map_iter(|place| nearest(place, &places, &axes)).collect();
        let is_free = |[a, b]: &[usize; 2]| {
            ctx.check()?;
            Ok(scene.check_segment(&places[*a], &places[*b]).is_none())
        };
        let free: Vec<bool> = pairs.par_iter().map(is_free).collect::<Result<_, Cancelled>>()?;
        let roads: Vec<_> = pairs.into_iter().zip(free).filter_map(|(road, free)| free.then_some(road)).collect();
        let mut roads_at = vec![Vec::new(); places.len()];
        roads.iter().enumerate().for_each(|(road, ends)| ends.iter().for_each(|end| roads_at[*end].push(road)));
        Ok(Self { places, roads, roads_at })
    }
}

/// Places from which the scanner looks at the table, on every branch.
fn looking(cell: &Cell, axes: &Axes) -> Vec<Configuration> {
    let radius_mm = cell.turntable.plate_radius_mm;
    let at = Vector3::z() * (ABOVE_RADII * radius_mm);
    let poses = spiral(DIRECTIONS, 0.0).flat_map(|out| {
        let rolls = (0..ROLLS).map(|roll| std::f64::consts::TAU * roll as f64 / ROLLS as f64);
        rolls.flat_map(move |roll_rad| BEYOND_RADII.map(|radii| (out, roll_rad, radii)))
    });
    let places = poses.flat_map(|(out, roll_rad, radii)| {
        let distance_mm = cell.scanner.best_mm + radii * radius_mm;
        let table_from_scanner: Pose<Table, ScannerFrame> =
            Pose::from_parts(at + out * distance_mm, looking_along(&-out, roll_rad));
        let base_from_scanner: Pose<Base, ScannerFrame> = cell.base_from_table * table_from_scanner;
        cell.robot.kinematics.ik_solutions(&(base_from_scanner * cell.flange_from_scanner.inverse()))
    });
    places.filter_map(|joints| as_near_home(&joints, cell, axes)).collect()
}

/// Of all turns of a place's joints those nearest to home.
fn as_near_home(joints: &[f64; 6], cell: &Cell, axes: &Axes) -> Option<Configuration> {
    let home = &cell.home_rad;
    let mut place = *home;
    for (axis, joint) in joints.iter().enumerate() {
        let turns = axes.0[axis].windings(*joint);
        place[axis] = turns.min_by(|a, b| (a - home[axis]).abs().total_cmp(&(b - home[axis]).abs()))?;
    }
    Some(place)
}

fn anywhere(axes: &Axes) -> impl Iterator<Item = Configuration> {
    let mut stream = Stream::new(0, &[STREAM]);
    let limits = axes.0;
    (0..ANYWHERE).map(move |_| limits.map(|axis| axis.min_rad + (axis.max_rad - axis.min_rad) * stream.unit()))
}

/// A place with each of its nearest.
fn nearest(place: usize, places: &[Configuration], axes: &Axes) -> Vec<[usize; 2]> {
    let secs = |other: usize| axes.move_secs(&places[place], &places[other], 1.0);
    let mut others: Vec<_> = (0..places.len()).filter(|other| *other != place).map(|other| (secs(other), other)).collect();
    others.sort_by(|a, b| a.0.total_cmp(&b.0));
    others.into_iter().take(NEAREST).map(|(_, other)| [place.min(other), place.max(other)]).collect()
}

/// Roadmaps of the cells planned for lately, by what the cells are made of: the next part in a cell need not wait for its own.
#[derive(Debug, Default)]
pub struct Roadmaps(Mutex<VecDeque<(String, Arc<Roadmap>)>>);

impl Roadmaps {
    /// The cell's, made where it is not kept.
    pub(super) fn of(&self, cell: &Cell, ctx: &Context<'_>) -> Result<Arc<Roadmap>, Cancelled> {
        let key = fingerprint(cell);
        if let Some((_, roadmap)) = self.lock().iter().find(|(other, _)| *other == key) {
            return Ok(Arc::clone(roadmap));
        }
        // Not under the lock: other cells need not wait, and two who make the same one make it equal.
        let roadmap = Arc::new(Roadmap::of(cell, ctx)?);
        let mut kept = self.lock();
        kept.push_front((key, Arc::clone(&roadmap)));
        kept.truncate(KEPT);
        Ok(roadmap)
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, VecDeque<(String, Arc<Roadmap>)>> {
        // Whole after every operation, also where a thread died in between.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// SHA-256 of all that a cell is made of.
fn fingerprint(cell: &Cell) -> String {
    struct Hashed(Sha256);
    impl fmt::Write for Hashed {
        fn write_str(&mut self, text: &str) -> fmt::Result {
            self.0.update(text);
            Ok(())
        }
    }
    let mut hashed = Hashed(Sha256::new());
    // Every field, numbers to their last bit.
    let written = write!(hashed, "{cell:?}");
    debug_assert!(written.is_ok(), "nothing that is hashed fails to be written");
    hashed.0.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(test)]
mod tests;
