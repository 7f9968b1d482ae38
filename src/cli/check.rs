//! `vantage check`: checks specifications, parameters, plans and programs, and names each finding with its place. The kind
//! of a file is recognised by its content.

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use sha2::{Digest, Sha256};

use super::CliError;
use super::files::{self, FileLibrary};
use crate::cell::{Cell, CellSpec, Presets, SpecKind, SpecLibrary};
use crate::check::{Reference, check};
use crate::geometry::{LengthUnit, Poll};
use crate::planning::context::{Context, Silent};
use crate::wire::part_size::{PartSize, SizeLimits};
use crate::wire::plan::PlanDocument;
use crate::wire::warnings::FieldWarning;

/// Check specifications, parameters, plans and programs.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  vantage check cell.toml robot.json params.toml
  vantage check plan/plan.json plan/program.json
  vantage check plan/program.json --cell e05-transcan --plan plan/plan.json --mesh part.stl --unit mm

Without --cell only structure and ranges of a program are checked. A file that is incomplete is told everything that it lacks.
Warnings, as of a tolerance that is finer than the scanner's noise can serve, or a home that looks like radians, are not findings. Exit codes: 0 no findings, 2 findings.")]
pub struct CheckArgs {
    /// Files to check, TOML or JSON; the kind of each is recognised by its content.
    #[arg(required = true)]
    files: Vec<PathBuf>,
    /// Cell to recompute limits, times, collisions and poses with: name of a preset, or a TOML or JSON file.
    #[arg(long)]
    cell: Option<String>,
    #[command(flatten)]
    reference: ReferenceArgs,
}

/// Files that a program is checked against, besides the cell.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct ReferenceArgs {
    /// Plan that the program has to carry out.
    #[arg(long, requires = "cell")]
    pub(super) plan: Option<PathBuf>,
    /// Part, STL, OBJ or PLY: for collisions, and with --plan for the area that the scans measure.
    #[arg(long, requires = "cell")]
    pub(super) mesh: Option<PathBuf>,
    /// Fixture, in the part's coordinates and unit: for collisions.
    #[arg(long, requires = "mesh")]
    fixture: Option<PathBuf>,
    /// Unit of the meshes: mm, cm, m or inch.
    #[arg(long)]
    unit: Option<LengthUnit>,
}

/// Checks every file; prints one line for each without findings.
///
/// # Errors
/// [`CliError::BadInput`] with every finding of every file, one per line.
pub fn run(args: &CheckArgs) -> Result<(), CliError> {
    let cell = args.cell.as_deref().map(cell).transpose()?;
    let reference = args.reference.load()?;
    args.reference.warn_of_size(cell.as_ref(), &reference);
    let never = AtomicBool::new(false);
    let ctx = Context::new(&never, &Silent);
    let mut wrong = Vec::new();
    for path in &args.files {
        let shown = path.display().to_string();
        let checked = files::value(path).and_then(|value| {
            check(value, &FileLibrary, cell.as_ref(), &reference, &ctx).map_err(|errors| files::findings(&shown, &errors))
        });
        match checked {
            Ok(sound) => {
                println!("{shown}: {}", sound.description);
                warn(&shown, &sound.warnings);
            }
            Err(CliError::BadInput(findings)) => wrong.push(findings),
            Err(other) => return Err(other),
        }
    }
    if wrong.is_empty() { Ok(()) } else { Err(CliError::BadInput(wrong.join("\n"))) }
}

/// Prints warnings on fields of `what`.
pub(super) fn warn(what: &str, warnings: &[FieldWarning]) {
    for FieldWarning { pointer, detail, remedy, .. } in warnings {
        eprintln!("{what}: {pointer}: {detail}\n  → {remedy}");
    }
}

/// Loads a cell: a preset or a file.
pub(super) fn cell(name: &str) -> Result<Cell, CliError> {
    let spec: CellSpec = files::spec(SpecKind::Cell, name, Presets.cell(name))?;
    spec.build(&FileLibrary).map_err(|errors| files::findings(name, &errors))
}

impl ReferenceArgs {
    /// Warns of a part whose size tells of a wrong unit.
    fn warn_of_size(&self, cell: Option<&Cell>, reference: &Reference) {
        if let (Some(cell), Some(part), Some(unit), Some(mesh)) = (cell, &reference.part, self.unit, &self.mesh) {
            let limits = SizeLimits::new(&cell.scanner, Some(cell));
            warn(&mesh.display().to_string(), &PartSize::new(&part.aabb(), unit).warnings(None, &limits, "--unit"));
        }
    }

    /// Reads the files.
    pub(super) fn load(&self) -> Result<Reference, CliError> {
        let read = |path: &PathBuf| files::mesh(path, self.unit, &Poll::never()).map(|(read, _)| read.mesh);
        Ok(Reference {
            plan: self.plan.as_deref().map(read_plan).transpose()?,
            part: self.mesh.as_ref().map(read).transpose()?,
            fixture: self.fixture.as_ref().map(read).transpose()?,
        })
    }
}

/// Reads a plan, with the SHA-256 of its file.
fn read_plan(path: &Path) -> Result<(PlanDocument, String), CliError> {
    let shown = path.display().to_string();
    let bytes = std::fs::read(path).map_err(|error| CliError::BadInput(format!("{shown}: {error}")))?;
    let document: PlanDocument = files::from_value(files::value(path)?, &shown)?;
    Ok((document, Sha256::digest(&bytes).iter().map(|byte| format!("{byte:02x}")).collect()))
}

#[cfg(test)]
mod plan_tests;
#[cfg(test)]
mod tests;
