//! `plan.json`, schema `vantage.plan/1`. No clock, no thread count: the same input gives the same bytes.

mod coverage;
mod missed;
mod motion;

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

pub use coverage::{
    CoverageDocument, DrawnDocument, GradesDocument, IndependentDocument, MisplacedDocument, RegionCoverageDocument,
    RobustDocument,
};
pub use missed::{MissedDocument, RemedyDocument, RemedyViewDocument, TreatedSpotDocument};
pub use motion::{MotionDocument, ObstructionDocument};

use super::angle::degrees;
use super::echo::Echo;
use crate::cell::{OpticalDevice, PoseSpec, Scanner};
use crate::planning::params::PlanParams;
use crate::planning::plan::{Bound, Cause, Outcome, Plan, PlannedView, SetupPlan};

/// Schema name that the document carries.
pub const PLAN_SCHEMA: &str = "vantage.plan/1";

/// The whole document.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct PlanDocument {
    /// `vantage.plan/1`.
    pub schema: String,
    /// Version of the planner.
    pub version: String,
    /// Labels, part number and serial as given with the job.
    #[serde(flatten)]
    pub echo: Echo,
    /// The planned part.
    pub part: PartDocument,
    /// The scanner planned for.
    pub scanner: ScannerDocument,
    /// The cell, `null` for viewpoints alone.
    pub cell: Option<CellDocument>,
    /// Every knob that was in force.
    pub params: PlanParams,
    /// Numbers of candidates.
    pub candidates: CandidatesDocument,
    /// Area that the chosen views measure.
    pub coverage: CoverageDocument,
    /// The ways in which the part lies while views are taken, where there are several; `program.json` is that of the first,
    /// `program-2.json` that of the second, and so on.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub setups: Vec<SetupDocument>,
    /// The chosen views, in the order chosen.
    pub viewpoints: Vec<ViewpointDocument>,
    /// Viewpoint ids in the order visited, setup by setup.
    pub sequence: Vec<u32>,
    /// Time of a cycle; `null` without a cell.
    #[serde(default)]
    pub motion: Option<MotionDocument>,
    /// Pairs of bodies that keep the cell from candidates, the one that keeps it from most first.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub obstructions: Vec<ObstructionDocument>,
    /// Missed area by cause.
    pub missed: Vec<MissedDocument>,
    /// Bound on the views of any choice from the same candidates.
    pub bound: BoundDocument,
    /// `target`, `growth`, `max_views` or `no_gain`.
    pub stopped_because: String,
}

/// Facts of the part.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct PartDocument {
    /// SHA-256 of the file.
    pub sha256: String,
    /// Triangles planned on.
    pub triangles: usize,
    /// Surface area.
    pub area_mm2: f64,
    /// Bounding box, part frame.
    pub bbox_mm: BoxDocument,
}

/// An axis-aligned box.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct BoxDocument {
    /// Lowest corner.
    pub min: [f64; 3],
    /// Highest corner.
    pub max: [f64; 3],
}

/// The scanner with everything that an independent check of visibility needs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct ScannerDocument {
    /// Name of its specification.
    pub name: String,
    /// Working depth.
    pub depth_mm: DepthDocument,
    /// Left camera, right camera, projector.
    pub devices: Vec<DeviceDocument>,
}

/// Working depth along +z of the scanner.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct DepthDocument {
    /// Nearest.
    pub near: f64,
    /// Best focus.
    pub best: f64,
    /// Farthest.
    pub far: f64,
}

/// One optical device.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct DeviceDocument {
    /// `left`, `right` or `projector`.
    pub name: String,
    /// Its pose.
    pub scanner_from_device: PoseSpec,
    /// Image width.
    pub width_px: u32,
    /// Image height.
    pub height_px: u32,
    /// Focal length along u, pixels.
    pub fx: f64,
    /// Focal length along v, pixels.
    pub fy: f64,
    /// Principal point, u, pixels.
    pub cx: f64,
    /// Principal point, v, pixels.
    pub cy: f64,
    /// Bouguet's α.
    pub skew: f64,
    /// k1, k2, p1, p2, k3.
    pub distortion: [f64; 5],
    /// Largest incidence in force.
    pub incidence_max_deg: f64,
}

/// The cell in force.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct CellDocument {
    /// Name of its specification.
    pub name: String,
    /// Turntable in the robot's base.
    pub base_from_table: PoseSpec,
    /// Part on the table.
    pub table_from_part: PoseSpec,
    /// Scanner on the flange.
    pub flange_from_scanner: PoseSpec,
    /// Name of the robot's specification.
    pub robot: String,
    /// Name of the turntable's specification.
    pub turntable: String,
}

/// Views and area of one setup.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct SetupDocument {
    /// Pose of the part in this setup.
    pub table_from_part: PoseSpec,
    /// Ids of the viewpoints taken.
    pub viewpoints: Vec<u32>,
    /// Asked area that some kept candidate of this setup measures.
    pub coverable_area_mm2: f64,
    /// Asked area that its viewpoints measure.
    pub measured_area_mm2: f64,
}

fn setups(plan: &Plan) -> Vec<SetupDocument> {
    let document = |setup: &SetupPlan| SetupDocument {
        table_from_part: PoseSpec::from(&setup.table_from_part),
        viewpoints: setup.views.iter().map(|view| view.0).collect(),
        coverable_area_mm2: setup.coverable_area_mm2,
        measured_area_mm2: setup.measured_area_mm2,
    };
    if plan.setups.len() > 1 { plan.setups.iter().map(document).collect() } else { Vec::new() }
}

/// Numbers of candidates.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct CandidatesDocument {
    /// Generated.
    pub generated: usize,
    /// Kept for selection.
    pub kept: usize,
    /// Dropped, by reason.
    pub rejected: BTreeMap<String, usize>,
}

/// One chosen view.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct ViewpointDocument {
    /// Number in the order chosen, from 0.
    pub id: u32,
    /// Number of the candidate.
    pub candidate: u32,
    /// `top`, `bottom`, `right`, `back`, `left` or `front`.
    pub label: String,
    /// Its pose.
    pub part_from_scanner: PoseSpec,
    /// Share of the asked area that it added when chosen.
    pub gain_of_asked: f64,
    /// Its score when chosen, mm².
    pub score: f64,
    /// Station from which the cell takes it.
    pub station: Option<StationDocument>,
    /// Cause for which it measures nothing, if so.
    pub rejected: Option<String>,
}

/// Table angle and joints, degrees.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct StationDocument {
    /// Table angle.
    pub table_angle_deg: f64,
    /// Joints 1 to 6.
    pub joints_deg: [f64; 6],
    /// Arm configuration: shoulder, elbow and wrist, such as `front, elbow up, no flip`.
    #[serde(default)]
    pub posture: String,
    /// Distance from a singularity: smallest singular value of the flange's Jacobian, lengths in parts of the arm's; 0 at one.
    #[serde(default)]
    pub singularity_margin: f64,
    /// Distance of the two bodies that are nearest to each other, mm; `null` where that is more than 200 mm.
    #[serde(default)]
    pub clearance_mm: Option<f64>,
}

/// Bound on the views of any choice. It holds for the candidates that could be chosen, without what is
/// asked of overlap, time and quality.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct BoundDocument {
    /// No plan over the same candidates reaches the goals with fewer views; where the plan does not reach one, as much of
    /// it as the plan measures.
    pub views_lower: u32,
    /// Views chosen minus `views_lower`; 0: proved fewest.
    pub gap: u32,
    /// With `selection.goal` `best_coverage`: no choice of `selection.max_views` views measures a larger share.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub of_asked_upper: Option<f64>,
    /// `of_asked_upper` minus the share that the chosen views measure; 0: proved best.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gap_of_asked: Option<f64>,
}

impl From<&Bound> for BoundDocument {
    fn from(bound: &Bound) -> Self {
        let Bound { views_lower, gap, of_asked_upper, gap_of_asked } = *bound;
        Self { views_lower, gap, of_asked_upper, gap_of_asked }
    }
}

impl PlanDocument {
    /// The document of an outcome.
    #[must_use]
    pub fn new(outcome: &Outcome, scanner: &Scanner, cell: Option<CellDocument>, echo: Echo) -> Self {
        let plan = &outcome.plan;
        let sequence = plan.visits().map(|(view, _)| view.0).collect();
        Self {
            schema: PLAN_SCHEMA.to_owned(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            echo,
            part: part(plan),
            scanner: scanner_document(scanner, &plan.params),
            cell,
            params: plan.params.clone(),
            candidates: CandidatesDocument {
                generated: plan.candidates.generated,
                kept: plan.candidates.kept,
                rejected: plan.candidates.rejected.iter().map(|(reason, n)| (reason.as_str().to_owned(), *n)).collect(),
            },
            coverage: CoverageDocument::from(&plan.coverage),
            setups: setups(plan),
            viewpoints: plan.views.iter().map(ViewpointDocument::from).collect(),
            sequence,
            motion: MotionDocument::of(plan),
            obstructions: plan.obstructions.iter().map(ObstructionDocument::from).collect(),
            missed: plan.missed.iter().map(MissedDocument::from).collect(),
            bound: BoundDocument::from(&plan.bound),
            stopped_because: plan.stopped_because.as_str().to_owned(),
        }
    }

    /// The file's bytes: indented JSON with a newline at the end. `plan_sha256` is over these.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        super::json_file_bytes(self)
    }
}

fn part(plan: &Plan) -> PartDocument {
    PartDocument {
        sha256: plan.part.sha256.clone(),
        triangles: plan.part.triangles,
        area_mm2: plan.part.area_mm2,
        bbox_mm: BoxDocument { min: plan.part.aabb.min.into(), max: plan.part.aabb.max.into() },
    }
}

fn scanner_document(scanner: &Scanner, params: &PlanParams) -> ScannerDocument {
    let limits = [params.limits.camera_deg, params.limits.camera_deg, params.limits.projector_deg];
    ScannerDocument {
        name: scanner.name.clone(),
        depth_mm: DepthDocument { near: scanner.near_mm, best: scanner.best_mm, far: scanner.far_mm },
        devices: scanner.devices.iter().zip(limits).map(|(device, limit)| device_document(device, limit)).collect(),
    }
}

fn device_document(device: &OpticalDevice, limit_deg: Option<f64>) -> DeviceDocument {
    let lens = &device.lens;
    DeviceDocument {
        name: device.name.as_str().to_owned(),
        scanner_from_device: PoseSpec::from(&device.scanner_from_device),
        width_px: lens.width_px as u32,
        height_px: lens.height_px as u32,
        fx: lens.fx,
        fy: lens.fy,
        cx: lens.cx,
        cy: lens.cy,
        skew: lens.skew,
        distortion: lens.distortion,
        incidence_max_deg: limit_deg.unwrap_or_else(|| degrees(device.incidence_max_rad)),
    }
}

impl From<&PlannedView> for ViewpointDocument {
    fn from(view: &PlannedView) -> Self {
        Self {
            id: view.id.0,
            candidate: view.candidate.0,
            label: view.label.as_str().to_owned(),
            part_from_scanner: PoseSpec::from(&view.part_from_scanner),
            gain_of_asked: view.gain_of_asked,
            score: view.score,
            station: view.station.zip(view.stance).map(|(station, stance)| StationDocument {
                table_angle_deg: degrees(station.table_angle_rad),
                joints_deg: station.joints_rad.map(degrees),
                posture: stance.posture.to_string(),
                singularity_margin: stance.singularity_margin,
                clearance_mm: stance.clearance_mm,
            }),
            rejected: view.rejected.map(|cause: Cause| cause.as_str().to_owned()),
        }
    }
}
