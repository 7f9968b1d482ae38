//! Audit logs of runs in the inventory of the store, in its share of the disk, and in retention.

use std::fs;
use std::path::Path;
use std::sync::Arc;

use sqlx::{Connection as _, SqliteConnection};

use super::*;
use crate::planning::context::Context;
use crate::service::Options;
use crate::service::planner::JobInput;
use crate::service::space::space_at;
use crate::service::tests::{ended_job, no_steps, options};
use crate::wire::JobId;
use crate::wire::run::{LeaseRequest, ReportedState, Run, RunRequest};

async fn service_with(change: impl FnOnce(&mut Options)) -> (App, tempfile::TempDir) {
    let folder = tempfile::tempdir().expect("a folder");
    let mut options = options(folder.path());
    change(&mut options);
    let planner = Arc::new(|_: &JobInput, _: &Context<'_>| Ok(Vec::new()));
    (App::open_with(options, planner, None).await.expect("a service"), folder)
}

/// A run in a cell, in this state, whose audit log has so many bytes.
async fn run(app: &App, cell: &str, state: ReportedState, log_bytes: usize) -> RunId {
    let run = Run { state, ..Run::new(&RunRequest::new(JobId::generate()), None, cell, &no_steps(), "") };
    app.0.store.insert_run(&run, 8).await.expect("stored");
    write_log(&app.0.options.execution.audit_dir, run.id, log_bytes);
    run.id
}

fn write_log(audit_dir: &Path, run: RunId, bytes: usize) {
    let folder = audit_dir.join(run.to_string());
    fs::create_dir_all(&folder).expect("a folder");
    fs::write(folder.join("audit-00000001.log"), vec![b'x'; bytes]).expect("written");
}

/// Lets days pass for all runs that are there.
async fn days_pass(folder: &Path, days: u32) {
    let database = format!("sqlite://{}", folder.join("vantage.db").display());
    let mut other = SqliteConnection::connect(&database).await.expect("a connection");
    let back = "UPDATE run SET created_at = strftime('%Y-%m-%dT%H:%M:%fZ', 'now', '-' || ?1 || ' days'),
        ended_at = strftime('%Y-%m-%dT%H:%M:%fZ', 'now', '-' || ?1 || ' days')";
    sqlx::query(back).bind(days).execute(&mut other).await.expect("days pass");
}

#[tokio::test]
async fn the_inventory_has_the_audit_logs_and_what_was_swept() {
    let (app, folder) = service_with(|_| {}).await;
    let before = app.storage().await.expect("an inventory");
    assert_eq!((before.audit_bytes, before.swept_bytes), (0, 0));
    run(&app, "c", ReportedState::Done, 300).await;
    run(&app, "c", ReportedState::Running, 40).await;
    fs::create_dir_all(folder.path().join("swept")).expect("a folder");
    fs::write(folder.path().join("swept").join("ab".repeat(32)), b"orphan").expect("written");
    let after = app.storage().await.expect("an inventory");
    assert_eq!((after.audit_bytes, after.swept_bytes), (340, 6));
}

#[tokio::test]
async fn old_runs_go_with_their_logs_and_those_of_a_leased_cell_stay() {
    let (app, folder) = service_with(|options| {
        options.retention.run_days = 2;
        options.execution.lease_ttl = Duration::from_secs(30);
    })
    .await;
    let old = run(&app, "c", ReportedState::Done, 300).await;
    let leased = run(&app, "e05-transcan", ReportedState::Stopped, 50).await;
    let open = run(&app, "c", ReportedState::Paused, 10).await;
    days_pass(folder.path(), 3).await;
    let young = run(&app, "c", ReportedState::Done, 7).await;
    let request = LeaseRequest { cell: "e05-transcan".to_owned(), holder: String::new() };
    let lease = app.take_lease(request).await.expect("a preset");
    let has_log = |id: RunId| folder.path().join("audit").join(id.to_string()).exists();

    let told = app.retention().await.expect("a preview");
    assert_eq!((told.policy.run_days, told.run_count, told.size_bytes), (2, 1, 300));
    assert_eq!(told.runs, [RetiredRun { id: old, size_bytes: 300 }]);
    assert!(has_log(old), "a preview deletes nothing");
    assert_eq!(app.apply_retention().await.expect("applied").runs, told.runs);
    assert!(matches!(app.run(old).await, Err(Error::RunNotFound(_))) && !has_log(old));
    for kept in [leased, open, young] {
        app.run(kept).await.expect("kept");
        assert!(has_log(kept), "{kept}");
    }
    app.give_lease_back(lease.id).expect("held");
    assert_eq!(app.apply_retention().await.expect("applied").runs, [RetiredRun { id: leased, size_bytes: 50 }]);
    assert_eq!(app.storage().await.expect("an inventory").audit_bytes, 17);
}

#[tokio::test]
async fn runs_and_their_logs_are_kept_by_default() {
    let (app, folder) = service_with(|_| {}).await;
    let id = run(&app, "c", ReportedState::Done, 300).await;
    days_pass(folder.path(), 10_000).await;
    assert_eq!(app.apply_retention().await.expect("applied").run_count, 0);
    app.run(id).await.expect("kept");
}

/// They took room that nothing counted.
#[tokio::test]
async fn audit_logs_take_their_part_of_the_share_of_the_disk_and_delete_no_job_by_themselves() {
    const LIMIT_BYTES: f64 = 1e6;
    let (app, folder) = service_with(|options| {
        let total_bytes = space_at(&options.data_dir).expect("a disk").total_bytes;
        options.retention.max_disk_share = LIMIT_BYTES / total_bytes as f64;
    })
    .await;
    let job = ended_job(&app).await.id;
    let due = async || app.retention().await.expect("a preview").jobs.into_iter().map(|job| job.id).collect::<Vec<_>>();
    assert_eq!(due().await, [], "a part and no log");
    let (audit_dir, log) = (folder.path().join("audit"), RunId::generate());
    write_log(&audit_dir, log, 999_990);
    assert_eq!(due().await, [job], "the log leaves no room for its files");
    write_log(&audit_dir, log, 1_000_001);
    assert_eq!(due().await, [], "that would not help");
    assert_eq!(app.apply_retention().await.expect("applied").job_count, 0);
    assert!(share_a_disk(folder.path(), &audit_dir) && !share_a_disk(folder.path(), &folder.path().join("nowhere")));
}
