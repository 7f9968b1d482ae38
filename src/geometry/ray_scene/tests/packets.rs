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
    let targets: Vec<_> = on_edges.chain(mesh.vertices_mm.iter().copied()).collect();
    for origin in (0..20).map(|i| Point3::from(direction(i) * 0.9 * spread(i, 0.754_877_666_246_693))) {
        let directions: Vec<_> = targets.iter().map(|target| target - origin).collect();
        for level in SimdLevel::available() {
            let name = level.as_str();
            assert!(blocked(&scene, level, &origin, &targets, 1.1).iter().all(|blocked| *blocked), "{name}, from {origin}");
            for hit in first_hits(&scene, level, &origin, &directions) {
                let share = hit.expect("the sphere is closed").share;
                assert!((0.99..1.01).contains(&share), "{name}, from {origin}: {share}");
            }
        }
    }
}

#[test]
fn axis_rays_through_vertices_hit() {
    let scene = RayScene::new([&octahedron()]);
    let axes = [Vector3::x(), -Vector3::x(), Vector3::y(), -Vector3::y(), Vector3::z(), -Vector3::z()];
    for level in SimdLevel::available() {
        for hit in first_hits(&scene, level, &Point3::origin(), &axes) {
            assert_eq!(hit.expect("a vertex is in the way").share, 1.0);
        }
    }
}

/// Directions of all kinds towards and past a part, some of which are none.
fn mixed_directions(count: usize) -> Vec<Vector3<f64>> {
    let mut directions: Vec<_> = (0..count).map(|i| direction(i) * (1.0 + 200.0 * spread(i, 0.569_840_290_998_053))).collect();
    directions[3] = Vector3::zeros();
    directions[count / 2] = Vector3::new(f64::NAN, 1.0, 0.0);
    directions[count / 2 + 1] = Vector3::new(0.0, f64::INFINITY, 0.0);
    directions[count - 1] = Vector3::new(0.0, -3.0, 0.0);
    directions
}

#[test]
fn answers_depend_neither_on_the_level_nor_on_the_company() {
    let part = figurine(8_000).expect("a demo part");
    let scene = RayScene::new([&part]);
    let centre = part.aabb().centre();
    let directions = mixed_directions(2_001);
    for origin in [centre, centre + Vector3::new(90.0, -40.0, 15.0), centre + Vector3::new(0.0, 0.0, 480.0)] {
        let towards: Vec<_> = directions.iter().map(|d| if d.norm() > 100.0 { centre + d * 0.3 - origin } else { *d }).collect();
        let targets: Vec<_> = towards.iter().map(|d| origin + d).collect();
        let together = first_hits(&scene, SimdLevel::PORTABLE, &origin, &towards);
        let any = blocked(&scene, SimdLevel::PORTABLE, &origin, &targets, 1.0);
        assert!(together.iter().flatten().count() > 200 && any.iter().filter(|blocked| **blocked).count() > 100);
        for level in SimdLevel::available() {
            assert_eq!(first_hits(&scene, level, &origin, &towards), together, "{}", level.as_str());
            assert_eq!(blocked(&scene, level, &origin, &targets, 1.0), any, "{}", level.as_str());
            for ray in (0..towards.len()).step_by(7) {
                assert_eq!(first_hits(&scene, level, &origin, &towards[ray..=ray])[0], together[ray]);
                assert_eq!(blocked(&scene, level, &origin, &targets[ray..=ray], 1.0)[0], any[ray]);
            }
        }
    }
}

#[test]
fn any_number_of_rays_is_answered() {
    let scene = RayScene::new([&octahedron()]);
    for count in (0..40).chain([160, 161]) {
        let directions: Vec<_> = (0..count).map(|i| direction(i) * 2.0).collect();
        let hits = first_hits(&scene, SimdLevel::widest(), &Point3::origin(), &directions);
        assert_eq!((hits.len(), hits.iter().flatten().count()), (count, count));
    }
}

#[test]
fn rays_that_are_none_meet_nothing() {
    let scene = RayScene::new([&octahedron()]);
    let none = [Vector3::zeros(), Vector3::repeat(f64::NAN), Vector3::new(f64::INFINITY, 0.0, 0.0)];
    for level in SimdLevel::available() {
        assert!(first_hits(&scene, level, &Point3::origin(), &none).iter().all(Option::is_none));
        assert!(first_hits(&scene, level, &Point3::from([f64::NAN; 3]), &[Vector3::x()])[0].is_none());
        assert!(first_hits(&RayScene::new([]), level, &Point3::origin(), &[Vector3::x()])[0].is_none());
        assert!(!blocked(&RayScene::new([]), level, &Point3::origin(), &[Point3::new(1.0, 0.0, 0.0)], 1.0)[0]);
    }
    assert!(!scene.blocked(&Point3::from([f64::NAN; 3]), &Point3::origin(), 1.0));
}

#[test]
fn length_of_a_direction_only_scales_the_share() {
    let scene = RayScene::new([&octahedron()]);
    let towards = direction(5);
    let share = |length: f64| {
        first_hits(&scene, SimdLevel::widest(), &Point3::origin(), &[towards * length])[0].map(|hit| hit.share * length)
    };
    let unit = share(1.0).expect("inside a closed surface");
    for length in [1e-9, 1e-3, 1e3, 1e9] {
        assert!((share(length).expect("the same ray") - unit).abs() < 1e-6 * unit, "{length}");
    }
}

#[test]
fn a_part_far_from_the_origin_is_seen_as_well_as_a_near_one() {
    let near = figurine(8_000).expect("a demo part");
    let shift = Vector3::new(50_000.0, -20_000.0, 8_000.0);
    let far = Mesh { vertices_mm: near.vertices_mm.iter().map(|p| p + shift).collect(), ..near.clone() };
    let origin = near.aabb().centre() + Vector3::new(300.0, 200.0, 250.0);
    let directions: Vec<_> = near.vertices_mm.iter().map(|p| p + Vector3::new(0.01, 0.02, -0.03) - origin).collect();
    let near = first_hits(&RayScene::new([&near]), SimdLevel::widest(), &origin, &directions);
    let far = first_hits(&RayScene::new([&far]), SimdLevel::widest(), &(origin + shift), &directions);
    let same = near.iter().zip(&far).filter(|(near, far)| near.map(|hit| hit.triangle) == far.map(|hit| hit.triangle)).count();
    assert!(near.len() - same < near.len() / 1000, "{same} of {} rays meet the same triangle", near.len());
}

#[test]
fn the_order_of_leaves_holds_every_triangle_once() {
    let (part, other) = (figurine(8_000).expect("a demo part"), octahedron());
    let scene = RayScene::new([&part, &other]);
    let mut order = scene.tree.order.clone();
    let centre = |face: u32| {
        let [a, b, c] = part.corners(face as usize);
        Point3::from((a.coords + b.coords + c.coords) / 3.0)
    };
    let of_part = |face: &u32| (*face as usize) < part.faces.len();
    let way = |order: &[u32]| {
        order
            .windows(2)
            .filter(|pair| pair.iter().all(of_part))
            .map(|pair| (centre(pair[0]) - centre(pair[1])).norm())
            .sum::<f64>()
    };
    let edge_mm = (part.area_mm2() / part.faces.len() as f64).sqrt();
    assert!(way(&order) < 3.0 * edge_mm * part.faces.len() as f64, "neighbours are apart");
    order.sort_unstable();
    assert!(order.into_iter().eq(0..(part.faces.len() + other.faces.len()) as u32));
}

#[test]
fn hits_are_counted_over_all_meshes() {
    let (left, mut right) = (octahedron(), octahedron());
    right.vertices_mm.iter_mut().for_each(|p| p.x += 10.0);
    let scene = RayScene::new([&left, &right]);
    let toward = [Vector3::new(-1.0, -0.1, -0.2)];
    let hit = first_hits(&scene, SimdLevel::widest(), &Point3::new(20.0, 1.0, 2.0), &toward)[0].expect("on the way");
    assert!((8..16).contains(&hit.triangle), "{}", hit.triangle);
}

#[test]
fn a_thousand_times_the_same_triangle_is_no_harder_than_once() {
    let faces = vec![[0, 1, 2]; 1000];
    let scene = RayScene::new([&mesh(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], &faces)]);
    let down = [Vector3::new(0.0, 0.0, -2.0), Vector3::new(1.0, 1.0, -2.0)];
    let hits = first_hits(&scene, SimdLevel::widest(), &Point3::new(0.2, 0.3, 1.0), &down);
    assert_eq!(hits[0].map(|hit| hit.share), Some(0.5));
    assert_eq!(hits[1], None);
}

#[test]
fn a_scene_takes_less_than_160_bytes_a_triangle() {
    let part = figurine(20_000).expect("a demo part");
    let bytes = RayScene::new([&part]).size_bytes() as f64 / part.faces.len() as f64;
    assert!(bytes < 100.0, "{bytes} bytes a triangle of a welded mesh");
    let soup_vertices: Vec<_> = (0..part.faces.len()).flat_map(|face| part.corners(face)).map(|p| [p.x, p.y, p.z]).collect();
    let soup_faces: Vec<_> = (0..part.faces.len() as u32).map(|face| [3 * face, 3 * face + 1, 3 * face + 2]).collect();
    let bytes = RayScene::new([&mesh(&soup_vertices, &soup_faces)]).size_bytes() as f64 / part.faces.len() as f64;
    assert!(bytes < 160.0, "{bytes} bytes a triangle of a mesh without a shared vertex");
}

/// First hit on a ray, by the volumes of the ray with a triangle's edges and its plane, in f64. `None` where f32 need not
/// agree: the ray passes the line of an edge, an end of the segment or another hit within `GRAZE`, or lies in a plane.
fn plain_loop(triangles: &[[Point3<f64>; 3]], origin: &Point3<f64>, d: &Vector3<f64>, end: f64) -> Option<Option<Hit>> {
    // Coordinates reach 8: a hundred times the roundings of f32 there.
    const GRAZE: f64 = 1e-4;
    let mut hits = Vec::new();
    for (triangle, corners) in triangles.iter().enumerate() {
        let [a, b, c] = corners.map(|corner| corner - origin);
        let normal = (b - a).cross(&(c - a));
        let descent = d.dot(&normal);
        if descent.abs() < 1e-3 * d.norm() * normal.norm() {
            return None;
        }
        let passes = [(b, c), (c, a), (a, b)].map(|(p, q)| d.dot(&p.cross(&q)) / ((q - p).norm() * d.norm()));
        if passes.iter().any(|pass| pass.abs() < GRAZE) {
            return None;
        }
        let share = a.dot(&normal) / descent;
        if passes.iter().all(|pass| *pass > 0.0) || passes.iter().all(|pass| *pass < 0.0) {
            hits.push(Hit { triangle: triangle as u32, share });
        }
    }
    let near = |a: f64, b: f64| (a - b).abs() * d.norm() < GRAZE;
    if hits.iter().any(|hit| near(hit.share, 0.0) || near(hit.share, end)) {
        return None;
    }
    hits.retain(|hit| 0.0 < hit.share && hit.share < end);
    hits.sort_by(|a, b| a.share.total_cmp(&b.share));
    let tie = hits.len() > 1 && near(hits[0].share, hits[1].share);
    (!tie).then(|| hits.first().copied())
}

fn point() -> impl Strategy<Value = [f64; 3]> {
    [-8.0..8.0, -8.0..8.0, -8.0..8.0]
}

proptest! {
    #[test]
    fn packets_answer_as_the_plain_loop(
        corners in prop::collection::vec([point(), point(), point()], 1..60),
        origin in point(),
        targets in prop::collection::vec(point(), 100),
    ) {
        let corners: Vec<_> = corners.into_iter().filter(|[a, b, c]| {
            let [a, b, c] = [a, b, c].map(|p| Point3::from(*p));
            (b - a).cross(&(c - a)).norm() > 1e-2
        }).collect();
        let vertices: Vec<_> = corners.iter().flatten().copied().collect();
        let faces: Vec<_> = (0..corners.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
        let scene = RayScene::new([&mesh(&vertices, &faces)]);
        let triangles: Vec<_> = corners.iter().map(|corners| corners.map(Point3::from)).collect();
        let (origin, targets) = (Point3::from(origin), targets.into_iter().map(Point3::from).collect::<Vec<_>>());
        let directions: Vec<_> = targets.iter().map(|target| target - origin).collect();
        for level in SimdLevel::available() {
            let blocked = blocked(&scene, level, &origin, &targets, 0.9);
            let hits = first_hits(&scene, level, &origin, &directions);
            for (ray, d) in directions.iter().enumerate() {
                if let Some(expected) = plain_loop(&triangles, &origin, d, 0.9) {
                    prop_assert_eq!(blocked[ray], expected.is_some(), "{} from {} to {}", level.as_str(), origin, targets[ray]);
                }
                if let Some(expected) = plain_loop(&triangles, &origin, d, f64::INFINITY) {
                    prop_assert_eq!(hits[ray].map(|hit| hit.triangle), expected.map(|hit| hit.triangle));
                    let apart = hits[ray].zip(expected).map_or(0.0, |(a, b)| (a.share - b.share).abs() * d.norm());
                    prop_assert!(apart < 1e-2, "{}", apart);
                }
            }
        }
    }
}
