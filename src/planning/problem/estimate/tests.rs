use super::*;
use crate::planning::params::{CandidateParams, FeatureParams, Region};
use crate::testing::{box_mesh, nominal_scanner};

fn estimate_of(mesh: &Mesh, params: &PlanParams) -> Estimate {
    let scanner = nominal_scanner();
    Estimate::of(&PlanInput { mesh, fixture: None, part_sha256: "", scanner: &scanner, cell: None, roadmaps: None }, params, 2)
}

fn refusal(mesh: &Mesh, params: &PlanParams, allowed: &Allowance) -> (String, String) {
    match estimate_of(mesh, params).check(allowed) {
        Err(PlanError::BadParams(errors)) => (errors[0].pointer.clone(), errors[0].detail.clone()),
        other => panic!("{other:?}"),
    }
}

#[test]
fn counts_are_those_of_the_box() {
    let counts = estimate_of(&box_mesh([0.0; 3], [1000.0; 3]), &PlanParams::default()).counts;
    // Eight blocks of 125 mm along each edge, 296 of 512 at the surface.
    assert_eq!((counts.blocks_along, counts.triangles), ([8.0; 3], 12.0));
    assert!((296.0..=384.0).contains(&counts.blocks), "{counts:?}");
    assert!(counts.samples >= 50_000.0 && counts.views >= 184.0 && counts.views < 400.0, "{counts:?}");
    let small = estimate_of(&box_mesh([0.0; 3], [100.0; 3]), &PlanParams::default()).counts;
    // 300 that know the part, and eight beside each of some forty views.
    assert!(small.blocks == 1.0 && (600.0..=650.0).contains(&small.candidates), "{small:?}");
}

#[test]
fn more_of_anything_never_takes_less() {
    let mesh = box_mesh([0.0; 3], [300.0; 3]);
    let base = estimate_of(&mesh, &PlanParams::default());
    let with = |change: &dyn Fn(&mut PlanParams)| {
        let mut params = PlanParams::default();
        change(&mut params);
        estimate_of(&mesh, &params)
    };
    for more in [
        with(&|params| params.part.samples_per_mm2 = Some(5.0)),
        with(&|params| params.part.patch_edge_mm = Some(1.0)),
        with(&|params| params.candidates.rolls_deg = vec![0.0, 30.0, 60.0, 90.0]),
        with(&|params| params.candidates.even_directions = Some(600)),
        with(&|params| params.setups = 2),
        with(&|params| params.robust.select = true),
        with(&|params| params.selection.solver = Solver::Certified),
    ] {
        assert!(more.bytes.sum() > base.bytes.sum() && more.core_secs.sum() >= base.core_secs.sum(), "{more:?}, {base:?}");
    }
}

#[test]
fn what_is_refused_names_figure_limit_and_parameter() {
    let free = Allowance::default();
    let (pointer, detail) = refusal(&box_mesh([0.0; 3], [100_000.0, 1.0, 1.0]), &PlanParams::default(), &free);
    assert!(pointer == "/part" && detail.contains("100000 × 1 × 1 mm") && detail.contains("right unit?"), "{detail}");
    let cube = box_mesh([0.0; 3], [100.0; 3]);
    assert_eq!(estimate_of(&cube, &PlanParams::default()).check(&free), Ok(()));
    let gibibyte = Allowance { bytes: 1_073_741_824.0, ..free };
    let mut dense = PlanParams::default();
    dense.part.samples_per_mm2 = Some(300.0);
    let (pointer, detail) = refusal(&cube, &dense, &gibibyte);
    assert_eq!(pointer, "/part/samples_per_mm2");
    assert!(
        detail.starts_with("makes the plan take at least ")
            && detail.contains(" GiB of memory, for 12 triangles, ")
            && detail.ends_with(" views; allowed are 1.0 GiB (limits.job_memory_bytes, --max-memory): take fewer samples"),
        "{detail}"
    );
    let mut fine = PlanParams::default();
    fine.part.patch_edge_mm = Some(0.2);
    assert_eq!(refusal(&cube, &fine, &gibibyte).0, "/part/patch_edge_mm");
    let mut many = PlanParams::default();
    many.candidates.even_directions = Some(9_000);
    let second = Allowance { core_secs: 1.0, ..free };
    let (pointer, detail) = refusal(&cube, &many, &second);
    assert!(
        pointer == "/candidates"
            && detail.contains(" s of one core, for 12 triangles, ")
            && detail.contains("1 s of one core, which is the time limit times the threads (limits.job_secs, --max-secs)")
            && detail.ends_with(": take larger steps, fewer even_directions, rolls_deg or standoffs_mm, or fewer samples"),
        "{detail}"
    );
}

/// 1500 features of a small part took 3.3 GB, of which nothing was reckoned with.
#[test]
fn targets_of_many_features_are_reckoned_with_and_refused_by_name() {
    let mesh = box_mesh([0.0; 3], [60.1, 40.1, 30.1]);
    let of_features = |count: usize, target: Option<f64>| {
        let region = Region::Sphere { centre_mm: [30.0, 20.0, 30.1], radius_mm: 2.0 };
        let feature = FeatureParams { name: None, region, tolerance_mm: 0.4, point_spacing_mm: None, target };
        let mut params = PlanParams::default();
        params.regions.features = vec![feature; count];
        params
    };
    let bytes = |params: &PlanParams| estimate_of(&mesh, params).bytes.sum();
    let without = bytes(&PlanParams::default());
    assert!((bytes(&of_features(1_500, None)) - without).abs() < 1.0, "without a target there is no goal");
    let (few, many) = (bytes(&of_features(300, Some(0.9))) - without, bytes(&of_features(1_500, Some(0.9))) - without);
    assert!((0.65e9..1.95e9).contains(&few) && (3.2e9..9.6e9).contains(&many), "{few} and {many} bytes");
    let allowed = Allowance { bytes: 16e9, ..Allowance::default() };
    let (pointer, detail) = refusal(&mesh, &of_features(10_000, Some(0.9)), &allowed);
    assert!(pointer == "/regions" && detail.contains("fewer regions of interest and features a target"), "{detail}");
}

#[test]
fn candidates_that_no_job_may_have_are_refused_before_samples_are_made() {
    let params = PlanParams {
        candidates: CandidateParams { step_small_deg: 1.0, step_large_deg: 1.0, ..CandidateParams::ellipsoid() },
        ..PlanParams::default()
    };
    let (pointer, detail) = refusal(&box_mesh([0.0; 3], [100.0; 3]), &params, &Allowance::default());
    assert!(pointer == "/candidates/strategies" && detail.contains("allowed are 50000 candidates"), "{detail}");
}
