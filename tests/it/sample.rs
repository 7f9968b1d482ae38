//! Inputs that more than one topic needs.

use vantage::cell::{DepthSpec, DeviceSpec, PoseSpec, Scanner, ScannerSpec};

/// The nominal rig of the planning method, section 2: cameras at x = ∓101 mm turned 11.5° inwards, projector at the origin.
pub fn nominal_scanner() -> Scanner {
    let half = (11.5f64 / 2.0).to_radians();
    let camera = |x_mm: f64, turn: f64| DeviceSpec {
        scanner_from_device: Some(PoseSpec { translation_mm: [x_mm, 0.0, 0.0], quaternion_xyzw: [0.0, turn.sin(), 0.0, turn.cos()] }),
        width_px: 4000,
        height_px: 3036,
        fx: 6668.0,
        fy: 6668.0,
        cx: 2000.0,
        cy: 1518.0,
        skew: 0.0,
        distortion: [0.0; 5],
        incidence_max_deg: 85.0,
    };
    let projector = DeviceSpec {
        scanner_from_device: Some(PoseSpec::default()),
        width_px: 2000,
        height_px: 2000,
        fx: 3200.0,
        fy: 2000.0 * 480.0 / 190.0,
        cx: 1000.0,
        cy: 1000.0,
        incidence_max_deg: 77.5,
        ..camera(0.0, 0.0)
    };
    let spec = ScannerSpec {
        name: "nominal".into(),
        depth_mm: DepthSpec { near: 410.0, best: 480.0, far: 565.0 },
        left: camera(-101.0, half),
        right: camera(101.0, -half),
        projector,
        board_poses: None,
        mass_kg: 2.7,
        centre_of_mass_mm: [0.0; 3],
        body: Vec::new(),
        practical_volume_mm: [260.0, 165.0, 140.0],
        block_cube_mm: 140.0,
    };
    spec.build().expect("the nominal rig is consistent")
}
