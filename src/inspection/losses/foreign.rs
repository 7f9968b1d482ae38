//! Points of a scan that lie in front of the model, where it has nothing: of a body that the plan does not know, or of material that
//! the part has too much of, if the part is within the search distance. What lies behind them on the way to a device is hidden by it.

use nalgebra::{Point3, Vector3};

use super::LossCause;
use crate::cell::PerDevice;
use crate::geometry::{Hit, NearestFace, Part, Pose, ScannerFrame};
use crate::inspection::PixelGrid;
use crate::inspection::coverage::{GriddedCloud, NominalModel};
use crate::planning::context::Context;

/// Distance between the pixels that are looked at.
const STRIDE_PX: f64 = 8.0;
/// Largest number of points that are kept.
const MAX_POINTS: usize = 10_000;
/// Distance of such a point from a line of sight within which the body hides it, as a multiple of the distance between points.
const REACH: f64 = 2.0;
/// Smallest number of such points that makes a body: single ones are mixed pixels.
const MIN_POINTS: usize = 8;
/// Rays around a point's own that look for an edge of the model, and their distance there as a share of the search distance.
const RAYS_AROUND: usize = 8;
const AROUND: f64 = 0.2;

/// Bodies and material in front of the model, as one scan shows them.
pub(super) struct InFront {
    /// Bodies that the plan does not know.
    foreign: Points,
    /// Material of the part.
    material: Points,
    search_mm: f64,
}

/// Points that hide what lies behind them.
struct Points {
    /// Part frame.
    points_mm: Vec<Point3<f64>>,
    reach_mm: f64,
}

impl InFront {
    /// Looks for points more than `search_mm` in front of the model on their own rays. The part itself may be nearer: seen obliquely,
    /// little material stands far before what its ray meets.
    pub(super) fn find(
        cloud: &GriddedCloud<'_>,
        (model, nearest): (&NominalModel<'_>, &NearestFace<'_>),
        pose: &Pose<Part, ScannerFrame>,
        search_mm: f64,
        ctx: &Context<'_>,
    ) -> Self {
        let grid = cloud.grid();
        let stride = (STRIDE_PX / grid.step_px).round().max(1.0) as usize;
        let rows = (0..grid.size.rows).step_by(stride);
        let cells = rows.flat_map(|row| (0..grid.size.columns).step_by(stride).map(move |column| [column, row]));
        let points: Vec<Point3<f64>> = cells.filter_map(|cell| Some(pose.point(&cloud.point(cell)?))).collect();
        let centre_mm = pose.point(&grid.centre_mm());
        // By its own ray: that through the middle of a large cell may meet another level of a step.
        let rays: Vec<Vector3<f64>> = points.iter().map(|point| point - centre_mm).collect();
        let mut hits = Vec::new();
        model.surfaces().first_hits_from(ctx.simd_level(), &centre_mm, &rays, &mut hits);
        let is_in_front =
            |ray: &Vector3<f64>, share: Option<f64>| share.is_none_or(|share| (share - 1.0) * ray.norm() > search_mm);
        let on_rays = points.into_iter().zip(&rays).zip(&hits);
        let in_front: Vec<Point3<f64>> = on_rays
            .filter(|((_, ray), hit)| is_in_front(ray, hit.as_ref().map(|hit| hit.share)))
            .map(|((point, _), _)| point)
            .collect();
        let found = beyond_edges(&in_front, model, &centre_mm, search_mm, ctx);
        let is_of_part = |point: &Point3<f64>| nearest.nearest(point, search_mm).is_some();
        let (material, foreign): (Vec<_>, Vec<_>) = found.into_iter().partition(is_of_part);
        let [foreign, material] = [foreign, material].map(|points_mm| Points::of(points_mm, &centre_mm, stride, grid));
        Self { foreign, material, search_mm }
    }

    /// Cause of the loss of a point of the model between which and one of the devices something lies; `None` where nothing does.
    pub(super) fn hides(&self, point_mm: &Point3<f64>, centres_mm: &PerDevice<Point3<f64>>) -> Option<LossCause> {
        // Surface farther behind the material is where the model has it, and another view may see it.
        let ways = [
            (&self.foreign, f64::INFINITY, LossCause::UnmodelledOccluder),
            (&self.material, self.search_mm, LossCause::PartDeviates),
            (&self.material, f64::INFINITY, LossCause::UnmodelledOccluder),
        ];
        ways.into_iter().find(|(points, within_mm, _)| points.hide(point_mm, centres_mm, *within_mm)).map(|(.., cause)| cause)
    }
}

impl Points {
    /// Some of the points of every so many cells; none of too few.
    fn of(mut points_mm: Vec<Point3<f64>>, centre_mm: &Point3<f64>, stride: usize, grid: &PixelGrid) -> Self {
        if points_mm.len() < MIN_POINTS {
            points_mm.clear();
        }
        let every = points_mm.len().div_ceil(MAX_POINTS).max(1);
        let points_mm: Vec<Point3<f64>> = points_mm.into_iter().step_by(every).collect();
        let depth_mm = points_mm.first().map_or(0.0, |point| (point - centre_mm).norm());
        // f · spacing = stride · z; the square root of `every` makes up for what was left out.
        let spacing_mm = stride as f64 * grid.cell_mm(depth_mm) * (every as f64).sqrt();
        Self { points_mm, reach_mm: REACH * spacing_mm }
    }

    /// Returns true if one of them lies between a point of the model and one of the devices, no farther from that point than `within_mm`.
    fn hide(&self, point_mm: &Point3<f64>, centres_mm: &PerDevice<Point3<f64>>, within_mm: f64) -> bool {
        let crosses = |centre: &Point3<f64>| {
            let (way, squared) = (centre - point_mm, (centre - point_mm).norm_squared());
            self.points_mm.iter().any(|between| {
                let from = between - point_mm;
                let share = from.dot(&way) / squared;
                share > 0.0 && from.norm() <= within_mm && (from - way * share).norm_squared() <= self.reach_mm * self.reach_mm
            })
        };
        !self.points_mm.is_empty() && centres_mm.iter().any(crosses)
    }
}

/// The points beside whose rays no edge of the model lies at their depth or before it. The rays of points on an edge just miss it where
/// pose or noise moves them to its side, and meet what lies far behind.
fn beyond_edges(
    points_mm: &[Point3<f64>],
    model: &NominalModel<'_>,
    centre_mm: &Point3<f64>,
    search_mm: f64,
    ctx: &Context<'_>,
) -> Vec<Point3<f64>> {
    let around = |point: &Point3<f64>| {
        let ray = point - centre_mm;
        let first = ray.cross(&Vector3::ith(ray.iamin(), 1.0)).normalize() * (AROUND * search_mm);
        let second = ray.cross(&first).normalize() * (AROUND * search_mm);
        (0..RAYS_AROUND).map(move |number| {
            let (sin, cos) = (std::f64::consts::TAU * number as f64 / RAYS_AROUND as f64).sin_cos();
            ray + first * cos + second * sin
        })
    };
    let rays: Vec<Vector3<f64>> = points_mm.iter().flat_map(around).collect();
    let mut hits = Vec::new();
    model.surfaces().first_hits_from(ctx.simd_level(), centre_mm, &rays, &mut hits);
    let by_point = rays.chunks(RAYS_AROUND).zip(hits.chunks(RAYS_AROUND));
    let is_beside_edge = |(rays, hits): (&[Vector3<f64>], &[Option<Hit>])| {
        let meets = |(ray, hit): (&Vector3<f64>, &Option<Hit>)| {
            hit.as_ref().is_some_and(|hit| (hit.share - 1.0) * ray.norm() <= search_mm)
        };
        rays.iter().zip(hits).any(meets)
    };
    points_mm.iter().zip(by_point).filter(|(_, beside)| !is_beside_edge(*beside)).map(|(point, _)| *point).collect()
}
