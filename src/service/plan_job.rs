//! From a part, a cell and parameters to every result file: what the server's jobs and the command line share.

use sha2::{Digest, Sha256};

use super::store::hex;
use crate::cell::{Cell, PoseSpec, Scanner};
use crate::geometry::{self, Mesh};
use crate::planning::context::{Cancelled, Context, Stage};
use crate::planning::params::PlanParams;
use crate::planning::plan::{Outcome, Plan};
use crate::planning::report::text;
use crate::planning::{PlanError, PlanInput, plan};
use crate::program::{Program, compile};
use crate::wire;
use crate::wire::echo::Echo;
use crate::wire::plan::{CellDocument, PlanDocument};
use crate::wire::program::ProgramDocument;
use crate::wire::report::{self, ReportInput};
use crate::wire::{coverage, json_file_bytes, missed, viewpoints};

/// Most triangles of the preview that browsers draw and `coverage.bin` refers to.
pub const PREVIEW_TRIANGLES: usize = 300_000;

/// Programs of the setups.
const PROGRAM_FILES: [[&str; 2]; 4] = [
    ["program.json", "program.csv"],
    ["program-2.json", "program-2.csv"],
    ["program-3.json", "program-3.csv"],
    ["program-4.json", "program-4.csv"],
];

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
        Ok(self.render(&self.plan(ctx)?, ctx)?)
    }

    /// Plans.
    ///
    /// # Errors
    /// [`PlanError`].
    pub fn plan(&self, ctx: &Context<'_>) -> Result<Outcome, PlanError> {
        let input = PlanInput {
            mesh: self.mesh,
            fixture: self.fixture,
            part_sha256: self.part_sha256,
            scanner: self.scanner,
            cell: self.cell,
        };
        plan(&input, self.params, ctx)
    }

    /// Renders every file.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub fn render(&self, outcome: &Outcome, ctx: &Context<'_>) -> Result<Vec<Artifact>, Cancelled> {
        ctx.begin(Stage::Report)?;
        let plan = &outcome.plan;
        let document = PlanDocument::new(outcome, self.scanner, self.cell_document(outcome), self.echo.clone()).to_bytes();
        let programs = self.programs(plan, &document);
        let preview = geometry::preview(self.mesh, PREVIEW_TRIANGLES);
        let report = ReportInput {
            outcome,
            mesh: self.mesh,
            scanner: self.scanner,
            cell_name: self.cell.map(|cell| cell.name.as_str()),
            cycle_secs: (!programs.is_empty()).then(|| programs.iter().map(|program| program.cycle_secs).sum()),
            part_name: &self.part_name,
            echo: &self.echo,
        };
        let mut files = vec![
            ("plan.json", document),
            ("viewpoints.json", json_file_bytes(&viewpoints::json(plan))),
            ("viewpoints.csv", viewpoints::csv(plan).into_bytes()),
            ("coverage.json", json_file_bytes(&coverage::json(outcome, self.mesh))),
            ("coverage.csv", coverage::csv(outcome, self.mesh).into_bytes()),
            ("coverage.bin", coverage::bin(outcome, &preview)),
            ("missed.json", json_file_bytes(&missed::json(plan))),
            ("report.txt", text(plan).into_bytes()),
            ("report.html", report::html(&report, ctx)?.into_bytes()),
        ];
        for (program, [json, csv]) in programs.iter().zip(PROGRAM_FILES) {
            files.push((json, ProgramDocument::new(program, self.echo.clone()).to_bytes()));
            files.push((csv, wire::program::csv(program).into_bytes()));
        }
        Ok(files.into_iter().map(|(name, bytes)| Artifact { name, bytes }).collect())
    }

    /// The robot program of each setup, where there is a cell; they name the bytes of the plan that they carry out.
    fn programs(&self, plan: &Plan, document: &[u8]) -> Vec<Program> {
        let (Some(cell), plan_sha256) = (self.cell, hex(&Sha256::digest(document))) else { return Vec::new() };
        let compiled = |(setup, sequence)| compile(sequence, setup, cell, &plan_sha256, &plan.params);
        plan.sequences().enumerate().map(compiled).collect()
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
