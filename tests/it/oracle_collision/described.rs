//! A cell as the oracles are told of it: shapes and where they are mounted, no kinematics of ours.

use nalgebra::Isometry3;
use serde_json::{Value, json};
use vantage::cell::{Body, Cell, Shape};
use vantage::geometry::{Mesh, Part, Pose, Table};

use crate::support::shared;

/// A vendor's model of an arm, and the links of it that are what a robot of ours calls base and flange.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Vendor {
    pub(crate) urdf: &'static str,
    pub(crate) base: &'static str,
    pub(crate) tip: &'static str,
}

/// Half edge and depth of the block that stands for the floor, mm.
const FLOOR_MM: [f64; 2] = [3000.0, 500.0];

fn pose(isometry: &Isometry3<f64>) -> [f64; 7] {
    let (at, turn) = (isometry.translation.vector, isometry.rotation.coords);
    [at.x, at.y, at.z, turn.x, turn.y, turn.z, turn.w]
}

fn surface(mesh: &Mesh) -> Value {
    let vertices: Vec<[f64; 3]> = mesh.vertices_mm.iter().map(|vertex| (*vertex).into()).collect();
    json!({"mesh": {"vertices": vertices, "faces": mesh.faces}})
}

fn shape(shape: &Shape) -> Value {
    match shape {
        Shape::Box { size_mm } => json!({"box": size_mm}),
        Shape::Cylinder { radius_mm, height_mm } => json!({"cylinder": [radius_mm, height_mm]}),
        Shape::Capsule { radius_mm, length_mm } => json!({"capsule": [radius_mm, length_mm]}),
        Shape::Mesh(mesh) => surface(mesh),
    }
}

fn mounted<'a>(bodies: &'a [Body], on: &'a str, owner: Isometry3<f64>) -> impl Iterator<Item = Value> + 'a {
    let told = move |body: &Body| json!({"name": body.name, "on": on, "pose": pose(&(owner * body.owner_from_body)), "shape": shape(&body.shape)});
    bodies.iter().map(told)
}

/// One line: the cell with a part on its plate. The links are the vendor's meshes or, `with_capsules`, the capsules that the
/// planner knows. `None` where there are no data.
pub(crate) fn described(
    cell: &Cell,
    vendor: &Vendor,
    part: Option<(&Mesh, &Pose<Table, Part>)>,
    with_capsules: bool,
) -> Option<String> {
    let urdf = shared(&format!("robots/{}.urdf", vendor.urdf))?;
    let mut bodies: Vec<Value> = mounted(&cell.mount, "flange", Isometry3::identity()).collect();
    bodies.extend(mounted(&cell.scanner_bodies, "flange", *cell.flange_from_scanner.isometry()));
    bodies.extend(mounted(&cell.table_bodies, "table", Isometry3::identity()));
    bodies.extend(mounted(&cell.obstacles, "base", Isometry3::identity()));
    let (radius_mm, height_mm) = (cell.turntable.plate_radius_mm, cell.turntable.plate_thickness_mm);
    let below = pose(&Isometry3::translation(0.0, 0.0, -0.5 * height_mm));
    bodies.push(json!({"name": "plate", "on": "plate", "pose": below, "shape": {"cylinder": [radius_mm, height_mm]}}));
    if let Some(floor_mm) = cell.floor_mm {
        let [half_mm, depth_mm] = FLOOR_MM;
        let below = pose(&Isometry3::translation(0.0, 0.0, floor_mm - 0.5 * depth_mm));
        let size_mm = [2.0 * half_mm, 2.0 * half_mm, depth_mm];
        bodies.push(json!({"name": "floor", "on": "base", "pose": below, "shape": {"box": size_mm}}));
    }
    if let Some((mesh, table_from_part)) = part {
        let at = pose(table_from_part.isometry());
        bodies.push(json!({"name": "part", "on": "plate", "pose": at, "shape": surface(mesh)}));
    }
    let frames = cell.robot.link_frames(&[0.0; 6]);
    let capsule = |link: &vantage::cell::LinkCapsule| {
        let [from, to] = [link.from_mm, link.to_mm].map(|end| <[f64; 3]>::from(frames[link.link] * end));
        json!({"name": link.name, "link": link.link, "from": from, "to": to, "radius": link.radius_mm})
    };
    let capsules = with_capsules.then(|| cell.robot.links.iter().map(capsule).collect::<Vec<_>>());
    let base_from_table = pose(cell.base_from_table.isometry());
    let Vendor { base, tip, .. } = vendor;
    Some(format!(
        "{}\n",
        json!({"urdf": urdf, "base": base, "tip": tip, "capsules": capsules, "base_from_table": base_from_table, "bodies": bodies})
    ))
}
