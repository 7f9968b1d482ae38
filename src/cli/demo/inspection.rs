//! The loop on the sample: scans of the run by the simulated scanner, held against the plan, and further views for what they lack.

use std::sync::atomic::AtomicBool;
use std::time::Duration;

use bytes::Bytes;

use super::TRIANGLES;
use crate::cell::{Presets, SpecLibrary};
use crate::cli::output;
use crate::geometry::demo_parts;
use crate::inspection::simulated_scanner::SimulationParams;
use crate::planning::context::{Context, Silent};
use crate::service::inspect_job::{InspectedPart, PlannedViews};
use crate::service::plan_job::{Artifact, PLAN_FILE, plan_sha256};
use crate::service::simulate_scans::{SimulatedScans, TRUTH_FILE};
use crate::service::{App, ScanUpload, Submission};
use crate::wire::inspection::{InspectionJob, InspectionRequest, RescanRequest};
use crate::wire::plan::PlanDocument;
use crate::wire::run::RunRecordDocument;
use crate::wire::words::counted;
use crate::wire::{JobId, JobState, RunId, parse};

/// Cell of the sample: that of a request which names none.
const CELL: &str = "e05-transcan";
/// Longest time that anything here takes.
const PATIENCE: Duration = Duration::from_secs(3600);

type Failure = Box<dyn std::error::Error + Send + Sync>;

/// A scanner as real ones are: little beyond some 65°, nothing in the corner of two walls, poses that are a little off.
fn scanner() -> SimulationParams {
    SimulationParams {
        step_px: 8,
        grazing_deg: vec![65.0, 80.0],
        concave_mm: 1.0,
        view_error_deg: 0.03,
        view_error_mm: 0.1,
        ..SimulationParams::default()
    }
}

/// Scans the sample as it was run, inspects it, and plans further views.
pub(super) async fn show(app: &App, job: JobId, run: RunId) -> Result<(), Failure> {
    let (plan, record) = (app.result(job, PLAN_FILE).await?.read().await?, app.run_record(run).await?);
    let scans = tokio::task::spawn_blocking(move || scan(&plan, &record)).await??;
    let count = scans.len();
    for scan in scans {
        let mut upload = app.receive(scan.bytes.len() as u64).await?;
        upload.write(Bytes::from(scan.bytes)).await?;
        let about = ScanUpload { name: Some(scan.name.into_owned()), ..ScanUpload::default() };
        app.add_scan(job, upload.finish(None).await?, about).await?;
    }
    let request = InspectionRequest { run_id: Some(run), ..InspectionRequest::default() };
    let inspection = app.submit_inspection(job, request, Submission::default()).await?;
    let inspection = app.inspection_when_ended(inspection.id, PATIENCE).await?;
    output::line(inspected(&inspection, count))?;
    if inspection.state != JobState::Succeeded {
        return Ok(());
    }
    let rescan = app.submit_rescan_of(inspection.id, RescanRequest::default(), Submission::default()).await?;
    let rescan = app.job_when_ended(rescan.id, PATIENCE).await?;
    let words = match (rescan.state, rescan.summary, rescan.problem) {
        (JobState::Succeeded, Some(summary), _) => {
            format!("Planned {} for the missing surface: job {}.", counted(summary.views, "further view"), rescan.id)
        }
        (_, _, problem) => problem.map_or_else(String::new, |problem| problem.detail),
    };
    Ok(output::line(words)?)
}

/// Scans of every view of a plan, as a run took them.
fn scan(plan: &[u8], record: &RunRecordDocument) -> Result<Vec<Artifact>, Failure> {
    let document: PlanDocument = parse(plan)?;
    let mesh = demo_parts::base(TRIANGLES)?;
    let spec = Presets.cell(CELL).map_err(|_| format!("there is no preset {CELL}"))?;
    let cell = spec.build(&Presets).map_err(|errors| format!("{errors:?}"))?;
    let part = InspectedPart { mesh: &mesh, fixture: None, name: "sample base", scanner: &cell.scanner, cell: Some(&cell) };
    let planned = PlannedViews::new(&document, Some(record), Some(&cell));
    let (sim, sha256) = (scanner(), plan_sha256(plan));
    let scans = SimulatedScans {
        part,
        as_built: &mesh,
        planned: &planned,
        plan_params: &document.params,
        plan_sha256: &sha256,
        sim: &sim,
    };
    let never = AtomicBool::new(false);
    let mut files = scans.files(&|_, _| (), &Context::new(&never, &Silent)).map_err(|_| "cancelled")?;
    files.retain(|file| file.name != TRUTH_FILE);
    Ok(files)
}

fn inspected(inspection: &InspectionJob, scans: usize) -> String {
    let Some(summary) = &inspection.summary else {
        let reason = inspection.problem.as_ref().map_or("", |problem| problem.detail.as_str());
        return format!("The scans could not be inspected: {reason}");
    };
    format!(
        "A simulated scanner took {scans} scans: they measure {:.1} % of the asked area, of {:.1} % planned. What was lost, and \
         why, is at /api/v1/inspections/{}/report.",
        100.0 * summary.measured_of_asked,
        100.0 * summary.planned_of_asked,
        inspection.id
    )
}
