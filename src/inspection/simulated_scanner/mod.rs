//! A scanner that exists in the computer alone: organised clouds of a part as it was built, from poses that are a little off, with
//! noise and with what real scanners do not return. Beside each cloud stands the truth: why each cell has no point, and the pose
//! at which the view was really taken. Tests hold inspection against it, and users rehearse with it.
//!
//! A cell returns a point where the ray of the left camera's pixel meets a surface that all devices see
//! ([`crate::planning::method::visibility`], with the scanner's own limits: its optics are those of the planner, its shadows are
//! rays), unless one of the weaknesses in [`SimulationParams`] takes it. Noise runs along the ray, such that its standard
//! deviation across the surface is that of [`crate::planning::surface::requirements`].
//!
//! Same input, same bytes, on any number of threads: everything random depends on seed, viewpoint and cell alone.
//! Cost: three rays a cell at most, in packets; 8 bytes a cell once, 21 a cell and view. Part frame, mm.

mod cast;
mod faults;
mod noise;
mod params;
mod steps;
#[cfg(test)]
mod tests;

pub use faults::{crop, in_unit, swap};
pub use params::SimulationParams;

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

use super::ViewScan;
use super::mirror::Reflection;
use super::pixel_grid::PixelGrid;
use crate::cell::{Scanner, closed_list};
use crate::geometry::parallel;
use crate::geometry::{Mesh, Part, Pose, RayScene, ScannerFrame};
use crate::planning::ConcaveZone;
use crate::planning::context::{Cancelled, Context};
use crate::planning::params::PlanParams;
use crate::planning::random::Stream;
use crate::planning::surface::requirements::Requirements;
use crate::planning::visibility::Optics;

/// Names of the streams of random numbers.
const VIEW_ERROR: u64 = 0x76_6965_7765;
const PART_ERROR: u64 = 0x70_6172_7465;

closed_list! {
    /// Fate of a cell of a simulated cloud.
    pub enum CellFate {
        /// The point of the part is returned.
        Returned = "returned",
        /// The ray of the cell meets nothing.
        Empty = "empty",
        /// The ray of the cell meets plate or fixture first.
        Surroundings = "surroundings",
        /// A device does not see the point.
        Unseen = "unseen",
        /// Something that the plan knows nothing of is in the way of a device.
        UnmodelledOccluder = "unmodelled_occluder",
        /// Seen at too large an angle to return.
        Grazing = "grazing",
        /// Glare.
        Specular = "specular",
        /// Beside a step of depth.
        Edge = "edge",
        /// The point lies in a concave corner.
        Concave = "concave",
        /// Too little light.
        Dark = "dark",
        /// Too much light.
        Saturated = "saturated",
        /// Cut off the file.
        OutsideFile = "outside_file",
    }
}

/// Everything that is scanned, in the part's nominal coordinates.
#[derive(Clone, Copy)]
pub struct ScannedScene<'a> {
    /// The part as it was built.
    pub as_built: &'a Mesh,
    /// Fixture that holds it.
    pub fixture: Option<&'a Mesh>,
    /// Plate below it.
    pub plate: Option<&'a Mesh>,
    /// A body that the plan does not know of.
    pub unknown: Option<&'a Mesh>,
    /// Albedo of each triangle of the part as built, where it is not [`SimulationParams::albedo`].
    pub face_albedo: Option<&'a [f32]>,
}

/// One simulated capture, and the truth about it.
#[derive(Clone, Debug)]
pub struct SimulatedView {
    /// The capture, as inspection gets it.
    pub scan: ViewScan,
    /// Pose from which it was taken, in the coordinates of the part as it really lay.
    pub true_part_from_scanner: Pose<Part, ScannerFrame>,
    /// Fate of each cell.
    pub fates: Vec<CellFate>,
    grid: PixelGrid,
}

impl SimulatedView {
    /// Fate of the cell in which a point of the part as built lies; `None` outside of the grid.
    #[must_use]
    pub fn fate_at(&self, part_mm: &Point3<f64>) -> Option<CellFate> {
        let scanner_mm = self.true_part_from_scanner.inverse().point(part_mm);
        self.grid.cell_of(&scanner_mm).map(|cell| self.fates[self.grid.number(cell)])
    }
}

/// The scanner in front of a scene, ready for many views.
pub struct SimulatedScanner<'a> {
    scanner: &'a Scanner,
    sim: SimulationParams,
    scene: ScannedScene<'a>,
    optics: Optics,
    grid: PixelGrid,
    /// Rays of the cells in the left camera's frame at depth 1: x and y.
    rays: Vec<[f32; 2]>,
    /// The part as built, where it lies.
    placed: Mesh,
    part_from_as_built: Isometry3<f64>,
    /// Part, fixture, plate, unknown body: triangles in that order.
    surfaces: RayScene,
    /// Without the unknown body, where there is one.
    known_surfaces: Option<RayScene>,
    /// Concave corners, in the coordinates of the part as built.
    concave: Option<ConcaveZone>,
    reflection: Reflection,
}

impl<'a> SimulatedScanner<'a> {
    /// Sets up `scanner` as `params` of a plan know its noise.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub fn new(
        scanner: &'a Scanner,
        params: &PlanParams,
        sim: &SimulationParams,
        scene: ScannedScene<'a>,
        ctx: &Context<'_>,
    ) -> Result<Self, Cancelled> {
        let mut optics_params = PlanParams::default();
        optics_params.regions.noise.best_mm = sim.noise_best_mm.unwrap_or(params.regions.noise.best_mm);
        optics_params.regions.noise.depth_gain = sim.noise_depth_gain.unwrap_or(params.regions.noise.depth_gain);
        let part_from_as_built = part_error(sim, scene.as_built);
        let mut placed = scene.as_built.clone();
        placed.vertices_mm.iter_mut().for_each(|vertex| *vertex = part_from_as_built * *vertex);
        let known = [Some(&placed), scene.fixture, scene.plate];
        let surfaces = RayScene::interruptible(known.into_iter().chain([scene.unknown]).flatten(), || ctx.check())?;
        let known_surfaces = match scene.unknown {
            Some(_) => Some(RayScene::interruptible(known.into_iter().flatten(), || ctx.check())?),
            None => None,
        };
        let concave = match sim.concave_mm > 0.0 {
            true => Some(ConcaveZone::new(scene.as_built, sim.concave_dihedral_deg.to_radians(), sim.concave_mm, ctx)?),
            false => None,
        };
        let grid = PixelGrid::new(scanner, sim.step_px);
        let rays = parallel::map_range(grid.cells(), |cell| {
            let ray = grid.device_ray(cell);
            [ray.x as f32, ray.y as f32]
        });
        Ok(Self {
            scanner,
            sim: sim.clone(),
            scene,
            optics: Optics::new(scanner, &optics_params, &Requirements::default()),
            rays,
            grid,
            placed,
            part_from_as_built,
            surfaces,
            known_surfaces,
            concave,
            reflection: Reflection::new(scanner),
        })
    }

    /// Scans from each of some viewpoints, by number and nominal pose.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub fn scan(&self, views: &[(u32, Pose<Part, ScannerFrame>)], ctx: &Context<'_>) -> Result<Vec<SimulatedView>, Cancelled> {
        views.iter().map(|(viewpoint, pose)| self.scan_view(*viewpoint, pose, ctx)).collect()
    }

    /// Scans from one viewpoint.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub fn scan_view(
        &self,
        viewpoint: u32,
        part_from_scanner: &Pose<Part, ScannerFrame>,
        ctx: &Context<'_>,
    ) -> Result<SimulatedView, Cancelled> {
        let error = self.view_error(viewpoint);
        let taken = Pose::claim(part_from_scanner.isometry() * error);
        let (scanner_cloud, fates) = cast::cast(self, viewpoint, &taken, ctx)?;
        Ok(SimulatedView {
            scan: ViewScan { viewpoint, part_from_scanner: *part_from_scanner, scanner_cloud },
            true_part_from_scanner: Pose::claim(self.part_from_as_built.inverse() * taken.isometry()),
            fates,
            grid: self.grid,
        })
    }

    /// Motion of the scanner's frame by which a view is off its pose.
    fn view_error(&self, viewpoint: u32) -> Isometry3<f64> {
        let mut stream = Stream::new(self.sim.seed, &[VIEW_ERROR, u64::from(viewpoint)]);
        motion(&mut stream, self.sim.view_error_deg, self.sim.view_error_mm)
    }
}

/// Motion of the part about the centre of its box.
fn part_error(sim: &SimulationParams, part: &Mesh) -> Isometry3<f64> {
    let centre = Translation3::from(part.aabb().centre());
    let motion = motion(&mut Stream::new(sim.seed, &[PART_ERROR]), sim.part_error_deg, sim.part_error_mm);
    centre * motion * centre.inverse()
}

/// Turn by an angle about an axis at random, and shift by a distance in a direction at random.
fn motion(stream: &mut Stream, angle_deg: f64, distance_mm: f64) -> Isometry3<f64> {
    let rotation = UnitQuaternion::from_axis_angle(&stream.direction(), angle_deg.to_radians());
    let shift_mm: Vector3<f64> = stream.direction().into_inner() * distance_mm;
    Isometry3::from_parts(Translation3::from(shift_mm), rotation)
}
