//! Content negotiation and socket timeouts, which the tests of the routes reach only in part.

use std::sync::Arc;
use std::time::{Duration, Instant};

use axum::body::to_bytes;
use axum::http::header::{ACCEPT, ACCEPT_ENCODING, ETAG, IF_NONE_MATCH, VARY};
use axum::http::{HeaderMap, StatusCode};
use axum::response::IntoResponse;
use tokio::io::{AsyncReadExt, AsyncWriteExt, DuplexStream};

use super::download::beyond_end;
use super::negotiate::{Representation, choose};
use super::prefix::Prefix;
use super::problem::{ApiError, Code, finish};
use super::socket::TimeoutStream;
use super::static_response::StaticResponse;
use crate::planning::plan::Cause;
use crate::wire::EventKind;
use crate::wire::plan::RegionCoverageDocument;

const OFFERED: [Representation; 2] = [
    Representation { name: "json", media_type: "application/json", file: std::borrow::Cow::Borrowed("a.json") },
    Representation { name: "csv", media_type: "text/csv; charset=utf-8", file: std::borrow::Cow::Borrowed("a.csv") },
];

fn chosen(accept: &str, asked: Option<&str>) -> Option<&'static str> {
    let mut headers = HeaderMap::new();
    if !accept.is_empty() {
        headers.insert(ACCEPT, accept.parse().expect("a header"));
    }
    choose(&headers, asked.map(|name| ("format", name)), &OFFERED).ok().map(|chosen| chosen.name)
}

#[test]
fn the_representation_follows_accept() {
    for (accept, name) in [
        ("", Some("json")),
        ("*/*", Some("json")),
        ("text/csv", Some("csv")),
        ("TEXT/CSV", Some("csv")),
        ("text/*", Some("csv")),
        ("text/csv;q=0.5, application/json", Some("json")),
        ("text/csv, application/json;q=0.9", Some("csv")),
        ("application/json, text/csv", Some("json")),
        ("*/*;q=0.1, text/csv", Some("csv")),
        ("text/csv;q=0, */*", Some("json")),
        ("text/html,application/xhtml+xml,*/*;q=0.8", Some("json")),
        ("application/json;q=0, text/csv;q=0", None),
        ("text/html", None),
        ("nonsense", None),
        ("text/csv;q=nan", None),
    ] {
        assert_eq!(chosen(accept, None), name, "{accept:?}");
    }
}

/// The detail of the problem was `is not the id of an event`, of nothing in particular.
#[tokio::test]
async fn a_header_at_fault_is_named_in_the_detail() {
    let of_event = ApiError::header(Code::BadRequest, "Last-Event-ID", "is not the id of an event").into_response();
    for (response, name, said) in [
        (beyond_end(5), "Range", "begins at or after the end; the length is 5 bytes"),
        (of_event, "Last-Event-ID", "is not the id of an event"),
    ] {
        let response = finish(response, &Prefix::default(), "/path", "id");
        let body = to_bytes(response.into_body(), 10_000).await.expect("a body");
        let problem: serde_json::Value = serde_json::from_slice(&body).expect("JSON");
        assert_eq!(problem["detail"], format!("The header {name} {said}."));
        assert_eq!(problem["errors"], serde_json::json!([{ "pointer": name, "detail": said }]));
    }
}

#[test]
fn the_query_goes_before_accept() {
    assert_eq!(chosen("application/json", Some("csv")), Some("csv"));
    assert_eq!(chosen("*/*", Some("xml")), None);
}

#[test]
fn an_unchanged_file_has_the_tag_that_it_has_with_its_bytes() {
    let file = StaticResponse::new("a".repeat(1000), "text/plain".to_owned());
    for (encoding, is_weak) in [("gzip", true), ("identity", false)] {
        let mut headers = HeaderMap::new();
        headers.insert(ACCEPT_ENCODING, encoding.parse().expect("a header"));
        let whole = file.respond(&headers);
        let tag = whole.headers()[ETAG].clone();
        assert_eq!(tag.as_bytes().starts_with(b"W/"), is_weak, "{encoding}");
        headers.insert(IF_NONE_MATCH, tag);
        let unchanged = file.respond(&headers);
        assert_eq!(unchanged.status(), StatusCode::NOT_MODIFIED);
        for name in [ETAG, VARY] {
            assert_eq!(unchanged.headers()[&name], whole.headers()[&name], "{encoding}");
        }
    }
}

const PREFACE: Duration = Duration::from_millis(200);
const STALL: Duration = Duration::from_millis(400);

fn guarded(buffer: usize) -> (DuplexStream, TimeoutStream<DuplexStream>) {
    let (client, server) = tokio::io::duplex(buffer);
    (client, TimeoutStream::new(server, PREFACE, STALL, Arc::default()))
}

/// Checks that a client was cut off at the limit; later by a margin, for busy machines.
/// `after` counts from before the stream was made, whose limit runs from then on.
#[track_caller]
fn assert_cut_off(error: &std::io::Error, after: Duration, limit: Duration) {
    assert_eq!(error.kind(), std::io::ErrorKind::TimedOut);
    assert!((limit..limit * 10).contains(&after), "{after:?}");
}

#[tokio::test]
async fn a_client_that_says_nothing_is_cut_off() {
    let began = Instant::now();
    let (_client, mut guarded) = guarded(64);
    assert_cut_off(&guarded.read_u8().await.expect_err("cut off"), began.elapsed(), PREFACE);
}

#[tokio::test]
async fn a_client_that_drips_is_cut_off_all_the_same() {
    let began = Instant::now();
    let (mut client, mut guarded) = guarded(64);
    tokio::spawn(async move {
        for byte in *b"PRI * HTTP/2.0" {
            client.write_all(&[byte]).await.expect("open");
            tokio::time::sleep(PREFACE / 4).await;
        }
        std::future::pending::<()>().await;
    });
    let error = loop {
        if let Err(error) = guarded.read_u8().await {
            break error;
        }
    };
    assert_cut_off(&error, began.elapsed(), PREFACE);
}

#[tokio::test]
async fn an_answered_client_may_wait_with_its_next_request() {
    let (mut client, mut guarded) = guarded(64);
    client.write_all(b"GET /").await.expect("open");
    guarded.read_exact(&mut [0; 5]).await.expect("a request");
    guarded.write_all(b"answer").await.expect("an answer");
    tokio::spawn(async move {
        tokio::time::sleep(3 * PREFACE).await;
        client.write_all(b"!").await.expect("open");
        std::future::pending::<()>().await;
    });
    assert_eq!(guarded.read_u8().await.expect("not cut off"), b'!');
}

#[tokio::test]
async fn a_client_that_takes_nothing_is_cut_off() {
    let began = Instant::now();
    let (_client, mut guarded) = guarded(8);
    assert_cut_off(&guarded.write_all(&[0; 64]).await.expect_err("cut off"), began.elapsed(), STALL);
}

#[tokio::test]
async fn a_client_that_takes_its_answer_slowly_is_not() {
    let (mut client, mut guarded) = guarded(8);
    tokio::spawn(async move {
        let mut piece = [0; 8];
        while client.read_exact(&mut piece).await.is_ok() {
            tokio::time::sleep(STALL / 4).await;
        }
    });
    let began = Instant::now();
    guarded.write_all(&[0; 64]).await.expect("taken");
    assert!(began.elapsed() > STALL);
}

#[tokio::test]
async fn what_is_still_being_sent_does_not_take_the_answer_away() {
    let (mut client, mut guarded) = guarded(64);
    let sending = tokio::spawn(async move {
        for _ in 0..8 {
            client.write_all(&[0; 64]).await.expect("it is read");
        }
        client.shutdown().await.expect("the end");
        let mut answer = String::new();
        client.read_to_string(&mut answer).await.expect("the answer");
        answer
    });
    guarded.write_all(b"refused").await.expect("written");
    guarded.shutdown().await.expect("closed");
    assert_eq!(sending.await.expect("sent"), "refused");
}

#[tokio::test]
async fn a_client_that_goes_on_sending_is_not_listened_to_for_long() {
    let (mut client, mut guarded) = guarded(64);
    tokio::spawn(async move {
        while client.write_all(&[0; 8]).await.is_ok() {
            tokio::time::sleep(STALL / 8).await;
        }
    });
    let began = Instant::now();
    guarded.shutdown().await.expect("closed");
    assert!(began.elapsed() < Duration::from_secs(5), "{:?}", began.elapsed());
}

/// The page knows two kinds by name, and reads the job anew at any other.
#[test]
fn the_page_handles_every_kind_of_event() {
    let page = include_str!("../../static/src/jobs.ts");
    for (name, kind) in [("PROGRESS", EventKind::Progress), ("DELETED", EventKind::Deleted)] {
        assert!(page.contains(&format!("const {name} = \"{}\";", kind.as_str())), "{name}");
        assert!(page.contains(&format!("kind === {name}")), "{name}");
    }
    let function = page.split("function applyEvent(").nth(1).and_then(|rest| rest.split("\n}\n").next()).unwrap_or_default();
    assert!(function.contains("} else {") && function.contains("refresh(about.job_id)"), "{function}");
}

/// The page once asked for each job that it listed, and for each that waited whenever anything happened.
#[test]
fn the_page_lists_jobs_by_one_request() {
    let script = include_str!("../../static/src/jobs.ts");
    let function = |name: &str| {
        let rest = script.split(&format!("function {name}(")).nth(1).unwrap_or_else(|| panic!("{name} is not there"));
        rest.split("\n}\n").next().unwrap_or_default()
    };
    assert!(function("listJobs").contains("page_size=") && !function("listJobs").contains("/jobs/$"));
    assert!(function("moveUp").contains("state=queued") && !function("moveUp").contains("/jobs/$"));
    // One job that changed, and the regions of one.
    assert_eq!(script.matches("(`/jobs/${id}").count(), 2);
    let row = include_str!("../../static/src/joblist.tsx");
    for field in ["summary", "submitted_by", "queue_position"] {
        assert!(row.contains(&format!("job.{field}")), "{field}");
    }
}

#[test]
fn the_page_shows_every_figure_of_a_region_by_the_name_that_answers_have() {
    let script = include_str!("../../static/src/job.tsx");
    let region = RegionCoverageDocument {
        name: String::new(),
        kind: String::new(),
        samples: 0,
        asked_area_mm2: 0.0,
        coverable_area_mm2: 0.0,
        measured_area_mm2: 0.0,
        of_asked: 0.0,
        of_coverable: 0.0,
        target: Some(0.0),
        met: Some(true),
        tolerance_mm: Some(0.0),
        min_tolerance_mm: None,
        missed: Vec::new(),
        beyond_noise_area_mm2: 0.0,
        independent_samples: None,
        independent_of_asked: None,
        independent_standard_error: None,
        independently_met: None,
        why_unmet: Some(String::new()),
    };
    let region = serde_json::to_value(region).expect("JSON");
    for field in ["name", "kind", "tolerance_mm", "asked_area_mm2", "samples", "target", "of_asked", "met", "why_unmet"] {
        assert!(region.get(field).is_some(), "{field} is in no answer");
        assert!(script.contains(&format!("region.{field}")), "{field}");
    }
    assert!(include_str!("../../static/src/results.tsx").contains("RegionTable"), "the place of the table");
}

/// The preview is coloured by these bytes in the browser, which asks for no list of them.
#[test]
fn the_page_knows_the_meaning_of_every_byte_of_the_coverage() {
    let script = include_str!("../../static/src/bytes.ts");
    let words = include_str!("../../static/src/text.ts");
    let mut at = 0;
    // In the order of their bytes: causes that came later are last.
    let (later, first): (Vec<Cause>, Vec<Cause>) = Cause::ALL.into_iter().partition(|cause| *cause == Cause::Exposure);
    for cause in first.into_iter().chain(later).map(Cause::as_str) {
        at += script[at..].find(&format!("\"{cause}\"")).unwrap_or_else(|| panic!("{cause} is not where it belongs"));
        assert!(words.contains(&format!("{cause}: \"")), "{cause} has no words");
    }
}

/// A browser has six connections to a server for all its pages, and an answer that the server keeps waiting holds one of them.
#[test]
fn the_page_waits_for_an_answer_only_while_it_is_seen() {
    let sources = std::fs::read_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/static/src")).expect("the folder");
    let mut waits = 0;
    for source in sources {
        let path = source.expect("an entry").path();
        let script = std::fs::read_to_string(&path).expect("text");
        for line in script.lines().filter(|line| line.contains("?wait=")) {
            assert!(line.contains("askSeen"), "{}: {line}", path.display());
            waits += 1;
        }
    }
    assert_eq!(waits, 2, "a calibration, and the end of a run");
    let script = include_str!("../../static/src/api.ts");
    let function = script.split("function askSeen").nth(1).and_then(|rest| rest.split("\n}\n").next()).unwrap_or_default();
    assert!(function.contains("document.addEventListener(\"visibilitychange\", end)"), "{function}");
    assert!(function.contains("signal: phase.signal"), "{function}");
}
