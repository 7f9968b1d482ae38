use super::*;
use crate::testing::box_mesh;

fn stable_poses(mesh: &Mesh) -> Vec<StablePose> {
    super::stable_poses(mesh, &Poll::never()).expect("not interrupted")
}

#[test]
fn a_brick_stands_on_its_six_sides_the_largest_first() {
    let poses = stable_poses(&box_mesh([0.0; 3], [60.0, 40.0, 20.0]));
    assert_eq!(poses.len(), 6);
    let axis = |pose: &StablePose| pose.down.iamax();
    assert_eq!(poses.iter().map(axis).collect::<Vec<_>>(), [2, 2, 1, 1, 0, 0]);
    assert!((poses.iter().map(|pose| pose.share).sum::<f64>() - 1.0).abs() < 1e-5, "{poses:?}");
    poses.iter().for_each(|pose| assert!((pose.down.norm() - 1.0).abs() < 1e-9 && pose.down.amax() > 1.0 - 1e-5));
}

#[test]
fn a_tall_thin_needle_does_not_stand_on_its_end() {
    // Half the edge over half the height is 1 in 50: it tips within 1.2°.
    let poses = stable_poses(&box_mesh([0.0; 3], [2.0, 2.0, 100.0]));
    assert_eq!(poses.len(), 4);
    poses.iter().for_each(|pose| assert!(pose.down.z.abs() < 1e-6));
}

#[test]
fn an_oblique_tower_falls() {
    // A column whose top is shifted by more than its foot is wide: the centre of mass is beside the foot.
    let mut tower = box_mesh([0.0; 3], [20.0, 20.0, 100.0]);
    tower.vertices_mm.iter_mut().for_each(|p| p.x += 0.6 * p.z);
    let poses = stable_poses(&tower);
    assert!(poses.iter().all(|pose| pose.down.z.abs() < 0.9), "{poses:?}");
    assert!(!poses.is_empty());
}

#[test]
fn what_has_no_volume_stands_nowhere() {
    let flat = Mesh {
        vertices_mm: vec![Point3::origin(), Point3::new(1.0, 0.0, 0.0), Point3::new(0.0, 1.0, 0.0)],
        faces: vec![[0, 1, 2]],
        source_face: vec![0],
        groups: Vec::new(),
    };
    assert!(stable_poses(&flat).is_empty());
}

/// Cylinder on the plate as a file of 32-bit numbers has it.
fn cylinder(radius_mm: f64, height_mm: f64, sections: u32) -> Mesh {
    let ring = |z: f64| {
        (0..sections).map(move |section| {
            let angle = std::f64::consts::TAU * f64::from(section) / f64::from(sections);
            Point3::new(radius_mm * angle.cos(), radius_mm * angle.sin(), z)
        })
    };
    let centres = [0.0, height_mm].map(|z| Point3::new(0.0, 0.0, z));
    let vertices: Vec<_> = ring(0.0).chain(ring(height_mm)).chain(centres).collect();
    let face = |section: u32| {
        let (a, b) = (section, (section + 1) % sections);
        [
            [a, b, sections + b],
            [a, sections + b, sections + a],
            [b, a, 2 * sections],
            [sections + a, sections + b, 2 * sections + 1],
        ]
    };
    let faces: Vec<_> = (0..sections).flat_map(face).collect();
    Mesh {
        vertices_mm: vertices.iter().map(|p| p.map(|c| f64::from(c as f32))).collect(),
        source_face: (0..faces.len() as u32).collect(),
        faces,
        groups: Vec::new(),
    }
}

/// A body turned by no round angle, as a file of 32-bit numbers has it.
fn turned(mut mesh: Mesh) -> Mesh {
    let turn = turn();
    mesh.vertices_mm.iter_mut().for_each(|p| *p = (turn * *p).map(|c| f64::from(c as f32)));
    mesh
}

fn turn() -> nalgebra::Rotation3<f64> {
    nalgebra::Rotation3::from_euler_angles(0.3, -0.7, 1.1)
}

/// Corners on an ellipsoid about the origin, evenly spread for equal radii, without faces.
fn ellipsoid(radii_mm: [f64; 3], corners: u32) -> Mesh {
    let golden_rad = std::f64::consts::PI * (1.0 + 5.0_f64.sqrt());
    let corner = |number: u32| {
        let place = f64::from(number) + 0.5;
        let z = 1.0 - 2.0 * place / f64::from(corners);
        let (sin, cos) = (golden_rad * place).sin_cos();
        let across = (1.0 - z * z).sqrt();
        Point3::new(radii_mm[0] * across * cos, radii_mm[1] * across * sin, radii_mm[2] * z)
    };
    Mesh { vertices_mm: (0..corners).map(corner).collect(), faces: Vec::new(), source_face: Vec::new(), groups: Vec::new() }
}

fn assert_stands_on_its_two_ends(mesh: &Mesh, axis: &Vector3<f64>, name: &str) {
    let poses = stable_poses(mesh);
    let [one, other] = poses[..] else { panic!("{name}: {poses:?}") };
    assert!(one.down.dot(&other.down) < 0.0, "{name}: {poses:?}");
    for pose in [one, other] {
        assert!(pose.down.cross(axis).norm() < 0.1_f64.to_radians().sin(), "{name}: {poses:?}");
    }
}

/// Slivers of the hull were once taken for faces, so that this cylinder was balanced on its rim.
#[test]
fn a_cylinder_of_many_sections_stands_on_no_edge() {
    let poses = stable_poses(&cylinder(30.0, 80.0, 720));
    assert!(poses.iter().all(|pose| pose.down.z.abs() > 0.9999), "{poses:?}");
    // Of few sections, each side is wide enough to stand on.
    let poses = stable_poses(&cylinder(30.0, 80.0, 24));
    let on_side = poses.iter().filter(|pose| pose.down.z.abs() < 1e-3).count();
    assert_eq!((poses.len(), on_side), (26, 24), "{poses:?}");
}

#[test]
fn a_cylinder_of_many_sections_stands_on_its_two_ends() {
    for sections in [360, 720, 900] {
        assert_stands_on_its_two_ends(&cylinder(25.0, 60.0, sections), &Vector3::z(), &format!("{sections} sections"));
    }
}

#[test]
fn a_turned_cylinder_of_many_sections_stands_on_its_two_ends() {
    let axis = turn() * Vector3::z();
    for sections in [360, 720, 900] {
        let mesh = turned(cylinder(25.0, 60.0, sections));
        assert_stands_on_its_two_ends(&mesh, &axis, &format!("{sections} sections"));
    }
}

#[test]
fn a_prism_stands_on_its_sides_until_they_are_too_narrow() {
    // From the axis, half a side is seen under 180° over their number: 30°, 15°, 3.1°.
    for (sections, expected) in [(6, 8), (12, 14), (58, 60)] {
        for mesh in [cylinder(20.0, 40.0, sections), turned(cylinder(20.0, 40.0, sections))] {
            let poses = stable_poses(&mesh);
            assert_eq!(poses.len(), expected, "{sections} sections: {poses:?}");
            assert!((poses.iter().map(|pose| pose.share).sum::<f64>() - 1.0).abs() < 1e-5, "{sections} sections: {poses:?}");
        }
    }
    assert_stands_on_its_two_ends(&cylinder(20.0, 40.0, 62), &Vector3::z(), "62 sections");
}

#[test]
fn a_cone_of_many_sections_stands_on_its_base_alone() {
    let mut cone = cylinder(30.0, 60.0, 720);
    for vertex in cone.vertices_mm.iter_mut().filter(|vertex| vertex.z > 1.0) {
        (vertex.x, vertex.y) = (vertex.x * 1e-4, vertex.y * 1e-4);
    }
    let poses = stable_poses(&cone);
    assert!(poses.len() == 1 && poses[0].down.z < -1.0 + 1e-6, "{poses:?}");
}

#[test]
fn a_table_stands_on_its_legs_though_one_is_short() {
    let leg = |x: f64, y: f64| box_mesh([x, y, 0.0], [x + 6.0, y + 6.0, 40.0]);
    let top = box_mesh([0.0, 0.0, 40.0], [100.0, 60.0, 45.0]);
    let mut table = Mesh::joined(&[top, leg(0.0, 0.0), leg(94.0, 0.0), leg(0.0, 54.0), leg(94.0, 54.0)]);
    for short_mm in [0.0, 0.3] {
        // The first leg's foot: corners 8 to 15 are the leg's, the first four of them below.
        table.vertices_mm[8..12].iter_mut().for_each(|corner| corner.z = short_mm);
        for (mesh, axis) in [(table.clone(), Vector3::z()), (turned(table.clone()), turn() * Vector3::z())] {
            let poses = stable_poses(&mesh);
            let on_legs: Vec<_> = poses.iter().filter(|pose| pose.down.dot(&axis) < -0.9).collect();
            assert!(poses.len() == 6 && on_legs.len() == 1, "{short_mm} mm: {poses:?}");
            // At most as far as a leg that is short by this tilts the table over its width.
            assert!(on_legs[0].down.cross(&axis).norm() < 1e-6 + short_mm / 54.0, "{short_mm} mm: {poses:?}");
        }
    }
}

#[test]
fn a_warped_plate_stands_on_both_faces() {
    let mut plate = box_mesh([0.0; 3], [100.0, 100.0, 1.0]);
    plate.vertices_mm[0].z -= 0.3;
    assert_stands_on_two_faces(&plate, 0.5);
}

fn assert_stands_on_two_faces(mesh: &Mesh, within_deg: f64) {
    let poses = stable_poses(mesh);
    let [one, other] = poses[..] else { panic!("{poses:?}") };
    let are_level = [one, other].iter().all(|pose| pose.down.z.abs() > within_deg.to_radians().cos());
    assert!(are_level && one.down.z * other.down.z < 0.0, "{poses:?}");
}

/// A round underside stands from a radius of twice the height of the centre of mass on.
#[test]
fn a_ball_and_an_egg_of_many_facets_roll_and_a_lens_does_not() {
    assert_eq!(stable_poses(&ellipsoid([20.0, 20.0, 20.0], 1200)), []);
    assert_eq!(stable_poses(&ellipsoid([10.0, 10.0, 15.0], 1200)), []);
    assert_stands_on_two_faces(&ellipsoid([50.0, 50.0, 10.0], 1200), 3.0);
}

#[test]
fn poses_of_one_share_are_in_the_order_of_their_directions() {
    let poses = stable_poses(&box_mesh([0.0; 3], [60.0, 40.0, 20.0]));
    let signs: Vec<_> = poses.iter().map(|pose| pose.down.sum() > 0.0).collect();
    assert_eq!(signs, [false, true, false, true, false, true], "{poses:?}");
    let digits = |pose: &StablePose| <[i64; 3]>::from(pose.down.map(|c| (c * 1e6).round() as i64));
    let cube = stable_poses(&box_mesh([-10.0; 3], [10.0; 3]));
    let directions: Vec<_> = cube.iter().map(|pose| digits(pose).map(|c| c / 1_000_000)).collect();
    assert_eq!(directions, [[0, 0, -1], [0, -1, 0], [-1, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]);
}

#[test]
fn the_work_is_given_up_when_told_so() {
    let ball = ellipsoid([20.0, 20.0, 20.0], 20_000);
    assert_eq!(super::stable_poses(&ball, &Poll::new(&|| true)), Err(Interrupted));
    let looks = std::cell::Cell::new(0);
    let look = || {
        looks.set(looks.get() + 1);
        looks.get() == 12
    };
    // It looks while the hull grows, not before and after that alone.
    assert_eq!(super::stable_poses(&ball, &Poll::new(&look)), Err(Interrupted));
    assert_eq!(looks.get(), 12);
}

/// Faces to stand on do not depend on whether corners near a plane are looked for in boxes or among all.
#[test]
fn corners_far_above_a_plane_do_not_matter() {
    let bodies = [
        ellipsoid([20.0, 20.0, 20.0], 3000),
        ellipsoid([50.0, 50.0, 10.0], 3000),
        ellipsoid([50.0, 30.0, 12.0], 3000),
        turned(cylinder(25.0, 60.0, 900)),
        turned(cylinder(20.0, 40.0, 58)),
        cylinder(60.0, 10.0, 900),
    ];
    let mut stable = 0;
    for body in &bodies {
        let hull = Hull::of(body, &body.aabb(), &Poll::never()).expect("not interrupted").expect("a volume");
        let centre = hull.centre(&Poll::never()).expect("not interrupted");
        let [all, few] = [1, 1000].map(|planes| CornerBlocks::of(&hull.corners, planes));
        for rest in hull.rests(&centre, &Poll::never()).expect("not interrupted") {
            let stands = hull.is_stable(&rest, &centre, &all);
            assert_eq!(hull.is_stable(&rest, &centre, &few), stands, "{:?}", rest.down);
            stable += usize::from(stands);
        }
    }
    assert!(stable > 60, "{stable}");
}

#[test]
fn poses_are_computed_once_for_all_who_share_them() {
    let block = box_mesh([0.0; 3], [60.0, 40.0, 20.0]);
    let (first, other) = (LazyStablePoses::default(), LazyStablePoses::default());
    let clone = first.clone();
    assert!(first.of(&block, &Poll::new(&|| true)).is_err() && !first.are_known(), "what was given up is not known");
    let poses = first.of(&block, &Poll::never()).expect("not interrupted");
    assert_eq!(poses, stable_poses(&block));
    // Nothing is computed: it would be given up.
    let known = clone.of(&block, &Poll::new(&|| true)).expect("known");
    assert!(std::ptr::eq(known, poses));
    other.learn_from(&LazyStablePoses::default());
    assert!(!other.are_known());
    other.learn_from(&first);
    assert_eq!(other.of(&block, &Poll::new(&|| true)), Ok(poses));
}
