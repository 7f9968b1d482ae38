//! Lists and unreadable rows: a bad row affects only itself.

use super::*;

async fn listed(store: &Store, filter: JobFilter, size: u32) -> crate::wire::JobPage {
    store.jobs(&filter, &Page::new(size, None, "").expect("a page")).await.expect("a list")
}

fn labelled(mesh: MeshId, labels: &[(&str, &str)], part: &str) -> NewJob {
    let labels = labels.iter().map(|(key, value)| ((*key).to_owned(), (*value).to_owned())).collect();
    let request = JobRequest { labels, part_number: Some(part.to_owned()), ..JobRequest::new(mesh) };
    NewJob { request, ..new_job(mesh, 0) }
}

#[tokio::test]
async fn every_filter_finds_its_jobs_in_order() {
    let opened = open().await;
    let store = &opened.store;
    let mesh = add_mesh(store, b"one").await.id;
    let mut ids = Vec::new();
    for (labels, part) in
        [(&[("line", "3"), ("shift", "a")][..], "P1"), (&[("line", "4")], "P1"), (&[("line", "3")], "P2"), (&[], "P1")]
    {
        ids.push(store.submit(labelled(mesh, labels, part)).await.expect("a job").id);
    }
    store.claim().await.expect("the queue").expect("the first");
    let found = async |state: Option<JobState>, label: Option<(&str, Option<&str>)>, part: Option<&str>| {
        let label = label.map(|(key, value)| (key.to_owned(), value.map(str::to_owned)));
        let page = listed(store, JobFilter { state, label, part_number: part.map(str::to_owned) }, 10).await;
        page.items.iter().map(|job| ids.iter().position(|id| *id == job.id).expect("one of them")).collect::<Vec<_>>()
    };
    assert_eq!(found(None, None, None).await, [3, 2, 1, 0]);
    assert_eq!(found(Some(JobState::Queued), None, None).await, [3, 2, 1]);
    assert_eq!(found(None, Some(("line", None)), None).await, [2, 1, 0]);
    assert_eq!(found(None, Some(("line", Some("3"))), None).await, [2, 0]);
    assert_eq!(found(Some(JobState::Queued), Some(("line", Some("3"))), None).await, [2]);
    assert_eq!(found(None, None, Some("P1")).await, [3, 1, 0]);
    assert_eq!(found(None, Some(("line", None)), Some("P1")).await, [1, 0]);
    assert!(found(None, Some(("shift", Some("b"))), None).await.is_empty());
    let places: Vec<_> = listed(store, JobFilter::default(), 10).await.items.iter().map(|job| job.queue_position).collect();
    assert_eq!(places, [Some(3), Some(2), Some(1), None]);
}

#[tokio::test]
async fn filters_and_places_use_an_index() {
    let opened = open().await;
    let plan = async |sql: &'static str| -> String {
        let rows = sqlx::query(sql).fetch_all(&opened.store.reader).await.expect("a plan");
        rows.iter().map(|row| sqlx::Row::get::<String, _>(row, "detail")).collect::<Vec<_>>().join("; ")
    };
    for (sql, index) in [
        ("EXPLAIN QUERY PLAN SELECT id FROM job WHERE id < 'x' AND state = 'failed' ORDER BY id DESC", "job_by_state"),
        ("EXPLAIN QUERY PLAN SELECT id FROM job WHERE id < 'x' AND part_number = 'P' ORDER BY id DESC", "job_by_part"),
        (
            "EXPLAIN QUERY PLAN SELECT id FROM job INDEXED BY job_queue WHERE state = 'queued' ORDER BY priority DESC, id",
            "COVERING INDEX job_queue",
        ),
        (
            "EXPLAIN QUERY PLAN SELECT job.id FROM job_label AS label CROSS JOIN job ON job.id = label.job_id
             WHERE label.key = 'k' AND label.value = 'v' AND label.job_id < 'x' ORDER BY label.job_id DESC",
            "label USING",
        ),
        ("EXPLAIN QUERY PLAN SELECT 1 FROM artifact WHERE file_sha256 = 'x'", "artifact_by_file"),
        ("EXPLAIN QUERY PLAN SELECT 1 FROM mesh WHERE preview = 'x'", "mesh_by_preview"),
    ] {
        let detail = plan(sql).await;
        assert!(detail.contains(index) && !detail.contains("TEMP B-TREE") && !detail.contains("SCAN job;"), "{sql}: {detail}");
    }
}

#[tokio::test]
async fn a_page_is_bounded_in_bytes_too() {
    let opened = open().await;
    let store = &opened.store;
    let mesh = add_mesh(store, b"one").await.id;
    let long = "x".repeat(256);
    let keys: Vec<String> = (0..32).map(|key| format!("{key:064}")).collect();
    let labels: Vec<(&str, &str)> = keys.iter().map(|key| (key.as_str(), long.as_str())).collect();
    for _ in 0..450 {
        store.submit(NewJob { queue_limit: 1000, ..labelled(mesh, &labels, "P") }).await.expect("a job");
    }
    let (mut token, mut seen, mut pages) = (None, 0, 0);
    loop {
        let page =
            store.jobs(&JobFilter::default(), &Page::new(1000, token.as_deref(), "").expect("a page")).await.expect("a list");
        assert!(serde_json::to_vec(&page).expect("JSON").len() < 5 << 20);
        seen += page.items.len();
        pages += 1;
        token = page.next_page_token;
        if token.is_none() {
            break;
        }
    }
    assert_eq!(seen, 450);
    assert!(pages > 1);
}

async fn execute(store: &Store, sql: &'static str) {
    sqlx::query(sql).execute(&store.reader).await.expect("done");
}

#[tokio::test]
async fn an_unreadable_job_fails_alone_and_can_be_seen_cancelled_and_deleted() {
    for damage in [
        "UPDATE job_body SET request = '{'",
        "UPDATE job_body SET request = '[]'",
        "UPDATE job_body SET version = 99",
        "DELETE FROM job_body",
    ] {
        let opened = open().await;
        let store = &opened.store;
        let mesh = add_mesh(store, b"one").await.id;
        let (bad, cancelled) = (submit(store, mesh).await, submit(store, mesh).await);
        execute(store, damage).await;
        let good = submit(store, mesh).await;
        assert_eq!(listed(store, JobFilter::default(), 10).await.items.len(), 3, "{damage}");
        assert_eq!(store.cancel(cancelled).await.expect("cancelled").state, JobState::Cancelled);
        assert_eq!(store.claim().await.expect("the queue").expect("the good one").id, good);
        let job = store.job(bad).await.expect("it");
        assert_eq!((job.state, job.problem.expect("the reason").code.as_str()), (JobState::Failed, "job_unreadable"), "{damage}");
        assert_eq!(kinds(store, bad).await, [EventKind::Queued, EventKind::Failed]);
        for id in [bad, cancelled] {
            store.delete_job(id, "hold", None).await.expect("deleted");
        }
        store.scrub_rows().await.expect("a look");
    }
}

#[tokio::test]
async fn rows_of_strange_columns_break_no_list() {
    let opened = open().await;
    let store = &opened.store;
    let mesh = add_mesh(store, b"one").await;
    let id = submit(store, mesh.id).await;
    execute(store, "UPDATE job SET state = 'dreaming', timings = '?', labels = '7', problem = 'x'").await;
    execute(store, "UPDATE event SET body = '}'").await;
    execute(store, "UPDATE mesh SET health = '{\"warnings\": 5}'").await;
    let item = &listed(store, JobFilter::default(), 10).await.items[0];
    assert_eq!((item.id, item.problem.as_ref().map(|problem| problem.code.as_str())), (id, Some("job_unreadable")));
    assert_eq!(store.job(id).await.expect("it").problem.expect("a reason").code, "job_unreadable");
    assert_eq!(kinds(store, id).await, []);
    store.scrub_rows().await.expect("a look");
    assert_eq!(store.damage().iter().map(|damage| damage.name.clone()).collect::<Vec<_>>(), [format!("mesh {}", mesh.id)]);
    let meshes = store.meshes(&Page::new(10, None, "").expect("a page")).await.expect("a list").items;
    assert!(meshes.len() == 1 && !meshes[0].health.warnings.is_empty(), "{meshes:?}");
    store.delete_job(id, "hold", None).await.expect("deleted");
}
