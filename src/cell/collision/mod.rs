//! Collision of anything in the cell, closer than the clearance: the arm's links, the mount and the scanner against the
//! table, the floor, obstacles, the part and its fixture (which turn with the table), and each other.
//!
//! Every body is a convex core (segment, box, cylinder) grown by a radius, or a triangle mesh, so that "closer than" is
//! one test of core distance against radii + margin: bounding boxes first, then GJK (parry3d, single precision,
//! millimetres around the robot's foot; its distances are good to 1e-3 of themselves). Meshes are descended by their box
//! tree with the same test. A check costs a few microseconds while nothing is near. Where the surface of a link is known, its
//! capsules are asked first and the surface confirms.
//!
//! A segment in joint space is proved free, not only sampled: no point of a body moves further than Σ |Δq_i| R_i between
//! two samples, R_i being the farthest distance of the body from axis i, so a sample whose clearance exceeds that vouches for its
//! neighbourhood (conservative advancement; F. Schwarzer, M. Saha and J.-C. Latombe, "Adaptive dynamic collision checking
//! for single and multiple articulated robots in complex environments", IEEE Trans. Robotics 21(3), 2005).

mod pairs;
mod scene_body;
mod separation;
mod solid;

use std::f64::consts::TAU;
use std::fmt;
use std::sync::Arc;

use nalgebra::{Isometry3, Point3};
use parry3d::bounding_volume::{Aabb, BoundingVolume};
use parry3d::math::Pose as ParryPose;

use self::pairs::{BodyPair, TABLE_AXIS, body_pairs};
use self::scene_body::{ParentLink, SceneBody, assemble, attach};
pub use self::separation::{Farthest, QUERY_SHARE, Separation};
use self::solid::{Solid, near, parry_pose};
use super::axis::{Axes, Axis, Configuration};
use super::halton::{PRIMES, halton};
use super::kinematics::Kinematics;
use super::layout::Cell;
use crate::geometry::{Base, Flange, Mesh, Part, Plate, Pose, Table, plate_from_placed};

/// Coarsest step along a segment, radians of any axis.
const STEP_RAD: f64 = 2.0 * std::f64::consts::PI / 180.0;
/// The least clearance that a job may ask for, mm.
pub const MIN_CLEARANCE_MM: f64 = 1.0;
/// Configurations at which a pair must touch to be taken as touching by construction.
const ALLOWED_PAIR_SAMPLES: u32 = 200;
/// A point that is moved less by a turn is on its axis, mm.
const ON_AXIS_MM: f64 = 1e-3;
/// Largest depth of what stands on the plate in what stands below, mm: it may lie on it, as on a floor level with the plate.
const LYING_MM: f64 = 0.5;

/// Two bodies that are closer than they may be.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Contact {
    /// Name of one.
    pub a: Arc<str>,
    /// Name of the other.
    pub b: Arc<str>,
}

impl Contact {
    /// Returns true if one of the two is the part or its fixture.
    #[must_use]
    pub fn is_with_part(&self) -> bool {
        [&self.a, &self.b].into_iter().any(|name| matches!(&**name, "part" | "fixture"))
    }
}

impl fmt::Display for Contact {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} and {}", self.a, self.b)
    }
}

/// Kind of body that turns with the table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MetOnTable {
    /// The plate.
    Plate,
    /// Part or fixture.
    Attached,
}

/// A cell with a part on its table, ready for tests. Holds no state: safe to share between threads.
#[derive(Clone, Debug)]
pub struct CollisionScene {
    kinematics: Kinematics,
    base_from_table: Pose<Base, Table>,
    table_axis: Axis,
    bodies: Vec<SceneBody>,
    pairs: Vec<BodyPair>,
    clearance_mm: f64,
    /// Part of the clearance that the plate may run out by, mm.
    runout_mm: f64,
    /// Pairs that are left out of `pairs` although the arm may drive one body of them into the other.
    untested_load: Vec<Contact>,
}

/// A straight way in joint space.
struct Segment<'a> {
    from: &'a Configuration,
    travel_rad: &'a [f64; 7],
}

impl Segment<'_> {
    /// The configuration at `share` of the way.
    fn at(&self, share: f64) -> Configuration {
        self.from.along(self.travel_rad, share)
    }
}

/// Poses of all bodies at one configuration.
struct Placement {
    poses: Vec<ParryPose>,
    boxes: Vec<Aabb>,
}

impl CollisionScene {
    /// The cell with `part` (and `fixture`, given in the part's frame) on its plate. Nothing may come closer to anything
    /// else than `clearance_mm`, save what is joined or touches by construction, and what cannot come nearer: the plate and what stands still. Builds the box trees: 0.2 s for a million
    /// triangles.
    #[must_use]
    pub fn new(cell: &Cell, part: &Mesh, fixture: Option<&Mesh>, table_from_part: &Pose<Table, Part>, clearance_mm: f64) -> Self {
        Self::without_part(cell, clearance_mm).with_part(part, fixture, table_from_part)
    }

    /// The scene of a cell with nothing on its plate, with `part` and `fixture` put on it: equal to [`CollisionScene::new`] of that
    /// cell, without the work on what the cell itself is made of.
    #[must_use]
    pub fn with_part(&self, part: &Mesh, fixture: Option<&Mesh>, table_from_part: &Pose<Table, Part>) -> Self {
        let mut scene = self.clone();
        let first = scene.bodies.len();
        let attached = std::iter::once(("part", part)).chain(fixture.map(|mesh| ("fixture", mesh)));
        scene.bodies.extend(attach(attached, table_from_part));
        let added = body_pairs(&scene.bodies, first, &scene.kinematics, scene.clearance_mm, SceneBody::may_meet);
        scene.pairs.extend(added);
        scene
    }

    /// The scene with its part and fixture lying as `to` tells, which lie as `from` tells: without building their box trees again.
    #[must_use]
    pub fn with_part_moved(&self, from: &Pose<Table, Part>, to: &Pose<Table, Part>) -> Self {
        let plate_from_before = plate_from_placed(to).isometry() * plate_from_placed(from).isometry().inverse();
        let mut scene = self.clone();
        // What is attached was added last.
        let first = scene.bodies.iter().position(SceneBody::is_attached).unwrap_or(scene.bodies.len());
        let moved: Vec<SceneBody> = scene.bodies.drain(first..).map(|body| body.moved(&plate_from_before)).collect();
        scene.pairs.retain(|pair| pair.a.max(pair.b) < first);
        scene.bodies.extend(moved);
        let added = body_pairs(&scene.bodies, first, &scene.kinematics, scene.clearance_mm, SceneBody::may_meet);
        scene.pairs.extend(added);
        scene
    }

    /// The cell with nothing on its plate.
    #[must_use]
    pub fn without_part(cell: &Cell, clearance_mm: f64) -> Self {
        // Bodies turn about the fixed axis here: what the plate runs out by is kept free beside.
        let runout_mm = cell.turntable.runout_displacement_mm();
        let clearance_mm = clearance_mm + runout_mm;
        let bodies = assemble(cell);
        let pairs = body_pairs(&bodies, 0, &cell.robot.kinematics, clearance_mm, SceneBody::may_meet);
        let mut scene = Self {
            kinematics: cell.robot.kinematics.clone(),
            base_from_table: cell.base_from_table,
            table_axis: cell.turntable.axis,
            bodies,
            pairs,
            clearance_mm,
            runout_mm,
            untested_load: Vec::new(),
        };
        scene.apply_allowed_collision_matrix(cell);
        scene.relax_rotation_symmetric_links();
        scene.relax_pairs_without_motion();
        scene
    }

    /// The scene with part and fixture as wide as they are when the table turns: what is free here is free at every table
    /// angle, save that what the table turns may meet what stands around it.
    #[must_use]
    pub fn at_every_table_angle(&self) -> Self {
        let mut scene = self.clone();
        for attached in (0..self.bodies.len()).filter(|body| self.bodies[*body].is_attached()) {
            let of_attached = |pair: &BodyPair| pair.a == attached || pair.b == attached;
            let moving = |pair: &&BodyPair| !self.bodies[pair.a].parent.is_still() && !self.bodies[pair.b].parent.is_still();
            let own: Vec<BodyPair> = scene.pairs.extract_if(.., |pair| of_attached(pair)).collect();
            for ring in self.bodies[attached].turned_all_around() {
                let place = |body: usize| if body == attached { scene.bodies.len() } else { body };
                scene.pairs.extend(own.iter().filter(moving).map(|pair| {
                    let mut motion_bound_mm = pair.motion_bound_mm;
                    motion_bound_mm[TABLE_AXIS] = 0.0;
                    BodyPair { a: place(pair.a), b: place(pair.b), motion_bound_mm, ..*pair }
                }));
                scene.bodies.push(ring);
            }
        }
        scene
    }

    /// The scene with half of the clearance, beside what the plate runs out by: for poses as they are measured, which are off the
    /// planned ones.
    #[must_use]
    pub fn with_half_clearance(&self) -> Self {
        let mut scene = self.clone();
        let clearance_mm = 0.5 * (self.clearance_mm - self.runout_mm) + self.runout_mm;
        scene.clearance_mm = scene.clearance_mm.min(clearance_mm);
        for pair in &mut scene.pairs {
            pair.clearance_mm = pair.clearance_mm.min(clearance_mm);
        }
        scene
    }

    /// Pairs of a body on links 0 to 4 of the arm (`a`) and one that the flange carries (`b`) that are never tested: they overlap at
    /// every configuration that was tried, and are taken as touching by construction. Links 5 and 6, which a mounted scanner touches
    /// anyway, are left out.
    #[must_use]
    pub fn untested_load(&self) -> &[Contact] {
        &self.untested_load
    }

    /// The clearance that is kept.
    #[cfg(test)]
    pub(super) fn clearance_mm(&self) -> f64 {
        self.clearance_mm
    }

    /// The first pair that is closer than the clearance; `None` when all is clear.
    #[must_use]
    pub fn check(&self, configuration: &Configuration) -> Option<Contact> {
        let placement = self.place(configuration);
        self.pairs.iter().find(|pair| self.is_near(pair, &placement, &[0.0; 7])).map(|pair| self.contact_of(pair))
    }

    /// The first contact of what the flange carries with what the table carries: as close wherever the two go together to take
    /// one view.
    #[must_use]
    pub fn check_view(&self, configuration: &Configuration) -> Option<Contact> {
        let placement = self.place(configuration);
        self.pairs_of_view().find(|pair| self.is_near(pair, &placement, &[0.0; 7])).map(|pair| self.contact_of(pair))
    }

    /// The first that what the flange carries meets of what the table carries, the flange being there over the plate: what
    /// [`CollisionScene::check_view`] finds, without a configuration.
    #[must_use]
    pub fn check_carried(&self, plate_from_flange: &Pose<Plate, Flange>) -> Option<MetOnTable> {
        // Plate coordinates; bodies that are neither held nor turn are in no pair that is looked at.
        let pose = |body: &SceneBody| match body.parent {
            ParentLink::Link(_) => parry_pose(&(plate_from_flange.isometry() * body.parent_from_body)),
            ParentLink::Plate | ParentLink::Still => parry_pose(&body.parent_from_body),
        };
        let placement = self.placed_at(self.bodies.iter().map(pose).collect());
        let met = self.pairs_of_view().find(|pair| self.is_near(pair, &placement, &[0.0; 7]))?;
        let is_attached = self.bodies[met.a].is_attached() || self.bodies[met.b].is_attached();
        Some(if is_attached { MetOnTable::Attached } else { MetOnTable::Plate })
    }

    /// Pairs of what the flange carries and what the table carries.
    fn pairs_of_view(&self) -> impl Iterator<Item = &BodyPair> {
        let is_held = |body: usize| self.bodies[body].parent == ParentLink::Link(6);
        let turns = |body: usize| self.bodies[body].parent == ParentLink::Plate;
        self.pairs.iter().filter(move |pair| is_held(pair.a) && turns(pair.b) || is_held(pair.b) && turns(pair.a))
    }

    /// The first pair found closer than the clearance on the straight segment in joint space, both ends included.
    ///
    /// Samples are at most 2° of any axis apart, and closer where bodies are near each other, until between two of them
    /// nothing can move further than the clearance: so nothing touches anywhere on a segment that is reported free.
    #[must_use]
    pub fn check_segment(&self, from: &Configuration, to: &Configuration) -> Option<Contact> {
        // The same samples whichever way it is run.
        let (from, to) = if from.axes_rad() <= to.axes_rad() { (from, to) } else { (to, from) };
        let steps = (from.max_turn_rad(to) / STEP_RAD).ceil().max(1.0);
        let segment = Segment { from, travel_rad: &from.travel_rad(to) };
        let inside = || self.check_inside(&segment, steps, self.pairs.iter().collect()).err();
        self.check(from).or_else(|| self.check(to)).or_else(inside)
    }

    /// The corner of a straight segment that arm and table move along one after the other, in an order that is free;
    /// `None` where only one of them moves.
    ///
    /// # Errors
    /// The contact where neither order is free.
    pub fn corner_between(&self, from: &Configuration, to: &Configuration) -> Result<Option<Configuration>, Contact> {
        if !(from.turns_table(to) && from.moves_arm(to)) {
            return self.check_segment(from, to).map_or(Ok(None), Err);
        }
        let turned = Configuration { table_rad: to.table_rad, ..*from };
        let moved = Configuration { table_rad: from.table_rad, ..*to };
        let contact = |corner| self.check_segment(from, corner).or_else(|| self.check_segment(corner, to));
        let Some(contact_turned) = contact(&turned) else { return Ok(Some(turned)) };
        if contact(&moved).is_none() { Ok(Some(moved)) } else { Err(contact_turned) }
    }

    /// The first contact of part or fixture, wherever the arm is, as the table turns from one angle to another.
    #[must_use]
    pub fn check_table_rotation(&self, from_rad: f64, to_rad: f64) -> Option<Contact> {
        let [from, to] = [from_rad, to_rad].map(|table_rad| Configuration { joints_rad: [0.0; 6], table_rad });
        let steps = ((to_rad - from_rad).abs() / STEP_RAD).ceil().max(1.0);
        let turns = |body: usize| self.bodies[body].is_attached();
        let still = |body: usize| self.bodies[body].parent.is_still();
        let pairs = self.pairs.iter().filter(|pair| (turns(pair.a) && still(pair.b)) || (turns(pair.b) && still(pair.a)));
        self.check_inside(&Segment { from: &from, travel_rad: &from.travel_rad(&to) }, steps, pairs.collect()).err()
    }

    /// Proves a segment free. Pieces are looked at coarse to fine, all of one length before any shorter one: a contact
    /// mostly shows early. A pair that is far enough apart for its whole piece is done with; for the others the piece is
    /// halved.
    fn check_inside(&self, segment: &Segment<'_>, steps: f64, all: Vec<&BodyPair>) -> Result<(), Contact> {
        let mut pieces: Vec<(f64, Vec<&BodyPair>)> =
            (0..steps as u64).map(|step| ((step as f64 + 0.5) / steps, all.clone())).collect();
        let mut half = 0.5 / steps;
        while !pieces.is_empty() {
            let mut finer = Vec::new();
            for (middle, pairs) in pieces {
                let open = self.check_piece(segment, middle, half, &pairs)?;
                if !open.is_empty() {
                    finer.extend([(middle - 0.5 * half, open.clone()), (middle + 0.5 * half, open)]);
                }
            }
            (pieces, half) = (finer, 0.5 * half);
        }
        Ok(())
    }

    /// The pairs of which the piece `middle ± half` of a segment is not yet proved free, or one that is in contact in
    /// its middle.
    fn check_piece<'a>(
        &'a self,
        segment: &Segment<'_>,
        middle: f64,
        half: f64,
        pairs: &[&'a BodyPair],
    ) -> Result<Vec<&'a BodyPair>, Contact> {
        let sweep_rad = segment.travel_rad.map(|angle| half * angle.abs());
        let placement = self.place(&segment.at(middle));
        let mut open: Vec<&BodyPair> = pairs.iter().filter(|pair| self.is_near(pair, &placement, &sweep_rad)).copied().collect();
        if let Some(pair) = open.iter().find(|pair| self.is_near(pair, &placement, &[0.0; 7])) {
            return Err(self.contact_of(pair));
        }
        open.retain(|pair| pair.motion_mm(&sweep_rad) > self.free_motion_mm(pair));
        Ok(open)
    }

    /// Motion of a pair that may not bring its bodies together from the distance that they keep: less what the plate runs out by.
    fn free_motion_mm(&self, pair: &BodyPair) -> f64 {
        let is_on_plate = [pair.a, pair.b].into_iter().any(|body| self.bodies[body].parent == ParentLink::Plate);
        if is_on_plate && pair.clearance_mm > self.runout_mm { pair.clearance_mm - self.runout_mm } else { pair.clearance_mm }
    }

    /// Returns true if a point lies in a body that does not move (obstacle, table, floor, the robot's foot).
    #[must_use]
    pub fn is_blocked(&self, point_in_base_mm: &Point3<f64>) -> bool {
        self.bodies.iter().any(|body| body.parent.is_still() && body.holds(point_in_base_mm))
    }

    fn place(&self, configuration: &Configuration) -> Placement {
        let frames = self.kinematics.link_frames(&configuration.joints_rad);
        let plate = self.base_from_table * crate::geometry::table_from_plate(configuration.table_rad);
        let pose = |body: &SceneBody| match body.parent {
            ParentLink::Still => parry_pose(&body.parent_from_body),
            ParentLink::Plate => parry_pose(&(plate.isometry() * body.parent_from_body)),
            ParentLink::Link(link) => parry_pose(&(frames[link] * body.parent_from_body)),
        };
        self.placed_at(self.bodies.iter().map(pose).collect())
    }

    fn placed_at(&self, poses: Vec<ParryPose>) -> Placement {
        let boxes = self.bodies.iter().zip(&poses).map(|(body, pose)| body.solid.aabb(pose)).collect();
        Placement { poses, boxes }
    }

    fn contact_of(&self, pair: &BodyPair) -> Contact {
        Contact { a: Arc::clone(&self.bodies[pair.a].name), b: Arc::clone(&self.bodies[pair.b].name) }
    }

    /// Names of a pair of a body on links 0 to 4 and one that the flange carries, in this order; `None` for other pairs.
    fn contact_of_load(&self, pair: &BodyPair) -> Option<Contact> {
        let (a, b) = (&self.bodies[pair.a], &self.bodies[pair.b]);
        let (arm, load) = if a.is_load() { (b, a) } else { (a, b) };
        let is_told = load.is_load() && arm.is_before_wrist();
        is_told.then(|| Contact { a: Arc::clone(&arm.name), b: Arc::clone(&load.name) })
    }

    /// Returns true if the two may come closer than their clearance while every axis moves by up to `sweep_rad`.
    fn is_near(&self, pair: &BodyPair, placement: &Placement, sweep_rad: &[f64; 7]) -> bool {
        self.is_closer(pair, placement, pair.clearance_mm + pair.motion_mm(sweep_rad))
    }

    fn is_closer(&self, pair: &BodyPair, placement: &Placement, distance_mm: f64) -> bool {
        let margin = distance_mm as f32;
        placement.boxes[pair.a].loosened(margin).intersects(&placement.boxes[pair.b])
            && near(
                (&self.bodies[pair.a].solid, &placement.poses[pair.a]),
                (&self.bodies[pair.b].solid, &placement.poses[pair.b]),
                margin,
            )
            && self.is_confirmed(pair, placement, margin)
    }

    /// Confirms nearness by the surfaces inside, where the two bodies only envelop them.
    fn is_confirmed(&self, pair: &BodyPair, placement: &Placement, margin: f32) -> bool {
        let (a, b) = (&self.bodies[pair.a], &self.bodies[pair.b]);
        !(a.is_envelope() || b.is_envelope())
            || a.placed(&placement.poses[pair.a]).any(|(in_a, pose_a)| {
                b.placed(&placement.poses[pair.b]).any(|(in_b, pose_b)| near((in_a, &pose_a), (in_b, &pose_b), margin))
            })
    }

    /// Pairs on the arm that touch at every sampled configuration touch by construction (the wrist inside the flange's
    /// capsule), and say nothing. Those that are merely never as far apart as the clearance must not touch. What stands
    /// around the arm is never excused.
    fn apply_allowed_collision_matrix(&mut self, cell: &Cell) {
        let axes = cell.axes();
        let on_arm = |body: usize| matches!(self.bodies[body].parent, ParentLink::Link(_));
        let mut crowded: Vec<usize> =
            (0..self.pairs.len()).filter(|index| on_arm(self.pairs[*index].a) && on_arm(self.pairs[*index].b)).collect();
        let mut touching = crowded.clone();
        for sample in 1..=ALLOWED_PAIR_SAMPLES {
            let placement = self.place(&spread_configuration(&axes, sample));
            touching.retain(|index| self.is_closer(&self.pairs[*index], &placement, 0.0));
            crowded.retain(|index| self.is_near(&self.pairs[*index], &placement, &[0.0; 7]));
            if crowded.is_empty() {
                return;
            }
        }
        for index in crowded {
            self.pairs[index].clearance_mm = self.clearance_mm.min(MIN_CLEARANCE_MM);
        }
        self.untested_load = touching.iter().filter_map(|index| self.contact_of_load(&self.pairs[*index])).collect();
        let mut index = 0;
        self.pairs.retain(|_| {
            index += 1;
            touching.binary_search(&(index - 1)).is_err()
        });
    }

    /// A capsule around the arm's first axis is as far from what stands still at any configuration: the column above its
    /// pedestal. It must not touch, whatever clearance is asked for. Where surfaces inside decide, they have to be round about
    /// the axis too: others come nearer as it turns.
    fn relax_rotation_symmetric_links(&mut self) {
        let mut quarter = [0.0; 6];
        quarter[0] = std::f64::consts::FRAC_PI_2;
        let frames = [[0.0; 6], quarter].map(|joints| self.kinematics.link_frames(&joints)[1]);
        let is_on_axis = |ends: [Point3<f64>; 2]| {
            let [a, b] = frames.map(|frame| ends.map(|end| frame * end));
            a.iter().zip(&b).all(|(a, b)| (a - b).norm() < ON_AXIS_MM)
        };
        let on_axis = |body: &SceneBody| {
            let ends = body.solid.ends_mm().filter(|_| body.parent == ParentLink::Link(1));
            let link_from_body = parry_pose(&body.parent_from_body);
            let is_round = |(solid, pose): (&Solid, ParryPose)| solid.axis_ends_mm(&pose).is_some_and(is_on_axis);
            ends.is_some_and(|ends| is_on_axis(ends.map(|end| body.parent_from_body * end)))
                && (!body.is_envelope() || body.placed(&link_from_body).all(is_round))
        };
        let (bodies, min_mm) = (&self.bodies, self.clearance_mm.min(MIN_CLEARANCE_MM));
        let keeps_apart = |a: usize, b: usize| bodies[a].parent.is_still() && on_axis(&bodies[b]);
        for pair in self.pairs.iter_mut().filter(|pair| keeps_apart(pair.a, pair.b) || keeps_apart(pair.b, pair.a)) {
            pair.clearance_mm = min_mm;
        }
    }

    /// The plate is as far from what stands still at any configuration: it must not touch, beside what it runs out by, whatever clearance
    /// is asked for.
    fn relax_pairs_without_motion(&mut self) {
        let min_mm = self.clearance_mm.min(MIN_CLEARANCE_MM + self.runout_mm);
        let keep_their_distance = |pair: &&mut BodyPair| pair.motion_bound_mm.iter().all(|bound_mm| *bound_mm <= 0.0);
        self.pairs.iter_mut().filter(keep_their_distance).for_each(|pair| pair.clearance_mm = min_mm);
    }

    /// The contact of part or fixture for which a configuration is not to blame: at some table angle with what stands below
    /// (housing, floor), on which it may lie; and as it is placed, at angle zero, what stands around. Beside the table
    /// other angles are for [`CollisionScene::check`] to judge. The plate is not tested, nor the fixture against the part,
    /// since they hold them.
    #[must_use]
    pub fn placement_contact(&self) -> Option<Contact> {
        if !self.bodies.iter().any(SceneBody::is_attached) {
            return None;
        }
        let mut lifted = self.clone();
        for body in lifted.bodies.iter_mut().filter(|body| body.is_attached()) {
            body.parent_from_body = Isometry3::translation(0.0, 0.0, LYING_MM) * body.parent_from_body;
        }
        let with = |stands: fn(&SceneBody) -> bool| {
            let meet = move |a: &SceneBody, b: &SceneBody| (a.is_attached() && stands(b)) || (b.is_attached() && stands(a));
            let pairs = body_pairs(&lifted.bodies, 0, &lifted.kinematics, 0.5 * LYING_MM, meet);
            Self { pairs, ..lifted.clone() }
        };
        let Axis { min_rad, max_rad, .. } = self.table_axis;
        let turned = |table_rad: f64| Configuration { joints_rad: [0.0; 6], table_rad };
        let below = with(SceneBody::is_below_part).check_segment(&turned(min_rad), &turned(max_rad.min(min_rad + TAU)));
        below.or_else(|| with(SceneBody::is_around_part).check(&turned(0.0_f64.clamp(min_rad, max_rad))))
    }
}

/// One of configurations that are spread evenly over the ranges of all axes; `sample` counts from 1.
fn spread_configuration(axes: &Axes, sample: u32) -> Configuration {
    Configuration::from_axes_rad(std::array::from_fn(|axis| {
        let axis_limits = &axes.0[axis];
        axis_limits.min_rad + (axis_limits.max_rad - axis_limits.min_rad) * halton(sample, PRIMES[axis])
    }))
}

#[cfg(test)]
mod tests;
