//! One simulated view: first hits of the left camera's rays, the optics at each, shadows of the other devices, weaknesses, noise.

use nalgebra::{Isometry3, Point3, Rotation3, Vector3};

use super::noise::ViewNoise;
use super::steps::near_steps;
use super::{CellFate, SimulatedScanner};
use crate::cell::DeviceName;
use crate::geometry::{CloudGrid, Hit, Part, PointCloud, Pose, ScannerFrame, parallel};
use crate::inspection::mirror::Reflection;
use crate::planning::context::{Cancelled, Context};
use crate::planning::visibility::{RAY_END_SHARE, View};

/// Rows of cells that a thread casts at a time.
const ROWS: usize = 4;
/// Index of a ray that meets no triangle.
const NONE: u32 = u32::MAX;
/// Exponent's base of the brightness levels: two levels double the light. Assumed: no figure is published.
const LIGHT_A_LEVEL: f64 = std::f64::consts::SQRT_2;
/// Level and albedo of which the signal is 1, seen straight on at the best focus.
const REFERENCE_LEVEL: f64 = 5.0;
const REFERENCE_ALBEDO: f64 = 0.5;

/// First hit of each cell's ray.
pub(super) struct FirstHits<'a> {
    scanner: &'a SimulatedScanner<'a>,
    /// Triangle, or [`NONE`], and depth in the left camera.
    hits: Vec<(u32, f32)>,
    part_from_left: Isometry3<f64>,
}

/// A surface point that a ray meets.
struct SurfacePoint {
    point_mm: Point3<f64>,
    normal: Vector3<f64>,
    triangle: usize,
}

impl<'a> FirstHits<'a> {
    fn new(scanner: &'a SimulatedScanner<'a>, part_from_left: Isometry3<f64>, ctx: &Context<'_>) -> Result<Self, Cancelled> {
        let turn: Rotation3<f64> = part_from_left.rotation.to_rotation_matrix();
        let centre_mm = Point3::from(part_from_left.translation.vector);
        let blocks = parallel::try_map_chunks(&scanner.rays, ROWS * scanner.grid.size.columns, |rays| {
            ctx.check()?;
            let direction = |[x, y]: &[f32; 2]| turn * Vector3::new(f64::from(*x), f64::from(*y), 1.0);
            let (directions, mut hits) = (rays.iter().map(direction).collect::<Vec<_>>(), Vec::new());
            scanner.surfaces.first_hits_from(ctx.simd_level(), &centre_mm, &directions, &mut hits);
            let packed = |hit: &Option<Hit>| hit.map_or((NONE, f32::INFINITY), |hit| (hit.triangle, hit.share as f32));
            Ok::<_, Cancelled>(hits.iter().map(packed).collect::<Vec<_>>())
        })?;
        Ok(Self { scanner, hits: blocks.concat(), part_from_left })
    }

    pub(super) fn size(&self) -> CloudGrid {
        self.scanner.grid.size
    }

    pub(super) fn is_hit(&self, cell: usize) -> bool {
        self.hits[cell].0 != NONE
    }

    fn ray(&self, cell: usize) -> Vector3<f64> {
        let [x, y] = self.scanner.rays[cell].map(f64::from);
        self.part_from_left.rotation * Vector3::new(x, y, 1.0)
    }

    fn point(&self, cell: usize) -> Option<SurfacePoint> {
        let (triangle, depth) = self.hits[cell];
        (triangle != NONE).then(|| SurfacePoint {
            point_mm: Point3::from(self.part_from_left.translation.vector + self.ray(cell) * f64::from(depth)),
            normal: self.scanner.normal(triangle as usize),
            triangle: triangle as usize,
        })
    }

    /// Returns true if `cell`, which has a hit, and its neighbour meet surfaces so far apart in depth, and as far from the planes
    /// of each other's triangles along the ray: a slope is no step.
    pub(super) fn is_step(&self, cell: usize, other: usize, step_mm: f64) -> bool {
        let (Some(here), Some(there)) = (self.point(cell), self.point(other)) else { return true };
        let depths = [self.hits[cell].1, self.hits[other].1].map(f64::from);
        let off_plane = |from: &SurfacePoint, ray: Vector3<f64>, depth: f64| {
            let centre_mm = Point3::from(self.part_from_left.translation.vector);
            let expected = from.normal.dot(&(from.point_mm - centre_mm)) / from.normal.dot(&ray);
            // A plane along the ray joins nothing.
            expected.is_nan() || (expected - depth).abs() >= step_mm
        };
        (depths[0] - depths[1]).abs() >= step_mm
            && off_plane(&here, self.ray(other), depths[1])
            && off_plane(&there, self.ray(cell), depths[0])
    }
}

impl SimulatedScanner<'_> {
    /// Unit normal of a triangle of the scene.
    fn normal(&self, triangle: usize) -> Vector3<f64> {
        let mut first = 0;
        for mesh in [Some(&self.placed), self.scene.fixture, self.scene.plate, self.scene.unknown].into_iter().flatten() {
            if triangle < first + mesh.faces.len() {
                return mesh.scaled_normal(triangle - first).normalize();
            }
            first += mesh.faces.len();
        }
        unreachable!("a hit has a triangle of the scene")
    }

    /// Triangles of the part, and of everything that is known.
    fn counts(&self) -> [usize; 2] {
        let known = [Some(&self.placed), self.scene.fixture, self.scene.plate];
        [self.placed.faces.len(), known.into_iter().flatten().map(|mesh| mesh.faces.len()).sum()]
    }
}

/// One view, ready for its cells.
struct ViewCast<'a> {
    scanner: &'a SimulatedScanner<'a>,
    hits: FirstHits<'a>,
    near_steps: Option<Vec<bool>>,
    view: View<'a>,
    reflection: Reflection,
    noise: ViewNoise,
    scanner_from_part: Isometry3<f64>,
    counts: [usize; 2],
}

/// Casts a view that is taken from `pose`, in nominal coordinates: points in the scanner's frame, and the fate of every cell.
///
/// # Errors
/// [`Cancelled`].
pub(super) fn cast(
    scanner: &SimulatedScanner<'_>,
    viewpoint: u32,
    pose: &Pose<Part, ScannerFrame>,
    ctx: &Context<'_>,
) -> Result<(PointCloud, Vec<CellFate>), Cancelled> {
    let left = &scanner.scanner.devices.left;
    let hits = FirstHits::new(scanner, pose.isometry() * left.scanner_from_device.isometry(), ctx)?;
    let sim = &scanner.sim;
    let reach = sim.edge_px / scanner.grid.step_px;
    let near_steps = (sim.edge_px > 0.0).then(|| near_steps(&hits, sim.edge_step_mm, reach));
    let view = ViewCast {
        scanner,
        near_steps,
        view: scanner.optics.at(pose),
        reflection: scanner.reflection.at(pose),
        noise: ViewNoise::new(scanner, viewpoint),
        scanner_from_part: pose.isometry().inverse(),
        counts: scanner.counts(),
        hits,
    };
    let block = ROWS * scanner.grid.size.columns;
    let cells = scanner.grid.cells();
    let blocks = parallel::try_map_range(cells.div_ceil(block), |first| {
        ctx.check()?;
        Ok::<_, Cancelled>(view.block(first * block..cells.min((first + 1) * block), ctx))
    })?;
    let points_mm = blocks.iter().flat_map(|(points, _)| points).copied().collect();
    let fates = blocks.iter().flat_map(|(_, fates)| fates).copied().collect();
    Ok((PointCloud { points_mm, grid: Some(scanner.grid.size) }, fates))
}

impl ViewCast<'_> {
    fn block(&self, cells: std::ops::Range<usize>, ctx: &Context<'_>) -> (Vec<[f32; 3]>, Vec<CellFate>) {
        let first = cells.start;
        let mut fates = vec![CellFate::Empty; cells.len()];
        let mut seen: Vec<(usize, SurfacePoint)> = Vec::new();
        for cell in cells {
            let Some(surface) = self.hits.point(cell) else { continue };
            fates[cell - first] = CellFate::Unseen;
            if self.view.before_shadow(&surface.point_mm, &surface.normal, 0).is_ok() {
                seen.push((cell, surface));
            }
        }
        let targets: Vec<Point3<f64>> = seen.iter().map(|(_, surface)| surface.point_mm).collect();
        let hidden = self.hidden(&targets, ctx);
        let mut points = vec![[f32::NAN; 3]; fates.len()];
        for ((cell, surface), hidden) in seen.iter().zip(hidden) {
            let fate = hidden.unwrap_or_else(|| self.fate(*cell, surface));
            fates[cell - first] = fate;
            let is_other = matches!(fate, CellFate::UnmodelledOccluder | CellFate::Surroundings) && hidden.is_none();
            let is_wanted = fate != CellFate::Surroundings || self.scanner.sim.with_surroundings;
            if fate == CellFate::Returned || is_other && is_wanted {
                points[cell - first] = self.measured(*cell, surface);
            }
        }
        (points, fates)
    }

    /// Fates of the points that something hides from the right camera or from the projector.
    fn hidden(&self, targets: &[Point3<f64>], ctx: &Context<'_>) -> Vec<Option<CellFate>> {
        let (level, mut blocked) = (ctx.simd_level(), Vec::new());
        let mut hidden = vec![None; targets.len()];
        for device in [DeviceName::Right, DeviceName::Projector] {
            let centre = &self.view.centres_mm()[device];
            self.scanner.surfaces.blocked_from(level, centre, targets, RAY_END_SHARE, &mut blocked);
            for (place, _) in blocked.iter().enumerate().filter(|(_, is_blocked)| **is_blocked) {
                let known = self.scanner.known_surfaces.as_ref();
                let is_known = known.is_none_or(|known| known.blocked(centre, &targets[place], RAY_END_SHARE));
                let fate = if is_known { CellFate::Unseen } else { CellFate::UnmodelledOccluder };
                // What is known to hide a point goes before what is not.
                if hidden[place] != Some(CellFate::Unseen) {
                    hidden[place] = Some(fate);
                }
            }
        }
        hidden
    }

    /// Fate of a cell whose point all devices see.
    fn fate(&self, cell: usize, surface: &SurfacePoint) -> CellFate {
        let [part, known] = self.counts;
        if surface.triangle >= part {
            return if surface.triangle >= known { CellFate::UnmodelledOccluder } else { CellFate::Surroundings };
        }
        let (sim, point_mm, normal) = (&self.scanner.sim, &surface.point_mm, &surface.normal);
        if let [begin_deg, end_deg] = sim.grazing_deg[..] {
            let angles = self.view.incidence_rad(point_mm, normal);
            let worst_deg = angles.into_iter().fold(0.0, f64::max).to_degrees();
            if self.noise.draw(cell) < (worst_deg - begin_deg) / (end_deg - begin_deg) {
                return CellFate::Grazing;
            }
        }
        if sim.lobe_deg > 0.0 && self.reflection.mirror_rad(point_mm, normal) < sim.lobe_deg.to_radians() {
            return CellFate::Specular;
        }
        if self.near_steps.as_ref().is_some_and(|near| near[cell]) {
            return CellFate::Edge;
        }
        let as_built_from_part = self.scanner.part_from_as_built.inverse();
        let in_corner =
            |zone: &crate::planning::ConcaveZone| zone.holds(&(as_built_from_part * point_mm), &(as_built_from_part * normal));
        if self.scanner.concave.as_ref().is_some_and(in_corner) {
            return CellFate::Concave;
        }
        if let [dark, saturated] = sim.signal[..] {
            let signal = self.signal(surface);
            if signal < dark {
                return CellFate::Dark;
            }
            if signal > saturated {
                return CellFate::Saturated;
            }
        }
        CellFate::Returned
    }

    /// Light that a point of the part returns, relative to the reference: Lambert's law in the projector's light, which falls off
    /// with the square of the distance.
    fn signal(&self, surface: &SurfacePoint) -> f64 {
        let albedo = self.scanner.scene.face_albedo.map_or(self.scanner.sim.albedo, |albedo| f64::from(albedo[surface.triangle]));
        let level = f64::from(self.scanner.sim.brightness) - REFERENCE_LEVEL;
        let towards = self.view.centres_mm().projector - surface.point_mm;
        let (distance_mm, best_mm) = (towards.norm(), self.scanner.scanner.best_mm);
        let cos = surface.normal.dot(&towards) / distance_mm;
        albedo / REFERENCE_ALBEDO * LIGHT_A_LEVEL.powf(level) * cos * (best_mm / distance_mm).powi(2)
    }

    /// The point as it is measured, scanner frame.
    fn measured(&self, cell: usize, surface: &SurfacePoint) -> [f32; 3] {
        let ray = self.hits.ray(cell);
        let depth_mm = f64::from(self.hits.hits[cell].1);
        let precision = self.view.precision_at(&surface.point_mm, &surface.normal);
        // Along the ray, so that what is left of it across the surface has the expected deviation.
        let along = (surface.normal.dot(&ray) / ray.norm()).abs();
        let error_mm = self.noise.of_cell(cell) * precision.noise_mm / along;
        let shared = self.noise.shared_mm(cell, depth_mm);
        let point_mm = surface.point_mm + ray * (error_mm / ray.norm() + shared);
        let scanner_mm = self.scanner_from_part * point_mm;
        [scanner_mm.x as f32, scanner_mm.y as f32, scanner_mm.z as f32]
    }
}
