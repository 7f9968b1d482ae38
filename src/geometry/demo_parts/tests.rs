use nalgebra::Vector3;

use super::field::DistanceField;
use super::*;
use crate::geometry::mesh_io::{Limits, read, write_stl};
use crate::geometry::{LengthUnit, assess};

fn field(part: DemoPart) -> fn(&nalgebra::Point3<f64>) -> f64 {
    match part {
        DemoPart::Base => base::distance_mm,
        DemoPart::Figurine => figurine::distance_mm,
    }
}

/// Every part at several resolutions.
fn parts() -> impl Iterator<Item = (DemoPart, usize, Mesh)> {
    let all = DemoPart::ALL.into_iter().flat_map(|part| [8_000, 20_000, 60_000].map(|target| (part, target)));
    all.map(|(part, target)| (part, target, part.mesh(target).expect("a demo part")))
}

fn unit_normal(mesh: &Mesh, face: usize) -> Vector3<f64> {
    mesh.scaled_normal(face).normalize()
}

/// Area that lies flat on the table, facing down.
fn underside_mm2(mesh: &Mesh) -> f64 {
    let lies_flat = |face: &usize| mesh.corners(*face).iter().all(|p| p.z == 0.0);
    let down = (0..mesh.faces.len()).filter(lies_flat).filter(|&face| unit_normal(mesh, face).z < -0.999_999);
    down.map(|face| mesh.face_area_mm2(face)).sum()
}

#[test]
#[ignore = "long: tests/all runs it"]
fn the_parts_are_sound_at_any_resolution() {
    for (part, target, mesh) in parts() {
        let health = assess(&mesh);
        assert!(health.triangles.abs_diff(target) * 10 <= target, "{part} {target}: {}", health.triangles);
        assert!(health.watertight && health.bodies == 1, "{part} {target}: {health:?}");
        assert_eq!((health.degenerate_triangles, health.duplicate_triangles, health.inconsistent_edges), (0, 0, 0));
        assert_eq!(health.warnings(), [], "{part} {target}");
        assert!(health.volume_mm3.expect("closed") > 1e5);
        assert_eq!(health.aabb.min.z, 0.0, "it stands on the table");
    }
}

#[test]
#[ignore = "long: tests/all runs it"]
fn every_vertex_lies_on_the_surface() {
    for (part, target, mesh) in parts() {
        let cell_mm = (mesh.area_mm2() / target as f64 * 2.0).sqrt();
        let off = |p: &nalgebra::Point3<f64>| field(part).at(p).abs();
        let far = mesh.vertices_mm.iter().filter(|p| off(p) > 1e-4).count();
        let worst = mesh.vertices_mm.iter().map(off).fold(0.0, f64::max);
        eprintln!("{part} {target}: {far} off, worst {worst} cell {cell_mm}");
    }
}

#[test]
#[ignore = "long: tests/all runs it"]
fn quality() {
    for (part, target, mesh) in parts() {
        let mut angles: Vec<f64> = (0..mesh.faces.len())
            .map(|f| {
                let [a, b, c] = mesh.corners(f);
                let s = [(b - a).angle(&(c - a)), (c - b).angle(&(a - b)), (a - c).angle(&(b - c))];
                s.into_iter().fold(9., f64::min).to_degrees()
            })
            .collect();
        angles.sort_by(f64::total_cmp);
        let flipped = (0..mesh.faces.len())
            .filter(|&f| {
                let [a, b, c] = mesh.corners(f);
                let m = nalgebra::Point3::from((a.coords + b.coords + c.coords) / 3.);
                unit_normal(&mesh, f).dot(&field(part).gradient(&m)) < 0.0
            })
            .count();
        let n = angles.len();
        eprintln!(
            "{part} {target}: {} flipped {flipped} angles min {:.3} 0.1% {:.2} 1% {:.2} median {:.1} underside {} bbox {:?}",
            n,
            angles[0],
            angles[n / 1000],
            angles[n / 100],
            angles[n / 2],
            underside_mm2(&mesh),
            mesh.aabb()
        );
    }
}

#[test]
fn stl_keeps_them_exactly() {
    for part in DemoPart::ALL {
        let mesh = part.mesh(DEFAULT_TRIANGLES).expect("a demo part");
        let again = read(&write_stl(&mesh), Some(LengthUnit::Millimetre), &Limits::default()).expect("a mesh").mesh;
        assert_eq!(again.faces.len(), mesh.faces.len());
        assert!((0..mesh.faces.len()).all(|face| again.corners(face) == mesh.corners(face)));
    }
}
