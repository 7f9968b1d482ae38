//! Upgrade: a store of the previous version, with jobs in every state, opened by this one.

use super::*;
use crate::wire::JobSelection;

const MESH: &str = "0192d3a0-0000-7000-8000-000000000001";

fn job_id(number: u8) -> JobId {
    format!("0192d3a0-0000-7000-8000-0000000001{number:02}").parse().expect("an id")
}

/// Rows as the previous version wrote them. A job's request has a field that this version does not know.
fn old_rows() -> Vec<String> {
    let request = |extra: &str| {
        format!(r#"{{"mesh_id":"{MESH}","cell":{{"name":"my-cell"}},"scanner":"transcan-c","labels":{{"line":"3"}}{extra}}}"#)
    };
    let job = |number, state: &str, request: &str| {
        format!(
            "INSERT INTO job (id, state, mesh_id, request, input, part_number, labels, priority, attempts) VALUES \
             ('{}', '{state}', '{MESH}', '{request}', '{{}}', 'PN', '{{\"line\":\"3\"}}', 0, 1)",
            job_id(number)
        )
    };
    let plain = format!(r#"{{"mesh_id":"{MESH}","cell":"none","serial":"S-1","params":{{"part":{{"colour":"red"}}}},"gone":1}}"#);
    vec![
        format!(
            "INSERT INTO mesh (id, sha256, unit, size_bytes, health, preview) VALUES ('{MESH}', 'aa', 'mm', 3, '{}', 'cc')",
            r#"{"format":"obj"}"#
        ),
        job(1, "queued", &plain),
        job(2, "running", &plain),
        job(3, "succeeded", &plain),
        job(4, "queued", "{ broken"),
        job(5, "failed", &request(r#","params":{"nothing":{}}"#)),
        format!("INSERT INTO artifact VALUES ('{}', 'plan.json', 'bb', 7)", job_id(3)),
        format!("INSERT INTO event (job_id, body) VALUES ('{}', '{{}}')", job_id(1)),
    ]
}

#[tokio::test]
async fn a_store_of_the_version_before_loses_nothing() {
    let folder = tempfile::tempdir().expect("a folder");
    let options = connect_options(&folder.path().join(DATABASE)).create_if_missing(true);
    let mut old = SqliteConnection::connect_with(&options).await.expect("a database");
    let first = Migration::new(
        1,
        "first".into(),
        MigrationType::Simple,
        include_str!("../migrations/0001_first.sql").into_sql_str(),
        false,
    );
    Migrator::with_migrations(vec![first]).run_direct(None, &mut old, false).await.expect("the old tables");
    for statement in old_rows() {
        sqlx::query(sqlx::AssertSqlSafe(statement)).execute(&mut old).await.expect("an old row");
    }
    old.close().await.expect("closed");

    let store = Store::open(folder.path()).await.expect("opened by this version");
    // Its size is not known: it is drawn again.
    assert_eq!(store.preview(MESH.parse().expect("an id")).await.expect("read"), None);
    assert_eq!(store.recover(3, &exhausted()).await.expect("order"), 1);
    let page = store.jobs(&JobQuery::default(), &Page::new(10, None, "").expect("a page")).await.expect("a list");
    let seen: Vec<_> = page.items.iter().rev().map(|job| (job.state, job.cell.as_str(), job.serial.as_deref())).collect();
    use JobState::{Failed, Queued, Succeeded};
    let none = ("none", Some("S-1"));
    assert_eq!(
        seen,
        [
            (Queued, none.0, none.1),
            (Queued, none.0, none.1),
            (Succeeded, none.0, none.1),
            (Queued, "", None),
            (Failed, "my-cell", None)
        ]
    );
    let label =
        JobQuery { selection: JobSelection { label: Some("line=3".into()), ..JobSelection::default() }, ..JobQuery::default() };
    assert_eq!(store.jobs(&label, &Page::new(10, None, "").expect("a page")).await.expect("a list").items.len(), 5);
    // Running and queued jobs continue with their requests; an unreadable one fails with the reason.
    for number in [1, 2] {
        let attempt = store.claim_next().await.expect("the queue").expect("a job");
        assert_eq!((attempt.id, attempt.request.serial.as_deref()), (job_id(number), Some("S-1")));
        assert_eq!(succeed(&store, attempt.id, vec![]).await, Succeeded);
    }
    assert!(store.claim_next().await.expect("the queue").is_none());
    assert_eq!(store.job(job_id(4)).await.expect("it").problem.expect("why").code, "job_unreadable");
    // A job that ended before summaries were stored has none.
    assert_eq!(store.job(job_id(3)).await.expect("it").summary, None);
    assert!(page.items.iter().all(|job| job.summary.is_none() && job.submitted_by.is_none() && job.warnings.is_empty()));
    let file = store.result(job_id(3), "plan.json").await.expect("the old result");
    assert_eq!((file.result.sha256.as_str(), file.file_sha256.as_str(), file.file_bytes), ("bb", "bb", 7));
    assert!(matches!(store.open_result(&file, true).await.err(), Some(Error::FileDamaged { missing: true, .. })));
}
