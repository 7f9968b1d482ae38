//! The verdict, the first thing to read: may the part be scanned, how well, how long it takes, and what to do next. Made in one
//! place, [`VerdictText::of`], from which the section is written.

use std::fmt::Write;

use super::ReportInput;
use super::markup::{duration, escape, number, percent};
use super::palette::Ink;
use super::views::swatch;
use super::words;
use crate::planning::plan::{Grade, Plan, StopReason, share};
use crate::planning::sequence::Sequence;
use crate::wire::plan::AdviceDocument;

/// Standing of a job, which gives the verdict its colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Standing {
    /// A plan that reaches what was asked.
    Met,
    /// A plan that leaves something of it open.
    Short,
    /// No plan.
    NoPlan,
}

/// A figure of the verdict.
pub(super) struct Figure {
    value: String,
    name: &'static str,
    /// Parts of it, or what it is of; may be empty.
    detail: String,
}

impl Figure {
    /// A figure without a detail.
    pub(super) fn new(value: String, name: &'static str) -> Self {
        Self { value, name, detail: String::new() }
    }
}

/// The verdict in words and figures. All text is escaped.
pub(super) struct VerdictText {
    pub(super) standing: Standing,
    pub(super) title: String,
    pub(super) sentence: String,
    pub(super) figures: Vec<Figure>,
    /// The one best action: in words, and the options that do it.
    pub(super) action: Option<[String; 2]>,
}

impl VerdictText {
    /// The verdict on a plan.
    pub(super) fn of(input: &ReportInput<'_>) -> Self {
        let plan = &input.outcome.plan;
        let with_target = plan.coverage.regions.iter().filter(|region| region.target.is_some()).count();
        let unmet = plan.coverage.regions.iter().filter(|region| region.is_unmet()).count();
        let left_out = plan.views.iter().filter(|view| view.rejected.is_some()).count();
        let is_met = plan.stopped_because == StopReason::Target && unmet == 0 && left_out == 0;
        let mut sentence = words::stop(plan.stopped_because, &plan.params);
        // Writing to a String cannot fail.
        if unmet > 0 {
            let verb = if unmet == 1 { "does" } else { "do" };
            let _ = write!(sentence, " {unmet} of {with_target} regions and features with a target {verb} not reach it.");
        }
        if left_out > 0 {
            let noun = if left_out == 1 { "view is" } else { "views are" };
            let _ = write!(sentence, " {left_out} chosen {noun} not executed: no collision-free path leads there.");
        }
        let advice = AdviceDocument::all_of(plan);
        Self {
            standing: if is_met { Standing::Met } else { Standing::Short },
            title: if is_met { "Ready to scan".to_owned() } else { "Can be scanned, with gaps".to_owned() },
            sentence,
            figures: figures(input, plan),
            action: advice.first().map(|advice| [escape(&advice.text), escape(&advice.options())]),
        }
    }

    /// The verdict as a block of the page.
    pub(super) fn block(&self) -> String {
        let class = match self.standing {
            Standing::Met => "met",
            Standing::Short => "short",
            Standing::NoPlan => "none",
        };
        let figure = |figure: &Figure| {
            let detail = match figure.detail.as_str() {
                "" => String::new(),
                detail => format!("<small>{detail}</small>"),
            };
            format!("<div class=\"figure\"><b>{}</b><span>{}</span>{detail}</div>", figure.value, figure.name)
        };
        let figures: String = self.figures.iter().map(figure).collect();
        let figures = if figures.is_empty() { figures } else { format!("<div class=\"figures\">{figures}</div>\n") };
        let action = self.action.as_ref().map_or_else(String::new, |[text, options]| {
            format!("<p class=\"action\"><b>To measure more:</b> {text}<br/><code>{options}</code></p>\n")
        });
        format!("<div class=\"verdict {class}\">\n<h2>{}</h2>\n<p>{}</p>\n</div>\n{figures}{action}", self.title, self.sentence)
    }
}

/// Section with the verdict, and the pictures of the whole plan.
pub(super) fn section(input: &ReportInput<'_>, pictures: &str) -> String {
    format!(
        "<section>\n{}{}{pictures}\
         <div class=\"notice\"><p><b>This is simulated coverage, computed from the models of the part and of the scanner. \
         It is not a measurement.</b> Shiny, dark or transparent surfaces, and parts that differ from their model, give less. \
         The planner is not safety-rated: guarding, speed limits and emergency stops belong to the cell’s own safety \
         system.</p></div>\n</section>\n",
        VerdictText::of(input).block(),
        grades_bar(input)
    )
}

fn figures(input: &ReportInput<'_>, plan: &Plan) -> Vec<Figure> {
    let visible = plan.coverage.independent.of_visible();
    let executed = plan.views.iter().filter(|view| view.rejected.is_none()).count();
    let mut figures = vec![
        Figure {
            value: percent(visible.measured),
            name: "of the visible surface measured",
            detail: format!("{} of it at grade A or B", percent(visible.grades_a_b)),
        },
        Figure {
            value: number(executed as f64, 0),
            name: if executed == 1 { "view" } else { "views" },
            detail: format!("at least {} are needed", number(f64::from(plan.bound.views_lower), 0)),
        },
    ];
    if plan.setups.len() > 1 {
        let detail = "the part is turned over between them".to_owned();
        figures.push(Figure { value: number(plan.setups.len() as f64, 0), name: "setups", detail });
    }
    figures.extend(input.cycle_secs.map(|secs| Figure { value: duration(secs), name: "cycle time", detail: cycle_parts(plan) }));
    figures
}

/// Components of the cycle time: "23.4 s moving + 6 × 1.3 s scanning".
fn cycle_parts(plan: &Plan) -> String {
    let moving: f64 = plan.sequences().map(Sequence::motion_secs).sum();
    let (stops, scan) = (plan.visits().count(), &plan.params.scan);
    format!("{} moving + {stops} × {} scanning", duration(moving), duration(scan.settle_secs + scan.capture_secs))
}

/// Bar of the asked area by grade, and the rest.
fn grades_bar(input: &ReportInput<'_>) -> String {
    let coverage = &input.outcome.plan.coverage;
    let grades = [(Grade::A, "A"), (Grade::B, "B"), (Grade::C, "C"), (Grade::D, "D")];
    let (mut bar, mut legend, mut spoken) = (String::new(), String::new(), String::new());
    for (grade, name) in grades {
        let (ink, share) =
            (Ink::Measured(grade), share(coverage.measured.grade_area_mm2[grade as usize], coverage.asked_area_mm2));
        // Writing to a String cannot fail.
        let _ = write!(bar, "<i style=\"width:{:.3}%;background:{}\"></i>", share * 100.0, ink.hex());
        let _ = write!(legend, "<li>{}Grade {name} {}</li>", swatch(ink), percent(share));
        let _ = write!(spoken, "grade {name} {}, ", percent(share));
    }
    let (missed, ink) = (1.0 - coverage.of_asked(), Ink::Unmeasured);
    let _ = write!(bar, "<i style=\"width:{:.3}%;background:{}\"></i>", missed * 100.0, ink.hex());
    format!(
        "<div class=\"bar\" role=\"img\" aria-label=\"Asked area: {spoken}missed {missed}\">{bar}</div>\n\
         <ul class=\"legend\">{legend}<li>{}Missed {missed}</li></ul>\n\
         <p class=\"soft\" style=\"margin-top:6px\">Shares of the asked area. The grade of a point says how squarely, and how \
         close to best focus, its best view sees it: A is close to the ideal, D is close to the scanner’s limits.</p>\n",
        swatch(ink),
        missed = percent(missed)
    )
}
