//! Patches to viewpoints (method §3): which directions are considered, how far the scanner stands, how it rolls, and
//! which viewpoints are dropped before anything is computed for them.
//!
//! Frames: everything is generated in `table` (the part as placed, +z up) and handed on as `part_from_scanner`.

mod blocks;
mod ellipsoid;
mod slide;
#[cfg(test)]
mod tests;

use std::sync::OnceLock;

use nalgebra::{Point3, Rotation3, UnitQuaternion, Vector3};
use rayon::prelude::*;

use super::context::{Cancelled, Context};
use super::error::PlanError;
use super::params::{CandidateParams, Hemisphere, Standoff, Strategy};
use super::surface::Surface;
use crate::cell::Scanner;
use crate::geometry::{Aabb, Mesh, Part, Pose, RayScene, Scanner as ScannerFrame, Table};

/// Dense number of a candidate, as generated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct CandidateId(pub u32);

/// Which side of the part a viewpoint looks at (method §3).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Label {
    /// Polar angle up to 60°.
    Top,
    /// Polar angle from 150°.
    Bottom,
    /// Azimuth sector around +x.
    Right,
    /// Azimuth sector around +y.
    Back,
    /// Azimuth sector around −x.
    Left,
    /// Azimuth sector around −y.
    Front,
}

impl Label {
    /// Name in files and answers.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Top => "top",
            Self::Bottom => "bottom",
            Self::Right => "right",
            Self::Back => "back",
            Self::Left => "left",
            Self::Front => "front",
        }
    }

    /// The side that a viewpoint in direction `u` from its block looks at; `u` in the table frame. Sector borders
    /// belong to the sector that starts there, counter-clockwise.
    #[must_use]
    pub fn of_direction(u: &Vector3<f64>) -> Self {
        const TOP_FROM_COS: f64 = 0.5;
        const BOTTOM_TO_COS: f64 = -0.866_025_403_784_438_6;
        // One part in 10⁹ of slack keeps grid directions at exactly 60° and 150° on their side of the border.
        const SLACK: f64 = 1e-9;
        let cos = u.z / u.norm();
        if cos >= TOP_FROM_COS - SLACK {
            return Self::Top;
        }
        if cos <= BOTTOM_TO_COS + SLACK {
            return Self::Bottom;
        }
        let quarter_turns = (u.y.atan2(u.x) / std::f64::consts::FRAC_PI_2 + 0.5 + SLACK).floor().rem_euclid(4.0);
        match quarter_turns as u8 {
            0 => Self::Right,
            1 => Self::Back,
            2 => Self::Left,
            _ => Self::Front,
        }
    }
}

/// Why a candidate was dropped before selection.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Rejection {
    /// A device or the viewpoint lies below the plate's plane.
    BelowTable,
    /// Inside the part.
    InsidePart,
    /// Inside an obstacle, at every table angle.
    InsideObstacle,
    /// Out of the robot's reach at every table angle.
    Unreachable,
    /// Reached, but something collides at every station.
    Collision,
}

impl Rejection {
    /// Name in files and answers.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::BelowTable => "below_table",
            Self::InsidePart => "inside_part",
            Self::InsideObstacle => "inside_obstacle",
            Self::Unreachable => "unreachable",
            Self::Collision => "collision",
        }
    }
}

/// A viewpoint under consideration.
#[derive(Clone, Debug)]
pub struct Candidate {
    /// Number as generated; ties break by it.
    pub id: CandidateId,
    /// Its pose.
    pub part_from_scanner: Pose<Part, ScannerFrame>,
    /// Which side it looks at.
    pub label: Label,
}

/// A direction from which a block is looked at, before roll and stand-off.
struct Aim {
    /// Centre of the block, table frame, mm.
    centre: Point3<f64>,
    /// Half extent of the block, mm.
    half_extent: Vector3<f64>,
    /// Unit direction on the unit sphere; the viewpoint stands at this direction times the semi-axes.
    direction: Vector3<f64>,
}

impl Aim {
    fn new(block: &blocks::Block, direction: &Vector3<f64>) -> Self {
        Self { centre: block.centre, half_extent: block.half_extent, direction: *direction }
    }
}

/// A pose that was generated, and the side it looks at.
type Placed = (Pose<Table, ScannerFrame>, Label);

/// What the candidates are generated for.
pub struct Scope<'a> {
    /// The samples of the part.
    pub surface: &'a Surface,
    /// The scanner.
    pub scanner: &'a Scanner,
    /// How the part lies.
    pub table_from_part: Pose<Table, Part>,
}

/// Candidates that are kept for visibility, and how many were generated and dropped.
#[derive(Clone, Debug, Default)]
pub struct Generated {
    /// Kept, ascending by id.
    pub kept: Vec<Candidate>,
    /// Number generated.
    pub generated: usize,
    /// Dropped, with the reason.
    pub rejected: Vec<(CandidateId, Rejection)>,
}

/// Most candidates of one job.
const MOST_CANDIDATES: usize = 50_000;
/// Most pairs of candidate and sample: bounds the table of what each measures to 2.2 GB.
const MOST_PAIRS: usize = 1_000_000_000;

/// Generates the candidates of every strategy in `params` and drops those that no cell could use.
///
/// # Errors
/// [`PlanError::Cancelled`]; [`PlanError::BadParams`] when there would be too many.
pub fn generate(scope: &Scope<'_>, params: &CandidateParams, part: &Mesh, ctx: &Context<'_>) -> Result<Generated, PlanError> {
    let part_from_table = scope.table_from_part.inverse();
    let mut placed = Vec::new();
    for strategy in &params.strategies {
        let blocks = blocks::split(scope);
        let directions = match strategy {
            Strategy::Ellipsoid => ellipsoid::directions(params.step_small_deg, params.step_large_deg),
        };
        refuse_too_many(placed.len() + blocks.len() * directions.len() * params.rolls_deg.len(), scope)?;
        let aims: Vec<_> =
            blocks.iter().flat_map(|block| directions.iter().map(|direction| Aim::new(block, direction))).collect();
        placed.extend(place(scope, &aims, params, ctx)?);
    }
    refuse_too_many(placed.len() + params.poses.len(), scope)?;
    placed.extend(params.poses.iter().map(|given| given_pose(scope, &given.pose())));
    let above_only = params.hemisphere == Some(Hemisphere::AboveTable);
    let filter = Filter { scope, above_only, part, aabb: part.aabb(), scene: OnceLock::new() };
    let judged: Vec<_> = placed
        .into_par_iter()
        .enumerate()
        .map(|(number, (table_from_scanner, label))| {
            ctx.check()?;
            let part_from_scanner = part_from_table * table_from_scanner;
            let candidate = Candidate { id: CandidateId(number as u32), part_from_scanner, label };
            Ok((filter.unusable(&candidate, &table_from_scanner), candidate))
        })
        .collect::<Result<_, Cancelled>>()?;
    let mut generated = Generated { generated: judged.len(), ..Generated::default() };
    for (reason, candidate) in judged {
        match reason {
            Some(reason) => generated.rejected.push((candidate.id, reason)),
            None => generated.kept.push(candidate),
        }
    }
    Ok(generated)
}

/// A pose that the job gives.
fn given_pose(scope: &Scope<'_>, part_from_scanner: &Pose<Part, ScannerFrame>) -> Placed {
    let from_centre = part_from_scanner.origin_mm() - scope.surface.centre_mm;
    let label = Label::of_direction(&scope.table_from_part.direction(&from_centre));
    (scope.table_from_part * *part_from_scanner, label)
}

fn refuse_too_many(candidates: usize, scope: &Scope<'_>) -> Result<(), PlanError> {
    let samples = scope.surface.sample_mm.len();
    if candidates <= MOST_CANDIDATES && candidates.saturating_mul(samples) <= MOST_PAIRS {
        return Ok(());
    }
    let detail = format!(
        "and its steps and rolls give {candidates} candidates for {samples} samples; allowed are {MOST_CANDIDATES} candidates \
         and {MOST_PAIRS} pairs: take larger steps, fewer samples (part.samples_per_mm2), or look at the part's unit"
    );
    Err(PlanError::param("/candidates/strategies", detail))
}

/// Turns aims into poses: every roll, at the stand-off asked for.
fn place(scope: &Scope<'_>, aims: &[Aim], params: &CandidateParams, ctx: &Context<'_>) -> Result<Vec<Placed>, Cancelled> {
    let slide = slide::Slide::new(scope);
    let poses: Vec<Vec<_>> = aims
        .par_iter()
        .map(|aim| {
            ctx.check()?;
            let label = Label::of_direction(&aim.direction);
            let semi_axes = match params.standoff {
                Standoff::Centre => Vector3::from_element(scope.scanner.best_mm),
                Standoff::Surface => aim.half_extent.add_scalar(scope.scanner.best_mm),
            };
            let offset = aim.direction.component_mul(&semi_axes);
            let pose = |roll_deg: &f64| {
                let orientation = looking_along(&-offset.normalize(), roll_deg.to_radians());
                let position = match params.standoff {
                    Standoff::Centre => aim.centre + offset,
                    Standoff::Surface => slide.along_axis(aim.centre + offset, &orientation),
                };
                (Pose::from_parts(position.coords, orientation), label)
            };
            Ok(params.rolls_deg.iter().map(pose).collect())
        })
        .collect::<Result<_, Cancelled>>()?;
    Ok(poses.into_iter().flatten().collect())
}

/// Orientation of a scanner that looks along `axis` (unit): roll 0 has its baseline level, x = normalize(axis × up);
/// straight up or down x is the table's +x (method §3).
fn looking_along(axis: &Vector3<f64>, roll_rad: f64) -> UnitQuaternion<f64> {
    /// Sine of the angle to the vertical below which an axis counts as vertical.
    const VERTICAL: f64 = 1e-9;
    let level = axis.cross(&Vector3::z());
    let x = if level.norm() > VERTICAL { level.normalize() } else { Vector3::x() };
    let axes = Rotation3::from_basis_unchecked(&[x, axis.cross(&x), *axis]);
    UnitQuaternion::from_rotation_matrix(&axes) * UnitQuaternion::from_axis_angle(&Vector3::z_axis(), roll_rad)
}

/// What every candidate is held against.
struct Filter<'a> {
    scope: &'a Scope<'a>,
    above_only: bool,
    part: &'a Mesh,
    aabb: Aabb,
    /// The part alone, made when the first viewpoint lies in its box: rare for parts smaller than the stand-off.
    scene: OnceLock<RayScene>,
}

impl Filter<'_> {
    fn unusable(&self, candidate: &Candidate, table_from_scanner: &Pose<Table, ScannerFrame>) -> Option<Rejection> {
        let optical_centres = self.scope.scanner.devices.iter().map(|device| device.scanner_from_device.origin_mm());
        let below = |centre: Point3<f64>| table_from_scanner.point(&centre).z <= 0.0;
        if self.above_only && optical_centres.chain([Point3::origin()]).any(below) {
            return Some(Rejection::BelowTable);
        }
        let viewpoint = candidate.part_from_scanner.origin_mm();
        let encloses = || self.scene.get_or_init(|| RayScene::new([self.part])).encloses(&viewpoint);
        (self.aabb.holds(&viewpoint) && encloses()).then_some(Rejection::InsidePart)
    }
}
