//! `<study>.html`: both plots, the table and an explanation, in one file in the style of the plan's report.

use super::table::goal;
use super::{StudyInput, coverage_svg, grades_svg};
use crate::planning::plan::StopReason;
use crate::planning::studies::{Series, Study};
use crate::report::html::markup::{escape, number, percent};
use crate::report::html::page::document;
use crate::wire::words::{changed_params, counted};

/// Renders the page.
#[must_use]
pub fn html(input: &StudyInput<'_>) -> String {
    let title = match input.findings.study {
        Study::Weights => "Weights of coverage and quality",
        Study::Limits => "Limits of incidence",
        Study::Candidates => "Candidate strategies",
    };
    let figure = |name: &str, svg: String| format!("<section>\n<h2>{name}</h2>\n<div class=\"card\">{svg}</div>\n</section>\n");
    let body = [
        header(input, title),
        "<main>\n".to_owned(),
        format!("<section>\n<h2>What was varied</h2>\n<p>{}</p>\n</section>\n", words(input)),
        figure("Coverage", coverage_svg(input)),
        figure("Grades", grades_svg(input)),
        table(input),
        skipped(input),
        settings(input),
        "</main>\n".to_owned(),
    ];
    document(&format!("{title}: {}", input.part_name), &body.concat())
}

fn header(input: &StudyInput<'_>, title: &str) -> String {
    let facts = [
        ("Part", input.part_name),
        ("Scanner", input.scanner_name),
        ("Cell", input.cell_name.unwrap_or("none: viewpoints only")),
    ];
    let facts = facts.map(|(name, value)| format!("<div><dt>{name}</dt><dd>{}</dd></div>", escape(value)));
    format!("<header>\n<p class=\"kind\">Study</p>\n<h1>{title}</h1>\n<dl class=\"facts\">{}</dl>\n</header>\n", facts.concat())
}

fn words(input: &StudyInput<'_>) -> String {
    let varied = match input.findings.study {
        Study::Weights => {
            "The score of a view is a times the area that it adds plus b times the quality at which it adds it. Here a falls \
             from 1 to 0 and b is 1 − a: less weight on area takes more views, more weight on quality gives better grades. \
             Once nothing of positive score is left, a score by quality ends the selection."
        }
        Study::Limits => {
            "A point counts as measured only up to a limit of incidence. Here the limit of the cameras falls from 85° to 45°, \
             and that of the projector is 7.5° lower: narrower limits give better grades, leave more of the surface unmeasured \
             and take more views."
        }
        Study::Candidates => {
            "Views are chosen from candidates. Here each strategy is used alone, then the mix that was configured. A poor set \
             of candidates looks good against what it can measure itself, so views are compared for the same area."
        }
    };
    format!(
        "{varied} Each series is the thesis’s greedy selection, from its first view on. Shares are of the asked area, on the \
         samples that views are chosen on. The goal is {}.",
        escape(&goal(input))
    )
}

fn table(input: &StudyInput<'_>) -> String {
    let rows: Vec<String> = input.findings.series.iter().map(|series| row(input, series)).collect();
    format!(
        "<section>\n<h2>Results</h2>\n<div class=\"card scroll\"><table>\n<thead><tr><th>{}</th><th class=\"n\">Candidates</th>\
         <th class=\"n\">Coverable</th><th class=\"n\">Views for the goal</th><th class=\"n\">After {}</th>\
         <th class=\"n\">A</th><th class=\"n\">B</th><th class=\"n\">C</th><th class=\"n\">D</th><th>Ended after</th></tr></thead>\n\
         <tbody>\n{}</tbody></table></div>\n</section>\n",
        input.varied(),
        counted(input.at, "view"),
        rows.concat()
    )
}

fn row(input: &StudyInput<'_>, series: &Series) -> String {
    let step = series.after(input.at);
    let views = input.views_for_goal(series).map_or_else(|| "not reached".to_owned(), |views| number(views as f64, 0));
    let mut figures =
        vec![number(series.candidates as f64, 0), percent(series.coverable_of_asked), views, percent(step.of_asked)];
    figures.extend(step.grades.map(percent));
    let figures: Vec<String> = figures.iter().map(|figure| format!("<td class=\"n\">{figure}</td>")).collect();
    let reason = match series.stopped_because {
        StopReason::Target => "all that can be measured",
        StopReason::Growth => "growth too small",
        StopReason::MaxViews => "limit of views",
        StopReason::NoGain | StopReason::NoPath | StopReason::RegionsUnmet => "nothing left to gain",
    };
    let views = counted(series.steps.len(), "view");
    format!("<tr><td>{}</td>{}<td>{views}: {reason}</td></tr>\n", escape(&series.label), figures.concat())
}

fn skipped(input: &StudyInput<'_>) -> String {
    let items: Vec<String> = input
        .findings
        .skipped
        .iter()
        .map(|(label, reason)| format!("<li><b>{}</b>: {}</li>\n", escape(label), escape(reason)))
        .collect();
    if items.is_empty() {
        return String::new();
    }
    format!("<section>\n<h2>Skipped</h2>\n<ul>\n{}</ul>\n</section>\n", items.concat())
}

fn settings(input: &StudyInput<'_>) -> String {
    let changed = changed_params(input.params);
    if changed.is_empty() {
        return String::new();
    }
    let rows: Vec<String> = changed
        .iter()
        .map(|(key, value)| format!("<tr><td><code>{}</code></td><td><code>{}</code></td></tr>\n", escape(key), escape(value)))
        .collect();
    format!(
        "<section>\n<h2>Parameters that were not varied</h2>\n<div class=\"card scroll\"><table>\n\
         <thead><tr><th>Parameter changed from its default</th><th>Value</th></tr></thead>\n\
         <tbody>\n{}</tbody></table></div>\n</section>\n",
        rows.concat()
    )
}
