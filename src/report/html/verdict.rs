//! The verdict, the first thing to read: may the part be scanned, how well, how long it takes, and what to do next. Made in one
//! place, [`VerdictText::of`], from which the section is written.

use std::fmt::Write;

use super::ReportInput;
use super::markup::{duration, escape, number, percent, with_options};
use super::views::{swatch, together};
use crate::planning::plan::{Bound, Grade, Plan, share};
use crate::rendering::Ink;
use crate::wire::summary::{MissedGroup, PlanLevel, ProgramCycle, Summary};
use crate::wire::words::MEANING_OF_OPEN;

/// Standing of a job, which gives the verdict its colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Standing {
    /// A plan that reaches what was asked.
    Met,
    /// A plan that leaves something of it open.
    Short,
    /// A job without a plan.
    NoPlan,
}

impl From<PlanLevel> for Standing {
    fn from(level: PlanLevel) -> Self {
        match level {
            PlanLevel::Ready => Self::Met,
            PlanLevel::Limited => Self::Short,
            PlanLevel::NotExecutable => Self::NoPlan,
        }
    }
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
    /// Sentences, the verdict's first.
    pub(super) lines: Vec<String>,
    /// The one thing to do next; empty if none is known.
    pub(super) next: String,
    pub(super) figures: Vec<Figure>,
}

/// Characters of a command that a sentence may hold; a pose of the part alone has more.
const COMMAND_CHARS: usize = 120;
/// Words in place of a longer command.
const LEFT_OUT: &str = " (options in report.txt)";

/// The sentence with `instead` in place of a command that nobody would read to its end.
fn readable(sentence: &str, command: &str, instead: &str) -> String {
    if is_long(command) { sentence.replace(&format!(": {command}"), instead) } else { sentence.to_owned() }
}

fn is_long(command: &str) -> bool {
    command.len() > COMMAND_CHARS
}

impl VerdictText {
    /// The verdict on a plan, in the sentences of its summary.
    pub(super) fn of(input: &ReportInput<'_>) -> Self {
        let (plan, summary) = (&input.outcome.plan, input.summary);
        let (next, command) = (summary.next_text(), summary.action.as_ref().and_then(|action| action.command.clone()));
        let has_place = |line: &String| *line == summary.title || next.as_ref() == Some(line);
        let of_groups: Vec<String> = summary.missed.iter().filter_map(MissedGroup::command).collect();
        let shortened = |line: String| of_groups.iter().fold(line, |line, command| readable(&line, command, LEFT_OUT));
        let lines = summary
            .lines_with_rest("see “What is missed, and how to fix it” below")
            .into_iter()
            .filter(|line| !has_place(line))
            .map(|line| with_options(shortened(line).trim_start()));
        // Options that are too long for the sentence follow on a line of their own.
        let told = next.as_ref().map(|next| command.iter().fold(next.clone(), |next, command| readable(&next, command, "")));
        Self {
            standing: Standing::from(summary.level),
            title: escape(&summary.title),
            lines: lines.collect(),
            next: told.map_or_else(String::new, |told| {
                with_options(&told) + &command.filter(|command| is_long(command)).map(code).unwrap_or_default()
            }),
            figures: figures(plan, summary),
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
        let line = |line: &String| format!("<li>{line}</li>\n");
        let (first, rest) = self.lines.split_first().map_or(("", &[][..]), |(first, rest)| (first, rest));
        let rest: String = rest.iter().map(line).collect();
        let rest = if rest.is_empty() { rest } else { format!("<ul class=\"card summary\">\n{rest}</ul>\n") };
        let next = match self.next.as_str() {
            "" => String::new(),
            next => format!("<p class=\"action\">{next}</p>\n"),
        };
        format!("<div class=\"verdict {class}\">\n<h2>{}</h2>\n<p>{first}</p>\n</div>\n{next}{figures}{rest}", self.title)
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

fn figures(plan: &Plan, summary: &Summary) -> Vec<Figure> {
    let mut figures = vec![
        Figure {
            value: percent(summary.coverage.of_visible),
            name: match plan.coverage.is_of_open {
                true => "of the visible surface that earlier scans left open measured",
                false => "of the visible surface measured",
            },
            detail: format!("{} of it at grade A or B", percent(summary.coverage.grades_a_b_of_visible)),
        },
        Figure {
            value: number(summary.views as f64, 0),
            name: if summary.views == 1 { "view" } else { "views" },
            detail: match summary.views_chosen - summary.views {
                0 => views_detail(&plan.bound),
                left_out => without_path(left_out),
            },
        },
    ];
    if summary.setups > 1 {
        let detail = "the part is turned over between them".to_owned();
        figures.push(Figure { value: number(summary.setups as f64, 0), name: "setups", detail });
    }
    // A tour of no view has no cycle.
    figures.extend(summary.cycle_secs.filter(|_| summary.views > 0).map(|secs| Figure {
        value: duration(secs),
        name: "cycle time",
        detail: summary.program_cycle.as_ref().filter(|program| program.differs()).map_or_else(String::new, as_program),
    }));
    figures
}

/// Lower bound of the number of views; of further views none is computed.
fn views_detail(bound: &Bound) -> String {
    match bound.views_lower {
        0 => "beside those of earlier scans".to_owned(),
        lower => format!("lower bound {}", number(f64::from(lower), 0)),
    }
}

/// Chosen views that are not executed.
fn without_path(views: usize) -> String {
    let (were, have) = if views == 1 { ("was", "has") } else { ("were", "have") };
    format!("{views} more {were} chosen and {have} no path")
}

/// Options of the command line on a line of their own, to be copied.
fn code(options: String) -> String {
    format!("<br/>{}", with_options(&options))
}

/// Cycle of the robot's own program, where it is another.
fn as_program(program: &ProgramCycle) -> String {
    format!("{} as a program for the robot ({})", duration(program.cycle_secs), program.dialect.as_str())
}

/// Part of the bar, with its name where there is room: colours are not told apart on a grey print.
fn segment(share: f64, ink: Ink, name: &str) -> String {
    const PER_LETTER: f64 = 0.025;
    let has_room = share > PER_LETTER * (1.0 + name.len() as f64);
    let name = if has_room { format!("<b>{name}</b>") } else { String::new() };
    format!("<i style=\"width:{:.3}%;background:{}\">{name}</i>", share * 100.0, ink.hex())
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
        bar += &segment(share, ink, name);
        let _ = write!(legend, "<li>{}Grade {name} {}</li>", swatch(ink), percent(share));
        let _ = write!(spoken, "grade {name} {}, ", percent(share));
    }
    let (missed, ink) = (1.0 - coverage.of_asked(), Ink::Unmeasured);
    bar += &segment(missed, ink, "missed");
    let missed = percent(missed);
    let (whole, asked) = if coverage.is_of_open { ("Open", "open") } else { ("Asked", "asked") };
    let bar = format!("<div class=\"bar\" role=\"img\" aria-label=\"{whole} area: {spoken}missed {missed}\">{bar}</div>\n");
    let legend = format!("<ul class=\"legend\">{legend}<li>{}Missed {missed}</li></ul>\n", swatch(ink));
    let of_open = if coverage.is_of_open { format!(" ({MEANING_OF_OPEN})") } else { String::new() };
    let meaning = format!(
        "<p class=\"soft\" style=\"margin-top:6px\">Shares of the {asked} area{of_open}, on the samples that views are chosen on. The grade of a \
                   point says how squarely, and how close to best focus, its best view sees it: A is close to the ideal, D is close to the \
                   scanner’s limits.</p>\n"
    );
    together(&bar, &(legend + &meaning))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The verdict said "lower bound 0" of further views.
    #[test]
    fn a_bound_that_was_not_computed_is_no_figure() {
        let told = [0, 9].map(|views_lower| views_detail(&Bound { views_lower, ..Bound::default() }));
        assert_eq!(told, ["beside those of earlier scans", "lower bound 9"]);
    }

    #[test]
    fn a_part_of_the_bar_has_its_name_where_there_is_room() {
        assert!(
            segment(0.3, Ink::Unmeasured, "missed").contains("width:30.000%")
                && segment(0.3, Ink::Unmeasured, "missed").contains("<b>missed</b>")
        );
        assert!(
            !segment(0.1, Ink::Unmeasured, "missed").contains("<b>")
                && segment(0.1, Ink::Measured(Grade::A), "A").contains("<b>A</b>")
        );
    }

    #[test]
    fn one_view_without_a_path_is_no_views() {
        assert_eq!(without_path(1), "1 more was chosen and has no path");
        assert_eq!(without_path(2), "2 more were chosen and have no path");
    }

    #[test]
    fn a_sentence_leaves_out_a_command_that_is_too_long_to_read() {
        let short = "--set setups=2";
        let long = format!("--set 'part.resting_poses=[{}]'", "0.1234567,".repeat(20));
        let told = |command: &str| format!("turn it over: {command}; recovers 12.3 mm²");
        assert_eq!(readable(&told(short), short, LEFT_OUT), told(short));
        assert_eq!(readable(&told(&long), &long, LEFT_OUT), "turn it over (options in report.txt); recovers 12.3 mm²");
        assert_eq!(readable(&told(&long), &long, ""), "turn it over; recovers 12.3 mm²");
    }

    #[test]
    fn the_next_action_has_a_box_of_its_own_and_the_level_its_colour() {
        let text = |standing: Standing, next: &str| {
            let lines = vec!["Target met".to_owned(), "4 views".to_owned()];
            VerdictText { standing, title: "Ready".to_owned(), lines, next: next.to_owned(), figures: Vec::new() }.block()
        };
        let block = text(Standing::from(PlanLevel::Limited), "Next: turn it over");
        assert!(block.starts_with("<div class=\"verdict short\">\n<h2>Ready</h2>\n<p>Target met</p>\n</div>\n"), "{block}");
        assert!(block.contains("<p class=\"action\">Next: turn it over</p>") && block.contains("<li>4 views</li>"), "{block}");
        let ready = text(Standing::from(PlanLevel::Ready), "");
        assert!(ready.contains("verdict met") && !ready.contains("class=\"action\""), "{ready}");
        assert!(text(Standing::from(PlanLevel::NotExecutable), "").contains("verdict none"));
    }
}
