//! Input of a plan: borrowed, so that a job's part is held once.

use crate::cell::{Cell, Scanner};
use crate::geometry::Mesh;
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
