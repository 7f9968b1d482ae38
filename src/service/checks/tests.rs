//! Parts of a request beside its document: held against the document, or refused by name.

use std::sync::LazyLock;
use std::sync::atomic::AtomicBool;

use serde_json::{Value, json};

use super::*;
use crate::geometry::LengthUnit;
use crate::geometry::mesh_io::{self, Limits, write_stl};
use crate::planning::params::PlanParams;
use crate::service::MeshUpload;
use crate::service::plan_job::{PLAN_FILE, PlanJob, Reports, bytes_of, plan_sha256};
use crate::service::tests::service;
use crate::testing::{box_mesh, nominal_scanner};
use crate::wire::echo::Echo;

static PLANNED: LazyLock<Planned> = LazyLock::new(Planned::new);

/// A block and a clamp within it, which hides nothing, as files; and a plan of two views of the one with the other, without a
/// cell.
struct Planned {
    block: Vec<u8>,
    clamp: Vec<u8>,
    plan: Value,
}

impl Planned {
    fn new() -> Self {
        let block = write_stl(&box_mesh([-30.0, -20.0, 0.0], [30.0, 20.0, 80.0]));
        let clamp = write_stl(&box_mesh([-2.0, -2.0, 20.0], [2.0, 2.0, 24.0]));
        let [mesh, fixture] = [&block, &clamp].map(|stl| {
            let read = mesh_io::read(stl, Some(LengthUnit::Millimetre), &Limits::default());
            read.unwrap_or_else(|error| panic!("{error}")).mesh
        });
        let (scanner, mut params) = (nominal_scanner(), PlanParams::default());
        (params.part.samples_per_mm2, params.part.patch_edge_mm) = (Some(0.05), Some(20.0));
        (params.candidates.even_directions, params.selection.max_views) = (Some(24), Some(2));
        (params.missed.remedies, params.missed.advice, params.robust.pose_error) = (0, false, None);
        params.part.fixture_mesh = Some("clamp.stl".to_owned());
        let clamp_sha256 = plan_sha256(&clamp);
        let job = PlanJob {
            mesh: &mesh,
            fixture: Some(&fixture),
            fixture_sha256: Some(&clamp_sha256),
            part_name: "block".into(),
            part_sha256: &plan_sha256(&block),
            unit: LengthUnit::Millimetre,
            scanner: &scanner,
            cell: None,
            roadmaps: None,
            rescan: None,
            params: &params,
            echo: Echo::default(),
            date: None,
        };
        let never = AtomicBool::new(false);
        let ctx = Context::new(&never, &Silent);
        let outcome = job.plan(&ctx).unwrap_or_else(|error| panic!("no plan: {error}"));
        let files = job.render(&outcome, Reports::None, &ctx).expect("nobody cancels it");
        let plan = serde_json::from_slice(bytes_of(&files, PLAN_FILE)).expect("JSON");
        Self { block, clamp, plan }
    }

    /// The plan with a fixture of this name, or with none, as of an earlier release: the name is all that it tells of the fixture.
    fn held_by(&self, name: impl Into<Value>) -> Value {
        let mut plan = self.plan.clone();
        plan.as_object_mut().expect("an object").remove("fixture");
        plan["params"]["part"]["fixture_mesh"] = name.into();
        plan
    }
}

async fn upload(app: &App, stl: &[u8], unit: LengthUnit) -> MeshId {
    let mut upload = app.receive(0).await.expect("room");
    upload.write(stl.to_vec().into()).await.expect("written");
    let about = MeshUpload { unit, name: None };
    app.add_mesh(upload.finish(None).await.expect("a file"), about).await.expect("a mesh").id
}

/// The report, or what was refused: a pointer and a reason each.
async fn check(app: &App, request: Value) -> Result<CheckReport, Vec<String>> {
    let request: CheckRequest = serde_json::from_value(request).expect("a request");
    match app.check(request, None).await {
        Ok(report) => Ok(report),
        Err(Error::Invalid(errors)) => Err(errors.iter().map(ToString::to_string).collect()),
        Err(other) => panic!("{other}"),
    }
}

/// Asserts that these fields are refused, in this order.
#[track_caller]
fn assert_refused(checked: Result<CheckReport, Vec<String>>, begins: &[&str]) {
    let refused = checked.expect_err("refused");
    assert_eq!(refused.len(), begins.len(), "{refused:#?}");
    for (told, begins) in refused.iter().zip(begins) {
        assert!(told.starts_with(begins), "{begins:?}: {told}");
    }
}

/// Any mesh was taken for the fixture, and one without a part for nothing.
#[tokio::test]
async fn another_fixture_than_the_plan_names_is_refused_with_what_differs() {
    let planned = &*PLANNED;
    let (app, _folder) = service().await;
    let block = upload(&app, &planned.block, LengthUnit::Millimetre).await;
    let clamp = upload(&app, &planned.clamp, LengthUnit::Millimetre).await;
    let in_inches = upload(&app, &planned.clamp, LengthUnit::Inch).await;
    let plan = planned.held_by(clamp.to_string());
    let request = |fixture: MeshId| json!({"document": plan, "mesh_id": block, "fixture_mesh_id": fixture});

    let refused = check(&app, request(block)).await;
    let told = refused.as_ref().err().and_then(|refused| refused.first().cloned()).unwrap_or_default();
    assert!(told.contains(&plan_sha256(&planned.block)) && told.contains(&plan_sha256(&planned.clamp)), "{told}");
    assert_refused(refused, &["/fixture_mesh_id: is not the fixture of the plan: its SHA-256 is "]);
    assert_refused(
        check(&app, request(in_inches)).await,
        &["/fixture_mesh_id: is the fixture of the plan, read in inches; the plan"],
    );
    let without_part = json!({"document": plan, "fixture_mesh_id": clamp});
    assert_refused(
        check(&app, without_part).await,
        &["/fixture_mesh_id: is given without the part that it holds; give the part"],
    );

    let report = check(&app, request(clamp)).await.expect("nothing is refused");
    assert!(report.sound && report.measured_of_asked.is_some(), "{report:#?}");
    for told in ["part: its SHA-256 and its size", "fixture: its SHA-256 and its unit, by mesh ", "coverage.of_asked: "] {
        assert!(report.verified.iter().any(|statement| statement.starts_with(told)), "{told:?} in {:#?}", report.verified);
    }
    let named_by_path = json!({"document": planned.held_by("clamp.stl"), "mesh_id": block, "fixture_mesh_id": clamp});
    let report = check(&app, named_by_path).await.expect("nothing is refused");
    let left = report.unverified.iter().find(|left| left.statement == "identity of the fixture");
    assert!(left.is_some_and(|left| left.reason.contains("\"clamp.stl\", and not its SHA-256")), "{report:#?}");
    assert!(
        report.description.is_some_and(|told| told.contains("; not checked: identity of the fixture (the plan names the file"))
    );
}

/// Plans told the name of their fixture alone, which may stand for another file by now.
#[tokio::test]
async fn a_fixture_is_held_against_its_digest_in_the_plan_whatever_its_name_is() {
    let planned = &*PLANNED;
    let (app, _folder) = service().await;
    let block = upload(&app, &planned.block, LengthUnit::Millimetre).await;
    let clamp = upload(&app, &planned.clamp, LengthUnit::Millimetre).await;
    let in_inches = upload(&app, &planned.clamp, LengthUnit::Inch).await;
    assert_eq!(planned.plan["fixture"]["sha256"], json!(plan_sha256(&planned.clamp)));
    let request = |fixture: MeshId| json!({"document": planned.plan, "mesh_id": block, "fixture_mesh_id": fixture});
    let report = check(&app, request(clamp)).await.expect("nothing is refused");
    let told = "fixture: its SHA-256 and its size, by the file that was given";
    assert!(report.sound && report.verified.iter().any(|statement| statement == told), "{report:#?}");
    let refused = check(&app, request(block)).await;
    assert_refused(refused, &["/fixture_mesh_id: is not the fixture of the plan: its SHA-256 is "]);
    assert_refused(
        check(&app, request(in_inches)).await,
        &["/fixture_mesh_id: is 101.6 × 101.6 × 101.6 mm as read; the planned"],
    );
}

/// Such a field was passed over in silence.
#[tokio::test]
async fn what_does_not_apply_to_the_document_is_refused_by_name() {
    let planned = &*PLANNED;
    let (app, _folder) = service().await;
    let block = upload(&app, &planned.block, LengthUnit::Millimetre).await;
    let plan = planned.held_by(Value::Null);
    let beside_plan = json!({
        "document": plan, "cell": "e05-transcan", "plan": plan, "mesh_id": block, "fixture_mesh_id": block, "temperature_c": 20,
    });
    assert_refused(
        check(&app, beside_plan).await,
        &[
            "/cell: does not apply: the plan was made without a cell; leave it out, or give \"none\"",
            "/plan: does not apply to a plan",
            "/fixture_mesh_id: does not apply: the plan was made without a fixture",
            "/temperature_c: does not apply to a plan",
        ],
    );
    let beside_params = json!({"document": {"selection": {}}, "cell": "e05-transcan", "scanner": "transcan-c", "mesh_id": block});
    assert_refused(
        check(&app, beside_params).await,
        &["/scanner: is used beside the cell \"none\" alone", "/mesh_id: does not apply"],
    );
    let program = json!({"schema": "vantage.program/1"});
    let beside_program = json!({"document": program, "cell": "none", "mesh_id": block, "temperature_c": 20});
    assert_refused(
        check(&app, beside_program).await,
        &[
            "/cell: is \"none\", but a program moves a cell",
            "/mesh_id: is used in a cell alone",
            "/temperature_c: is used in a cell",
        ],
    );
}

/// `"none"` was no known cell.
#[tokio::test]
async fn a_plan_is_checked_without_a_cell_as_a_job_is_planned_without_one() {
    let planned = &*PLANNED;
    let (app, _folder) = service().await;
    let (block, clamp) =
        (upload(&app, &planned.block, LengthUnit::Millimetre).await, upload(&app, &planned.clamp, LengthUnit::Millimetre).await);
    let plan = planned.held_by(clamp.to_string());
    let request = |scanner: Value| {
        let mut request = json!({"document": plan, "cell": "none", "mesh_id": block, "fixture_mesh_id": clamp});
        request["scanner"] = scanner;
        request
    };
    for scanner in [Value::Null, json!("transcan-c-nominal")] {
        let report = check(&app, request(scanner)).await.expect("nothing is refused");
        assert!(report.sound && report.measured_of_asked.is_some(), "{report:#?}");
        assert!(report.description.is_some_and(|told| told.contains(", made without a cell; its views measure ")));
    }
    let report = check(&app, request(json!("transcan-c"))).await.expect("nothing is refused");
    assert_eq!((report.sound, report.findings[0].pointer.as_str()), (false, "/scanner/name"), "{report:#?}");
    assert_refused(check(&app, request(json!("nowhere"))).await, &["/scanner: no scanner is named \"nowhere\""]);

    let beyond = json!({"document": {"limits": {"camera_deg": 89}}, "cell": "none"});
    let report = check(&app, beyond).await.expect("nothing is refused");
    assert_eq!((report.sound, report.findings[0].pointer.as_str()), (false, "/limits/camera_deg"), "{report:#?}");
    let mut in_cell = planned.plan.clone();
    in_cell["cell"] = json!({"name": "e05-transcan"});
    let refused = check(&app, json!({"document": in_cell, "cell": "none"})).await;
    assert_refused(refused, &["/cell: is \"none\", but the plan was made in cell \"e05-transcan\"; give that"]);
}

/// The program of such a plan was said to be made from another plan.
#[tokio::test]
async fn the_plan_of_an_earlier_release_is_said_to_be_none_whose_digest_a_request_tells() {
    let planned = &*PLANNED;
    let (app, _folder) = service().await;
    let program = |plan_sha256: String| json!({"schema": "vantage.program/1", "plan_sha256": plan_sha256});
    let mut earlier = planned.plan.clone();
    earlier["coverage"].as_object_mut().expect("an object").remove("at_risk");
    let refused = check(&app, json!({"document": program("00".repeat(32)), "plan": earlier})).await;
    assert_refused(refused, &["/plan: has no /coverage/at_risk, as of an earlier release; the SHA-256 of its file"]);
    let of_this = check(&app, json!({"document": program("00".repeat(32)), "plan": planned.plan})).await.expect("none refused");
    assert!(!of_this.sound, "it is no program, and says so: {of_this:#?}");
}
