//! From a part, a cell and parameters to every result file: what the server's jobs and the command line share.

use crate::cell::{Cell, PoseSpec, Scanner};
use crate::geometry::Mesh;
use crate::planning::context::Context;
use crate::planning::params::PlanParams;
use crate::planning::plan::Outcome;
use crate::planning::{PlanError, PlanInput, plan};
use crate::wire::echo::Echo;
use crate::wire::plan::{CellDocument, PlanDocument};

/// A file that came out.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Artifact {
    /// Its name.
    pub name: &'static str,
    /// Its bytes.
    pub bytes: Vec<u8>,
}

/// Everything that decides what comes out.
pub struct PlanJob<'a> {
    /// The part.
    pub mesh: &'a Mesh,
    /// What holds it, in the part's coordinates.
    pub fixture: Option<&'a Mesh>,
    /// Name of the part in reports.
    pub part_name: String,
    /// SHA-256 of the part's file.
    pub part_sha256: &'a str,
    /// The scanner; the cell's own where there is a cell.
    pub scanner: &'a Scanner,
    /// The cell; `None` for viewpoints alone.
    pub cell: Option<&'a Cell>,
    /// Parameters.
    pub params: &'a PlanParams,
    /// What the files echo.
    pub echo: Echo,
}

impl PlanJob<'_> {
    /// Plans and renders every file. Runs in the caller's thread pool.
    ///
    /// # Errors
    /// [`PlanError`].
    pub fn run(&self, ctx: &Context<'_>) -> Result<Vec<Artifact>, PlanError> {
        let input = PlanInput {
            mesh: self.mesh,
            fixture: self.fixture,
            part_sha256: self.part_sha256,
            scanner: self.scanner,
            cell: self.cell,
        };
        let outcome = plan(&input, self.params, ctx)?;
        Ok(self.render(&outcome))
    }

    fn render(&self, outcome: &Outcome) -> Vec<Artifact> {
        let document = PlanDocument::new(outcome, self.scanner, self.cell_document(outcome), self.echo.clone());
        vec![Artifact { name: "plan.json", bytes: document.to_bytes() }]
    }

    fn cell_document(&self, outcome: &Outcome) -> Option<CellDocument> {
        let (cell, table_from_part) = (self.cell?, outcome.plan.table_from_part?);
        Some(CellDocument {
            name: cell.name.clone(),
            base_from_table: PoseSpec::from(&cell.base_from_table),
            table_from_part: PoseSpec::from(&table_from_part),
            flange_from_scanner: PoseSpec::from(&cell.flange_from_scanner),
            robot: cell.robot.name.clone(),
            turntable: cell.turntable.name.clone(),
        })
    }
}
