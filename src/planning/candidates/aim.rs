//! An aim is a view before it is varied; [`place`] gives its poses: every tilt, roll and stand-off of the job.
//!
//! Table frame. A tilt turns the view about its aim point, F ahead, to the four sides; the scanner is levelled again.

use nalgebra::{Point3, Rotation3, Unit, UnitQuaternion, Vector3};

use super::blocks::PartBlock;
use super::slide::Slide;
use super::{Candidate, Label, Scope};
use crate::geometry::{Pose, ScannerFrame, Table, parallel};
use crate::planning::context::{Cancelled, Context};
use crate::planning::params::{CandidateParams, Standoff};

/// A pose that was generated, and the side it looks at.
pub(super) type Placed = (Pose<Table, ScannerFrame>, Label);

/// Surface whose score decides where a viewpoint comes to rest.
#[derive(Clone, Copy, Debug)]
pub(super) enum SlidesBy {
    /// The viewpoint keeps its place.
    None,
    /// Surface of a block.
    Block(u32),
    /// All of the part.
    Part,
}

/// A view before tilt, roll and stand-off.
#[derive(Clone, Debug)]
pub(super) struct Aim {
    /// The viewpoint, mm.
    pub(super) position_mm: Point3<f64>,
    /// Unit viewing direction.
    pub(super) axis: Vector3<f64>,
    /// Side of the part that it looks at.
    pub(super) label: Label,
    /// Surface by which it slides along its axis.
    pub(super) slides_by: SlidesBy,
    /// The baseline where the strategy has decided it; else it is level, turned by every roll of the job.
    pub(super) baseline: Option<Vector3<f64>>,
}

impl Aim {
    /// Aims from direction `u` of the unit sphere at a block: at this direction times the semi-axes of its stand-off ellipsoid,
    /// towards its centre (thesis §3.1.3).
    pub(super) fn at_block(block: &PartBlock, u: &Vector3<f64>, scope: &Scope<'_>, standoff: Standoff) -> Self {
        let offset = u.component_mul(&semi_axes_mm(block, scope, standoff));
        Self {
            position_mm: block.centre + offset,
            axis: -offset.normalize(),
            label: Label::of_direction(u),
            slides_by: if standoff == Standoff::Centre { SlidesBy::None } else { SlidesBy::Block(block.number) },
            baseline: None,
        }
    }

    /// Aims at the surface point `target_mm` from direction `u` (unit), with the point at F.
    pub(super) fn at_point(target_mm: &Point3<f64>, u: &Vector3<f64>, scope: &Scope<'_>) -> Self {
        let position_mm = target_mm + u * scope.scanner.best_mm;
        Self { position_mm, axis: -u, label: Label::of_direction(u), slides_by: SlidesBy::None, baseline: None }
    }

    /// Turned by `tilt_rad` about the aim point to each of its four sides.
    fn tilted(&self, tilt_rad: f64, best_mm: f64) -> [Self; 4] {
        let aimed_at = self.position_mm + self.axis * best_mm;
        let upright = looking_along(&self.axis, 0.0);
        [Vector3::x(), -Vector3::x(), Vector3::y(), -Vector3::y()].map(|side| {
            let turn = UnitQuaternion::from_axis_angle(&Unit::new_normalize(upright * side), tilt_rad);
            let axis = turn * self.axis;
            let baseline = self.baseline.map(|baseline| turn * baseline);
            Self {
                position_mm: aimed_at - axis * best_mm,
                axis,
                label: Label::of_direction(&-axis),
                slides_by: self.slides_by,
                baseline,
            }
        })
    }

    /// Orientations of the view: the baseline that was decided, or every roll.
    fn orientations(&self, rolls_deg: &[f64]) -> Vec<UnitQuaternion<f64>> {
        match &self.baseline {
            Some(baseline) => vec![facing(&self.axis, baseline)],
            None => rolls_deg.iter().map(|roll_deg| looking_along(&self.axis, roll_deg.to_radians())).collect(),
        }
    }
}

/// Angles by which views are turned that are looked for beside others: about a third and two thirds of the distance between even
/// directions all around a part of one block (16° to 17°). Over the cap above the plate these are 11° to 12° apart.
pub(super) const BESIDE_RAD: [f64; 2] = [6.0_f64.to_radians(), 12.0_f64.to_radians()];

/// Aims beside a view: turned to its four sides about the point at F ahead, with its own baseline.
pub(super) fn beside(scope: &Scope<'_>, view: &Candidate) -> impl Iterator<Item = Aim> {
    let (table_from_scanner, best_mm) = (scope.table_from_part * view.part_from_scanner, scope.scanner.best_mm);
    let aim = Aim {
        position_mm: table_from_scanner.origin_mm(),
        axis: table_from_scanner.direction(&Vector3::z()),
        label: view.label,
        slides_by: SlidesBy::None,
        baseline: Some(table_from_scanner.direction(&Vector3::x())),
    };
    BESIDE_RAD.into_iter().flat_map(move |tilt_rad| aim.tilted(tilt_rad, best_mm))
}

/// Half extent of the block plus F, or F alone.
pub(super) fn semi_axes_mm(block: &PartBlock, scope: &Scope<'_>, standoff: Standoff) -> Vector3<f64> {
    match standoff {
        Standoff::Centre => Vector3::from_element(scope.scanner.best_mm),
        Standoff::Surface | Standoff::FirstSurface => block.half_extent.add_scalar(scope.scanner.best_mm),
    }
}

/// Poses of an aim at most.
pub(super) fn views_of_an_aim(params: &CandidateParams) -> usize {
    (1 + 4 * params.tilts_deg.len()) * params.rolls_deg.len() * params.standoffs_mm.len()
}

/// Turns aims into poses: for each the untilted view, then every tilt; of each every roll, and every stand-off of that.
pub(super) fn place(
    scope: &Scope<'_>,
    aims: &[Aim],
    params: &CandidateParams,
    ctx: &Context<'_>,
) -> Result<Vec<Placed>, Cancelled> {
    let (slide, best_mm) = (Slide::new(scope, params, ctx.simd_level()), scope.scanner.best_mm);
    let poses_of = |aim: &Aim| {
        ctx.check()?;
        let tilted = params.tilts_deg.iter().flat_map(|tilt_deg| aim.tilted(tilt_deg.to_radians(), best_mm));
        let mut placed = Vec::with_capacity(views_of_an_aim(params));
        for view in std::iter::once(aim.clone()).chain(tilted) {
            for orientation in view.orientations(&params.rolls_deg) {
                let position_mm = slide.along_axis(view.position_mm, &orientation, view.slides_by);
                placed.extend(params.standoffs_mm.iter().map(|back_mm| {
                    let position_mm = position_mm - view.axis * *back_mm;
                    (Pose::from_parts(position_mm.coords, orientation), view.label)
                }));
            }
        }
        Ok(placed)
    };
    let poses = parallel::try_map::<_, _, Cancelled>(aims, poses_of)?;
    Ok(poses.into_iter().flatten().collect())
}

/// Orientation of a scanner that looks along `axis` (unit): roll 0 has its baseline level, x = normalize(axis × up);
/// straight up or down x is the table's +x ([`crate::planning::method::candidates`]).
pub(in crate::planning) fn looking_along(axis: &Vector3<f64>, roll_rad: f64) -> UnitQuaternion<f64> {
    /// Sine of the angle to the vertical below which an axis counts as vertical.
    const VERTICAL: f64 = 1e-9;
    let level = axis.cross(&Vector3::z());
    let x = if level.norm() > VERTICAL { level } else { Vector3::x() };
    facing(axis, &x) * UnitQuaternion::from_axis_angle(&Vector3::z_axis(), roll_rad)
}

/// Orientation of a scanner that looks along `axis` (unit), its baseline as near to `baseline` as can be.
fn facing(axis: &Vector3<f64>, baseline: &Vector3<f64>) -> UnitQuaternion<f64> {
    let x = (baseline - axis * axis.dot(baseline)).normalize();
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_basis_unchecked(&[x, axis.cross(&x), *axis]))
}
