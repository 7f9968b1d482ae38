//! Every knob of a planning job: default, unit, range and source on each field. The names are those of files, HTTP
//! and `--set`; angles are in degrees here, since this is the shape that users write, and radians from the first use on.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::grade::Grade;
use crate::cell::{DeviceName, FieldError, Findings, OpticalDevice, PoseSpec};

mod candidates;
mod dialects;
mod regions;
mod robust;
mod selection;

pub use candidates::{CandidateParams, Hemisphere, Standoff, Strategy};
pub use dialects::DialectParams;
pub use regions::{FeatureParams, InterestParams, NoiseParams, Region, RegionParams};
pub use robust::{PoseErrorParams, RobustParams};
pub use selection::{OverlapParams, SelectionGoal};

/// Largest number of viewpoints that a job may give.
const MAX_POSES: usize = 10_000;

/// Largest number of resting poses to choose from.
const MAX_RESTING: usize = 12;

/// All parameters of a plan. Unknown fields are refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields, expecting = "an object")]
pub struct PlanParams {
    /// Patches, samples and how the part lies.
    pub part: PartParams,
    /// Regions that are excluded, of interest, or toleranced.
    pub regions: RegionParams,
    /// Values that the program carries to the scanner.
    pub scan: ScanParams,
    /// Values that the program carries to the robot.
    pub motion: MotionParams,
    /// Names and signals in the programs for robot controllers.
    pub dialects: DialectParams,
    /// Incidence limits of this job.
    pub limits: LimitParams,
    /// Viewpoints to consider.
    pub candidates: CandidateParams,
    /// Computation of visibility.
    pub visibility: VisibilityParams,
    /// Weights of the score ([`crate::planning::method::quality`]).
    pub score: ScoreParams,
    /// Choice of views, and stop rules.
    pub selection: SelectionParams,
    /// Evaluation with poses that are off.
    pub robust: RobustParams,
    /// Remedies for missed area.
    pub missed: MissedParams,
    /// Resting poses in which the part may be planned, 1 to 4; fewer are used where they do. With more than 1 every
    /// setup is planned with viewpoints above the plate. Default 1.
    pub setups: u32,
    /// Seed of every pseudo-random choice. Default 0.
    pub seed: u64,
}

impl Default for PlanParams {
    fn default() -> Self {
        Self {
            part: PartParams::default(),
            regions: RegionParams::default(),
            scan: ScanParams::default(),
            motion: MotionParams::default(),
            dialects: DialectParams::default(),
            limits: LimitParams::default(),
            candidates: CandidateParams::default(),
            visibility: VisibilityParams::default(),
            score: ScoreParams::default(),
            selection: SelectionParams::default(),
            robust: RobustParams::default(),
            missed: MissedParams::default(),
            setups: 1,
            seed: 0,
        }
    }
}

/// Patches, samples and how the part lies.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields, expecting = "an object")]
pub struct PartParams {
    /// Largest patch edge, mm, 0.001 to 1000. Default: 1/60 of the bounding box's diagonal.
    pub patch_edge_mm: Option<f64>,
    /// Samples per mm², 0.0001 to 1000000; every patch has at least one. Default: 50 000 on the part.
    pub samples_per_mm2: Option<f64>,
    /// Pose of the part on the plate. Default: axes parallel, box bottom on the plate, box centre on the axis.
    pub table_from_part: Option<PoseSpec>,
    /// Poses to choose from where `setups` is more than 1, at most 12. Default: `table_from_part` and the stable poses of the
    /// part's convex hull.
    pub resting_poses: Vec<PoseSpec>,
    /// A fixture that occludes and collides and is not measured, modelled in the part's own coordinates and unit:
    /// a mesh id over HTTP, a file on the command line.
    pub fixture_mesh: Option<String>,
}

/// Values that the program carries to the scanner.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields, expecting = "an object")]
pub struct ScanParams {
    /// Projector brightness level, 0 to 9. Default 5.
    pub brightness: u8,
    /// Pause between arrival and capture, s, 0 to 60. Default 0.3.
    pub settle_secs: f64,
    /// Time of one capture, s, 0 to 600. Default 1.0.
    pub capture_secs: f64,
}

impl Default for ScanParams {
    fn default() -> Self {
        Self { brightness: 5, settle_secs: 0.3, capture_secs: 1.0 }
    }
}

/// Values that the program carries to the robot.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields, expecting = "an object")]
pub struct MotionParams {
    /// Share of the axes' rated speed, 0.01 to 1. Default 0.25.
    pub speed_fraction: f64,
    /// Smallest distance between moving and other bodies, mm, 1 to 200. Default 5.
    pub clearance_mm: f64,
    /// Table motion beside the arm's: `with_arm`, the default, or `alone`, for controllers that cannot drive
    /// both together. Alone costs the time of both.
    pub table: TableMotion,
    /// Treatment of the points of a move that is not straight: `stop`, the default, which every controller does alike, or
    /// `round`, for executors that stream set points: corners are cut where that is free, and the move is run without
    /// stopping, as quickly as the axes allow. Dialects take moves with stops alone.
    pub corners: Corners,
    /// Roll of chosen views about the optical axis where that makes the moves shorter: `free`, the
    /// default, where no less is measured then, or `fixed`.
    pub roll: Roll,
    /// Largest deviation of an emitted polyline from the planned path, degrees of any joint, 0.001 to 2. Default 0.1.
    pub path_tolerance_deg: f64,
}

impl Default for MotionParams {
    fn default() -> Self {
        Self {
            speed_fraction: 0.25,
            clearance_mm: 5.0,
            table: TableMotion::WithArm,
            corners: Corners::Stop,
            roll: Roll::Free,
            path_tolerance_deg: 0.1,
        }
    }
}

/// Motion of the table beside that of the arm.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum TableMotion {
    /// While the arm moves.
    #[default]
    WithArm,
    /// The table turns with the arm at rest.
    Alone,
}

/// Treatment of the inner points of a move.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Corners {
    /// Every point is a stop.
    #[default]
    Stop,
    /// Corners are cut and passed without stopping.
    Round,
}

/// Roll of chosen views about the optical axis.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Roll {
    /// Any with which the views measure no less.
    #[default]
    Free,
    /// That of the candidates.
    Fixed,
}

/// Incidence limits of this job.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields, expecting = "an object")]
pub struct LimitParams {
    /// Largest angle between surface normal and camera ray, degrees, 1 to 89.9. Default: the scanner's.
    pub camera_deg: Option<f64>,
    /// Largest angle between surface normal and projector ray, degrees, 1 to 89.9. Default: the scanner's.
    pub projector_deg: Option<f64>,
}

impl LimitParams {
    /// The limit in force for a device, radians: the job's, else the device's own.
    #[must_use]
    pub fn incidence_max_rad(&self, device: &OpticalDevice) -> f64 {
        let limit_deg = match device.name {
            DeviceName::Projector => self.projector_deg,
            DeviceName::Left | DeviceName::Right => self.camera_deg,
        };
        limit_deg.map_or(device.incidence_max_rad, f64::to_radians)
    }
}

/// A way to compute visibility. All agree on [`crate::planning::method::visibility`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Engine {
    /// Depth maps, and rays where they leave doubt.
    #[default]
    Raster,
    /// Any-hit rays for every sample: the reference.
    Rays,
}

/// Computation of visibility.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields, expecting = "an object")]
pub struct VisibilityParams {
    /// Default `raster`.
    pub engine: Engine,
    /// Counts by pixels beside samples, as the thesis does (§3.2.1): for each face the chosen views that hit it
    /// with at least one pixel of each device, in `coverage.csv`, and the share of such faces in `plan.json`. Default false.
    pub pixel_set: bool,
}

/// Direction against which the angle quality is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum ScoreAngle {
    /// The direction from the sample to the viewpoint.
    Ray,
    /// The viewing axis (the thesis's literal form).
    OpticalAxis,
}

/// Weights of the score ([`crate::planning::method::quality`]), each 0 to 10.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields, expecting = "an object")]
pub struct ScoreParams {
    /// Weight of the covered area. Default 0.5.
    pub a: f64,
    /// Weight of the quality. Default 0.5.
    pub b: f64,
    /// Weight of the angle in the quality. Default 0.6.
    pub c: f64,
    /// Weight of the distance in the quality. Default 0.4.
    pub d: f64,
    /// Default `ray`.
    pub angle: ScoreAngle,
}

impl Default for ScoreParams {
    fn default() -> Self {
        Self { a: 0.5, b: 0.5, c: 0.6, d: 0.4, angle: ScoreAngle::Ray }
    }
}

/// A way to choose views.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Solver {
    /// The thesis's greedy.
    #[default]
    Greedy,
    /// The choices of greedy from a priority queue of upper bounds.
    Lazy,
    /// Greedy by area, then dropping and exchanging views for fewer of them, then for a higher score.
    Local,
    /// `local`, then branch and bound for the proof that no fewer views do, or for fewer views.
    Certified,
}

/// Objective of greedy.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Objective {
    /// G_v = a·G_c + b·G_q.
    #[default]
    Score,
    /// Plain area.
    Coverage,
}

/// Area of which the target is a share.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum TargetOf {
    /// Asked area that at least one kept candidate measures.
    #[default]
    Coverable,
    /// All faces but excluded regions.
    Asked,
    /// The whole surface.
    Total,
}

/// Choice of views, and stop rules ([`crate::planning::method::selection`]).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields, expecting = "an object")]
pub struct SelectionParams {
    /// Default `greedy`.
    pub solver: Solver,
    /// Default `score`.
    pub objective: Objective,
    /// Stop at this share, 0 to 1. Default 0.985.
    pub target: f64,
    /// Default `coverable`.
    pub target_of: TargetOf,
    /// Stop when the best view adds less than this share of the asked area, 0 to 1. Default 0.0001.
    pub min_growth: f64,
    /// Stop at this many views, 1 to 1000. Default: no limit.
    pub max_views: Option<u32>,
    /// Count only area that is measured at this grade or better ([`crate::planning::method::quality`]): `A`, `B`, `C` or `D`.
    /// Default: all of it.
    pub min_grade: Option<Grade>,
    /// Default `fewest_views`.
    pub goal: SelectionGoal,
    /// Area that chosen views share, for registration. Default: none asked for.
    pub overlap: OverlapParams,
    /// Price of a second of the cycle: each view costs the time to settle, capture and travel to it, in mm² of
    /// score, 0 to 1 000 000 mm²/s. Default 0.
    pub view_cost_mm2_per_s: f64,
    /// Work of `local` and `certified`, in million pairs of sample and candidate looked at, about a millisecond each on
    /// one core, 1 to 10 000 000. No clock, so that the same input gives the same plan. Default 20 000.
    pub work_limit: u32,
}

impl Default for SelectionParams {
    fn default() -> Self {
        Self {
            solver: Solver::Greedy,
            objective: Objective::Score,
            target: 0.985,
            target_of: TargetOf::Coverable,
            min_growth: 0.0001,
            max_views: None,
            min_grade: None,
            goal: SelectionGoal::FewestViews,
            overlap: OverlapParams::default(),
            view_cost_mm2_per_s: 0.0,
            work_limit: 20_000,
        }
    }
}

/// Remedies for missed area.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields, expecting = "an object")]
pub struct MissedParams {
    /// Number of the largest missed spots for which a remedy is sought, 0 to 1000. Default 20.
    pub remedies: u32,
}

impl Default for MissedParams {
    fn default() -> Self {
        Self { remedies: 20 }
    }
}

impl PlanParams {
    /// Checks every range.
    ///
    /// # Errors
    /// All fields that are out of range, with the range.
    pub fn check(&self) -> Result<(), Vec<FieldError>> {
        let mut findings = Findings::default();
        self.check_part(&mut findings);
        self.regions.check(&mut findings);
        self.check_hardware_values(&mut findings);
        self.dialects.check(&mut findings);
        self.candidates.check(&mut findings);
        self.check_given(&mut findings);
        self.check_selection(&mut findings);
        self.robust.check(&mut findings);
        findings.into_result()
    }

    fn check_part(&self, findings: &mut Findings) {
        if let Some(edge_mm) = self.part.patch_edge_mm {
            findings.range("/part/patch_edge_mm", edge_mm, 0.001, 1000.0, "mm");
        }
        if let Some(density) = self.part.samples_per_mm2 {
            findings.range("/part/samples_per_mm2", density, 0.0001, 1e6, "per mm²");
        }
        if let Some(pose) = &self.part.table_from_part {
            pose.check("/part/table_from_part", findings);
        }
        let poses = &self.part.resting_poses;
        findings.require(poses.len() <= MAX_RESTING, "/part/resting_poses", || {
            format!("has {} entries; allowed is {MAX_RESTING}", poses.len())
        });
        poses.iter().enumerate().for_each(|(index, pose)| pose.check(&format!("/part/resting_poses/{index}"), findings));
        findings.range("/setups", f64::from(self.setups), 1.0, 4.0, "");
    }

    fn check_hardware_values(&self, findings: &mut Findings) {
        findings.range("/scan/brightness", f64::from(self.scan.brightness), 0.0, 9.0, "");
        findings.range("/scan/settle_secs", self.scan.settle_secs, 0.0, 60.0, "s");
        findings.range("/scan/capture_secs", self.scan.capture_secs, 0.0, 600.0, "s");
        findings.range("/motion/speed_fraction", self.motion.speed_fraction, 0.01, 1.0, "");
        let rounds_alone = self.motion.corners == Corners::Round && self.motion.table == TableMotion::Alone;
        findings.require(!rounds_alone, "/motion/corners", || {
            "is \"round\", which turns the table with the arm; motion.table is \"alone\"".into()
        });
        findings.range("/motion/clearance_mm", self.motion.clearance_mm, 1.0, 200.0, "mm");
        findings.range("/motion/path_tolerance_deg", self.motion.path_tolerance_deg, 0.001, 2.0, "°");
        for (pointer, limit) in
            [("/limits/camera_deg", self.limits.camera_deg), ("/limits/projector_deg", self.limits.projector_deg)]
        {
            if let Some(deg) = limit {
                findings.range(pointer, deg, 1.0, 89.9, "°");
            }
        }
    }

    fn check_given(&self, findings: &mut Findings) {
        let poses = &self.candidates.poses;
        findings.require(poses.len() <= MAX_POSES, "/candidates/poses", || {
            format!("has {} entries; allowed is {MAX_POSES}", poses.len())
        });
        poses.iter().enumerate().for_each(|(index, pose)| pose.check(&format!("/candidates/poses/{index}"), findings));
        findings.range("/missed/remedies", f64::from(self.missed.remedies), 0.0, 1000.0, "spots");
    }

    fn check_selection(&self, findings: &mut Findings) {
        let score = &self.score;
        for (name, weight) in [("a", score.a), ("b", score.b), ("c", score.c), ("d", score.d)] {
            findings.range(format!("/score/{name}"), weight, 0.0, 10.0, "");
        }
        findings.require(score.a + score.b > 0.0, "/score/a", || "a and b are both 0; at least one must count".into());
        findings.range("/selection/target", self.selection.target, 0.0, 1.0, "");
        findings.range("/selection/min_growth", self.selection.min_growth, 0.0, 1.0, "");
        if let Some(views) = self.selection.max_views {
            findings.range("/selection/max_views", f64::from(views), 1.0, 1000.0, "views");
        }
        selection::check(&self.selection, findings);
    }
}
