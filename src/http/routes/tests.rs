//! Responses that say that the client has the current version: a cache takes their headers over.

use axum::http::header::{CONTENT_SECURITY_POLICY, IF_NONE_MATCH, VARY};

use super::jobs::keyed;
use super::results::{REPORT_POLICY, add_shared_headers};
use super::*;

fn unchanged(sha256: &str) -> Response {
    let mut headers = HeaderMap::new();
    headers.insert(IF_NONE_MATCH, format!("\"{sha256}\"").parse().expect("a header"));
    not_modified(&headers, sha256).expect("unchanged")
}

#[test]
fn an_unchanged_resource_is_kept_for_as_long_as_a_new_one() {
    let whole = HeaderMap::from_iter(immutable("ab", "text/html"));
    let unchanged = unchanged("ab");
    assert_eq!(unchanged.status(), StatusCode::NOT_MODIFIED);
    for name in [ETAG, CACHE_CONTROL] {
        assert_eq!(unchanged.headers()[&name], whole[&name]);
    }
    assert!(not_modified(&HeaderMap::new(), "ab").is_none());
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
