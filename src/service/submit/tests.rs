//! Names in requests that stand for nothing usable, and keys of requests for further views.

use super::*;
use crate::inspection::InspectionParams;
use crate::planning::params::PlanParams;
use crate::service::store::Precondition;
use crate::service::tests::{ended_job, service};
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
        scanner: Named::Name("ours".to_owned()),
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

/// Two inspections of the same scans leave the same state.
#[tokio::test]
async fn a_key_that_was_used_for_the_rescan_of_another_inspection_is_refused() {
    let (app, _folder) = service().await;
    let job = ended_job(&app).await.id;
    let none = || RateCurveDocument { bins: Vec::new(), points: Vec::new() };
    let state = RescanState {
        schema: String::new(),
        plan_sha256: String::new(),
        plan_params: PlanParams::default(),
        target_of_mm2: 1.0,
        rounds: 0,
        measured: String::new(),
        hopeless: String::new(),
        easy_rate: 1.0,
        by_incidence: none(),
        by_mirror: none(),
        by_depth: none(),
    };
    let submitted = async |of: &InspectionJob| {
        let submission = Submission { idempotency_key: Some("key".to_owned()), ..Submission::default() };
        app.submit_rescan(of, StoredRescan { state: state.clone(), params: RescanParams::default() }, submission).await
    };
    let (first, second) = (inspection(job), inspection(job));
    let accepted = submitted(&first).await.expect("accepted");
    assert_eq!(submitted(&first).await.expect("the same").id, accepted.id);
    assert!(matches!(submitted(&second).await, Err(Error::IdempotencyMismatch)));
}
