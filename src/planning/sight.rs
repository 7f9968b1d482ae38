//! Lines of sight past the obstacles of a cell ([`crate::planning::method::visibility`]). Obstacles stand still while the part
//! turns with the table, so what they hide of a view depends on the table's angle, and not on which joints take it there.
//!
//! Base frame, millimetres. Cost: a test of a few points for each obstacle where none comes near; else three rays for each sample
//! that a view measures.

pub(super) mod sky;
#[cfg(test)]
mod tests;

use nalgebra::{Point3, Vector3};

use super::context::{Cancelled, Context};
use super::surface::Surface;
use super::visibility::SampleSet;
use crate::cell::{Cell, Turntable};
use crate::geometry::{Aabb, Base, Part, Plate, Pose, RayScene, ScannerFrame, Table, plate_from_placed};

/// Steps in which a plane between two sets of points is looked for.
const MAX_STEPS: usize = 48;
/// Samples between two checks of the cancel flag: some milliseconds.
const SAMPLES_PER_CHECK: usize = 4096;

/// The obstacles of a cell, and the part that is seen past them.
pub(super) struct Sight {
    obstacles: Vec<Obstacle>,
    base_from_table: Pose<Base, Table>,
    turntable: Turntable,
    plate_from_part: Pose<Plate, Part>,
    /// Optical centres, scanner frame.
    centres_mm: [Point3<f64>; 3],
    /// Corners of the part's box, part frame.
    part_mm: [Point3<f64>; 8],
}

/// A body that stands still.
struct Obstacle {
    /// Corners of the box around it.
    corners_mm: Vec<Point3<f64>>,
    /// Box along the axes around those.
    aabb: Aabb,
    surface: RayScene,
}

impl Obstacle {
    /// Returns true if it lies between two points.
    fn is_between(&self, from_mm: &Point3<f64>, to_mm: &Point3<f64>) -> bool {
        meets(&self.aabb, from_mm, to_mm) && self.surface.blocked(from_mm, to_mm, 1.0)
    }
}

/// A view as the cell takes it: everything in the base frame.
struct Lines {
    base_from_part: Pose<Base, Part>,
    /// Optical centres.
    centres_mm: [Point3<f64>; 3],
}

impl Lines {
    /// Returns true if an obstacle lies between a point of the part and a device.
    fn cross(&self, obstacles: &[&Obstacle], point_mm: &Point3<f64>) -> bool {
        let in_base_mm = self.base_from_part.point(point_mm);
        let crosses = |centre_mm| obstacles.iter().any(|obstacle| obstacle.is_between(centre_mm, &in_base_mm));
        self.centres_mm.iter().any(crosses)
    }
}

impl Sight {
    /// The obstacles of `cell`; the part lies as `table_from_part` has it.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub(super) fn new(
        cell: &Cell,
        part: &Aabb,
        table_from_part: &Pose<Table, Part>,
        ctx: &Context<'_>,
    ) -> Result<Self, Cancelled> {
        let obstacle = |body: &crate::cell::Body| {
            let corners_mm: Vec<_> = body.corners_mm();
            let aabb = corners_mm.iter().fold(Aabb::empty(), |aabb, corner| aabb.with(corner));
            let surface = RayScene::interruptible([&body.surface()], || ctx.check())?;
            Ok::<_, Cancelled>(Obstacle { corners_mm, aabb, surface })
        };
        let devices = &cell.scanner.devices;
        Ok(Self {
            obstacles: cell.obstacles.iter().map(obstacle).collect::<Result<_, _>>()?,
            base_from_table: cell.base_from_table,
            turntable: cell.turntable.clone(),
            plate_from_part: plate_from_placed(table_from_part),
            centres_mm: [&devices.left, &devices.right, &devices.projector].map(|device| device.scanner_from_device.origin_mm()),
            part_mm: corners(part),
        })
    }

    /// Returns true if there is no obstacle at all.
    pub(super) fn has_no_obstacles(&self) -> bool {
        self.obstacles.is_empty()
    }

    /// Samples, of those that a view measures, that an obstacle hides from a device while the table stands at an angle; `None`
    /// where it hides none.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub(super) fn hidden(
        &self,
        surface: &Surface,
        part_from_scanner: &Pose<Part, ScannerFrame>,
        measured: &SampleSet,
        table_rad: f64,
        ctx: &Context<'_>,
    ) -> Result<Option<SampleSet>, Cancelled> {
        self.hidden_from(&self.lines(part_from_scanner, table_rad), surface, measured, ctx)
    }

    /// [`Sight::hidden`] of a part that lies displaced in the frame of the planned one. The view is given in the frame of the displaced part;
    /// obstacles stay where they are.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub(super) fn hidden_of_displaced(
        &self,
        surface: &Surface,
        (part_from_scanner, planned_from_part): (&Pose<Part, ScannerFrame>, &Pose<Part, Part>),
        measured: &SampleSet,
        table_rad: f64,
        ctx: &Context<'_>,
    ) -> Result<Option<SampleSet>, Cancelled> {
        let as_planned = self.lines(&(*planned_from_part * *part_from_scanner), table_rad);
        let lines = Lines { base_from_part: as_planned.base_from_part * *planned_from_part, ..as_planned };
        self.hidden_from(&lines, surface, measured, ctx)
    }

    fn hidden_from(
        &self,
        lines: &Lines,
        surface: &Surface,
        measured: &SampleSet,
        ctx: &Context<'_>,
    ) -> Result<Option<SampleSet>, Cancelled> {
        let near: Vec<&Obstacle> = self.near(lines).collect();
        if near.is_empty() {
            return Ok(None);
        }
        let mut hidden = SampleSet::none_of(surface.sample_mm.len());
        let mut hides = false;
        for (count, sample) in measured.iter().enumerate() {
            if count % SAMPLES_PER_CHECK == 0 {
                ctx.check()?;
            }
            if lines.cross(&near, &surface.sample_mm[sample.index()]) {
                hidden.insert(sample);
                hides = true;
            }
        }
        Ok(hides.then_some(hidden))
    }

    /// Returns true if [`Sight::hidden`] has a sample, or the job is cancelled.
    pub(super) fn hides(
        &self,
        surface: &Surface,
        part_from_scanner: &Pose<Part, ScannerFrame>,
        measured: &SampleSet,
        table_rad: f64,
        ctx: &Context<'_>,
    ) -> bool {
        let lines = self.lines(part_from_scanner, table_rad);
        let near: Vec<&Obstacle> = self.near(&lines).collect();
        let mut samples = measured.iter().enumerate();
        !near.is_empty()
            && samples.any(|(count, sample)| {
                let is_cancelled = count % SAMPLES_PER_CHECK == 0 && ctx.check().is_err();
                is_cancelled || lines.cross(&near, &surface.sample_mm[sample.index()])
            })
    }

    /// Returns true if no obstacle stands anywhere between the devices of a view and the box of the part, the table at an angle.
    pub(super) fn is_clear(&self, part_from_scanner: &Pose<Part, ScannerFrame>, table_rad: f64) -> bool {
        self.near(&self.lines(part_from_scanner, table_rad)).next().is_none()
    }

    fn lines(&self, part_from_scanner: &Pose<Part, ScannerFrame>, table_rad: f64) -> Lines {
        let base_from_part = self.base_from_table * self.turntable.table_from_plate(table_rad) * self.plate_from_part;
        let base_from_scanner = base_from_part * *part_from_scanner;
        Lines { base_from_part, centres_mm: self.centres_mm.map(|centre_mm| base_from_scanner.point(&centre_mm)) }
    }

    /// Obstacles that no plane is found to separate from the lines between the devices and the part.
    fn near<'a>(&'a self, lines: &Lines) -> impl Iterator<Item = &'a Obstacle> + use<'a> {
        let part_mm = self.part_mm.iter().map(|corner| lines.base_from_part.point(corner));
        let ends_mm: Vec<_> = part_mm.chain(lines.centres_mm).collect();
        self.obstacles.iter().filter(move |obstacle| !are_separate(&ends_mm, &obstacle.corners_mm))
    }
}

/// Returns true if a segment may meet a box (slabs: Kay and Kajiya 1986); touching counts.
fn meets(aabb: &Aabb, from_mm: &Point3<f64>, to_mm: &Point3<f64>) -> bool {
    let (mut enters, mut leaves) = (0.0_f64, 1.0_f64);
    for axis in 0..3 {
        let (start, way) = (from_mm[axis], to_mm[axis] - from_mm[axis]);
        if way == 0.0 {
            if start < aabb.min[axis] || start > aabb.max[axis] {
                return false;
            }
            continue;
        }
        let [a, b] = [aabb.min[axis], aabb.max[axis]].map(|side| (side - start) / way);
        (enters, leaves) = (enters.max(a.min(b)), leaves.min(a.max(b)));
    }
    // Rounding must not lose what touches.
    enters <= leaves + 1e-9
}

fn corners(aabb: &Aabb) -> [Point3<f64>; 8] {
    std::array::from_fn(|i| Point3::from([0, 1, 2].map(|axis| if i >> axis & 1 == 1 { aabb.max[axis] } else { aabb.min[axis] })))
}

/// Returns true if a plane is found between the convex hulls of two sets of points: the walk towards the point of their
/// difference that is nearest to the origin (Gilbert 1966, *An iterative procedure for computing the minimum of a quadratic form
/// on a convex set*).
fn are_separate(a_mm: &[Point3<f64>], b_mm: &[Point3<f64>]) -> bool {
    let mut nearest = a_mm[0] - b_mm[0];
    for _ in 0..MAX_STEPS {
        let support = farthest(a_mm, &-nearest) - farthest(b_mm, &nearest);
        if support.dot(&nearest) > 0.0 {
            return true;
        }
        let step = support - nearest;
        if step.norm_squared() == 0.0 {
            return false;
        }
        nearest += step * (-nearest.dot(&step) / step.norm_squared()).clamp(0.0, 1.0);
    }
    false
}

/// The first of the points that lie farthest in a direction.
fn farthest(points_mm: &[Point3<f64>], towards: &Vector3<f64>) -> Point3<f64> {
    let along = |point: &Point3<f64>| point.coords.dot(towards);
    points_mm.iter().fold(points_mm[0], |best, point| if along(point) > along(&best) { *point } else { best })
}
