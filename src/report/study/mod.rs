//! Results of a study, for people and for spreadsheets: `<study>.csv`, two plots as standalone SVG files, and a page with both
//! plots, the table and an explanation. Equal findings give equal bytes.

mod chart;
mod page;
pub mod reach;
pub(super) mod svg;
mod table;
#[cfg(test)]
mod tests;

use crate::planning::params::PlanParams;
use crate::planning::studies::{Series, Study, StudyResult};

pub use chart::{coverage_svg, grades_svg};
pub use page::html;
pub use table::{csv, text};

/// Input of the page and the plots.
#[derive(Clone, Copy)]
pub struct StudyInput<'a> {
    /// The result.
    pub findings: &'a StudyResult,
    /// Parameters that were not varied.
    pub params: &'a PlanParams,
    /// Name of the part.
    pub part_name: &'a str,
    /// Name of the scanner.
    pub scanner_name: &'a str,
    /// Name of the cell; `None` for viewpoints only.
    pub cell_name: Option<&'a str>,
    /// Number of views after which grades are compared.
    pub at: usize,
}

impl StudyInput<'_> {
    /// Goal for a series as a share of the asked area: `selection.target` of what the series itself can measure if the limits
    /// vary, else of what the first series can, so that all have to measure the same area.
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

    /// Title of the first column.
    fn varied(&self) -> &'static str {
        match self.findings.study {
            Study::Weights => "Weights",
            Study::Limits => "Limit of cameras / projector",
            Study::Candidates => "Strategies",
        }
    }
}
