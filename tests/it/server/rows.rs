//! Stores with something wrong in them: a server refuses what it would harm, and otherwise serves all the rest.

use super::database;
use super::process::{QUICK, Server};

/// A store with a mesh and an ended job; their ids.
fn used_store(data: &std::path::Path) -> (String, String) {
    let server = Server::start(data, &[]);
    let mesh = server.upload().expect("a mesh");
    let job = server.submit(&mesh, QUICK).expect("a job")["id"].as_str().expect("an id").to_owned();
    server.ended(&job);
    server.stop();
    (mesh["id"].as_str().expect("an id").to_owned(), job)
}

fn files(data: &std::path::Path) -> usize {
    let folders = std::fs::read_dir(data.join("files")).expect("the folder");
    folders.map(|folder| std::fs::read_dir(folder.expect("an entry").path()).expect("a folder").count()).sum()
}

#[test]
fn a_missing_or_empty_database_beside_files_is_refused_and_nothing_is_deleted() {
    let data = tempfile::tempdir().expect("a folder");
    let (mesh, job) = used_store(data.path());
    let (database, aside) = (data.path().join("vantage.db"), data.path().join("aside.db"));
    let before = files(data.path());
    std::fs::rename(&database, &aside).expect("moved");
    for make in [|_: &std::path::Path| {}, |database: &std::path::Path| std::fs::write(database, b"").expect("written")] {
        make(&database);
        let said = Server::refusal(data.path());
        assert!(said.contains("vantage.db is missing or empty") && said.contains("vantage restore"), "{said}");
        assert_eq!(files(data.path()), before);
    }
    for log in ["vantage.db", "vantage.db-wal", "vantage.db-shm"] {
        let _ = std::fs::remove_file(data.path().join(log));
    }
    // Stopping had put everything into the one file: it alone is all that was lost.
    std::fs::rename(&aside, &database).expect("put back");
    let server = Server::start(data.path(), &[]);
    assert_eq!(server.job(&job)["state"], "succeeded");
    assert_eq!(server.ask("GET", &format!("/api/v1/meshes/{mesh}/file"), b"").0, 200);
}

#[test]
fn orphans_are_never_removed_at_a_start() {
    let data = tempfile::tempdir().expect("a folder");
    used_store(data.path());
    let orphan = data.path().join("files/ab").join("ab".repeat(32));
    std::fs::create_dir_all(orphan.parent().expect("a folder")).expect("made");
    std::fs::write(&orphan, b"somebody's").expect("written");
    let server = Server::start(data.path(), &[]);
    server.get("/readyz").expect("ready");
    assert!(orphan.exists());
    drop(server);
    // Old ones are moved away while it serves, and stay to be had.
    let old = std::time::SystemTime::now() - std::time::Duration::from_secs(48 * 3600);
    std::fs::File::options().write(true).open(&orphan).and_then(|file| file.set_modified(old)).expect("aged");
    let _server = Server::start(data.path(), &[]);
    for _ in 0..500 {
        if !orphan.exists() {
            break;
        }
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    assert_eq!(std::fs::read(data.path().join("swept").join("ab".repeat(32))).expect("swept"), b"somebody's");
}

#[test]
fn one_unreadable_row_stops_nothing_else() {
    let data = tempfile::tempdir().expect("a folder");
    let server = Server::start(data.path(), &[]);
    let mesh = server.upload().expect("a mesh");
    let long = server.submit(&mesh, r#"{"part": {"samples_per_mm2": 60, "patch_edge_mm": 0.5}}"#).expect("a job");
    let ids: Vec<String> =
        (0..3).map(|_| server.submit(&mesh, QUICK).expect("a job")["id"].as_str().expect("an id").to_owned()).collect();
    server.wait_for_stage(long["id"].as_str().expect("an id"), "visibility");
    server.ask("POST", &format!("/api/v1/jobs/{}/cancel", long["id"].as_str().expect("an id")), b"");
    server.signal("KILL");
    drop(server);
    database::execute(
        data.path(),
        [
            format!("UPDATE job SET state = 'queued', ended_at = NULL WHERE id IN ('{}', '{}', '{}')", ids[0], ids[1], ids[2]),
            format!("UPDATE job_body SET request = '{{\"mesh_id\"' WHERE job_id = '{}'", ids[0]),
            format!("UPDATE job_body SET input = 'nothing' WHERE job_id = '{}'", ids[1]),
        ],
    );
    let server = Server::start(data.path(), &[]);
    for id in &ids[..2] {
        let job = server.ended(id);
        assert_eq!((&job["state"], &job["problem"]["code"]), (&"failed".into(), &"job_unreadable".into()), "{job}");
    }
    assert_eq!(server.ended(&ids[2])["state"], "succeeded");
    assert_eq!(server.get("/api/v1/jobs").expect("a list")["items"].as_array().expect("a list").len(), 4);
    for id in &ids[..2] {
        assert_eq!(server.ask("DELETE", &format!("/api/v1/jobs/{id}"), b"").0, 204);
    }
}

#[test]
fn calibrations_that_kill_every_process_or_cannot_be_read_are_given_up_and_the_others_go_on() {
    let data = tempfile::tempdir().expect("a folder");
    let server = Server::start(data.path(), &[]);
    let request = serde_json::to_vec(&vantage::wire::example::calibration()).expect("JSON");
    let ended = |server: &Server, id: &str| server.get(&format!("/api/v1/calibrations/{id}?wait=60s")).expect("it");
    let ids: Vec<String> = (0..4)
        .map(|_| {
            let (status, _, job) = server.ask("POST", "/api/v1/calibrations", &request);
            assert_eq!(status, 202, "{job}");
            let id = job["id"].as_str().expect("an id").to_owned();
            assert_eq!(ended(&server, &id)["state"], "succeeded");
            id
        })
        .collect();
    server.stop();
    let died = |id: &str, times: u32| {
        format!(
            "UPDATE calibration SET state = 'running', body = json_set(body, '$.state', 'running'), attempts = {times} \
             WHERE id = '{id}'"
        )
    };
    let broken = format!("UPDATE calibration SET state = 'running', body = '{{' WHERE id = '{}'", ids[3]);
    database::execute(data.path(), [died(&ids[0], 0), died(&ids[1], 1), died(&ids[2], 2), broken]);
    let server = Server::start(data.path(), &[]);
    for id in &ids[..2] {
        assert_eq!(ended(&server, id)["state"], "succeeded");
    }
    let job = ended(&server, &ids[2]);
    assert_eq!((&job["state"], &job["problem"]["code"]), (&"failed".into(), &"job_attempts_exhausted".into()), "{job}");
    // The newest cannot be read: the list goes on behind it.
    let page = server.get("/api/v1/calibrations?page_size=1").expect("a page");
    assert_eq!(page["items"], serde_json::json!([]));
    let token = page["next_page_token"].as_str().expect("more");
    let page = server.get(&format!("/api/v1/calibrations?page_size=10&page_token={token}")).expect("a page");
    let listed: Vec<&str> = page["items"].as_array().expect("a list").iter().filter_map(|job| job["id"].as_str()).collect();
    assert_eq!(listed, [&ids[2], &ids[1], &ids[0]]);
    for id in &ids {
        assert_eq!(server.ask("DELETE", &format!("/api/v1/calibrations/{id}"), b"").0, 204);
    }
}

#[test]
fn a_damaged_mesh_file_is_refused_with_the_reason_until_it_is_uploaded_again() {
    let data = tempfile::tempdir().expect("a folder");
    let (mesh, _) = used_store(data.path());
    let server = Server::start(data.path(), &[]);
    let sha256 = server.get(&format!("/api/v1/meshes/{mesh}")).expect("it")["sha256"].as_str().expect("a hash").to_owned();
    let path = data.path().join("files").join(&sha256[..2]).join(&sha256);
    let mut bytes = std::fs::read(&path).expect("the file");
    bytes[100] ^= 1;
    std::fs::write(&path, bytes).expect("damaged");
    let (status, _, problem) = server.ask("GET", &format!("/api/v1/meshes/{mesh}/file"), b"");
    assert_eq!((status, &problem["code"]), (500, &"file_damaged".into()), "{problem}");
    assert!(problem["detail"].as_str().expect("text").contains(&sha256), "{problem}");
    let job = server.submit(&server.get(&format!("/api/v1/meshes/{mesh}")).expect("it"), QUICK).expect("a job");
    let job = server.ended(job["id"].as_str().expect("an id"));
    assert_eq!((&job["state"], &job["problem"]["code"]), (&"failed".into(), &"file_damaged".into()), "{job}");
    let damage = || {
        let listed = server.get("/api/v1/storage").expect("the store")["damaged"].as_array().expect("a list").len();
        let metrics = ureq::get(server.url("/metrics")).call().expect("metrics").body_mut().read_to_string().expect("text");
        let counted = metrics.lines().find_map(|line| line.strip_prefix("vantage_store_damaged ")).expect("a number").to_owned();
        (listed, counted)
    };
    assert_eq!(damage(), (1, "1".to_owned()));
    // The same upload puts it right.
    assert_eq!(server.upload().expect("the mesh")["id"], mesh.as_str());
    assert_eq!(damage(), (0, "0".to_owned()));
    assert_eq!(server.ask("GET", &format!("/api/v1/meshes/{mesh}/file"), b"").0, 200);
}

/// Whatever else is stored, a job costs the same: rows that it does not name are not read, so they may hold what nobody can read.
#[test]
fn a_job_reads_what_it_names_and_nothing_else() {
    let data = tempfile::tempdir().expect("a folder");
    let (mesh, _) = used_store(data.path());
    let server = Server::start(data.path(), &[]);
    let mut scanner = server.get("/api/v1/scanners/transcan-c").expect("a preset");
    for name in ["mine", "other"] {
        scanner["name"] = name.into();
        let (status, _, answer) = server.ask("PUT", &format!("/api/v1/scanners/{name}"), scanner.to_string().as_bytes());
        assert_eq!(status, 201, "{answer}");
    }
    server.stop();
    let id = |number: usize| format!("0192d3a0-0000-7000-8001-{number:012x}");
    let mut statements: Vec<String> = (0..50)
        .map(|number| {
            format!(
                "INSERT INTO mesh (id, sha256, unit, name, size_bytes, health)
                 SELECT '{}', sha256, unit, 'm{number}', size_bytes, health FROM mesh WHERE id = '{mesh}'",
                id(number)
            )
        })
        .collect();
    // Bytes that are no text: a row that is read is an error.
    statements.push(format!("UPDATE mesh SET sha256 = CAST(x'ff' AS TEXT), unit = CAST(x'ff' AS TEXT) WHERE id <> '{mesh}'"));
    statements.push("UPDATE spec SET body = CAST(x'ff' AS TEXT) WHERE name <> 'mine'".to_owned());
    database::execute(data.path(), statements);
    let server = Server::start(data.path(), &[]);
    let submit = |scanner: &str| {
        let body = format!(r#"{{"mesh_id": "{mesh}", "cell": "none", "scanner": "{scanner}", "params": {QUICK}}}"#);
        server.ask("POST", "/api/v1/jobs", body.as_bytes())
    };
    let (status, _, job) = submit("mine");
    assert_eq!(status, 202, "{job}");
    assert_eq!(server.ended(job["id"].as_str().expect("an id"))["state"], "succeeded");
    // The rows are as bad as they are meant to be.
    assert_eq!(submit("other").0, 500);
    assert_eq!(server.ask("GET", &format!("/api/v1/meshes/{}", id(0)), b"").0, 500);
    let listed = server.get("/api/v1/meshes").expect("a list");
    assert_eq!(listed["items"].as_array().expect("a list").iter().map(|item| &item["id"]).collect::<Vec<_>>(), [&mesh]);
}
