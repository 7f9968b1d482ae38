//! Planning of a part in a cell, with all result files: shared by the server's jobs and the command line.

mod fixture_fit;
mod refused;

use std::borrow::Cow;

use sha2::{Digest, Sha256};

use self::refused::{DialectProgram, Refused, in_dialect};
pub use self::refused::{REFUSED_FILE, dialect_of, foreign_name, left_out_candidates, refused_programs};
use super::rescan_job::RescanJob;
use crate::cell::{Cell, FieldError, PoseSpec, Scanner, closed_list};
use crate::geometry::{self, Interrupted, LengthUnit, Mesh, Part, Poll, Pose, Preview, Table};
use crate::planning::context::{Cancelled, Context, Stage};
use crate::planning::params::{DialectParams, PlanParams, TableMotion};
use crate::planning::plan::{Outcome, Plan};
use crate::planning::sequence::Roadmaps;
use crate::planning::surface::empty_regions;
use crate::planning::{PlanError, PlanInput, plan, standing_likeliest};
use crate::program::dialects::{CheckedProgram, CheckedWith, Dialect};
use crate::program::{Expected, Program, compile_views};
use crate::report::html::{self, NoPlanInput, NoPlanReason, ReportInput, ReportSubject};
use crate::report::no_plan_text;
use crate::report::text::{text_with_warnings, warned};
use crate::wire::candidates::{self, CANDIDATES_FILE, ListingError};
use crate::wire::echo::Echo;
use crate::wire::hex;
use crate::wire::part_size::{PartSize, SizeLimits, size_text, unit_text};
use crate::wire::plan::{CellDocument, FixtureDocument, PlanDocument};
use crate::wire::program::ProgramDocument;
use crate::wire::regions::REGIONS_FILE;
use crate::wire::summary::{PlanDoubts, ProgramCycle, SUMMARY_FILE, StandingRemedy, Summary};
use crate::wire::warnings::{
    FieldWarning, RegionUse, WarningCode, at_head_of_reports, by_cause, of_empty_region, of_fixture, of_home, of_poses, of_sight,
};
use crate::wire::{coverage, json_file_bytes, missed, regions, viewpoints};

/// Max triangles of the preview that browsers draw and `coverage.bin` refers to.
pub const PREVIEW_TRIANGLES: usize = 300_000;

/// Stem of the file names of a setup's program: `program`, then `program-2` and so on.
#[must_use]
pub fn program_stem(setup: usize) -> String {
    if setup == 0 { "program".to_owned() } else { format!("program-{}", setup + 1) }
}

/// File of the plan itself.
pub const PLAN_FILE: &str = "plan.json";

/// The report with pictures.
pub const REPORT_FILE: &str = "report.html";

/// The report as plain text.
pub const TEXT_REPORT_FILE: &str = "report.txt";

/// Draft of [`REPORT_FILE`], which takes its place until somebody asks for it; not shown to clients.
pub const REPORT_DRAFT_FILE: &str = "report.draft";

closed_list! {
    /// Reports that `vantage plan` writes.
    pub enum Reports {
        /// A plan without reports.
        None = "none",
        /// The report in plain text.
        Text = "text",
        /// The report in plain text and the one with pictures.
        Html = "html",
    }
}

impl std::str::FromStr for Reports {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        let known = || Self::ALL.map(Self::as_str).join(", ");
        Self::ALL
            .into_iter()
            .find(|reports| reports.as_str() == name)
            .ok_or_else(|| format!("is {name:?}; allowed is one of {}", known()))
    }
}

impl std::fmt::Display for Reports {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.as_str())
    }
}

/// Reports to render, and how far.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Rendered {
    /// Reports that are rendered with their pictures.
    Whole(Reports),
    /// Both reports, with a draft of the pictures.
    Draft,
}

/// Programs in the languages of other makers than the robot's.
#[derive(Clone, Copy, PartialEq, Eq)]
enum ForeignPrograms {
    /// Written under a name of their own, with a warning in the header, for who asks for them all the same.
    Kept,
    /// Programs that are not written.
    LeftOut,
}

/// Files with their names.
type Files = Vec<(Cow<'static, str>, Vec<u8>)>;
/// A program that the linter found nothing in, or its findings in a sentence.
type CheckedOrFindings<'a> = Result<CheckedProgram<'a>, String>;

/// A plan as it is written, with what its warnings come to.
struct WrittenPlan {
    /// Bytes of its file.
    bytes: Vec<u8>,
    /// SHA-256 of the bytes.
    sha256: String,
    /// Warnings on the part's size.
    size_warnings: Vec<FieldWarning>,
    /// Other warnings at the head of reports.
    warnings: Vec<FieldWarning>,
    /// Number of setups in which the part would tip over.
    unstable_setups: usize,
    /// Way to place the part so that it stands, where it would tip over.
    standing: Option<StandingRemedy>,
}

/// Programs of the setups, in every language in which they are written.
struct RenderedPrograms<'p> {
    programs: &'p [Program],
    /// Each program as the linter finds it.
    checked: Vec<CheckedOrFindings<'p>>,
    /// Each program in each dialect.
    rendered: Vec<Vec<DialectProgram>>,
}

/// A result file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Artifact {
    /// Name of the file.
    pub name: Cow<'static, str>,
    /// Bytes of the file.
    pub bytes: Vec<u8>,
}

/// Bytes of the file of this name; none if there is no such file.
#[must_use]
pub fn bytes_of<'a>(artifacts: &'a [Artifact], name: &str) -> &'a [u8] {
    artifacts.iter().find(|artifact| artifact.name == name).map_or(&[], |artifact| &artifact.bytes)
}

/// Inputs of a planning job.
pub struct PlanJob<'a> {
    /// The part.
    pub mesh: &'a Mesh,
    /// Fixture that holds the part, in the part's coordinates.
    pub fixture: Option<&'a Mesh>,
    /// SHA-256 of the fixture's file, where it is known.
    pub fixture_sha256: Option<&'a str>,
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
    /// State after scans, where views are planned for what they lack.
    pub rescan: Option<&'a RescanJob>,
    /// Parameters.
    pub params: &'a PlanParams,
    /// Fields of the request that the files echo.
    pub echo: Echo,
    /// Time to print on the report, RFC 3339: the one thing in the files that is not of the request.
    pub date: Option<String>,
}

impl PlanJob<'_> {
    /// Plans and renders every file, and the programs that are refused unless they are forced. Runs in the caller's thread
    /// pool.
    ///
    /// # Errors
    /// [`PlanError`].
    pub fn execute(&self, ctx: &Context<'_>) -> Result<Vec<Artifact>, PlanError> {
        Ok(self.artifacts(&self.plan(ctx)?, ForeignPrograms::Kept, Rendered::Whole(Reports::Html), ctx)?)
    }

    /// Plans and renders every file as [`PlanJob::execute`] does, but [`REPORT_DRAFT_FILE`] in place of [`REPORT_FILE`]: few reports
    /// are ever looked at, and [`drawn_report`] draws one when it is.
    ///
    /// # Errors
    /// [`PlanError`].
    pub fn execute_with_draft(&self, ctx: &Context<'_>) -> Result<Vec<Artifact>, PlanError> {
        Ok(self.artifacts(&self.plan(ctx)?, ForeignPrograms::Kept, Rendered::Draft, ctx)?)
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
        match self.rescan {
            Some(rescan) => rescan.plan(&input, ctx),
            None => plan(&input, self.params, ctx),
        }
    }

    /// Warnings on the part's size; `at` names the part: a pointer, or an option.
    #[must_use]
    pub fn size_warnings(&self, at: &str) -> Vec<FieldWarning> {
        let limits = SizeLimits::new(self.scanner, self.cell);
        PartSize::new(&self.mesh.aabb(), self.unit).warnings(self.params.part.table_from_part.as_ref(), &limits, at)
    }

    /// Question on the unit that comes before the verdict; `None` if the part's size is plausible.
    fn unit_question(&self) -> Option<String> {
        let limits = SizeLimits::new(self.scanner, self.cell);
        PartSize::new(&self.mesh.aabb(), self.unit).unit_question(self.params.part.table_from_part.as_ref(), &limits)
    }

    /// Warnings on regions that hold nothing of the part; `at` is the pointer to the parameters. None for a plan of what earlier scans left
    /// open, whose samples do not tell a region that lies elsewhere from one that is measured.
    #[must_use]
    pub fn empty_region_warnings(&self, outcome: &Outcome, at: &str) -> Vec<FieldWarning> {
        if outcome.plan.coverage.is_of_open {
            return Vec::new();
        }
        let (regions, part) = (&self.params.regions, self.mesh.aabb());
        let exclude = empty_regions(self.mesh, &outcome.surface, regions.exclude.iter());
        let interest = empty_regions(self.mesh, &outcome.surface, regions.interest.iter().map(|interest| &interest.region));
        let features = empty_regions(self.mesh, &outcome.surface, regions.features.iter().map(|feature| &feature.region));
        let uses = [(RegionUse::Exclude, exclude), (RegionUse::Interest, interest), (RegionUse::Features, features)];
        let warnings = |(use_, places): (RegionUse, Vec<usize>)| {
            places.into_iter().map(move |place| of_empty_region(use_, place, &part, at))
        };
        uses.into_iter().flat_map(warnings).collect()
    }

    /// Warnings on poses of a plan in which the part would tip over on the plate; `at` is the pointer to the parameters.
    ///
    /// # Errors
    /// [`Interrupted`], unless it is known by then how the part stands: once the files are rendered.
    pub fn standing_warnings(&self, outcome: &Outcome, at: &str, poll: &Poll<'_>) -> Result<Vec<FieldWarning>, Interrupted> {
        if self.cell.is_none() || self.fixture.is_some() {
            return Ok(Vec::new());
        }
        let plan = &outcome.plan;
        let given = &plan.params.part.resting_poses;
        let pointer = |pose: &Pose<Table, Part>| match given.iter().position(|given| given.pose() == *pose) {
            Some(place) => format!("{at}/part/resting_poses/{place}"),
            None => format!("{at}/part/table_from_part"),
        };
        let poses = plan.setups.iter().map(|setup| (pointer(&setup.table_from_part), setup.table_from_part));
        Ok(of_poses(outcome.stable_poses.of(self.mesh, poll)?, &poses.collect::<Vec<_>>()))
    }

    /// Way to place the part so that it stands, if it would tip over in a setup of a plan with these warnings; `None` of what
    /// earlier scans left open, since the part lay like that in them.
    fn standing_remedy(&self, outcome: &Outcome, warnings: &[FieldWarning]) -> Option<StandingRemedy> {
        let unstable: Vec<_> = warnings.iter().filter(|warning| warning.code == WarningCode::PartUnstable).collect();
        if unstable.is_empty() || outcome.plan.coverage.is_of_open {
            return None;
        }
        if unstable.iter().all(|warning| warning.pointer.contains("/part/resting_poses/")) {
            return Some(StandingRemedy::InPosesOfPlanner);
        }
        // Known since the warnings were made.
        let stable = outcome.stable_poses.of(self.mesh, &Poll::never()).ok()?;
        let (up, table_from_part) = standing_likeliest(self.mesh, stable)?;
        Some(match up {
            // The command line takes no axis beside resting poses.
            Some(up) if self.params.part.resting_poses.is_empty() => StandingRemedy::WithAxisUp(up, table_from_part),
            Some(_) | None => StandingRemedy::InPose(table_from_part),
        })
    }

    /// Warning on a fixture that runs into the part, or is the part itself; `at` is the pointer to the parameters.
    #[must_use]
    pub fn fixture_warning(&self, outcome: &Outcome, at: &str) -> Option<FieldWarning> {
        let fixture = self.fixture?;
        let is_part = self.fixture_sha256 == Some(self.part_sha256);
        let overlaps = is_part || fixture_fit::overlap(self.mesh, fixture, &outcome.surface.sample_mm);
        overlaps.then(|| of_fixture(is_part, fixture_fit::MAX_DEPTH_MM, at))
    }

    /// Warnings on a home that the part of a plan leaves no way out of; `at` is the pointer to the cell.
    #[must_use]
    pub fn home_warnings(&self, outcome: &Outcome, at: &str) -> Vec<FieldWarning> {
        let clearance_mm = outcome.plan.params.motion.clearance_mm;
        self.cell.map_or_else(Vec::new, |cell| of_home(cell, &outcome.scenes, clearance_mm, at))
    }

    /// Description of an error that parameters are blamed for which nobody has set: how the part lies by default, or that it is far
    /// too large. Its user gave the file and its unit. `None` for an error of parameters, as one on a pose that `is_pose_given`.
    #[must_use]
    pub fn error_of_part(&self, error: &FieldError, is_pose_given: bool) -> Option<String> {
        let (given, unit) = (self.params.part.table_from_part.as_ref(), unit_text(self.unit));
        let size = PartSize::new(&self.mesh.aabb(), self.unit);
        let limits = SizeLimits::new(self.scanner, self.cell);
        let units =
            || size.other_units(&limits).map_or_else(String::new, |units| format!("; it would fit if the file is in {units}"));
        let FieldError { pointer, detail } = error;
        match pointer.as_str() {
            "/part" => Some(format!("{detail} (read in {unit}{})", units())),
            "/part/table_from_part" if !is_pose_given => {
                let hint = if size.warnings(given, &limits, "").is_empty() { String::new() } else { units() };
                let read = size_text(&size.size_mm);
                let lies = "in the middle of the plate, as part.table_from_part is not given, that";
                Some(format!("is {read} as read in {unit}; {lies} {detail}{hint}"))
            }
            _ => None,
        }
    }

    /// Renders every file, of the reports these; programs in the robot's own language and in the neutral ones alone.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub fn render(&self, outcome: &Outcome, reports: Reports, ctx: &Context<'_>) -> Result<Vec<Artifact>, Cancelled> {
        self.artifacts(outcome, ForeignPrograms::LeftOut, Rendered::Whole(reports), ctx)
    }

    /// Stage report: every file.
    fn artifacts(
        &self,
        outcome: &Outcome,
        foreign: ForeignPrograms,
        reports: Rendered,
        ctx: &Context<'_>,
    ) -> Result<Vec<Artifact>, Cancelled> {
        ctx.stage(Stage::Report, || {
            let written = self.written_plan(outcome, ctx)?;
            let plan_sha256 = written.sha256.clone();
            let programs = self.programs(&outcome.plan, &plan_sha256);
            let programs = self.in_dialects(outcome, &programs, foreign);
            let summary = self.summary(&outcome.plan, &written, &programs);
            let mut refused = Refused::new();
            let mut files = self.tables_and_reports(outcome, written, &summary, reports, ctx)?;
            self.sort_programs(programs, &mut files, &mut refused);
            match candidates::file_bytes(outcome, self.mesh, &plan_sha256, ctx) {
                Some(Ok(bytes)) => files.push((CANDIDATES_FILE.into(), bytes)),
                Some(Err(ListingError::Cancelled(cancelled))) => return Err(cancelled),
                Some(Err(reason)) => drop(refused.insert(CANDIDATES_FILE.to_owned(), reason.to_string())),
                None => {}
            }
            if !refused.is_empty() {
                files.push((REFUSED_FILE.into(), json_file_bytes(&refused)));
            }
            Ok(files.into_iter().map(|(name, bytes)| Artifact { name, bytes }).collect())
        })
    }

    /// The plan as it is written, with what its warnings come to.
    fn written_plan(&self, outcome: &Outcome, ctx: &Context<'_>) -> Result<WrittenPlan, Cancelled> {
        let size_warnings = self.size_warnings("/part/bbox_mm");
        let document = self.document(outcome, &size_warnings, ctx)?;
        let mut warnings = at_head_of_reports(&document.warnings);
        warnings.retain(|warning| !size_warnings.contains(warning));
        let unstable_setups = document.warnings.iter().filter(|warning| warning.code == WarningCode::PartUnstable).count();
        let standing = self.standing_remedy(outcome, &document.warnings);
        let bytes = document.to_bytes();
        Ok(WrittenPlan { sha256: plan_sha256(&bytes), bytes, size_warnings, warnings, unstable_setups, standing })
    }

    /// Summary of a plan, with its programs and with what casts doubt on it.
    fn summary(&self, plan: &Plan, written: &WrittenPlan, programs: &RenderedPrograms<'_>) -> Summary {
        let unit_question = self.unit_question();
        let doubts = PlanDoubts {
            unit_question: unit_question.as_deref(),
            unstable_setups: written.unstable_setups,
            standing: written.standing.as_ref(),
            warnings: &written.warnings,
        };
        let summary = Summary::of(plan).with_calibration(self.cell.and_then(|cell| cell.calibrated.as_ref()));
        self.with_program(summary, programs).with_doubts(&doubts).of_file(written.sha256.clone())
    }

    /// Summary, plan, tables and reports.
    fn tables_and_reports(
        &self,
        outcome: &Outcome,
        written: WrittenPlan,
        summary: &Summary,
        reports: Rendered,
        ctx: &Context<'_>,
    ) -> Result<Files, Cancelled> {
        let (plan, WrittenPlan { bytes, sha256, size_warnings, warnings, .. }) = (&outcome.plan, written);
        let stop = || ctx.check().is_err();
        let subject = self.subject(&size_warnings);
        let report = ReportInput { subject, outcome, plan_sha256: &sha256, summary, warnings: &warnings };
        let tables = || -> Files {
            vec![
                (SUMMARY_FILE.into(), json_file_bytes(summary)),
                (PLAN_FILE.into(), bytes),
                ("viewpoints.json".into(), json_file_bytes(&viewpoints::json(plan, &sha256))),
                ("viewpoints.csv".into(), viewpoints::csv(plan, &sha256).into_bytes()),
                ("coverage.json".into(), json_file_bytes(&coverage::json(outcome, self.mesh, &sha256))),
                ("coverage.csv".into(), coverage::csv(outcome, self.mesh, &sha256).into_bytes()),
            ]
        };
        let preview = || geometry::preview(self.mesh, PREVIEW_TRIANGLES, &Poll::new(&stop)).map_err(Cancelled::from);
        let (preview, mut files) = rayon::join(preview, tables);
        let preview = preview?;
        let words = report_text(plan, summary, &size_warnings, &warnings);
        let bin = || coverage::bin(outcome, &preview);
        let (bin, reports) = rayon::join(bin, || report_files(&report, words, reports, &preview, ctx));
        files.push(("coverage.bin".into(), bin));
        files.push(("missed.json".into(), json_file_bytes(&missed::json(plan, &sha256))));
        files.extend(reports?);
        files.extend(regions::csv(plan, &sha256).map(|table| (REGIONS_FILE.into(), table.into_bytes())));
        Ok(files)
    }

    /// Adds the programs, each in every language, and the reasons why some are missing or refused.
    fn sort_programs(&self, programs: RenderedPrograms<'_>, files: &mut Files, refused: &mut Refused) {
        for (program, rendered) in programs.programs.iter().zip(programs.rendered) {
            let bytes = ProgramDocument::new(program, self.echo.clone()).to_bytes();
            files.push((format!("{}.json", program_stem(program.setup)).into(), bytes));
            rendered.into_iter().for_each(|program| program.sort_into(files, refused));
        }
    }

    /// The plan as it is written, with every warning on it.
    fn document(&self, outcome: &Outcome, size_warnings: &[FieldWarning], ctx: &Context<'_>) -> Result<PlanDocument, Cancelled> {
        let stop = || ctx.check().is_err();
        let mut document = PlanDocument::new(outcome, self.scanner, self.cell_document(outcome), self.echo.clone());
        document.fixture = self.fixture.zip(self.fixture_sha256).map(|(fixture, sha256)| FixtureDocument::new(fixture, sha256));
        document.warnings.extend(size_warnings.iter().cloned());
        document.warnings.extend(self.empty_region_warnings(outcome, "/params"));
        document.warnings.extend(self.standing_warnings(outcome, "/params", &Poll::new(&stop))?);
        document.warnings.extend(self.fixture_warning(outcome, "/params"));
        document.warnings.extend(self.home_warnings(outcome, "/cell"));
        document.warnings.extend(self.cell.map_or_else(Vec::new, |cell| of_sight(cell, "/cell")));
        document.warnings = by_cause(document.warnings);
        Ok(document)
    }

    /// Renders the report of a job that has no plan.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub fn render_no_plan(
        &self,
        reason: NoPlanReason<'_>,
        reports: Reports,
        ctx: &Context<'_>,
    ) -> Result<Vec<Artifact>, Cancelled> {
        ctx.stage(Stage::Report, || {
            let size_warnings = self.size_warnings("/part/bbox_mm");
            let input = NoPlanInput { subject: self.subject(&size_warnings), params: self.params, reason };
            let mut files = Vec::new();
            if reports != Reports::None {
                files.push((TEXT_REPORT_FILE, warned(&size_warnings) + &no_plan_text(&input)));
            }
            if reports == Reports::Html {
                files.push((REPORT_FILE, html::render_no_plan(&input, ctx)?));
            }
            Ok(files.into_iter().map(|(name, text)| Artifact { name: name.into(), bytes: text.into_bytes() }).collect())
        })
    }

    fn subject<'a>(&'a self, size_warnings: &'a [FieldWarning]) -> ReportSubject<'a> {
        ReportSubject {
            mesh: self.mesh,
            fixture: self.fixture,
            part_sha256: self.part_sha256,
            part_name: &self.part_name,
            scanner: self.scanner,
            cell: self.cell,
            echo: &self.echo,
            date: self.date.as_deref(),
            size_warnings,
        }
    }

    /// Robot program of each setup, if there is a cell. Each names its plan.
    fn programs(&self, plan: &Plan, plan_sha256: &str) -> Vec<Program> {
        let Some(cell) = self.cell else { return Vec::new() };
        let compiled = |(setup, sequence)| compile_views(sequence, setup, cell, plan_sha256, &plan.params, &plan.views);
        plan.sequences().enumerate().map(compiled).collect()
    }

    /// The program of a setup as the linter finds it in the scene that it was planned in, or its findings.
    fn checked<'p>(&'p self, outcome: &Outcome, program: &'p Program) -> CheckedOrFindings<'p> {
        let plan = &outcome.plan;
        let (Some(cell), Some(setup)) = (self.cell, plan.setups.get(program.setup)) else { return Err(String::new()) };
        let Some(scene) = outcome.scenes.get(program.setup) else { return Err(String::new()) };
        let visited = plan.views.iter().filter(|view| view.setup.index() == program.setup && view.station.is_some());
        let expected = Expected {
            plan_sha256: program.plan_sha256.clone(),
            table_from_part: setup.table_from_part,
            table_alone: plan.params.motion.table == TableMotion::Alone,
            views: visited.map(|view| (view.id, view.part_from_scanner)).collect(),
        };
        let checked = CheckedProgram::new(program, cell, scene, Some(&expected), CheckedWith::Part);
        checked.map_err(|findings| findings.iter().map(ToString::to_string).collect::<Vec<_>>().join("; "))
    }

    /// The summary with the cycle of the programs in the robot's own dialect, or with the reason why one of them was refused.
    fn with_program(&self, summary: Summary, programs: &RenderedPrograms<'_>) -> Summary {
        let Some(dialect) = self.cell.and_then(|cell| cell.robot.dialect) else { return summary };
        let own = own_cycle((dialect, &self.params.dialects), programs.programs, &programs.checked, &programs.rendered);
        match own.map(|cycle| cycle.map(|cycle| cycle.beside_corners(self.params.motion.corners))) {
            Ok(program_cycle) if self.rescan.is_some() => summary.with_program(program_cycle.map(ProgramCycle::without_options)),
            Ok(program_cycle) => summary.with_program(program_cycle),
            Err(reason) => summary.with_refused_program(dialect, &reason, REFUSED_FILE),
        }
    }

    /// Programs as the linter finds them, in the dialects that the robot takes, or in every one.
    fn in_dialects<'p>(&'p self, outcome: &Outcome, programs: &'p [Program], foreign: ForeignPrograms) -> RenderedPrograms<'p> {
        let checked: Vec<_> = programs.iter().map(|program| self.checked(outcome, program)).collect();
        let rendered = |(program, checked): (&Program, &CheckedOrFindings<'_>)| {
            self.dialects(program, checked, foreign, &outcome.plan.params.dialects)
        };
        let rendered = programs.iter().zip(&checked).map(rendered).collect();
        RenderedPrograms { programs, checked, rendered }
    }

    /// The program in the dialects that the robot takes, or in every one.
    fn dialects(
        &self,
        program: &Program,
        checked: &CheckedOrFindings<'_>,
        foreign: ForeignPrograms,
        params: &DialectParams,
    ) -> Vec<DialectProgram> {
        let Some(cell) = self.cell else { return Vec::new() };
        let wanted = |dialect: &Dialect| foreign == ForeignPrograms::Kept || cell.robot.takes(*dialect);
        let rendered = |dialect| in_dialect(checked.as_ref(), dialect, &program_stem(program.setup), params);
        Dialect::ALL.into_iter().filter(wanted).flat_map(rendered).collect()
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
            calibrated: cell.calibrated.clone(),
        })
    }
}

/// Cycle of the programs in the robot's own dialect; `None` if there are none.
///
/// # Errors
/// Reason why one of them was refused.
fn own_cycle(
    (dialect, params): (Dialect, &DialectParams),
    programs: &[Program],
    checked: &[CheckedOrFindings<'_>],
    rendered: &[Vec<DialectProgram>],
) -> Result<Option<ProgramCycle>, String> {
    let mut own = rendered.iter().flatten().filter(|program| program.dialect == dialect);
    if let Some(reason) = own.find_map(|program| program.text.as_ref().err()) {
        return Err(reason.clone());
    }
    let moves_in_turn = checked.iter().flatten().any(|program| program.moves_in_turn(dialect));
    let secs = |checked: &CheckedOrFindings<'_>| checked.as_ref().ok()?.cycle_secs(dialect).ok();
    let cycle_secs = checked.iter().map(secs).sum::<Option<f64>>().filter(|_| !checked.is_empty());
    let stems: Vec<(usize, String)> = programs.iter().map(|program| (program.setup, program_stem(program.setup))).collect();
    let work = [dialect.renaming_of(params, &stems), dialect.before_first_run_of(programs)];
    let work = work.into_iter().flatten().reduce(|first, next| format!("{first}; and {next}"));
    Ok(cycle_secs.map(|secs| ProgramCycle::new(dialect, secs, moves_in_turn, work)))
}

/// The report of a plan in plain text, after the warnings on the part's size.
fn report_text(plan: &Plan, summary: &Summary, size_warnings: &[FieldWarning], warnings: &[FieldWarning]) -> String {
    let sha256 = summary.plan_sha256.as_deref().unwrap_or_default();
    format!("{}{}plan {sha256}\n", warned(size_warnings), text_with_warnings(plan, summary, warnings))
}

/// The reports of a plan.
fn report_files(
    report: &ReportInput<'_>,
    words: String,
    reports: Rendered,
    preview: &Preview,
    ctx: &Context<'_>,
) -> Result<Files, Cancelled> {
    let in_text = || (TEXT_REPORT_FILE.into(), words.into_bytes());
    let draft = || html::draft(report, Some(preview), ctx);
    Ok(match reports {
        Rendered::Whole(Reports::None) => Vec::new(),
        Rendered::Whole(Reports::Text) => vec![in_text()],
        Rendered::Whole(Reports::Html) => vec![in_text(), (REPORT_FILE.into(), draft()?.draw(ctx)?.into_bytes())],
        Rendered::Draft => vec![in_text(), (REPORT_DRAFT_FILE.into(), draft()?.to_bytes())],
    })
}

/// Draws the report of a draft, of the bytes of [`REPORT_DRAFT_FILE`]; `None` if this version cannot read it.
///
/// # Errors
/// [`Cancelled`].
pub fn drawn_report(draft: &[u8], ctx: &Context<'_>) -> Result<Option<Artifact>, Cancelled> {
    let Ok(draft) = html::Draft::from_bytes(draft) else { return Ok(None) };
    Ok(Some(Artifact { name: REPORT_FILE.into(), bytes: draft.draw(ctx)?.into_bytes() }))
}

/// SHA-256 of the bytes of `plan.json`, lower-case hexadecimal: the name of a plan in everything that is derived from it.
#[must_use]
pub fn plan_sha256(bytes: &[u8]) -> String {
    hex(&Sha256::digest(bytes))
}

#[cfg(test)]
mod tests;
