//! Pictures with their captions: the part from three sides, and one card for each chosen view.

use std::collections::BTreeSet;
use std::sync::atomic::{AtomicUsize, Ordering};

use nalgebra::Vector3;
use rayon::iter::{IndexedParallelIterator, IntoParallelIterator, IntoParallelRefIterator, ParallelIterator};

use super::ReportInput;
use super::markup::{number, percent, triple};
use super::palette::Ink;
use super::pictures;
use super::renderer::Scene;
use super::words;
use crate::cell::PoseSpec;
use crate::planning::context::{Cancelled, Context};
use crate::planning::plan::{Cause, Grade, PlannedView, Verdict, share};
use crate::planning::stations::Station;
use crate::planning::visibility::Row;

/// Max views with a picture of their own; a page with more is slow to make and to open.
pub(super) const MAX_PICTURES: usize = 48;

const GRADES: [Ink; 4] = [Ink::Measured(Grade::A), Ink::Measured(Grade::B), Ink::Measured(Grade::C), Ink::Measured(Grade::D)];

/// Section of the part from three sides, as all views together measure it.
pub(super) fn overviews(input: &ReportInput<'_>, scene: &Scene<'_>) -> String {
    format!(
        "<section>\n<h2>Coverage by all views together</h2>\n{}{}\
         <p class=\"soft\">x, y, z are the axes of the uploaded file. The scale bar holds at the part’s centre.</p>\n\
         </section>\n",
        three_sides(|side| pictures::overview(input, scene, side)),
        legend(input, scene, &GRADES)
    )
}

/// Section of the part from three sides with its misses showing through; empty if nothing is missed.
pub(super) fn misses(input: &ReportInput<'_>, scene: &Scene<'_>) -> String {
    let missed = &input.outcome.plan.missed;
    if missed.is_empty() {
        return String::new();
    }
    let rests = missed.iter().any(|missed| missed.cause == Cause::ExcludedResting);
    let resting = if rests { " Surface that the part stands on is shown only from below." } else { "" };
    format!(
        "<section>\n<h2>Where surface is missed</h2>\n<p>The part is shown in grey and transparent; every missed spot has the \
         colour of its cause, paler where something hides it from this side.{resting}</p>\n{}{}</section>\n",
        three_sides(|side| pictures::misses(input, scene, side)),
        legend(input, scene, &[])
    )
}

fn three_sides(picture: impl Fn(&pictures::OverviewSide) -> String + Sync) -> String {
    let figure =
        |side: &pictures::OverviewSide| format!("<figure>{}<figcaption>{}</figcaption></figure>\n", picture(side), side.name);
    let figures: Vec<String> = pictures::SIDES.par_iter().map(figure).collect();
    format!("<div class=\"grid3\">\n{}</div>\n", figures.concat())
}

/// Section with one card for each chosen view, in the order chosen.
///
/// # Errors
/// [`Cancelled`].
pub(super) fn chosen(input: &ReportInput<'_>, scene: &Scene<'_>, ctx: &Context<'_>) -> Result<String, Cancelled> {
    let views = &input.outcome.plan.views;
    let done = AtomicUsize::new(0);
    let cards: Vec<String> = views
        .into_par_iter()
        .zip(&input.outcome.measured_by_view)
        .enumerate()
        .map(|(position, (view, row))| {
            ctx.check()?;
            let card = card(input, scene, position, view, row);
            ctx.progress(done.fetch_add(1, Ordering::Relaxed) + 1, views.len());
            Ok(card)
        })
        .collect::<Result<_, Cancelled>>()?;
    Ok(format!(
        "<section>\n<h2>The chosen views</h2>\n<p>Each picture shows the part from the viewpoint itself, with the scanner’s \
         baseline horizontal. Blue is what this view measures, by its own grade; grey is measured by other views. The dashed \
         line is the field that both cameras and the projector share at best focus.{}</p>\n{}\
         <div class=\"views\" style=\"margin-top:14px\">\n{}\
         </div>\n</section>\n",
        if views.len() > MAX_PICTURES { format!(" The first {MAX_PICTURES} views have pictures.") } else { String::new() },
        legend(input, scene, &[GRADES.as_slice(), &[Ink::ByOthers]].concat()),
        cards.concat()
    ))
}

fn card(input: &ReportInput<'_>, scene: &Scene<'_>, position: usize, view: &PlannedView, row: &Row) -> String {
    let coverage = &input.outcome.plan.coverage;
    let so_far = coverage.curve_area_mm2.get(position).map_or(0.0, |area_mm2| share(*area_mm2, coverage.asked_area_mm2));
    let mut details = vec![
        ("adds", format!("{} of the asked area, {} so far", percent(view.gain_of_asked), percent(so_far))),
        ("position", format!("{} mm", triple(view.part_from_scanner.origin_mm().into(), 1))),
        ("direction", triple(view.part_from_scanner.direction(&Vector3::z()).into(), 3)),
        ("quaternion", triple_and_w(&PoseSpec::from(&view.part_from_scanner).quaternion_xyzw)),
    ];
    details.extend(view.station.iter().flat_map(station));
    if let Some(cause) = view.rejected {
        details.push(("rejected", format!("measures nothing: {}", words::cause_name(cause))));
    }
    let picture = if position < MAX_PICTURES { pictures::from_view(input, scene, view, row) } else { String::new() };
    let rows: Vec<String> = details.iter().map(|(name, value)| format!("<dt>{name}</dt><dd>{value}</dd>")).collect();
    format!(
        "<figure>{}<figcaption><div class=\"head\"><h3>View {} <span class=\"chip\">{}</span></h3>\
         <span class=\"soft\">candidate {}</span></div>\n<dl class=\"details\">{}</dl></figcaption></figure>\n",
        picture,
        view.id.0,
        view.label.as_str(),
        view.candidate.0,
        rows.concat()
    )
}

fn triple_and_w(xyzw: &[f64; 4]) -> String {
    format!("({})", xyzw.map(|value| number(value, 5)).join(", "))
}

fn station(station: &Station) -> [(&'static str, String); 2] {
    let joints = station.joints_rad.map(|joint| number(joint.to_degrees(), 1)).join(", ");
    [("turntable", format!("{}°", number(station.table_angle_rad.to_degrees(), 1))), ("joints 1 to 6", format!("{joints}°"))]
}

/// Legend of `measured` and of the inks of unmeasured surface.
fn legend(input: &ReportInput<'_>, scene: &Scene<'_>, measured: &[Ink]) -> String {
    let others = input.outcome.verdicts.iter().filter(|verdict| !matches!(verdict, Verdict::Measured(_)));
    let mut inks: BTreeSet<Ink> = others.copied().map(Ink::of).chain(measured.iter().copied()).collect();
    if scene.open {
        inks.insert(Ink::Back);
    }
    let items: Vec<String> = inks.iter().map(|ink| format!("<li>{}{}</li>", swatch(*ink), ink.label())).collect();
    format!("<ul class=\"legend\">{}</ul>\n", items.concat())
}

/// A small square in the colour of an ink.
pub(super) fn swatch(ink: Ink) -> String {
    format!("<span class=\"swatch\" style=\"background:{}\"></span>", ink.hex())
}
