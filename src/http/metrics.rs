//! Numbers for Prometheus.

use std::sync::OnceLock;

use axum::http::Method;
use metrics_exporter_prometheus::{Matcher, PrometheusBuilder, PrometheusHandle};

/// Upper ends of the histograms' buckets, seconds: answers, and attempts at jobs.
const ANSWER_SECONDS: [f64; 9] = [0.001, 0.005, 0.02, 0.05, 0.1, 0.25, 1.0, 5.0, 30.0];
const ATTEMPT_SECONDS: [f64; 8] = [1.0, 5.0, 15.0, 60.0, 180.0, 600.0, 1800.0, 7200.0];

/// Where the process's numbers are collected; the `metrics` crate has one place for the process.
static COLLECTED: OnceLock<Option<PrometheusHandle>> = OnceLock::new();

/// Begins to collect. Numbers before it are lost; calling it again changes nothing.
pub fn install() {
    COLLECTED.get_or_init(|| {
        let builder = PrometheusBuilder::new()
            .set_buckets_for_metric(Matcher::Full("vantage_http_seconds".to_owned()), &ANSWER_SECONDS)
            .and_then(|b| b.set_buckets_for_metric(Matcher::Full("vantage_attempt_seconds".to_owned()), &ATTEMPT_SECONDS));
        builder.and_then(PrometheusBuilder::install_recorder).ok()
    });
}

/// Everything collected, in Prometheus's text format.
pub(super) fn text() -> String {
    let handle = COLLECTED.get().and_then(Option::as_ref);
    handle
        .map(|handle| {
            handle.run_upkeep();
            handle.render()
        })
        .unwrap_or_default()
}

/// Counts one answer.
pub(super) fn count_request(method: &Method, route: &str, status: u16, seconds: f64) {
    let labels = [("method", name(method).to_owned()), ("route", route.to_owned()), ("status", status.to_string())];
    metrics::counter!("vantage_http_requests_total", &labels).increment(1);
    metrics::histogram!("vantage_http_seconds", "route" => route.to_owned()).record(seconds);
}

/// Methods by name; one that a client invents must not become a time series.
fn name(method: &Method) -> &str {
    match *method {
        Method::GET | Method::HEAD | Method::POST | Method::PUT | Method::DELETE | Method::OPTIONS | Method::PATCH => {
            method.as_str()
        }
        _ => "other",
    }
}
