//! The bodies of a cell at one configuration, as one mesh in the base frame: what a picture of a collision shows. Links of the arm
//! are drawn as their capsules, which is what collisions are tested with first; the floor is a square below the table.

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

use super::ReportSubject;
use crate::cell::{Body, Cell, Configuration, LinkCapsule, Shape};
use crate::geometry::{Base, Mesh, Part, Pose, Table, plate_from_placed};
use crate::planning::context::{Cancelled, Context};
use crate::rendering::{BodyRole, Ink};

/// Names that collisions give to what is not named by a specification.
const PLATE: &str = "turntable plate";
const FLOOR: &str = "floor";
pub(super) const PART: &str = "part";
const FIXTURE: &str = "fixture";
/// Edge and thickness of the floor that is drawn, mm.
const FLOOR_MM: [f64; 2] = [1500.0, 10.0];

/// A body where it is, base frame.
struct PlacedBody {
    name: String,
    surface: Mesh,
}

/// Everything in the cell, joined; an ink for each triangle.
pub(super) struct Assembly {
    /// The mesh, base frame.
    pub(super) mesh: Mesh,
    /// Ink of each triangle.
    pub(super) inks: Vec<Ink>,
    /// Points of the part, of the plate and of what is in the way, or of the robot where that is nothing, base frame.
    pub(super) focus_mm: Vec<Point3<f64>>,
}

/// Place of everything that moves, and what is pointed out.
pub(super) struct Placing<'a> {
    pub(super) table_from_part: &'a Pose<Table, Part>,
    pub(super) configuration: &'a Configuration,
    /// Names of the two bodies in the way.
    pub(super) in_the_way: Option<[&'a str; 2]>,
}

impl Assembly {
    /// The cell with the part in it.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub(super) fn at(
        subject: &ReportSubject<'_>,
        cell: &Cell,
        placing: &Placing<'_>,
        ctx: &Context<'_>,
    ) -> Result<Self, Cancelled> {
        let Placing { table_from_part, configuration, in_the_way } = *placing;
        let role = |name: &str| match in_the_way.and_then(|names| names.iter().position(|known| *known == name)) {
            Some(0) => BodyRole::First,
            Some(_) => BodyRole::Second,
            None if name == PART => BodyRole::Part,
            None => BodyRole::Other,
        };
        let mesh = Mesh { vertices_mm: Vec::new(), faces: Vec::new(), source_face: Vec::new(), groups: Vec::new() };
        let mut assembly = Self { mesh, inks: Vec::new(), focus_mm: Vec::new() };
        for body in bodies(subject, cell, table_from_part, configuration) {
            ctx.check()?;
            let role = role(&body.name);
            let is_named = body.name == PLATE || (role != BodyRole::Other && body.name != FLOOR);
            // At home nothing is in the way: robot and table are shown, and not all that stands around them.
            let is_around = body.name == FLOOR || cell.obstacles.iter().any(|obstacle| obstacle.name == body.name);
            let is_focus = is_named || (in_the_way.is_none() && !is_around);
            assembly.join(body.surface, role, is_focus);
        }
        Ok(assembly)
    }

    fn join(&mut self, surface: Mesh, role: BodyRole, is_focus: bool) {
        if is_focus {
            self.focus_mm.extend(&surface.vertices_mm);
        }
        let first = self.mesh.vertices_mm.len() as u32;
        for (face, corners) in surface.faces.iter().enumerate() {
            // Capsules without length have rings that coincide.
            if surface.face_area_mm2(face) > 0.0 {
                self.mesh.source_face.push(self.mesh.faces.len() as u32);
                self.mesh.faces.push(corners.map(|corner| corner + first));
                self.inks.push(Ink::Body(role));
            }
        }
        self.mesh.vertices_mm.extend(surface.vertices_mm);
    }
}

fn bodies(
    subject: &ReportSubject<'_>,
    cell: &Cell,
    table_from_part: &Pose<Table, Part>,
    configuration: &Configuration,
) -> Vec<PlacedBody> {
    let frames = cell.robot.link_frames(&configuration.joints_rad);
    let base_from_scanner = frames[6] * cell.flange_from_scanner.isometry();
    let base_from_table = *cell.base_from_table.isometry();
    let base_from_plate = *cell.base_from_plate(configuration.table_rad).isometry();
    let base_from_part: Pose<Base, Part> = cell.base_from_plate(configuration.table_rad) * plate_from_placed(table_from_part);
    let identity = Isometry3::identity();
    let links = cell.robot.links.iter().map(|link| placed(&capsule(link), &frames[link.link]));
    let cable = cell.cable.iter().map(|piece| placed(&piece.body, &frames[piece.link]));
    let mount = cell.mount.iter().map(|body| placed(body, &frames[6]));
    let scanner = cell.scanner_bodies.iter().map(|body| placed(body, &base_from_scanner));
    let below = cell.table_bodies.iter().map(|body| placed(body, &base_from_table));
    let floor = cell.floor_mm.map(|height_mm| placed(&floor(cell, height_mm), &identity));
    let around = cell.obstacles.iter().map(|body| placed(body, &identity));
    let held = [(PART, Some(subject.mesh)), (FIXTURE, subject.fixture)].into_iter().filter_map(|(name, mesh)| {
        Some(PlacedBody { name: name.to_owned(), surface: moved(mesh?.clone(), base_from_part.isometry()) })
    });
    let plate = [placed(&plate(cell), &base_from_plate)];
    links.chain(cable).chain(mount).chain(scanner).chain(plate).chain(below).chain(floor).chain(around).chain(held).collect()
}

fn placed(body: &Body, base_from_owner: &Isometry3<f64>) -> PlacedBody {
    PlacedBody { name: body.name.clone(), surface: moved(body.surface(), base_from_owner) }
}

fn moved(mut mesh: Mesh, base_from_mesh: &Isometry3<f64>) -> Mesh {
    mesh.vertices_mm.iter_mut().for_each(|vertex| *vertex = base_from_mesh * *vertex);
    mesh
}

fn capsule(link: &LinkCapsule) -> Body {
    let axis = link.to_mm - link.from_mm;
    // No rotation is found for −z and for no length at all; a capsule is the same either way round.
    let along = UnitQuaternion::rotation_between(&Vector3::z(), &axis).unwrap_or_default();
    let middle = Translation3::from(nalgebra::center(&link.from_mm, &link.to_mm).coords);
    let shape = Shape::Capsule { radius_mm: link.radius_mm, length_mm: axis.norm() };
    Body { name: link.name.clone(), owner_from_body: Isometry3::from_parts(middle, along), shape }
}

fn plate(cell: &Cell) -> Body {
    let height_mm = cell.turntable.plate_thickness_mm;
    let shape = Shape::Cylinder { radius_mm: cell.turntable.plate_radius_mm, height_mm };
    Body { name: PLATE.to_owned(), owner_from_body: Isometry3::translation(0.0, 0.0, -0.5 * height_mm), shape }
}

fn floor(cell: &Cell, height_mm: f64) -> Body {
    let [edge_mm, thickness_mm] = FLOOR_MM;
    let below_table = cell.base_from_table.origin_mm();
    Body {
        name: FLOOR.to_owned(),
        owner_from_body: Isometry3::translation(below_table.x, below_table.y, height_mm - 0.5 * thickness_mm),
        shape: Shape::Box { size_mm: [edge_mm, edge_mm, thickness_mm] },
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicBool, Ordering};

    use super::*;
    use crate::cell::{CollisionScene, Presets, SpecLibrary};
    use crate::planning::context::Silent;
    use crate::planning::resting;
    use crate::testing::box_mesh;
    use crate::wire::echo::Echo;

    #[test]
    fn every_body_that_may_collide_is_drawn_by_its_name_where_it_is() {
        let cell = Presets.cell("e05-transcan").expect("a preset").build(&Presets).expect("a valid preset");
        let mesh = box_mesh([-20.0, -20.0, 0.0], [20.0, 20.0, 40.0]);
        let subject = ReportSubject {
            mesh: &mesh,
            fixture: None,
            part_sha256: "",
            part_name: "box",
            scanner: &cell.scanner,
            cell: Some(&cell),
            echo: &Echo::default(),
            date: None,
            size_warnings: &[],
        };
        let pose = resting(&mesh);
        // Stretched out through the plate: the scene names two bodies that meet there.
        let scene = CollisionScene::new(&cell, &mesh, None, &pose, 5.0);
        let mut into_it = cell.home_rad;
        let met = (0..400).find_map(|step| {
            into_it.joints_rad =
                std::array::from_fn(|joint| cell.home_rad.joints_rad[joint] + 0.01 * f64::from(step) * (joint as f64 - 2.5));
            scene.check(&into_it)
        });
        let met = met.expect("something collides on the way");
        let names: Vec<String> = bodies(&subject, &cell, &pose, &into_it).into_iter().map(|body| body.name).collect();
        assert!(names.contains(&met.a.to_string()) && names.contains(&met.b.to_string()), "{met} in {names:?}");

        let (cancel, in_the_way) = (AtomicBool::new(false), Some([&*met.a, &*met.b]));
        let placing = Placing { table_from_part: &pose, configuration: &into_it, in_the_way };
        let ctx = Context::new(&cancel, &Silent);
        let assembly = Assembly::at(&subject, &cell, &placing, &ctx).expect("not cancelled");
        cancel.store(true, Ordering::Relaxed);
        assert!(Assembly::at(&subject, &cell, &placing, &ctx).is_err(), "cancelled");
        assert_eq!(assembly.mesh.faces.len(), assembly.inks.len());
        let foot_mm = |focus_mm: &[Point3<f64>]| focus_mm.iter().map(|p| p.xy().coords.norm()).fold(f64::INFINITY, f64::min);
        let at_home = Placing { table_from_part: &pose, configuration: &cell.home_rad, in_the_way: None };
        cancel.store(false, Ordering::Relaxed);
        let home = Assembly::at(&subject, &cell, &at_home, &ctx).expect("not cancelled");
        assert!(foot_mm(&home.focus_mm) < 150.0, "the robot's foot is in the picture");
        assert!(home.focus_mm.len() < home.mesh.vertices_mm.len(), "the floor is not");
        for role in [BodyRole::First, BodyRole::Second] {
            assert!(assembly.inks.contains(&Ink::Body(role)), "{role:?} of {met}");
        }
        let top_mm = cell.base_from_table.origin_mm().z + 40.0;
        let highest_mm = bodies(&subject, &cell, &pose, &cell.home_rad)
            .into_iter()
            .filter(|body| body.name == PART)
            .map(|body| body.surface.aabb().max.z)
            .fold(f64::NEG_INFINITY, f64::max);
        assert!((highest_mm - top_mm).abs() < 1e-6, "{highest_mm} of {top_mm}");
    }
}
