//! `missed.json`, schema `vantage.missed/1`: missed surface by cause, down to the faces of the uploaded file.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::plan::{MissedDocument, RemedyDocument};
use super::schema_name::schema_name;
use super::total::total;
use super::words::ChoiceRules;
use crate::planning::plan::{MissedCause, MissedSpot, Plan};

/// Schema name in the document.
pub const MISSED_SCHEMA: &str = "vantage.missed/1";

schema_name!(MissedSchema, MISSED_SCHEMA);

/// Missed surface by cause, with every spot (`missed.json`).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct MissedListing {
    /// Schema name, `vantage.missed/1`.
    #[schema(value_type = MissedSchema)]
    pub schema: String,
    /// SHA-256 of the bytes of `plan.json`; empty in files of earlier releases.
    #[serde(default)]
    pub plan_sha256: String,
    /// Area asked for: all faces outside excluded regions.
    pub asked_area_mm2: f64,
    /// Part of the asked area that no chosen view measures.
    pub missed_area_mm2: f64,
    /// Missed area of each cause, as in the plan, with its spots.
    pub missed: Vec<MissedEntry>,
}

/// Area missed for one cause, with its spots.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct MissedEntry {
    /// Summary, as in the plan.
    #[serde(flatten)]
    pub summary: MissedDocument,
    /// Connected spots, largest first.
    pub listing: Vec<SpotDocument>,
}

/// A connected patch of surface missed for one cause.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SpotDocument {
    /// Missed area of the spot.
    pub area_mm2: f64,
    /// Area-weighted centre of the spot, part frame.
    pub centre_mm: [f64; 3],
    /// Size of its bounding box along the part's axes.
    pub extent_mm: [f64; 3],
    /// Faces of the uploaded file that the spot touches, ascending.
    pub faces: Vec<u32>,
    /// Remedy for the spot; `null` if none was searched for.
    pub remedy: Option<RemedyDocument>,
}

/// Lists the missed surface of a plan; `plan_sha256` is the hash of its file.
#[must_use]
pub fn json(plan: &Plan, plan_sha256: &str) -> MissedListing {
    MissedListing {
        schema: MISSED_SCHEMA.to_owned(),
        plan_sha256: plan_sha256.to_owned(),
        asked_area_mm2: plan.coverage.asked_area_mm2,
        missed_area_mm2: total(plan.missed.iter().map(|missed| missed.area_mm2)),
        missed: plan.missed.iter().map(|missed| MissedEntry::of(missed, ChoiceRules::of(plan))).collect(),
    }
}

impl MissedEntry {
    fn of(missed: &MissedCause, rules: ChoiceRules) -> Self {
        let listing = missed.spots.iter().map(|spot| SpotDocument::of(spot, rules)).collect();
        Self { summary: MissedDocument::of(missed, rules), listing }
    }
}

impl SpotDocument {
    fn of(spot: &MissedSpot, rules: ChoiceRules) -> Self {
        Self {
            area_mm2: spot.area_mm2,
            centre_mm: spot.centre_mm.into(),
            extent_mm: spot.extent_mm.into(),
            faces: spot.source_faces.clone(),
            remedy: spot.remedy.as_ref().map(|remedy| RemedyDocument::of(remedy, rules)),
        }
    }
}
