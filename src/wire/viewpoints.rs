//! Listing of the chosen views: `viewpoints.json`, schema `vantage.viewpoints/1`, and `viewpoints.csv`, one row per view
//! in the order chosen.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::csv::Csv;
use super::plan::ViewpointDocument;
use super::schema_name::schema_name;
use crate::planning::plan::{Plan, ViewId};

/// Schema name in the document.
pub const VIEWPOINTS_SCHEMA: &str = "vantage.viewpoints/1";

schema_name!(ViewpointsSchema, VIEWPOINTS_SCHEMA);

const HEADER: [&str; 24] = [
    "id",
    "candidate",
    "label",
    "x_mm",
    "y_mm",
    "z_mm",
    "qx",
    "qy",
    "qz",
    "qw",
    "gain_of_asked",
    "score",
    "visit",
    "table_angle_deg",
    "j1_deg",
    "j2_deg",
    "j3_deg",
    "j4_deg",
    "j5_deg",
    "j6_deg",
    "move_secs",
    "via_points",
    "rejected",
    "plan_sha256",
];

/// The chosen views (`viewpoints.json`).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ViewpointsDocument {
    /// Schema name, `vantage.viewpoints/1`.
    #[schema(value_type = ViewpointsSchema)]
    pub schema: String,
    /// SHA-256 of the bytes of `plan.json`; empty in files of earlier releases.
    #[serde(default)]
    pub plan_sha256: String,
    /// The chosen views, in the order chosen.
    pub viewpoints: Vec<ViewpointDocument>,
    /// Ids of the viewpoints in the order visited; empty without a cell.
    pub sequence: Vec<u32>,
}

/// Lists the chosen views of a plan; `plan_sha256` is the hash of its file.
#[must_use]
pub fn json(plan: &Plan, plan_sha256: &str) -> ViewpointsDocument {
    ViewpointsDocument {
        schema: VIEWPOINTS_SCHEMA.to_owned(),
        plan_sha256: plan_sha256.to_owned(),
        viewpoints: plan.views.iter().map(ViewpointDocument::from).collect(),
        sequence: plan.visits().map(|(view, _)| view.0).collect(),
    }
}

/// The listing as a table. The pose is `part_from_scanner`; `visit` counts from 0 in the order visited; `move_secs` and
/// `via_points` belong to the move to the view. Cells without a value are empty. The last column names the plan in every row: a
/// table has no comments.
#[must_use]
pub fn csv(plan: &Plan, plan_sha256: &str) -> String {
    let mut csv = Csv::new(&HEADER);
    for (view, planned) in json(plan, plan_sha256).viewpoints.iter().zip(&plan.views) {
        csv.number(view.id);
        csv.number(view.candidate);
        csv.text(&view.label);
        let pose = &view.part_from_scanner;
        pose.translation_mm.iter().chain(&pose.quaternion_xyzw).for_each(|value| csv.number(value));
        csv.number(view.gain_of_asked);
        csv.number(view.score);
        let visit = visit(plan, planned.id);
        csv.optional(visit.map(|(position, ..)| position));
        csv.optional(view.station.as_ref().map(|station| station.table_angle_deg));
        (0..6).for_each(|joint| csv.optional(view.station.as_ref().map(|station| station.joints_deg[joint])));
        csv.optional(visit.map(|(_, secs, _)| secs));
        csv.optional(visit.map(|(.., points)| points));
        csv.text(view.rejected.as_deref().unwrap_or(""));
        csv.number(plan_sha256);
        csv.end_row();
    }
    csv.finish()
}

/// Position in the order visited, and duration and number of via points of the move to the view.
fn visit(plan: &Plan, view: ViewId) -> Option<(usize, f64, usize)> {
    let (position, (_, leg)) = plan.visits().enumerate().find(|(_, (visited, _))| *visited == view)?;
    Some((position, leg.duration_secs, leg.via_rad.len()))
}
