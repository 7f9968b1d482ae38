//! Pictures of the part from three sides, legends and swatches.

use std::collections::BTreeSet;

use super::ReportInput;
use super::album::Album;
use super::pictures;
use crate::planning::plan::{Grade, Verdict};
use crate::rendering::Ink;

/// The grades, from the best on.
pub(super) const GRADES: [Ink; 4] =
    [Ink::Measured(Grade::A), Ink::Measured(Grade::B), Ink::Measured(Grade::C), Ink::Measured(Grade::D)];

/// The part from three sides, as all views together measure it.
pub(super) fn overviews(input: &ReportInput<'_>, album: &mut Album) -> String {
    let pictures = three_sides(|side| pictures::overview(input, album, side));
    let legend = legend(album, GRADES.into_iter().chain(unmeasured(input, Ink::of_grade)), Ink::label);
    format!(
        "{}<p class=\"soft\">All views together. x, y, z are the axes of the uploaded file. The scale bar holds at the part’s \
         centre.</p>\n",
        together(&pictures, &legend)
    )
}

/// Coloured pictures or a bar with their legend, which print does not part.
pub(super) fn together(coloured: &str, legend: &str) -> String {
    format!("<div class=\"together\">\n{coloured}{legend}</div>\n")
}

/// A figure a side, side by side.
pub(super) fn three_sides(picture: impl FnMut(&pictures::OverviewSide) -> String) -> String {
    let pictures: Vec<String> = pictures::SIDES.iter().map(picture).collect();
    figures(&pictures)
}

/// Pictures of the three sides as figures with captions.
pub(super) fn figures(pictures: &[String]) -> String {
    let figure = |(picture, side): (&String, &pictures::OverviewSide)| {
        format!("<figure>{picture}<figcaption>{}</figcaption></figure>\n", side.name)
    };
    let figures: String = pictures.iter().zip(&pictures::SIDES).map(figure).collect();
    format!("<div class=\"grid3\">\n{figures}</div>\n")
}

/// Inks of the samples that are not measured.
pub(super) fn unmeasured(input: &ReportInput<'_>, ink: impl Fn(Verdict) -> Ink) -> BTreeSet<Ink> {
    let others = input.outcome.verdicts.iter().filter(|verdict| !matches!(verdict, Verdict::Measured(_)));
    others.map(|verdict| ink(*verdict)).collect()
}

/// Legend of the inks of a picture, each with its name.
pub(super) fn legend(album: &Album, inks: impl IntoIterator<Item = Ink>, name: impl Fn(Ink) -> &'static str) -> String {
    let mut inks: BTreeSet<Ink> = inks.into_iter().collect();
    if album.is_open() {
        inks.insert(Ink::Back);
    }
    let items: String = inks.iter().map(|ink| format!("<li>{}{}</li>", swatch(*ink), name(*ink))).collect();
    format!("<ul class=\"legend\">{items}</ul>\n")
}

/// A small square in the colour of an ink.
pub(super) fn swatch(ink: Ink) -> String {
    format!("<span class=\"swatch\" style=\"background:{}\"></span>", ink.hex())
}
