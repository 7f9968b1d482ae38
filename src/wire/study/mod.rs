//! Result of a study, for people and for spreadsheets: `<study>.csv`, two plots as SVG files that stand alone, and a page
//! with both plots, the table and the words. Same findings, same bytes.

mod chart;
mod page;
pub mod reach;
mod svg;
mod table;
#[cfg(test)]
mod tests;

use crate::planning::params::PlanParams;
use crate::planning::studies::{Series, Study, StudyResult};

pub use chart::{coverage_svg, grades_svg};
pub use page::html;
pub use table::{csv, text};

/// Everything that the page and the plots tell.
#[derive(Clone, Copy)]
pub struct StudyInput<'a> {
    /// The result.
    pub findings: &'a StudyResult,
    /// The parameters that were left alone.
    pub params: &'a PlanParams,
    /// Name of the part.
    pub part_name: &'a str,
    /// Name of the scanner.
    pub scanner_name: &'a str,
    /// Name of the cell; `None` for viewpoints alone.
    pub cell_name: Option<&'a str>,
    /// Views after which grades are told.
    pub at: usize,
}

impl StudyInput<'_> {
    /// Share of the asked area that `selection.target` comes to for a series: of what the series itself can measure where
    /// the limits vary, else of what the first can, so that all are asked for the same area.
    fn goal_of_asked(&self, series: &Series) -> f64 {
        let whole = match self.findings.study {
            Study::Limits => series,
            Study::Weights | Study::Candidates => &self.findings.series[0],
        };
        self.params.selection.target * whole.coverable_of_asked
    }

    fn views_for_goal(&self, series: &Series) -> Option<usize> {
        series.views_for(self.goal_of_asked(series))
    }

    /// The first column's name.
    fn varied(&self) -> &'static str {
        match self.findings.study {
            Study::Weights => "Weights",
            Study::Limits => "Limit of cameras / projector",
            Study::Candidates => "Strategies",
        }
    }
}
