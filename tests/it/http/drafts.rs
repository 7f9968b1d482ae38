//! Reports that are drawn when somebody asks for them.

use std::sync::OnceLock;
use std::sync::atomic::AtomicBool;

use serde_json::{Value, json};
use vantage::cell::{Presets, SpecLibrary};
use vantage::geometry::LengthUnit;
use vantage::planning::context::{Context, Silent};
use vantage::planning::params::{CandidateParams, PlanParams};
use vantage::service::plan_job::{Artifact, PlanJob, REPORT_DRAFT_FILE, REPORT_FILE, bytes_of};
use vantage::wire::echo::Echo;

use super::api::Api;
use crate::support::box_mesh;

/// Files of a real job with a draft of its report, and the report as the command line draws it.
pub(super) struct Drafted {
    pub(super) files: Vec<Artifact>,
    report: Vec<u8>,
}

pub(super) fn drafted() -> &'static Drafted {
    static DRAFTED: OnceLock<Drafted> = OnceLock::new();
    DRAFTED.get_or_init(|| {
        let scanner = Presets.scanner("transcan-c-nominal").expect("a preset").build().expect("it is valid");
        let mesh = box_mesh([-30.0, -20.0, 0.0], [30.0, 20.0, 40.0]);
        let mut params = PlanParams { candidates: CandidateParams::ellipsoid(), ..PlanParams::default() };
        (params.part.samples_per_mm2, params.part.patch_edge_mm) = (Some(0.05), Some(20.0));
        (params.missed.remedies, params.selection.max_views) = (0, Some(3));
        let job = PlanJob {
            mesh: &mesh,
            fixture: None,
            fixture_sha256: None,
            part_name: "box <1>".into(),
            part_sha256: &"0a".repeat(32),
            unit: LengthUnit::Millimetre,
            scanner: &scanner,
            cell: None,
            roadmaps: None,
            rescan: None,
            params: &params,
            echo: Echo::default(),
            date: None,
        };
        let flag = AtomicBool::new(false);
        let ctx = Context::new(&flag, &Silent);
        let files = job.execute_with_draft(&ctx).expect("a plan");
        let drawn = job.execute(&ctx).expect("a plan");
        assert_eq!((files.len(), bytes_of(&files, REPORT_FILE)), (drawn.len(), &[][..]));
        Drafted { report: bytes_of(&drawn, REPORT_FILE).to_vec(), files }
    })
}

/// The report among the results of a job.
fn listed(job: &Value) -> Value {
    let results = job["results"].as_array().expect("a list");
    let names: Vec<&str> = results.iter().filter_map(|file| file["name"].as_str()).collect();
    assert!(names.is_sorted() && !names.contains(&REPORT_DRAFT_FILE), "{names:?}");
    results.iter().find(|file| file["name"] == REPORT_FILE).cloned().expect("it is named")
}

#[tokio::test]
async fn a_report_is_drawn_once_when_it_is_first_asked_for_as_the_command_draws_it() {
    let wanted = drafted();
    let api = Api::start().await;
    let job = api.job("draft").await;
    let ended = api.ended(&job).await;
    assert_eq!(ended["state"], "succeeded", "{ended}");
    assert_eq!(listed(&ended), json!({"name": REPORT_FILE, "sha256": null, "size_bytes": null}));
    assert_eq!(listed(&api.get("/api/v1/jobs").await.ok(200)["items"][0])["sha256"], json!(null));
    api.get(&format!("/api/v1/jobs/{job}/files/{REPORT_DRAFT_FILE}")).await.problem("result_not_found");
    // Not even the mesh is needed.
    let mesh = ended["mesh_id"].as_str().expect("an id");
    assert_eq!(api.send("DELETE", &format!("/api/v1/meshes/{mesh}"), &[], "").await.status, 204);

    let (page, file) = (format!("/api/v1/jobs/{job}/report"), format!("/api/v1/jobs/{job}/files/{REPORT_FILE}"));
    // All at once: whoever drew it a second time would find no draft to replace.
    let (a, b, c) = tokio::join!(api.get(&page), api.get(&file), api.get(&page));
    for answer in [&a, &b, &c, &api.get(&page).await] {
        assert_eq!(answer.status, 200, "{}", answer.text());
        assert!(answer.bytes == wanted.report, "not the report of the command");
        assert_eq!(answer.header("etag"), a.header("etag"));
    }
    let kept = listed(&api.get(&format!("/api/v1/jobs/{job}")).await.ok(200));
    assert_eq!(format!("\"{}\"", kept["sha256"].as_str().expect("a hash")), a.header("etag"));
    assert_eq!(kept["size_bytes"], json!(wanted.report.len()));
    assert_eq!(api.send("DELETE", &format!("/api/v1/jobs/{job}"), &[], "").await.status, 204);
    api.get(&page).await.problem("job_not_found");
}

#[tokio::test]
async fn a_job_without_a_draft_has_no_report() {
    let api = Api::start().await;
    let job = api.job("regions").await;
    api.ended(&job).await;
    let problem = api.get(&format!("/api/v1/jobs/{job}/report")).await.problem("result_not_found");
    assert!(problem["detail"].as_str().is_some_and(|detail| detail.contains(REPORT_FILE)), "{problem}");
}
