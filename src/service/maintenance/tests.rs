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
    app.0.store.insert_run(&run, None, 8).await.expect("stored");
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

#[test]
fn stored_files_have_half_of_the_share_whatever_the_logs_take() {
    let files = |max_bytes: u64, logs_bytes: u64| DiskShare { max_bytes, logs_bytes }.max_files_bytes();
    let logs = [0, 400, 500, 501, 1000, 1_000_000];
    assert_eq!(logs.map(|logs_bytes| files(1000, logs_bytes)), [1000, 600, 500, 500, 500, 500]);
    assert_eq!([files(1, 5), files(0, 5)], [1, 0]);
}

/// Audit logs took room that nothing counted, and then all jobs with them.
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
    for (log_bytes, files_bytes) in [(0, 1_000_000), (400_000, 600_000), (999_990, 500_000), (3_000_000, 500_000)] {
        write_log(&audit_dir, log, log_bytes);
        // The share is rounded, and some file systems change their size.
        let max_bytes = app.policy().await.expect("a policy").policy.max_bytes;
        assert!(max_bytes.abs_diff(files_bytes) <= 1000, "{log_bytes} bytes of logs leave {max_bytes} for files");
        assert_eq!(due().await, [], "half of the share is for its files: {job}");
        assert_eq!(app.apply_retention().await.expect("applied").job_count, 0);
    }
    app.job(job).await.expect("kept");
    assert!(audit_dir.join(log.to_string()).exists(), "no log goes for it either");
    assert!(share_a_disk(folder.path(), &audit_dir) && !share_a_disk(folder.path(), &folder.path().join("nowhere")));
}

/// The process may end between the two, and nobody knew the log any more.
#[tokio::test]
async fn the_log_of_a_deleted_run_goes_after_a_crash_too_and_the_logs_of_others_stay() {
    let (app, folder) = service_with(|_| {}).await;
    let (deleted, kept) = (run(&app, "c", ReportedState::Done, 300).await, run(&app, "c", ReportedState::Done, 40).await);
    let of_another_server = RunId::generate();
    write_log(&folder.path().join("audit"), of_another_server, 5);
    app.delete_run_row(deleted, false).await.expect("ended");
    app.round().await;
    let has_log = |id: RunId| folder.path().join("audit").join(id.to_string()).exists();
    assert_eq!([deleted, kept, of_another_server].map(has_log), [false, true, true]);
}

#[tokio::test]
async fn a_log_that_cannot_be_removed_keeps_nothing_else_from_being_deleted() {
    let (app, folder) = service_with(|options| options.retention.run_days = 2).await;
    let (stuck, other) = (run(&app, "c", ReportedState::Done, 300).await, run(&app, "c", ReportedState::Done, 40).await);
    days_pass(folder.path(), 3).await;
    let log = |id: RunId| folder.path().join("audit").join(id.to_string());
    // What is no folder cannot be removed as one.
    fs::remove_dir_all(log(stuck)).expect("removed");
    fs::write(log(stuck), b"no folder").expect("written");
    let applied = app.apply_retention().await.expect("applied");
    // What is left has freed nothing.
    assert_eq!(applied.runs, [(stuck, 0), (other, 40)].map(|(id, size_bytes)| RetiredRun { id, size_bytes }));
    assert!(log(stuck).exists() && !log(other).exists());
}

/// The first request failed, the second told that there was no such run, and the log was there.
#[tokio::test]
async fn a_deletion_that_leaves_the_log_says_so_and_the_same_request_removes_it_later() {
    let (app, folder) = service_with(|_| {}).await;
    let id = run(&app, "c", ReportedState::Done, 300).await;
    let log = folder.path().join("audit").join(id.to_string());
    // What is no folder cannot be removed as one.
    fs::remove_dir_all(&log).expect("removed");
    fs::write(&log, b"no folder").expect("written");
    for _ in 0..2 {
        let error = app.delete_run(id).await.expect_err("its log is left");
        assert!(matches!(error, Error::LogLeft { run, .. } if run == id), "{error:?}");
        assert!(error.to_string().contains("was deleted with its record, but its audit log cannot be removed"), "{error}");
        assert!(matches!(app.run(id).await, Err(Error::RunNotFound(_))) && log.exists());
    }
    fs::remove_file(&log).expect("removed");
    write_log(&folder.path().join("audit"), id, 300);
    // The service itself finishes deletions too, and may be first.
    let again = app.delete_run(id).await;
    assert!(matches!(again, Ok(()) | Err(Error::RunNotFound(_))) && !log.exists(), "{again:?}");
    assert!(matches!(app.delete_run(id).await, Err(Error::RunNotFound(_))));
}

/// Neither retention nor the inventory answered.
#[tokio::test]
async fn audit_logs_that_cannot_be_read_stop_nothing_else_and_are_told() {
    let (app, folder) = service_with(|options| {
        options.retention.run_days = 2;
        options.retention.max_disk_share = 0.5;
    })
    .await;
    let old = run(&app, "c", ReportedState::Done, 300).await;
    days_pass(folder.path(), 3).await;
    // What is no folder cannot be read as one.
    fs::remove_dir_all(folder.path().join("audit")).expect("removed");
    fs::write(folder.path().join("audit"), b"no folder").expect("written");
    let inventory = app.storage().await.expect("an inventory");
    let damaged: Vec<&str> = inventory.damaged.iter().map(|item| item.name.as_str()).collect();
    assert_eq!((damaged, inventory.audit_bytes), (vec!["audit logs"], 0));
    assert!(inventory.damaged[0].reason.contains("execution.audit_dir"), "{}", inventory.damaged[0].reason);
    let due = [RetiredRun { id: old, size_bytes: 0 }];
    assert_eq!(app.retention().await.expect("a preview").runs, due);
    assert_eq!(app.apply_retention().await.expect("applied").runs, due);
}
