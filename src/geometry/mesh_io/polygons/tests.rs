use std::fmt::Write as _;

use super::super::{Limits, ReadMesh, read};
use super::EAR_BUDGET;
use crate::geometry::{LengthUnit, MeshWarning};

fn read_mm(bytes: &[u8]) -> ReadMesh {
    read(bytes, Some(LengthUnit::Millimetre), &Limits::default()).expect("a mesh")
}

/// An OBJ file of one polygon.
fn obj(corners: &[[f64; 3]]) -> String {
    let mut text = String::new();
    corners.iter().for_each(|[x, y, z]| writeln!(text, "v {x} {y} {z}").expect("text"));
    let numbers: Vec<String> = (1..=corners.len()).map(|number| number.to_string()).collect();
    writeln!(text, "f {}", numbers.join(" ")).expect("text");
    text
}

/// A prism of height 10 over a polygon, its ends one face each, with the corners from number `first` on; as OBJ and as PLY.
fn prism(outline: &[[f64; 2]], first: usize) -> [Vec<u8>; 2] {
    let count = outline.len();
    let top: Vec<usize> = (0..count).map(|place| count + (first + place) % count).collect();
    let bottom: Vec<usize> = top.iter().rev().map(|corner| corner - count).collect();
    let side = |place: usize| vec![place, (place + 1) % count, count + (place + 1) % count, count + place];
    let faces: Vec<Vec<usize>> = [top, bottom].into_iter().chain((0..count).map(side)).collect();
    let mut text = String::new();
    let mut ply = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\nelement face {}\n\
         property list uchar int vertex_indices\nend_header\n",
        2 * count,
        faces.len()
    );
    for z in [0, 10] {
        for [x, y] in outline {
            writeln!(text, "v {x} {y} {z}").expect("text");
            writeln!(ply, "{x} {y} {z}").expect("text");
        }
    }
    for face in faces {
        let numbers = |add: usize| face.iter().map(|corner| (corner + add).to_string()).collect::<Vec<_>>().join(" ");
        writeln!(text, "f {}", numbers(1)).expect("text");
        writeln!(ply, "{} {}", face.len(), numbers(0)).expect("text");
    }
    [text.into_bytes(), ply.into_bytes()]
}

/// The fan of an L once covered the notch too, from four of its six corners: 400 mm² more at each end, half of it upside down, in a mesh
/// that was told to be sound.
#[test]
fn a_concave_polygon_is_cut_within_its_outline_from_every_first_corner() {
    let outline = [[0.0, 0.0], [30.0, 0.0], [30.0, 10.0], [10.0, 10.0], [10.0, 30.0], [0.0, 30.0]];
    for first in 0..outline.len() {
        for file in prism(&outline, first) {
            let ReadMesh { mesh, health, .. } = read_mm(&file);
            assert_eq!((health.triangles, health.bodies, health.watertight), (20, 1, true), "from corner {first}");
            assert!((health.area_mm2 - (2.0 * 500.0 + 120.0 * 10.0)).abs() < 1e-9, "{} mm² from corner {first}", health.area_mm2);
            assert!((health.volume_mm3.expect("closed") - 5000.0).abs() < 1e-9 && health.warnings().is_empty());
            let turned = (0..mesh.faces.len()).filter(|face| mesh.source_face[*face] == 0 && mesh.scaled_normal(*face).z <= 0.0);
            assert_eq!(turned.count(), 0, "the top faces up");
            assert_eq!(mesh.source_face.iter().filter(|source| **source < 2).count(), 8);
        }
    }
}

#[test]
fn a_convex_polygon_stays_the_fan_that_it_was() {
    let hexagon = [[1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [3.0, 1.0, 0.0], [2.0, 2.0, 0.0], [1.0, 2.0, 0.0], [0.0, 1.0, 0.0]];
    assert_eq!(read_mm(obj(&hexagon).as_bytes()).mesh.faces, [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]]);
    // A quadrangle that is not plane, and a corner on a straight edge, rounded inwards.
    let folded = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.7], [1.0, 1.0, 0.0], [0.0, 1.0, 0.7]];
    assert_eq!(read_mm(obj(&folded).as_bytes()).mesh.faces, [[0, 1, 2], [0, 2, 3]]);
    let rounded = [[0.0, 0.0, 0.0], [1.0, 1e-8, 0.0], [3.0, 0.0, 0.0], [0.0, 3.0, 0.0]];
    assert_eq!(read_mm(obj(&rounded).as_bytes()).mesh.faces, [[0, 1, 2], [0, 2, 3]]);
}

#[test]
fn a_dart_is_cut_along_its_other_diagonal() {
    let dart = [[0.0, 0.0, 5.0], [1.0, 1.0, 5.0], [3.0, 1.0, 5.0], [1.0, 3.0, 5.0]];
    for first in 0..4 {
        let mut corners = dart;
        corners.rotate_left(first);
        // Seen from below it runs the other way.
        for is_reversed in [false, true] {
            if is_reversed {
                corners.reverse();
            }
            let read = read_mm(obj(&corners).as_bytes());
            let doubled = |corners: &[[f64; 3]]| -> f64 {
                (0..4).map(|i| corners[i][0] * corners[(i + 1) % 4][1] - corners[(i + 1) % 4][0] * corners[i][1]).sum()
            };
            assert!((read.health.area_mm2 - 0.5 * doubled(&corners).abs()).abs() < 1e-12, "{corners:?}");
            assert!(read.mesh.scaled_normal(0).z * doubled(&corners) > 0.0);
        }
    }
}

/// A frame as one polygon, which runs to its hole and back, as exporters write planes with holes.
#[test]
fn a_polygon_may_run_to_a_hole_and_back() {
    let frame = [
        [0.0, 0.0, 0.0],
        [9.0, 0.0, 0.0],
        [9.0, 9.0, 0.0],
        [0.0, 9.0, 0.0],
        [0.0, 0.0, 0.0],
        [3.0, 3.0, 0.0],
        [3.0, 6.0, 0.0],
        [6.0, 6.0, 0.0],
        [6.0, 3.0, 0.0],
        [3.0, 3.0, 0.0],
    ];
    for first in 0..frame.len() {
        let mut corners = frame;
        corners.rotate_left(first);
        let read = read_mm(obj(&corners).as_bytes());
        assert!((read.health.area_mm2 - (81.0 - 9.0)).abs() < 1e-12, "{} mm² from corner {first}", read.health.area_mm2);
        assert_eq!((read.health.uncut_polygons, read.health.boundary_edges), (0, 8), "from corner {first}");
    }
}

#[test]
fn a_gear_of_many_teeth_is_cut_within_its_outline() {
    // Every other corner is one of a notch.
    let corner = |i: u32| {
        let radius = if i.is_multiple_of(2) { 50.0 } else { 45.0 };
        let (sin, cos) = (std::f64::consts::TAU * f64::from(i) / 400.0).sin_cos();
        [radius * cos, radius * sin, 0.3 * radius * cos]
    };
    let corners: Vec<[f64; 3]> = (0..400).map(corner).collect();
    let read = read_mm(obj(&corners).as_bytes());
    let wanted = 200.0 * 50.0 * 45.0 * (std::f64::consts::TAU / 400.0).sin() * 1.09_f64.sqrt();
    assert!((read.health.area_mm2 - wanted).abs() < 1e-6, "{} instead of {wanted}", read.health.area_mm2);
    assert_eq!((read.health.triangles, read.health.uncut_polygons), (398, 0));
}

#[test]
fn polygons_that_cross_themselves_or_are_too_large_are_told() {
    let crossing = [[0.0, 0.0, 0.0], [4.0, 3.0, 0.0], [4.0, 0.0, 0.0], [0.0, 2.0, 0.0]];
    let read = read_mm(obj(&crossing).as_bytes());
    assert_eq!((read.health.uncut_polygons, read.mesh.faces.len()), (1, 2));
    let warnings = read.health.warnings();
    let is_of_one = |warning: &MeshWarning| matches!(warning, MeshWarning::Uncut { .. }) && warning.to_string().starts_with("1 ");
    assert!(warnings.iter().any(is_of_one));
    // A comb of more corners than the budget lets look at each other.
    let count = ((2 * EAR_BUDGET) as f64).sqrt() as usize + 4;
    let comb: Vec<[f64; 3]> = (0..count).map(|i| [i as f64, (i % 2) as f64, 0.0]).chain([[count as f64, 9.0, 0.0]]).collect();
    assert_eq!(read_mm(obj(&comb).as_bytes()).health.uncut_polygons, 1);
    let line = [[0.0, 0.0, 0.0], [0.1, 0.3, 0.7], [0.2, 0.6, 1.4], [0.05, 0.15, 0.35], [9.0, 0.0, 0.0]];
    let text = obj(&line).replace("f 1 2 3 4 5", "f 1 2 3 4\nf 1 3 5");
    assert_eq!(read_mm(text.as_bytes()).health.uncut_polygons, 0, "a line has no area");
}
