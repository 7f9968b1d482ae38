//! Losses: every sample that was planned and is not measured, under exactly one cause, and a remedy for it.
//!
//! In one view the cause is the first that holds, in the order of [`LossCause`]. Of several views that were to measure a sample,
//! the one counts whose cause stands last in that order: it got furthest, as with the causes of what a plan misses
//! ([`crate::planning::method::causes`]). Grazing, glare and blur hold beyond the limits that were identified, not the scanner's own.
//!
//! A weakness near steps of depth and in corners holds only where the scans show it: pairs of view and sample of which the
//! geometry expects a point return there at most three quarters as often as elsewhere ([`evidence`]). A scan whose points lie scattered
//! in its grid shows none: an empty cell between them is one of too few points. So is one between two points of a cloud that came without
//! the camera's grid, and one whose point was taken out where cells are coarse, or neighbours on the surface itself lie as far apart in depth
//! as edges do. Where points were put into cells wider than the zone beside a step, whatever is lost there is one of too few points too: a
//! cell that reaches across the step holds a point of one side.
//!
//! That the part deviates or that points scatter is told by the points, each against the face that its ray meets ([`shown`]): an exact
//! scan shows neither, at edges and with coarse grids no more than elsewhere.
//!
//! Identity: planned + gained − Σ lost = measured ([`super::coverage`]).
//! Cost: some 45 rays a lost sample and view, and one ray for every 64th pixel of a scan.

mod attribute;
mod cut;
mod evidence;
mod foreign;
mod scattered;
mod shown;
mod steps;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod thinned;

pub use attribute::{Light, LossInput, attribute};

use nalgebra::{Point3, Vector3};

use super::coverage::{ComparedViews, MeasuredCoverage, area_mm2};
use crate::cell::closed_list;
use crate::geometry::Mesh;
use crate::planning::ids::SampleId;
use crate::planning::missed::{Spot, spots_of};

closed_list! {
    /// Cause for which a planned sample is not measured, in the order in which they are asked.
    pub enum LossCause {
        /// The scan of the view is missing.
        ViewMissing = "view_missing",
        /// The file ends before it.
        OutsideFile = "outside_file",
        /// The view was really taken from where the sample cannot be measured.
        Pose = "pose",
        /// Something that the model does not have is in the way.
        UnmodelledOccluder = "unmodelled_occluder",
        /// The surface is there, farther from the model than the tolerance.
        PartDeviates = "part_deviates",
        /// Beyond the identified limit of incidence, or up to 4° before it where nothing else explains the loss.
        Grazing = "grazing",
        /// Within the identified lobe of glare.
        Specular = "specular",
        /// Beside a step of depth.
        Edge = "edge",
        /// The sample lies in a concave corner.
        Concave = "concave",
        /// Too little light.
        Dark = "dark",
        /// Too much light.
        Saturated = "saturated",
        /// Beyond the identified depth.
        DepthBlur = "depth_blur",
        /// No ray of the grid meets the sample's surface, or the cloud has too few points there: around it on that surface, between its cells,
        /// or to tell surface from specks as it was cleaned.
        Sparse = "sparse",
        /// Points are there, and scatter too much.
        Noisy = "noisy",
        /// Taken out as the scan was cleaned.
        Filtered = "filtered",
        /// A loss that none of the other causes explains.
        Unexplained = "unexplained",
    }
}

closed_list! {
    /// Remedy for a lost spot.
    pub enum LossRemedy {
        /// Scan it from another view, or the view again.
        OtherView = "other_view",
        /// Scan with more light.
        Brighter = "brighter",
        /// Scan with less light.
        Darker = "darker",
        /// Spray it.
        Spray = "spray",
        /// Nothing helps.
        Nothing = "nothing",
    }
}

/// Brightest level of a projector.
const MAX_LEVEL: u8 = 9;

impl LossCause {
    /// Remedy of a spot that is lost for this cause in `views` views, at a level of brightness where that is known.
    #[must_use]
    pub fn remedy(self, views: f64, level: Option<u8>) -> LossRemedy {
        match self {
            // Glare from several sides: a dull surface helps more than another view.
            Self::Specular if views >= 2.0 => LossRemedy::Spray,
            Self::Dark if level == Some(MAX_LEVEL) => LossRemedy::Spray,
            Self::Saturated if level == Some(0) => LossRemedy::Spray,
            Self::Dark => LossRemedy::Brighter,
            Self::Saturated => LossRemedy::Darker,
            Self::ViewMissing
            | Self::OutsideFile
            | Self::Pose
            | Self::UnmodelledOccluder
            | Self::Grazing
            | Self::Specular
            | Self::DepthBlur
            | Self::Sparse
            | Self::Noisy => LossRemedy::OtherView,
            Self::PartDeviates | Self::Edge | Self::Concave | Self::Filtered | Self::Unexplained => LossRemedy::Nothing,
        }
    }
}

/// Connected samples that are lost for one cause.
#[derive(Clone, Debug, PartialEq)]
pub struct LostSpot {
    /// Lost area.
    pub area_mm2: f64,
    /// Area-weighted centre, part frame.
    pub centre_mm: Point3<f64>,
    /// Size of the box around it along the part's axes, whole patches counted.
    pub extent_mm: Vector3<f64>,
    /// Faces of the uploaded file that it touches, ascending.
    pub source_faces: Vec<u32>,
    /// Remedy for the spot.
    pub remedy: LossRemedy,
}

/// Area that is lost for one cause.
#[derive(Clone, Debug, PartialEq)]
pub struct Loss {
    /// The cause.
    pub cause: LossCause,
    /// Area of its samples.
    pub area_mm2: f64,
    /// Connected spots, largest first.
    pub spots: Vec<LostSpot>,
}

/// Everything that is lost.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Losses {
    /// Losses by cause, in the order of [`LossCause`]; causes without a loss are left out.
    pub by_cause: Vec<Loss>,
    /// Cause of each lost sample, ascending by sample.
    pub of_samples: Vec<(SampleId, LossCause)>,
}

impl Losses {
    /// Area lost for a cause, mm².
    #[must_use]
    pub fn area_mm2(&self, cause: LossCause) -> f64 {
        self.by_cause.iter().find(|loss| loss.cause == cause).map_or(0.0, |loss| loss.area_mm2)
    }

    /// Cause of a sample, if it is lost.
    #[must_use]
    pub fn cause_of(&self, sample: SampleId) -> Option<LossCause> {
        let place = self.of_samples.binary_search_by_key(&sample, |(sample, _)| *sample).ok()?;
        Some(self.of_samples[place].1)
    }

    /// Planned + gained − Σ lost − measured, mm²: zero but for rounding.
    #[must_use]
    pub fn residual_mm2(&self, coverage: &MeasuredCoverage) -> f64 {
        let lost_mm2: f64 = self.by_cause.iter().map(|loss| loss.area_mm2).sum();
        coverage.planned_mm2 + coverage.gained_mm2() - lost_mm2 - coverage.measured_mm2
    }

    /// Clusters lost samples, ascending, by cause.
    fn of(mesh: &Mesh, compared: &ComparedViews<'_>, of_samples: Vec<(SampleId, LossCause)>, level: Option<u8>) -> Self {
        let views = |spot: &Spot<LossCause>| {
            let planned = |sample: &SampleId| compared.planned.iter().filter(|view| view.row.holds(*sample)).count();
            spot.samples.iter().map(planned).sum::<usize>() as f64 / spot.samples.len() as f64
        };
        let loss = |cause: LossCause| {
            let of_cause = of_samples.iter().filter(|(_, other)| *other == cause).map(|(sample, _)| *sample);
            let samples: Vec<SampleId> = of_cause.collect();
            let area_mm2 = area_mm2(compared.asked_area_mm2, samples.iter().copied());
            let spots = spots_of(cause, samples, mesh, compared.surface).into_iter().map(|spot| LostSpot {
                remedy: cause.remedy(views(&spot), level),
                area_mm2: spot.area_mm2,
                centre_mm: spot.centre_mm,
                extent_mm: spot.extent_mm,
                source_faces: spot.source_faces,
            });
            Loss { cause, area_mm2, spots: spots.collect() }
        };
        let by_cause = LossCause::ALL.into_iter().map(loss).filter(|loss| !loss.spots.is_empty()).collect();
        Self { by_cause, of_samples }
    }
}
