//! Coverage as it was really measured, beside the planned one. The unit of counting is the plan's sample.
//!
//! **By view.** A sample is measured by a view if, at the registered pose, the cell of the left camera's image in which it lies
//! holds a point q with |(q − p) · n| ≤ τ, p the sample and n its normal; if the surface through q, from its neighbours in the
//! grid, is turned by at most 30° from n; and if the points around q lie as close as is asked for. τ is the larger of
//! [`CompareParams::tolerance_mm`] and 4 σ, σ the noise expected there ([`crate::planning::surface::requirements`]), so that a surface that
//! deviates more is told apart. Asked for is the `point_spacing_mm` of the sample's feature, else less than twice the distance
//! between full cells, n · z / (f · cos i). Counting by footprint has no scale to choose: counting points in a ball around the
//! sample is off by −0.8 to +4.1 points of coverage, with its radius alone.
//!
//! Samples that the left camera sees at [`CompareParams::band_deg`] more than its limit of incidence do not count: there whole faces
//! lie in one row of cells, whose points may be those of other surfaces.
//!
//! **Merged clouds** are parted into images of the views before (`ingest/merged.rs`), and the result says that it is approximate.
//!
//! Identity: planned + gained − lost = measured, in area, for sums that are compensated (Neumaier 1974, *Rundungsfehleranalyse
//! einiger Verfahren zur Summation endlicher Summen*).
//!
//! Cost: some 0.3 µs a sample and view, nothing a point of an organised cloud; a bit a sample and view.

mod footprint;
mod gridded;
mod model;
mod params;
mod returns;
mod sum;
#[cfg(test)]
mod tests;

pub use gridded::GriddedCloud;
pub use model::{ModelPoint, NominalModel};
pub use params::CompareParams;
pub use returns::{Return, Returns, returns};

pub(super) use footprint::{Footprint, SeenSample, ViewLookup};
pub(super) use sum::area_mm2;

use super::{RegisteredView, ViewScan};
use crate::cell::{PerDevice, Scanner};
use crate::geometry::parallel;
use crate::planning::context::{Cancelled, Context};
use crate::planning::ids::SampleId;
use crate::planning::params::PlanParams;
use crate::planning::surface::Surface;
use crate::planning::visibility::{Optics, Row, SampleSet};

/// Samples that a thread looks up at a time.
const BLOCK: usize = 4096;

/// Limits of a real scanner, as its scans show them; `None` where they do not show any.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct IdentifiedLimits {
    /// Incidence against each device beyond which less than three quarters of what is seen returns, degrees.
    pub incidence_deg: PerDevice<Option<f64>>,
    /// Angle around the mirror direction within which glare keeps a point from returning, degrees.
    pub lobe_deg: Option<f64>,
    /// Depths, z in the scanner's frame, between which points return, mm.
    pub depth_mm: Option<[f64; 2]>,
}

/// A view of the plan, and the samples that it was to measure.
#[derive(Clone, Debug)]
pub struct PlannedRow {
    /// Number of its viewpoint.
    pub viewpoint: u32,
    /// The samples.
    pub row: Row,
}

/// A scan and where it lies.
#[derive(Clone, Copy)]
pub struct ScannedView<'a> {
    /// The scan.
    pub scan: &'a ViewScan,
    /// Registration of the scan.
    pub registered: &'a RegisteredView,
}

/// A plan and the scans of it.
#[derive(Clone, Copy)]
pub struct ComparedViews<'a> {
    /// Samples of the plan.
    pub surface: &'a Surface,
    /// Area of each sample, 0 where it is not asked for.
    pub asked_area_mm2: &'a [f64],
    /// The scanner of the plan.
    pub scanner: &'a Scanner,
    /// Parameters of the plan.
    pub params: &'a PlanParams,
    /// Every view of the plan.
    pub planned: &'a [PlannedRow],
    /// Every scan that there is, of any of these views.
    pub scanned: &'a [ScannedView<'a>],
    /// Asked area that some candidate of the plan measures, where it is known.
    pub coverable_mm2: Option<f64>,
    /// Knobs.
    pub compare: &'a CompareParams,
}

/// Areas of one view of the plan, mm².
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ViewCoverage {
    /// Number of its viewpoint.
    pub viewpoint: u32,
    /// Number of its scans.
    pub scans: usize,
    /// Planned area.
    pub planned_mm2: f64,
    /// Area that its scans measure.
    pub measured_mm2: f64,
    /// Planned area that they measure.
    pub planned_and_measured_mm2: f64,
}

/// Area that lies so near to a limit of incidence, in every view concerned, that it may fall on either side
/// ([`CompareParams::band_deg`]), mm².
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LimitBand {
    /// Part of the planned area.
    pub planned_mm2: f64,
    /// Part of the area that is planned and not measured.
    pub lost_mm2: f64,
    /// Part of the area that is measured and not planned.
    pub gained_mm2: f64,
}

/// Measured beside planned coverage. Areas are of asked samples, mm².
#[derive(Clone, Debug)]
pub struct MeasuredCoverage {
    /// Samples that each scan measures, in the order of [`ComparedViews::scanned`].
    pub by_scan: Vec<SampleSet>,
    /// Samples that some view was to measure.
    pub planned: SampleSet,
    /// Samples that some scan measures.
    pub measured: SampleSet,
    /// All that is asked for.
    pub asked_mm2: f64,
    /// Asked area that some candidate of the plan measures, where it is known.
    pub coverable_mm2: Option<f64>,
    /// Areas by `[planned][measured]`, 0 for no and 1 for yes.
    pub table_mm2: [[f64; 2]; 2],
    /// Planned area.
    pub planned_mm2: f64,
    /// Measured area.
    pub measured_mm2: f64,
    /// Areas by view of the plan.
    pub by_view: Vec<ViewCoverage>,
    /// Area near a limit of incidence.
    pub band: LimitBand,
    /// True for clouds without views, of which coverage is known to about a point.
    pub is_approximate: bool,
}

impl MeasuredCoverage {
    /// Area that is measured and was not planned.
    #[must_use]
    pub fn gained_mm2(&self) -> f64 {
        self.table_mm2[0][1]
    }

    /// Area that was planned and is not measured.
    #[must_use]
    pub fn lost_mm2(&self) -> f64 {
        self.table_mm2[1][0]
    }

    /// Measured share of the asked area.
    #[must_use]
    pub fn of_asked(&self) -> f64 {
        share(self.measured_mm2, self.asked_mm2)
    }

    /// Planned share of the asked area.
    #[must_use]
    pub fn planned_of_asked(&self) -> f64 {
        share(self.planned_mm2, self.asked_mm2)
    }

    /// Measured share of the coverable area, where that is known.
    #[must_use]
    pub fn of_coverable(&self) -> Option<f64> {
        self.coverable_mm2.map(|coverable_mm2| share(self.measured_mm2, coverable_mm2))
    }

    /// Samples that were planned and are not measured.
    #[must_use]
    pub fn lost(&self) -> SampleSet {
        let mut lost = self.planned.clone();
        lost.remove_all(&self.measured);
        lost
    }

    /// Adds up what is planned and measured.
    pub(self) fn of_sets(input: &ComparedViews<'_>, by_scan: Vec<SampleSet>, measured: SampleSet) -> Self {
        let samples = input.surface.sample_mm.len();
        let asked = |sample: &SampleId| input.asked_area_mm2[sample.index()] > 0.0;
        let mut planned = SampleSet::none_of(samples);
        input.planned.iter().flat_map(|view| view.row.samples()).filter(asked).for_each(|sample| planned.insert(sample));
        let area = |is_planned: bool, is_measured: bool| {
            let is_of = |sample: &SampleId| planned.holds(*sample) == is_planned && measured.holds(*sample) == is_measured;
            area_mm2(input.asked_area_mm2, input.surface.samples().filter(is_of))
        };
        let table_mm2 = [[area(false, false), area(false, true)], [area(true, false), area(true, true)]];
        let mut coverage = Self {
            asked_mm2: area_mm2(input.asked_area_mm2, input.surface.samples()),
            coverable_mm2: input.coverable_mm2,
            table_mm2,
            planned_mm2: area_mm2(input.asked_area_mm2, planned.iter()),
            measured_mm2: area_mm2(input.asked_area_mm2, measured.iter()),
            by_view: Vec::new(),
            band: LimitBand::default(),
            is_approximate: false,
            by_scan,
            planned,
            measured,
        };
        coverage.by_view = input.planned.iter().map(|view| coverage.of_view(input, view)).collect();
        coverage
    }

    fn of_view(&self, input: &ComparedViews<'_>, view: &PlannedRow) -> ViewCoverage {
        let own = |scanned: &&ScannedView<'_>| scanned.scan.viewpoint == view.viewpoint;
        let mut measured = SampleSet::none_of(input.surface.sample_mm.len());
        let sets = input.scanned.iter().zip(&self.by_scan).filter(|(scanned, _)| own(scanned));
        sets.for_each(|(_, set)| measured.insert_all(set));
        let both = view.row.samples().filter(|sample| measured.holds(*sample));
        ViewCoverage {
            viewpoint: view.viewpoint,
            scans: input.scanned.iter().filter(own).count(),
            planned_mm2: area_mm2(input.asked_area_mm2, view.row.samples()),
            measured_mm2: area_mm2(input.asked_area_mm2, measured.iter()),
            planned_and_measured_mm2: area_mm2(input.asked_area_mm2, both),
        }
    }
}

fn share(part: f64, whole: f64) -> f64 {
    if whole > 0.0 { part / whole } else { 0.0 }
}

/// Measures the coverage of scans by view.
///
/// # Errors
/// [`Cancelled`].
pub fn measure(input: &ComparedViews<'_>, ctx: &Context<'_>) -> Result<MeasuredCoverage, Cancelled> {
    let optics = Optics::new(input.scanner, input.params, &input.surface.requirements);
    let asked: Vec<SampleId> = input.surface.samples().filter(|sample| input.asked_area_mm2[sample.index()] > 0.0).collect();
    let mut measured = SampleSet::none_of(input.surface.sample_mm.len());
    let mut by_scan = Vec::with_capacity(input.scanned.len());
    for scanned in input.scanned {
        ctx.check()?;
        let lookup = ViewLookup::new(input, &optics, scanned);
        let is_measured = |sample: &SampleId| {
            let seen = lookup.sample(*sample);
            seen.is_some_and(|seen| lookup.footprint(*sample, &seen) == Footprint::Measured)
        };
        let blocks = parallel::try_map_chunks(&asked, BLOCK, |block| {
            ctx.check()?;
            Ok::<_, Cancelled>(block.iter().copied().filter(is_measured).collect::<Vec<_>>())
        })?;
        let mut set = SampleSet::none_of(input.surface.sample_mm.len());
        blocks.iter().flatten().for_each(|sample| set.insert(*sample));
        measured.insert_all(&set);
        by_scan.push(set);
    }
    let mut coverage = MeasuredCoverage::of_sets(input, by_scan, measured);
    coverage.band = band(input, &optics, &coverage);
    Ok(coverage)
}

/// Area near a limit of incidence: of each sample the view counts that sees it farthest within the limits.
fn band(input: &ComparedViews<'_>, optics: &Optics, coverage: &MeasuredCoverage) -> LimitBand {
    let mut margin_rad = vec![f64::NEG_INFINITY; input.surface.sample_mm.len()];
    for (scanned, measured) in input.scanned.iter().zip(&coverage.by_scan) {
        let view = optics.at(&scanned.registered.part_from_scanner);
        let planned = input.planned.iter().filter(|view| view.viewpoint == scanned.scan.viewpoint);
        let concerned = planned.flat_map(|view| view.row.samples()).chain(measured.iter());
        for sample in concerned {
            let normal = &input.surface.patch_of(sample).normal;
            let angles = view.incidence_rad(&input.surface.sample_mm[sample.index()], normal);
            let limits = limits_rad(input, sample);
            let margins = limits.zip(angles).map(|(limit_rad, angle_rad)| limit_rad - angle_rad);
            let least = margins.into_iter().fold(f64::INFINITY, f64::min);
            margin_rad[sample.index()] = margin_rad[sample.index()].max(least);
        }
    }
    let band_rad = input.compare.band_deg.to_radians();
    let is_near = |sample: &SampleId| margin_rad[sample.index()].abs() < band_rad;
    let area = |samples: &mut dyn Iterator<Item = SampleId>| area_mm2(input.asked_area_mm2, samples.filter(is_near));
    LimitBand {
        planned_mm2: area(&mut coverage.planned.iter()),
        lost_mm2: area(&mut coverage.lost().iter()),
        gained_mm2: area(&mut coverage.measured.iter().filter(|sample| !coverage.planned.holds(*sample))),
    }
}

/// Limits of the incidence at a sample: the tightest of scanner, job and region.
fn limits_rad(input: &ComparedViews<'_>, sample: SampleId) -> PerDevice<f64> {
    let requirement = input.surface.requirements.of(sample);
    let required = PerDevice::of_cameras(requirement.camera_max_rad, requirement.projector_max_rad);
    let of_job = input.scanner.devices.as_ref().map(|device| input.params.limits.incidence_max_rad(device));
    required.zip(of_job).map(|(required, of_job)| required.map_or(of_job, |required| required.min(of_job)))
}
