//! Facts of every planned pair of view and sample: whether the view returned the sample, and under what angles and at what depth
//! it was to see it. From these the limits of a real scanner are identified, and lost samples are put down to them.
//!
//! Columns, not rows: 26 bytes a pair.

use super::model::{ModelPoint, NominalModel};
use super::{ComparedViews, MeasuredCoverage, ScannedView, ViewLookup};
use crate::cell::{DeviceName, PerDevice};
use crate::geometry::parallel;
use crate::inspection::mirror::Reflection;
use crate::planning::context::{Cancelled, Context};
use crate::planning::ids::SampleId;
use crate::planning::visibility::{Optics, SampleSet};

/// Samples that a thread looks into at a time.
const BLOCK: usize = 1024;

/// One planned sample in one registered view that was to measure it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Return {
    /// Place of the view among the registered views.
    pub view: usize,
    /// The sample.
    pub sample: SampleId,
    /// True if the view measures it ([`super`]).
    pub is_returned: bool,
    /// True if the model, at the registered pose, is seen by all devices where the ray of the sample's cell meets it, and is the
    /// sample's surface there: a scanner without any weakness would return the cell. Rates of return are those of expected pairs.
    pub is_expected: bool,
    /// Angles at the sample between its normal and the directions to the devices, at the registered pose, rad.
    pub incidence_rad: PerDevice<f64>,
    /// Smallest angle between the projector's light as a mirror at the sample reflects it and the direction to a camera, rad.
    pub mirror_rad: f64,
    /// z of the sample in the scanner's frame, mm.
    pub depth_mm: f64,
}

impl Return {
    /// The device that sees the sample at the largest angle, and that angle, rad; of equal ones the first.
    #[must_use]
    pub fn worst_incidence(&self) -> (DeviceName, f64) {
        let larger = |worst: (DeviceName, f64), device: DeviceName| {
            if self.incidence_rad[device] > worst.1 { (device, self.incidence_rad[device]) } else { worst }
        };
        let first = (DeviceName::Left, self.incidence_rad.left);
        [DeviceName::Right, DeviceName::Projector].into_iter().fold(first, larger)
    }
}

const RETURNED: u8 = 1;
const EXPECTED: u8 = 2;

/// Every planned pair of view and sample, ordered by view, then by sample.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Returns {
    /// Places at which the views begin, one a view.
    first: Vec<usize>,
    samples: Vec<SampleId>,
    flags: Vec<u8>,
    incidence_rad: Vec<[f32; 3]>,
    mirror_rad: Vec<f32>,
    depth_mm: Vec<f32>,
}

impl Returns {
    /// Number of pairs.
    #[must_use]
    pub fn len(&self) -> usize {
        self.samples.len()
    }

    /// Returns true if there is no pair.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.samples.is_empty()
    }

    /// Number of views.
    #[must_use]
    pub fn views(&self) -> usize {
        self.first.len()
    }

    /// Appends the pairs of the next view, ascending by sample; `view` of each is set to its place.
    pub fn push_view(&mut self, returns: impl IntoIterator<Item = Return>) {
        self.first.push(self.samples.len());
        for pair in returns {
            self.samples.push(pair.sample);
            self.flags.push((u8::from(pair.is_returned) * RETURNED) | (u8::from(pair.is_expected) * EXPECTED));
            let PerDevice { left, right, projector } = pair.incidence_rad.map(|rad| rad as f32);
            self.incidence_rad.push([left, right, projector]);
            self.mirror_rad.push(pair.mirror_rad as f32);
            self.depth_mm.push(pair.depth_mm as f32);
        }
    }

    /// The pairs of one view, ascending by sample; none of a view that is not there.
    pub fn of_view(&self, view: usize) -> impl ExactSizeIterator<Item = Return> + '_ {
        let begin = self.first.get(view).copied().unwrap_or(self.len());
        let end = self.first.get(view + 1).copied().unwrap_or(self.len());
        (begin..end).map(move |place| self.at(view, place))
    }

    /// Every pair.
    pub fn iter(&self) -> impl Iterator<Item = Return> + '_ {
        (0..self.views()).flat_map(|view| self.of_view(view))
    }

    /// The pair of a view and a sample, if it was planned.
    #[must_use]
    pub fn of(&self, view: usize, sample: SampleId) -> Option<Return> {
        let begin = *self.first.get(view)?;
        let end = self.first.get(view + 1).copied().unwrap_or(self.len());
        let place = self.samples[begin..end].binary_search(&sample).ok()?;
        Some(self.at(view, begin + place))
    }

    fn at(&self, view: usize, place: usize) -> Return {
        let [left, right, projector] = self.incidence_rad[place].map(f64::from);
        Return {
            view,
            sample: self.samples[place],
            is_returned: self.flags[place] & RETURNED != 0,
            is_expected: self.flags[place] & EXPECTED != 0,
            incidence_rad: PerDevice { left, right, projector },
            mirror_rad: f64::from(self.mirror_rad[place]),
            depth_mm: f64::from(self.depth_mm[place]),
        }
    }
}

/// Collects the facts of every planned sample in every scan.
///
/// # Errors
/// [`Cancelled`].
pub fn returns(
    input: &ComparedViews<'_>,
    coverage: &MeasuredCoverage,
    model: &NominalModel<'_>,
    ctx: &Context<'_>,
) -> Result<Returns, Cancelled> {
    let optics = Optics::new(input.scanner, input.params, &input.surface.requirements);
    let mut all = Returns::default();
    for (place, scanned) in input.scanned.iter().enumerate() {
        let planned = input.planned.iter().filter(|view| view.viewpoint == scanned.scan.viewpoint);
        let mut samples = SampleSet::none_of(input.surface.sample_mm.len());
        planned.for_each(|view| samples.insert_all(view.row.measured()));
        let samples: Vec<SampleId> = samples.iter().filter(|sample| input.asked_area_mm2[sample.index()] > 0.0).collect();
        let facts = ViewFacts {
            place,
            scanned,
            lookup: ViewLookup::new(input, &optics, scanned),
            reflection: Reflection::new(input.scanner).at(&scanned.registered.part_from_scanner),
            measured: coverage.by_scan.get(place),
            model,
        };
        let blocks = parallel::try_map_chunks(&samples, BLOCK, |block| {
            ctx.check()?;
            Ok::<_, Cancelled>(facts.of(input, block, ctx))
        })?;
        all.push_view(blocks.into_iter().flatten());
    }
    Ok(all)
}

/// One scan, ready for its samples.
struct ViewFacts<'a> {
    place: usize,
    scanned: &'a ScannedView<'a>,
    lookup: ViewLookup<'a>,
    reflection: Reflection,
    measured: Option<&'a SampleSet>,
    model: &'a NominalModel<'a>,
}

impl ViewFacts<'_> {
    fn of(&self, input: &ComparedViews<'_>, samples: &[SampleId], ctx: &Context<'_>) -> Vec<Return> {
        let grid = self.lookup.cloud.grid();
        let scanner_mm = |sample: &SampleId| self.lookup.scanner_from_part * input.surface.sample_mm[sample.index()];
        let cells: Vec<Option<usize>> =
            samples.iter().map(|sample| grid.cell_of(&scanner_mm(sample)).map(|cell| grid.number(cell))).collect();
        let asked: Vec<usize> = cells.iter().flatten().copied().collect();
        let mut points = self.model.at_cells(&self.scanned.registered.part_from_scanner, grid, &asked, ctx).into_iter();
        let mut facts = Vec::with_capacity(samples.len());
        for (sample, cell) in samples.iter().zip(cells) {
            let model = cell.and_then(|_| points.next().flatten());
            let (point_mm, normal) = (&input.surface.sample_mm[sample.index()], &input.surface.patch_of(*sample).normal);
            facts.push(Return {
                view: self.place,
                sample: *sample,
                is_returned: self.measured.is_some_and(|measured| measured.holds(*sample)),
                is_expected: model.is_some_and(|model| is_of_sample(input, *sample, &model)),
                incidence_rad: self.lookup.view.incidence_rad(point_mm, normal),
                mirror_rad: self.reflection.mirror_rad(point_mm, normal),
                depth_mm: scanner_mm(sample).z,
            });
        }
        facts
    }
}

/// Returns true if a point of the model is seen and lies on the surface of a sample, as a measured point has to.
pub(in crate::inspection) fn is_of_sample(input: &ComparedViews<'_>, sample: SampleId, model: &ModelPoint) -> bool {
    let normal = &input.surface.patch_of(sample).normal;
    let off_mm = (model.point_mm - input.surface.sample_mm[sample.index()]).dot(normal);
    let is_level = model.normal.dot(normal) >= input.compare.normal_deg.to_radians().cos();
    model.is_seen && is_level && off_mm.abs() <= input.compare.tolerance_mm
}
