//! A cell from above and from the side: the robot's foot and how far it reaches, the arm and the scanner at home, the plate, what
//! stands around, and the floor.

use nalgebra::{Point3, Vector3};

use super::{Scale, range};
use crate::cell::{Body, Cell};
use crate::report::html::markup::number;
use crate::report::study::svg::Svg;

/// Size of the drawing, and of each of its two windows.
const SIZE: [f64; 2] = [1040.0, 600.0];
const WINDOW: [f64; 2] = [470.0, 440.0];
const TOP: [f64; 2] = [30.0, 90.0];
const SIDE: [f64; 2] = [540.0, 90.0];
/// Colours: the arm and its reach, the table, the scanner, other bodies.
const ARM: usize = 0;
const TABLE: usize = 1;
const SCANNER: usize = 2;
const OTHER: usize = 3;

/// Direction of the drawing's x and y in the base frame.
struct Plane {
    right: Vector3<f64>,
    up: Vector3<f64>,
}

impl Plane {
    fn of(&self, point: &Point3<f64>) -> [f64; 2] {
        [point.coords.dot(&self.right), point.coords.dot(&self.up)]
    }
}

/// Draws a cell from above, and from the side across the line from the robot's foot to the table.
#[must_use]
pub fn cell_svg(cell: &Cell) -> String {
    let table = cell.base_from_table.origin_mm();
    let apart_mm = table.x.hypot(table.y);
    let (_, reach_mm) = cell.robot.max_reach_mm();
    let millimetres = |length_mm: f64| number(length_mm, 0);
    let spoken = format!(
        "{}: {} with {} and {}; the plate's centre stands {} mm from the foot and {} mm above it; stretched, the arm reaches {} mm",
        cell.name,
        cell.robot.name,
        cell.scanner.name,
        cell.turntable.name,
        millimetres(apart_mm),
        millimetres(table.z),
        millimetres(reach_mm)
    );
    let mut svg = Svg::new(SIZE[0], SIZE[1], &cell.name, &spoken);
    svg.text(16.0, 48.0, "", &spoken);
    let towards = if apart_mm > 0.0 { Vector3::new(table.x, table.y, 0.0) / apart_mm } else { Vector3::x() };
    let above = Plane { right: Vector3::x(), up: Vector3::y() };
    let beside = Plane { right: towards, up: Vector3::z() };
    svg.text(TOP[0], TOP[1] - 12.0, "strong", "from above");
    svg.text(SIDE[0], SIDE[1] - 12.0, "strong", "from the side");
    view(&mut svg, cell, &above, TOP);
    view(&mut svg, cell, &beside, SIDE);
    for (number, words) in [(ARM, "arm, its reach"), (TABLE, "plate"), (SCANNER, "scanner at home"), (OTHER, "other bodies")] {
        let x = 30.0 + 150.0 * number as f64;
        svg.point(number, [x, SIZE[1] - 20.0], words);
        svg.text(x + 12.0, SIZE[1] - 16.0, "", words);
    }
    svg.text(SIDE[0] + 120.0, SIZE[1] - 16.0, "", "base frame, mm; to scale");
    svg.finish()
}

fn view(svg: &mut Svg, cell: &Cell, plane: &Plane, at: [f64; 2]) {
    let (shoulder, reach_mm) = cell.robot.max_reach_mm();
    let (foot, table) = (plane.of(&shoulder), plane.of(&cell.base_from_table.origin_mm()));
    let radius_mm = cell.turntable.plate_radius_mm;
    let floor = cell.floor_mm.map(|floor_mm| plane.of(&Point3::new(0.0, 0.0, floor_mm))[1]);
    let span = |axis: usize| {
        let plate = [table[axis] - radius_mm, table[axis] + radius_mm];
        range([foot[axis] - reach_mm, foot[axis] + reach_mm].into_iter().chain(plate).chain(floor.filter(|_| axis == 1)))
    };
    let scale = Scale::fit(span(0), span(1), at, WINDOW);
    svg.circle(ARM, scale.at(foot), scale.length(reach_mm), true);
    for body in cell.table_bodies.iter() {
        let turned = body_box(body, |corner| plane.of(&cell.base_from_table.point(corner)));
        rectangle(svg, TABLE, &scale, turned);
    }
    for body in &cell.obstacles {
        rectangle(svg, OTHER, &scale, body_box(body, |corner| plane.of(corner)));
    }
    plate(svg, cell, plane, &scale);
    arm(svg, cell, plane, &scale);
    if let Some(height) = floor.filter(|_| plane.up.z > 0.5) {
        let [_, y] = scale.at([0.0, height]);
        svg.line("grid", [at[0], y], [at[0] + WINDOW[0], y]);
        svg.text(at[0] + WINDOW[0], y - 4.0, "end", &format!("floor, {} mm", number(height, 0)));
    }
    dimensions(svg, cell, plane, &scale);
}

/// The plate: a circle from above, a line from the side; with the mark of its zero.
fn plate(svg: &mut Svg, cell: &Cell, plane: &Plane, scale: &Scale) {
    const STEPS: u32 = 72;
    let radius_mm = cell.turntable.plate_radius_mm;
    let rim = |step: u32| {
        let (sin, cos) = (std::f64::consts::TAU * f64::from(step) / f64::from(STEPS)).sin_cos();
        scale.at(plane.of(&cell.base_from_table.point(&Point3::new(radius_mm * cos, radius_mm * sin, 0.0))))
    };
    let points: Vec<[f64; 2]> = (0..=STEPS).map(rim).collect();
    svg.area(TABLE, &points);
    svg.series(TABLE, &points);
    svg.point(TABLE, rim(0), "0° of the plate");
}

/// The arm and the scanner's axis at home.
fn arm(svg: &mut Svg, cell: &Cell, plane: &Plane, scale: &Scale) {
    let joints_rad = &cell.home_rad.joints_rad;
    let origins = cell.robot.link_frames(joints_rad).map(|frame| Point3::from(frame.translation.vector));
    svg.series(ARM, &origins.map(|origin| scale.at(plane.of(&origin))));
    svg.point(ARM, scale.at(plane.of(&origins[0])), "foot of the robot");
    let base_from_scanner = cell.base_from_scanner(joints_rad);
    for body in &cell.scanner_bodies {
        rectangle(svg, SCANNER, scale, body_box(body, |corner| plane.of(&base_from_scanner.point(corner))));
    }
    let ends = [Point3::origin(), cell.scanner.best_focus_mm()].map(|point| scale.at(plane.of(&base_from_scanner.point(&point))));
    svg.series(SCANNER, &ends);
    svg.point(SCANNER, ends[1], "best focus at home");
}

/// Distances in words: foot to table, and the plate's height.
fn dimensions(svg: &mut Svg, cell: &Cell, plane: &Plane, scale: &Scale) {
    let table = cell.base_from_table.origin_mm();
    let (foot, place) = (scale.at([0.0, 0.0]), scale.at(plane.of(&table)));
    svg.line("mark", foot, place);
    let middle = [0.5 * (foot[0] + place[0]), 0.5 * (foot[1] + place[1])];
    let [x, y, z] = [table.x, table.y, table.z].map(|length_mm| number(length_mm, 0));
    let words = if plane.up.z > 0.5 { format!("plate at z = {z}") } else { format!("table at x = {x}, y = {y}") };
    svg.text(middle[0], middle[1] - 6.0, "middle strong", &words);
}

/// Lowest and highest place of a body's corners in the drawing's plane.
fn body_box(body: &Body, place: impl Fn(&Point3<f64>) -> [f64; 2]) -> [[f64; 2]; 2] {
    let corners: Vec<[f64; 2]> = body.corners_mm().iter().map(place).collect();
    let of = |axis: usize, pick: fn(f64, f64) -> f64| corners.iter().map(|corner| corner[axis]).reduce(pick).unwrap_or_default();
    [[of(0, f64::min), of(1, f64::min)], [of(0, f64::max), of(1, f64::max)]]
}

fn rectangle(svg: &mut Svg, number: usize, scale: &Scale, [[left, bottom], [right, top]]: [[f64; 2]; 2]) {
    let corners = [[left, bottom], [right, bottom], [right, top], [left, top], [left, bottom]].map(|corner| scale.at(corner));
    svg.area(number, &corners);
    svg.series(number, &corners);
}
