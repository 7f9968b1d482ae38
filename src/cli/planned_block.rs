//! A plan that unit tests of commands read.

use std::sync::atomic::AtomicBool;

use crate::geometry::LengthUnit;
use crate::planning::context::{Context, Silent};
use crate::planning::params::{CandidateParams, PlanParams};
use crate::service::plan_job::{PLAN_FILE, PlanJob, bytes_of};
use crate::testing::{box_mesh, nominal_scanner};
use crate::wire::echo::Echo;

/// The plan of two views of the block, quickly made.
pub(crate) fn plan_of_two_views() -> serde_json::Value {
    serde_json::from_slice(&bytes_of_two_views()).expect("JSON")
}

/// Bytes of that plan.
pub(crate) fn bytes_of_two_views() -> Vec<u8> {
    let mut params = PlanParams { candidates: CandidateParams::ellipsoid(), ..PlanParams::default() };
    (params.part.samples_per_mm2, params.part.patch_edge_mm) = (Some(0.1), Some(20.0));
    (params.selection.max_views, params.missed.remedies, params.missed.advice) = (Some(2), 0, false);
    params.robust.pose_error = None;
    plan_of_block(&params)
}

/// Bytes of the plan of a block of 60 × 40 × 30 mm without a cell.
pub(crate) fn plan_of_block(params: &PlanParams) -> Vec<u8> {
    let (mesh, scanner) = (box_mesh([0.0; 3], [60.0, 40.0, 30.0]), nominal_scanner());
    let job = PlanJob {
        mesh: &mesh,
        fixture: None,
        fixture_sha256: None,
        part_name: "block".into(),
        part_sha256: &"0a".repeat(32),
        unit: LengthUnit::Millimetre,
        scanner: &scanner,
        cell: None,
        roadmaps: None,
        rescan: None,
        params,
        echo: Echo::default(),
        date: None,
    };
    let files = job.execute(&Context::new(&AtomicBool::new(false), &Silent)).unwrap_or_else(|error| panic!("no plan: {error}"));
    bytes_of(&files, PLAN_FILE).to_vec()
}
