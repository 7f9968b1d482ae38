//! Table to chosen views (thesis §3.3, method §5): the greedy rule and every rule that ends it.

mod greedy;
#[cfg(test)]
mod tests;

use super::context::{Cancelled, Context};
use super::params::{ScoreParams, SelectionParams, Solver, TargetOf};
use super::visibility::{Row, SampleSet};

/// Dense number of a chosen view, in the order chosen, from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ViewId(pub u32);

/// What views are chosen from.
pub struct Problem<'a> {
    /// Rows of the candidates that may be chosen, ascending by candidate number.
    pub rows: Vec<&'a Row>,
    /// Area that each sample stands for, mm²; 0 for samples that are not asked for.
    pub asked_area_mm2: &'a [f64],
    /// Area of the whole surface, mm².
    pub total_mm2: f64,
}

/// One choice.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Choice {
    /// Index into [`Problem::rows`].
    pub row: usize,
    /// Asked area that it added, mm².
    pub gain_mm2: f64,
    /// Its score when chosen, mm²: G_v, or plain area.
    pub score: f64,
}

/// Which rule ended the selection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StopReason {
    /// The target share was reached.
    Target,
    /// The best view would add less than `selection.min_growth`.
    Growth,
    /// `selection.max_views` views were chosen.
    MaxViews,
    /// No candidate's score is positive.
    NoGain,
    /// The target was met only of what the views with a path measure; others were tried in place of those without.
    NoPath,
}

impl StopReason {
    /// Every rule.
    pub const ALL: [Self; 5] = [Self::Target, Self::Growth, Self::MaxViews, Self::NoGain, Self::NoPath];

    /// Name in files and answers.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Target => "target",
            Self::Growth => "growth",
            Self::MaxViews => "max_views",
            Self::NoGain => "no_gain",
            Self::NoPath => "no_path",
        }
    }
}

/// Chosen views, in the order chosen.
#[derive(Clone, Debug, PartialEq)]
pub struct Selection {
    /// The choices.
    pub choices: Vec<Choice>,
    /// The rule that ended it.
    pub stopped_because: StopReason,
}

/// Chooses views.
///
/// # Errors
/// [`Cancelled`].
pub fn select(
    problem: &Problem<'_>,
    params: &SelectionParams,
    score: &ScoreParams,
    ctx: &Context<'_>,
) -> Result<Selection, Cancelled> {
    match params.solver {
        Solver::Greedy => greedy::select(problem, params, score, ctx),
    }
}

impl Problem<'_> {
    /// Samples that at least one row measures.
    #[must_use]
    pub fn coverable(&self) -> SampleSet {
        let mut coverable = SampleSet::none_of(self.asked_area_mm2.len());
        self.rows.iter().for_each(|row| coverable.insert_all(row.measured()));
        coverable
    }

    /// Asked area that at least one row measures.
    #[must_use]
    pub fn coverable_mm2(&self) -> f64 {
        self.coverable().iter().map(|sample| self.asked_area_mm2[sample as usize]).sum()
    }

    /// Asked area.
    #[must_use]
    pub fn asked_mm2(&self) -> f64 {
        self.asked_area_mm2.iter().sum()
    }

    fn target_mm2(&self, params: &SelectionParams) -> f64 {
        let whole_mm2 = match params.target_of {
            TargetOf::Coverable => self.coverable_mm2(),
            TargetOf::Asked => self.asked_mm2(),
            TargetOf::Total => self.total_mm2,
        };
        params.target * whole_mm2
    }
}
