//! Shapes and hardware that unit tests share.

use nalgebra::Point3;

use crate::cell::{Presets, Scanner, SpecLibrary};
use crate::geometry::Mesh;

/// A closed box of twelve triangles between two corners.
pub(crate) fn box_mesh(min_mm: [f64; 3], max_mm: [f64; 3]) -> Mesh {
    let corner = |i: usize| Point3::from([0, 1, 2].map(|axis| if i >> axis & 1 == 1 { max_mm[axis] } else { min_mm[axis] }));
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let faces: Vec<[u32; 3]> = quads.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).collect();
    Mesh { vertices_mm: (0..8).map(corner).collect(), source_face: (0..faces.len() as u32).collect(), faces, groups: Vec::new() }
}

/// A closed cylinder about z, standing on the origin, of so many plane sides around.
pub(crate) fn cylinder_mesh(radius_mm: f64, height_mm: f64, sides: u32) -> Mesh {
    let corner = |side: u32, z_mm: f64| {
        let angle_rad = std::f64::consts::TAU * f64::from(side) / f64::from(sides);
        Point3::new(radius_mm * angle_rad.cos(), radius_mm * angle_rad.sin(), z_mm)
    };
    let rings = [0.0, height_mm].map(|z_mm| (0..sides).map(move |side| corner(side, z_mm)).collect::<Vec<_>>());
    let mut vertices_mm = rings.concat();
    vertices_mm.extend([Point3::origin(), Point3::new(0.0, 0.0, height_mm)]);
    let [below, above] = [2 * sides, 2 * sides + 1];
    let around = (0..sides).flat_map(|side| {
        let (next, up) = ((side + 1) % sides, sides);
        [[side, next, next + up], [side, next + up, side + up], [below, next, side], [above, side + up, next + up]]
    });
    let faces: Vec<[u32; 3]> = around.collect();
    Mesh { vertices_mm, source_face: (0..faces.len() as u32).collect(), faces, groups: Vec::new() }
}

/// A trough on a plate, 30 mm wide and 60 mm deep, open along x and to the top: three boxes that touch.
pub(crate) fn trough() -> Mesh {
    let boxes = [
        box_mesh([-100.0, -60.0, 0.0], [100.0, 60.0, 10.0]),
        box_mesh([-100.0, -30.0, 10.0], [100.0, -15.0, 70.0]),
        box_mesh([-100.0, 15.0, 10.0], [100.0, 30.0, 70.0]),
    ];
    let [mut all, others @ ..] = boxes;
    for other in others {
        let first = all.vertices_mm.len() as u32;
        all.faces.extend(other.faces.iter().map(|face| face.map(|corner| corner + first)));
        all.vertices_mm.extend(other.vertices_mm);
    }
    all.source_face = (0..all.faces.len() as u32).collect();
    all
}

/// The nominal rig of [`crate::planning::method::scanner`].
pub(crate) fn nominal_scanner() -> Scanner {
    Presets.scanner("transcan-c-nominal").ok().and_then(|spec| spec.build().ok()).unwrap_or_else(|| unreachable!("a preset"))
}

/// A URDF of an arm of six joints like an Elfin, 1 m of it, with cylinders for links and a fixed flange.
pub(crate) fn arm_urdf(last_kind: &str) -> String {
    let mut text = String::from("<robot name=\"six\"><link name=\"world\"/><link name=\"base_link\"/>");
    text +=
        "<joint name=\"stand\" type=\"fixed\"><parent link=\"world\"/><child link=\"base_link\"/><origin xyz=\"0 0 1\"/></joint>";
    let rows = [
        ("0 0 0.1", "0 0 1"),
        ("0 0 0.12", "0 1 0"),
        ("0 0 0.38", "0 1 0"),
        ("0 0 0.2", "0 0 1"),
        ("0 0 0.22", "0 1 0"),
        ("0 0 0.05", "0 0 1"),
    ];
    for (number, (origin, axis)) in rows.iter().enumerate() {
        let parent = if number == 0 { "base_link".to_owned() } else { format!("link_{number}") };
        let (name, kind) = (format!("link_{}", number + 1), if number == 5 { last_kind } else { "revolute" });
        text += &format!(
            "<link name=\"{name}\"><collision><origin xyz=\"0 0 0.05\"/><geometry><cylinder radius=\"0.04\" length=\"0.1\"/></geometry></collision></link>\
             <joint name=\"joint_{0}\" type=\"{kind}\"><parent link=\"{parent}\"/><child link=\"{name}\"/><origin xyz=\"{origin}\"/>\
             <axis xyz=\"{axis}\"/><limit lower=\"-2\" upper=\"2.5\" velocity=\"1.5\" effort=\"0\"/></joint>",
            number + 1
        );
    }
    text + "<link name=\"tool0\"/><joint name=\"end\" type=\"fixed\"><parent link=\"link_6\"/><child link=\"tool0\"/><origin xyz=\"0 0 0.03\"/></joint></robot>"
}
