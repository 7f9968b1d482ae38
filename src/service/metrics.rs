//! Metrics of the process, for Prometheus.

use std::sync::OnceLock;

use prometheus::core::Collector;
use prometheus::{
    Gauge, GaugeVec, Histogram, HistogramOpts, HistogramVec, IntCounter, IntCounterVec, Opts, Registry, TextEncoder,
};

/// Media type of the text format (<https://prometheus.io/docs/instrumenting/exposition_formats/>).
pub(crate) const TEXT_FORMAT: &str = "text/plain; version=0.0.4; charset=utf-8";

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

/// Every metric of the process.
pub(crate) struct Metrics {
    registry: Registry,
    /// Responses by method, route and status.
    pub http_requests: IntCounterVec,
    /// Times of responses by route, s.
    pub http_seconds: HistogramVec,
    /// Open connections.
    pub connections: Gauge,
    /// Connections closed at once, since too many were open.
    pub connections_refused: IntCounter,
    /// 1 while a changed file of API keys cannot be used, else 0.
    pub api_keys_file_unreadable: Gauge,
    /// Open jobs by state.
    pub jobs: GaugeVec,
    /// Attempts at jobs by the state that they ended in.
    pub attempts: IntCounterVec,
    /// Times of attempts, s.
    pub attempt_seconds: Histogram,
    /// Open runs by state.
    pub runs: GaugeVec,
    /// Runs that ended, by mode and state.
    pub run_ended: IntCounterVec,
    /// Times of runs by mode, s.
    pub run_seconds: HistogramVec,
    /// Times from the order to stop to each stage of the stop, s.
    pub run_stop_seconds: HistogramVec,
    /// Jitter of streamed set points, s.
    pub run_jitter_seconds: Histogram,
    /// Periods in which no set point was sent.
    pub run_periods_missed: IntCounter,
    /// Rows and files of the store that are known to be damaged.
    pub store_damaged: Gauge,
}

/// Metrics of the process, once they are installed.
static METRICS: OnceLock<Option<Metrics>> = OnceLock::new();

/// Installs the metrics of the process: without them nothing is counted. Further calls have no effect.
pub fn install() {
    METRICS.get_or_init(|| {
        let made = Metrics::new();
        made.inspect_err(|error| tracing::error!(error = error as &dyn std::error::Error, "there are no metrics")).ok()
    });
}

/// Calls `change` with the metrics of the process, where they are installed.
pub(crate) fn record(change: impl FnOnce(&Metrics)) {
    if let Some(metrics) = METRICS.get().and_then(Option::as_ref) {
        change(metrics);
    }
}

/// All metrics in the text format of Prometheus; nothing where they are not installed.
pub(crate) fn text() -> String {
    let metrics = METRICS.get().and_then(Option::as_ref);
    let encoded = metrics.map(|metrics| TextEncoder::new().encode_to_string(&metrics.registry.gather()));
    encoded.and_then(Result::ok).unwrap_or_default()
}

impl Metrics {
    fn new() -> prometheus::Result<Self> {
        let registry = Registry::new();
        let of = &registry;
        let stages = "Time from the order to stop until it is sent, acknowledged, and the device at rest";
        Ok(Self {
            http_requests: counters(of, "vantage_http_requests_total", "Responses", &["method", "route", "status"])?,
            http_seconds: histograms(of, "vantage_http_seconds", "Time to the response headers", &RESPONSE_SECONDS, "route")?,
            connections: gauge(of, "vantage_connections", "Open connections")?,
            connections_refused: counter(of, "vantage_connections_refused_total", "Connections closed, as too many were open")?,
            api_keys_file_unreadable: gauge(
                of,
                "vantage_api_keys_file_unreadable",
                "1 while the changed file of API keys cannot be used and its earlier keys are in force",
            )?,
            jobs: gauges(of, "vantage_jobs", "Open jobs; NaN while the store cannot be read", "state")?,
            attempts: counters(of, "vantage_attempts_total", "Attempts at jobs by the state of the job after it", &["state"])?,
            attempt_seconds: histogram(of, "vantage_attempt_seconds", "Time of an attempt at a job", &ATTEMPT_SECONDS)?,
            runs: gauges(of, "vantage_runs", "Open runs; NaN while the store cannot be read", "state")?,
            run_ended: counters(of, "vantage_run_ended_total", "Runs that ended", &["mode", "state"])?,
            run_seconds: histograms(of, "vantage_run_seconds", "Time of a run", &RUN_SECONDS, "mode")?,
            run_stop_seconds: histograms(of, "vantage_run_stop_seconds", stages, &STOP_SECONDS, "stage")?,
            run_jitter_seconds: histogram(
                of,
                "vantage_run_jitter_seconds",
                "Difference between the period of streamed set points and the time between two of them",
                &JITTER_SECONDS,
            )?,
            run_periods_missed: counter(of, "vantage_run_periods_missed_total", "Periods in which no set point was sent")?,
            store_damaged: gauge(of, "vantage_store_damaged", "Rows and files of the store that are damaged")?,
            registry,
        })
    }
}

fn registered<M: Collector + Clone + 'static>(registry: &Registry, metric: prometheus::Result<M>) -> prometheus::Result<M> {
    let metric = metric?;
    registry.register(Box::new(metric.clone()))?;
    Ok(metric)
}

fn counter(registry: &Registry, name: &str, help: &str) -> prometheus::Result<IntCounter> {
    registered(registry, IntCounter::new(name, help))
}

fn counters(registry: &Registry, name: &str, help: &str, labels: &[&str]) -> prometheus::Result<IntCounterVec> {
    registered(registry, IntCounterVec::new(Opts::new(name, help), labels))
}

fn gauge(registry: &Registry, name: &str, help: &str) -> prometheus::Result<Gauge> {
    registered(registry, Gauge::new(name, help))
}

fn gauges(registry: &Registry, name: &str, help: &str, label: &str) -> prometheus::Result<GaugeVec> {
    registered(registry, GaugeVec::new(Opts::new(name, help), &[label]))
}

fn histogram(registry: &Registry, name: &str, help: &str, buckets: &[f64]) -> prometheus::Result<Histogram> {
    registered(registry, Histogram::with_opts(HistogramOpts::new(name, help).buckets(buckets.to_vec())))
}

fn histograms(registry: &Registry, name: &str, help: &str, buckets: &[f64], label: &str) -> prometheus::Result<HistogramVec> {
    let options = HistogramOpts::new(name, help).buckets(buckets.to_vec());
    registered(registry, HistogramVec::new(options, &[label]))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Names, labels and buckets are what dashboards and alerts of users refer to.
    #[test]
    fn every_metric_is_rendered_with_its_labels_and_buckets() {
        let metrics = Metrics::new().expect("metrics");
        metrics.http_requests.with_label_values(&["GET", "/healthz", "200"]).inc_by(3);
        metrics.http_seconds.with_label_values(&["/healthz"]).observe(0.004);
        metrics.http_seconds.with_label_values(&["/healthz"]).observe(60.0);
        metrics.connections.inc();
        metrics.jobs.with_label_values(&["queued"]).set(f64::NAN);
        metrics.runs.with_label_values(&["running"]).set(0.0);
        let text = TextEncoder::new().encode_to_string(&metrics.registry.gather()).expect("text");
        for line in [
            "# TYPE vantage_http_requests_total counter",
            "vantage_http_requests_total{method=\"GET\",route=\"/healthz\",status=\"200\"} 3",
            "# TYPE vantage_http_seconds histogram",
            "vantage_http_seconds_bucket{route=\"/healthz\",le=\"0.001\"} 0",
            "vantage_http_seconds_bucket{route=\"/healthz\",le=\"0.005\"} 1",
            "vantage_http_seconds_bucket{route=\"/healthz\",le=\"30\"} 1",
            "vantage_http_seconds_bucket{route=\"/healthz\",le=\"+Inf\"} 2",
            "vantage_http_seconds_count{route=\"/healthz\"} 2",
            "vantage_connections 1",
            "vantage_connections_refused_total 0",
            "vantage_jobs{state=\"queued\"} NaN",
            "vantage_runs{state=\"running\"} 0",
            "vantage_run_jitter_seconds_bucket{le=\"0.00005\"} 0",
            "vantage_store_damaged 0",
        ] {
            assert!(text.lines().any(|each| each == line), "{line} is missing in\n{text}");
        }
    }
}
