use std::f64::consts::PI;
use std::sync::atomic::AtomicBool;

use nalgebra::Point3;

use super::*;
use crate::planning::context::Silent;
use crate::planning::ids::SampleId;
use crate::planning::params::{FeatureParams, InterestParams, Region};
use crate::planning::surface::requirements::{sampled, sampled_densely, sampled_sparsely};
use crate::planning::surface::sample_for;
use crate::testing::box_mesh;

/// Middle of the disc, on top of the plate.
const CENTRE_MM: [f64; 3] = [83.0, 117.0, 10.0];

/// A plate of 88 000 mm².
fn plate() -> Mesh {
    box_mesh([0.0; 3], [200.0, 200.0, 10.0])
}

/// A disc of an area on top of the plate.
fn disc(area_mm2: f64) -> Region {
    Region::Sphere { centre_mm: CENTRE_MM, radius_mm: (area_mm2 / PI).sqrt() }
}

fn interest(region: Region) -> InterestParams {
    InterestParams { name: None, region, weight: 1.0, target: Some(0.95), camera_deg: None, projector_deg: None, min_grade: None }
}

/// A sample for each of some 6000 patches: a region of 20 mm² has one or two.
fn params(regions: Vec<Region>) -> PlanParams {
    let mut params = PlanParams::default();
    (params.part.patch_edge_mm, params.part.samples_per_mm2) = (Some(10.0), Some(0.02));
    params.regions.interest = regions.into_iter().map(interest).collect();
    params
}

fn with<T>(act: impl FnOnce(&Context<'_>) -> Result<T, PlanError>) -> T {
    let cancel = AtomicBool::new(false);
    act(&Context::new(&cancel, &Silent)).unwrap_or_else(|error| panic!("{error}"))
}

/// The surface as it is without regard to regions.
fn plain(params: &PlanParams, seed: u64) -> Surface {
    with(|ctx| sample_for(&plate(), &params.part, &params.regions, seed, ctx))
}

/// Number and area of the asked samples in a region.
fn held(surface: &Surface, region: usize) -> (usize, f64) {
    let is_held = |sample: &SampleId| surface.asked[sample.index()] && surface.requirements.of(*sample).regions.contains(&region);
    let held: Vec<SampleId> = surface.samples().filter(is_held).collect();
    (held.len(), held.iter().map(|sample| surface.sample_area_mm2(*sample)).sum())
}

#[test]
fn a_disc_of_20_mm2_has_samples_of_its_own_that_tell_its_area_and_halves_without_bias() {
    let (mesh, params) = (plate(), params(vec![disc(20.0)]));
    let (mut area_mm2, mut left_mm2) = (0.0, 0.0);
    const SEEDS: u64 = 20;
    for seed in 0..SEEDS {
        let surface = with(|ctx| sampled(&mesh, &params, seed, ctx));
        let (samples, of_disc_mm2) = held(&surface, 0);
        assert!((SAMPLES_OF_A_REGION..2 * SAMPLES_OF_A_REGION).contains(&samples), "{samples} samples with seed {seed}");
        // With 100 plain random points the standard error is 2 mm².
        assert!((of_disc_mm2 - 20.0).abs() < 2.0, "{of_disc_mm2} mm² with seed {seed}");
        assert!((surface.area_where(|_| true) - 88_000.0).abs() < 1e-6, "every patch stands for its area");
        area_mm2 += of_disc_mm2 / SEEDS as f64;
        // Views that see the plate up to x = 83 mm see half of the disc.
        let is_left = |sample: SampleId| {
            !surface.requirements.of(sample).regions.is_empty() && surface.sample_mm[sample.index()].x < CENTRE_MM[0]
        };
        left_mm2 += surface.area_where(is_left) / SEEDS as f64;
    }
    assert!((area_mm2 - 20.0).abs() < 0.2 && (left_mm2 / area_mm2 - 0.5).abs() < 0.01, "{left_mm2} of {area_mm2} mm²");
}

/// Number of samples of equal area that tell as much as the asked ones in a region.
fn effective(surface: &Surface, region: usize) -> f64 {
    let is_held = |sample: &SampleId| surface.asked[sample.index()] && surface.requirements.of(*sample).regions.contains(&region);
    let mut sum = Effective::default();
    surface.samples().filter(is_held).for_each(|sample| sum.add(1, surface.sample_area_mm2(sample)));
    sum.number()
}

/// The inner disc draws thousands of samples to the patch that it lies in; a fifth of the middle one lies in the next.
#[test]
fn discs_around_a_disc_have_samples_in_all_their_patches() {
    const SEEDS: u64 = 20;
    let mesh = plate();
    // Patches have edges at x = 81.25 mm.
    let disc = |radius_mm: f64| Region::Sphere { centre_mm: [81.75, 115.6, 10.0], radius_mm };
    let params = params(vec![disc(0.3), disc(1.0), disc(5.0)]);
    let mut square = 0.0;
    for seed in 0..SEEDS {
        let surface = with(|ctx| sampled(&mesh, &params, seed, ctx));
        for region in [1, 2] {
            let number = effective(&surface, region);
            assert!(number >= 100.0, "disc {region} has {number} samples of equal area with seed {seed}");
        }
        square += (held(&surface, 1).1 / PI - 1.0).powi(2) / SEEDS as f64;
    }
    assert!(square.sqrt() < 0.06, "the area of 3.14 mm² is told to {square:?}, squared");
}

/// 60 discs of a radius of 3 mm, 2 mm around a point: they overlap in some 3500 ways.
#[test]
fn discs_that_overlap_in_more_than_255_ways_have_their_samples() {
    let disc = |index: u32| {
        let (sin, cos) = (f64::from(index) * PI / 30.0).sin_cos();
        let [x, y, z] = CENTRE_MM;
        Region::Sphere { centre_mm: [x + 2.0 * cos, y + 2.0 * sin, z], radius_mm: 3.0 }
    };
    let params = params((0..60).map(disc).collect());
    let surface = with(|ctx| sampled_densely(&plate(), &params, (475, 7), ctx));
    assert!(surface.requirements.kinds.len() > 256, "{} kinds", surface.requirements.kinds.len());
    for region in 0..60 {
        let (samples, area_mm2) = held(&surface, region);
        assert!(samples >= 475 && (area_mm2 / (9.0 * PI) - 1.0).abs() < 0.1, "{region}: {samples} samples of {area_mm2} mm²");
    }
}

#[test]
fn samples_of_unequal_area_count_as_fewer() {
    let mut sum = Effective::default();
    assert_eq!(sum.number(), 0.0);
    sum.add(100, 0.25);
    assert!((sum.number() - 100.0).abs() < 1e-9, "{sum:?}");
    // 25 and 25 mm²: 50² / (100 · 0.25² + 25²).
    sum.add(1, 25.0);
    assert!((sum.number() - 2500.0 / 631.25).abs() < 1e-9, "{sum:?}");
}

#[test]
fn a_second_set_has_as_many_as_are_asked_for() {
    let params = params(vec![disc(20.0)]);
    let surface = with(|ctx| sampled_densely(&plate(), &params, (475, 7), ctx));
    let (samples, area_mm2) = held(&surface, 0);
    assert!((475..950).contains(&samples) && (area_mm2 - 20.0).abs() < 1.0, "{samples} samples of {area_mm2} mm²");
}

#[test]
fn patches_that_no_small_region_touches_keep_their_samples_and_others_keep_theirs_first() {
    let params = params(vec![disc(20.0)]);
    let (plain, surface) = (plain(&params, 3), with(|ctx| sampled(&plate(), &params, 3, ctx)));
    assert_eq!(plain.patches.len(), surface.patches.len());
    let mut denser = 0;
    for (before, after) in plain.patches.iter().zip(&surface.patches) {
        let own = |surface: &Surface, patch: &Patch| {
            let first = patch.first_sample.index();
            surface.sample_mm[first..first + before.samples as usize].to_vec()
        };
        assert_eq!(own(&plain, before), own(&surface, after));
        assert!((before.area_mm2 - after.area_mm2).abs() < 1e-12);
        denser += usize::from(before.samples != after.samples);
        let middle = Point3::from(before.corners_mm.iter().map(|corner| corner.coords).sum::<nalgebra::Vector3<f64>>() / 3.0);
        let is_near = (middle - Point3::from(CENTRE_MM)).norm() < 20.0;
        assert!(is_near || before.samples == after.samples, "a patch at {middle} is far from the disc");
    }
    assert!((2..20).contains(&denser), "{denser} patches are denser");
}

#[test]
fn samples_stay_the_same_without_regions_and_where_regions_have_enough() {
    // Half of the plate has 3000 samples.
    let half = Region::HalfSpace { point_mm: [100.0, 0.0, 0.0], normal: [1.0, 0.0, 0.0] };
    for regions in [Vec::new(), vec![half]] {
        let params = params(regions);
        let (plain, surface) = (plain(&params, 5), with(|ctx| sampled(&plate(), &params, 5, ctx)));
        assert_eq!((plain.sample_mm, plain.sample_patch, plain.asked), (surface.sample_mm, surface.sample_patch, surface.asked));
    }
}

#[test]
fn samples_that_are_not_asked_count_for_no_region() {
    let mut params = params(vec![disc(20.0)]);
    params.regions.exclude = vec![Region::HalfSpace { point_mm: CENTRE_MM, normal: [1.0, 0.0, 0.0] }];
    let (samples, area_mm2) = held(&with(|ctx| sampled(&plate(), &params, 1, ctx)), 0);
    assert!(samples >= SAMPLES_OF_A_REGION && (area_mm2 - 10.0).abs() < 1.0, "{samples} samples of {area_mm2} mm²");
}

#[test]
fn a_region_that_is_a_small_part_of_its_patches_or_beside_the_part_takes_no_more_than_it_may() {
    // A pin-prick of 0.13 mm² in patches of some 20 mm².
    let params = params(vec![disc(0.04 * PI), Region::Sphere { centre_mm: [300.0, 0.0, 0.0], radius_mm: 5.0 }]);
    let (plain, surface) = (plain(&params, 1), with(|ctx| sampled(&plate(), &params, 1, ctx)));
    let added = surface.sample_mm.len() - plain.sample_mm.len();
    assert!((1..=MAX_FOR_EACH * SAMPLES_OF_A_REGION).contains(&added), "{added} samples more");
    assert!((10..SAMPLES_OF_A_REGION).contains(&held(&surface, 0).0), "{:?}", held(&surface, 0));
    assert_eq!(held(&surface, 1).0, 0);
}

#[test]
fn every_kind_of_region_that_is_small_has_samples_of_its_own() {
    let strip = Region::Plane { point_mm: [50.3, 0.0, 0.0], normal: [1.0, 0.0, 0.0], within_mm: 0.2 };
    let corner = Region::Box { min_mm: [-1.0; 3], max_mm: [4.0, 4.0, 11.0] };
    let edge = Region::HalfSpace { point_mm: [0.05, 0.0, 0.0], normal: [1.0, 0.0, 0.0] };
    // One of the two triangles of the wall at y = 0.
    let wall = Region::Faces { faces: vec![4] };
    let mut params = params(vec![strip, corner, edge]);
    params.regions.features =
        vec![FeatureParams { name: None, region: wall, tolerance_mm: 0.4, point_spacing_mm: None, target: None }];
    let surface = with(|ctx| sampled_densely(&plate(), &params, (400, 9), ctx));
    // Around the plate, two walls with the corner above and below it, and all of one side with a rim.
    let exact_mm2 = [0.4 * 420.0, 2.0 * 16.0 + 80.0, 2000.0 + 0.05 * 420.0, 1000.0];
    for (region, exact_mm2) in exact_mm2.into_iter().enumerate() {
        let (samples, area_mm2) = held(&surface, region);
        assert!(samples >= 400, "region {region} has {samples} samples");
        assert!((area_mm2 / exact_mm2 - 1.0).abs() < 0.1, "region {region}: {area_mm2} of {exact_mm2} mm²");
    }
}

#[test]
fn a_small_region_of_a_mesh_that_is_sampled_sparsely_stands_for_itself() {
    let mesh = crate::geometry::demo_parts::figurine(8_000).unwrap_or_else(|error| panic!("{error}"));
    let params = params(vec![Region::Faces { faces: (0..40).collect() }]);
    let own_mm2: f64 = (0..40).map(|face| mesh.face_area_mm2(face)).sum();
    assert!(own_mm2 < 0.05 * mesh.area_mm2(), "{own_mm2} mm² are small");
    let surface = with(|ctx| sampled_sparsely(&mesh, &params, (500, 100, 7), ctx));
    let (samples, area_mm2) = held(&surface, 0);
    assert!(samples >= 100 && (area_mm2 / own_mm2 - 1.0).abs() < 1e-9, "{samples} samples of {area_mm2} mm²");
    assert!((surface.area_where(|_| true) / mesh.area_mm2() - 1.0).abs() < 1e-9);
    assert!(surface.sample_mm.len() < 1_000, "{}", surface.sample_mm.len());
    // Without regions, the samples are those that stand for all.
    let without = PlanParams { regions: crate::planning::params::RegionParams::default(), ..params };
    let same = with(|ctx| sampled_sparsely(&mesh, &without, (500, 100, 7), ctx));
    let some = with(|ctx| crate::planning::surface::sample_some(&mesh, &without.regions, (500, 7), ctx));
    assert_eq!(same.sample_mm, some.sample_mm);
}

#[test]
fn triangles_of_small_regions_stand_for_others_where_they_are_more_than_there_may_be() {
    const MAX: usize = 500;
    let mesh = crate::geometry::demo_parts::figurine(8_000).unwrap_or_else(|error| panic!("{error}"));
    let half = mesh.faces.len() / 2;
    let params = params(vec![Region::Faces { faces: (0..half as u32).collect() }]);
    let own_mm2: f64 = (0..half).map(|face| mesh.face_area_mm2(face)).sum();
    assert!(half > MAX && own_mm2 > 0.2 * mesh.area_mm2(), "{half} triangles, {own_mm2} mm²");
    let surface = with(|ctx| sampled_sparsely(&mesh, &params, (MAX, 475, 7), ctx));
    let (samples, area_mm2) = held(&surface, 0);
    assert!(surface.patches.len() <= MAX, "{} patches", surface.patches.len());
    assert!(samples >= 475 && (area_mm2 / own_mm2 - 1.0).abs() < 0.02, "{samples} samples of {area_mm2} of {own_mm2} mm²");
    assert!((surface.area_where(|_| true) / mesh.area_mm2() - 1.0).abs() < 1e-9);
}

#[test]
fn the_density_is_raised_until_a_region_holds_enough_or_may_have_no_more() {
    // A region that is a tenth of an area of 50 mm².
    let held = |per_mm2: f64| (5.0 * per_mm2).floor();
    let found = density(50.0, 125.0, 5_000.0, held).unwrap_or_default();
    assert!((125.0..160.0).contains(&held(found)), "{found} a mm²");
    let most = density(50.0, 125.0, 500.0, held).unwrap_or_default();
    assert!((most - 10.0).abs() < 1e-12, "{most} a mm²");
    assert_eq!(density(50.0, 125.0, 5_000.0, |_| 0.0), None);
    assert_eq!(density(0.0, 125.0, 5_000.0, |_| 0.0), None);
}
