//! Inspection of scans against a plan, with all result files: shared by the server and the command line.

use std::fs::File;
use std::io::{self, BufReader, Seek as _};
use std::path::PathBuf;

use rayon::prelude::*;

use super::cells::KeptCells;
use super::error::is_transient_io;
use super::hashing_reader::HashingReader;
use super::plan_job::{Artifact, plan_sha256};
use super::planner::{JobError, JobInput, opened, read_error, read_with_retry};
use super::rescan_job::RESCAN_STATE_FILE;
use crate::cell::{Cell, FieldError, PoseSpec, Scanner};
use crate::check::read_plan;
use crate::geometry::cloud_io::{self, CloudError, CloudLimits, StoredCloud};
use crate::geometry::{LengthUnit, Mesh, NearestFace, Part, Poll, Pose, Table, plate_from_placed, table_from_plate};
use crate::inspection::ingest::{IngestOptions, IngestWorld, PlannedCapture, ScanFile, ScanFrame, ingest};
use crate::inspection::{InspectedView, InspectionInput, InspectionParams, inspect};
use crate::planning::context::{Context, PlanError};
use crate::planning::visibility::SampleSet;
use crate::report::html::{InspectionReport, ReportSubject, inspection_html};
use crate::report::inspection_text;
use crate::wire::inspection::{
    InspectedFiles, InspectionDocument, InspectionSummary, LearnedDocument, LossListing, RescanState, coverage_csv,
    deviation_csv, deviation_ply,
};
use crate::wire::json_file_bytes;
use crate::wire::plan::PlanDocument;
use crate::wire::run::{RunRecordDocument, RunStepOp, RunStepRecord};

/// The result of an inspection.
pub const INSPECTION_FILE: &str = "inspection.json";
/// Every loss with every spot.
pub const LOSSES_FILE: &str = "losses.json";
/// Findings about the scanner.
pub const LEARNED_FILE: &str = "learned.json";
/// Planned and measured area of every face.
pub const MEASURED_FILE: &str = "coverage.csv";
/// Deviation of every face.
pub const DEVIATION_FILE: &str = "deviation.csv";
/// Measured surface in the colours of its deviation.
pub const DEVIATION_CLOUD_FILE: &str = "deviation.ply";
/// The report, a page.
pub const INSPECTION_REPORT_FILE: &str = "inspection.html";
/// The report as text.
pub const INSPECTION_TEXT_FILE: &str = "inspection.txt";

/// Files of every inspection.
pub const INSPECTION_FILES: [&str; 9] = [
    INSPECTION_FILE,
    LOSSES_FILE,
    LEARNED_FILE,
    MEASURED_FILE,
    DEVIATION_FILE,
    DEVIATION_CLOUD_FILE,
    INSPECTION_REPORT_FILE,
    INSPECTION_TEXT_FILE,
    RESCAN_STATE_FILE,
];

/// Name of the cloud in a scan that was uploaded without a name.
const UNNAMED: &str = "unnamed";

/// A file of a scan.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ScanSource {
    /// Path of the file.
    pub path: PathBuf,
    /// SHA-256 of the file, lower-case hexadecimal; empty where it is not known.
    pub sha256: String,
    /// Name of the file, as people know it.
    pub name: String,
    /// False if its name is its id, which tells nothing of the view.
    pub is_named: bool,
    /// Viewpoint of the plan, if it is declared.
    pub view: Option<u32>,
    /// Unit of the coordinates, if it is declared.
    pub unit: Option<String>,
    /// Frame of the coordinates, if it is declared.
    pub frame: Option<ScanFrame>,
}

impl ScanSource {
    /// Reads the clouds of the file, which stands at `pointer` in the list of scans. A stored file that is temporarily unreadable is tried
    /// again as [`read_with_retry`] does.
    fn read(&self, pointer: &str, ctx: &Context<'_>) -> Result<Vec<ScanFile>, InspectError> {
        let read = || self.read_once(pointer, ctx);
        let clouds = if self.sha256.is_empty() { read() } else { read_with_retry(read, &|| ctx.check().is_err()) };
        Ok(clouds?)
    }

    /// Reads the clouds of the file, once its bytes have been compared with its hash: readers of clouds go back and forth in it.
    fn read_once(&self, pointer: &str, ctx: &Context<'_>) -> Result<Vec<ScanFile>, JobError> {
        let stop = || ctx.check().is_err();
        let poll = Poll::new(&stop);
        let refused =
            |error: &dyn std::fmt::Display| JobError::BadInput(vec![refusal(pointer, format!("{}: {error}", self.name))]);
        let unread = |error: io::Error| read_error(&self.name, &error);
        let mut file = File::open(&self.path).map_err(unread)?;
        if !self.sha256.is_empty() {
            let sha256 = HashingReader::new(&file).finish(&poll).map_err(unread)?.ok_or(JobError::Cancelled)?;
            if sha256 != self.sha256 {
                let reason = "is damaged; upload the same file again and start another inspection";
                return Err(JobError::Damaged(format!("the stored file of scan {} {reason}", self.name)));
            }
            file.rewind().map_err(unread)?;
        }
        let clouds = cloud_io::read_from(&mut BufReader::new(file), &CloudLimits::default(), &poll);
        ctx.check().map_err(PlanError::from)?;
        let clouds = match clouds {
            Err(CloudError::Io(error)) if is_transient_io(&error) => return Err(unread(error)),
            clouds => clouds.map_err(|error| refused(&error))?,
        };
        let declared = self.unit.as_deref().map(str::parse::<LengthUnit>).transpose();
        let unit = declared.map_err(|error| refused(&error))?.or(clouds.unit);
        let of_cloud = |mut cloud: StoredCloud| {
            // The view is the number in a name, and the digits of an id would be taken for one.
            if !self.is_named && self.view.is_none() {
                cloud.name.get_or_insert_with(|| UNNAMED.to_owned());
            }
            ScanFile { file: self.name.clone(), cloud, unit, frame: self.frame, viewpoint: self.view }
        };
        Ok(clouds.clouds.into_iter().map(of_cloud).collect())
    }
}

/// Reasons why an inspection has no result.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum InspectError {
    /// The inspection was cancelled.
    #[error("cancelled")]
    Cancelled,
    /// Files or parameters that cannot be used.
    #[error("{}", .0.iter().map(ToString::to_string).collect::<Vec<_>>().join("; "))]
    Refused(Vec<FieldError>),
    /// A file is missing or damaged.
    #[error("{0}")]
    Damaged(String),
}

impl From<PlanError> for InspectError {
    fn from(error: PlanError) -> Self {
        match error {
            PlanError::Cancelled => Self::Cancelled,
            PlanError::BadParams(errors) => Self::Refused(errors.into_iter().map(|error| error.below("/params")).collect()),
            PlanError::NoPlan(_) => Self::Refused(vec![refusal("", "has no plan to inspect".to_owned())]),
        }
    }
}

impl From<JobError> for InspectError {
    fn from(error: JobError) -> Self {
        match error {
            JobError::Cancelled => Self::Cancelled,
            JobError::BadInput(errors) | JobError::PartRefused { errors, .. } => Self::Refused(errors),
            error @ (JobError::NoPlan { .. } | JobError::Damaged(_) | JobError::Unread(_) | JobError::Unavailable(_)) => {
                Self::Damaged(error.to_string())
            }
        }
    }
}

fn refusal(pointer: &str, detail: String) -> FieldError {
    FieldError { pointer: pointer.to_owned(), detail }
}

/// Scans and the plan that they are held against.
#[derive(Clone, Debug)]
pub struct InspectJob {
    /// Bytes of `plan.json`.
    pub plan: Vec<u8>,
    /// Files of the scans.
    pub scans: Vec<ScanSource>,
    /// Parameters.
    pub params: InspectionParams,
    /// Record of the run in which they were taken, whose measured poses then count.
    pub record: Option<RunRecordDocument>,
    /// State after the round before, whose surface stays measured.
    pub before: Option<RescanState>,
    /// Date of the inspection in UTC, RFC 3339; the report says it.
    pub date: Option<String>,
}

/// Part and hardware of an inspection.
#[derive(Clone, Copy)]
pub struct InspectedPart<'a> {
    /// The part as it was to be.
    pub mesh: &'a Mesh,
    /// Fixture that holds it.
    pub fixture: Option<&'a Mesh>,
    /// Name of the part in reports.
    pub name: &'a str,
    /// The scanner of the plan.
    pub scanner: &'a Scanner,
    /// The cell of the plan.
    pub cell: Option<&'a Cell>,
}

/// Result of an inspection.
#[derive(Clone, Debug)]
pub struct Inspected {
    /// The result itself.
    pub document: InspectionDocument,
    /// Figures for a list.
    pub summary: InspectionSummary,
    /// All files.
    pub files: Vec<Artifact>,
}

impl InspectJob {
    /// Samples that the round before measured, of so many of a plan.
    fn measured_before(&self, plan: &PlanDocument, samples: usize) -> Result<Option<SampleSet>, InspectError> {
        let Some(before) = &self.before else { return Ok(None) };
        let checked = before.check_samples(samples).and_then(|()| before.check_sampling(&plan.params));
        let measured = checked.and_then(|()| before.measured());
        measured.map(Some).map_err(|error| InspectError::Refused(vec![error]))
    }

    /// Inspects the part of a job; `progress` is told the share done.
    ///
    /// # Errors
    /// [`InspectError`].
    pub fn execute(
        &self,
        input: &JobInput,
        cells: &KeptCells,
        progress: &dyn Fn(f64),
        ctx: &Context<'_>,
    ) -> Result<Inspected, InspectError> {
        let (meshes, hardware) = opened(input, cells, &|| ctx.check().is_err())?;
        let part = InspectedPart {
            mesh: &meshes.mesh,
            fixture: meshes.fixture.as_ref(),
            name: &input.part_name,
            scanner: hardware.scanner(),
            cell: hardware.cell(),
        };
        self.inspect_planned(&part, input.accepted_at.as_deref(), progress, ctx)
    }

    /// Reads the scans, inspects the part and renders every file; `progress` is told the share done.
    ///
    /// # Errors
    /// [`InspectError`].
    pub fn inspect(
        &self,
        part: &InspectedPart<'_>,
        progress: &dyn Fn(f64),
        ctx: &Context<'_>,
    ) -> Result<Inspected, InspectError> {
        self.inspect_planned(part, None, progress, ctx)
    }

    /// Inspects a part whose plan is of a job that was accepted at `planned_at`, RFC 3339, where that is known.
    fn inspect_planned(
        &self,
        part: &InspectedPart<'_>,
        planned_at: Option<&str>,
        progress: &dyn Fn(f64),
        ctx: &Context<'_>,
    ) -> Result<Inspected, InspectError> {
        let plan = serde_json::from_slice(&self.plan).map_err(|error| InspectError::Damaged(format!("plan.json: {error}")))?;
        let plan: PlanDocument = read_plan(plan).map_err(InspectError::Refused)?;
        part.check(&plan).map_err(InspectError::Refused)?;
        let PlannedViews { setups, views } = PlannedViews::new(&plan, self.record.as_ref(), part.cell);
        if views.is_empty() {
            return Err(InspectError::Refused(vec![refusal("/viewpoints", "has no view to inspect".to_owned())]));
        }
        let files = self.read(ctx)?;
        progress(0.1);
        let captures: Vec<PlannedCapture> = views.iter().map(|view| capture(view, part, &setups)).collect();
        let nearest = NearestFace::new(part.mesh);
        let fixtures = fixtures_on_plate(part, &setups);
        let world = IngestWorld { scanner: part.scanner, nearest: &nearest, captures: &captures, fixtures: &fixtures };
        let mut taken = ingest(files, &world, &IngestOptions::default(), ctx).map_err(PlanError::from)?;
        if taken.scans.is_empty() {
            return Err(InspectError::Refused(InspectedFiles::new(&taken).refusals()));
        }
        taken.note_planned_poses(self.record.as_ref().map_or_else(Vec::new, |record| viewpoints_without_scan(&plan, record)));
        progress(0.2);
        let input = InspectionInput {
            part: part.mesh,
            fixture: part.fixture,
            scanner: part.scanner,
            cell: part.cell,
            plan_params: &plan.params,
            setups: &setups,
            views: &views,
            // The plan of a rescan knows what is coverable of the rest alone.
            coverable_mm2: self.before.is_none().then_some(plan.coverage.coverable_area_mm2),
            taken: &taken,
            nearest: &nearest,
            params: &self.params,
        };
        let inspection = inspect(&input, &|share| progress(0.2 + 0.7 * share), ctx)?;
        let before = self.measured_before(&plan, inspection.surface.sample_mm.len())?;
        let plan_sha256 = plan_sha256(&self.plan);
        let state = RescanState::new(&inspection, &plan, &plan_sha256, self.before.as_ref());
        let taken = InspectedFiles::new(&taken);
        let document = InspectionDocument::new(&inspection, &taken, &self.params, part.mesh, (&plan_sha256, &state));
        let learned = LearnedDocument::new(inspection.learned.as_ref(), &inspection.offer, &plan_sha256);
        let report = InspectionReport {
            subject: ReportSubject { date: self.date.as_deref(), ..part.subject(&plan) },
            planned_at,
            run_at: self.record.as_ref().map(|record| record.run.created_at.as_str()),
            inspection: &inspection,
            document: &document,
            learned: &learned,
            before: before.as_ref(),
            table_from_part: setups[0],
        };
        let mut files = files_of(&report, &plan_sha256, ctx)?;
        files.push(Artifact { name: RESCAN_STATE_FILE.into(), bytes: json_file_bytes(&state) });
        progress(1.0);
        Ok(Inspected { summary: document.summary(), document, files })
    }

    /// Reads the files of the scans.
    fn read(&self, ctx: &Context<'_>) -> Result<Vec<ScanFile>, InspectError> {
        let read: Vec<Result<Vec<ScanFile>, InspectError>> =
            self.scans.par_iter().enumerate().map(|(index, source)| source.read(&format!("/scans/{index}"), ctx)).collect();
        Ok(read.into_iter().collect::<Result<Vec<_>, _>>()?.into_iter().flatten().collect())
    }
}

/// Views of a plan that were to be taken, and the poses of the part in its setups.
#[derive(Clone, Debug)]
pub struct PlannedViews {
    /// Pose of the part in each setup; without a cell that of the mesh's own coordinates.
    pub setups: Vec<Pose<Table, Part>>,
    /// The views.
    pub views: Vec<InspectedView>,
}

impl PlannedViews {
    /// Views of a plan, at the poses of a run if there is a record of one.
    #[must_use]
    pub fn new(plan: &PlanDocument, record: Option<&RunRecordDocument>, cell: Option<&Cell>) -> Self {
        let setups = setups_of(plan);
        let setup_of = |id: u32| plan.setups.iter().position(|setup| setup.viewpoints.contains(&id)).unwrap_or_default();
        let taken = plan.viewpoints.iter().filter(|view| view.rejected.is_none());
        let views = taken.map(|view| {
            let mut planned = InspectedView {
                viewpoint: view.id,
                setup: setup_of(view.id),
                part_from_scanner: view.part_from_scanner.pose(),
                table_rad: view.station.as_ref().map(|station| station.table_angle_deg.to_radians()),
            };
            let step = record.and_then(|record| scan_of(&record.steps, view.id));
            if let (Some(step), Some(cell)) = (step, cell) {
                let configuration = step.measured.configuration();
                let part_from_plate = plate_from_placed(&setups[planned.setup]).inverse();
                planned.part_from_scanner = part_from_plate * cell.plate_from_scanner(&configuration);
                planned.table_rad = Some(configuration.table_rad);
            }
            planned
        });
        Self { views: views.collect(), setups }
    }
}

/// Viewpoints of a plan that a run was to scan and did not: nobody knows where their scans were taken from.
#[must_use]
pub fn viewpoints_without_scan(plan: &PlanDocument, record: &RunRecordDocument) -> Vec<u32> {
    let taken = plan.viewpoints.iter().filter(|view| view.rejected.is_none());
    taken.map(|view| view.id).filter(|id| scan_of(&record.steps, *id).is_none()).collect()
}

/// Step of a run that scanned a viewpoint; not the capture before it by which the part was located, from elsewhere.
fn scan_of(steps: &[RunStepRecord], viewpoint: u32) -> Option<&RunStepRecord> {
    steps.iter().find(|step| step.op == RunStepOp::Scan && step.viewpoint == Some(viewpoint))
}

impl InspectedPart<'_> {
    /// Refuses part, fixture and hardware that the plan was not made with.
    ///
    /// # Errors
    /// Every difference from the plan.
    pub fn check(&self, plan: &PlanDocument) -> Result<(), Vec<FieldError>> {
        let mut errors = Vec::new();
        if plan.scanner.name != self.scanner.name {
            let detail = format!("is {:?}; the plan was made with {:?}", self.scanner.name, plan.scanner.name);
            errors.push(refusal("/scanner", detail));
        }
        let other_cell = plan.cell.as_ref().zip(self.cell).filter(|(planned, cell)| planned.name != cell.name);
        if let Some((planned, cell)) = other_cell {
            errors.push(refusal("/cell", format!("is {:?}; the plan was made in {:?}", cell.name, planned.name)));
        }
        if plan.part.triangles != self.mesh.faces.len() {
            let detail = format!("has {} triangles; the planned part has {}", self.mesh.faces.len(), plan.part.triangles);
            errors.push(refusal("/mesh", detail));
        } else {
            let other = plan.part.other_size(self.mesh);
            errors.extend(other.map(|other| refusal("/mesh", format!("{other}; give the unit that it was planned in"))));
        }
        errors.extend(self.other_fixture(plan).map(|detail| refusal("/fixture", detail)));
        if errors.is_empty() { Ok(()) } else { Err(errors) }
    }

    /// Difference of the fixture from the plan's, in words; of its file this knows the size alone.
    fn other_fixture(&self, plan: &PlanDocument) -> Option<String> {
        match (self.fixture, &plan.fixture) {
            (Some(fixture), Some(planned)) => planned.other_size(fixture),
            (Some(_), None) => (!plan.has_fixture()).then(|| "is given; the plan was made without one, leave it out".to_owned()),
            (None, _) => plan.has_fixture().then(|| "is not given; give the one that the plan was made with".to_owned()),
        }
    }

    /// Subject of the report: the part, and what it was planned for.
    fn subject<'s>(&'s self, plan: &'s PlanDocument) -> ReportSubject<'s> {
        ReportSubject {
            mesh: self.mesh,
            fixture: self.fixture,
            part_sha256: &plan.part.sha256,
            part_name: self.name,
            scanner: self.scanner,
            cell: self.cell,
            echo: &plan.echo,
            date: None,
            size_warnings: &[],
        }
    }
}

/// Pose of the part in each setup; without a cell, that of the mesh's own coordinates.
fn setups_of(plan: &PlanDocument) -> Vec<Pose<Table, Part>> {
    let poses = plan.setups.iter().map(|setup| &setup.table_from_part);
    let of_cell = plan.cell.iter().map(|cell| &cell.table_from_part).filter(|_| plan.setups.is_empty());
    let mut poses: Vec<_> = poses.chain(of_cell).map(PoseSpec::pose).collect();
    if poses.is_empty() {
        poses.push(Pose::identity());
    }
    poses
}

/// The fixture on the plate; none where the part lies on it in several ways.
fn fixtures_on_plate(part: &InspectedPart<'_>, setups: &[Pose<Table, Part>]) -> Vec<Mesh> {
    let placed = |fixture: &Mesh, table_from_part: &Pose<Table, Part>| {
        let plate_from_part = plate_from_placed(table_from_part);
        let mut fixture = fixture.clone();
        fixture.vertices_mm.iter_mut().for_each(|vertex| *vertex = plate_from_part.point(vertex));
        fixture
    };
    match (part.fixture, setups) {
        (Some(fixture), [table_from_part]) => vec![placed(fixture, table_from_part)],
        _ => Vec::new(),
    }
}

/// Poses that tie frames to a view.
fn capture(view: &InspectedView, part: &InspectedPart<'_>, setups: &[Pose<Table, Part>]) -> PlannedCapture {
    let mut capture = PlannedCapture::at(view.viewpoint, view.part_from_scanner);
    capture.scanner_from_cloud = part.scanner.cloud_frame.map(|frame| frame.scanner_from_cloud(&part.scanner.devices));
    if let (Some(cell), Some(table_rad)) = (part.cell, view.table_rad) {
        let part_from_plate = plate_from_placed(&setups[view.setup]).inverse();
        let part_from_table = part_from_plate * table_from_plate(table_rad).inverse();
        capture.part_from_plate = Some(part_from_plate);
        capture.part_from_table = Some(part_from_table);
        capture.part_from_base = Some(part_from_table * cell.base_from_table.inverse());
    }
    capture
}

fn files_of(report: &InspectionReport<'_>, plan_sha256: &str, ctx: &Context<'_>) -> Result<Vec<Artifact>, InspectError> {
    let InspectionReport { subject: ReportSubject { mesh, part_name, .. }, inspection, document, learned, .. } = *report;
    let losses = LossListing::new(&inspection.losses, &inspection.coverage, plan_sha256);
    let page = inspection_html(report, ctx).map_err(PlanError::from)?;
    let files = [
        (INSPECTION_FILE, json_file_bytes(document)),
        (LOSSES_FILE, json_file_bytes(&losses)),
        (LEARNED_FILE, json_file_bytes(learned)),
        (MEASURED_FILE, coverage_csv(inspection, mesh).into_bytes()),
        (DEVIATION_FILE, deviation_csv(inspection, mesh).into_bytes()),
        (DEVIATION_CLOUD_FILE, deviation_ply(inspection)),
        (INSPECTION_REPORT_FILE, page.into_bytes()),
        (INSPECTION_TEXT_FILE, inspection_text(document, part_name).into_bytes()),
    ];
    Ok(files.into_iter().map(|(name, bytes)| Artifact { name: name.into(), bytes }).collect())
}

#[cfg(test)]
mod tests;
