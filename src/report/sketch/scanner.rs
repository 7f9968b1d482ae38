//! A scanner from the side: its devices, what each sees in the plane y = 0, the field at best focus and the working depth.

use super::{Scale, range};
use crate::cell::Scanner;
use crate::report::html::markup::number;
use crate::report::study::svg::Svg;

/// Size of the drawing, and the window in it.
const SIZE: [f64; 2] = [760.0, 620.0];
const AT: [f64; 2] = [90.0, 70.0];
const WINDOW: [f64; 2] = [470.0, 500.0];
/// Left end of the legend.
const LEGEND: f64 = 590.0;
/// Words for the devices, in their order.
const DEVICES: [&str; 3] = ["left camera", "right camera", "projector"];

/// Draws a scanner from the side: +x to the right, depth downwards.
#[must_use]
pub fn scanner_svg(scanner: &Scanner) -> String {
    let [width, height] = scanner.common_field_at(scanner.best_mm).size_mm();
    let millimetres = |length_mm: f64| number(length_mm, 0);
    let spoken = format!(
        "{}: field {} × {} mm at {} mm, working depth {} to {} mm, cameras {} mm apart",
        scanner.name,
        millimetres(width),
        millimetres(height),
        millimetres(scanner.best_mm),
        millimetres(scanner.near_mm),
        millimetres(scanner.far_mm),
        millimetres(scanner.baseline_mm())
    );
    let mut svg = Svg::new(SIZE[0], SIZE[1], &format!("{} from the side", scanner.name), &spoken);
    let scale = scale(scanner);
    let at = |x_mm: f64, depth_mm: f64| scale.at([x_mm, -depth_mm]);
    for (index, device) in scanner.devices.iter().enumerate() {
        let (centre, seen) = (device.scanner_from_device.origin_mm(), device.field_at(scanner.far_mm).x_mm);
        let place = at(centre.x, centre.z);
        svg.area(index, &[place, at(seen[0], scanner.far_mm), at(seen[1], scanner.far_mm)]);
        let deg = number(device.incidence_max_rad.to_degrees(), 1);
        svg.point(index, place, &format!("{}, incidence up to {deg}°", DEVICES[index]));
    }
    for (words, depth_mm) in [("near", scanner.near_mm), ("best focus", scanner.best_mm), ("far", scanner.far_mm)] {
        let [_, y] = at(0.0, depth_mm);
        svg.line("mark", [AT[0] - 10.0, y], [AT[0] + WINDOW[0], y]);
        svg.text(AT[0] + WINDOW[0] + 6.0, y + 4.0, "", &format!("{words}, {} mm", millimetres(depth_mm)));
    }
    let [from, to] = scanner.common_field_at(scanner.best_mm).x_mm;
    svg.series(2, &[at(from, scanner.best_mm), at(to, scanner.best_mm)]);
    let [x, y] = at(0.5 * (from + to), scanner.best_mm);
    svg.text(x, y - 6.0, "middle strong", &format!("field {} × {} mm", millimetres(width), millimetres(height)));
    legend(&mut svg, scanner);
    svg.finish()
}

fn scale(scanner: &Scanner) -> Scale {
    let seen = scanner.devices.iter().flat_map(|device| device.field_at(scanner.far_mm).x_mm);
    let centres = scanner.devices.iter().map(|device| device.scanner_from_device.origin_mm());
    let x_mm = range(seen.chain(centres.clone().map(|centre| centre.x)));
    let z_mm = range(centres.map(|centre| -centre.z).chain([-scanner.far_mm]));
    Scale::fit(x_mm, z_mm, AT, WINDOW)
}

fn legend(svg: &mut Svg, scanner: &Scanner) {
    for (index, name) in DEVICES.into_iter().enumerate() {
        let y = AT[1] + 22.0 * index as f64;
        svg.point(index, [LEGEND, y], name);
        svg.text(LEGEND + 12.0, y + 4.0, "", name);
    }
    let [x, y, z] = scanner.practical_volume_mm.map(|edge_mm| number(edge_mm, 0));
    for (row, words) in [
        format!("cameras {} mm apart,", number(scanner.baseline_mm(), 0)),
        format!("axes {}° apart", number(scanner.axes_angle_rad().to_degrees(), 1)),
        "practical volume".to_owned(),
        format!("{x} × {y} × {z} mm"),
        format!("block cube {} mm", number(scanner.block_cube_mm, 0)),
    ]
    .into_iter()
    .enumerate()
    {
        svg.text(LEGEND - 6.0, AT[1] + 80.0 + 20.0 * row as f64, "", &words);
    }
    svg.text(16.0, SIZE[1] - 16.0, "", "plane y = 0 of the scanner's frame; to scale");
}
