//! A service in a folder of its own, and its router to be asked.

use std::sync::Arc;
use std::time::{Duration, Instant};

use axum::Router;
use axum::body::{Body, to_bytes};
use axum::http::{HeaderMap, HeaderValue, Method, Request, StatusCode};
use serde_json::{Value, json};
use tower::ServiceExt as _;
use vantage::http::{self, Quota};
use vantage::planning::context::{Context, Stage};
use vantage::service::planner::{Artifact, JobError, JobInput};
use vantage::service::{self, App, Planner, Sizer};

pub(super) struct Api {
    pub(super) app: App,
    router: Router,
    folder: tempfile::TempDir,
}

/// An answer, read to its end.
#[derive(Debug)]
pub(super) struct Answer {
    pub(super) status: StatusCode,
    pub(super) headers: HeaderMap,
    pub(super) bytes: Vec<u8>,
}

/// Every file that a job may come to.
pub(super) const FILES: [&str; 19] = [
    "plan.json",
    "program.json",
    "missed.json",
    "candidates.json",
    "viewpoints.json",
    "viewpoints.csv",
    "coverage.json",
    "coverage.csv",
    "coverage.bin",
    "report.html",
    "report.txt",
    "program.csv",
    "program.cps",
    "program.script",
    "program.mod",
    "program.src",
    "program.dat",
    "program.ls",
    "program.py",
];

/// The planner of these tests.
fn planner() -> Planner {
    Arc::new(|input: &JobInput, ctx: &Context<'_>| {
        ctx.stage(Stage::Surface, || Ok::<_, JobError>(()))?;
        match input.echo.labels.get("do").map(String::as_str) {
            Some("panic") => panic!("as asked"),
            Some("no_plan") => {
                return Err(JobError::NoPlan { reasons: "nothing is in reach".into(), report: Vec::new() });
            }
            Some("no_plan_report") => return Err(no_plan()),
            Some("bad_input") => input.mesh.read("/mesh_id", 1, &|| false).map(drop)?,
            Some("wait") => wait_for_cancel(ctx)?,
            Some("regions") => return Ok(vec![coverage_of_regions()]),
            Some("foreign") => return Ok(programs_for_an_arm_of_hans()),
            Some("earlier") => return Ok(programs_of_an_earlier_release()),
            Some("long") => {
                return Ok(vec![Artifact { name: "report.txt".into(), bytes: "0123456789".repeat(1000).into_bytes() }]);
            }
            Some("draft") => return Ok(super::drafts::drafted().files.clone()),
            Some("drive") => return super::runs::planned(input, ctx),
            Some("refuse") => {
                let bytes = br#"{"program.ls": "the speed is 0.001 of the rated"}"#.to_vec();
                return Ok(vec![Artifact { name: "refused.json".into(), bytes }]);
            }
            _ => {}
        }
        ctx.stage(Stage::Visibility, || Ok::<_, JobError>(()))?;
        Ok(FILES.map(|name| Artifact { name: name.into(), bytes: format!("{{\"file\": \"{name}\"}}").into_bytes() }).into())
    })
}

/// The error of a job without a plan, with a report on it.
fn no_plan() -> JobError {
    let report =
        ["report.html", "report.txt"].map(|name| Artifact { name: name.into(), bytes: format!("no {name}").into_bytes() });
    JobError::NoPlan { reasons: "nothing is in reach".into(), report: report.into() }
}

/// A program in the robot's own language, and one in another maker's.
fn programs_for_an_arm_of_hans() -> Vec<Artifact> {
    let reason = "rapid is not a language of robot hans-e05, whose specification has dialect = \"hans\"";
    [
        ("program.json", "{}".to_owned()),
        ("program.cps", "# own".to_owned()),
        ("program.foreign.mod", "! WARNING: FORCED".to_owned()),
        ("refused.json", json!({ "program.mod": reason }).to_string()),
    ]
    .map(|(name, text)| Artifact { name: name.into(), bytes: text.into_bytes() })
    .into()
}

/// Programs as releases wrote them that knew of no robot's language: every language under its plain name.
fn programs_of_an_earlier_release() -> Vec<Artifact> {
    [("program.json", "{}"), ("program.cps", "# own"), ("program.mod", "! of another maker"), ("program.csv", "a table")]
        .map(|(name, text)| Artifact { name: name.into(), bytes: text.into() })
        .into()
}

/// `coverage.json` of a plan that misses one of its two regions.
fn coverage_of_regions() -> Artifact {
    let region = |name: &str, of_asked: f64| {
        json!({"name": name, "kind": "feature", "samples": 9, "asked_area_mm2": 90.0, "coverable_area_mm2": 90.0,
            "measured_area_mm2": 90.0 * of_asked, "of_asked": of_asked, "of_coverable": of_asked, "target": 0.9,
            "met": of_asked >= 0.9, "why_unmet": if of_asked < 0.9 { Some("below_grade 90.0 mm²") } else { None }})
    };
    let coverage = json!({"schema": "vantage.coverage/1", "coverage": {"regions": [region("bore", 0.0), region("face", 1.0)]}});
    Artifact { name: "coverage.json".into(), bytes: coverage.to_string().into_bytes() }
}

fn wait_for_cancel(ctx: &Context<'_>) -> Result<(), JobError> {
    let until = Instant::now() + Duration::from_secs(60);
    while Instant::now() < until {
        ctx.check().map_err(|_| JobError::Cancelled)?;
        std::thread::sleep(Duration::from_millis(5));
    }
    Err(JobError::NoPlan { reasons: "nobody cancelled".into(), report: Vec::new() })
}

pub(super) fn http_options() -> http::ServerOptions {
    http::ServerOptions {
        listen: ([127, 0, 0, 1], 0).into(),
        api_key: None,
        api_keys_file: None,
        hosts: Vec::new(),
        trusted_proxies: vec![[0, 0, 0, 0].into()],
        public_path: String::new(),
        cors_origins: Vec::new(),
        max_connections: 16,
        max_connections_per_address: 16,
        event_streams: Quota { total: 4, per_address: 3 },
        uploads: Quota { total: 4, per_address: 3 },
        waits: Quota { total: 4, per_address: 3 },
        http2_max_streams: 16,
        header_timeout: Duration::from_secs(10),
        idle_timeout: Duration::from_secs(10),
        body_idle_timeout: Duration::from_millis(500),
        request_timeout: Duration::from_secs(30),
        max_json_bytes: 64 * 1024,
        download_bytes_per_sec: 1_000_000_000,
    }
}

pub(crate) fn service_options() -> service::Options {
    service::Options {
        data_dir: std::path::PathBuf::new(),
        planning_threads: 2,
        concurrent_jobs: 1,
        max_attempts: 3,
        max_queued_jobs: 100,
        max_uploads: 4,
        max_upload_bytes: 1 << 20,
        max_triangles: 10_000,
        parse_limit: Duration::from_secs(60),
        parse_memory_bytes: 1 << 30,
        job_memory_bytes: 4 << 30,
        job_limit: None,
        event_retention_hours: 1,
        min_free_bytes: 0,
        min_free_share: 0.0,
        orphan_hours: 1,
        swept_hours: 1,
        scrub_hours: 0,
        retention: service::RetentionOptions {
            job_days: 0,
            jobs_per_part: 0,
            unused_mesh_days: 0,
            run_days: 0,
            max_disk_share: 0.0,
            hold_label: "hold".to_owned(),
        },
        execution: service::ExecutionOptions {
            live: false,
            cells: Vec::new(),
            lease_ttl: Duration::from_secs(2),
            heartbeat: Duration::from_millis(500),
            audit_dir: std::path::PathBuf::new(),
            audit_file_bytes: 1 << 20,
            audit_files: 4,
            max_runs: 8,
        },
    }
}

impl Api {
    pub(super) async fn start() -> Self {
        Self::start_with(service_options(), http_options()).await
    }

    pub(super) async fn start_with(service: service::Options, http: http::ServerOptions) -> Self {
        Self::start_planning(service, http, planner(), None).await
    }

    /// Starts with another planner, and sizes of jobs.
    pub(super) async fn start_planning(
        mut service: service::Options,
        http: http::ServerOptions,
        planner: Planner,
        sizer: Option<Sizer>,
    ) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        service.data_dir = folder.path().to_owned();
        service.execution.audit_dir = folder.path().join("audit");
        let app = App::open_with(service, planner, sizer).await.expect("a service");
        Self { router: http::router(app.clone(), http), app, folder }
    }

    /// Waits until no upload has left anything behind.
    pub(super) async fn nothing_is_left(&self) {
        let unfinished = self.folder.path().join("unfinished");
        for _ in 0..100 {
            if std::fs::read_dir(&unfinished).expect("the folder").count() == 0 {
                return;
            }
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
        panic!("something is left in {}", unfinished.display());
    }

    /// The answer to a request, which is for `localhost` unless it says another host.
    pub(super) async fn raw(&self, mut request: Request<Body>) -> axum::response::Response {
        request.headers_mut().entry("host").or_insert(HeaderValue::from_static("localhost"));
        self.as_it_is(request).await
    }

    pub(super) async fn as_it_is(&self, request: Request<Body>) -> axum::response::Response {
        self.router.clone().oneshot(request).await.expect("an answer")
    }

    pub(super) async fn send(&self, method: &str, path: &str, headers: &[(&str, &str)], body: impl Into<Body>) -> Answer {
        let mut request = Request::builder().method(Method::from_bytes(method.as_bytes()).expect("a method")).uri(path);
        for (name, value) in headers {
            request = request.header(*name, *value);
        }
        Answer::read(self.raw(request.body(body.into()).expect("a request")).await).await
    }

    pub(super) async fn get(&self, path: &str) -> Answer {
        self.send("GET", path, &[], Body::empty()).await
    }

    pub(super) async fn post_json(&self, path: &str, body: &Value) -> Answer {
        self.send("POST", path, &[("content-type", "application/json")], body.to_string()).await
    }

    pub(super) async fn patch_json(&self, path: &str, body: &Value) -> Answer {
        self.send("PATCH", path, &[("content-type", "application/json")], body.to_string()).await
    }

    /// Uploads a cube; returns the mesh's id.
    pub(super) async fn mesh(&self) -> String {
        self.send("POST", "/api/v1/meshes?unit=mm&name=cube", &[], cube(10.0)).await.ok(201)["id"].as_str().expect("an id").into()
    }

    /// Starts a job without a cell; `what` is told to the planner. Returns the job's id.
    pub(super) async fn job(&self, what: &str) -> String {
        let mesh = self.mesh().await;
        let request = json!({"mesh_id": mesh, "cell": "none", "labels": {"do": what}});
        self.post_json("/api/v1/jobs", &request).await.ok(202)["id"].as_str().expect("an id").into()
    }

    /// The job once it has ended.
    pub(super) async fn ended(&self, job: &str) -> Value {
        let job = self.get(&format!("/api/v1/jobs/{job}?wait=30s")).await.ok(200);
        assert!(["succeeded", "failed", "cancelled"].contains(&job["state"].as_str().expect("a state")), "{job}");
        job
    }

    /// Waits until the job runs.
    pub(super) async fn running(&self, job: &str) {
        for _ in 0..500 {
            if self.get(&format!("/api/v1/jobs/{job}")).await.ok(200)["state"] == "running" {
                return;
            }
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
        panic!("{job} does not run");
    }
}

impl Answer {
    pub(super) async fn read(response: axum::response::Response) -> Self {
        let (parts, body) = response.into_parts();
        let bytes = to_bytes(body, usize::MAX).await.expect("a body").to_vec();
        Self { status: parts.status, headers: parts.headers, bytes }
    }

    pub(super) fn header(&self, name: &str) -> &str {
        self.headers.get(name).and_then(|value| value.to_str().ok()).unwrap_or_default()
    }

    pub(super) fn text(&self) -> String {
        String::from_utf8_lossy(&self.bytes).into_owned()
    }

    /// The JSON of an answer with this status.
    #[track_caller]
    pub(super) fn ok(&self, status: u16) -> Value {
        assert_eq!(self.status.as_u16(), status, "{}", self.text());
        serde_json::from_slice(&self.bytes).unwrap_or(Value::Null)
    }

    /// The problem, which must be whole and of this code.
    #[track_caller]
    pub(super) fn problem(&self, code: &str) -> Value {
        assert_eq!(self.header("content-type"), "application/problem+json", "{} {}", self.status, self.text());
        let problem: Value = serde_json::from_slice(&self.bytes).expect("JSON");
        assert_eq!(problem["code"], code, "{problem}");
        let known = http::Code::ALL.iter().find(|known| known.as_str() == code).expect("a known code");
        assert_eq!(known.status(), self.status);
        assert_eq!(problem["status"], self.status.as_u16());
        assert_eq!(problem["type"], format!("/problems/{code}"));
        assert_eq!(problem["request_id"], self.header("x-request-id"));
        for text in ["title", "detail", "instance"] {
            assert!(problem[text].as_str().is_some_and(|text| !text.is_empty()), "{problem}");
        }
        assert!(problem["errors"].is_array(), "{problem}");
        problem
    }

    /// The problem, with the pointers of its fields.
    #[track_caller]
    pub(super) fn problem_at(&self, code: &str, pointers: &[&str]) -> Value {
        let problem = self.problem(code);
        let found: Vec<&str> =
            problem["errors"].as_array().expect("a list").iter().filter_map(|e| e["pointer"].as_str()).collect();
        assert_eq!(found, pointers, "{problem}");
        problem
    }
}

/// A closed cube as ASCII STL.
pub(crate) fn cube(edge: f64) -> String {
    let corner = |i: usize| [i & 1, i >> 1 & 1, i >> 2 & 1].map(|bit| bit as f64 * edge);
    let faces = [
        [0, 2, 1],
        [1, 2, 3],
        [4, 5, 6],
        [5, 7, 6],
        [0, 1, 4],
        [1, 5, 4],
        [2, 6, 3],
        [3, 6, 7],
        [0, 4, 2],
        [2, 4, 6],
        [1, 3, 5],
        [3, 7, 5],
    ];
    let facet = |face: &[usize; 3]| {
        let vertices = face.map(|i| corner(i).map(|c| c.to_string()).join(" ")).map(|v| format!("vertex {v}\n")).concat();
        format!("facet normal 0 0 0\nouter loop\n{vertices}endloop\nendfacet\n")
    };
    format!("solid cube\n{}endsolid cube\n", faces.iter().map(facet).collect::<String>())
}
