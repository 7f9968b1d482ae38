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
        /// Named set of parameter values. A parameter that the preset sets may be left out or given the preset's value; any other
        /// value is refused.
        preset: Preset = Preset::Vantage;
        /// Patches, samples and the pose of the part.
        part: PartParams = PartParams::default();
        /// Excluded regions, regions of interest and toleranced features.
        regions: RegionParams = RegionParams::default();
        /// Materials of the surface, from which the exposure of the views is predicted. Default: unknown; exposure is then
        /// predicted only with `scan.brightness` = `auto`, for a matte white part.
        #[serde(skip_serializing_if = "MaterialParams::is_default")]
        materials: MaterialParams = MaterialParams::default();
        /// Exposure and timing of the captures.
        scan: ScanParams = ScanParams::default();
        /// Motion of robot and turntable.
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
        /// Selection of views, and stopping rules.
        selection: SelectionParams = SelectionParams::default();
        /// Evaluation of the plan under pose errors.
        robust: RobustParams = RobustParams::default();
        /// Measured area that may be missing from a real scan ([`crate::planning::method::realism`]).
        realism: RealismParams = RealismParams::default();
        /// Remedies for missed area.
        missed: MissedParams = MissedParams::default();
        /// Optional result files.
        output: OutputParams = OutputParams::default();
        /// Maximum number of setups: resting poses in which the part is scanned one after another. Fewer are used if they measure
        /// as much, to within 0.2 % of the asked area. More than 1 cannot be combined with a fixture.
        setups: u32 = 1, [1.0, 4.0] "";
        /// Means of registering the measurements of different setups to each other. With `surface`, every setup must share
        /// surface with another one that constrains all six degrees of freedom; views are added where that takes them.
        registration: Registration = Registration::Surface;
        /// Seed of the sample positions, the random candidates and the pose-error draws: the same input with the same seed gives
        /// the same plan. The maximum, 2⁵³ − 1, is the largest integer that every JSON reader represents exactly.
        seed: u64 = 0, [0.0, 9007199254740991.0] "";
    }
}

params! {
    /// Patches, samples and the pose of the part.
    PartParams {
        /// Maximum edge length of a surface patch, mm. Smaller patches resolve more detail but take longer. Default: 1/60 of the
        /// diagonal of the part's bounding box.
        patch_edge_mm: Option<f64> = None, [0.001, 1000.0] "mm";
        /// Samples per mm² of surface, on which coverage is evaluated; every patch has at least one. More samples are more
        /// accurate but take longer. Default: about 50 000 on the whole part.
        samples_per_mm2: Option<f64> = None, [0.0001, 1_000_000.0] "per mm²";
        /// Pose of the part on the turntable's plate. Default: axes parallel to the table's, the bottom of the bounding box on
        /// the plate and its centre on the table axis.
        #[schema(value_type = Option<PoseInput>)]
        table_from_part: Option<PoseSpec> = None;
        /// Poses to choose from if `setups` is more than 1. Default: `table_from_part` and the stable poses of the part's convex
        /// hull.
        #[schema(value_type = Vec<PoseInput>)]
        resting_poses: Vec<PoseSpec> = Vec::new(), entries [0, 12];
        /// Mesh of the fixture, in the part's own coordinates and unit: a mesh id over HTTP, a file on the command line. It hides
        /// surface and can be collided with, but is not measured. Default: no fixture.
        fixture_mesh: Option<String> = None;
    }
}

params! {
    /// Exposure and timing of the captures.
    ScanParams {
        /// Projector brightness, from 0 (darkest) to 9 (brightest): one level for every view, or `auto`. `auto` chooses for each
        /// view the level at which the most area is neither saturated nor too dark, and adds a second capture where that gains at
        /// least 1 % of the area.
        brightness: Brightness = Brightness::Level(5), [0.0, 9.0] "";
        /// Ambient light: the share of the cameras' full scale to which it alone lifts a white surface. Default: none.
        #[serde(skip_serializing_if = "Option::is_none")]
        ambient: Option<f64> = None, [0.0, 0.9] "";
        /// Pause between arriving at a viewpoint and capturing, s. A longer pause lets vibration decay.
        settle_secs: f64 = 0.3, [0.0, 60.0] "s";
        /// Duration of one capture, s.
        capture_secs: f64 = 1.0, [0.0, 600.0] "s";
    }
}

params! {
    /// Motion of robot and turntable.
    MotionParams {
        /// Fraction of each axis's rated speed and acceleration with which moves are made. A larger fraction is faster.
        speed_fraction: f64 = 0.25, [0.01, 1.0] "";
        /// Minimum distance that moving bodies keep from everything else, mm. A larger distance is safer, but puts more views out
        /// of reach.
        clearance_mm: f64 = 5.0, [1.0, 200.0] "mm";
        /// Table motion: `with_arm` turns the table while the arm moves; `alone` turns it while the arm rests, for controllers
        /// that cannot drive both together, and takes the time of both.
        table: TableMotion = TableMotion::WithArm;
        /// Motion at the via points of a move: `stop`, which every controller does alike, or `round`, which cuts corners where
        /// that is collision-free and faster. `round` cannot be combined with motion.table = `alone`; runs and simulators stop at
        /// the points all the same, and dialects refuse it.
        corners: Corners = Corners::Stop;
        /// Roll of the chosen views about the optical axis: `free` rolls them where that shortens moves and no less is measured,
        /// `fixed` keeps the roll of the candidates.
        roll: Roll = Roll::Free;
        /// Blend tolerance of `corners` = `round`: maximum deviation from the corner at a via point, degrees in each axis. A
        /// larger value cuts corners more and takes less time. `stop` does not use it.
        path_tolerance_deg: f64 = 0.1, [0.001, 2.0] "°";
    }
}

/// Motion of the table relative to that of the arm.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum TableMotion {
    /// The table turns while the arm moves.
    #[default]
    WithArm,
    /// The table turns with the arm at rest.
    Alone,
}

/// Motion at the via points of a move.
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
    /// Roll of the candidates.
    Fixed,
}

params! {
    /// Incidence limits of this job. They can only tighten the scanner's own limits.
    LimitParams {
        /// Maximum angle between the surface normal and the ray to either camera, degrees; no more than each camera's own limit.
        /// A smaller limit measures less area, but less obliquely. Default: each camera's own limit.
        camera_deg: Option<f64> = None, [1.0, 89.9] "°";
        /// Maximum angle between the surface normal and the projector ray, degrees; no more than the projector's own limit.
        /// Default: the projector's own limit.
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
        format!("is {limit_deg} °; allowed is 1 to {own_deg} °, the own limit of the {name}{kind}: a job can only tighten it")
    });
}

/// Engine that computes visibility ([`crate::planning::method::visibility`]). All engines agree.
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
        /// Engine that computes visibility: `raster`, by depth maps, and rays where these leave doubt, or `rays`, by rays alone,
        /// as a reference.
        engine: Engine = Engine::Raster;
        /// Counts coverage by pixels as well, as the thesis does (§3.2.1): `coverage.csv` then gives, for each face, the chosen
        /// views that hit it with at least one pixel of each device, and `plan.json` the share of the surface on such faces.
        pixel_set: bool = false;
    }
}

/// Direction with which the surface normal is compared for the quality of the angle.
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
        /// Weight a of the measured area G_c in the score a · G_c + b · G_q of a view.
        a: f64 = 0.5, [0.0, 10.0] "";
        /// Weight b of the quality G_q in the score. A larger weight favours quality over area.
        b: f64 = 0.5, [0.0, 10.0] "";
        /// Weight c of the incidence angle in the quality.
        c: f64 = 0.6, [0.0, 10.0] "";
        /// Weight d of the distance from best focus in the quality.
        d: f64 = 0.4, [0.0, 10.0] "";
        /// Direction with which the surface normal is compared: `ray`, from the sample to the viewpoint, or `optical_axis`, the
        /// viewing axis (the thesis's literal form).
        angle: ScoreAngle = ScoreAngle::Ray;
    }
}

/// Algorithm that selects views.
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

/// Quantity by which views are scored.
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
    /// Selection of views, and stopping rules ([`crate::planning::method::selection`]).
    SelectionParams {
        /// Algorithm that selects views: `greedy`, the thesis's; `lazy`, the same choices from a priority queue; `local`, greedy
        /// and then exchanges for fewer views and a higher score; `certified`, `local` and then branch and bound, to prove that
        /// no fewer views suffice or to find them.
        solver: Solver = Solver::Local;
        /// Quantity by which views are scored: `score`, area and quality, or `coverage`, area alone.
        objective: Objective = Objective::Score;
        /// Share of the area named by `target_of` at which selection stops. A higher target takes more views.
        target: f64 = 0.985, [0.0, 1.0] "";
        /// Area of which the target is a share: `coverable`, the asked area that at least one kept candidate measures; `asked`,
        /// all faces outside excluded regions; or `total`, the whole surface.
        target_of: TargetOf = TargetOf::Coverable;
        /// Minimum share of the asked area that a view must add; selection stops when no further view does. `local` and
        /// `certified` keep views that add less where a floor under grades (`max_grade_loss`, `min_grade_a`) needs them.
        min_growth: f64 = 0.0001, [0.0, 1.0] "";
        /// Maximum number of views. Default: no limit.
        max_views: Option<u32> = None, [1.0, 1000.0] "views";
        /// `local` and `certified`: largest share of the asked area by which grade A, and grades A and B together, may fall below
        /// what greedy's views give; `null` sets no limit. A larger share allows fewer views, which look at more of the surface
        /// obliquely.
        max_grade_loss: Option<f64> = Some(0.01), [0.0, 1.0] "";
        /// `local` and `certified`: share of the asked area that the views must measure at grade A, on the samples that they are chosen on,
        /// as far as a further view adds at least 0.5 % of the asked area there; `null` asks for none beyond `max_grade_loss`. A larger
        /// share takes more views.
        min_grade_a: Option<f64> = None, [0.0, 1.0] "";
        /// Approximate number of samples that views are chosen on; more are taken where small features need them. The chosen
        /// views are then evaluated on every sample. Default: 8 000 plus one for each 25 mm² of surface, at most 40 000; 40 000
        /// for a part that takes many views.
        samples: Option<u32> = None, [100.0, 40_000_000.0] "samples";
        /// Lowest grade at which area counts as measured; A is the best ([`crate::planning::method::quality`]). Default: any
        /// grade counts.
        min_grade: Option<Grade> = None;
        /// Goal of the selection: `fewest_views` that reach the target; `min_time`, among these the ones with the shortest cycle
        /// (needs a cell); or `best_coverage`, the largest area with `max_views` views, whatever the target.
        goal: SelectionGoal = SelectionGoal::FewestViews;
        /// Surface that the chosen views must share, for registration. Default: none required.
        overlap: OverlapParams = OverlapParams::default();
        /// Cost of cycle time, mm² of score per second: each view is charged for the time to settle, to capture and to travel to
        /// it. A larger cost favours fewer and closer views; 0 ignores time.
        view_cost_mm2_per_s: f64 = 0.0, [0.0, 1_000_000.0] "mm²/s";
        /// Limit on the work of `local` and `certified`, in million pairs of sample and candidate examined; a million takes about
        /// a millisecond on one core. It is a count, not a time, so that the same input gives the same plan.
        work_limit: u32 = 20_000, [1.0, 10_000_000.0] "million pairs";
    }
}

params! {
    /// Remedies for missed area.
    MissedParams {
        /// Number of missed spots, largest first, for which a remedy is searched; 0 searches none.
        remedies: u32 = 20, [0.0, 1000.0] "spots";
        /// Tries changes to the plan as a whole (a further setup, or more views), and reports those with which it would measure
        /// more.
        advice: bool = true;
    }
}

params! {
    /// Optional result files.
    OutputParams {
        /// Writes `candidates.json`: every candidate with its pose, its fate and the area that it measures, and the sparse
        /// matrices of visibility and quality (H and G of the thesis, §3.2.2). The plan itself is not affected.
        candidates: bool = false;
    }
}

impl PlanParams {
    /// Checks every range.
    ///
    /// # Errors
    /// All fields that are out of range, with the range.
    pub fn check(&self) -> Result<(), Vec<FieldError>> {
        let mut findings = self.findings();
        self.regions.check_names(&mut findings);
        findings.into_result()
    }

    /// Checks the parameters of a plan that exists, as [`Self::check`], but for equal names of regions, which earlier releases took.
    ///
    /// # Errors
    /// All fields that are out of range, with the range.
    pub fn check_of_plan(&self) -> Result<(), Vec<FieldError>> {
        self.findings().into_result()
    }

    fn findings(&self) -> Findings {
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
        let as_chosen = self.preset.apply(self);
        let can_ask = self.selection.min_grade_a.is_none() || as_chosen.selection.keeps_grades(&as_chosen.score);
        findings.require(can_ask, "/selection/min_grade_a", || {
            "is given; it needs selection.solver = local or certified, selection.objective = score, score.b above 0 and a \
             selection.goal other than best_coverage"
                .into()
        });
        self.robust.check(&mut findings);
        findings
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
    /// Returns true if advice on the plan as a whole is tried: it is asked for, and views are not chosen by what they measure under
    /// errors too, need not overlap, and area at risk counts.
    #[must_use]
    pub fn tries_advice(&self) -> bool {
        let tolerates_errors = self.robust.select && self.robust.pose_error.is_some();
        let overlaps = self.selection.overlap != OverlapParams::default();
        self.missed.advice && self.realism.count_at_risk && !tolerates_errors && !overlaps
    }

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
            "is \"round\", which moves table and arm together, but motion.table is \"alone\"".into()
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
        findings.require(self.a + self.b > 0.0, "/score/a", || "is 0 and so is b; at least one of them must be above 0".into());
    }
}
