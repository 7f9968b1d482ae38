use super::*;
use crate::planning::params::{FeatureParams, InterestParams, Region};
use crate::planning::plan::{Cause, RegionCoverage, RegionKind};
use crate::wire::words::shortfall;

fn everywhere() -> Region {
    Region::Box { min_mm: [-1e3; 3], max_mm: [1e3; 3] }
}

fn params(tolerances_mm: &[f64]) -> PlanParams {
    let feature = |tolerance_mm: &f64| FeatureParams {
        name: None,
        region: everywhere(),
        tolerance_mm: *tolerance_mm,
        point_spacing_mm: None,
        target: Some(0.95),
    };
    let mut params = PlanParams::default();
    params.regions.features = tolerances_mm.iter().map(feature).collect();
    params
}

/// A feature of 900 mm² of which nothing is measured.
fn feature() -> RegionCoverage {
    RegionCoverage {
        name: "bore".into(),
        kind: RegionKind::Feature,
        samples: 90,
        asked_area_mm2: 900.0,
        coverable_area_mm2: 0.0,
        measured_area_mm2: 0.0,
        target: Some(0.95),
        tolerance_mm: Some(0.05),
        min_tolerance_mm: NoiseParams::default().min_tolerance_mm(),
        missed_mm2: vec![(Cause::BelowGrade, 850.0), (Cause::ShadowLeft, 50.0)],
        beyond_noise_area_mm2: 850.0,
    }
}

#[test]
fn a_tolerance_beyond_the_noise_is_told_with_the_finest_that_is_served_and_what_moves_it() {
    let found = of_params(&params(&[0.2, 0.05, 0.156]), "/params");
    assert_eq!(found.len(), 1, "{found:#?}");
    assert_eq!(
        (found[0].code, found[0].pointer.as_str()),
        (WarningCode::ToleranceBeyondNoise, "/params/regions/features/1/tolerance_mm")
    );
    for said in [
        "is 0.05 mm",
        "0.156 mm",
        "regions.noise.best_mm (0.0117 mm)",
        "regions.noise.budget (0.3)",
        "VDA Volume 5",
        "our choice",
    ] {
        assert!(found[0].detail.contains(said), "{said:?} is not in {:?}", found[0].detail);
    }
    for knob in ["tolerance_mm", "regions.noise.best_mm", "regions.noise.budget"] {
        assert!(found[0].remedy.contains(knob), "{knob:?} is not in {:?}", found[0].remedy);
    }
}

#[test]
fn knobs_of_the_noise_move_the_finest_tolerance_and_own_values_have_no_source_of_ours() {
    let mut params = params(&[0.05]);
    params.regions.noise.budget = 0.5;
    let told = &of_params(&params, "")[0].detail;
    assert!(told.contains("0.094 mm") && told.contains("budget (0.5)") && !told.contains("VDA"), "{told}");
    params.regions.noise.best_mm = 0.005;
    assert_eq!(of_params(&params, ""), [], "4 · 0.005 / 0.5 is 0.04 mm");
}

#[test]
fn an_unmet_region_is_named_at_its_target_with_its_causes() {
    let mut params = params(&[0.05]);
    let interest = InterestParams {
        name: None,
        region: everywhere(),
        weight: 1.0,
        target: None,
        camera_deg: None,
        projector_deg: None,
        min_grade: None,
    };
    params.regions.interest = vec![interest];
    let met = RegionCoverage { measured_area_mm2: 900.0, missed_mm2: Vec::new(), beyond_noise_area_mm2: 0.0, ..feature() };
    let regions = [met, feature()].map(|region| RegionCoverageDocument::from(&region));
    let found = of_regions(&params, &regions, "/params");
    assert_eq!(found.len(), 1, "{found:#?}");
    assert_eq!((found[0].code, found[0].pointer.as_str()), (WarningCode::RegionUnmet, "/params/regions/features/0/target"));
    assert_eq!(
        found[0].detail,
        "is 0.95, and 0.00 % of the 900.0 mm² of \"bore\" are measured; missed: below_grade 850.0 mm² (tolerance beyond the \
         scanner's noise; the finest that it can serve is 0.156 mm), shadow_left 50.0 mm²"
    );
    assert!(found[0].remedy.contains("regions.noise.budget"), "{}", found[0].remedy);
}

#[test]
fn a_shortfall_names_causes_by_area_and_says_where_noise_is_a_part_of_it() {
    let partly = RegionCoverage { beyond_noise_area_mm2: 12.0, ..feature() };
    let told = shortfall(&partly).unwrap_or_default();
    assert!(told.starts_with("below_grade 850.0 mm² (tolerance beyond the scanner's noise on 12.0 mm²;"), "{told}");
    let without_noise = RegionCoverage { beyond_noise_area_mm2: 0.0, ..feature() };
    assert_eq!(shortfall(&without_noise).as_deref(), Some("below_grade 850.0 mm², shadow_left 50.0 mm²"));
    let empty = RegionCoverage { samples: 0, asked_area_mm2: 0.0, missed_mm2: Vec::new(), ..feature() };
    assert_eq!(shortfall(&empty).as_deref(), Some("it holds none of the asked surface"));
    assert_eq!(shortfall(&RegionCoverage { target: None, ..feature() }), None);
    assert_eq!(shortfall(&RegionCoverage { measured_area_mm2: 860.0, ..feature() }), None);
}
