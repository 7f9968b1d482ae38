//! Viewpoints at F along surface normals, of facets (Scott 2009, *Model-based view planning*; thesis §2.2 with Martins and
//! Mahmud) or of surface points (Scott, Loriot: thesis §2.2). A filter thins them: near one that is taken, with nearly its
//! normal, no other is. Facets go first by area, points in a random order.
//!
//! Cost: candidates × those taken, at most 10⁵ × count.

use nalgebra::{Point3, Vector3};

use super::{Aim, Scope};
use crate::planning::ids::SampleId;
use crate::planning::params::CandidateParams;
use crate::planning::random::split_mix;

/// Facets or points that are looked at.
const LOOKED_AT: usize = 100_000;
/// Cosine of the angle within which two normals count as one: 15°.
const ALIKE_COS: f64 = 0.965_925_826_289_068_3;

/// A surface point with its unit normal, table frame, mm.
type Site = (Point3<f64>, Vector3<f64>);

pub(super) fn of_facets(scope: &Scope<'_>, params: &CandidateParams) -> Vec<Aim> {
    let mut facets: Vec<(f64, usize)> =
        (0..scope.part.faces.len()).map(|face| (scope.part.face_area_mm2(face), face)).filter(|(area, _)| *area > 0.0).collect();
    facets.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let site = |(_, face): &(f64, usize)| {
        let [a, b, c] = scope.part.corners(*face).map(|corner| corner.coords);
        placed(scope, &Point3::from((a + b + c) / 3.0), &scope.part.scaled_normal(*face).normalize())
    };
    let count = params.facet_normals as usize;
    aims(scope, spaced(facets.iter().take(LOOKED_AT).map(site), count, spacing_mm(scope, params, count)))
}

pub(super) fn of_points(scope: &Scope<'_>, params: &CandidateParams) -> Vec<Aim> {
    let samples = scope.surface.sample_mm.len();
    let mut order: Vec<(u64, SampleId)> = SampleId::first(samples)
        .step_by(samples.div_ceil(LOOKED_AT).max(1))
        .map(|sample| (split_mix(scope.seed ^ split_mix(u64::from(sample.0))), sample))
        .collect();
    order.sort_unstable();
    let site = |(_, sample): &(u64, SampleId)| {
        placed(scope, &scope.surface.sample_mm[sample.index()], &scope.surface.patch_of(*sample).normal)
    };
    let count = params.surface_points as usize;
    aims(scope, spaced(order.iter().map(site), count, spacing_mm(scope, params, count)))
}

fn placed(scope: &Scope<'_>, point: &Point3<f64>, normal: &Vector3<f64>) -> Site {
    (scope.table_from_part.point(point), scope.table_from_part.direction(normal))
}

fn spacing_mm(scope: &Scope<'_>, params: &CandidateParams, count: usize) -> f64 {
    params.spacing_mm.unwrap_or_else(|| (scope.part.area_mm2() / count as f64).sqrt())
}

/// The first `count` sites of which none lies within `spacing_mm` of an earlier one with nearly the same normal.
fn spaced(sites: impl Iterator<Item = Site>, count: usize, spacing_mm: f64) -> Vec<Site> {
    let mut taken: Vec<Site> = Vec::new();
    for (point, normal) in sites {
        if taken.len() == count {
            break;
        }
        let near = |(p, n): &Site| (p - point).norm_squared() < spacing_mm * spacing_mm && n.dot(&normal) > ALIKE_COS;
        if !taken.iter().any(near) {
            taken.push((point, normal));
        }
    }
    taken
}

fn aims(scope: &Scope<'_>, sites: Vec<Site>) -> Vec<Aim> {
    sites.iter().map(|(point, normal)| Aim::at_point(point, normal, scope)).collect()
}
