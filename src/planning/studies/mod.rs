//! One knob varied and the rest left alone, each time with the thesis's greedy from the first view on: what coverage and
//! grades come out after 1, 2, … views (thesis §3.3, there for the weights a and b on a part that is not public).
//!
//! [`Study::Weights`]: a falling from 1 to 0, b = 1 − a; c and d as they are. Visibility is computed once. [`Study::Limits`]:
//! the cameras' limit of incidence from 85° to 45°, the projector's 7.5° below it ([`crate::planning::method::scanner`]).
//! [`Study::Candidates`]: each strategy alone, then the mix that the parameters name.
//!
//! Shares are of the samples that views are chosen on. Cost: that of the tables; choosing is the least of it.

mod ground;
pub mod reach;
mod steps;
#[cfg(test)]
mod tests;

use super::context::{Context, NoPlan, PlanError, Refusal, Stage};
use super::params::{Objective, PlanParams, ScoreParams, Strategy};
use super::scene::PlanInput;
use super::selection::StopReason;
use crate::cell::FieldError;
use ground::StudyBase;

/// The thesis's five values of a (§3.3), b = 1 − a.
const WEIGHTS_A: [f64; 5] = [1.0, 0.75, 0.5, 0.25, 0.0];
/// Limits of the cameras, degrees.
const CAMERA_LIMITS_DEG: [f64; 5] = [85.0, 75.0, 65.0, 55.0, 45.0];
/// Difference by which the projector's limit lies below that of the cameras, degrees.
const PROJECTOR_BELOW_DEG: f64 = 7.5;

/// The parameter that is varied.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Study {
    /// Weights of coverage and quality in the score.
    Weights,
    /// Limits of incidence.
    Limits,
    /// Candidate strategies.
    Candidates,
}

/// One value of what is varied, with its name, and the parameters that it makes.
#[derive(Clone, Debug)]
struct StudyCase {
    label: String,
    settings: Vec<(&'static str, String)>,
    params: PlanParams,
}

/// Result of a study.
#[derive(Clone, Debug, PartialEq)]
pub struct StudyResult {
    /// The parameter that was varied.
    pub study: Study,
    /// Results for each value, in order.
    pub series: Vec<Series>,
    /// Values that could not be used here, with the reason.
    pub skipped: Vec<(String, String)>,
}

/// Result for one value.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// The value in words.
    pub label: String,
    /// The value by the names of the parameters.
    pub settings: Vec<(&'static str, String)>,
    /// Candidates that views were chosen from.
    pub candidates: usize,
    /// Share of the asked area that they can measure.
    pub coverable_of_asked: f64,
    /// Coverage after 1, 2, … views.
    pub steps: Vec<StudyStep>,
    /// The rule that ended the choice of views.
    pub stopped_because: StopReason,
}

/// Coverage by the views so far.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StudyStep {
    /// Share of the asked area.
    pub of_asked: f64,
    /// Share of the coverable area.
    pub of_coverable: f64,
    /// Share of the whole surface.
    pub of_total: f64,
    /// Shares of the asked area by grade A, B, C, D.
    pub grades: [f64; 4],
}

impl Study {
    /// Every study.
    pub const ALL: [Self; 3] = [Self::Weights, Self::Limits, Self::Candidates];

    /// Name on the command line and in files.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Weights => "weights",
            Self::Limits => "limits",
            Self::Candidates => "candidates",
        }
    }

    /// Findings on parameters that the study sets by itself.
    fn set_by_itself(self, params: &PlanParams) -> Vec<FieldError> {
        let default = PlanParams::default();
        let (own, of_default) = (&params.score, &default.score);
        let (selection, default_selection) = (&params.selection, &default.selection);
        let mut given = vec![
            ("/selection/max_views", selection.max_views.is_some()),
            ("/selection/solver", selection.solver != default_selection.solver),
            ("/selection/target", selection.target.to_bits() != default_selection.target.to_bits()),
            ("/selection/target_of", selection.target_of != default_selection.target_of),
        ];
        given.extend(match self {
            Self::Weights => vec![
                ("/score/a", own.a.to_bits() != of_default.a.to_bits()),
                ("/score/b", own.b.to_bits() != of_default.b.to_bits()),
                ("/selection/objective", selection.objective != default_selection.objective),
            ],
            Self::Limits => vec![
                ("/limits/camera_deg", params.limits.camera_deg.is_some()),
                ("/limits/projector_deg", params.limits.projector_deg.is_some()),
            ],
            Self::Candidates => Vec::new(),
        });
        let finding = |pointer: &str| FieldError { pointer: pointer.to_owned(), detail: Refusal::SetByStudy.to_string() };
        given.into_iter().filter(|(_, is_given)| *is_given).map(|(pointer, _)| finding(pointer)).collect()
    }

    fn cases(self, params: &PlanParams) -> Vec<StudyCase> {
        match self {
            Self::Weights => WEIGHTS_A.map(|a| weights(params, a)).into(),
            Self::Limits => CAMERA_LIMITS_DEG.map(|deg| limits(params, deg)).into(),
            Self::Candidates => strategies(params),
        }
    }
}

impl Series {
    /// Coverage by `views` views: the last step where fewer were taken, nothing where none was.
    #[must_use]
    pub fn after(&self, views: usize) -> StudyStep {
        let taken = views.min(self.steps.len());
        taken.checked_sub(1).map_or_else(StudyStep::default, |last| self.steps[last])
    }

    /// Views for so much of the asked area; `None` where those taken do not measure it.
    #[must_use]
    pub fn views_for(&self, of_asked: f64) -> Option<usize> {
        /// Sums of areas in another order.
        const SUM_SLACK: f64 = 1e-9;
        self.steps.iter().position(|step| step.of_asked >= of_asked - SUM_SLACK).map(|step| step + 1)
    }
}

/// Runs a study: at most `max_views` views a value.
///
/// # Errors
/// [`PlanError`], where no value can be used at all or none measures anything, and for a parameter that the study sets by itself.
pub fn run(
    study: Study,
    input: &PlanInput<'_>,
    params: &PlanParams,
    max_views: u32,
    ctx: &Context<'_>,
) -> Result<StudyResult, PlanError> {
    params.check().map_err(PlanError::BadParams)?;
    let given = study.set_by_itself(params);
    if !given.is_empty() {
        return Err(PlanError::BadParams(given));
    }
    let mut findings = StudyResult { study, series: Vec::new(), skipped: Vec::new() };
    let mut shared: Option<StudyBase> = None;
    let mut refused = None;
    for case in study.cases(params) {
        let ground = match shared.take() {
            Some(ground) => Ok(ground),
            None => StudyBase::new(input, &case.params, ctx),
        };
        match ground {
            Ok(ground) => {
                let series = ctx.stage(Stage::Selection, || ground.series(&case, input, max_views, ctx))?;
                findings.series.push(series);
                shared = Some(ground).filter(|_| study == Study::Weights);
            }
            Err(PlanError::BadParams(errors)) => {
                let reasons: Vec<String> = errors.iter().map(ToString::to_string).collect();
                findings.skipped.push((case.label, reasons.join("; ")));
                refused = Some(PlanError::BadParams(errors));
            }
            Err(error) => return Err(error),
        }
    }
    match refused {
        Some(error) if findings.series.is_empty() => Err(error),
        _ if findings.series.iter().all(|series| series.steps.is_empty()) => Err(PlanError::NoPlan(NoPlan::NothingInStudy)),
        _ => Ok(findings),
    }
}

fn weights(params: &PlanParams, a: f64) -> StudyCase {
    let mut params = params.clone();
    params.selection.objective = Objective::Score;
    params.score = ScoreParams { a, b: 1.0 - a, ..params.score };
    let settings = vec![("score.a", params.score.a.to_string()), ("score.b", params.score.b.to_string())];
    StudyCase { label: format!("a = {:.2}, b = {:.2}", params.score.a, params.score.b), settings, params }
}

fn limits(params: &PlanParams, camera_deg: f64) -> StudyCase {
    let (mut params, projector_deg) = (params.clone(), camera_deg - PROJECTOR_BELOW_DEG);
    (params.limits.camera_deg, params.limits.projector_deg) = (Some(camera_deg), Some(projector_deg));
    let settings = vec![("limits.camera_deg", camera_deg.to_string()), ("limits.projector_deg", projector_deg.to_string())];
    StudyCase { label: format!("{camera_deg}° / {projector_deg}°"), settings, params }
}

fn strategies(params: &PlanParams) -> Vec<StudyCase> {
    let case = |strategies: &[Strategy]| {
        let mut params = params.clone();
        params.candidates.strategies = strategies.to_vec();
        let label = strategies.iter().map(|strategy| strategy.as_str()).collect::<Vec<_>>().join(" + ");
        StudyCase { settings: vec![("candidates.strategies", label.clone())], label, params }
    };
    let mut cases: Vec<StudyCase> = Strategy::ALL.iter().map(|strategy| case(&[*strategy])).collect();
    if params.candidates.strategies.len() > 1 {
        cases.push(case(&params.candidates.strategies));
    }
    cases
}
