//! The bodies of a cell, and what carries each.

use std::sync::Arc;

use nalgebra::{Isometry3, Point3};
use parry3d::math::Pose as ParryPose;

use super::solid::{Solid, Trees, parry_pose};
use crate::cell::body::{Body, LinkBody, Shape};
use crate::cell::layout::Cell;
use crate::cell::robot::LinkCapsule;
use crate::geometry::{Mesh, Part, Pose, Table, plate_from_placed};

/// Half edge and depth of the block that stands for the floor, mm.
const FLOOR_MM: [f64; 2] = [5000.0, 500.0];

/// Last link that a mounted scanner does not touch by construction; the two after it carry the flange.
const LAST_BEFORE_WRIST: usize = 4;

/// Rings that an attached body is held in when the table may turn it as it likes.
const RINGS: usize = 8;

/// The frame that a body moves with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ParentLink {
    /// The body stands still.
    Still,
    /// The turning plate.
    Plate,
    /// Frame 0 to 6 of the arm.
    Link(usize),
}

impl ParentLink {
    /// Number of joints between the foot and this.
    pub(super) fn link(self) -> usize {
        if let Self::Link(link) = self { link } else { 0 }
    }

    /// The robot's foot does not move either.
    pub(super) fn is_still(self) -> bool {
        matches!(self, Self::Still | Self::Link(0))
    }
}

/// One body.
#[derive(Clone, Debug)]
pub(super) struct SceneBody {
    pub(super) name: Arc<str>,
    pub(super) parent: ParentLink,
    /// Pose in the parent's frame (base for what is still), mm.
    pub(super) parent_from_body: Isometry3<f64>,
    pub(super) solid: Solid,
    /// Bodies inside, with their poses in the body's frame: where the body is too close, they decide. Empty where nothing but
    /// the body is known.
    inside: Vec<(ParryPose, Solid)>,
    /// Farthest of its points from the parent's origin; for bodies attached to the plate from the table's axis.
    pub(super) motion_bound_mm: f64,
    /// Is below the part: the part may touch it.
    holds_part: bool,
    /// Is bolted to the flange, not a link of the arm.
    is_load: bool,
}

impl SceneBody {
    fn new(name: &str, parent: ParentLink, parent_from_body: Isometry3<f64>, solid: Solid) -> Self {
        let motion_bound_mm = solid.motion_bound_mm(&parent_from_body, parent == ParentLink::Plate);
        let (name, inside) = (name.into(), Vec::new());
        Self { name, parent, parent_from_body, solid, inside, motion_bound_mm, holds_part: false, is_load: false }
    }

    /// The body elsewhere on its parent.
    pub(super) fn moved(self, after_from_before: &Isometry3<f64>) -> Self {
        let parent_from_body = after_from_before * self.parent_from_body;
        let motion_bound_mm = self.solid.motion_bound_mm(&parent_from_body, self.parent == ParentLink::Plate);
        Self { parent_from_body, motion_bound_mm, ..self }
    }

    fn from_body(body: &Body, parent: ParentLink, parent_from_owner: &Isometry3<f64>, trees: &mut Trees) -> Self {
        Self::new(&body.name, parent, parent_from_owner * body.owner_from_body, Solid::shared(&body.shape, trees))
    }

    fn load(body: &Body, flange_from_owner: &Isometry3<f64>, trees: &mut Trees) -> Self {
        Self { is_load: true, ..Self::from_body(body, ParentLink::Link(6), flange_from_owner, trees) }
    }

    /// Returns true if something else than itself decides.
    pub(super) fn is_envelope(&self) -> bool {
        !self.inside.is_empty()
    }

    /// The solids that decide, placed, the body being at `pose`.
    pub(super) fn placed(&self, pose: &ParryPose) -> impl Iterator<Item = (&Solid, ParryPose)> {
        let own = self.inside.is_empty().then_some((&self.solid, *pose));
        own.into_iter().chain(self.inside.iter().map(move |(body_from_solid, solid)| (solid, *pose * *body_from_solid)))
    }

    /// Returns true if the two can move against each other, without being neighbours in the chain or the part on its table. What
    /// the flange carries may reach back to the link before it.
    pub(super) fn may_meet(&self, other: &Self) -> bool {
        match (self.parent, other.parent) {
            (ParentLink::Link(a), ParentLink::Link(b)) => a.abs_diff(b) > usize::from(self.is_load == other.is_load),
            (ParentLink::Plate, ParentLink::Plate) => false,
            (ParentLink::Plate, ParentLink::Still) => !other.holds_part,
            (ParentLink::Still, ParentLink::Plate) => !self.holds_part,
            (a, b) => !(a.is_still() && b.is_still()),
        }
    }

    /// Cylinders that hold an attached body at every angle of the table.
    pub(super) fn turned_all_around(&self) -> Vec<Self> {
        let rings = self.solid.rings_mm(&self.parent_from_body, RINGS);
        let ring = |([low, high], radius): &([f32; 2], f32)| {
            let [low_mm, high_mm, radius_mm] = [*low, *high, *radius].map(f64::from);
            let shape = Shape::Cylinder { radius_mm, height_mm: high_mm - low_mm };
            let middle = Isometry3::translation(0.0, 0.0, 0.5 * (low_mm + high_mm));
            Self { motion_bound_mm: 0.0, ..Self::new(&self.name, ParentLink::Plate, middle, Solid::from_shape(&shape)) }
        };
        rings.iter().map(ring).collect()
    }

    /// Returns true if it is bolted to the flange: scanner, adapter or what else holds the scanner.
    pub(super) fn is_load(&self) -> bool {
        self.is_load
    }

    /// Returns true if it moves with the arm's foot or one of its links 1 to 4.
    pub(super) fn is_before_wrist(&self) -> bool {
        matches!(self.parent, ParentLink::Link(link) if link <= LAST_BEFORE_WRIST)
    }

    /// Part or fixture.
    pub(super) fn is_attached(&self) -> bool {
        self.parent == ParentLink::Plate && !self.holds_part
    }

    /// Stands still below the part.
    pub(super) fn is_below_part(&self) -> bool {
        self.parent.is_still() && self.holds_part
    }

    /// Stands still, and not below the part.
    pub(super) fn is_around_part(&self) -> bool {
        self.parent.is_still() && !self.holds_part
    }

    /// Returns true if a point of the base frame lies in it; for bodies that do not move.
    pub(super) fn holds(&self, point_mm: &Point3<f64>) -> bool {
        let local = self.parent_from_body.inverse() * point_mm;
        self.solid.holds(&local)
    }
}

/// Everything in the cell, in a fixed order: arm, cable, mount, scanner, table, floor, obstacles.
pub(super) fn assemble(cell: &Cell) -> Vec<SceneBody> {
    let (mut trees, identity) = (Trees::default(), Isometry3::identity());
    let own = |surface: &LinkBody| Solid::shared(&surface.body.shape, &mut trees);
    let solids: Vec<_> = cell.link_surfaces.iter().map(own).collect();
    let surfaces: Vec<_> = cell.link_surfaces.iter().zip(solids).collect();
    let mut bodies: Vec<_> = cell.robot.links.iter().map(|capsule| link_body(capsule, &surfaces)).collect();
    let cable = |piece: &LinkBody| SceneBody::from_body(&piece.body, ParentLink::Link(piece.link), &identity, &mut trees);
    bodies.extend(cell.cable.iter().map(cable));
    bodies.extend(cell.mount.iter().map(|body| SceneBody::load(body, &identity, &mut trees)));
    let flange_from_scanner = cell.flange_from_scanner.isometry();
    bodies.extend(cell.scanner_bodies.iter().map(|body| SceneBody::load(body, flange_from_scanner, &mut trees)));
    bodies.extend(table_bodies(cell, &mut trees));
    bodies.extend(cell.floor_mm.map(floor));
    bodies.extend(cell.obstacles.iter().map(|body| SceneBody::from_body(body, ParentLink::Still, &identity, &mut trees)));
    bodies
}

/// Bodies attached to the plate: part and fixture, unless they are empty.
pub(super) fn attach<'a>(
    meshes: impl Iterator<Item = (&'a str, &'a Mesh)>,
    table_from_part: &Pose<Table, Part>,
) -> impl Iterator<Item = SceneBody> {
    let plate_from_part = plate_from_placed(table_from_part);
    meshes.filter(|(_, mesh)| !mesh.faces.is_empty()).map(move |(name, mesh)| {
        // About its middle before rounding to single precision: files may lie far from their own origin.
        let part_from_body = Isometry3::from(mesh.aabb().centre().coords);
        let solid = Solid::from_mesh(mesh, &part_from_body.inverse());
        SceneBody::new(name, ParentLink::Plate, plate_from_part.isometry() * part_from_body, solid)
    })
}

fn link_body(link: &LinkCapsule, surfaces: &[(&LinkBody, Solid)]) -> SceneBody {
    let Body { owner_from_body: link_from_capsule, shape, .. } = link.body();
    let capsule_from_link = link_from_capsule.inverse();
    // A capsule without a surface in it decides by itself, beside others of its link that have some.
    let own = surfaces.iter().filter(|(surface, _)| surface.link == link.link && surface.is_in_part_of(link));
    let inside = own.map(|(surface, solid)| (parry_pose(&(capsule_from_link * surface.body.owner_from_body)), solid.clone()));
    SceneBody {
        inside: inside.collect(),
        ..SceneBody::new(&link.name, ParentLink::Link(link.link), link_from_capsule, Solid::from_shape(&shape))
    }
}

/// The plate, and what is below it.
fn table_bodies(cell: &Cell, trees: &mut Trees) -> Vec<SceneBody> {
    let base_from_table = cell.base_from_table.isometry();
    let below = cell.table_bodies.iter().map(|body| SceneBody::from_body(body, ParentLink::Still, base_from_table, trees));
    std::iter::once(plate(cell)).chain(below.map(|body| SceneBody { holds_part: true, ..body })).collect()
}

/// The plate of the table. It turns, so nothing may stand in it; it is round, so turning moves no point of it anywhere new.
fn plate(cell: &Cell) -> SceneBody {
    let height_mm = cell.turntable.plate_thickness_mm;
    let shape = Shape::Cylinder { radius_mm: cell.turntable.plate_radius_mm, height_mm };
    let plate_from_body = Isometry3::translation(0.0, 0.0, -0.5 * height_mm);
    let solid = Solid::from_shape(&shape);
    SceneBody {
        motion_bound_mm: 0.0,
        holds_part: true,
        ..SceneBody::new("turntable plate", ParentLink::Plate, plate_from_body, solid)
    }
}

fn floor(height_mm: f64) -> SceneBody {
    let [half_mm, depth_mm] = FLOOR_MM;
    let shape = Shape::Box { size_mm: [2.0 * half_mm, 2.0 * half_mm, depth_mm] };
    let below = Isometry3::translation(0.0, 0.0, height_mm - 0.5 * depth_mm);
    SceneBody { holds_part: true, ..SceneBody::new("floor", ParentLink::Still, below, Solid::from_shape(&shape)) }
}
