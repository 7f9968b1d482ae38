//! Input of a plan: borrowed, so that a job's part is held once.

use crate::cell::{Cell, PoseSpec, Scanner};
use crate::geometry::Mesh;
use crate::planning::context::{PlanError, Refusal};
use crate::planning::sequence::Roadmaps;

/// Part, fixture, scanner and cell to plan for.
pub struct PlanInput<'a> {
    /// The part.
    pub mesh: &'a Mesh,
    /// The fixture that holds it: occludes and collides, is not measured. In part coordinates.
    pub fixture: Option<&'a Mesh>,
    /// SHA-256 of the part's file, lower-case hexadecimal.
    pub part_sha256: &'a str,
    /// The scanner; the cell's own where there is a cell.
    pub scanner: &'a Scanner,
    /// The cell; `None` plans viewpoints alone.
    pub cell: Option<&'a Cell>,
    /// Roadmaps of cells that were planned for before. They change how fast a plan is made and nothing else.
    pub roadmaps: Option<&'a Roadmaps>,
}

impl PlanInput<'_> {
    /// Refuses a part so far from the origin of its frame that the poses of its plan could not be written and read again. A
    /// viewpoint is up to twice the scanner's farthest depth from what it measures, with which a field of 120 ° is allowed for; a
    /// part that is turned over keeps its distance.
    ///
    /// # Errors
    /// [`PlanError::BadParams`], at `/part`.
    pub(in crate::planning) fn check_place(&self) -> Result<(), PlanError> {
        let aabb = self.mesh.aabb();
        let farthest_mm = (0..3).map(|axis| aabb.min[axis].abs().max(aabb.max[axis].abs()).powi(2)).sum::<f64>().sqrt();
        let max_mm = PoseSpec::REACH_MM - 2.0 * self.scanner.far_mm;
        if farthest_mm <= max_mm {
            return Ok(());
        }
        Err(PlanError::param("/part", &Refusal::FarFromOrigin { farthest_mm, max_mm }))
    }
}
