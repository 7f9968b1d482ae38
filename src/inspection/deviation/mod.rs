//! Deviation of the surface from its model: for every sample the mean signed distance of the points that its pixels hold, with its
//! uncertainty; statistics, verdicts of toleranced regions, extents, and the worst spots.
//!
//! Each point belongs to the face that the left camera's ray through it meets first, at h; its distance is d = n·(q − h), n the
//! face's outward normal, exact where the surface found is parallel to the face. Where d is more than a footprint, extra material stands on
//! the surface elsewhere than an oblique ray meets it: such a point belongs to the face behind the surface that it shows, if that is turned
//! alike and within [`DeviationOptions::search_mm`], else to the face below it, and h is its foot there. A sample takes
//! the points whose h is no farther than [`DeviationOptions::footprint_mm`] and whose face is turned by less than 30° against its own: none
//! is ever averaged across an edge.
//! At a step in depth, where the part lies off its model sideways, a ray to the level on the other side meets the wrong face: a point
//! that the face of a pixel within [`DeviationOptions::rim_mm`] explains better is left out. So is one of what lies behind a rim of the
//! part, if so near both it goes on beside the part and the face is shown; and one that shows a surface turned by more than 30° against
//! its face, such as the flank of a notch. Points of the other side of a step or behind a rim are forgotten; those of a turned surface are
//! counted, and a sample where most points are such ones, and off by more than the tolerance, does not pass: it counts as not measured, as
//! those at edges that are broken do.
//!
//! A merged cloud does not tell which view took a point: it is parted into images of the views before (`ingest/merged.rs`). A surface that
//! is missing down to near another one, or to the other side of a sheet, may then be taken for that: it counts as not measured.
//!
//! Expanded uncertainty (JCGM 100:2008, 6.2, k = 2): U² = t² σ²/n_eff + 4·(Σ (n_v/n)² σ_v² + |Σ (n_v/n) h_v|² + σ_align²), σ the points'
//! own spread, n_eff their number over that of points which share noise, as the scans show it (`correlation.rs`), σ_v the standard
//! deviation along n of where a view lies by itself, and h_v the errors along n by one standard deviation of each component that all
//! poses are off alike: h is summed over views as fully correlated (JCGM 100:2008, 5.2.2, Note 1). Few points show their σ badly, so
//! that their variance is pooled with the median of the samples that are seen about as flatly, which counts for ten, and t is Student's
//! factor where that is larger than 2 (JCGM 100:2008, G.3). After an alignment to samples the poses count by σ_align, which holds what
//! neither their priors nor surface of several views rule out of them ([`super::OpenPoses`]), as far as the alignment does not take it
//! up, and the uncertainty of the alignment itself ([`align`]). What the points alone leave open is told beside U: a pose that is off
//! shifts a wall as a whole, and hides no spot of it.
//!
//! Verdicts after ISO 14253-1:2017: conformity is shown where |d| + U ≤ T/2, its contrary where |d| − U > T/2, and nothing in between. Its
//! contrary is shown as well where two samples of the same views are farther apart than T and what is open of their difference. A
//! region fails only if ten samples are measured and more of them fail than noise lets fail, or ten lie farther beyond than noise takes any
//! of so many, or all of a smaller one fail, and only where the registration holds it: where no point of the accepted views tells its distance
//! to 2.5 mm or its tolerance, or samples fail by points of views that could not be registered, the region is undecided.
//! A sample from which most points lie farther than is searched is undecided, and keeps its region from passing: its material may be
//! missing, but such points also come of a view that lies off sideways, a reflection or another body. With a larger search distance they
//! are judged.
//!
//! Cost: a ray a point in packets, some 10⁻⁷ s, and a look-up of the pixels around each sample. Nothing depends on the number of threads.

pub mod align;
mod aligned_poses;
mod correlation;
mod extents;
mod footprint;
mod off_surface;
mod spots;
pub mod statistics;
mod sums;
#[cfg(test)]
mod tests;

use nalgebra::{Matrix6, Point3, Vector3};

use super::{PixelGrid, RegisteredView, ViewScan};
use crate::cell::Scanner;
use crate::cell::calibration::se3::Twist;
use crate::cell::closed_list;
use crate::geometry::parallel;
use crate::geometry::{Mesh, Part, Pose, RayScene, ScannerFrame, SimdLevel};
use crate::planning::ids::SampleId;
use crate::planning::surface::Surface;
use correlation::NoiseRuns;
pub use extents::Extent;
use footprint::{Footprints, ViewDistances};
pub use off_surface::{MAX_HEAPS, MaterialKind, OffSurface};
pub use spots::DeviationSpot;
pub use statistics::{
    Conformity, DeviationStatistics, ExcludedShares, Histogram, MIN_TO_FAIL, OpenPart, RegionDeviation, RegionToJudge,
    UndecidedBecause,
};
use sums::{MIN_OTHER_POINTS, PooledVariance, SampleSum};

/// Largest angle between the measured and the nominal normal, degrees: that with which coverage is counted.
pub const MAX_TURN_DEG: f64 = 30.0;

/// Standard deviation of a point of the nominal scanner at its best distance, mm.
const NOISE_MM: f64 = 0.035 / 3.0;

/// Knobs of the comparison.
#[derive(Clone, Debug, PartialEq)]
pub struct DeviationOptions {
    /// Distance from the sample within which points count for it, mm; `None` takes half the distance between samples, and at least 1.5
    /// times that between the points.
    pub footprint_mm: Option<f64>,
    /// Distance from the surface up to which a point measures it, mm. Points beyond are material missing or extra.
    pub search_mm: f64,
    /// Largest angle between the measured and the nominal normal, degrees.
    pub max_turn_deg: f64,
    /// Distance of a point from a step in depth, or from a rim of the part, within which the faces on both sides are tried, mm: what the
    /// part may lie off sideways.
    pub rim_mm: f64,
    /// Minimum number of points that are taken to share noise, n_eff = n over it: more where the scans show that neighbours share
    /// more.
    pub correlated_points: f64,
    /// Standard deviation of a point where too few samples show their own, mm. Where it is larger than usual, another face beside a step
    /// has to explain a point better by as many times more before the point counts for it.
    pub noise_mm: f64,
    /// Deviation from which spots are listed where a region has no tolerance, mm.
    pub spot_mm: f64,
    /// Minimum share of a region's area whose samples have to pass for its verdict to be `pass`.
    pub min_measured: f64,
    /// True if each scan is the image of one cloud that was merged of all views. A sample then takes the points of the scan that shows most
    /// of them, since the others show the same ones again.
    pub is_merged: bool,
}

impl Default for DeviationOptions {
    /// 2 mm: beyond it a point seldom belongs to the face that its ray meets; 0.5 mm, twice the usual error of a pose.
    fn default() -> Self {
        Self {
            footprint_mm: None,
            search_mm: 2.0,
            max_turn_deg: MAX_TURN_DEG,
            rim_mm: 0.5,
            correlated_points: 1.0,
            noise_mm: NOISE_MM,
            spot_mm: 0.1,
            min_measured: 0.9,
            is_merged: false,
        }
    }
}

closed_list! {
    /// Alignment of the scans to the model.
    pub enum Alignment {
        /// The calibrated poses place the part.
        AsPlaced = "as_placed",
        /// All measured samples fitted to the model, by least squares of their distances, without those beyond three root mean
        /// squares.
        BestFit = "best_fit",
        /// The samples of one region fitted to the model.
        BestFitOn = "best_fit_on",
    }
}

/// Deviation of one sample.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SampleDeviation {
    /// Mean signed distance along the outward normal, mm: above 0 where there is more material than nominal.
    pub distance_mm: f32,
    /// Standard deviation of its points, mm.
    pub sigma_mm: f32,
    /// Expanded uncertainty of the mean, k = 2, mm.
    pub expanded_mm: f32,
    /// Expanded uncertainty that the points alone give it, mm: the rest is that of poses and alignment, which neighbours share.
    pub of_points_mm: f32,
    /// Number of points; 0 where it was not measured.
    pub points: u32,
    /// Points that are left out, since the surface that they show is turned by more than [`DeviationOptions::max_turn_deg`].
    pub turned_points: u32,
    /// Mean signed distance of those points, mm.
    pub turned_mm: f32,
    /// True if most points before it or behind it are farther from it than is searched: material is missing there, or extra.
    pub is_off: bool,
}

impl SampleDeviation {
    /// Expanded uncertainty that poses and the alignment give it, mm.
    #[must_use]
    pub fn of_poses_mm(&self) -> f64 {
        (f64::from(self.expanded_mm).powi(2) - f64::from(self.of_points_mm).powi(2)).max(0.0).sqrt()
    }

    /// Returns true if most points around it are left out for their turn, and show a surface that is off by more than a limit.
    #[must_use]
    pub fn is_turned_beyond(&self, limit_mm: f64) -> bool {
        let is_turned = self.turned_points >= MIN_OTHER_POINTS && self.turned_points > self.points;
        is_turned && f64::from(self.turned_mm.abs()) > limit_mm
    }
}

/// A scan with the pose at which it is compared.
#[derive(Clone, Copy, Debug)]
pub struct PlacedScan<'a> {
    /// The scan.
    pub scan: &'a ViewScan,
    /// Pose of the scanner.
    pub part_from_scanner: Pose<Part, ScannerFrame>,
    /// Covariance of what this pose is off by itself: right perturbation, rad and mm.
    pub covariance: Matrix6<f64>,
    /// Standard deviations of what the poses of all scans are off alike, scanner frame, rad and mm.
    pub shared_sd: Twist,
}

impl<'a> PlacedScan<'a> {
    /// A scan at its registered pose. Its uncertainty is that of all poses against an alignment ([`align::best_fit`]).
    #[must_use]
    pub fn registered(scan: &'a ViewScan, view: &RegisteredView) -> Self {
        let (covariance, shared_sd) = (Matrix6::zeros(), Twist::zeros());
        Self { scan, part_from_scanner: view.part_from_scanner, covariance, shared_sd }
    }

    /// Moves the part's coordinates.
    #[must_use]
    pub fn moved(&self, mesh_from_placed: &Pose<Part, Part>) -> Self {
        Self { part_from_scanner: *mesh_from_placed * self.part_from_scanner, ..*self }
    }
}

/// The model that scans are compared with.
pub struct Nominal<'a> {
    /// The mesh.
    pub mesh: &'a Mesh,
    /// Triangles of the part, to be met by rays, and after them those of what may hide it.
    pub scene: &'a RayScene,
    /// Samples of the part.
    pub surface: &'a Surface,
    /// The scanner.
    pub scanner: &'a Scanner,
}

/// Result of the comparison.
#[derive(Clone, Debug, PartialEq)]
pub struct Deviation {
    /// Deviation of each sample.
    pub samples: Vec<SampleDeviation>,
    /// Views that measured each sample, as places in the list of scans, ascending: the first is at `view_begin[sample]`.
    pub views: Vec<u16>,
    /// Points that each of them has of the sample.
    pub view_points: Vec<u32>,
    /// Begin of each sample's views, and the end of the last.
    pub view_begin: Vec<u32>,
    /// Points off the surface by more than the search distance, in heaps.
    pub off_surface: Vec<OffSurface>,
    /// Points that met a face and were compared; those of a merged cloud count once for each view that shows them.
    pub compared_points: u64,
    /// Points that met a face and were left out, since the surface that they show is turned by more than
    /// [`DeviationOptions::max_turn_deg`]; they count likewise.
    pub turned_points: u64,
}

/// Compares scans with the model.
#[must_use]
pub fn compare(scans: &[PlacedScan<'_>], nominal: &Nominal<'_>, options: &DeviationOptions) -> Deviation {
    let footprint_mm = options.footprint_mm.unwrap_or_else(|| default_footprint_mm(scans, nominal));
    let (mut sums, mut heaps) = (vec![SampleSum::default(); nominal.surface.sample_mm.len()], Vec::new());
    let (mut compared_points, mut turned_points) = (0, 0);
    let mut runs = NoiseRuns::default();
    let mut seen: Vec<Vec<SeenSample>> = Vec::with_capacity(scans.len());
    let mesh = nominal.mesh;
    let normals: Vec<Vector3<f64>> = parallel::map_range(mesh.faces.len(), |face| mesh.scaled_normal(face).normalize());
    for placed in scans {
        let distances = ViewDistances::of(placed, nominal, &normals, options, footprint_mm);
        compared_points += distances.compared;
        turned_points += distances.turned;
        heaps.extend_from_slice(&distances.off_surface);
        runs.add(&distances, &normals);
        let scanner_from_part = placed.part_from_scanner.inverse();
        let (normals, distances) = (&normals[..], &distances);
        let footprints = Footprints { placed, nominal, normals, scanner_from_part, distances, footprint_mm };
        let measured = |sample: usize| {
            let id = SampleId::at(sample);
            footprints.of(id).map(|footprint| (footprint, PoseError::of(placed, &scanner_from_part, nominal.surface, id)))
        };
        let found: Vec<Option<_>> = parallel::map_range(sums.len(), measured);
        let mut own = Vec::new();
        for (sample, footprint) in found.iter().enumerate() {
            if let Some((footprint, error)) = footprint {
                sums[sample].add(footprint, error, options.is_merged);
                if footprint.compared.points > 0 {
                    own.push((SampleId::at(sample), footprint.compared.points));
                }
            }
        }
        seen.push(own);
    }
    let pooled = PooledVariance::of(&sums, runs.correlation(), options);
    let samples: Vec<SampleDeviation> = sums.iter().map(|sum| sum.finish(&pooled, options)).collect();
    let (views, view_points, view_begin) = views_of(&seen, samples.len());
    let off_surface = off_surface::heaps(&heaps, options);
    Deviation { samples, views, view_points, view_begin, off_surface, compared_points, turned_points }
}

/// Half the distance between samples, and at least 1.5 times that between points at the best focus.
fn default_footprint_mm(scans: &[PlacedScan<'_>], nominal: &Nominal<'_>) -> f64 {
    let surface = nominal.surface;
    let area_mm2: f64 = surface.patches.iter().map(|patch| patch.area_mm2).sum();
    let between_samples = (area_mm2 / surface.sample_mm.len().max(1) as f64).sqrt();
    let sizes = scans.iter().filter_map(|placed| placed.scan.scanner_cloud.grid);
    let grids = sizes.filter_map(|size| PixelGrid::of_size(nominal.scanner, size));
    let between_points = grids.map(|grid| grid.cell_mm(nominal.scanner.best_mm)).fold(0.0, f64::max);
    (0.5 * between_samples).max(1.5 * between_points)
}

/// Error along a sample's normal of where the view's pose puts it, by j = (s × n, n) in the scanner's frame.
#[derive(Clone, Copy)]
struct PoseError {
    /// Cosine of the incidence at which the view sees the sample.
    cos: f64,
    /// Variance of the pose's own error, jᵀ Σ j.
    own_mm2: f64,
    /// Error by one standard deviation of each component that all poses share.
    shared_mm: Twist,
}

impl PoseError {
    fn of(placed: &PlacedScan<'_>, scanner_from_part: &Pose<ScannerFrame, Part>, surface: &Surface, sample: SampleId) -> Self {
        let at = scanner_from_part.point(&surface.sample_mm[sample.index()]);
        let normal = scanner_from_part.direction(&surface.patch_of(sample).normal);
        let row = lever(&at, &normal);
        Self {
            cos: -normal.dot(&at.coords) / at.coords.norm(),
            own_mm2: variance((row.transpose() * placed.covariance * row)[0]),
            shared_mm: row.component_mul(&placed.shared_sd),
        }
    }
}

/// A variance that rounding left below zero is none, and one that is no number is without bounds.
fn variance(found: f64) -> f64 {
    if found.is_nan() { f64::INFINITY } else { found.max(0.0) }
}

/// Derivative of a point's distance along `normal` by a small motion of the point: (p × n, n).
fn lever(at: &Point3<f64>, normal: &Vector3<f64>) -> Twist {
    let turn = at.coords.cross(normal);
    Twist::new(turn.x, turn.y, turn.z, normal.x, normal.y, normal.z)
}

/// A sample that a view sees, with the points that it has of it.
type SeenSample = (SampleId, u32);

/// Views of each sample with their points, in one list each, and where those of each sample begin.
fn views_of(seen: &[Vec<SeenSample>], samples: usize) -> (Vec<u16>, Vec<u32>, Vec<u32>) {
    let mut begin = vec![0_u32; samples + 1];
    for (sample, _) in seen.iter().flatten() {
        begin[sample.index() + 1] += 1;
    }
    for sample in 0..samples {
        begin[sample + 1] += begin[sample];
    }
    let mut place = begin.clone();
    let mut views = vec![0_u16; begin[samples] as usize];
    let mut view_points = vec![0_u32; views.len()];
    for (view, own) in seen.iter().enumerate() {
        for (sample, points) in own {
            let at = place[sample.index()] as usize;
            (views[at], view_points[at]) = (view as u16, *points);
            place[sample.index()] += 1;
        }
    }
    (views, view_points, begin)
}

impl Deviation {
    /// Views that measured a sample, as places in the list of scans.
    #[must_use]
    pub fn views_of(&self, sample: SampleId) -> &[u16] {
        &self.views[self.places_of(sample)]
    }

    /// Points of a sample that each of its views has.
    fn points_of(&self, sample: SampleId) -> &[u32] {
        &self.view_points[self.places_of(sample)]
    }

    fn places_of(&self, sample: SampleId) -> std::ops::Range<usize> {
        let place = sample.index();
        self.view_begin[place] as usize..self.view_begin[place + 1] as usize
    }

    /// Extents of the part along its axes, nominal and measured.
    #[must_use]
    pub fn extents(&self, nominal: &Nominal<'_>) -> [Extent; 3] {
        extents::extents(&self.samples, nominal)
    }

    /// The worst spots, at most so many, by their largest deviation.
    #[must_use]
    pub fn worst_spots(&self, nominal: &Nominal<'_>, options: &DeviationOptions, count: usize) -> Vec<DeviationSpot> {
        spots::worst(self, nominal, options, count)
    }
}
