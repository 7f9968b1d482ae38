//! Some of a surface's samples as a surface of its own, each standing for an area of its own there: what is asked of many views or
//! poses need not be asked at every sample.

use super::{Patch, Surface, asked, excluded, patch_normal};
use crate::geometry::Mesh;
use crate::planning::context::{Context, PlanError};
use crate::planning::ids::{PatchId, SampleId};
use crate::planning::params::RegionParams;

impl Surface {
    /// The surface of some of the samples, ascending, each with the area that it stands for. Every one becomes a patch, whose
    /// corners are those of the patch that it lies in.
    #[must_use]
    pub(in crate::planning) fn of_samples(&self, some: &[(SampleId, f64)]) -> Self {
        let patch = |(first_sample, (sample, area_mm2)): (SampleId, &(SampleId, f64))| Patch {
            area_mm2: *area_mm2,
            first_sample,
            samples: 1,
            ..*self.patch_of(*sample)
        };
        Self {
            patches: SampleId::number(some).map(patch).collect(),
            centre_mm: self.centre_mm,
            sample_mm: some.iter().map(|(sample, _)| self.sample_mm[sample.index()]).collect(),
            sample_patch: (0..some.len()).map(PatchId::at).collect(),
            asked: some.iter().map(|(sample, _)| self.asked[sample.index()]).collect(),
            requirements: self.requirements.of_samples(some.iter().map(|(sample, _)| *sample)),
        }
    }
}

/// Places at most `max` samples on a mesh of more triangles, on some of them ([`systematic`]), that stand for all: an O(n) look at
/// the areas, and no patch for the other triangles. Without requirements.
///
/// # Errors
/// Excluded regions that the mesh does not have; [`PlanError::Cancelled`].
pub(in crate::planning) fn sample_some(
    mesh: &Mesh,
    regions: &RegionParams,
    (max, seed): (usize, u64),
    ctx: &Context<'_>,
) -> Result<Surface, PlanError> {
    sample_some_and_all_of(mesh, regions, (&[], max, seed), ctx)
}

/// [`sample_some`], of which the triangles `own`, with an area each, stand for themselves alone, each a patch after those of the
/// others.
///
/// # Errors
/// The errors of [`sample_some`].
pub(super) fn sample_some_and_all_of(
    mesh: &Mesh,
    regions: &RegionParams,
    (own, max, seed): (&[u32], usize, u64),
    ctx: &Context<'_>,
) -> Result<Surface, PlanError> {
    let excluded = excluded(mesh, regions)?;
    ctx.check()?;
    let mut areas_mm2 = mesh.face_areas_mm2();
    let part_mm2 = areas_mm2.iter().sum::<f64>() / max as f64;
    let own: Vec<(u32, f64)> = own.iter().map(|face| (*face, std::mem::take(&mut areas_mm2[*face as usize]))).collect();
    let others = systematic(&areas_mm2, max).into_iter().map(|(SampleId(face), area_mm2)| (face, area_mm2));
    let patch = |(face, area_mm2): (u32, f64)| Patch {
        corners_mm: mesh.corners(face as usize),
        face,
        normal: patch_normal(mesh, face as usize),
        area_mm2,
        first_sample: SampleId(0),
        samples: (area_mm2 / part_mm2).round().max(1.0) as u32,
    };
    let mut surface = Surface::of_patches(vec![others.chain(own).map(patch).collect()], mesh.aabb().centre(), seed);
    surface.asked = asked(mesh, &surface, &excluded, || Ok::<_, PlanError>(ctx.check()?))?;
    Ok(surface)
}

/// Samples that stand for all, at most `max`, with the area that each stands for: one at every `max`-th part of the area as it adds
/// up in the order of the samples, which is that of the patches (systematic sampling with probability proportional to size:
/// W. Madow 1949, *On the theory of systematic sampling, II*, Annals of Mathematical Statistics 20). All that have an area where
/// those are no more than `max`. The areas add up to the whole.
#[must_use]
pub(in crate::planning) fn systematic(area_mm2: &[f64], max: usize) -> Vec<(SampleId, f64)> {
    let all =
        || SampleId::number(area_mm2).filter(|(_, area_mm2)| **area_mm2 > 0.0).map(|(sample, area_mm2)| (sample, *area_mm2));
    if all().count() <= max {
        return all().collect();
    }
    let whole_mm2: f64 = all().map(|(_, area_mm2)| area_mm2).sum();
    let part_mm2 = whole_mm2 / max as f64;
    let (mut so_far_mm2, mut taken) = (0.0, 0_usize);
    let parts = |(sample, area_mm2): (SampleId, f64)| {
        so_far_mm2 += area_mm2;
        // Parts whose middles lie in what has added up.
        let up_to = ((so_far_mm2 / part_mm2 + 0.5).floor() as usize).min(max);
        let parts = up_to.saturating_sub(taken);
        taken += parts;
        (parts > 0).then_some((sample, parts as f64 * part_mm2))
    };
    all().filter_map(parts).collect()
}

#[cfg(test)]
mod tests {
    use super::super::{PartParams, RegionParams, sample};
    use super::*;
    use crate::planning::params::Region;
    use crate::testing::trough;

    /// Sum of the areas that samples stand for.
    fn sum_mm2(some: &[(SampleId, f64)]) -> f64 {
        some.iter().map(|(_, area_mm2)| area_mm2).sum()
    }

    #[test]
    fn thinned_samples_stand_for_the_whole_area_and_for_every_stretch_of_it() {
        let area_mm2: Vec<f64> = (0..10_000).map(|i| if i % 7 == 0 { 0.0 } else { 1.0 + f64::from(i % 13) }).collect();
        let whole_mm2: f64 = area_mm2.iter().sum();
        let some = systematic(&area_mm2, 500);
        assert!(some.len() <= 500 && some.len() > 400, "{}", some.len());
        assert!((sum_mm2(&some) / whole_mm2 - 1.0).abs() < 1e-12);
        assert!(some.windows(2).all(|pair| pair[0].0 < pair[1].0), "ascending");
        assert!(some.iter().all(|(sample, _)| area_mm2[sample.index()] > 0.0));
        // Every stretch has its area to within one part at each end.
        for first in (0..10_000).step_by(1000) {
            let stretch = first..first + 1000;
            let own_mm2: f64 = area_mm2[stretch.clone()].iter().sum();
            let held: Vec<_> = some.iter().copied().filter(|(sample, _)| stretch.contains(&sample.index())).collect();
            assert!((sum_mm2(&held) - own_mm2).abs() <= 2.0 * whole_mm2 / 500.0, "{first}");
        }
    }

    #[test]
    fn a_sample_larger_than_a_part_stands_for_several_and_few_stay_as_they_are() {
        let some = systematic(&[1.0, 6.0, 1.0, 0.0, 1.0, 1.0], 4);
        assert!((sum_mm2(&some) - 10.0).abs() < 1e-12);
        assert!(some.iter().any(|(sample, area_mm2)| *sample == SampleId(1) && *area_mm2 >= 5.0), "{some:?}");
        assert_eq!(systematic(&[2.0, 0.0, 3.0], 2), [(SampleId(0), 2.0), (SampleId(2), 3.0)]);
        assert_eq!(systematic(&[], 5), []);
    }

    #[test]
    fn some_triangles_stand_for_the_area_of_all_and_of_what_is_excluded() {
        let mesh = crate::geometry::demo_parts::figurine(8_000).unwrap_or_else(|error| panic!("{error}"));
        let middle = mesh.aabb().centre();
        let half = Region::HalfSpace { point_mm: middle.into(), normal: [1.0, 0.0, 0.0] };
        let regions = RegionParams { exclude: vec![half], ..RegionParams::default() };
        let (cancel, silent) = (std::sync::atomic::AtomicBool::new(false), crate::planning::context::Silent);
        let ctx = Context::new(&cancel, &silent);
        let some = sample_some(&mesh, &regions, (1_500, 7), &ctx).unwrap_or_else(|error| panic!("{error}"));
        let all = sample(&mesh, &PartParams::default(), &regions, 7).unwrap_or_else(|errors| panic!("{errors:?}"));
        assert!(some.sample_mm.len() <= 1_500 && some.sample_mm.len() > 1_000, "{}", some.sample_mm.len());
        assert!((some.area_where(|_| true) / mesh.area_mm2() - 1.0).abs() < 1e-9);
        let asked = |surface: &Surface| surface.asked_area_mm2().iter().sum::<f64>() / mesh.area_mm2();
        assert!((asked(&some) - asked(&all)).abs() < 0.02 && asked(&some) < 0.9, "{} and {}", asked(&some), asked(&all));
        let is_outward = |sample: SampleId| {
            let patch = some.patch_of(sample);
            patch.normal.dot(&mesh.scaled_normal(patch.face as usize)) > 0.0
        };
        assert!(some.samples().all(is_outward));
    }

    #[test]
    fn a_large_triangle_has_as_many_samples_as_its_area_asks_for() {
        let mesh = trough();
        let (cancel, silent) = (std::sync::atomic::AtomicBool::new(false), crate::planning::context::Silent);
        let ctx = Context::new(&cancel, &silent);
        let some = sample_some(&mesh, &RegionParams::default(), (2_000, 7), &ctx).unwrap_or_else(|error| panic!("{error}"));
        assert!(some.patches.len() <= mesh.faces.len() && mesh.faces.len() < 1_000, "triangles are large");
        assert!((some.area_where(|_| true) / mesh.area_mm2() - 1.0).abs() < 1e-9);
        let part_mm2 = mesh.area_mm2() / 2_000.0;
        let stands_for = |sample: SampleId| some.sample_area_mm2(sample) / part_mm2;
        assert!(some.samples().all(|sample| (0.5..=1.5).contains(&stands_for(sample))));
        let mut points: Vec<_> = some.sample_mm.iter().map(|p| [p.x, p.y, p.z].map(f64::to_bits)).collect();
        points.sort_unstable();
        points.dedup();
        assert_eq!(points.len(), some.sample_mm.len(), "no point twice");
    }

    #[test]
    fn a_thinned_surface_has_the_points_normals_and_requirements_of_its_samples() {
        let mesh = trough();
        let regions = RegionParams {
            exclude: vec![Region::HalfSpace { point_mm: [0.0, 0.0, 1.0], normal: [0.0, 0.0, 1.0] }],
            ..RegionParams::default()
        };
        let part = PartParams { samples_per_mm2: Some(0.2), patch_edge_mm: Some(15.0), ..PartParams::default() };
        let surface = sample(&mesh, &part, &regions, 3).unwrap_or_else(|errors| panic!("{errors:?}"));
        let some = systematic(&surface.asked_area_mm2(), 200);
        let thinned = surface.of_samples(&some);
        assert_eq!(thinned.sample_mm.len(), some.len());
        assert!(some.len() < surface.sample_mm.len() && surface.asked.contains(&false), "there is something to leave out");
        for (own, (of, area_mm2)) in thinned.samples().zip(&some) {
            assert_eq!(thinned.sample_mm[own.index()], surface.sample_mm[of.index()]);
            assert_eq!(thinned.patch_of(own).normal, surface.patch_of(*of).normal);
            assert_eq!((thinned.patch_of(own).first_sample, thinned.sample_area_mm2(own)), (own, *area_mm2));
            assert!(thinned.asked[own.index()]);
            assert_eq!(thinned.requirements.kind(own), surface.requirements.kind(*of));
        }
        let asked_mm2 = |surface: &Surface| surface.asked_area_mm2().iter().sum::<f64>();
        assert!((asked_mm2(&thinned) / asked_mm2(&surface) - 1.0).abs() < 1e-12);
    }
}
