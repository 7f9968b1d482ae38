//! Several parts in one `vantage plan`: one after another, each into a folder of its own. One that fails does not stop the
//! others.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::Serialize;
use serde_json::Value;

use super::out::{MadeFolders, OutputFolder};
use super::plan::{PartPlanner, PlannedPart, print_summary};
use super::{CliError, output, summary};
use crate::service::plan_job::{Artifact, PLAN_FILE, bytes_of};
use crate::wire::summary::ProgramCycle;
use crate::wire::words::percent_below;

/// Plans every part; prints what became of each.
///
/// # Errors
/// The worst of the parts' errors: an interruption, then one of the system, of the input, and no plan.
pub(super) fn run(planner: &mut PartPlanner<'_>, meshes: &[PathBuf]) -> Result<(), CliError> {
    if planner.args.serial.is_some() {
        return Err(CliError::BadInput(
            "--serial: a serial number belongs to one part; plan parts with serial numbers one by one".into(),
        ));
    }
    let out = planner.args.out();
    let paths = folders(meshes, &out)?;
    // Before the parts' own: they are inside it, and gone before it is looked at. What stands in its way is told with theirs.
    let _made = MadeFolders::make(&out).ok();
    // All are tried before the first part is planned.
    let folders = paths.iter().map(|path| planner.folder(path)).collect::<Result<Vec<_>, _>>()?;
    planner.load_fixture()?;
    let mut rows = Vec::new();
    for (mesh, folder) in meshes.iter().zip(&folders) {
        let row = plan_part(planner, mesh, folder);
        let is_interrupted = matches!(row.error, Some(CliError::Cancelled(_)));
        rows.push(row);
        if is_interrupted {
            break;
        }
    }
    let interrupted = || Some(CliError::Cancelled("interrupted before it was planned".into()));
    rows.extend(
        meshes.iter().skip(rows.len()).map(|mesh| PartRow { error: interrupted(), ..PartRow::new(mesh) }).collect::<Vec<_>>(),
    );
    output::text(format_args!("\n{}", table(&rows)))?;
    worst(&rows)
}

/// A folder for each part, named after its file without the extension.
fn folders(meshes: &[PathBuf], out: &Path) -> Result<Vec<PathBuf>, CliError> {
    // File systems that take capitals for small letters would put both into one folder.
    let mut taken: BTreeMap<String, &Path> = BTreeMap::new();
    meshes
        .iter()
        .map(|mesh| {
            let stem = mesh.file_stem().ok_or_else(|| CliError::BadInput(format!("{}: is not a file", mesh.display())))?;
            match taken.insert(stem.to_string_lossy().to_lowercase(), mesh) {
                None => Ok(out.join(stem)),
                Some(other) => Err(CliError::BadInput(format!(
                    "{} and {} would both be planned into {}; rename one of them, or plan each with its own --out",
                    other.display(),
                    mesh.display(),
                    out.join(stem).display()
                ))),
            }
        })
        .collect()
}

/// Plans a part and prints its summary, or its line of JSON.
fn plan_part(planner: &PartPlanner<'_>, mesh: &Path, folder: &OutputFolder) -> PartRow {
    let mut row = PartRow::new(mesh);
    let planned = planner.plan(mesh, folder);
    let judged = planned.as_ref().map_err(Clone::clone).and_then(|planned| {
        row.fill(planned)?;
        planner.judge(planned)
    });
    row.error = judged.err();
    if let Some(error) = &row.error {
        let (mesh, error) = (mesh.display().to_string(), error.to_string());
        // Most errors name the file.
        let named = if error.contains(&mesh) { error } else { format!("{mesh}: {error}") };
        output::error_of_part(format_args!("error: {named}"));
    }
    let artifacts = planned.as_ref().map_or(&[][..], |planned| &planned.artifacts);
    let printed = match planner.args.json {
        true => print_line(&row, folder.path(), artifacts),
        false if artifacts.is_empty() => Ok(()),
        false => {
            let printed = output::text(format_args!("\n{}\n", mesh.display()));
            printed.and_then(|()| print_summary(planner.args.json, folder.path(), artifacts))
        }
    };
    row.error = row.error.or(printed.err());
    row
}

/// A part and what became of it.
#[derive(Debug)]
struct PartRow {
    mesh: PathBuf,
    /// Views that are taken.
    views: Option<usize>,
    /// Measured share of the visible area.
    of_visible: Option<f64>,
    cycle: Option<String>,
    error: Option<CliError>,
}

impl PartRow {
    fn new(mesh: &Path) -> Self {
        Self { mesh: mesh.to_owned(), views: None, of_visible: None, cycle: None, error: None }
    }

    /// Takes over the figures of the plan.
    fn fill(&mut self, planned: &PlannedPart) -> Result<(), CliError> {
        let summary = summary::of(&planned.artifacts)?;
        self.of_visible = Some(summary.coverage.of_visible);
        self.views = Some(summary.views);
        self.cycle = summary.cycle_secs.map(|secs| match summary.program_cycle.filter(ProgramCycle::differs) {
            Some(program) => format!("{secs:.1} s ({}: {:.1} s)", program.dialect.as_str(), program.cycle_secs),
            None => format!("{secs:.1} s"),
        });
        Ok(())
    }

    /// Result in a word or two.
    fn result(&self) -> &'static str {
        match &self.error {
            None => "planned",
            Some(CliError::NoPlan(_)) => "no plan",
            Some(CliError::RegionsUnmet(_)) => "regions below target",
            Some(CliError::BadInput(_) | CliError::Findings(_)) => "bad input",
            Some(CliError::Failed(_)) => "system error",
            Some(CliError::NotCalibrated(_)) => "not calibrated",
            Some(CliError::Cancelled(_)) => "interrupted",
        }
    }
}

/// The parts as a table, with a header and a line a part.
fn table(rows: &[PartRow]) -> String {
    let or_dash = |text: Option<String>| text.unwrap_or_else(|| "–".to_owned());
    let header = ["part", "views", "of visible", "cycle", "result"].map(str::to_owned);
    let lines = rows.iter().map(|row| {
        [
            row.mesh.display().to_string(),
            or_dash(row.views.map(|views| views.to_string())),
            or_dash(row.of_visible.map(|share| format!("{} %", percent_below(share, 1.0, 2)))),
            or_dash(row.cycle.clone()),
            row.result().to_owned(),
        ]
    });
    let lines: Vec<[String; 5]> = std::iter::once(header).chain(lines).collect();
    let widths: [usize; 5] =
        std::array::from_fn(|column| lines.iter().map(|line| line[column].chars().count()).max().unwrap_or_default());
    let line = |[part, views, share, cycle, result]: &[String; 5]| {
        let [a, b, c, d, _] = widths;
        format!("{part:<a$}  {views:>b$}  {share:>c$}  {cycle:>d$}  {result}\n")
    };
    lines.iter().map(line).collect()
}

/// A part as a line of JSON.
#[derive(Serialize)]
struct PartLine {
    mesh: String,
    out: String,
    exit_code: u8,
    error: Option<String>,
    plan: Option<Value>,
}

fn print_line(row: &PartRow, out: &Path, artifacts: &[Artifact]) -> Result<(), CliError> {
    let plan = match bytes_of(artifacts, PLAN_FILE) {
        [] => None,
        bytes => Some(serde_json::from_slice(bytes).map_err(|error| unreadable(&error))?),
    };
    let line = PartLine {
        mesh: row.mesh.display().to_string(),
        out: out.display().to_string(),
        exit_code: row.error.as_ref().map_or(0, CliError::exit_code),
        error: row.error.as_ref().map(ToString::to_string),
        plan,
    };
    let line = serde_json::to_string(&line).map_err(|error| unreadable(&error))?;
    output::bytes((line + "\n").as_bytes())
}

fn unreadable(error: &serde_json::Error) -> CliError {
    CliError::Failed(format!("{PLAN_FILE}: {error}"))
}

/// The error to end with: the worst, and which parts have one.
fn worst(rows: &[PartRow]) -> Result<(), CliError> {
    let failed: Vec<String> =
        rows.iter().filter(|row| row.error.is_some()).map(|row| format!("{} ({})", row.mesh.display(), row.result())).collect();
    let detail = format!("{} of {} parts failed: {}", failed.len(), rows.len(), failed.join(", "));
    let worst = rows.iter().filter_map(|row| row.error.as_ref()).max_by_key(|error| match error {
        CliError::RegionsUnmet(_) => 0,
        CliError::NoPlan(_) | CliError::NotCalibrated(_) => 1,
        CliError::BadInput(_) | CliError::Findings(_) => 2,
        CliError::Failed(_) => 3,
        CliError::Cancelled(_) => 4,
    });
    Err(match worst {
        None => return Ok(()),
        Some(CliError::RegionsUnmet(_)) => CliError::RegionsUnmet(detail),
        Some(CliError::NoPlan(_) | CliError::NotCalibrated(_)) => CliError::NoPlan(detail),
        Some(CliError::BadInput(_) | CliError::Findings(_)) => CliError::BadInput(detail),
        Some(CliError::Failed(_)) => CliError::Failed(detail),
        Some(CliError::Cancelled(_)) => CliError::Cancelled(detail),
    })
}

#[cfg(test)]
mod tests;
