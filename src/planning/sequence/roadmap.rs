//! The roadmap of a cell: configurations at which the arm clears the cell alone, whatever lies on its table, and the straight
//! edges between them (L. Kavraki, P. Švestka, J.-C. Latombe and M. Overmars, "Probabilistic roadmaps for path planning in
//! high-dimensional configuration spaces", IEEE Trans. Robotics and Automation 12(4), 1996). The plate is round, so the
//! table's angle does not matter here. A roadmap follows from its cell alone and holds for every part on it: a caller that plans
//! many parts in one cell keeps it ([`Roadmaps`]), and gets the same plans as one that makes it anew each time.
//!
//! Cost: about a thousand vertices, a few thousand edges to prove free, some tenths of a second on two cores.

use std::collections::{BTreeSet, VecDeque};
use std::fmt::{self, Write};
use std::sync::{Arc, Mutex, PoisonError};

use nalgebra::Vector3;
use rayon::prelude::*;
use sha2::{Digest, Sha256};

use crate::cell::collision::MIN_CLEARANCE_MM;
use crate::cell::{Axes, Body, Cell, CollisionScene, Configuration, Shape};
use crate::geometry::{Base, Mesh, Pose, ScannerFrame, Table, sort_ascending};
use crate::planning::candidates::{looking_along, spiral};
use crate::planning::context::{Cancelled, Context};
use crate::planning::random::Stream;

/// Directions from which the scanner looks at the table.
const DIRECTIONS: usize = 32;
/// Rolls about each direction.
const ROLLS: usize = 4;
/// Distances beyond the best one at which the scanner looks at the table, in radii of the plate: beside what stands on it, and
/// clear of it.
const BEYOND_RADII: [f64; 2] = [0.5, 1.2];
/// Height above the plate of the point that the scanner looks at, in radii.
const ABOVE_RADII: f64 = 0.3;
/// Vertices drawn uniformly within the limits of the axes.
const RANDOM_VERTICES: usize = 96;
/// Names the stream of random vertices.
const STREAM: u64 = 0x726f_6164;
/// Edges from a vertex to the nearest others, before those that collide are left out.
const NEIGHBOURS: usize = 6;
/// Roadmaps, and scenes, that are kept at most.
const MAX_KEPT: usize = 8;
/// Triangles of a cell's bodies beyond which its scene is not kept, since it takes as much memory as a large part.
const MAX_KEPT_TRIANGLES: usize = 500_000;

/// Vertices of one cell and edges between them.
#[derive(Debug, PartialEq)]
pub(super) struct Roadmap {
    /// Configurations, home first. All have home's table angle, which does not matter.
    pub(super) vertices: Vec<Configuration>,
    /// Edges, as the numbers of their two vertices.
    pub(super) edges: Vec<[usize; 2]>,
    /// Edges of each vertex.
    pub(super) edges_at: Vec<Vec<usize>>,
}

impl Roadmap {
    fn of(cell: &Cell, scene: &CollisionScene, ctx: &Context<'_>) -> Result<Self, Cancelled> {
        let axes = cell.axes();
        let mut vertices: Vec<_> = viewing(cell, &axes).into_iter().chain(random(&axes)).collect();
        vertices.iter_mut().for_each(|vertex| vertex.table_rad = cell.home_rad.table_rad);
        ctx.check()?;
        let free: Vec<_> = vertices.into_par_iter().filter(|vertex| scene.check(vertex).is_none()).collect();
        let vertices: Vec<_> = std::iter::once(cell.home_rad).chain(free).collect();
        let pairs: BTreeSet<[usize; 2]> =
            (0..vertices.len()).into_par_iter().flat_map_iter(|vertex| nearest(vertex, &vertices, &axes)).collect();
        let is_free = |[a, b]: &[usize; 2]| {
            ctx.check()?;
            Ok(scene.check_segment(&vertices[*a], &vertices[*b]).is_none())
        };
        let free: Vec<bool> = pairs.par_iter().map(is_free).collect::<Result<_, Cancelled>>()?;
        let edges: Vec<_> = pairs.into_iter().zip(free).filter_map(|(edge, free)| free.then_some(edge)).collect();
        let mut edges_at = vec![Vec::new(); vertices.len()];
        edges.iter().enumerate().for_each(|(edge, ends)| ends.iter().for_each(|end| edges_at[*end].push(edge)));
        Ok(Self { vertices, edges, edges_at })
    }
}

/// Configurations from which the scanner looks at the table: every IK solution of each pose.
fn viewing(cell: &Cell, axes: &Axes) -> Vec<Configuration> {
    let radius_mm = cell.turntable.plate_radius_mm;
    let at = Vector3::z() * (ABOVE_RADII * radius_mm);
    let poses = spiral(DIRECTIONS, 0.0).flat_map(|out| {
        let rolls = (0..ROLLS).map(|roll| std::f64::consts::TAU * roll as f64 / ROLLS as f64);
        rolls.flat_map(move |roll_rad| BEYOND_RADII.map(|radii| (out, roll_rad, radii)))
    });
    let vertices = poses.flat_map(|(out, roll_rad, radii)| {
        let distance_mm = cell.scanner.best_mm + radii * radius_mm;
        let table_from_scanner: Pose<Table, ScannerFrame> =
            Pose::from_parts(at + out * distance_mm, looking_along(&-out, roll_rad));
        let base_from_scanner: Pose<Base, ScannerFrame> = cell.base_from_table * table_from_scanner;
        cell.robot.kinematics.ik_solutions(&(base_from_scanner * cell.flange_from_scanner.inverse()))
    });
    vertices.filter_map(|joints| as_near_home(&joints, cell, axes)).collect()
}

/// Picks the turns of a vertex's joints that are nearest to home.
fn as_near_home(joints_rad: &[f64; 6], cell: &Cell, axes: &Axes) -> Option<Configuration> {
    let mut vertex = cell.home_rad;
    for ((at, joint), axis) in vertex.joints_rad.iter_mut().zip(joints_rad).zip(&axes.0) {
        let home = *at;
        *at = axis.windings(*joint).min_by(|a, b| (a - home).abs().total_cmp(&(b - home).abs()))?;
    }
    Some(vertex)
}

fn random(axes: &Axes) -> impl Iterator<Item = Configuration> {
    let mut stream = Stream::new(0, &[STREAM]);
    let limits = axes.0;
    let mut angles_rad = move || limits.map(|axis| axis.min_rad + (axis.max_rad - axis.min_rad) * stream.unit());
    (0..RANDOM_VERTICES).map(move |_| Configuration::from_axes_rad(angles_rad()))
}

/// Pairs of a vertex and each of its nearest.
fn nearest(vertex: usize, vertices: &[Configuration], axes: &Axes) -> Vec<[usize; 2]> {
    let secs = |other: usize| axes.move_secs(&vertices[vertex], &vertices[other], 1.0);
    let mut others: Vec<_> = (0..vertices.len()).filter(|other| *other != vertex).map(|other| (secs(other), other)).collect();
    sort_ascending(&mut others, |other| other.0);
    others.into_iter().take(NEIGHBOURS).map(|(_, other)| [vertex.min(other), vertex.max(other)]).collect()
}

/// Values with their keys, the latest first.
type Latest<T> = VecDeque<(String, Arc<T>)>;

/// Roadmaps and collision scenes of the cells planned for lately, by what the cells are made of: the next part in a cell need not wait
/// for its own.
#[derive(Debug, Default)]
pub struct Roadmaps {
    roadmaps: Mutex<Latest<Roadmap>>,
    /// Scenes with nothing on the plate; the clearance is in the key.
    scenes: Mutex<Latest<CollisionScene>>,
}

impl Roadmaps {
    /// Returns the cell's roadmap, and makes it where it is not kept.
    pub(super) fn of(&self, cell: &Cell, ctx: &Context<'_>) -> Result<Arc<Roadmap>, Cancelled> {
        let key = fingerprint(cell);
        if let Some((_, roadmap)) = self.lock().iter().find(|(other, _)| *other == key) {
            return Ok(Arc::clone(roadmap));
        }
        // Not under the lock: other cells need not wait, and two who make the same one make it equal.
        let roadmap = Arc::new(Roadmap::of(cell, &self.bare_scene(cell, MIN_CLEARANCE_MM), ctx)?);
        keep(&mut self.lock(), key, &roadmap);
        Ok(roadmap)
    }

    /// Returns the cell's scene with nothing on its plate, and makes it where it is not kept.
    pub(in crate::planning) fn bare_scene(&self, cell: &Cell, clearance_mm: f64) -> Arc<CollisionScene> {
        let key = format!("{} {:x}", fingerprint(cell), clearance_mm.to_bits());
        let scenes = || self.scenes.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, scene)) = scenes().iter().find(|(other, _)| *other == key) {
            return Arc::clone(scene);
        }
        let scene = Arc::new(CollisionScene::without_part(cell, clearance_mm));
        if cell.surfaces().iter().map(|mesh| mesh.faces.len()).sum::<usize>() <= MAX_KEPT_TRIANGLES {
            keep(&mut scenes(), key, &scene);
        }
        scene
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, Latest<Roadmap>> {
        // Whole after every operation, also where a thread died in between.
        self.roadmaps.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn keep<T>(latest: &mut Latest<T>, key: String, value: &Arc<T>) {
    latest.push_front((key, Arc::clone(value)));
    latest.truncate(MAX_KEPT);
}

/// SHA-256 of all fields of a cell.
fn fingerprint(cell: &Cell) -> String {
    struct Hashed(Sha256);
    impl fmt::Write for Hashed {
        fn write_str(&mut self, text: &str) -> fmt::Result {
            self.0.update(text);
            Ok(())
        }
    }
    let mut hashed = Hashed(Sha256::new());
    // Every field, numbers to their last bit; meshes by their bytes, for their digits take ten times as long.
    let (bare, meshes) = without_meshes(cell);
    let written = write!(hashed, "{bare:?}");
    debug_assert!(written.is_ok(), "nothing that is hashed fails to be written");
    for mesh in meshes {
        mesh.vertices_mm.iter().flat_map(|vertex| vertex.iter()).for_each(|at| hashed.0.update(at.to_bits().to_le_bytes()));
        mesh.faces.as_flattened().iter().for_each(|corner| hashed.0.update(corner.to_le_bytes()));
        hashed.0.update(mesh.faces.len().to_le_bytes());
    }
    hashed.0.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
}

/// The cell with its bodies' meshes taken out, each body numbered in its place, and the meshes, in that order.
fn without_meshes(cell: &Cell) -> (Cell, Vec<Arc<Mesh>>) {
    let (mut bare, mut meshes) = (cell.clone(), Vec::new());
    let take = |body: &mut Body| {
        if let Shape::Mesh(mesh) = &body.shape {
            meshes.push(Arc::clone(mesh));
            // No other body has such a shape.
            body.shape = Shape::Box { size_mm: [f64::NAN; 3] };
        }
    };
    let carried = bare.link_surfaces.iter_mut().chain(&mut bare.cable).map(|carried| &mut carried.body);
    let rigid = bare.scanner_bodies.iter_mut().chain(&mut bare.mount).chain(&mut bare.table_bodies).chain(&mut bare.obstacles);
    carried.chain(rigid).for_each(take);
    (bare, meshes)
}

#[cfg(test)]
mod tests;
