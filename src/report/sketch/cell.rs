//! A cell from above and from the side: the robot's foot and how far it reaches, the arm and the scanner at home, the plate, what
//! stands around, and the floor.

use nalgebra::{Point3, Vector3};

use super::{Scale, range};
use crate::cell::{Body, Cell};
use crate::report::html::markup::number;
use crate::report::study::svg::Svg;

/// Size of the drawing, and of each of its two windows.
const SIZE: [f64; 2] = [1040.0, 630.0];
const WINDOW: [f64; 2] = [470.0, 440.0];
const TOP: [f64; 2] = [30.0, 130.0];
const SIDE: [f64; 2] = [540.0, 130.0];
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
    let devices = format!("robot {}, scanner {}, turntable {}", cell.robot.name, cell.scanner.name, cell.turntable.name);
    let distances = format!(
        "the plate's centre is {} mm from the robot's foot and {} mm {} it; stretched, the arm reaches {} mm",
        millimetres(apart_mm),
        millimetres(table.z.abs()),
        if table.z < 0.0 { "below" } else { "above" },
        millimetres(reach_mm)
    );
    let mut svg = Svg::new(SIZE[0], SIZE[1], &cell.name, &format!("{}: {devices}; {distances}", cell.name));
    svg.text(16.0, 50.0, "", &devices);
    svg.text(16.0, 70.0, "", &distances);
    let towards = if apart_mm > 0.0 { Vector3::new(table.x, table.y, 0.0) / apart_mm } else { Vector3::x() };
    let above = Plane { right: Vector3::x(), up: Vector3::y() };
    let beside = Plane { right: towards, up: Vector3::z() };
    // Figures stand beside the drawings: in them they would cover what they are of.
    let floor = cell.floor_mm.map_or_else(String::new, |floor_mm| format!(", floor at z = {}", millimetres(floor_mm)));
    let [x, y, z] = [table.x, table.y, table.z].map(millimetres);
    svg.text(TOP[0], TOP[1] - 22.0, "strong", &format!("from above: plate at x = {x}, y = {y}"));
    svg.text(SIDE[0], SIDE[1] - 22.0, "strong", &format!("from the side: plate at z = {z}{floor}"));
    view(&mut svg, cell, &above, TOP);
    view(&mut svg, cell, &beside, SIDE);
    for (number, words) in
        [(ARM, "arm at home, its reach"), (TABLE, "plate, mark at 0°"), (SCANNER, "scanner, best focus"), (OTHER, "other bodies")]
    {
        let x = 30.0 + 190.0 * number as f64;
        svg.point(number, [x, SIZE[1] - 20.0], words);
        svg.text(x + 12.0, SIZE[1] - 16.0, "", words);
    }
    svg.text(30.0 + 190.0 * 4.0, SIZE[1] - 16.0, "", "base frame, mm; to scale");
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
    }
    svg.line("mark", scale.at([0.0, 0.0]), scale.at(table));
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
