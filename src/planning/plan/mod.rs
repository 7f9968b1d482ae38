//! The result of planning: an immutable value from which every file and every answer is rendered. Types alone; later rooms
//! make them.

mod at_risk;
mod candidate_table;
mod certificate;
mod exposure;
mod measured;
mod plan_advice;
mod region_coverage;
mod remedy;
pub(super) mod tally;
mod turn;

pub use at_risk::AtRisk;
pub use candidate_table::{CandidateFate, CandidateTable, MAX_LISTING_BYTES, TableEntry};
pub use certificate::{Certificate, Drawn, Independent, Robust};
pub use exposure::{ExposureLoss, ViewExposure};
pub use measured::{MeasuredArea, VisibleShares, WITHIN_DEG};
pub use plan_advice::{AdviceKind, AdvisedSetup, ParamChange, PlanAdvice};
pub(in crate::planning) use region_coverage::SHARE_SLACK;
pub use region_coverage::{IndependentRegion, RegionCoverage};
pub use remedy::{Remedy, RemedyKind, RemedyView};
pub use turn::{PartSide, Turn, TurnKind};

use std::sync::Arc;

use nalgebra::{Point3, Vector3};

use super::candidates::Label;
pub use super::ids::{CandidateId, SetupId, ViewId};
use super::params::{PlanParams, ScanParams, SelectionParams, TargetOf};
pub use super::selection::{Bound, StopReason};
use super::sequence::{Leg, Sequence};
use super::stations::Station;
use super::surface::Surface;
pub use super::surface::requirements::RegionKind;
pub use super::verdict::{Advice, CandidateCounts, Cause, Fate, Grade, Obstruction, RiskReason, Stability, Verdict};
use super::visibility::Row;
use crate::cell::{CollisionScene, Posture, Robot};
use crate::geometry::{Aabb, LazyStablePoses, Part, Pose, ScannerFrame, Table};

/// A plan. Everything needed to write `plan.json`; no clock, no thread count.
#[derive(Clone, Debug)]
pub struct Plan {
    /// The part that was planned for.
    pub part: PartFacts,
    /// Pose of the part on the table; present with a cell.
    pub table_from_part: Option<Pose<Table, Part>>,
    /// Every knob that was in force, defaults resolved.
    pub params: PlanParams,
    /// Numbers of candidates, kept and rejected.
    pub candidates: CandidateCounts,
    /// Area that the chosen views measure.
    pub coverage: Coverage,
    /// The chosen views, in the order chosen.
    pub views: Vec<PlannedView>,
    /// The ways in which the part lies while views are taken, in that order; at least one.
    pub setups: Vec<SetupPlan>,
    /// Registration of every two setups to each other.
    pub setup_links: Vec<SetupLink>,
    /// Pairs of bodies that keep the cell from candidates, the one that keeps it from most first.
    pub obstructions: Vec<Obstruction>,
    /// Missed area by cause, in the order of [`Cause`].
    pub missed: Vec<MissedCause>,
    /// Advice that would measure more, what adds most first.
    pub advice: Vec<PlanAdvice>,
    /// The rule that ended the selection.
    pub stopped_because: StopReason,
    /// Bound of the views, or of the area, of the best choice from the same candidates, on the samples that they are chosen on.
    pub bound: Bound,
    /// Samples that views were chosen on.
    pub chosen_on: ChosenOn,
}

/// Samples that views are chosen on. Coverage is that of every sample.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ChosenOn {
    /// Number of them.
    pub samples: usize,
    /// Number of all samples.
    pub of_samples: usize,
    /// Times that samples were added, since the views met their goals on these alone, and that views were chosen anew.
    pub refinements: u32,
}

impl ChosenOn {
    /// Returns true if views are chosen on some of the samples.
    #[must_use]
    pub fn is_part(&self) -> bool {
        self.samples < self.of_samples
    }
}

/// Views and sequence of one setup.
#[derive(Clone, Debug)]
pub struct SetupPlan {
    /// Pose of the part in this setup.
    pub table_from_part: Pose<Table, Part>,
    /// The views taken, in the order chosen.
    pub views: Vec<ViewId>,
    /// Asked area that some kept candidate of this setup measures.
    pub coverable_area_mm2: f64,
    /// Asked area that its views measure.
    pub measured_area_mm2: f64,
    /// Order and paths; present with a cell.
    pub sequence: Option<Sequence>,
    /// The two views that are registered to each other worst, by the surface that they share, if each is to the one that it shares
    /// most with. Views of one setup share the table's frame, so this is information. `None` for a single view.
    pub weakest_link: Option<([ViewId; 2], Stability)>,
}

/// Registration of two setups to each other by the surface that both measure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SetupLink {
    /// The setups.
    pub setups: [SetupId; 2],
    /// Stability of it, by the surface that they share.
    pub stability: Stability,
}

impl Plan {
    /// The sequences of all setups, one after another.
    pub fn sequences(&self) -> impl Iterator<Item = &Sequence> {
        self.setups.iter().filter_map(|setup| setup.sequence.as_ref())
    }

    /// Turn of the part from the first setup into another; `None` for the first itself.
    #[must_use]
    pub fn turn_into(&self, setup: SetupId) -> Option<Turn> {
        let (first, other) = (self.setups.first()?, self.setups.get(setup.index())?);
        (setup != SetupId(0)).then(|| Turn::between(&first.table_from_part, &other.table_from_part))
    }

    /// Views in the order visited, each with the move that leads to it.
    pub fn visits(&self) -> impl Iterator<Item = &(ViewId, Leg)> {
        self.sequences().flat_map(|sequence| &sequence.visits)
    }

    /// Captures of the views that are visited: some views have two, of different brightness.
    #[must_use]
    pub fn captures(&self) -> usize {
        let captures = |view: ViewId| self.views.get(view.index()).map_or(1, |view| view.levels(&self.params.scan).len());
        self.visits().map(|(view, _)| captures(*view)).sum()
    }

    /// Number of views that are executed: those chosen, but for the ones to which no path was found.
    #[must_use]
    pub fn executed_views(&self) -> usize {
        self.views.iter().filter(|view| view.rejected.is_none()).count()
    }
}

/// Facts of the planned part.
#[derive(Clone, Debug, PartialEq)]
pub struct PartFacts {
    /// SHA-256 of the uploaded file, lower-case hexadecimal.
    pub sha256: String,
    /// Triangles planned on.
    pub triangles: usize,
    /// Surface area.
    pub area_mm2: f64,
    /// Bounding box, part frame.
    pub aabb: Aabb,
}

/// Areas and shares of what is measured. Sums run over samples ([`crate::planning::method::coverage`]).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Coverage {
    /// Whole surface.
    pub total_area_mm2: f64,
    /// All faces but excluded regions.
    pub asked_area_mm2: f64,
    /// Asked area that neither rests on the plate in every setup nor is enclosed by the part.
    pub visible_area_mm2: f64,
    /// Asked area that at least one kept candidate measures.
    pub coverable_area_mm2: f64,
    /// Asked area that at least one candidate measures, the cell's reach ignored.
    pub optically_coverable_area_mm2: f64,
    /// Asked area that the chosen views measure.
    pub measured: MeasuredArea,
    /// Area that the chosen views measure in the simulation and a real scan may lack.
    pub at_risk: AtRisk,
    /// True if the views are further ones, of which only what earlier scans left open is asked.
    pub is_of_open: bool,
    /// Area that is expected to be too dark or saturated; `None` where nothing is known of the materials.
    pub exposure: Option<ExposureLoss>,
    /// Measured area after 1, 2, … views.
    pub curve_area_mm2: Vec<f64>,
    /// Coverage of each region of interest and feature, in the order of their numbers: regions of interest come first.
    pub regions: Vec<RegionCoverage>,
    /// Coverage on samples that the views were not chosen on: the figure to trust.
    pub independent: Independent,
    /// Coverage on these samples with poses that are off; with `robust.pose_error`.
    pub robust: Option<Robust>,
    /// Area of the triangles that some chosen view hits with a pixel of each device; with `visibility.pixel_set`.
    pub pixel_set_area_mm2: Option<f64>,
}

impl Coverage {
    /// Measured share of the asked area; 0 when nothing is asked.
    #[must_use]
    pub fn of_asked(&self) -> f64 {
        share(self.measured.area_mm2, self.asked_area_mm2)
    }

    /// Measured share of the coverable area.
    #[must_use]
    pub fn of_coverable(&self) -> f64 {
        share(self.measured.area_mm2, self.coverable_area_mm2)
    }

    /// Measured share of the whole surface.
    #[must_use]
    pub fn of_total(&self) -> f64 {
        share(self.measured.area_mm2, self.total_area_mm2)
    }

    /// Shares of the visible area.
    #[must_use]
    pub fn of_visible(&self) -> VisibleShares {
        self.measured.of_visible(self.visible_area_mm2)
    }

    /// Area of which a target is a share.
    #[must_use]
    pub fn whole_mm2(&self, target_of: TargetOf) -> f64 {
        match target_of {
            TargetOf::Coverable => self.coverable_area_mm2,
            TargetOf::Asked => self.asked_area_mm2,
            TargetOf::Total => self.total_area_mm2,
        }
    }

    /// Share that is held against the target: views are chosen as if what is at risk counted.
    #[must_use]
    pub fn of_target(&self, target_of: TargetOf) -> f64 {
        let left_out_mm2 = if self.at_risk.is_counted { 0.0 } else { self.at_risk.area_mm2 };
        share(self.measured.area_mm2 + left_out_mm2, self.whole_mm2(target_of))
    }

    /// Returns true if the target of the plan is reached.
    #[must_use]
    pub fn reaches_target(&self, params: &SelectionParams) -> bool {
        self.of_target(params.target_of) >= params.target - SHARE_SLACK
    }

    /// Returns true if so large a share of the asked area is measured, whatever of it can be.
    #[must_use]
    pub fn measures_of_asked(&self, min_share: f64) -> bool {
        self.of_asked() >= min_share - SHARE_SLACK
    }
}

/// `part / whole`, 0 where there is no whole. Sums of the same areas in another order differ in their last bits: what exceeds 1 by no
/// more than that is 1.
pub fn share(part: f64, whole: f64) -> f64 {
    /// Max excess over 1 by rounding.
    const ROUNDING: f64 = 1e-12;
    let share = if whole > 0.0 { part / whole } else { 0.0 };
    if share > 1.0 && share <= 1.0 + ROUNDING { 1.0 } else { share }
}

/// One chosen view.
#[derive(Clone, Debug)]
pub struct PlannedView {
    /// Number in the order chosen.
    pub id: ViewId,
    /// The candidate it was.
    pub candidate: CandidateId,
    /// Setup of the plan that it is taken in.
    pub setup: SetupId,
    /// Side of the part that it looks at.
    pub label: Label,
    /// Pose of the scanner in the part frame.
    pub part_from_scanner: Pose<Part, ScannerFrame>,
    /// Share of the asked area that it added when chosen.
    pub gain_of_asked: f64,
    /// Score of the view when it was chosen.
    pub score: f64,
    /// Station from which the cell takes it; `None` without a cell, or when rejected.
    pub station: Option<Station>,
    /// Posture, singularity and clearance of the arm there.
    pub stance: Option<Stance>,
    /// Cause for which it measures nothing, if so.
    pub rejected: Option<Cause>,
    /// Brightness of its captures; `None` where nothing is known of the materials, or when rejected.
    pub exposure: Option<ViewExposure>,
}

impl PlannedView {
    /// Brightness level of each of its captures.
    #[must_use]
    pub fn levels(&self, scan: &ScanParams) -> Vec<u8> {
        self.exposure.as_ref().map_or_else(|| vec![scan.brightness.usual_level()], |exposure| exposure.levels.clone())
    }
}

/// Posture, singularity and clearance of an arm at a station.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stance {
    /// Arm configuration.
    pub posture: Posture,
    /// Distance from singularity, 0 at one ([`crate::cell::Kinematics::singularity_margin`]).
    pub singularity_margin: f64,
    /// Distance of the two bodies that are nearest to each other, mm, of those that the axes can bring farther apart than they are
    /// here ([`crate::cell::CollisionScene::nearest`]); `None` where all are farther apart than a clearance may be asked for.
    pub clearance_mm: Option<f64>,
}

impl Stance {
    /// Evaluates a robot at a station.
    #[must_use]
    pub fn of(robot: &Robot, station: &Station, clearance_mm: Option<f64>) -> Self {
        let joints_rad = &station.joints_rad;
        Self {
            posture: robot.kinematics.posture(joints_rad),
            singularity_margin: robot.kinematics.singularity_margin(joints_rad),
            clearance_mm,
        }
    }
}

/// Area missed for one cause.
#[derive(Clone, Debug, PartialEq)]
pub struct MissedCause {
    /// The cause.
    pub cause: Cause,
    /// Area of its samples.
    pub area_mm2: f64,
    /// Connected spots, largest first.
    pub spots: Vec<MissedSpot>,
}

/// A connected patch of surface missed for one cause.
#[derive(Clone, Debug, PartialEq)]
pub struct MissedSpot {
    /// Missed area in it.
    pub area_mm2: f64,
    /// Area-weighted centre, part frame.
    pub centre_mm: Point3<f64>,
    /// Size of the box around it along the part's axes, whole patches counted.
    pub extent_mm: Vector3<f64>,
    /// Faces of the uploaded file that it touches, ascending.
    pub source_faces: Vec<u32>,
    /// Remedy; `None` where none was sought: only the largest spots are tried.
    pub remedy: Option<Remedy>,
}

/// A plan and what is known of each sample: input of reports, listings and pictures.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// The plan.
    pub plan: Plan,
    /// Patches and samples planned on.
    pub surface: Arc<Surface>,
    /// Verdict on each sample: a [`super::ids::SampleId`] is a place here.
    pub verdicts: Vec<Verdict>,
    /// Samples that each chosen view measures, with its quality at each: a [`ViewId`] is a place here.
    pub measured_by_view: Vec<Row>,
    /// Number of chosen views that hit each triangle planned on with a pixel of each device; with
    /// `visibility.pixel_set`.
    pub pixel_views: Option<Vec<u32>>,
    /// Every candidate, chosen or not; with `output.candidates`.
    pub candidates: Option<CandidateTable>,
    /// Cell and part of each setup as its moves were proved free in, for what checks programs; none without a cell.
    pub scenes: Vec<CollisionScene>,
    /// Ways in which the part can stand, known where the plan needed them.
    pub stable_poses: LazyStablePoses,
}
