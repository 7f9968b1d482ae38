//! The model as a scanner without any weakness would see it at a registered pose, ray by ray of the left camera's grid.

use nalgebra::{Point3, Vector3};

use crate::cell::{DeviceName, PerDevice, Scanner};
use crate::geometry::{Mesh, Part, Pose, RayScene, ScannerFrame};
use crate::inspection::PixelGrid;
use crate::planning::context::{Cancelled, Context};
use crate::planning::params::PlanParams;
use crate::planning::surface::requirements::Requirements;
use crate::planning::visibility::{Optics, RAY_END_SHARE, View};

/// Part, fixture and plate as planned, and the scanner's own limits.
pub struct NominalModel<'a> {
    mesh: &'a Mesh,
    surfaces: RayScene,
    optics: Optics,
}

/// First point of the model on a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ModelPoint {
    /// Position, part frame.
    pub point_mm: Point3<f64>,
    /// Unit normal of its triangle, part frame; of fixture and plate zero.
    pub normal: Vector3<f64>,
    /// True if it is the part's, and all devices see it.
    pub is_seen: bool,
}

impl<'a> NominalModel<'a> {
    /// A model of `mesh` with what stands around it.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub fn new(mesh: &'a Mesh, surroundings: &[&Mesh], scanner: &Scanner, ctx: &Context<'_>) -> Result<Self, Cancelled> {
        let surfaces = RayScene::interruptible([mesh].into_iter().chain(surroundings.iter().copied()), || ctx.check())?;
        Ok(Self { mesh, surfaces, optics: Optics::new(scanner, &PlanParams::default(), &Requirements::default()) })
    }

    /// Mesh of the part.
    #[must_use]
    pub fn mesh(&self) -> &'a Mesh {
        self.mesh
    }

    /// Surfaces of part, fixture and plate.
    #[must_use]
    pub fn surfaces(&self) -> &RayScene {
        &self.surfaces
    }

    /// The scanner at a pose, with its own limits.
    #[must_use]
    pub fn view(&self, pose: &Pose<Part, ScannerFrame>) -> View<'_> {
        self.optics.at(pose)
    }

    /// The first point on the ray of each of some cells; `None` where a ray meets nothing.
    #[must_use]
    pub fn at_cells(
        &self,
        pose: &Pose<Part, ScannerFrame>,
        grid: &PixelGrid,
        cells: &[usize],
        ctx: &Context<'_>,
    ) -> Vec<Option<ModelPoint>> {
        let (centre_mm, view) = (pose.point(&grid.centre_mm()), self.view(pose));
        let directions: Vec<Vector3<f64>> = cells.iter().map(|cell| pose.direction(&grid.ray(*cell))).collect();
        let mut hits = Vec::new();
        self.surfaces.first_hits_from(ctx.simd_level(), &centre_mm, &directions, &mut hits);
        let point = |(hit, direction): (&Option<crate::geometry::Hit>, &Vector3<f64>)| {
            let hit = (*hit)?;
            let point_mm = centre_mm + direction * hit.share;
            let is_part = (hit.triangle as usize) < self.mesh.faces.len();
            let normal = if is_part { self.mesh.scaled_normal(hit.triangle as usize).normalize() } else { Vector3::zeros() };
            let is_seen = is_part && view.before_shadow(&point_mm, &normal, 0).is_ok();
            Some(ModelPoint { point_mm, normal, is_seen })
        };
        let mut points: Vec<Option<ModelPoint>> = hits.iter().zip(&directions).map(point).collect();
        self.hide(&mut points, view.centres_mm(), ctx);
        points
    }

    /// Takes the points that the right camera or the projector does not see.
    fn hide(&self, points: &mut [Option<ModelPoint>], centres_mm: &PerDevice<Point3<f64>>, ctx: &Context<'_>) {
        let mut blocked = Vec::new();
        for device in [DeviceName::Right, DeviceName::Projector] {
            let mut seen: Vec<&mut ModelPoint> = points.iter_mut().flatten().filter(|point| point.is_seen).collect();
            let targets: Vec<Point3<f64>> = seen.iter().map(|point| point.point_mm).collect();
            self.surfaces.blocked_from(ctx.simd_level(), &centres_mm[device], &targets, RAY_END_SHARE, &mut blocked);
            seen.iter_mut().zip(&blocked).for_each(|(point, blocked)| point.is_seen = !blocked);
        }
    }
}
