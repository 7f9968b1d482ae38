//! Packets against a loop in f64 that shares no code with them, at every level of vector instructions.

use nalgebra::{Point3, Vector3};
use proptest::prelude::*;

use super::{mesh, octahedron};
use crate::geometry::demo_parts::figurine;
use crate::geometry::{Hit, Mesh, RayScene, SimdLevel};

/// Steps of `i` that fill the unit interval evenly.
fn spread(i: usize, step: f64) -> f64 {
    (i as f64 * step).fract()
}

fn direction(i: usize) -> Vector3<f64> {
    let [z, angle] = [2.0 * spread(i, 0.618_033_988_749_895) - 1.0, std::f64::consts::TAU * spread(i, 0.414_213_562_373_095)];
    let radius = (1.0 - z * z).sqrt();
    Vector3::new(radius * angle.cos(), radius * angle.sin(), z)
}

fn blocked(scene: &RayScene, level: SimdLevel, origin: &Point3<f64>, targets: &[Point3<f64>], share: f64) -> Vec<bool> {
    // What the vector held before is no part of the answer.
    let mut blocked = vec![true; 3];
    scene.blocked_from(level, origin, targets, share, &mut blocked);
    blocked
}

fn first_hits(scene: &RayScene, level: SimdLevel, origin: &Point3<f64>, directions: &[Vector3<f64>]) -> Vec<Option<Hit>> {
    let mut hits = vec![Some(Hit { triangle: 0, share: 0.0 }); 3];
    scene.first_hits_from(level, origin, directions, &mut hits);
    hits
}

/// A sphere of radius 1 as an octahedron that is split `splits` times.
fn sphere(splits: usize) -> Mesh {
    let mut corners: Vec<[Vector3<f64>; 3]> = {
        let octahedron = octahedron();
        (0..8).map(|face| octahedron.corners(face).map(|p| p.coords)).collect()
    };
    for _ in 0..splits {
        let middle = |a: Vector3<f64>, b: Vector3<f64>| (a + b).normalize();
        corners = corners
            .into_iter()
            .flat_map(|[a, b, c]| {
                let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
                [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
            })
            .collect();
    }
    let vertices: Vec<_> = corners.iter().flatten().map(|p| [p.x, p.y, p.z]).collect();
    let faces: Vec<_> = (0..corners.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
    mesh(&vertices, &faces)
}

#[test]
fn no_ray_of_a_packet_slips_through_an_edge_or_a_vertex() {
    let mesh = sphere(4);
    let scene = RayScene::new([&mesh]);
    let on_edges = (0..mesh.faces.len()).flat_map(|face| {
        let [a, b, c] = mesh.corners(face).map(|p| p.coords);
        [a.lerp(&b, 0.5), b.lerp(&c, 0.31), c.lerp(&a, 0.77)].map(Point3::from)
    });
    let edges: Vec<_> = on_edges.collect();
    let vertices = mesh.vertices_mm.clone();
    for origin in (0..40).map(|i| Point3::from(direction(i) * 0.9 * spread(i, 0.7548776662466927))) {
        for (name, targets) in [("edges", &edges), ("vertices", &vertices)] {
            for level in SimdLevel::available() {
                let blocked = blocked(&scene, level, &origin, targets, 1.1);
                let through = blocked.iter().filter(|blocked| !**blocked).count();
                eprintln!("{through} of {} rays at {name} slip through from {origin} at {}", targets.len(), level.as_str());
            }
        }
    }
    panic!();
}
