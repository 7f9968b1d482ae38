//! `vantage program`: checks a program and writes it in the language of a robot controller.

use std::path::{Path, PathBuf};

use super::check::{self, ReferenceArgs};
use super::given_params::set_params;
use super::out::{self, FileOrigin, OutputFolder, OutputWriter};
use super::{CliError, files, output};
use crate::cell::{Cell, Robot};
use crate::check::{Reference, field_errors};
use crate::planning::params::DialectParams;
use crate::program::Program;
use crate::program::dialects::{CheckedProgram, CheckedWith, Dialect, DialectError, DialectFile};
use crate::service::plan_job::{Artifact, PLAN_FILE, TEXT_REPORT_FILE, program_stem};
use crate::wire::DocumentKind;
use crate::wire::output_record::RECORD_FILE;
use crate::wire::parameters;
use crate::wire::plan::PlanDocument;
use crate::wire::program::ProgramDocument;

/// Check a program and write it in the language of the robot controller.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  vantage program plan --cell e05-transcan --mesh part.stl --unit mm --out robot
  vantage program plan --cell cell.toml --mesh part.stl --unit mm \\
      --dialect robodk --out robot
  vantage program plan/program.json --cell cell.toml --out scan.script \\
      --set dialects.scan_output=3

The program is checked first, as by `vantage check`. It is not written if it has errors, or if it was not made from the \
plan.json beside it. --mesh needs the plan, which says where the part lies, and the fixture if the plan has one: --fixture, or \
the file that the plan names. Without --mesh, collisions with the part are not checked, and the program's header says so.

Signals and names come from `params.dialects` of the plan; --set overrides them. A KUKA program has two files, and each setup \
has its own program: give --out a folder for these. Programs made from the same source and an earlier plan are removed from the \
folder; a program made from another plan elsewhere is never replaced.")]
pub struct ProgramArgs {
    /// Program: a folder that `vantage plan` wrote, or a program.json.
    from: PathBuf,
    /// Cell: a preset name, or a TOML or JSON file.
    #[arg(long)]
    cell: String,
    #[arg(long, help = format!(
        "Controller language: {} [default: the one that the robot's specification names]",
        Dialect::ALL.map(Dialect::as_str).join(", ")
    ))]
    dialect: Option<Dialect>,
    /// Accept the language of another maker's controller; the program's header then carries a warning.
    #[arg(long, requires = "dialect")]
    force: bool,
    /// Folder for the program, with file names as the controller expects them, or a single file.
    #[arg(long)]
    out: PathBuf,
    #[command(flatten)]
    reference: ReferenceArgs,
    /// Set one parameter, overriding the plan: `dialects.program_name=bracket`; `KEY=@FILE` reads the value from a file. Repeatable.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    sets: Vec<String>,
}

/// Runs the command; prints the files written.
///
/// # Errors
/// [`CliError`].
pub fn run(args: &ProgramArgs) -> Result<(), CliError> {
    files::require_existing(&args.from)?;
    let cell = check::cell(&args.cell)?;
    let dialect = dialect(args.dialect, &cell.robot)?;
    let mut reference_args = args.reference.clone();
    let beside = plan_beside(&args.from)?;
    // First: without a program, neither plan nor part is of use.
    let paths = programs(&args.from)?;
    reference_args.plan = reference_args.plan.or(beside);
    let job = RenderJob {
        reference: reference_args.load()?,
        cell,
        dialect,
        force: args.force,
        checked_with: if reference_args.mesh.is_some() { CheckedWith::Part } else { CheckedWith::CellAlone },
    };
    let from = args.from.display();
    job.reference.check_placed().map_err(|reason| unplaced(&from, reason))?;
    let params = params(job.reference.plan.as_ref().map(|(plan, _)| plan), &args.sets)?;
    let (mut rendered, mut rendered_from, mut renamed) = (Vec::new(), Vec::new(), Vec::new());
    let mut plan_sha256: Option<String> = None;
    for path in &paths {
        let shown = path.display().to_string();
        let kind = ("a program", Some(DocumentKind::Program));
        let document: ProgramDocument = files::of_kind(files::value(path)?, kind, &shown)?;
        let program = document.program().map_err(|errors| files::findings(&shown, &errors))?;
        let files = job.render(&program, &params, &shown)?;
        renamed.extend(renaming(dialect, &params.program_name, program.setup, &files));
        rendered.extend(files);
        rendered_from.push(program.clone());
        let first = plan_sha256.get_or_insert_with(|| program.plan_sha256.clone());
        if *first != program.plan_sha256 {
            return Err(CliError::BadInput(format!("{shown}: is made from a different plan than program.json; plan again")));
        }
    }
    // Last: a program that is not the plan's is told as such, whatever the cell and the others.
    if let Some((plan, _)) = job.reference.plan.as_ref().filter(|_| args.from.is_dir()) {
        check_all_there(&args.from, paths.len(), plan)?;
    }
    job.reference.check_scanner(&job.cell).map_err(|errors| files::findings(&args.cell, &errors))?;
    let made_from = std::fs::canonicalize(&args.from).unwrap_or_else(|_| args.from.clone());
    let origin = FileOrigin { plan_sha256, made_from: Some(made_from.display().to_string()) };
    // Before a file of this name is refused.
    renamed.into_iter().for_each(output::note);
    let written: Vec<String> = write(&args.out, rendered, &origin)?.iter().map(|path| path.display().to_string()).collect();
    let work = dialect.before_first_run_of(&rendered_from);
    let lines: String = written.iter().map(|path| format!("{path}\n")).collect();
    output::result(&serde_json::json!({ "files": written, "before_first_run": work }), lines)?;
    work.into_iter().for_each(|work| output::note(format!("Before the first run: {work}")));
    Ok(())
}

/// Says that a program has another name than the one asked for, capital letters apart; `None` where it has that.
fn renaming(dialect: Dialect, asked: &str, setup: usize, files: &[DialectFile]) -> Option<String> {
    let (stem, _) = files.first()?.name.rsplit_once('.')?;
    let wanted = if setup == 0 { asked.to_owned() } else { format!("{asked}_{}", setup + 1) };
    // Tables are named as by a plan, whatever the program.
    if dialect.is_table() || stem.eq_ignore_ascii_case(&wanted) {
        return None;
    }
    let longer = dialect.name_length_param().map(|param| format!("; give dialects.{param} if the controller takes longer names"));
    let longer = longer.unwrap_or_default();
    Some(format!("the program is named {stem}, because {} programs cannot be named {wanted:?}{longer}", dialect.as_str()))
}

/// The language asked for, else the robot's own.
fn dialect(asked: Option<Dialect>, robot: &Robot) -> Result<Dialect, CliError> {
    asked.or(robot.dialect).ok_or_else(|| {
        let known = Dialect::ALL.map(Dialect::as_str).join(", ");
        CliError::BadInput(format!(
            "the specification of robot {} has no `dialect`; name the language of its controller with --dialect: {known}",
            robot.name
        ))
    })
}

/// The plan that stands beside the program, which is then held against it.
pub(super) fn plan_beside(from: &Path) -> Result<Option<PathBuf>, CliError> {
    let folder = if from.is_dir() { from } else { folder_of(from) };
    out::check_complete(folder)?;
    let plan = folder.join(PLAN_FILE);
    Ok(plan.is_file().then_some(plan))
}

/// Folder of a file.
fn folder_of(file: &Path) -> &Path {
    file.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Everything that programs are rendered with.
struct RenderJob {
    reference: Reference,
    cell: Cell,
    dialect: Dialect,
    force: bool,
    checked_with: CheckedWith,
}

impl RenderJob {
    /// The program in the dialect, once it is checked.
    fn render(&self, program: &Program, params: &DialectParams, shown: &str) -> Result<Vec<DialectFile>, CliError> {
        let not_the_plans = |finding| {
            let findings = files::findings(shown, &field_errors(&[finding]));
            CliError::BadInput(format!("{findings}\n  → plan again, and use the program that it writes"))
        };
        self.reference.owns(program).map_err(not_the_plans)?;
        let expected = self.reference.expected(program.setup);
        let scene = self.reference.scene(&self.cell, expected.as_ref());
        let checked = CheckedProgram::new(program, &self.cell, &scene, expected.as_ref(), self.checked_with);
        let checked = checked.map_err(|found| files::findings(shown, &field_errors(&found)))?;
        let off_orders = self.reference.off_orders(program);
        if !off_orders.is_empty() {
            return Err(files::findings(shown, &field_errors(&off_orders)));
        }
        let rendered = match checked.render(self.dialect, params) {
            Err(foreign @ DialectError::Foreign { .. }) if self.force => {
                output::warning(shown, "", &foreign.to_string(), "the program's header carries this warning");
                checked.render_forced(self.dialect, params)
            }
            rendered => rendered,
        };
        rendered.map_err(|error| {
            let is_foreign = matches!(error, DialectError::Foreign { .. });
            let advice = "\n  → leave out --dialect, or give --force to write it with a warning in its header";
            let advice = if is_foreign { advice } else { "" };
            CliError::BadInput(format!("{shown}: {error}{advice}"))
        })
    }
}

/// Path of the program, or of every program in a folder.
fn programs(from: &Path) -> Result<Vec<PathBuf>, CliError> {
    if !from.is_dir() {
        return Ok(vec![from.to_owned()]);
    }
    let paths = (0..).map(|setup| from.join(format!("{}.json", program_stem(setup))));
    let found: Vec<_> = paths.take_while(|path| path.is_file()).collect();
    if found.is_empty() { Err(without_program(from)) } else { Ok(found) }
}

/// Requires the program of every setup of the plan: the scans of one that is left out would be missed at the cell alone.
fn check_all_there(folder: &Path, found: usize, plan: &PlanDocument) -> Result<(), CliError> {
    let setups = plan.setups.len().max(1);
    if found >= setups {
        return Ok(());
    }
    let missing = folder.join(format!("{}.json", program_stem(found)));
    Err(CliError::BadInput(format!(
        "{}: is missing; the plan has {setups} setups, each with its own program\n  → plan again, or give a single program.json",
        missing.display()
    )))
}

/// Error for a part without the plan that says where it lies.
pub(super) fn unplaced(program: &impl std::fmt::Display, reason: &str) -> CliError {
    CliError::BadInput(format!("{program}: {reason}\n  → keep plan.json beside it, or name it with --plan"))
}

/// Error for a folder without a program: a plan that was made without a cell has none, and neither has a part without a plan.
pub(super) fn without_program(folder: &Path) -> CliError {
    let reason = if folder.join(PLAN_FILE).is_file() {
        "has no program.json: its plan was made without a cell and has only viewpoints; plan with a cell (--cell)"
    } else if folder.join(TEXT_REPORT_FILE).is_file() {
        "has neither plan nor program.json; its report.txt says why"
    } else {
        "has no program.json"
    };
    CliError::BadInput(format!("{}: {reason}", folder.display()))
}

/// Dialect parameters of the plan, with every `--set` applied.
fn params(plan: Option<&PlanDocument>, sets: &[String]) -> Result<DialectParams, CliError> {
    let elsewhere = sets.iter().find(|set| {
        let key = set.split('=').next().unwrap_or_default();
        set.contains('=') && parameters::unknown(key).is_none() && key != "dialects" && !key.starts_with("dialects.")
    });
    if let Some(set) = elsewhere {
        let reason = "has no effect here: only parameters dialects.* apply to a program; plan again with it";
        return Err(CliError::BadInput(format!("--set {set}: {reason}")));
    }
    let dialects = plan.map_or_else(DialectParams::default, |plan| plan.params.dialects.clone());
    set_params(serde_json::json!({ "dialects": dialects }), sets).map(|params| params.dialects)
}

/// Writes into a folder, if `path` exists as one, or has no extension and does not exist; else to a file, which holds one program of one
/// file. Returns the paths written.
fn write(path: &Path, files: Vec<DialectFile>, origin: &FileOrigin) -> Result<Vec<PathBuf>, CliError> {
    let is_folder = path.is_dir() || (path.extension().is_none() && !path.exists());
    if !is_folder {
        return write_alone(path, files, origin);
    }
    let artifact = |file: DialectFile| Artifact { name: file.name.into(), bytes: file.text.into_bytes() };
    let artifacts: Vec<Artifact> = files.into_iter().map(artifact).collect();
    let names: Vec<&str> = artifacts.iter().map(|artifact| &*artifact.name).collect();
    OutputFolder::prepare(path, OutputWriter::Program, &names)?.replace(&artifacts, origin)?;
    Ok(names.iter().map(|name| path.join(name)).collect())
}

/// Writes the only file of the only program under the name that was asked for, over an earlier program if there is one. In a
/// folder with results it is recorded among them. What is there and is no file, such as a pipe, is neither read nor replaced.
fn write_alone(path: &Path, files: Vec<DialectFile>, origin: &FileOrigin) -> Result<Vec<PathBuf>, CliError> {
    let [file] = <[DialectFile; 1]>::try_from(files).map_err(|files| {
        let names: Vec<_> = files.iter().map(|file| file.name.as_str()).collect();
        CliError::BadInput(format!("--out {}: is a single file; name a folder for {}", path.display(), names.join(", ")))
    })?;
    if path.exists() && !path.is_file() {
        files::write(path, file.text.as_bytes())?;
        return Ok(vec![path.to_owned()]);
    }
    let folder = folder_of(path);
    if [RECORD_FILE, PLAN_FILE].iter().any(|name| folder.join(name).is_file()) {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let prepared = OutputFolder::prepare(folder, OutputWriter::Program, &[&name])?;
        prepared.replace(&[Artifact { name: name.into(), bytes: file.text.into_bytes() }], origin)?;
        return Ok(vec![path.to_owned()]);
    }
    if std::fs::read(path).is_ok_and(|bytes| !bytes.is_empty() && !out::is_program_text(&bytes)) {
        let what = "exists and is not a program that Vantage wrote; move it away or name another file";
        return Err(CliError::BadInput(format!("--out {}: {what}", path.display())));
    }
    std::fs::create_dir_all(folder_of(path)).map_err(|error| out::refused(path, &error))?;
    out::write_file(path, file.text.as_bytes())?;
    Ok(vec![path.to_owned()])
}

#[cfg(test)]
mod tests;
