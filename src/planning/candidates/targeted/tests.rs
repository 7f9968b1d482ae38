use super::*;
use crate::geometry::Mesh;
use crate::testing::{box_mesh, nominal_scanner};

/// The solver of the nominal rig among `walls`.
fn solver(walls: &RayScene) -> ViewSolver<'_> {
    let scanner = nominal_scanner();
    let devices = scanner.devices.map(|device| (device.scanner_from_device.origin_mm(), 80.0_f64.to_radians().cos()));
    let (best_mm, far_mm) = (scanner.best_mm, scanner.far_mm);
    ViewSolver { occluders: walls, level: SimdLevel::widest(), best_mm, far_mm, devices }
}

/// The wall of a round hole about +z, from z = 0 up.
fn tube(radius_mm: f64, depth_mm: f64) -> Mesh {
    const SIDES: u32 = 64;
    let point = |side: u32, z: f64| {
        let (sin, cos) = (std::f64::consts::TAU * f64::from(side) / f64::from(SIDES)).sin_cos();
        Point3::new(radius_mm * cos, radius_mm * sin, z)
    };
    let vertices_mm = (0..SIDES).flat_map(|side| [point(side, 0.0), point(side, depth_mm)]).collect();
    let faces: Vec<_> = (0..SIDES)
        .flat_map(|side| {
            let (a, b) = (2 * side, 2 * ((side + 1) % SIDES));
            [[a, b, a + 1], [b, b + 1, a + 1]]
        })
        .collect();
    Mesh { vertices_mm, source_face: (0..faces.len() as u32).collect(), faces, groups: Vec::new() }
}

/// A slot about the origin, as deep as its walls are high.
fn slot(half_x_mm: f64, half_y_mm: f64, depth_mm: f64) -> RayScene {
    let (x, y) = (half_x_mm, half_y_mm);
    let wall = |min: [f64; 2], max: [f64; 2]| box_mesh([min[0], min[1], 0.0], [max[0], max[1], depth_mm]);
    let walls = [
        wall([-100.0, y], [100.0, 100.0]),
        wall([-100.0, -100.0], [100.0, -y]),
        wall([x, -y], [100.0, y]),
        wall([-100.0, -y], [-x, y]),
    ];
    RayScene::new(&walls)
}

#[test]
fn from_the_floor_of_a_blind_hole_the_view_is_along_its_axis() {
    for depth_to_diameter in [0.5, 1.0, 2.0] {
        let walls = RayScene::new([&tube(10.0, 20.0 * depth_to_diameter)]);
        let view = solver(&walls).view(&Point3::origin(), &Vector3::z()).expect("open above");
        let off_axis_deg = view.outward.angle(&Vector3::z()).to_degrees();
        assert!(off_axis_deg < 4.0, "{off_axis_deg}° at depth/diameter {depth_to_diameter}");
    }
}

#[test]
fn a_hole_too_deep_for_the_three_lines_has_no_view() {
    // Each camera sees the middle of the floor under 11.9°: three diameters up the line is 12.6 mm off, the wall 10 mm.
    let walls = RayScene::new([&tube(10.0, 60.0)]);
    assert!(solver(&walls).view(&Point3::origin(), &Vector3::z()).is_none());
    assert!(solver(&walls).view(&Point3::origin(), &-Vector3::z()).is_some(), "nothing below");
}

#[test]
fn in_a_slot_the_baseline_lies_along_it() {
    for (half_x_mm, half_y_mm, along) in [(30.0, 6.0, Vector3::x()), (6.0, 30.0, Vector3::y())] {
        let walls = slot(half_x_mm, half_y_mm, 25.0);
        let view = solver(&walls).view(&Point3::origin(), &Vector3::z()).expect("open above");
        assert!(view.outward.z > 4.0_f64.to_radians().cos(), "{view:?}");
        // Rolls are tried 15° apart.
        assert!(view.baseline.angle(&along).cos().abs() > 10.0_f64.to_radians().cos(), "{view:?}");
    }
}

#[test]
fn every_line_of_a_view_is_clear_and_within_the_limits() {
    let walls = slot(20.0, 8.0, 30.0);
    let solver = solver(&walls);
    // Half way up a wall, which faces across the slot.
    let (sample, normal) = (Point3::new(0.0, -8.0, 15.0), Vector3::y());
    let view = solver.view(&sample, &normal).expect("seen from above");
    assert!((view.baseline.dot(&view.outward)).abs() < 1e-12);
    for (centre, (_, min_cos)) in solver.centres_mm(&view).iter().zip(&solver.devices) {
        assert!(!walls.blocked(centre, &(sample + normal * ABOVE_MM), 1.0));
        assert!(normal.dot(&(centre - sample).normalize()) >= min_cos - 1e-12);
    }
}
