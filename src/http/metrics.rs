//! Prometheus metrics.

use std::io;
use std::sync::OnceLock;
use std::thread::JoinHandle;
use std::time::Duration;

use axum::http::Method;
use metrics_exporter_prometheus::{Matcher, PrometheusBuilder, PrometheusHandle};

/// Upper bounds of the histogram buckets of responses, seconds.
const RESPONSE_SECONDS: [f64; 9] = [0.001, 0.005, 0.02, 0.05, 0.1, 0.25, 1.0, 5.0, 30.0];
/// Upper bounds of the histogram buckets of job attempts, seconds.
const ATTEMPT_SECONDS: [f64; 8] = [1.0, 5.0, 15.0, 60.0, 180.0, 600.0, 1800.0, 7200.0];

/// Upper bounds of the histogram buckets of runs, seconds.
const RUN_SECONDS: [f64; 7] = [10.0, 30.0, 60.0, 120.0, 300.0, 900.0, 3600.0];
/// Upper bounds of the histogram buckets of stops, seconds.
const STOP_SECONDS: [f64; 9] = [0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.2, 1.0, 5.0];

/// Upper bounds of the histogram buckets of the jitter of streamed set points, seconds.
const JITTER_SECONDS: [f64; 8] = [0.000_05, 0.000_1, 0.000_2, 0.000_5, 0.001, 0.002, 0.005, 0.02];

/// Interval at which recorded values are added to their buckets; each is held by itself until then.
const UPKEEP: Duration = Duration::from_secs(5);

/// Recorder of the process's metrics; the `metrics` crate has one per process.
static RECORDER: OnceLock<Option<PrometheusHandle>> = OnceLock::new();

/// Installs the recorder. Earlier values are lost; further calls have no effect.
pub fn install() {
    RECORDER.get_or_init(|| {
        let builder = PrometheusBuilder::new()
            .set_buckets_for_metric(Matcher::Full("vantage_http_seconds".to_owned()), &RESPONSE_SECONDS)
            .and_then(|b| b.set_buckets_for_metric(Matcher::Full("vantage_attempt_seconds".to_owned()), &ATTEMPT_SECONDS))
            .and_then(|b| b.set_buckets_for_metric(Matcher::Full("vantage_run_seconds".to_owned()), &RUN_SECONDS))
            .and_then(|b| b.set_buckets_for_metric(Matcher::Full("vantage_run_stop_seconds".to_owned()), &STOP_SECONDS))
            .and_then(|b| b.set_buckets_for_metric(Matcher::Full("vantage_run_jitter_seconds".to_owned()), &JITTER_SECONDS));
        let handle = builder.and_then(PrometheusBuilder::install_recorder).ok()?;
        let of_thread = handle.clone();
        // Without a thread, whoever reads the metrics keeps them up.
        let _ = keep_up(UPKEEP, move || of_thread.run_upkeep());
        Some(handle)
    });
}

/// Starts a thread that calls `upkeep` at every interval, as long as the process lives: values of histograms would else pile up
/// until somebody reads the metrics.
fn keep_up(interval: Duration, upkeep: impl Fn() + Send + 'static) -> io::Result<JoinHandle<()>> {
    std::thread::Builder::new().name("metrics".to_owned()).spawn(move || {
        loop {
            std::thread::sleep(interval);
            upkeep();
        }
    })
}

/// Renders all metrics in Prometheus's text format.
pub(super) fn render() -> String {
    let handle = RECORDER.get().and_then(Option::as_ref);
    handle
        .map(|handle| {
            handle.run_upkeep();
            handle.render()
        })
        .unwrap_or_default()
}

/// Counts one response.
pub(super) fn count_request(method: &Method, route: &str, status: u16, seconds: f64) {
    let labels = [("method", name(method).to_owned()), ("route", route.to_owned()), ("status", status.to_string())];
    metrics::counter!("vantage_http_requests_total", &labels).increment(1);
    metrics::histogram!("vantage_http_seconds", "route" => route.to_owned()).record(seconds);
}

/// Name of a method; one that a client invents must not become a time series.
fn name(method: &Method) -> &str {
    match *method {
        Method::GET | Method::HEAD | Method::POST | Method::PUT | Method::DELETE | Method::OPTIONS | Method::PATCH => {
            method.as_str()
        }
        _ => "other",
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc;

    use super::*;

    #[test]
    fn metrics_are_kept_up_though_nobody_reads_them() {
        let (kept_up, turns) = mpsc::channel();
        let upkeep = move || {
            // Nobody waits for the turns after the second.
            let _ = kept_up.send(());
        };
        keep_up(Duration::from_millis(1), upkeep).expect("a thread");
        turns.recv().expect("a turn");
        turns.recv().expect("another");
    }
}
