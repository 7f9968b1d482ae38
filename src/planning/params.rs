//! Every knob of a planning job: default, unit, range and source on each field. The names are those of files, HTTP
//! and `--set`; angles are in degrees here, since this is the shape that users write, and radians from the first use on.
//! `api/parameters.md` lists them.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::verdict::Grade;
use crate::cell::{DeviceName, FieldError, Findings, Material, OpticalDevice, PoseInput, PoseSpec, Scanner};

mod brightness;
mod candidates;
mod dialects;
pub(crate) mod knob;
mod materials;
mod preset;
mod realism;
mod regions;
mod registration;
mod rescan;
mod robust;
mod selection;

pub use brightness::Brightness;
pub use candidates::{CandidateParams, Hemisphere, Standoff, Strategy};
pub use dialects::DialectParams;
use knob::params;
pub use knob::{Knob, KnobGroup};
pub use materials::{MaterialParams, RegionMaterialParams};
pub use preset::Preset;
pub use realism::RealismParams;
pub use regions::{FeatureParams, InterestParams, NoiseParams, Region, RegionParams};
pub use registration::Registration;
pub use rescan::RescanParams;
pub use robust::{PoseErrorParams, RobustParams};
pub use selection::{OverlapParams, SelectionGoal};

params! {
    /// All parameters of a plan. Unknown fields are refused.
    PlanParams {
        /// Set of parameters that is chosen as a whole; a parameter that it sets cannot be set otherwise beside it.
        preset: Preset = Preset::Vantage;
        /// Patches, samples and how the part lies.
        part: PartParams = PartParams::default();
        /// Regions that are excluded, of interest, or toleranced.
        regions: RegionParams = RegionParams::default();
        /// Materials of the surface, from which the brightness of views follows. Default: not known; brightness then enters no figure.
        #[serde(skip_serializing_if = "MaterialParams::is_default")]
        materials: MaterialParams = MaterialParams::default();
        /// Values that the program carries to the scanner.
        scan: ScanParams = ScanParams::default();
        /// Values that the program carries to the robot.
        motion: MotionParams = MotionParams::default();
        /// Names and signals in the programs for robot controllers.
        dialects: DialectParams = DialectParams::default();
        /// Incidence limits of this job.
        limits: LimitParams = LimitParams::default();
        /// Viewpoints to consider.
        candidates: CandidateParams = CandidateParams::default();
        /// Computation of visibility.
        visibility: VisibilityParams = VisibilityParams::default();
        /// Weights of the score ([`crate::planning::method::quality`]).
        score: ScoreParams = ScoreParams::default();
        /// Choice of views, and stop rules.
        selection: SelectionParams = SelectionParams::default();
        /// Evaluation with poses that are off.
        robust: RobustParams = RobustParams::default();
        /// Measured area that a real scan may lack ([`crate::planning::method::realism`]).
        realism: RealismParams = RealismParams::default();
        /// Remedies for missed area.
        missed: MissedParams = MissedParams::default();
        /// Optional result files.
        output: OutputParams = OutputParams::default();
        /// Resting poses in which the part may be planned; fewer are used where they do. With more than 1 every setup is planned
        /// with viewpoints above the plate.
        setups: u32 = 1, [1.0, 4.0] "";
        /// Means by which measurements of different setups are registered to each other. With `surface` every setup has to share
        /// surface with another that fixes all six freedoms; views are added where it takes them.
        registration: Registration = Registration::Surface;
        /// Seed of every pseudo-random choice. The largest is that which a JSON number of any reader holds exactly, 2⁵³ − 1.
        seed: u64 = 0, [0.0, 9007199254740991.0] "";
    }
}

params! {
    /// Patches, samples and how the part lies.
    PartParams {
        /// Largest patch edge, mm. Default: 1/60 of the bounding box's diagonal.
        patch_edge_mm: Option<f64> = None, [0.001, 1000.0] "mm";
        /// Samples per mm²; every patch has at least one. Default: 50 000 on the part.
        samples_per_mm2: Option<f64> = None, [0.0001, 1_000_000.0] "per mm²";
        /// Pose of the part on the plate. Default: axes parallel, box bottom on the plate, box centre on the axis.
        #[schema(value_type = Option<PoseInput>)]
        table_from_part: Option<PoseSpec> = None;
        /// Poses to choose from where `setups` is more than 1. Default: `table_from_part` and the stable poses of the part's
        /// convex hull.
        #[schema(value_type = Vec<PoseInput>)]
        resting_poses: Vec<PoseSpec> = Vec::new(), entries [0, 12];
        /// A fixture that occludes and collides and is not measured, modelled in the part's own coordinates and unit:
        /// a mesh id over HTTP, a file on the command line.
        fixture_mesh: Option<String> = None;
    }
}

params! {
    /// Values that the program carries to the scanner.
    ScanParams {
        /// Projector brightness: a level for every view, or `auto`: for each view the level at which the largest area is neither
        /// saturated nor dark, and two captures where that adds at least 1 % of it.
        brightness: Brightness = Brightness::Level(5), [0.0, 9.0] "";
        /// Light of the surroundings: share of the cameras' full scale that it alone gives a white surface. Default: none.
        #[serde(skip_serializing_if = "Option::is_none")]
        ambient: Option<f64> = None, [0.0, 0.9] "";
        /// Pause between arrival and capture, s.
        settle_secs: f64 = 0.3, [0.0, 60.0] "s";
        /// Time of one capture, s.
        capture_secs: f64 = 1.0, [0.0, 600.0] "s";
    }
}

params! {
    /// Values that the program carries to the robot.
    MotionParams {
        /// Share of the axes' rated speed.
        speed_fraction: f64 = 0.25, [0.01, 1.0] "";
        /// Smallest distance between moving and other bodies, mm.
        clearance_mm: f64 = 5.0, [1.0, 200.0] "mm";
        /// Table motion beside the arm's: `with_arm`, or `alone` for controllers that cannot drive both together. Alone costs the
        /// time of both.
        table: TableMotion = TableMotion::WithArm;
        /// Treatment of the points of a move that is not straight: `stop`, which every controller does alike, or `round`: corners
        /// are cut where that is free and quicker, not with motion.table = `alone`. Runs and simulators stop there all the same, and
        /// dialects refuse it.
        corners: Corners = Corners::Stop;
        /// Roll of chosen views about the optical axis where that makes the moves shorter: `free`, where no less is measured
        /// then, or `fixed`.
        roll: Roll = Roll::Free;
        /// Largest deviation of an emitted polyline from the planned path, degrees of any joint.
        path_tolerance_deg: f64 = 0.1, [0.001, 2.0] "°";
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

params! {
    /// Incidence limits of this job. They tighten the scanner's own, which they may not exceed.
    LimitParams {
        /// Largest angle between surface normal and the ray of either camera, degrees; at most the own limit of each camera.
        /// Default: each camera's own.
        camera_deg: Option<f64> = None, [1.0, 89.9] "°";
        /// Largest angle between surface normal and projector ray, degrees; at most the projector's own limit. Default: that.
        projector_deg: Option<f64> = None, [1.0, 89.9] "°";
    }
}

/// Difference between limits that were converted to degrees and back, rad.
const SAME_LIMIT_RAD: f64 = 1e-9;

impl LimitParams {
    /// Limit that the job gives for a device, degrees.
    #[must_use]
    pub fn given_deg(&self, device: DeviceName) -> Option<f64> {
        match device {
            DeviceName::Projector => self.projector_deg,
            DeviceName::Left | DeviceName::Right => self.camera_deg,
        }
    }

    /// Limit that the job gives for a device, degrees, where it is tighter than the device's own.
    #[must_use]
    pub fn tightened_deg(&self, device: &OpticalDevice) -> Option<f64> {
        self.given_deg(device.name).filter(|deg| deg.to_radians() < device.incidence_max_rad - SAME_LIMIT_RAD)
    }

    /// Limit in force for a device, radians: the device's own or the job's, whichever is tighter.
    #[must_use]
    pub fn incidence_max_rad(&self, device: &OpticalDevice) -> f64 {
        let given_rad = self.given_deg(device.name).map(f64::to_radians);
        given_rad.map_or(device.incidence_max_rad, |given_rad| given_rad.min(device.incidence_max_rad))
    }
}

/// Requires that a limit, degrees, does not exceed the own limit of a device.
fn check_within_own(at: String, limit_deg: Option<f64>, device: &OpticalDevice, findings: &mut Findings) {
    let Some(limit_deg) = limit_deg else { return };
    let is_within = limit_deg.to_radians() <= device.incidence_max_rad + SAME_LIMIT_RAD;
    findings.require(is_within, at, || {
        let own_deg = device.incidence_max_rad.to_degrees();
        let (name, own_deg) = (device.name.as_str(), (own_deg * 1e6).round() / 1e6);
        let kind = if device.name == DeviceName::Projector { "" } else { " camera" };
        format!(
            "is {limit_deg} °; allowed is 1 to {own_deg} °, the own limit of the {name}{kind}: a job may tighten it, not widen it"
        )
    });
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

params! {
    /// Computation of visibility.
    VisibilityParams {
        /// Way to compute visibility.
        engine: Engine = Engine::Raster;
        /// Counts by pixels beside samples, as the thesis does (§3.2.1): for each face the chosen views that hit it
        /// with at least one pixel of each device, in `coverage.csv`, and the share of such faces in `plan.json`.
        pixel_set: bool = false;
    }
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

params! {
    /// Weights of the score ([`crate::planning::method::quality`]).
    ScoreParams {
        /// Weight of the covered area.
        a: f64 = 0.5, [0.0, 10.0] "";
        /// Weight of the quality.
        b: f64 = 0.5, [0.0, 10.0] "";
        /// Weight of the angle in the quality.
        c: f64 = 0.6, [0.0, 10.0] "";
        /// Weight of the distance in the quality.
        d: f64 = 0.4, [0.0, 10.0] "";
        /// Direction against which the angle is measured.
        angle: ScoreAngle = ScoreAngle::Ray;
    }
}

/// A way to choose views.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Solver {
    /// The thesis's greedy.
    Greedy,
    /// The choices of greedy from a priority queue of upper bounds.
    Lazy,
    /// Fewest views that exchanges find to meet the goals, then exchanges for a higher score with that many.
    #[default]
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

params! {
    /// Choice of views, and stop rules ([`crate::planning::method::selection`]).
    SelectionParams {
        /// Way to choose views.
        solver: Solver = Solver::Local;
        /// Objective of greedy.
        objective: Objective = Objective::Score;
        /// Share of the area at which the choice stops.
        target: f64 = 0.985, [0.0, 1.0] "";
        /// Area of which the target is a share.
        target_of: TargetOf = TargetOf::Coverable;
        /// Stop when the best view adds less than this share of the asked area.
        min_growth: f64 = 0.0001, [0.0, 1.0] "";
        /// Stop at this many views. Default: no limit.
        max_views: Option<u32> = None, [1.0, 1000.0] "views";
        /// `local` and `certified`: share of the asked area by which the views may give less grade A, and less of A and B together,
        /// than greedy's; `null` lets them give any. Fewer views look at more surface obliquely.
        max_grade_loss: Option<f64> = Some(0.01), [0.0, 1.0] "";
        /// Samples that views are chosen on: about so many, more where the part has small features of its own. The chosen views are
        /// then evaluated on every sample. Default: 8 000 and one for each 25 mm², at most 40 000; 40 000 for a part of many views.
        samples: Option<u32> = None, [100.0, 40_000_000.0] "samples";
        /// Count only area that is measured at this grade or better ([`crate::planning::method::quality`]). Default: all of it.
        min_grade: Option<Grade> = None;
        /// Formulation that is solved.
        goal: SelectionGoal = SelectionGoal::FewestViews;
        /// Area that chosen views share, for registration. Default: none asked for.
        overlap: OverlapParams = OverlapParams::default();
        /// Price of a second of the cycle: each view costs the time to settle, capture and travel to it, in mm² of score per s.
        view_cost_mm2_per_s: f64 = 0.0, [0.0, 1_000_000.0] "mm²/s";
        /// Work of `local` and `certified`, in million pairs of sample and candidate looked at, about a millisecond each on
        /// one core. No clock, so that the same input gives the same plan.
        work_limit: u32 = 20_000, [1.0, 10_000_000.0] "million pairs";
    }
}

params! {
    /// Remedies for missed area.
    MissedParams {
        /// Number of the largest missed spots for which a remedy is sought.
        remedies: u32 = 20, [0.0, 1000.0] "spots";
        /// Tries advice on the plan as a whole: one more setup, more views.
        advice: bool = true;
    }
}

params! {
    /// Optional result files.
    OutputParams {
        /// Writes `candidates.json`: every candidate with its pose, its fate and the area that it measures, and the matrices of
        /// visibility and of quality (H and G of the thesis, §3.2.2), sparse. It changes nothing else of a plan.
        candidates: bool = false;
    }
}

impl PlanParams {
    /// Checks every range.
    ///
    /// # Errors
    /// All fields that are out of range, with the range.
    pub fn check(&self) -> Result<(), Vec<FieldError>> {
        let mut findings = Findings::default();
        self.part.check(&mut findings);
        self.check_ranges("", &mut findings);
        self.preset.check(self, &mut findings);
        self.regions.check(&mut findings);
        self.materials.check(&mut findings);
        self.scan.check_ranges("/scan", &mut findings);
        self.motion.check(&mut findings);
        self.limits.check_ranges("/limits", &mut findings);
        self.dialects.check(&mut findings);
        self.candidates.check(&mut findings);
        self.visibility.check_ranges("/visibility", &mut findings);
        self.realism.check(&mut findings);
        self.missed.check_ranges("/missed", &mut findings);
        self.output.check_ranges("/output", &mut findings);
        self.score.check(&mut findings);
        self.selection.check(&mut findings);
        self.robust.check(&mut findings);
        findings.into_result()
    }

    /// Checks the limits of incidence, the job's and those of its regions, against those of the scanner's devices. Both cameras
    /// have one limit in a job, so that the camera whose own is tighter bounds it.
    ///
    /// # Errors
    /// All limits that a device does not reach, with the range and the device's name.
    pub fn check_limits(&self, scanner: &Scanner) -> Result<(), Vec<FieldError>> {
        let mut findings = Findings::default();
        let [left, right] = scanner.devices.cameras();
        let camera = if right.incidence_max_rad < left.incidence_max_rad { right } else { left };
        let mut check = |at: &str, camera_deg: Option<f64>, projector_deg: Option<f64>| {
            check_within_own(format!("{at}/camera_deg"), camera_deg, camera, &mut findings);
            check_within_own(format!("{at}/projector_deg"), projector_deg, &scanner.devices.projector, &mut findings);
        };
        check("/limits", self.limits.camera_deg, self.limits.projector_deg);
        for (index, region) in self.regions.interest.iter().enumerate() {
            check(&format!("/regions/interest/{index}"), region.camera_deg, region.projector_deg);
        }
        findings.into_result()
    }

    /// Every parameter: groups of fields, with the path that leads to each group. Entries of lists are written `[]`.
    #[must_use]
    pub fn knobs() -> Vec<(&'static str, KnobGroup)> {
        vec![
            ("", Self::KNOBS),
            ("part", PartParams::KNOBS),
            ("regions", RegionParams::KNOBS),
            ("regions.interest[]", InterestParams::KNOBS),
            ("regions.features[]", FeatureParams::KNOBS),
            ("regions.noise", NoiseParams::KNOBS),
            ("materials", MaterialParams::KNOBS),
            ("materials.regions[]", RegionMaterialParams::KNOBS),
            ("scan", ScanParams::KNOBS),
            ("motion", MotionParams::KNOBS),
            ("dialects", DialectParams::KNOBS),
            ("limits", LimitParams::KNOBS),
            ("candidates", CandidateParams::KNOBS),
            ("visibility", VisibilityParams::KNOBS),
            ("score", ScoreParams::KNOBS),
            ("selection", SelectionParams::KNOBS),
            ("selection.overlap", OverlapParams::KNOBS),
            ("robust", RobustParams::KNOBS),
            ("robust.pose_error", PoseErrorParams::KNOBS),
            ("realism", RealismParams::KNOBS),
            ("missed", MissedParams::KNOBS),
            ("output", OutputParams::KNOBS),
        ]
    }
}

impl PartParams {
    fn check(&self, findings: &mut Findings) {
        self.check_ranges("/part", findings);
        if let Some(pose) = &self.table_from_part {
            pose.check("/part/table_from_part", findings);
        }
        let poses = self.resting_poses.iter().enumerate();
        poses.for_each(|(index, pose)| pose.check(&format!("/part/resting_poses/{index}"), findings));
    }
}

impl PlanParams {
    /// Material of what no region of `materials` holds; `None` where brightness enters no figure, since nothing is said of it.
    #[must_use]
    pub fn material_of_part(&self) -> Option<Material> {
        let is_asked = self.materials != MaterialParams::default() || self.scan.brightness == Brightness::Auto;
        is_asked.then(|| self.materials.of_part())
    }
}

impl MotionParams {
    fn check(&self, findings: &mut Findings) {
        self.check_ranges("/motion", findings);
        let rounds_alone = self.corners == Corners::Round && self.table == TableMotion::Alone;
        findings.require(!rounds_alone, "/motion/corners", || {
            "is \"round\", which turns the table with the arm; motion.table is \"alone\"".into()
        });
    }
}

impl ScoreParams {
    /// Score of a unit of measured area of this quality, a + b·q.
    #[must_use]
    pub fn value(&self, quality: f64) -> f64 {
        self.a + self.b * quality
    }

    fn check(&self, findings: &mut Findings) {
        self.check_ranges("/score", findings);
        findings.require(self.a + self.b > 0.0, "/score/a", || "a and b are both 0; at least one must count".into());
    }
}
