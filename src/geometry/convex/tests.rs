use nalgebra::{Point3, Vector3};

use super::{ConvexPolytope, HalfSpace, box_half_spaces, largest_centred_box};

fn close(a: f64, b: f64, tolerance: f64) {
    assert!((a - b).abs() <= tolerance, "{a} is not {b} ± {tolerance}");
}

/// Half-spaces of the regular octahedron |x| + |y| + |z| ≤ 1 scaled to `reach_mm`.
fn octahedron(reach_mm: f64) -> Vec<HalfSpace> {
    (0..8_u32)
        .map(|octant| Vector3::from_fn(|axis, _| if octant >> axis & 1 == 0 { 1.0 } else { -1.0 }))
        .map(|n| HalfSpace::through(&Point3::from(n * (reach_mm / 3.0)), &n))
        .collect()
}

#[test]
fn box_has_its_volume_and_eight_corners() {
    let polytope = ConvexPolytope::intersection(box_half_spaces(&Point3::new(5.0, -7.0, 400.0), &Vector3::new(10.0, 20.0, 30.0)))
        .expect("a box has an inside");
    close(polytope.volume_mm3, 6000.0, 1e-6);
    assert_eq!(polytope.vertices_mm.len(), 8);
    assert!(polytope.holds(&Point3::new(9.9, 2.9, 414.9)) && !polytope.holds(&Point3::new(10.1, 0.0, 400.0)));
}

#[test]
fn octahedron_has_its_volume_and_six_corners_of_four_planes_each() {
    let polytope = ConvexPolytope::intersection(octahedron(100.0)).expect("an octahedron has an inside");
    close(polytope.volume_mm3, 4.0 / 3.0 * 1e6, 1e-3);
    assert_eq!(polytope.vertices_mm.len(), 6);
}

#[test]
fn repeated_and_idle_half_spaces_change_nothing() {
    let once = octahedron(100.0);
    let far = HalfSpace { normal: Vector3::x(), offset_mm: 1000.0 };
    let twice = once.iter().chain(&once).copied().chain([far]);
    let polytope = ConvexPolytope::intersection(twice).expect("an octahedron has an inside");
    close(polytope.volume_mm3, 4.0 / 3.0 * 1e6, 1e-3);
}

#[test]
fn cut_halves_a_box_and_empties_it() {
    let polytope =
        ConvexPolytope::intersection(box_half_spaces(&Point3::origin(), &Vector3::new(2.0, 2.0, 2.0))).expect("a cube");
    let half = polytope.cut([HalfSpace::through(&Point3::origin(), &Vector3::new(1.0, 1.0, 0.0))]).expect("half a cube");
    close(half.volume_mm3, 4.0, 1e-9);
    let beyond = HalfSpace { normal: Vector3::z(), offset_mm: -1.0 };
    assert!(polytope.cut([beyond]).is_none(), "a face alone has no inside");
}

#[test]
fn largest_box_in_an_octahedron_is_the_cube_of_its_face_centres() {
    // One constraint holds: h = r / 3 in each axis.
    let edges = largest_centred_box(&octahedron(90.0), &Point3::origin()).expect("the octahedron is bounded");
    close((edges - Vector3::repeat(60.0)).norm(), 0.0, 1e-9);
}

#[test]
fn largest_box_held_by_three_and_by_two_planes() {
    let centre = Point3::new(1.0, 2.0, 3.0);
    let brick = box_half_spaces(&centre, &Vector3::new(4.0, 6.0, 8.0));
    let edges = largest_centred_box(&brick, &centre).expect("a brick");
    close((edges - Vector3::new(4.0, 6.0, 8.0)).norm(), 0.0, 1e-9);

    // |x| + |y| ≤ 1 and |z| ≤ 1: x y is largest at 1/2 each, with z free up to its own plane.
    let diamond = [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)]
        .map(|(x, y)| HalfSpace::through(&Point3::new(x / 2.0, y / 2.0, 0.0), &Vector3::new(x, y, 0.0)));
    let lids = [Vector3::z(), -Vector3::z()].map(|normal| HalfSpace { normal, offset_mm: 1.0 });
    let prism: Vec<_> = diamond.into_iter().chain(lids).collect();
    let edges = largest_centred_box(&prism, &Point3::origin()).expect("a prism");
    close((edges - Vector3::new(1.0, 1.0, 2.0)).norm(), 0.0, 1e-9);
}

#[test]
fn largest_box_beats_a_dense_search() {
    // Planes in general position, so that two and three of them hold at the optimum.
    let normals = [(0.9, 0.1, 0.5), (-0.7, 0.6, 0.2), (0.1, -0.8, 0.7), (-0.3, -0.3, -0.9), (0.2, 0.9, -0.4), (0.4, -0.6, -0.7)];
    let planes: Vec<_> = normals
        .iter()
        .zip([3.0, 2.0, 4.0, 2.5, 3.5, 1.5])
        .map(|((x, y, z), offset_mm)| HalfSpace { normal: Vector3::new(*x, *y, *z).normalize(), offset_mm })
        .collect();
    let best = largest_centred_box(&planes, &Point3::origin()).expect("bounded");
    let fits = |h: &Vector3<f64>| planes.iter().all(|p| p.normal.abs().dot(h) <= p.offset_mm);
    assert!(fits(&(best * 0.5 * (1.0 - 1e-9))), "the answer must fit");
    let mut searched = 0.0_f64;
    for i in 1..150 {
        for j in 1..150 {
            let (x, y) = (f64::from(i) * 0.03, f64::from(j) * 0.03);
            let z = planes.iter().map(|p| (p.offset_mm - p.normal.x.abs() * x - p.normal.y.abs() * y) / p.normal.z.abs());
            searched = searched.max(8.0 * x * y * z.fold(f64::INFINITY, f64::min));
        }
    }
    assert!(best.product() >= searched && best.product() <= searched * 1.01, "{} against {searched}", best.product());
}

#[test]
fn no_box_about_a_centre_outside_or_without_bounds() {
    let brick = box_half_spaces(&Point3::origin(), &Vector3::new(4.0, 6.0, 8.0));
    assert_eq!(largest_centred_box(&brick, &Point3::new(3.0, 0.0, 0.0)), None);
    assert_eq!(largest_centred_box(&brick[..2], &Point3::origin()), None);
}
