//! The test of one sample in one view: by the cell of the left camera's image in which the sample lies at the registered pose.

use std::f64::consts::FRAC_PI_2;

use nalgebra::{Isometry3, Point3, Vector3};

use super::gridded::GriddedCloud;
use super::{CompareParams, ComparedViews, ScannedView};
use crate::planning::ids::SampleId;
use crate::planning::visibility::{MeasuringPrecision, View};

/// Standard deviations of the expected noise that are within the tolerance.
const SIGMAS: f64 = 4.0;
/// Share of the spacing that the noise may have in a triangle of neighbouring points, so that its normal is known to about 20°.
const NOISE_OF_SPACING: f64 = 0.25;
/// Largest distance of the neighbours that a normal is taken from, cells.
const MAX_REACH: f64 = 8.0;
/// Distance between points, as a multiple of that of full cells, that counts where no other is asked for. One of four cells
/// gives just this much, and is not enough.
const SPACING_FACTOR: f64 = 2.0;

/// Content of the cell of a sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::inspection) enum Footprint {
    /// A point of the sample's surface.
    Measured,
    /// The sample lies outside of the cloud's grid.
    OutsideGrid,
    /// A cell without a point.
    Empty,
    /// A point so far from the sample's plane, mm, positive in front of it.
    Off(f64),
    /// A point on the sample's plane, of a surface that is turned.
    Turned,
    /// A point on the sample's surface with too few around it.
    Sparse,
}

/// One registered view, ready for many samples.
pub(in crate::inspection) struct ViewLookup<'a> {
    pub(in crate::inspection) cloud: GriddedCloud<'a>,
    pub(in crate::inspection) view: View<'a>,
    pub(in crate::inspection) scanner_from_part: Isometry3<f64>,
    input: &'a ComparedViews<'a>,
    /// Cosine of the largest incidence at which a cell tells what it shows.
    min_cos: f64,
}

/// A sample in the scanner's frame.
pub(in crate::inspection) struct SeenSample {
    pub(in crate::inspection) scanner_mm: Point3<f64>,
    pub(in crate::inspection) normal: Vector3<f64>,
    pub(in crate::inspection) precision: MeasuringPrecision,
    pub(in crate::inspection) tolerance_mm: f64,
}

impl<'a> ViewLookup<'a> {
    pub(in crate::inspection) fn new(
        input: &'a ComparedViews<'a>,
        optics: &'a crate::planning::visibility::Optics,
        scanned: &ScannedView<'a>,
    ) -> Self {
        let pose = &scanned.registered.part_from_scanner;
        let max_rad = input.scanner.devices.left.incidence_max_rad + input.compare.band_deg.to_radians();
        Self {
            cloud: GriddedCloud::new(input.scanner, &scanned.scan.scanner_cloud),
            view: optics.at(pose),
            scanner_from_part: pose.isometry().inverse(),
            input,
            min_cos: max_rad.min(FRAC_PI_2).cos().max(0.0),
        }
    }

    fn compare(&self) -> &CompareParams {
        self.input.compare
    }

    /// A sample as this view sees it; `None` where it faces away, or is seen at more than the left camera's limit of incidence and
    /// [`CompareParams::band_deg`]: at 89.5° one row of cells holds 6 mm of a surface, and the points there may as well lie on its rim or
    /// on what stands behind it.
    pub(in crate::inspection) fn sample(&self, sample: SampleId) -> Option<SeenSample> {
        let surface = self.input.surface;
        let (point_mm, normal) = (&surface.sample_mm[sample.index()], &surface.patch_of(sample).normal);
        let to_camera = self.view.centres_mm().left - point_mm;
        if normal.dot(&to_camera) <= self.min_cos * to_camera.norm() {
            return None;
        }
        let precision = self.view.precision_at(point_mm, normal);
        Some(SeenSample {
            scanner_mm: self.scanner_from_part * point_mm,
            normal: self.scanner_from_part * normal,
            precision,
            tolerance_mm: self.tolerance_mm(&precision),
        })
    }

    /// Distance from a surface, seen with this precision, within which a point measures it, mm.
    pub(in crate::inspection) fn tolerance_mm(&self, precision: &MeasuringPrecision) -> f64 {
        let noise_mm = if precision.cos > 0.0 { precision.noise_mm } else { 0.0 };
        self.compare().tolerance_mm.max(SIGMAS * noise_mm)
    }

    /// Finds what the cell of a sample holds.
    pub(in crate::inspection) fn footprint(&self, sample: SampleId, seen: &SeenSample) -> Footprint {
        let Some(cell) = self.cloud.grid().cell_of(&seen.scanner_mm) else { return Footprint::OutsideGrid };
        let Some(point) = self.cloud.point(cell) else { return Footprint::Empty };
        let off_mm = (point - seen.scanner_mm).dot(&seen.normal);
        if off_mm.abs() > seen.tolerance_mm {
            return Footprint::Off(off_mm);
        }
        let enough = self.compare().normal_deg.to_radians().cos();
        let cos = self.cloud.best_normal_cos(cell, &point, &seen.normal, self.reach(seen), enough);
        if cos.is_some_and(|cos| cos < enough) {
            return Footprint::Turned;
        }
        if self.is_dense(sample, seen, cell) { Footprint::Measured } else { Footprint::Sparse }
    }

    /// Distance of neighbours, in cells, at which the expected noise is small beside the spacing.
    pub(in crate::inspection) fn reach(&self, seen: &SeenSample) -> isize {
        let MeasuringPrecision { cos, noise_mm, spacing_mm } = seen.precision;
        let across_mm = self.cloud.grid().step_px * spacing_mm * cos;
        let reach = (noise_mm / (NOISE_OF_SPACING * across_mm)).ceil().clamp(1.0, MAX_REACH);
        (reach as isize).max(1)
    }

    fn is_dense(&self, sample: SampleId, seen: &SeenSample, cell: [usize; 2]) -> bool {
        let full_mm = self.cloud.grid().step_px * seen.precision.spacing_mm;
        let spacing_mm = full_mm * (4.0 / f64::from(self.cloud.best_square(cell))).sqrt();
        match self.input.surface.requirements.of(sample).spacing_max_mm {
            Some(max_mm) => spacing_mm <= max_mm,
            None => spacing_mm < SPACING_FACTOR * full_mm,
        }
    }
}
