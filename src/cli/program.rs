//! `vantage program`: a program in the language of a robot controller, after the linter found nothing in it.

use std::path::{Path, PathBuf};

use super::CliError;
use super::check::{self, Against};
use super::files;
use super::plan::set_params;
use crate::planning::params::DialectParams;
use crate::program::dialects::{CheckedProgram, CheckedWith, Dialect, DialectFile};
use crate::wire::plan::PlanDocument;
use crate::wire::program::ProgramDocument;

/// Write a program in the language of a robot controller.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  vantage program plan --cell e05-transcan --mesh part.stl --unit mm --dialect rapid --out robot
  vantage program plan/program.json --cell cell.toml --dialect urscript --out scan.script --set dialects.scan_output=3

The program is checked first, as `vantage check` does; one with faults is not written. Without --mesh collisions with the part
are not looked for, and the program's header says so. Signals and names are the plan's `params.dialects`, --set over them.
KUKA's language needs two files, and several setups have one program each: name a folder for those.")]
pub struct ProgramArgs {
    /// Folder that `vantage plan` wrote, or one program.json.
    from: PathBuf,
    /// Cell: a preset's name, or a TOML or JSON file.
    #[arg(long)]
    cell: String,
    /// hans, urscript, rapid, krl, fanuc, robodk or csv.
    #[arg(long)]
    dialect: Dialect,
    /// Folder, which gets files called as the controller wants it, or one file.
    #[arg(long)]
    out: PathBuf,
    #[command(flatten)]
    against: Against,
    /// A parameter, as in dialects.program_name=bracket.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    sets: Vec<String>,
}

/// Runs the command; prints the files written.
///
/// # Errors
/// [`CliError`].
pub fn run(args: &ProgramArgs) -> Result<(), CliError> {
    let cell = check::cell(&args.cell)?;
    let mut against = args.against.clone();
    let beside = args.from.join("plan.json");
    if against.plan.is_none() && beside.is_file() {
        against.plan = Some(beside);
    }
    let mut rendered = Vec::new();
    for path in programs(&args.from)? {
        let shown = path.display().to_string();
        let document: ProgramDocument = files::from_value(files::value(&path)?, &shown)?;
        let program = document.program().map_err(|errors| files::findings(&shown, &errors))?;
        let ground = against.ground(&cell, program.setup)?;
        let params = params(ground.plan.as_ref(), &args.sets)?;
        let checked_with = if against.mesh.is_some() { CheckedWith::Part } else { CheckedWith::CellAlone };
        let checked = CheckedProgram::new(&program, &cell, &ground.scene, ground.expected.as_ref(), checked_with);
        let checked = checked.map_err(|found| check::faults(&shown, &found))?;
        rendered.extend(checked.render(args.dialect, &params).map_err(|error| CliError::BadInput(format!("{shown}: {error}")))?);
    }
    write(&args.out, &rendered)
}

/// The file, or every program in the folder.
fn programs(from: &Path) -> Result<Vec<PathBuf>, CliError> {
    if !from.is_dir() {
        return Ok(vec![from.to_owned()]);
    }
    let names = ["program.json", "program-2.json", "program-3.json", "program-4.json"];
    let found: Vec<_> = names.iter().map(|name| from.join(name)).filter(|path| path.is_file()).collect();
    if found.is_empty() { Err(CliError::BadInput(format!("{}: has no program.json", from.display()))) } else { Ok(found) }
}

/// The plan's, with what is set over them.
fn params(plan: Option<&PlanDocument>, sets: &[String]) -> Result<DialectParams, CliError> {
    let dialects = plan.map_or_else(DialectParams::default, |plan| plan.params.dialects.clone());
    set_params(serde_json::json!({ "dialects": dialects }), sets).map(|params| params.dialects)
}

/// A folder is what exists as one, or has no extension; a file takes one program of one file.
fn write(out: &Path, files: &[DialectFile]) -> Result<(), CliError> {
    let is_folder = out.is_dir() || (out.extension().is_none() && !out.is_file());
    if !is_folder && files.len() > 1 {
        let names: Vec<_> = files.iter().map(|file| file.name.as_str()).collect();
        return Err(CliError::BadInput(format!("--out {}: is one file; name a folder for {}", out.display(), names.join(", "))));
    }
    let folder =
        if is_folder { out } else { out.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new(".")) };
    super::out::prepare(folder)?;
    for file in files {
        let path = if is_folder { out.join(&file.name) } else { out.to_owned() };
        super::out::write_file(&path, file.text.as_bytes())?;
        println!("{}", path.display());
    }
    Ok(())
}

#[cfg(test)]
mod tests;
