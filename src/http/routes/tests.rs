//! Responses that say that the client has the current version: a cache takes their headers over.

use axum::http::header::{CONTENT_SECURITY_POLICY, IF_NONE_MATCH, VARY};

use serde_json::{Value, json};

use super::jobs::{check_beside_presets, keyed};
use super::results::{REPORT_POLICY, add_shared_headers};
use super::*;
use crate::planning::params::{PlanParams, Preset};
use crate::wire::{JobBatchRequest, JobRequest, parse_document};

fn unchanged(sha256: &str) -> Response {
    let mut headers = HeaderMap::new();
    headers.insert(IF_NONE_MATCH, format!("\"{sha256}\"").parse().expect("a header"));
    not_modified(&headers, sha256).expect("any version will do").expect("unchanged")
}

#[test]
fn an_unchanged_resource_is_kept_for_as_long_as_a_new_one() {
    let whole = HeaderMap::from_iter(immutable("ab", "text/html"));
    let unchanged = unchanged("ab");
    assert_eq!(unchanged.status(), StatusCode::NOT_MODIFIED);
    for name in [ETAG, CACHE_CONTROL] {
        assert_eq!(unchanged.headers()[&name], whole[&name]);
    }
    assert!(not_modified(&HeaderMap::new(), "ab").expect("any version will do").is_none());
}

/// The policy of the server's own pages would take an unchanged report its styles and pictures.
#[test]
fn an_unchanged_report_keeps_its_policy_and_its_tag() {
    for (is_sent_packed, etag) in [(true, "W/\"ab\""), (false, "\"ab\"")] {
        let mut report = unchanged("ab");
        add_shared_headers(&mut report, is_sent_packed, "text/html; charset=utf-8");
        let headers = report.headers();
        assert_eq!(headers[CONTENT_SECURITY_POLICY], REPORT_POLICY);
        assert_eq!(
            (&headers[ETAG], &headers[VARY]),
            (&HeaderValue::from_static(etag), &HeaderValue::from_static("accept, accept-encoding"))
        );
    }
}

/// A list that is empty for ever does not tell of the slip.
#[test]
fn a_filter_by_a_label_names_its_key() {
    for keyless in ["", "=", "=3"] {
        let refused = keyed(Some(keyless.to_owned())).expect_err("no label has an empty key");
        assert_eq!(refused.code(), Code::BadQuery, "{refused:?}");
    }
    for label in ["line", "line=", "line=3", "line=a=b"] {
        assert_eq!(keyed(Some(label.to_owned())).expect("a filter").as_deref(), Some(label));
    }
    assert_eq!(keyed(None).expect("no filter"), None);
}

/// A default beside a preset was replaced in silence, other values were refused.
#[test]
fn what_a_preset_sets_otherwise_is_refused_beside_it_in_a_job_and_in_a_batch() {
    let job = |params: &Value| json!({"mesh_id": MeshId::generate(), "params": params});
    let of_one = |params: &Value| {
        let body = job(params).to_string();
        let request: JobRequest = parse_document(body.as_bytes()).expect("a request");
        check_beside_presets(&request, body.as_bytes())
    };
    let beside = json!({"preset": "thesis", "selection": {"solver": "local"}, "score": {"a": 0.7, "b": 0.3}});
    let refused = of_one(&beside).expect_err("the default solver is given");
    assert_eq!(refused.code(), Code::InvalidFields);
    let told = format!("{refused:?}");
    for pointer in ["/params/selection/solver", "/params/score/a", "/params/score/b"] {
        assert_eq!(told.matches(&format!("{pointer:?}")).count(), 1, "{pointer} in {told}");
    }
    assert!(told.contains("is set by preset = thesis; leave it out, or leave out the preset"), "{told}");
    let applied = Preset::Thesis.apply(&PlanParams { preset: Preset::Thesis, ..PlanParams::default() });
    for accepted in [
        json!({"preset": "thesis"}),
        json!({"preset": "thesis", "selection": {"solver": "greedy"}, "seed": 7}),
        json!({"selection": {"solver": "local"}}),
        serde_json::to_value(applied).expect("JSON"),
    ] {
        assert!(of_one(&accepted).is_ok(), "{accepted}");
    }
    let body = json!({"jobs": [job(&json!({})), job(&beside), job(&json!({"selection": {"target": 2}}))]}).to_string();
    let batch: JobBatchRequest = parse_document(body.as_bytes()).expect("a request");
    let told = format!("{:?}", check_beside_presets(&batch, body.as_bytes()).expect_err("the second"));
    assert!(told.contains("\"/jobs/1/params/selection/solver\"") && !told.contains("/jobs/0/"), "{told}");
    assert!(told.contains("\"/jobs/2/params/selection/target\""), "what else is wrong: {told}");
}
