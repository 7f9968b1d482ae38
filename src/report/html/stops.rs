//! The stops in the robot's order, setup by setup: a thumbnail each, which opens to the picture and all figures of the view.

use nalgebra::Vector3;
use rayon::iter::{IntoParallelRefIterator, ParallelIterator};

use super::ReportInput;
use super::album::{Album, Picture};
use super::markup::{duration, escape, number, percent, triple};
use super::pictures;
use super::views::{GRADES, legend, unmeasured};
use super::words;
use crate::cell::PoseSpec;
use crate::planning::context::{Cancelled, Context};
use crate::planning::plan::{Plan, PlannedView, SetupId, SetupPlan, ViewId, share};
use crate::planning::sequence::Leg;
use crate::rendering::Ink;
use crate::wire::summary::ProgramCycle;
use crate::wire::words::{asked_name, counted, turn_phrase};

/// Max stops with a picture; a page with more is slow to make and to open.
pub(super) const MAX_PICTURES: usize = 120;
/// Max stops with large pictures.
const LARGE_PICTURES: usize = 48;

/// A view where the robot takes it.
struct Stop<'a> {
    /// Place in the robot's order within its setup, from 1; in the order chosen without a cell; `None` if it is not executed.
    number: Option<usize>,
    view: &'a PlannedView,
    /// The move that leads there, and the time at which it ends, seconds after the start of the setup's program.
    arrival: Option<(&'a Leg, f64)>,
}

/// Stops that stand together, below a title.
struct Group<'a> {
    title: String,
    stops: Vec<Stop<'a>>,
}

/// The section.
///
/// # Errors
/// [`Cancelled`].
pub(super) fn section(input: &ReportInput<'_>, album: &mut Album, ctx: &Context<'_>) -> Result<String, Cancelled> {
    let plan = &input.outcome.plan;
    let groups = groups(plan);
    let stops: Vec<&Stop<'_>> = groups.iter().flat_map(|group| &group.stops).collect();
    let count = stops.len();
    let size_px = if count <= LARGE_PICTURES { pictures::SIZE_PX } else { pictures::SIZE_PX.map(|n| n / 2) };
    let picture = |stop: &&Stop<'_>| {
        ctx.check()?;
        let row = input.outcome.measured_by_view.get(stop.view.id.index());
        Ok(row.map(|row| pictures::of_view(input, album, (stop.view, row), size_px)))
    };
    let with_picture = &stops[..count.min(MAX_PICTURES)];
    let pictures: Vec<Option<Picture>> = with_picture.par_iter().map(picture).collect::<Result<_, Cancelled>>()?;
    let pictures = pictures.into_iter().chain(std::iter::repeat_with(|| None));
    let cards: Vec<String> = stops.iter().zip(pictures).map(|(stop, picture)| card(input, album, stop, picture)).collect();
    let mut cards = cards.into_iter();
    let mut body = String::new();
    for group in &groups {
        let stops: String = cards.by_ref().take(group.stops.len()).collect();
        body += &format!("{}<div class=\"stops\">\n{stops}</div>\n", group.title);
    }
    let ordered = plan.sequences().next().is_some();
    let program = input.summary.program_cycle.as_ref().and_then(ProgramCycle::before_first_run_text);
    let program = program.map_or_else(String::new, |work| format!("<p><b>{}.</b></p>\n", escape(&work)));
    let inks = GRADES.into_iter().chain([Ink::ByOthers]).chain(unmeasured(input, Ink::of_grade));
    Ok(format!(
        "<section>\n<h2>{}</h2>\n<p>Each picture shows the part from the viewpoint itself, with the scanner’s baseline horizontal, \
         coloured by what this view measures; grey surface is measured by other views. The dashed line is the field that both cameras and \
         the projector share at best focus. {}{}</p>\n{program}{}{body}</section>\n",
        if ordered { "Stops in the robot’s order" } else { "The chosen views" },
        how_to_read(ordered),
        if count > MAX_PICTURES { format!(" The first {MAX_PICTURES} have pictures.") } else { String::new() },
        legend(album, inks, ink_name)
    ))
}

/// Name of an ink in the picture of one view.
fn ink_name(ink: Ink) -> &'static str {
    if ink == Ink::ByOthers { "Measured by other views" } else { ink.label() }
}

/// Says what the times of the stops are, and on a screen how to open one.
fn how_to_read(ordered: bool) -> &'static str {
    if ordered {
        "Times are those of the plan, from the start of the setup, with arm and table moving together; a controller that moves them \
         in turn takes longer. <span class=\"screen\">Click a stop to see its pose and joints.</span>"
    } else {
        "<span class=\"screen\">Click a view to see its pose.</span>"
    }
}

/// Stops of each setup in order, and last the views that are not executed.
fn groups(plan: &Plan) -> Vec<Group<'_>> {
    let mut groups: Vec<Group<'_>> = SetupId::number(&plan.setups).map(|(id, setup)| group(plan, id, setup)).collect();
    groups.retain(|group| !group.stops.is_empty());
    let left_out: Vec<Stop<'_>> =
        plan.views.iter().filter(|view| view.rejected.is_some()).map(|view| Stop { number: None, view, arrival: None }).collect();
    if !left_out.is_empty() {
        groups.push(Group { title: "<h3>Chosen, but not executed</h3>\n".to_owned(), stops: left_out });
    }
    groups
}

fn group<'a>(plan: &'a Plan, id: SetupId, setup: &'a SetupPlan) -> Group<'a> {
    let planned = |view: ViewId| plan.views.get(view.index()).filter(|view| view.rejected.is_none());
    let mut stops = Vec::new();
    match &setup.sequence {
        Some(sequence) => {
            let scan = &plan.params.scan;
            let captures = |view: ViewId| plan.views.get(view.index()).map_or(1, |view| view.levels(scan).len());
            let mut secs = 0.0;
            for (view, leg) in &sequence.visits {
                secs += leg.duration_secs;
                stops.extend(planned(*view).map(|view| Stop { number: None, view, arrival: Some((leg, secs)) }));
                secs += scan.settle_secs + scan.capture_secs * captures(*view) as f64;
            }
        }
        None => {
            let views = setup.views.iter().filter_map(|view| planned(*view));
            stops.extend(views.map(|view| Stop { number: None, view, arrival: None }));
        }
    }
    stops.iter_mut().zip(1..).for_each(|(stop, number)| stop.number = Some(number));
    let turn = plan.turn_into(id).map_or_else(String::new, |turn| format!(", from setup 1: {}", turn_phrase(&turn)));
    let title = if plan.setups.len() > 1 { format!("<h3>Setup {}{turn}</h3>\n", id.0 + 1) } else { String::new() };
    Group { title, stops }
}

/// A stop: its thumbnail, if it has one, and behind it all its figures.
fn card(input: &ReportInput<'_>, album: &mut Album, stop: &Stop<'_>, picture: Option<Picture>) -> String {
    let view = stop.view;
    let picture = picture.map(|picture| pictures::from_view(input, album, view, picture));
    let mut line = vec![format!("View {} · {}", view.id.0, view.label.as_str())];
    line.extend(stop.arrival.map(|(leg, secs)| {
        let table_deg = leg.target.table_angle_rad.to_degrees();
        format!("table {}° · at {}", number(table_deg, 1), duration(secs))
    }));
    let line: String = line.iter().map(|text| format!("<span class=\"soft\">{text}</span>")).collect();
    let number = stop.number.map_or_else(String::new, |number| format!("<b>{number}</b>"));
    let details: String = details(input, stop).iter().map(|(name, value)| format!("<dt>{name}</dt><dd>{value}</dd>")).collect();
    format!(
        "<details class=\"stop\" data-view=\"{}\"><summary>{}<span class=\"line\">{number}{line}</span></summary>\
         <dl class=\"details\">{details}</dl></details>\n",
        view.id.0,
        picture.unwrap_or_default()
    )
}

fn details(input: &ReportInput<'_>, stop: &Stop<'_>) -> Vec<(&'static str, String)> {
    let (view, coverage) = (stop.view, &input.outcome.plan.coverage);
    let so_far = coverage.curve_area_mm2.get(view.id.index()).map_or(0.0, |mm2| share(*mm2, coverage.asked_area_mm2));
    let (asked, adds) = (asked_name(coverage.is_of_open), percent(view.gain_of_asked));
    let mut details = vec![
        ("adds", format!("{adds} of the {asked} area, {} with the views chosen before", percent(so_far))),
        ("position", format!("{} mm", triple(view.part_from_scanner.origin_mm().into(), 1))),
        ("direction", triple(view.part_from_scanner.direction(&Vector3::z()).into(), 3)),
        ("quaternion", quadruple(&PoseSpec::from(&view.part_from_scanner).quaternion_xyzw)),
    ];
    if let Some(station) = &view.station {
        let joints = station.joints_rad.map(|joint| number(joint.to_degrees(), 1)).join(", ");
        details.push(("turntable", format!("{}°", number(station.table_angle_rad.to_degrees(), 1))));
        details.push(("joints 1 to 6", format!("{joints}°")));
    }
    if let Some((leg, _)) = stop.arrival {
        let via = match leg.via_rad.len() {
            0 => "without via points".to_owned(),
            via => format!("through {}", counted(via, "via point")),
        };
        details.push(("move", format!("{}, {via}", duration(leg.duration_secs))));
    }
    details.push(("candidate", view.candidate.0.to_string()));
    if let Some(cause) = view.rejected {
        details.push(("not executed", format!("measures nothing: {}", words::cause_name(cause))));
    }
    details
}

fn quadruple(xyzw: &[f64; 4]) -> String {
    format!("({})", xyzw.map(|value| number(value, 5)).join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::planning::plan::Grade;

    #[test]
    fn how_to_open_a_stop_is_said_on_a_screen_alone() {
        assert!(how_to_read(true).ends_with(" longer. <span class=\"screen\">Click a stop to see its pose and joints.</span>"));
        assert_eq!(how_to_read(false), "<span class=\"screen\">Click a view to see its pose.</span>");
    }

    #[test]
    fn grey_is_not_what_the_pictured_view_measures() {
        assert_eq!(ink_name(Ink::ByOthers), "Measured by other views");
        assert_eq!(ink_name(Ink::Measured(Grade::A)), "Grade A");
    }
}
