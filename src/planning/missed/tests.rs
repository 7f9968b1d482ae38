use nalgebra::{Point3, Vector3};

use super::spots;
use crate::geometry::Mesh;
use crate::planning::params::{PartParams, RegionParams};
use crate::planning::plan::{Cause, Grade, Verdict};
use crate::planning::surface::{self, Surface};

/// A square plate of two triangles, 60 mm wide, in patches of at most 4 mm.
fn plate() -> (Mesh, Surface) {
    let vertices_mm = [[0.0, 0.0], [60.0, 0.0], [0.0, 60.0], [60.0, 60.0]].map(|[x, y]| Point3::new(x, y, 0.0)).into();
    let mesh = Mesh { vertices_mm, faces: vec![[0, 1, 3], [0, 3, 2]], source_face: vec![5, 6], groups: Vec::new() };
    let part = PartParams { patch_edge_mm: Some(4.0), samples_per_mm2: Some(2.0), ..PartParams::default() };
    let surface = surface::sample(&mesh, &part, &RegionParams::default(), 0).expect("a surface");
    (mesh, surface)
}

fn spots_where(missed: impl Fn(&Point3<f64>) -> Option<Cause>) -> Vec<spots::Spot> {
    let (mesh, surface) = plate();
    let verdict = |p: &Point3<f64>| missed(p).map_or(Verdict::Measured(Grade::A), Verdict::Missed);
    let verdicts: Vec<_> = surface.sample_mm.iter().map(verdict).collect();
    spots::find(&mesh, &surface, &verdicts)
}

#[test]
fn two_places_on_one_facet_are_two_spots_and_one_across_facets_is_one() {
    let disc = |p: &Point3<f64>, x: f64, y: f64, radius: f64| (p - Point3::new(x, y, 0.0)).norm() <= radius;
    // The first two lie on the lower facet; the third across the diagonal, over both.
    let found = spots_where(|p| {
        let any = disc(p, 30.0, 8.0, 5.0) || disc(p, 50.0, 12.0, 4.0) || disc(p, 40.0, 40.0, 7.0);
        any.then_some(Cause::ShadowLeft)
    });
    assert_eq!(found.len(), 3);
    let faces: Vec<_> = found.iter().map(|spot| spot.source_faces.as_slice()).collect();
    assert_eq!(faces, [&[5, 6][..], &[5], &[5]]);
    for (spot, (x, y, radius)) in found.iter().zip([(40.0, 40.0, 7.0), (30.0, 8.0, 5.0), (50.0, 12.0, 4.0)]) {
        let disc_mm2 = std::f64::consts::PI * radius * radius;
        assert!((spot.area_mm2 - disc_mm2).abs() < 0.05 * disc_mm2, "{} of {disc_mm2}", spot.area_mm2);
        assert!((spot.centre_mm - Point3::new(x, y, 0.0)).norm() < 0.3, "{:?}", spot.centre_mm);
        // Whole patches: up to their longest edge more on either side.
        let beyond = spot.extent_mm - Vector3::new(2.0 * radius, 2.0 * radius, 0.0);
        assert!(beyond.x >= -0.5 && beyond.y >= -0.5 && beyond.max() <= 8.0 && spot.extent_mm.z == 0.0, "{:?}", spot.extent_mm);
    }
}

#[test]
fn causes_are_apart_in_their_order() {
    let found = spots_where(|p| Some(if p.x < 20.0 { Cause::NotChosen } else { Cause::Facing }));
    let causes: Vec<_> = found.iter().map(|spot| spot.cause).collect();
    assert_eq!(causes, [Cause::Facing, Cause::NotChosen]);
    let area_mm2: f64 = found.iter().map(|spot| spot.area_mm2).sum();
    assert!((area_mm2 - 3600.0).abs() < 1e-6);
}
