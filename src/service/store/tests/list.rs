//! Lists and unreadable rows: a bad row affects only itself.

use super::*;
use crate::wire::JobSelection;
use crate::wire::warnings::{FieldWarning, WarningCode};

fn selecting(selection: JobSelection) -> JobQuery {
    JobQuery { selection, ..JobQuery::default() }
}

async fn listed(store: &Store, query: JobQuery, size: u32) -> crate::wire::JobPage {
    store.jobs(&query, &Page::new(size, None, "").expect("a page")).await.expect("a list")
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
        ids.push(store.submit_one(&labelled(mesh, labels, part)).await.expect("a job").id);
    }
    store.claim_next().await.expect("the queue").expect("the first");
    let found = async |state: Option<JobState>, label: Option<(&str, Option<&str>)>, part: Option<&str>| {
        let label = label.map(|(key, value)| value.map_or_else(|| key.to_owned(), |value| format!("{key}={value}")));
        let selection = JobSelection { state, label, part_number: part.map(str::to_owned), ..JobSelection::default() };
        let page = listed(store, selecting(selection), 10).await;
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
    let places: Vec<_> = listed(store, JobQuery::default(), 10).await.items.iter().map(|job| job.queue_position).collect();
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
        ("EXPLAIN QUERY PLAN SELECT id FROM job WHERE 1 AND id < 'x' AND serial = 'S' ORDER BY id DESC", "job_by_serial"),
        ("EXPLAIN QUERY PLAN SELECT id FROM job WHERE 1 AND id < 'x' AND cell = 'c' ORDER BY id DESC", "job_by_cell"),
        ("EXPLAIN QUERY PLAN SELECT id FROM job WHERE 1 AND id < 'x' AND mesh_id = 'm' ORDER BY id DESC", "job_by_mesh"),
        (
            "EXPLAIN QUERY PLAN SELECT id FROM job WHERE 1 AND coalesce(ended_at, '~') <= 'e'
             AND NOT (coalesce(ended_at, '~') = 'e' AND job.id >= 'x') ORDER BY coalesce(ended_at, '~') DESC, job.id DESC",
            "job_in_order_of_end",
        ),
        (
            "EXPLAIN QUERY PLAN SELECT id FROM job WHERE 1 ORDER BY coalesce(part_number, ''), job.id LIMIT 5",
            "job_in_order_of_part",
        ),
        (
            "EXPLAIN QUERY PLAN SELECT id FROM job WHERE 1 ORDER BY coalesce(serial, '') DESC, job.id DESC",
            "job_in_order_of_serial",
        ),
        ("EXPLAIN QUERY PLAN SELECT 1 FROM artifact WHERE file_sha256 = 'x'", "artifact_by_file"),
        ("EXPLAIN QUERY PLAN SELECT 1 FROM mesh WHERE preview = 'x'", "mesh_by_preview"),
    ] {
        let detail = plan(sql).await;
        assert!(detail.contains(index) && !detail.contains("TEMP B-TREE") && !detail.contains("SCAN job;"), "{sql}: {detail}");
    }
}

/// Jobs with part numbers and serials, of which the first three have ended, in another order than they began.
async fn numbered(store: &Store) -> Vec<JobId> {
    let mesh = add_mesh(store, b"one").await.id;
    let mut ids = Vec::new();
    for (part, serial) in [(Some("B"), Some("2")), (Some("Ä"), None), (None, Some("1")), (Some("B"), Some("2")), (None, None)] {
        let request =
            JobRequest { part_number: part.map(str::to_owned), serial: serial.map(str::to_owned), ..JobRequest::new(mesh) };
        ids.push(store.submit_one(&NewJob { request, ..new_job(mesh, 0) }).await.expect("a job").id);
    }
    for (number, ended) in [(0, "2026-03-03T00:00:00.000Z"), (1, "2026-03-01T00:00:00.000Z"), (2, "2026-03-02T00:00:00.000Z")] {
        store.claim_next().await.expect("the queue").expect("a job");
        succeed(store, ids[number], vec![]).await;
        sqlx::query("UPDATE job SET ended_at = ?1, created_at = ?2 WHERE id = ?3")
            .bind(ended)
            .bind(format!("2026-02-0{}T12:00:00.000Z", number + 1))
            .bind(ids[number].to_string())
            .execute(&store.reader)
            .await
            .expect("aged");
    }
    ids
}

#[tokio::test]
async fn every_order_goes_through_all_jobs_once_page_by_page() {
    let opened = open().await;
    let store = &opened.store;
    let ids = numbered(store).await;
    for (sort, order) in [
        ("-created_at", [4, 3, 2, 1, 0]),
        ("created_at", [0, 1, 2, 3, 4]),
        ("ended_at", [1, 2, 0, 3, 4]),
        ("-ended_at", [4, 3, 0, 2, 1]),
        ("part_number", [2, 4, 0, 3, 1]),
        ("-part_number", [1, 3, 0, 4, 2]),
        ("serial", [1, 4, 2, 0, 3]),
        ("-serial", [3, 0, 2, 4, 1]),
    ] {
        let filter = JobQuery { sort: sort.parse().expect("an order"), ..JobQuery::default() };
        for size in [1, 2, 5] {
            let (mut found, mut token) = (Vec::new(), None);
            loop {
                let page = Page::new(size, token.as_deref(), sort).expect("a page");
                let page = store.jobs(&filter, &page).await.expect("a list");
                found.extend(page.items.iter().map(|job| ids.iter().position(|id| *id == job.id).expect("one of them")));
                token = page.next_page_token;
                if token.is_none() {
                    break;
                }
            }
            assert_eq!(found, order, "{sort} by {size}");
        }
    }
}

#[tokio::test]
async fn a_page_after_a_deleted_job_goes_on_where_that_was() {
    let opened = open().await;
    let store = &opened.store;
    let ids = numbered(store).await;
    let filter = JobQuery { sort: "part_number".parse().expect("an order"), ..JobQuery::default() };
    let first = store.jobs(&filter, &Page::new(3, None, "").expect("a page")).await.expect("a list");
    store.delete_job(ids[0], "hold", None).await.expect("deleted");
    let next = Page::new(3, first.next_page_token.as_deref(), "").expect("a page");
    let found: Vec<JobId> = store.jobs(&filter, &next).await.expect("a list").items.iter().map(|job| job.id).collect();
    assert_eq!(found, [ids[3], ids[1]]);
}

#[tokio::test]
async fn jobs_are_found_by_serial_mesh_cell_time_and_id() {
    let opened = open().await;
    let store = &opened.store;
    let ids = numbered(store).await;
    let mesh_id = store.job(ids[0]).await.expect("it").mesh_id;
    let time = |text: &str| Some(text.parse::<crate::wire::UtcTime>().expect("a time"));
    for (selection, numbers) in [
        (JobSelection { serial: Some("2".into()), ..JobSelection::default() }, &[3, 0][..]),
        (JobSelection { mesh_id: Some(mesh_id), ..JobSelection::default() }, &[4, 3, 2, 1, 0]),
        (JobSelection { mesh_id: Some(MeshId::generate()), ..JobSelection::default() }, &[]),
        (JobSelection { cell: Some("e05-transcan".into()), ..JobSelection::default() }, &[4, 3, 2, 1, 0]),
        (JobSelection { cell: Some("none".into()), ..JobSelection::default() }, &[]),
        (JobSelection { created_before: time("2026-02-02T12:00:00Z"), ..JobSelection::default() }, &[0]),
        (
            JobSelection {
                created_after: time("2026-02-02T13:00:00+01:00"),
                created_before: time("2026-02-04T00:00:00Z"),
                ..JobSelection::default()
            },
            &[2, 1],
        ),
        (JobSelection { ids: Some(vec![ids[3], ids[1]]), ..JobSelection::default() }, &[3, 1]),
        (JobSelection { ids: Some(vec![]), ..JobSelection::default() }, &[]),
    ] {
        let query = selecting(selection);
        let page = listed(store, query.clone(), 10).await;
        let found: Vec<_> = page.items.iter().map(|job| ids.iter().position(|id| *id == job.id).expect("one of them")).collect();
        assert_eq!(found, numbers, "{query:?}");
        let mut matching: Vec<_> = store.matching(&query, "hold").await.expect("jobs").iter().map(|job| job.id).collect();
        matching.reverse();
        assert_eq!(matching, page.items.iter().map(|job| job.id).collect::<Vec<_>>(), "{query:?}");
    }
}

#[tokio::test]
async fn a_batch_is_stored_whole_or_not_at_all() {
    let opened = open().await;
    let store = &opened.store;
    let mesh = add_mesh(store, b"one").await.id;
    let jobs: Vec<NewJob> = [0, 5, 0].map(|priority| new_job(mesh, priority)).into();
    assert!(matches!(store.submit_batch(&jobs, None, 2).await, Err(Error::QueueFull { queued: 0, asked: 3, limit: 2 })));
    let gone = [new_job(mesh, 0), NewJob { meshes: vec![MeshId::generate()], ..new_job(mesh, 0) }];
    assert!(matches!(store.submit_batch(&gone, None, 10).await, Err(Error::MeshNotFound(_))));
    assert!(listed(store, JobQuery::default(), 10).await.items.is_empty());
    let key = IdempotencyKey::new("key", "a");
    let batch = store.submit_batch(&jobs, Some(&key), 3).await.expect("jobs");
    assert_eq!(batch.jobs.iter().map(|job| job.queue_position).collect::<Vec<_>>(), [Some(2), Some(1), Some(3)]);
    assert!(batch.jobs.is_sorted_by_key(|job| job.id));
    // The same key gives the same answer, and is refused for another request.
    assert_eq!(store.submit_batch(&jobs, Some(&key), 3).await.expect("the same"), batch);
    let other = IdempotencyKey::new("key", "b");
    assert!(matches!(store.submit(&new_job(mesh, 0), Some(&other), ROOM).await, Err(Error::IdempotencyMismatch)));
    assert_eq!(kinds(store, batch.jobs[2].id).await, [EventKind::Queued]);
}

#[tokio::test]
async fn the_part_of_the_examples_has_its_id_in_whichever_unit_it_comes_first() {
    let opened = open().await;
    let store = &opened.store;
    let add = async |unit: &str| {
        let mut receiver = store.files().receive().expect("a receiver");
        receiver.write(crate::wire::example::MESH.as_bytes()).expect("written");
        let received = receiver.finish().expect("finished");
        store.add_mesh(NewMesh { received, unit: unit.into(), name: None, health: health() }).await.expect("a mesh")
    };
    assert_eq!(add("inch").await.id, MeshId::EXAMPLE);
    assert_ne!(add("mm").await.id, MeshId::EXAMPLE);
    assert_eq!(add("inch").await.id, MeshId::EXAMPLE, "uploaded again");
    store.delete_mesh(MeshId::EXAMPLE, 0).await.expect("free");
    assert_eq!(add("cm").await.id, MeshId::EXAMPLE);
    // Its digest stands beside it.
    let digest = <sha2::Sha256 as sha2::Digest>::digest(crate::wire::example::MESH);
    assert_eq!(crate::wire::hex(&digest), crate::wire::example::MESH_SHA256);
}

#[tokio::test]
#[ignore = "long: tests/all runs it"]
async fn a_page_is_bounded_in_bytes_too() {
    let opened = open().await;
    let store = &opened.store;
    let mesh = add_mesh(store, b"one").await.id;
    let long = "x".repeat(256);
    let keys: Vec<String> = (0..32).map(|key| format!("{key:064}")).collect();
    let labels: Vec<(&str, &str)> = keys.iter().map(|key| (key.as_str(), long.as_str())).collect();
    for _ in 0..450 {
        store.submit_one(&labelled(mesh, &labels, "P")).await.expect("a job");
    }
    let (mut token, mut seen, mut pages) = (None, 0, 0);
    loop {
        let page =
            store.jobs(&JobQuery::default(), &Page::new(1000, token.as_deref(), "").expect("a page")).await.expect("a list");
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
        assert_eq!(listed(store, JobQuery::default(), 10).await.items.len(), 3, "{damage}");
        assert_eq!(store.cancel(cancelled).await.expect("cancelled").state, JobState::Cancelled);
        assert_eq!(store.claim_next().await.expect("the queue").expect("the good one").id, good);
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
    let item = &listed(store, JobQuery::default(), 10).await.items[0];
    assert_eq!((item.id, item.problem.as_ref().map(|problem| problem.code.as_str())), (id, Some("job_unreadable")));
    assert_eq!(store.job(id).await.expect("it").problem.expect("a reason").code, "job_unreadable");
    assert_eq!(kinds(store, id).await, []);
    store.scrub_rows().await.expect("a look");
    assert_eq!(store.damage().iter().map(|damage| damage.name.clone()).collect::<Vec<_>>(), [format!("mesh {}", mesh.id)]);
    let meshes = store.meshes(&Page::new(10, None, "").expect("a page")).await.expect("a list").items;
    assert!(meshes.len() == 1 && !meshes[0].health.warnings.is_empty(), "{meshes:?}");
    store.delete_job(id, "hold", None).await.expect("deleted");
}

/// A page with an unreadable row lost the token of the next one, and with it all older jobs.
#[tokio::test]
async fn a_list_goes_on_behind_rows_that_cannot_be_read() {
    let opened = open().await;
    let store = &opened.store;
    let mesh = add_mesh(store, b"one").await.id;
    let mut ids = Vec::new();
    for _ in 0..7 {
        ids.push(submit(store, mesh).await);
    }
    let damage = async |sql: &'static str, id: JobId| {
        sqlx::query(sql).bind(id.to_string()).execute(&store.reader).await.expect("damaged");
    };
    damage("UPDATE job SET mesh_id = 'none' WHERE id = ?1", ids[5]).await;
    damage("UPDATE job SET mesh_id = 'none' WHERE id = ?1", ids[4]).await;
    // The id of a row is no id, and still its place in the list.
    let strange = format!("{}~", &ids[2].to_string()[..35]);
    sqlx::query("INSERT INTO job (id, state, mesh_id, labels, priority) VALUES (?1, 'failed', 'm', '{}', 0)")
        .bind(&strange)
        .execute(&store.reader)
        .await
        .expect("a strange row");
    for sort in ["-created_at", "created_at", "part_number", "-ended_at"] {
        for size in [1, 2, 3, 10] {
            let query = JobQuery { sort: sort.parse().expect("an order"), ..JobQuery::default() };
            let (mut found, mut token, mut pages) = (Vec::new(), None, 0);
            loop {
                let page = Page::new(size, token.as_deref(), sort).expect("a page");
                let page = store.jobs(&query, &page).await.expect("a list");
                found.extend(page.items.iter().map(|job| job.id));
                (token, pages) = (page.next_page_token, pages + 1);
                if token.is_none() || pages > 20 {
                    break;
                }
            }
            found.sort_unstable();
            assert_eq!(found, [0, 1, 2, 3, 6].map(|number| ids[number]), "{sort} by {size}");
        }
    }
}

#[tokio::test]
async fn lists_have_warnings_and_sender_without_the_body() {
    let opened = open().await;
    let store = &opened.store;
    let mesh = add_mesh(store, b"one").await.id;
    let warning = FieldWarning {
        code: WarningCode::PartSmall,
        pointer: "/mesh_id".into(),
        detail: "is small".into(),
        remedy: "look at the unit".into(),
    };
    let new = NewJob { warnings: vec![warning.clone()], submitted_by: Some("mes".into()), ..new_job(mesh, 0) };
    let id = store.submit_one(&new).await.expect("a job").id;
    let plain = submit(store, mesh).await;
    execute(store, "DELETE FROM job_body").await;
    let items = listed(store, JobQuery::default(), 10).await.items;
    let seen: Vec<_> = items.iter().map(|job| (job.id, &job.warnings[..], job.submitted_by.as_deref())).collect();
    assert_eq!(seen, [(plain, &[][..], None), (id, &[warning][..], Some("mes"))]);
    assert_eq!(store.job(id).await.expect("it").submitted_by.as_deref(), Some("mes"));
}

#[tokio::test]
async fn warnings_of_a_plan_join_those_of_its_job() {
    let opened = open().await;
    let store = &opened.store;
    let mesh = add_mesh(store, b"one").await.id;
    let warning =
        |code: WarningCode| FieldWarning { code, pointer: "/params".into(), detail: String::new(), remedy: String::new() };
    let new = NewJob { warnings: vec![warning(WarningCode::PartSmall)], ..new_job(mesh, 0) };
    let id = store.submit_one(&new).await.expect("a job").id;
    store.claim_next().await.expect("the queue").expect("the job");
    let of_plan = vec![warning(WarningCode::RegionEmpty), warning(WarningCode::FragileUnderPoseError)];
    let outcome = AttemptOutcome::Succeeded { files: Vec::new(), summary: None, warnings: of_plan.clone() };
    store.end_attempt(id, &outcome, "{}").await.expect("an end");
    assert_eq!(store.job(id).await.expect("it").warnings, of_plan, "its input has none");
    let listed = listed(store, JobQuery::default(), 10).await.items.remove(0).warnings;
    assert_eq!(listed, [new.warnings, of_plan].concat());
}
