//! Uploading meshes and looking at them.

use std::time::{Duration, Instant};

use axum::body::{Body, Bytes};
use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use futures_util::stream;
use serde_json::json;
use sha2::{Digest, Sha256};

use super::api::{Api, cube, http_options, service_options};

fn sha256(text: &str) -> String {
    Sha256::digest(text).iter().map(|byte| format!("{byte:02x}")).collect()
}

#[tokio::test]
async fn a_file_is_taken_under_any_type() {
    let api = Api::start().await;
    for kind in ["", "application/octet-stream", "model/stl", "text/html", "application/json", "nonsense"] {
        let answer = api.send("POST", "/api/v1/meshes?unit=cm", &[("content-type", kind)], cube(10.0)).await;
        let mesh = answer.ok(201);
        assert_eq!(answer.header("location"), format!("/api/v1/meshes/{}", mesh["id"].as_str().expect("an id")));
        assert_eq!(mesh["unit"], "cm");
        assert_eq!(mesh["name"], json!(null));
        assert_eq!(mesh["health"]["triangles"], 12);
        assert_eq!(mesh["health"]["watertight"], true);
        assert_eq!(mesh["health"]["bbox_mm"]["max"], json!([100.0, 100.0, 100.0]));
        assert_eq!(mesh["sha256"], sha256(&cube(10.0)));
    }
    assert_eq!(api.get("/api/v1/meshes").await.ok(200)["items"].as_array().expect("a list").len(), 1);
}

fn form(field: &str) -> ([(&'static str, &'static str); 1], String) {
    let head = format!("--x\r\ncontent-disposition: form-data; name=\"{field}\"; filename=\"../../a.stl\"\r\n\r\n");
    ([("content-type", "multipart/form-data; boundary=x")], format!("{head}{}\r\n--x--\r\n", cube(10.0)))
}

#[tokio::test]
async fn a_form_is_taken_by_its_field() {
    let api = Api::start().await;
    let (headers, body) = form("file");
    let mesh = api.send("POST", "/api/v1/meshes?unit=mm", &headers, body.clone()).await.ok(201);
    assert_eq!(mesh["sha256"], sha256(&cube(10.0)));
    // The name of the file, without the folders that a browser may send; one that is given goes first.
    assert_eq!(mesh["name"], "a.stl");
    let named = api.send("POST", "/api/v1/meshes?unit=mm&name=housing", &headers, body.clone()).await.ok(201);
    assert_eq!(named["name"], "housing");
    api.send("POST", "/api/v1/meshes?unit=mm", &headers, "--x--\r\n").await.problem_at("bad_body", &["file"]);
    // An empty file is the same as an empty body, and as an empty scan.
    let empty = body.replace(&cube(10.0), "");
    for (headers, body) in [(&headers[..], empty), (&[], String::new())] {
        let problem = api.send("POST", "/api/v1/meshes?unit=mm", headers, body).await.problem("bad_body");
        assert!(problem["detail"].as_str().expect("text").contains("is empty"), "{problem}");
    }
    // A unit in the form would else be passed over without a word.
    let unit = "--x\r\ncontent-disposition: form-data; name=\"unit\"\r\n\r\nmm\r\n";
    let (before, after) = (format!("{unit}{body}"), body.replace("--x--\r\n", &format!("{unit}--x--\r\n")));
    let twice = body.replace("--x--\r\n", &body);
    for (body, field) in [(form("mesh").1, "mesh"), (before, "unit"), (after, "unit"), (twice, "file")] {
        api.send("POST", "/api/v1/meshes?unit=mm", &headers, body).await.problem_at("bad_body", &[field]);
    }
    api.send("POST", "/api/v1/meshes?unit=mm", &headers, body[..150].to_owned()).await.problem("bad_body");
    api.send("POST", "/api/v1/meshes?unit=mm", &[("content-type", "multipart/form-data")], body).await.problem("bad_body");
    api.nothing_is_left().await;
}

/// The parser keeps what stands beside the file, however long it is.
#[tokio::test]
async fn a_form_with_more_than_its_file_is_cut_off() {
    let api = Api::start().await;
    let (headers, body) = form("file");
    let long = "a".repeat(2 << 20);
    let endless = [
        long.clone(),
        format!("--x\r\ncontent-disposition: form-data; name=\"{long}"),
        body.replace("--x--\r\n", &format!("--x\r\ncontent-disposition: form-data; name=\"{long}")),
    ];
    for body in endless {
        let problem = api.send("POST", "/api/v1/meshes?unit=mm", &headers, body).await.problem("too_large");
        assert!(problem["detail"].as_str().is_some_and(|detail| detail.contains("beside its field")), "{problem}");
    }
    // Half of that in the preamble and most of it in the file.
    let file = format!("{}v 1 0 0\nv 0 1 0\nv 0 0 1\nf -1 -2 -3\n", "# a line\n".repeat(1 << 16));
    let head = "--x\r\ncontent-disposition: form-data; name=\"file\"; filename=\"a.obj\"\r\n\r\n";
    let half = format!("{}\r\n", &long[..1 << 19]);
    api.send("POST", "/api/v1/meshes?unit=mm", &headers, format!("{half}{head}{file}\r\n--x--\r\n")).await.ok(201);
}

#[tokio::test]
async fn a_digest_is_held_against_the_file() {
    let api = Api::start().await;
    let right = format!("sha-512=:eA==:, sha-256=:{}:", BASE64_STANDARD.encode(Sha256::digest(cube(10.0))));
    api.send("POST", "/api/v1/meshes?unit=mm", &[("content-digest", &right)], cube(10.0)).await.ok(201);
    api.send("POST", "/api/v1/meshes?unit=mm", &[("content-digest", &right)], cube(11.0)).await.problem("digest_mismatch");
    for unreadable in ["", "sha-256=abc", "sha-256=:eA==:", "md5=:eA==:", "sha-256=::", "\u{e4}"] {
        let answer = api.send("POST", "/api/v1/meshes?unit=mm", &[("content-digest", unreadable)], cube(10.0)).await;
        answer.problem_at("bad_digest", &["Content-Digest"]);
    }
}

/// The digest of the content, which RFC 9530 defines, was held against the file in the form and refused.
#[tokio::test]
async fn a_digest_of_a_form_is_that_of_the_whole_or_of_its_file() {
    let api = Api::start().await;
    let ([kind], body) = form("file");
    // What follows the last boundary is a part of the content.
    let body = format!("a preamble\r\n{body}and the end");
    let encoded = |bytes: &str| format!("sha-256=:{}:", BASE64_STANDARD.encode(Sha256::digest(bytes)));
    for digest in [encoded(&body), encoded(&cube(10.0))] {
        let mesh =
            api.send("POST", "/api/v1/meshes?unit=mm", &[kind, ("content-digest", digest.as_str())], body.clone()).await.ok(201);
        assert_eq!(mesh["sha256"], sha256(&cube(10.0)));
    }
    let other = encoded("another body");
    let answer = api.send("POST", "/api/v1/meshes?unit=mm", &[kind, ("content-digest", other.as_str())], body.clone()).await;
    let problem = answer.problem("digest_mismatch");
    let detail = problem["detail"].as_str().expect("text");
    for sha256 in [sha256(&body), sha256(&cube(10.0)), sha256("another body")] {
        assert!(detail.contains(&sha256), "{detail}");
    }
    api.nothing_is_left().await;
}

#[tokio::test]
async fn what_is_too_large_is_refused_before_and_while_it_comes() {
    let limit = 1000;
    let api = Api::start_with(vantage::service::Options { max_upload_bytes: limit, ..service_options() }, http_options()).await;
    let announced = api.send("POST", "/api/v1/meshes?unit=mm", &[("content-length", "1001")], "").await;
    assert!(announced.problem("too_large")["detail"].as_str().is_some_and(|detail| detail.contains("1000")));
    let endless = stream::repeat_with(|| Ok::<_, std::io::Error>(Bytes::from_static(&[0; 100])));
    api.send("POST", "/api/v1/meshes?unit=mm", &[], Body::from_stream(endless)).await.problem("too_large");
    api.nothing_is_left().await;
}

#[tokio::test]
async fn a_body_that_stalls_or_breaks_leaves_nothing() {
    let api = Api::start().await;
    let stalls = stream::pending::<Result<Bytes, std::io::Error>>();
    api.send("POST", "/api/v1/meshes?unit=mm", &[], Body::from_stream(stalls)).await.problem("request_timeout");
    let breaks = stream::iter([Ok(Bytes::from_static(b"solid")), Err(std::io::Error::other("gone"))]);
    api.send("POST", "/api/v1/meshes?unit=mm", &[], Body::from_stream(breaks)).await.problem("bad_body");
    api.nothing_is_left().await;
}

#[tokio::test]
async fn a_body_that_drips_is_given_up() {
    let api = Api::start().await;
    let drips = stream::unfold((), |()| async {
        tokio::time::sleep(Duration::from_millis(50)).await;
        Some((Ok::<_, std::io::Error>(Bytes::from_static(b"s")), ()))
    });
    let began = Instant::now();
    let refused = api.send("POST", "/api/v1/meshes?unit=mm", &[], Body::from_stream(drips)).await.problem("request_timeout");
    assert!(refused["detail"].as_str().is_some_and(|said| said.contains("less than 1024 bytes a second")), "{refused}");
    assert!(began.elapsed() < Duration::from_secs(5), "{:?}", began.elapsed());
    api.nothing_is_left().await;
}

#[tokio::test]
async fn what_is_no_mesh_is_refused() {
    let api = Api::start_with(vantage::service::Options { max_triangles: 11, ..service_options() }, http_options()).await;
    for body in ["nonsense", "solid x\nfacet", "ply\nformat ascii 1.0\nelement vertex 4000000000\nend_header\n", &cube(1.0)] {
        let answer = api.send("POST", "/api/v1/meshes?unit=mm", &[], body.to_owned()).await;
        answer.problem("mesh_unreadable");
    }
    assert_eq!(api.get("/api/v1/meshes").await.ok(200)["items"], json!([]));
}

#[tokio::test]
async fn pages_go_through_all_meshes_once() {
    let api = Api::start().await;
    let mut ids = Vec::new();
    for edge in 1..=5 {
        let path = format!("/api/v1/meshes?unit=mm&name=cube%20{edge}");
        ids.push(api.send("POST", &path, &[], cube(f64::from(edge))).await.ok(201)["id"].clone());
    }
    ids.reverse();
    let (mut found, mut path) = (Vec::new(), "/api/v1/meshes?page_size=2".to_owned());
    let token = loop {
        let page = api.get(&path).await.ok(200);
        found.extend(page["items"].as_array().expect("a list").iter().map(|mesh| mesh["id"].clone()));
        let Some(token) = page["next_page_token"].as_str() else { break path };
        path = format!("/api/v1/meshes?page_size=2&page_token={token}");
    };
    assert_eq!(found, ids);
    let token = token.rsplit_once('=').expect("a token").1;
    // A token holds for its own listing only, and none can be made up.
    api.get(&format!("/api/v1/jobs?page_token={token}")).await.problem_at("bad_page_token", &["page_token"]);
    for made_up in
        ["", "x", "0.0", &token.replace('-', "'"), &format!("{token}0"), &format!("{token}.f"), "%00", &"9".repeat(5000)]
    {
        api.get(&format!("/api/v1/meshes?page_token={made_up}")).await.problem("bad_page_token");
    }
}

#[tokio::test]
async fn a_mesh_is_given_back_as_it_came_and_as_a_preview() {
    let api = Api::start().await;
    let id = api.mesh().await;
    let mesh = api.get(&format!("/api/v1/meshes/{id}")).await.ok(200);
    let file = api.get(&format!("/api/v1/meshes/{id}/file")).await;
    assert_eq!(file.text(), cube(10.0));
    assert_eq!(file.header("etag"), format!("\"{}\"", mesh["sha256"].as_str().expect("a hash")));
    assert_eq!(file.header("content-disposition"), "attachment; filename=\"cube.stl\"");
    assert!(file.header("cache-control").contains("immutable"));
    for _ in 0..2 {
        let preview = api.get(&format!("/api/v1/meshes/{id}/preview.glb")).await;
        assert_eq!((preview.header("content-type"), &preview.bytes[..4]), ("model/gltf-binary", &b"glTF"[..]));
    }
    for part in ["file", "preview.glb"] {
        let path = format!("/api/v1/meshes/{id}/{part}");
        let etag = api.get(&path).await.header("etag").to_owned();
        for known in [etag.clone(), format!("\"other\", W/{etag}"), "*".to_owned()] {
            let answer = api.send("GET", &path, &[("if-none-match", &known)], "").await;
            assert_eq!((answer.status.as_u16(), answer.header("etag"), answer.bytes.len()), (304, etag.as_str(), 0));
        }
        assert_eq!(api.send("GET", &path, &[("if-none-match", "\"other\"")], "").await.status, 200);
    }
    assert_eq!(api.send("DELETE", &format!("/api/v1/meshes/{id}"), &[], "").await.status, 204);
    for part in ["", "/file", "/preview.glb"] {
        api.get(&format!("/api/v1/meshes/{id}{part}")).await.problem("mesh_not_found");
    }
}

#[tokio::test]
async fn a_mesh_that_a_job_needs_stays() {
    let api = Api::start().await;
    let job = api.job("wait").await;
    let mesh = api.get(&format!("/api/v1/jobs/{job}")).await.ok(200)["mesh_id"].as_str().expect("an id").to_owned();
    api.send("DELETE", &format!("/api/v1/meshes/{mesh}"), &[], "").await.problem("mesh_in_use");
    api.post_json(&format!("/api/v1/jobs/{job}/cancel"), &json!(null)).await.ok(202);
    api.ended(&job).await;
    assert_eq!(api.send("DELETE", &format!("/api/v1/meshes/{mesh}"), &[], "").await.status, 204);
    assert_eq!(api.get(&format!("/api/v1/jobs/{job}")).await.ok(200)["mesh_id"], mesh);
}
