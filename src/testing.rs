//! Shapes and hardware that unit tests share.

use nalgebra::Point3;

use crate::cell::{DepthSpec, DeviceSpec, PoseSpec, Scanner, ScannerSpec};
use crate::geometry::Mesh;

/// A closed box of twelve triangles between two corners.
pub(crate) fn box_mesh(min_mm: [f64; 3], max_mm: [f64; 3]) -> Mesh {
    let corner = |i: usize| Point3::from([0, 1, 2].map(|axis| if i >> axis & 1 == 1 { max_mm[axis] } else { min_mm[axis] }));
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let faces: Vec<[u32; 3]> = quads.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).collect();
    Mesh { vertices_mm: (0..8).map(corner).collect(), source_face: (0..faces.len() as u32).collect(), faces, groups: Vec::new() }
}

/// The nominal rig of method §2, without a body.
pub(crate) fn nominal_scanner() -> Scanner {
    let half_turn_rad = (11.5_f64 / 2.0).to_radians();
    let camera = |x_mm: f64, sign: f64| DeviceSpec {
        scanner_from_device: Some(PoseSpec {
            translation_mm: [x_mm, 0.0, 0.0],
            quaternion_xyzw: [0.0, sign * half_turn_rad.sin(), 0.0, half_turn_rad.cos()],
        }),
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
        fx: 2000.0 * 480.0 / 300.0,
        fy: 2000.0 * 480.0 / 190.0,
        cx: 1000.0,
        cy: 1000.0,
        incidence_max_deg: 77.5,
        ..camera(0.0, 0.0)
    };
    let spec = ScannerSpec {
        name: "nominal".into(),
        depth_mm: DepthSpec { near: 410.0, best: 480.0, far: 565.0 },
        left: camera(-101.0, 1.0),
        right: camera(101.0, -1.0),
        projector,
        board_poses: None,
        mass_kg: 2.7,
        centre_of_mass_mm: [0.0; 3],
        body: Vec::new(),
        practical_volume_mm: [260.0, 165.0, 140.0],
        block_cube_mm: 140.0,
    };
    spec.build().unwrap_or_else(|errors| panic!("{errors:?}"))
}
