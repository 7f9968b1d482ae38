//! Files as browsers and resumed downloads fetch them: names and parts.

use super::api::{Answer, Api};

/// The answer to a request for a part.
async fn part(api: &Api, path: &str, range: &str) -> Answer {
    api.send("GET", path, &[("range", range)], "").await
}

#[tokio::test]
async fn every_file_comes_in_parts() {
    let api = Api::start().await;
    let mesh = api.mesh().await;
    let job = api.job("").await;
    api.ended(&job).await;
    let paths = [
        format!("/api/v1/meshes/{mesh}/file"),
        format!("/api/v1/meshes/{mesh}/preview.glb"),
        format!("/api/v1/jobs/{job}/plan"),
        format!("/api/v1/jobs/{job}/report"),
        format!("/api/v1/jobs/{job}/program/rapid"),
        format!("/api/v1/jobs/{job}/files/coverage.csv"),
    ];
    for path in paths {
        let whole = api.get(&path).await;
        assert_eq!((whole.status.as_u16(), whole.header("accept-ranges")), (200, "bytes"), "{path}");
        let (length, etag) = (whole.bytes.len(), whole.header("etag").to_owned());
        for (range, from, to) in [("bytes=0-4", 0, 5), ("bytes=7-", 7, length), ("bytes=-3", length - 3, length)] {
            let answer = part(&api, &path, range).await;
            assert_eq!((answer.status.as_u16(), answer.header("etag")), (206, etag.as_str()), "{path} {range}");
            assert_eq!(answer.bytes, whole.bytes[from..to], "{path} {range}");
            assert_eq!(answer.header("content-range"), format!("bytes {from}-{}/{length}", to - 1));
            assert_eq!(answer.header("content-type"), whole.header("content-type"));
        }
        // What is asked for in several parts, or cannot be read, is sent whole; and so is another version than the one begun.
        for headers in [
            &[("range", "bytes=0-1,4-5")][..],
            &[("range", "bytes=5-1")],
            &[("range", "pages=1-2")],
            &[("range", "bytes=0-4"), ("if-range", "\"other\"")],
        ] {
            let answer = api.send("GET", &path, headers, "").await;
            assert_eq!((answer.status.as_u16(), answer.bytes.len()), (200, length), "{path} {headers:?}");
        }
        let current = api.send("GET", &path, &[("range", "bytes=0-4"), ("if-range", &etag)], "").await;
        assert_eq!((current.status.as_u16(), current.bytes.len()), (206, 5), "{path}");
        let known = api.send("GET", &path, &[("range", "bytes=0-4"), ("if-none-match", &etag)], "").await;
        assert_eq!(known.status, 304, "{path}");
        // Whoever asks for another version only gets none.
        for (if_match, status) in
            [("\"other\"", 412), (&*format!("W/{etag}"), 412), ("*", 200), (&*format!("\"a\", {etag}"), 200)]
        {
            let answer = api.send("GET", &path, &[("if-match", if_match)], "").await;
            assert_eq!((answer.status.as_u16(), answer.header("etag")), (status, etag.as_str()), "{path} {if_match}");
        }
        let beyond = part(&api, &path, &format!("bytes={length}-")).await;
        beyond.problem_at("range_not_satisfiable", &["Range"]);
        assert_eq!(beyond.header("content-range"), format!("bytes */{length}"), "{path}");
        let head = api.send("HEAD", &path, &[("range", "bytes=0-4")], "").await;
        assert_eq!(head.status, 200, "{path}");
    }
}

#[tokio::test]
async fn a_part_of_a_file_that_is_stored_compressed_is_one_of_the_file_itself() {
    let api = Api::start().await;
    let job = api.job("long").await;
    api.ended(&job).await;
    let path = format!("/api/v1/jobs/{job}/report.txt");
    let packed = [("accept-encoding", "gzip")];
    let whole = api.send("GET", &path, &packed, "").await;
    assert_eq!((whole.status.as_u16(), whole.header("content-encoding")), (200, "gzip"));
    let answer = api.send("GET", &path, &[&packed[..], &[("range", "bytes=9003-9009")]].concat(), "").await;
    assert_eq!((answer.status.as_u16(), answer.header("content-encoding")), (206, ""));
    assert_eq!((answer.text().as_str(), answer.header("content-range")), ("3456789", "bytes 9003-9009/10000"));
}

#[tokio::test]
async fn downloads_are_named_after_the_part() {
    let api = Api::start().await;
    let mesh = api.mesh().await;
    let start = async |numbers: serde_json::Value| {
        let mut request = serde_json::json!({"mesh_id": mesh, "cell": "none"});
        request.as_object_mut().expect("an object").extend(numbers.as_object().expect("an object").clone());
        let job = api.post_json("/api/v1/jobs", &request).await.ok(202)["id"].as_str().expect("an id").to_owned();
        api.ended(&job).await;
        job
    };
    let numbered = start(serde_json::json!({"part_number": "Gehäuse/7", "serial": "S 2"})).await;
    let plain = start(serde_json::json!({})).await;
    let blank = start(serde_json::json!({"part_number": "", "serial": " "})).await;
    let named = async |path: String| api.get(&format!("/api/v1/{path}")).await.header("content-disposition").to_owned();
    let numbers = |kind: &str, file: &str| {
        format!("{kind}; filename=\"Geh_use_7_S 2_{file}\"; filename*=UTF-8''Geh%C3%A4use_7_S%202_{file}")
    };
    assert_eq!(named(format!("jobs/{numbered}/plan")).await, numbers("inline", "plan.json"));
    assert_eq!(named(format!("jobs/{numbered}/report")).await, numbers("inline", "report.html"));
    assert_eq!(named(format!("jobs/{numbered}/files/plan.json")).await, numbers("attachment", "plan.json"));
    assert_eq!(named(format!("jobs/{numbered}/program/rapid")).await, numbers("attachment", "program.mod"));
    assert_eq!(named(format!("jobs/{plain}/coverage.csv")).await, "attachment; filename=\"cube_coverage.csv\"");
    assert_eq!(named(format!("jobs/{blank}/plan")).await, "inline; filename=\"cube_plan.json\"");
    let job = api.get(&format!("/api/v1/jobs/{blank}")).await.ok(200);
    assert!(job["part_number"].is_null() && job["serial"].is_null(), "blank numbers are none: {job}");
    assert_eq!(named(format!("meshes/{mesh}/preview.glb")).await, "inline; filename=\"cube_preview.glb\"");
    // Without its mesh the job's own id is left.
    assert_eq!(api.send("DELETE", &format!("/api/v1/meshes/{mesh}"), &[], "").await.status, 204);
    assert_eq!(named(format!("jobs/{plain}/plan")).await, format!("inline; filename=\"{plain}_plan.json\""));
}

#[tokio::test]
async fn a_preview_comes_under_the_type_that_a_client_knows() {
    let api = Api::start().await;
    let path = format!("/api/v1/meshes/{}/preview.glb", api.mesh().await);
    for (accept, kind) in [
        ("*/*", "model/gltf-binary"),
        ("model/gltf-binary", "model/gltf-binary"),
        ("application/octet-stream", "application/octet-stream"),
    ] {
        assert_eq!(api.send("GET", &path, &[("accept", accept)], "").await.header("content-type"), kind);
    }
    api.send("GET", &path, &[("accept", "image/png")], "").await.problem("not_acceptable");
}
