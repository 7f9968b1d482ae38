use crate::planning::params::Region;
use nalgebra::{Point3, Vector3};

use super::*;
use crate::geometry::mesh_io::{self, Limits};
use crate::geometry::{FaceGroup, LengthUnit};
use crate::testing::box_mesh;

/// A 60 × 40 mm plate of two triangles, +z up.
fn plate() -> Mesh {
    Mesh {
        vertices_mm: [[0.0, 0.0], [60.0, 0.0], [60.0, 40.0], [0.0, 40.0]].map(|[x, y]| Point3::new(x, y, 5.0)).into(),
        faces: vec![[0, 1, 2], [0, 2, 3]],
        source_face: vec![0, 1],
        groups: vec![FaceGroup { name: "rim".into(), source_faces: vec![1] }],
    }
}

fn params(edge_mm: f64, density: f64) -> PartParams {
    PartParams { patch_edge_mm: Some(edge_mm), samples_per_mm2: Some(density), ..PartParams::default() }
}

fn sampled(edge_mm: f64, density: f64, regions: &[Region]) -> Surface {
    let regions = RegionParams { exclude: regions.to_vec(), ..RegionParams::default() };
    sample(&plate(), &params(edge_mm, density), &regions, 7).unwrap_or_else(|errors| panic!("{errors:?}"))
}

#[test]
fn patches_keep_the_area_and_respect_the_edge() {
    let surface = sampled(3.0, 0.5, &[]);
    let area_mm2: f64 = surface.patches.iter().map(|patch| patch.area_mm2).sum();
    assert!((area_mm2 - 2400.0).abs() < 1e-9);
    assert!((surface.area_where(|_| true) - 2400.0).abs() < 1e-9);
    for patch in &surface.patches {
        assert!(longest_edge_mm(&patch.corners_mm) <= 3.0);
        assert!((patch.normal - Vector3::z()).norm() < 1e-12);
        assert!(patch.samples >= 1);
    }
}

#[test]
fn samples_lie_in_their_patch_and_are_spread_evenly() {
    let surface = sampled(100.0, 2.0, &[]);
    assert_eq!(surface.patches.len(), 2);
    assert_eq!(surface.sample_mm.len(), 4800);
    let inside = |p: &Point3<f64>| (p.z - 5.0).abs() < 1e-12 && 0.0 <= p.x && p.x <= 60.0 && 0.0 <= p.y && p.y <= 40.0;
    assert!(surface.sample_mm.iter().all(inside));
    // Stratified points: each tenth of the plate holds its share to 3 %, where plain random points would miss by 5 %.
    for tenth in 0..10 {
        let left = 6.0 * f64::from(tenth);
        let held = surface.sample_mm.iter().filter(|p| left <= p.x && p.x < left + 6.0).count();
        assert!((held as f64 - 480.0).abs() < 15.0, "tenth {tenth} holds {held}");
    }
}

#[test]
fn the_seed_and_nothing_else_moves_samples() {
    let again = |seed| {
        let surface = sample(&plate(), &params(5.0, 1.0), &RegionParams::default(), seed);
        surface.unwrap_or_else(|errors| panic!("{errors:?}")).sample_mm
    };
    assert_eq!(again(1), again(1));
    assert_ne!(again(1), again(2));
}

#[test]
fn every_kind_of_region_is_left_out() {
    let asked_mm2 = |region: Region| {
        let surface = sampled(0.8, 4.0, &[region]);
        surface.area_where(|sample| surface.asked[sample.index()])
    };
    assert!((asked_mm2(Region::Faces { faces: vec![0] }) - 1200.0).abs() < 1e-6);
    assert!((asked_mm2(Region::Name { name: "rim".into() }) - 1200.0).abs() < 1e-6);
    let half = Region::HalfSpace { point_mm: [15.0, 0.0, 0.0], normal: [2.0, 0.0, 0.0] };
    assert!((asked_mm2(half) - 1800.0).abs() < 5.0);
    let corner = Region::Box { min_mm: [-1.0, -1.0, 0.0], max_mm: [30.0, 20.0, 9.0] };
    assert!((asked_mm2(corner) - 1800.0).abs() < 5.0);
    let ball = Region::Sphere { centre_mm: [30.0, 20.0, 5.0], radius_mm: 10.0 };
    assert!((asked_mm2(ball) - (2400.0 - 100.0 * std::f64::consts::PI)).abs() < 5.0);
}

/// Samples are rounded off their facet: a box region as large as the part held neither its upper nor its lower face.
#[test]
fn a_region_holds_the_faces_that_lie_in_its_border() {
    let size_mm = [60.1, 40.1, 30.1];
    let mesh = box_mesh([0.0; 3], size_mm);
    let excluded_mm2 = |region: Region| {
        let regions = RegionParams { exclude: vec![region], ..RegionParams::default() };
        let surface = sample(&mesh, &params(10.0, 0.2), &regions, 7).unwrap_or_else(|errors| panic!("{errors:?}"));
        surface.area_where(|sample| !surface.asked[sample.index()])
    };
    let around = Region::Box { min_mm: [0.0; 3], max_mm: size_mm };
    let above_the_plate = Region::HalfSpace { point_mm: [0.0; 3], normal: [0.0, 0.0, -1.0] };
    let from_below = Region::HalfSpace { point_mm: size_mm, normal: [0.0, 0.0, 1.0] };
    for region in [around, above_the_plate, from_below] {
        let all_mm2 = excluded_mm2(region.clone());
        assert!((all_mm2 - mesh.area_mm2()).abs() < 1e-6, "{region:?} holds {all_mm2} of {} mm²", mesh.area_mm2());
    }
    let upper_face = Region::Plane { point_mm: size_mm, normal: [0.0, 0.0, 1.0], within_mm: 1e-6 };
    assert!((excluded_mm2(upper_face) - 60.1 * 40.1).abs() < 1e-6);
    // A tenth of a micrometre beyond the border is beyond it.
    let just_below = Region::HalfSpace { point_mm: [0.0, 0.0, -1e-4], normal: [0.0, 0.0, 1.0] };
    assert_eq!(excluded_mm2(just_below), 0.0);
}

#[test]
fn unknown_faces_groups_and_absurd_densities_are_refused_by_name() {
    let refused = |params: PartParams, region: Option<Region>| {
        let regions = RegionParams { exclude: region.into_iter().collect(), ..RegionParams::default() };
        match sample(&plate(), &params, &regions, 0) {
            Err(errors) => errors[0].to_string(),
            Ok(_) => "accepted".into(),
        }
    };
    let faces = refused(params(5.0, 1.0), Some(Region::Faces { faces: vec![2] }));
    let told = "names face 2; the file's last face with an area is 1, counted from 0: leave out what lies beyond";
    assert_eq!(faces, format!("/regions/exclude/0/faces: {told}"));
    let name = refused(params(5.0, 1.0), Some(Region::Name { name: "bore".into() }));
    assert_eq!(name, "/regions/exclude/0/name: is \"bore\"; the file's groups are rim");
    assert!(refused(params(0.001, 1.0), None).starts_with("/part/patch_edge_mm: is 0.001"));
    assert!(refused(params(5.0, 1e6), None).starts_with("/part/samples_per_mm2: is 1000000"));
}

/// Face 2 of a file of three faces, the last of which is degenerate, was told to be none of the file's.
#[test]
fn degenerate_faces_may_be_named_and_beyond_the_last_with_an_area_the_refusal_tells_that_one() {
    let read = |faces: &str| {
        let file = format!("v 0 0 0\nv 60 0 0\nv 60 40 0\nv 0 40 0\n{faces}");
        mesh_io::read(file.as_bytes(), Some(LengthUnit::Millimetre), &Limits::default()).expect("a mesh").mesh
    };
    let excluding = |mesh: &Mesh, faces: &[u32]| {
        let exclude = vec![Region::Faces { faces: faces.to_vec() }];
        let asked = sample(mesh, &params(5.0, 1.0), &RegionParams { exclude, ..RegionParams::default() }, 0);
        asked.map(|surface| surface.asked_area_mm2().iter().sum::<f64>()).map_err(|errors| errors[0].to_string())
    };
    let asked_mm2 = excluding(&read("f 1 2 3\nf 1 1 2\nf 1 3 4\n"), &[0, 1]).expect("face 1 is degenerate");
    assert!((asked_mm2 - 1200.0).abs() < 1e-6, "{asked_mm2} mm²");
    let refused = excluding(&read("f 1 2 3\nf 1 3 4\nf 1 1 2\n"), &[0, 2]).expect_err("face 2 is degenerate");
    assert!(refused.contains("names face 2; the file's last face with an area is 1, counted from 0"), "{refused}");
}

#[test]
fn regions_beside_the_part_are_found_empty() {
    let beside = Region::Sphere { centre_mm: [1000.0, 0.0, 0.0], radius_mm: 20.0 };
    let on_it = Region::Sphere { centre_mm: [30.0, 20.0, 5.0], radius_mm: 10.0 };
    let surface = sampled(3.0, 0.5, &[]);
    assert_eq!(empty_regions(&plate(), &surface, [&beside, &on_it, &beside].into_iter()), [0, 2]);
}
