//! Requirements of each sample beyond being measured at all: a weight, incidence limits, a grade, and for toleranced
//! features a limit of the expected noise and of the distance between points.
//!
//! **Expected noise** of a point at depth z, seen under the incidence i against the direction to the viewpoint:
//!
//! σ(z, i) = σ_F · (1 + g · ((z − F) / D)²) / cos i
//!
//! with F the best focus, D the half range of the working depth on that side of F, σ_F `noise.best_mm` and g
//! `noise.depth_gain`. It has the shape that Prieto found for range sensors (F. Prieto, T. Redarce, P. Boulanger, R. Lepage
//! 1999, *CAD-based range sensor placement for optimum 3D data acquisition*): U-shaped in distance with its least value at
//! the focus, and growing without bound towards grazing incidence, here as the footprint of a pixel does. A feature of
//! tolerance T is measured where 4 σ ≤ `noise.budget` · T: the expanded uncertainty, k = 2, to both sides (JCGM 100:2008,
//! 6.2; VDA Volume 5). The distance between its points is z / (f · cos i), f the smallest focal length of the cameras in
//! pixels. Features of a finer tolerance count more in the score: the coarsest tolerance of the job over their own.
//!
//! Memory: two bytes a sample. Cost: O(samples · regions), once.

use std::collections::HashMap;

use nalgebra::Point3;

use super::little_asked::LittleAsked;
use super::small_regions::{SAMPLES_OF_A_REGION, SmallRegions, denser};
use super::subset::sample_some_and_all_of;
use super::{RegionFinder, Surface, border_mm, sample_for, sample_some};
use crate::cell::{FieldError, Material, closed_list};
use crate::geometry::Mesh;
use crate::planning::context::{Context, PlanError, Refusal};
use crate::planning::ids::SampleId;
use crate::planning::params::{InterestParams, PlanParams};
use crate::planning::verdict::Grade;

#[cfg(test)]
mod tests;

/// Largest weight of a finer tolerance beside the coarsest.
const MAX_WEIGHT: f64 = 100.0;

/// Requirements of some samples.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Requirement {
    /// Numbers of the regions that hold them: regions of interest, then features.
    pub regions: Vec<usize>,
    /// Weight of their area in the score.
    pub weight: f64,
    /// Own limit of the cameras' incidence, rad.
    pub camera_max_rad: Option<f64>,
    /// Own limit of the projector's incidence, rad.
    pub projector_max_rad: Option<f64>,
    /// Worst grade that counts.
    pub min_grade: Option<Grade>,
    /// Largest expected noise, mm.
    pub noise_max_mm: Option<f64>,
    /// Largest distance between measured points, mm.
    pub spacing_max_mm: Option<f64>,
    /// Material; `None` where brightness enters no figure.
    pub material: Option<Material>,
}

/// Requirements by sample.
#[derive(Clone, Debug, PartialEq)]
pub struct Requirements {
    /// The kinds that there are; the first is what is asked outside all regions.
    pub kinds: Vec<Requirement>,
    /// Kind of each sample; empty where all are of the first.
    of_sample: Vec<u16>,
}

impl Default for Requirements {
    /// A requirement of nothing beyond being measured.
    fn default() -> Self {
        Self { kinds: vec![Requirement { weight: 1.0, ..Requirement::default() }], of_sample: Vec::new() }
    }
}

closed_list! {
    /// Kind of a region that has requirements of its own.
    pub enum RegionKind {
        /// Region of interest.
        Interest = "interest",
        /// Toleranced feature.
        Feature = "feature",
    }
}

/// A region with a name and a target of its own.
#[derive(Clone, Debug, PartialEq)]
pub struct NamedRegion {
    /// Name in plan and report.
    pub name: String,
    /// Kind of the region.
    pub kind: RegionKind,
    /// Width of the tolerance zone of a feature, mm.
    pub tolerance_mm: Option<f64>,
    /// Share of its asked area that is to be measured.
    pub target: Option<f64>,
}

/// The regions of a job in the order of their numbers.
#[must_use]
pub fn regions(params: &PlanParams) -> Vec<NamedRegion> {
    let interest = params.regions.interest.iter().enumerate().map(|(index, region)| NamedRegion {
        name: region.name_at(index),
        kind: RegionKind::Interest,
        tolerance_mm: None,
        target: region.target,
    });
    let features = params.regions.features.iter().enumerate().map(|(index, feature)| NamedRegion {
        name: feature.name_at(index),
        kind: RegionKind::Feature,
        tolerance_mm: Some(feature.tolerance_mm),
        target: feature.target,
    });
    interest.chain(features).collect()
}

/// The samples of a part, after [`super::resolve`], with what is asked of them. A region of interest or a feature has about a hundred at
/// least, however small it is, and so has all that is asked ([`crate::planning::method::sampling`]).
///
/// # Errors
/// The errors of [`sample_for`] and [`Requirements::new`]; regions that leave too little for samples.
pub fn sampled(mesh: &Mesh, params: &PlanParams, seed: u64, ctx: &Context<'_>) -> Result<Surface, PlanError> {
    sampled_densely(mesh, params, (SAMPLES_OF_A_REGION, seed), ctx)
}

/// [`sampled`], with about `of_region` samples at least of each region of interest and feature, and of what is asked where that is little.
///
/// # Errors
/// The errors of [`sampled`].
pub(in crate::planning) fn sampled_densely(
    mesh: &Mesh,
    params: &PlanParams,
    (of_region, seed): (usize, u64),
    ctx: &Context<'_>,
) -> Result<Surface, PlanError> {
    let mut surface = sample_for(mesh, &params.part, &params.regions, seed, ctx)?;
    if let Some(little) = LittleAsked::of(mesh, &surface, &params.regions)? {
        let nothing = || PlanError::param("/regions/exclude", &Refusal::NothingAsked);
        surface = little.denser(&surface, (of_region, seed), ctx)?.ok_or_else(nothing)?;
    }
    surface.requirements = Requirements::new(mesh, &surface, params)?;
    denser(mesh, surface, params, (of_region, seed), ctx)
}

/// Samples, about `max`, that stand for those of a mesh with more triangles ([`sample_some`]), with what is asked of them; about
/// `of_region` at least of each region of interest and feature, and of what is asked, whose triangles stand for themselves where that is
/// small, unless all such are more than `max`.
///
/// # Errors
/// The errors of [`sample_some`] and [`Requirements::new`].
pub(in crate::planning) fn sampled_sparsely(
    mesh: &Mesh,
    params: &PlanParams,
    (max, of_region, seed): (usize, usize, u64),
    ctx: &Context<'_>,
) -> Result<Surface, PlanError> {
    let mut surface = sample_some(mesh, &params.regions, (max, seed), ctx)?;
    if let Some(little) = LittleAsked::of(mesh, &surface, &params.regions)? {
        return sampled_where_asked(mesh, params, (&little, surface), (max, of_region, seed), ctx);
    }
    surface.requirements = Requirements::new(mesh, &surface, params)?;
    let Some(small) = SmallRegions::of(mesh, &surface, params, of_region)? else { return Ok(surface) };
    let own = small.faces();
    // Of many slivers that a narrow region crosses, those that stand for others are as good, and do not take longer than the part.
    if own.len() > max {
        return denser(mesh, surface, params, (of_region, seed), ctx);
    }
    let with_own = sample_some_and_all_of(mesh, &params.regions, (&own, max, seed), ctx)?;
    // More samples may find more overlaps of regions than can be told apart.
    let surface = match Requirements::new(mesh, &with_own, params) {
        Ok(requirements) => Surface { requirements, ..with_own },
        Err(_) => surface,
    };
    denser(mesh, surface, params, (of_region, seed), ctx)
}

/// [`sampled_sparsely`] where little is asked: triangles of which some may be stand for themselves, unless they are more than `max`, and
/// regions have what samples these leave them.
fn sampled_where_asked(
    mesh: &Mesh,
    params: &PlanParams,
    (little, some): (&LittleAsked<'_>, Surface),
    (max, of_region, seed): (usize, usize, u64),
    ctx: &Context<'_>,
) -> Result<Surface, PlanError> {
    let own = little.faces();
    let surface = if own.len() > max { some } else { sample_some_and_all_of(mesh, &params.regions, (&own, max, seed), ctx)? };
    let mut surface = little.denser(&surface, (of_region, seed), ctx)?.unwrap_or(surface);
    surface.requirements = Requirements::new(mesh, &surface, params)?;
    denser(mesh, surface, params, (of_region, seed), ctx)
}

impl Requirements {
    /// Applies `params` to the samples of `surface`.
    ///
    /// # Errors
    /// Regions that the mesh does not have; more than 65 535 ways in which regions overlap.
    pub fn new(mesh: &Mesh, surface: &Surface, params: &PlanParams) -> Result<Self, Vec<FieldError>> {
        let mut requirements = Self::default();
        requirements.kinds[0].min_grade = params.selection.min_grade;
        requirements.kinds[0].material = params.material_of_part();
        let (interest, features) = (&params.regions.interest, &params.regions.features);
        let materials = &params.materials.regions;
        if interest.is_empty() && features.is_empty() && materials.is_empty() {
            return Ok(requirements);
        }
        let interest = interest.iter().enumerate().map(|(i, region)| (format!("/regions/interest/{i}/region"), &region.region));
        let features = features.iter().enumerate().map(|(i, region)| (format!("/regions/features/{i}/region"), &region.region));
        let materials =
            materials.iter().enumerate().map(|(i, region)| (format!("/materials/regions/{i}/region"), &region.region));
        let border_mm = border_mm(mesh);
        let all = interest.chain(features).chain(materials);
        let finders = all.map(|(at, region)| RegionFinder::new(mesh, region, (at.as_str(), border_mm)));
        let finders = finders.collect::<Result<Vec<_>, _>>()?;
        let mut kind_of: HashMap<Vec<usize>, u16> = HashMap::from([(Vec::new(), 0)]);
        for (sample, p) in SampleId::number(&surface.sample_mm) {
            let source_face = mesh.source_face[surface.patch_of(sample).face as usize];
            let kind = match kind_of.entry(holding(&finders, source_face, p)) {
                std::collections::hash_map::Entry::Occupied(known) => *known.get(),
                std::collections::hash_map::Entry::Vacant(new) => {
                    let kind = u16::try_from(requirements.kinds.len()).map_err(|_| too_many_overlaps())?;
                    requirements.kinds.push(Requirement::of_regions(new.key(), params));
                    *new.insert(kind)
                }
            };
            requirements.of_sample.push(kind);
        }
        Ok(requirements)
    }

    /// Adds a sample with the requirement that one of `whole` has, which has the same kinds.
    pub(super) fn push_of(&mut self, whole: &Self, sample: SampleId) {
        if !whole.of_sample.is_empty() {
            self.of_sample.push(whole.kind(sample));
        }
    }

    /// Number of a sample's kind.
    #[must_use]
    pub fn kind(&self, sample: SampleId) -> u16 {
        self.of_sample.get(sample.index()).copied().unwrap_or(0)
    }

    /// The requirements of some of the samples, numbered anew in the order given.
    pub(super) fn of_samples(&self, some: impl Iterator<Item = SampleId>) -> Self {
        let of_sample = if self.of_sample.is_empty() { Vec::new() } else { some.map(|sample| self.kind(sample)).collect() };
        Self { kinds: self.kinds.clone(), of_sample }
    }

    /// The requirement of a sample.
    #[must_use]
    pub fn of(&self, sample: SampleId) -> &Requirement {
        &self.kinds[usize::from(self.kind(sample))]
    }

    /// Returns true if any sample has to be measured well, not only at all.
    #[must_use]
    pub fn any_requires_quality(&self) -> bool {
        self.kinds.iter().any(Requirement::requires_quality)
    }
}

fn holding(finders: &[RegionFinder<'_>], source_face: u32, p: &Point3<f64>) -> Vec<usize> {
    (0..finders.len()).filter(|region| finders[*region].holds(source_face, p)).collect()
}

fn too_many_overlaps() -> Vec<FieldError> {
    vec![FieldError { pointer: "/regions/interest".to_owned(), detail: Refusal::TooManyOverlaps.to_string() }]
}

impl Requirement {
    /// Returns true if being measured is not enough.
    #[must_use]
    pub fn requires_quality(&self) -> bool {
        self.min_grade.is_some_and(|grade| grade != Grade::D)
            || self.noise_max_mm.is_some()
            || self.spacing_max_mm.is_some()
            || self.material.is_some()
    }

    /// Combines a set of regions: the greatest weight, the strictest limits, the last material. Regions of a material are numbered
    /// after those with requirements.
    fn of_regions(regions: &[usize], params: &PlanParams) -> Self {
        let (interest, features) = (&params.regions.interest, &params.regions.features);
        let coarsest_mm = features.iter().map(|feature| feature.tolerance_mm).fold(0.0, f64::max);
        let (regions, materials) = regions.split_at(regions.partition_point(|region| *region < interest.len() + features.len()));
        let material = materials.last().map(|region| &params.materials.regions[region - interest.len() - features.len()]);
        let material = material.map(|region| params.materials.of_region(region)).or_else(|| params.material_of_part());
        let weight = if regions.is_empty() { 1.0 } else { f64::NEG_INFINITY };
        let mut requirement = Self { regions: regions.to_vec(), weight, material, ..Self::default() };
        for &region in regions {
            match region.checked_sub(interest.len()) {
                None => requirement.tighten(&interest[region]),
                Some(feature) => {
                    let feature = &features[feature];
                    let noise_max_mm = params.regions.noise.max_noise_mm(feature.tolerance_mm);
                    requirement.weight = requirement.weight.max((coarsest_mm / feature.tolerance_mm).min(MAX_WEIGHT));
                    requirement.noise_max_mm = stricter(requirement.noise_max_mm, Some(noise_max_mm));
                    requirement.spacing_max_mm = stricter(requirement.spacing_max_mm, feature.point_spacing_mm);
                }
            }
        }
        // A is the least grade: the better of two is the stricter.
        requirement.min_grade = requirement.min_grade.or(params.selection.min_grade);
        requirement
    }

    fn tighten(&mut self, interest: &InterestParams) {
        self.weight = self.weight.max(interest.weight);
        self.camera_max_rad = stricter(self.camera_max_rad, interest.camera_deg.map(f64::to_radians));
        self.projector_max_rad = stricter(self.projector_max_rad, interest.projector_deg.map(f64::to_radians));
        self.min_grade = match (self.min_grade, interest.min_grade) {
            (Some(a), Some(b)) => Some(a.min(b)),
            (a, b) => a.or(b),
        };
    }
}

/// The smaller of two limits, where there are any.
fn stricter(a: Option<f64>, b: Option<f64>) -> Option<f64> {
    match (a, b) {
        (Some(a), Some(b)) => Some(a.min(b)),
        (a, b) => a.or(b),
    }
}
