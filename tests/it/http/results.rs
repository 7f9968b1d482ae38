//! Results of a job, in the forms that are asked for.

use serde_json::json;
use vantage::program::dialects::Dialect;

use super::api::{Api, FILES, cube};

#[tokio::test]
async fn each_result_comes_in_its_forms() {
    let api = Api::start().await;
    let job = api.job("").await;
    api.ended(&job).await;
    let html = "text/html; charset=utf-8";
    let (csv, text, bytes) = ("text/csv; charset=utf-8", "text/plain; charset=utf-8", "application/octet-stream");
    for (path, accept, kind, file) in [
        ("plan", "", "application/json", "plan.json"),
        ("plan?format=json", "text/csv", "application/json", "plan.json"),
        ("program", "", "application/json", "program.json"),
        ("program?dialect=csv", "", csv, "program.csv"),
        ("program", "text/csv", csv, "program.csv"),
        ("program?dialect=hans", "", "text/x-hans-cps; charset=utf-8", "program.cps"),
        ("program?dialect=urscript", "", "text/x-urscript; charset=utf-8", "program.script"),
        ("program?dialect=rapid", "text/plain", "text/x-rapid; charset=utf-8", "program.mod"),
        ("program", "text/x-rapid", "text/x-rapid; charset=utf-8", "program.mod"),
        ("program?dialect=krl", "", "text/x-krl; charset=utf-8", "program.src"),
        ("program?dialect=krl_dat", "", "text/x-krl-dat; charset=utf-8", "program.dat"),
        ("program?dialect=fanuc", "", "text/x-fanuc-ls; charset=utf-8", "program.ls"),
        ("program?dialect=robodk", "", "text/x-python; charset=utf-8", "program.py"),
        ("files/program.src", "", bytes, "program.src"),
        ("files/report.html", "text/html", bytes, "report.html"),
        ("program/rapid", "", text, "program.mod"),
        ("program/krl_dat", "application/json", text, "program.dat"),
        ("program/csv", "", text, "program.csv"),
        ("viewpoints.csv", "application/json", csv, "viewpoints.csv"),
        ("coverage.csv", "", csv, "coverage.csv"),
        ("report.txt", "text/html", text, "report.txt"),
        ("viewpoints", "*/*", "application/json", "viewpoints.json"),
        ("viewpoints", "text/csv", csv, "viewpoints.csv"),
        ("coverage", "", "application/json", "coverage.json"),
        ("coverage?format=csv", "application/json", csv, "coverage.csv"),
        ("missed", "", "application/json", "missed.json"),
        ("candidates", "", "application/json", "candidates.json"),
        ("report", "text/html,*/*;q=0.8", html, "report.html"),
        ("report", "", html, "report.html"),
        ("report?format=text", "", text, "report.txt"),
        ("coverage.bin", "", bytes, "coverage.bin"),
        ("files/report.txt", "", bytes, "report.txt"),
        ("files/coverage.bin", "", bytes, "coverage.bin"),
    ] {
        let headers = [("accept", accept)];
        let path = format!("/api/v1/jobs/{job}/{path}");
        let answer = api.send("GET", &path, if accept.is_empty() { &[] } else { &headers }, "").await;
        assert_eq!(answer.ok(200)["file"], file, "{path}");
        assert_eq!(answer.header("content-type"), kind, "{path}");
        assert!(answer.header("cache-control").contains("immutable"), "{path}");
        if kind == html {
            assert!(answer.header("content-security-policy").contains("sandbox"));
        }
        let etag = answer.header("etag").to_owned();
        assert!(etag.len() == 66 && etag.starts_with('"'), "{etag}");
        let mut known = headers.to_vec();
        known.push(("if-none-match", &etag));
        known.retain(|(_, value)| !value.is_empty());
        assert_eq!(api.send("GET", &path, &known, "").await.status, 304, "{path}");
        let head = api.send("HEAD", &path, if accept.is_empty() { &[] } else { &headers }, "").await;
        assert_eq!((head.status.as_u16(), head.header("etag")), (200, etag.as_str()));
    }
    let timings = api.get(&format!("/api/v1/jobs/{job}/timings")).await.ok(200);
    assert!(timings["visibility"].is_number(), "{timings}");
    for name in FILES {
        assert_eq!(api.get(&format!("/api/v1/jobs/{job}/files/{name}")).await.ok(200)["file"], name);
    }
}

#[tokio::test]
async fn other_forms_are_not_to_be_had() {
    let api = Api::start().await;
    let job = api.job("").await;
    api.ended(&job).await;
    // The field at fault was not named.
    for (path, accept, field) in [
        ("plan", "text/csv", "Accept"),
        ("plan?format=csv", "*/*", "format"),
        ("program?dialect=cobol", "*/*", "dialect"),
        ("report", "application/json", "Accept"),
        ("coverage.bin", "image/png", "Accept"),
        ("viewpoints?format=", "*/*", "format"),
    ] {
        let path = format!("/api/v1/jobs/{job}/{path}");
        api.send("GET", &path, &[("accept", accept)], "").await.problem_at("not_acceptable", &[field]);
    }
    let problem = api.get(&format!("/api/v1/jobs/{job}/program?dialect=cobol")).await.problem("not_acceptable");
    let detail = problem["detail"].as_str().expect("text");
    let outputs = Dialect::ALL.into_iter().flat_map(Dialect::outputs).map(|output| output.format);
    for form in outputs.chain(["json"]) {
        assert!(detail.contains(&format!("({form})")), "{detail}");
    }
    api.get(&format!("/api/v1/jobs/{job}/program-2?dialect=rapid")).await.problem("result_not_found");
    api.get(&format!("/api/v1/jobs/{job}/program-2/rapid")).await.problem("result_not_found");
    for unknown in ["json", "cobol"] {
        let problem = api.get(&format!("/api/v1/jobs/{job}/program/{unknown}")).await.problem("result_not_found");
        assert!(problem["detail"].as_str().expect("text").contains("krl_dat"), "{problem}");
    }
    api.get(&format!("/api/v1/jobs/{job}/program?format=json")).await.problem_at("bad_query", &["format"]);
    for name in ["nothing", "plan.json%00", "..%2f..%2fvantage.db", "%2e%2e"] {
        api.get(&format!("/api/v1/jobs/{job}/files/{name}")).await.problem("result_not_found");
    }
}

#[tokio::test]
async fn a_dialect_that_cannot_say_a_program_says_why() {
    let api = Api::start().await;
    let job = api.job("refuse").await;
    api.ended(&job).await;
    let problem = api.get(&format!("/api/v1/jobs/{job}/program?dialect=fanuc")).await.problem("result_not_found");
    assert_eq!(problem["detail"], "there is no program.ls: the speed is 0.001 of the rated");
    let problem = api.get(&format!("/api/v1/jobs/{job}/program?dialect=rapid")).await.problem("result_not_found");
    assert!(problem["detail"].as_str().expect("text").contains("has no program.mod"), "{problem}");
}

/// RAPID for a Han's arm was sent without a word.
#[tokio::test]
async fn a_program_in_another_makers_language_has_to_be_forced() {
    let api = Api::start().await;
    let job = api.job("foreign").await;
    api.ended(&job).await;
    let path = |rest: &str| format!("/api/v1/jobs/{job}/{rest}");
    assert_eq!(api.get(&path("program?dialect=hans")).await.text(), "# own");
    let accepts = [("accept", "text/x-rapid")];
    for answer in [
        api.get(&path("program?dialect=rapid")).await,
        api.get(&path("program?dialect=rapid&force=false")).await,
        api.send("GET", &path("program"), &accepts, "").await,
        api.get(&path("files/program.mod")).await,
    ] {
        let problem = answer.problem("foreign_dialect");
        let detail = problem["detail"].as_str().expect("text");
        assert!(detail.contains("hans-e05") && detail.contains("\"hans\"") && detail.contains("force=true"), "{detail}");
    }
    let forced = api.get(&path("program?dialect=rapid&force=true")).await;
    assert_eq!((forced.status.as_u16(), forced.header("content-type")), (200, "text/x-rapid; charset=utf-8"));
    assert!(forced.text().contains("WARNING: FORCED"), "{}", forced.text());
    assert_eq!(api.get(&path("program?dialect=hans&force=true")).await.text(), "# own");
    api.get(&path("program?dialect=krl&force=true")).await.problem("result_not_found");
    api.get(&path("program?dialect=rapid&force=maybe")).await.problem_at("bad_query", &["force"]);
    api.get(&path("plan?force=true")).await.problem_at("bad_query", &["force"]);
}

/// Jobs of earlier releases sent RAPID for a Han's arm without a word, since it is stored under its plain name.
#[tokio::test]
async fn a_program_of_an_earlier_release_in_another_makers_language_has_to_be_forced_too() {
    let api = Api::start().await;
    let mesh = api.mesh().await;
    let request = |cell: &str| json!({"mesh_id": mesh, "cell": cell, "labels": {"do": "earlier"}});
    let job = api.post_json("/api/v1/jobs", &request("e05-transcan")).await.ok(202)["id"].as_str().expect("an id").to_owned();
    api.ended(&job).await;
    let database = format!("sqlite://{}", api.app.data_dir().join("vantage.db").display());
    let options: sqlx::sqlite::SqliteConnectOptions = database.parse().expect("a path");
    // With the robot's language in the stored specification, and as it was stored before robots had one.
    for statement in ["SELECT 1", "UPDATE job_body SET input = json_remove(input, '$.cell.robot.dialect')"] {
        let mut connection = sqlx::ConnectOptions::connect(&options).await.expect("the database");
        sqlx::query(statement).execute(&mut connection).await.expect("done");
        sqlx::Connection::close(connection).await.expect("closed");
        for path in ["program?dialect=rapid", "program/rapid", "files/program.mod"] {
            let problem = api.get(&format!("/api/v1/jobs/{job}/{path}")).await.problem("foreign_dialect");
            let detail = problem["detail"].as_str().expect("text");
            assert!(detail.contains("hans-e05") && detail.contains("force=true"), "{statement}: {detail}");
        }
        for (path, text) in [
            ("program?dialect=rapid&force=true", "! of another maker"),
            ("program/rapid?force=true", "! of another maker"),
            ("program?dialect=hans", "# own"),
            ("program?dialect=csv", "a table"),
            ("files/program.cps", "# own"),
        ] {
            let answer = api.get(&format!("/api/v1/jobs/{job}/{path}")).await;
            assert_eq!((answer.status.as_u16(), answer.text()), (200, text.to_owned()), "{statement}: {path}");
        }
    }
    // Without a robot, nobody's language is another's.
    let job = api.post_json("/api/v1/jobs", &request("none")).await.ok(202)["id"].as_str().expect("an id").to_owned();
    api.ended(&job).await;
    assert_eq!(api.get(&format!("/api/v1/jobs/{job}/program/rapid")).await.text(), "! of another maker");
}

#[tokio::test]
async fn there_are_no_results_before_the_end_nor_after_a_bad_one() {
    let api = Api::start().await;
    let running = api.job("wait").await;
    let failed = api.job("no_plan").await;
    api.get(&format!("/api/v1/jobs/{running}/plan")).await.problem("no_results");
    api.post_json(&format!("/api/v1/jobs/{running}/cancel"), &json!(null)).await.ok(202);
    api.ended(&running).await;
    api.ended(&failed).await;
    for job in [running, failed] {
        api.get(&format!("/api/v1/jobs/{job}/plan")).await.problem("no_results");
        api.get(&format!("/api/v1/jobs/{job}/files/plan.json")).await.problem("no_results");
    }
}

#[tokio::test]
async fn a_job_without_a_plan_has_its_report() {
    let api = Api::start().await;
    let job = api.job("no_plan_report").await;
    let ended = api.ended(&job).await;
    assert_eq!((&ended["state"], &ended["problem"]["code"]), (&json!("failed"), &json!("no_plan")), "{ended}");
    let names: Vec<&str> = ended["results"].as_array().expect("files").iter().filter_map(|file| file["name"].as_str()).collect();
    assert_eq!(names, ["report.html", "report.txt", "timings.json"]);
    assert_eq!(ended["plan_sha256"], json!(null));
    for (path, said) in
        [("report", "no report.html"), ("report?format=text", "no report.txt"), ("files/report.txt", "no report.txt")]
    {
        let answer = api.get(&format!("/api/v1/jobs/{job}/{path}")).await;
        assert_eq!((answer.status.as_u16(), answer.text()), (200, said.to_owned()), "{path}");
    }
    for path in ["plan", "program", "coverage", "files/plan.json"] {
        api.get(&format!("/api/v1/jobs/{job}/{path}")).await.problem("no_results");
    }
}

#[tokio::test]
async fn large_answers_are_compressed_and_their_tag_says_so() {
    let api = Api::start().await;
    let document = api.send("GET", "/api/v1/openapi.json", &[("accept-encoding", "gzip")], "").await;
    assert_eq!((document.status.as_u16(), document.header("content-encoding")), (200, "gzip"));
    let page = api.send("GET", "/assets/page.js", &[("accept-encoding", "gzip")], "").await;
    assert_eq!(page.header("content-encoding"), "gzip");
    assert!(page.header("etag").starts_with("W/\""), "{}", page.header("etag"));
}

#[tokio::test]
async fn a_part_that_is_refused_has_a_report_as_well() {
    let api = super::inspections::planning().await;
    let mesh = api.send("POST", "/api/v1/meshes?unit=mm", &[], cube(900.0)).await.ok(201);
    let job = api.post_json("/api/v1/jobs", &json!({"mesh_id": mesh["id"], "cell": "e05-transcan"})).await.ok(202);
    let job = job["id"].as_str().expect("an id").to_owned();
    let ended = api.get(&format!("/api/v1/jobs/{job}?wait=60s")).await.ok(200);
    assert_eq!(ended["problem"]["code"], "job_input_invalid", "{ended}");
    assert_eq!(ended["problem"]["errors"][0]["pointer"], "/mesh_id", "{ended}");
    let report = api.get(&format!("/api/v1/jobs/{job}/report?format=html")).await;
    assert!(report.status == 200 && report.text().contains("plate"), "{}", report.status);
}
