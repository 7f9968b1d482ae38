//! Every route and what it refuses: a table, from which no route may be missing.

use std::collections::BTreeSet;

use serde_json::json;

use super::api::{Api, cube};

const NOBODY: &str = "01a1f77c-78a1-7554-855a-a9513c22aa2b";

/// Bodies of requests that are well formed.
const RUN_OF_NOBODY: &str = "{\"job_id\":\"01a1f77c-78a1-7554-855a-a9513c22aa2b\"}";
const ARM: &str = "{\"operator\":\"A\",\"cell\":\"a\"}";

/// Route, and path with query, method, content type, body and the code it is refused with.
type Case = (&'static str, &'static str, &'static str, &'static str, &'static str, &'static str);

const CASES: &[Case] = &[
    ("/api/v1/meshes", "/api/v1/meshes", "POST", "", "x", "bad_query"),
    ("/api/v1/meshes", "/api/v1/meshes?unit=furlong", "POST", "", "x", "bad_query"),
    ("/api/v1/meshes", "/api/v1/meshes?unit=mm&unit=mm", "POST", "", "x", "bad_query"),
    ("/api/v1/meshes", "/api/v1/meshes?unit=mm&size=1", "POST", "", "x", "bad_query"),
    ("/api/v1/meshes", "/api/v1/meshes?unit=mm&name=", "POST", "", "x", "bad_query"),
    ("/api/v1/meshes", "/api/v1/meshes?unit=mm&name=a%0ab", "POST", "", "x", "bad_query"),
    ("/api/v1/meshes", "/api/v1/meshes?unit=mm&name=%ff%fe", "POST", "", "x", "bad_query"),
    ("/api/v1/meshes", "/api/v1/meshes?unit=mm", "POST", "", "x", "mesh_unreadable"),
    ("/api/v1/meshes", "/api/v1/meshes?page_size=0", "GET", "", "", "bad_query"),
    ("/api/v1/meshes", "/api/v1/meshes?page_size=1001", "GET", "", "", "bad_query"),
    ("/api/v1/meshes", "/api/v1/meshes?page_size=many", "GET", "", "", "bad_query"),
    ("/api/v1/meshes", "/api/v1/meshes?state=queued", "GET", "", "", "bad_query"),
    ("/api/v1/meshes", "/api/v1/meshes", "PATCH", "", "", "method_not_allowed"),
    ("/api/v1/meshes/{id}", "/api/v1/meshes/{nobody}", "GET", "", "", "mesh_not_found"),
    ("/api/v1/meshes/{id}", "/api/v1/meshes/nothing", "GET", "", "", "mesh_not_found"),
    ("/api/v1/meshes/{id}", "/api/v1/meshes/%ff", "GET", "", "", "bad_request"),
    ("/api/v1/meshes/{id}", "/api/v1/meshes/..%2f..%2fetc%2fpasswd", "GET", "", "", "mesh_not_found"),
    ("/api/v1/meshes/{id}", "/api/v1/meshes/{nobody}?x=1", "GET", "", "", "bad_query"),
    ("/api/v1/meshes/{id}", "/api/v1/meshes/{nobody}", "DELETE", "", "", "mesh_not_found"),
    ("/api/v1/meshes/{id}", "/api/v1/meshes/{nobody}", "PUT", "", "", "method_not_allowed"),
    ("/api/v1/meshes/{id}/file", "/api/v1/meshes/{nobody}/file", "GET", "", "", "mesh_not_found"),
    ("/api/v1/meshes/{id}/file", "/api/v1/meshes/{nobody}/file", "DELETE", "", "", "method_not_allowed"),
    ("/api/v1/meshes/{id}/preview.glb", "/api/v1/meshes/{nobody}/preview.glb", "GET", "", "", "mesh_not_found"),
    ("/api/v1/scanners", "/api/v1/scanners?x=1", "GET", "", "", "bad_query"),
    ("/api/v1/scanners", "/api/v1/scanners", "POST", "", "", "method_not_allowed"),
    ("/api/v1/scanners/{name}", "/api/v1/scanners/nothing", "GET", "", "", "spec_not_found"),
    ("/api/v1/scanners/{name}", "/api/v1/scanners/nothing", "DELETE", "", "", "spec_not_found"),
    ("/api/v1/scanners/{name}", "/api/v1/scanners/a", "PUT", "text/plain", "{}", "unsupported_media_type"),
    ("/api/v1/scanners/{name}", "/api/v1/scanners/a", "PUT", "application/json", "", "bad_json"),
    ("/api/v1/scanners/{name}", "/api/v1/scanners/a", "PUT", "application/json", "{}", "bad_shape"),
    ("/api/v1/robots", "/api/v1/robots", "DELETE", "", "", "method_not_allowed"),
    ("/api/v1/robots/{name}", "/api/v1/robots/nothing", "GET", "", "", "spec_not_found"),
    ("/api/v1/robots/{name}", "/api/v1/robots/a", "PUT", "application/json", "[]", "bad_shape"),
    ("/api/v1/turntables", "/api/v1/turntables", "PUT", "", "", "method_not_allowed"),
    ("/api/v1/turntables/{name}", "/api/v1/turntables/nothing", "GET", "", "", "spec_not_found"),
    ("/api/v1/turntables/{name}", "/api/v1/turntables/a", "PUT", "application/json", "1", "bad_shape"),
    ("/api/v1/cells", "/api/v1/cells", "POST", "", "", "method_not_allowed"),
    ("/api/v1/cells/{name}", "/api/v1/cells/none", "GET", "", "", "spec_not_found"),
    ("/api/v1/cells/{name}", "/api/v1/cells/a", "PUT", "application/json", "null", "bad_shape"),
    ("/api/v1/check", "/api/v1/check", "POST", "", "{}", "unsupported_media_type"),
    ("/api/v1/check", "/api/v1/check", "POST", "application/json", "{\"document\":1}", "bad_shape"),
    ("/api/v1/check", "/api/v1/check", "POST", "application/json", "{\"document\":{},\"plan\":{}}", "invalid_fields"),
    ("/api/v1/check", "/api/v1/check", "GET", "", "", "method_not_allowed"),
    ("/api/v1/jobs", "/api/v1/jobs", "POST", "", "{}", "unsupported_media_type"),
    ("/api/v1/jobs", "/api/v1/jobs", "POST", "application/json; charset=utf-8", "{}", "bad_shape"),
    ("/api/v1/jobs", "/api/v1/jobs", "POST", "application/json", "", "bad_json"),
    ("/api/v1/jobs", "/api/v1/jobs", "POST", "application/json", "{\"mesh_id\"", "bad_json"),
    ("/api/v1/jobs", "/api/v1/jobs", "POST", "application/json", "\u{feff}{}", "bad_json"),
    ("/api/v1/jobs", "/api/v1/jobs", "POST", "application/json", "{\"priority\":1e999}", "bad_shape"),
    ("/api/v1/jobs", "/api/v1/jobs", "POST", "application/json", "{\"priority\":NaN}", "bad_json"),
    ("/api/v1/jobs", "/api/v1/jobs", "POST", "application/json", "{\"priority\":1,\"priority\":2}", "bad_shape"),
    (
        "/api/v1/jobs",
        "/api/v1/jobs?wait=1",
        "POST",
        "application/json",
        "{\"mesh_id\":\"01a1f77c-78a1-7554-855a-a9513c22aa2b\"}",
        "bad_query",
    ),
    ("/api/v1/jobs", "/api/v1/jobs?state=happy", "GET", "", "", "bad_query"),
    ("/api/v1/jobs", "/api/v1/jobs?page_token=x", "GET", "", "", "bad_page_token"),
    ("/api/v1/jobs", "/api/v1/jobs", "DELETE", "", "", "method_not_allowed"),
    ("/api/v1/jobs", "/api/v1/jobs?mesh=1", "GET", "", "", "bad_query"),
    ("/api/v1/jobs", "/api/v1/jobs?created_after=yesterday", "GET", "", "", "bad_query"),
    ("/api/v1/jobs", "/api/v1/jobs?created_before=2026-02-30T00:00:00Z", "GET", "", "", "bad_query"),
    ("/api/v1/jobs", "/api/v1/jobs?sort=age", "GET", "", "", "bad_query"),
    ("/api/v1/jobs", "/api/v1/jobs?fields=id,colour", "GET", "", "", "bad_query"),
    ("/api/v1/jobs", "/api/v1/jobs?fields=", "GET", "", "", "bad_query"),
    ("/api/v1/jobs", "/api/v1/jobs?fields=params", "GET", "", "", "bad_query"),
    ("/api/v1/jobs", "/api/v1/jobs?%ff=1", "GET", "", "", "bad_query"),
    ("/api/v1/jobs/batch", "/api/v1/jobs/batch", "POST", "application/json", "{\"jobs\":[]}", "invalid_fields"),
    ("/api/v1/jobs/batch", "/api/v1/jobs/batch", "POST", "application/json", "[]", "bad_shape"),
    ("/api/v1/jobs/batch", "/api/v1/jobs/batch", "GET", "", "", "method_not_allowed"),
    ("/api/v1/jobs/delete", "/api/v1/jobs/delete", "POST", "application/json", "{}", "invalid_fields"),
    ("/api/v1/jobs/delete", "/api/v1/jobs/delete", "POST", "application/json", "{\"state\":null}", "invalid_fields"),
    ("/api/v1/jobs/delete", "/api/v1/jobs/delete", "POST", "application/json", "{\"all\":true}", "bad_shape"),
    ("/api/v1/jobs/delete", "/api/v1/jobs/delete", "POST", "application/json", "{\"created_before\":\"now\"}", "bad_shape"),
    ("/api/v1/jobs/delete", "/api/v1/jobs/delete?dry_run=1", "POST", "application/json", "{\"label\":\"a\"}", "bad_query"),
    ("/api/v1/jobs/delete", "/api/v1/jobs/delete", "DELETE", "", "", "method_not_allowed"),
    ("/api/v1/jobs/{id}", "/api/v1/jobs/{nobody}", "GET", "", "", "job_not_found"),
    ("/api/v1/jobs/{id}", "/api/v1/jobs/{nobody}?wait=1s", "GET", "", "", "job_not_found"),
    ("/api/v1/jobs/{id}", "/api/v1/jobs/{nobody}", "DELETE", "", "", "job_not_found"),
    ("/api/v1/jobs/{id}", "/api/v1/jobs/%00", "GET", "", "", "job_not_found"),
    ("/api/v1/jobs/{id}", "/api/v1/jobs/{nobody}?fields=nothing", "GET", "", "", "bad_query"),
    ("/api/v1/jobs/{id}", "/api/v1/jobs/{nobody}", "PATCH", "application/json", "{\"priority\":1}", "job_not_found"),
    ("/api/v1/jobs/{id}", "/api/v1/jobs/{nobody}", "PATCH", "application/json", "{\"priority\":101}", "invalid_fields"),
    ("/api/v1/jobs/{id}", "/api/v1/jobs/{nobody}", "PATCH", "application/json", "{}", "bad_shape"),
    ("/api/v1/jobs/{id}/cancel", "/api/v1/jobs/{nobody}/cancel", "POST", "", "", "job_not_found"),
    ("/api/v1/jobs/{id}/cancel", "/api/v1/jobs/{nobody}/cancel", "GET", "", "", "method_not_allowed"),
    ("/api/v1/jobs/{id}/labels", "/api/v1/jobs/{nobody}/labels", "PUT", "application/json", "{\"labels\":{}}", "job_not_found"),
    (
        "/api/v1/jobs/{id}/labels",
        "/api/v1/jobs/{nobody}/labels",
        "PUT",
        "application/json",
        "{\"labels\":{\"\":\"\"}}",
        "invalid_fields",
    ),
    ("/api/v1/jobs/{id}/labels", "/api/v1/jobs/{nobody}/labels", "PUT", "application/json", "{}", "bad_shape"),
    ("/api/v1/storage", "/api/v1/storage?x=1", "GET", "", "", "bad_query"),
    ("/api/v1/retention", "/api/v1/retention", "DELETE", "", "", "method_not_allowed"),
    ("/api/v1/retention", "/api/v1/retention?dry_run=true", "POST", "", "", "bad_query"),
    ("/api/v1/retention", "/api/v1/retention", "POST", "application/json", "{\"dry_run\": true}", "unexpected_body"),
    ("/api/v1/retention", "/api/v1/retention", "POST", "application/x-www-form-urlencoded", "dry_run=true", "unexpected_body"),
    ("/api/v1/jobs/{id}/events", "/api/v1/jobs/{nobody}/events", "GET", "", "", "job_not_found"),
    ("/api/v1/jobs/{id}/plan", "/api/v1/jobs/{nobody}/plan", "GET", "", "", "job_not_found"),
    ("/api/v1/jobs/{id}/program", "/api/v1/jobs/{nobody}/program?dialect=x", "GET", "", "", "job_not_found"),
    ("/api/v1/jobs/{id}/program-2", "/api/v1/jobs/{nobody}/program-2?dialect=x", "GET", "", "", "job_not_found"),
    ("/api/v1/jobs/{id}/program-3", "/api/v1/jobs/{nobody}/program-3?dialect=x", "GET", "", "", "job_not_found"),
    ("/api/v1/jobs/{id}/program-4", "/api/v1/jobs/{nobody}/program-4?dialect=x", "GET", "", "", "job_not_found"),
    ("/api/v1/jobs/{id}/program/{dialect}", "/api/v1/jobs/{nobody}/program/rapid", "GET", "", "", "job_not_found"),
    ("/api/v1/jobs/{id}/program/{dialect}", "/api/v1/jobs/{nobody}/program/rapid?x=1", "GET", "", "", "bad_query"),
    ("/api/v1/jobs/{id}/program-2/{dialect}", "/api/v1/jobs/{nobody}/program-2/rapid", "GET", "", "", "job_not_found"),
    ("/api/v1/jobs/{id}/program-3/{dialect}", "/api/v1/jobs/{nobody}/program-3/rapid", "GET", "", "", "job_not_found"),
    ("/api/v1/jobs/{id}/program-4/{dialect}", "/api/v1/jobs/{nobody}/program-4/rapid", "GET", "", "", "job_not_found"),
    ("/api/v1/jobs/{id}/viewpoints", "/api/v1/jobs/{nobody}/viewpoints", "GET", "", "", "job_not_found"),
    ("/api/v1/jobs/{id}/viewpoints.csv", "/api/v1/jobs/{nobody}/viewpoints.csv", "GET", "", "", "job_not_found"),
    ("/api/v1/jobs/{id}/coverage", "/api/v1/jobs/{nobody}/coverage", "GET", "", "", "job_not_found"),
    ("/api/v1/jobs/{id}/coverage.csv", "/api/v1/jobs/{nobody}/coverage.csv", "GET", "", "", "job_not_found"),
    ("/api/v1/jobs/{id}/missed", "/api/v1/jobs/{nobody}/missed", "GET", "", "", "job_not_found"),
    ("/api/v1/jobs/{id}/candidates", "/api/v1/jobs/{nobody}/candidates", "GET", "", "", "job_not_found"),
    ("/api/v1/jobs/{id}/timings", "/api/v1/jobs/{nobody}/timings", "GET", "", "", "job_not_found"),
    ("/api/v1/jobs/{id}/report", "/api/v1/jobs/{nobody}/report", "GET", "", "", "job_not_found"),
    ("/api/v1/jobs/{id}/report.txt", "/api/v1/jobs/{nobody}/report.txt", "GET", "", "", "job_not_found"),
    ("/api/v1/jobs/{id}/coverage.bin", "/api/v1/jobs/{nobody}/coverage.bin", "GET", "", "", "job_not_found"),
    ("/api/v1/jobs/{id}/files/{name}", "/api/v1/jobs/{nobody}/files/plan.json", "GET", "", "", "job_not_found"),
    ("/api/v1/runs", "/api/v1/runs", "POST", "application/json", "{}", "bad_shape"),
    ("/api/v1/runs", "/api/v1/runs", "POST", "", "{}", "unsupported_media_type"),
    ("/api/v1/runs", "/api/v1/runs", "POST", "application/json", RUN_OF_NOBODY, "job_not_found"),
    ("/api/v1/runs", "/api/v1/runs?token=x", "POST", "application/json", RUN_OF_NOBODY, "bad_query"),
    ("/api/v1/runs", "/api/v1/runs?state=happy", "GET", "", "", "bad_query"),
    ("/api/v1/runs", "/api/v1/runs?mode=real", "GET", "", "", "bad_query"),
    ("/api/v1/runs", "/api/v1/runs?page_token=x", "GET", "", "", "bad_page_token"),
    ("/api/v1/runs", "/api/v1/runs", "DELETE", "", "", "method_not_allowed"),
    ("/api/v1/runs/{id}", "/api/v1/runs/{nobody}", "GET", "", "", "run_not_found"),
    ("/api/v1/runs/{id}", "/api/v1/runs/nothing", "GET", "", "", "run_not_found"),
    ("/api/v1/runs/{id}", "/api/v1/runs/{nobody}?wait=61s", "GET", "", "", "bad_query"),
    ("/api/v1/runs/{id}", "/api/v1/runs/{nobody}?wait=1s", "GET", "", "", "run_not_found"),
    ("/api/v1/runs/{id}", "/api/v1/runs/{nobody}", "DELETE", "", "", "run_not_found"),
    ("/api/v1/runs/{id}/events", "/api/v1/runs/{nobody}/events", "GET", "", "", "run_not_found"),
    ("/api/v1/runs/{id}/arm", "/api/v1/runs/{nobody}/arm", "POST", "application/json", ARM, "run_not_found"),
    ("/api/v1/runs/{id}/arm", "/api/v1/runs/{nobody}/arm", "POST", "application/json", "{}", "bad_shape"),
    (
        "/api/v1/runs/{id}/arm",
        "/api/v1/runs/{nobody}/arm",
        "POST",
        "application/json",
        "{\"operator\":\"\",\"cell\":\"a\"}",
        "invalid_fields",
    ),
    ("/api/v1/runs/{id}/pause", "/api/v1/runs/{nobody}/pause", "POST", "", "", "run_not_found"),
    ("/api/v1/runs/{id}/pause", "/api/v1/runs/{nobody}/pause?token=1", "POST", "", "", "run_not_found"),
    ("/api/v1/runs/{id}/resume", "/api/v1/runs/{nobody}/resume", "POST", "", "", "run_not_found"),
    ("/api/v1/runs/{id}/resume", "/api/v1/runs/{nobody}/resume?token=-1", "POST", "", "", "bad_query"),
    ("/api/v1/runs/{id}/resume", "/api/v1/runs/{nobody}/resume?token=9007199254740991", "POST", "", "", "run_not_found"),
    ("/api/v1/runs/{id}/resume", "/api/v1/runs/{nobody}/resume?token=9007199254740992", "POST", "", "", "bad_query"),
    ("/api/v1/runs/{id}/stop", "/api/v1/runs/{nobody}/stop", "POST", "", "", "run_not_found"),
    ("/api/v1/runs/{id}/stop", "/api/v1/runs/{nobody}/stop?token=1&token=x&%ff", "POST", "", "", "run_not_found"),
    ("/api/v1/runs/{id}/stop", "/api/v1/runs/{nobody}/stop", "GET", "", "", "method_not_allowed"),
    ("/api/v1/runs/{id}/step", "/api/v1/runs/{nobody}/step", "POST", "", "", "run_not_found"),
    (
        "/api/v1/runs/{id}/override",
        "/api/v1/runs/{nobody}/override",
        "POST",
        "application/json",
        "{\"speed_override\":0.5}",
        "run_not_found",
    ),
    (
        "/api/v1/runs/{id}/override",
        "/api/v1/runs/{nobody}/override",
        "POST",
        "application/json",
        "{\"speed_override\":0}",
        "invalid_fields",
    ),
    ("/api/v1/runs/{id}/located", "/api/v1/runs/{nobody}/located", "POST", "application/json", "{}", "bad_shape"),
    ("/api/v1/runs/{id}/record", "/api/v1/runs/{nobody}/record", "GET", "", "", "run_not_found"),
    ("/api/v1/runs/{id}/record.csv", "/api/v1/runs/{nobody}/record.csv", "GET", "", "", "run_not_found"),
    ("/api/v1/runs/{id}/audit", "/api/v1/runs/{nobody}/audit", "GET", "", "", "run_not_found"),
    ("/api/v1/jobs/{id}/scans", "/api/v1/jobs/{nobody}/scans", "POST", "application/octet-stream", "x", "job_not_found"),
    ("/api/v1/jobs/{id}/scans", "/api/v1/jobs/{nobody}/scans?view=100000", "POST", "", "x", "bad_query"),
    ("/api/v1/jobs/{id}/scans", "/api/v1/jobs/{nobody}/scans", "GET", "", "", "job_not_found"),
    ("/api/v1/scans/{id}", "/api/v1/scans/{nobody}", "GET", "", "", "scan_not_found"),
    ("/api/v1/scans/{id}", "/api/v1/scans/nothing", "DELETE", "", "", "scan_not_found"),
    ("/api/v1/scans/{id}/file", "/api/v1/scans/{nobody}/file", "GET", "", "", "scan_not_found"),
    ("/api/v1/jobs/{id}/inspections", "/api/v1/jobs/{nobody}/inspections", "POST", "application/json", "{}", "job_not_found"),
    ("/api/v1/inspections", "/api/v1/inspections?state=good", "GET", "", "", "bad_query"),
    ("/api/v1/inspections/{id}", "/api/v1/inspections/nothing", "GET", "", "", "inspection_not_found"),
    ("/api/v1/inspections/{id}", "/api/v1/inspections/{nobody}?wait=61s", "GET", "", "", "bad_query"),
    ("/api/v1/inspections/{id}", "/api/v1/inspections/{nobody}", "DELETE", "", "", "inspection_not_found"),
    ("/api/v1/inspections/{id}/cancel", "/api/v1/inspections/{nobody}/cancel", "POST", "", "", "inspection_not_found"),
    ("/api/v1/inspections/{id}/result", "/api/v1/inspections/{nobody}/result", "GET", "", "", "inspection_not_found"),
    ("/api/v1/inspections/{id}/losses", "/api/v1/inspections/{nobody}/losses", "GET", "", "", "inspection_not_found"),
    ("/api/v1/inspections/{id}/deviation", "/api/v1/inspections/{nobody}/deviation", "GET", "", "", "inspection_not_found"),
    ("/api/v1/inspections/{id}/learned", "/api/v1/inspections/{nobody}/learned", "GET", "", "", "inspection_not_found"),
    ("/api/v1/inspections/{id}/report", "/api/v1/inspections/{nobody}/report", "GET", "", "", "inspection_not_found"),
    (
        "/api/v1/inspections/{id}/rescans",
        "/api/v1/inspections/{nobody}/rescans",
        "POST",
        "application/json",
        "{}",
        "inspection_not_found",
    ),
    ("/api/v1/calibrations", "/api/v1/calibrations", "POST", "application/json", "{}", "bad_shape"),
    ("/api/v1/calibrations", "/api/v1/calibrations?state=good", "GET", "", "", "bad_query"),
    ("/api/v1/calibrations/{id}", "/api/v1/calibrations/nothing", "GET", "", "", "calibration_not_found"),
    ("/api/v1/calibrations/{id}", "/api/v1/calibrations/{nobody}?wait=61s", "GET", "", "", "bad_query"),
    ("/api/v1/calibrations/{id}", "/api/v1/calibrations/{nobody}", "DELETE", "", "", "calibration_not_found"),
    ("/api/v1/calibrations/{id}", "/api/v1/calibrations/{nobody}", "PUT", "", "", "method_not_allowed"),
    ("/api/v1/calibrations/{id}/cancel", "/api/v1/calibrations/{nobody}/cancel", "POST", "", "", "calibration_not_found"),
    ("/api/v1/calibrations/{id}/result", "/api/v1/calibrations/{nobody}/result", "GET", "", "", "calibration_not_found"),
    ("/api/v1/calibrations/{id}/cell", "/api/v1/calibrations/{nobody}/cell", "GET", "", "", "calibration_not_found"),
    ("/api/v1/calibrations/{id}/report", "/api/v1/calibrations/{nobody}/report", "GET", "", "", "calibration_not_found"),
    ("/api/v1/leases", "/api/v1/leases", "POST", "application/json", "{\"cell\":\"\"}", "invalid_fields"),
    ("/api/v1/leases", "/api/v1/leases", "POST", "application/json", "{}", "bad_shape"),
    ("/api/v1/leases", "/api/v1/leases?cell=a", "GET", "", "", "bad_query"),
    ("/api/v1/leases/{id}", "/api/v1/leases/{nobody}", "PUT", "", "", "lease_not_found"),
    ("/api/v1/leases/{id}", "/api/v1/leases/nothing", "DELETE", "", "", "lease_not_found"),
    ("/api/v1/events", "/api/v1/events?after=1", "GET", "", "", "bad_query"),
    ("/api/v1/events", "/api/v1/events", "POST", "", "", "method_not_allowed"),
    ("/api/v1/session", "/api/v1/session?x=1", "POST", "", "", "bad_query"),
    ("/api/v1/session", "/api/v1/session?x=1", "DELETE", "", "", "bad_query"),
    ("/api/v1/session", "/api/v1/session", "GET", "", "", "method_not_allowed"),
    ("/api/v1/openapi.json", "/api/v1/openapi.json", "PUT", "", "", "method_not_allowed"),
    ("/healthz", "/healthz", "POST", "", "", "method_not_allowed"),
    ("/readyz", "/readyz", "POST", "", "", "method_not_allowed"),
    ("/version", "/version", "POST", "", "", "method_not_allowed"),
    ("/metrics", "/metrics", "POST", "", "", "method_not_allowed"),
    ("/problems", "/problems", "POST", "", "", "method_not_allowed"),
    ("", "/api/v2/jobs", "GET", "", "", "no_such_route"),
    ("", "/api", "GET", "", "", "no_such_route"),
    ("", "/api/v1", "GET", "", "", "no_such_route"),
    ("", "/api/v1/", "GET", "", "", "no_such_route"),
    ("", "/api/v1/jobs/", "GET", "", "", "no_such_route"),
    ("", "/api/v1/runs/{nobody}/pause/", "POST", "", "", "run_not_found"),
    ("", "/api/v1/runs/{nobody}/stop/", "POST", "", "", "run_not_found"),
    ("", "/api/v1/runs/{nobody}/resume/", "POST", "", "", "no_such_route"),
    ("", "//api/v1/jobs", "GET", "", "", "no_such_route"),
    ("", "/%61pi/v1/jobs", "GET", "", "", "no_such_route"),
];

#[tokio::test]
async fn every_route_refuses_what_it_cannot_take() {
    let api = Api::start().await;
    for (_, path, method, kind, body, code) in CASES {
        let path = path.replace("{nobody}", NOBODY);
        let headers = [("content-type", *kind)];
        let answer = api.send(method, &path, if kind.is_empty() { &[] } else { &headers }, *body).await;
        let problem = answer.problem(code);
        assert_eq!(problem["instance"], path.split('?').next().expect("a path"), "{method} {path}");
        if *code == "bad_query" {
            // A sentence, which names the parameter.
            let detail = problem["detail"].as_str().expect("text");
            assert!(detail.starts_with("The query ") && detail.ends_with('.'), "{method} {path}: {detail}");
            let name = problem["errors"][0]["pointer"].as_str().map(|name| format!("{name:?}"));
            assert!(name.is_none_or(|name| detail.contains(&name)), "{method} {path}: {detail}");
        }
        if *code == "method_not_allowed" {
            assert!(answer.header("allow").contains(|c: char| c.is_ascii_uppercase()), "{method} {path}");
        }
    }
}

/// The detail did not name the field, told the texts of two schemas, and had `""` for a header that was not sent.
#[tokio::test]
async fn a_single_fault_is_told_with_the_field_the_value_and_what_is_expected() {
    let api = Api::start().await;
    let json = Some("application/json");
    for (method, path, kind, body, code, pointer, detail) in [
        ("POST", "jobs", json, "[]", "bad_shape", "", "the body: is a list; expected an object"),
        ("POST", "jobs", json, "[{}]", "bad_shape", "", "the body: is a list; expected an object"),
        ("POST", "calibrations", json, "[{}]", "bad_shape", "", "the body: is a list; expected an object"),
        ("POST", "jobs", json, "{}", "bad_shape", "/mesh_id", "/mesh_id: is missing: Id of the mesh to plan for"),
        ("POST", "jobs", json, "{\"mesh_id\": 3}", "bad_shape", "/mesh_id", "/mesh_id: is 3; expected a UUID"),
        ("POST", "jobs", json, "{\"mesh_id\": \"x\"}", "bad_shape", "/mesh_id", "/mesh_id: is \"x\"; expected a UUID"),
        ("POST", "jobs/batch", json, "{\"jobs\": []}", "invalid_fields", "/jobs", "/jobs: has 0 entries; allowed are 1 to 100"),
        (
            "POST",
            "leases",
            None,
            "{}",
            "unsupported_media_type",
            "Content-Type",
            "The header Content-Type is missing; send application/json.",
        ),
        (
            "POST",
            "leases",
            Some("text/plain"),
            "{}",
            "unsupported_media_type",
            "Content-Type",
            "The header Content-Type is \"text/plain\"; send application/json.",
        ),
    ] {
        let headers: Vec<(&str, &str)> = kind.map(|kind| ("content-type", kind)).into_iter().collect();
        let problem = api.send(method, &format!("/api/v1/{path}"), &headers, body).await.problem_at(code, &[pointer]);
        assert_eq!(problem["detail"], detail, "{path} {body}");
    }
}

#[tokio::test]
async fn a_wrong_path_is_told_what_would_be_right_and_a_wrong_method_which_there_are() {
    let api = Api::start().await;
    for (method, path, code, told) in [
        ("GET", "/api/v1/jobs/", "no_such_route", "there is nothing at /api/v1/jobs/; leave out the slash at the end"),
        ("GET", "//api/v1/jobs", "no_such_route", "there is nothing at //api/v1/jobs; write one slash in the place of two"),
        ("GET", "/api/v1", "no_such_route", "there is nothing at /api/v1; /docs lists the routes"),
        ("GET", "/api/v1/jobs/%ff", "bad_request", "the path is not UTF-8 text once its percent-encoding is undone"),
    ] {
        assert_eq!(api.send(method, path, &[], "").await.problem(code)["detail"], told);
    }
    let refused = api.send("DELETE", "/api/v1/jobs", &[], "").await;
    assert_eq!(refused.header("allow"), "GET,HEAD,POST");
    refused.problem("method_not_allowed");
}

/// OPTIONS was refused, with what was asked for in the refusal (RFC 9110, section 9.3.7).
#[tokio::test]
async fn options_tells_the_methods_of_a_route_and_does_nothing() {
    let api = Api::start().await;
    let nobody = "0190b6b0-7c1e-7c1e-8c1e-0123456789ab";
    for (path, methods) in [
        ("/api/v1/jobs".to_owned(), "GET,HEAD,POST"),
        ("/api/v1/meshes?unit=mm".to_owned(), "GET,HEAD,POST"),
        (format!("/api/v1/runs/{nobody}/stop"), "POST"),
        ("/healthz".to_owned(), "GET,HEAD"),
        ("/docs/".to_owned(), "GET,HEAD"),
    ] {
        let answer = api.send("OPTIONS", &path, &[], "").await;
        assert_eq!((answer.status.as_u16(), answer.header("allow"), answer.text().as_str()), (204, methods, ""), "{path}");
        assert!(!answer.header("x-request-id").is_empty(), "{path}");
    }
    api.send("OPTIONS", "/api/v1/nowhere", &[], "").await.problem("no_such_route");
}

/// Retention once deleted when it was asked for a dry run in a body.
#[tokio::test]
async fn what_a_route_does_not_take_is_refused_before_anything_is_done() {
    let api = Api::start().await;
    let document = serde_json::to_value(vantage::http::openapi()).expect("JSON");
    let json = [("content-type", "application/json")];
    let mut refused = 0;
    for (path, item) in document["paths"].as_object().expect("paths") {
        for (method, operation) in item.as_object().expect("operations").iter().filter(|(method, _)| *method != "get") {
            if operation.get("requestBody").is_some() {
                continue;
            }
            let (method, path) = (method.to_uppercase(), path.replace("{id}", NOBODY).replace("{name}", "nothing"));
            let misspelt = api.send(&method, &format!("{path}?dryrun=true"), &[], "").await;
            let answer = api.send(&method, &path, &json, "{\"dry_run\": true}").await;
            // A refusal would leave arm and table moving.
            if path.ends_with("/stop") || path.ends_with("/pause") {
                misspelt.problem("run_not_found");
                answer.problem("run_not_found");
                continue;
            }
            misspelt.problem_at("bad_query", &["dryrun"]);
            let problem = answer.problem("unexpected_body");
            assert!(problem["detail"].as_str().is_some_and(|detail| detail.contains("takes no body")), "{problem}");
            refused += 1;
        }
    }
    assert_eq!(refused, 20);
    let told = api.send("POST", "/api/v1/retention", &json, "{\"dry_run\": true}").await.problem("unexpected_body");
    assert!(told["detail"].as_str().is_some_and(|detail| detail.contains("GET /api/v1/retention")), "{told}");
    for nothing in ["", "\n", "{}", " { } ", "null"] {
        api.send("POST", "/api/v1/retention", &json, nothing).await.ok(200);
    }
    api.send("POST", "/api/v1/retention", &[("content-length", "0")], "").await.ok(200);
}

#[test]
fn no_route_is_missing_from_the_table() {
    let tested: BTreeSet<&str> = CASES.iter().map(|case| case.0).filter(|route| !route.is_empty()).collect();
    let document = serde_json::to_value(vantage::http::openapi()).expect("JSON");
    let documented: BTreeSet<&str> = document["paths"].as_object().expect("paths").keys().map(String::as_str).collect();
    assert_eq!(tested, documented);
}

#[tokio::test]
async fn a_body_that_is_too_large_or_too_deep_is_refused() {
    let api = Api::start().await;
    let long = json!({"mesh_id": NOBODY, "serial": "x".repeat(65 * 1024)});
    api.post_json("/api/v1/jobs", &long).await.problem("too_large");
    let deep = format!("{{\"params\":{}", "{\"part\":".repeat(5000));
    let answer = api.send("POST", "/api/v1/jobs", &[("content-type", "application/json")], deep).await;
    assert!(answer.status.is_client_error(), "{}", answer.text());
    let deep = "[".repeat(60_000);
    let answer = api.send("POST", "/api/v1/jobs", &[("content-type", "application/json")], deep).await;
    assert!(answer.status.is_client_error(), "{}", answer.text());
}

#[tokio::test]
async fn compressed_bodies_are_refused() {
    let api = Api::start().await;
    for (method, path) in [("POST", "/api/v1/jobs"), ("PUT", "/api/v1/robots/a"), ("POST", "/api/v1/meshes?unit=mm")] {
        let headers = [("content-type", "application/json"), ("content-encoding", "gzip")];
        api.send(method, path, &headers, cube(1.0)).await.problem_at("unsupported_media_type", &["Content-Encoding"]);
    }
    let plain = [("content-encoding", "identity")];
    api.send("POST", "/api/v1/meshes?unit=mm", &plain, cube(1.0)).await.ok(201);
    let coded = [("content-type", "application/json"), ("transfer-encoding", "gzip, chunked")];
    api.send("POST", "/api/v1/jobs", &coded, "{}").await.problem_at("unsupported_transfer_coding", &["Transfer-Encoding"]);
}

#[tokio::test]
async fn preconditions_are_read_strictly() {
    let api = Api::start().await;
    for headers in [
        &[("if-none-match", "\"1\"")][..],
        &[("if-match", "*"), ("if-none-match", "\"1\"")],
        &[("if-match", "\"1\""), ("if-match", "\"2\"")],
        &[("if-match", "\u{e4}")],
    ] {
        api.send("DELETE", "/api/v1/robots/a", headers, "").await.problem("bad_request");
    }
}

#[tokio::test]
async fn other_sites_pages_change_nothing() {
    let api = Api::start().await;
    let own = [("host", "127.0.0.1:8080"), ("origin", "http://127.0.0.1:8080")];
    api.send("POST", "/api/v1/meshes?unit=mm", &own, cube(1.0)).await.ok(201);
    api.send("POST", "/api/v1/meshes?unit=mm", &[("sec-fetch-site", "same-origin")], cube(1.0)).await.ok(201);
    for headers in [
        &[("sec-fetch-site", "cross-site")][..],
        &[("sec-fetch-site", "same-site")],
        &[("host", "127.0.0.1:8080"), ("origin", "http://evil.example")],
        &[("host", "127.0.0.1:8080"), ("origin", "null")],
    ] {
        api.send("POST", "/api/v1/meshes?unit=mm", headers, cube(1.0)).await.problem("cross_site");
        assert_eq!(api.send("GET", "/api/v1/meshes", headers, "").await.status, 200);
    }
}
