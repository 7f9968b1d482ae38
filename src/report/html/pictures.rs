//! Pictures of a report: the part from three sides, and the part from each chosen view. They are added to an album, which draws them
//! later. An overlay shows the part's axes, a scale bar, for views the field that all three devices share at best focus, and for
//! misses the numbers of spots.

use std::fmt::Write;

use nalgebra::{Point3, Vector3};
use rayon::iter::{IntoParallelRefIterator, ParallelIterator};

use super::album::{Album, Picture};
use super::markup::{escape, number};
use super::{ReportInput, ReportSubject};
use crate::cell::Scanner;
use crate::geometry::{Device, Mesh, Part, Pose, ScannerFrame, SimdLevel, Table, sort_descending};
use crate::planning::plan::{Grade, Outcome, PlannedView, Verdict};
use crate::planning::visibility::Row;
use crate::rendering::{Camera, Ink, Seen};

/// Width and height of a picture, pixels.
pub(super) const SIZE_PX: [usize; 2] = [640, 480];
/// Directions in which the border of the shared field is searched.
const FIELD_CORNERS: usize = 360;
/// Bisection steps of each search: to a millionth of the working distance.
const FIELD_STEPS: usize = 20;
/// Length of the drawn axes, pixels.
const AXIS_PX: f64 = 30.0;
/// Distance of the drawn axes' origin from the lower left corner, pixels.
const AXES_AT_PX: f64 = 44.0;
/// Max length of the scale bar, as a share of the picture's width.
const MAX_SCALE: f64 = 0.22;

/// Side from which the whole plan is shown: its name, and the direction to the camera relative to the part as placed.
pub(super) struct OverviewSide {
    /// Caption.
    pub(super) name: &'static str,
    towards_camera: [f64; 3],
}

/// Sides of the overviews. Front is −y, right is +x, up is +z of the part as placed.
pub(super) const SIDES: [OverviewSide; 3] = [
    OverviewSide { name: "From the front right, above", towards_camera: [0.62, -1.0, 0.72] },
    OverviewSide { name: "From the back left, above", towards_camera: [-0.62, 1.0, 0.72] },
    OverviewSide { name: "From below", towards_camera: [0.38, -0.62, -1.0] },
];

/// Adds the part from a side, as all views together measure it.
pub(super) fn overview(input: &ReportInput<'_>, album: &mut Album, side: &OverviewSide) -> String {
    let codes: Vec<u8> = input.outcome.verdicts.iter().map(|verdict| Ink::of_grade(*verdict).code()).collect();
    let inks = album.inks(&codes);
    let camera = overview_camera(&input.subject, first_pose(input.outcome), side);
    let alt = format!("{}: the part, coloured by grade", side.name);
    markup(&input.subject, album, Picture { camera, inks, through: false }, &alt, "")
}

/// Adds the part alone from a side.
pub(super) fn plain(
    subject: &ReportSubject<'_>,
    album: &mut Album,
    table_from_part: Pose<Table, Part>,
    side: &OverviewSide,
) -> String {
    let camera = overview_camera(subject, table_from_part, side);
    let inks = album.plain(Ink::ByOthers);
    markup(subject, album, Picture { camera, inks, through: false }, &format!("{}: the part", side.name), "")
}

/// A part in pictures, and how it lies.
#[derive(Clone, Copy)]
pub(super) struct PicturedPart<'a> {
    pub(super) mesh: &'a Mesh,
    pub(super) table_from_part: Pose<Table, Part>,
}

/// Adds a part from a side in given inks.
pub(super) fn in_inks(part: &PicturedPart<'_>, album: &mut Album, side: &OverviewSide, inks: &[u8], alt: &str) -> String {
    let camera = side_camera(part.mesh, part.table_from_part, side);
    overlay(part.mesh, album, Picture { camera, inks: inks.to_vec(), through: false }, &format!("{}: {alt}", side.name), "")
}

/// Parts of the surface that are seen from each side.
pub(super) fn seen_sides<'m>(input: &ReportInput<'_>, album: &'m Album, level: SimdLevel) -> Vec<Seen<'m>> {
    let seen =
        |side: &OverviewSide| Seen::new(album.model(), &overview_camera(&input.subject, first_pose(input.outcome), side), level);
    SIDES.par_iter().map(seen).collect()
}

/// Adds the part from a side in grey, with all missed surface showing through it and a drawing over it.
pub(super) fn misses(input: &ReportInput<'_>, album: &mut Album, side: &OverviewSide, drawing: &str) -> String {
    let codes: Vec<u8> = input.outcome.verdicts.iter().map(|verdict| Ink::of_cause(*verdict).code()).collect();
    let inks = album.inks(&codes);
    let camera = overview_camera(&input.subject, first_pose(input.outcome), side);
    let alt = format!("{}: the part in grey, with missed surface showing through in the colours of its causes", side.name);
    markup(&input.subject, album, Picture { camera, inks, through: true }, &alt, drawing)
}

/// Pose of the part in the first setup.
fn first_pose(outcome: &Outcome) -> Pose<Table, Part> {
    outcome.plan.table_from_part.unwrap_or_default()
}

fn overview_camera(subject: &ReportSubject<'_>, table_from_part: Pose<Table, Part>, side: &OverviewSide) -> Camera {
    side_camera(subject.mesh, table_from_part, side)
}

fn side_camera(mesh: &Mesh, table_from_part: Pose<Table, Part>, side: &OverviewSide) -> Camera {
    let part_from_table = table_from_part.inverse();
    let towards_camera = part_from_table.direction(&Vector3::from(side.towards_camera));
    Camera::looking_at(&mesh.vertices_mm, towards_camera, part_from_table.direction(&Vector3::z()), SIZE_PX)
}

/// Picture of the part as the scanner sees it from a view.
pub(super) fn of_view(input: &ReportInput<'_>, album: &Album, (view, row): (&PlannedView, &Row), size_px: [usize; 2]) -> Picture {
    // The scanner's frame has the axes of a device: +z forward, +x right, hence +y down.
    let camera_from_part: Pose<Device, Part> = Pose::claim(*view.part_from_scanner.inverse().isometry());
    let camera = Camera::fitted(camera_from_part, size_px, &input.subject.mesh.vertices_mm);
    Picture { camera, inks: album.inks(&inks_of_view(input.outcome, row)), through: false }
}

/// Adds the picture of a view.
pub(super) fn from_view(input: &ReportInput<'_>, album: &mut Album, view: &PlannedView, picture: Picture) -> String {
    let alt = format!("The part as seen from view {} ({}), coloured by what this view measures", view.id.0, view.label.as_str());
    let (field, camera) = (shared_field(input.subject.scanner), &picture.camera);
    let outline: Vec<String> = field.iter().filter_map(|p| camera.pixel(p)).map(|[x, y]| format!("{x:.1},{y:.1}")).collect();
    let outline = format!("<polygon class=\"field\" points=\"{}\"/>", outline.join(" "));
    markup(&input.subject, album, picture, &alt, &outline)
}

/// Codes of the inks for one view: its own grades, grey where only other views measure, one colour for what the plan misses.
fn inks_of_view(outcome: &Outcome, row: &Row) -> Vec<u8> {
    let others = |verdict: &Verdict| match verdict {
        Verdict::Measured(_) => Ink::ByOthers,
        Verdict::Missed(_) | Verdict::NotAsked => Ink::of_grade(*verdict),
    };
    let mut codes: Vec<u8> = outcome.verdicts.iter().map(|verdict| others(verdict).code()).collect();
    for (sample, quality) in row.graded() {
        let code = &mut codes[sample.index()];
        if *code != Ink::NotAsked.code() {
            *code = Ink::Measured(Grade::of(f64::from(quality))).code();
        }
    }
    codes
}

fn markup(subject: &ReportSubject<'_>, album: &mut Album, picture: Picture, alt: &str, drawing: &str) -> String {
    overlay(subject.mesh, album, picture, alt, drawing)
}

/// Adds a picture with axes, scale and a drawing over it.
fn overlay(mesh: &Mesh, album: &mut Album, picture: Picture, alt: &str, drawing: &str) -> String {
    let axes = axes(&picture.camera);
    let scale = scale(&picture.camera, &picture.camera.camera_from_part.point(&mesh.aabb().centre()));
    let size_px = picture.camera.size_px;
    overlaid(size_px, &album.add(picture), alt, &format!("{drawing}{axes}{scale}"))
}

/// A picture at an address, with a drawing over it in its pixels.
pub(super) fn overlaid([width, height]: [usize; 2], address: &str, alt: &str, drawing: &str) -> String {
    format!(
        "<div class=\"picture\"><img width=\"{width}\" height=\"{height}\" alt=\"{}\" src=\"{address}\"/>\
         <svg viewBox=\"0 0 {width} {height}\" aria-hidden=\"true\">{drawing}</svg></div>",
        escape(alt),
    )
}

/// Draws the part's axes, those that point away first.
fn axes(camera: &Camera) -> String {
    let [x0, y0] = [AXES_AT_PX, camera.size_px[1] as f64 - AXES_AT_PX];
    let mut axes = [("x", Vector3::x()), ("y", Vector3::y()), ("z", Vector3::z())]
        .map(|(name, axis)| (name, camera.camera_from_part.direction(&axis)));
    sort_descending(&mut axes, |axis| axis.1.z);
    let mut svg = String::new();
    for (name, axis) in axes {
        let at = |length_px: f64| (x0 + length_px * axis.x, y0 + length_px * axis.y);
        let ((x, y), (x_name, y_name)) = (at(AXIS_PX), at(AXIS_PX + 9.0));
        // Writing to a String cannot fail.
        let _ = write!(svg, "<line class=\"axes\" x1=\"{x0}\" y1=\"{y0}\" x2=\"{x:.1}\" y2=\"{y:.1}\"/>");
        let _ = write!(svg, "<text class=\"axes\" x=\"{x_name:.1}\" y=\"{:.1}\">{name}</text>", y_name + 4.0);
    }
    svg
}

/// Draws a bar of a round length, to scale at the depth of `at` (camera frame).
fn scale(camera: &Camera, at: &Point3<f64>) -> String {
    let [width, height] = camera.size_px.map(|n| n as f64);
    let px_per_mm = camera.focal_px / at.z;
    if !(at.z > 0.0 && px_per_mm > 0.0) {
        return String::new();
    }
    let max_mm = MAX_SCALE * width / px_per_mm;
    let decade = 10f64.powf(max_mm.log10().floor());
    let length_mm = [5.0, 2.0, 1.0].into_iter().map(|n| n * decade).find(|n| *n <= max_mm).unwrap_or(decade);
    let (right, y) = (width - 20.0, height - 20.0);
    let left = right - length_mm * px_per_mm;
    let decimals = if length_mm < 1.0 { 2 } else { 0 };
    format!(
        "<path class=\"scale\" d=\"M{left:.1} {:.1}V{y}H{right}V{:.1}\"/><text class=\"scale\" x=\"{:.1}\" y=\"{:.1}\">{} mm</text>",
        y - 6.0,
        y - 6.0,
        (left + right) / 2.0,
        y - 8.0,
        number(length_mm, decimals)
    )
}

/// Border of the field that all three devices share in the plane of best focus, scanner frame; empty if they do not share
/// its centre.
fn shared_field(scanner: &Scanner) -> Vec<Point3<f64>> {
    let device_from_scanner = scanner.devices.map(|device| (device.lens, device.scanner_from_device.inverse()));
    let shared = |p: &Point3<f64>| {
        device_from_scanner.iter().all(|(lens, pose): &(_, Pose<Device, ScannerFrame>)| lens.project(&pose.point(p)).is_some())
    };
    let at = |angle: f64, radius_mm: f64| Point3::new(radius_mm * angle.cos(), radius_mm * angle.sin(), scanner.best_mm);
    if !shared(&at(0.0, 0.0)) {
        return Vec::new();
    }
    let border = |corner: usize| {
        let angle = std::f64::consts::TAU * corner as f64 / FIELD_CORNERS as f64;
        let (mut inside, mut outside) = (0.0, 2.0 * scanner.best_mm);
        for _ in 0..FIELD_STEPS {
            let middle = f64::midpoint(inside, outside);
            if shared(&at(angle, middle)) { inside = middle } else { outside = middle }
        }
        at(angle, inside)
    };
    (0..FIELD_CORNERS).map(border).collect()
}
