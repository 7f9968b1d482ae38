//! Failpoints: each stage has one, each is documented and in the code. Beside them, the service that the tests of this room share.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use sha2::{Digest, Sha256};

use super::planner::{Artifact, JobInput, MeshSource};
use super::store::{NewJob, NewMesh, RESERVE};
use super::*;
use crate::cell::{CellSpec, Configuration, Named, Presets, SpecLibrary};
use crate::geometry::LengthUnit;
use crate::planning::context::{Context, Stage};
use crate::planning::params::PlanParams;
use crate::program::Program;
use crate::wire::echo::Echo;
use crate::wire::{JobId, JobRequest, MeshHealthReport};

/// A mesh that can be planned.
pub(super) const TRIANGLE: &str =
    "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 9 0 0\nvertex 0 9 0\nendloop\nendfacet\nendsolid a\n";
/// A file that fails with EIO: nothing lies at the first address of a process.
pub(super) const BAD_SECTOR: &str = "/proc/self/mem";

/// A program that does nothing, for runs of which only the document counts.
pub(super) fn no_steps() -> Program {
    Program {
        plan_sha256: String::new(),
        setup: 0,
        calibration: None,
        robot: String::new(),
        turntable: String::new(),
        home_rad: Configuration { joints_rad: [0.0; 6], table_rad: 0.0 },
        steps: Vec::new(),
        cycle_secs: 0.0,
    }
}

/// Options of a small service in a folder.
pub(super) fn options(data: &Path) -> Options {
    Options {
        data_dir: data.to_owned(),
        planning_threads: 2,
        concurrent_jobs: 1,
        max_attempts: 3,
        max_queued_jobs: 100,
        max_uploads: 4,
        max_upload_bytes: 1 << 20,
        max_triangles: 10_000,
        parse_limit: Duration::from_secs(60),
        parse_memory_bytes: 1 << 30,
        job_memory_bytes: 4 << 30,
        job_limit: None,
        event_retention_hours: 1,
        min_free_bytes: 0,
        min_free_share: 0.0,
        orphan_hours: 1,
        swept_hours: 1,
        scrub_hours: 0,
        retention: RetentionOptions {
            job_days: 0,
            jobs_per_part: 0,
            unused_mesh_days: 0,
            run_days: 0,
            max_disk_share: 0.0,
            hold_label: "hold".to_owned(),
        },
        execution: ExecutionOptions {
            live: false,
            cells: Vec::new(),
            lease_ttl: Duration::from_secs(2),
            heartbeat: Duration::from_millis(500),
            audit_dir: PathBuf::from(data).join("audit"),
            audit_file_bytes: 1 << 20,
            audit_files: 4,
            max_runs: 8,
        },
    }
}

/// A service in a folder of its own, whose plans have no files.
pub(super) async fn service() -> (App, tempfile::TempDir) {
    service_with(Vec::new()).await
}

/// A service in a folder of its own, whose plans have these files.
pub(super) async fn service_with(files: Vec<Artifact>) -> (App, tempfile::TempDir) {
    let folder = tempfile::tempdir().expect("a folder");
    let planner = Arc::new(move |_: &JobInput, _: &Context<'_>| Ok(files.clone()));
    (App::open_with(options(folder.path()), planner, None).await.expect("a service"), folder)
}

/// Lets no reserve be kept in a store's folder: a folder stands in its place.
pub(super) fn keep_no_reserve(data: &Path) {
    let reserve = data.join(RESERVE);
    while std::fs::create_dir(&reserve).is_err() {
        // There is none yet, or the service has just written it.
        let _ = std::fs::remove_file(&reserve);
    }
}

/// A service on a disk that never has its floor of free space.
pub(super) async fn service_below_the_floor() -> (App, tempfile::TempDir) {
    let folder = tempfile::tempdir().expect("a folder");
    let options = Options { min_free_bytes: u64::MAX, min_free_share: 1.0, ..options(folder.path()) };
    let planner = Arc::new(|_: &JobInput, _: &Context<'_>| Ok(Vec::new()));
    (App::open_with(options, planner, None).await.expect("a service"), folder)
}

/// A job without a cell, accepted as a request is, as it ended.
pub(super) async fn ended_job(app: &App) -> crate::wire::Job {
    ended_job_in(app, "none").await
}

/// A job in a cell, accepted as a request is, as it ended.
pub(super) async fn ended_job_in(app: &App, cell: &str) -> crate::wire::Job {
    let mut upload = app.receive(0).await.expect("room");
    upload.write(TRIANGLE.into()).await.expect("written");
    let about = MeshUpload { unit: LengthUnit::Millimetre, name: None };
    let mesh = app.add_mesh(upload.finish(None).await.expect("a file"), about).await.expect("a mesh").id;
    let request = JobRequest { cell: Named::Name(cell.to_owned()), ..JobRequest::new(mesh) };
    let id = app.submit(request, Submission::default()).await.expect("accepted").id;
    app.job_when_ended(id, Duration::from_secs(60)).await.expect("it")
}

/// Input of a job that reads [`TRIANGLE`] from `part`, and from `post` where its cell has a body of that mesh.
pub(super) fn job_input(part: &Path, cell: Option<CellSpec>, post: &Path) -> JobInput {
    JobInput {
        mesh: source(part),
        part_name: "part".into(),
        fixture: None,
        cell,
        scanner: Presets.scanner("transcan-c").expect("a preset"),
        body_meshes: [("post".to_owned(), source(post))].into(),
        max_triangles: 1000,
        params: PlanParams::default(),
        echo: Echo::default(),
        rescan: None,
        accepted_at: None,
    }
}

/// [`TRIANGLE`] in a file.
pub(super) fn source(path: &Path) -> MeshSource {
    let sha256 = crate::wire::hex(&Sha256::digest(TRIANGLE));
    MeshSource { path: path.to_owned(), sha256, unit: LengthUnit::Millimetre }
}

/// A job, in whatever state.
pub(super) async fn job(app: &App) -> JobId {
    let store = &app.0.store;
    let received = store.files().write(b"one").expect("a file");
    let new = NewMesh { received, unit: "mm".into(), name: None, health: MeshHealthReport::default() };
    let mesh = store.add_mesh(new).await.expect("a mesh").id;
    let (request, input, meshes) = (JobRequest::new(mesh), "{}".to_owned(), vec![mesh]);
    let new = NewJob { request, input, meshes, warnings: Vec::new(), submitted_by: None, scanned: None };
    store.submit(&new, None, 1).await.expect("a job").id
}

#[test]
fn every_stage_has_its_failpoint() {
    for stage in Stage::ALL {
        assert!(FAILPOINTS.contains(&format!("stage.{}", stage.as_str()).as_str()), "{}", stage.as_str());
    }
}

#[test]
fn every_failpoint_is_documented_and_in_the_code() {
    let sources = [
        include_str!("store/files.rs"),
        include_str!("store/artifacts.rs"),
        include_str!("store/meshes.rs"),
        include_str!("store/jobs.rs"),
        include_str!("store/attempts.rs"),
        include_str!("jobs.rs"),
    ]
    .concat();
    let documentation = include_str!("failpoint.rs").split("pub const").next().unwrap_or_default();
    for name in FAILPOINTS {
        let (group, point) = name.split_once('.').expect("a group");
        if group != "stage" {
            assert!(sources.contains(&format!("hit(\"{group}\", \"{point}\")")), "{name} is nowhere");
            assert!(documentation.contains(&format!("`{name}`")), "{name} is not documented");
        }
    }
}
