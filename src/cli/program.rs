//! `vantage program`: checks a program and writes it in the language of a robot controller.

use std::path::{Path, PathBuf};

use super::check::{self, ReferenceArgs};
use super::plan::set_params;
use super::{CliError, files, output};
use crate::check::field_errors;
use crate::planning::params::DialectParams;
use crate::program::dialects::{CheckedProgram, CheckedWith, Dialect, DialectFile};
use crate::service::plan_job::program_stem;
use crate::wire::plan::PlanDocument;
use crate::wire::program::ProgramDocument;

/// Write a program in the language of a robot controller.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  vantage program plan --cell e05-transcan --mesh part.stl --unit mm --dialect rapid --out robot
  vantage program plan/program.json --cell cell.toml --dialect urscript --out scan.script --set dialects.scan_output=3

The program is checked first, as by `vantage check`; a program with findings is not written. Without --mesh it is not checked
for collisions with the part, and its header says so. Signals and names come from `params.dialects` of the plan; --set
overrides them. KUKA programs are two files, and each setup has its own program: give a folder for those.")]
pub struct ProgramArgs {
    /// Folder that `vantage plan` wrote, or a program.json.
    from: PathBuf,
    /// Cell: name of a preset, or a TOML or JSON file.
    #[arg(long)]
    cell: String,
    #[arg(long, help = format!("Controller language: {}", Dialect::ALL.map(Dialect::as_str).join(", ")))]
    dialect: Dialect,
    /// Folder for files named as the controller expects them, or a single file.
    #[arg(long)]
    out: PathBuf,
    #[command(flatten)]
    reference: ReferenceArgs,
    /// Set one parameter, overriding the plan: `dialects.program_name=bracket`. Repeatable.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    sets: Vec<String>,
}

/// Runs the command; prints the files written.
///
/// # Errors
/// [`CliError`].
pub fn run(args: &ProgramArgs) -> Result<(), CliError> {
    let cell = check::cell(&args.cell)?;
    let mut reference_args = args.reference.clone();
    let beside = args.from.join("plan.json");
    if reference_args.plan.is_none() && beside.is_file() {
        reference_args.plan = Some(beside);
    }
    let reference = reference_args.load()?;
    let plan = reference.plan.as_ref().map(|(plan, _)| plan);
    let mut rendered = Vec::new();
    for path in programs(&args.from)? {
        let shown = path.display().to_string();
        let document: ProgramDocument = files::from_value(files::value(&path)?, &shown)?;
        let program = document.program().map_err(|errors| files::findings(&shown, &errors))?;
        let expected = reference.expected(program.setup);
        let scene = reference.scene(&cell, expected.as_ref());
        let params = params(plan, &args.sets)?;
        let checked_with = if reference_args.mesh.is_some() { CheckedWith::Part } else { CheckedWith::CellAlone };
        let checked = CheckedProgram::new(&program, &cell, &scene, expected.as_ref(), checked_with);
        let checked = checked.map_err(|found| files::findings(&shown, &field_errors(&found)))?;
        rendered.extend(checked.render(args.dialect, &params).map_err(|error| CliError::BadInput(format!("{shown}: {error}")))?);
    }
    write(&args.out, &rendered)
}

/// Path of the program, or of every program in a folder.
fn programs(from: &Path) -> Result<Vec<PathBuf>, CliError> {
    if !from.is_dir() {
        return Ok(vec![from.to_owned()]);
    }
    let paths = (0..).map(|setup| from.join(format!("{}.json", program_stem(setup))));
    let found: Vec<_> = paths.take_while(|path| path.is_file()).collect();
    if found.is_empty() { Err(CliError::BadInput(format!("{}: has no program.json", from.display()))) } else { Ok(found) }
}

/// Dialect parameters of the plan, with every `--set` applied.
fn params(plan: Option<&PlanDocument>, sets: &[String]) -> Result<DialectParams, CliError> {
    let dialects = plan.map_or_else(DialectParams::default, |plan| plan.params.dialects.clone());
    set_params(serde_json::json!({ "dialects": dialects }), sets).map(|params| params.dialects)
}

/// Writes into a folder, if `out` exists as one or has no extension; else to a file, which holds one program of one file.
fn write(out: &Path, files: &[DialectFile]) -> Result<(), CliError> {
    let is_folder = out.is_dir() || (out.extension().is_none() && !out.is_file());
    if !is_folder && files.len() > 1 {
        let names: Vec<_> = files.iter().map(|file| file.name.as_str()).collect();
        return Err(CliError::BadInput(format!(
            "--out {}: is a single file; name a folder for {}",
            out.display(),
            names.join(", ")
        )));
    }
    let folder =
        if is_folder { out } else { out.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new(".")) };
    super::out::prepare(folder)?;
    let path = |file: &DialectFile| if is_folder { out.join(&file.name) } else { out.to_owned() };
    files.iter().try_for_each(|file| super::out::write_file(&path(file), file.text.as_bytes()))?;
    let written: Vec<String> = files.iter().map(|file| path(file).display().to_string()).collect();
    let lines: String = written.iter().map(|path| format!("{path}\n")).collect();
    output::result(&serde_json::json!({ "files": written }), lines)
}

#[cfg(test)]
mod tests;
