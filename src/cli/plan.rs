//! `vantage plan`: plans a part with the server's pipeline, without a server.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};

use tracing_subscriber::fmt::format::Writer;
use tracing_subscriber::fmt::time::{FormatTime, SystemTime};

use super::check::warn;
use super::files::{self, FileLibrary};
use super::given_params::{load_params, named_by_sets};
use super::limits::LimitArgs;
use super::out::{FILES_OF_EVERY_PLAN, FileOrigin, OutputFolder, OutputWriter, TIMINGS_FILE, programs};
use super::progress::{CommandStage, Course, Progress, Stopwatch};
use super::ranges::whole;
use super::{CliError, FileFinding, doubts, features, output, parts, summary};
use crate::cell::{Cell, FieldError, PoseSpec, Presets, Scanner, ScannerSpec, SpecKind, SpecLibrary};
use crate::geometry::mesh_io::ReadMesh;
use crate::geometry::{Interrupted, LazyStablePoses, LengthUnit, Mesh, Poll};
use crate::planning::context::{Context, NoPlan, Stage};
use crate::planning::params::PlanParams;
use crate::planning::plan::{Outcome, RegionCoverage, StopReason};
use crate::planning::sequence::Roadmaps;
use crate::planning::{PlanError, UpAxis, standing};
use crate::report::html::NoPlanReason;
use crate::report::text::reached_percent;
use crate::service::plan_job::{
    Artifact, PLAN_FILE, PlanJob, REFUSED_FILE, REPORT_FILE, Reports, TEXT_REPORT_FILE, bytes_of, left_out_candidates,
    plan_sha256, refused_programs,
};
use crate::wire::candidates::CANDIDATES_FILE;
use crate::wire::echo::Echo;
use crate::wire::ovp::OvpDocument;
use crate::wire::plan::{CoverageDocument, RegionCoverageDocument};
use crate::wire::regions::REGIONS_FILE;
use crate::wire::warnings::FieldWarning;
use crate::wire::words::{NOTHING_IN_REGION, area_mm2, counted, independent_share, no_plan_sentence, percent_below};
use crate::wire::{json_file_bytes, parameters, warnings};

const EXAMPLES: &str = "Examples:
  vantage plan part.stl --unit mm --out plan
  vantage plan part.stl --unit mm --cell none --scanner transcan-c-nominal \\
      --out plan
  vantage plan part.obj --unit inch --set limits.camera_deg=60 \\
      --set selection.max_views=8 --out plan --json
  vantage plan lid.stl --unit mm --up -z --set regions.exclude=@clamp.toml \\
      --out plan
  vantage plan lid.stl housing.stl --unit mm --out plans

Files written to --out: report.html (open this first), report.txt (see --report), summary.json, plan.json, program.json and the program in the \
robot's language, tables of views, coverage and missed spots (CSV, JSON), timings.json, and ovp.json, a log in the format of the \
public benchmark for viewpoint planning. Regions of interest and features add regions.csv; --set output.candidates=true adds \
candidates.json, which lists every viewpoint that was considered.

Vantage writes all files at once, when they are complete. They replace the results of an earlier run, including programs made \
from its plan. vantage.json lists them with their hashes. Your own files are left alone; if one is in the way, nothing is \
planned. If no plan is possible, or the part does not suit the plate or the scanner, the earlier results are removed, and \
report.html and report.txt say why.

Several parts are planned one after another, each into a folder of --out that is named after its file. If one fails, the others \
are still planned. A table at the end shows each result, and the exit code is the most serious one, in the order 4, 1, 2, 3. \
With --json, each part is one line: an object with mesh, out, exit_code, error and plan.

Exit codes: 0 success; 1 system error; 2 bad input; 3 no plan possible, no path to any of its views, or with --strict a region \
or feature below its target; 4 interrupted.";

/// Plan viewpoints, motion and a robot program for a part.
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES, after_long_help = format!("{EXAMPLES}\n\nParameters for --set:\n{}", parameters::help()))]
pub struct PlanArgs {
    /// Part to plan: an STL, OBJ or PLY file. Several parts are planned one after another, each into a folder named after its
    /// file.
    #[arg(required = true, value_name = "MESH")]
    pub(super) meshes: Vec<PathBuf>,
    /// Unit of the coordinates in the file, required: mm, cm, m or inch (also `in`, `inches`, `MM` and similar).
    #[arg(long)]
    unit: Option<LengthUnit>,
    /// Axis of the part that points up on the plate: x, -x, y, -y, z or -z [default: z].
    #[arg(long, value_name = "AXIS", allow_hyphen_values = true)]
    up: Option<UpAxis>,
    /// Cell: a preset name, a TOML or JSON file, or `none` to plan viewpoints only.
    #[arg(long, default_value = "e05-transcan")]
    cell: String,
    /// Scanner, only with `--cell none`: a preset name, or a TOML or JSON file [default: transcan-c].
    #[arg(long)]
    scanner: Option<String>,
    /// Planning parameters: a TOML or JSON file (`vantage params` lists them).
    #[arg(long)]
    params: Option<PathBuf>,
    /// Set one parameter, overriding --params: `selection.target=0.99`. A value that is not valid JSON is taken as a string.
    /// `KEY=@FILE` reads the value from a JSON, TOML or text file; in TOML, a list is an array of tables such as `[[exclude]]`.
    /// Repeatable.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    sets: Vec<String>,
    /// Toleranced features, in addition to `regions.features`: a JSON or CSV file. CSV example: a header line
    /// `name,region,tolerance_mm,point_spacing_mm`, then `bore,sphere 10 20 30 5,0.2,0.2` (centre and radius in mm; a tolerance
    /// of 0.2 is ±0.1 mm).
    #[arg(long)]
    features: Option<PathBuf>,
    /// Folder for the results; created if it does not exist [default: NAME_plan for NAME.stl, `plans` for several parts].
    #[arg(long)]
    out: Option<PathBuf>,
    /// Print plan.json to standard output instead of a summary; for several parts, one JSON object per line.
    #[arg(long)]
    pub(super) json: bool,
    /// Reports to write: html (report.html and report.txt), text (only report.txt) or none.
    #[arg(long, value_name = "REPORTS", default_value_t = Reports::Html)]
    report: Reports,
    /// Exit with code 3 if a region of interest or a feature misses its target, or if the independent samples refute that it
    /// meets it; results are still written.
    #[arg(long)]
    strict: bool,
    /// Number of threads, 0 to 1024; 0 for all cores. The plan does not depend on it.
    #[arg(long, default_value_t = 0, value_parser = whole::<u16>(0..=1024))]
    threads: u16,
    #[command(flatten)]
    limits: LimitArgs,
    /// Label to record in the plan, the program and the report, such as `line=3`. Repeatable.
    #[arg(long = "label", value_name = "KEY=VALUE")]
    labels: Vec<String>,
    /// Part number to record in the plan, the program and the report.
    #[arg(long)]
    part_number: Option<String>,
    /// Serial number to record in the plan, the program and the report.
    #[arg(long)]
    pub(super) serial: Option<String>,
}

impl PlanArgs {
    /// Folder for the results.
    pub(super) fn out(&self) -> PathBuf {
        let of_meshes = || match self.meshes.as_slice() {
            [mesh] => {
                let mut name = mesh.file_stem().unwrap_or_default().to_owned();
                name.push("_plan");
                name.into()
            }
            _ => PathBuf::from("plans"),
        };
        self.out.clone().unwrap_or_else(of_meshes)
    }
}

/// Runs the command.
///
/// # Errors
/// [`CliError`].
pub fn run(args: &PlanArgs, cancel: &AtomicBool) -> Result<(), CliError> {
    let mut planner = PartPlanner::load(args, cancel)?;
    match args.meshes.as_slice() {
        [mesh] => {
            let folder = planner.folder(&args.out())?;
            planner.load_fixture()?;
            let planned = planner.plan(mesh, &folder)?;
            print_summary(args.json, folder.path(), &planned.artifacts)?;
            planner.judge(&planned)
        }
        meshes => parts::run(&mut planner, meshes),
    }
}

/// Everything that the parts of a command have in common.
pub(super) struct PartPlanner<'a> {
    pub(super) args: &'a PlanArgs,
    params: PlanParams,
    cell: Option<Cell>,
    scanner: Scanner,
    fixture: Option<Mesh>,
    /// SHA-256 of the fixture's file.
    fixture_sha256: Option<String>,
    echo: Echo,
    /// Views are ordered, and remedies tried, many times in the same cell.
    roadmaps: Roadmaps,
    pool: rayon::ThreadPool,
    /// Clock of the command since its start, until the first part takes it.
    watch: Mutex<Option<Stopwatch>>,
    cancel: &'a AtomicBool,
}

/// A part that was planned, and its files, which are written.
pub(super) struct PlannedPart {
    pub(super) outcome: Outcome,
    pub(super) artifacts: Vec<Artifact>,
    /// Warnings on regions that hold nothing of it, which were given.
    empty_regions: Vec<FieldWarning>,
}

impl<'a> PartPlanner<'a> {
    fn load(args: &'a PlanArgs, cancel: &'a AtomicBool) -> Result<Self, CliError> {
        let watch = Mutex::new(Some(Stopwatch::start(Some(CommandStage::Loading.as_str()))));
        let mut params = load_params(args.params.as_deref(), &args.sets)?;
        if let Some(file) = args.features.as_deref() {
            params.regions.features.extend(features::read(file)?);
            params.check().map_err(|errors| files::findings(&format!("--features {}", file.display()), &errors))?;
        }
        check_up(args.up, &params)?;
        warn("parameters", &warnings::of_params(&params, ""));
        let cell = load_cell(&args.cell, args.scanner.as_deref())?;
        let scanner = load_scanner(cell.as_ref(), args.scanner.as_deref())?;
        warn("parameters", &warnings::of_spacing(&params, &scanner, ""));
        warn("parameters", warnings::of_goal(&params, cell.is_some(), "").as_slice());
        cell.iter().for_each(|cell| warn(&args.cell, &warnings::of_cell(cell, "")));
        doubts::warn_of_file(SpecKind::Cell, &args.cell);
        args.scanner.iter().for_each(|name| doubts::warn_of_file(SpecKind::Scanner, name));
        params.check_limits(&scanner).map_err(|errors| named_by_sets(files::findings("parameters", &errors), &args.sets))?;
        let echo = Echo::given(labels(&args.labels)?, args.part_number.clone(), args.serial.clone());
        echo.check().map_err(|errors| files::findings("--label, --part-number, --serial", &errors))?;
        let (roadmaps, pool) = (Roadmaps::default(), pool(args.threads)?);
        let (fixture, fixture_sha256) = (None, None);
        Ok(Self { args, params, cell, scanner, fixture, fixture_sha256, echo, roadmaps, pool, watch, cancel })
    }

    /// The folder for the results of a part.
    pub(super) fn folder(&self, path: &Path) -> Result<OutputFolder, CliError> {
        let mut names = FILES_OF_EVERY_PLAN.to_vec();
        let left_out: &[&str] = match self.args.report {
            Reports::None => &[REPORT_FILE, TEXT_REPORT_FILE],
            Reports::Text => &[REPORT_FILE],
            Reports::Html => &[],
        };
        names.retain(|name| !left_out.contains(name));
        let takes = |cell: &Cell| programs(self.params.setups as usize, |dialect| cell.robot.takes(dialect));
        let programs = self.cell.as_ref().map(takes).unwrap_or_default();
        names.extend(programs.iter().map(String::as_str).chain([REFUSED_FILE]));
        names.extend(
            (!self.params.regions.interest.is_empty() || !self.params.regions.features.is_empty()).then_some(REGIONS_FILE),
        );
        names.extend(self.params.output.candidates.then_some(CANDIDATES_FILE));
        OutputFolder::prepare(path, OutputWriter::Plan, &names)
    }

    /// Loads the fixture, if there is one.
    pub(super) fn load_fixture(&mut self) -> Result<(), CliError> {
        let path = self.params.part.fixture_mesh.as_ref();
        let load = |path: &String| self.pool.install(|| load_mesh(Path::new(path), self.args.unit, self.cancel));
        let fixture = path.map(load).transpose()?;
        (self.fixture, self.fixture_sha256) = fixture.map(|(read, sha256)| (read.mesh, sha256)).unzip();
        Ok(())
    }

    /// Plans a part and writes its files. Where no plan is possible, those of an earlier plan are removed, so that nobody takes
    /// them for this part's.
    pub(super) fn plan(&self, mesh: &Path, folder: &OutputFolder) -> Result<PlannedPart, CliError> {
        let mut watch = self.watch().take().unwrap_or_else(|| Stopwatch::start(None));
        watch.switch(Some(Stage::Reading.as_str()));
        let is_read = || watch.switch(Some(CommandStage::Health.as_str()));
        let (part, part_sha256) = self.pool.install(|| load_mesh_in_steps(mesh, self.args.unit, self.cancel, is_read))?;
        let params = placed(&self.params, self.args.up, &part.mesh);
        let job = PlanJob {
            mesh: &part.mesh,
            fixture: self.fixture.as_ref(),
            fixture_sha256: self.fixture_sha256.as_deref(),
            part_name: mesh.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned()),
            part_sha256: &part_sha256,
            unit: part.unit,
            scanner: &self.scanner,
            cell: self.cell.as_ref(),
            roadmaps: Some(&self.roadmaps),
            rescan: None,
            params: &params,
            echo: self.echo.clone(),
            date: Some(now()),
        };
        warn(&mesh.display().to_string(), &job.size_warnings("--unit"));
        let stable = self.warn_of_up(mesh, &part.mesh)?;
        let progress = Progress::go_on(&Course::of_plan(&params, self.cell.is_some()), watch);
        let planned = || {
            let allowance = self.args.limits.allowance(rayon::current_num_threads());
            let ctx = Context::new(self.cancel, &progress).with_allowance(allowance);
            match job.plan(&ctx) {
                Ok(outcome) => {
                    outcome.stable_poses.learn_from(&stable);
                    let artifacts = job.render(&outcome, self.args.report, &ctx)?;
                    Ok((Ok(outcome), artifacts))
                }
                Err(PlanError::NoPlan(finding)) => Ok((
                    Err(CliError::NoPlan(no_plan_reason(&finding))),
                    job.render_no_plan(NoPlanReason::NoPlan(&finding), self.args.report, &ctx)?,
                )),
                Err(PlanError::BadParams(errors)) if !self.faults_of_part(&job, &errors).is_empty() => {
                    let faults = self.faults_of_part(&job, &errors);
                    let report = job.render_no_plan(NoPlanReason::PartRefused(&faults), self.args.report, &ctx)?;
                    Ok((Err(blamed(&job, self.args, mesh, PlanError::BadParams(errors))), report))
                }
                Err(error) => Err(error),
            }
        };
        let result = self
            .args
            .limits
            .within(self.cancel, || self.pool.install(planned).map_err(|error| blamed(&job, self.args, mesh, error)));
        let mut watch = progress.finish();
        let (planned, mut artifacts) = result?;
        watch.switch(Some(CommandStage::Writing.as_str()));
        let outcome = planned.map_err(|error| without_plan(error, &artifacts, folder))?;
        let empty_regions = self.warn_of_plan(&job, &outcome, &artifacts);
        let sha256 = plan_sha256(bytes_of(&artifacts, PLAN_FILE));
        let log = OvpDocument::new(&outcome, &part.mesh, &self.scanner, &job.part_name, &sha256, &watch.times(), now());
        artifacts.push(Artifact { name: "ovp.json".into(), bytes: json_file_bytes(&log) });
        let timings = || Artifact { name: TIMINGS_FILE.into(), bytes: json_file_bytes(&watch.times()) };
        folder.replace_timed(&artifacts, &timings, &FileOrigin { plan_sha256: Some(sha256), made_from: None })?;
        warn_of_refused(self.cell.as_ref(), &artifacts, folder.path());
        Ok(PlannedPart { outcome, artifacts, empty_regions })
    }

    /// Warns of a part that would not stand with the axis up that `--up` gives. Returns the ways in which it stands, known with
    /// `--up` alone.
    fn warn_of_up(&self, path: &Path, part: &Mesh) -> Result<LazyStablePoses, CliError> {
        let stable = LazyStablePoses::default();
        if let (Some(up), None) = (self.args.up, self.fixture.as_ref()) {
            let stop = || self.cancel.load(Ordering::Relaxed);
            let known = self.pool.install(|| stable.of(part, &Poll::new(&stop)));
            let known = known.map_err(|Interrupted| CliError::Cancelled("interrupted; nothing was written".into()))?;
            warn(&path.display().to_string(), warnings::of_standing(known, up, "--up").as_slice());
        }
        Ok(stable)
    }

    /// Warns of regions that hold nothing of the part, of a list of candidates that is left out, of a home that the part
    /// blocks, and of poses in which the part would tip over. Returns the warnings on regions.
    fn warn_of_plan(&self, job: &PlanJob<'_>, outcome: &Outcome, artifacts: &[Artifact]) -> Vec<FieldWarning> {
        warn("parameters", left_out_candidates(artifacts, "").as_slice());
        warn("parameters", job.fixture_warning(outcome, "").as_slice());
        warn(&self.args.cell, &job.home_warnings(outcome, ""));
        let empty_regions = job.empty_region_warnings(outcome, "");
        warn("parameters", &empty_regions);
        // With --up its user was warned before.
        if self.args.up.is_none() {
            // Known since the files were rendered.
            warn("parameters", &job.standing_warnings(outcome, "", &Poll::never()).unwrap_or_default());
        }
        empty_regions
    }

    fn watch(&self) -> std::sync::MutexGuard<'_, Option<Stopwatch>> {
        // There, or taken: whole after every operation.
        self.watch.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Faults of a part that does not suit plate or scanner; empty where parameters are to blame.
    fn faults_of_part(&self, job: &PlanJob<'_>, errors: &[FieldError]) -> Vec<String> {
        let is_pose_given = is_pose_given(job, self.args.up);
        let faults: Option<Vec<String>> = errors.iter().map(|error| job.error_of_part(error, is_pose_given)).collect();
        faults.unwrap_or_default()
    }

    /// Warns of what a plan loses under pose errors and of regions below their targets; with `--strict` these are an error, as is always a
    /// plan of which no view is carried out.
    pub(super) fn judge(&self, planned: &PlannedPart) -> Result<(), CliError> {
        let coverage = &planned.outcome.plan.coverage;
        warn_of_quality(&self.params, &CoverageDocument::from(coverage), planned.outcome.plan.stopped_because);
        let regions = judge_regions(self.args.strict, &self.params, &coverage.regions, &planned.empty_regions);
        require_a_view(planned.outcome.plan.executed_views(), planned.outcome.plan.views.len())?;
        regions
    }
}

/// Replaces the results of an earlier plan by the report on why there is none; the error to end with.
fn without_plan(error: CliError, report: &[Artifact], folder: &OutputFolder) -> CliError {
    match folder.replace(report, &FileOrigin::default()) {
        Ok(()) => {
            if let Some(report) = shown_report(report) {
                output::note(format_args!("Report: {}", folder.path().join(report).display()));
            }
        }
        Err(kept) => output::note(format_args!("results of an earlier plan could not be replaced: {kept}")),
    }
    error
}

/// Warns of programs in the robot's own language that are not among the files.
pub(super) fn warn_of_refused(cell: Option<&Cell>, artifacts: &[Artifact], folder: &Path) {
    let refused = cell.and_then(|cell| cell.robot.dialect).map(|dialect| refused_programs(artifacts, dialect));
    let remedy = format!("plan again with what it asks for; {} lists all that was refused", folder.join(REFUSED_FILE).display());
    for (name, reason) in refused.unwrap_or_default() {
        output::warning(&name, "", &format!("was not written, so there is no program for the robot: {reason}"), &remedy);
    }
}

/// Returns true if the pose of the part is a parameter that its user set.
fn is_pose_given(job: &PlanJob<'_>, up: Option<UpAxis>) -> bool {
    up.is_none() && job.params.part.table_from_part.is_some()
}

/// The report among the files that a user looks at first, if there is one.
fn shown_report(artifacts: &[Artifact]) -> Option<&'static str> {
    [REPORT_FILE, TEXT_REPORT_FILE].into_iter().find(|name| artifacts.iter().any(|artifact| artifact.name == *name))
}

/// Refuses `--up` beside parameters that say how the part lies.
pub(super) fn check_up(up: Option<UpAxis>, params: &PlanParams) -> Result<(), CliError> {
    let refuse = |what: &str| {
        Err(CliError::BadInput(format!("--up: {what} already says how the part lies; leave --up out, or that parameter")))
    };
    match up {
        None => Ok(()),
        Some(_) if params.part.table_from_part.is_some() => refuse("part.table_from_part"),
        Some(_) if !params.part.resting_poses.is_empty() => refuse("part.resting_poses"),
        Some(_) => Ok(()),
    }
}

/// The parameters, with the pose of a part that `--up` gives.
pub(super) fn placed(params: &PlanParams, up: Option<UpAxis>, mesh: &Mesh) -> PlanParams {
    let mut params = params.clone();
    if let Some(up) = up {
        params.part.table_from_part = Some(PoseSpec::from(&standing(mesh, up)));
    }
    params
}

/// Warns of a plan that measures less at grade A than is asked for, or loses much under pose errors.
fn warn_of_quality(params: &PlanParams, coverage: &CoverageDocument, stopped_because: StopReason) {
    warn("parameters", warnings::of_grade_a(params, coverage, "").as_slice());
    let robust = coverage.robust.as_ref();
    let fragile = robust.and_then(|robust| warnings::of_robust(params, robust, (false, stopped_because), ""));
    warn("parameters", fragile.as_slice());
}

/// Warns of regions that do not reach their target, or reach it on the samples that views were chosen on alone; with `strict` both are an
/// error. `told` are warnings on regions that were given.
fn judge_regions(strict: bool, params: &PlanParams, regions: &[RegionCoverage], told: &[FieldWarning]) -> Result<(), CliError> {
    let regions: Vec<_> = regions.iter().map(RegionCoverageDocument::from).collect();
    let unmet = warnings::of_regions(params, &regions, "");
    let refuted = warnings::of_refuted_regions(params, &regions, "");
    let untold = warnings::by_cause([told, unmet.as_slice()].concat());
    warn("parameters", &untold[told.len()..]);
    warn("parameters", &refuted);
    if !strict {
        return Ok(());
    }
    let lines: Vec<String> = regions.iter().filter_map(not_met).map(|region| format!("\n  {region}")).collect();
    if lines.is_empty() {
        return Ok(());
    }
    Err(CliError::RegionsUnmet(format!(
        "{} of {} regions and features not met (--strict); the results are written{}\n  → see the fixes in the report, lower the \
         targets, or exclude what cannot be measured (regions.exclude)",
        lines.len(),
        regions.len(),
        lines.concat()
    )))
}

/// Region that does not have what is asked of it, in a sentence: its target, what is reached, and why not more. `None` for any
/// other.
fn not_met(region: &RegionCoverageDocument) -> Option<String> {
    let target = region.target.map_or_else(String::new, |target| format!(", target {} %", percent_below(target, 1.0, 2)));
    let name = format!("{:?}{target}", region.name);
    if region.samples == 0 {
        return Some(format!("{name}: {NOTHING_IN_REGION}"));
    }
    let reached = reached_percent(region.of_asked, region.target);
    if region.met == Some(false) {
        let (asked, why) = (area_mm2(region.asked_area_mm2), region.why_unmet.as_deref().unwrap_or("not known"));
        return Some(format!("{name}: {reached} % of {asked} mm² measured; missed: {why}"));
    }
    let independent = independent_share(region).filter(|_| region.is_refuted())?;
    let samples = region.independent_samples.unwrap_or_default();
    Some(format!("{name}: {reached} % on the samples that views were chosen on, but on {samples} others {independent}"))
}

/// Refuses a plan of which no view is executed. One without views has given up the last for want of a path.
pub(super) fn require_a_view(executed: usize, chosen: usize) -> Result<(), CliError> {
    if executed > 0 {
        return Ok(());
    }
    Err(CliError::NoPlan(format!(
        "no view can be reached: no collision-free path leads to any ({} chosen); the results are written and say what \
         is in the way",
        counted(chosen, "view")
    )))
}

/// Loads a mesh and prints its warnings: a wrong unit is better noticed before an hour of planning than after.
pub(super) fn load_mesh(path: &Path, unit: Option<LengthUnit>, cancel: &AtomicBool) -> Result<(ReadMesh, String), CliError> {
    load_mesh_in_steps(path, unit, cancel, || ())
}

/// Loads a mesh as [`load_mesh`] does; calls `is_read` when its bytes are read and it is to be welded and assessed.
fn load_mesh_in_steps(
    path: &Path,
    unit: Option<LengthUnit>,
    cancel: &AtomicBool,
    is_read: impl FnOnce(),
) -> Result<(ReadMesh, String), CliError> {
    let (read, sha256) = files::mesh_in_steps(path, unit, &Poll::new(&|| cancel.load(Ordering::Relaxed)), is_read)?;
    for warning in read.health.warnings() {
        output::warning(&path.display().to_string(), "", &warning.to_string(), warning.remedy());
    }
    Ok((read, sha256))
}

/// Loads the cell that `--cell` names; `None` for `none`.
pub(super) fn load_cell(name: &str, scanner: Option<&str>) -> Result<Option<Cell>, CliError> {
    if name == "none" {
        return Ok(None);
    }
    if scanner.is_some() {
        return Err(CliError::BadInput("--scanner can only be used with --cell none; a cell has its own scanner".into()));
    }
    let (spec, _) = files::cell(name)?;
    spec.build(&FileLibrary).map(Some).map_err(|errors| files::findings(name, &errors))
}

/// Loads the scanner: the cell's, else the one that `--scanner` names.
pub(super) fn load_scanner(cell: Option<&Cell>, name: Option<&str>) -> Result<Scanner, CliError> {
    if let Some(cell) = cell {
        return Ok(cell.scanner.clone());
    }
    let name = name.unwrap_or("transcan-c");
    let spec: ScannerSpec = files::spec(SpecKind::Scanner, name, Presets.scanner(name))?;
    spec.build().map_err(|errors| files::findings(name, &errors))
}

/// Thread pool of `threads` threads; of all cores for 0.
pub(super) fn pool(threads: u16) -> Result<rayon::ThreadPool, CliError> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(usize::from(threads)).build();
    pool.map_err(|error| CliError::Failed(format!("--threads: {error}")))
}

/// Current time in UTC, RFC 3339; empty if it cannot be formatted.
pub(super) fn now() -> String {
    let mut text = String::new();
    match SystemTime.format_time(&mut Writer::new(&mut text)) {
        Ok(()) => text,
        Err(_) => String::new(),
    }
}

fn labels(pairs: &[String]) -> Result<std::collections::BTreeMap<String, String>, CliError> {
    let mut labels = std::collections::BTreeMap::new();
    for pair in pairs {
        let refused = |said: &str| CliError::BadInput(format!("--label {pair}: {said}"));
        let (key, value) = pair.split_once('=').ok_or_else(|| refused("not of the form KEY=VALUE"))?;
        if labels.insert(key.to_owned(), value.to_owned()).is_some() {
            return Err(refused("the key is given twice"));
        }
    }
    Ok(labels)
}

/// Error of the command for an error of planning.
pub(super) fn to_cli_error(error: PlanError) -> CliError {
    match error {
        PlanError::Cancelled => CliError::Cancelled("interrupted; nothing was written".into()),
        PlanError::BadParams(errors) => files::findings("parameters", &errors),
        PlanError::NoPlan(finding) => CliError::NoPlan(no_plan_reason(&finding)),
    }
}

fn no_plan_reason(finding: &NoPlan) -> String {
    format!("no plan is possible: {}", no_plan_sentence(finding))
}

/// Error of the command for an error of a plan: at what its user gave, the file and its unit where no parameter is to blame.
fn blamed(job: &PlanJob<'_>, args: &PlanArgs, mesh: &Path, error: PlanError) -> CliError {
    let PlanError::BadParams(errors) = error else { return to_cli_error(error) };
    let is_pose_given = is_pose_given(job, args.up);
    let finding = |error: &FieldError| match job.error_of_part(error, is_pose_given) {
        Some(detail) => FileFinding { file: format!("{} (--unit {})", mesh.display(), job.unit), pointer: String::new(), detail },
        None => FileFinding { file: "parameters".to_owned(), pointer: error.pointer.clone(), detail: error.detail.clone() },
    };
    named_by_sets(CliError::Findings(errors.iter().map(finding).collect()), &args.sets)
}

/// Prints a summary for people, or with `--json` the plan itself for programs.
pub(super) fn print_summary(json: bool, out: &Path, artifacts: &[Artifact]) -> Result<(), CliError> {
    let bytes = bytes_of(artifacts, PLAN_FILE);
    if json {
        return output::bytes(bytes);
    }
    let lines = summary::lines(artifacts)?.join("\n");
    let report = shown_report(artifacts).map_or_else(String::new, |name| format!("Report: {}\n", out.join(name).display()));
    output::text(format!("{lines}\n{report}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::planning::params::{FeatureParams, Region};
    use crate::planning::plan::{Cause, IndependentRegion, RegionKind};

    /// A feature of 10 mm² with a target of 0.9 that is reached on the samples of the plan, and so much measured on 400 others.
    fn feature(independent_mm2: f64) -> RegionCoverage {
        RegionCoverage {
            name: "bore".to_owned(),
            kind: RegionKind::Feature,
            samples: 100,
            asked_area_mm2: 10.0,
            coverable_area_mm2: 10.0,
            measured_area_mm2: 9.3,
            target: Some(0.9),
            tolerance_mm: None,
            min_tolerance_mm: 0.156,
            missed_mm2: Vec::new(),
            beyond_noise_area_mm2: 0.0,
            independent: Some(IndependentRegion {
                samples: 400,
                asked_area_mm2: 10.0,
                measured_area_mm2: independent_mm2,
                squares_mm4: 0.25,
            }),
        }
    }

    fn params(features: usize) -> PlanParams {
        let feature = FeatureParams {
            name: None,
            region: Region::Box { min_mm: [0.0; 3], max_mm: [1.0; 3] },
            tolerance_mm: 0.5,
            point_spacing_mm: None,
            target: Some(0.9),
        };
        let mut params = PlanParams::default();
        params.regions.features = vec![feature; features];
        params
    }

    /// "Cannot be scanned" ended with exit code 0.
    #[test]
    fn a_plan_of_which_no_view_is_carried_out_is_an_error() {
        let refused = require_a_view(0, 10).expect_err("no view is carried out");
        assert_eq!(refused.exit_code(), 3);
        assert!(refused.to_string().contains("10 views chosen"), "{refused}");
        assert_eq!(require_a_view(1, 10), Ok(()));
        let refused = require_a_view(0, 0).expect_err("the last view was given up");
        assert_eq!(refused.exit_code(), 3);
    }

    /// Such a region was a warning alone, and exit code 0.
    #[test]
    fn a_region_that_independent_samples_refute_is_an_error_with_strict() {
        let judged = |strict: bool, regions: &[RegionCoverage]| judge_regions(strict, &params(regions.len()), regions, &[]);
        assert_eq!(judged(true, &[feature(8.9)]), Ok(()), "within the standard error");
        assert_eq!(judged(false, &[feature(8.5)]), Ok(()));
        let refused = judged(true, &[feature(8.5), feature(9.3)]).expect_err("one of two");
        assert_eq!(refused.exit_code(), 3);
        assert!(refused.to_string().starts_with("1 of 2 regions and features not met (--strict); "), "{refused}");
    }

    /// One that holds nothing of the part hid all others, of which none was named.
    #[test]
    fn every_region_that_is_not_met_is_named_with_what_is_asked_and_reached_and_why_in_one_message() {
        let unmet = RegionCoverage {
            name: "rim".to_owned(),
            measured_area_mm2: 5.0,
            missed_mm2: vec![(Cause::ShadowLeft, 4.0), (Cause::Depth, 1.0)],
            ..feature(5.0)
        };
        let empty = RegionCoverage {
            name: "slot".to_owned(),
            samples: 0,
            asked_area_mm2: 0.0,
            measured_area_mm2: 0.0,
            target: None,
            independent: None,
            ..feature(0.0)
        };
        let regions = [feature(8.5), unmet, feature(9.3), empty];
        let refused = judge_regions(true, &params(regions.len()), &regions, &[]).expect_err("three of four");
        assert_eq!(refused.exit_code(), 3);
        assert_eq!(
            refused.to_string(),
            "3 of 4 regions and features not met (--strict); the results are written\n  \
             \"bore\", target 90.00 %: 93.00 % on the samples that views were chosen on, but on 400 others 85.00 %, standard \
             error 1.79 points\n  \
             \"rim\", target 90.00 %: 50.00 % of 10.0 mm² measured; missed: hidden from the left camera (4.00 mm²), \
             outside the working depth (1.00 mm²)\n  \
             \"slot\": it contains none of the asked surface\n  \
             → see the fixes in the report, lower the targets, or exclude what cannot be measured (regions.exclude)"
        );
    }
}
