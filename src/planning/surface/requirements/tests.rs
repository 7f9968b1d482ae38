use super::*;
use crate::planning::params::{FeatureParams, Region};
use crate::planning::surface::sample;
use crate::testing::box_mesh;

fn slab(axis: usize, from_mm: f64, to_mm: f64) -> Region {
    let (mut min_mm, mut max_mm) = ([-1e3; 3], [1e3; 3]);
    (min_mm[axis], max_mm[axis]) = (from_mm, to_mm);
    Region::Box { min_mm, max_mm }
}

fn interest(region: Region) -> InterestParams {
    InterestParams { name: None, region, weight: 1.0, target: None, camera_deg: None, projector_deg: None, min_grade: None }
}

fn requirements(params: &PlanParams) -> (Surface, Requirements) {
    let mesh = box_mesh([0.0; 3], [30.0; 3]);
    let surface = sample(&mesh, &params.part, &params.regions, 0).unwrap_or_else(|errors| panic!("{errors:?}"));
    let requirements = Requirements::new(&mesh, &surface, params).unwrap_or_else(|errors| panic!("{errors:?}"));
    (surface, requirements)
}

#[test]
fn without_regions_every_sample_is_asked_the_same() {
    let (_, requirements) = requirements(&PlanParams::default());
    assert_eq!(requirements, Requirements::default());
    assert!(!requirements.any_requires_quality());
}

#[test]
fn where_regions_overlap_the_greatest_weight_and_the_strictest_limits_count() {
    let mut params = PlanParams::default();
    params.regions.interest = vec![
        InterestParams { weight: 3.0, camera_deg: Some(50.0), min_grade: Some(Grade::C), ..interest(slab(2, -1.0, 20.0)) },
        InterestParams { weight: 0.5, camera_deg: Some(40.0), min_grade: Some(Grade::B), ..interest(slab(2, 10.0, 31.0)) },
    ];
    let (surface, requirements) = requirements(&params);
    for (sample, p) in SampleId::number(&surface.sample_mm) {
        let requirement = requirements.of(sample);
        let (regions, weight, camera_deg, grade) = match p.z {
            z if z < 10.0 => (vec![0], 3.0, 50.0_f64, Grade::C),
            z if z <= 20.0 => (vec![0, 1], 3.0, 40.0, Grade::B),
            _ => (vec![1], 0.5, 40.0, Grade::B),
        };
        assert_eq!((&requirement.regions, requirement.weight, requirement.min_grade), (&regions, weight, Some(grade)), "at {p}");
        assert_eq!(requirement.camera_max_rad, Some(camera_deg.to_radians()));
    }
}

#[test]
fn a_finer_tolerance_weighs_more_and_allows_less_noise() {
    let mut params = PlanParams::default();
    let feature = |region, tolerance_mm| FeatureParams { name: None, region, tolerance_mm, point_spacing_mm: None, target: None };
    params.regions.features = vec![feature(slab(2, -1.0, 1.0), 0.4), feature(slab(2, 29.0, 31.0), 0.1)];
    let (surface, requirements) = requirements(&params);
    let at = |low: bool| {
        let is_there = |p: &Point3<f64>| if low { p.z < 1.0 } else { p.z > 29.0 };
        surface.samples().find(|sample| is_there(&surface.sample_mm[sample.index()]))
    };
    let [coarse, fine] = [true, false].map(|low| requirements.of(at(low).unwrap_or_else(|| panic!("a sample"))));
    assert_eq!((coarse.weight, fine.weight), (1.0, 4.0));
    assert!((coarse.noise_max_mm.unwrap_or(0.0) - 0.3 * 0.4 / 4.0).abs() < 1e-15);
    assert!((fine.noise_max_mm.unwrap_or(0.0) - 0.3 * 0.1 / 4.0).abs() < 1e-15);
}

#[test]
fn the_finest_tolerance_is_the_one_that_the_noise_at_best_focus_just_fits() {
    let mut params = PlanParams::default();
    let feature = |tolerance_mm| FeatureParams {
        name: None,
        region: slab(2, -1.0, 1.0),
        tolerance_mm,
        point_spacing_mm: None,
        target: None,
    };
    let min_mm = params.regions.noise.min_tolerance_mm();
    assert!((min_mm - 4.0 * 0.035 / 3.0 / 0.3).abs() < 1e-12 && (0.155..0.156).contains(&min_mm), "{min_mm}");
    params.regions.features = vec![feature(0.4), feature(min_mm * (1.0 - 1e-9)), feature(min_mm * (1.0 + 1e-9))];
    let beyond: Vec<usize> = params.regions.beyond_noise().map(|(index, _)| index).collect();
    assert_eq!(beyond, [1]);
    params.regions.noise.budget = 0.1;
    assert_eq!(params.regions.beyond_noise().count(), 3, "a third of the budget serves three times as coarse tolerances");
}

#[test]
fn regions_are_numbered_with_their_kind_regions_of_interest_first() {
    let mut params = PlanParams::default();
    let feature = |name: Option<&str>| FeatureParams {
        name: name.map(str::to_owned),
        region: slab(2, -1.0, 1.0),
        tolerance_mm: 0.4,
        point_spacing_mm: None,
        target: Some(0.5),
    };
    params.regions.features = vec![feature(Some("bore")), feature(None)];
    params.regions.interest = vec![interest(slab(2, -1.0, 1.0))];
    let found = regions(&params);
    let told: Vec<_> = found.iter().map(|region| (region.name.as_str(), region.kind.as_str(), region.tolerance_mm)).collect();
    assert_eq!(told, [("interest 1", "interest", None), ("bore", "feature", Some(0.4)), ("feature 2", "feature", Some(0.4))]);
}

#[test]
fn a_region_that_the_part_does_not_have_is_named() {
    let mut params = PlanParams::default();
    params.regions.interest = vec![interest(Region::Name { name: "bore".into() })];
    let mesh = box_mesh([0.0; 3], [30.0; 3]);
    let surface = sample(&mesh, &params.part, &params.regions, 0).unwrap_or_else(|errors| panic!("{errors:?}"));
    let errors = Requirements::new(&mesh, &surface, &params).err().unwrap_or_default();
    assert_eq!(errors[0].pointer, "/regions/interest/0/region/name");
    assert!(errors[0].detail.contains("no named groups"), "{errors:?}");
}
