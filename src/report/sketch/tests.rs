use super::{cell_svg, scanner_svg};
use crate::cell::{Cell, Presets, SpecLibrary};
use crate::testing::nominal_scanner;

fn cell() -> Cell {
    Presets.cell("e05-transcan").expect("a preset").build(&Presets).expect("valid")
}

/// Numbers of an attribute of every element, in order.
fn numbers(svg: &str, attribute: &str) -> Vec<f64> {
    let opening = format!(" {attribute}=\"");
    svg.split(&opening).skip(1).filter_map(|piece| piece.split('"').next()?.parse().ok()).collect()
}

#[test]
fn a_scanner_is_drawn_with_its_figures_inside_the_drawing() {
    let svg = scanner_svg(&nominal_scanner());
    assert!(svg.starts_with("<svg xmlns=") && svg.trim_end().ends_with("</svg>"));
    for words in ["near, 410 mm", "best focus, 480 mm", "far, 565 mm", "left camera", "projector", "202 mm apart", "× 190 mm"] {
        assert!(svg.contains(words), "{words:?} is not in\n{svg}");
    }
    assert_eq!(svg.matches("<polygon").count(), 3, "what each device sees");
    assert!(numbers(&svg, "x1").iter().chain(&numbers(&svg, "cx")).all(|x| (0.0..=760.0).contains(x)));
    assert!(numbers(&svg, "y1").iter().chain(&numbers(&svg, "cy")).all(|y| (0.0..=620.0).contains(y)));
}

#[test]
fn a_cell_is_drawn_from_above_and_from_the_side_with_reach_table_and_floor() {
    let svg = cell_svg(&cell());
    for words in [
        "from above: plate at x = 400, y = 0",
        "from the side: plate at z = −200, floor at z = −380",
        "0° of the plate",
        "200 mm below it",
    ] {
        assert!(svg.contains(words), "{words:?} is not in\n{svg}");
    }
    assert_eq!(svg.matches("stroke-dasharray=\"7 4\" cx").count(), 2, "a circle of the reach in each view");
    assert!(svg.matches("<polygon").count() >= 8, "plate, scanner, pedestal and housing in each view");
}

/// Box of each text: left, top, right and bottom, by a generous width of its letters.
fn text_boxes(svg: &str) -> Vec<([f64; 4], String)> {
    let number = |element: &str, name: &str| {
        let found = element.split(&format!(" {name}=\"")).nth(1).and_then(|rest| rest.split('"').next()?.parse::<f64>().ok());
        found.expect("a place")
    };
    let boxed = |element: &str| {
        let words = element.split('>').nth(1).expect("words").to_owned();
        let (x, y, width) = (number(element, "x"), number(element, "y"), 7.6 * words.chars().count() as f64);
        let left = if element.contains("end\"") {
            x - width
        } else if element.contains("middle") {
            x - 0.5 * width
        } else {
            x
        };
        ([left, y - 12.0, left + width, y + 3.0], words)
    };
    svg.split("<text").skip(1).map(|rest| boxed(rest.split("</text>").next().expect("an element"))).collect()
}

#[test]
fn labels_of_a_cell_cover_neither_each_other_nor_the_drawings() {
    let svg = cell_svg(&cell());
    let (labels, windows) = (text_boxes(&svg), [[30.0, 130.0, 500.0, 570.0], [540.0, 130.0, 1010.0, 570.0]]);
    let meet = |a: &[f64; 4], b: &[f64; 4]| a[0] < b[2] && b[0] < a[2] && a[1] < b[3] && b[1] < a[3];
    assert!(labels.len() >= 9, "{labels:?}");
    for (number, (label, words)) in labels.iter().enumerate() {
        assert!(label[0] >= 0.0 && label[2] <= 1040.0 && label[3] <= 630.0, "{words:?} leaves the drawing: {label:?}");
        let covered = labels[..number].iter().find(|(other, _)| meet(label, other));
        assert!(covered.is_none() && !windows.iter().any(|window| meet(label, window)), "{words:?} covers {covered:?}");
    }
}

#[test]
fn a_table_far_away_is_drawn_to_scale_as_well() {
    let mut far = cell();
    let near_reach = numbers(&cell_svg(&far), "r").into_iter().fold(0.0, f64::max);
    far.base_from_table =
        crate::geometry::Pose::from_parts(nalgebra::Vector3::new(2900.0, 0.0, 0.0), nalgebra::UnitQuaternion::identity());
    let svg = cell_svg(&far);
    assert!(svg.contains("plate at x = 2\u{202f}900, y = 0"), "{svg}");
    let far_reach = numbers(&svg, "r").into_iter().fold(0.0, f64::max);
    assert!(far_reach < 0.9 * near_reach, "{far_reach} beside {near_reach}: the drawing shrinks to hold the table");
}
