use std::f64::consts::TAU;
use std::sync::atomic::AtomicBool;

use super::*;
use crate::geometry::Mesh;
use crate::planning::context::Silent;
use crate::planning::params::PlanParams;
use crate::planning::surface;
use crate::testing::{box_mesh, cylinder_mesh};

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
    assert!(walls.resistance < 1e-12 && walls.shift.z > 0.99, "{walls:?}");
    // Rounding left a resistance of 1e-17, and an expected error of metres.
    assert_eq!(walls.expected_error_mm(0.01, 0.1), None, "{walls:?}");
    let face = SharedSurface::new(&surface).stability(&facing(&surface, &[z]));
    assert!(face.resistance < 1e-12 && face.shift.z.abs() < 1e-6, "{face:?}");
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
    assert!(!cylinder.is_fixed() && cylinder.turn.z.abs() > 0.99, "{cylinder:?}");
}

/// Faces x, y and z of a cube, a third of the shared area each: a shift along x moves that third alone.
#[test]
fn the_expected_error_is_that_of_least_squares() {
    let stability = Stability {
        shared_area_mm2: 100.0,
        resistance: 0.25,
        turn: Vector3::zeros(),
        shift: Vector3::x(),
        centre_mm: Point3::origin(),
    };
    // 10 000 points, of which a quarter resists: √2 · 0.01 / √2500.
    let error_mm = stability.expected_error_mm(0.01, 0.1).unwrap_or(f64::NAN);
    assert!((error_mm - 0.01 * 2.0_f64.sqrt() / 50.0).abs() < 1e-12, "{error_mm}");
    assert!(Stability { resistance: 0.0, ..stability }.expected_error_mm(0.01, 0.1).is_none());
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
