//! Summary of a plan: verdict, views, coverage, cycle, missed spots in groups, and the one best action, as numbers and as the
//! sentences that the command line, both reports, the job, the list of jobs and the page show. It is stored as `summary.json`,
//! schema `vantage.summary/1`.

mod action;
mod cycle;
mod doubts;
mod missed;
mod verdict;

#[cfg(test)]
mod tests;

use std::collections::BTreeSet;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

pub use action::{StandingRemedy, SummaryAction};
pub use cycle::{CycleParts, ProgramCycle};
pub use doubts::PlanDoubts;
pub use missed::MissedGroup;
pub(crate) use missed::{choice_ended_by, further_setup, own_plan_remark, stop_rules, turned_setup};
pub(crate) use verdict::rescan_ended;
pub use verdict::{PlanLevel, PlanVerdict};

use super::plan::{CoverageDocument, DrawnDocument, GradesDocument, MotionDocument, RobustDocument, SetupLinkDocument};
use super::schema_name::schema_name;
use super::words::{
    HeadlineShare, MEANING_OF_OPEN, asked_name, counted, headline, of_asked_phrase, percent, percent_below, pose_error_sizes,
    shortfall,
};
use crate::cell::{CalibrationProvenance, Dialect};
use crate::planning::ids::SetupId;
use crate::planning::params::{PoseErrorParams, Registration, SelectionGoal};
use crate::planning::plan::{Plan, RegionCoverage, RegionKind};

/// Schema name in the document.
pub const SUMMARY_SCHEMA: &str = "vantage.summary/1";
/// Regions and features that a summary lists; the plan has all.
const REGIONS_LISTED: usize = 20;
/// Groups of missed spots that have a line of their own.
const GROUPS_SHOWN: usize = 6;
/// Name of the file.
pub const SUMMARY_FILE: &str = "summary.json";

schema_name!(SummarySchema, SUMMARY_SCHEMA);

/// Summary of a plan (`summary.json`), short enough for a row of a table. Texts are sentences without a full stop, the same in
/// every output.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct Summary {
    /// Schema name, `vantage.summary/1`.
    #[schema(value_type = SummarySchema)]
    pub schema: String,
    /// Level of the verdict: whether the part can be scanned as planned.
    pub level: PlanLevel,
    /// Level in a sentence, with the measured shares of the visible and of the asked area: the first line to read. In its place, if the
    /// part has an implausible size, a request to check its unit, else, if it does not stand as it is placed, what to do about that.
    pub title: String,
    /// Verdict on the plan.
    pub verdict: PlanVerdict,
    /// Verdict in a sentence, with its figures.
    pub verdict_text: String,
    /// True in a plan of further views after a scan: `of_asked` is then a share of the area that earlier scans left open, which
    /// the sentences call the open area. Absent in any other plan.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub of_open: bool,
    /// Number of views that are executed.
    pub views: usize,
    /// Number of views that were chosen; those to which no collision-free path was found are not executed.
    pub views_chosen: usize,
    /// Number of setups.
    pub setups: usize,
    /// Views and setups in a sentence.
    pub views_text: String,
    /// Registration of every two setups to each other by the surface that both measure. Absent for a single setup.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub setup_links: Vec<SetupLinkDocument>,
    /// Shares that head the plan.
    pub coverage: SummaryShares,
    /// Shares of `coverage` in a sentence.
    pub coverage_text: String,
    /// Shares that head the plan with their meanings, the one to read first at the top: the table of every output.
    #[serde(default)]
    pub headline: Vec<HeadlineDocument>,
    /// Shares of the asked area by grade, on the samples that views are chosen on: their sum differs a little from
    /// `coverage.of_asked`, which is on independent samples.
    pub grades: GradesDocument,
    /// Predicted cycle time of the motion as planned, s; turning the part over between setups is not counted. `null` without a
    /// cell.
    pub cycle_secs: Option<f64>,
    /// Parts of the cycle time; `null` without a cell.
    pub cycle_parts: Option<CycleParts>,
    /// Cycle time and its parts in a sentence; `null` without a cell.
    pub cycle_text: Option<String>,
    /// Cycle of the program in the robot's own dialect, which may move table and arm in turn; `null` without a cell, if the robot's
    /// specification names no dialect, or if there is no program in it.
    #[serde(default)]
    pub program_cycle: Option<ProgramCycle>,
    /// Number of regions of interest and features that have a target.
    pub regions_with_target: usize,
    /// Number of these that miss their target, on the samples that views were chosen on or on independent ones.
    pub regions_unmet: usize,
    /// Regions of interest and features, those that miss their targets first: at most 20. `plan.json` has all (`coverage.regions`).
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub regions: Vec<SummaryRegion>,
    /// Missed share of the asked area, on the samples that views are chosen on.
    pub missed_of_asked: f64,
    /// Number of missed spots.
    pub missed_spots: usize,
    /// Missed share and spots in a sentence.
    pub missed_text: String,
    /// Missed spots, those of the same cause and the same fix together, the largest area first.
    pub missed: Vec<MissedGroup>,
    /// Action that would add the most measured area; `null` if none is known.
    pub action: Option<SummaryAction>,
    /// SHA-256 of `plan.json`, of which this is the summary; `null` before that is written.
    pub plan_sha256: Option<String>,
}

/// Share that heads a plan, with its meaning.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct HeadlineDocument {
    /// Name, with the area that the share is of, such as "measured of visible".
    pub name: String,
    /// The share, 0 to 1.
    pub share: f64,
    /// True if it is on independent samples, which were not used to choose views.
    pub independent: bool,
    /// Meaning, in a sentence without a full stop.
    pub meaning: String,
}

impl From<HeadlineShare> for HeadlineDocument {
    fn from(HeadlineShare { name, share, is_independent, meaning }: HeadlineShare) -> Self {
        Self { name: name.to_owned(), share, independent: is_independent, meaning: meaning.to_owned() }
    }
}

/// A region of interest or a feature: what was asked, what was reached, and why not more.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct SummaryRegion {
    /// Name of the region.
    pub name: String,
    /// Kind of the region.
    pub kind: RegionKind,
    /// Target for the measured share of its asked area; `null` without one.
    pub target: Option<f64>,
    /// Measured share of its asked area, on the samples that views are chosen on.
    pub of_asked: f64,
    /// Measured share on independent samples; `null` if it has none of them.
    pub independent_of_asked: Option<f64>,
    /// False if the target is missed on the samples that views are chosen on, or by more than the standard error on independent ones;
    /// `null` without a target.
    pub met: Option<bool>,
    /// Reasons for which the target is missed, in words, those of most area first; `null` if it is not missed.
    pub why_unmet: Option<String>,
}

impl SummaryRegion {
    /// The regions that a summary lists, those that miss their targets first.
    fn listed(regions: &[RegionCoverage]) -> Vec<Self> {
        let (missing, others): (Vec<_>, Vec<_>) = regions.iter().partition(|region| region.misses_target());
        missing.into_iter().chain(others).take(REGIONS_LISTED).map(Self::of).collect()
    }

    fn of(region: &RegionCoverage) -> Self {
        let refuted = || "reached on the samples that views were chosen on, but not on independent ones".to_owned();
        Self {
            name: region.name.clone(),
            kind: region.kind,
            target: region.target,
            of_asked: region.of_asked(),
            independent_of_asked: region.independent.map(|independent| independent.of_asked()),
            met: region.target.map(|_| !region.misses_target()),
            why_unmet: shortfall(region).or_else(|| region.is_refuted().then(refuted)),
        }
    }
}

/// Headline shares of a plan. They are on independent samples, except the share of the coverable area, which is only known on the
/// samples that views are chosen on.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct SummaryShares {
    /// Measured share of the visible area, which the part neither stands on nor encloses.
    pub of_visible: f64,
    /// Share of the visible area measured at grade A or B.
    pub grades_a_b_of_visible: f64,
    /// Share of the visible area measured at an incidence of at most 35°, against the ray to the origin of the scanner frame.
    pub within_35_deg_of_visible: f64,
    /// Share of the visible area measured at an incidence of at most 60°, against the same ray.
    pub within_60_deg_of_visible: f64,
    /// Measured share of the asked area, on independent samples; the sum of `grades` is that on the samples that views are chosen
    /// on.
    pub of_asked: f64,
    /// Measured share of the coverable area, on the samples that views are chosen on.
    pub of_coverable: f64,
    /// Measured share of the whole surface.
    pub of_total: f64,
    /// Lowest measured shares of the asked area under pose errors; `null` if none are evaluated (`robust.pose_error`), and in summaries
    /// from before they were introduced.
    #[serde(default)]
    pub under_pose_errors: Option<SharesUnderPoseErrors>,
}

/// Lowest measured shares of the asked area under pose errors, on independent samples.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct SharesUnderPoseErrors {
    /// Size of the errors.
    pub pose_error: PoseErrorParams,
    /// True if the size is that of the cell's calibration: twice its standard deviations or twice its residuals, whichever are
    /// larger. Absent if false: the size was given, or is the default.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub of_calibration: bool,
    /// Lowest share, over all draws.
    pub of_asked: f64,
    /// Lowest share with an error of its own of each view.
    pub each_view: WorstShare,
    /// Lowest share with one error of the part and its support.
    pub part: WorstShare,
    /// Lowest share with one error that every view shares, as a wrong hand-eye calibration causes it; `null` if it was not evaluated.
    pub hand_eye: Option<WorstShare>,
}

/// Lowest measured share over the draws of one kind of pose error.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct WorstShare {
    /// Measured share of the asked area.
    pub of_asked: f64,
    /// Number of draws.
    pub draws: usize,
}

impl Summary {
    /// Summarises a plan.
    #[must_use]
    pub fn of(plan: &Plan) -> Self {
        let document = CoverageDocument::from(&plan.coverage);
        let (coverage, motion) = (SummaryShares::from(&document), MotionDocument::of(plan));
        let groups = missed::groups(plan);
        let missed_spots = plan.missed.iter().map(|missed| missed.spots.len()).sum();
        let missed_of_asked = 1.0 - plan.coverage.of_asked();
        let (verdict, regions) = (PlanVerdict::of(plan), &plan.coverage.regions);
        let level = PlanLevel::of(plan, verdict);
        Self {
            schema: SUMMARY_SCHEMA.to_owned(),
            level,
            title: verdict::title(level, verdict, plan, &coverage),
            verdict,
            verdict_text: verdict::text(verdict, plan),
            of_open: plan.coverage.is_of_open,
            views: plan.executed_views(),
            views_chosen: plan.views.len(),
            setups: plan.setups.len(),
            views_text: views_text(plan),
            setup_links: SetupLinkDocument::all_of(plan),
            coverage_text: coverage.text(plan.coverage.is_of_open),
            headline: headline(&document).map(HeadlineDocument::from).into(),
            coverage,
            grades: document.grades,
            cycle_secs: motion.map(|motion| motion.cycle_secs),
            cycle_parts: motion.as_ref().map(CycleParts::from),
            cycle_text: motion.map(|motion| cycle::text(plan, &motion)),
            program_cycle: None,
            regions_with_target: regions.iter().filter(|region| region.target.is_some()).count(),
            regions_unmet: regions.iter().filter(|region| region.misses_target()).count(),
            regions: SummaryRegion::listed(regions),
            missed_of_asked,
            missed_spots,
            missed_text: missed_text([missed_of_asked, 1.0 - coverage.of_asked], missed_spots, plan.coverage.is_of_open),
            action: action::best(plan, verdict, motion.map(|motion| motion.cycle_secs)),
            missed: groups,
            plan_sha256: None,
        }
    }

    /// The summary of the plan whose file has this SHA-256.
    #[must_use]
    pub fn of_file(self, plan_sha256: String) -> Self {
        Self { plan_sha256: Some(plan_sha256), ..self }
    }

    /// The summary with the cycle of the program in the robot's own dialect, told beside that of the plan where the two differ.
    #[must_use]
    pub fn with_program(self, program_cycle: Option<ProgramCycle>) -> Self {
        let told = program_cycle.as_ref().and_then(|program| program.text(self.cycle_secs)).unwrap_or_default();
        let cycle_text = self.cycle_text.map(|text| text + &told);
        Self { cycle_text, program_cycle, ..self }
    }

    /// The summary of a plan whose program in the robot's own dialect was refused, with the reason and the file that holds every reason.
    #[must_use]
    pub fn with_refused_program(self, dialect: Dialect, reason: &str, file: &str) -> Self {
        let told = format!("; NO PROGRAM for the robot ({}), see {file}: {reason}", dialect.as_str());
        let cycle_text = self.cycle_text.map(|text| text + &told);
        Self { cycle_text, program_cycle: None, ..self }
    }

    /// The line of the best action, if one is known.
    #[must_use]
    pub fn next_text(&self) -> Option<String> {
        self.action.as_ref().map(|action| format!("Next: {}", action.text))
    }

    /// The summary in sentences, one on a line, as people read it: title and verdict first, then views, coverage, cycle, what the
    /// robot's program still needs, the best action, and what is missed; the largest groups of missed spots are indented.
    #[must_use]
    pub fn lines(&self) -> Vec<String> {
        self.lines_with_rest("in the report")
    }

    /// Lines of the summary, with the place where the groups are told that have no line of their own.
    #[must_use]
    pub fn lines_with_rest(&self, place: &str) -> Vec<String> {
        let mut lines = vec![self.title.clone(), self.verdict_text.clone(), self.views_text.clone(), self.coverage_text.clone()];
        lines.extend(self.cycle_text.clone());
        lines.extend(self.program_cycle.as_ref().and_then(ProgramCycle::before_first_run_text));
        lines.extend(self.next_text());
        lines.push(self.missed_text.clone());
        let (shown, rest) = self.missed.split_at(self.missed.len().min(GROUPS_SHOWN));
        lines.extend(shown.iter().map(|group| format!("  {}", group.text)));
        if !rest.is_empty() {
            let (spots, of_asked) = rest.iter().fold((0, 0.0), |(spots, sum), group| (spots + group.spots, sum + group.of_asked));
            let noun = if spots == 1 { "spot" } else { "spots" };
            let of = of_asked_phrase(self.of_open);
            lines.push(format!("  {spots} more {noun}, {} {of}: {place}", percent(of_asked)));
        }
        lines
    }
}

impl From<&CoverageDocument> for SummaryShares {
    fn from(coverage: &CoverageDocument) -> Self {
        let [of_visible, grades_a_b, within_35_deg, within_60_deg, of_asked, of_coverable, of_total] =
            headline(coverage).map(|figure| figure.share);
        Self {
            of_visible,
            grades_a_b_of_visible: grades_a_b,
            within_35_deg_of_visible: within_35_deg,
            within_60_deg_of_visible: within_60_deg,
            of_asked,
            of_coverable,
            of_total,
            under_pose_errors: coverage.robust.as_ref().map(SharesUnderPoseErrors::from),
        }
    }
}

impl From<&RobustDocument> for SharesUnderPoseErrors {
    fn from(robust: &RobustDocument) -> Self {
        let worst = |draws: usize, drawn: &DrawnDocument| WorstShare { of_asked: drawn.worst, draws };
        let each_view = worst(robust.draws, &robust.of_asked);
        let part = worst(robust.part.draws, &robust.part.of_asked);
        let hand_eye = robust.hand_eye.map(|off| worst(off.draws, &off.of_asked));
        let of_asked =
            [Some(part), hand_eye].into_iter().flatten().fold(each_view.of_asked, |least, kind| least.min(kind.of_asked));
        Self { pose_error: robust.pose_error, of_calibration: false, of_asked, each_view, part, hand_eye }
    }
}

impl SharesUnderPoseErrors {
    /// The lowest share in a clause; `is_of_open` of what earlier scans left open.
    fn text(&self, is_of_open: bool) -> String {
        let [angle_deg, shift_mm] = pose_error_sizes(&self.pose_error);
        let source = if self.of_calibration { " (twice the uncertainty of the cell's calibration)" } else { "" };
        format!(
            "if poses are off by {angle_deg}° and {shift_mm} mm{source}, at worst {} {}",
            percent(self.of_asked),
            of_asked_phrase(is_of_open)
        )
    }
}

impl Summary {
    /// The summary of a plan in a cell with this calibration: it says where the size of the pose errors comes from.
    #[must_use]
    pub fn with_calibration(mut self, calibrated: Option<&CalibrationProvenance>) -> Self {
        let Some(calibrated) = calibrated else { return self };
        if let Some(shares) = &mut self.coverage.under_pose_errors {
            shares.of_calibration = shares.pose_error == PoseErrorParams::of_calibration(calibrated);
            self.coverage_text = self.coverage.text(self.of_open);
        }
        self
    }
}

impl SummaryShares {
    /// The shares in a sentence; `is_of_open` of what earlier scans left open.
    fn text(&self, is_of_open: bool) -> String {
        let open = if is_of_open { format!(" ({MEANING_OF_OPEN})") } else { String::new() };
        // On independent samples too, so before the share that is not.
        let off = self.under_pose_errors.map_or_else(String::new, |shares| format!("; {}", shares.text(is_of_open)));
        format!(
            "Simulated coverage{open}, independent check: {} of visible ({} at grade A or B, {} within 35°, {} within 60°), {} {}, \
             {} of the whole surface{off}; on the samples that views are chosen on: {} of coverable",
            percent(self.of_visible),
            percent(self.grades_a_b_of_visible),
            percent(self.within_35_deg_of_visible),
            percent(self.within_60_deg_of_visible),
            percent(self.of_asked),
            of_asked_phrase(is_of_open),
            percent(self.of_total),
            percent(self.of_coverable),
        )
    }
}

/// Views, setups, their registration and the bound: "10 views in 1 setup; lower bound 9".
fn views_text(plan: &Plan) -> String {
    let (views, setups) = (counted(plan.executed_views(), "view"), counted(plan.setups.len(), "setup"));
    let left_out = no_path(plan).map_or_else(String::new, |left_out| format!("; {left_out}"));
    let bound = match plan.params.selection.goal {
        // It is a bound of the views that were chosen; 0 of further views, of which none is computed.
        SelectionGoal::FewestViews | SelectionGoal::MinTime if left_out.is_empty() && plan.bound.views_lower > 0 => {
            format!("; lower bound {}", plan.bound.views_lower)
        }
        SelectionGoal::FewestViews | SelectionGoal::MinTime | SelectionGoal::BestCoverage => String::new(),
    };
    let registered = if plan.setups.len() > 1 { registered(plan) } else { "" };
    format!("{views} in {setups}{registered}{bound}{left_out}")
}

/// Returns true if surface holds every setup to the first one, directly or through others; of plans that do not tell their pairs too.
fn is_joined(plan: &Plan) -> bool {
    let fixed = || plan.setup_links.iter().filter(|link| link.stability.is_fixed()).map(|link| link.setups);
    let mut joined = BTreeSet::from([SetupId(0)]);
    for _ in &plan.setups {
        for [one, other] in fixed() {
            if joined.contains(&one) || joined.contains(&other) {
                joined.extend([one, other]);
            }
        }
    }
    plan.setup_links.is_empty() || joined.len() == plan.setups.len()
}

/// Means by which several setups become one measurement, in a clause.
fn registered(plan: &Plan) -> &'static str {
    match plan.params.registration {
        Registration::Surface if !is_joined(plan) => ", not held to each other by the surface that they share",
        Registration::Surface => ", registered by shared surface",
        Registration::Markers => ", to be registered by markers",
        Registration::Fixture => ", to be registered by a fixture",
        Registration::None => ", not registered to each other",
    }
}

/// Chosen views that are not executed, in a clause; `None` where all are.
fn no_path(plan: &Plan) -> Option<String> {
    let chosen = plan.views.len();
    let without_path = chosen - plan.executed_views();
    // Where nothing is left to choose, all that measures something has been given up.
    if chosen == 0 {
        return Some("no collision-free path leads to any view that is worth taking".to_owned());
    }
    (without_path > 0).then(|| format!("no collision-free path leads to {without_path} of {}", counted(chosen, "chosen view")))
}

/// Missed share, on the samples that views are chosen on and on independent ones, and the spots, which the first have.
fn missed_text(missed_of_asked: [f64; 2], spots: usize, is_of_open: bool) -> String {
    let [chosen_on, independent] = missed_of_asked.map(percent);
    let differs = chosen_on != independent;
    let on = if differs {
        format!(" on the samples that views are chosen on (independent check: {independent})")
    } else {
        String::new()
    };
    match spots {
        0 if differs => format!("Missed: nothing{on}"),
        0 => format!("Missed: nothing, all of the {} area is measured", asked_name(is_of_open)),
        _ => format!("Missed: {chosen_on} {}{on}, {}", of_asked_phrase(is_of_open), counted(spots, "spot")),
    }
}

/// Names of regions below their target, with what is reached: `"top" 0.00 %, target 95.00 %`.
fn unmet_regions(regions: &[RegionCoverage]) -> String {
    const NAMED: usize = 3;
    let unmet: Vec<&RegionCoverage> = regions.iter().filter(|region| region.misses_target()).collect();
    // Quoted, so that no name breaks a line.
    let named = unmet.iter().take(NAMED).map(|region| {
        let target = region.target.unwrap_or_default();
        let (of_asked, on) = match region.independent.filter(|_| region.is_refuted()) {
            Some(independent) => (independent.of_asked(), " on independent samples"),
            None => (region.of_asked(), ""),
        };
        format!("{:?} {} %{on}, target {}", region.name, percent_below(of_asked, target, 2), percent(target))
    });
    let named = named.collect::<Vec<_>>().join("; ");
    match unmet.len() {
        more if more > NAMED => format!("{named}; and {} more", more - NAMED),
        _ => named,
    }
}
