use std::f64::consts::TAU;
use std::sync::atomic::AtomicBool;

use super::*;
use crate::geometry::{Mesh, Pose};
use crate::planning::candidates::looking_along;
use crate::planning::context::Silent;
use crate::planning::params::PlanParams;
use crate::planning::surface;
use crate::planning::visibility::Optics;
use crate::testing::{box_mesh, cylinder_mesh, nominal_scanner};

fn sampled(mesh: &Mesh) -> Surface {
    let params = PlanParams::default();
    let cancel = AtomicBool::new(false);
    let ctx = Context::new(&cancel, &Silent);
    surface::sample_for(mesh, &params.part, &params.regions, 0, &ctx).unwrap_or_else(|error| panic!("{error}"))
}

/// Samples whose normal points within a few degrees of one of `normals`.
fn facing(surface: &Surface, normals: &[Vector3<f64>]) -> SampleSet {
    let mut set = SampleSet::none_of(surface.sample_mm.len());
    let faces = |sample: &SampleId| normals.iter().any(|normal| normal.dot(&surface.patch_of(*sample).normal) > 0.99);
    surface.samples().filter(faces).for_each(|sample| set.insert(sample));
    set
}

fn all_of(surface: &Surface) -> SampleSet {
    let mut set = SampleSet::none_of(surface.sample_mm.len());
    surface.samples().for_each(|sample| set.insert(sample));
    set
}

#[test]
fn a_corner_fixes_all_freedoms_and_a_face_none_along_itself() {
    let surface = sampled(&box_mesh([0.0; 3], [60.0, 40.0, 30.0]));
    let [x, y, z] = [Vector3::x(), Vector3::y(), Vector3::z()];
    let corner = SharedSurface::new(&surface).stability(&facing(&surface, &[x, y, z]));
    assert!(corner.is_fixed() && (corner.shared_area_mm2 - 5400.0).abs() < 1e-6, "{corner:?}");
    // The four walls around z resist neither a shift along z nor, to either side of their middle, more than a little of a tilt.
    let walls = SharedSurface::new(&surface).stability(&facing(&surface, &[x, y, -x, -y]));
    assert!(walls.resistance < 1e-12 && walls.shift_in_part.z > 0.99, "{walls:?}");
    // Rounding left a resistance of 1e-17, and an expected error of metres.
    let measured = uniform(&surface, &facing(&surface, &[x, y, -x, -y]), 0.01);
    assert_eq!(SharedSurface::new(&surface).registration(&measured, &measured).expected_error_mm, None, "{walls:?}");
    let face = SharedSurface::new(&surface).stability(&facing(&surface, &[z]));
    assert!(face.resistance < 1e-12 && face.shift_in_part.z.abs() < 1e-6, "{face:?}");
    let nothing = SharedSurface::new(&surface).stability(&SampleSet::none_of(surface.sample_mm.len()));
    assert_eq!((nothing.shared_area_mm2, nothing.resistance, nothing.is_fixed()), (0.0, 0.0, false));
}

/// A cylinder with both ends turns about its axis: with n facets of half width w = r·tan(π / n) a point is w / √3 off the foot of
/// the axis on its facet (root mean square), which is all that resists.
#[test]
fn a_cylinder_turns_about_its_axis_alone() {
    let (radius_mm, height_mm, facets) = (20.0, 50.0, 256);
    let surface = sampled(&cylinder_mesh(radius_mm, height_mm, facets));
    let cylinder = SharedSurface::new(&surface).stability(&all_of(&surface));
    let off_mm = radius_mm * (TAU / 2.0 / f64::from(facets)).tan() / 3.0_f64.sqrt();
    let side = height_mm / (height_mm + radius_mm);
    let radius_of_part_mm = radius_mm.hypot(0.5 * height_mm);
    let expected = side * (off_mm / radius_of_part_mm).powi(2);
    assert!((cylinder.resistance / expected - 1.0).abs() < 0.05, "{} beside {expected}", cylinder.resistance);
    assert!(!cylinder.is_fixed() && cylinder.turn_in_part.z.abs() > 0.99, "{cylinder:?}");
}

/// A measurement of these samples by 100 points a mm², with independent noise of `noise_mm`.
fn uniform(surface: &Surface, samples: &SampleSet, noise_mm: f64) -> MeasuredSurface {
    let mut information = vec![0.0; surface.sample_mm.len()];
    let of_area = 100.0 / (noise_mm * noise_mm);
    samples.iter().for_each(|sample| information[sample.index()] = of_area * surface.sample_area_mm2(sample));
    MeasuredSurface { samples: samples.clone(), information }
}

/// Faces x, y and z of a cube, a third of the shared area each: √(σ₁² + σ₂²) / √(λ N) of N points.
#[test]
fn the_expected_error_is_that_of_least_squares() {
    let surface = sampled(&box_mesh([0.0; 3], [40.0; 3]));
    let (part, [x, y, z]) = (SharedSurface::new(&surface), [Vector3::x(), Vector3::y(), Vector3::z()]);
    let corner = facing(&surface, &[x, y, z]);
    for (noise_mm, variances_mm2) in [([0.01, 0.01], 2e-4), ([0.01, 0.02], 5e-4)] {
        let [a, b] = noise_mm.map(|noise_mm| uniform(&surface, &corner, noise_mm));
        let found = part.registration(&a, &b);
        let expected_mm = (variances_mm2 / (found.resistance * 100.0 * found.shared_area_mm2)).sqrt();
        let error_mm = found.expected_error_mm.unwrap_or(f64::NAN);
        assert!((error_mm / expected_mm - 1.0).abs() < 1e-9, "{error_mm} beside {expected_mm}");
    }
    let nothing = uniform(&surface, &SampleSet::none_of(surface.sample_mm.len()), 0.01);
    assert_eq!(part.registration(&nothing, &uniform(&surface, &corner, 0.01)).expected_error_mm, None);
}

/// The noise was that at best focus, seen straight on, wherever a view stood.
#[test]
fn the_expected_error_is_from_the_noise_at_the_depth_and_the_incidence_of_each_sample() {
    let (surface, scanner, params) = (sampled(&box_mesh([0.0; 3], [40.0; 3])), nominal_scanner(), PlanParams::default());
    let optics = Optics::new(&scanner, &params, &surface.requirements);
    let (part, [x, y, z]) = (SharedSurface::new(&surface), [Vector3::x(), Vector3::y(), Vector3::z()]);
    let corner = facing(&surface, &[x, y, z]);
    let row = Row::from_samples(surface.sample_mm.len(), corner.iter().map(|sample| (sample, 0.5)));
    let axis = -Vector3::new(1.0, 1.0, 1.0).normalize();
    let at = |distance_mm: f64| {
        let place_mm = Point3::new(40.0, 40.0, 40.0) - axis * distance_mm;
        optics.at(&Pose::from_parts(place_mm.coords, looking_along(&axis, 0.0)))
    };
    let told = |distance_mm: f64| part.measured([(at(distance_mm), &row)]);
    let [_, far_mm] = scanner.working_depth_mm();
    let [focus, far] = [scanner.best_mm, far_mm].map(told);
    // Of the sample at the corner itself z is the distance, and 1 / cos i = √3: twice the noise at the end of the depth.
    let focal_px = scanner.devices.cameras().into_iter().map(|camera| camera.lens.focal_px()).fold(f64::INFINITY, f64::min);
    let at_corner = corner.iter().min_by(|a, b| {
        let off_mm = |sample: &SampleId| (surface.sample_mm[sample.index()] - Point3::new(40.0, 40.0, 40.0)).norm();
        off_mm(a).total_cmp(&off_mm(b))
    });
    let at_corner = at_corner.unwrap_or_else(|| panic!("samples"));
    for (measured, distance_mm, of_best) in [(&focus, scanner.best_mm, 1.0), (&far, far_mm, 2.0)] {
        let noise_mm = of_best * params.regions.noise.best_mm * 3.0_f64.sqrt();
        let points = surface.sample_area_mm2(at_corner) * (focal_px / distance_mm).powi(2) / 3.0_f64.sqrt();
        let information = measured.information[at_corner.index()];
        assert!((information * noise_mm * noise_mm / points - 1.0).abs() < 0.15, "{information} at {distance_mm} mm");
    }
    let error_mm = |a: &MeasuredSurface, b: &MeasuredSurface| part.registration(a, b).expected_error_mm.unwrap_or(f64::NAN);
    assert!(error_mm(&focus, &far) > 1.4 * error_mm(&focus, &focus), "{} mm", error_mm(&focus, &far));
    // Two views tell more than one.
    let twice = part.measured([(at(scanner.best_mm), &row), (at(scanner.best_mm), &row)]);
    let gain = error_mm(&focus, &focus) / error_mm(&twice, &twice);
    assert!((gain - 2.0_f64.sqrt()).abs() < 1e-9, "{gain}");
}

#[test]
fn the_weakest_link_is_that_of_the_strongest_tree() {
    let surface = sampled(&box_mesh([0.0; 3], [60.0, 40.0, 30.0]));
    let [x, y, z] = [Vector3::x(), Vector3::y(), Vector3::z()];
    let sets = [facing(&surface, &[x, y, z]), facing(&surface, &[-x, -y, -z]), all_of(&surface)];
    // The first two share nothing, and are joined through the third.
    let cancel = AtomicBool::new(false);
    let ctx = Context::new(&cancel, &Silent);
    let weakest =
        |sets: &[SampleSet]| SharedSurface::new(&surface).weakest_link(sets, &ctx).unwrap_or_else(|_| panic!("not cancelled"));
    let (pair, link) = weakest(&sets).unwrap_or_else(|| panic!("three sets"));
    assert!(pair.contains(&2) && link.is_fixed(), "{pair:?} {link:?}");
    assert!(weakest(&sets[..1]).is_none());
    // A view that measures nothing has a row without words.
    let (_, link) = weakest(&[all_of(&surface), SampleSet::from_words(Vec::new())]).unwrap_or_else(|| panic!("two sets"));
    assert_eq!((link.shared_area_mm2, link.is_fixed()), (0.0, false));
}
