//! The findings as a table: every step for spreadsheets, one line per series for people.

use super::StudyInput;
use crate::planning::studies::{Series, Study};
use crate::wire::csv::Csv;
use crate::wire::words::{counted, fixed, percent_below};

const STEP_COLUMNS: [&str; 11] = [
    "candidates",
    "coverable_of_asked",
    "views",
    "of_asked",
    "of_coverable",
    "of_total",
    "grade_a",
    "grade_b",
    "grade_c",
    "grade_d",
    "stopped_because",
];

/// The table for spreadsheets, one row per series and number of views, 1, 2, …; shares are from 0 to 1, those of grades of the
/// asked area. Only the last row of a series has the reason for which it ended.
#[must_use]
pub fn csv(input: &StudyInput<'_>) -> String {
    let findings = input.findings;
    let keys = findings.series.first().map_or_else(Vec::new, |series| series.settings.iter().map(|(key, _)| *key).collect());
    let header: Vec<&str> = keys.into_iter().chain(STEP_COLUMNS).collect();
    let mut csv = Csv::new(&header);
    for series in &findings.series {
        for (step, views) in series.steps.iter().zip(1..) {
            series.settings.iter().for_each(|(_, value)| csv.text(value));
            csv.number(series.candidates);
            csv.number(series.coverable_of_asked);
            csv.number(views);
            [step.of_asked, step.of_coverable, step.of_total].into_iter().chain(step.grades).for_each(|share| csv.number(share));
            csv.optional((views == series.steps.len()).then(|| series.stopped_because.as_str()));
            csv.end_row();
        }
    }
    csv.finish()
}

/// The table for a terminal; every line ends with a newline.
#[must_use]
pub fn text(input: &StudyInput<'_>) -> String {
    let width = input.findings.series.iter().map(|series| series.label.chars().count()).max().unwrap_or_default();
    let (width, percent) = (width.max(input.varied().len()), |share: f64| percent_below(share, 1.0, 2));
    let after = format!("after {} %", counted(input.at, "view"));
    let mut out = format!("{:width$}  candidates  coverable %  views for goal  {after}", input.varied());
    out += "      A      B      C      D\n";
    for series in &input.findings.series {
        let (step, views) = (series.after(input.at), input.views_for_goal(series));
        let views = views.map_or_else(|| "–".to_owned(), |views| views.to_string());
        out += &format!("{:width$}  {:>10}  {:>11}", series.label, series.candidates, percent(series.coverable_of_asked));
        out += &format!("  {views:>14}  {:>1$}", percent(step.of_asked), after.len());
        out += &step.grades.map(|share| format!(" {:>6}", percent(share))).concat();
        out.push('\n');
    }
    for (label, reason) in &input.findings.skipped {
        out += &format!("{label:width$}  left out: {reason}\n");
    }
    out + &format!("goal: {}\n", goal(input))
}

/// Describes the area that a series has to measure.
pub(super) fn goal(input: &StudyInput<'_>) -> String {
    let target = fixed(100.0 * input.params.selection.target, 2);
    let target = target.trim_end_matches('0').trim_end_matches('.').to_owned();
    match (input.findings.study, input.findings.series.first()) {
        (Study::Candidates, Some(Series { label, .. })) => format!("{target} % of what the candidates of {label} can measure"),
        (Study::Limits, _) => format!("{target} % of what can be measured within these limits"),
        _ => format!("{target} % of what the candidates can measure"),
    }
}
