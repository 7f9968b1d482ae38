//! Missed surface in `plan.json`: by cause, its largest spots, and their remedies.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::cell::PoseSpec;
use crate::planning::plan::{MissedCause, MissedSpot, Remedy, RemedyView};
use crate::wire::angle::degrees;

/// Area missed for one cause.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct MissedDocument {
    /// The cause, of the closed list.
    pub reason: String,
    /// Its area.
    pub area_mm2: f64,
    /// Number of connected spots.
    pub spots: usize,
    /// Centre of the largest spot, part frame.
    pub centre_mm: [f64; 3],
    /// The cheapest remedy for the largest spot that was tried and works, or kind `none`; `null` where none was sought.
    pub remedy: Option<RemedyDocument>,
    /// Its spots among the largest of all, for which remedies were sought; the `/missed` listing has every spot.
    #[serde(default)]
    pub largest: Vec<TreatedSpotDocument>,
}

/// A spot with its remedy.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct TreatedSpotDocument {
    /// Missed area in it.
    pub area_mm2: f64,
    /// Its area-weighted centre, part frame.
    pub centre_mm: [f64; 3],
    /// Size of the box around it along the part's axes.
    pub extent_mm: [f64; 3],
    /// Remedy of the spot.
    pub remedy: RemedyDocument,
}

/// The cheapest remedy of a missed spot that was tried and works, or that none does.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct RemedyDocument {
    /// `view` (choose candidates that were left out), `roll`, `tilt`, `standoff`, `setup` (lay the part another way),
    /// `limit` (raise limits of incidence), or `none`.
    pub kind: String,
    /// In a sentence.
    pub text: String,
    /// The views that it takes, best first; to apply them, put their poses into `candidates.poses`.
    pub views: Vec<RemedyViewDocument>,
    /// Pose in which the part has to rest, if so, for `part.table_from_part` or `part.resting_poses`.
    #[serde(default)]
    pub table_from_part: Option<PoseSpec>,
    /// Value that `limits.camera_deg` has to be raised to, if so.
    pub camera_deg: Option<f64>,
    /// Value that `limits.projector_deg` has to be raised to, if so.
    pub projector_deg: Option<f64>,
    /// Area of the spot that the views together measure.
    pub area_mm2: f64,
    /// Share of the spot that the views together measure; a remedy works from 0.5 on.
    pub of_spot: f64,
    /// Views that were tried for the spot.
    pub tried: usize,
}

/// A view of a remedy.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct RemedyViewDocument {
    /// The candidate that it was made from.
    pub candidate: u32,
    /// Turned about the viewing axis against it.
    pub roll_deg: f64,
    /// Angle between the viewing axes of the two.
    pub tilt_deg: f64,
    /// Depth of the spot's centre along the viewing axis.
    pub standoff_mm: f64,
    /// The view.
    pub part_from_scanner: PoseSpec,
    /// Area of the spot that it adds to those before it.
    pub area_mm2: f64,
}

impl From<&MissedCause> for MissedDocument {
    fn from(missed: &MissedCause) -> Self {
        let largest = missed.spots.first();
        Self {
            reason: missed.cause.as_str().to_owned(),
            area_mm2: missed.area_mm2,
            spots: missed.spots.len(),
            centre_mm: largest.map_or([0.0; 3], |spot| spot.centre_mm.into()),
            remedy: largest.and_then(|spot| spot.remedy.as_ref()).map(RemedyDocument::from),
            largest: missed.spots.iter().filter_map(treated_spot).collect(),
        }
    }
}

fn treated_spot(spot: &MissedSpot) -> Option<TreatedSpotDocument> {
    spot.remedy.as_ref().map(|remedy| TreatedSpotDocument {
        area_mm2: spot.area_mm2,
        centre_mm: spot.centre_mm.into(),
        extent_mm: spot.extent_mm.into(),
        remedy: RemedyDocument::from(remedy),
    })
}

impl From<&Remedy> for RemedyDocument {
    fn from(remedy: &Remedy) -> Self {
        let view = |view: &RemedyView| RemedyViewDocument {
            candidate: view.candidate.0,
            roll_deg: degrees(view.roll_rad),
            tilt_deg: degrees(view.tilt_rad),
            standoff_mm: view.standoff_mm,
            part_from_scanner: PoseSpec::from(&view.part_from_scanner),
            area_mm2: view.area_mm2,
        };
        Self {
            kind: remedy.kind.as_str().to_owned(),
            text: remedy.sentence(),
            views: remedy.views.iter().map(view).collect(),
            table_from_part: remedy.table_from_part.as_ref().map(PoseSpec::from),
            camera_deg: remedy.camera_deg,
            projector_deg: remedy.projector_deg,
            area_mm2: remedy.area_mm2,
            of_spot: remedy.of_spot,
            tried: remedy.tried,
        }
    }
}
