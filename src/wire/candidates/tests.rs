use std::sync::atomic::AtomicBool;

use super::*;
use crate::planning::context::Silent;
use crate::planning::params::{CandidateParams, PlanParams};
use crate::planning::{PlanInput, plan};
use crate::testing::{box_mesh, nominal_scanner};

#[test]
fn consecutive_samples_are_one_run() {
    let of = |samples: &[u32]| runs(samples.iter().map(|sample| SampleId(*sample)));
    assert_eq!(of(&[]), [] as [[u32; 2]; 0]);
    assert_eq!(of(&[7]), [[7, 1]]);
    assert_eq!(of(&[0, 1, 2, 5, 63, 64, 65, 99]), [[0, 3], [5, 1], [63, 3], [99, 1]]);
}

#[test]
fn a_quality_has_four_decimals_and_no_sign_at_zero() {
    let text = |quality: f32| serde_json::to_string(&rounded(quality)).expect("a number");
    assert_eq!([0.123_44, -0.987_66, 1.0, 0.3].map(text), ["0.1234", "-0.9877", "1.0", "0.3"]);
    assert_eq!([0.000_01, -0.000_01].map(text), ["0.0", "0.0"]);
}

#[test]
fn a_file_that_would_be_too_large_is_refused_with_what_to_change() {
    let (mesh, scanner) = (box_mesh([0.0; 3], [60.0, 40.0, 20.0]), nominal_scanner());
    let mut params = PlanParams { candidates: CandidateParams::ellipsoid(), ..PlanParams::default() };
    (params.part.samples_per_mm2, params.part.patch_edge_mm) = (Some(0.1), Some(20.0));
    (params.output.candidates, params.missed.remedies) = (true, 0);
    let input = PlanInput { mesh: &mesh, fixture: None, part_sha256: "", scanner: &scanner, cell: None, roadmaps: None };
    let (flag, cancelled) = (AtomicBool::new(false), AtomicBool::new(true));
    let ctx = Context::new(&flag, &Silent);
    let outcome = plan(&input, &params, &ctx).expect("a plan");
    let table = outcome.candidates.as_ref().expect("asked for");
    let whole = write(&outcome, table, &mesh, "", MAX_LISTING_BYTES, &ctx).expect("small");
    assert_eq!(file_bytes(&outcome, &mesh, "", &ctx), Some(Ok(whole.clone())));
    let given_up = file_bytes(&outcome, &mesh, "", &Context::new(&cancelled, &Silent));
    assert_eq!(given_up, Some(Err(ListingError::Cancelled(Cancelled))));
    assert_eq!(whole.iter().filter(|byte| **byte == b'\n').count(), table.entries.len() + 2, "a candidate a line");
    for max_bytes in [10, whole.len() / 2] {
        let refused = write(&outcome, table, &mesh, "", max_bytes, &ctx).expect_err("too large").to_string();
        assert!(refused.contains("would be larger") && refused.contains("part.samples_per_mm2"), "{refused}");
    }
}
