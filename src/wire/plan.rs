//! `plan.json`, schema `vantage.plan/1`. It depends on neither clock nor thread count: the same input gives the same bytes.

mod advice;
mod at_risk;
mod coverage;
mod exposure;
mod missed;
mod motion;
mod regions;
mod registration;

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::Value;
use utoipa::ToSchema;

pub(crate) use advice::options;
pub use advice::{AdviceDocument, AdvisedSetupDocument, TurnDocument};
pub use at_risk::{AtRiskDocument, RiskReasonDocument};
pub use coverage::{
    CoverageDocument, DrawnDocument, GradesDocument, IndependentDocument, MisplacedDocument, RobustDocument,
    VisibleSharesDocument,
};
pub use exposure::{ExposureLossDocument, ViewExposureDocument};
pub use missed::{MissedDocument, RemedyDocument, RemedyViewDocument, TreatedSpotDocument};
pub use motion::{MotionDocument, ObstructionDocument};
pub use regions::{RegionCoverageDocument, RegionMissDocument};
pub use registration::{SetupLinkDocument, StabilityDocument, ViewLinkDocument};

use super::angle::degrees;
use super::echo::Echo;
use super::part_size::size_text;
use super::schema_name::schema_name;
use super::warnings::{self, FieldWarning};
use super::words::ChoiceRules;
use crate::cell::{CalibratedScannerSpec, CalibrationProvenance, FieldError, OpticalDevice, PoseSpec, Scanner};
use crate::geometry::Mesh;
use crate::planning::params::{LimitParams, PlanParams};
use crate::planning::plan::{Bound, Cause, ChosenOn, Outcome, Plan, PlannedView, SetupId, SetupPlan};

/// Schema name in the document.
pub const PLAN_SCHEMA: &str = "vantage.plan/1";

schema_name!(PlanSchema, PLAN_SCHEMA);

/// A plan (`plan.json`).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct PlanDocument {
    /// Schema name, `vantage.plan/1`.
    #[schema(value_type = PlanSchema)]
    pub schema: String,
    /// Version of the planner.
    pub version: String,
    /// Labels, part number and serial number, as given with the job.
    #[serde(flatten)]
    pub echo: Echo,
    /// The planned part.
    pub part: PartDocument,
    /// The fixture that the part was planned with; absent without one, and in plans of earlier releases, which name it in
    /// `params.part.fixture_mesh` alone.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fixture: Option<FixtureDocument>,
    /// The scanner that was planned for.
    pub scanner: ScannerDocument,
    /// The cell; `null` for a plan of viewpoints only.
    pub cell: Option<CellDocument>,
    /// Planning parameters, with defaults filled in. `limits.camera_deg` stays `null` if the job gave none and the cameras' own
    /// limits differ; `scanner.devices` has the limit of each device.
    pub params: PlanParams,
    /// Numbers of candidates.
    pub candidates: CandidatesDocument,
    /// Coverage by the chosen views.
    pub coverage: CoverageDocument,
    /// Setups, if there are several: placements of the part in which views are taken. `program.json` belongs to the first setup,
    /// `program-2.json` to the second, and so on.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub setups: Vec<SetupDocument>,
    /// Registration of every two setups to each other by the surface that both measure. Measurements of a part that is turned
    /// over form one measurement only if that surface constrains all six degrees of freedom, or if markers or a fixture do
    /// (`params.registration`).
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub setup_links: Vec<SetupLinkDocument>,
    /// The weakest link between the views of each setup.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub view_links: Vec<ViewLinkDocument>,
    /// The chosen views, in the order chosen.
    pub viewpoints: Vec<ViewpointDocument>,
    /// Viewpoint ids in the order visited, setup by setup.
    pub sequence: Vec<u32>,
    /// Cycle time and its components; `null` without a cell.
    #[serde(default)]
    pub motion: Option<MotionDocument>,
    /// Pairs of bodies whose collisions keep the cell from reaching candidates, the pair that blocks most first.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub obstructions: Vec<ObstructionDocument>,
    /// Missed area by cause.
    pub missed: Vec<MissedDocument>,
    /// Advice on the plan as a whole, what measures most first.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub advice: Vec<AdviceDocument>,
    /// Warnings on what the plan does not reach or tolerate.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<FieldWarning>,
    /// Samples that views were chosen on; absent in plans of earlier releases.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub chosen_on: Option<ChosenOnDocument>,
    /// Bounds on the best selection from the same candidates.
    pub bound: BoundDocument,
    /// Rule that ended the selection.
    #[schema(value_type = crate::planning::selection::StopReason)]
    pub stopped_because: String,
}

/// The planned part.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct PartDocument {
    /// SHA-256 of the mesh file.
    pub sha256: String,
    /// Number of triangles planned on.
    pub triangles: usize,
    /// Surface area.
    pub area_mm2: f64,
    /// Bounding box, part frame.
    pub bbox_mm: BoxDocument,
}

impl PartDocument {
    /// Returns what differs where a mesh of these triangles has another size: the part as read in another unit.
    #[must_use]
    pub fn other_size(&self, mesh: &Mesh) -> Option<String> {
        self.bbox_mm.other_size("part", mesh)
    }
}

/// The fixture that holds the part.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct FixtureDocument {
    /// SHA-256 of the mesh file.
    pub sha256: String,
    /// Bounding box, part frame.
    pub bbox_mm: BoxDocument,
}

impl FixtureDocument {
    /// Builds the document of a fixture; `sha256` is that of its file.
    #[must_use]
    pub fn new(mesh: &Mesh, sha256: &str) -> Self {
        let aabb = mesh.aabb();
        Self { sha256: sha256.to_owned(), bbox_mm: BoxDocument { min: aabb.min.into(), max: aabb.max.into() } }
    }

    /// Returns what differs where a mesh of these triangles has another size: the fixture as read in another unit.
    #[must_use]
    pub fn other_size(&self, mesh: &Mesh) -> Option<String> {
        self.bbox_mm.other_size("fixture", mesh)
    }
}

/// Axis-aligned bounding box.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct BoxDocument {
    /// Lowest corner.
    pub min: [f64; 3],
    /// Highest corner.
    pub max: [f64; 3],
}

impl BoxDocument {
    /// Size of the box along x, y and z, mm.
    #[must_use]
    pub fn extent_mm(&self) -> [f64; 3] {
        [0, 1, 2].map(|axis| self.max[axis] - self.min[axis])
    }

    /// Returns what differs where a mesh has another size than this box of the planned `what`.
    fn other_size(&self, what: &str, mesh: &Mesh) -> Option<String> {
        /// Relative tolerance of a box that went through a file.
        const SAME: f64 = 1e-6;
        let (found, planned) = (mesh.aabb().extent_mm(), self.extent_mm());
        let differs = (0..3).any(|axis| (found[axis] - planned[axis]).abs() > SAME * planned[axis].max(1.0));
        differs.then(|| format!("is {} as read; the planned {what} is {}", size_text(&found.into()), size_text(&planned)))
    }
}

/// The scanner, with all data that an independent check of visibility needs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct ScannerDocument {
    /// Name of the scanner specification.
    pub name: String,
    /// Working depth.
    pub depth_mm: DepthDocument,
    /// Left camera, right camera and projector, in this order.
    pub devices: Vec<DeviceDocument>,
    /// Provenance of lenses and poses; present if they were calibrated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub calibrated: Option<CalibratedScannerSpec>,
}

/// Working depth along +z of the scanner frame, mm.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct DepthDocument {
    /// Nearest depth.
    pub near: f64,
    /// Depth of best focus.
    pub best: f64,
    /// Farthest depth.
    pub far: f64,
}

/// A camera or the projector.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct DeviceDocument {
    /// `left`, `right` or `projector`.
    #[schema(value_type = crate::cell::DeviceName)]
    pub name: String,
    /// Pose of the device in the scanner frame.
    pub scanner_from_device: PoseSpec,
    /// Width of the image.
    pub width_px: u32,
    /// Height of the image.
    pub height_px: u32,
    /// Focal length along u, pixels.
    pub fx: f64,
    /// Focal length along v, pixels.
    pub fy: f64,
    /// Principal point, u, pixels from the outer corner of the first pixel.
    pub cx: f64,
    /// Principal point, v, pixels from that corner.
    pub cy: f64,
    /// Skew coefficient α (Bouguet).
    pub skew: f64,
    /// Distortion coefficients k1, k2, p1, p2, k3 (Bouguet).
    pub distortion: [f64; 5],
    /// Max angle of incidence in force: the device's own or the job's, whichever is tighter.
    pub incidence_max_deg: f64,
    /// Max angle of incidence of the device itself; present if the job's is tighter. Grades refer to that of the projector.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub incidence_own_deg: Option<f64>,
    /// Nearest distance in focus along the optical axis, mm; present if depth of field limits it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub in_focus_from_mm: Option<f64>,
    /// Farthest distance in focus along the optical axis, mm; present if depth of field limits it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub in_focus_to_mm: Option<f64>,
}

/// The cell.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct CellDocument {
    /// Name of the cell specification.
    pub name: String,
    /// Pose of the turntable in the robot's base frame.
    pub base_from_table: PoseSpec,
    /// Pose of the part in the table frame.
    pub table_from_part: PoseSpec,
    /// Pose of the scanner in the flange frame.
    pub flange_from_scanner: PoseSpec,
    /// Name of the robot specification.
    pub robot: String,
    /// Name of the turntable specification.
    pub turntable: String,
    /// Calibration that the poses were taken from; absent where they were typed in.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub calibrated: Option<CalibrationProvenance>,
}

/// Views and area of one setup.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct SetupDocument {
    /// Pose of the part on the table in this setup.
    pub table_from_part: PoseSpec,
    /// Turn into this pose from that of the first setup; absent in the first setup.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub turn: Option<TurnDocument>,
    /// Ids of the viewpoints taken in this setup.
    pub viewpoints: Vec<u32>,
    /// Asked area that at least one kept candidate of this setup measures.
    pub coverable_area_mm2: f64,
    /// Asked area that the viewpoints of this setup measure.
    pub measured_area_mm2: f64,
}

fn setups(plan: &Plan) -> Vec<SetupDocument> {
    let document = |(id, setup): (SetupId, &SetupPlan)| SetupDocument {
        table_from_part: PoseSpec::from(&setup.table_from_part),
        turn: plan.turn_into(id).as_ref().map(TurnDocument::from),
        viewpoints: setup.views.iter().map(|view| view.0).collect(),
        coverable_area_mm2: setup.coverable_area_mm2,
        measured_area_mm2: setup.measured_area_mm2,
    };
    if plan.setups.len() > 1 { SetupId::number(&plan.setups).map(document).collect() } else { Vec::new() }
}

/// Numbers of candidates.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct CandidatesDocument {
    /// Candidates generated.
    pub generated: usize,
    /// Candidates kept for selection.
    pub kept: usize,
    /// Candidates rejected, by reason.
    #[schema(value_type = BTreeMap<crate::planning::candidates::Rejection, usize>)]
    pub rejected: BTreeMap<String, usize>,
}

/// A chosen view.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct ViewpointDocument {
    /// Id: its number in the order chosen, from 0.
    pub id: u32,
    /// Number of the candidate that was chosen.
    pub candidate: u32,
    /// Side of the part that it looks at.
    #[schema(value_type = crate::planning::candidates::Label)]
    pub label: String,
    /// Pose of the scanner in the part frame.
    pub part_from_scanner: PoseSpec,
    /// Share of the asked area that it added when chosen.
    pub gain_of_asked: f64,
    /// Score when it was chosen, mm².
    pub score: f64,
    /// Station from which the cell takes the view; `null` without a cell or if the view is rejected.
    pub station: Option<StationDocument>,
    /// Cause for which the view is rejected and measures nothing; `null` if it is not.
    #[schema(value_type = Option<crate::planning::verdict::Cause>)]
    pub rejected: Option<String>,
    /// Brightness of its captures; present where `params.materials` or `params.scan.brightness` asks for it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub exposure: Option<ViewExposureDocument>,
}

/// Table angle and joint angles at which a view is taken.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct StationDocument {
    /// Table angle, degrees.
    pub table_angle_deg: f64,
    /// Angles of joints 1 to 6, degrees.
    pub joints_deg: [f64; 6],
    /// Arm configuration: shoulder, elbow and wrist, such as `front, elbow up, no flip`.
    #[serde(default)]
    #[schema(value_type = crate::cell::Posture)]
    pub posture: String,
    /// Distance from singularity: smallest singular value of the flange's Jacobian, lengths relative to the arm's; 0 at a
    /// singularity.
    #[serde(default)]
    pub singularity_margin: f64,
    /// Distance between the two nearest bodies, mm. Pairs that are as far apart here as the axes can bring them are left out.
    /// `null` if it is more than 200 mm.
    #[serde(default)]
    pub clearance_mm: Option<f64>,
}

/// Samples that views are chosen on and that bounds are computed on. Coverage is that of every sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct ChosenOnDocument {
    /// Number of samples that views were chosen on.
    pub samples: usize,
    /// Number of all samples.
    pub of_samples: usize,
    /// Number of times that samples were added and views chosen anew, because the views met the target on these samples but not
    /// on all.
    pub refinements: u32,
}

impl From<ChosenOn> for ChosenOnDocument {
    fn from(chosen_on: ChosenOn) -> Self {
        let ChosenOn { samples, of_samples, refinements } = chosen_on;
        Self { samples, of_samples, refinements }
    }
}

/// Bounds on the best selection from the same candidates. They ignore the requirements on overlap, time and quality, and
/// remain valid with them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct BoundDocument {
    /// Lower bound on the number of views that reach the goals, including those on grades (`selection.max_grade_loss`,
    /// `selection.min_grade_a`); a goal that the plan misses counts only as far as the plan reaches it.
    pub views_lower: u32,
    /// Number of chosen views minus `views_lower`; 0 proves that no selection needs fewer.
    pub gap: u32,
    /// Upper bound on the share of the asked area that `selection.max_views` views measure: the share that the plan measures plus
    /// `gap_of_asked`. Present with `selection.goal` `best_coverage`, but not with `robust.select`, which chooses by what views measure
    /// under pose errors.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub of_asked_upper: Option<f64>,
    /// Upper bound on how much more of the samples that views are chosen on another selection could measure, as a share; 0 proves
    /// that none measures more.
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
    /// Returns true if the part was planned with a fixture.
    #[must_use]
    pub fn has_fixture(&self) -> bool {
        self.fixture.is_some() || self.params.part.fixture_mesh.is_some()
    }

    /// Builds the document of an outcome, without its fixture, whose file an outcome does not know.
    #[must_use]
    pub fn new(outcome: &Outcome, scanner: &Scanner, cell: Option<CellDocument>, echo: Echo) -> Self {
        let plan = &outcome.plan;
        let sequence = plan.visits().map(|(view, _)| view.0).collect();
        Self {
            schema: PLAN_SCHEMA.to_owned(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            echo,
            part: part(plan),
            fixture: None,
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
            setup_links: SetupLinkDocument::all_of(plan),
            view_links: ViewLinkDocument::all_of(plan),
            viewpoints: plan.views.iter().map(ViewpointDocument::from).collect(),
            sequence,
            motion: MotionDocument::of(plan),
            obstructions: plan.obstructions.iter().map(ObstructionDocument::from).collect(),
            missed: plan.missed.iter().map(|missed| MissedDocument::of(missed, ChoiceRules::of(plan))).collect(),
            advice: AdviceDocument::all_of(plan),
            warnings: warnings::of_coverage(
                &plan.params,
                &CoverageDocument::from(&plan.coverage),
                plan.stopped_because,
                "/params",
            ),
            chosen_on: Some(plan.chosen_on.into()),
            bound: BoundDocument::from(&plan.bound),
            stopped_because: plan.stopped_because.as_str().to_owned(),
        }
    }

    /// Bytes of the file: indented JSON with a newline at the end. `plan_sha256` is computed over them.
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

/// Fields that are named at most.
const MAX_DIFFERENCES: usize = 5;
/// Relative tolerance of numbers that went through a file.
const SAME: f64 = 1e-9;

impl PlanDocument {
    /// Fields in which a scanner is not the one that was planned for; pointers begin with `/scanner`. A few at most.
    #[must_use]
    pub fn scanner_differences(&self, scanner: &Scanner) -> Vec<FieldError> {
        let value = |document: &ScannerDocument| serde_json::to_value(document).unwrap_or_default();
        let mut found = Vec::new();
        differences("/scanner", &value(&self.scanner), &value(&scanner_document(scanner, &self.params)), &mut found);
        found.truncate(MAX_DIFFERENCES);
        found
    }
}

/// Records the fields of `planned` in which `present` differs.
fn differences(at: &str, planned: &Value, present: &Value, found: &mut Vec<FieldError>) {
    match (planned, present) {
        (Value::Object(planned), Value::Object(present)) => {
            let fields = planned.iter().map(|(name, value)| (name, value, present.get(name).unwrap_or(&Value::Null)));
            fields.for_each(|(name, planned, present)| differences(&format!("{at}/{name}"), planned, present, found));
        }
        (Value::Array(planned), Value::Array(present)) if planned.len() == present.len() => {
            let entries = planned.iter().zip(present).enumerate();
            entries.for_each(|(index, (planned, present))| differences(&format!("{at}/{index}"), planned, present, found));
        }
        (planned, present) => {
            let is_near = planned.as_f64().zip(present.as_f64()).is_some_and(|(a, b)| (a - b).abs() <= SAME * a.abs().max(1.0));
            if planned != present && !is_near {
                found.push(FieldError {
                    pointer: at.to_owned(),
                    detail: format!("is {present}; the plan was made with {planned}"),
                });
            }
        }
    }
}

fn scanner_document(scanner: &Scanner, params: &PlanParams) -> ScannerDocument {
    ScannerDocument {
        name: scanner.name.clone(),
        depth_mm: DepthDocument { near: scanner.near_mm, best: scanner.best_mm, far: scanner.far_mm },
        devices: scanner.devices.iter().map(|device| device_document(device, &params.limits)).collect(),
        calibrated: scanner.calibrated.clone(),
    }
}

fn device_document(device: &OpticalDevice, limits: &LimitParams) -> DeviceDocument {
    let (lens, own_deg, tightened_deg) = (&device.lens, degrees(device.incidence_max_rad), limits.tightened_deg(device));
    let [in_focus_from_mm, in_focus_to_mm] = device.in_focus_mm.map(|mm| mm.is_finite().then_some(mm));
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
        incidence_max_deg: tightened_deg.unwrap_or(own_deg),
        incidence_own_deg: tightened_deg.map(|_| own_deg),
        in_focus_from_mm,
        in_focus_to_mm,
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
            exposure: view.exposure.as_ref().map(ViewExposureDocument::from),
        }
    }
}
