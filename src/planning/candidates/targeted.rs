//! Viewpoints for what is still uncovered, each solved from the opening above one open sample.
//!
//! The sky of a sample are the directions from it in which nothing lies within the working depth. Of these the ones remain, with
//! a roll, for which the lines to all three optical centres are clear and within the job's limits of incidence: a cone. The axis
//! is the one in it that is nearest the middle of the sky, and of its rolls the one is taken whose baseline lies along the widest
//! opening. The sample comes to lie at F on the axis, which is not slid.
//!
//! Part frame, mm. Cost: about a thousand rays a sample looked at.

#[cfg(test)]
mod tests;

use nalgebra::{Point3, UnitQuaternion, Vector3};
use std::f64::consts::PI;

use super::aim::{SlidesBy, looking_along};
use super::even::spiral;
use super::spread::widest;
use super::{Aim, Label, Scope};
use crate::cell::{DeviceName, PerDevice};
use crate::geometry::parallel;
use crate::geometry::{RayScene, SimdLevel, sort_descending};
use crate::planning::context::{Cancelled, Context};
use crate::planning::ids::SampleId;

/// Open samples that are looked at.
const MAX_SAMPLES: usize = 1_500;
/// Directions of the sky: 7° apart over a hemisphere.
const SKY: usize = 384;
/// Axes that are tried in the sky, from its middle to its rim.
const AXES: usize = 32;
/// Rolls that are tried, over half a turn: cameras and projector stand nearly in line.
const ROLLS: usize = 12;
/// Steps in which the width of an opening is measured to each side of an axis.
const WIDTH_STEPS: usize = 15;
const WIDTH_STEP_RAD: f64 = PI / 45.0;
/// Height above the surface at which rays begin, mm: clear of the sample's own facet.
const ABOVE_MM: f64 = 0.02;
/// Distance of two views whose axes differ by a radian, mm: about what lies within a third of the field.
const RADIAN_MM: f64 = 90.0;

/// Samples that are left to measure, and the surroundings.
pub struct OpenSamples<'a> {
    /// Samples that are asked for and not measured yet, ascending.
    pub samples: &'a [SampleId],
    /// Surfaces that may lie between, part frame.
    pub occluders: &'a RayScene,
    /// Largest incidence at each device, of the job: limits of regions do not count here.
    pub incidence_max_rad: PerDevice<f64>,
}

pub(super) fn aims(scope: &Scope<'_>, open: &OpenSamples<'_>, max: usize, ctx: &Context<'_>) -> Result<Vec<Aim>, Cancelled> {
    let solver = ViewSolver::new(scope, open, ctx.simd_level());
    let looked_at: Vec<SampleId> =
        open.samples.iter().step_by(open.samples.len().div_ceil(MAX_SAMPLES).max(1)).copied().collect();
    let view = |sample: &SampleId| {
        ctx.check()?;
        let normal = scope.surface.patch_of(*sample).normal;
        Ok(solver.view(&scope.surface.sample_mm[sample.index()], &normal))
    };
    let views: Vec<Option<TargetedView>> = parallel::try_map::<_, _, Cancelled>(&looked_at, view)?;
    let distance_mm =
        |a: &TargetedView, b: &TargetedView| (a.target_mm - b.target_mm).norm() + RADIAN_MM * (a.outward - b.outward).norm();
    let chosen = widest(views.into_iter().flatten().collect(), max, distance_mm);
    Ok(chosen.iter().map(|view| view.aim(scope)).collect())
}

/// A view that all three lines of its target are clear for; part frame.
#[derive(Clone, Copy, Debug)]
struct TargetedView {
    target_mm: Point3<f64>,
    /// Unit direction from the target to the viewpoint.
    outward: Vector3<f64>,
    /// Unit, across it.
    baseline: Vector3<f64>,
}

impl TargetedView {
    fn aim(&self, scope: &Scope<'_>) -> Aim {
        let [outward, baseline] = [self.outward, self.baseline].map(|v| scope.table_from_part.direction(&v));
        let position_mm = scope.table_from_part.point(&self.target_mm) + outward * scope.scanner.best_mm;
        Aim {
            position_mm,
            axis: -outward,
            label: Label::of_direction(&outward),
            slides_by: SlidesBy::None,
            baseline: Some(baseline),
        }
    }
}

struct ViewSolver<'a> {
    occluders: &'a RayScene,
    level: SimdLevel,
    best_mm: f64,
    far_mm: f64,
    /// Optical centres in the scanner frame, and the least cosine of their incidence.
    devices: PerDevice<(Point3<f64>, f64)>,
}

impl<'a> ViewSolver<'a> {
    fn new(scope: &Scope<'_>, open: &OpenSamples<'a>, level: SimdLevel) -> Self {
        let scanner = scope.scanner;
        let devices = scanner.devices.zip(open.incidence_max_rad);
        let devices = devices.map(|(device, max_rad)| (device.scanner_from_device.origin_mm(), max_rad.cos()));
        Self { occluders: open.occluders, level, best_mm: scanner.best_mm, far_mm: scanner.far_mm, devices }
    }

    /// The view from as near the middle of the sky as the three lines allow, if there is one.
    fn view(&self, sample_mm: &Point3<f64>, normal: &Vector3<f64>) -> Option<TargetedView> {
        let from_mm = sample_mm + normal * ABOVE_MM;
        let axes = self.axes(&from_mm, normal);
        let tried: Vec<TargetedView> = axes
            .iter()
            .flat_map(|outward| (0..ROLLS).map(|roll| TargetedView::rolled(sample_mm, outward, PI * roll as f64 / ROLLS as f64)))
            .collect();
        let clear = self.clear(&from_mm, normal, &tried);
        let inner = clear.first()?;
        let rolls: Vec<_> = clear.iter().filter(|view| view.outward == inner.outward).collect();
        let widths = self.widths(&from_mm, &rolls);
        let widest = (1..rolls.len()).fold(0, |best, roll| if widths[roll] > widths[best] { roll } else { best });
        Some(*rolls[widest])
    }

    /// Axes under the open sky, its middle first.
    fn axes(&self, from_mm: &Point3<f64>, normal: &Vector3<f64>) -> Vec<Vector3<f64>> {
        let (_, lowest) = self.devices.projector;
        let from_z = UnitQuaternion::rotation_between(&Vector3::z(), normal)
            .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::x_axis(), PI));
        let directions: Vec<_> = spiral(SKY, lowest).map(|direction| from_z * direction).collect();
        let mut sky = self.open(from_mm, &directions);
        let middle = sky.iter().sum::<Vector3<f64>>();
        sort_descending(&mut sky, |direction| direction.dot(&middle));
        let every = sky.len().div_ceil(AXES).max(1);
        middle.try_normalize(f64::MIN_POSITIVE).into_iter().chain(sky.into_iter().step_by(every)).collect()
    }

    /// The `directions` in which nothing lies within the working depth.
    fn open(&self, from_mm: &Point3<f64>, directions: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
        let targets: Vec<_> = directions.iter().map(|direction| from_mm + direction * self.far_mm).collect();
        let hidden = self.hidden(from_mm, &targets);
        directions.iter().zip(hidden).filter(|(_, hidden)| !hidden).map(|(direction, _)| *direction).collect()
    }

    /// The `views` whose three lines are clear and within the limits.
    fn clear(&self, from_mm: &Point3<f64>, normal: &Vector3<f64>, views: &[TargetedView]) -> Vec<TargetedView> {
        let within = |view: &&TargetedView| {
            self.centres_mm(view).iter().zip(&self.devices).all(|(centre, (_, min_cos))| {
                let towards = centre - view.target_mm;
                normal.dot(&towards) >= min_cos * towards.norm()
            })
        };
        let views: Vec<&TargetedView> = views.iter().filter(within).collect();
        let centres: Vec<_> = views.iter().flat_map(|view| self.centres_mm(view)).collect();
        let hidden = self.hidden(from_mm, &centres);
        views
            .into_iter()
            .zip(hidden.chunks(DeviceName::ALL.len()))
            .filter(|(_, hidden)| !hidden.contains(&true))
            .map(|(view, _)| *view)
            .collect()
    }

    /// Steps of the sky that are open in an unbroken run along each view's baseline.
    fn widths(&self, from_mm: &Point3<f64>, views: &[&TargetedView]) -> Vec<usize> {
        let along = |view: &TargetedView, side: f64| {
            let (outward, baseline) = (view.outward, view.baseline * side);
            (1..=WIDTH_STEPS).map(move |step| {
                let (sin, cos) = (WIDTH_STEP_RAD * step as f64).sin_cos();
                from_mm + (outward * cos + baseline * sin) * self.far_mm
            })
        };
        let targets: Vec<_> = views.iter().flat_map(|view| along(view, 1.0).chain(along(view, -1.0))).collect();
        let hidden = self.hidden(from_mm, &targets);
        let run = |side: &[bool]| side.iter().take_while(|hidden| !**hidden).count();
        hidden.chunks(2 * WIDTH_STEPS).map(|sides| sides.chunks(WIDTH_STEPS).map(run).sum()).collect()
    }

    fn centres_mm(&self, view: &TargetedView) -> PerDevice<Point3<f64>> {
        let across = view.baseline.cross(&view.outward);
        let viewpoint_mm = view.target_mm + view.outward * self.best_mm;
        self.devices.map(|(at, _)| viewpoint_mm + view.baseline * at.x + across * at.y - view.outward * at.z)
    }

    fn hidden(&self, from_mm: &Point3<f64>, targets: &[Point3<f64>]) -> Vec<bool> {
        let mut hidden = Vec::new();
        self.occluders.blocked_from(self.level, from_mm, targets, 1.0, &mut hidden);
        hidden
    }
}

impl TargetedView {
    fn rolled(target_mm: &Point3<f64>, outward: &Vector3<f64>, roll_rad: f64) -> Self {
        let baseline = looking_along(&-outward, roll_rad) * Vector3::x();
        Self { target_mm: *target_mm, outward: *outward, baseline }
    }
}
