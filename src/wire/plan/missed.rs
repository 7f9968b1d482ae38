//! Missed surface in `plan.json`: by cause, its largest spots, and their remedies.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::advice::TurnDocument;
use crate::cell::PoseSpec;
use crate::planning::plan::{MissedCause, MissedSpot, Remedy, RemedyView};
use crate::wire::angle::degrees;
use crate::wire::words::{ChoiceRules, fix_sentence};

/// Area missed for one cause.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct MissedDocument {
    /// Cause for which the area is missed.
    #[schema(value_type = crate::planning::verdict::Cause)]
    pub reason: String,
    /// Missed area.
    pub area_mm2: f64,
    /// Number of connected spots.
    pub spots: usize,
    /// Centre of the largest spot, part frame.
    pub centre_mm: [f64; 3],
    /// Remedy for the largest spot, or kind `none`; `null` if none was searched for.
    pub remedy: Option<RemedyDocument>,
    /// Spots of this cause among the largest of all, for which remedies were searched; the `/missed` listing has every spot.
    #[serde(default)]
    pub largest: Vec<TreatedSpotDocument>,
}

/// A missed spot with its remedy.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct TreatedSpotDocument {
    /// Missed area of the spot.
    pub area_mm2: f64,
    /// Area-weighted centre of the spot, part frame.
    pub centre_mm: [f64; 3],
    /// Size of its bounding box along the part's axes.
    pub extent_mm: [f64; 3],
    /// Remedy for the spot.
    pub remedy: RemedyDocument,
}

/// Cheapest remedy for a missed spot that was simulated and works: it measures at least 90 % of the spot. Else the cheapest that
/// measures at least half; else kind `none`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct RemedyDocument {
    /// Kind of remedy.
    #[schema(value_type = crate::planning::plan::RemedyKind)]
    pub kind: String,
    /// Description in one sentence; of a remedy that does not work it begins with the share of the spot that it measures.
    pub text: String,
    /// Views of the remedy, best first; to apply it, put their poses into `candidates.poses`.
    pub views: Vec<RemedyViewDocument>,
    /// Pose that the part has to rest in, for `part.table_from_part` or `part.resting_poses`; `null` if it need not be moved.
    #[serde(default)]
    pub table_from_part: Option<PoseSpec>,
    /// Turn into that pose from the first setup; `null` if the part need not be moved.
    #[serde(default)]
    pub turn: Option<TurnDocument>,
    /// Value that `limits.camera_deg` has to be raised to, at most the own limit of each camera; `null` if it need not be.
    pub camera_deg: Option<f64>,
    /// Value that `limits.projector_deg` has to be raised to, at most the projector's own limit; `null` if it need not be.
    pub projector_deg: Option<f64>,
    /// Area of the spot that the views measure together.
    pub area_mm2: f64,
    /// Share of the spot that the views measure together: at least 0.5, and 0 with kind `none`; a remedy works from 0.9 on.
    pub of_spot: f64,
    /// Number of views tried for the spot.
    pub tried: usize,
}

/// A view of a remedy.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct RemedyViewDocument {
    /// Number of the candidate that the view was made from.
    pub candidate: u32,
    /// Rotation about the viewing axis relative to that candidate.
    pub roll_deg: f64,
    /// Angle between the viewing axes of the view and that candidate.
    pub tilt_deg: f64,
    /// Depth of the spot's centre along the viewing axis.
    pub standoff_mm: f64,
    /// Pose of the scanner in the part frame.
    pub part_from_scanner: PoseSpec,
    /// Area of the spot that the view adds to those before it.
    pub area_mm2: f64,
}

impl MissedDocument {
    /// Describes area missed by a plan whose views were chosen by these rules.
    pub(crate) fn of(missed: &MissedCause, rules: ChoiceRules) -> Self {
        let largest = missed.spots.first();
        Self {
            reason: missed.cause.as_str().to_owned(),
            area_mm2: missed.area_mm2,
            spots: missed.spots.len(),
            centre_mm: largest.map_or([0.0; 3], |spot| spot.centre_mm.into()),
            remedy: largest.and_then(|spot| spot.remedy.as_ref()).map(|remedy| RemedyDocument::of(remedy, rules)),
            largest: missed.spots.iter().filter_map(|spot| treated_spot(spot, rules)).collect(),
        }
    }
}

fn treated_spot(spot: &MissedSpot, rules: ChoiceRules) -> Option<TreatedSpotDocument> {
    spot.remedy.as_ref().map(|remedy| TreatedSpotDocument {
        area_mm2: spot.area_mm2,
        centre_mm: spot.centre_mm.into(),
        extent_mm: spot.extent_mm.into(),
        remedy: RemedyDocument::of(remedy, rules),
    })
}

/// An angle that may come from a device in radians, rounded as [`degrees`] does.
fn rounded_deg(angle_deg: f64) -> f64 {
    degrees(angle_deg.to_radians())
}

impl RemedyDocument {
    /// Describes a remedy for a spot of a plan whose views were chosen by these rules.
    pub(crate) fn of(remedy: &Remedy, rules: ChoiceRules) -> Self {
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
            text: fix_sentence(remedy, rules),
            views: remedy.views.iter().map(view).collect(),
            table_from_part: remedy.table_from_part.as_ref().map(PoseSpec::from),
            turn: remedy.turn.as_ref().map(TurnDocument::from),
            camera_deg: remedy.camera_deg.map(rounded_deg),
            projector_deg: remedy.projector_deg.map(rounded_deg),
            area_mm2: remedy.area_mm2,
            of_spot: remedy.of_spot,
            tried: remedy.tried,
        }
    }
}
