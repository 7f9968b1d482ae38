//! Names in requests that stand for nothing usable, and keys of requests for further views.

use super::*;
use crate::geometry::LengthUnit;
use crate::inspection::InspectionParams;
use crate::planning::context::Context;
use crate::planning::params::{PlanParams, Region};
use crate::service::library::FacesInFile;
use crate::service::store::Precondition;
use crate::service::tests::{ended_job, options, service};
use crate::service::{MeshUpload, Options};
use crate::wire::inspection::RateCurveDocument;
use crate::wire::{InspectionId, JobId, JobState, SpecCollection};

#[tokio::test]
async fn a_stored_specification_that_cannot_be_read_is_not_said_to_be_unknown() {
    let (app, _folder) = service().await;
    for collection in [SpecCollection::Scanner, SpecCollection::Cell] {
        app.0.store.put_spec(collection, "ours", "?", &Precondition::None).await.expect("stored");
    }
    let job = |cell: &str| JobRequest {
        cell: Named::Name(cell.to_owned()),
        scanner: Some(Named::Name("ours".to_owned())),
        ..JobRequest::new(MeshId::generate())
    };
    for (cell, pointer, path) in [("none", "/scanner", "scanners/ours"), ("ours", "/cell", "cells/ours")] {
        let refused = app.submit(job(cell), Submission::default()).await.expect_err("it cannot be read");
        let Error::Invalid(errors) = refused else { panic!("{refused}") };
        let said = &errors.iter().find(|error| error.pointer == pointer).expect("an error").detail;
        assert!(said.contains("cannot be used: ") && said.contains(path) && !said.contains("known names"), "{said}");
    }
}

fn inspection(job_id: JobId) -> InspectionJob {
    InspectionJob {
        id: InspectionId::generate(),
        job_id,
        state: JobState::Succeeded,
        scans: Vec::new(),
        run_id: None,
        params: InspectionParams::default(),
        fraction: 1.0,
        submitted_by: None,
        created_at: String::new(),
        ended_at: None,
        summary: None,
        files: Vec::new(),
        problem: None,
    }
}

fn stored_rescan() -> StoredRescan {
    let none = || RateCurveDocument { bins: Vec::new(), points: Vec::new() };
    let state = RescanState {
        schema: String::new(),
        plan_sha256: String::new(),
        plan_params: PlanParams::default(),
        target_of_mm2: 1.0,
        rounds: 0,
        is_not_found: false,
        samples: None,
        measured: String::new(),
        hopeless: String::new(),
        easy_rate: 1.0,
        by_incidence: none(),
        by_mirror: none(),
        by_depth: none(),
    };
    StoredRescan { state, params: RescanParams::default() }
}

/// Two inspections of the same scans leave the same state.
#[tokio::test]
async fn a_key_that_was_used_for_the_rescan_of_another_inspection_is_refused() {
    let (app, _folder) = service().await;
    let job = ended_job(&app).await.id;
    let submitted = async |of: &InspectionJob| {
        let submission = Submission { idempotency_key: Some("key".to_owned()), ..Submission::default() };
        app.submit_rescan(of, stored_rescan(), submission).await
    };
    let (first, second) = (inspection(job), inspection(job));
    let accepted = submitted(&first).await.expect("accepted");
    assert_eq!(submitted(&first).await.expect("the same").id, accepted.id);
    assert!(matches!(submitted(&second).await, Err(Error::IdempotencyMismatch)));
}

#[tokio::test]
async fn further_views_are_refused_to_scans_that_do_not_fit_the_part() {
    let (app, _folder) = service().await;
    let job = ended_job(&app).await.id;
    let mut lost = stored_rescan();
    lost.state.is_not_found = true;
    let refused = app.submit_rescan(&inspection(job), lost, Submission::default()).await;
    let Err(Error::Invalid(errors)) = refused else { panic!("accepted") };
    assert!(errors[0].detail.contains("alignment not found"), "{errors:?}");
}

#[tokio::test]
async fn further_views_are_planned_on_the_file_of_a_mesh_that_was_deleted() {
    let (app, _folder) = service().await;
    let scanned = ended_job(&app).await;
    let sha256 = app.mesh(scanned.mesh_id).await.expect("it").sha256;
    app.delete_mesh(scanned.mesh_id).await.expect("no open job needs it");
    let from = inspection(scanned.id);
    let further = app.submit_rescan(&from, stored_rescan(), Submission::default()).await.expect("accepted").id;
    app.job_when_ended(further, Duration::from_secs(60)).await.expect("it");
    app.delete_job(scanned.id).await.expect("ended");
    app.0.store.files().read(&sha256).expect("kept for the job of further views");
    let gone = app.submit_rescan(&from, stored_rescan(), Submission::default()).await;
    assert!(matches!(gone, Err(Error::JobNotFound(id)) if id == scanned.id), "{gone:?}");
}

/// No queue gets empty enough for such a batch.
#[tokio::test]
async fn a_batch_beyond_the_limit_of_the_queue_is_not_told_to_come_again() {
    let folder = tempfile::tempdir().expect("a folder");
    let options = Options { max_queued_jobs: 3, ..options(folder.path()) };
    let app = App::open_with(options, Arc::new(|_: &JobInput, _: &Context<'_>| Ok(Vec::new())), None).await.expect("a service");
    let batch = JobBatchRequest { jobs: vec![JobRequest::new(MeshId::generate()); 4] };
    let Err(Error::Invalid(errors)) = app.submit_batch(batch, Submission::default()).await else { panic!("accepted") };
    assert_eq!(
        errors,
        [FieldError { pointer: "/jobs".to_owned(), detail: "has 4 entries; limits.queued_jobs allows 3".to_owned() }]
    );
}

/// Such a group was refused in the job alone, which may wait for hours before.
#[tokio::test]
async fn a_group_that_the_mesh_does_not_have_is_refused_when_the_job_is_submitted() {
    let (app, _folder) = service().await;
    let mut upload = app.receive(0).await.expect("room");
    let obj = "v 0 0 0\nv 9 0 0\nv 0 9 0\nv 0 0 9\ng base\nf 1 3 2\ng flange wall\nf 1 2 4\nf 2 3 4\nf 3 1 4\n";
    upload.write(obj.into()).await.expect("written");
    let about = MeshUpload { unit: LengthUnit::Millimetre, name: None };
    let mesh = app.add_mesh(upload.finish(None).await.expect("a file"), about).await.expect("a mesh");
    assert_eq!(mesh.health.group_names, Some(["base", "flange", "wall"].map(str::to_owned).to_vec()));
    let submitted = async |name: &str| {
        let mut request = JobRequest { cell: Named::Name("none".to_owned()), ..JobRequest::new(mesh.id) };
        request.params.regions.exclude = vec![Region::Name { name: name.to_owned() }];
        app.submit(request, Submission::default()).await
    };
    let Err(Error::Invalid(errors)) = submitted("flnge").await else { panic!("accepted") };
    let detail = "is \"flnge\"; the file's groups are base, flange, wall".to_owned();
    assert_eq!(errors, [FieldError { pointer: "/params/regions/exclude/0/name".to_owned(), detail }]);
    submitted("flange").await.expect("a group of the file");
}

/// An earlier release stored no names: those meshes are looked into by the job, as before.
#[test]
fn a_group_is_not_refused_where_the_names_are_not_known() {
    let mut params = PlanParams::default();
    params.regions.exclude = vec![Region::Name { name: "rim".to_owned() }];
    let told = |group_names: Option<Vec<String>>, may_be_grouped: bool| {
        let file = FacesInFile { triangles: 4, may_be_polygons: true, may_be_grouped, group_names };
        regions::absent(&params, &file, &[]).into_iter().map(|error| error.detail).collect::<Vec<_>>()
    };
    assert_eq!(told(None, true), [""; 0]);
    assert_eq!(told(None, false), ["is \"rim\"; the file has no named groups"]);
    assert_eq!(told(Some(Vec::new()), true), ["is \"rim\"; the file has no named groups"]);
    assert_eq!(told(Some(vec!["rim".to_owned()]), true), [""; 0]);
}

/// The answer was 404, as if the path had named the mesh.
#[tokio::test]
async fn a_mesh_that_is_deleted_while_its_job_is_accepted_is_an_invalid_field() {
    let (app, _folder) = service().await;
    let mesh = ended_job(&app).await.mesh_id;
    let job = JobRequest { cell: Named::Name("none".to_owned()), ..JobRequest::new(mesh) };
    let alone = async { app.submit(job.clone(), Submission::default()).await.map(drop) };
    let beside = JobBatchRequest { jobs: vec![job.clone(), job.clone()] };
    let in_batch = async { app.submit_batch(beside, Submission::default()).await.map(drop) };
    tokio::pin!(alone, in_batch);
    let both = async {
        // Long enough to be checked; and however long that takes, what is told is the same.
        let limit = Duration::from_millis(300);
        let (one, two) =
            tokio::join!(tokio::time::timeout(limit, alone.as_mut()), tokio::time::timeout(limit, in_batch.as_mut()));
        assert!(one.is_err() && two.is_err(), "they wait for the store");
    };
    app.0.store.delete_mesh_after(mesh, both).await;
    for (refused, pointers) in [(alone.await, vec!["/mesh_id"]), (in_batch.await, vec!["/jobs/0/mesh_id", "/jobs/1/mesh_id"])] {
        let Err(Error::Invalid(errors)) = refused else { panic!("{refused:?}") };
        assert_eq!(errors.iter().map(|error| error.pointer.as_str()).collect::<Vec<_>>(), pointers);
        assert!(errors.iter().all(|error| error.detail == NO_MESH), "{errors:?}");
    }
}
