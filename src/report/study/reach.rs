//! Reach of cell layouts: a table, a heat map and a summary.

use std::fmt::Write;

use super::svg::Svg;
use crate::cell::HousingFace;
use crate::planning::studies::reach::{AZIMUTHS, ELEVATIONS, Layout, Layouts, Mounting, best};
use crate::report::html::markup::number;
use crate::wire::words::{fixed, percent_below};

const CELL: [f64; 2] = [92.0, 34.0];
const LEFT: f64 = 86.0;
const TOP: f64 = 44.0;
const BELOW: f64 = 64.0;
/// Shades for shares from 0 to 1: light to dark of one hue, which also reads in grey (C. Brewer, *ColorBrewer*, Blues).
const SHADES: [&str; 6] = ["#eff3ff", "#c6dbef", "#9ecae1", "#6baed6", "#3182bd", "#08519c"];
/// First shade on which text is light.
const FIRST_DARK_SHADE: usize = 4;

/// Layouts and their reach.
pub struct ReachInput<'a> {
    /// Layouts that were compared.
    pub layouts: &'a Layouts,
    /// Results, mounting by mounting, height by height, foot by foot.
    pub found: &'a [Layout],
    /// Name of the cell.
    pub cell_name: &'a str,
}

/// Words for where the scanner sits on the flange.
#[must_use]
pub fn mounting_words(mounting: &Mounting) -> &'static str {
    match mounting.face {
        None => "as it is",
        Some(HousingFace::Top) => "on the top face (−y)",
        Some(HousingFace::Bottom) => "on the bottom face (+y)",
        Some(HousingFace::Left) => "on the left end (−x)",
        Some(HousingFace::Right) => "on the right end (+x)",
        Some(HousingFace::Back) => "on the back (−z)",
    }
}

fn share(layout: &Layout) -> Option<f64> {
    layout.reached.map(|reached| reached.hemisphere_share)
}

/// The table, one row per layout. `directions` counts those of the grid; `hemisphere_share` is the share of solid angle that they
/// stand for.
#[must_use]
pub fn csv(input: &ReachInput<'_>) -> String {
    let mut text =
        String::from("mounting,foot_mm,table_mm,fits,elevations,elevations_of,directions,directions_of,hemisphere_share\n");
    for layout in input.found {
        let label = mounting_words(&input.layouts.mountings[layout.mounting]);
        let reached = layout.reached;
        let count = |get: fn(crate::planning::studies::reach::Reached) -> usize| {
            reached.map_or(String::new(), |reached| get(reached).to_string())
        };
        // Writing to a String cannot fail.
        let _ = writeln!(
            text,
            "\"{label}\",{},{},{},{},{ELEVATIONS},{},{},{}",
            layout.foot_mm,
            layout.table_mm,
            reached.is_some(),
            count(|reached| reached.elevations),
            count(|reached| reached.directions),
            ELEVATIONS * AZIMUTHS,
            share(layout).map_or_else(String::new, |share| fixed(share, 6))
        );
    }
    text
}

/// The heat map for each mounting: share of the hemisphere's solid angle reached, by foot and height of the table.
#[must_use]
pub fn svg(input: &ReachInput<'_>) -> String {
    let Layouts { foot_mm, table_mm, mountings, .. } = input.layouts;
    let block = TOP + CELL[1] * table_mm.len() as f64 + BELOW;
    let title = format!("{}: share of the viewing hemisphere reached (solid angle)", input.cell_name);
    let spoken = best_words(input);
    let width = (LEFT + CELL[0] * foot_mm.len() as f64 + 40.0).max(520.0);
    let mut svg = Svg::new(width, 40.0 + block * mountings.len() as f64, &title, &format!("{title}. {spoken}"));
    for (index, mounting) in mountings.iter().enumerate() {
        let top = 30.0 + block * index as f64;
        svg.text(16.0, top + 30.0, "strong", &format!("Flange {}", mounting_words(mounting)));
        svg.upwards(24.0, top + TOP + 0.5 * CELL[1] * table_mm.len() as f64, "plate above foot, mm");
        let layouts = input.found.iter().filter(|layout| layout.mounting == index);
        for (place, layout) in layouts.enumerate() {
            let (row, column) = (place / foot_mm.len(), place % foot_mm.len());
            field(&mut svg, layout, [LEFT + CELL[0] * column as f64, top + TOP + CELL[1] * row as f64]);
        }
        for (row, table_mm) in table_mm.iter().enumerate() {
            svg.text(LEFT - 8.0, top + TOP + CELL[1] * (row as f64 + 0.5) + 4.0, "end", &number(*table_mm, 0));
        }
        let foot = top + TOP + CELL[1] * table_mm.len() as f64;
        for (column, foot_mm) in foot_mm.iter().enumerate() {
            svg.text(LEFT + CELL[0] * (column as f64 + 0.5), foot + 18.0, "middle", &number(*foot_mm, 0));
        }
        svg.text(LEFT + 0.5 * CELL[0] * foot_mm.len() as f64, foot + 38.0, "middle", "foot to the table's axis, mm");
    }
    svg.finish()
}

fn field(svg: &mut Svg, layout: &Layout, at: [f64; 2]) {
    let size = [CELL[0] - 2.0, CELL[1] - 2.0];
    let middle = [at[0] + 0.5 * CELL[0], at[1] + 0.5 * CELL[1] + 4.0];
    match share(layout) {
        None => {
            svg.rest(at, size);
            svg.text(middle[0], middle[1], "middle", "does not fit");
        }
        Some(share) => {
            let shade = ((share * SHADES.len() as f64) as usize).min(SHADES.len() - 1);
            svg.bar(SHADES[shade], at, size);
            let class = if shade >= FIRST_DARK_SHADE { "middle light" } else { "middle dark" };
            svg.text(middle[0], middle[1], class, &format!("{} %", percent_below(share, 1.0, 0)));
        }
    }
}

/// Describes the best layout, and the cell as it is.
#[must_use]
pub fn text(input: &ReachInput<'_>, own: Option<&Layout>) -> String {
    let mut text = String::new();
    if let Some(words) = own.map(|own| words(input, own)) {
        let _ = writeln!(text, "as it is: {words}");
    }
    let _ = writeln!(text, "{}", best_words(input));
    text
}

fn best_words(input: &ReachInput<'_>) -> String {
    best(input.found).map_or_else(|| "no layout fits".into(), |layout| format!("best: {}", words(input, layout)))
}

fn words(input: &ReachInput<'_>, layout: &Layout) -> String {
    let label = mounting_words(&input.layouts.mountings[layout.mounting]);
    let place = format!(
        "foot {} mm from the axis, plate {} mm above the foot, flange {label}",
        number(layout.foot_mm, 0),
        number(layout.table_mm, 0)
    );
    match layout.reached {
        None => format!("{place}: does not fit"),
        Some(reached) => format!(
            "{place}: {} of {ELEVATIONS} elevations, {} % of the hemisphere ({} of {} directions)",
            reached.elevations,
            percent_below(reached.hemisphere_share, 1.0, 0),
            reached.directions,
            ELEVATIONS * AZIMUTHS
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Pose;
    use crate::planning::studies::reach::Reached;

    fn layout(hemisphere_share: f64, directions: usize) -> Layout {
        let reached = Some(Reached { elevations: ELEVATIONS, hemisphere_share, directions });
        Layout { mounting: 0, foot_mm: 1300.0, table_mm: 500.0, reached }
    }

    /// A layout that reaches little of the hemisphere was told as one that reaches none, and all but little as all.
    #[test]
    fn a_field_of_the_map_is_rounded_neither_to_nothing_nor_to_all() {
        let told = |share: f64| {
            let mut svg = Svg::new(100.0, 100.0, "", "");
            field(&mut svg, &layout(share, 1), [0.0; 2]);
            svg.finish()
        };
        for (share, percent) in [(0.0, ">0 %<"), (0.0022, ">0.22 %<"), (0.5, ">50 %<"), (0.998, ">99 %<"), (1.0, ">100 %<")] {
            assert!(told(share).contains(percent), "{share}: {}", told(share));
        }
    }

    #[test]
    fn a_mounting_is_told_by_the_face_that_the_flange_is_on() {
        let told = |face: Option<HousingFace>| mounting_words(&Mounting { face, flange_from_scanner: Pose::identity() });
        assert_eq!([told(None), told(Some(HousingFace::Top))], ["as it is", "on the top face (−y)"]);
        assert_eq!(HousingFace::ALL.map(|face| told(Some(face))).map(|words| words.starts_with("on the ")), [true; 5]);
    }

    /// Half of the directions of the grid may be a third of the hemisphere.
    #[test]
    fn table_and_sentence_tell_the_share_of_solid_angle_beside_the_count_of_directions() {
        let mounting = Mounting { face: None, flange_from_scanner: Pose::identity() };
        let layouts = Layouts {
            part_mm: 120.0,
            foot_mm: vec![1300.0],
            table_mm: vec![500.0],
            mountings: vec![mounting],
            clearance_mm: 5.0,
        };
        let found = [layout(0.324, 240)];
        let input = ReachInput { layouts: &layouts, found: &found, cell_name: "cell" };
        let rows: Vec<String> = csv(&input).lines().map(str::to_owned).collect();
        assert_eq!(
            rows,
            [
                "mounting,foot_mm,table_mm,fits,elevations,elevations_of,directions,directions_of,hemisphere_share",
                "\"as it is\",1300,500,true,19,19,240,456,0.324000"
            ]
        );
        let said = text(&input, None);
        assert!(said.contains("19 of 19 elevations, 32 % of the hemisphere (240 of 456 directions)"), "{said}");
    }
}
