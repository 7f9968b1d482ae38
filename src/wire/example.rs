//! The part and the calibration of the examples in the API document.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use serde_json::{Value, json};

use super::words::rounded_to;
use crate::cell::{Presets, SpecLibrary as _};

/// A tetrahedron of 60 mm as ASCII STL. Uploaded, it gets the id [`super::MeshId::EXAMPLE`].
pub const MESH: &str = "solid tetrahedron
facet normal 0 0 0
outer loop vertex 0 0 0 vertex 0 60 0 vertex 60 0 0 endloop endfacet
facet normal 0 0 0
outer loop vertex 0 0 0 vertex 60 0 0 vertex 0 0 60 endloop endfacet
facet normal 0 0 0
outer loop vertex 0 0 0 vertex 0 0 60 vertex 0 60 0 endloop endfacet
facet normal 0 0 0
outer loop vertex 60 0 0 vertex 0 60 0 vertex 0 0 60 endloop endfacet
endsolid tetrahedron
";

/// SHA-256 of [`MESH`], lower-case hexadecimal.
pub const MESH_SHA256: &str = "77c8fd8828dd0742aaab508caf70daf2fc895085886672ae66f428226f37124d";

/// SHA-256 of [`MESH`] as the value of a `Content-Digest` header (RFC 9530).
pub const MESH_DIGEST: &str = "sha-256=:d8j9iCjdB0Kqq1CMr3Da8vyJUIWIZnKuZvQoIm83Ek0=:";

/// Joints and table angle of the observations of [`calibration`], degrees.
const OBSERVED_DEG: [([f64; 6], f64); 6] = [
    ([0.0, -30.0, 60.0, 0.0, 30.0, 0.0], 0.0),
    ([12.0, -26.0, 58.0, 8.0, 41.0, -22.0], 60.0),
    ([-14.0, -33.0, 66.0, -12.0, 18.0, 27.0], 120.0),
    ([8.0, -22.0, 51.0, 21.0, 24.0, -48.0], 180.0),
    ([-6.0, -37.0, 70.0, -19.0, 44.0, 51.0], 240.0),
    ([3.0, -28.0, 63.0, 15.0, 12.0, 90.0], 300.0),
];

/// Request for a calibration of the preset cell: six observations of a board on its table, made up from the cell's own poses and
/// rounded; `null` without the preset.
#[must_use]
pub fn calibration() -> Value {
    let Some(cell) = Presets.cell("e05-transcan").ok().and_then(|spec| spec.build(&Presets).ok()) else { return Value::Null };
    let plate_from_board = Isometry3::from_parts(
        Translation3::new(-60.0, 40.0, 5.0),
        UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 20_f64.to_radians()),
    );
    let rounded = |value: f64| rounded_to(value, 6);
    let observation = |(number, (joints_deg, angle_deg)): (usize, &([f64; 6], f64))| {
        let base_from_flange = cell.robot.kinematics.base_from_flange(&joints_deg.map(f64::to_radians));
        let base_from_scanner = base_from_flange.isometry() * cell.flange_from_scanner.isometry();
        let turn = Isometry3::rotation(Vector3::z() * angle_deg.to_radians());
        let board = base_from_scanner.inverse() * cell.base_from_table.isometry() * turn * plate_from_board;
        let translation_mm: [f64; 3] = board.translation.vector.map(rounded).into();
        let quaternion_xyzw: [f64; 4] = board.rotation.coords.map(rounded).into();
        json!({
            "id": format!("p{:02}", number + 1),
            "joints_deg": joints_deg,
            "table_angle_deg": angle_deg,
            "cloud_from_board": {"translation_mm": translation_mm, "quaternion_xyzw": quaternion_xyzw},
        })
    };
    let observations: Vec<Value> = OBSERVED_DEG.iter().enumerate().map(observation).collect();
    json!({
        "cell": "e05-transcan",
        "solve": "joint",
        "data": {
            "schema": "vantage.calibration_data/1",
            "cloud_frame": "scanner",
            "temperature_c": 22.0,
            "sigma": {"robot_deg": 0.003, "robot_mm": 0.012, "board_deg": 0.003, "board_mm": 0.012},
            "observations": observations,
        },
    })
}

/// A scan, as text: three points, an example of the form alone.
pub const SCAN: &str = "0.0 0.0 480.0\n1.0 0.0 480.0\n0.0 1.0 480.0\n";

/// SHA-256 of [`SCAN`] as the value of a `Content-Digest` header (RFC 9530).
pub const SCAN_DIGEST: &str = "sha-256=:gGRA36Q8yYk4dZe9BwmH5o5I6yBJfEnesTmgGVq58dc=:";
