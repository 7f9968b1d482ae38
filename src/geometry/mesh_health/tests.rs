use nalgebra::{Point3, Vector3};

use super::*;
use crate::geometry::FaceGroup;

fn clean(mesh: Mesh) -> (Mesh, MeshHealth) {
    super::clean(mesh, &Poll::never()).expect("not interrupted")
}

/// A cube of `size` at `offset`; `inverted` has its normals inwards.
fn cube(size: f64, offset: Vector3<f64>, inverted: bool) -> Mesh {
    let corner = |i: usize| Point3::from(offset + size * Vector3::new((i & 1) as f64, (i >> 1 & 1) as f64, (i >> 2) as f64));
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let mut faces: Vec<[u32; 3]> = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    if inverted {
        faces.iter_mut().for_each(|face| face.swap(1, 2));
    }
    let source_face = (0..faces.len() as u32).collect();
    Mesh { vertices_mm: (0..8).map(corner).collect(), faces, source_face, groups: Vec::new() }
}

fn join(parts: impl IntoIterator<Item = Mesh>) -> Mesh {
    let mut whole = Mesh { vertices_mm: Vec::new(), faces: Vec::new(), source_face: Vec::new(), groups: Vec::<FaceGroup>::new() };
    for part in parts {
        let first = whole.vertices_mm.len() as u32;
        let first_face = whole.faces.len() as u32;
        whole.faces.extend(part.faces.iter().map(|face| face.map(|v| v + first)));
        whole.source_face.extend(part.source_face.iter().map(|face| face + first_face));
        whole.vertices_mm.extend(part.vertices_mm);
    }
    whole
}

fn at(x: f64) -> Vector3<f64> {
    Vector3::new(x, x, x)
}

#[test]
fn a_cube_is_sound() {
    let health = assess(&cube(10.0, at(0.0), false));
    assert_eq!((health.triangles, health.vertices, health.bodies, health.watertight), (12, 8, 1, true));
    assert!((health.area_mm2 - 600.0).abs() < 1e-9 && (health.volume_mm3.expect("closed") - 1000.0).abs() < 1e-9);
    assert_eq!((health.flipped_bodies, health.inconsistent_edges, health.warnings().len()), (0, 0, 0));
}

#[test]
fn an_inverted_cube_is_turned() {
    let (mesh, health) = clean(cube(10.0, at(0.0), true));
    assert_eq!((health.flipped_bodies, health.volume_mm3.map(f64::round)), (1, Some(1000.0)));
    assert!(mesh.scaled_normal(0).z < 0.0, "the bottom faces down again");
    assert_eq!(health.warnings(), [MeshWarning::Flipped { bodies: 1 }]);
}

#[test]
fn a_cavity_stays_and_a_part_inside_a_part_stays() {
    for (inner_inverted, volume_mm3) in [(true, 1000.0 - 8.0), (false, 1000.0 + 8.0)] {
        let (mesh, health) = clean(join([cube(10.0, at(0.0), false), cube(2.0, at(3.0), inner_inverted)]));
        assert_eq!((health.bodies, health.flipped_bodies), (2, 0));
        assert!((health.volume_mm3.expect("closed") - volume_mm3).abs() < 1e-9);
        assert_eq!(mesh.scaled_normal(12).z > 0.0, inner_inverted);
    }
}

#[test]
fn a_file_that_is_inside_out_is_turned_with_its_cavities() {
    let inside_out = join([cube(10.0, at(0.0), true), cube(6.0, at(2.0), false), cube(2.0, at(4.0), true)]);
    let health = clean(inside_out).1;
    assert_eq!(health.flipped_bodies, 3);
    assert!((health.volume_mm3.expect("closed") - (1000.0 - 216.0 + 8.0)).abs() < 1e-9);
}

#[test]
fn an_inverted_outer_body_leaves_a_right_cavity_alone() {
    let health = clean(join([cube(10.0, at(0.0), true), cube(2.0, at(3.0), true)])).1;
    assert_eq!((health.flipped_bodies, health.volume_mm3.map(f64::round)), (1, Some(992.0)));
}

#[test]
fn side_by_side_bodies_are_judged_alone() {
    let health = clean(join([cube(10.0, at(0.0), false), cube(2.0, at(20.0), true), cube(3.0, at(-9.0), true)])).1;
    assert_eq!((health.bodies, health.flipped_bodies), (3, 2));
}

#[test]
fn a_hole_is_counted_and_has_no_volume() {
    let mut mesh = cube(10.0, at(0.0), true);
    mesh.faces.pop();
    mesh.source_face.pop();
    let health = assess(&mesh);
    assert_eq!((health.boundary_edges, health.watertight, health.volume_mm3), (3, false, None));
    assert_eq!(health.flipped_bodies, 0, "an open body has no inside");
}

#[test]
fn one_turned_triangle_shows_at_its_three_edges() {
    let mut mesh = cube(10.0, at(0.0), false);
    mesh.faces[4].swap(0, 1);
    let health = assess(&mesh);
    assert_eq!((health.inconsistent_edges, health.watertight, health.volume_mm3), (3, true, None));
}

#[test]
fn degenerate_triangles_go_and_make_no_hole() {
    let mut mesh = cube(10.0, at(0.0), false);
    // A point on an edge of the bottom; the neighbour is split, and a triangle without area closes the gap.
    let edge = [mesh.faces[0][0], mesh.faces[0][1]];
    let middle = mesh.vertices_mm.len() as u32;
    mesh.vertices_mm.push(nalgebra::center(&mesh.vertices_mm[edge[0] as usize], &mesh.vertices_mm[edge[1] as usize]));
    let apex = mesh.faces[0][2];
    mesh.faces[0] = [edge[0], middle, apex];
    mesh.faces.extend([[middle, edge[1], apex], [edge[0], edge[1], middle], [0, 0, 1]]);
    mesh.source_face.extend([0, 12, 13]);
    mesh.vertices_mm.push(Point3::new(99.0, 99.0, 99.0));
    let (mesh, health) = clean(mesh);
    assert_eq!((health.triangles_in_file, health.triangles, health.degenerate_triangles), (15, 13, 2));
    assert!(health.watertight && health.bodies == 1 && health.vertices == 9, "{health:?}");
    assert_eq!(mesh.source_face, [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 0]);
    assert_eq!(health.aabb.max, Point3::new(10.0, 10.0, 10.0), "a vertex that nothing uses is not the part's");
}

#[test]
fn duplicates_are_counted_in_any_winding() {
    let mut mesh = cube(10.0, at(0.0), false);
    let [a, b, c] = mesh.faces[0];
    mesh.faces.extend([[b, c, a], [a, c, b]]);
    mesh.source_face.extend([12, 13]);
    let health = assess(&mesh);
    assert_eq!((health.duplicate_triangles, health.non_manifold_edges, health.watertight), (2, 3, false));
}

#[test]
fn the_unit_is_doubted_outside_of_1_mm_to_20_m() {
    for (size, doubted) in [(0.5, true), (0.6, false), (11_000.0, false), (12_000.0, true)] {
        let warnings = assess(&cube(size, at(0.0), false)).warnings();
        assert_eq!(warnings.iter().any(|warning| matches!(warning, MeshWarning::Size { .. })), doubted, "{size}: {warnings:?}");
    }
}

#[test]
fn deep_nesting_ends_in_time_and_is_said() {
    let shells = (0..6000).map(|i| cube(10_000.0 - f64::from(i), at(f64::from(i) * 0.5), true));
    let health = clean(join(shells)).1;
    assert!(health.unresolved_bodies > 0 && health.unresolved_bodies < 6000, "{}", health.unresolved_bodies);
    assert!(health.warnings().iter().any(|warning| matches!(warning, MeshWarning::Unresolved { .. })));
}

/// A prism along z over an L, which has its inner corner at (10, 10).
fn ell(height: f64) -> Mesh {
    // From the inner corner all of the L is in sight.
    let outline = [[10.0, 10.0], [10.0, 30.0], [0.0, 30.0], [0.0, 0.0], [30.0, 0.0], [30.0, 10.0]];
    let vertices_mm = [0.0, height].iter().flat_map(|z| outline.map(|[x, y]| Point3::new(x, y, *z))).collect();
    let ends = (1..5).flat_map(|i| [[0, i + 1, i], [6, 6 + i, 7 + i]]);
    let sides = (0..6).flat_map(|i| [[i, (i + 1) % 6, 6 + (i + 1) % 6], [i, 6 + (i + 1) % 6, 6 + i]]);
    let faces: Vec<[u32; 3]> = ends.chain(sides).collect();
    Mesh { vertices_mm, source_face: (0..faces.len() as u32).collect(), faces, groups: Vec::new() }
}

fn moved(mut mesh: Mesh, by: [f64; 3]) -> Mesh {
    mesh.vertices_mm.iter_mut().for_each(|corner| *corner += Vector3::from(by));
    mesh
}

/// Vertices on a face of another body were once taken to lie inside it: the body was left inside out, as a cavity, and nothing said so.
#[test]
fn an_inverted_body_that_stands_on_a_face_of_another_is_turned() {
    for by in [[12.0, 10.0, 2.0], [10.0, 12.0, 2.0], [10.0, 10.0, 2.0]] {
        let health = clean(join([ell(10.0), moved(cube(5.0, at(0.0), true), by)])).1;
        assert_eq!((health.flipped_bodies, health.volume_mm3.map(f64::round)), (1, Some(5125.0)), "{by:?}");
        assert_eq!(health.warnings(), [MeshWarning::Flipped { bodies: 1 }], "{by:?}");
    }
}

/// `vantage inspect` once said nothing of bodies that run into each other.
#[test]
fn bodies_that_run_into_each_other_are_told_and_those_that_touch_are_not() {
    let bar = |half: [f64; 3]| {
        let mut mesh = cube(2.0, at(-1.0), false);
        mesh.vertices_mm.iter_mut().for_each(|corner| *corner = Point3::from(corner.coords.component_mul(&Vector3::from(half))));
        mesh
    };
    let ten = || cube(10.0, at(0.0), false);
    for (name, parts, pairs) in [
        ("a corner within", vec![ten(), cube(10.0, at(5.0), false)], 1),
        ("inside out", vec![cube(10.0, at(0.0), true), cube(10.0, at(5.0), false)], 1),
        ("bars through each other", vec![bar([10.0, 1.0, 1.0]), bar([2.0, 10.0, 3.0])], 1),
        ("three in a row", vec![ten(), moved(ten(), [8.0, 1.0, 2.0]), moved(ten(), [16.0, 2.0, 1.0])], 2),
        ("side by side", vec![ten(), cube(10.0, at(20.0), false)], 0),
        ("faces touch", vec![ten(), moved(ten(), [10.0, 5.0, 0.0])], 0),
        ("a block in the corner of an L", vec![ell(10.0), moved(ten(), [10.0, 10.0, 0.0])], 0),
        ("a block in the walls of an L", vec![ell(10.0), moved(ten(), [9.0, 9.0, 0.0])], 1),
        ("a part inside a part", vec![ten(), cube(2.0, at(3.0), false)], 0),
        ("a cavity", vec![ten(), cube(2.0, at(3.0), true)], 0),
    ] {
        let health = clean(join(parts)).1;
        assert_eq!(health.overlapping_pairs, pairs, "{name}");
        assert_eq!(health.warnings().iter().any(|warning| matches!(warning, MeshWarning::Overlap { .. })), pairs > 0, "{name}");
    }
}

/// The surface of unit cubes at whole places, outward, with one vertex a corner.
fn voxels(places: &[[i32; 3]]) -> Mesh {
    let mut mesh = join([]);
    for place in places {
        let unit = moved(cube(1.0, at(0.0), false), place.map(f64::from));
        for pair in 0..6 {
            let [a, b, c] = unit.corners(2 * pair);
            let normal = (b - a).cross(&(c - a));
            let beyond: Vec<i32> = (0..3).map(|axis| place[axis] + normal[axis].round() as i32).collect();
            if places.iter().any(|other| other[..] == beyond[..]) {
                continue;
            }
            for face in &unit.faces[2 * pair..2 * pair + 2] {
                let welded = face.map(|vertex| vertex_at(&mut mesh, unit.vertices_mm[vertex as usize]));
                mesh.source_face.push(mesh.faces.len() as u32);
                mesh.faces.push(welded);
            }
        }
    }
    mesh
}

#[test]
fn cubes_that_share_an_edge_are_two_closed_bodies() {
    let health = assess(&voxels(&[[0, 0, 0], [1, 1, 0]]));
    assert_eq!((health.bodies, health.non_manifold_edges, health.watertight), (2, 1, false));
    assert!((health.volume_mm3.expect("closed") - 2.0).abs() < 1e-9);
}

/// The volume of such a body was once said to be unknown.
#[test]
fn a_body_that_touches_itself_along_an_edge_has_a_volume() {
    let mesh = voxels(&[[0, 0, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [1, 1, 0]]);
    let health = assess(&mesh);
    assert_eq!((health.bodies, health.non_manifold_edges), (1, 1));
    assert!((health.volume_mm3.expect("balanced") - 5.0).abs() < 1e-9);

    let mut inside_out = mesh.clone();
    inside_out.faces.iter_mut().for_each(|face| face.swap(1, 2));
    let turned = assess(&inside_out);
    assert_eq!((turned.bodies, turned.flipped_bodies, turned.volume_mm3.map(f64::round)), (1, 1, Some(5.0)));

    let mut twice = mesh.clone();
    twice.faces.extend_from_within(..);
    twice.source_face.extend_from_within(..);
    assert_eq!(assess(&twice).volume_mm3, None, "a shell that is there twice encloses no more");

    let mut open = mesh;
    open.faces.pop();
    open.source_face.pop();
    assert_eq!(assess(&open).volume_mm3, None);
}

/// Vertex of a mesh at a corner, which joins the mesh if none is there.
fn vertex_at(mesh: &mut Mesh, corner_mm: Point3<f64>) -> u32 {
    let known = mesh.vertices_mm.iter().position(|other| (other - corner_mm).norm() < 1e-9);
    known.unwrap_or_else(|| {
        mesh.vertices_mm.push(corner_mm);
        mesh.vertices_mm.len() - 1
    }) as u32
}

/// Adds a part to a mesh; equal corners get one vertex.
fn weld(mut mesh: Mesh, part: &Mesh) -> Mesh {
    for face in &part.faces {
        let welded = face.map(|vertex| vertex_at(&mut mesh, part.vertices_mm[vertex as usize]));
        mesh.source_face.push(mesh.faces.len() as u32);
        mesh.faces.push(welded);
    }
    mesh
}

/// Three by three unit cubes in each layer of so many, without the middle one of the uppermost layer.
fn pitted(layers: i32) -> Vec<[i32; 3]> {
    let places = (0..layers).flat_map(|z| (0..9).map(move |i| [i % 3, i / 3, z]));
    places.filter(|place| *place != [1, 1, layers - 1]).collect()
}

/// The volume of such shells was once said to be unknown: the loop cuts the shells into pieces, which are open.
#[test]
fn shells_that_touch_along_a_loop_of_edges_are_bodies_with_a_volume() {
    // A plug over a hole through a plate, whose surface the loop does not cut, and one over a pit, whose surface it does.
    for (layers, cubes, pieces) in [(1, 8.0, 3), (2, 17.0, 4)] {
        let mesh = voxels(&[pitted(layers), vec![[1, 1, layers]]].concat());
        let health = assess(&mesh);
        assert_eq!((health.bodies, health.non_manifold_edges, health.overlapping_pairs, health.nested_bodies), (pieces, 4, 0, 0));
        assert!((health.volume_mm3.expect("two shells") - cubes - 1.0).abs() < 1e-9, "{layers} layers");
        assert!(outward_faces(&mesh, &Poll::never()).expect("not interrupted").iter().all(|outward| *outward));

        let mut inside_out = mesh.clone();
        inside_out.faces.iter_mut().for_each(|face| face.swap(1, 2));
        let health = assess(&inside_out);
        assert!((health.volume_mm3.expect("two shells") - cubes - 1.0).abs() < 1e-9, "{layers} layers, inside out");
        assert!(health.flipped_bodies > 0);

        let mut open = mesh;
        open.faces.swap_remove(0);
        open.source_face.pop();
        assert_eq!(assess(&open).volume_mm3, None, "{layers} layers, open");
    }
}

#[test]
fn shells_that_touch_with_faces_that_both_have_are_bodies_with_a_volume() {
    let places: Vec<[i32; 3]> = (0..9).map(|i| [i % 3, i / 3, 0]).collect();
    let on_plate = weld(voxels(&places), &voxels(&[[1, 1, 1]]));
    let health = assess(&on_plate);
    assert_eq!((health.bodies, health.non_manifold_edges, health.duplicate_triangles), (6, 5, 2));
    assert!((health.volume_mm3.expect("two shells") - 10.0).abs() < 1e-9);

    let one = cube(1.0, at(0.0), false);
    let twice = weld(weld(join([]), &one), &one);
    assert_eq!(assess(&twice).volume_mm3, None, "nothing tells the copies apart");
    let both_ways = weld(weld(join([]), &one), &cube(1.0, at(0.0), true));
    assert_eq!(assess(&both_ways).volume_mm3, None, "it would count twice");
}

/// A body inside another one is in no view, and nothing said so.
#[test]
fn bodies_wholly_inside_others_are_told_and_parts_in_cavities_are_not() {
    let ten = || cube(10.0, at(0.0), false);
    for (name, parts, nested) in [
        ("a part inside a part", vec![ten(), cube(2.0, at(3.0), false)], 1),
        ("two parts inside a part", vec![cube(2.0, at(1.0), false), ten(), cube(2.0, at(6.0), false)], 2),
        ("a part inside a part inside a part", vec![ten(), cube(6.0, at(2.0), false), cube(2.0, at(4.0), false)], 2),
        ("a cavity", vec![ten(), cube(2.0, at(3.0), true)], 0),
        ("a part in a cavity", vec![ten(), cube(6.0, at(2.0), true), cube(2.0, at(4.0), false)], 0),
        ("side by side", vec![ten(), cube(2.0, at(20.0), false)], 0),
        ("in the corner of an L", vec![ell(10.0), moved(cube(5.0, at(0.0), false), [10.0, 10.0, 2.0])], 0),
        ("in the wall of an L", vec![ell(10.0), moved(cube(4.0, at(0.0), false), [3.0, 20.0, 2.0])], 1),
        ("through a wall", vec![ten(), cube(10.0, at(5.0), false)], 0),
        ("through the walls of an L", vec![ell(10.0), moved(cube(8.0, at(0.0), false), [5.0, 5.0, 1.0])], 0),
    ] {
        let health = clean(join(parts)).1;
        assert_eq!(health.nested_bodies, nested, "{name}");
        let warnings = health.warnings();
        assert_eq!(warnings.iter().any(|warning| matches!(warning, MeshWarning::Nested { .. })), nested > 0, "{name}");
        assert_eq!(health.volume_counts_overlaps, nested + health.overlapping_pairs > 0, "{name}");
    }
}

/// The common volume of two bodies once counted twice, and nothing said so.
#[test]
fn a_volume_that_counts_overlaps_is_told() {
    let overlapping = join([cube(10.0, at(0.0), false), cube(10.0, at(5.0), false)]);
    let health = assess(&overlapping);
    assert!(health.volume_counts_overlaps && health.volume_mm3.map(f64::round) == Some(2000.0));
    let told = |health: &MeshHealth| {
        health.warnings().iter().any(|warning| warning.to_string().contains("the volume is a sum over bodies"))
    };
    assert!(told(&health));

    let mut open = moved(cube(10.0, at(0.0), false), [50.0, 0.0, 0.0]);
    open.faces.pop();
    open.source_face.pop();
    let health = assess(&join([overlapping, open]));
    assert_eq!((health.overlapping_pairs, health.volume_counts_overlaps, health.volume_mm3), (1, false, None));
    assert!(!told(&health), "no volume is stated");
    let apart = assess(&join([cube(10.0, at(0.0), false), cube(10.0, at(20.0), false)]));
    assert!(!apart.volume_counts_overlaps);
}

/// "1 edges belong to more than two triangles" was told of one edge.
#[test]
fn one_of_a_kind_is_told_in_the_singular() {
    let health = |count: usize| MeshHealth {
        inconsistent_edges: count,
        uncut_polygons: count,
        unresolved_bodies: count,
        flipped_bodies: count,
        boundary_edges: count,
        non_manifold_edges: count,
        overlapping_pairs: count,
        nested_bodies: count,
        volume_counts_overlaps: true,
        duplicate_triangles: count,
        degenerate_triangles: count,
        ..assess(&cube(10.0, at(0.0), false))
    };
    let told = |count: usize| health(count).warnings().iter().map(ToString::to_string).collect::<Vec<_>>();
    assert_eq!(
        told(1),
        [
            "the winding of neighbours disagrees at 1 edge",
            "1 polygon crosses or folds over itself, or is too large to be cut into triangles",
            "1 closed body has negative volume, and the nesting is too deep to judge it",
            "1 closed body was inside out and has been turned",
            "the surface is open along 1 edge",
            "1 edge belongs to more than two triangles",
            "two closed bodies, and perhaps more, run into each other; the volume is a sum over bodies and counts what they have \
             in common more than once",
            "at least 1 closed body lies wholly inside another, with normals that point outwards; the volume is a sum over bodies \
             and counts it twice",
            "1 triangle repeats another",
            "1 degenerate triangle was dropped",
        ]
    );
    let many = told(2);
    assert!(many.len() == 10 && !many.iter().any(|told| told.contains("1 ")), "{many:?}");
    assert_eq!(many[5], "2 edges belong to more than two triangles");
}
