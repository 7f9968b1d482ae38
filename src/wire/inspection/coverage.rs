//! Measured coverage beside the planned one, and the losses.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::geometry::sort_descending;
use crate::inspection::coverage::{MeasuredCoverage, ViewCoverage};
use crate::inspection::losses::{Loss, LossCause, LossRemedy, Losses, LostSpot};
use crate::wire::schema_name::schema_name;

/// Spots of a cause that the result itself lists; the listing of the losses has all.
const SPOTS_SHOWN: usize = 5;

/// Schema name of the listing of losses.
const LOSSES_SCHEMA: &str = "vantage.losses/1";

schema_name!(LossesSchema, LOSSES_SCHEMA);

/// Coverage that the scans measured, compared with the planned one. Shares are of the asked area unless they say otherwise.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct MeasuredCoverageDocument {
    /// Area asked for.
    pub asked_area_mm2: f64,
    /// Share that the plan measures.
    pub planned_of_asked: f64,
    /// Share that the scans measure.
    pub measured_of_asked: f64,
    /// Share that the scans of all rounds so far measure: this round, and those that its plan continues.
    pub measured_in_all_of_asked: f64,
    /// Share of the coverable area that the scans measure; `null` where that area is not known.
    pub measured_of_coverable: Option<f64>,
    /// Share that was planned and measured.
    pub both_of_asked: f64,
    /// Share that was planned and not measured: the sum of the losses.
    pub lost_of_asked: f64,
    /// Share that was measured and not planned.
    pub gained_of_asked: f64,
    /// Share that was neither planned nor measured.
    pub neither_of_asked: f64,
    /// Share that was planned and not measured, and lies so near to a limit of incidence that it may fall on either side.
    pub lost_near_limit_of_asked: f64,
    /// Share that was measured and not planned, and lies so near to a limit of incidence that it may fall on either side.
    pub gained_near_limit_of_asked: f64,
    /// True for merged clouds, whose coverage is known to within about one percentage point, and not by view.
    pub approximate: bool,
    /// Areas by view of the plan.
    pub by_view: Vec<ViewCoverageDocument>,
}

/// Coverage of one view.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ViewCoverageDocument {
    /// Viewpoint of the plan.
    pub viewpoint: u32,
    /// Number of its scans.
    pub scans: usize,
    /// Area that the view was planned to measure.
    pub planned_area_mm2: f64,
    /// Area that its scans measure.
    pub measured_area_mm2: f64,
    /// Part of the planned area that they measure.
    pub planned_and_measured_area_mm2: f64,
}

/// Area that was planned and not measured, for one cause.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LossDocument {
    /// Cause.
    pub cause: LossCause,
    /// Sentence for people.
    pub detail: String,
    /// Lost area.
    pub area_mm2: f64,
    /// Share of the asked area.
    pub of_asked: f64,
    /// Number of connected spots.
    pub spots: usize,
    /// Largest spots, largest first; `losses.json` has all of them.
    pub largest: Vec<LostSpotDocument>,
}

/// A connected patch of surface that was lost for one cause.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LostSpotDocument {
    /// Lost area of the spot.
    pub area_mm2: f64,
    /// Area-weighted centre of the spot, part frame.
    pub centre_mm: [f64; 3],
    /// Size of its bounding box along the part's axes.
    pub extent_mm: [f64; 3],
    /// Remedy.
    pub remedy: LossRemedy,
    /// Faces of the uploaded file that the spot touches, ascending; only in the listing of the losses.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub faces: Vec<u32>,
}

/// Every loss with every spot (`losses.json`).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LossListing {
    /// Schema name, `vantage.losses/1`.
    #[schema(value_type = LossesSchema)]
    pub schema: String,
    /// SHA-256 of the bytes of `plan.json`.
    pub plan_sha256: String,
    /// Area asked for.
    pub asked_area_mm2: f64,
    /// Area that was planned but not measured.
    pub lost_area_mm2: f64,
    /// Losses by cause.
    pub losses: Vec<LossDocument>,
}

fn share(part: f64, whole: f64) -> f64 {
    if whole > 0.0 { part / whole } else { 0.0 }
}

impl MeasuredCoverageDocument {
    /// Document of a measured coverage; scans of all rounds so far measure `in_all_mm2`.
    #[must_use]
    pub fn new(coverage: &MeasuredCoverage, in_all_mm2: f64) -> Self {
        let of_asked = |area_mm2: f64| share(area_mm2, coverage.asked_mm2);
        Self {
            asked_area_mm2: coverage.asked_mm2,
            planned_of_asked: coverage.planned_of_asked(),
            measured_of_asked: coverage.of_asked(),
            measured_in_all_of_asked: of_asked(in_all_mm2),
            measured_of_coverable: coverage.of_coverable(),
            both_of_asked: of_asked(coverage.table_mm2[1][1]),
            lost_of_asked: of_asked(coverage.lost_mm2()),
            gained_of_asked: of_asked(coverage.gained_mm2()),
            neither_of_asked: of_asked(coverage.table_mm2[0][0]),
            lost_near_limit_of_asked: of_asked(coverage.band.lost_mm2),
            gained_near_limit_of_asked: of_asked(coverage.band.gained_mm2),
            approximate: coverage.is_approximate,
            by_view: coverage.by_view.iter().map(ViewCoverageDocument::from).collect(),
        }
    }
}

impl From<&ViewCoverage> for ViewCoverageDocument {
    fn from(view: &ViewCoverage) -> Self {
        Self {
            viewpoint: view.viewpoint,
            scans: view.scans,
            planned_area_mm2: view.planned_mm2,
            measured_area_mm2: view.measured_mm2,
            planned_and_measured_area_mm2: view.planned_and_measured_mm2,
        }
    }
}

impl LostSpotDocument {
    fn new(spot: &LostSpot, with_faces: bool) -> Self {
        Self {
            area_mm2: spot.area_mm2,
            centre_mm: spot.centre_mm.coords.into(),
            extent_mm: spot.extent_mm.into(),
            remedy: spot.remedy,
            faces: if with_faces { spot.source_faces.clone() } else { Vec::new() },
        }
    }
}

impl LossDocument {
    /// Document of a loss, with its largest spots alone or with all.
    fn new(loss: &Loss, asked_mm2: f64, all: bool) -> Self {
        let shown = if all { loss.spots.len() } else { SPOTS_SHOWN };
        Self {
            cause: loss.cause,
            detail: loss_sentence(loss.cause).to_owned(),
            area_mm2: loss.area_mm2,
            of_asked: share(loss.area_mm2, asked_mm2),
            spots: loss.spots.len(),
            largest: loss.spots.iter().take(shown).map(|spot| LostSpotDocument::new(spot, all)).collect(),
        }
    }

    /// Documents of all losses, largest area first.
    #[must_use]
    pub fn all(losses: &Losses, asked_mm2: f64) -> Vec<Self> {
        let mut documents: Vec<Self> = losses.by_cause.iter().map(|loss| Self::new(loss, asked_mm2, false)).collect();
        sort_descending(&mut documents, |document| document.area_mm2);
        documents
    }
}

impl LossListing {
    /// Lists every spot.
    #[must_use]
    pub fn new(losses: &Losses, coverage: &MeasuredCoverage, plan_sha256: &str) -> Self {
        Self {
            schema: LOSSES_SCHEMA.to_owned(),
            plan_sha256: plan_sha256.to_owned(),
            asked_area_mm2: coverage.asked_mm2,
            lost_area_mm2: coverage.lost_mm2(),
            losses: losses.by_cause.iter().map(|loss| LossDocument::new(loss, coverage.asked_mm2, true)).collect(),
        }
    }
}

/// Sentence for a cause.
#[must_use]
pub fn loss_sentence(cause: LossCause) -> &'static str {
    match cause {
        LossCause::ViewMissing => "there is no scan of the view: scan it, or upload its file",
        LossCause::OutsideFile => "the file ends before it: export the whole field of view",
        LossCause::Pose => {
            "this surface cannot be measured from where the view was taken: check the calibration and the pose of the part"
        }
        LossCause::UnmodelledOccluder => "an object that is not in the model is in the way: add it to the cell, or remove it",
        LossCause::PartDeviates => "the surface is farther from the model than the tolerance: see the deviation",
        LossCause::Grazing => "seen more obliquely than this scanner can measure: plan with the identified limit, or add a view",
        LossCause::Specular => {
            "the projector's light reflects into a camera: add a view off the mirror direction, or spray the part"
        }
        LossCause::Edge => "near an edge, where scanners lose points: only a view along the edge helps",
        LossCause::Concave => "in a concave corner, where light is reflected back and forth",
        LossCause::Dark => "too little light returns: scan brighter, or spray the part",
        LossCause::Saturated => "too much light returns: scan darker, or spray the part",
        LossCause::DepthBlur => "nearer or farther than this scanner can measure: plan with the identified depth, or add a view",
        LossCause::Sparse => "too few points lie there: export the scan with all of its points, or add a view that faces it",
        LossCause::Noisy => "its points scatter more than the plan expects: add a view at best focus",
        LossCause::Filtered => "its points were removed when the scan was cleaned",
        LossCause::Unexplained => "none of the known causes applies",
    }
}

/// Phrase for a cause of loss, as the dashboard has it.
#[must_use]
pub fn loss_phrase(cause: LossCause) -> &'static str {
    match cause {
        LossCause::ViewMissing => "no scan of the view",
        LossCause::OutsideFile => "cut off in the file",
        LossCause::Pose => "view taken from elsewhere",
        LossCause::UnmodelledOccluder => "hidden by an object that is not in the model",
        LossCause::PartDeviates => "part deviates",
        LossCause::Grazing => "too oblique for this scanner",
        LossCause::Specular => "glare",
        LossCause::Edge => "near an edge",
        LossCause::Concave => "concave corner",
        LossCause::Dark => "too dark",
        LossCause::Saturated => "too bright",
        LossCause::DepthBlur => "outside the usable depth",
        LossCause::Sparse => "too few points",
        LossCause::Noisy => "too noisy",
        LossCause::Filtered => "removed in cleaning",
        LossCause::Unexplained => "unexplained",
    }
}

/// Words for a remedy.
#[must_use]
pub fn remedy_words(remedy: LossRemedy) -> &'static str {
    match remedy {
        LossRemedy::OtherView => "add a view",
        LossRemedy::Brighter => "scan brighter",
        LossRemedy::Darker => "scan darker",
        LossRemedy::Spray => "spray",
        LossRemedy::Nothing => "none",
    }
}
