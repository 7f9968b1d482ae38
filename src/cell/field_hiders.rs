//! Bodies that stand between the scanner's devices and its field: what the flange carries, and the end of the arm behind it. They move
//! with the scanner, so what they hide is hidden in every view; they are tested once for a cell
//! ([`crate::planning::method::visibility`]).
//!
//! Millimetres. Cost: a millisecond where boxes show that nothing comes near; else 4000 rays for each body of mount, scanner and link 6,
//! and 100 000 for each of link 5, which is looked at with joint 6 at 25 angles.

use std::f64::consts::TAU;

use nalgebra::{Isometry3, Point3};

use super::body::Body;
use super::layout::Cell;
use super::robot::LinkCapsule;
use super::scanner::{DeviceName, Field, OpticalDevice, PerDevice, Scanner};
use crate::geometry::{Aabb, RayScene};

/// Points along each side of a field. Our choice.
const GRID: usize = 21;
/// Steps between the angles of joint 6, over a turn or what its limits allow of one. Our choice.
const TURN_STEPS: u32 = 24;
/// Distance from an optical centre within which nothing hides, mm: the front of a housing may lie there. Our choice.
const CLOSE_MM: f64 = 1.0;
/// Share of a field up to which nothing is told: two points of the grid. Our choice.
const MIN_SHARE: f64 = 0.005;
/// Last link before the flange: where it is, seen from the flange, joint 6 alone decides.
const WRIST_LINK: usize = 5;

/// Bodies of one place that hide a part of the field of a device.
#[derive(Clone, Debug, PartialEq)]
pub struct FieldHider {
    /// Place of the bodies.
    pub place: HiderPlace,
    /// Names of the bodies.
    pub names: Vec<String>,
    /// Shares that they hide together, by device; devices of which they hide no more than 0.5 % are left out.
    pub shares: Vec<HiddenShare>,
}

/// Place of bodies that may hide the field.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HiderPlace {
    /// Body of the mount, by its number.
    Mount(usize),
    /// Body of the scanner, by its number.
    Scanner(usize),
    /// Links 5 and 6 of the arm.
    Arm,
}

/// Share of a device's field that is hidden.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HiddenShare {
    /// Device.
    pub device: DeviceName,
    /// Depth along +z of the scanner, of nearest, best and farthest, at which most is hidden, mm.
    pub depth_mm: f64,
    /// Smallest share there, over the angles of joint 6.
    pub min: f64,
    /// Largest share there.
    pub max: f64,
}

/// Lines from the optical centre of a device to the points of the common field at one depth, scanner frame.
struct Lines {
    device: DeviceName,
    depth_mm: f64,
    centre_mm: Point3<f64>,
    points_mm: Vec<Point3<f64>>,
}

/// A body that may come between.
struct Occluder {
    name: String,
    /// Surface, in the frame of what carries it.
    surface: RayScene,
    /// The scanner in that frame, at each angle of joint 6, or once for all of them; none where boxes are apart.
    owner_from_scanner: Vec<Option<Isometry3<f64>>>,
    /// True for devices that look out of it: the scanner's own housing.
    is_housing_of: PerDevice<bool>,
}

impl Cell {
    /// Bodies that hide more than 0.5 % of the field of a device in views, as they move with the scanner: those of the mount, those of
    /// the scanner, and links 5 and 6 of the arm. A body of the scanner, or of the mount if the scanner has none, that holds an optical
    /// centre is its housing, and hides nothing of that device's field.
    #[must_use]
    pub fn field_hiders(&self) -> Vec<FieldHider> {
        let lines = lines_to_field(&self.scanner);
        let (flange, scanner) = ([*self.flange_from_scanner.isometry()], [Isometry3::identity()]);
        let on_mount = self.mount.iter().enumerate().filter_map(|(index, body)| {
            let occluder = Occluder::new(body, &flange, &lines)?;
            // Whoever gives the scanner no body may have its housing on the mount.
            let occluder = if self.scanner_bodies.is_empty() { occluder.looked_out_of(&self.scanner) } else { occluder };
            hider(HiderPlace::Mount(index), &[occluder], &lines)
        });
        let of_scanner = self.scanner_bodies.iter().enumerate().filter_map(|(index, body)| {
            let occluder = Occluder::new(body, &scanner, &lines)?.looked_out_of(&self.scanner);
            hider(HiderPlace::Scanner(index), &[occluder], &lines)
        });
        let mut hiders: Vec<FieldHider> = on_mount.chain(of_scanner).collect();
        hiders.extend(hider(HiderPlace::Arm, &self.end_of_arm(&lines), &lines));
        hiders
    }

    /// Links 5 and 6: their surfaces, and the capsules in which no surface is known.
    fn end_of_arm(&self, lines: &[Lines]) -> Vec<Occluder> {
        let flange = [*self.flange_from_scanner.isometry()];
        let turned = self.wrist_from_scanner();
        let frames = |link: usize| if link == WRIST_LINK { &turned[..] } else { &flange[..] };
        let surfaces = || self.link_surfaces.iter().filter(|surface| surface.link >= WRIST_LINK);
        let is_bare = |capsule: &LinkCapsule| !surfaces().any(|own| own.link == capsule.link && own.is_in_part_of(capsule));
        let bare = self.robot.links.iter().filter(|capsule| capsule.link >= WRIST_LINK && is_bare(capsule));
        let known = surfaces().filter_map(|surface| Occluder::new(&surface.body, frames(surface.link), lines));
        known.chain(bare.filter_map(|capsule| Occluder::new(&capsule.body(), frames(capsule.link), lines))).collect()
    }

    /// The scanner as link 5 has it, at each angle of joint 6 that is looked at.
    fn wrist_from_scanner(&self) -> Vec<Isometry3<f64>> {
        let [.., joint] = &self.robot.joints;
        let span_rad = (joint.max_rad - joint.min_rad).min(TAU);
        let at = |step: u32| {
            let angle_rad = joint.min_rad + span_rad * f64::from(step) / f64::from(TURN_STEPS);
            let [.., wrist, flange] = self.robot.link_frames(&[0.0, 0.0, 0.0, 0.0, 0.0, angle_rad]);
            wrist.inverse() * flange * self.flange_from_scanner.isometry()
        };
        (0..=TURN_STEPS).map(at).collect()
    }
}

impl Occluder {
    /// A body in the frame in which `owner_from_scanner` has the scanner; `None` if the boxes around it and the lines are always apart.
    fn new(body: &Body, owner_from_scanner: &[Isometry3<f64>], lines: &[Lines]) -> Option<Self> {
        let (corners_mm, in_scanner) = (body.corners_mm(), aabb_of_lines(&Isometry3::identity(), lines));
        let body_aabb = Aabb::around(&corners_mm);
        // Along the axes of either frame: the boxes of one may overlap where those of the other are apart.
        let near = |frame: &Isometry3<f64>| {
            let seen_mm: Vec<_> = corners_mm.iter().map(|corner| frame.inverse() * corner).collect();
            let is_near = overlap(&in_scanner, &Aabb::around(&seen_mm)) && overlap(&aabb_of_lines(frame, lines), &body_aabb);
            is_near.then_some(*frame)
        };
        let owner_from_scanner: Vec<_> = owner_from_scanner.iter().map(near).collect();
        owner_from_scanner.iter().any(Option::is_some).then(|| Self {
            name: body.name.clone(),
            surface: RayScene::new([&body.surface()]),
            owner_from_scanner,
            is_housing_of: PerDevice::default(),
        })
    }

    /// The body as one that devices may look out of.
    fn looked_out_of(self, scanner: &Scanner) -> Self {
        let frame = self.owner_from_scanner.first().copied().flatten();
        let holds = |centre_mm| frame.is_some_and(|owner_from_scanner| self.surface.encloses(&(owner_from_scanner * centre_mm)));
        let is_housing_of = scanner.devices.as_ref().map(|device| holds(device.scanner_from_device.origin_mm()));
        Self { is_housing_of, ..self }
    }

    /// Points that it hides of those at the end of `lines`: at each angle of joint 6, or once for all of them.
    fn hidden(&self, lines: &Lines) -> Vec<Vec<bool>> {
        let at_angle = |frame: &Option<Isometry3<f64>>| {
            let Some(owner_from_scanner) = frame.filter(|_| !self.is_housing_of[lines.device]) else {
                return vec![false; lines.points_mm.len()];
            };
            let is_hidden = |point_mm: &Point3<f64>| {
                let ahead_mm = (point_mm - lines.centre_mm).normalize() * CLOSE_MM;
                let [from_mm, to_mm] = [lines.centre_mm + ahead_mm, *point_mm].map(|end_mm| owner_from_scanner * end_mm);
                self.surface.blocked(&from_mm, &to_mm, 1.0)
            };
            lines.points_mm.iter().map(is_hidden).collect()
        };
        self.owner_from_scanner.iter().map(at_angle).collect()
    }
}

/// Bodies of one place, if they hide more than is left untold.
fn hider(place: HiderPlace, occluders: &[Occluder], lines: &[Lines]) -> Option<FieldHider> {
    let angles = occluders.iter().map(|occluder| occluder.owner_from_scanner.len()).max()?;
    let mut is_met = vec![false; occluders.len()];
    let mut shares: Vec<HiddenShare> = Vec::new();
    for field in lines {
        let hidden: Vec<_> = occluders.iter().map(|occluder| occluder.hidden(field)).collect();
        let hides_any = |at_angles: &Vec<Vec<bool>>| at_angles.iter().flatten().any(|is_hidden| *is_hidden);
        is_met.iter_mut().zip(&hidden).for_each(|(is_met, at_angles)| *is_met |= hides_any(at_angles));
        let at_angle = |angle| hidden_share(field.points_mm.len(), &hidden, angle);
        let (min, max) = (0..angles).map(at_angle).fold((1.0_f64, 0.0_f64), |(min, max), share| (min.min(share), max.max(share)));
        let found = HiddenShare { device: field.device, depth_mm: field.depth_mm, min, max };
        match shares.iter_mut().find(|known| known.device == found.device) {
            Some(known) if found.max > known.max => *known = found,
            Some(_) => {}
            None => shares.push(found),
        }
    }
    shares.retain(|share| share.max > MIN_SHARE);
    let mut names: Vec<String> = Vec::new();
    for (occluder, _) in occluders.iter().zip(is_met).filter(|(_, is_met)| *is_met) {
        if !names.contains(&occluder.name) {
            names.push(occluder.name.clone());
        }
    }
    (!shares.is_empty()).then_some(FieldHider { place, names, shares })
}

/// Share of the points that one of the bodies hides, joint 6 being at one of its angles; `hidden` are those of each body
/// ([`Occluder::hidden`]).
fn hidden_share(points: usize, hidden: &[Vec<Vec<bool>>], angle: usize) -> f64 {
    let here: Vec<&Vec<bool>> = hidden.iter().filter_map(|at_angles| at_angles.get(angle).or(at_angles.first())).collect();
    let is_hidden = |point: &usize| here.iter().any(|of_body| of_body[*point]);
    (0..points).filter(is_hidden).count() as f64 / points.max(1) as f64
}

/// Lines from each device to the common field at each depth, the best one first.
fn lines_to_field(scanner: &Scanner) -> Vec<Lines> {
    let depths = [scanner.best_mm, scanner.near_mm, scanner.far_mm].map(|depth_mm| (depth_mm, field_points(scanner, depth_mm)));
    let lines = |device: DeviceName| {
        let centre_mm = scanner.devices[device].scanner_from_device.origin_mm();
        let to = move |(depth_mm, points_mm): &(f64, Vec<Point3<f64>>)| Lines {
            device,
            depth_mm: *depth_mm,
            centre_mm,
            points_mm: points_mm.clone(),
        };
        depths.iter().map(to)
    };
    DeviceName::ALL.into_iter().flat_map(lines).collect()
}

/// Points of a grid over the field at a depth that all devices see.
fn field_points(scanner: &Scanner, depth_mm: f64) -> Vec<Point3<f64>> {
    let Field { x_mm, y_mm } = scanner.common_field_at(depth_mm);
    let along = |[from, to]: [f64; 2], step: usize| from + (to - from) * (step as f64 + 0.5) / GRID as f64;
    let points = (0..GRID * GRID).map(|point| Point3::new(along(x_mm, point % GRID), along(y_mm, point / GRID), depth_mm));
    let is_seen = |point_mm: &Point3<f64>| {
        let is_imaged =
            |device: &OpticalDevice| device.lens.project(&device.scanner_from_device.inverse().point(point_mm)).is_some();
        scanner.devices.iter().all(is_imaged)
    };
    points.filter(is_seen).collect()
}

/// Box around all lines in a frame.
fn aabb_of_lines(frame_from_scanner: &Isometry3<f64>, lines: &[Lines]) -> Aabb {
    let ends = lines.iter().flat_map(|lines| std::iter::once(&lines.centre_mm).chain(&lines.points_mm));
    ends.fold(Aabb::empty(), |aabb, end_mm| aabb.with(&(frame_from_scanner * end_mm)))
}

/// Returns true if two boxes have a point in common.
fn overlap(a: &Aabb, b: &Aabb) -> bool {
    (0..3).all(|axis| a.min[axis] <= b.max[axis] && b.min[axis] <= a.max[axis])
}

#[cfg(test)]
mod tests;
