//! Failpoints: each stage has one, each is documented and in the code. Beside them, the service that the tests of this room share.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use super::planner::JobInput;
use super::store::{NewJob, NewMesh};
use super::*;
use crate::planning::context::{Context, Stage};
use crate::wire::{JobId, JobRequest, MeshHealthReport};

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
    let folder = tempfile::tempdir().expect("a folder");
    let planner = Arc::new(|_: &JobInput, _: &Context<'_>| Ok(Vec::new()));
    (App::open_with(options(folder.path()), planner, None).await.expect("a service"), folder)
}

/// A job, in whatever state.
pub(super) async fn job(app: &App) -> JobId {
    let store = &app.0.store;
    let received = store.files().write(b"one").expect("a file");
    let new = NewMesh { received, unit: "mm".into(), name: None, health: MeshHealthReport::default() };
    let mesh = store.add_mesh(new).await.expect("a mesh").id;
    let (request, input, meshes) = (JobRequest::new(mesh), "{}".to_owned(), vec![mesh]);
    let new = NewJob { request, input, meshes, warnings: Vec::new(), submitted_by: None };
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
