use std::collections::BTreeSet;

use nalgebra::{Point3, Vector3};
use serde_json::Value;

use super::{NOT_DRAWN, Preview, glb};
use crate::geometry::{Mesh, Poll};

fn preview(mesh: &Mesh, max_triangles: usize) -> Preview {
    super::preview(mesh, max_triangles, &Poll::never()).expect("not interrupted")
}

/// A sphere of quads, each cut into two triangles: `2·n` meridians, `n` rings of faces, each quad one face of the "file".
fn sphere(radius_mm: f64, n: u32) -> Mesh {
    let point = |ring: u32, meridian: u32| {
        let (polar, azimuth) =
            (std::f64::consts::PI * f64::from(ring) / f64::from(n), std::f64::consts::PI * f64::from(meridian) / f64::from(n));
        Point3::new(polar.sin() * azimuth.cos(), polar.sin() * azimuth.sin(), polar.cos()) * radius_mm
    };
    let mut vertices_mm = vec![point(0, 0)];
    vertices_mm.extend((1..n).flat_map(|ring| (0..2 * n).map(move |meridian| point(ring, meridian))));
    vertices_mm.push(point(n, 0));
    let last = vertices_mm.len() as u32 - 1;
    let index = |ring: u32, meridian: u32| match ring {
        0 => 0,
        ring if ring == n => last,
        ring => 1 + (ring - 1) * 2 * n + meridian % (2 * n),
    };
    let (mut faces, mut source_face) = (Vec::new(), Vec::new());
    for (ring, meridian) in (0..n).flat_map(|ring| (0..2 * n).map(move |meridian| (ring, meridian))) {
        let [a, b, c, d] =
            [index(ring, meridian), index(ring + 1, meridian), index(ring + 1, meridian + 1), index(ring, meridian + 1)];
        for face in [[a, b, c], [a, c, d]].into_iter().filter(|[x, y, z]| x != y && y != z && x != z) {
            faces.push(face);
            source_face.push(ring * 2 * n + meridian);
        }
    }
    Mesh { vertices_mm, faces, source_face, groups: Vec::new() }
}

fn as_mesh(preview: &Preview) -> Mesh {
    Mesh {
        vertices_mm: preview.positions_mm.iter().map(|p| Point3::from(p.map(f64::from))).collect(),
        faces: preview.faces.clone(),
        source_face: (0..).take(preview.faces.len()).collect(),
        groups: Vec::new(),
    }
}

#[test]
fn a_mesh_within_the_budget_is_passed_on() {
    let mesh = sphere(40.0, 12);
    let preview = preview(&mesh, mesh.faces.len());
    assert_eq!(preview.faces, mesh.faces);
    assert!((0..mesh.faces.len()).all(|face| preview.source_faces.of(face) == [mesh.source_face[face]]));
    assert!((0..mesh.faces.len()).all(|face| preview.face_of_triangle[face] == face as u32));
}

#[test]
fn thinning_uses_most_of_the_budget_and_keeps_the_shape() {
    let mesh = sphere(40.0, 120);
    let budget = 6000;
    let preview = preview(&mesh, budget);
    assert!((budget * 8 / 10..=budget).contains(&preview.faces.len()), "{} of {budget}", preview.faces.len());
    let thin = as_mesh(&preview);
    assert!((thin.area_mm2() / mesh.area_mm2() - 1.0).abs() < 0.03, "{} of {}", thin.area_mm2(), mesh.area_mm2());
    let off_mm = thin.vertices_mm.iter().map(|p| (p.coords.norm() - 40.0).abs()).fold(0.0, f64::max);
    assert!(off_mm < 0.1, "a vertex is {off_mm} mm off the sphere");
    let inverted =
        (0..thin.faces.len()).filter(|face| thin.scaled_normal(*face).dot(&thin.corners(*face)[0].coords) < 0.0).count();
    assert_eq!(inverted, 0);
}

#[test]
fn edges_of_a_box_stay_sharp() {
    // A box of 40 mm, each side a grid of 60 × 60 quads.
    let mut mesh = Mesh { vertices_mm: Vec::new(), faces: Vec::new(), source_face: Vec::new(), groups: Vec::new() };
    let mut index_of = std::collections::HashMap::new();
    let mut vertex = |mesh: &mut Mesh, at: [i32; 3]| {
        *index_of.entry(at).or_insert_with(|| {
            mesh.vertices_mm.push(Point3::from(at.map(|c| f64::from(c) * 40.0 / 60.0)));
            mesh.vertices_mm.len() as u32 - 1
        })
    };
    for (axis, side, i, j) in
        (0..3).flat_map(|a| [0, 60].into_iter().flat_map(move |s| (0..60).flat_map(move |i| (0..60).map(move |j| (a, s, i, j)))))
    {
        let corner = |di: i32, dj: i32| {
            let mut at = [0; 3];
            (at[axis], at[(axis + 1) % 3], at[(axis + 2) % 3]) = (side, i + di, j + dj);
            at
        };
        let mut quad = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)].map(|at| vertex(&mut mesh, at));
        if side == 0 {
            quad.reverse();
        }
        mesh.faces.extend([[quad[0], quad[1], quad[2]], [quad[0], quad[2], quad[3]]]);
    }
    mesh.source_face = (0..).take(mesh.faces.len()).collect();
    let thin = as_mesh(&preview(&mesh, 2000));
    let aabb = thin.aabb();
    assert!((aabb.extent_mm() - Vector3::from([40.0; 3])).amax() < 1e-3, "{aabb:?}");
    assert!((thin.area_mm2() / (6.0 * 1600.0) - 1.0).abs() < 1e-3, "{}", thin.area_mm2());
}

#[test]
fn every_triangle_of_a_closed_body_finds_a_face_and_every_face_its_sources() {
    let mesh = sphere(40.0, 100);
    let preview = preview(&mesh, 3000);
    assert!(preview.face_of_triangle.iter().all(|face| (*face as usize) < preview.faces.len()));
    let named: BTreeSet<u32> = preview.source_faces.faces.iter().copied().collect();
    assert_eq!(named, mesh.source_face.iter().copied().collect());
    for face in 0..preview.faces.len() {
        let sources = preview.source_faces.of(face);
        assert!(!sources.is_empty() && sources.is_sorted());
    }
    for (triangle, face) in preview.face_of_triangle.iter().enumerate() {
        assert!(preview.source_faces.of(*face as usize).contains(&mesh.source_face[triangle]));
    }
}

#[test]
fn open_and_non_manifold_meshes_pass_and_tiny_bodies_are_not_drawn() {
    let mut mesh = sphere(40.0, 60);
    // Half of it, a fin on one edge, and a speck far smaller than a cell.
    mesh.faces.truncate(mesh.faces.len() / 2);
    mesh.source_face.truncate(mesh.faces.len());
    let [a, b, _] = mesh.faces[500];
    let base = mesh.vertices_mm.len() as u32;
    mesh.vertices_mm.extend([
        Point3::new(0.0, 0.0, 90.0),
        Point3::new(1.0, 1.0, -1.0),
        Point3::new(1.001, 1.0, -1.0),
        Point3::new(1.0, 1.001, -1.0),
    ]);
    mesh.faces.extend([[a, b, base], [base + 1, base + 2, base + 3]]);
    mesh.source_face.extend([90_000, 90_001]);
    let preview = preview(&mesh, 800);
    assert!(preview.faces.len() <= 800);
    assert_eq!(preview.face_of_triangle.last(), Some(&NOT_DRAWN));
    assert!(preview.face_of_triangle.iter().filter(|face| **face == NOT_DRAWN).count() == 1);
    assert!(preview.faces.iter().flatten().all(|vertex| (*vertex as usize) < preview.positions_mm.len()));
}

#[test]
fn no_budget_means_no_faces() {
    let mesh = sphere(40.0, 8);
    let preview = preview(&mesh, 0);
    assert_eq!((preview.faces.len(), preview.positions_mm.len()), (0, 0));
    let (document, binary) = chunks(&glb(&preview));
    assert_eq!(document["asset"]["version"], "2.0");
    assert!(document.get("meshes").is_none(), "glTF allows no empty accessors");
    assert_eq!(binary.len() % 4, 0);
}

/// The two chunks of a GLB file, its framing checked against chapter 4.4 of the specification.
fn chunks(bytes: &[u8]) -> (Value, Vec<u8>) {
    let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().expect("four bytes")) as usize;
    assert_eq!((&bytes[..4], word(4), word(8)), (b"glTF".as_slice(), 2, bytes.len()));
    let json_length = word(12);
    assert_eq!((&bytes[16..20], json_length % 4), (b"JSON".as_slice(), 0));
    let document = serde_json::from_slice(&bytes[20..20 + json_length]).expect("JSON");
    let at = 20 + json_length;
    if at == bytes.len() {
        return (document, Vec::new());
    }
    assert_eq!((&bytes[at + 4..at + 8], word(at) % 4, at + 8 + word(at)), (b"BIN\0".as_slice(), 0, bytes.len()));
    (document, bytes[at + 8..].to_vec())
}

#[test]
fn glb_holds_positions_faces_and_the_way_back() {
    let mesh = sphere(40.0, 30);
    let preview = preview(&mesh, 500);
    let bytes = glb(&preview);
    assert_eq!(bytes, glb(&preview));
    let (document, binary) = chunks(&bytes);
    assert_eq!(document["buffers"][0]["byteLength"], binary.len());
    let accessor = |index: usize| {
        let view = &document["bufferViews"][document["accessors"][index]["bufferView"].as_u64().expect("a view") as usize];
        let (offset, length) =
            (view["byteOffset"].as_u64().expect("offset") as usize, view["byteLength"].as_u64().expect("length") as usize);
        assert_eq!(offset % 4, 0);
        binary[offset..offset + length].chunks_exact(4).map(|c| c.try_into().expect("four bytes")).collect::<Vec<[u8; 4]>>()
    };
    let primitive = &document["meshes"][0]["primitives"][0];
    let positions: Vec<f32> = accessor(primitive["attributes"]["POSITION"].as_u64().expect("index") as usize)
        .into_iter()
        .map(f32::from_le_bytes)
        .collect();
    assert_eq!(positions, preview.positions_mm.as_flattened());
    for axis in 0..3 {
        let (low, high) =
            preview.positions_mm.iter().fold((f32::MAX, f32::MIN), |(low, high), p| (low.min(p[axis]), high.max(p[axis])));
        assert_eq!(document["accessors"][0]["min"][axis], f64::from(low));
        assert_eq!(document["accessors"][0]["max"][axis], f64::from(high));
    }
    let words = |index: &Value| {
        accessor(index.as_u64().expect("index") as usize).into_iter().map(u32::from_le_bytes).collect::<Vec<u32>>()
    };
    assert_eq!(words(&primitive["indices"]), preview.faces.as_flattened());
    assert_eq!(words(&primitive["extras"]["source_faces"]["offsets"]), preview.source_faces.offsets);
    assert_eq!(words(&primitive["extras"]["source_faces"]["faces"]), preview.source_faces.faces);
}
