//! Random positions in the volume from which the surface is in depth, each drawn to the surface (Jing et al. 2016,
//! *Sampling-based view planning for 3D visual coverage task with unmanned aerial vehicle*): every sample that faces the
//! viewpoint pulls with a force that falls with the square of its distance, and the axis follows the sum.
//!
//! A viewpoint keeps the distance that was drawn: it is not slid. Cost: tries × [`SAMPLES`] a viewpoint.

use nalgebra::{Point3, Vector3};

use super::aim::SlidesBy;
use super::{Aim, Label, Scope};
use crate::geometry::{Aabb, parallel};
use crate::planning::context::{Cancelled, Context};
use crate::planning::ids::SampleId;
use crate::planning::params::CandidateParams;
use crate::planning::random::Stream;

/// Samples that stand for the surface.
const SAMPLES: usize = 2_000;
/// Positions tried for one viewpoint.
const TRIES: usize = 200;
/// Name of this strategy's streams.
const STREAM: u64 = 0x766f_6c75;

pub(super) fn aims(scope: &Scope<'_>, params: &CandidateParams, ctx: &Context<'_>) -> Result<Vec<Aim>, Cancelled> {
    let surface = scope.surface;
    let every = surface.sample_mm.len().div_ceil(SAMPLES).max(1);
    let sample = |sample: SampleId| {
        let normal = scope.table_from_part.direction(&surface.patch_of(sample).normal);
        (scope.table_from_part.point(&surface.sample_mm[sample.index()]), normal)
    };
    let samples: Vec<_> = surface.samples().step_by(every).map(sample).collect();
    let aabb = Aabb::around(samples.iter().map(|(point, _)| point));
    let volume = Volume { scope, samples, aabb };
    let found = parallel::try_map_range(params.volume_points as usize, |number| {
        ctx.check().map(|()| volume.viewpoint(Stream::new(scope.seed, &[STREAM, number as u64])))
    })?;
    Ok(found.into_iter().flatten().collect())
}

struct Volume<'a> {
    scope: &'a Scope<'a>,
    /// Position and normal, table frame, mm.
    samples: Vec<(Point3<f64>, Vector3<f64>)>,
    aabb: Aabb,
}

impl Volume<'_> {
    fn viewpoint(&self, mut stream: Stream) -> Option<Aim> {
        let scanner = self.scope.scanner;
        let [near_mm, far_mm] = scanner.working_depth_mm();
        let (low, extent) =
            (self.aabb.min.coords.add_scalar(-scanner.far_mm), self.aabb.extent_mm().add_scalar(2.0 * scanner.far_mm));
        (0..TRIES).find_map(|_| {
            let position_mm = Point3::from(low + extent.map(|edge_mm| stream.unit() * edge_mm));
            let nearest_mm2 = self.samples.iter().map(|(p, _)| (p - position_mm).norm_squared()).fold(f64::INFINITY, f64::min);
            let in_depth = (near_mm..=far_mm).contains(&nearest_mm2.sqrt());
            let axis = self.pull(&position_mm).filter(|_| in_depth)?;
            Some(Aim { position_mm, axis, label: Label::of_direction(&-axis), slides_by: SlidesBy::None, baseline: None })
        })
    }

    /// Unit sum of the forces, where there is one.
    fn pull(&self, position_mm: &Point3<f64>) -> Option<Vector3<f64>> {
        let force = |(p, normal): &(Point3<f64>, Vector3<f64>)| {
            let towards = p - position_mm;
            let faces = normal.dot(&towards) < 0.0;
            if faces { towards / towards.norm().powi(3) } else { Vector3::zeros() }
        };
        self.samples.iter().map(force).sum::<Vector3<f64>>().try_normalize(f64::MIN_POSITIVE)
    }
}
