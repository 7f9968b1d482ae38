//! Planning of a part in a cell, with all result files: shared by the server's jobs and the command line.

use std::borrow::Cow;
use std::collections::BTreeMap;

use sha2::{Digest, Sha256};

use super::store::hex;
use crate::cell::{Cell, CollisionScene, FieldError, PoseSpec, Scanner};
use crate::geometry::{self, LengthUnit, Mesh, Poll};
use crate::planning::context::{Cancelled, Context, Stage};
use crate::planning::params::{PlanParams, TableMotion};
use crate::planning::plan::{Outcome, Plan};
use crate::planning::sequence::Roadmaps;
use crate::planning::{PlanError, PlanInput, plan};
use crate::program::dialects::{CheckedProgram, CheckedWith, Dialect, DialectFile};
use crate::program::{Expected, Program, compile};
use crate::report::html::{self, ReportInput};
use crate::report::text::{text, warned};
use crate::wire::candidates::{self, CANDIDATES_FILE, ListingError};
use crate::wire::echo::Echo;
use crate::wire::part_size::{PartSize, SizeLimits, size_text};
use crate::wire::plan::{CellDocument, PlanDocument};
use crate::wire::program::ProgramDocument;
use crate::wire::regions::REGIONS_FILE;
use crate::wire::warnings::FieldWarning;
use crate::wire::{coverage, json_file_bytes, missed, regions, viewpoints};

/// Max triangles of the preview that browsers draw and `coverage.bin` refers to.
pub const PREVIEW_TRIANGLES: usize = 300_000;

/// Stem of the file names of a setup's program: `program`, then `program-2` and so on.
#[must_use]
pub fn program_stem(setup: usize) -> String {
    if setup == 0 { "program".to_owned() } else { format!("program-{}", setup + 1) }
}

/// File with the reasons why some files are missing: programs in some dialects, or a listing that is too large.
pub const REFUSED_FILE: &str = "refused.json";

/// A result file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Artifact {
    /// Its name.
    pub name: Cow<'static, str>,
    /// Its bytes.
    pub bytes: Vec<u8>,
}

/// Inputs of a planning job.
pub struct PlanJob<'a> {
    /// The part.
    pub mesh: &'a Mesh,
    /// Fixture that holds the part, in the part's coordinates.
    pub fixture: Option<&'a Mesh>,
    /// Name of the part in reports.
    pub part_name: String,
    /// SHA-256 of the part's file.
    pub part_sha256: &'a str,
    /// Unit that the part's file was read in.
    pub unit: LengthUnit,
    /// The scanner; the cell's own if there is a cell.
    pub scanner: &'a Scanner,
    /// The cell; `None` for viewpoints only.
    pub cell: Option<&'a Cell>,
    /// Roadmaps of cells that were planned for before.
    pub roadmaps: Option<&'a Roadmaps>,
    /// Parameters.
    pub params: &'a PlanParams,
    /// Fields of the request that the files echo.
    pub echo: Echo,
}

impl PlanJob<'_> {
    /// Plans and renders every file. Runs in the caller's thread pool.
    ///
    /// # Errors
    /// [`PlanError`].
    pub fn execute(&self, ctx: &Context<'_>) -> Result<Vec<Artifact>, PlanError> {
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
            roadmaps: self.roadmaps,
        };
        plan(&input, self.params, ctx)
    }

    /// Warnings on the part's size; `at` names the part: a pointer, or an option.
    #[must_use]
    pub fn size_warnings(&self, at: &str) -> Vec<FieldWarning> {
        let limits = SizeLimits::new(self.scanner, self.cell);
        PartSize::new(&self.mesh.aabb(), self.unit).warnings(self.params.part.table_from_part.as_ref(), &limits, at)
    }

    /// Description of an error that parameters are blamed for which nobody has set: how the part lies by default, or that it is far
    /// too large. Its user gave the file and its unit. `None` for an error of parameters.
    #[must_use]
    pub fn error_of_part(&self, error: &FieldError) -> Option<String> {
        let (given, unit) = (self.params.part.table_from_part.as_ref(), self.unit);
        let size = PartSize::new(&self.mesh.aabb(), unit);
        let limits = SizeLimits::new(self.scanner, self.cell);
        let units =
            || size.other_units(&limits).map_or_else(String::new, |units| format!("; it would fit if the file is in {units}"));
        let FieldError { pointer, detail } = error;
        match pointer.as_str() {
            "/part" => Some(format!("{detail} (read in {unit}{})", units())),
            "/part/table_from_part" if given.is_none() => {
                let hint = if size.warnings(given, &limits, "").is_empty() { String::new() } else { units() };
                let read = size_text(&size.size_mm);
                let lies = "in the middle of the plate, as part.table_from_part is not given, that";
                Some(format!("is {read} as read in {unit}; {lies} {detail}{hint}"))
            }
            _ => None,
        }
    }

    /// Renders every file.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub fn render(&self, outcome: &Outcome, ctx: &Context<'_>) -> Result<Vec<Artifact>, Cancelled> {
        ctx.begin(Stage::Report)?;
        let plan = &outcome.plan;
        let size_warnings = self.size_warnings("/part/bbox_mm");
        let mut document = PlanDocument::new(outcome, self.scanner, self.cell_document(outcome), self.echo.clone());
        document.warnings.extend(size_warnings.iter().cloned());
        let document = document.to_bytes();
        let programs = self.programs(plan, &document);
        let stop = || ctx.check().is_err();
        let preview = geometry::preview(self.mesh, PREVIEW_TRIANGLES, &Poll::new(&stop)).map_err(Cancelled::from)?;
        let report = ReportInput {
            outcome,
            mesh: self.mesh,
            scanner: self.scanner,
            cell_name: self.cell.map(|cell| cell.name.as_str()),
            cycle_secs: (!programs.is_empty()).then(|| programs.iter().map(|program| program.cycle_secs).sum()),
            part_name: &self.part_name,
            echo: &self.echo,
            size_warnings: &size_warnings,
        };
        let mut files: Vec<(Cow<'static, str>, Vec<u8>)> = vec![
            ("plan.json".into(), document),
            ("viewpoints.json".into(), json_file_bytes(&viewpoints::json(plan))),
            ("viewpoints.csv".into(), viewpoints::csv(plan).into_bytes()),
            ("coverage.json".into(), json_file_bytes(&coverage::json(outcome, self.mesh))),
            ("coverage.csv".into(), coverage::csv(outcome, self.mesh).into_bytes()),
            ("coverage.bin".into(), coverage::bin(outcome, &preview)),
            ("missed.json".into(), json_file_bytes(&missed::json(plan))),
            ("report.txt".into(), (warned(&size_warnings) + &text(plan)).into_bytes()),
            ("report.html".into(), html::render(&report, ctx)?.into_bytes()),
        ];
        files.extend(regions::csv(plan).map(|table| (REGIONS_FILE.into(), table.into_bytes())));
        let mut refused = BTreeMap::new();
        for (setup, program) in programs.iter().enumerate() {
            let stem = program_stem(setup);
            files.push((format!("{stem}.json").into(), ProgramDocument::new(program, self.echo.clone()).to_bytes()));
            for (extension, text) in self.dialects(plan, program) {
                let name = format!("{stem}.{extension}");
                match text {
                    Ok(text) => files.push((name.into(), text.into_bytes())),
                    Err(reason) => drop(refused.insert(name, reason)),
                }
            }
        }
        match candidates::file_bytes(outcome, self.mesh, ctx) {
            Some(Ok(bytes)) => files.push((CANDIDATES_FILE.into(), bytes)),
            Some(Err(ListingError::Cancelled(cancelled))) => return Err(cancelled),
            Some(Err(reason)) => drop(refused.insert(CANDIDATES_FILE.to_owned(), reason.to_string())),
            None => {}
        }
        if !refused.is_empty() {
            files.push((REFUSED_FILE.into(), json_file_bytes(&refused)));
        }
        Ok(files.into_iter().map(|(name, bytes)| Artifact { name, bytes }).collect())
    }

    /// Robot program of each setup, if there is a cell. Each names its plan by the hash of `document`.
    fn programs(&self, plan: &Plan, document: &[u8]) -> Vec<Program> {
        let (Some(cell), plan_sha256) = (self.cell, hex(&Sha256::digest(document))) else { return Vec::new() };
        let compiled = |(setup, sequence)| compile(sequence, setup, cell, &plan_sha256, &plan.params);
        plan.sequences().enumerate().map(compiled).collect()
    }

    /// Program text in every dialect, or the reason why there is none, by the file's extension. The linter checks the program
    /// first.
    fn dialects(&self, plan: &Plan, program: &Program) -> Vec<(&'static str, Result<String, String>)> {
        let (Some(cell), Some(setup)) = (self.cell, plan.setups.get(program.setup)) else { return Vec::new() };
        let scene = CollisionScene::new(cell, self.mesh, self.fixture, &setup.table_from_part, plan.params.motion.clearance_mm);
        let visited = plan.views.iter().filter(|view| view.setup.index() == program.setup && view.station.is_some());
        let expected = Expected {
            plan_sha256: program.plan_sha256.clone(),
            table_from_part: setup.table_from_part,
            table_alone: plan.params.motion.table == TableMotion::Alone,
            views: visited.map(|view| (view.id, view.part_from_scanner)).collect(),
        };
        let checked = CheckedProgram::new(program, cell, &scene, Some(&expected), CheckedWith::Part);
        let rendered = |dialect: Dialect| -> Result<Vec<DialectFile>, String> {
            let checked =
                checked.as_ref().map_err(|findings| findings.iter().map(ToString::to_string).collect::<Vec<_>>().join("; "))?;
            checked.render(dialect, &plan.params.dialects).map_err(|error| error.to_string())
        };
        let files = Dialect::ALL.into_iter().flat_map(|dialect| {
            let rendered = rendered(dialect);
            let text = move |index: usize| rendered.as_ref().map(|files| files[index].text.clone()).map_err(Clone::clone);
            dialect.outputs().iter().enumerate().map(move |(index, output)| (output.extension, text(index)))
        });
        files.collect()
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
