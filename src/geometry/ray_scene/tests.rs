mod packets;

use std::sync::atomic::{AtomicUsize, Ordering};

use nalgebra::{Point3, Vector3};
use proptest::prelude::*;

use super::RayScene;
use super::split::PART;
use crate::geometry::Mesh;
use crate::geometry::demo_parts::figurine;

fn mesh(vertices: &[[f64; 3]], faces: &[[u32; 3]]) -> Mesh {
    Mesh {
        vertices_mm: vertices.iter().map(|v| Point3::from(*v)).collect(),
        faces: faces.to_vec(),
        source_face: (0..faces.len() as u32).collect(),
        groups: Vec::new(),
    }
}

/// A unit octahedron: every axis ray goes through a vertex, every diagonal one through an edge.
fn octahedron() -> Mesh {
    mesh(
        &[[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -1.0]],
        &[[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]],
    )
}

#[test]
fn no_ray_slips_through_an_edge_or_a_vertex() {
    let scene = RayScene::new([&octahedron()]);
    for direction in [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [1.0, 1.0, 0.0], [0.0, -1.0, 1.0], [1.0, 1.0, 1.0], [-3.0, 1e-9, 0.0]] {
        let far = Point3::from(Vector3::from(direction) * 10.0);
        assert!(scene.blocked(&far, &Point3::origin(), 1.0), "{direction:?} towards the centre");
        assert!(scene.blocked(&Point3::origin(), &far, 1.0), "{direction:?} from the centre");
    }
}

#[test]
fn a_segment_ends_where_it_is_told() {
    let scene = RayScene::new([&octahedron()]);
    let (from, to) = (Point3::new(0.1, 0.2, 2.0), Point3::new(0.1, 0.2, 0.7));
    assert!(!scene.blocked(&from, &to, 1.0 - 1e-9), "the surface itself does not hide its own point");
    assert!(scene.blocked(&from, &to, 1.0 + 1e-9));
    assert!(!scene.blocked(&Point3::new(0.1, 0.2, 0.71), &from, 1.0));
}

#[test]
fn an_empty_scene_blocks_nothing() {
    assert!(!RayScene::new([]).blocked(&Point3::origin(), &Point3::new(1.0, 0.0, 0.0), 1.0));
}

#[test]
fn inside_is_told_from_outside() {
    let scene = RayScene::new([&octahedron()]);
    for inside in [[0.1, 0.2, 0.1], [0.0, 0.0, 0.0], [0.0, 0.0, -0.99]] {
        assert!(scene.encloses(&Point3::from(inside)), "{inside:?}");
    }
    for outside in [[1.0, 1.0, 1.0], [0.0, 0.0, 1.01], [-0.5, -0.6, 0.0]] {
        assert!(!scene.encloses(&Point3::from(outside)), "{outside:?}");
    }
}

/// Many triangles: a part with small details, and one of which all lie in one place.
fn large() -> [Mesh; 2] {
    let triangle = [[0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [0.0, 1.0, 1.0]];
    [figurine(3 * PART).expect("a demo part"), mesh(&triangle, &vec![[0, 1, 2]; 2 * PART + 1])]
}

#[test]
fn a_tree_of_parts_answers_as_the_plain_loop() {
    for part in large() {
        let scene = RayScene::new([&part]);
        assert_eq!(scene.faces.len(), part.faces.len());
        let (middle, size) = (part.aabb().centre(), (part.aabb().max - part.aabb().min).norm());
        let mut blocked = 0;
        for ray in 0..200 {
            let turn = f64::from(ray);
            let from = middle + size * Vector3::new((2.4 * turn).cos(), (2.4 * turn).sin(), 1.0 - 0.01 * turn);
            let to = middle - 0.1 * (from - middle) + 0.002 * size * Vector3::new((0.7 * turn).sin(), (1.3 * turn).cos(), 0.0);
            let plain = scene.blocked_brute_force(&from, &to, 1.0);
            assert_eq!(scene.blocked(&from, &to, 1.0), plain, "ray {ray}");
            blocked += u32::from(plain);
        }
        assert!(blocked > 50, "{blocked} of 200");
    }
}

#[test]
fn who_gives_up_is_heard_while_a_tree_is_built() {
    for part in large() {
        let asked = AtomicUsize::new(0);
        let count = || {
            asked.fetch_add(1, Ordering::Relaxed);
            Ok::<(), usize>(())
        };
        assert!(RayScene::interruptible([&part], count).is_ok());
        let asked = asked.into_inner();
        assert!(asked >= 2 * part.faces.len() / PART, "asked {asked} times");
        for last in 0..asked {
            let left = AtomicUsize::new(last);
            let check = || left.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |left| left.checked_sub(1)).map(|_| ());
            assert!(RayScene::interruptible([&part], check).is_err(), "given up after {last} of {asked}");
        }
    }
}

fn coordinate() -> impl Strategy<Value = f64> {
    // A coarse grid makes rays that graze edges, vertices and box planes common.
    prop_oneof![(-8i32..=8).prop_map(f64::from), -8.0..8.0]
}

fn point() -> impl Strategy<Value = [f64; 3]> {
    [coordinate(), coordinate(), coordinate()]
}

proptest! {
    #[test]
    fn the_tree_answers_as_the_plain_loop(
        corners in prop::collection::vec([point(), point(), point()], 1..60),
        rays in prop::collection::vec((point(), point()), 50),
    ) {
        let vertices: Vec<_> = corners.iter().flatten().copied().collect();
        let faces: Vec<_> = (0..corners.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
        let scene = RayScene::new([&mesh(&vertices, &faces)]);
        for (from, to) in rays {
            let (from, to) = (Point3::from(from), Point3::from(to));
            prop_assert_eq!(scene.blocked(&from, &to, 0.99), scene.blocked_brute_force(&from, &to, 0.99));
        }
    }
}
